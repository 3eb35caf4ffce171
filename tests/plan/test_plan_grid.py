"""Plans over more or fewer intervals, what holds them back, and limits that fall away."""

from __future__ import annotations

import numpy as np
import pytest
from cases import CURVES, PROGRAMS, mill, reference_cases, worst

from planner import Curve, Limits, check, load_curve, load_limits, plan_feedrate
from planner.plan import refine
from planner.programs.path.path import program_path
from planner.programs.reading.reader import read_program
from planner.status import Status


def test_without_a_jerk_limit_toppra_plans() -> None:
    limits = mill(jerk=[np.inf] * 2)
    profile = plan_feedrate(load_curve("teardrop"), limits)
    assert profile.duration == pytest.approx(1.0903, rel=1e-3)
    assert any("no jerk limit" in note for note in profile.notes)


def test_a_budget_ends_early_with_a_feasible_plan() -> None:
    curve = load_curve("butterfly", scale=10)
    best = plan_feedrate(curve, mill())
    early = plan_feedrate(curve, mill(), budget=1e-4)
    assert best.duration * (1.0 - 1e-6) <= early.duration <= 1.5 * best.duration
    worst(curve, mill(), early)


def test_multipliers_predict_what_another_limit_saves() -> None:
    curve = load_curve("butterfly", scale=10)
    base = plan_feedrate(curve, mill(300.0))
    saved = base.saved_by_one_percent
    for name, changes in (
        ("acceleration X", {"acceleration": [1050.0, 1000.0]}),
        ("jerk Y", {"jerk": [20000.0, 21000.0]}),
    ):
        changed = plan_feedrate(curve, mill(300.0, **changes))
        assert base.duration - changed.duration == pytest.approx(5.0 * saved[name], rel=0.15)


def grid_cases() -> dict[str, tuple[Curve, Limits]]:
    found = {name: (curve, limits) for name, curve, limits, _ in reference_cases()}
    slots = read_program(PROGRAMS / "slots.ngc")
    found["slots"] = program_path(slots, 0.01, mill()).curve, mill()
    return found


def assert_no_slower_with_more(name: str, *counts: int) -> None:
    curve, limits = grid_cases()[name]
    durations = []
    for count in counts:
        profile = plan_feedrate(curve, limits, intervals=count)
        report = check(curve, limits, profile)
        assert report.ok, f"{count} intervals: {report}"
        durations.append(profile.duration)
    assert (np.diff(durations) <= 1e-6 * np.array(durations[1:])).all(), durations


@pytest.mark.parametrize("name", ["teardrop 100", "hypotrochoid 100", "circle 300", "butterfly-nurbs 250"])
def test_more_intervals_never_make_a_plan_slower(name):
    assert_no_slower_with_more(name, 500, 1000, 2000, 4000)


@pytest.mark.slow
@pytest.mark.parametrize("name", grid_cases())
def test_no_number_of_intervals_makes_a_plan_slower(name):
    assert_no_slower_with_more(name, 500, 1000, 2000, 4000, 16000)


@pytest.mark.parametrize("name", ["teardrop 300", pytest.param("flank", marks=pytest.mark.slow)])
def test_sixty_thousand_intervals_keep_the_limits(name):
    curve, limits = grid_cases()[name]
    profile = plan_feedrate(curve, limits, intervals=60_000)
    report = check(curve, limits, profile)
    assert report.ok, report
    assert profile.duration <= plan_feedrate(curve, limits, intervals=1000).duration


def test_something_holds_a_plan_back_nearly_all_the_time():
    curve, limits = load_curve("butterfly-nurbs"), load_limits("mill")
    profile = plan_feedrate(curve, limits.for_curve(curve))
    assert profile.shares().get("none", 0.0) <= 0.03


def test_a_plan_that_was_slowed_down_says_so_and_still_names_what_binds(monkeypatch):
    # As if the first round had been the last: 24 intervals are far too few, and the law between them too fast.
    monkeypatch.setattr(refine, "_MAX_ROUNDS", 1)
    curve = load_curve("butterfly", scale=10.0)
    profile = plan_feedrate(curve, mill(), intervals=60)
    assert profile.work.slowdown > 1.01
    assert profile.status is Status.SLOWED
    assert any("slowed down as a whole" in note for note in profile.notes)
    assert check(curve, mill(), profile).ok
    assert profile.shares().get("none", 0.0) < 0.8


@pytest.mark.parametrize("name", ["circle", "hypotrochoid"])
def test_an_axis_that_loses_its_jerk_limit_makes_no_plan_slower(name: str) -> None:
    """Beside an axis that keeps its own; from stop to stop the free one leaves on a ramp of half a period."""
    curve = load_curve(name, scale=1.0 if name == "circle" else 10.0)
    durations = [plan_feedrate(curve, mill(jerk=[20000.0, free])).duration for free in (2e4, 1e5, 1e6, np.inf)]
    assert (np.diff(durations) <= 1e-5 * durations[0]).all(), durations


def test_the_true_chord_error_is_kept_at_a_near_cusp() -> None:
    """Turned back within less than a period's way: the osculating circle allows what leaves the path by 42 times more."""
    curve, limits = load_curve(CURVES / "seed109.json"), load_limits(CURVES / "seed109.toml")
    profile = plan_feedrate(curve, limits)
    row = check(curve, limits, profile).row("chord error")
    assert row.ok
    assert row.ratio > 0.9
    # held there alone: slowed down as a whole it took 3.80 s
    assert profile.duration < 0.72
    assert profile.work.slowdown < 1.001
    assert any("for its chord error" in note for note in profile.notes)


def test_a_plan_that_keeps_its_chord_error_is_left_as_it_is() -> None:
    curve = load_curve("butterfly", scale=10.0)
    limits = mill(chord_error=1e-4)
    profile = plan_feedrate(curve, limits, intervals=400)
    assert not any("chord error" in note for note in profile.notes)
    assert check(curve, limits, profile).ok
