"""A plan as a page for a browser: ``feedplan report``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from feedplan.cli import options
from feedplan.cli.app import report_verdict
from feedplan.cli.streams import Streams
from feedplan.job import load_job_of_table

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan report table.csv butterfly-nurbs -o report.html\n"
        "  feedplan plan butterfly-nurbs --report report.html\n"
    ),
)
@options.table
@options.curve
@click.option("--output", "-o", type=options.FILE, required=True, help="The page, .html.")
@options.machine
@options.scale
@options.layer
@options.chain
@options.tolerance
@options.tools
@options.setup
@options.ignore
@options.reader
@options.path_of_table
@options.as_json
def report(
    table: Path,
    curve: str,
    *,
    output: Path,
    machine: str | None,
    complete: dict[str, float],
    scale: float,
    layer: str | None,
    chain: int | None,
    tolerance_mm: float | None,
    tools: Path | None,
    setup: str | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    as_json: bool,
) -> None:
    """Write a feedrate table as a page for a browser.

    One file that needs no network: the path by feed, the use of every limit over time, the verdict, and for part programs
    the time of each line.  Without --machine the limits in the table's own header count.
    """
    with Streams() as at:
        from feedplan.page import require_report, write_report

        table, curve = at.table(table), at.curve(curve)
        page = at.output(output, ".html") or output
        require_report(page)
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
            setup=setup,
            layer=layer,
            chain=chain,
        )
        with ProgressLine() as line:
            line("reading the table")
            profile = read_table(table, job.curve)
            verdict = job.judge(profile, line, files=(at.told(str(page)),))
            verdict = replace(verdict, machine=at.told(verdict.machine))
            lines = None if job.program is None else job.line_times(profile)
            write_report(page, verdict, lines=lines, progress=line)
        report_verdict(verdict, as_json, aside=at.taken)
