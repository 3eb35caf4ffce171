"""The path of a long program, part after part, with the memory of one.

A part covers some thousand blocks.  What a junction becomes, and where a tube begins, depends on its surroundings only;
so a part is built with a few blocks before it and some after it, and ends where the rest of the program has no more say:

1.  at the last exact stop of its second half, if there is one; the program's end is one;
2.  inside the last tube, ``OVERLAP`` knots before its end as far as it is known: the next part's tube begins there with the
    same position and three derivatives;
3.  before that tube, where it has too few knots;
4.  else beyond the last corner, at the end of the last tube, or between two blocks that go on smoothly.

A part that would have no length is built again with twice as many blocks.  Each is measured within the tolerance, together
with the end of the part before it, since the point of the path nearest to a programmed one may lie there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.errors import SolverError
from planner.machine.limits import Limits
from planner.programs.long.run import Run, cut_run
from planner.programs.path.absorb import Absorbed, absorb
from planner.programs.path.corners import Junction, Junctions, classify
from planner.programs.path.measure import LinePlace, Written, largest_deviation
from planner.programs.path.moves import MovingBlocks, ProgramAxes
from planner.programs.path.separate_path import (
    MARGIN,
    SHORT_REST,
    assemble,
    places_of,
    tube_stretches,
    widest_piece,
)
from planner.programs.path.smooth_path import MAX_TRIES, NARROWER
from planner.programs.path.stretch import OVERLAP, Fitted, Stretch, fit
from planner.programs.reading.program import Program, part_of
from planner.types import FloatArray

_HISTORY, _AHEAD = 3, 3  # blocks that decide what a junction becomes, on either side
_FIRST_BLOCKS, _MIN_BLOCKS, _MAX_BLOCKS = 4000, 500, 20_000
_WANTED_KNOTS = 1800.0  # of the tubes of a part
_MIN_KNOTS = 2 * OVERLAP  # of a tube that is cut
_DEFERRED = 4.0  # tolerances before a cut that are measured with the next part: twice the tangential slip
_KEPT = 8.0  # mm of a part that are kept to measure the next one
_ROUNDING = 1e-9  # mm, of abscissae
_BESIDE = 1e-7  # mm; a junction this near to the start of a part belongs to the part before


@dataclass(frozen=True, eq=False)
class Cursor:
    """Where a part begins, and how.

    Attributes
    ----------
    row : int
        Move that it begins in, of those that absorption leaves.
    offset : float
        How far along it, mm.
    entry : (4, dim) array or None
        Position and three derivatives there, inside a tube.
    rests : bool
        The path is at rest there.
    blocks : int
        How many blocks to look at.
    tail : Run or None
        The end of the part before it.
    deferred : float
        Tolerance of the last ``_DEFERRED`` tolerances before it, which have not been measured; 0 if all has been.
    """

    row: int
    offset: float
    entry: FloatArray | None
    rests: bool
    blocks: int
    tail: Run | None
    deferred: float


@dataclass(frozen=True, eq=False)
class PathPart:
    """A part of the path: the run, whether the path rests at its end, and what was measured.

    ``deviation`` is in mm, ``share`` against the tolerance in force, ``deviation_row`` the move it was found at;
    ``stops`` are exact stops that nobody asked for: the row before each, and why.
    """

    run: Run
    rests: bool
    deviation: float
    share: float
    deviation_row: int
    stops: tuple[tuple[int, str], ...]


@dataclass(frozen=True, eq=False)
class PathSource:
    """A program, and what its path depends on besides: axes that move, the tolerance in place of its own, limits."""

    program: Program
    used: ProgramAxes
    tolerance: float | None
    limits: Limits

    @cached_property
    def row(self) -> NDArray[np.intp]:
        """The moves of the program with a length."""
        return np.flatnonzero(self.program.lengths > 0.0)

    @cached_property
    def absorbed(self) -> Absorbed:
        """What absorption leaves of the program: the same for every part, so that parts join."""
        return absorb(self.program, MovingBlocks.of(self.program, self.tolerance, self.used))

    def given(self, first: int, last: int) -> slice:
        """Which of ``row`` the moves from ``first`` to before ``last`` stand for."""
        begin, end = np.searchsorted(self.absorbed.owner, [first, last])
        return slice(int(begin), int(end))

    def start(self) -> Cursor:
        """The cursor before the first part."""
        return Cursor(0, 0.0, None, True, _FIRST_BLOCKS, None, 0.0)

    def part(self, cursor: Cursor) -> tuple[PathPart, Cursor | None]:
        """Build the part at a cursor; with it comes the cursor of the next one, None at the end of the program."""
        count = cursor.blocks
        while True:
            view = _View.of(self, cursor, count)
            share = 1.0
            for number in range(MAX_TRIES + 1):  # as for the path of a whole program
                pieces = view.fit(share, None if number else view.room)
                if pieces is None:
                    break
                part = _measured(view, pieces)
                if part.share <= 1.0:
                    return part, _next(view, pieces, part)
                share *= NARROWER / part.share if number else 1.0
            else:
                line = self.program.line[part.deviation_row]
                raise SolverError(
                    f"{self.program.source}:{line}: the path leaves the tolerance by {part.share - 1.0:.2g} of it; give a "
                    "larger one"
                )
            count *= 2


@dataclass(frozen=True, eq=False)
class _FittedTubes:
    """What was fitted: junctions, tubes in order, reasons of stops, where the part ends, and whether inside a tube."""

    junctions: Junctions
    tubes: list[Fitted]
    reasons: dict[int, str]
    end: float
    inside: bool


@dataclass(frozen=True, eq=False)
class _View:
    """The moves in sight of a cursor, of those that absorption leaves: from ``first``, the part beginning at ``start``, mm.

    ``own`` is the tolerance in force at each, ``given`` the rows of the program they stand for, ``written`` these blocks.
    """

    source: PathSource
    cursor: Cursor
    first: int
    blocks: MovingBlocks
    own: FloatArray
    given: NDArray[np.intp]
    written: Written
    start: float
    is_last: bool

    @classmethod
    def of(cls, source: PathSource, cursor: Cursor, count: int) -> _View:
        """Take ``count`` blocks from the cursor on."""
        absorbed = source.absorbed
        size = len(absorbed.program)
        first, last = max(cursor.row - _HISTORY, 0), min(cursor.row + count, size)
        blocks = MovingBlocks.of(part_of(absorbed.program, slice(first, last)), None, source.used)
        edges = blocks.programmed.edges
        some = source.given(first, last)
        given = source.row[some]
        programmed = MovingBlocks.of(part_of(source.program, given), source.tolerance, source.used).programmed
        begin = float(absorbed.edges[first])
        place = _at_edges(absorbed.place[some.start : some.stop + 1] - begin, edges)
        lines = [(lo - begin, hi - begin, tolerance) for lo, hi, tolerance in absorbed.lines(first, last)]
        start = float(edges[cursor.row - first]) + cursor.offset
        own = absorbed.own[first:last]
        written = Written(programmed, place, lines)
        return cls(source, cursor, first, blocks, own, given, written, start, last == size)

    @property
    def room(self) -> FloatArray:
        """How far the corners may pass from their vertices, by measurement."""
        return self.source.absorbed.room[self.first : self.first + self.own.size - 1]

    def row_before(self, junction: int) -> int:
        """The row of the program whose end a junction is."""
        last = self.source.given(0, self.first + junction + 1).stop - 1
        return int(self.source.row[last])

    @property
    def edges(self) -> FloatArray:
        """Abscissae of the blocks."""
        return self.blocks.programmed.edges

    @property
    def known(self) -> float:
        """Up to here the blocks in sight decide."""
        edges = self.edges
        if self.is_last:
            return float(edges[-1])
        return float(min(edges[-1] - 2.0 * MARGIN - SHORT_REST, edges[max(edges.size - 1 - _AHEAD, 0)]))

    def fit(self, share: float, room: FloatArray | None) -> _FittedTubes | None:
        """Fit tubes with a share of their tolerance, corners within ``room``; None where the part would have no length."""
        blocks, limits = self.blocks, self.source.limits
        junctions = classify(blocks.programmed, blocks.tolerance, blocks.stop, room, blocks.apart)
        s = self.edges[1:-1]
        halts = s[(junctions.kind == Junction.STOP) & (s > self.start + _BESIDE) & (s <= self.known)]
        end = float(halts[-1]) if halts.size and halts[-1] > 0.5 * (self.start + self.known) else np.inf
        end = float(self.edges[-1]) if self.is_last else end
        reasons: dict[int, str] = {}
        tubes: list[Fitted] = []
        inside = False
        feed = np.where(blocks.rapid | blocks.angular, blocks.feed, np.minimum(blocks.feed, limits.feed))
        todo = self._entered(tube_stretches(blocks, junctions, self.start + _BESIDE), junctions, np.inf)[::-1]
        while todo:
            stretch = todo.pop()
            if stretch.start >= end - _BESIDE:
                break
            is_open = stretch.end > self.known and not self.is_last and np.isinf(end)
            if is_open and _knots(stretch) < _MIN_KNOTS:
                end = stretch.start
                break
            narrowed = replace(stretch, tolerance=share * stretch.tolerance)
            fitted = replace(fit(narrowed, blocks.programmed, limits, feed), tolerance=stretch.tolerance)
            if fitted.deviation > narrowed.tolerance:
                todo += self._split(narrowed, fitted, junctions, reasons)[::-1]
                continue
            if is_open:
                fitted = fitted.up_to(fitted.knots.size - 1 - OVERLAP)
                end, inside = float(fitted.knots[-1]), True
            tubes.append(fitted)
            if is_open:
                break
        if np.isinf(end):
            end = self._last_cut(junctions, tubes)
        if (
            end <= self.start + SHORT_REST
            and not self.is_last
            and not (s[junctions.kind == Junction.STOP] == end).any()
        ):
            return None
        return _FittedTubes(junctions, tubes, reasons, end, inside)

    def _entered(self, stretches: list[Stretch], junctions: Junctions, last: float) -> list[Stretch]:
        """Let the first stretch begin as the part before ended."""
        start, entry = self.start, self.cursor.entry
        first = stretches[0] if stretches else None
        if entry is None:
            s = self.edges[1:-1]
            begun = first is not None and ((junctions.kind >= Junction.CORNER) & (s > start) & (s < first.start)).any()
            if first is not None and first.start < start + SHORT_REST and not begun:
                first = replace(first, stops=(self.cursor.rests, first.stops[1])).part(start, first.end, None)
                first = replace(first, start=start)
                return [first, *stretches[1:]]
            return stretches
        s, reach = self.edges[1:-1], junctions.reach
        fences = np.flatnonzero((junctions.kind >= Junction.CORNER) & (s > start + _BESIDE))
        fence = float(s[fences[0]] - reach[fences[0]]) if fences.size else float(self.edges[-1])
        halts = bool(fences.size == 0 or junctions.kind[fences[0]] == Junction.STOP)
        if first is not None and first.start < fence:
            first = replace(first, start=start, stops=(False, first.stops[1])).part(start, first.end, entry)
            return [first, *stretches[1:]]
        end = min(fence, start + 2.0 * MARGIN, last)
        none = np.empty(0)
        index = int(np.clip(np.searchsorted(self.edges, start, side="right") - 1, 0, self.edges.size - 2))
        tolerance = float(self.blocks.tolerance[index])
        bridge = Stretch(start, end, (False, halts and end == fence), none, none, none, none, tolerance, entry)
        return [bridge, *stretches]

    def _split(self, stretch: Stretch, fitted: Fitted, junctions: Junctions, reasons: dict[int, str]) -> list[Stretch]:
        """Put an exact stop where a tube cannot be kept within its share of the tolerance; returns what is left to fit."""
        s = self.edges[1:-1]
        inner = np.flatnonzero((junctions.kind == Junction.TUBE) & (s > stretch.start + _BESIDE) & (s < stretch.end))
        if inner.size == 0:
            line = self.source.absorbed.program.line[self.cursor.row]
            raise SolverError(
                f"{self.source.program.source}:{line}: the path cannot go on within the tolerance; give a larger one"
            )
        at = int(inner[np.argmin(np.abs(s[inner] - fitted.abscissa))])
        junctions.kind[at] = Junction.STOP
        reasons[at] = f"the tube would leave the tolerance by {1e3 * (fitted.deviation - stretch.tolerance):.3g} um"
        left = tube_stretches(self.blocks, junctions, max(stretch.start, self.start + _BESIDE), stretch.end)
        return self._entered(left, junctions, stretch.end) if stretch.start == self.start else left

    def _last_cut(self, junctions: Junctions, tubes: list[Fitted]) -> float:
        """The last place up to which all is known and at which the path is on a block."""
        s = self.edges[1:-1]
        fences = junctions.kind >= Junction.CORNER
        places = np.concatenate([s[fences] + junctions.reach[fences], s[junctions.kind == Junction.SMOOTH]])
        taken = zip((s - junctions.reach)[fences], (s + junctions.reach)[fences], strict=True)
        busy = [(float(a), float(b)) for a, b in taken]
        busy += [(float(tube.knots[0]), float(tube.knots[-1])) for tube in tubes]
        places = np.unique(np.append(places, [tube.knots[-1] for tube in tubes]))
        places = places[(places > self.start) & (places <= self.known)]
        if busy:
            lo, hi = (np.array(ends) for ends in zip(*sorted(busy), strict=True))
            before = np.searchsorted(lo, places, side="left") - 1
            places = places[(before < 0) | (places >= np.maximum.accumulate(hi)[np.maximum(before, 0)])]
        return float(places[-1]) if places.size else self.start


def _at_edges(place: FloatArray, edges: FloatArray) -> FloatArray:
    """Places, those that are at an edge but for rounding exactly there."""
    k = np.clip(np.searchsorted(edges, place), 1, edges.size - 1)
    nearest = np.where(place - edges[k - 1] < edges[k] - place, edges[k - 1], edges[k])
    return np.clip(np.where(np.abs(place - nearest) < _ROUNDING, nearest, place), 0.0, edges[-1])


def _knots(stretch: Stretch) -> int:
    from planner.programs.path import tube_knots as knotting

    return int(knotting.place(stretch.start, stretch.end, stretch.at, stretch.spacing, stretch.sharp).size)


def _measured(view: _View, pieces: _FittedTubes) -> PathPart:
    """Assemble the part and measure it."""
    blocks, cursor, written = view.blocks, view.cursor, view.written
    curve, _, s_edges = assemble(blocks, pieces.junctions, pieces.tubes)
    owner = view.source.absorbed.owner[view.source.given(view.first, view.first + blocks.row.size)] - view.first
    run = cut_run(curve, s_edges, (written.place, blocks.feed[owner], blocks.angular[owner]), view.start, pieces.end)
    run = replace(run, row=view.given[run.row])
    joined, s_joined = run.curve, run.s + view.start
    if cursor.tail is not None:
        whole = cursor.tail.joined(run, rests=cursor.rests)
        joined, s_joined = whole.curve, whole.s - cursor.tail.s[-1] + view.start
    widest = widest_piece(pieces.junctions, pieces.tubes)
    places, lines = _measured_places(view, pieces)
    found, largest = largest_deviation(joined, joined.edges, s_joined, replace(written, lines=lines), places, widest)
    edges = written.programmed.edges
    at = int(np.clip(np.searchsorted(edges, found.abscissa, side="right") - 1, 0, view.given.size - 1))
    s = view.edges[1:-1]
    rests = bool(view.is_last or (s[pieces.junctions.kind == Junction.STOP] == pieces.end).any())
    stops = tuple(
        (view.row_before(k), reason) for k, reason in sorted(pieces.reasons.items()) if view.start < s[k] <= pieces.end
    )
    return PathPart(run, rests, found.largest, largest, int(view.given[at]), stops)


def _measured_places(view: _View, pieces: _FittedTubes) -> tuple[list[LinePlace], list[LinePlace]]:
    """Corners and tubes of the part, and lines that stand for several blocks, with the tolerance in force there."""
    lo, hi = view.start - _BESIDE, pieces.end + _BESIDE
    places = [
        place
        for place in places_of(view.edges, view.own, pieces.junctions, pieces.tubes)
        if place[0] >= lo and place[1] <= hi
    ]
    if pieces.inside:
        places = [
            (start, end - _DEFERRED * tolerance if end == pieces.end else end, tolerance)
            for start, end, tolerance in places
        ]
    if view.cursor.deferred > 0.0:
        places.append((view.start - _DEFERRED * view.cursor.deferred, view.start, view.cursor.deferred))
    lines = [(max(a, lo), min(b, hi), tolerance) for a, b, tolerance in view.written.lines if a < hi and b > lo]
    return places, lines


def _next(view: _View, pieces: _FittedTubes, part: PathPart) -> Cursor | None:
    """The cursor at the end of a part."""
    if view.is_last:
        return None
    edges = view.edges
    block = int(np.searchsorted(edges, pieces.end + _BESIDE, side="right")) - 1
    knots = sum(tube.knots.size for tube in pieces.tubes)
    wanted = part.run.row.size * _WANTED_KNOTS / knots if knots else _MAX_BLOCKS
    run = part.run
    first = int(np.searchsorted(run.curve.edges, run.length - _KEPT, side="right")) - 1
    return Cursor(
        row=int(view.blocks.row[block]) + view.first,
        offset=max(0.0, pieces.end - float(edges[block])),
        entry=pieces.tubes[-1].end_derivatives() if pieces.inside else None,
        rests=part.rests,
        blocks=int(np.clip(wanted, _MIN_BLOCKS, _MAX_BLOCKS)),
        tail=run.pieces(max(first, 0), run.curve.kind.size),
        deferred=places_of(view.edges, view.own, pieces.junctions, pieces.tubes[-1:])[-1][2] if pieces.inside else 0.0,
    )
