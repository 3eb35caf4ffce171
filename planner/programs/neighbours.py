"""How equal the feed is at the same place in neighbouring passes of a part program.

A surface is cut in passes side by side.  Where their feeds differ, so do the forces on the tool, and the passes show.

Rules

1.  Places are points of the planned path at equal distances along it, at most ``SPACING`` apart on paths up to 50 m.
2.  The place beside a place is on another pass: at most ``REACH`` away across the path, where the path runs the same way or
    back within 3 degrees, under the same commanded feed, and more than 4 x ``REACH`` away along the path.  Of several the
    nearest.
3.  Left out are places, of either pass, from which the machine could brake to rest before the next stop, or after the last
    one from rest could not yet have reached its largest feed, and the same beside a turn of more than 45 degrees within
    ``SPACING``, or a rapid: v (v / A + A / J) / 2 of them along the path, with the largest feed v of the cuts and the least
    limits of the axes.  There the programmed geometry itself lets the feeds differ.
4.  The two are compared in one plane across the path, found by two steps of Newton's method in time: the difference of their
    feeds against the mean of both.

Known limitation: passes farther apart than ``REACH`` are not compared, and what differs because the surface does is counted.
Nothing is said of programs that move rotary axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.geometry.curve import ROTARY_AXES
from planner.geometry.differential import dot
from planner.machine.feed_limits import commanded_feed
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.programs.path.smooth_path import ProgramPath
from planner.types import FloatArray

SPACING = 0.5  # mm
REACH = 2.0  # mm
_MAX_PLACES = 100_000
_NEAREST = 16  # places looked at around each: those of its own pass are nearer than some of the next
_PARALLEL = np.cos(np.deg2rad(3.0))
_TURN = np.cos(np.deg2rad(45.0))
_APART = 4.0 * REACH  # mm along the path, beyond which it is another pass
_RESTS = 1e-3  # of the largest feed: slower is at rest
_FEWEST = 20  # pairs, below which there are no neighbouring passes to speak of


@dataclass(frozen=True)
class NeighbouringPasses:
    """What was found of the feeds in neighbouring passes.

    Attributes
    ----------
    mean, worst : float
        Difference of the feeds of two passes at the same place against their mean: on average over the places, and largest.
    lines : (int, int)
        Lines of the blocks at the two places of the largest.
    feeds : (float, float)
        Feeds there, mm/s.
    places : int
        How many were compared.
    length : float
        Path that they stand for, mm.
    """

    mean: float
    worst: float
    lines: tuple[int, int]
    feeds: tuple[float, float]
    places: int
    length: float


@dataclass(frozen=True, eq=False)
class _PassPlaces:
    """Points of a plan, n of them: time, distance along the path, position and unit tangent of the tip, feed, parameter."""

    t: FloatArray
    s: FloatArray
    position: FloatArray
    tangent: FloatArray
    feed: FloatArray
    u: FloatArray


def neighbouring_passes(path: ProgramPath, profile: FeedrateProfile, limits: Limits) -> NeighbouringPasses | None:
    """Compare the feeds of neighbouring passes; None where a program has none, or moves rotary axes.

    Parameters
    ----------
    path : ProgramPath
    profile : FeedrateProfile
        A plan of its curve.
    limits : Limits
        On the axes of the curve.
    """
    from scipy.spatial import cKDTree

    if set(profile.curve.axes) & set(ROTARY_AXES):
        return None
    length = float(profile.s[-1] - profile.s[0])
    count = min(int(np.ceil(length / SPACING)) + 1, _MAX_PLACES)
    if count < _FEWEST:
        return None
    s = np.linspace(profile.s[0], profile.s[-1], count)
    # The feed is about linear between nodes: what it is not moves the places a little, no more.
    at = _places(profile, np.interp(s, profile.s, profile.t))
    cap = commanded_feed(profile.curve, limits, at.u)
    free = np.flatnonzero(_undisturbed(path, at, profile, limits))
    if free.size < _FEWEST:
        return None
    tree = cKDTree(at.position[free])
    away, found = tree.query(at.position[free], k=min(_NEAREST, free.size), distance_upper_bound=REACH + SPACING)
    own, other = np.broadcast_to(free[:, None], found.shape), free[np.minimum(found, free.size - 1)]
    beside = np.isfinite(away) & (np.abs(at.s[other] - at.s[own]) > _APART) & (cap[other] == cap[own])
    first, rank = np.nonzero(beside)
    own, other = own[first, rank], other[first, rank]
    along = np.abs(dot(at.tangent[own], at.tangent[other])) > _PARALLEL
    first, own, other = first[along], own[along], other[along]
    nearest = np.append(True, np.diff(first) > 0) if first.size else np.zeros(0, dtype=np.bool_)
    own, other = own[nearest], other[nearest]
    matched = _matched(profile, at, own, other)
    kept = dot(matched.position - at.position[own], matched.position - at.position[own]) <= REACH**2
    own, feeds, u = own[kept], matched.feed[kept], matched.u[kept]
    if own.size < _FEWEST:
        return None
    relative = np.abs(feeds - at.feed[own]) / (0.5 * (feeds + at.feed[own]))
    worst = int(np.argmax(relative))
    return NeighbouringPasses(
        float(relative.mean()),
        float(relative[worst]),
        (_line(path, float(at.u[own[worst]])), _line(path, float(u[worst]))),
        (float(at.feed[own[worst]]), float(feeds[worst])),
        int(own.size),
        float(own.size * length / (count - 1)),
    )


def _places(profile: FeedrateProfile, t: FloatArray) -> _PassPlaces:
    """The plan at times t (n,)."""
    at = profile.at(np.clip(t, 0.0, profile.duration))
    d = profile.curve.tip.derivatives(at.u, 1)
    size = np.sqrt(dot(d[1], d[1]))
    tangent = d[1] / np.where(size > 0.0, size, 1.0)[:, None]
    return _PassPlaces(at.t, at.s, d[0], tangent, at.feed, at.u)


def _undisturbed(path: ProgramPath, at: _PassPlaces, profile: FeedrateProfile, limits: Limits) -> NDArray[np.bool_]:
    """Places that are far enough from stops, turns and rapids."""
    block = np.clip(np.searchsorted(path.u, at.u, side="right") - 1, 0, path.rapid.size - 1)
    most = float(at.feed[~path.rapid[block]].max(initial=0.0))
    acceleration, jerk = float(limits.acceleration.min()), float(limits.jerk.min())
    build_up = acceleration / jerk if np.isfinite(jerk) else 0.0
    margin = 0.5 * most * (most / acceleration + build_up) if np.isfinite(acceleration) else 0.0
    resting = at.s[at.feed <= _RESTS * most]
    turning = np.flatnonzero(dot(at.tangent[1:], at.tangent[:-1]) < _TURN)
    stops = np.interp([stop.u for stop in path.stops], profile.law.u, profile.s)
    ends = [at.s[[0, -1]], resting, 0.5 * (at.s[turning] + at.s[turning + 1]), stops, at.s[path.rapid[block]]]
    marks = np.unique(np.concatenate(ends))
    next_mark = np.searchsorted(marks, at.s)
    after = marks[np.minimum(next_mark, marks.size - 1)] - at.s
    before = at.s - marks[np.maximum(next_mark - 1, 0)]
    return np.asarray((np.abs(after) >= margin) & (np.abs(before) >= margin) & (at.feed > _RESTS * most))


def _matched(profile: FeedrateProfile, at: _PassPlaces, own: NDArray[np.intp], other: NDArray[np.intp]) -> _PassPlaces:
    """The places beside ``own`` on the passes of ``other``, in the planes across the path."""
    t, place, tangent = at.t[other], at.position[own], at.tangent[own]
    for _ in range(2):
        now = _places(profile, t)
        rate = now.feed * dot(now.tangent, tangent)
        t = t - dot(now.position - place, tangent) / np.where(rate == 0.0, np.inf, rate)
    return _places(profile, t)


def _line(path: ProgramPath, u: float) -> int:
    """Line of the block at a parameter."""
    block = int(np.clip(np.searchsorted(path.u, u, side="right") - 1, 0, path.line.size - 1))
    return int(path.line[block])
