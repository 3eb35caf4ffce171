"""What starts with a command: its own file, and of the libraries only what it works with."""

from __future__ import annotations

import subprocess
import sys

import pytest
from cases import PROGRAMS, PROJECT

COMMANDS = ("plan", "check", "replay", "compare", "report", "time", "sweep", "ngc", "export", "windows", "curves")
# Each takes as long to load as planning a curve, or longer.
UNUSED = (
    "casadi",
    "ezdxf",
    "matplotlib",
    "pandas",
    "pydantic",
    "rich",
    "ruckig",
    "scipy.interpolate",
    "scipy.optimize",
    "toppra",
)
# What numpy loads when one of its functions needs it, and ours do without.
OF_NUMPY = ("numpy.ma", "numpy.polynomial")
OF_SCIPY = ("importlib.metadata", "numpy.random", "scipy.linalg")  # a program's smoothing solves banded systems with it
SLOTS = str(PROGRAMS / "slots.ngc")


def loaded(tmp_path, *lines):
    """Run commands one after the other in one process; the modules that are loaded in the end."""
    code = "import sys\nfrom feedplan.cli import app\n"
    for line in lines:
        code += f"try:\n    app({list(line)!r})\nexcept SystemExit as stop:\n    assert not stop.code, stop.code\n"
    code += "print(*sys.modules, file=sys.stderr)"
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": str(PROJECT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return set(run.stderr.split())


@pytest.mark.parametrize(
    "lines",
    [
        [("plan", "circle")],
        [("plan", "butterfly-nurbs", "--intervals", "60", "--json")],
        [
            ("plan", "circle", "-o", "t.csv", "--intervals", "60"),
            ("check", "t.csv", "circle"),
            ("replay", "t.csv", "circle"),
        ],
        [("time", SLOTS, "--tolerance-mm", "0.01")],
    ],
    ids=["plan", "plan as JSON", "check and replay", "time"],
)
def test_a_command_loads_no_library_that_it_does_not_need(lines, tmp_path):
    found = loaded(tmp_path, *lines)
    assert "planner.plan.refine" in found
    smoothed = lines[0][0] == "time"
    assert found & {*UNUSED, *(() if smoothed else OF_SCIPY + OF_NUMPY)} == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_loads_its_own_file(name, tmp_path):
    found = loaded(tmp_path, (name, "--help"))
    commands = {f"feedplan.cli.{other}" for other in COMMANDS}
    assert found & commands == {f"feedplan.cli.{name}"}
    assert "numpy" not in found


def test_the_list_of_curves_and_the_version_need_no_numbers(tmp_path):
    assert not loaded(tmp_path, ("curves",), ("--version",)) & {"numpy", *UNUSED}
