"""``feedplan sweep`` as a shell runs it."""

from __future__ import annotations

import csv

import pytest
from texts import flat, strict_json

MOVES = "G21 G90 G0 X0 Y0\nG64 P0.02\nF1200\nG1 X10\nY15\nX0\nY0\nM2\n"


@pytest.fixture
def part(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.ngc").write_text(MOVES)
    return tmp_path


def test_every_combination_is_a_row(run, part):
    code, out, err = run(
        "sweep", "part.ngc", "--machine", "mill", "--machine", "four-axis", "--tolerance-mm", "0.01,0.05",
        "--scale", "jerk=1,4", "-o", "out.csv", "--json", "--jobs", 1,
    )  # fmt: skip
    assert (code, err) == (0, "")
    rows = strict_json(out)["programs"]
    assert [(row["machine"], row["tolerance_mm"], row["scale_jerk"]) for row in rows] == [
        (machine, tolerance, jerk)
        for machine in ("mill", "four-axis")
        for tolerance in (0.01, 0.05)
        for jerk in (1.0, 4.0)
    ]
    assert [row["saved_s"] > 0.0 for row in rows[1:4]] == [True] * 3
    with (part / "out.csv").open(newline="") as file:
        assert [float(row["total_s"]) for row in csv.DictReader(file)] == [row["total_s"] for row in rows]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--scale", "speed=2"], '--scale "speed=2": must be a limit and its factors'),
        (["--scale", "feed=2", "--feed-mm-s", "10"], "--scale feed multiplies the feed of the machine"),
        (["--tolerance-mm", "0.01,0.01"], "--tolerance-mm: 0.01 is given twice"),
        (["--machine", "mill", "--machine", "mill"], "--machine mill: is given twice"),
        (["--machine", "none.toml"], "none.toml"),
        (["-o", "part.ngc"], "part.ngc: "),
    ],
)
def test_what_is_refused_before_the_work_begins(run, part, arguments, text):
    code, out, err = run("sweep", "part.ngc", *arguments)
    assert (code, out) == (2, "")
    assert text in flat(err)


def test_a_combination_that_fails_is_a_row(run, part):
    (part / "wrong.ngc").write_text("G1 X5 H\nM2\n")
    code, out, _ = run("sweep", "part.ngc", "wrong.ngc", "--scale", "jerk=2", "--jobs", 1)
    assert code == 2
    assert flat(out).count("wrong.ngc:1: H: a letter needs a number after it") == 2
