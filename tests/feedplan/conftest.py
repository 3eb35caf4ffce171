"""Commands, run as a shell would run them."""

from __future__ import annotations

import pytest

from feedplan.cli import app


@pytest.fixture
def run(capsys):
    """Run a command; returns its exit code, standard output and standard error."""

    def command(*arguments):
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            app([str(argument) for argument in arguments], prog_name="feedplan")
        out, err = capsys.readouterr()
        return stop.value.code or 0, out, err

    return command
