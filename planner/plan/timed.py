"""Sections of a curve of which the feed was found together with the path: their laws are taken as they are.

Found for the same limits they are at an optimum of more than the feed: no plan of the path alone is faster by more than the
solvers leave.  What they use of the limits was measured where they were found; they are slowed down by what that leaves to
rounding.
"""

from __future__ import annotations

from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.law import TimeLaw, Timing
from planner.machine.limits import Limits
from planner.plan.bounds import SectionBound
from planner.plan.dual.problem import Pace
from planner.plan.ends import REST, End, Free, feed_at
from planner.plan.refine import PEAK_MARGIN, SectionPlan
from planner.plan.section import Section, axis_weights, sections_between
from planner.plan.stops import exact_stops
from planner.status import Status, Work


def require_rests(curve: Curve, start: End, end: End) -> None:
    """Refuse a feed at an end of a curve that was found with its feed from rest: next to it the path knows no other.

    The parameter goes like time there, and the path has no curvature but that of a start from rest.
    """
    if curve.timing is None:
        return
    u0, u1 = curve.domain
    for name, asked, found in (
        ("start_feed", start, any(law.u[0] == u0 for law in curve.timing.laws)),
        ("end_feed", end, any(law.u[-1] == u1 for law in curve.timing.laws)),
    ):
        if asked is not REST and found:
            what = "periodic = True" if isinstance(asked, Free) else f"{name} = {feed_at(asked):g} mm/s"
            raise InputError(
                f"{what} does not go with {curve.name}, which was found together with its feed and begins and ends at rest; "
                'make its path with path = "separate"'
            )


def laws_for(curve: Curve, limits: Limits) -> Timing | None:
    """What was found with a curve, where it serves for these limits."""
    timing = curve.timing
    return timing if timing is not None and timing.limits == limits else None


def cut_around(
    curve: Curve, timing: Timing, limits: Limits, start: End, end: End, *, exact_stop: bool
) -> list[Section]:
    """Cut a path as :func:`~planner.plan.section.cut` does, but not inside of what has a law."""
    stops = exact_stops(curve, limits, axis_weights(limits), at_jumps=exact_stop)
    outside = {u: bend for u, bend in stops.items() if not timing.covers(u)}
    return sections_between(curve, limits, outside, start, end)


def plan_timed(section: Section, limits: Limits, law: TimeLaw) -> SectionPlan:
    """Take a law as the plan of its section."""
    intervals = law.t.size - 1
    # A bound takes it that a plan has no acceleration where it stops.
    turns = any(b.is_corner and section.u_start < b.u < section.u_end for b in section.curve.breaks)
    bound = None if turns else SectionBound(section, limits, intervals, Pace(law.u, law.t))
    return SectionPlan(law.dilated(1.0 + PEAK_MARGIN), bound, Status.OPTIMAL, Work(intervals=intervals))
