"""How long a part program takes: all of it, its operations, its tools, and every line.

found = time_program("part.ngc", "mill.toml", tool_change_s=8.0)
print(found.total_s, found.motion_s, found.dwell_s, found.shares)

:class:`ProgramTime` is plain data: it can be sent to another process, and text and JSON are made of it (``time_text``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from feedplan.job import Job, load_job
from feedplan.limit_costs import LimitCost, limit_costs
from feedplan.sources import Pairs, require_program
from feedplan.tolerances import ToleranceTime
from planner.errors import FeedrateError, InputError
from planner.machine.program_setup import RestTimes
from planner.programs.line_table import write_line_times
from planner.programs.operations import Division, SectionTime, operation_sections, tool_sections
from planner.programs.program_text import ProgramText
from planner.programs.reading.setup import read_tool_table
from planner.programs.schedule import Schedule
from planner.programs.times import LineTimes, held_seconds, move_edges
from planner.programs.tool_names import tool_names

if TYPE_CHECKING:
    from planner.machine.limits import Limits
    from planner.machine.machine_table import Machine
    from planner.profile import FeedrateProfile
    from planner.types import Progress
    from planner.verify import Report

_WAITS = {"stop", "optional_stop"}


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
    tool_changes, spindle_starts : int
    rests : RestTimes
        What one of these takes, s; None where nobody said it: then they are not in ``total_s``.
    waits : int
        M0, M1 and M60, where a person goes on: not in ``total_s``.
    operations, tools : tuple of SectionTime
        In the order of the run; without comments on operations these are the tools.
    named : bool
        The operations are those of comments.
    lines : LineTimes
        Every line, with the limits of the machine.
    without_jerk : LineTimes or None
        The same without its jerk limit; None where nobody asked, or no such plan was found.
    why_none : str
        Why there is none; empty where there is one, or nobody asked.
    jerk_limited : bool
        The machine has a jerk limit.
    shares : mapping of str to float
        Share of the motion's time during which each limit holds the program back; they add up to 1.
    saved_by_one_percent : mapping of str to float
        Seconds that one percent more of a limit saves on this path, to first order; empty where the path was found with
        its feed.
    costs : tuple of LimitCost
        What each limit costs, measured; empty where nobody asked.
    planned : ToleranceTime
        The tolerance in force, and what the path does with it.
    facts : pairs of str
        What a person reads of program, path and machine, each with its name.
    path_facts : mapping
        Of the path, for JSON: tolerance, deviation, stops.
    notes : tuple of str
    text : ProgramText
        The program as it stands.
    """

    program: str
    machine: str
    ok: bool
    verdict: str
    worst: str
    motion_s: float
    dwell_s: float
    tool_changes: int
    spindle_starts: int
    rests: RestTimes
    waits: int
    operations: tuple[SectionTime, ...]
    tools: tuple[SectionTime, ...]
    named: bool
    lines: LineTimes
    without_jerk: LineTimes | None
    why_none: str
    jerk_limited: bool
    shares: Mapping[str, float]
    saved_by_one_percent: Mapping[str, float]
    costs: tuple[LimitCost, ...]
    planned: ToleranceTime
    facts: Pairs
    path_facts: Mapping[str, Any]
    notes: tuple[str, ...]
    text: ProgramText

    @property
    def total_s(self) -> float:
        """Motion, dwells, and tool changes and spindle starts where their time is known, s."""
        return self.lines.total

    @property
    def tool_change_s(self) -> float | None:
        """Of one tool change, s; None where nobody said it."""
        return self.rests.tool_change

    @property
    def change_s(self) -> float:
        """Time of all tool changes, s; 0 where nobody said it."""
        return self.tool_changes * (self.rests.tool_change or 0.0)

    @property
    def spindle_s(self) -> float:
        """Time of all spindle starts, s; 0 where nobody said it."""
        return self.spindle_starts * (self.rests.spindle_start or 0.0)

    @property
    def jerk_share(self) -> float:
        """What the jerk limit costs, as a share of the time without it; nan where that is 0 or not known."""
        least = 0.0 if self.without_jerk is None else self.without_jerk.moving
        return self.motion_s / least - 1.0 if least > 0.0 else math.nan

    def write_lines(self, file: Path) -> None:
        """Write every line, as :func:`planner.programs.line_table.write_line_times` does."""
        write_line_times(file, self.lines, self.program, self.verdict, without_jerk=self.without_jerk, text=self.text)


def time_program(
    program: str | Path,
    machine: str | Path | Limits | Machine | None = None,
    *,
    tool_change_s: float | None = None,
    costs: bool = False,
    without_jerk: bool = True,
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
    costs : bool
        Also plan the program with each limit raised, which takes as long for each as the plan itself.
    without_jerk : bool
        Also plan its path without a jerk limit, for what this limit costs.
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
    text = ProgramText.read(program)
    profile = job.plan(say)
    plain = _without_jerk(job, profile, say) if without_jerk else ""
    say("checking the plan", None)
    report = job.check(profile)
    rests = job.rests if change is None else replace(job.rests, tool_change=change)
    tools = options.get("tools") or (None if job.setup is None else job.setup.tools)
    worth = limit_costs(job, profile, progress=progress) if costs else ()
    return _program_time(str(program), job, profile, plain, report, _Sources(text, rests, tools, worth))


def _without_jerk(job: Job, profile: FeedrateProfile, say: Progress) -> FeedrateProfile | str:
    """The plan without a jerk limit, or why there is none: it only tells what the limit costs."""
    if not job.limits.has_jerk:
        return profile
    say("planning without a jerk limit", None)
    try:
        # A plan with a jerk limit is also one without.
        return min(job.without_jerk().plan(say), profile, key=lambda plan: plan.duration)
    except FeedrateError as error:
        return str(error)


@dataclass(frozen=True)
class _Sources:
    """What is told beside the plan: the program's text, the machine's rests, the tool table, what limits cost."""

    text: ProgramText
    rests: RestTimes
    tools: str | Path | None
    costs: tuple[LimitCost, ...]


def _program_time(
    program: str, job: Job, profile: FeedrateProfile, plain: FeedrateProfile | str, report: Report, given: _Sources
) -> ProgramTime:
    from feedplan.verdict import program_facts
    from feedplan.verdict_text import machine_pair, program_pairs

    path, source = job.path, job.program
    if path is None or source is None:
        raise AssertionError("only a part program has lines")
    times = job.line_times(profile, given.rests)
    edges = move_edges(path, profile)
    run = Schedule.of(source, np.diff(edges), given.rests)
    names = tool_names(source, given.text, None if given.tools is None else read_tool_table(given.tools))
    by_tool = tool_sections(source, run, names)
    by_operation = operation_sections(source, run, given.text, by_tool)

    def timed(sections: Division) -> tuple[SectionTime, ...]:
        held = held_seconds(profile, edges, sections.of_move, len(sections.names))
        return sections.times(source, run, held)

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
        spindle_starts=sum(rest.kind == "spindle" for rest in run.rests),
        rests=given.rests,
        waits=sum(event.kind in _WAITS for event in source.events),
        operations=timed(by_operation or by_tool),
        tools=timed(by_tool),
        named=by_operation is not None,
        lines=times,
        without_jerk=None if isinstance(plain, str) else job.line_times(plain, given.rests),
        why_none=plain if isinstance(plain, str) else "",
        jerk_limited=job.limits.has_jerk,
        shares=profile.shares(),
        saved_by_one_percent=dict(profile.saved_by_one_percent),
        costs=given.costs,
        planned=ToleranceTime.of(path, profile, report),
        facts=(*job.facts, *program_pairs(path), machine_pair(job.machine, job.limits, job.curve)),
        path_facts=program_facts(path),
        notes=tuple(path.notes),
        text=given.text,
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
