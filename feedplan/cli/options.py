"""Arguments and options that several commands have, each a decorator, and how the shell completes them."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from feedplan.tolerances import USUAL_UM, read_tolerances
from planner.data import FOLDER, data_text
from planner.files.formats import ANY_COLUMN_FORMAT

_COMPLETED = (("velocity", "s"), ("acceleration", "s2"), ("jerk", "s3"))
FILE = click.Path(path_type=Path)
"""Type of a file; what is wrong with it is said where it is opened."""


def curve_names(incomplete: str) -> list[str]:
    """Names of curves that begin so."""
    return [name for name in json.loads(data_text("curve_facts.json")) if name.startswith(incomplete)]


def machine_names(incomplete: str) -> list[str]:
    """Names of example machines that begin so."""
    return sorted(file.stem for file in (FOLDER / "machines").iterdir() if file.stem.startswith(incomplete))


def _or_files(names: list[str], incomplete: str) -> list[CompletionItem]:
    """Where no name begins so, the shell completes the name of a file."""
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


override_reserve = click.option(
    "--override-reserve",
    type=float,
    default=0.0,
    metavar="SHARE",
    help="Share of every jerk limit, and a third of it of every acceleration limit, left for feed override and hold.",
)
curve = click.argument(
    "curve",
    metavar="CURVE",
    help='Name of a curve, or a file: .json, .toml, .dxf, .csv, .ngc; "-" is standard input.',
    shell_complete=lambda _context, _parameter, incomplete: _or_files(curve_names(incomplete), incomplete),
)
table = click.argument(
    "table", metavar="TABLE", type=FILE, help=f'Feedrate table, {ANY_COLUMN_FORMAT}; "-" is standard input.'
)
program = click.argument("program", metavar="PROGRAM", type=click.Path(), help="Part program, .ngc.")
programs = click.argument(
    "programs",
    metavar="PROGRAM...",
    nargs=-1,
    required=True,
    type=click.Path(),
    help="Part programs, .ngc, or folders of them.",
)
_MACHINE: dict[str, Any] = {
    "metavar": "FILE",
    "help": "Machine file (.toml; .ini of LinuxCNC, .cfg of Klipper, $$ of GRBL), or an example machine.",
    "shell_complete": lambda _context, _parameter, incomplete: _or_files(machine_names(incomplete), incomplete),
}
_COMPLETIONS = tuple(f"{key}_{unit}_{time}" for unit in ("mm", "rad") for key, time in _COMPLETED)
"""As :data:`planner.machine.machine_table.COMPLETIONS`, which takes numpy to load."""


def machine(command: Callable[..., None]) -> Callable[..., None]:
    """The machine, and ``complete``: limits for the axes that its file has none for, by their keys."""
    return click.option("--machine", **_MACHINE)(_completed(command))


def machines(command: Callable[..., None]) -> Callable[..., None]:
    """The same of several machines."""
    several = _MACHINE | {"help": f"{_MACHINE['help']}  May be repeated."}
    return click.option("--machine", "machines", multiple=True, **several)(_completed(command))


def _completed(command: Callable[..., None]) -> Callable[..., None]:
    @functools.wraps(command)
    def with_completions(**values: Any) -> None:
        given = {key: values.pop(key) for key in _COMPLETIONS}
        command(**values, complete={key: value for key, value in given.items() if value is not None})

    for key in reversed(_COMPLETIONS):
        quantity = key.partition("_")[0].capitalize()
        which = "that turn and have" if "_rad_" in key else "that have"
        said = f"{quantity} limit of axes {which} none in the machine file."
        with_completions = click.option(f"--{key.replace('_', '-')}", type=float, help=said)(with_completions)
    return with_completions


scale = click.option("--scale", type=float, default=1.0, help="Multiplies the linear axes of the curve.")
tolerance = click.option(
    "--tolerance-mm",
    type=float,
    help="Distance allowed from a part program, in place of its P words, or from points.",
)
tolerances = click.option(
    "--tolerances-um",
    "tolerances",
    is_flag=False,
    flag_value=(_USUAL := ",".join(map(str, USUAL_UM))),
    metavar="[A,B,...]",
    help=f"Say what the tolerance buys: the time within each of these, {_USUAL} if none are named.",
    callback=lambda _context, _parameter, text: None if text is None else read_tolerances(text, "--tolerances-um"),
)
controllers = click.option(
    "--controller",
    "controllers",
    multiple=True,
    metavar="NAME",
    help="Controller to time it on as well, by a model: klipper, grbl, linuxcnc, several with commas, or all.",
)
controller_settings = click.option(
    "--controller-setting",
    "controller_settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="What the controller goes by in place of the machine file, as junction_deviation_mm=0.02; may be repeated.",
)
tools = click.option("--tools", type=FILE, help="Tool table of LinuxCNC, .tbl, for a part program's G41, G42 and G43.")
setup = click.option(
    "--setup",
    metavar="FILE",
    help="Machine file with the homes and offsets that a part program was planned with; else those of --machine.",
)
ignore = click.option(
    "--ignore",
    multiple=True,
    metavar="WORD",
    help="Word of a part program to pass over, as A or M123; may be repeated.",
)
reader = click.option(
    "--reader",
    type=click.Choice(["feedplan", "rs274"]),
    default="feedplan",
    show_default=True,
    help="Who reads a part program: this, or the interpreter of an installed LinuxCNC.",
)
path = click.option(
    "--path",
    type=click.Choice(["joint", "separate"]),
    help="Path of a part program: found with its feed as one problem (joint, the default), or before it.",
)
path_to_compare = click.option(
    "--path",
    type=click.Choice(["joint", "separate"]),
    help="Path of a part program: found before its feed (separate, the default), or with that of the optimal plan.",
)
path_of_table = click.option(
    "--path",
    type=click.Choice(["joint", "separate"]),
    help="How the path of a part program was made; else as the table says.",
)
_SIDES = click.Choice(["both", "left", "right", "inside", "outside"])
side = click.option(
    "--side",
    type=_SIDES,
    help="Where the path may leave a part program to: both sides, that of the motion, or that of closed contours.",
)
side_of_table = click.option("--side", type=_SIDES, help="Where the path may leave it to; else as the table says.")
layer = click.option("--layer", metavar="NAME", help="Layer of a drawing: only what is on it.")
chain = click.option(
    "--chain", type=int, metavar="N", help="Chain of a drawing that has several; without it they are listed."
)
commanded_feed = click.option("--feed-mm-s", type=float, help="Commanded feed, in place of the machine's.")
period = click.option("--period-s", type=float, help="Interpolation period, in place of the machine's.")
plot_width = click.option("--width-mm", type=float, help="Width of the figure; 85 is a paper's column, 180 its page.")
as_json = click.option("--json", "as_json", is_flag=True, help="Print the verdict as JSON and nothing else.")
