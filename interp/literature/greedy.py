"""Algorithms 1-4 of the 2022 thesis: greedy interpolators that choose one step after the other.

    1  second-order Taylor step, S-curves at both ends
    2  and the feedrate below its limit: cases A (faster), B (slower), C (as it is)
    3  and the step backed off until the chord error is within its tolerance
    4  and the step pushed up again until the chord error has reached it

W. R. W. Yusoff, "A realtime and parallel look-ahead control and feedrate compensation strategy for CNC reference-pulse
interpolation", Universiti Malaysia Pahang, 2022.

*Mode compat* is the program behind the published numbers of points.  Four defects of it decide these numbers, each of
them an argument of :func:`greedy` that repairs it:

    error_curve         the chord error is computed on the teardrop, whichever curve runs
    step_feed           the command feedrate drives the step; what is planned is only drawn
    taylor              the second term of the step has |C''| in place of C'.C''/|C'|, and no feedrate rate
    second_derivatives  three terms of the butterfly's C'' are wrong, in the step and in the bounds of the acceleration

*Mode physical* is what the text describes: the planned feedrate drives the step, the chord error is the curve's own and
the tolerance stands in limit 3.  Neither mode looks ahead; what that breaks is counted and located in the result.

Known limitation: the S-curves are functions of u and never reach 0 in a finite time, so a feed of ``min_feed`` enters
and leaves the path in mode physical.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from math import isfinite
from typing import TYPE_CHECKING, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError, StalledError
from planner.geometry.catalog import read_curve
from planner.geometry.chord import half_chord
from planner.geometry.curve import Curve
from planner.inputs import positive_number
from planner.machine.feed_limits import FeedrateLimits
from planner.machine.limits import Limits, require_limits
from planner.profile import Samples
from planner.quantity import JERK
from planner.types import FloatArray, Progress

if TYPE_CHECKING:
    from types import ModuleType

Mode = Literal["compat", "physical"]
ErrorCurve = Literal["teardrop", "own"]
Variant = Literal["theta", "root"]
StepFeed = Literal["command", "planned"]
Formula = Literal["published", "exact"]
Braking = Literal["strict", "soft"]
Path = tuple[FloatArray, FloatArray, bool]  # breaks in [0, 1], coefficients, rational: see ``greedy_kernels``

PUBLISHED_COUNTS: Mapping[str, tuple[int, int, int, int]] = {
    "teardrop": (5096, 9204, 7599, 7344),
    "hypotrochoid": (3443, 9545, 7347, 7344),
    "snailshell": (706, 14601, 7351, 7346),
    "butterfly": (1800, 10875, 7348, 7345),
}
"""Numbers of points as printed, Algorithms 1 to 4, for the limits of :data:`PUBLISHED_LIMITS`."""

PUBLISHED_LIMITS = {"feed": 20.0, "velocity": 30.0, "acceleration": 30.0, "jerk": 200.0, "chord_error": 1e-6}
"""mm/s, mm/s, mm/s^2, mm/s^3, mm; the period is 1 ms.  The jerk is printed in mm/s^2."""

_MISPRINT = (
    "printed 9204 with a difference to Algorithm 3 of 1805; the program makes 9294 points (two digits swapped), and "
    "1805 fits neither 9204 - 7599 = 1605, of which the printed 17 % is made, nor 9294 - 7599 = 1695"
)
_REMARKS = {
    1: "printed with the start point counted",
    4: "the print is within 2 of the loop, whose last push-up decides",
}

# Each defect of the published program: the argument, its value in the program, and repaired.
DEFECTS: Mapping[str, tuple[str, str, str]] = {
    "chord error on the wrong curve": ("error_curve", "teardrop", "own"),
    "command feedrate in the step": ("step_feed", "command", "planned"),
    "wrong Taylor term": ("taylor", "published", "exact"),
    "wrong second derivatives": ("second_derivatives", "published", "exact"),
}

_CHUNK = 1 << 16  # passes between two looks at the number of steps
_SLOW_CHUNK = 2048  # of the published back-off, thousands of trials a pass: some 50 ms
_SCAN_POINTS = 1000
_SINGULAR = 1e-12  # of the largest |C'|
_NEAR_CUSP = 5e-3  # of it: what is slower counts as the cause of a stall
_SAME_CURVE = 1e-9
_COMPARED_POINTS = 33
# Shares by which a value may pass its limit as rounding of the loop.
_ROUNDING = {"feed": 1e-9, "chord error": 1e-7, "acceleration": 1e-6, "jerk": 1e-6}


@dataclass(frozen=True, eq=False)
class Violation:
    """One limit of a run: how often it is broken, and where worst.

    Attributes
    ----------
    limit, unit : str
        "feed" (mm/s), "chord error" (mm), "acceleration" (mm/s^2, tangential) or "jerk" (mm/s^3, tangential).
    count : int
        Steps that break it.
    worst, allowed : float
        The value farthest beyond its limit, or nearest to it where nothing is broken, and the limit there.
    u, t : float
        Curve parameter and time, s, of that step's start.
    index : int
        Sample of that step's start.
    indices : (count,) int array
        Samples of all steps that break it.
    """

    limit: str
    unit: str
    count: int
    worst: float
    allowed: float
    u: float
    t: float
    index: int
    indices: NDArray[np.intp]

    def __str__(self) -> str:
        return (
            f"{self.limit}: {self.count} steps beyond the limit, worst {self.worst:.6g} {self.unit} where "
            f"{self.allowed:.6g} is allowed, at u = {self.u:.6g}, t = {self.t:.6g} s, sample {self.index}"
        )


@dataclass(frozen=True, eq=False)
class GreedyRun:
    """The points of one run and what is known at each of them.

    An entry k of an array of shape (m,) belongs to sample k and, where it says so, to the step from k to k + 1.

    Attributes
    ----------
    samples : Samples
        One point a period; the first and the last are the ends of the curve.
    algorithm : int
    mode, variant : str
    defects : tuple of str
        Those of :data:`DEFECTS` that were on; for the second derivatives only where the curve is the butterfly.
    n : int
        Number of points as the thesis counts them: with the start for Algorithm 1, without it for the others.
    published : int or None
        The number printed for this curve, algorithm and limits, if there is one.
    remark : str
        Where that number errs, or how it was counted.
    feed : (m,) array
        Planned feedrate, mm/s.
    actual_feed : (m,) array
        Feedrate that the step makes, mm/s; in mode compat chord over period, and 0 behind the last step.
    limit : (m,) array
        Lowest feedrate limit, mm/s.
    limits : FeedrateLimits
        The four of them.  In mode compat limit 3 is made of the chord error of the step before, as published: it measures
        and limits nothing.  inf where the algorithm has none.
    chord_error : (m,) array
        Distance between the step's chord and the curve, mm; 0 in the last entry.
    controlled_error : (m,) array
        The same on the curve that the algorithm looked at, the teardrop or its own.
    acceleration : (m,) array
        Change of the actual feed over the period, mm/s^2.  Mode compat starts and ends at rest, mode physical at
        ``min_feed``.
    acceleration_range : (m, 2) array
        Least and largest tangential acceleration that keep every axis within its own, mm/s^2.
    reported_acceleration : (m,) array
        The column of the published program: change of the planned feed over the period, clipped to bounds of its own.
    rows : tuple of Violation
        Feed, chord error, acceleration, jerk; in mode compat those of the actual feed.
    """

    samples: Samples
    algorithm: int
    mode: Mode
    variant: Variant
    defects: tuple[str, ...]
    n: int
    published: int | None
    remark: str
    feed: FloatArray
    actual_feed: FloatArray
    limit: FloatArray
    limits: FeedrateLimits
    chord_error: FloatArray
    controlled_error: FloatArray
    acceleration: FloatArray
    acceleration_range: FloatArray
    reported_acceleration: FloatArray
    rows: tuple[Violation, ...] = ()

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def u(self) -> FloatArray:
        """Curve parameter of every sample, both ends included."""
        return self.samples.u

    @property
    def duration(self) -> float:
        """Number of steps times the period, s."""
        return float(self.samples.t[-1])

    @property
    def violations(self) -> tuple[Violation, ...]:
        """The rows whose limit is broken."""
        return tuple(row for row in self.rows if row.count > 0)

    def row(self, limit: str) -> Violation:
        """Return the row of a limit: "feed", "chord error", "acceleration" or "jerk"."""
        for row in self.rows:
            if row.limit == limit:
                return row
        raise InputError(f"limit = {limit!r} must be one of {', '.join(row.limit for row in self.rows)}")


def greedy(
    curve: Curve,
    limits: Limits,
    algorithm: int,
    *,
    mode: Mode = "compat",
    error_curve: ErrorCurve | None = None,
    variant: Variant = "theta",
    step_feed: StepFeed | None = None,
    taylor: Formula | None = None,
    second_derivatives: Formula | None = None,
    braking: Braking = "strict",
    safety: float = 0.18,
    u_rise: float = 0.10,
    u_fall: float = 0.95,
    min_feed: float = 0.5,
    max_steps: int = 1_000_000,
    progress: Progress | None = None,
) -> GreedyRun:
    """Interpolate a curve by one of the four algorithms.

    With v = |C'|, both with respect to u, and V the feedrate that drives the step,

        du = T V/v - (T V)^2/2 C'.C''/v^4             exact
        du = |T F/v - (T F)^2/2 |C''|/v^3|            as published

    and then, until the chord error is within its tolerance, du *= theta with theta = 0.9, 0.8, ... in Algorithm 2
    (mode compat only) and 0.999999, 0.999998, ... from Algorithm 3 on; Algorithm 4 multiplies by 1 + 1e-7, 1 + 2e-7, ...
    while the error is below 0.999 of the tolerance.  ``variant="root"`` solves for the largest step within the tolerance
    instead, in Algorithms 2 to 4, to 1e-6 of it.  In mode physical the factors are 0.999 and 1.001, and a step grows up
    to limits 1, 2 and 4 at most, outside the S-curves.

    The S-curves of the feedrate, over the parameter mapped to [0, 1], are s(3u/u_rise) and 1 - s(3(u-u_fall)/(1-u_fall))
    with s(z) = (1 + exp(-5z))^-8.  (The final thesis prints the falling one without its brackets.)

    Parameters
    ----------
    curve : Curve
        Of linear axes.
    limits : Limits
        The planned feedrate changes by the smaller of the tangential and the axes' jerks.
    algorithm : int
        1 to 4.
    mode : {"compat", "physical"}
    error_curve : {"teardrop", "own"}, optional
        Curve that the chord error is computed on; teardrop in mode compat, own in mode physical.
    variant : {"theta", "root"}
    step_feed : {"command", "planned"}, optional
        What drives the step; command in mode compat, planned in mode physical.  Planned in mode compat is the S-curve
        times the limit, without cases A to C.
    taylor, second_derivatives : {"published", "exact"}, optional
        Published in mode compat, exact in mode physical.  The second derivatives differ on the butterfly alone.
    braking : {"strict", "soft"}
        Case B in mode physical: go to the limit at once, whatever acceleration that takes, or brake within acceleration
        and jerk, however long the feed is above its limit.
    safety : float
        lambda of limit 4, in (0, 1].
    u_rise, u_fall : float
        End of the rising and start of the falling S-curve, of the range of u mapped to [0, 1].
    min_feed : float
        Feedrate below which nothing is planned where the limits allow it, mm/s.
    max_steps : int
        More are refused.
    progress : callable, optional
        Called now and then with a message and the share of the curve that is done.

    Returns
    -------
    GreedyRun

    Raises
    ------
    InputError
        If an argument is not one of those above, or the limits do not fit the curve.
    StalledError
        If the steps stop advancing, or there are more than ``max_steps``: the message names u, the cause and a remedy.
    """
    limits = require_limits(curve, limits)
    if curve.tip is not curve:
        raise InputError(f"{curve.name} moves rotary axes; the algorithms of 2022 know linear axes only")
    job = _job(
        curve, limits, algorithm, mode, variant,
        {"error_curve": error_curve, "step_feed": step_feed, "taylor": taylor, "second_derivatives": second_derivatives},
        braking, (safety, u_rise, u_fall, min_feed), max_steps,
    )  # fmt: skip
    u, driving = _advance(job, progress)
    return _finish(job, u, driving)


@dataclass(frozen=True, eq=False)
class _GreedySetup:
    """A run as compiled code wants it."""

    curve: Curve
    limits: Limits
    algorithm: int
    mode: Mode
    variant: Variant
    repaired: Mapping[str, str]  # value of each argument of DEFECTS
    max_steps: int
    settings: FloatArray
    own: Path
    error: Path
    top_speed: float

    @property
    def physical(self) -> bool:
        return self.mode == "physical"

    def setting(self, index: int) -> float:
        return float(self.settings[index])


def _kernels() -> ModuleType:
    from interp.literature import greedy_kernels

    return greedy_kernels


def _job(
    curve: Curve,
    limits: Limits,
    algorithm: int,
    mode: Mode,
    variant: Variant,
    switches: Mapping[str, str | None],
    braking: Braking,
    shape: tuple[float, float, float, float],
    max_steps: int,
) -> _GreedySetup:
    if algorithm not in (1, 2, 3, 4) or isinstance(algorithm, bool):
        raise InputError(f"algorithm = {algorithm!r} must be 1, 2, 3 or 4")
    _require_choice("mode", mode, ("compat", "physical"))
    _require_choice("variant", variant, ("theta", "root"))
    _require_choice("braking", braking, ("strict", "soft"))
    physical = mode == "physical"
    chosen = _switches(switches, physical)
    safety, u_rise, u_fall, min_feed = _shape(*shape)
    count = _step_count(max_steps)
    if not isfinite(limits.feed):
        raise InputError("feed = inf must be finite: these algorithms start from a commanded feedrate")
    if not physical and algorithm >= 2 and not isfinite(limits.chord_error):
        raise InputError(f"chord_error = inf must be finite for Algorithm {algorithm}, which holds the chord error")
    k = _kernels()
    first = np.linalg.norm(curve.derivatives(np.linspace(*curve.domain, _SCAN_POINTS), 1)[1], axis=-1)
    top_speed = float(first.max()) * (curve.domain[1] - curve.domain[0])
    settings = np.zeros(k.SETTINGS)
    settings[k.PERIOD], settings[k.FEED], settings[k.TOLERANCE] = limits.period, limits.feed, limits.chord_error
    settings[k.SAFETY], settings[k.RISE], settings[k.FALL], settings[k.FLOOR] = safety, u_rise, u_fall, min_feed
    settings[k.JERK] = float(limits.of_motions(JERK.order).min())
    settings[k.ALGORITHM], settings[k.ROOT] = algorithm, variant == "root"
    settings[k.EXACT_TAYLOR], settings[k.PLANNED_FEED] = chosen["taylor"] == "exact", chosen["step_feed"] == "planned"
    if chosen["second_derivatives"] == "published":
        settings[k.WRONG_BEND] = _scale_of(curve, "butterfly")
    settings[k.SOFT], settings[k.SINGULAR_SPEED] = braking == "soft", _SINGULAR * top_speed
    own = _path(curve)
    error = own if chosen["error_curve"] == "own" else _teardrop()
    return _GreedySetup(curve, limits, algorithm, mode, variant, chosen, count, settings, own, error, top_speed)


def _require_choice(name: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"{name} = {value!r} must be {' or '.join(repr(choice) for choice in allowed)}")


def _switches(given: Mapping[str, str | None], physical: bool) -> dict[str, str]:
    """Fill in what a mode means; mode physical has no defects to switch on."""
    chosen = {}
    for name, published, repaired in DEFECTS.values():
        value = given[name]
        if value is not None:
            _require_choice(name, value, (published, repaired))
        if physical and value == published:
            raise InputError(f'{name} = {value!r} is a defect of mode "compat"; mode "physical" has {repaired!r}')
        chosen[name] = value or (repaired if physical else published)
    return chosen


def _shape(safety: float, u_rise: float, u_fall: float, min_feed: float) -> tuple[float, float, float, float]:
    factor, rise = positive_number(safety, "safety"), positive_number(u_rise, "u_rise")
    fall, floor = positive_number(u_fall, "u_fall"), positive_number(min_feed, "min_feed")
    if factor > 1.0:
        raise InputError(f"safety = {factor!r} must lie in (0, 1]")
    if rise >= 1.0 or fall >= 1.0:
        raise InputError(f"u_rise = {rise!r} and u_fall = {fall!r} must lie in (0, 1), shares of the range of u")
    if not isfinite(floor):
        raise InputError("min_feed = inf must be finite, a feedrate in mm/s")
    return factor, rise, fall, floor


def _step_count(max_steps: int) -> int:
    try:
        count = operator.index(max_steps)
    except TypeError:
        count = 0
    if count < 1:
        raise InputError(f"max_steps = {max_steps!r} must be a whole number > 0")
    return count


def _path(curve: Curve) -> Path:
    """The curve's pieces over [0, 1]."""
    pieces = curve.pieces
    u0, u1 = curve.domain
    breaks = (pieces.breaks - u0) / (u1 - u0)
    breaks[0], breaks[-1] = 0.0, 1.0
    return breaks, pieces.powers, pieces.rational


def _teardrop() -> Path:
    """The teardrop as its own polynomials, which is exact, and fast where a back-off takes thousands of trials."""
    x, y, one = [0.0, -150.0, 450.0, -300.0], [0.0, -150.0, 150.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    return np.array([0.0, 1.0]), np.array([[x, y, one]]), False


@cache
def _catalog_curve(name: str) -> Curve:
    return read_curve(name)


def _scale_of(curve: Curve, name: str) -> float:
    """Factor by which the curve is a scaled copy of a catalog curve, point by point; 0 where it is none."""
    model = _catalog_curve(name)
    if curve.dim != model.dim:
        return 0.0
    share = np.linspace(0.0, 1.0, _COMPARED_POINTS)[1:-1]
    points, expected = (c.derivatives(c.domain[0] + share * (c.domain[1] - c.domain[0]), 0)[0] for c in (curve, model))
    scale = float(np.sum(points * expected) / np.sum(expected**2))
    same = scale > 0.0 and np.abs(points - scale * expected).max() <= _SAME_CURVE * np.abs(points).max()
    return scale if same else 0.0


def _advance(job: _GreedySetup, progress: Progress | None) -> tuple[FloatArray, FloatArray]:
    """Run the loop to the end of the curve: parameters in [0, 1] of all points, and the feed of every step."""
    k = _kernels()
    size = _SLOW_CHUNK if job.variant == "theta" and job.algorithm >= 3 else _CHUNK
    state = np.zeros(k.STATE)
    state[k.PLANNED] = job.setting(k.FLOOR)
    parts, feeds, count, code = [np.zeros(1)], [np.empty(0)], 0, k.RUNNING
    while code == k.RUNNING:
        u, feed = np.empty(min(size, job.max_steps - count)), np.empty(min(size, job.max_steps - count))
        arrays = (job.limits.velocity, job.limits.acceleration, job.settings, state, u, feed)
        code = k.physical_run(*job.own, *arrays) if job.physical else k.compat_run(*job.own, *job.error, *arrays)
        done = int(state[k.COUNT])
        parts.append(u[:done])
        feeds.append(feed[:done])
        count += done
        if code not in (k.RUNNING, k.DONE) or (code == k.RUNNING and count >= job.max_steps):
            _stall(job, code, state, count)
        if progress is not None:
            progress(f"Algorithm {job.algorithm}, {job.curve.name}: {count} points", min(float(state[k.U]), 1.0))
    return np.concatenate(parts), np.concatenate(feeds)


def _stall(job: _GreedySetup, code: int, state: FloatArray, count: int) -> NoReturn:
    """Raise StalledError with the place, the cause and a remedy."""
    k = _kernels()
    u0, u1 = job.curve.domain
    u, du, speed = (float(state[i]) for i in (k.U, k.DU, k.SPEED))
    span = u1 - u0
    way = job.limits.feed * job.limits.period
    smaller = "scale the curve up, or lower feed or period"
    if code == k.RUNNING:
        cause = f"max_steps = {job.max_steps} points are not enough; raise max_steps, or use a longer period"
    elif code == k.SINGULAR or not speed > _NEAR_CUSP * job.top_speed:
        cause = (
            f"|C'| = {speed / span:.3g} against {job.top_speed / span:.3g} elsewhere: a cusp, where a step of the "
            "parameter has no length; split the curve there, or give it a parametrisation with |C'| > 0"
        )
    elif code == k.BACK_OFF:
        cause = (
            f"back-off exhausted at theta = {state[k.THETA]:.3g}: the curve is too small for a step F T = {way:.3g} mm "
            f'within a chord error of {job.limits.chord_error:.3g} mm; {smaller}, or use variant="root"'
        )
    elif code == k.TOO_LONG:
        why = f"the curve is too small for a step F T = {way:.3g} mm; {smaller}"
        if job.algorithm == 4:
            why += ', or, where the curve is straight and nothing stops the push-up, use mode="physical"'
        cause = f"a step of {du:.3g} exceeds 0.1 of the range; {why}"
    elif code == k.NO_ADVANCE:
        cause = (
            f"steps of {du:.3g} of the range no longer advance: the second term of the Taylor step cancels the first, as "
            f"the curve is too small for a step F T = {way:.3g} mm; {smaller}"
        )
    else:
        cause = f"the Taylor step is {du:.3g}: its second term outweighs the first; {smaller}"
    raise StalledError(
        f"Algorithm {job.algorithm} stopped on {job.curve.name} at u = {u0 + span * min(u, 1.0):.9g}, step {count}: {cause}"
    )


def _finish(job: _GreedySetup, share: FloatArray, driving: FloatArray) -> GreedyRun:
    """From the parameters in [0, 1] to everything that is reported."""
    k = _kernels()
    share = np.minimum(share, 1.0)
    table = np.empty((share.size, k.COLUMNS))
    before = np.concatenate([[job.setting(k.FLOOR)], driving]) if job.physical else np.empty(0)
    k.along(*job.own, share, before, job.limits.velocity, job.limits.acceleration, job.settings, table)
    seen = table[:, k.ERROR].copy()
    if job.error is not job.own:
        k.chord_errors(*job.error, share, seen)
    four = _four_limits(job, table, seen)
    feed, actual, start = _feeds(job, table, four.lowest, driving)
    bound = table[:, k.PUBLISHED_BOUND]
    published, remark = _published(job)
    run = GreedyRun(
        samples=_samples(job, share, start),
        algorithm=job.algorithm,
        mode=job.mode,
        variant=job.variant,
        defects=_defects(job),
        n=share.size if job.algorithm == 1 else share.size - 1,
        published=published,
        remark=remark,
        feed=feed,
        actual_feed=actual,
        limit=four.lowest,
        limits=four,
        chord_error=table[:, k.ERROR].copy(),
        controlled_error=seen,
        acceleration=np.diff(actual, prepend=start) / job.limits.period,
        acceleration_range=table[:, [k.LOWEST, k.HIGHEST]],
        reported_acceleration=np.clip(np.diff(feed, prepend=feed[0]) / job.limits.period, -bound, bound),
    )
    return replace(run, rows=_rows(job, run))


def _samples(job: _GreedySetup, share: FloatArray, end_feed: float) -> Samples:
    u0, u1 = job.curve.domain
    u = np.clip(u0 + (u1 - u0) * share, u0, u1)
    u[-1] = u1
    times = job.limits.period * np.arange(u.size, dtype=np.float64)
    return Samples(job.limits.period, times, u, job.curve.derivatives(u, 0)[0], end_feed, end_feed, job.curve.axes)


def _feeds(
    job: _GreedySetup, table: FloatArray, limit: FloatArray, driving: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Planned feedrate, that which the steps make, and that before the first step."""
    k = _kernels()
    if job.physical:
        feed = np.append(driving, driving[-1])
        return feed, feed, job.setting(k.FLOOR)
    actual = np.append(table[:-1, k.LENGTH] / job.limits.period, 0.0)
    planned = limit * table[:, k.SHAPE]
    if job.setting(k.PLANNED_FEED) > 0.0:
        planned = np.maximum(planned, np.minimum(limit, job.setting(k.FLOOR)))
    return planned, actual, 0.0


def _four_limits(job: _GreedySetup, table: FloatArray, seen: FloatArray) -> FeedrateLimits:
    """The four feedrate limits; limit 3 from the tolerance, or from the error of the step before as published."""
    k = _kernels()
    count = table.shape[0]
    planned = job.setting(k.PLANNED_FEED) > 0.0
    if not planned:
        error = np.append(np.inf, seen[:-1])
    else:
        error = np.full(count, job.limits.chord_error if job.algorithm >= 3 else np.inf)
    third = 2.0 / job.limits.period * half_chord(table[:, k.CURVATURE], error)
    third = np.where(np.isfinite(error), third, np.inf)
    return FeedrateLimits(
        np.full(count, job.limits.feed), table[:, k.AXIS_LIMIT].copy(), third, table[:, k.NORMAL_LIMIT].copy()
    )


def _defects(job: _GreedySetup) -> tuple[str, ...]:
    k = _kernels()
    found = [name for name, (argument, published, _) in DEFECTS.items() if job.repaired[argument] == published]
    return tuple(name for name in found if name != "wrong second derivatives" or job.setting(k.WRONG_BEND) > 0.0)


def _published(job: _GreedySetup) -> tuple[int | None, str]:
    """The printed number of points of this curve under these limits, and what to know about it."""
    given = (job.limits.feed, job.limits.chord_error, job.limits.period)
    if job.physical or given != (PUBLISHED_LIMITS["feed"], PUBLISHED_LIMITS["chord_error"], 1e-3):
        return None, ""
    for name, counts in PUBLISHED_COUNTS.items():
        if abs(_scale_of(job.curve, name) - 1.0) <= _SAME_CURVE:
            remark = _MISPRINT if (name, job.algorithm) in {("teardrop", 2), ("teardrop", 3)} else ""
            return counts[job.algorithm - 1], remark or _REMARKS.get(job.algorithm, "")
    return None, ""


def _rows(job: _GreedySetup, run: GreedyRun) -> tuple[Violation, ...]:
    """Compare every step with the four limits."""
    k = _kernels()
    limits, period = job.limits, job.limits.period
    # Limit 3 as published is the feed itself and cannot be broken; what Algorithm 4 pushes up is beyond it on purpose,
    # up to the chord error, which has a row of its own.
    four, lowest = run.limits, run.limit
    if job.setting(k.PLANNED_FEED) == 0.0 or job.algorithm == 4:
        lowest = np.minimum(np.minimum(four.command, four.axis_velocity), four.normal_acceleration)
    low, high = run.acceleration_range[:, 0], run.acceleration_range[:, 1]
    nearer = np.where(run.acceleration - high >= low - run.acceleration, high, low)
    jerk = np.diff(run.acceleration, prepend=0.0) / period
    most = np.copysign(job.setting(k.JERK), jerk)
    tolerance = np.full(run.u.size, limits.chord_error)
    # The machine comes to rest behind the last step of mode compat, so that the last sample counts there.
    last = -1 if job.physical else run.u.size
    # Rounding of the positions, where the feed is measured from them.
    blur = 0.0 if job.physical else 8.0 * np.finfo(np.float64).eps * float(np.abs(run.samples.position).max())
    feed, chord = run.actual_feed[:-1], run.chord_error[:-1]
    acceleration = run.acceleration[:last]
    over = np.maximum(acceleration - high[:last], low[:last] - acceleration)
    return (
        _row(run, "feed", "mm/s", (feed, lowest, feed - lowest[:-1]), blur / period),
        _row(run, "chord error", "mm", (chord, tolerance, chord - limits.chord_error), 0.0),
        _row(run, "acceleration", "mm/s^2", (acceleration, nearer, over), 2.0 * blur / period**2),
        _row(run, "jerk", "mm/s^3", (jerk, most, np.abs(jerk[:last]) - job.setting(k.JERK)), 4.0 * blur / period**3),
    )


def _row(
    run: GreedyRun, limit: str, unit: str, columns: tuple[FloatArray, FloatArray, FloatArray], blur: float
) -> Violation:
    """Count and locate, from the value, what is allowed, and how far the value is beyond that."""
    value, allowed, excess = columns
    worst = int(np.argmax(excess))
    found = np.flatnonzero(excess > 0.0)  # rarely many: what is rounding is looked at for these alone
    found = found[excess[found] > _ROUNDING[limit] * np.abs(allowed[found]) + blur]
    found.setflags(write=False)
    u, t = float(run.samples.u[worst]), float(run.samples.t[worst])
    return Violation(limit, unit, found.size, float(value[worst]), float(allowed[worst]), u, t, worst, found)
