"""The moves in sight of a cursor, and the corners and tubes of the part that begins there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from planner.errors import SolverError
from planner.programs.long.part_runs import PartRuns, RunsInSight, find_part_runs
from planner.programs.long.path_source import Cursor, PathSource
from planner.programs.long.runs_beside import RunsBeside
from planner.programs.path.corners import Junction, Junctions
from planner.programs.path.joint_runs import FoundRun, find_run
from planner.programs.path.measure import Written
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.separate_path import MARGIN, SHORT_REST, blocks_between, classified, tube_stretches
from planner.programs.path.stretch import OVERLAP, Fitted, Stretch, fit, knots_of
from planner.programs.reading.program import part_of
from planner.types import FloatArray

_HISTORY, _AHEAD = 3, 3  # blocks that decide what a junction becomes, on either side
_MIN_KNOTS = 2 * OVERLAP  # of a tube that is cut
_ROUNDING = 1e-9  # mm, of abscissae
BESIDE = 1e-7  # mm; a junction this near to the start of a part belongs to the part before


@dataclass(frozen=True, eq=False)
class FittedTubes:
    """What was fitted: junctions, tubes in order, reasons of stops, where the part ends, and whether inside a tube.

    ``runs`` are those of the part.
    """

    runs: PartRuns
    junctions: Junctions
    tubes: list[Fitted]
    reasons: dict[int, str]
    end: float
    inside: bool


@dataclass(frozen=True, eq=False)
class View:
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
    def of(cls, source: PathSource, cursor: Cursor, count: int) -> View:
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

    def ends(self, s: float) -> bool:
        """Whether an abscissa is the end of the program."""
        return bool(self.is_last and s == self.edges[-1])

    def row_of(self, block: int) -> int:
        """The first row of the program that a block stands for."""
        return int(self.source.row[self.source.given(0, self.first + block).stop])

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

    def runs(self, beside: RunsBeside | None = None) -> PartRuns:
        """Find the runs of the part, with the help of another process where there is one."""
        if self.source.joint is None:
            return PartRuns()
        sight = RunsInSight(self.source, self.first, self.blocks, classified(self.blocks, self.room))
        find = sight.found if beside is None else partial(beside.found, sight)
        return find_part_runs(self.blocks, sight.junctions, find, (self.start, self.known), rests=self.cursor.rests)

    def found_again(self, run: FoundRun, room: float) -> FoundRun:
        """A run within another share of its tolerance."""
        assert self.source.joint is not None
        junctions = classified(self.blocks, self.room)
        return find_run(self.blocks, junctions, self.source.joint, run.first, run.last, room=room)

    def fit(self, share: float, room: FloatArray | None, runs: PartRuns) -> FittedTubes | None:
        """Fit tubes with a share of their tolerance, corners within ``room``; None where the part would have no length."""
        blocks, limits = self.blocks, self.source.limits
        junctions = runs.smoothed(classified(blocks, room))
        s = self.edges[1:-1]
        end = min(runs.end, self._end_at_stop(junctions))
        reasons: dict[int, str] = {}
        tubes: list[Fitted] = []
        inside = False
        feed = np.where(blocks.rapid | blocks.angular, blocks.feed, np.minimum(blocks.feed, limits.feed))
        todo = self._entered(tube_stretches(blocks, junctions, self.start + BESIDE), junctions, np.inf)[::-1]
        while todo:
            stretch = todo.pop()
            if stretch.start >= end - BESIDE:
                break
            is_open = stretch.end > self.known and not self.is_last and np.isinf(end)
            if is_open and knots_of(stretch, self.blocks.programmed).size < _MIN_KNOTS:
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
        halts = end > self.start + BESIDE and bool((s[junctions.kind == Junction.STOP] == end).any())
        if end <= self.start + SHORT_REST and not self.ends(end) and not halts:
            return None
        return FittedTubes(runs, junctions, tubes, reasons, end, inside)

    def _end_at_stop(self, junctions: Junctions) -> float:
        """The end of the program, or the last exact stop of the second half; inf where there is none."""
        if self.is_last:
            return float(self.edges[-1])
        s = self.edges[1:-1]
        halts = s[(junctions.kind == Junction.STOP) & (s > self.start + BESIDE) & (s <= self.known)]
        return float(halts[-1]) if halts.size and halts[-1] > 0.5 * (self.start + self.known) else np.inf

    def _entered(self, stretches: list[Stretch], junctions: Junctions, last: float) -> list[Stretch]:
        """Let the first stretch begin as the part before ended."""
        start, entry = self.start, self.cursor.entry
        first = stretches[0] if stretches else None
        if entry is None:
            s = self.edges[1:-1]
            begun = first is not None and ((junctions.kind >= Junction.CORNER) & (s > start) & (s <= first.start)).any()
            if first is not None and first.start < start + SHORT_REST and not begun:
                first = replace(first, stops=(self.cursor.rests, first.stops[1])).part(start, first.end, None)
                first = replace(first, start=start)
                return [first, *stretches[1:]]
            return stretches
        s, reach = self.edges[1:-1], junctions.reach
        fences = np.flatnonzero((junctions.kind >= Junction.CORNER) & (s > start + BESIDE))
        fence = float(s[fences[0]] - reach[fences[0]]) if fences.size else float(self.edges[-1])
        halts = bool(fences.size == 0 or junctions.kind[fences[0]] == Junction.STOP)
        if first is not None and first.start < fence:
            first = replace(first, start=start, stops=(False, first.stops[1])).part(start, first.end, entry)
            return [first, *stretches[1:]]
        end = min(fence, start + 2.0 * MARGIN, last)
        none = np.empty(0)
        row, after = blocks_between(self.edges, start, end)
        allowed = self.blocks.tolerance[row:after]
        most = float(allowed.max())
        parts = most, self.edges[row : after + 1], allowed / most
        bridge = Stretch(
            start, end, (False, halts and end == fence), none, none, none.astype(np.bool_), none, none, *parts, entry
        )
        return [bridge, *stretches]

    def _split(self, stretch: Stretch, fitted: Fitted, junctions: Junctions, reasons: dict[int, str]) -> list[Stretch]:
        """Put an exact stop where a tube cannot be kept within its share of the tolerance; returns what is left to fit."""
        s = self.edges[1:-1]
        inner = np.flatnonzero((junctions.kind == Junction.TUBE) & (s > stretch.start + BESIDE) & (s < stretch.end))
        if inner.size == 0:
            line = self.source.absorbed.program.line[self.cursor.row]
            raise SolverError(
                f"{self.source.program.source}:{line}: the path cannot go on within the tolerance; give a larger one"
            )
        at = int(inner[np.argmin(np.abs(s[inner] - fitted.abscissa))])
        junctions.kind[at] = Junction.STOP
        reasons[at] = f"the tube would leave the tolerance by {1e3 * (fitted.deviation - stretch.tolerance):.3g} um"
        left = tube_stretches(self.blocks, junctions, max(stretch.start, self.start + BESIDE), stretch.end)
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
