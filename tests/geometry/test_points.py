"""Curves out of points."""

from itertools import pairwise

import numpy as np
import pytest

from planner import load_curve
from planner.errors import CurveError, InputError
from planner.geometry.points import read_points


def at(curve, s):
    return curve.derivatives(curve.arclength.u(np.asarray(s, dtype=float)), 0)[0]


def distance_to_polyline(point, vertices):
    """From a point to the two segments about the nearest vertex."""
    k = int(np.clip(np.argmin(np.linalg.norm(vertices - point, axis=1)), 1, len(vertices) - 2))
    best = np.inf
    for a, b in pairwise(vertices[k - 1 : k + 2]):
        w = np.clip((point - a) @ (b - a) / np.sum((b - a) ** 2), 0, 1)
        best = min(best, np.linalg.norm(point - a - w * (b - a)))
    return best


class TestPoints:
    @pytest.fixture
    def spiral(self):
        a = np.linspace(0, 9, 400)
        return np.stack([(20 - a) * np.cos(a), (20 - a) * np.sin(a)], axis=1)

    def write(self, tmp_path, points, head="", delimiter=","):
        path = tmp_path / "points.csv"
        rows = [delimiter.join(f"{x:.6f}" for x in row) for row in points]
        path.write_text("\n".join([head, *rows] if head else rows) + "\n")
        return path

    @pytest.mark.parametrize("tolerance", [0.1, 0.01, 1e-4])
    def test_every_point_is_within_the_tolerance(self, tmp_path, spiral, tolerance):
        rng = np.random.default_rng(0)
        noisy = spiral + rng.normal(size=spiral.shape) * 0.2 * tolerance
        curve = read_points(self.write(tmp_path, noisy), tolerance)
        u = np.linspace(*curve.domain, 40001)
        dense = curve.derivatives(u, 0)[0]
        assert max(distance_to_polyline(p, dense) for p in noisy) <= curve.deviation + 1e-6
        assert curve.deviation <= tolerance
        # Between the points too it is the spiral that they come from.
        a = np.linspace(0, 9, 4000)
        true = np.stack([(20 - a) * np.cos(a), (20 - a) * np.sin(a)], axis=1)
        assert max(distance_to_polyline(p, true) for p in dense[::40]) <= 3 * tolerance + 1e-4

    def test_it_has_no_breaks(self, tmp_path, spiral):
        assert read_points(self.write(tmp_path, spiral), 0.01).breaks == ()

    def test_a_wider_tolerance_needs_fewer_knots(self, tmp_path, spiral):
        path = self.write(tmp_path, spiral)
        assert read_points(path, 0.1).knots.size < read_points(path, 1e-5).knots.size

    def test_scattered_points_are_interpolated(self, tmp_path):
        points = np.random.default_rng(1).normal(size=(40, 3)) * 10
        curve = read_points(self.write(tmp_path, points), 1e-7)
        assert curve.axes == ("X", "Y", "Z")
        assert curve.deviation <= 1e-7

    @pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
    def test_few_points(self, tmp_path, spiral, count):
        curve = read_points(self.write(tmp_path, spiral[::60][:count]), 1e-6)
        assert curve.deviation <= 1e-6
        assert curve.degree == min(5, count - 1)

    @pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", ", "])
    def test_delimiters_and_names(self, tmp_path, spiral, delimiter):
        head = delimiter.join(("x_mm", "y_mm"))
        plain = read_points(self.write(tmp_path, spiral), 0.01)
        named = read_points(self.write(tmp_path, spiral, head, delimiter), 0.01)
        assert named.control_points.tolist() == plain.control_points.tolist()

    def test_repeated_points_and_comments(self, tmp_path):
        path = tmp_path / "points.csv"
        path.write_text("# measured\n0,0\n0,0\n5,0\n\n10,1\n10,1\n")
        curve = read_points(path, 1e-3)
        assert at(curve, [0, curve.length]) == pytest.approx(np.array([[0, 0], [10, 1]]), abs=1e-9)

    def test_the_row_of_the_largest_deviation(self, tmp_path):
        x = np.linspace(0, 10, 60)
        y = np.where(np.arange(60) == 40, 0.04, 0.0)
        curve = read_points(self.write(tmp_path, np.stack([x, y], axis=1)), 0.05)
        assert curve.row == 41
        assert 0.005 < curve.deviation <= 0.05

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "has no points"),
            ("1,2\n", "1 different points are too few; a curve needs 2"),
            ("1,2\n1,2\n", "1 different points are too few; a curve needs 2"),
            ("1,2\n3,x\n", "2: 3,x must be 2 or 3 numbers"),
            ("a,b\n3,4\n", "1: a,b must be 2 or 3 numbers, or the names X, Y, Z in the first line"),
            ("1,2\n3,4,5\n", "2: 3,4,5 must be 2 finite numbers"),
            ("1,2\n3,nan\n", "2: 3,nan must be 2 finite numbers"),
            ("1\n2\n", "1: 1 must be 2 or 3 finite numbers"),
            ("1,2\n3,\n", "2: 3, must be 2 or 3 numbers"),
        ],
    )
    def test_refusals(self, tmp_path, text, message):
        path = tmp_path / "points.csv"
        path.write_text(text)
        with pytest.raises(CurveError) as caught:
            read_points(path, 0.01)
        assert str(caught.value).partition("points.csv:")[2].strip() == message

    def test_the_tolerance_must_be_positive(self, tmp_path):
        with pytest.raises(InputError, match="tolerance = 0 must be a number > 0"):
            read_points(tmp_path / "a.csv", 0)


def test_load_curve_reads_them(tmp_path):
    (tmp_path / "a.csv").write_text("0,0\n1,2\n4,4\n")
    assert load_curve(str(tmp_path / "a.csv")).control_points[-1].tolist() == pytest.approx([4, 4])


@pytest.mark.parametrize(
    ("row", "text", "message"),
    [
        (20, "1_0,2", "must be 2 or 3 numbers"),
        (20, "\u0661,2", "must be 2 or 3 numbers"),
        (20, "1e300,2", "coordinates must lie within 1e+09 mm of 0"),
        (20, '"1,2', "numbers|quote"),
        (20, "\x00,2", "numbers|NUL"),
    ],
)
def test_points_that_are_none_are_refused(tmp_path, row, text, message):
    lines = [f"{k},{0.1 * k**2}" for k in range(40)]
    lines[row - 1] = text
    path = tmp_path / "points.csv"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(CurveError) as caught:
        read_points(path, 0.01)
    assert any(part in str(caught.value) for part in message.split("|"))


def test_a_point_far_from_all_others_is_named_or_passed_within_tolerance(tmp_path):
    refusals, passed = [], 0
    for far in 10.0 ** np.arange(2, 10):
        lines = [f"{k},{0.1 * k**2}" for k in range(40)]
        lines[24] = f"{far:.0f},3"
        path = tmp_path / "points.csv"
        path.write_text("\n".join(lines) + "\n")
        try:
            curve = read_points(path, 0.01)
        except CurveError as error:
            refusals.append(str(error))
        else:
            passed += 1
            assert curve.deviation <= 0.01
    assert passed > 0
    assert refusals
    assert all("points.csv:25: the spline through the points misses this one by" in said for said in refusals)


def test_points_nearer_than_the_digits_of_the_parameter_are_one(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("0,0\n10,0\n10,1e-14\n20,5\n30,5\n")
    assert read_points(path, 1e-3).length == pytest.approx(31.3, abs=0.5)
