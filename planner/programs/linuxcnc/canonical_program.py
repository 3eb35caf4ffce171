"""A part program as LinuxCNC reads it: its canonical calls as moves, with the lines that they come from.

Where the interpreter does not tell something in its calls, it is taken from the words of the line that it ran: stops,
spindle and coolant, the tolerances of G64, and the pitch of threads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.curve import AXES
from planner.inputs import require_path
from planner.programs.linuxcnc import canon
from planner.programs.linuxcnc.calls import (
    DISTANCE,
    FEED_MODE,
    PATH_MODE,
    CallColumns,
    require_read,
    sorted_calls,
    unit_mm,
)
from planner.programs.linuxcnc.interpreter import CanonicalCalls, canonical_calls
from planner.programs.linuxcnc.line_events import events_and_tolerances
from planner.programs.reading.modal import MoveColumns, ReadingState
from planner.programs.reading.program import (
    ANGULAR,
    ARC,
    LINE,
    RAPID,
    ZERO_LENGTH_MM,
    Program,
    arc_lengths,
    feed_lengths,
)
from planner.programs.reading.setup import Tool, read_tool_table
from planner.programs.reading.unread import UnreadWords
from planner.programs.reading.words import LineArray, Mask
from planner.types import FloatArray

_EXACT_PATH, _EXACT_STOP = 610, 611
_PER_MINUTE = 940
_ABSOLUTE = 900
_SAME_DIRECTION = 1e-6  # rad; LinuxCNC makes a full turn of less


def read_with_linuxcnc(
    path: str | Path, *, tools: str | Path | Mapping[int, Tool] | None = None, from_zero: bool = False
) -> Program:
    """Read a part program by an installed LinuxCNC.

    Parameters
    ----------
    path : str or Path
        The program.  Files that it calls are looked for beside it.
    tools : str, Path or mapping of int to Tool, optional
        A tool table of LinuxCNC, or the tools by their numbers; left out, every tool has the length 0.
    from_zero : bool
        The machine stands at 0 before the first block; otherwise where the first rapids lead.

    Returns
    -------
    Program
        The moves of the interpreter; splines are the chords that it makes of them.

    Raises
    ------
    InputError
        Where LinuxCNC is not installed, refuses the program (with its message and the line), or does not end.
    """
    file = require_path(path)
    table = read_tool_table(tools) if isinstance(tools, str | Path) else tools
    calls = canonical_calls(file, table)
    require_read(calls)
    return _program(file.name, calls, assumed=table is None, from_zero=from_zero)


def _program(source: str, calls: CanonicalCalls, *, assumed: bool, from_zero: bool) -> Program:
    """Make the program; ``assumed``: there is no tool table."""
    table, columns = calls.rows, sorted_calls(calls)
    ends = np.ascontiguousarray(table[columns.rows, 3:12])
    state = ReadingState(source, UnreadWords(source), carried=len(AXES))
    _note_axes(state, columns.line, ends)
    if not from_zero:
        _stand(state, columns, ends)
    keep = np.empty(columns.kind.size, dtype=np.uint8)
    arc = columns.kind == canon.ARC
    core.reader_merge_short_moves(keep.size, ends.shape[1], ends, arc, ZERO_LENGTH_MM, state.position, keep)
    kept = keep == 1
    counts = np.zeros(len(table), dtype=np.int64)
    counts[columns.rows[kept]] = 1
    state.events, tolerances = events_and_tolerances(calls, columns, np.cumsum(counts) - 1)
    state.zero_lines.append(columns.line[~kept])
    state.line_count, state.ended, state.moves = calls.marked.line_count, True, int(kept.sum())
    starts = np.concatenate([state.first[None], ends[kept]])[: state.moves]
    state.parts.append(_columns(columns, table[columns.rows], kept, (starts, ends[kept]), tolerances))
    if assumed:
        for number in calls.marked.tools:
            state.offsets.assume(f"the length of tool {number}", 1)
    program = state.program()
    return replace(program, notes=(*program.notes, "read by LinuxCNC's interpreter: splines are its chords"))


def _columns(
    columns: CallColumns, table: FloatArray, kept: Mask, points: tuple[FloatArray, FloatArray], tolerances: FloatArray
) -> MoveColumns:
    """The kept moves."""
    (start, end), table, state = points, table[kept], columns.state[kept]
    called = table[:, 0].astype(np.int64)
    kind = np.full(called.size, LINE, dtype=np.uint8)
    kind[called == canon.RAPID] = RAPID
    arcs = np.flatnonzero(called == canon.ARC)
    kind[arcs] = ARC
    normal = np.array([2, 2, 0, 1], dtype=np.uint8)[table[:, -1].astype(np.int64)]
    centre, sweep = np.full((called.size, 3), np.nan), np.zeros(called.size)
    centre[arcs], sweep[arcs] = _arcs(start[arcs, :3], end[arcs, :3], normal[arcs], table[arcs, 12:15])
    exact = state[:, PATH_MODE] == _EXACT_STOP
    on_path = exact | (state[:, PATH_MODE] == _EXACT_PATH)
    along = arc_lengths(start[arcs], end[arcs], centre[arcs], normal[arcs], sweep[arcs])
    # Of a move in degrees alone F is in degrees, which inches do not change.
    turns = feed_lengths(start, end, arcs, along)[1] == ANGULAR
    feed = np.where(turns, columns.feed[kept] / unit_mm(state), columns.feed[kept])
    rapid = kind == RAPID
    modal_feed = np.where(rapid & ((state[:, FEED_MODE] != _PER_MINUTE) | (feed == 0.0)), np.nan, feed)
    feed[rapid] = np.inf
    return MoveColumns(
        columns.line[kept], kind, end, centre, normal, sweep, np.full(called.size, -1), feed, exact,
        np.where(on_path, 0.0, tolerances[kept, 0]), np.where(on_path, np.nan, tolerances[kept, 1]),
        np.zeros(called.size, dtype=np.int64), modal_feed,
    )  # fmt: skip


def _arcs(
    start: FloatArray, end: FloatArray, normal: NDArray[np.uint8], arc: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Centre and sweep, from the two coordinates of the centre and the turns, of which the first may be a part of one."""
    rows, first, second = np.arange(normal.size), (normal + 1) % 3, (normal + 2) % 3
    centre = start.copy()
    centre[rows, first], centre[rows, second] = arc[:, 0], arc[:, 1]
    angle = [np.arctan2(p[rows, second] - arc[:, 1], p[rows, first] - arc[:, 0]) for p in (start, end)]
    clockwise = arc[:, 2] < 0.0
    turn = np.where(clockwise, angle[0] - angle[1], angle[1] - angle[0]) % (2.0 * np.pi)
    turn[(turn < _SAME_DIRECTION) | (turn > 2.0 * np.pi - 1e-12)] = 2.0 * np.pi
    sweep = turn + 2.0 * np.pi * (np.abs(arc[:, 2]) - 1.0)
    return centre, np.where(clockwise, -sweep, sweep)


def _stand(state: ReadingState, columns: CallColumns, ends: FloatArray) -> None:
    """An axis whose first move is an absolute rapid stood there from the start, as :mod:`..reading.reader` has it."""
    for axis in range(len(AXES)):
        first = int(np.argmax(np.abs(ends[:, axis] - state.position[axis]) > ZERO_LENGTH_MM)) if ends.size else 0
        if ends.size and columns.kind[first] == canon.RAPID and columns.state[first, DISTANCE] == _ABSOLUTE:
            ends[:first, axis] = ends[first, axis]
            state.position[axis] = state.first[axis] = ends[first, axis]


def _note_axes(state: ReadingState, line: LineArray, ends: FloatArray) -> None:
    """The first line that moves each axis."""
    for axis in range(len(AXES)):
        moved = np.abs(np.diff(ends[:, axis], prepend=0.0)) > ZERO_LENGTH_MM
        if moved.any():
            state.axis_lines[axis] = line[np.argmax(moved)]
