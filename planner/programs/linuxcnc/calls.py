"""The canonical calls by what they are: moves, marks of lines, states of the interpreter."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.programs.linuxcnc import canon
from planner.programs.linuxcnc.interpreter import CanonicalCalls
from planner.programs.linuxcnc.marks import word_value
from planner.programs.reading.modal import INCH_MM
from planner.programs.reading.words import LineArray
from planner.types import FloatArray

_MOVES = (canon.RAPID, canon.LINE, canon.ARC, canon.PROBE, canon.TAP)
# Columns of a STATE row.
FEED_MODE, PATH_MODE, SPEED, MOTION, DISTANCE, UNITS = range(3, 9)
_PER_TURN, _INCH = 950, 200
_CYCLE = 760
_APART_MM = 1e-6
_THREADS = (330, 331, _CYCLE)
_NEAR = 6  # rows behind a mark, in which a pitch is told
_LOST = {
    canon.LOST_UNITS: "the tool length was taken in other units, which LinuxCNC's interpreter mixes up where no machine is "
    "there; write G49 before G20 or G21",
    canon.LOST_PLACE: "the tool change before comes after an arc, or after a change of offsets, and LinuxCNC's interpreter "
    "does not know where a move to a home begins where no machine is there; write a straight move before the tool change",
}
_TOOL_WRITTEN = re.compile(r"L1[01]?(?![\d.])")


@dataclass(frozen=True, eq=False)
class CallColumns:
    """The moves of a program: rows of the calls, line of each, feed in mm/s, and the state in force.

    ``marks`` are the rows of the marks, ``mark_lines`` the lines of the program they stand for.
    """

    rows: LineArray
    kind: LineArray
    line: LineArray
    feed: FloatArray
    state: FloatArray
    marks: LineArray
    mark_lines: LineArray


def _require_tools_kept(calls: CanonicalCalls) -> None:
    """Refuse a tool change after G10 L1: the interpreter takes the tools from the table again, where no machine wrote it."""
    changes = np.flatnonzero(calls.rows[:, 0] == canon.TOOL)
    for row in np.flatnonzero(calls.rows[: changes[-1] if changes.size else 0, 0] == canon.MARK).tolist():
        file, line = calls.rows[row, 3:5].astype(np.int64).tolist()
        text = calls.marked.lines[file][line - 1]
        if "G10" in text and _TOOL_WRITTEN.search(text):
            raise InputError(
                f"{calls.marked.names[file]}:{line}: {text[:40]}: a tool is changed afterwards, and LinuxCNC's interpreter "
                "forgets this where no machine is there; write it behind the last tool change, or into the tool table"
            )


def require_read(calls: CanonicalCalls) -> None:
    """Raise InputError with LinuxCNC's message where it refuses the program, or where it has no machine to ask."""
    lost = np.flatnonzero(calls.rows[:, 0] == canon.LOST)
    if lost.size:
        row = int(lost[0])
        mark = calls.rows[np.flatnonzero(calls.rows[:row, 0] == canon.MARK)[-1]]
        name, line = calls.marked.names[int(mark[3])], int(mark[4])
        raise InputError(
            f"{name}:{line}: {calls.marked.lines[int(mark[3])][line - 1][:40]}: {_LOST[int(calls.rows[row, 3])]}"
        )
    _require_tools_kept(calls)
    if not calls.message:
        return
    lines = calls.marked.lines[calls.file]
    word = lines[calls.line - 1][:40] if calls.line <= len(lines) else ""
    raise InputError(
        f"{calls.marked.names[calls.file]}:{calls.line}: {word or 'end of file'}: LinuxCNC refuses it: {calls.message}"
    )


def sorted_calls(calls: CanonicalCalls) -> CallColumns:
    """Find the moves, their lines and feeds."""
    table = calls.rows
    kind = table[:, 0].astype(np.int64)
    marks, states = np.flatnonzero(kind == canon.MARK), np.flatnonzero(kind == canon.STATE)
    moves = np.flatnonzero(np.isin(kind, _MOVES))
    # What is in force is told before the next line: the state after a call is the one that it was made in.
    state = table[states[np.minimum(np.searchsorted(states, moves), states.size - 1)]]
    in_main = table[marks, 3] == 0
    main_line = np.maximum.accumulate(np.where(in_main, table[marks, 4], 0)).astype(np.int64)
    last = np.searchsorted(marks, moves) - 1
    numbers = np.asarray(calls.marked.numbers)
    own = numbers[np.clip(table[moves, 1].astype(np.int64), 0, numbers.size - 1)]
    called = (last >= 0) & ~in_main[np.maximum(last, 0)]
    line = np.where(called, main_line[np.maximum(last, 0)] if marks.size else 0, own)
    feed = table[moves, 2] / 60.0
    turning = state[:, FEED_MODE] == _PER_TURN
    feed[turning] *= state[turning, SPEED]
    threads = np.isin(state[:, MOTION], _THREADS) & (kind[moves] != canon.RAPID)
    for index in np.flatnonzero(threads).tolist():
        letter = "P" if state[index, MOTION] == _CYCLE else "K"
        pitch = _pitch(calls, int(marks[last[index]]), int(line[index]), letter) * float(unit_mm(state[index]))
        feed[index] = pitch * state[index, SPEED] / 60.0
        if (
            index
            and kind[moves[index - 1]] == kind[moves[index]] == canon.TAP
            and marks[last[index]] < moves[index - 1]
        ):
            feed[index] *= max(_number_of(calls, int(marks[last[index]]), "I") or 1.0, 1.0)  # back, this much faster
    _steepen(table[moves, 3:6], kind[moves], state, feed)
    return CallColumns(moves, kind[moves], line, feed, state, marks, main_line)


def _steepen(points: FloatArray, kind: LineArray, state: FloatArray, feed: FloatArray) -> None:
    """Where a G76 leads in or out, its pitch is that of the thread along Z, and the way is longer as it is slanted."""
    step = np.abs(np.diff(points, axis=0, prepend=points[:1]))
    across = (state[:, MOTION] == _CYCLE) & (kind == canon.LINE) & (step[:, 0] > _APART_MM)
    slanted = np.flatnonzero(across & (step[:, 2] > _APART_MM))
    rise = np.hypot(step[slanted, 0], step[slanted, 2]) / step[slanted, 2]
    for at, times in zip(slanted.tolist(), rise.tolist(), strict=True):
        feed[at] *= times
        if across[at - 1] and step[at - 1, 2] <= _APART_MM:  # in to the depth from where it begins
            feed[at - 1] *= times


def unit_mm(state: FloatArray) -> FloatArray:
    """Length unit in force in each state, mm."""
    return np.where(state[..., UNITS] == _INCH, INCH_MM, 1.0)


def _pitch(calls: CanonicalCalls, mark: int, line: int, letter: str) -> float:
    """Way along a thread of a turn of the spindle, in the program's units: it stands in the line, or in the dwell before it
    (``marks``).
    """
    for row in calls.rows[mark + 1 : mark + _NEAR]:
        if row[0] == canon.PITCH:
            return float(row[3])
        if row[0] == canon.MARK:
            break
    found = _number_of(calls, mark, letter)
    if found is None:
        raise InputError(
            f"{calls.marked.names[0]}:{line}: LinuxCNC does not tell the pitch of a thread, and here it is no number; write "
            f"{letter} with a number, or G33 or G76 into this block"
        )
    return abs(found)


def _number_of(calls: CanonicalCalls, mark: int, letter: str) -> float | None:
    """The number behind a letter in the line of a mark; None where there is none."""
    file, number = calls.rows[mark, 3:5].astype(np.int64).tolist()
    try:
        return float(word_value(calls.marked.lines[file][number - 1], letter))
    except ValueError:
        return None
