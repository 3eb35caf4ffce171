"""How long a part program takes: all of it, and every line.

found = time_program("part.ngc", "mill.toml", tool_change_s=8.0)
print(found.total_s, found.motion_s, found.dwell_s, found.shares)

:class:`ProgramTime` is plain data: it can be sent to another process, and text and JSON are made of it (``time_text``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from feedplan.job import Job, load_job
from feedplan.sources import Pairs, require_program
from feedplan.tolerances import ToleranceTime
from planner.errors import InputError
from planner.programs.times import LineTimes, write_line_times

if TYPE_CHECKING:
    from planner.machine.limits import Limits
    from planner.machine.machine_table import Machine
    from planner.profile import FeedrateProfile
    from planner.types import Progress
    from planner.verify import Report


@dataclass(frozen=True, eq=False)
class ProgramTime:
    """The time of a part program.

    Attributes
    ----------
    program, machine : str
        The file, and where the limits come from.
    ok : bool
        The plan keeps every limit.
    verdict : str
        What the check of the plan says.
    worst : str
        The limit that the plan breaks most, and by how much; empty where it keeps all.
    motion_s, dwell_s : float
        Duration of the plan, and of the dwells beside it, s.
    tool_changes : int
    tool_change_s : float, optional
        Of one, s; None where nobody said it: then they are not in ``total_s``.
    lines, without_jerk : LineTimes
        Every line, with the limits of the machine, and without its jerk limit.
    jerk_limited : bool
        The machine has a jerk limit.
    shares : mapping of str to float
        Share of the motion's time during which each limit holds the program back; they add up to 1.
    saved_by_one_percent : mapping of str to float
        Seconds that one percent more of a limit saves, to first order.
    planned : ToleranceTime
        The tolerance in force, and what the path does with it.
    facts : pairs of str
        What a person reads of program, path and machine, each with its name.
    path_facts : mapping
        Of the path, for JSON: tolerance, deviation, stops.
    notes : tuple of str
    """

    program: str
    machine: str
    ok: bool
    verdict: str
    worst: str
    motion_s: float
    dwell_s: float
    tool_changes: int
    tool_change_s: float | None
    lines: LineTimes
    without_jerk: LineTimes
    jerk_limited: bool
    shares: Mapping[str, float]
    saved_by_one_percent: Mapping[str, float]
    planned: ToleranceTime
    facts: Pairs
    path_facts: Mapping[str, Any]
    notes: tuple[str, ...]

    @property
    def total_s(self) -> float:
        """Motion, dwells, and tool changes where their time is known, s."""
        return self.motion_s + self.dwell_s + self.tool_changes * (self.tool_change_s or 0.0)

    @property
    def jerk_share(self) -> float:
        """What the jerk limit costs, as a share of the time without it; nan where that is 0."""
        least = self.without_jerk.moving
        return self.motion_s / least - 1.0 if least > 0.0 else math.nan

    def write_lines(self, file: Path) -> None:
        """Write every line, as :func:`planner.programs.times.write_line_times` does."""
        write_line_times(file, self.lines, self.program, self.verdict, without_jerk=self.without_jerk)


def time_program(
    program: str | Path,
    machine: str | Path | Limits | Machine | None = None,
    *,
    tool_change_s: float | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> ProgramTime:
    """Plan a part program, check the plan, and say how long it takes and what holds it back.

    Parameters
    ----------
    program : str or Path
    machine : str, Path, Limits or Machine, optional
        As for :func:`load_job`.
    tool_change_s : float, optional
        Time of a tool change, s, in place of what the machine file says.
    progress : callable, optional
        Is told what is being done.
    options
        As for :func:`load_job`: ``tolerance``, ``feed``, ``tools``, ``ignore``, ``reader``, ``path``, ``side``,
        ``complete``, ``notice``.

    Raises
    ------
    InputError
        If something given is not as it must be.
    InfeasibleError, SolverError
        If there is no plan.
    """
    require_program(program, "the time of a program")
    change = _seconds(tool_change_s, "tool_change_s")
    say = progress or _silent
    job = load_job(program, machine, **options)
    profile = plain = job.plan(say)
    if job.limits.has_jerk:
        say("planning without a jerk limit", None)
        # A plan with a jerk limit is also one without.
        plain = min(job.without_jerk().plan(say), profile, key=lambda plan: plan.duration)
    say("checking the plan", None)
    report = job.check(profile)
    if change is None and job.setup is not None:
        change = job.setup.rests.tool_change
    return _program_time(str(program), job, (profile, plain), report, change)


def _program_time(
    program: str, job: Job, plans: tuple[FeedrateProfile, FeedrateProfile], report: Report, change: float | None
) -> ProgramTime:
    from feedplan.verdict import program_facts
    from feedplan.verdict_text import machine_pair, program_pairs

    if job.path is None:
        raise AssertionError("only a part program has lines")
    profile = plans[0]
    times, without = job.line_times(profile), job.line_times(plans[1])
    worst = ""
    if not report.ok:
        row = max(report.violations, key=lambda row: row.ratio)
        worst = f"{row.limit} {row.axis}".rstrip() + f": {row.ratio:.6g} times what is allowed"
    return ProgramTime(
        program=program,
        machine=job.machine,
        ok=report.ok,
        verdict=report.summary(),
        worst=worst,
        motion_s=times.moving,
        dwell_s=times.dwelling,
        tool_changes=times.changes,
        tool_change_s=change,
        lines=times,
        without_jerk=without,
        jerk_limited=job.limits.has_jerk,
        shares=profile.shares(),
        saved_by_one_percent=dict(profile.saved_by_one_percent),
        planned=ToleranceTime.of(job.path, profile, report),
        facts=(*job.facts, *program_pairs(job.path), machine_pair(job.machine, job.limits, job.curve)),
        path_facts=program_facts(job.path),
        notes=tuple(job.path.notes),
    )


def _seconds(value: float | None, name: str) -> float | None:
    """A time that is given, s, at least 0; None stays None."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
        raise InputError(f"{name} = {value!r} must be a finite number of at least 0, in s")
    return float(value)


def _silent(message: str, fraction: float | None = None) -> None:
    """Show no progress."""
