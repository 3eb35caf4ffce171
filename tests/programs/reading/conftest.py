"""Part programs given as text: what is read, or why it is refused."""

import pytest

from planner.errors import InputError
from planner.programs.reading.program import Program
from planner.programs.reading.reader import read_program


@pytest.fixture
def read(tmp_path):
    def read(text: str | bytes, **options) -> Program:
        path = tmp_path / "part.ngc"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_program(path, **options)

    return read


@pytest.fixture
def refusal(read):
    """What the reader says of a program, without the name of the file."""

    def refusal(text: str | bytes) -> str:
        with pytest.raises(InputError) as caught:
            read(text)
        message = str(caught.value)
        assert message.startswith("part.ngc:")
        return message.removeprefix("part.ngc:")

    return refusal
