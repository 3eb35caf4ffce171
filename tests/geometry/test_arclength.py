"""Arc length and its inverse against closed forms and independent quadrature."""

import time
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from curve_reference import panel_inverse, panel_length
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import chebyshev
from scipy import special
from strategies import exact_nurbs, nurbs_curves, random_nurbs, span_of

from planner import CATALOG, InputError, load_curve
from planner.geometry import arclength
from planner.geometry.arclength import ArcLength, inverse_on_panels
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve

ACCURACY = 1e-10  # of the whole length: what is promised; reached is about 1e-14


def gauss_length(curve, a, b, parts=400):
    """Length of a smooth stretch by composite Gauss-Legendre quadrature, parts dense towards both ends."""
    x, w = special.roots_legendre(12)
    edges = a + (b - a) * 0.5 * (1.0 - np.cos(np.pi * np.arange(parts + 1) / parts))
    half, mid = 0.5 * np.diff(edges), 0.5 * (edges[:-1] + edges[1:])
    speed = np.linalg.norm(curve.derivatives(mid[:, None] + half[:, None] * x, 1)[1], axis=-1)
    return float(np.sum(half[:, None] * w * speed))


def rest_in_the_middle():
    return NurbsCurve([[0, 0, 0], [3, 4, 1], [3, 4, 2], [6, 8, 2]], [0, 0, 1, 2, 3, 3], 1, axes=["X", "Y", "A"])


class TestLength:
    def test_parabola_in_closed_form(self):
        curve = FormulaCurve({"X": "u", "Y": "u**2"}, (-1.0, 3.0))
        u = np.linspace(-1.0, 3.0, 301)
        anti = 0.5 * u * np.sqrt(1.0 + 4.0 * u**2) + 0.25 * np.arcsinh(2.0 * u)
        np.testing.assert_allclose(curve.arclength.s(u), anti - anti[0], rtol=0, atol=1e-13 * curve.length)

    def test_logarithmic_spiral_over_thirteen_decades(self):
        curve = FormulaCurve({"X": "exp(u)*cos(u)", "Y": "exp(u)*sin(u)"}, (-15.0, 15.0))
        u = np.linspace(-15.0, 15.0, 301)
        expected = np.sqrt(2.0) * (np.exp(u) - np.exp(-15.0))
        np.testing.assert_allclose(curve.arclength.s(u), expected, rtol=0, atol=1e-13 * curve.length)

    def test_nearly_stopping_curve(self):
        # |C'| = 2 sqrt(u^2 + slow^2) is all but a corner at u = 0.
        slow = 1e-7
        curve = FormulaCurve({"X": "u**2", "Y": f"{2 * slow}*u"}, (-1.0, 1.0))
        expected = 2.0 * (np.sqrt(1.0 + slow**2) + slow**2 * np.arcsinh(1.0 / slow))
        assert curve.length == pytest.approx(expected, rel=1e-13)
        s = np.linspace(0.0, curve.length, 2001)
        np.testing.assert_allclose(curve.arclength.s(curve.arclength.u(s)), s, rtol=0, atol=1e-13)

    @pytest.mark.parametrize("seed", range(3))
    def test_rational_curve_by_quadrature_in_30_digits(self, seed):
        curve = random_nurbs(seed, 3, 3, spans=3)
        edges = curve.pieces.breaks
        with mpmath.workdps(30):
            lengths = []
            for a, b in pairwise(edges):
                f = exact_nurbs(curve, span_of(curve, 0.5 * (a + b), "right"))

                def speed(u, f=f):
                    h = mpmath.mpf(10) ** -12
                    return mpmath.norm([(p - m) / (2 * h) for p, m in zip(f(u + h), f(u - h), strict=True)])

                lengths.append(float(mpmath.quad(speed, np.linspace(a, b, 3).tolist(), maxdegree=4)))
        np.testing.assert_allclose(curve.arclength.s(edges), np.append(0.0, np.cumsum(lengths)), rtol=1e-12)

    @pytest.mark.parametrize("name", CATALOG)
    def test_named_curves_by_gauss_quadrature(self, name):
        curve = load_curve(name)
        edges = np.union1d([b.u for b in curve.breaks], curve.domain)
        each = [gauss_length(curve.tip, a, b) for a, b in pairwise(edges)]
        np.testing.assert_allclose(curve.arclength.s(edges[1:]), np.cumsum(each), rtol=1e-12, atol=1e-12 * curve.length)

    @pytest.mark.parametrize("size", [1e-6, 1e8], ids=["1 nm", "100 km"])
    def test_size_does_not_matter(self, size):
        plain, sized = load_curve("butterfly-nurbs"), load_curve("butterfly-nurbs", scale=size / 382.8)
        u = np.linspace(*plain.domain, 500)
        np.testing.assert_allclose(sized.arclength.s(u), plain.arclength.s(u) * size / 382.8, rtol=1e-12)

    def test_small_circle_far_from_the_origin(self):
        # 1 um at 100 m: rounding leaves 5 digits of the rational curve, and as many of its length.
        circle = load_curve("circle")
        far = NurbsCurve(circle.control_points * 2e-5 + 1e5, circle.knots, 2, circle.weights)
        assert far.length == pytest.approx(2.0 * np.pi * 1e-3, rel=1e-5)

    def test_steep_weights(self):
        curve = NurbsCurve([[0, 0], [1, 2], [3, 1], [4, 0]], [0, 0, 0, 0.5, 1, 1, 1], 2, [1e12, 1, 1, 1e-3])
        # The weights only shift the parameter: each half is a conic arc of the same hull.
        assert 4.0 < curve.length < np.linalg.norm(np.diff(curve.control_points, axis=0), axis=1).sum()

    def test_length_of_a_formula_with_many_turns(self):
        curve = FormulaCurve({"X": "5*cos(u)", "Y": "5*sin(u)"}, (0.0, 2000.0))
        assert curve.length == pytest.approx(10_000.0, rel=1e-13)


@pytest.mark.parametrize("count", [2, 5, 16])
def test_series_are_integrated_and_derived_as_numpy_does(count):
    rng = np.random.default_rng(count)
    series = rng.normal(size=(7, count))
    expected = chebyshev.chebint(series, lbnd=-1, axis=1)
    np.testing.assert_allclose(arclength._integrals(series), expected, rtol=0.0, atol=4e-15)
    for x in (-1.0, 1.0, 0.0, *rng.uniform(-1.0, 1.0, 20)):
        rows = arclength._chebyshev(x, count)
        for k in range(3):
            exact = chebyshev.chebval(x, chebyshev.chebder(np.eye(count), k))
            np.testing.assert_allclose(rows[k], exact, rtol=0.0, atol=1e-14 * count ** (2 * k))


class TestInverse:
    @pytest.mark.parametrize("name", CATALOG)
    def test_round_trip_is_far_within_the_promise(self, name):
        arc = load_curve(name).arclength
        s = np.linspace(0.0, arc.total, 20_000)
        u = arc.u(s)
        assert (np.diff(u) > 0.0).all()
        assert np.abs(arc.s(u) - s).max() <= 1e-14 * arc.total

    @pytest.mark.parametrize("name", ["butterfly-nurbs", "butterfly", "flank"])
    def test_points_at_equal_distances_are_equally_far_by_quadrature(self, name):
        curve = load_curve(name)
        u = curve.arclength.u(np.linspace(0.0, curve.length, 12))
        breaks = np.array([b.u for b in curve.breaks])
        for a, b in pairwise(u):
            edges = [a, *breaks[(breaks > a) & (breaks < b)], b]
            length = sum(gauss_length(curve.tip, p, q, 100) for p, q in pairwise(edges))
            assert length == pytest.approx(curve.length / 11.0, abs=ACCURACY * curve.length)

    def test_breaks_and_ends_are_met_exactly(self):
        curve = load_curve("butterfly-nurbs")
        at = np.array([curve.domain[0], *[b.u for b in curve.breaks], curve.domain[1]])
        s = curve.arclength.s(at)
        assert (s[0], s[-1]) == (0.0, curve.length)
        for side in ("left", "right"):
            np.testing.assert_array_equal(curve.arclength.u(s, side=side), at)

    def test_never_leaves_the_domain(self):
        for seed in range(20):
            curve = random_nurbs(seed, 3, 2, clamped=False)
            u = curve.arclength.u(np.array([0.0, 1e-300, 0.5, 1.0 - 1e-16, 1.0]) * curve.length)
            assert curve.domain[0] <= u.min() <= u.max() <= curve.domain[1]

    @settings(max_examples=40)
    @given(nurbs_curves(), st.floats(0.0, 1.0))
    def test_any_curve(self, curve, share):
        s = share * curve.length
        assert float(curve.arclength.s(curve.arclength.u(s))) == pytest.approx(s, abs=1e-13 * curve.length)

    @settings(max_examples=40)
    @given(nurbs_curves())
    def test_reversed_curve_has_the_same_length(self, curve):
        back = NurbsCurve(curve.control_points[::-1], -curve.knots[::-1], curve.degree, curve.weights[::-1])
        u = np.linspace(*curve.domain, 9)
        s = back.arclength.s(-u)
        np.testing.assert_allclose(curve.length - s, curve.arclength.s(u), rtol=0, atol=1e-12 * curve.length)

    def test_speed_of_20_000_points(self):
        arc = load_curve("butterfly-nurbs").arclength
        s = np.random.default_rng(1).uniform(0.0, arc.total, 20_000)
        runs = []
        for _ in range(5):
            start = time.perf_counter()
            arc.u(s)
            runs.append(time.perf_counter() - start)
        assert min(runs) < 0.05


class TestRest:
    def test_side_chooses_the_end_of_a_rest(self):
        arc = rest_in_the_middle().arclength
        np.testing.assert_array_equal(arc.s([1.0, 1.3, 2.0]), 5.0)
        assert float(arc.u(5.0)) == 2.0
        assert float(arc.u(5.0, side="left")) == 1.0
        assert float(arc.u(np.nextafter(5.0, 0.0))) <= 1.0
        assert float(arc.u(np.nextafter(5.0, 9.0))) >= 2.0

    def test_rest_at_the_start_and_at_the_end(self):
        points = [[0, 0, 0], [0, 0, 1], [3, 4, 1], [3, 4, 3]]
        arc = NurbsCurve(points, [0, 0, 1, 2, 3, 3], 1, axes=["X", "Y", "C"]).arclength
        assert [float(arc.u(0.0, side=side)) for side in ("left", "right")] == [0.0, 1.0]
        assert [float(arc.u(5.0, side=side)) for side in ("left", "right")] == [2.0, 3.0]

    def test_curve_that_only_turns(self):
        arc = NurbsCurve([[1, 1, 0], [1, 1, 2]], [0, 0, 1, 1], 1, axes=["X", "Y", "C"]).arclength
        assert arc.total == 0.0
        np.testing.assert_array_equal(arc.s([0.0, 0.5, 1.0]), 0.0)
        assert [float(arc.u(0.0, side=side)) for side in ("left", "right")] == [0.0, 1.0]


class TestOtherSpeeds:
    def test_weighted_axes(self):
        # An ellipse whose second axis counts three times is a circle.
        curve = FormulaCurve({"X": "6*cos(u)", "Y": "2*sin(u)"}, (0.0, 1.0))

        def speed(u):
            return np.linalg.norm(curve.derivatives(u, 1)[1] * [1.0, 3.0], axis=-1)

        arc = ArcLength.of_speed(speed, curve.pieces.breaks, "weighted")
        np.testing.assert_allclose(arc.s([0.0, 0.4, 1.0]), [0.0, 2.4, 6.0], atol=1e-14)

    def test_speed_with_noise_is_integrated_to_its_noise(self):
        noise = np.random.default_rng(4)
        arc = ArcLength.of_speed(lambda u: 1.0 + u + 1e-8 * noise.normal(size=u.size), np.array([0.0, 1.0]), "noisy")
        assert arc.total == pytest.approx(1.5, rel=1e-7)
        assert arc.edges.size < 10_000


class TestArguments:
    def test_shapes(self):
        arc = load_curve("circle").arclength
        assert arc.s(0.5).shape == ()
        assert arc.u(np.ones((2, 3))).shape == (2, 3)
        assert arc.s([]).shape == (0,)

    @pytest.mark.parametrize("s", [-1e-3, 315.0, np.nan, np.inf, [1.0, -1.0], "1", None])
    def test_length_outside_the_curve_is_refused(self, s):
        with pytest.raises(InputError, match="s = "):
            load_curve("circle").arclength.u(s)

    @pytest.mark.parametrize("u", [-1e-3, 1.1, np.nan, [0.5, 2.0], "1", None])
    def test_parameter_outside_the_domain_is_refused(self, u):
        with pytest.raises(InputError, match="u = "):
            load_curve("circle").arclength.s(u)

    def test_other_side_is_refused(self):
        with pytest.raises(InputError, match='side = 5 must be "left" or "right"'):
            load_curve("circle").arclength.u(1.0, side=5)

    def test_rounding_beyond_the_ends_is_forgiven(self):
        arc = load_curve("circle").arclength
        assert float(arc.u(arc.total * (1.0 + 1e-15))) == 1.0
        assert float(arc.u(-1e-14)) == 0.0

    def test_arrays_cannot_be_written(self):
        arc = load_curve("circle").arclength
        with pytest.raises(ValueError, match="read-only"):
            arc.lengths[0] = 1.0


class TestCompiled:
    """The bits are those of plain Python, where the curve runs on, rests, and hardly moves."""

    CURVES = (
        load_curve("butterfly"),
        random_nurbs(3, 3, 2),
        rest_in_the_middle(),
        # |C'| from 1 to 1e-9 and back: Newton leaves the bracket
        FormulaCurve({"X": "u**5 + 1e-9*u", "Y": "0*u"}, (-1.0, 1.3)),
    )

    @pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)
    def test_lengths_and_parameters(self, curve):
        arc, rng = curve.arclength, np.random.default_rng(6)
        u = rng.permutation(
            np.concatenate([arc.edges, np.nextafter(arc.edges[1:], -np.inf), rng.uniform(*curve.domain, 200)])
        )
        expected = np.empty(u.size)
        panel_length(arc.edges, arc.lengths, arc._series, u, expected)
        assert arc.s(u).tobytes() == expected.tobytes()
        s = np.concatenate([arc.lengths, np.nextafter(arc.lengths[1:], 0.0), rng.uniform(0.0, arc.total, 200)])
        s = rng.permutation(np.concatenate([s, arc.total * rng.uniform(0.0, 1e-12, 20)]))
        for side in ("left", "right"):
            panel_inverse(
                arc.edges, arc.lengths, arc._series, arc._speeds, s, side == "left", expected := np.empty(s.size)
            )
            assert arc.u(s, side=side).tobytes() == expected.tobytes()

    def test_bisection_takes_over(self):
        """A series of the speed that is wrong sends Newton away; the length alone still decides."""
        edges, lengths = np.array([0.0, 2.0]), np.array([0.0, 1.0])
        series = np.array([[0.5, 0.45, 0.0, 0.05]])
        for speeds in (np.array([[1e-3, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]]), np.array([[1e300, 0.0, 0.0]])):
            s = np.linspace(0.0, 1.0, 41)
            panel_inverse(edges, lengths, series, speeds, s, False, expected := np.empty(s.size))
            found = inverse_on_panels(edges, lengths, series, speeds, s)
            assert found.tobytes() == expected.tobytes()
            if speeds[0, 0] < 1.0:
                x = found - 1.0
                np.testing.assert_allclose(0.5 + 0.45 * x + 0.05 * (4.0 * x**3 - 3.0 * x), s, atol=1e-12)
