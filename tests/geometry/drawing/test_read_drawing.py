"""Curves out of DXF drawings."""

import re

import numpy as np
import pytest

from planner import load_curve
from planner.errors import CurveError
from planner.geometry.drawing.read_drawing import read_dxf
from planner.geometry.nurbs import NurbsCurve

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
        message = self.refusal(drawing, lambda space: space.add_solid([(0, 0), (1, 0), (0, 1)]))
        assert message.startswith("SOLID #")
        read = "SPLINE, LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE, HELIX, INSERT"
        assert f"is not read; a chain of {read} is: delete it, put the path on a layer of its own (--layer)" in message

    def test_a_mesh(self, drawing):
        message = self.refusal(drawing, lambda space: space.add_polymesh((3, 3)))
        assert re.match(r"POLYLINE #\w+ is a mesh, which is no path: delete it", message)

    def test_nothing(self, drawing):
        assert self.refusal(drawing, lambda space: None).startswith("the model space has no SPLINE")
        assert self.refusal(drawing, lambda space: None, layer="a").startswith("layer 'a' has no SPLINE")
        only = self.refusal(drawing, lambda space: space.add_point((0, 0)))
        assert only.endswith("LWPOLYLINE, POLYLINE, HELIX; not read: 1 POINT")

    def test_another_layer(self, drawing):
        message = self.refusal(
            drawing, lambda space: space.add_line((0, 0), (1, 0), dxfattribs={"layer": "cut"}), layer="a"
        )
        assert message.startswith("layer 'a' has no SPLINE")
        assert message.endswith("; the layers with paths are cut")

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"chain": 2}, "chain = 2 must be 1 to 1; there is 1: LINE #"),
            ({"chain": 0}, "chain = 0 must be 1 to 1; there is 1: LINE #"),
            ({"chain": True}, "chain = True must be a whole number"),
            ({"chain": "1"}, "chain = '1' must be a whole number"),
            ({"layer": 1}, "layer = 1 must be the name of a layer"),
        ],
    )
    def test_what_is_no_choice(self, drawing, options, message):
        with pytest.raises(CurveError) as caught:
            drawing(lambda space: space.add_line((0, 0), (1, 0)), **options)
        assert message in str(caught.value)

    def test_two_chains(self, drawing):
        def add(space):
            space.add_line((0, 0), (10, 0))
            space.add_line((10.5, 0), (20, 0))

        message = self.refusal(drawing, add)
        assert re.match(
            r"the drawing has 2 chains; choose one by its number \(--chain, chain=\) or its layer \(--layer, layer=\): "
            r"1: LINE #(\w+), \(0, 0, 0\) to \(10, 0, 0\), 10 mm, layer 0; 2: LINE #(\w+), \(10.5, 0, 0\) to \(20, 0, 0\), "
            r"9.5 mm, layer 0; the nearest ends, \(10, 0, 0\) of LINE #\1 and \(10.5, 0, 0\) of LINE #\2, are 0.5 mm apart "
            r"and join within 0.001 mm$",
            message,
        )

    def test_many_chains_are_not_all_listed(self, drawing):
        def add(space):
            for k in range(30):
                space.add_circle((10 * k, 0), 2)

        message = self.refusal(drawing, add)
        assert re.search(r"8: CIRCLE #\w+, closed, 12.57 mm, layer 0; and 22 more$", message)

    def test_a_branch(self, drawing):
        def add(space):
            for end in ((10, 0), (0, 10), (-10, 0)):
                space.add_line((0, 0), end)

        message = self.refusal(drawing, add)
        assert message.startswith("the drawing has 3 chains; choose one")
        assert "; 3 ends meet at (0, 0, 0), of LINE #" in message
        assert message.endswith("; a chain has two at every joint: delete what does not belong to it")
        assert at(drawing(add, chain=2), [0, 10]) == pytest.approx(np.array([[0, 0], [0, 10]]))

    def test_a_star_is_refused_before_it_takes_long(self, drawing):
        def add(space):
            for k in range(150):
                space.add_line((0, 0), (10 + k, 1))

        assert self.refusal(drawing, add).startswith("150 ends meet at (0, 0, 0), of LINE #")

    def test_a_path_drawn_twice_is_not_run_out_and_back(self, drawing):
        def add(space):
            space.add_lwpolyline([(0, 0), (5, 3), (9, 0)])
            space.add_lwpolyline([(9, 0), (5, 3), (0, 0)])
            space.add_line((20, 0), (30, 0))

        message = self.refusal(drawing, add, chain=1)
        assert re.match(r"LWPOLYLINE #(\w+) and LWPOLYLINE #(\w+) are the same path, drawn twice; delete one$", message)
        assert drawing(add, chain=2).length == pytest.approx(10.0)

    def test_a_line_drawn_twice_is_named(self, drawing):
        def add(space):
            for start, end in (((0, 0), (10, 0)), ((10, 0), (0, 0)), ((10, 0), (20, 5))):
                space.add_line(start, end)

        message = self.refusal(drawing, add)
        assert re.search(
            r"LINE #(\w+) and LINE #(\w+) have both ends in common, delete one if it is drawn twice", message
        )

    @pytest.mark.parametrize(
        ("add", "message"),
        [
            (lambda space: space.add_line((0, 0), (1e12, 0)), "coordinates must be finite, and lie within 1e\\+09 mm"),
            (lambda space: space.add_line((0, 0), (float("nan"), 0)), "coordinates must be finite"),
            (
                lambda space: space.add_ellipse((0, 0), (1e200, 0), 0.5),
                "ELLIPSE #\\w+: its coordinates must be finite, and lie",
            ),
            (
                lambda space: space.add_ellipse((float("nan"), 0), (1, 0), 0.5),
                "ELLIPSE #\\w+: its coordinates must be finite",
            ),
            (
                lambda space: space.add_spline([(0, 0), (1e200, 0)]),
                "SPLINE #\\w+: its coordinates must be finite, and lie",
            ),
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

    @pytest.mark.parametrize(
        ("points", "closed", "message"),
        [
            ([(0, 0), (1, 1), (1, 1), (2, 0)], False, ": fit points 2 and 3 are the same; delete one"),
            ([(0, 0), (1, 1), (2, 0)], True, " is closed and has fit points only; export it with control points"),
            ([(0, 0)], False, " has neither control points nor fit points; the file is damaged"),
        ],
    )
    def test_fit_points_through_which_there_is_no_one_spline(self, drawing, points, closed, message):
        def add(space):
            space.add_spline(points).closed = closed

        assert self.refusal(drawing, add).partition("#")[2].endswith(message)

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


def test_load_curve_reads_it_scaled(tmp_path):
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    document.modelspace().add_circle((0, 0), 3)
    document.saveas(tmp_path / "a.dxf")
    assert load_curve(tmp_path / "a.dxf", scale=2.0).length == pytest.approx(12 * np.pi, rel=1e-9)


@pytest.mark.parametrize("header", ["", "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n0\nENDSEC\n"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_drawing_that_names_no_unit_is_in_mm(tmp_path, header, end):
    """Also without any HEADER, as small exporters write it: ezdxf 1.4 would have it in metres."""
    line = "0\nLINE\n8\n0\n10\n0\n20\n0\n11\n10\n21\n0\n"
    text = f"{header}0\nSECTION\n2\nENTITIES\n{line}0\nENDSEC\n0\nEOF\n"
    (tmp_path / "plain.dxf").write_bytes(text.replace("\n", end).encode())
    assert read_dxf(tmp_path / "plain.dxf").length == pytest.approx(10.0, rel=1e-12)
