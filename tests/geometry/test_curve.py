"""What every curve answers: one-sided derivatives, curvature, breaks, cusps, tool tip, fingerprint."""

import subprocess
import sys

import numpy as np
import pytest
from curve_reference import evaluate_pieces
from hypothesis import given, settings
from strategies import insert_knot, nurbs_curves, oracle, random_nurbs

from planner import CurveError, InputError, load_curve
from planner.geometry.continuity import continuity_at
from planner.geometry.curve import Pieces
from planner.geometry.differential import arc_derivatives
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve

LINE_AND_ARC = NurbsCurve(  # 10 mm along X, then a quarter circle of radius 4 mm
    [[0, 0], [5, 0], [10, 0], [14, 0], [14, 4]],
    [0, 0, 0, 1, 1, 2, 2, 2],
    2,
    [1, 1, 1, np.sqrt(0.5), 1],
    name="line-arc",
)


def polyline(*points):
    return NurbsCurve(points, [0, *range(len(points)), len(points) - 1], 1)


class TestDerivatives:
    def test_shape_follows_the_parameter(self):
        curve = random_nurbs(1, 3, 3)
        assert curve.derivatives(0.5).shape == (4, 3)
        assert curve.derivatives(np.full((2, 5), 0.5), 1).shape == (2, 2, 5, 3)
        assert curve.derivatives([], 2).shape == (3, 0, 3)
        assert curve.curvature(np.full((2, 5), 0.5)).shape == (2, 5)

    @pytest.mark.parametrize("name", ["circle", "butterfly", "flank"])
    def test_lower_order_is_the_beginning_of_a_higher_one(self, name):
        curve = load_curve(name)
        u = np.linspace(*curve.domain, 17)
        whole = curve.derivatives(u)
        for order in range(3):
            np.testing.assert_array_equal(curve.derivatives(u, order), whole[: order + 1])

    def test_ends_take_the_inner_value_from_either_side(self):
        curve = random_nurbs(2, 3, 2)
        for u in curve.domain:
            np.testing.assert_array_equal(curve.derivatives(u, side="left"), curve.derivatives(u, side="right"))

    def test_sides_differ_at_a_break_and_only_there(self):
        curve = polyline([0, 0], [3, 0], [3, 4])
        np.testing.assert_array_equal(curve.derivatives(1.0, 1, side="left")[1], [3, 0])
        np.testing.assert_array_equal(curve.derivatives(1.0, 1, side="right")[1], [0, 4])
        below, above = np.nextafter(1.0, 0.0), np.nextafter(1.0, 2.0)
        for side in ("left", "right"):
            np.testing.assert_array_equal(curve.derivatives([below, above], 1, side=side)[1], [[3, 0], [0, 4]])

    def test_unsorted_parameters_give_the_values_of_sorted_ones(self):
        curve = load_curve("butterfly-nurbs")
        u = np.random.default_rng(3).uniform(*curve.domain, 500)
        order = np.argsort(u)
        np.testing.assert_array_equal(curve.derivatives(u)[:, order], curve.derivatives(u[order]))

    @pytest.mark.parametrize("u", [-1e-9, 1.0000001, np.nan, np.inf, [0.5, 2.0], "half", None, 1j])
    def test_parameter_outside_the_domain_is_refused(self, u):
        with pytest.raises(InputError, match="u"):
            load_curve("circle").derivatives(u)

    @pytest.mark.parametrize("order", [-1, 4, 1.5, "1", None])
    def test_order_other_than_0_to_3_is_refused(self, order):
        with pytest.raises(InputError, match="must be 0, 1, 2 or 3"):
            load_curve("circle").derivatives(0.5, order)

    @pytest.mark.parametrize("side", ["middle", "", None, 1, ["left"]])
    def test_side_other_than_left_and_right_is_refused(self, side):
        with pytest.raises(InputError, match='must be "left" or "right"'):
            load_curve("circle").derivatives(0.5, side=side)


class TestArcDerivatives:
    def test_helix(self):
        radius, pitch = 3.0, 0.5
        c = np.hypot(radius, pitch)
        curve = FormulaCurve({"X": f"{radius}*cos(u**2)", "Y": f"{radius}*sin(u**2)", "Z": f"{pitch}*u**2"}, (1.0, 2.0))
        u = np.linspace(1.0, 2.0, 11)
        angle = u**2
        arc = arc_derivatives(curve.derivatives(u))
        zero, turn = np.zeros_like(u), np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        side = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        np.testing.assert_allclose(arc[1], np.column_stack([radius * side, zero + pitch]) / c, atol=1e-14)
        np.testing.assert_allclose(arc[2], np.column_stack([-radius * turn, zero]) / c**2, atol=1e-13)
        np.testing.assert_allclose(arc[3], np.column_stack([-radius * side, zero]) / c**3, atol=1e-12)

    def test_curvature_of_a_helix_in_space(self):
        curve = FormulaCurve({"X": "3*cos(u)", "Y": "3*sin(u)", "Z": "4*u"}, (0.0, 6.0))
        np.testing.assert_allclose(curve.curvature(np.linspace(0.0, 6.0, 20)), 3.0 / 25.0, rtol=1e-14)

    def test_curvature_keeps_its_digits_on_a_nearly_straight_curve(self):
        curve = FormulaCurve({"X": "1000*u + u**2", "Y": "1e-7*u**2"}, (0.0, 1.0))
        assert curve.curvature(0.0) == pytest.approx(2e-7 / 1e6, rel=1e-9, abs=0.0)


class TestBreaks:
    def test_corner(self):
        (corner,) = polyline([0, 0], [3, 0], [3, 4]).breaks
        assert (corner.u, corner.parametric, corner.geometric) == (1.0, 0, 0)
        assert corner.angle == pytest.approx(np.pi / 2, abs=1e-15)

    def test_polyline_with_a_straight_joint(self):
        first, second, third = polyline([0, 0], [1, 0], [4, 0], [4, 1], [4, 2.5]).breaks
        assert [b.geometric for b in (first, second, third)] == [3, 0, 3]
        assert [b.parametric for b in (first, second, third)] == [0, 0, 0]

    @pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.3, 3.0, np.pi])
    def test_angle_of_a_corner(self, angle):
        (corner,) = polyline([0, 0, 0], [3, 0, 0], [3 + np.cos(angle), np.sin(angle), 0]).breaks
        assert corner.geometric == 0
        assert corner.angle == pytest.approx(angle, rel=1e-9, abs=0.0)

    def test_line_into_arc_is_tangent_with_a_jump_of_curvature(self):
        (joint,) = LINE_AND_ARC.breaks
        assert (joint.u, joint.geometric) == (1.0, 1)
        assert joint.angle == pytest.approx(0.0, abs=1e-12)
        assert joint.curvature_jump == pytest.approx(1 / 4, rel=1e-12)

    def test_circle_jumps_in_its_second_derivative_but_not_in_its_curvature(self):
        circle = load_curve("circle")
        (joint,) = circle.breaks
        assert (joint.u, joint.parametric, joint.geometric) == (0.5, 1, 3)
        left, right = circle.derivatives(0.5, side="left"), circle.derivatives(0.5, side="right")
        assert np.abs(left[2] - right[2]).max() > 100.0
        assert circle.curvature(0.5, side="left") == pytest.approx(circle.curvature(0.5, side="right"), rel=1e-13)

    def test_tangent_continuous_but_not_in_the_parameter(self):
        # One straight line, run through with a jump of |C'|: no corner, no curvature.
        curve = NurbsCurve([[0, 0], [1, 2], [3, 6], [4, 8]], [0, 0, 1, 2, 3, 3], 1)
        assert [(b.parametric, b.geometric) for b in curve.breaks] == [(0, 3), (0, 3)]

    @pytest.mark.parametrize(("degree", "repeat"), [(3, 1), (3, 2), (3, 3), (4, 2), (4, 3), (5, 3), (2, 1)])
    def test_knot_of_multiplicity_m_has_order_degree_less_m(self, degree, repeat):
        curve = random_nurbs(degree * 10 + repeat, degree, 3, spans=2, repeat=repeat)
        (joint,) = curve.breaks
        assert joint.parametric == degree - repeat
        assert joint.geometric == degree - repeat

    @pytest.mark.parametrize(("degree", "repeat"), [(4, 1), (5, 1), (5, 2), (7, 3)])
    def test_smooth_knots_are_no_breaks(self, degree, repeat):
        assert random_nurbs(9, degree, 2, spans=2, repeat=repeat).breaks == ()

    def test_jumps_have_the_size_that_exact_arithmetic_gives(self):
        curve = random_nurbs(13, 3, 2, spans=2, repeat=2)
        (joint,) = curve.breaks
        left, right = (arc_derivatives(oracle(curve, joint.u, side)[:, None])[:, 0] for side in ("left", "right"))
        assert joint.curvature_jump == pytest.approx(np.abs(left[2] - right[2]).max(), rel=1e-9)
        corner = random_nurbs(14, 3, 2, spans=2, repeat=3)
        (joint,) = corner.breaks
        tangents = [oracle(corner, joint.u, side)[1] for side in ("left", "right")]
        cosine = np.dot(*tangents) / np.prod([np.linalg.norm(t) for t in tangents])
        assert joint.angle == pytest.approx(np.arccos(cosine), rel=1e-9)

    @pytest.mark.parametrize("count", [5, 60, 2000])
    def test_straight_line_with_many_knots_has_no_breaks(self, count):
        knots = np.concatenate([np.zeros(4), np.arange(1, count - 3) / (count - 3), np.ones(4)])
        greville = np.array([knots[i + 1 : i + 4].mean() for i in range(count)])
        line = NurbsCurve(np.outer(greville, [30.0, 40.0]) + np.array([1e3, -2e3]), knots, 3)
        assert [b for b in line.breaks if b.parametric < 2 or b.geometric < 3] == []

    def test_fine_spline_of_a_smooth_curve_breaks_only_in_the_third_derivative(self):
        from scipy.interpolate import make_interp_spline

        u = np.linspace(0.0, 1.0, 200)
        spline = make_interp_spline(u, np.column_stack([50 * np.cos(4 * u), 30 * np.sin(5 * u)]), k=3)
        curve = NurbsCurve(spline.c, spline.t, 3)
        assert {b.parametric for b in curve.breaks} == {2}
        assert {b.geometric for b in curve.breaks} == {2}

    def test_far_from_the_origin_rounding_makes_no_breaks(self):
        curve = random_nurbs(21, 5, 2, spans=6)
        moved = NurbsCurve(curve.control_points + 1e5, curve.knots, 5, curve.weights)
        assert moved.breaks == ()

    @settings(max_examples=40)
    @given(nurbs_curves())
    def test_knot_insertion_scale_and_reversal_leave_the_order_of_every_break(self, curve):
        orders = [(b.parametric, b.geometric) for b in curve.breaks]
        u0, u1 = curve.domain
        places = [0.5 * (a + b) for a, b in zip(curve.pieces.breaks[:-1], curve.pieces.breaks[1:], strict=True)]
        assert [(b.parametric, b.geometric) for b in insert_knot(curve, places[0]).breaks] == orders
        big = NurbsCurve(curve.control_points * 1e4, curve.knots, curve.degree, curve.weights)
        assert [(b.parametric, b.geometric) for b in big.breaks] == orders
        slow = NurbsCurve(curve.control_points, curve.knots * 1e3, curve.degree, curve.weights)
        assert [(b.parametric, b.geometric) for b in slow.breaks] == orders
        back = NurbsCurve(curve.control_points[::-1], u0 + u1 - curve.knots[::-1], curve.degree, curve.weights[::-1])
        assert [(b.parametric, b.geometric) for b in back.breaks] == orders[::-1]

    def test_smooth_point_counts_as_order_3(self):
        joint = continuity_at(load_curve("circle"), 0.4)
        assert (joint.parametric, joint.geometric, joint.angle) == (3, 3, 0.0)

    def test_a_rotary_axis_that_turns_back_beside_a_long_way_is_a_corner(self):
        """1e10 mm of X while A goes to 5 rad and back: its kink is 1e-9 of the tangent, and all that A ever does."""
        points = [[0.0, 0.0], [5e9, 5.0], [1e10, 0.0]]
        curve = NurbsCurve(points, [0.0, 0.0, 0.5, 1.0, 1.0], 1, axes=("X", "A"))
        assert [b.geometric for b in curve.breaks] == [0]
        straight = NurbsCurve([[0.0, 0.0], [5e9, 5.0], [1e10, 10.0]], curve.knots, 1, axes=("X", "A"))
        assert straight.breaks == ()


def tripled_point(u):
    """Cubic with a tripled control point at a simple interior knot, which stops the curve there."""
    points = [[0, 0], [2, 4], [5, 5], [5, 5], [5, 5], [8, 4], [11, 0]]
    return NurbsCurve(points, [0, 0, 0, 0, 0.5 * u, u, 0.5 * (1 + u), 1, 1, 1, 1], 3)


class TestCusps:
    @pytest.mark.parametrize(
        ("x", "y", "domain"),
        [
            ("cos(u)**3", "sin(u)**3", (0.0, 6.283185307179586)),
            ("cos(u)**3", "sin(u)**3", (0.1234, 3.0)),
            ("cos(u)**3", "sin(u)**3", (0.1234, 500.0)),
            ("u**2", "u**3", (-1.0, 0.7)),
            ("u**2", "u**3", (0.0, 1.0)),
            ("(u - 0.123456789)**3", "(u - 0.123456789)**2", (0.0, 1.0)),
            ("u - sin(u)", "1 - cos(u)", (1.0, 10.0)),
            ("u + tanh(50*(u-0.3)) - 51*(u-0.3)", "(u-0.3)**2", (0.0, 1.0)),
        ],
        ids=[
            "astroid",
            "cut astroid",
            "astroid over and over",
            "parabola",
            "at the start",
            "hidden",
            "cycloid",
            "steep",
        ],
    )
    def test_formula_with_a_cusp_is_refused(self, x, y, domain):
        with pytest.raises(CurveError, match="cusp"):
            FormulaCurve({"X": x, "Y": y}, domain)

    @pytest.mark.parametrize("u", [0.5, 0.3, 0.123456789])
    def test_tripled_control_point_is_refused(self, u):
        with pytest.raises(CurveError, match=f"u = {u}"):
            tripled_point(u)

    def test_cusp_inside_a_span_is_refused(self):
        # Control points of a loop that has just closed up: C' = 0 at u = 1/2, between the scan's points of other knots.
        for knots in ([0, 0, 0, 0, 1, 1, 1, 1], [-0.3, 0, 0, 0, 1, 1, 1, 1.7]):
            with pytest.raises(CurveError, match="cusp"):
                NurbsCurve([[0, 0], [1, 1], [0, 1], [1, 0]], knots, 3)

    def test_cusp_on_the_left_of_a_break_is_found(self):
        # The first span runs into its end with C' = 0, the second leaves at full speed.
        with pytest.raises(CurveError, match="cusp"):
            NurbsCurve([[0, 0], [4, 0], [4, 0], [4, 3], [0, 3]], [0, 0, 0, 0.5, 0.5, 1, 1, 1], 2)

    def test_curve_that_turns_back_on_itself_is_refused(self):
        with pytest.raises(CurveError, match="cusp"):
            FormulaCurve({"X": "sin(u)", "Y": "2*sin(u)"}, (0.0, 3.0))

    @pytest.mark.parametrize("slow", [1e-2, 1e-4, 1e-6, 1e-8])
    def test_slow_but_moving_curves_are_not_refused(self, slow):
        FormulaCurve({"X": f"cos(u)**3 + {slow}*cos(u)", "Y": f"sin(u)**3 - {slow}*sin(u)"}, (0.1, 6.0))
        FormulaCurve({"X": f"u**2 + {slow}*u", "Y": "u**3"}, (0.0, 1.0))
        FormulaCurve({"X": f"u**3 + {slow}*u", "Y": "u**2"}, (-1.0, 1.0))
        NurbsCurve([[0, 0], [slow, 0], [3, 1], [4, 0]], [0, 0, 0, 0, 1, 1, 1, 1], 3)

    def test_uneven_parametrisation_is_not_a_cusp(self):
        spiral = FormulaCurve({"X": "exp(u)*cos(u)", "Y": "exp(u)*sin(u)"}, (-15.0, 15.0))
        speed = np.linalg.norm(spiral.derivatives(np.array(spiral.domain), 1)[1], axis=-1)
        assert speed[0] < 1e-12 * speed[1]
        uneven = NurbsCurve(random_nurbs(3, 3, 2).control_points, [0, 0, 0, 0, 1e-5, 0.5, 0.6, 1, 1, 1, 1], 3)
        assert uneven.length > 10.0

    @pytest.mark.parametrize("size", [1e-6, 1e8], ids=["1 nm", "100 km"])
    def test_very_small_and_very_large_curves_load(self, size):
        small = load_curve("butterfly-nurbs", scale=size / 100.0)
        assert small.length == pytest.approx(382.8565834742799 * size / 100.0, rel=1e-12, abs=0.0)
        formula = FormulaCurve({"X": f"{size}*cos(u)", "Y": f"{size}*sin(u)"}, (0.0, 3.0))
        assert formula.length == pytest.approx(3.0 * size, rel=1e-13, abs=0.0)

    def test_curve_without_length_is_refused(self):
        with pytest.raises(CurveError, match="length 0"):
            FormulaCurve({"X": "1", "Y": "2 + 0*u"}, (0.0, 1.0))

    def test_curve_that_rests_for_a_while_is_refused(self):
        with pytest.raises(CurveError, match="rest"):
            NurbsCurve([[0, 0], [1, 1], [1, 1], [2, 0]], [0, 0, 1, 2, 3, 3], 1)


class TestToolTip:
    def resting(self, weights=None):
        """The tip rests on u in [1, 2] while A turns; a polyline in X, Y, A."""
        points = [[0, 0, 0], [3, 4, 0.5], [3, 4, 1.5], [6, 8, 1.5]]
        return NurbsCurve(points, [0, 0, 1, 2, 3, 3], 1, weights, ["X", "Y", "A"])

    def test_cartesian_curve_is_its_own_tip(self):
        curve = random_nurbs(1, 3, 6)
        assert curve.tip is curve
        assert curve.axis_units == ("mm",) * 6

    def test_tip_is_the_linear_axes(self):
        curve = NurbsCurve(
            random_nurbs(5, 3, 4).control_points, random_nurbs(5, 3, 4).knots, 3, axes=["X", "A", "Z", "C"]
        )
        assert curve.axis_units == ("mm", "rad", "mm", "rad")
        assert curve.tip.axes == ("X", "Z")
        u = np.linspace(0.0, 1.0, 9)
        for side in ("left", "right"):
            whole, tip = curve.derivatives(u, side=side), curve.tip.derivatives(u, side=side)
            np.testing.assert_array_equal(tip, whole[..., [0, 2]])
        np.testing.assert_array_equal(curve.tip.pieces.evaluate(u, 3, False), curve.tip.derivatives(u))
        assert [b.u for b in curve.tip.breaks] == [b.u for b in curve.breaks]

    def test_resting_tip_is_legal(self):
        curve = self.resting()
        assert curve.length == pytest.approx(10.0, rel=1e-15)
        u = np.linspace(1.0, 2.0, 5)
        np.testing.assert_array_equal(curve.tip.derivatives(u, side="left")[1, 1:], 0.0)
        np.testing.assert_array_equal(curve.tip.curvature(u[:-1]), 0.0)
        assert np.linalg.norm(curve.derivatives(u, 1)[1], axis=-1).min() > 0.0

    def test_breaks_where_the_tip_starts_and_stops(self):
        curve = self.resting()
        assert [b.geometric for b in curve.breaks] == [0, 0]
        assert [(b.parametric, b.geometric, b.angle) for b in curve.tip.breaks] == [(0, 0, 0.0), (0, 0, 0.0)]

    @pytest.mark.parametrize("weights", [None, [1, 2, 1, 0.5, 1, 2, 1, 1.5, 1]], ids=["plain", "rational"])
    def test_resting_tip_of_a_smooth_curve(self, weights):
        turn = [[4, 3, 0.5 + 0.2 * k] for k in range(5)]
        points = [[0, 0, 0], [1, 1, 0.1], [2, 2, 0.4], *turn, [6, 2, 2.0]]
        curve = NurbsCurve(points, [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 6, 6, 6], 3, weights, ["X", "Y", "A"])
        rest = np.linspace(3.0, 5.0, 9)
        np.testing.assert_array_equal(curve.tip.derivatives(rest[:-1])[1:], 0.0)
        np.testing.assert_array_equal(curve.tip.derivatives(rest[1:], side="left")[1:], 0.0)
        np.testing.assert_array_equal(curve.tip.curvature(rest[:-1]), 0.0)
        for u, side in ((3.0, "left"), (5.0, "right")):
            assert np.abs(curve.tip.derivatives(u, side=side)[3]).max() > 1.0
        assert np.abs(curve.derivatives(rest, 1)[1, :, 2]).min() > 0.05

    def test_tip_of_a_machine_that_only_turns_has_no_length(self):
        curve = NurbsCurve([[0, 0], [1, 2], [3, 1]], [0, 0, 0, 1, 1, 1], 2, axes=["A", "C"])
        assert curve.tip.dim == 0
        assert curve.length == 0.0

    def test_scan_for_cusps_counts_the_rotary_axes(self):
        with pytest.raises(CurveError, match="cusp"):
            NurbsCurve([[0, 0, 1], [1, 1, 1], [0, 0, 1]], [0, 0, 0, 1, 1, 1], 2, axes=["X", "Y", "A"])


class TestFingerprint:
    def test_differs_where_the_curve_differs(self):
        curves = [load_curve(name) for name in ("teardrop", "butterfly", "circle", "flank")]
        curves += [load_curve("butterfly", scale=2.0), load_curve("circle", scale=2.0), load_curve("circle").tip]
        prints = [curve.fingerprint for curve in curves]
        assert len(set(prints)) == len(prints) - 1  # the tip of a plane curve is the curve itself

    def test_equal_definitions_have_equal_fingerprints(self):
        whole = FormulaCurve({"X": "u", "Y": "u**2"}, (0, 1), scale=2)
        real = FormulaCurve({"X": "u", "Y": "u**2"}, (0.0, 1.0), scale=2.0, name="another name")
        assert whole.fingerprint == real.fingerprint
        ints = NurbsCurve([[0, 0], [1, 1]], [0, 0, 1, 1], 1)
        floats = NurbsCurve(np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([0.0, 0.0, 1.0, 1.0]), np.int64(1))
        assert ints.fingerprint == floats.fingerprint

    def test_is_the_same_in_another_process(self):
        command = "from planner import load_curve; print(*(load_curve(n).fingerprint for n in ('butterfly', 'flank')))"
        there = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
        assert there.stdout.split() == [load_curve("butterfly").fingerprint, load_curve("flank").fingerprint]


def random_pieces(seed):
    """Pieces of 1 to 4 coordinates, rational or not, some coordinates at rest, one narrow and one denominator that is 0."""
    rng = np.random.default_rng(seed)
    count, dim, terms, rational = (
        int(rng.integers(1, 9)),
        int(rng.integers(1, 5)),
        int(rng.integers(1, 11)),
        seed % 2 == 1,
    )
    coefficients = rng.normal(size=(count, dim + 1, terms)) * 10.0 ** rng.integers(-3, 4, size=(count, 1, 1))
    if rational and seed % 3 == 0:
        coefficients[0, -1] = 0.0
    widths = rng.uniform(0.1, 1.0, count)
    widths[-1] = 1e-12 if seed % 5 == 0 else widths[-1]
    breaks = np.concatenate([[-0.3], -0.3 + np.cumsum(widths)])
    return Pieces(breaks, coefficients, rational, rng.random((count, dim)) < 0.2, rng.normal(size=(count, dim)))


class TestCompiled:
    @pytest.mark.parametrize("seed", range(30))
    def test_the_bits_are_those_of_plain_python(self, seed):
        pieces, rng = random_pieces(seed), np.random.default_rng([seed, 1])
        b = pieces.breaks
        u = np.concatenate(
            [b, np.nextafter(b, np.inf), np.nextafter(b, -np.inf), rng.uniform(b[0] - 0.1, b[-1] + 0.1, 60)]
        )
        u, left = rng.permutation(u), rng.random(u.size) < 0.5
        for order in range(4):
            expected = np.empty((order + 1, u.size, pieces.origin.shape[1]))
            with np.errstate(all="ignore"):
                evaluate_pieces(
                    b, pieces.coefficients, pieces.rational, pieces.resting, pieces.origin, u, left, order, expected
                )
            found = pieces.evaluate(u, order, left)
            # a result that is not a number has no bits to agree on
            assert np.array_equal(np.isnan(found), np.isnan(expected))
            assert np.array_equal(found[~np.isnan(found)].view(np.int64), expected[~np.isnan(found)].view(np.int64))

    def test_the_seeds_hold_what_they_should(self):
        every = [random_pieces(seed) for seed in range(30)]
        assert sum(p.rational for p in every) == 15
        assert any(not p.coefficients[0, -1].any() for p in every)
        assert sum(p.resting.any() for p in every) > 10
