"""The moves of a part program as legs: what the path, its parts and the measure of their deviation are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import CurveError
from planner.geometry.blend import Legs
from planner.geometry.tolerance import DEFAULT_TOLERANCE
from planner.programs.path.deviation import Programmed
from planner.programs.reading.program import ARC, AXES, RAPID, Program
from planner.types import FloatArray


@dataclass(frozen=True, eq=False)
class MovingBlocks:
    """The blocks that move, in the axes that move: rows of the program with a length."""

    row: NDArray[np.intp]
    axes: tuple[str, ...]
    programmed: Programmed
    tolerance: FloatArray
    feed: FloatArray
    rapid: NDArray[np.bool_]
    stop: NDArray[np.bool_]

    @classmethod
    def of(cls, program: Program, tolerance: float | None, moves: NDArray[np.bool_] | None = None) -> MovingBlocks:
        """Take the moves as legs, in the axes that move or those of ``moves`` (3,)."""
        row = np.flatnonzero(program.lengths > 0.0)
        if not row.size:
            raise CurveError(
                f"{program.source}: the program moves nothing, in the digits of its numbers; a path needs a move"
            )
        moves = moving_axes(program) if moves is None else moves
        legs, length = _legs(program, row, moves)
        edges = np.concatenate([[0.0], np.cumsum(length)])
        given = program.tolerance[row]
        own = np.where(np.isnan(given), DEFAULT_TOLERANCE, given)
        if tolerance is not None:
            own = np.where(given == 0.0, 0.0, tolerance)
        rapid = program.kind[row] == RAPID
        halts = np.concatenate([[0], np.cumsum(program.stop_after)])
        # a stop between two moves that stay counts, also after a move of length 0
        stop = (halts[row[1:]] > halts[row[:-1]]) | rapid[:-1] | rapid[1:]
        axes = tuple(name for name, moving in zip(AXES, moves, strict=True) if moving)
        return cls(row, axes, Programmed(edges, legs), own, program.feed[row], rapid, stop)


def moving_axes(program: Program) -> NDArray[np.bool_]:
    """Which of X, Y and Z move, (3,); at least two, since a path has two axes or more."""
    moves = np.maximum(program.start.max(axis=0), program.end.max(axis=0)) > np.minimum(
        program.start.min(axis=0), program.end.min(axis=0)
    )
    arcs = program.kind == ARC
    moves[np.unique((program.normal[arcs][:, None] + np.array([1, 2])) % 3)] = True
    if moves.sum() < 2:
        moves[[k for k in range(3) if not moves[k]][: 2 - int(moves.sum())]] = True
    return np.asarray(moves)


def _legs(program: Program, row: NDArray[np.intp], moves: NDArray[np.bool_]) -> tuple[Legs, FloatArray]:
    """Legs of the moves ``row`` in the axes that move, and their lengths."""
    start, end = program.start[row], program.end[row]
    length = program.lengths[row].copy()
    vectors, rates = np.zeros((row.size, 4, 3)), np.zeros((row.size, 2))
    vectors[:, 0] = start
    vectors[:, 3] = (end - start) / length[:, None]
    on = np.flatnonzero(program.kind[row] == ARC)
    if on.size:
        index = row[on]
        normal = np.eye(3)[program.normal[index]]
        spoke, last = start[on] - program.centre[index], end[on] - program.centre[index]
        spoke -= normal * np.sum(spoke * normal, axis=1)[:, None]
        last -= normal * np.sum(last * normal, axis=1)[:, None]
        radius, final = (np.sqrt(np.sum(part**2, axis=1)) for part in (spoke, last))
        vectors[on, 0] = start[on] - spoke
        vectors[on, 1] = spoke
        vectors[on, 2] = np.cross(normal, spoke)
        vectors[on, 3] = normal * (np.sum((end[on] - start[on]) * normal, axis=1) / length[on])[:, None]
        rates[on, 0] = program.sweep[index] / length[on]
        rates[on, 1] = np.where(np.abs(final - radius) > 1e-12 * radius, (final / radius - 1.0) / length[on], 0.0)
    return Legs(np.ascontiguousarray(vectors[:, :, moves]), rates), length
