"""A machine's limits from a controller's logs: ``feedplan calibrate``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli import options
from feedplan.cli.app import require_apart, show
from planner.errors import InputError
from planner.files.whole_file import require_writable, whole_file

if TYPE_CHECKING:
    from feedplan.calibration import FoundMachine


@click.command(
    epilog=(
        "\b\nExamples:\n"
        "  feedplan calibrate logs/*.csv --machine start.toml -o machine.toml\n"
        "  feedplan calibrate times.csv --controller grbl --machine start.toml -o machine.toml\n"
        "  feedplan calibrate positions.csv --period-s 0.001 --machine mill -o machine.toml\n"
    ),
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=options.FILE)
@options.machine
@click.option("--output", "-o", required=True, type=options.FILE, help="Machine file to write, .toml.")
@click.option("--period-s", type=float, help="Time between two samples, for logs without a column of time.")
@click.option(
    "--controller", metavar="NAME", help="Whose model times of programs are compared with; else each is tried."
)
@click.option("--trust-units", is_flag=True, help="Believe the units of the columns whatever the machine file says.")
@options.as_json
def calibrate(
    logs: tuple[Path, ...],
    *,
    machine: str | None,
    complete: dict[str, float],
    output: Path,
    period_s: float | None,
    controller: str | None,
    trust_units: bool,
    as_json: bool,
) -> None:
    """Find a machine's limits in logs of a controller.

    A LOG is CSV whose first line names columns and units: time and positions of axes (t_s,X_mm,Y_mm), or the times of
    programs (program,seconds).  A program beside a log, under its name, says what feed was asked for.  What the logs
    cannot tell stays as in the machine file, and is said.
    """
    if machine is None:
        raise InputError("--machine is needed: the machine file to start from, which says what the logs cannot")
    if output.suffix.lower() != ".toml":
        raise InputError(f'{output}: the suffix "{output.suffix}" must be .toml')
    require_apart([output], [*logs, machine])
    require_writable(output)
    from feedplan.calibration import calibrate_files
    from feedplan.progress import ProgressLine

    with ProgressLine() as line:
        found = calibrate_files(
            logs,
            machine,
            complete=complete,
            period=period_s,
            controller=controller,
            trust_units=trust_units,
            progress=line,
        )
    with whole_file(output) as file:
        file.write(found.toml(output.resolve().parent).encode())
    if as_json:
        click.echo(json.dumps(_facts(found, output), indent=2, allow_nan=False))
    else:
        from feedplan.calibration import calibration_lines

        show(calibration_lines(found, str(output)))


def _facts(found: FoundMachine, output: Path) -> dict[str, Any]:
    from feedplan.calibration import calibration_facts

    return {**calibration_facts(found), "written": str(output)}
