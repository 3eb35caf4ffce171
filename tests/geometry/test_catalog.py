"""The named curves against their published figures, and curve files, good and bad."""

import contextlib
import json
import os
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import CATALOG, CurveError, InputError, load_curve
from planner.geometry.fiveaxis import DualSplineCurve
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve

# Lengths: Yusoff 2022 (thesis summary), Cheng, Tsai, Cheng 2002, Ma et al. 2022; radii by independent computation.
LENGTHS = {
    "teardrop": 101.834695,
    "hypotrochoid": 68.627374,
    "snailshell": 13.855877,
    "butterfly": 35.606994,
    "circle": 314.1592653589793,
    "butterfly-nurbs": 382.8565834742799,
    "flank": 98.16813287344424,
}
MIN_RADII = {
    "teardrop": (10.947321, 5e-7),
    "hypotrochoid": (0.421053, 5e-7),
    "snailshell": (0.108812, 5e-7),
    "butterfly": (0.0165417, 5e-7),  # at sampled points; the curve's own minimum, 0.01654146, is at its very end
    "circle": (50.0, 1e-12),
    "butterfly-nurbs": (0.0232, 5e-5),
}
NURBS = {
    "type": "nurbs",
    "degree": 2,
    "control_points": [[0, 0], [1, 2], [3, 1], [4, 0]],
    "weights": [1, 2, 1, 1],
    "knots": [0, 0, 0, 0.5, 1, 1, 1],
}
FORMULA = {"type": "formula", "x": "cos(u)", "y": "2*sin(u)", "u_range": [0, "pi/2"]}


@pytest.fixture
def write(tmp_path):
    """Write a curve file: a table as JSON, text or bytes as they are."""

    def write_file(content, name="curve.json"):
        path = tmp_path / name
        text = json.dumps(content) if isinstance(content, dict | list) else content
        path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
        return path

    return write_file


def without(table, key):
    return {name: value for name, value in table.items() if name != key}


class TestNamedCurves:
    def test_all_names_load(self):
        assert set(CATALOG) == set(LENGTHS)
        assert {name: load_curve(name).dim for name in CATALOG} == dict.fromkeys(CATALOG, 2) | {"flank": 5}

    @pytest.mark.parametrize("name", CATALOG)
    def test_length(self, name):
        digits = 1e-12 if LENGTHS[name] > 90 and name != "teardrop" else 1e-7
        assert load_curve(name).length == pytest.approx(LENGTHS[name], rel=digits)

    @pytest.mark.parametrize("name", MIN_RADII)
    def test_smallest_radius(self, name):
        curve = load_curve(name)
        u = np.linspace(*curve.domain, 20_001)
        for _ in range(3):
            best = int(np.argmax(curve.curvature(u)))
            u = np.linspace(u[max(best - 1, 0)], u[min(best + 1, u.size - 1)], 201)
        value, tolerance = MIN_RADII[name]
        assert 1.0 / curve.curvature(u).max() == pytest.approx(value, abs=tolerance)

    def test_sharpest_place_of_the_butterfly_nurbs(self):
        curve = load_curve("butterfly-nurbs")
        u = np.linspace(*curve.domain, 200_001)
        assert u[np.argmax(curve.curvature(u))] == pytest.approx(0.256, abs=5e-4)

    def test_largest_radii(self):
        for name, radius in (("teardrop", 106.066), ("snailshell", 2.2222)):
            curve = load_curve(name)
            assert 1.0 / curve.curvature(np.linspace(*curve.domain, 10_001)).min() == pytest.approx(radius, abs=5e-4)

    def test_circle_is_one(self):
        circle = load_curve("circle")
        u = np.linspace(0.0, 1.0, 999)
        assert np.linalg.norm(circle.derivatives(u, 0)[0] - [50.0, 0.0], axis=1) == pytest.approx(50.0, abs=1e-13)
        for side in ("left", "right"):
            np.testing.assert_allclose(circle.curvature(u, side=side), 0.02, rtol=1e-12)

    @pytest.mark.parametrize("name", CATALOG)
    def test_scale(self, name):
        plain, large = load_curve(name), load_curve(name, scale=10.0)
        assert large.length == pytest.approx(10.0 * plain.length, rel=1e-13)
        assert large.domain == plain.domain
        assert large.fingerprint != plain.fingerprint

    @pytest.mark.parametrize("scale", [0, -1, np.nan, np.inf, "2", None, True, 1j, [1.0], 10**400])
    def test_scale_must_be_positive_and_finite(self, scale):
        for name in ("butterfly", "circle"):
            with pytest.raises(InputError, match=r"scale = .* must be"):
                load_curve(name, scale=scale)

    @pytest.mark.parametrize("scale", [1e-300, 1e300])
    def test_scale_beyond_double_precision(self, scale):
        for name in ("butterfly", "circle", "flank"):
            with pytest.raises(CurveError, match=r"length 0|overflow|not finite|meet"):
                load_curve(name, scale=scale)

    @pytest.mark.parametrize("name", ["Teardrop", "", "circle ", "spiral"])
    def test_unknown_name_lists_the_known_ones(self, name):
        with pytest.raises(CurveError, match=r"nor a name: teardrop, .*, flank$"):
            load_curve(name)

    @pytest.mark.parametrize("name", [None, 5, b"circle", ["circle"]])
    def test_what_is_no_name_is_said_by_its_type(self, name):
        with pytest.raises(CurveError, match=rf"^source is an? {type(name).__name__}; it must be the path of a file$"):
            load_curve(name)


class TestFiles:
    def test_nurbs_from_json(self, write):
        curve = load_curve(write(NURBS))
        assert isinstance(curve, NurbsCurve)
        expected = NurbsCurve(NURBS["control_points"], NURBS["knots"], 2, NURBS["weights"])
        assert curve.fingerprint == expected.fingerprint
        assert curve.name == "curve"

    def test_nurbs_from_toml(self, write):
        text = "\n".join(f"{key} = {json.dumps(value)}" for key, value in NURBS.items())
        assert load_curve(write(text, "c.toml")).fingerprint == load_curve(write(NURBS)).fingerprint
        assert load_curve(write("[curve]\n" + text, "c.TOML")).fingerprint == load_curve(write(NURBS)).fingerprint

    def test_formula_from_json_and_toml(self, write):
        curve = load_curve(write(FORMULA))
        assert isinstance(curve, FormulaCurve)
        assert curve.domain == (0.0, np.pi / 2)
        toml = 'x = "cos(t)"\ny = "2*sin(t)"\nu_range = [0, "pi/2"]\nparameter = "t"'
        u = np.linspace(*curve.domain, 5)
        np.testing.assert_array_equal(load_curve(write(toml, "c.toml")).derivatives(u), curve.derivatives(u))

    def test_dual_spline_from_json(self, write):
        bottom, top = [[0, 0, 0], [10, 0, 0], [20, 5, 0]], [[0, 5, 20], [10, 5, 20], [20, 9, 20]]
        table = {
            "type": "dual_bspline_5axis",
            "degree": 2,
            "knots": [0, 0, 0, 1, 1, 1],
            "bottom_control_points": bottom,
            "top_control_points": top,
            "kinematics": {"machine": "table-tilting A/C"},
        }
        assert isinstance(load_curve(write(table)), DualSplineCurve)
        for machine in ({"machine": "head-tilting BC"}, "BC", {"machine": 5}):
            with pytest.raises(CurveError, match="table-tilting AC"):
                load_curve(write(table | {"kinematics": machine}))
        for ignored in ({"tool_axis": [0, 0, 1]}, {"kinematics": {"machine": "table-tilting AC", "pivot": 50}}):
            with pytest.raises(CurveError, match=r'unknown key "(tool_axis|pivot)"'):
                load_curve(write(table | ignored))
        with pytest.raises(CurveError, match='key "top_control_points" is missing'):
            load_curve(write(without(table, "top_control_points")))

    def test_remarks_change_nothing(self, write):
        remarks = {"name": "c", "source": {"year": 2002}, "description": "d", "note": ["n"], "units": "mm"}
        plain = load_curve(write(NURBS)).fingerprint
        assert load_curve(write(remarks | {"curve": NURBS})).fingerprint == plain
        assert load_curve(write(remarks | NURBS | {"dim": 2})).fingerprint == plain
        assert load_curve(write({"curve": NURBS | {"units": "not stated"}})).fingerprint == plain

    def test_type_may_be_left_out(self, write):
        assert isinstance(load_curve(write(without(NURBS, "type"))), NurbsCurve)
        assert isinstance(load_curve(write(without(FORMULA, "type"))), FormulaCurve)

    def test_weights_and_axes_may_be_left_out_or_null(self, write):
        for table in (without(NURBS, "weights"), NURBS | {"weights": None, "axes": None}):
            curve = load_curve(write(table))
            assert not curve.pieces.rational
            assert curve.axes == ("X", "Y")

    def test_rotary_axes_by_name(self, write):
        points = [[0, 0, 0], [1, 2, 0.1], [3, 1, 0.3], [4, 0, 0.2]]
        curve = load_curve(write(NURBS | {"control_points": points, "axes": ["X", "Y", "A"]}), scale=2.0)
        np.testing.assert_allclose(curve.derivatives(1.0, 0)[0], [8.0, 0.0, 0.2], rtol=1e-14, atol=1e-15)
        assert curve.tip.axes == ("X", "Y")
        formula = load_curve(write(FORMULA | {"a": "u/3", "axes": ["A", "X", "Y"]}), scale=2.0)
        np.testing.assert_allclose(formula.derivatives(0.3, 0)[0], [0.1, 2 * np.cos(0.3), 4 * np.sin(0.3)], rtol=1e-14)
        assert formula.tip.axes == ("X", "Y")

    def test_byte_order_mark_and_path_objects(self, write):
        path = write(b"\xef\xbb\xbf" + json.dumps(NURBS).encode())
        assert load_curve(path).fingerprint == load_curve(str(path)).fingerprint

    def test_huge_integers_that_are_doubles(self, write):
        points = [[0, 0], [10**20, 2], [3, 10**20], [4, 0]]
        assert load_curve(write(NURBS | {"control_points": points})).length > 1e19


BAD_TABLES = {
    "no type": (without(NURBS, "control_points") | {"type": None}, "type = None must be one of nurbs"),
    "unknown type": (NURBS | {"type": "spline"}, "type = 'spline' must be one of"),
    "type no text": (NURBS | {"type": ["nurbs"]}, "type = .* must be one of"),
    "other type": (NURBS | {"type": "formula"}, 'unknown key "control_points"; a formula has the keys x, y'),
    "misspelt key": (NURBS | {"weigths": [1]}, 'unknown key "weigths"; a nurbs has the keys degree'),
    "misspelt remark": (FORMULA | {"sources": "s"}, "for remarks name, description, note, source, units, dim, type"),
    "inches": (NURBS | {"units": "inch"}, "units = 'inch' must be \"mm\"; leave the key out and give the scale"),
    "inches beside the curve": ({"units": "inch", "curve": FORMULA}, "units = 'inch' must be \"mm\""),
    "unit no text": (NURBS | {"units": ["mm"]}, "units = .* must be"),
    "scale beside the curve": (
        {"scale": 25.4, "curve": NURBS},
        'unknown key "scale" beside "curve"; there may be name',
    ),
    "tool axis of a curve": (NURBS | {"tool_axis": [0, 0, 1]}, 'unknown key "tool_axis"'),
    "no knots": (without(NURBS, "knots"), 'key "knots" is missing'),
    "no degree": (without(NURBS, "degree"), 'key "degree" is missing'),
    "no points": (without(NURBS, "control_points"), 'key "control_points" is missing'),
    "text for a number": (NURBS | {"knots": ["0", 0, 0, 0.5, 1, 1, 1]}, "knots .*'0' is not a number"),
    "truth value for a number": (NURBS | {"weights": [True, 1, 1, 1]}, "weights .*True is not a number"),
    "null for a number": (NURBS | {"weights": [None, 1, 1, 1]}, "weights .*None is not a number"),
    "text for the degree": (NURBS | {"degree": "2"}, "degree = '2' must be an integer"),
    "fraction for the degree": (NURBS | {"degree": 2.5}, "degree = 2.5 must be an integer"),
    "ragged points": (NURBS | {"control_points": [[0, 0], [1], [3, 1], [4, 0]]}, "rows differ in length"),
    "points too deep": (NURBS | {"control_points": [[[0, 0]], [[1, 2]]]}, "has shape"),
    "points a number": (NURBS | {"control_points": 5}, "has shape"),
    "points a text": (NURBS | {"control_points": "0 0 1 1"}, "not a number"),
    "points an object": (NURBS | {"control_points": {"x": [0, 1]}}, "not a number"),
    "integer beyond doubles": (NURBS | {"weights": [10**400, 1, 1, 1]}, "too large"),
    "infinity": (NURBS | {"weights": [np.inf, 1, 1, 1]}, r"weights\[0\] = inf must be finite"),
    "nan": (NURBS | {"control_points": [[0, np.nan], [1, 2], [3, 1], [4, 0]]}, r"\[0\]\[1\] = nan must be finite"),
    "cusp": (NURBS | {"control_points": [[0, 0], [0, 0], [3, 1], [4, 0]]}, "cusp"),
    "point": (NURBS | {"control_points": [[7, 7]] * 4}, "length 0"),
    "axes a text": (NURBS | {"axes": "XY"}, "axes = 'XY' must be a list"),
    "axes twice": (NURBS | {"axes": ["X", "X"]}, "different names"),
    "axes unknown": (NURBS | {"axes": ["X", "Q"]}, "out of X Y Z A B C U V W"),
    "axes too many": (NURBS | {"axes": ["X", "Y", "Z"]}, "names 3 axes"),
    "other dim": (NURBS | {"dim": 3}, "dim = 3, but the curve has the axes X, Y"),
    "one expression": (without(FORMULA, "y"), "1 axis expressions; give 2 to 6 of x, y, z, a, b, c"),
    "no range": (without(FORMULA, "u_range"), 'key "u_range" is missing'),
    "range of one": (FORMULA | {"u_range": [0]}, "list of two numbers"),
    "range falls": (FORMULA | {"u_range": [1, 0]}, "two increasing finite numbers"),
    "range null": (FORMULA | {"u_range": [0, None]}, r"u_range\[1\]"),
    "range with a name": (FORMULA | {"u_range": [0, "u"]}, r'u_range\[1\]: "u" is not allowed'),
    "range infinite": (FORMULA | {"u_range": [0, "1/0"]}, "two increasing finite numbers"),
    "parameter no name": (FORMULA | {"parameter": "2u"}, "parameter = '2u' must be a name"),
    "parameter a number": (FORMULA | {"parameter": 2}, "parameter = 2 must be a name"),
    "expression a number": (FORMULA | {"x": 5}, "x = 5 must be an expression in quotation marks"),
    "expression Python": (FORMULA | {"x": "__import__('os').getcwd()"}, "is not allowed in an expression"),
    "formula axes": (FORMULA | {"axes": ["X", "A"]}, "must name the axes that have an expression: X, Y"),
    "curve a list": ({"curve": [1]}, '"curve" must be an object'),
    "curve null": ({"curve": None}, '"curve" must be an object'),
    "empty object": ({}, "type = None"),
    "list": ([NURBS], "must hold an object .* not a list"),
}
BAD_JSON = {
    "empty": (b"", "not a valid JSON file"),
    "cut off": (b'{"type": "nurbs", ', "not a valid JSON file"),
    "binary": (bytes(range(256)), "is not text in UTF-8"),
    "null bytes": (b"\0" * 64, "not a valid JSON file"),
    "key twice": (b'{"degree": 2, "degree": 3}', 'the key "degree" is given twice'),
    "deep": (b"[" * 100_000, "not a valid JSON file"),
    "endless number": (b'{"degree": ' + b"9" * 5000 + b"}", "not a valid JSON file"),
    "number": (b"3.14", "must hold an object .* not a float"),
    "null": (b"null", "must hold an object"),
}
BAD_TOML = {
    "empty": (b"", "type = None"),
    "JSON": (json.dumps(NURBS).encode(), "not a valid TOML file"),
    "binary": (bytes(range(256)), "is not text in UTF-8"),
    "key twice": (b"degree = 2\ndegree = 3", "not a valid TOML file"),
    "deep": (b"a = " + b"[" * 100_000, "not a valid TOML file"),
    "endless number": (b"degree = " + b"9" * 5000, "not a valid TOML file"),
    "date": (b'type = "nurbs"\ndegree = 1979-05-27\nknots = []\ncontrol_points = []', "degree = datetime|has shape"),
}


class TestBadFiles:
    @pytest.mark.parametrize(("table", "message"), BAD_TABLES.values(), ids=BAD_TABLES.keys())
    def test_table(self, write, table, message):
        with pytest.raises(CurveError, match=message):
            load_curve(write(table))

    @pytest.mark.parametrize(("content", "message"), BAD_JSON.values(), ids=BAD_JSON.keys())
    def test_json(self, write, content, message):
        with pytest.raises(CurveError, match=message):
            load_curve(write(content))

    @pytest.mark.parametrize(("content", "message"), BAD_TOML.values(), ids=BAD_TOML.keys())
    def test_toml(self, write, content, message):
        with pytest.raises(CurveError, match=message):
            load_curve(write(content, "curve.toml"))

    def test_missing_file_directory_and_device(self, tmp_path):
        with pytest.raises(CurveError, match="cannot be read \\(No such file"):
            load_curve(tmp_path / "none.json")
        (tmp_path / "folder.json").mkdir()
        with pytest.raises(CurveError, match="is not a file"):
            load_curve(tmp_path / "folder.json")
        with pytest.raises(CurveError, match="null byte"):
            load_curve("a\0b.json")
        with pytest.raises(CurveError, match="cannot be read"):
            load_curve("x" * 5000 + ".json")
        with pytest.raises(CurveError, match=r"neither a \.json, \.toml, \.dxf, \.csv or \.ngc file nor a name"):
            load_curve(tmp_path / "none")
        with pytest.raises(
            CurveError, match=r"is a directory; give a \.json, \.toml, \.dxf, \.csv or \.ngc file or a name"
        ):
            load_curve(tmp_path)

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
    def test_pipe_is_not_waited_for(self, tmp_path):
        os.mkfifo(tmp_path / "pipe.json")
        with pytest.raises(CurveError, match="is not a file"):
            load_curve(tmp_path / "pipe.json")

    def test_message_names_the_file(self, write):
        path = write("{")
        with pytest.raises(CurveError, match=path.name):
            load_curve(path)

    @settings(max_examples=40)
    @given(
        st.dictionaries(
            st.sampled_from([*NURBS, "x", "y", "u_range", "axes", "dim"]),
            st.recursive(
                st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
                lambda inner: st.lists(inner, max_size=4),
                max_leaves=8,
            ),
        )
    )
    def test_no_table_raises_anything_else(self, tmp_path_factory, changes):
        path = tmp_path_factory.mktemp("curve") / "c.json"
        path.write_text(json.dumps(NURBS | changes))
        with contextlib.suppress(CurveError):
            load_curve(path)

    def test_large_file_loads_quickly(self, write):
        u = np.linspace(0.0, 1.0, 20_000)
        points = np.column_stack([100 * np.cos(40 * u), 100 * np.sin(40 * u), 5 * u])
        knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, points.shape[0] - 2), np.ones(3)])
        path = write({"type": "nurbs", "degree": 3, "control_points": points.tolist(), "knots": knots.tolist()})
        start = time.perf_counter()
        curve = load_curve(path)
        assert len(curve.breaks) > 19_000
        assert curve.length > 3900.0
        assert time.perf_counter() - start < 10.0
