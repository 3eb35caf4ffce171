"""The check on planted defects of a table, at corners and at curvature breaks."""

from __future__ import annotations

import numpy as np
import pytest
from check_plans import (
    ELLIPSE,
    check,
    constant_feed,
    failing,
    lift,
    nodes_of,
    profile_on,
    scurve,
    unlimited,
    with_columns,
)
from joint_motions import there_and_back as there_and_back_of_jerks

from planner.geometry.blend import Legs
from planner.geometry.chain import ChainCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.samples import Samples


def test_a_rate_beyond_double_precision_fails(ellipse, ellipse_plan, used_up):
    """The cube of u' overflows: the jerk there is no number, its rounding neither, and it is beyond every limit."""
    rate = ellipse_plan.u_rate.copy()
    rate[200] = 1e120
    report = check(ellipse, used_up["profile"], with_columns(ellipse_plan, u_rate=rate))
    for axis in "XY":
        row = report.row("jerk", axis)
        assert not row.ok
        assert ellipse_plan.t[199] <= row.t <= ellipse_plan.t[201]
    assert not report.row("tangential jerk").ok


@pytest.mark.parametrize(("column", "size"), [(1, 1e-7), (2, 1e-4), (3, 5e-2)])
def test_one_bad_node_is_found_where_it_is(ellipse, ellipse_plan, used_up, column, size):
    used = used_up["profile"]
    generous = used._replace(jerk=used.jerk * 1.05, tangential_jerk=used.tangential_jerk * 1.05)
    assert check(ellipse, generous, ellipse_plan).ok
    nodes, k = nodes_of(ellipse_plan), 150
    nodes[column][k] += size * nodes[column][k]
    report = check(ellipse, generous, profile_on(ellipse, generous, nodes))
    rows = [row for row in report.violations if row.limit == "jerk"]
    assert rows
    for row in rows:
        assert nodes[0][k - 1] <= row.t <= nodes[0][k + 1]
        assert nodes[1][k - 1] <= row.u <= nodes[1][k + 1]


def test_one_bad_sample_is_found_where_it_is(ellipse, ellipse_samples, used_up):
    samples, used = ellipse_samples, used_up["samples"]
    k, error = 400, 2e-5
    position = samples.position.copy()
    position[k, 1] += error
    report = check(ellipse, used, Samples(1e-3, samples.t, samples.u, position))
    assert ("path error", "Y") in failing(report)
    assert report.row("path error", "Y").worst == pytest.approx(error, rel=1e-6)
    assert report.row("path error", "Y").t == samples.t[k]
    assert report.row("path error", "X").ok
    row = report.row("jerk", "Y")
    assert not row.ok
    assert abs(row.t - samples.t[k]) <= 1.5e-3 + 1e-12
    assert samples.u[k - 2] <= row.u <= samples.u[k + 2]
    # 3 e / T^3, on top of what the plan has there
    assert row.worst == pytest.approx(3.0 * error / 1e-9, rel=0.3)


def far_samples(off, along=0.0):
    """A line of 1e7 mm over u = -67.000001 .. -67, one sample moved across and along it; a digit is 0.14 mm."""
    curve = NurbsCurve([[0.0, 0.0], [8e6, 6e6]], [-67.000001, -67.000001, -67.0, -67.0], 1)
    u = np.linspace(*curve.domain, 101)
    position = curve.derivatives(u, 0)[0]
    position[50] += off * np.array([-0.6, 0.8]) + along * np.array([0.8, 0.6])
    return curve, Samples(1e-3, 1e-3 * np.arange(101), u, position)


@pytest.mark.parametrize(
    ("off", "along", "holds"), [(0.0, 0.05, True), (0.0, -0.1, True), (0.0, 0.3, False), (0.05, 0.0, False)]
)
def test_a_position_between_two_doubles_of_u_is_on_the_path(off, along, holds):
    curve, samples = far_samples(off, along)
    inf = [np.inf, np.inf]
    report = check(curve, Limits(np.inf, inf, inf, inf), samples)
    assert all(report.row("path error", axis).ok for axis in "XY") is holds


def test_a_velocity_step_is_a_violation(ellipse, ellipse_plan):
    k, share = 200, 1e-6
    t, u, rate, second = nodes_of(ellipse_plan)
    nodes = [np.insert(column, k, column[k]) for column in (t, u, rate, second)]
    nodes[2][k + 1] *= 1.0 + share
    report = check(ellipse, unlimited(), profile_on(ellipse, unlimited(), nodes))
    slope = np.array([-ELLIPSE[0] * np.sin(u[k]), ELLIPSE[1] * np.cos(u[k])])
    for j, axis in enumerate("XY"):
        row = report.row("velocity step", axis)
        assert not row.ok
        assert row.worst == pytest.approx(abs(slope[j] * rate[k] * share), rel=1e-6)
        assert (row.t, row.u) == (t[k], u[k])
        assert row.ratio == np.inf
    assert check(ellipse, unlimited(), ellipse_plan).row("velocity step", "X").ok


def test_a_knot_crossed_between_nodes_is_looked_at_from_both_sides(circle):
    """At a constant rate of u the circle's axis acceleration jumps at u = 0.5, where C'' does; no node is near."""
    t = np.array([0.0, 1.3, 3.0])
    nodes = (t, t / 3.0, np.full(3, 1.0 / 3.0), np.zeros(3))
    limits = unlimited(jerk=[1e5] * 2, period=2e-3)
    report = check(circle, limits, profile_on(circle, limits, nodes))
    sides = [circle.derivatives(0.5, 3, side=side) for side in ("left", "right")]
    jump = np.abs(sides[1][2] - sides[0][2]) / 9.0
    axis = "XY"[int(jump.argmax())]
    row = report.row("acceleration step", axis)
    assert row.worst == pytest.approx(jump.max(), rel=1e-9)
    assert row.t == pytest.approx(1.5, abs=1e-12)
    assert row.u == 0.5
    sampled_row = report.row("jerk at a curvature break", axis)
    assert sampled_row.worst >= 0.75 * jump.max() / 2e-3
    assert sampled_row.t == pytest.approx(1.5, abs=1e-12)


def test_constant_acceleration_from_rest_is_a_step_of_it(line):
    """Trapezoidal speed: D = a at both ends and at the corners of the trapezoid; sampled 0.75 a / T."""
    a, v = 1000.0, 100.0
    t = np.array([0.0, 0.1, 0.1, 1.0, 1.0, 1.1])
    s = np.array([0.0, 5.0, 5.0, 95.0, 95.0, 100.0])
    second = np.array([a, a, 0.0, 0.0, -a, -a])
    nodes = (t, s / 100.0, np.array([0.0, v, v, v, v, 0.0]) / 100.0, second / 100.0)
    for period in (1e-3, 0.4e-3):
        limits = unlimited(jerk=[1e9] * 2, period=period)
        profile = profile_on(line, limits, nodes)
        report = check(line, limits, profile)
        for axis, share in (("X", 0.6), ("Y", 0.8)):
            assert report.row("jerk", axis).worst < 1e-6
            assert report.row("acceleration step", axis).worst == pytest.approx(share * a, rel=1e-12)
            assert report.row("jerk at a curvature break", axis).worst == pytest.approx(0.75 * share * a / period)
            assert report.row("jerk at a curvature break", axis).t in {0.0, 0.1, 1.0, 1.1}
            # With no jerk besides, the step is to its limit as its sampled jerk is to the jerk limit.
            jerk_share = report.row("jerk at a curvature break", axis).ratio
            assert report.row("acceleration step", axis).ratio == pytest.approx(jerk_share, rel=1e-9)
        assert report.start_acceleration == pytest.approx(a)
        # The samples, at the worst phase of each step, see just that; at others less.
        jerk = max_sampled_jerk(line, profile, period)
        assert jerk[0] == pytest.approx(0.75 * 600.0 / period, rel=1e-3)


def test_an_acceleration_where_the_point_is_held_is_a_step(line):
    """From rest, a falls linearly from a to -a: nothing jumps on the way, but both ends are held points."""
    a, period = 1000.0, 1e-3
    duration = np.sqrt(6.0 * 100.0 / a)
    nodes = (np.array([0.0, duration]), np.array([0.0, 1.0]), np.zeros(2), np.array([a, -a]) / 100.0)
    limits = unlimited(jerk=[1e9] * 2, period=period)
    report = check(line, limits, profile_on(line, limits, nodes))
    for axis, share in (("X", 0.6), ("Y", 0.8)):
        row = report.row("jerk at a curvature break", axis)
        assert row.worst == pytest.approx(share * (0.75 * a / period + 2.0 * a / duration), rel=1e-9)
        assert row.t in {0.0, duration}
    assert report.start_acceleration == pytest.approx(a)
    assert report.end_acceleration == pytest.approx(-a)
    # Beginning and ending at speed, the same acceleration continues what came before.
    moving = (nodes[0], nodes[1], np.full(2, 1.0 / duration), np.full(2, 5.0))
    report = check(line, limits, profile_on(line, limits, moving))
    assert report.row("acceleration step", "X").worst == 0.0


def max_sampled_jerk(curve, profile, period, phases=64):
    """Largest third difference over T^3 of each axis over many phases of the sampling, both ends held."""
    best = np.zeros(curve.dim)
    count = int(np.ceil(profile.duration / period)) + 6
    for phase in np.arange(phases) / phases:
        t = np.clip((np.arange(count) - 3 + phase) * period, 0.0, profile.duration)
        q = curve.derivatives(profile.at(t).u, 0)[0]
        best = np.maximum(best, np.abs(np.diff(q, 3, axis=0)).max(axis=0) / period**3)
    return best


@pytest.fixture(scope="module")
def corner():
    return NurbsCurve([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]], [0.0, 0.0, 0.5, 1.0, 1.0], 1, name="corner")


def two_legs(motion):
    """The same motion on either leg of the corner."""
    t, s, v, a = motion
    return tuple(
        np.concatenate(parts) / scale
        for parts, scale in (((t, t + t[-1]), 1.0), ((s, s + 50.0), 100.0), ((v, v), 100.0), ((a, a), 100.0))
    )


CORNER_LIMITS = Limits(100.0, [100.0] * 2, [1000.0] * 2, [20000.0] * 2)


def test_stopping_at_a_corner_passes(corner):
    report = check(corner, CORNER_LIMITS, profile_on(corner, CORNER_LIMITS, two_legs(scurve(50.0, 100, 1000, 20000))))
    assert report.ok
    assert report.row("exact stop").worst == 0.0
    assert report.row("acceleration at an exact stop").worst == 0.0


@pytest.mark.parametrize("node_at_corner", [True, False])
def test_a_corner_passed_at_speed_fails(corner, node_at_corner):
    """At constant feed, with a node at the corner and without."""
    s = np.array([0.0, 50.0, 100.0]) if node_at_corner else np.array([0.0, 20.0, 70.0, 100.0])
    v = 20.0
    nodes = (s / v, s / 100.0, np.full(s.size, v / 100.0), np.zeros(s.size))
    report = check(corner, CORNER_LIMITS, profile_on(corner, CORNER_LIMITS, nodes))
    assert {("exact stop", ""), ("velocity step", "X"), ("velocity step", "Y")} <= failing(report)
    row = report.row("exact stop")
    assert row.worst == pytest.approx(v, rel=1e-9)
    assert row.t == pytest.approx(50.0 / v, rel=1e-12)
    assert row.u == 0.5
    assert report.row("velocity step", "X").worst == pytest.approx(v, rel=1e-9)


def test_a_corner_reached_with_acceleration_fails(corner):
    a = 400.0
    half = np.sqrt(50.0 / a)
    t = np.array([0.0, half, half, 2 * half])
    s, v = np.array([0.0, 25.0, 25.0, 50.0]), np.array([0.0, a * half, a * half, 0.0])
    nodes = two_legs((t, s, v, np.array([a, a, -a, -a])))
    # Without a jerk limit a stop may be left at full acceleration.  A jerk limit of 1e9 mm/s^3 the samples of this plan
    # keep, but no jerk is large enough for its steps: at the stop, and where either leg turns from speeding up to braking.
    limits = unlimited(acceleration=[1000.0] * 2, jerk=[1e9] * 2)
    assert check(corner, limits._replace(jerk=[np.inf] * 2), profile_on(corner, unlimited(), nodes)).ok
    report = check(corner, limits, profile_on(corner, unlimited(), nodes))
    smooth = "step on a smooth path"
    assert failing(report) == {("acceleration at an exact stop", ""), (smooth, "X"), (smooth, "Y")}
    assert report.row(smooth, "X").worst == pytest.approx(2.0 * a)
    assert report.row(smooth, "X").t == pytest.approx(half)
    row = report.row("acceleration at an exact stop")
    assert row.worst == pytest.approx(a)
    assert row.t == pytest.approx(2 * half)
    assert row.u == 0.5


def there_and_back(slower=1.0, *, stop=False):
    """Out along X to a turn at constant acceleration and back, the way back with so much less of it; the nodes, the path."""
    part = there_and_back_of_jerks()[1]
    far = float(part.position[4, 0])
    direction = np.array([[1.0, 0.0], [-1.0, 0.0]])
    vectors = np.zeros((2, 4, 2))
    vectors[:, 0], vectors[:, 3] = [[0.0, 0.0], [far, 0.0]], direction
    none = np.empty(0)
    stops = np.array([far]) if stop else none
    path = ChainCurve(
        np.array([0.0, far, 2.0 * far]), np.zeros(2, np.int8), np.arange(2), np.zeros(2), Legs(vectors, np.zeros((2, 2))),
        None, np.empty((0, 2, 5)), np.array([far]), stops, none,
    )  # fmt: skip
    t, x, v, a = part.t[:5], part.position[:5, 0], np.abs(part.velocity[:5, 0]), part.acceleration[:5, 0]
    v[-1] = 0.0
    nodes = (
        np.concatenate([t, t[-1] + slower * (t[-1] - t[::-1])]),
        np.concatenate([x, 2.0 * far - x[::-1]]),
        np.concatenate([v, v[::-1] / slower]),
        np.concatenate([a, -a[::-1] / slower**2]),
    )
    return path, nodes


def test_a_path_that_turns_back_may_keep_its_acceleration():
    path, nodes = there_and_back()
    report = check(path, CORNER_LIMITS, profile_on(path, CORNER_LIMITS, nodes))
    assert report.ok, str(report)
    assert report.row("acceleration at an exact stop").worst == pytest.approx(0.0, abs=1e-9)


def test_a_turn_at_another_acceleration_fails():
    path, nodes = there_and_back(1.01)
    report = check(path, CORNER_LIMITS, profile_on(path, CORNER_LIMITS, nodes))
    assert failing(report) == {("acceleration at an exact stop", "")}
    assert report.row("acceleration at an exact stop").worst == pytest.approx(200.0 * (1.0 - 1.01**-2), rel=1e-6)


def test_a_stop_that_is_demanded_where_the_path_turns_back_is_one():
    path, nodes = there_and_back(stop=True)
    report = check(path, CORNER_LIMITS, profile_on(path, CORNER_LIMITS, nodes))
    assert failing(report) == {("acceleration at an exact stop", "")}
    assert report.row("acceleration at an exact stop").worst == pytest.approx(200.0, rel=1e-6)


RADIUS = 20.0


@pytest.fixture(scope="module")
def line_arc():
    """A straight segment of 40 mm, then a quarter circle: the curvature jumps from 0 to 1/R."""
    points = [[0.0, 0.0], [20.0, 0.0], [40.0, 0.0], [40.0 + RADIUS, 0.0], [40.0 + RADIUS, RADIUS]]
    weights = [1.0, 1.0, 1.0, np.sqrt(0.5), 1.0]
    return NurbsCurve(points, [0, 0, 0, 0.5, 0.5, 1, 1, 1], 2, weights, name="line and arc")


def test_curvature_break_at_constant_feed(line_arc):
    """D = v^2/R across the path; nearby the jerk is v^3/R^2 along it, turned by up to 3 v T / R."""
    (bend,) = line_arc.breaks
    assert bend.geometric == 1
    v, period = 30.0, 1e-3
    step, jerk = v**2 / RADIUS, v**3 / RADIUS**2
    expected = 0.75 * step / period + jerk * np.sin(3.0 * v * period / RADIUS)
    nodes = lift(line_arc, constant_feed(line_arc, v, 400))
    reports = {}
    for factor in (1.0 - 1e-5, 1.0 + 1e-5):
        limits = unlimited(jerk=[expected, expected * factor], period=period)
        reports[factor] = check(line_arc, limits, profile_on(line_arc, limits, nodes))
    assert reports[1.0 + 1e-5].ok
    assert failing(reports[1.0 - 1e-5]) == {("jerk at a curvature break", "Y")}
    report = reports[1.0 - 1e-5]
    row = report.row("jerk at a curvature break", "Y")
    assert row.worst == pytest.approx(expected, rel=1e-6)
    assert row.t == pytest.approx(40.0 / v, abs=1e-12)
    assert row.u == 0.5
    assert report.row("jerk at a curvature break", "X").worst == pytest.approx(jerk, rel=1e-5)
    assert report.row("acceleration step", "Y").worst == pytest.approx(step, rel=1e-9)
    # Samples of that plan, away from its ends: at the worst phase the step shows, and never more than that.
    seen = 0.0
    for phase in np.arange(100) / 100:
        t = 40.0 / v + (np.arange(9) - 4 + phase) * period
        q = line_arc.derivatives(profile_on(line_arc, limits, nodes).at(t).u, 0)[0]
        seen = max(seen, np.abs(np.diff(q[:, 1], 3)).max() / period**3)
    assert 0.75 * step / period * (1 - 1e-3) < seen <= row.worst


def test_curvature_breaks_close_together_add_up():
    """y'' rises in three steps that are passed within one and a half periods: they reach the drive nearly as one.

    With knots k_m the curve is y = sum_m c_m (x - k_m)_+^2 / 2, x = u; the control points of a quadratic spline are its
    polar form at two consecutive knots k', k'', here sum_m c_m (k' - k_m)_+ (k'' - k_m)_+ / 2.
    """
    feed, period = 20.0, 1e-3
    at = 8.0 + feed * period * np.array([0.0, 0.5, 1.4])
    bends = np.array([0.010, 0.008, 0.012])
    knots = np.concatenate([[0.0] * 3, at, [16.0] * 3])
    pairs = np.maximum(knots[1:-2, None] - at, 0.0) * np.maximum(knots[2:-1, None] - at, 0.0)
    points = np.stack([(knots[1:-2] + knots[2:-1]) / 2.0, pairs @ bends / 2.0], axis=1)
    curve = NurbsCurve(points, knots, 2, name="close knots")
    limits = unlimited(jerk=[1e6] * 2, period=period)
    profile = profile_on(curve, limits, lift(curve, constant_feed(curve, feed, 300)))
    report = check(curve, limits, profile)
    t = at[1] / feed + (np.arange(-6, 7) + np.arange(400)[:, None] / 400) * period
    q = curve.derivatives(profile.at(t).u, 0)[0][..., 1]
    seen = np.abs(np.diff(q, 3, axis=1)).max() / period**3
    single = 0.75 * report.row("acceleration step", "Y").worst / period
    assert report.row("acceleration step", "Y").worst == pytest.approx(feed**2 * bends.max(), rel=1e-3)
    assert seen > 1.4 * single
    row = report.row("jerk at a curvature break", "Y")
    assert seen <= row.worst
    assert row.worst == pytest.approx(seen, rel=1e-2)


def test_a_node_a_rounding_beside_a_knot_lies_on_it(circle):
    """Inverting the arc length gives the knot but for its last digit; each side still belongs to its own node."""
    v = 100.0
    limits = Limits(v, [v] * 2, [v**2 / 50.0] * 2, [v**3 / 2500.0] * 2)
    for beside in (-np.inf, np.inf):
        nodes = lift(circle, constant_feed(circle, v, 1000))
        nodes[1][nodes[1] == 0.5] = np.nextafter(0.5, beside)
        report = check(circle, limits, profile_on(circle, limits, nodes))
        assert report.ok
        assert max(report.row("acceleration step", axis).worst for axis in "XY") < 1e-6


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_step_of_the_tangential_acceleration_is_found_where_the_curvature_jumps(line_arc, share):
    """A step D that alone, sampled, would use up the tangential jerk J is 4/3 J T."""
    limits = unlimited(tangential_jerk=20000.0)
    step = share * 4.0 / 3.0 * 20000.0 * limits.period
    v, straight, rest = 20.0, 40.0, 0.1
    times = np.array([0.0, straight / v, straight / v + rest])
    s = np.array([0.0, straight, straight + v * rest + 0.5 * step * rest**2])
    t, u, rate, change = lift(line_arc, (times, s, np.array([v, v, v + step * rest]), np.array([0.0, 0.0, step])))
    assert u[1] == u[2] == 0.5
    change[2] += step / np.sqrt(np.sum(line_arc.derivatives(0.5, 1)[1] ** 2))
    row = check(line_arc, limits, profile_on(line_arc, limits, (t, u, rate, change))).row("tangential step")
    assert row.worst == pytest.approx(step, rel=1e-6)
    assert row.t == pytest.approx(straight / v)
    assert row.ok is (share < 1.0)
