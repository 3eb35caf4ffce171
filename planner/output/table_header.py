"""What the header of a feedrate table says of its plan: how it was asked for, and how it ended."""

from __future__ import annotations

import json
from typing import TypeVar, get_args

import numpy as np

from planner.errors import InputError
from planner.files.columns import ColumnFile
from planner.geometry.tolerance import PathKind, PathSide, PathTolerance
from planner.inputs import plain_number, shorten
from planner.machine.limits import MAX_RESERVE
from planner.machine.machine_file import EXAMPLE_MACHINES
from planner.origin import Origin
from planner.status import Status

_Word = TypeVar("_Word", bound=str)
_TRUTH = {"yes": True, "no": False}
# What else a table may say of its curve: how the path was made from a part program or from points.
_TOLERANCE, _SHARE, _MACHINE, _OWN = "path_tolerance_mm", "path_share", "path_machine", "P words"
_KIND, _SIDE = "path_kind", "path_side"
_SLOWED = "slowed"
_RESERVE = "override_reserve"
OPTIONAL_KEYS = (_SLOWED, _RESERVE, _TOLERANCE, _SHARE, _MACHINE, _KIND, _SIDE)
# How earlier versions began what they said of the status.
_STATUS_BEFORE = {
    "slowed down by": "slowed",
    "stalled: the Newton": "singular",
    "stalled: the step": "no step",
    "stalled:": "too many iterations",
}


def tolerance_lines(tolerance: PathTolerance | None) -> dict[str, str]:
    """Header lines of the tolerance a curve was made within: none of an exact curve's."""
    if tolerance is None:
        return {}
    said = {_TOLERANCE: _OWN if tolerance.mm is None else repr(tolerance.mm)}
    said |= {} if tolerance.share == 1.0 else {_SHARE: repr(tolerance.share)}
    said |= {_MACHINE: tolerance.machine} if tolerance.machine else {}
    said |= {} if tolerance.path == PathTolerance.path else {_KIND: tolerance.path}
    return said | ({} if tolerance.side == PathTolerance.side else {_SIDE: tolerance.side})


def _tolerance(file: ColumnFile) -> PathTolerance | None:
    """Read the tolerance of the curve; None of an exact one's."""
    if not {_TOLERANCE, _SHARE, _MACHINE, _KIND, _SIDE} & file.header.keys():
        return None
    mm = None if file.header.get(_TOLERANCE, _OWN) == _OWN else number_of(file, _TOLERANCE)
    share = number_of(file, _SHARE) if _SHARE in file.header else 1.0
    if mm is not None and not 0.0 < mm < np.inf:
        raise InputError(f"{file.path}: the header says {_TOLERANCE} = {mm!r}; it must be > 0 and finite")
    if not 0.0 < share <= 1.0:
        raise InputError(f"{file.path}: the header says {_SHARE} = {share!r}; it must lie within (0, 1]")
    machine = file.header.get(_MACHINE, "")
    if machine and machine not in EXAMPLE_MACHINES:
        raise InputError(
            f'{file.path}: the header says {_MACHINE} = "{shorten(machine)}"; it must be one of '
            f"{', '.join(EXAMPLE_MACHINES)}"
        )
    kinds: dict[str, PathKind] = {kind: kind for kind in get_args(PathKind)}
    sides: dict[str, PathSide] = {side: side for side in get_args(PathSide)}
    kind = _one_of(file, _KIND, kinds, PathTolerance.path)
    return PathTolerance(mm, share, machine, kind, _one_of(file, _SIDE, sides, PathTolerance.side))


def _one_of(file: ColumnFile, key: str, words: dict[str, _Word], default: _Word) -> _Word:
    word = file.header.get(key, default)
    if word not in words:
        raise InputError(
            f'{file.path}: the header says {key} = "{shorten(word)}"; it must be one of {", ".join(words)}'
        )
    return words[word]


def origin_of(file: ColumnFile) -> Origin:
    """Read how the plan was asked for."""
    truths = {key: _truth(file, key) for key in ("exact_stop", "periodic")}
    reserve = _reserve(file)
    return Origin(number_of(file, "limit_period_s"), **truths, tolerance=_tolerance(file), override_reserve=reserve)


def reserve_lines(reserve: float) -> dict[str, str]:
    """Header line of what a plan leaves for feed override: none where it leaves nothing."""
    return {_RESERVE: repr(reserve)} if reserve else {}


def _reserve(file: ColumnFile) -> float:
    """Read what a plan leaves of its limits for feed override; 0 where nothing is said."""
    if _RESERVE not in file.header:
        return 0.0
    reserve = number_of(file, _RESERVE)
    if not 0.0 < reserve <= MAX_RESERVE:
        raise InputError(
            f"{file.path}: the header says {_RESERVE} = {reserve!r}; it must be > 0 and at most {MAX_RESERVE}"
        )
    return reserve


def status_of(file: ColumnFile) -> Status:
    """Read how the plan ended, by the words of today or of before."""
    text = file.header["status"]
    word = next((word for prefix, word in _STATUS_BEFORE.items() if text.startswith(prefix)), text)
    words = {status.value: status for status in Status}
    if word not in words:
        raise InputError(
            f'{file.path}: the header says status = "{shorten(text)}"; it must be one of {", ".join(words)}'
        )
    return words[word]


def number_of(file: ColumnFile, key: str) -> float:
    """Read a number, which may be inf or nan."""
    text = file.header.get(key, "")
    number = plain_number(text, other=("inf", "-inf", "nan"))
    if number is None:
        raise InputError(f'{file.path}: the header says {key} = "{shorten(text)}"; it must be a number')
    return number


def _truth(file: ColumnFile, key: str) -> bool:
    if file.header[key] not in _TRUTH:
        raise InputError(f'{file.path}: the header says {key} = "{shorten(file.header[key])}"; it must be yes or no')
    return _TRUTH[file.header[key]]


def notes_of(file: ColumnFile) -> tuple[str, ...]:
    """Read what a person should know of the plan."""
    try:
        notes = json.loads(file.header["notes"])
    except (ValueError, RecursionError):
        notes = None
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise InputError(
            f"{file.path}: the header says notes = {shorten(file.header['notes'])}; it must be a JSON list of texts"
        )
    return tuple(notes)


def slowed_of(file: ColumnFile, rows: int) -> tuple[tuple[int, float], ...]:
    """Rows from which on, and factors by which, the plan was slowed down; none where it was not."""
    if _SLOWED not in file.header:
        return ()
    text = file.header[_SLOWED]
    try:
        pairs = [(row, factor) for row, factor in json.loads(text)]
    except (TypeError, ValueError, RecursionError):
        pairs = []
    at = [row for row, _ in pairs]
    sound = bool(pairs) and all(type(row) is int and isinstance(factor, float) for row, factor in pairs)
    if (
        not sound
        or at != sorted(set(at))
        or at[0] != 0
        or at[-1] >= rows
        or not all(1.0 <= f < np.inf for _, f in pairs)
    ):
        raise InputError(
            f"{file.path}: the header says slowed = {shorten(text)}; it must be pairs [row, factor], rows increasing "
            "from 0, factors of at least 1"
        )
    return tuple(pairs)
