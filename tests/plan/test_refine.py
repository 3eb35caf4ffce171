"""Rounds of refinement: what the next solve begins with, where limits are tightened, and which plan is kept."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from cases import DRIVES, line_arc_line
from problems import laid_out

from planner import FeedrateProfile, Limits, check, load_curve, plan_feedrate
from planner.errors import InfeasibleError, SolverError
from planner.geometry.makers import formula
from planner.plan import refine
from planner.plan import stage as stages
from planner.plan.coarse import Effort
from planner.plan.collocation import points_of
from planner.plan.ends import Feed
from planner.plan.refine import Outcome, Round, _sooner
from planner.plan.solvers import interior as optimal
from planner.plan.solvers import ipopt as nlp
from planner.plan.stage import Stage, Task
from planner.plan.time_map import TimeMap
from planner.plan.utilisation import Utilisation
from planner.status import Status, Work


def task_of(name: str = "teardrop", intervals: int = 100, **feeds: float) -> tuple[Task, Stage]:
    section, guess, grid = laid_out(load_curve(name), DRIVES, intervals, **feeds)
    task = Task(section, DRIVES, guess, "optimal", False, np.inf, None)
    return task, Stage.on(task, grid)


def used_of(**shares: Any) -> Utilisation:
    rows = [np.asarray(shares.get(name, 0.0), dtype=float) for name in ("speed", "acceleration", "jerk", "backward")]
    size = max(row.size for row in rows)
    return Utilisation(*(np.broadcast_to(row, size).copy() for row in rows))


def round_of(seconds: float = 1.0, slowdown: float = 1.0, forward: bool = True, number: int = 0) -> Round:
    nodes = SimpleNamespace(t=np.array([0.0, seconds]), u=np.array([0.0, 1.0]))
    return Round(number, nodes, used_of(speed=[slowdown]), slowdown, forward)  # type: ignore[arg-type]


# ---- a solve that stalls -------------------------------------------------------------------------------------------


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, Any]]:
    """Arguments of every solve from here on; ``statuses`` and ``slower`` plant what comes out of each."""
    solve, calls = optimal.solve_interior, []

    def planted(problem: Any, start: Any, **options: Any) -> Any:
        calls.append((problem, start.copy() if isinstance(start, np.ndarray) else start))  # a solve works in its start
        found = solve(problem, start, **options)
        factor = planted.slower[len(calls) - 1] if len(calls) <= len(planted.slower) else 1.0  # type: ignore[attr-defined]
        if factor == np.inf:
            raise SolverError("planted")
        if factor == 1.0:
            return found
        return replace(found, status=Status.NO_STEP, time=factor * found.time, x=found.x / factor**2)

    planted.slower = []  # type: ignore[attr-defined]
    monkeypatch.setattr(optimal, "solve_interior", planted)
    calls_of: Any = calls
    return calls_of


def planted_times(*factors: float) -> None:
    optimal.solve_interior.slower = list(factors)  # type: ignore[attr-defined]


def test_a_solve_that_stalls_is_begun_anew_without_the_law_before_it(solves: list[tuple[Any, Any]]) -> None:
    task, stage = task_of()
    before = stage.solve(task, None)
    planted_times(1.0, 1.5)
    found = stage.solve(task, before)
    assert len(solves) == 3
    assert found.status is Status.OPTIMAL
    assert found.speed_law.x == pytest.approx(before.speed_law.x, rel=1e-4)
    # the third one knows neither the law nor the way to it
    problem, start = solves[2]
    assert problem is stage.problem
    assert np.array_equal(start, optimal.start_from(stage.problem, stage.problem.guess))


@pytest.mark.parametrize("again", [1.8, np.inf], ids=["worse", "none"])
def test_a_stalled_solve_is_kept_where_the_second_is_no_better(solves: list[tuple[Any, Any]], again: float) -> None:
    task, stage = task_of()
    before = stage.solve(task, None)
    planted_times(1.0, 1.5, again)
    found = stage.solve(task, before)
    assert len(solves) == 3
    assert found.status is Status.NO_STEP
    assert found.speed_law.x == pytest.approx(before.speed_law.x / 1.5**2, rel=1e-4)


def test_a_first_solve_that_stalls_is_not_repeated(solves: list[tuple[Any, Any]]) -> None:
    task, stage = task_of()
    planted_times(1.5)
    assert stage.solve(task, None).status is Status.NO_STEP
    assert len(solves) == 1


def test_a_solve_begins_at_the_law_before_it(solves: list[tuple[Any, Any]]) -> None:
    task, stage = task_of()
    before = stage.solve(task, None)
    stage.solve(task, replace(before, waypoint=None))
    stage.solve(task, before)
    assert solves[1][0].guess == pytest.approx(before.speed_law.x, rel=1e-12)
    assert solves[2][1] is before.waypoint


def test_a_solve_on_another_map_begins_at_even_speed(solves: list[tuple[Any, Any]]) -> None:
    """The map is that of a law: to go on as that did is x = 1."""
    task, stage = task_of()
    before = replace(stage.solve(task, None), waypoint=None)
    law = stage.time_law(before)
    stage = Stage.on(task, stage.grid.renewed(law, stage.knot_times(law), periodic=False))
    assert stage.solve(task, before).speed_law.x == pytest.approx(np.ones(stage.grid.sigma.size), rel=5e-2)
    assert (solves[1][0].guess == 1.0).all()


def test_a_failed_solve_is_infeasible_only_where_a_feed_is_prescribed(solves: list[tuple[Any, Any]]) -> None:
    for feeds, error in (({}, SolverError), ({"start": 10.0}, InfeasibleError)):
        task, stage = task_of(**feeds)
        planted_times(*[np.inf] * (len(solves) + 1))
        with pytest.raises(error, match="planted") as caught:
            stage.solve(task, None)
        assert caught.type is error


# ---- tightening ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gain", [1.0, 2.0])
@pytest.mark.parametrize("inner", [1, 3])
def test_limits_are_tightened_at_all_points_of_an_interval_and_by_less_beside_it(gain: float, inner: int) -> None:
    shares = [np.full(60, 0.9) for _ in range(3)]
    shares[1][40] = 1.01
    full = np.ones(60, dtype=bool)
    full[41] = False  # a double knot has no part in it
    speed, acceleration, jerk = stages._margins(shares, full, inner, gain)
    wanted = np.ones((inner + 1) * 60 + 1)
    margin = (1.0 + gain * 0.01) * (1.0 + stages._MARGIN_STEP)
    # its neighbours by less, or the plan would seek there what it gives up
    near, far = stages._BESIDE[inner]
    wanted[(inner + 1) * 38 : (inner + 1) * 44 + 1] = 1.0 + far * (margin - 1.0)
    wanted[(inner + 1) * 39 : (inner + 1) * 43 + 1] = 1.0 + near * (margin - 1.0)
    wanted[(inner + 1) * 41 + 1 : (inner + 1) * 42] = 1.0
    wanted[(inner + 1) * 40 : (inner + 1) * 41 + 1] = margin
    assert acceleration == pytest.approx(wanted, rel=1e-14)
    assert (speed == 1.0).all()
    assert (jerk == 1.0).all()


def test_the_tighter_of_two_neighbours_counts_at_the_knot_between() -> None:
    share = np.array([1.025, 1.03, 1.028])
    (found,) = stages._margins([share], np.ones(3, dtype=bool), 1, 1.0)
    assert found / (1.0 + stages._MARGIN_STEP) == pytest.approx(
        [1.025, 1.025, 1.03, 1.03, 1.03, 1.028, 1.028], rel=1e-14
    )


def test_tightening_divides_every_limit_but_a_prescribed_feed() -> None:
    _, stage = task_of(start=100.0, end=60.0)
    problem = stage.problem
    margins = [1.0 + 0.1 * np.random.default_rng(k).uniform(0.5, 1.0, problem.cap.size) for k in range(3)]
    tight = stages._tightened(problem, *margins)
    assert tight.cap[1:-1] == pytest.approx((problem.cap / margins[0] ** 2)[1:-1], rel=1e-14)
    assert tight.cap[0] == pytest.approx(problem.start, rel=2e-9)  # the feed limit itself is prescribed there
    assert tight.cap[0] > problem.start
    assert tight.cap[-1] == pytest.approx(problem.cap[-1] / margins[0][-1] ** 2, rel=1e-14)
    for rows, before, margin in (
        (tight.acceleration, problem.acceleration, margins[1]),
        (tight.jerk, problem.jerk, margins[2]),
    ):
        assert rows.given is before.given  # the largest array of a plan, which all rounds have in common
        assert before.factor is not None
        assert np.array_equal(rows.r, before.given * (before.factor * margin))


def test_a_reserve_is_left_from_its_parameter_on() -> None:
    task = replace(task_of()[0], inner=stages.MORE_INNER)
    stage = Stage.on(task, task_of()[1].grid)
    middle = 0.5 * sum(task.section.curve.domain)
    kept = Stage.on(replace(task, section=replace(task.section, reserve=((middle, 0.2),))), stage.grid)
    inner = stage.problem.inner
    macro = np.repeat(stage.grid.macro, inner + 1)[:-inner]
    after = stage.grid.map.along(points_of(stage.grid.sigma, inner), macro)[0] >= middle
    factor = np.where(after, 1.0 / 0.8, 1.0)
    assert kept.problem.jerk.r == pytest.approx(stage.problem.jerk.r * factor, rel=1e-14)
    assert kept.problem.acceleration.r == pytest.approx(stage.problem.acceleration.r * factor, rel=1e-14)
    assert kept.problem.cap == pytest.approx(stage.problem.cap / factor**2, rel=1e-14)
    assert 10 < np.count_nonzero(after) < after.size - 10


def test_a_prescribed_feed_leaves_two_millionths_of_every_limit() -> None:
    """Such a plan cannot be slowed down: what a solve uses too much between points must be left before."""
    task, stage = task_of(start=30.0)
    untouched = stages.build(task.limits, stage.grid, inner=stage.problem.inner)[0]
    assert stage.problem.jerk.r == pytest.approx(untouched.jerk.r * (1.0 + 2e-6), rel=1e-12)
    assert stage.problem.cap[1:] == pytest.approx(untouched.cap[1:] / (1.0 + 2e-6) ** 2, rel=1e-12)


# ---- the next round ------------------------------------------------------------------------------------------------


def test_where_a_plan_is_far_too_fast_or_falls_back_the_grid_is_halved_in_its_own_time() -> None:
    task, stage = task_of()
    attempt = stage.solve(task, None)
    law = stage.time_law(attempt)
    size = 2 * stage.grid.intervals
    shares = np.full(size, 1.001)
    backward = np.zeros(size)
    shares[20], shares[51], backward[81] = 1.004, 1.01, 1e-9
    finer, start = stage.next(task, attempt, used_of(speed=shares, backward=backward), may_split=True)
    assert start.waypoint is None
    assert finer.grid.intervals == stage.grid.intervals + 3
    new = np.setdiff1d(np.round(finer.grid.sigma, 12), np.round(law.t[::2], 12))
    assert new == pytest.approx(law.t[[21, 51, 81]], rel=1e-3)
    assert finer.grid.map.span == law.t[-1]


def test_where_the_law_falls_back_the_grid_is_halved_in_the_time_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    task, stage = task_of()
    attempt = stage.solve(task, None)

    def falls_back(*_: Any, **__: Any) -> Any:
        raise SolverError("planted")

    monkeypatch.setattr(TimeMap, "from_law", falls_back)
    shares = np.full(2 * stage.grid.intervals, 1.01)
    finer, _ = stage.next(task, attempt, used_of(speed=shares), may_split=True)
    assert finer.grid.map is stage.grid.map
    assert finer.grid.intervals == 2 * stage.grid.intervals


@pytest.mark.parametrize("feeds", [{}, {"start": 30.0}])
def test_a_tightened_solve_begins_on_the_way_of_the_last_unless_a_feed_is_prescribed(feeds: dict[str, float]) -> None:
    task, stage = task_of(**feeds)
    attempt = stage.solve(task, None)
    share = np.full(2 * stage.grid.intervals, 1.002)
    tighter, start = stage.next(task, attempt, used_of(jerk=share), may_split=False)
    assert attempt.waypoint is not None
    assert start.waypoint is (None if feeds else attempt.waypoint)
    assert tighter.grid is stage.grid
    gain = stages._GAIN[stage.problem.inner]
    assert tighter.problem.jerk.r == pytest.approx(
        stage.problem.jerk.r * (1.0 + 0.002 * gain) * (1.0 + stages._MARGIN_STEP), rel=1e-12
    )
    reserved = replace(task, section=replace(task.section, reserve=((0.0, 0.1),)))
    gain = 2.0 if feeds else gain  # only what continues another plan is tightened by more
    tighter, _ = stage.next(reserved, attempt, used_of(jerk=share), may_split=False)
    assert tighter.problem.jerk.r == pytest.approx(
        stage.problem.jerk.r * (1.0 + 0.002 * gain) * (1.0 + stages._MARGIN_STEP), rel=1e-12
    )


def test_a_plan_that_continues_another_is_tightened_from_the_way_of_the_last() -> None:
    task, free = task_of(start=30.0)
    task = replace(task, section=replace(task.section, start=Feed(30.0, 0.0)))
    stage = Stage.on(task, free.grid)
    attempt = stage.solve(task, None)
    tighter, start = stage.next(task, attempt, used_of(jerk=np.full(2 * stage.grid.intervals, 1.002)), may_split=False)
    assert attempt.waypoint is not None
    assert start.waypoint is attempt.waypoint
    warm, cold = tighter.solve(task, start), tighter.solve(task, replace(start, waypoint=None))
    assert warm.work.iterations < cold.work.iterations
    assert warm.work.residual < 1e-9
    assert warm.speed_law.x == pytest.approx(cold.speed_law.x, rel=1e-3)


def test_late_rounds_tighten_by_more() -> None:
    """Few places are left then, and a plan of a million intervals is solved as a whole for each of them."""
    task, stage = task_of()
    attempt = stage.solve(task, None)
    share = np.full(2 * stage.grid.intervals, 1.0001)
    for number, gain in ((0, 1.0), (1, 1.0), (2, 2.0), (4, 8.0)):
        tighter, _ = stage.next(task, attempt, used_of(acceleration=share), may_split=False, number=number)
        margin = (1.0 + 0.0001 * gain * stages._GAIN[stage.problem.inner]) * (1.0 + stages._MARGIN_STEP)
        assert tighter.problem.acceleration.r == pytest.approx(stage.problem.acceleration.r * margin, rel=1e-12)


def test_the_largest_part_stands_for_an_interval_and_none_for_an_empty_one() -> None:
    """Between the two nodes of a break there is nothing; where macros meet within a stretch there is one node."""
    section, guess, grid = laid_out(line_arc_line(), DRIVES, 60)
    stage = Stage.on(Task(section, DRIVES, guess, "optimal", False, np.inf, None), grid)
    law = stage.time_law(stage.solve(Task(section, DRIVES, guess, "optimal", False, np.inf, None), None))
    full = np.diff(grid.sigma) > 0.0
    values, doubled = np.arange(law.t.size - 1.0), np.diff(law.t) == 0.0
    found = stage.by_interval(np.where(doubled, 1e9, values))
    assert np.count_nonzero(doubled) == 2
    assert found[full].tolist() == values[~doubled][1::2].tolist()
    assert not found[~full].any()
    assert np.diff(stage.knot_times(law))[full] == pytest.approx(np.diff(law.t)[~doubled].reshape(-1, 2).sum(axis=1))


# ---- which plan is kept --------------------------------------------------------------------------------------------


def test_forward_comes_first_then_the_sooner_or_where_feeds_are_prescribed_the_closer() -> None:
    free, prescribed = task_of()[0], task_of(start=10.0)[0]
    for task in (free, prescribed):
        assert round_of(2.0, 1.5).is_better_than(round_of(1.0, 1.0, forward=False), task)
        assert not round_of(1.0, 1.0, forward=False).is_better_than(round_of(2.0, 1.5), task)
    sooner, closer = round_of(1.0, 1.2), round_of(1.1, 1.1)
    assert sooner.is_better_than(closer, free)
    assert not closer.is_better_than(sooner, free)
    assert closer.is_better_than(sooner, prescribed)
    assert not sooner.is_better_than(closer, prescribed)
    assert not sooner.is_better_than(sooner, free)
    assert not sooner.is_better_than(sooner, prescribed)


def test_what_is_accepted() -> None:
    free, prescribed = task_of()[0], task_of(start=10.0)[0]
    assert round_of(slowdown=1.000002).is_accepted(free, 2e-6)
    assert not round_of(slowdown=1.000003).is_accepted(free, 2e-6)
    assert round_of(slowdown=1.000003).is_accepted(free, 5e-6)
    assert not round_of(slowdown=1.000002).is_accepted(prescribed, 2e-6)
    assert round_of(slowdown=1.00000001).is_accepted(prescribed, 2e-6)
    assert not round_of(forward=False).is_accepted(free, 2e-6)


@pytest.mark.parametrize(
    ("slowdown", "number", "free", "coarse"),
    [
        (1.009, 0, True, False),
        (1.011, 0, True, True),
        (1.011, 0, False, False),
        (1.04, 4, False, False),
        (1.06, 0, False, True),
        (1.0005, 5, False, False),
        (1.009, 4, True, False),
        (1.0011, 5, True, True),
        (1.0011, 5, False, True),
    ],
)
def test_a_grid_is_too_coarse_where_tightening_does_not_help(
    slowdown: float, number: int, free: bool, coarse: bool
) -> None:
    assert round_of(slowdown=slowdown, number=number).is_too_coarse(Effort(100, free)) is coarse
    assert round_of(forward=False, number=number).is_too_coarse(Effort(100, free))


@pytest.mark.parametrize(("slowdown", "said"), [(1.0009, False), (1.0021, True)])
def test_a_slowing_down_is_said(slowdown: float, said: bool) -> None:
    nodes = round_of().law
    for before, after in ((Status.OPTIMAL, Status.SLOWED), (Status.BUDGET, Status.BUDGET)):
        plan = refine.SectionPlan(nodes, np.nan, before, Work(slowdown=slowdown)).said_slowed(0.25)
        assert plan.status is (after if said else before)
        assert len(plan.notes) == said
        assert all("slowed down as a whole by 0.21 %" in note for note in plan.notes)


def test_a_plan_with_prescribed_feeds_that_exceeds_its_limits_is_refused() -> None:
    free, prescribed = task_of()[0], task_of(start=10.0, end=5.0)[0]
    refine._require_met(free, round_of(slowdown=1.5))
    refine._require_met(prescribed, round_of(slowdown=1.0 + 0.9e-6))
    with pytest.raises(
        SolverError, match=r"start_feed = 10 to end_feed = 5 mm/s between u = 0 and 1 still exceeds .* 1\.000002 times"
    ):
        refine._require_met(prescribed, round_of(slowdown=1.000002))


def planned_with(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    intervals: int,
    method: Literal["optimal", "nlp"] = "optimal",
    periodic: bool = False,
    **found: Any,
) -> tuple[FeedrateProfile, int]:
    """A plan whose solves take 1, 2, 4, ... seconds and say what is given; and how many there were."""
    solver, name_of_solve = {"optimal": (optimal, "solve_interior"), "nlp": (nlp, "solve_nlp")}[method]
    solve, solves = getattr(solver, name_of_solve), []

    def timed(*args: Any, **kwargs: Any) -> Any:
        solves.append(2.0 ** len(solves))
        return replace(solve(*args, **kwargs), cpu_s=solves[-1], **found)

    monkeypatch.setattr(solver, name_of_solve, timed)
    profile = plan_feedrate(load_curve(name), DRIVES, method=method, intervals=intervals, periodic=periodic)
    return profile, len(solves)


def test_every_solve_is_counted_and_the_first_with_the_coarse_one(monkeypatch: pytest.MonkeyPatch) -> None:
    profile, count = planned_with(monkeypatch, "circle", 400)
    assert count > 2
    assert profile.work.solve_cpu_s == 2.0**count - 1.0
    assert profile.work.first_solve_cpu_s == 7.0  # on the two coarse grids and on the wanted one


def test_the_reference_method_solves_on_coarse_grids_too(monkeypatch: pytest.MonkeyPatch) -> None:
    profile, count = planned_with(monkeypatch, "circle", 100, method="nlp")
    assert count > 1
    assert profile.work.solve_cpu_s == 2.0**count - 1.0
    assert profile.work.first_solve_cpu_s == 7.0


@pytest.mark.parametrize(
    ("name", "status", "proven"),
    [("circle", Status.OPTIMAL, True), ("circle", Status.BUDGET, False), ("butterfly", Status.OPTIMAL, False)],
)
def test_only_an_optimum_is_proven_to_be_global(
    monkeypatch: pytest.MonkeyPatch, name: str, status: Status, proven: bool
) -> None:
    """The multipliers on a circle without an end are smooth enough; those of a butterfly jump."""
    profile, _ = planned_with(monkeypatch, name, 100, periodic=name == "circle", status=status)
    assert profile.work.proven_global is proven


# ---- as many intervals as serve ------------------------------------------------------------------------------------

# Five lobes between which the path all but turns back: most of the time at the programmed feed, and ten short slow places.
LOBES = {"X": "11.213*cos(u)*(1+0.791*cos(5*u))", "Y": "27.617*sin(u)*(1+0.791*cos(5*u))"}
SLOW = Limits(25.9048, [392.589, 161.388], [4022.21, 1680.21], [203307.0, 80862.4], tangential_jerk=10191.8)


def test_where_midpoints_do_not_serve_a_free_number_of_intervals_is_doubled() -> None:
    curve = formula(LOBES, (0.3, "2*pi+0.3"))
    fine = plan_feedrate(curve, SLOW, start_feed=12.0, intervals=12_000)
    found = plan_feedrate(curve, SLOW, start_feed=12.0)
    assert found.duration == pytest.approx(fine.duration, rel=3e-4)
    assert 3000 < found.work.intervals <= 4000
    asked = plan_feedrate(curve, SLOW, start_feed=12.0, intervals=1000)
    assert asked.work.intervals < 1200
    assert check(curve, SLOW, found).ok


@pytest.mark.parametrize(("seconds", "slowdown", "taken"), [(0.9, 1.0, True), (1.1, 1.0, False), (0.9, 1.1, False)])
def test_of_two_numbers_of_intervals_the_sooner_plan_is_kept_that_keeps_its_limits(
    seconds: float, slowdown: float, taken: bool
) -> None:
    task, stage = task_of(start=10.0)
    one = Outcome(task, round_of(1.0), stage, None, 0.25, 0.125, ())  # type: ignore[arg-type]
    other = Outcome(task, round_of(seconds, slowdown), stage, None, 0.5, 0.375, ())  # type: ignore[arg-type]
    kept = _sooner(task, one, other)
    assert kept.best is (other if taken else one).best
    assert (kept.spent, kept.first) == (0.75, 0.125)


def test_a_finer_plan_that_is_no_law_is_not_kept() -> None:
    """With a jerk of 1e12 mm/s^3 the finer ones fall back by a digit beside the stop."""
    curve = formula({"X": "50*cos(u)", "Y": "50*sin(u)"}, (0.0, "2*pi"))
    limits = Limits(100.0, 250.0, 1000.0, 1e12)
    found = plan_feedrate(curve, limits)
    without = plan_feedrate(curve, replace(limits, jerk=np.inf))
    assert found.duration == pytest.approx(without.duration, rel=1e-4)
    assert check(curve, limits, found).ok
