"""What the joint problem is given and what it finds: a run of blocks, and a motion along it.

A *run* is a chain of blocks from rest to rest.  The motion sought leaves every block by no more than its tolerance; its
path is not chosen before its feed, both are one function of time.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.blend import Legs
from planner.types import FloatArray, IntArray

_JOINED = 1e-6  # mm between the end of a leg and the start of the next
_DIGITS = 10  # of vertices in mm, as a program says them at most
_ROUNDING = 4e-15  # of the largest coordinate: what the end of a leg is off


@dataclass(frozen=True, eq=False)
class JointRun:
    """Blocks from rest to rest, and the limits on the motion along them.

    Distances of several axes are taken together: sqrt(sum of squares), a degree counted as a mm.

    Attributes
    ----------
    legs : Legs
        The n blocks, each from x = 0 to its length; each begins where the one before ends.
    lengths : (n,) array
        mm, positive.
    tolerance : (n,) array
        Largest distance of the motion from each block, mm, positive; at a junction the smaller of the two holds.
    feed : (n,) array
        Largest speed along each block, mm/s; inf for none.
    velocity, acceleration, jerk : (d,) arrays
        Limits of the axes, mm/s, mm/s^2, mm/s^3; the first two may be inf.
    side : (n,) array, optional
        Where the motion may leave each block to: 1 to its left alone, -1 to its right alone, 0 to both; both if left out.
    plane : (int, int)
        The axes of the plane in which left and right are meant.
    """

    legs: Legs
    lengths: FloatArray
    tolerance: FloatArray
    feed: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    side: NDArray[np.int8] | None = None
    plane: tuple[int, int] = (0, 1)

    def __post_init__(self) -> None:
        for name in ("lengths", "tolerance", "feed", "velocity", "acceleration", "jerk"):
            value = getattr(self, name)
            if not (value > 0.0).all():
                at = int(np.argmin(value > 0.0))
                raise InputError(f"{name}[{at}] = {value[at]!r} must be > 0")
        if not np.isfinite(self.jerk).all():
            raise InputError(
                f"jerk = {self.jerk!r} must be finite; without a jerk limit a motion has no least time to find"
            )
        gaps = np.abs(self.ends[:-1] - self.starts[1:]).max(axis=1, initial=0.0)
        if (gaps > _JOINED).any():
            at = int(np.argmax(gaps))
            raise InputError(f"leg {at + 1} begins {gaps[at]:.3g} mm from the end of leg {at}; a run has no gaps")

    @property
    def normals(self) -> FloatArray | None:
        """Unit vectors in the plane to the allowed side of every block where it begins, (n, d), 0 for both; None for all."""
        if self.side is None or not self.side.any():
            return None
        rows = np.arange(self.lengths.size)
        along = self.legs.at(rows, np.zeros(rows.size))[1]
        first, second = self.plane
        normals = np.zeros((rows.size, self.dim))
        normals[:, first], normals[:, second] = -along[:, second], along[:, first]
        size = np.sqrt(np.sum(normals**2, axis=1))
        lost = np.flatnonzero((self.side != 0) & (size == 0.0))
        if lost.size:
            raise InputError(f"leg {lost[0]} does not move in the plane of its side {self.side[lost[0]]}")
        return np.asarray(normals * (self.side / np.where(size > 0.0, size, 1.0))[:, None])

    @property
    def is_backward(self) -> bool:
        """Whether the run that goes back along the same blocks is the one to be solved.

        Of the vertices from the start and those from the end the first pair that differs decides, by its first axis that
        does: of a run and the one back along it exactly one is backward, unless both are the same.
        """
        apart = self._vertices - self._vertices[::-1]
        pair, axis = np.nonzero(np.abs(apart) > _JOINED)
        return bool(pair.size and apart[pair[0], axis[0]] > 0.0)

    @property
    def _vertices(self) -> FloatArray:
        """Where the blocks begin, and where the last one ends, (n + 1, d)."""
        return np.vstack([self.starts, self.ends[-1:]])

    def between_vertices(self) -> JointRun:
        """The run with its lines laid from vertex to vertex, without what rounding added: the same from either end.

        With an arc among its blocks it stays as it is.
        """
        if self.legs.curved.any():
            return self
        vertices, said = self._vertices, np.round(self._vertices, _DIGITS)
        vertices = np.where(np.abs(said - vertices) <= _ROUNDING * np.abs(vertices).max(), said, vertices)
        way = np.diff(vertices, axis=0)
        lengths = np.sqrt(np.sum(way**2, axis=1))
        vectors = np.zeros_like(self.legs.vectors)
        vectors[:, 0], vectors[:, 3] = vertices[:-1], way / lengths[:, None]
        return replace(self, legs=Legs(vectors, np.zeros((lengths.size, 2))), lengths=lengths)

    def reversed(self) -> JointRun:
        """The run back along the same blocks."""
        back = slice(None, None, -1)
        legs = self.legs.from_point(self.lengths, backwards=True).taken(np.arange(self.lengths.size)[back])
        side = None if self.side is None else np.asarray(-self.side[back])
        lengths, tolerance, feed = self.lengths[back], self.tolerance[back], self.feed[back]
        return replace(self, legs=legs, lengths=lengths, tolerance=tolerance, feed=feed, side=side)

    @property
    def dim(self) -> int:
        """Number of axes, d."""
        return int(self.jerk.size)

    @property
    def starts(self) -> FloatArray:
        """Points at which the blocks begin, (n, d)."""
        rows = np.arange(self.lengths.size)
        return np.asarray(self.legs.at(rows, np.zeros(rows.size))[0])

    @property
    def ends(self) -> FloatArray:
        """Points at which the blocks end, (n, d)."""
        return np.asarray(self.legs.at(np.arange(self.lengths.size), self.lengths)[0])


@dataclass(frozen=True, eq=False)
class JointMotion:
    """A motion from rest to rest: position over time, a piecewise cubic with continuous acceleration; read-only arrays.

    Attributes
    ----------
    t : (m + 1,) array
        Nodes, s, from 0, increasing.
    position, velocity, acceleration : (m + 1, d) arrays
        There, in mm and s.
    jerk : (m, d) array
        Between two nodes, constant.
    leg : (m,) array
        The block that each piece runs along; does not decrease, and every block has a piece.
    iterations : int
        Of the solver.
    """

    t: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    leg: IntArray
    iterations: int = 0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def duration(self) -> float:
        """Time from start to end, s."""
        return float(self.t[-1])

    def reversed(self) -> JointMotion:
        """The same motion back in time, along the run back."""
        p, v, a, j = (row[::-1] for row in (self.position, self.velocity, self.acceleration, self.jerk))
        leg = self.leg[-1] - self.leg[::-1]
        return JointMotion(self.t[-1] - self.t[::-1], p.copy(), 0.0 - v, a.copy(), 0.0 - j, leg, self.iterations)

    def with_ends(self, start: FloatArray, end: FloatArray) -> JointMotion:
        """The same motion between these two points (d,), which differ from its own by rounding."""
        return replace(self, position=np.vstack([start, self.position[1:-1], end]))

    def at(self, t: FloatArray) -> FloatArray:
        """Position, velocity, acceleration, jerk (4, k, d) at times (k,) within the motion; at a node on its right."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, self.t.size - 2)
        h = (t - self.t[i])[:, None]
        p, v, a, j = self.position[i], self.velocity[i], self.acceleration[i], self.jerk[i]
        position = p + h * (v + h * (0.5 * a + h * (j / 6.0)))
        return np.stack([position, v + h * (a + 0.5 * h * j), a + h * j, j])
