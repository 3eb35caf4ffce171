"""Compiled passes of the time-optimal plan without a jerk limit; see ``accelerations.py``.

Layout: ``rows (m, 2, n, p)``, ``cap (n, p)`` and ``offset (n, p)`` hold, for each of n intervals, p points from its left
to its right end, both included; x is linear on the interval, so that x = x_k + 2 a offset there.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from planner.geometry.kernels import F64, I64, NOTHING, READ2, WRITE1, WRITE2

READ4 = types.Array(F64, 4, "C", readonly=True)
_MOST_STEPS = 200  # of Newton; as many as there are lines at most, but for rounding


@njit(types.UniTuple(F64, 4)(READ4, READ2, READ2, I64, F64, F64, F64), cache=True, error_model="numpy")
def _control_range(rows, cap, offset, k, x, floor, ceiling):
    """Range of a on interval k from x: rows and caps at all of its points, and floor <= next x <= ceiling.

    Returns its lower and upper end, and how fast each moves with x.
    """
    twice = 2.0 * offset[k, offset.shape[1] - 1]
    low, high = (floor - x) / twice, (ceiling - x) / twice
    low_slope = high_slope = -1.0 / twice
    for p in range(offset.shape[1]):
        reach = 2.0 * offset[k, p]
        if reach > 0.0 and cap[k, p] - x < high * reach:
            high, high_slope = (cap[k, p] - x) / reach, -1.0 / reach
        for r in range(rows.shape[0]):
            alpha = rows[r, 0, k, p]
            beta = rows[r, 1, k, p] + reach * alpha
            if beta < 0.0:
                alpha, beta = -alpha, -beta
            if beta > 0.0:
                lower, upper = (-1.0 - alpha * x) / beta, (1.0 - alpha * x) / beta
                if lower > low:
                    low, low_slope = lower, -alpha / beta
                if upper < high:
                    high, high_slope = upper, -alpha / beta
    return low, high, low_slope, high_slope


@njit(F64(READ4, READ2, READ2, I64, F64, F64, F64, F64), cache=True, error_model="numpy")
def _extreme(rows, cap, offset, k, x, sign, floor, ceiling):
    """Extreme x at the left of interval k from which its right end can be reached: from above (sign 1) or below (-1).

    The width of the range of controls is a concave function of x, made of straight lines, so that Newton's iteration from
    outside meets its zero in as many steps as there are lines, at most (Pham and Pham, TOPP-RA, IEEE T-RO 34 (2018)).
    """
    for _ in range(_MOST_STEPS):
        low, high, low_slope, high_slope = _control_range(rows, cap, offset, k, x, floor, ceiling)
        if not low > high:
            return x
        closing = sign * (low_slope - high_slope)
        if not closing > 0.0:
            return np.nan if sign < 0.0 else 0.0
        following = x - sign * (low - high) / closing
        if sign > 0.0 and not 0.0 < following < x:
            return max(min(following, x), 0.0)
        if sign < 0.0 and not following > x:
            return x
        x = following
    return x


@njit(NOTHING(READ4, READ2, READ2, F64, WRITE2), cache=True, error_model="numpy")
def controllable(rows, cap, offset, end, out):
    """Write the least and the largest x (2, n + 1) from which the end can be reached; the end is left at x = ``end``.

    nan where there is none.
    """
    n, last = offset.shape[0], offset.shape[1] - 1
    out[0, n] = out[1, n] = end
    for k in range(n - 1, -1, -1):
        floor, ceiling = out[0, k + 1], min(out[1, k + 1], cap[k, last])
        top = cap[k, 0]
        if k > 0:
            top = min(top, cap[k - 1, last])
        for r in range(rows.shape[0]):
            for p in range(last + 1):
                alpha = abs(rows[r, 0, k, p])
                if alpha > 0.0 and rows[r, 1, k, p] + 2.0 * offset[k, p] * rows[r, 0, k, p] == 0.0:
                    top = min(top, 1.0 / alpha)
        out[1, k] = _extreme(rows, cap, offset, k, top, 1.0, floor, ceiling)
        out[0, k] = _extreme(rows, cap, offset, k, 0.0, -1.0, floor, ceiling) if floor > 0.0 else 0.0
        if not out[0, k] <= out[1, k] * (1.0 + 1e-12):
            out[:, : k + 1] = np.nan
            return


@njit(NOTHING(READ4, READ2, READ2, READ2, F64, WRITE1), cache=True, error_model="numpy")
def fastest(rows, cap, offset, reach, start, x):
    """Write the largest x (n + 1,) that can be reached from x = ``start`` within the controllable range ``reach``."""
    n = offset.shape[0]
    x[0] = start
    for k in range(n):
        _, high, _, _ = _control_range(rows, cap, offset, k, x[k], reach[0, k + 1], reach[1, k + 1])
        following = x[k] + 2.0 * offset[k, offset.shape[1] - 1] * high
        x[k + 1] = min(max(following, reach[0, k + 1]), reach[1, k + 1])
