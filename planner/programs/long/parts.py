"""The path of a long program, part after part, with the memory of one.

A part covers some thousand blocks.  What a junction becomes, and where a tube begins, depends on its surroundings only;
so a part is built with a few blocks before it and some after it, and ends where the rest of the program has no more say:

1.  at the last exact stop of its second half, if there is one; the program's end is one;
2.  inside the last tube, ``OVERLAP`` knots before its end as far as it is known: the next part's tube begins there with the
    same position and three derivatives;
3.  before that tube, where it has too few knots;
4.  else beyond the last corner, at the end of the last tube, or between two blocks that go on smoothly.

Runs of which path and feed are found together lie in one part, wholly (``part_runs``).

A part that would have no length is built again with twice as many blocks.  Each is measured within the tolerance, together
with the end of the part before it, since the point of the path nearest to a programmed one may lie there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.errors import SolverError
from planner.programs.long import part_runs
from planner.programs.long.part_runs import PartRuns
from planner.programs.long.path_source import Cursor, PathSource
from planner.programs.long.run import Run, cut_run
from planner.programs.long.runs_beside import RunsBeside
from planner.programs.long.view import BESIDE, FittedTubes, View
from planner.programs.path.corners import Junction
from planner.programs.path.measure import LinePlace
from planner.programs.path.measured_runs import MeasuredPath
from planner.programs.path.separate_path import assemble, places_of, widest_piece
from planner.programs.path.smooth_path import MAX_TRIES, NARROWER
from planner.programs.path.splice import Placed, spliced

_FIRST_BLOCKS, _MIN_BLOCKS, _MAX_BLOCKS = 4000, 500, 20_000
_WANTED_KNOTS = 1800.0  # of the tubes of a part
_DEFERRED = 4.0  # tolerances before a cut that are measured with the next part: twice the tangential slip
_KEPT = 8.0  # mm of a part that are kept to measure the next one


@dataclass(frozen=True, eq=False)
class PathPart:
    """A part of the path: the run, whether the path rests at its end, and what was measured.

    ``deviation`` is in mm, ``share`` against the tolerance in force, ``deviation_row`` the move it was found at;
    ``stops`` are exact stops that nobody asked for: the row before each, and why.  Of the ``runs`` that begin in it,
    ``separate`` are those made separately: the row each begins with, and why.
    """

    run: Run
    rests: bool
    deviation: float
    share: float
    deviation_row: int
    stops: tuple[tuple[int, str], ...]
    runs: int
    separate: tuple[tuple[int, str], ...]


def first_cursor() -> Cursor:
    """The cursor before the first part."""
    return Cursor(0, 0.0, None, True, _FIRST_BLOCKS, None, 0.0)


def next_part(source: PathSource, cursor: Cursor, beside: RunsBeside | None = None) -> tuple[PathPart, Cursor | None]:
    """Build the part at a cursor; with it comes the cursor of the next one, None at the end of the program."""
    count, runs = cursor.blocks, PartRuns()
    sight = max(count, part_runs.MAX_BLOCKS)
    if source.joint is not None:
        view = View.of(source, cursor, sight)
        runs = view.runs(beside)
        if np.isfinite(runs.end):
            count = sight
    while True:
        view = View.of(source, cursor, count)
        if count > sight:  # there may be the end of a run in it by now
            runs = view.runs(beside)
        found = _built(view, runs)
        if found is not None:
            return found
        count *= 2


def _built(view: View, runs: PartRuns) -> tuple[PathPart, Cursor | None] | None:
    """Build the part of a view; None where it would have no length."""
    share, number = 1.0, 0
    while number <= MAX_TRIES:  # as for the path of a whole program
        pieces = view.fit(share, None if number else view.room, runs)
        if pieces is None:
            return None
        part, measured = _measured(view, pieces)
        if part.share <= 1.0:
            return part, _next(view, pieces, part)
        kept = runs.left_out(measured.share, view.found_again)
        if kept is not runs:
            runs = kept
            continue
        share *= NARROWER / part.share if number else 1.0
        number += 1
    source = view.source
    line = source.program.line[part.deviation_row]
    raise SolverError(
        f"{source.program.source}:{line}: the path leaves the tolerance by {part.share - 1.0:.2g} of it; give a larger one"
    )


def _measured(view: View, pieces: FittedTubes) -> tuple[PathPart, MeasuredPath]:
    """Assemble the part and measure it."""
    cursor, written = view.cursor, view.written
    run = _run_of(view, pieces)
    curve, u, s = run.curve, run.at, run.s + view.start
    if cursor.tail is not None:
        whole = cursor.tail.joined(run, rests=cursor.rests)
        curve, u, s = whole.curve, whole.at, whole.s - cursor.tail.s[-1] + view.start
    places, lines = _measured_places(view, pieces)
    measured = MeasuredPath(curve, curve.edges, u, s, view.edges, view.own, replace(written, lines=lines))
    found, largest = measured.largest(pieces.runs.runs, places, widest_piece(pieces.junctions, pieces.tubes))
    edges = written.programmed.edges
    at = int(np.clip(np.searchsorted(edges, found.abscissa, side="right") - 1, 0, view.given.size - 1))
    stops = view.edges[1:-1]
    rests = bool(view.ends(pieces.end) or (stops[pieces.junctions.kind == Junction.STOP] == pieces.end).any())
    reasons = tuple(
        (view.row_before(k), reason)
        for k, reason in sorted(pieces.reasons.items())
        if view.start < stops[k] <= pieces.end
    )
    runs = pieces.runs.runs
    separate = tuple((view.row_of(one.first), one.reason) for one in runs if one.part is None)
    part = PathPart(run, rests, found.largest, largest, int(view.given[at]), reasons, len(runs), separate)
    return part, measured


def _run_of(view: View, pieces: FittedTubes) -> Run:
    """Assemble the part."""
    blocks, source = view.blocks, view.source
    curve, u_edges, s_edges = assemble(blocks, pieces.junctions, pieces.tubes)
    placed = Placed(curve, u_edges, s_edges, np.interp(view.edges, s_edges, u_edges))
    if source.joint is not None:
        placed = spliced(placed, blocks, list(pieces.runs.runs), source.joint)
    owner = source.absorbed.owner[source.given(view.first, view.first + blocks.row.size)] - view.first
    place = view.written.place
    u = placed.at(place)
    block = np.searchsorted(view.edges, place)
    exact = view.edges[block] == place
    u[exact] = placed.ends[block[exact]]
    run = cut_run(placed, (u, blocks.feed[owner], blocks.angular[owner]), view.start, pieces.end)
    return replace(run, row=view.given[run.row])


def _measured_places(view: View, pieces: FittedTubes) -> tuple[list[LinePlace], list[LinePlace]]:
    """Corners and tubes of the part, and lines that stand for several blocks, with the tolerance in force there."""
    lo, hi = view.start - BESIDE, pieces.end + BESIDE
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


def _next(view: View, pieces: FittedTubes, part: PathPart) -> Cursor | None:
    """The cursor at the end of a part."""
    if view.ends(pieces.end):
        return None
    edges = view.edges
    block = int(np.searchsorted(edges, pieces.end + BESIDE, side="right")) - 1
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
        tail=run.pieces(max(first, 0), run.curve.kind.size).untimed(),
        deferred=places_of(view.edges, view.own, pieces.junctions, pieces.tubes[-1:])[-1][2] if pieces.inside else 0.0,
    )
