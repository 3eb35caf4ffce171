"""Limits from times of programs, by the models of controllers: that of a name, or the one that fits best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planner.calibration.cycle_times import Seconds, TimesFit, fit_times
from planner.calibration.times_list import TimedProgram
from planner.controllers.known import CONTROLLERS, Controller, known_controller
from planner.errors import InputError
from planner.geometry.curve import AXES
from planner.machine.limits import Limits
from planner.types import FloatArray, Progress

_SLOW, _FAST = 50.0, 0.2  # of the time that its feeds ask for: no program takes so much longer, or shorter


@dataclass(frozen=True, eq=False)
class TimesCalibration:
    """Limits from times of programs.

    Attributes
    ----------
    controller : str
        Whose model.
    fit : TimesFit
    programs : sequence of TimedProgram
        Those that were used, in the order of the fit.
    others : mapping of str to float
        Median error of other controllers' models with limits of their own.
    notes : tuple of str
    """

    controller: str
    fit: TimesFit
    programs: Sequence[TimedProgram]
    others: Mapping[str, float]
    notes: tuple[str, ...]


def calibrate_times(
    timed: Sequence[TimedProgram], start: Limits, controller: str | None, progress: Progress
) -> TimesCalibration:
    """Find the limits of a machine from the times of programs.

    Parameters
    ----------
    timed : sequence of TimedProgram
    start : Limits
    controller : str, optional
        Left out, every model is tried.
    progress : callable
        Told what is being done.

    Raises
    ------
    InputError
        If there is no such controller, too few programs are left, or times are in another unit.
    """
    names = list(CONTROLLERS) if controller is None else [known_controller(controller).name]
    used, notes = [], []
    for row in timed:
        changes = sum(event.kind == "tool_change" for event in row.program.events)
        if changes or row.program.line.size == 0:
            why = f"has {changes} tool changes, whose time it does not say" if changes else "moves nothing"
            notes.append(f"{row.where}: {row.name} {why}: left out")
            continue
        row.program.require_axes(start)
        _require_unit(row)
        used.append(row)
    if len(used) < 2:
        raise InputError(f"{timed[0].where}: {len(used)} programs to go by; at least two are needed")
    moved = np.any([np.any(row.program.start != row.program.end, axis=0) for row in used], axis=0)
    axes = [axis for axis, moves in zip(AXES, moved, strict=True) if moves and axis in start.axes]
    measured = np.array([row.seconds for row in used])
    fits: dict[str, TimesFit] = {}
    for name in names:
        progress(f"times by the model of {name}", None)
        fits[name] = fit_times(seconds_of(used, known_controller(name)), measured, start, axes)
    best = min(fits, key=lambda name: fits[name].misfit)
    out = [row for row, kept in zip(used, fits[best].used, strict=True) if not kept]
    notes += [
        f"{row.where}: {row.name} fits no limits that the others fit: left out; is it that program's time?"
        for row in out
    ]
    others = {name: fit.misfit for name, fit in fits.items() if name != best}
    return TimesCalibration(best, fits[best], used, others, tuple(notes))


def _require_unit(row: TimedProgram) -> None:
    program = row.program
    finite = np.isfinite(program.feed) & (program.feed > 0.0)
    least = float(np.sum(program.lengths[finite] / program.feed[finite])) + _rests(row)
    if least > 0.0 and not _FAST < row.seconds / least < _SLOW:
        raise InputError(
            f"{row.where}: {row.name} took {row.seconds:.6g} s, where its feeds ask for {least:.6g} s or more; is the time "
            "in seconds (or minutes, as the column says), and of this program?"
        )


def _rests(row: TimedProgram) -> float:
    return sum(event.seconds for event in row.program.events)


def seconds_of(timed: Sequence[TimedProgram], controller: Controller) -> Seconds:
    """What the model of a controller says of programs, with their dwells, for the limits of a machine."""
    rests = np.array([_rests(row) for row in timed])

    def seconds(limits: Limits) -> FloatArray:
        settings = controller.on_limits(limits)
        return rests + np.array([controller.motion(row.program, settings).duration for row in timed])

    return seconds
