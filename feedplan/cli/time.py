"""How long each line of a part program takes: ``feedplan time``."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import options
from feedplan.cli.app import BROKEN, notice, require_apart, require_outputs, show
from feedplan.cli.streams import Streams
from feedplan.job import Job, load_job
from feedplan.sources import require_program
from planner.files.formats import ANY_COLUMN_FORMAT

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind, PathSide
    from planner.profile import FeedrateProfile
    from planner.programs.times import LineTimes
    from planner.verify import Report

_ROWS = 12
_DIGITS = 4  # behind the point of the seconds that are shown


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan time part.ngc --machine mill.toml\n"
        "  feedplan time part.ngc --machine machine.ini --tolerance-mm 0.01 -o lines.csv\n"
        "  feedplan time part.ngc --machine mill --rows 0 --tolerances-um\n"
    ),
)
@options.program
@options.machine
@options.tolerance
@options.tolerances
@options.tools
@options.ignore
@options.reader
@options.path
@options.side
@click.option("--feed-mm-s", type=float, help="Largest feed, in place of the machine's.")
@click.option("--rows", type=click.IntRange(min=0), default=_ROWS, help="How many of the longest lines to print.")
@click.option("--output", "-o", type=options.FILE, help=f"Every line, {ANY_COLUMN_FORMAT}.")
@options.as_json
def time(
    program: str,
    *,
    machine: str | None,
    complete: dict[str, float],
    tolerance_mm: float | None,
    tolerances: tuple[float, ...] | None,
    tools: Path | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    side: PathSide | None,
    feed_mm_s: float | None,
    rows: int,
    output: Path | None,
    as_json: bool,
) -> None:
    """Tell the time of each line of a part program, and of all.

    Beside it, the least time of the same path without a jerk limit, and with --tolerances-um what another tolerance saves.
    Dwells and tool changes count apart.  Exit code 1: a plan breaks a limit.
    """
    with Streams() as at:
        program, output = at.program(program), at.output(output, ".csv")
        require_program(program, "feedplan time")
        require_apart([output], [program, machine])
        require_outputs(output, None)
        given: dict[str, Any] = {
            "complete": complete, "feed": feed_mm_s, "tools": tools, "ignore": ignore, "reader": reader,
            "path": path,
            "side": side,
        }  # fmt: skip
        job = load_job(program, machine, tolerance=tolerance_mm, notice=notice, **given)
        from feedplan.progress import ProgressLine
        from feedplan.tolerances import ToleranceTime, time_of_tolerances, tolerance_facts, tolerance_lines
        from planner.programs.times import write_line_times

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
            now, others = ToleranceTime.of(job.path, profile, report), None
            if tolerances is not None:
                others = time_of_tolerances(program, machine, tolerances, progress=line, **given)
        if as_json:
            facts = _time_facts(job, at.told(program), times, without, report)
            if others is not None:
                facts["tolerances"] = tolerance_facts(now, others)
            click.echo(json.dumps(facts, indent=2, allow_nan=False), err=at.taken)
        else:
            file = "" if output is None else at.told(str(output))
            text = _times_text(job, profile, times, without, report, rows, file)
            show(text if others is None else [*text, "", *tolerance_lines(now, others)], aside=at.taken)
        if not report.ok or any(row.breaks for row in others or ()):
            raise click.exceptions.Exit(BROKEN)


def _times_text(
    job: Job,
    profile: FeedrateProfile,
    times: LineTimes,
    without: LineTimes,
    report: Report,
    rows: int,
    file: str,
) -> list[str]:
    """The longest lines, the totals, and what the jerk limit costs."""
    from feedplan.layout import BOLD, RED, named, styled
    from feedplan.verdict_text import fact_lines, held_back, machine_line, program_lines

    if job.path is None:
        raise AssertionError("only a part program has lines")
    parts = [
        *fact_lines(job.facts),
        *program_lines(job.path),
        *machine_line(job.machine, job.limits, job.curve),
        "",
        *_line_table(times, without, rows),
        "",
        *named("motion", f"{times.moving:.6g} s", BOLD),
    ]
    if times.dwelling:
        parts += named("dwells", f"{times.dwelling:.6g} s more")
    if times.changes:
        parts += named("tool changes", f"{times.changes}; the program does not say how long they take")
    parts += [
        *named("jerk limit", _cost(times, without, job.limits.has_jerk)),
        *held_back(profile),
        *fact_lines(("note", note) for note in job.path.notes),
    ]
    if file:
        parts += named("written", file)
    if not report.ok:
        worst = max(report.violations, key=lambda row: row.ratio)
        text = f"LIMIT BROKEN  {worst.limit} {worst.axis}: {worst.ratio:.6g} times what is allowed"
        parts.append(styled(text, RED))
    return parts


def _line_table(times: LineTimes, without: LineTimes, shown: int) -> list[str]:
    """Lay the longest lines out, with what the others take together and the total."""
    import numpy as np

    from feedplan.layout import table
    from planner.programs.times import KINDS

    # Lines of which the same time is shown stand in the order of the program.
    order = np.argsort(-np.round(times.seconds + times.dwell, _DIGITS), kind="stable")
    groups = [order[k : k + 1] for k in range(min(shown, order.size))]
    if order.size > shown:
        groups.append(order[shown:])
    groups.append(order)
    columns: dict[str, list[str]] = {
        "line": [
            *(str(times.line[group[0]]) for group in groups[: min(shown, order.size)]),
            *([f"{order.size - shown} others"] if order.size > shown else []),
            "all",
        ],
        "kind": [KINDS[times.kind[group[0]]] if group.size == 1 else "" for group in groups],
        "mm": [f"{times.length[group].sum():.3f}" for group in groups],
        "seconds": [f"{math.fsum(times.seconds[group]):.{_DIGITS}f}" for group in groups],
        "no jerk\nlimit": [f"{math.fsum(without.seconds[group]):.{_DIGITS}f}" for group in groups],
    }
    single = [int(group[0]) if group.size == 1 and times.seconds[group[0]] > 0.0 else -1 for group in groups]
    columns["held back by"] = ["" if k < 0 else _limit_name(times, k) for k in single]
    columns["share"] = ["" if k < 0 or not times.binding[k] else f"{100.0 * times.share[k]:.0f}%" for k in single]
    if times.dwell.any():
        dwells = [float(times.dwell[group].sum()) for group in groups]
        columns["dwell\ns"] = [f"{dwell:.4g}" if dwell else "" for dwell in dwells]
    if times.changes:
        changes = [int(times.tool_changes[group].sum()) for group in groups]
        columns["tool\nchanges"] = [str(count) if count else "" for count in changes]
    return table(list(columns), list(zip(*columns.values(), strict=True)), left=("kind", "held back by"))


def _limit_name(times: LineTimes, row: int) -> str:
    return times.limit_names[times.binding[row]] if times.binding[row] else "no limit"


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


def _time_facts(job: Job, program: str, times: LineTimes, without: LineTimes, report: Report) -> dict[str, Any]:
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
    return {
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
