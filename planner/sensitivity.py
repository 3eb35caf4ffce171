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

from planner.constraints import Path, speed_limits
from planner.limits import Limits
from planner.solvers.optimal import Iterate

_PERCENT = 0.01


def saved_by_one_percent(iterate: Iterate, path: Path, limits: Limits, axes: tuple[str, ...]) -> dict[str, float]:
    """Seconds that one percent more of each limit would save (limits without any effect are left out).

    Parameters
    ----------
    iterate : Iterate
        The optimum of a section.
    path : Path
        The path at its collocation points.
    limits : Limits
    axes : tuple of str

    Returns
    -------
    dict
        By the names of ``FeedrateProfile.limit_names``; unit of the problem's time.
    """
    bound, _ = iterate.bound_and_value()
    worth = (iterate.dual.sum(axis=1) * bound).sum(axis=1)
    saved: dict[str, float] = {}
    # the speed row is the lowest of several limits at each point
    names = ["feed", "chord error", *(f"velocity {axis}" for axis in axes)]
    power = np.array([2.0, 1.0, *(2.0 for _ in axes)])
    which = np.argmin(speed_limits(limits, path), axis=0)
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
                saved[name] = float(worth[row])
                row += 1
    return {name: _PERCENT * value for name, value in saved.items()}
