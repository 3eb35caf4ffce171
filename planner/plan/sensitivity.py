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

from planner.geometry.differential import dot
from planner.machine.feed_limits import COMMANDS
from planner.machine.limits import Limits
from planner.plan.rows import Constraints, Path, speed_limits
from planner.plan.solvers.interior import Iterate
from planner.quantity import CHORD_ERROR, FEED, JERK

_PERCENT = 0.01
_LOWERED = 1e-9


@dataclass(frozen=True, eq=False)
class SpeedBound:
    """Which limit sets the largest x at each point, and how x grows with it.

    ``names``: the limits on the speed, and those of the jerk, which limit it at jumps; ``which (p,)``: index into them;
    ``power (p,)``: by how many percent x grows with one percent of the limit.
    """

    names: tuple[str, ...]
    which: NDArray[np.int8]
    power: NDArray[np.float32]

    @classmethod
    def of(cls, limits: Limits, path: Path, problem: Constraints, command: NDArray[np.int8]) -> SpeedBound:
        """At the points of a problem, before its limits are tightened; ``command (p,)``: see ``limits.command_kind``."""
        bounds = speed_limits(limits, path)
        names = (*bounds, *COMMANDS[1:], *(JERK.of(axis) for axis in limits.axes))
        at_jumps = len(names) - limits.dim
        stacked = np.stack(list(bounds.values()))
        which, lowest = np.argmin(stacked, axis=0), stacked.min(axis=0)
        power = np.where(np.isfinite(lowest), 2.0, 0.0).astype(np.float32)
        at = np.flatnonzero(which == names.index(CHORD_ERROR.label))
        radius = 1.0 / path.curvature[at]
        error = np.minimum(limits.chord_error, radius)
        power[at] = 2.0 * (radius - error) / (2.0 * radius - error)
        commands = np.array([names.index(name) for name in COMMANDS])
        which = np.where(which == names.index(FEED.label), commands[command], which)
        per_x = (problem.length_unit / problem.time_unit) ** 2
        lowered = problem.cap * per_x < lowest**2 * (1.0 - _LOWERED)
        stride = problem.inner + 1
        jump = stride * np.flatnonzero((problem.h == 0.0) & lowered[1::stride])
        step = np.abs(path.axes[2, jump + stride] - path.axes[2, jump])
        with np.errstate(divide="ignore"):
            axis = np.argmin(limits.jerk / step, axis=1)
        for k in range(stride + 1):
            here = jump + k
            which[here] = np.where(lowered[here], at_jumps + axis, which[here])
            power[here] = np.where(lowered[here], 1.0, power[here])
        return cls(names, which.astype(np.int8), power)


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
    # row by row: a long path has no memory to spare
    pace, problem = iterate.pace(), iterate.problem
    # the speed row is the lowest of several limits at each point
    by_name = np.bincount(bound.which, iterate.multipliers(0) * bound.power, len(bound.names))
    saved = dict(zip(bound.names, by_name.tolist(), strict=True))
    for k, of in enumerate((*problem.acceleration.of, *problem.jerk.of)):
        both = iterate.multipliers(1 + 2 * k) + iterate.multipliers(2 + 2 * k)
        # both bounds of a scaled row move by as much as the limit
        worth = float(dot(both, pace)) if of.order == JERK.order else float(both.sum())
        saved[of.name] = saved.get(of.name, 0.0) + worth
    return {name: _PERCENT * value for name, value in saved.items() if value > 0.0}
