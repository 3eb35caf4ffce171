"""The curve that a job is about, with what is known of where it comes from: a name, a file, points, or a part program."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from planner.errors import InputError
from planner.geometry.tolerance import DEFAULT_TOLERANCE, POINTS_TOLERANCE_MM
from planner.inputs import require_path
from planner.programs import SUFFIXES

if TYPE_CHECKING:
    from planner.geometry.curve import Curve
    from planner.geometry.tolerance import PathKind, PathSide, PathTolerance
    from planner.machine.limits import Limits
    from planner.machine.program_setup import ProgramSetup
    from planner.programs.path.smooth_path import ProgramPath
    from planner.programs.reading.program import Program

# Of the tolerance, where a program is written too: the path takes this, and the lines of the program the rest.
PATH_SHARE = 0.75
_LONG = 20_000  # moves
Pairs: TypeAlias = tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class SourceCurve:
    """A curve, and what it was made from.

    Attributes
    ----------
    curve : Curve
    room : float
        Distance that the lines of a program written from a plan may leave the curve by, mm.
    facts : tuple of (str, str)
        What a verdict says of where the curve comes from.
    program, path : Program, ProgramPath, optional
        The part program, and what was made of it.
    seconds : float
        What it took to make the path.
    """

    curve: Curve
    room: float
    facts: Pairs = ()
    program: Program | None = None
    path: ProgramPath | None = None
    seconds: float = 0.0


def is_program(source: str | Path) -> bool:
    """Whether the name of a curve is that of a part program."""
    return require_path(source, name="source").suffix.lower() in SUFFIXES


def is_points(source: str | Path) -> bool:
    """Whether the name of a curve is that of a file of points."""
    return Path(source).suffix.lower() == ".csv"


def require_no_path_choice(source: object, path: PathKind | None, side: PathSide | None = None) -> None:
    """Refuse to choose how a path is made where there is none to make."""
    for name, given in (("path", path), ("side", side)):
        if given is not None:
            raise InputError(f"{name} = {given!r} is for part programs, {', '.join(SUFFIXES)}; {source} is none")


def path_for(source: str | Path | Curve, path: PathKind | None, options: Mapping[str, Any]) -> PathKind | None:
    """How the path of a part program is made for a plan with these options.

    What is found with its feed begins at rest; and S-curves run a way that swings before a corner slower than one that does
    not.
    """
    other = options.get("method") == "scurve" or any(
        options.get(name) for name in ("start_feed", "end_feed", "periodic")
    )
    return "separate" if path is None and other and isinstance(source, str | Path) and is_program(source) else path


def require_program(source: str | Path, what: str) -> None:
    """Refuse a curve without lines, and what is nothing at all."""
    if not is_program(source):
        from planner.geometry.catalog import CATALOG

        if str(source) not in (*CATALOG, "-") and not os.path.exists(source):
            raise InputError(f"{source}: there is no such file, and no folder either")
        raise InputError(f"{source} has no lines; {what} needs a part program, {', '.join(SUFFIXES)}")


@dataclass(frozen=True)
class DrawingChoice:
    """Which path of a drawing is meant: all on a layer, the chain of a number; None is not said."""

    layer: str | None = None
    chain: int | None = None


def plain_curve(
    source: str | Path | Curve,
    scale: float,
    tolerance: float | None,
    share: float,
    choice: DrawingChoice = DrawingChoice(),
) -> SourceCurve:
    """Load a curve that is no part program; the points of a CSV file are fitted within their share of the tolerance."""
    from planner import load_curve
    from planner.geometry.catalog import require_no_choice
    from planner.geometry.curve import Curve
    from planner.geometry.points import FittedCurve, read_points
    from planner.programs.source import require_unscaled

    layer, chain = choice.layer, choice.chain

    if isinstance(source, Curve) or not is_points(source):
        name = source.name if isinstance(source, Curve) else source
        if tolerance is not None and share == 1.0:
            raise InputError(f"tolerance = {tolerance!r} mm is for part programs and points; {name} is exact")
        if isinstance(source, Curve):
            require_unscaled(name, scale)
            require_no_choice(name, layer, chain)
        curve = source if isinstance(source, Curve) else load_curve(source, scale=scale, layer=layer, chain=chain)
        return SourceCurve(curve, tolerance or DEFAULT_TOLERANCE, _said_of_drawing(curve))
    require_no_choice(source, layer, chain)
    if tolerance is None:
        curve, allowed, room = load_curve(source, scale=scale), POINTS_TOLERANCE_MM, DEFAULT_TOLERANCE
    else:
        require_unscaled(source, scale)
        allowed, room = share * tolerance, (1.0 - share) * tolerance
        curve = read_points(source, tolerance, share=share)
    facts: Pairs = ()
    if isinstance(curve, FittedCurve):
        far = f"{1e3 * curve.deviation:.4g} um at most from a point, in line {curve.row}"
        facts = (("deviation", f"{far}; {1e3 * allowed:g} um allowed"), *_said_of_share(share))
    return SourceCurve(curve, room, facts)


def _said_of_drawing(curve: Curve) -> Pairs:
    """What was read of a drawing, and what was not."""
    notes = getattr(curve, "notes", ())
    return (("drawing", "; ".join(notes)),) if notes else ()


def program_curve(
    source: str | Path,
    scale: float,
    limits: Limits,
    tolerance: float | None,
    share: float,
    notice: Callable[[str], None] | None = None,
    *,
    tools: str | Path | None = None,
    ignore: Sequence[str] = (),
    reader: str = "feedplan",
    setup: ProgramSetup | None = None,
    path: PathKind = "joint",
    side: PathSide = "both",
    widen: bool = False,
) -> SourceCurve:
    """Make the path of a part program, which takes its share of the tolerance.

    ``notice`` is told of a long one; ``tools``, ``ignore``, ``reader`` and ``setup`` say how it is read.  ``path``: found
    with its feed, or before; ``side``: where it may leave the program to.
    ``widen``: the limits are those of the axes that move, as a table has them.
    """
    import numpy as np

    from feedplan.verdict_text import program_summary
    from planner.programs.source import given_tolerances, path_of, program_of, require_unscaled

    require_unscaled(source, scale)
    program = program_of(source, reader, tools=tools, ignore=ignore, setup=setup)
    if len(program) > _LONG and notice is not None:
        notice(
            f"{source}: {len(program)} moves are planned as a whole here, which takes memory; "
            "feedplan windows plans any number"
        )
    limits = widened(limits, program.axes) if widen else limits
    began = time.perf_counter()
    made = path_of(program, limits, tolerance, share, path=path, side=side)
    seconds = time.perf_counter() - began
    given = given_tolerances(program) if tolerance is None else np.array([tolerance])
    least = float(given[given > 0.0].min(initial=np.inf))
    room = (1.0 - share) * (least if np.isfinite(least) else DEFAULT_TOLERANCE)
    facts = (("program", program_summary(program, made)), *_said_of_share(share))
    return SourceCurve(made.curve, room, facts, program, made, seconds)


def _said_of_share(share: float) -> Pairs:
    """Say that a path which leaves room for the program written from it takes longer than one which does not."""
    text = f"{share:.0%} for the path, {1.0 - share:.0%} for the program; a plan alone is faster"
    return () if share == 1.0 else (("tolerance", text),)


def tolerance_of_table(table: str | Path, source: str | Path | Curve) -> PathTolerance:
    """Read the tolerance that a table says its curve was made within; where it says none, that of an exact curve."""
    from planner.geometry.curve import Curve
    from planner.geometry.tolerance import PathTolerance
    from planner.output.table import table_origin

    said = table_origin(table).tolerance or PathTolerance(None)
    # A table of an exact curve says no tolerance: one that does is of another curve, as reading it will tell.
    inexact = not isinstance(source, Curve) and (is_program(source) or is_points(source))
    return said if inexact else replace(said, mm=None)


def widened(limits: Limits, axes: tuple[str, ...]) -> Limits:
    """The limits in a table are those of the axes that move; an axis that only has words needs none that counts."""
    from planner.quantity import AXIS

    resting = tuple(axis for axis in axes if axis not in limits.axes)
    if not resting:
        return limits
    rows = {q.key: [*limits.of(q), *[math.inf] * len(resting)] for q in AXIS}
    return limits.with_axes((*limits.axes, *resting), **rows)
