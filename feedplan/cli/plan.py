"""Planning, checking and replaying one curve: ``feedplan plan | check | replay | curves``."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, replace
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from feedplan.cli.app import (
    BROKEN,
    AsJson,
    CurveName,
    Machine,
    Scale,
    TableFile,
    Tolerance,
    app,
    exits,
    notice,
    report_verdict,
    require_apart,
    require_outputs,
    show,
    with_proof,
)
from feedplan.job import PATH_SHARE, Part, load_part, load_part_of_table, require_program
from planner.files.whole_file import require_writable

if TYPE_CHECKING:
    from rich.console import RenderableType

    from feedplan.progress import ProgressLine
    from feedplan.verdict import Verdict
    from planner.geometry.curve import Curve
    from planner.machine.limits import Limits
    from planner.profile import FeedrateProfile, Samples

_SAMPLES_AT_ONCE = 1_000_000  # bounds the memory that evaluating the plan takes


class Method(StrEnum):
    """Solvers of the plan command."""

    optimal = "optimal"
    nlp = "nlp"
    toppra = "toppra"
    scurve = "scurve"


@app.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan plan butterfly-nurbs -o table.csv\n"
        "  feedplan plan part.json --machine mill.toml --feed-mm-s 80 --plot plan.pdf\n"
        "  feedplan plan part.ngc --tolerance-mm 0.01 --program out.ngc\n"
    ),
)
def plan(
    curve: CurveName,
    *,
    machine: Machine = None,
    method: Annotated[Method, typer.Option(help="Solver; toppra knows no jerk limit.")] = Method.optimal,
    feed_mm_s: Annotated[float | None, typer.Option(help="Commanded feed, in place of the machine's.")] = None,
    scale: Scale = 1.0,
    period_s: Annotated[float | None, typer.Option(help="Interpolation period, in place of the machine's.")] = None,
    start_feed_mm_s: Annotated[float, typer.Option(help="Feed at the start of the path.")] = 0.0,
    end_feed_mm_s: Annotated[float, typer.Option(help="Feed at the end of the path.")] = 0.0,
    periodic: Annotated[bool, typer.Option("--periodic", help="Pass the end into the start without a stop.")] = False,
    exact_stop: Annotated[
        bool, typer.Option("--exact-stop", help="Stop wherever the curvature jumps, not only in corners.")
    ] = False,
    tolerance_mm: Tolerance = None,
    intervals: Annotated[int | None, typer.Option(help="Grid intervals; refinement chooses if left out.")] = None,
    budget_s: Annotated[float, typer.Option(help="Time after which to return the best plan so far.")] = math.inf,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Feedrate table, .csv or .npz.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure, .png, .pdf or .svg.")] = None,
    report: Annotated[Path | None, typer.Option(help="Page for a browser, .html.")] = None,
    program: Annotated[Path | None, typer.Option(help="LinuxCNC program of the plan; see feedplan ngc.")] = None,
    lines: Annotated[Path | None, typer.Option(help="Seconds of each line of a part program, .csv or .npz.")] = None,
    certificate: Annotated[Path | None, typer.Option(help="Proof of the lower bound, .npz; see check.")] = None,
    as_json: AsJson = False,
) -> None:
    """Plan the feed along a curve, and check the plan.

    The plan and its samples are checked on their own, without a formula of the planner; one verdict is printed.  Where a
    limit is broken no --program is written, and every other file says so.
    """
    with exits():
        files = Files(output, certificate, plot, report, program, lines)
        files.require_writable(curve, machine, method)
        share = 1.0 if program is None else PATH_SHARE
        part = load_part(curve, scale, machine, feed_mm_s, period_s, tolerance_mm, share, notice)
        path, limits = part.curve, part.limits
        from feedplan.progress import ProgressLine, load_kernels

        load_kernels()
        with ProgressLine() as line:
            started = time.perf_counter()
            profile = part.plan(
                line,
                method=method.value,
                start_feed=start_feed_mm_s,
                end_feed=end_feed_mm_s,
                periodic=periodic,
                budget=budget_s,
                intervals=intervals,
                exact_stop=exact_stop,
            )
            seconds = time.perf_counter() - started
            if method is not Method.toppra:
                profile = _bounded(path, limits, profile, certificate, line)
            verdict = part.judge(profile, line, seconds=seconds)
            if not verdict.ok:  # no machine gets a plan that breaks a limit
                files = replace(files, program=None)
            verdict = replace(verdict, files=files.names)
            if certificate is not None:
                from planner.output.certificate_file import read_certificate

                verdict = with_proof(verdict, read_certificate(certificate), line)
            files.write(part, verdict, curve, line)
        if files.program != program:
            typer.echo(f"{program}: not written, since the plan breaks a limit", err=True)
        report_verdict(verdict, as_json)


@dataclass(frozen=True)
class Files:
    """What the plan command writes; None is not asked for."""

    output: Path | None
    certificate: Path | None
    plot: Path | None
    report: Path | None
    program: Path | None
    lines: Path | None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files, in the order in which the verdict tells them."""
        every = (self.output, self.certificate, self.plot, self.report, self.program, self.lines)
        return tuple(str(name) for name in every if name is not None)

    def require_writable(self, curve: str, machine: str | None, method: Method) -> None:
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

    def write(self, part: Part, verdict: Verdict, source: str, line: ProgressLine) -> None:
        """Write all but the certificate, each saying so where the plan breaks a limit."""
        profile, limits, report = verdict.profile, verdict.limits, verdict.report
        if self.output is not None:
            from planner import write_table

            line(f"writing {self.output}")
            write_table(self.output, profile, limits, report=report)
        if self.program is not None:
            line(f"writing {self.program}")
            part.write(self.program, profile, "feed", report=report)
        if self.lines is not None:
            from planner.programs.times import write_line_times

            line(f"writing {self.lines}")
            write_line_times(self.lines, part.line_times(profile), source, report.summary())
        if self.plot is not None:
            from planner.output.plots import plot_plan, save_plot

            line(f"drawing {self.plot}")
            save_plot(self.plot, plot_plan(part.curve, limits, profile, verdict.samples, report))
        if self.report is not None:
            from feedplan.page import write_report

            lines = part.line_times(profile) if part.program else None
            write_report(self.report, verdict, lines=lines, progress=line)


def _bounded(
    curve: Curve, limits: Limits, profile: FeedrateProfile, certificate: Path | None, line: ProgressLine
) -> FeedrateProfile:
    """The plan with the tight bound, of which the certificate is written if a file is given.

    A plan is not lost for want of a bound: it then has none, and a note says why.
    """
    from planner import SolverError, certify

    line("bounding the time from below")
    try:
        bound = certify(curve, limits, profile)
    except SolverError as error:
        if certificate is not None:
            raise
        return replace(profile, lower_bound=math.nan, notes=(*profile.notes, f"no lower bound: {error}"))
    if certificate is not None:
        from planner.output.certificate_file import write_certificate

        line(f"writing {certificate}")
        write_certificate(certificate, bound.certificate)
    return replace(profile, lower_bound=float(bound))


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
    with exits():
        from feedplan.progress import ProgressLine, load_kernels
        from planner import read_table
        from planner.output.certificate_file import read_certificate

        part = load_part_of_table(table, curve, scale, machine, tolerance_mm)
        load_kernels()
        with ProgressLine() as line:
            line("reading the table")
            profile = read_table(table, part.curve)
            proof = None if certificate is None else read_certificate(certificate)
            verdict = part.judge(profile, line)
            if proof is not None:
                verdict = with_proof(verdict, proof, line)
        report_verdict(verdict, as_json)


@app.command(epilog="\b\nExample:\n  feedplan replay table.csv butterfly-nurbs --period-s 0.001 -o samples.csv")
def replay(
    table: TableFile,
    curve: CurveName,
    *,
    period_s: Annotated[float | None, typer.Option(help="Interpolation period, in place of the table's.")] = None,
    order: Annotated[int, typer.Option(help="1, 2, 3 (Taylor steps) or 5 (the plan itself).")] = 5,
    tolerance_mm: Tolerance = None,
    scale: Scale = 1.0,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Samples, .csv or .npz.")] = None,
) -> None:
    """Sample a feedrate table once a period.

    This is what an interpolator does.  Printed is how far the samples are off the plan and what they use of its limits.
    Exit code 1: they break a limit; a file of them says so.
    """
    with exits():
        require_apart([output], [table, curve])
        require_outputs(output, None)
        import interp
        from feedplan.progress import ProgressLine, load_kernels
        from planner import read_table
        from planner.output.table import write_samples
        from planner.verify import check as check_plan

        part = load_part_of_table(table, curve, scale, None, tolerance_mm)
        path = part.curve
        load_kernels()
        with ProgressLine() as line:
            line("reading the table")
            profile = read_table(table, path)
            line("sampling")
            samples = interp.replay(path, profile, period_s, order=order)
            line("measuring the samples")
            report = check_plan(path, part.limits, samples)
            apart = _distance(profile, samples)
            if output is not None:
                line(f"writing {output}")
                write_samples(output, path, samples, report)
        from feedplan.verdict import samples_text

        show(samples_text(profile, samples, report, apart, "" if output is None else str(output)))
        if not report.ok:
            raise typer.Exit(BROKEN)


@app.command(epilog="\b\nExample:\n  feedplan curves")
def curves() -> None:
    """List the named curves.

    Breaks are counted by what is still continuous there: G0 a corner, G1 the tangent, G2 the curvature, G3 its rate.
    """
    with exits():
        from planner import CATALOG, load_curve

        show(_curve_list({name: load_curve(name) for name in CATALOG}))


def _require_certifiable(certificate: Path, method: Method) -> None:
    """Refuse a certificate that could not be made or written before the work begins."""
    from planner.errors import InputError
    from planner.output.certificate_file import require_npz

    require_npz(certificate)
    require_writable(certificate)
    if method is Method.toppra:
        raise InputError("--certificate needs a lower bound; the method toppra gives none")


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


def _curve_list(found: dict[str, Curve]) -> RenderableType:
    from rich.console import Group
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="underline")
    for column in ("name", "axes", "length mm", "u from", "to", "breaks by order"):
        table.add_column(
            column, justify="left" if column in {"name", "axes", "breaks by order"} else "right", no_wrap=True
        )
    sources: dict[str, list[str]] = {}
    for name, curve in found.items():
        u0, u1 = curve.domain
        table.add_row(name, " ".join(curve.axes), f"{curve.length:.3f}", f"{u0:.6g}", f"{u1:.6g}", _smoothness(curve))
        sources.setdefault(_source(name), []).append(name)
    parts: list[RenderableType] = [table, ""]
    for source, names in sources.items():
        parts += [Text(f"{', '.join(names)}:"), Padding(Text(source), (0, 0, 0, 2))]
    return Group(*parts)


def _smoothness(curve: Curve) -> str:
    """Count the breaks by what is still continuous there: G0 a corner, G1 the tangent, G2 the curvature."""
    orders = [b.geometric for b in curve.breaks]
    return ", ".join(f"{orders.count(k)} G{k}" for k in range(4) if k in orders) or "none"


def _source(name: str) -> str:
    """Where the definition of a named curve was published."""
    text = resources.files("planner").joinpath(f"data/curves/{name}.json").read_text(encoding="utf-8")
    source = json.loads(text)["source"]
    if "control_points_from" in source:
        return str(source["control_points_from"])
    return f"{source['authors']}: {source['title']} ({source['year']})"
