"""Runs LinuxCNC's interpreter on a program, in LinuxCNC's own Python, and takes its canonical calls."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from planner.errors import InputError
from planner.programs.linuxcnc import canon
from planner.programs.linuxcnc.marks import PART, MarkedProgram, write_marked
from planner.programs.reading.setup import Tool
from planner.types import FloatArray

TIMEOUT_S = 300.0
HOW_TO_INSTALL = "on Debian and Ubuntu: apt-get install --no-install-recommends linuxcnc-uspace"
_LINE_NUMBER = re.compile(r"(line:? )(\d+)")
_SYSTEM_PYTHON = "/usr/bin/python3"


@dataclass(frozen=True, eq=False)
class CanonicalCalls:
    """The calls of a program in their order: columns of :data:`~planner.programs.linuxcnc.canon.COLUMNS`, (n, 16).

    ``marked`` are the lines they come from; ``message``, ``line`` and ``file`` say where the interpreter refused it.
    """

    rows: FloatArray
    marked: MarkedProgram
    message: str = ""
    file: int = 0
    line: int = 0


@cache
def python_of_linuxcnc() -> str | None:
    """The Python that has LinuxCNC's module gcode; None where there is none."""
    for name in (_SYSTEM_PYTHON, shutil.which("python3")):
        if name is None or not Path(name).exists():
            continue
        run = subprocess.run(
            [name, "-c", "import gcode; gcode.parse"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            timeout=60,
        )
        if run.returncode == 0:
            return name
    return None


def is_installed() -> bool:
    """Whether LinuxCNC's interpreter is there."""
    return python_of_linuxcnc() is not None


def canonical_calls(path: Path, tools: Mapping[int, Tool] | None = None, timeout: float = TIMEOUT_S) -> CanonicalCalls:
    """Interpret a program.

    Parameters
    ----------
    path : Path
        The program; files that it calls are looked for beside it.
    tools : mapping of int to Tool, optional
        The tool table; left out, every tool that the program names has the length 0.
    timeout : float
        Seconds after which the interpreter is ended.

    Raises
    ------
    InputError
        Where LinuxCNC is not installed, or the interpreter does not end.  A program that it refuses has a ``message``.
    """
    python = python_of_linuxcnc()
    if python is None:
        raise InputError(
            f"{path.name}: LinuxCNC is not installed: its module gcode is neither in {_SYSTEM_PYTHON} nor in the python3 of "
            f"PATH; {HOW_TO_INSTALL}"
        )
    with tempfile.TemporaryDirectory(prefix="feedplan_") as name:
        folder = Path(name)
        marked = write_marked(path, folder)
        _write_machine(folder, path, tools if tools is not None else {k: Tool() for k in marked.tools})
        # HOME, since LinuxCNC keeps the tool table of the machine that runs in a file there, which this would overwrite.
        environment = {
            **os.environ,
            "HOME": name,
            "INI_FILE_NAME": str(folder / "machine.ini"),
            "PYTHONNOUSERSITE": "1",
        }
        environment.pop("PYTHONPATH", None)
        environment.pop("PYTHONHOME", None)
        command = [python, "-B", str(Path(canon.__file__).resolve()), str(folder / PART), name]
        try:
            run = subprocess.run(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=timeout,
                check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise InputError(
                f"{path.name}:1: end of steps: LinuxCNC's interpreter does not end within {timeout:g} s; "
                "a loop may never end"
            ) from None
        if run.returncode != 0:
            raise InputError(f"{path.name}: LinuxCNC's interpreter failed: {_ending(run)}")
        rows = np.fromfile(folder / "calls.bin").reshape(-1, len(canon.COLUMNS))
        message = json.loads((folder / "end.json").read_text())["message"]
    marks = rows[rows[:, 0] == canon.MARK]
    file, line = (int(marks[-1, 3]), int(marks[-1, 4])) if len(marks) else (0, 1)
    return CanonicalCalls(rows, marked, _message(str(message), folder, marked), file, line)


def _message(text: str, folder: Path, marked: MarkedProgram) -> str:
    """LinuxCNC's message with the name and the lines of the program in place of those of its copy."""
    named = " ".join(text.split()).replace(f"{folder / PART}", marked.names[0]).replace(f"{folder}/", "")

    def line(match: re.Match[str]) -> str:
        number = int(match[2])
        return match[1] + str(marked.numbers[number] if number < len(marked.numbers) else number)

    return _LINE_NUMBER.sub(line, named)


def _write_machine(folder: Path, path: Path, tools: Mapping[int, Tool]) -> None:
    """The files that stand for the machine: its tool table, its parameters, and where subroutines are."""
    numbers = sorted(number for number in tools if number > 0)
    table, rows = [], []
    for number in numbers:
        tool = tools[number]
        offset = [*tool.offset, *[0.0] * (9 - len(tool.offset))]
        words = " ".join(f"{axis}{value!r}" for axis, value in zip("XYZABCUVW", offset, strict=True))
        table.append(f"T{number} P{number} {words} D{tool.diameter!r}\n")
        rows.append([number, *offset, tool.diameter, 0.0, 0.0, 0])
    (folder / "tool.tbl").write_text("".join(table))
    (folder / "tools.json").write_text(json.dumps(rows))
    (folder / "numbers.var").write_text("")
    (folder / "machine.ini").write_text(
        f"[DISPLAY]\nPROGRAM_PREFIX = {folder}\n[RS274NGC]\nSUBROUTINE_PATH = {folder}:{path.resolve().parent}\n"
    )


def _ending(run: subprocess.CompletedProcess[bytes]) -> str:
    """Why a process ended."""
    if run.returncode < 0:
        return signal.Signals(-run.returncode).name
    said = run.stderr.decode("utf-8", "replace").strip().splitlines()
    return said[-1] if said else f"exit status {run.returncode}"
