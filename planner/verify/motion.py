"""A plan on its curve: the time law between the nodes, and what the axes and the tool tip do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from planner.compiled import core
from planner.geometry.curve import Curve
from planner.geometry.differential import norm
from planner.types import BoolArray, FloatArray, IntArray
from planner.verify.quantities import names
from planner.verify.sizes import ON_KNOT, ON_KNOT_OF_GAP

_COLUMNS = 17  # of the table of a law


class Law(Protocol):
    """Nodes of a time law: four (n,) arrays."""

    @property
    def t(self) -> FloatArray:
        """Times, s."""

    @property
    def u(self) -> FloatArray:
        """Curve parameters."""

    @property
    def u_rate(self) -> FloatArray:
        """First time derivative of u."""

    @property
    def u_acceleration(self) -> FloatArray:
        """Second time derivative of u."""


@dataclass(frozen=True, eq=False)
class Quintics:
    """The quintics between the nodes, over x = (t - start) / h in [0, 1].

    Attributes
    ----------
    table : (n, 17) array
        A row each: start, h; u, u', u'' as tabulated at both ends; coefficients of the powers of x; what the rounding of
        the tabulated t, u, u', u'' can change in the first three time derivatives of u.
    start, h : (n,) arrays
        Time at which each begins, and how long it lasts, s.
    """

    table: FloatArray
    start: FloatArray
    h: FloatArray

    @classmethod
    def of(cls, profile: Law) -> Quintics:
        """Take the intervals that have a length; those of double nodes have none."""
        table = np.empty((profile.t.size - 1, _COLUMNS))
        nodes = profile.t, profile.u, profile.u_rate, profile.u_acceleration
        table = table[: core.law_table(profile.t.size, *(np.ascontiguousarray(column) for column in nodes), table)]
        return cls(table, np.ascontiguousarray(table[:, 0]), np.ascontiguousarray(table[:, 1]))

    @property
    def u_ends(self) -> FloatArray:
        """U as tabulated at both ends of each, (2, n)."""
        return np.ascontiguousarray(self.table[:, [2, 5]].T)

    @property
    def slack(self) -> FloatArray:
        """What rounding can change in the first three time derivatives of u, (n, 3)."""
        return self.table[:, -3:]

    def value(self, i: IntArray, x: FloatArray) -> FloatArray:
        """Evaluate u on the intervals i (n,) at x (n, k)."""
        return np.asarray(self._evaluate(i, x, 1)[0])

    def rates(self, i: IntArray, x: FloatArray) -> FloatArray:
        """First three time derivatives of u on the intervals i (n,) at x (n, k), (3, n, k).

        At the ends of an interval u' and u'' are those of the table.
        """
        return self._evaluate(i, x, 4)[1:]

    def parameters(self, t: FloatArray, low: float, high: float) -> FloatArray:
        """Evaluate u at times t (n,), held at the last node and within low .. high."""
        u = np.empty(t.size)
        core.law_parameters(self.h.size, self.table, self.start, t.size, t, low, high, u)
        return u

    def _evaluate(self, i: IntArray, x: FloatArray, count: int) -> FloatArray:
        """Evaluate u, or with count = 4 u and its three derivatives, (count, n, k)."""
        out = np.empty((count, *x.shape))
        core.law_values(self.table, *x.shape, i, np.ascontiguousarray(x), count, out)
        return out

    def crossing(self, i: IntArray, u: FloatArray) -> FloatArray:
        """Solve u(x) = u for x on the intervals i by bisection."""
        x = np.empty(u.size)
        core.law_crossings(self.table, u.size, i, u, x)
        return x

    def at(self, t: FloatArray) -> tuple[IntArray, FloatArray]:
        """Interval and x of each time, flat."""
        i, x = np.empty(t.size, dtype=np.intp), np.empty(t.size)
        core.law_locate(self.h.size, self.table, self.start, t.size, t, i, x)
        return i, x


@dataclass(frozen=True, eq=False)
class Motion:
    """A plan on its curve, in spans within which everything is smooth.

    Span k is the part x in [lower[k], upper[k]] of interval[k]; u_ends (2, n) is u there, exactly on a knot of the
    curve where the span ends at one.
    """

    curve: Curve
    law: Quintics
    interval: IntArray
    lower: FloatArray
    upper: FloatArray
    u_ends: FloatArray

    @classmethod
    def of(cls, curve: Curve, law: Quintics) -> Motion:
        """Cut the intervals at the knots they cross."""
        knots = curve._candidate_breaks()
        u0, u1 = curve.domain
        u_ends = np.clip(law.u_ends, u0, u1)
        if knots.size:
            # Knots may be 1e-8 of the domain apart, and |C'| change between them.
            gaps = np.diff(np.concatenate([[u0], knots, [u1]]))
            local = np.maximum(ON_KNOT_OF_GAP * np.minimum(gaps[:-1], gaps[1:]), 4.0 * np.spacing(np.abs(knots)))
            reach = np.minimum(ON_KNOT * (u1 - u0), local)
            near = np.clip(np.searchsorted(knots, u_ends), 1, knots.size) - 1
            for k in (near, np.minimum(near + 1, knots.size - 1)):
                u_ends = np.where(np.abs(u_ends - knots[k]) <= reach[k], knots[k], u_ends)
        first = np.searchsorted(knots, u_ends[0], side="right")
        parts = np.maximum(np.searchsorted(knots, u_ends[1], side="left") - first, 0) + 1
        interval = np.repeat(np.arange(law.h.size), parts)
        part = np.arange(interval.size) - np.repeat(np.cumsum(parts) - parts, parts)
        lower, upper = np.zeros(interval.size), np.ones(interval.size)
        u_ends = np.ascontiguousarray(u_ends[:, interval])
        cut = np.flatnonzero(part > 0)
        at = knots[first[interval[cut]] + part[cut] - 1]
        lower[cut] = upper[cut - 1] = law.crossing(interval[cut], at)
        u_ends[0, cut] = u_ends[1, cut - 1] = at
        return cls(curve, law, interval, lower, upper, u_ends)

    def time(self, span: IntArray, x: FloatArray) -> FloatArray:
        """Time at x of each span, both flat."""
        i = self.interval[span]
        return self.law.start[i] + x * self.law.h[i]

    def place(self, span: int, x: float) -> tuple[float, float]:
        """Time and curve parameter at x of one span."""
        at = np.array([span])
        return float(self.time(at, np.array([x]))[0]), float(self.parameter(at, np.array([[x]]))[0, 0])

    def parameter(self, span: IntArray, x: FloatArray) -> FloatArray:
        """Curve parameter on the spans (n,) at x (n, k), within the span's ends."""
        return self._place(span, x)[0]

    def _place(
        self, span: IntArray, x: FloatArray, rates: FloatArray | None = None, slack: FloatArray | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """Curve parameter on the spans (n,) at x (n, k), and where it is seen from the left, to be inside the span."""
        u, left, x = np.empty(x.shape), np.empty(x.shape, dtype=np.bool_), np.ascontiguousarray(x)
        spans = self.interval.size, self.interval, self.upper, self.u_ends
        core.motion_place(self.law.table, *spans, *x.shape, span, x, u, left, rates, slack)
        return u, left

    def grid(self, span: IntArray, density: int) -> FloatArray:
        """Equidistant x on each span, (n, density), both ends included exactly."""
        x = np.empty((span.size, density))
        core.motion_grid(*x.shape, span, self.lower, self.upper, x)
        return x

    def states(self, span: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray, bool, FloatArray, FloatArray]:
        """What every quantity follows from, on the spans (n,) at x (n, k).

        Derivatives of the machine axes (4, n k, dim) and of the tool tip with respect to u, each point of a span from
        inside it, and whether these are the same; time derivatives of u (3, n, k), and what rounding can change in
        them (n, 3).
        """
        look = Look(self, span, np.ascontiguousarray(x))
        d, p = look()
        return d, d if p is None else p, p is None, look.rates, look.slack

    def sweep(self, density: int, room: int) -> Sweep:
        """All spans, so many at a time, at ``density`` points each, both ends included."""
        return Sweep(self, density, room)

    def measure(self, span: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed values and slack of every quantity, (quantities, n, k), on the spans (n,) at x (n, k)."""
        return measure_points(*self.states(span, x))

    def feed(self, span: IntArray, x: FloatArray) -> FloatArray:
        """Speed of the tool tip, in the direction of u, on the spans (n,) at x (n, k)."""
        rates = np.empty((3, *x.shape))
        u, left = self._place(span, x, rates)
        slope = self.curve.tip.derivatives(u, 1, side=left)[1]
        return np.asarray(norm(slope) * rates[0])


class _SpanPoints:
    """Points of spans, in arrays that are filled again and again.

    Attributes
    ----------
    x : (n, k) array
        Places on n spans.
    rates, slack : (3, n, k) and (n, 3) arrays
        Time derivatives of u there, and what rounding can change in them.
    """

    def __init__(self, motion: Motion, x: FloatArray) -> None:
        self.x, self.curve = x, motion.curve
        self.u, self.left = np.empty(x.shape), np.empty(x.shape, dtype=np.bool_)
        self.rates, self.slack = np.empty((3, *x.shape)), np.empty((x.shape[0], 3))

    def derivatives(self) -> tuple[FloatArray, FloatArray | None]:
        """Derivatives of the machine axes (4, n k, dim) and of the tool tip there, None where these are the same."""
        d, p = self.curve._evaluate_with_tip(self.u.reshape(-1), 3, self.left.reshape(-1))
        return d, None if p is d else p


class Look(_SpanPoints):
    """Some spans, at places that may be others each time."""

    def __init__(self, motion: Motion, span: IntArray, x: FloatArray) -> None:
        super().__init__(motion, x)
        spans = motion.interval.size, motion.interval, motion.upper, motion.u_ends
        filled = self.u, self.left, self.rates, self.slack
        self._place = core.motion_place.bind(motion.law.table, *spans, *x.shape, span, x, *filled)

    def __call__(self) -> tuple[FloatArray, FloatArray | None]:
        """Derivatives at the places that stand in ``x`` now."""
        self._place()
        return self.derivatives()


class Sweep(_SpanPoints):
    """All spans, one window after the other.

    Attributes
    ----------
    window : (2,) int array
        First span, and how many.
    """

    def __init__(self, motion: Motion, density: int, room: int) -> None:
        super().__init__(motion, np.empty((room, density)))
        self.window, self._spans = np.zeros(2, dtype=np.intp), motion.interval.size
        self.u[:] = motion.curve.domain[0]  # where a window is smaller than there is room
        spans = self._spans, motion.interval, motion.lower, motion.upper, motion.u_ends
        filled = self.x, self.u, self.left, self.rates, self.slack
        self._place = core.motion_sweep.bind(motion.law.table, *spans, *self.x.shape, self.window, *filled)

    def __iter__(self) -> Iterator[tuple[FloatArray, FloatArray | None]]:
        room = self.x.shape[0]
        for first in range(0, self._spans, room):
            self.window[:] = first, min(room, self._spans - first)
            self._place()
            yield self.derivatives()


def measure_points(
    d: FloatArray, p: FloatArray, cartesian: bool, rates: FloatArray, slack: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Values of all quantities and their slack, (quantities, n, k), on n spans at k points each.

    Parameters
    ----------
    d, p : (4, n k, dim) and (4, n k, tip) arrays
        Derivatives of the machine axes and of the tool tip with respect to u.
    cartesian : bool
        The two are the same.
    rates : (3, n, k) array
        Time derivatives of u.
    slack : (n, 3) array
        What rounding can change in these.
    """
    shape, dim = rates.shape[1:], d.shape[2]
    values, granted = np.empty((2, len(names(dim)), *shape))
    core.motion_measure(*shape, dim, p.shape[2], d, None if cartesian else p, rates, slack, values, granted)
    return values, granted
