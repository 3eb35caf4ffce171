"""A plan on its curve: the time law between the nodes, and what the axes and the tool tip do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from planner.compiled import core
from planner.geometry.curve import Curve
from planner.geometry.differential import norm
from planner.types import BoolArray, FloatArray, IntArray
from planner.verify.quantities import names
from planner.verify.sizes import EPS, ON_KNOT, ON_KNOT_OF_GAP


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

    ``ends`` (2, 3, n) holds u, u', u'' as tabulated at both ends of each interval, ``slack`` (3, n) what the rounding
    of the tabulated t, u, u', u'' can change in the first three time derivatives of u.
    """

    start: FloatArray
    h: FloatArray
    ends: FloatArray
    coefficients: FloatArray
    slack: FloatArray

    @classmethod
    def of(cls, profile: Law) -> Quintics:
        """Take the intervals that have a length; those of double nodes have none."""
        nodes = np.stack([profile.u, profile.u_rate, profile.u_acceleration])
        kept = np.flatnonzero(np.diff(profile.t) > 0.0)
        start, h = profile.t[kept], np.diff(profile.t)[kept]
        ends = np.ascontiguousarray(np.stack([nodes[:, kept], nodes[:, kept + 1]]))
        (u0, v0, a0), (u1, v1, a1) = ends
        # The conditions at x = 1 that the Taylor part from x = 0 leaves to x^3, x^4 and x^5.
        left = np.stack([u1 - u0 - v0 * h - 0.5 * a0 * h**2, (v1 - v0 - a0 * h) * h, (a1 - a0) * h**2])
        tail = np.linalg.solve(np.array([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]]), left)
        # Rounding: half a digit at each end of u, u' and u''; that of t moves u by u' times as much.  The factors are
        # the largest derivatives of the quintics that answer to a unit of u, of u' h and of u'' h^2.
        size = np.abs(ends).max(axis=0)
        du = EPS * (size[0] + size[1] * (start + h))
        dv, da = EPS * size[1] * h, EPS * size[2] * h**2
        slack = np.stack([2.0 * (du + dv + da), 6.0 * du + 4.0 * dv + da, 60.0 * du + 36.0 * dv + 9.0 * da])
        slack /= np.stack([h, h**2, h**3])
        return cls(start, h, ends, np.concatenate([[u0, v0 * h, 0.5 * a0 * h**2], tail]), slack)

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
        core.law_parameters(self.h.size, self.start, self.h, self.ends, self.coefficients, t.size, t, low, high, u)
        return u

    def _evaluate(self, i: IntArray, x: FloatArray, count: int) -> FloatArray:
        """Evaluate u, or with count = 4 u and its three derivatives, (count, n, k)."""
        out = np.empty((count, *x.shape))
        x = np.ascontiguousarray(x)
        core.law_values(self.h.size, self.h, self.ends, self.coefficients, *x.shape, i, x, count, out)
        return out

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
        i, x = np.empty(t.size, dtype=np.intp), np.empty(t.size)
        core.law_locate(self.h.size, self.start, self.h, t.size, t, i, x)
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
        u_ends = np.clip(law.ends[:, 0], u0, u1)
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

    def _place(self, span: IntArray, x: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Curve parameter on the spans (n,) at x (n, k), and where it is seen from the left, to be inside the span."""
        law, x = self.law, np.ascontiguousarray(x)
        u, left = np.empty(x.shape), np.empty(x.shape, dtype=np.bool_)
        table = law.h.size, law.h, law.ends, law.coefficients
        spans = self.interval.size, self.interval, self.upper, self.u_ends
        core.motion_place(*table, *spans, *x.shape, span, x, u, left)
        return u, left

    def grid(self, span: IntArray, density: int) -> FloatArray:
        """Equidistant x on each span, (n, density), both ends included exactly."""
        share = np.linspace(0.0, 1.0, density)
        lower, upper = self.lower[span, None], self.upper[span, None]
        return np.where(share == 1.0, upper, lower + (upper - lower) * share)

    def states(self, span: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray, bool, FloatArray, FloatArray]:
        """What every quantity follows from, on the spans (n,) at x (n, k).

        Derivatives of the machine axes (4, n k, dim) and of the tool tip with respect to u, each point of a span from
        inside it, and whether these are the same; time derivatives of u (3, n, k), and what rounding can change in
        them (n, 3).
        """
        i, tip, (u, left) = self.interval[span], self.curve.tip, self._place(span, x)
        d = self.curve.derivatives(u.reshape(-1), 3, side=left.reshape(-1))
        cartesian = tip is self.curve
        p = d if cartesian else tip.derivatives(u.reshape(-1), 3, side=left.reshape(-1))
        return d, p, cartesian, self.law.rates(i, x), np.ascontiguousarray(self.law.slack[:, i].T)

    def measure(self, span: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed values and slack of every quantity, (quantities, n, k), on the spans (n,) at x (n, k)."""
        return measure_points(*self.states(span, x))

    def feed(self, span: IntArray, x: FloatArray) -> FloatArray:
        """Speed of the tool tip, in the direction of u, on the spans (n,) at x (n, k)."""
        u, left = self._place(span, x)
        slope = self.curve.tip.derivatives(u, 1, side=left)[1]
        return np.asarray(norm(slope) * self.law.rates(self.interval[span], x)[0])


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
