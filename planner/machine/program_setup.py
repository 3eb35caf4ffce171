"""What the programs of a machine count on that does not stand in them: homes, work offsets, where tools are changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from planner.machine.controller_words import ControllerWords
from planner.types import FloatArray

SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
"""Coordinate systems of a program, in the order of their numbers, 1 to 9."""
Point = Mapping[str, float]
"""Coordinates by the names of axes, mm and degrees, as programs have them; an axis that is left out stands at 0."""


@dataclass(frozen=True)
class RestTimes:
    """What the machine needs for acts whose time no program says, s; None where nobody said it.

    Attributes
    ----------
    tool_change : float, optional
        Of one M6, from the stop of the axes to their start.
    spindle_start : float, optional
        Of an M3 or M4 while the spindle stands still or turns the other way.
    """

    tool_change: float | None = None
    spindle_start: float | None = None


NO_RESTS = RestTimes()


@dataclass(frozen=True)
class ProgramSetup:
    """Positions on the machine that a program's words lead to, its tools, and how long it rests.

    Attributes
    ----------
    tools : Path, optional
        Tool table of LinuxCNC.
    home, second_home : mapping of str to float, optional
        Where G28 and G30 lead, by the names of the axes; None where the machine file does not say.
    tool_change : mapping of str to float, optional
        Where M6 leads, in the axes that are named; None: it moves nothing.
    offsets : mapping of str to mapping
        Origins of coordinate systems, by their words.
    rests : RestTimes
    controller : ControllerWords
        What the file says of the controller's own planner.
    """

    tools: Path | None = None
    home: Point | None = None
    second_home: Point | None = None
    tool_change: Point | None = None
    offsets: Mapping[str, Point] = field(default_factory=dict)
    rests: RestTimes = NO_RESTS
    controller: ControllerWords = field(default_factory=ControllerWords)


def vector(point: Point | None, axes: Sequence[str]) -> FloatArray:
    """Coordinates of a point in the order of the axes, (n,), 0 for what is not named."""
    return np.array([0.0 if point is None else point.get(axis, 0.0) for axis in axes])
