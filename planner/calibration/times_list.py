"""How long programs took: CSV with the columns program and seconds (or minutes), the programs beside it.

Each program is taken to begin at X0 Y0 Z0: the way from there to its first position is part of its time.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

from planner.errors import InputError
from planner.inputs import shorten
from planner.machine.program_setup import ProgramSetup
from planner.programs.reading.program import Program
from planner.programs.reading.reader import read_program

_PROGRAM = "program"
_START = (0.0, 0.0, 0.0)  # where a program is taken to begin
_UNITS = {"seconds": 1.0, "minutes": 60.0}


@dataclass(frozen=True, eq=False)
class TimedProgram:
    """A program and the time that it took, s."""

    name: str
    program: Program
    seconds: float
    where: str


def is_times_list(text: str) -> bool:
    """Whether a file lists times of programs: its first line names the column ``program``."""
    first = next((line for line in text.splitlines() if line.strip() and line.strip()[0] != "#"), "")
    return _PROGRAM in [name.strip().lower() for name in first.replace(";", ",").split(",")]


def read_times_list(text: str, path: Path, setup: ProgramSetup) -> list[TimedProgram]:
    """Read a list and its programs.

    Raises
    ------
    InputError
        Naming file and line; a program that cannot be read is named by its own.
    """
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line.strip()[0] != "#"]
    mark = ";" if lines[0][1].count(";") > lines[0][1].count(",") else ","
    rows = list(csv.reader(io.StringIO("\n".join(line for _, line in lines)), delimiter=mark, skipinitialspace=True))
    names = [name.strip().lower() for name in rows[0]]
    unit = next((name for name in names if name in _UNITS), None)
    if unit is None or len(set(names)) < len(names):
        raise InputError(
            f"{path}:{lines[0][0]}: the columns are {shorten(', '.join(names))}; once each are needed: {_PROGRAM} and "
            "seconds (or minutes)"
        )
    found: list[TimedProgram] = []
    for (number, _), row in zip(lines[1:], rows[1:], strict=True):
        where = f"{path}:{number}"
        if len(row) != len(names):
            raise InputError(f"{where}: {len(row)} cells; a row must have {len(names)}")
        name, text_of_time = row[names.index(_PROGRAM)].strip(), row[names.index(unit)].strip()
        try:
            value = float(text_of_time)
        except ValueError:
            value = -1.0
        if not 0.0 < value < float("inf"):
            raise InputError(f'{where}: {unit}: "{shorten(text_of_time)}" must be a number > 0')
        if name in [timed.name for timed in found]:
            raise InputError(f"{where}: {name} is listed twice; leave one, or their mean")
        found.append(
            TimedProgram(name, read_program(path.parent / name, start=_START, setup=setup), _UNITS[unit] * value, where)
        )
    if not found:
        raise InputError(f"{path}: lists no program")
    return found
