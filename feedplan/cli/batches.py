"""What commands share that time many part programs: who does it, what is printed and written, and the exit code."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from feedplan.cli.app import BROKEN, INTERRUPTED, exit_code, notice, require_apart, require_outputs, show
from planner.errors import InputError

if TYPE_CHECKING:
    from feedplan.batch_times import TimeRow, TimeRows, TimingCase, TimingOptions
    from feedplan.cli.streams import Streams

scheduler = click.option(
    "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers time the programs, tcp://host:port."
)
jobs = click.option(
    "--jobs", type=click.IntRange(min=1), metavar="N", help="Processes that time the programs; one a core if left out."
)


@dataclass(frozen=True)
class Hands:
    """Who times the programs: so many processes, one a core if None; or the workers of a scheduler."""

    jobs: int | None
    scheduler: str | None


def are_many(programs: Sequence[str]) -> bool:
    """Whether names stand for other than one file."""
    return len(programs) != 1 or os.path.isdir(programs[0])


def require_one_program(options: Mapping[str, object]) -> None:
    """Refuse options that are for one program, where several are named."""
    for name, given in options.items():
        if given is not None:
            raise InputError(f"{name} is for one program, and several are named; leave it out, or name one")


def time_many(
    at: Streams,
    programs: Sequence[str],
    machine: str | None,
    complete: Mapping[str, float],
    tolerance: float | None,
    alike: Mapping[str, Any],
    hands: Hands,
    output: Path | None,
    as_json: bool,
) -> None:
    """Time part programs on one machine, and print a row each."""
    from feedplan.batch_text import rows_facts, rows_text
    from feedplan.batch_times import NamedMachine, TimingCase, TimingOptions
    from feedplan.job import load_machine
    from feedplan.program_files import find_programs

    found, name = load_machine(machine, complete=complete)
    files, notes = find_programs(programs)
    cases = [TimingCase(file, NamedMachine(name, found), tolerance) for file in files]
    report_rows(at, cases, TimingOptions(**alike), notes, hands, output, as_json, (rows_text, rows_facts))


def report_rows(
    at: Streams,
    cases: Sequence[TimingCase],
    options: TimingOptions,
    notes: Sequence[str],
    hands: Hands,
    output: Path | None,
    as_json: bool,
    shown: tuple[Callable[[TimeRows, Sequence[str], str], list[str]], Callable[[TimeRows], list[dict[str, Any]]]],
) -> None:
    """Time cases, write and print the rows, and leave with the largest of their exit codes.

    ``shown``: what makes text of them for a person, with the notes and the name of the file; and plain values, a row each.
    """
    from feedplan.batch_text import rows_json, write_rows

    output = at.output(output, ".csv")
    require_apart([output], [case.file.path for case in cases])
    require_outputs(output, None)
    found = _timed(cases, options, hands)
    if output is not None:
        write_rows(output, shown[1](found))
    if as_json:
        click.echo(rows_json(found, notes, shown[1](found)), err=at.taken)
    else:
        show(shown[0](found, notes, "" if output is None else at.told(str(output))), aside=at.taken)
    code = INTERRUPTED if found.interrupted else max(map(_row_code, found.rows), default=0)
    if code:
        raise click.exceptions.Exit(code)


def _timed(cases: Sequence[TimingCase], options: TimingOptions, hands: Hands) -> TimeRows:
    """Time the cases on this machine's cores or on a cluster, and show how far it is."""
    from feedplan.batch_times import time_programs
    from feedplan.progress import ProgressLine

    with ProgressLine() as line:
        if hands.scheduler is None:
            from feedplan.local_processes import LocalProcesses, core_count

            count = min(len(cases), core_count()) if hands.jobs is None else hands.jobs
            with LocalProcesses(max(count, 1)) as processes:
                return time_programs(cases, processes, options, line)
        from feedplan.dask_cluster import DaskCluster

        with DaskCluster(hands.scheduler) as cluster:
            for note in cluster.notes:
                notice(note)
            return time_programs(cases, cluster, options, line)


def _row_code(row: TimeRow) -> int:
    """The exit code that a row alone would have."""
    if row.error is not None:
        return exit_code(row.error)
    return 0 if row.ok else BROKEN
