"""Plan a feedrate: validate, cut at the stops, solve each section, refine, and hand over a profile.

A section is solved on a coarse grid, then on a grid of the wanted size that starts from the coarse solution.  The law is
then measured between its nodes.  Where it uses more than its limits, the intervals are halved and the limits tightened by
what was found, and the section is solved again; last, the whole section is slowed down by the little that is left
(time scaled by kappa divides velocities by kappa, accelerations by kappa^2, jerks by kappa^3).  What leaves here keeps
every limit everywhere, not only at the points at which a solver looked.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from planner.bounds import without_jerk
from planner.constraints import Constraints, Path, build
from planner.errors import InfeasibleError, InputError, SolverError
from planner.geometry.curve import Curve, FloatArray, arc_derivatives
from planner.grid import Grid, Scan, place_knots, scan, split, with_blends
from planner.law import SpeedLaw, TimeNodes, Utilisation, utilisation
from planner.limits import Limits, feedrate_limits
from planner.profile import FeedrateProfile, make_profile
from planner.sections import Section, cut
from planner.sensitivity import saved_by_one_percent
from planner.solvers import optimal
from planner.solvers.optimal import Solution

Method = Literal["optimal", "nlp", "toppra", "scurve"]
Progress = Callable[[str, float | None], None]

DEFAULT_INTERVALS = 1000
_COARSER = 4
_COARSE_GAP = 1e-2
_LEAST_GUESS = 1e-6
_MIN_INTERVALS = 24
_MAX_INTERVALS = 20_000_000
# A plan that needs more slowing down than this at the end is refined first.
_ACCEPTED_SLOWDOWN = 1.0002
# Beyond this the grid is too coarse there, and is refined; below, tightening the limits locally is enough.
_TOO_COARSE = 1.004
_MARGIN_STEP = 2e-5
_MAX_ROUNDS = 6
# Slowing down is measured at points; the peaks between them are higher by less than this.
_PEAK_MARGIN = 2e-6
_MET = 1.0 + 2e-8
_ALMOST_MET = 1.0 + 1e-6
_PRESCRIBED_MARGIN = 2e-6
# An interior point needs room above a feed that is prescribed at its limit.
_PRESCRIBED_ROOM = 1e-9


@dataclass(frozen=True, eq=False)
class SectionPlan:
    """A solved section: its time law and what the solver says of it."""

    nodes: TimeNodes
    lower_bound: float
    stats: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Margins:
    """By how much the limits are tightened at each collocation point, so that a plan keeps them between the points.

    ``speed``, ``acceleration``, ``jerk``: (2n - 1,) arrays >= 1.
    """

    speed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @classmethod
    def uniform(cls, grid: Grid, margin: float) -> Margins:
        """The same margin everywhere."""
        return cls(*np.full((3, 2 * grid.sigma.size - 1), margin))

    def raised(self, used: Utilisation, grid: Grid) -> Margins:
        """Raise the margins where a plan made with these ones used more than its limits."""
        raised = []
        for margin, share in ((self.speed, used.speed), (self.acceleration, used.acceleration), (self.jerk, used.jerk)):
            excess = _by_interval(share, grid)
            excess = np.where(excess > 1.0, excess * (1.0 + _MARGIN_STEP), 1.0)
            at = np.ones(margin.size)
            at[1::2] = excess
            at[2::2] = excess
            at[0:-1:2] = np.maximum(at[0:-1:2], excess)
            raised.append(margin * at)
        return Margins(*raised)

    def apply(self, problem: Constraints) -> Constraints:
        """Tighten the constraints; a prescribed feed stays attainable."""
        cap = problem.cap / self.speed**2
        for value, at in ((problem.start, 0), (problem.end, -1)):
            if not np.isnan(value):
                cap[at] = max(cap[at], value * (1.0 + _PRESCRIBED_ROOM))
        return replace(
            problem,
            cap=cap,
            acceleration=np.ascontiguousarray(problem.acceleration * self.acceleration),
            jerk=np.ascontiguousarray(problem.jerk * self.jerk),
        )


def plan_feedrate(
    curve: Curve,
    limits: Limits,
    *,
    method: Method = "optimal",
    start_feed: float = 0.0,
    end_feed: float = 0.0,
    periodic: bool = False,
    budget: float = np.inf,
    intervals: int | None = None,
    exact_stop: bool = False,
    progress: Progress | None = None,
) -> FeedrateProfile:
    """Find the feedrate profile that finishes the curve soonest within the limits.

    Parameters
    ----------
    curve : Curve
    limits : Limits
        One value for each axis of the curve.
    method : {"optimal", "nlp", "toppra", "scurve"}
        ``optimal``: the jerk-limited optimum by our interior-point method.  ``nlp``: the same problem by CasADi and
        IPOPT, the reference.  ``toppra``: without a jerk limit, a lower bound.  ``scurve``: jerk-limited S-curves
        between the feed minima, what industry does today.
    start_feed, end_feed : float
        Tip feed at the ends, mm/s; 0 is rest.
    periodic : bool
        The closed curve is run continuously: same feed and acceleration at both ends, free value.
    budget : float
        Computing time after which the best plan so far is returned, s (method ``optimal``).
    intervals : int, optional
        Number of intervals of the grid; refined as needed if left out.
    exact_stop : bool
        Stop at curvature discontinuities instead of passing them slowly.
    progress : callable, optional
        Called with a message and the share done (or None).

    Returns
    -------
    FeedrateProfile

    Raises
    ------
    InputError
        If an argument is not allowed.
    InfeasibleError
        If the limits and the prescribed feeds contradict each other.
    SolverError
        If no plan was found.
    """
    began = time.perf_counter()
    _validate(curve, limits, method, start_feed, end_feed, periodic, budget, intervals)
    sections = cut(curve, limits, start_feed, end_feed, exact_stop=exact_stop, periodic=periodic)
    if periodic and len(sections) > 1:
        raise InputError(
            f"periodic = True cannot pass the exact stop of {curve.name} at u = {sections[1].u_start:.6g}: let the curve "
            "begin there and plan it from stop to stop"
        )
    plans = []
    total = sum(section.u_end - section.u_start for section in sections)
    for i, section in enumerate(sections):
        if progress is not None:
            progress(f"section {i + 1} of {len(sections)}", (section.u_start - sections[0].u_start) / total)
        plans.append(_plan_section(section, limits, method, periodic, began + budget, intervals, progress))
    nodes = _chain([plan.nodes for plan in plans])
    stats = _collect(sections, plans, limits, exact_stop)
    stats["planning_s"] = time.perf_counter() - began
    return make_profile(
        curve,
        limits,
        (nodes.t, nodes.u, nodes.u_rate, nodes.u_acceleration),
        method=method,
        lower_bound=sum(plan.lower_bound for plan in plans),
        stats=stats,
    )


def _validate(
    curve: Curve,
    limits: Limits,
    method: str,
    start_feed: float,
    end_feed: float,
    periodic: bool,
    budget: float,
    intervals: int | None,
) -> None:
    limits.require_matches(curve)
    if method not in get_args(Method):
        raise InputError(f"method = {method!r} must be one of {', '.join(get_args(Method))}")
    if not budget > 0.0:
        raise InputError(f"budget = {budget!r} s must be > 0")
    if intervals is not None and not _MIN_INTERVALS <= intervals <= _MAX_INTERVALS:
        raise InputError(f"intervals = {intervals!r} must lie within [{_MIN_INTERVALS}, {_MAX_INTERVALS}]")
    if periodic:
        if method not in {"optimal", "nlp"}:
            raise InputError(f"periodic = True is planned by the methods optimal and nlp, not by {method!r}")
        if not (np.isfinite(limits.jerk).any() or np.isfinite(limits.tangential_jerk)):
            raise InputError("periodic = True needs a jerk limit; without one toppra plans from rest to rest")
        _require_closed(curve, start_feed, end_feed)
    for name, feed, u in (("start_feed", start_feed, curve.domain[0]), ("end_feed", end_feed, curve.domain[1])):
        if not (np.isfinite(feed) and feed >= 0.0):
            raise InputError(f"{name} = {feed!r} mm/s must be >= 0 and finite")
        if feed > 0.0:
            allowed = float(feedrate_limits(curve, limits, u).lowest)
            if feed > allowed:
                raise InfeasibleError(
                    f"{name} = {feed!r} mm/s is above the feed limit there, {allowed:.6g} mm/s (u = {u:.9g})"
                )


def _require_closed(curve: Curve, start_feed: float, end_feed: float) -> None:
    if start_feed or end_feed:
        raise InputError("periodic = True leaves the feed at the ends free; start_feed and end_feed must be 0")
    ends = [curve.derivatives(np.array([u]), 3)[:, 0] for u in curve.domain]
    gap = float(np.abs(ends[1][0] - ends[0][0]).max())
    size = float(np.abs(curve.derivatives(np.linspace(*curve.domain, 64), 0)[0] - ends[0][0]).max())
    if gap > 1e-9 * size:
        raise InputError(f"periodic = True needs a closed curve; the ends of {curve.name} are {gap:.3g} apart")
    directions = [end[1] / np.sqrt(np.sum(end[1] ** 2)) for end in ends]
    turn = float(np.abs(directions[1] - directions[0]).max())
    if turn > 1e-8:
        raise InputError(f"periodic = True needs a smooth seam; the tangent of {curve.name} turns by {turn:.3g} there")
    bends = [arc_derivatives(end[:, None])[2, 0] for end in ends]
    jump = float(np.abs(bends[1] - bends[0]).max())
    if jump > 1e-6 * max(float(np.abs(bends).max()), 1.0 / size):
        raise InputError(
            f"periodic = True needs a smooth seam; the curvature of {curve.name} jumps by {jump:.4g} 1/mm there: let the "
            "curve begin elsewhere"
        )


def _plan_section(
    section: Section,
    limits: Limits,
    method: str,
    periodic: bool,
    deadline: float,
    intervals: int | None,
    progress: Progress | None,
) -> SectionPlan:
    if method == "scurve":
        from planner.solvers.scurve import plan_section

        feeds = (section.start_feed or 0.0, section.end_feed or 0.0)
        nodes = TimeNodes(*plan_section(section.curve, limits, section.u_start, section.u_end, *feeds))
        return SectionPlan(nodes, np.nan, {"status": "feasible", "intervals": nodes.t.size - 1})
    if method == "toppra" or not (np.isfinite(limits.jerk).any() or np.isfinite(limits.tangential_jerk)):
        from planner.solvers.topp import plan_section as plan_without_jerk

        nodes, bound, stats = plan_without_jerk(section, limits, intervals or DEFAULT_INTERVALS)
        if not section.has_prescribed_feed:
            used = utilisation(section.curve, limits, nodes)
            slowdown = max(float(used.speed.max()), float(np.sqrt(used.acceleration.max())))
            nodes = nodes.dilated(max(1.0, slowdown * (1.0 + _PEAK_MARGIN)))
        return SectionPlan(nodes, bound, stats)
    return _solve_and_refine(section, limits, method, periodic, deadline, intervals, progress)


def _solve_and_refine(
    section: Section,
    limits: Limits,
    method: str,
    periodic: bool,
    deadline: float,
    intervals: int | None,
    progress: Progress | None,
) -> SectionPlan:
    wanted = intervals or DEFAULT_INTERVALS
    guess = scan(section, limits, wanted)
    section = with_blends(section, guess)
    task = _Task(section, limits, guess, method, periodic, deadline, progress)
    law: SpeedLaw | None = None
    spent = 0.0
    if method == "optimal":
        coarse = _Stage.on(task, place_knots(section, guess, max(_MIN_INTERVALS, wanted // _COARSER)))
        law, solution = coarse.solve(task, None, _COARSE_GAP)
        spent = solution.cpu_s
    stage = _Stage.on(task, place_knots(section, guess, wanted))
    best: SectionPlan | None = None
    for round_ in range(_MAX_ROUNDS):
        law, solution = stage.solve(task, law)
        spent += solution.cpu_s
        nodes = law.nodes(stage.path)
        used = utilisation(section.curve, limits, nodes)
        slowdown = float(used.slowdown.max())
        # A slower clock would change a prescribed feed; there the limits are tightened until they are met as they are.
        kappa = 1.0 if task.prescribed else max(1.0, slowdown * (1.0 + _PEAK_MARGIN))
        duration = kappa * float(nodes.t[-1])
        better = best is None or (slowdown < best.stats["slowdown"] if task.prescribed else duration < best.nodes.t[-1])
        if better:
            stats = {"status": solution.status, "iterations": solution.iterations, "gap": solution.gap}
            stats |= {"residual": solution.residual, "intervals": stage.grid.intervals, "slowdown": slowdown}
            stats |= {"rounds": round_ + 1, "solve_cpu_s": spent, "saved_by_one_percent": stage.worth(task, solution)}
            best = SectionPlan(nodes.dilated(kappa), np.nan, stats)
        accepted = slowdown <= (_MET if task.prescribed else _ACCEPTED_SLOWDOWN)
        if accepted or time.perf_counter() > deadline:
            break
        if slowdown > _TOO_COARSE and intervals is None:
            stage = _Stage.on(
                task, split(section, stage.grid, _by_interval(used.slowdown, stage.grid) > _ACCEPTED_SLOWDOWN)
            )
        else:
            stage = replace(stage, margins=stage.margins.raised(used, stage.grid))
    if best is None:
        raise SolverError("no round of refinement was run")
    if task.prescribed and best.stats["slowdown"] > _ALMOST_MET:
        raise SolverError(
            f"the plan from start_feed = {section.start_feed or 0.0:g} to end_feed = {section.end_feed or 0.0:g} mm/s "
            f"still exceeds its limits, {best.stats['slowdown']:.6g} times as fast as allowed; try other feeds or more "
            "intervals"
        )
    bound = without_jerk(section, limits, stage.grid)[1]
    best.stats["solve_cpu_s"] = spent
    return replace(best, lower_bound=min(bound, float(best.nodes.t[-1])))


@dataclass(frozen=True, eq=False)
class _Task:
    """A section and how it is to be solved."""

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


@dataclass(frozen=True, eq=False)
class _Stage:
    """A grid with its constraints and the margins they are given."""

    grid: Grid
    problem: Constraints
    path: Path
    margins: Margins

    @classmethod
    def on(cls, task: _Task, grid: Grid) -> _Stage:
        """Build the constraints on a grid."""
        problem, path = build(task.section, task.limits, grid, task.guess, periodic=task.periodic)
        return cls(grid, problem, path, Margins.uniform(grid, 1.0 + _PRESCRIBED_MARGIN if task.prescribed else 1.0))

    def solve(self, task: _Task, law: SpeedLaw | None, tolerance: float | None = None) -> tuple[SpeedLaw, Solution]:
        """Solve, from a previous law where there is one."""
        problem = self.margins.apply(self.problem)
        per_x = (problem.length_unit / problem.time_unit) ** 2
        if law is not None:
            floor = _LEAST_GUESS * float(law.x.min())
            problem = replace(problem, guess=np.maximum(law.at(self.grid.sigma), floor) / per_x)
        try:
            solution = _run(task, problem, law is not None, tolerance)
        except SolverError as error:
            if not task.prescribed:
                raise
            section = task.section
            length = float(np.diff(section.curve.arclength.s([section.u_start, section.u_end]))[0])
            raise InfeasibleError(
                f"no plan found from start_feed = {section.start_feed or 0.0:g} to end_feed = "
                f"{section.end_feed or 0.0:g} mm/s between u = {section.u_start:.6g} and {section.u_end:.6g} "
                f"(length {length:.6g} mm): {error}; a prescribed feed must be attainable under the limits, lower it"
            ) from None
        scale = problem.length_unit
        x, a, c = solution.x * per_x, solution.a * per_x / scale, solution.c * per_x / scale**2
        return SpeedLaw(self.grid.sigma, x, a, c), solution

    def worth(self, task: _Task, solution: Solution) -> dict[str, float]:
        """Seconds that one percent more of each limit would save."""
        if solution.iterate is None:
            return {}
        saved = saved_by_one_percent(solution.iterate, self.path, task.limits, task.section.curve.axes)
        return {name: value * self.problem.time_unit for name, value in saved.items()}


def _run(task: _Task, problem: Constraints, warm: bool, tolerance: float | None) -> Solution:
    if task.method == "nlp":
        from planner.solvers import nlp

        return nlp.solve(problem)
    return optimal.solve(
        problem,
        optimal.start_from(problem, problem.guess),
        centring=0.1 if warm else 1.0,
        tolerance=tolerance,
        deadline=task.deadline,
        progress=task.progress,
    )


def _by_interval(values: FloatArray, grid: Grid) -> FloatArray:
    """Largest value of the two halves of each solver interval; 0 for empty ones."""
    full = np.diff(grid.sigma) > 0.0
    out = np.zeros(full.size)
    # nodes: knot, midpoint, knot, ...; an empty interval has one entry, a full one two
    first = np.cumsum(np.where(full, 2, 1)) - np.where(full, 2, 1)
    out[full] = np.maximum(values[first[full]], values[first[full] + 1])
    return out


def _chain(parts: list[TimeNodes]) -> TimeNodes:
    """Join the sections; at a stop the last node of one and the first of the next form a double node."""
    offsets = np.concatenate([[0.0], np.cumsum([part.t[-1] for part in parts])])
    return TimeNodes(
        np.concatenate([part.t + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
        np.concatenate([part.u for part in parts]),
        np.concatenate([part.u_rate for part in parts]),
        np.concatenate([part.u_acceleration for part in parts]),
    )


def _collect(sections: list[Section], plans: list[SectionPlan], limits: Limits, exact_stop: bool) -> dict[str, Any]:
    """What the solver did, over all sections, and what a reader of the verdict should know of the path."""
    notes = [f"exact stop at u = {section.u_start:.6g}" for section in sections[1:]]
    for section in sections:
        notes += [
            f"curvature jumps by {b.curvature_jump:.4g} 1/mm at u = {b.u:.6g}: passed slowly, so that the samples at "
            f"{1e3 * limits.period:g} ms keep the jerk limit; exact_stop=True would stop there"
            for b in section.jumps
        ]
    if not (np.isfinite(limits.jerk).any() or np.isfinite(limits.tangential_jerk)):
        notes.append("no jerk limit is set: planned without one, by toppra")
    every = [plan.stats for plan in plans]
    status = next((s["status"] for s in every if s["status"] not in {"optimal", "feasible"}), every[0]["status"])
    stats: dict[str, Any] = {"status": status, "period": limits.period, "notes": notes, "sections": len(sections)}
    for key in ("iterations", "intervals", "solve_cpu_s"):
        stats[key] = sum(s.get(key, 0) for s in every)
    for key in ("gap", "residual", "rounds", "slowdown"):
        found = [s[key] for s in every if key in s]
        if found:
            stats[key] = max(found)
    stats |= {"exact_stop": exact_stop, "periodic": any(np.isnan(s.start_feed or 0.0) for s in sections)}
    saved: dict[str, float] = {}
    for s in every:
        for name, value in s.get("saved_by_one_percent", {}).items():
            saved[name] = saved.get(name, 0.0) + value
    if saved:
        stats["saved_by_one_percent"] = dict(sorted(saved.items(), key=lambda item: -item[1]))
    return stats
