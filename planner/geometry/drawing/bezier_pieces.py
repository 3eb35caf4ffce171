"""Lines, arcs, ellipses, bulges and splines as Bezier segments, exactly; and what an affine map makes of them.

A rational Bezier segment has control points P_i with weights w_i; kept are the homogeneous points (w P, w), on which a map
x -> x M + t acts as (w P) M + w t: a circle in a block that is scaled by different factors is an ellipse, exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb

import numpy as np

from planner.errors import CurveError
from planner.geometry.curve import MAX_COORDINATE
from planner.geometry.nurbs import NurbsCurve
from planner.types import FloatArray

_STRAIGHT = 1e-9  # rad: an arc that turns less is a line, to what a joint counts as smooth
_MAX_ARC = 0.5 * np.pi  # of one Bezier segment: beyond a half turn there is none, below the speed is more even


@dataclass(frozen=True, eq=False)
class Piece:
    """Bezier segments of one entity: homogeneous points (m, degree + 1, 4), w times X, Y, Z, and w; widths (m,)."""

    points: FloatArray
    widths: FloatArray

    @property
    def start(self) -> FloatArray:
        """Where it begins, (3,)."""
        return np.asarray(self.points[0, 0, :3] / self.points[0, 0, 3])

    @property
    def end(self) -> FloatArray:
        """Where it ends, (3,)."""
        return np.asarray(self.points[-1, -1, :3] / self.points[-1, -1, 3])

    @property
    def length(self) -> float:
        """Length, near enough to set a parameter by: that of a polyline of 33 points a segment."""
        p = self.points.shape[1] - 1
        w = np.linspace(0.0, 1.0, 33)
        basis = np.stack([comb(p, i) * w**i * (1.0 - w) ** (p - i) for i in range(p + 1)])
        values = np.einsum("iw,mic->mwc", basis, self.points)
        return float(np.linalg.norm(np.diff(values[..., :3] / values[..., 3:], axis=1), axis=2).sum())

    def reversed(self) -> Piece:
        """The same, run from its end to its start."""
        return Piece(self.points[::-1, ::-1], self.widths[::-1])

    def starting_at(self, point: FloatArray) -> Piece:
        """The same with its first control point moved."""
        points = self.points.copy()
        points[0, 0, :3] = point * points[0, 0, 3]
        return Piece(points, self.widths)

    def mapped(self, matrix: FloatArray) -> Piece:
        """What an affine map makes of it; (4, 4), for points in rows: [x y z 1] times the matrix."""
        points = self.points.copy()
        points[..., :3] = self.points[..., :3] @ matrix[:3, :3] + self.points[..., 3:] * matrix[3, :3]
        return Piece(points, self.widths)

    def raised(self, degree: int) -> FloatArray:
        """The segments with a higher degree: Q_j = sum_i C(p, i) C(r, j - i) / C(p + r, j) P_i, r the difference."""
        p = self.points.shape[1] - 1
        matrix = np.zeros((degree + 1, p + 1))
        for j in range(degree + 1):
            for i in range(max(0, j - degree + p), min(p, j) + 1):
                matrix[j, i] = comb(p, i) * comb(degree - p, j - i) / comb(degree, j)
        return np.einsum("ji,mic->mjc", matrix, self.points)


def line(start: FloatArray, end: FloatArray) -> Iterator[Piece]:
    """A line from a point to another, (3,); none where they are one."""
    length = float(np.linalg.norm(end - start))
    if length > 0.0:
        yield Piece(np.array([[[*start, 1.0], [*end, 1.0]]]), np.array([length]))


def arc(centre: FloatArray, radius: float, first: float, sweep: float) -> Piece:
    """A circular arc in the plane of X and Y: equal rational quadratics, with the middle weight cos of half their angle."""
    count = max(1, int(np.ceil(abs(sweep) / _MAX_ARC - 1e-9)))
    angles = first + sweep * np.arange(2 * count + 1) / (2 * count)
    weight = np.tile([1.0, np.cos(0.5 * sweep / count)], count + 1)[: angles.size]
    # The middle point lies at radius / weight: times its weight it is at the radius, as the ends are.
    spokes = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(angles.size)], axis=1)
    points = np.column_stack([spokes + weight[:, None] * centre, weight])
    if abs(abs(sweep) - 2.0 * np.pi) < 1e-12:
        points[-1] = points[0]
    rows = 2 * np.arange(count)[:, None] + np.arange(3)
    return Piece(points[rows], np.full(count, radius * abs(sweep) / count))


def ellipse(axes: FloatArray, centre: FloatArray, first: float, sweep: float) -> Piece:
    """An elliptic arc, centre + cos t major + sin t minor, ``axes`` (2, 3) the two: the image of a circular one."""
    matrix = np.zeros((4, 4))
    matrix[:2, :3] = axes
    matrix[3, :3] = centre
    return arc(np.zeros(3), 1.0, first, sweep).mapped(matrix)


def bulged(start: FloatArray, end: FloatArray, bulge: float, label: str) -> Iterator[Piece]:
    """A side of a polyline: a line, or an arc where there is a bulge, the tangent of a quarter of its angle.

    The arc is made from its chord c, without the centre, which lies far away for a small bulge.  With the sweep t, the point
    after an angle a is c sin(a/2) / sin(t/2), turned by (a - t)/2; the middle control points lie on the tangents there.
    """
    chord = end - start
    sweep = 4.0 * np.arctan(bulge)
    if abs(sweep) < _STRAIGHT or not chord.any():
        yield from line(start, end)
        return
    sine = 2.0 * bulge / (1.0 + bulge**2)  # of half the sweep
    length = float(np.linalg.norm(chord)) * 0.5 * sweep / sine
    if not abs(length) <= MAX_COORDINATE:
        raise CurveError(
            f"{label}: bulge = {bulge:.6g} makes an arc of {abs(length):.3g} mm; at most {MAX_COORDINATE:g} mm"
        )
    count = max(1, int(np.ceil(abs(sweep) / _MAX_ARC - 1e-9)))
    half = 0.5 * sweep / count  # of a segment
    angle = half * np.arange(2 * count + 1)
    weight = np.tile([1.0, np.cos(half)], count + 1)[: angle.size]
    points = start + _turned(chord, 0.5 * (angle - sweep)) * (np.sin(0.5 * angle) / sine)[:, None]
    points[-1] = end
    step = np.tan(half) / (2.0 * sine)
    points[1::2] = points[:-1:2] + step * _turned(chord, angle[:-1:2] - 0.5 * sweep)
    rows = 2 * np.arange(count)[:, None] + np.arange(3)
    homogeneous = np.column_stack([points * weight[:, None], weight])
    yield Piece(homogeneous[rows], np.full(count, length / count))


def _turned(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """A vector turned in its plane by angles (n,), (n, 3)."""
    x, y, z = vector
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y, np.full(angle.size, z)], axis=1)


def spline(points: FloatArray, knots: list[float], degree: int, weights: list[float] | None, label: str) -> Piece:
    """A B-spline as Bezier segments: its power-basis pieces in the basis of Bernstein."""
    curve = NurbsCurve(points, knots, degree, weights, None, label)
    power = curve.pieces.powers
    p = power.shape[2] - 1
    matrix = np.array([[comb(j, i) / comb(p, i) if i <= j else 0.0 for i in range(p + 1)] for j in range(p + 1)])
    return Piece(np.einsum("ji,mci->mjc", matrix, power), np.diff(curve.pieces.breaks))


def joined(chain: list[Piece]) -> tuple[FloatArray, FloatArray, int, FloatArray]:
    """Control points (n, 3), knots, degree and weights of the B-spline that the pieces are one after the other.

    Where ends differ by a rounding, the later one gives way.
    """
    degree = max(piece.points.shape[1] - 1 for piece in chain)
    points: list[FloatArray] = []
    widths: list[float] = []
    for piece in chain:
        segments = piece.raised(degree)
        if points:
            segments = segments * (points[-1][-1, 3] / segments[0, 0, 3])
            segments[0, 0] = points[-1][-1]
        points.extend(segments)
        # The parameter runs with the arc length, so that it has no needless jumps of speed.
        widths.extend((piece.widths * (piece.length / piece.widths.sum())).tolist())
    homogeneous = np.concatenate([points[0], *(segment[1:] for segment in points[1:])])
    edges = np.append(0.0, np.cumsum(widths))
    knots = np.concatenate([[edges[0]], np.repeat(edges, degree), [edges[-1]]])
    weights = homogeneous[:, 3]
    return homogeneous[:, :3] / weights[:, None], knots, degree, weights / weights[0]
