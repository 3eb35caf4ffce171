"""The ends of a plan: feeds, accelerations, stops, seams of closed paths, and what is refused there."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from cases import line, line_into_arc, mill, s_curve_time, square, worst

from interp import replay
from planner import Curve, InfeasibleError, InputError, Limits, SolverError, check, load_curve, plan_feedrate
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.plan.solvers import interior as optimal
from planner.status import Status


def test_corners_become_exact_stops() -> None:
    curve = square(20.0)
    profile = plan_feedrate(curve, mill())
    assert profile.duration == pytest.approx(4.0 * s_curve_time(20.0, 100.0, 1000.0, 20000.0), rel=1e-4)
    assert sum("exact stop" in note for note in profile.notes) == 3
    worst(curve, mill(), profile)


def test_a_plan_of_s_curves_counts_the_intervals_of_its_sides_and_claims_no_bound() -> None:
    """Two nodes share each of the three corners of the four sides."""
    profile = plan_feedrate(square(20.0), mill(), method="scurve")
    assert profile.status is Status.FEASIBLE
    assert profile.work.intervals == np.count_nonzero(np.diff(profile.t)) == profile.t.size - 4
    assert np.isnan(profile.lower_bound)


def test_a_curvature_jump_is_passed_slowly_enough_for_the_samples() -> None:
    curve, limits = line_into_arc(), mill()
    profile = plan_feedrate(curve, limits)
    assert any("curvature jumps" in note for note in profile.notes)
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
    profile = plan_feedrate(line_into_arc(), mill(), exact_stop=True)
    assert profile.feed[profile.u == 1.0].max() == 0.0
    assert any("exact stop at u = 1" in note for note in profile.notes)
    worst(line_into_arc(), mill(), profile)


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
    profile = plan_feedrate(curve, mill(), start_feed=50.0, end_feed=20.0)
    assert profile.feed[[0, -1]] == pytest.approx([50.0, 20.0], rel=1e-9)
    assert profile.duration < plan_feedrate(curve, mill()).duration
    worst(curve, mill(), profile)
    worst(curve, mill(), replay(curve, profile))


def test_a_closed_path_runs_on_without_a_stop() -> None:
    curve = load_curve("circle")
    profile = plan_feedrate(curve, mill(), periodic=True)
    assert profile.duration == pytest.approx(curve.length / 100.0, rel=1e-5)
    assert profile.feed[0] == pytest.approx(profile.feed[-1], rel=1e-9)
    worst(curve, mill(), replay(curve, profile))


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
        plan_feedrate(line(1.0), mill(), **changes)  # type: ignore[arg-type]


def test_a_reserve_is_left_unused_from_its_parameter_on() -> None:
    curve, limits = load_curve("butterfly", scale=10.0), mill()
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
    profile = plan_feedrate(square(20.0), mill())
    double = np.flatnonzero(np.diff(profile.t) == 0.0)
    assert profile.u[double].tolist() == profile.u[double + 1].tolist() == [1.0, 2.0, 3.0]
    assert profile.t[double] == pytest.approx(profile.duration * np.array([0.25, 0.5, 0.75]), rel=1e-4)
    assert (np.diff(profile.t) >= 0.0).all()
    whole, four = square(20.0), plan_feedrate(square(20.0), mill(), intervals=1000)
    sides = [
        plan_feedrate(NurbsCurve(whole.control_points[k : k + 2], [k, k, k + 1, k + 1], 1), mill(), intervals=250)
        for k in range(4)
    ]
    assert four.duration == pytest.approx(sum(side.duration for side in sides), rel=1e-14)
    # alike within what 250 intervals are above the optimum: where rounding moves a knot, so does what is tightened
    assert four.duration == pytest.approx(4.0 * sides[0].duration, rel=3e-6)
    assert four.lower_bound == pytest.approx(sum(side.lower_bound for side in sides), rel=1e-12)
    for key in ("intervals", "iterations"):
        assert getattr(four.work, key) == sum(getattr(side.work, key) for side in sides)
    assert sum(four.saved_by_one_percent.values()) == pytest.approx(
        sum(sum(side.saved_by_one_percent.values()) for side in sides), rel=1e-12
    )
    assert (four.work.sections, four.origin.periodic, four.origin.exact_stop) == (4, False, False)


def test_an_entry_feed_that_cannot_be_braked_is_infeasible() -> None:
    with pytest.raises(InfeasibleError, match="start_feed = 100 to end_feed = 0"):
        plan_feedrate(line(1.0), mill(), start_feed=100.0)


def test_limits_that_limit_nothing_are_refused() -> None:
    with pytest.raises(InfeasibleError, match="nothing limits the feed"):
        plan_feedrate(line(1.0), Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2))


def test_limits_of_another_number_of_axes_are_refused() -> None:
    with pytest.raises(InputError, match="the limits have 2 axes"):
        plan_feedrate(load_curve("flank"), mill())


def test_a_kinked_seam_cannot_be_periodic() -> None:
    with pytest.raises(InputError, match="smooth seam"):
        plan_feedrate(load_curve("teardrop"), mill(), periodic=True)


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
        plan_feedrate(racetrack(), mill(), periodic=True)


def test_a_gap_is_measured_by_the_size_of_the_path_wherever_it_lies() -> None:
    """A circle of 10 mm, 1e6 mm from the origin: closed to a digit there, or open by 1e-7 mm, ten times what may be."""
    circle = {"X": "1e6+10*cos(u)", "Y": "2e6+10*sin(u)"}
    with pytest.raises(InputError, match=r"needs a closed curve; the ends of formula are 9\.99e-08 apart"):
        plan_feedrate(FormulaCurve(circle, (0.0, 2.0 * np.pi - 1e-8)), mill(), periodic=True)
    curve = FormulaCurve(circle, (0.0, 2.0 * np.pi))
    assert plan_feedrate(curve, mill(), periodic=True).duration == pytest.approx(curve.length / 100.0, rel=1e-5)


def test_a_closed_path_with_a_corner_cannot_be_periodic() -> None:
    square = NurbsCurve(
        [[5, 0], [10, 0], [10, 10], [0, 10], [0, 0], [5, 0]], [0, 0, 1, 2, 3, 4, 5, 5], 1, name="square"
    )
    with pytest.raises(InputError, match="cannot pass the exact stop of square at u = 1"):
        plan_feedrate(square, mill(), periodic=True)


def test_a_periodic_plan_needs_no_jerk_limit() -> None:
    curve, limits = load_curve("circle"), mill(jerk=[np.inf] * 2)
    profile = plan_feedrate(curve, limits, periodic=True)
    assert check(curve, limits, profile).ok
    assert profile.duration == pytest.approx(curve.length / limits.feed, rel=1e-5)


@pytest.mark.parametrize("end", [1e-5, 1e-3, 1e-2, 0.1, 1.0])
def test_a_plan_with_feeds_at_its_ends_keeps_its_limits_or_is_an_error(end: float) -> None:
    curve = FormulaCurve({"X": "60*u", "Y": "20*sin(3*u)"}, (0.0, 2.0))
    try:
        profile = plan_feedrate(curve, mill(), start_feed=10.0, end_feed=end)
    except (InfeasibleError, SolverError):  # said, not silently exceeded
        assert end <= 0.01
    else:
        worst(curve, mill(), profile)


def test_progress_is_a_share() -> None:
    said: list[tuple[str, float | None]] = []
    plan_feedrate(square(20.0), mill(), progress=lambda text, share: said.append((text, share)))
    shares = [share for _, share in said]
    assert all(share is None or 0.0 <= share <= 1.0 for share in shares)
    assert [entry for entry in said if entry[0].startswith("section")] == [
        (f"section {k + 1} of 4", pytest.approx(0.25 * k)) for k in range(4)
    ]


@pytest.mark.parametrize("method", ["optimal", "nlp"])
def test_a_plan_may_continue_another_one(method: str) -> None:
    """From 50 mm/s at 400 mm/s^2: up to 100 mm/s and down to rest, in closed form."""
    curve = line(30.0)
    profile = plan_feedrate(
        curve,
        mill(),
        method=method,
        start_feed=50.0,
        start_acceleration=400.0,
        intervals=400,  # type: ignore[arg-type]
    )
    assert profile.feed[0] == pytest.approx(50.0, rel=1e-9)
    assert profile.acceleration[0] == pytest.approx(400.0, rel=1e-9)
    assert check(curve, mill(), profile).ok
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
        plan_feedrate(line(30.0), mill(), **options)


@pytest.mark.parametrize("given", [1000.0, -1000.0, 5000.0])
def test_a_start_acceleration_beyond_an_axis_names_it(given: float) -> None:
    """On the line of 30 mm along X all of it is the axis'."""
    with pytest.raises(
        InfeasibleError, match=rf"start_acceleration = {given:g} mm/s\^2 at 50 mm/s takes .* of acceleration X"
    ):
        plan_feedrate(line(30.0), mill(), start_feed=50.0, start_acceleration=given)
    with pytest.raises(InfeasibleError, match="must stay below the tangential acceleration, 300 mm"):
        plan_feedrate(line(30.0), mill(tangential_acceleration=300.0), start_feed=50.0, start_acceleration=given)
    assert plan_feedrate(line(30.0), mill(), start_feed=50.0, start_acceleration=999.99).duration > 0.0


def test_a_start_acceleration_counts_with_the_curvature() -> None:
    """On a circle of 20 mm, where the tangent is at 45 degrees: X takes (500 + 80^2 / 20) / sqrt 2."""
    circle = FormulaCurve({"X": "20*cos(u)", "Y": "20*sin(u)"}, (0.25 * np.pi, 3.0))
    limits = mill(acceleration=[550.0, 1000.0])
    with pytest.raises(InfeasibleError, match=r"takes 579.827\d* of acceleration X, which must stay below 550"):
        plan_feedrate(circle, limits, start_feed=80.0, start_acceleration=500.0)


@pytest.mark.parametrize(
    "options", [{"intervals": "100"}, {"intervals": 100.5}, {"intervals": True}, {"start_feed": "5"}]
)
def test_numbers_of_another_kind_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(options))} = "):
        plan_feedrate(line(30.0), mill(), **options)


def test_an_axis_without_a_jerk_limit_may_begin_beside_one_that_has_it() -> None:
    """Y moves first and has none: little is lost against the bound without any, and nothing is exceeded."""
    ellipse = FormulaCurve({"X": "30*cos(u)", "Y": "10*sin(u)"}, (0.0, 2.0 * np.pi))
    limits = mill(jerk=[20000.0, np.inf])
    profile = plan_feedrate(ellipse, limits)
    assert profile.duration < 1.015 * profile.lower_bound
    assert check(ellipse, limits, profile).ok


def test_corners_without_any_jerk_limit_are_left_at_full_acceleration() -> None:
    limits = mill(jerk=[np.inf] * 2)
    profile = plan_feedrate(square(20.0), limits, intervals=400)
    report = check(square(20.0), limits, profile)
    assert report.ok, str(report)
    assert profile.duration == pytest.approx(4.0 * (20.0 / 100.0 + 100.0 / 1000.0), rel=2e-3)
    half = mill(jerk=[np.inf, 20000.0])
    assert not check(square(20.0), half, profile).ok


def test_a_round_that_fails_leaves_the_plan_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver gives up in the second round: the first one's plan, slowed down, and the reason."""
    curve, limits = load_curve("butterfly", scale=10.0), mill()
    whole = plan_feedrate(curve, limits, intervals=500)
    assert whole.work.rounds > 1
    solve = optimal.solve_interior

    def failing(problem: Any, start: Any, **options: Any) -> Any:
        if isinstance(start, optimal.Waypoint):  # as rounds after the first begin
            raise SolverError("planted")
        return solve(problem, start, **options)

    monkeypatch.setattr(optimal, "solve_interior", failing)
    profile = plan_feedrate(curve, limits, intervals=500)
    assert profile.work.rounds == 1
    assert any(n.startswith("refinement ended after 1 rounds") and "planted" in n for n in profile.notes)
    assert whole.duration < profile.duration < 1.02 * whole.duration
    assert check(curve, limits, profile).ok
