"""What the tests of the controllers share."""

import pytest

from planner import read_program


@pytest.fixture
def program(tmp_path):
    """Make a program of a text."""

    def of(text):
        path = tmp_path / "part.ngc"
        path.write_text(text)
        return read_program(path)

    return of
