"""Evaluation of curve pieces inside other compiled loops; see ``curve_inline.h``.

*Pieces* (m of them): ``breaks (m+1,)``, ``coefficients (m, d+1, p+1)`` and ``origin (m, d)``.  On piece i, with the local
parameter ``w = (u - breaks[i]) / (breaks[i+1] - breaks[i])`` in [0, 1], coordinate j is ``origin[i, j]`` and the ratio of
two polynomials in w, ``coefficients[i, j, :]`` over ``coefficients[i, d, :]`` (ascending powers).  Where the curve is
polynomial the denominator is not looked at.  ``resting (m, d)`` says which coordinates have one value all over a piece.

Signatures are explicit and the machine code is cached, so only the very first import compiles.  Divisions follow numpy:
a denominator that underflows to 0 gives inf or nan, which the curve's own validation finds.
"""

from __future__ import annotations

from numba import njit, types

# Arrays that a kernel only reads may be frozen, which is a type of its own to numba.
F64, I64, FLAG, NOTHING = types.float64, types.int64, types.boolean, types.void
READ1, READ2, READ3 = (types.Array(F64, n, "C", readonly=True) for n in (1, 2, 3))
WRITE1, WRITE2, WRITE3 = (types.Array(F64, n, "C") for n in (1, 2, 3))
FLAGS, FLAGS2 = (types.Array(FLAG, n, "C", readonly=True) for n in (1, 2))


@njit(forceinline=True)
def _horner(coefficients, piece, row, w):
    """Value and first three derivatives with respect to w, over 0!, 1!, 2! and 3!, of one polynomial."""
    b0 = coefficients[piece, row, coefficients.shape[2] - 1]
    b1 = b2 = b3 = 0.0
    for k in range(coefficients.shape[2] - 2, -1, -1):
        b3 = b3 * w + b2
        b2 = b2 * w + b1
        b1 = b1 * w + b0
        b0 = b0 * w + coefficients[piece, row, k]
    return b0, b1, b2, b3


@njit(I64(READ1, F64, FLAG, I64), cache=True, error_model="numpy")
def find_piece(breaks, u, left, guess):
    """Index i with breaks[i] <= u < breaks[i+1] (left: breaks[i] < u <= breaks[i+1]), trying ``guess`` first."""
    last = breaks.size - 2
    if 0 <= guess <= last:
        if left:
            if breaks[guess] < u <= breaks[guess + 1]:
                return guess
        elif breaks[guess] <= u < breaks[guess + 1]:
            return guess
    lo, hi = 0, last + 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if breaks[mid] < u or (not left and breaks[mid] == u):
            lo = mid
        else:
            hi = mid
    return lo


@njit(forceinline=True, error_model="numpy")
def point_on_pieces(breaks, coefficients, rational, resting, origin, u, left, guess, out):
    """Write the derivatives 0..3 of the curve at one parameter into ``out (4, d)``; returns the piece, tried first next.

    Horner with Taylor coefficients on each coordinate, then the quotient rule: with numerator N, denominator D, C = N/D
    from the origin and coefficients N_k = N^(k)/k!,  D C_k = N_k - sum_{i=1..k} D_i C_(k-i).
    """
    dim = coefficients.shape[1] - 1
    piece = find_piece(breaks, u, left, guess)
    scale = 1.0 / (breaks[piece + 1] - breaks[piece])
    w = (u - breaks[piece]) / (breaks[piece + 1] - breaks[piece])
    v0, v1, v2, v3 = 1.0, 0.0, 0.0, 0.0
    if rational:
        v0, v1, v2, v3 = _horner(coefficients, piece, dim, w)
        v0 = 1.0 / v0
    for j in range(dim):
        c0, c1, c2, c3 = _horner(coefficients, piece, j, w)
        if rational:
            c0 *= v0
            c1 = (c1 - v1 * c0) * v0
            c2 = (c2 - v1 * c1 - v2 * c0) * v0
            c3 = (c3 - v1 * c2 - v2 * c1 - v3 * c0) * v0
        if resting[piece, j]:
            # The quotient rule leaves rounding where a coordinate rests, and a direction made of rounding is none.
            c1 = c2 = c3 = 0.0
        out[0, j] = origin[piece, j] + c0
        out[1, j] = c1 * scale
        out[2, j] = 2.0 * c2 * scale * scale
        out[3, j] = 6.0 * c3 * scale * scale * scale
    return piece
