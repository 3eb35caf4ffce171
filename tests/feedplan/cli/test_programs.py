"""Part programs on the command line: verdict, seconds a line, programs out, and what is refused."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest
from cases import PROGRAMS, drives
from texts import flat, strict_json

import planner.output.table
from planner import (
    load_curve,
    load_limits,
    plan_feedrate,
    read_points,
    read_program,
    read_table,
    write_table,
)
from planner.geometry.tolerance import PathTolerance
from planner.programs.linuxcnc.interpreter import is_installed
from planner.programs.path.deviation import deviation
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.smooth_path import program_path

SLOTS = PROGRAMS / "slots.ngc"
PART = """\
%
(a bracket)
G21 G90 G17
T1 M6
S12000 M3
G0 Z5
G0 X0 Y0
M8
G1 Z-1 F300
G64 P0.02
F2400
X30
G3 X30 Y10 I0 J5
G1 X0
G4 P0.5
S8000
X0 Y0
X0 Y0
M9
G0 Z5
M5
M30
%
"""
INI = """\
[TRAJ]
COORDINATES = X Y Z
MAX_LINEAR_VELOCITY = 120
[EMCMOT]
SERVO_PERIOD = 2000000
""" + "".join(f"[AXIS_{a}]\nMAX_VELOCITY = 100\nMAX_ACCELERATION = 800\nMAX_JERK = 16000\n" for a in "XYZ")


@pytest.fixture
def part(tmp_path):
    file = tmp_path / "part.ngc"
    file.write_text(PART)
    return file


@pytest.fixture
def machine(tmp_path):
    file = tmp_path / "machine.ini"
    file.write_text(INI)
    return file


@pytest.fixture
def corners(tmp_path):
    """Three lines and the two corners between them."""
    file = tmp_path / "corners.ngc"
    file.write_text("G21 G90\nG0 X0 Y0\nG64 P0.01\nF6000\nG1 X20\nY20\nX0 Y30\nM2\n")
    return file


def distance(points, vertices):
    """Largest distance of points from a polyline of few vertices, each from its nearest segment."""
    a, chord = vertices[:-1], np.diff(vertices, axis=0)
    square = np.maximum(np.sum(chord**2, axis=1), 1e-30)
    worst = 0.0
    for p in points:
        w = np.clip(np.sum((p - a) * chord, axis=1) / square, 0.0, 1.0)
        worst = max(worst, float(np.sum((p - a - w[:, None] * chord) ** 2, axis=1).min()))
    return math.sqrt(worst)


def points_between(source, step=0.02):
    """The moves of a program of lines as points no farther apart than a step, both ends among them."""
    parts = [source.start[:1]]
    for start, end, length in zip(source.start, source.end, source.lengths, strict=True):
        count = int(np.ceil(length / step))
        parts.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(parts)


class TestPlan:
    def test_the_verdict_tells_tolerance_deviation_and_line(self, run, corners, tmp_path):
        table = tmp_path / "table.csv"
        code, out, err = run("plan", corners, "--tolerance-mm", "0.02", "-o", table)
        assert (code, err) == (0, "")
        path = program_path(read_program(corners), 0.02, load_limits("mill"))
        assert (
            f"deviation     {1e3 * path.deviation.largest:.4g} um at most, at line {path.deviation_line}; 20 um" in out
        )
        assert (
            "program       8 lines, 3 moves\npath          joint, with its feed: all of 1 run from stop to stop\n"
            in out
        )
        assert max(len(line) for line in out.splitlines()) <= 80
        profile = read_table(table, path.curve)
        assert f"{profile.duration:.6g} s" in out
        assert run("check", table, corners)[0] == 0
        assert run("check", table, corners, "--tolerance-mm", "0.02", "--machine", "mill")[0] == 0
        code, _, err = run("check", table, corners, "--tolerance-mm", "0.03")
        assert code == 2
        assert "give the curve, and the scale and tolerance, it was planned with" in err
        code, out, _ = run("replay", table, corners, "-o", tmp_path / "samples.csv")
        assert code == 0
        assert f"samples       {math.ceil(profile.duration / 1e-3) + 1}, one every 0.001 s" in out

    def test_json(self, run, part, machine, tmp_path):
        files = [tmp_path / name for name in ("t.npz", "out.ngc", "lines.csv")]
        code, out, _ = run(
            "plan", part, "--machine", machine, "-o", files[0], "--program", files[1], "--lines", files[2], "--json"
        )
        assert code == 0
        facts = strict_json(out)
        assert facts["files"] == [str(file) for file in files]
        found = facts["program"]
        assert found["tolerance_mm"] == pytest.approx(0.015)  # of P0.02 the path takes three quarters
        assert found["deviation_mm"] <= found["tolerance_mm"]
        assert [(stop["line"], stop["reason"]) for stop in found["exact_stops"]] == [
            (14, "demanded by the program"),
            (17, "beside a rapid"),
        ]
        assert facts["period_s"] == 0.002
        assert not [note for note in facts["notes"] if note.startswith("exact stop at u")]
        with open(files[2]) as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
        assert [int(row["line"]) for row in rows] == [4, 6, 7, 9, 12, 13, 14, 15, 17, 18, 20]
        assert math.fsum(float(row["seconds"]) for row in rows) == pytest.approx(facts["duration_s"], abs=1e-9)
        assert run("check", files[0], part)[0] == 0

    def test_f_words_hold_under_the_feed_of_the_machine(self, run, tmp_path):
        file = tmp_path / "part.ngc"
        file.write_text("G21 G90\nG0 X0 Y0\nG64 P0.01\nG1 X20 F1200\nX60 F30000\nM2\n")
        lines = tmp_path / "lines.csv"
        assert run("plan", file, "--lines", lines)[0] == 0
        rows = list(csv.DictReader(line for line in lines.read_text().splitlines() if not line.startswith("#")))
        mean = {int(row["line"]): float(row["mean_feed_mm_min"]) / 60.0 for row in rows}
        assert 17.0 < mean[4] <= 20.0  # F1200
        assert 60.0 < mean[5] <= 100.0  # F30000, but 100 mm/s is the machine's

    @pytest.mark.parametrize("method", ["toppra", "scurve"])
    def test_other_methods_take_a_program(self, run, corners, method):
        code, out, _ = run("plan", corners, "--method", method, "--json")
        assert strict_json(out)["method"] == method
        assert code == (1 if method == "toppra" else 0)


class TestPoints:
    @pytest.fixture
    def points(self, tmp_path):
        t = np.linspace(0.0, 2.0, 200)
        file = tmp_path / "points.csv"
        file.write_text("X,Y\n" + "".join(f"{30 * np.cos(a):.6f},{20 * np.sin(a):.6f}\n" for a in t))
        return file

    def test_points_are_fitted_within_the_tolerance(self, run, points, tmp_path):
        table = tmp_path / "table.csv"
        code, out, _ = run("plan", points, "--tolerance-mm", "0.005", "-o", table, "--intervals", "60", "--json")
        assert code == 0
        assert strict_json(out)["source"]["deviation"].endswith("; 5 um allowed")
        assert run("check", table, points)[0] == 0
        assert run("plan", points, "--intervals", "60", "-o", table)[0] == 0
        assert run("check", table, points)[0] == 0

    def test_a_drawing_is_planned_and_written(self, run, tmp_path):
        import ezdxf

        drawing = ezdxf.new(units=4)
        drawing.modelspace().add_line((0, 0), (20, 0))
        drawing.modelspace().add_arc((20, 5), 5, -90, 90)
        drawing.saveas(tmp_path / "part.dxf")
        out = tmp_path / "out.ngc"
        code, text, _ = run("ngc", tmp_path / "part.dxf", "--tolerance-mm", "0.01", "-o", out)
        assert code == 0
        assert "within" in text
        assert read_program(out).end[-1, :2] == pytest.approx([20.0, 10.0], abs=1e-3)


class TestTime:
    def test_json_adds_up(self, run, part, machine, tmp_path):
        output = tmp_path / "lines.csv"
        code, out, err = run("time", part, "--machine", machine, "-o", output, "--json")
        assert (code, err) == (0, "")
        facts = strict_json(out)
        lines = facts["lines"]
        assert math.fsum(row["seconds"] for row in lines) == facts["motion_s"]
        assert math.fsum(row["without_jerk_limit_s"] for row in lines) == facts["without_jerk_limit_s"]
        assert 0.0 < facts["jerk_limit_costs"] < 0.3
        assert (facts["dwell_s"], facts["tool_changes"]) == (0.5, 1)
        assert {row["line"]: row["dwell_s"] for row in lines if row["dwell_s"]} == {15: 0.5}
        assert next(row for row in lines if row["line"] == 9)["held_back_by"] == "feed"
        assert "without_jerk_limit_s" in output.read_text()

    def test_text_tells_the_longest_lines_first(self, run, part, machine):
        code, out, _ = run("time", part, "--machine", machine, "--rows", "2")
        assert code == 0
        lines = out.splitlines()
        head = next(k for k, line in enumerate(lines) if line.split()[:2] == ["line", "text"])
        longest = [line.split() for line in lines[head + 1 : head + 5]]
        assert [row[0] for row in longest] == ["9", "14", "9", "all"]
        assert longest[2][1] == "others"
        assert lines[head + 1].split(maxsplit=1)[1].startswith("G1 Z-1 F300 ")
        assert float(longest[0][5]) >= float(longest[1][4])
        text = flat(out)
        assert "tool starts time seconds % held back by T1 0:00:00" in text
        assert (
            "dwells 0.5 s tool changes 1; not in the total, for nobody says how long one takes: --tool-change-s" in text
        )
        assert text.endswith("same path takes at best without one")
        assert max(len(line) for line in lines) <= 80

    def test_head_and_shares_are_those_of_plan(self, run, part, machine):
        time, plan = (flat(run(command, part, "--machine", machine)[1]) for command in ("time", "plan"))
        heads = [re.findall(r" machine [^;]+; .*? period [0-9.]+ m?s ", text) for text in (time, plan)]
        assert len(heads[0]) == 1
        assert heads[0] == heads[1]
        held = time[time.rindex("held back by motion") : time.rindex(" total ")].removeprefix("held back by motion ")
        assert held.replace("% ", "%, ") in plan
        shares = [float(x) for x in re.findall(r"([0-9.]+)%", held)]
        assert sum(shares) == pytest.approx(100.0, abs=0.06 * len(shares))

    def test_what_the_jerk_limit_costs_at_corners(self, run, corners):
        facts = strict_json(run("time", corners, "--tolerance-mm", "0.01", "--json")[1])
        assert facts["jerk_limit_costs"] == facts["motion_s"] / facts["without_jerk_limit_s"] - 1.0
        assert 0.01 < facts["jerk_limit_costs"] < 0.3

    def test_a_machine_without_a_jerk_limit(self, run, corners, tmp_path):
        ini = tmp_path / "machine.ini"
        ini.write_text("".join(line for line in INI.splitlines(keepends=True) if "JERK" not in line))
        facts = strict_json(run("time", corners, "--machine", ini, "--json")[1])
        assert facts["motion_s"] == facts["without_jerk_limit_s"]
        assert "jerk limit none is set" in flat(run("time", corners, "--machine", ini)[1])
        given = ("--jerk-mm-s3", "20000")
        facts = strict_json(run("time", corners, "--machine", ini, *given, "--json")[1])
        assert facts["jerk_limit_costs"] > 0.0
        assert facts["machine"].startswith(f"{ini} (jerk 20000 mm/s^3 given for X")


class TestNgc:
    @pytest.mark.parametrize("options", [(), ("--inverse-time",)])
    def test_what_is_written_reads_back_within_the_tolerance(self, run, corners, tmp_path, options):
        out = tmp_path / "out.ngc"
        code, text, err = run("ngc", corners, "--tolerance-mm", "0.02", "-o", out, "--json", *options)
        assert (code, err) == (0, "")
        facts = strict_json(text)
        source, written = read_program(corners), read_program(out)
        vertices = np.concatenate([source.start[:1], source.end])
        back = np.concatenate([written.start[:1], written.end])
        assert len(written) == facts["blocks"]
        assert facts["duration_s"] == pytest.approx(facts["plan_s"], rel=0.03)
        blend = facts["blending_mm"]
        assert distance(points_between(written, 1.0), vertices) + blend <= 0.02
        assert distance(vertices, back) + blend <= 0.02
        assert facts["deviation_mm"] + blend <= 0.02
        assert written.tolerance[~written.stop_after].max() <= 0.02 - facts["deviation_mm"] + blend

    def test_arcs_become_lines_within_the_tolerance(self, run, tmp_path):
        out = tmp_path / "out.ngc"
        assert run("ngc", SLOTS, "--tolerance-mm", "0.01", "-o", out)[0] == 0
        blocks = MovingBlocks.of(read_program(SLOTS), 0.01)
        written = read_program(out)
        limits = drives(dim=3)
        path = program_path(written, 1e-3, limits)  # follows the written lines within 1 um
        ends = blocks.programmed.edges
        u = np.interp(ends, [0.0, ends[-1]], path.curve.domain)
        found = deviation(path.curve, blocks.programmed, u, ends, 5.0, density=8)
        assert found.largest <= 0.01 + 1e-3

    def test_spindle_tools_and_dwells_keep_their_places(self, run, part, machine, tmp_path):
        out = tmp_path / "out.ngc"
        assert run("ngc", part, "--machine", machine, "-o", out)[0] == 0
        words = [line for line in out.read_text().splitlines() if not line.startswith(("G1 ", "G61", "G64", "("))]
        assert words == [
            "G21 G17 G90 G94", "M6 T1", "M3 S12000", "G0 Z5", "G0 X0 Y0", "M8", "G0 X0 Y0 Z5", "G4 P0.5", "S8000", "M9",
            "M5", "M2",
        ]  # fmt: skip
        source, written = read_program(part), read_program(out)
        for kind in ("dwell", "coolant", "spindle", "tool_change"):
            there, here = (
                [
                    program.end[e.after_move] if e.after_move >= 0 else program.start[0]
                    for e in program.events
                    if e.kind == kind
                ]
                for program in (source, written)
            )
            assert np.abs(np.array(there) - np.array(here)).max() <= 0.02
        assert [e.text for e in source.events if e.kind != "end"] == [e.text for e in written.events if e.kind != "end"]

    def test_an_axis_that_rests_keeps_its_rapid(self, run, tmp_path):
        file, out, table = (tmp_path / name for name in ("flat.ngc", "out.ngc", "table.csv"))
        file.write_text("G21 G90\nG0 Z2.5\nG0 X0 Y0\nG64 P0.01\nG1 X20 F3000\nY20\nM2\n")
        assert run("plan", file, "-o", table, "--program", out)[0] == 0
        assert out.read_text().splitlines()[3:5] == ["G0 Z2.5", "G0 X0 Y0"]
        assert run("check", table, file)[0] == 0  # the table has no limits of Z

    def test_from_a_table(self, run, corners, tmp_path):
        table, planned, out = (tmp_path / name for name in ("t.csv", "planned.ngc", "out.ngc"))
        assert run("plan", corners, "--tolerance-mm", "0.02", "-o", table, "--program", planned)[0] == 0
        assert run("ngc", corners, "--table", table, "-o", out)[0] == 0
        assert out.read_bytes() == planned.read_bytes()
        assert run("plan", corners, "--tolerance-mm", "0.02", "-o", table)[0] == 0
        code, _, err = run("ngc", corners, "--table", table, "-o", out)
        assert code == 2
        assert "its path takes 0.02 mm of tolerance and leaves nothing for the blocks" in err
        assert run("ngc", corners, "--table", table, "-o", out, "--tolerance-mm", "0.03")[0] == 0
        code, _, err = run("ngc", corners, "--table", table, "-o", out, "--machine", "mill")
        assert code == 2
        assert "--table brings its own limits" in err

    def test_a_path_that_leaves_room_for_its_program_says_so(self, run, corners, tmp_path):
        said = "75% for the path, 25% for the program; a plan alone is faster"
        alone = strict_json(run("plan", corners, "--tolerance-mm", "0.02", "--json")[1])
        out, text = tmp_path / "out.ngc", ("--tolerance-mm", "0.02")
        shared = strict_json(run("plan", corners, *text, "--program", out, "--json")[1])
        assert shared["source"]["tolerance"] == said
        assert "tolerance" not in alone["source"]
        assert alone["duration_s"] < shared["duration_s"]
        assert f"tolerance {said}" in flat(run("plan", corners, *text, "--program", out)[1])
        assert run("ngc", corners, *text, "-o", out)[1].splitlines()[1] == f"tolerance: {said}"
        assert strict_json(run("ngc", corners, *text, "-o", out, "--json")[1])["source"] == shared["source"]
        assert "source" not in strict_json(run("plan", "teardrop", "--program", out, "--json")[1])

    def test_a_curve(self, run, tmp_path):
        code, out, _ = run("ngc", "teardrop", "--tolerance-mm", "0.004", "-o", tmp_path / "t.ngc", "--json")
        assert code == 0
        facts = strict_json(out)
        assert facts["deviation_mm"] > 0.001
        assert facts["blending_mm"] > 0.0
        assert facts["deviation_mm"] + facts["blending_mm"] <= 0.004
        assert len(read_program(tmp_path / "t.ngc")) == facts["blocks"]

    def test_a_share_of_the_acceleration_brings_linuxcnc_to_the_plan(self, run, tmp_path):
        off = []
        for share in ("1", "0.8"):
            words = ("ngc", "hypotrochoid", "--scale", "10", "--tolerance-mm", "0.01", "--acceleration-share", share)
            facts = strict_json(run(*words, "-o", tmp_path / "t.ngc", "--json")[1])
            off.append(facts["duration_s"] / facts["plan_s"] - 1.0)
        assert off[0] > 0.012
        assert abs(off[1]) < 0.006

    @pytest.mark.parametrize("share", ["0", "1.5", "-1", "nan"])
    def test_a_share_of_the_acceleration_that_is_none(self, run, tmp_path, share):
        code, _, err = run(
            "ngc", "teardrop", "--tolerance-mm", "0.01", "--acceleration-share", share, "-o", tmp_path / "t.ngc"
        )
        assert code == 2
        assert "acceleration_share = " in err
        assert list(tmp_path.iterdir()) == []


class TestBadInput:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G21 G90\nG0 X0\nG1 X10 Q5 F100\nM2\n", "part.ngc:3: Q5: belongs to a word that is not in the block"),
            ("G21\nG1 X10\nM2\n", "part.ngc:2: G1: no feed is given; F is missing"),
            ("G21\nG1 X10 F100\n", "part.ngc:2: end of file: there is no M2, M30 or closing %"),
            ("G21\nM2\n", "part.ngc: the program moves nothing"),
            ("G21\nG0 X5 Y5\nG1 X5 F100\nM2\n", "part.ngc: the program moves nothing"),
            ("G21\nG1 X1 F100\nM123\nM2\n", "part.ngc:3: M123: not read in this program: M123 (line 3, 1 time"),
            ("\0\1\2\3", "part.ngc:1: "),
        ],
    )
    @pytest.mark.parametrize("command", [("plan",), ("time",), ("ngc", "-o", "out.ngc")])
    def test_programs(self, run, tmp_path, monkeypatch, text, message, command):
        monkeypatch.chdir(tmp_path)
        Path("part.ngc").write_text(text)
        code, out, err = run(command[0], "part.ngc", *command[1:])
        assert (code, out) == (2, "")
        assert err.startswith(f"error: {message}")
        assert err.count("\n") == 1
        assert [file.name for file in tmp_path.iterdir()] == ["part.ngc"]

    def test_a_machine_that_lacks_an_axis(self, run, tmp_path):
        file, toml = tmp_path / "part.ngc", tmp_path / "m.toml"
        file.write_text("G21\nG0 X0\nG1 X5 F100\nY5\nM2\n")
        toml.write_text(
            'feed_mm_s = 10.0\n[[axis]]\nname = "X"\nvelocity_mm_s = 1.0\nacceleration_mm_s2 = 1.0\njerk_mm_s3 = 1.0\n'
        )
        for command in ("plan", "time"):
            code, _, err = run(command, file, "--machine", toml)
            assert code == 2
            assert "part.ngc:4: Y: the machine has no axis Y; its axes are X" in err

    @pytest.mark.parametrize("tolerance", ["0", "-0.01", "nan"])
    def test_tolerances(self, run, tolerance):
        for command in (("plan", SLOTS), ("time", SLOTS), ("plan", "teardrop")):
            code, _, err = run(*command, "--tolerance-mm", tolerance)
            assert code == 2
            assert f"tolerance = {float(tolerance)!r} must be a number > 0" in err
            assert "must be a number > 0" in err

    @pytest.mark.parametrize(
        ("command", "message"),
        [
            (("plan", "teardrop", "--lines", "x.csv"), "teardrop has no lines; --lines needs a part program"),
            (("time", "teardrop"), "teardrop has no lines; feedplan time needs a part program"),
            (("time", "orders/"), "orders/: there is no such file, and no folder either"),
            (("plan", "teardrop", "--tolerance-mm", "0.01"), "teardrop is exact"),
            (("plan", SLOTS, "--scale", "2"), "it must be 1"),
            (("plan", "no.ngc"), "no.ngc: cannot be read"),
            (("time", SLOTS, "-o", "x.pdf"), 'the suffix ".pdf" must be .csv or .npz'),
            (("ngc", SLOTS, "-o", "no/x.ngc"), "cannot be written"),
            (("plan", SLOTS, "--program", "no/x.ngc"), "cannot be written"),
        ],
    )
    def test_options(self, run, command, message):
        code, out, err = run(*command)
        assert (code, out) == (2, "")
        assert message in err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("ngc", "part.ngc", "-o", "part.ngc"), "is an input of this command"),
        (("time", "part.ngc", "-o", "./part.ngc"), "is an input of this command"),
        (("plan", "part.ngc", "--program", "part.ngc"), "is an input of this command"),
        (("plan", "part.ngc", "--lines", "same.csv", "-o", "same.csv"), "is given for two outputs"),
    ],
)
def test_no_input_and_no_other_output_is_replaced(run, tmp_path, monkeypatch, options, message):
    text = "G21 G90 F6000\nG1 X10\nG1 Y10\nM2\n"
    (tmp_path / "part.ngc").write_text(text)
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*options)
    assert (code, out) == (2, "")
    assert message in " ".join(err.split())
    assert (tmp_path / "part.ngc").read_text() == text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part.ngc"]


def test_a_table_of_another_curve_is_the_fault_not_its_tolerance(run, corners, tmp_path):
    table = tmp_path / "table.csv"
    assert run("plan", corners, "--tolerance-mm", "0.02", "-o", table)[0] == 0
    assert run("check", table, corners)[0] == 0
    for command in (("check", table, "teardrop"), ("replay", table, "teardrop")):
        code, out, err = run(*command)
        assert (code, out) == (2, "")
        assert "the table is for the curve corners.ngc" in err
        assert "not for teardrop" in err
        assert "--tolerance-mm" not in err


@pytest.mark.parametrize("tolerance", [0.02, None])
def test_a_table_written_from_python_says_its_tolerance(run, corners, tmp_path, tolerance):
    """Neither the command that checks it nor the one that writes a program of it has to be told again."""
    table, other, limits = tmp_path / "t.csv", tmp_path / "u.csv", load_limits("mill")
    path = program_path(read_program(corners), tolerance, limits)
    limits = limits.for_curve(path.curve)
    profile = plan_feedrate(path.curve, limits, intervals=300)
    write_table(table, profile, limits)
    assert run("check", table, corners)[0] == 0
    code, _, err = run("check", table, corners, "--tolerance-mm", "0.015")
    assert code == 2
    assert "the scale and tolerance" in err
    # the command line says the same
    given = ("--tolerance-mm", tolerance) if tolerance else ()
    assert run("plan", corners, *given, "--intervals", 300, "-o", other)[0] == 0
    assert read_table(other, path.curve).origin == profile.origin
    assert read_table(table, path.curve).origin == profile.origin
    assert profile.origin.tolerance == PathTolerance(tolerance, path="joint")


def test_a_table_of_points_written_from_python_says_its_tolerance(run, tmp_path):
    t, file, table = np.linspace(0.0, 2.0, 100), tmp_path / "points.csv", tmp_path / "t.csv"
    file.write_text("".join(f"{30 * np.cos(a):.6f},{20 * np.sin(a):.6f}\n" for a in t))
    for curve, tolerance in ((read_points(file, 0.05), 0.05), (load_curve(file), 1e-3)):
        limits = load_limits("mill").for_curve(curve)
        write_table(table, plan_feedrate(curve, limits, intervals=60), limits)
        assert read_table(table, curve).origin.tolerance == PathTolerance(tolerance)
        assert run("check", table, file)[0] == 0


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("path_tolerance_mm", "a hair", "path_tolerance_mm = .a hair.; it must be a number"),
        ("path_tolerance_mm", "-0.01", "path_tolerance_mm = -0.01; it must be > 0 and finite"),
        ("path_tolerance_mm", "inf", "path_tolerance_mm = inf; it must be > 0 and finite"),
        ("path_share", "1.5", "path_share = 1.5; it must lie within"),
        ("path_share", "nan", "path_share = nan; it must lie within"),
        ("path_machine", "lathe", "path_machine = .lathe.; it must be one of mill, four-axis, five-axis"),
    ],
)
def test_a_table_with_a_false_tolerance_is_refused(run, corners, tmp_path, monkeypatch, key, text, message):
    lines = planner.output.table.tolerance_lines
    monkeypatch.setattr(planner.output.table, "tolerance_lines", lambda made: lines(made) | {key: text})
    table = tmp_path / "t.csv"
    run("plan", corners, "--intervals", 300, "-o", table)
    code, _, err = run("check", table, corners)
    assert code == 2
    assert re.search(message, flat(err))


@pytest.mark.parametrize("command", ["plan", "time", "windows", "ngc", "check", "compare"])
def test_an_empty_name_is_no_machine(run, corners, tmp_path, command):
    output = tmp_path / "output.npz"
    options = {
        "windows": (corners, "-o", output),
        "ngc": (corners, "-o", output),
        "check": (tmp_path / "table.csv", corners),
        "compare": ("teardrop",),
    }.get(command, (corners,))
    if command == "check":
        assert run("plan", corners, "-o", tmp_path / "table.csv")[0] == 0
    code, out, err = run(command, *options, "--machine", "")
    assert (code, out) == (2, "")
    assert flat(err) == (
        "error: machine '' must be a file, .toml, the .ini of LinuxCNC, the .cfg of Klipper, or what a GRBL controller "
        "answers to $$ (.txt), or an example machine: mill, four-axis, five-axis"
    )
    assert not output.exists()


def test_a_directory_is_no_curve(run, tmp_path):
    code, _, err = run("plan", tmp_path)
    assert code == 2
    assert "is a directory; give a .json" in err


@pytest.mark.skipif(not is_installed(), reason="LinuxCNC is not installed (Debian: apt-get install linuxcnc-uspace)")
class TestReadByLinuxCNC:
    TEXT = "G21 G64 P0.01\nG0 X0 Y0\nF1200\nG1 X10\nG2 X20 I5\nG5.1 X30 Y10 I5 J0\nG1 X40\nM2\n"

    @pytest.fixture
    def file(self, tmp_path):
        path = tmp_path / "part.ngc"
        path.write_text(self.TEXT)
        return path

    def test_every_command_takes_the_reader(self, run, file, tmp_path):
        table, program, windows = tmp_path / "plan.csv", tmp_path / "out.ngc", tmp_path / "plan.npz"
        by = ("--reader", "rs274")
        code, out, _ = run("time", file, *by, "--json")
        assert code == 0
        lines = {row["line"] for row in strict_json(out)["lines"] if row["seconds"] > 0.0}
        assert lines == {4, 5, 6, 7}
        assert "read by LinuxCNC's interpreter: splines are its chords" in strict_json(out)["notes"]
        assert run("plan", file, *by, "-o", table)[0] == 0
        assert run("check", table, file, *by)[0] == 0
        assert run("replay", table, file, *by, "-o", tmp_path / "samples.csv")[0] == 0
        assert run("report", table, file, *by, "-o", tmp_path / "page.html")[0] == 0
        assert run("ngc", file, *by, "-o", program)[0] == 0
        assert run("windows", file, *by, "-o", windows)[0] == 0
        assert run("compare", file, *by, "--methods", "optimal")[0] == 0

    def test_what_linuxcnc_refuses_is_bad_input(self, run, file):
        file.write_text("G1 X1 F60\nG1 X[1/0]\nM2\n")
        code, _, err = run("time", file, "--reader", "rs274")
        assert code == 2
        assert "part.ngc:2: G1X[1/0]: LinuxCNC refuses it: Attempt to divide by zero" in err

    def test_a_reader_that_there_is_not(self, run, file):
        code, _, err = run("time", file, "--reader", "grbl")
        assert code == 2
        assert "'feedplan', 'rs274'" in err


class TestWhatAProgramCountsOn:
    def test_a_tool_table_and_words_passed_over(self, run, tmp_path):
        file, table = tmp_path / "part.ngc", tmp_path / "tool.tbl"
        file.write_text("G21 G90\nG43 H1\nG1 X5 Z1 F600\nM123\nM124\nX10\nM2\n")
        table.write_text("T1 P1 Z30 ;drill\n")
        code, _, err = run("time", file)
        assert code == 2
        assert "M123 (line 4, 1 time, a code of the user); M124 (line 5, 1 time, a code of the user)" in err
        options = ("--tools", table, "--ignore", "M124", "--ignore", "M123", "--json")
        code, out, _ = run("time", file, *options)
        facts = strict_json(out)
        assert code == 0
        assert facts["lines"][0]["length_mm"] == pytest.approx(math.hypot(5, 31))
        assert "M123 is passed over as asked, 1 time, the first in line 4" in facts["notes"]
        out_file = tmp_path / "plan.csv"
        assert run("plan", file, *options[:-1], "-o", out_file)[0] == 0
        assert run("check", out_file, file, *options[:-1])[0] == 0
        code, out, _ = run("compare", file, "--methods", "toppra", *options)
        assert code in (0, 1)
        assert strict_json(out)["curve"]["length_mm"] == pytest.approx(math.hypot(5, 31) + 5, abs=0.05)
        code, _, err = run("compare", "teardrop", "--tools", table)
        assert code == 2
        assert "is for part programs" in err

    def test_a_machine_file_with_homes_and_offsets(self, run, tmp_path):
        file, shop, table = tmp_path / "part.ngc", tmp_path / "shop.toml", tmp_path / "plan.csv"
        file.write_text("G21 G90 F1200\nG0 X0 Y0 Z5\nG1 X9\nT2 M6\nG0 X0 Z5\nG28 Z9\nM2\n")
        shop.write_text(
            "feed_m_min = 6\n"
            + "".join(
                f'[[axis]]\nname = "{axis}"\nvelocity_m_min = 12\nacceleration_m_s2 = 2\njerk_mm_s3 = inf\n'
                for axis in "XYZ"
            )
            + "[program]\nhome_mm = { Z = 40 }\ntool_change_mm = { X = -30 }\n"
        )
        with_jerk = ("--machine", shop, "--jerk-mm-s3", "30000")
        code, out, _ = run("time", file, *with_jerk, "--json")
        facts = strict_json(out)
        assert code == 0
        assert facts["machine"] == f"{shop} (jerk 30000 mm/s^3 given for X Y Z)"
        # the rapid of M6, from X9 to X-30; that of G28, up to 9 and on to the home
        assert {row["line"]: row["length_mm"] for row in facts["lines"]} == {
            2: 0.0, 3: 9.0, 4: 39.0, 5: 30.0, 6: 35.0,
        }  # fmt: skip
        assert facts["tool_changes"] == 1
        assert facts["notes"] == []
        assert run("plan", file, *with_jerk, "-o", table)[0] == 0
        assert run("check", table, file, *with_jerk)[0] == 0
        assert run("check", table, file, "--setup", shop)[0] == 0
        assert run("replay", table, file, "--setup", shop)[0] == 0
        assert run("report", table, file, "--setup", shop, "-o", tmp_path / "page.html")[0] == 0
        to_ngc = ("ngc", file, "--table", table, "-o", tmp_path / "out.ngc")
        assert run(*to_ngc, "--setup", shop, "--tolerance-mm", "0.02")[0] == 0
        code, _, err = run("check", table, file)
        assert code == 2
        assert flat(err).endswith(
            "a program that counts on homes or offsets of a machine file needs that file too (--setup)"
        )
        code, _, err = run(*to_ngc, "--jerk-mm-s3", "5")
        assert code == 2
        assert "leave --machine, --feed-mm-s and --jerk-mm-s3 out" in err


def test_a_chain_of_a_drawing_by_every_command(run, tmp_path):
    import ezdxf

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    for radius, layer in ((20, "outer"), (10, "inner")):
        document.modelspace().add_circle((0, 0), radius, dxfattribs={"layer": layer})
    file, table = tmp_path / "part.dxf", tmp_path / "plan.csv"
    document.saveas(file)
    code, _, err = run("plan", file)
    assert code == 2
    assert "part.dxf: the drawing has 2 chains; choose one by its number (--chain, chain=)" in err
    code, out, _ = run("plan", file, "--chain", "2", "-o", table)
    assert code == 0
    assert "drawing chain 2 of 2: CIRCLE" in flat(out)
    for which in (("--chain", "2"), ("--layer", "inner")):
        assert run("check", table, file, *which)[0] == 0
    assert run("replay", table, file, "--chain", "2")[0] == 0
    assert run("report", table, file, "--chain", "2", "-o", tmp_path / "page.html")[0] == 0
    assert run("ngc", file, "--layer", "inner", "-o", tmp_path / "out.ngc")[0] == 0
    assert run("ngc", file, "--table", table, "--chain", "2", "-o", tmp_path / "out.ngc")[0] == 0
    assert run("compare", file, "--chain", "2", "--methods", "scurve")[0] == 0
