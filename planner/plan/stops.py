"""Where a plan stops: in corners, and in bends so tight that a machine takes them as corners.

A bend of radius R is passed at no more than min((A R)^(1/2), (J R^2)^(1/3)).  Below a radius of about 8e-4 A^3 / J^2, 2 um
for 1000 mm/s^2 and 20000 mm/s^3, that is nearly a stop: passing it saves a few hundredths of a second.  Where such a
bend is hidden in a span a thousand times its size and more, a plan would need nodes at the scale of nanometres to pass it;
there it is an exact stop.  So is one that the digits of the plan, or the period, cannot tell from a corner.  A fillet that
is a span of its own is resolved, and passed, however small it is.

The curvature of a spline rises steeply where |C'| nearly vanishes, over a stretch that is short against a knot span.  So
what is looked for is, on every piece, the highest of the curvatures sampled and the least |C'|; each is refined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.compiled import core
from planner.geometry.curve import Curve
from planner.geometry.differential import dot
from planner.machine.limits import Limits
from planner.types import FloatArray

_MIN_RADIUS = 8e-4  # times A^3 / J^2
_SAMPLES = 16  # a piece, as in stops.c
_BLOCK = 4096  # pieces at a time, which bounds the memory
_HIDDEN = 1e3  # length of its span over the radius of a bend
# Radius over the extent of the path, and over the way that a digit of u is worth, below which a plan cannot tell a bend from
# a corner: passing it takes no longer than the nodes must be apart.
_OF_EXTENT, _OF_DIGIT = 1e-9, 1e6
# Radius over J T^3, and over A T^2, below which the bend is over within the periods that passing it would save.
_OF_PERIODS = 6.0
_APART = 4.0  # times the smallest radius: bends closer than this along the path are one


@dataclass(frozen=True)
class Bend:
    """A bend taken as a corner: its parameter and its radius, mm of the axes as ``axis_weights`` weighs them."""

    u: float
    radius: float


def smallest_radius(limits: Limits, weights: FloatArray) -> float:
    """Radius below which a bend is a corner, in weighted units; 0 where the acceleration has no limit."""
    acceleration, jerk = float((weights * limits.acceleration).min()), float((weights * limits.jerk).min())
    if np.isinf(acceleration):
        return 0.0
    within = min(_OF_PERIODS * jerk * limits.period**3, acceleration * limits.period**2)
    return within if np.isinf(jerk) else max(within, _MIN_RADIUS * acceleration * (acceleration / jerk) ** 2)


def exact_stops(
    curve: Curve, limits: Limits, weights: FloatArray, *, at_jumps: bool, bends: bool = True, hidden: bool = True
) -> dict[float, float]:
    """Parameters of a curve at which a plan stops, each with the radius, mm, of the bend whose tip it is; 0 in a corner.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    weights : (dim,) array
        What makes the axes comparable.
    at_jumps : bool
        Stop at curvature jumps too, which else are passed slowly.
    bends : bool
        Stop in bends that are corners to this machine.
    hidden : bool
        Only in those hidden in a much longer span; else in all of them.
    """
    stops = {b.u: 0.0 for b in curve.breaks if b.is_corner or (at_jumps and b.is_curvature_jump)}
    if bends:
        stops |= {bend.u: bend.radius for bend in tight_bends(curve, limits, weights, hidden=hidden)}
    return stops


def tight_bends(curve: Curve, limits: Limits, weights: FloatArray, *, hidden: bool = True) -> list[Bend]:
    """Find the bends of a curve that are corners to a machine, in order of u; all tight ones without ``hidden``."""
    radius = smallest_radius(limits, weights)
    edges = curve.pieces.breaks
    extent = np.ptp(curve.pieces.evaluate(edges, 0, False)[0] * weights, axis=0)
    radius = max(radius, _OF_EXTENT * float(np.sqrt(dot(extent, extent))))

    found = [
        _sharpest(curve, weights, radius, first, min(_BLOCK, edges.size - 1 - first))
        for first in range(0, edges.size - 1, _BLOCK)
    ]
    return _separate(curve, weights, radius, _HIDDEN if hidden else 0.0, found)


def _sharpest(
    curve: Curve, weights: FloatArray, radius: float, first: int, count: int
) -> tuple[FloatArray, FloatArray]:
    """Places and curvatures of what may be tight bends on ``count`` pieces from the first on."""
    scratch = np.empty((6, _SAMPLES * count))
    found = np.empty((2, 2 * _SAMPLES * count))
    size = core.stops_sharpest(*curve.pieces.arguments, weights, first, count, radius, _OF_DIGIT, scratch, *found)
    # first those found from the least |C'| beside a sample, then those from the sample itself
    u, bend = found[:, :size].reshape(2, -1, 2).transpose(0, 2, 1).reshape(2, -1)
    return u, bend


def _unresolved(curve: Curve, weights: FloatArray, u: FloatArray) -> FloatArray:
    """Radius below which the digits of u do not resolve a bend, at each parameter."""
    length, width = _span_length(curve, weights, u)
    return _OF_DIGIT * np.spacing(np.abs(u)) * length / width


def _span_length(curve: Curve, weights: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Length, and width in u, of the piece of the curve at each parameter."""
    edges = curve.pieces.breaks
    piece = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, edges.size - 2)
    width = edges[piece + 1] - edges[piece]
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    some, which = np.unique(piece, return_inverse=True)
    inside = edges[some, None] + (edges[some + 1] - edges[some])[:, None] * share
    velocity = curve.pieces.evaluate(inside.reshape(-1), 1, False)[1] * weights
    mean = np.sqrt(dot(velocity, velocity)).reshape(inside.shape).mean(axis=1)
    return mean[which] * width, width


def _separate(
    curve: Curve, weights: FloatArray, radius: float, hidden: float, found: list[tuple[FloatArray, FloatArray]]
) -> list[Bend]:
    """Of the peaks above the limit, those that are not one bend with a sharper one; none at the ends of the curve."""
    u, bend = (np.concatenate(parts) for parts in zip(*found, strict=True))
    if u.size == 0:
        return []
    local = np.maximum(radius, _unresolved(curve, weights, u))
    sharp = np.flatnonzero((bend * local > 1.0) & (bend * _span_length(curve, weights, u)[0] > hidden))
    sharp = sharp[np.argsort(-bend[sharp], kind="stable")]
    kept: list[int] = []
    points = curve.pieces.evaluate(u, 0, False)[0] * weights
    ends = curve.pieces.evaluate(np.array(curve.domain), 0, False)[0] * weights
    taken = ends
    for i in sharp:
        if np.sqrt(((taken - points[i]) ** 2).sum(axis=1)).min() > _APART * local[i]:
            kept.append(int(i))
            taken = np.vstack([taken, points[i]])
    at = _on_breaks(curve, weights, u[kept], points[kept], _APART * local[kept])
    return sorted(
        (Bend(float(x), 1.0 / float(bend[i])) for x, i in zip(at, kept, strict=True)), key=lambda bend: bend.u
    )


def _on_breaks(curve: Curve, weights: FloatArray, u: FloatArray, points: FloatArray, near: FloatArray) -> FloatArray:
    """Parameters of bends, moved onto a break that is as near as to be the same place."""
    breaks = curve._candidate_breaks()
    if breaks.size == 0 or u.size == 0:
        return u
    after = np.clip(np.searchsorted(breaks, u), 0, breaks.size - 1)
    moved = u.copy()
    for k in (np.maximum(after - 1, 0), after):
        there = curve.pieces.evaluate(breaks[k], 0, False)[0] * weights
        moved = np.where(np.sqrt(((there - points) ** 2).sum(axis=1)) <= near, breaks[k], moved)
    return np.asarray(moved)
