"""What each limit costs: the change of the duration with the limit, from the multipliers of the optimum.

The multiplier l of a constraint g(z) <= 0 is the rate at which the time falls when its bound is relaxed.  Relaxing a limit
by the fraction e moves the scaled bounds of its rows by

    feed, axis velocity   cap (1 + e)^2     2 e        chord error   cap ~ 2 rho d - d^2      2 e (rho - d) / (2 rho - d)
    acceleration          1 (1 + e)           e        jerk          x^(-1/2) (1 + e)         e x^(-1/2)

(d the chord error, rho the radius), so that the seconds saved by one percent are 0.01 sum(l * bound * power).  At a jump of
the curvature the cap is what the jerk of an axis leaves of its step in one period: it grows with that jerk.  Where the path
itself commands a lower feed than the limits (``feed_caps``), it is not the machine's feed that costs time but the
programmed one, and on rapids the limit of these.  An axis that has no jerk limit leaves a rest by a ramp in proportion to
its acceleration.

They hold for small changes; a limit that stops binding when it is relaxed saves less than its rate promises.  So does one
of two that bind together: along a line at 45 degrees more jerk for one axis alone saves nothing, and what both are worth
may be told of either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.machine.feed_limits import COMMANDS
from planner.machine.limits import Limits
from planner.plan.rows import Speeds
from planner.plan.solvers.interior import Iterate
from planner.quantity import CHORD_ERROR, FEED, JERK, VELOCITY

_PERCENT = 0.01


@dataclass(frozen=True, eq=False)
class SpeedBound:
    """Which limit sets the largest x at each point, and how x grows with it.

    ``names``: the limits on the speed, and those of the jerk, which limit it at jumps; ``which (p,)``: index into them;
    ``power (p,)``: by how many percent x grows with one percent of the limit.
    """

    names: tuple[str, ...]
    which: NDArray[np.uint8]
    power: NDArray[np.float32]

    @classmethod
    def of(cls, limits: Limits, speeds: Speeds) -> SpeedBound:
        """At the points of a problem, before its limits are tightened."""
        velocities = [VELOCITY.of(axis) for axis in limits.axes]
        names = (FEED.label, CHORD_ERROR.label, *velocities, *COMMANDS[1:], *(JERK.of(axis) for axis in limits.axes))
        which, power, stride = speeds.which, speeds.power, speeds.lowered.shape[1] - 1
        with np.errstate(divide="ignore"):
            axis = np.argmin(limits.jerk / np.abs(speeds.step), axis=1)
        for k, lowered in enumerate(speeds.lowered.T):
            here = stride * speeds.jumps[lowered] + k
            which[here] = len(names) - limits.dim + axis[lowered]
            power[here] = 1.0
        return cls(names, which, power)


def saved_by_one_percent(iterate: Iterate, bound: SpeedBound) -> dict[str, float]:
    """Seconds that one percent more of each limit would save.

    Parameters
    ----------
    iterate : Iterate
        The optimum of a section.
    bound : SpeedBound
        What limits the speed at its points.

    Returns
    -------
    dict
        By the names of ``FeedrateProfile.limit_names``, "programmed feed" and "rapid"; unit of the problem's time.
    """
    problem = iterate.problem
    every = (*problem.acceleration.of, *problem.jerk.of)
    by_speed, by_row = np.zeros(len(bound.names)), np.zeros(len(every))
    core.sensitivity_sums(
        *(problem.h.size, problem.h, problem.inner, iterate.z, len(problem.acceleration), len(every), iterate.pairs),
        *(bound.which, bound.power, by_speed, by_row),
    )
    # the speed row is the lowest of several limits at each point
    saved = dict(zip(bound.names, by_speed.tolist(), strict=True))
    for of, worth in zip(every, by_row.tolist(), strict=True):
        # both bounds of a scaled row move by as much as the limit
        saved[of.name] = saved.get(of.name, 0.0) + worth
    return {name: _PERCENT * value for name, value in saved.items() if value > 0.0}
