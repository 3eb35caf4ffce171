"""What all commands share: the application, types of arguments, exit codes, loading and the verdict.

Exit codes: 0 every limit holds, 1 a limit is broken, 2 bad input, 3 no plan was found, 130 interrupted.  Nothing
heavier than typer loads before a command runs.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, NoReturn, TypedDict

import typer

from planner import __version__
from planner.errors import BrokenLimitError, FeedrateError, InputError
from planner.files.formats import ANY_COLUMN_FORMAT, file_format
from planner.files.whole_file import require_writable

if TYPE_CHECKING:
    from rich.console import RenderableType

    from feedplan.verdict import Verdict


class Drawing(TypedDict, total=False):
    """How a figure looks, where it is not left to the one who draws it."""

    panels: tuple[str, ...]
    width_mm: float


BROKEN, BAD_INPUT, NO_PLAN, INTERRUPTED = 1, 2, 3, 130

_HELP = """\
Time-optimal, jerk-limited feedrate plans for parametric tool paths.

A CURVE is a name that "feedplan curves" lists, a .json, .toml, .dxf or .csv
file, or a part program, .ngc.  A machine is a .toml file, the .ini of a
LinuxCNC machine, or one of the examples "mill" and "five-axis".
Lengths are in mm, angles in rad, times in s.  "-" is standard input or output.
"""
_EXAMPLES = """\
\b
Examples:
  feedplan curves
  feedplan plan butterfly-nurbs -o table.csv --plot plan.png
  feedplan check table.csv butterfly-nurbs --machine mill.toml
  feedplan replay table.csv butterfly-nurbs --period-s 0.001 -o samples.csv
  feedplan time part.ngc --machine mill.toml --tolerance-mm 0.01
  feedplan windows long.ngc --machine mill.toml -o plan.npz
  feedplan ngc part.ngc --machine mill.toml --tolerance-mm 0.01 -o out.ngc
  feedplan report table.csv butterfly-nurbs -o report.html
  feedplan compare teardrop --machine mill.toml --plot compare.png

\b
Exit codes: 0 every limit holds, 1 a limit is broken or a claim does not hold,
2 bad input, 3 no plan was found.
"""

app = typer.Typer(
    help=_HELP,
    epilog=_EXAMPLES,
    rich_markup_mode=None,  # rich would double the time --help takes
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _curves(incomplete: str) -> list[str]:
    """Complete the name of a curve; where none begins so, the shell completes the name of a file."""
    text = resources.files("planner").joinpath("data", "curve_facts.json").read_text(encoding="utf-8")
    return [name for name in json.loads(text) if name.startswith(incomplete)]


def _machines(incomplete: str) -> list[str]:
    """Complete the name of an example machine."""
    found = (Path(entry.name).stem for entry in resources.files("planner").joinpath("data", "machines").iterdir())
    return sorted(name for name in found if name.startswith(incomplete))


CurveName = Annotated[
    str,
    typer.Argument(
        metavar="CURVE",
        help='Name of a curve, or a file: .json, .toml, .dxf, .csv, .ngc; "-" is standard input.',
        autocompletion=_curves,
    ),
]
TableFile = Annotated[
    Path, typer.Argument(metavar="TABLE", help=f'Feedrate table, {ANY_COLUMN_FORMAT}; "-" is standard input.')
]
Scale = Annotated[float, typer.Option(help="Multiplies the linear axes of the curve.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the verdict as JSON and nothing else.")]
Machine = Annotated[
    str | None,
    typer.Option(metavar="FILE", help="Machine file, .toml or .ini, or an example machine.", autocompletion=_machines),
]

Tolerance = Annotated[
    float | None,
    typer.Option(
        "--tolerance-mm", help="Distance allowed from a part program, in place of its P words, or from points."
    ),
]

PlotWidth = Annotated[
    float | None, typer.Option("--width-mm", help="Width of the figure; 85 is a paper's column, 180 its page.")
]


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


@contextmanager
def exits() -> Iterator[None]:
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
        if isinstance(error, BrokenLimitError):
            raise typer.Exit(BROKEN) from None
        raise typer.Exit(BAD_INPUT if isinstance(error, InputError) else NO_PLAN) from None
    finally:
        signal.signal(signal.SIGINT, previous)


def require_apart(outputs: Sequence[Path | None], inputs: Sequence[str | Path | None]) -> None:
    """Refuse an output that would replace an input, or another output."""
    taken = {Path(name).resolve(): f"is an input of this command: {name}" for name in inputs if name is not None}
    for output in outputs:
        if output is None:
            continue
        if reason := taken.get(output.resolve()):
            raise InputError(f"{output}: {reason}; give another name for the output")
        taken[output.resolve()] = "is given for two outputs"


def require_outputs(table: Path | None, plot: Path | None, report: Path | None = None) -> None:
    """Refuse an output that could not be written before the work begins."""
    if table is not None:
        file_format(table)
        require_writable(table)
    if plot is not None:
        from planner.output.figures import figure_format

        figure_format(plot)
        require_writable(plot)
    if report is not None:
        from feedplan.page import require_report

        require_report(report)


def require_figure(plot: Path | None, panels: str | None, width_mm: float | None, allowed: Sequence[str]) -> Drawing:
    """What a command was told of its figure, refused before the work begins where it cannot be drawn."""
    if plot is None:
        for option, value in (("--panels", panels), ("--width-mm", width_mm)):
            if value is not None:
                raise InputError(f"{option} says how a figure looks, and none is asked for; add --plot FILE")
        return {}
    from planner.output.panel_choice import panel_names, require_width

    chosen: Drawing = {}
    if panels is not None:
        chosen["panels"] = panel_names(panels, allowed)
    if width_mm is not None:
        chosen["width_mm"] = require_width(width_mm)
    return chosen


def notice(text: str) -> None:
    """Say on standard error what is no error and yet worth knowing."""
    typer.echo(text, err=True)


def report_verdict(verdict: Verdict, as_json: bool, *, aside: bool = False) -> None:
    """Print the verdict, on standard error if ``aside``, and leave with its exit code."""
    from feedplan.verdict import to_json
    from feedplan.verdict_text import to_text

    if as_json:
        typer.echo(to_json(verdict), err=aside)
    else:
        show(to_text(verdict), aside=aside)
    if not verdict.ok:
        raise typer.Exit(BROKEN)


def show(text: RenderableType, *, aside: bool = False) -> None:
    """Print on standard output, or on standard error if ``aside``, nothing highlighted."""
    from rich.console import Console

    Console(highlight=False, markup=False, emoji=False, stderr=aside).print(text)
