"""Sizes against which values and their rounding are judged."""

from __future__ import annotations

import numpy as np

from planner.geometry.curve import Curve
from planner.types import FloatArray

EPS = float(np.finfo(np.float64).eps)
# Steps of the velocity below this fraction of the largest value are rounding: one-sided derivatives differ in the last
# digits.
VELOCITY_STEP = 1e-9
# Nodes within this fraction of the domain of a knot lie on it, where the next knots are not so close that it is much of the
# way to them: no more than the second fraction of that, but always a few digits.
ON_KNOT, ON_KNOT_OF_GAP = 1e-12, 1e-10
# Accuracy to which an arc length is known, as a fraction of the whole length.
LENGTH_ACCURACY = 1e-14
# A unit step of acceleration, twice integrated, sampled and differenced three times, is a quadratic B-spline of the
# phase: STEP_PEAK over the period at its peak, and none beyond STEP_REACH periods to either side.
STEP_PEAK = 0.75
STEP_REACH = 1.5


def extent(curve: Curve) -> float:
    """Length of the tip's path, mm; 1 mm where only rotary axes move, so that shares of it still mean something."""
    return curve.length or 1.0


def group_sizes(curve: Curve, largest: FloatArray) -> FloatArray:
    """Size against which an axis is judged: the largest of the axes with its unit.

    At least a thousandth of the largest of all, since axes that stand still have nothing but rounding to compare with.
    """
    units = np.array(curve.axis_units)
    group = np.array([largest[units == unit].max() for unit in units])
    return np.asarray(np.maximum(group, 1e-3 * largest.max()))


def position_rounding(curve: Curve, u: FloatArray) -> float:
    """What the last digit of u and of the tip's position are worth, mm."""
    d = curve.tip.derivatives(u, 1)
    return EPS * float((np.abs(d[0]) + 0.5 * np.abs(d[1] * u[:, None])).max(initial=0.0))
