"""Where two blocks meet: exact stop, cubic corner, tube or nothing at all.

| junction | becomes |
|---|---|
| demanded by the program, beside a rapid, or a turn of more than 150 degrees | exact stop |
| a turn of more than 21 degrees | cubic corner; smaller where the blocks are too short for it |
| up to 45 degrees, and the blocks far too short for the corner | tube |
| a smaller turn, or a jump of curvature | tube |
| a corner too small to be worth passing | exact stop |
| where the feed begins to be measured along other axes | cubic corner, or exact stop |
| neither | nothing: the blocks go on smoothly |

A cubic corner of size A passes the vertex at A |t2 - t1| and takes 8 A of either block.  A corner between lines keeps the
tolerance by construction; where an arc begins or ends, the deviation is measured and A reduced.

Corner or stop.  Under a jerk J alone the corner is passed at the constant rate (J / 6A)^(1/3) of its parameter: one axis
comes to rest and the other leaves it, overlapping, and against an exact stop, where they follow each other, that saves the
time of the passage,

    t = 2 (6 A / J)^(1/3).

A leg of length L takes at least 4 (L / 2J)^(1/3) from rest to rest, so of it the corner saves at most the share

    t / T = 12^(1/3) / 2 (A / L)^(1/3) = 1.14 (A / L)^(1/3),

whatever the jerk.  Samples and knots crowd around the corner, so that it is resolved down to A / L = 1e-7: at 90 degrees,
between legs of 10 and 100 mm, the plan saves 0.7 to 1 of 2 (6 A / J)^(1/3), at wider turns more, and at 30 degrees and
A / L = 2e-7 it costs 0.03 % at worst.  Below, of the smaller corner against the longer of its blocks, the path stops: the
digits of a path are no longer enough for the corner, and what is given up is a share below 1.14 (1e-7)^(1/3) = 0.53 % of a
leg that is all jerk, and less of a longer one.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from planner.geometry.blend import BLEND_REACH, Blends, Legs
from planner.geometry.differential import curvature_vector, norm
from planner.programs.path.deviation import Programmed
from planner.types import FloatArray

MAX_TURN = np.deg2rad(150.0)
CORNER_TURN = np.deg2rad(21.0)  # no round number, on which the last digit of an angle would decide
SHARP_TURN = np.deg2rad(45.0)
# A corner that keeps less of its size than this is left to the tube, where it is not sharp.
_WORTH_SHRINKING = 0.5
# Neighbouring corners leave a remainder of the block between them, which keeps every piece of the path a length.
SHARE_OF_BLOCK = 0.499
_SMALLEST = 1e-7  # size of a corner against the longer block, see above
_WITHIN = 1.0 - 1e-9  # of the tolerance: rounding must not carry a corner beyond it
_SMOOTH_TURN = 1e-9  # rad
_SMOOTH_BEND = 1e-9  # relative jump of curvature, against curvature or 1 / length
_SHRINK, _MAX_SHRINKS = 0.9, 40
_PROBES = 33


class Junction(IntEnum):
    """What a junction becomes."""

    SMOOTH = 0
    TUBE = 1
    CORNER = 2
    STOP = 3


@dataclass(frozen=True, eq=False)
class Junctions:
    """Junctions between consecutive blocks, m - 1 of them.

    Attributes
    ----------
    kind : (m - 1,) int array
        A :class:`Junction` each.
    turn : (m - 1,) array
        Angle between the tangents, rad.
    bend : (m - 1,) array
        Jump of the curvature vector, 1/mm.
    size : (m - 1,) array
        A of the corners, mm; 0 elsewhere.
    """

    kind: NDArray[np.int8]
    turn: FloatArray
    bend: FloatArray
    size: FloatArray

    @property
    def reach(self) -> FloatArray:
        """How much of either block the corners take, mm."""
        return BLEND_REACH * self.size


def classify(
    programmed: Programmed,
    tolerance: FloatArray,
    stop: NDArray[np.bool_],
    room: FloatArray | None = None,
    apart: NDArray[np.bool_] | None = None,
) -> Junctions:
    """Decide what every junction becomes.

    Parameters
    ----------
    programmed : Programmed
        The blocks, m of them.
    tolerance : (m,) array
        Of each block, mm; the smaller of two counts at their junction, and none is a stop.
    stop : (m - 1,) bool array
        Stops that the program demands.
    room : (m - 1,) array, optional
        How far corners may pass from their vertices, mm, in place of the tolerance.
    apart : (m - 1,) bool array, optional
        Junctions that no tube may pass, whatever their turn: the feed is measured along other axes from there on.
    """
    edges, length = programmed.edges, np.diff(programmed.edges)
    before, after = (tangents(programmed, edges[1:-1], left=left) for left in (True, False))
    chord = np.sqrt(np.sum((after[0] - before[0]) ** 2, axis=1))
    turn = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    bend = np.sqrt(np.sum((after[1] - before[1]) ** 2, axis=1))
    largest = np.maximum(*(np.sqrt(np.sum(part[1] ** 2, axis=1)) for part in (before, after)))
    allowed = np.minimum(tolerance[:-1], tolerance[1:])
    bent = bend > _SMOOTH_BEND * np.maximum(largest, 1.0 / np.minimum(length[:-1], length[1:]))
    kind = np.where((turn > _SMOOTH_TURN) | bent, Junction.TUBE, Junction.SMOOTH).astype(np.int8)
    apart = np.zeros(turn.size, dtype=np.bool_) if apart is None else apart
    kind[(turn > CORNER_TURN) | apart] = Junction.CORNER
    kind[stop | (turn > MAX_TURN)] = Junction.STOP
    kind[(allowed <= 0.0) & (kind != Junction.SMOOTH)] = Junction.STOP
    # Where the exact mode begins or ends, a tube must not lead on, however straight the program goes on.
    kind[(tolerance[:-1] <= 0.0) != (tolerance[1:] <= 0.0)] = Junction.STOP
    room = allowed if room is None else room
    size = np.zeros(turn.size)
    longer = np.maximum(length[:-1], length[1:])
    for _ in range(3):  # a corner left to the tube, or to a stop, gives room to its neighbours
        corner = kind == Junction.CORNER
        full = _WITHIN * room[corner] / chord[corner]
        whole = np.concatenate([[False], corner, [False]])
        space = length * np.where(whole[:-1] & whole[1:], SHARE_OF_BLOCK, 2.0 * SHARE_OF_BLOCK)
        tubes = np.concatenate([[False], kind == Junction.TUBE, [False]])
        space = np.where(tubes[:-1] | tubes[1:], np.minimum(space, SHARE_OF_BLOCK * length), space)
        fits = np.minimum(space[:-1], space[1:])[corner] / BLEND_REACH
        size[:] = 0.0
        size[corner] = np.minimum(full, fits)
        weak = (fits < _WORTH_SHRINKING * full) & (turn[corner] <= SHARP_TURN) & ~apart[corner]
        kind[np.flatnonzero(corner)[weak]] = Junction.TUBE
        kind[(kind == Junction.CORNER) & (size < _SMALLEST * longer)] = Junction.STOP
        size[kind != Junction.CORNER] = 0.0
    junctions = Junctions(kind, turn, bend, size)
    _fit_to_arcs(programmed, junctions, room)
    return junctions


def tangent_jumps(programmed: Programmed) -> FloatArray:
    """|t2 - t1| at the junctions, (m - 1,)."""
    before, after = (tangents(programmed, programmed.edges[1:-1], left=left)[0] for left in (True, False))
    return np.asarray(np.sqrt(np.sum((after - before) ** 2, axis=1)))


def tangents(programmed: Programmed, s: FloatArray, *, left: bool) -> tuple[FloatArray, FloatArray]:
    """Unit tangents and curvature vectors (n, dim)."""
    d = programmed.at(s, left=left)
    return d[1] / norm(d[1])[:, None], curvature_vector(d)


def blends_at(
    programmed: Programmed,
    junctions: Junctions,
    at: NDArray[np.intp],
    columns: tuple[Legs, FloatArray] | None = None,
) -> Blends:
    """The blends of the corners ``at``, of other columns of the blocks where these are given with their weights."""
    length = np.diff(programmed.edges)
    legs, weight = (programmed.legs, None) if columns is None else columns
    before = legs.taken(at).from_point(length[at], backwards=True)
    after = legs.taken(at + 1).from_point(np.zeros(at.size), backwards=False)
    return Blends.between(before, after, junctions.size[at], weight)


def _fit_to_arcs(programmed: Programmed, junctions: Junctions, allowed: FloatArray) -> None:
    """Reduce the corners beside arcs until they keep the tolerance."""
    curved = programmed.legs.curved
    at = np.flatnonzero((junctions.kind == Junction.CORNER) & (curved[:-1] | curved[1:]))
    for _ in range(_MAX_SHRINKS):
        if at.size == 0:
            return
        blends = blends_at(programmed, junctions, at)
        tau = np.linspace(-1.0, 1.0, _PROBES)
        row = np.repeat(np.arange(at.size), _PROBES)
        points = blends.at(row, np.tile(tau, at.size))[0]
        reach, corner = junctions.reach[at], programmed.edges[1:-1][at]
        s = (corner[:, None] + reach[:, None] * tau).reshape(-1)
        away = programmed.distance(points, s, np.repeat(2.0 * reach, _PROBES)).reshape(-1, _PROBES).max(axis=1)
        middle = points.reshape(at.size, _PROBES, -1)[:, _PROBES // 2]
        away = np.maximum(away, np.sqrt(np.sum((middle - programmed.at(corner)[0]) ** 2, axis=1)))
        at = at[away > _WITHIN * allowed[at]]
        junctions.size[at] *= _SHRINK
