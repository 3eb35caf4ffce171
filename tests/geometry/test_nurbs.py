"""Rational B-splines against the recurrence that defines them, and malformed definitions."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import insert_knot, nurbs_curves, oracle, random_nurbs

from planner import CurveError
from planner.geometry.nurbs import MAX_DEGREE, NurbsCurve

# Allowed error of the derivatives 0..3, against the largest value of each on the curve.
_TOLERANCES = np.array([4e-15, 2e-14, 1e-13, 4e-13])

CASES = {
    "degree 1, plane": random_nurbs(1, 1, 2),
    "degree 2, double knot": random_nurbs(2, 2, 3, repeat=2),
    "degree 3, five axes": random_nurbs(3, 3, 5),
    "degree 3, triple knot": random_nurbs(4, 3, 2, repeat=3),
    "degree 3, unclamped": random_nurbs(5, 3, 3, clamped=False),
    "degree 3, not rational": random_nurbs(6, 3, 6, rational=False),
    "degree 4": random_nurbs(7, 4, 4, repeat=2),
    "degree 5, unclamped": random_nurbs(8, 5, 2, clamped=False, repeat=3),
    "degree 6, one span": random_nurbs(9, 6, 3, spans=1),
    "degree 7": random_nurbs(10, 7, 2, spans=5, repeat=4),
    "degree 12": random_nurbs(11, 12, 2, spans=2),
}


def quadratic(**changes):
    """A valid curve with some parts of its definition replaced."""
    definition = {
        "control_points": [[0.0, 0.0], [1.0, 2.0], [3.0, 1.0], [4.0, 0.0]],
        "knots": [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0],
        "degree": 2,
        "weights": [1.0, 2.0, 1.0, 1.0],
    }
    return NurbsCurve(**(definition | changes))


@pytest.mark.parametrize("curve", CASES.values(), ids=CASES.keys())
def test_derivatives_agree_with_cox_de_boor_on_both_sides_of_every_knot(curve):
    u0, u1 = curve.domain
    edges = np.unique(curve.knots[(curve.knots >= u0) & (curve.knots <= u1)])
    at = [(u, side) for u in edges for side in ("left", "right")]
    for a, b in pairwise(edges):
        at += [(a + f * (b - a), "right") for f in (0.3, 0.999)]
        at.append((np.nextafter(b, a), "left"))
    expected = np.array([oracle(curve, u, side) for u, side in at])
    got = np.array([curve.derivatives(u, 3, side=side) for u, side in at])
    scale = np.abs(expected).max(axis=(0, 2))
    worst = np.abs(got - expected).max(axis=(0, 2)) / np.where(scale > 0.0, scale, 1.0)
    assert (worst <= _TOLERANCES).all(), worst


@pytest.mark.parametrize("degree", [20, 50])
def test_high_degrees_keep_their_digits_up_to_the_right_end_of_a_span(degree):
    curve = random_nurbs(12, degree, 2, spans=1)
    for u in (0.3, 1.0):
        expected = oracle(curve, u, "left")
        error = np.abs(curve.derivatives(u, 3, side="left") - expected).max(axis=1)
        assert (error <= np.array([1e-14, 1e-12, 1e-11, 1e-11]) * np.abs(expected).max(axis=1)).all()


@pytest.mark.parametrize("ratio", [1e4, 1e8])
def test_weights_that_fall_steeply_keep_the_digits(ratio):
    curve = quadratic(weights=[ratio, 1.0, 1.0, ratio**-0.5])
    for u in (0.1, 0.4321, 0.4999, 0.5, 0.75, 1.0):
        expected = oracle(curve, u, "left")
        error = np.abs(curve.derivatives(u, 3, side="left") - expected).max(axis=1)
        assert (error <= np.array([1e-12, 1e-11, 1e-10, 1e-8]) * np.abs(expected).max(axis=1)).all()


def test_bezier_curve_is_de_casteljau():
    points = np.array([[0.0, 0.0, 1.0], [2.0, 5.0, 1.0], [6.0, -3.0, 0.0], [9.0, 1.0, 4.0]])
    curve = NurbsCurve(points, [0, 0, 0, 0, 1, 1, 1, 1], 3)
    for u in (0.0, 0.25, 0.7, 1.0):
        row = points
        while len(row) > 1:
            row = (1.0 - u) * row[:-1] + u * row[1:]
        np.testing.assert_allclose(curve.derivatives(u, 0)[0], row[0], rtol=0, atol=2e-15)


@settings(max_examples=40)
@given(nurbs_curves(), st.floats(0.0, 1.0))
def test_knot_insertion_leaves_the_curve(curve, share):
    u0, u1 = curve.domain
    refined = insert_knot(curve, min(max(u0 + share * (u1 - u0), u0 + 1e-3), u1 - 1e-3))
    u = np.linspace(u0, u1, 41)
    size = np.abs(curve.derivatives(u)).max(axis=(1, 2))
    error = np.abs(refined.derivatives(u) - curve.derivatives(u)).max(axis=(1, 2))
    # A span as short as 1e-3 leaves so many digits of the third derivative.
    assert (error <= np.array([1e-14, 1e-11, 1e-8, 1e-5]) * size).all()


@settings(max_examples=40)
@given(nurbs_curves())
def test_affine_maps_of_the_control_points_map_the_curve(curve):
    rng = np.random.default_rng(len(curve.control_points))
    matrix, shift = rng.normal(size=(curve.dim, curve.dim)) + 2.0 * np.eye(curve.dim), rng.normal(size=curve.dim)
    mapped = NurbsCurve(
        curve.control_points @ matrix.T + shift,
        curve.knots,
        curve.degree,
        curve.weights,
    )
    u = np.linspace(*curve.domain, 23)
    expected = curve.derivatives(u) @ matrix.T
    expected[0] += shift
    size = np.abs(expected).max(axis=(1, 2))
    error = np.abs(mapped.derivatives(u) - expected).max(axis=(1, 2))
    assert (error <= np.array([1e-14, 1e-13, 1e-12, 1e-10]) * size).all()


@settings(max_examples=40)
@given(nurbs_curves())
def test_reversal_runs_the_same_curve_backwards(curve):
    reverse = NurbsCurve(curve.control_points[::-1], -curve.knots[::-1], curve.degree, curve.weights[::-1])
    u = np.linspace(*curve.domain, 23)
    backwards = reverse.derivatives(-u, side="left") * np.array([1.0, -1.0, 1.0, -1.0])[:, None, None]
    size = np.abs(backwards).max(axis=(1, 2))
    error = np.abs(curve.derivatives(u) - backwards).max(axis=(1, 2))
    assert (error <= np.array([1e-14, 1e-12, 1e-10, 1e-8]) * size).all()


@settings(max_examples=40)
@given(nurbs_curves(), st.sampled_from([1e-6, 0.5, 3.0, 1e6]))
def test_common_factor_of_the_weights_changes_nothing(curve, factor):
    same = NurbsCurve(curve.control_points, curve.knots, curve.degree, curve.weights * factor)
    u = np.linspace(*curve.domain, 11)
    error = np.abs(same.derivatives(u, 1) - curve.derivatives(u, 1)).max()
    assert error <= 1e-12 * np.abs(curve.derivatives(u, 1)).max()


def test_equal_weights_give_polynomial_pieces():
    assert not quadratic(weights=[2.0] * 4).pieces.rational
    assert quadratic().pieces.rational


def test_pieces_are_the_spans_and_cannot_be_written():
    pieces = quadratic().pieces
    np.testing.assert_array_equal(pieces.breaks, [0.0, 0.5, 1.0])
    assert pieces.coefficients.shape == (2, 3, 3)
    with pytest.raises(ValueError, match="read-only"):
        pieces.coefficients[0, 0, 0] = 1.0


def test_inputs_are_copied():
    points = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 1.0], [4.0, 0.0]])
    curve = quadratic(control_points=points)
    points[1] = 99.0
    assert curve.control_points[1, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        curve.control_points[0] = 1.0


def test_knots_beyond_the_domain_do_not_enter_it():
    inner = quadratic()
    outer = NurbsCurve(inner.control_points, [-5.0, 0.0, 0.0, 0.5, 1.0, 1.0, 7.0], 2, inner.weights)
    assert outer.domain == (0.0, 1.0)
    u = np.linspace(0.0, 1.0, 9)
    np.testing.assert_allclose(outer.derivatives(u, 0), inner.derivatives(u, 0), atol=1e-14)


BAD = {
    "knots fall": ({"knots": [0, 0, 0, 0.6, 0.5, 1, 1]}, r"knots\[4\] = 0.5 is less than knots\[3\] = 0.6"),
    "a knot too few": ({"knots": [0, 0, 0, 0.5, 1, 1]}, "knots has length 6.* need 7"),
    "a knot too many": ({"knots": [0, 0, 0, 0.5, 1, 1, 1, 1]}, "knots has length 8.* need 7"),
    "knots in a row of rows": ({"knots": [[0, 0, 0], [0.5, 1, 1, 1]]}, "knots .*rows differ in length"),
    "all knots equal": ({"knots": [1] * 7}, "range must not be empty"),
    "inner knot too often": (
        {"knots": [0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1], "control_points": [[i, i * i] for i in range(6)], "weights": None},
        "knot 0.5 appears 3 times",
    ),
    "weight zero": ({"weights": [1, 0, 1, 1]}, r"weights\[1\] = 0.0 must be > 0"),
    "weight negative": ({"weights": [1, 1, 1, -2]}, r"weights\[3\] = -2.0 must be > 0"),
    "weight infinite": ({"weights": [1, 1, np.inf, 1]}, r"weights\[2\] = inf must be finite"),
    "weights too few": ({"weights": [1, 1, 1]}, "weights has length 3"),
    "weights out of range": ({"weights": [1e300, 1, 1e-300, 1]}, "not finite|range of double"),
    "nan in a point": ({"control_points": [[0, 0], [1, np.nan], [3, 1], [4, 0]]}, r"control_points\[1\]\[1\] = nan"),
    "nan in a knot": ({"knots": [0, 0, 0, np.nan, 1, 1, 1]}, r"knots\[3\] = nan"),
    "nan in a weight": ({"weights": [np.nan, 1, 1, 1]}, r"weights\[0\] = nan"),
    "too few points": ({"control_points": [[0, 0], [1, 2]], "weights": None}, "2 control points are too few"),
    "one axis": ({"control_points": [[0], [1], [2], [3]]}, "2 <= dim <= 6"),
    "seven axes": ({"control_points": np.eye(4, 7)}, "2 <= dim <= 6"),
    "no points": ({"control_points": []}, "2 <= dim <= 6"),
    "ragged points": ({"control_points": [[0, 0], [1], [3, 1], [4, 0]]}, "rows differ in length"),
    "text in a point": ({"control_points": [["0", 0], [1, 2], [3, 1], [4, 0]]}, "'0' is not a number"),
    "truth value in a point": ({"control_points": [[True, 0], [1, 2], [3, 1], [4, 0]]}, "True is not a number"),
    "truth values in a point": ({"control_points": np.eye(4, 2, dtype=bool)}, "not numbers"),
    "null in a point": ({"control_points": [[None, 0], [1, 2], [3, 1], [4, 0]]}, "None is not a number"),
    "huge integer": ({"control_points": [[10**400, 0], [1, 2], [3, 1], [4, 0]]}, "too large"),
    "coordinates overflow": ({"control_points": [[1e300, 0], [1, 2e300], [3, 1], [4, 0]]}, "overflows|range of double"),
    "knot spacing underflows": ({"knots": [0, 0, 0, 1e-320, 1, 1, 1]}, "not finite|range of double"),
    "degree zero": ({"degree": 0}, "degree = 0 must be an integer from 1"),
    "degree with a fraction": ({"degree": 2.0}, "degree = 2.0 must be an integer"),
    "degree a truth value": ({"degree": True}, "degree = True must be an integer"),
    "degree too high": ({"degree": 10**30}, "degree = 10+ must be an integer"),
    "axis named twice": ({"axes": ["X", "X"]}, "different names"),
    "axis unknown": ({"axes": ["X", "Q"]}, "different names out of X Y Z A B C U V W"),
    "axes too few": ({"axes": ["X"]}, "names 1 axes"),
    "one point only": ({"control_points": [[1, 1]] * 4}, "length 0"),
    "end point repeated": ({"control_points": [[0, 0], [0, 0], [3, 1], [4, 0]]}, "cusp"),
}


@pytest.mark.parametrize(("changes", "message"), BAD.values(), ids=BAD.keys())
def test_malformed_definition_is_refused(changes, message):
    with pytest.raises(CurveError, match=message):
        quadratic(**changes)


def test_extreme_but_valid_definitions_load():
    assert quadratic(weights=[1e12, 1, 1, 1e-3]).length > 4.0
    assert quadratic(control_points=1e-6 * np.array([[0, 0], [1, 2], [3, 1], [4, 0]])).length > 4e-6
    assert quadratic(control_points=1e8 * np.array([[0, 0], [1, 2], [3, 1], [4, 0]])).length > 4e8
    assert quadratic(knots=[0, 0, 0, 0.5, 1, 1, 10**20]).domain == (0.0, 1.0)
    assert random_nurbs(1, MAX_DEGREE, 2, spans=1).length > 10.0


@pytest.mark.parametrize("weights", [(1e3, 1e-3), (1.0, 1.0 + 1e-9), (1e-3, 1e3)])
@pytest.mark.parametrize("offset", [0.0, 4.0, 1e6])
def test_derivatives_of_a_rational_line_are_exact_far_from_0(weights, offset):
    """C = (w0 (1 - t) P0 + w1 t P1) / w: C' = w0 w1 (P1 - P0) / w^2, C'' = -2 C' w' / w, however small they are."""
    curve = NurbsCurve([[offset, 0.0], [offset + 0.5, 0.25]], [0, 0, 1, 1], 1, list(weights))
    u = np.array([0.0, 1e-9, 1e-3, 0.25])
    w0, w1 = weights
    w = w0 * (1.0 - u) + w1 * u
    exact = w0 * w1 * np.array([0.5, 0.25]) / w[:, None] ** 2
    d = curve.derivatives(u, 2)
    np.testing.assert_allclose(d[1], exact, rtol=1e-9 * (1.0 if weights[0] < weights[1] else 1e-4))
    np.testing.assert_allclose(d[2], -2.0 * exact * ((w1 - w0) / w)[:, None], rtol=1e-6)
    np.testing.assert_allclose(d[0], offset * np.array([1.0, 0.0]) + (w1 * u / w)[:, None] * [0.5, 0.25], rtol=1e-14)
    np.testing.assert_allclose(curve.pieces.powers[:, 0, 0] / curve.pieces.powers[:, 2, 0], offset, atol=0.5, rtol=1e-9)


def test_weights_beyond_double_precision_are_refused_without_a_word_of_numpy():
    points = [[0.0, 0.0], [10.0, 0.5], [12.0, 8.0], [3.0, 9.0], [0.0, 14.0], [-3.0, 15.0]]
    with pytest.raises(
        CurveError, match="control points, weights or knot spacings exceed the range of double precision"
    ):
        NurbsCurve(points, [0, 0, 0, 0, 0.25, 0.5, 1, 1, 1, 1], 3, [1.0, 1.0, 2.5, 1.0, 1e308, 1.0])
