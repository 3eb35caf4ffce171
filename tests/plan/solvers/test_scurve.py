"""S-curves between the feed minima: closed forms on lines, every limit on curves, and how far from the optimum."""

from functools import cache

import numpy as np
import pytest
from cases import FEEDS, MILL, OPTIMA, drives, line, line_arc_line
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from strategies import random_nurbs

from planner import load_curve
from planner.errors import InfeasibleError, InputError
from planner.geometry.fiveaxis import DualSplineCurve
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.feed_limits import feedrate_limits
from planner.machine.limits import Limits
from planner.machine.machine_file import load_limits
from planner.plan.solvers.arcpath import used_exactly
from planner.plan.solvers.scurve import plan_scurve
from planner.profile import make_profile
from planner.verify import check

# What these S-curves take at each of FEEDS, s.
TIMES = {
    ("teardrop", 1.0): (1.1489, 0.9455),
    ("butterfly", 10.0): (4.3959, 3.6429),
    ("hypotrochoid", 10.0): (7.2161, 3.8288),
    ("snailshell", 10.0): (1.9035, 1.7173),
    ("circle", 1.0): (3.3010, 1.7287),
}


def plan(curve, limits, start_feed=0.0, end_feed=0.0):
    nodes = plan_scurve(curve, limits, *curve.domain, start_feed, end_feed)
    return make_profile(curve, limits, TimeLaw(*nodes), method="scurve")


def duration(curve, limits, start_feed=0.0, end_feed=0.0):
    return plan_scurve(curve, limits, *curve.domain, start_feed, end_feed)[0][-1]


def ramp_time(change, acceleration, jerk):
    """Least time for a change of feed, no acceleration at either end."""
    full = acceleration**2 / jerk
    return change / acceleration + acceleration / jerk if change >= full else 2.0 * np.sqrt(change / jerk)


def shortest_time(length, v0, v1, feed, acceleration, jerk):
    """Least time over a length from feed v0 to v1: two ramps and a cruise, the rise above the faster end by bisection."""
    faster, apart = max(v0, v1), abs(v1 - v0)

    def ramps(rise):
        changes = np.array([rise, rise + apart])
        times = np.array([ramp_time(change, acceleration, jerk) for change in changes])
        return times.sum(), float(np.sum((faster + rise - 0.5 * changes) * times))

    time, covered = ramps(feed - faster)
    if covered <= length:
        return time + (length - covered) / feed
    lo, hi = 0.0, feed - faster
    for _ in range(200):
        rise = 0.5 * (lo + hi)
        lo, hi = (lo, rise) if ramps(rise)[1] > length else (rise, hi)
    time, covered = ramps(lo)
    return time + (length - covered) / (faster + lo)


# ---- lines: the closed form ----------------------------------------------------------------------------------------


# 1 nm and 2 mm reach neither acceleration nor feed, 8 mm reaches the acceleration, 40 mm the feed.
@pytest.mark.parametrize("length", [1e-6, 2.0, 8.0, 40.0, 1e4])
def test_line_takes_the_time_of_the_closed_form(length):
    profile = plan(line(length, 0.0), MILL)
    assert profile.duration == pytest.approx(shortest_time(length, 0, 0, 100.0, 1000.0, 20000.0), rel=1e-9)
    assert check(profile.curve, MILL, profile, tolerance=1e-9).ok
    assert profile.t.size <= 8


def test_line_of_a_hundred_kilometres():
    curve = line(1e8, 0.0)
    nodes = plan_scurve(curve, MILL, 0.0, 1.0, 0.0, 0.0)
    assert nodes[0][-1] == pytest.approx(shortest_time(1e8, 0, 0, 100.0, 1000.0, 20000.0), rel=1e-12)
    assert used_exactly(curve, MILL, nodes)[0].max() <= 1.0 + 1e-9


rates = st.floats(0.1, 1e4)


@given(
    st.lists(st.sampled_from([-90.0, -3.0, 0.0, 0.01, 7.0, 60.0]), min_size=2, max_size=4).filter(any),
    st.tuples(rates, rates, rates, rates),
    st.floats(0.0, 0.9),
    st.floats(0.0, 0.9),
)
@example([-90.0, -90.0], (217.0, 153.0, 0.5, 3.0), 0.5, 0.5)  # rounding takes it 1e-9 above its jerk limit
@example([-90.0, -90.0], (314.0, 223.0, 0.5, 7.0), 0.5, 0.5)  # 3e-8
@example([-90.0, -90.0], (652.0, 462.0, 0.5, 31.0), 0.5, 0.5)  # 6e-7, what Ruckig ends off shared out over the phases
@example([-90.0, -90.0], (992.0, 899.0, 0.5, 20.0), 0.5, 0.5)  # 1.4e-6
def test_any_line_with_any_entry_and_exit_feed(end, bounds, start_share, end_share):
    feed, *per_axis = bounds
    limits = Limits(feed, *([bound * (1.0 + j) for j in range(len(end))] for bound in per_axis))
    direction, length = np.abs(end) / np.linalg.norm(end), np.linalg.norm(end)
    moving = direction > 0.0
    top, a, j = ((row[moving] / direction[moving]).min() for row in (limits.velocity, limits.acceleration, limits.jerk))
    top = min(top, feed)
    v0, v1 = start_share * top, end_share * top
    assume(0.5 * (v0 + v1) * ramp_time(abs(v1 - v0), a, j) <= 0.99 * length)
    assert duration(line(*end), limits, v0, v1) == pytest.approx(shortest_time(length, v0, v1, top, a, j), rel=1e-9)


def test_tangential_limits_hold_a_line_and_a_circle_back():
    limits = Limits(
        100.0, [250.0] * 2, [1000.0] * 2, [20000.0] * 2, tangential_acceleration=300.0, tangential_jerk=5000.0
    )
    expected = shortest_time(10.0, 0, 0, 100.0, 300.0, 5000.0)
    assert duration(line(6.0, 8.0), limits) == pytest.approx(expected, rel=1e-9)
    profile = plan(load_curve("circle"), limits)
    assert check(profile.curve, limits, profile, tolerance=1e-9).ok
    assert profile.duration == pytest.approx(shortest_time(100.0 * np.pi, 0, 0, 100.0, 300.0, 5000.0), rel=5e-3)


def test_line_without_some_limits():
    no_acceleration = drives(acceleration=np.inf)
    assert duration(line(40.0, 0.0), no_acceleration) == pytest.approx(0.4 + ramp_time(100.0, 1e9, 20000.0), rel=1e-9)
    no_feed = Limits(np.inf, [np.inf] * 2, [1000.0] * 2, [20000.0] * 2)
    assert duration(line(40.0, 0.0), no_feed) == pytest.approx(
        shortest_time(40.0, 0, 0, 1e6, 1000.0, 20000.0), rel=1e-9
    )
    # Without a jerk limit the acceleration builds up within a period.
    no_jerk = drives(jerk=np.inf)
    assert duration(line(40.0, 0.0), no_jerk) == pytest.approx(0.4 + 100.0 / 1000.0 + 1e-3, rel=1e-9)


# ---- curves ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", range(len(FEEDS)))
@pytest.mark.parametrize(("name", "scale"), TIMES)
def test_curves_hold_every_limit_within_reach_of_the_optimum(name, scale, k):
    optimum, measured = OPTIMA[name, scale].with_jerk[k], TIMES[name, scale][k]
    limits = MILL.with_feed(FEEDS[k])
    profile = plan(load_curve(name, scale=scale), limits)
    report = check(profile.curve, limits, profile, tolerance=1e-9)
    assert report.ok, str(report)
    assert optimum * (1.0 - 1e-4) <= profile.duration <= 1.02 * measured
    assert profile.duration <= 1.12 * optimum


def test_circle_at_a_feed_the_bend_allows_loses_only_at_its_ends():
    assert duration(load_curve("circle"), MILL) <= 1.01 * OPTIMA["circle", 1.0].with_jerk[0]


def test_five_axis_path_holds_every_limit():
    limits = load_limits("five-axis")
    profile = plan(load_curve("flank"), limits)
    report = check(profile.curve, limits, profile, tolerance=1e-9)
    assert report.ok, str(report)
    assert 8.03 <= profile.duration <= 1.02 * 10.476


def test_nurbs_with_radii_of_hundredths_of_a_millimetre_holds_every_limit():
    limits = Limits(250.0, [250.0] * 2, [2000.0] * 2, [20000.0] * 2)
    profile = plan(load_curve("butterfly-nurbs"), limits)
    report = check(profile.curve, limits, profile, tolerance=1e-9)
    assert report.ok, str(report)
    assert 4.56 <= profile.duration <= 1.02 * 5.787


@pytest.mark.parametrize(("seed", "degree", "dim"), [(1, 2, 2), (2, 3, 3), (3, 4, 2), (4, 5, 4)])
def test_random_nurbs_hold_every_limit(seed, degree, dim):
    curve = random_nurbs(seed, degree, dim, repeat=degree - 1)
    limits = Limits(150.0, [250.0] * dim, [1000.0] * dim, [20000.0] * dim, 1e-3)
    profile = plan(curve, limits)
    report = check(curve, limits, profile, tolerance=1e-8)
    assert report.ok, str(report)


def test_plan_sped_up_by_half_a_percent_fails_the_check():
    curve = load_curve("teardrop")
    t, u, rate, acceleration = plan_scurve(curve, MILL.with_feed(300.0), 0.0, 1.0, 0.0, 0.0)
    faster = t / 1.005, u, rate * 1.005, acceleration * 1.005**2
    assert not check(curve, MILL.with_feed(300.0), make_profile(curve, MILL, TimeLaw(*faster), method="scurve")).ok
    assert used_exactly(curve, MILL.with_feed(300.0), faster)[0].max() > 1.004


def test_own_measure_agrees_with_the_independent_check():
    curve, limits = load_curve("hypotrochoid", scale=10.0), MILL
    profile = plan(curve, limits)
    nodes = profile.t, profile.u, profile.u_rate, profile.u_acceleration
    used = used_exactly(curve, limits, nodes)[0].max()
    rows = [
        row.ratio for row in check(curve, limits, profile).rows if row.limit in {"velocity", "acceleration", "jerk"}
    ]
    assert used == pytest.approx(max(rows), abs=2e-5)


def test_nodes_follow_the_path_and_double_where_the_parametrisation_jumps():
    curve = load_curve("circle")
    t, u, rate, acceleration = plan_scurve(curve, MILL, *curve.domain, 0.0, 0.0)
    assert (t[0], u[0], u[-1]) == (0.0, *curve.domain)
    assert (np.diff(t) >= 0.0).all()
    assert (np.diff(u) >= 0.0).all()
    assert rate[0] == rate[-1] == acceleration[0] == acceleration[-1] == 0.0
    double = np.flatnonzero(np.diff(t) == 0.0)
    np.testing.assert_array_equal(u[double], u[double + 1])
    jumping = [b.u for b in curve.breaks if b.parametric < 2]
    np.testing.assert_array_equal(u[double], jumping)


def test_section_of_a_path_with_a_corner():
    curve = NurbsCurve([[0, 0], [10, 0], [10, 5]], [0, 0, 0.5, 1, 1], 1, name="corner")
    for ends, length in (((0.0, 0.5), 10.0), ((0.5, 1.0), 5.0)):
        t, u, rate, _ = plan_scurve(curve, MILL, *ends, 0.0, 0.0)
        assert t[-1] == pytest.approx(shortest_time(length, 0, 0, 100.0, 1000.0, 20000.0), rel=1e-9)
        assert (u[0], u[-1], rate[0], rate[-1]) == (*ends, 0.0, 0.0)
    with pytest.raises(InputError, match=r"corner at u = 0\.5 must be an exact stop"):
        plan_scurve(curve, MILL, 0.0, 1.0, 0.0, 0.0)


# ---- curvature jumps -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [1e-3, 4e-3])
def test_curvature_jump_is_passed_at_the_feed_its_step_allows(period):
    curve, limits = line_arc_line(), MILL.with_period(period).with_feed(200.0)
    profile = plan(curve, limits)
    report = check(curve, limits, profile, tolerance=1e-9)
    assert report.ok, str(report)
    # The step |dk| v^2 with dk = 1/10 mm may take 2/3 J T.
    allowed = min(np.sqrt(2.0 / 3.0 * 20000.0 * period * 10.0), 100.0)
    passed = profile.feed[np.isin(profile.u, [1.0, 2.0])]
    assert passed.max() <= allowed * (1.0 + 1e-9)
    assert passed.min() >= 0.8 * allowed


def test_jerk_is_halved_within_three_periods_of_a_curvature_jump():
    curve, limits = line_arc_line(), MILL
    profile = plan(curve, limits)
    times = profile.t[np.isin(profile.u, [1.0, 2.0])]
    assert np.unique(times).size == 2
    for passed in times:
        at = profile.at(passed + np.linspace(-2.99e-3, 2.99e-3, 400))
        inside = np.abs(at.t - passed) > 1e-9
        q = curve.derivatives(at.u, 3)
        u1, u2, u3 = (part[:, None] for part in (at.u_rate, at.u_acceleration, at.u_jerk))
        jerk = np.abs(q[3] * u1**3 + 3.0 * q[2] * u1 * u2 + q[1] * u3)
        assert jerk[inside].max() <= 0.5 * 20000.0 * (1.0 + 1e-6)


def test_neighbouring_curvature_jumps_share_the_step():
    # A quadratic spline jumps in curvature at every knot; the knots in the middle are passed within a few periods.
    rng = np.random.default_rng(5)
    points = np.column_stack([np.arange(9.0) * 6.0, rng.uniform(-5.0, 5.0, 9)])
    curve = NurbsCurve(points, [0, 0, 0, 1, 2, 2.02, 2.04, 3, 4, 5, 5, 5], 2, name="quadratic")
    profile = plan(curve, MILL)
    report = check(curve, MILL, profile, tolerance=1e-9)
    assert report.ok, str(report)


# ---- entry and exit feeds --------------------------------------------------------------------------------------------


def test_curve_entered_and_left_at_a_feed():
    curve, limits = load_curve("teardrop"), MILL.with_feed(300.0)
    profile = plan(curve, limits, 90.0, 60.0)
    assert profile.feed[[0, -1]] == pytest.approx([90.0, 60.0], rel=1e-12)
    assert profile.acceleration[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert check(curve, limits, profile, tolerance=1e-9).ok
    assert profile.duration < duration(curve, limits)


@pytest.mark.parametrize(("name", "feeds"), [("start_feed", (60.0, 0.0)), ("end_feed", (0.0, 60.0))])
def test_feed_too_fast_for_a_short_line_names_the_largest_allowed(name, feeds):
    # From rest over L the feed reaches v with L = v sqrt(v / J), where the acceleration is not reached.
    largest = (0.5**2 * 20000.0) ** (1.0 / 3.0)
    with pytest.raises(InfeasibleError, match=rf"{name} = 60 mm/s is too fast") as raised:
        duration(line(0.5, 0.0), MILL, *feeds)
    named = float(str(raised.value).split(" is ")[-1].split()[0])
    assert named == pytest.approx(largest, rel=1e-5)
    shares = np.array(feeds) / 60.0
    assert duration(line(0.5, 0.0), MILL, *(0.999 * named * shares)) > 0.0


def test_feed_above_the_limit_curve_names_the_largest_allowed():
    curve, limits = load_curve("circle"), MILL.with_feed(300.0)
    allowed = float(feedrate_limits(curve, limits, 0.0).lowest)
    with pytest.raises(InfeasibleError, match="start_feed = 230 mm/s is too fast") as raised:
        duration(curve, limits, 230.0, 0.0)
    named = float(str(raised.value).split(" is ")[-1].split()[0])
    assert 0.99 * allowed <= named <= allowed
    assert duration(curve, limits, 0.999 * named, 0.0) > 0.0


# ---- what does not depend on units -----------------------------------------------------------------------------------


def scaled(limits, length, time):
    rows = (limits.velocity * length / time, limits.acceleration * length / time**2, limits.jerk * length / time**3)
    return Limits(limits.feed * length / time, *rows, period=limits.period * time)


BEND = np.array([[0.0, 0.0], [8.0, 1.0], [9.0, 8.0], [20.0, 9.0]])


@cache
def bend_duration(length_unit, time_unit):
    limits = scaled(MILL.with_feed(300.0), length_unit, time_unit)
    return duration(NurbsCurve(BEND * length_unit, [0, 0, 0, 0, 1, 1, 1, 1], 3), limits)


@settings(max_examples=8)
@given(st.integers(-30, 30), st.integers(-20, 20))
def test_units_of_length_and_time_change_nothing_but_the_unit_of_time(length, time):
    # Powers of two scale without rounding, so that the search takes the same way.
    assert bend_duration(2.0**length, 2.0**time) == pytest.approx(2.0**time * bend_duration(1.0, 1.0), rel=1e-3)


# ---- input -----------------------------------------------------------------------------------------------------------


def test_tip_at_rest_is_refused_with_the_method_that_can():
    count = 12
    knots = [0.0] * 4 + list(np.linspace(0.0, 1.0, count - 2)[1:-1]) + [1.0] * 4
    tip = np.column_stack([np.minimum(np.arange(count), 5) + np.maximum(np.arange(count) - 9, 0), np.zeros((count, 2))])
    axis = np.column_stack([2.0 * np.arange(count), 10.0 + 3.0 * np.sin(np.arange(count)), np.full(count, 40.0)])
    bottom, top = (NurbsCurve(points, knots, 3, rests_allowed=True) for points in (tip, axis))
    curve = DualSplineCurve(bottom, top, "turning")
    limits = Limits(100.0, [100.0] * 3 + [1.0] * 2, [500.0] * 3 + [5.0] * 2, [3000.0] * 3 + [50.0] * 2)
    with pytest.raises(InputError, match=r'tip rests at u = .* use method = "optimal"'):
        duration(curve, limits)
    turning = FormulaCurve({"X": "10 + 0*u", "Y": "0*u", "C": "u"}, (0.0, 1.0), name="turntable")
    with pytest.raises(InputError, match=r'tip rests .* use method = "optimal"'):
        duration(turning, Limits(100.0, [100.0, 100.0, 1.0], [1e3, 1e3, 5.0], [2e4, 2e4, 50.0]))


def test_path_that_nothing_limits_is_refused():
    unlimited = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2)
    with pytest.raises(InputError, match="at least one of them must be finite"):
        duration(line(10.0, 0.0), unlimited)


def test_limits_of_another_machine_are_refused():
    with pytest.raises(InputError, match="limits have 2 axes"):
        duration(line(1.0, 2.0, 3.0), MILL)
