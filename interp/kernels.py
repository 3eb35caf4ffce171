"""Compiled steps of the interpolators: one sample a call, plain arrays, no allocation.

*Pieces* ``(m + 1, rows, degree + 1)``: the curve as (rational) polynomials of a local parameter w in [0, 1], highest
power first, as Horner reads them.  The rows of a piece are

    0  first parameter and width of the piece, in columns 0 and 1: u = pieces[i, 0, 0] + pieces[i, 0, 1] w
    1 .. dim  the machine axes
    dim + 1  their denominator; a polynomial curve has none
    behind them, where the tool tip is not made of these rows: the tip's coordinates, then their denominator

*Segments* ``(n + 1, 8)``: times t_i at which the plan goes over to another quintic or another piece, the quintic of w
in ascending powers of t - t_i, and the index of the piece.

*Feed* ``(n + 1, 5)``: times t_i, and the cubic of the path speed V(t) in ascending powers of t - t_i.

Each of the three is closed by a row that starts at inf, so that a pointer advances by comparison alone.

*State* ``(8 + 2 dim,)``: what is remembered between two periods, see the indices below, and the last sample; a copy of
it is a snapshot.  The sample time k T is a product, never a sum of periods, and T is split into a leading part of 20
bits and the rest: the time since t_i is exact to rounding however long the plan is.

Calling compiled code costs more than the step does, about 100 ns for every array: hence so few of them.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planner.geometry.kernels import F64, FLAG, I64, NOTHING, READ1, READ2, READ3, WRITE1, WRITE2

# Indices into the state.
SAMPLE = 0  # number k of the last sample
SEGMENT = 1  # row of the segments, or of the feed, that holds its time
PIECE = 2  # curve piece that holds its parameter (Taylor only: a segment knows its piece)
U = 3  # its curve parameter
PERIOD_HIGH = 4  # leading 20 bits of the period T, s: times k they are exact up to k = 2^33
PERIOD_LOW = 5  # the rest of T
LAST = 6  # number of the last sample, at the end of the path
U_END = 7
END = 8  # dim numbers: the position at the end of the path; behind them, dim numbers: the position of the last sample


@njit(forceinline=True)
def _since(state, k, start):
    """Time k T - start, s, without the rounding of k T: k times the high part is exact and close to start."""
    return (k * state[PERIOD_HIGH] - start) + k * state[PERIOD_LOW]


@njit(forceinline=True)
def _horner(row, w):
    value = row[0]
    for n in range(1, row.size):
        value = value * w + row[n]
    return value


@njit(forceinline=True, error_model="numpy")
def _position(pieces, piece, w, out, at, dim):
    """Write the point of a piece at w into ``out[at : at + dim]``."""
    scale = 1.0
    if pieces.shape[1] > dim + 1:
        scale = 1.0 / _horner(pieces[piece, dim + 1], w)
    for j in range(dim):
        out[at + j] = scale * _horner(pieces[piece, 1 + j], w)


@njit(forceinline=True)
def _dim(state):
    return (state.size - END) // 2


@njit(forceinline=True)
def _end(state, out, at):
    for j in range(_dim(state)):
        out[at + j] = state[END + j]


@njit(forceinline=True)
def _keep(state, positions):
    """Put the last row of the flat positions into the state."""
    dim = _dim(state)
    for j in range(min(dim, positions.size)):
        state[END + dim + j] = positions[positions.size - dim + j]


@njit(forceinline=True)
def _quintic(segments, pieces, state, k, i, u, out, at):
    """Write sample k; returns its segment and parameter, given those of the sample before."""
    if k >= state[LAST]:
        _end(state, out, at)
        return i, state[U_END]
    while _since(state, k, segments[i + 1, 0]) >= 0.0:
        i += 1
    t = _since(state, k, segments[i, 0])
    c = segments[i]
    w = c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6]))))
    w = min(max(w, 0.0), 1.0)
    piece = int(c[7])
    _position(pieces, piece, w, out, at, _dim(state))
    # A rounding must not report a parameter that falls back, or one beyond the end.
    return i, min(max(pieces[piece, 0, 0] + pieces[piece, 0, 1] * w, u), state[U_END])


@njit(forceinline=True)
def _polynomial(row, w, scale, order):
    """Value and first ``order`` derivatives with respect to u (dw/du = scale); the others stay 0."""
    b0 = row[0]
    b1 = b2 = b3 = 0.0
    for n in range(1, row.size):
        if order > 2:
            b3 = b3 * w + b2
        if order > 1:
            b2 = b2 * w + b1
        b1 = b1 * w + b0
        b0 = b0 * w + row[n]
    return b0, b1 * scale, 2.0 * b2 * scale * scale, 6.0 * b3 * scale * scale * scale


@njit(forceinline=True, error_model="numpy")
def _speed(pieces, piece, u, order, dim):
    """|C'| of the tool tip and, as far as the order needs them, its first and second derivative with respect to u.

    |C'|' = C'.C''/|C'|,  |C'|'' = (|C''|^2 + C'.C''' - |C'|'^2) / |C'|.
    """
    rows = pieces.shape[1]
    rational = rows > dim + 1
    first = dim + 2 if rows > dim + 2 else 1
    last = rows - 1 if rational else rows
    scale = 1.0 / pieces[piece, 0, 1]
    w = (u - pieces[piece, 0, 0]) * scale
    d0, d1, d2, d3 = 1.0, 0.0, 0.0, 0.0
    if rational:
        d0, d1, d2, d3 = _polynomial(pieces[piece, last], w, scale, order)
    square = dot = more = 0.0
    for j in range(first, last):
        c0, c1, c2, c3 = _polynomial(pieces[piece, j], w, scale, order)
        if rational:  # quotient rule, as in planner.geometry.kernels.evaluate_pieces
            c0 = c0 / d0
            c1 = (c1 - d1 * c0) / d0
            c2 = (c2 - 2.0 * d1 * c1 - d2 * c0) / d0
            c3 = (c3 - 3.0 * d1 * c2 - 3.0 * d2 * c1 - d3 * c0) / d0
        square += c1 * c1
        dot += c1 * c2
        more += c2 * c2 + c1 * c3
    speed = np.sqrt(square)
    slope = dot / speed
    return speed, slope, (more - slope * slope) / speed


@njit(forceinline=True, error_model="numpy")
def _taylor_series(order, period, speed, slope, bend, v, a, j):
    """T u' + T^2/2 u'' + T^3/6 u''' as far as the order goes; see ``taylor_step``."""
    u1 = v / speed
    step = period * u1
    if order > 1:
        u2 = (a - slope * u1 * u1) / speed
        step += 0.5 * period * period * u2
        if order > 2:
            u3 = (j - 3.0 * slope * u1 * u2 - bend * u1 * u1 * u1) / speed
            step += period * period * period / 6.0 * u3
    return step


@njit(forceinline=True, error_model="numpy")
def _taylor(order, feed, pieces, state, k, i, piece, u, out, at):
    """Write sample k; returns its segment, piece and parameter, given those of the sample before."""
    if k >= state[LAST]:
        _end(state, out, at)
        return i, piece, state[U_END]
    dim = _dim(state)
    before = k - 1.0
    period = state[PERIOD_HIGH] + state[PERIOD_LOW]
    while _since(state, before, feed[i + 1, 0]) >= 0.0:
        i += 1
    t = _since(state, before, feed[i, 0])
    c = feed[i]
    speed, slope, bend = _speed(pieces, piece, u, order, dim)
    step = 0.0
    if speed > 0.0:
        v = c[1] + t * (c[2] + t * (c[3] + t * c[4]))
        a = c[2] + t * (2.0 * c[3] + t * 3.0 * c[4])
        step = _taylor_series(order, period, speed, slope, bend, v, a, 2.0 * c[3] + t * 6.0 * c[4])
    u = min(u + max(step, 0.0), state[U_END])
    while u >= pieces[piece + 1, 0, 0]:
        piece += 1
    _position(pieces, piece, (u - pieces[piece, 0, 0]) / pieces[piece, 0, 1], out, at, dim)
    return i, piece, u


@njit(FLAG(READ2, READ3, WRITE1), cache=True)
def quintic_step(segments, pieces, state):
    """Go to the next sample of the plan; True once it is the last one, which is then held.

    t = k T;  the quintic of its segment gives the curve parameter, and the curve piece the position.

    Parameters
    ----------
    segments, pieces
        ``InterpolatorTable.arrays``.
    state : (8 + 2 dim,) array
        From ``start``; changed in place.  Its last dim numbers are the sample: machine axes, mm (rad for rotary axes).
    """
    k = min(state[SAMPLE] + 1.0, state[LAST])
    i, u = _quintic(segments, pieces, state, k, int(state[SEGMENT]), state[U], state, END + _dim(state))
    state[SAMPLE], state[SEGMENT], state[U] = k, i, u
    return k >= state[LAST]


@njit(NOTHING(READ2, READ3, WRITE1, WRITE1, WRITE1), cache=True)
def quintic_run(segments, pieces, state, u, positions):
    """Take ``u.size`` steps; ``positions`` is flat, ``dim`` numbers a step."""
    dim = _dim(state)
    k, i, at = state[SAMPLE], int(state[SEGMENT]), state[U]
    for n in range(u.size):
        k = min(k + 1.0, state[LAST])
        i, at = _quintic(segments, pieces, state, k, i, at, positions, n * dim)
        u[n] = at
    state[SAMPLE], state[SEGMENT], state[U] = k, i, at
    _keep(state, positions)


@njit(FLAG(I64, READ2, READ3, WRITE1), cache=True)
def taylor_step(order, feed, pieces, state):
    """Go to the next sample by a Taylor step of order 1, 2 or 3; True once it is the last one, which is then held.

    u_{k+1} = u_k + T u' + T^2/2 u'' + T^3/6 u'''  with V, A, J of the plan at t_k and C', C'', C''' at u_k:

        u'   = V / |C'|
        u''  = A / |C'| - V^2 (C'.C'') / |C'|^4
        u''' = (J - 3 |C'|' u' u'' - |C'|'' u'^3) / |C'|

    (Cheng, Tsai, Cheng 2002, equations 4 to 9, carried on by one term.)  A step never goes back, nor beyond the end of
    the path; the last sample is that end, whatever the steps have accumulated.

    Parameters
    ----------
    order : int
        1, 2 or 3.
    feed, pieces
        ``TaylorTable.arrays``.
    state : (8 + 2 dim,) array
        From ``start``; changed in place.  Its last dim numbers are the sample: machine axes, mm (rad for rotary axes).
    """
    k = min(state[SAMPLE] + 1.0, state[LAST])
    i, piece, u = _taylor(
        order, feed, pieces, state, k, int(state[SEGMENT]), int(state[PIECE]), state[U], state, END + _dim(state)
    )
    state[SAMPLE], state[SEGMENT], state[PIECE], state[U] = k, i, piece, u
    return k >= state[LAST]


@njit(NOTHING(I64, READ2, READ3, WRITE1, WRITE1, WRITE1), cache=True)
def taylor_run(order, feed, pieces, state, u, positions):
    """Take ``u.size`` Taylor steps; ``positions`` is flat, ``dim`` numbers a step."""
    dim = _dim(state)
    k, i, piece, at = state[SAMPLE], int(state[SEGMENT]), int(state[PIECE]), state[U]
    for n in range(u.size):
        k = min(k + 1.0, state[LAST])
        i, piece, at = _taylor(order, feed, pieces, state, k, i, piece, at, positions, n * dim)
        u[n] = at
    state[SAMPLE], state[SEGMENT], state[PIECE], state[U] = k, i, piece, at
    _keep(state, positions)


# ---- feed shapes of 2002 (interp.feedshapes) ------------------------------------------------------------------------

TRAPEZOID, EXPONENTIAL, BELL = 0.0, 1.0, 2.0
EXPONENTIAL_RATE = 5.0  # time constants in the time of a ramp: 0.7 % of the feed is left then
# A shape is five numbers: which, feed F (mm/s), time of a ramp, begin of the falling ramp, end of the motion (s).


@njit(forceinline=True, error_model="numpy")
def _shape(shape, t):
    """Feed and acceleration of a shape at time t; a jump takes its value after it."""
    which, feed, ramp, fall, end = shape[0], shape[1], shape[2], shape[3], shape[4]
    if t < 0.0 or t >= end:
        return 0.0, 0.0
    if which == EXPONENTIAL:
        rate = EXPONENTIAL_RATE / ramp
        if t < fall:
            left = np.exp(-rate * t)
            return feed * (1.0 - left), feed * rate * left
        left = feed * (1.0 - np.exp(-rate * fall)) * np.exp(-rate * (t - fall))
        return left, -rate * left
    rising = t < ramp
    if not rising and t < fall:
        return feed, 0.0
    x = t / ramp if rising else (end - t) / ramp
    sign = 1.0 if rising else -1.0
    if which == BELL:
        return 0.5 * feed * (1.0 - np.cos(np.pi * x)), sign * 0.5 * feed * np.pi / ramp * np.sin(np.pi * x)
    return feed * x, sign * feed / ramp


@njit(NOTHING(READ1, READ1, WRITE1, WRITE1), cache=True)
def shape_feed(shape, t, feed, acceleration):
    """Write the feed and the acceleration of a shape at every time."""
    for n in range(t.size):
        feed[n], acceleration[n] = _shape(shape, t[n])


@njit(NOTHING(I64, READ1, READ3, F64, F64, WRITE1, WRITE1, WRITE1, WRITE2), cache=True)
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
        _position(pieces, piece, (at - pieces[piece, 0, 0]) / pieces[piece, 0, 1], flat, k * dim, dim)
        v, a = _shape(shape, k * period)
        feed[k], acceleration[k] = v, a
        speed, slope, bend = _speed(pieces, piece, at, order, dim)
        if speed > 0.0:
            step = _taylor_series(order, period, speed, slope, bend, v, a, 0.0)
            at = min(at + max(step, 0.0), u_end)


# ---- the other forms of a replay (interp.forms) ---------------------------------------------------------------------

TAYLOR_BY_PARAMETER, RUNGE_KUTTA, CHORD = 0, 1, 2
_NEWTON_PASSES = 60
# With V(u): periods before the plan's end, and share of the way left, within which a step is taken to the end.
_ARRIVAL, _CRAWL = 1.5, 0.1


@njit(forceinline=True)
def _cubic(row, t):
    return row[1] + t * (row[2] + t * (row[3] + t * row[4]))


@njit(forceinline=True)
def _feed_row(feed, state, k, i):
    """Row of the feed that holds the time of sample k."""
    while _since(state, k, feed[i + 1, 0]) >= 0.0:
        i += 1
    return i


@njit(forceinline=True)
def _piece_of(pieces, u, piece):
    while u >= pieces[piece + 1, 0, 0]:
        piece += 1
    return piece


@njit(forceinline=True, error_model="numpy")
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


@njit(forceinline=True, error_model="numpy")
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
        near, far = 1.0 / _horner(pieces[piece, last], w), 1.0 / _horner(pieces[other, last], x)
    square = 0.0
    for j in range(first, last):
        apart = far * _horner(pieces[other, j], x) - near * _horner(pieces[piece, j], w)
        square += apart * apart
    return np.sqrt(square)


@njit(forceinline=True, error_model="numpy")
def _corrected(form, passes, pieces, piece, u, u_end, period, speed, v, v1, length, dim):
    """Parameter step of the Runge-Kutta and of the chord form; see ``form_run``."""
    if form == RUNGE_KUTTA:
        step = period * v / speed
        other = min(u + step, u_end)
        following, _, _ = _speed(pieces, _piece_of(pieces, other, piece), other, 1, dim)
        return 0.5 * (step + period * v1 / following) if following > 0.0 else step
    step = length / speed
    for _ in range(passes):
        other = min(u + step, u_end)
        chord = _chord(pieces, piece, u, _piece_of(pieces, other, piece), other, dim)
        if chord > 0.0:
            step = (other - u) * length / chord
    return step


@njit(I64(I64, I64, READ2, READ2, READ3, F64, WRITE1, WRITE1, WRITE1), cache=True, error_model="numpy")
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
    dim = _dim(state)
    period = state[PERIOD_HIGH] + state[PERIOD_LOW]
    k, i, piece, at = state[SAMPLE], int(state[SEGMENT]), int(state[PIECE]), state[U]
    row = 0
    taken = 0
    while taken < u.size and at < state[U_END]:
        v, a, j = 0.0, 0.0, 0.0
        speed, slope, bend = _speed(pieces, piece, at, order if form == TAYLOR_BY_PARAMETER else 1, dim)
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
                step = _taylor_series(order, period, speed, slope, bend, v, a, j)
            if near and step < _CRAWL * (state[U_END] - at):
                step = state[U_END] - at
        elif k + 1.0 >= state[LAST]:
            step = state[U_END] - at
        else:
            i = _feed_row(feed, state, k, i)
            v = _cubic(feed[i], _since(state, k, feed[i, 0]))
            after = _feed_row(feed, state, k + 1.0, i)
            v1 = _cubic(feed[after], _since(state, k + 1.0, feed[after, 0]))
            length = 0.0
            if form == CHORD:
                middle = _feed_row(feed, state, k + 0.5, i)
                v2 = _cubic(feed[middle], _since(state, k + 0.5, feed[middle, 0]))
                length = period / 6.0 * (v + 4.0 * v2 + v1)
            if speed > 0.0:
                step = _corrected(form, order, pieces, piece, at, state[U_END], period, speed, v, v1, length, dim)
        at = min(at + max(step, 0.0), state[U_END])
        k += 1.0
        piece = _piece_of(pieces, at, piece)
        if at >= state[U_END]:
            _end(state, positions, taken * dim)
        else:
            _position(pieces, piece, (at - pieces[piece, 0, 0]) / pieces[piece, 0, 1], positions, taken * dim, dim)
        u[taken] = at
        taken += 1
    state[SAMPLE], state[SEGMENT], state[PIECE], state[U] = k, i, piece, at
    return taken


# ---- adaptive feed with look-ahead, 2007 (interp.lookahead) ---------------------------------------------------------

AVERAGED, UNIFORM = 0, 1


@njit(forceinline=True, error_model="numpy")
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
        d0, d1, d2, _ = _polynomial(pieces[piece, last], w, scale, 2)
    square = 0.0
    for j in range(first, last):
        c0, c1, c2, _ = _polynomial(pieces[piece, j], w, scale, 2)
        if rational:
            c0 = c0 / d0
            c1 = (c1 - d1 * c0) / d0
            c2 = (c2 - 2.0 * d1 * c1 - d2 * c0) / d0
        normal = c2 - slope / speed * c1
        square += normal * normal
    return np.sqrt(square) / (speed * speed)


@njit(I64(READ1, READ3, I64, F64, WRITE1, WRITE1, WRITE1), cache=True, error_model="numpy")
def adaptive_points(limits, pieces, dim, u_end, u, feed, lengths):
    """Place one point a period at the adaptive feed (2007, equations 5 to 7), from ``u[0]`` to the end of the path.

    ``limits`` is command feed, normal acceleration, chord error, period.  Writes u_i, V_i and the chords s_i between
    them; returns the number of points, or -1 where there is no room for them, or -2 - i where point i does not move.
    """
    period = limits[3]
    piece = 0
    for i in range(u.size):
        piece = _piece_of(pieces, u[i], piece)
        speed, slope, _ = _speed(pieces, piece, u[i], 2, dim)
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


@njit(F64(F64, READ1, WRITE1), cache=True)
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


@njit(forceinline=True, error_model="numpy")
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


@njit(I64(I64, I64, READ1, READ1, READ1, READ3, F64, F64, WRITE1, WRITE1, WRITE2), cache=True, error_model="numpy")
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
        _position(pieces, piece, (at - pieces[piece, 0, 0]) / pieces[piece, 0, 1], flat, k * dim, dim)
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
        speed, slope, bend = _speed(pieces, piece, at, order, dim)
        at = end if arrives else min(at + _taylor_series(order, period, speed, slope, bend, v, 0.0, 0.0), end)
    return -1
