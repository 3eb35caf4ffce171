"""What each limit costs: the change of the duration with the limit, from the multipliers of the optimum.

The multiplier l of a constraint g(z) <= 0 is the rate at which the time falls when its bound is relaxed.  Relaxing a limit
by the fraction e moves the scaled bounds of its rows by

    feed, axis velocity   cap (1 + e)^2     2 e        chord error   cap grows with the tolerance      e
    acceleration          1 (1 + e)           e        jerk          x^(-1/2) (1 + e)       e x^(-1/2)

so that the seconds saved by one percent are 0.01 sum(l * bound * power).  They hold for small changes; a limit that stops
binding when it is relaxed saves less than its rate promises.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.constraints import Path, speed_limits
from planner.geometry.curve import dot
from planner.limits import Limits
from planner.solvers.optimal import Iterate

_PERCENT = 0.01


def slowest(limits: Limits, path: Path) -> NDArray[np.int8]:
    """Which of feed, chord error and axis velocities allows the lowest speed at each point, (p,)."""
    return np.argmin(speed_limits(limits, path), axis=0).astype(np.int8)


def saved_by_one_percent(
    iterate: Iterate, which: NDArray[np.int8], limits: Limits, axes: tuple[str, ...]
) -> dict[str, float]:
    """Seconds that one percent more of each limit would save (limits without any effect are left out).

    Parameters
    ----------
    iterate : Iterate
        The optimum of a section.
    which : (p,) int array
        The lowest speed limit at its points, see :func:`slowest`.
    limits : Limits
    axes : tuple of str

    Returns
    -------
    dict
        By the names of ``FeedrateProfile.limit_names``; unit of the problem's time.
    """
    # row by row: a long path has no memory to spare
    pace = iterate.z[0] ** -0.5
    worth = [
        float(dot(dual[0], pace) + dot(dual[1], pace)) if jerk else float(dual.sum())
        for dual, jerk in zip(iterate.dual, iterate.jerk, strict=True)
    ]
    saved: dict[str, float] = {}
    # the speed row is the lowest of several limits at each point
    names = ["feed", "chord error", *(f"velocity {axis}" for axis in axes)]
    power = np.array([2.0, 1.0, *(2.0 for _ in axes)])
    at_points = iterate.dual[0, 0]
    for k, name in enumerate(names):
        saved[name] = float(power[k] * at_points[which == k].sum())
    row = 1
    for kind, values, along in (
        ("acceleration", limits.acceleration, limits.tangential_acceleration),
        ("jerk", limits.jerk, limits.tangential_jerk),
    ):
        for name, value in [
            *((f"{kind} {axis}", values[j]) for j, axis in enumerate(axes)),
            (f"tangential {kind}", along),
        ]:
            if np.isfinite(value):
                saved[name] = worth[row]
                row += 1
    return {name: _PERCENT * value for name, value in saved.items()}
