"""A plan of one curve, checked: ``feedplan plan``."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import options
from feedplan.cli.app import (
    Drawing,
    notice,
    report_verdict,
    require_apart,
    require_figure,
    require_outputs,
)
from feedplan.cli.streams import Streams
from feedplan.job import UNBOUNDED, Job, load_job
from feedplan.sources import PATH_SHARE, path_for, require_program
from planner.files.formats import ANY_COLUMN_FORMAT
from planner.files.whole_file import require_writable

if TYPE_CHECKING:
    from feedplan.progress import ProgressLine
    from feedplan.verdict import Verdict
    from planner.geometry.tolerance import PathKind, PathSide

_SAMPLES_AT_ONCE = 1_000_000  # bounds the memory that evaluating the plan takes


class MethodName(StrEnum):
    """Solvers of the plan command."""

    optimal = "optimal"
    nlp = "nlp"
    toppra = "toppra"
    scurve = "scurve"


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan plan butterfly-nurbs -o table.csv\n"
        "  feedplan plan part.json --machine mill.toml --feed-mm-s 80 --plot plan.pdf\n"
        "  feedplan plan part.ngc --tolerance-mm 0.01 --program out.ngc\n"
    ),
)
@options.curve
@options.machine
@click.option(
    "--method",
    type=click.Choice(MethodName),
    default=MethodName.optimal,
    help="Solver; toppra knows no jerk limit.",
)
@options.commanded_feed
@options.scale
@options.layer
@options.chain
@options.period
@click.option("--start-feed-mm-s", type=float, default=0.0, help="Feed at the start of the path.")
@click.option("--end-feed-mm-s", type=float, default=0.0, help="Feed at the end of the path.")
@click.option("--periodic", is_flag=True, help="Pass the end into the start without a stop.")
@click.option("--exact-stop", is_flag=True, help="Stop wherever the curvature jumps, not only in corners.")
@options.override_reserve
@options.tolerance
@options.tools
@options.ignore
@options.reader
@options.path
@options.side
@click.option("--intervals", type=int, help="Grid intervals; refinement chooses if left out.")
@click.option("--budget-s", type=float, default=math.inf, help="Time after which to return the best plan so far.")
@click.option("--output", "-o", type=options.FILE, help=f"Feedrate table, {ANY_COLUMN_FORMAT}.")
@click.option("--plot", type=options.FILE, help="Figure, .png, .pdf or .svg.")
@click.option(
    "--panels", metavar="A,B,...", help="Of the figure: path, feed, velocity, acceleration, jerk, chord, binding."
)
@options.plot_width
@click.option("--report", type=options.FILE, help="Page for a browser, .html.")
@click.option("--program", type=options.FILE, help="LinuxCNC program of the plan; see feedplan ngc.")
@click.option("--lines", type=options.FILE, help=f"Seconds of each line of a part program, {ANY_COLUMN_FORMAT}.")
@click.option("--certificate", type=options.FILE, help="Proof of the lower bound, .npz; see check.")
@options.as_json
def plan(
    curve: str,
    *,
    machine: str | None,
    complete: dict[str, float],
    method: MethodName,
    feed_mm_s: float | None,
    scale: float,
    layer: str | None,
    chain: int | None,
    period_s: float | None,
    start_feed_mm_s: float,
    end_feed_mm_s: float,
    periodic: bool,
    exact_stop: bool,
    override_reserve: float,
    tolerance_mm: float | None,
    tools: Path | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    side: PathSide | None,
    intervals: int | None,
    budget_s: float,
    output: Path | None,
    plot: Path | None,
    panels: str | None,
    width_mm: float | None,
    report: Path | None,
    program: Path | None,
    lines: Path | None,
    certificate: Path | None,
    as_json: bool,
) -> None:
    """Plan the feed along a curve, and check the plan.

    The plan and its samples are checked on their own, without a formula of the planner; one verdict is printed.  Where a
    limit is broken no --program is written, and every other file says so.
    """
    with Streams() as at:
        from planner.output.panel_choice import PLAN_PANELS

        curve = at.curve(curve)
        files = Files(
            at.output(output, ".csv"),
            certificate,
            plot,
            at.output(report, ".html"),
            at.output(program, ".ngc"),
            at.output(lines, ".csv"),
            require_figure(plot, panels, width_mm, PLAN_PANELS),
        )
        files.require_writable(curve, machine, method)
        share = 1.0 if program is None else PATH_SHARE
        ends: dict[str, Any] = {"start_feed": start_feed_mm_s, "end_feed": end_feed_mm_s, "periodic": periodic}
        job = load_job(
            curve,
            machine,
            complete=complete,
            scale=scale,
            layer=layer,
            chain=chain,
            feed=feed_mm_s,
            period=period_s,
            tolerance=tolerance_mm,
            tools=tools,
            ignore=ignore,
            reader=reader,
            path=path_for(curve, path, ends | {"method": method.value}),
            side=side,
            share=share,
            override_reserve=override_reserve,
            notice=notice,
        )
        from feedplan.progress import ProgressLine
        from planner.output.ngc import require_both_sides

        if program is not None:
            require_both_sides(job.curve)
        with ProgressLine() as line:
            verdict = job.run(
                line,
                certificate=certificate,
                method=method.value,
                **ends,
                budget=budget_s,
                intervals=intervals,
                exact_stop=exact_stop,
            )
            if not verdict.holds:  # no machine gets a plan that breaks a limit
                files = replace(files, program=None)
            verdict = replace(verdict, files=tuple(map(at.told, files.names)))
            files.write(job, verdict, curve, at.told(curve), line)
        if program is not None and files.program is None:
            click.echo(f"{program}: not written, since the plan breaks a limit", err=True)
        report_verdict(verdict, as_json, aside=at.taken)


@dataclass(frozen=True)
class Files:
    """What the plan command writes; None is not asked for."""

    output: Path | None
    certificate: Path | None
    plot: Path | None
    report: Path | None
    program: Path | None
    lines: Path | None
    drawing: Drawing

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files, in the order in which the verdict tells them."""
        every = (self.output, self.certificate, self.plot, self.report, self.program, self.lines)
        return tuple(str(name) for name in every if name is not None)

    def require_writable(self, curve: str, machine: str | None, method: MethodName) -> None:
        """Refuse what cannot be written before anything is planned."""
        require_apart(
            [self.output, self.certificate, self.plot, self.report, self.program, self.lines], [curve, machine]
        )
        require_outputs(self.output, self.plot, self.report)
        require_outputs(self.lines, None)
        if self.program is not None:
            require_writable(self.program)
        if self.lines is not None:
            require_program(curve, "--lines")
        if self.certificate is not None:
            _require_certifiable(self.certificate, method)

    def write(self, job: Job, verdict: Verdict, curve: str, told: str, line: ProgressLine) -> None:
        """Write all but the certificate, each saying so where the plan breaks a limit; ``told`` names the curve in them."""
        profile, limits, report = verdict.profile, verdict.limits, verdict.report
        if self.output is not None:
            from planner import write_table

            line(f"writing {self.output}")
            write_table(self.output, profile, limits, report=report)
        if self.program is not None:
            line(f"writing {self.program}")
            job.write(self.program, profile, "feed", report=report)
        if self.lines is not None:
            from planner.programs.line_table import write_line_times

            line(f"writing {self.lines}")
            write_line_times(self.lines, job.line_times(profile), told, report.summary())
        if self.plot is not None:
            from planner.output.figures import save_plot
            from planner.output.plots import plot_plan

            line(f"drawing {self.plot}")
            save_plot(self.plot, plot_plan(job.curve, limits, profile, verdict.samples, report, **self.drawing))
        if self.report is not None:
            _write_page(self.report, job, verdict, curve, line)


def _write_page(page: Path, job: Job, verdict: Verdict, curve: str, line: ProgressLine) -> None:
    """Write the page of a plan, of a program with its lines."""
    from feedplan.page import write_report
    from feedplan.playback import PlayedLines
    from feedplan.slow_corner import slowest_corner
    from planner.programs.program_text import ProgramText

    profile, lines, played = verdict.profile, None, None
    if job.program is not None:
        text = ProgramText.read(curve)
        lines, played = job.line_times(profile), PlayedLines.of(job, profile, text)
    corner = slowest_corner(job, profile)
    write_report(page, verdict, lines=lines, played=played, corner=corner, progress=line)


def _require_certifiable(certificate: Path, method: MethodName) -> None:
    """Refuse a certificate that could not be made or written before the work begins."""
    from planner.errors import InputError
    from planner.output.certificate_file import require_npz

    require_npz(certificate)
    require_writable(certificate)
    if method.value == UNBOUNDED:
        raise InputError(f"--certificate needs a lower bound; the method {UNBOUNDED} gives none")
