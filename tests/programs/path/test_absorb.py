"""Blocks inside the tolerance: absorbed, and at no cost; what may not be absorbed is not."""

from functools import cache

import numpy as np
import path_reference as reference
import pytest
from cases import drives
from program_blocks import arc, line, polyline, program, rapid

from planner import SolverError, check, plan_feedrate
from planner.compiled import core
from planner.programs.long.windows import plan_program
from planner.programs.path import absorb as absorbing
from planner.programs.path.absorb import absorb
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.smooth_path import program_path
from planner.programs.times import line_times

LIMITS = drives(50.0, dim=3)
PLANE = drives(50.0)
LEG = 10.0
ANGLES = (10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0, 150.0, 160.0, 170.0)
LENGTHS = 10.0 ** np.linspace(-7.0, 0.0, 22)
TOLERANCES = (0.001, 0.01, 0.05)


def planned(source, tolerance, limits=LIMITS):
    """The path of a program and the duration of its plan, which must pass its check."""
    path = program_path(source, tolerance, limits, path="separate")
    own = limits.for_curve(path.curve)
    profile = plan_feedrate(path.curve, own, intervals=path.intervals)
    report = check(path.curve, own, profile)
    assert report.ok, report.violations
    assert path.deviation_share <= 1.0
    return path, profile


def corner(angle, length=0.0, place="none"):
    """Points of a corner between two legs, with a block of some length before it, after it, on both sides, or across."""
    a = np.deg2rad(angle)
    t1, t2, mean = np.array([1.0, 0.0]), np.array([np.cos(a), np.sin(a)]), np.array([np.cos(0.5 * a), np.sin(0.5 * a)])
    vertex = LEG * t1
    inner = {
        "none": [vertex],
        "before": [vertex - length * t1, vertex],
        "after": [vertex, vertex + length * t2],
        "both": [vertex - length * t1, vertex, vertex + length * t2],
        "oblique": [vertex, vertex + length * mean],
        "back": [vertex, vertex - length * t1, vertex],
    }[place]
    return np.array([[0.0, 0.0], *inner, vertex + LEG * t2])


@cache
def corner_alone(angle, tolerance):
    return planned(polyline(corner(angle)), tolerance)[1].duration


def assert_costs_nothing(angle, tolerance, length, place):
    duration = planned(polyline(corner(angle, length, place)), tolerance)[1].duration
    assert duration <= corner_alone(angle, tolerance) * (1.0 + 1e-3), (angle, tolerance, length, place)


@pytest.mark.parametrize("seed", range(12))
def test_a_short_block_beside_a_corner_costs_nothing(seed):
    rng = np.random.default_rng(seed)
    angle, tolerance = float(rng.choice(ANGLES)), float(rng.choice(TOLERANCES))
    place = str(rng.choice(["before", "after", "both"]))
    assert_costs_nothing(angle, tolerance, float(rng.choice(LENGTHS)), place)


@pytest.mark.parametrize("length", [2e-3, 5e-3, 1e-2, 1.4e-2])
def test_short_blocks_that_go_on_straight_beside_a_bend_cost_nothing(length):
    """They made the bend look like a curve of short chords, of a radius of micrometres."""
    assert_costs_nothing(10.0, 0.01, length, "both")


@pytest.mark.slow
@pytest.mark.parametrize("place", ["before", "after", "both"])
@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("angle", ANGLES)
def test_no_short_block_beside_a_corner_costs_anything(angle, tolerance, place):
    for length in LENGTHS:
        assert_costs_nothing(angle, tolerance, float(length), place)


@pytest.mark.parametrize("place", ["oblique", "back"])
@pytest.mark.parametrize("angle", [10.0, 30.0, 90.0, 135.0, 160.0])
def test_a_tiny_block_across_a_corner_costs_nothing(angle, place):
    """Up to a tenth of the tolerance, but for a step aside in a bend of a tube, which is the program's own geometry."""
    for length in (1e-7, 1e-6, 1e-5, 1e-4, 1e-3):
        if (angle, place, length) != (10.0, "oblique", 1e-3):
            assert_costs_nothing(angle, 0.01, length, place)


@pytest.mark.parametrize("angle", [60.0, 90.0, 120.0])
@pytest.mark.parametrize("place", ["oblique", "back"])
def test_a_block_across_a_corner_of_half_the_tolerance_costs_little(angle, place):
    """A spike must be kept within the tolerance: at 90 degrees that leaves the corner 0.58 of its size."""
    path, profile = planned(polyline(corner(angle, 5e-3, place)), 0.01)
    assert profile.duration <= corner_alone(angle, 0.01) * (1.0 + 8e-3)
    assert path.counts["corners"] == 1
    assert path.deviation_share > 0.99


def exact_room(offset, tolerance):
    """How far the apex of a corner of 90 degrees may be from its vertex, with a spike ahead: its tip sets it, by mpmath."""
    import mpmath

    def to_tip(apex):
        size = apex / mpmath.sqrt(2)  # q = A ((1 + t)^3 j - (1 - t)^3 i) from the vertex

        def away(t):
            return mpmath.hypot(-size * (1 - t) ** 3 - offset, size * (1 + t) ** 3)

        return min(away(mpmath.mpf(k) / 1000 - 1) for k in range(2001))

    return float(
        mpmath.findroot(lambda apex: to_tip(apex) - tolerance, (0.3 * tolerance, tolerance), solver="anderson")
    )


@pytest.mark.parametrize("length", [1e-3, 3e-3, 6e-3])
def test_a_corner_is_as_large_as_the_tip_of_a_spike_allows(length):
    """Sized by measurement: not below what the geometry allows by more than its margin, and never above."""
    from planner.programs.path.corner_sizes import rooms

    legs = polyline([(0.0, 0.0), (LEG, 0.0), (LEG, LEG)])
    written = polyline([(0.0, 0.0), (LEG + length, 0.0), (LEG, 0.0), (LEG, LEG)])
    some, given = (MovingBlocks.of(source, 0.01).programmed for source in (legs, written))
    place = np.array([0.0, LEG, LEG, 2.0 * LEG])
    own, left = np.full(2, 0.01), np.full(2, 1e-4)
    found = rooms(some, given, place, own, left, np.array([False]))[0]
    wanted = exact_room(length, 0.01)
    assert 0.99 * wanted <= found <= wanted


@pytest.mark.parametrize("seed", range(4))
def test_dust_of_the_size_of_the_tolerance_is_absorbed(seed):
    """Around a winding path, against the same path without: dust of up to 10 um at 10 um costs a part of the smoothing."""
    rng = np.random.default_rng(seed)
    at, heading, clean, dusty = np.zeros(2), 0.0, [np.zeros(2)], [np.zeros(2)]
    for _ in range(15):
        heading += rng.choice([0.5, 1.5, -1.5])
        at = at + rng.uniform(1.0, 3.0) * np.array([np.cos(heading), np.sin(heading)])
        clean.append(at)
        dusty += [at + 10.0 ** rng.uniform(-4.0, -2.5) * rng.normal(size=2) for _ in range(rng.integers(1, 6))]
    found, wanted = (planned(polyline(points), 0.01, PLANE)[1].duration for points in (dusty, clean))
    assert found <= 1.07 * wanted


def test_where_what_was_measured_misleads_the_path_does_without(monkeypatch):
    source = polyline(corner(90.0, 5e-3, "back"))
    monkeypatch.setattr(absorbing, "rooms", lambda *given: np.full(given[3].size - 1, 0.02))
    path, _ = planned(source, 0.01)
    assert path.deviation_share <= 1.0


def rounded(points, digits=6):
    return np.round(np.array(points, dtype=float), digits)


def test_zigzag_of_a_nanometre_beside_corners():
    """The blocks as a drawing with doubled points gives them, against the same path without."""
    noise = [(10.0 + 3e-6 * k, 2e-6 * (k % 2)) for k in range(1, 8)]
    points = [(0, 0), (10, 0), *noise, (20, 0), (20, 10), (20.00001, 10), (30, 10)]
    path, profile = planned(polyline(points), 0.01)
    plain = planned(polyline([(0, 0), (20, 0), (20, 10), (30, 10)]), 0.01)[1]
    assert profile.duration <= plain.duration * (1.0 + 1e-3)
    assert path.counts["absorbed"] == 8
    assert any("8 blocks of at most" in note for note in path.notes)
    assert path.line.size == path.u.size - 1 == len(points) - 1


@pytest.mark.parametrize("amplitude", [1e-6, 1e-4, 1e-3, 4e-3])
@pytest.mark.parametrize("pitch", [1e-6, 1e-3, 1e-2])
def test_zigzag_within_the_tolerance_is_a_line(amplitude, pitch):
    x = 10.0 + pitch * np.arange(200)
    points = np.column_stack([x, amplitude * (-1.0) ** np.arange(200)])
    profile = planned(polyline([(0.0, 0.0), *points, (20.0, 0.0)]), 0.01)[1]
    assert profile.duration <= 0.5 * (1.0 + 1e-3)  # of the line: (20 mm, 50 mm/s) + 0.05 + 0.05 s


@pytest.mark.parametrize("size", [1e-6, 1e-5, 1e-4])
def test_jitter_and_retraces_at_a_corner(size):
    rng = np.random.default_rng(7)
    around = np.array([LEG, 0.0]) + size * rng.uniform(-1.0, 1.0, (300, 2))
    points = [(0.0, 0.0), (LEG, 0.0), *around, (LEG, LEG)]
    assert planned(polyline(points), 0.01)[1].duration <= corner_alone(90.0, 0.01) * (1.0 + 1e-3)


@pytest.mark.parametrize("size", [1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("form", ["arc", "circle", "helix", "line between arcs"])
def test_tiny_blocks_of_other_forms(size, form):
    d, x = size, LEG
    if form == "line between arcs":
        with_it = [arc((x, x), (0, x), 1), line(x + d, x), arc((2 * x + d, 2 * x), (2 * x + d, x), -1)]
        without = [arc((x, x), (0, x), 1), arc((2 * x, 2 * x), (2 * x, x), -1)]
    else:
        middle = {
            "arc": [arc((x + d, d), (x, d), 1), line(x + d, x)],
            "circle": [arc((x, 0), (x, d), 1), line(x, x)],
            "helix": [arc((x + d, d, d), (x, d, 0), 1), line(x + d, x, d)],
        }[form]
        with_it, without = [line(x, 0), *middle], [line(x, 0), line(x, x)]
    found, wanted = (planned(program(*moves), 0.01)[1].duration for moves in (with_it, without))
    assert found <= wanted * (1.0 + 1e-3)


def test_distance_is_measured_against_the_blocks_as_written(monkeypatch):
    """Absorbing more than the tolerance must be seen by the measure, which knows nothing of absorption."""
    monkeypatch.setattr(absorbing, "_SHARES", (4.0,))
    monkeypatch.setattr(
        absorbing.Absorbed, "__post_init__", lambda self: self.program.tolerance.setflags(write=True), raising=False
    )
    x = np.arange(60)
    points = np.column_stack([10.0 + 0.01 * x, 0.02 * (x % 2)])
    source = polyline([(0.0, 0.0), *points, (20.0, 0.0)])
    blocks = MovingBlocks.of(source, 0.01)
    assert absorb(source, blocks).largest > 0.01
    with pytest.raises(SolverError, match="leaves the tolerance"):
        program_path(source, 0.01, LIMITS)


def steps_of_all_sizes(seed):
    rng = np.random.default_rng(seed)
    step = rng.choice([1e-5, 1e-3, 5.0], 200)[:, None] * rng.normal(size=(200, 2))
    return polyline(np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)]))


def distances(points, start, end):
    """Of points (n, dim) from the nearest of the lines from ``start`` to ``end`` (m, dim), (n,)."""
    vector = end - start
    spoke = points[:, None] - start
    along = np.einsum("nmd,md->nm", spoke, vector) / np.sum(vector**2, axis=1)
    away = spoke - np.clip(along, 0.0, 1.0)[..., None] * vector
    return np.sqrt(np.sum(away**2, axis=2)).min(axis=1)


def dense(start, end):
    return (start + np.linspace(0.0, 1.0, 41)[:, None, None] * (end - start)).reshape(-1, start.shape[1])


@pytest.mark.parametrize("seed", range(3, 9))
def test_what_is_off_is_the_distance_between_the_lines_and_the_blocks(seed):
    """Both ways, by points close together on either; it is taken from the tolerance of the moves on which they lie."""
    source = steps_of_all_sizes(seed)
    found = absorb(source, MovingBlocks.of(source, 0.01))
    moves, off = found.program, found.own - found.program.tolerance
    assert found.largest == pytest.approx(off.max(), rel=1e-12)
    assert np.count_nonzero(off) > 10
    for k in np.flatnonzero(np.bincount(found.owner) > 1):
        rows = np.flatnonzero(found.owner == k)
        start, end = source.start[rows], source.end[rows]
        line = moves.start[k : k + 1], moves.end[k : k + 1]
        near = slice(max(k - 1, 0), k + 2)
        assert distances(dense(start, end), moves.start[near], moves.end[near]).max() <= off[k] * (1 + 1e-9) + 1e-12
        assert distances(dense(*line), start, end).max() <= off[k] * (1 + 1e-9) + 1e-12


def test_a_spike_beside_a_corner_is_off_by_nothing_or_its_length():
    """Back along the line it came from, or over the end of the line: of 4 um, at 10 um."""
    for length, wanted in ((-0.004, 0.0), (0.004, 0.004)):
        source = polyline([(0.0, 0.0), (LEG, 0.0), (LEG + length, 0.0), (LEG, 0.0), (LEG, LEG)])
        assert absorb(source, MovingBlocks.of(source, 0.01)).largest == pytest.approx(wanted, abs=1e-9)


def test_places_go_with_the_blocks():
    """Every vertex lies beside the point of the simpler program that goes with it, within the largest share."""
    source = steps_of_all_sizes(3)
    blocks = MovingBlocks.of(source, 0.01)
    found = absorb(source, blocks)
    assert 20 < len(found.program) < 190
    assert (np.diff(found.place) >= 0.0).all()
    assert (found.place[0], found.place[-1]) == (0.0, found.edges[-1])
    left = MovingBlocks.of(found.program, None).programmed
    points = np.concatenate([source.start[:1], source.end])[:, :2]
    away = np.sqrt(np.sum((left.at(found.place)[0] - points) ** 2, axis=1))
    assert found.largest <= away.max() <= 0.9 * 0.01
    assert (found.program.tolerance >= 0.1 * 0.01 * (1.0 - 1e-9)).all()


class TestNotAbsorbed:
    def count(self, *moves, tolerance=0.01):
        path, profile = planned(program(*moves, feed=50.0), tolerance)
        return path, profile, path.counts["absorbed"]

    def test_a_block_with_time_of_its_own(self):
        """1 um at 1 um/s is a second, whatever its length."""
        path, profile, absorbed = self.count(line(LEG, 0), line(LEG, 1e-3, feed=1e-3), line(LEG, LEG))
        assert absorbed == 0
        assert (
            line_times(program(line(LEG, 0), line(LEG, 1e-3, feed=1e-3), line(LEG, LEG)), path, profile).seconds[1]
            > 0.9
        )

    def test_stops_and_rapids(self):
        moves = [line(LEG, 0, stop=True), line(LEG + 1e-5, 0, stop=True), rapid(LEG + 2e-5, 0), line(LEG, LEG)]
        path, _, absorbed = self.count(*moves)
        assert absorbed == 0
        assert [stop.line for stop in path.stops] == [1, 2, 3]

    def test_exact_stop_mode(self):
        moves = [line(LEG, 0), line(LEG + 1e-5, 0), line(LEG, LEG)]
        path, _, absorbed = self.count(*({**move, "tolerance": 0.0} for move in moves))
        assert absorbed == 0
        assert len(path.stops) >= 1
        assert path.deviation.largest == 0.0

    def test_a_smooth_curve_of_short_chords(self):
        angle = np.linspace(0.0, 1.5, 2001)
        path = program_path(
            polyline(10.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])), 0.01, LIMITS, path="separate"
        )
        assert path.counts["absorbed"] == 0


def winding_with_dust(seed=11):
    """A long program: corners, arcs of chords, and dust of all sizes around its vertices."""
    rng = np.random.default_rng(seed)
    at, heading, out = np.zeros(2), 0.0, [np.zeros(2)]
    for _ in range(120):
        heading += rng.choice([0.1, -0.1, 0.5, 1.5, -1.5])
        at = at + rng.uniform(1.0, 3.0) * np.array([np.cos(heading), np.sin(heading)])
        out += [at + 10.0 ** rng.uniform(-6, -3) * rng.normal(size=2) for _ in range(rng.integers(1, 6))]
    return polyline(rounded(out, 7))


def test_windows_absorb_as_the_whole_does(tmp_path, monkeypatch):
    from planner.programs.long import parts

    monkeypatch.setattr(parts, "_FIRST_BLOCKS", 120)
    monkeypatch.setattr(parts, "_MAX_BLOCKS", 120)
    monkeypatch.setattr(parts, "_MIN_BLOCKS", 60)
    source = winding_with_dust()
    path, profile = planned(source, 0.01, PLANE)
    plan = plan_program(source, PLANE, 0.01, output=tmp_path / "plan.npz", path="separate")
    assert plan.ok
    assert plan.duration == pytest.approx(profile.duration, rel=5e-3)
    assert 0.5e-2 < plan.deviation <= 0.01
    assert path.counts["absorbed"] > 50
    rows = [row.split(",") for row in plan.lines.read_text().splitlines() if row[:1].isdigit()]
    assert [int(row[0]) for row in rows] == source.line.tolist()
    assert sum(float(row[3]) for row in rows) == pytest.approx(plan.duration, abs=1e-9)


def test_lines_add_up_and_absorbed_ones_take_their_share():
    source = winding_with_dust(4)
    path, profile = planned(source, 0.01, PLANE)
    times = line_times(source, path, profile)
    assert times.line.tolist() == source.line.tolist()
    assert times.moving == pytest.approx(profile.duration, abs=1e-9)
    assert (times.seconds >= 0.0).all()
    assert (np.diff(path.u) >= 0.0).all()


@pytest.mark.parametrize("angle", [30.0, 90.0, 149.0])
def test_the_tolerance_never_makes_a_plan_slower_than_stopping(angle):
    """From 1 nm to 10 um: a corner, or a stop where the corner is too small to be worth passing."""
    points = corner(angle)
    stopping = planned(polyline(points, tolerance=0.0), None)[1].duration
    before = stopping
    for tolerance in 10.0 ** np.arange(-7.0, -1.0):
        path, profile = planned(polyline(points), float(tolerance))
        assert profile.duration <= stopping * (1.0 + 1e-3)
        assert profile.duration <= before * (1.0 + 1e-3)
        size = tolerance / (2.0 * np.sin(0.5 * np.deg2rad(angle)))
        assert bool(path.stops) == (size < 1e-7 * LEG)
        before = profile.duration
    assert profile.duration < stopping - 0.015


@pytest.mark.parametrize("tolerance", [1e-8, 1e-6, 1e-4])
def test_tubes_at_tiny_tolerances_stay_small(tolerance):
    path = program_path(polyline(corner(10.0)), tolerance, LIMITS, path="separate")
    assert path.counts["knots"] < 500
    assert path.deviation_share <= 1.0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(12))
def test_the_compiled_runs_are_those_of_plain_python(seed, dim):
    """Noise about a curve, repeated vertices, feeds that differ, vertices that must stay; runs of more than 1024 blocks."""
    rng = np.random.default_rng([seed, dim])
    count = 1500 if seed == 0 else int(rng.integers(1, 120))
    way = np.cumsum(rng.uniform(0.0, 0.2, count + 1))
    points = np.column_stack([way, np.sin(way if seed % 2 else 0.1 * way), 0.3 * way][:dim])
    points = points + rng.normal(0.0, 0.003, (count + 1, dim))
    points[rng.integers(0, count, count // 10) + 1] = (
        points[rng.integers(0, count, count // 10)] if seed % 4 == 3 else 0.5
    )
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    feed = 50.0 if seed < 6 else rng.choice([50.0, 80.0], count, p=[0.9, 0.1])
    rows = np.column_stack(
        [
            length,
            np.where(rng.random(count) < 0.05, rng.choice([np.inf, 1e-3], count), 0.0),
            np.broadcast_to(feed, count),
            rng.choice([0.01, 0.02], count),
            rng.choice([0.0, 1e-3], count),
            np.full(count, 0.05),
        ]
    )
    loose = rng.random(count + 1) < (1.0 if seed == 0 else 0.95)
    loose[[0, -1]] = False
    core.absorb_runs(count, dim, points, rows, loose, 0.8, kept := np.full(count + 1, 7, dtype=np.uint8))
    reference.absorb_runs(points, rows, loose, 0.8, expected := np.full(count + 1, 7, dtype=np.uint8))
    assert kept.tobytes() == expected.tobytes()
    assert kept[[0, -1]].all()
    assert kept[~loose].all()
    assert count < 100 or kept.sum() < 0.9 * count
