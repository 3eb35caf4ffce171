"""Reference optima, limits and paths that several tests of plans share."""

from __future__ import annotations

import numpy as np

from planner import Curve, Limits, check
from planner.geometry.nurbs import NurbsCurve

# s at 100 and 300 mm/s: three independent solvers agree within 1e-4; without jerk limit by toppra
OPTIMA = {
    ("teardrop", 1.0): ((1.1402, 0.9040), (1.0903, 0.8506)),
    ("butterfly", 10.0): ((4.1574, 3.3027), (4.0856, 3.2169)),
    ("hypotrochoid", 10.0): ((7.1202, 3.6401), (7.0615, 3.5830)),
    ("snailshell", 10.0): ((1.8027, 1.5875), (1.7260, 1.5099)),
    ("circle", 1.0): ((3.2916, 1.6479), (3.2414, 1.5973)),
}


def plane(feed: float = 100.0, **changes: object) -> Limits:
    values = {"velocity": [250.0] * 2, "acceleration": [1000.0] * 2, "jerk": [20000.0] * 2, "chord_error": 1e-3}
    return Limits(feed, **(values | changes))  # type: ignore[arg-type]


def line(length: float) -> Curve:
    return NurbsCurve([[0.0, 0.0], [length, 0.0]], [0.0, 0.0, 1.0, 1.0], 1, name="line")


def square(side: float) -> Curve:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * side
    return NurbsCurve(corners, [0, 0, 1, 2, 3, 4, 4], 1, name="square")


def line_into_arc() -> Curve:
    """20 mm along X, then a quarter circle of radius 10 mm: the curvature jumps by 0.1 1/mm."""
    points = [[0, 0], [10, 0], [20, 0], [30, 0], [30, 10]]
    return NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 2], 2, [1, 1, 1, np.sqrt(0.5), 1], name="line into arc")


def s_curve_time(length: float, v: float, a: float, j: float) -> float:
    """Shortest rest-to-rest time over a length under velocity, acceleration and jerk limits."""
    if v * j >= a * a:
        ramp, ramp_length = v / a + a / j, 0.5 * v * (v / a + a / j)
    else:
        ramp, ramp_length = 2.0 * np.sqrt(v / j), v * np.sqrt(v / j)
    if length >= 2.0 * ramp_length:
        return float(2.0 * ramp + (length - 2.0 * ramp_length) / v)
    if length <= 2.0 * a**3 / j**2:
        return float(np.cbrt(32.0 * length / j))
    peak = 0.5 * (-(a * a) / j + np.sqrt((a * a / j) ** 2 + 4.0 * a * length))
    return float(2.0 * (peak / a + a / j))


def worst(curve: Curve, limits: Limits, profile: object) -> float:
    report = check(curve, limits, profile)  # type: ignore[arg-type]
    assert report.ok, str(report)
    return max(row.ratio for row in report.rows if np.isfinite(row.ratio))
