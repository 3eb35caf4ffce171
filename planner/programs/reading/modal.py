"""What a program carries forward from block to block, and a part of the file to the next.

The word of each modal group, the feed, the tolerances and the programmed position are columns with a value at every
block: that of the last block that names it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import InputError
from planner.geometry.bezier import Beziers
from planner.geometry.curve import AXES, MAX_COORDINATE
from planner.inputs import numbers
from planner.programs.reading.blocks import Blocks
from planner.programs.reading.compensation import CompensatedTool, ProgrammedPath, compensate
from planner.programs.reading.language import (
    AXIS_LETTERS,
    CENTRES,
    COMPENSATION,
    DIAMETER,
    DISTANCE,
    FEED_MODE,
    MOTION,
    PATH_MODE,
    PLANE,
    RETRACT,
    SPEED_MODE,
    TAP,
    THREAD,
    THREADING,
    UNITS,
)  # fmt: skip
from planner.programs.reading.offsets import Offsets, origin
from planner.programs.reading.program import ARC, LINE, RAPID, SPLINE, ZERO_LENGTH_MM, Event, Program
from planner.programs.reading.unread import UnreadWords
from planner.programs.reading.words import LineArray, Mask
from planner.types import FloatArray

INCH_MM = 25.4
_NO_BLOCKS = {"/": "/ (block delete is on)", "$": "$ (a setting of GRBL)", "?": "? (a question to GRBL)"}
_NO_STOP_KINDS = ("spindle", "coolant", "tool", "signal", "offset")


@dataclass
class CycleSeries:
    """Canned cycles without another motion between them: the last one, the level of the axis before the first, mm on the
    machine, and the words kept: R, Q and depth in mm, P in s.
    """

    code: int
    level: float
    numbers: dict[str, float] = field(default_factory=dict)


@dataclass
class OpenNurbs:
    """A NURBS whose blocks are being read: control points on the machine, mm, weights, knots, and the line of each point."""

    code: int
    line: int
    order: int
    start: FloatArray
    points: list[FloatArray] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)
    knots: list[float] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


@dataclass
class ReadingState:
    """What one part of the file hands to the next, and the moves so far."""

    source: str
    unread: UnreadWords
    offsets: Offsets = field(default_factory=Offsets)
    modal: dict[int, int] = field(
        default_factory=lambda: {
            MOTION: 800, PLANE: 170, UNITS: 210, DISTANCE: 900, CENTRES: 911, FEED_MODE: 940, PATH_MODE: 640,
            COMPENSATION: 400, RETRACT: 990, SPEED_MODE: 970, DIAMETER: 80,
        }
    )  # fmt: skip
    feed: float = np.nan  # mm/s under G94, mm a turn under G95
    angular_feed: float = np.nan  # the same F in degrees
    speed_bound: float = np.inf  # D of G96, turns a minute
    turning: bool = False  # the spindle, by M3 or M4
    feed_mode: int = 940
    unit: float = 1.0  # of the last block, mm
    early_feeds: tuple[int, int] | None = None  # F beside G20 or G21 that change the units: the first line, how many
    tolerance: float = np.nan
    naive: float = np.nan
    spindle: float = np.nan
    spindle_code: int = 5
    coolant_code: int = 9
    tool: str = ""
    selected: int = 0  # by T
    loaded: int = 0  # by M6
    series: CycleSeries | None = None
    nurbs: OpenNurbs | None = None
    handle: FloatArray = field(default_factory=lambda: np.full(3, np.nan))  # with which a G5 may go on, mm
    beziers: list[Beziers] = field(default_factory=list)  # of the splines so far
    tools: list[CompensatedTool] = field(default_factory=list)  # of each G41 and G42
    tool_beside: int = 0  # the number of the last of them, 0 after G40
    beside: FloatArray | None = (
        None  # from the programmed end to the tool, (3,), mm, where the last move is compensated
    )
    stands_beside: bool = False  # and a tool change has made that the programmed point
    programmed: FloatArray = field(default_factory=origin)
    position: FloatArray = field(default_factory=origin)  # where the last kept move ends
    first: FloatArray = field(default_factory=origin)
    carried: int = 3  # axes whose points are columns: X Y Z, and all as soon as another is named
    known: list[bool] = field(default_factory=lambda: [False] * len(AXES))
    axis_lines: LineArray = field(default_factory=lambda: np.zeros(len(AXES), dtype=np.int64))
    shifts: list[tuple[int, int, float]] = field(default_factory=list)
    percents: int = 0
    blocks: int = 0
    ended: bool = False
    line_count: int = 0
    moves: int = 0
    parts: list[MoveColumns] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    zero_lines: list[LineArray] = field(default_factory=list)
    probes: tuple[int, int] | None = None  # moves of G38: the first line, how many
    probed: FloatArray | None = None  # the end of the last of them, in the program's coordinates, mm
    long_arcs: list[tuple[int, float, float]] = field(default_factory=list)  # full turns: line, length, turns
    skipped: dict[str, tuple[int, int]] = field(default_factory=dict)  # by their first character: first line, how many

    def place(self, start: Sequence[float]) -> None:
        """Set the first position."""
        point = numbers(np.asarray(start), "start", InputError)
        if point.shape not in ((3,), (len(AXES),)) or not (np.abs(point) <= MAX_COORDINATE).all():
            raise InputError(
                f"start = {start!r} must be three coordinates in mm, or nine of {' '.join(AXES)}, of at most 1e9"
            )
        for given in (self.programmed, self.position, self.first):
            given[: point.size] = point
        self.known = [True] * len(AXES)

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
        parts = self.parts or [MoveColumns.none()]
        points = self._points(parts)
        beziers = self.beziers[0] if self.beziers else None
        for more in self.beziers[1:]:
            beziers = more if beziers is None else beziers.joined(more)
        for axis, count, shift in self.shifts:  # an axis stood there before its first word
            points[: count + 1, axis] += shift
        moves = MoveColumns.joined(parts, points[1:])
        for axis, count, shift in self.shifts:
            if axis < moves.centre.shape[1]:
                moves.centre[:count, axis] += shift
                if beziers is not None:
                    beziers.start[moves.curve[:count][moves.curve[:count] >= 0], axis] += shift
        if self.tools:
            moves = self._beside_tools(moves, points[:-1])
            points = np.concatenate([points[:1], moves.end])
        rapid = moves.kind == RAPID
        stop = moves.exact | rapid
        stop[:-1] |= rapid[1:]
        stop[-1:] = True
        at = np.array([e.after_move for e in self.events if e.kind not in _NO_STOP_KINDS], dtype=np.int64)
        stop[at[at >= 0]] = True
        zero = np.concatenate([*self.zero_lines, np.empty(0, dtype=np.int64)])
        if (np.diff(zero) <= 0).any():
            zero = np.unique(zero)  # of a block with several moves, or that is run again
        if self.tools or (np.diff(moves.line) <= 0).any():
            zero = zero[~np.isin(zero, moves.line)]
        return Program(
            self.source, moves.line, moves.kind, points[:-1], points[1:], moves.centre, moves.normal, moves.sweep,
            moves.curve, moves.feed, stop, moves.tolerance, moves.naive, moves.modal_feed, moves.exact, tuple(self.events),
            zero, self.line_count, self.axis_lines, self._notes(), beziers,
        )  # fmt: skip

    def _points(self, parts: list[MoveColumns]) -> FloatArray:
        """Where the machine stands before the first move and after each, (m + 1, 9), as far as was known at every part."""
        points = np.empty((sum(part.line.size for part in parts) + 1, self.first.size))
        points[0] = self.first
        at = 1
        for part in parts:
            rows, carried = slice(at, at + part.line.size), part.end.shape[1]
            points[rows, :carried] = part.end
            points[rows, carried:] = self.first[carried:]  # these have not moved so far
            at = rows.stop
        return points

    def _beside_tools(self, moves: MoveColumns, start: FloatArray) -> MoveColumns:
        """The moves of the compensated tools; events come after those that belong to the move that they came after."""
        columns = {item.name: getattr(moves, item.name) for item in fields(ProgrammedPath) if hasattr(moves, item.name)}
        path = compensate(ProgrammedPath(**columns, source=self.source, start=start), self.tools)
        keep = np.empty(path.row.size, dtype=np.uint8)
        bent = ((path.kind == ARC) & (path.sweep != 0.0)) | (path.kind == SPLINE)
        core.reader_merge_short_moves(
            path.row.size,
            path.end.shape[1],
            np.ascontiguousarray(path.end),
            bent,
            ZERO_LENGTH_MM,
            start[0].copy(),
            keep,
        )
        kept = keep == 1
        self.zero_lines.append(moves.line[path.row[~kept]])
        row = path.row[kept]
        last = np.append(np.searchsorted(row, np.arange(moves.line.size), side="right") - 1, -1)
        self.events = [replace(event, after_move=int(last[event.after_move])) for event in self.events]
        return replace(
            moves.take(row), kind=path.kind[kept], end=path.end[kept], centre=path.centre[kept], sweep=path.sweep[kept]
        )

    def _notes(self) -> tuple[str, ...]:
        """What was passed over, and what was taken for 0."""
        lines = [
            f"{count} line{'s' if count > 1 else ''} with {_NO_BLOCKS[name]} passed over, the first is line {first}"
            for name, (first, count) in self.skipped.items()
        ]
        arcs = [
            f"line {line}: start and end lie in one direction from the centre: by rule {turns:g} full turns, "
            f"{1e-3 * length:.6g} m on a radius of {length / (2.0 * np.pi * turns):.6g} mm"
            for line, length, turns in self.long_arcs
        ]
        if self.early_feeds is not None:
            first, count = self.early_feeds
            lines.append(
                f"F beside G20 or G21 counts in the units before, as on LinuxCNC, in {count} "
                f"block{'s' if count > 1 else ''}, the first in line {first}"
            )
        if self.probes is not None:
            first, count = self.probes
            lines.append(f"{count} probing move{'s' if count > 1 else ''} taken in full, the first in line {first}")
        return (*self.offsets.notes(), *lines, *arcs, *self.unread.notes())


@dataclass(frozen=True, eq=False)
class MoveColumns:
    """The kept moves of a part; columns as in Program, ends in the axes carried, whether G61.1 was active, and the tool
    that is compensated.
    """

    line: LineArray
    kind: NDArray[np.uint8]
    end: FloatArray
    centre: FloatArray
    normal: NDArray[np.uint8]
    sweep: FloatArray
    curve: LineArray
    feed: FloatArray
    exact: Mask
    tolerance: FloatArray
    naive: FloatArray
    tool: LineArray
    modal_feed: FloatArray

    @classmethod
    def none(cls) -> MoveColumns:
        """No moves."""
        byte, number, point = np.empty(0, dtype=np.uint8), np.empty(0), np.empty((0, 3))
        flag, index = np.empty(0, dtype=np.bool_), np.empty(0, dtype=np.int64)
        return cls(index, byte, point, point, byte, number, index, number, flag, number, number, index, number)

    @classmethod
    def joined(cls, parts: Sequence[MoveColumns], end: FloatArray) -> MoveColumns:
        """The moves of all parts, which end there in all axes."""
        names = [item.name for item in fields(cls) if item.name != "end"]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}, end=end)

    def take(self, rows: LineArray) -> MoveColumns:
        """Some of the moves, or of one several."""
        return MoveColumns(*(getattr(self, item.name)[rows] for item in fields(self)))


def carry_forward(given: Mask, value: NDArray[np.generic], before: float) -> NDArray[np.generic]:
    """Carry values forward from where they are given; before the first, the value of the part before."""
    if not given.any():
        return np.full(given.size, before)
    last = np.maximum.accumulate(np.where(given, np.arange(given.size), -1))
    return np.where(last >= 0, value[last], before)


def carry_modal(blocks: Blocks, before: dict[int, int]) -> tuple[dict[int, int], dict[int, LineArray]]:
    """The word of each modal group that is active at every block, and after the last."""
    modal = {
        group: np.asarray(carry_forward(blocks.g[group].given, blocks.g[group].value, code), dtype=np.int64)
        for group, code in before.items()
    }
    return {group: int(column[-1]) for group, column in modal.items()}, modal


def units(modal: dict[int, LineArray]) -> FloatArray:
    """Length unit of every block, mm; angles are degrees always."""
    return np.where(modal[UNITS] == 200, INCH_MM, 1.0)


def halve_diameters(blocks: Blocks, modal: dict[int, LineArray]) -> None:
    """Make radii of the X words that are diameters, under G7."""
    if (modal[DIAMETER] == 70).any():
        x = blocks.letters["X"]
        blocks.letters["X"] = replace(x, value=np.where(modal[DIAMETER] == 70, 0.5, 1.0) * x.value)


def carry_feeds(
    blocks: Blocks, modal: dict[int, LineArray], unit: FloatArray, kind: LineArray, state: ReadingState
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Feed at every block in mm/s and in degrees/s (G94), or a turn (G95), and moves a second (G93; nan elsewhere)."""
    faults, f, mode, motion = blocks.faults, blocks.letters["F"], modal[FEED_MODE], modal[MOTION]
    by_spindle = (motion == THREAD) | (motion == TAP) | (motion == THREADING)
    by_time, cuts = mode == 930, (kind >= LINE) & ~by_spindle
    given = f.given & ~by_time
    changed = np.append(mode[0] != state.feed_mode, mode[1:] != mode[:-1])
    last = np.where(given, f.value / np.where(mode == 950, 1.0, 60.0), np.nan)
    before = np.append(state.unit, unit[:-1])
    early = given & (before != unit)
    if early.any():
        line, count = state.early_feeds or (int(blocks.line[np.argmax(early)]), 0)
        state.early_feeds = line, count + int(early.sum())
    state.unit = float(unit[-1])
    feed = np.asarray(carry_forward(given | changed, last * before, state.feed))
    angular = np.asarray(carry_forward(given | changed, last, state.angular_feed))
    state.feed, state.angular_feed, state.feed_mode = float(feed[-1]), float(angular[-1]), int(mode[-1])
    word = np.where(blocks.g[MOTION].given, blocks.g[MOTION].word, blocks.first)
    unnamed = cuts & ~blocks.g[MOTION].given
    word[unnamed] = blocks.first_of(f"{AXIS_LETTERS}IJKR", unnamed)
    faults.add(word[cuts & ~by_time & np.isnan(feed)], "no feed is given; F is missing")
    faults.add(word[cuts & ~by_time & (feed == 0.0)], "the feed is 0; F must be > 0")
    faults.add(word[cuts & by_time & ~f.given], "G93 needs an F in every block that cuts")
    faults.add(f.at(cuts & by_time & (f.value == 0.0)), "must be > 0")
    return feed, angular, np.where(cuts & by_time & f.given, f.value / 60.0, np.nan)


def carry_tolerances(blocks: Blocks, unit: FloatArray, state: ReadingState) -> tuple[FloatArray, FloatArray]:
    """P and Q of G64 at every block, mm; 0 and nan under G61 and G61.1."""
    path, p, q = blocks.g[PATH_MODE], blocks.letters["P"], blocks.letters["Q"]
    blend = path.value == 640
    given = np.where(
        blend, np.where(p.given & (p.value > 0.0), p.value * unit, np.nan), 0.0
    )  # P0 is none, as on LinuxCNC
    tolerance = np.asarray(carry_forward(path.given, given, state.tolerance))
    naive = np.asarray(carry_forward(path.given, np.where(blend & q.given, q.value * unit, np.nan), state.naive))
    state.tolerance, state.naive = float(tolerance[-1]), float(naive[-1])
    return tolerance, naive
