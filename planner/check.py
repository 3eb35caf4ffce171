"""Independent verification of a plan or of its samples.

A plan is believed only after it has been measured here, from the curve and the time law alone: no formula of the
planner is used, neither its constraints nor its feed limit for the chord.

A *profile* is measured between its nodes.  The time law is cut into spans: the intervals of the table, cut again
wherever u(t) crosses a knot of the curve, so that everything is smooth within a span.

1. On each span the axes' velocity, acceleration and jerk follow from u(t) and the curve's derivatives by the chain
   rule, at ``density`` points, both ends included and each end taken from inside the span.
2. The spans with the highest peaks (a parabola through the top three points) are searched on ever finer points, so
   that the worst value does not depend on the grid.
3. Where two spans meet, the values on either side are compared: a step of the velocity is a violation; a step D of the
   acceleration is what a drive sees as a jerk of 0.75 D / T, once it is sampled with the period T.
4. The chord error is the true distance between the path and the chord of one period, for every phase of the sampling.

*Samples* are measured as a drive sees them: by differences over the period, held constant before the first and after
the last one.

Known limitation: a table in double precision cannot hold a jerk over very short intervals h, because the last digit of
u is worth 60 eps |u| / h^3.  That much is granted (``Row.slack``); it matters below some 1e-5 s, where the samples of
the plan say more than the table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.curve import Curve, FloatArray
from planner.limits import Limits
from planner.profile import FeedrateProfile, Samples

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
Place = tuple[float, float]

_EPS = float(np.finfo(np.float64).eps)
# Points evaluated at once; bounds the memory, changes no result.
_CHUNK_POINTS = 50_000
# Highest spans whose peaks are searched, and how: each round looks at 25 points and keeps 1.5 spacings on either side.
_CANDIDATES = 8
_ZOOM_ROUNDS = 5
_ZOOM_POINTS = 25
_ZOOM_SHRINK = 8.0
# Steps below these fractions of the largest value are rounding (one-sided derivatives differ in the last digits).
_VELOCITY_STEP = 1e-9
_ACCELERATION_STEP = 1e-6
# Nodes within this fraction of the domain of a knot lie on it.
_ON_KNOT = 1e-12
# A unit step of acceleration, twice integrated, sampled and differenced three times, is a quadratic B-spline of the
# phase: support 3 T, peak 0.75 / T.
_STEP_PEAK = 0.75
_STEP_REACH = 3.0
_COLUMN_TOLERANCE = 1e-9
_PATH_TOLERANCE = 1e-9
# Accuracy to which the arc length of samples is known, as a fraction of the whole length.
_LENGTH_ACCURACY = 1e-14
# A period is looked at in sixteenths; chords start every fourth of them.
_CHORD_PARTS = 16
_CHORD_STRIDE = 4
_STARTS_PER_INTERVAL = 24

_AXIS_RATES = ("velocity", "acceleration", "jerk")
_TIP_RATES = ("feed", "tangential acceleration", "tangential jerk")
_REVERSAL = len(_TIP_RATES)  # row of -u' among the measured quantities
# Unit of each row; of a row about an axis, what follows the axis' own unit.
_UNITS = {
    "feed": "mm/s",
    "programmed feed": "mm/s",
    "chord error": "mm",
    "velocity": "/s",
    "acceleration": "/s^2",
    "jerk": "/s^3",
    "tangential acceleration": "mm/s^2",
    "tangential jerk": "mm/s^3",
    "velocity step": "/s",
    "acceleration step": "/s^2",
    "jerk at a curvature break": "/s^3",
    "reversal": "1/s",
    "path start": "mm",
    "path end": "mm",
    "path error": "",
    "position step": "mm",
    "table columns": "",
    "finite values": "",
    "time order": "s",
    "sample times": "s",
}


@dataclass(frozen=True)
class Row:
    """The worst use of one limit by one axis.

    Attributes
    ----------
    limit : str
        "feed", "programmed feed" (against the curve's own caps), "chord error", "velocity", "acceleration", "jerk",
        "tangential acceleration", "tangential jerk",
        "velocity step", "acceleration step", "jerk at a curvature break", "exact stop",
        "acceleration at an exact stop"; or what makes the plan one at all: "reversal", "path start", "path end",
        "path error", "position step", "table columns", "finite values", "time order", "sample times".
    axis : str
        Name of the axis; empty where the row is not about one.
    worst, allowed : float
        Largest value found (of places with different slack: the largest less slack) and the limit, in ``unit``.
    ratio : float
        worst / allowed; 0 where the limit is inf; where nothing is allowed, 0 or (if it is not ok) inf.
    t, u : float
        Where the worst value is, s and curve parameter.
    unit : str
        Unit of worst and allowed.
    slack : float
        What the rounding of the plan's own numbers can add to the value there; granted on top of ``allowed``.
    ok : bool
        worst <= allowed (1 + tolerance) + slack.
    """

    limit: str
    axis: str
    worst: float
    allowed: float
    ratio: float
    t: float
    u: float
    unit: str
    slack: float
    ok: bool


@dataclass(frozen=True)
class Report:
    """What :func:`check` found.

    Attributes
    ----------
    rows : tuple of Row
        One for each limit and axis.
    start_feed, end_feed : float
        Feed with which the plan begins and ends, mm/s.
    start_acceleration, end_acceleration : float
        Tangential acceleration there, mm/s^2.
    """

    rows: tuple[Row, ...]
    start_feed: float = 0.0
    end_feed: float = 0.0
    start_acceleration: float = 0.0
    end_acceleration: float = 0.0

    @property
    def ok(self) -> bool:
        """True where every row holds."""
        return all(row.ok for row in self.rows)

    @property
    def violations(self) -> tuple[Row, ...]:
        """The rows that do not hold."""
        return tuple(row for row in self.rows if not row.ok)

    def row(self, limit: str, axis: str = "") -> Row:
        """Return the row of a limit and an axis; raises InputError where there is none."""
        for row in self.rows:
            if (row.limit, row.axis) == (limit, axis):
                return row
        known = ", ".join(f"{row.limit} {row.axis}".strip() for row in self.rows)
        raise InputError(f'there is no row "{limit}" for the axis "{axis}"; there are {known}')

    def __str__(self) -> str:
        """A table, one line a row, with the verdict above it."""
        count = len(self.violations)
        head = "every limit holds" if not count else f"{count} of {len(self.rows)} checks fail"
        lines = [f"{head}; feed {self.start_feed:.6g} mm/s at the start, {self.end_feed:.6g} mm/s at the end"]
        for row in self.rows:
            name = f"{row.limit} {row.axis}".strip()
            lines.append(
                f"{'' if row.ok else 'FAILS':5} {name:28} {row.worst:13.7g} of {row.allowed:10.6g} {row.unit:8}"
                f" ratio {row.ratio:<12.7g} at t = {row.t:.6g} s, u = {row.u:.6g}"
                + (f" (slack {row.slack:.2g})" if row.slack > 0.0 else "")
            )
        return "\n".join(lines)


def check(
    curve: Curve,
    limits: Limits,
    plan: FeedrateProfile | Samples,
    *,
    density: int = 24,
    tolerance: float = 1e-6,
) -> Report:
    """Measure a plan, or the samples of one, against every limit.

    Parameters
    ----------
    curve : Curve
        The tool path.
    limits : Limits
        What is allowed; its period is the one the chord error of a profile is measured with (samples have their own).
    plan : FeedrateProfile or Samples
        What is measured.
    density : int
        Points an interval of the table (of samples: a period, for the chord error), at least 4.
    tolerance : float
        Relative excess that still counts as within a limit.

    Returns
    -------
    Report

    Raises
    ------
    InputError
        If limits, curve and plan do not belong together, or an argument is not one of those above.
    """
    limits.require_matches(curve)
    if isinstance(density, bool) or not isinstance(density, int | np.integer) or density < 4:
        raise InputError(f"density = {density!r} must be an integer of at least 4")
    if not (np.isfinite(tolerance) and tolerance >= 0.0):
        raise InputError(f"tolerance = {tolerance!r} must be >= 0 and finite")
    rows = _Rows(curve, float(tolerance))
    if isinstance(plan, FeedrateProfile):
        if plan.curve.fingerprint != curve.fingerprint:
            raise InputError(
                f"the plan was made for another curve: {plan.curve.name} (fingerprint {plan.curve.fingerprint}), not "
                f"{curve.name} ({curve.fingerprint}); plan this curve, or check the plan on its own"
            )
        return _check_profile(curve, limits, plan, int(density), rows)
    if isinstance(plan, Samples):
        return _check_samples(curve, limits, plan, int(density), rows)
    raise InputError(f"plan is a {type(plan).__name__}; it must be a FeedrateProfile or Samples")


class _Rows:
    """Collects rows and gives each its unit and verdict."""

    def __init__(self, curve: Curve, tolerance: float) -> None:
        self.axes = curve.axes
        self.units = curve.axis_units
        self.tolerance = tolerance
        self.rows: list[Row] = []

    def add(
        self,
        limit: str,
        worst: float,
        allowed: float,
        place: Place,
        *,
        slack: float = 0.0,
        j: int | None = None,
        unit: str | None = None,
    ) -> None:
        """Add one row, about axis j if given; place is (t, u)."""
        worst, allowed, slack = float(worst), float(allowed), float(slack)
        ok = bool(np.isfinite(worst)) and worst <= allowed * (1.0 + self.tolerance) + slack
        if np.isinf(allowed):
            ratio = 0.0
        elif allowed > 0.0:
            ratio = worst / allowed
        else:
            ratio = 0.0 if ok else np.inf
        axis = "" if j is None else self.axes[j]
        if unit is None:
            unit = ("" if j is None else self.units[j]) + _UNITS[limit]
        self.rows.append(Row(limit, axis, worst, allowed, ratio, float(place[0]), float(place[1]), unit, slack, ok))


# ---- the time law of a profile -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Law:
    """The quintics between the nodes, over x = (t - start) / h in [0, 1].

    ``ends`` (2, 3, n) holds u, u', u'' as tabulated at both ends of each interval, ``slack`` (3, n) what the rounding
    of the tabulated t, u, u', u'' can change in the first three time derivatives of u.
    """

    start: FloatArray
    h: FloatArray
    ends: FloatArray
    coefficients: FloatArray
    slack: FloatArray

    @classmethod
    def of(cls, profile: FeedrateProfile) -> _Law:
        """Take the intervals that have a length; those of double nodes have none."""
        nodes = np.stack([profile.u, profile.u_rate, profile.u_acceleration])
        kept = np.flatnonzero(np.diff(profile.t) > 0.0)
        start, h = profile.t[kept], np.diff(profile.t)[kept]
        ends = np.stack([nodes[:, kept], nodes[:, kept + 1]])
        (u0, v0, a0), (u1, v1, a1) = ends
        # The conditions at x = 1 that the Taylor part from x = 0 leaves to x^3, x^4 and x^5.
        left = np.stack([u1 - u0 - v0 * h - 0.5 * a0 * h**2, (v1 - v0 - a0 * h) * h, (a1 - a0) * h**2])
        tail = np.linalg.solve(np.array([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]]), left)
        # Rounding: half a digit at each end of u, u' and u''; that of t moves u by u' times as much.  The factors are
        # the largest derivatives of the quintics that answer to a unit of u, of u' h and of u'' h^2.
        size = np.abs(ends).max(axis=0)
        du = _EPS * (size[0] + size[1] * (start + h))
        dv, da = _EPS * size[1] * h, _EPS * size[2] * h**2
        slack = np.stack([2.0 * (du + dv + da), 6.0 * du + 4.0 * dv + da, 60.0 * du + 36.0 * dv + 9.0 * da])
        slack /= np.stack([h, h**2, h**3])
        return cls(start, h, ends, np.concatenate([[u0, v0 * h, 0.5 * a0 * h**2], tail]), slack)

    def value(self, i: IntArray, x: FloatArray) -> FloatArray:
        """Evaluate u on the intervals i (n,) at x (n, k)."""
        c = self.coefficients[:, i, None]
        u = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
        return np.where(x == 1.0, self.ends[1, 0, i, None], u)

    def rates(self, i: IntArray, x: FloatArray) -> FloatArray:
        """First three time derivatives of u, (3, n, k); at the nodes the first two as tabulated."""
        c, h = self.coefficients[:, i, None], self.h[i, None]
        first = (c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5])))) / h
        second = (2.0 * c[2] + x * (6.0 * c[3] + x * (12.0 * c[4] + x * 20.0 * c[5]))) / h**2
        third = (6.0 * c[3] + x * (24.0 * c[4] + x * 60.0 * c[5])) / h**3
        for side, at in enumerate((x == 0.0, x == 1.0)):
            first = np.where(at, self.ends[side, 1, i, None], first)
            second = np.where(at, self.ends[side, 2, i, None], second)
        return np.stack([first, second, third])

    def crossing(self, i: IntArray, u: FloatArray) -> FloatArray:
        """Solve u(x) = u for x on the intervals i by bisection."""
        lo, hi = np.zeros(u.size), np.ones(u.size)
        for _ in range(60):
            mid = 0.5 * (lo + hi)
            below = self.value(i, mid[:, None])[:, 0] < u
            lo, hi = np.where(below, mid, lo), np.where(below, hi, mid)
        return hi

    def at(self, t: FloatArray) -> tuple[IntArray, FloatArray]:
        """Interval and x of each time, flat."""
        i = np.clip(np.searchsorted(self.start, t, side="right") - 1, 0, self.start.size - 1)
        return i, np.clip((t - self.start[i]) / self.h[i], 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class _Motion:
    """A plan on its curve, in spans within which everything is smooth.

    Span k is the part x in [lower[k], upper[k]] of interval[k]; u_ends (2, n) is u there, exactly on a knot of the
    curve where the span ends at one.
    """

    curve: Curve
    law: _Law
    interval: IntArray
    lower: FloatArray
    upper: FloatArray
    u_ends: FloatArray

    @classmethod
    def of(cls, curve: Curve, law: _Law) -> _Motion:
        """Cut the intervals at the knots they cross."""
        knots = curve._candidate_breaks()
        u0, u1 = curve.domain
        u_ends = np.clip(law.ends[:, 0], u0, u1)
        if knots.size:
            near = np.clip(np.searchsorted(knots, u_ends), 1, knots.size) - 1
            for k in (near, np.minimum(near + 1, knots.size - 1)):
                u_ends = np.where(np.abs(u_ends - knots[k]) <= _ON_KNOT * (u1 - u0), knots[k], u_ends)
        first = np.searchsorted(knots, u_ends[0], side="right")
        parts = np.maximum(np.searchsorted(knots, u_ends[1], side="left") - first, 0) + 1
        interval = np.repeat(np.arange(law.h.size), parts)
        part = np.arange(interval.size) - np.repeat(np.cumsum(parts) - parts, parts)
        lower, upper, u_ends = np.zeros(interval.size), np.ones(interval.size), u_ends[:, interval]
        cut = np.flatnonzero(part > 0)
        at = knots[first[interval[cut]] + part[cut] - 1]
        lower[cut] = upper[cut - 1] = law.crossing(interval[cut], at)
        u_ends[0, cut] = u_ends[1, cut - 1] = at
        return cls(curve, law, interval, lower, upper, u_ends)

    @property
    def names(self) -> tuple[tuple[str, int], ...]:
        """Limit and axis (-1: none) of each measured quantity."""
        single = (*_TIP_RATES, "reversal")
        return (*((name, -1) for name in single), *((what, j) for what in _AXIS_RATES for j in range(self.curve.dim)))

    def time(self, span: IntArray, x: FloatArray) -> FloatArray:
        """Time at x of each span, both flat."""
        i = self.interval[span]
        return self.law.start[i] + x * self.law.h[i]

    def parameter(self, span: IntArray, x: FloatArray) -> FloatArray:
        """Curve parameter on the spans (n,) at x (n, k), within the span's ends."""
        ends = np.sort(self.u_ends[:, span], axis=0)
        return np.clip(self.law.value(self.interval[span], x), ends[0, :, None], ends[1, :, None])

    def measure(self, span: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed values and slack of every quantity of ``names``, (quantities, n, k), on the spans (n,) at x (n, k).

        With q = C(u(t)):  q' = C_u u',  q'' = C_uu u'^2 + C_u u'',  q''' = C_uuu u'^3 + 3 C_uu u' u'' + C_u u'''.
        Along the tip p with unit tangent t:  s' = p'.t,  s'' = p''.t,  s''' = p'''.t + p''.t', where p''.t' =
        |n|^2 u'^3 / |p_u| with n the part of p_uu across t.
        """
        i = self.interval[span]
        u = self.parameter(span, x)
        rates = self.law.rates(i, x)
        from_left = (u >= self.u_ends[1, span, None]) | (x >= self.upper[span, None])
        d = _one_sided(self.curve, u, from_left)
        axes = _time_derivatives(d, rates)
        # To first order and beyond: the chain rule takes no larger value than from the sizes of all its terms.
        high, size = np.abs(rates) + self.law.slack[:, i, None], np.abs(rates)
        slack = _time_derivatives(np.abs(d), high) - _time_derivatives(np.abs(d), size)
        tip = self.curve.tip
        if tip is self.curve:
            dp, along, tip_slack = d, axes, slack
        else:
            dp = _one_sided(tip, u, from_left)
            along = _time_derivatives(dp, rates)
            tip_slack = _time_derivatives(np.abs(dp), high) - _time_derivatives(np.abs(dp), size)
        speed, tangent, turn = _tangent(dp)
        tangential = _dot(along[1:], tangent)
        tangential[1] += turn * rates[0] ** 3
        granted = _norm(tip_slack)
        granted[2] += turn * (high[0] ** 3 - size[0] ** 3)
        back = -rates[0], np.broadcast_to(self.law.slack[0, i, None], u.shape)
        by_axis = (np.moveaxis(a, -1, 1).reshape(-1, *u.shape) for a in (axes, slack))
        values = np.concatenate([[speed * rates[0], *tangential, back[0]], next(by_axis)])
        return values, np.concatenate([granted, back[1][None], next(by_axis)])


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Product over the last axis, which is short: einsum is several times faster there than multiply and sum."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _norm(a: FloatArray) -> FloatArray:
    return np.sqrt(_dot(a, a))


def _axis_rows(dim: int, k: int) -> slice:
    """Rows of the axes' velocity (k = 0), acceleration (1) or jerk (2) among the measured quantities."""
    return slice(_REVERSAL + 1 + k * dim, _REVERSAL + 1 + (k + 1) * dim)


def _sizes(values: FloatArray) -> FloatArray:
    """What is compared with the limits: sizes, but of the speed backwards only what is backwards."""
    sizes = np.abs(values)
    sizes[_REVERSAL] = values[_REVERSAL]
    return sizes


def _one_sided(curve: Curve, u: FloatArray, from_left: BoolArray) -> FloatArray:
    d = curve.derivatives(u, 3)
    if from_left.any():
        d[:, from_left] = curve.derivatives(u[from_left], 3, side="left")
    return d


def _time_derivatives(d: FloatArray, rates: FloatArray) -> FloatArray:
    """Chain rule: the first three time derivatives, (3, ..., dim), from those with respect to u."""
    u1, u2, u3 = rates[..., None]
    return np.stack([d[1] * u1, d[2] * u1**2 + d[1] * u2, d[3] * u1**3 + 3.0 * d[2] * u1 * u2 + d[1] * u3])


def _tangent(d: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """|p_u|, the unit tangent and |n|^2 / |p_u|, with n the part of p_uu across the tangent."""
    speed = _norm(d[1])
    # Where the tip rests in the parameter, it leaves along its second derivative.
    direction = np.where(speed[..., None] > 0.0, d[1], d[2])
    size = _norm(direction)[..., None]
    tangent = np.divide(direction, size, out=np.zeros_like(direction), where=size > 0.0)
    across = d[2] - _dot(d[2], tangent)[..., None] * tangent
    turn = _dot(across, across)
    return speed, tangent, np.divide(turn, speed, out=np.zeros_like(turn), where=speed > 0.0)


# ---- peaks ---------------------------------------------------------------------------------------------------------


def _peaks(heights: FloatArray) -> tuple[FloatArray, IntArray]:
    """Height and index of the top of each row (..., k); inside a row, height of the parabola through the top three."""
    top = heights.argmax(axis=-1)
    middle = np.clip(top, 1, heights.shape[-1] - 2)[..., None]
    before, here, after = (np.take_along_axis(heights, middle + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    inside = (middle[..., 0] == top) & (bend < 0.0)
    rise = np.divide(-((before - after) ** 2), 8.0 * bend, out=np.zeros_like(bend), where=inside)
    return np.take_along_axis(heights, top[..., None], axis=-1)[..., 0] + rise, top


def _zoom(
    height: Callable[[FloatArray], FloatArray], x: FloatArray, half: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Climb to the highest point within x - half .. x + half, each row of x (n,) on its own."""
    steps = np.linspace(-1.0, 1.0, _ZOOM_POINTS)
    for _ in range(_ZOOM_ROUNDS):
        trial = np.clip(x[:, None] + half[:, None] * steps, lower[:, None], upper[:, None])
        top = height(trial).argmax(axis=1)
        x = trial[np.arange(x.size), top]
        half = half / _ZOOM_SHRINK
    return x


def _chunks(count: int, points_each: int) -> Iterator[IntArray]:
    size = max(1, _CHUNK_POINTS // points_each)
    for first in range(0, count, size):
        yield np.arange(first, min(first + size, count))


@dataclass(frozen=True, eq=False)
class _Scan:
    """What the dense pass over a profile keeps.

    top_span, top_x : (quantities, candidates)
        The highest spans of each quantity and where their highest points are.
    largest : (quantities,)
        Largest size of each quantity at the points, less its slack.
    jerk : (dim, spans)
        Largest |axis jerk| on each span.
    steps : (2, spans + 1, dim)
        Steps of axis velocity and acceleration where spans meet; first and last entry: against a standstill.
    """

    top_span: IntArray
    top_x: FloatArray
    largest: FloatArray
    jerk: FloatArray
    steps: FloatArray


def _scan(motion: _Motion, density: int) -> _Scan:
    dim, spans = motion.curve.dim, motion.interval.size
    count = len(motion.names)
    grid = np.linspace(0.0, 1.0, density)
    top_height = np.full((count, 0), 0.0)
    top_span, top_x = np.zeros((count, 0), dtype=np.intp), np.zeros((count, 0))
    largest = np.zeros(count)
    jerk = np.empty((dim, spans))
    ends = np.zeros((2, 2, spans + 1, dim))  # velocity and acceleration; before and after each meeting point
    for span in _chunks(spans, density):
        lower, upper = motion.lower[span, None], motion.upper[span, None]
        x = np.where(grid == 1.0, upper, lower + (upper - lower) * grid)
        values, slack = motion.measure(span, x)
        sizes = _sizes(values)
        largest = np.maximum(largest, (sizes - slack).max(axis=(1, 2)))
        for k in range(2):
            rows = _axis_rows(dim, k)
            ends[k, 0, span + 1] = values[rows, :, -1].T
            ends[k, 1, span] = values[rows, :, 0].T
        jerk[:, span] = _peaks(sizes[-dim:])[0]
        heights, top = _peaks(sizes - slack)
        # Stable: of equal peaks the earliest counts, however the spans are cut into chunks.
        top_height = np.concatenate([top_height, heights], axis=1)
        order = np.argsort(-top_height, axis=1, kind="stable")[:, :_CANDIDATES]
        top_span = np.concatenate([top_span, np.broadcast_to(span, heights.shape)], axis=1)
        top_x = np.concatenate([top_x, x[np.arange(span.size), top]], axis=1)
        top_height, top_span, top_x = (np.take_along_axis(a, order, axis=1) for a in (top_height, top_span, top_x))
    return _Scan(top_span, top_x, largest, jerk, ends[:, 1] - ends[:, 0])


def _worst(motion: _Motion, scan: _Scan, density: int) -> Iterator[tuple[str, int, float, float, Place]]:
    """Yield quantity, axis, worst value, its slack and its place, after the search around the highest points."""
    span, candidates = scan.top_span.reshape(-1), scan.top_span.shape[1]
    quantity = np.repeat(np.arange(len(motion.names)), candidates)
    every = np.arange(span.size)

    def height(x: FloatArray) -> FloatArray:
        values, slack = motion.measure(span, x)
        return np.asarray((_sizes(values) - slack)[quantity, every])

    lower, upper = motion.lower[span], motion.upper[span]
    x = _zoom(height, scan.top_x.reshape(-1), (upper - lower) / (density - 1), lower, upper)[:, None]
    values, slack = motion.measure(span, x)
    worst, slack = _sizes(values)[quantity, every, 0], slack[quantity, every, 0]
    u, t = motion.parameter(span, x)[:, 0], motion.time(span, x[:, 0])
    best = (worst - slack).reshape(-1, candidates).argmax(axis=1) + candidates * np.arange(len(motion.names))
    for (name, j), k in zip(motion.names, best, strict=True):
        yield name, j, max(float(worst[k]), 0.0), float(slack[k]), (float(t[k]), float(u[k]))


# ---- a profile -----------------------------------------------------------------------------------------------------


def _check_profile(curve: Curve, limits: Limits, profile: FeedrateProfile, density: int, rows: _Rows) -> Report:
    if not _check_table(curve, profile, rows):
        return Report(tuple(rows.rows), np.nan, np.nan, np.nan, np.nan)
    motion = _Motion.of(curve, _Law.of(profile))
    scan = _scan(motion, density)
    table = rows.rows
    rows.rows = []
    turning_back = _VELOCITY_STEP * float(np.abs(profile.u_rate).max())
    for name, j, worst, slack, place in _worst(motion, scan, density):
        if j >= 0:
            rows.add(name, worst, getattr(limits, name)[j], place, slack=slack, j=j)
        elif name == "reversal":
            rows.add(name, worst, 0.0, place, slack=slack + turning_back)
        else:
            rows.add(name, worst, getattr(limits, name.replace(" ", "_")), place, slack=slack)
    if curve.feed_caps is not None:
        rows.add("programmed feed", *_programmed_feed(motion, density))
    worst, place = _profile_chord(motion, limits.period)
    rounding = _position_rounding(curve, np.clip(profile.u, *curve.domain))
    rows.add("chord error", worst, limits.chord_error, place, slack=rounding)
    _check_steps(motion, scan, limits, rows, density)
    _check_corners(motion, scan, limits, rows)
    ends = motion.measure(np.array([0, motion.interval.size - 1]), np.array([[0.0], [1.0]]))[0][:2, :, 0]
    return Report(tuple(rows.rows + table), *(float(value) for value in ends.reshape(-1)))


def _programmed_feed(motion: _Motion, density: int) -> tuple[float, float, tuple[float, float]]:
    """Feed that uses most of what the curve's own caps command: value, cap and place."""
    caps, worst = motion.curve.feed_caps, (0.0, np.inf, (0.0, 0.0))
    x = np.linspace(0.0, 1.0, density)
    for lo in range(0, motion.interval.size, _CHUNK_POINTS // density):
        span = np.arange(lo, min(lo + _CHUNK_POINTS // density, motion.interval.size))
        inside = motion.lower[span, None] + x * (motion.upper - motion.lower)[span, None]
        feeds, u = motion.measure(span, inside)[0][0], motion.parameter(span, inside)
        # A span ends at the knots of the path; on a step of the cap it has the cap of its own side.
        cap = caps.at(u, u >= motion.u_ends[1, span, None]) if caps is not None else np.full(u.shape, np.inf)
        k = np.unravel_index(int((feeds / cap).argmax()), feeds.shape)
        if feeds[k] / cap[k] > worst[0] / worst[1]:
            worst = (float(feeds[k]), float(cap[k]), (float(motion.time(span, inside[:, k[1]])[k[0]]), float(u[k])))
    return worst


def _check_table(curve: Curve, profile: FeedrateProfile, rows: _Rows) -> bool:
    """Check that the table is a time law over the whole curve; False where it cannot be evaluated at all."""
    columns = {name: getattr(profile, name) for name in ("t", "u", "u_rate", "u_acceleration", "s", "feed")}
    t, u = profile.t, profile.u
    if t.ndim != 1 or t.size < 2 or any(column.shape != t.shape for column in columns.values()):
        shapes = ", ".join(f"{name} {column.shape}" for name, column in columns.items())
        raise InputError(
            f"the columns of the plan have the shapes {shapes}; they must be one-dimensional, equal, >= 2 long"
        )
    bad = ~np.isfinite(np.stack(list(columns.values()))).all(axis=0)
    at = int(np.argmax(bad))
    rows.add("finite values", int(bad.sum()), 0.0, (t[at], u[at]))
    if bad.any():
        return False
    back = np.concatenate([[abs(t[0])], np.maximum(-np.diff(t), 0.0)])
    at = int(np.argmax(back))
    late = t[-1] <= t[0]
    rows.add("time order", np.inf if late else back[at], 0.0, (t[at], u[at]))
    if late or back[at] > 0.0:
        return False
    u0, u1 = curve.domain
    per_u = _extent(curve) / (u1 - u0)
    slack = _ON_KNOT * _extent(curve)
    rows.add("path start", abs(u[0] - u0) * per_u, 0.0, (t[0], u[0]), slack=slack)
    rows.add("path end", abs(u[-1] - u1) * per_u, 0.0, (t[-1], u[-1]), slack=slack)
    jump = np.where(np.diff(t) == 0.0, np.abs(np.diff(u)), 0.0)
    at = int(np.argmax(jump))
    rows.add("position step", jump[at] * per_u, 0.0, (t[at], u[at]), slack=slack)
    inside = np.clip(u, u0, u1)
    speed = [_norm(curve.tip.derivatives(inside, 1, side=side)[1]) for side in ("left", "right")]
    feed = np.min([np.abs(v * profile.u_rate - profile.feed) for v in speed], axis=0)
    length = np.abs(curve.arclength.s(inside) - profile.s) / _extent(curve)
    off = np.maximum(length, feed / max(float(np.abs(profile.feed).max()), 1e-300))
    at = int(np.argmax(off))
    rows.add("table columns", off[at], _COLUMN_TOLERANCE, (t[at], u[at]))
    return True


def _extent(curve: Curve) -> float:
    """Length of the tip's path, mm; 1 mm where only rotary axes move, so that shares of it still mean something."""
    return curve.length or 1.0


def _group_sizes(curve: Curve, largest: FloatArray) -> FloatArray:
    """Size against which an axis is judged: the largest of the axes with its unit.

    At least a thousandth of the largest of all, since axes that stand still have nothing but rounding to compare with.
    """
    units = np.array(curve.axis_units)
    group = np.array([largest[units == unit].max() for unit in units])
    return np.asarray(np.maximum(group, 1e-3 * largest.max()))


def _check_steps(motion: _Motion, scan: _Scan, limits: Limits, rows: _Rows, density: int) -> None:
    """Steps of velocity and acceleration between spans, and what the latter become once they are sampled."""
    dim, period = motion.curve.dim, limits.period
    velocity, acceleration = (_group_sizes(motion.curve, scan.largest[_axis_rows(dim, k)]) for k in range(2))
    t = np.append(motion.time(np.arange(motion.interval.size), motion.lower), motion.law.start[-1] + motion.law.h[-1])
    u = np.append(motion.u_ends[0], motion.u_ends[1, -1])
    steps = scan.steps.copy()
    # A controller holds the first and the last point.  A plan that begins (ends) at speed continues another one, so
    # there is nothing to compare with; from a standstill, an acceleration at once is a step like any other.
    for end in (0, -1):
        if (np.abs(steps[0, end]) > _VELOCITY_STEP * velocity).any():
            steps[1, end] = 0.0
        steps[0, end] = 0.0
    sizes = np.abs(steps)
    for j in range(dim):
        k = int(sizes[0, :, j].argmax())
        rows.add("velocity step", sizes[0, k, j], 0.0, (t[k], u[k]), slack=_VELOCITY_STEP * velocity[j], j=j)
    for j in range(dim):
        k = int(sizes[1, :, j].argmax())
        slack = _ACCELERATION_STEP * acceleration[j]
        # The step that alone, once sampled, would use up the jerk.
        alone = limits.jerk[j] * period / _STEP_PEAK
        rows.add("acceleration step", sizes[1, k, j], alone, (t[k], u[k]), slack=slack, j=j)
    found = np.flatnonzero((sizes[1] > _ACCELERATION_STEP * acceleration).any(axis=1))
    if found.size == 0:
        return
    t, u, steps = t[found], u[found], steps[1, found]
    near = _jerk_near(motion, scan, t, _STEP_REACH * period, density)
    phases = np.linspace(-1.5, 1.5, 13)
    height, at = np.empty((t.size, dim)), np.empty((t.size, dim))
    for some in _chunks(t.size, phases.size * dim):
        seen = _sampled_steps(t[some, None] + phases * period, t, steps, period)
        height[some], top = _peaks(np.moveaxis(seen, 1, -1))
        at[some] = t[some, None] + phases[top] * period
    for j in range(dim):
        best = np.argsort(-(height[:, j] + near[:, j]), kind="stable")[:_CANDIDATES]
        half = np.full(best.size, 0.25 * period)

        def rise(x: FloatArray, j: int = j) -> FloatArray:
            return _sampled_steps(x, t, steps, period)[..., j]

        x = _zoom(rise, at[best, j], half, at[best, j] - half, at[best, j] + half)
        total = rise(x[:, None])[:, 0] + near[best, j]
        k = int(total.argmax())
        rows.add("jerk at a curvature break", total[k], limits.jerk[j], (t[best[k]], u[best[k]]), j=j)


def _sampled_steps(at: FloatArray, t: FloatArray, steps: FloatArray, period: float) -> FloatArray:
    """|third difference| / T^3 of samples centred at the times ``at`` (n, k), by steps of the acceleration; (n, k, dim).

    A step D at the time t_i makes D B((at - t_i) / T) / T, with the quadratic B-spline

        B(z) = 3/4 - z^2 for |z| <= 1/2,   (3/2 - |z|)^2 / 2 for |z| <= 3/2,

    and those of steps that are close together add up.
    """
    first = np.searchsorted(t, at - 1.5 * period)
    last = np.searchsorted(t, at + 1.5 * period, side="right")
    total = np.zeros((*at.shape, steps.shape[1]))
    for k in range(int((last - first).max())):
        i = np.minimum(first + k, t.size - 1)
        z = np.abs(at - t[i]) / period
        spline = np.where(z <= 0.5, 0.75 - z**2, 0.5 * np.maximum(1.5 - z, 0.0) ** 2)
        total += np.where(first + k < last, spline, 0.0)[..., None] * steps[i]
    return np.asarray(np.abs(total) / period)


def _jerk_near(motion: _Motion, scan: _Scan, t: FloatArray, reach: float, density: int) -> FloatArray:
    """Largest |axis jerk| (m, dim) within ``reach`` of each time; spans that the window cuts are measured again."""
    dim, spans = motion.curve.dim, motion.interval.size
    every = np.arange(spans)
    begin, end = motion.time(every, motion.lower), motion.time(every, motion.upper)
    first = np.minimum(np.searchsorted(end, t - reach, side="right"), spans - 1)
    last = np.maximum(np.searchsorted(begin, t + reach, side="left") - 1, first)
    # Whole spans lie strictly between the first and the last; reduceat takes pairs of bounds.
    bounds = np.stack([first + 1, last], axis=1).reshape(-1)
    padded = np.concatenate([scan.jerk, np.zeros((dim, 2))], axis=1)
    whole = np.maximum.reduceat(padded, bounds, axis=1)[:, ::2].T
    largest = np.where((last > first + 1)[:, None], whole, 0.0)
    grid = np.linspace(0.0, 1.0, density)
    for some in _chunks(t.size, 2 * density):
        for span in (first[some], last[some]):
            i = motion.interval[span]
            window = (t[some] + reach * np.array([[-1.0], [1.0]]) - motion.law.start[i]) / motion.law.h[i]
            lower, upper = np.clip(window, motion.lower[span], motion.upper[span])[:, :, None]
            x = np.where(grid == 1.0, upper, lower + (upper - lower) * grid)
            height = _peaks(np.abs(motion.measure(span, x)[0][-dim:]))[0].T
            largest[some] = np.maximum(largest[some], height)
    return largest


def _check_corners(motion: _Motion, scan: _Scan, limits: Limits, rows: _Rows) -> None:
    """At a corner of the path the plan must stand still, with no acceleration on either side."""
    dim = motion.curve.dim
    corners = [b.u for b in motion.curve.breaks if b.geometric == 0]
    before = np.flatnonzero(np.isin(motion.u_ends[1, :-1], corners))
    if before.size == 0:
        return
    span = np.concatenate([before, before + 1])
    x = np.concatenate([motion.upper[before], motion.lower[before + 1]])
    measured = np.abs(motion.measure(span, x[:, None])[0][..., 0])
    values = [measured[_axis_rows(dim, k)] for k in range(2)]
    linear = np.array(motion.curve.axis_units) == "mm"
    velocity = np.where(linear, np.minimum(limits.velocity, limits.feed), limits.velocity)
    for name, k, allowed, share, power in (
        ("exact stop", 0, velocity, _VELOCITY_STEP, "/s"),
        ("acceleration at an exact stop", 1, limits.acceleration, _ACCELERATION_STEP, "/s^2"),
    ):
        # Without a limit, what the plan does elsewhere is the measure.
        own = _group_sizes(motion.curve, scan.largest[_axis_rows(dim, k)])
        slack = share * np.where(np.isfinite(allowed), allowed, own)
        used = np.divide(values[k], slack[:, None], out=np.zeros_like(values[k]), where=slack[:, None] > 0.0)
        j, where = (int(index) for index in np.unravel_index(used.argmax(), used.shape))
        place = (float(motion.time(span[[where]], x[[where]])[0]), float(motion.u_ends[1, before[where % before.size]]))
        rows.add(name, values[k][j, where], 0.0, place, slack=slack[j], unit=motion.curve.axis_units[j] + power)


# ---- chords --------------------------------------------------------------------------------------------------------


def _from_segment(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance of points (..., k, dim) from the segments a-b (..., dim)."""
    chord = (b - a)[..., None, :]
    from_a = points - a[..., None, :]
    square = _dot(chord, chord)
    along = _dot(from_a, chord)
    share = np.clip(np.divide(along, square, out=np.zeros_like(along), where=square > 0.0), 0.0, 1.0)
    return _norm(from_a - share[..., None] * chord)


def _profile_chord(motion: _Motion, period: float) -> tuple[float, Place]:
    """Largest distance between the tip's path and its chord of one period, over every start of the period.

    The last point is held, so the last chords are shorter.
    """
    law, tip = motion.law, motion.curve.tip
    u0, u1 = motion.curve.domain
    end = float(law.start[-1] + law.h[-1])
    period = min(period, end)

    def parameter(t: FloatArray) -> FloatArray:
        i, x = law.at(np.minimum(t, end).reshape(-1))
        return np.asarray(np.clip(law.value(i, x[:, None])[:, 0], u0, u1).reshape(t.shape))

    def position(t: FloatArray) -> FloatArray:
        return np.asarray(tip.derivatives(parameter(t), 0)[0])

    top = np.zeros(0)
    top_start, top_share = np.zeros(0), np.zeros(0)
    for starts, points in _chords(law, position, period, end):
        height, at = _peaks(_from_segment(points, points[:, 0], points[:, -1]))
        top = np.concatenate([top, height])
        top_start = np.concatenate([top_start, starts])
        top_share = np.concatenate([top_share, at / _CHORD_PARTS])
        order = np.argsort(-top, kind="stable")[:_CANDIDATES]
        top, top_start, top_share = top[order], top_start[order], top_share[order]

    start, share = _climb_chords(position, top_start, top_share, period, end)
    heights = _from_segment(position(start + share * period)[:, None], position(start), position(start + period))[:, 0]
    best = int(heights.argmax())
    t = min(float(start[best] + share[best] * period), end)
    return float(heights[best]), (t, float(parameter(np.array([t]))[0]))


def _chords(
    law: _Law, position: Callable[[FloatArray], FloatArray], period: float, end: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Starts of chords of one period, and the path at equal times within each, (n, parts + 1, dim), in chunks.

    The starts are a fraction of the period apart; where a plan has far more periods than nodes they follow the nodes, as
    nothing changes faster than between two of those.
    """
    part = period / _CHORD_PARTS
    count = int(np.ceil(end / (part * _CHORD_STRIDE)))
    if count <= _STARTS_PER_INTERVAL * law.h.size + _CANDIDATES:
        for window in _chunks(count, _CHORD_PARTS + 1):
            k = np.arange(window[0] * _CHORD_STRIDE, window[-1] * _CHORD_STRIDE + _CHORD_PARTS + 1)
            view = np.lib.stride_tricks.sliding_window_view(position(k * part), _CHORD_PARTS + 1, axis=0)
            yield np.asarray(window * _CHORD_STRIDE * part, dtype=np.float64), np.moveaxis(view[::_CHORD_STRIDE], -1, 1)
        return
    within = np.arange(_STARTS_PER_INTERVAL) / _STARTS_PER_INTERVAL
    every = (law.start[:, None] + law.h[:, None] * within).reshape(-1)
    for window in _chunks(every.size, _CHORD_PARTS + 1):
        starts = every[window]
        yield np.asarray(starts), position(starts[:, None] + part * np.arange(_CHORD_PARTS + 1))


def _climb_chords(
    position: Callable[[FloatArray], FloatArray], start: FloatArray, share: FloatArray, period: float, end: float
) -> tuple[FloatArray, FloatArray]:
    """Move start and place (share of the period) of each chord to the highest distance nearby."""
    steps = np.linspace(-1.0, 1.0, 9)
    half_start, half_share = period * _CHORD_STRIDE / _CHORD_PARTS, 1.0 / _CHORD_PARTS
    for _ in range(12):
        starts = np.clip(start[:, None] + half_start * steps, 0.0, end)
        shares = np.clip(share[:, None] + half_share * steps, 0.0, 1.0)
        points = position(starts[:, :, None] + shares[:, None, :] * period)
        heights = _from_segment(points, position(starts), position(starts + period))
        best = heights.reshape(start.size, -1).argmax(axis=1)
        start = starts[np.arange(start.size), best // steps.size]
        share = shares[np.arange(start.size), best % steps.size]
        half_start, half_share = half_start / 3.0, half_share / 3.0  # a spacing is a quarter of the half-width
    return start, share


def _sample_chord(curve: Curve, samples: Samples, u: FloatArray, density: int) -> tuple[float, Place]:
    """Largest distance between the tip's path and the chords between consecutive samples."""
    tip = curve.tip
    begin, end = u[:-1], u[1:]
    grid = np.linspace(0.0, 1.0, density)

    def distance(k: IntArray, x: FloatArray) -> FloatArray:
        lo, hi = np.minimum(begin, end)[k, None], np.maximum(begin, end)[k, None]
        between = np.clip(begin[k, None] + (end - begin)[k, None] * x, lo, hi)
        ends = tip.derivatives(np.stack([begin[k], end[k]]), 0)[0]
        return _from_segment(tip.derivatives(between, 0)[0], ends[0], ends[1])

    top, top_k, top_x = np.zeros(0), np.zeros(0, dtype=np.intp), np.zeros(0)
    for k in _chunks(begin.size, density):
        height, at = _peaks(distance(k, np.broadcast_to(grid, (k.size, density))))
        top, top_k = np.concatenate([top, height]), np.concatenate([top_k, k])
        top_x = np.concatenate([top_x, grid[at]])
        order = np.argsort(-top, kind="stable")[:_CANDIDATES]
        top, top_k, top_x = top[order], top_k[order], top_x[order]
    half = np.full(top_k.size, 1.0 / (density - 1))
    x = _zoom(lambda trial: distance(top_k, trial), top_x, half, np.zeros(half.size), np.ones(half.size))
    heights = distance(top_k, x[:, None])[:, 0]
    best = int(heights.argmax())
    first, share = int(top_k[best]), float(x[best])
    place = float(samples.t[first]) + share * samples.period, float(begin[first] + (end[first] - begin[first]) * share)
    return float(heights[best]), place


# ---- samples -------------------------------------------------------------------------------------------------------


def _position_rounding(curve: Curve, u: FloatArray) -> float:
    """What the last digit of u and of the tip's position are worth, mm."""
    d = curve.tip.derivatives(u, 1)
    return _EPS * float((np.abs(d[0]) + 0.5 * np.abs(d[1] * u[:, None])).max(initial=0.0))


def _check_samples(curve: Curve, limits: Limits, samples: Samples, density: int, rows: _Rows) -> Report:
    if not _check_sequence(curve, samples, rows):
        return Report(tuple(rows.rows), np.nan, np.nan, np.nan, np.nan)
    table = rows.rows
    rows.rows = []
    period = samples.period
    u = np.clip(samples.u, *curve.domain)
    tip = curve.tip.derivatives(u, 0)[0]
    feeds = _norm(np.diff(tip, axis=0)) / period
    tip_rounding = _position_rounding(curve, u)
    k = int(feeds.argmax())
    rows.add("feed", feeds[k], limits.feed, _middle(samples, k + 0.5), slack=2.0 * tip_rounding / period)
    if curve.feed_caps is not None:
        # Between two samples the path may lie under several caps; the mean feed is below the highest of them.
        edges, cap = curve.feed_caps.edges, curve.feed_caps.feed
        first = np.clip(np.searchsorted(edges, u[:-1], side="right") - 1, 0, cap.size - 1)
        last = np.clip(np.searchsorted(edges, u[1:], side="left") - 1, first, cap.size - 1)
        bounds = np.stack([first, last + 1], axis=1).reshape(-1)
        highest = np.maximum.reduceat(np.append(cap, 0.0), bounds)[::2]
        k = int((feeds / highest).argmax())
        rows.add("programmed feed", feeds[k], highest[k], _middle(samples, k + 0.5), slack=2.0 * tip_rounding / period)
    worst, place = _sample_chord(curve, samples, u, density)
    rows.add("chord error", worst, limits.chord_error, place, slack=tip_rounding)
    # A position is known to half its last digit, its evaluation to about as much, and u moves it by |C_u| times half of
    # its own: e in all.  The n-th difference weighs its points with the binomials, whose sum is 2^n, so e costs at most
    # 2^n e / T^n; for the jerk 8 e / T^3.
    slope = np.abs(curve.derivatives(u, 1)[1] * u[:, None]).max(axis=0)
    rounding = _EPS * (np.abs(samples.position).max(axis=0) + 0.5 * slope)
    moving, before = _held(samples, samples.position)
    for n, name in enumerate(_AXIS_RATES, start=1):
        sizes = np.abs(np.diff(moving, n, axis=0)) / period**n
        for j in range(curve.dim):
            k = int(sizes[:, j].argmax())
            slack = 2.0**n * rounding[j] / period**n
            place = _middle(samples, k - before + 0.5 * n)
            rows.add(name, sizes[k, j], getattr(limits, name)[j], place, slack=slack, j=j)
    s = curve.arclength.s(u)
    s_rounding = _LENGTH_ACCURACY * curve.length + tip_rounding
    moving, before = _held(samples, s)
    for n, name in ((2, "tangential acceleration"), (3, "tangential jerk")):
        size = np.abs(np.diff(moving, n)) / period**n
        if size.size == 0:
            continue
        k = int(size.argmax())
        allowed = getattr(limits, name.replace(" ", "_"))
        slack = 2.0**n * s_rounding / period**n
        rows.add(name, size[k], allowed, _middle(samples, k - 3 + 0.5 * n), slack=slack)
    change = np.diff(feeds) / period if feeds.size > 1 else np.zeros(1)
    ends = (feeds[0], feeds[-1], change[0], change[-1])
    return Report(tuple(rows.rows + table), *(float(value) for value in ends))


def _held(samples: Samples, values: FloatArray) -> tuple[FloatArray, int]:
    """Samples as the drives see them, and how many were put before the first.

    At an end at rest the point is held, three times for the third difference.  At an end with a feed the path goes on:
    nothing is added, and the last period, which the end of the curve cuts short, is left out.
    """
    before = 3 if samples.start_feed == 0.0 else 0
    after = 3 if samples.end_feed == 0.0 else 0
    inner = values if after or values.shape[0] < 3 else values[:-1]
    width = [(before, after)] + [(0, 0)] * (values.ndim - 1)
    return np.pad(inner, width, mode="edge"), before


def _middle(samples: Samples, k: float) -> Place:
    """Time and parameter at a (half) index, the middle of the samples that a difference takes in."""
    k = min(max(k, 0.0), samples.t.size - 1.0)
    ends = [int(np.floor(k)), int(np.ceil(k))]
    return float(samples.t[ends].mean()), float(samples.u[ends].mean())


def _check_sequence(curve: Curve, samples: Samples, rows: _Rows) -> bool:
    """Check that the samples are points of the whole curve, one a period; False where they cannot be measured."""
    t, u, position, period = samples.t, samples.u, samples.position, samples.period
    _require_shapes(curve, samples)
    bad = ~(np.isfinite(t) & np.isfinite(u) & np.isfinite(position).all(axis=1))
    at = int(np.argmax(bad))
    rows.add("finite values", int(bad.sum()), 0.0, (t[at], u[at]))
    if bad.any():
        return False
    off = np.abs(t - (np.round(t[0] / period) + np.arange(t.size)) * period)
    at = int(off.argmax())
    rows.add("sample times", off[at], 0.0, (t[at], u[at]), slack=4.0 * _EPS * float(np.abs(t).max()))
    back = np.maximum(-np.diff(u), 0.0)
    at = int(back.argmax())
    rows.add("reversal", back[at] / period, 0.0, (t[at], u[at]))
    u0, u1 = curve.domain
    on_curve = curve.derivatives(np.clip(u, u0, u1), 0)[0]
    apart = np.abs(position - on_curve)
    extent = np.array([np.ptp(on_curve[:, j]) for j in range(curve.dim)])
    for j, size in enumerate(_group_sizes(curve, extent)):
        k = int(apart[:, j].argmax())
        rows.add("path error", apart[k, j], _PATH_TOLERANCE * (size + 1.0), (t[k], u[k]), j=j)
    ends = curve.derivatives(np.array([u0, u1]), 0)[0]
    per_u = _extent(curve) / (u1 - u0)
    for name, k, end in (("path start", 0, u0), ("path end", -1, u1)):
        missing = max(float(np.abs(position[k] - ends[k]).max()), abs(float(u[k]) - end) * per_u)
        rows.add(name, missing, 0.0, (t[k], u[k]), slack=4.0 * _EPS * float(np.abs(ends[k]).max()))
    return True


def _require_shapes(curve: Curve, samples: Samples) -> None:
    t, u, position = samples.t, samples.u, samples.position
    if not (np.isfinite(samples.period) and samples.period > 0.0):
        raise InputError(f"period = {samples.period!r} of the samples must be > 0 and finite")
    if t.ndim != 1 or t.size < 2 or u.shape != t.shape:
        raise InputError(f"the samples have t {t.shape} and u {u.shape}; both must be (m,) with m >= 2")
    wanted: Sequence[int] = (t.size, curve.dim)
    if position.shape != tuple(wanted):
        raise InputError(
            f"the samples' positions have the shape {position.shape}; {t.size} samples of {curve.name} with its axes "
            f"{', '.join(curve.axes)} need {tuple(wanted)}"
        )
