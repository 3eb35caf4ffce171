"""The thesis of 2022 as printed: its numbers of points, their misprints, and the defects of the program behind them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from planner.geometry.catalog import read_curve
from planner.geometry.curve import Curve
from planner.machine.limits import Limits

PUBLISHED_COUNTS: Mapping[str, tuple[int, int, int, int]] = {
    "teardrop": (5096, 9204, 7599, 7344),
    "hypotrochoid": (3443, 9545, 7347, 7344),
    "snailshell": (706, 14601, 7351, 7346),
    "butterfly": (1800, 10875, 7348, 7345),
}
"""Numbers of points as printed, Algorithms 1 to 4, for the limits of :data:`PUBLISHED_LIMITS`."""

PUBLISHED_LIMITS = {"feed": 20.0, "velocity": 30.0, "acceleration": 30.0, "jerk": 200.0, "chord_error": 1e-6}
"""mm/s, mm/s, mm/s^2, mm/s^3, mm; the period is 1 ms.  The jerk is printed in mm/s^2."""

_MISPRINT = (
    "printed 9204 with a difference to Algorithm 3 of 1805; the program makes 9294 points (two digits swapped), and "
    "1805 fits neither 9204 - 7599 = 1605, of which the printed 17 % is made, nor 9294 - 7599 = 1695"
)
_REMARKS = {
    1: "printed with the start point counted",
    4: "the print is within 2 of the loop, whose last push-up decides",
}

# Each defect of the published program: the argument, its value in the program, and repaired.
DEFECTS: Mapping[str, tuple[str, str, str]] = {
    "chord error on the wrong curve": ("error_curve", "teardrop", "own"),
    "command feedrate in the step": ("step_feed", "command", "planned"),
    "wrong Taylor term": ("taylor", "published", "exact"),
    "wrong second derivatives": ("second_derivatives", "published", "exact"),
}

# Of the size of a curve: so near to it lies a copy.
SAME_CURVE = 1e-9
_COMPARED_POINTS = 33


@cache
def _catalog_curve(name: str) -> Curve:
    return read_curve(name)


def scale_of(curve: Curve, name: str) -> float:
    """Factor by which the curve is a scaled copy of a catalog curve, point by point; 0 where it is none."""
    model = _catalog_curve(name)
    if curve.dim != model.dim:
        return 0.0
    share = np.linspace(0.0, 1.0, _COMPARED_POINTS)[1:-1]
    points, expected = (c.derivatives(c.domain[0] + share * (c.domain[1] - c.domain[0]), 0)[0] for c in (curve, model))
    scale = float(np.sum(points * expected) / np.sum(expected**2))
    same = scale > 0.0 and np.abs(points - scale * expected).max() <= SAME_CURVE * np.abs(points).max()
    return scale if same else 0.0


def printed_count(curve: Curve, limits: Limits, algorithm: int) -> tuple[int | None, str]:
    """The printed number of points of a curve under these limits, and what to know about it; None where there is none."""
    given = (limits.feed, limits.chord_error, limits.period)
    if given != (PUBLISHED_LIMITS["feed"], PUBLISHED_LIMITS["chord_error"], 1e-3):
        return None, ""
    for name, counts in PUBLISHED_COUNTS.items():
        if abs(scale_of(curve, name) - 1.0) <= SAME_CURVE:
            remark = _MISPRINT if (name, algorithm) in {("teardrop", 2), ("teardrop", 3)} else ""
            return counts[algorithm - 1], remark or _REMARKS.get(algorithm, "")
    return None, ""
