"""Feed limits of a curve: what is commanded along it, and what axes, chord error and curvature leave of that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.geometry.chord import half_chord
from planner.geometry.curve import ROTARY_AXES, Curve
from planner.geometry.differential import curvature_vector, norm
from planner.inputs import positive_number
from planner.machine.limits import Limits, require_limits
from planner.types import FloatArray, Side

COMMANDS = ("feed", "programmed feed", "rapid")
"""Whose feed may be commanded at a point: that of the limits, a cap of the curve, that of rapids."""


@dataclass(frozen=True, eq=False)
class FeedrateLimits:
    """The four feedrate limits along a curve, mm/s, each with the shape of u (2022, FRLimit-1 to 4)."""

    command: FloatArray
    axis_velocity: FloatArray
    chord_error: FloatArray
    normal_acceleration: FloatArray

    @property
    def lowest(self) -> FloatArray:
        """The limit that counts at every u."""
        stacked = np.stack([self.command, self.axis_velocity, self.chord_error, self.normal_acceleration])
        return np.asarray(stacked.min(axis=0))


def feedrate_limits(
    curve: Curve, limits: Limits, u: ArrayLike, *, safety: float = 1.0, side: Side = "right"
) -> FeedrateLimits:
    """Evaluate the four feedrate limits as functions of the curve parameter.

        1  F                                     the command
        2  min_j V_j / |t_j|                     t = dq/ds, the axes' share of the feed
        3  (2/T) sqrt(2 rho e - e^2)             e = min(chord_error, rho)
        4  min_j sqrt(lambda A_j / |k_j|)        k = d2q/ds2; on a plane curve k = n/rho

    Parameters
    ----------
    curve : Curve
    limits : Limits
    u : array_like
        Curve parameters.
    safety : float
        The factor lambda in (0, 1] of limit 4.
    side : {"right", "left"}
        One-sided value at a break.

    Returns
    -------
    FeedrateLimits
        Each limit with the shape of u, mm/s; inf where a limit does not apply (also where the tip rests).

    Raises
    ------
    InputError
        If the safety factor is outside (0, 1] or the axes do not match.
    """
    limits = require_limits(curve, limits)
    factor = positive_number(safety, "safety")
    if factor > 1.0:
        raise InputError(f"safety = {factor!r} must lie in (0, 1]")
    axes = curve.derivatives(u, 2, side=side)
    tip = curve.tip.derivatives(u, 2, side=side)
    speed = norm(tip[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        axis_velocity = (limits.velocity / np.abs(axes[1] / speed[..., None])).min(axis=-1)
        normal = np.sqrt((factor * limits.acceleration / np.abs(curvature_vector(axes, tip))).min(axis=-1))
    moving = speed > 0.0
    return FeedrateLimits(
        command=commanded_feed(curve, limits, np.asarray(u, dtype=np.float64), side == "left"),
        axis_velocity=np.where(moving, axis_velocity, np.inf),
        chord_error=chord_feed_limit(curve.tip.curvature(u, side=side), limits),
        normal_acceleration=np.where(moving, normal, np.inf),
    )


def commanded_feed(curve: Curve, limits: Limits, u: FloatArray, left: NDArray[np.bool_] | bool = False) -> FloatArray:
    """Feed limit at parameters u, mm/s: the lower of that of the limits and of the curve's own caps; of rapids their own."""
    if curve.feed_caps is None:
        return np.full(u.shape, limits.feed)
    caps = curve.feed_caps
    return caps.commanded(limits.feed, limits.rapid)[caps.stretch(u, left)]


def command_kind(
    curve: Curve, limits: Limits, u: FloatArray, left: NDArray[np.bool_] | bool = False
) -> NDArray[np.int8]:
    """Which of ``COMMANDS`` sets the feed limit at parameters u: that of the limits, a cap of the curve, that of rapids."""
    if curve.feed_caps is None:
        return np.zeros(u.shape, dtype=np.int8)
    caps = curve.feed_caps
    own = caps.feed < limits.feed
    own = own if caps.angular is None else own | caps.angular
    return np.where(np.isinf(caps.feed), 2, np.where(own, 1, 0)).astype(np.int8)[caps.stretch(u, left)]


def largest_command(curve: Curve, limits: Limits) -> float:
    """Largest feed commanded anywhere on a curve, mm/s."""
    if curve.feed_caps is None:
        return limits.feed
    return float(curve.feed_caps.commanded(limits.feed, limits.rapid).max())


def chord_feed_limit(curvature: FloatArray, limits: Limits) -> FloatArray:
    """Feed at which the chord of one period leaves the osculating circle by the chord error, mm/s.

    (2/T) sqrt(2 rho e - e^2); where the tolerance e exceeds the radius rho, it takes the radius.
    """
    if np.isinf(limits.chord_error):
        return np.full(curvature.shape, np.inf)
    return np.asarray(2.0 / limits.period * half_chord(curvature, limits.chord_error))


def largest_chord_error(curve: Curve, limits: Limits) -> float:
    """Distance, mm, that the path leaves its chords of one period by at most, by the accelerations alone.

    A linear interpolation over T of a function whose second derivative is at most A is off by A T^2 / 8.  Velocities are
    continuous: in a corner a plan stops.
    """
    linear = [axis not in ROTARY_AXES for axis in curve.axes]
    return float(norm(limits.acceleration[linear])) * limits.period**2 / 8.0


def osculating_limits(curve: Curve, limits: Limits) -> Limits:
    """The limits, without a chord error where the feed of the osculating circle would ask for more than it.

    In a bend tighter than the chord error that feed is not the chord's.  A path that was found with its feed has such bends,
    in sharp turns; where the accelerations alone keep every chord nothing need be asked for.
    """
    if curve.timing is None or largest_chord_error(curve, limits) > limits.chord_error:
        return limits
    return limits.without_chord_error()
