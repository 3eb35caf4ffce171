"""How long each line of a part program takes: ``feedplan time``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import batches, options
from feedplan.cli.app import BROKEN, notice, require_apart, require_outputs, show
from feedplan.cli.streams import Streams
from feedplan.sources import require_program
from planner.errors import InputError
from planner.files.formats import ANY_COLUMN_FORMAT
from planner.files.whole_file import require_writable

if TYPE_CHECKING:
    from feedplan.controller_time import ControllerTime
    from feedplan.program_time import ProgramTime
    from feedplan.tolerances import ToleranceTime
    from planner.geometry.tolerance import PathKind, PathSide

_ROWS = 12


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan time part.ngc --machine mill.toml\n"
        "  feedplan time part.ngc --machine machine.ini --tolerance-mm 0.01 -o lines.csv\n"
        "  feedplan time part.ngc --machine mill --rows 0 --tolerances-um\n"
        "  feedplan time parts/*.ngc --machine mill.toml -o times.csv\n"
    ),
)
@options.programs
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
@click.option("--costs", is_flag=True, help="Say what each limit costs: plan again with 10 % more of each.")
@click.option(
    "--rows",
    type=click.IntRange(min=0),
    show_default=str(_ROWS),
    help="How many of the longest lines to print; of one program.",
)
@click.option(
    "--output", "-o", type=options.FILE, help=f"Every line, or of several every program, {ANY_COLUMN_FORMAT}."
)
@click.option("--post", type=options.FILE, help="The program with its time in comments.")
@click.option(
    "--in-place", is_flag=True, help="Write the time into the program itself, in place of one written before."
)
@batches.jobs
@batches.scheduler
@options.as_json
def time(
    programs: tuple[str, ...],
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
    costs: bool,
    rows: int | None,
    output: Path | None,
    post: Path | None,
    in_place: bool,
    jobs: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Tell the time of a part program, and of each line of it; or of many programs, a row each.

    The total has motion, dwells, and tool changes if the machine file or --tool-change-s says how long one takes.  Beside
    it, the least time of the same path without a jerk limit, with --tolerances-um what another tolerance saves, and with
    --controller what a model of another controller takes on the same machine.
    Exit code 1: a plan breaks a limit.

    Several programs, or folders, are timed side by side on every core, or by the workers of a Dask scheduler.  One that
    fails does not stop the rest: its row says why.  The exit code is the largest that one of them would have alone.
    """
    with Streams() as at:
        if batches.are_many(programs) or jobs is not None or scheduler is not None:
            batches.require_one_program(
                {
                    "--rows": rows,
                    "--tolerances-um": tolerances,
                    "--costs": costs or None,
                    "--post": post,
                    "--in-place": in_place or None,
                    "--controller": controllers or None,
                    "--controller-setting": controller_settings or None,
                }
            )
            alike: dict[str, Any] = {
                "feed": feed_mm_s, "tool_change_s": tool_change_s, "tools": tools, "ignore": ignore, "reader": reader,
                "path": path, "side": side,
            }  # fmt: skip
            hands = batches.Hands(jobs, scheduler)
            batches.time_many(at, programs, machine, complete, tolerance_mm, alike, hands, output, as_json)
            return
        program, output = at.program(programs[0]), at.output(output, ".csv")
        require_program(program, "feedplan time")
        post = _posted(at, program, post, in_place)
        require_apart([output, None if in_place else post], [program, machine, tools])
        require_outputs(output, None)
        given: dict[str, Any] = {
            "complete": complete, "feed": feed_mm_s, "tools": tools, "ignore": ignore, "reader": reader,
            "path": path,
            "side": side,
        }  # fmt: skip
        from feedplan.controller_time import chosen_controllers, controller_times
        from feedplan.program_time import time_program
        from feedplan.progress import ProgressLine
        from feedplan.time_comment import write_with_time
        from feedplan.tolerances import time_of_tolerances

        chosen = chosen_controllers(controllers, controller_settings)
        with ProgressLine() as line:
            elsewhere = controller_times(
                program, machine, chosen, complete=complete, feed=feed_mm_s, tools=tools, ignore=ignore, reader=reader
            )
            found = time_program(
                program,
                machine,
                tool_change_s=tool_change_s,
                costs=costs,
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
            if post is not None and found.ok:
                line(f"writing {post}")
                write_with_time(post, found)
        written = [at.told(str(file)) for file in (output, post if found.ok else None) if file is not None]
        _tell(at, found, others, elsewhere, _ROWS if rows is None else rows, written, as_json)
        if post is not None and not found.ok:
            notice(f"{at.told(str(post))}: not written, for the plan breaks a limit")
        if not found.ok or any(row.breaks for row in others or ()):
            raise click.exceptions.Exit(BROKEN)


def _tell(
    at: Streams,
    found: ProgramTime,
    others: Sequence[ToleranceTime] | None,
    elsewhere: Sequence[ControllerTime],
    rows: int,
    written: Sequence[str],
    as_json: bool,
) -> None:
    """Show the time of a program, and what was asked for beside it, as text or as JSON."""
    from feedplan.controller_text import controller_facts, controller_lines
    from feedplan.time_text import time_facts, time_text
    from feedplan.tolerances import tolerance_facts, tolerance_lines

    if as_json:
        facts = time_facts(found)
        if others is not None:
            facts["tolerances"] = tolerance_facts(found.planned, others)
        if elsewhere:
            facts["controllers"] = controller_facts(found, elsewhere)
        click.echo(json.dumps(facts, indent=2, allow_nan=False), err=at.taken)
        return
    text = time_text(found, rows, written)
    if others is not None:
        text += ["", *tolerance_lines(found.planned, others)]
    if elsewhere:
        text += ["", *controller_lines(found, elsewhere, rows)]
    show(text, aside=at.taken)


def _posted(at: Streams, program: str, post: Path | None, in_place: bool) -> Path | None:
    """The file that the program is written to with its time, refused before the work begins where it cannot be."""
    if in_place and post is not None:
        raise InputError("--in-place writes into the program, --post into another file; give one of them")
    if in_place and at.told(program) != program:
        raise InputError("--in-place needs a file to write to, and the program is standard input; give --post")
    file = Path(program) if in_place else at.output(post, ".ngc")
    if file is not None:
        require_writable(file)
    return file
