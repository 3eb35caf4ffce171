"""From a solution in sigma to the nodes of a time law, and how far such nodes use the limits.

A solution gives x = sigma_dot^2 as a cubic on every interval.  Its time law has a node at each knot and each midpoint,

    t' = x^(-1/2) integrated by Gauss,   u_dot = u' x^(1/2),   u_ddot = u'' x + u' a,

with one-sided values at double knots.  Between nodes the law is the quintic of ``profile.py``; that quintic, not the
cubic, is what :func:`utilisation` measures, so what is measured is what will run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.constraints import JERK_BESIDE_STEP, PERIODS_AROUND_STEP, Parameter
from planner.geometry.curve import Curve, FloatArray
from planner.limits import Limits, commanded_feed
from planner.profile import quintic_coefficients

_GAUSS_POINTS = 8  # on half an interval: the integrand varies little there
# Points an interval: an interval of a solver has two nodes' intervals, hence 10 points, and parabolas between.  A stretch
# between breaks has no fewer than the second number: one that is a single interval, as a tiny corner is, hides its peaks.
_POINTS_PER_INTERVAL, _POINTS_PER_STRETCH = 5, 40
_DEEPEST_DIP = 1e-4
_DIGITS = 16.0  # a difference of parameters is known to so many units in their last place
_CHUNK = 20_000


@dataclass(frozen=True, eq=False)
class TimeNodes:
    """Nodes of a time law: four (n,) arrays as in ``FeedrateProfile``; t starts at 0.

    ``steps (2, n - 1)``: t and u from node to node before they are rounded to sums, where the law knows them.  Between
    close nodes the last digits of t and u are worth a jerk; whoever mends an excess must not chase these.
    """

    t: FloatArray
    u: FloatArray
    u_rate: FloatArray
    u_acceleration: FloatArray
    steps: FloatArray | None = None

    def dilated(self, factor: float) -> TimeNodes:
        """The same law run ``factor`` times slower."""
        steps = None if self.steps is None else self.steps * np.array([[factor], [1.0]])
        # Sums of the dilated steps: products of the rounded times would round once more.
        t = self.t * factor if steps is None else np.concatenate([[0.0], np.cumsum(steps[0])])
        return TimeNodes(t, self.u, self.u_rate / factor, self.u_acceleration / factor**2, steps)

    def only(self, index: NDArray[np.intp]) -> TimeNodes:
        """The law through some of the nodes, first and last among them."""
        steps = None if self.steps is None else np.add.reduceat(self.steps, index[:-1], axis=1)
        nodes = TimeNodes(self.t[index], self.u[index], self.u_rate[index], self.u_acceleration[index], steps)
        nodes._keep_forward_at_stops()
        return nodes

    def _keep_forward_at_stops(self) -> None:
        """Let u not fall back in an interval that ends at rest, where the solver's last digits shape the quintic.

        From rate v and acceleration a to rest over h and a distance D, u' = (h - t)^2 p(t) with a quadratic p whose value
        at the end has the sign of 20 D - 8 v h - a h^2; likewise, backwards in time, in one that begins at rest.
        """
        for rest, inner, sign in ((-1, -2, 1.0), (0, 1, -1.0)):
            h = abs(self.t[rest] - self.t[inner])
            if self.u_rate[rest] == 0.0 and h > 0.0:
                most = (20.0 * abs(self.u[rest] - self.u[inner]) / h - 8.0 * self.u_rate[inner]) / h
                self.u_acceleration[inner] = sign * min(sign * self.u_acceleration[inner], most)


def joined(parts: list[TimeNodes]) -> TimeNodes:
    """Join laws; at a stop the last node of one and the first of the next form a double node."""
    offsets = np.concatenate([[0.0], np.cumsum([part.t[-1] for part in parts])])
    return TimeNodes(
        np.concatenate([part.t + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
        np.concatenate([part.u for part in parts]),
        np.concatenate([part.u_rate for part in parts]),
        np.concatenate([part.u_acceleration for part in parts]),
    )


@dataclass(frozen=True, eq=False)
class SpeedLaw:
    """x = sigma_dot^2 as a piecewise cubic.

    ``sigma``, ``x``, ``a``, ``c`` at the knots, in the path's own units; equal neighbours in sigma are a double knot.
    """

    sigma: FloatArray
    x: FloatArray
    a: FloatArray
    c: FloatArray

    def at(self, sigma: FloatArray) -> FloatArray:
        """Evaluate x at any sigma."""
        i = np.clip(np.searchsorted(self.sigma, sigma, side="right") - 1, 0, self.sigma.size - 2)
        h = self.sigma[i + 1] - self.sigma[i]
        i = np.where(h > 0.0, i, i - 1)
        h = self.sigma[i + 1] - self.sigma[i]
        w = sigma - self.sigma[i]
        slope = (self.c[i + 1] - self.c[i]) / h
        return self.x[i] + w * (2.0 * self.a[i] + w * (self.c[i] + w * slope / 3.0))

    def nodes(self, path: Parameter) -> TimeNodes:
        """Nodes at knots and midpoints; ``path`` holds the same points."""
        h = np.diff(self.sigma)
        # A midpoint is where it rounds to: far from the origin and next to a stop that is not the middle.
        first = 0.5 * (self.sigma[:-1] + self.sigma[1:]) - self.sigma[:-1]
        halves = np.stack([first, h - first], axis=1)
        slope = np.diff(self.c) / np.where(h > 0.0, h, 1.0)
        x, a, c = np.empty((3, path.u.shape[1]))
        x[0::2], a[0::2], c[0::2] = self.x, self.a, self.c
        x[1::2] = self.x[:-1] + first * (2.0 * self.a[:-1] + first * (self.c[:-1] + first * slope / 3.0))
        np.maximum(x[1::2], _DEEPEST_DIP * np.minimum(self.x[:-1], self.x[1:]), out=x[1::2])
        a[1::2] = self.a[:-1] + first * (self.c[:-1] + 0.5 * first * slope)
        c[1::2] = self.c[:-1] + first * slope
        dt = np.empty(2 * h.size)
        gauss, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        for half in (0, 1):
            w = half * first[:, None] + halves[:, [half]] * (0.5 * (gauss + 1.0))
            inner = self.x[:-1, None] + w * (
                2.0 * self.a[:-1, None] + w * (self.c[:-1, None] + w * slope[:, None] / 3.0)
            )
            # A cubic may dip below 0 between collocation points of a coarse grid; it is slow there, not undefined, and the
            # excess that the quintic shows makes the grid finer.
            np.maximum(inner, _DEEPEST_DIP * np.minimum(self.x[:-1], self.x[1:])[:, None], out=inner)
            dt[half::2] = 0.5 * halves[:, half] * np.einsum("ij,j->i", 1.0 / np.sqrt(inner), weights)
        u, u1, u2, u3 = path.u
        rate, acceleration = u1 * np.sqrt(x), u2 * x + u1 * a
        # Where rounding moved u, the node is the moment at which the law has the rounded u.
        off = np.flatnonzero((path.rounding != 0.0) & (rate > 0.0))
        later, moved = np.zeros(x.size), path.rounding
        third = (u3[off] * x[off] + 3.0 * u2[off] * a[off] + u1[off] * c[off]) * np.sqrt(x[off])
        later[off] = _until(moved[off], rate[off], acceleration[off])
        rate[off] += later[off] * (acceleration[off] + 0.5 * later[off] * third)
        acceleration[off] += later[off] * third
        # u is exact at the ends of stretches and taken as it is next to a stop; elsewhere its digits are those of a solve.
        exact = moved != 0.0
        exact[0::2] |= np.append(h == 0.0, True) | np.append(True, h == 0.0)
        advance, u = _in_step(u, _advance(halves.reshape(-1), path.u) + np.diff(moved), exact, dt)
        dt += np.diff(later)
        keep = np.append(True, np.repeat(h, 2) > 0.0)
        keep[2::2] = True  # the midpoint of an empty interval is no node of its own
        inner = keep[1:]
        t = np.concatenate([[0.0], np.cumsum(dt[inner])])
        nodes = TimeNodes(t, u[keep], rate[keep], acceleration[keep], np.stack([dt, advance])[:, inner])
        nodes._keep_forward_at_stops()
        return nodes


def _until(distance: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Time in which u goes on by a distance of some digits; to second order, since these may be much next to a stop."""
    square = rate**2 + 2.0 * acceleration * distance
    return np.where(square > 0.0, 2.0 * distance / (rate + np.sqrt(np.maximum(square, 0.0))), distance / rate)


def _advance(h: FloatArray, u: FloatArray) -> FloatArray:
    """Difference of u from point to point, from u and its derivatives (4, p) there: its integral where the digits end.

    By Hermite's formula, h/2 (u' + u'+) + h^2/10 (u'' - u''+) + h^3/120 (u+), exact for u' of degree 5; where that
    is further from the difference than rounding is, the intervals are long and the difference is the better one.
    """
    plain, digit = np.diff(u[0]), np.finfo(float).eps * float(np.abs(u[0]).max())
    integral = h * (
        0.5 * (u[1, 1:] + u[1, :-1]) + h * (0.1 * (u[2, :-1] - u[2, 1:]) + h / 120.0 * (u[3, 1:] + u[3, :-1]))
    )
    return np.where(np.abs(integral - plain) <= _DIGITS * digit, integral, plain)


def _in_step(
    u: FloatArray, advance: FloatArray, exact: NDArray[np.bool_], dt: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Make u (p,) and its steps (p - 1,) agree to a digit of u; returns the steps and u.

    The steps are summed up from one exact point to the next.  What is left over there beyond half a digit is spread over
    them by their length and the square of the times ``dt (p - 1,)`` they take, since 60 e |C'| / dt^3 is the jerk of an
    error e; half a digit is not, since over two nodes a microsecond apart it would be a jerk beyond any limit.
    """
    from planner.kernels import follow

    total = np.cumsum(np.concatenate([u[:1], advance]))
    # What each addition rounded off, exactly (Knuth's TwoSum); together with it the sums are good to half a digit.
    added = np.diff(total)
    lost = np.concatenate([[0.0], np.cumsum((total[:-1] - (total[1:] - added)) + (advance - added))])
    at = np.flatnonzero(exact)
    left_over = np.empty(at.size)
    follow((u[at] - total[at]) - lost[at], 0.5 * np.finfo(float).eps * np.abs(u[at]), left_over)
    share = np.abs(advance) * (dt / dt.max()) ** 2
    share[~(share > 0.0)] = share.mean()  # empty intervals lie between exact points
    over = np.concatenate([[0.0], np.cumsum(share)])
    spread = np.interp(over, over[at], left_over)
    out = total + (lost + spread)
    out[at] = u[at]
    return advance + np.diff(spread), out


@dataclass(frozen=True, eq=False)
class Utilisation:
    """Largest share of the limits used in each interval between nodes.

    ``speed`` (feed, chord, axis velocities), ``acceleration``, ``jerk``: (n - 1,) arrays, 0 for empty intervals.  Beside
    a curvature jump the share of the jerk is that of what the step leaves of it.  ``backward``: rate at which u falls back,
    1/s, where the law changes too much within an interval for a quintic.
    """

    speed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    backward: FloatArray

    @property
    def slowdown(self) -> FloatArray:
        """By how much each interval must slow down to keep its limits: max(V, A^(1/2), J^(1/3))."""
        return np.maximum(self.speed, np.maximum(np.sqrt(self.acceleration), np.cbrt(self.jerk)))

    def spread(self, parts: NDArray[np.intp]) -> Utilisation:
        """The same for ``parts`` equal shares of each interval."""
        rows = (self.speed, self.acceleration, self.jerk, self.backward)
        return Utilisation(*(np.repeat(row, parts) for row in rows))


def utilisation(curve: Curve, limits: Limits, nodes: TimeNodes) -> Utilisation:
    """Measure a time law densely between its nodes, in chunks."""
    out = np.zeros((4, nodes.t.size - 1))
    step = np.diff(nodes.t)
    last = np.append(np.flatnonzero(step <= 0.0), nodes.t.size - 1)
    end = np.repeat(nodes.u[last], np.diff(last, prepend=-1))
    full = np.flatnonzero(step > 0.0)
    points = _points(curve, nodes, step)
    for lo in range(0, full.size, _CHUNK):
        index = full[lo : lo + _CHUNK]
        out[:, index] = _chunk(curve, limits, nodes, index, end[index], points[index])
    out[2, _beside_steps(curve, limits, nodes)] /= JERK_BESIDE_STEP
    return Utilisation(*out)


def _points(curve: Curve, nodes: TimeNodes, step: FloatArray) -> NDArray[np.intp]:
    """At how many points to look at each interval: by its share of the time of its stretch between breaks."""
    breaks = np.searchsorted(nodes.u, curve._candidate_breaks(), side="right") - 1
    starts = np.unique(np.concatenate([[0], np.clip(breaks, 0, step.size - 1)]))
    time = np.repeat(np.add.reduceat(step, starts), np.diff(starts, append=step.size))
    share = np.divide(step, time, out=np.ones_like(step), where=time > 0.0)
    return np.clip(np.ceil(_POINTS_PER_STRETCH * share), _POINTS_PER_INTERVAL, _POINTS_PER_STRETCH).astype(np.intp)


def _beside_steps(curve: Curve, limits: Limits, nodes: TimeNodes) -> NDArray[np.bool_]:
    """Intervals within three periods of a curvature jump, where half of the jerk is the step's."""
    jumps = [b.u for b in curve.breaks if b.geometric == 1 and nodes.u[0] < b.u < nodes.u[-1]]
    at, reach = nodes.t[np.searchsorted(nodes.u, jumps)], PERIODS_AROUND_STEP * limits.period
    first = np.maximum(np.searchsorted(nodes.t, at - reach, side="right") - 1, 0)
    last = np.searchsorted(nodes.t[:-1], at + reach)
    edges = np.bincount(first, minlength=nodes.t.size) - np.bincount(last, minlength=nodes.t.size)
    return np.asarray(np.cumsum(edges)[:-1] > 0)


def _chunk(
    curve: Curve, limits: Limits, nodes: TimeNodes, index: NDArray[np.intp], end: FloatArray, points: NDArray[np.intp]
) -> FloatArray:
    """Largest shares of the limits used in the intervals ``index``, and backward rates, (4, n), at so many points each."""
    from planner.kernels import shares

    if nodes.steps is None:
        h, advance = nodes.t[index + 1] - nodes.t[index], nodes.u[index + 1] - nodes.u[index]
        digit = np.finfo(float).eps * (np.abs(nodes.u[index + 1]) + np.abs(nodes.u_rate[index]) * nodes.t[index + 1])
    else:
        (h, advance), digit = nodes.steps[:, index], np.zeros(index.size)
    quintic = quintic_coefficients(
        h,
        (np.zeros(index.size), nodes.u_rate[index], nodes.u_acceleration[index]),
        (advance, nodes.u_rate[index + 1], nodes.u_acceleration[index + 1]),
    )
    quintic[0] = nodes.u[index]
    feed = commanded_feed(curve, limits, 0.5 * (nodes.u[index] + nodes.u[index + 1]))  # steps only at nodes
    spans = np.stack([h, nodes.u[index], nodes.u[index + 1], end, digit, feed, points])
    rows = np.stack([limits.velocity, limits.acceleration, limits.jerk])
    scalars = np.array([limits.chord_error, limits.period, limits.tangential_acceleration, limits.tangential_jerk])
    out = np.empty((4, index.size))
    axes, tip = (
        (part.breaks, part.coefficients, part.rational, part.resting, part.origin)
        for part in (curve.pieces, curve.tip.pieces)
    )
    shares(axes, tip, curve.tip is curve, quintic, spans, rows, scalars, out)
    return out
