"""The steps of ``interp/quintic.c`` and ``interp/taylor.c`` in plain Python, one sum after the other."""

from __future__ import annotations

import numpy as np

from interp.stepping import END, LAST, PERIOD_HIGH, PERIOD_LOW, PIECE, SAMPLE, SEGMENT, U_END, U


def speed_derivatives(square, along, bend):
    """|C'| > 0 and its first two derivatives with respect to u, from |C'|^2, C'.C'' and |C''|^2 + C'.C'''."""
    speed = np.sqrt(square)
    slope = along / speed
    return speed, slope, (bend - slope * slope) / speed


def rates_of_parameter(speed, slope, bend, v, a, j):
    """First three time derivatives of u from those of the arc length, given |C'| and its first two derivatives."""
    u1 = v / speed
    u2 = (a - slope * u1 * u1) / speed
    return u1, u2, (j - 3.0 * slope * u1 * u2 - bend * u1 * u1 * u1) / speed


def since(state, k, start):
    """Time k T - start, s, without the rounding of k T: k times the high part is exact and close to start."""
    return (k * state[PERIOD_HIGH] - start) + k * state[PERIOD_LOW]


def horner(row, w):
    value = row[0]
    for n in range(1, row.size):
        value = value * w + row[n]
    return value


def position(pieces, piece, w, out, at, dim):
    """Write the point of a piece at w into ``out[at : at + dim]``."""
    scale = 1.0
    if pieces.shape[1] > dim + 1:
        scale = 1.0 / horner(pieces[piece, dim + 1], w)
    for j in range(dim):
        out[at + j] = scale * horner(pieces[piece, 1 + j], w)


def axes_of(state):
    return (state.size - END) // 2


def end(state, out, at):
    for j in range(axes_of(state)):
        out[at + j] = state[END + j]


def keep(state, positions):
    """Put the last row of the flat positions into the state."""
    dim = axes_of(state)
    for j in range(min(dim, positions.size)):
        state[END + dim + j] = positions[positions.size - dim + j]


def quintic(segments, pieces, state, k, i, u, out, at):
    """Write sample k; returns its segment and parameter, given those of the sample before."""
    if k >= state[LAST]:
        end(state, out, at)
        return i, state[U_END]
    while since(state, k, segments[i + 1, 0]) >= 0.0:
        i += 1
    t = since(state, k, segments[i, 0])
    c = segments[i]
    w = c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6]))))
    w = min(max(w, 0.0), 1.0)
    piece = int(c[7])
    position(pieces, piece, w, out, at, axes_of(state))
    # A rounding must not report a parameter that falls back, or one beyond the end.
    return i, min(max(pieces[piece, 0, 0] + pieces[piece, 0, 1] * w, u), state[U_END])


def polynomial(row, w, scale, order):
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


def tip_speed(pieces, piece, u, order, dim):
    """|C'| of the tool tip and, as far as the order needs them, its first and second derivative with respect to u."""
    rows = pieces.shape[1]
    rational = rows > dim + 1
    first = dim + 2 if rows > dim + 2 else 1
    last = rows - 1 if rational else rows
    scale = 1.0 / pieces[piece, 0, 1]
    w = (u - pieces[piece, 0, 0]) * scale
    d0, d1, d2, d3 = 1.0, 0.0, 0.0, 0.0
    if rational:
        d0, d1, d2, d3 = polynomial(pieces[piece, last], w, scale, order)
    square = dot = more = 0.0
    for j in range(first, last):
        c0, c1, c2, c3 = polynomial(pieces[piece, j], w, scale, order)
        if rational:  # quotient rule, as in planner/geometry/curve_inline.h
            c0 = c0 / d0
            c1 = (c1 - d1 * c0) / d0
            c2 = (c2 - 2.0 * d1 * c1 - d2 * c0) / d0
            c3 = (c3 - 3.0 * d1 * c2 - 3.0 * d2 * c1 - d3 * c0) / d0
        square += c1 * c1
        dot += c1 * c2
        more += c2 * c2 + c1 * c3
    return speed_derivatives(square, dot, more)


def taylor_series(order, period, speed, slope, bend, v, a, j):
    """T u' + T^2/2 u'' + T^3/6 u''' as far as the order goes; see ``taylor_step``."""
    u1, u2, u3 = rates_of_parameter(speed, slope, bend, v, a, j)
    step = period * u1
    if order > 1:
        step += 0.5 * period * period * u2
    if order > 2:
        step += period * period * period / 6.0 * u3
    return step


def taylor(order, feed, pieces, state, k, i, piece, u, out, at):
    """Write sample k; returns its segment, piece and parameter, given those of the sample before."""
    if k >= state[LAST]:
        end(state, out, at)
        return i, piece, state[U_END]
    dim = axes_of(state)
    before = k - 1.0
    period = state[PERIOD_HIGH] + state[PERIOD_LOW]
    while since(state, before, feed[i + 1, 0]) >= 0.0:
        i += 1
    t = since(state, before, feed[i, 0])
    c = feed[i]
    speed, slope, bend = tip_speed(pieces, piece, u, order, dim)
    step = 0.0
    if speed > 0.0:
        v = c[1] + t * (c[2] + t * (c[3] + t * c[4]))
        a = c[2] + t * (2.0 * c[3] + t * 3.0 * c[4])
        step = taylor_series(order, period, speed, slope, bend, v, a, 2.0 * c[3] + t * 6.0 * c[4])
    u = min(u + max(step, 0.0), state[U_END])
    while u >= pieces[piece + 1, 0, 0]:
        piece += 1
    position(pieces, piece, (u - pieces[piece, 0, 0]) / pieces[piece, 0, 1], out, at, dim)
    return i, piece, u


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
    i, u = quintic(segments, pieces, state, k, int(state[SEGMENT]), state[U], state, END + axes_of(state))
    state[SAMPLE], state[SEGMENT], state[U] = k, i, u
    return k >= state[LAST]


def quintic_run(segments, pieces, state, u, positions):
    """Take ``u.size`` steps; ``positions`` is flat, ``dim`` numbers a step."""
    dim = axes_of(state)
    k, i, at = state[SAMPLE], int(state[SEGMENT]), state[U]
    for n in range(u.size):
        k = min(k + 1.0, state[LAST])
        i, at = quintic(segments, pieces, state, k, i, at, positions, n * dim)
        u[n] = at
    state[SAMPLE], state[SEGMENT], state[U] = k, i, at
    keep(state, positions)


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
    i, piece, u = taylor(
        order, feed, pieces, state, k, int(state[SEGMENT]), int(state[PIECE]), state[U], state, END + axes_of(state)
    )
    state[SAMPLE], state[SEGMENT], state[PIECE], state[U] = k, i, piece, u
    return k >= state[LAST]


def taylor_run(order, feed, pieces, state, u, positions):
    """Take ``u.size`` Taylor steps; ``positions`` is flat, ``dim`` numbers a step."""
    dim = axes_of(state)
    k, i, piece, at = state[SAMPLE], int(state[SEGMENT]), int(state[PIECE]), state[U]
    for n in range(u.size):
        k = min(k + 1.0, state[LAST])
        i, piece, at = taylor(order, feed, pieces, state, k, i, piece, at, positions, n * dim)
        u[n] = at
    state[SAMPLE], state[SEGMENT], state[PIECE], state[U] = k, i, piece, at
    keep(state, positions)
