"""A part program as controllers that move along straight lines alone see it: its lines, and the chords of its arcs."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.blend import Legs
from planner.geometry.curve import AXES
from planner.machine.limits import Limits
from planner.programs.reading.program import ARC, RAPID, SPLINE, Program
from planner.types import BoolArray, FloatArray, IntArray

STRAIGHT_AXES = AXES[:3]
# A chord that is shorter is none: of a circle that is one chord alone.
_NO_LENGTH = 1e-9  # mm
_MAX_CHORDS = 20_000_000  # of a program


@dataclass(frozen=True, eq=False)
class StraightBlocks:
    """Lines in X Y Z, n of them in the order of the program; read-only arrays.

    Attributes
    ----------
    start : (n, 3) array
        mm.
    direction : (n, 3) array
        Unit vectors.
    length : (n,) array
        mm.
    feed : (n,) array
        What the program commands, mm/s: inf for rapids.
    modal_feed : (n,) array
        The same, but for rapids the feed in force; nan where there is none.
    rapid : (n,) bool array
    line : (n,) int array
        Line of the program.
    stop : (n + 1,) bool array
        Where the motion stands still: before the first block, after the last, and between two where the program does
        something that the controller waits for.
    """

    start: FloatArray
    direction: FloatArray
    length: FloatArray
    feed: FloatArray
    modal_feed: FloatArray
    rapid: BoolArray
    line: NDArray[np.int64]
    stop: BoolArray

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)

    @property
    def legs(self) -> Legs:
        """The lines as legs."""
        vectors = np.zeros((self.length.size, 4, 3))
        vectors[:, 0], vectors[:, 3] = self.start, self.direction
        return Legs(vectors, np.zeros((self.length.size, 2)))

    @property
    def turn(self) -> tuple[FloatArray, FloatArray]:
        """Sine and cosine of half the angle that the path encloses where two blocks meet, (n - 1,).

        The angle is 180 degrees where it goes straight on, 0 where it turns back.
        """
        cosine = -np.sum(self.direction[1:] * self.direction[:-1], axis=1)
        return np.sqrt(np.maximum(0.5 * (1.0 - cosine), 0.0)), np.sqrt(np.maximum(0.5 * (1.0 + cosine), 0.0))


def straight_blocks(
    program: Program,
    controller: str,
    chord_counts: Callable[[FloatArray, FloatArray, FloatArray], IntArray],
    waits_for: Collection[str],
    steps: FloatArray | None = None,
) -> StraightBlocks:
    """Cut the arcs of a program into chords of equal angles.

    Parameters
    ----------
    program : Program
    controller : str
        Its name, for messages.
    chord_counts : callable
        Takes radius, mm, angle swept, rad, > 0, and length in X Y Z, mm, of arcs, (k,) each, and gives the number of
        chords of each.
    waits_for : collection of str
        Kinds of events at which the motion stops.
    steps : (3,) array, optional
        Of each axis a mm: every point is rounded to them.

    Raises
    ------
    InputError
        If the program has splines or moves other axes than X Y Z, or there are too many chords.
    """
    row = np.flatnonzero(program.lengths > 0.0)
    if not row.size:
        raise InputError(f"{program.source}: the program moves nothing; a time needs a move")
    _require_straight(program, row, controller)
    count = np.ones(row.size, dtype=np.intp)
    arcs = np.flatnonzero(program.kind[row] == ARC)
    if arcs.size:
        moves = row[arcs]
        counted = chord_counts(_length(_spokes(program, moves)), np.abs(program.sweep[moves]), program.lengths[moves])
        count[arcs] = np.maximum(counted, 1)
    if count.sum() > _MAX_CHORDS:
        raise InputError(f"{program.source}: its arcs are {count.sum()} chords; at most {_MAX_CHORDS} are timed")
    move = np.repeat(np.arange(row.size), count)
    last = np.cumsum(count) - 1
    points = np.concatenate([program.start[row[:1], :3], program.end[row[move], :3]])
    inner = np.flatnonzero(np.arange(move.size) < last[move])
    share = (inner + 1 - (last + 1 - count)[move[inner]]) / count[move[inner]]
    points[1 + inner] = _on_arcs(program, row[move[inner]], share)
    if steps is not None:
        points = np.round(points * steps) / steps
    step = np.diff(points, axis=0)
    size = _length(step)
    kept = np.flatnonzero(size > _NO_LENGTH)
    if not kept.size:
        raise InputError(
            f"{program.source}:{program.line[row[0]]}: of the circle the controller {controller} makes one chord, which "
            "has no length; there is no other move"
        )
    move = move[kept]
    of = row[move]
    return StraightBlocks(
        start=points[kept],
        direction=step[kept] / size[kept, None],
        length=size[kept],
        feed=program.feed[of],
        modal_feed=program.modal_feed[of],
        rapid=program.kind[of] == RAPID,
        line=program.line[of],
        stop=stops_of(program, of, waits_for),
    )


def stops_of(program: Program, of: IntArray, waits_for: Collection[str]) -> BoolArray:
    """Where blocks of the moves ``of`` (n,) stop, (n + 1,)."""
    stop = np.zeros(of.size + 1, dtype=np.bool_)
    after = np.array([event.after_move for event in program.events if event.kind in waits_for], dtype=np.intp)
    stop[np.searchsorted(of, after, side="right")] = True
    stop[[0, -1]] = True
    return stop


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.sum(vectors**2, axis=1)))


def _spokes(program: Program, moves: IntArray) -> FloatArray:
    """From the centres of arcs to their starts, in their planes, (k, 3), mm."""
    spoke = program.start[moves, :3] - program.centre[moves]
    spoke[np.arange(moves.size), program.normal[moves]] = 0.0
    return spoke


def _on_arcs(program: Program, moves: IntArray, share: FloatArray) -> FloatArray:
    """Points on arcs at shares (k,) of their angles, (k, 3), mm.

    The radius is that of the start, wherever the end lies: what is left over is in the last chord.
    """
    spoke, normal = _spokes(program, moves), np.eye(3)[program.normal[moves]]
    angle = (program.sweep[moves] * share)[:, None]
    around = np.cos(angle) * spoke + np.sin(angle) * np.cross(normal, spoke)
    climb = normal * (program.end[moves, :3] - program.start[moves, :3]) * share[:, None]
    return np.asarray(program.start[moves, :3] - spoke + around + climb)


def limits_of_straight_axes(limits: Limits, controller: str) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations of X Y Z, (3,), mm/s and mm/s^2; an axis that a machine lacks has the highest of it.

    Raises
    ------
    InputError
        If one is inf.
    """
    found = []
    for quantity, row in (("velocity", limits.velocity), ("acceleration", limits.acceleration)):
        values = [row[limits.axes.index(name)] if name in limits.axes else row.max() for name in STRAIGHT_AXES]
        for name, value in zip(STRAIGHT_AXES, values, strict=True):
            if np.isinf(value):
                raise InputError(
                    f"the machine has no limit on the {quantity} of {name}; {controller} has none without it"
                )
        found.append(np.array(values, dtype=np.float64))
    return found[0], found[1]


def _require_straight(program: Program, row: IntArray, controller: str) -> None:
    """Refuse what such a controller does not move along."""
    splines = row[program.kind[row] == SPLINE]
    if splines.size:
        raise InputError(
            f"{program.source}:{program.line[splines[0]]}: the controller {controller} knows no splines; write them as "
            "lines or arcs"
        )
    require_straight_axes(program, controller)


def require_straight_axes(program: Program, controller: str) -> None:
    """Refuse a program that names other axes than X Y Z."""
    others = program.axis_lines[len(STRAIGHT_AXES) :]
    if others.any():
        line, axis = min((int(n), name) for n, name in zip(others, AXES[len(STRAIGHT_AXES) :], strict=True) if n > 0)
        raise InputError(
            f"{program.source}:{line}: {axis}: the model of {controller} is of X Y Z; it tells no time of a program that "
            f"moves {axis}"
        )
