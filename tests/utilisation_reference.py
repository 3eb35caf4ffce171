"""Loops over the intervals of a time law in plain Python: the compiled ones give the same bits."""

from __future__ import annotations

import numpy as np
from curve_reference import point_on_pieces

_MAX_PARTS = 80  # that an interval is cut into
_PARABOLA = 0.07  # its error through four points, against their third difference: max |x (x^2 - 1)| / 6
_PRECISE = 3e-7  # as a share of a limit


def chain_rule(q1, q2, q3, u1, u2, u3):
    """First three derivatives of q(u(t)) with respect to t."""
    return q1 * u1, q2 * (u1 * u1) + q1 * u2, q3 * (u1 * u1 * u1) + q2 * (3.0 * u1 * u2) + q1 * u3


def speed_derivatives(square, along, bend):
    """|C'| > 0 and its first two derivatives with respect to u, from |C'|^2, C'.C'' and |C''|^2 + C'.C'''."""
    speed = np.sqrt(square)
    slope = along / speed
    return speed, slope, (bend - slope * slope) / speed


def rates_along(s1, s2, s3, u1, u2, u3):
    """First three time derivatives of an arc length, given |C'| and its first two derivatives, from those of u."""
    return s1 * u1, s1 * u2 + s2 * (u1 * u1), s1 * u3 + s2 * (3.0 * u1 * u2) + s3 * (u1 * u1 * u1)


def half_chord(radius, error):
    """Half the length of the chord that leaves a circle by an error."""
    sagitta = min(error, radius)
    return np.sqrt(sagitta * (2.0 * radius - sagitta))


def rates_of_motions(q, tip, u1, u2, u3, rates):
    """Write velocity, acceleration and jerk of every motion into ``rates (motions, 3)``: the axes, and last the arc length.

    Returns of the arc length of the tip the square of its derivative by u, the derivative and the second one.
    """
    dim = q.shape[1]
    for j in range(dim):
        rates[j, 0], rates[j, 1], rates[j, 2] = chain_rule(q[1, j], q[2, j], q[3, j], u1, u2, u3)
    dot11 = dot12 = dot13 = dot22 = 0.0
    for j in range(tip.shape[1]):
        d1, d2, d3 = tip[1, j], tip[2, j], tip[3, j]
        dot11 += d1 * d1
        dot12 += d1 * d2
        dot13 += d1 * d3
        dot22 += d2 * d2
    s1, s2, s3 = speed_derivatives(dot11, dot12, dot22 + dot13)
    rates[dim, 0], rates[dim, 1], rates[dim, 2] = s1 * u1, 0.0, 0.0
    if s1 > 0.0:
        rates[dim, 0], rates[dim, 1], rates[dim, 2] = rates_along(s1, s2, s3, u1, u2, u3)
    return dot11, s1, s2


def shares_at(q, tip, u1, u2, u3, feed, rows, kinds, chords, rates, out):
    """Shares of all limits used at a point: of the feed, of the chord error, and of each row."""
    dot11, s1, s2 = rates_of_motions(q, tip, u1, u2, u3, rates)
    chord, period = chords
    out[0] = s1 * abs(u1) / feed
    out[1] = 0.0
    for r in range(kinds.shape[0]):
        j, value = kinds[r, 0], 0.0
        for k in range(3):
            if rows[r, k] != 0.0:
                value += rows[r, k] * rates[j, k]
        out[2 + r] = value / (rows[r, 4] if value > 0.0 else rows[r, 3])
    if s1 > 0.0 and np.isfinite(chord):
        # The radius as ``curvature`` in ``differential`` has its inverse, at one point, with the slope that is at hand.
        normal = 0.0
        for j in range(tip.shape[1]):
            across = tip[2, j] - s2 / s1 * tip[1, j]
            normal += across * across
        if normal > 0.0:
            radius = dot11 / np.sqrt(normal)
            out[1] = s1 * abs(u1) * period / (2.0 * half_chord(radius, chord))


def grant(q, tip, digit, h, feed, rows, kinds, out):
    """Shares of the limits that rounding makes of a quintic of duration h.

    Half a digit of u at both ends is worth up to 2, 6 and 60 of it over h, h^2 and h^3; nine tenths of that are granted
    here, all of it by the check: nothing on a path of metres, all of the jerk at the end of one of 100 km, where no table
    in double precision says more.
    """
    digits = (1.8 * digit / h, 5.4 * digit / (h * h), 54.0 * digit / (h * h * h))
    speed = 0.0
    for j in range(tip.shape[1]):
        speed += tip[1, j] * tip[1, j]
    speed = np.sqrt(speed)
    out[0] = digits[0] * speed / feed
    for r in range(kinds.shape[0]):
        j = kinds[r, 0]
        size, granted = (abs(q[1, j]) if j < q.shape[1] else speed), 0.0
        for k in range(3):
            granted += digits[k] * size * abs(rows[r, k])
        out[2 + r] = granted / min(rows[r, 4], -rows[r, 3])


def peak(values, points, granted):
    """Largest value of a row of ``points`` + 1 equidistant ones less what is granted, and whether that may be too low.

    A peak between points is that of the parabola through three; it is off by up to 0.07 of the third difference.
    """
    top, doubtful = values[0], False
    for n in range(1, points + 1):
        top = max(top, values[n])
        if n < 2:
            continue
        before, here, after = values[n - 2], values[n - 1], values[n]
        bend, lean = before - 2.0 * here + after, before - after
        # The vertex is nearest to the middle one, or at an end of the interval to its first or last point.
        outer = (n == 2 and lean > 0.0) or (n == points and lean < 0.0)
        if bend < 0.0 and abs(lean) <= (-2.0 * bend if outer else -bend):
            top = max(top, here - lean * lean / (8.0 * bend))
        if n >= 3:
            third = after - 3.0 * here + 3.0 * before - values[n - 3]
            error = _PARABOLA * abs(third)
            # Either parabola rises by at most an eighth of its second difference above its points.
            highest = max(values[n - 3], before, here, after) - 0.125 * min(bend, bend - third, 0.0) + error
            doubtful = doubtful or (error > _PRECISE and highest > 1.0 + granted)
    return top - granted, doubtful


def shares(axes, tip, cartesian, quintic, spans, rows, kinds, chords, out):
    """Write the largest share of speed, acceleration and jerk limits used in each interval into ``out (4, n)``.

    The fourth row is the largest rate at which u falls back, 1/s.

    ``axes``, ``tip``: pieces of the machine axes and of the tool tip, the same ones if ``cartesian``.  On interval i the
    parameter u is ``quintic[:, i]`` (ascending powers of the time since its start); ``spans[:, i]`` are its duration, its
    smallest and largest u, the end of its stretch between breaks, what a digit of the law is worth in u, the feed limit,
    and into how many equal parts it is cut to be looked at: into twice as many, at most _MAX_PARTS, until the parabolas
    between points tell whether a limit is kept.  ``rows (m, 5)``: weights of velocity, acceleration and jerk in each
    limit row, and its lower and upper bound; ``kinds (m, 2)``: its motion (the axes, last the arc length of
    the tip), and whether it is about speeds (0), accelerations (1) or jerks (2); ``chords``: chord error and period.
    """
    dim, count = axes[1].shape[1] - 1, 2 + rows.shape[0]
    values, new = np.empty((count, _MAX_PARTS + 1)), np.empty(count)
    granted, rates = np.zeros(count), np.empty((dim + 1, 3))
    q = np.empty((4, dim))
    p = q if cartesian else np.empty((4, tip[1].shape[1] - 1))
    piece = tip_piece = 0
    for i in range(spans.shape[1]):
        h, first, last, stretch_end, feed = spans[0, i], spans[1, i], spans[2, i], spans[3, i], spans[5, i]
        c0, c1, c2, c3, c4, c5 = (
            quintic[0, i],
            quintic[1, i],
            quintic[2, i],
            quintic[3, i],
            quintic[4, i],
            quintic[5, i],
        )
        points, doubtful = int(spans[6, i]), True
        out[3, i] = 0.0
        while doubtful:
            for n in range(points + 1):
                w = h * n / points
                u = min(max(c0 + w * (c1 + w * (c2 + w * (c3 + w * (c4 + w * c5)))), first), last)
                if n == 0:
                    u = first
                elif n == points:
                    u = last
                u1 = c1 + w * (2.0 * c2 + w * (3.0 * c3 + w * (4.0 * c4 + w * 5.0 * c5)))
                u2 = 2.0 * c2 + w * (6.0 * c3 + w * (12.0 * c4 + w * 20.0 * c5))
                u3 = 6.0 * c3 + w * (24.0 * c4 + w * 60.0 * c5)
                out[3, i] = max(out[3, i], -u1)
                # A point that rounds to the end of its stretch must not be read from beyond it.
                left = u >= stretch_end
                piece = point_on_pieces(axes[0], axes[1], axes[2], axes[3], axes[4], u, left, piece, q)
                if not cartesian:
                    tip_piece = point_on_pieces(tip[0], tip[1], tip[2], tip[3], tip[4], u, left, tip_piece, p)
                shares_at(q, p, u1, u2, u3, feed, rows, kinds, chords, rates, new)
                if n == 0:
                    grant(q, p, spans[4, i], h, feed, rows, kinds, granted)
                for k in range(count):
                    values[k, n] = new[k]
            out[0, i] = out[1, i] = out[2, i] = 0.0
            doubtful = False
            for k in range(count):
                kind = 0 if k < 2 else kinds[k - 2, 1]
                top, unsure = peak(values[k], points, granted[k])
                out[kind, i] = max(out[kind, i], top)
                doubtful = doubtful or unsure
            doubtful = doubtful and points < _MAX_PARTS
            points = min(2 * points, _MAX_PARTS)


def limit_growth(values, steps):
    """Lower each value to at most either neighbour's plus the step between them, ``steps (n - 1,)``.

    One by one: sums over all steps would swamp the small ones.
    """
    for i in range(1, values.size):
        values[i] = min(values[i], values[i - 1] + steps[i - 1])
    for i in range(values.size - 2, -1, -1):
        values[i] = min(values[i], values[i + 1] + steps[i])
