"""Legs (lines, arcs, helices) and the cubic blends that round the corners between them, by true arc length.

A **leg** is everything a block of a part program can be, at distance x from its start:

    leg(x) = o + (1 + k x) (e1 cos wx + e2 sin wx) + g x

a line where e1 = e2 = 0, an arc or helix of radius |e1| = |e2| otherwise, a spiral where k is not 0; or a stretch of a curve
(``bezier``), by the distance along it.

A **blend** lets the motion along the incoming leg run out while that along the outgoing one begins.  With D1(x) and D2(x)
the displacements from the corner V to the points at distance x before and after it, size A and |tau| <= 1,

    q(tau) = V + D1(A (1 - tau)^3) + D2(A (1 + tau)^3).

Between two lines that is a cubic Bezier with both inner control points at V: two overlapping moves of constant jerk.  It
reaches 8A along each leg, joins them with continuous curvature, and passes V at the distance A |t2 - t1|.

Arc length.  |dq/dtau| has branch points near tau = +-i b, b = tan((pi - angle)/4), which come close for sharp corners.
tau = b sinh(eta x), eta = asinh(1/b), moves them away from x in [-1, 1]: 64 Chebyshev nodes resolve the speed to rounding
for every angle up to 150 degrees, and 256 or 1024 where a leg bends by much within the reach.  Between lines the series
depends on the angle alone and is shared by all equal corners.  Its inverse, tau over the share of the length, is tabulated
once a shape: panels are halved until the last terms of their Chebyshev series are rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.bezier import Beziers, tabulate_inverse
from planner.geometry.differential import chain_rule
from planner.types import BoolArray, FloatArray, IntArray

BLEND_REACH = 8.0  # of the size A, along each leg
_NODES = (64, 256, 1024)
_RESOLVED = 1e-12  # tail of the series of the speed, against its mean
_SAME_COSINE = 13  # decimals; closer angles share a table
_FOLLOWED = 0.1  # of the distance from the real axis to the branch points, in which quintics follow the arc length


@dataclass(frozen=True, eq=False)
class Legs:
    """Lines, arcs, helices, spirals and stretches of curves, n of them.

    Attributes
    ----------
    vectors : (n, 4, dim) array
        o, e1, e2 and g of each; of a stretch of a curve where that curve begins, the way from there to x = 0, and 0.
    rates : (n, 2) array
        w in rad/mm and k in 1/mm.
    ways : (n, 3) array, optional
        Of a stretch of a curve its row in ``beziers`` (-1: none), its distance at x = 0, mm, and the direction, 1 or -1.
    beziers : Beziers, optional
    """

    vectors: FloatArray
    rates: FloatArray
    ways: FloatArray | None = None
    beziers: Beziers | None = None

    @property
    def curved(self) -> BoolArray:
        """Which of the legs are no lines, (n,)."""
        bent = self.rates[:, 0] != 0.0
        return np.asarray(bent if self.ways is None else bent | (self.ways[:, 0] >= 0.0))

    def radius(self, row: NDArray[np.intp]) -> FloatArray:
        """Smallest radius of curvature of the legs ``row`` (n,), nearly, mm; inf for lines."""
        with np.errstate(divide="ignore"):
            out = np.abs(1.0 / self.rates[row, 0])
        if self.ways is not None and self.beziers is not None:
            curve = self.ways[row, 0].astype(np.intp)
            out[curve >= 0] = self.beziers.taken(curve[curve >= 0]).tightest
        return np.asarray(out)

    def at(self, row: NDArray[np.intp], x: FloatArray) -> FloatArray:
        """Position and three derivatives with respect to x, (4, n, dim), of the legs ``row`` (n,) at x (n,)."""
        d = self.turned(row, x)
        d[0] += self.vectors[row, 0]
        return d

    def turned(self, row: NDArray[np.intp], x: FloatArray) -> FloatArray:
        """As :meth:`at`, the position counted from o."""
        d = turning(self.vectors[row, 1:], self.rates[row], x)
        if self.ways is not None and self.beziers is not None:
            curve, begin, direction = self.ways[row].T
            on = np.flatnonzero(curve >= 0.0)
            d[:, on] = self.beziers.at(curve[on].astype(np.intp), begin[on] + direction[on] * x[on])
            d[1::2, on] *= direction[on, None]
        return d

    def taken(self, row: NDArray[np.intp]) -> Legs:
        """Return some of the legs."""
        return Legs(self.vectors[row], self.rates[row], None if self.ways is None else self.ways[row], self.beziers)

    def from_point(self, x: FloatArray, *, backwards: bool) -> Legs:
        """The same legs, measured from the points at x (n,) on, or back from them."""
        d = self.turned(np.arange(x.size), x)
        sign = -1.0 if backwards else 1.0
        grown = 1.0 + self.rates[:, 1] * x
        angle = (self.rates[:, 0] * x)[:, None]
        e1, e2, g = (self.vectors[:, k] for k in (1, 2, 3))
        radial = grown[:, None] * (e1 * np.cos(angle) + e2 * np.sin(angle))
        across = sign * grown[:, None] * (e2 * np.cos(angle) - e1 * np.sin(angle))
        origin = self.vectors[:, 0] + d[0] - radial
        vectors = np.stack([origin, radial, across, sign * g], axis=1)
        rates = np.stack([self.rates[:, 0], sign * self.rates[:, 1] / grown], axis=1)
        if self.ways is None:
            return Legs(vectors, rates)
        on = np.flatnonzero(self.ways[:, 0] >= 0.0)
        vectors[on, 0], vectors[on, 1] = self.vectors[on, 0], d[0, on]
        ways = np.column_stack([self.ways[:, 0], self.ways[:, 1] + self.ways[:, 2] * x, sign * self.ways[:, 2]])
        return Legs(vectors, rates, ways, self.beziers)

    def with_curves(self, row: NDArray[np.intp], beziers: Beziers) -> Legs:
        """The same legs on other curves, of which ``row`` says where each is now."""
        if self.ways is None:
            return self
        ways = self.ways.copy()
        on = ways[:, 0] >= 0.0
        ways[on, 0] = row[ways[on, 0].astype(np.intp)]
        return replace(self, ways=ways, beziers=beziers)

    def joined(self, other: Legs) -> Legs:
        """These legs, and after them others."""
        vectors, rates = (np.concatenate(pair) for pair in ((self.vectors, other.vectors), (self.rates, other.rates)))
        curves = [legs.beziers for legs in (self, other) if legs.beziers is not None]
        if not curves:
            return Legs(vectors, rates)
        none = np.array([-1.0, 0.0, 1.0])
        ways = [np.tile(none, (legs.rates.shape[0], 1)) if legs.ways is None else legs.ways for legs in (self, other)]
        beziers = curves[0]
        if len(curves) == 2 and curves[1] is not curves[0]:
            beziers = curves[0].joined(curves[1])
            ways[1] = ways[1] + np.where(ways[1][:, :1] >= 0.0, [[float(len(curves[0])), 0.0, 0.0]], 0.0)
        return Legs(vectors, rates, np.concatenate(ways), beziers)


def turning(vectors: FloatArray, rates: FloatArray, x: FloatArray) -> FloatArray:
    """(1 + k x) (e1 cos wx + e2 sin wx) + g x and its first three derivatives, (4, n, dim).

    Parameters
    ----------
    vectors : (n, 3, dim) array
        e1, e2, g.
    rates : (n, 2) array
        w, k.
    x : (n,) array
    """
    out = np.zeros((4, *vectors[:, 0].shape))
    out[0] = vectors[:, 0] + vectors[:, 2] * x[:, None]
    out[1] = vectors[:, 2]
    bent = np.flatnonzero((rates != 0.0).any(axis=1))  # lines are most of a program, and need no sine
    if bent.size == 0:
        return out
    w, k, x = rates[bent, 0:1], rates[bent, 1:2], x[bent, None]
    e1, e2, g = (vectors[bent, j] for j in range(3))
    cosine, sine = np.cos(w * x), np.sin(w * x)
    circle = e1 * cosine + e2 * sine
    along = w * (e2 * cosine - e1 * sine)
    grown = 1.0 + k * x
    out[0, bent] = grown * circle + g * x
    out[1, bent] = grown * along + k * circle + g
    out[2, bent] = -grown * w**2 * circle + 2.0 * k * along
    out[3, bent] = -grown * w**2 * along - 3.0 * k * w**2 * circle
    return out


def with_own_curves(parts: Sequence[Legs]) -> list[Legs]:
    """Legs that share their curves, with those curves alone that one of them is on."""
    rows = [legs.ways[:, 0].astype(np.intp) for legs in parts if legs.ways is not None]
    beziers = next((legs.beziers for legs in parts if legs.beziers is not None), None)
    if beziers is None or not rows:
        return list(parts)
    used = np.unique(np.concatenate(rows))
    used = used[used >= 0]
    if not used.size:
        return [replace(legs, ways=None, beziers=None) for legs in parts]
    row = np.full(len(beziers), -1)
    row[used] = np.arange(used.size)
    own = beziers.taken(used)
    return [legs.with_curves(row, own) for legs in parts]


@dataclass(frozen=True, eq=False)
class Blends:
    """Cubic blends, n of them; build them with :meth:`between`.

    Attributes
    ----------
    vertex : (n, dim) array
        The corners V.
    before, after : Legs
        Legs from the corners, backwards and forwards.
    size : (n,) array
        A, mm.
    length : (n,) array
        Arc length, mm.
    weight : (dim,) array
        What the square of each column counts in it: 1 of a length, 0 of a column that only goes along.
    """

    vertex: FloatArray
    before: Legs
    after: Legs
    size: FloatArray
    length: FloatArray
    weight: FloatArray
    _table: NDArray[np.intp]
    _half_angle: FloatArray
    _lengths: FloatArray
    _speeds: FloatArray

    @classmethod
    def between(cls, before: Legs, after: Legs, size: FloatArray, weight: FloatArray | None = None) -> Blends:
        """Blends of the sizes A (n,) between legs that begin at the corners (``before`` runs backwards)."""
        weight = np.ones(after.vectors.shape[2]) if weight is None else weight
        vertex = after.vectors[:, 0] + after.vectors[:, 1]
        straight = ~before.curved & ~after.curved
        row = np.arange(size.size)
        back, forth = (legs.at(row, np.zeros(size.size))[1] for legs in (before, after))
        product, *squares = (np.sum(weight * part, axis=1) for part in (back * forth, back**2, forth**2))
        cosine = -product / np.sqrt(squares[0] * squares[1])
        key = np.where(straight, np.round(cosine, _SAME_COSINE), 2.0 + row)
        _, first, table = np.unique(key, return_index=True, return_inverse=True)
        angle = np.arccos(np.clip(cosine[first], -1.0, 1.0))
        b = np.tan(0.25 * (np.pi - angle))
        blends = cls(
            vertex, before, after, size, size, weight, np.asarray(table), b, np.empty((0, 0)), np.empty((0, 0))
        )
        for count in _NODES:  # more where a leg bends by much within the reach
            speeds = blends._speed_series(first, count)
            if (np.abs(speeds[:, -4:]) <= _RESOLVED * np.abs(speeds[:, :1])).all():
                break
        lengths = np.ascontiguousarray(chebyshev.chebint(speeds, lbnd=-1, axis=1), dtype=np.float64)
        total = lengths.sum(axis=1)
        return cls(
            vertex,
            before,
            after,
            size,
            size * total[table],
            weight,
            blends._table,
            b,
            lengths,
            np.ascontiguousarray(speeds),
        )

    def _speed_series(self, row: NDArray[np.intp], count: int) -> FloatArray:
        """Chebyshev series (n, count) over x of the speed over it, of the blends ``row`` (n,), one of each shape."""
        nodes = np.pi * (np.arange(count) + 0.5) / count
        to_series = np.cos(np.outer(np.arange(count), nodes)) * (2.0 / count)
        to_series[0] *= 0.5
        b, x = self._half_angle[:, None], np.cos(nodes)
        eta = np.arcsinh(1.0 / b)
        tau = b * np.sinh(eta * x)
        d = self.at(np.repeat(row, count), tau.reshape(-1))[1]
        speed = np.sqrt(np.sum(self.weight * d**2, axis=1)).reshape(tau.shape) / self.size[row, None]
        return np.asarray(speed * b * eta * np.cosh(eta * x) @ to_series.T)

    def at(self, row: NDArray[np.intp], tau: FloatArray) -> FloatArray:
        """Position and three derivatives with respect to tau, (4, n, dim), of the blends ``row`` (n,) at tau (n,)."""
        out = np.zeros((4, row.size, self.vertex.shape[1]))
        out[0] = self.vertex[row]
        size = self.size[row]
        for legs, sign in ((self.before, -1.0), (self.after, 1.0)):
            reach = 1.0 + sign * tau
            x = size * reach**3
            x1, x2, x3 = (
                part[:, None] for part in (3.0 * sign * size * reach**2, 6.0 * size * reach, 6.0 * sign * size)
            )
            d = legs.turned(row, x)
            out[0] += d[0] - legs.vectors[row, 1]
            out[1:] += chain_rule(d[1], d[2], d[3], x1, x2, x3)
        return out

    @cached_property
    def inverse(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """The inverse of the arc length of every shape: tau over the share of the length, by panels.

        Returns
        -------
        edges, series, first : arrays
            Edges of the panels, one more than panels for each shape; Chebyshev series (panels, 12); first panel of each
            shape, (shapes + 1,).
        """
        return tabulate_inverse(self._lengths, self._speeds, self._half_angle)

    def tau(self, row: IntArray, s: FloatArray) -> FloatArray:
        """Invert the arc length of the blends ``row`` (n,) at s (n,) from the start of each."""
        edges, series, first = self.inverse
        out, share = np.empty(row.size), np.clip(s / self.length[row], 0.0, 1.0)
        core.blend_tau(row.size, self._table[row], share, first, edges, series, out)
        return out

    @property
    def shape(self) -> IntArray:
        """Which of the shapes in ``inverse`` each blend has, (n,)."""
        return self._table

    def arc_length(self, row: NDArray[np.intp], tau: FloatArray) -> FloatArray:
        """Arc length from the start of the blends ``row`` (n,) to tau (n,), mm."""
        table = self._table[row]
        b = self._half_angle[table]
        x = np.arcsinh(tau / b) / np.arcsinh(1.0 / b)
        share = np.empty(row.size)
        order = np.argsort(table, kind="stable")
        starts = np.flatnonzero(np.diff(table[order], prepend=-1))
        for some in np.split(order, starts[1:]) if order.size else []:
            share[some] = chebyshev.chebval(x[some], self._lengths[table[some[0]]])
        return np.where(tau <= -1.0, 0.0, np.where(tau >= 1.0, self.length[row], self.size[row] * share))

    def spacing(self, row: NDArray[np.intp]) -> FloatArray:
        """Steps of tau (n,) in which a polynomial of degree 5 follows the arc length: a share of b, where that is less."""
        return _FOLLOWED * np.minimum(1.0, self._half_angle[self._table[row]])
