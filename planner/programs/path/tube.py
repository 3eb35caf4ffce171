"""The smoothest spline within a tube around a stretch of the programmed path.

A quartic B-spline q(s) with simple knots (C3), parametrised by the programmed abscissa s, minimises

    1/2 integral w |q'''|^2 ds,     w = v^5 / J^2,

the square of the jerk used at the speed v, weighted by time, subject at the vertices and at samples of every interval to

    |n . (q - p)| <= tol,     |t . (q - p)| <= 2 tol.

In space four normals n, 45 degrees apart, with tol cos 22.5 deg keep q in an octagon within the circle.

Rules

1.  Knots.  H(s), the spacing, is small where the path bends: see ``knots``.  Knots are equidistant in the integral of
    ds/H, one on every sharp vertex, which treats both directions of travel alike.
2.  Start from c_i = p(Greville abscissa), which lies in the tube nearly everywhere.
3.  Banded primal-dual interior point, Mehrotra's predictor and corrector.  Every row may be exceeded by an elastic e >= 0
    at a price, so that an infeasible tube ends with the least excess and is seen by the check, instead of failing here.
    Slacks, elastics and multipliers are eliminated row by row; what remains is H + sum D_k a_k a_k^T, half-bandwidth 5d - 1.
4.  The ends: position, tangent and curvature of the path where it goes on (the first three control points), the third
    derivative too where another tube goes on, the position alone where the path stops.

The price of a row is bounded by the penalty, hence the iteration cannot diverge; the tube is not the exact set of curves
within the tolerance (tangential slip, samples), hence the accepted curve is the one that ``deviation`` has measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.types import FloatArray

DEGREE = 4
_SAMPLES = (1.0 / 6.0, 0.5, 5.0 / 6.0)  # of an interval
_OCTAGON = float(np.cos(np.pi / 8.0))
SLIP = 2.0  # tangential half-width, in tolerances
_ROWS_AT_VERTICES = 6  # of an interval at first


@dataclass(frozen=True, eq=False)
class Tube:
    """What a tube is built of.

    Attributes
    ----------
    knots : (n + 1,) array
        Distinct knots, mm of programmed abscissa.
    abscissa : (m,) array
        Where the rows are, increasing.
    point : (m, d) array
        Programmed points there.
    tangent : (m, d) array
        Unit tangents; at a vertex the mean direction.
    half_width : (m,) array
        Tolerance of each row, mm.
    start, end : (k, d) array
        Position and k - 1 derivatives at the ends, k from 1 to 4.
    initial : (n + 4, d) array
        Control points to start from.
    weight : (n,) array
        w on every interval, any unit.
    """

    knots: FloatArray
    abscissa: FloatArray
    point: FloatArray
    tangent: FloatArray
    half_width: FloatArray
    start: FloatArray
    end: FloatArray
    initial: FloatArray
    weight: FloatArray


@dataclass(frozen=True, eq=False)
class Spline:
    """A quartic spline in power form: ``knots (n + 1,)`` and ``powers (n, d, 5)`` of the local parameter in [0, 1]."""

    knots: FloatArray
    powers: FloatArray
    control: FloatArray
    iterations: int

    def derivatives(self, s: FloatArray) -> FloatArray:
        """Value and three derivatives (4, n, d) at s (n,), right-sided at knots."""
        from planner.geometry.chain import span_derivatives

        i = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, self.powers.shape[0] - 1)
        width = (self.knots[i + 1] - self.knots[i])[:, None]
        return span_derivatives(self.powers[i], (s - self.knots[i])[:, None] / width, width)

    def in_axes(self, moving: NDArray[np.bool_], rest: FloatArray) -> Spline:
        """The same in all axes, those at rest included, where ``rest`` (dim,) tells."""
        powers = np.zeros((self.powers.shape[0], moving.size, self.powers.shape[2]))
        powers[:, :, 0] = rest
        powers[:, moving] = self.powers
        return Spline(self.knots, powers, self.control, self.iterations)

    def places(self, s: FloatArray) -> FloatArray:
        """Positions (n, d) at s (n,)."""
        out = np.empty((s.size, self.powers.shape[1]))
        core.spline_places(*self.powers.shape[:2], self.knots, self.powers, s.size, s, out)
        return out

    def distances(self, points: FloatArray, s: FloatArray, lo: FloatArray, hi: FloatArray) -> FloatArray:
        """Distances (n,) of points (n, d) near s (n,), within [lo, hi]: as :func:`deviation.foot_distance`."""
        out = np.empty(s.size)
        points = np.ascontiguousarray(points)
        core.spline_distances(*self.powers.shape[:2], self.knots, self.powers, s.size, points, s, lo, hi, out)
        return out


def full_knots(knots: FloatArray) -> FloatArray:
    """The knot vector with its ends repeated, (n + 9,)."""
    return np.concatenate([[knots[0]] * DEGREE, knots, [knots[-1]] * DEGREE])


def greville(knots: FloatArray) -> FloatArray:
    """Greville abscissae of the control points, (n + 4,)."""
    full = full_knots(knots)
    count = full.size - DEGREE - 1
    return np.asarray(sum(full[1 + k : 1 + k + count] for k in range(DEGREE)) / DEGREE)


def basis_powers(knots: FloatArray) -> FloatArray:
    """The five B-splines of every interval as polynomials of its local parameter, (n, 5, 5): interval, B-spline, power.

    Cox-de Boor on coefficients: N_j,p = (s - k_j)/(k_j+p - k_j) N_j,p-1 + (k_j+p+1 - s)/(k_j+p+1 - k_j+1) N_j+1,p-1.
    """
    full = full_knots(knots)
    n = knots.size - 1
    span = np.arange(n) + DEGREE
    low, width = knots[:-1], np.diff(knots)
    out = np.zeros((n, DEGREE + 1, DEGREE + 1))
    out[:, 0, 0] = 1.0
    for p in range(1, DEGREE + 1):
        raised = np.zeros_like(out)
        for r in range(p + 1):  # B-spline span - p + r of degree p
            j = span - p + r
            if r > 0:
                gap = full[j + p] - full[j]
                raised[:, r, : p + 1] += ((low - full[j]) / gap)[:, None] * out[:, r - 1, : p + 1]
                raised[:, r, 1 : p + 1] += (width / gap)[:, None] * out[:, r - 1, :p]
            if r < p:
                gap = full[j + p + 1] - full[j + 1]
                raised[:, r, : p + 1] += ((full[j + p + 1] - low) / gap)[:, None] * out[:, r, : p + 1]
                raised[:, r, 1 : p + 1] -= (width / gap)[:, None] * out[:, r, :p]
        out = raised
    return out


def samples_of(knots: FloatArray, vertices: FloatArray) -> FloatArray:
    """Where the rows go: samples of every interval, and the vertices inside; of many, some evenly chosen."""
    inner = knots[:-1, None] + np.diff(knots)[:, None] * np.array(_SAMPLES)
    inside = vertices[(vertices > knots[0]) & (vertices < knots[-1])]
    interval = np.searchsorted(knots, inside, side="right") - 1
    count = np.bincount(interval, minlength=knots.size - 1)
    number = np.arange(inside.size) - (np.cumsum(count) - count)[interval]
    stride = np.ceil(count / _ROWS_AT_VERTICES).astype(np.intp)[interval]
    return np.union1d(inner.reshape(-1), inside[number % stride == stride // 2])


def smoothest(tube: Tube) -> Spline:
    """Solve a tube.

    Where rounding stops the iteration early, the spline is the last iterate: inside the tube, and less smooth.
    """
    basis = basis_powers(tube.knots)
    rows = _TubeRows.of(tube, basis)
    objective = _objective(tube, basis)
    control = tube.initial.copy()
    fixed = _fix_ends(tube, control)
    point = _interior_point(tube, rows, objective, control, fixed)
    index = np.arange(basis.shape[0])[:, None] + np.arange(DEGREE + 1)
    powers = np.einsum("nip,nid->ndp", basis, control[index])
    return Spline(tube.knots, powers, control, point)


@dataclass(frozen=True, eq=False)
class _TubeRows:
    """Rows a_k of the tube, scaled to half-width 1: first control point, coefficients (m, 5 d), offsets a_k . c - r_k."""

    first: NDArray[np.int64]
    rows: FloatArray
    offset: FloatArray
    dim: int

    @classmethod
    def of(cls, tube: Tube, basis: FloatArray) -> _TubeRows:
        """Normals first, then the tangents."""
        dim = tube.point.shape[1]
        i = np.clip(np.searchsorted(tube.knots, tube.abscissa, side="right") - 1, 0, basis.shape[0] - 1)
        w = (tube.abscissa - tube.knots[i]) / (tube.knots[i + 1] - tube.knots[i])
        value = np.einsum("nip,np->ni", basis[i], w[:, None] ** np.arange(DEGREE + 1))
        normals, share = _normals(tube.tangent)
        directions = [normal / (share * tube.half_width[:, None]) for normal in normals]
        directions.append(tube.tangent / (SLIP * tube.half_width[:, None]))
        stacked = np.concatenate([(value[:, :, None] * d[:, None, :]).reshape(w.size, -1) for d in directions])
        offset = np.concatenate([np.sum(d * tube.point, axis=1) for d in directions])
        first = np.tile(i, len(directions)).astype(np.int64)
        order = np.argsort(first, kind="stable")
        return cls(first[order], np.ascontiguousarray(stacked[order]), offset[order], dim)


def _normals(tangent: FloatArray) -> tuple[list[FloatArray], float]:
    """Unit normals of the tangents (m, d), and the share of the tolerance that each may use."""
    if tangent.shape[1] == 2:
        return [np.column_stack([-tangent[:, 1], tangent[:, 0]])], 1.0
    half = np.sqrt(0.5)
    if tangent.shape[1] == 3:
        least = np.eye(3)[np.argmin(np.abs(tangent), axis=1)]
        n1 = np.cross(tangent, least)
        n1 /= np.sqrt(np.sum(n1**2, axis=1))[:, None]
        n2 = np.cross(tangent, n1)
        return [n1, n2, half * (n1 + n2), half * (n1 - n2)], _OCTAGON
    across = _across(tangent)
    pairs = [half * (a + sign * b) for a, b in combinations(across, 2) for sign in (1.0, -1.0)]
    # The corners of |x_i| <= 1, |x_i +- x_j| <= sqrt(2) are (1, sqrt(2) - 1, ..) and (1, 1, ..) / sqrt(2).
    count = len(across)
    farthest = max(1.0 + (count - 1) * (np.sqrt(2.0) - 1.0) ** 2, 0.5 * count)
    return [*across, *pairs], float(1.0 / np.sqrt(farthest))


def _across(tangent: FloatArray) -> list[FloatArray]:
    """Orthonormal vectors across unit tangents (m, d), d - 1 of (m, d): Householder's reflection of one axis onto each."""
    rows, dim = np.arange(tangent.shape[0]), tangent.shape[1]
    main = np.argmax(np.abs(tangent), axis=1)
    mirror = tangent.copy()
    mirror[rows, main] += np.copysign(1.0, tangent[rows, main])
    square = np.sum(mirror**2, axis=1)
    out = []
    for step in range(1, dim):
        axis = (main + step) % dim
        normal = -2.0 * mirror * (mirror[rows, axis] / square)[:, None]
        normal[rows, axis] += 1.0
        out.append(normal)
    return out


def _objective(tube: Tube, basis: FloatArray) -> FloatArray:
    """Band (5 d, N) of the integral of w |q'''|^2, by two Gauss points an interval, which is exact."""
    dim = tube.point.shape[1]
    n = basis.shape[0]
    width = np.diff(tube.knots)
    band = np.zeros(((DEGREE + 1) * dim, (n + DEGREE) * dim))
    first = np.arange(n, dtype=np.int64)
    for gauss in (0.5 - np.sqrt(1.0 / 12.0), 0.5 + np.sqrt(1.0 / 12.0)):
        third = (6.0 * basis[:, :, 3] + 24.0 * gauss * basis[:, :, 4]) / width[:, None] ** 3
        for j in range(dim):
            rows = np.zeros((n, DEGREE + 1, dim))
            rows[:, :, j] = third
            core.tube_add_rows(n, rows[0].size, dim, first, rows, 0.5 * tube.weight * width, band.shape[1], band)
    return band


def _fix_ends(tube: Tube, control: FloatArray) -> NDArray[np.intp]:
    """Set the control points that the ends determine, one for each derivative given; returns their indices.

    The k-th derivative at a clamped end is the first control point of the k-times differenced spline: from the derivatives
    the control points follow level by level.  Signed steps serve both ends.
    """
    fixed: list[int] = []
    for data, at, inward, steps in (
        (tube.start, 0, 1, tube.knots[1:4] - tube.knots[0]),
        (tube.end, control.shape[0] - 1, -1, (tube.knots[-4:-1] - tube.knots[-1])[::-1]),
    ):
        # level[k] holds the first control points of the k-th derivative, as many as are known so far
        level = [data[0]]
        control[at] = data[0]
        fixed.append(at)
        for k in range(1, data.shape[0]):
            # c_(i+1) of level j is c_i + step * (c_i of level j + 1); the outermost difference is the new derivative
            following = [data[k]]
            for j in range(k - 1, -1, -1):
                gap = steps[k - 1 - j]
                following.append(level[j] + following[-1] * gap / (DEGREE - j))
            level = following[::-1]
            control[at + k * inward] = level[0]
            fixed.append(at + k * inward)
    return np.unique(np.array(fixed, dtype=np.intp))


def _interior_point(
    tube: Tube, rows: _TubeRows, objective: FloatArray, control: FloatArray, fixed: NDArray[np.intp]
) -> int:
    """Minimise over the control points in place; returns the number of iterations."""
    frozen = (fixed[:, None] * rows.dim + np.arange(rows.dim)).reshape(-1).astype(np.int64)
    # Scaled so that moving by the tolerance is felt like one unit of the objective.
    scale = 1.0 / float(np.median(objective[0]) * np.median(tube.half_width) ** 2)
    count, width = rows.rows.shape
    return int(
        core.tube_solve(
            *(count, width, rows.dim, rows.first, rows.rows, rows.offset),
            *(control.size, objective * scale, frozen.size, frozen),
            *(control, np.empty(core.tube_solve_work(count, width, control.size))),
        )
    )
