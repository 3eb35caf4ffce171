"""What LinuxCNC's interpreter makes of a program, by its stand-alone form ``rs274``."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_CALL = re.compile(r"^\s*\d+\s+N\S*\s+(\w+)\((.*)\)\s*$")
_MOVES = ("STRAIGHT_FEED", "STRAIGHT_TRAVERSE", "ARC_FEED", "NURBS_FEED", "STRAIGHT_PROBE")


@dataclass(frozen=True, eq=False)
class Canonical:
    """The canonical calls of a program: counts by name, and the end points (n, 3) of straight feed moves, mm."""

    counts: dict[str, int]
    points: NDArray[np.float64]

    @property
    def moves(self) -> int:
        """Number of moves of any kind."""
        return sum(self.counts.get(name, 0) for name in _MOVES)


def is_installed() -> bool:
    return shutil.which("rs274") is not None and shutil.which("linuxcnc") is not None


def interpret(path: Path, timeout: float = 120.0) -> Canonical:
    """Let rs274 read a program; raises ValueError with its words where it refuses one."""
    with tempfile.TemporaryDirectory() as folder:
        tools, variables = Path(folder, "tools.tbl"), Path(folder, "numbers.var")
        tools.touch()
        variables.touch()
        run = subprocess.run(
            ["rs274", "-g", "-n", "2", "-t", str(tools), "-v", str(variables), str(path.resolve())],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            env={
                **os.environ,
                "HOME": folder,
            },  # rs274 2.9 empties the tool table of a machine that runs, which is there
        )
    complaints = [line for line in run.stderr.splitlines() if line.strip() not in ("", "executing")]
    if run.returncode or complaints:
        raise ValueError(f"{path.name}: rs274 refuses it: {' / '.join(complaints) or run.returncode}")
    calls = [match.groups() for match in map(_CALL.match, run.stdout.splitlines()) if match]
    counts: dict[str, int] = {}
    for name, _ in calls:
        counts[name] = counts.get(name, 0) + 1
    points = [[float(v) for v in values.split(",")[:3]] for name, values in calls if name == "STRAIGHT_FEED"]
    return Canonical(counts, np.array(points).reshape(-1, 3))
