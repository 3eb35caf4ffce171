"""The loops of greedy.c, greedy_compat.c and greedy_physical.c in plain Python, one sum after the other."""

from __future__ import annotations

# ruff: noqa: PLR0912  -- as long as the published loops
from math import cos, exp, sin

import numpy as np

from interp.literature.greedy_layout import (
    ALGORITHM,
    AXIS_LIMIT,
    BACK_OFF,
    COUNT,
    CURVATURE,
    DONE,
    DU,
    ERROR,
    ERROR_PIECE,
    EXACT_TAYLOR,
    FALL,
    FEED,
    FLOOR,
    HIGHEST,
    JERK,
    LENGTH,
    LOWEST,
    NO_ADVANCE,
    NORMAL_LIMIT,
    NOT_FINITE,
    PERIOD,
    PIECE,
    PLANNED,
    PLANNED_FEED,
    PUBLISHED_BOUND,
    RATE,
    RISE,
    ROOT,
    RUNNING,
    SAFETY,
    SHAPE,
    SINGULAR,
    SINGULAR_SPEED,
    SOFT,
    SPEED,
    THETA,
    TINY_STEPS,
    TOLERANCE,
    TOO_LONG,
    WRONG_BEND,
    U,
)

_SUBDIVISIONS = 20  # of a chord: 19 inner points, as published
_MAX_STEP = 0.1
_MIN_STEP = 1e-12
_SMALL_STEPS = 5
_MAX_PASSES = 100_000  # 0.999 to this power is 0
_LOW_THETA = 1e-9  # 0.9, 0.8, ... reaches 0 in the tenth pass but for rounding
_BLOCK = 64  # trials passed over at once
_PUSH_UP = 0.999  # share of the tolerance that Algorithm 4 pushes to
_ROOT_WINDOW = 1e-6  # of the tolerance
_SOLVER_PASSES = 80
_NEGLIGIBLE = 1e-12  # a component of the unit tangent below which an axis does not bound the acceleration


def _square(x):
    return x * x


def _piece_of(breaks, u, piece):
    last = breaks.size - 2
    while piece < last and u >= breaks[piece + 1]:
        piece += 1
    while piece > 0 and u < breaks[piece]:
        piece -= 1
    return piece


def _value(coefficients, piece, row, w):
    degree = coefficients.shape[2] - 1
    value = coefficients[piece, row, degree]
    for k in range(degree - 1, -1, -1):
        value = value * w + coefficients[piece, row, k]
    return value


def _point(breaks, coefficients, rational, u, piece, out):
    """Write the point at u; returns its piece."""
    piece = _piece_of(breaks, u, piece)
    w = (u - breaks[piece]) / (breaks[piece + 1] - breaks[piece])
    scale = 1.0
    if rational:
        scale = 1.0 / _value(coefficients, piece, out.size, w)
    for j in range(out.size):
        out[j] = scale * _value(coefficients, piece, j, w)
    return piece


def _polynomial(coefficients, piece, row, w, scale):
    """Value and first two derivatives with respect to u (dw/du = scale)."""
    degree = coefficients.shape[2] - 1
    b0 = coefficients[piece, row, degree]
    b1 = b2 = 0.0
    for k in range(degree - 1, -1, -1):
        b2 = b2 * w + b1
        b1 = b1 * w + b0
        b0 = b0 * w + coefficients[piece, row, k]
    return b0, b1 * scale, 2.0 * b2 * scale * scale


def _derivatives(breaks, coefficients, rational, u, piece, first, second):
    """Write C' and C'' at u; returns the piece."""
    piece = _piece_of(breaks, u, piece)
    scale = 1.0 / (breaks[piece + 1] - breaks[piece])
    w = (u - breaks[piece]) * scale
    d0, d1, d2 = 1.0, 0.0, 0.0
    if rational:
        d0, d1, d2 = _polynomial(coefficients, piece, first.size, w, scale)
    for j in range(first.size):
        c0, c1, c2 = _polynomial(coefficients, piece, j, w, scale)
        if rational:
            c0 = c0 / d0
            c1 = (c1 - d1 * c0) / d0
            c2 = (c2 - 2.0 * d1 * c1 - d2 * c0) / d0
        first[j], second[j] = c1, c2
    return piece


def _add_wrong_bend(u, scale, second):
    """Add to the butterfly's C'' what three wrong terms of the published program make of it.

    x'': d(sin^2) without its cosine, and a sine in place of a cosine; y'': a factor sin t left out.
    """
    t = 2.0 * np.pi * u
    s, c = sin(t), cos(t)
    e = exp(c)
    k = scale * ((2.0 * np.pi) * (2.0 * np.pi))
    second[0] += k * ((2.0 * s * c - 2.0 * s) * e + 32.0 * s * (sin(4.0 * t) - cos(4.0 * t)))
    second[1] += k * ((s + s * c) * e + (c * c - s * s - s * s * c) * e)


def _dot(a, b):
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


def _feed_limits(first, second, velocity, acceleration, safety):
    """|C'|, C'.C'', limits 2 and 4, and the curvature; k_j below is the j-th component of d2C/ds2."""
    speed2 = _dot(first, first)
    speed = np.sqrt(speed2)
    dot = _dot(first, second)
    axis = normal = np.inf
    kappa2 = 0.0
    for j in range(first.size):
        k = (second[j] - first[j] * (dot / speed2)) / speed2
        kappa2 += k * k
        axis = min(axis, velocity[j] * speed / abs(first[j]))
        normal = min(normal, np.sqrt(safety * acceleration[j] / abs(k)))
    return speed, dot, axis, normal, np.sqrt(kappa2)


def _chord_limit(kappa, error, period):
    """(2/T) sqrt(2 rho e - e^2): limit 3, the feed whose chord leaves a circle of radius rho by e."""
    if error == np.inf:
        return np.inf
    if kappa * error >= 1.0:
        error = 1.0 / kappa
    return 2.0 / period * np.sqrt(2.0 * error / kappa - error * error)


def _s_curve(u, settings):
    """Rising and falling factor; the exponent is clamped, as exp would overflow far outside either ramp."""
    rise = 1.0 / _square(_square(_square(1.0 + exp(min(-15.0 * u / settings[RISE], 80.0)))))
    z = 3.0 * (u - settings[FALL]) / (1.0 - settings[FALL])
    return rise * (1.0 - 1.0 / _square(_square(_square(1.0 + exp(min(-5.0 * z, 80.0))))))


def _acceleration_range(first, second, speed, dot, feed, acceleration):
    """Tangential accelerations A with |t_j A + k_j V^2| <= A_j on every axis."""
    lowest, highest = -np.inf, np.inf
    for j in range(first.size):
        t = first[j] / speed
        if abs(t) > _NEGLIGIBLE:
            k = (second[j] - first[j] * (dot / (speed * speed))) / (speed * speed)
            centre, half = -k * feed * feed / t, acceleration[j] / abs(t)
            lowest, highest = max(lowest, centre - half), min(highest, centre + half)
    return lowest, highest


def _inner_points(breaks, coefficients, rational, u, du, piece, last, dim, inner):
    """Write the 19 inner points to ``inner[:dim]``; the rows behind are scratch."""
    w = inner[dim]
    scale = inner[dim + 1]
    if piece != last:
        one = np.empty(dim)
        for n in range(_SUBDIVISIONS - 1):
            at = u + du * ((n + 1) / _SUBDIVISIONS)
            piece = _point(breaks, coefficients, rational, at, piece, one)
            for j in range(dim):
                inner[j, n] = one[j]
        return
    # On one piece, as a rule: all points side by side, which the compiler turns into vector instructions.
    width = breaks[piece + 1] - breaks[piece]
    first, step = (u - breaks[piece]) / width, du / width / _SUBDIVISIONS
    degree = coefficients.shape[2] - 1
    for n in range(_SUBDIVISIONS - 1):
        w[n] = first + step * (n + 1)
    for j in range(dim + 1 if rational else dim):
        row = scale if j == dim else inner[j]
        top = coefficients[piece, j, degree]
        for n in range(_SUBDIVISIONS - 1):
            row[n] = top
        for k in range(degree - 1, -1, -1):
            c = coefficients[piece, j, k]
            for n in range(_SUBDIVISIONS - 1):
                row[n] = row[n] * w[n] + c
    if rational:
        for j in range(dim):
            for n in range(_SUBDIVISIONS - 1):
                inner[j, n] /= scale[n]


def _chord_error(breaks, coefficients, rational, u, du, piece, stop, start, end, inner):
    """Largest distance of the inner points from the chord over [u, u + du], or that of the middle if above ``stop``.

    |p x c| / |c| by the components of the cross product: exact for vertical chords too.  ``start`` holds C(u), ``end``
    takes the chord, ``inner (dim + 2, 19)`` is scratch.
    """
    dim = end.size
    last = _point(breaks, coefficients, rational, u + du, piece, end)
    chord2 = 0.0
    for j in range(dim):
        end[j] -= start[j]
        chord2 += end[j] * end[j]
    if chord2 == 0.0:
        return 0.0
    allowed = stop * stop * chord2
    if stop < np.inf:  # the middle is the worst, as a rule: most trials of a back-off end here
        middle = inner[dim]
        _point(breaks, coefficients, rational, u + 0.5 * du, min(piece, last), middle[:dim])
        cross2 = 0.0
        for i in range(dim):
            for j in range(i + 1, dim):
                cross = (middle[i] - start[i]) * end[j] - (middle[j] - start[j]) * end[i]
                cross2 += cross * cross
        if not cross2 <= allowed:  # nan, far beyond the end of a piece, counts as too large
            return np.sqrt(cross2 / chord2)
    _inner_points(breaks, coefficients, rational, u, du, piece, last, dim, inner)
    worst = inner[dim]
    for n in range(_SUBDIVISIONS - 1):
        worst[n] = 0.0
    for i in range(dim):
        for j in range(i + 1, dim):
            for n in range(_SUBDIVISIONS - 1):
                cross = (inner[i, n] - start[i]) * end[j] - (inner[j, n] - start[j]) * end[i]
                worst[n] += cross * cross
    cross2 = 0.0
    for n in range(_SUBDIVISIONS - 1):
        if not worst[n] <= cross2:
            cross2 = worst[n]
            if np.isnan(cross2):
                break
    return np.sqrt(cross2 / chord2)


def _step_to_tolerance(breaks, coefficients, rational, u, guess, cap, piece, tolerance, start, end, inner):
    """Largest step up to ``cap`` whose chord error is within the tolerance, to 1e-6 of it.

    The error grows as the square of the step, nearly; the next guess follows that law, and halves the bracket where
    that leaves it or takes long.
    """
    lo, hi, x = 0.0, np.inf, min(guess, cap)
    for n in range(_SOLVER_PASSES):
        error = _chord_error(breaks, coefficients, rational, u, x, piece, tolerance, start, end, inner)
        if error <= tolerance:
            lo = x
            if x >= cap or error >= tolerance * (1.0 - _ROOT_WINDOW):
                break
        else:
            hi = x
        if hi < np.inf and hi - lo <= 1e-10 * hi:
            break
        x *= min(2.0, np.sqrt(tolerance * (1.0 - 0.5 * _ROOT_WINDOW) / error))
        if not lo < x < hi or (n > 8 and n % 2 == 0 and hi < np.inf):
            x = 0.5 * (lo + hi)
        x = min(x, cap)
    return lo


def _stalled(u, du, tiny):
    """Code for a step that leads nowhere, else RUNNING; and the number of tiny steps in a row."""
    if not (du > 0.0 and du < np.inf):
        return NOT_FINITE, tiny
    tiny = tiny + 1 if du < _MIN_STEP else 0
    if u + du == u or tiny >= _SMALL_STEPS:
        return NO_ADVANCE, tiny
    return (TOO_LONG if du > _MAX_STEP else RUNNING), tiny


def _published_back_off(breaks, coefficients, rational, u, du, piece, settings, start, end, inner):
    """Multiply the step by theta = 1 - d, 1 - 2 d, ... until the chord error is within the tolerance.

    d = 0.1 in Algorithm 2, 1e-6 in Algorithms 3 and 4.  The error grows with the step: of a block of trials whose last
    one is still too large none is looked at.  Returns the code, the step, theta.
    """
    d = 1e-6 if settings[ALGORITHM] > 2.0 else 0.1
    tolerance = settings[TOLERANCE]
    theta = 1.0 - d
    if _chord_error(breaks, coefficients, rational, u, du, piece, tolerance, start, end, inner) <= tolerance:
        return RUNNING, du, theta
    while d * _BLOCK < theta and du > 0.0:
        trial, next_theta = du, theta
        for _ in range(_BLOCK):
            trial *= next_theta
            next_theta -= d
        if _chord_error(breaks, coefficients, rational, u, trial, piece, tolerance, start, end, inner) <= tolerance:
            break
        du, theta = trial, next_theta
    while theta > _LOW_THETA and du > 0.0:
        du *= theta
        theta -= d
        if _chord_error(breaks, coefficients, rational, u, du, piece, tolerance, start, end, inner) <= tolerance:
            return RUNNING, du, theta
    return BACK_OFF, du, theta


def _published_push_up(breaks, coefficients, rational, u, du, piece, settings, start, end, inner):
    """Multiply the step by theta = 1, 1 + 1e-7, ... until the chord error is 0.999 of the tolerance at least.

    A block of trials whose last one is still too small is passed over, as in the back-off.
    """
    least = _PUSH_UP * settings[TOLERANCE]
    theta = 1.0
    while du <= _MAX_STEP and theta < 2.0:
        trial, next_theta = du, theta
        for _ in range(_BLOCK):
            trial *= next_theta
            next_theta += 1e-7
        if not _chord_error(breaks, coefficients, rational, u, trial, piece, least, start, end, inner) < least:
            break
        du, theta = trial, next_theta
    while du <= _MAX_STEP and theta < 2.0:
        if not _chord_error(breaks, coefficients, rational, u, du, piece, least, start, end, inner) < least:
            break
        du *= theta
        theta += 1e-7
    return du, theta


def compat_run(
    breaks, coefficients, rational, e_breaks, e_coefficients, e_rational, velocity, acceleration, settings, state,
    u_out, feed_out,
):  # fmt: skip
    """Run the published program for up to ``u_out.size`` passes; the path named e_ is the one its chord error is of.

    u may pass 1 in the last step.  ``feed_out`` takes the feedrate that drove each step.
    """
    dim, e_dim = velocity.size, e_coefficients.shape[1] - 1
    first, second = np.empty(dim), np.empty(dim)
    start, end, inner = np.empty(e_dim), np.empty(e_dim), np.empty((e_dim + 2, _SUBDIVISIONS - 1))
    period, algorithm = settings[PERIOD], settings[ALGORITHM]
    code, count = RUNNING, 0
    u, tiny = state[U], state[TINY_STEPS]
    piece, e_piece = int(state[PIECE]), int(state[ERROR_PIECE])
    while count < u_out.size:
        piece = _derivatives(breaks, coefficients, rational, u, piece, first, second)
        speed = np.sqrt(_dot(first, first))
        state[SPEED], state[THETA] = speed, 1.0
        if not (speed > settings[SINGULAR_SPEED] and speed < np.inf):
            code = SINGULAR
            break
        feed = settings[FEED]
        if settings[PLANNED_FEED] > 0.0:
            _, _, axis, normal, kappa = _feed_limits(first, second, velocity, acceleration, settings[SAFETY])
            limit = min(feed, axis, normal)
            if algorithm >= 3.0:
                limit = min(limit, _chord_limit(kappa, settings[TOLERANCE], period))
            feed = max(limit * _s_curve(u, settings), min(limit, settings[FLOOR]))
        if settings[WRONG_BEND] > 0.0:
            _add_wrong_bend(u, settings[WRONG_BEND], second)
        way = period * feed
        if settings[EXACT_TAYLOR] > 0.0:
            du = abs(way / speed - 0.5 * way * way * _dot(first, second) / _square(_square(speed)))
        else:
            du = abs(way / speed - 0.5 * way * way * np.sqrt(_dot(second, second)) / (speed * _square(speed)))
        if algorithm >= 2.0 and du < np.inf:
            e_piece = _point(e_breaks, e_coefficients, e_rational, u, e_piece, start)
            if settings[ROOT] > 0.0:
                cap = 2.0 * _MAX_STEP if algorithm >= 4.0 else du
                du = _step_to_tolerance(
                    e_breaks, e_coefficients, e_rational, u, du, cap, e_piece, settings[TOLERANCE], start, end, inner
                )
            else:
                code, du, state[THETA] = _published_back_off(
                    e_breaks, e_coefficients, e_rational, u, du, e_piece, settings, start, end, inner
                )
                if algorithm >= 4.0 and code == RUNNING:
                    du, state[THETA] = _published_push_up(
                        e_breaks, e_coefficients, e_rational, u, du, e_piece, settings, start, end, inner
                    )
        state[DU] = du
        if code == RUNNING:
            code, tiny = _stalled(u, du, tiny)
        if code != RUNNING:
            break
        u += du
        u_out[count], feed_out[count] = u, feed
        count += 1
        if u >= 1.0:
            code = DONE
            break
    state[U], state[PIECE], state[ERROR_PIECE], state[TINY_STEPS], state[COUNT] = u, piece, e_piece, tiny, count
    return code


def _next_feed(target, lowest, highest, settings, V, A):
    """Feedrate of the next period by the cases of the table: A faster, B slower, C as it is."""
    period, change = settings[PERIOD], settings[JERK] * settings[PERIOD]
    if target > V:
        rise = min(max(A + change if A > 0.0 else change, 0.0), highest)
        return min(V + rise * period, target)
    if target < V and settings[SOFT] > 0.0:
        fall = min(max(A - change if A < 0.0 else -change, lowest), 0.0)
        return max(V + fall * period, target)
    return target


def _fine_steps(breaks, coefficients, rational, u, du, cap, piece, tolerance, start, end, inner):
    """Shrink the step by 0.999 until the chord error is within the tolerance; then grow it by 1.001 up to the cap."""
    for _ in range(_MAX_PASSES):
        if _chord_error(breaks, coefficients, rational, u, du, piece, tolerance, start, end, inner) <= tolerance:
            break
        du *= 0.999
    while du < cap:
        trial = min(du * 1.001, cap)
        error = _chord_error(breaks, coefficients, rational, u, trial, piece, tolerance, start, end, inner)
        if not error <= tolerance:
            break
        du = trial
        if error >= _PUSH_UP * tolerance:
            break
    return du


def physical_run(breaks, coefficients, rational, velocity, acceleration, settings, state, u_out, feed_out):
    """Run the algorithms with the planned feedrate in the step for up to ``u_out.size`` passes; the last ends at 1."""
    dim = velocity.size
    first, second = np.empty(dim), np.empty(dim)
    start, end, inner = np.empty(dim), np.empty(dim), np.empty((dim + 2, _SUBDIVISIONS - 1))
    period, algorithm, tolerance = settings[PERIOD], settings[ALGORITHM], settings[TOLERANCE]
    code, count = RUNNING, 0
    u, V, A, piece, tiny = state[U], state[PLANNED], state[RATE], int(state[PIECE]), state[TINY_STEPS]
    while count < u_out.size:
        piece = _derivatives(breaks, coefficients, rational, u, piece, first, second)
        speed, dot, axis, normal, kappa = _feed_limits(first, second, velocity, acceleration, settings[SAFETY])
        state[SPEED] = speed
        if not (speed > settings[SINGULAR_SPEED] and speed < np.inf):
            code = SINGULAR
            break
        shape = _s_curve(u, settings)
        most = min(settings[FEED], axis, normal)
        if algorithm == 1.0:
            feed = max(settings[FEED] * shape, settings[FLOOR])
        else:
            limit = min(most, _chord_limit(kappa, tolerance, period)) if algorithm >= 3.0 else most
            lowest, highest = _acceleration_range(first, second, speed, dot, V, acceleration)
            target = max(limit * shape, min(limit, settings[FLOOR]))
            feed = _next_feed(target, lowest, highest, settings, V, A)
        A, V = (feed - V) / period, feed
        way = period * feed
        du = way / speed - 0.5 * way * way * dot / _square(_square(speed))
        if algorithm >= 3.0 and tolerance < np.inf and du > 0.0 and du < np.inf:
            planned = du
            cap = du
            if algorithm >= 4.0 and shape > _PUSH_UP:
                cap = du * max(1.0, most / feed)
            _point(breaks, coefficients, rational, u, piece, start)
            if settings[ROOT] > 0.0:
                du = _step_to_tolerance(breaks, coefficients, rational, u, du, cap, piece, tolerance, start, end, inner)
            else:
                du = _fine_steps(breaks, coefficients, rational, u, du, cap, piece, tolerance, start, end, inner)
            feed *= du / planned
        state[DU] = du
        code, tiny = _stalled(u, du, tiny)
        if code != RUNNING:
            break
        u = min(u + du, 1.0)
        u_out[count], feed_out[count] = u, feed
        count += 1
        if u >= 1.0:
            code = DONE
            break
    state[U], state[PLANNED], state[RATE], state[PIECE], state[TINY_STEPS], state[COUNT] = u, V, A, piece, tiny, count
    return code


def chord_errors(breaks, coefficients, rational, u, out):
    """Write the chord error between u[k] and u[k + 1] to out[k]."""
    dim = coefficients.shape[1] - 1
    start, end, inner = np.empty(dim), np.empty(dim), np.empty((dim + 2, _SUBDIVISIONS - 1))
    piece = 0
    for k in range(u.size - 1):
        piece = _point(breaks, coefficients, rational, u[k], piece, start)
        out[k] = _chord_error(breaks, coefficients, rational, u[k], u[k + 1] - u[k], piece, np.inf, start, end, inner)


def along(breaks, coefficients, rational, u, feed, velocity, acceleration, settings, out):
    """Write what there is to know at every point, ``out (u.size, COLUMNS)``.

    ``feed`` is that of the step before each point; where it is empty, the chord over the period is.
    """
    dim = velocity.size
    first, second = np.empty(dim), np.empty(dim)
    start, end, inner = np.empty(dim), np.empty(dim), np.empty((dim + 2, _SUBDIVISIONS - 1))
    piece = 0
    before = 0.0
    for n in range(u.size):
        piece = _derivatives(breaks, coefficients, rational, u[n], piece, first, second)
        speed, dot, axis, normal, kappa = _feed_limits(first, second, velocity, acceleration, settings[SAFETY])
        row = out[n]
        row[AXIS_LIMIT], row[NORMAL_LIMIT], row[CURVATURE], row[SHAPE] = axis, normal, kappa, _s_curve(u[n], settings)
        at = feed[n] if feed.size > 0 else before
        row[LOWEST], row[HIGHEST] = _acceleration_range(first, second, speed, dot, at, acceleration)
        if settings[WRONG_BEND] > 0.0:
            _add_wrong_bend(u[n], settings[WRONG_BEND], second)
        bend = np.sqrt(_dot(second, second))
        row[PUBLISHED_BOUND] = np.inf
        for j in range(dim):
            row[PUBLISHED_BOUND] = min(row[PUBLISHED_BOUND], acceleration[j] * bend / abs(second[j]))
        row[LENGTH] = row[ERROR] = 0.0
        if n + 1 < u.size:
            _point(breaks, coefficients, rational, u[n], piece, start)
            du = u[n + 1] - u[n]
            row[ERROR] = _chord_error(breaks, coefficients, rational, u[n], du, piece, np.inf, start, end, inner)
            row[LENGTH] = np.sqrt(_dot(end, end))
            before = row[LENGTH] / settings[PERIOD]
