"""Splines as moves: G5 and G5.1, a block each, and the NURBS of several blocks (``nurbs_blocks``).

    G5 X Y I J P Q   cubic: start, start + (I, J), end + (P, Q), end; without I J the last P Q turned round
    G5.1 X Y I J     quadratic: start, start + (I, J), end

Each becomes its rational Bezier pieces, from knot to knot: exact, and a move each (``beziers``).  A spline all whose
control points lie in order on one line is that line.  What has no tangent somewhere, a cusp, or a handle I J or P Q of
length 0 beside a bend, is refused: no feed passes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.geometry.bezier import Beziers
from planner.geometry.nurbs import NurbsCurve
from planner.programs.reading.blocks import Blocks
from planner.programs.reading.language import (
    AXIS_LETTERS,
    CUBIC,
    MOTION,
    NURBS_BEGIN,
    NURBS_END,
    NURBS_KNOTS,
    PLANE,
    QUADRATIC,
)
from planner.programs.reading.positions import NURBS, NurbsMove, ProgramTrack
from planner.programs.reading.program import LINE, RAPID, SPLINE, ZERO_LENGTH_MM
from planner.programs.reading.words import LineArray, Mask
from planner.types import FloatArray

_MIN_RADIUS_MM = 1e-9  # of curvature: below, a turn is a cusp but for the digits of its handles
_STRAIGHT_MM = 1e-9  # away from their line, of control points: rounding
# From control points to powers of w.
_POWERS = {
    2: np.array([[1.0, 0.0, 0.0], [-2.0, 2.0, 0.0], [1.0, -2.0, 1.0]]),
    3: np.array([[1.0, 0.0, 0.0, 0.0], [-3.0, 3.0, 0.0, 0.0], [3.0, -6.0, 3.0, 0.0], [-1.0, 3.0, -3.0, 1.0]]),
}


@dataclass(frozen=True, eq=False)
class SplinePieces:
    """The pieces of splines, and to which move of a part and which line of the file each belongs, (k,), in their order."""

    beziers: Beziers
    move: NDArray[np.intp]
    line: LineArray

    def lengths(self) -> tuple[NDArray[np.intp], FloatArray]:
        """The moves, each once, and their lengths, mm."""
        moves, index = np.unique(self.move, return_inverse=True)
        return moves, np.asarray(np.bincount(index, self.beziers.length), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Polygon:
    """Powers (k, 4, terms) of pieces from the points ``start`` (k, 3), and to which move and line each belongs."""

    move: LineArray
    line: LineArray
    start: FloatArray
    powers: FloatArray


def spline_kinds(blocks: Blocks, active: LineArray, kind: LineArray, ends: Mask) -> None:
    """Mark the blocks of splines in ``kind``, and refuse those of G5 and G5.1 that lack a word."""
    faults, word = blocks.faults, blocks.g[MOTION]
    one = np.isin(active, (CUBIC, QUADRATIC))
    kind[one & ends] = SPLINE
    faults.add(word.at(one & ~ends), "a spline needs its end X Y")
    several = np.isin(active, (NURBS_BEGIN, NURBS_KNOTS)) & (word.given | ends | blocks.any_of("PLKR"))
    several |= word.has(NURBS_END)
    for group in (*blocks.g, *blocks.m):
        if group is not word:
            several &= ~group.given
    kind[several] = NURBS
    if not one.any():
        return
    i, j, p, q = (blocks.letters[name].given for name in "IJPQ")
    both = one & ends & (i != j)
    faults.add(blocks.first_of("IJ", both & (i | j)), "needs I and J, or with G5 neither")
    first = np.where(word.given, word.word, blocks.first)
    faults.add(first[(active == QUADRATIC) & ends & ~i & ~j], "needs the handle I J")
    faults.add(first[(active == CUBIC) & ends & ~(p & q)], "needs the handle P Q at its end")


def check_splines(blocks: Blocks, modal: dict[int, LineArray], kind: LineArray) -> None:
    """Rules on blocks of splines: their plane, and axes that they do not move."""
    flat = np.isin(modal[MOTION], (CUBIC, QUADRATIC, NURBS_BEGIN)) & (kind >= RAPID)
    if not flat.any():
        return
    word = np.where(blocks.g[MOTION].given, blocks.g[MOTION].word, blocks.first)
    blocks.faults.add(word[flat & (modal[PLANE] != 170)], "a spline lies in the plane XY, G17")
    for name in AXIS_LETTERS[2:]:
        blocks.faults.add(blocks.letters[name].at(flat), f"a spline moves X and Y; move {name} in a block of its own")


def spline_moves(
    track: ProgramTrack, moves: tuple[LineArray, LineArray, FloatArray, FloatArray], of_nurbs: LineArray
) -> SplinePieces | None:
    """The pieces of all splines, None where there are none.

    Parameters
    ----------
    moves : tuple
        Block (n,), kind (n,), start and end (n, 3) of every move; a spline that is a line becomes one in ``kind``.
    of_nurbs : (n,) int array
        Which of ``track.nurbs`` a move is, or -1.
    """
    rows, kind, start, _ = moves
    on = np.flatnonzero(kind == SPLINE)
    if not on.size:
        if (track.kind >= RAPID).any():
            track.state.handle[:] = np.nan
        return None
    polygons = _handles(track, on[of_nurbs[on] < 0], moves)
    for k in on[of_nurbs[on] >= 0].tolist():
        polygons += _pieces_of_nurbs(track, track.nurbs[int(of_nurbs[k])], k, start[k], kind)
    polygons = [polygon for polygon in polygons if polygon.move.size]
    if not polygons:
        return None
    terms = max(polygon.powers.shape[2] for polygon in polygons)
    powers = [np.pad(one.powers, ((0, 0), (0, 0), (0, terms - one.powers.shape[2]))) for one in polygons]
    move, line, begin = (np.concatenate([getattr(one, name) for one in polygons]) for name in ("move", "line", "start"))
    order = np.argsort(move, kind="stable")
    beziers, of = Beziers.of_powers(begin[order], np.concatenate(powers)[order])
    move, line = move[order][of], line[order][of]
    _refuse_cusps(track, beziers, rows[move])
    return SplinePieces(beziers, move, line)


def _handles(
    track: ProgramTrack, on: LineArray, moves: tuple[LineArray, LineArray, FloatArray, FloatArray]
) -> list[_Polygon]:
    """G5 and G5.1."""
    blocks, (rows, kind, start, end) = track.blocks, moves
    out = []
    first, last = _handle(track, "IJ"), _handle(track, "PQ")
    _continue_handles(track, first, last)
    for code, degree in ((QUADRATIC, 2), (CUBIC, 3)):
        some = on[track.modal[MOTION][rows[on]] == code]
        points = [start[some], start[some] + first[rows[some]]]
        points += [end[some] + last[rows[some]]] * (code == CUBIC) + [end[some]]
        control = np.stack(points, axis=1)
        shape = _shapes(control)
        _refuse_empty(track, rows[some[shape == _EMPTY]])
        kind[some[shape == _LINE]] = LINE
        bent = shape == _BENT
        out.append(_polygon(some[bent], blocks.line[rows[some[bent]]], control[bent], degree))
    return out


def _handle(track: ProgramTrack, letters: str) -> FloatArray:
    """A handle along X and Y at every block, (n, 3), mm; nan where it is not given."""
    out = np.zeros((track.kind.size, 3))
    for axis, name in enumerate(letters):
        column = track.blocks.letters[name]
        out[:, axis] = np.where(column.given, column.value * track.unit, np.nan)
    return out


def _continue_handles(track: ProgramTrack, first: FloatArray, last: FloatArray) -> None:
    """Without I J a G5 goes on as the G5 before it ended; ``first`` is completed in place."""
    state, blocks = track.state, track.blocks
    rows = np.flatnonzero(track.kind >= RAPID)
    cubic = (track.kind[rows] == SPLINE) & (track.modal[MOTION][rows] == CUBIC)
    ends = np.where(cubic[:, None], -last[rows], np.nan)
    before = np.concatenate([state.handle[None], ends[:-1]])
    state.handle = ends[-1].copy()
    lacking = cubic & np.isnan(first[rows, :2]).all(axis=1)
    first[rows[lacking]] = before[lacking]
    lost = rows[lacking & np.isnan(before[:, 0])]
    word = np.where(blocks.g[MOTION].given, blocks.g[MOTION].word, blocks.first)
    blocks.faults.add(word[lost], "needs I J: the move before it is no G5 with whose P Q it could go on")
    for handle in (first, last):  # what is lacking is refused already
        np.nan_to_num(handle, copy=False)


def _polygon(move: LineArray, line: LineArray, control: FloatArray, degree: int) -> _Polygon:
    """Powers of Bezier curves from their control points (k, degree + 1, 3)."""
    ways = np.einsum("ij,kjd->kdi", _POWERS[degree], control - control[:, :1])
    bottom = np.zeros((move.size, 1, degree + 1))
    bottom[:, 0, 0] = 1.0
    return _Polygon(move, line, control[:, 0], np.concatenate([ways, bottom], axis=1))


_EMPTY, _LINE, _BENT = range(3)


def _shapes(control: FloatArray) -> LineArray:
    """Whether control points (k, n, 3) are one point, lie in order on a line, or neither, (k,)."""
    way = control - control[:, :1]
    chord = way[:, -1]
    square = np.sum(chord**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.einsum("knd,kd->kn", way, chord) / square[:, None]
        away = np.sqrt(np.sum((way - along[:, :, None] * chord[:, None]) ** 2, axis=2)).max(axis=1)
        straight = (away <= _STRAIGHT_MM) & (np.diff(along, axis=1) >= 0.0).all(axis=1)
    straight &= square > ZERO_LENGTH_MM**2
    empty = np.sqrt(np.sum(way**2, axis=2)).max(axis=1) < ZERO_LENGTH_MM
    return np.where(empty, _EMPTY, np.where(straight, _LINE, _BENT))


def _pieces_of_nurbs(
    track: ProgramTrack, move: NurbsMove, index: int, start: FloatArray, kind: LineArray
) -> list[_Polygon]:
    """The pieces of a NURBS between its knots, each with the line of the last control point that shapes it."""
    control = move.control.copy()
    control[0] = start
    shape = int(_shapes(control[None])[0])
    if shape == _EMPTY:
        _refuse_empty(track, np.array([move.row]))
    if shape != _BENT:
        kind[index] = LINE
        return []
    curve = NurbsCurve(control - start, move.knots, move.degree, move.weights, rests_allowed=True)
    pieces = curve.pieces
    count = pieces.breaks.size - 1
    ways = pieces.coefficients[:, :-1].copy()
    bottom = pieces.coefficients[:, -1:]
    own = ways[:, :, :1] / bottom[:, :, :1]
    ways -= own * bottom
    ways[:, :, 0] = 0.0
    begin = np.tile(control[0], (count, 1))
    begin += pieces.origin + own[:, :, 0]
    powers = np.concatenate([ways, bottom], axis=1)
    span = np.searchsorted(move.knots, pieces.breaks[:-1], side="right") - 1
    return [_Polygon(np.full(count, index), np.array(move.lines)[span], begin, powers)]


def _refuse_empty(track: ProgramTrack, rows: LineArray) -> None:
    word = np.where(track.blocks.g[MOTION].given, track.blocks.g[MOTION].word, track.blocks.first)
    track.blocks.faults.add(word[rows], "the spline has no length: its control points are one point")


def _refuse_cusps(track: ProgramTrack, beziers: Beziers, rows: LineArray) -> None:
    """Refuse curves without a tangent or with a turn too tight to be one."""
    bad = np.flatnonzero(beziers.tightest < _MIN_RADIUS_MM)
    word = np.where(track.blocks.g[MOTION].given, track.blocks.g[MOTION].word, track.blocks.first)

    def reason(i: int) -> str:
        x, y = beziers.tightest_point(int(bad[i]))[:2] - track.state.offsets.total[:2]
        return (
            f"has a cusp near X{x:.6g} Y{y:.6g} (mm): its curvature is infinite and "
            "no feed passes it; give every handle a length, or split the spline there"
        )

    track.blocks.faults.add(word[rows[bad]], reason)
