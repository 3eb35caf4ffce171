"""How long each line of a part program takes: ``feedplan time``."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from feedplan.cli.app import (
    BROKEN,
    AsJson,
    Machine,
    Tolerance,
    app,
    exits,
    notice,
    require_apart,
    require_outputs,
    show,
)
from feedplan.cli.streams import Streams
from feedplan.job import Job, load_job
from feedplan.sources import require_program
from planner.files.formats import ANY_COLUMN_FORMAT

if TYPE_CHECKING:
    from rich.console import RenderableType

    from planner.profile import FeedrateProfile
    from planner.programs.times import LineTimes
    from planner.verify import Report

_ROWS = 12


@app.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan time part.ngc --machine mill.toml\n"
        "  feedplan time part.ngc --machine machine.ini --tolerance-mm 0.01 -o lines.csv\n"
    ),
)
def time(
    program: Annotated[str, typer.Argument(metavar="PROGRAM", help="Part program, .ngc.")],
    *,
    machine: Machine = None,
    tolerance_mm: Tolerance = None,
    feed_mm_s: Annotated[float | None, typer.Option(help="Largest feed, in place of the machine's.")] = None,
    rows: Annotated[int, typer.Option(min=0, help="How many of the longest lines to print.")] = _ROWS,
    output: Annotated[Path | None, typer.Option("--output", "-o", help=f"Every line, {ANY_COLUMN_FORMAT}.")] = None,
    as_json: AsJson = False,
) -> None:
    """Tell the time of each line of a part program, and of all.

    Beside it, the least time of the same path without a jerk limit.  Dwells and tool changes count apart.  Exit code 1:
    the plan breaks a limit.
    """
    with exits(), Streams() as at:
        program, output = at.program(program), at.output(output, ".csv")
        require_program(program, "feedplan time")
        require_apart([output], [program, machine])
        require_outputs(output, None)
        job = load_job(program, machine, feed=feed_mm_s, tolerance=tolerance_mm, notice=notice)
        from feedplan.progress import ProgressLine, load_kernels
        from planner.programs.times import write_line_times

        load_kernels()
        with ProgressLine() as line:
            profile = plain = job.plan(line)
            if job.limits.has_jerk:
                line("planning without a jerk limit")
                # A plan with a jerk limit is also one without.
                plain = min(job.without_jerk().plan(line), profile, key=lambda plan: plan.duration)
            line("checking the plan")
            report = job.check(profile)
            times, without = job.line_times(profile), job.line_times(plain)
            if output is not None:
                line(f"writing {output}")
                write_line_times(output, times, at.told(program), report.summary(), without_jerk=without)
        if as_json:
            typer.echo(_times_json(job, at.told(program), times, without, report), err=at.taken)
        else:
            file = "" if output is None else at.told(str(output))
            show(_times_text(job, profile, times, without, report, rows, file), aside=at.taken)
        if not report.ok:
            raise typer.Exit(BROKEN)


def _times_text(
    job: Job,
    profile: FeedrateProfile,
    times: LineTimes,
    without: LineTimes,
    report: Report,
    rows: int,
    file: str,
) -> RenderableType:
    """The longest lines, the totals, and what the jerk limit costs."""
    from rich.console import Group
    from rich.text import Text

    from feedplan.verdict_text import held_back, machine_line, named, program_lines
    from planner.programs.times import line_table

    if job.path is None:
        raise AssertionError("only a part program has lines")
    parts: list[RenderableType] = [
        *(named(name, text) for name, text in job.facts),
        *program_lines(job.path),
        machine_line(job.machine, job.limits, job.curve),
        "",
        line_table(times, without_jerk=without, rows=rows),
        "",
        named("motion", f"{times.moving:.6g} s", "bold"),
    ]
    if times.dwelling:
        parts.append(named("dwells", f"{times.dwelling:.6g} s more"))
    if times.changes:
        parts.append(named("tool changes", f"{times.changes}; the program does not say how long they take"))
    parts += [
        named("jerk limit", _cost(times, without, job.limits.has_jerk)),
        held_back(profile),
        *(named("note", note) for note in job.path.notes),
    ]
    if file:
        parts.append(named("written", file))
    if not report.ok:
        worst = max(report.violations, key=lambda row: row.ratio)
        parts.append(
            Text(f"LIMIT BROKEN  {worst.limit} {worst.axis}: {worst.ratio:.6g} times what is allowed", "bold red")
        )
    return Group(*parts)


def _cost(times: LineTimes, without: LineTimes, limited: bool) -> str:
    """What the jerk limit costs against the least time of the same path without one."""
    share = _cost_share(times, without)
    if not limited:
        return "none is set: the times are the least that the accelerations allow"
    return (
        f"costs {times.moving - without.moving:.4g} s or {100.0 * share:.1f}% of the {without.moving:.6g} s that the "
        "same path takes at best without one"
    )


def _cost_share(times: LineTimes, without: LineTimes) -> float:
    return times.moving / without.moving - 1.0 if without.moving > 0.0 else math.nan


def _times_json(job: Job, program: str, times: LineTimes, without: LineTimes, report: Report) -> str:
    """The same for a program, every line."""
    from feedplan.verdict import program_facts
    from planner.programs.times import KINDS

    if job.path is None:
        raise AssertionError("only a part program has lines")
    columns: dict[str, list[Any]] = {
        "line": times.line.tolist(),
        "kind": [KINDS[k] for k in times.kind],
        "length_mm": times.length.tolist(),
        "seconds": times.seconds.tolist(),
        "without_jerk_limit_s": without.seconds.tolist(),
        "held_back_by": [times.limit_names[k] for k in times.binding],
        "share": times.share.tolist(),
        "dwell_s": times.dwell.tolist(),
        "tool_changes": times.tool_changes.tolist(),
    }
    facts = {
        "ok": report.ok,
        "program": {"file": program, **program_facts(job.path)},
        "machine": job.machine,
        "motion_s": times.moving,
        "dwell_s": times.dwelling,
        "tool_changes": times.changes,
        "without_jerk_limit_s": without.moving,
        "jerk_limit_costs": _cost_share(times, without),
        "notes": list(job.path.notes),
        "lines": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
    }
    return json.dumps(facts, indent=2, allow_nan=False)
