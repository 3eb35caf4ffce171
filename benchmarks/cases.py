"""The reference cases: curves, the mill's limits, and the shortest times that are known for them.

Three independent solvers agree on the optima within 1e-4; those without a jerk limit are toppra's, on fine grids.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planner import Curve, Limits, load_curve, load_limits
from planner.geometry.nurbs import NurbsCurve

FEEDS = (100.0, 300.0)  # mm/s


@dataclass(frozen=True)
class Optimum:
    """Shortest times of a curve on the mill, s: one for each of ``FEEDS``."""

    with_jerk: tuple[float, float]
    without_jerk: tuple[float, float]


OPTIMA = {  # by curve and scale
    ("teardrop", 1.0): Optimum((1.1402, 0.9040), (1.0903, 0.8506)),
    ("butterfly", 10.0): Optimum((4.1574, 3.3027), (4.0856, 3.2169)),
    ("hypotrochoid", 10.0): Optimum((7.1202, 3.6401), (7.0615, 3.5830)),
    ("snailshell", 10.0): Optimum((1.8027, 1.5875), (1.7260, 1.5099)),
    ("circle", 1.0): Optimum((3.2916, 1.6479), (3.2414, 1.5973)),
}
# The same with a jerk limit to more digits: plans on 16 000 intervals, of 28 November 2026.  Their proven gaps are 3e-6 to
# 1.1e-5 (``certify`` on 4000 intervals); those on 8000 are at most 6.8e-6 longer.
CONVERGED = {
    ("teardrop", 1.0): (1.1401740, 0.9039787),
    ("butterfly", 10.0): (4.1574277, 3.3026629),
    ("hypotrochoid", 10.0): (7.1201934, 3.6400684),
    ("snailshell", 10.0): (1.8026832, 1.5875183),
    ("circle", 1.0): (3.2916035, 1.6478626),
}
# The butterfly as NURBS has a radius of 23 um; its axes have no velocity limit.
BUTTERFLY_NURBS_LIMITS = Limits(250.0, [np.inf] * 2, [2000.0] * 2, [20000.0] * 2)
BUTTERFLY_NURBS_OPTIMUM = 4.5603  # s
FLANK_OPTIMUM = 8.0309  # s, on the five-axis machine


def mill(feed: float = 100.0, dim: int = 2, **changes: Any) -> Limits:
    """Limits of the machine "mill" on ``dim`` axes, some of them changed; a scalar stands for every axis."""
    rows = {"velocity": 250.0, "acceleration": 1000.0, "jerk": 20000.0}
    axes = {name: np.broadcast_to(np.asarray(changes.pop(name, row), dtype=float), dim) for name, row in rows.items()}
    return Limits(feed, **axes, **({"chord_error": 1e-3} | changes))


def drives(feed: float = 100.0, dim: int = 2, **changes: Any) -> Limits:
    """Limits of the mill's feed and drives, as :func:`mill`, without a chord error."""
    return mill(feed, dim, **({"chord_error": np.inf} | changes))


def bump(nanometres: float) -> NurbsCurve:
    """Two straight runs of 20 mm with a bump of the given height and width between them."""
    height = 1e-6 * nanometres
    run = np.concatenate([[20.0, 10.0, 5.0], 2.5 * 0.3 ** np.arange(14)])
    run = run[run > 3.0 * height]
    x = np.concatenate([-run, height * np.arange(-2.0, 3.0), run[::-1]])
    points = np.stack([x, np.where(np.abs(x) < 0.5 * height, height, 0.0)], axis=1)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    knots = np.concatenate([[s[0]] * 4, np.convolve(s, np.ones(3) / 3.0, "valid")[1:-1], [s[-1]] * 4])
    return NurbsCurve(points, knots, 3, name=f"bump of {nanometres:g} nm")


def reference_cases() -> list[tuple[str, Curve, Limits, float]]:
    """Label, curve, limits and optimum (s) of the twelve reference cases."""
    found = [
        (f"{name} {feed:g}", load_curve(name, scale=scale), mill(feed), optimum.with_jerk[k])
        for k, feed in enumerate(FEEDS)
        for (name, scale), optimum in OPTIMA.items()
    ]
    found.append(
        ("butterfly-nurbs 250", load_curve("butterfly-nurbs"), BUTTERFLY_NURBS_LIMITS, BUTTERFLY_NURBS_OPTIMUM)
    )
    found.append(("flank", load_curve("flank"), load_limits("five-axis"), FLANK_OPTIMUM))
    return found
