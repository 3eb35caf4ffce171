"""A tool path by the name of what it comes from: a named curve, a file of one, a drawing, points, or a part program."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError
from planner.geometry.catalog import read_curve, require_no_choice
from planner.geometry.curve import Curve
from planner.geometry.tolerance import DEFAULT_TOLERANCE, PathKind, PathSide, PathTolerance
from planner.inputs import positive_number
from planner.programs import SUFFIXES

if TYPE_CHECKING:
    from planner.machine.limits import Limits
    from planner.machine.program_setup import ProgramSetup
    from planner.programs.path.smooth_path import ProgramPath
    from planner.programs.reading.program import Program
    from planner.programs.reading.setup import Tool

EXAMPLE = "mill"
"""The machine whose limits weigh the path of a program where none are given."""
READERS = ("feedplan", "rs274")
"""Who reads a part program: this package, or the interpreter of an installed LinuxCNC."""


def load_curve(
    source: str | Path,
    *,
    scale: float = 1.0,
    tolerance: float | None = None,
    limits: Limits | None = None,
    tools: str | Path | Mapping[int, Tool] | None = None,
    ignore: Sequence[str] = (),
    reader: str = "feedplan",
    layer: str | None = None,
    chain: int | None = None,
    path: PathKind | None = None,
    side: PathSide | None = None,
) -> Curve:
    """Load a curve by its name or from a file.

    Parameters
    ----------
    source : str or Path
        One of :data:`~planner.geometry.catalog.CATALOG`; a ``.json`` or ``.toml`` file of a curve; a ``.dxf`` drawing; a
        ``.csv`` file of points; or a part program, ``.ngc``, ``.nc``, ``.tap``, ``.gcode``, ``.cnc``, ``.eia`` or ``.txt``.
    scale : float
        Multiplies the linear axes; a part program has its own size.
    tolerance : float, optional
        Largest distance of the curve from the points (1e-3 mm if left out), or from the part program (its P words, 0.01 mm
        where it has none); other curves are exact.
    limits : Limits, optional
        Of the machine that is to run the part program: they weigh in its corners where smoothness is worth most.  Left
        out, those of the example machine ``mill``; the path keeps its tolerance either way, and any limits can be planned
        with.
    tools : str, Path or mapping of int to Tool, optional
        The tools of the part program, as :func:`~planner.programs.reading.reader.read_program` takes them.
    ignore : sequence of str
        Words of the part program to pass over.
    reader : str
        Of a part program: "feedplan", or "rs274" for the interpreter of an installed LinuxCNC.
    layer : str, optional
        Of a drawing: only what is on it.
    chain : int, optional
        Of a drawing with several chains: its number, from 1 on, in the order of the file.
    path : {"joint", "separate"}, optional
        Of a part program: found together with its feed, which is the fastest under ``limits`` and belongs to them, or first.
        Left out, joint where limits are given.
    side : {"both", "left", "right", "inside", "outside"}, optional
        Where the path may leave a part program to; both if left out.  One side alone is for a joint path.

    Returns
    -------
    Curve
        Of a part program its ``feed_caps`` are the F words.  Lines, dwells and tools are those of
        :func:`~planner.programs.reading.reader.read_program` and
        :func:`~planner.programs.path.smooth_path.program_path`, which this calls.

    Raises
    ------
    CurveError
        If the name is unknown, the file cannot be read, or the curve in it is not valid.
    InputError
        If the part program is not one, or an argument is not as it must be or not for such a source.
    """
    suffix = Path(source).suffix.lower() if isinstance(source, str | os.PathLike) else ""
    if suffix in SUFFIXES:
        require_no_choice(source, layer, chain)
        from planner.machine.machine_file import load_limits

        require_unscaled(source, scale)
        tolerance = None if tolerance is None else positive_number(tolerance, "tolerance")
        machine = "" if limits is not None else EXAMPLE
        program = program_of(source, reader, tools=tools, ignore=ignore)
        kind = ("separate" if limits is None and side is None else "joint") if path is None else path
        made = path_of(
            program, load_limits(machine) if limits is None else limits, tolerance, path=kind, side=side or "both"
        )
        return replace(made.curve, made_within=PathTolerance(tolerance, 1.0, machine, kind, side or "both"))
    for name, given in (("path", path), ("side", side)):
        if given is not None:
            raise InputError(f"{name} = {given!r} is for part programs; {source} is none")
    require_no_program_options(source, tools, ignore)
    if reader != READERS[0]:
        raise InputError(f"reader = {reader!r} is for part programs; {source} is none")
    if tolerance is None:
        return read_curve(source, scale=scale, layer=layer, chain=chain)
    if suffix == ".csv":
        from planner.geometry.points import read_points

        require_no_choice(source, layer, chain)
        require_unscaled(source, scale)
        return read_points(source, tolerance)
    raise InputError(f"tolerance = {tolerance!r} mm is for part programs and points; {source} is exact")


def program_of(
    source: str | Path,
    reader: str = "feedplan",
    *,
    tools: str | Path | Mapping[int, Tool] | None = None,
    ignore: Sequence[str] = (),
    setup: ProgramSetup | None = None,
) -> Program:
    """Read a part program, by this package or by LinuxCNC.

    Raises InputError as :func:`planner.read_program` and
    :func:`~planner.programs.linuxcnc.canonical_program.read_with_linuxcnc` do.
    """
    if reader not in READERS:
        raise InputError(f"reader = {reader!r} must be one of {', '.join(READERS)}")
    if reader == READERS[0]:
        from planner.programs.reading.reader import read_program

        return read_program(source, tools=tools, ignore=ignore, setup=setup)
    from planner.programs.linuxcnc.canonical_program import read_with_linuxcnc

    if ignore:
        raise InputError(
            f"ignore = {list(ignore)!r}: LinuxCNC passes over no words; leave them out with its reader rs274"
        )
    if setup is not None and (setup.home or setup.second_home or setup.tool_change or setup.offsets):
        raise InputError(
            "the machine file says where homes, offsets or tool changes are, which LinuxCNC takes from its own files; leave "
            "them out with its reader rs274"
        )
    return read_with_linuxcnc(source, tools=setup.tools if tools is None and setup is not None else tools)


def path_of(
    program: Program,
    limits: Limits,
    tolerance: float | None,
    share: float = 1.0,
    *,
    path: PathKind = "joint",
    side: PathSide = "both",
) -> ProgramPath:
    """Make the path of a part program, which takes a share of the tolerance and the name of the file.

    ``tolerance`` in mm stands in place of the program's P words.
    """
    from planner.programs.path.smooth_path import program_path

    if tolerance is None:
        own = replace(program, tolerance=share * given_tolerances(program))
        made = program_path(own, None, limits, path=path, side=side)
    else:
        made = program_path(program, share * tolerance, limits, path=path, side=side)
    within = PathTolerance(tolerance, share, path=path, side=side)
    named: dict[str, Any] = {"name": Path(program.source).name, "made_within": within}
    return replace(made, curve=replace(made.curve, **named))


def given_tolerances(program: Program) -> np.ndarray[Any, np.dtype[np.float64]]:
    """P word in force at every move, mm, the default where there is none."""
    return np.where(np.isnan(program.tolerance), DEFAULT_TOLERANCE, program.tolerance)


def require_no_program_options(source: object, tools: object, ignore: Sequence[str]) -> None:
    """Refuse what only a part program can be read with."""
    for name, given in (("tools", tools), ("ignore", ignore or None)):
        if given is not None:
            raise InputError(f"{name} = {given!r} is for part programs, {', '.join(SUFFIXES)}; {source} is none")


def require_unscaled(source: str | Path, scale: float) -> None:
    """Refuse another scale than 1 for what has its own size."""
    if scale != 1.0:
        raise InputError(f"scale = {scale!r} is not for {source}; it must be 1")
