"""What a greedy run made: its points, what is known at each of them, and the limits that it breaks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from interp.literature import greedy_layout as k
from interp.literature.greedy_published import DEFECTS, printed_count
from interp.literature.greedy_setup import GreedyMode, GreedySetup, Variant
from planner.compiled import core
from planner.errors import InputError
from planner.geometry.chord import half_chord
from planner.machine.feed_limits import FeedrateLimits
from planner.samples import Samples
from planner.types import FloatArray

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
    mode: GreedyMode
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


def finish(job: GreedySetup, share: FloatArray, driving: FloatArray) -> GreedyRun:
    """From the parameters in [0, 1] to everything that is reported."""
    share = np.minimum(share, 1.0)
    table = np.empty((share.size, k.COLUMNS))
    before = np.concatenate([[job.setting(k.FLOOR)], driving]) if job.physical else None
    rest = job.limits.velocity, job.limits.acceleration, job.settings, table
    core.greedy_along(*job.own, share.size, share, before, *rest)
    seen = table[:, k.ERROR].copy()
    if job.error is not job.own:
        core.greedy_chord_errors(*job.error, share.size, share, seen)
    four = _four_limits(job, table, seen)
    feed, actual, start = _feeds(job, table, four.lowest, driving)
    bound = table[:, k.PUBLISHED_BOUND]
    published, remark = (None, "") if job.physical else printed_count(job.curve, job.limits, job.algorithm)
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


def _samples(job: GreedySetup, share: FloatArray, end_feed: float) -> Samples:
    u0, u1 = job.curve.domain
    u = np.clip(u0 + (u1 - u0) * share, u0, u1)
    u[-1] = u1
    times = job.limits.period * np.arange(u.size, dtype=np.float64)
    return Samples(job.limits.period, times, u, job.curve.derivatives(u, 0)[0], end_feed, end_feed, job.curve.axes)


def _feeds(
    job: GreedySetup, table: FloatArray, limit: FloatArray, driving: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Planned feedrate, that which the steps make, and that before the first step."""
    if job.physical:
        feed = np.append(driving, driving[-1])
        return feed, feed, job.setting(k.FLOOR)
    actual = np.append(table[:-1, k.LENGTH] / job.limits.period, 0.0)
    planned = limit * table[:, k.SHAPE]
    if job.setting(k.PLANNED_FEED) > 0.0:
        planned = np.maximum(planned, np.minimum(limit, job.setting(k.FLOOR)))
    return planned, actual, 0.0


def _four_limits(job: GreedySetup, table: FloatArray, seen: FloatArray) -> FeedrateLimits:
    """The four feedrate limits; limit 3 from the tolerance, or from the error of the step before as published."""
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


def _defects(job: GreedySetup) -> tuple[str, ...]:
    found = [name for name, (argument, published, _) in DEFECTS.items() if job.repaired[argument] == published]
    return tuple(name for name in found if name != "wrong second derivatives" or job.setting(k.WRONG_BEND) > 0.0)


def _rows(job: GreedySetup, run: GreedyRun) -> tuple[Violation, ...]:
    """Compare every step with the four limits."""
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
