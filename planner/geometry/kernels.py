"""Compiled evaluation of curve pieces and of arc length.

Two data structures reach compiled code, both plain arrays:

*Pieces* (m of them): ``breaks (m+1,)`` and ``coefficients (m, d+1, p+1)``.  On piece i, with the local parameter
``w = (u - breaks[i]) / (breaks[i+1] - breaks[i])`` in [0, 1], coordinate j is the ratio of two polynomials in w,
``coefficients[i, j, :]`` over ``coefficients[i, d, :]`` (ascending powers).  Where the curve is polynomial the
denominator is not looked at.

*Panels* (m of them): ``edges (m+1,)`` in u, ``lengths (m+1,)`` accumulated, and per panel the Chebyshev series of the
length since the panel's left edge.

Signatures are explicit and the machine code is cached, so only the very first import compiles.  Divisions follow numpy:
a denominator that underflows to 0 gives inf or nan, which the curve's own validation finds.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

# Arrays that a kernel only reads may be frozen, which is a type of its own to numba.
F64, I64, FLAG, NOTHING = types.float64, types.int64, types.boolean, types.void
READ1, READ2, READ3 = (types.Array(F64, n, "C", readonly=True) for n in (1, 2, 3))
WRITE1, WRITE2, WRITE3 = (types.Array(F64, n, "C") for n in (1, 2, 3))

# Newton on a Chebyshev panel converges in 3-5 passes; bisection, which takes over where it leaves the bracket, in 60.
_MAX_INVERSION_PASSES = 100


@njit(F64(READ1, F64), cache=True, error_model="numpy")
def _clenshaw(series, x):
    b1 = b2 = 0.0
    for k in range(series.size - 1, 0, -1):
        b1, b2 = series[k] + 2.0 * x * b1 - b2, b1
    return series[0] + x * b1 - b2


@njit(NOTHING(READ1, I64, F64, F64, WRITE1), cache=True, error_model="numpy")
def _horner(poly, degree, w, scale, out):
    """Value and first three derivatives with respect to u (dw/du = scale) of one polynomial."""
    b0 = poly[degree]
    b1 = b2 = b3 = 0.0
    for k in range(degree - 1, -1, -1):
        b3 = b3 * w + b2
        b2 = b2 * w + b1
        b1 = b1 * w + b0
        b0 = b0 * w + poly[k]
    out[0] = b0
    out[1] = b1 * scale
    out[2] = 2.0 * b2 * scale * scale
    out[3] = 6.0 * b3 * scale * scale * scale


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


@njit(NOTHING(READ1, READ3, FLAG, READ1, FLAG, I64, WRITE3), cache=True, error_model="numpy")
def evaluate_pieces(breaks, coefficients, rational, u, left, order, out):
    """Write the derivatives 0..order of the curve at every u into ``out (order+1, n, d)``.

    Horner with derivatives on each coordinate, then the quotient rule: with numerator N, denominator D and C = N/D,
    D C^(k) = N^(k) - sum_{i=1..k} binom(k, i) D^(i) C^(k-i).
    """
    dim = coefficients.shape[1] - 1
    degree = coefficients.shape[2] - 1
    num = np.empty(4)
    den = np.empty(4)
    piece = 0
    for n in range(u.size):
        piece = find_piece(breaks, u[n], left, piece)
        width = breaks[piece + 1] - breaks[piece]
        w = (u[n] - breaks[piece]) / width
        scale = 1.0 / width
        if rational:
            _horner(coefficients[piece, dim], degree, w, scale, den)
        for j in range(dim):
            _horner(coefficients[piece, j], degree, w, scale, num)
            if rational:
                num[0] = num[0] / den[0]
                num[1] = (num[1] - den[1] * num[0]) / den[0]
                num[2] = (num[2] - 2.0 * den[1] * num[1] - den[2] * num[0]) / den[0]
                num[3] = (num[3] - 3.0 * den[1] * num[2] - 3.0 * den[2] * num[1] - den[3] * num[0]) / den[0]
            for k in range(order + 1):
                out[k, n, j] = num[k]


@njit(NOTHING(READ1, READ1, READ2, READ1, WRITE1), cache=True, error_model="numpy")
def panel_length(edges, lengths, series, u, out):
    """Write the arc length at every u into ``out``: Clenshaw on the panel's series, exact at the edges."""
    panel = 0
    for n in range(u.size):
        panel = find_piece(edges, u[n], False, panel)
        x = 2.0 * (u[n] - edges[panel]) / (edges[panel + 1] - edges[panel]) - 1.0
        if u[n] <= edges[panel]:
            out[n] = lengths[panel]
        elif u[n] >= edges[panel + 1]:
            out[n] = lengths[panel + 1]
        else:
            out[n] = min(max(lengths[panel] + _clenshaw(series[panel], x), lengths[panel]), lengths[panel + 1])


@njit(NOTHING(READ1, READ1, READ2, READ2, READ1, FLAG, WRITE1), cache=True, error_model="numpy")
def panel_inverse(edges, lengths, series, speeds, s, left, out):
    """Write the parameter at every arc length s into ``out``.

    The lengths at the edges give the edges themselves, so breaks are met exactly; where the curve rests, the last of
    them (left: the first).  Between them Newton, with bisection where Newton leaves the bracket.
    """
    panel = 0
    for n in range(s.size):
        panel = find_piece(lengths, s[n], left, panel)
        target = s[n] - lengths[panel]
        total = lengths[panel + 1] - lengths[panel]
        if target >= total and (total > 0.0 or not left):
            out[n] = edges[panel + 1]
            continue
        if target <= 0.0:
            out[n] = edges[panel]
            continue
        half = 0.5 * (edges[panel + 1] - edges[panel])
        lo, hi = -1.0, 1.0
        x = 2.0 * target / total - 1.0
        for _ in range(_MAX_INVERSION_PASSES):
            error = _clenshaw(series[panel], x) - target
            if error > 0.0:
                hi = x
            else:
                lo = x
            slope = _clenshaw(speeds[panel], x) * half
            step = -error / slope if slope > 0.0 else 4.0
            if abs(step) <= 4e-16 or hi - lo <= 4e-16:
                break
            trial = x + step
            x = trial if lo <= trial <= hi else 0.5 * (lo + hi)
        out[n] = min(max(edges[panel] + half * (x + 1.0), edges[panel]), edges[panel + 1])
