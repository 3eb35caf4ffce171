"""The plan of a part program as a program again, with what the first one does besides moving.

Spindle, coolant, tools, dwells and stops keep their places along the path, words and order.  The rapids to the start come
in the order of the axes' first words, those of axes that never move again among them.  Rapids become blocks with a feed,
so that the jerk limit holds for them too; nothing is left of the moves of no length.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from planner.geometry.curve import AXES
from planner.inputs import require_instance
from planner.output.ngc import FeedMode, WrittenProgram, write_ngc
from planner.profile import FeedrateProfile
from planner.programs.path.smooth_path import ProgramPath
from planner.programs.reading.program import Program
from planner.verify import Report

# M2 or M30: the program that is written has its own; the rest is no part of it.
_NOT_WRITTEN = ("end", "signal", "offset", "message")


def write_program(
    file: str | Path,
    program: Program,
    path: ProgramPath,
    profile: FeedrateProfile,
    *,
    tolerance: float,
    mode: FeedMode = "feed",
    block_time: float = 0.01,
    report: Report | None = None,
    acceleration: ArrayLike | None = None,
) -> WrittenProgram:
    """Write the plan of a part program as a LinuxCNC program, if the plan breaks no limit.

    Parameters
    ----------
    file : str or Path
    program : Program
    path : ProgramPath
        The path of that program.
    profile : FeedrateProfile
        A plan for the curve of that path.
    tolerance : float
        Largest distance between the path and what the controller may make of the blocks, mm; it adds to that between
        the path and the program.
    mode, block_time, report, acceleration
        As for :func:`planner.output.ngc.write_ngc`.

    Returns
    -------
    WrittenProgram

    Raises
    ------
    InputError
        If an option is not allowed or the file cannot be written.
    BrokenLimitError
        If the plan breaks a limit.  Then no file is written.
    """
    require_instance(program, Program, "program")
    require_instance(path, ProgramPath, "path")
    require_instance(profile, FeedrateProfile, "profile")
    lines = sorted([*_rests(program, path), *_events(program, path)], key=lambda item: item[:2])
    inserted = [(u, text) for u, _, text in lines]
    return write_ngc(
        file,
        path.curve,
        profile,
        tolerance=tolerance,
        mode=mode,
        block_time=block_time,
        inserted=inserted,
        report=report,
        acceleration=acceleration,
    )


def _rests(program: Program, path: ProgramPath) -> list[tuple[float, int, str]]:
    """Rapids to the start, axis after axis where the program has them so, with their lines."""
    order = sorted((int(line), k) for k, line in enumerate(program.axis_lines) if line > 0)
    groups = [(line, [k for _, k in group]) for line, group in groupby(order, key=lambda item: item[0])]
    first = [event.line for event in program.events if event.after_move < 0]
    line, axes = groups[-1]
    if all(AXES[k] in path.curve.axes for k in axes) and all(line > other for other in first):
        groups.pop()  # the rapid that every program begins with
    return [
        (path.curve.domain[0], line, " ".join(["G0", *(f"{AXES[k]}{_plain(program.start[0, k])}" for k in axes)]))
        for line, axes in groups
    ]


def _events(program: Program, path: ProgramPath) -> list[tuple[float, int, str]]:
    """What happens between the moves: the curve parameter at which it happens, its line and its words."""
    moving = np.flatnonzero(program.lengths > 0.0)
    return [
        (float(path.u[np.searchsorted(moving, event.after_move, side="right")]), event.line, event.text)
        for event in program.events
        if event.kind not in _NOT_WRITTEN
    ]


def _plain(value: float) -> str:
    """A coordinate in plain digits."""
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
