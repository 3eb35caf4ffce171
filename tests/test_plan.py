"""Plans of whole paths: durations against reference optima, feasibility between the nodes, stops, ends and bad input."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interp import replay
from planner import (
    Curve,
    InfeasibleError,
    InputError,
    Limits,
    SolverError,
    certify,
    check,
    load_curve,
    load_limits,
    plan_feedrate,
    refine,
)
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.plots import plot_plan, save_plot
from planner.programs.path import program_path
from planner.programs.reader import read_program
from planner.solvers import optimal

# s at 100 and 300 mm/s: three independent solvers agree within 1e-4; without jerk limit by toppra
OPTIMA = {
    ("teardrop", 1.0): ((1.1402, 0.9040), (1.0903, 0.8506)),
    ("butterfly", 10.0): ((4.1574, 3.3027), (4.0856, 3.2169)),
    ("hypotrochoid", 10.0): ((7.1202, 3.6401), (7.0615, 3.5830)),
    ("snailshell", 10.0): ((1.8027, 1.5875), (1.7260, 1.5099)),
    ("circle", 1.0): ((3.2916, 1.6479), (3.2414, 1.5973)),
}
CASES = [
    pytest.param(name, scale, feed, with_jerk[k], without[k], id=f"{name}-{feed:g}")
    for (name, scale), (with_jerk, without) in OPTIMA.items()
    for k, feed in enumerate((100.0, 300.0))
]


def plane(feed: float = 100.0, **changes: object) -> Limits:
    values = {"velocity": [250.0] * 2, "acceleration": [1000.0] * 2, "jerk": [20000.0] * 2, "chord_error": 1e-3}
    return Limits(feed, **(values | changes))  # type: ignore[arg-type]


def line(length: float) -> Curve:
    return NurbsCurve([[0.0, 0.0], [length, 0.0]], [0.0, 0.0, 1.0, 1.0], 1, name="line")


def square(side: float) -> Curve:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * side
    return NurbsCurve(corners, [0, 0, 1, 2, 3, 4, 4], 1, name="square")


def line_into_arc() -> Curve:
    """20 mm along X, then a quarter circle of radius 10 mm: the curvature jumps by 0.1 1/mm."""
    points = [[0, 0], [10, 0], [20, 0], [30, 0], [30, 10]]
    return NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 2], 2, [1, 1, 1, np.sqrt(0.5), 1], name="line into arc")


def s_curve_time(length: float, v: float, a: float, j: float) -> float:
    """Shortest rest-to-rest time over a length under velocity, acceleration and jerk limits."""
    if v * j >= a * a:
        ramp, ramp_length = v / a + a / j, 0.5 * v * (v / a + a / j)
    else:
        ramp, ramp_length = 2.0 * np.sqrt(v / j), v * np.sqrt(v / j)
    if length >= 2.0 * ramp_length:
        return float(2.0 * ramp + (length - 2.0 * ramp_length) / v)
    if length <= 2.0 * a**3 / j**2:
        return float(np.cbrt(32.0 * length / j))
    peak = 0.5 * (-(a * a) / j + np.sqrt((a * a / j) ** 2 + 4.0 * a * length))
    return float(2.0 * (peak / a + a / j))


def worst(curve: Curve, limits: Limits, profile: object) -> float:
    report = check(curve, limits, profile)  # type: ignore[arg-type]
    assert report.ok, str(report)
    return max(row.ratio for row in report.rows if np.isfinite(row.ratio))


@pytest.mark.parametrize(("name", "scale", "feed", "optimum", "without_jerk"), CASES)
def test_optimal_plan_reaches_the_reference_optimum_and_keeps_every_limit(
    name: str, scale: float, feed: float, optimum: float, without_jerk: float
) -> None:
    curve, limits = load_curve(name, scale=scale), plane(feed)
    profile = plan_feedrate(curve, limits)
    assert optimum * (1.0 - 1e-4) <= profile.duration <= optimum * 1.0005
    assert profile.stats["status"] == "optimal"
    assert 0.99 <= worst(curve, limits, profile) <= 1.0 + 1e-6
    assert worst(curve, limits, replay(curve, profile)) <= 1.0 + 1e-6
    assert without_jerk * 0.998 <= profile.lower_bound <= profile.duration
    assert not check(curve, limits, replay(curve, plan_feedrate(curve, plane(feed, jerk=[20300.0] * 2)))).ok


@pytest.mark.parametrize(("name", "scale", "feed", "optimum", "without_jerk"), CASES)
def test_toppra_gives_the_optimum_without_jerk_limit(
    name: str, scale: float, feed: float, optimum: float, without_jerk: float
) -> None:
    profile = plan_feedrate(load_curve(name, scale=scale), plane(feed), method="toppra")
    assert profile.lower_bound == pytest.approx(without_jerk, rel=2e-3)
    assert profile.duration < optimum
    report = check(profile.curve, plane(feed), profile)
    assert not report.ok
    kinds = {row.limit for row in report.violations}
    assert "step on a smooth path" in kinds
    assert kinds <= {"jerk", "jerk at a curvature break", "acceleration step", "step on a smooth path"}


@pytest.mark.parametrize("name", ["teardrop", "circle"])
def test_ipopt_agrees_with_our_solver(name: str) -> None:
    ours, reference = (
        plan_feedrate(load_curve(name), plane(), method=method, intervals=300) for method in ("optimal", "nlp")
    )
    assert ours.duration == pytest.approx(reference.duration, rel=1e-4)
    assert reference.duration == pytest.approx(OPTIMA[name, 1.0][0][0], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scale", "feed", "optimum", "without_jerk"), CASES)
def test_ipopt_reaches_the_reference_optimum(
    name: str, scale: float, feed: float, optimum: float, without_jerk: float
) -> None:
    curve = load_curve(name, scale=scale)
    assert plan_feedrate(curve, plane(feed), method="nlp").duration == pytest.approx(optimum, rel=1e-3)
    fine = plan_feedrate(curve, plane(feed), method="nlp", intervals=2000)
    assert fine.duration == pytest.approx(optimum, rel=5e-4)


@pytest.mark.slow
def test_ipopt_on_the_five_axis_flank() -> None:
    profile = plan_feedrate(load_curve("flank"), load_limits("five-axis"), method="nlp", intervals=500)
    assert profile.duration == pytest.approx(8.031, rel=1e-2)


def test_five_axis_flank() -> None:
    curve, limits = load_curve("flank"), load_limits("five-axis")
    profile = plan_feedrate(curve, limits)
    assert 8.0305 <= profile.duration <= 8.035
    worst(curve, limits, profile)
    worst(curve, limits, replay(curve, profile))


def test_butterfly_nurbs_with_its_radius_of_23_micrometres() -> None:
    curve = load_curve("butterfly-nurbs")
    limits = Limits(250.0, [np.inf] * 2, [2000.0] * 2, [20000.0] * 2)
    profile = plan_feedrate(curve, limits)
    assert 4.560 <= profile.duration <= 4.58
    worst(curve, limits, profile)


@pytest.mark.parametrize("length", [1e-6, 0.01, 0.3, 2.0, 5.1, 20.0, 100.0])
def test_a_line_takes_the_time_of_the_s_curve(length: float) -> None:
    profile = plan_feedrate(line(length), plane())
    assert profile.duration == pytest.approx(s_curve_time(length, 100.0, 1000.0, 20000.0), rel=2e-4)
    assert profile.duration >= s_curve_time(length, 100.0, 1000.0, 20000.0) * (1.0 - 1e-6)
    worst(line(length), plane(), profile)


@pytest.mark.parametrize("curve", [line(1e8), load_curve("circle", scale=1e6)], ids=["line", "circle"])
def test_a_path_of_100_km_plans(curve: Curve) -> None:
    profile = plan_feedrate(curve, plane())
    assert profile.duration == pytest.approx(curve.length / 100.0, rel=1e-3)
    worst(curve, plane(), profile)


def test_a_circle_of_a_nanometre_plans() -> None:
    curve = load_curve("circle", scale=1e-8)
    worst(curve, plane(), plan_feedrate(curve, plane()))


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_lengths_and_limits_in_another_unit_leave_the_duration(factor: float) -> None:
    curve, other = load_curve("teardrop"), load_curve("teardrop", scale=factor)
    scaled = Limits(100 * factor, [250 * factor] * 2, [1e3 * factor] * 2, [2e4 * factor] * 2, 1e-3 * factor)
    first, second = plan_feedrate(curve, plane()), plan_feedrate(other, scaled)
    assert second.duration == pytest.approx(first.duration, rel=1e-9)


def test_time_in_another_unit_scales_the_duration() -> None:
    curve = load_curve("teardrop")
    slow = Limits(10.0, [25.0] * 2, [10.0] * 2, [20.0] * 2, 1e-3, period=1e-2)
    assert plan_feedrate(curve, slow).duration == pytest.approx(10.0 * plan_feedrate(curve, plane()).duration, rel=1e-9)


def test_running_the_path_backwards_takes_as_long() -> None:
    curve = load_curve("snailshell", scale=10)
    assert isinstance(curve, FormulaCurve)
    backwards = {axis: text.replace("u", "(3*pi-u)") for axis, text in curve.expressions.items()}
    # the function names of these expressions contain no u
    other = FormulaCurve(backwards, curve.domain, scale=10.0)
    first, second = (plan_feedrate(c, plane()).duration for c in (curve, other))
    assert second == pytest.approx(first, rel=2e-4)


def test_the_same_input_gives_the_same_plan() -> None:
    first, second = (plan_feedrate(load_curve("teardrop"), plane()) for _ in range(2))
    for name in ("t", "u", "u_rate", "u_acceleration", "binding"):
        assert np.array_equal(getattr(first, name), getattr(second, name))


def test_corners_become_exact_stops() -> None:
    curve = square(20.0)
    profile = plan_feedrate(curve, plane())
    assert profile.duration == pytest.approx(4.0 * s_curve_time(20.0, 100.0, 1000.0, 20000.0), rel=1e-4)
    assert sum("exact stop" in note for note in profile.stats["notes"]) == 3
    worst(curve, plane(), profile)


def test_a_curvature_jump_is_passed_slowly_enough_for_the_samples() -> None:
    curve, limits = line_into_arc(), plane()
    profile = plan_feedrate(curve, limits)
    assert any("curvature jumps" in note for note in profile.stats["notes"])
    at = int(np.flatnonzero(profile.u == 1.0)[0])
    step = 0.1 * profile.feed[at] ** 2
    assert step <= 2.0 / 3.0 * 20000.0 * limits.period * (1.0 + 1e-9)
    assert profile.feed[at] == pytest.approx(np.sqrt(2.0 / 3.0 * 20.0 / 0.1), rel=0.02)
    near = np.linspace(profile.t[at] - 3e-3, profile.t[at] + 3e-3, 601)
    assert np.abs(profile.at(near).jerk).max() <= 0.5 * 20000.0 * (1.0 + 1e-6)
    worst(curve, limits, profile)
    for phase in np.linspace(0.0, 0.9, 4):
        worst(curve, limits, replay(curve, profile, 1e-3 * (1.0 + 0.001 * phase)))


def test_exact_stop_stops_at_a_curvature_jump() -> None:
    profile = plan_feedrate(line_into_arc(), plane(), exact_stop=True)
    assert profile.feed[profile.u == 1.0].max() == 0.0
    assert any("exact stop at u = 1" in note for note in profile.stats["notes"])
    worst(line_into_arc(), plane(), profile)


def test_a_resting_tip_is_planned_on_the_rotary_axis() -> None:
    xy = np.array([[0, 0]] + [[10.0 * k, 0] for k in range(1, 4)] + [[30.0, 0.0]] * 5 + [[30, 5], [30, 15]])
    points = np.column_stack([xy, 0.1 * np.arange(len(xy))])
    knots = [0, 0, 0, 0, *range(1, len(xy) - 3), *[len(xy) - 3] * 4]
    curve = NurbsCurve(points, knots, 3, axes=["X", "Y", "A"], name="tip rests")
    limits = Limits(100.0, [250, 250, 2], [1000, 1000, 20], [20000, 20000, 400], axes=["X", "Y", "A"])
    profile = plan_feedrate(curve, limits)
    resting = np.isin(profile.limit_names, ["jerk A", "acceleration A", "velocity A"])[profile.binding]
    assert resting[(profile.u > 5.2) & (profile.u < 5.8)].any()
    worst(curve, limits, profile)


def test_entry_and_exit_feeds_are_kept_exactly() -> None:
    curve = load_curve("teardrop")
    profile = plan_feedrate(curve, plane(), start_feed=50.0, end_feed=20.0)
    assert profile.feed[[0, -1]] == pytest.approx([50.0, 20.0], rel=1e-9)
    assert profile.duration < plan_feedrate(curve, plane()).duration
    worst(curve, plane(), profile)
    worst(curve, plane(), replay(curve, profile))


def test_a_closed_path_runs_on_without_a_stop() -> None:
    curve = load_curve("circle")
    profile = plan_feedrate(curve, plane(), periodic=True)
    assert profile.duration == pytest.approx(curve.length / 100.0, rel=1e-5)
    assert profile.feed[0] == pytest.approx(profile.feed[-1], rel=1e-9)
    worst(curve, plane(), replay(curve, profile))


def test_tangential_and_chord_limits_bind() -> None:
    curve = load_curve("teardrop")
    tangential = plane(tangential_acceleration=300.0, tangential_jerk=3000.0)
    profile = plan_feedrate(curve, tangential)
    assert {"tangential acceleration", "tangential jerk"} <= set(profile.shares())
    worst(curve, tangential, profile)
    chord = plane(300.0, chord_error=1e-4)
    profile = plan_feedrate(curve, chord)
    assert profile.shares()["chord error"] > 0.1
    worst(curve, chord, profile)


def test_without_a_jerk_limit_toppra_plans() -> None:
    limits = plane(jerk=[np.inf] * 2)
    profile = plan_feedrate(load_curve("teardrop"), limits)
    assert profile.duration == pytest.approx(1.0903, rel=1e-3)
    assert any("no jerk limit" in note for note in profile.stats["notes"])


def test_a_budget_ends_early_with_a_feasible_plan() -> None:
    curve = load_curve("butterfly", scale=10)
    best = plan_feedrate(curve, plane())
    early = plan_feedrate(curve, plane(), budget=1e-4)
    assert best.duration * (1.0 - 1e-6) <= early.duration <= 1.5 * best.duration
    worst(curve, plane(), early)


def test_multipliers_predict_what_another_limit_saves() -> None:
    curve = load_curve("butterfly", scale=10)
    base = plan_feedrate(curve, plane(300.0))
    saved = base.stats["saved_by_one_percent"]
    for name, changes in (
        ("acceleration X", {"acceleration": [1050.0, 1000.0]}),
        ("jerk Y", {"jerk": [20000.0, 21000.0]}),
    ):
        changed = plan_feedrate(curve, plane(300.0, **changes))
        assert base.duration - changed.duration == pytest.approx(5.0 * saved[name], rel=0.15)


def test_certified_bound_meets_the_plan() -> None:
    curve, limits = load_curve("circle"), plane()
    profile = plan_feedrate(curve, limits)
    assert 0.998 * profile.duration <= certify(curve, limits, profile) <= profile.duration


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"method": "fast"}, InputError, "method = 'fast' must be one of"),
        ({"start_feed": -1.0}, InputError, "start_feed = -1.0 mm/s must be >= 0"),
        ({"end_feed": np.nan}, InputError, "end_feed = nan mm/s must be >= 0"),
        ({"intervals": 5}, InputError, "intervals = 5 must lie within"),
        ({"budget": 0.0}, InputError, "budget = 0.0 s must be > 0"),
        ({"start_feed": 101.0}, InfeasibleError, "above the feed limit there, 100 mm/s"),
        ({"periodic": True}, InputError, "the ends of line are 1 apart"),
        ({"intervals": 23}, InputError, r"intervals = 23 must lie within \[24, 20000000\]"),
        ({"intervals": 20_000_001}, InputError, "intervals = 20000001 must lie within"),
        ({"periodic": True, "method": "scurve"}, InputError, "not by 'scurve'"),
        ({"periodic": True, "start_feed": 1.0}, InputError, "start_feed and end_feed must be 0"),
        ({"reserve": [(0.5, 0.1), (0.2, 0.1)]}, InputError, "must be increasing parameters"),
        ({"reserve": [(0.5, 1.0)]}, InputError, r"each with a share in \[0, 1\)"),
        ({"reserve": [(0.5, -0.1)]}, InputError, r"each with a share in \[0, 1\)"),
    ],
)
def test_bad_arguments_are_named(changes: dict[str, object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        plan_feedrate(line(1.0), plane(), **changes)  # type: ignore[arg-type]


def test_a_reserve_is_left_unused_from_its_parameter_on() -> None:
    curve, limits = load_curve("butterfly", scale=10.0), plane()
    middle = 0.5 * sum(curve.domain)
    profile = plan_feedrate(curve, limits, reserve=[(middle, 0.1)])
    t = np.linspace(0.0, profile.duration, 20_001)
    law = profile.at(t)
    q = curve.derivatives(law.u, 2)
    share = np.abs(q[2] * law.u_rate[:, None] ** 2 + q[1] * law.u_acceleration[:, None]).max(axis=1) / 1000.0
    after = law.u > middle + 0.01 * np.diff(curve.domain)[0]
    assert 0.99 < share[~after].max() <= 1.0 + 1e-6
    assert 0.89 < share[after].max() <= 0.9 * (1.0 + 1e-3)  # room is meant, not a limit
    assert profile.duration > plan_feedrate(curve, limits, reserve=[(middle, 0.0)]).duration


def test_sections_are_chained_without_a_gap() -> None:
    """Four sides of a square of one length take one time; at a stop two nodes share it."""
    profile = plan_feedrate(square(20.0), plane())
    double = np.flatnonzero(np.diff(profile.t) == 0.0)
    assert profile.u[double].tolist() == profile.u[double + 1].tolist() == [1.0, 2.0, 3.0]
    assert profile.t[double] == pytest.approx(profile.duration * np.array([0.25, 0.5, 0.75]), rel=1e-4)
    assert (np.diff(profile.t) >= 0.0).all()
    one = plan_feedrate(line(20.0), plane(), intervals=250)
    four = plan_feedrate(square(20.0), plane(), intervals=1000)
    assert four.duration == pytest.approx(4.0 * one.duration, rel=1e-6)
    assert four.lower_bound == pytest.approx(4.0 * one.lower_bound, rel=1e-6)
    for key in ("intervals", "iterations"):
        assert four.stats[key] == pytest.approx(4 * one.stats[key], rel=0.1)
    assert sum(four.stats["saved_by_one_percent"].values()) == pytest.approx(
        4.0 * sum(one.stats["saved_by_one_percent"].values()), rel=1e-3
    )
    assert (four.stats["sections"], four.stats["periodic"], four.stats["exact_stop"]) == (4, False, False)


def test_an_entry_feed_that_cannot_be_braked_is_infeasible() -> None:
    with pytest.raises(InfeasibleError, match="start_feed = 100 to end_feed = 0"):
        plan_feedrate(line(1.0), plane(), start_feed=100.0)


def test_limits_that_limit_nothing_are_refused() -> None:
    with pytest.raises(InfeasibleError, match="nothing limits the feed"):
        plan_feedrate(line(1.0), Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2))


def test_limits_of_another_number_of_axes_are_refused() -> None:
    with pytest.raises(InputError, match="the limits have 2 axes"):
        plan_feedrate(load_curve("flank"), plane())


def test_a_kinked_seam_cannot_be_periodic() -> None:
    with pytest.raises(InputError, match="smooth seam"):
        plan_feedrate(load_curve("teardrop"), plane(), periodic=True)


@pytest.mark.parametrize(("name", "scale"), list(OPTIMA))
def test_plans_are_proven_global_optima(name: str, scale: float) -> None:
    for feed in (100.0, 300.0):
        curve, limits = load_curve(name, scale=scale), plane(feed)
        profile = plan_feedrate(curve, limits)
        assert 0.0 <= 1.0 - certify(curve, limits, profile) / profile.duration <= 5e-4


def racetrack() -> Curve:
    """Two lines and four quarter circles, entered where a line meets an arc."""
    w = np.sqrt(0.5)
    points = [
        [0, 0],
        [15, 0],
        [30, 0],
        [40, 0],
        [40, 10],
        [40, 20],
        [30, 20],
        [15, 20],
        [0, 20],
        [-10, 20],
        [-10, 10],
        [-10, 0],
        [0, 0],
    ]
    return NurbsCurve(
        points,
        [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 6],
        2,
        [1, 1, 1, w, 1, w, 1, 1, 1, w, 1, w, 1],
        name="racetrack",
    )


def test_a_seam_at_which_the_curvature_jumps_cannot_be_periodic() -> None:
    with pytest.raises(InputError, match=r"curvature of racetrack jumps by 0\.1 1/mm there"):
        plan_feedrate(racetrack(), plane(), periodic=True)


def test_a_closed_path_with_a_corner_cannot_be_periodic() -> None:
    square = NurbsCurve(
        [[5, 0], [10, 0], [10, 10], [0, 10], [0, 0], [5, 0]], [0, 0, 1, 2, 3, 4, 5, 5], 1, name="square"
    )
    with pytest.raises(InputError, match="cannot pass the exact stop of square at u = 1"):
        plan_feedrate(square, plane(), periodic=True)


def test_a_periodic_plan_needs_no_jerk_limit() -> None:
    curve, limits = load_curve("circle"), plane(jerk=[np.inf] * 2)
    profile = plan_feedrate(curve, limits, periodic=True)
    assert check(curve, limits, profile).ok
    assert profile.duration == pytest.approx(curve.length / limits.feed, rel=1e-5)


@pytest.mark.parametrize("end", [1e-5, 1e-3, 1e-2, 0.1, 1.0])
def test_a_plan_with_feeds_at_its_ends_keeps_its_limits_or_is_an_error(end: float) -> None:
    curve = FormulaCurve({"X": "60*u", "Y": "20*sin(3*u)"}, (0.0, 2.0))
    try:
        profile = plan_feedrate(curve, plane(), start_feed=10.0, end_feed=end)
    except (InfeasibleError, SolverError):  # said, not silently exceeded
        assert end <= 0.01
    else:
        worst(curve, plane(), profile)


def test_progress_is_a_share() -> None:
    said: list[tuple[str, float | None]] = []
    plan_feedrate(square(20.0), plane(), progress=lambda text, share: said.append((text, share)))
    shares = [share for _, share in said]
    assert all(share is None or 0.0 <= share <= 1.0 for share in shares)
    assert [entry for entry in said if entry[0].startswith("section")] == [
        (f"section {k + 1} of 4", pytest.approx(0.25 * k)) for k in range(4)
    ]


def test_a_path_of_rotary_axes_alone_is_planned_checked_and_drawn(tmp_path: Path) -> None:
    points = [[0.0, 0.0], [0.1, 0.3], [0.4, 0.5], [0.9, 0.6], [1.2, 0.2]]
    curve = NurbsCurve(points, [0, 0, 0, 0, 0.5, 1, 1, 1, 1], 3, axes=["A", "C"], name="table")
    limits = Limits(100.0, [2.0] * 2, [20.0] * 2, [400.0] * 2, chord_error=1e-3, axes=["A", "C"])
    profile = plan_feedrate(curve, limits)
    worst(curve, limits, profile)
    worst(curve, limits, replay(curve, profile))
    assert profile.duration - certify(curve, limits, profile) <= 1e-3 * profile.duration
    save_plot(tmp_path / "table.png", plot_plan(curve, limits, profile))
    with pytest.raises(InputError, match="the tool tip rests"):
        plan_feedrate(curve, limits, method="scurve")


@pytest.mark.parametrize("height", [1e-3, 1e-6])
def test_features_of_micrometres_and_nanometres(height: float) -> None:
    """A bump between two straight runs of 20 mm: two S-curves, and next to nothing on the bump itself."""
    run = np.concatenate([[20.0, 10.0, 5.0], 2.5 * 0.3 ** np.arange(14)])
    run = run[run > 3.0 * height]
    x = np.concatenate([-run, height * np.arange(-2.0, 3.0), run[::-1]])
    points = np.stack([x, np.where(np.abs(x) < 0.5 * height, height, 0.0)], axis=1)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    knots = np.concatenate([[s[0]] * 4, np.convolve(s, np.ones(3) / 3.0, "valid")[1:-1], [s[-1]] * 4])
    curve = NurbsCurve(points, knots, 3)
    profile = plan_feedrate(curve, plane())
    assert profile.stats["slowdown"] < 1.002
    assert check(curve, plane(), profile).ok
    assert profile.duration == pytest.approx(2.0 * s_curve_time(20.0, 100.0, 1000.0, 20000.0), rel=0.04)


@pytest.mark.parametrize("method", ["optimal", "nlp"])
def test_a_plan_may_continue_another_one(method: str) -> None:
    """From 50 mm/s at 400 mm/s^2: up to 100 mm/s and down to rest, in closed form."""
    curve = line(30.0)
    profile = plan_feedrate(
        curve,
        plane(),
        method=method,
        start_feed=50.0,
        start_acceleration=400.0,
        intervals=400,  # type: ignore[arg-type]
    )
    assert profile.feed[0] == pytest.approx(50.0, rel=1e-9)
    assert profile.acceleration[0] == pytest.approx(400.0, rel=1e-9)
    assert check(curve, plane(), profile).ok
    # rise: jerk 20000 from 400 to a, then back to 0; feed gained (a^2 - 400^2) / 2J + a^2 / 2J = 50
    peak = np.sqrt(20000.0 * 50.0 + 0.5 * 400.0**2)
    up, down = (peak - 400.0) / 20000.0, peak / 20000.0
    gained = 50.0 * up + 200.0 * up**2 + 20000.0 * up**3 / 6.0
    feed = 50.0 + 400.0 * up + 10000.0 * up**2
    gained += feed * down + 0.5 * peak * down**2 - 20000.0 * down**3 / 6.0
    exact = up + down + (30.0 - gained - 7.5) / 100.0 + 0.15
    assert exact * (1.0 - 1e-6) <= profile.duration <= exact * 1.0005


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start_feed": 10.0, "start_acceleration": np.inf}, "start_acceleration = inf mm/s^2 must be finite"),
        ({"start_acceleration": 10.0}, "start_acceleration needs a start_feed > 0"),
        ({"start_feed": 10.0, "start_acceleration": 1.0, "method": "scurve"}, "kept by the methods optimal and nlp"),
    ],
)
def test_start_accelerations_that_are_not_allowed(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        plan_feedrate(line(30.0), plane(), **options)


def test_an_axis_without_a_jerk_limit_may_begin_beside_one_that_has_it() -> None:
    """Y moves first and has none: little is lost against the bound without any, and nothing is exceeded."""
    ellipse = FormulaCurve({"X": "30*cos(u)", "Y": "10*sin(u)"}, (0.0, 2.0 * np.pi))
    limits = plane(jerk=[20000.0, np.inf])
    profile = plan_feedrate(ellipse, limits)
    assert profile.duration < 1.015 * profile.lower_bound
    assert check(ellipse, limits, profile).ok


def test_corners_without_any_jerk_limit_are_left_at_full_acceleration() -> None:
    limits = plane(jerk=[np.inf] * 2)
    profile = plan_feedrate(square(20.0), limits, intervals=400)
    report = check(square(20.0), limits, profile)
    assert report.ok, str(report)
    assert profile.duration == pytest.approx(4.0 * (20.0 / 100.0 + 100.0 / 1000.0), rel=2e-3)
    half = plane(jerk=[np.inf, 20000.0])
    assert not check(square(20.0), half, profile).ok


def test_a_round_that_fails_leaves_the_plan_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver gives up in the second round: the first one's plan, slowed down, and the reason."""
    curve, limits = load_curve("butterfly", scale=10.0), plane()
    whole = plan_feedrate(curve, limits, intervals=300)
    assert whole.stats["rounds"] > 1
    solve, calls = optimal.solve, []

    def failing(*args: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) == 3:  # coarse, fine, and the round after it
            raise SolverError("planted")
        return solve(*args, **options)

    monkeypatch.setattr(optimal, "solve", failing)
    profile = plan_feedrate(curve, limits, intervals=300)
    assert profile.stats["rounds"] == 1
    assert any(n.startswith("refinement ended after 1 rounds") and "planted" in n for n in profile.stats["notes"])
    assert whole.duration < profile.duration < 1.02 * whole.duration
    assert check(curve, limits, profile).ok


# ---- more intervals, and what is said of a plan ----------------------------------------------------------------------


def grid_cases() -> dict[str, tuple[Curve, Limits]]:
    found = {
        f"{name} {feed:g}": (load_curve(name, scale=scale), plane(feed))
        for name, scale in OPTIMA
        for feed in (100.0, 300.0)
    }
    free = Limits(250.0, [np.inf] * 2, [2000.0] * 2, [20000.0] * 2)
    found["butterfly-nurbs 250"] = load_curve("butterfly-nurbs"), free
    found["flank"] = load_curve("flank"), load_limits("five-axis")
    slots = read_program(Path(__file__).parent / "data" / "programs" / "slots.ngc")
    found["slots"] = program_path(slots, 0.01, plane()).curve, plane()
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
    profile = plan_feedrate(curve, plane(), intervals=60)
    assert profile.stats["slowdown"] > 1.01
    assert profile.stats["status"].startswith("slowed down by")
    assert any("slowed down as a whole" in note for note in profile.stats["notes"])
    assert check(curve, plane(), profile).ok
    assert profile.shares().get("none", 0.0) < 0.8


@pytest.mark.parametrize("name", ["circle", "hypotrochoid"])
def test_an_axis_that_loses_its_jerk_limit_makes_no_plan_slower(name: str) -> None:
    """Beside an axis that keeps its own; from stop to stop the free one leaves on a ramp of half a period."""
    curve = load_curve(name, scale=1.0 if name == "circle" else 10.0)
    durations = [plan_feedrate(curve, plane(jerk=[20000.0, free])).duration for free in (2e4, 1e5, 1e6, np.inf)]
    assert (np.diff(durations) <= 1e-5 * durations[0]).all(), durations


def test_the_true_chord_error_is_kept_at_a_near_cusp() -> None:
    """Turned back within less than a period's way: the osculating circle allows what leaves the path by 42 times more."""
    data = Path(__file__).parent / "data" / "curves"
    curve, limits = load_curve(data / "seed109.json"), load_limits(data / "seed109.toml")
    profile = plan_feedrate(curve, limits)
    row = check(curve, limits, profile).row("chord error")
    assert row.ok
    assert row.ratio > 0.9
    assert profile.stats["slowdown"] > 1.1
    assert any("for its chord error" in note for note in profile.stats["notes"])


def test_a_plan_that_keeps_its_chord_error_is_left_as_it_is() -> None:
    curve = load_curve("butterfly", scale=10.0)
    limits = plane(chord_error=1e-4)
    profile = plan_feedrate(curve, limits, intervals=400)
    assert not any("chord error" in note for note in profile.stats["notes"])
    assert check(curve, limits, profile).ok
