"""The plan before the plan: a coarse solution, in whose time the grid to begin with is placed.

A solve in the time of a guess, or of a law that was found with the path, tells roughly how long each place takes; another
on a grid that is even in that time tells where the jerk switches, and is the law whose time is the coordinate of what
follows.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.errors import SolverError
from planner.law import TimeLaw
from planner.plan.ends import REST
from planner.plan.guess import breaks_inside
from planner.plan.section import Section
from planner.plan.stage import Attempt, Stage, Task
from planner.plan.time_knots import JerkChanges, TimeGrid, place_in_time
from planner.plan.time_map import TimeMap, divided
from planner.plan.utilisation import utilisation

DEFAULT_INTERVALS = 1000
MIN_INTERVALS = 24
_MIN_INTERVALS = 200  # of one section among several
# How many times coarser than the grid that is asked for those of the guess and of the even solve are.  On a path with blends
# neither is, the macros of the guess are short, and its solve begins close to it: or programs of short lines end in local
# optima up to 8 % slower, and a tiny corner between long legs is not seen.
_COARSER_GUESS, _COARSER_EVEN = 4, 2
# Intervals to a macro of the guess, and with blends; in all at least the first, up to the second as many as asked for; and
# relative gaps of the coarse solves.
_PER_GUESSED, _PER_GUESSED_BLENDS, _MIN_COARSE = 2, 4, (200, 300)
_COARSE_GAP, _EVEN_GAP = 1e-2, 1e-4
# Where the even grid has fewer intervals than this for a change of the jerk by its limit, it cannot tell the switches apart.
_TO_TELL = 8.0
# Where the law that the guess leads to falls back for good, the intervals there are halved, so often at most.
_MAX_HALVINGS = 4
# Where the number of intervals is free: so many for a change of the jerk by its limit, by the points inside one, and at most
# so many times the usual.
_PER_CHANGE, _MAX_FOR_CHANGES = {1: 26.0, 3: 15.0}, 4
# A law that was found with its path is slowed down by so much for a start: a solver begins inside its limits.
_SLOWER = 1.05


@dataclass(frozen=True)
class Effort:
    """Number of intervals to begin with, and whether refinement may choose more."""

    intervals: int
    free: bool

    @classmethod
    def for_share(cls, intervals: int | None, share: float, section: Section) -> Effort:
        """For a section with this share of the path, given the number of intervals asked for, if any."""
        if intervals is None:
            least = DEFAULT_INTERVALS if share == 1.0 else _MIN_INTERVALS
            needed = section.curve.intervals_needed(section.u_start, section.u_end)
            return cls(max(least, round(DEFAULT_INTERVALS * share), needed), True)
        return cls(max(MIN_INTERVALS, round(intervals * share)), False)


@dataclass(frozen=True, eq=False)
class Coarse:
    """A plan on a coarse grid, in whose time the grid to begin with is placed; ``spent``: computing time of it, s."""

    stage: Stage
    attempt: Attempt
    spent: float

    @classmethod
    def solved(cls, task: Task, stage: Stage, before: Coarse | None, gap: float) -> Coarse:
        """Solve on a grid after another one."""
        attempt = stage.solve(task, before.attempt if before else None, gap)
        spent = attempt.work.solve_cpu_s + (before.spent if before else 0.0)
        return cls(stage, replace(attempt, waypoint=None), spent)

    @cached_property
    def law(self) -> TimeLaw:
        """The law of the plan."""
        return self.stage.time_law(self.attempt)

    @cached_property
    def changes(self) -> JerkChanges:
        """Where its jerk changes."""
        return self.stage.jerk_changes(self.attempt, self.law)

    def halved(self, task: Task, gap: float) -> Coarse:
        """Solve anew with the intervals halved where the law falls back."""
        stage = self.stage
        backward = utilisation(task.section.curve, task.limits, self.law).backward > 0.0
        grid = stage.grid.split(stage.by_interval(backward.astype(np.float64)) > 0.0)
        again = Coarse.solved(task, Stage.on(task, grid, inner=stage.problem.inner), None, gap)
        return replace(again, spent=self.spent + again.spent)

    def first_stage(self, task: Task, effort: Effort, most: int, *, follow: bool) -> Stage:
        """The grid to begin with."""
        return Stage.on(task, self.placed(task, effort, effort.intervals, most, follow=follow))

    def placed(
        self, task: Task, effort: Effort, intervals: int, most: int, *, follow: bool, even: bool = False
    ) -> TimeGrid:
        """A grid on the map of this plan."""
        if effort.free and not even:
            per_change = _PER_CHANGE[task.points_inside(self.stage.grid.map)]
            intervals = int(np.clip(per_change * self.changes.change.sum(), intervals, _MAX_FOR_CHANGES * intervals))
        return place_in_time(
            task.section,
            self.law,
            self.changes,
            min(intervals, most),
            guess=task.guess,
            even=even,
            periodic=task.periodic,
            period=task.limits.period,
            follow=follow,
        )


def coarse_plan(task: Task, effort: Effort, most: int, *, follow: bool) -> Coarse:
    """Solve coarsely: on a map of the guess, then on an even grid in the time of that plan.

    On blends the second has as many intervals as these need, so that it tells where the jerk switches; elsewhere there is a
    third where it does not.  Where the section continues another one, the first solve begins in any state: it may be slowed
    down as a whole to begin inside its limits, and takes 20 iterations, where one with a prescribed state, which may not,
    took 90 to 120 and often found nothing.
    """
    section, wanted = task.section, effort.intervals
    needed = section.curve.intervals_needed(section.u_start, section.u_end)
    parts = _PER_GUESSED_BLENDS if needed else _PER_GUESSED
    least = int(np.clip(wanted, *_MIN_COARSE))
    count = max(least, wanted if needed else wanted // _COARSER_GUESS) // parts
    on = _first_map(task, count)
    stage = Stage.on(task, TimeGrid.even(on, parts), inner=1)
    found = Coarse.solved(task, stage.begun_anyhow() if section.continues else stage, None, _COARSE_GAP)
    between = max(least, wanted if needed else wanted // _COARSER_EVEN, min(2 * wanted, needed))
    for _ in range(_MAX_HALVINGS):
        with suppress(SolverError):
            grid = found.placed(task, effort, between, most, follow=follow, even=True)
            break
        found = found.halved(task, _COARSE_GAP)
    else:
        grid = found.placed(task, effort, between, most, follow=follow, even=True)
    found = Coarse.solved(task, Stage.on(task, grid), found, _EVEN_GAP)
    told = min(round(_TO_TELL * float(found.changes.change.sum())), 2 * wanted if effort.free else wanted, most)
    if found.stage.problem.inner == task.inner and told > 1.5 * between:
        grid = found.placed(task, effort, told, most, follow=follow, even=True)
        found = Coarse.solved(task, Stage.on(task, grid), found, _EVEN_GAP)
    return found


def _first_map(task: Task, count: int) -> TimeMap:
    """The map of a law that was found with the path, slowed down to these limits; where there is none that of the guess."""
    section, limits = task.section, task.limits
    timing = section.curve.timing
    law = None if timing is None else timing.between(section.u_start, section.u_end)
    if law is None or section.start is not REST or section.end is not REST:
        return TimeMap.from_guess(section, limits, task.guess, breaks_inside(section), count)
    law = law.dilated(max(1.0, float(utilisation(section.curve, limits, law).slowdown.max())) * _SLOWER)
    nodes = np.unique(law.t)
    parts = np.maximum(1, np.rint(np.diff(nodes) * count / law.duration)).astype(np.intp)
    return TimeMap.from_law(section, law, divided(nodes, parts))
