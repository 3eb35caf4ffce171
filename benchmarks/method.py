"""The numbers of docs/method.md: what each idea of the method is worth, measured.

    python -m benchmarks.method [--output numbers.json]

Takes the planner apart and runs its parts with one of them changed: narrower rest blends, collocation at the knots alone,
other grids, a start from nothing, no hoped-for gain in the centring, limits changed by 1 %.  Durations are those of the
solver's own time law, before any slowing down, unless a row says "slowed down".
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from benchmarks.cases import reference_cases
from feedplan.job import Job
from planner import load_curve, load_limits
from planner.geometry.curve import Curve
from planner.geometry.differential import chain_rule, jerk_terms
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.plan.bounds import certify, section_bound
from planner.plan.coarse import Effort, coarse_plan
from planner.plan.dual.method import best_multipliers
from planner.plan.dual.problem import Pace, best_splines, problem_of
from planner.plan.dual.terms import Track
from planner.plan.ends import REST, Feed
from planner.plan.guess import breaks_inside, guess_feed
from planner.plan.knots import place_knots, with_blends
from planner.plan.rest_map import BLEND_LENGTH
from planner.plan.rows import Constraints, build
from planner.plan.section import Section, cut
from planner.plan.solvers import interior as optimal
from planner.plan.solvers.interior import Iterate
from planner.plan.stage import Attempt, Stage, Task
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap
from planner.plan.utilisation import Utilisation, utilisation
from planner.types import FloatArray

INTERVALS = 1000
COARSER = 1  # the coarse grids have as many intervals, solved to wider gaps
_PER_GUESSED = 8
_MANY = 10**9
_COARSE_GAP = 1e-2
_FINE_GAP = 1e-7  # where durations are compared with one another
_WITHIN = 1.0 + 1e-9
_BLEND_SHARE = 0.6  # of the path of the start from rest
_STEPS = 400  # of the blend's cubic that are looked at


@dataclass(frozen=True, eq=False)
class Case:
    """A path with its limits, and the task a planner makes of it."""

    name: str
    curve: Curve
    limits: Limits
    task: Task

    @property
    def section(self) -> Section:
        """The path in its coordinate with rest blends."""
        return self.task.section


def case(name: str, intervals: int = INTERVALS, *, width: float = 1.0) -> Case:
    """Prepare one of the cases of ``benchmarks.cases``; its rest blends ``width`` times as wide as usual."""
    curve, limits = next((curve, limits) for label, curve, limits, _ in reference_cases() if label == name)
    return prepared(name, curve, limits, intervals, width=width)


def prepared(name: str, curve: Curve, limits: Limits, intervals: int = INTERVALS, *, width: float = 1.0) -> Case:
    """Prepare a path from rest to rest without stops inside."""
    (section,) = cut(curve, limits, exact_stop=False)
    guess = guess_feed(section, limits, intervals)
    section = with_blends(section, guess)
    section = replace(section, blend_start=width * section.blend_start, blend_end=width * section.blend_end)
    return Case(name, curve, limits, Task(section, limits, guess, "optimal", False, np.inf, None))


def stage(of: Case, intervals: int = INTERVALS) -> Stage:
    """The constraints on the usual grid, in the time of a coarser plan."""
    effort = Effort(intervals, free=False)
    return coarse_plan(of.task, effort, _MANY, follow=False).first_stage(of.task, effort, _MANY, follow=False)


def coarse_attempt(of: Case, intervals: int = INTERVALS) -> Attempt:
    """The plan in the time of which the usual grid is."""
    return coarse_plan(of.task, Effort(intervals, free=False), _MANY, follow=False).attempt


def guessed(of: Case, intervals: int = INTERVALS) -> Stage:
    """The constraints in the time of the guess, as the planner has them first."""
    breaks = breaks_inside(of.section)
    on = TimeMap.from_guess(of.section, of.limits, of.task.guess, breaks, intervals // _PER_GUESSED)
    return Stage.on(of.task, TimeGrid.even(on, _PER_GUESSED))


def constraints(of: Case, intervals: int = INTERVALS) -> Constraints:
    """What the solver sees."""
    return guessed(of, intervals).problem


# --- the start from rest --------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Spline:
    """Cubic spline of a squared speed over a coordinate, through the exact values of a start with constant jerk 1.

    ``coordinate``, ``y`` and ``jerk`` at many points, ``squared`` the spline there; ``knots`` in y.
    """

    knots: FloatArray
    coordinate: FloatArray
    squared: FloatArray
    y: FloatArray
    jerk: FloatArray


def exact_start(y: FloatArray) -> FloatArray:
    """(dy/dt)^2 after a start from rest with constant jerk 1: y = t^3/6, so that x = (6 y)^(4/3) / 4."""
    return np.asarray(0.25 * np.cbrt(6.0 * y) ** 4)


def start_in_y(intervals: int) -> Spline:
    """Spline of x = (dy/dt)^2 over y in [0, 1], knots equally spaced; jerk = x'' sqrt(x) / 2."""
    knots = np.linspace(0.0, 1.0, intervals + 1)
    spline = _through(knots, exact_start(knots))
    y = np.linspace(0.0, 1.0, _STEPS * intervals + 1)[1:]
    x = np.maximum(spline(y), 0.0)
    return Spline(knots, y, x, y, 0.5 * spline(y, 2) * np.sqrt(x))


def start_in_sigma(intervals: int) -> Spline:
    """Spline of x = sigma_dot^2 over sigma, as many knots; jerk = (y''' x + 3 y'' a + y' c) sqrt(x)."""
    # The rest map of a path of length 1; the curve itself is not looked at.
    blend = Section(load_curve("circle"), 0.0, 1.0, REST, Feed(1.0), None, blend_start=_BLEND_SHARE / BLEND_LENGTH)
    knots = np.linspace(0.0, blend.span, intervals + 1)
    y, slope, _, _ = blend.rest_map(knots)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = exact_start(y) / slope**2
    values[0] = (8.0 * blend.blend_start) ** (4.0 / 3.0) / 64.0  # the limit: y = 4/3 w r^3, y' = 4 r^2
    spline = _through(knots, values)
    sigma = np.linspace(0.0, blend.span, _STEPS * intervals + 1)[1:]
    x, a, c = spline(sigma), 0.5 * spline(sigma, 1), 0.5 * spline(sigma, 2)
    y_of, y1, y2, y3 = blend.rest_map(sigma)
    return Spline(y, sigma, x, y_of, np.einsum("km,km->m", jerk_terms(y1, y2, y3), np.stack([x, a, c])) * np.sqrt(x))


def _through(knots: FloatArray, values: FloatArray) -> Any:
    """Cubic spline that ends with the exact slope: what is compared is the start."""
    from scipy.interpolate import CubicSpline

    slope = 6.0 ** (4.0 / 3.0) / 3.0  # of exact_start at 1
    return CubicSpline(knots, values, bc_type=("not-a-knot", (1, slope)))


@dataclass(frozen=True)
class BlendRow:
    """A plan with rest blends ``width`` times as wide: excess of time and limits, and the duration slowed down."""

    case: str
    width: float
    iterations: int
    slowdown: float
    slowed_down_s: float


def blend_row(name: str, width: float, intervals: int = INTERVALS) -> BlendRow:
    """Solve once with other rest blends."""
    of = case(name, intervals, width=width)
    at = stage(of, intervals)
    attempt = at.solve(of.task, coarse_attempt(of, intervals))
    nodes, used = measured(of, at, attempt)
    slowdown = max(1.0, float(used.slowdown.max()))
    return BlendRow(name, width, attempt.work.iterations, slowdown - 1.0, slowdown * float(nodes.t[-1]))


# --- between the points ---------------------------------------------------------------------------------------------


def measured(of: Case, at: Stage, attempt: Attempt) -> tuple[TimeLaw, Utilisation]:
    """The time law of a solution, and what it uses between its nodes."""
    nodes = at.time_law(attempt)
    return nodes, utilisation(of.curve, of.limits, nodes)


def knots_only(at: Stage) -> Stage:
    """The same stage without constraints between the knots."""
    problem = at.problem
    between = np.arange(problem.cap.size) % (problem.inner + 1) > 0
    rows_a, rows_j = (
        replace(rows, given=np.where(between, 0.0, rows.given)) for rows in (problem.acceleration, problem.jerk)
    )
    cap = np.where(between, 1e300, problem.cap)
    return replace(at, problem=replace(problem, cap=cap, acceleration=rows_a, jerk=rows_j))


@dataclass(frozen=True)
class CollocationRow:
    """Where the limits are held, and what the law uses of them anywhere."""

    case: str
    intervals: int
    points: str
    duration_s: float
    acceleration: float
    jerk: float


def collocation_rows(name: str, intervals: int = INTERVALS) -> list[CollocationRow]:
    """Hold the limits at knots alone, and at knots and midpoints."""
    of = case(name, intervals)
    rows = []
    for points, at in (("knots", knots_only(stage(of, intervals))), ("knots and midpoints", stage(of, intervals))):
        nodes, used = measured(of, at, at.solve(of.task, None))
        most = float(used.acceleration.max()), float(used.jerk.max())
        rows.append(CollocationRow(name, intervals, points, float(nodes.t[-1]), *most))
    return rows


@dataclass(frozen=True, eq=False)
class Round:
    """One round of refinement: its nodes, what they use, and the solver's iterations."""

    nodes: TimeLaw
    used: Utilisation
    iterations: int


def tightening_rounds(of: Case, intervals: int = INTERVALS, count: int = 2) -> list[Round]:
    """Solve, and tighten the limits where the law uses too much, ``count`` solves in all."""
    at, attempt = stage(of, intervals), coarse_attempt(of, intervals)
    rounds = []
    for _ in range(count):
        attempt = at.solve(of.task, attempt)
        nodes, used = measured(of, at, attempt)
        rounds.append(Round(nodes, used, attempt.work.iterations))
        at, attempt = at.next(of.task, attempt, used, may_split=False)
    return rounds


@dataclass(frozen=True)
class RoundRow:
    """One round: duration of the law, largest shares of acceleration and jerk used, and the slowing down needed, - 1."""

    case: str
    round: int
    iterations: int
    duration_s: float
    acceleration: float
    jerk: float
    slowdown: float


def round_rows(name: str, count: int = 2) -> list[RoundRow]:
    """What tightening does to a case."""
    rows = []
    for number, solved in enumerate(tightening_rounds(case(name), count=count), start=1):
        most = (float(v.max()) for v in (solved.used.acceleration, solved.used.jerk, solved.used.slowdown - 1.0))
        rows.append(RoundRow(name, number, solved.iterations, float(solved.nodes.t[-1]), *most))
    return rows


def jerk_shares(curve: Curve, limits: Limits, nodes: TimeLaw, t: FloatArray) -> FloatArray:
    """Jerk of each axis over its limit at times t, (n, dim)."""
    u, u1, u2, u3 = (v[:, None] for v in nodes.at(t))
    q = curve.derivatives(u[:, 0], 3)
    return np.asarray(chain_rule(q[1], q[2], q[3], u1, u2, u3)[2] / limits.jerk)


# --- the solver -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Trace:
    """Iterates of one solve, the start first: time (s), gap over time, and the largest share of a limit used."""

    time: FloatArray
    gap: FloatArray
    used: FloatArray


def trace(problem: Constraints, *, centring: float = 0.2, most: int = 150) -> Trace:
    """Run the interior-point method and look at every iterate at its collocation points."""
    tolerance = optimal.GAP_TOLERANCE
    it = Iterate(problem, optimal.start_from(problem, problem.guess), centring, 0.95)
    rows, ended = [], None
    for _ in range(most):
        rows.append((it.time * problem.time_unit, it.gap / it.time, float(problem.used(*it.z).max())))
        if ended is not None:
            break
        ended = it.run(tolerance, 1)
    return Trace(*np.array(rows).T)


def staged_traces(of: Case, intervals: int = INTERVALS) -> tuple[Trace, Trace]:
    """Iterates on the coarse grid, and those on the fine one that begins with what the coarse one gave."""
    with patch.object(optimal, "GAP_TOLERANCE", _COARSE_GAP):
        first = trace(constraints(of, intervals))
    return first, trace(stage(of, intervals).problem, centring=0.1)


@dataclass(frozen=True)
class IterationRow:
    """Iterations from the scan alone with and without the hoped-for gain, and those of the planner.

    ``above_after_8``: how far the eighth iterate from the scan is from the optimum; ``feasible``: all of them are;
    ``infeasible_from_coarse``: how many of those that begin with the coarse law are not.
    """

    case: str
    cold: int
    without_hope: int
    coarse: int
    fine: int
    next_round: int
    above_after_8: float
    feasible: bool
    infeasible_from_coarse: int


def iteration_row(name: str) -> IterationRow:
    """Count iterations on the usual grid."""
    of = case(name)
    problem = constraints(of)
    run = trace(problem)
    with patch.object(optimal, "_HOPE", 0.0):
        without = optimal.solve_interior(problem, optimal.start_from(problem, problem.guess)).iterations
    rounds = tightening_rounds(of)
    return IterationRow(
        name,
        run.time.size - 1,
        without,
        coarse_attempt(of).work.iterations,
        rounds[0].iterations,
        rounds[1].iterations,
        float(run.time[8] / run.time[-1] - 1.0),
        bool(run.used.max() <= _WITHIN),
        int(np.count_nonzero(staged_traces(of)[1].used > _WITHIN)),
    )


@dataclass(frozen=True)
class GridRow:
    """One number of intervals: duration, its excess over the finest grid's, CPU microseconds an interval and iteration."""

    case: str
    intervals: int
    duration_s: float
    above_finest: float
    iterations: int
    us_per_interval: float


def grid_rows(name: str, counts: Sequence[int]) -> list[GridRow]:
    """Solve to a gap of 1e-7 on ever finer grids of the same section."""
    of = case(name)
    rows = []
    for n in counts:
        at = stage(of, n)
        attempt = at.solve(of.task, coarse_attempt(of, n), _FINE_GAP)
        work = attempt.work
        cost = 1e6 * work.solve_cpu_s / work.iterations / at.grid.intervals
        duration = float(attempt.speed_law.time_law(at.path).t[-1])
        rows.append(GridRow(name, at.grid.intervals, duration, 0.0, work.iterations, cost))
    return [replace(row, above_finest=row.duration_s / rows[-1].duration_s - 1.0) for row in rows]


# --- bounds and sensitivities ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Relaxed:
    """Where the method of the lower bound ends: x and pace y at its points, scaled, and the bound, s."""

    x: FloatArray
    pace: FloatArray
    bound: float


def relax(of: Case, intervals: int = INTERVALS) -> Relaxed:
    """Solve for the multipliers of the lower bound, and keep the primal state they belong to."""
    track = Track.on(of.section, of.limits, place_knots(of.section, of.task.guess, intervals))
    margin = np.ones(track.h.size)
    pace = Pace(of.task.guess.u, of.task.guess.time)
    problem, (_, tau) = problem_of(track, pace, margin, periodic=False)
    state = best_multipliers(problem, pace.duration / tau)
    bound, _ = best_splines(track, pace, periodic=False)
    return Relaxed(state.points[:, 1], state.points[:, 0], bound)


@dataclass(frozen=True)
class BoundRow:
    """A plan, its two bounds, and where the relaxation is loose."""

    case: str
    planned_s: float
    carried_s: float
    certified_s: float
    gap: float
    loose_points: float
    multipliers_prove_it: bool


def bound_row(name: str) -> BoundRow:
    """Plan a case and bound it."""
    of = case(name)
    profile = Job(of.curve, of.limits).plan()
    problem = constraints(of)
    solution = optimal.solve_interior(problem, optimal.start_from(problem, problem.guess))
    assert solution.iterate is not None
    found = relax(of)
    return BoundRow(
        name,
        profile.duration,
        section_bound(of.section, of.limits, INTERVALS, Pace(profile.u, profile.t)),
        float(certify(of.curve, of.limits, profile)),
        1.0 - found.bound / profile.duration,
        float((found.pace * np.sqrt(found.x) > 1.001).mean()),
        optimal.is_global(solution.iterate),
    )


@dataclass(frozen=True)
class SavingRow:
    """Seconds that 1 % more of a limit saves: by the multipliers, and by solving again (central difference)."""

    case: str
    limit: str
    promised_s: float
    solved_s: float


def saving_rows(of: Case, intervals: int = INTERVALS, change: float = 0.01) -> list[SavingRow]:
    """Compare the multipliers of a plan with solving again for limits higher and lower by ``change``, on the same grid."""
    at = stage(of, intervals)
    promised = at.solve(of.task, None, _FINE_GAP).saved
    rows = []
    for name, saved in sorted(promised.items(), key=lambda item: -item[1]):
        if saved < 1e-3 * max(promised.values()):
            continue
        times = []
        for share in (1.0 - change, 1.0 + change):
            problem, _ = build(_changed(of.limits, name, share), at.grid, inner=at.problem.inner)
            start = optimal.start_from(problem, problem.guess)
            times.append(optimal.solve_interior(problem, start, tolerance=_FINE_GAP).time * problem.time_unit)
        rows.append(SavingRow(of.name, name, saved, 0.005 / change * (times[0] - times[1])))
    return rows


def _changed(limits: Limits, name: str, share: float) -> Limits:
    """Limits of which one, by its name in a plan, is multiplied."""
    if name in {"feed", "chord error"}:
        key = name.replace(" ", "_")
        return replace(limits, **{key: share * getattr(limits, key)})
    kind, axis = name.split()
    row = getattr(limits, kind).copy()
    row[limits.axes.index(axis)] *= share
    return replace(limits, **{kind: row})


def teardrop(feed: float) -> Case:
    """The teardrop with the axes of the reference cases, at another feed."""
    curve, limits = next((curve, limits) for label, curve, limits, _ in reference_cases() if label == "teardrop 100")
    return prepared(f"teardrop {feed:g}", curve, limits.with_feed(feed))


def example() -> Case:
    """The butterfly NURBS on the example machine, as in the README."""
    curve = load_curve("butterfly-nurbs")
    return prepared("butterfly-nurbs 100", curve, load_limits("mill").for_curve(curve))


# --- the command ----------------------------------------------------------------------------------------------------

_ALL = tuple(name for name, *_ in reference_cases())
_TEN = _ALL[:10]
_GRIDS = (62, 125, 250, 500, 1000, 2000, 4000, 16000)


def start_errors(counts: Sequence[int] = (10, 20, 40, 80, 160)) -> list[dict[str, float]]:
    """Largest error of the jerk (true value 1) of the splines of a start from rest."""
    rows = []
    for n in counts:
        plain, mapped = (float(np.abs(s.jerk - 1.0).max()) for s in (start_in_y(n), start_in_sigma(n)))
        rows.append({"knots": n + 1, "over y": plain, "over sigma": mapped})
    return rows


def tables() -> dict[str, Callable[[], list[Any]]]:
    """Every experiment by the name of its table."""
    return {
        "jerk error of a spline through a start from rest": start_errors,
        "rest blends": lambda: [blend_row(n, w) for n in _TEN[:5] for w in (1e-3, 1e-2, 0.1, 1.0, 2.0)],
        "collocation": lambda: [r for n in _TEN[:2] for k in (250, 1000) for r in collocation_rows(n, k)],
        "tightening": lambda: [r for n in ("butterfly 100", "butterfly 300", "flank") for r in round_rows(n)],
        "iterations": lambda: [iteration_row(n) for n in _ALL],
        "grids": lambda: [r for n in _TEN[:2] for r in grid_rows(n, _GRIDS)],
        "bounds": lambda: [bound_row(n) for n in _ALL],
        "savings": lambda: [r for of in (example(), case("teardrop 300")) for r in saving_rows(of)],
    }


def show(title: str, rows: Sequence[dict[str, Any]]) -> Table:
    """A table of equal rows."""
    table = Table(title=title, title_justify="left", box=SIMPLE, padding=(0, 1, 0, 0))
    for name in rows[0]:
        table.add_column(name.replace("_", " "))
    for row in rows:
        table.add_row(*(f"{v:.7g}" if isinstance(v, float) else str(v) for v in row.values()))
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Print every table, and write them as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--output", type=Path, help="JSON result file")
    options = parser.parse_args(arguments)
    results = {}
    for title, run in tables().items():
        results[title] = [row if isinstance(row, dict) else asdict(row) for row in run()]
        Console(width=120).print(show(title, results[title]))
    if options.output is not None:
        options.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
