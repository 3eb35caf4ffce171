"""The times of many part programs, on one machine or several: a row each, whatever becomes of it.

    files, notes = find_programs(["parts/"])
    rows = time_programs([TimingCase(file, machine) for file in files], LocalProcesses())

A case travels as bytes and numbers, for the process that times it may be on another computer.  The rows are those of one
process, however many there are.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from feedplan.batch import BatchTask, TaskOutcome, WorkerPool, run_batch
from feedplan.program_files import ProgramFile, called_files
from planner.errors import FeedrateError, InputError
from planner.types import Progress

if TYPE_CHECKING:
    from feedplan.program_time import ProgramTime
    from planner.machine.machine_table import Machine

# A worker of Dask may have several threads; solvers of other libraries keep state that a process has once.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class NamedMachine:
    """A machine, and what to call it."""

    label: str
    machine: Machine


@dataclass(frozen=True)
class TimingCase:
    """A part program on a machine.

    Attributes
    ----------
    file : ProgramFile
    machine : NamedMachine
        With its limits as the case has them.
    tolerance : float, optional
        mm, in place of the program's P words.
    scales : tuple of (str, float)
        By what the limits of the machine's file were multiplied, for the row.
    """

    file: ProgramFile
    machine: NamedMachine
    tolerance: float | None = None
    scales: tuple[tuple[str, float], ...] = ()

    @property
    def key(self) -> str:
        """Its identity."""
        scales = " ".join(f"{name}={factor!r}" for name, factor in self.scales)
        return f"{self.file.label} on {self.machine.label} within {self.tolerance!r} {scales}".rstrip()


@dataclass(frozen=True)
class CaseTime:
    """What timing a case gives: the numbers of :class:`~feedplan.program_time.ProgramTime` that a row shows.

    ``held_by`` is the limit that holds the program back for the largest ``share`` of its motion, empty where none does.
    """

    motion_s: float
    dwell_s: float
    tool_changes: int
    tool_change_s: float | None
    total_s: float
    held_by: str
    share: float
    worst: str
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, found: ProgramTime) -> CaseTime:
        """Take them from the time of a program."""
        held = max(((share, name) for name, share in found.shares.items() if name != "none"), default=(0.0, ""))
        rests = found.motion_s, found.dwell_s, found.tool_changes, found.tool_change_s, found.total_s
        return cls(*rests, held[1], held[0], found.worst, found.notes)


@dataclass(frozen=True, eq=False)
class TimeRow:
    """A case, and its time or the error that there is in place of it."""

    case: TimingCase
    time: CaseTime | None = None
    error: FeedrateError | None = None

    @property
    def ok(self) -> bool:
        """There is a plan, and it keeps every limit."""
        return self.time is not None and not self.time.worst

    @property
    def total_s(self) -> float:
        """Motion, dwells, and tool changes where their time is known, s; nan without a plan."""
        return math.nan if self.time is None else self.time.total_s

    @property
    def reason(self) -> str:
        """Why there is no plan, or which limit it breaks; empty where it keeps all."""
        return str(self.error) if self.time is None else self.time.worst


@dataclass(frozen=True, eq=False)
class TimeRows:
    """Rows in the order of their cases; ``interrupted``: the user ended it before all were timed."""

    rows: tuple[TimeRow, ...]
    interrupted: bool = False


@dataclass(frozen=True)
class TimingOptions:
    """What is the same for all cases.

    Attributes
    ----------
    feed, tool_change_s, ignore, reader, path, side
        As for :func:`feedplan.program_time.time_program`.
    tools : Path, optional
        Tool table, in place of those of the machines.
    """

    feed: float | None = None
    tool_change_s: float | None = None
    tools: Path | None = None
    ignore: tuple[str, ...] = ()
    reader: str = "feedplan"
    path: str | None = None
    side: str | None = None


_PLAIN = TimingOptions()


def time_programs(
    cases: Sequence[TimingCase],
    pool: WorkerPool,
    options: TimingOptions = _PLAIN,
    progress: Progress | None = None,
) -> TimeRows:
    """Time part programs, one in each process at a time.

    Parameters
    ----------
    cases : sequence of TimingCase
        All different.
    pool : WorkerPool
        :class:`~feedplan.local_processes.LocalProcesses` or :class:`~feedplan.dask_cluster.DaskCluster`.
    options : TimingOptions
    progress : callable, optional
        Is told how many are done, and which are in work.

    Raises
    ------
    InputError
        If two cases are the same.
    """
    tasks = [BatchTask(case.key, case.file.label, timed, _Arguments(case, options)) for case in cases]
    batch = run_batch(tasks, pool, progress)
    return TimeRows(
        tuple(_row(case, outcome) for case, outcome in zip(cases, batch.outcomes.values(), strict=True)),
        batch.interrupted,
    )


def _row(case: TimingCase, outcome: TaskOutcome[CaseTime]) -> TimeRow:
    return TimeRow(case, outcome.value, outcome.error)


@dataclass(frozen=True)
class Parcel:
    """What travels to the process that times a case: contents of files, with what to call them."""

    name: str
    label: str
    program: bytes
    called: dict[str, bytes]
    machine: Machine
    tools: tuple[str, bytes] | None
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Arguments:
    """Packs a case when it is its turn."""

    case: TimingCase
    options: TimingOptions

    def __call__(self) -> tuple[Parcel]:
        machine, tools = self.case.machine.machine, self.options.tools
        if tools is None:
            tools = machine.setup.tools
        options = {
            name: getattr(self.options, name) for name in ("feed", "tool_change_s", "ignore", "reader", "path", "side")
        }
        content = self.case.file.read()
        return (
            Parcel(
                self.case.file.path.name,
                self.case.file.label,
                content,
                called_files(self.case.file, content),
                replace(machine, setup=replace(machine.setup, tools=None)),
                None if tools is None else (str(tools), _content(tools)),
                options | {"tolerance": self.case.tolerance},
            ),
        )


def _content(tools: Path) -> bytes:
    try:
        return tools.read_bytes()
    except OSError as error:
        raise InputError(f"{tools}: cannot be read ({error.strerror or error})") from None


def timed(parcel: Parcel) -> CaseTime:
    """Time a case in the process that it was sent to; what is wrong is told by the names that its files have at home."""
    from feedplan.program_time import time_program

    with _ONE_AT_A_TIME, TemporaryDirectory(prefix="feedplan-") as folder:
        names = {}
        (program := Path(folder) / "program" / parcel.name).parent.mkdir()
        program.write_bytes(parcel.program)
        for name, content in parcel.called.items():
            (program.parent / name).write_bytes(content)
        names[str(program)] = parcel.label
        tools = None
        if parcel.tools is not None:
            tools = Path(folder) / Path(parcel.tools[0]).name
            tools.write_bytes(parcel.tools[1])
            names[str(tools)] = parcel.tools[0]
        try:
            return CaseTime.of(time_program(program, parcel.machine, tools=tools, without_jerk=False, **parcel.options))
        except FeedrateError as error:
            text = str(error)
            for path, name in names.items():
                text = text.replace(path, name)
            if text.startswith(f"{parcel.name}:"):
                text = parcel.label + text.removeprefix(parcel.name)
            raise type(error)(text) from None
