"""The moves of a part program as legs: what the path, its parts and the measure of their deviation are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import CurveError, InputError
from planner.geometry.blend import Legs
from planner.geometry.curve import AXES
from planner.geometry.tolerance import DEFAULT_TOLERANCE
from planner.programs.path.deviation import Programmed
from planner.programs.reading.program import ARC, RAPID, Program
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
        if moves[3:].any():
            axis = 3 + int(np.argmax(moves[3:]))
            line = int(program.axis_lines[axis])
            raise InputError(f"{program.source}:{line}: {AXES[axis]}: moves of X, Y and Z alone are planned so far")
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
    """Legs of the moves ``row`` in the axes that move, and their lengths, for which a degree counts as a mm."""
    columns = np.flatnonzero(moves)
    start, end = program.start[row][:, columns], program.end[row][:, columns]
    length = np.sqrt(np.sum((end - start) ** 2, axis=1))
    arc = np.flatnonzero(program.kind[row] == ARC)
    if arc.size:
        others = np.sum((end - start)[arc][:, columns > 2] ** 2, axis=1)
        along = program.lengths[row[arc]]
        length[arc] = np.where(others > 0.0, np.sqrt(along**2 + others), along)
    vectors, rates = np.zeros((row.size, 4, columns.size)), np.zeros((row.size, 2))
    vectors[:, 0] = start
    vectors[:, 3] = (end - start) / length[:, None]
    if arc.size:
        bent, rates[arc] = _arcs(program, row[arc], length[arc])
        xyz = columns[columns < 3]
        vectors[arc, :, : xyz.size] = bent[:, :, xyz]
    return Legs(vectors, rates), length


def _arcs(program: Program, row: NDArray[np.intp], length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Vectors (n, 4, 3) in X Y Z and rates (n, 2) of the arcs ``row`` of these lengths (n,)."""
    start, end, centre = program.start[row, :3], program.end[row, :3], program.centre[row]
    normal = np.eye(3)[program.normal[row]]
    spoke, last = start - centre, end - centre
    spoke -= normal * np.sum(spoke * normal, axis=1)[:, None]
    last -= normal * np.sum(last * normal, axis=1)[:, None]
    radius, final = (np.sqrt(np.sum(part**2, axis=1)) for part in (spoke, last))
    climb = normal * (np.sum((end - start) * normal, axis=1) / length)[:, None]
    vectors = np.stack([start - spoke, spoke, np.cross(normal, spoke), climb], axis=1)
    growth = np.where(np.abs(final - radius) > 1e-12 * radius, (final / radius - 1.0) / length, 0.0)
    return vectors, np.stack([program.sweep[row] / length, growth], axis=1)
