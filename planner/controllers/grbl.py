"""How GRBL 1.1 moves: trapezoids, junction speeds from the junction deviation, limits of every axis, sixteen blocks.

Sources: the settings of GRBL v1.1 as its wiki has them; S. K. Jeon, "Improving Grbl: Cornering Algorithm" (2011) for the
junction deviation.

1. Arcs are chords whose distance from the arc is about the arc tolerance e ($12): of length 2 sqrt(e (2 r - e)), as many as
   fit whole into the arc, at least one.
2. *By direction.*  A block along the unit vector n has the highest speed min_j v_j / |n_j| of the axes' rates ($110 to $112)
   and the acceleration min_j a_j / |n_j| ($120 to $122).  G0 runs at that speed, other moves at their feed at most, and
   nothing slower than 1 mm/min.
3. *Junctions.*  The path encloses the angle t where two blocks meet.  A circle whose edge comes to the junction deviation d
   ($11) of the corner gives v^2 = a R, R = d sin(t/2) / (1 - sin(t/2)); a is the acceleration by direction, along the change
   of direction n2 - n1.  Straight on there is no limit; where the path turns back v = 0.  No junction is faster than both of
   its blocks.
4. *Look-ahead.*  v1^2 = v0^2 + 2 a L, forwards and backwards.  The planner holds few blocks: the one that is run, and those
   behind it, after the last of which it counts on a stop.  So v^2 at the start of a block is at most the sum of 2 a L over
   the blocks it knows from there on.  That matters where many short blocks follow one another.

Dwells, tool changes, stops, and words of the spindle and of the coolant let the buffer run empty.

5. *Steps.*  Points are rounded to steps ($100 to $102), which turns blocks of few steps, and so slows their junctions.

Known limitation: the serial line and the time to read a line are not in it, which hold back programs of more than some
hundred blocks a second; nor is laser mode.  The clock of the steps is not either: it rounds down by some 0.05 %.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from planner.controllers.controller_motion import ControllerMotion, Trapezoids, look_ahead_squared, peak_speed
from planner.controllers.straight_blocks import STRAIGHT_AXES, StraightBlocks, limits_of_straight_axes, straight_blocks
from planner.errors import InputError
from planner.inputs import numbers, positive_number, shorten
from planner.machine.limits import Limits
from planner.programs.reading.program import Program
from planner.types import FloatArray, IntArray

GRBL = "grbl"
MIN_FEED = 1.0 / 60.0  # mm/s
PLANNER_BLOCKS = 15  # of the ring of 16 one stays empty
_WAITS_FOR = ("dwell", "tool_change", "stop", "end", "spindle", "coolant")
_TURNED = 0.999999  # of the cosine: beyond, a junction turns back or goes straight on
_NO_LIMIT = np.inf


@dataclass(frozen=True, eq=False)
class GrblSettings:
    """What of the settings of GRBL its planner uses, mm and s; junction deviation and arc tolerance default to GRBL's own.

    Parameters
    ----------
    max_rate : (3,) sequence of float
        Of X Y Z, mm/s: $110 to $112, which are in mm/min there.
    acceleration : (3,) sequence of float
        mm/s^2: $120 to $122.
    junction_deviation : float
        mm, >= 0: $11.
    arc_tolerance : float
        mm: $12.
    planner_blocks : int
        Blocks that the planner holds, at least 2.
    steps_per_mm : float or (3,) sequence of float
        $100 to $102: the points are rounded to steps; inf, the default, does not round.
    """

    max_rate: FloatArray
    acceleration: FloatArray
    junction_deviation: float = 0.01
    arc_tolerance: float = 0.002
    planner_blocks: int = PLANNER_BLOCKS
    steps_per_mm: FloatArray = field(default_factory=lambda: np.full(3, np.inf))

    def __post_init__(self) -> None:
        for name in ("max_rate", "acceleration", "steps_per_mm"):
            row = numbers(getattr(self, name), name, InputError)
            finite = name != "steps_per_mm"
            row = row if finite or row.ndim else np.full(3, float(row))
            if row.shape != (3,) or not ((row > 0.0) & (np.isfinite(row) | (not finite))).all():
                raise InputError(
                    f"{name} = {shorten(str(row.tolist()))} must be three {'finite ' * finite}numbers > 0, of X Y Z"
                )
            row.setflags(write=False)
            object.__setattr__(self, name, row)
        positive_number(self.arc_tolerance, "arc_tolerance")
        value = self.junction_deviation
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 <= value < np.inf:
            raise InputError(f"junction_deviation = {shorten(repr(value))} must be a number >= 0")
        blocks = self.planner_blocks
        if isinstance(blocks, bool) or not isinstance(blocks, int | float | np.number) or not 2 <= blocks < np.inf:
            raise InputError(f"planner_blocks = {shorten(repr(blocks))} must be a whole number of at least 2")
        if blocks != int(blocks):
            raise InputError(f"planner_blocks = {blocks!r} must be a whole number of at least 2")
        object.__setattr__(self, "planner_blocks", int(blocks))


GRBL_KEYS = {
    "junction_deviation_mm": "junction_deviation",
    "arc_tolerance_mm": "arc_tolerance",
    "planner_blocks": "planner_blocks",
    "steps_per_mm": "steps_per_mm",
}
"""Settings that are no limits, by their keys with units."""


def grbl_on(limits: Limits) -> GrblSettings:
    """The limits of a machine as $110 to $112 and $120 to $122; an axis that it lacks moves in no program of it.

    Raises
    ------
    InputError
        If an axis has no limit on its velocity or acceleration.
    """
    return GrblSettings(*limits_of_straight_axes(limits, "GRBL"))


def grbl_motion(program: Program, settings: GrblSettings) -> ControllerMotion:
    """The motion of a part program on GRBL.

    Raises
    ------
    InputError
        If the program has splines or moves other axes than X Y Z.
    """

    def chords(radius: FloatArray, angle: FloatArray, _length: FloatArray) -> IntArray:
        error = settings.arc_tolerance
        half = np.sqrt(np.maximum(error * (2.0 * radius - error), 0.0))
        whole = np.divide(0.5 * angle * radius, half, out=np.ones(radius.size), where=half > 0.0)
        return np.floor(whole).astype(np.intp)

    steps = settings.steps_per_mm if np.isfinite(settings.steps_per_mm).all() else None
    blocks = straight_blocks(program, GRBL, chords, _WAITS_FOR, steps)
    rate = limit_along(settings.acceleration, blocks.direction)
    cap = np.minimum(np.maximum(blocks.feed, MIN_FEED), limit_along(settings.max_rate, blocks.direction))
    gain = 2.0 * blocks.length * rate
    allowed = np.minimum(_allowed_squared(blocks, settings, cap), _known_ahead(gain, settings.planner_blocks))
    ends = np.sqrt(look_ahead_squared(allowed, gain, gain))
    top = peak_speed(ends[:-1], ends[1:], blocks.length, rate, rate, cap)
    shape = Trapezoids(ends[:-1], top, ends[1:], rate, rate)
    return shape.motion(GRBL, STRAIGHT_AXES, blocks.legs, blocks.length, blocks.line)


def limit_along(limit: FloatArray, direction: FloatArray) -> FloatArray:
    """Limits of the axes (3,) as one along unit vectors (n, 3): min_j limit_j / |n_j|, (n,)."""
    size = np.abs(direction)
    return np.asarray(np.divide(limit, size, out=np.full(size.shape, _NO_LIMIT), where=size > 0.0).min(axis=1))


def _allowed_squared(blocks: StraightBlocks, settings: GrblSettings, cap: FloatArray) -> FloatArray:
    """Squares of the highest speeds at the ends of blocks, (n + 1,): of rule 3, the caps on both sides, and stops."""
    sine, _ = blocks.turn
    change = blocks.direction[1:] - blocks.direction[:-1]
    size = np.sqrt(np.sum(change**2, axis=1))
    straight, back = 1.0 - 2.0 * sine**2 < -_TURNED, 1.0 - 2.0 * sine**2 > _TURNED
    bent = ~straight & ~back
    inner = np.where(straight, _NO_LIMIT, 0.0)
    rate = limit_along(settings.acceleration, change[bent] / size[bent, None])
    inner[bent] = rate * settings.junction_deviation * sine[bent] / (1.0 - sine[bent])
    allowed = np.concatenate([[0.0], np.minimum(inner, np.minimum(cap[1:], cap[:-1]) ** 2), [0.0]])
    allowed[blocks.stop] = 0.0
    return allowed


def _known_ahead(gain: FloatArray, held: int) -> FloatArray:
    """Squares of the speeds from which the known blocks suffice to stop, (n + 1,).

    While a block runs, ``held`` - 1 are known behind it; the speed at its end is the one that these can lose.
    """
    lost = np.concatenate([[0.0], np.cumsum(gain)])
    every = np.arange(gain.size + 1)
    return lost[np.minimum(every + held - 1, gain.size)] - lost + np.where(every + held - 1 > gain.size, _NO_LIMIT, 0.0)
