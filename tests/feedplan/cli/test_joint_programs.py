"""Programs whose path was found with its feed, on the command line: every command works on them, tables make them again."""

import csv
import re

import numpy as np
import pytest
from cases import PROGRAMS
from texts import flat, strict_json

import planner.output.table
from feedplan import load_job, plan_and_check
from planner import InputError, load_curve, load_limits, read_table
from planner.geometry.tolerance import PathTolerance
from planner.output.table import table_origin

ZIGZAG = PROGRAMS / "zigzag.ngc"
PART = """\
G21 G17 G90 G64 P0.02
G0 X0 Y0
F3000
G1 X20
Y20
G4 P0.25
X40 F1500
G64 P0.05
Y40
M0
G61
X60
X60 Y60
G64 P0.01
G0 X0 Y0
M2
"""


@pytest.fixture
def part(tmp_path):
    file = tmp_path / "part.ngc"
    file.write_text(PART)
    return file


@pytest.fixture
def table(run, part, tmp_path):
    file = tmp_path / "plan.csv"
    assert run("plan", part, "-o", file)[0] == 0
    return file


def facts(run, *command):
    code, out, err = run(*command, "--json")
    assert code == 0, err
    return strict_json(out)


def test_zigzag_is_faster_than_with_a_separate_path(run):
    joint, separate = (facts(run, "plan", ZIGZAG, "--path", path) for path in ("joint", "separate"))
    assert [found["program"]["path"] for found in (joint, separate)] == ["joint", "separate"]
    assert joint["duration_s"] < 0.97 * separate["duration_s"]
    assert joint["duration_s"] >= joint["lower_bound_s"] > 0.98 * joint["duration_s"]
    assert joint["program"]["deviation_share"] <= 1.0
    assert facts(run, "plan", ZIGZAG)["duration_s"] == joint["duration_s"]


def test_the_verdict_tells_how_the_path_was_made(run, part):
    _, out, _ = run("plan", part)
    assert re.search(r"path +joint, with its feed: all of 5 runs from stop to stop", out)
    assert "the gap on this path is at most" in flat(out)
    _, out, _ = run("plan", part, "--path", "separate")
    assert re.search(r"path +separate, before its feed", out)
    assert "on this path" not in flat(out)


def test_a_table_says_how_its_path_was_made_and_makes_it_again(run, part, table, tmp_path):
    assert "# path_kind = joint\n" in table.read_text()
    assert table_origin(table).tolerance == PathTolerance(None, path="joint")
    code, out, _ = run("check", table, part)
    assert code == 0
    assert "OK  every limit holds" in out
    assert run("replay", table, part, "-o", tmp_path / "samples.csv")[0] == 0
    assert run("report", table, part, "-o", tmp_path / "page.html")[0] == 0
    code, _, err = run("check", table, part, "--path", "separate")
    assert code == 2
    assert "the table is for the curve part.ngc" in flat(err)


def test_a_table_of_a_separate_path_says_nothing_of_it(run, part, tmp_path):
    file = tmp_path / "separate.csv"
    assert run("plan", part, "--path", "separate", "-o", file)[0] == 0
    assert "path_kind" not in file.read_text()
    assert run("check", file, part)[0] == 0
    assert run("check", file, part, "--path", "joint")[0] == 2


def test_a_table_with_another_kind_of_path_is_refused(run, part, tmp_path, monkeypatch):
    lines = planner.output.table.tolerance_lines
    monkeypatch.setattr(planner.output.table, "tolerance_lines", lambda made: lines(made) | {"path_kind": "both"})
    file = tmp_path / "t.csv"
    run("plan", part, "-o", file)
    code, _, err = run("check", file, part)
    assert code == 2
    assert 'path_kind = "both"; it must be one of joint, separate' in flat(err)


def test_the_seconds_of_the_lines_add_up(run, part, tmp_path):
    lines = tmp_path / "lines.csv"
    found = facts(run, "time", part, "-o", lines)
    assert found["ok"]
    assert sum(row["seconds"] for row in found["lines"]) == pytest.approx(found["motion_s"], rel=1e-12)
    assert found["motion_s"] == pytest.approx(facts(run, "plan", part)["duration_s"], rel=1e-12)
    assert found["dwell_s"] == 0.25
    assert found["without_jerk_limit_s"] < found["motion_s"]
    of = {row["line"]: row["seconds"] for row in found["lines"]}
    separate = {row["line"]: row["seconds"] for row in facts(run, "time", part, "--path", "separate")["lines"]}
    assert of.keys() == separate.keys()
    # a rapid between stops is the same line either way
    assert of[15] == pytest.approx(separate[15], rel=1e-5)
    with lines.open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert len(rows) == len(found["lines"])


def test_a_program_is_written_of_it(run, part, tmp_path):
    out = tmp_path / "out.ngc"
    written = facts(run, "ngc", part, "-o", out)
    assert written["deviation_mm"] <= 0.05
    assert written["plan_s"] == pytest.approx(shared_duration(part), rel=1e-7)
    assert 1.0 <= written["duration_s"] / written["plan_s"] < 1.01
    assert "G4 P0.25" in out.read_text()
    assert "M0" in out.read_text()
    table = tmp_path / "plan.npz"
    assert run("plan", part, "-o", table, "--program", tmp_path / "other.ngc")[0] == 0
    assert "joint" in table_origin(table).tolerance.path
    assert run("ngc", part, "--table", table, "-o", tmp_path / "again.ngc")[0] == 0


def shared_duration(part):
    return load_job(part, share=0.75).plan().duration


def test_with_a_feed_at_an_end_the_path_is_separate(run, part):
    code, out, _ = run("plan", part, "--start-feed-mm-s", 5)
    assert code == 0
    assert "separate, before its feed" in out
    code, _, err = run("plan", part, "--start-feed-mm-s", 5, "--path", "joint")
    assert code == 2
    assert "start_feed = 5 mm/s does not go with" in flat(err)
    assert plan_and_check(part, end_feed=5.0, bound=False).program.counts["joint"] == 0


@pytest.mark.parametrize(("method", "path"), [("toppra", "joint"), ("scurve", "separate"), ("nlp", "joint")])
def test_other_methods_plan_along_it_but_s_curves(run, part, method, path):
    code, out, _ = run("plan", part, "--method", method, "--intervals", 600, "--json")
    found = strict_json(out)
    assert found["program"]["path"] == path
    assert code == (1 if method == "toppra" else 0)


def test_the_literature_is_compared_on_a_separate_path(run, part, tmp_path):
    result = tmp_path / "result.json"
    assert run("compare", part, "--methods", "scurve", "-o", result)[0] == 0
    assert strict_json(result.read_text())["curve"]["hash"] == load_job(part, path="separate").curve.fingerprint


@pytest.mark.parametrize("source", ["teardrop", "points.csv"])
def test_only_a_program_has_such_a_choice(run, tmp_path, monkeypatch, source):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points.csv").write_text("".join(f"{x},{x * x}\n" for x in np.linspace(0.0, 1.0, 30)))
    code, _, err = run("plan", source, "--path", "joint")
    assert code == 2
    assert "path = 'joint' is for part programs" in flat(err)


def test_load_curve_finds_the_feed_where_it_is_given_limits(part, table):
    limits = load_limits("mill")
    joint, plain = load_curve(part, limits=limits), load_curve(part)
    assert joint.timing is not None
    assert joint.timing.limits == limits.for_curve(joint)
    assert plain.timing is None
    assert plain.fingerprint == load_curve(part, limits=limits, path="separate").fingerprint
    assert read_table(table, joint).duration == pytest.approx(sum(law.duration for law in joint.timing.laws), rel=1e-6)
    with pytest.raises(InputError, match="path = 'joint' is for part programs"):
        load_curve("teardrop", path="joint")
    with pytest.raises(InputError, match="path = 'both' must be one of joint, separate"):
        load_curve(part, path="both")


POCKET = """\
G21 G17 G90 G64 P0.01
G0 X5 Y0 Z5
G1 Z-1 F3000
X10
Y10
X0
Y0
X5
G0 Z5
M2
"""


@pytest.fixture
def pocket(tmp_path):
    file = tmp_path / "pocket.ngc"
    file.write_text(POCKET)
    return file


def test_a_pocket_is_not_gouged_and_its_table_makes_the_same_path(run, pocket, tmp_path):
    table = tmp_path / "pocket.csv"
    both = facts(run, "plan", pocket)
    inside = facts(run, "plan", pocket, "--side", "inside", "-o", table)
    assert [found["program"]["side"] for found in (both, inside)] == ["both", "inside"]
    assert 0.0 <= inside["program"]["overcut_mm"] <= 1e-9
    assert inside["program"]["deviation_mm"] > 0.009
    assert inside["duration_s"] > both["duration_s"]
    assert table_origin(table).tolerance == PathTolerance(None, path="joint", side="inside")
    for command in ("check", "replay"):
        assert run(command, table, pocket)[0] == 0
        assert run(command, table, pocket, "--side", "both")[0] == 2
    assert run("report", table, pocket, "-o", tmp_path / "page.html")[0] == 0
    _, out, _ = run("time", pocket, "--side", "inside")
    assert "inside alone; overcut" in out
    assert load_curve(pocket, limits=load_limits("mill"), side="inside").made_within.side == "inside"
    rows = facts(run, "compare", pocket, "--side", "outside", "--methods", "optimal")["methods"]
    assert "a separate path cuts corners inside" in str(rows)


def test_blocks_that_would_pass_to_the_other_side_are_refused(run, pocket, tmp_path):
    program, table = tmp_path / "out.ngc", tmp_path / "pocket.csv"
    code, _, err = run("plan", pocket, "--side", "inside", "--program", program, "-o", table)
    assert code == 2
    assert "chords of the path" in err
    assert not program.exists()
    assert not table.exists()
    assert run("plan", pocket, "--side", "inside", "-o", table)[0] == 0
    code, _, err = run("ngc", pocket, "-o", program, "--table", table, "--tolerance-mm", "0.02")
    assert code == 2
    assert "chords of the path" in err
    assert not program.exists()


def test_a_side_is_for_part_programs(run):
    assert "side = 'inside' is for part programs" in run("plan", "butterfly-nurbs", "--side", "inside")[2]
    with pytest.raises(InputError, match="side = 'left' is for part programs"):
        load_curve("butterfly-nurbs", side="left")
