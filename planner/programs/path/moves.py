"""The moves of a part program as legs: what the path, its parts and the measure of their deviation are made of.

A distance between two points of several axes is sqrt(sum of squares), a degree counted as a mm: so is the abscissa, the
tolerance, and all that a path is made by.  What is within P of the program in this sense is so in X Y Z alone, in U V W, and
in A B C, in degrees.

The feed is measured on another path, of which each move has a part by LinuxCNC's rule: X Y Z where these move, else U V W,
else A B C in degrees.  X Y Z stand still in the moves of the other kinds; so this path is X Y Z, and further columns that
advance in the moves that are measured along them alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.errors import CurveError
from planner.geometry.blend import Legs
from planner.geometry.curve import AXES, DEGREES, ROTARY_AXES
from planner.geometry.tolerance import DEFAULT_TOLERANCE
from planner.programs.path.deviation import Programmed
from planner.programs.reading.move_legs import legs_of_moves
from planner.programs.reading.program import ANGULAR, ARC, FEED_GROUPS, RAPID, SPLINE, Program
from planner.types import BoolArray, FloatArray, IntArray

_TURNS_BACK = np.cos(np.deg2rad(150.0))  # of the path the feed is measured on: there its speed would fall to 0
# Where the feed begins to be measured along other axes, by how much these may move faster or slower for a length of
# path: in a corner both count, and its speed would have to fall so far within it that no grid of a plan follows.
_MAX_UNEVEN = 4.0


def scale_of(axes: Sequence[str]) -> FloatArray:
    """What the coordinates of axes in mm and rad are multiplied by where they are taken together, a degree as a mm."""
    return np.array([DEGREES if name in ROTARY_AXES else 1.0 for name in axes])


@dataclass(frozen=True, eq=False)
class ProgramAxes:
    """What a program moves.

    Attributes
    ----------
    moving : (9,) bool array
        The axes that move; X, Y or Z among them and at least two, since a path has two axes or more.
    groups : (3,) bool array
        The ``FEED_GROUPS`` that the feed of some move is measured along.
    """

    moving: BoolArray
    groups: BoolArray

    @classmethod
    def of(cls, program: Program) -> ProgramAxes:
        """Look at all moves."""
        moving = np.maximum(program.start.max(axis=0), program.end.max(axis=0)) > np.minimum(
            program.start.min(axis=0), program.end.min(axis=0)
        )
        arcs = program.kind == ARC
        moving[np.unique((program.normal[arcs][:, None] + np.array([1, 2])) % 3)] = True
        if program.beziers is not None:
            used = np.unique(program.curve[program.kind == SPLINE])
            moving[:3] |= program.beziers.powers[used, :-1].any(axis=(0, 2))
        named = [k for k in range(3) if program.axis_lines[k]]
        for k in (*named, 0, 1, 2):
            if moving.sum() < 2 or not moving[:3].any():
                moving[k] = True
        return cls(moving, np.bincount(program.feed_group, minlength=len(FEED_GROUPS)) > 0)

    @property
    def names(self) -> tuple[str, ...]:
        """The axes that move."""
        return tuple(name for name, moves in zip(AXES, self.moving, strict=True) if moves)

    @property
    def scale(self) -> FloatArray:
        """What their coordinates in mm and rad are multiplied by where they are taken together, a degree as a mm."""
        return scale_of(self.names)


@dataclass(frozen=True, eq=False)
class MovingBlocks:
    """The blocks that move, in the axes that move: rows of the program with a length.

    Attributes
    ----------
    row : (m,) int array
    used : ProgramAxes
        What the program moves.
    programmed : Programmed
        In mm and degrees.
    tolerance, feed : (m,) arrays
        In force at each; the feed as the program measures it.
    rapid : (m,) bool array
    stop : (m - 1,) bool array
        Stops that the program demands, and places where the tool turns back.
    group : (m,) uint8 array
        Index into ``FEED_GROUPS``: what the feed is measured along.
    turns_back : (m - 1,) bool array
        The path that the feed is measured on turns by more than 150 degrees.
    uneven : (m - 1,) bool array
        It is another one from here on, and what is measured moves at quite another rate.
    length : (m,) array
        Of each, mm: to the last digit, whatever lies before it.
    """

    row: IntArray
    used: ProgramAxes
    programmed: Programmed
    tolerance: FloatArray
    feed: FloatArray
    rapid: BoolArray
    stop: BoolArray
    group: NDArray[np.uint8]
    turns_back: BoolArray
    uneven: BoolArray
    length: FloatArray

    @classmethod
    def of(cls, program: Program, tolerance: float | None, used: ProgramAxes | None = None) -> MovingBlocks:
        """Take the moves as legs; ``used``: of a program that these moves are a part of."""
        row = np.flatnonzero(program.lengths > 0.0)
        if not row.size:
            raise CurveError(
                f"{program.source}: the program moves nothing, in the digits of its numbers; a path needs a move"
            )
        used = ProgramAxes.of(program) if used is None else used
        legs, length = legs_of_moves(program, row, used.moving)
        edges = np.concatenate([[0.0], np.cumsum(length)])
        given = program.tolerance[row]
        own = np.where(np.isnan(given), DEFAULT_TOLERANCE, given)
        if tolerance is not None:
            own = np.where(given == 0.0, 0.0, tolerance)
        rapid = program.kind[row] == RAPID
        halts = np.concatenate([[0], np.cumsum(program.stop_after)])
        # a stop between two moves that stay counts, also after a move of length 0
        stop = (halts[row[1:]] > halts[row[:-1]]) | rapid[:-1] | rapid[1:]
        group = program.feed_group[row]
        programmed = Programmed(edges, legs, used.scale, length / program.lengths[row])
        back = uneven = np.zeros(stop.size, dtype=np.bool_)
        if used.moving[3:].any():
            back, uneven = _measured_turns(programmed, group, used.names)
        return cls(
            row, used, programmed, own, program.feed[row], rapid, stop | back | uneven, group, back, uneven, length
        )

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return self.used.names

    @property
    def apart(self) -> BoolArray:
        """Junctions at which the feed begins to be measured along other axes, (m - 1,)."""
        return np.asarray(self.group[1:] != self.group[:-1])

    @property
    def angular(self) -> BoolArray:
        """Blocks whose feed is in degrees/s, (m,)."""
        return np.asarray(self.group == ANGULAR)

    @property
    def speed(self) -> FloatArray:
        """Cap on the rate of the abscissa by the feed of every block, (m,), mm/s."""
        return self.feed * self.programmed.per_feed

    @cached_property
    def columns(self) -> ChainColumns:
        """What the pieces of a chain are made of."""
        return ChainColumns.of(self)


@dataclass(frozen=True, eq=False)
class ChainColumns:
    """Columns of the pieces of a chain: the axes, in mm and rad, and the path that the feed is measured on.

    Attributes
    ----------
    scale : (d,) array
        Of the axes, rad per degree or 1.
    extra : tuple of (int, int)
        Of every further column the axis that it follows and the group whose moves advance it.
    start : (m, e) array
        Where the further columns are at the start of every block.
    """

    scale: FloatArray
    extra: tuple[tuple[int, int], ...]
    start: FloatArray
    tip: tuple[int, ...]
    blocks: MovingBlocks

    @classmethod
    def of(cls, blocks: MovingBlocks) -> ChainColumns:
        """Find which are needed: none where every move is one of X Y Z, in these axes alone."""
        axes, group = blocks.axes, blocks.group
        columns = [[j for j, name in enumerate(axes) if name in AXES[part]] for part in FEED_GROUPS]
        extra = tuple((j, g) for g in (1, 2) if blocks.used.groups[g] for j in columns[g])
        vectors, length = blocks.programmed.legs.vectors, np.diff(blocks.programmed.edges)
        steps = (
            np.stack([np.where(group == g, vectors[:, 3, j] * length, 0.0) for j, g in extra], axis=1)
            if extra
            else np.empty((group.size, 0))
        )
        start = np.concatenate([np.zeros((1, len(extra))), np.cumsum(steps, axis=0)])[:-1]
        tip = (*columns[0], *range(len(axes), len(axes) + len(extra)))
        scale = 1.0 / blocks.used.scale
        return cls(scale, extra, start, () if len(columns[0]) == len(axes) else tip, blocks)

    @property
    def weight(self) -> FloatArray:
        """What the square of each column counts in the abscissa."""
        return np.concatenate([self.scale**-2.0, np.zeros(len(self.extra))])

    def legs(self) -> Legs:
        """The blocks."""
        legs = self.blocks.programmed.legs
        if not self.tip:
            return legs
        vectors = np.concatenate(
            [legs.vectors * self.scale, np.zeros((*legs.vectors.shape[:2], len(self.extra)))], axis=2
        )
        for k, (j, g) in enumerate(self.extra, start=len(self.scale)):
            vectors[:, 0, k] = self.start[:, k - len(self.scale)]
            vectors[:, 3, k] = np.where(self.blocks.group == g, legs.vectors[:, 3, j], 0.0)
        if legs.ways is None or legs.beziers is None:
            return Legs(vectors, legs.rates)
        on = np.flatnonzero(legs.ways[:, 0] >= 0.0)
        start = np.zeros((len(legs.beziers), vectors.shape[2]))
        start[legs.ways[on, 0].astype(np.intp)] = vectors[on, 0]
        return Legs(vectors, legs.rates, legs.ways, legs.beziers.with_columns(start))

    def spans(self, powers: FloatArray, first: float) -> FloatArray:
        """A tube from an abscissa on, within which the feed is measured along the same axes: its powers (n, d, 5)."""
        if not self.tip:
            return powers
        edges, group = self.blocks.programmed.edges, self.blocks.group
        block = int(np.clip(np.searchsorted(edges, first, side="right") - 1, 0, group.size - 1))
        out = np.concatenate(
            [powers * self.scale[:, None], np.zeros((powers.shape[0], len(self.extra), powers.shape[2]))], axis=1
        )
        for k, (j, g) in enumerate(self.extra):
            column = out[:, len(self.scale) + k]
            column[:, 0] = self.start[block, k]
            if group[block] == g:
                column[:] += powers[:, j]
                column[:, 0] -= self.blocks.programmed.legs.vectors[block, 0, j]
        return out


def _measured_turns(
    programmed: Programmed, group: NDArray[np.uint8], axes: tuple[str, ...]
) -> tuple[BoolArray, BoolArray]:
    """Junctions at which the path that the feed is measured on turns back, or is uneven with the one before, (m - 1,)."""
    measured = np.array([[name in AXES[part] for name in axes] for part in FEED_GROUPS])
    at = programmed.edges[1:-1]
    before, after = (programmed.at(at, left=left)[1] for left in (True, False))
    before, after = before * measured[group[:-1]], after * measured[group[1:]]
    slow, fast = np.sort([np.sqrt(np.sum(rate**2, axis=1)) for rate in (before, after)], axis=0)
    same = group[1:] == group[:-1]
    back = same & (np.sum(before * after, axis=1) < _TURNS_BACK * slow * fast)
    return np.asarray(back), np.asarray(~same & (fast > _MAX_UNEVEN * slow))
