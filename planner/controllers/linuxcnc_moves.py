"""What LinuxCNC's interpreter makes of a part program: the moves that it hands over to the motion, one row each.

1. *Merging.*  Under G64 P without Q, lines of one feed become one line while all their ends lie within P of it, or with Q
   within Q; at most 101.  Arcs in the plane of X Y whose chord is no farther off become the chords of their halves first.
2. *Limits.*  Of a line along the unit vector n those of the axes, min_j v_j / |n_j|; of an arc those of the slower axis of
   its plane, v <= sqrt(sqrt(3)/2 a r) and what its climb needs.
3. *Ends.*  G61.1 stops, G61 keeps to the path, G64 blends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.controllers.grbl import limit_along
from planner.controllers.straight_blocks import require_straight_axes, stops_of
from planner.errors import InputError
from planner.programs.reading.program import ARC, LINE, RAPID, SPLINE, Program
from planner.types import BoolArray, FloatArray, IntArray

STOPS, EXACT, PARABOLIC = 0, 1, 3  # how a move ends, as in linuxcnc_inline.h
_WAITS_FOR = (
    "dwell",
    "tool_change",
    "stop",
    "optional_stop",
    "end",
    "spindle",
    "coolant",
    "signal",
    "offset",
    "message",
)
_BREAKS = (*_WAITS_FOR, "tool")
_ACROSS = np.sqrt(3.0) / 2.0  # share of the acceleration that an arc has across


@dataclass(frozen=True, eq=False)
class LinuxcncMoves:
    """Moves of the interpreter, n of them.

    Attributes
    ----------
    rows : (n, 21) array
        As ``Move`` in linuxcnc_inline.h: start, end, centre, normal; 0 of a line, 1 of an arc; angle swept about the normal;
        end, rapid, tolerance; speed that is asked for, highest speed, acceleration; own number.
    line : (n,) int array
        Line of the program; of several that became one the last.
    waits : (n + 1,) bool array
        The queue has run empty before a move, and after the last.
    of : (k,) int array
        The move that each part (a line, an arc, a half of it) became part of.
    part_line, part_end : (k,), (k, 3) arrays
        Line of each part and its end, mm.
    """

    rows: FloatArray
    line: NDArray[np.int64]
    waits: BoolArray
    of: IntArray
    part_line: NDArray[np.int64]
    part_end: FloatArray


def linuxcnc_moves(program: Program, velocity: FloatArray, acceleration: FloatArray) -> LinuxcncMoves:
    """Make the moves, on a machine with these velocities and accelerations of X Y Z, (3,), mm/s and mm/s^2.

    Raises
    ------
    InputError
        If the program has splines, moves other axes than X Y Z, or nothing.
    """
    row = np.flatnonzero(program.lengths > 0.0)
    if not row.size:
        raise InputError(f"{program.source}: the program moves nothing; a time needs a move")
    splines = row[program.kind[row] == SPLINE]
    if splines.size:
        raise InputError(
            f"{program.source}:{program.line[splines[0]]}: the model of linuxcnc knows no splines; write them as lines "
            "or arcs"
        )
    require_straight_axes(program, "linuxcnc")
    ending = np.where(program.tolerance[row] != 0.0, PARABOLIC, np.where(program.exact_stop[row], STOPS, EXACT))
    tolerance = np.where(np.isnan(program.tolerance[row]), 0.0, program.tolerance[row])
    merging = np.where(np.isnan(program.naive_tolerance[row]), tolerance, program.naive_tolerance[row])
    merging = np.where(ending == PARABOLIC, merging, 0.0)
    halved = _short_arcs(program, row, merging)
    of, end = _parts(program, row, halved)
    is_line = ((program.kind[row] == LINE) | halved)[of]
    apart = ~is_line
    apart[1:] |= ~is_line[:-1]
    for column in (program.feed[row], tolerance, merging, ending):
        apart[1:] |= column[of[1:]] != column[of[:-1]]
    begins = np.searchsorted(of, np.arange(row.size))  # the first part of each
    apart[begins] |= stops_of(program, row, _BREAKS)[:-1]
    kept = np.zeros(of.size, dtype=np.bool_)
    core.linuxcnc_merge(of.size, end, program.start[row[0], :3].copy(), merging[of], apart, kept)
    last = np.flatnonzero(kept)
    waits = np.zeros(of.size + 1, dtype=np.bool_)
    waits[np.append(begins, of.size)] = stops_of(program, row, _WAITS_FOR)
    first = np.concatenate([[0], last[:-1] + 1])
    move = of[last]
    rows = _rows(program, row[move], program.start[row[0], :3], end[last], is_line[last], (velocity, acceleration))
    rows[:, 14], rows[:, 16], rows[:, 20] = ending[move], tolerance[move], np.arange(last.size)
    return LinuxcncMoves(
        rows, program.line[row[move]], np.append(waits[first], True),
        np.repeat(np.arange(last.size), np.diff(last, prepend=-1)), program.line[row[of]], end,
    )  # fmt: skip


def _short_arcs(program: Program, row: IntArray, merging: FloatArray) -> BoolArray:
    """Which of the moves are arcs that their chords stand for."""
    off = np.full(row.size, np.inf)
    arcs = np.flatnonzero((program.kind[row] == ARC) & (program.normal[row] == 2))
    spoke = (program.start[row[arcs], :3] - program.centre[row[arcs]])[:, :2]
    swept = np.abs(program.sweep[row[arcs]])
    turn = swept - 2.0 * np.pi * np.maximum(np.ceil(swept / (2.0 * np.pi) - 1e-9) - 1.0, 0.0)
    off[arcs] = np.hypot(*spoke.T) * (1.0 - np.cos(0.5 * turn))
    return off < merging


def _parts(program: Program, row: IntArray, halved: BoolArray) -> tuple[IntArray, FloatArray]:
    """The moves with some halved: of which each is, (k,), and where it ends, (k, 3), mm."""
    of = np.repeat(np.arange(row.size), 1 + halved)
    end = np.ascontiguousarray(program.end[row[of], :3])
    inner = np.flatnonzero(of[1:] == of[:-1])
    moves = row[of[inner]]
    spoke = (program.start[moves, :3] - program.centre[moves])[:, :2]
    angle = 0.5 * program.sweep[moves] + np.arctan2(spoke[:, 1], spoke[:, 0])
    radius = np.hypot(*spoke.T)
    end[inner, 0] = program.centre[moves, 0] + radius * np.cos(angle)
    end[inner, 1] = program.centre[moves, 1] + radius * np.sin(angle)
    end[inner, 2] = 0.5 * (program.start[moves, 2] + program.end[moves, 2])
    return of, end


def _rows(
    program: Program,
    move: IntArray,
    first: FloatArray,
    end: FloatArray,
    is_line: BoolArray,
    limits: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Rows of moves that end there (n, 3), the first from ``first`` (3,) on; without ending, tolerance and number."""
    rows = np.zeros((move.size, 21))
    start = np.concatenate([first[None], end[:-1]])
    rapid = program.kind[move] == RAPID
    rows[:, :3], rows[:, 3:6], rows[:, 15] = start, end, rapid
    arcs = np.flatnonzero(~is_line & ~rapid)
    rows[arcs, 6:9] = program.centre[move[arcs]]
    rows[arcs, 9 + program.normal[move[arcs]]] = 1.0
    rows[arcs, 12], rows[arcs, 13] = 1.0, program.sweep[move[arcs]]
    step = end - start
    size = np.sqrt(np.sum(step**2, axis=1))
    way = np.divide(step, size[:, None], out=np.zeros_like(step), where=size[:, None] > 0.0)
    cap, rate = (limit_along(limit, way) for limit in limits)
    cap[arcs], rate[arcs] = _arc_limits(rows[arcs], program.normal[move[arcs]], limits)
    rows[:, 17], rows[:, 18], rows[:, 19] = np.minimum(program.feed[move], cap), cap, rate
    return rows


def _arc_limits(
    rows: FloatArray, normal: NDArray[np.uint8], limits: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Rule 2 for arcs: highest speed and acceleration, (n,)."""
    start, end, centre, sweep = rows[:, :3], rows[:, 3:6], rows[:, 6:9], np.abs(rows[:, 13])
    every = np.arange(normal.size)
    plane = np.stack([(normal + 1) % 3, (normal + 2) % 3], axis=1)
    velocity, acceleration = (limit[plane].min(axis=1) for limit in limits)
    radius = [np.hypot(*np.take_along_axis(point - centre, plane, axis=1).T) for point in (start, end)]
    spiral, least = radius[1] - radius[0], np.minimum(*radius)
    flat = np.hypot(least * sweep, spiral)
    length = np.hypot(flat, (end - start)[every, normal])
    across = np.sqrt(_ACROSS * acceleration * np.hypot(spiral / sweep, least))
    straight = [np.abs(end - start) / limit for limit in limits]
    seconds = np.maximum(straight[0].max(axis=1), flat / np.minimum(across, velocity))
    return length / seconds, length / np.maximum(straight[1].max(axis=1), flat / acceleration)
