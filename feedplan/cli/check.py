"""A table of a plan checked again: ``feedplan check``."""

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
    from planner.geometry.tolerance import PathKind, PathSide


@click.command(epilog="\b\nExample:\n  feedplan check table.csv butterfly-nurbs --machine mill.toml")
@options.table
@options.curve
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
@click.option("--certificate", type=options.FILE, help="Certificate of its lower bound, .npz.")
@options.as_json
def check(
    table: Path,
    curve: str,
    *,
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
    certificate: Path | None,
    as_json: bool,
) -> None:
    """Check a feedrate table and the samples of it.

    Nothing of the planner is used.  Without --machine the limits in the table's own header count.  With the certificate
    that feedplan plan wrote, the lower bound is verified from the curve and the limits too; else it is only claimed.
    """
    with Streams() as at:
        from feedplan.progress import ProgressLine
        from planner import read_table

        table, curve = at.table(table), at.curve(curve)
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
            verdict = replace(verdict, machine=at.told(verdict.machine))
            if certificate is not None:
                verdict = job.prove(verdict, certificate, line)
        report_verdict(verdict, as_json)
