"""A part program as arrays: one row a move, units mm, degrees and s, every modal word resolved."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.bezier import Beziers
from planner.geometry.curve import AXES
from planner.inputs import require_instance
from planner.machine.limits import Limits
from planner.types import FloatArray

RAPID, LINE, ARC, SPLINE = 0, 1, 2, 3
_COLUMNS = (
    "line", "kind", "start", "end", "centre", "normal", "sweep", "curve", "feed", "stop_after", "tolerance",
    "naive_tolerance", "modal_feed", "exact_stop",
)  # fmt: skip
# Shorter moves are none: the line is kept and takes no time.  Degrees count as mm.
ZERO_LENGTH_MM = 1e-6
# Columns of the axes that a feed is measured along, the first of them that move: X Y Z, U V W, A B C.
FEED_GROUPS = (slice(0, 3), slice(6, 9), slice(3, 6))
ANGULAR = 2
# Less is no motion of a group.  Of a move that is one, some group has at least ZERO_LENGTH_MM / sqrt(3).
_NO_MOTION = 0.5 * ZERO_LENGTH_MM


@dataclass(frozen=True)
class Event:
    """Something that happens between two moves.

    Attributes
    ----------
    line : int
        Line number in the file, from 1.
    kind : str
        "dwell", "tool_change", "tool", "spindle", "coolant", "stop", "optional_stop", "end", "signal" (M64, M65, M66, M68)
        "offset" (G54 to G59.3, G43, G49) or "message" (a comment that begins with MSG).
    seconds : float
        Length of a dwell; 0 for everything else, whose time the program does not say.
    after_move : int
        Index of the move it follows; -1 before the first.
    text : str
        The words that caused it, for example "G4 P0.5" or "M3 S12000".
    """

    line: int
    kind: str
    seconds: float
    after_move: int
    text: str


@dataclass(frozen=True, eq=False, repr=False)
class Program:
    """The moves of a part program in their order; all arrays are read-only, m is the number of moves.

    Attributes
    ----------
    source : str
        Name of the file, for messages.
    line : (m,) int64 array
        Line number in the file, from 1.  A line may have several moves, and be run again.
    kind : (m,) uint8 array
        ``RAPID``, ``LINE``, ``ARC`` (helices and spirals as well) or ``SPLINE``.
    start, end : (m, 9) arrays
        The axes in the order of :data:`~planner.geometry.curve.AXES`, mm, of A B C degrees; every move starts where the one
        before it ends.
    centre : (m, 3) array
        X, Y, Z of the centre of an arc, mm; the coordinate along the normal is that of the start.  nan for lines and
        rapids.
    normal : (m,) uint8 array
        Axis normal to the arc's plane: 2 for G17, 1 for G18, 0 for G19.
    sweep : (m,) array
        Angle swept about the positive normal axis by the right-hand rule (G3 > 0, G2 < 0 in every plane), rad, at most
        a full turn, or with a P word whole turns more; 0 for lines and rapids.  The coordinates along the normal and of
        all other axes, and the radius where start and end differ in it, are linear in the angle.
    curve : (m,) int64 array
        Of a spline its row in ``beziers``, else -1.  A spline of the program may be several moves.
    feed : (m,) array
        Cap on the feed as ``lengths`` measures it, mm/s or degrees/s; inf for rapids.  A move under G93 has its length over
        its time.
    stop_after : (m,) bool array
        The program demands an exact stop after this move.
    tolerance : (m,) array
        P of G64, mm: nan where none was given, 0 under G61 and G61.1, and in cycles, which LinuxCNC runs under G61.
    naive_tolerance : (m,) array
        Q of G64, mm; nan where none was given.
    modal_feed : (m,) array
        Of a rapid the F word in force under G94, mm/s, or nan: controllers that know no rapid run it at that feed.  Of
        other moves their feed.
    exact_stop : (m,) bool array
        G61.1 is active.
    events : tuple of Event
        In the order of the program.
    zero_lines : (k,) int64 array
        Lines whose move is shorter than ``ZERO_LENGTH_MM`` and was merged; their other words act.
    line_count : int
        Lines in the file.
    axis_lines : (9,) int64 array
        The line of the first word of each axis; 0 where there is none.
    notes : tuple of str
        What was passed over as asked, and what was taken for 0 since the program does not say it.
    beziers : Beziers, optional
        The splines, as rational Bezier curves of X, Y and Z.
    """

    source: str
    line: NDArray[np.int64]
    kind: NDArray[np.uint8]
    start: FloatArray
    end: FloatArray
    centre: FloatArray
    normal: NDArray[np.uint8]
    sweep: FloatArray
    curve: NDArray[np.int64]
    feed: FloatArray
    stop_after: NDArray[np.bool_]
    tolerance: FloatArray
    naive_tolerance: FloatArray
    modal_feed: FloatArray
    exact_stop: NDArray[np.bool_]
    events: tuple[Event, ...]
    zero_lines: NDArray[np.int64]
    line_count: int
    axis_lines: NDArray[np.int64]
    notes: tuple[str, ...] = ()
    beziers: Beziers | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __repr__(self) -> str:
        return f"Program({self.source}: {self.line_count} lines, {len(self)} moves)"

    def __len__(self) -> int:
        """Number of moves."""
        return int(self.line.size)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes the program has a word for."""
        return tuple(name for name, line in zip(AXES, self.axis_lines, strict=True) if line > 0)

    @property
    def lengths(self) -> FloatArray:
        """Length of every move as its feed is measured, (m,), mm or degrees.

        LinuxCNC's rule: along X Y Z where any of these moves, else along U V W, else along A B C.
        """
        return self._measured[0]

    @property
    def feed_group(self) -> NDArray[np.uint8]:
        """Index into ``FEED_GROUPS`` of the axes that the feed of every move is measured along, (m,)."""
        return self._measured[1]

    @cached_property
    def _measured(self) -> tuple[FloatArray, NDArray[np.uint8]]:
        arcs = np.flatnonzero(self.kind == ARC)
        along = arc_lengths(self.start[arcs], self.end[arcs], self.centre[arcs], self.normal[arcs], self.sweep[arcs])
        if self.beziers is not None:
            splines = np.flatnonzero(self.kind == SPLINE)
            arcs = np.append(arcs, splines)
            along = np.append(along, self.beziers.length[self.curve[splines]])
        found = feed_lengths(self.start, self.end, arcs, along)
        for array in found:
            array.setflags(write=False)
        return found

    def require_axes(self, limits: Limits) -> Limits:
        """Limits with axes: the machine's, or of one number for every axis those that the program names.

        Raises InputError, with file and line, where the program names an axis that the machine lacks.
        """
        require_instance(limits, Limits, "limits")
        if not limits.axes:
            named = [name for name, line in zip(AXES, self.axis_lines, strict=True) if line > 0]
            return limits.for_axes(named, self.source) if named else limits
        missing = [
            (int(line), name)
            for name, line in zip(AXES, self.axis_lines, strict=True)
            if line > 0 and name not in limits.axes
        ]
        if missing:
            line, name = min(missing)
            raise InputError(
                f"{self.source}:{line}: {name}: the machine has no axis {name}; its axes are {', '.join(limits.axes)}"
            )
        return limits


def rows_of(program: Program, rows: slice | NDArray[np.intp]) -> Program:
    """Some moves of a program, without events."""
    return replace(program, **{name: getattr(program, name)[rows] for name in _COLUMNS}, events=())


def part_of(program: Program, rows: slice | NDArray[np.intp]) -> Program:
    """As :func:`rows_of`, and of the splines those of these moves alone."""
    part = rows_of(program, rows)
    if part.beziers is None:
        return part
    used, row = np.unique(part.curve, return_inverse=True)
    rests = int(used.size > 0 and used[0] < 0)  # moves that are no splines
    return replace(part, curve=row.astype(np.int64) - rests, beziers=part.beziers.taken(used[rests:]))


def feed_lengths(
    start: FloatArray, end: FloatArray, arcs: NDArray[np.intp], along: FloatArray
) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Length of moves as their feed is measured, (m,), and which of ``FEED_GROUPS`` that is.

    Parameters
    ----------
    start, end : (m, k) arrays
        Points in the axes that are carried: X Y Z, or all nine.
    arcs : (n,) int array
        Moves that are arcs or splines.
    along : (n,) array
        Their lengths in X Y Z, mm.
    """
    length = _distance(start, end, FEED_GROUPS[0])
    length[arcs] = along
    group = np.zeros(length.size, dtype=np.uint8)
    if start.shape[1] > FEED_GROUPS[0].stop:
        for number in (1, 2):
            rest = np.flatnonzero(length < _NO_MOTION)
            other = _distance(start[rest], end[rest], FEED_GROUPS[number])
            moves = other >= _NO_MOTION
            length[rest[moves]], group[rest[moves]] = other[moves], number
    return length, group


def _distance(start: FloatArray, end: FloatArray, columns: slice) -> FloatArray:
    square = np.zeros(start.shape[0])
    for column in range(columns.start, columns.stop):
        square += (end[:, column] - start[:, column]) ** 2
    return np.sqrt(square)


def arc_lengths(
    start: FloatArray, end: FloatArray, centre: FloatArray, normal: NDArray[np.uint8], sweep: FloatArray
) -> FloatArray:
    """Length of arcs, helices and spirals in X Y Z, (m,), mm.

    On a spiral the radius goes linearly from r0 to r1; sqrt((rm sweep)^2 + (r1 - r0)^2 + h^2) with the mean radius rm
    is exact where r0 = r1, and within (r1 - r0)^2 |sweep| / (24 rm) elsewhere.
    """
    rows = np.arange(start.shape[0])
    first, second = (normal + 1) % 3, (normal + 2) % 3
    from_centre = [
        np.hypot(point[rows, first] - centre[rows, first], point[rows, second] - centre[rows, second])
        for point in (start, end)
    ]
    mean = 0.5 * (from_centre[0] + from_centre[1])
    along = end[rows, normal] - start[rows, normal]
    return np.asarray(np.sqrt((mean * sweep) ** 2 + (from_centre[1] - from_centre[0]) ** 2 + along**2))
