"""The path of a lower bound and the integrand of its multipliers, over whole arrays: what the compiled forms agree with."""

from itertools import pairwise

import numpy as np

from planner.geometry.differential import curvature, dot
from planner.machine.feed_limits import chord_feed_limit, commanded_feed
from planner.plan.section import axis_weights
from planner.quantity import ACCELERATION, JERK


def coordinate(track, k, r):
    """Way in u from the left and to the right knot, u' and u'' in the cells k at r, by the quintic."""
    h, slope, s = track.h[k], track._slope(k), 1.0 - r
    u1 = s**4 * slope[0] + 4.0 * r * s**3 * slope[1] + 6.0 * r**2 * s**2 * slope[2]
    u1 += 4.0 * r**3 * s * slope[3] + r**4 * slope[4]
    bend = [4.0 * (b - a) for a, b in pairwise(slope)]
    u2 = s**3 * bend[0] + 3.0 * r * s**2 * bend[1] + 3.0 * r**2 * s * bend[2] + r**3 * bend[3]
    gone, left = np.zeros_like(r), np.zeros_like(r)
    sums, back, binomial = np.zeros_like(r), np.zeros_like(r), (5.0, 10.0, 10.0, 5.0, 1.0)
    for i in range(5):
        sums = sums + slope[i] / 5.0
        back = back + slope[4 - i] / 5.0
        gone += binomial[i] * sums * r ** (i + 1) * s ** (4 - i)
        left += binomial[i] * back * s ** (i + 1) * r ** (4 - i)
    return gone, left, u1 / h, u2 / h**2


def points(track, k, r):
    """Evaluate the path in the cells k at r (both flat), from inside the cells."""
    gone, left, u1, u2 = coordinate(track, k, r)
    first, second, cap = along(track, k, r, gone)
    for end, gone_or_left in ((0, gone), (1, left)):
        v0 = track.known_speeds[end]
        if v0 is None:
            continue
        some = np.flatnonzero(track.near[end, k] | ~np.isfinite(cap))
        cells = k[some]
        # rounding next to an end may leave less than nothing
        way = np.maximum(track.way[end][:, cells + end] + track.rise[:, cells] * gone_or_left[some], 0.0)
        found = reached(track, first[:, some], 1.01 * way, v0, track.ramps[end][:, cells])
        cap[some] = np.minimum(cap[some], found)
    return (first * u1, second * u1**2 + first * u2, cap / u1**2)


def along(track, k, r, gone):
    """Derivatives of the motions over u, and the cap of u_dot^2 by feed, chord error and velocities."""
    curve, limits = track.section.curve, track.limits
    end = track.u[0, k + 1]
    u = np.where(r >= 1.0, end, np.minimum(track.u[0, k] + gone, end))
    left = (u >= end) & (r > 0.0)
    q = curve.pieces.evaluate(u, 2, left)
    tip = q if curve.tip is curve else curve.tip.pieces.evaluate(u, 2, left)
    speed = np.sqrt(dot(tip[1], tip[1]))
    bend = np.divide(dot(tip[1], tip[2]), speed, out=np.zeros_like(speed), where=speed > 0.0)
    feed = commanded_feed(curve, limits, u)
    if curve.feed_caps is not None:  # where it changes within a cell, the larger
        for side in (commanded_feed(curve, limits, track.u[0, k]), commanded_feed(curve, limits, end, True)):
            feed = np.maximum(feed, side)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        cap = np.where(speed > 0.0, np.minimum(feed, chord_feed_limit(curvature(tip), limits)) / speed, np.inf)
        cap = np.fmin(cap, np.fmin.reduce(limits.velocity / np.abs(q[1]), axis=1))
    return np.vstack([q[1].T, speed]), np.vstack([q[2].T, bend]), cap**2


def reached(track, first, way, v0, ramps):
    """Largest u_dot^2 that the motions reach on their ways."""
    limits = track.limits
    # A motion that hardly takes part says little, and rounding could be all there is of its way.
    share = np.abs(first[:-1]) * axis_weights(limits)[:, None]
    first = np.vstack([np.where(share >= 0.05 * share.max(axis=0), first[:-1], 0.0), first[-1:]])
    acceleration = limits.of_motions(ACCELERATION.order)[:, None]
    jerk = limits.of_motions(JERK.order)[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        by_acceleration = (v0[:, None] ** 2 + 2.0 * acceleration * way) / first**2
        by_jerk = np.where(ramps, np.cbrt(1.5 * np.sqrt(2.0 * jerk) * way) ** 4 / first**2, np.inf)
    return np.fmin.reduce(np.fmin(by_acceleration, by_jerk), axis=0)


def min_price(w, g, cap):
    """Smallest w x^(-1/2) + g x over 0 < x <= cap; for g > 0 at x = (w / 2g)^(2/3) where that is below the cap."""
    w = np.maximum(w, 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inside = (g > 0.0) & ((0.5 * w / g) ** 2 < cap**3)
        return np.where(
            inside,
            3.0 * np.cbrt((0.5 * w) ** 2 * np.maximum(g, 0.0)),
            w / np.sqrt(cap) + np.where(g == 0.0, 0.0, g * cap),
        )


def quadratic(a, b, c, r):
    s = 1.0 - r
    return s * s * a + 2.0 * r * s * b + r * r * c


def weight_and_pull(splines, first, second, k, r):
    """Weight 1 - sum |l| of the pace and coefficient g of x at points of the cells k."""
    of, h = splines.of, splines.track.h[k]
    a, b, c = splines.controls[:, :, k]
    l1 = 2.0 * ((1.0 - r) * (b - a) + r * (c - b)) / h
    l2 = 2.0 * (a - 2.0 * b + c) / h**2
    m0, m1 = splines.acceleration[:, k], splines.acceleration[:, k + 1]
    m, dm = m0 + (m1 - m0) * r, (m1 - m0) / h
    g = np.sum((l2 * first[of.jerk] - l1 * second[of.jerk]) / of.most_jerk[:, None], axis=0)
    g += np.sum((m * second[of.acceleration] - dm * first[of.acceleration]) / of.most_acceleration[:, None], axis=0)
    return 1.0 - np.abs(quadratic(a, b, c, r)).sum(axis=0), 0.5 * g
