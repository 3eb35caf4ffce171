"""Loops over curve pieces and arc length in plain Python: the compiled ones give the same bits."""

import numpy as np


def clenshaw(series, x):
    b1 = b2 = 0.0
    for k in range(series.size - 1, 0, -1):
        b1, b2 = series[k] + 2.0 * x * b1 - b2, b1
    return series[0] + x * b1 - b2


def horner(coefficients, piece, row, w):
    """Value and first three derivatives with respect to w, over 0!, 1!, 2! and 3!, of one polynomial."""
    b0 = coefficients[piece, row, coefficients.shape[2] - 1]
    b1 = b2 = b3 = 0.0
    for k in range(coefficients.shape[2] - 2, -1, -1):
        b3 = b3 * w + b2
        b2 = b2 * w + b1
        b1 = b1 * w + b0
        b0 = b0 * w + coefficients[piece, row, k]
    return b0, b1, b2, b3


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
        v0, v1, v2, v3 = horner(coefficients, piece, dim, w)
        v0 = 1.0 / v0
    for j in range(dim):
        c0, c1, c2, c3 = horner(coefficients, piece, j, w)
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


def evaluate_pieces(breaks, coefficients, rational, resting, origin, u, left, order, out):
    """Write the derivatives 0..order of the curve at every u into ``out (order+1, n, d)``, from the left where asked."""
    dim = coefficients.shape[1] - 1
    point = np.empty((4, dim))
    piece = 0
    for n in range(u.size):
        piece = point_on_pieces(breaks, coefficients, rational, resting, origin, u[n], left[n], piece, point)
        for k in range(order + 1):
            for j in range(dim):
                out[k, n, j] = point[k, j]


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
            out[n] = min(max(lengths[panel] + clenshaw(series[panel], x), lengths[panel]), lengths[panel + 1])


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
        for _ in range(100):
            error = clenshaw(series[panel], x) - target
            if error > 0.0:
                hi = x
            else:
                lo = x
            slope = clenshaw(speeds[panel], x) * half
            step = -error / slope if slope > 0.0 else 4.0
            if abs(step) <= 4e-16 or hi - lo <= 4e-16:
                break
            trial = x + step
            x = trial if lo <= trial <= hi else 0.5 * (lo + hi)
        out[n] = min(max(edges[panel] + half * (x + 1.0), edges[panel]), edges[panel + 1])
