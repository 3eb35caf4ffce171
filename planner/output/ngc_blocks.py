"""Blocks of a written program: a planned curve cut into lines within a tolerance.

A line may leave the curve, digits included, by what the blending at its ends leaves of the tolerance.  Whoever follows the
lines and keeps within P of them at their ends therefore keeps within the tolerance of the curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.curve import AXES, DEGREES, Curve
from planner.law import TimeLaw
from planner.output.ngc_motion import BlockMotion, needed_blends
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.types import FloatArray

_PROBES = 16  # inside a block, at Chebyshev points: they miss the peak of a parabola by at most 1 %
_PROBE_SHARE = 0.98
_MAX_ROUNDS = 30
_MAX_GROWTH = 2.0  # of the parts of a block in one round
_MAX_BLOCKS = 5_000_000
_P_STEP = 1.06  # P changes in steps of this ratio, so that most blocks need no word for it
_MIN_SHARE = 1e-4  # of the tolerance, the least P that is written


@dataclass(frozen=True, eq=False)
class WrittenBlocks:
    """Points (n, dim) in mm and degrees as written, with what belongs to them.

    Attributes
    ----------
    points : (n, dim) array
    t, u : (n,) array
        Times and parameters of the curve.
    stops : (n,) array of bool
        Whether the plan stops at a point.
    blends : (n - 1,) array
        P of each block, mm.
    deviations : (n - 1,) array
        Largest distance of the curve to the line of each block, mm.
    """

    points: FloatArray
    t: FloatArray
    u: FloatArray
    stops: NDArray[np.bool_]
    blends: FloatArray
    deviations: FloatArray


@dataclass(frozen=True, eq=False)
class Room:
    """What the blocks may take.

    Attributes
    ----------
    tolerance : float
        Distance of the blended lines to the curve, mm.
    decimals : int
        Of the coordinates.
    acceleration : (dim,) array
        Of the machine's axes, mm/s^2; inf where it is not known.
    period : float
        Of the controller, s.
    """

    tolerance: float
    decimals: int
    acceleration: FloatArray
    period: float

    def follows(self, curve: Curve) -> bool:
        """Whether it is known how LinuxCNC moves: by arcs between lines in X Y Z, on axes of known acceleration."""
        return set(curve.axes) <= set(AXES[:3]) and bool(np.isfinite(self.acceleration).all())

    @property
    def largest_blend(self) -> float:
        """P where nothing asks for less, mm."""
        return 0.5 * self.tolerance


def blocks_of_profile(
    curve: Curve, profile: FeedrateProfile, room: Room, block_time: float, places: FloatArray
) -> WrittenBlocks:
    """Cut a profile at equal times, at corners, stops and places, and in parts until every line is within its room."""
    law = profile.law
    corners = np.union1d([b.u for b in curve.breaks if b.is_corner], places)
    count = int(np.ceil(profile.duration / block_time))
    if count > _MAX_BLOCKS:
        raise InputError(f"block_time = {block_time!r} s makes {count} blocks; at most {_MAX_BLOCKS} are written")
    fixed = np.unique(np.concatenate([[0.0, profile.duration], _times_at(law, corners), _stops(profile)]))
    coarse = _merge_times(fixed, np.linspace(0.0, profile.duration, count + 1), 0.25 * block_time)
    t, u = _within(curve, profile, room, coarse, corners)
    stops = np.isin(t, _stops(profile)[1:-1])
    made = _rounded(curve, u, t, _positions(curve, u), stops, room)
    return replace(made, blends=_blends(curve, made, profile, room))


def _within(
    curve: Curve, profile: FeedrateProfile, room: Room, coarse: FloatArray, corners: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Times and parameters of points whose lines are within their room, with the coarse times among them.

    What lies between two coarse times is cut into equal parts: an arc between lines is as wide as the shorter one allows.
    """
    rounding = 0.5 * 10.0**-room.decimals * np.sqrt(curve.dim)
    at_coarse = _parameters_at(curve, profile.law, coarse, corners)
    parts = np.ones(coarse.size - 1, dtype=int)
    for _ in range(_MAX_ROUNDS):
        first = np.repeat(np.arange(parts.size), parts)
        step = np.arange(first.size) - np.repeat(np.cumsum(parts) - parts, parts)
        t = np.append(coarse[first] + step / parts[first] * np.diff(coarse)[first], coarse[-1])
        u = profile.law.at(t)[0]
        u[np.append(step == 0, True)] = at_coarse
        position = _positions(curve, u)
        taken = rounding + _taken(curve, position, profile.at(t).feed, room)
        over = (_deviations(curve, u, position) / _PROBE_SHARE + taken) / room.tolerance
        worst = np.maximum.reduceat(over, np.flatnonzero(step == 0))
        wide = worst > 1.0
        if not wide.any():
            return t, u
        # The distance to a chord falls with the square of its length.
        more = np.ceil(np.minimum(np.sqrt(worst), _MAX_GROWTH) * parts).astype(int)
        parts = np.where(wide, np.maximum(parts + 1, more), parts)
        if parts.sum() >= _MAX_BLOCKS:
            raise InputError(
                f"tolerance = {room.tolerance!r} mm makes more than {_MAX_BLOCKS} blocks; give a larger one"
            )
    raise InputError(
        f"tolerance = {room.tolerance!r} mm is below what the digits of the curve's parameter allow; give a larger one"
    )


def _taken(curve: Curve, position: FloatArray, speed: FloatArray, room: Room) -> FloatArray:
    """What blending takes of the tolerance in each block, (n - 1,), mm."""
    if not room.follows(curve):
        return np.full(speed.size - 1, room.largest_blend)
    needed, _ = needed_blends(block_motion(position, speed, room))
    return _P_STEP * np.maximum(np.append(0.0, needed), np.append(needed, 0.0))


def _blends(curve: Curve, blocks: WrittenBlocks, profile: FeedrateProfile, room: Room) -> FloatArray:
    """P of each block: what its kinks need, in steps; where they need none, what the line leaves, at most half."""
    if not room.follows(curve):
        return np.full(blocks.t.size - 1, room.largest_blend)
    motion = block_motion(blocks.points, profile.at(blocks.t).feed, room)
    needed, free = needed_blends(motion)
    least = np.maximum(np.append(0.0, needed), np.append(needed, 0.0))
    free = np.append(True, free) & np.append(free, True)
    left = np.clip((1.0 - 1e-4) * room.tolerance - blocks.deviations, _MIN_SHARE * room.tolerance, None)  # P has digits
    stepped = room.tolerance * _P_STEP ** np.ceil(
        np.log(np.maximum(least / room.tolerance, _MIN_SHARE)) / np.log(_P_STEP)
    )
    return np.minimum(np.where(free, room.largest_blend, stepped), left)


def block_motion(points: FloatArray, speed: FloatArray, room: Room) -> BlockMotion:
    """Lines between points in mm, with the planned speed at each."""
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    return BlockMotion(length, step / np.maximum(length, 1e-300)[:, None], speed, room.acceleration, room.period)


def _parameters_at(curve: Curve, law: TimeLaw, t: FloatArray, corners: FloatArray) -> FloatArray:
    """Parameters at times; at a corner the parameter itself: found from the time, it would be off by a rounding."""
    u = law.at(t)[0]
    at = np.searchsorted(corners, u)
    for k in (np.clip(at - 1, 0, None), at):
        if corners.size:
            near = corners[np.minimum(k, corners.size - 1)]
            u = np.where(np.abs(u - near) <= 1e-9 * np.ptp(curve.domain), near, u)
    u[0], u[-1] = curve.domain
    return u


def blocks_of_samples(curve: Curve, samples: Samples, room: Room) -> WrittenBlocks:
    """Samples as they are, a block each."""
    return _rounded(curve, samples.u, samples.t, samples.position, np.zeros(samples.t.size, dtype=bool), room)


def _rounded(
    curve: Curve, u: FloatArray, t: FloatArray, position: FloatArray, stops: NDArray[np.bool_], room: Room
) -> WrittenBlocks:
    """Points as they are written; those that rounding makes equal become one, and the time stays with the next."""
    scale = np.array([1.0 if unit == "mm" else DEGREES for unit in curve.axis_units])
    points = np.round(position * scale, room.decimals)
    keep = np.append(True, np.any(np.diff(points, axis=0) != 0.0, axis=1))
    last = int(np.flatnonzero(keep)[-1])
    if last == 0:
        raise InputError(f"{curve.name}: all points are equal when written with {room.decimals} decimals")
    t, u = t.copy(), u.copy()
    t[last], u[last] = t[-1], u[-1]  # a rest at the end belongs to the last block
    # Which points are dropped before a kept one does not matter: they are that one, or the one before it.
    deviations = _deviations(curve, u[keep], points[keep] / scale)
    stopped = np.maximum.reduceat(stops, np.flatnonzero(keep))
    blends = np.full(int(keep.sum()) - 1, room.largest_blend)
    return WrittenBlocks(points[keep], t[keep], u[keep], stopped, blends, deviations)


def _positions(curve: Curve, u: FloatArray) -> FloatArray:
    return curve.derivatives(u, 0)[0]


def _deviations(curve: Curve, u: FloatArray, points: FloatArray) -> FloatArray:
    """Largest distance, in each block, from probes of the curve to the line between the points, (n - 1,), mm."""
    lever = np.array([1.0 if unit == "mm" else DEGREES for unit in curve.axis_units])
    fraction = 0.5 - 0.5 * np.cos(np.pi * (np.arange(_PROBES) + 0.5) / _PROBES)
    largest = np.empty(u.size - 1)
    for lo in range(0, u.size - 1, 100_000):
        rows = slice(lo, min(lo + 100_000, u.size - 1))
        a, chord = points[rows] * lever, np.diff(points[lo : rows.stop + 1], axis=0) * lever
        ends = u[lo : rows.stop + 1]
        at = ends[:-1, None] + np.diff(ends)[:, None] * np.append(fraction, [0.0, 1.0])
        probes = curve.derivatives(np.clip(at, *curve.domain), 0)[0] * lever - a[:, None]
        along = np.einsum("npd,nd->np", probes, chord) / np.maximum(np.sum(chord**2, axis=1), 1e-300)[:, None]
        away = probes - np.clip(along, 0.0, 1.0)[..., None] * chord[:, None]
        largest[rows] = np.sqrt(np.sum(away**2, axis=2)).max(axis=1)
    return largest


def _stops(profile: FeedrateProfile) -> FloatArray:
    """Times at which the plan rests, both ends included."""
    resting = profile.u_rate <= 1e-9 * profile.u_rate.max()
    return np.unique(np.concatenate([[0.0], profile.t[resting], [profile.duration]]))


def _times_at(law: TimeLaw, u: FloatArray) -> FloatArray:
    """Times at which the plan passes the parameters u, by bisection."""
    lo, hi = np.zeros(u.size), np.full(u.size, law.t[-1])
    for _ in range(60):
        middle = 0.5 * (lo + hi)
        before = law.at(middle)[0] < u
        lo, hi = np.where(before, middle, lo), np.where(before, hi, middle)
    # A node of the plan stands on every corner: its time, where it is that close, joins the stop there.
    k = np.clip(np.searchsorted(law.t, hi), 1, law.t.size - 1)
    near = np.where(hi - law.t[k - 1] < law.t[k] - hi, law.t[k - 1], law.t[k])
    return np.where(np.abs(near - hi) <= 1e-9 * law.t[-1], near, hi)


def _merge_times(fixed: FloatArray, others: FloatArray, distance: float) -> FloatArray:
    """All fixed times, and those others that are farther than a distance from them."""
    k = np.searchsorted(fixed, others)
    below, above = fixed[np.maximum(k - 1, 0)], fixed[np.minimum(k, fixed.size - 1)]
    free = np.minimum(np.abs(others - below), np.abs(others - above)) > distance
    return np.sort(np.concatenate([fixed, others[free]]))


def lengths_of_feed(curve: Curve, points: FloatArray) -> FloatArray:
    """Way of each block that F counts: along X Y Z where any of these moves, else along U V W, else along A B C, degrees."""
    step = np.diff(points, axis=0)
    way = np.zeros(step.shape[0])
    for group in (AXES[:3], AXES[6:], AXES[3:6]):
        chosen = np.array([axis in group for axis in curve.axes])
        way = np.where(way > 0.0, way, np.sqrt(np.sum(step[:, chosen] ** 2, axis=1)))
    return way
