"""What docs/joint.md says of its pictures, and that they are drawn."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from cases import PROJECT

from benchmarks import joint_figures as figures
from planner.output.corner_view import distance_from

PAGE = (PROJECT / "docs" / "joint.md").read_text(encoding="utf-8")


@cache
def passes(degrees, tolerance):
    """The motion of the joint path past a corner, the other one, and the corner."""
    corner = figures.corner_of(figures.turning(degrees, tolerance)).corner
    return corner, corner.passes


def feed_at_least(motion):
    return float(np.linalg.norm(motion.velocity, axis=1).min())


def seconds(motion):
    return float(re.search(r"([0-9.]+) s$", motion.label)[1])


def test_the_feed_in_a_right_angle_is_what_the_page_says():
    _, (joint, separate) = passes(90.0, 1e-2)
    said = re.search(r"([0-9.]+) instead of ([0-9.]+) mm/s", PAGE)
    assert feed_at_least(joint) == pytest.approx(float(said[1]), abs=0.05)
    assert feed_at_least(separate) == pytest.approx(float(said[2]), abs=0.005)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-2, 5e-2])
def test_the_path_swings_to_both_edges_before_the_corner(tolerance):
    corner, (joint, separate) = passes(90.0, tolerance)
    off = distance_from(corner, joint.position) / tolerance
    assert np.abs(off).max() <= 1.0 + 1e-6
    vertex = int(np.argmin(np.linalg.norm(joint.position - corner.vertex, axis=1)))
    before = off[:vertex][joint.t[vertex] - joint.t[:vertex] < 6.0 * np.cbrt(tolerance / 20000.0)]
    assert before.max() > 0.9
    assert before.min() < -0.9
    assert np.argmax(before) < np.argmin(before)  # first inside, then outside, then the corner
    assert distance_from(corner, separate.position).min() > -1e-6


def test_swings_at_all_tolerances_have_one_shape():
    shapes = []
    at = np.linspace(-4.0, 4.0, 81)
    for tolerance in (1e-2, 5e-2):
        corner, (joint, _) = passes(90.0, tolerance)
        vertex = int(np.argmin(np.linalg.norm(joint.position - corner.vertex, axis=1)))
        time = (joint.t - joint.t[vertex]) / np.cbrt(tolerance / 20000.0)
        shapes.append(np.interp(at, time, distance_from(corner, joint.position) / tolerance))
    assert np.abs(shapes[1] - shapes[0]).max() < 0.1


def test_a_reversal_saves_what_the_page_says():
    _, (joint, separate) = passes(170.0, 1e-2)
    said = re.search(r"in the picture (\d+) ms", PAGE)
    assert 1e3 * (seconds(separate) - seconds(joint)) == pytest.approx(float(said[1]), abs=1.0)
    assert feed_at_least(separate) < 1e-3 < feed_at_least(joint)


def test_a_program_as_text_is_planned():
    text = figures.lines_through([(0, 0), (3, 4), (6, 0)], 0.02)
    job, profile = figures.planned(text, "separate")
    assert job.path.tolerance == 0.02
    assert profile.duration > 0.1
    assert job.curve.length == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize("name", ["corner", "swing", "reversal"])
def test_pictures_are_drawn(name):
    assert len(figures.FIGURES[name]().axes) in {2, 4}
    assert f"joint-{name}.png" in PAGE
