"""Steps where spans of a plan meet, and exact stops at corners."""

from __future__ import annotations

import numpy as np

from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.quantity import TANGENTIAL_ACCELERATION
from planner.types import FloatArray
from planner.verify.findings import Rows
from planner.verify.motion import Motion
from planner.verify.peaks import CANDIDATES, chunks, peaks, zoom
from planner.verify.places import Places
from planner.verify.quantities import axis_rows, row_of
from planner.verify.scan import Scan
from planner.verify.sizes import STEP_PEAK, STEP_REACH, VELOCITY_STEP, group_sizes

# Steps of the acceleration below this fraction of the largest value are rounding, like those of the velocity.
_ACCELERATION_STEP = 1e-6
_TURNED_BACK = np.pi - 1e-6  # rad


def check_steps(motion: Motion, scan: Scan, limits: Limits, rows: Rows, density: int) -> None:
    """Steps of velocity and acceleration between spans, and what the latter become once they are sampled."""
    dim, period = motion.curve.dim, limits.period
    velocity, acceleration = (group_sizes(motion.curve, scan.largest[axis_rows(dim, k)]) for k in range(2))
    t = np.append(motion.time(np.arange(motion.interval.size), motion.lower), motion.law.start[-1] + motion.law.h[-1])
    u = np.append(motion.u_ends[0], motion.u_ends[1, -1])
    steps, along = scan.steps.copy(), np.abs(scan.along)
    # A controller holds the first and the last point.  A plan that begins (ends) at speed continues another one, so
    # there is nothing to compare with; from a standstill, an acceleration at once is a step like any other.
    for end in (0, -1):
        if (np.abs(steps[0, end]) > VELOCITY_STEP * velocity).any():
            steps[1, end] = along[end] = 0.0
        steps[0, end] = 0.0
    sizes = np.abs(steps)
    for j in range(dim):
        k = int(sizes[0, :, j].argmax())
        rows.add("velocity step", sizes[0, k, j], 0.0, (t[k], u[k]), slack=VELOCITY_STEP * velocity[j], j=j)
    for j in range(dim):
        k = int(sizes[1, :, j].argmax())
        slack = _ACCELERATION_STEP * acceleration[j]
        # The step that alone, once sampled, would use up the jerk.
        alone = limits.jerk[j] * period / STEP_PEAK
        rows.add("acceleration step", sizes[1, k, j], alone, (t[k], u[k]), slack=slack, j=j)
    k, size = int(along.argmax()), float(scan.largest[row_of(TANGENTIAL_ACCELERATION)])
    alone = limits.tangential_jerk * period / STEP_PEAK
    rows.add("tangential step", along[k], alone, (t[k], u[k]), slack=_ACCELERATION_STEP * size)
    found = np.flatnonzero((sizes[1] > _ACCELERATION_STEP * acceleration).any(axis=1))
    if found.size == 0:
        return
    t, u, steps = t[found], u[found], steps[1, found]
    _check_smooth_steps(motion.curve, limits, rows, (t, u), np.abs(steps), _ACCELERATION_STEP * acceleration)
    near = _jerk_near(motion, scan, t, 2.0 * STEP_REACH * period, density)
    phases = np.linspace(-STEP_REACH, STEP_REACH, 13)
    height, at = np.empty((t.size, dim)), np.empty((t.size, dim))
    for some in chunks(t.size, phases.size * dim):
        seen = _sampled_steps(t[some, None] + phases * period, t, steps, period)
        height[some], top = peaks(np.moveaxis(seen, 1, -1))
        at[some] = t[some, None] + phases[top] * period
    for j in range(dim):
        best = np.argsort(-(height[:, j] + near[:, j]), kind="stable")[:CANDIDATES]
        half = np.full(best.size, 0.25 * period)

        def rise(x: FloatArray, j: int = j) -> FloatArray:
            return _sampled_steps(x, t, steps, period)[..., j]

        x = zoom(rise, at[best, j], half, at[best, j] - half, at[best, j] + half)
        total = rise(x[:, None])[:, 0] + near[best, j]
        k = int(total.argmax())
        rows.add("jerk at a curvature break", total[k], limits.jerk[j], (t[best[k]], u[best[k]]), j=j)


def _check_smooth_steps(
    curve: Curve,
    limits: Limits,
    rows: Rows,
    places: tuple[FloatArray, FloatArray],
    sizes: FloatArray,
    slack: FloatArray,
) -> None:
    """Steps of the acceleration (n, dim) where the curvature has none: no jerk is large enough for them.

    Samples do not tell a small one from a jerk, but a plan says what happens between the samples.
    """
    of_curve = Places.of(curve)
    smooth = np.flatnonzero(~(of_curve.on(of_curve.corners, places[1]) | of_curve.on(of_curve.jumps, places[1])))
    linear = np.array(curve.axis_units) == "mm"
    limited = np.isfinite(limits.jerk) | (np.isfinite(limits.tangential_jerk) & linear)
    for j in np.flatnonzero(limited) if smooth.size else ():
        k = smooth[sizes[smooth, j].argmax()]
        place = float(places[0][k]), float(places[1][k])
        rows.add("step on a smooth path", sizes[k, j], 0.0, place, slack=slack[j], j=int(j))


def _sampled_steps(at: FloatArray, t: FloatArray, steps: FloatArray, period: float) -> FloatArray:
    """|third difference| / T^3 of samples centred at the times ``at`` (n, k), by steps of the acceleration; (n, k, dim).

    A step D at the time t_i makes D B((at - t_i) / T) / T, with the quadratic B-spline

        B(z) = 3/4 - z^2 for |z| <= 1/2,   (3/2 - |z|)^2 / 2 for |z| <= 3/2,

    and those of steps that are close together add up.
    """
    first = np.searchsorted(t, at - STEP_REACH * period)
    last = np.searchsorted(t, at + STEP_REACH * period, side="right")
    total = np.zeros((*at.shape, steps.shape[1]))
    for k in range(int((last - first).max())):
        i = np.minimum(first + k, t.size - 1)
        z = np.abs(at - t[i]) / period
        spline = np.where(z <= 0.5, STEP_PEAK - z**2, 0.5 * np.maximum(STEP_REACH - z, 0.0) ** 2)
        total += np.where(first + k < last, spline, 0.0)[..., None] * steps[i]
    return np.asarray(np.abs(total) / period)


def _jerk_near(motion: Motion, scan: Scan, t: FloatArray, reach: float, density: int) -> FloatArray:
    """Largest |axis jerk| less its slack (m, dim) within ``reach`` of each time; cut spans are measured again."""
    dim, spans = motion.curve.dim, motion.interval.size
    every = np.arange(spans)
    begin, end = motion.time(every, motion.lower), motion.time(every, motion.upper)
    first = np.minimum(np.searchsorted(end, t - reach, side="right"), spans - 1)
    last = np.maximum(np.searchsorted(begin, t + reach, side="left") - 1, first)
    # Whole spans lie strictly between the first and the last; reduceat takes pairs of bounds.
    bounds = np.stack([first + 1, last], axis=1).reshape(-1)
    padded = np.concatenate([scan.jerk, np.zeros((dim, 2))], axis=1)
    whole = np.maximum.reduceat(padded, bounds, axis=1)[:, ::2].T
    largest = np.where((last > first + 1)[:, None], whole, 0.0)
    share = np.linspace(0.0, 1.0, density)
    for some in chunks(t.size, 2 * density):
        for span in (first[some], last[some]):
            i = motion.interval[span]
            window = (t[some] + reach * np.array([[-1.0], [1.0]]) - motion.law.start[i]) / motion.law.h[i]
            lower, upper = np.clip(window, motion.lower[span], motion.upper[span])[:, :, None]
            x = np.where(share == 1.0, upper, lower + (upper - lower) * share)
            values, slack = motion.measure(span, x)
            height = peaks(np.maximum(np.abs(values[-dim:]) - slack[-dim:], 0.0))[0].T
            largest[some] = np.maximum(largest[some], height)
    return largest


def check_corners(motion: Motion, scan: Scan, limits: Limits, rows: Rows) -> None:
    """At a corner the plan must stand still, with no acceleration on either side of axes that have a jerk limit.

    Where the path turns back on itself and no stop is demanded, an acceleration may go on: the one before and the one after
    must be the same.
    """
    dim = motion.curve.dim
    corners = [b.u for b in motion.curve.breaks if b.is_corner]
    turns = [b.u for b in motion.curve.breaks if b.is_corner and b.angle > _TURNED_BACK]
    before = np.flatnonzero(np.isin(motion.u_ends[1, :-1], corners))
    if before.size == 0:
        return
    span = np.concatenate([before, before + 1])
    x = np.concatenate([motion.upper[before], motion.lower[before + 1]])
    measured = motion.measure(span, x[:, None])[0][..., 0]
    values = [measured[axis_rows(dim, k)] for k in range(2)]
    at = motion.u_ends[1, before]
    goes_on = np.isin(at, turns) & ~np.isin(at, motion.curve.demanded_stops)
    first, second = values[1][:, : before.size], values[1][:, before.size :]
    values = [np.abs(values[0]), np.abs(np.where(np.tile(goes_on, 2), np.tile(second - first, 2), values[1]))]
    linear = np.array(motion.curve.axis_units) == "mm"
    velocity = np.where(linear, np.minimum(limits.velocity, limits.feed), limits.velocity)
    for name, k, allowed, share, power in (
        ("exact stop", 0, velocity, VELOCITY_STEP, "/s"),
        ("acceleration at an exact stop", 1, limits.acceleration, _ACCELERATION_STEP, "/s^2"),
    ):
        # Without a limit, what the plan does elsewhere is the measure.
        own = group_sizes(motion.curve, scan.largest[axis_rows(dim, k)])
        slack = share * np.where(np.isfinite(allowed), allowed, own)
        used = np.divide(values[k], slack[:, None], out=np.zeros_like(values[k]), where=slack[:, None] > 0.0)
        if k == 1:
            used[np.isinf(limits.jerk)] = 0.0  # an axis without a jerk limit may leave a stop at full acceleration
        j, where = (int(index) for index in np.unravel_index(used.argmax(), used.shape))
        place = (float(motion.time(span[[where]], x[[where]])[0]), float(motion.u_ends[1, before[where % before.size]]))
        worst = 0.0 if used[j, where] == 0.0 else values[k][j, where]
        rows.add(name, worst, 0.0, place, slack=slack[j], unit=motion.curve.axis_units[j] + power)
