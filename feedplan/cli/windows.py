"""Part programs of any length: ``feedplan windows``."""

from __future__ import annotations

import json
import math
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from feedplan.cli import options
from feedplan.cli.app import BROKEN, show
from feedplan.job import load_machine
from feedplan.sources import require_program

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind
    from planner.programs.long.windows import ProgramPlan

_UNITS = {
    "duration": "s",
    "dwell": "s",
    "length": "mm",
    "deviation": "mm",
    "joint_feed": "mm_s",
    "joint_acceleration": "mm_s2",
}


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan windows long.ngc --machine mill.toml -o plan.npz\n"
        "  feedplan windows long.ngc --tolerance-mm 0.01 -o plan.npz --json\n"
    ),
)
@options.program
@click.option("--output", "-o", type=options.FILE, required=True, help="Table of all windows, .npz.")
@options.machine
@options.tolerance
@options.path
@options.tools
@options.ignore
@options.reader
@click.option("--feed-mm-s", type=float, help="Largest feed, in place of the machine's.")
@click.option(
    "--cores",
    type=click.IntRange(min=1),
    help="Processors to use; else as many as there are.  Two are the most that is of use.",
)
@click.option("--fresh", is_flag=True, help="Begin anew where an earlier run was interrupted.")
@options.as_json
def windows(
    program: str,
    *,
    output: Path,
    machine: str | None,
    complete: dict[str, float],
    tolerance_mm: float | None,
    path: PathKind | None,
    tools: Path | None,
    ignore: tuple[str, ...],
    reader: str,
    feed_mm_s: float | None,
    cores: int | None,
    fresh: bool,
    as_json: bool,
) -> None:
    """Plan a part program of any length, window by window.

    Writes the table and, beside it, the seconds of every line.  Interrupted and started again, it goes on where it was.
    Exit code 1: the plan breaks a limit.
    """
    require_program(program, "feedplan windows")
    from feedplan.progress import ProgressLine
    from planner.programs.long.windows import plan_program
    from planner.programs.source import program_of

    found, name = load_machine(machine, complete=complete)
    limits = found.limits if feed_mm_s is None else found.limits.with_feed(feed_mm_s)
    began = time.perf_counter()
    with ProgressLine() as line:
        line("reading the program", None)
        blocks = program_of(program, reader, tools=tools, ignore=ignore, setup=found.setup)
        plan = plan_program(
            blocks,
            limits,
            tolerance_mm,
            output=output,
            path=path or "joint",
            progress=line,
            resume=not fresh,
            cores=cores or usable_cores(),
        )
    seconds = time.perf_counter() - began
    if as_json:
        click.echo(_json(plan, name, seconds))
    else:
        show(_text(plan, program, name, seconds))
    if not plan.ok:
        raise click.exceptions.Exit(BROKEN)


def usable_cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _json(plan: ProgramPlan, machine: str, seconds: float) -> str:
    facts = {"machine": machine, "ok": plan.ok, "planning_time_s": seconds}
    facts |= {f"{key}_{unit}": getattr(plan, key) for key, unit in _UNITS.items()}
    facts |= {"planning_s": seconds}  # from here on the keys of old, where units are not told
    facts |= {key: str(value) if isinstance(value, Path) else value for key, value in asdict(plan).items()}
    finite = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in facts.items()
    }
    return json.dumps(finite, indent=2, allow_nan=False)


def _text(plan: ProgramPlan, program: str, machine: str, seconds: float) -> list[str]:
    resumed = f", {plan.resumed} of them by an earlier run" if plan.resumed else ""
    return [
        "every limit holds" if plan.ok else f"{len(plan.violations)} limits do not hold",
        f"{program}: {plan.blocks} blocks, {plan.length:.6g} mm, {plan.duration:.6f} s on {machine}"
        + (f", dwells {plan.dwell:.6g} s beside it" if plan.dwell else ""),
        f"planned in {seconds:.3g} s, {plan.windows} window{'' if plan.windows == 1 else 's'}{resumed}; "
        f"joints within {plan.joint_feed:.2g} mm/s and "
        f"{plan.joint_acceleration:.2g} mm/s^2",
        f"largest use of a limit {plan.worst:.7f}, {plan.worst_limit}",
        f"path within {1e3 * plan.deviation:.4g} um of the program (line {plan.deviation_line}), "
        f"{100.0 * plan.deviation_share:.2f} % of the tolerance",
        *([f"{plan.joint} of {plan.runs} runs from stop to stop found together with their feed"] if plan.runs else []),
        *plan.violations,
        *plan.notes,
        f"wrote {plan.table} and {plan.lines}",
    ]
