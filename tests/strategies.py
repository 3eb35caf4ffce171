"""Oracles and random curves that several test modules share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.geometry.nurbs import NurbsCurve

Array = NDArray[np.float64]


def cox_de_boor(knots: Sequence[Any], degree: int, span: int, u: Any) -> list[Any]:
    """Basis functions N_{span-p,p}..N_{span,p} at u, by the recurrence that defines them, as polynomials of one span.

    A parameter outside the span evaluates the continuation of its polynomials, so that derivatives at a knot are those
    of one side.
    """
    row = {span: mpmath.mpf(1)}
    for p in range(1, degree + 1):
        following: dict[int, Any] = {}
        for i in range(span - p, span + 1):
            total = mpmath.mpf(0)
            if i in row:
                total += (u - knots[i]) / (knots[i + p] - knots[i]) * row[i]
            if i + 1 in row:
                total += (knots[i + p + 1] - u) / (knots[i + p + 1] - knots[i + 1]) * row[i + 1]
            following[i] = total
        row = following
    return [row[i] for i in range(span - degree, span + 1)]


def exact_nurbs(curve: NurbsCurve, span: int) -> Callable[[Any], list[Any]]:
    """The rational polynomial of one span, in as many digits as mpmath is set to."""
    knots = [mpmath.mpf(float(knot)) for knot in curve.knots]
    chosen = range(span - curve.degree, span + 1)
    weights = [mpmath.mpf(float(curve.weights[i])) for i in chosen]
    points = [[mpmath.mpf(float(x)) for x in curve.control_points[i]] for i in chosen]

    def at(u: Any) -> list[Any]:
        blend = [w * n for w, n in zip(weights, cox_de_boor(knots, curve.degree, span, u), strict=True)]
        denominator = mpmath.fsum(blend)
        return [mpmath.fdot(blend, column) / denominator for column in zip(*points, strict=True)]

    return at


def derivatives_of(f: Callable[[Any], Sequence[Any]], u: float, dim: int) -> Array:
    """Value and three derivatives (4, dim) of a vector function, by differences in 50 digits."""
    with mpmath.workdps(50):
        at = mpmath.mpf(float(u))
        h = mpmath.mpf(10) ** -9  # truncation h^4 f^(7), rounding 1e-50/h^3: both far below double precision
        rows = {k: f(at + k * h) for k in (-3, -2, -1, 0, 1, 2, 3)}
        out = np.empty((4, dim))
        for j in range(dim):
            v = {k: row[j] for k, row in rows.items()}
            out[0, j] = v[0]
            out[1, j] = (45 * (v[1] - v[-1]) - 9 * (v[2] - v[-2]) + v[3] - v[-3]) / (60 * h)
            out[2, j] = (270 * (v[1] + v[-1]) - 27 * (v[2] + v[-2]) + 2 * (v[3] + v[-3]) - 490 * v[0]) / (180 * h**2)
            out[3, j] = (-13 * (v[1] - v[-1]) + 8 * (v[2] - v[-2]) - (v[3] - v[-3])) / (8 * h**3)
        return out


def span_of(curve: NurbsCurve, u: float, side: str) -> int:
    """Index of the knot span that holds u, from the side given."""
    spans = [i for i in range(curve.degree, len(curve.control_points)) if curve.knots[i] < curve.knots[i + 1]]
    if side == "right":
        inside = [i for i in spans if curve.knots[i] <= u < curve.knots[i + 1]]
        return inside[0] if inside else spans[-1]
    inside = [i for i in spans if curve.knots[i] < u <= curve.knots[i + 1]]
    return inside[0] if inside else spans[0]


def oracle(curve: NurbsCurve, u: float, side: str) -> Array:
    """Derivatives 0..3 (4, dim) of a NURBS curve from one side, by Cox-de Boor in 50 digits."""
    with mpmath.workdps(50):
        return derivatives_of(exact_nurbs(curve, span_of(curve, u, side)), u, curve.dim)


def insert_knot(curve: NurbsCurve, u: float) -> NurbsCurve:
    """The same curve with one more knot (Boehm's algorithm)."""
    p, knots = curve.degree, curve.knots
    span = span_of(curve, u, "right")
    homogeneous = np.column_stack([curve.control_points * curve.weights[:, None], curve.weights])
    rows = []
    for i in range(len(homogeneous) + 1):
        if i <= span - p:
            rows.append(homogeneous[i])
        elif i > span:
            rows.append(homogeneous[i - 1])
        else:
            share = (u - knots[i]) / (knots[i + p] - knots[i])
            rows.append((1.0 - share) * homogeneous[i - 1] + share * homogeneous[i])
    table = np.array(rows)
    return NurbsCurve(
        table[:, :-1] / table[:, -1:], np.insert(knots, span + 1, u), p, table[:, -1], curve.axes, "with one more knot"
    )


def random_nurbs(
    seed: int, degree: int, dim: int, *, spans: int = 4, rational: bool = True, clamped: bool = True, repeat: int = 1
) -> NurbsCurve:
    """A curve that wanders along the diagonal, so that it has no cusp; one interior knot is repeated."""
    rng = np.random.default_rng(seed)
    inner = np.sort(rng.uniform(0.1, 0.9, spans - 1)) if spans > 1 else np.empty(0)
    if inner.size:
        inner = np.sort(np.append(inner, np.repeat(inner[inner.size // 2], min(repeat, degree) - 1)))
    if clamped:
        ends = np.zeros(degree + 1), np.ones(degree + 1)
    else:
        steps = np.cumsum(rng.uniform(0.05, 0.3, degree))
        ends = np.append(-steps[::-1], 0.0), np.append(1.0, 1.0 + steps)
    knots = np.concatenate([ends[0], inner, ends[1]])
    count = knots.size - degree - 1
    points = 10.0 * np.arange(count)[:, None] + rng.uniform(-4.0, 4.0, (count, dim))
    weights = rng.uniform(0.5, 2.0, count) if rational else None
    return NurbsCurve(points, knots, degree, weights)


@st.composite
def nurbs_curves(draw: st.DrawFn, max_degree: int = 5) -> NurbsCurve:
    """Random NURBS curves of several degrees and dimensions, with a repeated knot now and then."""
    degree = draw(st.integers(2, max_degree))
    return random_nurbs(
        draw(st.integers(0, 10_000)),
        degree,
        draw(st.integers(2, 6)),
        spans=draw(st.integers(1, 5)),
        rational=draw(st.booleans()),
        clamped=draw(st.booleans()),
        repeat=draw(st.integers(1, degree)),
    )
