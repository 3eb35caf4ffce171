"""The programmed point after every block, in coordinates of the machine.

Between words that act at once (``acts``) the offsets do not change: there the positions of all blocks are made of whole
columns.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from planner.geometry.curve import AXES, MAX_COORDINATE, ROTARY_AXES
from planner.programs.reading.blocks import Blocks
from planner.programs.reading.language import (
    AXIS_LETTERS,
    CHANGE,
    COMPENSATION,
    DISTANCE,
    MOTION,
    ONCE,
    SYSTEM,
    TOOL_LENGTH,
)  # fmt: skip
from planner.programs.reading.modal import INCH_MM, ReadingState
from planner.programs.reading.offsets import origin
from planner.programs.reading.program import RAPID, SPLINE
from planner.programs.reading.words import LineArray
from planner.types import FloatArray

_DWELL, _MACHINE = 40, 530
CYCLE, NURBS = SPLINE + 1, SPLINE + 2  # kinds of blocks, beside those of moves: a canned cycle, a part of a NURBS


@dataclass
class SideMove:
    """A move of a block that makes several, or that is not where its words say: its end, (9,), and a dwell after it, s.

    ``pitch`` is the way of a turn of the spindle, mm, where that is its feed.
    """

    row: int
    kind: int
    end: FloatArray
    dwell: float = 0.0
    pitch: float = np.nan


@dataclass(frozen=True, eq=False)
class NurbsMove:
    """A complete NURBS, made by the block ``row``: its lines, its control points (n, 3), mm, weights, knots and degree, and
    where the machine stands then, (9,).
    """

    row: int
    lines: list[int]
    control: FloatArray
    weights: FloatArray
    knots: FloatArray
    degree: int
    end: FloatArray


@dataclass
class ProgramTrack:
    """The programmed points of a part as they are made: before the first and after every block, mm and degrees.

    The points are (n + 1, 3) as long as only X, Y and Z are named or can move, else (n + 1, 9).
    """

    blocks: Blocks
    modal: dict[int, LineArray]
    unit: FloatArray
    kind: LineArray
    state: ReadingState
    points: FloatArray = field(init=False)
    side: list[SideMove] = field(default_factory=list)
    nurbs: list[NurbsMove] = field(default_factory=list)
    totals: list[tuple[int, FloatArray]] = field(default_factory=list)  # the offsets from a block on
    tools: list[tuple[int, int]] = field(default_factory=list)  # from a block on: which tool is compensated, 0 for none

    def __post_init__(self) -> None:
        state = self.state
        homes = state.offsets.home.values()
        elsewhere = any(home[3:].any() for home in homes) or any(axis > 2 for axis in state.offsets.tool_change or ())
        if elsewhere or self.blocks.any_of(AXIS_LETTERS[3:]).any():
            state.carried = len(AXES)
        self.points = np.empty((self.kind.size + 1, state.carried))
        self.points[0] = state.programmed[: state.carried]
        self.tools.append((0, self.state.tool_beside))

    def special_rows(self) -> LineArray:
        """Blocks at which something is done that is no plain move."""
        once = self.blocks.g[ONCE]
        special = once.given & (once.value != _DWELL)
        for group in (COMPENSATION, TOOL_LENGTH, SYSTEM):
            special |= self.blocks.g[group].given
        special |= self.blocks.m[CHANGE].given
        special |= self.kind >= CYCLE
        return np.flatnonzero(special)

    def in_machine_coordinates(self, row: int) -> bool:
        """Whether a block has G53."""
        once = self.blocks.g[ONCE]
        return bool(once.given[row]) and once.value[row] == _MACHINE

    def stand(self, row: int, axis: int, at: float) -> None:
        """Let an axis without a word before a block have stood somewhere from the start, mm or degrees."""
        shift = at - self.state.programmed[axis]
        self.state.stand(axis, at)
        self.state.known[axis] = True
        if axis < self.points.shape[1]:
            self.points[: row + 1, axis] += shift
        for move in self.side:
            move.end[axis] += shift
        for nurbs in self.nurbs:
            nurbs.end[axis] += shift
            if axis < nurbs.control.shape[1]:
                nurbs.control[:, axis] += shift

    def origins(self, rows: LineArray) -> FloatArray:
        """What absolute centres of arcs at these blocks count from, (m, 3), mm."""
        at = np.searchsorted([row for row, _ in self.totals], rows, side="right") - 1
        return np.array([total[:3] for _, total in self.totals])[at]

    def tools_beside(self, rows: LineArray) -> LineArray:
        """The number of the tool that is compensated at these blocks, 0 for none."""
        if len(self.tools) == 1:
            return np.full(rows.size, self.tools[0][1])
        first, number = np.array(self.tools).T
        return np.asarray(number[np.searchsorted(first, rows, side="right") - 1])

    def run(self, first: int, last: int) -> None:
        """Carry the position through the blocks from the first to before the last."""
        state, rows = self.state, np.arange(last - first)
        if state.series is not None and (
            (self.kind[first:last] >= RAPID).any() or self.blocks.g[MOTION].given[first:last].any()
        ):
            state.series = None
        machine = last == first + 1 and self.in_machine_coordinates(first)
        offset = origin() if machine else state.offsets.total
        self.totals.append((first, offset))
        kind, unit = self.kind[first:last], self.unit[first:last]
        absolute = np.ones(1, dtype=np.bool_) if machine else self.modal[DISTANCE][first:last] == 900
        moving = kind >= RAPID
        for axis, name in enumerate(AXES[: state.carried]):
            column = self.blocks.letters[name]
            given, target = column.given[first:last] & moving, column.value[first:last]
            if name not in ROTARY_AXES:
                target = target * unit
            if state.axis_lines[axis] == 0 and given.any():
                row = int(np.argmax(given))
                state.axis_lines[axis] = self.blocks.line[first + row]
                if not state.known[axis] and absolute[row] and kind[row] == RAPID:
                    self.stand(first, axis, float(target[row] + offset[axis]))
            out = self.points[first + 1 : last + 1, axis]
            if not given.any():
                out[:] = state.programmed[axis]
                continue
            steps = np.cumsum(np.where(given & ~absolute, target, 0.0))
            at = np.maximum.accumulate(np.where(given & absolute, rows, -1))
            since = np.where(at >= 0, steps - steps[at], steps)
            out[:] = np.where(at >= 0, target[at] + offset[axis], state.programmed[axis]) + since
        state.programmed[: state.carried] = self.points[last]

    def require_near(self) -> None:
        """Refuse blocks that lead too far."""
        far = np.flatnonzero((np.abs(self.points[1:]) > MAX_COORDINATE * INCH_MM).any(axis=1))
        self.blocks.faults.add(self.blocks.first[far], "leads farther than 2.5e10 mm from 0")


def block_numbers(blocks: Blocks, row: int, unit: float) -> list[float | None]:
    """The numbers behind the letters of the axes in a block, mm and degrees."""
    found = [blocks.number(row, name) for name in AXES]
    return [
        value if value is None or name in ROTARY_AXES else value * unit for name, value in zip(AXES, found, strict=True)
    ]
