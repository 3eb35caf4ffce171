"""Curves, limits and options that the tests of the greedy algorithms share."""

from __future__ import annotations

import numpy as np

from interp.literature.greedy_published import PUBLISHED_COUNTS
from planner import load_curve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits

NAMES = tuple(PUBLISHED_COUNTS)


# What the published program makes of them; of the print, 9204 has two digits swapped.
MADE = {
    "teardrop": (5096, 9294, 7599, 7345),
    "hypotrochoid": (3443, 9545, 7347, 7345),
    "snailshell": (706, 14601, 7351, 7345),
    "butterfly": (1800, 10875, 7348, 7345),
}


REPAIRED = {"error_curve": "own", "taylor": "exact", "second_derivatives": "exact"}


CURVES = {name: load_curve(name) for name in NAMES}


def limits(feed=20.0, chord_error=1e-6, period=1e-3, **changes):
    rows = {"velocity": [30.0] * 2, "acceleration": [30.0] * 2, "jerk": [200.0] * 2} | changes
    return Limits(feed, chord_error=chord_error, period=period, **rows)


CUSP = NurbsCurve(
    [[0, 0], [100, 100], [0, 100], [100, 0]], [0, 0, 0, 0, 1, 1, 1, 1], 3, name="cusp", rests_allowed=True
)


REST = NurbsCurve([[0, 0], [0, 0], [50, 100], [100, 0]], [0, 0, 0, 0, 1, 1, 1, 1], 3, name="rest", rests_allowed=True)


def greedy_limit(curve, u, safety=0.18):
    """Limits 2 and 4 for 30 mm/s and 30 mm/s^2, from the directions alone."""
    _, first, _ = curve.derivatives(u, 2)
    tangent = np.abs(first / np.linalg.norm(first, axis=-1)[:, None])
    largest = tangent.max(axis=-1)
    return np.minimum(30.0 / largest, np.sqrt(safety * 30.0 / curve.curvature(u) / largest))
