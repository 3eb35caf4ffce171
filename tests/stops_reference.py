"""The sharpest bends of a curve by numpy's arrays: the compiled search has the same bits on planar paths."""

import numpy as np

from planner.geometry.curve import golden_minimum
from planner.geometry.differential import curvature, dot
from planner.plan.stops import _unresolved

_SAMPLES, _PASSES, _NEAR, _SLOW, _WORTH_REFINING = 16, 48, 1e-3, 0.5, 0.1


def candidates(d, radius):
    """Samples next to which the curvature may reach 1 / radius, from the derivatives (3, n, dim) there.

    By the second derivative C' runs along a straight line, which comes as close to 0 as |n|, n its part across C''; there
    the curvature is |C''| / |n|^2.
    """
    bend, speed = curvature(d), np.sqrt(dot(d[1], d[1]))
    around = np.pad(bend, 1, constant_values=-np.inf)
    peak = (bend >= around[:-2]) & (bend >= around[2:]) & (bend * radius > _WORTH_REFINING)
    slower = np.pad(speed, 2, mode="edge")
    least = (speed <= slower[1:-3]) & (speed <= slower[3:-1]) & (speed <= _SLOW * np.maximum(slower[:-4], slower[4:]))
    second = dot(d[2], d[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        across = d[1] - (dot(d[1], d[2]) / second)[:, None] * d[2]
        least &= np.sqrt(second) * radius > _WORTH_REFINING * dot(across, across)
    return np.flatnonzero(peak | least)


def sharpest(curve, weights, radius):
    """Places and curvatures of the bends next to samples that may be tight."""
    edges = curve.pieces.breaks

    def weighted(u):
        d = curve.pieces.evaluate(u, 2, False)
        d[1:] *= weights
        return d

    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    u = (edges[:-1, None] + np.diff(edges)[:, None] * share).reshape(-1)
    local = np.maximum(radius, _unresolved(curve, weights, u))
    at = candidates(weighted(u), local)
    lo = np.where(at > 0, u[np.maximum(at - 1, 0)], edges[0])
    hi = np.where(at < u.size - 1, u[np.minimum(at + 1, u.size - 1)], edges[-1])
    slow, least = golden_minimum(lambda x: dot(*[weighted(x)[1]] * 2), lo, hi, _PASSES)
    reach = np.minimum(hi - lo, 4.0 * np.sqrt(least) * local[at] + _NEAR * (hi - lo))
    ends = ((np.maximum(slow - reach, lo), lo), (np.minimum(slow + reach, hi), hi))
    a, b = (np.concatenate(end) for end in ends)
    top, negative = golden_minimum(lambda x: -curvature(weighted(x)), a, b, _PASSES)
    return top, -negative
