"""Shell completion: commands, options, curves and example machines, without loading anything heavy."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from cases import PROJECT

from planner import CATALOG


def completions(line):
    """What bash is told for the last word of a line."""
    words = line.split(" ")
    env = os.environ | {
        "_FEEDPLAN_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
        "PYTHONPROFILEIMPORTTIME": "1",
    }
    command = [sys.executable, "-m", "feedplan"]
    run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, env=env, check=True)
    loaded = {text.rpartition("|")[2].strip() for text in run.stderr.splitlines()}
    assert "feedplan.cli.plan" in loaded
    assert not loaded & {"numpy", "scipy", "numba", "casadi", "rich"}
    return run.stdout.split()


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("feedplan c", ["check", "compare", "curves"]),
        ("feedplan plan but", ["butterfly", "butterfly-nurbs"]),
        ("feedplan plan ", list(CATALOG)),
        ("feedplan check table.csv fl", ["flank"]),
        ("feedplan plan flank --machine ", ["five-axis", "mill"]),
        ("feedplan plan part.n", []),  # left to the shell, which completes files
        ("feedplan windows part.ngc --fr", ["--fresh"]),
    ],
)
def test_bash_is_told(line, found):
    assert completions(line) == found


def test_the_script_for_a_shell_is_printed():
    env = os.environ | {"_FEEDPLAN_COMPLETE": "source_bash"}
    run = [sys.executable, "-m", "feedplan"]
    out = subprocess.run(run, cwd=PROJECT, capture_output=True, text=True, env=env, check=True).stdout
    assert "complete -o default -F _feedplan_completion feedplan" in out
