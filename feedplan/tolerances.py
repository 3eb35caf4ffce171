"""What the tolerance of a part program buys: the time of its plan at each of several tolerances.

for row in time_of_tolerances("part.ngc", "mill"):
    print(row.tolerance, row.seconds, row.deviation)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.errors import CurveError, InfeasibleError, InputError, SolverError

if TYPE_CHECKING:
    from planner.machine.limits import Limits
    from planner.profile import FeedrateProfile
    from planner.programs.path.smooth_path import ProgramPath
    from planner.types import Progress
    from planner.verify import Report

USUAL_UM = (1, 2, 5, 10, 20, 50)
"""Tolerances that are asked for where none are named, um."""
_MICRO = 1e3  # um in a mm


@dataclass(frozen=True)
class ToleranceTime:
    """A part program planned within a tolerance.

    Attributes
    ----------
    tolerance : float
        Largest distance of the path from the program that is allowed, mm.
    seconds : float
        Duration of the plan, without dwells; nan where there is none.
    deviation : float
        Largest distance of the path from the program, measured in both directions, mm; nan where there is no plan.
    line : int
        Of the program, where that is; 0 where there is no plan.
    path : str
        "joint" where the path was found with its feed, in some runs at least, "separate" where before it; empty where there
        is no plan.
    ok : bool
        There is a plan, and it keeps every limit.
    reason : str
        Why there is no plan, or which limit it breaks; empty where it keeps all.
    """

    tolerance: float
    seconds: float = math.nan
    deviation: float = math.nan
    line: int = 0
    path: str = ""
    ok: bool = False
    reason: str = ""

    @property
    def breaks(self) -> bool:
        """There is a plan, and it breaks a limit."""
        return not self.ok and not math.isnan(self.seconds)

    @classmethod
    def of(
        cls, path: ProgramPath | None, profile: FeedrateProfile, report: Report, tolerance: float | None = None
    ) -> ToleranceTime:
        """What a plan of a part program's path, and the check of it, say; left out, the largest tolerance in force."""
        if path is None:
            raise InputError(f"{profile.curve.name} has no tolerance to choose; that needs a part program")
        reason = ""
        if tolerance is None:
            within = path.curve.made_within
            tolerance = path.tolerance if within is None else path.tolerance / within.share
        if not report.ok:
            worst = max(report.violations, key=lambda row: row.ratio)
            reason = f"breaks {worst.limit} {worst.axis}".rstrip() + f": {worst.ratio:.6g} times what is allowed"
        far, line = path.deviation.largest, int(path.deviation_line)
        made = "joint" if path.counts["joint"] else "separate"
        return cls(tolerance, profile.duration, far, line, made, report.ok, reason)


def time_of_tolerances(
    source: str | Path,
    machine: str | Path | Limits | None = None,
    tolerances: Sequence[float] | None = None,
    *,
    table: Path | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> tuple[ToleranceTime, ...]:
    """Plan a part program within each of several tolerances, and check every plan.

    Parameters
    ----------
    source : str or Path
        A part program.
    machine : str, Path or Limits, optional
        As for :func:`load_job`.
    tolerances : sequence of float, optional
        mm, each in place of the program's P words; left out, 1, 2, 5, 10, 20 and 50 um.
    table : Path, optional
        A feedrate table of the program: everything but the tolerance is as it was planned with, as
        :func:`load_job_of_table` reads it.
    progress : callable, optional
        Is told which tolerance is planned, and which share of them is done.
    options
        As for :func:`load_job`, or with a table for :func:`load_job_of_table`.

    Returns
    -------
    tuple of ToleranceTime
        A row for each tolerance, in their order; one that cannot be planned says why.

    Raises
    ------
    InputError
        If a tolerance is not a number > 0 or is there twice, or something else given is not as it must be.
    """
    from feedplan.job import load_job, load_job_of_table
    from feedplan.sources import require_program

    require_program(source, "what a tolerance buys")
    usual = tuple(um / _MICRO for um in USUAL_UM)
    chosen = usual if tolerances is None else _distinct(tolerances, "tolerances")
    load = partial(load_job, source) if table is None else partial(load_job_of_table, table, source)
    found = []
    for k, tolerance in enumerate(chosen):
        if progress is not None:
            progress(f"planning within {_MICRO * tolerance:g} um", k / len(chosen))
        try:
            job = load(machine, tolerance=tolerance, **options)
            profile = job.plan()
        except (CurveError, InfeasibleError, SolverError) as error:
            found.append(ToleranceTime(tolerance, reason=str(error)))
            continue
        found.append(ToleranceTime.of(job.path, profile, job.check(profile), tolerance))
    return tuple(found)


def read_tolerances(text: str, name: str) -> tuple[float, ...]:
    """Read numbers in um, with commas between them, as tolerances in mm; ``name`` is what they are called in an error."""
    values = []
    for word in (part.strip() for part in text.split(",")):
        try:
            values.append(float(word))
        except ValueError:
            raise InputError(
                f'{name}: "{word}" is no number; it takes numbers in um with commas between them, as 1,5,10, and stands '
                "behind the program"
            ) from None
    return tuple(value / _MICRO for value in _distinct(values, name))


def _distinct(values: Sequence[float], name: str) -> tuple[float, ...]:
    """Refuse values unless each is a finite number > 0 that is there once."""
    from planner.inputs import positive_number

    found: list[float] = []
    for value in values:
        number = positive_number(value, name)
        if not math.isfinite(number):
            raise InputError(f"{name} = {number!r} must be finite")
        if number in found:
            raise InputError(f"{name} = {number!r} is given twice")
        found.append(number)
    if not found:
        raise InputError(f"{name} is empty; it must name at least one")
    return tuple(found)


def tolerance_facts(now: ToleranceTime, rows: Sequence[ToleranceTime]) -> list[dict[str, Any]]:
    """The rows as plain values, each with what it saves against the plan within the tolerance of now."""
    return [
        {
            "tolerance_mm": row.tolerance,
            "seconds": _finite(row.seconds),
            "saved_s": _finite(now.seconds - row.seconds),
            "saved_share": _finite(_saved_share(now, row)),
            "deviation_mm": _finite(row.deviation),
            "deviation_line": row.line or None,
            "path": row.path,
            "ok": row.ok,
            "reason": row.reason,
        }
        for row in rows
    ]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _saved_share(now: ToleranceTime, row: ToleranceTime) -> float:
    return 1.0 - row.seconds / now.seconds if now.seconds > 0.0 else math.nan


def tolerance_lines(now: ToleranceTime, rows: Sequence[ToleranceTime]) -> list[str]:
    """Lay the rows out below the plan within the tolerance of now; what cannot be planned, or breaks a limit, says so."""
    from feedplan.layout import RED, named, styled, table

    heads = ["tolerance\num", "", "seconds", "saves\ns", "saves\n%", "off by\num", "at line", "path"]
    cells = [_cells(now, now, "now"), *(_cells(now, row) for row in rows)]
    lines = table(heads, cells, left=("", "path"))
    for row in rows:
        if row.breaks:
            lines += named(f"{_MICRO * row.tolerance:g} um", styled(f"LIMIT BROKEN  {row.reason}", RED))
        elif not row.ok:
            lines += named(f"{_MICRO * row.tolerance:g} um", f"no plan: {row.reason}")
    return lines


def _cells(now: ToleranceTime, row: ToleranceTime, mark: str = "") -> list[str]:
    name = f"{_MICRO * row.tolerance:g}"
    if math.isnan(row.seconds):
        return [name, "", "no plan", "", "", "", "", ""]
    saved = ["", ""] if mark else [f"{now.seconds - row.seconds:.4f}", f"{100.0 * _saved_share(now, row):.1f}"]
    place = [f"{_MICRO * row.deviation:.4g}", str(row.line)] if row.deviation > 0.0 else ["none", ""]
    return [name, mark, f"{row.seconds:.4f}", *saved, *place, row.path]
