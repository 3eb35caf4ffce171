"""Blocks that lie inside the tolerance are absorbed before the junctions are looked at.

A corner takes 8 A of both its blocks.  Beside a block of a micrometre it would shrink to nanometres and the feed in it to
nothing, for a detail that the tolerance allows to leave out.  So runs of such blocks become one line, in four passes:

1.  share 0.02 of the tolerance: blocks that are too short for the corner at one of their ends, with the blocks beside them
    as far as the corner wants to reach; and blocks with a turn at one end that are shorter than 0.2 tolerances, or than 1.5
    tolerances where they go on straight at the other;
2.  shares 0.1, 0.5 and 0.9: blocks too short for the corner at one of their ends.

A vertex is left out where a line between vertices that stay passes all those between within the share, in their order: then
no point of either is farther from the other (the distance of two segments whose ends are matched is convex).  What a line
is off is taken from the tolerance of what is made of it, so the path keeps to the program's own; that is measured against
the blocks as they were written.  In the end what a line is off is measured without regard to the order, and how large a
corner beside it may be as well (``sizes``): a spike along a line, or a block across a corner, takes less than its length.

Never left out: the ends of the program, stops, rapids and blocks without a tolerance, arcs longer than 0.2 tolerances,
splines whose bow is more than the share, and blocks with a feed of their own that would take longer than 0.1 ms.  No line
stands for blocks whose feed is measured along different axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.blend import BLEND_REACH
from planner.programs.path.corner_sizes import rooms
from planner.programs.path.corners import CORNER_TURN, SHARE_OF_BLOCK, tangent_jumps
from planner.programs.path.deviation import Programmed
from planner.programs.path.measure import LinePlace, Written
from planner.programs.path.moves import MovingBlocks
from planner.programs.reading.program import ARC, LINE, SPLINE, Program, rows_of
from planner.types import FloatArray

_SHARES = (0.02, 0.1, 0.5, 0.9)  # of the tolerance
_MICRO, _SHORT = 0.2, 1.5  # of the tolerance
_TURN, _ALONE = 0.01, 0.1  # rad; the chords of a curve turn by less, or at either end alike
_SPARE_TIME = 1e-4  # s
_SPLINE_MARGIN = 1.1  # for what a spline does between the points looked at


@dataclass(frozen=True, eq=False)
class Absorbed:
    """A program without the blocks inside its tolerance.

    Attributes
    ----------
    program : Program
        The moves that are left, every one with a length.  Their tolerance is what the blocks they stand for leave of theirs,
        their line that of the last of these.
    own : (k,) array
        The tolerance in force at every move, mm: the least of its blocks.
    owner : (m,) int array
        Row of ``program`` that every block of the given program which moves has its end in.
    place : (m + 1,) array
        Abscissae of the given vertices on ``program``, mm, not decreasing.
    edges : (k + 1,) array
        Abscissae at which its moves begin and end.
    room : (k - 1,) array
        The distance that a corner between two of them may keep from its vertex, by measurement, mm.
    count : int
        Blocks shorter than the tolerance that are no more.
    longest, largest : float
        The longest of them, and the largest distance between the lines and the blocks they stand for, mm.
    """

    program: Program
    own: FloatArray
    owner: NDArray[np.intp]
    place: FloatArray
    edges: FloatArray
    room: FloatArray
    count: int
    longest: float
    largest: float

    def written(self, programmed: Programmed) -> Written:
        """The given blocks, and where they lie on the moves that are left."""
        return Written(programmed, self.place, self.lines())

    def lines(self, first: int = 0, last: int | None = None) -> list[LinePlace]:
        """Where moves from ``first`` to before ``last`` stand for several blocks, and the tolerance there."""
        several = np.bincount(self.owner, minlength=self.own.size)[first:last] > 1
        rows = first + np.flatnonzero(several)
        return [(float(self.edges[k]), float(self.edges[k + 1]), float(self.own[k])) for k in rows]


def absorb(program: Program, blocks: MovingBlocks) -> Absorbed:
    """Absorb the blocks inside the tolerance.

    Parameters
    ----------
    program : Program
    blocks : Blocks
        All its blocks that move, with the tolerance in force.
    """
    halts = np.concatenate([[0], np.cumsum(program.stop_after)])
    stops = np.diff(halts[np.append(blocks.row, len(program))]) > 0
    moves = replace(rows_of(program, blocks.row), stop_after=stops, tolerance=blocks.tolerance)
    count = blocks.row.size
    work = _Absorbing(moves, blocks, blocks.tolerance, np.zeros(count), np.arange(count), blocks.programmed.edges)
    for number, share in enumerate(_SHARES):
        kept = _pass(work, share, beside=number == 0)
        if not kept.all():
            work = _joined(work, np.flatnonzero(kept[:-1]))
        work = _with_arcs_moved(work, share, beside=number == 0)
    lengths = np.diff(blocks.programmed.edges)
    gone = (np.bincount(work.owner, minlength=work.own.size)[work.owner] > 1) & (lengths < work.own[work.owner])
    place = np.maximum.accumulate(work.place)
    cost = _measured(work, moves)
    left = work.own - cost
    return Absorbed(
        program=replace(work.moves, tolerance=left),
        own=work.own,
        owner=work.owner,
        place=place,
        edges=work.blocks.programmed.edges,
        room=rooms(work.blocks.programmed, blocks.programmed, place, work.own, left, work.blocks.stop),
        count=int(np.count_nonzero(gone)),
        longest=float(lengths[gone].max(initial=0.0)),
        largest=float(cost.max()),
    )


@dataclass(frozen=True, eq=False)
class _Absorbing:
    """The moves so far, with their tolerances and how far they are off; ``owner`` and ``place`` as in :class:`Absorbed`."""

    moves: Program
    blocks: MovingBlocks
    own: FloatArray
    cost: FloatArray
    owner: NDArray[np.intp]
    place: FloatArray

    def replaced(self, moves: Program, cost: FloatArray, first: NDArray[np.intp], on: FloatArray) -> _Absorbing:
        """Put other moves in place: each from ``first`` on to before the next stands for these.

        ``on`` says where on the new moves the old ones begin, as a share of their length.
        """
        own = np.minimum.reduceat(self.own, first)
        blocks = MovingBlocks.of(replace(moves, tolerance=own), None, self.blocks.used)
        edges = blocks.programmed.edges
        row = np.repeat(np.arange(first.size), np.diff(np.append(first, self.own.size)))
        begins = np.append(edges[row] + on * np.diff(edges)[row], edges[-1])
        place = np.interp(self.place, self.blocks.programmed.edges, begins)
        return _Absorbing(moves, blocks, own, cost, row[self.owner], place)


def _pass(work: _Absorbing, share: float, *, beside: bool) -> NDArray[np.bool_]:
    """Which vertices stay, (k + 1,)."""
    moves, blocks, own = work.moves, work.blocks, work.own
    length = np.diff(blocks.programmed.edges)
    bow = _bow(moves, length)
    small = bow <= share * own
    loose = _loose(blocks, own, beside=beside)
    if beside:
        tiny = (moves.kind >= ARC) & (length <= _MICRO * own)
        loose[1:-1] |= (tiny[1:] | tiny[:-1]) & ~blocks.stop & (np.minimum(own[1:], own[:-1]) > 0.0)
    loose[:-1] &= small
    loose[1:] &= small
    if not loose.any():
        return np.ones(loose.size, dtype=np.bool_)
    alike = np.minimum(_MICRO * own, _SPARE_TIME * blocks.speed)
    rows = np.column_stack([length, np.where(small, bow, np.inf), blocks.feed, own, work.cost, alike])
    points = np.concatenate([moves.start[:1], moves.end])
    kept = np.empty(loose.size, dtype=np.uint8)
    core.absorb_runs(len(rows), points.shape[1], points, rows, loose.astype(np.uint8), share, kept)
    return kept.astype(np.bool_)


def _measured(work: _Absorbing, written: Program) -> FloatArray:
    """How far the moves are off the blocks they stand for, at most, (k,), mm; no more than the passes know.

    A block of lines is cut where it leaves the slab between the ends of its line.  A part within is as far from the line as
    the farther of its ends; all of them together pass every point of the line.  A part without, of a spike along the line
    or over its end, may be nearer to one of the neighbours, for all its length: then it is laid to the charge of both.
    """
    row, moves, own = work.owner, work.moves, work.own
    several = (np.bincount(row, minlength=own.size) > 1) & (np.bincount(row, written.kind >= ARC, own.size) == 0.0)
    cost = np.where(several, 0.0, work.cost)
    some = np.flatnonzero(several[row])
    at, start, vector = row[some], written.start[some], (written.end - written.start)[some]
    begin, end = (_along(moves, at, points) for points in (start, written.end[some]))
    with np.errstate(divide="ignore", invalid="ignore"):
        leaves = np.nan_to_num(np.array([-begin, 1.0 - begin]) / (end - begin))
    cuts = np.stack([np.zeros(some.size), *np.sort(np.clip(leaves, 0.0, 1.0), axis=0), np.ones(some.size)])
    for lo, hi in pairwise(cuts):
        parts = [start + share[:, None] * vector for share in (lo, hi)]
        nearest, away = at, np.where(lo < hi, _away(moves, at, parts), 0.0)
        middle = begin + 0.5 * (lo + hi) * (end - begin)
        outside = (middle <= 0.0) | (middle >= 1.0)
        for step in (-1, 1):
            other = np.clip(at + step, 0, own.size - 1)
            found = _away(moves, other, parts)
            nearer = outside & (found < away) & (moves.kind[other] == LINE) & (own[other] >= own[at])
            nearest, away = np.where(nearer, other, nearest), np.where(nearer, found, away)
        for charged in (at, nearest):
            np.maximum.at(cost, charged, away)
    return cost


def _along(moves: Program, row: NDArray[np.intp], points: FloatArray) -> FloatArray:
    """Where points (n, 3) are along the lines ``row`` (n,), as a share of their length."""
    vector = (moves.end - moves.start)[row]
    return np.asarray(np.sum((points - moves.start[row]) * vector, axis=1) / np.sum(vector**2, axis=1).clip(1e-300))


def _away(moves: Program, row: NDArray[np.intp], ends: list[FloatArray]) -> FloatArray:
    """Distance of straight parts with these ends from the lines ``row``, at most, (n,), mm."""
    vector = (moves.end - moves.start)[row]
    feet = (moves.start[row] + np.clip(_along(moves, row, points), 0.0, 1.0)[:, None] * vector for points in ends)
    return np.maximum(*(np.sqrt(np.sum((p - foot) ** 2, axis=1)) for p, foot in zip(ends, feet, strict=True)))


def _bow(moves: Program, length: FloatArray) -> FloatArray:
    """How far the points of every block are from its chord, in their order, at most, (k,), mm; 0 for lines.

    r (1 - cos(sweep / 2)) up to half a turn, 2 r beyond; a spiral is within the difference of its radii of a circle.
    """
    arc = np.flatnonzero(moves.kind == ARC)
    out = np.zeros(length.size)
    if moves.beziers is not None:
        on = np.flatnonzero(moves.kind == SPLINE)
        out[on] = np.minimum(length[on], _SPLINE_MARGIN * moves.beziers.taken(moves.curve[on]).bow)
    normal = np.eye(3)[moves.normal[arc]]
    radii = []
    for point in (moves.start[arc, :3], moves.end[arc, :3]):
        spoke = point - moves.centre[arc]
        spoke -= normal * np.sum(spoke * normal, axis=1)[:, None]
        radii.append(np.sqrt(np.sum(spoke**2, axis=1)))
    sweep = np.abs(moves.sweep[arc])
    share = np.where(sweep <= np.pi, 1.0 - np.cos(0.5 * sweep), 2.0)
    out[arc] = np.minimum(length[arc], share * np.maximum(*radii) + np.abs(radii[1] - radii[0]))
    return out


def _with_arcs_moved(work: _Absorbing, share: float, *, beside: bool) -> _Absorbing:
    """Let an arc end where the next one begins, if what lies between them is small.

    An arc whose end is moved goes around the same centre, with a radius that changes a little: no point of it moves farther
    than its end.
    """
    moves, blocks, own, cost = work.moves, work.blocks, work.own, work.cost.copy()
    turn = 2.0 * np.arcsin(np.minimum(0.5 * tangent_jumps(blocks.programmed), 1.0))
    corner = beside | (turn[:-1] > CORNER_TURN) | (turn[1:] > CORNER_TURN)
    length = np.diff(blocks.programmed.edges)
    arc = (moves.kind == ARC) & (_bow(moves, length) > share * own)
    room = share * np.minimum(np.minimum(own[:-2], own[1:-1]), own[2:]) - np.maximum(cost[:-2], cost[1:-1])
    free = ~blocks.stop[:-1] & ~blocks.stop[1:] & corner & arc[:-2] & arc[2:] & ~arc[1:-1]
    slow = (blocks.feed[1:-1] != blocks.feed[:-2]) & (length[1:-1] > _SPARE_TIME * blocks.speed[1:-1])
    gone = 1 + np.flatnonzero(free & ~slow & (length[1:-1] <= room))
    if gone.size == 0:
        return work
    stay = np.setdiff1d(np.arange(own.size), gone)
    end, sweep = moves.end.copy(), moves.sweep.copy()
    before = gone - 1
    first, second = (moves.normal[before] + 1) % 3, (moves.normal[before] + 2) % 3
    old, new = (point[:, :3] - moves.centre[before] for point in (moves.end[before], moves.end[gone]))
    k = np.arange(gone.size)
    cross = old[k, first] * new[k, second] - old[k, second] * new[k, first]
    sweep[before] += np.arctan2(cross, old[k, first] * new[k, first] + old[k, second] * new[k, second])
    end[before] = moves.end[gone]
    cost[before] = np.maximum(cost[before], cost[gone]) + length[gone]
    on = np.zeros(own.size)
    on[gone] = 1.0
    return work.replaced(rows_of(replace(moves, end=end, sweep=sweep), stay), cost[stay], stay, on)


def _loose(blocks: MovingBlocks, own: FloatArray, *, beside: bool) -> NDArray[np.bool_]:
    """Vertices that may be left out, (k + 1,)."""
    edges = blocks.programmed.edges
    length = np.diff(edges)
    chord = tangent_jumps(blocks.programmed)
    turn = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    corner = (turn > CORNER_TURN) & ~blocks.stop
    wanted = np.zeros(edges.size)
    allowed = np.minimum(own[:-1], own[1:])
    reach = BLEND_REACH / SHARE_OF_BLOCK * allowed / np.maximum(chord, 1e-300)
    if beside:
        wanted[1:-1] = np.where(corner, reach, np.where((turn > _TURN) & ~blocks.stop, _MICRO * allowed, 0.0))
    else:
        wanted[1:-1] = np.where(corner, reach, 0.0)
    tight = length < np.maximum(wanted[:-1], wanted[1:])
    if beside:
        turns = np.concatenate([[np.nan], np.where(blocks.stop, np.nan, turn), [np.nan]])
        least, most = np.minimum(turns[:-1], turns[1:]), np.maximum(turns[:-1], turns[1:])
        tight |= (length < _SHORT * own) & (most > _TURN) & (least < _ALONE * most)
    loose = np.zeros(edges.size, dtype=np.bool_)
    loose[:-1] |= tight
    loose[1:] |= tight
    if beside:
        # the blocks beyond a short one, as far as the corner wants to reach
        ahead = np.where(np.append(tight, False), edges + wanted, -np.inf)
        behind = np.where(np.append(False, tight), edges - wanted, np.inf)
        loose |= edges <= np.maximum.accumulate(ahead)
        loose |= edges >= np.minimum.accumulate(behind[::-1])[::-1]
    fixed = blocks.stop | blocks.apart | (allowed <= 0.0)
    loose[1:-1] &= ~fixed
    loose[[0, -1]] = False
    return loose


def _joined(work: _Absorbing, first: NDArray[np.intp]) -> _Absorbing:
    """One move from each vertex that stays to the next; ``first`` are the moves that begin there."""
    moves, cost = work.moves, work.cost
    last = np.append(first[1:], cost.size) - 1
    several = last > first
    length = np.diff(work.blocks.programmed.edges)
    row = np.repeat(np.arange(first.size), last - first + 1)
    start, end = moves.start[first], moves.end[last]
    vector = end - start
    square = np.sum(vector**2, axis=1)
    along = np.sum((moves.start - start[row]) * vector[row], axis=1) / np.where(square > 0.0, square, 1.0)[row]
    along[first] = 0.0
    # in the order of the vertices: a running maximum within each move
    along = np.maximum.accumulate(np.clip(along, 0.0, 1.0) + row) - row
    away = np.sqrt(np.sum((moves.start - start[row] - along[:, None] * vector[row]) ** 2, axis=1))
    away[first] = 0.0
    bow = np.where(moves.kind >= ARC, length, 0.0)
    off = np.where(several, np.maximum.reduceat(away, first) + np.maximum.reduceat(bow + cost, first), cost[first])
    order = np.lexsort((length, row))
    main = order[np.append(first[1:], cost.size) - 1]  # the longest block of each
    stop_after = np.logical_or.reduceat(moves.stop_after, first)
    columns = {
        name: getattr(moves, name)[last]
        for name in ("line", "normal", "naive_tolerance", "tolerance", "modal_feed", "exact_stop")
    }
    joined = replace(
        moves,
        **columns,
        kind=np.where(several, LINE, moves.kind[first]).astype(np.uint8),
        start=start,
        end=end,
        centre=np.where(several[:, None], np.nan, moves.centre[first]),
        sweep=np.where(several, 0.0, moves.sweep[first]),
        curve=np.where(several, -1, moves.curve[first]),
        feed=moves.feed[main],
        stop_after=stop_after,
    )
    return work.replaced(joined, off, first, along)
