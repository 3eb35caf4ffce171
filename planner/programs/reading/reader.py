"""Strict reader of part programs (RS274, the dialect of LinuxCNC): every block is understood, or refused by name.

A block is a line with words.  Modal words are columns: each group has a value at the blocks that name it, and carries it
forward to those that do not.  So the rules below act on all blocks of some megabytes of text at once; what is wrong is
collected and the first in the order of the file is raised.

Read: G0 G1 G2 G3 G4, G17 G18 G19, G20 G21, G40, G49, G54, G61 G61.1 G64 (P, Q), G80, G90 G91, G90.1 G91.1, G93 G94,
F S T N, M0 to M9, M30, ( ) and ; comments, %.  Everything else is an error, among it what would have to be guessed.

Rules, where dialects differ:

1. The file starts in G17 G21 G40 G49 G54 G80 G90 G91.1 G94 and G64 without a tolerance.
2. The machine's first position is unknown.  An axis whose first word is an absolute one of a rapid stands there from the
   start, so that the rapid to the start of the work takes no time; every other axis stands at 0.
3. F, X, Y, Z, I, J, K, R, and P and Q of G64 count in the units and the distance mode of their own block (LinuxCNC takes an
   F beside G20 or G21 in the units before: write it in a later block).
4. Changing between G93 and G94 forgets the feed.
5. The program ends with M2, M30 or the second %, and nothing may follow: a file without one may have been cut off.
6. In a block tool change, spindle and dwell come before the motion, M0, M1, M2 and M30 after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import InputError
from planner.inputs import require_path
from planner.programs.reading.arcs import resolve_arcs
from planner.programs.reading.blocks import (
    CENTRES,
    CHANGE,
    COOLANT,
    DWELL,
    MOTION,
    PATH_MODE,
    PLANE,
    SPINDLE,
    STOP,
    Blocks,
    WordColumn,
    sort_words,
)  # fmt: skip
from planner.programs.reading.modal import (
    MoveColumns,
    ReadingState,
    carry_feeds,
    carry_modal,
    carry_positions,
    carry_tolerances,
    units,
)
from planner.programs.reading.program import ARC, LINE, RAPID, ZERO_LENGTH_MM, Event, Program, arc_lengths
from planner.programs.reading.words import Faults, LineArray, Mask, Words, read_words
from planner.types import FloatArray

_MAX_MOVES = 5_000_000  # some 120 bytes each
_MAX_EVENTS = 1_000_000
_STOP_KINDS = {0: "stop", 1: "optional_stop", 2: "end", 30: "end"}


def read_program(path: str | Path, *, start: Sequence[float] | None = None) -> Program:
    """Read a part program.

    Parameters
    ----------
    path : str or Path
        A text file in the subset above.
    start : (3,) sequence of float, optional
        Where the machine stands before the first block, mm; left out, it is taken from the program (rule 2 above).

    Returns
    -------
    Program
        Moves in mm and mm/s, with their lines; m = 0 where the program moves no axis.

    Raises
    ------
    InputError
        ``file:line: word: reason`` for the first thing that is wrong, in the order of the file.
    """
    file = require_path(path)
    state = ReadingState(file.name)
    if start is not None:
        state.place(start)
    for words, problem in read_words(file):
        _read_part(words, state)
        if problem is not None:
            raise problem
    state.require_end()
    return state.program()


def _read_part(words: Words, state: ReadingState) -> None:
    """Read the words of some megabytes of text; the state goes on from there."""
    faults = Faults(words)
    if words.line.size:
        blocks = sort_words(words, faults)
        _check_words(blocks)
        _check_end(blocks, state)
        state.modal, modal = carry_modal(blocks, state.modal)
        unit = units(modal)
        kind = _check_motion(blocks, modal)
        feed, rate = carry_feeds(blocks, modal, unit, kind, state)
        tolerance, naive = carry_tolerances(blocks, unit, state)
        programmed = carry_positions(blocks, modal, unit, kind, state)
        kept, moves = _moves(blocks, modal, unit, kind, programmed, (feed, rate, tolerance, naive), state)
        faults.raise_first()
        _add_events(blocks, kept, state)
        state.parts.append(moves)
        state.moves += moves.line.size
        state.blocks += blocks.line.size
    state.line_count += words.lines
    if state.moves > _MAX_MOVES or len(state.events) > _MAX_EVENTS:
        raise InputError(
            f"{state.source}:{state.line_count}: end of part: more than {_MAX_MOVES} moves, or {_MAX_EVENTS} stops and "
            "switches; split the program"
        )


def _check_words(blocks: Blocks) -> None:
    """Rules on single words, and on words that belong to others of their block."""
    faults, letters = blocks.faults, blocks.letters
    number = letters["N"]
    faults.add(number.word[number.given & (number.word != blocks.first)], "a line number must come first in its block")
    for name in "NFSTPQ":
        column = letters[name]
        faults.add(column.at(column.value < 0.0), "must not be negative")
    for name in "NT":
        column = letters[name]
        faults.add(column.at(column.value != np.rint(column.value)), "must be a whole number")
    dwell, path = blocks.g[DWELL], blocks.g[PATH_MODE]
    blend = path.given & (path.value == 640)
    p, q, r = (letters[name] for name in "PQR")
    turns = np.isin(blocks.g[MOTION].value, (20, 30)) & blocks.g[MOTION].given & ~dwell.given & ~blend
    faults.add(p.at(turns), "several turns of an arc are not read; write a G2 or G3 for each")
    faults.add(p.at(~dwell.given & ~blend & ~turns), "belongs to G4 or G64, which is not in the block")
    faults.add(p.at(dwell.given & blend), "belongs to G4 or to G64; write them in two blocks")
    faults.add(p.at(blend & ~dwell.given & (p.value == 0.0)), "the tolerance must be > 0; G61 holds the path exactly")
    faults.add(q.at(~blend), "belongs to G64, which is not in the block")
    faults.add(q.at(blend & ~p.given), "needs the tolerance P beside it")
    faults.add(dwell.at(~p.given), "needs the time P in seconds")
    faults.add(r.at(r.value == 0.0), "the radius must not be 0")
    faults.add(r.at(blocks.any_of("IJK")), "an arc has a radius R or a centre I, J, K, not both")
    moving = blocks.any_of("XYZIJKR")
    faults.add(
        blocks.first_of("XYZIJKR", dwell.given & moving), "motion beside G4; write the dwell in a block of its own"
    )


def _check_end(blocks: Blocks, state: ReadingState) -> None:
    """The %, and the end of the program: once, and nothing after it."""
    faults, mark, stop = blocks.faults, blocks.letters["%"], blocks.m[STOP]
    rows = np.arange(blocks.line.size)
    several = np.diff(np.append(blocks.first, blocks.of_word.size)) > 1
    count = state.percents + np.cumsum(mark.given)
    ends = stop.given & (stop.value >= 20) | mark.given & (count == 2)
    after = np.append(state.ended, np.logical_or.accumulate(ends)[:-1] | state.ended)
    faults.add(mark.at(several), "must stand alone in its line")
    faults.add(mark.at((count == 1) & (state.blocks + rows > 0) & ~after), "closes a file that no % opens")
    faults.add(mark.at(count > 2), "a third %; one opens the file, and one closes it")
    faults.add(blocks.first[after & ~mark.given], "follows the end of the program (M2, M30 or the closing %)")
    state.percents, state.ended = int(count[-1]), bool(after[-1] | ends[-1])


def _check_motion(blocks: Blocks, modal: dict[int, LineArray]) -> LineArray:
    """What every block moves: RAPID, LINE, ARC, or -1 for nothing."""
    faults, active, word = blocks.faults, modal[MOTION], blocks.g[MOTION]
    ends, centres = blocks.any_of("XYZ"), blocks.any_of("IJKR")
    arc = (active == 20) | (active == 30)
    faults.add(blocks.first_of("XYZ", ends & (active == 800)), "no G0, G1, G2 or G3 is active")
    faults.add(blocks.first_of("IJKR", centres & ~arc), "belongs to G2 or G3, which is not active")
    faults.add(word.at(arc & ~ends & ~centres), "an arc needs an end point or a centre")
    faults.add(blocks.first_of("XYZ", arc & ends & ~centres), "an arc needs a centre I, J, K or a radius R")
    plane = modal[PLANE]
    for name, code in (("I", 190), ("J", 180), ("K", 170)):
        faults.add(blocks.letters[name].at(plane == code), f"is along the normal of the plane, G{code // 10}")
    absolute = arc & (modal[CENTRES] == 901) & centres & ~blocks.letters["R"].given
    for name, code in (("I", 190), ("J", 180), ("K", 170)):
        lacking = absolute & (plane != code) & ~blocks.letters[name].given
        faults.add(blocks.first_of("IJK", lacking & blocks.any_of("IJK")), f"under G90.1 the arc needs {name} as well")
    kind = np.full(active.size, -1)
    kind[ends & (active == 0)] = RAPID
    kind[ends & (active == 10)] = LINE
    kind[arc & (ends | centres)] = ARC
    return kind


def _moves(
    blocks: Blocks,
    modal: dict[int, LineArray],
    unit: FloatArray,
    kind: LineArray,
    programmed: FloatArray,
    columns: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    state: ReadingState,
) -> tuple[Mask, MoveColumns]:
    """The moves that are long enough to be one, and at which blocks they are; the other lines go to the state."""
    rows = np.flatnonzero(kind >= RAPID)
    ends = programmed[1:][rows]
    before = state.position.copy()
    keep = np.empty(rows.size, dtype=np.uint8)
    core.reader_merge_short_moves(rows.size, ends, kind[rows] == ARC, ZERO_LENGTH_MM, state.position, keep)
    state.zero_lines.append(blocks.line[rows[keep == 0]])
    rows, end = rows[keep == 1], ends[keep == 1]
    kept = np.zeros(kind.size, dtype=bool)
    kept[rows] = True
    start = np.concatenate([before[None], end])[:-1]
    normal = np.array([2, 1, 0], dtype=np.uint8)[modal[PLANE][rows] // 10 - 17]
    centre, sweep = np.full(end.shape, np.nan), np.zeros(rows.size)
    travel = np.sqrt(np.sum((end - start) ** 2, axis=1))
    arcs = np.flatnonzero(kind[rows] == ARC)
    if arcs.size:
        at = rows[arcs]
        centre[arcs], sweep[arcs] = _arcs(
            blocks, modal, unit, at, programmed[at], (start[arcs], end[arcs], normal[arcs])
        )
        travel[arcs] = arc_lengths(start[arcs], end[arcs], centre[arcs], normal[arcs], sweep[arcs])
    feed, rate, tolerance, naive = (column[rows] for column in columns)
    feed = np.where(kind[rows] == RAPID, np.inf, np.where(np.isnan(rate), feed, travel * rate))
    exact = modal[PATH_MODE][rows] != 640
    moves = MoveColumns(
        blocks.line[rows], kind[rows].astype(np.uint8), end, centre, normal, sweep, feed, exact, tolerance, naive
    )
    return kept, moves


def _arcs(
    blocks: Blocks,
    modal: dict[int, LineArray],
    unit: FloatArray,
    rows: LineArray,
    programmed: FloatArray,
    move: tuple[FloatArray, FloatArray, NDArray[np.uint8]],
) -> tuple[FloatArray, FloatArray]:
    """Centre and sweep of the arcs at these blocks; refuse the impossible."""
    start, end, normal = move
    offsets = np.stack([blocks.letters[name].value[rows] * unit[rows] for name in "IJK"], axis=1)
    centre = np.where((modal[CENTRES][rows] == 901)[:, None], offsets, programmed + offsets)
    r = blocks.letters["R"]
    radius = np.where(r.given[rows], r.value[rows] * unit[rows], np.nan)
    arcs = resolve_arcs(start, end, normal, modal[MOTION][rows] == 30, centre, radius, ZERO_LENGTH_MM)
    place = np.minimum(blocks.first_of("IJKR", np.ones(blocks.line.size, dtype=bool)), blocks.of_word.size - 1)[rows]
    bad = np.flatnonzero(~np.isnan(arcs.mismatch))
    blocks.faults.add(
        place[bad],
        lambda i: (
            f"start and end lie {arcs.radii[bad[i], 0]:.6g} and {arcs.radii[bad[i], 1]:.6g} mm from the centre; "
            "they may differ by 0.005 mm or 0.05 %"
        ),
    )
    wide = np.flatnonzero(~np.isnan(arcs.gap))
    blocks.faults.add(
        place[wide],
        lambda i: f"start and end are {2.0 * arcs.gap[wide[i]]:.6g} mm farther apart than twice the radius",
    )
    lost = np.flatnonzero(~np.isnan(arcs.chord))
    blocks.faults.add(
        place[lost],
        lambda i: (
            f"start and end lie {arcs.chord[lost[i]]:.3g} mm apart on a radius of {arcs.radii[lost[i], 0]:.6g} mm, by rule "
            f"a full turn of {2e-3 * np.pi * arcs.radii[lost[i], 0]:.6g} m; write G1 for the short move, or end the circle "
            "where it starts"
        ),
    )
    full = ~np.isnan(radius) & (np.abs(arcs.sweep) == 2.0 * np.pi)
    blocks.faults.add(place[full], "a full circle has no radius form; give its centre with I, J, K")
    blocks.faults.add(place[arcs.small], "the centre lies on the start or the end of the arc")
    return arcs.centre, arcs.sweep


def _add_events(blocks: Blocks, kept: Mask, state: ReadingState) -> None:
    """Note dwells, stops, tool changes and switches, in the order in which a controller acts on them."""
    letters, dwell = blocks.letters, blocks.g[DWELL]
    speed, tool = letters["S"], letters["T"]
    named = [column.given for column in (speed, tool, dwell, *blocks.m)]
    moves = state.moves + np.cumsum(kept)
    for row in np.flatnonzero(np.logical_or.reduce(named)):
        line, after = int(blocks.line[row]), int(moves[row]) - 1
        before = after - int(kept[row])

        def text(*columns: WordColumn, row: int = int(row)) -> str:
            return " ".join(blocks.words.word(int(c.word[row])) for c in columns if c.given[row])

        change, spindle, coolant, stop = (blocks.m[k] for k in (CHANGE, SPINDLE, COOLANT, STOP))
        if tool.given[row]:
            state.tool = text(tool)
            if not change.given[row]:
                state.events.append(Event(line, "tool", 0.0, before, state.tool))
        if change.given[row]:
            state.events.append(Event(line, "tool_change", 0.0, before, f"{text(change)} {state.tool}".strip()))
        if spindle.given[row] or (speed.given[row] and speed.value[row] != state.spindle):
            state.events.append(Event(line, "spindle", 0.0, before, text(spindle, speed)))
        if speed.given[row]:
            state.spindle = float(speed.value[row])
        if coolant.given[row]:
            state.events.append(Event(line, "coolant", 0.0, before, text(coolant)))
        if dwell.given[row]:
            seconds = float(letters["P"].value[row])
            state.events.append(Event(line, "dwell", seconds, before, text(dwell, letters["P"])))
        if stop.given[row]:
            state.events.append(Event(line, _STOP_KINDS[int(stop.value[row]) // 10], 0.0, after, text(stop)))
