"""Rows of many programs, for people and for other programs."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import click
import numpy as np
import pytest
from texts import flat, strict_json

from feedplan.batch import UnfinishedError
from feedplan.batch_text import row_facts, rows_facts, rows_json, rows_text, write_rows
from feedplan.batch_times import CaseTime, NamedMachine, TimeRow, TimeRows, TimingCase
from feedplan.program_files import ProgramFile
from planner.errors import InfeasibleError, InputError
from planner.machine.machine_file import read_machine

MACHINE = NamedMachine("mill.toml", read_machine("mill"))


def row(name, time=None, error=None):
    return TimeRow(TimingCase(ProgramFile(Path("parts") / name, name), MACHINE, 0.01), time, error)


def case_time(total, *, dwell=0.0, changes=0, worst="", notes=()):
    return CaseTime(total - dwell, dwell, changes, None, total, "acceleration X", 0.625, worst, notes)


@pytest.fixture
def found():
    return TimeRows(
        (
            row("a.ngc", case_time(3725.4, dwell=12.5, changes=3, notes=("rapids have no feed",))),
            row("b.ngc", error=InputError("b.ngc:2: H: a letter needs a number after it")),
            row("c.ngc", case_time(7.6, worst="jerk X: 1.5 times what is allowed", notes=("rapids have no feed",))),
            row("d.ngc", error=InfeasibleError("no feed keeps the limits")),
            row("e.ngc", error=UnfinishedError("interrupted before it was done")),
        )
    )


def test_a_person_reads_a_row_each_the_total_and_why_others_have_none(found, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    lines = list(map(click.unstyle, rows_text(found, ["parts: not timed: notes.txt"], "out.csv")))
    text = flat("\n".join(lines))
    plain = [" ".join(flat(line).split()) for line in lines]
    assert "a.ngc 1:02:05 3712.90 12.50 3 acceleration X 62% ok" in plain
    assert "b.ngc bad input" in plain
    assert "c.ngc 0:00:08 7.60 acceleration X 62% limit broken" in plain
    assert "d.ngc no plan" in plain
    assert "e.ngc not done" in plain
    assert "1:02:13 or 3733 s, 2 of 5 programs" in text
    assert "3 are not in it, for nobody says how long one takes: --tool-change-s" in text
    assert "b.ngc:2: H: a letter needs a number after it" in text
    assert "b.ngc: b.ngc" not in text
    assert "c.ngc: LIMIT BROKEN jerk X: 1.5 times what is allowed" in text
    assert "d.ngc: no feed keeps the limits" in text
    assert "parts: not timed: notes.txt" in text
    assert "a.ngc and 1 more: rapids have no feed" in text
    assert text.count("rapids have no feed") == 1
    assert "out.csv" in text


def test_columns_that_no_program_has_are_left_out():
    text = "\n".join(rows_text(TimeRows((row("a.ngc", case_time(5.0)),)), []))
    assert "dwells" not in text
    assert "changes" not in text
    assert "1 program" in text
    assert "1 programs" not in text


def test_the_same_for_a_program(found):
    facts = strict_json(rows_json(found, ["a note"], rows_facts(found)))
    assert (facts["ok"], facts["count"], facts["timed"], facts["interrupted"]) == (False, 5, 2, False)
    assert facts["total_s"] == math.fsum([3725.4, 7.6])
    assert facts["notes"] == ["a note"]
    assert facts["programs"] == json.loads(json.dumps([row_facts(row) for row in found.rows]))
    first, second = facts["programs"][:2]
    assert (first["program"], first["file"], first["machine"]) == ("a.ngc", "parts/a.ngc", "mill.toml")
    assert (first["total_s"], first["dwell_s"], first["tool_changes"], first["held_back_by"]) == (
        3725.4,
        12.5,
        3,
        "acceleration X",
    )
    assert (second["total_s"], second["verdict"]) == (None, "bad input")


def test_files_hold_the_same_rows(found, tmp_path):
    facts = [row_facts(row) for row in found.rows]
    write_rows(tmp_path / "t.csv", facts)
    with (tmp_path / "t.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [row["total_s"] for row in read] == ["3725.4", "", "7.6", "", ""]
    assert [row["reason"] for row in read] == [row["reason"] for row in facts]
    write_rows(tmp_path / "t.npz", facts)
    with np.load(tmp_path / "t.npz", allow_pickle=False) as archive:
        assert list(archive) == list(facts[0])
        np.testing.assert_array_equal(archive["total_s"], [3725.4, np.nan, 7.6, np.nan, np.nan])
        assert archive["verdict"].tolist() == ["ok", "bad input", "limit broken", "no plan", "not done"]
        assert archive["tolerance_mm"].dtype == np.float64
    first = (tmp_path / "t.npz").read_bytes()
    write_rows(tmp_path / "t.npz", facts)
    assert (tmp_path / "t.npz").read_bytes() == first
