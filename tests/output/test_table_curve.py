"""A table read on a curve that another machine made: the same within its rounding, or another one."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from cases import PROGRAMS
from table_lines import CIRCLE, LIMITS, first_row, sealed, small_plan

from planner import InputError, check, load_curve, load_limits, plan_feedrate, read_table, write_table
from planner.geometry.nurbs import NurbsCurve
from planner.output.table_curve import SAME_CURVE

SLOTS = str(PROGRAMS / "slots.ngc")


def altered(curve, change):
    """The curve with ``change(values, at)`` made of its control points, weights and knots."""
    points, weights, knots = (change(np.array(x)) for x in (curve.control_points, curve.weights, curve.knots))
    return NurbsCurve(points, knots, curve.degree, weights, name=curve.name, axes=curve.axes)


@pytest.fixture(scope="module")
def butterfly(tmp_path_factory):
    curve = load_curve("butterfly-nurbs")
    limits = load_limits("mill").for_curve(curve)
    file = tmp_path_factory.mktemp("butterfly") / "table.csv"
    profile = plan_feedrate(curve, limits)
    write_table(file, profile, limits)
    return curve, limits, file, profile


def nudged(seed, **where):
    """Every number one place up or down; equal numbers, as those of a multiple knot, alike."""
    rng = np.random.default_rng(seed)

    def change(values):
        kinds, index = np.unique(values, return_inverse=True)
        moved = np.nextafter(kinds, np.where(rng.random(kinds.size) < 0.5, -np.inf, np.inf))
        return np.where(values == 0.0, 0.0, moved[index].reshape(values.shape))

    return change


class TestAnotherMachine:
    @pytest.mark.parametrize("seed", range(6))
    def test_the_last_digit_of_every_coefficient_does_not_matter(self, butterfly, seed):
        curve, limits, file, profile = butterfly
        other = altered(curve, nudged(seed))
        assert other.fingerprint != curve.fingerprint
        found = read_table(file, other)
        assert found.curve is other
        assert np.array_equal(found.t, profile.t)
        assert np.abs(found.u - profile.u).max() <= SAME_CURVE
        assert np.isin(np.unique(other.knots), found.u).sum() == np.isin(np.unique(curve.knots), profile.u).sum()
        report, before = check(other, limits, found), check(curve, limits, profile)
        assert report.ok
        assert report.summary() == before.summary()

    @pytest.mark.parametrize("relative", [1e-11, -1e-11, 1e-9, 1e-3])
    def test_more_than_that_is_another_curve(self, butterfly, relative):
        curve, _, file, _ = butterfly
        points = np.array(curve.control_points) * (1.0 + relative)
        other = NurbsCurve(points, curve.knots, curve.degree, curve.weights, name=curve.name)
        with pytest.raises(InputError, match=r"is for the curve butterfly-nurbs .* off at u = .*1e-12 of its size, "):
            read_table(file, other)

    @pytest.mark.parametrize("k", range(0, 51, 5))
    def test_one_control_point_is_enough(self, butterfly, k):
        curve, _, file, _ = butterfly
        points = np.array(curve.control_points)
        points[k] += 1e-11 * np.abs(points).max() * np.array([1.0, -1.0])
        other = NurbsCurve(points, curve.knots, curve.degree, curve.weights, name=curve.name)
        with pytest.raises(InputError, match=r"[XY] is \d\.?\d*e-(09|10) mm off at u = "):
            read_table(file, other)

    def test_the_place_is_where_it_is_farthest_off(self, butterfly):
        curve, _, file, profile = butterfly
        points = np.array(curve.control_points)
        points[20] += [0.0, 1e-6]
        other = NurbsCurve(points, curve.knots, curve.degree, curve.weights, name=curve.name)
        apart = np.abs(other.derivatives(profile.u, 0)[0] - curve.derivatives(profile.u, 0)[0])
        row = int(apart[:, 1].argmax())
        with pytest.raises(
            InputError, match=rf"Y is {apart[row, 1]:.3g} mm off at u = {profile.u[row]:.9g} \(row {row + 1}\); "
        ):
            read_table(file, other)

    def test_another_domain_is_another_curve(self, butterfly):
        curve, _, file, _ = butterfly
        longer = NurbsCurve(curve.control_points, 2.0 * np.array(curve.knots), curve.degree, curve.weights)
        with pytest.raises(InputError, match=r"its parameter has an end at u = 1\.0, that of .* at 2\.0"):
            read_table(file, longer)

    def test_other_axes_are_another_curve(self, butterfly):
        curve, _, file, _ = butterfly
        turned = NurbsCurve(curve.control_points, curve.knots, curve.degree, curve.weights, axes=("X", "Z"))
        with pytest.raises(InputError, match="its axes are X Y, not X Z"):
            read_table(file, turned)

    def test_few_rows_cannot_tell(self, tmp_path):
        file = tmp_path / "table.csv"
        write_table(file, small_plan(), LIMITS)
        same = altered(CIRCLE, lambda values: values)
        assert read_table(file, same).curve is same
        with pytest.raises(InputError, match=r"\d rows between u = 0 and 0\.25 cannot tell .*\(6 are needed\)"):
            read_table(file, altered(CIRCLE, nudged(1)))

    def test_a_hash_is_no_excuse_for_edited_rows(self, butterfly, tmp_path):
        """The seals still count: rows of which a place was moved to where the other curve is."""
        curve, _, file, _ = butterfly
        lines = file.read_text().splitlines(keepends=True)
        at = first_row(lines) + 40
        cells = lines[at].split(",")
        cells[3] = repr(float(cells[3]) * (1.0 + 1e-13))
        lines[at] = ",".join(cells)
        moved = tmp_path / "table.csv"
        moved.write_text("".join(lines))
        with pytest.raises(InputError, match="rows_sha256 differs"):
            read_table(moved, altered(curve, nudged(0)))


class TestTablesOfBefore:
    def test_what_they_say_is_enough(self, butterfly, tmp_path):
        """A table holds no more than before: one without a hash that is known is compared by its rows."""
        curve, _, file, profile = butterfly
        lines = file.read_text().replace(curve.fingerprint, "0123456789abcdef" * 2).splitlines(keepends=True)
        old = tmp_path / "table.csv"
        old.write_text("".join(sealed(lines)))
        found = read_table(old, curve)
        assert np.array_equal(found.u, profile.u)
        assert found.duration == profile.duration


@pytest.fixture
def other_libm(monkeypatch):
    """Functions of libm that are right to one unit in the last place, and not always to half of one."""
    count = [0]

    def off(value):
        count[0] += 1
        moved = np.nextafter(value, np.inf if count[0] % 3 else -np.inf) if count[0] % 2 else value
        exact = np.isin(value, (0.0, 1.0, -1.0))  # every libm has these
        return np.where(exact, value, moved) if np.ndim(value) else value if exact else moved

    def wrapped(function):
        return lambda *given, **named: off(function(*given, **named))

    def scalar(function):
        return lambda *given: float(off(function(*given)))

    names = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "hypot", "exp", "log")
    own = {getattr(math, name): scalar(getattr(math, name)) for name in names}
    for module in [m for key, m in sys.modules.items() if key.split(".")[0] in {"planner", "feedplan"}]:
        for name, value in list(vars(module).items()):
            if type(value).__name__ == "builtin_function_or_method" and value in own:
                monkeypatch.setattr(module, name, own[value])
    for name in names:
        monkeypatch.setattr(math, name, scalar(getattr(math, name)))
    for name in ("sin", "cos", "arctan2", "hypot", "arccos", "arcsin"):
        monkeypatch.setattr(np, name, wrapped(getattr(np, name)))
    return count


def program_and_again(tmp_path, request, path):
    """A table of the plan of a program, its limits, and the curve that another machine makes of the program."""
    limits = load_limits("mill")
    curve = load_curve(SLOTS, tolerance=0.01, limits=limits, path=path)
    own = limits.for_curve(curve)
    write_table(tmp_path / "table.csv", plan_feedrate(curve, own), own)
    count = request.getfixturevalue("other_libm")
    again = load_curve(SLOTS, tolerance=0.01, limits=limits, path=path)
    assert count[0] > 10
    assert again.fingerprint != curve.fingerprint
    return own, again


def test_a_table_of_a_program_is_read_with_another_libm(tmp_path, request):
    limits, again = program_and_again(tmp_path, request, "separate")
    found = read_table(tmp_path / "table.csv", again)
    assert found.curve is again
    assert check(again, limits, found).ok


def test_a_path_found_with_its_feed_is_another_one_there(tmp_path, request):
    """The search for it makes um of last digits: that is said, and what to do."""
    _, again = program_and_again(tmp_path, request, "joint")
    with pytest.raises(
        InputError, match=r"of a program as joint .* where rounding is the same; plan it .*--path separate"
    ):
        read_table(tmp_path / "table.csv", again)
