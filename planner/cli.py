"""The ``feedplan`` command.

Exit codes: 0 every limit holds, 1 a limit is broken, 2 bad input, 3 no plan was found, 130 interrupted.  Nothing
heavier than typer loads before a command runs.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from enum import StrEnum
from importlib import resources
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from planner import __version__
from planner.errors import FeedrateError, InputError
from planner.output import require_writable

if TYPE_CHECKING:
    from rich.console import RenderableType

    from planner.geometry.curve import Curve
    from planner.limits import Limits
    from planner.profile import FeedrateProfile, Samples
    from planner.progress import ProgressLine
    from planner.verdict import Verdict

BROKEN, BAD_INPUT, NO_PLAN, INTERRUPTED = 1, 2, 3, 130
_SAMPLES_AT_ONCE = 1_000_000  # bounds the memory that evaluating the plan takes

_HELP = """\
Time-optimal, jerk-limited feedrate plans for parametric tool paths.

A CURVE is a name that "feedplan curves" lists, or a .json or .toml file.
A machine is a .toml file, or one of the examples "mill" and "five-axis".
Lengths are in mm, angles in rad, times in s.
"""
_EXAMPLES = """\
\b
Examples:
  feedplan curves
  feedplan plan butterfly-nurbs -o table.csv --plot plan.png
  feedplan check table.csv butterfly-nurbs --machine mill.toml
  feedplan replay table.csv butterfly-nurbs --period-s 0.001 -o samples.csv

\b
Exit codes: 0 every limit holds, 1 a limit is broken, 2 bad input,
3 no plan was found.
"""

app = typer.Typer(
    help=_HELP,
    epilog=_EXAMPLES,
    rich_markup_mode=None,  # rich would double the time --help takes
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Method(StrEnum):
    """Solvers of the plan command."""

    optimal = "optimal"
    nlp = "nlp"
    toppra = "toppra"
    scurve = "scurve"


CurveName = Annotated[str, typer.Argument(metavar="CURVE", help="Name of a curve, or a .json or .toml file.")]
TableFile = Annotated[Path, typer.Argument(metavar="TABLE", help="Feedrate table, .csv or .npz.")]
Scale = Annotated[float, typer.Option(help="Multiplies the linear axes of the curve.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the verdict as JSON and nothing else.")]
Machine = Annotated[str | None, typer.Option(metavar="FILE", help="Machine file, .toml, or an example machine.")]


def main() -> None:
    """Run the command line."""
    try:
        app(prog_name="feedplan")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"feedplan {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan plan butterfly-nurbs -o table.csv\n"
        "  feedplan plan part.json --machine mill.toml --feed-mm-s 80 --plot plan.pdf\n"
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
    intervals: Annotated[int | None, typer.Option(help="Grid intervals; refinement chooses if left out.")] = None,
    budget_s: Annotated[float, typer.Option(help="Time after which to return the best plan so far.")] = math.inf,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Feedrate table, .csv or .npz.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure, .png, .pdf or .svg.")] = None,
    as_json: AsJson = False,
) -> None:
    """Plan the feed along a curve, and check the plan.

    The plan and its samples are checked on their own, without a formula of the planner; one verdict is printed.
    """
    with _exits():
        _require_outputs(output, plot)
        path, limits, machine_name = _load(curve, scale, machine, feed_mm_s, period_s)
        from planner import SolverError, certify, plan_feedrate, write_table
        from planner.progress import ProgressLine

        _load_kernels()
        with ProgressLine() as line:
            started = time.perf_counter()
            profile = plan_feedrate(
                path,
                limits,
                method=method.value,
                start_feed=start_feed_mm_s,
                end_feed=end_feed_mm_s,
                periodic=periodic,
                budget=budget_s,
                intervals=intervals,
                exact_stop=exact_stop,
                progress=line,
            )
            seconds = time.perf_counter() - started
            if method is not Method.toppra:
                line("bounding the time from below")
                with suppress(SolverError):  # the plan keeps its own, looser bound
                    profile = replace(profile, lower_bound=certify(path, limits, profile))
            if output is not None:
                line(f"writing {output}")
                write_table(output, profile, limits)
            files = tuple(str(name) for name in (output, plot) if name is not None)
            verdict = _judge(profile, limits, machine_name, line, seconds=seconds, files=files)
            if plot is not None:
                from planner.plots import plot_plan, save_plot

                line(f"drawing {plot}")
                save_plot(plot, plot_plan(path, limits, profile, verdict.samples))
        _report(verdict, as_json)


@app.command(epilog="\b\nExample:\n  feedplan check table.csv butterfly-nurbs --machine mill.toml")
def check(
    table: TableFile,
    curve: CurveName,
    *,
    machine: Machine = None,
    scale: Scale = 1.0,
    as_json: AsJson = False,
) -> None:
    """Check a feedrate table and the samples of it.

    Nothing of the planner is used.  Without --machine the limits in the table's own header count.
    """
    with _exits():
        from planner import load_curve, load_limits, read_table, table_limits
        from planner.progress import ProgressLine

        path = load_curve(curve, scale=scale)
        limits = load_limits(machine).for_curve(path) if machine else None
        _load_kernels()
        with ProgressLine() as line:
            line("reading the table")
            profile = read_table(table, path)
            if limits is None:
                limits = table_limits(table)
            verdict = _judge(profile, limits, machine or f"limits in {table}", line)
        _report(verdict, as_json)


@app.command(epilog="\b\nExample:\n  feedplan replay table.csv butterfly-nurbs --period-s 0.001 -o samples.csv")
def replay(
    table: TableFile,
    curve: CurveName,
    *,
    period_s: Annotated[float | None, typer.Option(help="Interpolation period, in place of the table's.")] = None,
    order: Annotated[int, typer.Option(help="1, 2, 3 (Taylor steps) or 5 (the plan itself).")] = 5,
    scale: Scale = 1.0,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Samples, .csv or .npz.")] = None,
) -> None:
    """Sample a feedrate table once a period.

    This is what an interpolator does.  Printed is how far the samples are off the plan and what they use of its limits.
    """
    with _exits():
        _require_outputs(output, None)
        import interp
        from planner import load_curve, read_table, table_limits
        from planner.check import check as check_plan
        from planner.progress import ProgressLine
        from planner.tables import write_samples

        path = load_curve(curve, scale=scale)
        _load_kernels()
        with ProgressLine() as line:
            line("reading the table")
            profile = read_table(table, path)
            line("sampling")
            samples = interp.replay(path, profile, period_s, order=order)
            line("measuring the samples")
            report = check_plan(path, table_limits(table), samples)
            apart = _distance(profile, samples)
            if output is not None:
                line(f"writing {output}")
                write_samples(output, path, samples)
        from planner.verdict import samples_text

        _print(samples_text(profile, samples, report, apart, "" if output is None else str(output)))


@app.command(epilog="\b\nExample:\n  feedplan curves")
def curves() -> None:
    """List the named curves.

    Breaks are counted by what is still continuous there: G0 a corner, G1 the tangent, G2 the curvature, G3 its rate.
    """
    with _exits():
        from planner import CATALOG, load_curve

        _print(_curve_list({name: load_curve(name) for name in CATALOG}))


@contextmanager
def _exits() -> Iterator[None]:
    """Turn what we raise on purpose into a line on standard error and an exit code; the rest keeps its traceback."""
    interrupted = False

    def remember(number: int, frame: FrameType | None) -> NoReturn:
        # A solver in compiled code may report an interrupt as a failure of its own.
        nonlocal interrupted
        interrupted = True
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGINT, remember)
    try:
        yield
    except KeyboardInterrupt:
        raise typer.Exit(INTERRUPTED) from None
    except FeedrateError as error:
        if interrupted:
            raise typer.Exit(INTERRUPTED) from None
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(BAD_INPUT if isinstance(error, InputError) else NO_PLAN) from None
    finally:
        signal.signal(signal.SIGINT, previous)


def _require_outputs(table: Path | None, plot: Path | None) -> None:
    """Refuse an output that could not be written before the work begins."""
    if table is not None:
        from planner.tablefile import file_format

        file_format(table)
        require_writable(table)
    if plot is not None:
        from planner.plots import figure_format

        figure_format(plot)
        require_writable(plot)


def _load(
    curve: str, scale: float, machine: str | None, feed: float | None, period: float | None
) -> tuple[Curve, Limits, str]:
    """Load curve and limits; without a machine, the example that has the curve's axes."""
    from planner import load_curve, load_limits
    from planner.geometry.curve import ROTARY_AXES

    path = load_curve(curve, scale=scale)
    example = "five-axis" if ROTARY_AXES & set(path.axes) else "mill"
    limits = load_limits(machine or example).for_curve(path)
    if feed is not None:
        limits = limits.with_feed(feed)
    if period is not None:
        limits = limits.with_period(period)
    return path, limits, machine or f"{example} (example machine)"


def _load_kernels() -> None:
    import interp
    import planner
    from planner.progress import load_kernels

    load_kernels(planner, interp)


def _judge(
    profile: FeedrateProfile,
    limits: Limits,
    machine: str,
    line: ProgressLine,
    *,
    seconds: float = math.nan,
    files: tuple[str, ...] = (),
) -> Verdict:
    """Check a plan and the samples of it, each on its own."""
    import interp
    from planner.check import check as check_plan
    from planner.verdict import Verdict

    curve = profile.curve
    line("checking the plan")
    plan_report = check_plan(curve, limits, profile)
    line("checking the samples")
    samples = interp.replay(curve, profile, limits.period)
    samples_report = check_plan(curve, limits, samples)
    return Verdict(profile, limits, machine, samples, plan_report, samples_report, seconds, files)


def _report(verdict: Verdict, as_json: bool) -> None:
    """Print the verdict and leave with its exit code."""
    from planner.verdict import to_json, to_text

    if as_json:
        typer.echo(to_json(verdict))
    else:
        _print(to_text(verdict))
    if not verdict.ok:
        raise typer.Exit(BROKEN)


def _print(text: RenderableType) -> None:
    from rich.console import Console

    Console(highlight=False, markup=False, emoji=False).print(text)


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
