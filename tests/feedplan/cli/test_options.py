"""Shell completion: commands, options, curves and example machines, without loading anything heavy."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from cases import PROJECT

from planner import CATALOG

OTHERS = {
    f"feedplan.cli.{name}"
    for name in ("check", "replay", "compare", "report", "time", "ngc", "export", "windows", "curves")
}


def completions(line):
    """What bash is told for the last word of a line, each with its kind, and the modules that loaded for it."""
    words = line.split(" ")
    env = os.environ | {
        "_FEEDPLAN_COMPLETE": "bash_complete",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
    }
    code = "import atexit, sys\natexit.register(lambda: print(*sys.modules, file=sys.stderr))\n"
    code += "from feedplan.cli import main\nmain()"
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, env=env, check=True)
    loaded = set(run.stderr.split())
    assert "feedplan.cli.app" in loaded
    assert not loaded & {"numpy", "scipy", "casadi", "rich"}
    return [tuple(text.split(",", 1)) for text in run.stdout.split()], loaded


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("feedplan plan but", ["butterfly", "butterfly-nurbs"]),
        ("feedplan plan ", list(CATALOG)),
        ("feedplan plan flank --machine ", ["five-axis", "four-axis", "mill"]),
        ("feedplan plan flank --exa", ["--exact-stop"]),
        ("feedplan plan flank --method t", ["toppra"]),
    ],
)
def test_bash_is_told_and_one_command_loads(line, found):
    told, loaded = completions(line)
    assert told == [("plain", name) for name in found]
    assert "feedplan.cli.plan" in loaded
    assert not loaded & OTHERS


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("feedplan c", ["check", "compare", "calibrate", "curves"]),
        ("feedplan check table.csv fl", ["flank"]),
        ("feedplan windows part.ngc --fr", ["--fresh"]),
    ],
)
def test_bash_is_told_of_every_command(line, found):
    assert completions(line)[0] == [("plain", name) for name in found]


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("feedplan plan part.n", "part.n"),
        ("feedplan plan circle --machine my", "my"),
        ("feedplan plan circle -o tab", "tab"),
        ("feedplan time par", "par"),
    ],
)
def test_the_shell_completes_files(line, word):
    assert completions(line)[0] == [("file", word)]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_a_shell_is_printed(shell):
    env = os.environ | {"_FEEDPLAN_COMPLETE": f"{shell}_source"}
    run = [sys.executable, "-m", "feedplan"]
    out = subprocess.run(run, cwd=PROJECT, capture_output=True, text=True, env=env, check=True).stdout
    assert f"_FEEDPLAN_COMPLETE={shell}_complete" in out
