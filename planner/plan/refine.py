"""Plan one section: solve in the time of a guess, then in the time of that plan, and go on until the law keeps its limits.

The coarse solves before (``coarse.py``) tell the time that is the coordinate of the next one (``time_map.py``) and where its
knots go (``time_knots.py``).  A solver looks at knots and at one or three points between only.  Everywhere else the law is
measured (``utilisation.py``), and what it uses too much is given back in four ways, the first that serves:

1.  Where an interval is far too coarse it is halved, and the map is renewed from the law at hand.
2.  Where it uses a little more than its limits, these are tightened there by as much or half as much again, and by parts of
    that in two intervals on either side, where the plan would otherwise seek what it gives up.  The next solve begins where
    the last one came through (``Waypoint``) and takes half of its iterations; one or two rounds serve.  Later ones, which
    long paths need for a few places, tighten by twice as much each.
3.  Where intervals are as short as nodes may be, or refining did not help, the speed is held in them; so it is where the
    true chord error is too large.
4.  What is left is slowed down uniformly: time scaled by kappa divides velocities by kappa, accelerations by kappa^2 and
    jerks by kappa^3.  A prescribed feed would change with it; there step 2 is repeated until the limits are met.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import CurveError, InfeasibleError, SolverError
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.plan.bounds import SectionBound
from planner.plan.chord_errors import MET_CHORD, chord_shares
from planner.plan.coarse import Coarse, Effort, coarse_plan
from planner.plan.dual.problem import Pace
from planner.plan.ends import Rest, feed_at
from planner.plan.guard import require_finite_law, require_law
from planner.plan.guess import guess_feed, resolvable
from planner.plan.section import Section
from planner.plan.stage import HOPELESS, MORE_INNER, TIGHTENING_ROUNDS, TOO_COARSE, WORTH_SAYING, Attempt, Stage, Task
from planner.plan.utilisation import Utilisation, utilisation
from planner.status import Status, Work
from planner.types import Progress

# Where a first plan needs more slowing down than this between midpoints, there are three points in an interval instead.
_POINTS_SERVE = 1.005
# A plan that needs more slowing down than this at the end is refined first; and than this share of what the first on its
# grid needed, up to the third: the grid itself keeps a plan further from the optimum than that.
_MIN_ACCEPTED, _ACCEPTED_SHARE, _MAX_ACCEPTED = 2e-6, 0.02, 1e-5
_MAX_ROUNDS, _CHORD_ROUNDS = 12, 16
# Where midpoints do not serve and the number of intervals is free, these are doubled, up to so many times as many: what the
# path asks for is too short to be seen by the coarse solves, and the plan was up to 1 % slower.  A share of the time that is
# worth that.
_MAX_FINER, _WORTH_FINER = 4, 5e-5
# Intervals times iterations of all rounds, at most: some seconds.
_MAX_WORK, _WORK_PER_INTERVAL, _USUAL_ITERATIONS = 2_000_000, 1200, 60
# Slowing down is measured at points; the peaks between them are higher by less than this.
PEAK_MARGIN = 5e-7
_MET = 1.0 + 2e-8
_BACKWARD = 5e-10  # of the largest rate of u: slower than that is rounding
ALMOST_MET = 1.0 + 1e-6
# Nodes closer to a stop than this share of the domain of u are left out.
_ON_STOP = 2e-12


@dataclass(frozen=True, eq=False)
class SectionPlan:
    """A solved section: its time law, what a lower bound of its time follows from, and what the solver says of it.

    ``bound``: None where the method gives none.  ``saved``: time that one percent more of each limit saves, s, where the
    method tells.
    """

    law: TimeLaw
    bound: Callable[[], float] | None
    status: Status
    work: Work
    notes: tuple[str, ...] = ()
    saved: Mapping[str, float] = field(default_factory=dict)
    outcome: Outcome | None = None

    def said_slowed(self, place: float) -> SectionPlan:
        """Say so, in status and notes, where the plan is a good deal slower than what was solved for, because of a place."""
        slowdown = self.work.slowdown
        if slowdown <= WORTH_SAYING:
            return self
        note = (
            f"slowed down as a whole by {100.0 * (slowdown - 1.0):.2g} %, for what the plan would use of its limits at u = "
            f"{place:.6g}: refining the grid there did not help"
        )
        status = Status.SLOWED if self.status.as_meant else self.status
        return replace(self, status=status, notes=(*self.notes, note))


def plan_section(
    section: Section,
    limits: Limits,
    *,
    method: str,
    periodic: bool,
    deadline: float,
    effort: Effort,
    progress: Progress | None,
) -> SectionPlan:
    """Plan one section by the method optimal or nlp, see the sketch above.

    Raises
    ------
    InfeasibleError
        If a prescribed feed is not attainable.
    SolverError
        If no plan was found, or none that keeps the limits with the feeds prescribed.
    """
    wanted = effort.intervals
    guess = guess_feed(section, limits, wanted)
    most = resolvable(guess)
    notes: tuple[str, ...] = ()
    if wanted > most:
        notes = (
            f"{wanted} intervals asked for, {most} used: in a plan of {guess.duration:.3g} s closer nodes differ by "
            "little more than rounding",
        )
        wanted = most
    task = Task(section, limits, guess, method, periodic, deadline, progress)
    effort = replace(effort, intervals=wanted)
    found = _with_enough(task, effort, most)
    _require_met(task, found.best)
    best, attempt = found.best, found.attempt
    work = replace(
        attempt.work,
        rounds=best.number + 1,
        slowdown=best.slowdown,
        solve_cpu_s=found.spent,
        first_solve_cpu_s=found.first,
    )
    bound = SectionBound(section, limits, wanted, Pace(best.law.u, best.law.t), periodic=periodic)
    plan = SectionPlan(best.law, bound, attempt.status, work, (*notes, *found.notes), attempt.saved, found)
    return plan.said_slowed(best.place)


def _with_enough(task: Task, effort: Effort, most: int) -> Outcome:
    """Refine; where the intervals are too long to do so between midpoints, on twice as many, if their number is free.

    A path with blends asks for as many as it needs.
    """
    found = _best_of_tries(task, effort, most)
    needed = task.section.curve.intervals_needed(task.section.u_start, task.section.u_end)
    if not effort.free or task.method != "optimal" or needed:
        return found
    largest, tried = min(most, _MAX_FINER * effort.intervals), found
    while not tried.served and 2 * effort.intervals <= largest and time.perf_counter() < task.deadline:
        effort = replace(effort, intervals=2 * effort.intervals)
        with suppress(CurveError, InfeasibleError, SolverError):
            tried = _best_of_tries(task, effort, most)
            require_law(task.section.curve, tried.best.law)
            found = _sooner(task, found, tried)
    return found


def _sooner(task: Task, found: Outcome, other: Outcome) -> Outcome:
    """Another outcome where it is sooner by enough and keeps its limits, or is the better one; with the time of both."""
    met = [each.best.forward and (not task.prescribed or each.best.slowdown <= ALMOST_MET) for each in (found, other)]
    worth = bool(other.best.law.t[-1] < (1.0 - _WORTH_FINER) * found.best.law.t[-1])
    better = worth if all(met) else other.best.is_better_than(found.best, task)
    return replace(other if better else found, spent=found.spent + other.spent, first=found.first)


def _best_of_tries(task: Task, effort: Effort, most: int) -> Outcome:
    """Refine with as few points as serve; where that ends badly, with more, and then from a grid that follows |C'|."""
    best, failed, coarse, spent = None, None, None, 0.0
    more = replace(task, inner=MORE_INNER) if task.method == "optimal" else task
    tries = ((task, False), (more, False), (more, True)) if more.inner != task.inner else ((task, False), (task, True))
    for each, follow in tries:
        try:
            this = _following(each, effort) if follow else each
            if follow or coarse is None:
                coarse = coarse_plan(this, effort, most, follow=follow)
                spent += coarse.spent
            found = _refined(this, effort, most, coarse, follow=follow, patient=each is more)
        except (CurveError, InfeasibleError, SolverError) as error:
            failed = failed or error
            continue
        spent += found.spent
        best = found if best is None or found.best.is_better_than(best.best, task) else best
        enough = ALMOST_MET if task.prescribed else WORTH_SAYING if effort.free else HOPELESS
        enough = enough if each is more else min(enough, _POINTS_SERVE)
        good = best.best.forward and best.best.slowdown <= enough
        if good or time.perf_counter() > task.deadline:
            break
    if best is None:
        raise failed or SolverError("no round of refinement was run")
    return replace(best, spent=spent, served=each is task and not follow)


def _following(task: Task, effort: Effort) -> Task:
    """The same task with samples that follow |C'|."""
    return replace(task, guess=guess_feed(task.section, task.limits, effort.intervals, follow=True))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The best round of a refinement, with what its solve began from; computing times, s, and notes.

    ``served``: the fewest points served.
    """

    task: Task
    best: Round
    stage: Stage
    attempt: Attempt
    spent: float
    first: float
    notes: tuple[str, ...]
    served: bool = False


def _refined(task: Task, effort: Effort, most: int, coarse: Coarse, *, follow: bool, patient: bool) -> Outcome:
    """Solve on the map of a coarse plan, and refine.

    ``follow``: grids that follow |C'|; ``patient``: go on where the first plan is far off between its points.
    """
    stage, attempt, spent = coarse.first_stage(task, effort, most, follow=follow), coarse.attempt, 0.0
    first, work, slowdown, accepted = 0.0, 0, np.inf, _MIN_ACCEPTED
    most_work = max(_MAX_WORK, _WORK_PER_INTERVAL * effort.intervals)
    notes: tuple[str, ...] = ()
    found: Outcome | None = None
    for number in range(_MAX_ROUNDS):
        on_new_grid = attempt.waypoint is None
        try:
            attempt = stage.solve(task, attempt)
            this = Round.of(task, number, stage, attempt)
        except (InfeasibleError, SolverError) as error:
            if found is None:
                raise
            notes = (f"refinement ended after {number} rounds: {error}",)
            break
        spent += attempt.work.solve_cpu_s
        first = first or coarse.spent + spent
        if found is None or this.is_better_than(found.best, task):
            found = Outcome(task, this, stage, attempt, spent, first, ())
        work += stage.grid.intervals * attempt.work.iterations
        if on_new_grid and effort.free:
            accepted = float(np.clip(_ACCEPTED_SHARE * (this.slowdown - 1.0), _MIN_ACCEPTED, _MAX_ACCEPTED))
        if this.is_accepted(task, accepted) or work > most_work:
            break
        if not patient and stage.problem.inner == task.inner and not (this.forward and this.slowdown <= _POINTS_SERVE):
            break
        if time.perf_counter() > task.deadline:
            break
        may_split = stage.grid.intervals < most and this.is_too_coarse(effort)
        stage, attempt = stage.next(task, attempt, this.used, may_split=may_split, number=number, before=slowdown)
        slowdown = this.slowdown
        if work + _USUAL_ITERATIONS * stage.grid.intervals > most_work:
            break
    if found is None:
        raise SolverError("no round of refinement was run")
    return replace(found, spent=spent, first=first, notes=notes)


def hold_chords(plan: SectionPlan) -> SectionPlan:
    """Hold the speed where the true chord error of a plan is too large, and plan again; the plan itself where none helps."""
    if plan.outcome is None:
        return plan
    task, stage, attempt, best = plan.outcome.task, plan.outcome.stage, plan.outcome.attempt, plan.outcome.best
    law, shortest, place, work = best.law, np.inf, np.nan, 0
    curve, limits = task.section.curve, task.limits
    for _ in range(_CHORD_ROUNDS):
        times, shares = chord_shares(curve, limits, law)
        place = float(np.interp(times[shares.argmax()], law.t, law.u)) if np.isnan(place) else place
        needed = float(law.t[-1]) * max(1.0, float(np.sqrt(shares.max())))
        if needed < shortest:
            shortest, kept = needed, (law, attempt, best)
        met = bool(shares.max() <= MET_CHORD)
        if (met and best.slowdown <= WORTH_SAYING) or time.perf_counter() > task.deadline:
            break
        if met:  # and the other limits are not, or only once it is slowed down as a whole
            stage, attempt = stage.next(task, attempt, best.used, may_split=False)
        else:
            stage, attempt = stage.slower(task, attempt, best.used, stage.knot_times(law), times, shares)
        if work + _USUAL_ITERATIONS * stage.grid.intervals > _MAX_WORK:
            break
        with suppress(SolverError, InfeasibleError):
            attempt = stage.solve(task, attempt)
            work += stage.grid.intervals * attempt.work.iterations
            best = Round.of(task, best.number + 1, stage, attempt)
            law = best.law
            continue
        break
    law, attempt, best = kept
    if best is plan.outcome.best:
        return plan
    note = (
        f"held slow near u = {place:.6g} for its chord error, which the osculating circle does not tell where the "
        "curvature changes within a period"
    )
    last = attempt.work
    spent = replace(
        plan.work,
        slowdown=best.slowdown,
        intervals=last.intervals,
        iterations=last.iterations,
        gap=last.gap,
        residual=last.residual,
    )
    return replace(plan, law=law, status=attempt.status, work=spent, notes=(*plan.notes, note), outcome=None)


@dataclass(frozen=True, eq=False)
class Round:
    """What came out of one round: the law, slowed down until it keeps its limits, and how it was before.

    ``slowdown``: by which factor it was too fast; ``forward``: u falls back nowhere, but for rounding.
    """

    number: int
    law: TimeLaw
    used: Utilisation
    slowdown: float
    forward: bool

    @classmethod
    def of(cls, task: Task, number: int, stage: Stage, attempt: Attempt) -> Round:
        """Measure an attempt between its nodes; a SolverError where it is not finite."""
        given = stage.time_law(attempt)
        require_finite_law(task.section.curve, given)
        kept = _apart_from_stops(task.section, given)
        law = given if kept.size == given.t.size else given.only(kept)
        used = utilisation(task.section.curve, task.limits, law).spread(np.diff(kept))
        slowdown = float(used.slowdown.max())
        kappa = 1.0 if task.prescribed else max(1.0, slowdown * (1.0 + PEAK_MARGIN))
        forward = bool((used.backward <= _BACKWARD * float(np.abs(law.u_rate).max())).all())
        forward &= bool((np.diff(law.u) >= 0.0).all())
        return cls(number, law.dilated(kappa), used, slowdown, forward)

    @property
    def place(self) -> float:
        """Parameter at which it uses most of its limits, but for the few nodes left out beside a stop."""
        return float(self.law.u[min(int(self.used.slowdown.argmax()), self.law.u.size - 1)])

    def is_better_than(self, other: Round, task: Task) -> bool:
        """Forward first; then sooner, or where nothing may be slowed down, closer to its limits."""
        if self.forward != other.forward:
            return self.forward
        if task.prescribed:
            return self.slowdown < other.slowdown
        return bool(self.law.t[-1] < other.law.t[-1])

    def is_accepted(self, task: Task, accepted: float) -> bool:
        """It keeps its limits as it is, or up to so much slowing down where it may be slowed down."""
        return self.forward and self.slowdown <= (_MET if task.prescribed else 1.0 + accepted)

    def is_too_coarse(self, effort: Effort) -> bool:
        """The grid should be refined rather than the limits tightened."""
        limit = TOO_COARSE if effort.free else HOPELESS
        return not self.forward or self.slowdown > (limit if self.number < TIGHTENING_ROUNDS else WORTH_SAYING)


def _require_met(task: Task, best: Round) -> None:
    """Refuse a plan that exceeds its limits and cannot be slowed down, since its feeds are prescribed."""
    if task.prescribed and best.slowdown > ALMOST_MET:
        raise SolverError(not_met(task.section, best.slowdown))


def not_met(section: Section, slowdown: float) -> str:
    """Say that a plan with prescribed feeds exceeds its limits."""
    return (
        f"the plan from start_feed = {feed_at(section.start):g} to end_feed = {feed_at(section.end):g} mm/s "
        f"between u = {section.u_start:.9g} and {section.u_end:.9g} still exceeds its limits, {slowdown:.9g} times as "
        "fast as allowed; try other feeds or more intervals"
    )


def _apart_from_stops(section: Section, law: TimeLaw) -> NDArray[np.intp]:
    """Nodes that are not a stop but for rounding: who reads a table takes what is so close to a stop for the stop."""
    inside = np.ones(law.t.size, dtype=np.bool_)
    least = _ON_STOP * (section.curve.domain[1] - section.curve.domain[0])
    if isinstance(section.start, Rest):
        inside[1:-1] &= law.u[1:-1] - section.u_start > least
    if isinstance(section.end, Rest):
        inside[1:-1] &= section.u_end - law.u[1:-1] > least
    return np.flatnonzero(inside)
