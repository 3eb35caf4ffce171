"""Logs of a controller: time and positions of axes, as CSV whose first line names columns and units.

    t_s,X_mm,Y_mm          time_ms;x_inch;y_inch          X_mm,Z_mm  with a period

A log may have gaps: it falls into pieces of even time, and each is used as it is.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planner.errors import InputError
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.inputs import read_text, shorten
from planner.machine.machine_toml import LENGTHS
from planner.types import FloatArray

TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
"""Units of time, s."""
MIN_SAMPLES = 20
"""Fewer say nothing of an acceleration."""
_GAP = 1.5  # periods; more between two samples is a gap
_NAME = re.compile(r"(t|time|[a-z])[ _]*[\[(]?([a-z]*)[\])]?", re.ASCII)
_TIME = "time"


@dataclass(frozen=True, eq=False)
class Log:
    """Positions over time.

    Attributes
    ----------
    where : str
        Name of the file.
    axes : tuple of str
    t : (n,) array
        Strictly increasing, s.
    position : (n, d) array
        mm, or rad of axes that turn.
    period : float
        Median time between two samples, s.
    pieces : tuple of slice
        Between gaps, each of at least :data:`MIN_SAMPLES` samples.
    notes : tuple of str
        What a person should know: gaps, columns passed over.
    """

    where: str
    axes: tuple[str, ...]
    t: FloatArray
    position: FloatArray
    period: float
    pieces: tuple[slice, ...]
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the file without its folder."""
        return Path(self.where).name


def read_log(path: str | Path, period: float | None = None) -> Log:
    """Read a log; ``period`` in s is for a log without a column of time.

    Raises
    ------
    InputError
        Naming the file, the line, the column, its value and what is allowed.
    """
    return log_of_text(read_text(path, InputError), str(path), period)


def log_of_text(text: str, where: str, period: float | None = None) -> Log:
    """Read the text of a log."""
    names, rows, lines = _cells(text, where)
    columns, passed = _columns(names, where)
    for number, row in zip(lines, rows, strict=True):
        if len(row) != len(names):
            raise InputError(
                f"{where}:{number}: {len(row)} cells; a row must have {len(names)}, as the first line names"
            )
    values = {key: factor * _numbers(rows, lines, j, names[j], where) for key, (j, factor) in columns.items()}
    if len(rows) < MIN_SAMPLES:
        raise InputError(f"{where}: {len(rows)} samples; a log needs {MIN_SAMPLES} or more")
    if _TIME in values and period is not None:
        raise InputError(f"{where}: has the column {names[columns[_TIME][0]]}; leave the period out")
    if _TIME not in values and period is None:
        raise InputError(f"{where}: has no column of time, such as t_s; add it, or give the period (--period-s)")
    axes = tuple(axis for axis in AXES if axis in values)
    t: FloatArray = values[_TIME] if period is None else period * np.arange(len(rows), dtype=np.float64)
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if back.size:
        k = int(back[0])
        raise InputError(
            f"{where}:{lines[k + 1]}: time {t[k + 1]:.9g} s follows {t[k]:.9g} s; time must grow from line to line"
        )
    step = float(np.median(np.diff(t)))
    pieces, notes = _pieces(t, step, where)
    if passed:
        notes.append(f"{where}: columns passed over: {shorten(', '.join(passed))}")
    position = np.stack([values[axis] for axis in axes], axis=1)
    return Log(where, axes, t, position, step, tuple(pieces), tuple(notes))


def _cells(text: str, where: str) -> tuple[list[str], list[list[str]], list[int]]:
    """Names of the columns, rows of cells, and the line of each row; lines of # are remarks."""
    kept = [
        (number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line.strip()[0] != "#"
    ]
    if not kept:
        raise InputError(f"{where}: is empty; a log starts with the names of its columns, such as t_s,X_mm,Y_mm")
    head = kept[0][1]
    mark = max(",;\t", key=head.count)
    rows = list(csv.reader(io.StringIO("\n".join(line for _, line in kept)), delimiter=mark, skipinitialspace=True))
    names = [name.strip() for name in rows[0]]
    return names, rows[1:], [number for number, _ in kept[1:]]


def _columns(names: list[str], where: str) -> tuple[dict[str, tuple[int, float]], list[str]]:
    """Column and factor to mm, rad and s of time and of each axis; and the names of other columns."""
    found: dict[str, tuple[int, float]] = {}
    passed: list[str] = []
    for j, name in enumerate(names):
        match = _NAME.fullmatch(name.lower())
        key = _TIME if match and match[1] in ("t", _TIME) else match[1].upper() if match else ""
        if match is None or (key != _TIME and key not in AXES):
            passed.append(name)
            continue
        units = TIMES if key == _TIME else LENGTHS["rad" if key in ROTARY_AXES else "mm"]
        if match[2] not in units:
            first = f"{name}_{next(iter(units))}" if not match[2] else f"{key}_{next(iter(units))}"
            raise InputError(
                f'{where}:1: the column "{shorten(name)}" must name its unit, one of {", ".join(units)}: write {first}'
            )
        if key in found:
            raise InputError(f'{where}:1: the columns "{names[found[key][0]]}" and "{name}" are both {key}; leave one')
        found[key] = (j, units[match[2]])
    if not any(key != _TIME for key in found):
        raise InputError(
            f"{where}:1: no column is an axis ({shorten(', '.join(names))}); the first line names columns and units, such "
            "as t_s,X_mm,Y_mm"
        )
    return found, passed


def _numbers(rows: list[list[str]], lines: list[int], column: int, name: str, where: str) -> FloatArray:
    values = np.empty(len(rows))
    for i, row in enumerate(rows):
        try:
            values[i] = float(row[column])
        except ValueError:
            raise InputError(f'{where}:{lines[i]}: {name}: "{shorten(row[column])}" must be a number') from None
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise InputError(f"{where}:{lines[bad[0]]}: {name} = {values[bad[0]]} must be finite")
    return values


def _pieces(t: FloatArray, step: float, where: str) -> tuple[list[slice], list[str]]:
    """Cut a log at its gaps."""
    gaps = np.flatnonzero(np.diff(t) > _GAP * step)
    edges = [0, *(int(k) + 1 for k in gaps), t.size]
    pieces = [slice(a, b) for a, b in itertools.pairwise(edges) if b - a >= MIN_SAMPLES]
    notes: list[str] = []
    if gaps.size:
        shown = ", ".join(f"{t[k]:.6g} to {t[k + 1]:.6g} s" for k in gaps[:3])
        more = f" and {gaps.size - 3} more" if gaps.size > 3 else ""
        notes.append(f"{where}: {gaps.size} gap{'s' * (gaps.size > 1)} ({shown}{more}); the pieces between are used")
        short = len(edges) - 1 - len(pieces)
        if short:
            notes.append(f"{where}: {short} pieces of less than {MIN_SAMPLES} samples are not used")
    if not pieces:
        raise InputError(
            f"{where}: no {MIN_SAMPLES} samples without a gap (period {step:.6g} s, {gaps.size} gaps); log evenly"
        )
    return pieces, notes
