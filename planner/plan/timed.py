"""Sections of a curve of which the feed was found together with the path: their laws are taken as they are.

Found for the same limits they are at an optimum of more than the feed: no plan of the path alone is faster by more than the
solvers leave.  What they use of the limits was measured where they were found; they are slowed down by what that leaves to
rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.law import TimeLaw, Timing
from planner.machine.feed_limits import osculating_limits
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


@dataclass(frozen=True, eq=False)
class TimedCut:
    """A path cut at its stops, but not inside of what has a law.

    Attributes
    ----------
    curve : Curve
    limits : Limits
    timing : Timing
    stops : mapping of float to float
        Parameters, each with the radius of a bend whose tip it is, or 0.
    start, end : Rest, Feed or Free
    """

    curve: Curve
    limits: Limits
    timing: Timing
    stops: Mapping[float, float]
    start: End
    end: End

    @classmethod
    def of(cls, curve: Curve, timing: Timing, limits: Limits, start: End, end: End, *, exact_stop: bool) -> TimedCut:
        """Look for stops outside of the laws only."""
        ends = {float(law.u[k]) for law in timing.laws for k in (0, -1)}
        inner = {u: 0.0 for u in ends if curve.domain[0] < u < curve.domain[1]}
        if len(timing.laws) <= len(inner):
            stops = exact_stops(curve, limits, axis_weights(limits), at_jumps=exact_stop)
            inner |= {u: bend for u, bend in stops.items() if not timing.covers(u)}
        return cls(curve, limits, timing, inner, start, end)

    @property
    def covers_all(self) -> bool:
        """Every section has a law."""
        return len(self.timing.laws) == len(self.stops) + 1

    @property
    def sections(self) -> list[Section]:
        """The sections; those with a law have no coordinate yet, which takes long and only a bound asks for."""
        edges = [self.curve.domain[0], *sorted(self.stops), self.curve.domain[1]]
        with_law = [self.timing.between(*ends) is not None for ends in pairwise(edges)]
        whole = [] if all(with_law) else self.whole
        return [
            Section(self.curve, *ends, REST, REST, None) if timed else whole[k]
            for k, (ends, timed) in enumerate(zip(pairwise(edges), with_law, strict=True))
        ]

    @cached_property
    def whole(self) -> list[Section]:
        """The sections, each with its coordinate."""
        return sections_between(self.curve, self.limits, self.stops, self.start, self.end)

    def plan(self, number: int, law: TimeLaw) -> SectionPlan:
        """Take a law as the plan of a section."""
        intervals = law.t.size - 1
        # A bound takes it that a plan has no acceleration where it stops.
        turns = bool(((law.u_rate[1:-1] == 0.0) & (law.u_acceleration[1:-1] != 0.0)).any())
        bound = None if turns else TimedBound(self, number, law)
        return SectionPlan(law.dilated(1.0 + PEAK_MARGIN), bound, Status.OPTIMAL, Work(intervals=intervals))


@dataclass(frozen=True, eq=False)
class TimedBound:
    """The lower bound of a section that has a law, once somebody asks for it."""

    cut: TimedCut
    number: int
    law: TimeLaw

    def __call__(self) -> float:
        """Compute the bound, s."""
        law, section = self.law, self.cut.whole[self.number]
        limits = osculating_limits(self.cut.curve, self.cut.limits)
        return SectionBound(section, limits, law.t.size - 1, Pace(law.u, law.t))()
