"""Chords of a curve are told from corners, and their curvature is that of the curve, wherever they begin and end."""

import numpy as np
import pytest

from planner.geometry.blend import Legs
from planner.programs.path.chord_curvature import curvature_of_chords
from planner.programs.path.deviation import Programmed
from planner.programs.path.tube_knots import place, spacing_at

TOLERANCE = 0.01


def lines(points):
    vectors = np.diff(points, axis=0)
    length = np.sqrt(np.sum(vectors**2, axis=1))
    frame = np.zeros((length.size, 4, points.shape[1]))
    return Programmed(
        np.concatenate([[0.0], np.cumsum(length)]), legs_of(points[:-1], vectors / length[:, None], frame)
    )


def legs_of(start, along, frame):
    frame[:, 0], frame[:, 3] = start, along
    return Legs(frame, np.zeros((start.shape[0], 2)))


def chords_of_circle(radius, seed, least=0.2, most=0.9, total=60.0):
    """Points on a circle, at random distances along it, mm."""
    rng = np.random.default_rng(seed)
    s = np.concatenate([[0.0], np.cumsum(rng.uniform(least, most, int(total / least)))])
    s = s[s < total]
    return radius * np.column_stack([np.cos(s / radius), np.sin(s / radius), 0.0 * s])


def turns(programmed):
    direction = programmed.legs.at(np.arange(programmed.edges.size - 1), np.zeros(programmed.edges.size - 1))[1]
    return 2.0 * np.arcsin(0.5 * np.sqrt(np.sum(np.diff(direction, axis=0) ** 2, axis=1)))


def curvature(points, smooth=None):
    programmed = lines(points)
    turn = turns(programmed)
    smooth = np.ones(turn.size, dtype=bool) if smooth is None else smooth
    return programmed, turn, curvature_of_chords(programmed, smooth, turn, np.full(turn.size, TOLERANCE))


@pytest.mark.parametrize("radius", [5.0, 10.0, 40.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_curvature_behind_chords_of_a_circle(radius, seed):
    longest = min(0.9, 0.99 * np.sqrt(8.0 * TOLERANCE * radius))
    _, _, (found, chords) = curvature(chords_of_circle(radius, seed, most=longest))
    assert chords.all()
    # from the middle of one chord to that of another: exact on a circle, but for chord against arc
    np.testing.assert_allclose(found, 1.0 / radius, rtol=longest**2 / radius**2 / 24.0)


def test_rounding_of_short_blocks_hardly_bends_them():
    points = np.round(chords_of_circle(10.0, 1, 0.04, 0.06, total=10.0), 4)
    _, turn, (found, chords) = curvature(points)
    assert chords.all()
    assert np.ptp(turn / 0.05) > 0.03  # of neighbouring blocks alone
    np.testing.assert_allclose(found, 0.1, atol=0.02)


def test_no_curvature_across_a_corner_or_where_the_curve_would_leave_the_tolerance():
    one = chords_of_circle(10.0, 2)
    points = np.concatenate([one, one[-1] + np.array([[-3.0, 0.0, 0.0], [-6.0, 0.1, 0.0], [-26.0, 0.2, 0.0]])])
    turn = curvature(points)[1]
    smooth = turn < 0.2
    assert not smooth.all()
    _, _, (found, chords) = curvature(points, smooth)
    np.testing.assert_allclose(found[: one.shape[0] - 2], 0.1, rtol=0.01)
    # the last junction turns by 0.03 rad between blocks of 3 and 20 mm: a curve there would be 40 um off
    assert not chords[-1]
    assert (found[~chords] == 0.0).all()


def wave(seed, begin, end):
    """Chords of one wave along X at random places, from and up to any X."""
    rng = np.random.default_rng(seed)
    x = begin + np.cumsum(rng.uniform(0.1, 0.5, 400))
    x = np.concatenate([[begin], x[x < end - 0.1], [end]])
    return np.column_stack([x, np.full(x.size, float(seed)), 2.0 * np.sin(2.0 * np.pi * x / 20.0)])


def knots_along_x(points):
    programmed, turn, (found, chords) = curvature(points)
    spacing = spacing_at(turn, 0.0 * turn, 0.0 * turn, found, np.full(turn.size, TOLERANCE))
    s = programmed.edges
    knots = place(0.0, s[-1], s[1:-1], spacing, np.empty(0), chords, lambda at: programmed.at(at)[0])
    assert (np.diff(knots) > 0.0).all()
    return np.interp(knots, s, points[:, 0]), knots


def test_passes_share_their_knots_whatever_their_chords_and_ends():
    ends = ((0.0, 60.0), (0.03, 59.0), (-1.7, 61.3), (0.111, 60.2))
    every = [knots_along_x(wave(seed, *some))[0] for seed, some in enumerate(ends)]
    inner = [x[(x > 4.0) & (x < 55.0)] for x in every]
    for x in inner[1:]:
        shared = np.abs(x[:, None] - inner[0]).min(axis=1) < 1e-9
        assert shared.mean() > 0.9
        assert abs(x.size - inner[0].size) <= 0.1 * x.size
    # knots at even places of passes of other lengths are shared by chance alone
    even = [np.linspace(*some, 240) for some in ends]
    assert (np.abs(even[1][:, None] - even[0]).min(axis=1) < 1e-9).mean() < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_the_way_back_has_the_same_knots(seed):
    points = wave(seed, 0.0, 60.0)
    forth, back = knots_along_x(points), knots_along_x(points[::-1])
    np.testing.assert_allclose(back[1][-1] - back[1][::-1], forth[1], atol=1e-9)


@pytest.mark.parametrize("turned", [0.0, 0.7, np.pi / 2])
def test_all_around_a_circle_the_spacing_is_about_what_is_wanted(turned):
    points = chords_of_circle(10.0, 0)
    c, s = np.cos(turned), np.sin(turned)
    _, knots = knots_along_x(points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    wanted = 0.3 * np.sqrt(8.0 * TOLERANCE * 10.0)
    inner = np.diff(knots)[5:-5]
    assert inner.min() > 0.35 * wanted
    assert inner.max() < 2.2 * wanted
    assert inner.mean() == pytest.approx(wanted, rel=0.35)
