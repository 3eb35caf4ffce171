"""Where the knots of a plan go, in the time of the law before it.

The optimum changes its jerk at once wherever it goes from one limit to another, and a grid resolves that to one interval:
what a plan loses goes with the square of the intervals there, and with little else.  So the knots follow what a solve on a
coarser grid found (``switches.py``):

1.  A share of the knots is even in time; the others go where the jerk changes, each interval of the coarser grid getting as
    many as its part of all changes.
2.  The switches that were located have a double knot each, as the breaks of the path do.
3.  Neighbouring spacings stay within a factor of about 2; beside a curvature jump knots are no further apart than a period,
    since the plan has only half of the jerk there.
4.  Every two dozen intervals a macro of the map ends, at a double knot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.law import TimeLaw
from planner.plan.ends import Feed
from planner.plan.guess import FeedGuess, breaks_inside, least_times
from planner.plan.jumps import PERIODS_AROUND_STEP
from planner.plan.knots import followed
from planner.plan.section import Section
from planner.plan.time_map import TimeMap
from planner.sets import union
from planner.types import FloatArray, IntArray

_PER_MACRO = 24
# Share of the knots that go where the jerk changes.
_CHANGES = 0.45
# An interval's change may be anywhere in it, or begin in the next: it is spread so far beyond either end, in its lengths.
_BEYOND = 0.5
# |d spacing / d time| that keeps neighbours within a factor 2, and how often the spacings are scaled to give their number
_GROWTH, _SCALINGS = 0.5, 4
_MAX_WIDER = 1.5  # than the density has them: the growth away from where knots are close may take more than all
# Where there is room, nodes are so far apart that rounding makes no more than this share of the jerk limit.
ROUNDING_SHARE = 2e-6
_SLIVER = 1e-9  # of the whole
_PER_ENTRY = 0.25  # of the time in which acceleration makes up the feed at an end
_PER_INTERVAL = 6  # cells in which the density is known, an interval
# Switches closer to a break or to one another than this share of the mean interval are one place.
_APART = 0.2
# Where there are more of them than this share of the intervals, the grid is too coarse to tell them.
_MAX_SWITCHES = 0.4


@dataclass(frozen=True, eq=False)
class TimeGrid:
    """Knots of a section on its map.

    Attributes
    ----------
    map : TimeMap
    sigma : (n,) array
        Non-decreasing; where a macro ends and the next begins there are two equal ones.
    macro : (n,) int array
        The macro of each knot.
    left : (K,) int array
        Last knots of the macros.
    """

    map: TimeMap
    sigma: FloatArray
    macro: IntArray
    left: IntArray

    @classmethod
    def even(cls, on: TimeMap, parts: int) -> TimeGrid:
        """Every macro in so many equal intervals."""
        count = on.piece.size
        macro = np.repeat(np.arange(count), parts + 1)
        share = np.tile(np.arange(parts + 1) / parts, count)
        sigma = on.sigma[macro] + np.diff(on.sigma)[macro] * share
        left = (parts + 1) * np.arange(1, count + 1) - 1
        sigma[left] = on.sigma[1:]
        return cls(on, sigma, macro, left)

    @cached_property
    def intervals(self) -> int:
        """Number of intervals that are not empty."""
        return int(np.count_nonzero(np.diff(self.sigma) > 0.0))

    @cached_property
    def at_breaks(self) -> NDArray[np.bool_]:
        """Ends of macros (K,) that are breaks of the path, or its end."""
        ends = self.map.u[1:]
        breaks = np.append(breaks_inside(self.map.section), np.inf)
        found = np.asarray(breaks[np.searchsorted(breaks, ends)] == ends)
        found[-1] = True
        return found

    def distances(self, sigma: FloatArray, macro: IntArray) -> FloatArray:
        """Distances of points sigma from the starts of their macros, never beyond the ends."""
        start, end = self.map.sigma[macro], self.map.sigma[macro + 1]
        return np.where(sigma >= end, end - start, np.maximum(sigma - start, 0.0))

    def split(self, where: NDArray[np.bool_]) -> TimeGrid:
        """Halve the intervals at which ``where`` (one flag an interval, empty ones included) is true, on the same map."""
        halves = np.flatnonzero(where & (np.diff(self.sigma) > 0.0))
        middle = 0.5 * (self.sigma[halves] + self.sigma[halves + 1])
        sigma = np.insert(self.sigma, halves + 1, middle)
        macro = np.insert(self.macro, halves + 1, self.macro[halves])
        return TimeGrid(self.map, sigma, macro, self.left + np.searchsorted(halves, self.left, side="left"))

    def renewed(self, law: TimeLaw, time: FloatArray, *, periodic: bool) -> TimeGrid:
        """The same knots on the map of a law that was found on them, which passes them at the ``time (n,)``.

        Raises
        ------
        SolverError
            If that law falls back.
        """
        on = TimeMap.from_law(self.map.section, law, np.append(0.0, time[self.left]), periodic=periodic)
        return _on_map(on, union(time))


@dataclass(frozen=True, eq=False)
class JerkChanges:
    """How the jerk of a plan changes: the ``time (n,)`` of its knots, the ``change (n - 1,)`` in each interval, as the share
    of the limit that changes most, and the times of the ``switches (k,)``.
    """

    time: FloatArray
    change: FloatArray
    switches: FloatArray


def place_in_time(
    section: Section,
    law: TimeLaw,
    changes: JerkChanges,
    intervals: int,
    *,
    guess: FeedGuess,
    even: bool = False,
    periodic: bool = False,
    period: float = np.inf,
    follow: bool = False,
) -> TimeGrid:
    """Distribute about ``intervals`` intervals over a law by the rules above; ``even``: by the first and third alone.

    ``period``: of the samples, s; ``follow``: knots have to follow |C'| too.
    """
    breaks = breaks_inside(section)
    ends = np.concatenate([law.t[:1], law.t[np.searchsorted(law.u, breaks)], law.t[-1:]])
    total, mean = float(law.t[-1]), float(law.t[-1]) / intervals
    if not even and changes.switches.size <= _MAX_SWITCHES * intervals:
        ends = _with_switches(ends, changes.switches, _APART * total / np.count_nonzero(np.diff(changes.time) > 0.0))
    edges, rate = _rates(changes, ends)
    share = 0.0 if even else _CHANGES
    fine = union(edges, np.linspace(0.0, total, _PER_INTERVAL * intervals + 1))
    fine = fine[np.append(np.diff(fine) > _SLIVER * total, True)]
    fine[0] = 0.0
    middle = 0.5 * (fine[1:] + fine[:-1])
    cell = np.clip(np.searchsorted(edges, middle, side="right") - 1, 0, rate.size - 1)
    spacing = 1.0 / (intervals * (share * rate[cell] + (1.0 - share) / total))
    most = np.full(middle.size, np.inf)
    for jump in section.jumps:
        at = float(law.t[np.searchsorted(law.u, jump.u)])
        lo, hi = np.searchsorted(middle, [at - PERIODS_AROUND_STEP * period, at + PERIODS_AROUND_STEP * period])
        most[max(lo - 1, 0) : hi + 1] = 0.5 * period
    if follow:
        u = np.interp(fine, law.t, law.u)
        most = np.minimum(most, np.diff(fine) * followed(guess, section.coordinate(u)))
    # nodes are half an interval apart, or less
    least = 2.0 * np.interp(np.interp(middle, law.t, law.u), guess.u, least_times(guess, ROUNDING_SHARE))
    for at, end in ((0, section.start), (-1, section.end)):
        if isinstance(end, Feed):  # a slow one changes by its own size in the time that acceleration takes for it
            most[at] = max(min(most[at], _PER_ENTRY * guess.feed[at] / guess.acceleration[at]), least[at])
    spacing = np.maximum(spacing, np.minimum(least, 0.8 * mean))
    count = _counted(fine, spacing, most, intervals)
    at = np.interp(ends, fine, count)
    parts = _whole(np.diff(at), max(intervals, round(float(count[-1]))) if np.isfinite(most).any() else intervals)
    k = np.repeat(np.arange(parts.size), parts)
    j = np.arange(k.size) - np.repeat(np.cumsum(parts) - parts, parts)
    knots = np.interp(at[k] + np.diff(at)[k] * j / parts[k], count, fine)
    knots[j == 0] = ends[:-1]
    # ends of macros: every so many knots of a stretch
    macros = np.maximum(1, np.rint(parts / _PER_MACRO)).astype(np.intp)
    of = np.repeat(np.arange(macros.size), macros)
    i = np.arange(of.size) - np.repeat(np.cumsum(macros) - macros, macros)
    first = (np.cumsum(parts) - parts)[of] + np.rint(parts[of] * i / macros[of]).astype(np.intp)
    starts = np.append(first, knots.size)
    knots = np.append(knots, total)
    on = TimeMap.from_law(section, law, knots[starts], periodic=periodic)
    return _on_map(on, knots)


def _on_map(on: TimeMap, knots: FloatArray) -> TimeGrid:
    """Put increasing knots, the ends of the macros among them, on a map that may have more macros."""
    knots = union(knots, on.sigma)
    inner = np.searchsorted(knots, on.sigma[1:-1])
    sigma = np.insert(knots, inner, on.sigma[1:-1])
    left = np.append(inner + np.arange(inner.size), sigma.size - 1)
    macro = np.zeros(sigma.size, dtype=np.intp)
    macro[left[:-1] + 1] = 1
    return TimeGrid(on, sigma, np.cumsum(macro), left)


def _with_switches(ends: FloatArray, switches: FloatArray, apart: float) -> FloatArray:
    """Add the switches that are apart from the ends of stretches and from one another."""
    after = np.clip(np.searchsorted(ends, switches), 1, ends.size - 1)
    near = np.minimum(switches - ends[after - 1], ends[after] - switches)
    kept = switches[near > apart]
    kept = kept[np.append(True, np.diff(kept) > apart)[: kept.size]]
    return union(ends, kept)


def _rates(changes: JerkChanges, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of all changes per second, (k,), between the edges (k + 1,)."""
    t, total = changes.time, float(ends[-1])
    full = np.flatnonzero(np.diff(t) > 0.0)
    reach = _BEYOND * np.diff(t)[full]
    lo, hi = np.maximum(t[full] - reach, 0.0), np.minimum(t[full + 1] + reach, total)
    share = changes.change[full] / max(float(changes.change.sum()), np.finfo(float).tiny)
    edges = union(lo, hi, ends)
    steps = np.bincount(np.searchsorted(edges, lo), share / (hi - lo), edges.size)
    steps -= np.bincount(np.searchsorted(edges, hi), share / (hi - lo), edges.size)
    return edges, np.maximum(np.cumsum(steps)[:-1], 0.0)


def _whole(shares: FloatArray, total: int) -> IntArray:
    """Whole numbers, 1 at least, near the shares; where their sum is beyond the total, less of those rounded up most."""
    parts = np.maximum(1, np.rint(shares)).astype(np.intp)
    over = int(parts.sum()) - total
    if over > 0:
        order = np.argsort(shares - parts, kind="stable")
        parts[order[parts[order] > 1][:over]] -= 1
    return parts


def _counted(
    fine: FloatArray, spacing: FloatArray, most: FloatArray, intervals: float, scalings: int = _SCALINGS
) -> FloatArray:
    """Accumulated number of intervals (k + 1,) at these spacings of the cells, each in the growth of its neighbours."""
    count = np.empty(fine.size)
    core.time_knots_count(
        *(spacing.size, fine, spacing, most, intervals, _GROWTH, scalings, _MAX_WIDER, np.empty(spacing.size), count)
    )
    return count
