"""Gauss-Legendre rules.

The points are the roots of the Legendre polynomial P_n, by Newton's method on its three-term recurrence (NIST,
Digital Library of Mathematical Functions, 3.5(v) and 18.9(i)), from Tricomi's guess (18.16(ii)).  numpy's own takes the
eigenvalues of a matrix, and loading what that needs takes longer than many a plan has.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from planner.types import FloatArray

_STEPS = 8  # Newton's method from Tricomi's guess reaches the last digit in three or four


@cache
def gauss_legendre(count: int) -> tuple[FloatArray, FloatArray]:
    """Points in (-1, 1), increasing, and weights of the rule that is exact for polynomials of degree 2 count - 1.

    Both (count,), to the last digits for small counts, and not writable: every caller gets the same.
    """
    x = -np.cos(math.pi * (np.arange(count) + 0.75) / (count + 0.5))
    for _ in range(_STEPS):
        value, slope = _legendre(count, x)
        x = x - value / slope
    x = 0.5 * (x - x[::-1])  # the rule is symmetric, and its middle 0, to the last digit
    _, slope = _legendre(count, x)
    weights = 2.0 / ((1.0 - x**2) * slope**2)
    weights = 0.5 * (weights + weights[::-1])
    for array in (x, weights):
        array.setflags(write=False)
    return x, weights


def _legendre(count: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P_n and its derivative."""
    below, value = np.ones_like(x), x
    for k in range(2, count + 1):
        below, value = value, ((2 * k - 1) * x * value - (k - 1) * below) / k
    return value, count * (below - x * value) / (1.0 - x**2)
