"""A table of a plan checked again: ``feedplan check``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from feedplan.cli.app import AsJson, CurveName, Machine, Scale, TableFile, Tolerance, app, exits, report_verdict
from feedplan.cli.streams import Streams
from feedplan.job import load_job_of_table


@app.command(epilog="\b\nExample:\n  feedplan check table.csv butterfly-nurbs --machine mill.toml")
def check(
    table: TableFile,
    curve: CurveName,
    *,
    machine: Machine = None,
    tolerance_mm: Tolerance = None,
    scale: Scale = 1.0,
    certificate: Annotated[Path | None, typer.Option(help="Certificate of its lower bound, .npz.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check a feedrate table and the samples of it.

    Nothing of the planner is used.  Without --machine the limits in the table's own header count.  With the certificate
    that feedplan plan wrote, the lower bound is verified from the curve and the limits too; else it is only claimed.
    """
    with exits(), Streams() as at:
        from feedplan.progress import ProgressLine, load_kernels
        from planner import read_table

        table, curve = at.table(table), at.curve(curve)
        job = load_job_of_table(table, curve, machine, scale=scale, tolerance=tolerance_mm)
        load_kernels()
        with ProgressLine() as line:
            line("reading the table")
            verdict = job.judge(read_table(table, job.curve), line)
            verdict = replace(verdict, machine=at.told(verdict.machine))
            if certificate is not None:
                verdict = job.prove(verdict, certificate, line)
        report_verdict(verdict, as_json)
