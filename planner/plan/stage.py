"""A grid of a section with its constraints, one solve on it, and what the next one is to be: finer, tighter or slower."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.errors import InfeasibleError, SolverError
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.plan.collocation import points_of
from planner.plan.ends import Feed, feed_at
from planner.plan.guess import FeedGuess, least_times
from planner.plan.rows import Constraints, build
from planner.plan.section import Section
from planner.plan.sensitivity import SpeedBound, saved_by_one_percent
from planner.plan.solvers import interior as optimal
from planner.plan.solvers.interior import Solution, Waypoint
from planner.plan.speed_law import SpeedLaw
from planner.plan.switches import jerk_changes
from planner.plan.time_knots import ROUNDING_SHARE, JerkChanges, TimeGrid
from planner.plan.time_map import TimeMap
from planner.plan.utilisation import Utilisation
from planner.status import Status, Work
from planner.types import FloatArray, IntArray, Progress

_MIN_GUESS = 1e-6
# Points inside an interval: one, but three where a path has blends, each of which few intervals have to pass, where room is
# left that no measurement between the points enforces, and where a plan with one is far off between them.  Elsewhere three
# are no nearer to the optimum than one in as much computing time.
_INNER, MORE_INNER = 1, 3
# sum(s l) at the start as a share of the time, from a guess and from a law.
_FROM_GUESS, _FROM_LAW = 0.05, 0.03
_NODES = 2  # of the time law, an interval at least
# Beyond the first the grid is too coarse somewhere, and is halved wherever it is beyond the last; below, tightening the
# limits locally is enough.  Where the number of intervals is given, only what is beyond the second is refined.
TOO_COARSE, HOPELESS, COARSE = 1.01, 1.05, 1.002
# A slowing down by more than this is said, and so much is not accepted while the grid may still be refined.
WORTH_SAYING = 1.001
TIGHTENING_ROUNDS = 5
_PROGRESS = 0.99  # of the slowing down, from round to round: less than that is none
_MARGIN_STEP = 2e-5
# Of the excess of an interval, by which its limits are tightened, and of that in the first and second interval beside it, by
# the points inside one.  Between midpoints a plan takes back more than between three points.
_GAIN, _BESIDE = {1: 1.5, 3: 1.0}, {1: (0.7, 0.35), 3: (0.5, 0.25)}
_PRESCRIBED_MARGIN = 2e-6
_CONTINUED_GAIN = 2.0
# From the third round on by so many times more each time: few places are left then, and a round costs a solve of all.
_GAIN_GROWTH = 2.0
# An interior point needs room above a feed that is prescribed at its limit.
_PRESCRIBED_ROOM = 1e-9
# How the speed is held where chords are too far from the path, and the length of intervals there in periods.
_CHORD_POWER, _MIN_HOLD, _MAX_HOLD, _CHORD_SPACING = 0.56, 1.001, 3.0, 0.25


@dataclass(frozen=True, eq=False)
class Task:
    """A section, and how it is to be solved; ``inner``: points inside an interval, at least."""

    section: Section
    limits: Limits
    guess: FeedGuess
    method: str
    periodic: bool
    deadline: float
    progress: Progress | None
    inner: int = _INNER

    @property
    def prescribed(self) -> bool:
        """A feed is prescribed at one of the ends."""
        return self.section.has_prescribed_feed

    def points_inside(self, on: TimeMap) -> int:
        """How many points inside an interval a plan on this map needs."""
        more = on.has_native or bool(self.section.reserve)
        return MORE_INNER if more and self.method == "optimal" else self.inner


def _margins(shares: Sequence[FloatArray], full: NDArray[np.bool_], inner: int, gain: float) -> tuple[FloatArray, ...]:
    """By how much to tighten speed, acceleration and jerk limits at each point where a plan used too much of them.

    ``shares``: of each, used in every interval (n - 1,); ``full``: those that are not empty; ``inner``: points in one;
    ``gain``: times the excess.
    """
    margins = []
    for share in shares:
        own = np.maximum(share[full] - 1.0, 0.0)
        own[own > 0.0] = gain * own[own > 0.0] * (1.0 + _MARGIN_STEP) + _MARGIN_STEP
        most = own.copy()
        for away, part in enumerate(_BESIDE[inner], start=1):
            most[away:] = np.maximum(most[away:], part * own[:-away])
            most[:-away] = np.maximum(most[:-away], part * own[away:])
        excess = np.ones(share.size)
        excess[full] += most
        at = np.ones((inner + 1) * excess.size + 1)
        at[:-1] = np.repeat(excess, inner + 1)
        at[inner + 1 :: inner + 1] = np.maximum(at[inner + 1 :: inner + 1], excess)
        margins.append(at)
    return tuple(margins)


def _tightened(
    problem: Constraints, speed: FloatArray | float, acceleration: FloatArray | float, jerk: FloatArray | float
) -> Constraints:
    """Divide the limits by these margins, at all points or at each; a prescribed feed stays attainable."""
    cap = problem.cap / speed**2
    for value, at in ((problem.start, 0), (problem.end, -1)):
        if not np.isnan(value):
            cap[at] = max(cap[at], value * (1.0 + _PRESCRIBED_ROOM))
    return replace(
        problem,
        cap=cap,
        acceleration=problem.acceleration.times(acceleration),
        jerk=problem.jerk.times(jerk),
    )


@dataclass(frozen=True, eq=False)
class Attempt:
    """What one solve gave: the law over the time of the map, where the next solve may begin, and what is said of it.

    ``saved``: time that one percent more of each limit saves, s, where the solver tells.
    """

    map: TimeMap
    speed_law: SpeedLaw
    waypoint: Waypoint | None
    status: Status
    work: Work
    saved: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Holds:
    """Stretches of sigma on which the speed is held below what the limits allow: ``lo``, ``hi`` and the largest x, (k,)."""

    lo: FloatArray
    hi: FloatArray
    x: FloatArray

    def caps(self, sigma: FloatArray) -> FloatArray:
        """Largest x at increasing sigma, inf where it is not held."""
        out = np.full(sigma.size, np.inf)
        first, last = np.searchsorted(sigma, self.lo, side="left"), np.searchsorted(sigma, self.hi, side="right")
        for i, j, x in zip(first, last, self.x, strict=True):
            out[i:j] = np.minimum(out[i:j], x)
        return out

    def with_more(self, lo: FloatArray, hi: FloatArray, x: FloatArray) -> Holds:
        """These and more."""
        return Holds(*(np.concatenate(pair) for pair in ((self.lo, lo), (self.hi, hi), (self.x, x))))


NO_HOLDS = Holds(np.empty(0), np.empty(0), np.empty(0))


@dataclass(frozen=True, eq=False)
class Stage:
    """A grid with its constraints, tightened where a plan on it used too much, and where it is held slow.

    ``counts (m,)``: nodes of the time law to each interval that is not empty.
    """

    grid: TimeGrid
    problem: Constraints
    counts: IntArray
    speed: SpeedBound
    holds: Holds

    @classmethod
    def on(cls, task: Task, grid: TimeGrid, holds: Holds = NO_HOLDS, *, inner: int | None = None) -> Stage:
        """Build the constraints on a grid, with ``inner`` points in an interval, or as many as the plan needs."""
        inner = task.points_inside(grid.map) if inner is None else inner
        problem, speeds = build(task.limits, grid, periodic=task.periodic, inner=inner)
        speed = SpeedBound.of(task.limits, speeds)
        if task.prescribed:
            problem = _tightened(problem, *[1.0 + _PRESCRIBED_MARGIN] * 3)
        if task.section.reserve:
            u = grid.map.along(points_of(grid.sigma, inner), np.repeat(grid.macro, inner + 1)[:-inner])[0]
            problem = _tightened(problem, *[1.0 / task.section.usable(u)] * 3)
        if holds.x.size:
            problem = replace(problem, cap=np.minimum(problem.cap, holds.caps(points_of(grid.sigma, inner))))
        return cls(grid, problem, _node_counts(task, grid), speed, holds)

    def begun_anyhow(self) -> Stage:
        """The same without what is prescribed at the start."""
        return replace(self, problem=replace(self.problem, start=np.nan, start_slope=np.nan))

    @cached_property
    def _full(self) -> NDArray[np.bool_]:
        """Intervals (n - 1,) that are not empty."""
        return np.diff(self.grid.sigma) > 0.0

    @cached_property
    def _starts(self) -> tuple[IntArray, NDArray[np.bool_]]:
        """Where the values between the nodes of the time law begin that belong to one interval, and which of these are full.

        The two nodes of a break have nothing between them: such values come after those of the macro that ends there.
        """
        at_breaks = self.grid.at_breaks[:-1]
        before = np.append(0, np.cumsum(at_breaks))
        starts = np.cumsum(self.counts) - self.counts + before[self.grid.macro[:-1][self._full]]
        nodes = np.cumsum(self.counts)[np.searchsorted(np.flatnonzero(self._full), self.grid.left[:-1]) - 1]
        gaps = nodes[at_breaks] + np.arange(np.count_nonzero(at_breaks))
        every = np.concatenate([starts, gaps])
        order = np.argsort(every, kind="stable")
        return every[order], order < starts.size

    def by_interval(self, values: FloatArray) -> FloatArray:
        """Largest value in each interval of the grid, 0 for empty ones, from those between the nodes of the time law."""
        starts, full = self._starts
        out = np.zeros(self._full.size)
        out[self._full] = np.maximum.reduceat(values, starts)[full]
        return out

    def time_law(self, attempt: Attempt) -> TimeLaw:
        """The law of an attempt on this grid."""
        return attempt.speed_law.time_law(self.grid, self.counts)

    def knot_times(self, law: TimeLaw) -> FloatArray:
        """When the law of an attempt on this grid passes its knots, (n,), s."""
        steps = np.zeros(self._full.size)
        starts, full = self._starts
        steps[self._full] = np.add.reduceat(np.diff(law.t), starts)[full]
        return np.minimum(np.concatenate([[0.0], np.cumsum(steps)]), law.t[-1])

    def jerk_changes(self, attempt: Attempt, law: TimeLaw) -> JerkChanges:
        """Where the jerk of an attempt on this grid changes, given its law."""
        of, scale = attempt.speed_law, self.problem.length_unit
        states = np.stack([of.x, of.a * scale, of.c * scale**2])
        return jerk_changes(self.problem, states, self.knot_times(law))

    def solve(self, task: Task, before: Attempt | None, tolerance: float | None = None) -> Attempt:
        """Solve, from the way to a law on the same grid where there is one, else from the law that the map is of."""
        problem = self.problem
        if before is not None and before.map is self.grid.map:
            floor = _MIN_GUESS * float(before.speed_law.x.min())
            problem = replace(problem, guess=np.maximum(before.speed_law.at(self.grid.sigma), floor))
        waypoint = before.waypoint if before else None
        try:
            solution = _run(task, problem, waypoint, before is not None, tolerance)
            if before is not None and solution.status.stalled:
                # A coarse law that fits the finer grid badly is a worse start than none; where it stalled it is feasible.
                with suppress(SolverError):
                    again = _run(task, self.problem, None, False, tolerance)
                    solution = again if again.time < solution.time else solution
        except SolverError as error:
            if not task.prescribed:
                raise SolverError(_not_found(task.section, error)) from None
            raise InfeasibleError(_not_attainable(task.section, error)) from None
        scale = problem.length_unit
        law = SpeedLaw(self.grid.sigma, solution.x, solution.a / scale, solution.c / scale**2)
        return Attempt(
            self.grid.map, law, solution.waypoint, solution.status, self._work(solution), self._saved(task, solution)
        )

    def _work(self, solution: Solution) -> Work:
        optimum = solution.status is Status.OPTIMAL
        return Work(
            intervals=self.grid.intervals,
            iterations=solution.iterations,
            solve_cpu_s=solution.cpu_s,
            gap=solution.gap,
            residual=solution.residual,
            proven_global=optimum and solution.iterate is not None and optimal.is_global(solution.iterate),
        )

    def _saved(self, task: Task, solution: Solution) -> Mapping[str, float]:
        if solution.iterate is None:
            return {}
        saved = saved_by_one_percent(solution.iterate, self.speed)
        return {name: value * self.problem.time_unit for name, value in saved.items()}

    def next(
        self,
        task: Task,
        attempt: Attempt,
        used: Utilisation,
        *,
        may_split: bool,
        number: int = 0,
        before: float = np.inf,
    ) -> tuple[Stage, Attempt]:
        """Refine the grid or tighten the limits where an attempt used too much; and what the next one begins with.

        Where an interval is as short as nodes may be, or refining did not help before, the speed is held there instead.
        """
        slowdown = self.by_interval(used.slowdown)
        coarse = (used.slowdown > COARSE) | (used.backward > 0.0)
        tolerated = HOPELESS if float(used.slowdown.max()) < _PROGRESS * before else WORTH_SAYING
        halved = self.by_interval(coarse.astype(np.float64)) > 0.0
        stuck = (slowdown > tolerated) & (not task.prescribed)
        if halved.any() or stuck.any():
            fixed = self._shortest(task, attempt) | (number > TIGHTENING_ROUNDS)
            halved, stuck = halved & ~fixed, stuck & fixed
        may_split &= bool(halved.any())
        if may_split or stuck.any():
            # What a quintic of a few digits is off by goes with the sixth power of the speed: the root is enough of much.
            by = np.minimum(slowdown, np.sqrt(2.0 * slowdown))
            grid, holds = self.grid.split(halved) if may_split else self.grid, self._held(attempt, by, stuck)
            return self._renewed(task, attempt, grid, holds), replace(attempt, waypoint=None)
        # A plan that continues another one, and cannot be slowed down as a whole, is tightened by more: what that costs is
        # little against its reserve.
        gain = _CONTINUED_GAIN if task.prescribed and task.section.reserve else _GAIN[self.problem.inner]
        gain *= _GAIN_GROWTH ** max(0, number - 1)
        shares = [self.by_interval(share) for share in (used.speed, used.acceleration, used.jerk)]
        tighter = replace(
            self, problem=_tightened(self.problem, *_margins(shares, self._full, self.problem.inner, gain))
        )
        goes_on = not task.prescribed or task.section.continues
        return tighter, attempt if goes_on else replace(attempt, waypoint=None)

    def slower(
        self, task: Task, attempt: Attempt, used: Utilisation, knots: FloatArray, times: FloatArray, shares: FloatArray
    ) -> tuple[Stage, Attempt]:
        """Hold the speed where chords are too far from the path, by their ``shares`` of the limit at the ``times``.

        ``knots``: times of the knots.
        """
        middle = 0.5 * (knots[1:] + knots[:-1])
        i = np.clip(np.searchsorted(times, middle), 1, times.size - 1)
        share = np.maximum(shares[i], shares[i - 1])
        over = (share > 1.0) & (np.diff(self.grid.sigma) > 0.0)
        by = np.clip(share**_CHORD_POWER, _MIN_HOLD, _MAX_HOLD)
        coarse = self.by_interval(used.slowdown) > TOO_COARSE
        halved = over & (np.diff(knots) > _CHORD_SPACING * task.limits.period) | coarse
        grid = self.grid.split(halved)
        return self._renewed(task, attempt, grid, self._held(attempt, by, over)), replace(attempt, waypoint=None)

    def _renewed(self, task: Task, attempt: Attempt, grid: TimeGrid, holds: Holds) -> Stage:
        """The stage of a finer grid, in the time of the attempt where that is a law; else in the time it has."""
        knots, of = self.grid.sigma, attempt.speed_law
        law = self.time_law(attempt)
        time = self.knot_times(law)
        try:
            # a knot in the middle of an interval is passed within it, at whatever time
            renewed = grid.renewed(law, np.interp(grid.sigma, *_increasing(knots, time)), periodic=task.periodic)
        except SolverError:
            return Stage.on(task, grid, holds)
        lo, hi = (np.interp(at, *_increasing(knots, time)) for at in (holds.lo, holds.hi))
        return Stage.on(task, renewed, Holds(lo, hi, holds.x / of.at(0.5 * (holds.lo + holds.hi))))

    def _held(self, attempt: Attempt, by: FloatArray, stuck: NDArray[np.bool_]) -> Holds:
        """Hold the speed in the intervals ``stuck`` below that of an attempt, by these factors."""
        sigma, x = self.grid.sigma, attempt.speed_law.x
        slower = np.maximum(x[1:], x[:-1])[stuck] / by[stuck] ** 2
        return self.holds.with_more(sigma[:-1][stuck], sigma[1:][stuck], slower)

    def _shortest(self, task: Task, attempt: Attempt) -> NDArray[np.bool_]:
        """Intervals (n - 1,) whose halves would be shorter than nodes may be apart."""
        guess, law = task.guess, attempt.speed_law
        u = self.grid.map.parameter(self.grid.macro, self.grid.distances(self.grid.sigma, self.grid.macro))[0]
        least = np.interp(0.5 * (u[1:] + u[:-1]), guess.u, least_times(guess))
        time = np.diff(self.grid.sigma) / np.sqrt(0.5 * (law.x[1:] + law.x[:-1]))
        return np.asarray(time < 4.0 * least)


def _run(
    task: Task, problem: Constraints, waypoint: Waypoint | None, has_law: bool, tolerance: float | None
) -> Solution:
    if task.method == "nlp":
        from planner.plan.solvers import ipopt as nlp

        return nlp.solve_nlp(problem)
    return optimal.solve_interior(
        problem,
        waypoint or optimal.start_from(problem, problem.guess),
        centring=_FROM_LAW if has_law else _FROM_GUESS,
        tolerance=tolerance,
        deadline=task.deadline,
        progress=task.progress,
    )


def _not_found(section: Section, error: SolverError) -> str:
    return (
        f"{section.curve.name}: no plan found between u = {section.u_start:.9g} and {section.u_end:.9g}: {error}; split the "
        "curve there, or ask for more intervals"
    )


def _not_attainable(section: Section, error: SolverError) -> str:
    length = float(np.diff(section.curve.arclength.s([section.u_start, section.u_end]))[0])
    given = section.start.acceleration if isinstance(section.start, Feed) else None
    continued = "" if given is None else f", start_acceleration = {given:g} mm/s^2,"
    return (
        f"no plan found from start_feed = {feed_at(section.start):g}{continued} to end_feed = "
        f"{feed_at(section.end):g} mm/s between u = {section.u_start:.6g} and {section.u_end:.6g} (length {length:.6g} "
        f"mm): {error}; a prescribed feed must be attainable under the limits, lower it"
    )


def _increasing(sigma: FloatArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Knots without the second of each double one."""
    once = np.append(True, np.diff(sigma) > 0.0)
    return sigma[once], time[once]


def _node_counts(task: Task, grid: TimeGrid) -> IntArray:
    """Nodes of the time law to each interval that is not empty, so that its quintics follow u over time."""
    full = np.flatnonzero(np.diff(grid.sigma) > 0.0)
    counts = np.full(full.size, _NODES, dtype=np.intp)
    piece = grid.map.piece[grid.macro[full]]
    on = np.flatnonzero(piece >= 0)
    if on.size:
        ends = (grid.distances(grid.sigma[k], grid.macro[k]) for k in (full[on], full[on] + 1))
        way = np.diff([grid.map.native(grid.macro[full[on]], d)[0] for d in ends], axis=0)[0]
        spacing = grid.map.section.curve.native_spacing(piece[on])
        time = np.diff(grid.sigma)[full[on]]
        least = np.interp(grid.map.u[grid.macro[full[on]]], task.guess.u, least_times(task.guess, ROUNDING_SHARE))
        allowed = np.divide(time, least, out=np.full(time.size, np.inf), where=least > 0.0)
        counts[on] = np.maximum(_NODES, np.minimum(np.ceil(way / spacing), allowed)).astype(np.intp)
    return counts
