"""Runs whose path and feed are found as one: cut at stops, within limits and tolerance, faster; and why others are not."""

from dataclasses import replace

import numpy as np
import pytest
from cases import PROGRAMS, drives
from program_blocks import arc, line, polyline, program, rapid

from planner import Limits, check, plan_feedrate
from planner.errors import SolverError
from planner.geometry.chain import Kind
from planner.programs.path import joint_runs
from planner.programs.path.joint_runs import find_runs, reason_of_machine
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.separate_path import classified
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.reader import read_program

AXES = ("X", "Y", "Z")
LIMITS = drives(dim=3, axes=AXES)
SQUARE = [[0, 0], [12, 0], [12, 12], [0, 12], [0, 24]]


def runs_of(source, limits=LIMITS):
    blocks = MovingBlocks.of(source, None)
    limits = limits.for_axes(blocks.axes, "the program")
    return find_runs(blocks, classified(blocks, None), limits, lambda first, last: np.inf)


def planned(source, limits=LIMITS, tolerance=0.02, **options):
    path = program_path(source, tolerance, limits, **options)
    own = limits.for_curve(path.curve)
    profile = plan_feedrate(path.curve, own)
    report = check(path.curve, own, profile)
    assert report.ok, str(report)
    return path, profile


def test_a_run_of_lines_is_faster_within_limits_and_tolerance():
    path, profile = planned(polyline(SQUARE))
    other, slower = planned(polyline(SQUARE), path="separate")
    assert path.counts["runs"] == path.counts["joint"] == 1
    assert other.counts["joint"] == 0
    assert profile.duration < 0.98 * slower.duration
    assert 0.5 < path.deviation_share <= 1.0
    assert path.stops == ()
    assert not path.notes


@pytest.mark.parametrize(
    ("name", "tolerance", "seconds"),
    [
        ("zigzag", 1e-3, 13.09),
        ("zigzag", 1e-2, 12.29),
        ("zigzag", 5e-2, 11.51),
        ("slots", 1e-3, 6.19),
        ("slots", 1e-2, 5.54),
        ("slots", 5e-2, 5.165),
    ],
)
def test_durations(name, tolerance, seconds):
    path, profile = planned(read_program(PROGRAMS / f"{name}.ngc"), tolerance=tolerance)
    assert path.counts["joint"] == path.counts["runs"] == 1
    assert path.stops == ()
    assert 0.9 < path.deviation_share <= 1.0
    assert profile.duration <= seconds


def test_runs_are_cut_at_the_stops_that_are_demanded():
    moves = [line(5, 0), line(5, 5, stop=True), line(0, 5), rapid(0, 30), line(9, 30), line(9, 40)]
    assert [(run.first, run.last) for run in runs_of(program(*moves))] == [(0, 2), (2, 3), (3, 4), (4, 6)]
    path, profile = planned(program(*moves))
    assert [stop.line for stop in path.stops] == [2, 3, 4]
    at_rest = np.unique(profile.u[profile.u_rate == 0.0])
    assert at_rest == pytest.approx([0.0, *(stop.u for stop in path.stops), path.curve.domain[1]])
    # what is demanded is exact
    for stop, point in zip(path.stops, [(5, 5), (0, 5), (0, 30)], strict=True):
        assert path.curve.derivatives(stop.u, 0)[0, :2] == pytest.approx(point, abs=1e-12)


def test_single_lines_are_legs_also_without_a_tolerance():
    moves = [line(5, 0, tolerance=0.0), line(5, 5, tolerance=0.0), rapid(0, 5)]
    path, profile = planned(program(*moves), tolerance=None)
    assert path.counts["joint"] == 3
    assert (path.curve.kind == Kind.LEG).all()
    assert path.curve.kind.size == 3
    assert path.deviation.largest == 0.0
    _, other = planned(program(*moves), tolerance=None, path="separate")
    assert profile.duration <= other.duration * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        (LIMITS.without_jerk(), "the jerk of X, Y has no limit"),
        (LIMITS._replace(tangential_jerk=1e4), "along the path has a limit"),
        (LIMITS._replace(tangential_acceleration=5e2), "along the path has a limit"),
    ],
)
def test_what_a_machine_does_not_allow_is_told(limits, reason):
    (run,) = runs_of(polyline(SQUARE), limits)
    assert run.part is None
    assert reason in run.reason
    path, _ = planned(polyline(SQUARE), limits)
    assert path.counts["joint"] == 0
    assert [note for note in path.notes if reason in note and "made separately" in note]


def test_blocks_without_a_tolerance_are_made_separately():
    moves = [line(5, 0, tolerance=0.0), line(10, 0, tolerance=0.0), line(10, 10)]
    found = runs_of(program(*moves))
    assert [(run.first, run.last, run.part is None) for run in found] == [(0, 2, True), (2, 3, False)]
    assert "no tolerance" in found[0].reason


def test_a_solver_that_gives_up_leaves_the_run_to_the_separate_path(monkeypatch):
    def refuses(run):
        raise SolverError("it gives up")

    monkeypatch.setattr(joint_runs, "solve_run", refuses)
    path, profile = planned(polyline(SQUARE))
    _, other = planned(polyline(SQUARE), path="separate")
    assert profile.duration == other.duration
    assert [note for note in path.notes if "it gives up" in note and "the path is made separately" in note]


@pytest.mark.parametrize(("factor", "joint"), [(1.001, 1), (1.05, 0)])
def test_what_exceeds_its_limits_is_slowed_down_or_left_out(monkeypatch, factor, joint):
    solve = joint_runs.solve_run

    def hurried(run):
        motion = solve(run)
        return replace(
            motion,
            t=motion.t / factor,
            velocity=motion.velocity * factor,
            acceleration=motion.acceleration * factor**2,
            jerk=motion.jerk * factor**3,
        )

    expected = planned(polyline(SQUARE))[1].duration
    monkeypatch.setattr(joint_runs, "solve_run", hurried)
    path, profile = planned(polyline(SQUARE))
    assert path.counts["joint"] == joint
    if joint:
        assert profile.duration == pytest.approx(expected, rel=1e-5)


def test_what_leaves_the_tolerance_is_solved_again_with_less(monkeypatch):
    solve = joint_runs.solve_run
    monkeypatch.setattr(joint_runs, "solve_run", lambda run: solve(replace(run, tolerance=1.5 * run.tolerance)))
    path, _ = planned(polyline(SQUARE))
    assert path.counts["joint"] == 1
    assert 0.5 < path.deviation_share <= 1.0


@pytest.mark.parametrize(("wider", "joint"), [(1.5, 0), (0.7, 1)])
def test_what_leaves_the_tolerance_is_left_out(monkeypatch, wider, joint):
    solve = joint_runs.solve_run
    monkeypatch.setattr(joint_runs, "_shares", lambda run, motion: np.zeros(run.lengths.size))
    monkeypatch.setattr(joint_runs, "solve_run", lambda run: solve(replace(run, tolerance=wider * run.tolerance)))
    moves = [*(line(x, y) for x, y in SQUARE[1:]), rapid(0, 40), line(5, 40), line(5, 45, feed=50.0)]
    path, _ = planned(program(*moves))
    assert path.deviation_share <= 1.0
    assert path.counts["joint"] == 1 + 2 * joint
    assert bool(path.notes) != bool(joint)


def test_the_feed_of_each_block_is_kept_and_changes_at_its_end():
    path, profile = planned(program(line(20, 0, feed=80.0), line(20, 20, feed=20.0), line(40, 20, feed=60.0)))
    assert path.counts["joint"] == 1
    for k, feed in enumerate([80.0, 20.0, 60.0]):
        inside = (profile.u > path.u[k]) & (profile.u < path.u[k + 1])
        assert 0.9 * feed < profile.feed[inside].max() <= feed * (1.0 + 1e-6)


@pytest.mark.parametrize("feed", [1.0, 0.1, 0.01])
def test_an_arc_at_a_small_feed_has_no_more_pieces_for_it(feed):
    """A piece a unit of time would be 200 000 of them, and minutes of solving."""
    moves = line(5, 0), arc((15, 0, 0), (10, 0, 0), 1), line(20, 0)
    path, profile = planned(program(*moves, feed=feed))
    assert path.counts["joint"] == 1
    assert profile.t.size < 1000
    assert profile.duration == pytest.approx((10.0 + 5.0 * np.pi) / feed, rel=5e-3)


def test_each_block_keeps_its_own_tolerance():
    wide, narrow = 0.05, 0.005
    moves = [
        line(10, 0, tolerance=wide),
        line(10, 10, tolerance=wide),
        line(20, 10, tolerance=narrow),
        line(20, 20, tolerance=wide),
    ]
    path, _ = planned(program(*moves), tolerance=None)
    assert path.counts["joint"] == 1
    assert path.deviation_share <= 1.0
    third = np.linspace(path.u[2], path.u[3], 2000)
    assert np.abs(path.curve.derivatives(third, 0)[0][:, 1] - 10.0).max() <= narrow * (1.0 + 1e-9)
    assert path.deviation.largest > 2.0 * narrow


def wave_of(count, seed=3, waves=1.0):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.1, 0.5, count))
    return polyline(np.column_stack([x, waves * (3.0 * np.sin(x / 4.0) + 0.4 * np.sin(x))]).round(3))


def solver_is_asked(monkeypatch, source):
    asked = []

    def give_up(run):
        asked.append(run.lengths.size)
        raise SolverError("planted")

    monkeypatch.setattr(joint_runs, "solve_run", give_up)
    runs = runs_of(source)
    assert all(run.part is None for run in runs)
    return bool(asked), runs[0].reason


def test_many_blocks_finer_than_the_tolerance_are_left_to_the_separate_path(monkeypatch):
    """No solver is asked; but where they are few, or turn by more, or have corners."""
    asked, reason = solver_is_asked(monkeypatch, wave_of(120))
    assert not asked
    assert "finer than the tolerance asks for" in reason
    assert solver_is_asked(monkeypatch, wave_of(50))[0]
    assert solver_is_asked(monkeypatch, wave_of(120, waves=30.0))[0]
    sharp = np.column_stack([0.3 * np.arange(120), 3.0 * (np.arange(120) % 12 == 0)])
    assert solver_is_asked(monkeypatch, polyline(sharp))[0]


def test_without_a_corner_the_faster_of_the_two_is_taken():
    """A turn of a degree: within 50 um nothing is to be gained by swinging."""
    turn = np.deg2rad(1.0)
    points = [[0.0, 0.0], [50.0, 0.0], [50.0 + 50.0 * np.cos(turn), 50.0 * np.sin(turn)]]
    for tolerance in (0.001, 0.05):
        path, profile = planned(polyline(points), tolerance=tolerance)
        _, other = planned(polyline(points), tolerance=tolerance, path="separate")
        assert profile.duration <= other.duration * (1.0 + 1e-9)
        if not path.counts["joint"]:
            (note,) = path.notes
            assert "faster here" in note or "as fast here" in note


def test_the_slower_is_left_and_the_note_tells_by_how_much():
    points = [[0.0, 0.0], [5.0, 0.0], [10.0, 0.5]]
    blocks = MovingBlocks.of(polyline(points), 0.01)
    limits = LIMITS.for_axes(blocks.axes, "the program")
    kinds = classified(blocks, None)
    (run,) = find_runs(blocks, kinds, limits, lambda first, last: np.inf)
    took = run.part.law.duration
    asked = []

    def told(first, last):
        asked.append((first, last))
        return 0.99 * took

    (left,) = find_runs(blocks, kinds, limits, told)
    assert left.part is None
    assert left.reason == "that is 1 % faster here"
    assert asked == [(0, 2)]
    corner = MovingBlocks.of(polyline(SQUARE), 0.01)
    (run,) = find_runs(corner, classified(corner, None), limits, told)
    assert run.part is not None
    assert asked == [(0, 2)]


@pytest.mark.parametrize("own", [{"tangential_acceleration": 800.0}, {"tangential_jerk": 9e3}])
def test_a_single_line_keeps_limits_along_the_path(own):
    limits = replace(LIMITS, **own)
    path, _ = planned(program(line(30, 0, stop=True), line(30, 30, stop=True), line(0, 0)), limits)
    assert (path.counts["runs"], path.counts["joint"]) == (3, 0)
    assert "along the path has a limit of its own" in path.notes[0]


def test_an_arc_by_itself_keeps_the_chord_error_and_a_line_need_not():
    limits = replace(LIMITS, chord_error=1e-3, period=0.01)  # 80 mm/s^2 across
    path, _ = planned(program(line(30, 0, stop=True), arc((0, 30), (0, 0), 0.25)), limits)
    assert (path.counts["runs"], path.counts["joint"]) == (2, 1)
    assert path.notes == (
        "line 2 is made separately from the feed: the chord error limits the acceleration to less than the axes do",
    )


def test_an_arc_by_itself_without_a_tolerance_is_made_separately():
    stops = line(30, 0, stop=True), arc((30, 20), (30, 10), 0.5, stop=True), arc((30, 0), (30, 10), 0.5, stop=True)
    path, _ = planned(program(*stops, line(0, 0), tolerance=0.0), tolerance=None)
    assert (path.counts["runs"], path.counts["joint"]) == (4, 2)
    assert path.notes == ("lines 2, 3 are made separately from the feed: it has no tolerance",)


@pytest.mark.parametrize("jerk", [1e5, 3e5, 1e6])
def test_a_motion_with_a_piece_that_the_digits_of_the_path_do_not_hold_is_no_path(jerk):
    """0.01 mm/min before the rest at the end, under a large jerk: the last piece of the motion is below 1e-15 mm."""
    limits = Limits(100.0, 250.0, 1000.0, jerk, 1e-3, 1e-3, axes=("X", "Y"))
    moves = line(0, 0.2, feed=1 / 60), line(20, 0.2, feed=250 / 3), line(20.001, 0.2, feed=1 / 6000)
    planned(program(*moves), limits, 0.01)


@pytest.mark.parametrize(("jerk", "joint"), [(50.0, 1), (2.0, 0)])
def test_the_jerks_of_axes_are_compared_as_they_count_a_degree_as_a_mm(jerk, joint):
    """50 rad/s^3 are 2865 degrees/s^3, a seventh of the 20 000 mm/s^3 beside; 2 are too little."""
    axes = ("X", "Y", "A")
    limits = Limits(100.0, [250.0, 250.0, 2.0], [1000.0, 1000.0, 5.0], [20000.0, 20000.0, jerk], axes=axes)
    path, _ = planned(program(line(10, 0, 0, 5), line(10, 10, 0, 10)), limits)
    assert path.counts["joint"] == joint
    assert joint or "more than 100 times apart" in path.notes[0]


def test_an_axis_that_turns_does_not_count_for_the_chord_error():
    axes = ("X", "Y", "A")
    limits = Limits(100.0, [250.0] * 3, [1000.0, 1000.0, 1e6], [20000.0, 20000.0, 1000.0], 2e-4, 1e-3, axes=axes)
    assert reason_of_machine(limits, 100.0) == ""
    assert "chord error" in reason_of_machine(replace(limits, chord_error=1.7e-4), 100.0)


def test_an_acceleration_beyond_what_the_feed_lets_be_reached_changes_nothing():
    """At 1000 mm/min and 20 000 mm/s^3 no axis gets beyond 816 mm/s^2; runs of arcs and tiny lines are hard to solve."""
    source, limits = read_program(PROGRAMS / "stops.ngc"), drives(dim=3, axes=AXES, chord_error=1e-3)
    path, profile = planned(source, limits)
    for factor in (1.5, 2.0, 10.0):
        other, as_fast = planned(source, replace(limits, acceleration=factor * limits.acceleration))
        assert other.counts["joint"] == path.counts["joint"] == path.counts["runs"]
        assert as_fast.duration == pytest.approx(profile.duration, rel=1e-9)


@pytest.mark.parametrize("feed", [0.5, 3.0, 60.0])
def test_a_corner_is_rounded_at_whatever_feed(feed, tmp_path):
    """In mm/min; at the slowest no axis gets beyond 18 mm/s^2, and a tenth of the unit of time is worth no digit."""
    file = tmp_path / "slow.ngc"
    file.write_text(f"G21 G90 G64 P0.01\nG0 X0 Y0\nG1 X10 F{feed}\nG1 Y3\nM2\n")
    path, profile = planned(read_program(file), drives(dim=3, axes=AXES), tolerance=None)
    assert path.counts["joint"] == 1
    assert profile.duration < 13.0 / feed * 60.0 + 0.02  # for the ramps, at the fastest
