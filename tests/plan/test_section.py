"""Sections between exact stops: where a path is cut, the coordinate of a section, and its rest map."""

from dataclasses import replace

import numpy as np
import pytest
from cases import MILL, line_arc_line
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from strategies import random_nurbs

from planner import load_curve
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan.ends import FREE, REST, Feed
from planner.plan.section import Section, axis_weights, cut, evaluate, weighted_arclength

ROTARY = Limits(100.0, [250, 250, 2], [1000, 1000, 10], [20000, 20000, 200], axes=["X", "Y", "A"])


def slope(r):
    """dy/dsigma of the rest map at r = sigma / width, in its factored form."""
    return 1.0 - (1.0 - r) ** 4 * (1.0 + 4.0 * r + 6.0 * r**2)


def section_of(curve, blend_start=0.0, blend_end=0.0, limits=MILL, stops=(True, True)):
    arc = None if all(b.parametric >= 2 for b in curve.breaks) else weighted_arclength(curve, axis_weights(limits))
    feeds = (REST if rests else Feed(10.0) for rests in stops)
    return Section(curve, *curve.domain, *feeds, arc, blend_start, blend_end)


def line(length=10.0):
    return NurbsCurve([[0.0, 0.0], [length, 0.0]], [0.0, 0.0, length, length], 1)


def polyline(points):
    count = len(points)
    return NurbsCurve(points, [0, *range(count), count - 1], 1)


# ---- the rest map --------------------------------------------------------------------------------------------------


def test_rest_map_is_the_integral_of_its_slope():
    section = section_of(line(), 3.0, 2.0)
    sigma = np.linspace(0.0, section.span, 301)
    y, first, _, _ = section.rest_map(sigma)
    inside = [min(s / 3.0, (section.span - s) / 2.0, 1.0) for s in sigma]
    assert first == pytest.approx([slope(r) for r in inside], abs=1e-13)
    covered = [quad(slope, 0.0, min(s / 3.0, 1.0))[0] * 3.0 + max(s - 3.0, 0.0) for s in sigma]
    left = [quad(slope, 0.0, min((section.span - s) / 2.0, 1.0))[0] * 2.0 for s in sigma]
    expected = np.where(sigma <= section.span - 2.0, covered, 10.0 - np.array(left))
    assert y == pytest.approx(expected, abs=1e-13)
    assert y[[0, -1]].tolist() == [0.0, 10.0]


def test_higher_derivatives_of_the_rest_map_are_those_of_its_slope():
    section = section_of(line(), 3.0, 2.0)
    h = 1e-3
    for lo, hi in ((0.0, 3.0), (3.0, section.span - 2.0), (section.span - 2.0, section.span)):
        sigma = np.linspace(lo, hi, 23)[1:-1]
        first = [section.rest_map(sigma + k * h)[1] for k in (-2, -1, 0, 1, 2)]
        _, _, second, third = section.rest_map(sigma)
        by_differences = (8.0 * (first[3] - first[1]) - (first[4] - first[0])) / (12.0 * h)
        assert second == pytest.approx(by_differences, abs=1e-9)
        by_differences = (16.0 * (first[3] + first[1]) - (first[4] + first[0]) - 30.0 * first[2]) / (12.0 * h**2)
        assert third == pytest.approx(by_differences, abs=1e-7)


@pytest.mark.parametrize("joint", [3.0, "end"])
def test_rest_map_joins_the_middle_with_three_continuous_derivatives(joint):
    section = section_of(line(), 3.0, 2.0)
    at = section.span - 2.0 if joint == "end" else joint
    before, after = (np.array(section.rest_map(np.array([at + d])))[:, 0] for d in (-1e-9, 1e-9))
    assert after == pytest.approx(before, abs=1e-8)
    assert before[1:] == pytest.approx([1.0, 0.0, 0.0], abs=1e-7)


def test_blends_that_meet_cover_the_whole_section():
    covered = quad(slope, 0.0, 1.0)[0]
    section = section_of(line(), 6.0 / covered, 4.0 / covered)
    assert section.span == pytest.approx(10.0 / covered, rel=1e-14)
    sigma = np.linspace(0.0, section.span, 1001)
    y, first, _, _ = section.rest_map(sigma)
    assert (np.diff(y) > 0.0).all()
    assert (first[1:-1] > 0.0).all()
    assert first[[0, -1]].tolist() == [0.0, 0.0]


WIDTHS = st.one_of(st.just(0.0), st.floats(1e-6, 0.5))


@given(WIDTHS, WIDTHS, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20), st.floats(-6, 6))
def test_inverse_of_the_rest_map(start, end, shares, decades):
    length = 10.0**decades
    section = section_of(line(length), start * length, end * length)
    y = length * np.array([0.0, 1e-12, 1e-6, *shares, 1.0])
    sigma = section.sigma(y)
    assert ((sigma >= 0.0) & (sigma <= section.span)).all()
    assert section.rest_map(sigma)[0] == pytest.approx(y, abs=4e-15 * length)
    ordered = section.sigma(np.sort(y))
    assert (np.diff(ordered) >= 0.0).all()
    assert section.sigma(np.array([0.0, length])).tolist() == [0.0, section.span]


def test_without_blends_sigma_is_the_coordinate():
    section = section_of(line())
    sigma = np.linspace(0.0, 10.0, 7)
    y, first, second, third = section.rest_map(sigma)
    assert np.array_equal(y, sigma)
    assert np.array_equal(np.stack([first, second, third]), np.outer([1.0, 0.0, 0.0], np.ones(7)))


# ---- the coordinate ------------------------------------------------------------------------------------------------


def test_weighted_arc_length_counts_axes_as_their_drives_feel_them():
    assert axis_weights(ROTARY) == pytest.approx([1.0, 1.0, 100.0])
    curve = NurbsCurve([[0, 0, 0], [3, 0, 0.04]], [0, 0, 1, 1], 1, axes=["X", "Y", "A"])
    assert weighted_arclength(curve, axis_weights(ROTARY)).total == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("acceleration", "jerk", "velocity", "weights"),
    [
        ([2.0, 4.0], [1.0, 1.0], [1.0, 1.0], [2.0, 1.0]),
        ([np.inf, 4.0], [8.0, 1.0], [1.0, 1.0], [1.0, 8.0]),
        ([np.inf, 4.0], [8.0, np.inf], [1.0, 3.0], [3.0, 1.0]),
        ([np.inf, 4.0], [8.0, np.inf], [1.0, np.inf], [1.0, 1.0]),
    ],
)
def test_weights_come_from_the_first_kind_of_limit_that_every_axis_has(acceleration, jerk, velocity, weights):
    assert axis_weights(Limits(1.0, velocity, acceleration, jerk)).tolist() == weights


@pytest.mark.parametrize("name", ["circle", "line and arc"])
def test_parameter_and_coordinate_are_inverse(name):
    curve = load_curve("circle") if name == "circle" else line_arc_line()
    section = section_of(curve)
    assert section.arc is not None
    y = np.linspace(section.y_start, section.y_end, 401)
    assert section.coordinate(section.parameter(y)) == pytest.approx(y, abs=1e-11)
    assert section.y_end - section.y_start == pytest.approx(curve.length, rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.1, 0.4])
def test_derivatives_of_the_parameter_with_respect_to_sigma(seed, share):
    curve = random_nurbs(seed, 3, 3, spans=2, repeat=2)
    length = section_of(curve, limits=ROTARY).y_end
    section = section_of(curve, share * length, 0.1 * length, limits=ROTARY)
    (at,) = section.sigma(section.coordinate(np.array([b.u for b in curve.breaks])))
    for lo, hi in ((0.0, at), (at, section.span)):
        h = 0.002 * (hi - lo)
        sigma = np.linspace(lo + 4.0 * h, hi - 4.0 * h, 41)
        for joint in (section.blend_start, section.span - section.blend_end):  # where the fourth derivative jumps
            sigma = sigma[np.abs(sigma - joint) > 4.0 * h]
        rest = section.rest_map(sigma)
        q = evaluate(curve, section.parameter(rest[0]), np.zeros(sigma.size, dtype=bool))
        found = section.parameter_derivatives(q, axis_weights(ROTARY), rest)
        u = {k: section.parameter(section.rest_map(sigma + k * h)[0]) for k in range(-3, 4)}
        first = (45 * (u[1] - u[-1]) - 9 * (u[2] - u[-2]) + u[3] - u[-3]) / (60 * h)
        second = (270 * (u[1] + u[-1]) - 27 * (u[2] + u[-2]) + 2 * (u[3] + u[-3]) - 490 * u[0]) / (180 * h**2)
        third = (-13 * (u[1] - u[-1]) + 8 * (u[2] - u[-2]) - (u[3] - u[-3])) / (8 * h**3)
        for value, expected, accuracy in zip(found, (first, second, third), (1e-5, 1e-4, 1e-2), strict=True):
            assert value == pytest.approx(expected, abs=accuracy * np.abs(expected).max())


# ---- where a path is cut -------------------------------------------------------------------------------------------


def test_a_path_stops_at_its_corners():
    sections = cut(polyline([[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]), MILL, exact_stop=False)
    assert [(s.u_start, s.u_end) for s in sections] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert all(s.start == s.end == REST and s.arc is None for s in sections)


def test_points_on_a_straight_line_are_no_corners():
    sections = cut(polyline([[0, 0], [1, 1], [4, 4], [10, 10]]), MILL, exact_stop=False)
    assert len(sections) == 1
    assert sections[0].arc is not None
    assert sections[0].jumps == ()


def test_curvature_jumps_are_passed_or_become_stops():
    curve = line_arc_line()
    (passing,) = cut(curve, MILL, exact_stop=False)
    assert [b.u for b in passing.jumps] == [1.0, 2.0]
    assert passing.arc is not None
    sections = cut(curve, MILL, exact_stop=True)
    assert [s.u_start for s in sections] == [0.0, 1.0, 2.0]
    assert not any(s.jumps for s in sections)


def test_only_the_ends_of_the_path_have_a_feed():
    curve = polyline([[0, 0], [10, 0], [10, 10], [0, 10]])
    sections = cut(curve, MILL, Feed(30.0), Feed(20.0), exact_stop=False)
    assert [(s.start, s.end) for s in sections] == [(Feed(30.0), REST), (REST, REST), (REST, Feed(20.0))]
    assert [s.has_prescribed_feed for s in sections] == [True, False, True]


def test_the_feed_at_the_seam_of_a_periodic_path_is_free():
    (section,) = cut(load_curve("circle"), MILL, FREE, FREE, exact_stop=False)
    assert section.start == section.end == FREE
    assert not section.has_prescribed_feed


def test_a_seam_that_only_the_parameter_jumps_at_is_run_by_arc_length():
    even = FormulaCurve({"X": "20*cos(2*pi*u)", "Y": "10*sin(2*pi*u)"}, (0.0, 1.0))
    uneven = FormulaCurve({"X": "20*cos(pi*(u+u**2))", "Y": "10*sin(pi*(u+u**2))"}, (0.0, 1.0))
    for curve, by_arc_length in ((even, False), (uneven, True)):
        (section,) = cut(curve, MILL, FREE, FREE, exact_stop=False)
        assert (section.arc is not None) is by_arc_length
        (section,) = cut(curve, MILL, exact_stop=False)
        assert section.arc is None


def test_the_coordinate_never_rests_while_an_axis_moves():
    xy = [[10.0 * k, 0.0] for k in range(4)] + [[30.0, 0.0]] * 5 + [[30.0, 10.0 * k] for k in range(1, 4)]
    points = np.column_stack([xy, 0.05 * np.arange(len(xy)) + 0.01 * (np.arange(len(xy)) > 6)])
    # a doubled knot, at which the rotary axis' acceleration jumps, so that the section runs by arc length
    knots = [0, 0, 0, 0, *range(1, 5), 5, 5, *range(6, len(xy) - 4), *[len(xy) - 4] * 4]
    curve = NurbsCurve(points, knots, 3, axes=["X", "Y", "A"])
    (section,) = cut(curve, ROTARY, exact_stop=False)
    assert section.arc is not None
    tip = curve.tip.arclength
    assert np.ptp(tip.s(np.linspace(4.2, 4.8, 5))) == 0.0
    y = section.coordinate(np.linspace(*curve.domain, 500))
    assert np.diff(y).min() > 0.02
    u = section.parameter(np.linspace(section.y_start, section.y_end, 500))
    assert (np.diff(u) > 0.0).all()


def test_derivatives_are_taken_from_the_side_asked_for():
    curve = line_arc_line()
    u = np.array([0.5, 1.0, 1.0, 2.0])
    left = np.array([False, True, False, True])
    q = evaluate(curve, u, left)
    for i, side in enumerate(("right", "left", "right", "left")):
        assert np.array_equal(q[:, i], curve.derivatives(u[i], 3, side=side))
    assert not np.array_equal(q[2, 1], q[2, 2])


def test_a_reserve_leaves_a_share_of_the_limits_from_each_of_its_parameters_on():
    section = replace(section_of(line()), reserve=((2.0, 0.1), (5.0, 0.25)))
    assert section.usable(np.array([0.0, 1.9, 2.0, 4.9, 5.0, 10.0])).tolist() == [1.0, 1.0, 0.9, 0.9, 0.75, 0.75]
    assert section_of(line()).usable(np.array([0.0, 10.0])).tolist() == [1.0, 1.0]
