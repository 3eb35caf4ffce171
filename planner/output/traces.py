"""A plan over time, thinned out for drawing: in every bucket of time the smallest and the largest value stay.

A thinned line that keeps every n-th point loses the peaks, which are what limits are about.  Here the plan is evaluated
inside every interval of its table, near both ends of each, since the jerk may jump at a node.  Where the points are few
enough they are all kept; otherwise time is cut into equal buckets, and of each the extremes are kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.geometry.chord import distance_to_chord
from planner.geometry.curve import Curve
from planner.geometry.differential import chain_rule, rates_along
from planner.machine.feed_limits import feedrate_limits
from planner.machine.limits import Limits, require_limits
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.types import FloatArray, Side

_CHUNK = 100_000  # points evaluated at once; bounds the memory, changes no result
_POINTS_INSIDE, _MIN_POINTS = 4, 2500
_MIN_INSIDE = 3  # of an interval: both ends and the middle
_END = 1e-6  # of an interval: so near its ends the jerk is its own
_PLACES_APART = 0.25
_CHORD_PLACES = 0.5 + _PLACES_APART * np.array([-1.0, 0.0, 1.0])  # of a period: the path is farthest near its middle


@dataclass(frozen=True, eq=False)
class Traces:
    """Quantities over time; every array has the length of t.

    Attributes
    ----------
    t : (n,) array
        Increasing, s: the points, or the starts of the buckets and the end of the last.
    low, high : dict of str to (n,) float32 array
        Smallest and largest value in the bucket that starts at t; the same array where every point is kept.
    """

    t: FloatArray
    low: dict[str, NDArray[np.float32]]
    high: dict[str, NDArray[np.float32]]

    @property
    def thinned(self) -> bool:
        """A place stands for a bucket, not for a point."""
        return any(self.low[name] is not self.high[name] for name in self.low)


@dataclass(frozen=True, eq=False)
class PlanTraces(Traces):
    """The plan over time.

    The quantities are "feed", "feed limit" (the lowest that command, axis velocities and chord error set) and "limit at
    steady feed" (that of the axis accelerations, which a changing feed may exceed), mm/s; "acceleration" and "jerk" along
    the path, mm/s^2 and mm/s^3; for every axis with such a limit "velocity X", "acceleration X" and "jerk X", as shares of
    it; and of a part program "programmed feed", mm/s: its F word, nan on rapids.

    Attributes
    ----------
    u, s : (n,) arrays
        Curve parameter and arc length (mm) at t.
    position : (n, dim) array
        The tool tip at t, mm.
    binding : (n,) array
        Index into the profile's ``limit_names``: at the point, or for most of the bucket.
    rapid : (n,) bool array
        Whether the motion that leads to a place is a rapid of a part program.
    """

    u: FloatArray
    s: FloatArray
    position: FloatArray
    binding: NDArray[np.int8]
    rapid: NDArray[np.bool_]


def trace_plan(curve: Curve, limits: Limits, profile: FeedrateProfile, most: int) -> PlanTraces:
    """Evaluate a plan at about ``most`` times at most, or keep the extremes of that many buckets.

    Raises InputError if the axes of the limits are not those of the curve.
    """
    limits = require_limits(curve, limits)
    intervals = int(np.count_nonzero(np.diff(profile.t) > 0.0))
    inside = min(max(_POINTS_INSIDE, _MIN_POINTS // intervals), most // intervals)
    if inside >= _MIN_INSIDE:
        t = np.concatenate(list(_times(profile.t, inside, np.empty(0))))
        parts = [_quantities(curve, limits, profile, t[k : k + _CHUNK]) for k in range(0, t.size, _CHUNK)]
        low = {name: np.concatenate([part[name] for part in parts]).astype(np.float32) for name in parts[0]}
        return _with_place(curve, profile, t, low, low, _nearest(profile, t))
    edges = np.linspace(0.0, profile.duration, most)
    envelope = _Envelope(edges, list(_quantities(curve, limits, profile, edges[:1])))
    for t in _times(profile.t, _MIN_INSIDE, edges):
        envelope.add(t, _quantities(curve, limits, profile, t))
    return _with_place(curve, profile, edges, *envelope.result(), _longest(profile, edges))


def trace_chord_error(curve: Curve, samples: Samples, most: int) -> Traces:
    """Distance of the tip's path from the chord of each period, "chord error" in mm, at the middle of the period."""
    count = samples.t.size - 1
    middle = 0.5 * (samples.t[:-1] + samples.t[1:])
    error = np.empty(count)
    for k in range(0, count, _CHUNK):
        error[k : k + _CHUNK] = _off_chord(curve.tip, samples.u[k : k + _CHUNK + 1])
    if count <= most:
        low = {"chord error": error.astype(np.float32)}
        return Traces(middle, low, low)
    edges = np.linspace(float(middle[0]), float(middle[-1]), most)
    envelope = _Envelope(edges, ["chord error"])
    envelope.add(middle, {"chord error": error})
    return Traces(edges, *envelope.result())


class _Envelope:
    """The smallest and largest values in buckets of time, from points that come in the order of time."""

    def __init__(self, edges: FloatArray, names: list[str]) -> None:
        self.edges = edges
        self.low = {name: np.full(edges.size, np.inf) for name in names}
        self.high = {name: np.full(edges.size, -np.inf) for name in names}

    def add(self, t: FloatArray, values: dict[str, FloatArray]) -> None:
        """Take in points; every bucket must get one sooner or later."""
        bucket = np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, self.edges.size - 1)
        first = np.flatnonzero(np.diff(bucket, prepend=-1))
        at = bucket[first]
        for name, column in values.items():
            self.low[name][at] = np.fmin(self.low[name][at], np.fmin.reduceat(column, first))
            self.high[name][at] = np.fmax(self.high[name][at], np.fmax.reduceat(column, first))

    def result(self) -> tuple[dict[str, NDArray[np.float32]], dict[str, NDArray[np.float32]]]:
        """The extremes, in single precision; nan where a bucket has no number."""
        for name in self.low:
            nothing = self.low[name] > self.high[name]
            self.low[name][nothing] = self.high[name][nothing] = np.nan
        low, high = ({k: v.astype(np.float32) for k, v in side.items()} for side in (self.low, self.high))
        return low, high


def _times(nodes: FloatArray, inside: int, further: FloatArray) -> Iterator[FloatArray]:
    """Times within every interval, both ends included, merged with further times: increasing, chunk by chunk."""
    width = np.diff(nodes)
    start, width = nodes[:-1][width > 0.0], width[width > 0.0]
    share = np.linspace(0.0, 1.0, inside)
    share[0], share[-1] = _END, 1.0 - _END
    step = max(1, _CHUNK // inside)
    for k in range(0, start.size, step):
        last = k + step >= start.size
        t = (start[k : k + step, None] + width[k : k + step, None] * share).reshape(-1)
        if k == 0:
            t[0] = nodes[0]
        if last:
            t[-1] = nodes[-1]
        lo, hi = np.searchsorted(further, [start[k], np.inf if last else start[k + step]])
        yield np.sort(np.concatenate([t, further[lo:hi]])) if hi > lo else t


def _quantities(curve: Curve, limits: Limits, profile: FeedrateProfile, t: FloatArray) -> dict[str, FloatArray]:
    """What is drawn, at the times t."""
    states = profile.at(t)
    node = np.clip(np.searchsorted(profile.t, t, side="right") - 1, 0, profile.t.size - 2)
    # So near the end of an interval rounding may put u at the break there, or behind it: its own side is the left one.
    u = np.clip(states.u, profile.u[node], profile.u[node + 1])
    left = u >= profile.u[node + 1]
    law = (u, states.u_rate, states.u_acceleration, states.u_jerk)
    found: dict[str, FloatArray] = {}
    sides: tuple[tuple[Side, NDArray[np.bool_]], ...] = (("right", ~left), ("left", left))
    for side, at in sides:
        if at.any():
            some = law[0][at], law[1][at], law[2][at], law[3][at]
            for name, values in _on_one_side(curve, limits, some, side).items():
                found.setdefault(name, np.empty(t.size))[at] = values
    return found


def _on_one_side(
    curve: Curve, limits: Limits, law: tuple[FloatArray, FloatArray, FloatArray, FloatArray], side: Side
) -> dict[str, FloatArray]:
    """What is drawn, from u and its first three time derivatives."""
    u1, u2, u3 = (values[:, None] for values in law[1:])
    q = curve.derivatives(law[0], 3, side=side)
    feed, acceleration, jerk = rates_along(curve.tip.derivatives(law[0], 3, side=side), *law[1:])
    allowed = feedrate_limits(curve, limits, law[0], side=side)
    found = {
        "feed": feed,
        "feed limit": np.minimum.reduce([allowed.command, allowed.axis_velocity, allowed.chord_error]),
        "limit at steady feed": allowed.normal_acceleration,
        "acceleration": acceleration,
        "jerk": jerk,
    }
    if curve.feed_caps is not None:
        cap = curve.feed_caps.at(law[0], side == "left")
        found["programmed feed"] = np.where(np.isinf(cap), np.nan, cap)
    motion = zip(("velocity", "acceleration", "jerk"), chain_rule(q[1], q[2], q[3], u1, u2, u3), strict=True)
    for what, values in motion:
        largest = getattr(limits, what)
        for j, axis in enumerate(curve.axes):
            if np.isfinite(largest[j]):
                found[f"{what} {axis}"] = values[:, j] / largest[j]
    return found


def _with_place(
    curve: Curve,
    profile: FeedrateProfile,
    t: FloatArray,
    low: dict[str, NDArray[np.float32]],
    high: dict[str, NDArray[np.float32]],
    binding: NDArray[np.int8],
) -> PlanTraces:
    """Add where the tool is at the times t."""
    states = [profile.at(t[k : k + _CHUNK]) for k in range(0, t.size, _CHUNK)]
    u, s = (np.concatenate([getattr(part, name) for part in states]) for name in ("u", "s"))
    rapid = np.zeros(t.size, dtype=np.bool_)
    if curve.feed_caps is not None:
        rapid[1:] = np.isinf(curve.feed_caps.at(u[1:], True))
        rapid[0] = np.isinf(curve.feed_caps.feed[0])
    return PlanTraces(t, low, high, u, s, curve.tip.derivatives(u, 0)[0], binding, rapid)


def _nearest(profile: FeedrateProfile, t: FloatArray) -> NDArray[np.int8]:
    """Limit that binds at the node nearest in time."""
    node = np.searchsorted(0.5 * (profile.t[:-1] + profile.t[1:]), t, side="right")
    return np.asarray(profile.binding[node])


def _longest(profile: FeedrateProfile, edges: FloatArray) -> NDArray[np.int8]:
    """Limit that holds the path back for the longest time in each bucket; a node stands for the time nearest to it."""
    cuts = np.union1d(0.5 * (profile.t[:-1] + profile.t[1:]), edges)
    middle = 0.5 * (cuts[:-1] + cuts[1:])
    bucket = np.searchsorted(edges, middle, side="right") - 1
    kinds = len(profile.limit_names)
    time = np.bincount(bucket * kinds + _nearest(profile, middle), np.diff(cuts), edges.size * kinds)
    longest = np.argmax(time.reshape(edges.size, kinds), axis=1)
    longest[-1] = profile.binding[-1]  # the end of the last bucket
    return np.asarray(longest, dtype=np.int8)


def _off_chord(tip: Curve, u: FloatArray) -> FloatArray:
    """Largest distance of the path between neighbours of u (m,) from the chord between them, (m - 1,), mm."""
    ends = tip.derivatives(u, 0)[0]

    def distance(places: FloatArray) -> FloatArray:
        between = u[:-1, None] + np.diff(u)[:, None] * places
        return distance_to_chord(tip.derivatives(np.clip(between, *tip.domain), 0)[0], ends[:-1], ends[1:])

    found = distance(_CHORD_PLACES)
    first, middle, last = found.T
    # Where the parameter does not run evenly the path is farthest beside the middle: at the vertex of a parabola.
    bend = first - 2.0 * middle + last
    vertex = np.divide(first - last, 2.0 * bend, out=np.zeros_like(bend), where=bend < 0.0)
    places = _CHORD_PLACES[1] + _PLACES_APART * np.clip(vertex, -1.0, 1.0)
    return np.asarray(np.maximum(found.max(axis=1), distance(places[:, None])[:, 0]))
