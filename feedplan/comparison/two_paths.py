"""A part program both ways: its path found together with the feed, and made before it, each planned and judged alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from feedplan.comparison.methods import OPTIMUM
from feedplan.comparison.result import Result
from planner.errors import CurveError, InfeasibleError, InputError, SolverError
from planner.geometry.tolerance import PathKind

if TYPE_CHECKING:
    from feedplan.job import Job
    from planner.programs.path.smooth_path import ProgramPath

PATHS: tuple[PathKind, PathKind] = ("joint", "separate")
"""Methods of the rows that are about the other path of a program."""


def path_kind(path: ProgramPath) -> PathKind:
    """How the path of a program was made, in one run at least."""
    return "joint" if path.counts["joint"] else "separate"


def with_other_path(
    results: Sequence[Result], job: Job, load: Callable[[PathKind], Job], run: Callable[[Job], Result]
) -> tuple[Result, ...]:
    """Add the optimal plan of the path made the other way, behind that of the path the methods ran on.

    Parameters
    ----------
    results : sequence of Result
        Of methods on the path of a part program.
    job : Job
        That program.
    load : callable
        Makes the same program's job with the path of a kind.
    run : callable
        Plans and judges a job.

    Returns
    -------
    tuple of Result
        Every row that ran with the deviation of its path.  The row of the other path is named after its kind; where there is
        none it says why.  Without the optimal plan among the results there is no such row.
    """
    if job.path is None:
        return tuple(results)
    found: list[Result] = []
    for result in results:
        found.append(replace(result, deviation=job.path.deviation.largest) if result.judgement else result)
        if result.method == OPTIMUM:
            found.append(_other(job.path, load, run))
    return tuple(found)


def _other(path: ProgramPath, load: Callable[[PathKind], Job], run: Callable[[Job], Result]) -> Result:
    kind = PATHS[1 - PATHS.index(path_kind(path))]
    try:
        other = load(kind)
    except (CurveError, InfeasibleError, InputError, SolverError) as error:
        return Result(kind, reason=f"{type(error).__name__}: {error}")
    if other.path is None or path_kind(other.path) != kind:
        why = "" if other.path is None else "; ".join(note for note in other.path.notes if "separately" in note)
        return Result(kind, reason=why or "no path of this kind was made")
    result = run(other)
    return replace(
        result, method=kind, deviation=other.path.deviation.largest if result.judgement else result.deviation
    )


def joint_saving(results: Sequence[Result]) -> float | None:
    """Share of the time that path and feed found together save against the path made first; None where not both are there.

    The optimal plan on the path that the methods ran on stands for its kind.
    """
    rows = {result.method: result for result in results if result.ok}
    optimal = rows.get(OPTIMUM)
    if optimal is None:
        return None
    if "joint" in rows:
        return 1.0 - rows["joint"].duration / optimal.duration
    return 1.0 - optimal.duration / rows["separate"].duration if "separate" in rows else None
