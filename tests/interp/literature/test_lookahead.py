"""The adaptive feed with look-ahead against two-pass planning, de Boor's recurrence, and the limits of the 2007 paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from strategies import random_nurbs

from interp.literature.lookahead import (
    PAPER_LIMITS,
    RULES,
    AdaptiveLimits,
    adaptive_feed,
    interpolate_adaptive,
    span_coefficients,
    span_matrix,
)
from planner import load_curve
from planner.compiled import core
from planner.errors import InfeasibleError, InputError, StalledError
from planner.geometry.nurbs import NurbsCurve

LINE = NurbsCurve([[0.0, 0.0], [30.0, 40.0]], [0.0, 0.0, 1.0, 1.0], 1, name="line")


@pytest.fixture(scope="module")
def butterfly():
    return load_curve("butterfly-nurbs")


# ---- the span matrix -----------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 3), st.booleans())
def test_the_span_matrix_is_the_basis_of_scipy(seed, spans, repeat, clamped):
    curve = random_nurbs(seed, 3, 2, spans=spans, repeat=repeat, clamped=clamped)
    knots = curve.knots
    long = [i for i in range(3, knots.size - 4) if knots[i + 1] - knots[i] >= 1e-3]
    assert long
    for i in long:
        t = np.linspace(0.0, 1.0, 7)
        powers = t[:, None] ** np.arange(4)
        basis = np.stack(
            [
                BSpline(knots, np.eye(knots.size - 4)[i - 3 + k], 3)(knots[i] + t[:-1] * (knots[i + 1] - knots[i]))
                for k in range(4)
            ],
            axis=1,
        )
        matrix = span_matrix(knots, i)
        assert (powers[:-1] @ matrix) == pytest.approx(basis, abs=3e-13)
        assert matrix.sum(axis=1) == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-12)


def test_the_matrix_of_equal_knots_is_the_uniform_one():
    uniform = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
    assert span_matrix(np.arange(12.0), 5) == pytest.approx(uniform, abs=1e-15)


def test_spans_evaluate_to_the_curve(butterfly):
    knots, coefficients = span_coefficients(butterfly)
    assert np.array_equal(knots, np.unique(butterfly.knots))
    t = np.linspace(0.0, 1.0, 9)
    for i in range(len(coefficients)):
        values = (t[:, None] ** np.arange(4)) @ coefficients[i].T
        points = values[:, :-1] / values[:, -1:]
        u = knots[i] + t * (knots[i + 1] - knots[i])
        side = butterfly.derivatives(np.minimum(u, knots[i + 1]), 0, side="right" if i == 0 else "left")[0]
        side[0] = butterfly.derivatives(u[0], 0)[0]
        assert points == pytest.approx(side, abs=3e-13)


def test_spans_that_are_not_there_are_refused():
    knots = np.array([0.0, 0, 0, 0, 1, 1, 2, 2, 2, 2])
    for i in (2, 4, 6):
        with pytest.raises(InputError, match=f"span i = {i} must be one that is not empty"):
            span_matrix(knots, i)
    with pytest.raises(InputError, match="circle has the degree 2"):
        span_coefficients(load_curve("circle"))


# ---- the adaptive feed ---------------------------------------------------------------------------------------------


def test_the_feed_on_a_circle_is_that_of_the_formulas():
    circle = load_curve("circle")
    base = AdaptiveLimits(1e4, np.inf, 9800.0, np.inf, 2e-3)
    chord = 2.0 / 2e-3 * np.sqrt(50.0**2 - (50.0 - 2e-3) ** 2)
    u = np.array([0.0, 0.3, 0.9])
    assert adaptive_feed(circle, replace(base, chord_error=2e-3), u) == pytest.approx(chord, rel=1e-9)
    assert adaptive_feed(circle, replace(base, normal_acceleration=980.0), u) == pytest.approx(np.sqrt(980.0 * 50.0))
    assert adaptive_feed(circle, base, u) == pytest.approx(1e4)


@pytest.mark.parametrize("name", ["butterfly-nurbs", "teardrop", "circle"])
@pytest.mark.parametrize(("normal", "chord"), [(980.0, 2e-3), (np.inf, 2e-5), (980.0, np.inf), (1e5, 1e-5)])
def test_the_points_have_the_adaptive_feed(name, normal, chord):
    curve = load_curve(name)
    limits = replace(PAPER_LIMITS, normal_acceleration=normal, chord_error=chord)
    run = interpolate_adaptive(curve, limits)
    assert run.adaptive_feed == pytest.approx(adaptive_feed(curve, limits, run.u_points), rel=1e-6)
    points = curve.derivatives(run.u_points, 0)[0]
    assert run.lengths == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1), abs=1e-11)
    steps = np.diff(run.u_points)[:-1]
    speed = np.linalg.norm(curve.derivatives(run.u_points[:-2], 1)[1], axis=1)
    assert steps == pytest.approx(limits.period * run.adaptive_feed[:-2] / speed, rel=1e-9, abs=0.0)


def test_with_the_limits_of_the_paper_the_chord_never_counts():
    # 63.2 sqrt(r) from the chord against 31.3 sqrt(r) from the normal acceleration; the command from r = 10.2 mm on
    r = np.geomspace(0.01, 1e3, 50)
    chord = 2.0 / PAPER_LIMITS.period * np.sqrt(r**2 - (r - PAPER_LIMITS.chord_error) ** 2)
    assert (chord > 1.9 * np.sqrt(PAPER_LIMITS.normal_acceleration * r)).all()
    assert PAPER_LIMITS.feed**2 / PAPER_LIMITS.normal_acceleration == pytest.approx(10.2, abs=0.01)
    assert PAPER_LIMITS.feed**2 / (2.0 * PAPER_LIMITS.acceleration) == pytest.approx(0.51, abs=0.001)


# ---- the look-ahead ------------------------------------------------------------------------------------------------


def two_passes(square, lengths, twice):
    """The highest squared feeds under the given ones: backwards, then forwards."""
    out = square.copy()
    for i in range(lengths.size - 1, -1, -1):
        out[i] = min(out[i], out[i + 1] + twice * lengths[i])
    for i in range(lengths.size):
        out[i + 1] = min(out[i + 1], out[i] + twice * lengths[i])
    return out


@given(st.integers(0, 100_000), st.integers(1, 60), st.floats(0.1, 1e4))
def test_looking_ahead_gives_what_two_passes_over_the_whole_path_give(seed, count, twice):
    rng = np.random.default_rng(seed)
    square, lengths = rng.uniform(0.0, 1e4, count + 1), rng.uniform(1e-3, 2.0, count)
    square[-1] = 0.0
    found = square.copy()
    farthest = core.lookahead_brake(twice, lengths.size, lengths, found)
    assert found == pytest.approx(two_passes(square, lengths, twice), abs=1e-6)
    assert (found <= square).all()
    assert (np.abs(np.diff(found)) <= twice * lengths * (1.0 + 1e-12) + 1e-9).all()
    # nothing beyond the distance in which the highest feed comes to rest, and the segment it began in
    assert farthest <= square.max() / twice + lengths.max()


def test_the_acceleration_exceeds_the_limit_before_and_holds_after(butterfly):
    before = interpolate_adaptive(butterfly, PAPER_LIMITS, look_ahead=False)
    allowed = PAPER_LIMITS.acceleration
    assert np.abs(before.acceleration).max() > 1.5 * allowed
    assert (np.abs(before.acceleration) > allowed).sum() >= 5
    assert np.abs(before.planned_acceleration).max() > 1.5 * allowed
    for rule, order in (("averaged", 1), ("uniform", 2)):
        after = interpolate_adaptive(butterfly, PAPER_LIMITS, rule=rule, order=order)
        assert np.abs(after.acceleration).max() <= allowed
        assert np.abs(after.planned_acceleration).max() <= allowed * (1.0 + 1e-9)
        assert after.looked_ahead <= 100.0**2 / (2.0 * allowed)
        assert after.planned_feed[0] == PAPER_LIMITS.start_feed
        assert after.planned_feed[-1] == 0.0
        assert (after.planned_feed <= after.adaptive_feed).all()
        assert 4.5 < after.duration < 4.6


@pytest.mark.parametrize("period", [1e-3, 2e-3])
def test_uniform_acceleration_and_second_order_keep_what_the_mean_does_not(butterfly, period):
    limits = replace(PAPER_LIMITS, period=period)
    normal = {}
    for rule, order in (("averaged", 1), ("uniform", 2)):
        run = interpolate_adaptive(butterfly, limits, rule=rule, order=order)
        feed = run.actual_feed
        through = (0.5 * (feed[1:] + feed[:-1])) ** 2 * butterfly.curvature(run.samples.u[1:-1])
        normal[rule] = through.max() / limits.normal_acceleration
    assert np.abs(run.acceleration).max() <= limits.acceleration
    assert normal["averaged"] > 2.5  # a mean lags behind the feed it should have come down to
    assert normal["uniform"] < 1.2  # what is left is the change of curvature within a period


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("start", [0.0, 25.0 / 3.0])
def test_samples_lie_on_the_curve_and_end_with_it(butterfly, rule, order, start):
    for curve in (butterfly, load_curve("teardrop"), LINE):
        run = interpolate_adaptive(curve, replace(PAPER_LIMITS, start_feed=start), rule=rule, order=order)
        samples = run.samples
        assert np.abs(samples.position - curve.derivatives(samples.u, 0)[0]).max() < 1e-10
        assert np.array_equal(samples.position[[0, -1]], curve.derivatives(curve.domain, 0)[0])
        assert (np.diff(samples.u)[1:] > 0.0).all()  # a mean with a feed of 0 waits for one period
        assert samples.t == pytest.approx(2e-3 * np.arange(samples.t.size))
        assert run.feed.size == samples.t.size
        assert samples.end_feed == 0.0


@pytest.mark.parametrize("start", [0.0, 20.0])
def test_on_a_line_the_uniform_rule_takes_the_time_of_constant_acceleration(start):
    limits = AdaptiveLimits(100.0, 980.0, 500.0, period=1e-3, start_feed=start)
    run = interpolate_adaptive(LINE, limits, rule="uniform")
    rise, stop = (100.0 - start) / 500.0, 100.0 / 500.0
    cruise = (50.0 - (100.0**2 - start**2) / 1000.0 - 100.0**2 / 1000.0) / 100.0
    # points are a period apart, and the corners of the trapezoid lie between them
    assert run.duration == pytest.approx(rise + cruise + stop, abs=2e-3)
    assert np.abs(run.acceleration).max() <= 500.0 * (1.0 + 1e-9)


def test_three_axes_and_five(butterfly):
    flank = load_curve("flank")
    run = interpolate_adaptive(flank, AdaptiveLimits(20.0, 100.0, 200.0))
    tip = flank.tip.derivatives(run.samples.u, 0)[0]
    feed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / run.samples.period
    assert feed.max() < 20.5
    assert run.samples.position.shape[1] == 5
    assert np.abs(run.samples.position - flank.derivatives(run.samples.u, 0)[0]).max() < 1e-9


# ---- what is refused -----------------------------------------------------------------------------------------------


def test_limits_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="acceleration"):
        AdaptiveLimits(100.0, 980.0, -1.0)
    with pytest.raises(InputError, match="feed = inf must be finite"):
        AdaptiveLimits(np.inf, 980.0, 9800.0)
    with pytest.raises(InputError, match=r"start_feed = 101.0 mm/s must lie within"):
        AdaptiveLimits(100.0, 980.0, 9800.0, start_feed=101.0)


def test_unknown_rules_and_orders_are_refused(butterfly):
    with pytest.raises(InputError, match="rule = 'mean' must be one of averaged, uniform"):
        interpolate_adaptive(butterfly, PAPER_LIMITS, rule="mean")
    with pytest.raises(InputError, match="order = 3 must be 1 or 2"):
        interpolate_adaptive(butterfly, PAPER_LIMITS, order=3)


def test_a_path_too_short_to_stop_on_is_refused():
    short = NurbsCurve([[0.0, 0.0], [1.0, 0.0]], [0.0, 0.0, 1.0, 1.0], 1, name="short")
    limits = AdaptiveLimits(100.0, 980.0, 500.0, start_feed=50.0)
    with pytest.raises(
        InfeasibleError, match=r"too short to stop from the start feed 50 mm/s .* start with 31\.6\d* mm/s"
    ):
        interpolate_adaptive(short, limits)


def test_a_feed_that_goes_nowhere_is_reported(butterfly, monkeypatch):
    monkeypatch.setattr("interp.literature.lookahead.MAX_SAMPLES", 100_000)
    with pytest.raises(StalledError, match="butterfly-nurbs: more than 100000 periods"):
        interpolate_adaptive(butterfly, AdaptiveLimits(1e-6, 1e-12, 1.0))
