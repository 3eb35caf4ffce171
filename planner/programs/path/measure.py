"""The deviation of a path from the blocks as they were written, place by place.

Where nothing was changed the path is the program, exactly, and nothing is to be measured: only corners, tubes, and lines
that stand for several blocks are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.geometry.curve import Curve
from planner.programs.path.deviation import Deviation, Programmed, deviation
from planner.types import FloatArray

# Where a line lies along the path, from and to, and its tolerance, mm.
LinePlace = tuple[float, float, float]
_ROUNDED = 1e-9  # mm: what digits leave of a path that is the program itself
_REACH = 8.0  # tolerances along the path in which the nearest point is searched, besides what pieces and blocks take


@dataclass(frozen=True, eq=False)
class Written:
    """The blocks as they were written, and where they lie on what the path was made from.

    Attributes
    ----------
    programmed : Programmed
    place : (m + 1,) array
        Their vertices on the abscissa that the path was made along, mm, not decreasing.
    lines : sequence of (float, float, float)
        Where lines stand for several blocks: from, to, and the tolerance there, mm.
    """

    programmed: Programmed
    place: FloatArray
    lines: Sequence[LinePlace]

    @property
    def slack(self) -> float:
        """By how much more two vertices may lie apart along the blocks than along the path, mm."""
        excess = self.programmed.edges - self.place
        return float(np.ptp(excess))


def largest_deviation(
    curve: Curve,
    u_edges: FloatArray,
    s_edges: FloatArray,
    written: Written,
    places: Sequence[LinePlace],
    widest: float,
    *,
    pieces: FloatArray | None = None,
    density: int = 16,
) -> tuple[Deviation, float]:
    """Measure a path at the places where it is not the program itself.

    Parameters
    ----------
    curve : Curve
    u_edges, s_edges : (n,) arrays
        Its edges, and the abscissae that it was made along there.
    written : Written
    places : sequence of (float, float, float)
        Corners and tubes: from, to, and the tolerance there, mm of that abscissa.
    widest : float
        The longest piece of them, mm.
    pieces : (k,) array, optional
        Curve parameters between which points lie, in place of ``u_edges``.
    density : int
        How many.

    Returns
    -------
    Deviation
        The largest one; its abscissa is that of the blocks.
    float
        The largest against its tolerance.
    """
    edges, place = written.programmed.edges, written.place
    inside = (place >= s_edges[0]) & (place <= s_edges[-1])
    u = np.concatenate([u_edges, np.interp(place[inside], s_edges, u_edges)])
    s = np.concatenate([np.interp(s_edges, place, edges), edges[inside]])
    order = np.lexsort((u, s))
    along = np.maximum.accumulate(u[order]), s[order]
    window = 2.0 * widest + 2.0 * written.slack
    found, largest = Deviation(0.0, float(edges[0]), 0.0, 0.0), 0.0
    every = [*places, *written.lines]
    for value in sorted({tolerance for _, _, tolerance in every}):
        lo, hi = _merged([(a, b) for a, b, tolerance in every if tolerance == value])
        measured = deviation(
            curve,
            written.programmed,
            *along,
            _REACH * value + window,
            density=density,
            pieces=u_edges if pieces is None else pieces,
            where=(np.interp(lo, place, edges), np.interp(hi, place, edges)),
        )
        found = max(found, measured, key=lambda item: item.largest)
        exact = 0.0 if measured.largest <= _ROUNDED else np.inf  # of a tolerance of 0
        largest = max(largest, measured.largest / value if value > 0.0 else exact)
    return found, largest


def _merged(places: list[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    """Disjoint intervals, in order, that cover the same."""
    lo, hi = (np.array(column) for column in zip(*sorted(places), strict=True))
    hi = np.maximum.accumulate(hi)
    new = np.append(True, lo[1:] > hi[:-1])
    return lo[new], hi[np.append(new[1:], True)]
