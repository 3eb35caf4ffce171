"""The file of lines: every column, as CSV and NPZ, sealed; and what of it stands where."""

from __future__ import annotations

import csv
from functools import cache

import numpy as np
import pytest
from cases import PROGRAMS, drives

from planner import plan_feedrate
from planner.files.columns import digest_of_lines, digest_of_rows, reading
from planner.machine.program_setup import NO_RESTS, RestTimes
from planner.programs.line_table import FORMAT, write_line_times
from planner.programs.path.smooth_path import program_path
from planner.programs.program_text import ProgramText
from planner.programs.reading.reader import read_program
from planner.programs.times import KINDS, line_times

LIMITS = drives(dim=3)
TEXT = b'G21 G90\nN10 T1 M6\nG0 X0 Y0\nG1 X20 F3000 ; a, "b"\nG4 P0.5\nn20G1Y20 (\xfc)\nM2\n'


def planned(file, rests=NO_RESTS):
    program = read_program(file)
    path = program_path(program, 0.01, LIMITS)
    limits = LIMITS.for_curve(path.curve)
    plans = [plan_feedrate(path.curve, some, intervals=path.intervals) for some in (limits, limits.without_jerk())]
    return [line_times(program, path, plan, rests) for plan in plans]


@cache
def slots():
    return planned(PROGRAMS / "slots.ngc")


def rows_of(file):
    lines = [line for line in file.read_text("utf-8").splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def header_of(file):
    lines = file.read_text("utf-8").splitlines()
    return dict(line[2:].split(" = ", 1) for line in lines if line.startswith("#"))


def test_the_file_holds_every_line(tmp_path):
    times, without = slots()
    file = tmp_path / "lines.csv"
    write_line_times(file, times, "slots.ngc", "every limit holds", without_jerk=without)
    words = {"kind": KINDS, "held_back_by": times.limit_names}
    names = [*times.columns(), "without_jerk_limit_s"]
    with reading(file, FORMAT, ("rows", "seconds", "total_s")) as found:
        assert float(found.header["seconds"]) == times.moving
        assert float(found.header["total_s"]) == times.total
        assert found.header["verdict"] == "every limit holds"
        assert float(found.header["without_jerk_limit_s"]) == without.moving
        columns = found.columns(names, words)
    for name, values in times.columns().items():
        if name not in words:
            assert columns[name].tolist() == values.tolist()
    assert columns["held_back_by"].tolist() == times.binding.tolist()
    assert columns["without_jerk_limit_s"].tolist() == without.seconds.tolist()
    write_line_times(tmp_path / "lines.npz", times, "slots.ngc", "every limit holds")
    with np.load(tmp_path / "lines.npz") as arrays:
        assert arrays["line"].tolist() == times.line.tolist()
        assert arrays["seconds"].tolist() == times.seconds.tolist()
        assert "without_jerk_limit_s" not in arrays
        assert "text" not in arrays


class TestText:
    @pytest.fixture
    def part(self, tmp_path):
        (tmp_path / "part.ngc").write_bytes(TEXT)
        return tmp_path / "part.ngc"

    def test_csv(self, part, tmp_path):
        times, without = planned(part, RestTimes(8.0))
        file = tmp_path / "lines.csv"
        write_line_times(file, times, "part.ngc", "ok", without_jerk=without, text=ProgramText.read(part))
        rows = rows_of(file)
        assert [row["line"] for row in rows] == ["2", "3", "4", "5", "6"]
        assert [row["n_word"] for row in rows] == ["N10", "", "", "", "N20"]
        assert [row["text"] for row in rows][2:] == ['G1 X20 F3000 ; a, "b"', "G4 P0.5", "n20G1Y20 (ü)"]
        first = float(rows[2]["seconds"])
        assert [float(row["start_s"]) for row in rows] == [0.0, 8.0, 8.0, 8.0 + first, 8.5 + first]
        assert [(float(row["x_mm"]), float(row["y_mm"]), float(row["z_mm"])) for row in rows] == [
            (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (20.0, 0.0, 0.0), (20.0, 0.0, 0.0), (20.0, 20.0, 0.0)
        ]  # fmt: skip
        assert [float(row["feed_mm_min"]) for row in rows] == [0.0, 0.0, 3000.0, 0.0, 3000.0]
        for row in (rows[2], rows[4]):
            assert float(row["mean_feed_mm_min"]) == pytest.approx(60.0 * 20.0 / float(row["seconds"]))
            assert float(row["highest_feed_mm_min"]) == pytest.approx(3000.0, rel=1e-4)
        assert [float(row["rest_s"]) for row in rows] == [8.0, 0.0, 0.0, 0.5, 0.0]
        total = sum(float(row["seconds"]) + float(row["rest_s"]) for row in rows)
        assert float(header_of(file)["total_s"]) == pytest.approx(total, rel=1e-12)

    def test_npz_says_the_same(self, part, tmp_path):
        times = planned(part)[0]
        text = ProgramText.read(part)
        for name in ("lines.csv", "lines.npz"):
            write_line_times(tmp_path / name, times, "part.ngc", "ok", text=text)
        with np.load(tmp_path / "lines.npz") as arrays:
            for name in ("text", "n_word"):
                assert arrays[name].tolist() == [row[name] for row in rows_of(tmp_path / "lines.csv")]

    def test_the_seals_are_of_the_text_too(self, part, tmp_path):
        times = planned(part)[0]
        text = ProgramText.read(part)
        write_line_times(tmp_path / "lines.csv", times, "part.ngc", "ok", text=text)
        header = header_of(tmp_path / "lines.csv")
        columns = times.columns() | {"kind": times.kind, "held_back_by": times.binding}
        for name, made in (("n_word", text.number_word), ("text", text.shown)):
            columns[name] = np.array([made(line) for line in times.line.tolist()], dtype=object)
        assert header["rows_sha256"] == digest_of_rows(columns.values())
        columns["text"][0] += " "
        assert header["rows_sha256"] != digest_of_rows(columns.values())
        assert header["header_sha256"] == digest_of_lines(header)


def test_a_program_with_a_rotary_axis_shows_it(tmp_path):
    (tmp_path / "part.ngc").write_text("G21 G90\nG0 X0 Y0 A0\nG1 X20 A90 F600\nG1 Y5 A0\nM2\n")
    program = read_program(tmp_path / "part.ngc")
    limits = LIMITS.with_axes(
        ("X", "Y", "A"), velocity=[250, 250, 5], acceleration=[900, 900, 40], jerk=[2e4, 2e4, 900]
    )
    path = program_path(program, 0.01, limits)
    plan = plan_feedrate(path.curve, limits.for_curve(path.curve), intervals=path.intervals)
    write_line_times(tmp_path / "lines.csv", line_times(program, path, plan), "part.ngc", "ok")
    assert [row["a_deg"] for row in rows_of(tmp_path / "lines.csv")] == ["0.0", "90.0", "0.0"]
