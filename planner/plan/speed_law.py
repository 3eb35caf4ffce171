"""From a solution in sigma to the nodes of a time law.

A solution gives x = sigma_dot^2 as a cubic on every interval.  Its time law has a node at each knot and at points between,

    t' = x^(-1/2) integrated by Gauss,   u_dot = u' x^(1/2),   u_ddot = u'' x + u' a,

with one-sided values at double knots.  Between nodes the law is the quintic of ``law.py``; that quintic, not the
cubic, is what ``utilisation.py`` measures, so what is measured is what will run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.differential import jerk_terms
from planner.law import TimeLaw
from planner.plan.time_knots import TimeGrid
from planner.types import FloatArray, IntArray

_GAUSS_POINTS = 6  # from node to node: the integrand varies little there
_DEEPEST_DIP = 1e-4
_DIGITS = 16.0  # a difference of parameters is known to so many units in their last place


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

    def time_law(self, grid: TimeGrid, counts: IntArray) -> TimeLaw:
        """Nodes at knots, and between: ``counts (m,)`` to each interval that is not empty, evenly."""
        h = np.diff(self.sigma)
        full = np.flatnonzero(h > 0.0)
        slope = np.diff(self.c)[full] / h[full]
        i = np.repeat(np.arange(full.size), counts)
        share = (np.arange(i.size) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[i]
        knot, width = full[i], h[full[i]] / counts[i]
        w = h[knot] * share
        lowest = _DEEPEST_DIP * np.minimum(self.x[knot], self.x[knot + 1])

        def squared(at: FloatArray) -> FloatArray:
            # A cubic may dip below 0 between collocation points of a coarse grid; it is slow there, not undefined, and the
            # excess that the quintic shows makes the grid finer.
            cubic = self.x[knot] + at * (2.0 * self.a[knot] + at * (self.c[knot] + at * slope[i] / 3.0))
            return np.maximum(cubic, lowest)

        dt = np.zeros(i.size)
        for place, weight in zip(*np.polynomial.legendre.leggauss(_GAUSS_POINTS), strict=True):
            dt += 0.5 * weight * width / np.sqrt(squared(w + 0.5 * (place + 1.0) * width))
        x, a, c = squared(w), self.a[knot] + w * (self.c[knot] + 0.5 * w * slope[i]), self.c[knot] + w * slope[i]
        # the last knots of the macros, each after the nodes of the interval before it
        at = np.cumsum(counts)[np.searchsorted(full, grid.left) - 1]
        x, a, c = (np.insert(of, at, knots[grid.left]) for of, knots in ((x, self.x), (a, self.a), (c, self.c)))
        macro = np.insert(grid.macro[knot], at, grid.macro[grid.left])
        sigma = np.insert(self.sigma[knot] + w, at, self.sigma[grid.left])
        dt, width = (np.insert(of, at, 0.0)[:-1] for of in (dt, width))
        distance = grid.distances(sigma, macro)
        u, u1, u2, u3 = path = grid.map.parameter(macro, distance)
        moved = grid.map.rounding(macro, distance, u)
        rate, acceleration = u1 * np.sqrt(x), u2 * x + u1 * a
        # Where rounding moved u, the node is the moment at which the law has the rounded u.
        off = np.flatnonzero((moved != 0.0) & (rate > 0.0))
        later = np.zeros(x.size)
        terms = jerk_terms(u1[off], u2[off], u3[off])
        third = (terms[0] * x[off] + terms[1] * a[off] + terms[2] * c[off]) * np.sqrt(x[off])
        later[off] = _until(moved[off], rate[off], acceleration[off])
        rate[off] += later[off] * (acceleration[off] + 0.5 * later[off] * third)
        acceleration[off] += later[off] * third
        # u is exact at breaks and taken as it is next to a stop; elsewhere its digits are those of a solve.
        exact = moved != 0.0
        ends = at + np.arange(at.size)
        exact[ends[grid.at_breaks]] = True
        exact[np.minimum(ends[grid.at_breaks] + 1, x.size - 1)] = True
        exact[0] = True
        advance, u = _in_step(u, _advance(width, path) + np.diff(moved), exact, dt)
        dt += np.diff(later)
        # between macros that meet within a stretch all is continuous: one node
        once = np.ones(x.size, dtype=np.bool_)
        once[ends[~grid.at_breaks]] = False
        steps = np.stack([dt, advance])[:, once[:-1]]
        t = np.concatenate([[0.0], np.cumsum(steps[0])])
        return TimeLaw(t, u[once], rate[once], acceleration[once], steps).forward_at_stops()


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
    total = np.cumsum(np.concatenate([u[:1], advance]))
    # What each addition rounded off, exactly (Knuth's TwoSum); together with it the sums are good to half a digit.
    added = np.diff(total)
    lost = np.concatenate([[0.0], np.cumsum((total[:-1] - (total[1:] - added)) + (advance - added))])
    at = np.flatnonzero(exact)
    left_over = np.empty(at.size)
    bands = 0.5 * np.finfo(float).eps * np.abs(u[at])
    core.speed_law_follow(at.size, (u[at] - total[at]) - lost[at], bands, left_over)
    share = np.abs(advance) * (dt / dt.max()) ** 2
    share[~(share > 0.0) & (dt > 0.0)] = share.mean()  # an empty interval takes no step
    over = np.concatenate([[0.0], np.cumsum(share)])
    spread = np.interp(over, over[at], left_over)
    out = total + (lost + spread)
    out[at] = u[at]
    return advance + np.diff(spread), out
