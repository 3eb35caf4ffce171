"""The four feedrate limits of a curve against closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import nurbs_curves

from planner import FeedrateLimits, InputError, Limits, feedrate_limits, load_curve, load_limits
from planner.geometry.nurbs import NurbsCurve
from planner.machine.feed_limits import chord_feed_limit

PLAIN = {"feed": 100, "velocity": [250, 200], "acceleration": [1000, 800], "jerk": [2e4, 1e4]}


def limits(**changes):
    return Limits(**(PLAIN | changes))


class TestFeedrateLimits:
    def test_line(self):
        line = NurbsCurve([[0, 0], [30, 40]], [0, 0, 2, 2], 1)
        got = feedrate_limits(line, limits(chord_error=1e-3), np.linspace(0.0, 2.0, 5))
        np.testing.assert_array_equal(got.command, 100.0)
        np.testing.assert_allclose(got.axis_velocity, min(250 / 0.6, 200 / 0.8), rtol=1e-15)
        np.testing.assert_array_equal(got.chord_error, np.inf)
        np.testing.assert_array_equal(got.normal_acceleration, np.inf)
        np.testing.assert_array_equal(got.lowest, 100.0)

    def test_circle(self):
        radius, error, period, safety = 50.0, 1e-3, 2e-3, 0.18
        circle = load_curve("circle")
        machine = limits(chord_error=error, period=period)
        u = np.linspace(0.0, 1.0, 101)
        normal = (circle.derivatives(u, 0)[0] - [radius, 0.0]) / radius
        tangent = np.abs(normal[:, ::-1])
        for side in ("left", "right"):
            got = feedrate_limits(circle, machine, u, safety=safety, side=side)
            chord = 2.0 / period * np.sqrt(radius**2 - (radius - error) ** 2)
            np.testing.assert_allclose(got.chord_error, chord, rtol=1e-11)
            with np.errstate(divide="ignore"):
                speed = np.min([250.0, 200.0] / tangent, axis=1)
                turn = np.sqrt(safety * radius * np.min([1000.0, 800.0] / np.abs(normal), axis=1))
            np.testing.assert_allclose(got.axis_velocity, speed, rtol=1e-11)
            np.testing.assert_allclose(got.normal_acceleration, turn, rtol=1e-11)

    def test_lowest_of_the_four(self):
        u = np.linspace(0.0, 6.0, 200)
        got = feedrate_limits(load_curve("butterfly", scale=10.0), limits(chord_error=1e-4), u)
        rows = [got.command, got.axis_velocity, got.chord_error, got.normal_acceleration]
        np.testing.assert_array_equal(got.lowest, np.min(rows, axis=0))
        assert len({int(i) for i in np.argmin(rows, axis=0)}) >= 2

    @pytest.mark.parametrize("shape", [(), (3,), (2, 3), (0,)])
    def test_shape_follows_the_parameter(self, shape):
        got = feedrate_limits(load_curve("circle"), limits(), np.full(shape, 0.3))
        assert isinstance(got, FeedrateLimits)
        for row in (got.command, got.axis_velocity, got.chord_error, got.normal_acceleration, got.lowest):
            assert row.shape == shape

    def test_chord_limit_takes_the_radius_where_the_error_exceeds_it(self):
        machine = limits(chord_error=0.5, period=1e-3)
        # e = rho: (2/T) sqrt(2 rho^2 - rho^2) = 2 rho / T, the diameter in one period
        np.testing.assert_allclose(chord_feed_limit(np.array([1 / 0.5, 1 / 0.1, 1e6]), machine), [1e3, 200.0, 2e-3])
        # Below the radius the sagitta of the chord V T is e exactly.
        for radius in (0.6, 5.0, 1e4):
            chord = float(chord_feed_limit(np.array(1.0 / radius), machine)) * 1e-3
            assert radius - np.sqrt(radius**2 - 0.25 * chord**2) == pytest.approx(0.5, rel=1e-9)
        assert float(chord_feed_limit(np.array(0.0), machine)) == np.inf

    def test_chord_limit_rises_with_radius_and_error(self):
        radii = np.geomspace(1e-6, 1e6, 200)
        by_radius = chord_feed_limit(1.0 / radii, limits(chord_error=1e-3))
        assert (np.diff(by_radius) > 0.0).all()
        errors = [float(chord_feed_limit(np.array(2.0), limits(chord_error=e))) for e in np.geomspace(1e-6, 0.5, 50)]
        assert all(a < b for a, b in pairwise(errors))

    def test_no_limits_give_infinity(self):
        free = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2)
        np.testing.assert_array_equal(feedrate_limits(load_curve("circle"), free, [0.1, 0.5]).lowest, np.inf)

    def test_five_axes_are_measured_along_the_tip(self):
        flank, machine = load_curve("flank"), load_limits("five-axis")
        u = np.array([0.05, 0.33, 0.71])
        got = feedrate_limits(flank, machine, u)
        # Differences over the tip's arc length, independent of the chain rule.
        s, h = flank.arclength.s(u), 1e-3
        q = [flank.derivatives(flank.arclength.u(s + k * h), 0)[0] for k in (-1, 0, 1)]
        first, second = (q[2] - q[0]) / (2 * h), (q[2] - 2 * q[1] + q[0]) / h**2
        np.testing.assert_allclose(got.axis_velocity, np.min(machine.velocity / np.abs(first), axis=1), rtol=1e-5)
        turn = np.sqrt(np.min(machine.acceleration / np.abs(second), axis=1))
        np.testing.assert_allclose(got.normal_acceleration, turn, rtol=1e-4)
        np.testing.assert_array_equal(got.chord_error, chord_feed_limit(flank.tip.curvature(u), machine))
        np.testing.assert_array_equal(got.command, np.inf)

    def test_resting_tip_has_no_feedrate_limit_but_the_command(self):
        points = [[0, 0, 0], [3, 4, 1], [3, 4, 2], [6, 8, 2]]
        curve = NurbsCurve(points, [0, 0, 1, 2, 3, 3], 1, axes=["X", "Y", "A"])
        machine = Limits(50, [9, 9, 9], [9, 9, 9], [9, 9, 9], chord_error=1e-3, axes=["X", "Y", "A"])
        np.testing.assert_array_equal(feedrate_limits(curve, machine, [1.2, 1.9]).lowest, 50.0)

    @pytest.mark.parametrize("safety", [0.0, -0.5, 1.0001, np.nan, np.inf, "1", None])
    def test_safety_factor_is_in_0_to_1(self, safety):
        with pytest.raises(InputError, match="safety = "):
            feedrate_limits(load_curve("circle"), limits(), 0.5, safety=safety)

    def test_parameter_outside_the_domain_is_refused(self):
        with pytest.raises(InputError, match="must lie within"):
            feedrate_limits(load_curve("circle"), limits(), 1.5)

    @settings(max_examples=40)
    @given(nurbs_curves(max_degree=4), st.sampled_from([1e-3, 0.5, 20.0]))
    def test_lengths_scaled_together_scale_every_limit(self, curve, factor):
        row = np.arange(1.0, curve.dim + 1.0)
        machine = Limits(100, 50 * row, 900 * row, 1e4 * row, chord_error=1e-3)
        sized = Limits(100 * factor, 50 * factor * row, 900 * factor * row, 1e4 * row, chord_error=1e-3 * factor)
        large = NurbsCurve(curve.control_points * factor, curve.knots, curve.degree, curve.weights)
        u = np.linspace(*curve.domain, 7)
        a, b = feedrate_limits(curve, machine, u), feedrate_limits(large, sized, u)
        np.testing.assert_allclose(b.axis_velocity, factor * a.axis_velocity, rtol=1e-9)
        np.testing.assert_allclose(b.chord_error, factor * a.chord_error, rtol=1e-7)
        np.testing.assert_allclose(b.normal_acceleration, factor * a.normal_acceleration, rtol=1e-6)
