"""Part programs on several machines, within several tolerances, with limits multiplied: ``feedplan sweep``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from feedplan.cli import batches, options
from feedplan.cli.app import require_apart
from feedplan.cli.streams import Streams
from planner.errors import InputError
from planner.files.formats import ANY_COLUMN_FORMAT

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind, PathSide


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan sweep part.ngc --machine mill.toml --scale jerk=1,2,4\n"
        "  feedplan sweep parts/ --machine mill.toml --machine router.toml --tolerance-mm 0.01,0.05 -o sweep.csv\n"
        "  feedplan sweep part.ngc --scale acceleration.X=1,1.5 --scale jerk=1,2 --scheduler tcp://10.0.0.5:8786\n"
    ),
)
@options.programs
@options.machines
@click.option("--tolerance-mm", metavar="A,B,...", help="Distances allowed from the program, in place of its P words.")
@click.option(
    "--scale",
    "scales",
    metavar="LIMIT=A,B,...",
    multiple=True,
    help="Factors of a limit, as jerk=1,2,4, or of that of an axis, as acceleration.X=1,1.5.  May be repeated.",
)
@options.tools
@options.ignore
@options.reader
@options.path
@options.side
@click.option("--feed-mm-s", type=float, help="Largest feed, in place of the machines'.")
@click.option("--tool-change-s", type=float, help="Time of a tool change, in place of the machine files'.")
@click.option("--output", "-o", type=options.FILE, help=f"Every combination, {ANY_COLUMN_FORMAT}.")
@batches.jobs
@batches.scheduler
@options.as_json
def sweep(
    programs: tuple[str, ...],
    *,
    machines: tuple[str, ...],
    complete: dict[str, float],
    tolerance_mm: str | None,
    scales: tuple[str, ...],
    tools: Path | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    side: PathSide | None,
    feed_mm_s: float | None,
    tool_change_s: float | None,
    output: Path | None,
    jobs: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Tell what other limits, tolerances or machines would save: the time of every combination.

    Each program is timed on every machine, within every tolerance, with every factor of the limits that are scaled; the
    first row of a program is its base.  Combinations are timed side by side on every core, or by the workers of a Dask
    scheduler.  The exit code is the largest that one of them would have alone.
    """
    from feedplan.batch_times import TimingOptions
    from feedplan.job import load_machine
    from feedplan.program_files import find_programs
    from feedplan.sweep import name_machines, read_numbers, read_scale, sweep_cases, sweep_facts, sweep_text
    from planner.quantity import FEED

    with Streams() as at:
        require_apart([output], [*programs, *machines])
        tolerances = () if tolerance_mm is None else read_numbers(tolerance_mm, "--tolerance-mm")
        factors = [read_scale(text) for text in scales]
        if feed_mm_s is not None and any(limit.key == FEED.key for limit in factors):
            raise InputError(
                "--scale feed multiplies the feed of the machine, and --feed-mm-s stands in its place; leave one"
            )
        names = machines or ("mill",)
        found = name_machines(names, [load_machine(name, complete=complete)[0] for name in names])
        files, notes = find_programs(programs)
        cases = sweep_cases(files, found, tolerances, factors)
        alike = TimingOptions(feed_mm_s, tool_change_s, tools, ignore, reader, path, side)
        hands = batches.Hands(jobs, scheduler)
        batches.report_rows(at, cases, alike, notes, hands, output, as_json, (sweep_text, sweep_facts))
