"""Expressions and parameters: precedence, functions, and what cannot be evaluated."""

import math

import numpy as np
import pytest

from planner.programs.reading.expressions import LineError, LineEvaluator, Parameters


def value(text, **named):
    parameters = Parameters()
    for name, number in named.items():
        parameters.set(name, number)
    evaluator = LineEvaluator(text, parameters)
    result = evaluator.value()
    assert evaluator.at == len(text)
    return result


class TestValues:
    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("[-2**2]", 4),  # the sign belongs to the number
            ("[2**3**2]", 64),  # from left to right
            ("[-7MOD3]", 2),
            ("[7MOD-3]", 1),
            ("FIX[-1.5]", -2),
            ("FUP[-1.5]", -1),
            ("FUP[1.5]", 2),
            ("ROUND[2.5]", 3),
            ("ROUND[-2.5]", -3),
            ("[1EQ1.00000001]", 1),
            ("[1NE1.00000001]", 0),
            ("[1EQ1.00001]", 0),
            ("[1+2*3]", 7),
            ("[[1+2]*3]", 9),
            ("[8/4/2]", 1),
            ("[2-3-4]", -5),
            ("[1LT2AND2LT1]", 0),
            ("[1LT2OR2LT1]", 1),
            ("[1XOR2]", 0),
            ("[0XOR2]", 1),
            ("[2GE2]", 1),
            ("[1+1GT1]", 1),
            ("-[1+2]", -3),
            ("-+2", -2),
            ("--2", 2),
            ("-.5", -0.5),
            ("5.", 5),
            ("ATAN[1]/[-1]", 135),
            ("ATAN[-1]/[0]", -90),
            ("SIN[30]", 0.5),
            ("COS[60]", 0.5),
            ("TAN[45]", 1),
            ("ASIN[0.5]", 30),
            ("ACOS[0.5]", 60),
            ("SQRT[2]", math.sqrt(2)),
            ("EXP[1]", math.e),
            ("LN[EXP[2]]", 2),
            ("ABS[-3]", 3),
            ("-ABS[-3]", -3),
            ("[10*SIN[30]+SQRT[9]]", 8),
        ],
    )
    def test_as_linuxcnc_has_them(self, text, expected):
        assert value(text) == pytest.approx(expected, rel=1e-14, abs=1e-14)

    def test_random_expressions_against_python(self):
        """Where both languages have the same precedence: sums of products, with brackets."""
        rng = np.random.default_rng(5)

        def some(depth):
            if depth == 0 or rng.random() < 0.3:
                return f"{rng.uniform(0.1, 9):.3f}"
            return "[" + some(depth - 1) + str(rng.choice(["+", "-", "*", "/"])) + some(depth - 1) + "]"

        for _ in range(300):
            text = "[" + "".join(some(3) + str(rng.choice(["+", "-", "*"])) for _ in range(4)) + "1]"
            expected = eval(text.replace("[", "(").replace("]", ")"))
            assert value(text) == pytest.approx(expected, rel=1e-12, abs=1e-12)

    def test_named_parameters(self):
        assert value("[#<depth>*2+#<_all>]", depth=3.0, _all=1.0) == 7
        assert value("EXISTS[#<depth>]", depth=3.0) == 1
        assert value("EXISTS[#<width>]", depth=3.0) == 0

    def test_parameters_by_a_parameter(self):
        parameters = Parameters()
        for key, number in ((1, 40.0), (40, 7.0), (41, 8.0)):
            parameters.set(key, number)
        assert LineEvaluator("##1", parameters).value() == 7
        assert LineEvaluator("#[#1+1]", parameters).value() == 8

    def test_what_a_line_sets_acts_after_it(self):
        parameters = Parameters()
        parameters.set(3, 15.0)
        found = LineEvaluator("#3=6G1X#3", parameters).line()
        assert found.sets == [(3, 6.0)]
        assert found.words == [("G", 1.0, 4, 6), ("X", 15.0, 6, 9)]


class TestWhatIsRefused:
    @pytest.mark.parametrize(
        ("text", "word", "reason"),
        [
            ("X[1/0]", "[1/0", "divides by 0"),
            ("X[1MOD0]", "[1MOD0", "is not defined for its argument"),
            ("XSQRT[-1]", "SQRT[-1]", "is not defined for its argument"),
            ("X[[0-8]**0.5]", "[[0-8]**0.5", "is not defined for its argument"),
            ("XLN[0]", "LN[0]", "is not defined for its argument"),
            ("XACOS[2]", "ACOS[2]", "is not defined for its argument"),
            ("XEXP[1000]", "EXP[1000]", "is too large"),
            ("X[10**400]", "[10**400", "is too large"),
            ("X[0**-1]", "[0**-1", "divides by 0"),
            ("X#5", "#5", "the parameter is not set before it is read"),
            ("X#<DEPTH>", "#<DEPTH>", "the parameter is not set before it is read"),
            ("X#0", "#0", "the number of a parameter is a whole number from 1 to 5602"),
            ("X#1.5", "#1.5", "the number of a parameter is a whole number from 1 to 5602"),
            ("X[1+2", "[1+2", "the bracket is not closed, or holds what is no expression"),
            ("X[1+2)]", "[1+2)]", "the bracket is not closed, or holds what is no expression"),
            ("X[]", "[]", "a number, a parameter or an expression is missing"),
            ("X", "X", "a number, a parameter or an expression is missing"),
            ("XATAN[1]", "ATAN[1]", "ATAN needs two arguments, ATAN[y]/[x]"),
            ("[1+2]", "[1+2]", "no word starts with it"),
            ("#5", "#5", "a parameter that starts a word is set with ="),
            ("XEXISTS[5]", "EXISTS[5]", "EXISTS asks for a named parameter, EXISTS[#<name>]"),
            ("X" + "[" * 51 + "1" + "]" * 51, "X" + "[" * 19, "more than 50 brackets or # within each other"),
            ("X" + "#" * 5000 + "1", "X" + "#" * 19, "more than 50 brackets or # within each other"),
        ],
    )
    def test_with_the_word(self, text, word, reason):
        with pytest.raises(LineError) as caught:
            LineEvaluator(text, Parameters()).line()
        assert (caught.value.word, caught.value.reason) == (word, reason)

    def test_any_characters_give_a_value_or_an_error(self):
        rng = np.random.default_rng(6)
        pieces = [
            "[",
            "]",
            "#",
            "1",
            "2.5",
            "+",
            "-",
            "*",
            "**",
            "/",
            "X",
            "SIN[",
            "ATAN[",
            "MOD",
            "EQ",
            "AND",
            "=",
            "<a>",
            ".",
        ]
        evaluated = 0
        for _ in range(3000):
            text = "X" + "".join(rng.choice(pieces, rng.integers(1, 9)))
            try:
                LineEvaluator(text, Parameters()).line()
                evaluated += 1
            except LineError:
                pass
        assert evaluated > 20
