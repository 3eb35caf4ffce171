"""A grid of a section with its constraints, one solve on it, and what the next one is to be: finer, tighter or slower."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import InfeasibleError, SolverError
from planner.machine.feed_limits import command_kind
from planner.machine.limits import Limits
from planner.plan.ends import Feed, feed_at
from planner.plan.guess import FeedGuess, least_times
from planner.plan.knots import Grid, split
from planner.plan.rows import Constraints, Parameter, build
from planner.plan.section import Section
from planner.plan.sensitivity import SpeedBound, saved_by_one_percent
from planner.plan.solvers import interior as optimal
from planner.plan.solvers.interior import Solution, Waypoint
from planner.plan.speed_law import SpeedLaw
from planner.plan.utilisation import Utilisation
from planner.profile import BINDING_SHARE
from planner.status import Status, Work
from planner.types import FloatArray, Progress

_MIN_GUESS = 1e-6
# Beyond the first the grid is too coarse somewhere, and is halved wherever it is beyond the last; below, tightening the
# limits locally is enough.  Where the number of intervals is given, only what is beyond the second is refined.
TOO_COARSE, HOPELESS, COARSE = 1.0005, 1.05, 1.0001
# A slowing down by more than this is said, and so much is not accepted while the grid may still be refined.
WORTH_SAYING = 1.001
TIGHTENING_ROUNDS = 5
_PROGRESS = 0.99  # of the slowing down, from round to round: less than that is none
_MARGIN_STEP = 2e-5
_MARGIN_REACH = 2
_PRESCRIBED_MARGIN = 2e-6
_CONTINUED_GAIN = 2.0
# An interior point needs room above a feed that is prescribed at its limit.
_PRESCRIBED_ROOM = 1e-9
# How the speed is held where chords are too far from the path, and the length of intervals there in periods.
_CHORD_POWER, _MIN_HOLD, _MAX_HOLD, _CHORD_SPACING = 0.6, 1.001, 3.0, 0.25


@dataclass(frozen=True, eq=False)
class Task:
    """A section with its rest blends, and how it is to be solved."""

    section: Section
    limits: Limits
    guess: FeedGuess
    method: str
    periodic: bool
    deadline: float
    progress: Progress | None

    @property
    def prescribed(self) -> bool:
        """A feed is prescribed at one of the ends."""
        return self.section.has_prescribed_feed


def _margins(used: Utilisation, grid: Grid, gain: float) -> tuple[FloatArray, ...]:
    """By how much to tighten speed, acceleration and jerk limits at each point where a plan used too much of them.

    ``gain``: times the excess.
    """
    margins = []
    for share in (used.speed, used.acceleration, used.jerk):
        excess = _by_interval(share, grid)
        excess = np.where(excess > 1.0, (1.0 + gain * (excess - 1.0)) * (1.0 + _MARGIN_STEP), 1.0)
        # What a plan gives up in one interval it would seek in the next ones, so these are tightened with it.
        for _ in range(_MARGIN_REACH):
            excess[1:] = np.maximum(excess[1:], excess[:-1])
            excess[:-1] = np.maximum(excess[:-1], excess[1:])
        at = np.ones(2 * grid.sigma.size - 1)
        at[1::2] = excess
        at[2::2] = excess
        at[0:-1:2] = np.maximum(at[0:-1:2], excess)
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
    """What one solve gave: the law, where the next solve may begin, and what is said of it.

    ``unbound (n - 1,)``: share of the time of each interval, knot - middle - knot, in which no limit binds.  ``saved``: time
    that one percent more of each limit saves, s, where the solver tells.
    """

    speed_law: SpeedLaw
    waypoint: Waypoint | None
    unbound: FloatArray
    status: Status
    work: Work
    saved: Mapping[str, float]

    @property
    def idle(self) -> float:
        """Share of the time in which no limit binds."""
        time = np.diff(self.speed_law.sigma) / np.sqrt(0.5 * (self.speed_law.x[1:] + self.speed_law.x[:-1]))
        return float(time @ self.unbound / time.sum())


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
    """A grid with its constraints, tightened where a plan on it used too much, and where it is held slow."""

    grid: Grid
    problem: Constraints
    path: Parameter
    speed: SpeedBound
    holds: Holds

    @classmethod
    def on(cls, task: Task, grid: Grid, holds: Holds = NO_HOLDS) -> Stage:
        """Build the constraints on a grid."""
        problem, path = build(task.section, task.limits, grid, task.guess, periodic=task.periodic)
        # of the path only what is needed from here on: a long one has no memory to spare
        parameter = Parameter(path.u, path.rounding)
        beyond = path.u[0] >= np.repeat(grid.stretch_end, 2)[:-1]
        command = command_kind(task.section.curve, task.limits, path.u[0], beyond)
        speed = SpeedBound.of(task.limits, path, problem, command)
        if task.prescribed:
            problem = _tightened(problem, *[1.0 + _PRESCRIBED_MARGIN] * 3)
        if task.section.reserve:
            problem = _tightened(problem, *[1.0 / task.section.usable(path.u[0])] * 3)
        if holds.x.size:
            middle = 0.5 * (grid.sigma[1:] + grid.sigma[:-1])
            points = np.insert(grid.sigma, np.arange(1, grid.sigma.size), middle)
            per_x = (problem.length_unit / problem.time_unit) ** 2
            problem = replace(problem, cap=np.minimum(problem.cap, holds.caps(points) / per_x))
        return cls(grid, problem, parameter, speed, holds)

    def solve(self, task: Task, before: Attempt | None, tolerance: float | None = None) -> Attempt:
        """Solve, from a previous law or from the way to it where there is one."""
        problem = self.problem
        per_x = (problem.length_unit / problem.time_unit) ** 2
        if before is not None:
            floor = _MIN_GUESS * float(before.speed_law.x.min())
            problem = replace(problem, guess=np.maximum(before.speed_law.at(self.grid.sigma), floor) / per_x)
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
        idle = self.problem.used(solution.x, solution.a, solution.c) < BINDING_SHARE
        unbound = (idle[:-2:2] + 4.0 * idle[1::2] + idle[2::2]) / 6.0
        scale = problem.length_unit
        x, a, c = solution.x * per_x, solution.a * per_x / scale, solution.c * per_x / scale**2
        law = SpeedLaw(self.grid.sigma, x, a, c)
        return Attempt(
            law, solution.waypoint, unbound, solution.status, self._work(solution), self._saved(task, solution)
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
        slowdown = _by_interval(used.slowdown, self.grid)
        fixed = self._shortest(task, attempt) | (number > TIGHTENING_ROUNDS)
        coarse = (used.slowdown > COARSE) | (used.backward > 0.0)
        halved = (_by_interval(coarse.astype(np.float64), self.grid) > 0.0) & ~fixed | (attempt.unbound > 0.0)
        tolerated = HOPELESS if float(used.slowdown.max()) < _PROGRESS * before else WORTH_SAYING
        stuck = (slowdown > tolerated) & fixed & (not task.prescribed)
        may_split &= bool(halved.any())
        if may_split or stuck.any():
            grid = split(task.section, self.grid, halved) if may_split else self.grid
            # What a quintic of a few digits is off by goes with the sixth power of the speed: the root is enough of much.
            by = np.minimum(slowdown, np.sqrt(2.0 * slowdown))
            return Stage.on(task, grid, self._held(attempt, by, stuck)), replace(attempt, waypoint=None)
        # Tightening by the excess leaves up to half of it.  A plan that continues another one, and cannot be slowed down as
        # a whole, is tightened by more: what that costs is little against its reserve.
        gain = _CONTINUED_GAIN if task.prescribed and task.section.reserve else 1.0
        tighter = replace(self, problem=_tightened(self.problem, *_margins(used, self.grid, gain)))
        return tighter, replace(attempt, waypoint=None) if task.prescribed else attempt

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
        coarse = _by_interval(used.slowdown, self.grid) > TOO_COARSE
        halved = over & (np.diff(knots) > _CHORD_SPACING * task.limits.period) | coarse
        holds = self._held(attempt, by, over)
        return Stage.on(task, split(task.section, self.grid, halved), holds), replace(attempt, waypoint=None)

    def _held(self, attempt: Attempt, by: FloatArray, stuck: NDArray[np.bool_]) -> Holds:
        """Hold the speed in the intervals ``stuck`` below that of an attempt, by these factors."""
        sigma, x = self.grid.sigma, attempt.speed_law.x
        slower = np.maximum(x[1:], x[:-1])[stuck] / by[stuck] ** 2
        return self.holds.with_more(sigma[:-1][stuck], sigma[1:][stuck], slower)

    def _shortest(self, task: Task, attempt: Attempt) -> NDArray[np.bool_]:
        """Intervals (n - 1,) whose halves would be shorter than nodes may be apart."""
        guess, law = task.guess, attempt.speed_law
        y = task.section.position(0.5 * (self.grid.sigma[1:] + self.grid.sigma[:-1]))
        least = np.interp(y, guess.y, least_times(guess))
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
        centring=0.1 if has_law else 0.2,
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


def _by_interval(values: FloatArray, grid: Grid) -> FloatArray:
    """Largest value of the two halves of each solver interval; 0 for empty ones."""
    full = np.diff(grid.sigma) > 0.0
    out = np.zeros(full.size)
    # nodes: knot, midpoint, knot, ...; an empty interval has one entry, a full one two
    first = np.cumsum(np.where(full, 2, 1)) - np.where(full, 2, 1)
    out[full] = np.maximum(values[first[full]], values[first[full] + 1])
    return out
