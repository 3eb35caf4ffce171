"""Samples where the parameter hardly moves the path, or moves it ever faster: |C'| changes by orders of magnitude there.

Next to a minimum of |C'| the arc length goes like the square of the parameter's distance, and a plan's u over time like
the root of the way.  Knots that are even in either miss that, also on a straight line.  So samples crowd there until
|C'| changes by a factor of at most e^(1/2) from one to the next, and knots by as much as it changes (``knots.py``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from planner.geometry.curve import Curve, golden_minimum
from planner.geometry.differential import dot
from planner.sets import union
from planner.types import FloatArray

_CHANGE = 0.5  # of log |C'| from sample to sample
_SLOW = 0.5  # |C'| against that of the samples after the next: where C' passes near 0 in a line, at most a third
_PASSES = 60  # of the golden section, and of halving
_APART = 64.0  # digits of u, no closer


def resolved(curve: Curve, weights: FloatArray, u: FloatArray) -> FloatArray:
    """Parameters to add to the increasing samples u (n,) of a section, so that they tell how |C'| (weighted) changes."""

    def square(at: FloatArray) -> FloatArray:
        velocity = curve.pieces.evaluate(at, 1, False)[1] * weights
        return dot(velocity, velocity)

    lowest = _minima(square(u))
    if lowest.size:
        slow, _ = golden_minimum(square, u[lowest - 1], u[lowest + 1], _PASSES)
        u = union(u, slow)
    added = [u[:0] if not lowest.size else slow]
    lo, hi = u[:-1], u[1:]
    before, after = np.split(_log(square, np.concatenate([lo, np.nextafter(hi, lo)])), 2)
    for _ in range(_PASSES):
        wide = (np.abs(after - before) > _CHANGE) & (hi - lo > _APART * np.spacing(np.maximum(np.abs(lo), np.abs(hi))))
        if not wide.any():
            break
        lo, hi, before, after = lo[wide], hi[wide], before[wide], after[wide]
        middle = 0.5 * (lo + hi)
        between = _log(square, middle)
        added.append(middle)
        lo, hi = np.concatenate([lo, middle]), np.concatenate([middle, hi])
        before, after = np.concatenate([before, between]), np.concatenate([between, after])
    return np.concatenate(added)


def _minima(square: FloatArray) -> NDArray[np.intp]:
    """Samples, but the ends, at which |C'|^2 has a minimum far below its values around."""
    inner = square[1:-1]
    around = np.pad(square, 1, mode="edge")
    high = np.maximum(around[:-4], around[4:])
    at = (inner <= square[:-2]) & (inner <= square[2:]) & (inner <= _SLOW**2 * high[: inner.size])
    return np.flatnonzero(at) + 1


def _log(square: Callable[[FloatArray], FloatArray], u: FloatArray) -> FloatArray:
    return 0.5 * np.log(np.maximum(square(u), np.finfo(np.float64).tiny))
