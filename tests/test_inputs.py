"""What comes from outside: what passes, and that a refusal names the quantity, its value and what is allowed."""

import numpy as np
import pytest

from planner import load_curve
from planner.errors import CurveError, InputError
from planner.inputs import (
    coordinates,
    numbers,
    plain_number,
    positive_number,
    read_text,
    require_instance,
    require_side,
    shorten,
)
from planner.machine.limits import Limits


class TestText:
    def test_a_byte_order_mark_is_no_text(self, tmp_path):
        path = tmp_path / "a.txt"
        path.write_bytes(b"\xef\xbb\xbfG1 X1\n")
        assert read_text(path, InputError) == "G1 X1\n"
        assert read_text(str(path), InputError) == "G1 X1\n"

    @pytest.mark.parametrize(
        ("name", "said"),
        [
            ("missing", "cannot be read"),
            (".", "is not a file"),
            ("latin", "is not text in UTF-8"),
            ("a\0b", "not a path"),
        ],
    )
    def test_what_is_no_text_file_is_named(self, tmp_path, name, said):
        (tmp_path / "latin").write_bytes("für".encode("latin-1"))
        with pytest.raises(CurveError, match=said):
            read_text(f"{tmp_path}/{name}", CurveError)

    @pytest.mark.parametrize("source", [None, 3, b"a.txt", ["a.txt"]])
    def test_what_is_no_path_is_shown(self, source):
        with pytest.raises(InputError, match="must be the path of a file"):
            read_text(source, InputError)


class TestNumbers:
    @pytest.mark.parametrize("values", [[1, 2.5], (1, np.float32(2.5)), np.array([1.0, 2.5]), [np.int64(1), 2.5]])
    def test_numbers_of_any_kind_become_doubles(self, values):
        found = numbers(values, "knots", CurveError)
        assert found.dtype == np.float64
        assert found.tolist() == [1.0, 2.5]

    def test_the_array_is_a_new_one(self):
        given = np.array([1.0, 2.0])
        assert not np.shares_memory(numbers(given, "knots", CurveError), given)

    @pytest.mark.parametrize(
        ("values", "said"),
        [
            (["1", 2], "'1' is not a number"),
            ([True, 2], "True is not a number"),
            ([None, 2], "None is not a number"),
            ([[1, 2], [3]], "knots must be an array of numbers"),
            (np.array([True]), "of type bool are not numbers"),
            (np.array(["1"]), "are not numbers"),
            ([10**400], "knots must be an array of numbers"),
        ],
    )
    def test_nothing_else_passes_for_a_number(self, values, said):
        with pytest.raises(CurveError, match=said):
            numbers(values, "knots", CurveError)

    def test_coordinates_keep_their_shape_and_are_not_copied(self):
        given = np.zeros((2, 3))
        assert coordinates(given, "u") is given
        assert coordinates(0.5, "u").shape == ()
        for bad in ("0.5", [None], [[1, 2], [3]], True):
            with pytest.raises(InputError, match=r"u = .* must be a number or an array of numbers"):
                coordinates(bad, "u")

    @pytest.mark.parametrize("value", [1, 0.5, np.inf, np.float32(2.0), np.int64(3)])
    def test_positive_numbers(self, value):
        assert positive_number(value, "period") == value

    @pytest.mark.parametrize("value", [0, -1.0, np.nan, True, "1", None, [1.0], 1j])
    def test_what_is_not_positive_is_named_with_a_hint(self, value):
        with pytest.raises(InputError, match=r"period = .* must be a number > 0, in seconds"):
            positive_number(value, "period", ", in seconds")

    @pytest.mark.parametrize("text", ["0", "-1.5", "+.5", "3.", "1e-3", "2E+5"])
    def test_numbers_as_files_hold_them(self, text):
        assert plain_number(text) == float(text)

    @pytest.mark.parametrize(
        "text", ["", "1_0", "\u0661", "Infinity", "inf", "nan", "0x1", "1e", ".", "1,5", " 1", "1 "]
    )
    def test_what_python_alone_takes_is_none(self, text):
        assert plain_number(text) is None

    def test_words_that_pass(self):
        assert plain_number("inf", other=("inf", "nan")) == np.inf
        assert plain_number("-inf", other=("inf", "nan")) is None


def test_swapped_arguments_are_named_with_what_makes_them():
    curve = load_curve("circle")
    require_instance(curve, type(curve), "curve")
    with pytest.raises(InputError, match=r"limits is a .*; it must be a Limits, as load_limits returns"):
        require_instance(curve, Limits, "limits")
    with pytest.raises(InputError, match="limits is the class Limits; it must be a Limits"):
        require_instance(Limits, Limits, "limits")


def test_quotations_fit_a_line_and_show_what_cannot_be_printed():
    assert shorten("short") == "short"
    assert shorten("a\nb\x1b") == "a\\nb\\x1b"
    long = shorten("x" * 10**6)
    assert len(long) == 60
    assert long.endswith("...")


@pytest.mark.parametrize("side", ["Left", "", None, 1])
def test_a_side_is_left_or_right(side):
    require_side("left")
    require_side("right")
    with pytest.raises(InputError, match='must be "left" or "right"'):
        require_side(side)
