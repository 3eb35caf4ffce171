"""Passes of the plan without a jerk limit in plain Python: the compiled ones give the same bits."""

import numpy as np


def control_range(rows, bounds, cap, offset, k, lean, x, floor, ceiling):
    """Range of a on interval k from x: rows and 0 <= x <= cap at all of its points, and floor <= next x <= ceiling.

    Returns its lower and upper end, and how fast each moves with x.
    """
    twice = 2.0 * offset[k, offset.shape[1] - 1]
    low, high = (floor - x) / twice, (ceiling - x) / twice
    low_slope = high_slope = -1.0 / twice
    for p in range(offset.shape[1]):
        reach = 2.0 * offset[k, p]
        bump, tilt = lean * reach * (1.0 - reach / twice), lean * (1.0 - 2.0 * reach / twice)
        if reach > 0.0:
            if cap[k, p] - bump - x < high * reach:
                high, high_slope = (cap[k, p] - bump - x) / reach, -1.0 / reach
            if -bump - x > low * reach:
                low, low_slope = (-bump - x) / reach, -1.0 / reach
        for r in range(rows.shape[0]):
            alpha, beta = rows[r, 0, k, p], rows[r, 1, k, p]
            shift = alpha * bump + beta * tilt
            beta += reach * alpha
            most, least = bounds[r, 0], bounds[r, 1]
            if beta < 0.0:
                alpha, beta, shift = -alpha, -beta, -shift
                most, least = least, most
            if beta > 0.0:
                lower, upper = (-least - shift - alpha * x) / beta, (most - shift - alpha * x) / beta
                if lower > low:
                    low, low_slope = lower, -alpha / beta
                if upper < high:
                    high, high_slope = upper, -alpha / beta
    return low, high, low_slope, high_slope


def extreme(rows, bounds, cap, offset, k, lean, x, sign, floor, ceiling):
    """Extreme x at the left of interval k from which its right end can be reached: from above (sign 1) or below (-1).

    The width of the range of controls is a concave function of x, made of straight lines, so that Newton's iteration from
    outside meets its zero in as many steps as there are lines, at most (Pham and Pham, TOPP-RA, IEEE T-RO 34 (2018)).
    """
    for _ in range(200):
        low, high, low_slope, high_slope = control_range(rows, bounds, cap, offset, k, lean, x, floor, ceiling)
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


def controllable(rows, bounds, cap, offset, lean, slowest, fastest, out):
    """Write the least and the largest x (2, n + 1) from which an x within ``slowest`` and ``fastest`` can end the section.

    nan where there is none.  Where a lean (n,) would forbid rest it is set to 0.
    """
    n, last = offset.shape[0], offset.shape[1] - 1
    out[0, n], out[1, n] = slowest, fastest
    for k in range(n - 1, -1, -1):
        floor, ceiling = out[0, k + 1], min(out[1, k + 1], cap[k, last])
        top = cap[k, 0]
        if k > 0:
            top = min(top, cap[k - 1, last])
        for r in range(rows.shape[0]):
            for p in range(last + 1):
                alpha = rows[r, 0, k, p]
                if alpha != 0.0 and rows[r, 1, k, p] + 2.0 * offset[k, p] * alpha == 0.0:
                    lean[k] = 0.0
                    top = min(top, bounds[r, 0] / alpha if alpha > 0.0 else -bounds[r, 1] / alpha)
        if lean[k] != 0.0:
            low, high, _, _ = control_range(rows, bounds, cap, offset, k, lean[k], 0.0, 0.0, ceiling)
            if not low <= high:
                lean[k] = 0.0
        out[1, k] = extreme(rows, bounds, cap, offset, k, lean[k], top, 1.0, floor, ceiling)
        out[0, k] = extreme(rows, bounds, cap, offset, k, lean[k], 0.0, -1.0, floor, ceiling) if floor > 0.0 else 0.0
        if not out[0, k] <= out[1, k] * (1.0 + 1e-12):
            out[:, : k + 1] = np.nan
            return


def fastest(rows, bounds, cap, offset, lean, reach, start, x):
    """Write the largest x (n + 1,) that can be reached from x = ``start`` within the controllable range ``reach``."""
    n = offset.shape[0]
    x[0] = start
    for k in range(n):
        _, high, _, _ = control_range(rows, bounds, cap, offset, k, lean[k], x[k], reach[0, k + 1], reach[1, k + 1])
        following = x[k] + 2.0 * offset[k, offset.shape[1] - 1] * high
        x[k + 1] = min(max(following, reach[0, k + 1]), reach[1, k + 1])


def follow_rows(rows, bounds, offset, x, lean, out):
    """Write the lean of each interval that follows the row nearest to its bound there, given a law x (n + 1,).

    Along a smooth row at its bound b a is (b - alpha x) / beta at both ends; half their difference is the lean.
    """
    last = offset.shape[1] - 1
    for k in range(offset.shape[0]):
        h = offset[k, last]
        a = 0.5 * (x[k + 1] - x[k]) / h
        out[k] = 0.0
        if not (x[k] > 0.0 and x[k + 1] > 0.0):
            continue
        nearest, which, bound = 0.98, -1, 1.0
        for r in range(rows.shape[0]):
            for p in range(last + 1):
                w = offset[k, p]
                here = x[k] + 2.0 * w * (a + lean[k] * (1.0 - w / h))
                value = rows[r, 0, k, p] * here + rows[r, 1, k, p] * (a + lean[k] * (1.0 - 2.0 * w / h))
                share = value / bounds[r, 0] if value > 0.0 else -value / bounds[r, 1]
                if share > nearest:
                    nearest, which, bound = share, r, bounds[r, 0] if value > 0.0 else -bounds[r, 1]
        if which < 0 or not rows[which, 1, k, 0] * rows[which, 1, k, last] > 0.0:
            continue
        first = (bound - rows[which, 0, k, 0] * x[k]) / rows[which, 1, k, 0]
        second = (bound - rows[which, 0, k, last] * x[k + 1]) / rows[which, 1, k, last]
        most = 0.5 * min(x[k], x[k + 1]) / h
        out[k] = min(max(0.5 * (first - second), -most), most)
