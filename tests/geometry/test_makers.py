"""Curves from what a script has: against scipy's own evaluation, and against the file of the same curve."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import Akima1DInterpolator, BSpline, CubicSpline, PchipInterpolator, PPoly, make_interp_spline

from planner import CurveError, InputError, load_curve, read_points
from planner.geometry.makers import formula, from_points, from_spline, nurbs

ARC = {"degree": 2, "control_points": [[0, 0], [40, 0], [40, 30]], "knots": [0, 0, 0, 1, 1, 1], "weights": [1, 0.7, 1]}


def random_spline(seed, degree, dim, *, multiple=False):
    """A B-spline with no cusp to be expected; knots uneven, some of them repeated, not clamped for odd seeds."""
    rng = np.random.default_rng(seed)
    inner = np.sort(rng.uniform(0.0, 1.0, 6))
    if multiple and degree > 1:
        inner = np.sort(np.concatenate([inner, np.repeat(inner[2], min(degree, 3) - 1)]))
    ends = (degree + 1,) if seed % 2 == 0 else (1,)
    before, after = np.linspace(-0.3, 0.0, degree + 1), np.linspace(1.0, 1.3, degree + 1)
    if ends[0] > 1:
        before, after = np.zeros(degree + 1), np.ones(degree + 1)
    knots = np.concatenate([before, inner, after])
    control = (
        rng.normal(size=(knots.size - degree - 1, dim)).cumsum(axis=0)
        + 3.0 * np.arange(knots.size - degree - 1)[:, None]
    )
    return BSpline(knots, control, degree)


def assert_same(curve, spline, lo, hi, rtol=1e-11):
    """Value and three derivatives between breaks, against scipy."""
    u = np.linspace(lo, hi, 403)[1:-1]
    u = u[np.abs(u[:, None] - curve.pieces.breaks).min(axis=1) > 1e-6 * (hi - lo)]
    found = curve.derivatives(u, 3)
    for order in range(4):
        expected = spline(u, order)
        scale = np.abs(expected).max() + np.abs(found[0]).max()
        assert np.abs(found[order] - expected).max() <= rtol * 10**order * scale
    assert curve.domain == pytest.approx((lo, hi), abs=0.0)


class TestFromSpline:
    @pytest.mark.parametrize("degree", [1, 2, 3, 4, 5, 7])
    @pytest.mark.parametrize("dim", [2, 3, 5])
    @pytest.mark.parametrize("seed", range(4))
    def test_is_the_b_spline_of_scipy(self, seed, degree, dim):
        spline = random_spline(seed, degree, dim, multiple=seed > 1)
        assert_same(from_spline(spline), spline, spline.t[degree], spline.t[-degree - 1])

    def test_more_coefficients_than_the_knots_take_are_left_out(self):
        spline = random_spline(0, 3, 2)
        longer = BSpline(spline.t, np.vstack([spline.c, np.full((4, 2), 9.0)]), 3)
        assert from_spline(longer).fingerprint == from_spline(spline).fingerprint

    @pytest.mark.parametrize("maker", [CubicSpline, PchipInterpolator, Akima1DInterpolator])
    @pytest.mark.parametrize("seed", range(4))
    def test_is_the_piecewise_polynomial_of_scipy(self, maker, seed):
        rng = np.random.default_rng(seed)
        x = np.cumsum(rng.uniform(0.2, 2.0, 12))
        points = rng.normal(size=(12, 3)).cumsum(axis=0)
        points[:, 0] = 4.0 * x  # where all axes turn, Pchip rests
        spline = maker(x, points)
        assert_same(from_spline(spline, "XYA"), spline, x[0], x[-1])

    def test_a_cubic_spline_has_continuous_curvature(self):
        angle = np.linspace(0.0, 2.0, 9)
        curve = from_spline(CubicSpline(angle, 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)))
        assert {at.geometric for at in curve.breaks} == {2}

    def test_degree_5_through_points(self):
        angle = np.linspace(0.0, 2.0, 20)
        spline = make_interp_spline(angle, 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), k=5)
        curve = from_spline(spline, ("Y", "Z"), name="arc")
        assert (curve.axes, curve.name, curve.degree) == (("Y", "Z"), "arc", 5)
        assert curve.length == pytest.approx(40.0, rel=1e-6)

    @pytest.mark.parametrize(
        ("spline", "said"),
        [
            (lambda: BSpline([0, 0, 1, 1], [1.0, 2.0], 1), "must be vectors of 2 to 6 axes"),
            (lambda: BSpline([0, 0, 0, 1, 1, 1], np.ones((3, 2)), 2), "length 0"),
            (lambda: BSpline([0, 1, 2], np.array([[0.0, 0.0], [1.0, 1.0]]), 0), "degree = 0 must be"),
            (
                lambda: PPoly(np.array([[[0.0, 0.0], [5.0, 5.0]], [[1.0, 1.0], [2.0, 2.0]]])[::-1], [0, 1, 2]),
                "jumps by",
            ),
            (lambda: PPoly(np.ones((1, 1, 2)), [0, 1]), "degree 0 is no curve"),
            (lambda: np.ones(4), "a ndarray must be a BSpline or PPoly"),
        ],
    )
    def test_refuses(self, spline, said):
        with pytest.raises(CurveError, match=said):
            from_spline(spline())


class TestFromPoints:
    @pytest.mark.parametrize("dim", [2, 3])
    def test_is_the_curve_of_the_same_file(self, tmp_path, dim):
        angle = np.linspace(0.0, 3.0, 80)
        points = 10.0 * np.stack([np.cos(angle), np.sin(angle), 0.2 * angle], axis=1)[:, :dim]
        file = tmp_path / "points.csv"
        np.savetxt(file, points, fmt="%.17g", delimiter=",")
        curve, same = from_points(points, 1e-3), read_points(file, 1e-3)
        assert curve.fingerprint == same.fingerprint
        assert (curve.deviation, curve.row + 1) == (same.deviation, same.row)
        assert from_points(pd.DataFrame(points), 1e-3).fingerprint == curve.fingerprint

    def test_every_point_is_within_the_tolerance(self):
        rng = np.random.default_rng(3)
        angle = np.linspace(0.0, 3.0, 200)
        points = 10.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1) + rng.uniform(-5e-4, 5e-4, (200, 2))
        curve = from_points(points, 2e-3, ("X", "Z"))
        dense = curve.derivatives(np.linspace(*curve.domain, 20_000), 0)[0]
        assert max(np.linalg.norm(dense - point, axis=1).min() for point in points) <= 2e-3 + 1e-6
        assert curve.axes == ("X", "Z")

    @pytest.mark.parametrize(
        ("points", "said"),
        [
            (np.zeros((5, 4)), r"has the shape \(5, 4\); it must be"),
            (np.zeros((0, 2)), "0 different points are too few"),
            (np.zeros((5, 2)), "1 different points are too few"),
            ([[0.0, 0.0], [1.0, np.nan]], r"points\[1\] = \[1.0, nan\] must be finite"),
            ([["a", "b"]], "must be an array of numbers"),
        ],
    )
    def test_refuses(self, points, said):
        with pytest.raises(CurveError, match=said):
            from_points(points, 1e-3)

    def test_the_tolerance_is_positive(self):
        with pytest.raises(InputError, match=r"tolerance = 0\.0 must be"):
            from_points(np.eye(2), 0.0)


class TestDefinitions:
    def test_nurbs_is_that_of_a_file(self, tmp_path):
        file = tmp_path / "arc.toml"
        file.write_text("[curve]\ntype = 'nurbs'\n" + "".join(f"{key} = {value}\n" for key, value in ARC.items()))
        assert nurbs(**ARC).fingerprint == load_curve(file).fingerprint

    def test_formula_is_that_of_a_file(self, tmp_path):
        file = tmp_path / "ellipse.toml"
        file.write_text("x = '30*cos(u)'\ny = '20*sin(u)'\nu_range = [0, '2*pi']\n")
        made = formula({"X": "30*cos(u)", "Y": "20*sin(u)"}, (0, "2*pi"))
        assert made.fingerprint == load_curve(file).fingerprint

    @pytest.mark.parametrize("span", [3.0, (0.0,), "01", (0.0, "u")])
    def test_formula_refuses_a_range(self, span):
        with pytest.raises(CurveError, match="u_range"):
            formula({"X": "u", "Y": "u"}, span)
