"""What several tests share: where files are, curves, limits and reference optima."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import quad

from benchmarks.cases import BUTTERFLY_NURBS_LIMITS, FEEDS, OPTIMA, bump, drives, mill, reference_cases
from planner import Curve, Limits, check
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve

__all__ = ["BUTTERFLY_NURBS_LIMITS", "FEEDS", "OPTIMA", "bump", "drives", "mill", "reference_cases"]

PROJECT = Path(__file__).resolve().parents[1]
PROGRAMS = PROJECT / "tests" / "data" / "programs"  # part programs, see README.md there
CURVES = PROJECT / "tests" / "data" / "curves"  # curves that once went wrong, see SOURCE.md there


# ---- limits --------------------------------------------------------------------------------------------------------


MILL = mill()
DRIVES = drives()
DRIVES_XYZ = drives(dim=3)


# ---- curves --------------------------------------------------------------------------------------------------------


def line(*end: float) -> NurbsCurve:
    """A line from the origin to a point; a single number is a length along X, beside Y."""
    point = (*end, 0.0) if len(end) == 1 else end
    return NurbsCurve([np.zeros(len(point)), point], [0, 0, 1, 1], 1, name="line")


def square(side: float) -> NurbsCurve:
    """A square with its corners at u = 1, 2, 3."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * side
    return NurbsCurve(corners, [0, 0, 1, 2, 3, 4, 4], 1, name="square")


def line_into_arc() -> NurbsCurve:
    """20 mm along X, then a quarter circle of radius 10 mm: the curvature jumps by 0.1 1/mm."""
    points = [[0, 0], [10, 0], [20, 0], [30, 0], [30, 10]]
    return NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 2], 2, [1, 1, 1, np.sqrt(0.5), 1], name="line into arc")


def line_arc_line() -> NurbsCurve:
    """20 mm along X, a quarter circle of radius 10 mm, 20 mm along Y: the curvature jumps at u = 1 and 2."""
    points = [[-20, 0], [-10, 0], [0, 0], [10, 0], [10, 10], [10, 20], [10, 30]]
    return NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 3, 3, 3], 2, [1, 1, 1, np.sqrt(0.5), 1, 1, 1])


def ellipse(a: float = 30.0, b: float = 10.0) -> FormulaCurve:
    """A whole ellipse of half axes a along X and b along Y; a circle where they are equal."""
    return FormulaCurve({"X": f"{a:g}*cos(u)", "Y": f"{b:g}*sin(u)"}, (0.0, 2.0 * np.pi), name="ellipse")


# ---- closed forms and judgements -----------------------------------------------------------------------------------


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


def velocity_time(a: float, b: float, v_x: float, v_y: float) -> float:
    """Shortest time around an ellipse under velocity limits alone: the integral of the slowest axis' time."""

    def slowest(u: float) -> float:
        return max(a * np.sin(u) / v_x, b * np.cos(u) / v_y)

    turn = np.arctan2(b / v_y, a / v_x)  # from here on X is the slower one
    return float(4.0 * quad(slowest, 0.0, 0.5 * np.pi, points=[turn], epsabs=1e-12)[0])


def worst(curve: Curve, limits: Limits, profile: object) -> float:
    """Largest share of a limit that a plan or samples use; all of them must be kept."""
    report = check(curve, limits, profile)  # type: ignore[arg-type]
    assert report.ok, str(report)
    return max(row.ratio for row in report.rows if np.isfinite(row.ratio))
