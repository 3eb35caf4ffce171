"""What if: part programs on several machines, within several tolerances, with limits multiplied.

    cases = sweep_cases(files, machines, [0.01, 0.05], [read_scale("jerk=1,2,4")])
    rows = time_programs(cases, LocalProcesses())

Every combination is a case.  The first of each program is its base: the first machine, the first tolerance, every limit as
the machine's file has it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from feedplan.batch_text import note_lines, reason_lines, row_facts, verdict_word
from feedplan.batch_times import NamedMachine, TimeRow, TimeRows, TimingCase
from feedplan.layout import BOLD, RED, Cell, named, table
from feedplan.program_files import ProgramFile, distinct_labels
from planner.errors import InputError
from planner.inputs import positive_number
from planner.machine.limits import SCALABLE

_MICRO = 1e3  # um in a mm


@dataclass(frozen=True)
class LimitFactors:
    """A limit, of one axis where it is named, and what it is multiplied by, one after the other."""

    key: str
    axis: str
    factors: tuple[float, ...]

    @property
    def name(self) -> str:
        """As it is given: ``jerk`` or ``acceleration.X``."""
        return f"{self.key}.{self.axis}" if self.axis else self.key


def read_scale(text: str) -> LimitFactors:
    """Read ``jerk=1,2,4`` or ``acceleration.X=1,1.5``.

    Raises InputError, with what is allowed, where it is something else.
    """
    name, sign, values = text.partition("=")
    key, dot, axis = name.strip().partition(".")
    if not sign or key not in SCALABLE or (dot and not axis):
        raise InputError(
            f'--scale "{text}": must be a limit and its factors, as jerk=1,2,4 or acceleration.X=1,1.5; the limits are '
            f"{', '.join(SCALABLE)}"
        )
    return LimitFactors(key, axis.upper(), read_numbers(values, f"--scale {name.strip()}"))


def read_numbers(text: str, name: str) -> tuple[float, ...]:
    """Read finite numbers > 0 with commas between them, each once; ``name`` is what they are called in an error."""
    found: list[float] = []
    for word in text.split(","):
        try:
            value = positive_number(float(word), name)
        except ValueError:
            raise InputError(
                f'{name}: "{word.strip()}" must be a number > 0; several have commas between them'
            ) from None
        if not math.isfinite(value) or value in found:
            raise InputError(f"{name}: {value:g} {'is given twice' if value in found else 'must be finite'}")
        found.append(value)
    return tuple(found)


def name_machines(names: Sequence[str], found: Sequence[Any]) -> list[NamedMachine]:
    """Give machines their names: those of their files, or the ends of their paths that tell these apart.

    Raises InputError where one is given twice.
    """
    paths = [str(Path(name).absolute()) for name in names]
    twice = next((name for name, path in zip(names, paths, strict=True) if paths.count(path) > 1), None)
    if twice is not None:
        raise InputError(f"--machine {twice}: is given twice")
    return [NamedMachine(label, machine) for label, machine in zip(distinct_labels(paths), found, strict=True)]


def sweep_cases(
    files: Sequence[ProgramFile],
    machines: Sequence[NamedMachine],
    tolerances: Sequence[float] = (),
    scales: Sequence[LimitFactors] = (),
) -> list[TimingCase]:
    """Combine programs, machines, tolerances and factors, in this order; the base of each program comes first.

    Parameters
    ----------
    files, machines
    tolerances : sequence of float
        mm; left out, each program's own.
    scales : sequence of LimitFactors

    Raises
    ------
    InputError
        If a limit is there twice, a machine has no such axis, or a limit that is multiplied is one that no machine has.
    """
    names = [scale.name for scale in scales]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"--scale {twice}: is given twice; name all its factors at once")
    _require_effect(machines, scales)
    plain = (1.0,) * len(scales)
    combined = list(product(machines, tuple(tolerances) or (None,), product(*(scale.factors for scale in scales))))
    base = (machines[0], (tuple(tolerances) or (None,))[0], plain)
    combined = [base, *(combination for combination in combined if combination != base)]
    return [
        TimingCase(
            file,
            NamedMachine(machine.label, _scaled(machine, scales, factors)),
            tolerance,
            tuple(zip(names, factors, strict=True)),
        )
        for file in files
        for machine, tolerance, factors in combined
    ]


def _scaled(machine: NamedMachine, scales: Sequence[LimitFactors], factors: Sequence[float]) -> Any:
    limits = machine.machine.limits
    for scale, factor in zip(scales, factors, strict=True):
        try:
            limits = limits.scaled(scale.key, factor, scale.axis)
        except InputError as error:
            raise InputError(f"--scale {scale.name}: {machine.label}: {error}") from None
    return replace(machine.machine, limits=limits)


def _require_effect(machines: Sequence[NamedMachine], scales: Sequence[LimitFactors]) -> None:
    """Refuse to multiply what no machine limits: the rows would say that it changes nothing."""
    for scale in scales:
        if all(_scaled(machine, [scale], [2.0]).limits == machine.machine.limits for machine in machines):
            labels = ", ".join(machine.label for machine in machines)
            raise InputError(
                f"--scale {scale.name}: there is no such limit on {labels}, so its factor would change nothing"
            )


# ---- what is shown -------------------------------------------------------------------------------------------------


def _bases(found: TimeRows) -> list[TimeRow]:
    """The base of each row: the first of its program."""
    first: dict[str, TimeRow] = {}
    return [first.setdefault(row.case.file.label, row) for row in found.rows]


def sweep_facts(found: TimeRows) -> list[dict[str, Any]]:
    """Rows as plain values, with what each saves against the base of its program; None where either has no plan."""
    facts = []
    for row, base in zip(found.rows, _bases(found), strict=True):
        saved = base.total_s - row.total_s
        known = math.isfinite(saved) and base.total_s > 0.0
        facts.append(
            row_facts(row)
            | {"saved_s": saved if known else None, "saved_share": saved / base.total_s if known else None}
        )
    return facts


def sweep_text(found: TimeRows, notes: Sequence[str], file: str = "") -> list[str]:
    """Lay out a row each with what it saves against its base; ``file`` is what was written."""
    rows, bases = found.rows, _bases(found)
    columns: dict[str, list[str | Cell]] = {"program": [row.case.file.label for row in rows]}
    columns["machine"] = [row.case.machine.label for row in rows]
    columns["tolerance\num"] = [_tolerance(row.case) for row in rows]
    columns["change"] = [_change(row.case) for row in rows]
    kept = {name: cells for name, cells in columns.items() if len(set(cells)) > 1}
    pairs = list(zip(rows, bases, strict=True))
    kept |= {
        "total\ns": ["" if row.time is None else Cell(f"{row.total_s:.3f}", BOLD) for row in rows],
        "saves\ns": [_saved(row, base, f"{base.total_s - row.total_s:.3f}") for row, base in pairs],
        "saves\n%": [_saved(row, base, f"{100.0 * (1.0 - row.total_s / base.total_s):.1f}") for row, base in pairs],
        "held back by": ["" if row.time is None else row.time.held_by or "no limit" for row in rows],
        "share": ["" if row.time is None else f"{100.0 * row.time.share:.0f}%" for row in rows],
        "verdict": [Cell("ok") if row.ok else Cell(verdict_word(row), RED) for row in rows],
    }
    left = ("program", "machine", "change", "held back by", "verdict")
    lines = [*table(list(kept), list(zip(*kept.values(), strict=True)), left=left), ""]
    lines += named("base", _base_text(rows[0].case))
    names = [case_name(row.case) for row in rows]
    lines += [*reason_lines(rows, names), *note_lines(rows, names, notes)]
    return lines + (named("written", file) if file else [])


def case_name(case: TimingCase) -> str:
    """A case in words: the program, the machine, the tolerance, what is changed."""
    within = "" if case.tolerance is None else f" within {_MICRO * case.tolerance:g} um"
    change = _change(case)
    return f"{case.file.label} on {case.machine.label}{within}" + (f", {change}" if change != "none" else "")


def _base_text(case: TimingCase) -> str:
    within = "its own tolerance" if case.tolerance is None else f"{_MICRO * case.tolerance:g} um"
    return f"of each program: {case.machine.label}, {within}, every limit as the machine has it"


def _tolerance(case: TimingCase) -> str:
    return "own" if case.tolerance is None else f"{_MICRO * case.tolerance:g}"


def _change(case: TimingCase) -> str:
    return ", ".join(f"{name} x {factor:g}" for name, factor in case.scales if factor != 1.0) or "none"


def _saved(row: TimeRow, base: TimeRow, text: str) -> str:
    if row is base:
        return "base"
    return text if math.isfinite(base.total_s - row.total_s) and base.total_s > 0.0 else ""
