"""How far a path is from the programmed one, in both directions.

    from the path      every point of the path to the nearest of the blocks,
    from the program   every programmed point to the nearest point of the path,

each searched within a window of the abscissa, since a path may come near itself.  The points lie densely between all
knots and vertices, and the largest distances are refined between them.  Nothing of how a path was made enters: only the
blocks, the curve, and the abscissa that goes with its parameter.  A distance to a point of the other path is never less
than the distance to the path, so a search that misses the nearest point exaggerates; it does not excuse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.compiled import core
from planner.geometry.blend import Legs
from planner.geometry.curve import Curve
from planner.geometry.differential import dot
from planner.types import FloatArray

_FOOT_PASSES = 8
_CONVEX = 0.2
_SETTLED = 1e-9  # of the distance, by which another step could shorten it
_REFINED = 64  # largest samples of either direction that are refined between their neighbours
_ZOOM, _ZOOMS = 12, 3  # parts of a bracket looked at, and how often: 1/216 of it at last
_SAME = 1e-12
_BLOCK = 200_000  # points at a time


@dataclass(frozen=True, eq=False)
class Programmed:
    """The programmed path: block i is leg i, from abscissa edges[i] to edges[i + 1], mm.

    ``scale`` (dim,) is what the coordinates of a curve are multiplied by to be those of the legs, where that is not 1;
    ``per_feed`` (m,) by how much more the abscissa rises in a block than the way that its feed is measured along.
    """

    edges: FloatArray
    legs: Legs
    scale: FloatArray | float = 1.0
    per_feed: FloatArray | float = 1.0

    def of_curve(self, curve: Curve, u: FloatArray, order: int) -> FloatArray:
        """Derivatives 0..order of a curve in the units of the legs."""
        return curve.derivatives(u, order) * self.scale

    def at(self, s: FloatArray, *, left: bool = False) -> FloatArray:
        """Position and three derivatives (4, n, dim) at the abscissae s (n,)."""
        block = np.searchsorted(self.edges, s, side="left" if left else "right") - 1
        block = np.clip(block, 0, self.edges.size - 2)
        return self.legs.at(block, s - self.edges[block])

    def distance(self, points: FloatArray, s: FloatArray, window: FloatArray) -> FloatArray:
        """Distance of points (n, dim) to the blocks within the windows around s, (n,)."""
        out = np.empty(s.size)
        points, s, window = (np.ascontiguousarray(a) for a in (points, s, window))
        legs, curves = self.legs, self.legs.beziers
        blocks = self.edges.size - 1, points.shape[1], self.edges, legs.vectors, legs.rates, legs.ways
        beziers = (0, *[None] * 5) if curves is None else curves.arguments
        core.deviation_to_blocks(*blocks, *beziers, s.size, points, s, window, out)
        return out


@dataclass(frozen=True)
class Deviation:
    """The largest distance between path and program.

    Attributes
    ----------
    largest : float
        mm.
    abscissa : float
        Where, mm of programmed path.
    from_path, from_program : float
        The largest of either direction, mm.
    """

    largest: float
    abscissa: float
    from_path: float
    from_program: float


Along = Callable[[FloatArray], FloatArray]


def foot_distance(
    curve: Callable[[FloatArray], FloatArray], points: FloatArray, u: FloatArray, lo: FloatArray, hi: FloatArray
) -> FloatArray:
    """Distance of points (n, dim) to a curve near u, within [lo, hi]; ``curve`` gives (3 or more, n, dim).

    Newton on the squared distance where that is convex, Gauss-Newton where it is not; a step that leads away is halved.
    """
    best = np.full(u.size, np.inf)
    at, u = u.copy(), u.copy()
    moving = np.arange(u.size)
    for _ in range(_FOOT_PASSES):
        x = u[moving]
        d = curve(x)
        away = d[0] - points[moving]
        square = dot(d[1], d[1])
        distance = np.sqrt(dot(away, away))
        nearer = distance < best[moving]
        at[moving], best[moving] = np.where(nearer, x, at[moving]), np.where(nearer, distance, best[moving])
        convex = square + dot(away, d[2])
        slope = np.where(convex > _CONVEX * square, convex, square)
        # A step that led away is halved, from the best point so far.
        step = np.clip(x - dot(away, d[1]) / slope, lo[moving], hi[moving])
        u[moving] = np.where(nearer, step, 0.5 * (at[moving] + x))
        # A step d along changes the distance r by no more than d^2 / 2r, or d: this point is settled, the distance found.
        reach = np.abs(u[moving] - x) * np.sqrt(square)
        moving = moving[reach * np.minimum(reach, best[moving]) > _SETTLED * best[moving] ** 2]
        if moving.size == 0:
            return best
    last = curve(u[moving])[0] - points[moving]
    best[moving] = np.minimum(best[moving], np.sqrt(dot(last, last)))
    return best


def samples_between(edges: FloatArray, count: int) -> FloatArray:
    """The edges, and ``count`` - 1 points between any two."""
    inner = edges[:-1, None] + np.diff(edges)[:, None] * (np.arange(count) / count)
    return np.append(np.minimum(inner, edges[1:, None]).reshape(-1), edges[-1])


def deviation(
    curve: Curve,
    programmed: Programmed,
    u_edges: FloatArray,
    s_edges: FloatArray,
    window: float,
    *,
    density: int = 16,
    pieces: FloatArray | None = None,
    where: tuple[FloatArray, FloatArray] | None = None,
) -> Deviation:
    """Measure the deviation of a curve from the programmed path.

    Parameters
    ----------
    curve : Curve
    programmed : Programmed
    u_edges, s_edges : (m,) arrays
        Curve parameters and the abscissae that go with them, increasing; linear between.
    window : float
        How far along the path the nearest point is searched, mm.
    density : int
        Points between neighbouring edges (knots, vertices).
    pieces : (k,) array, optional
        Curve parameters between which the points of the curve lie, and between whose abscissae those of the blocks, in place
        of ``u_edges``.
    where : pair of (k,) arrays, optional
        Abscissae at which the stretches to be looked at begin and end; everything if left out.

    Returns
    -------
    Deviation
    """

    def from_path(u: FloatArray) -> FloatArray:
        s = np.interp(u, u_edges, s_edges)
        return programmed.distance(programmed.of_curve(curve, u, 0)[0], s, np.full(u.size, window))

    def from_program(s: FloatArray) -> FloatArray:
        u = np.interp(s, s_edges, u_edges)
        lo, hi = np.maximum(u - window, u_edges[0]), np.minimum(u + window, u_edges[-1])
        return foot_distance(lambda at: programmed.of_curve(curve, at, 2), programmed.at(s)[0], u, lo, hi)

    found = []
    inner = u_edges if pieces is None else pieces
    along = s_edges if pieces is None else np.interp(pieces, u_edges, s_edges)
    for measure, own, other in ((from_path, u_edges, s_edges), (from_program, s_edges, u_edges)):
        edges = np.union1d(*((curve._candidate_breaks(), inner) if own is u_edges else (programmed.edges, along)))
        if where is not None:
            limits = where if own is s_edges else tuple(np.interp(part, s_edges, u_edges) for part in where)
            edges = np.union1d(edges, np.concatenate(limits))
        edges = edges[(edges >= own[0]) & (edges <= own[-1])]
        edges = edges[np.append(True, np.diff(edges) > _SAME)]
        if where is not None:
            inside = np.searchsorted(limits[0], edges[:-1] + _SAME, side="right") - 1
            kept = (inside >= 0) & (edges[:-1] < limits[1][np.maximum(inside, 0)])
        else:
            kept = np.ones(edges.size - 1, dtype=np.bool_)
        found.append(_largest(measure, edges[:-1][kept], edges[1:][kept], density))
        if own is u_edges:
            found[-1] = (found[-1][0], float(np.interp(found[-1][1], own, other)))
    worst = max(found)
    return Deviation(worst[0], worst[1], found[0][0], found[1][0])


def _largest(measure: Along, lo: FloatArray, hi: FloatArray, density: int) -> tuple[float, float]:
    """Largest value of a function on the intervals [lo, hi], and its place."""
    best, at = 0.0, float(lo[0]) if lo.size else 0.0
    fractions = np.arange(density + 1) / density
    step = max(1, _BLOCK // (density + 1))
    for start in range(0, lo.size, step):
        a, b = lo[start : start + step], hi[start : start + step]
        x = np.minimum(a[:, None] + (b - a)[:, None] * fractions, b[:, None])
        value = measure(x.reshape(-1)).reshape(x.shape)
        place = np.unravel_index(int(np.argmax(value)), value.shape)
        if value[place] > best:
            best, at = float(value[place]), float(x[place])
        where, height = refined_peaks(measure, x.reshape(-1), value.reshape(-1))
        if where.size and height.max() > best:
            best, at = float(height.max()), float(where[int(np.argmax(height))])
    return best, at


def refined_peaks(measure: Along, x: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Refine the largest local maxima among samples ``value`` at non-decreasing x: their places and heights."""
    left, middle, right = value[:-2], value[1:-1], value[2:]
    bend = 2.0 * middle - left - right
    at = np.flatnonzero((middle >= left) & (middle >= right) & (x[2:] > x[:-2]))
    if at.size == 0:
        return np.empty(0), np.empty(0)
    # ranked by the peak of the parabola through three samples
    with np.errstate(divide="ignore", invalid="ignore"):
        height = middle[at] + np.nan_to_num((right[at] - left[at]) ** 2 / (8.0 * bend[at]), posinf=0.0)
    at = at[np.argsort(-height, kind="stable")[:_REFINED]]
    lo, hi = x[at], x[at + 2]
    share = np.arange(_ZOOM + 1) / _ZOOM
    for _ in range(_ZOOMS):
        places = np.minimum(lo[:, None] + (hi - lo)[:, None] * share, hi[:, None])
        found = measure(places.reshape(-1)).reshape(places.shape)
        best = np.argmax(found, axis=1)
        row = np.arange(at.size)
        lo, hi = places[row, np.maximum(best - 1, 0)], places[row, np.minimum(best + 1, _ZOOM)]
    return places[row, best], found[row, best]
