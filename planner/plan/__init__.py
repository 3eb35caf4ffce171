"""Plan a feedrate: validate, cut at the stops, plan each section, and hand over a profile.

A section runs from stop to stop, or from an end that has a feed; ``refine.py`` plans one.  What leaves here keeps every
limit everywhere, not only at the points at which a solver looked.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from planner.errors import CurveError, InfeasibleError, InputError, SolverError
from planner.geometry.curve import Curve
from planner.geometry.differential import arc_derivatives
from planner.inputs import require_flag
from planner.law import TimeLaw
from planner.machine.feed_limits import feedrate_limits
from planner.machine.limits import Limits, require_limits
from planner.origin import Origin
from planner.plan.bounds import MAX_INTERVALS, PlanBound, SectionBound
from planner.plan.chord_errors import slowed_for_chords
from planner.plan.coarse import MIN_INTERVALS, Effort
from planner.plan.dual.problem import Pace
from planner.plan.ends import FREE, end_with, feed_at
from planner.plan.guard import explained, require_law
from planner.plan.refine import (
    ALMOST_MET,
    PEAK_MARGIN,
    SectionPlan,
    hold_chords,
    not_met,
)
from planner.plan.refine import plan_section as plan_and_refine
from planner.plan.section import Section, cut
from planner.plan.stage import WORTH_SAYING
from planner.plan.timed import TimedCut, laws_for, require_rests
from planner.plan.utilisation import utilisation
from planner.profile import FeedrateProfile, make_profile
from planner.quantity import ACCELERATION, TANGENTIAL_ACCELERATION
from planner.status import Claim, Status, Work
from planner.types import FloatArray, Progress

Method = Literal["optimal", "nlp", "toppra", "scurve"]

_MAX_SHARE = 1.0 - 1e-6  # of an acceleration at the start: the solver begins inside its limits
_HARDLY_A_PLAN = 10.0  # of slowing down as a whole


def plan_feedrate(
    curve: Curve,
    limits: Limits,
    *,
    method: Method = "optimal",
    start_feed: float = 0.0,
    end_feed: float = 0.0,
    start_acceleration: float | None = None,
    periodic: bool = False,
    budget: float = np.inf,
    intervals: int | None = None,
    exact_stop: bool = False,
    reserve: Sequence[tuple[float, float]] = (),
    override_reserve: float = 0.0,
    progress: Progress | None = None,
) -> FeedrateProfile:
    """Find the feedrate profile that finishes the curve soonest within the limits.

    Parameters
    ----------
    curve : Curve
    limits : Limits
        One value for each axis of the curve.
    method : {"optimal", "nlp", "toppra", "scurve"}
        ``optimal``: the jerk-limited optimum by our interior-point method.  ``nlp``: the same problem by CasADi and
        IPOPT, the reference.  ``toppra``: without a jerk limit, to compare with.  ``scurve``: jerk-limited S-curves
        between the feed minima, what industry does today.
    start_feed, end_feed : float
        Tip feed at the ends, mm/s; 0 is rest.
    start_acceleration : float, optional
        Tangential acceleration of the tip at a start with a feed, mm/s^2, where a plan continues another one; free if left
        out (methods ``optimal`` and ``nlp``), and without any jerk limit, under which it may step.
    periodic : bool
        The closed curve is run continuously: same feed and acceleration at both ends, free value.
    budget : float
        Computing time after which the best plan so far is returned, s (method ``optimal``).
    intervals : int, optional
        Number of intervals of the grid, shared out among the sections between exact stops.  If left out, as many as the
        features of the curve need, refined wherever no limit binds.
    exact_stop : bool
        Stop at curvature discontinuities instead of passing them slowly.
    reserve : sequence of (u, share)
        Leave a share of the limits unused from each parameter on, in increasing order, so that another plan may go on from
        there: its solver needs room around the state it begins with (methods ``optimal`` and ``nlp``).
    override_reserve : float
        Leave this share of every jerk limit, and a third of it of every acceleration limit, for feed override and feed hold
        while the plan runs, 0 to 0.5.  The plan remembers it; its ``limits`` are what it may use.
    progress : callable, optional
        Called with a message and the share done (or None).

    Returns
    -------
    FeedrateProfile

    Raises
    ------
    InputError
        If an argument is not allowed.
    InfeasibleError
        If the limits and the prescribed feeds contradict each other.
    SolverError
        If no plan was found.
    """
    began = time.perf_counter()
    limits = require_limits(curve, limits)
    if override_reserve:
        limits = limits.with_reserve(override_reserve)
    periodic, exact_stop = require_flag(periodic, "periodic"), require_flag(exact_stop, "exact_stop")
    _validate(curve, limits, method, start_feed, end_feed, periodic, budget, intervals)
    if start_acceleration is not None:
        _require_continued(curve, limits, start_feed, start_acceleration, method)
    start, end = (FREE, FREE) if periodic else (end_with(start_feed, start_acceleration), end_with(end_feed))
    plain = method == "optimal" and intervals is None and not periodic and not reserve
    require_rests(curve, start, end)
    timing = laws_for(curve, limits) if plain else None
    around = None if timing is None else TimedCut.of(curve, timing, limits, start, end, exact_stop=exact_stop)
    sections = cut(curve, limits, start, end, exact_stop=exact_stop) if around is None else around.sections
    if reserve:
        begins = [u for u, _ in reserve]
        if begins != sorted(begins) or not all(0.0 <= share < 1.0 for _, share in reserve):
            raise InputError(f"reserve = {reserve!r} must be increasing parameters, each with a share in [0, 1)")
        sections = [replace(section, reserve=tuple(reserve)) for section in sections]
    if periodic and len(sections) > 1:
        raise InputError(
            f"periodic = True cannot pass the exact stop of {curve.name} at u = {sections[1].u_start:.6g}: let the curve "
            "begin there and plan it from stop to stop"
        )
    plans: list[SectionPlan] = []
    shares = np.zeros(len(sections)) if around is not None and around.covers_all else _shares(sections)
    for i, section in enumerate(sections):
        law = None if around is None else around.timing.between(section.u_start, section.u_end)
        if around is not None and law is not None:
            plans.append(around.plan(i, law))
            continue
        if progress is not None:
            progress(f"section {i + 1} of {len(sections)}", float(shares[:i].sum()))
        effort = Effort.for_share(intervals, float(shares[i]), section)
        try:
            plans.append(_plan_section(section, limits, method, periodic, began + budget, effort, progress))
        except SolverError as error:
            raise explained(curve, error, section.u_start, section.u_end) from None
        _require_worth(section, plans[-1], free=method == "optimal" and intervals is None)
    # Grids and solutions are not kept beside the profile that is made of their laws.
    plans = [replace(plan, outcome=None) for plan in _hold_chords(curve, limits, sections, plans)]
    law = TimeLaw.joined([plan.law for plan in plans])
    try:
        require_law(curve, law)
    except SolverError as error:
        raise explained(curve, error, *curve.domain) from None
    slowed = np.repeat([max(1.0, plan.work.slowdown) for plan in plans], [plan.law.t.size for plan in plans])
    profile = make_profile(
        curve,
        limits,
        law,
        method=method,
        slowed=slowed,
    )
    return replace(
        profile,
        lower_bound=PlanBound(tuple(plan.bound for plan in plans)),  # type: ignore[arg-type]  # computed on demand
        claim=Claim.COMPUTED,
        origin=Origin(limits.period, exact_stop, periodic, curve.made_within, override_reserve),
        status=next((plan.status for plan in plans if not plan.status.as_meant), plans[0].status),
        notes=_notes(sections, plans, limits),
        saved_by_one_percent=_saved(plans),
        work=Work.of_all((plan.work for plan in plans), time.perf_counter() - began),
    )


def _validate(
    curve: Curve,
    limits: Limits,
    method: str,
    start_feed: float,
    end_feed: float,
    periodic: bool,
    budget: float,
    intervals: int | None,
) -> None:
    if method not in get_args(Method):
        raise InputError(f"method = {method!r} must be one of {', '.join(get_args(Method))}")
    if not (isinstance(budget, int | float | np.number) and budget > 0.0):
        raise InputError(f"budget = {budget!r} s must be > 0")
    if intervals is not None:
        whole = isinstance(intervals, int | np.integer) and not isinstance(intervals, bool)
        if not whole:
            raise InputError(f"intervals = {intervals!r} must be a whole number")
        if not MIN_INTERVALS <= intervals <= MAX_INTERVALS:
            raise InputError(f"intervals = {intervals!r} must lie within [{MIN_INTERVALS}, {MAX_INTERVALS}]")
    if periodic:
        if method not in {"optimal", "nlp"}:
            raise InputError(f"periodic = True is planned by the methods optimal and nlp, not by {method!r}")
        _require_closed(curve, start_feed, end_feed)
    for name, feed, u in (("start_feed", start_feed, curve.domain[0]), ("end_feed", end_feed, curve.domain[1])):
        if not (isinstance(feed, int | float | np.number) and np.isfinite(feed) and feed >= 0.0):
            raise InputError(f"{name} = {feed!r} mm/s must be >= 0 and finite")
        if feed > 0.0:
            allowed = float(feedrate_limits(curve, limits, u).lowest)
            if feed > allowed:
                raise InfeasibleError(
                    f"{name} = {feed!r} mm/s is above the feed limit there, {allowed:.6g} mm/s (u = {u:.9g})"
                )


def _require_continued(curve: Curve, limits: Limits, start_feed: float, start_acceleration: float, method: str) -> None:
    if not np.isfinite(start_acceleration):
        raise InputError(f"start_acceleration = {start_acceleration!r} mm/s^2 must be finite")
    if start_feed == 0.0:
        raise InputError("start_acceleration needs a start_feed > 0; a path begins at rest without acceleration")
    if method not in {"optimal", "nlp"}:
        raise InputError(f"start_acceleration is kept by the methods optimal and nlp, not by {method!r}")
    if abs(start_acceleration) >= limits.tangential_acceleration * _MAX_SHARE:
        raise InfeasibleError(
            f"start_acceleration = {start_acceleration:g} mm/s^2 must stay below the {TANGENTIAL_ACCELERATION.label}, "
            f"{limits.tangential_acceleration:g} mm/s^2"
        )
    q, tip = (part.derivatives(curve.domain[0], 2) for part in (curve, curve.tip))
    speed = float(np.sqrt(tip[1] @ tip[1]))
    slope = q[1] / speed
    bend = (q[2] - slope * (tip[1] @ tip[2] / speed)) / speed**2
    of_axes = np.abs(slope * start_acceleration + bend * start_feed**2)
    for axis, size, most in zip(curve.axes, of_axes, limits.acceleration, strict=True):
        if size >= most * _MAX_SHARE:
            raise InfeasibleError(
                f"start_acceleration = {start_acceleration:g} mm/s^2 at {start_feed:g} mm/s takes {size:.9g} of "
                f"{ACCELERATION.of(axis)}, which must stay below {most:g}; lower it, or the feed"
            )


def _require_closed(curve: Curve, start_feed: float, end_feed: float) -> None:
    if start_feed or end_feed:
        raise InputError("periodic = True leaves the feed at the ends free; start_feed and end_feed must be 0")
    ends = [curve.derivatives(np.array([u]), 3)[:, 0] for u in curve.domain]
    gap = float(np.abs(ends[1][0] - ends[0][0]).max())
    size = float(np.abs(curve.derivatives(np.linspace(*curve.domain, 64), 0)[0] - ends[0][0]).max())
    if gap > 1e-9 * size:
        raise InputError(f"periodic = True needs a closed curve; the ends of {curve.name} are {gap:.3g} apart")
    directions = [end[1] / np.sqrt(np.sum(end[1] ** 2)) for end in ends]
    turn = float(np.abs(directions[1] - directions[0]).max())
    if turn > 1e-8:
        raise InputError(f"periodic = True needs a smooth seam; the tangent of {curve.name} turns by {turn:.3g} there")
    bends = [arc_derivatives(end[:, None])[2, 0] for end in ends]
    jump = float(np.abs(bends[1] - bends[0]).max())
    if jump > 1e-6 * max(float(np.abs(bends).max()), 1.0 / size):
        raise InputError(
            f"periodic = True needs a smooth seam; the curvature of {curve.name} jumps by {jump:.4g} 1/mm there: let the "
            "curve begin elsewhere"
        )


def _shares(sections: list[Section]) -> FloatArray:
    """Share of each section in the length of the tool path; of the parameter where the tip does not move."""
    if len(sections) == 1:
        return np.ones(1)
    u = np.array([section.u_start for section in sections] + [sections[-1].u_end])
    lengths = np.diff(sections[0].curve.arclength.s(u))
    lengths = lengths if lengths.sum() > 0.0 else np.diff(u)
    return np.asarray(lengths / lengths.sum())


def _plan_section(
    section: Section,
    limits: Limits,
    method: str,
    periodic: bool,
    deadline: float,
    effort: Effort,
    progress: Progress | None,
) -> SectionPlan:
    if method == "scurve":
        from planner.plan.solvers.scurve import plan_scurve

        feeds = (feed_at(section.start), feed_at(section.end))
        law = TimeLaw(*plan_scurve(section.curve, limits, section.u_start, section.u_end, *feeds))
        return SectionPlan(law, None, Status.FEASIBLE, Work(intervals=law.t.size - 1))
    if method != "toppra" and not limits.has_jerk:
        return _plan_without_jerk(section, limits, effort, periodic)
    if method == "toppra":
        from planner.plan.solvers.toppra import plan_toppra

        law = plan_toppra(section, limits, effort.intervals)
        work = Work(intervals=int(np.count_nonzero(np.diff(law.t))), iterations=1)
        notes: tuple[str, ...] = ()
        if not section.has_prescribed_feed:
            used = utilisation(section.curve, limits, law)
            slowdown = max(float(used.speed.max()), float(np.sqrt(used.acceleration.max())))
            law = law.dilated(max(1.0, slowdown * (1.0 + PEAK_MARGIN)))
            if slowdown > 1.0:
                work = replace(work, slowdown=slowdown)
                percent = 100.0 * (slowdown - 1.0)
                notes = (f"slowed down by {percent:.2g} % for what toppra exceeds between its points",)
        bound = SectionBound(section, limits.without_jerk(), effort.intervals, Pace(law.u, law.t))
        return SectionPlan(law, bound, Status.FEASIBLE, work, notes)
    return plan_and_refine(
        section,
        limits,
        method=method,
        periodic=periodic,
        deadline=deadline,
        effort=effort,
        progress=progress,
    )


def _plan_without_jerk(section: Section, limits: Limits, effort: Effort, periodic: bool) -> SectionPlan:
    """Plan one section without any jerk limit; what its law still exceeds of the others slows it down."""
    from planner.plan.solvers.accelerations import plan_without_jerk

    found = plan_without_jerk(section, limits, effort.intervals)
    law, unmet = found.law, found.unmet
    if not section.has_prescribed_feed:
        law = law.dilated(unmet * (1.0 + PEAK_MARGIN) if unmet > 1.0 else 1.0)
    elif unmet > ALMOST_MET:
        raise SolverError(not_met(section, unmet))
    bound = SectionBound(section, limits, effort.intervals, Pace(law.u, law.t), periodic=periodic)
    plan = SectionPlan(law, bound, Status.OPTIMAL, found.work, saved=found.saved)
    return plan.said_slowed(found.place)


def _require_worth(section: Section, plan: SectionPlan, *, free: bool) -> None:
    """Refuse a curve of which a plan must be run many times slower than it was solved, where the curve is the reason.

    Where refinement was ``free`` to choose the grid, the curve is the reason also where nothing about it stands out.
    """
    slowdown = plan.work.slowdown
    if slowdown <= _HARDLY_A_PLAN or section.has_prescribed_feed:
        return
    reason = explained(
        section.curve,
        SolverError(
            f"{section.curve.name}: what was found between u = {section.u_start:.9g} and {section.u_end:.9g} must be run "
            f"{slowdown:.3g} times slower than it was solved, which is hardly a plan"
        ),
        section.u_start,
        section.u_end,
    )
    if isinstance(reason, CurveError):
        raise reason
    if free:
        place = plan.outcome.best.place if plan.outcome else section.u_start
        raise CurveError(f"{reason}: near u = {place:.9g} no grid followed it; split the curve there")


def _hold_chords(curve: Curve, limits: Limits, sections: list[Section], plans: list[SectionPlan]) -> list[SectionPlan]:
    """Slow down the sections in which the true chord error is too large, and say so."""
    may_slow = np.array([not section.has_prescribed_feed for section in sections])
    factors = slowed_for_chords(curve, limits, [plan.law for plan in plans], may_slow)
    if (factors > 1.0).any():
        plans = [hold_chords(plan) if factor > 1.0 else plan for plan, factor in zip(plans, factors, strict=True)]
        factors = slowed_for_chords(curve, limits, [plan.law for plan in plans], may_slow)
    held = []
    for section, plan, factor in zip(sections, plans, factors, strict=True):
        if factor == 1.0:
            held.append(plan)
            continue
        percent = 100.0 * (factor - 1.0)
        note = (
            f"slowed down by {percent:.2g} % from u = {section.u_start:.6g} to {section.u_end:.6g} for its chord error, "
            "which the osculating circle does not tell where the curvature changes within a period"
        )
        held.append(
            replace(
                plan,
                law=plan.law.dilated(float(factor)),
                status=Status.SLOWED if factor > WORTH_SAYING else plan.status,
                work=replace(plan.work, slowdown=max(1.0, plan.work.slowdown) * float(factor)),
                notes=(*plan.notes, note),
                outcome=None,
            )
        )
    return held


def _notes(sections: list[Section], plans: list[SectionPlan], limits: Limits) -> tuple[str, ...]:
    """What a reader of the verdict should know of the path and of its plan."""
    notes = []
    for section in sections[1:]:
        bend = f", a bend of {section.bend:.3g} mm radius" if section.bend > 0.0 else ""
        notes.append(f"exact stop at u = {section.u_start:.6g}{bend}")
    for section in sections:
        notes += [
            f"curvature jumps by {b.curvature_jump:.4g} 1/mm at u = {b.u:.6g}: passed slowly, so that the samples at "
            f"{1e3 * limits.period:g} ms keep the jerk limit; exact_stop=True would stop there"
            for b in section.jumps
        ]
    for plan in plans:
        notes += plan.notes
    if not limits.has_jerk:
        notes.append("no jerk limit is set: planned without one, the acceleration may step")
    return tuple(notes)


def _saved(plans: list[SectionPlan]) -> dict[str, float]:
    """Time that one percent more of each limit saves, over all sections, most first."""
    saved: dict[str, float] = {}
    for plan in plans:
        for name, value in plan.saved.items():
            saved[name] = saved.get(name, 0.0) + value
    return dict(sorted(saved.items(), key=lambda item: -item[1]))
