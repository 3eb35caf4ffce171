"""Canned cycles as the moves that LinuxCNC makes of them, with their dwells.

Of a hole at (x, y) the tool goes by rapid over it, to the plane R, and from there as its cycle says: the functions in
``_CYCLES``.  In the end it stands at R (G99), or at the level of the axis before the first of a series of cycles, where
that is above R (G98).  Under G91 R counts from that level and Z from R; L repeats, each time by X and Y farther.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.geometry.curve import AXES
from planner.programs.reading.language import DISTANCE, FEED_MODE, MOTION, PLANE, RETRACT, SPINDLE
from planner.programs.reading.modal import CycleSeries
from planner.programs.reading.positions import ProgramTrack, SideMove, block_numbers
from planner.programs.reading.program import LINE, RAPID, ZERO_LENGTH_MM

_CHIP_GAP_MM = 0.254  # above the last depth, where a peck begins; 0.01 inch, also in mm
_MAX_MOVES = 1_000_000  # of one block
# Step of a hole: kind of move, level, seconds of dwell after it.
_Step = tuple[int, float, float]
# Of a cycle: plane R, level to go back to, bottom, depth of a peck, dwell -> steps.
_Steps = Callable[[float, float, float, float, float], list[_Step]]


def _drill(plane: float, back: float, bottom: float, peck: float, dwell: float) -> list[_Step]:
    """G81, G82 and G86: feed down, dwell, rapid out."""
    return [(LINE, bottom, dwell), (RAPID, back, 0.0)]


def _bore(plane: float, back: float, bottom: float, peck: float, dwell: float) -> list[_Step]:
    """G85: feed down and out to the plane R."""
    return [(LINE, bottom, 0.0), (LINE, plane, 0.0), (RAPID, back, 0.0)]


def _feed_out(plane: float, back: float, bottom: float, peck: float, dwell: float) -> list[_Step]:
    """G89, and the tapping G74 and G84: feed down, dwell, feed out."""
    return [(LINE, bottom, dwell), (LINE, back, 0.0)]


def _break_chips(plane: float, back: float, bottom: float, peck: float, dwell: float) -> list[_Step]:
    """G73: pecks, each with a short way back."""
    out: list[_Step] = []
    depth = plane - peck
    while depth - bottom > ZERO_LENGTH_MM:
        out += [(LINE, depth, 0.0), (RAPID, depth + _CHIP_GAP_MM, 0.0)]
        depth -= peck
    return [*out, (LINE, bottom, 0.0), (RAPID, back, 0.0)]


def _clear_chips(plane: float, back: float, bottom: float, peck: float, dwell: float) -> list[_Step]:
    """G83: pecks, each with a way back to the plane R and down again to just above the last depth."""
    out: list[_Step] = []
    depth = plane - peck
    while depth - bottom > ZERO_LENGTH_MM:
        out += [(LINE, depth, 0.0), (RAPID, plane, 0.0), (RAPID, depth + _CHIP_GAP_MM, 0.0)]
        depth -= peck
    return [*out, (LINE, bottom, 0.0), (RAPID, back, 0.0)]


_CYCLES: dict[int, _Steps] = {
    **dict.fromkeys((810, 820, 860), _drill),
    850: _bore,
    **dict.fromkeys((890, 740, 840), _feed_out),
    730: _break_chips,
    830: _clear_chips,
}
_PECKS = (730, 830)
_DWELLS = (820, 860, 890)


# How the spindle turns, M3 or M4.
_SPINDLE = {740: (4,), 840: (3,), 860: (3, 4)}
_SPINDLE_SAID = {740: "M4", 840: "M3", 860: "M3 or M4"}


def _spindle(track: ProgramTrack, row: int) -> int:
    """The word of the spindle in force at a block."""
    column = track.blocks.m[SPINDLE]
    rows = np.flatnonzero(column.given[: row + 1] & np.isin(column.value[: row + 1], (3, 4, 5)))
    return int(column.value[rows[-1]]) if rows.size else track.state.spindle_code


@dataclass(frozen=True)
class _Hole:
    """What the words of a block, and those kept from the block before, say of a cycle; mm and s."""

    plane: float
    bottom: float
    peck: float
    dwell: float
    repeats: int


def run_cycle(track: ProgramTrack, row: int) -> None:
    """Make the moves of the cycle in a block."""
    state = track.state
    normal = {17: 2, 18: 1, 19: 0}[int(track.modal[PLANE][row]) // 10]
    code = int(track.modal[MOTION][row])
    series = state.series if state.series is not None else CycleSeries(code, float(state.programmed[normal]))
    hole = _hole(track, row, series, normal, code)
    if hole is not None:
        state.series = series
        _drill_all(track, row, hole, series, normal)
    track.points[row + 1] = state.programmed[: state.carried]


def _hole(track: ProgramTrack, row: int, series: CycleSeries, normal: int, code: int) -> _Hole | None:
    """Complete the words of a block by those kept; None where something is refused."""
    blocks, unit = track.blocks, float(track.unit[row])
    kept = series.numbers if series.code == code else {}
    numbers = {name: value for name in ("R", "Q", "P") if (value := blocks.number(row, name)) is not None}
    numbers |= {name: value * unit for name, value in numbers.items() if name != "P"}
    depth = block_numbers(blocks, row, unit)[normal]
    if depth is not None:
        numbers["Z"] = depth
    numbers = kept | numbers
    series.code, series.numbers = code, numbers
    word = blocks.first_of("XYZ", np.arange(track.kind.size) == row)
    needs = (
        {"Z": AXES[normal], "R": "R"} | ({"Q": "Q"} if code in _PECKS else {}) | ({"P": "P"} if code in _DWELLS else {})
    )
    lacking = [name for key, name in needs.items() if key not in numbers]
    repeats = blocks.number(row, "L")
    reason = ""
    if lacking:
        reason = f"the first block of a cycle G{code // 10} needs {' and '.join(lacking)}"
    elif repeats == 0.0:
        reason = "a cycle is repeated at least once; L must be > 0"
    elif code in _PECKS and numbers["Q"] <= 0.0:
        reason = "the depth Q of a peck must be > 0"
    elif code in _SPINDLE and (turning := _spindle(track, row)) not in _SPINDLE[code]:
        reason = (
            f"a cycle G{code // 10} needs a spindle that turns, {_SPINDLE_SAID[code]}"
            if turning == 5
            else (f"the spindle turns the other way; a cycle G{code // 10} needs {_SPINDLE_SAID[code]}")
        )
    elif track.modal[FEED_MODE][row] == 930:
        reason = "a cycle needs a feed in units a minute or a turn, G94 or G95"
    if reason:
        blocks.faults.add(word, reason)
        return None
    relative = track.modal[DISTANCE][row] != 900
    offset = float(track.state.offsets.total[normal])
    plane = numbers["R"] + (series.level if relative else offset)
    bottom = numbers["Z"] + (plane if relative else offset)
    hole = _Hole(plane, bottom, numbers.get("Q", 0.0), numbers.get("P", 0.0), int(repeats or 1))
    if plane < bottom:
        blocks.faults.add(word, f"the plane R lies {bottom - plane:.6g} mm below the bottom of the hole")
        return None
    count = 3.0 * ((plane - bottom) / hole.peck if code in _PECKS else 1.0) * hole.repeats
    if count > _MAX_MOVES:
        blocks.faults.add(word, f"makes {count:.3g} moves of one block; at most {_MAX_MOVES} are read: look at Q and L")
        return None
    return hole


def _drill_all(track: ProgramTrack, row: int, hole: _Hole, series: CycleSeries, normal: int) -> None:
    """The moves of all repeats."""
    state = track.state
    relative = track.modal[DISTANCE][row] != 900
    numbers = block_numbers(track.blocks, row, float(track.unit[row]))
    for axis in range(len(AXES)):
        if numbers[axis] is None or state.axis_lines[axis]:
            continue
        state.axis_lines[axis] = track.blocks.line[row]
        if axis != normal and not relative and not state.known[axis]:
            track.stand(row, axis, float(numbers[axis] + state.offsets.total[axis]))
    at = state.programmed.copy()

    def go(kind: int, axis: int, value: float, dwell: float = 0.0) -> None:
        at[axis] = value
        track.side.append(SideMove(row, kind, at.copy(), dwell))

    if series.level < hole.plane:
        go(RAPID, normal, hole.plane)
    back = hole.plane if track.modal[RETRACT][row] == 990 else max(series.level, hole.plane)
    steps = _CYCLES[series.code](hole.plane, back, hole.bottom, hole.peck, hole.dwell)
    for repeat in range(hole.repeats):
        for axis, number in enumerate(numbers):
            if axis != normal and number is not None:
                at[axis] = at[axis] + number if relative else number + state.offsets.total[axis]
        if repeat or at[normal] <= hole.plane:
            at[normal] = back  # below the plane R, or where the words have changed since, on a slope
        track.side.append(SideMove(row, RAPID, at.copy()))
        go(RAPID, normal, hole.plane)
        for kind, level, dwell in steps:
            go(kind, normal, level, dwell)
    state.programmed = at
