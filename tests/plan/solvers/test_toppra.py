"""Plans without a jerk limit by toppra: closed forms, a pointwise bound, and what every jerk-limited plan exceeds."""

import numpy as np
import pytest
from cases import FEEDS, OPTIMA, drives, ellipse, line, mill, velocity_time
from strategies import random_nurbs

from planner import load_curve
from planner.errors import FeedrateError
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.verify import check

INF = np.inf
JERKS = {
    "jerk",
    "jerk at a curvature break",
    "acceleration step",
    "step on a smooth path",
    "tangential jerk",
}


def without_jerk(curve, limits, **options):
    return plan_feedrate(curve, limits, method="toppra", **options)


def keeps_all_but_jerk(curve, limits, profile):
    kinds = {row.limit for row in check(curve, limits, profile).violations}
    return kinds <= JERKS


@pytest.mark.parametrize("length", [1e-6, 1.0, 9.9, 10.1, 200.0, 1e6])
def test_a_line_is_run_by_the_trapezoid(length):
    exact = 2.0 * np.sqrt(length / 1000.0) if length < 10.0 else length / 100.0 + 0.1
    profile = without_jerk(line(length), drives())
    assert profile.duration == pytest.approx(exact, rel=1e-4)
    assert keeps_all_but_jerk(line(length), drives(), profile)
    assert profile.feed.max() == pytest.approx(min(100.0, np.sqrt(1000.0 * length)), rel=1e-3)


def test_feeds_at_the_ends_of_a_line():
    profile = without_jerk(line(50.0), drives(), start_feed=60.0, end_feed=20.0)
    way = (100.0**2 - 60.0**2 + 100.0**2 - 20.0**2) / 2000.0
    assert profile.duration == pytest.approx(0.04 + 0.08 + (50.0 - way) / 100.0, rel=1e-6)
    assert profile.feed[[0, -1]] == pytest.approx([60.0, 20.0], rel=1e-12)


def test_the_ends_that_no_plan_joins_are_infeasible():
    with pytest.raises(FeedrateError):
        without_jerk(line(1.0), drives(), start_feed=90.0)


def test_velocities_alone_are_used_up_everywhere():
    """With nothing but velocity limits the time is the integral of the slowest axis' share."""
    curve = ellipse()
    limits = Limits(INF, [60.0, 25.0], [INF] * 2, [INF] * 2)
    exact = velocity_time(30.0, 10.0, 60.0, 25.0)
    assert without_jerk(curve, limits).duration == pytest.approx(exact, rel=3e-3)


@pytest.mark.parametrize(("name", "scale"), OPTIMA)
def test_reference_times(name, scale):
    for feed, time in zip(FEEDS, OPTIMA[name, scale].without_jerk, strict=True):
        limits = mill(feed)
        profile = without_jerk(load_curve(name, scale=scale), limits)
        assert profile.duration == pytest.approx(time, rel=2e-3)
        assert profile.lower_bound == pytest.approx(time, rel=2e-3)
        assert keeps_all_but_jerk(profile.curve, limits, profile)


@pytest.mark.parametrize("seed", range(6))
def test_no_plan_with_a_jerk_limit_is_faster(seed):
    rng = np.random.default_rng(seed)
    curve = random_nurbs(seed, int(rng.integers(2, 5)), 3, spans=3)
    limits = Limits(150.0, rng.uniform(50, 300, 3), rng.uniform(500, 2000, 3), rng.uniform(1e4, 5e4, 3))
    bound = without_jerk(curve, limits)
    assert keeps_all_but_jerk(curve, limits, bound)
    assert bound.lower_bound <= bound.duration
    plan = plan_feedrate(curve, limits)
    assert bound.lower_bound * (1.0 - 1e-4) <= plan.duration
    # the bound of a plan knows the jerk limit: it lies above the optimum without one, but for its own coarseness
    assert bound.lower_bound * (1.0 - 2e-3) <= plan.lower_bound <= plan.duration


def test_the_limit_of_a_high_jerk_is_the_plan_without_one():
    curve = load_curve("teardrop")
    reference = without_jerk(curve, drives()).duration
    times = [plan_feedrate(curve, drives(jerk=jerk)).duration for jerk in (1e5, 1e6, 1e7)]
    assert times == sorted(times, reverse=True)
    assert times[-1] == pytest.approx(reference, rel=1e-3)
    assert times[-1] > reference * (1.0 - 1e-4)


def test_toppra_is_a_method_to_compare_with():
    """It plans on its own grid points alone and is slowed down for what it exceeds between them."""
    curve, limits = load_curve("butterfly-nurbs"), drives(jerk=INF)
    own, theirs = (plan_feedrate(curve, limits, method=method) for method in ("optimal", "toppra"))
    assert own.duration < theirs.duration < 1.05 * own.duration
    assert theirs.method == "toppra"
    assert check(curve, limits, theirs).ok


def test_a_tangential_jerk_alone_is_a_jerk_limit():
    limits = drives(jerk=INF, tangential_jerk=5000.0)
    profile = plan_feedrate(line(60.0), limits)
    assert not any("no jerk limit" in note for note in profile.notes)
    assert check(line(60.0), limits, profile).ok
    assert np.abs(profile.jerk).max() == pytest.approx(5000.0, rel=1e-4)


def test_knots_in_a_hurry_or_far_apart_change_nothing():
    """A parameter of the order of micrometres or kilometres a second would mislead a solver that sees it."""
    curve = load_curve("circle")
    reference = without_jerk(curve, drives()).duration
    for factor in (1e-6, 1e6):
        moved = NurbsCurve(curve.control_points, factor * curve.knots, curve.degree, curve.weights)
        assert without_jerk(moved, drives()).duration == pytest.approx(reference, rel=1e-6)


def test_corners_are_stops():
    corners = [[0.0, 0.0], [20.0, 0.0], [20.0, 7.0]]
    profile = without_jerk(NurbsCurve(corners, [0, 0, 1, 2, 2], 1), drives())
    assert profile.duration == pytest.approx(0.3 + 2.0 * np.sqrt(7.0 / 1000.0), rel=1e-5)
    assert profile.feed[profile.u == 1.0].max() == 0.0


def test_a_rotary_axis_turns_while_the_tip_rests():
    curve = NurbsCurve([[5, 5, 0], [5, 5, 1]], [0, 0, 1, 1], 1, axes=["X", "Y", "A"])
    limits = Limits(100.0, [250, 250, 2], [1000, 1000, 10], [INF] * 3, axes=["X", "Y", "A"])
    assert without_jerk(curve, limits).duration == pytest.approx(0.5 + 0.2, rel=1e-5)


def test_more_intervals_come_closer():
    curve = load_curve("teardrop")
    times = [without_jerk(curve, drives(300.0), intervals=n).duration for n in (100, 400, 3000)]
    assert abs(times[1] - times[2]) < abs(times[0] - times[2]) + 1e-9
    assert times[2] == pytest.approx(0.8506, rel=2e-4)


def test_tangential_acceleration_counts_too():
    limits = drives(tangential_acceleration=250.0)
    assert without_jerk(line(100.0), limits).duration == pytest.approx(1.0 + 0.4, rel=1e-5)
    curve = load_curve("teardrop")
    profile = without_jerk(curve, limits)
    assert keeps_all_but_jerk(curve, limits, profile)
    assert profile.duration > without_jerk(curve, drives()).duration
    assert profile.duration < plan_feedrate(curve, limits).duration
