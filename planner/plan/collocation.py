"""The points of an interval at which limits are kept, and the weights by which they make up the time.

x is a cubic on an interval of length h: with a = x'/2 and c = x''/2 at its ends, at the share t of it

    x_t = x + 2 t h a + h^2 (t^2 - t^3/3) c + h^2 t^3/3 c+
    a_t = a + h (t - t^2/2) c + h t^2/2 c+
    c_t = (1 - t) c + t c+.

``inner`` points stand inside an interval, at k / (inner + 1): the midpoint (Simpson's rule for the time), or the three
quarters (Boole's).  Points are in the order of the path, knot, inner ones, knot, ...: (inner + 1)(n - 1) + 1 for n knots.
"""

from __future__ import annotations

import numpy as np

from planner.types import FloatArray

# weights of a closed Newton-Cotes rule on an interval of length 1: start, inner points, end
_RULES = {1: np.array([1.0, 4.0, 1.0]) / 6.0, 3: np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0}


def inner_shares(inner: int) -> FloatArray:
    """Where the inner points are, as shares of their interval, (inner,)."""
    return np.arange(1, inner + 1) / (inner + 1)


def points_of(knots: FloatArray, inner: int) -> FloatArray:
    """All points, (p,), of increasing knots (n,); those of a knot are exact."""
    points = np.empty((inner + 1) * (knots.size - 1) + 1)
    points[:: inner + 1] = knots
    for k, share in enumerate(inner_shares(inner), start=1):
        points[k :: inner + 1] = (1.0 - share) * knots[:-1] + share * knots[1:]
    return points


def time_weights(h: FloatArray, inner: int) -> FloatArray:
    """Weights (p,) of x^(-1/2) in the time over intervals of lengths h (n - 1,)."""
    rule = _RULES[inner]
    weights = np.zeros((inner + 1) * h.size + 1)
    for k, weight in enumerate(rule):
        weights[k : weights.size - 1 - inner + k : inner + 1] += weight * h
    return weights


def mean_of(values: FloatArray, inner: int) -> FloatArray:
    """Mean of values at the points (p,) over each interval, (n - 1,)."""
    rule = _RULES[inner]
    last = values.size - 1 - inner
    return np.asarray(sum(weight * values[k : last + k : inner + 1] for k, weight in enumerate(rule)))


def states_between(h: FloatArray, knots: FloatArray, inner: int) -> FloatArray:
    """x, a, c at all points, (3, p), of the cubics with these states (3, n) at their ends."""
    z = np.empty((3, (inner + 1) * h.size + 1))
    z[:, :: inner + 1] = knots
    (x, a, c), after = knots[:, :-1], knots[2, 1:]
    for k, t in enumerate(inner_shares(inner), start=1):
        far = t**3 / 3.0
        z[0, k :: inner + 1] = x + 2.0 * t * h * a + h**2 * ((t**2 - far) * c + far * after)
        z[1, k :: inner + 1] = a + h * ((t - 0.5 * t**2) * c + 0.5 * t**2 * after)
        z[2, k :: inner + 1] = (1.0 - t) * c + t * after
    return z
