"""Many programs on the command line: one table, the worst exit code, and an end at any time."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import click
import pytest
from cases import PROJECT
from texts import flat, strict_json

MOVES = "G21 G90 G0 X0 Y0\nG64 P0.02\nF1200\nG1 X{0}\nY15\nX0\nY0\nM2\n"
# Hundreds of corners: seconds of work.
LONG = (
    "G21 G90 G0 X0 Y0\nG64 P0.02\nF1200\n"
    + "".join(f"G1 X{k % 7 * 3 + (k % 2)} Y{k % 5 * 2}\n" for k in range(1, 6000))
    + "M2\n"
)


@pytest.fixture
def parts(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, size in (("a", 10), ("b", 20)):
        (tmp_path / f"{name}.ngc").write_text(MOVES.format(size))
    return tmp_path


def words(text):
    return [" ".join(click.unstyle(line).split()) for line in text.splitlines()]


def test_a_row_each_in_the_order_given_and_the_total(run, parts):
    code, out, err = run("time", "b.ngc", "a.ngc", "--machine", "mill", "--jobs", 1)
    assert (code, err) == (0, "")
    rows = [line for line in words(out) if re.match(r"[ab]\.ngc 0:00:\d\d \d+\.\d\d .* \d+% ok$", line)]
    assert [row[0] for row in rows] == ["b", "a"]
    assert re.search(r"total\s+0:00:\d\d or [\d.]+ s, 2 programs", click.unstyle(out))


def test_the_worst_code_is_that_of_the_command_and_the_others_have_their_rows(run, parts):
    (parts / "c.ngc").write_text("G0 X0 Y0\nG1 X10 F600 H\nM2\n")
    (parts / "readme.md").touch()
    code, out, err = run("time", ".", "--machine", "mill", "--jobs", 1, "-o", "out.csv", "--json")
    assert (code, err) == (2, "")
    facts = strict_json(out)
    assert [(row["program"], row["ok"]) for row in facts["programs"]] == [
        ("a.ngc", True),
        ("b.ngc", True),
        ("c.ngc", False),
    ]
    assert facts["programs"][2]["reason"].startswith("c.ngc:2: H")
    assert facts["notes"] == [".: not timed: readme.md"]
    with (parts / "out.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    assert [row["program"] for row in written] == ["a.ngc", "b.ngc", "c.ngc"]
    assert float(written[0]["total_s"]) == facts["programs"][0]["total_s"]


def test_the_same_table_from_one_process_and_from_two(run, parts):
    one, two = (run("time", ".", "--machine", "mill", "--jobs", jobs) for jobs in (1, 2))
    assert one == two


def test_standard_output_may_be_the_file(run, parts):
    code, out, err = run("time", "a.ngc", "b.ngc", "--jobs", 1, "-o", "-")
    assert code == 0
    assert [row["program"] for row in csv.DictReader(out.splitlines())] == ["a.ngc", "b.ngc"]
    assert "total" in err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["a.ngc", "b.ngc", "--rows", "3"], "--rows is for one program, and several are named"),
        (["a.ngc", "b.ngc", "--tolerances-um", "1,2"], "--tolerances-um is for one program"),
        (["a.ngc", "b.ngc", "-o", "b.ngc"], "b.ngc: "),
        (["a.ngc", "b.ngc", "-o", "x.xlsx"], 'the suffix ".xlsx" must be'),
        (["a.ngc", "b.ngc", "--machine", "none.toml"], "none.toml"),
        (["a.ngc", "--scheduler", "cluster"], 'scheduler "cluster" must be tcp://host:port'),
        (["a.ngc", "--scheduler", "tcp://127.0.0.1:99999"], "with a port up to 65535"),
        (["empty/"], "has no part program"),
        (["a.ngc", "--jobs", "0"], "0 is not in the range"),
    ],
)
def test_what_is_refused_before_the_work_begins(run, parts, arguments, text):
    (parts / "empty").mkdir()
    code, out, err = run("time", *arguments)
    assert (code, out) == (2, "")
    assert text in flat(err)


def test_an_interrupt_shows_what_was_done(parts):
    (parts / "long.ngc").write_text(LONG)
    command = [
        sys.executable,
        "-m",
        "feedplan",
        "time",
        "a.ngc",
        "long.ngc",
        "b.ngc",
        "--machine",
        "mill",
        "--jobs",
        "1",
    ]
    command += ["-o", "out.csv"]
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as shell:
        end = time.monotonic() + 60.0
        children = Path(f"/proc/{shell.pid}/task/{shell.pid}/children")
        while not children.read_text() and time.monotonic() < end:
            time.sleep(0.05)
        time.sleep(3.0)
        os.killpg(shell.pid, signal.SIGINT)  # as a terminal does: to all of them
        out, err = shell.communicate(timeout=60)
    assert shell.returncode == 130
    assert "Traceback" not in err
    rows = dict(line.split(maxsplit=1) for line in words(out) if re.match(r"(a|long|b)\.ngc ", line))
    assert rows["long.ngc"] == "not done"
    assert "long.ngc: interrupted before it was done" in flat(out)
    with (parts / "out.csv").open(newline="") as file:
        assert [row["program"] for row in csv.DictReader(file)] == ["a.ngc", "long.ngc", "b.ngc"]


@pytest.fixture(scope="module")
def cluster():
    """Two processes that work, with a scheduler in this one."""
    distributed = pytest.importorskip("distributed")  # an extra: feedplan[dask]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as found:
        yield found


class TestOnACluster:
    def test_the_table_is_that_of_this_machine_also_when_a_worker_is_killed(self, run, parts, cluster):
        """Nothing is lost, and nothing counted twice; what a program calls travels with it."""
        for k in range(3):
            (parts / f"c{k}.ngc").write_text(MOVES.format(10 + k).replace("X0\nY0", "o<back> call"))
        (parts / "back.nc").write_text("o<back> sub\nX0\nY0\no<back> endsub\nM2\n")
        (parts / "wrong.ngc").write_text("G1 X10 F600 H\nM2\n")
        programs = [path.name for path in sorted(parts.glob("*.ngc"))]
        here = run("time", *programs, "--machine", "mill", "--json")
        worker = next(iter(cluster.workers.values()))
        killer = threading.Timer(1.0, os.kill, (worker.pid, signal.SIGKILL))
        killer.start()
        there = run("time", *programs, "--machine", "mill", "--json", "--scheduler", cluster.scheduler_address)
        killer.join()
        assert there == here
        assert here[0] == 2
        assert [row["program"] for row in strict_json(here[1])["programs"]] == programs

    def test_a_sweep_is_too(self, run, parts, cluster):
        arguments = ["sweep", "a.ngc", "b.ngc", "--scale", "jerk=1,2", "--json"]
        assert run(*arguments, "--scheduler", cluster.scheduler_address) == run(*arguments)
