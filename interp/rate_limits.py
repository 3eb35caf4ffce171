"""How fast the rate of a plan may change: what feed override and feed hold may do within the machine's limits.

A plan q(tau) that runs at the rate r = dtau/dt has

    q'   = r q_tau
    q''  = r^2 q_tautau + r' q_tau
    q''' = r^3 q_tautautau + 3 r r' q_tautau + r'' q_tau.

The rate is governed by two numbers, 0 < H <= L (see docs/override.md for the proof):

    r'^2 <= 2 L r   and   r'^2 <= 2 H (1 - r)            a triangle over r, with its tip at r = H / (H + L)
    |r''| <= L up to the rate ``low_until``, a little above the tip;  |r''| <= H above it.

They are feasible if at every rate, with the largest r' of the triangle and the largest r'' there, each axis keeps its
limits with the values (q_tau, q_tautau, q_tautautau) of every point of the plan, whatever their signs.  Those that give
the shortest stop from full rate are chosen:

    stop = R / H + R / L,   R = largest |r'| = sqrt(2 H L / (H + L)).

Where the curvature jumps, the acceleration of an axis steps by r^2 D, and samples at the period T see up to 3/4 r^2 D / T of
that as a jerk; points within three periods of such steps have their sum in a column more.

Why it is feasible at every rate and not only at those looked at: rates are cut into cells, and a cell takes the largest
r, the largest r' and the largest r'' in it.  Why at every point of the plan: between two nodes each axis is looked at 17
times, and what it has of acceleration and jerk is taken larger by a share that covers what lies between.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.types import FloatArray

LONGEST_PERIOD = 4e-3  # s, for which L may be used below low_until
# Points between two nodes; what an axis has between them, above what it has at them, as a share of its limit.
_POINTS = 17
_BETWEEN = 1e-4
# Of the bounds: ten times what roundings of a step may exceed them by.
_FOR_ROUNDINGS = 1e-8
_CELLS = 400
# Jerk that samples see of a step of the acceleration by 1, times their period: the peak of the quadratic B-spline, within
# whose support a sample averages jerk from three periods before to three after.
_STEP_SEEN, _STEP_REACH = 0.75, 3.0
_STEP_COUNTS = 1e-6  # of the acceleration limit: less is no step but roundings
_LEAST, _MOST = 1e-3, 1e6  # of H: a stop within a minute, and within a few ms
# H is tried at so many shares of the largest that holds with L = H; L is found by bisection of the factor between them.
_SHARES = np.linspace(0.5, 0.99, 15)
_WIDEST, _CLOSE, _EXACT = 100.0, 1.02, 1.0005


@dataclass(frozen=True)
class RateLimits:
    """Bounds on the rate of a plan.

    Attributes
    ----------
    high, low : float
        H and L: bounds on |r''|, 1/s^2, above ``low_until`` and up to it.
    low_until : float
        Rate.
    longest_period : float
        Up to which these hold, s; with a longer one H bounds |r''| everywhere.
    """

    high: float
    low: float
    low_until: float
    longest_period: float = LONGEST_PERIOD

    @property
    def fastest(self) -> float:
        """Largest |r'|, 1/s."""
        return sqrt(2.0 * self.high * self.low / (self.high + self.low))

    @property
    def stop_time(self) -> float:
        """From full rate to a stop, s."""
        return self.fastest / self.high + self.fastest / self.low


@dataclass(frozen=True)
class _Axis:
    """Points (n, 4) of |q_tau|, |q_tautau|, |q_tautautau| and what samples see of steps, and the limits on the inner two."""

    points: FloatArray
    acceleration: float
    jerk: float


def rate_limits(profile: FeedrateProfile, limits: Limits) -> RateLimits | None:
    """Find the bounds with the shortest stop; None where the plan leaves no reserve for any.

    Parameters
    ----------
    profile : FeedrateProfile
    limits : Limits
        Of the machine, on the axes of the curve: those that the motion must keep at every rate.
    """
    axes = _axes(profile, limits)
    # Few points decide: the bounds of some are found, the points that break them are added, until none does.
    some = [replace(axis, points=axis.points[np.unique(axis.points.argmax(axis=0))]) for axis in axes]
    while True:
        found = _fastest(some)
        if found is None:
            return None
        broken = [_breaking(axis, found.high, found.low) for axis in axes]
        if not any(points.size for points in broken):
            return RateLimits(found.high * (1.0 - _FOR_ROUNDINGS), found.low * (1.0 - _FOR_ROUNDINGS), found.low_until)
        some = [
            replace(axis, points=np.unique(np.concatenate([axis.points, points]), axis=0))
            for axis, points in zip(some, broken, strict=True)
        ]


def _fastest(axes: list[_Axis]) -> RateLimits | None:
    """The bounds with the shortest stop by the points of some axes; None where there are none."""
    lo, hi = _LEAST, _MOST
    if not _holds(axes, lo, lo):
        return None
    while hi / lo > _EXACT:  # the largest H with L = H
        middle = sqrt(lo * hi)
        lo, hi = (middle, hi) if _holds(axes, middle, middle) else (lo, middle)

    def with_low(share: float) -> RateLimits:
        high, factor, wide = share * lo, 1.0, _WIDEST
        while wide / factor > _CLOSE:
            middle = sqrt(factor * wide)
            factor, wide = (middle, wide) if _holds(axes, high, middle * high) else (factor, middle)
        return _bounds(high, factor * high)

    return min(map(with_low, _SHARES.tolist()), key=lambda bounds: bounds.stop_time)


def _bounds(high: float, low: float) -> RateLimits:
    tip = high / (high + low)
    fastest = sqrt(2.0 * high * low / (high + low))
    return RateLimits(high, low, min(1.0, tip + fastest * LONGEST_PERIOD))


def _axes(profile: FeedrateProfile, limits: Limits) -> list[_Axis]:
    """What each axis has, and the tool tip along its path where that is limited."""
    quadruples = _quadruples(profile, limits)
    pairs = list(zip(limits.acceleration.tolist(), limits.jerk.tolist(), strict=True))
    pairs.append((limits.tangential_acceleration, limits.tangential_jerk))
    found = []
    for points, (acceleration, jerk) in zip(quadruples, pairs, strict=False):  # the tip's only where it is limited
        if not (np.isfinite(acceleration) or np.isfinite(jerk)):
            continue
        points[:, 1] += _BETWEEN * (acceleration if np.isfinite(acceleration) else 0.0)
        points[:, 2] += _BETWEEN * (jerk if np.isfinite(jerk) else 0.0)
        stepped = points[:, 3] > 0.0
        worst = np.concatenate([_outermost(points[~stepped]), np.unique(points[stepped], axis=0)])
        found.append(_Axis(worst, acceleration, jerk))
    return found


def _steps_seen(profile: FeedrateProfile, i: NDArray[np.intp], acceleration: FloatArray, limit: float) -> FloatArray:
    """Jerk that samples see of the steps of an acceleration (n, points) around every interval i (n,)."""
    step = np.abs(acceleration[1:, 0] - acceleration[:-1, -1])
    step = np.where(step > _STEP_COUNTS * (limit if np.isfinite(limit) else step.max(initial=0.0)), step, 0.0)
    at, reach = profile.t[i[1:]], _STEP_REACH * profile.origin.period
    total = np.concatenate([[0.0], np.cumsum(step)])
    first = np.searchsorted(at, profile.t[i] - reach, side="left")
    last = np.searchsorted(at, profile.t[i + 1] + reach, side="right")
    seen = _STEP_SEEN / profile.origin.period * (total[last] - total[first])
    # Differences of sums round: what is no step must be 0.
    return np.where(seen > _STEP_SEEN / profile.origin.period * 1e-9 * total[-1], seen, 0.0)


def _quadruples(profile: FeedrateProfile, limits: Limits) -> list[FloatArray]:
    """What :class:`_Axis` has (n, 4), of every axis and of the tip's arc length, at points all over the plan."""
    i = np.flatnonzero(np.diff(profile.t) > 0.0)
    t, gap = profile.t[i], profile.t[i + 1] - profile.t[i]
    c = profile.law.coefficients(i)
    x = gap[:, None] * np.linspace(0.0, 1.0, _POINTS)
    c = c[:, :, None]
    u = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
    first = c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5])))
    second = 2.0 * c[2] + x * (6.0 * c[3] + x * (12.0 * c[4] + x * 20.0 * c[5]))
    third = 6.0 * c[3] + x * (24.0 * c[4] + x * 60.0 * c[5])
    left = np.zeros(u.shape, dtype=bool)
    left[:, -1] = True  # of the curve, the side on which the interval lies
    u = np.clip(u, profile.u[i][:, None], profile.u[i + 1][:, None])
    d = profile.curve.derivatives(u, 3, side=left)
    first, second, third = first[..., None], second[..., None], third[..., None]
    orders = [
        d[1] * first,
        d[2] * first**2 + d[1] * second,
        d[3] * first**3 + 3.0 * d[2] * first * second + d[1] * third,
    ]
    motions = [(*(order[..., j] for order in orders), float(limits.acceleration[j])) for j in range(profile.curve.dim)]
    if np.isfinite(limits.tangential_acceleration) or np.isfinite(limits.tangential_jerk):
        states = profile.at(np.clip(t[:, None] + x, 0.0, profile.duration))
        motions.append((states.feed, states.acceleration, states.jerk, limits.tangential_acceleration))
    found = []
    for v, a, j, limit in motions:
        seen = np.repeat(_steps_seen(profile, i, a, limit), _POINTS)
        found.append(np.stack([np.abs(v).ravel(), np.abs(a).ravel(), np.abs(j).ravel(), seen], axis=1))
    return found


def _outermost(points: FloatArray) -> FloatArray:
    """Those of points (n, 4), the last 0, that are the largest in a direction without a negative part."""
    kept = np.unique(points, axis=0)
    scale = kept[:, :3].max(axis=0, initial=0.0)
    if kept.shape[0] < 16 or not (scale > 0.0).all():
        return kept
    scaled = kept[:, :3] / scale
    corners = [scaled, np.zeros((1, 3))]
    corners += [scaled * mask for mask in np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])]
    try:
        vertices = ConvexHull(np.concatenate(corners), qhull_options="QJ Pp").vertices
    except QhullError:  # all in a plane, or on a line
        return kept
    chosen = np.unique(vertices[vertices < kept.shape[0]])
    # The hull is that of points moved by roundings; the extremes of each order are kept in any case.
    return kept[np.union1d(chosen, scaled.argmax(axis=0))]


def _holds(axes: list[_Axis], high: float, low: float) -> bool:
    """Whether every axis keeps its limits at every rate, with all that the triangle allows there."""
    return all((_excess(axis, high, low) <= 0.0).all() for axis in axes)


def _breaking(axis: _Axis, high: float, low: float) -> FloatArray:
    """Of the points that break a limit the worst at each rate, (n, 4)."""
    excess = _excess(axis, high, low)
    worst = excess.argmax(axis=0)
    return axis.points[np.unique(worst[excess.max(axis=0) > 0.0])]


def _excess(axis: _Axis, high: float, low: float) -> FloatArray:
    """How far each point of an axis is beyond its limits at every rate, as a share of them, (points, cells)."""
    bounds = _bounds(high, low)
    tip = high / (high + low)
    # Cells even in r' on both sides of the tip; r' is largest at the tip.
    z = np.linspace(0.0, 1.0, _CELLS + 1)
    left, right = tip * z**2, 1.0 - (1.0 - tip) * z[::-1] ** 2
    rate = np.concatenate([left[1:], right[1:]])  # largest of each cell
    slope = bounds.fastest * np.concatenate([z[1:], z[::-1][:-1]])
    start = np.concatenate([left[:-1], right[:-1]])
    curve = np.where(start <= bounds.low_until, low, high)
    v, a, j, d = axis.points.T[:, :, None]
    of_acceleration = (rate**2 * a + slope * v) / axis.acceleration
    of_jerk = (rate**3 * j + rate**2 * d + 3.0 * rate * slope * a + curve * v) / axis.jerk
    return np.maximum(of_acceleration, of_jerk) - 1.0
