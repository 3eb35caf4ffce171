"""The moves of a part of a program, made of its blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.programs.reading.arcs import resolve_arcs
from planner.programs.reading.compensation import end_beside
from planner.programs.reading.language import CENTRES, CYCLES, FEED_MODE, MOTION, PATH_MODE, PLANE, THREAD
from planner.programs.reading.modal import MoveColumns, ReadingState
from planner.programs.reading.positions import ProgramTrack
from planner.programs.reading.program import ANGULAR, ARC, RAPID, SPLINE, ZERO_LENGTH_MM, arc_lengths, feed_lengths
from planner.programs.reading.spindle import BlockSpindle, seconds_a_turn, x_along
from planner.programs.reading.splines import SplinePieces, spline_moves
from planner.programs.reading.words import LineArray
from planner.types import FloatArray

_SLOWEST = 0.1  # units a minute, as on LinuxCNC
_MAX_TURNS = 10_000  # of one arc: each turn takes some pieces and nodes of a plan
_LONG_ARC_MM = 1e6  # a full turn of this length is likely a short move whose digits are lost


@dataclass(frozen=True, eq=False)
class BlockFeeds:
    """At every block: feed in mm and degrees, a second or under G95 a turn; moves a second under G93, or nan; P and Q of
    G64, mm; and the spindle.
    """

    feed: FloatArray
    angular: FloatArray
    rate: FloatArray
    tolerance: FloatArray
    naive: FloatArray
    spindle: BlockSpindle


@dataclass(frozen=True, eq=False)
class MovesOfPart:
    """The moves that are long enough to be one; how many of them each block has, and the dwells within blocks.

    A dwell is its block, its seconds, and the index among the moves of the one it follows, -1 for none.
    """

    columns: MoveColumns
    count: LineArray
    dwells: list[tuple[int, float, int]]


def make_moves(track: ProgramTrack, feeds: BlockFeeds) -> MovesOfPart:
    """Make the moves; the lines of those too short to be one go to the state."""
    blocks, modal, state = track.blocks, track.modal, track.state
    rows, kind, ends, of_nurbs, pitch = _programmed(track)
    before = state.position.copy()
    keep = np.empty(rows.size, dtype=np.uint8)
    # Beside a programmed path, and from there back to it, is far: those of no length are taken out after that.
    always = (kind == ARC) | (kind == SPLINE) | bool(state.tools)
    core.reader_merge_short_moves(rows.size, ends.shape[1], ends, always, ZERO_LENGTH_MM, state.position, keep)
    state.zero_lines.append(blocks.line[rows[keep == 0]])
    dwells = _dwells(track, rows, keep)
    kept = keep == 1
    rows, kind, end, of_nurbs, pitch = rows[kept], kind[kept], ends[kept], of_nurbs[kept], pitch[kept]
    start = np.concatenate([before[None, : end.shape[1]], end])[:-1]
    splines = spline_moves(track, (rows, kind, start[:, :3], end[:, :3]), of_nurbs)
    normal = np.array([2, 1, 0], dtype=np.uint8)[modal[PLANE][rows] // 10 - 17]
    centre, sweep = np.full((rows.size, 3), np.nan), np.zeros(rows.size)
    arcs, along = np.flatnonzero(kind == ARC), np.empty(0)
    if arcs.size:
        centre[arcs], sweep[arcs] = _arcs(track, rows[arcs], (start[arcs, :3], end[arcs, :3], normal[arcs]))
        along = arc_lengths(start[arcs], end[arcs], centre[arcs], normal[arcs], sweep[arcs])
        for k in np.flatnonzero((along > _LONG_ARC_MM) & (np.abs(sweep[arcs]) >= 2.0 * np.pi)).tolist():
            turns = abs(float(sweep[arcs[k]])) / (2.0 * np.pi)
            state.long_arcs.append((int(blocks.line[rows[arcs[k]]]), float(along[k]), turns))
    if splines is not None:
        on, curved = splines.lengths()
        arcs, along = np.append(arcs, on), np.append(along, curved)
    travel, group = feed_lengths(start, end, arcs, along)
    feed, rate = np.where(group == ANGULAR, feeds.angular[rows], feeds.feed[rows]), feeds.rate[rows]
    by_time = ~np.isnan(rate)
    if by_time.any():
        # A block of no length moves where cutter compensation ends in it.
        slowest = np.where(travel < ZERO_LENGTH_MM, _SLOWEST / 60.0 * track.unit[rows], 0.0)
        feed = np.where(by_time, np.maximum(travel * rate, slowest), feed)
    turned = np.flatnonzero(((modal[FEED_MODE][rows] == 950) | ~np.isnan(pitch)) & (kind != RAPID))
    if turned.size:
        x = x_along(start, end, arcs, (centre[arcs], normal[arcs], sweep[arcs]))[turned]
        way = np.where(np.isnan(pitch), feed, pitch)[turned]
        feed[turned] = way / _turn_times(track, feeds.spindle, rows[turned], x)
    rapid = kind == RAPID
    by_minute = modal[FEED_MODE][rows] == 940
    modal_feed = np.where(rapid & ~by_minute, np.nan, feed)
    feed[rapid] = np.inf
    exact = modal[PATH_MODE][rows] == 611
    tolerance = np.where(np.isin(modal[MOTION][rows], CYCLES), 0.0, feeds.tolerance[rows])
    columns = MoveColumns(
        blocks.line[rows], kind.astype(np.uint8), end, centre, normal, sweep, np.full(rows.size, -1), feed, exact,
        tolerance, feeds.naive[rows], track.tools_beside(rows), modal_feed,
    )  # fmt: skip
    if splines is not None:
        columns, rows = _in_pieces(columns, rows, splines, sum(map(len, state.beziers)))
        state.beziers.append(splines.beziers)
    if state.tools and columns.line.size:
        state.beside = _offset_beside(columns, np.concatenate([before[None, :3], columns.end[:, :3]])[:-1], state)
        state.stands_beside = False
    shaping = [line for nurbs in track.nurbs for line in (*nurbs.lines, int(blocks.line[nurbs.row]))]
    state.zero_lines.append(np.setdiff1d(np.array(shaping, dtype=np.int64), columns.line))
    return MovesOfPart(columns, np.bincount(rows, minlength=track.kind.size), dwells)


def _offset_beside(columns: MoveColumns, start: FloatArray, state: ReadingState) -> FloatArray | None:
    """From the programmed end to that of the tool, (3,), mm; None where the last move is not compensated."""
    number = int(columns.tool[-1])
    if number == 0:
        return None
    in_plane = [(columns.normal[-1] + k) % 3 for k in (1, 2)]
    step = np.hypot(*(columns.end[:, :3] - start)[:, in_plane].T)
    moves = np.flatnonzero((columns.tool == number) & ((columns.kind == ARC) | (step >= ZERO_LENGTH_MM)))
    if not moves.size:
        return state.beside
    k = int(moves[-1])
    point = [complex(*at[k, in_plane]) for at in (start, columns.end, columns.centre)]
    offset = end_beside(
        state.tools[number - 1], *point, sweep=float(columns.sweep[k]) if columns.kind[k] == ARC else 0.0
    )
    out = np.zeros(3)
    out[in_plane] = offset.real, offset.imag
    return out


def _in_pieces(
    columns: MoveColumns, rows: LineArray, splines: SplinePieces, first: int
) -> tuple[MoveColumns, LineArray]:
    """A move for each piece of a spline; the curves before theirs are ``first``."""
    of = splines.move
    count = np.ones(rows.size, dtype=np.int64)
    count[of] = 0
    np.add.at(count, of, 1)
    move = np.repeat(np.arange(rows.size), count)
    pieces = columns.take(move)
    on = np.flatnonzero(np.isin(move, of))
    pieces.line[on] = splines.line
    pieces.curve[on] = first + np.arange(on.size)
    inner = np.flatnonzero(of[1:] == of[:-1])  # where another piece of the same spline goes on
    pieces.end[on[inner], :3] = splines.beziers.start[inner + 1]
    pieces.exact[on[inner]] = False  # a block ends at its end
    return pieces, rows[move]


def _turn_times(track: ProgramTrack, spindle: BlockSpindle, rows: LineArray, x: FloatArray) -> FloatArray:
    """Seconds of a turn of the spindle in these moves; refuse it where there is no speed."""
    blocks = track.blocks
    place = np.where(blocks.g[MOTION].given, blocks.g[MOTION].word, blocks.first)[rows]
    still = np.isnan(spindle.speed[rows]) | (spindle.speed[rows] == 0.0)
    blocks.faults.add(place[still], "its feed is that of the spindle, which has no speed; S is missing")
    out = np.ones(rows.size)
    out[~still] = seconds_a_turn(spindle, rows[~still], (x - track.origins(rows)[:, :1])[~still])
    blocks.faults.add(place[out == 0.0], "on the axis, at X0, the speed of G96 has no bound; write G96 with D")
    return np.where(out > 0.0, out, 1.0)


def _programmed(track: ProgramTrack) -> tuple[LineArray, LineArray, FloatArray, LineArray, FloatArray]:
    """Block, kind and end of every move, also of those in blocks that make several; which of the NURBS it is, or -1, and
    the pitch of threads, mm.
    """
    rows = np.flatnonzero((track.kind >= RAPID) & (track.kind <= SPLINE))
    kind, ends, of_nurbs = track.kind[rows], track.points[1:][rows], np.full(rows.size, -1)
    k = np.abs(track.blocks.letters["K"].value[rows]) * track.unit[rows]
    pitch = np.where(track.modal[MOTION][rows] == THREAD, k, np.nan)
    side, nurbs = track.side, track.nurbs
    if not side and not nurbs:
        return rows, kind, ends, of_nurbs, pitch
    rows = np.append(rows, [*(move.row for move in side), *(move.row for move in nurbs)])
    order = np.argsort(rows, kind="stable")
    kind = np.append(kind, [*(move.kind for move in side), *(SPLINE for _ in nurbs)])
    others = [*(move.end for move in side), *(move.end for move in nurbs)]
    ends = np.concatenate([ends, np.array(others)[:, : ends.shape[1]]])
    of_nurbs = np.append(of_nurbs, [*(-1 for _ in side), *range(len(nurbs))])
    pitch = np.append(pitch, [*(move.pitch for move in side), *(np.nan for _ in nurbs)])
    return rows[order], kind[order], np.ascontiguousarray(ends[order]), of_nurbs[order], pitch[order]


def _dwells(track: ProgramTrack, rows: LineArray, keep: NDArray[np.uint8]) -> list[tuple[int, float, int]]:
    """Dwells after moves of blocks that make several."""
    if not any(move.dwell for move in track.side):
        return []
    index, moves = np.cumsum(keep) - 1, sorted(track.side, key=lambda move: move.row)
    side = np.isin(rows, [move.row for move in moves])
    return [(move.row, move.dwell, int(at)) for move, at in zip(moves, index[side], strict=True) if move.dwell]


def _arcs(
    track: ProgramTrack, rows: LineArray, move: tuple[FloatArray, FloatArray, NDArray[np.uint8]]
) -> tuple[FloatArray, FloatArray]:
    """Centre and sweep of the arcs at these blocks; refuse the impossible."""
    blocks, modal, unit, (start, end, normal) = track.blocks, track.modal, track.unit, move
    offsets = np.stack([blocks.letters[name].value[rows] * unit[rows] for name in "IJK"], axis=1)
    centre = np.where(
        (modal[CENTRES][rows] == 901)[:, None], track.origins(rows) + offsets, track.points[rows, :3] + offsets
    )
    r = blocks.letters["R"]
    radius = np.where(r.given[rows], r.value[rows] * unit[rows], np.nan)
    arcs = resolve_arcs(start, end, normal, modal[MOTION][rows] == 30, centre, radius, ZERO_LENGTH_MM, unit[rows])
    place = np.minimum(blocks.first_of("IJKR", np.ones(blocks.line.size, dtype=bool)), blocks.of_word.size - 1)[rows]
    bad = np.flatnonzero(~np.isnan(arcs.mismatch))
    blocks.faults.add(
        place[bad],
        lambda i: (
            f"start and end lie {arcs.radii[bad[i], 0]:.6g} and {arcs.radii[bad[i], 1]:.6g} mm from the centre; "
            f"they may differ by {arcs.allowed[bad[i]]:.3g} mm"
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
    p = blocks.letters["P"]
    turns = np.where(p.given[rows], p.value[rows], 1.0)
    blocks.faults.add(
        p.word[rows[(turns < 1.0) | (turns != np.rint(turns))]],
        "the turns of an arc must be a whole number of at least 1",
    )
    blocks.faults.add(p.word[rows[turns > _MAX_TURNS]], f"at most {_MAX_TURNS} turns are read of one arc")
    return arcs.centre, arcs.sweep + np.copysign(2.0 * np.pi * (turns - 1.0), arcs.sweep)
