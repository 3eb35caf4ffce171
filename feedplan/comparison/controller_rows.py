"""A part program as other controllers run it, by their models: judged by the same check as every method.

A controller moves along a path of its own (the program, chords of its arcs, rounded points), so its samples are checked on
that path, under the limits of the machine; how far that path is from the program stands beside it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from feedplan.comparison.judgement import fluctuation, judge
from feedplan.comparison.methods import MethodRun
from feedplan.comparison.result import Result
from feedplan.controller_time import Settings, within_feed
from planner.controllers.known import controller_motion
from planner.controllers.settings_on import settings_on
from planner.errors import InputError
from planner.machine.program_setup import ProgramSetup
from planner.programs.path.deviation import deviation
from planner.programs.path.moves import MovingBlocks

if TYPE_CHECKING:
    from feedplan.job import Job
    from planner.controllers.controller_motion import ControllerMotion
    from planner.geometry.chain import ChainCurve
    from planner.programs.reading.program import Program
    from planner.types import FloatArray

_WINDOW = 1.0  # mm along the program in which the nearest point is searched


def with_controllers(results: Sequence[Result], job: Job, chosen: Mapping[str, Settings]) -> tuple[Result, ...]:
    """Add a row for each controller behind those of the methods.

    Parameters
    ----------
    results : sequence of Result
    job : Job
        Of a part program; of another curve there is nothing to add.
    chosen : mapping of str to mapping
        Settings in place of those of the machine file, by the names of the controllers.

    Returns
    -------
    tuple of Result
        A controller that cannot run the program has a reason in place of numbers.
    """
    if job.program is None:
        return tuple(results)
    program = within_feed(job.program, job.limits.feed)
    return (*results, *(_result(program, job, name, given) for name, given in chosen.items()))


def _result(program: Program, job: Job, name: str, given: Settings) -> Result:
    words = (ProgramSetup() if job.setup is None else job.setup).controller
    began = time.process_time()
    try:
        on = settings_on(name, job.limits, words, given)
        motion = controller_motion(program, name, on.settings).on_axes(job.curve.axes)
        samples = motion.samples(job.limits.period)
    except InputError as error:
        return Result(name, reason=f"{type(error).__name__}: {error}")
    seconds = time.process_time() - began
    curve = motion.curve(f"{program.source} on {name}")
    setting = ", ".join(f"{key} {value}" for key, value, _ in on.said)
    run = MethodRun(samples, np.diff(samples.u) / samples.period, motion.duration, setting=setting)
    rows, judgement = judge(curve, job.limits, run)
    return Result(
        method=name,
        duration=motion.duration,
        points=samples.t.size,
        chord_error=max(row.worst for row in rows if row.limit == "chord error"),
        fluctuation=fluctuation(curve, run),
        computing_time=seconds,
        judgement=judgement,
        motion=run,
        deviation=_from_program(program, motion, curve),
    )


def _from_program(program: Program, motion: ControllerMotion, curve: ChainCurve) -> float:
    """Largest distance between the path of a controller and the program, measured both ways, mm; nan in other axes."""
    blocks = MovingBlocks.of(program, None)
    if blocks.axes != motion.axes:
        return math.nan
    ends = _ends_of_lines(program.line[blocks.row], blocks.programmed.edges)
    u, s = [0.0], [0.0]
    at = 0
    for line, u_end in _ends_of_lines(motion.line, curve.edges):
        while at < len(ends) and ends[at][0] != line:  # a line that the controller has merged with the next
            at += 1
        if at < len(ends) and ends[at][1] > s[-1]:
            u.append(u_end)
            s.append(ends[at][1])
            at += 1
    u[-1], s[-1] = float(curve.edges[-1]), float(blocks.programmed.edges[-1])
    return deviation(curve, blocks.programmed, np.array(u), np.array(s), _WINDOW).largest


def _ends_of_lines(line: np.ndarray, edges: FloatArray) -> list[tuple[int, float]]:
    """Of every run of blocks of one line its number, and the edge at which it ends."""
    last = np.flatnonzero(np.append(line[1:] != line[:-1], True))
    return list(zip(line[last].tolist(), edges[last + 1].tolist(), strict=True))
