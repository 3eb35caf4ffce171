"""Plain reference of the compiled measurement of a plan: what each point of it means, and the highest points.

The quantities of a point, in the rows of ``quantities.py``, follow from the derivatives ``d (4, m, dim)`` of the machine
axes and ``p (4, m, tip)`` of the tool tip with respect to u (the same array if ``cartesian``), and from
the first three time derivatives of u.

Everything is looked at in plain loops, point by point; the compiled code must give the same bits.
"""

from __future__ import annotations

import numpy as np

from planner.verify.quantities import FIRST_AXIS, REVERSAL


def _square(x):
    return x * x


def chain_rule(q1, q2, q3, u1, u2, u3):
    """First three derivatives of q(u(t)) with respect to t."""
    return q1 * u1, q2 * (u1 * u1) + q1 * u2, q3 * (u1 * u1 * u1) + q2 * (3.0 * u1 * u2) + q1 * u3


def locate(start, h, t, interval, x):
    """Write the interval that holds each time, and the share x of it that has passed."""
    for n in range(t.size):
        i = int(np.searchsorted(start, t[n], side="right")) - 1
        interval[n] = i
        x[n] = min(max((t[n] - start[i]) / h[i], 0.0), 1.0)


def time_law(coefficients, h, ends, interval, x, out):
    """Write u, and in further rows its first three time derivatives, of n quintics at k points each, ``out (., n, k)``.

    ``coefficients (6, m)`` of the powers of x in [0, 1], which h takes; u, u' and u'' at both of its ends are those of the
    table, ``ends (2, 3, m)``.
    """
    for n in range(interval.size):
        i = interval[n]
        c0, c1, c2 = coefficients[0, i], coefficients[1, i], coefficients[2, i]
        c3, c4, c5 = coefficients[3, i], coefficients[4, i], coefficients[5, i]
        for k in range(x.shape[1]):
            w = x[n, k]
            u = c0 + w * (c1 + w * (c2 + w * (c3 + w * (c4 + w * c5))))
            out[0, n, k] = ends[1, 0, i] if w == 1.0 else u
            if out.shape[0] > 1:
                first = (c1 + w * (2.0 * c2 + w * (3.0 * c3 + w * (4.0 * c4 + w * 5.0 * c5)))) / h[i]
                second = (2.0 * c2 + w * (6.0 * c3 + w * (12.0 * c4 + w * 20.0 * c5))) / (h[i] * h[i])
                third = (6.0 * c3 + w * (24.0 * c4 + w * 60.0 * c5)) / (h[i] * h[i] * h[i])
                side = int(w)
                if w == side:  # 0 or 1
                    first, second = ends[side, 1, i], ends[side, 2, i]
                out[1, n, k], out[2, n, k], out[3, n, k] = first, second, third


def _rounded(c1, c2, c3, u1, u2, slack):
    """What errors of up to ``slack`` in the time derivatives of u can change in those of C.

    To first order and beyond: the chain rule takes no larger value than from the sizes of all its terms.  What these gain
    is multiplied out, for the difference of two powers would leave few digits of it.
    """
    c1, c2, c3, u1, u2 = abs(c1), abs(c2), abs(c3), abs(u1), abs(u2)
    off1, off2, off3 = slack
    square = off1 * (2.0 * u1 + off1)
    mixed = 3.0 * (off1 * (u2 + off2) + u1 * off2)
    return c1 * off1, c2 * square + c1 * off2, c3 * _cube_gain(u1, off1) + c2 * mixed + c1 * off3


def _cube_gain(u1, off1):
    """What u'^3 gains where u' does off1."""
    return off1 * (3.0 * u1 * (u1 + off1) + off1 * off1)


def _measure_tip(p, cartesian, at, u1, u2, u3, slack, value, granted):
    """Write feed, tangential acceleration and jerk.

    Along the tip p with unit tangent t:  s' = p'.t,  s'' = p''.t,  s''' = p'''.t + p''.t', where p''.t' =
    |n|^2 u'^3 / |p_u| with n the part of p_uu across t.
    """
    tip = p.shape[2]
    speed = size = 0.0
    for j in range(tip):
        speed += _square(p[1, at, j])
        size += _square(p[2, at, j])
    speed, size = np.sqrt(speed), np.sqrt(size)
    # Where the tip rests in the parameter, it leaves along its second derivative.
    row = 1 if speed > 0.0 else 2
    size = speed if speed > 0.0 else size
    scale = 1.0 / size if size > 0.0 else 0.0
    bend = 0.0
    for j in range(tip):
        bend += p[2, at, j] * p[row, at, j] * scale
    turn = second = third = 0.0
    granted2 = granted3 = 0.0
    for j in range(tip):
        tangent = p[row, at, j] * scale
        turn += _square(p[2, at, j] - bend * tangent)
        if cartesian:  # the axes' own values
            a, b = FIRST_AXIS + tip + j, FIRST_AXIS + 2 * tip + j
            acceleration, jerk = value[a], value[b]
            off2, off3 = granted[a], granted[b]
        else:
            _, acceleration, jerk = chain_rule(p[1, at, j], p[2, at, j], p[3, at, j], u1, u2, u3)
            _, off2, off3 = _rounded(p[1, at, j], p[2, at, j], p[3, at, j], u1, u2, slack)
        second += acceleration * tangent
        third += jerk * tangent
        granted2 += _square(off2)
        granted3 += _square(off3)
    turn = turn * scale if speed > 0.0 else 0.0
    value[0], value[1], value[2] = speed * u1, second, third + turn * (u1 * u1 * u1)
    granted[0], granted[1] = speed * slack[0], np.sqrt(granted2)
    granted[2] = np.sqrt(granted3) + turn * _cube_gain(abs(u1), slack[0])


def _measure_point(d, p, cartesian, at, u1, u2, u3, slack, value, granted):
    """Write every quantity of a point, and what errors of up to ``slack`` in u', u'' and u''' can change in it."""
    dim = d.shape[2]
    value[REVERSAL], granted[REVERSAL] = -u1, slack[0]
    for j in range(dim):
        v, a, b = FIRST_AXIS + j, FIRST_AXIS + dim + j, FIRST_AXIS + 2 * dim + j
        value[v], value[a], value[b] = chain_rule(d[1, at, j], d[2, at, j], d[3, at, j], u1, u2, u3)
        granted[v], granted[a], granted[b] = _rounded(d[1, at, j], d[2, at, j], d[3, at, j], u1, u2, slack)
    _measure_tip(p, cartesian, at, u1, u2, u3, slack, value, granted)


def measure_points(d, p, cartesian, rates, slack, values, granted):
    """Write all quantities and their slack, ``(quantities, n, k)``, on n spans at k points each.

    ``rates (3, n, k)``: time derivatives of u; ``slack (n, 3)``: what rounding can change in them.
    """
    spans, points = rates.shape[1:]
    value, off = np.empty(values.shape[0]), np.empty(values.shape[0])
    for i in range(spans):
        error = slack[i]
        for k in range(points):
            u1, u2, u3 = rates[0, i, k], rates[1, i, k], rates[2, i, k]
            _measure_point(d, p, cartesian, i * points + k, u1, u2, u3, error, value, off)
            for row in range(value.size):
                values[row, i, k] = value[row]
                granted[row, i, k] = off[row]


def _peak(heights, top):
    """Height of the highest point, or where it lies inside, of the parabola through it and its neighbours."""
    if 0 < top < heights.size - 1:
        before, after = heights[top - 1], heights[top + 1]
        bend = before - 2.0 * heights[top] + after
        if -np.inf < bend < 0.0:
            return heights[top] - _square(before - after) / (8.0 * bend)
    return heights[top]


def _highest(heights):
    top = 0
    for k in range(1, heights.size):
        if heights[k] > heights[top]:
            top = k
    return top


def measure_spans(d, p, cartesian, rates, slack, ends, height, top, largest, jerk):
    """Measure spans as ``measure_points`` does, and keep of each of them and every quantity only the highest.

    ``ends (2, quantities, n)`` takes the values at the first and the last point; ``height, top (quantities, n)`` the peak
    of the sizes less their slack, and its point; ``largest (quantities,)`` is raised to the largest of these without the
    parabola; ``jerk (dim, n)`` takes the peak of the axes' jerk less its slack.
    """
    spans, points = rates.shape[1:]
    count, dim = height.shape[0], d.shape[2]
    value, granted = np.empty(count), np.empty(count)
    used, jerks = np.empty((count, points)), np.empty((dim, points))
    for i in range(spans):
        error = slack[i]
        for k in range(points):
            u1, u2, u3 = rates[0, i, k], rates[1, i, k], rates[2, i, k]
            _measure_point(d, p, cartesian, i * points + k, u1, u2, u3, error, value, granted)
            for row in range(count):
                if k == 0:
                    ends[0, row, i] = value[row]
                # Backwards counts only what is backwards; what is not a number is beyond every limit.
                size = value[row] if row == REVERSAL else abs(value[row])
                less = size - granted[row]
                used[row, k] = less if less < np.inf else np.inf
                if row >= count - dim:
                    jerks[row - count + dim, k] = max(used[row, k], 0.0)
        for row in range(count):
            ends[1, row, i] = value[row]  # of the last point
            k = _highest(used[row])
            height[row, i], top[row, i] = _peak(used[row], k), k
            largest[row] = max(largest[row], used[row, k])
        for j in range(dim):
            jerk[j, i] = _peak(jerks[j], _highest(jerks[j]))


def chord_heights(points, stride, parts, height, top):
    """Write the largest distance from each chord to the path above it, and its point.

    Chord i runs from ``points[i stride]`` to ``points[i stride + parts]``; the path between them is given by the points
    between them.  The distance is that to the segment, not to its line.
    """
    dim = points.shape[1]
    distance = np.empty(parts + 1)
    for i in range(height.size):
        first, last = i * stride, i * stride + parts
        square = 0.0
        for j in range(dim):
            square += _square(points[last, j] - points[first, j])
        scale = 1.0 / square if square > 0.0 else 0.0
        for k in range(parts + 1):
            along = 0.0
            for j in range(dim):
                along += (points[first + k, j] - points[first, j]) * (points[last, j] - points[first, j])
            share = min(max(along * scale, 0.0), 1.0)
            apart = 0.0
            for j in range(dim):
                chord = points[last, j] - points[first, j]
                apart += _square(points[first + k, j] - points[first, j] - share * chord)
            distance[k] = apart
        top[i] = _highest(distance)
        height[i] = _peak(np.sqrt(distance), top[i])


def mean_jerks(d, rates, u, start, h, gap):
    """Size of the mean jerk over whole intervals, and what rounding can make of it, (n, dim): by array arithmetic."""
    eps, count = np.finfo(np.float64).eps, h.size
    position, first, second, third = (part.reshape(count, 2, -1) for part in np.abs(d))
    u1, u2 = (rate[..., None] for rate in rates[:2])
    signed = d.reshape(4, count, 2, -1)
    acceleration = signed[2] * u1**2 + signed[1] * u2
    off = 16.0 * eps * (second * u1**2 + first * np.abs(u2) + position * u1**2 / gap[:, None, None] ** 2)
    off += eps * np.abs(u)[..., None] * (third * u1**2 + second * np.abs(u2))
    mean = np.abs(acceleration[:, 1] - acceleration[:, 0]) / h[:, None]
    return mean, off.sum(axis=1) / h[:, None] + mean * eps * (start + h)[:, None] / h[:, None]
