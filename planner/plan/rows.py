"""Curve, limits and knots in; the arrays a solver sees out, and nothing else.

With x = sigma_dot^2, a = sigma_ddot = x'/2, c = a' = x''/2 (a prime is d/dsigma), q the machine axes and p the tip,

    speed         |p'| sqrt(x) <= feed, chord limit;  |q_j'| sqrt(x) <= V_j
    acceleration  |q_j'' x + q_j' a| <= A_j
    jerk          |q_j''' x + 3 q_j'' a + q_j' c| sqrt(x) <= J_j

and the tangential limits are the same rows for one more "axis", the arc length of the tip.  Scaled to 1 they read

    x / cap <= 1,     |alpha x + beta a| <= 1,     |r . (x, a, c)| <= x^(-1/2).

Each limit may have bounds of different size: with lower < 0 < upper in place of -1 and 1, and times x^(-1/2) where there is
a jerk.  Every row knows the limit that it is of, and so does every multiplier; which place it has in an array says nothing.

They are collocated at the knots and at points between (``collocation.py``).  Lengths and times are scaled so that the mean
interval has length 1 and takes about the time 1: a solver never sees millimetres or seconds, and the same path in other
units gives the same arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.curve import Curve
from planner.geometry.differential import Triple, acceleration_terms, chain_rule, jerk_terms, speed_derivatives
from planner.machine.feed_limits import chord_feed_limit, command_kind, commanded_feed
from planner.machine.limit_rows import LimitRow, limit_rows
from planner.machine.limits import Limits
from planner.plan.collocation import points_of, states_between, time_weights
from planner.plan.ends import Feed, Rest
from planner.plan.jumps import JERK_COLLOCATED, soften
from planner.plan.section import Section, axis_weights, evaluate
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap
from planner.quantity import ACCELERATION, CHORD_ERROR, FEED, JERK, VELOCITY
from planner.types import FloatArray, IntArray

# In periods: shorter than samples tell; and how long after a stop, or before one, in the time of the law before.
_RAMP, _RAMP_REACH = 0.5, 4.0
_LOWERED = 1e-9
_INTERVALS_AT_ONCE = 16_384


@dataclass(frozen=True, eq=False)
class GridRows:
    """Rows  lower <= r . (x, a[, c]) <= upper,  one for each limit.

    ``of (m,)``: the limits they are of, scaled as these say; ``given (m, 2 or 3, p)``: coefficients at the points;
    ``factor (p,)``: by which all limits are tightened there, if they are.  One array of coefficients, the largest of a plan,
    serves all rounds of tightening.
    """

    of: tuple[LimitRow, ...]
    given: FloatArray
    factor: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.of)

    @property
    def r(self) -> FloatArray:
        """The coefficients, tightened; a new array where they are."""
        return self.given if self.factor is None else self.given * self.factor

    @cached_property
    def bounds(self) -> FloatArray:
        """Sizes (m, 2) of the upper and of the lower bound of the scaled rows."""
        return np.array([(upper, -lower) for lower, upper in (row.bounds for row in self.of)]).reshape(-1, 2)

    def times(self, factor: FloatArray | float) -> GridRows:
        """The same limits, tightened by factors of at least 1, (p,)."""
        by = np.full(self.given.shape[2], factor) if np.ndim(factor) == 0 else np.asarray(factor)
        return replace(self, factor=by if self.factor is None else self.factor * by)


@dataclass(frozen=True, eq=False)
class Constraints:
    """What a solver sees of a path and a machine, in units of ``length_unit`` (of sigma) and ``time_unit`` (s).

    Points are the knots and ``inner`` points inside every interval in order (``collocation.py``).

    Attributes
    ----------
    h : (n - 1,) array
        Interval lengths; 0 between the two knots of a double one.
    cap : (p,) array
        Largest x at each point.
    acceleration : GridRows
        (alpha, beta) of the limits on accelerations.
    jerk : GridRows
        r of the limits on jerks; their bounds are those of the rows times x^(-1/2).
    weight : (p,) array
        Weights of Simpson's or Boole's rule: the time is sum(weight * x^(-1/2)).
    start, end : float
        Prescribed x at the first and last knot, nan where it is free.
    start_slope : float
        Prescribed a at the first knot, nan where it is free.
    guess : (n,) array
        A guess of x at the knots, positive.
    periodic : bool
        First and last knot share x, a and c.
    length_unit, time_unit : float
        Of the scaled problem.
    inner : int
        Points inside an interval, 1 or 3.
    """

    h: FloatArray
    cap: FloatArray
    acceleration: GridRows
    jerk: GridRows
    weight: FloatArray
    start: float
    end: float
    start_slope: float
    guess: FloatArray
    periodic: bool
    length_unit: float
    time_unit: float
    inner: int = 1

    def used(self, x: FloatArray, a: FloatArray, c: FloatArray) -> FloatArray:
        """Largest share of a limit used at each point, (p,), by the cubics with these x, a, c at the knots (n,)."""
        z = states_between(self.h, np.stack([x, a, c]), self.inner)
        share = np.sqrt(np.maximum(z[0], 0.0))
        out = share / np.sqrt(self.cap)
        for row, bounds in zip(self.acceleration.r, self.acceleration.bounds, strict=True):
            np.maximum(out, used_share(row[0] * z[0] + row[1] * z[1], bounds), out=out)
        for row, bounds in zip(self.jerk.r, self.jerk.bounds, strict=True):
            np.maximum(out, used_share(row[0] * z[0] + row[1] * z[1] + row[2] * z[2], bounds) * share, out=out)
        return out


def used_share(values: FloatArray, bounds: FloatArray) -> FloatArray:
    """Share of the bound on its own side that each value uses."""
    return np.asarray(np.maximum(values / bounds[0], -values / bounds[1]))


@dataclass(frozen=True, eq=False)
class Path:
    """The path at points of sigma: u, the axes and the tip's arc length, with their derivatives over sigma.

    ``u (4, p)``: the curve parameter; ``axes (4, p, dim)``, ``tip (4, p)`` (row 0 unused), ``curvature (p,)`` of the tip,
    ``feed (p,)`` commanded; ``left (p,)`` where the path is taken from the left.
    """

    u: FloatArray
    axes: FloatArray
    tip: FloatArray
    curvature: FloatArray
    feed: FloatArray
    left: NDArray[np.bool_]


def path_at(section: Section, limits: Limits, sigma: FloatArray, u: FloatArray, left: NDArray[np.bool_]) -> Path:
    """Evaluate the path of a section over its rest map at sigma, where the parameter is u; from the left where asked."""
    rest = section.rest_map(sigma)
    q = evaluate(section.curve, u, left)
    rates = section.parameter_derivatives(q, axis_weights(limits), rest)
    return _path(section.curve, limits, np.stack([u, *rates]), q, rates, left)


def path_on(limits: Limits, on: TimeMap, sigma: FloatArray, macro: IntArray) -> Path:
    """Evaluate the path on a map at points sigma (n,) of its macros (n,)."""
    u, q, rates, left = on.along(sigma, macro)
    over_sigma, native = np.stack([u, *rates]), np.flatnonzero(on.piece[macro] >= 0)
    if native.size:
        over_sigma[1:, native] = chain_rule(*speed_derivatives(q[:, native]), *rates[:, native])
    return _path(on.section.curve, limits, over_sigma, q, (rates[0], rates[1], rates[2]), left)


def _path(
    curve: Curve,
    limits: Limits,
    u: FloatArray,
    q: FloatArray,
    rates: Triple,
    left: NDArray[np.bool_],
) -> Path:
    """The path at parameters ``u (4, p)``, with their derivatives over sigma; ``q`` over a parameter with such ``rates``."""
    tip = q if curve.tip is curve else evaluate(curve.tip, u[0], left)
    speeds = speed_derivatives(tip)
    speed = speeds[0]
    # As ``curvature`` says, but with the slope that is at hand: its own quotient rounds otherwise, and plans of it differ in
    # their last digits.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        bend = np.sqrt(np.sum((tip[2] - (speeds[1] / speed)[:, None] * tip[1]) ** 2, axis=-1)) / speed**2
    curvature = np.where(speed > 0.0, np.nan_to_num(bend), 0.0)
    feed = commanded_feed(curve, limits, u[0], left)
    axes = np.stack([q[0], *chain_rule(q[1], q[2], q[3], *(rate[:, None] for rate in rates))])
    along = np.stack([np.zeros_like(speed), *chain_rule(*speeds, *rates)])
    return Path(u, axes, along, curvature, feed, left)


@dataclass(frozen=True, eq=False)
class Speeds:
    """What sets the largest speed at the points of a grid, before any limit is tightened.

    Attributes
    ----------
    which : (p,) uint8 array
        Which of :func:`speed_limits` is the lowest; one beyond them, by ``COMMANDS``, where the curve commands the feed.
    power : (p,) float32 array
        By how many percent x grows with one percent of it.
    jumps : (k,) int array
        First knots of the double ones at which a jump of the curvature lowers the speed further.
    step : (k, dim) array
        The jump there of the second derivatives of the axes over sigma.
    lowered : (k, inner + 2) bool array
        At which of the points from one of these knots to the next.
    """

    which: NDArray[np.uint8]
    power: NDArray[np.float32]
    jumps: IntArray
    step: FloatArray
    lowered: NDArray[np.bool_]


def build(limits: Limits, grid: TimeGrid, *, periodic: bool = False, inner: int = 3) -> tuple[Constraints, Speeds]:
    """Assemble the constraints of one section on a grid, ``inner`` points in every interval, and what sets the speeds."""
    section, h, stride = grid.map.section, np.diff(grid.sigma), inner + 1
    # sigma is the time of a law: with the mean interval for the unit of both, x is about 1
    scale = grid.map.span / grid.intervals
    table, points = _RowTable.of(limits, section), stride * h.size + 1
    cap, power, which = np.empty(points), np.empty(points, dtype=np.float32), np.empty(points, dtype=np.uint8)
    acceleration, jerk = np.empty((len(table.accelerations), 2, points)), np.empty((len(table.jerks), 3, points))
    for first in range(0, h.size, _INTERVALS_AT_ONCE):  # some at a time, which bounds the memory
        some = slice(first, first + _INTERVALS_AT_ONCE + 1)
        sigma, macro = points_of(grid.sigma[some], inner), np.repeat(grid.macro[some], stride)[:-inner]
        table.fill(limits, grid.map, sigma, macro, scale, stride * first, (cap, which, power, acceleration, jerk))
        _ramp(table, section, limits, grid.map.span, sigma, jerk[:, :, stride * first :])
    speeds = Speeds(
        which, power, np.empty(0, dtype=np.intp), np.empty((0, limits.dim)), np.empty((0, stride + 1), bool)
    )
    if section.jumps:
        speeds = _soften_jumps(section, limits, grid, cap, jerk, speeds)
    doubled = stride * np.flatnonzero(h == 0.0)
    for k in range(1, stride):
        acceleration[:, :, doubled + k] = 0.0
        jerk[:, :, doubled + k] = 0.0
    start, end, slope = _prescribed(limits, grid)
    constraints = Constraints(
        h=h / scale,
        cap=cap,
        acceleration=GridRows(table.accelerations, acceleration),
        jerk=GridRows(table.jerks, jerk),
        weight=time_weights(h, inner) / scale,
        start=start,
        end=end,
        start_slope=slope * scale,
        guess=np.ones(grid.sigma.size),
        periodic=periodic,
        length_unit=scale,
        time_unit=scale,
        inner=inner,
    )
    return constraints, speeds


@dataclass(frozen=True, eq=False)
class _RowTable:
    """The limits on accelerations and jerks, those of ramps last, as compiled code takes them."""

    accelerations: tuple[LimitRow, ...]
    jerks: tuple[LimitRow, ...]
    ramps: int
    motions: NDArray[np.int64]
    weights: FloatArray
    scales: FloatArray

    @classmethod
    def of(cls, limits: Limits, section: Section) -> _RowTable:
        rows = limit_rows(limits)
        accelerations = tuple(row for row in rows if row.order == ACCELERATION.order)
        jerks = tuple(row for row in rows if row.order == JERK.order)
        ramps = tuple(row for row in rows if row.quantity is ACCELERATION and not np.isfinite(limits.jerk[row.motion]))
        ramps = ramps if jerks and (isinstance(section.start, Rest) or isinstance(section.end, Rest)) else ()
        every = (*accelerations, *jerks, *ramps)
        weights = [row.weights[row.order - 1] for row in (*accelerations, *jerks)]
        return cls(
            accelerations,
            (*jerks, *ramps),
            len(ramps),
            np.array([row.motion for row in every], dtype=np.int64),
            np.array([*weights, *[_RAMP * limits.period] * len(ramps)]),
            np.array([row.scale for row in every]),
        )

    def fill(
        self,
        limits: Limits,
        on: TimeMap,
        sigma: FloatArray,
        macro: IntArray,
        scale: float,
        first: int,
        out: tuple[FloatArray, NDArray[np.uint8], NDArray[np.float32], FloatArray, FloatArray],
    ) -> None:
        """Write the limits at points sigma, those from ``first`` on, into ``out``; a = a* / scale, c = c* / scale^2."""
        curve = on.section.curve
        u, q, rates, left = on.along(sigma, macro)
        tip = q if curve.tip is curve else evaluate(curve.tip, u, left)
        feed = commanded_feed(curve, limits, u, left)
        cap, which, power, acceleration, jerk = out
        core.rows_fill(
            *(sigma.size, q.shape[2], tip.shape[2], q, tip, rates, feed),
            *(limits.velocity, limits.chord_error, limits.period),
            *(len(self.accelerations), self.motions.size, self.motions, self.weights, self.scales),
            *(scale ** -np.arange(3.0), first, cap.size, cap, which, power, acceleration, jerk),
        )
        if curve.feed_caps is not None:
            some = which[first : first + sigma.size]
            command = command_kind(curve, limits, u, left)
            commanded = (some == 0) & (command > 0)
            some[commanded] = 1 + limits.dim + command[commanded]


def _ramp(table: _RowTable, section: Section, limits: Limits, span: float, sigma: FloatArray, jerk: FloatArray) -> None:
    """Keep the jerk rows of ramps next to the stops only, in place.

    They are of axes that have an acceleration limit but none of the jerk.  Such an axis may leave a stop at full
    acceleration, but the law of a plan begins with none: without a ramp its quintic would overshoot, however short the
    interval.  The ramp takes _RAMP periods.
    """
    if not table.ramps:
        return
    away = [np.abs(sigma - at) for at, end in ((0.0, section.start), (span, section.end)) if isinstance(end, Rest)]
    jerk[-table.ramps :, :, : sigma.size] *= np.min(away, axis=0) < _RAMP_REACH * limits.period


def _prescribed(limits: Limits, grid: TimeGrid) -> tuple[float, float, float]:
    """X at the ends and a at the first, by the feeds and the acceleration asked for there; nan where nothing is."""
    section, ends = grid.map.section, np.array([0, grid.sigma.size - 1])
    if not section.has_prescribed_feed:
        return np.nan, np.nan, np.nan
    path = path_on(limits, grid.map, grid.sigma[ends], grid.macro[ends])
    start, end = (
        (end.feed / path.tip[1, at]) ** 2 if isinstance(end, Feed) else np.nan
        for end, at in ((section.start, 0), (section.end, -1))
    )
    # s'' = s_sigma_sigma x + s_sigma a
    slope = np.nan
    if isinstance(section.start, Feed) and section.start.acceleration is not None:
        slope = (section.start.acceleration - path.tip[2, 0] * start) / path.tip[1, 0]
    return start, end, slope


def speed_limits(limits: Limits, path: Path) -> dict[str, FloatArray]:
    """Largest sigma_dot at each point (p,) by feed, chord error and each axis velocity, by the limit's name."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        feed = path.feed / path.tip[1]
        chord = chord_feed_limit(path.curvature, limits) / path.tip[1]
        velocity = limits.velocity / np.abs(path.axes[1])
    found = {FEED.label: feed, CHORD_ERROR.label: chord}
    found |= {VELOCITY.of(axis): row for axis, row in zip(limits.axes, velocity.T, strict=True)}
    return {name: np.where(np.isnan(row), np.inf, row) for name, row in found.items()}


def speed_cap(limits: Limits, path: Path) -> FloatArray:
    """Largest x that feed, chord error and axis velocities allow at each point."""
    return np.asarray(np.min(list(speed_limits(limits, path).values()), axis=0) ** 2)


def acceleration_rows(limits: Limits, path: Path) -> GridRows:
    """Rows (alpha, beta) of the limits on accelerations of the axes and of the tip's arc length, scaled."""
    of = tuple(row for row in limit_rows(limits) if row.order == ACCELERATION.order)
    found = [row.weights[1] * acceleration_terms(q[1], q[2]) / row.scale for row, q in _with_motions(of, path)]
    return GridRows(of, np.array(found).reshape(len(of), 2, path.curvature.size))


def jerk_rows(limits: Limits, path: Path) -> GridRows:
    """Rows r of the limits on jerks of the axes and of the tip's arc length, scaled."""
    of = tuple(row for row in limit_rows(limits) if row.order == JERK.order)
    found = [row.weights[2] * jerk_terms(q[1], q[2], q[3]) / row.scale for row, q in _with_motions(of, path)]
    return GridRows(of, np.array(found).reshape(len(of), 3, path.curvature.size))


def _with_motions(of: tuple[LimitRow, ...], path: Path) -> list[tuple[LimitRow, FloatArray]]:
    """Each limit with the derivatives (4, p) of its motion over sigma: of an axis, or of the tip's arc length."""
    return [(row, path.tip if row.along else path.axes[:, :, row.motion]) for row in of]


def _soften_jumps(
    section: Section, limits: Limits, grid: TimeGrid, cap: FloatArray, jerk: FloatArray, speeds: Speeds
) -> Speeds:
    """Lower the cap at curvature jumps, and the jerk that is left beside them, in place; says where the first counts."""
    stride = (cap.size - 1) // (grid.sigma.size - 1)
    first = grid.left[np.searchsorted(grid.map.u[1:], [b.u for b in section.jumps])]
    # The tip's arc length bends with the axes where these are weighted: sigma is that of the machine axes.
    before, after = (
        np.concatenate([path.axes[2], path.tip[2][:, None]], axis=1)
        for path in (path_on(limits, grid.map, grid.sigma[at], grid.macro[at]) for at in (first, first + 1))
    )
    points = stride * first[:, None] + np.arange(stride + 1)
    lowest = cap[points]
    beside = soften(limits, grid.sigma, first, after - before, cap)
    jerk[:, :, beside] /= JERK_COLLOCATED
    lowered = cap[points] < lowest * (1.0 - _LOWERED)
    some = lowered[:, 1]
    return replace(speeds, jumps=first[some], step=(after - before)[some, :-1], lowered=lowered[some])
