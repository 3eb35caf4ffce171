"""Plan one section: solve on a coarse grid, then on the wanted one, and go on until the law keeps its limits everywhere.

A solver looks at knots and midpoints only.  Between them the law is measured (``law.py``), and what it uses too much is
given back in three ways, the first that serves:

1.  Where an interval is far too coarse it is halved; and where no limit binds, which is where the plan changes from one
    limit to another and an interval takes longer than that needs.
2.  Where it uses a little more than its limits, these are tightened there by as much, and in the two intervals on either
    side, where the plan would otherwise seek what it gives up.  The next solve begins where the last one came through
    (``Waypoint``) and takes half of its iterations; one such round leaves some 1e-5.
3.  What is left is slowed down uniformly: time scaled by kappa divides velocities by kappa, accelerations by kappa^2 and
    jerks by kappa^3.  A prescribed feed would change with it; there step 2 is repeated until the limits are met.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.bounds import section_bound
from planner.constraints import Constraints, Parameter, build
from planner.dual.problem import Pace
from planner.errors import InfeasibleError, SolverError
from planner.geometry.curve import FloatArray
from planner.grid import Grid, Scan, place_knots, resolvable, scan, split, with_blends
from planner.guard import require_finite
from planner.law import SpeedLaw, TimeNodes, Utilisation, utilisation
from planner.limits import Limits, command_kind
from planner.profile import BINDING_SHARE
from planner.sections import Section
from planner.sensitivity import SpeedBound, saved_by_one_percent
from planner.solvers import optimal
from planner.solvers.optimal import Solution, Waypoint

Progress = Callable[[str, float | None], None]

DEFAULT_INTERVALS = 1000
MIN_INTERVALS = 24
_LEAST_INTERVALS = 200  # of one section among several
_COARSER = 8
_COARSE_GAP = 1e-2
_LEAST_GUESS = 1e-6
# A plan that needs more slowing down than this at the end is refined first.
_ACCEPTED_SLOWDOWN = 1.000002
# Beyond the first the grid is too coarse somewhere, and is halved wherever it is beyond the last; below, tightening the
# limits locally is enough.  Where the number of intervals is given, only what is beyond the second is refined.
_TOO_COARSE, _HOPELESS, _COARSE = 1.0005, 1.05, 1.0001
# Where no limit binds for more than this share of the time, the grid is too coarse.
_UNBOUND = 0.03
# A slowing down by more than this is said, and so much is not accepted while the grid may still be refined.
WORTH_SAYING = 1.001
_MARGIN_STEP = 2e-5
_MARGIN_REACH = 2
_MAX_ROUNDS = 8
_IDLE_ROUNDS, _TIGHTENING_ROUNDS = 3, 5  # the last for idle intervals, and for tightening alone
# Slowing down is measured at points; the peaks between them are higher by less than this.
PEAK_MARGIN = 5e-7
_MET = 1.0 + 2e-8
_BACKWARD = 5e-10  # of the largest rate of u: slower than that is rounding
ALMOST_MET = 1.0 + 1e-6
_PRESCRIBED_MARGIN = 2e-6
_CONTINUED_GAIN = 2.0
# Nodes closer to a stop than this share of the domain of u are left out.
_ON_STOP = 2e-12
# An interior point needs room above a feed that is prescribed at its limit.
_PRESCRIBED_ROOM = 1e-9


@dataclass(frozen=True, eq=False)
class SectionPlan:
    """A solved section: its time law, a lower bound of its time, and what the solver says of it."""

    nodes: TimeNodes
    lower_bound: float
    stats: dict[str, Any]


@dataclass(frozen=True)
class Effort:
    """Number of intervals to begin with, and whether refinement may choose more."""

    intervals: int
    free: bool

    @classmethod
    def for_share(cls, intervals: int | None, share: float, section: Section) -> Effort:
        """For a section with this share of the path, given the number of intervals asked for, if any."""
        if intervals is None:
            least = DEFAULT_INTERVALS if share == 1.0 else _LEAST_INTERVALS
            needed = section.curve.intervals_needed(section.u_start, section.u_end)
            return cls(max(least, round(DEFAULT_INTERVALS * share), needed), True)
        return cls(max(MIN_INTERVALS, round(intervals * share)), False)


@dataclass(frozen=True, eq=False)
class Task:
    """A section with its rest blends, and how it is to be solved."""

    section: Section
    limits: Limits
    guess: Scan
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
        acceleration=np.ascontiguousarray(problem.acceleration * acceleration),
        jerk=np.ascontiguousarray(problem.jerk * jerk),
    )


@dataclass(frozen=True, eq=False)
class Attempt:
    """What one solve gave: the law, where the next solve may begin, and what is said of it.

    ``unbound (n - 1,)``: share of the time of each interval, knot - middle - knot, in which no limit binds.
    """

    law: SpeedLaw
    waypoint: Waypoint | None
    unbound: FloatArray
    stats: dict[str, Any]

    @property
    def idle(self) -> float:
        """Share of the time in which no limit binds."""
        time = np.diff(self.law.sigma) / np.sqrt(0.5 * (self.law.x[1:] + self.law.x[:-1]))
        return float(time @ self.unbound / time.sum())


@dataclass(frozen=True, eq=False)
class Stage:
    """A grid with its constraints, tightened where a plan on it used too much."""

    grid: Grid
    problem: Constraints
    path: Parameter
    speed: SpeedBound

    @classmethod
    def on(cls, task: Task, grid: Grid) -> Stage:
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
            begins, unused = (np.array(column) for column in zip(*task.section.reserve, strict=True))
            left = np.append(1.0, 1.0 - unused)[np.searchsorted(begins, path.u[0], side="right")]
            problem = _tightened(problem, *[1.0 / left] * 3)
        return cls(grid, problem, parameter, speed)

    def solve(self, task: Task, before: Attempt | None, tolerance: float | None = None) -> Attempt:
        """Solve, from a previous law or from the way to it where there is one."""
        problem = self.problem
        per_x = (problem.length_unit / problem.time_unit) ** 2
        if before is not None:
            floor = _LEAST_GUESS * float(before.law.x.min())
            problem = replace(problem, guess=np.maximum(before.law.at(self.grid.sigma), floor) / per_x)
        waypoint = before.waypoint if before else None
        try:
            solution = _run(task, problem, waypoint, before is not None, tolerance)
            if before is not None and solution.status.startswith("stalled"):
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
        return Attempt(SpeedLaw(self.grid.sigma, x, a, c), solution.waypoint, unbound, self._stats(task, solution))

    def _stats(self, task: Task, solution: Solution) -> dict[str, Any]:
        stats = {"status": solution.status, "iterations": solution.iterations, "gap": solution.gap}
        stats |= {"residual": solution.residual, "intervals": self.grid.intervals, "solve_cpu_s": solution.cpu_s}
        if solution.iterate is not None:
            saved = saved_by_one_percent(solution.iterate, self.speed, task.limits, task.section.curve.axes)
            stats["saved_by_one_percent"] = {name: value * self.problem.time_unit for name, value in saved.items()}
            stats["proven_global"] = solution.status == "optimal" and optimal.is_global(solution.iterate)
        return stats

    def next(self, task: Task, attempt: Attempt, used: Utilisation, *, may_split: bool) -> tuple[Stage, Attempt]:
        """Refine the grid or tighten the limits where an attempt used too much; and what the next one begins with."""
        if may_split:
            coarse = (used.slowdown > _COARSE) | (used.backward > 0.0)
            halved = (_by_interval(coarse.astype(np.float64), self.grid) > 0.0) | (attempt.unbound > 0.0)
            finer = split(task.section, self.grid, halved)
            return Stage.on(task, finer), replace(attempt, waypoint=None)
        # Tightening by the excess leaves up to half of it.  A plan that continues another one, and cannot be slowed down as
        # a whole, is tightened by more: what that costs is little against its reserve.
        gain = _CONTINUED_GAIN if task.prescribed and task.section.reserve else 1.0
        tighter = replace(self, problem=_tightened(self.problem, *_margins(used, self.grid, gain)))
        return tighter, replace(attempt, waypoint=None) if task.prescribed else attempt


def plan_section(
    section: Section,
    limits: Limits,
    *,
    method: str,
    periodic: bool,
    deadline: float,
    effort: Effort,
    progress: Progress | None,
) -> SectionPlan:
    """Plan one section by the method optimal or nlp, see the sketch above.

    Raises
    ------
    InfeasibleError
        If a prescribed feed is not attainable.
    SolverError
        If no plan was found, or none that keeps the limits with the feeds prescribed.
    """
    wanted = effort.intervals
    guess = scan(section, limits, wanted)
    most = resolvable(guess)
    notes = []
    if wanted > most:
        notes.append(
            f"{wanted} intervals asked for, {most} used: in a plan of {guess.duration:.3g} s closer nodes differ by "
            "little more than rounding"
        )
        wanted = most
    section = with_blends(section, guess)
    task = Task(section, limits, guess, method, periodic, deadline, progress)
    attempt = _coarse(task, max(MIN_INTERVALS, wanted // _COARSER)) if method == "optimal" else None
    stage = Stage.on(task, place_knots(section, guess, wanted))
    spent = attempt.stats["solve_cpu_s"] if attempt else 0.0
    first = 0.0
    best: Round | None = None
    for number in range(_MAX_ROUNDS):
        try:
            attempt = stage.solve(task, attempt)
            this = Round.of(task, number, attempt, stage.path)
        except (InfeasibleError, SolverError) as error:
            if best is None:
                raise
            notes.append(f"refinement ended after {number} rounds: {error}")
            break
        spent += attempt.stats["solve_cpu_s"]
        first = first or spent
        best = this if best is None or this.is_better_than(best, task) else best
        idle = effort.free and number < _IDLE_ROUNDS and attempt.idle > _UNBOUND
        if (this.is_accepted(task) and not idle) or time.perf_counter() > deadline:
            break
        may_split = stage.grid.intervals < most and (idle or this.is_too_coarse(effort))
        stage, attempt = stage.next(task, attempt, this.used, may_split=may_split)
    if best is None:
        raise SolverError("no round of refinement was run")
    _require_met(task, best)
    stats = {**best.stats, "notes": notes, "solve_cpu_s": spent, "first_solve_cpu_s": first}
    say_slowing_down(best.slowdown, best.place, stats)
    bound = section_bound(section, limits, wanted, Pace(best.nodes.u, best.nodes.t), periodic=periodic)
    return SectionPlan(best.nodes, bound, stats)


@dataclass(frozen=True, eq=False)
class Round:
    """What came out of one round: the law, slowed down until it keeps its limits, and how it was before.

    ``slowdown``: by which factor it was too fast; ``forward``: u falls back nowhere, but for rounding.
    """

    number: int
    nodes: TimeNodes
    used: Utilisation
    slowdown: float
    forward: bool
    stats: dict[str, Any]

    @classmethod
    def of(cls, task: Task, number: int, attempt: Attempt, path: Parameter) -> Round:
        """Measure an attempt between its nodes; a SolverError where it is not finite."""
        given = attempt.law.nodes(path)
        require_finite(task.section.curve, given)
        kept = _apart_from_stops(task.section, given)
        nodes = given if kept.size == given.t.size else given.only(kept)
        used = utilisation(task.section.curve, task.limits, nodes).spread(np.diff(kept))
        slowdown = float(used.slowdown.max())
        kappa = 1.0 if task.prescribed else max(1.0, slowdown * (1.0 + PEAK_MARGIN))
        forward = bool((used.backward <= _BACKWARD * float(np.abs(nodes.u_rate).max())).all())
        stats = {**attempt.stats, "slowdown": slowdown, "rounds": number + 1}
        return cls(number, nodes.dilated(kappa), used, slowdown, forward, stats)

    @property
    def place(self) -> float:
        """Parameter at which it uses most of its limits, but for the few nodes left out beside a stop."""
        return float(self.nodes.u[min(int(self.used.slowdown.argmax()), self.nodes.u.size - 1)])

    def is_better_than(self, other: Round, task: Task) -> bool:
        """Forward first; then sooner, or where nothing may be slowed down, closer to its limits."""
        if self.forward != other.forward:
            return self.forward
        if task.prescribed:
            return self.slowdown < other.slowdown
        return bool(self.nodes.t[-1] < other.nodes.t[-1])

    def is_accepted(self, task: Task) -> bool:
        """It keeps its limits as it is, or nearly so where it may be slowed down."""
        return self.forward and self.slowdown <= (_MET if task.prescribed else _ACCEPTED_SLOWDOWN)

    def is_too_coarse(self, effort: Effort) -> bool:
        """The grid should be refined rather than the limits tightened."""
        limit = _TOO_COARSE if effort.free else _HOPELESS
        return not self.forward or self.slowdown > (limit if self.number < _TIGHTENING_ROUNDS else WORTH_SAYING)


def _coarse(task: Task, intervals: int) -> Attempt | None:
    """Solve on a coarse grid; what is attainable may be out of its reach, and the fine one then begins without it."""
    with suppress(InfeasibleError):
        stage = Stage.on(task, place_knots(task.section, task.guess, intervals))
        return replace(stage.solve(task, None, _COARSE_GAP), waypoint=None)
    return None


def say_slowing_down(slowdown: float, place: float, stats: dict[str, Any]) -> None:
    """Say so, in status and notes, where a plan is a good deal slower than what was solved for."""
    if slowdown > WORTH_SAYING:
        percent = 100.0 * (slowdown - 1.0)
        if stats["status"] in {"optimal", "feasible"}:
            stats["status"] = f"slowed down by {percent:.2g} %"
        stats["notes"].append(
            f"slowed down as a whole by {percent:.2g} %, for what the plan would use of its limits at u = "
            f"{place:.6g}: refining the grid there did not help"
        )


def _require_met(task: Task, best: Round) -> None:
    """Refuse a plan that exceeds its limits and cannot be slowed down, since its feeds are prescribed."""
    if task.prescribed and best.slowdown > ALMOST_MET:
        raise SolverError(not_met(task.section, best.slowdown))


def not_met(section: Section, slowdown: float) -> str:
    """Say that a plan with prescribed feeds exceeds its limits."""
    return (
        f"the plan from start_feed = {section.start_feed or 0.0:g} to end_feed = {section.end_feed or 0.0:g} mm/s "
        f"still exceeds its limits, {slowdown:.9g} times as fast as allowed; try other feeds or more intervals"
    )


def _run(
    task: Task, problem: Constraints, waypoint: Waypoint | None, has_law: bool, tolerance: float | None
) -> Solution:
    if task.method == "nlp":
        from planner.solvers import nlp

        return nlp.solve(problem)
    return optimal.solve(
        problem,
        waypoint or optimal.start_from(problem, problem.guess),
        centring=0.1 if has_law else 1.0,
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
    return (
        f"no plan found from start_feed = {section.start_feed or 0.0:g} to end_feed = {section.end_feed or 0.0:g} mm/s "
        f"between u = {section.u_start:.6g} and {section.u_end:.6g} (length {length:.6g} mm): {error}; a prescribed feed "
        "must be attainable under the limits, lower it"
    )


def _apart_from_stops(section: Section, nodes: TimeNodes) -> NDArray[np.intp]:
    """Nodes that are not a stop but for rounding: who reads a table takes what is so close to a stop for the stop."""
    inside = np.ones(nodes.t.size, dtype=np.bool_)
    least = _ON_STOP * (section.curve.domain[1] - section.curve.domain[0])
    if section.start_feed is None:
        inside[1:-1] &= nodes.u[1:-1] - section.u_start > least
    if section.end_feed is None:
        inside[1:-1] &= section.u_end - nodes.u[1:-1] > least
    return np.flatnonzero(inside)


def _by_interval(values: FloatArray, grid: Grid) -> FloatArray:
    """Largest value of the two halves of each solver interval; 0 for empty ones."""
    full = np.diff(grid.sigma) > 0.0
    out = np.zeros(full.size)
    # nodes: knot, midpoint, knot, ...; an empty interval has one entry, a full one two
    first = np.cumsum(np.where(full, 2, 1)) - np.where(full, 2, 1)
    out[full] = np.maximum(values[first[full]], values[first[full] + 1])
    return out
