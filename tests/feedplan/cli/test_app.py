"""Without its compiled core no command says that there is no plan: it says what to type, with an exit code of its own."""

import os
import subprocess
import sys

import click
import pytest
from cases import PROGRAMS, PROJECT

from feedplan.cli.app import app, exits
from planner.errors import BrokenLimitError, CoreError, CurveError, InfeasibleError, SolverError

SLOTS = str(PROGRAMS / "slots.ngc")
WITHOUT = """
import pathlib
import planner.compiled
planner.compiled.core_file = lambda root: pathlib.Path("planner/_core.so")
from feedplan.cli import main
main()
"""


@pytest.mark.parametrize(
    "arguments", [("plan", "circle"), ("compare", "circle"), ("time", SLOTS), ("plan", "circle", "-o", "-")]
)
def test_a_missing_core_has_an_exit_code_and_a_message_of_its_own(arguments, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *arguments],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(PROJECT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (4, "")
    assert done.stderr.startswith("error: the compiled core _core.so is missing from planner; install feedplan again")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("error", "code"), [(BrokenLimitError, 1), (CurveError, 2), (SolverError, 3), (InfeasibleError, 3), (CoreError, 4)]
)
def test_every_error_has_the_exit_code_that_help_says(error, code, capsys):
    with pytest.raises(click.exceptions.Exit) as stop, exits():
        raise error("what is wrong")
    assert stop.value.exit_code == code
    assert capsys.readouterr().err == "error: what is wrong\n"
    assert all(f"{number} " in str(app.epilog) for number in range(5))
