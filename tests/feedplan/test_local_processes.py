"""Real processes: they work side by side, die alone, and end with their parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import batch_work
import pytest
from cases import PROJECT

from feedplan.batch import BatchTask, run_batch
from feedplan.local_processes import LocalProcesses, core_count
from planner.errors import InfeasibleError, InputError


def task(key, work, *arguments):
    return BatchTask(key, key, work, lambda: arguments)


@pytest.fixture(scope="module")
def two():
    with LocalProcesses(2) as pool:
        yield pool


def alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def eventually(holds, seconds=20.0):
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.02)
    return holds()


def test_every_core_that_the_process_may_use_is_one(monkeypatch):
    assert core_count() == len(os.sched_getaffinity(0))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 3, 5})
    assert LocalProcesses().room() == 3


@pytest.mark.parametrize("count", [0, -1, 1.5, True, "2"])
def test_a_count_of_processes_that_is_none_is_refused(count):
    with pytest.raises(InputError, match="count = "):
        LocalProcesses(count)


def test_tasks_are_done_in_other_processes_two_at_a_time(two):
    found = run_batch([task(str(k), batch_work.process_id, k) for k in range(6)], two).outcomes
    processes = {outcome.value for outcome in found.values()}
    assert os.getpid() not in processes
    assert len(processes) == 2


def test_a_process_computes_with_one_thread_unless_the_user_says_more(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    before = dict(os.environ)
    with LocalProcesses(1) as pool:
        assert run_batch([task("a", batch_work.threads, 0)], pool).outcomes["a"].value == ["3", "1", "1"]
    assert dict(os.environ) == before


def test_errors_come_back_and_the_process_goes_on(two):
    tasks = [
        task("refused", batch_work.refuse, "no plan for part.ngc"),
        task("wrong", batch_work.fail, "of a kind nobody thought of"),
        task("large", batch_work.exhaust, 0),
        task("good", batch_work.double, 21),
    ]
    found = run_batch(tasks, two).outcomes
    assert isinstance(found["refused"].error, InfeasibleError)
    assert str(found["refused"].error) == "no plan for part.ngc"
    assert "unexpected ZeroDivisionError: of a kind nobody thought of" in str(found["wrong"].error)
    assert "memory" in str(found["large"].error)
    assert found["good"].value == 42


def test_a_death_is_the_end_of_one_task_and_of_no_other(tmp_path, two):
    """Four others run while it dies; each is begun once, the one that dies twice."""
    tasks = [task("dies", batch_work.die, tmp_path / "dies")]
    tasks += [task(f"other {k}", batch_work.noted_sleep, tmp_path / str(k), 0.2) for k in range(4)]
    found = run_batch(tasks, two).outcomes
    assert "the process that worked on it died, twice" in str(found["dies"].error)
    assert all(isinstance(found[f"other {k}"].value, int) for k in range(4))
    assert [batch_work.begun(tmp_path / name) for name in ("dies", "0", "1", "2", "3")] == [2, 1, 1, 1, 1]


def test_a_task_whose_process_died_once_is_done_by_another(tmp_path, two):
    found = run_batch([task("a", batch_work.die_once, tmp_path / "a"), task("b", batch_work.double, 1)], two).outcomes
    assert (found["a"].value, found["b"].value) == ("done", 2)
    assert batch_work.begun(tmp_path / "a") == 2


def test_a_process_that_died_while_it_had_nothing_to_do_is_replaced():
    with LocalProcesses(1) as pool:
        process = run_batch([task("a", batch_work.process_id, 0)], pool).outcomes["a"].value
        os.kill(process, signal.SIGKILL)
        assert run_batch([task("b", batch_work.double, 2)], pool).outcomes["b"].value == 4


def test_an_interrupt_ends_processes_in_the_middle_of_their_tasks(tmp_path):
    marks = tmp_path / "marks"

    def interrupt():
        assert eventually(lambda: batch_work.begun(marks) == 1)
        signal.raise_signal(signal.SIGINT)

    timer = threading.Thread(target=interrupt)
    with LocalProcesses(1) as pool:
        began = time.monotonic()
        timer.start()
        found = run_batch([task("a", batch_work.double, 1), task("b", batch_work.noted_sleep, marks, 60.0)], pool)
    timer.join()
    assert found.interrupted
    assert found.outcomes["a"].value == 2
    assert "interrupted" in str(found.outcomes["b"].error)
    assert time.monotonic() - began < 20.0
    process = int(next(marks.iterdir()).name.partition("-")[2])
    assert eventually(lambda: not alive(process))


def test_processes_end_when_their_parent_is_killed(tmp_path):
    script = f"""
import sys
sys.path[:0] = [{str(PROJECT)!r}, {str(PROJECT / "tests")!r}]
import batch_work
from feedplan.batch import BatchTask, run_batch
from feedplan.local_processes import LocalProcesses
if __name__ == "__main__":
    with LocalProcesses(1) as pool:
        run_batch([BatchTask("a", "a", batch_work.noted_sleep, lambda: ({str(tmp_path / "a")!r}, 60.0))], pool)
"""
    file = tmp_path / "parent.py"
    file.write_text(script)
    with subprocess.Popen([sys.executable, str(file)]) as parent:
        assert eventually(lambda: batch_work.begun(tmp_path / "a") == 1)
        process = int(next((tmp_path / "a").iterdir()).name.partition("-")[2])
        assert alive(process)
        parent.kill()
    assert eventually(lambda: not alive(process))
