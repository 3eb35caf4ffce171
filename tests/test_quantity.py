"""The table of what can be limited: its words, units and letters, and that nothing else lists them again."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from planner import Limits, load_curve, plan_feedrate
from planner.machine.machine_toml import file_key
from planner.quantity import AXIS, FEED, PATH, QUANTITIES, TANGENTIAL, limit_names, motion_names, with_label

ROOT = Path(__file__).resolve().parents[1]


def test_every_row_has_words_and_letters_of_its_own():
    for field in ("key", "label", "letter"):
        assert len({getattr(q, field) for q in QUANTITIES}) == len(QUANTITIES)
    assert set(PATH) | set(AXIS) == set(QUANTITIES)
    assert not set(PATH) & set(AXIS)
    assert all(with_label(q.label) is q for q in QUANTITIES)
    assert with_label("reversal") is None


def test_every_row_is_a_field_of_limits():
    limits = Limits(1.0, [2.0, 3.0], [4.0, 5.0], [6.0, 7.0])
    for q in QUANTITIES:
        assert np.shape(getattr(limits, q.key)) == ((2,) if q in AXIS else ())
        assert len(limits.of(q)) == (2 if q in AXIS else 1)


@pytest.mark.parametrize(
    ("label", "unit", "turning", "key"),
    [
        ("feed", "mm/s", None, "feed_mm_s"),
        ("chord error", "mm", None, "chord_error_mm"),
        ("velocity", "mm/s", "rad/s", "velocity_mm_s"),
        ("acceleration", "mm/s^2", "rad/s^2", "acceleration_mm_s2"),
        ("jerk", "mm/s^3", "rad/s^3", "jerk_mm_s3"),
        ("tangential acceleration", "mm/s^2", None, "tangential_acceleration_mm_s2"),
        ("tangential jerk", "mm/s^3", None, "tangential_jerk_mm_s3"),
    ],
)
def test_units(label, unit, turning, key):
    q = with_label(label)
    assert (q.unit(), file_key(q.key)) == (unit, key)
    assert turning is None or q.unit("rad") == turning


@pytest.mark.parametrize("q", [q for q in QUANTITIES if q.order > 0])
def test_power_is_that_of_a_slower_motion(q):
    """A derivative of order n over a time that is f times as long is f^-n times as large."""
    t, f = np.linspace(0.0, 1.0, 50), 3.0
    slow = np.polynomial.Polynomial([0.0, 1.0, 2.0, 3.0, 4.0])(np.polynomial.Polynomial([0.0, 1.0 / f]))
    fast = np.polynomial.Polynomial([0.0, 1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(slow.deriv(q.order)(f * t), fast.deriv(q.order)(t) / f**q.power, rtol=1e-12)


def test_names_of_a_plan_are_those_of_the_table():
    curve = load_curve("circle")
    profile = plan_feedrate(curve, Limits(100, 250, 1000, 20000), intervals=40)
    assert profile.limit_names == limit_names(curve.axes)
    assert set(profile.limit_names) == {"none", *(q.label for q in PATH), *(q.of(axis) for q in AXIS for axis in "XY")}


def test_motions_are_the_axes_and_the_arc_length():
    limits = Limits(1.0, [2, 3], [4, 5], [6, 7], tangential_acceleration=8.0, tangential_jerk=9.0)
    assert [limits.of_motions(order).tolist() for order in (1, 2, 3)] == [[2, 3, 1], [4, 5, 8], [6, 7, 9]]
    assert motion_names(3, "XY") == ("jerk X", "jerk Y", "tangential jerk")
    assert motion_names(1, "XY") == ("velocity X", "velocity Y", FEED.label)


def test_no_module_spells_the_tangential_limits_again():
    """The words of a quantity that is not of an axis stand in the table and in Limits; and each has its colour."""
    words = re.compile("|".join(f"{q.key}|{q.label}" for q in TANGENTIAL))
    allowed = {"planner/quantity.py", "planner/machine/limits.py", "planner/output/palette.py"}
    found = set()
    for package in ("planner", "interp", "feedplan"):
        for path in sorted((ROOT / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            documented = {
                id(node.body[0].value)
                for node in ast.walk(tree)
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None
            }
            for node in ast.walk(tree):
                text = node.value if isinstance(node, ast.Constant) and id(node) not in documented else None
                if isinstance(text, str) and words.search(text):
                    found.add(str(path.relative_to(ROOT)))
    assert sorted(found - allowed) == []
