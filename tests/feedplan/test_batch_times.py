"""Times of many programs: those of each alone, in other processes, with the names that files have at home."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from cases import PROGRAMS

from feedplan.batch_times import NamedMachine, TimingCase, TimingOptions, time_programs
from feedplan.local_processes import LocalProcesses
from feedplan.program_files import find_programs
from feedplan.program_time import time_program
from planner.errors import InputError
from planner.machine.machine_file import read_machine

MOVES = "G21 G90 G0 X0 Y0\nG64 P0.02\nF1200\nG1 X20\nY15\nG4 P0.5\nT2 M6\nX0\nY0\nM2\n"
TOOLS = "T1 P1 Z10 D6\nT2 P2 Z20 D8\n"


@pytest.fixture(scope="module")
def two():
    with LocalProcesses(2) as pool:
        yield pool


@pytest.fixture(scope="module")
def mill():
    return NamedMachine("mill", read_machine("mill"))


def cases_of(files, machine, **more):
    return [TimingCase(file, machine, **more) for file in find_programs(list(map(str, files)))[0]]


def numbers(found):
    return [(row.case.key, row.time, row.reason) for row in found.rows]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "part.ngc").write_text(MOVES)
    (tmp_path / "wrong.ngc").write_text("G0 X0 Y0\nG1 X10 F600 H\nM2\n")
    (tmp_path / "empty.ngc").touch()
    (tmp_path / "bytes.ngc").write_bytes(bytes(range(256)))
    (tmp_path / "link.ngc").symlink_to("nowhere")
    return tmp_path


def test_the_rows_are_the_times_of_each_alone(two, mill, folder):
    files = [PROGRAMS / "stops.ngc", folder / "part.ngc"]
    found = time_programs(cases_of(files, mill), two)
    for file, row in zip(files, found.rows, strict=True):
        alone = time_program(file, "mill")
        assert (row.case.file.label, row.ok) == (file.name, alone.ok)
        assert row.time.motion_s == pytest.approx(alone.motion_s, rel=1e-12)
        assert row.total_s == pytest.approx(alone.total_s, rel=1e-12)
        assert row.time.share == max(share for limit, share in alone.shares.items() if limit != "none")
        assert alone.shares[row.time.held_by] == row.time.share


def test_one_process_finds_the_same_as_two(two, mill, folder):
    files = [PROGRAMS / "stops.ngc", *sorted(folder.iterdir())]
    cases = cases_of(files, mill)
    with LocalProcesses(1) as one:
        assert numbers(time_programs(cases, one)) == numbers(time_programs(cases, two))


def test_a_program_that_fails_does_not_stop_the_rest_and_says_why_by_its_name(two, mill, folder):
    names = ("wrong", "part", "empty", "link", "bytes")
    found = time_programs(cases_of([folder / f"{name}.ngc" for name in names], mill), two)
    reasons = {row.case.file.label: row.reason for row in found.rows}
    assert list(reasons) == [f"{name}.ngc" for name in names]
    assert reasons["part.ngc"] == ""
    assert reasons["wrong.ngc"].startswith("wrong.ngc:2: H")
    assert reasons["empty.ngc"] == "empty.ngc: is empty; the file may have been cut off"
    assert reasons["bytes.ngc"].startswith("bytes.ngc")
    assert all(isinstance(row.error, InputError) for row in found.rows if not row.ok)
    assert all(math.isnan(row.total_s) for row in found.rows if not row.ok)


def test_files_that_a_program_calls_travel_with_it(two, mill, tmp_path):
    """By name, by number, by M98, by a number that is computed, and from one that is called."""
    (tmp_path / "corner.ngc").write_text("o<corner> sub\nG1 Y5\no<200> call\no<corner> endsub\nM2\n")
    (tmp_path / "200.ngc").write_text("o200 sub\nG1 X0\no200 endsub\nM2\n")
    (tmp_path / "201.ngc").write_text("O201\nG1 Y5\nM99\n")
    (tmp_path / "other.ngc").write_text("G1 X5\nM2\n")
    files = []
    for name, line in (("name", "o<corner> call"), ("number", "o200 call"), ("computed", "#1=100\nM98 P[#1+101]")):
        files.append(tmp_path / f"{name}.ngc")
        files[-1].write_text(f"G21 G90 G0 X0 Y0\nF600\nG1 X10\n{line}\nG1 X3 Y3\nM2\n")
    found = time_programs(cases_of(files, mill), two)
    for file, row in zip(files, found.rows, strict=True):
        assert row.reason == ""
        assert row.time.motion_s == pytest.approx(time_program(file, "mill").motion_s, rel=1e-12)


def test_files_of_one_name_are_told_apart(two, mill, folder):
    """Also in what the reader of programs says, which names the file alone."""
    for name, text in (("a", "G1 X10 F600 H\n"), ("b", "G1 X10 F600\nQ\n")):
        (folder / name).mkdir()
        (folder / name / "wrong.ngc").write_text(text)
    found = time_programs(cases_of([folder / "a" / "wrong.ngc", folder / "b" / "wrong.ngc"], mill), two)
    assert [row.case.file.label for row in found.rows] == ["a/wrong.ngc", "b/wrong.ngc"]
    assert found.rows[0].reason.startswith("a/wrong.ngc:1: H")
    assert found.rows[1].reason.startswith("b/wrong.ngc:2: Q")


def test_dwells_and_tool_changes_are_in_the_total(two, mill, folder):
    (row,) = time_programs(cases_of([folder / "part.ngc"], mill), two, TimingOptions(tool_change_s=7.0)).rows
    assert (row.time.dwell_s, row.time.tool_changes, row.time.tool_change_s) == (0.5, 1, 7.0)
    assert row.total_s == pytest.approx(row.time.motion_s + 7.5, rel=1e-12)


def test_a_tool_table_travels_with_the_program(two, mill, folder):
    """That of the machine, or another; what is wrong in it is told by its own name."""
    table = folder / "tools.tbl"
    table.write_text(TOOLS)
    part = folder / "part.ngc"
    part.write_text(MOVES.replace("T2 M6", "T2 M6\nG43"))
    at_home = replace(mill.machine, setup=replace(mill.machine.setup, tools=table))
    for machine, options in ((mill, TimingOptions(tools=table)), (NamedMachine("own", at_home), TimingOptions())):
        (row,) = time_programs(cases_of([part], machine), two, options).rows
        assert row.time.motion_s == pytest.approx(time_program(part, "mill", tools=table).motion_s, rel=1e-12)
    table.write_text("T1 Zlong\n")
    (row,) = time_programs(cases_of([part], mill), two, TimingOptions(tools=table)).rows
    assert row.reason.startswith("tools.tbl:1: Zlong")
    (row,) = time_programs(cases_of([part], mill), two, TimingOptions(tools=folder / "none.tbl")).rows
    assert row.reason.startswith(f"{folder / 'none.tbl'}: cannot be read")


def test_a_tolerance_of_a_case_is_that_of_its_plan(two, mill, folder):
    wide, narrow = (
        time_programs(cases_of([folder / "part.ngc"], mill, tolerance=mm), two).rows[0].time.motion_s
        for mm in (0.1, 0.001)
    )
    assert narrow > wide


def test_two_cases_that_are_the_same_are_refused(two, mill):
    (case,) = cases_of([PROGRAMS / "stops.ngc"], mill)
    with pytest.raises(InputError, match=r"stops\.ngc on mill within None.* is that of two tasks"):
        time_programs([case, case], two)
