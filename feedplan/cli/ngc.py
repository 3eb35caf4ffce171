"""A plan as a program for LinuxCNC: ``feedplan ngc``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from feedplan.cli import options
from feedplan.cli.app import notice, require_apart
from feedplan.cli.streams import Streams
from feedplan.job import Job, load_job, load_job_of_table
from feedplan.sources import PATH_SHARE
from planner.errors import InputError
from planner.files.whole_file import require_writable
from planner.geometry.tolerance import DEFAULT_TOLERANCE

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind
    from planner.output.ngc import FeedMode


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan ngc butterfly-nurbs --machine mill.toml --tolerance-mm 0.01 -o butterfly.ngc\n"
        "  feedplan ngc part.ngc --machine machine.ini --tolerance-mm 0.01 --inverse-time -o out.ngc\n"
        "  feedplan ngc part.ngc --table table.csv -o out.ngc\n"
    ),
)
@options.curve
@click.option("--output", "-o", type=options.FILE, required=True, help="The program.")
@options.machine
@click.option("--table", type=options.FILE, help="Feedrate table of the plan, in place of planning.")
@click.option("--tolerance-mm", type=float, help="Distance allowed between the program and the CURVE.")
@options.tools
@options.setup
@options.ignore
@options.reader
@options.path
@click.option("--inverse-time", is_flag=True, help="G93: F as blocks a minute.")
@click.option("--block-time-s", type=float, default=0.01, help="Longest time of a block.")
@click.option("--acceleration-share", type=float, default=1.0, help="Part of the machine's acceleration to plan with.")
@options.commanded_feed
@options.scale
@options.layer
@options.chain
@options.as_json
def ngc(
    curve: str,
    *,
    output: Path,
    machine: str | None,
    complete: dict[str, float],
    table: Path | None,
    tolerance_mm: float | None,
    tools: Path | None,
    setup: str | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    inverse_time: bool,
    block_time_s: float,
    acceleration_share: float,
    feed_mm_s: float | None,
    scale: float,
    layer: str | None,
    chain: int | None,
    as_json: bool,
) -> None:
    """Write a plan as a program for LinuxCNC.

    Short G1 blocks with a feed each, and the time that LinuxCNC takes for them.  Of the tolerance the path of a part program
    takes three quarters, the blocks and their blending by the controller the rest.  Spindle, tools, coolant, dwells and
    stops keep their places.  Exit code 1: the plan or its samples break a limit, and nothing is written.
    """
    with Streams() as at:
        curve, table = at.curve(curve), None if table is None else at.table(table)
        written_to = at.output(output, ".ngc") or output
        require_apart([written_to], [curve, machine, table])
        require_writable(written_to)
        if table is not None and (machine is not None or feed_mm_s is not None or complete):
            given = [f"--{key.replace('_', '-')}" for key in ("machine", "feed_mm_s", *complete)]
            raise InputError(f"--table brings its own limits; leave {', '.join(given[:-1])} and {given[-1]} out")
        if table is not None and acceleration_share != 1.0:
            raise InputError("--table brings its own plan; leave --acceleration-share out")
        if table is None:
            job = load_job(
                curve,
                machine,
                complete=complete,
                scale=scale,
                layer=layer,
                chain=chain,
                feed=feed_mm_s,
                tolerance=tolerance_mm,
                tools=tools,
                ignore=ignore,
                reader=reader,
                path=path,
                share=PATH_SHARE,
                acceleration_share=acceleration_share,
                notice=notice,
            )
        else:
            job = _job_of_table(
                load_job_of_table(
                    table,
                    curve,
                    scale=scale,
                    layer=layer,
                    chain=chain,
                    tools=tools,
                    ignore=ignore,
                    reader=reader,
                    path=path,
                    setup=setup,
                ),
                table,
                tolerance_mm,
            )
        from feedplan.progress import ProgressLine
        from planner import read_table

        with ProgressLine() as line:
            profile = job.plan(line) if table is None else read_table(table, job.curve)
            verdict = job.judge(profile, line)
            line(f"writing {written_to}")
            mode: FeedMode = "inverse_time" if inverse_time else "feed"
            written = job.write(written_to, profile, mode, block_time=block_time_s, report=verdict.report)
        deviation = written.deviation + (0.0 if job.path is None else job.path.deviation.largest)
        name = at.told(str(written_to))
        facts = {
            "curve": job.curve.name,
            "machine": at.told(job.machine),
            "blocks": written.blocks,
            "duration_s": written.duration,
            "plan_s": profile.duration,
            "deviation_mm": deviation,
            "blending_mm": written.reach - written.deviation,
            "source": dict(job.facts),
            "files": [name],
        }
        if as_json:
            click.echo(json.dumps(facts, indent=2, allow_nan=False), err=at.taken)
        else:
            text = (
                f"{name}: {written.blocks} blocks, {written.duration:.6g} s on LinuxCNC, {profile.duration:.6g} s as "
                f"planned, within {1e3 * deviation:.3g} um of {job.curve.name}; the controller may blend "
                f"{1e3 * (written.reach - written.deviation):.3g} um more"
            )
            shared = [f"{key}: {said}" for key, said in job.facts if key == "tolerance"]
            click.echo("\n".join([text, *shared]), err=at.taken)


def _job_of_table(job: Job, table: Path, tolerance: float | None) -> Job:
    """Of the job of a table, the blocks get what its path leaves of the tolerance."""
    from dataclasses import replace

    from planner.inputs import positive_number

    if tolerance is None:
        room = job.room
    else:
        taken = 0.0 if job.path is None else job.path.tolerance
        room = positive_number(tolerance, "--tolerance-mm") - taken
    if room <= 0.0:
        taken = DEFAULT_TOLERANCE if job.path is None else job.path.tolerance
        raise InputError(
            f"{table}: its path takes {taken:g} mm of tolerance and leaves nothing for the blocks; give a --tolerance-mm "
            "above that, or plan with --program"
        )
    return replace(job, room=room)
