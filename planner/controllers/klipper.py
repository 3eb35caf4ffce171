"""How Klipper moves: trapezoids with one acceleration along the path, and junction speeds from the square corner velocity.

Sources: Klipper's pages "Kinematics" and "Configuration reference", and what its planner was measured to do.

1. Arcs are chords of equal angles, as many as fit whole into the arc's length at the resolution; at least one.  G0 and G1
   are the same: both run at the F word in force (25 mm/s before the first), at most max_velocity.
2. A move with Z keeps the component along Z below max_z_velocity and max_z_accel.
3. *Junctions.*  The path encloses the angle t where two moves meet (180 degrees: straight on).  A circle of the radius

       R = d sin(t/2) / (1 - sin(t/2)),    d = scv^2 (sqrt(2) - 1) / max_accel,

   touches both moves, and v^2 <= a R: at 90 degrees that is the square corner velocity.  It must not touch them beyond their
   middle, v^2 <= a L tan(t/2) / 2, for both.  Straight on there is no limit, and where the path turns back v = 0.
4. *Look-ahead.*  v1^2 = v0^2 + 2 a L, forwards and backwards, from stop to stop over everything between.
5. *Smoothing.*  The same with (1 - minimum_cruise_ratio) a gives a second, slower motion.  Its peaks cap the first: from one
   stretch of slowing down to the next no move is faster than the peak between them, so that short moves do not go up and
   down.  Where the slow motion only slows down, the fast one does not speed up.

Known limitation: what runs while it moves (macros, pressure advance, a raised limit inside a program) is not in it, and a
host that is too slow or a file that comes in late is not either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.controllers.controller_motion import ControllerMotion, Trapezoids, look_ahead_squared
from planner.controllers.straight_blocks import STRAIGHT_AXES, StraightBlocks, straight_blocks
from planner.errors import InputError
from planner.inputs import positive_number, shorten
from planner.machine.limits import Limits
from planner.programs.reading.program import Program
from planner.types import FloatArray, IntArray

KLIPPER = "klipper"
FIRST_FEED = 25.0  # mm/s, before the first F word
_WAITS_FOR = ("dwell", "tool_change", "stop", "end")
_NO_LIMIT = np.inf


@dataclass(frozen=True)
class KlipperSettings:
    """What of a Klipper configuration its planner uses, mm and s; the defaults are Klipper's own.

    Parameters
    ----------
    max_velocity, max_accel : float
        Along the path, mm/s and mm/s^2.
    max_z_velocity, max_z_accel : float
        Of Z; inf leaves it to the path.
    square_corner_velocity : float
        mm/s, >= 0.
    minimum_cruise_ratio : float
        In [0, 1).
    arc_resolution : float
        Length of the chords of arcs, mm.
    """

    max_velocity: float
    max_accel: float
    max_z_velocity: float = np.inf
    max_z_accel: float = np.inf
    square_corner_velocity: float = 5.0
    minimum_cruise_ratio: float = 0.5
    arc_resolution: float = 1.0

    def __post_init__(self) -> None:
        for name in ("max_velocity", "max_accel", "max_z_velocity", "max_z_accel", "arc_resolution"):
            positive_number(getattr(self, name), name)
        for name in ("max_velocity", "max_accel"):
            if np.isinf(getattr(self, name)):
                raise InputError(f"{name} = inf must be finite: Klipper has no motion without it")
        for name, top in (("square_corner_velocity", np.inf), ("minimum_cruise_ratio", 1.0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 <= value < top:
                below = "" if np.isinf(top) else f" and < {top:g}"
                raise InputError(f"{name} = {shorten(repr(value))} must be a number >= 0{below}")


KLIPPER_KEYS = {
    "square_corner_velocity_mm_s": "square_corner_velocity",
    "minimum_cruise_ratio": "minimum_cruise_ratio",
    "arc_resolution_mm": "arc_resolution",
}
"""Settings that are no limits, by their keys with units."""


def klipper_on(limits: Limits) -> KlipperSettings:
    """The limits of a machine as those of Klipper: the slower of X and Y along the path, and Z.

    Raises
    ------
    InputError
        If the machine has no X or Y, or no limit on their velocity or acceleration.
    """
    plane = [limits.axes.index(name) for name in ("X", "Y") if name in limits.axes]
    if not plane:
        raise InputError(f"the machine has the axes {', '.join(limits.axes)}; Klipper needs X or Y")
    climb = {}
    if "Z" in limits.axes:
        k = limits.axes.index("Z")
        climb = {"max_z_velocity": float(limits.velocity[k]), "max_z_accel": float(limits.acceleration[k])}
    return KlipperSettings(
        max_velocity=float(min(limits.feed, limits.velocity[plane].min())),
        max_accel=float(min(limits.tangential_acceleration, limits.acceleration[plane].min())),
        **climb,
    )


def klipper_motion(program: Program, settings: KlipperSettings) -> ControllerMotion:
    """The motion of a part program on Klipper.

    Raises
    ------
    InputError
        If the program has splines or moves other axes than X Y Z.
    """

    def chords(_radius: FloatArray, _angle: FloatArray, length: FloatArray) -> IntArray:
        return np.floor(length / settings.arc_resolution).astype(np.intp)

    blocks = straight_blocks(program, KLIPPER, chords, _WAITS_FOR)
    feed = np.where(np.isnan(blocks.modal_feed), FIRST_FEED, blocks.modal_feed)
    cap, rate = np.minimum(feed, settings.max_velocity), np.full(feed.size, settings.max_accel, dtype=np.float64)
    climb = np.abs(blocks.direction[:, 2])
    climbing = climb > 0.0
    cap[climbing] = np.minimum(cap[climbing], settings.max_z_velocity / climb[climbing])
    rate[climbing] = np.minimum(rate[climbing], settings.max_z_accel / climb[climbing])
    allowed = _allowed_squared(blocks, settings, cap, rate)
    slow = np.minimum(rate, (1.0 - settings.minimum_cruise_ratio) * settings.max_accel)
    shape = _smoothed(allowed, cap**2, 2.0 * blocks.length * rate, 2.0 * blocks.length * slow, rate)
    return shape.motion(KLIPPER, STRAIGHT_AXES, blocks.legs, blocks.length, blocks.line)


def _allowed_squared(
    blocks: StraightBlocks, settings: KlipperSettings, cap: FloatArray, rate: FloatArray
) -> FloatArray:
    """Squares of the highest speeds at the ends of blocks, (n + 1,): of rule 3, the caps on both sides, and stops."""
    sine, cosine = blocks.turn
    deviation = settings.square_corner_velocity**2 * (np.sqrt(2.0) - 1.0) / settings.max_accel
    bent = (sine < 1.0) & (cosine > 0.0)
    on_circle = np.divide(deviation * sine, 1.0 - sine, out=np.full(sine.size, _NO_LIMIT), where=bent)
    to_middle = np.divide(0.5 * sine, cosine, out=np.full(sine.size, _NO_LIMIT), where=bent)
    least = np.minimum(rate[1:], rate[:-1])
    reach = rate * blocks.length
    inner = np.minimum(np.minimum(cap[1:], cap[:-1]) ** 2, on_circle * least)
    inner = np.minimum(inner, to_middle * np.minimum(reach[1:], reach[:-1]))
    allowed = np.concatenate([[0.0], inner, [0.0]])
    allowed[blocks.stop] = 0.0
    return allowed


def _smoothed(
    allowed: FloatArray, cap: FloatArray, gain: FloatArray, slow_gain: FloatArray, rate: FloatArray
) -> Trapezoids:
    """Rules 4 and 5, in squares of speeds, mm^2/s^2: allowed at the ends (n + 1,), cap and gains of the blocks (n,)."""
    fast, slow = (look_ahead_squared(allowed, step, step) for step in (gain, slow_gain))
    begin, end = slow[:-1], slow[1:]
    every = np.arange(cap.size)
    falling = begin >= end + slow_gain
    rising = begin + slow_gain <= end
    before_falling = np.append(falling[1:], False)
    is_peak = ~falling & (~rising | before_falling)
    peak = np.minimum(cap, 0.5 * (begin + end + slow_gain))
    # the peak ahead of a block that is rising, its own, or the one behind a block that is falling
    ahead = np.minimum.accumulate(np.where(is_peak, every, cap.size - 1)[::-1])[::-1]
    behind = np.maximum.accumulate(np.where(is_peak, every, 0))
    highest = peak[np.where(falling, behind, ahead)]
    top = np.minimum(np.minimum(0.5 * (fast[:-1] + fast[1:] + gain), cap), highest)
    for i in np.flatnonzero(falling).tolist():  # in order: none is faster than the falling one before it
        top[i] = min(fast[i], top[i - 1] if falling[i - 1] else highest[i])
    speeds = [np.sqrt(part) for part in (np.minimum(fast[:-1], top), top, np.minimum(fast[1:], top))]
    return Trapezoids(speeds[0], speeds[1], speeds[2], rate, rate)
