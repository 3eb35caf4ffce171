"""What all commands share: the application, exit codes, what is refused before the work begins, and the verdict.

Exit codes: 0 every limit holds, 1 a limit is broken, 2 bad input, 3 no plan was found, 4 the installation is not whole,
130 interrupted.  A command loads the file named after it and no other, and nothing heavier than click loads before it runs.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn, TypedDict

import click

from planner import __version__
from planner.errors import BrokenLimitError, CoreError, FeedrateError, InputError
from planner.files.formats import file_format
from planner.files.whole_file import require_writable

if TYPE_CHECKING:
    from feedplan.verdict import Verdict


class Drawing(TypedDict, total=False):
    """How a figure looks, where it is not left to the one who draws it."""

    panels: tuple[str, ...]
    width_mm: float


BROKEN, BAD_INPUT, NO_PLAN, NOT_WHOLE, INTERRUPTED = 1, 2, 3, 4, 130

_HELP = """\
Time-optimal, jerk-limited feedrate plans for parametric tool paths.

A CURVE is a name that "feedplan curves" lists, a .json, .toml, .dxf or .csv
file, or a part program, .ngc.  A machine is a .toml file, the .ini of
LinuxCNC, the .cfg of Klipper, what GRBL answers to $$ (.txt), or one of the
examples "mill", "four-axis" and "five-axis".
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
  feedplan time part.ngc --machine mill.toml --tolerances-um 1,10,50
  feedplan time parts/*.ngc --machine mill.toml
  feedplan sweep part.ngc --machine mill.toml --scale jerk=1,2,4
  feedplan windows long.ngc --machine mill.toml -o plan.npz
  feedplan ngc part.ngc --machine mill.toml --tolerance-mm 0.01 -o out.ngc
  feedplan export table.csv butterfly-nurbs --counts-per-mm 10000 -o drives.csv
  feedplan report table.csv butterfly-nurbs -o report.html
  feedplan compare teardrop --machine mill.toml --plot compare.png
  feedplan calibrate logs/*.csv --machine start.toml -o machine.toml

\b
Exit codes: 0 every limit holds, 1 a limit is broken or a claim does not hold,
2 bad input, 3 no plan was found, 4 feedplan's compiled core is missing or
of other source: install it again.
"""

_COMMANDS = (
    "plan",
    "check",
    "replay",
    "compare",
    "report",
    "time",
    "sweep",
    "ngc",
    "export",
    "windows",
    "calibrate",
    "curves",
)  # as help lists them


class Commands(click.Group):
    """The commands, each in the module named after it, which loads when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of help."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load a command; None if there is none of that name."""
        if cmd_name not in _COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"feedplan.cli.{cmd_name}"), cmd_name)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; what it raises on purpose becomes an exit code."""
        with exits():
            return super().invoke(ctx)


@click.group(
    cls=Commands,
    help=_HELP,
    epilog=_EXAMPLES,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, prog_name="feedplan", message="%(prog)s %(version)s", help="Print the version.")
def app() -> None:
    """Hold the commands; the help of the group says what they do."""


def main() -> None:
    """Run the command line."""
    app(prog_name="feedplan")


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
        raise click.exceptions.Exit(INTERRUPTED) from None
    except FeedrateError as error:
        if interrupted:
            raise click.exceptions.Exit(INTERRUPTED) from None
        click.echo(f"error: {error}", err=True)
        raise click.exceptions.Exit(exit_code(error)) from None
    finally:
        signal.signal(signal.SIGINT, previous)


def exit_code(error: FeedrateError) -> int:
    """Return the exit code that an error stands for."""
    codes = {BrokenLimitError: BROKEN, InputError: BAD_INPUT, CoreError: NOT_WHOLE}
    return next((code for kind, code in codes.items() if isinstance(error, kind)), NO_PLAN)


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
    click.echo(text, err=True)


def report_verdict(verdict: Verdict, as_json: bool, *, aside: bool = False) -> None:
    """Print the verdict, on standard error if ``aside``, and leave with its exit code."""
    from feedplan.verdict import to_json
    from feedplan.verdict_text import to_text

    if as_json:
        click.echo(to_json(verdict), err=aside)
    else:
        show(to_text(verdict), aside=aside)
    if not verdict.ok:
        raise click.exceptions.Exit(BROKEN)


def show(lines: Sequence[str], *, aside: bool = False) -> None:
    """Print on standard output, or on standard error if ``aside``; colours are for a terminal that wants them."""
    plain = bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") == "dumb"
    click.echo("\n".join(lines), err=aside, color=False if plain else None)
