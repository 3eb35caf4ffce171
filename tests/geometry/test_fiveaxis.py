"""The table-tilting A/C machine against its kinematics in 50 digits."""

import mpmath
import numpy as np
import pytest
from strategies import derivatives_of, exact_nurbs, span_of

from planner import CurveError, load_curve
from planner.geometry.fiveaxis import DualSplineCurve
from planner.geometry.nurbs import NurbsCurve

KNOTS = [0, 0, 0, 0, 1, 1, 1, 1]


def machine_axes(bottom, top, near):
    """Axes for a tool tip and a point on the tool axis; C on the branch of atan2 next to ``near``.

    Ma, Yuan, Shen, Gao, J. Computational Design and Engineering 9 (2022) 2355-2374, section 4.3, by rotating the
    workpiece: first about Z until the tool axis lies in the plane X = 0, then about X until it is vertical.
    """
    i, j, k = (t - b for b, t in zip(bottom, top, strict=True))
    tilt, turn = mpmath.acos(k / mpmath.sqrt(i * i + j * j + k * k)), mpmath.atan2(i, j)
    turn += 2 * mpmath.pi * mpmath.nint((near - turn) / (2 * mpmath.pi))
    about_z = mpmath.matrix(
        [[mpmath.cos(turn), -mpmath.sin(turn), 0], [mpmath.sin(turn), mpmath.cos(turn), 0], [0, 0, 1]]
    )
    about_x = mpmath.matrix(
        [[1, 0, 0], [0, mpmath.cos(tilt), -mpmath.sin(tilt)], [0, mpmath.sin(tilt), mpmath.cos(tilt)]]
    )
    upright = about_x * about_z * mpmath.matrix([i, j, k])
    assert abs(upright[0]) < 1e-40
    assert abs(upright[1]) < 1e-40
    return [*(about_x * about_z * mpmath.matrix(bottom)), tilt, turn]


def oracle(curve, u, side):
    """Derivatives 0..3 of the five axes (4, 5) from one side."""
    near = curve.derivatives(u, 0)[0, 4]
    with mpmath.workdps(50):
        span = span_of(curve.bottom, u, side)
        bottom, top = exact_nurbs(curve.bottom, span), exact_nurbs(curve.top, span)
        return derivatives_of(lambda x: machine_axes(bottom(x), top(x), near), u, 5)


def dual(bottom, top, knots=None, degree=3):
    """Dual spline from the control points of its two splines."""
    knots = KNOTS if knots is None else knots
    return DualSplineCurve(
        NurbsCurve(bottom, knots, degree, rests_allowed=True), NurbsCurve(top, knots, degree, rests_allowed=True)
    )


def leaning(angles, knots=None):
    """Tip along a line while the tool, tilted by 0.3 rad or so, turns through the given directions."""
    bottom = np.array([[10.0 * n, n % 2, 0.0] for n in range(len(angles))])
    tool = np.array([[3.0 * np.sin(a), 3.0 * np.cos(a), 10.0] for a in angles])
    return dual(bottom, bottom + tool, knots)


@pytest.mark.parametrize("side", ["left", "right"])
def test_flank_derivatives_agree_with_the_kinematics(side):
    flank = load_curve("flank")
    u = [0.0, 0.05, 0.1009, 0.2, 0.31, 0.4, 0.55, 0.6, 0.8, 0.93, 1.0]
    expected = np.stack([oracle(flank, x, side) for x in u], axis=1)
    error = np.abs(flank.derivatives(u, side=side) - expected).max(axis=1)
    size = np.abs(expected).max(axis=1)
    assert (error <= np.array([2e-14, 4e-14, 2e-13, 1e-12])[:, None] * size).all(), (error / size).max(axis=1)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_tip_that_comes_with_the_axes_is_the_bottom_spline(order):
    curve = load_curve("flank")
    knots = np.concatenate([[curve.domain[0]], curve._candidate_breaks(), [curve.domain[1]]])
    u = np.sort(np.concatenate([knots, np.random.default_rng(order).uniform(*curve.domain, 90)]))
    left = np.arange(u.size) % 2 == 0
    axes, tip = curve.derivatives_with_tip(u, order, side=left)
    assert (axes == curve.derivatives(u, order, side=left)).all()
    assert (tip == curve.bottom.derivatives(u, order, side=left)).all()


def test_cartesian_axes_are_their_own_tip():
    curve = load_curve("circle")
    axes, tip = curve.derivatives_with_tip(np.array([[0.1], [0.2]]), 2)
    assert tip is axes
    assert (axes == curve.derivatives(np.array([[0.1], [0.2]]), 2)).all()


def test_flank_is_the_published_path():
    flank = load_curve("flank")
    assert flank.axes == ("X", "Y", "Z", "A", "C")
    assert flank.axis_units == ("mm", "mm", "mm", "rad", "rad")
    assert flank.tip is flank.bottom
    assert flank.length == pytest.approx(98.16813287344424, rel=1e-14)
    assert flank.top.length == pytest.approx(115.34974176977695, rel=1e-14)
    assert flank.tip.curvature(0.10095) == pytest.approx(0.2447549069783437, rel=1e-6)


def test_flank_breaks_in_its_third_derivative_at_every_knot():
    breaks = load_curve("flank").breaks
    assert [b.u for b in breaks] == [0.2, 0.4, 0.6, 0.8]
    assert {(b.parametric, b.geometric) for b in breaks} == {(2, 2)}


def test_scale_leaves_the_angles():
    u = np.linspace(0.0, 1.0, 7)
    plain, large = load_curve("flank").derivatives(u), load_curve("flank", scale=3.0).derivatives(u)
    np.testing.assert_allclose(large, plain * [3.0, 3.0, 3.0, 1.0, 1.0], rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize("turns", [0.4, 1.5, -2.2])
def test_rotary_axis_turns_on_without_a_jump(turns):
    angles = 3.0 + 2.0 * np.pi * turns * np.linspace(0.0, 1.0, 12)
    curve = leaning(angles, np.concatenate([np.zeros(4), np.arange(1, 9) / 9.0, np.ones(4)]))
    u = np.linspace(0.0, 1.0, 5000)
    c = curve.derivatives(u, 0)[0, :, 4]
    assert np.abs(np.diff(c)).max() < 0.02
    assert c[-1] - c[0] == pytest.approx(2.0 * np.pi * turns, abs=1e-9)
    rate = curve.derivatives(u, 1)[1, :, 4]
    assert np.trapezoid(rate, u) == pytest.approx(c[-1] - c[0], abs=1e-3)
    # One point alone lies on the same branch as in the whole.
    np.testing.assert_allclose([curve.derivatives(x, 0)[0, 4] for x in u[::500]], c[::500], rtol=1e-14)


def test_pieces_follow_the_machine_axes():
    flank = load_curve("flank")
    u = np.random.default_rng(2).uniform(0.0, 1.0, 3000)
    exact = flank.derivatives(u, 0)[0]
    error = np.abs(flank.pieces.evaluate(u, 0, False)[0] - exact).max(axis=0)
    assert (error[:3] <= 1.5e-13 * np.ptp(exact[:, :3], axis=0).max()).all()
    assert (error[3:] <= 1.5e-13 * max(1.0, np.ptp(exact[:, 3:], axis=0).max())).all()
    assert set(flank.tip.pieces.breaks) <= set(flank.pieces.breaks)


def test_tip_may_rest_while_the_tool_turns():
    here = [[5.0, 0.0, 0.0]] * 4
    curve = dual(here, [[5.0, 3.0, 10.0], [6.0, 3.0, 10.0], [8.0, 2.0, 10.0], [8.0, 0.0, 10.0]])
    assert curve.length == 0.0
    assert np.linalg.norm(curve.derivatives(np.linspace(0.0, 1.0, 9), 1)[1], axis=-1).min() > 0.0


class TestRefused:
    @pytest.mark.parametrize("middle", [0.5, 0.3123])
    def test_vertical_tool_axis(self, middle):
        # Straight across the vertical, at a parameter between the points of any scan.
        bottom = [[0, 0, 0], [10, 0, 0]]
        top = [[0, -3.0 * middle, 10], [10, 3.0 * (1.0 - middle), 10]]
        with pytest.raises(CurveError, match=rf"tool axis is vertical at u = {middle}"):
            dual(bottom, top, [0, 0, 1, 1], 1)

    def test_tool_axis_vertical_all_along(self):
        with pytest.raises(CurveError, match="tool axis is vertical"):
            dual([[0, 0, 0], [10, 0, 0]], [[0, 0, 10], [10, 0, 10]], [0, 0, 1, 1], 1)

    def test_near_vertical_is_allowed(self):
        curve = dual([[0, 0, 0], [10, 0, 0]], [[1e-4, -1, 10], [10 + 1e-4, 1, 10]], [0, 0, 1, 1], 1)
        c = curve.derivatives([0.0, 0.5, 1.0], 0)[0, :, 4]
        assert np.abs(np.diff(c)) == pytest.approx(np.full(2, np.pi / 2), abs=1e-3)

    def test_bottom_and_top_that_meet(self):
        with pytest.raises(CurveError, match=r"bottom and top meet at u = 0\.25"):
            dual([[0, 0, 0], [10, 0, 0]], [[0, -1, 1], [10, 3, -3]], [0, 0, 1, 1], 1)

    def test_other_numbers_of_axes(self):
        with pytest.raises(CurveError, match="3 columns"):
            dual([[0, 0], [10, 0]], [[0, 1], [10, 1]], [0, 0, 1, 1], 1)

    def test_other_parameter_ranges(self):
        bottom = NurbsCurve([[0, 0, 0], [10, 0, 0]], [0, 0, 1, 1], 1)
        top = NurbsCurve([[0, 1, 5], [10, 1, 5]], [0, 0, 2, 2], 1)
        with pytest.raises(CurveError, match="share a parameter range"):
            DualSplineCurve(bottom, top)

    def test_curve_that_rests_in_every_axis(self):
        with pytest.raises(CurveError, match="length 0"):
            dual([[1, 2, 3]] * 4, [[1, 3, 9]] * 4)
