"""Rules on the words of a block: which belong to which, and what a block moves."""

from __future__ import annotations

import numpy as np

from planner.programs.reading.blocks import Blocks, WordColumn
from planner.programs.reading.language import (
    AXIS_LETTERS,
    CENTRES,
    COMPENSATION,
    CUBIC,
    CYCLES,
    G_WORDS,
    M_WORDS,
    MOTION,
    NURBS_BEGIN,
    NURBS_END,
    ONCE,
    OWNED_LETTERS,
    PLANE,
    PROBES,
    SIGNAL,
    SPINDLE,
    THREAD,
    TOOL_LENGTH,
    LanguageWord,
    word_name,
)  # fmt: skip
from planner.programs.reading.positions import CYCLE
from planner.programs.reading.program import ARC, LINE, RAPID
from planner.programs.reading.splines import spline_kinds
from planner.programs.reading.words import LineArray, Mask

_DWELL, _INPUT, _ORIENT = 40, 66, 19
_SHIFTS = (520, 920)
_NAMES_SHOWN = 8
# Words whose words of axes are no end of a move.
_TAKE_AXES = {
    group: tuple(code for code, word in G_WORDS.items() if word.group == group and "X" in word.takes)
    for group in (ONCE, TOOL_LENGTH)
}
_Codes = dict[str, dict[tuple[str, int], tuple[int, ...]]]


def _owners() -> _Codes:
    """By letter: the words that take it, by kind (G or M) and modal group."""
    out: _Codes = {}
    for letter in OWNED_LETTERS:
        found: dict[tuple[str, int], tuple[int, ...]] = {}
        for kind, table in (("G", G_WORDS), ("M", M_WORDS)):
            for code, word in table.items():
                if letter in word.takes:
                    found[kind, word.group] = (*found.get((kind, word.group), ()), code)
        out[letter] = found
    return out


_OWNERS = _owners()


def takes_axes(blocks: Blocks) -> Mask:
    """Blocks whose words of axes belong to another word than a motion."""
    out = np.zeros(blocks.line.size, dtype=np.bool_)
    for group, codes in _TAKE_AXES.items():
        if blocks.g[group].given.any():
            out |= blocks.g[group].has(*codes)
    return out


def check_words(blocks: Blocks, motion: LineArray, kind: LineArray) -> None:
    """Rules on single words, and on words that belong to others of their block."""
    faults, letters = blocks.faults, blocks.letters
    number = letters["N"]
    faults.add(number.word[number.given & (number.word != blocks.first)], "a line number must come first in its block")
    free = np.isin(motion, (CUBIC, NURBS_BEGIN))  # P is a handle, or has a rule of its own
    for name in "NFSTPHL":
        column = letters[name]
        if column.given.any():
            faults.add(column.at((column.value < 0.0) & ~(free & (name == "P"))), "must not be negative")
    q = letters["Q"]
    faults.add(q.at((q.value < 0.0) & ~blocks.m[SIGNAL].given & (motion != CUBIC)), "must not be negative")
    by_diameter = blocks.g[COMPENSATION].has(411, 421)
    d = letters["D"]
    faults.add(d.at((d.value < 0.0) & ~by_diameter), "must not be negative")
    faults.add(d.at((d.value != np.rint(d.value)) & ~by_diameter), "must be a whole number")
    for name in "THL":
        column = letters[name]
        if column.given.any():
            faults.add(column.at(column.value != np.rint(column.value)), "must be a whole number")
    r, p = letters["R"], letters["P"]
    faults.add(r.at((r.value == 0.0) & np.isin(motion, (20, 30))), "the radius must not be 0")
    faults.add(
        r.at(blocks.any_of("IJK") & np.isin(motion, (20, 30))), "an arc has a radius R or a centre I, J, K, not both"
    )
    inputs = blocks.m[SIGNAL].has(_INPUT)
    faults.add(blocks.m[SIGNAL].at(inputs & ~p.given & ~letters["E"].given), "needs the number of an input, P or E")
    for column, letter, table in (
        *((column, "G", G_WORDS) for column in blocks.g), *((column, "M", M_WORDS) for column in blocks.m)
    ):  # fmt: skip
        _check_needs(blocks, column, letter, table)
    for letter in OWNED_LETTERS:
        if letters[letter].given.any():
            _check_owner(blocks, letter, motion, kind)


def _check_needs(blocks: Blocks, column: WordColumn, letter: str, table: dict[int, LanguageWord]) -> None:
    """Words without a letter that they need."""
    if not column.given.any():
        return
    for code, word in table.items():
        for name in word.needs:
            lacking = column.has(code) & ~blocks.letters[name].given
            what = "the time P in seconds" if (letter, code) == ("G", _DWELL) else f"{name} beside it"
            blocks.faults.add(column.word[lacking], f"needs {what}")


def _check_owner(blocks: Blocks, letter: str, motion: LineArray, kind: LineArray) -> None:
    """A letter whose word is not there, or that could belong to several."""
    column, owners = blocks.letters[letter], _OWNERS[letter]
    count = np.zeros(motion.size, dtype=np.int64)
    for (table, group), codes in owners.items():
        if (table, group) == ("G", MOTION):
            count += np.isin(motion, codes) & (kind >= RAPID)
        else:
            count += (blocks.g if table == "G" else blocks.m)[group].has(*codes)
    if letter in "IJK":
        blocks.faults.add(column.at(count == 0), "belongs to G2 or G3, which is not active")
        return
    order = sorted(owners, key=("G", MOTION).__eq__)  # motions last, of which there are many
    names = [_name(key[0], code) for key in order for code in owners[key]]
    shown = ", ".join(names[:_NAMES_SHOWN]) + (" ..." if len(names) > _NAMES_SHOWN else "")
    exponent = "a number has no exponent; E " if letter == "E" else ""
    blocks.faults.add(
        column.at(count == 0), f"{exponent}belongs to a word that is not in the block; it is read beside {shown}"
    )
    blocks.faults.add(column.at(count > 1), "could belong to several words of the block; write them in two blocks")


def _name(letter: str, code: int) -> str:
    return word_name(letter, code / 10.0 if letter == "G" else code)


def check_motion(blocks: Blocks, modal: dict[int, LineArray]) -> LineArray:
    """What every block moves: RAPID, LINE, ARC, CYCLE, or -1 for nothing."""
    faults, active, word = blocks.faults, modal[MOTION], blocks.g[MOTION]
    # The R of M19 is an angle.
    centred = blocks.any_of("IJK") | (blocks.letters["R"].given & ~blocks.m[SPINDLE].has(_ORIENT))
    other, named = takes_axes(blocks), blocks.any_of(AXIS_LETTERS)
    ends, centres = named & ~other, centred & ~other
    arc = (active == 20) | (active == 30)
    faults.add(
        blocks.first_of(AXIS_LETTERS, named & other & word.given),
        "belongs to the other word of the block; write the motion in a block of its own",
    )
    faults.add(blocks.first_of(AXIS_LETTERS, ends & (active == 800)), "no G0, G1, G2, G3 or cycle is active")
    faults.add(word.at(arc & ~ends & ~centres & ~other), "an arc needs an end point or a centre")
    faults.add(blocks.first_of(AXIS_LETTERS, arc & ends & ~centres), "an arc needs a centre I, J, K or a radius R")
    plane = modal[PLANE]
    beside = plane % 10 != 0  # of U, V and W
    faults.add(word.at(arc & beside & (ends | centres)), "an arc needs the plane G17, G18 or G19")
    for name, code in (("I", 190), ("J", 180), ("K", 170)):
        column = blocks.letters[name]
        faults.add(column.at(arc & (plane == code)), f"is along the normal of the plane, G{code // 10}")
    absolute = arc & (modal[CENTRES] == 901) & centres & ~blocks.letters["R"].given
    for name, code in (("I", 190), ("J", 180), ("K", 170)):
        lacking = absolute & (plane != code) & ~blocks.letters[name].given
        faults.add(blocks.first_of("IJK", lacking & blocks.any_of("IJK")), f"under G90.1 the arc needs {name} as well")
    once = blocks.g[ONCE]
    faults.add(once.at(once.has(*_SHIFTS) & ~named), "needs the axes that it shifts")
    faults.add(word.at(word.has(*PROBES) & ~ends), "a probe needs the end of its move")
    kind = np.full(active.size, -1)
    kind[ends & (active == 0)] = RAPID
    kind[ends & (active == 10)] = LINE
    kind[arc & (ends | centres)] = ARC
    if ((active > 30) & (active != 800)).any():
        kind[(np.isin(active, PROBES) | (active == THREAD)) & ends] = LINE
        thread = (active == THREAD) & ~ends & ~other
        faults.add(word.at(thread), "a thread needs an end point")
        spline_kinds(blocks, active, kind, ends)
        over = ends & (active == NURBS_END) & ~word.given
        faults.add(blocks.first_of(AXIS_LETTERS, over), "no G0, G1, G2, G3 or cycle is active")
        cycle = np.isin(active, CYCLES)
        faults.add(
            blocks.first_of("XYZ", cycle & blocks.any_of("XYZ") & beside), "a cycle needs the plane G17, G18 or G19"
        )
        kind[cycle & ends & blocks.any_of("XYZ")] = CYCLE
        other_axes = AXIS_LETTERS[3:]
        faults.add(
            blocks.first_of(other_axes, cycle & ends & blocks.any_of(other_axes)),
            "a cycle moves X, Y and Z alone; write the move of the other axis in a block of its own",
        )
        faults.add(word.at(cycle & ~ends & ~other), "a cycle needs X, Y or Z")
    return kind
