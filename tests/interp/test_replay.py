"""Samples against the exact motion, against the plan, and against the limits they must inherit."""

from __future__ import annotations

import importlib
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from cases import drives
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from motions import (
    largest_differences,
    largest_rates,
    node_times,
    plan_along,
    positions_at,
    scurve,
)

from interp import replay
from planner import load_curve
from planner.errors import InputError
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.profile import make_profile
from planner.samples import Samples

PERIODS = (0.25e-3, 1e-3, 2e-3)
ORDERS = (1, 2, 3, 5)
# First, second and third difference over T, T^2, T^3, as multiples of the velocity, acceleration and jerk allowed.
ALLOWED_RATIOS = np.array([1.0001, 1.0005, 1.0005])
LINE = NurbsCurve([[0.0, 0.0], [60.0, 25.0]], [0.0, 0.0, 1.0, 1.0], 1, name="line")
# feed, acceleration, jerk along the path: within 250 mm/s, 1000 mm/s^2, 20000 mm/s^3 on each axis.
MOTIONS = {"line": (100.0, 1000.0, 20000.0), "circle": (100.0, 800.0, 14000.0), "teardrop": (60.0, 600.0, 12000.0)}


def curve_named(name):
    return LINE if name == "line" else load_curve(name)


@pytest.fixture(scope="module")
def cases():
    """Curve, motion and plan by name."""
    found = {}
    for name, (feed, acceleration, jerk) in MOTIONS.items():
        curve = curve_named(name)
        motion = scurve(curve.length, feed, acceleration, jerk)
        found[name] = curve, motion, plan_along(curve, motion)
    return found


@pytest.fixture(scope="module")
def short_plan():
    """A plan of 80 ms on a short line."""
    curve = NurbsCurve([[0.0, 0.0], [0.4, 0.3]], [0.0, 0.0, 1.0, 1.0], 1, name="short line")
    motion = scurve(curve.length, 10.0, 400.0, 20000.0)
    return curve, plan_along(curve, motion)


# ---- the samples of an exact replay --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("period", PERIODS)
def test_every_sample_is_the_exact_position_at_its_time(cases, name, period):
    curve, motion, profile = cases[name]
    samples = replay(curve, profile, period)
    assert samples.period == period
    assert np.array_equal(samples.t, period * np.arange(samples.t.size))
    assert np.abs(samples.position - positions_at(curve, motion, samples.t)).max() < 1e-9
    # and, more closely, what the plan says: rounding alone must not cost 0.1 % of the jerk at 0.25 ms
    at = profile.at(np.minimum(samples.t, profile.duration))
    assert np.abs(samples.position - curve.derivatives(at.u, 0)[0]).max() < 4e-11
    assert np.abs(samples.u - at.u).max() < 1e-13


@pytest.mark.parametrize("name", ["butterfly-nurbs", "flank"])
def test_curves_of_many_pieces_and_axes_follow_their_plan(name):
    curve = load_curve(name)
    motion = scurve(curve.length, 20.0, 200.0, 5000.0)
    profile = plan_along(curve, motion, times=node_times(motion, 600))
    samples = replay(curve, profile, 0.25e-3)
    u = profile.at(np.minimum(samples.t, profile.duration)).u
    assert np.abs(samples.position - curve.derivatives(u, 0)[0]).max() < 4e-11
    assert np.array_equal(samples.position[-1], curve.derivatives(curve.domain[1], 0)[0])


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("period", PERIODS)
def test_differences_stay_within_the_rates_of_the_motion_at_every_phase_of_the_last_period(cases, name, period):
    curve, motion, profile = cases[name]
    allowed = largest_rates(curve, motion)
    whole = int(profile.duration / period)
    for phase in np.linspace(0.0, 1.0, 9):
        samples = replay(curve, profile, profile.duration / (whole + phase))
        ratio = (largest_differences(samples) / allowed).max(axis=1)
        assert (ratio <= ALLOWED_RATIOS).all(), (phase, ratio)


def test_differences_on_a_line_reach_the_rates_of_the_motion(cases):
    curve, motion, profile = cases["line"]
    ratio = largest_differences(replay(curve, profile, 1e-3)) / largest_rates(curve, motion)
    assert ratio == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize(("name", "feed"), [("teardrop", 100.0), ("circle", 100.0), ("circle", 300.0)])
def test_samples_of_an_optimal_plan_stay_within_the_limits(name, feed, period):
    curve = load_curve(name)
    limits = drives(feed, period=period)
    profile = plan_feedrate(curve, limits, intervals=400)
    samples = replay(curve, profile)
    assert samples.period == period
    allowed = np.stack([limits.velocity, limits.acceleration, limits.jerk])
    ratio = (largest_differences(samples) / allowed).max(axis=1)
    assert (ratio <= ALLOWED_RATIOS).all(), ratio
    u = profile.at(np.minimum(samples.t, profile.duration)).u
    assert np.abs(samples.position - curve.derivatives(u, 0)[0]).max() < 4e-11


def test_a_replay_that_stops_a_sample_early_is_seen_to_exceed_the_limits(cases):
    curve, motion, profile = cases["line"]
    samples = replay(curve, profile, profile.duration / 1000.99)
    cut = np.delete(samples.position, -2, axis=0)
    early = Samples(samples.period, samples.t[:-1], samples.u[:-1], cut)
    ratio = (largest_differences(early) / largest_rates(curve, motion)).max(axis=1)
    assert ratio[2] > 1.01


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("period", PERIODS)
def test_feed_between_samples_is_the_feed_of_the_plan(cases, name, period):
    curve, motion, profile = cases[name]
    samples = replay(curve, profile, period)
    planned = np.diff(motion(samples.t[:-1])[0])
    actual = np.diff(curve.arclength.s(samples.u[:-1]))
    moving = planned > 1.0 * period
    assert moving.sum() > 0.9 * moving.size
    assert np.abs(actual / planned - 1.0)[moving].max() < 1e-6


# ---- the number of samples, the first and the last -----------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    ("periods", "last"),
    [(79.0, 79), (79.0 + 5e-10, 79), (79.0 - 5e-10, 79), (79.0 + 5e-9, 80), (79.5, 80), (1.0, 1), (0.3, 1), (1.5, 2)],
)
def test_the_last_sample_ends_the_plan(short_plan, order, periods, last):
    curve, profile = short_plan
    samples = replay(curve, profile, profile.duration / periods, order=order)
    assert samples.t.size == samples.u.size == len(samples.position) == last + 1
    assert samples.u[0] == curve.domain[0]
    assert samples.u[-1] == curve.domain[1]
    assert np.array_equal(samples.position[[0, -1]], curve.derivatives(curve.domain, 0)[0])


@pytest.mark.parametrize("order", ORDERS)
def test_the_end_is_the_end_of_the_curve_to_the_bit(cases, order):
    for curve, _, profile in cases.values():
        samples = replay(curve, profile, 1e-3, order=order)
        assert np.array_equal(samples.position[-1], curve.derivatives(curve.domain[1], 0)[0])


def test_the_period_comes_from_the_plan_where_none_is_given(short_plan):
    curve, profile = short_plan
    assert replay(curve, profile).period == 1e-3
    planned = make_profile(curve, drives().with_period(2e-3), profile.law, method="s-curve")
    assert replay(curve, planned).period == 2e-3
    assert replay(curve, planned, 5e-3).period == 5e-3


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(MOTIONS)), st.floats(2e-5, 0.5), st.sampled_from(ORDERS), st.floats(0.3, 1.0), st.data())
def test_the_parameter_never_falls_back_nor_leaves_the_curve(cases, name, period, order, share, data):
    curve, _, profile = cases[name]
    stop = share * profile.duration
    start = data.draw(st.floats(max(0.0, stop - 2000 * period), stop)) if order == 5 else 0.0
    assume(np.ceil(start / period) <= np.floor(stop / period) and stop / period <= 5000)
    samples = replay(curve, profile, period, order=order, start=start, stop=stop)
    assert (np.diff(samples.u) >= 0.0).all()
    assert samples.u[0] >= curve.domain[0]
    assert samples.u[-1] <= curve.domain[1]
    # what is reported is where the axes are
    assert np.abs(samples.position - curve.derivatives(samples.u, 0)[0]).max() < 4e-11


# ---- parts of a plan -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("first", "last"), [(0, 30), (17, 17), (17, 60), (60, None), (1, None)])
def test_a_part_of_a_replay_is_that_part_of_the_whole(short_plan, order, first, last):
    curve, profile = short_plan
    whole = replay(curve, profile, 1e-3, order=order)
    stop = None if last is None else last * 1e-3
    part = replay(curve, profile, 1e-3, order=order, start=first * 1e-3, stop=stop)
    rows = slice(first, None if last is None else last + 1)
    assert np.array_equal(part.t, whole.t[rows])
    assert np.array_equal(part.u, whole.u[rows])
    assert np.array_equal(part.position, whole.position[rows])


def test_a_part_takes_the_multiples_of_the_period_inside_it(short_plan):
    curve, profile = short_plan
    assert replay(curve, profile, 1e-3, start=2.5e-3, stop=5.5e-3).t == pytest.approx([3e-3, 4e-3, 5e-3])
    whole = replay(curve, profile, 1e-3)
    assert np.array_equal(replay(curve, profile, 1e-3, stop=profile.duration).u, whole.u)


@pytest.mark.parametrize("order", ORDERS)
def test_the_length_of_a_compiled_call_makes_no_difference(short_plan, order, monkeypatch):
    curve, profile = short_plan
    whole = replay(curve, profile, 1e-3, order=order, start=20e-3)
    monkeypatch.setattr(importlib.import_module("interp.replay"), "_CHUNK", 7)
    chunked = replay(curve, profile, 1e-3, order=order, start=20e-3)
    assert np.array_equal(whole.u, chunked.u)
    assert np.array_equal(whole.position, chunked.position)


def test_samples_stay_exact_after_a_million_seconds():
    # A rest of 1e6 s, then a motion at 128 mm/s.  There k T as one number is off by up to 6e-11 s, hence 7e-9 mm.
    rest, period = 1e6, 0.25e-3
    line = NurbsCurve([[0.0, 0.0], [38.4, 51.2]], [0.0, 0.0, 1.0, 1.0], 1, name="line of 64 mm")
    motion = scurve(64.0, 128.0, 1024.0, 16384.0)
    times = node_times(motion, 64, step=1.0)  # all multiples of 2^-12 s: rest + t has no rounding
    s, v, a, _ = motion(times)
    nodes = [np.concatenate([[0.0], x]) for x in (rest + times, s / 64.0, v / 64.0, a / 64.0)]
    limits = Limits(200.0, [250.0] * 2, [1500.0] * 2, [20000.0] * 2)
    profile = make_profile(line, limits, TimeLaw(*nodes), method="s-curve")
    samples = replay(line, profile, period, start=rest)
    first = round(samples.t[0] / period)
    exact = [float((first + k) * Fraction(period) - Fraction(rest)) for k in range(samples.t.size)]
    assert np.abs(samples.position - positions_at(line, motion, np.array(exact)))[:-1].max() < 1e-12
    ratio = largest_differences(samples) / largest_rates(line, motion)
    assert (ratio.max(axis=1) <= ALLOWED_RATIOS).all()


# ---- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [0.0, -1e-3, np.nan, np.inf])
def test_a_period_must_be_positive_and_finite(short_plan, period):
    with pytest.raises(InputError, match=r"period = .* must be > 0 and finite"):
        replay(*short_plan, period)


@pytest.mark.parametrize("order", [0, 4, 6, 2.5])
def test_an_order_must_be_known(short_plan, order):
    with pytest.raises(InputError, match=f"order = {order}"):
        replay(*short_plan, order=order)


def test_another_curve_is_refused(short_plan):
    _, profile = short_plan
    with pytest.raises(InputError) as error:
        replay(LINE, profile)
    for part in (LINE.name, LINE.fingerprint, profile.curve.name, profile.curve.fingerprint):
        assert part in str(error.value)


def test_an_equal_curve_is_accepted(cases):
    _, _, profile = cases["circle"]
    assert replay(load_curve("circle"), profile).u[-1] == 1.0


def test_too_many_samples_are_refused_with_their_number(short_plan):
    curve, profile = short_plan
    period = profile.duration / 2e8
    with pytest.raises(InputError, match=r"200000001 samples; at most 100000000 .* coarser period, or a range"):
        replay(curve, profile, period)
    assert replay(curve, profile, period, start=0.02, stop=0.02 + 100.5 * period).t.size in {100, 101}
    with pytest.raises(InputError, match="more than 2\\^33 samples"):
        replay(curve, profile, 5e-324)


@pytest.mark.parametrize(
    ("start", "stop"), [(-1e-3, None), (0.5, None), (0.03, 0.02), (0.0, 10.0), (np.nan, None), (0.0, np.inf)]
)
def test_a_range_must_lie_within_the_plan(short_plan, start, stop):
    with pytest.raises(InputError, match="must lie within the plan"):
        replay(*short_plan, start=start, stop=stop)


def test_a_range_without_a_sample_is_refused(short_plan):
    with pytest.raises(InputError, match="no multiple of the period"):
        replay(*short_plan, 1e-3, start=2.2e-3, stop=2.8e-3)


def test_importing_the_stage_compiles_nothing():
    code = "import sys, interp; from interp import replay; import interp.replay; from interp import replay as again; "
    code += "assert replay is again is interp.replay is not sys.modules['interp.replay']; "
    code += "print(*sorted({'casadi', 'toppra', 'ruckig', 'matplotlib', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
