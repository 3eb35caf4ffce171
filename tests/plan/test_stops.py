"""Bends that are corners to a machine: found where they are, and nowhere else."""

import numpy as np
import pytest
from cases import DRIVES, DRIVES_XYZ, drives
from program_blocks import line, program
from stops_reference import sharpest

from planner import check, load_curve, plan_feedrate
from planner.geometry.nurbs import NurbsCurve
from planner.plan.section import axis_weights
from planner.plan.stops import _sharpest, smallest_radius, tight_bends
from planner.programs.path.smooth_path import program_path

ONES = np.ones(2)


def parabola(radius):
    """y = x^2 / (2 radius) up to 10 mm: its curvature has its peak, 1 / radius, at the origin, in the middle of u."""
    height = 10.0
    reach = np.sqrt(2.0 * radius * height)
    return NurbsCurve([[-reach, height], [0.0, -height], [reach, height]], [0, 0, 0, 1, 1, 1], 2)


def near_cusp(gap):
    """A cubic that comes within ``gap`` of a cusp in its middle."""
    points = [[0.0, 0.0], [10.0 + gap, 10.0], [-gap, 10.0], [10.0, 0.0]]
    return NurbsCurve(points, [0, 0, 0, 0, 1, 1, 1, 1], 3)


def test_smallest_radius_follows_from_acceleration_and_jerk():
    assert smallest_radius(DRIVES, ONES) == pytest.approx(8e-4 * 1000.0**3 / 20000.0**2)
    free = drives(acceleration=np.inf)
    assert smallest_radius(free, ONES) == 0.0


@pytest.mark.parametrize("radius", [1e-3, 1e-5, 1e-7])
def test_the_tip_of_a_sharp_parabola_is_a_corner(radius):
    (bend,) = tight_bends(parabola(radius), DRIVES, ONES)
    assert bend.u == pytest.approx(0.5, abs=1e-7)
    assert bend.radius == pytest.approx(radius, rel=1e-4)


@pytest.mark.parametrize("radius", [2.5e-3, 0.1])
def test_a_rounder_one_is_not(radius):
    assert tight_bends(parabola(radius), DRIVES, ONES) == []


def test_between_samples_too():
    """The tip of a spike far narrower than the distance between samples, wherever it lies in its span."""
    for middle in np.linspace(0.31, 0.69, 7):
        cubic = near_cusp(-3.33)
        knots = np.concatenate([[0.0] * 4, [middle], [1.0] * 4])
        points = np.insert(cubic.control_points, 2, cubic.control_points[1:3].mean(axis=0), axis=0)
        curve = NurbsCurve(points, knots, 3)
        u = np.linspace(0.0, 1.0, 400_001)
        sharpest = float(curve.curvature(u).max())
        found = tight_bends(curve, DRIVES, ONES)
        assert bool(found) == (1.0 / sharpest < smallest_radius(DRIVES, ONES))


def test_a_fillet_that_is_a_span_of_its_own_is_passed():
    """A right angle of 20 mm legs rounded within 1 um: the radius is 1.5 um, and stopping would cost 10 ms."""
    machine = DRIVES_XYZ
    curve = program_path(program(line(20, 0), line(20, 20)), 1e-3, machine, path="separate").curve
    limits = machine.for_curve(curve)
    sharpest = float(curve.curvature(np.linspace(*curve.domain, 2_000_001)).max())
    assert 1.0 / sharpest < smallest_radius(limits, ONES)
    assert tight_bends(curve, limits, ONES) == []
    assert plan_feedrate(curve, limits).duration == pytest.approx(0.6884, rel=5e-4)


def test_two_peaks_of_one_bend_count_once():
    (bend,) = tight_bends(near_cusp(1e-4), DRIVES, ONES)
    assert bend.u == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("name", ["teardrop", "butterfly", "hypotrochoid", "snailshell", "circle", "butterfly-nurbs"])
def test_the_named_curves_have_none(name):
    assert tight_bends(load_curve(name, scale=10.0), DRIVES, ONES) == []


def test_weighted_as_the_drives_feel_it():
    """An axis with a tenth of the acceleration makes ten times the length."""
    slow = drives(acceleration=[1000.0, 100.0], jerk=[20000.0, 2000.0])
    assert axis_weights(slow).tolist() == [1.0, 10.0]
    assert len(tight_bends(parabola(1e-2), slow, axis_weights(slow))) == 1


def test_a_plan_stops_there_and_says_so():
    curve = parabola(1e-5)
    profile = plan_feedrate(curve, DRIVES)
    (bend,) = tight_bends(curve, DRIVES, ONES)
    assert profile.feed[np.searchsorted(profile.u, bend.u)] == 0.0
    assert "exact stop at u = 0.5, a bend of 1e-05 mm radius" in profile.notes
    assert profile.work.slowdown < 1.002
    assert check(curve, DRIVES, profile).ok


SHARP = {
    "parabola": lambda: parabola(1e-5),
    "near a cusp": lambda: near_cusp(-3.33),
    "rational": lambda: load_curve("butterfly-nurbs"),
    "a formula": lambda: load_curve("hypotrochoid", scale=10.0),
    "a smoothed program": lambda: (
        program_path(
            program(line(20, 0), line(20, 0.5), line(0, 0.5), line(0, 1), line(20, 1)),
            0.01,
            DRIVES_XYZ,
            path="separate",
        ).curve
    ),
}


@pytest.mark.parametrize("case", SHARP)
def test_the_compiled_search_finds_what_arrays_find(case):
    curve = SHARP[case]()
    weights = np.array([1.0, 1.5, 0.5])[: curve.dim]
    counted = 0
    for radius in (1e-6, 1e-3, 0.3, 10.0):
        plain = sharpest(curve, weights, radius)
        found = _sharpest(curve, weights, radius, 0, curve.pieces.breaks.size - 1)
        counted += plain[0].size
        if curve.dim == 2:
            np.testing.assert_array_equal(found, plain)
        else:  # sums of three products in another order
            np.testing.assert_allclose(found[1], plain[1], rtol=1e-6)
    assert counted > 0


def test_pieces_from_anywhere_on_are_searched_alone():
    curve = SHARP["a smoothed program"]()
    count = curve.pieces.breaks.size - 1
    weights = np.ones(curve.dim)
    whole = np.sort(_sharpest(curve, weights, 10.0, 0, count)[0])
    halves = [_sharpest(curve, weights, 10.0, first, count // 2)[0] for first in (0, count - count // 2)]
    assert np.isin(np.round(whole, 6), np.round(np.concatenate(halves), 6)).mean() > 0.9
