"""How long each line of a part program takes: ``feedplan time``."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import options
from feedplan.cli.app import BROKEN, notice, require_apart, require_outputs, show
from feedplan.cli.streams import Streams
from feedplan.sources import require_program
from planner.files.formats import ANY_COLUMN_FORMAT

if TYPE_CHECKING:
    from planner.geometry.tolerance import PathKind, PathSide


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan time part.ngc --machine mill.toml\n"
        "  feedplan time part.ngc --machine machine.ini --tolerance-mm 0.01 -o lines.csv\n"
        "  feedplan time part.ngc --machine mill --rows 0 --tolerances-um\n"
    ),
)
@options.program
@options.machine
@options.tolerance
@options.tolerances
@options.tools
@options.ignore
@options.reader
@options.path
@options.side
@click.option("--feed-mm-s", type=float, help="Largest feed, in place of the machine's.")
@click.option("--tool-change-s", type=float, help="Time of a tool change, in place of the machine file's.")
@options.controllers
@options.controller_settings
@click.option("--rows", type=click.IntRange(min=0), default=12, help="How many of the longest lines to print.")
@click.option("--output", "-o", type=options.FILE, help=f"Every line, {ANY_COLUMN_FORMAT}.")
@options.as_json
def time(
    program: str,
    *,
    machine: str | None,
    complete: dict[str, float],
    tolerance_mm: float | None,
    tolerances: tuple[float, ...] | None,
    tools: Path | None,
    ignore: tuple[str, ...],
    reader: str,
    path: PathKind | None,
    side: PathSide | None,
    feed_mm_s: float | None,
    tool_change_s: float | None,
    controllers: tuple[str, ...],
    controller_settings: tuple[str, ...],
    rows: int,
    output: Path | None,
    as_json: bool,
) -> None:
    """Tell the time of a part program, and of each line of it.

    The total has motion, dwells, and tool changes if the machine file or --tool-change-s says how long one takes.  Beside
    it, the least time of the same path without a jerk limit, with --tolerances-um what another tolerance saves, and with
    --controller what a model of another controller takes on the same machine.
    Exit code 1: a plan breaks a limit.
    """
    with Streams() as at:
        program, output = at.program(program), at.output(output, ".csv")
        require_program(program, "feedplan time")
        require_apart([output], [program, machine])
        require_outputs(output, None)
        given: dict[str, Any] = {
            "complete": complete, "feed": feed_mm_s, "tools": tools, "ignore": ignore, "reader": reader,
            "path": path,
            "side": side,
        }  # fmt: skip
        from feedplan.controller_text import controller_facts, controller_lines
        from feedplan.controller_time import chosen_controllers, controller_times
        from feedplan.program_time import time_program
        from feedplan.progress import ProgressLine
        from feedplan.time_text import time_facts, time_text
        from feedplan.tolerances import time_of_tolerances, tolerance_facts, tolerance_lines

        chosen = chosen_controllers(controllers, controller_settings)
        with ProgressLine() as line:
            elsewhere = controller_times(
                program, machine, chosen, complete=complete, feed=feed_mm_s, tools=tools, ignore=ignore, reader=reader
            )
            found = time_program(
                program,
                machine,
                tool_change_s=tool_change_s,
                progress=line,
                tolerance=tolerance_mm,
                notice=notice,
                **given,
            )
            found = replace(found, program=at.told(program))
            if output is not None:
                line(f"writing {output}")
                found.write_lines(output)
            others = None
            if tolerances is not None:
                others = time_of_tolerances(program, machine, tolerances, progress=line, **given)
        if as_json:
            facts = time_facts(found)
            if others is not None:
                facts["tolerances"] = tolerance_facts(found.planned, others)
            if elsewhere:
                facts["controllers"] = controller_facts(found, elsewhere)
            click.echo(json.dumps(facts, indent=2, allow_nan=False), err=at.taken)
        else:
            text = time_text(found, rows, "" if output is None else at.told(str(output)))
            if others is not None:
                text += ["", *tolerance_lines(found.planned, others)]
            if elsewhere:
                text += ["", *controller_lines(found, elsewhere, rows)]
            show(text, aside=at.taken)
        if not found.ok or any(row.breaks for row in others or ()):
            raise click.exceptions.Exit(BROKEN)
