"""The words of cutter compensation: which tool they take, and what may not stand beside them.

D names a tool of the table, of G41.1 and G42.1 a diameter; without D it is the tool in the spindle.  A radius below 0 is
one on the other side.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.programs.reading.blocks import Blocks
from planner.programs.reading.compensation import LATHE_ORIENTATIONS, CompensatedTool
from planner.programs.reading.language import (
    COMPENSATION,
    G_WORDS,
    M_WORDS,
    MOTION,
    PLANE,
    LanguageWord,
)  # fmt: skip
from planner.programs.reading.positions import ProgramTrack
from planner.programs.reading.program import RAPID
from planner.programs.reading.words import LineArray

NOT_BESIDE = "is not possible while cutter compensation is on; write G40 before it"
_OFF = 400
TURN_ON = (41.0, 41.1, 42.0, 42.1)
_LEFT = (410, 411)
_BY_DIAMETER = (411, 421)


def check_beside(blocks: Blocks, modal: dict[int, LineArray], before: dict[int, int], kind: LineArray) -> None:
    """Refuse words that may not stand where compensation is on.

    ``before`` are the words in force before the first block.  M words and planes act before the compensation of their
    block does, other G words after it.
    """
    active = modal[COMPENSATION]
    if before[COMPENSATION] == _OFF and not blocks.g[COMPENSATION].given.any():
        return
    faults, on, was_on = blocks.faults, active != _OFF, np.append(before[COMPENSATION], active[:-1]) != _OFF
    again = "compensation is on already; write G40 before it"
    faults.add(blocks.g[COMPENSATION].at(was_on & on), again)
    plane = modal[PLANE]
    changed = np.diff(np.append(before[PLANE], plane)) != 0
    faults.add(blocks.g[PLANE].at(was_on & changed), NOT_BESIDE)
    faults.add(
        blocks.g[COMPENSATION].at(on & (plane != 170) & (plane != 180)),
        "the tool can be beside a path in G17 and G18, not in G19",
    )
    for column in blocks.g:
        faults.add(column.at(on & column.has(*_not_beside(G_WORDS))), NOT_BESIDE)
    for column in blocks.m:
        faults.add(column.at(was_on & column.has(*_not_beside(M_WORDS))), NOT_BESIDE)
    modal_only = on & (kind >= 0) & ~blocks.g[MOTION].given & np.isin(modal[MOTION], _not_beside(G_WORDS))
    faults.add(blocks.first_of("XYZ", modal_only), f"a cycle {NOT_BESIDE}")


def _not_beside(table: dict[int, LanguageWord]) -> list[int]:
    return [code for code, word in table.items() if not word.beside]


def _turn_on(track: ProgramTrack, row: int) -> None:
    """G41, G42, G41.1 and G42.1."""
    state, blocks = track.state, track.blocks
    code, d = int(blocks.g[COMPENSATION].value[row]), blocks.number(row, "D")
    word = blocks.g[COMPENSATION].word[row : row + 1]
    if state.beside is not None and state.stands_beside and not (track.kind[:row] >= RAPID).any() and not track.side:
        blocks.faults.add(word, "the tool stands beside the path before G40; write a move before it")
    lathe = int(track.modal[PLANE][row]) == 180
    if code in _BY_DIAMETER:
        orientation = blocks.number(row, "L")
        if orientation is not None and not lathe:
            blocks.faults.add(
                blocks.letters["L"].word[row : row + 1], "the orientation of a lathe tool needs the plane G18"
            )
        found = (0.5 * float(track.unit[row]) * (d or 0.0), int(orientation or 0))
    elif d is not None and (d < 0.0 or d != int(d)):
        return  # refused already
    else:
        number = int(d) if d else state.loaded
        known = state.offsets.radius_and_orientation(number)
        if known is None:
            blocks.faults.add(
                word,
                f"the diameter of tool {number} is not known; give a tool table with a line T{number} D6 (--tools), or "
                f"write G{code // 10}.1 D with the diameter",
            )
        found = known or (0.0, 0)
        if found[1] in LATHE_ORIENTATIONS and not lathe:
            blocks.faults.add(
                word, f"tool {number} is a lathe tool, with the orientation {found[1]}; it needs the plane G18"
            )
        if found[0] == 0.0:
            state.offsets.assume(f"the diameter of tool {number}", int(blocks.line[row]))
    state.tools.append(CompensatedTool(found[0] if code in _LEFT else -found[0], found[1]))
    state.tool_beside = len(state.tools)
    track.tools.append((row, state.tool_beside))


def _turn_off(track: ProgramTrack, row: int) -> None:
    """G40."""
    track.state.tool_beside = 0
    track.tools.append((row, 0))


COMPENSATIONS: dict[int, Callable[[ProgramTrack, int], None]] = {
    _OFF: _turn_off,
    **dict.fromkeys((410, 420, 411, 421), _turn_on),
}
