"""The path of a section over the coordinate of its certificate, and the speeds that the limits allow along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.geometry.curve import Curve
from planner.geometry.differential import curvature, dot
from planner.machine.limits import Limits
from planner.quantity import ACCELERATION, JERK
from planner.types import FloatArray, IntArray
from planner.verify.certificate.multipliers import Multipliers

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Bounds:
    """Largest velocity, acceleration and jerk of each motion, (K,): the axes, and last the tip's arc length."""

    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @classmethod
    def of(cls, limits: Limits) -> Bounds:
        """Read them from the limits; the feed is not among them, it changes along a program."""
        return cls(
            np.append(limits.velocity, np.inf),
            limits.of_motions(ACCELERATION.order),
            limits.of_motions(JERK.order),
        )


@dataclass(frozen=True, eq=False)
class PathPoints:
    """The path at points of a section.

    Attributes
    ----------
    first, second : (K, p) arrays
        Derivatives of the motions with respect to sigma: of the axes, and last of the tip's arc length.
    cap : (p,) array
        Largest sigma_dot^2 by the feed and the axis velocities, 1/s^2 in units of sigma.
    chord_cap : (p,) array
        That by the chord error, as the osculating circle has it.
    """

    first: FloatArray
    second: FloatArray
    cap: FloatArray
    chord_cap: FloatArray


def path_points(
    curve: Curve, limits: Limits, parts: Multipliers, i: IntArray, r: FloatArray, left: Flags | None = None
) -> PathPoints:
    """Evaluate the path on the intervals i at r (both flat), from inside the intervals or as ``left`` says."""
    u, u1, u2 = parts.coordinate(i, r)
    from_left = u >= parts.u[1, i] if left is None else left
    d = curve.derivatives(u, 2)
    some = np.flatnonzero(from_left)
    if some.size:
        d[:, some] = curve.derivatives(u[some], 2, side="left")
    tip = d[:, :, [unit == "mm" for unit in curve.axis_units]]
    speed = np.sqrt(dot(tip[1], tip[1]))
    bend = np.divide(dot(tip[1], tip[2]), speed, out=np.zeros_like(speed), where=speed > 0.0)
    du = np.vstack([d[1].T, speed])
    first = du * u1
    second = np.vstack([d[2].T, bend]) * u1**2 + du * u2
    bounds = Bounds.of(limits)
    feed = _commanded(curve, limits, parts)[i]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        speeds = np.fmin.reduce(bounds.velocity[:, None] / np.abs(first), axis=0)
        speeds = np.fmin(speeds, np.where(first[-1] > 0.0, feed / first[-1], np.inf))
        chord = np.where(first[-1] > 0.0, _chord_feed(curvature(tip), limits) / first[-1], np.inf)
        return PathPoints(first, second, speeds**2, chord**2)


def _commanded(curve: Curve, limits: Limits, parts: Multipliers) -> FloatArray:
    """Feed commanded on each interval, (M,); where the command changes within one, the larger."""
    if curve.feed_caps is None:
        return np.full(parts.h.size, limits.feed)
    edges, own = curve.feed_caps.edges, curve.feed_caps.feed
    feed = np.where(np.isinf(own), limits.rapid, np.minimum(limits.feed, own))  # a cap of inf is a rapid's
    if curve.feed_caps.angular is not None:
        feed = np.where(curve.feed_caps.angular, own, feed)  # limits on feeds are of lengths
    first = np.clip(np.searchsorted(edges, parts.u[0], side="right") - 1, 0, feed.size - 1)
    last = np.clip(np.searchsorted(edges, parts.u[1], side="left"), first + 1, feed.size)
    largest = np.maximum.reduceat(np.append(feed, 0.0), np.stack([first, last], axis=1).reshape(-1))[::2]
    return np.asarray(largest)


def _chord_feed(kappa: FloatArray, limits: Limits) -> FloatArray:
    """Feed at which a chord of one period leaves a circle of curvature kappa by the chord error.

    The chord of half length c leaves the circle of radius rho by e with c^2 = e (2 rho - e); no chord leaves it by more
    than the radius.
    """
    if np.isinf(limits.chord_error):
        return np.full(kappa.shape, np.inf)
    with np.errstate(divide="ignore"):
        radius = 1.0 / kappa
        error = np.minimum(limits.chord_error, radius)
        half = np.where(np.isinf(radius), np.inf, np.sqrt(error * (2.0 * radius - error)))
    return np.asarray(2.0 * half / limits.period)


def stop_caps(bounds: Bounds, first: FloatArray, way: FloatArray, speed: FloatArray, ramps: Flags) -> FloatArray:
    """Largest sigma_dot^2 (p,) that a motion reaches on its way from an end at which its speed is known.

        v^2     <= v_0^2 + 2 A D                 |d(v^2)/dt| = 2 |v a| <= 2 A |v|
        v^(3/2) <= (3 / sqrt 2) sqrt(J) D        from rest without acceleration, while v keeps its sign:
                                                 a <= sqrt(2 J v), since an acceleration a took the time a / J to build
                                                 up, in which v grew by a^2 / (2 J) at least; and v dv = a dD

    Parameters
    ----------
    bounds : Bounds
    first : (K, p) array
        Derivatives of the motions with respect to sigma.
    way : (K, p) array
        D, at least the way of each motion since that end.
    speed : (K,) array
        Speed of each motion at the end.
    ramps : (K, p) bool array
        Where the second rule applies.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope2 = first**2
        by_acceleration = (speed[:, None] ** 2 + 2.0 * bounds.acceleration[:, None] * way) / slope2
        by_jerk = np.cbrt(1.5 * np.sqrt(2.0 * bounds.jerk[:, None]) * way) ** 4 / slope2
    # 0/0 of a motion that does not move is no limit
    return np.fmin.reduce(np.fmin(by_acceleration, np.where(ramps, by_jerk, np.inf)), axis=0, initial=np.inf)
