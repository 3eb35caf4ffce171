"""Long programs in windows: against the whole plan, interrupted and resumed, at the joints, and when a state is no start."""

import csv
import itertools
import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cases import PROGRAMS, drives
from click.testing import CliRunner
from program_blocks import line, polyline, program, rapid

from feedplan.cli import app
from planner import InfeasibleError, InputError, Limits, check, plan_feedrate, read_program
from planner.geometry.curve import FeedCaps
from planner.law import TimeLaw
from planner.machine.limits import SCALARS
from planner.plan.utilisation import utilisation
from planner.programs.long import parts, window
from planner.programs.long.path_source import PathSource
from planner.programs.long.windows import plan_program
from planner.programs.path.deviation import deviation
from planner.programs.path.moves import MovingBlocks, ProgramAxes
from planner.programs.path.smooth_path import program_path

BUTTERFLY, SLOTS = PROGRAMS / "butterfly_5000.ngc", PROGRAMS / "slots.ngc"
LIMITS = drives(dim=3)
PLANE = drives()
separately = partial(plan_program, path="separate")


def winding(blocks, **words):
    """Segments of 0.1 mm along a curve that turns all the time, rounded to 1 um."""
    s = 0.1 * np.arange(blocks)
    heading = 0.9 * np.sin(s / 2.3) + 1.1 * np.sin(s / 6.1 + 1.0)
    points = np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    return polyline(np.round(np.concatenate([[[0.0, 0.0]], points]), 3), **words)


def whole_duration(source, tolerance):
    path = program_path(source, tolerance, LIMITS, path="separate")
    return plan_feedrate(path.curve, LIMITS.for_curve(path.curve), intervals=path.intervals).duration


def seconds_of(path):
    rows = csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#"))
    return {int(row["line"]): float(row["seconds"]) for row in rows}


@pytest.fixture
def short_windows(monkeypatch):
    shorten_windows(monkeypatch)


def shorten_windows(monkeypatch):
    """Windows of a few hundred intervals, parts of a few hundred blocks."""
    monkeypatch.setattr(window, "_WINDOW", 300)
    monkeypatch.setattr(parts, "_FIRST_BLOCKS", 1200)
    monkeypatch.setattr(parts, "_MAX_BLOCKS", 1200)
    monkeypatch.setattr(parts, "_MIN_BLOCKS", 600)


def test_butterfly_loses_little_and_joins_smoothly(tmp_path, short_windows):
    source = read_program(BUTTERFLY)
    plan = separately(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.windows >= 2
    assert plan.stops == 0
    whole = whole_duration(source, 0.01)
    assert abs(plan.duration / whole - 1.0) <= 2e-3
    assert plan.deviation <= 0.01
    assert plan.joint_feed < 1e-9
    assert plan.joint_acceleration < 1e-6
    seconds = seconds_of(plan.lines)
    assert sum(seconds.values()) == pytest.approx(plan.duration, abs=1e-9)
    assert set(seconds) == {*source.line.tolist(), *source.zero_lines.tolist()}


def test_the_table_is_one_motion(tmp_path, short_windows):
    """Read from the file alone: position, feed and its slope go on from window to window, time and parameter add up."""
    plan = separately(winding(2600), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.windows >= 3
    with np.load(plan.table) as table:
        columns = {name: table[name] for name in table.files}
    first = columns["first"]
    assert first[-1] == columns["t"].size
    assert columns["axes"].tolist() == ["X", "Y"]
    for k in range(1, plan.windows):
        end, start = first[k] - 1, first[k]
        assert columns["t"][start] == columns["u"][start] == 0.0
        assert columns["t_start"][k - 1] + columns["t"][end] == pytest.approx(columns["t_start"][k], abs=1e-12)
        assert columns["u_start"][k - 1] + columns["u"][end] == pytest.approx(columns["u_start"][k], abs=1e-9)
        assert np.abs(columns["position"][end] - columns["position"][start]).max() < 1e-9
        assert columns["t"][end] > columns["t"][end - 1]
        assert columns["feed"][end] > 1.0
        assert columns["feed"][start] == pytest.approx(columns["feed"][end], rel=1e-12)
        # The slopes on either side are half an interval away from the joint each: jerk times that is what they differ by.
        before, after = slice(end - 1, end + 1), slice(start, start + 2)
        slopes = [np.diff(columns["feed"][some])[0] / np.diff(columns["t"][some])[0] for some in (before, after)]
        apart = 0.5 * sum(np.diff(columns["t"][some])[0] for some in (before, after))
        assert abs(slopes[1] - slopes[0]) < 3.0 * 2e4 * apart + 1.0
    moved = np.sqrt((np.diff(columns["position"], axis=0) ** 2).sum(axis=1)).sum()
    assert moved == pytest.approx(plan.length, rel=1e-3)


def test_interrupted_and_resumed_is_the_same(tmp_path, short_windows):
    source = winding(2600)
    once = separately(source, LIMITS, 0.01, output=tmp_path / "once.npz")

    class KilledError(Exception):
        pass

    def until(count):
        def progress(message, share):
            if message == f"window {count}":
                raise KilledError

        return progress

    table = tmp_path / "again.npz"
    work = tmp_path / "again.npz.windows"
    for count in (2, 4):
        with pytest.raises(KilledError):
            separately(source, LIMITS, 0.01, output=table, progress=until(count))
        assert work.is_dir()
        # A run killed between a window and its state leaves a window too many, one killed while writing a part of a file.
        (work / f"window-{count - 1:06d}.npz").write_bytes(b"torn")
        (work / ".feedplan-0123456789ab.part").write_bytes(b"torn")
        assert not table.exists()
    again = separately(source, LIMITS, 0.01, output=table)
    assert again.resumed == 3
    assert again.windows == once.windows
    assert not work.exists()
    assert again.lines.read_bytes() == once.lines.read_bytes()
    with np.load(once.table) as a, np.load(table) as b:
        assert a.files == b.files
        for name in a.files:
            assert np.array_equal(a[name], b[name]), name
    same = {name: getattr(once, name) for name in ("table", "lines", "resumed")}
    assert replace(again, **same) == once


def test_what_belongs_to_another_program_is_not_resumed(tmp_path, short_windows):
    def stop(message, share):
        if message == "window 2":
            raise KeyboardInterrupt

    table = tmp_path / "plan.npz"
    with pytest.raises(KeyboardInterrupt):
        separately(winding(1100), LIMITS, 0.01, output=table, progress=stop)
    before = {path: path.read_bytes() for path in (tmp_path / "plan.npz.windows").iterdir()}
    for source, limits, tolerance in (
        (winding(1100), LIMITS, 0.02),
        (winding(1101), LIMITS, 0.01),
        *((winding(1100), replace(LIMITS, **{name: 0.5}), 0.01) for name in SCALARS),
    ):
        with pytest.raises(
            InputError, match=r"state\.npz: belongs to another program, .*; to begin again, plan with --fresh"
        ):
            separately(source, limits, tolerance, output=table)
    assert {path: path.read_bytes() for path in (tmp_path / "plan.npz.windows").iterdir()} == before
    assert separately(winding(1100), LIMITS, 0.01, output=table, resume=False).resumed == 0


@pytest.fixture(scope="module")
def journal(tmp_path_factory):
    """The journal of a run that ended in its fourth window."""

    def stop(message, share):
        if message == "window 4":
            raise KeyboardInterrupt

    folder = tmp_path_factory.mktemp("windows")
    with pytest.MonkeyPatch.context() as patch:
        shorten_windows(patch)
        with pytest.raises(KeyboardInterrupt):
            separately(winding(2600), LIMITS, 0.01, output=folder / "plan.npz", progress=stop)
    return folder / "plan.npz.windows"


@pytest.fixture
def interrupted(tmp_path, journal, short_windows):
    """A copy of it, and a function that goes on with it."""
    work = tmp_path / journal.name
    shutil.copytree(journal, work)
    return work, lambda: separately(winding(2600), LIMITS, 0.01, output=tmp_path / "plan.npz")


def rewritten(path, **changes):
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    np.savez(path, **(arrays | {name: change(arrays[name]) for name, change in changes.items()}))


def in_header(change):
    """A change of the header of a state."""

    def changed(header):
        found = json.loads(str(header))
        change(found)
        return np.array(json.dumps(found))

    return changed


def nudged(k, factor):
    return lambda values: np.concatenate([values[:k], values[k : k + 1] * factor, values[k + 1 :]])


@pytest.mark.parametrize(
    ("name", "column", "change", "message"),
    [
        ("window-000001.npz", "u_acceleration", lambda v: v * 1.1, r"checks|table columns|follow|joint|feed|breaks"),
        ("window-000001.npz", "t", lambda v: v * 0.98, r"."),
        ("window-000001.npz", "feed", nudged(20, 1.01), r"."),
        ("window-000001.npz", "u_rate", nudged(0, 1.01), r"."),
        ("window-000001.npz", "t", lambda v: v[:-1], "no common length"),
        ("window-000001.npz", "u", lambda v: np.full_like(v, np.nan), "must be finite"),
        ("window-000001.npz", "position", lambda v: v + 1e-3, "its column position does not follow"),
        ("window-000001.npz", "seconds", nudged(3, 1.01), "its column seconds does not follow"),
        ("window-000001.npz", "row", lambda v: v + 1, "its column row does not follow"),
        ("window-000001.npz", "start", lambda v: v + 1.0, "its column start does not follow"),
        ("window-000001.npz", "edges", lambda v: v[:-1], "where no piece of the path does|parameter must increase"),
        ("window-000001.npz", "edges", lambda v: v[:0], "where no piece of the path does"),
        ("window-000001.npz", "binding", lambda v: (v + 1) % 5, "it names other limits"),
        ("window-000000.npz", "t", lambda v: v * 0.5, r"."),
        ("state.npz", "header", in_header(lambda h: h["done"].update(t=0.5 * h["done"]["t"])), "but the windows give"),
        ("state.npz", "header", in_header(lambda h: h["done"].update(windows=2)), "but the windows give"),
        ("state.npz", "header", in_header(lambda h: h["done"].update(windows=9)), "window-0000|the program ends"),
        ("state.npz", "header", in_header(lambda h: h["done"].update(windows="3")), "windows is no int"),
        ("state.npz", "header", in_header(lambda h: h["done"].update(worst=0.5)), "but the windows use"),
        ("state.npz", "header", in_header(lambda h: h["done"].pop("notes")), "its totals are not those"),
        ("state.npz", "header", in_header(lambda h: h["state"].update(feed=1.0)), "the state to go on from is not"),
        ("state.npz", "header", in_header(lambda h: h.update(state=None)), "does not end where the program does"),
        ("state.npz", "header", in_header(lambda h: h.update(format="feedplan windows 1")), "not of this version"),
        ("state.npz", "header", lambda h: np.array("{"), "it has no header"),
        ("state.npz", "queue.edges", lambda v: v * 1.001, "queue.edges is not that of the program"),
        ("state.npz", "queue.feed", lambda v: v * 2.0, "queue.feed is not that of the program"),
    ],
)
def test_a_journal_that_is_not_sound_is_refused(interrupted, name, column, change, message):
    work, go_on = interrupted
    rewritten(work / name, **{column: change})
    with pytest.raises(InputError, match=message) as caught:
        go_on()
    assert str(work / "") in str(caught.value)
    assert "to begin again, plan with --fresh" in str(caught.value)


def test_a_window_that_breaks_a_limit_does_not_count(interrupted):
    """A law that is sound in itself but too fast: everything that follows from it is changed as well."""
    work, go_on = interrupted
    rewritten(
        work / "window-000000.npz",
        t=lambda v: v / 1.02, u_rate=lambda v: v * 1.02, u_acceleration=lambda v: v * 1.02**2, feed=lambda v: v * 1.02,
        seconds=lambda v: v / 1.02, held=lambda v: v / 1.02,
    )  # fmt: skip
    with pytest.raises(InputError, match="it breaks a limit, which the run"):
        go_on()


@pytest.mark.parametrize("name", ["state.npz", "window-000001.npz"])
def test_a_damaged_journal_is_refused(interrupted, name):
    work, go_on = interrupted
    whole = (work / name).read_bytes()
    rng = np.random.default_rng(7)
    for k in range(30):
        data = bytearray(whole)
        if k % 3:
            for at in rng.integers(0, len(data), 3):
                data[at] ^= int(rng.integers(1, 256))
        else:
            data = data[: int(rng.integers(0, len(data)))]
        (work / name).write_bytes(data)
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            go_on()
        if k >= 8:  # each builds the path again
            break
    (work / name).write_bytes(whole)
    assert go_on().resumed == 3


def test_a_missing_window_is_named_and_the_command_says_how_to_go_on(interrupted):
    work, go_on = interrupted
    (work / "window-000002.npz").unlink()
    with pytest.raises(InputError, match=r"window-000002\.npz: is damaged \(cannot be read"):
        go_on()


def test_every_window_is_checked(tmp_path, short_windows, monkeypatch):
    """A planner that takes five percent more of the jerk than allowed, in one window, is found out."""
    counter = itertools.count()

    def eager(curve, limits, **options):
        if next(counter) == 1:
            limits = Limits(limits.feed, limits.velocity, limits.acceleration, 1.05 * limits.jerk, axes=limits.axes)
        return plan_feedrate(curve, limits, **options)

    monkeypatch.setattr(window, "plan_feedrate", eager)
    plan = separately(winding(1500), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert not plan.ok
    assert any("jerk" in text for text in plan.violations)
    assert plan.worst == pytest.approx(1.05, rel=1e-2)
    assert "# verdict = BREAKS ITS LIMITS: " in plan.lines.read_text()
    with np.load(plan.table) as table:
        assert str(table["verdict"]).startswith("BREAKS ITS LIMITS: ")
    checked = []
    monkeypatch.setattr(window, "plan_feedrate", plan_feedrate)
    monkeypatch.setattr(window, "check", lambda *args: checked.append(args) or check(*args))
    plan = separately(winding(1500), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert len(checked) == plan.windows


def test_where_no_state_serves_the_window_keeps_its_stop(tmp_path, short_windows, monkeypatch):
    def timid(curve, limits, **options):
        if options["start_feed"] > 0.0:
            raise InfeasibleError("no")
        return plan_feedrate(curve, limits, **options)

    monkeypatch.setattr(window, "plan_feedrate", timid)
    plan = separately(winding(1500), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.stops == plan.windows - 1 >= 1
    assert len([note for note in plan.notes if note.startswith("the plan rests after line ")]) == plan.stops
    assert plan.duration > whole_duration(winding(1500), 0.01)


def test_exact_stops_rapids_and_caps_as_in_the_whole(tmp_path, short_windows):
    """Windows that end at exact stops lose nothing; F words and rapids act as in the whole plan."""
    moves = []
    for k in range(6):
        x, y = 25.0 * k, 10.0
        moves += [line(x, y, feed=40.0), line(x + 5.0, y + 5.0, feed=60.0, stop=True), line(x + 12.0, y, feed=80.0)]
        moves += [rapid(x + 25.0, 0.0)]
    source = program(*moves)
    plan = separately(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.windows >= 3
    assert plan.stops == 0
    # A whole shares its intervals out among more sections, and is the coarser for it.
    whole = whole_duration(source, 0.01)
    assert 0.995 * whole < plan.duration < 1.001 * whole
    with np.load(plan.table) as table:
        capped = table["feed"].max()
    # the rapids, down to the right by 13 and 10 mm, are too short for the velocity of X
    assert 100.0 < capped < 250.0 * np.hypot(13.0, 10.0) / 13.0


def test_caps_of_a_window_are_those_of_its_blocks(tmp_path, short_windows, monkeypatch):
    found = []

    def seen(curve, limits, **options):
        found.append((curve.feed_caps, limits.feed))
        return plan_feedrate(curve, limits, **options)

    monkeypatch.setattr(window, "plan_feedrate", seen)
    source = winding(1500)
    feed = np.where(np.arange(1500) < 700, 30.0, 50.0)
    plan = separately(replace(source, feed=feed), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert any(isinstance(caps, FeedCaps) and caps.feed.tolist() == [30.0, 50.0] for caps, _ in found)
    assert {top for caps, top in found if caps is None} <= {30.0, 50.0}
    # Over 5 mm the length of the path is that of the blocks but for two percent.
    seconds = np.array(list(seconds_of(plan.lines).values())).reshape(-1, 50).sum(axis=1)
    feeds = source.lengths.reshape(-1, 50).sum(axis=1) / seconds
    assert 29.0 < feeds[:14].max() <= 30.6
    assert 45.0 < feeds[14:].max() <= 51.0


def source_of(moves_of, tolerance=0.01):
    return PathSource(moves_of, ProgramAxes.of(moves_of), tolerance, PLANE)


def joined_parts(source):
    cursor, run, rests, count = parts.first_cursor(), None, True, 0
    while cursor is not None:
        part, cursor = parts.next_part(source, cursor)
        run = part.run if run is None else run.joined(part.run, rests=rests)
        rests, count = part.rests, count + 1
    return run, count


def test_parts_cut_inside_a_tube_join_smoothly_and_within_tolerance(short_windows):
    source = winding(2600)
    run, count = joined_parts(source_of(source))
    assert count >= 3
    assert run.curve.breaks == ()  # C2 with a bounded third derivative, and here even that goes on
    assert run.row.tolist() == list(range(2600))
    blocks = MovingBlocks.of(source, 0.01)
    found = deviation(run.curve, blocks.programmed, run.at, run.s, 2.0)
    assert 5e-3 < found.largest <= 1e-2


def test_a_part_begins_with_no_sliver_beside_a_corner(short_windows):
    """Where a part begins at the end of a corner, this and the start of the tube behind it differ by rounding."""
    points = winding(1100).end[:, :2]
    source = polyline(np.concatenate([points + k * points[-1] for k in range(3)]))
    run, count = joined_parts(source_of(source))
    assert count >= 4
    whole = program_path(source, 0.01, PLANE, path="separate")
    assert np.diff(run.curve.edges).min() > 0.99 * np.diff(whole.curve.edges).min()


def test_parts_of_corners_are_the_whole_path(monkeypatch):
    """Cut between corners, a path does not depend on where."""
    monkeypatch.setattr(parts, "_FIRST_BLOCKS", 17)
    monkeypatch.setattr(parts, "_MAX_BLOCKS", 17)
    monkeypatch.setattr(parts, "_MIN_BLOCKS", 17)
    points = np.column_stack([7.0 * np.arange(80), 9.0 * (np.arange(80) % 2)])
    source = polyline(points)
    run, count = joined_parts(source_of(source))
    whole = program_path(source, 0.01, PLANE, path="separate")
    assert count >= 4
    assert run.length == pytest.approx(whole.curve.domain[1], abs=1e-9)
    assert np.abs(run.u - whole.u).max() < 1e-9
    u = np.linspace(0.0, min(whole.curve.domain[1], run.length), 2001)
    assert np.abs(run.curve.derivatives(u, 2) - whole.curve.derivatives(u, 2)).max() < 1e-6


def test_a_straight_program_is_cut_between_blocks(monkeypatch):
    monkeypatch.setattr(parts, "_FIRST_BLOCKS", 300)
    monkeypatch.setattr(parts, "_MAX_BLOCKS", 300)
    source = polyline(np.column_stack([0.5 * np.arange(1201), np.zeros(1201)]))
    run, count = joined_parts(source_of(source))
    assert count >= 4
    assert run.length == pytest.approx(600.0, abs=1e-9)
    assert run.curve.breaks == ()


@pytest.mark.parametrize(
    ("source", "limits", "name", "words"),
    [
        (winding(20), LIMITS, "plan.csv", r"ends in \.npz"),
        (program(line(0.0, 0.0)), LIMITS, "plan.npz", "moves nothing"),
        (winding(20), Limits(100.0, [250.0] * 2, [1000.0] * 2, [np.inf] * 2), "plan.npz", "finite"),
        (program(line(1.0, 0.0, 2.0)), PLANE, "plan.npz", "no axis Z"),
    ],
)
def test_refused(tmp_path, source, limits, name, words):
    with pytest.raises(InputError, match=words):
        separately(source, limits, 0.01, output=tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_state_is_named(tmp_path):
    work = tmp_path / "plan.npz.windows"
    work.mkdir()
    (work / "state.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"state\.npz: is damaged"):
        separately(winding(20), LIMITS, 0.01, output=tmp_path / "plan.npz")
    arguments = ["windows", str(SLOTS), "-o", str(tmp_path / "plan.npz")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2
    assert "state.npz: is damaged" in done.output
    assert f"to begin again, plan with --fresh, or delete the directory {work}" in " ".join(done.output.split("\n"))
    assert (work / "state.npz").read_bytes() == b"no archive"
    assert CliRunner().invoke(app, [*arguments, "--fresh", "--tolerance-mm", "0.01"]).exit_code == 0


def test_the_command(tmp_path):
    table = tmp_path / "plan.npz"
    options = ["--tolerance-mm", "0.01", "--path", "separate", "-o", str(table), "--json"]
    done = CliRunner().invoke(app, ["windows", str(SLOTS), *options])
    assert done.exit_code == 0
    verdict = json.loads(done.stdout)
    assert verdict["ok"]
    assert verdict["duration"] == pytest.approx(whole_duration(read_program(SLOTS), 0.01), rel=1e-4)
    assert table.is_file()
    assert Path(verdict["lines"]).is_file()
    assert CliRunner().invoke(app, ["windows", str(SLOTS), "-o", str(tmp_path / "plan.csv")]).exit_code == 2
    done = CliRunner().invoke(app, ["windows", "-h"])
    assert "\n    feedplan windows" in done.stdout
    assert max(len(line) for line in done.stdout.splitlines()) <= 80


def test_a_reserve_is_left_from_its_parameter_on():
    curve = program_path(winding(600), 0.01, PLANE, path="separate").curve
    begins = 0.5 * curve.domain[1]
    profile = plan_feedrate(curve, PLANE, reserve=[(begins, 0.05)])
    nodes = TimeLaw(profile.t, profile.u, profile.u_rate, profile.u_acceleration)
    jerk = utilisation(curve, PLANE, nodes).jerk
    after = profile.u[:-1] >= begins
    assert 0.94 < jerk[after].max() < 0.955
    assert jerk[~after].max() > 0.99
    for reserve in ([(begins, 1.0)], [(begins, 0.1), (0.0, 0.2)]):
        with pytest.raises(InputError, match="reserve"):
            plan_feedrate(curve, PLANE, reserve=reserve)


@pytest.mark.parametrize("lead", [0.1, 1.0, 1.9, 2.5])
def test_a_corner_shortly_after_the_start_is_that_of_the_whole_program(tmp_path, lead):
    """The run of chords behind it is a tube of its own: reaching back to the start it was cut into stops."""
    angle = np.linspace(0.0, 1.0, 100)
    chords = "".join(f"G1 X{20.0 * np.cos(a) - 20.0:.4f} Y{20.0 * np.sin(a):.4f}\n" for a in angle[1:])
    (tmp_path / "lead.ngc").write_text(f"G21 G90 G64 P0.01\nG0 X{-lead} Y0\nG1 X0 F6000\n{chords}M2\n")
    source = read_program(tmp_path / "lead.ngc")
    plan = separately(source, LIMITS, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.stops == 0
    assert plan.duration == pytest.approx(whole_duration(source, None), rel=2e-4)


@pytest.mark.parametrize("lead", [0.5, 1.0])
def test_a_stop_shortly_after_the_start_is_kept(tmp_path, lead):
    """Where a tube begins at it, too: the tube must not begin before it, at the start."""
    angle = np.linspace(0.0, 1.0, 40)
    chords = [line(20.0 * np.sin(a), 20.0 - 20.0 * np.cos(a)) for a in angle[1:]]
    source = program(line(0.0, 0.0, stop=True), *chords, start=(-lead, 0.0, 0.0))
    plan = separately(source, LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.duration == pytest.approx(whole_duration(source, 0.01), rel=1e-6)
    with np.load(plan.table) as table:
        at_rest = table["position"][table["feed"] == 0.0]
    assert np.abs(at_rest - [0.0, 0.0]).max(axis=1).min() < 1e-9
