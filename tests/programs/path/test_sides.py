"""One side alone: what the path may not pass, the measure that tells, and what has no such side."""

from dataclasses import replace

import numpy as np
import pytest
from cases import drives
from program_blocks import arc, line, polyline, program, rapid

from planner import check, plan_feedrate
from planner.errors import InputError
from planner.joint import solve
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.sides import overcut, samples, sides_of
from planner.programs.path.smooth_path import program_path

LIMITS = drives(dim=3, axes=("X", "Y", "Z"))
TOLERANCE = 0.01
SQUARE = [[5, 0], [10, 0], [10, 10], [0, 10], [0, 0], [5, 0]]
TRIANGLE = [[5, 0], [10, 0], [5, 8], [0, 0], [5, 0]]
REFLEX = [[5, 0], [20, 0], [20, 10], [10, 10], [10, 20], [0, 20], [0, 0], [5, 0]]
CONTOURS = [SQUARE, TRIANGLE, REFLEX, SQUARE[::-1], TRIANGLE[::-1], REFLEX[::-1]]


def farthest(path, points):
    """How far a path goes to the left and to the right of a polygon that ends where it begins, and does not cross itself.

    By the number of times that the polygon goes around a point, which shares nothing with what is tested.
    """
    at = path.curve.derivatives(samples(path.curve.edges), 0)[0, :, :2]
    corners = np.array(points, dtype=float)
    step = np.diff(corners, axis=0)
    share = np.clip(((at[:, None] - corners[:-1]) * step).sum(-1) / (step**2).sum(-1), 0.0, 1.0)
    distance = np.linalg.norm(at[:, None] - corners[:-1] - share[..., None] * step, axis=-1).min(axis=1)
    angle = np.arctan2(*np.moveaxis(corners - at[:, None], -1, 0)[::-1])
    around = (np.mod(np.diff(angle, axis=1) + np.pi, 2.0 * np.pi) - np.pi).sum(axis=1)
    inside = np.abs(around) > np.pi
    return distance[inside].max(initial=0.0), distance[~inside].max(initial=0.0)


@pytest.mark.parametrize("points", CONTOURS)
@pytest.mark.parametrize("side", ["inside", "outside"])
def test_a_contour_is_left_to_one_side_alone(points, side):
    path = program_path(polyline(points), TOLERANCE, LIMITS, side=side)
    assert path.counts["joint"] == 1
    assert path.stops == ()
    assert path.overcut <= 1e-9
    within, beyond = farthest(path, points)[:: 1 if side == "inside" else -1]
    assert beyond <= 1e-9
    assert 0.9 * TOLERANCE < within <= TOLERANCE
    own = LIMITS.for_curve(path.curve)
    profile = plan_feedrate(path.curve, own)
    assert check(path.curve, own, profile).ok
    both, exact = (program_path(polyline(points), TOLERANCE, LIMITS), program_path(polyline(points), 1e-9, LIMITS))
    fast, slow = (plan_feedrate(other.curve, own).duration for other in (both, exact))
    assert fast < profile.duration < slow


@pytest.mark.parametrize("points", CONTOURS)
def test_the_measure_finds_what_both_sides_take(points):
    """A path that may go to both sides goes to either by nearly all of the tolerance, and the measure says by how much."""
    source = polyline(points)
    path = program_path(source, TOLERANCE, LIMITS)
    given = MovingBlocks.of(source, TOLERANCE)
    u = samples(path.curve.edges)
    s = np.interp(u, path.u, given.programmed.edges)
    at = given.programmed.of_curve(path.curve, u, 0)[0]
    found = [
        overcut(sides_of(given, side, source.line, "it"), given.programmed, at, s, TOLERANCE)
        for side in ("outside", "inside")
    ]
    np.testing.assert_allclose(found, farthest(path, points), rtol=1e-9)
    assert min(found) > 0.5 * TOLERANCE


def test_a_solver_that_takes_the_other_side_is_found_out(monkeypatch):
    monkeypatch.setattr(solve, "_walls", lambda run, walls=solve._walls: walls(replace(run, side=-run.side)))
    path = program_path(polyline(SQUARE), TOLERANCE, LIMITS, side="inside")
    assert path.counts["joint"] == 0
    assert path.deviation.largest == 0.0
    assert len(path.stops) == 4
    assert path.notes == (
        "the path is exact, with stops at its corners: it would pass to the other side, by more than 0.001 of the tolerance",
    )


def test_left_and_right_are_those_of_the_motion():
    times = {}
    for side in ("left", "right", "inside", "outside"):
        path = program_path(polyline(SQUARE), TOLERANCE, LIMITS, side=side)
        times[side] = plan_feedrate(path.curve, LIMITS.for_curve(path.curve)).duration
    assert times["left"] == times["inside"] != times["right"] == times["outside"]


def test_moves_across_the_plane_and_rapids_are_exact():
    moves = [rapid(5, 0), line(5, 0, -2), *(line(x, y, -2) for x, y in SQUARE[1:]), line(5, 0, 3), rapid(9, 9, 3)]
    path = program_path(program(*moves), TOLERANCE, LIMITS, side="inside")
    assert path.overcut <= 1e-9
    assert [stop.reason for stop in path.stops] == [
        "beside a rapid",
        "beside a move that has no sides",
        "beside a move that has no sides",
        "beside a rapid",
    ]
    assert path.counts["joint"] == path.counts["runs"] == 5


def test_arcs_are_exact():
    moves = [line(10, 0), arc((10, 10), (10, 5), 1), line(0, 10), arc((0, 0), (0, 5), 1), line(5, 0)]
    path = program_path(program(*moves, start=(5, 0)), TOLERANCE, LIMITS, side="inside")
    assert path.deviation.largest <= 1e-9
    assert path.overcut == 0.0
    assert "arcs" in path.notes[0]


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0, 0], [10, 0], [10, 10]], "lines 1 to 2 do not end where they begin, and have no inside"),
        ([[0, 0], [10, 10], [10, 0], [0, 10], [0, 0]], "lines 1 to 4 turn by 0 degrees in all"),
        ([[0, 0], [10, 0], [0, 0]], "after line 1 the contour turns back, and has no inside"),
    ],
)
def test_what_has_no_inside_is_refused(points, message):
    with pytest.raises(InputError, match=message):
        program_path(polyline(points), TOLERANCE, LIMITS, side="inside")
    program_path(polyline(points), TOLERANCE, LIMITS, side="left")


def test_what_no_path_can_be_made_for_is_refused():
    with pytest.raises(InputError, match="must be one of both, left, right, inside, outside"):
        program_path(polyline(SQUARE), TOLERANCE, LIMITS, side="in")
    with pytest.raises(InputError, match="is for path = 'joint'; a separate path cuts corners inside"):
        program_path(polyline(SQUARE), TOLERANCE, LIMITS, side="inside", path="separate")
