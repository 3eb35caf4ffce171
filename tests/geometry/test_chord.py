"""Chords of a circle and distances from a segment, against closed forms and against looking at many points."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from planner.compiled import core
from planner.geometry import chord

SOURCE = Path(chord.__file__).read_text(encoding="utf-8")


def half_chord_off(rules):
    """A chord under the angle 2 a of a circle of radius r has the half length r sin a and leaves it by r (1 - cos a)."""
    radius = np.array([0.01, 1.0, 30.0, 1e5])[:, None]
    angle = np.array([1e-3, 0.2, 1.0, 0.5 * np.pi])
    found = rules.half_chord(1.0 / (radius + 0.0 * angle), radius * 2.0 * np.sin(0.5 * angle) ** 2)
    return float(np.abs(found / (radius * np.sin(angle)) - 1.0).max())


def distance_off(rules):
    """Every point against the nearest of many points of the segment."""
    rng = np.random.default_rng(1)
    a, b, points = rng.normal(size=(40, 3)), rng.normal(size=(40, 3)), rng.normal(size=(40, 5, 3))
    b[0] = a[0]  # a chord without length is a point
    x = np.linspace(0.0, 1.0, 2001)[:, None]
    nearest = [
        [np.sqrt(((p - (start + x * (end - start))) ** 2).sum(axis=1)).min() for p in some]
        for some, start, end in zip(points, a, b, strict=True)
    ]
    return float(np.abs(rules.distance_to_chord(points, a, b) - nearest).max())


def test_half_chord_is_that_of_the_circle():
    assert half_chord_off(chord) < 1e-9  # of an angle of 1e-3 the sagitta keeps ten digits
    assert (chord.half_chord(np.array([0.0, 2.0]), 9.0) == [np.inf, 0.5]).all()


def test_distance_is_that_of_the_nearest_point_of_the_segment():
    assert distance_off(chord) < 1e-6


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("2.0 * radius - sagitta", "2.0 * radius + sagitta"),
        ("2.0 * radius - sagitta", "1.0 * radius - sagitta"),
        ("np.sqrt(sagitta", "np.cbrt(sagitta"),
        ("np.minimum(error", "np.maximum(error"),
        ("(b - a)", "(a - b)"),
        ("points - a", "points + a"),
        ("from_a - share", "from_a + share"),
        (", 0.0, 1.0)", ", -1.0, 1.0)"),
        (", 0.0, 1.0)", ", 0.0, 2.0)"),
        ("np.divide(along, square", "np.divide(square, along"),
    ],
)
def test_an_error_in_either_formula_is_found(old, new):
    assert SOURCE.count(old) == 1
    changed = ModuleType("changed")
    with np.errstate(all="ignore"):
        exec(compile(SOURCE.replace(old, new), "changed", "exec"), changed.__dict__)
        assert not max(half_chord_off(changed), distance_off(changed)) < 1e-3


def test_the_compiled_form_agrees():
    rng = np.random.default_rng(2)
    radius, error = np.exp(rng.normal(size=(2, 100)))
    core.differential_half_chord(100, radius, error, found := np.empty(100))
    np.testing.assert_allclose(found, chord.half_chord(1.0 / radius, error), rtol=1e-13)
