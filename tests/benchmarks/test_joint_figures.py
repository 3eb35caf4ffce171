"""What docs/joint.md says of its pictures, and that they are drawn."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from cases import PROJECT

from benchmarks import joint_figures as figures
from planner.geometry.blend import Legs
from planner.joint.bound import joint_bound
from planner.joint.joint_run import JointRun
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


@pytest.mark.parametrize("degrees", [90, 135, 170])
def test_the_bound_proves_what_the_page_says(degrees):
    said = re.search(rf"([0-9.]+) % (?:of the time )?at( a turn of)?\s+{degrees}°", PAGE)
    angle = np.deg2rad(degrees)
    points = np.array([[0.0, 0.0], [20.0, 0.0], [20.0 + 20.0 * np.cos(angle), 20.0 * np.sin(angle)]])
    legs = np.zeros((2, 4, 2))
    legs[:, 0], legs[:, 3] = points[:-1], np.diff(points, axis=0) / 20.0
    limits = {"velocity": np.full(2, 250.0), "acceleration": np.full(2, 1000.0), "jerk": np.full(2, 20000.0)}
    lines = Legs(legs, np.zeros((2, 2)))
    run = JointRun(lines, np.full(2, 20.0), np.full(2, 0.01), np.full(2, 100.0), **limits)
    proven = joint_bound(run).seconds / seconds(passes(float(degrees), 1e-2)[1][0])
    assert 100.0 * proven == pytest.approx(float(said[1]), abs=0.1)


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
