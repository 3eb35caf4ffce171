"""What a shop asks of a part program: ``feedplan time`` and ``feedplan ngc``."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from feedplan.cli.app import (
    BROKEN,
    AsJson,
    CurveName,
    Machine,
    Scale,
    Tolerance,
    app,
    exits,
    notice,
    require_apart,
    require_outputs,
    show,
)
from feedplan.job import (
    DEFAULT_TOLERANCE,
    PATH_SHARE,
    Part,
    load_part,
    load_part_of_table,
    require_program,
)
from planner.errors import InputError
from planner.files.whole_file import require_writable

if TYPE_CHECKING:
    from rich.console import RenderableType

    from planner.output.ngc import Mode
    from planner.profile import FeedrateProfile
    from planner.programs.times import LineTimes
    from planner.verify import Report

_ROWS = 12
_CORNERS = "Where a path really has corners a jerk limit costs 1 to 30 %; without it the machine takes the jerks."


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
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Every line, .csv or .npz.")] = None,
    as_json: AsJson = False,
) -> None:
    """Tell the time of each line of a part program, and of all.

    Beside it, the least time of the same path without a jerk limit.  Dwells and tool changes count apart.  Exit code 1:
    the plan breaks a limit.
    """
    with exits():
        require_program(program, "feedplan time")
        require_apart([output], [program, machine])
        require_outputs(output, None)
        part = load_part(program, 1.0, machine, feed_mm_s, None, tolerance_mm, notice=notice)
        from dataclasses import replace

        from feedplan.progress import ProgressLine, load_kernels
        from planner.programs.times import write_line_times
        from planner.verify import check

        load_kernels()
        with ProgressLine() as line:
            profile = part.plan(line)
            line("planning without a jerk limit")
            plain = profile
            if part.limits.has_jerk:
                # A plan with a jerk limit is also one without.
                free = replace(part, limits=part.limits.without_jerk()).plan(line)
                plain = min(free, profile, key=lambda plan: plan.duration)
            line("checking the plan")
            report = check(part.curve, part.limits, profile)
            times, without = part.line_times(profile), part.line_times(plain)
            if output is not None:
                line(f"writing {output}")
                write_line_times(output, times, program, report.summary(), without_jerk=without)
        if as_json:
            typer.echo(_times_json(part, program, times, without, report))
        else:
            show(_times_text(part, profile, times, without, report, rows, output))
        if not report.ok:
            raise typer.Exit(BROKEN)


@app.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan ngc butterfly-nurbs --machine mill.toml --tolerance-mm 0.01 -o butterfly.ngc\n"
        "  feedplan ngc part.ngc --machine machine.ini --tolerance-mm 0.01 --inverse-time -o out.ngc\n"
        "  feedplan ngc part.ngc --table table.csv -o out.ngc\n"
    ),
)
def ngc(
    curve: CurveName,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="The program.")],
    machine: Machine = None,
    table: Annotated[Path | None, typer.Option(help="Feedrate table of the plan, in place of planning.")] = None,
    tolerance_mm: Annotated[
        float | None, typer.Option("--tolerance-mm", help="Distance allowed between the program and the CURVE.")
    ] = None,
    inverse_time: Annotated[bool, typer.Option("--inverse-time", help="G93: F as blocks a minute.")] = False,
    block_time_s: Annotated[float, typer.Option(help="Longest time of a block.")] = 0.01,
    feed_mm_s: Annotated[float | None, typer.Option(help="Commanded feed, in place of the machine's.")] = None,
    scale: Scale = 1.0,
    as_json: AsJson = False,
) -> None:
    """Write the plan of a curve or a part program as a LinuxCNC program.

    Short G1 blocks with a feed each.  Of the tolerance the path of a part program takes three quarters, the blocks and
    their blending by the controller the rest.  Spindle, tools, coolant, dwells and stops keep their places.  Exit code 1:
    the plan or its samples break a limit, and nothing is written.
    """
    with exits():
        require_apart([output], [curve, machine, table])
        require_writable(output)
        if table is not None and (machine is not None or feed_mm_s is not None):
            raise InputError("--table brings its own limits; leave --machine and --feed-mm-s out")
        if table is None:
            part = load_part(curve, scale, machine, feed_mm_s, None, tolerance_mm, PATH_SHARE, notice)
        else:
            part = _part_of_table(table, curve, scale, tolerance_mm)
        from feedplan.progress import ProgressLine, load_kernels
        from planner import read_table

        load_kernels()
        with ProgressLine() as line:
            profile = part.plan(line) if table is None else read_table(table, part.curve)
            verdict = part.judge(profile, line)
            line(f"writing {output}")
            mode: Mode = "inverse_time" if inverse_time else "feed"
            written = part.write(output, profile, mode, block_time=block_time_s, report=verdict.report)
        deviation = written.deviation + (0.0 if part.path is None else part.path.deviation.largest)
        facts = {
            "curve": part.curve.name,
            "machine": part.machine,
            "blocks": written.blocks,
            "duration_s": written.duration,
            "deviation_mm": deviation,
            "blending_mm": 0.5 * part.room,
            "files": [str(output)],
        }
        if as_json:
            typer.echo(json.dumps(facts, indent=2, allow_nan=False))
        else:
            typer.echo(
                f"{output}: {written.blocks} blocks, {written.duration:.6g} s, within {1e3 * deviation:.3g} um of "
                f"{part.curve.name}; the controller may blend {1e3 * 0.5 * part.room:.3g} um more"
            )


def _part_of_table(table: Path, curve: str, scale: float, tolerance: float | None) -> Part:
    """Load the curve of a table; the blocks get what its path leaves of the tolerance."""
    from dataclasses import replace

    from planner.inputs import positive_number

    part = load_part_of_table(table, curve, scale, None)
    if tolerance is None:
        room = part.room
    else:
        taken = 0.0 if part.path is None else part.path.tolerance
        room = positive_number(tolerance, "--tolerance-mm") - taken
    if room <= 0.0:
        taken = DEFAULT_TOLERANCE if part.path is None else part.path.tolerance
        raise InputError(
            f"{table}: its path takes {taken:g} mm of tolerance and leaves nothing for the blocks; give a --tolerance-mm "
            "above that, or plan with --program"
        )
    return replace(part, room=room)


def _times_text(
    part: Part,
    profile: FeedrateProfile,
    times: LineTimes,
    without: LineTimes,
    report: Report,
    rows: int,
    output: Path | None,
) -> RenderableType:
    """The longest lines, the totals, and what the jerk limit costs."""
    from rich.console import Group
    from rich.text import Text

    from feedplan.verdict import named, program_lines
    from planner.programs.times import line_table

    if part.path is None:
        raise AssertionError("only a part program has lines")
    shares = [(name, share) for name, share in profile.shares().items() if share >= 0.005]
    held = ", ".join(f"{'no limit' if name == 'none' else name} {100.0 * share:.1f}%" for name, share in shares)
    parts: list[RenderableType] = [
        *(named(name, text) for name, text in part.facts),
        *program_lines(part.path),
        named("machine", part.machine),
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
        named("jerk limit", _cost(times, without, part.limits.has_jerk)),
        named("held back by", held),
        *(named("note", note) for note in part.path.notes),
    ]
    if output is not None:
        parts.append(named("written", str(output)))
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
        f"same path takes at best without one.  {_CORNERS}"
    )


def _cost_share(times: LineTimes, without: LineTimes) -> float:
    return times.moving / without.moving - 1.0 if without.moving > 0.0 else math.nan


def _times_json(part: Part, program: str, times: LineTimes, without: LineTimes, report: Report) -> str:
    """The same for a program, every line."""
    from feedplan.verdict import program_facts
    from planner.programs.times import KINDS

    if part.path is None:
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
        "program": {"file": program, **program_facts(part.path)},
        "machine": part.machine,
        "motion_s": times.moving,
        "dwell_s": times.dwelling,
        "tool_changes": times.changes,
        "without_jerk_limit_s": without.moving,
        "jerk_limit_costs": _cost_share(times, without),
        "notes": list(part.path.notes),
        "lines": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
    }
    return json.dumps(facts, indent=2, allow_nan=False)
