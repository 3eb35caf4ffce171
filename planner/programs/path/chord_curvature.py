"""Which blocks are chords of a smooth curve, and how it bends.

A surface or a spline comes as short lines.  Where they begin and end is chance, and differs from pass to pass; the curve
does not.  What is to be equal in all passes follows the curve:

1.  A junction of two lines is one of chords where they turn by less than 0.2 rad, and the curve through its vertex is within
    the tolerance of both: it leaves a chord of length l by l turn / 8.
2.  The curvature there is how far the direction turns from 1.5 times both lengths before the junction to as much after it,
    so that it is that of several chords; never across a junction of another kind.
"""

from __future__ import annotations

import numpy as np

from planner.programs.path.deviation import Programmed
from planner.types import BoolArray, FloatArray

_AROUND = 1.5  # lengths of both blocks before and after a junction


def curvature_of_chords(
    programmed: Programmed, smooth: BoolArray, turn: FloatArray, tolerance: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Curvature of the curve behind chords, and at which junctions there is one.

    Parameters
    ----------
    programmed : Programmed
        The blocks, m of them.
    smooth : (m - 1,) bool array
        Junctions that are no corner, no stop, and not sharp.
    turn, tolerance : (m - 1,) arrays
        Angles between the blocks, rad; what the path may leave the junction by, mm.

    Returns
    -------
    curvature : (m - 1,) array
        1/mm, 0 where there are no chords.
    chords : (m - 1,) bool array
    """
    edges, curved = programmed.edges, programmed.legs.curved
    length, s, number = np.diff(edges), edges[1:-1], np.arange(edges.size - 2)
    both = length[1:] + length[:-1]
    plain = smooth & ~curved[:-1] & ~curved[1:]
    fences = np.flatnonzero(~plain)
    following = np.searchsorted(fences, number)
    lowest = np.append(-1, fences)[following] + 1
    highest = np.append(fences, number.size)[following]
    first = np.maximum(np.searchsorted(edges, s - _AROUND * both, side="right") - 1, lowest)
    last = np.minimum(np.searchsorted(edges, s + _AROUND * both, side="left") - 1, highest)
    first, last = np.minimum(first, number), np.maximum(last, number + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    tangent = programmed.at(middle)[1]
    tangent /= np.sqrt(np.sum(tangent**2, axis=1))[:, None]
    turned = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(np.sum((tangent[last] - tangent[first]) ** 2, axis=1)), 1.0))
    chords = plain & (0.125 * turn * 0.5 * both <= tolerance)
    return np.where(chords, turned / (middle[last] - middle[first]), 0.0), chords
