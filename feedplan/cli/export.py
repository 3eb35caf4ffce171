"""A plan in the format of another machine's controller: ``feedplan export``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import options
from feedplan.cli.app import require_apart
from feedplan.cli.streams import STANDARD, Streams
from feedplan.exports import EXPORT_SUFFIXES, export_format, export_plan, require_own
from feedplan.job import load_job_of_table
from planner.errors import InputError
from planner.files.whole_file import require_writable

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind, PathSide


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan export table.csv butterfly-nurbs -o part.fpr\n"
        "  feedplan export table.csv butterfly-nurbs --counts-per-mm 10000 -o drives.csv\n"
        "  feedplan export table.csv butterfly-nurbs --joint-names x,y -o trajectory.yaml\n"
        "  feedplan export table.csv butterfly-nurbs --steps-per-mm X=800,Y=800 -o part.steps\n"
    ),
)
@options.table
@options.curve
@click.option("--output", "-o", type=options.FILE, required=True, help="The file; its suffix says the format.")
@click.option(
    "--format",
    "kind",
    type=click.Choice(list(EXPORT_SUFFIXES)),
    help="Plan file of the C step (fpr), positions of drives a cycle (csp), JointTrajectory of ROS 2 (ros), step and "
    "direction pulses (steps).",
)
@options.machine
@options.tolerance
@options.tools
@options.setup
@options.ignore
@options.reader
@options.path_of_table
@options.side_of_table
@options.scale
@options.layer
@options.chain
@click.option("--period-s", type=float, help="csp: time of a cycle, in place of the table's period.")
@click.option("--counts-per-mm", metavar="N", help="csp: increments of linear axes, one number or X=10000,Y=8000.")
@click.option("--counts-per-rad", metavar="N", help="csp: increments of rotary axes.")
@click.option("--velocity-offset", is_flag=True, help="csp: write 0x60B1 too.")
@click.option("--joint-names", metavar="A,B,...", help="ros: names of the joints, in the order of the axes.")
@click.option("--deviation-mm", type=float, help="ros: distance of the controller's quintics from the plan.")
@click.option("--steps-per-mm", metavar="N", help="steps: steps of linear axes, one number or X=800,Y=800.")
@click.option("--steps-per-rad", metavar="N", help="steps: steps of rotary axes.")
@click.option("--clock-hz", type=float, help="steps: clock whose ticks the times are; 1e9 if left out.")
@click.option("--pulse-us", type=float, help="steps: least time that a pulse is high; 2.5 if left out.")
@click.option("--space-us", type=float, help="steps: least time that it is low; 2.5 if left out.")
@click.option("--setup-us", type=float, help="steps: least time from a change of direction to a pulse; 5 if left out.")
@click.option("--hold-us", type=float, help="steps: least time from a pulse to a change of direction; 0 if left out.")
@options.as_json
def export(
    table: Path,
    curve: str,
    *,
    output: Path,
    kind: str | None,
    machine: str | None,
    complete: dict[str, float],
    tolerance_mm: float | None,
    tools: Path | None,
    setup: str | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    side: PathSide | None,
    scale: float,
    layer: str | None,
    chain: int | None,
    as_json: bool,
    **own: Any,
) -> None:
    """Write a feedrate table in the format of a controller.

    The plan and its samples are checked first, as feedplan check does.  Exit code 1: they break a limit, or pulses follow
    each other closer than the drives take, and nothing is written.
    """
    with Streams() as at:
        table, curve = at.table(table), at.curve(curve)
        if str(output) == STANDARD and kind is None:
            raise InputError("a file on standard output has no suffix; say its format with --format")
        written_to = at.output(output, EXPORT_SUFFIXES[kind][0] if kind else "") or output
        require_apart([written_to], [table, curve, machine])
        kind = export_format(written_to, kind)
        require_own(kind, own)
        require_writable(written_to)
        from feedplan.progress import ProgressLine
        from planner import read_table

        job = load_job_of_table(
            table,
            curve,
            machine,
            complete=complete,
            scale=scale,
            tolerance=tolerance_mm,
            tools=tools,
            ignore=ignore,
            reader=reader,
            path=path,
            side=side,
            setup=setup,
            layer=layer,
            chain=chain,
        )
        with ProgressLine() as line:
            line("reading the table")
            verdict = job.judge(read_table(table, job.curve), line)
            done = export_plan(job, verdict, written_to, kind, line, **own)
        name = at.told(str(written_to))
        if as_json:
            facts = {
                "curve": job.curve.name,
                "machine": at.told(job.machine),
                "format": kind,
                "axes": list(job.curve.axes),
                **done.facts,
                "files": [name],
            }
            click.echo(json.dumps(facts, indent=2, allow_nan=False), err=at.taken)
        else:
            click.echo(f"{name}: {done.text}", err=at.taken)
