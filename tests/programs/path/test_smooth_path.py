"""From programs to paths: durations, deviation, exact pieces, stops, and what is kept with the path."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import PROGRAMS, drives
from hypothesis import given, settings
from hypothesis import strategies as st
from program_blocks import arc, line, polyline, program, rapid

from planner import CurveError, InputError, check, plan_feedrate
from planner.geometry.chain import ChainCurve, Kind
from planner.programs.path import stretch
from planner.programs.path.deviation import deviation
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.reader import read_program

LIMITS = drives(dim=3)
PLANE = drives()


@cache
def path_of(name, tolerance):
    return separate(read_program(PROGRAMS / f"{name}.ngc"), tolerance)


def separate(source, tolerance, limits=LIMITS):
    """The path as it is made before its feed: corners, tubes, and what lies between."""
    return program_path(source, tolerance, limits, path="separate")


def brute_deviation(path, points, u, window):
    """Largest distance of the vertices of a polyline from the curve, each within a window of u, on a grid."""
    largest = 0.0
    for p, at in zip(points, u, strict=True):
        grid = np.linspace(max(at - window, 0.0), min(at + window, path.curve.domain[1]), 4001)
        away = np.sqrt(np.sum((path.curve.derivatives(grid, 0)[0] - p) ** 2, axis=1))
        largest = max(largest, float(away.min()))
    return largest


@pytest.mark.parametrize(
    ("name", "tolerance", "seconds"),
    [
        ("butterfly_5000", 1e-3, 6.66),
        ("butterfly_5000", 1e-2, 6.66),
        ("slots", 1e-2, 5.80),
        ("slots", 5e-2, 5.32),
        ("zigzag", 1e-2, 12.90),
        ("zigzag", 5e-2, 12.20),
    ],
)
def test_durations(name, tolerance, seconds):
    path = path_of(name, tolerance)
    assert path.stops == ()
    assert path.counts["joint"] == 0
    assert 0.5 * tolerance < path.deviation.largest <= tolerance
    assert path.deviation_share <= 1.0
    profile = plan_feedrate(path.curve, PLANE, intervals=path.intervals)
    assert profile.duration <= seconds
    assert check(path.curve, PLANE, profile).ok


def sawtooth(pitch, teeth, tolerance):
    """A zigzag of 135 degrees: along, up the diagonal, down again, ..."""
    points = [(0.0, 0.0), (pitch, 0.0)]
    for k in range(2, teeth + 2):
        points += [(k * pitch, pitch), (k * pitch, 0.0)]
    return separate(polyline(points, tolerance=tolerance), None, PLANE)


def assert_resolved(pitch, teeth, tolerance, *, compared=True):
    path = sawtooth(pitch, teeth, tolerance)
    plan = plan_feedrate(path.curve, PLANE)
    report = check(path.curve, PLANE, plan)
    assert report.ok, (pitch, teeth, tolerance, report)
    if compared:
        fine = plan_feedrate(path.curve, PLANE, intervals=10 * path.intervals)
        assert plan.duration <= fine.duration * (1.0 + 1e-3), (pitch, teeth, tolerance)


@pytest.mark.parametrize(
    ("pitch", "teeth", "tolerance"), [(25.4, 5, 0.01), (20.0, 5, 0.01), (5.0, 2, 0.05), (50.0, 1, 0.001)]
)
def test_corners_shorter_than_the_samples_of_the_scan_are_resolved(pitch, teeth, tolerance):
    # A cubic corner has no curvature at either end; of 70 um beside 50 mm only its ends were seen, and one interval given.
    assert_resolved(pitch, teeth, tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.001, 0.002, 0.005, 0.01, 0.02, 0.05])
@pytest.mark.parametrize("teeth", range(1, 9))
def test_every_sawtooth_is_resolved(teeth, tolerance):
    for pitch in range(5, 51):
        assert_resolved(float(pitch), teeth, tolerance, compared=teeth in {1, 4} and pitch % 3 == 2)


@pytest.mark.parametrize("tolerance", [3e-5, 1e-4, 1e-3])
def test_a_tiny_corner_between_long_legs_saves_its_closed_form(tolerance):
    """Two legs of 100 mm, 90 degrees: against an exact stop 2 (6 A / J)^(1/3), A = tolerance / sqrt 2, but for a quarter."""
    points = [(0.0, 0.0), (100.0, 0.0), (100.0, 100.0)]
    corner, stop = (separate(polyline(points, tolerance=value), None, PLANE) for value in (tolerance, 0.0))
    profile = plan_feedrate(corner.curve, PLANE)
    assert check(corner.curve, PLANE, profile).ok
    saved = plan_feedrate(stop.curve, PLANE).duration - profile.duration
    assert 0.7 <= saved / (2.0 * np.cbrt(6.0 * tolerance / np.sqrt(2.0) / 2e4)) <= 1.0


def test_deviation_of_the_butterfly_by_brute_force():
    source = read_program(PROGRAMS / "butterfly_5000.ngc")
    path = path_of("butterfly_5000", 1e-2)
    some = np.arange(3, len(source), 17)
    found = brute_deviation(path, source.end[some, :2], path.u[some + 1], 0.3)
    assert found <= 1e-2 * (1 + 1e-4)
    assert found <= path.deviation.largest + 1e-6
    assert path.deviation_line in source.line


def test_a_planted_excursion_is_found():
    """One span of the curve moved by 0.05 mm across, in its middle: its distance from the program must be seen."""
    source = read_program(PROGRAMS / "butterfly_5000.ngc")
    path = path_of("butterfly_5000", 1e-2)
    spans = path.curve.spans.copy()
    along = spans[100, :, 1] / np.hypot(*spans[100, :, 1])
    bump = np.array([0.0, 0.0, 16.0, -32.0, 16.0]) * 0.05  # flat at both ends
    spans[100] += np.outer([-along[1], along[0]], bump)
    moved = replace(path.curve, spans=spans)
    blocks = MovingBlocks.of(source, 1e-2)
    whole = deviation(path.curve, blocks.programmed, path.u, blocks.programmed.edges, 5.0, density=4)
    planted = deviation(moved, blocks.programmed, path.u, blocks.programmed.edges, 5.0, density=4)
    assert whole.largest <= 1e-2
    assert planted.largest > 3e-2
    place = path.curve.edges[np.flatnonzero(path.curve.kind == Kind.SPAN)[100]]
    assert abs(np.interp(planted.abscissa, blocks.programmed.edges, path.u) - place) < 5.0


def test_full_circle_stays_exact():
    path = separate(program(arc((0, 0), (0, 5), 1)), 0.01, PLANE)
    u = np.linspace(*path.curve.domain, 101)
    d = path.curve.derivatives(u)
    assert path.curve.domain[1] == pytest.approx(10.0 * np.pi, rel=1e-14)
    assert np.abs(np.hypot(d[0, :, 0], d[0, :, 1] - 5.0) - 5.0).max() < 1e-13
    assert np.abs(path.curve.curvature(u) - 0.2).max() < 1e-13
    assert path.deviation.largest == 0.0
    assert path.curve.breaks == ()


def test_helix_is_exact_and_its_third_axis_linear():
    path = separate(program(arc((0, 20, 3), (0, 10), -1)), 0.01, LIMITS)
    length = np.hypot(10.0 * np.pi, 3.0)
    u = np.linspace(0.0, path.curve.domain[1], 51)
    d = path.curve.derivatives(u)
    assert path.curve.domain[1] == pytest.approx(length, rel=1e-14)
    assert np.abs(d[0, :, 2] - 3.0 * u / length).max() < 1e-13
    assert np.abs(np.hypot(d[0, :, 0], d[0, :, 1] - 10.0) - 10.0).max() < 1e-13
    assert d[0, 25, 0] < 0.0  # clockwise from (0, 0) around (0, 10)
    assert np.abs(np.sum(d[1] ** 2, axis=1) - 1.0).max() < 1e-14


def test_spiral_meets_both_ends():
    path = separate(program(arc((0, 10.004), (0, 5), 1)), 0.01, PLANE)
    ends = path.curve.derivatives(np.array(path.curve.domain), 0)[0]
    assert np.abs(ends - [[0.0, 0.0], [0.0, 10.004]]).max() < 1e-13


def test_arcs_of_all_planes():
    for normal, end, centre in (
        (2, (10, 10, 0), (0, 10, 0)),
        (1, (10, 0, 10), (0, 0, 10)),
        (0, (0, 10, 10), (0, 10, 0)),
    ):
        for turns in (1, -1):
            path = separate(program(arc(end, centre, turns, normal=normal)), 0.01, LIMITS)
            u = np.array(path.curve.domain)
            kept = [("X", "Y", "Z").index(axis) for axis in path.curve.axes]
            assert np.abs(path.curve.derivatives(u, 0)[0] - np.array([(0, 0, 0), end])[:, kept]).max() < 1e-12
            middle = path.curve.derivatives(np.linspace(*u, 9), 0)[0] - np.array(centre, dtype=float)[kept]
            assert np.ptp(np.sqrt(np.sum(middle**2, axis=1))) < 1e-12


def mixed():
    return program(
        rapid(0, 0, 5),
        line(0, 0, 0),
        line(20, 0, 0),
        arc((20, 10, 0), (20, 5, 0), 1),
        line(10, 10, 0, feed=25.0),
        line(10, 30, 0, feed=25.0),
        arc((20, 30, -2), (15, 30, 0), -1, stop=True),
        line(40, 30, -2),
        line(20, 30, -2),
        start=(0, 0, 6),
    )


def test_mixed_program_in_space():
    path = separate(mixed(), 0.02)
    reasons = {stop.line: stop.reason for stop in path.stops}
    assert set(reasons) == {1, 7, 8}
    assert "rapid" in reasons[1]
    assert "demanded" in reasons[7]
    assert "180" in reasons[8]
    corner_breaks = [b.u for b in path.curve.breaks if b.geometric == 0]
    assert corner_breaks == pytest.approx([stop.u for stop in path.stops])
    assert all(b.parametric >= 2 for b in path.curve.breaks if b.geometric > 0)
    caps = path.curve.feed_caps
    assert caps.feed.tolist() == [np.inf, 100.0, 25.0, 100.0]
    assert (caps.edges[0], caps.edges[-1]) == path.curve.domain
    assert caps.edges[2] == path.u[4]
    assert np.isin(caps.edges[1:-1], path.curve._candidate_breaks()).all()
    assert path.deviation.largest <= 0.02
    profile = plan_feedrate(path.curve, LIMITS)
    assert check(path.curve, LIMITS, profile).ok
    for stop in path.stops:
        assert profile.feed[np.abs(profile.u - stop.u) < 1e-9].min() == 0.0


def test_pieces_for_compiled_code_agree_with_the_curve():
    path = separate(mixed(), 0.02)
    u = np.linspace(*path.curve.domain, 3001)
    for left in (False, True):
        exact = path.curve.derivatives(u, 3, side="left" if left else "right")
        found = path.curve.pieces.evaluate(u, 3, left)
        largest = np.abs(exact).max(axis=(1, 2))
        assert (np.abs(found - exact).max(axis=(1, 2)) < np.array([1e-13, 1e-9, 1e-7, 1e-4]) * largest).all()


def test_chain_derivatives_agree_with_differences():
    path = separate(mixed(), 0.02)
    edges = path.curve.edges
    u = (0.5 * (edges[1:] + edges[:-1]))[:, None] + 1e-4 * np.diff(edges)[:, None] * np.array([-1, 0, 1])
    d = path.curve.derivatives(u)
    h = (u[:, 2] - u[:, 0])[:, None]
    for k in range(3):
        slope = (d[k, :, 2] - d[k, :, 0]) / h
        size = np.abs(d[k + 1]).max() + np.abs(d[k]).max() * 1e-11 / h
        assert (np.abs(slope - d[k + 1, :, 1]) < 1e-4 * size).all()


def test_vertices_keep_their_parameter():
    path = path_of("zigzag", 5e-2)
    source = read_program(PROGRAMS / "zigzag.ngc")
    at = path.curve.derivatives(path.u, 0)[0]
    points = np.concatenate([source.start[:1], source.end])[-path.u.size :, :2]
    away = np.sqrt(np.sum((at - points) ** 2, axis=1))
    assert away[[0, -1]].max() < 1e-12
    assert away[1:-1] == pytest.approx(0.05, rel=1e-6)
    assert (np.diff(path.u) > 0.0).all()


def test_exact_stop_mode_has_no_tolerance():
    moves = [line(10, 0, tolerance=0.0), line(10, 10, tolerance=0.0), line(20, 11, tolerance=0.0)]
    path = program_path(program(*moves), 0.05, PLANE)
    assert [stop.line for stop in path.stops] == [1, 2]
    assert path.deviation.largest == 0.0


def test_tolerance_of_the_program_and_of_the_caller():
    moves = program(line(20, 0), line(20, 20), tolerance=0.05)
    assert program_path(moves, None, PLANE).deviation.largest == pytest.approx(0.05, rel=1e-3)
    assert program_path(moves, 0.002, PLANE).deviation.largest == pytest.approx(0.002, rel=1e-3)
    default = program_path(program(line(20, 0), line(20, 20)), None, PLANE)
    assert default.deviation.largest == pytest.approx(0.01, rel=1e-3)


def test_noise_larger_than_the_tolerance_is_named():
    angle = np.linspace(0.0, 3.0, 600)
    points = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    noisy = points + np.random.default_rng(5).uniform(-0.002, 0.002, points.shape)
    assert any("noise" in note for note in separate(polyline(noisy), 0.003, PLANE).notes)
    assert not separate(polyline(noisy), 0.02, PLANE).notes


def test_windows_lose_next_to_nothing(monkeypatch):
    """Joined windows are as smooth, as close and as fast as one solve (within 0.2 %)."""
    whole = path_of("butterfly_5000", 1e-3)
    monkeypatch.setattr(stretch, "WINDOW", 500)
    parts = separate(read_program(PROGRAMS / "butterfly_5000.ngc"), 1e-3)
    assert parts.deviation.largest <= 1e-3
    assert all(b.parametric >= 2 for b in parts.curve.breaks)
    times = [plan_feedrate(p.curve, PLANE, intervals=4000).duration for p in (whole, parts)]
    assert times[1] <= 1.002 * times[0]


@settings(max_examples=10)
@given(st.integers(0, 10_000), st.sampled_from([0.002, 0.02, 0.2]), st.integers(2, 3))
def test_random_polylines_keep_their_tolerance(seed, tolerance, dim):
    rng = np.random.default_rng(seed)
    turn = rng.choice([0.02, 0.2, 1.0, 3.0], 30)[:, None] * rng.normal(size=(30, dim))
    direction = np.cumsum(turn, axis=0) * 0.3 + rng.normal(size=dim)
    step = rng.choice([0.02, 0.5, 8.0], 30)[:, None] * direction / np.sqrt(np.sum(direction**2, axis=1))[:, None]
    points = np.concatenate([np.zeros((1, dim)), np.cumsum(step, axis=0)])
    path = program_path(polyline(points), tolerance, LIMITS)
    assert path.deviation_share <= 1.0
    assert all(b.geometric >= 2 or b.u in path.curve.stops for b in path.curve.breaks)
    where = [axis in path.curve.axes for axis in ("X", "Y", "Z")][:dim]
    assert brute_deviation(path, points[:, where], path.u, 6.0 * tolerance + 0.5) <= tolerance + 0.02 * (
        tolerance + 0.5
    )
    assert np.abs(path.curve.derivatives(path.u[[0, -1]], 0)[0] - points[[0, -1]][:, where]).max() < 1e-9


class TestBadInput:
    def test_tolerance(self):
        for tolerance in (0.0, -1.0, np.nan, np.inf):
            with pytest.raises(InputError, match="tolerance"):
                program_path(program(line(1, 1)), tolerance, PLANE)

    def test_axis_that_the_machine_lacks(self):
        with pytest.raises(InputError, match="axis Z"):
            program_path(program(line(1, 1, 1)), 0.01, PLANE)

    def test_piece_without_length(self):
        curve = path_of("zigzag", 5e-2).curve
        edges = curve.edges.copy()
        edges[3] = edges[2]
        with pytest.raises(CurveError, match="piece 2 has no length"):
            replace(curve, edges=edges)

    def test_program_that_moves_nothing(self):
        nothing = program(line(0, 0))
        with pytest.raises(CurveError, match="moves nothing"):
            program_path(nothing, 0.01, PLANE)

    def test_chain_is_a_curve_with_names(self):
        curve = path_of("slots", 5e-2).curve
        assert isinstance(curve, ChainCurve)
        assert curve.axes == ("X", "Y")
        assert curve.fingerprint != path_of("slots", 1e-2).curve.fingerprint
        assert curve.length == pytest.approx(curve.domain[1], rel=2e-3)


def test_a_tube_ends_where_the_exact_mode_begins():
    """A block of 10 nm under G61 goes straight on from one that a tube was led through."""
    points = [(4.98141, 2.03765), (4.9813, 2.02975), (4.9813, 2.02811), (4.9813, 2.0281)]
    moves = [line(*point, tolerance=0.01) for point in points[:-1]] + [line(*points[-1], tolerance=0.0, stop=True)]
    path = program_path(program(*moves), None, PLANE)
    assert path.deviation_share <= 1.0
    profile = plan_feedrate(path.curve, PLANE)
    assert check(path.curve, PLANE, profile).ok


def test_a_tube_has_the_tolerance_of_each_block():
    """Where one block may be left by little, the path keeps to it there, and uses what the others allow."""
    angle = np.linspace(0.0, np.pi, 121)
    x, y = 5.0 - 5.0 * np.cos(angle), 3.0 * np.sin(angle)
    tight, wide = 0.001, 0.02
    narrow = {58, 59, 60, 61}
    moves = [
        line(a, b, tolerance=tight if k in narrow else wide) for k, (a, b) in enumerate(zip(x[1:], y[1:], strict=True))
    ]
    path = program_path(program(*moves, start=(x[0], y[0], 0.0)), None, LIMITS, path="separate")
    assert path.counts["tubes"] == 1
    u = np.linspace(*path.curve.domain, 40_001)
    points = path.curve.derivatives(u, 0)[0][:, :2]
    block = np.clip(np.searchsorted(path.u, u, side="right") - 1, 0, len(moves) - 1)
    vertex = np.column_stack([x, y])
    away = np.full(u.size, np.inf)
    for k in range(-2, 3):
        near = np.clip(block + k, 0, len(moves) - 1)
        chord = vertex[near + 1] - vertex[near]
        along = np.clip(np.sum((points - vertex[near]) * chord, axis=1) / np.sum(chord**2, axis=1), 0.0, 1.0)
        away = np.minimum(away, np.hypot(*(points - vertex[near] - along[:, None] * chord).T))
    inside = np.isin(block, list(narrow))
    assert away[inside].max() <= tight
    assert 0.9 * wide < away[~inside].max() <= wide
    assert path.deviation_share <= 1.0


@pytest.mark.parametrize("back", [False, True])
def test_the_share_of_a_tube_is_the_least_within_the_slip(back):
    edges, share = np.array([0.0, 1.0, 1.1, 3.0]), np.array([1.0, 0.5, 0.8])
    s = np.array([0.0, 0.55, 0.65, 1.0, 1.05, 1.45, 1.55, 3.0])
    expected = np.array([1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.8, 0.8])
    if back:
        edges, share, s = 3.0 - edges[::-1], share[::-1], 3.0 - s
    none = np.empty(0)
    tube = stretch.Stretch(0.0, 3.0, (True, True), none, none, none.astype(bool), none, none, 0.2, edges, share)
    np.testing.assert_array_equal(tube.share_at(s), expected)
