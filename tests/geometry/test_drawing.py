"""Curves out of DXF drawings and out of points."""

import re
from itertools import pairwise

import numpy as np
import pytest

from planner import load_curve
from planner.errors import CurveError, InputError
from planner.geometry.drawing import read_dxf
from planner.geometry.nurbs import NurbsCurve
from planner.geometry.points import read_points

ezdxf = pytest.importorskip("ezdxf")


@pytest.fixture
def drawing(tmp_path):
    """Write a drawing with what the function adds to its model space, and read it."""

    def drawing(add, *, units=4, **options):
        document = ezdxf.new("R2010")
        document.header["$INSUNITS"] = units
        add(document.modelspace())
        document.saveas(tmp_path / "part.dxf")
        return read_dxf(tmp_path / "part.dxf", **options)

    return drawing


def at(curve, s):
    return curve.derivatives(curve.arclength.u(np.asarray(s, dtype=float)), 0)[0]


def corners(curve):
    return [b for b in curve.breaks if b.geometric == 0]


def distance_to_polyline(point, vertices):
    """From a point to the two segments about the nearest vertex."""
    k = int(np.clip(np.argmin(np.linalg.norm(vertices - point, axis=1)), 1, len(vertices) - 2))
    best = np.inf
    for a, b in pairwise(vertices[k - 1 : k + 2]):
        w = np.clip((point - a) @ (b - a) / np.sum((b - a) ** 2), 0, 1)
        best = min(best, np.linalg.norm(point - a - w * (b - a)))
    return best


class TestChains:
    def test_lines_in_any_order_and_direction(self, drawing):
        def add(space):
            space.add_line((10, 0), (10, 5))
            space.add_line((0, 0), (10, 0))
            space.add_line((12, 5), (10, 5))

        curve = drawing(add)
        assert curve.axes == ("X", "Y")
        assert curve.name == "part"
        assert curve.length == pytest.approx(17.0, rel=1e-12)
        assert at(curve, [0, 10, 15, 17]) == pytest.approx(np.array([[0, 0], [10, 0], [10, 5], [12, 5]]))
        assert [b.angle for b in corners(curve)] == pytest.approx([np.pi / 2, np.pi / 2])

    def test_a_tangent_arc_joins_smoothly(self, drawing):
        def add(space):
            space.add_line((0, 0), (10, 0))
            space.add_arc((10, 3), 3, -90, 90)
            space.add_line((0, 6), (10, 6))

        curve = drawing(add)
        assert curve.length == pytest.approx(20 + 3 * np.pi, rel=1e-10)
        assert corners(curve) == []
        s = 10 + np.linspace(0.1, 3 * np.pi - 0.1, 50)
        assert np.hypot(*(at(curve, s) - [10, 3]).T) == pytest.approx(np.full(50, 3.0), rel=1e-12)
        assert curve.curvature(curve.arclength.u(s)) == pytest.approx(np.full(50, 1 / 3), rel=1e-9)

    def test_a_full_circle(self, drawing):
        curve = drawing(lambda space: space.add_circle((1, 2), 5))
        assert curve.length == pytest.approx(10 * np.pi, rel=1e-10)
        assert at(curve, [0, 2.5 * np.pi]) == pytest.approx(np.array([[6, 2], [1, 7]]), abs=1e-6)

    def test_a_polyline_with_bulges(self, drawing):
        """A slot: two lines and two half circles, of bulge 1."""
        rows = [(0, 0, 0, 0, 0), (10, 0, 0, 0, 1), (10, 4, 0, 0, 0), (0, 4, 0, 0, 1)]
        curve = drawing(lambda space: space.add_lwpolyline(rows, close=True))
        assert curve.length == pytest.approx(20 + 4 * np.pi, rel=1e-10)
        assert corners(curve) == []
        assert at(curve, [10 + np.pi, 20 + 3 * np.pi]) == pytest.approx(np.array([[12, 2], [-2, 2]]), abs=1e-6)

    @pytest.mark.parametrize("bulge", [1e-300, 1e-13, -1e-11, 1e-9, 1e-7, -1e-5, 1e-3])
    def test_a_small_bulge_bends_as_much_as_it_says(self, drawing, bulge):
        """Sagitta b c / 2 and ends, at every size; below a turn of 1e-9 it is a line."""
        curve = drawing(lambda space: space.add_lwpolyline([(0, 0, 0, 0, bulge), (60, 80, 0, 0, 0), (60, 90, 0, 0, 0)]))
        first = curve.arclength.u(100.0) if abs(bulge) < 1e-4 else curve.breaks[0].u
        points = curve.derivatives(np.array([0.0, 0.5 * first, first]), 0)[0]
        assert points[[0, 2]] == pytest.approx(np.array([[0, 0], [60, 80]]), abs=1e-4 if abs(bulge) > 1e-4 else 1e-7)
        rise = (points[1] - [30, 40]) @ [0.8, -0.6]
        assert rise == pytest.approx(50.0 * bulge if abs(bulge) > 1e-10 else 0.0, abs=1e-12 * 100, rel=1e-3)
        assert len(corners(curve)) == 1

    @pytest.mark.parametrize(
        "extra", [[(0, 0), (0, 0)], [(0, 0), (5e-4, 0)], [(10, 0), (10, 9e-4)], [(20, 0), (20, 0)]]
    )
    def test_slivers_are_absorbed(self, drawing, extra):
        def add(space):
            space.add_line((0, 0), (10, 0))
            space.add_line(*extra)
            space.add_line((10, 0), (20, 0))

        curve = drawing(add)
        assert curve.length == pytest.approx(20.0, abs=1e-9)
        assert corners(curve) == []

    def test_arcs_without_a_turn_are_absorbed(self, drawing):
        def add(space):
            space.add_line((0, 0), (10, 0))
            space.add_arc((10, 3), 3, -90, -90 + 1e-9)
            space.add_arc((10, 3), 3, -90, 90)

        assert drawing(add).length == pytest.approx(10 + 3 * np.pi, rel=1e-9)

    @pytest.mark.parametrize("bulge", [0.3, -0.3, 2.0, -2.0])
    def test_a_bulge_is_the_tangent_of_a_quarter_of_the_angle(self, drawing, bulge):
        curve = drawing(lambda space: space.add_lwpolyline([(0, 0, 0, 0, bulge), (6, 0, 0, 0, 0)]))
        # The arc rises on the right of the chord, for a positive bulge, by b times half the chord.
        assert at(curve, curve.length / 2) == pytest.approx([3, -3 * bulge], abs=1e-6)

    def test_a_spline_is_exact(self, drawing):
        points = [(0, 0, 0), (1, 3, 1), (4, 4, 2), (6, 1, 0), (9, 2, 1)]
        weights, knots = [1, 2, 0.7, 1, 3], [0, 0, 0, 0, 0.4, 1, 1, 1, 1]
        curve = drawing(lambda space: space.add_rational_spline(points, weights, degree=3, knots=knots))
        expected = NurbsCurve(points, knots, 3, weights)
        s = np.linspace(0, expected.length, 200)
        assert curve.axes == ("X", "Y", "Z")
        assert curve.length == pytest.approx(expected.length, rel=1e-9)
        assert at(curve, s) == pytest.approx(at(expected, s), abs=1e-6)
        assert corners(curve) == []

    def test_pieces_of_different_degrees(self, drawing):
        points, knots = [(0, 0, 0), (1, 2, 0), (3, 2, 0), (4, 0, 0)], [0, 0, 0, 0, 1, 1, 1, 1]

        def add(space):
            space.add_open_spline(points, degree=3, knots=knots)
            space.add_line((4, 0), (8, 0))
            space.add_arc((8, -1), 1, 0, 90)

        curve = drawing(add)
        lengths = NurbsCurve(points, knots, 3).length + 4 + np.pi / 2
        assert curve.degree == 3
        assert curve.length == pytest.approx(lengths, rel=1e-9)
        assert at(curve, curve.length) == pytest.approx([9, -1], abs=1e-12)
        assert len(corners(curve)) == 1

    def test_the_parameter_runs_with_the_length(self, drawing):
        def add(space):
            space.add_line((0, 0), (10, 0))
            space.add_arc((10, 3), 3, -90, 90)

        curve = drawing(add)
        speed = np.linalg.norm(curve.derivatives(np.linspace(*curve.domain, 300), 1)[1], axis=1)
        assert speed.min() > 0.8
        assert speed.max() < 1.2

    def test_units_and_layers(self, drawing):
        def add(space):
            space.add_line((0, 0), (1, 0), dxfattribs={"layer": "cut"})
            space.add_text("made by hand")

        curve = drawing(add, units=1, layer="cut")
        assert curve.length == pytest.approx(25.4)

    def test_a_mirrored_arc(self, drawing):
        """With the extrusion along -Z the entity's own X is the world's -X."""
        curve = drawing(lambda space: space.add_arc((1, 0), 2, 0, 90, dxfattribs={"extrusion": (0, 0, -1)}))
        assert at(curve, [0, curve.length]) == pytest.approx(np.array([[-3, 0], [-1, 2]]), abs=1e-9)

    def test_a_long_polyline(self, drawing):
        x = np.linspace(0, 200, 5000)
        curve = drawing(lambda space: space.add_lwpolyline(np.stack([x, np.sin(x)], axis=1).tolist()))
        assert len(corners(curve)) == 4998


class TestDrawingsRefused:
    def refusal(self, drawing, add, **options):
        with pytest.raises(CurveError) as caught:
            drawing(add, **options)
        return str(caught.value).partition("part.dxf: ")[2]

    def test_another_entity(self, drawing):
        message = self.refusal(drawing, lambda space: space.add_point((0, 0)))
        assert message.startswith("POINT #")
        assert "is not read; a chain of SPLINE, LINE, ARC, CIRCLE, LWPOLYLINE is: delete it, or put the path" in message

    def test_nothing(self, drawing):
        assert self.refusal(drawing, lambda space: None).startswith("the model space has no SPLINE")
        assert self.refusal(drawing, lambda space: None, layer="a").startswith("layer 'a' has no SPLINE")

    def test_two_chains(self, drawing):
        def add(space):
            space.add_line((0, 0), (10, 0))
            space.add_line((10.5, 0), (20, 0))

        message = self.refusal(drawing, add)
        assert message.startswith("the drawing is more than one chain: the end (10, 0, 0) of LINE #")
        assert "lies 0.5 mm from the nearest other, of LINE #" in message

    def test_a_branch(self, drawing):
        def add(space):
            for end in ((10, 0), (0, 10), (-10, 0)):
                space.add_line((0, 0), end)

        message = self.refusal(drawing, add)
        assert message.startswith("3 ends meet at (0, 0, 0), of LINE #")
        assert message.endswith("; a chain has two at every joint: delete what does not belong to it")

    def test_a_line_drawn_twice_is_named(self, drawing):
        def add(space):
            for start, end in (((0, 0), (10, 0)), ((10, 0), (0, 0)), ((10, 0), (20, 5))):
                space.add_line(start, end)

        message = self.refusal(drawing, add)
        assert re.search(
            r"LINE #(\w+) and LINE #(\w+) have both ends in common, delete one if it is drawn twice", message
        )

    @pytest.mark.parametrize(
        ("add", "hint"),
        [
            (lambda space: space.add_polyline2d([(0, 0), (5, 0)]), "convert it to LWPOLYLINE"),
            (lambda space: space.add_ellipse((0, 0), (5, 0), 0.5), "convert it to SPLINE"),
            (lambda space: space.add_blockref("part", (0, 0)), "explode the block"),
        ],
    )
    def test_what_to_do_with_other_entities(self, drawing, add, hint):
        assert hint in self.refusal(drawing, add)

    @pytest.mark.parametrize(
        ("add", "message"),
        [
            (lambda space: space.add_line((0, 0), (1e12, 0)), "coordinates must be finite, and lie within 1e\\+09 mm"),
            (lambda space: space.add_line((0, 0), (float("nan"), 0)), "coordinates must be finite"),
            (lambda space: space.add_circle((0, 0), -3), "radius = -3.0 must be > 0"),
            (lambda space: space.add_circle((0, 0), float("inf")), "must be finite"),
            (
                lambda space: space.add_lwpolyline([(0, 0, 0, 0, 1e12), (5, 0, 0, 0, 0)]),
                "vertex 1: bulge = 1e\\+12 makes",
            ),
        ],
    )
    def test_numbers_of_no_drawing(self, drawing, add, message):
        assert re.search(message, self.refusal(drawing, add))

    def test_a_line_without_length(self, drawing):
        assert self.refusal(drawing, lambda space: space.add_line((1, 1), (1, 1))).endswith(
            "no entity is longer than 0.001 mm, within which ends join; are the units right?"
        )

    def test_a_spline_without_control_points(self, drawing):
        message = self.refusal(drawing, lambda space: space.add_spline([(0, 0), (1, 1), (2, 0)]))
        assert message.endswith("has fit points only; export it with control points")

    def test_unknown_units(self, drawing):
        assert self.refusal(drawing, lambda space: space.add_circle((0, 0), 1), units=20).startswith("$INSUNITS = 20")

    @pytest.mark.parametrize("content", [b"", b"rubbish\n", b"\x00\x01\x02" * 50, b"  0\nSECTION\n  2\nENTITIES\n"])
    def test_what_is_no_drawing(self, tmp_path, content):
        path = tmp_path / "part.dxf"
        path.write_bytes(content)
        with pytest.raises(CurveError, match=r"part\.dxf: "):
            read_dxf(path)

    def test_a_missing_file(self, tmp_path):
        with pytest.raises(CurveError, match="there is no such file"):
            read_dxf(tmp_path / "absent.dxf")


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


def test_load_curve_reads_both(tmp_path):
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    document.modelspace().add_circle((0, 0), 3)
    document.saveas(tmp_path / "a.dxf")
    (tmp_path / "a.csv").write_text("0,0\n1,2\n4,4\n")
    assert load_curve(tmp_path / "a.dxf", scale=2.0).length == pytest.approx(12 * np.pi, rel=1e-9)
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


@pytest.mark.parametrize("header", ["", "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n0\nENDSEC\n"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_drawing_that_names_no_unit_is_in_mm(tmp_path, header, end):
    """Also without any HEADER, as small exporters write it: ezdxf 1.4 would have it in metres."""
    line = "0\nLINE\n8\n0\n10\n0\n20\n0\n11\n10\n21\n0\n"
    text = f"{header}0\nSECTION\n2\nENTITIES\n{line}0\nENDSEC\n0\nEOF\n"
    (tmp_path / "plain.dxf").write_bytes(text.replace("\n", end).encode())
    assert read_dxf(tmp_path / "plain.dxf").length == pytest.approx(10.0, rel=1e-12)
