"""Runs of a long program, found jointly: the same as in the whole, however it is cut, interrupted, or mixed with others."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import drives
from click.testing import CliRunner
from program_blocks import line, program, rapid

from feedplan.cli import app
from planner import InputError, plan_feedrate
from planner.machine.limits import Limits
from planner.programs.long import part_runs, parts, view, window
from planner.programs.long.part_runs import find_part_runs
from planner.programs.long.path_ahead import PathAhead
from planner.programs.long.path_source import PathSource
from planner.programs.long.windows import plan_program
from planner.programs.path import joint_runs
from planner.programs.path.joint_runs import find_run
from planner.programs.path.moves import MovingBlocks, ProgramAxes
from planner.programs.path.separate_path import classified
from planner.programs.path.smooth_path import program_path

LIMITS = drives(dim=3, axes=("X", "Y", "Z"))
TEETH = 5


def zigzags(passes):
    """Passes of teeth side by side, each with a stop inside, and rapids between: runs of 1, 3 and 3 moves."""
    moves = []
    for k in range(passes):
        y = 12.0 * k
        moves += [rapid(0.0, y, 2.0), line(0.0, y, 0.0, feed=50.0)]
        moves += [line(3.0 * i, y + 7.0 * (i % 2), 0.0, feed=100.0, stop=i == 2) for i in range(1, TEETH)]
        moves += [line(3.0 * TEETH, y, 2.0, feed=80.0)]
    return program(*moves, start=(0.0, 0.0, 4.0))


def winding(blocks, start):
    """Segments of 0.1 mm along a curve that turns all the time, as moves."""
    s = 0.1 * np.arange(blocks)
    heading = 0.9 * np.sin(s / 2.3) + 1.1 * np.sin(s / 6.1 + 1.0)
    points = start + np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    return [line(*point) for point in np.round(points, 3)]


@pytest.fixture(autouse=True)
def short_windows(monkeypatch):
    """Windows of some runs each."""
    monkeypatch.setattr(window, "_WINDOW", 300)
    monkeypatch.setattr(part_runs, "_WANTED_PIECES", 400)


@pytest.fixture
def queues(monkeypatch):
    """The paths that are waiting whenever a window is planned, and the windows."""
    found = []
    usual = window.Planner.end_of

    def seen(planner, state, queue):
        end = usual(planner, state, queue)
        found.append((state, queue, end))
        return end

    monkeypatch.setattr(window.Planner, "end_of", seen)
    return found


def planner_of(source):
    """The planner of a program."""
    path = PathSource(source, ProgramAxes.of(source), 0.01, drives(dim=2))
    return window.Planner(path, LIMITS, PathAhead(path).next)


def whole(source, **options):
    path = program_path(source, 0.01, LIMITS, **options)
    return path, plan_feedrate(path.curve, LIMITS.for_curve(path.curve))


def test_runs_are_those_of_the_whole(tmp_path, queues):
    source = zigzags(8)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    path, profile = whole(source)
    assert plan.ok
    assert plan.windows >= 4
    assert (plan.runs, plan.joint, plan.stops, plan.notes) == (24, 24, 0, ())
    assert (path.counts["runs"], path.counts["joint"]) == (24, 24)
    assert plan.duration == pytest.approx(profile.duration, rel=1e-9)
    assert plan.length == pytest.approx(path.curve.domain[1], rel=1e-12)
    assert plan.deviation_share == pytest.approx(path.deviation_share, rel=1e-6)
    assert (
        plan.duration
        < 0.97 * plan_program(source, LIMITS, 0.01, output=tmp_path / "other.npz", path="separate").duration
    )
    # Each window ends where the path rests, and takes the laws as they are.
    with np.load(plan.table) as table:
        last = table["first"][1:] - 1
        assert (table["feed"][last] == 0.0).all()
        u = np.concatenate(
            [table["u"][i:j] + start for i, j, start in zip(table["first"], last + 1, table["u_start"], strict=False)]
        )
    assert np.isin(np.round(u, 6), np.round(profile.u, 6)).all()
    for _, queue, (end, at_stop) in queues:
        assert at_stop
        assert not any(first < end < last for first, last in queue.timed)
    with open(plan.lines, encoding="utf-8") as file:
        rows = [text.split(",") for text in file if not text.startswith("#")]
    at = rows[0].index("seconds")
    assert sum(float(row[at]) for row in rows[1:]) == pytest.approx(plan.duration, abs=1e-9)


def test_a_window_that_is_shorter_than_a_run_takes_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(window, "_WINDOW", 20)
    source = zigzags(2)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.windows > 3
    assert plan.stops == 0
    assert plan.duration == pytest.approx(whole(source)[1].duration, rel=1e-9)


def test_the_laws_are_taken_also_where_one_feed_is_the_lowest_everywhere(tmp_path, monkeypatch):
    """The limits of such a window, here one of both runs, must be those that its laws were found for."""
    monkeypatch.setattr(window, "_WINDOW", 600)
    source = program(*[line(4.0 * k, 6.0 * (k % 2), stop=k == 4) for k in range(1, 9)], feed=60.0)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    path, _ = whole(source)
    assert plan.ok
    nodes = np.concatenate([law.u for law in path.curve.timing.laws])
    with np.load(plan.table) as table:
        assert table["u"] == pytest.approx(nodes, abs=1e-9)
        assert 59.0 < table["feed"].max() <= 60.0 * (1.0 + 1e-6)


def test_a_run_is_not_cut_where_a_window_would_end(tmp_path, monkeypatch, queues):
    """It goes on for several times what stopping takes."""
    monkeypatch.setattr(window, "_WINDOW", 20)
    moves = [line(4.0 * k, 6.0 * (k % 2), stop=k == 26) for k in range(1, 30)]
    source = program(*moves)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert (plan.runs, plan.joint, plan.stops, plan.windows) == (2, 2, 0, 2)
    state, queue, _ = queues[0]
    usual = window.Planner._usual_end(planner_of(source), state, queue)
    assert usual[0] < queue.timed[0, 1]
    assert plan.duration == pytest.approx(whole(source)[1].duration, rel=1e-9)


def test_what_waits_is_a_part_and_a_window(tmp_path, queues):
    """However long the program is: a part more than a window at most, each longer by a run at most."""
    plan = plan_program(zigzags(12), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    sizes = [queue.curve.kind.size for _, queue, _ in queues]
    assert max(sizes) < 300 + 400 + 2 * 100
    runs = [np.diff(queue.timed, axis=1).max() for _, queue, _ in queues]
    assert max(runs) < 200  # intervals of a run of seven blocks
    with np.load(plan.table) as table:
        assert table["t"].size > 2000


class InterruptedError(Exception):
    """A run that ends in the middle."""


def interrupt(source, output, count):
    def progress(message, share):
        if message == f"window {count}":
            raise InterruptedError

    with pytest.raises(InterruptedError):
        plan_program(source, LIMITS, 0.01, output=output, progress=progress)


def test_interrupted_and_resumed_is_the_same(tmp_path):
    source = zigzags(6)
    once = plan_program(source, LIMITS, 0.01, output=tmp_path / "once.npz")
    table = tmp_path / "again.npz"
    for count in (2, 3):
        interrupt(source, table, count)
    with pytest.raises(InputError, match="belongs to another program"):
        plan_program(source, LIMITS, 0.01, output=table, path="separate")
    again = plan_program(source, LIMITS, 0.01, output=table)
    assert again.resumed == 2
    assert again.lines.read_bytes() == once.lines.read_bytes()
    with np.load(once.table) as a, np.load(table) as b:
        assert all(np.array_equal(a[name], b[name]) for name in a.files)
    same = {name: getattr(once, name) for name in ("table", "lines", "resumed")}
    assert replace(again, **same) == once


@pytest.mark.parametrize(
    ("name", "column", "change"),
    [
        ("window-000001.npz", "t", lambda v: v * 0.98),
        ("window-000001.npz", "u", lambda v: np.concatenate([v[:40], v[40:41] * 1.001, v[41:]])),
        ("state.npz", "queue.law_t", lambda v: v * 1.001),
        ("state.npz", "queue.law_first", lambda v: v + 1),
        ("state.npz", "queue.spans", lambda v: v * 1.0001),
        ("state.npz", "queue.at", lambda v: v * 1.0001),
        ("state.npz", "header", lambda v: np.array(str(v).replace('"runs": ', '"runs": 1'))),
    ],
)
def test_a_journal_that_is_not_sound_is_refused(tmp_path, name, column, change):
    source = zigzags(5)
    table = tmp_path / "plan.npz"
    interrupt(source, table, 3)
    path = tmp_path / "plan.npz.windows" / name
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    np.savez(path, **(arrays | {column: change(arrays[column])}))
    with pytest.raises(InputError, match="to begin again, plan with --fresh"):
        plan_program(source, LIMITS, 0.01, output=table)


def test_runs_that_are_not_found_are_made_separately_among_the_others(tmp_path, monkeypatch):
    """The window takes the laws of the others, and plans these."""

    def refused(blocks, junctions, limits, first, last, sides=None, room=1.0):
        found = find_run(blocks, junctions, limits, first, last, sides, room)
        return (
            replace(found, part=None, reason="no luck") if last - first == 3 and blocks.feed[first] == 50.0 else found
        )

    for module in (part_runs, joint_runs):
        monkeypatch.setattr(module, "find_run", refused)
    source = zigzags(9)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    path, profile = whole(source)
    assert plan.ok
    assert plan.windows >= 3
    assert (plan.runs, plan.joint) == (27, 18) == (path.counts["runs"], path.counts["joint"])
    assert plan.duration == pytest.approx(profile.duration, rel=1e-3)
    said = [note for note in plan.notes if note.endswith("no luck")]
    assert said[:2] == [f"from line {n} to the next stop the path is made separately: no luck" for n in (2, 9)]
    assert len(said) == 8
    assert plan.notes[-1] == "and so are 1 runs more"


def test_a_run_beyond_its_tolerance_is_left_out(tmp_path, monkeypatch):
    """The measure decides, not the solver."""

    def wider(blocks, junctions, limits, first, last):
        return find_run(replace(blocks, tolerance=3.0 * blocks.tolerance), junctions, limits, first, last)

    monkeypatch.setattr(part_runs, "find_run", wider)
    plan = plan_program(zigzags(2), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.deviation_share <= 1.0
    assert (plan.runs, plan.joint) == (6, 2)  # the rapids are exact
    assert sum("it would leave the tolerance by" in note for note in plan.notes) == 4


def test_a_run_a_little_beyond_its_tolerance_is_found_again_as_in_the_whole(tmp_path, monkeypatch):
    solve, rooms = joint_runs.solve_run, []

    def again(blocks, junctions, limits, first, last, sides=None, room=1.0):
        rooms.append(room)
        return find_run(blocks, junctions, limits, first, last, sides, room)

    monkeypatch.setattr(joint_runs, "_shares", lambda run, motion: np.zeros(run.lengths.size))
    monkeypatch.setattr(joint_runs, "solve_run", lambda run: solve(replace(run, tolerance=1.03 * run.tolerance)))
    monkeypatch.setattr(view, "find_run", again)
    source = zigzags(2)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert (plan.runs, plan.joint, plan.notes) == (6, 6, ())
    assert 0.99 < plan.deviation_share <= 1.0
    assert len(rooms) == 4
    assert all(0.95 < room < 0.98 for room in rooms)
    assert plan.duration == pytest.approx(whole(source)[1].duration, rel=1e-9)


def test_runs_without_a_corner_are_left_where_they_are_left_in_the_whole(tmp_path):
    """Which of both paths is faster at a turn of some degrees; a line with a step, which is absorbed, is one."""
    moves = []
    for k in range(12):
        x, turn = 60.0 * k, np.deg2rad((0.2, 1.0, 6.0, 60.0)[k % 4])
        moves += [line(x + 8.0, 0.0), line(x + 8.0, 0.004), line(x + 20.0, 0.004, stop=True)]
        moves += [line(x + 40.0, 0.004), line(x + 60.0, 0.004 + 20.0 * np.tan(turn), stop=True)]
        moves += [line(x + 60.0, 0.0, stop=True)]
    source = program(*moves)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    path, profile = whole(source)
    assert plan.ok
    assert plan.windows >= 2
    assert path.counts["absorbed"] > 0
    assert (plan.runs, plan.joint) == (path.counts["runs"], path.counts["joint"])
    assert 0 < plan.runs - plan.joint < 12
    assert plan.duration == pytest.approx(profile.duration, rel=1e-3)
    assert plan.deviation_share == pytest.approx(path.deviation_share, rel=1e-6)
    said, ours = (
        {note.rsplit(": ", 1)[1] for note in notes if "separately" in note} for notes in (path.notes, plan.notes)
    )
    assert said == ours
    assert all(reason.endswith(" here") for reason in said)


@pytest.mark.parametrize("first", ["long", "joint"])
def test_a_run_too_long_is_made_as_without_runs(tmp_path, monkeypatch, queues, first):
    """Windows inside of it join at speed; the one before the next run ends where that begins, and it begins at rest."""
    monkeypatch.setattr(window, "_WINDOW", 100)
    monkeypatch.setattr(part_runs, "MAX_BLOCKS", 400)
    monkeypatch.setattr(joint_runs, "_MAX_BLOCKS", 400)
    for name in ("_FIRST_BLOCKS", "_MAX_BLOCKS", "_MIN_BLOCKS"):
        monkeypatch.setattr(parts, name, 400)

    def teeth(x, y):
        return [line(x + 5.0 * k, y + 5.0 * (k % 2), stop=True) for k in range(1, 6)]

    if first == "long":
        moves = winding(1800, np.zeros(2))
        moves[-1]["stop"] = True
        moves += teeth(*moves[-1]["end"][:2])
    else:
        moves = teeth(0.0, 0.0)
        moves += winding(1800, np.array(moves[-1]["end"][:2]))
    source = program(*moves)
    plan = plan_program(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.stops == 0
    assert (plan.runs, plan.joint) == (6, 5)
    assert plan.windows >= 3
    ended = [(state, queue, end) for state, queue, (end, at_stop) in queues if queue.laws and at_stop]
    if first == "long":
        state, queue = next((state, queue) for state, queue, _ in ended if state.feed > 0.0)
        for size in (100, 10_000):
            monkeypatch.setattr(window, "_WINDOW", size)
            assert window.Planner.end_of(planner_of(source), state, queue) == (queue.timed[0, 0], True)
    else:
        assert any(end == queue.timed[-1, 1] < queue.curve.kind.size for _, queue, end in ended)
    (note,) = plan.notes
    line_of = 1 if first == "long" else 6
    assert note.startswith(f"from line {line_of} to the next stop the path is made separately: it has no stop within ")
    assert plan.duration == pytest.approx(whole(source)[1].duration, rel=2e-3)


def test_without_runs_nothing_changes(tmp_path, monkeypatch):
    monkeypatch.setattr(part_runs, "MAX_BLOCKS", 300)
    source = program(*winding(600, np.zeros(2)))
    plans = [
        plan_program(source, LIMITS, 0.01, output=tmp_path / f"{path}.npz", path=path) for path in ("joint", "separate")
    ]
    with np.load(plans[0].table) as a, np.load(plans[1].table) as b:
        assert all(np.array_equal(a[name], b[name]) for name in b.files)


def test_which_runs_a_part_has():
    blocks = MovingBlocks.of(zigzags(3), 0.01)
    edges, junctions = blocks.programmed.edges, classified(blocks, None)

    def never(first, last):
        raise AssertionError((first, last))

    def find(pairs):
        return (joint_runs.faster(find_run(blocks, junctions, LIMITS, *pair), junctions, never) for pair in pairs)

    def runs(start, known, **options):
        found = find_part_runs(blocks, junctions, find, (edges[start], edges[known]), **options)
        return [(run.first, run.last) for run in found.runs], found.end

    assert runs(0, 7, rests=True) == ([(0, 1), (1, 4), (4, 7)], edges[7])
    # What does not end in sight is left to the next part; where nothing does, the part goes on as if there were no runs.
    assert runs(0, 6, rests=True) == ([(0, 1), (1, 4)], edges[4])
    assert runs(1, 3, rests=True) == ([(1, 3)], np.inf)
    # From within a run, at rest or not, it goes on to the end of that one.
    assert runs(2, 6, rests=False) == ([], edges[4])
    assert runs(2, 9, rests=True) == ([(4, 7), (7, 8)], edges[8])


def test_a_machine_that_allows_none_is_said_once(tmp_path):
    own = Limits(100.0, [250.0] * 3, [1000.0] * 3, [2e4] * 3, tangential_acceleration=800.0, axes=("X", "Y", "Z"))
    plan = plan_program(zigzags(1), own, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert (plan.runs, plan.joint) == (0, 0)
    assert plan.notes == (
        "the path is made separately from the feed: the acceleration or the jerk along the path has a limit of its own",
    )
    with pytest.raises(InputError, match="path = 'fast' must be one of joint, separate"):
        plan_program(zigzags(1), LIMITS, 0.01, output=tmp_path / "plan.npz", path="fast")


def test_the_command_takes_a_path(tmp_path):
    (tmp_path / "part.ngc").write_text("G21 G90 G64 P0.01\nG1 X9 Y0 F6000\nX9 Y9\nX0 Y9\nG4 P1\nX0 Y0\nM2\n")
    found = {}
    for path in ("joint", "separate"):
        options = ["--machine", "mill", "--path", path, "-o", str(tmp_path / f"{path}.npz"), "--json"]
        done = CliRunner().invoke(app, ["windows", str(tmp_path / "part.ngc"), *options])
        assert done.exit_code == 0, done.output
        found[path] = json.loads(done.stdout)
    assert found["joint"]["duration"] < found["separate"]["duration"]
    assert (found["joint"]["runs"], found["joint"]["joint"], found["separate"]["runs"]) == (2, 2, 0)
