"""The coarse plan: on how many intervals it is solved, and that what it found is used again."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cases import DRIVES, line_arc_line, mill

from planner import Curve, Limits, SolverError, load_curve, plan_feedrate
from planner.geometry.makers import formula
from planner.plan.coarse import Coarse, Effort, coarse_plan
from planner.plan.guess import guess_feed
from planner.plan.section import Section, cut
from planner.plan.stage import Stage, Task
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.reader import read_program

BLENDS = "G21 G90 G17\nG0 X0 Y0\nF6000\nG1 X20\nG1 Y0.5\nG1 X0\nM2\n"


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Intervals, and points inside one, of every solve from here on."""
    solve, found = Stage.solve, []

    def counted(self: Stage, *arguments: Any) -> Any:
        found.append((self.grid.intervals, self.problem.inner))
        return solve(self, *arguments)

    monkeypatch.setattr(Stage, "solve", counted)
    return found


def coarse_of(curve: Curve, intervals: int, *, free: bool = False) -> Coarse:
    (section,) = cut(curve, DRIVES.for_curve(curve), exact_stop=False)
    limits = DRIVES.for_curve(curve)
    task = Task(section, limits, guess_feed(section, limits, intervals), "optimal", False, np.inf, None)
    return coarse_plan(task, Effort(intervals, free), 10**9, follow=False)


def test_a_path_without_blends_is_guessed_on_a_quarter_and_solved_evenly_on_half(solves: list[tuple[int, int]]) -> None:
    found = coarse_of(load_curve("hypotrochoid", scale=10.0), 2000)
    assert solves == pytest.approx(np.array([(500, 1), (1000, 1)]), rel=0.01)
    assert found.attempt.waypoint is None
    assert found.attempt.work.gap < 1e-4


def test_blends_have_as_many_intervals_as_they_need_and_three_points_in_the_second(
    solves: list[tuple[int, int]], tmp_path: Path
) -> None:
    (tmp_path / "part.ngc").write_text(BLENDS)
    curve = program_path(read_program(tmp_path / "part.ngc"), 0.01, mill(), path="separate").curve
    needed = curve.intervals_needed(*curve.domain)
    coarse_of(curve, 400)
    assert [inner for _, inner in solves] == [1, 3]
    assert solves[0][0] == pytest.approx(400, rel=0.05)
    assert solves[1][0] == pytest.approx(max(400, needed), rel=0.05)


def test_where_the_even_grid_cannot_tell_the_switches_there_is_a_third_solve(solves: list[tuple[int, int]]) -> None:
    coarse_of(load_curve("butterfly", scale=10.0), 300)
    assert len(solves) == 2
    coarse_of(load_curve("butterfly", scale=10.0), 600, free=True)
    assert len(solves) == 5


def test_a_plan_that_continues_another_is_solved_in_any_state_first(monkeypatch: pytest.MonkeyPatch) -> None:
    solve, starts, iterations = Stage.solve, [], []

    def watched(self: Stage, *arguments: Any) -> Any:
        found = solve(self, *arguments)
        starts.append((self.problem.start, self.problem.start_slope))
        iterations.append(found.work.iterations)
        return found

    monkeypatch.setattr(Stage, "solve", watched)
    curve = load_curve("hypotrochoid", scale=10.0)
    plan = plan_feedrate(curve, DRIVES, start_feed=40.0, start_acceleration=-100.0, intervals=1000)
    assert np.isnan(starts[0]).all()
    assert not np.isnan(starts[1:]).any()
    assert iterations[0] < 25
    assert plan.feed[0] == pytest.approx(40.0, rel=1e-9)
    assert plan.acceleration[0] == pytest.approx(-100.0, rel=1e-6)
    starts.clear()
    plan_feedrate(curve, DRIVES, start_feed=40.0, intervals=1000)
    assert not np.isnan([start for start, _ in starts]).any()


def test_a_plan_that_midpoints_do_not_serve_begins_from_the_same_coarse_plan(
    solves: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    curve = line_arc_line()
    monkeypatch.setattr("planner.plan.refine._POINTS_SERVE", 1.0)
    profile = plan_feedrate(curve, DRIVES, intervals=400)
    assert [inner for _, inner in solves[:4]] == [1, 1, 1, 3]
    assert solves[2][0] == pytest.approx(solves[3][0], rel=0.05)
    assert profile.work.slowdown < 1.00001


@pytest.mark.parametrize(
    ("intervals", "share", "expected"),
    [
        (None, 1.0, (1000, True)),
        (None, 0.3, (300, True)),
        (None, 0.01, (200, True)),
        (500, 0.5, (250, False)),
        (500, 0.01, (24, False)),
    ],
)
def test_the_effort_is_shared_among_sections(
    intervals: int | None, share: float, expected: tuple[int, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    section = SimpleNamespace(curve=SimpleNamespace(intervals_needed=lambda lo, hi: 10), u_start=0.0, u_end=1.0)
    assert Effort.for_share(intervals, share, _as_section(section)) == Effort(*expected)
    section.curve.intervals_needed = lambda lo, hi: 4000 if (lo, hi) == (0.0, 1.0) else 0
    wanted = 4000 if intervals is None else expected[0]
    assert Effort.for_share(intervals, share, _as_section(section)).intervals == wanted


def _as_section(found: Any) -> Section:
    return found  # type: ignore[no-any-return]


def test_where_the_guess_leads_to_a_law_that_falls_back_its_intervals_are_halved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Six lobes with all but cusps between, far shorter than an interval of the guess."""
    lobes = {"X": "30*cos(u)*(1+0.9*cos(6*u))", "Y": "25*sin(u)*(1+0.9*cos(6*u))"}
    limits = Limits(
        11.0,
        [490.0, 410.0],
        [2900.0, 2100.0],
        [17800.0, 188000.0],
        tangential_acceleration=746.0,
        tangential_jerk=6400.0,
    )
    (section,) = cut(formula(lobes, (0.3, "2*pi+0.3")), limits, exact_stop=False)
    task = Task(section, limits, guess_feed(section, limits, 1000), "optimal", False, np.inf, None)
    found = coarse_plan(task, Effort(1000, True), 10**9, follow=False)
    assert (np.diff(found.law.u) > 0.0).all()
    monkeypatch.setattr("planner.plan.coarse._MAX_HALVINGS", 0)
    with pytest.raises(SolverError, match="falls back"):
        coarse_plan(task, Effort(1000, True), 10**9, follow=False)
