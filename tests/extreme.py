"""Seeded NURBS curves and machines at the edges of what is allowed.

Degrees 1..7, weights 1e-3..1e3, repeated and crowded knots, parameter ranges far from 0, near-cusps, axes that rest,
straight lines in odd parametrisations, 1e-6..1e8 mm, 2..6 axes; limits up to 1e6 apart, some of them inf, periods
1e-4..5e-3 s.  Two thirds of the curves have no near-cusp by construction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits

Array = NDArray[np.float64]

SHAPES = ("wander", "random", "line", "crowded", "repeated", "resting")
_LINEAR, _ROTARY = ("X", "Y", "Z", "U", "V", "W"), ("A", "B", "C")


@dataclass(frozen=True)
class Case:
    """A control polygon and its machine; the curve is built by :meth:`curve`, which may refuse it."""

    shape: str
    points: Array
    knots: Array
    degree: int
    weights: Array | None
    axes: tuple[str, ...]
    limits: Limits

    def curve(self) -> NurbsCurve:
        """Build the curve."""
        return NurbsCurve(self.points, self.knots, self.degree, self.weights, self.axes, name=f"extreme {self.shape}")


def extreme_case(seed: int) -> Case:
    """A case of any kind; the same for the same seed."""
    rng = np.random.default_rng([20, seed])
    degree = int(rng.integers(1, 8))
    count = degree + 1 + int(rng.integers(0, 11))
    dim = int(rng.integers(2, 7))
    axes = _axes(rng, dim)
    shape = SHAPES[int(rng.integers(len(SHAPES)))]
    points = _points(rng, shape, count, dim)
    linear = np.array([axis in _LINEAR for axis in axes])
    scale = 10.0 ** rng.uniform(-6.0, 8.0)
    points[:, linear] *= scale
    weights = 10.0 ** rng.uniform(-3.0, 3.0, count) if rng.random() < 1.0 / 3.0 else None
    knots = _knots(rng, degree, count)
    return Case(shape, points, knots, degree, weights, axes, _limits(rng, points, axes))


def _axes(rng: np.random.Generator, dim: int) -> tuple[str, ...]:
    rotary = int(rng.integers(0, min(3, dim - 1) + 1)) if rng.random() < 0.3 else 0
    return (*_LINEAR[: dim - rotary], *_ROTARY[:rotary])


def _points(rng: np.random.Generator, shape: str, count: int, dim: int) -> Array:
    """Control points of about unit extent."""
    if shape == "random":
        return rng.uniform(-1.0, 1.0, (count, dim))
    if shape == "line":  # control points in order on a line, unevenly spaced
        along = np.cumsum(10.0 ** rng.uniform(-2.0, 0.5, count))
        return rng.uniform(-1.0, 1.0, dim) + along[:, None] * rng.normal(size=dim)
    steps = rng.normal(size=(count, dim))
    if shape == "crowded":  # some steps far shorter than others
        steps *= 10.0 ** rng.uniform(-3.0, 0.0, (count, 1))
    points = np.cumsum(steps, axis=0)
    if shape == "wander":
        points += 2.0 * np.arange(count)[:, None]
    if shape == "repeated":  # two points all but coincide
        at = int(rng.integers(1, count))
        points[at] = points[at - 1] + 10.0 ** rng.uniform(-9.0, -4.0) * rng.normal(size=dim)
    if shape == "resting":  # an axis stands still for a while
        at = int(rng.integers(0, count))
        points[at : at + 4, int(rng.integers(dim))] = 0.0
    return np.asarray(points)


def _knots(rng: np.random.Generator, degree: int, count: int) -> Array:
    inner_count = count - degree - 1
    kind = rng.random()
    inner = np.sort(rng.uniform(0.0, 1.0, inner_count))
    if kind < 0.3:
        inner = np.arange(1, inner_count + 1) / (inner_count + 1)
    elif kind < 0.5:  # crowded at one end
        inner = inner ** rng.uniform(2.0, 5.0)
    if degree > 1 and inner_count > 1 and rng.random() < 0.4:
        at, times = int(rng.integers(inner_count)), int(rng.integers(2, degree + 1))
        inner[at : at + times] = inner[at]
    start, width = 0.0, 1.0
    if rng.random() < 0.3:
        start, width = rng.uniform(-100.0, 100.0), 10.0 ** rng.uniform(-3.0, 3.0)
    return np.asarray(start + width * np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)]))


def _limits(rng: np.random.Generator, points: Array, axes: tuple[str, ...]) -> Limits:
    """A machine for which the path takes something like 0.01 s to 100 s, its axes up to 1e6 apart."""
    dim = len(axes)
    linear = np.array([axis in _LINEAR for axis in axes])
    extent = np.ptp(points, axis=0)
    size = np.where(
        linear, max(float(extent[linear].max()), 1e-300), max(float(extent.max(initial=0.0, where=~linear)), 1.0)
    )
    seconds = 10.0 ** rng.uniform(-1.5, 1.0)
    spread = rng.choice([1.0, 3.0])  # decades up and down
    velocity = size / seconds * 10.0 ** rng.uniform(-0.5, spread, dim)
    acceleration = size / seconds**2 * 10.0 ** rng.uniform(0.0, 2.0 * spread, dim)
    jerk = size / seconds**3 * 10.0 ** rng.uniform(1.0, 1.0 + 2.0 * spread, dim)
    for row in (velocity, acceleration, jerk):
        if rng.random() < 0.2:
            row[rng.random(dim) < 0.4] = np.inf
    if rng.random() < 0.1:
        jerk[:] = np.inf
    if not np.isfinite(np.concatenate([velocity, acceleration, jerk])).any():
        velocity[:] = size / seconds
    tip = float(size[linear].max())
    feed = np.inf if rng.random() < 0.2 else tip / seconds * 10.0 ** rng.uniform(-0.5, 2.0)
    period = 10.0 ** rng.uniform(-4.0, np.log10(5e-3))
    chord = np.inf if rng.random() < 0.4 else tip * 10.0 ** rng.uniform(-7.0, -2.0)
    tangential_acceleration = tip / seconds**2 * 10.0 ** rng.uniform(0.0, 2.0) if rng.random() < 0.25 else np.inf
    tangential_jerk = tip / seconds**3 * 10.0 ** rng.uniform(1.0, 3.0) if rng.random() < 0.25 else np.inf
    return Limits(
        feed, velocity, acceleration, jerk, chord, period, tangential_acceleration, tangential_jerk, axes=axes
    )
