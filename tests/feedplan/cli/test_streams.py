"""Standard input and output in place of files, in real pipes."""

from __future__ import annotations

import csv
import io
import os
import shlex
import subprocess
import sys

import numpy as np
import pytest
from cases import PROGRAMS, PROJECT
from texts import flat, strict_json

from planner import load_curve, read_table

FEEDPLAN = f"{shlex.quote(sys.executable)} -m feedplan"
SLOTS = PROGRAMS / "slots.ngc"
QUICK = "--intervals 60"


@pytest.fixture
def sh(tmp_path):
    """Run a line of a shell in an empty folder; ``feedplan`` is the command."""

    def line(text, given=b"", code=0):
        text = text.replace("feedplan ", f"{FEEDPLAN} ")
        run = subprocess.run(
            ["bash", "-o", "pipefail", "-c", text],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(PROJECT), "TMPDIR": str(tmp_path)},
            input=given,
            capture_output=True,
            check=False,
        )
        assert run.returncode == code, run.stderr.decode()
        return run.stdout.decode(), run.stderr.decode()

    return line


def test_a_plan_is_checked_down_a_pipe(sh, tmp_path):
    out, err = sh(f"feedplan plan teardrop {QUICK} -o - | tee table.csv | feedplan check - teardrop")
    assert "OK  every limit holds" in out
    assert "limits in standard input" in flat(out)
    assert "written       standard output" in err
    assert "OK  every limit holds" in err
    profile = read_table(tmp_path / "table.csv", load_curve("teardrop"))
    assert f"{profile.duration:.6g} s" in out
    assert [file.name for file in tmp_path.iterdir()] == ["table.csv"]  # nothing is left behind


def test_a_table_is_the_same_as_in_a_file(sh, tmp_path):
    out, err = sh(f"feedplan plan teardrop {QUICK} --json -o -")
    sh(f"feedplan plan teardrop {QUICK} -o table.csv")
    assert out == (tmp_path / "table.csv").read_text()
    # On a busy machine a line about compiling may stand before it.
    assert strict_json(err[err.index("{") :])["files"] == ["standard output"]


def test_samples_and_a_page(sh, tmp_path):
    sh(f"feedplan plan teardrop {QUICK} -o table.csv")
    out, err = sh("feedplan replay - teardrop --period-s 0.001 -o - < table.csv")
    rows = [line for line in out.splitlines() if not line.startswith("#")]
    profile = read_table(tmp_path / "table.csv", load_curve("teardrop"))
    assert len(rows) == int(np.ceil(profile.duration / 0.001)) + 2
    assert "one every 0.001 s" in err
    page, _ = sh("feedplan report - teardrop -o - < table.csv")
    assert page.startswith("<!DOCTYPE html>") or page.startswith("<!doctype html>")
    assert "/stdin.csv" not in page


def test_a_program_goes_in_and_a_program_comes_out(sh):
    given = SLOTS.read_bytes()
    out, err = sh("feedplan ngc - --tolerance-mm 0.05 -o -", given)
    assert "G64" in out
    assert out.rstrip().endswith("M2") or "M2" in out.splitlines()[-2:]
    assert "standard output: " in err
    lines, err = sh("feedplan time - --tolerance-mm 0.05 -o -", given)
    assert "# program = standard input\n" in lines
    assert "motion" in err


def test_a_curve_in_braces(sh):
    given = b'{"x": "30*cos(u)", "y": "20*sin(u)", "u_range": [0, 3]}'
    out, _ = sh(f"feedplan plan - {QUICK} --json", given)
    assert strict_json(out)["curve"]["name"] == "stdin"


def test_a_comparison_is_csv(sh):
    out, err = sh("feedplan compare teardrop --methods 2002-bell-1,optimal -o -")
    assert [row["method"] for row in csv.DictReader(io.StringIO(out))] == ["2002-bell-1", "optimal"]
    assert "breaks" in err


def test_a_plan_that_breaks_a_limit_comes_out_with_its_code(sh):
    out, _ = sh(f"feedplan plan teardrop {QUICK} --method toppra -o -", code=1)
    assert "# verdict = BREAKS ITS LIMITS" in out


@pytest.mark.parametrize(
    ("line", "given", "said"),
    [
        ("feedplan check - -", b"", "error: standard input is given for two inputs; give a file for one\n"),
        ("feedplan plan teardrop -o - --report -", b"", "error: standard output is given for two outputs"),
        ("feedplan check - teardrop", b"u,v\n", "error: standard input: "),
        ("feedplan plan - --intervals 60", b"G1 X1 Q7\n", "error: standard input:1"),
        ("feedplan plan -", b"{", "error: standard input: not a valid JSON file"),
        ("feedplan windows - -o plan.npz", b"", "error: - has no lines; feedplan windows needs a part program"),
        ("feedplan plan teardrop --plot -", b"", "error: -: "),
    ],
)
def test_bad_input(sh, line, given, said):
    out, err = sh(line, given, code=2)
    assert out == ""
    assert said in err
    assert "Traceback" not in err


def test_a_reader_that_stops_early_is_no_error(sh):
    out, err = sh("set +o pipefail; feedplan plan teardrop --intervals 3000 -o - | head -n 1")
    assert out.startswith("# format = ")
    assert "Traceback" not in err
