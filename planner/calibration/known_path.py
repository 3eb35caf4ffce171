"""A log beside the program it is of: whether it is that program's, in what units, and what feed was asked for where.

A controller logs positions of the machine and a program has those of the work: a log may stand beside the program by one
vector, which is that between the middles of the two boxes around them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from planner.calibration.log import TIMES, Log
from planner.calibration.stretches import SteadyStretch
from planner.errors import InputError
from planner.geometry.curve import AXES, DEGREES, ROTARY_AXES
from planner.machine.machine_toml import LENGTHS
from planner.programs.reading.move_legs import legs_of_moves
from planner.programs.reading.program import Program
from planner.types import FloatArray, IntArray

_POINTS = 20_000  # along a program
_NEAR = 0.02  # of the size of the program, by which rounded corners may leave it
_MOST = 0.95  # of the samples that must lie so near
_UNIT = 0.1  # by how much a ratio of sizes may differ from that of two units
_LOOKED_AT = 5_000  # samples
_SLOW, _FAST = 50.0, 0.2  # of the shortest time its feeds allow: no program takes so long, none so short
_FACTORS = (60, 1000, 1_000_000)  # between units of time


@dataclass(frozen=True, eq=False)
class KnownPath:
    """Points along a program and what it asks for there.

    Attributes
    ----------
    program : Program
    points : (n, d) array
        In the axes of the log, mm and rad, where the log has them.
    move : (n,) int array
        Move of the program each is on.
    shift : (d,) array
        From the program to the log.
    """

    program: Program
    points: FloatArray
    move: IntArray
    shift: FloatArray

    def feeds(self, log: Log, stretches: list[SteadyStretch]) -> FloatArray:
        """Feed that the program asks for at the middle of stretches, mm/s; inf in rapids."""
        middle = np.array([(s.first + s.last) // 2 for s in stretches], dtype=np.intp)
        _, near = cKDTree(self.points).query(log.position[middle])
        return self.program.feed[self.move[near]]


def known_path(log: Log, program: Program) -> KnownPath:
    """Lay a program beside its log.

    Raises
    ------
    InputError
        If the log is in other units than it says, or is not of this program.
    """
    points, move = _points(program, log.axes)
    if points.shape[0] == 0:
        raise InputError(
            f"{log.where}: {program.source} moves none of the axes {' '.join(log.axes)}; it is another program's log"
        )
    box, own = (np.array([p.min(axis=0), p.max(axis=0)]) for p in (points, log.position))
    size, seen = np.ptp(box, axis=0), np.ptp(own, axis=0)
    _require_lengths(log, program, size, seen)
    _require_times(log, program)
    allowed = _NEAR * float(np.linalg.norm(size))
    worst = np.inf
    for shift in (np.zeros(len(log.axes)), own.mean(axis=0) - box.mean(axis=0)):
        rows = np.linspace(0, log.t.size - 1, min(log.t.size, _LOOKED_AT)).astype(np.intp)
        away, _ = cKDTree(points + shift).query(log.position[rows])
        off = float(np.quantile(away, _MOST))
        if off <= allowed:
            return KnownPath(program, points + shift, move, shift)
        worst = min(worst, off)
    raise InputError(
        f"{log.where}: is not a log of {program.source}: positions leave its path by {worst:.4g} mm, {allowed:.4g} mm are "
        "allowed for corners; put the program that was logged beside it, under the log's name, or none"
    )


def _points(program: Program, axes: tuple[str, ...]) -> tuple[FloatArray, IntArray]:
    """Points along every move, evenly."""
    moves = np.isin(AXES, axes)
    rows = np.flatnonzero(program.lengths > 0.0)
    rows = rows[
        np.any(program.start[rows][:, moves] != program.end[rows][:, moves], axis=1) | (program.sweep[rows] != 0.0)
    ]
    if rows.size == 0:
        return np.empty((0, len(axes))), rows
    legs, length = legs_of_moves(program, rows, moves)
    step = max(float(length.sum()) / _POINTS, 1e-9)
    count = np.ceil(length / step).astype(np.intp) + 1
    leg = np.repeat(np.arange(rows.size), count)
    place = np.concatenate([np.linspace(0.0, 1.0, n) for n in count]) * length[leg]
    turns = [1.0 / DEGREES if axis in ROTARY_AXES else 1.0 for axis in AXES if axis in axes]
    return legs.at(leg, place)[0] * turns, rows[leg]


def _require_lengths(log: Log, program: Program, size: FloatArray, seen: FloatArray) -> None:
    """Refuse a log whose path is that of the program, but in another unit."""
    both = (size > 0.0) & (seen > 0.0)
    if not both.any():
        return
    ratio = seen[both] / size[both]
    mean = float(np.exp(np.log(ratio).mean()))
    if ratio.max() / ratio.min() > (1.0 + _UNIT) ** 2 or abs(mean - 1.0) < _UNIT:
        return
    for said, factor in LENGTHS["mm"].items():
        for meant, true in LENGTHS["mm"].items():
            if said != meant and abs(mean / (factor / true) - 1.0) < _UNIT:
                raise InputError(
                    f"{log.where}: positions are {mean:.4g} times those of {program.source}, as if {meant} were called "
                    f"{said}; name the columns {log.axes[0]}_{meant} ..."
                )


def _require_times(log: Log, program: Program) -> None:
    """Refuse a log that takes so much longer or shorter than the feeds say that its unit of time must be wrong."""
    finite = np.isfinite(program.feed) & (program.feed > 0.0)
    least = float(np.sum(program.lengths[finite] / program.feed[finite]))
    rests = sum(event.seconds for event in program.events)
    took = float(log.t[-1] - log.t[0])
    ratio = took / max(least + rests, 1e-9)
    if _FAST < ratio < _SLOW or least == 0.0:
        return
    size, way = (ratio, "long") if ratio > 1.0 else (1.0 / ratio, "short")
    factor = min(_FACTORS, key=lambda f: abs(float(np.log(size / f))))
    raise InputError(
        f"{log.where}: takes {took:.6g} s, where the feeds of {program.source} ask for {least:.6g} s or more: about "
        f"{factor} times too {way}; name the column of time by its unit, t_{' t_'.join(TIMES)}"
    )
