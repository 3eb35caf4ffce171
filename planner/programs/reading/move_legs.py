"""The moves of a part program as legs: lines, arcs, helices, spirals and stretches of splines, by their length."""

from __future__ import annotations

import numpy as np

from planner.geometry.blend import Legs
from planner.programs.reading.program import ARC, SPLINE, Program
from planner.types import BoolArray, FloatArray, IntArray


def legs_of_moves(program: Program, row: IntArray, moves: BoolArray) -> tuple[Legs, FloatArray]:
    """Make legs of some moves.

    Parameters
    ----------
    program : Program
    row : (n,) int array
        Moves with a length.
    moves : (9,) bool array
        The axes that the legs have as columns.

    Returns
    -------
    Legs
        In mm and degrees.
    length : (n,) array
        Of each, for which a degree counts as a mm.
    """
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
    if program.beziers is None:
        return Legs(vectors, rates), length
    on = np.flatnonzero(program.kind[row] == SPLINE)
    curve = program.curve[row[on]]
    ways = np.tile([-1.0, 0.0, 1.0], (row.size, 1))
    ways[on, 0], length[on] = curve, program.beziers.length[curve]
    rest = np.zeros((len(program.beziers), columns.size))
    rest[curve] = start[on]
    beziers = program.beziers.in_axes(columns, rest)
    vectors[on] = 0.0
    vectors[on, 0] = beziers.start[curve]
    return Legs(vectors, rates, ways, beziers), length


def _arcs(program: Program, row: IntArray, length: FloatArray) -> tuple[FloatArray, FloatArray]:
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
