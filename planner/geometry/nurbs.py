"""Non-uniform rational B-splines of any degree, in 2 to 6 machine axes.

The control polygon is turned once into power-basis pieces (de Boor's derivative control points at each span), and only
those are evaluated: one code for the planner, the check and the real-time side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import CurveError
from planner.geometry.curve import DEFAULT_AXES, Curve, Pieces, axis_names, require_regular
from planner.inputs import numbers, shorten
from planner.sets import union
from planner.types import BoolArray, FloatArray

MAX_DEGREE = 100  # a bound on the work; the digits would last longer
# Sum of a denominator's coefficients against its value: loses one of 16 digits.
_MAX_CANCELLATION = 8.0
_DIGITS_OF_A_PART = 2.0**20


@dataclass(frozen=True, eq=False, repr=False)
class NurbsCurve(Curve):
    """A (rational) B-spline curve.

        C(u) = sum_i w_i P_i N_{i,p}(u) / sum_i w_i N_{i,p}(u),   u in [knots[p], knots[n]]

    Parameters
    ----------
    control_points : (n, dim) array_like
        Axis positions, mm (rad for the axes A, B, C).
    knots : (n + degree + 1,) array_like
        Non-decreasing; an interior knot at most ``degree`` times.
    degree : int
        Polynomial degree p (the order less one).
    weights : (n,) array_like, optional
        Positive; 1 if left out.
    axes : sequence of str, optional
        Names; X, Y, Z, U, V, W if left out.
    name : str
        For messages.

    Raises
    ------
    CurveError
        For a malformed definition, a curve of length 0, or a cusp.
    """

    control_points: FloatArray
    knots: FloatArray
    degree: int
    weights: FloatArray
    axes: tuple[str, ...]
    name: str

    def __init__(
        self,
        control_points: ArrayLike,
        knots: ArrayLike,
        degree: int,
        weights: ArrayLike | None = None,
        axes: Sequence[str] | None = None,
        name: str = "nurbs",
        *,
        rests_allowed: bool = False,
    ) -> None:
        points, knot_vector = _finite(control_points, "control_points", name), _finite(knots, "knots", name)
        if points.ndim != 2 or not 2 <= points.shape[1] <= len(DEFAULT_AXES):
            raise CurveError(f"{name}: control_points has shape {points.shape}; it must be (n, dim) with 2 <= dim <= 6")
        count, dim = points.shape
        weight = np.ones(count) if weights is None else _finite(weights, "weights", name)
        _validate(points, knot_vector, degree, weight, name)
        for array in (points, knot_vector, weight):
            array.setflags(write=False)
        for field, value in (
            ("control_points", points),
            ("knots", knot_vector),
            ("degree", int(degree)),
            ("weights", weight),
            ("axes", axis_names(axes, dim, name)),
            ("name", name),
        ):
            object.__setattr__(self, field, value)
        if not np.isfinite(self.pieces.coefficients).all():
            raise CurveError(f"{name}: control points, weights or knot spacings exceed the range of double precision")
        if not rests_allowed:
            require_regular(self)

    @property
    def domain(self) -> tuple[float, float]:  # type: ignore[override]
        """Parameter range [knots[degree], knots[n]]."""
        return float(self.knots[self.degree]), float(self.knots[-self.degree - 1])

    def _evaluate(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        return self.pieces.evaluate(u, order, left)

    def _candidate_breaks(self) -> FloatArray:
        return self._spans[1:-1]

    @cached_property
    def _spans(self) -> FloatArray:
        """Distinct knots within the domain, ends included."""
        u0, u1 = self.domain
        return union(self.knots[(self.knots >= u0) & (self.knots <= u1)])

    @cached_property
    def pieces(self) -> Pieces:
        """The curve as power-basis pieces, exact but for rounding.

        Rounding grows with the sum of a piece's coefficients against its value, so spans are split where that is large.
        A polynomial of degree p on 1/m of its span has coefficients up to (1 + 2/m)^p times the control points:
        m = p - 1 keeps the factor below 8, and 27 is left of a whole cubic span.  Denominators that fall from large to
        small weights within a span are halved until they no longer cancel.
        """
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            breaks = _subdivide(self._spans, 1 if self.degree <= 3 else self.degree - 1)
            rational = bool(np.any(self.weights != self.weights[0]))
            while rational:
                denominator = self._taylor(self._acting(self.weights[:, None], breaks), breaks)[:, 0]
                least = np.minimum(denominator[:, 0], denominator.sum(axis=1))
                cancels = np.abs(denominator).sum(axis=1) > _MAX_CANCELLATION * least
                cancels &= np.diff(breaks) > 64.0 * np.spacing(np.abs(breaks).max())
                if not cancels.any():
                    break
                breaks = np.sort(np.append(breaks, 0.5 * (breaks[:-1] + breaks[1:])[cancels]))
            points, weights = (self._acting(of, breaks) for of in (self.control_points, self.weights[:, None]))
            origin = np.zeros((breaks.size - 1, self.dim))
            if rational:
                start = self._taylor(np.concatenate([points * weights, weights], axis=2), breaks)[:, :, 0]
                origin = start[:, :-1] / start[:, -1:]
                points = points - origin[:, None]
            coefficients = self._taylor(np.concatenate([points * weights, weights], axis=2), breaks)
            resting = np.asarray(np.ptp(points, axis=1) == 0.0)
        if not rational:
            coefficients /= self.weights[0]
            coefficients[:, -1] = 0.0
            coefficients[:, -1, 0] = 1.0
        return Pieces(breaks, coefficients, rational, resting, origin)

    def _acting(self, rows: FloatArray, breaks: FloatArray) -> FloatArray:
        """Rows (n, columns) of the degree + 1 control points that act on each piece, (m, degree + 1, columns)."""
        span = np.searchsorted(self.knots, breaks[:-1], side="right") - 1
        return np.asarray(rows[span[:, None] + np.arange(-self.degree, 1)])

    def _taylor(self, points: FloatArray, breaks: FloatArray) -> FloatArray:
        """Taylor coefficients (m, columns, degree + 1) at the start of each piece, in units of its width.

        ``points``: those that act on each piece, (m, degree + 1, columns).

        The k-th derivative there is a B-spline of the k-times differenced control points, so that each coefficient
        costs one de Boor evaluation and none is differenced from nearby numbers.
        """
        p = self.degree
        span = np.searchsorted(self.knots, breaks[:-1], side="right") - 1
        width = np.diff(breaks)[:, None]
        coefficients = np.empty((span.size, points.shape[2], p + 1))
        differenced = points
        for k in range(p + 1):
            coefficients[:, :, k] = self._de_boor(differenced, span, breaks[:-1])
            if k < p:
                index = span[:, None] + np.arange(k - p + 1, 1)
                gap = self.knots[index + p - k] - self.knots[index]
                differenced = ((p - k) / (k + 1) * width / gap)[..., None] * np.diff(differenced, axis=1)
        return coefficients

    def _de_boor(self, points: FloatArray, span: NDArray[np.intp], at: FloatArray) -> FloatArray:
        """De Boor's triangle at a parameter of each span: (m, r + 1, dim) control points of degree r to (m, dim)."""
        for r in range(points.shape[1] - 1, 0, -1):
            index = span[:, None] + np.arange(-r + 1, 1)
            left, right = self.knots[index], self.knots[index + r]
            blend = ((at[:, None] - left) / (right - left))[..., None]
            points = (1.0 - blend) * points[:, :-1] + blend * points[:, 1:]
        return points[:, 0]

    def definition(self) -> Mapping[str, Any]:
        """Degree, knots, control points, weights and axes."""
        return {
            "type": "nurbs",
            "degree": self.degree,
            "knots": self.knots.tolist(),
            "control_points": self.control_points.tolist(),
            "weights": self.weights.tolist(),
            "axes": list(self.axes),
        }


def _subdivide(edges: FloatArray, parts: int) -> FloatArray:
    """Split every interval into equal parts, but for those in which a digit of u is a share of a part."""
    if parts == 1:
        return edges
    steps = np.arange(1, parts) / parts
    wide = np.diff(edges) > _DIGITS_OF_A_PART * parts * np.spacing(np.abs(edges).max())
    inner = edges[:-1][wide, None] + np.diff(edges)[wide, None] * steps
    return union(edges, inner)


def _finite(values: ArrayLike, what: str, name: str) -> FloatArray:
    array = numbers(values, f"{name}: {what}", CurveError)
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        index = "".join(f"[{i}]" for i in place)
        raise CurveError(f"{name}: {what}{index} = {array[place]} must be finite")
    return array


def _validate(points: FloatArray, knots: FloatArray, degree: int, weights: FloatArray, name: str) -> None:
    count = points.shape[0]
    if isinstance(degree, bool) or not isinstance(degree, int | np.integer) or not 1 <= degree <= MAX_DEGREE:
        raise CurveError(f"{name}: degree = {shorten(repr(degree))} must be an integer from 1 to {MAX_DEGREE}")
    if count < degree + 1:
        raise CurveError(f"{name}: {count} control points are too few; degree {degree} needs at least {degree + 1}")
    if knots.shape != (count + degree + 1,):
        raise CurveError(
            f"{name}: knots has length {knots.size}; {count} control points of degree {degree} need "
            f"{count + degree + 1}"
        )
    falling = np.flatnonzero(np.diff(knots) < 0.0)
    if falling.size:
        i = int(falling[0]) + 1
        raise CurveError(
            f"{name}: knots[{i}] = {float(knots[i])!r} is less than knots[{i - 1}] = {float(knots[i - 1])!r}; "
            "knots must not decrease"
        )
    if knots[degree] >= knots[count]:
        raise CurveError(
            f"{name}: knots[{degree}] = knots[{count}] = {float(knots[degree])!r}; "
            "the parameter range must not be empty"
        )
    inner, times = np.unique(knots, return_counts=True)
    over = np.flatnonzero((times > degree) & (inner > knots[degree]) & (inner < knots[count]))
    if over.size:
        i = int(over[0])
        raise CurveError(
            f"{name}: knot {float(inner[i])!r} appears {times[i]} times; inside the range at most degree = {degree}"
        )
    if weights.shape != (count,):
        raise CurveError(
            f"{name}: weights has length {weights.size}; one for each of the {count} control points is needed"
        )
    if (weights <= 0.0).any():
        i = int(np.argmax(weights <= 0.0))
        raise CurveError(f"{name}: weights[{i}] = {float(weights[i])!r} must be > 0")
