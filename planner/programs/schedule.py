"""When every move of a part program begins, dwells, tool changes and spindle starts counted."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from planner.machine.program_setup import NO_RESTS, RestTimes
from planner.programs.reading.program import Program
from planner.programs.reading.words import LineArray
from planner.types import FloatArray

_TURNS = re.compile(r"M0*(3|4|5|19)\b")
_LINES = 2**32  # more than a file has
_SENSE = {3: 1, 4: -1, 5: 0, 19: 0}


@dataclass(frozen=True)
class Pause:
    """A time in which the axes stand.

    Attributes
    ----------
    line : int
        Of the program.
    kind : str
        "dwell", "tool_change" or "spindle".
    seconds : float
        0 where nobody says how long it takes.
    before : int
        Index of the move with a length that follows; their number after the last.
    text : str
        The words.
    """

    line: int
    kind: str
    seconds: float
    before: int
    text: str


@dataclass(frozen=True, eq=False)
class Schedule:
    """The run of a program in time.

    Attributes
    ----------
    row : (m,) int array
        The moves with a length, as indices of the program's.
    start, seconds : (m,) arrays
        When each begins, s from the start of the run, and how long it takes.
    rests : tuple of Pause
        In the order of the run.
    rest_start : (r,) array
        When each rest begins, s.
    """

    row: LineArray
    start: FloatArray
    seconds: FloatArray
    rests: tuple[Pause, ...]
    rest_start: FloatArray

    @property
    def total(self) -> float:
        """Time of the run, s."""
        return math.fsum(self.seconds) + math.fsum(rest.seconds for rest in self.rests)

    def rested(self, kind: str) -> float:
        """Time of all rests of a kind, s."""
        return math.fsum(rest.seconds for rest in self.rests if rest.kind == kind)

    def reached(self, move: LineArray, line: LineArray) -> FloatArray:
        """When lines are reached, s, that stand before these moves and do nothing: after what rests there above them."""
        ends = np.concatenate([np.zeros(1), np.cumsum(self.seconds)])
        rested = np.concatenate([np.zeros(1), np.cumsum([rest.seconds for rest in self.rests])])
        keys = np.array([rest.before * _LINES + rest.line for rest in self.rests], dtype=np.int64)
        return ends[move] + rested[np.searchsorted(np.maximum.accumulate(keys), move * _LINES + line)]

    @classmethod
    def of(cls, program: Program, seconds: FloatArray, rests: RestTimes = NO_RESTS) -> Schedule:
        """Put the times of the moves with a length (m,) and those of the rests in the order of the run."""
        row = np.flatnonzero(program.lengths > 0.0)
        found = _rests(program, row, rests)
        taken = np.array([rest.seconds for rest in found])
        before = np.array([rest.before for rest in found], dtype=np.int64)
        moved = np.concatenate([np.zeros(1), np.cumsum(seconds)])
        rested = np.concatenate([np.zeros(1), np.cumsum(taken)])
        start = moved[:-1] + rested[np.searchsorted(before, np.arange(row.size), side="right")]
        return cls(row, start, seconds, found, moved[before] + rested[:-1])


def _rests(program: Program, row: LineArray, rests: RestTimes) -> tuple[Pause, ...]:
    """Dwells, tool changes and spindle starts, in the order of the run."""
    found: list[Pause] = []
    turning = 0
    after = np.searchsorted(row, [event.after_move for event in program.events], side="right").tolist()
    for event, before in zip(program.events, after, strict=True):
        seconds = event.seconds
        if event.kind == "spindle":
            words = _TURNS.findall(event.text)
            sense = _SENSE[int(words[-1])] if words else turning
            starts, turning = sense not in (0, turning), sense
            if not starts:
                continue
            seconds = rests.spindle_start or 0.0
        elif event.kind == "tool_change":
            seconds = rests.tool_change or 0.0
        elif event.kind != "dwell":
            continue
        found.append(Pause(event.line, event.kind, seconds, before, event.text))
    # the words of a block may act before and after its motion: the order is that of the run
    return tuple(sorted(found, key=lambda rest: rest.before))
