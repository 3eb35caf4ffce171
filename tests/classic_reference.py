"""The loops of feedshapes.c, forms.c and lookahead.c in plain Python, one sum after the other."""

from __future__ import annotations

from math import cos, exp, sin

import numpy as np
from steps_reference import axes_of, end, horner, polynomial, position, since, taylor_series, tip_speed

from interp.stepping import LAST, PERIOD_HIGH, PERIOD_LOW, PIECE, SAMPLE, SEGMENT, U_END, U

# ---- feed shapes of 2002 (feedshapes.py) ------------------------------------------------------------

TRAPEZOID, EXPONENTIAL, BELL = 0.0, 1.0, 2.0
EXPONENTIAL_RATE = 5.0  # time constants in the time of a ramp: 0.7 % of the feed is left then
# A shape is five numbers: which, feed F (mm/s), time of a ramp, begin of the falling ramp, end of the motion (s).


def _shape(shape, t):
    """Feed and acceleration of a shape at time t; a jump takes its value after it."""
    which, feed, ramp, fall, end = shape[0], shape[1], shape[2], shape[3], shape[4]
    if t < 0.0 or t >= end:
        return 0.0, 0.0
    if which == EXPONENTIAL:
        rate = EXPONENTIAL_RATE / ramp
        if t < fall:
            left = exp(-rate * t)
            return feed * (1.0 - left), feed * rate * left
        left = feed * (1.0 - exp(-rate * fall)) * exp(-rate * (t - fall))
        return left, -rate * left
    rising = t < ramp
    if not rising and t < fall:
        return feed, 0.0
    x = t / ramp if rising else (end - t) / ramp
    sign = 1.0 if rising else -1.0
    if which == BELL:
        return 0.5 * feed * (1.0 - cos(np.pi * x)), sign * 0.5 * feed * np.pi / ramp * sin(np.pi * x)
    return feed * x, sign * feed / ramp


def shape_feed(shape, t, feed, acceleration):
    """Write the feed and the acceleration of a shape at every time."""
    for n in range(t.size):
        feed[n], acceleration[n] = _shape(shape, t[n])


def shaped_run(order, shape, pieces, period, u_end, u, feed, acceleration, positions):
    """Take ``u.size - 1`` Taylor steps of order 1 or 2 from ``u[0]`` with the feed of a shape (2002, equations 8, 9).

    ``feed``, ``acceleration`` get V_k and A_k of every sample, ``positions (n, dim)`` the machine axes.
    """
    dim = positions.shape[1]
    flat = positions.reshape(-1)
    piece = 0
    at = u[0]
    for k in range(u.size):
        while at >= pieces[piece + 1, 0, 0]:
            piece += 1
        u[k] = at
        position(pieces, piece, (at - pieces[piece, 0, 0]) / pieces[piece, 0, 1], flat, k * dim, dim)
        v, a = _shape(shape, k * period)
        feed[k], acceleration[k] = v, a
        speed, slope, bend = tip_speed(pieces, piece, at, order, dim)
        if speed > 0.0:
            step = taylor_series(order, period, speed, slope, bend, v, a, 0.0)
            at = min(at + max(step, 0.0), u_end)


# ---- the other forms of a replay (forms.py) -----------------------------------------------------------------

TAYLOR_BY_PARAMETER, RUNGE_KUTTA, CHORD = 0, 1, 2
_NEWTON_PASSES = 60
# With V(u): periods before the plan's end, and share of the way left, within which a step is taken to the end.
_ARRIVAL, _CRAWL = 1.5, 0.1


def _cubic(row, t):
    return row[1] + t * (row[2] + t * (row[3] + t * row[4]))


def _feed_row(feed, state, k, i):
    """Row of the feed that holds the time of sample k."""
    while since(state, k, feed[i + 1, 0]) >= 0.0:
        i += 1
    return i


def _piece_of(pieces, u, piece):
    while u >= pieces[piece + 1, 0, 0]:
        piece += 1
    return piece


def _time_at(course, u, i, duration):
    """Segment and time at which the plan is at u: Newton on its quintic, bisection where Newton leaves the bracket."""
    while course[i + 1, 0] < duration and course[i + 1, 1] <= u:
        i += 1
    c = course[i]
    lo, hi = 0.0, min(course[i + 1, 0], duration) - c[0]
    t = 0.5 * hi
    for _ in range(_NEWTON_PASSES):
        value = c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6])))) - u
        slope = c[2] + t * (2.0 * c[3] + t * (3.0 * c[4] + t * (4.0 * c[5] + t * 5.0 * c[6])))
        if value > 0.0:
            hi = t
        else:
            lo = t
        trial = t - value / slope
        if not lo <= trial <= hi:
            trial = 0.5 * (lo + hi)
        moved = abs(trial - t)
        t = trial
        if moved <= 1e-15 * duration:
            break
    return i, c[0] + t


def _chord(pieces, piece, u, other, p, dim):
    """Length of the chord between two points of the tool tip, given by their pieces and parameters."""
    rows = pieces.shape[1]
    rational = rows > dim + 1
    first = dim + 2 if rows > dim + 2 else 1
    last = rows - 1 if rational else rows
    w = (u - pieces[piece, 0, 0]) / pieces[piece, 0, 1]
    x = (p - pieces[other, 0, 0]) / pieces[other, 0, 1]
    near, far = 1.0, 1.0
    if rational:
        near, far = 1.0 / horner(pieces[piece, last], w), 1.0 / horner(pieces[other, last], x)
    square = 0.0
    for j in range(first, last):
        apart = far * horner(pieces[other, j], x) - near * horner(pieces[piece, j], w)
        square += apart * apart
    return np.sqrt(square)


def _corrected(form, passes, pieces, piece, u, u_end, period, speed, v, v1, length, dim):
    """Parameter step of the Runge-Kutta and of the chord form; see ``form_run``."""
    if form == RUNGE_KUTTA:
        step = period * v / speed
        other = min(u + step, u_end)
        following, _, _ = tip_speed(pieces, _piece_of(pieces, other, piece), other, 1, dim)
        return 0.5 * (step + period * v1 / following) if following > 0.0 else step
    step = length / speed
    for _ in range(passes):
        other = min(u + step, u_end)
        chord = _chord(pieces, piece, u, _piece_of(pieces, other, piece), other, dim)
        if chord > 0.0:
            step = (other - u) * length / chord
    return step


def form_run(form, order, feed, course, pieces, duration, state, u, positions):
    """Take up to ``u.size`` steps of a form; returns how many, less where the path ends before.

    With V the plan's feed, f(t, u) = V(t) / |C'(u)| and T the period,

        Taylor with V(u)  the time at which the plan was at u_k gives V, A, J; then the Taylor step of ``taylor_step``
        Runge-Kutta       p = u_k + T f(t_k, u_k),   u_{k+1} = u_k + T/2 (f(t_k, u_k) + f(t_{k+1}, p))
        chord             with L = T/6 (V(t_k) + 4 V(t_k + T/2) + V(t_{k+1})), p = u_k + L / |C'(u_k)|, then ``order`` times
                          p := u_k + (p - u_k) L / |C(p) - C(u_k)|

    The forms with V(t) are at the end of the path at the plan's last sample, whatever they have accumulated; those with
    V(u) when they get there.  At an end at rest the second-order step shrinks to nothing one period before it: a step
    that crawls there is taken to the end.  ``course (n + 1, 7)``, read with V(u) alone, holds the plan's u(t): start
    times and quintics of u.  ``positions`` is flat, ``dim`` numbers a step.
    """
    dim = axes_of(state)
    period = state[PERIOD_HIGH] + state[PERIOD_LOW]
    k, i, piece, at = state[SAMPLE], int(state[SEGMENT]), int(state[PIECE]), state[U]
    row = 0
    taken = 0
    while taken < u.size and at < state[U_END]:
        v, a, j = 0.0, 0.0, 0.0
        speed, slope, bend = tip_speed(pieces, piece, at, order if form == TAYLOR_BY_PARAMETER else 1, dim)
        step = 0.0
        if form == TAYLOR_BY_PARAMETER:
            row, t = _time_at(course, at, row, duration)
            near = duration - t <= _ARRIVAL * period
            while feed[i + 1, 0] <= t:
                i += 1
            c = feed[i]
            t -= c[0]
            v, a, j = _cubic(c, t), c[2] + t * (2.0 * c[3] + t * 3.0 * c[4]), 2.0 * c[3] + t * 6.0 * c[4]
            if speed > 0.0:
                step = taylor_series(order, period, speed, slope, bend, v, a, j)
            if near and step < _CRAWL * (state[U_END] - at):
                step = state[U_END] - at
        elif k + 1.0 >= state[LAST]:
            step = state[U_END] - at
        else:
            i = _feed_row(feed, state, k, i)
            v = _cubic(feed[i], since(state, k, feed[i, 0]))
            after = _feed_row(feed, state, k + 1.0, i)
            v1 = _cubic(feed[after], since(state, k + 1.0, feed[after, 0]))
            length = 0.0
            if form == CHORD:
                middle = _feed_row(feed, state, k + 0.5, i)
                v2 = _cubic(feed[middle], since(state, k + 0.5, feed[middle, 0]))
                length = period / 6.0 * (v + 4.0 * v2 + v1)
            if speed > 0.0:
                step = _corrected(form, order, pieces, piece, at, state[U_END], period, speed, v, v1, length, dim)
        at = min(at + max(step, 0.0), state[U_END])
        k += 1.0
        piece = _piece_of(pieces, at, piece)
        if at >= state[U_END]:
            end(state, positions, taken * dim)
        else:
            position(pieces, piece, (at - pieces[piece, 0, 0]) / pieces[piece, 0, 1], positions, taken * dim, dim)
        u[taken] = at
        taken += 1
    state[SAMPLE], state[SEGMENT], state[PIECE], state[U] = k, i, piece, at
    return taken


# ---- adaptive feed with look-ahead, 2007 (lookahead.py) -------------------------------------------------------------

AVERAGED, UNIFORM = 0, 1


def _curvature(pieces, piece, u, slope, speed, dim):
    """Curvature of the tool tip, |C'' - (|C'|'/|C'|) C'| / |C'|^2: the part of C'' along C' is taken off first."""
    rows = pieces.shape[1]
    rational = rows > dim + 1
    first = dim + 2 if rows > dim + 2 else 1
    last = rows - 1 if rational else rows
    scale = 1.0 / pieces[piece, 0, 1]
    w = (u - pieces[piece, 0, 0]) * scale
    d0, d1, d2 = 1.0, 0.0, 0.0
    if rational:
        d0, d1, d2, _ = polynomial(pieces[piece, last], w, scale, 2)
    square = 0.0
    for j in range(first, last):
        c0, c1, c2, _ = polynomial(pieces[piece, j], w, scale, 2)
        if rational:
            c0 = c0 / d0
            c1 = (c1 - d1 * c0) / d0
            c2 = (c2 - 2.0 * d1 * c1 - d2 * c0) / d0
        normal = c2 - slope / speed * c1
        square += normal * normal
    return np.sqrt(square) / (speed * speed)


def adaptive_points(limits, pieces, dim, u_end, u, feed, lengths):
    """Place one point a period at the adaptive feed (2007, equations 5 to 7), from ``u[0]`` to the end of the path.

    ``limits`` is command feed, normal acceleration, chord error, period.  Writes u_i, V_i and the chords s_i between
    them; returns the number of points, or -1 where there is no room for them, or -2 - i where point i does not move.
    """
    period = limits[3]
    piece = 0
    for i in range(u.size):
        piece = _piece_of(pieces, u[i], piece)
        speed, slope, _ = tip_speed(pieces, piece, u[i], 2, dim)
        radius = 1.0 / _curvature(pieces, piece, u[i], slope, speed, dim)
        error = min(limits[2], radius)
        v = min(limits[0], np.sqrt(limits[1] * radius))
        if np.isfinite(limits[2]):
            v = min(v, 2.0 / period * np.sqrt(error * (2.0 * radius - error)))
        feed[i] = v
        if u[i] >= u_end:
            return i + 1
        following = min(u[i] + period * v / speed, u_end)
        if i + 1 == u.size or not following > u[i]:
            return -1 if i + 1 == u.size else -2 - i
        u[i + 1] = following
        lengths[i] = _chord(pieces, piece, u[i], _piece_of(pieces, following, piece), following, dim)
    return -1


def look_ahead(twice, lengths, square):
    """Lower the squared feeds until every segment can be crossed within the acceleration (2007, equations 8 and 9).

    ``twice`` is 2 a_max; returns the farthest that braking reached back, mm.
    """
    farthest = 0.0
    for j in range(lengths.size):
        square[j + 1] = min(square[j + 1], square[j] + twice * lengths[j])
        i, back = j, 0.0
        while i >= 0 and square[i] > square[i + 1] + twice * lengths[i]:
            square[i] = square[i + 1] + twice * lengths[i]
            back += lengths[i]
            i -= 1
        farthest = max(farthest, back)
    return farthest


def _travel(points, square, lengths, i, u, period):
    """Distance covered in one period from u on, V^2 linear in the distance between the points."""
    share = (u - points[i]) / (points[i + 1] - points[i])
    v = np.sqrt(max(square[i] + share * (square[i + 1] - square[i]), 0.0))
    left = (1.0 - share) * lengths[i]
    time, covered = period, 0.0
    while True:
        v1 = np.sqrt(square[i + 1])
        needed = 2.0 * left / (v + v1) if left > 0.0 else 0.0
        if needed > time:
            return covered + time * (v + 0.25 * time * (v1 * v1 - v * v) / left), False
        covered += left
        time -= needed
        i += 1
        if i + 1 >= points.size:
            return covered, True
        v, left = v1, lengths[i]


def adaptive_run(rule, order, points, square, lengths, pieces, period, least, u, feed, positions):
    """Interpolate at the feeds after look-ahead by Taylor steps of order 1 or 2 with the feed V_k, one a period.

        AVERAGED  V_k is the mean of V_{k-1} and of the feed at the next point (the figure 3 of 2007), at least ``least``
        UNIFORM   V_k is what constant acceleration between the points makes of the period that follows

    Writes u_k, V_k and the positions; returns the number of samples, or -1 where there is no room for them.
    """
    dim = positions.shape[1]
    flat = positions.reshape(-1)
    end = points[points.size - 1]
    i = piece = 0
    at, v = points[0], np.sqrt(square[0])
    for k in range(u.size):
        piece = _piece_of(pieces, at, piece)
        u[k] = at
        position(pieces, piece, (at - pieces[piece, 0, 0]) / pieces[piece, 0, 1], flat, k * dim, dim)
        if at >= end:
            feed[k] = np.sqrt(square[square.size - 1])
            return k + 1
        while points[i + 1] <= at:
            i += 1
        arrives = False
        if rule == UNIFORM:
            covered, arrives = _travel(points, square, lengths, i, at, period)
            v = covered / period
        elif k > 0:
            v = max(0.5 * (v + np.sqrt(square[i + 1])), least)
        feed[k] = v
        speed, slope, bend = tip_speed(pieces, piece, at, order, dim)
        at = end if arrives else min(at + taylor_series(order, period, speed, slope, bend, v, 0.0, 0.0), end)
    return -1
