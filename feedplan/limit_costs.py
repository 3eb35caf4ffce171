"""What each limit of a machine costs a part program: the time of its plan with that limit raised, the others as they are.

for row in limit_costs(job, profile):
    print(row.limit, row.saved_s)

Path and feed are found again under the limits raised, so what is told is measured, not estimated: a limit that stops binding
on the way saves no more than that, and a path that may turn faster is another path.  Two limits that bind together, as those
of two axes on a line at 45 degrees, may each save nothing alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from feedplan.job import Job
from feedplan.sources import SourceCurve, widened
from planner.errors import CurveError, InfeasibleError, InputError, SolverError
from planner.quantity import FEED, NONE

if TYPE_CHECKING:
    from planner.machine.limits import Limits
    from planner.profile import FeedrateProfile
    from planner.types import Progress

MORE = 0.1
"""By how much a limit is raised."""
_ASKED = 0.005  # of the time that a limit holds back: less is not asked for


@dataclass(frozen=True)
class LimitCost:
    """A part program planned with one limit raised.

    Attributes
    ----------
    limit : str
        By the names of ``FeedrateProfile.limit_names``; "feed" is what is commanded: F words, and the machine's feed and
        rapids.
    saved_s : float
        Seconds by which the plan is sooner done; nan where there is no such plan.
    ok : bool
        There is a plan, and it keeps every limit.
    reason : str
        Why there is none, or which limit it breaks; empty where it keeps all.
    """

    limit: str
    saved_s: float = math.nan
    ok: bool = False
    reason: str = ""


def limit_costs(
    job: Job, profile: FeedrateProfile, *, more: float = MORE, progress: Progress | None = None
) -> tuple[LimitCost, ...]:
    """Plan a part program again with each limit raised that holds it back, one after the other.

    Parameters
    ----------
    job : Job
        Of a part program.
    profile : FeedrateProfile
        Its plan.
    more : float
        By which share a limit is raised.
    progress : callable, optional
        Is told which limit is raised, and which share of them is done.

    Returns
    -------
    tuple of LimitCost
        A row for each limit that holds the program back for half a percent of the time or more, the longest first.

    Raises
    ------
    InputError
        If the job is of no part program.
    """
    names = [name for name, share in profile.shares().items() if name != NONE and share >= _ASKED]
    found = []
    for k, name in enumerate(names):
        if progress is not None:
            progress(f"planning with {100.0 * more:g}% more {name}", k / len(names))
        try:
            raised = raised_job(job, name, 1.0 + more)
            plan = raised.plan()
        except (CurveError, InfeasibleError, SolverError) as error:
            found.append(LimitCost(name, reason=str(error)))
            continue
        report = raised.check(plan)
        reason = "" if report.ok else report.summary()
        found.append(LimitCost(name, profile.duration - plan.duration, report.ok, reason))
    return tuple(found)


def raised_job(job: Job, limit: str, factor: float) -> Job:
    """The same program on a machine with one limit raised; its path is found again.

    Raises InputError where the job is of no part program, or the limit is none.
    """
    from planner.programs.source import path_of

    within = job.curve.made_within
    if job.program is None or within is None:
        raise InputError(f"{job.curve.name} is no part program; what its limits cost is told of one")
    program = job.program
    limits: Limits = job.limits.raised(limit, factor)
    if limit == FEED.label:
        program = replace(program, feed=factor * program.feed)
    path = path_of(program, widened(limits, program.axes), within.mm, within.share, path=within.path, side=within.side)
    return Job.of(SourceCurve(path.curve, job.room, job.facts, program, path), limits, job.machine, job.setup)
