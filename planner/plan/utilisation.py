"""How far a time law uses the limits between its nodes: what is measured is the quintic that will run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.curve import Curve
from planner.law import TimeLaw, quintic_coefficients
from planner.machine.feed_limits import commanded_feed
from planner.machine.limit_rows import limit_rows
from planner.machine.limits import Limits
from planner.plan.jumps import JERK_BESIDE_STEP, beside_jumps
from planner.types import FloatArray, IntArray

# Points an interval: an interval of a solver has two nodes' intervals, hence 10 points, and parabolas between.  A stretch
# between breaks has no fewer than the second number: one that is a single interval, as a tiny corner is, hides its peaks.
_POINTS_PER_INTERVAL, _POINTS_PER_STRETCH = 5, 40
_CHUNK = 20_000


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
    """Measure a time law densely between its nodes, in chunks."""
    out = np.zeros((4, law.t.size - 1))
    step = np.diff(law.t)
    last = np.append(np.flatnonzero(step <= 0.0), law.t.size - 1)
    end = np.repeat(law.u[last], np.diff(last, prepend=-1))
    full = np.flatnonzero(step > 0.0)
    points = _points(curve, law, step)
    for lo in range(0, full.size, _CHUNK):
        index = full[lo : lo + _CHUNK]
        out[:, index] = _chunk(curve, limits, law, index, end[index], points[index])
    out[2, beside_jumps(curve, limits, law)] /= JERK_BESIDE_STEP
    return Utilisation(*out)


def _points(curve: Curve, law: TimeLaw, step: FloatArray) -> NDArray[np.intp]:
    """At how many points to look at each interval: by its share of the time of its stretch between breaks."""
    breaks = np.searchsorted(law.u, curve._candidate_breaks(), side="right") - 1
    starts = np.unique(np.concatenate([[0], np.clip(breaks, 0, step.size - 1)]))
    time = np.repeat(np.add.reduceat(step, starts), np.diff(starts, append=step.size))
    share = np.divide(step, time, out=np.ones_like(step), where=time > 0.0)
    return np.clip(np.ceil(_POINTS_PER_STRETCH * share), _POINTS_PER_INTERVAL, _POINTS_PER_STRETCH).astype(np.intp)


def _chunk(
    curve: Curve, limits: Limits, law: TimeLaw, index: NDArray[np.intp], end: FloatArray, points: NDArray[np.intp]
) -> FloatArray:
    """Largest shares of the limits used in the intervals ``index``, and backward rates, (4, n), at so many points each."""
    if law.steps is None:
        h, advance = law.t[index + 1] - law.t[index], law.u[index + 1] - law.u[index]
        digit = np.finfo(float).eps * (np.abs(law.u[index + 1]) + np.abs(law.u_rate[index]) * law.t[index + 1])
    else:
        (h, advance), digit = law.steps[:, index], np.zeros(index.size)
    quintic = quintic_coefficients(
        h,
        (np.zeros(index.size), law.u_rate[index], law.u_acceleration[index]),
        (advance, law.u_rate[index + 1], law.u_acceleration[index + 1]),
    )
    quintic[0] = law.u[index]
    feed = commanded_feed(curve, limits, 0.5 * (law.u[index] + law.u[index + 1]))  # steps only at nodes
    spans = np.stack([h, law.u[index], law.u[index + 1], end, digit, feed, points])
    found = limit_rows(limits)
    # An axis' weights are scaled beforehand, those of the arc length with the bounds: each is rounded once.
    rows = np.array(
        [
            [*row.weights, row.lower, row.upper]
            if row.along
            else [*np.multiply(row.weights, 1.0 / row.scale), *row.bounds]
            for row in found
        ]
    )
    kinds = np.array([(row.motion, row.order - 1) for row in found], dtype=np.int64)
    return shares(curve, quintic, spans, rows.reshape(-1, 5), kinds.reshape(-1, 2), limits.chord_error, limits.period)


def shares(
    curve: Curve,
    quintic: FloatArray,
    spans: FloatArray,
    rows: FloatArray,
    kinds: IntArray,
    chord_error: float,
    period: float,
) -> FloatArray:
    """Largest shares of speed, acceleration and jerk limits on the intervals of quintics, and rates backward, (4, n).

    Parameters
    ----------
    curve : Curve
    quintic : (6, n) array
        Ascending powers of the time since the start of each interval.
    spans : (7, n) array
        Duration, smallest and largest u, the end of its stretch between breaks, what a digit of the law is worth in u, the
        feed limit, and into how many equal parts it is cut to be looked at.
    rows : (m, 5) array
        Weights of velocity, acceleration and jerk in each limit row, and its lower and upper bound.
    kinds : (m, 2) int array
        Motion of each row, and whether it is about speeds (0), accelerations (1) or jerks (2).
    chord_error, period : float
    """
    out = np.empty((4, spans.shape[1]))
    pieces = (*curve.pieces.arguments, *curve.tip.pieces.arguments)
    if not core.utilisation_shares(
        *pieces, spans.shape[1], quintic, spans, len(rows), rows, kinds, chord_error, period, out
    ):
        raise MemoryError("a plan cannot be measured between its nodes")
    return out
