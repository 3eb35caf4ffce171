"""Curves by the length along them: against quadrature in 30 digits, B-splines of scipy, and circles."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from planner.geometry.bezier import Beziers, over_parameter
from planner.geometry.blend import Blends, Legs
from planner.geometry.differential import arc_derivatives

# Powers of w of a Bezier curve from its control points: the rows of degree 2 and 3.
TO_POWERS = {
    2: np.array([[1.0, 0, 0], [-2, 2, 0], [1, -2, 1]]),
    3: np.array([[1.0, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]),
}
HALF = float(np.sqrt(0.5))


def powers_of(control, weights=None):
    """Start and powers of one curve from its control points (degree + 1, dim)."""
    control = np.asarray(control, dtype=float)
    weights = np.ones(len(control)) if weights is None else np.asarray(weights, dtype=float)
    to = TO_POWERS[len(control) - 1]
    numerator = to @ ((control - control[0]) * weights[:, None])
    return control[:1], np.concatenate([numerator, (to @ weights)[:, None]], axis=1).T[None]


def curve_of(control, weights=None):
    return Beziers.of_powers(*powers_of(control, weights))[0]


def along(beziers, s):
    """Position and derivatives at distances along curves that follow one another."""
    ends = np.cumsum(beziers.length)
    row = np.minimum(np.searchsorted(ends, s, side="right"), len(beziers) - 1)
    d = beziers.at(row, s - (ends - beziers.length)[row])
    d[0] += beziers.start[row]
    return d


def foot_distance(control, weights, point):
    """Distance from a point to a curve: the nearest of many points, and from there Gauss-Newton."""
    whole = BPoly((np.column_stack([control, np.ones(len(control))]) * weights[:, None])[:, None], [0.0, 1.0])
    slope = whole.derivative()

    def at(w):
        (*top, bottom), (*rise, fall) = whole(w), slope(w)
        place = np.array(top) / bottom
        return place - point, (np.array(rise) - place * fall) / bottom

    many = whole(np.linspace(0.0, 1.0, 2001))
    w = np.argmin(((many[:, :-1] / many[:, -1:] - point) ** 2).sum(axis=1)) / 2000.0
    for _ in range(20):
        away, velocity = at(w)
        w = np.clip(w - away @ velocity / (velocity @ velocity), 0.0, 1.0)
    return np.sqrt((at(w)[0] ** 2).sum())


class TestLength:
    @pytest.mark.parametrize("seed", range(2))
    def test_of_cubics_is_that_of_quadrature_in_30_digits(self, seed):
        rng = np.random.default_rng(seed)
        control = rng.uniform(-10.0, 10.0, (4, 2))
        beziers = curve_of(control)
        s = beziers.length.sum() * np.array([0.0, 0.37, 0.93])
        found = along(beziers, s)[0]
        with mpmath.workdps(30):
            points = [[mpmath.mpf(float(x)) for x in row] for row in control]

            def place(w):
                b = [(1 - w) ** 3, 3 * w * (1 - w) ** 2, 3 * w**2 * (1 - w), w**3]
                return [sum(b[i] * points[i][j] for i in range(4)) for j in range(2)]

            def speed(w):
                b = [3 * (1 - w) ** 2, 6 * w * (1 - w), 3 * w**2]
                step = [[points[i + 1][j] - points[i][j] for j in range(2)] for i in range(3)]
                return mpmath.sqrt(sum(sum(b[i] * step[i][j] for i in range(3)) ** 2 for j in range(2)))

            def length(w):
                return mpmath.quad(speed, mpmath.linspace(0, w, 9))

            for k, distance in enumerate(s):
                w = mpmath.findroot(
                    lambda x, at=distance: length(x) - mpmath.mpf(float(at)),
                    k / 5,
                    df=speed,
                    solver="newton",
                    tol=1e-20,
                )
                assert found[k] == pytest.approx([float(x) for x in place(w)], abs=2e-13)

    def test_of_a_quarter_circle_is_exact(self):
        beziers = curve_of([[10, 0], [10, 10], [0, 10]], [1, HALF, 1])
        assert beziers.length.sum() == pytest.approx(5.0 * np.pi, rel=4e-16)
        s = np.linspace(0.0, 5.0 * np.pi, 301)
        d = along(beziers, s)
        angle = s / 10.0
        for k, (x, y) in enumerate(
            [(np.cos, np.sin), (lambda a: -np.sin(a), np.cos), (lambda a: -np.cos(a), lambda a: -np.sin(a))]
        ):
            assert d[k] == pytest.approx(np.column_stack([x(angle), y(angle)]) * 10.0 ** (1 - k), abs=2e-13)


class TestPlace:
    @pytest.mark.parametrize("seed", range(20))
    def test_every_point_lies_on_the_curve_as_it_was_written(self, seed):
        rng = np.random.default_rng(seed)
        control, weights = rng.uniform(-20.0, 20.0, (rng.integers(3, 5), 3)), rng.uniform(0.2, 5.0, 4)
        weights = weights[: len(control)]
        start, powers = powers_of(control, weights)
        beziers, _ = Beziers.of_powers(start, powers)
        points = along(beziers, np.linspace(0.0, beziers.length.sum(), 21))[0]
        assert max(foot_distance(control, weights, point) for point in points) < 1e-12

    @pytest.mark.parametrize("seed", range(4))
    def test_derivatives_are_those_over_the_parameter_by_the_chain_rule(self, seed):
        rng = np.random.default_rng(seed)
        start, powers = powers_of(rng.uniform(-10.0, 10.0, (4, 3)), rng.uniform(0.5, 2.0, 4))
        beziers, _ = Beziers.of_powers(start, powers)
        w = np.linspace(0.0, 1.0, 9)
        expected = arc_derivatives(over_parameter(powers, w)[:, 0])
        expected[0] += start
        s = np.linspace(0.0, beziers.length.sum(), 20001)
        near = along(beziers, s)
        at = [int(np.argmin(((near[0] - point) ** 2).sum(axis=1))) for point in expected[0]]
        # refined to the foot on the tangent
        s = s[at] + ((expected[0] - near[0][at]) * near[1][at]).sum(axis=1)
        found = along(beziers, np.clip(s, 0.0, beziers.length.sum()))
        for k in range(4):
            size = np.abs(expected[k]).max()
            assert found[k] == pytest.approx(expected[k], abs=1e-5 * size)
        assert np.sqrt((near[1] ** 2).sum(axis=1)) == pytest.approx(1.0, abs=1e-14)

    def test_halves_join_and_are_the_curve(self):
        """A curve with a tight bend is split; what is left of the joints is rounding."""
        beziers = curve_of([[0, 0, 0], [10, 0.05, 0], [-9, 0.05, 1], [1, 0, 1]])
        assert len(beziers) > 6
        rows = np.arange(len(beziers) - 1)
        end, begin = beziers.at(rows, beziers.length[:-1]), beziers.at(rows + 1, np.zeros(rows.size))
        assert end[0] + beziers.start[:-1] == pytest.approx(beziers.start[1:], abs=1e-14)
        assert end[1] == pytest.approx(begin[1], abs=1e-10)
        scale = np.abs(end[2]).max(axis=1)
        assert (np.abs(end[2] - begin[2]).max(axis=1) <= 1e-8 * scale + 1e-12).all()


class TestTightest:
    def test_of_a_circle_is_its_radius(self):
        assert curve_of([[3, 0], [3, 3], [0, 3]], [1, HALF, 1]).tightest == pytest.approx(3.0, rel=1e-14)

    def test_of_a_line_is_infinite(self):
        assert curve_of([[0, 0], [1, 0], [2, 0], [3, 0]]).tightest.tolist() == [np.inf]

    @pytest.mark.parametrize(
        "control",
        [
            [[0, 0], [10, 10], [0, 10], [10, 0]],  # in the middle
            [[0, 0], [0, 0], [5, 5], [10, 0]],  # at the start
            [[0, 0], [5, 5], [10, 0], [10, 0]],  # at the end
        ],
    )
    def test_of_a_cusp_is_nothing(self, control):
        assert curve_of(control).tightest.min() == 0.0

    @pytest.mark.parametrize(
        "control", [[[0, 0], [20, 0], [-10, 0], [10, 0]], [[0, 0], [11, 0], [12, 0], [10, 0]], [[1, 2]] * 4]
    )
    def test_of_a_line_that_turns_back_or_goes_nowhere_is_nothing(self, control):
        assert curve_of(control).tightest.min() == 0.0

    @settings(max_examples=20)
    @given(st.floats(1e-5, 1.0))
    def test_close_to_a_cusp_is_that_of_many_digits(self, apart):
        """The curve that has a cusp for apart = 0: at w = 1/2 the speed is 3/2 apart and its slope 60 across it."""
        control = [[0, 0], [10 + apart, 10], [-apart, 10], [10, 0]]
        found = curve_of(control).tightest.min()
        w = np.linspace(0.0, 1.0, 20001) if apart > 1e-3 else 0.5 + np.linspace(-1e-2, 1e-2, 20001) * 10 * apart
        d = over_parameter(powers_of(control)[1], w)
        cross = np.abs(d[1, 0, :, 0] * d[2, 0, :, 1] - d[1, 0, :, 1] * d[2, 0, :, 0])
        assert found == pytest.approx(((d[1, 0] ** 2).sum(axis=1) ** 1.5 / cross).min(), rel=0.05)


class TestStretches:
    """Legs along a curve, forwards and backwards, as blends take them."""

    @staticmethod
    def legs(begin, direction):
        beziers = curve_of([[0, 0], [4, 6], [9, -3], [12, 2]], [1, 1.5, 0.8, 1])
        row = 0
        way = beziers.at(np.array([row]), np.array([begin]))[0]
        vectors = np.zeros((1, 4, 2))
        vectors[:, 0], vectors[:, 1] = beziers.start[row], way
        return Legs(vectors, np.zeros((1, 2)), np.array([[row, begin, direction]]), beziers)

    @pytest.mark.parametrize("backwards", [False, True])
    def test_from_a_point_on_the_leg_is_the_same(self, backwards):
        legs = self.legs(0.0, 1.0)
        x = 0.4 * legs.beziers.length[0]
        other = legs.from_point(np.array([x]), backwards=backwards)
        sign = -1.0 if backwards else 1.0
        steps = np.linspace(0.0, x, 7)
        row = np.zeros(7, dtype=np.intp)
        mine, theirs = legs.at(row, x + sign * steps), other.at(row, steps)
        for k in range(4):
            assert theirs[k] == pytest.approx(sign**k * mine[k], abs=1e-13)
        again = other.from_point(np.array([0.0]), backwards=backwards)
        assert again.at(row, steps)[0] == pytest.approx(legs.at(row, x + steps)[0], abs=1e-13)
        assert legs.curved.all()

    def test_blend_between_two_of_them_keeps_position_tangent_and_curvature(self):
        legs = self.legs(0.0, 1.0)
        length = legs.beziers.length[0]
        before = legs.from_point(np.array([length]), backwards=True)
        turned = self.legs(0.0, 1.0)
        moved = before.beziers.at(np.array([0]), np.array([length]))[0] + before.beziers.start[0]
        second = turned.beziers.shifted(moved - turned.beziers.start[0])
        vectors = np.zeros((1, 4, 2))
        vectors[:, 0] = moved
        after = Legs(vectors, np.zeros((1, 2)), np.array([[0.0, 0.0, 1.0]]), second)
        blends = Blends.between(before, after, np.array([0.02]))
        d = arc_derivatives(blends.at(np.zeros(2, dtype=np.intp), np.array([-1.0, 1.0])))
        ends = legs.at(np.array([0]), np.array([length - 0.16])), after.at(np.array([0]), np.array([0.16]))
        for k in range(3):
            for at in range(2):
                assert d[k, at] == pytest.approx(ends[at][k, 0], abs=1e-9)


def test_a_blend_beside_a_tight_bend_has_its_length():
    """Where a leg bends by much within the reach, more nodes are taken: against the length of many chords."""
    beziers = curve_of([[0, 0], [0.02, 0.05], [0.0, 0.06], [1.0, 0.03]])
    vectors, line = np.zeros((1, 4, 2)), np.zeros((1, 4, 2))
    after = Legs(vectors, np.zeros((1, 2)), np.array([[0.0, 0.0, 1.0]]), beziers)
    line[0, 3] = [-1.0, 0.0]
    size = 0.9 * beziers.length[0] / 8.0
    blends = Blends.between(Legs(line, np.zeros((1, 2))), after, np.array([size]))
    length, count = [], 40001
    for step in (1, 2):
        tau = np.linspace(-1.0, 1.0, count)[::step]
        points = blends.at(np.zeros(tau.size, dtype=np.intp), tau)[0]
        length.append(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum())
    exact = length[0] + (length[0] - length[1]) / 3.0  # Richardson
    assert beziers.tightest[0] < 0.3 * 8.0 * size
    assert blends.length[0] == pytest.approx(exact, rel=1e-12)


def test_joined_taken_and_in_some_axes():
    rng = np.random.default_rng(3)
    curves = [curve_of(np.column_stack([rng.uniform(-5, 5, (n, 2)), np.zeros(n)])) for n in (4, 3, 4)]
    joined = curves[0].joined(curves[1]).joined(curves[2])
    count = np.cumsum([0, *map(len, curves)])
    assert len(joined) == count[-1]
    for k, curve in enumerate(curves):
        part = joined.taken(np.arange(count[k], count[k + 1]))
        s = np.linspace(0.0, curve.length.sum(), 17)
        np.testing.assert_array_equal(along(part, s), along(curve, s))
        other = part.in_axes(np.array([0, 1, 7]), np.full((len(part), 3), 4.0))
        d = along(other, s)
        np.testing.assert_array_equal(d[..., :2], along(curve, s)[..., :2])
        assert (d[0, :, 2] == 4.0).all()
        assert (d[1:, :, 2] == 0.0).all()
