"""Curves given by expressions: exact derivatives, the small language, and the pieces fitted for compiled code."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import CurveError, InputError, load_curve
from planner.geometry.formula import FUNCTIONS, FormulaCurve, parse_constant

THESIS = {
    "teardrop": (lambda u: -150 * u + 450 * u**2 - 300 * u**3, lambda u: -150 * u + 150 * u**2),
    "hypotrochoid": (
        lambda u: 2 * mpmath.cos(u) + 5 * mpmath.cos(2 * u / 3),
        lambda u: 2 * mpmath.sin(u) - 5 * mpmath.sin(2 * u / 3),
    ),
    "snailshell": (
        lambda u: 10 * mpmath.sin(2 * u) / (u * u + 4),
        lambda u: 10 * mpmath.cos(2 * u) / (u * u + 4),
    ),
    "butterfly": (
        lambda u: mpmath.sin(u) * (mpmath.exp(mpmath.cos(u)) - 2 * mpmath.cos(4 * u) - mpmath.sin(u / 12) ** 5),
        lambda u: mpmath.cos(u) * (mpmath.exp(mpmath.cos(u)) - 2 * mpmath.cos(4 * u) - mpmath.sin(u / 12) ** 5),
    ),
}


def exact(functions, u):
    """Derivatives 0..3 (4, dim), by mpmath in 50 digits."""
    with mpmath.workdps(50):
        at = mpmath.mpf(float(u))
        return np.array([[float(mpmath.diff(f, at, k)) for f in functions] for k in range(4)])


def parabola(x, **changes):
    """A curve with the given expression for X."""
    return FormulaCurve({"X": x, "Y": "u"}, **({"domain": (0.0, 1.0)} | changes))


class TestDerivatives:
    @pytest.mark.parametrize("name", THESIS)
    def test_thesis_curves(self, name):
        curve = load_curve(name)
        u = np.linspace(*curve.domain, 13)
        expected = np.stack([exact(THESIS[name], x) for x in u], axis=1)
        error = np.abs(curve.derivatives(u) - expected).max(axis=(1, 2))
        assert (error <= np.array([4e-15, 1e-14, 2e-14, 4e-14]) * np.abs(expected).max(axis=(1, 2))).all()

    @pytest.mark.parametrize(
        ("expression", "function"),
        [
            ("sin(u)", mpmath.sin), ("cos(u)", mpmath.cos), ("tan(u)", mpmath.tan), ("asin(u)", mpmath.asin),
            ("acos(u)", mpmath.acos), ("atan(u)", mpmath.atan), ("sinh(u)", mpmath.sinh), ("cosh(u)", mpmath.cosh),
            ("tanh(u)", mpmath.tanh), ("exp(u)", mpmath.exp), ("log(u + 2)", lambda u: mpmath.log(u + 2)),
            ("sqrt(u + 2)", lambda u: mpmath.sqrt(u + 2)), ("atan2(u, 1 + u**2)", lambda u: mpmath.atan2(u, 1 + u**2)),
            ("pow(u, 3)", lambda u: u**3), ("pow(2, u)", lambda u: 2**u), ("(u + 2)**u", lambda u: (u + 2) ** u),
            ("(u + 2)**2.5", lambda u: (u + 2) ** mpmath.mpf(2.5)), ("1/(u + 2)", lambda u: 1 / (u + 2)),
            ("sqrt((u + 2)**2)", lambda u: u + 2), ("(u + 2)**-3", lambda u: (u + 2) ** -3),
            ("-u*+2", lambda u: -2 * u),
            ("2**3**u", lambda u: mpmath.mpf(2) ** (mpmath.mpf(3) ** u)), ("8 - 4 - 2*u - 1", lambda u: 3 - 2 * u),
            ("8/4/(2 + u)", lambda u: 2 / (2 + u)), ("pi*u + e", lambda u: mpmath.pi * u + mpmath.e),
        ],
    )  # fmt: skip
    def test_every_function_and_operator(self, expression, function):
        curve = parabola(expression, domain=(-0.6, 0.7))
        for u in (-0.55, 0.0, 0.3):
            expected = exact((function,), u)[:, 0]
            np.testing.assert_allclose(curve.derivatives(u)[:, 0], expected, rtol=1e-13, atol=1e-14)

    def test_every_function_is_covered_above(self):
        assert len(FUNCTIONS) == 14

    @pytest.mark.parametrize("power", [0, 1, 2, 3, 4, 5, 7, 50, 101])
    def test_integer_powers_of_negative_numbers_and_of_zero(self, power):
        for text in (f"u**{power}", f"pow(u, {power})", f"u**{power}.0"):
            curve = parabola(f"u + {text}" if power == 0 else text, domain=(-0.9, 0.5))
            for u in (-0.9, -0.3, 0.0):
                falling = [1, power, power * (power - 1), power * (power - 1) * (power - 2)]
                expected = [c * u ** (power - k) if c else 0.0 for k, c in enumerate(falling)]
                expected[0] += u if power == 0 else 0.0
                expected[1] += 1.0 if power == 0 else 0.0
                np.testing.assert_allclose(curve.derivatives(u)[:, 0], expected, rtol=1e-12, atol=1e-15)

    def test_power_of_a_sine_has_derivatives_where_the_sine_vanishes(self):
        curve = FormulaCurve({"X": "u", "Y": "sin(u)**5", "Z": "sin(u/12)**3"}, (-4.0, 4.0))
        d = curve.derivatives(np.array([-np.pi, 0.0, np.pi, -1.0]))
        assert np.isfinite(d).all()
        np.testing.assert_allclose(d[:, 1, 1], 0.0, atol=1e-300)
        expected = exact((lambda u: u, lambda u: mpmath.sin(u) ** 5, lambda u: mpmath.sin(u / 12) ** 3), -1.0)
        np.testing.assert_allclose(d[:, 3], expected, rtol=1e-13, atol=1e-15)

    def test_derivatives_of_many_points_are_those_of_single_ones(self):
        curve = load_curve("butterfly")
        u = np.linspace(*curve.domain, 5001)
        some = u[::500]
        many = curve.derivatives(u)[:, ::500]
        np.testing.assert_allclose(many, np.stack([curve.derivatives(x) for x in some], axis=1), rtol=1e-13)

    def test_constant_and_vanishing_derivatives_are_filled_in(self):
        curve = FormulaCurve({"X": "2*u", "Y": "7", "Z": "u**2"}, (0.0, 1.0))
        np.testing.assert_array_equal(
            curve.derivatives(np.array([0.0, 0.5])),
            [
                [[0.0, 7.0, 0.0], [1.0, 7.0, 0.25]],
                [[2.0, 0.0, 0.0], [2.0, 0.0, 1.0]],
                [[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]],
                [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
            ],
        )

    def test_scale_multiplies_the_linear_axes_only(self):
        plain = FormulaCurve({"X": "cos(u)", "Y": "sin(u)", "A": "u"}, (0.0, 1.0))
        large = FormulaCurve({"X": "cos(u)", "Y": "sin(u)", "A": "u"}, (0.0, 1.0), scale=10.0)
        np.testing.assert_allclose(large.derivatives(0.3), plain.derivatives(0.3) * [10.0, 10.0, 1.0], rtol=1e-15)
        assert large.axis_units == ("mm", "mm", "rad")

    def test_other_name_of_the_parameter(self):
        curve = FormulaCurve({"X": "cos(t)", "Y": "e*t"}, (0.0, 1.0), parameter="t")
        np.testing.assert_allclose(curve.derivatives(0.5, 0)[0], [np.cos(0.5), np.e * 0.5], rtol=1e-15)
        named_e = FormulaCurve({"X": "e", "Y": "2*e"}, (0.0, 1.0), parameter="e")
        np.testing.assert_array_equal(named_e.derivatives(0.5, 0)[0], [0.5, 1.0])


FITTED = {
    **{name: load_curve(name) for name in THESIS},
    "butterfly of 1 m": load_curve("butterfly", scale=100.0),
    "far away": FormulaCurve({"X": "1e5 + 20*cos(u)", "Y": "20*sin(u)"}, (0.0, 6.0)),
    "100 turns": FormulaCurve({"X": "u*cos(u)", "Y": "u*sin(u)"}, (1.0, 600.0)),
    "narrow bump": FormulaCurve({"X": "u", "Y": "exp(-((u - 0.3137)*200)**2)"}, (0.0, 1.0)),
    "1 nm": FormulaCurve({"X": "1e-6*cos(u)", "Y": "1e-6*sin(3*u)"}, (0.0, 6.0)),
    "with a rotary axis": FormulaCurve({"X": "100*cos(u)", "Y": "100*sin(u)", "C": "sin(u)**2"}, (0.0, 6.0)),
}


class TestPieces:
    @pytest.mark.parametrize("curve", FITTED.values(), ids=FITTED.keys())
    def test_fit_is_within_1e13_of_the_extent(self, curve):
        u = np.random.default_rng(5).uniform(*curve.domain, 4000)
        positions = curve.derivatives(u, 0)[0]
        extent = np.where(np.array(curve.axis_units) == "mm", np.ptp(positions, axis=0).max(), 1.0)
        rounding = 2e-15 * np.abs(positions).max(axis=0) + np.spacing(np.abs(u).max()) * np.abs(
            curve.derivatives(u, 1)[1]
        ).max(axis=0)
        error = np.abs(curve.pieces.evaluate(u, 0, False)[0] - positions).max(axis=0)
        assert (error <= 1.5e-13 * extent + 4.0 * rounding).all()

    @pytest.mark.parametrize("name", THESIS)
    def test_pieces_join_and_follow_the_derivatives(self, name):
        curve = load_curve(name)
        pieces = curve.pieces
        assert (pieces.breaks[0], pieces.breaks[-1]) == curve.domain
        assert (np.diff(pieces.breaks) > 0.0).all()
        assert not pieces.rational
        inner = pieces.breaks[1:-1]
        size = np.abs(curve.derivatives(np.linspace(*curve.domain, 300))).max(axis=(1, 2))
        for side in ("left", "right"):
            if inner.size:
                error = np.abs(pieces.evaluate(inner, 3, side == "left") - curve.derivatives(inner)).max(axis=(1, 2))
                assert (error <= np.array([1e-13, 1e-10, 1e-8, 1e-6]) * size).all()

    def test_axes_that_stay_at_the_origin(self):
        curve = FormulaCurve({"X": "0", "Y": "0*u", "C": "u"}, (0.0, 2.0))
        np.testing.assert_allclose(curve.pieces.evaluate(np.array([0.5]), 1, False)[:, 0], [[0, 0, 0.5], [0, 0, 1]])
        assert curve.length == 0.0

    def test_cubic_is_one_piece(self):
        assert load_curve("teardrop").pieces.breaks.size == 2


REFUSED = [
    "", " ", "u +", "(u", "u)", "u u", "sin u", "u;u", "u = 1", "import os", "lambda: u", "lambda u: u", "(u := 1)",
    "u,", "[u]", "{u}", "{u: u}", "[u for u in (1, 2)]", "(x for x in u)", "u[0]", "u.real", "u.__class__", "'u'",
    '"u"', "b'u'", "f'{u}'", "...", "None", "True", "False", "1j", "__import__('os')",
    "__import__('os').system('true')", "eval('u')", "exec('u')", "open('x')", "().__class__.__bases__",
    "sin.__globals__", "u if u else 1", "u and 1", "not u", "~u", "u < 1", "u // 2", "u % 2", "u @ u", "u ^ 2",
    "u & 1", "u | 1", "u << 1", "sin", "sin()", "sin(u, u)", "atan2(u)", "pow(u)", "pow(u, 2, 3)", "sin(x=u)",
    "sin(*[u])", "sin(**{'x': u})", "abs(u)", "max(u, 1)", "v", "x", "u2", "_", "i", "é", "π", "u\0", "\0", "\ud800",
    "yield u", "await u", "u # comment", "*u", "**u", "u..", "0x", "1e", "1__0", "print(u)", "globals()", "u.u",
    "sin(u)(u)", "(lambda: 1)()", "$u", "u!", "u?",
]  # fmt: skip


class TestLanguage:
    @pytest.mark.parametrize("text", REFUSED, ids=ascii)
    def test_whatever_is_no_expression_is_refused(self, text):
        with pytest.raises(CurveError, match="formula: x"):
            parabola(text)

    @pytest.mark.parametrize("value", [5, 1.5, True, None, ["u"], {"u": 1}, b"u", 10**400])
    def test_expression_that_is_no_text_is_refused(self, value):
        with pytest.raises(CurveError, match="must be an expression in quotation marks"):
            parabola(value)

    @pytest.mark.parametrize(
        "text",
        [
            "(" * 500 + "u" + ")" * 500, "-" * 5000 + "u", "sin(" * 2000 + "u" + ")" * 2000, "u" + "+u" * 4900,
            "u" * 100_000, "9" * 4000, "9" * 5000, "[" * 9000, "u**" * 3000 + "u", "u if " * 1500 + "u",
        ],
        ids=lambda text: f"{text[:6]} x {len(text)}",
    )  # fmt: skip
    def test_deep_and_long_texts_are_refused_at_once(self, text):
        with pytest.raises(CurveError, match=r"x (=|has)") as caught:
            parabola(text)
        assert len(str(caught.value)) < 250

    @pytest.mark.parametrize("text", ["9**9**9", "u*9**9**9**9", "1e999*u", "10**400 + u", "exp(exp(exp(9*u)))"])
    def test_huge_numbers_are_no_points(self, text):
        with pytest.raises(CurveError, match="not finite at u = "):
            parabola(text)

    @pytest.mark.parametrize(
        "text", ["sqrt(u - 0.5)", "log(u)", "sqrt(u)", "u**2.5", "acos(2*u)", "1/u", "u**-1", "u**u"]
    )
    def test_values_and_derivatives_must_be_finite(self, text):
        with pytest.raises(CurveError, match="not finite at u = "):
            parabola(text)

    @pytest.mark.parametrize(
        "text",
        ["1/(u - 0.337)", "tan(10*u)", "atan2(sin(9*u), cos(9*u))", "sqrt((u - 0.337)**2)", "sin(1e9*u)", "sin(1e5*u)"],
    )
    def test_poles_jumps_and_corners_are_refused(self, text):
        with pytest.raises(CurveError, match=r"not smooth near|polynomial pieces|digits of u"):
            parabola(text)

    def test_message_names_axis_part_and_what_is_allowed(self):
        with pytest.raises(CurveError, match=r'b: "foo\(u\)" is not allowed .* numbers, u, pi, e, .* sin, cos'):
            FormulaCurve({"X": "u", "B": "1 + foo(u)*2"}, (0.0, 1.0))

    def test_sum_of_many_terms_is_an_expression(self):
        terms = "+".join(f"{0.5**k:.6g}*cos({k}*u)" for k in range(300))
        expected = sum(float(f"{0.5**k:.6g}") * np.cos(k * 0.7) for k in range(300))
        assert parabola(terms).derivatives(0.7, 0)[0, 0] == pytest.approx(expected, rel=1e-14)

    def test_lines_of_a_long_expression(self):
        assert parabola("u\n   + 1\n\t- 2").derivatives(0.5, 0)[0, 0] == -0.5

    @given(st.text(alphabet="u1.*/+-()e ,psincoxq'\"[]:=_\n", max_size=25))
    def test_any_text_gives_a_curve_or_a_curve_error(self, text):
        try:
            curve = parabola(text)
        except CurveError:
            return
        assert np.isfinite(curve.derivatives(np.linspace(0.0, 1.0, 7))).all()


class TestDefinition:
    @pytest.mark.parametrize(
        "domain",
        [(1.0, 0.0), (0.0, 0.0), (0.0, np.inf), (np.nan, 1.0), (0.0,), "01", None, (0.0, "x"), (0.0, 1.0, 2.0)],
    )
    def test_range_must_be_two_increasing_numbers(self, domain):
        with pytest.raises(CurveError, match="u_range"):
            parabola("u", domain=domain)

    @pytest.mark.parametrize("domain", [(0.0, 1e300), (1e15, 1e15 + 8.0)])
    def test_parameter_beyond_the_digits_of_a_double_is_refused(self, domain):
        with pytest.raises(CurveError, match="digits of u do not suffice"):
            FormulaCurve({"X": "cos(u)", "Y": "sin(u)"}, domain)

    @pytest.mark.parametrize("count", [0, 1, 7])
    def test_two_to_six_axes(self, count):
        with pytest.raises(CurveError, match=f"{count} expressions"):
            FormulaCurve(dict.fromkeys("XYZABCU"[:count], "u"), (0.0, 1.0))

    @pytest.mark.parametrize("expressions", [None, "uu", ["u", "u"], 5])
    def test_expressions_are_a_mapping(self, expressions):
        with pytest.raises(CurveError, match="0 expressions"):
            FormulaCurve(expressions, (0.0, 1.0))

    @pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, "2", None, True])
    def test_scale_is_positive(self, scale):
        with pytest.raises(InputError, match=r"scale = .* must be a number > 0"):
            parabola("u", scale=scale)

    @pytest.mark.parametrize("parameter", ["", "2u", "u v", 5, None])
    def test_parameter_is_a_name(self, parameter):
        with pytest.raises(CurveError, match=r"parameter = .* must be a name"):
            parabola("u", parameter=parameter)

    def test_axes_are_known_ones(self):
        with pytest.raises(CurveError, match="different names out of"):
            FormulaCurve({"X": "u", "Q": "u"}, (0.0, 1.0))

    def test_later_changes_of_the_mapping_do_not_reach_the_curve(self):
        expressions = {"X": "u", "Y": "u**2"}
        curve = FormulaCurve(expressions, (0.0, 1.0))
        expressions["Y"] = "u**3"
        assert curve.derivatives(0.5, 0)[0, 1] == 0.25

    @pytest.mark.parametrize(
        ("value", "number"), [("2*pi", 2 * np.pi), (3, 3.0), ("-1/4", -0.25), ("sqrt(2)", np.sqrt(2.0)), (0.1, 0.1)]
    )
    def test_constants(self, value, number):
        assert parse_constant(value, "end") == pytest.approx(number, rel=1e-15)

    @pytest.mark.parametrize("value", ["u", "x", "", "import os", None, True, [1], 10**400])
    def test_bad_constants(self, value):
        with pytest.raises(CurveError, match="end"):
            parse_constant(value, "end")
