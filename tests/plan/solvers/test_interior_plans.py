"""Plans of the interior-point method: limits kept, feeds at the ends, and axes with other limits or none."""

from itertools import pairwise

import numpy as np
import pytest
from cases import drives, ellipse, line, line_arc_line, s_curve_time
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import NO_SHRINKING, SEEDS, duration, random_case
from strategies import random_nurbs

from interp import replay
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.status import Status
from planner.verify import check


def require_feasible(curve, limits, profile, tightest=0.99):
    """The plan and its samples keep every limit, and use one up; limits lowered by 0.5 % are not kept."""
    report, of_samples = check(curve, limits, profile), check(curve, limits, replay(curve, profile))
    for row in (*report.rows, *of_samples.rows):
        assert row.ok, row
    assert max(row.ratio for row in report.rows if np.isfinite(row.ratio)) >= tightest
    k = 0.995
    lower = Limits(
        k * limits.feed, k * limits.velocity, k * limits.acceleration, k * limits.jerk, k * limits.chord_error
    )
    assert not check(curve, lower, profile).ok
    assert profile.lower_bound <= profile.duration * (1.0 + 1e-9)


@settings(max_examples=12, phases=NO_SHRINKING)
@given(SEEDS)
def test_plans_of_random_paths_are_feasible(seed):
    curve, limits = random_case(seed)
    profile = plan_feedrate(curve, limits)
    assert profile.status is Status.OPTIMAL
    require_feasible(curve, limits, profile)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_plans_of_many_random_paths_are_feasible(degree):
    broken = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        dim = int(rng.integers(2, 6))
        curve = random_nurbs(seed, degree, dim, spans=int(rng.choice([1, 4, 12])), repeat=int(rng.integers(1, degree)))
        rows = rng.uniform(50.0, 400.0, dim), rng.uniform(300.0, 3000.0, dim), rng.uniform(5e3, 6e4, dim)
        limits = Limits(float(rng.choice([60.0, 200.0, np.inf])), *rows, period=float(rng.choice([1e-3, 4e-3])))
        profile = plan_feedrate(curve, limits)
        for report in (check(curve, limits, profile), check(curve, limits, replay(curve, profile))):
            broken += [(seed, row.limit, row.axis, row.ratio) for row in report.rows if not row.ok]
    assert broken == []


@pytest.mark.parametrize("spans", [10, 40, 160, 640, 1280])
def test_a_path_of_short_spans_with_small_curvature_jumps(spans):
    """The finer a quadratic spline follows a wave, the smaller its jumps: the plan must come close to that of the wave."""

    def wave(degree):
        s = np.linspace(0.0, 1.0, spans + degree)
        points = np.column_stack([60.0 * s, 5.0 * np.sin(6.0 * np.pi * s)])
        knots = [*[0.0] * degree, *np.linspace(0.0, 1.0, spans + 1), *[1.0] * degree]
        return NurbsCurve(points, knots, degree)

    limits = drives(chord_error=1e-3)
    profile = plan_feedrate(wave(2), limits)
    report = check(profile.curve, limits, profile)
    assert report.ok, str(report)
    assert check(profile.curve, limits, replay(profile.curve, profile)).ok
    smooth = duration(wave(3), limits)
    assert smooth <= profile.duration
    if spans >= 640:  # spans shorter than a period
        assert profile.duration <= 1.1 * smooth
    assert all(period > 0.0 for period in np.diff([b.u for b in profile.curve.breaks]))


@pytest.mark.parametrize(("spans", "period", "intervals"), [(40, 1e-4, None), (40, 1e-3, 100), (10, 1e-2, 60)])
def test_curvature_jumps_in_quick_succession(spans, period, intervals):
    """The feed falls to a fraction and rises again within a fraction of an interval of the wanted grid."""
    curve = random_nurbs(1, 2, 2, spans=spans)
    limits = drives(period=period)
    profile = plan_feedrate(curve, limits, intervals=intervals)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert check(curve, limits, replay(curve, profile)).ok
    assert profile.duration <= 1.05 * duration(curve, limits, intervals=4000)


def test_jumps_pass_within_their_share_of_the_jerk():
    curve = line_arc_line()
    limits = drives(jerk=[20000.0, 12000.0])
    profile = plan_feedrate(curve, limits)
    assert len(curve.breaks) == 2
    for b in curve.breaks:
        k = int(np.flatnonzero(profile.u == b.u)[0])
        sides = [curve.derivatives(b.u, 2, side=side) for side in ("left", "right")]
        before, after = (
            q[2] * profile.u_rate[i] ** 2 + q[1] * profile.u_acceleration[i]
            for q, i in zip(sides, (k, k + 1), strict=True)
        )
        step = np.abs(after - before) / (limits.jerk * limits.period)
        assert 0.97 * 2.0 / 3.0 <= step.max() <= 2.0 / 3.0 * (1.0 + 1e-6)
        t = profile.t[k] + limits.period * np.linspace(-3.0, 3.0, 1201)
        state = profile.at(t)
        q = curve.derivatives(state.u, 3)
        u1, u2, u3 = (v[:, None] for v in (state.u_rate, state.u_acceleration, state.u_jerk))
        jerk = np.abs(q[3] * u1**3 + 3.0 * q[2] * u1 * u2 + q[1] * u3)
        assert (jerk / limits.jerk).max() <= 0.5 * (1.0 + 1e-6)
    for phase in np.linspace(0.0, 1.0, 5):
        samples = replay(curve, profile, limits.period * (1.0 + 1e-3 * phase))
        assert check(curve, limits, samples).ok


@settings(max_examples=8, phases=NO_SHRINKING)
@given(SEEDS, st.floats(0.1, 1.0), st.one_of(st.just(0.0), st.floats(0.1, 1.0)))
def test_feeds_at_the_ends_are_kept_exactly(seed, start, end):
    curve, limits = random_case(seed)
    at_rest = plan_feedrate(curve, limits)
    # what a plan from rest has reached after a hundredth of the way can be braked there too
    top = [float(np.interp(share * curve.length, at_rest.s, at_rest.feed)) for share in (0.01, 0.99)]
    feeds = {"start_feed": 0.5 * start * top[0], "end_feed": 0.5 * end * top[1]}
    profile = plan_feedrate(curve, limits, **feeds)
    assert profile.feed[0] == pytest.approx(feeds["start_feed"], rel=1e-12)
    assert profile.feed[-1] == pytest.approx(feeds["end_feed"], rel=1e-12)
    assert profile.duration <= at_rest.duration * (1.0 + 5e-4)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert report.start_feed == pytest.approx(feeds["start_feed"], rel=1e-9)


@pytest.mark.parametrize("feed", [1.0, 10.0, 99.0, 100.0])
def test_a_line_entered_at_speed(feed):
    """With the acceleration free at the start it runs into the S-curve that brakes, at once or after some time."""
    profile = plan_feedrate(line(60.0, 0.0), drives(), start_feed=feed)
    at_rest = s_curve_time(60.0, 100.0, 1000.0, 20000.0)
    ramp = 0.5 * (at_rest - (60.0 - 100.0 * 0.15) / 100.0)
    assert ramp == pytest.approx(0.15)
    # from feed to 100 mm/s: at 1000 mm/s^2 from the start on, then falling at 20000 mm/s^3; shorter ramps likewise
    if 100.0 - feed >= 1000.0**2 / 20000.0 / 2.0:
        time = (100.0 - feed) / 1000.0 + 1000.0 / 20000.0 / 2.0
        fall = 1000.0 / 20000.0
        way = (time - fall) * 0.5 * (feed + 100.0 - 25.0) + 100.0 * fall - 20000.0 * fall**3 / 6.0
    else:
        time = np.sqrt(2.0 * (100.0 - feed) / 20000.0)
        way = 100.0 * time - 20000.0 * time**3 / 6.0
    exact = time + (60.0 - way - 100.0 * 0.15 / 2.0) / 100.0 + 0.15
    assert profile.duration == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("start", [0.0, 0.13, 0.4])
def test_a_closed_path_takes_as_long_from_wherever_it_is_entered(start):
    text = {"X": "30*cos(2*pi*u)", "Y": "10*sin(2*pi*u)"}
    curve = FormulaCurve(text, (start, start + 1.0))
    limits = drives()
    profile = plan_feedrate(curve, limits, periodic=True)
    reference = plan_feedrate(FormulaCurve(text, (0.0, 1.0)), limits, periodic=True, intervals=3000)
    assert profile.duration == pytest.approx(reference.duration, rel=2e-4)
    for values in (profile.feed, profile.acceleration):
        assert values[-1] == pytest.approx(values[0], abs=1e-8 * np.abs(values).max())
    assert check(curve, limits, profile).ok


def test_a_closed_path_whose_parameter_jumps_at_the_seam():
    limits = drives()
    even = FormulaCurve({"X": "20*cos(2*pi*u)", "Y": "10*sin(2*pi*u)"}, (0.0, 1.0))
    uneven = FormulaCurve({"X": "20*cos(pi*(u+u**2))", "Y": "10*sin(pi*(u+u**2))"}, (0.0, 1.0))
    first, second = (plan_feedrate(curve, limits, periodic=True) for curve in (even, uneven))
    assert second.duration == pytest.approx(first.duration, rel=2e-4)
    assert second.feed[0] == pytest.approx(second.feed[-1], rel=1e-9)
    assert second.feed[0] == pytest.approx(first.feed[0], rel=2e-3)


def test_corners_join_sections_from_stop_to_stop():
    corners = [[0.0, 0.0], [20.0, 0.0], [20.0, 7.0], [3.0, 7.0], [3.0, 3.0]]
    curve = NurbsCurve(corners, [0, 0, 1, 2, 3, 4, 4], 1)
    profile = plan_feedrate(curve, drives())
    sides = [float(np.abs(np.subtract(a, b)).sum()) for a, b in pairwise(corners)]
    exact = sum(s_curve_time(side, 100.0, 1000.0, 20000.0) for side in sides)
    assert profile.duration == pytest.approx(exact, rel=1e-4)
    assert profile.work.sections == 4
    stops = [profile.t[profile.u == u] for u in (1.0, 2.0, 3.0)]
    assert np.cumsum([s_curve_time(side, 100.0, 1000.0, 20000.0) for side in sides])[:3] == pytest.approx(
        [t[0] for t in stops], rel=1e-4
    )
    assert all(np.abs(profile.feed[profile.u == u]).max() == 0.0 for u in (1.0, 2.0, 3.0))


def test_an_axis_without_limits():
    curve = ellipse()
    limits = Limits(100.0, [np.inf, 250.0], [np.inf, 1000.0], [np.inf, 20000.0])
    profile = plan_feedrate(curve, limits)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert profile.feed[[0, -1]].tolist() == [0.0, 0.0]
    assert profile.duration <= plan_feedrate(curve, drives()).duration * (1.0 + 5e-4)


def test_an_axis_without_a_jerk_limit():
    """X, which does not move at the start."""
    curve = ellipse()
    limits = Limits(100.0, [250.0] * 2, [1000.0] * 2, [np.inf, 20000.0])
    profile = plan_feedrate(curve, limits)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert profile.duration <= plan_feedrate(curve, drives()).duration * (1.0 + 5e-4)


@pytest.mark.parametrize(
    ("feed", "velocity", "acceleration", "jerk", "more", "binding"),
    [
        (50.0, np.inf, np.inf, 20000.0, {}, {"feed"}),
        (np.inf, 60.0, np.inf, 20000.0, {}, {"velocity X"}),
        (np.inf, np.inf, 1000.0, 20000.0, {}, {"acceleration X", "jerk X"}),
        (np.inf, np.inf, np.inf, 20000.0, {"chord_error": 1e-4}, {"chord error"}),
        (
            100.0,
            np.inf,
            np.inf,
            np.inf,
            {"tangential_jerk": 3000.0, "tangential_acceleration": 200.0},
            {"feed", "tangential jerk"},
        ),
    ],
)
def test_any_selection_of_limits_binds(feed, velocity, acceleration, jerk, more, binding):
    curve = ellipse()
    limits = drives(feed, velocity=velocity, acceleration=acceleration, jerk=jerk, **more)
    profile = plan_feedrate(curve, limits)
    assert binding <= set(profile.shares())
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert max(row.ratio for row in report.rows if np.isfinite(row.ratio)) >= 0.99


def test_an_axis_that_turns_alone():
    """The tip stands still while the rotary axis makes an S-curve."""
    curve = NurbsCurve([[5, 5, 0], [5, 5, 1]], [0, 0, 1, 1], 1, axes=["X", "Y", "A"])
    limits = Limits(100.0, [250, 250, 2], [1000, 1000, 10], [2e4, 2e4, 200], 1e-3, axes=["X", "Y", "A"])
    profile = plan_feedrate(curve, limits)
    assert profile.duration == pytest.approx(s_curve_time(1.0, 2.0, 10.0, 200.0), rel=2e-4)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert check(curve, limits, replay(curve, profile)).ok


def test_a_path_on_which_the_tip_rests_for_a_while():
    xy = [[10.0 * k, 0.0] for k in range(4)] + [[30.0, 0.0]] * 5 + [[30.0, 10.0 * k] for k in range(1, 4)]
    points = np.column_stack([xy, 0.05 * np.arange(len(xy))])
    knots = [0, 0, 0, 0, *range(1, len(xy) - 3), *[len(xy) - 3] * 4]
    curve = NurbsCurve(points, knots, 3, axes=["X", "Y", "A"])
    limits = Limits(100.0, [250, 250, 2], [1000, 1000, 10], [2e4, 2e4, 200], 1e-3, axes=["X", "Y", "A"])
    profile = plan_feedrate(curve, limits)
    require_feasible(curve, limits, profile)
    resting = (profile.u > 5.01) & (profile.u < 5.99)
    assert profile.feed[resting].max() < 1e-9
    assert profile.u_rate[resting].min() > 0.0
    assert all(np.isfinite(getattr(profile, name)).all() for name in ("s", "feed", "acceleration", "jerk"))
