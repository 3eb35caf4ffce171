"""What must not change the optimum of the interior-point method."""

import numpy as np
import pytest
from cases import drives
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from problems import NO_SHRINKING, SEEDS, duration, random_case
from strategies import insert_knot

from planner import load_curve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan import plan_feedrate


def reversed_nurbs(curve):
    u0, u1 = curve.domain
    return NurbsCurve(
        curve.control_points[::-1], (u0 + u1 - curve.knots)[::-1], curve.degree, curve.weights[::-1], curve.axes
    )


def moved_parameter(curve, factor, shift):
    return NurbsCurve(curve.control_points, factor * curve.knots + shift, curve.degree, curve.weights, curve.axes)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS)
def test_reversing_the_path_leaves_the_duration(seed):
    curve, limits = random_case(seed)
    assert duration(reversed_nurbs(curve), limits) == pytest.approx(duration(curve, limits), rel=5e-4)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.floats(0.05, 0.95))
def test_inserting_a_knot_leaves_the_duration(seed, u):
    curve, limits = random_case(seed)
    assume(np.abs(curve.knots - u).min() > 0.02)
    assert duration(insert_knot(curve, u), limits) == pytest.approx(duration(curve, limits), rel=5e-4)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from([1e-4, 3.0, 1e4]), st.sampled_from([-5.0, 0.0, 1.0]))
def test_an_affine_change_of_the_parameter_leaves_the_duration(seed, factor, shift):
    curve, limits = random_case(seed)
    moved = moved_parameter(curve, factor, factor * shift)
    assert duration(moved, limits) == pytest.approx(duration(curve, limits), rel=2e-5)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from([-18, -6, 12]))
def test_another_unit_of_length_leaves_the_plan(seed, power):
    curve, limits = random_case(seed)
    k = 2.0**power
    scaled = NurbsCurve(k * curve.control_points, curve.knots, curve.degree, curve.weights)
    other = Limits(
        k * limits.feed, k * limits.velocity, k * limits.acceleration, k * limits.jerk, k * limits.chord_error
    )
    first, second = plan_feedrate(curve, limits), plan_feedrate(scaled, other)
    assert second.duration == pytest.approx(first.duration, rel=1e-12)


@pytest.mark.parametrize("factor", [1e-6, 1e3])
def test_millimetres_to_kilometres_or_micrometres(factor):
    curve, scaled = load_curve("teardrop"), load_curve("teardrop", scale=factor)
    k = factor
    other = Limits(100 * k, [250 * k] * 2, [1000 * k] * 2, [20000 * k] * 2, chord_error=1e-3 * k)
    assert duration(scaled, other) == pytest.approx(duration(curve, drives(chord_error=1e-3)), rel=1e-9)


@settings(max_examples=4, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from([0.125, 64.0]))
def test_slower_in_proportion_takes_as_much_longer(seed, k):
    curve, limits = random_case(seed)
    slow = Limits(
        limits.feed / k,
        limits.velocity / k,
        limits.acceleration / k**2,
        limits.jerk / k**3,
        limits.chord_error,
        limits.period * k,
    )
    assert duration(curve, slow) == pytest.approx(k * duration(curve, limits), rel=1e-9)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from(["feed", "velocity", "acceleration", "jerk", "chord_error"]), st.floats(1.05, 3.0))
def test_a_wider_limit_costs_no_time(seed, which, factor):
    curve, limits = random_case(seed)
    names = ("feed", "velocity", "acceleration", "jerk", "chord_error")
    wider = Limits(*(getattr(limits, name) * (factor if name == which else 1.0) for name in names))
    assert duration(curve, wider) <= duration(curve, limits) * (1.0 + 5e-4)


@settings(max_examples=3, phases=NO_SHRINKING)
@given(SEEDS)
def test_the_same_input_gives_the_same_bits(seed):
    curve, limits = random_case(seed)
    first, second = plan_feedrate(curve, limits), plan_feedrate(*random_case(seed))
    assert all(np.array_equal(getattr(first, k), getattr(second, k)) for k in ("t", "u", "u_rate", "u_acceleration"))
