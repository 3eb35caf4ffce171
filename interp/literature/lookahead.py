"""Adaptive feed with look-ahead (Zhang, Zhou 2007).

1. *Points*, one a period, where the feed is the lowest of the command F and, with the radius of curvature r,

       V = (2/T) sqrt(r^2 - (r - e)^2)      the chord of a period stays within the error e       (equation 5)
       V = sqrt(a_N r)                      the normal acceleration within a_N                   (equation 6)

   The step to the next one is the first term of the Taylor series, u + T V/|C'| (the paper drops the second).
2. *Look-ahead*: a segment of length s between two points can be crossed if the squares of the feeds at its ends differ
   by 2 a_max s at most (equation 9).  As each point comes in, its own square is lowered to what the rise allows; if it
   is too slow for the points before it, their squares are lowered backwards until one needs no change.  No square root
   is taken, and no point farther back than s_m = V^2 / (2 a_max) can be concerned: the end of the path needs no search.
   The result is the highest feed under the limits of step 1 that keeps the acceleration: what a backward and a forward
   pass over the whole path give.
3. *Samples*: one step a period along the lowered feed, its feed V_k the mean of the present one and of that at the next
   point ("averaged").

For a cubic NURBS the curve is read as ``[1 t t^2 t^3] M [w d]`` with the matrix M of its knot span and t in [0, 1].

Where step 3 falls short.  A mean lags behind: it can exceed what step 2 keeps, and the limits of step 1 as well; nor does
it come to a feed of 0 at the end of the path, so it is kept above the start feed.  A first-order step is too long or too
short by a tenth where |C'| changes within it.  The rule "uniform" takes what constant acceleration between the points
makes of the coming period, and ``order=2`` adds the second term of the series: together they keep the acceleration.

Known limitation: no axis has a limit of its own, the jerk has none, and the acceleration of step 2 is along the path
while that of equation 6 is across it: their resultant is larger than either.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from planner.compiled import core
from planner.errors import InfeasibleError, InputError, StalledError
from planner.geometry.curve import Curve
from planner.geometry.nurbs import NurbsCurve
from planner.inputs import positive_number, require_instance
from planner.machine.feed_limits import chord_feed_limit
from planner.machine.limits import Limits
from planner.samples import Samples
from planner.types import FloatArray

Rule = Literal["averaged", "uniform"]
RULES: tuple[Rule, ...] = ("averaged", "uniform")
MAX_SAMPLES = 10_000_000
_FIRST_GUESS = 4096


@dataclass(frozen=True)
class AdaptiveLimits:
    """What the adaptive feed keeps.

    Parameters
    ----------
    feed : float
        Command feed F, mm/s.
    normal_acceleration, acceleration : float
        a_N across and a_max along the path, mm/s^2.
    chord_error : float
        mm; inf for none.
    period : float
        T, s.
    start_feed : float
        Feed with which the motion begins, mm/s; 0 is a start from rest.

    Raises
    ------
    InputError
        If a value is not positive (the start feed: not negative), or not finite where it has to be.
    """

    feed: float
    normal_acceleration: float
    acceleration: float
    chord_error: float = np.inf
    period: float = 1e-3
    start_feed: float = 0.0

    def __post_init__(self) -> None:
        for name in ("feed", "normal_acceleration", "acceleration", "chord_error", "period"):
            value = positive_number(getattr(self, name), name)
            if not isfinite(value) and name not in ("normal_acceleration", "chord_error"):
                raise InputError(f"{name} = {value!r} must be finite")
        if not 0.0 <= self.start_feed <= self.feed:
            raise InputError(
                f"start_feed = {self.start_feed!r} mm/s must lie within 0 and the feed, {self.feed!r} mm/s"
            )


# The experiment of the paper: 6 m/min from 0.5 m/min, 0.1 g across and 1 g along the path, 2 um, 2 ms.
PAPER_LIMITS = AdaptiveLimits(100.0, 980.0, 9800.0, 2e-3, 2e-3, 25.0 / 3.0)


@dataclass(frozen=True, eq=False)
class AdaptiveRun:
    """Samples at the adaptive feed, and the points they were planned on.

    Attributes
    ----------
    samples : Samples
    feed : (m,) array
        V_k of the step that leaves sample k, mm/s.
    u_points : (n,) array
        Curve parameters of the points of step 1.
    adaptive_feed, planned_feed : (n,) arrays
        The feed there before and after the look-ahead, mm/s.
    lengths : (n - 1,) array
        Chords between the points, mm.
    looked_ahead : float
        The farthest that braking reached back, mm.
    """

    samples: Samples
    feed: FloatArray
    u_points: FloatArray
    adaptive_feed: FloatArray
    planned_feed: FloatArray
    lengths: FloatArray
    looked_ahead: float

    def __post_init__(self) -> None:
        for array in (self.feed, self.u_points, self.adaptive_feed, self.planned_feed, self.lengths):
            array.setflags(write=False)

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return float(self.samples.t[-1])

    @property
    def actual_feed(self) -> FloatArray:
        """Feed |P_{k+1} - P_k| / T of every period, (m - 1,), mm/s."""
        steps = np.diff(self.samples.position, axis=0)
        return np.asarray(np.sqrt(np.sum(steps**2, axis=1)) / self.samples.period)

    @property
    def acceleration(self) -> FloatArray:
        """Acceleration along the path at every inner sample, the difference of the feeds around it over T, (m - 2,)."""
        return np.diff(self.actual_feed) / self.samples.period

    @property
    def planned_acceleration(self) -> FloatArray:
        """Acceleration that crosses each segment between the points, (V_{i+1}^2 - V_i^2) / (2 s_i), (n - 1,)."""
        return np.diff(self.planned_feed**2) / (2.0 * self.lengths)


def adaptive_feed(curve: Curve, limits: AdaptiveLimits, u: ArrayLike) -> FloatArray:
    """Evaluate the lowest of command feed, chord limit and normal-acceleration limit (2007, equations 5 to 7).

    Parameters
    ----------
    curve : Curve
    limits : AdaptiveLimits
    u : array_like
        Curve parameters.

    Returns
    -------
    ndarray
        mm/s, the shape of u.
    """
    curvature = curve.tip.curvature(u)
    machine = Limits(limits.feed, [np.inf], [np.inf], [np.inf], limits.chord_error, limits.period)
    with np.errstate(divide="ignore"):
        normal = np.sqrt(limits.normal_acceleration / curvature)
    return np.minimum(limits.feed, np.minimum(normal, chord_feed_limit(curvature, machine)))


def interpolate_adaptive(
    curve: Curve, limits: AdaptiveLimits, *, look_ahead: bool = True, rule: Rule = "averaged", order: int = 1
) -> AdaptiveRun:
    """Interpolate a curve at the adaptive feed.

    Parameters
    ----------
    curve : Curve
    limits : AdaptiveLimits
    look_ahead : bool
        False leaves the feed as equation 7 has it, its start and its end at full feed: the samples are the points.
    rule : str
        How the feed of a sample follows from those of the points: "averaged" as printed, or "uniform".
    order : int
        Terms of the Taylor series in the step of a sample: 1 as printed, or 2.

    Returns
    -------
    AdaptiveRun
        The last sample is the end of the curve.

    Raises
    ------
    InputError
        If the rule or the order is another one.
    InfeasibleError
        If the path is too short to stop from the start feed.
    StalledError
        If a step does not advance (a curvature beyond measure, or a period too short), or there are more than 1e7.
    """
    require_instance(curve, Curve, "curve")
    require_instance(limits, AdaptiveLimits, "limits")
    if rule not in RULES:
        raise InputError(f"rule = {rule!r} must be one of {', '.join(RULES)}")
    if order not in (1, 2):
        raise InputError(f"order = {order!r} must be 1 or 2")
    pieces = _rows(curve)
    u, feed, lengths = _points(curve, limits, pieces)
    if not look_ahead:
        position = curve.derivatives(u, 0)[0]
        samples = Samples(
            limits.period,
            limits.period * np.arange(u.size, dtype=np.float64),
            u,
            position,
            float(feed[0]),
            float(feed[-1]),
            curve.axes,
        )
        return AdaptiveRun(samples, feed.copy(), u.copy(), feed, feed.copy(), lengths, 0.0)
    square = feed**2
    square[0], square[-1] = min(float(square[0]), limits.start_feed**2), 0.0
    start_square = float(square[0])
    looked = float(core.lookahead_brake(2.0 * limits.acceleration, lengths.size, lengths, square))
    if square[0] < start_square:
        raise InfeasibleError(
            f"{curve.name}: the path is too short to stop from the start feed {np.sqrt(start_square):.6g} mm/s with "
            f"{limits.acceleration:.6g} mm/s^2; start with {np.sqrt(square[0]):.6g} mm/s or less"
        )
    samples_u, samples_feed, position = _samples(curve, limits, pieces, (u, square, lengths), rule, order)
    t = limits.period * np.arange(samples_u.size, dtype=np.float64)
    ends = float(samples_feed[0]) if limits.start_feed > 0.0 else 0.0
    samples = Samples(limits.period, t, samples_u, position, ends, 0.0, curve.axes)
    return AdaptiveRun(samples, samples_feed, u, feed, np.sqrt(square), lengths, looked)


def span_matrix(knots: FloatArray, i: int) -> FloatArray:
    """Return the matrix M of a knot span of a cubic B-spline: [1 t t^2 t^3] M [d_{i-3} .. d_i] on [u_i, u_{i+1}].

    With D(j, k) = u_{j+k} - u_j (2007, section 3, whose printed matrix is illegible; rebuilt and tested against de
    Boor's recurrence).  The degree is 3, which the paper calls the order.

    Parameters
    ----------
    knots : (n,) array
    i : int
        A span that is not empty, 3 <= i <= n - 5.

    Returns
    -------
    (4, 4) array

    Raises
    ------
    InputError
        If there is no such span.
    """
    if not (3 <= i <= knots.size - 5 and knots[i] < knots[i + 1]):
        raise InputError(f"span i = {i!r} must be one that is not empty, within 3 and {knots.size - 5}")

    def gap(j: int, k: int) -> float:
        return float(knots[j + k] - knots[j])

    m11 = gap(i, 1) ** 2 / (gap(i - 1, 2) * gap(i - 2, 3))
    m13 = gap(i - 1, 1) ** 2 / (gap(i - 1, 2) * gap(i - 1, 3))
    m23 = 3.0 * gap(i, 1) * gap(i - 1, 1) / (gap(i - 1, 2) * gap(i - 1, 3))
    m33 = 3.0 * gap(i, 1) ** 2 / (gap(i - 1, 2) * gap(i - 1, 3))
    m44 = gap(i, 1) ** 2 / (gap(i, 2) * gap(i, 3))
    m43 = -(m33 / 3.0 + m44 + gap(i, 1) ** 2 / (gap(i, 2) * gap(i - 1, 3)))
    return np.array(
        [
            [m11, 1.0 - m11 - m13, m13, 0.0],
            [-3.0 * m11, 3.0 * m11 - m23, m23, 0.0],
            [3.0 * m11, -(3.0 * m11 + m33), m33, 0.0],
            [-m11, m11 - m43 - m44, m43, m44],
        ]
    )


def span_coefficients(curve: NurbsCurve) -> tuple[FloatArray, FloatArray]:
    """Return a cubic NURBS as polynomials of t in [0, 1] on each knot span: M [w d], and M [w] for the denominator.

    A step in u is a step in t over the width of the span, which is what the interpolation adds up.

    Returns
    -------
    knots : (m + 1,) array
        Those at which the spans meet.
    coefficients : (m, dim + 1, 4) array
        Ascending powers of t; the last row is the denominator.

    Raises
    ------
    InputError
        If the curve is not of degree 3.
    """
    if curve.degree != 3:
        raise InputError(f"{curve.name} has the degree {curve.degree}; the span matrix is that of degree 3")
    knots, last = curve.knots, len(curve.control_points) - 1
    spans = [i for i in range(3, last + 1) if knots[i] < knots[i + 1]]
    homogeneous = np.column_stack([curve.control_points * curve.weights[:, None], curve.weights])
    coefficients = np.stack([(span_matrix(knots, i) @ homogeneous[i - 3 : i + 1]).T for i in spans])
    return np.append(knots[spans], knots[last + 1]), np.ascontiguousarray(coefficients)


def _rows(curve: Curve) -> FloatArray:
    """The curve as compiled code reads it: by its span matrices, if it is a cubic NURBS of linear axes."""
    from interp.taylor import packed_curve, packed_pieces

    if isinstance(curve, NurbsCurve) and curve.degree == 3 and curve.tip is curve:
        return packed_pieces(*span_coefficients(curve))
    return packed_curve(curve)


def _points(curve: Curve, limits: AdaptiveLimits, pieces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Step 1: parameters, feeds and chords of the points, one a period."""
    numbers = np.array([limits.feed, limits.normal_acceleration, limits.chord_error, limits.period])
    sizes = curve.dim, *pieces.shape[1:]
    room = _room(curve.length / limits.feed / limits.period)
    while True:
        u, feed, lengths = np.empty(room), np.empty(room), np.empty(room)
        u[0], end = curve.domain
        count = int(core.lookahead_points(numbers, pieces, *sizes, end, room, u, feed, lengths))
        if count > 0:
            return u[:count].copy(), feed[:count].copy(), lengths[: count - 1].copy()
        if count < -1:
            at = -2 - count
            raise StalledError(
                f"{curve.name}: the feed {feed[at]:.3g} mm/s does not advance u = {u[at]!r}: its curvature there is too "
                "large for the normal acceleration; scale the curve up, or allow more"
            )
        if room >= MAX_SAMPLES:
            raise StalledError(
                f"{curve.name}: more than {MAX_SAMPLES} periods of {limits.period!r} s, at u = {u[-1]!r}; use a longer "
                "period"
            )
        room = min(8 * room, MAX_SAMPLES)


def _room(periods: float) -> int:
    """Points to make room for at first, where at least so many are expected."""
    return ceil(min(_FIRST_GUESS + 2.0 * periods, MAX_SAMPLES))


def _samples(
    curve: Curve,
    limits: AdaptiveLimits,
    pieces: FloatArray,
    plan: tuple[FloatArray, FloatArray, FloatArray],
    rule: Rule,
    order: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Step 3: parameters, feeds and positions of the samples."""
    points, square, lengths = plan
    least = limits.start_feed if limits.start_feed > 0.0 else limits.acceleration * limits.period
    feeds = np.sqrt(square)
    seconds = float(np.sum(2.0 * lengths / np.maximum(feeds[:-1] + feeds[1:], least)))
    which, sizes = RULES.index(rule), (curve.dim, *pieces.shape[1:])
    room = _room(seconds / limits.period)
    while True:
        u, feed, position = np.empty(room), np.empty(room), np.empty((room, curve.dim))
        course = points.size, points, square, lengths, pieces, *sizes
        count = int(core.lookahead_run(which, order, *course, limits.period, least, room, u, feed, position))
        if count > 0:
            position[[0, count - 1]] = curve.derivatives(np.array(curve.domain), 0)[0]
            return u[:count].copy(), feed[:count].copy(), position[:count].copy()
        if room >= MAX_SAMPLES:
            raise StalledError(
                f"{curve.name}: more than {MAX_SAMPLES} periods of {limits.period!r} s, at u = {u[-1]!r}; use a longer "
                "period"
            )
        room = min(8 * room, MAX_SAMPLES)
