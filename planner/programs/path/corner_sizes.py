"""How much of the tolerance corners may use beside lines that stand for several blocks.

What such a line is off is taken from the tolerance of all that is made of it.  A corner need not lose it: it is off inwards,
at its middle, and the line outwards, somewhere else.  So the corner there is made as large as its distance from the
blocks as they were written allows, measured both ways.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.geometry.blend import BLEND_REACH, Legs
from planner.programs.path.corners import CORNER_TURN, MAX_TURN, tangent_jumps
from planner.programs.path.deviation import Programmed
from planner.types import FloatArray

# Points of a corner, closer at its middle, where it turns: there it is within 1e-4 A of the chords between them.
_TAU = np.linspace(-1.0, 1.0, 65)
_TAU = 0.25 * _TAU + 0.75 * _TAU**3
_FINE = 16  # parts between the neighbours of the point that is farthest off
_WITHIN = 0.998
_HALVINGS = 8
_AROUND = 2.0  # tolerances beyond the reach in which the nearest point is searched
_TOGETHER = 512  # corners, which bounds the memory


def rooms(
    programmed: Programmed,
    written: Programmed,
    place: FloatArray,
    own: FloatArray,
    left: FloatArray,
    stop: NDArray[np.bool_],
) -> FloatArray:
    """The distance that a corner may keep from its vertex at every junction, (m - 1,), mm.

    Parameters
    ----------
    programmed : Programmed
        The m blocks that the corners are made of.
    written : Programmed
        The blocks as they were written.
    place : (k + 1,) array
        Abscissae of their vertices on ``programmed``, mm.
    own, left : (m,) arrays
        The tolerance in force, and what the blocks leave of it, mm.
    stop : (m - 1,) bool array
        Stops that the program demands.
    """
    low, high = np.minimum(left[:-1], left[1:]), np.minimum(own[:-1], own[1:])
    chord = tangent_jumps(programmed)
    turn = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    at = np.flatnonzero((turn > CORNER_TURN) & (turn <= MAX_TURN) & ~stop & (low < high) & (low > 0.0))
    for first in range(0, at.size, _TOGETHER):
        some = at[first : first + _TOGETHER]
        before = programmed.legs.taken(some).from_point(np.diff(programmed.edges)[some], backwards=True)
        after = programmed.legs.taken(some + 1).from_point(np.zeros(some.size), backwards=False)
        corners = _Corners(before, after, programmed.edges[some + 1], chord[some], high[some], written, place)
        low[some] = corners.largest(low[some])
    return low


@dataclass(frozen=True, eq=False)
class _Corners:
    """Corners between legs that begin at ``vertex``, of that chord |t2 - t1| and tolerance."""

    before: Legs
    after: Legs
    vertex: FloatArray
    chord: FloatArray
    tolerance: FloatArray
    written: Programmed
    place: FloatArray

    def largest(self, low: FloatArray) -> FloatArray:
        """The largest distances from the vertices that keep the tolerance, from those on that are known to, by halving."""
        high = self.tolerance.copy()
        low = np.where(self._keeps(np.arange(high.size), high), high, low)
        todo = np.flatnonzero(low < high)
        for _ in range(_HALVINGS if todo.size else 0):
            middle = 0.5 * (low[todo] + high[todo])
            keeps = self._keeps(todo, middle)
            low[todo] = np.where(keeps, middle, low[todo])
            high[todo] = np.where(keeps, high[todo], middle)
        return low

    def _keeps(self, some: NDArray[np.intp], room: FloatArray) -> NDArray[np.bool_]:
        """Whether corners at these distances from their vertices keep the tolerance."""
        size = room / self.chord[some]
        ends = self.vertex[some] + BLEND_REACH * size * np.array([[-1.0], [1.0]])
        first, last = np.interp(ends, self.place, self.written.edges)
        window = last - first + _AROUND * self.tolerance[some]
        tau = np.broadcast_to(_TAU, (some.size, _TAU.size))
        points = self._points(some, size, tau)
        away = self._from_corner(some, size, window, tau, points)
        peak = np.clip(np.argmax(away, axis=1), 1, _TAU.size - 2)
        fine = np.linspace(_TAU[peak - 1], _TAU[peak + 1], _FINE + 1, axis=1)
        close = self._from_corner(some, size, window, fine, self._points(some, size, fine))
        largest = np.maximum(away.max(axis=1), close.max(axis=1))
        largest = np.maximum(largest, self._to_corner(points, first, last))
        return np.asarray(largest <= _WITHIN * self.tolerance[some])

    def _points(self, some: NDArray[np.intp], size: FloatArray, tau: FloatArray) -> FloatArray:
        """V + D1(A (1 - tau)^3) + D2(A (1 + tau)^3), (n, k, dim), of the sizes A (n,) at tau (n, k)."""
        row = np.repeat(some, tau.shape[1])
        x1, x2 = ((size[:, None] * (1.0 + sign * tau) ** 3).reshape(-1) for sign in (-1.0, 1.0))
        vertex = self.after.at(some, np.zeros(some.size))[0]
        points = (self.before.at(row, x1)[0] + self.after.at(row, x2)[0]).reshape(*tau.shape, -1)
        return np.asarray(points - vertex[:, None])

    def _from_corner(
        self, some: NDArray[np.intp], size: FloatArray, window: FloatArray, tau: FloatArray, points: FloatArray
    ) -> FloatArray:
        """Distance of points of the corners, at tau (n, k), to the blocks, (n, k)."""
        along = self.vertex[some, None] + size[:, None] * ((1.0 + tau) ** 3 - (1.0 - tau) ** 3)
        s = np.interp(along, self.place, self.written.edges).reshape(-1)
        flat = points.reshape(s.size, -1)
        return self.written.distance(flat, s, np.repeat(window, tau.shape[1])).reshape(tau.shape)

    def _to_corner(self, points: FloatArray, first: FloatArray, last: FloatArray) -> FloatArray:
        """Largest distance of the vertices from ``first`` to ``last``, and of the middles between them, to chords, (n,)."""
        edges = self.written.edges
        begin, end = np.searchsorted(edges, first, side="right"), np.searchsorted(edges, last)
        count = end - begin + 1  # blocks; at either end a part of one
        index = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        row = np.repeat(np.arange(count.size), count)
        lo = np.maximum(edges[begin[row] + index - 1], first[row])
        hi = np.minimum(edges[begin[row] + index], last[row])
        s, row = np.concatenate([lo, 0.5 * (lo + hi), hi]), np.tile(row, 3)
        # all of them as one path, of which each point looks at its own corner only
        flat = points.reshape(-1, points.shape[2])
        vector = np.diff(flat, axis=0)
        length = np.maximum(np.sqrt(np.sum(vector**2, axis=1)), 1e-300)
        none = np.zeros_like(vector)
        legs = Legs(np.stack([flat[:-1], none, none, vector / length[:, None]], axis=1), np.zeros((length.size, 2)))
        chain = Programmed(np.append(0.0, np.cumsum(length)), legs)
        ends = chain.edges.reshape(points.shape[:2])[:, [0, -1]]
        at, window = ends.mean(axis=1)[row], 0.5 * np.diff(ends, axis=1)[row, 0]
        out = np.zeros(count.size)
        np.maximum.at(out, row, chain.distance(self.written.at(s)[0], at, window))
        return out
