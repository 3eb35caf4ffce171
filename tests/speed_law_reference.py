"""The nodes of a time law by array arithmetic, as ``speed_law.c`` makes them one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.geometry.differential import jerk_terms
from planner.law import TimeLaw, quintic_coefficients
from planner.plan.ends import Rest
from planner.plan.speed_law import SpeedLaw
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap
from planner.types import FloatArray, IntArray

_GAUSS_POINTS = 6
_DEEPEST_DIP = 1e-4
_DIGITS = 16.0


def follow(n: int, values: FloatArray, bands: FloatArray, out: FloatArray) -> None:
    """Follow the values (n) as lazily as the bands (n) around them allow, from 0 on."""
    last = 0.0
    for i in range(n):
        last = min(max(last, values[i] - bands[i]), values[i] + bands[i])
        out[i] = last


def time_law(law: SpeedLaw, grid: TimeGrid, counts: IntArray) -> TimeLaw:
    """Nodes at knots, and between: ``counts (m,)`` to each interval that is not empty, evenly."""
    h = np.diff(law.sigma)
    full = np.flatnonzero(h > 0.0)
    slope = np.diff(law.c)[full] / h[full]
    i = np.repeat(np.arange(full.size), counts)
    share = (np.arange(i.size) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[i]
    knot, width = full[i], h[full[i]] / counts[i]
    w = h[knot] * share
    lowest = _DEEPEST_DIP * np.minimum(law.x[knot], law.x[knot + 1])

    def squared(at: FloatArray) -> FloatArray:
        # A cubic may dip below 0 between collocation points of a coarse grid; it is slow there, not undefined, and the
        # excess that the quintic shows makes the grid finer.
        cubic = law.x[knot] + at * (2.0 * law.a[knot] + at * (law.c[knot] + at * slope[i] / 3.0))
        return np.maximum(cubic, lowest)

    dt = np.zeros(i.size)
    for place, weight in zip(*np.polynomial.legendre.leggauss(_GAUSS_POINTS), strict=True):
        dt += 0.5 * weight * width / np.sqrt(squared(w + 0.5 * (place + 1.0) * width))
    x, a, c = squared(w), law.a[knot] + w * (law.c[knot] + 0.5 * w * slope[i]), law.c[knot] + w * slope[i]
    # the last knots of the macros, each after the nodes of the interval before it
    at = np.cumsum(counts)[np.searchsorted(full, grid.left) - 1]
    x, a, c = (np.insert(of, at, knots[grid.left]) for of, knots in ((x, law.x), (a, law.a), (c, law.c)))
    macro = np.insert(grid.macro[knot], at, grid.macro[grid.left])
    sigma = np.insert(law.sigma[knot] + w, at, law.sigma[grid.left])
    dt, width = (np.insert(of, at, 0.0)[:-1] for of in (dt, width))
    distance = grid.distances(sigma, macro)
    u, u1, u2, u3 = path = grid.map.parameter(macro, distance)
    moved = rounding(grid.map, macro, distance, u)
    rate, acceleration = u1 * np.sqrt(x), u2 * x + u1 * a
    # Where rounding moved u, the node is the moment at which the law has the rounded u.
    off = np.flatnonzero((moved != 0.0) & (rate > 0.0))
    later = np.zeros(x.size)
    terms = jerk_terms(u1[off], u2[off], u3[off])
    third = (terms[0] * x[off] + terms[1] * a[off] + terms[2] * c[off]) * np.sqrt(x[off])
    later[off] = until(moved[off], rate[off], acceleration[off])
    rate[off] += later[off] * (acceleration[off] + 0.5 * later[off] * third)
    acceleration[off] += later[off] * third
    # u is exact at breaks and taken as it is next to a stop; elsewhere its digits are those of a solve.
    exact = moved != 0.0
    ends = at + np.arange(at.size)
    exact[ends[grid.at_breaks]] = True
    exact[np.minimum(ends[grid.at_breaks] + 1, x.size - 1)] = True
    exact[0] = True
    advance, u = in_step(u, advance_between(width, path) + np.diff(moved), exact, dt)
    dt += np.diff(later)
    # between macros that meet within a stretch all is continuous: one node
    once = np.ones(x.size, dtype=np.bool_)
    once[ends[~grid.at_breaks]] = False
    steps = np.stack([dt, advance])[:, once[:-1]]
    t = np.concatenate([[0.0], np.cumsum(steps[0])])
    return TimeLaw(t, u[once], rate[once], acceleration[once], steps).forward_at_stops()


def rounding(on: TimeMap, macro: NDArray[np.intp], d: FloatArray, u: FloatArray) -> FloatArray:
    """By how much rounding moved u (n,) next to a stop, where the quintic tells the distance from it in full; else 0.

    A path that ends at u = 1 has no parameters closer to its end than 1e-16, and a plan goes there.
    """
    out = np.zeros_like(u)
    section, h = on.section, np.diff(on.sigma)
    digits = (
        _DIGITS * np.finfo(float).eps * max(abs(section.u_start), abs(section.u_end), section.u_end - section.u_start)
    )
    if isinstance(section.start, Rest) and on.piece[0] < 0:
        place = np.flatnonzero((macro == 0) & (d > 0.0) & (d < h[0]))
        c, w = on.powers[:, 0], d[place]
        meant = w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))))
        out[place] = (u[place] - section.u_start) - meant
    if isinstance(section.end, Rest) and on.piece[-1] < 0:
        place = np.flatnonzero((macro == h.size - 1) & (d > 0.0) & (d < h[-1]))
        ends = [on.native(np.array([h.size - 1]), np.array([x])) for x in (h[-1], 0.0)]
        way = on.u[-1:] - on.u[-2:-1]
        c = quintic_coefficients(h[-1:], (0.0 * way, ends[0][1], -ends[0][2]), (way, ends[1][1], -ends[1][2]))[:, 0]
        w = h[-1] - d[place]
        meant = w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))))
        out[place] = (u[place] - section.u_end) + meant
    return np.where(np.abs(out) <= digits, out, 0.0)


def until(distance: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Time in which u goes on by a distance of some digits; to second order, since these may be much next to a stop."""
    square = rate**2 + 2.0 * acceleration * distance
    return np.where(square > 0.0, 2.0 * distance / (rate + np.sqrt(np.maximum(square, 0.0))), distance / rate)


def advance_between(h: FloatArray, u: FloatArray) -> FloatArray:
    """Difference of u from point to point, from u and its derivatives (4, p) there: its integral where the digits end.

    By Hermite's formula, h/2 (u' + u'+) + h^2/10 (u'' - u''+) + h^3/120 (u+), exact for u' of degree 5; where that
    is further from the difference than rounding is, the intervals are long and the difference is the better one.
    """
    plain, digit = np.diff(u[0]), np.finfo(float).eps * float(np.abs(u[0]).max())
    integral = h * (
        0.5 * (u[1, 1:] + u[1, :-1]) + h * (0.1 * (u[2, :-1] - u[2, 1:]) + h / 120.0 * (u[3, 1:] + u[3, :-1]))
    )
    return np.where(np.abs(integral - plain) <= _DIGITS * digit, integral, plain)


def in_step(
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
    follow(at.size, (u[at] - total[at]) - lost[at], bands, left_over)
    share = np.abs(advance) * (dt / dt.max()) ** 2
    share[~(share > 0.0) & (dt > 0.0)] = share.mean()  # an empty interval takes no step
    over = np.concatenate([[0.0], np.cumsum(share)])
    spread = np.interp(over, over[at], left_over)
    out = total + (lost + spread)
    out[at] = u[at]
    return advance + np.diff(spread), out
