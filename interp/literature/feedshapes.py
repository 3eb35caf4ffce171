"""Feed shapes with acceleration before or after interpolation (Cheng, Tsai, Cheng 2002).

*Before*: the feed V(t) rises and falls as a shape says, and Taylor steps of order 1 or 2 carry the curve parameter along

    u_{k+1} = u_k + T V_k / |C'| + T^2/2 (A_k / |C'| - V_k^2 (C'.C'') / |C'|^4)             (equations 8 and 9)

so that every sample lies on the curve.  *After*: the curve is interpolated at constant feed, and every axis' command is
smoothed by a filter whose step response is the same shape.  The feed then rises and falls alike, but the axes are
smoothed apart from each other: where the path bends it is left towards the inside.

Deviations from the paper: its figure of the shapes is lost, so the bell is a raised cosine and the exponential has a
time constant of a fifth of the ramp.  An exponential never ends: it is cut off one ramp after it begins to fall.

Known limitation: as published, these interpolators look at the command feed and at the acceleration along the path
alone.  They know no limit of an axis, no jerk limit and no chord error.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, isfinite
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from interp.periods import MAX_SAMPLES, WHOLE_PERIOD
from planner.compiled import core
from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.inputs import coordinates, positive_number, require_instance
from planner.samples import Samples
from planner.types import FloatArray

ShapeName = Literal["trapezoid", "exponential", "bell"]
FilterName = Literal["moving average", "half-sine", "exponential"]
SHAPES: tuple[ShapeName, ...] = get_args(ShapeName)
FILTERS: tuple[FilterName, ...] = get_args(FilterName)
# Feeds below this, mm/s, have no meaningful error.
SLOWEST_FEED = 1.0
# Time constants in the time of an exponential ramp: 0.7 % of the feed is left then.
_EXPONENTIAL_RATE = 5.0
# An exponential filter is followed for as many time constants: what is left of a step is 2e-9 of it.
_TIME_CONSTANTS_FOLLOWED = 20.0


@dataclass(frozen=True)
class FeedShape:
    """A feed over time, from rest to rest.

    Parameters
    ----------
    kind : str
        "trapezoid" (constant acceleration F/Ta), "exponential" (F (1 - exp(-5 t/Ta)), then F exp(-5 t/Ta)) or "bell"
        (F/2 (1 - cos(pi t/Ta))).
    length : float
        Distance to go, mm.
    feed : float
        The steady feed F, mm/s.
    ramp : float
        Time Ta of either ramp, s.

    Raises
    ------
    InputError
        If a value is not positive and finite, the kind is unknown, or the length is too short to reach the feed.
    """

    kind: ShapeName
    length: float
    feed: float
    ramp: float

    def __post_init__(self) -> None:
        if self.kind not in SHAPES:
            raise InputError(f"kind = {self.kind!r} must be one of {', '.join(SHAPES)}")
        for name in ("length", "feed", "ramp"):
            value = positive_number(getattr(self, name), name)
            if not isfinite(value):
                raise InputError(f"{name} = {value!r} must be finite")
        if self.length < self.feed * self.ramp:
            raise InputError(
                f"length = {self.length:.9g} mm is too short for a feed of {self.feed:.9g} mm/s with ramps of "
                f"{self.ramp:.9g} s, which take {self.feed * self.ramp:.9g} mm; lower the feed or shorten the ramp"
            )

    @property
    def fall(self) -> float:
        """Time at which the feed begins to fall, s: each ramp covers half of what the steady feed would."""
        return self.length / self.feed

    @property
    def duration(self) -> float:
        """Length over feed and one ramp, s."""
        return self.fall + self.ramp

    @property
    def array(self) -> FloatArray:
        """The six numbers that compiled code reads, see ``interp/literature/literature.h``."""
        rate = _EXPONENTIAL_RATE / self.ramp
        return np.array([float(SHAPES.index(self.kind)), self.feed, self.ramp, self.fall, self.duration, rate])

    def at(self, t: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Feed (mm/s) and acceleration (mm/s^2) at times of any shape; 0 outside, the value after a jump at one."""
        times = coordinates(t, "t")
        feed, acceleration = np.empty(times.size), np.empty(times.size)
        core.feedshape_feed(self.array, times.size, np.ascontiguousarray(times.reshape(-1)), feed, acceleration)
        return feed.reshape(times.shape), acceleration.reshape(times.shape)


@dataclass(frozen=True, eq=False)
class ShapedRun:
    """Samples of an interpolator with a feed shape.

    Attributes
    ----------
    samples : Samples
        The last one is the end of the curve, wherever the steps have got to.
    feed, acceleration : (m,) arrays
        The commanded V_k, mm/s, and A_k, mm/s^2, at every sample.
    reached : float
        Curve parameter to which the steps alone have got.
    """

    samples: Samples
    feed: FloatArray
    acceleration: FloatArray
    reached: float

    def __post_init__(self) -> None:
        self.feed.setflags(write=False)
        self.acceleration.setflags(write=False)

    @property
    def actual_feed(self) -> FloatArray:
        """Feed |P_{k+1} - P_k| / T of every period, (m - 1,), mm/s."""
        steps = np.diff(self.samples.position, axis=0)
        return np.asarray(np.sqrt(np.sum(steps**2, axis=1)) / self.samples.period)

    def feed_error(self, reference: Literal["start", "mean"] = "start") -> FloatArray:
        """Actual less commanded feed of every period, (m - 1,), mm/s.

        The command of a period is that at its start, V_k, as published, or the mean of V_k and V_{k+1}, which is what a
        second-order step follows.  The last period, which ends at the end of the curve, and periods below 1 mm/s are 0.
        """
        if reference not in ("start", "mean"):
            raise InputError(f'reference = {reference!r} must be "start" or "mean"')
        start = self.feed[:-1]
        command = start if reference == "start" else 0.5 * (start + self.feed[1:])
        counted = start > SLOWEST_FEED
        counted[-1] = False
        return np.where(counted, self.actual_feed - command, 0.0)


@dataclass(frozen=True, eq=False)
class FilteredRun:
    """A command smoothed axis by axis: its points leave the curve.

    Attributes
    ----------
    period : float
        Time between two points, s.
    t : (m,) array
        Time, s.
    position : (m, dim) array
        Machine axes, mm (rad for rotary axes).
    """

    period: float
    t: FloatArray
    position: FloatArray

    def __post_init__(self) -> None:
        self.t.setflags(write=False)
        self.position.setflags(write=False)


def interpolate_shape(curve: Curve, shape: FeedShape, period: float, *, order: int = 2) -> ShapedRun:
    """Interpolate a curve with the acceleration planned before the interpolation.

    Parameters
    ----------
    curve : Curve
    shape : FeedShape
        Of the length of the curve.
    period : float
        Sampling period T, s.
    order : int
        1 (equation 8) or 2 (equation 9).

    Returns
    -------
    ShapedRun
        With samples at 0, T, ... up to ceil(duration / T) T.

    Raises
    ------
    InputError
        If order or period are not as above, or there would be more than 1e8 samples.
    """
    require_instance(curve, Curve, "curve")
    require_instance(shape, FeedShape, "shape")
    if order not in (1, 2):
        raise InputError(f"order = {order!r} must be 1 or 2")
    count = _count(shape.duration, period)
    return _run(curve, shape.array, period, order, count)


def interpolate_constant(curve: Curve, feed: float, period: float, *, order: int = 2) -> ShapedRun:
    """Interpolate a curve at constant feed, without any ramp: what a filter after interpolation is given.

    Parameters, result and errors as in :func:`interpolate_shape`; the feed in mm/s.
    """
    require_instance(curve, Curve, "curve")
    if order not in (1, 2):
        raise InputError(f"order = {order!r} must be 1 or 2")
    steady = positive_number(feed, "feed")
    count = _count(curve.length / steady, period)
    # A trapezoid whose ramps are over before the first sample and begin after the last one.
    whole = np.array([0.0, steady, 0.0, np.inf, np.inf])
    return _run(curve, whole, period, order, count)


def filter_axes(samples: Samples, kind: FilterName, ramp: float) -> FilteredRun:
    """Smooth every axis of a command, the acceleration after interpolation (Kim, Song, Kim 1994).

    Parameters
    ----------
    samples : Samples
        Of constant feed; held before the first and after the last one.
    kind : str
        "moving average" of a ramp makes the feed rise as a trapezoid, "half-sine" weights as a bell, and an
        "exponential" lag with a time constant of a fifth of the ramp as the exponential shape.
    ramp : float
        Time of a ramp Ta, s.

    Returns
    -------
    FilteredRun
        Longer than the samples by the filter's memory.

    Raises
    ------
    InputError
        If the kind is unknown, or the ramp is not finite or shorter than a period.
    """
    require_instance(samples, Samples, "samples")
    if kind not in FILTERS:
        raise InputError(f"kind = {kind!r} must be one of {', '.join(FILTERS)}")
    from scipy.signal import lfilter

    period = samples.period
    if not (isfinite(ramp) and ramp >= period):
        raise InputError(f"ramp = {ramp!r} s must be finite and at least a period, {period!r} s")
    taps = round(ramp / period)
    if kind == "exponential":
        constant = ramp / _EXPONENTIAL_RATE
        left = float(np.exp(-period / constant))
        numerator, denominator = np.array([1.0 - left]), np.array([1.0, -left])
        tail = ceil(_TIME_CONSTANTS_FOLLOWED * constant / period)
    else:
        weights = np.ones(taps) if kind == "moving average" else np.sin(np.pi * (np.arange(taps) + 0.5) / taps)
        numerator, denominator = weights / weights.sum(), np.ones(1)
        tail = taps - 1
    first = samples.position[0]
    command = np.concatenate([samples.position, np.repeat(samples.position[-1:], tail, axis=0)]) - first
    position = np.asarray(lfilter(numerator, denominator, command, axis=0)) + first
    return FilteredRun(period, period * np.arange(len(position), dtype=np.float64), position)


def _count(duration: float, period: float) -> int:
    if not (isfinite(period) and period > 0.0):
        raise InputError(f"period = {period!r} s must be > 0 and finite")
    periods = duration / period
    if not periods < MAX_SAMPLES:
        raise InputError(f"period = {period!r} s makes {periods:.3g} samples; at most {MAX_SAMPLES} are allowed")
    return max(1, ceil(periods - WHOLE_PERIOD))


def _run(curve: Curve, shape: FloatArray, period: float, order: int, count: int) -> ShapedRun:
    from interp.taylor import packed_curve

    u, feed, acceleration = (np.empty(count + 1) for _ in range(3))
    position = np.empty((count + 1, curve.dim))
    u[0], end = curve.domain
    pieces = packed_curve(curve)
    out = u, feed, acceleration, position
    core.feedshape_run(order, shape, pieces, curve.dim, *pieces.shape[1:], period, end, u.size, *out)
    reached, u[-1] = float(u[-1]), end
    position[[0, -1]] = curve.derivatives(np.array(curve.domain), 0)[0]
    t = period * np.arange(count + 1, dtype=np.float64)
    return ShapedRun(Samples(period, t, u, position, axes=curve.axes), feed, acceleration, reached)
