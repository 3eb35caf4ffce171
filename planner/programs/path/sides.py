"""To which side of a programmed contour its path may leave it, where that is one side alone.

The plane is that of the first two linear axes that move.  ``left`` and ``right`` are those of the motion, of every block
that is no rapid and moves in the plane.  ``inside`` and ``outside`` are those of a closed contour: blocks one after the
other, without a rapid or a move across the plane between, that end where they began and turn once in all.  Where that is
to the left, counter-clockwise, the inside is on the left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.tolerance import PathSide
from planner.programs.path.deviation import Programmed
from planner.programs.path.moves import MovingBlocks
from planner.types import BoolArray, FloatArray, IntArray

ALLOWED_OVERCUT = 1e-3  # of the tolerance
_LINEAR = ("X", "Y", "Z")
_LEAST = 1e-9  # of a block's length: what counts as moving in the plane
_TURNS_BACK = np.deg2rad(179.9)
_ONCE = 1e-3  # rad, by which the whole turn may be off a full one
_PER_BLOCK = 32  # chords of a block, for its turn
_PER_PIECE = 24  # places between two nodes at which the overcut is looked at
_REACH = 8.0  # tolerances along the blocks within which the nearest point is searched, beside a piece


@dataclass(frozen=True, eq=False)
class Contour:
    """Blocks from ``first`` on to before ``last`` that belong together, and whether they end where they began."""

    first: int
    last: int
    closed: bool


@dataclass(frozen=True, eq=False)
class AllowedSides:
    """The allowed side of every block.

    Attributes
    ----------
    allowed : (m,) int8 array
        1 for the left, -1 for the right; 0 where the block has none: rapids, and moves across the plane.
    plane : (int, int)
        Columns of its axes.
    contours : list of Contour
    """

    allowed: NDArray[np.int8]
    plane: tuple[int, int]
    contours: list[Contour]

    def cut(self, blocks: MovingBlocks) -> MovingBlocks:
        """The blocks, with a stop wherever those with a side begin or end."""
        return replace(blocks, stop=blocks.stop | ((self.allowed[1:] != 0) != (self.allowed[:-1] != 0)))


def sides_of(blocks: MovingBlocks, side: PathSide, line: IntArray, source: str) -> AllowedSides:
    """Find the allowed sides; ``line`` are the numbers of the blocks' lines.

    Raises InputError where a contour has no inside, or two linear axes do not move.
    """
    columns = [k for k, name in enumerate(blocks.axes) if name in _LINEAR]
    if len(columns) < 2:
        raise InputError(f"{source}: side = {side!r} needs two linear axes that move, not {', '.join(blocks.axes)}")
    plane = columns[0], columns[1]
    programmed, count = blocks.programmed, blocks.row.size
    length = np.diff(programmed.edges)
    rows = np.arange(count)
    rates = [programmed.legs.at(rows, share * length)[1][:, plane] for share in (0.0, 1.0)]
    moves = np.sqrt(np.minimum(*(np.sum(rate**2, axis=1) for rate in rates))) > _LEAST
    cutting = moves & ~blocks.rapid
    contours = [_contour(blocks, plane, int(a), int(b)) for a, b in _stretches(cutting)]
    allowed = np.zeros(count, dtype=np.int8)
    for contour in contours:
        some = slice(contour.first, contour.last)
        if side in ("left", "right"):
            allowed[some] = 1 if side == "left" else -1
        else:
            turn = _turn(blocks, plane, contour, side, line, source)
            allowed[some] = np.sign(turn) * (1 if side == "inside" else -1)
    return AllowedSides(allowed, plane, contours)


def _stretches(cutting: BoolArray) -> IntArray:
    """First blocks of stretches, and those after their last, (k, 2)."""
    change = np.diff(np.concatenate([[False], cutting, [False]]).astype(np.int8))
    return np.column_stack([np.flatnonzero(change > 0), np.flatnonzero(change < 0)])


def _contour(blocks: MovingBlocks, plane: tuple[int, int], first: int, last: int) -> Contour:
    ends = blocks.programmed.at(blocks.programmed.edges[[first, last]], left=False)[0]
    ends[1] = blocks.programmed.at(blocks.programmed.edges[[last]], left=True)[0][0]
    gap = np.sqrt(np.sum((ends[1] - ends[0])[list(plane)] ** 2))
    return Contour(first, last, bool(gap <= max(1e-6, min(blocks.tolerance[first], blocks.tolerance[last - 1]))))


def _turn(
    blocks: MovingBlocks, plane: tuple[int, int], contour: Contour, side: str, line: IntArray, source: str
) -> float:
    """By how much a closed contour turns in all: a full turn either way, rad."""
    lines = f"lines {line[contour.first]} to {line[contour.last - 1]}"
    other = "make it closed, or give side = left or right, which every contour has"
    if not contour.closed:
        raise InputError(
            f"{source}: {lines} do not end where they begin, and have no {side}; {other} (a lead-in or lead-out by a rapid "
            "or a move across the plane is none of it)"
        )
    rows = np.repeat(np.arange(contour.first, contour.last), _PER_BLOCK + 1)
    length = np.diff(blocks.programmed.edges)[rows]
    share = np.tile(np.arange(_PER_BLOCK + 1) / _PER_BLOCK, contour.last - contour.first)
    rate = blocks.programmed.legs.at(rows, share * length)[1][:, plane]
    angle = np.arctan2(rate[:, 1], rate[:, 0])
    turns = np.mod(np.diff(angle, append=angle[0]) + np.pi, 2.0 * np.pi) - np.pi
    back = np.flatnonzero(np.abs(turns) > _TURNS_BACK)
    if back.size:
        after = line[rows[back[0]]]
        raise InputError(f"{source}: after line {after} the contour turns back, and has no {side}; {other}")
    turn = float(turns.sum())
    if abs(abs(turn) - 2.0 * np.pi) > _ONCE:
        raise InputError(
            f"{source}: {lines} turn by {np.rad2deg(turn):.4g} degrees in all, where a contour with an {side} turns by 360; "
            "give side = left or right, which every contour has"
        )
    return turn


def overcut(sides: AllowedSides, programmed: Programmed, points: FloatArray, s: FloatArray, tolerance: float) -> float:
    """How far points (k, d) that belong to abscissae s lie on the side of the blocks that is not allowed, mm.

    A point lies on the side of the nearest point of its contour; beside a vertex that of both blocks together.
    """
    block = np.clip(np.searchsorted(programmed.edges, s, side="right") - 1, 0, sides.allowed.size - 1)
    largest = 0.0
    for contour in sides.contours:
        on = (block >= contour.first) & (block < contour.last)
        if sides.allowed[contour.first] and on.any():
            away = _signed(contour, programmed, sides.plane, points[on][:, sides.plane], s[on], _REACH * tolerance)
            largest = max(largest, float((-sides.allowed[contour.first] * away).max()))
    return largest


def _signed(
    contour: Contour, programmed: Programmed, plane: tuple[int, int], points: FloatArray, s: FloatArray, reach: float
) -> FloatArray:
    """Distance in the plane from the nearest point of a contour, positive on its left."""
    edges = programmed.edges[contour.first : contour.last + 1]
    count, total = edges.size - 1, edges[-1] - edges[0]
    laps = (-1, 0, 1) if contour.closed else (0,)
    begins = np.concatenate([edges[:-1] + lap * total for lap in laps])
    shift = count if contour.closed else 0
    low = np.clip(np.searchsorted(begins, s - reach, side="right") - 1, 0, begins.size - 1)
    high = np.clip(np.searchsorted(begins, s + reach, side="right") - 1, 0, begins.size - 1)
    best, signed = np.full(s.size, np.inf), np.zeros(s.size)
    for step in range(int((high - low).max()) + 1):
        on = np.flatnonzero(low + step <= high)
        number = (low[on] + step - shift) % count
        foot, normal = _foot(contour, programmed, plane, number, points[on])
        away = points[on] - foot
        distance = np.sqrt(np.sum(away**2, axis=1))
        nearer = distance < best[on]
        at = on[nearer]
        best[at] = distance[nearer]
        signed[at] = distance[nearer] * np.sign(np.sum(away * normal, axis=1))[nearer]
    return signed


def _foot(
    contour: Contour, programmed: Programmed, plane: tuple[int, int], number: IntArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The nearest points of blocks of a contour, and their normals to the left; beside a vertex those of both blocks."""
    count = contour.last - contour.first
    row, legs = contour.first + number, programmed.legs
    length = np.diff(programmed.edges)
    origin, first, second, along = (legs.vectors[row, k][:, plane] for k in range(4))
    away = points - origin
    x = np.sum(away * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-300)
    rate = legs.rates[row, 0]
    bent = rate != 0.0
    if bent.any():
        angle = np.arctan2(np.sum(away * second, axis=1), np.sum(away * first, axis=1))[bent]
        turn = 2.0 * np.pi / np.abs(rate[bent])
        middle = 0.5 * length[row[bent]]
        x[bent] = angle / rate[bent]
        x[bent] += turn * np.round((middle - x[bent]) / turn)
    x = np.clip(x, 0.0, length[row])
    place = legs.at(row, x)

    def left_of(rates: FloatArray) -> FloatArray:
        flat = rates[:, plane]
        size = np.sqrt(np.sum(flat**2, axis=1))[:, None]
        return np.asarray(np.column_stack([-flat[:, 1], flat[:, 0]]) / size)

    normal = left_of(place[1])
    for at_end, step in ((x >= length[row], 1), (x <= 0.0, -1)):
        other = number + step
        ends = at_end & (contour.closed | ((other >= 0) & (other < count)))
        beside = contour.first + other[ends] % count
        normal[ends] += left_of(legs.at(beside, (step < 0) * length[beside])[1])
    return place[0][:, plane], normal


def samples(edges: FloatArray) -> FloatArray:
    """Places between neighbouring edges, and these."""
    inner = edges[:-1, None] + np.diff(edges)[:, None] * (np.arange(_PER_PIECE) / _PER_PIECE)
    return np.append(inner.reshape(-1), edges[-1])
