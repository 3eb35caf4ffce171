"""The motion that a controller makes of a part program: constant acceleration, piece by piece, along legs.

Within a piece that begins at the time t0 on a leg, at the distance x0 from its start and with the speed v0,

    x(t) = x0 + v0 (t - t0) + a (t - t0)^2 / 2.

The legs are what the controller moves along: the lines of the program, arcs or the chords it makes of them, blend arcs.  A
rest between two moves (a dwell, a tool change) takes no time here.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.blend import Legs
from planner.geometry.chain import ChainCurve, Kind
from planner.geometry.curve import DEGREES, ROTARY_AXES
from planner.inputs import positive_number
from planner.samples import Samples
from planner.types import FloatArray, IntArray

_MAX_SAMPLES = 50_000_000
# Pieces that take less have no weight: rounding of the distance that is left for a cruise.
_NO_TIME = 1e-12  # s


@dataclass(frozen=True, eq=False, repr=False)
class ControllerMotion:
    """What a controller does; all arrays are read-only, k pieces in the order of time on n legs in that of the program.

    Attributes
    ----------
    controller : str
        Its name in :data:`planner.controllers.known.CONTROLLERS`.
    axes : tuple of str
        Names of the columns of the legs.
    legs : Legs
        In mm and degrees; each begins where the one before it ends.
    length : (n,) array
        Of each leg, mm.
    line : (n,) int array
        Line of the program that each leg is of.
    start : (k + 1,) array
        Times at which the pieces begin, s, from 0, and at which the last ends.
    leg : (k,) int array
        The leg of each piece.
    x, speed, acceleration : (k,) arrays
        Distance from the start of the leg, mm, and speed, mm/s, at the start of the piece; acceleration along it, mm/s^2.
    """

    controller: str
    axes: tuple[str, ...]
    legs: Legs
    length: FloatArray
    line: NDArray[np.int64]
    start: FloatArray
    leg: IntArray
    x: FloatArray
    speed: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __repr__(self) -> str:
        return f"ControllerMotion({self.controller}: {self.length.size} legs, {self.duration:.6g} s)"

    @property
    def duration(self) -> float:
        """Time of all motion, s."""
        return float(self.start[-1])

    @cached_property
    def leg_seconds(self) -> FloatArray:
        """Time of each leg, (n,), s."""
        return np.bincount(self.leg, np.diff(self.start), self.length.size).astype(np.float64)

    def line_seconds(self) -> tuple[NDArray[np.int64], FloatArray]:
        """Lines of the program that move, ascending, and the time of each, s; they add up to the duration."""
        line, row = np.unique(self.line, return_inverse=True)
        return line, np.bincount(row, self.leg_seconds, line.size).astype(np.float64)

    def piece_at(self, t: FloatArray) -> IntArray:
        """Piece at the times t (m,), of two that meet there the later one."""
        return np.clip(np.searchsorted(self.start, t, side="right") - 1, 0, self.leg.size - 1)

    def distance(self, t: FloatArray) -> tuple[IntArray, FloatArray]:
        """Leg at the times t (m,), s, and the distance from its start, (m,), mm; before and after the motion it rests."""
        time = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        piece = self.piece_at(time)
        since = time - self.start[piece]
        x = self.x[piece] + since * (self.speed[piece] + 0.5 * since * self.acceleration[piece])
        leg = self.leg[piece]
        return leg, np.clip(x, 0.0, self.length[leg])

    def at(self, t: FloatArray) -> FloatArray:
        """Positions at the times t (m,), (m, dim), mm and rad."""
        leg, x = self.distance(t)
        return np.asarray(self.legs.at(leg, x)[0] * self._scale)

    def speed_at(self, t: FloatArray) -> FloatArray:
        """Speed along the leg at the times t (m,), mm/s; of two pieces that meet there that of the later one."""
        time = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        piece = self.piece_at(time)
        return np.asarray(self.speed[piece] + self.acceleration[piece] * (time - self.start[piece]))

    def on_axes(self, axes: tuple[str, ...]) -> ControllerMotion:
        """The same motion in some of its axes, in this order: the others must rest.

        Raises
        ------
        InputError
            If an axis is not one of its own, or one that is left out moves.
        """
        missing = [name for name in axes if name not in self.axes]
        if missing:
            raise InputError(f"the motion has the axes {', '.join(self.axes)}; {missing[0]} is none of them")
        left = [k for k, name in enumerate(self.axes) if name not in axes]
        moving = np.flatnonzero(np.abs(self.legs.vectors[:, 1:, left]).max(axis=(0, 1), initial=0.0))
        if moving.size:
            raise InputError(f"axis {self.axes[left[moving[0]]]} moves; it cannot be left out of {', '.join(axes)}")
        columns = [self.axes.index(name) for name in axes]
        legs = Legs(np.ascontiguousarray(self.legs.vectors[:, :, columns]), self.legs.rates)
        return replace(self, axes=tuple(axes), legs=legs)

    def curve(self, name: str) -> ChainCurve:
        """The path of this motion as a curve, by its arc length, for the check."""
        edges, every = np.concatenate([[0.0], np.cumsum(self.length)]), np.arange(self.length.size)
        vectors = self.legs.vectors * self._scale
        return ChainCurve(
            edges=edges,
            kind=np.full(every.size, Kind.LEG, dtype=np.int8),
            row=every,
            offset=np.zeros(every.size),
            legs=Legs(vectors, self.legs.rates, self.legs.ways, self.legs.beziers),
            blends=None,
            spans=np.empty((0, len(self.axes), 5)),
            joints=edges[1:-1],
            stops=np.empty(0),
            marks=np.empty(0),
            axes=self.axes,
            name=name,
        )

    def samples(self, period: float) -> Samples:
        """One point a period, from rest to rest, on the curve that :meth:`curve` makes.

        Raises
        ------
        InputError
            If the period is not positive, or there would be too many samples.
        """
        period = positive_number(period, "period")
        count = int(np.ceil(self.duration / period * (1.0 - 1e-12)))
        if count >= _MAX_SAMPLES:
            raise InputError(
                f"period = {period:g} s makes {count} samples of {self.duration:.6g} s; at most {_MAX_SAMPLES} are made"
            )
        t = np.arange(count + 1, dtype=np.float64) * period
        leg, x = self.distance(t)
        curve = self.curve(self.controller)
        u = np.minimum(curve.edges[leg] + x, curve.edges[leg + 1])
        u[-1] = curve.edges[-1]
        return Samples(period, t, u, np.array(curve.derivatives(u, 0)[0]), axes=self.axes)

    @property
    def _scale(self) -> FloatArray:
        """What turns the legs' coordinates into mm and rad, (dim,)."""
        return np.array([1.0 / DEGREES if name in ROTARY_AXES else 1.0 for name in self.axes])


@dataclass(frozen=True, eq=False)
class Trapezoids:
    """How fast each leg is passed: it speeds up from its entry, cruises, and slows down to its exit.

    Attributes
    ----------
    entry, cruise, exit : (n,) arrays
        Speeds, mm/s.
    rise, fall : (n,) arrays
        Size of the acceleration up to the cruise and down from it, mm/s^2.
    """

    entry: FloatArray
    cruise: FloatArray
    exit: FloatArray
    rise: FloatArray
    fall: FloatArray

    def motion(
        self, controller: str, axes: tuple[str, ...], legs: Legs, length: FloatArray, line: NDArray[np.int64]
    ) -> ControllerMotion:
        """The motion on legs of these lengths (n,) and lines (n,): up to three pieces each.

        v^2 = v0^2 + 2 a x gives the length of both ramps; what is left of the leg is passed at the cruise.  An acceleration
        of a ramp that is no ramp does not matter.
        """
        up = _ramp_length(self.cruise, self.entry, self.rise)
        down = _ramp_length(self.cruise, self.exit, self.fall)
        steady = np.maximum(length - up - down, 0.0)
        seconds = np.stack(
            [
                _ratio(2.0 * up, self.entry + self.cruise),
                _ratio(steady, self.cruise),
                _ratio(2.0 * down, self.exit + self.cruise),
            ],
            axis=1,
        ).reshape(-1)
        x = np.stack([np.zeros(length.size), up, up + steady], axis=1).reshape(-1)
        speed = np.stack([self.entry, self.cruise, self.cruise], axis=1).reshape(-1)
        acceleration = np.stack([self.rise, np.zeros(length.size), -self.fall], axis=1).reshape(-1)
        some = np.flatnonzero(seconds > _NO_TIME)
        return ControllerMotion(
            controller=controller,
            axes=axes,
            legs=legs,
            length=length,
            line=line,
            start=np.concatenate([[0.0], np.cumsum(seconds[some])]),
            leg=np.repeat(np.arange(length.size), 3)[some],
            x=x[some],
            speed=speed[some],
            acceleration=acceleration[some],
        )


def cut_legs(motion: ControllerMotion, leg: IntArray, x: FloatArray, line: NDArray[np.int64]) -> ControllerMotion:
    """The same motion with legs cut in two.

    Parameters
    ----------
    motion : ControllerMotion
    leg, x : (k,) arrays
        The legs and the distances from their starts, mm, in the order of the motion.  They must be lines.
    line : (k,) int array
        Line of the program of what is before each cut, up to the cut before.
    """
    edges = np.concatenate([[0.0], np.cumsum(motion.length)])
    starts = edges[motion.leg] + motion.x
    cut = edges[leg] + x
    # of pieces that begin at the same place the last one moves on from there
    piece = np.searchsorted(starts, cut, side="right") - 1
    way = np.maximum(cut - starts[piece], 0.0)
    speed, rate = motion.speed[piece], motion.acceleration[piece]
    there = np.sqrt(np.maximum(speed**2 + 2.0 * rate * way, 0.0))
    seconds = np.minimum(_ratio(2.0 * way, speed + there), np.diff(motion.start)[piece])
    every = np.arange(leg.size)
    counted = np.searchsorted(piece, np.arange(motion.leg.size), side="left")
    at = piece + 1
    new_leg = np.insert(motion.leg + counted, at, leg + every + 1)
    new_edges = np.insert(edges, leg + 1, cut)
    row = np.insert(np.arange(motion.length.size), leg, leg)
    vectors = motion.legs.vectors[row].copy()
    vectors[:, 0] += (new_edges[:-1] - edges[row])[:, None] * vectors[:, 3] * (motion.legs.rates[row, :1] == 0.0)
    return replace(
        motion,
        legs=Legs(vectors, motion.legs.rates[row]),
        length=np.diff(new_edges),
        line=np.insert(motion.line, leg, line),
        start=np.insert(motion.start, at, motion.start[piece] + seconds),
        leg=new_leg,
        x=np.maximum(np.insert(starts, at, cut) - new_edges[new_leg], 0.0),
        speed=np.insert(motion.speed, at, there),
        acceleration=np.insert(motion.acceleration, at, rate),
    )


def peak_speed(
    entry: FloatArray, out: FloatArray, length: FloatArray, rise: FloatArray, fall: FloatArray, cap: FloatArray
) -> FloatArray:
    """Highest speed that legs reach between their ends, (n,), mm/s.

    The two ramps of v0^2 + 2 r x and v1^2 + 2 f (L - x) meet at

        v^2 = (f v0^2 + r v1^2 + 2 r f L) / (r + f),

    and no speed is above the cap.
    """
    meeting = (fall * entry**2 + rise * out**2 + 2.0 * rise * fall * length) / (rise + fall)
    return np.minimum(cap, np.sqrt(meeting))


def look_ahead(junction: FloatArray, length: FloatArray, rise: FloatArray, fall: FloatArray) -> FloatArray:
    """Highest speeds at the ends of legs that both can be reached from the start and slowed down from.

    Backwards v_i^2 <= v_(i+1)^2 + 2 f_i L_i, and forwards v_(i+1)^2 <= v_i^2 + 2 r_i L_i.

    Parameters
    ----------
    junction : (n + 1,) array
        Highest speed allowed at the start of each leg, and at the end of the last, mm/s; 0 for a stop.
    length : (n,) array
        mm.
    rise, fall : (n,) arrays
        Accelerations up and down, mm/s^2.

    Returns
    -------
    (n + 1,) array
    """
    return np.sqrt(look_ahead_squared(junction**2, 2.0 * rise * length, 2.0 * fall * length))


def look_ahead_squared(junction: FloatArray, gain: FloatArray, loss: FloatArray) -> FloatArray:
    """The same in squares of speeds, mm^2/s^2, (n + 1,): of what is allowed, and how much each leg can gain and lose.

    Where a leg does nothing but speed up or slow down, its ends differ by exactly its gain or its loss.
    """
    square, up, down = junction.tolist(), gain.tolist(), loss.tolist()
    for i in range(len(down) - 1, -1, -1):
        square[i] = min(square[i], square[i + 1] + down[i])
    for i in range(len(up)):
        square[i + 1] = min(square[i + 1], square[i] + up[i])
    return np.array(square)


def _ramp_length(fast: FloatArray, slow: FloatArray, acceleration: FloatArray) -> FloatArray:
    return _ratio(np.maximum(fast**2 - slow**2, 0.0), 2.0 * acceleration)


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Quotient, 0 where nothing is divided."""
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=numerator > 0.0)
