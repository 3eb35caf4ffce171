"""How LinuxCNC 2.9 moves: its queue of moves, its blends, and its trapezoids, period by period.

Sources: LinuxCNC's documentation ("Trajectory Control", "INI Configuration") and its source code for the rules; they are
written down here anew, and measured (docs/controllers.md).

1. The interpreter hands over moves, some of them merged: linuxcnc_moves.py.
2. Every corner becomes a kink that is passed at a speed, an arc, or an overlap of two moves: linuxcnc_queue.c.
3. The queue is run, period by period: linuxcnc_run.c.  The positions of the joints trail that by two periods.

The queue is taken to be full whenever the motion goes on, and to run empty at dwells, tool changes, stops, words of the
spindle and of the coolant, and wherever else LinuxCNC waits for the motion.

Known limitation: X Y Z alone; no motion that follows a spindle; a feed override of 100 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.controllers.controller_motion import ControllerMotion, cut_legs
from planner.controllers.linuxcnc_moves import LinuxcncMoves, linuxcnc_moves
from planner.controllers.straight_blocks import STRAIGHT_AXES, limits_of_straight_axes
from planner.errors import InputError
from planner.geometry.blend import Legs
from planner.inputs import numbers, positive_number, shorten
from planner.machine.limits import Limits
from planner.programs.reading.program import Program
from planner.types import FloatArray, IntArray

LINUXCNC = "linuxcnc"
SETTLING_PERIODS = 2  # that the joints trail the plan, after every stop with an empty queue
_PIECES = 1 << 16  # of one call
_TIME, _LEG, _FROM, _SPEED, _RATE, _SECONDS, _WAY = range(7)
_NO_LENGTH = 1e-12  # mm
# columns of a segment
_ORIGIN, _SPOKE, _ACROSS, _HELIX, _ALONG = (slice(3 * k, 3 * k + 3) for k in range(5))
_RADIUS, _ANGLE, _SPIRAL, _LEAD, _LENGTH, _MOVE, _KIND = range(18, 25)
_LINE, _CIRCLE = 0, 1


@dataclass(frozen=True, eq=False)
class LinuxcncSettings:
    """What of an INI file of LinuxCNC its planner uses, mm and s; the defaults are LinuxCNC's own.

    Parameters
    ----------
    max_velocity, max_acceleration : (3,) sequences of float
        Of X Y Z.
    period : float
        [EMCMOT]SERVO_PERIOD, s.
    path_velocity : float
        [TRAJ]MAX_LINEAR_VELOCITY.
    max_feed_override : float
        [DISPLAY]MAX_FEED_OVERRIDE: at this share of the feed corners are planned.
    optimization_depth, gap_cycles, ramp_frequency, kink_ratio : float
        [TRAJ]ARC_BLEND_OPTIMIZATION_DEPTH, _GAP_CYCLES, _RAMP_FREQ (Hz), _KINK_RATIO.
    arc_blend : float
        [TRAJ]ARC_BLEND_ENABLE, 1 or 0.
    """

    max_velocity: FloatArray
    max_acceleration: FloatArray
    period: float = 1e-3
    path_velocity: float = np.inf
    max_feed_override: float = 1.0
    optimization_depth: float = 50.0
    gap_cycles: float = 4.0
    ramp_frequency: float = 100.0
    kink_ratio: float = 0.1
    arc_blend: float = 1.0

    def __post_init__(self) -> None:
        for name in ("max_velocity", "max_acceleration"):
            row = numbers(getattr(self, name), name, InputError)
            if row.shape != (3,) or not ((row > 0.0) & np.isfinite(row)).all():
                raise InputError(f"{name} = {shorten(str(row.tolist()))} must be three finite numbers > 0, of X Y Z")
            row.setflags(write=False)
            object.__setattr__(self, name, row)
        for name in ("period", "max_feed_override", "ramp_frequency", "kink_ratio"):
            positive_number(getattr(self, name), name)
        for name in ("path_velocity", "optimization_depth", "gap_cycles", "arc_blend"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not value >= 0.0:
                raise InputError(f"{name} = {shorten(repr(value))} must be a number >= 0")
        if not self.path_velocity > 0.0:
            raise InputError("path_velocity = 0 must be > 0")

    @property
    def machine(self) -> FloatArray:
        """``Machine`` of linuxcnc_inline.h, (14,)."""
        return np.array(
            [
                *self.max_velocity, *self.max_acceleration, self.period, self.path_velocity, self.max_feed_override,
                min(self.optimization_depth, 200.0), self.gap_cycles, self.ramp_frequency,
                min(max(self.kink_ratio, 0.001), 0.7071), self.arc_blend,
            ]
        )  # fmt: skip


LINUXCNC_KEYS = {
    "max_feed_override": "max_feed_override",
    "arc_blend": "arc_blend",
    "optimization_depth": "optimization_depth",
    "gap_cycles": "gap_cycles",
    "ramp_frequency_hz": "ramp_frequency",
    "kink_ratio": "kink_ratio",
}
"""Settings that are no limits, by their keys with units."""


def linuxcnc_on(limits: Limits) -> LinuxcncSettings:
    """The limits of a machine as those of an INI file.

    Raises
    ------
    InputError
        If an axis has no limit on its velocity or acceleration.
    """
    velocity, acceleration = limits_of_straight_axes(limits, "LinuxCNC")
    return LinuxcncSettings(velocity, acceleration, period=limits.period, path_velocity=limits.rapid)


def linuxcnc_motion(program: Program, settings: LinuxcncSettings) -> ControllerMotion:
    """The motion of a part program on LinuxCNC.

    Raises
    ------
    InputError
        If the program has splines or moves other axes than X Y Z.
    """
    moves = linuxcnc_moves(program, settings.max_velocity, settings.max_acceleration)
    begins = np.flatnonzero(moves.waits)
    machine = settings.machine
    queues = [_run(machine, np.ascontiguousarray(moves.rows[first:last])) for first, last in pairwise(begins.tolist())]
    return _motion(moves, queues, settings.period)


def _run(machine: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Segments (m, size) and pieces (k, 9) of moves that are in the queue together."""
    sizes = np.zeros(3, dtype=np.int64)
    core.linuxcnc_sizes(sizes)
    segments = np.zeros((2 * len(rows), sizes[2]))
    segments = segments[: core.linuxcnc_queue(machine, len(rows), rows, segments)]
    state, found = np.zeros(4), []
    while not state[2]:
        pieces = np.empty((_PIECES, _WAY + 3))
        found.append(pieces[: core.linuxcnc_run(machine, len(segments), segments, state, _PIECES, pieces)].copy())
    return segments, np.concatenate(found)


def _motion(moves: LinuxcncMoves, queues: list[tuple[FloatArray, FloatArray]], period: float) -> ControllerMotion:
    """The pieces of all queues, one after the other, on the legs that they are on."""
    count = np.cumsum([0, *(len(segments) for segments, _ in queues)])
    segments = np.concatenate([segments for segments, _ in queues])
    parts = []
    for k, (own, pieces) in enumerate(queues):
        leg = pieces[:, _LEG]
        pieces[:, _LEG] = np.where(leg >= 0.0, leg + 2 * count[k], leg - count[k])
        rest = np.array(
            [[0.0, 2.0 * (count[k] + len(own)) - 1.0, 0.0, 0.0, 0.0, SETTLING_PERIODS * period, 0.0, 0.0, 0.0]]
        )
        parts += [pieces, rest]
    pieces = np.concatenate(parts)
    begin, way = _runs(pieces)
    first = np.flatnonzero(begin)
    of = np.cumsum(begin) - 1
    length = np.asarray(np.bincount(of, way, first.size), dtype=np.float64)
    legs = _legs(segments, pieces[first], length, moves.rows[0, :3])
    segment = np.where(pieces[first, _LEG] >= 0.0, pieces[first, _LEG] // 2, -1.0 - pieces[first, _LEG]).astype(np.intp)
    move = segments[segment, _MOVE].astype(np.intp)
    straight = (pieces[first, _LEG] % 2 == 0.0) | (segments[segment, _KIND] == _LINE)
    whole = straight & (pieces[first, _LEG] >= 0.0)
    motion = ControllerMotion(
        controller=LINUXCNC,
        axes=STRAIGHT_AXES,
        legs=legs,
        length=length,
        line=moves.line[move],
        start=np.concatenate([[0.0], np.cumsum(pieces[:, _SECONDS])]),
        leg=of,
        x=np.concatenate([[0.0], np.cumsum(way)[:-1]]) - (np.cumsum(length) - length)[of],
        speed=pieces[:, _SPEED].copy(),
        acceleration=pieces[:, _RATE].copy(),
    )
    return _by_lines(motion, moves, np.flatnonzero(whole), move[whole])


def _by_lines(motion: ControllerMotion, moves: LinuxcncMoves, leg: IntArray, move: IntArray) -> ControllerMotion:
    """Cut the legs (n,) that are merged lines of the moves (n,) where the lines of the program end."""
    inner = np.flatnonzero(moves.of[1:] == moves.of[:-1])
    row = np.searchsorted(move, moves.of[inner])
    known = (row < move.size) & (move[np.minimum(row, move.size - 1)] == moves.of[inner]) if move.size else row < 0
    inner, on = inner[known], leg[row[known]]
    o, g = motion.legs.vectors[on, 0], motion.legs.vectors[on, 3]
    along = np.sum((moves.part_end[inner] - o) * g, axis=1)
    inside = (along > _NO_LENGTH) & (along < motion.length[on] * (1.0 - 1e-9))
    if not inside.any():
        return motion
    on, edges = on[inside], np.concatenate([[0.0], np.cumsum(motion.length)])
    # the ends of the lines in their order, also where they go back within the tolerance
    cut = np.sort(edges[on] + along[inside])
    return cut_legs(motion, on, cut - edges[on], moves.part_line[inner][inside])


def _runs(pieces: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Which pieces begin a leg, (k,), and the way of each along it, mm; what does not move stays on the leg before."""
    way = pieces[:, _SECONDS] * (pieces[:, _SPEED] + 0.5 * pieces[:, _SECONDS] * pieces[:, _RATE])
    way = np.where(way > _NO_LENGTH, way, 0.0)
    moving = np.flatnonzero(way > 0.0)
    leg = pieces[moving, _LEG]
    begin = np.zeros(way.size, dtype=np.bool_)
    begin[moving] = np.append(True, (leg[1:] != leg[:-1]) | (leg[1:] < 0.0))
    if moving[0]:
        begin[moving[0]], begin[0] = False, True
    return begin, way


def _legs(segments: FloatArray, first: FloatArray, length: FloatArray, start: FloatArray) -> Legs:
    """Legs of the runs that begin with these pieces, (n, 9)."""
    leg = first[:, _LEG]
    both = leg < 0.0
    row = np.where(both, 0.0, leg // 2).astype(np.intp)
    s = segments[row]
    vectors, rates = np.zeros((leg.size, 4, 3)), np.zeros((leg.size, 2))
    on_lead = ~both & (leg % 2 == 0.0)
    straight = s[:, _KIND] == _LINE
    vectors[:, 0] = s[:, _ORIGIN]
    bent = np.flatnonzero(~both & ~on_lead & ~straight)
    vectors[bent, 1], vectors[bent, 2] = s[bent, _SPOKE], s[bent, _ACROSS]
    along = s[bent, _LENGTH] - s[bent, _LEAD]
    vectors[bent, 3] = s[bent, _HELIX] / along[:, None]
    rates[bent, 0] = s[bent, _ANGLE] / along
    rates[bent, 1] = s[bent, _SPIRAL] / (s[bent, _RADIUS] * along)
    vectors[on_lead, 0] += s[on_lead, _SPOKE] - s[on_lead, _LEAD, None] * s[on_lead, _ALONG]
    straight |= on_lead
    vectors[straight, 3] = s[straight, _ALONG]
    legs = Legs(vectors, rates).from_point(np.where(both, 0.0, first[:, _FROM]), backwards=False)
    _place_chords(legs.vectors, np.flatnonzero(both), first[:, _WAY:], legs.at(np.arange(leg.size), length)[0], start)
    return legs


def _place_chords(vectors: FloatArray, chords: IntArray, way: FloatArray, end: FloatArray, start: FloatArray) -> None:
    """Put chords where the leg before them ends: o and g of vectors (n, 4, 3); ends of the others (n, 3)."""
    if not chords.size:
        return
    ahead = np.cumsum(way[chords], axis=0) - way[chords]
    begins = np.append(True, np.diff(chords) > 1)
    group = np.cumsum(begins) - 1
    before = chords[begins] - 1
    base = np.where(before[:, None] >= 0, end[before], start)
    vectors[chords, 0] = base[group] + ahead - ahead[begins][group]
    vectors[chords, 3] = way[chords] / np.sqrt(np.sum(way[chords] ** 2, axis=1))[:, None]
