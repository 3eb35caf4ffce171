"""How far a time law uses the limits between its nodes: what is measured is the quintic that will run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.curve import Curve
from planner.law import TimeLaw
from planner.machine.feed_limits import commanded_feed
from planner.machine.limit_rows import limit_rows
from planner.machine.limits import Limits
from planner.plan.jumps import JERK_BESIDE_STEP, beside_jumps
from planner.sets import union
from planner.types import FloatArray

# Points an interval: an interval of a solver has two nodes' intervals, hence 10 points, and parabolas between.  A stretch
# between breaks has no fewer than the second number: one that is a single interval, as a tiny corner is, hides its peaks.
_POINTS_PER_INTERVAL, _POINTS_PER_STRETCH = 5, 40
_AT_ONCE = 65_536


@dataclass(frozen=True, eq=False)
class Utilisation:
    """Largest share of the limits used in each interval between nodes.

    ``speed`` (feed, chord, axis velocities), ``acceleration``, ``jerk``: (n - 1,) arrays, 0 for empty intervals.  Beside
    a curvature jump the share of the jerk is that of what the step leaves of it.  ``backward``: rate at which u falls back,
    1/s, where the law changes too much within an interval for a quintic.
    """

    speed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    backward: FloatArray

    @property
    def slowdown(self) -> FloatArray:
        """By how much each interval must slow down to keep its limits: max(V, A^(1/2), J^(1/3))."""
        return np.maximum(self.speed, np.maximum(np.sqrt(self.acceleration), np.cbrt(self.jerk)))

    def spread(self, parts: NDArray[np.intp]) -> Utilisation:
        """The same for ``parts`` equal shares of each interval."""
        rows = (self.speed, self.acceleration, self.jerk, self.backward)
        return Utilisation(*(np.repeat(row, parts) for row in rows))


def utilisation(curve: Curve, limits: Limits, law: TimeLaw) -> Utilisation:
    """Measure a time law densely between its nodes."""
    step = np.diff(law.t)
    last = np.append(np.flatnonzero(step <= 0.0), step.size)
    end = np.repeat(law.u[last], np.diff(last, prepend=-1))
    points = _points(curve, law, step)
    found = limit_rows(limits)
    # An axis' weights are scaled beforehand, those of the arc length with the bounds: each is rounded once.
    rows = np.array(
        [
            (*row.weights, row.lower, row.upper)
            if row.along
            else (*np.multiply(row.weights, 1.0 / row.scale), *row.bounds)
            for row in found
        ],
        dtype=np.float64,
    ).reshape(-1, 5)
    kinds = np.array([(row.motion, row.order - 1) for row in found], dtype=np.int64).reshape(-1, 2)
    out = np.empty((4, step.size))
    for first in range(0, step.size, _AT_ONCE):  # some at a time, which bounds the memory
        some = slice(first, first + _AT_ONCE)
        u, rate, t = (row[first : first + _AT_ONCE + 1] for row in (law.u, law.u_rate, law.t))
        full, shares = np.flatnonzero(step[some] > 0.0), np.zeros((4, t.size - 1))
        h, advance, digit = step[some], np.diff(u), np.zeros(t.size - 1)
        if law.steps is None:
            digit = np.finfo(float).eps * (np.abs(u[1:]) + np.abs(rate[:-1]) * t[1:])
        else:
            h, advance = law.steps[0, some], law.steps[1, some]
        measured = core.utilisation_shares(
            *(*curve.pieces.arguments, *curve.tip.pieces.arguments),
            *(full.size, full, t.size - 1, u, rate, law.u_acceleration[first : first + _AT_ONCE + 1]),
            *(np.ascontiguousarray(h), np.ascontiguousarray(advance), np.stack([h**3, h**4, h**5]), digit, end[some]),
            commanded_feed(curve, limits, 0.5 * (u[1:] + u[:-1])),  # steps only at nodes
            *(points[some], len(found), rows, kinds, limits.chord_error, limits.period, shares),
        )
        if not measured:
            raise MemoryError("a plan cannot be measured between its nodes")
        out[:, some] = shares
    out[2, beside_jumps(curve, limits, law)] /= JERK_BESIDE_STEP
    return Utilisation(*out)


def _points(curve: Curve, law: TimeLaw, step: FloatArray) -> NDArray[np.intp]:
    """At how many points to look at each interval: by its share of the time of its stretch between breaks."""
    breaks = np.searchsorted(law.u, curve._candidate_breaks(), side="right") - 1
    starts = union(np.zeros(1, dtype=np.intp), np.clip(breaks, 0, step.size - 1))
    time = np.repeat(np.add.reduceat(step, starts), np.diff(starts, append=step.size))
    share = np.divide(step, time, out=np.ones_like(step), where=time > 0.0)
    return np.clip(np.ceil(_POINTS_PER_STRETCH * share), _POINTS_PER_INTERVAL, _POINTS_PER_STRETCH).astype(np.intp)
