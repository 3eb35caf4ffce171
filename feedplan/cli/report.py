"""A plan as a page for a browser: ``feedplan report``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import options
from feedplan.cli.app import BROKEN, report_verdict
from feedplan.cli.streams import Streams
from feedplan.job import load_job_of_table
from feedplan.sources import require_program
from planner.errors import CurveError, InfeasibleError, SolverError

if TYPE_CHECKING:
    from feedplan.job import Job
    from planner.geometry.tolerance import PathKind, PathSide
    from planner.profile import FeedrateProfile


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan report table.csv butterfly-nurbs -o report.html\n"
        "  feedplan plan butterfly-nurbs --report report.html\n"
        "  feedplan report table.csv part.ngc -o report.html --tolerances-um 1,5,10,50\n"
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
@options.tolerances
@options.tools
@options.setup
@options.ignore
@options.reader
@options.path_of_table
@options.side_of_table
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
    tolerances: tuple[float, ...] | None,
    tools: Path | None,
    setup: str | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    side: PathSide | None,
    as_json: bool,
) -> None:
    """Write a feedrate table as a page for a browser.

    One file that needs no network: the path by feed, played back along a slider, the use of every limit over time, the
    verdict, and for part programs the time of each line and, with --tolerances-um, what another tolerance saves.
    Without --machine the limits in the table's own header count.
    """
    with Streams() as at:
        from feedplan.page import require_report, write_report

        table, curve = at.table(table), at.curve(curve)
        page = at.output(output, ".html") or output
        require_report(page)
        if tolerances is not None:
            require_program(curve, "--tolerances-um")
        from feedplan.playback import PlayedLines
        from feedplan.progress import ProgressLine
        from feedplan.slow_corner import slowest_corner
        from feedplan.tolerances import ToleranceTime, time_of_tolerances
        from planner import read_table
        from planner.programs.program_text import ProgramText

        given: dict[str, Any] = {
            "complete": complete, "scale": scale, "tools": tools, "ignore": ignore, "reader": reader, "setup": setup,
            "path": path, "side": side, "layer": layer, "chain": chain,
        }  # fmt: skip
        job = load_job_of_table(table, curve, machine, tolerance=tolerance_mm, **given)
        with ProgressLine() as line:
            line("reading the table")
            profile = read_table(table, job.curve)
            verdict = job.judge(profile, line, files=(at.told(str(page)),))
            verdict = replace(verdict, machine=at.told(verdict.machine))
            lines = played = None
            if job.program is not None:
                lines, played = job.line_times(profile), PlayedLines.of(job, profile, ProgramText.read(curve))
            others: tuple[ToleranceTime, ...] = ()
            if tolerances is not None:
                others = time_of_tolerances(curve, machine, tolerances, table=table, progress=line, **given)
            beside = {}
            if job.path is not None and job.path.counts["joint"]:
                line("planning the path made before its feed")
                separate = given | {"path": "separate", "side": "both", "tolerance": tolerance_mm}
                beside = _planned("path first, then feed", lambda: load_job_of_table(table, curve, machine, **separate))
            corner = slowest_corner(job, profile, beside)
            write_report(page, verdict, lines=lines, played=played, tolerances=others, corner=corner, progress=line)
        report_verdict(verdict, as_json, aside=at.taken)
        if any(row.breaks for row in others):
            raise click.exceptions.Exit(BROKEN)


def _planned(name: str, load: Callable[[], Job]) -> dict[str, tuple[Job, FeedrateProfile]]:
    """A plan to be seen beside that of the page; one that cannot be made is left out."""
    try:
        job = load()
        return {name: (job, job.plan())}
    except (CurveError, InfeasibleError, SolverError):
        return {}
