"""Windows with a second process: the same files to the last bit, whatever becomes of it, and none that is left behind."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from cases import drives
from program_blocks import line, polyline, program, rapid

from planner import SolverError
from planner.programs.long import part_runs, parts, path_ahead, runs_beside, window
from planner.programs.long.path_ahead import make_parts
from planner.programs.long.runs_beside import RunsBeside
from planner.programs.long.windows import plan_program
from planner.programs.long.worker import Worker, WorkerEndedError

LIMITS = drives(dim=3, axes=("X", "Y", "Z"))


def shorten():
    """Windows of a few hundred intervals, parts of a few hundred blocks or pieces."""
    window._WINDOW = 300
    parts._FIRST_BLOCKS = parts._MAX_BLOCKS = 600
    parts._MIN_BLOCKS = 300
    part_runs._WANTED_PIECES = 400


def make_short_parts(receive, send):
    """Make parts, in a process that shares no constant with this one."""
    shorten()
    make_parts(receive, send)


@pytest.fixture
def workers(monkeypatch):
    """The processes that are started from here; windows and parts are short."""
    started = []

    class Seen(Worker):
        def __init__(self, work, first):
            super().__init__(work, first)
            started.append(self)

    for module, name in ((window, "_WINDOW"), (part_runs, "_WANTED_PIECES")):
        monkeypatch.setattr(module, name, getattr(module, name))
    for name in ("_FIRST_BLOCKS", "_MAX_BLOCKS", "_MIN_BLOCKS"):
        monkeypatch.setattr(parts, name, getattr(parts, name))
    shorten()
    monkeypatch.setattr(path_ahead, "Worker", Seen)
    monkeypatch.setattr(path_ahead, "make_parts", make_short_parts)
    return started


def winding():
    """Segments of 0.1 mm along a curve that turns all the time: its windows end in the middle of the motion."""
    s = 0.1 * np.arange(1800)
    heading = 0.9 * np.sin(s / 2.3) + 1.1 * np.sin(s / 6.1 + 1.0)
    points = np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    return polyline(np.round(np.concatenate([[[0.0, 0.0]], points]), 3))


def zigzags():
    """Passes of teeth with a stop in each, and rapids between them: runs that are found together with their feed."""
    moves = []
    for k in range(10):
        y = 20.0 * k
        moves.append(rapid(0.0, y))
        for tooth in range(5):
            moves.append(line(4.0 * tooth + 2.0 + 0.1 * k, y + 3.0))
            moves.append(line(4.0 * tooth + 4.0, y, **({"stop": True} if tooth == 2 else {})))
    return program(*moves)


separately = partial(plan_program, path="separate")


def files(plan):
    return plan.table.read_bytes(), plan.lines.read_bytes()


def stopped_at(count, act):
    """A progress that acts when a window begins."""

    def progress(message, share):
        if message == f"window {count}":
            act()

    return progress


def ended(workers):
    return all(worker._process.returncode is not None for worker in workers)


@pytest.mark.parametrize(("source", "path"), [(winding, "separate"), (zigzags, "joint")])
def test_two_processes_write_what_one_writes(tmp_path, workers, source, path):
    one, two = (
        plan_program(source(), LIMITS, 0.01, output=tmp_path / f"{cores}.npz", cores=cores, path=path)
        for cores in (1, 2)
    )
    assert one.ok
    assert one.windows >= 3
    assert files(one) == files(two)
    assert one.notes == two.notes
    assert len(workers) == 1
    assert ended(workers)


def make_one_part_and_die(receive, send):
    """Hand over a part; then be killed."""
    shorten()

    def once(made):
        send(made)
        os.kill(os.getpid(), signal.SIGKILL)

    make_parts(receive, once)


def test_where_the_second_process_is_killed_the_first_goes_on_alone(tmp_path, workers, monkeypatch):
    one = separately(winding(), LIMITS, 0.01, output=tmp_path / "one.npz")
    monkeypatch.setattr(path_ahead, "make_parts", make_one_part_and_die)
    two = separately(winding(), LIMITS, 0.01, output=tmp_path / "two.npz", cores=2)
    assert files(one) == files(two)
    said = "the second process ended (status -9); from there on the path was made by the one of the plan"
    assert two.notes == (*one.notes, said)
    assert len(workers) == 1
    assert ended(workers)


def test_where_no_second_process_can_be_started_one_does_all(tmp_path, workers, monkeypatch):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "nothing"))
    plan = separately(winding(), LIMITS, 0.01, output=tmp_path / "plan.npz", cores=2)
    assert plan.ok
    assert plan.notes[-1].startswith("no second process could be started (")
    assert workers == []


def test_interrupted_with_two_and_resumed_with_either_is_the_same(tmp_path, workers):
    once = separately(winding(), LIMITS, 0.01, output=tmp_path / "once.npz")

    def interrupt():
        raise KeyboardInterrupt

    for cores in (1, 2):
        table = tmp_path / f"again-{cores}.npz"
        with pytest.raises(KeyboardInterrupt):
            separately(winding(), LIMITS, 0.01, output=table, progress=stopped_at(3, interrupt), cores=2)
        assert ended(workers)
        again = separately(winding(), LIMITS, 0.01, output=table, cores=cores)
        assert again.resumed == 2
        assert files(again) == files(once)
        assert ended(workers)
    assert len(workers) == 3  # two of the runs that were interrupted, and one that verified what was left


def make_one_part(receive, send):
    """Make a part, and fail with the next."""
    shorten()

    def once(message):
        send(message)
        raise SolverError("no path")

    make_parts(receive, once)


def test_a_path_that_cannot_be_made_is_the_error_of_one_process(tmp_path, workers, monkeypatch):
    """The process beside ends with it, and here it is found again."""
    given = []

    def next_part(source, cursor):
        if given:
            raise SolverError("no path")
        given.append(cursor)
        return parts.next_part(source, cursor)

    monkeypatch.setattr(path_ahead, "make_parts", make_one_part)
    monkeypatch.setattr(path_ahead, "next_part", next_part)
    for cores in (1, 2):
        with pytest.raises(SolverError, match="no path"):
            separately(winding(), LIMITS, 0.01, output=tmp_path / f"{cores}.npz", cores=cores)
        given = [None]
    assert len(workers) == 1
    assert ended(workers)


def test_few_moves_are_left_to_one_process(tmp_path, workers):
    assert plan_program(polyline([[0, 0], [9, 0], [9, 9]]), LIMITS, 0.01, output=tmp_path / "p.npz", cores=2).ok
    assert workers == []


class Sight:
    """Runs of numbers instead of blocks: ``run`` says who found which, and takes its time."""

    first, blocks, junctions = 0, None, None

    def __init__(self, source=None, *_):
        self.source = source

    def run(self, first, last):
        time.sleep(0.02)
        return (os.getpid(), first, last)

    def found(self, pairs):
        return (self.run(*pair) for pair in pairs)


def find_in_sight(receive, send):
    runs_beside.RunsInSight = Sight
    runs_beside.find_each(receive, send)


@pytest.mark.parametrize("kill", [False, True])
def test_runs_come_in_order_whoever_finds_them(monkeypatch, kill):
    started = []

    class Seen(Worker):
        def __init__(self, work, first):
            super().__init__(find_in_sight, first)
            started.append(self)

    monkeypatch.setattr(runs_beside, "Worker", Seen)
    pairs = [(k, k + 1) for k in range(60)]
    with RunsBeside(SimpleNamespace()) as beside:
        for _ in range(2):
            found = []
            for k, run in enumerate(beside.found(Sight(), pairs)):
                found.append(run)
                if kill and k == 50 and not beside.lost:
                    os.kill(started[0].pid, signal.SIGKILL)
            assert [run[1:] for run in found] == pairs
        here = sum(run[0] == os.getpid() for run in found)
        assert here == 60 if kill else 20 <= here <= 40
        # Whoever stops in the middle, as a part does, leaves nothing that the next would take for its own.
        few = beside.found(Sight(), pairs)
        assert next(few)[1:] == pairs[0]
        few.close()
        assert [run[1:] for run in beside.found(Sight(), pairs[30:])] == pairs[30:]
        assert beside.lost == kill
    assert ended(started)


def echo(receive, send):
    """Send back what comes, and print."""
    while True:
        message = receive()
        print("printed", message, flush=True)
        send(message)


def test_what_a_worker_prints_comes_between_no_objects():
    worker = Worker(echo, [1])
    try:
        assert worker.receive() == [1]
        worker.send({"two": np.arange(100_000)})
        assert worker.receive()["two"].sum() == np.arange(100_000).sum()
    finally:
        worker.close()
    with pytest.raises(WorkerEndedError):
        worker.send(3)


def half(receive, send):
    """End in the middle of an object."""
    receive()
    sys.exit(3)


def test_a_worker_that_ends_says_its_status():
    worker = Worker(half, 1)
    with pytest.raises(WorkerEndedError, match=r"the second process ended \(status 3\)"):
        worker.receive()


def test_a_break_at_the_keyboard_ends_both_and_the_next_run_goes_on(tmp_path):
    """As a terminal sends it: to all processes in the foreground."""
    source = tmp_path / "long.ngc"
    points = winding().end[:, :2]
    many = np.concatenate([points + 1.001 * k * points[-1] for k in range(4)])
    source.write_text("G21 G90 G64 P0.01 F6000\n" + "".join(f"G1 X{x:.3f} Y{y:.3f}\n" for x, y in many) + "M2\n")
    table = tmp_path / "long.npz"
    command = [sys.executable, "-m", "feedplan", "windows", str(source), "--machine", "mill", "-o", str(table)]
    going = subprocess.Popen(
        [*command, "--cores", "2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    state = tmp_path / "long.npz.windows" / "state.npz"
    while not state.exists():
        assert going.poll() is None, going.communicate()
        time.sleep(0.01)
    os.killpg(going.pid, signal.SIGINT)
    _, said = going.communicate(timeout=20)
    assert going.returncode == 130
    assert "Traceback" not in said
    assert not table.exists()
    again = subprocess.run([*command, "--cores", "2"], capture_output=True, text=True, check=True)
    assert "of them by an earlier run" in again.stdout
