"""Words that act at once, where the machine stands: homes, coordinate systems, offsets, tool lengths, tool changes.

Each has a function in a table of its modal group.  Order in a block, as LinuxCNC has it: tool change, cutter compensation,
tool length, coordinate system, then the others, then the motion.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.programs.reading.blocks import WordColumn
from planner.programs.reading.compensation_words import COMPENSATIONS, NOT_BESIDE
from planner.programs.reading.cycles import run_cycle
from planner.programs.reading.language import CHANGE, COMPENSATION, DISTANCE, MOTION, ONCE, SYSTEM, TOOL_LENGTH
from planner.programs.reading.modal import ReadingState
from planner.programs.reading.nurbs_blocks import require_closed, run_nurbs
from planner.programs.reading.offsets import SYSTEM_CODES, origin
from planner.programs.reading.positions import CYCLE, NURBS, ProgramTrack, SideMove, block_numbers
from planner.programs.reading.program import RAPID
from planner.programs.reading.threads import THREADS

_FROM_FIXTURE = 11
_OF_TOOLS = (1, 10, _FROM_FIXTURE)


def carry_positions(track: ProgramTrack) -> None:
    """Find the programmed point after every block."""
    at = 0
    for row in track.special_rows().tolist():
        if row > at:
            require_closed(track, at)
            track.run(at, row)
        if track.kind[row] == NURBS:
            run_nurbs(track, row)
            at = row + 1
            continue
        require_closed(track, row)
        _act(track, row)
        at = row
        machine = track.in_machine_coordinates(row)
        if machine:
            _note_machine(track, row)
        if track.kind[row] == CYCLE:
            THREADS.get(int(track.modal[MOTION][row]), run_cycle)(track, row)
            at = row + 1
        elif machine:
            track.run(row, row + 1)
            at = row + 1
    if at < track.kind.size:
        require_closed(track, at)
        track.run(at, track.kind.size)
    tools = track.blocks.letters["T"]
    if tools.given.any():
        track.state.selected = _selected(track, track.kind.size - 1)
        _require_tools(track)
    track.require_near()


def _act(track: ProgramTrack, row: int) -> None:
    blocks = track.blocks
    if blocks.m[CHANGE].given[row]:
        by_number = blocks.number(row, "Q") if blocks.m[CHANGE].value[row] != 6 else None
        track.state.loaded = _selected(track, row) if by_number is None else int(by_number)
        if by_number is None and track.state.beside is not None and row == 0:
            _stand_beside(track)
        if by_number is None and track.state.offsets.tool_change is not None:
            _go_to_tool_change(track, row)
    for group, table in ((COMPENSATION, COMPENSATIONS), (TOOL_LENGTH, _LENGTHS), (SYSTEM, _SYSTEMS), (ONCE, _ONCE)):
        if blocks.g[group].given[row]:
            table.get(int(blocks.g[group].value[row]), _nothing)(track, row)


def _stand_beside(track: ProgramTrack) -> None:
    """M6 behind a G40 that no move follows: LinuxCNC asks where the machine is, and that is beside the programmed point."""
    state = track.state
    if state.beside is None or state.stands_beside:
        return
    state.stands_beside = True
    for point in (state.programmed, state.position):
        point[:3] += state.beside
    track.points[0] = state.programmed[: state.carried]


def _require_tools(track: ProgramTrack) -> None:
    """Refuse tools that the table, where there is one, lacks."""
    offsets, tools = track.state.offsets, track.blocks.letters["T"]
    if offsets.given is not None:
        known = np.isin(tools.value, [0, *offsets.given, *offsets.written])
        track.blocks.faults.add(tools.at(~known), "the tool table has no such tool; add a line for it, as T1 P1 Z40 D6")


def _selected(track: ProgramTrack, row: int) -> int:
    """The tool named last, at a block."""
    column = track.blocks.letters["T"]
    rows = np.flatnonzero(column.given[: row + 1])
    return int(column.value[rows[-1]]) if rows.size else track.state.selected


def _nothing(track: ProgramTrack, row: int) -> None:
    """A word that is looked at elsewhere."""


def _refuse(track: ProgramTrack, column: WordColumn, row: int, reason: str) -> None:
    track.blocks.faults.add(column.word[row : row + 1], reason)


def _note_machine(track: ProgramTrack, row: int) -> None:
    state = track.state
    motion = track.modal[MOTION][row]
    if motion not in (0, 10):
        _refuse(track, track.blocks.g[ONCE], row, "machine coordinates need G0 or G1")
    if track.modal[DISTANCE][row] != 900 and track.kind[row] >= RAPID:
        _refuse(track, track.blocks.g[ONCE], row, "machine coordinates are absolute; write G90 before")
    code = SYSTEM_CODES[state.offsets.active]
    if not state.offsets.is_known(code):
        state.offsets.assume(f"the origin of G{code / 10:g} on the machine, for G53", int(track.blocks.line[row]))


def _numbers(track: ProgramTrack, row: int) -> list[float | None]:
    return block_numbers(track.blocks, row, float(track.unit[row]))


def _go_home(track: ProgramTrack, row: int) -> None:
    """G28 and G30: over the point in the block, in the axes that it names, to the home; without axes in all."""
    state, blocks = track.state, track.blocks
    code = int(blocks.g[ONCE].value[row])
    home, line = state.offsets.home[code], int(blocks.line[row])
    if not state.offsets.is_known(code):
        state.offsets.assume(f"the position of G{code // 10}", line)
    numbers = _numbers(track, row)
    if any(number is not None for number in numbers):
        relative = track.modal[DISTANCE][row] != 900
        middle = state.programmed.copy()
        for axis, number in enumerate(numbers):
            if number is None:
                continue
            if not state.known[axis] and state.axis_lines[axis] == 0:
                track.stand(row, axis, float(home[axis]))
                middle[axis] = home[axis]
            if state.axis_lines[axis] == 0:
                state.axis_lines[axis] = line
            middle[axis] = middle[axis] + number if relative else number + state.offsets.total[axis]
        track.side.append(SideMove(row, RAPID, middle))
    end = state.programmed.copy()
    for axis in range(end.size):
        if all(number is None for number in numbers) or numbers[axis] is not None:
            if not state.known[axis] and state.axis_lines[axis] == 0:
                track.stand(row, axis, float(home[axis]))
            end[axis] = home[axis]
    track.side.append(SideMove(row, RAPID, end))
    state.programmed = end.copy()


def _go_to_tool_change(track: ProgramTrack, row: int) -> None:
    """M6 on a machine that changes tools in one place: a rapid there, in the axes that its file names."""
    state, blocks = track.state, track.blocks
    if track.kind[row] >= RAPID or blocks.g[ONCE].has(280)[row] or blocks.g[ONCE].has(300)[row]:
        reason = "M6 leads to the tool change position of the machine file; write the motion in a block of its own"
        _refuse(track, blocks.m[CHANGE], row, reason)
        return
    end = state.programmed.copy()
    for axis, at in (state.offsets.tool_change or {}).items():
        if not state.known[axis] and state.axis_lines[axis] == 0:
            track.stand(row, axis, at)
        if state.axis_lines[axis] == 0:
            state.axis_lines[axis] = blocks.line[row]
        end[axis] = at
    track.side.append(SideMove(row, RAPID, end))
    state.programmed = end.copy()


def _set_home(track: ProgramTrack, row: int) -> None:
    """G28.1 and G30.1: the home is where the machine stands."""
    code = int(track.blocks.g[ONCE].value[row]) - 1
    track.state.offsets.home[code] = track.state.programmed.copy()
    track.state.known = [True] * len(track.state.known)


def _set_shift(track: ProgramTrack, row: int) -> None:
    """G92: where the machine stands is the point in the block.  G52: the shift itself."""
    state = track.state
    local = track.blocks.g[ONCE].value[row] == 520
    for axis, number in enumerate(_numbers(track, row)):
        if number is not None:
            here = state.programmed[axis] - state.offsets.total[axis]
            state.offsets.shift[axis] = number if local else state.offsets.shift[axis] + here - number
            state.known[axis] = True
    state.offsets.kept_shift = state.offsets.shift.copy()


def _clear_shift(track: ProgramTrack, row: int) -> None:
    """G92.1 and G92.2: no shift; G92.1 forgets it."""
    offsets = track.state.offsets
    offsets.shift = origin()
    if track.blocks.g[ONCE].value[row] == 921:
        offsets.kept_shift = origin()


def _restore_shift(track: ProgramTrack, row: int) -> None:
    """G92.3: the shift as it was before G92.2."""
    track.state.offsets.shift = track.state.offsets.kept_shift.copy()


def _set_offsets(track: ProgramTrack, row: int) -> None:
    """G10: L1 the offsets of a tool, L10 and L11 so that with it the machine stands at a point of the active system or of
    G59.3; L2 the origin of a system, L20 so that the machine stands at a point of it.
    """
    state, blocks = track.state, track.blocks
    level, which, numbers = blocks.number(row, "L"), blocks.number(row, "P"), _numbers(track, row)
    if level is None or which is None:
        return  # refused already
    if level in _OF_TOOLS:
        _write_tool(track, row, int(level))
        return
    if level not in (2.0, 20.0):
        _refuse(track, blocks.letters["L"], row, "of G10 only L1, L2, L10, L11 and L20 are read")
        return
    if which not in range(10):
        _refuse(track, blocks.letters["P"], row, "the number of a coordinate system is 1 to 9, or 0 for the active one")
        return
    if blocks.number(row, "R"):
        _refuse(track, blocks.letters["R"], row, "a coordinate system that is turned is not read; turn the program")
    system = int(which) - 1 if which else state.offsets.active
    if system == state.offsets.active and track.modal[COMPENSATION][row] != 400:
        _refuse(track, blocks.g[ONCE], row, NOT_BESIDE)
        return
    for axis, number in enumerate(numbers):
        if number is not None and level == 2.0:
            state.offsets.systems[system, axis] = number
        elif number is not None:
            rest = state.offsets.shift[axis] + state.offsets.length[axis]
            state.offsets.systems[system, axis] = state.programmed[axis] - rest - number
            state.known[axis] = True


def _write_tool(track: ProgramTrack, row: int, level: int) -> None:
    """G10 L1, L10 and L11."""
    state, blocks, which = track.state, track.blocks, track.blocks.number(row, "P") or 0.0
    if which < 1 or which != int(which):
        _refuse(track, blocks.letters["P"], row, "the number of a tool must be a whole number of at least 1")
    tool = state.offsets.to_write(int(which))
    for axis, number in enumerate(_numbers(track, row)):
        if number is not None:
            tool[axis] = number if level == 1 else _beyond(state, axis, from_fixture=level == _FROM_FIXTURE) - number
    radius = blocks.number(row, "R")
    if radius is not None:
        state.offsets.radii[int(which)] = radius * float(track.unit[row])


def _beyond(state: ReadingState, axis: int, *, from_fixture: bool) -> float:
    """Where the machine is from the origin of the active system and G92, or of G59.3, without a tool."""
    offsets = state.offsets
    base = offsets.systems[-1, axis] if from_fixture else offsets.systems[offsets.active, axis] + offsets.shift[axis]
    state.known[axis] = True
    return float(state.programmed[axis] - base)


def _choose_system(track: ProgramTrack, row: int) -> None:
    """G54 to G59.3."""
    offsets, code = track.state.offsets, int(track.blocks.g[SYSTEM].value[row])
    offsets.active = SYSTEM_CODES.index(code)
    if offsets.active and not offsets.is_known(code):
        offsets.assume(f"the origin of G{code / 10:g}", int(track.blocks.line[row]))


def _tool_offset(track: ProgramTrack, row: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The offset of the tool H, or where there is no H of the one in the spindle."""
    state, blocks = track.state, track.blocks
    named = blocks.number(row, "H")
    number = state.loaded if named is None else int(named)
    found = state.offsets.of_tool(number)
    if found is None:
        column = blocks.letters["H"] if named is not None else blocks.g[TOOL_LENGTH]
        _refuse(track, column, row, f"the tool table has no tool {number}; add a line T{number} with its length Z")
        return origin()
    if state.offsets.given is None and number and number not in state.offsets.written:
        state.offsets.assume(f"the length of tool {number}", int(blocks.line[row]))
    return found


def _take_length(track: ProgramTrack, row: int) -> None:
    track.state.offsets.length = _tool_offset(track, row).copy()


def _given_length(track: ProgramTrack, row: int) -> None:
    """G43.1: the offsets in the block, in the axes that it names."""
    length = track.state.offsets.length.copy()
    for axis, number in enumerate(_numbers(track, row)):
        length[axis] = length[axis] if number is None else number
    track.state.offsets.length = length


def _more_length(track: ProgramTrack, row: int) -> None:
    """G43.2: on top of the length in force, that of the tool H, or the offsets in the block."""
    numbers = _numbers(track, row)
    by_axes = any(number is not None for number in numbers)
    more = np.array([number or 0.0 for number in numbers]) if by_axes else _tool_offset(track, row)
    track.state.offsets.length = track.state.offsets.length + more


def _no_length(track: ProgramTrack, row: int) -> None:
    track.state.offsets.length = origin()


_Act = Callable[[ProgramTrack, int], None]
_ONCE: dict[int, _Act] = {
    100: _set_offsets,
    **dict.fromkeys((280, 300), _go_home),
    **dict.fromkeys((281, 301), _set_home),
    **dict.fromkeys((520, 920), _set_shift),
    **dict.fromkeys((921, 922), _clear_shift),
    923: _restore_shift,
}
_LENGTHS: dict[int, _Act] = {430: _take_length, 431: _given_length, 432: _more_length, 490: _no_length}
_SYSTEMS: dict[int, _Act] = dict.fromkeys(SYSTEM_CODES, _choose_system)
