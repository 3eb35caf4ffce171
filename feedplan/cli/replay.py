"""Samples of a plan, one a period: ``feedplan replay``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from feedplan.cli import options
from feedplan.cli.app import BROKEN, require_apart, require_outputs, show
from feedplan.cli.streams import Streams
from feedplan.job import load_job_of_table
from planner.files.formats import ANY_COLUMN_FORMAT

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind, PathSide
    from planner.profile import FeedrateProfile
    from planner.samples import Samples

_SAMPLES_AT_ONCE = 1_000_000  # bounds the memory that evaluating the plan takes


@click.command(epilog="\b\nExample:\n  feedplan replay table.csv butterfly-nurbs --period-s 0.001 -o samples.csv")
@options.table
@options.curve
@click.option("--period-s", type=float, help="Interpolation period, in place of the table's.")
@click.option("--order", type=int, default=5, help="1, 2, 3 (Taylor steps) or 5 (the plan itself).")
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
@click.option("--output", "-o", type=options.FILE, help=f"Samples, {ANY_COLUMN_FORMAT}.")
def replay(
    table: Path,
    curve: str,
    *,
    period_s: float | None,
    order: int,
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
    output: Path | None,
) -> None:
    """Sample a feedrate table once a period.

    This is what an interpolator does.  Printed is how far the samples are off the plan and what they use of its limits.
    Exit code 1: they break a limit; a file of them says so.
    """
    with Streams() as at:
        table, curve, output = at.table(table), at.curve(curve), at.output(output, ".csv")
        require_apart([output], [table, curve])
        require_outputs(output, None)
        from feedplan.progress import ProgressLine
        from planner import read_table
        from planner.output.table import write_samples

        job = load_job_of_table(
            table,
            curve,
            scale=scale,
            layer=layer,
            chain=chain,
            tolerance=tolerance_mm,
            tools=tools,
            ignore=ignore,
            reader=reader,
            path=path,
            side=side,
            setup=setup,
        )
        with ProgressLine() as line:
            line("reading the table")
            profile = read_table(table, job.curve)
            line("sampling")
            samples = job.replay(profile, period_s, order=order)
            line("measuring the samples")
            report = job.check(samples)
            apart = _distance(profile, samples)
            if output is not None:
                line(f"writing {output}")
                write_samples(output, job.curve, samples, report)
        from feedplan.verdict_text import samples_text

        written = "" if output is None else at.told(str(output))
        show(samples_text(profile, samples, report, apart, written), aside=at.taken)
        if not report.ok:
            raise click.exceptions.Exit(BROKEN)


def _distance(profile: FeedrateProfile, samples: Samples) -> float:
    """Largest distance along an axis between a sample and where the plan is at that time, mm or rad."""
    import numpy as np

    worst = 0.0
    for first in range(0, samples.t.size, _SAMPLES_AT_ONCE):
        some = slice(first, first + _SAMPLES_AT_ONCE)
        u = profile.at(np.minimum(samples.t[some], profile.duration)).u
        apart = np.abs(samples.position[some] - profile.curve.derivatives(u, 0)[0])
        worst = max(worst, float(apart.max()))
    return worst
