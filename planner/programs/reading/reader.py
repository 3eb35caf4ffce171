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
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.curve import MAX_COORDINATE
from planner.inputs import numbers
from planner.programs.reading.arcs import resolve_arcs
from planner.programs.reading.blocks import (
    CENTRES,
    CHANGE,
    COOLANT,
    DISTANCE,
    DWELL,
    FEED_MODE,
    MOTION,
    PATH_MODE,
    PLANE,
    SPINDLE,
    STOP,
    UNITS,
    Blocks,
    WordColumn,
    sort_words,
)  # fmt: skip
from planner.programs.reading.program import ARC, AXES, LINE, RAPID, ZERO_LENGTH_MM, Event, Program, arc_lengths
from planner.programs.reading.words import Faults, IntArray, Mask, Words, read_words
from planner.types import FloatArray

_INCH = 25.4
_MAX_MOVES = 5_000_000  # some 120 bytes each
_MAX_EVENTS = 1_000_000
_STOP_KINDS = {0: "stop", 1: "optional_stop", 2: "end", 30: "end"}
_NO_STOP_KINDS = ("spindle", "coolant", "tool")


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
    try:
        file = Path(path)
    except TypeError:
        raise InputError(f"{path!r} must be the path of a file") from None
    state = _Reading(file.name)
    if start is not None:
        state.place(start)
    for words, problem in read_words(file):
        _read_part(words, state)
        if problem is not None:
            raise problem
    state.require_end()
    return state.program()


@dataclass
class _Reading:
    """What one part of the file hands to the next, and the moves so far."""

    source: str
    modal: dict[int, int] = field(
        default_factory=lambda: {
            MOTION: 800, PLANE: 170, UNITS: 210, DISTANCE: 900, CENTRES: 911, FEED_MODE: 940, PATH_MODE: 640
        }
    )  # fmt: skip
    feed: float = np.nan  # mm/s under G94
    feed_mode: int = 940
    tolerance: float = np.nan
    naive: float = np.nan
    spindle: float = np.nan
    tool: str = ""
    programmed: FloatArray = field(default_factory=lambda: np.zeros(3))
    position: FloatArray = field(default_factory=lambda: np.zeros(3))  # where the last kept move ends
    first: FloatArray = field(default_factory=lambda: np.zeros(3))
    known: list[bool] = field(default_factory=lambda: [False] * 3)
    axis_lines: IntArray = field(default_factory=lambda: np.zeros(3, dtype=np.int64))
    shifts: list[tuple[int, int, float]] = field(default_factory=list)
    percents: int = 0
    blocks: int = 0
    ended: bool = False
    line_count: int = 0
    moves: int = 0
    parts: list[_Moves] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    zero_lines: list[IntArray] = field(default_factory=list)

    def place(self, start: Sequence[float]) -> None:
        """Set the first position."""
        point = numbers(np.asarray(start), "start", InputError)
        if point.shape != (3,) or not (np.abs(point) <= MAX_COORDINATE).all():
            raise InputError(f"start = {start!r} must be three coordinates in mm, of at most 1e9")
        self.programmed, self.position, self.first = point.copy(), point.copy(), point.copy()
        self.known = [True] * 3

    def stand(self, axis: int, at: float) -> None:
        """Let an axis without a word so far have stood somewhere from the start, mm."""
        self.shifts.append((axis, self.moves, at))
        self.programmed[axis] = self.position[axis] = at

    def require_end(self) -> None:
        """Refuse a file without an end."""
        if not self.ended:
            line = max(self.line_count, 1)
            if self.blocks == 0:
                raise InputError(
                    f"{self.source}:{line}: end of file: there is no block in it; a program needs a move and M2"
                )
            what, end = (
                ("the closing % is missing", "%") if self.percents else ("there is no M2, M30 or closing %", "M2")
            )
            raise InputError(
                f"{self.source}:{line}: end of file: {what}; the file may have been cut off, else end it with {end}"
            )

    def program(self) -> Program:
        """Put the parts together."""
        parts = self.parts or [_Moves.none()]
        line, kind, end, centre, normal, sweep, feed, exact, tolerance, naive = (
            np.concatenate([getattr(part, name) for part in parts]) for name in _Moves.__dataclass_fields__
        )
        for axis, count, shift in self.shifts:  # an axis stood there before its first word
            end[:count, axis] += shift
            centre[:count, axis] += shift
            self.first[axis] += shift
        start = np.concatenate([self.first[None], end[:-1]]) if line.size else end.copy()
        rapid = kind == RAPID
        stop = exact | rapid
        stop[:-1] |= rapid[1:]
        stop[-1:] = True
        at = np.array([e.after_move for e in self.events if e.kind not in _NO_STOP_KINDS], dtype=np.int64)
        stop[at[at >= 0]] = True
        zero = np.concatenate([*self.zero_lines, np.empty(0, dtype=np.int64)])
        return Program(
            self.source, line, kind, start, end, centre, normal, sweep, feed, stop, tolerance, naive,
            tuple(self.events), zero, self.line_count, self.axis_lines,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Moves:
    """The kept moves of a part; columns as in Program, and whether G61 or G61.1 was active."""

    line: IntArray
    kind: NDArray[np.uint8]
    end: FloatArray
    centre: FloatArray
    normal: NDArray[np.uint8]
    sweep: FloatArray
    feed: FloatArray
    exact: Mask
    tolerance: FloatArray
    naive: FloatArray

    @classmethod
    def none(cls) -> _Moves:
        byte, number, point = np.empty(0, dtype=np.uint8), np.empty(0), np.empty((0, 3))
        flag = np.empty(0, dtype=np.bool_)
        return cls(np.empty(0, dtype=np.int64), byte, point, point, byte, number, number, flag, number, number)


def _read_part(words: Words, state: _Reading) -> None:
    """Read the words of some megabytes of text; the state goes on from there."""
    faults = Faults(words)
    if words.line.size:
        blocks = sort_words(words, faults)
        _check_words(blocks)
        _check_end(blocks, state)
        state.modal, modal = _carry_modal(blocks, state.modal)
        unit = np.where(modal[UNITS] == 200, _INCH, 1.0)
        kind = _check_motion(blocks, modal)
        feed, rate = _feeds(blocks, modal, unit, kind, state)
        tolerance, naive = _tolerances(blocks, unit, state)
        programmed = _positions(blocks, modal, unit, kind, state)
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


def _carried(given: Mask, value: NDArray[np.generic], before: float) -> NDArray[np.generic]:
    """Carry values forward from where they are given; before the first, the value of the part before."""
    last = np.maximum.accumulate(np.where(given, np.arange(given.size), -1))
    return np.where(last >= 0, value[last], before)


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


def _check_end(blocks: Blocks, state: _Reading) -> None:
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


def _carry_modal(blocks: Blocks, before: dict[int, int]) -> tuple[dict[int, int], dict[int, IntArray]]:
    """The word of each modal group that is active at every block, and after the last."""
    modal = {
        group: np.asarray(_carried(blocks.g[group].given, blocks.g[group].value, code), dtype=np.int64)
        for group, code in before.items()
    }
    return {group: int(column[-1]) for group, column in modal.items()}, modal


def _check_motion(blocks: Blocks, modal: dict[int, IntArray]) -> IntArray:
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


def _feeds(
    blocks: Blocks, modal: dict[int, IntArray], unit: FloatArray, kind: IntArray, state: _Reading
) -> tuple[FloatArray, FloatArray]:
    """Feed at every block in mm/s (G94), and moves a second (G93; nan elsewhere)."""
    faults, f, mode = blocks.faults, blocks.letters["F"], modal[FEED_MODE]
    per_minute, cuts = mode == 940, kind >= LINE
    given = f.given & per_minute
    changed = np.append(mode[0] != state.feed_mode, mode[1:] != mode[:-1])
    feed = np.asarray(_carried(given | changed, np.where(given, f.value * unit / 60.0, np.nan), state.feed))
    state.feed, state.feed_mode = float(feed[-1]), int(mode[-1])
    word = np.where(blocks.g[MOTION].given, blocks.g[MOTION].word, blocks.first)
    unnamed = cuts & ~blocks.g[MOTION].given
    word[unnamed] = blocks.first_of("XYZIJKR", unnamed)
    faults.add(word[cuts & per_minute & np.isnan(feed)], "no feed is given; F is missing")
    faults.add(word[cuts & per_minute & (feed == 0.0)], "the feed is 0; F must be > 0")
    faults.add(word[cuts & ~per_minute & ~f.given], "G93 needs an F in every block that cuts")
    faults.add(f.at(cuts & ~per_minute & (f.value == 0.0)), "must be > 0")
    faults.add(f.at(~cuts & ~per_minute), "under G93 an F belongs to a block with G1, G2 or G3")
    return feed, np.where(cuts & ~per_minute & f.given, f.value / 60.0, np.nan)


def _tolerances(blocks: Blocks, unit: FloatArray, state: _Reading) -> tuple[FloatArray, FloatArray]:
    """P and Q of G64 at every block, mm; 0 and nan under G61 and G61.1."""
    path, p, q = blocks.g[PATH_MODE], blocks.letters["P"], blocks.letters["Q"]
    blend = path.value == 640
    given = np.where(blend, np.where(p.given, p.value * unit, np.nan), 0.0)
    tolerance = np.asarray(_carried(path.given, given, state.tolerance))
    naive = np.asarray(_carried(path.given, np.where(blend & q.given, q.value * unit, np.nan), state.naive))
    state.tolerance, state.naive = float(tolerance[-1]), float(naive[-1])
    return tolerance, naive


def _positions(
    blocks: Blocks, modal: dict[int, IntArray], unit: FloatArray, kind: IntArray, state: _Reading
) -> FloatArray:
    """Programmed point before the first and after every block, (n + 1, 3), mm."""
    absolute = modal[DISTANCE] == 900
    rows = np.arange(absolute.size)
    out = np.empty((absolute.size + 1, 3))
    for axis, name in enumerate(AXES):
        column = blocks.letters[name]
        target = column.value * unit
        if column.given.any() and state.axis_lines[axis] == 0:
            row = int(np.argmax(column.given))
            state.axis_lines[axis] = blocks.line[row]
            if not state.known[axis] and absolute[row] and kind[row] == RAPID:
                state.stand(axis, float(target[row]))
        steps = np.cumsum(np.where(column.given & ~absolute, target, 0.0))
        last = np.maximum.accumulate(np.where(column.given & absolute, rows, -1))
        since = np.where(last >= 0, steps - steps[last], steps)
        out[1:, axis] = np.where(last >= 0, target[last], state.programmed[axis]) + since
        out[0, axis] = state.programmed[axis]
    far = np.flatnonzero((np.abs(out[1:]) > MAX_COORDINATE * _INCH).any(axis=1))
    blocks.faults.add(blocks.first[far], "leads farther than 2.5e10 mm from 0")
    state.programmed = out[-1].copy()
    return out


def _moves(
    blocks: Blocks,
    modal: dict[int, IntArray],
    unit: FloatArray,
    kind: IntArray,
    programmed: FloatArray,
    columns: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    state: _Reading,
) -> tuple[Mask, _Moves]:
    """The moves that are long enough to be one, and at which blocks they are; the other lines go to the state."""
    from planner.programs.reading.reader_kernels import merge_short_moves

    rows = np.flatnonzero(kind >= RAPID)
    ends = programmed[1:][rows]
    before = state.position.copy()
    keep = np.empty(rows.size, dtype=np.uint8)
    merge_short_moves(ends, (kind[rows] == ARC).astype(np.uint8), ZERO_LENGTH_MM, state.position, keep)
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
    moves = _Moves(
        blocks.line[rows], kind[rows].astype(np.uint8), end, centre, normal, sweep, feed, exact, tolerance, naive
    )
    return kept, moves


def _arcs(
    blocks: Blocks,
    modal: dict[int, IntArray],
    unit: FloatArray,
    rows: IntArray,
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


def _add_events(blocks: Blocks, kept: Mask, state: _Reading) -> None:
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
