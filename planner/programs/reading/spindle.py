"""Feeds that the spindle gives: a way for each of its turns, under G95 and in threads.

With the pitch p of a move in mm a turn and the time T of a turn, the feed is p / T.  Under G97 T = 60 s / S.  Under G96
the cutting speed S, in m/min or under G20 in feet/min, is constant, and the spindle turns the slower the farther X is
from the axis,

    T = 60 s max(1 / D, 2 pi |x| / S);

of a move its mean along the move counts, with which the move takes the time that it takes.  x counts from the origin of
the program.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.programs.reading.blocks import Blocks
from planner.programs.reading.language import CHANGE, MOTION, SPEED_MODE, SPINDLE, TAP, THREAD, THREADING
from planner.programs.reading.modal import ReadingState, carry_forward
from planner.programs.reading.words import LineArray, Mask
from planner.types import FloatArray

_METRE_MM, _FOOT_MM = 1000.0, 304.8
_CHORDS = 64  # of an arc, along which x is taken as linear
_TOOL_CHANGE = 6


@dataclass(frozen=True, eq=False)
class BlockSpindle:
    """The spindle at every block: S, under G96 in mm a minute; the largest speed, turns a minute; whether it is G96."""

    speed: FloatArray
    bound: FloatArray
    surface: Mask


def carry_spindle(
    blocks: Blocks, modal: dict[int, LineArray], unit: FloatArray, kind: LineArray, state: ReadingState
) -> BlockSpindle:
    """Speeds at every block; refuse threads where the spindle stands, and what does not belong beside them."""
    s, d, mode, switch = blocks.letters["S"], blocks.letters["D"], blocks.g[SPEED_MODE], blocks.m[SPINDLE]
    surface = modal[SPEED_MODE] == 960
    speed = np.asarray(carry_forward(s.given, s.value, state.spindle))
    largest = np.where(d.given & (d.value > 0.0), d.value, np.inf)
    bound = np.asarray(carry_forward(mode.given, largest, state.speed_bound))
    named = switch.has(3, 4, 5)
    turning = np.asarray(
        carry_forward(named | blocks.m[CHANGE].has(_TOOL_CHANGE), named & (switch.value != 5), state.turning),
        dtype=np.bool_,
    )
    state.speed_bound, state.turning = float(bound[-1]), bool(turning[-1])
    blocks.faults.add(mode.at(mode.has(960) & ~s.given), "needs the cutting speed S beside it")
    motion = modal[MOTION]
    threads = (kind >= 0) & ((motion == THREAD) | (motion == TAP) | (motion == THREADING))
    if threads.any():
        _check_threads(blocks, threads, threads & (motion != THREADING), turning)
    scale = np.where(surface, np.where(unit == 1.0, _METRE_MM, _FOOT_MM), 1.0)
    return BlockSpindle(speed * scale, bound, surface)


def _check_threads(blocks: Blocks, threads: Mask, by_pitch: Mask, turning: Mask) -> None:
    faults, k, motion = blocks.faults, blocks.letters["K"], blocks.g[MOTION]
    place = np.where(motion.given, motion.word, blocks.first)
    faults.add(place[threads & ~turning], "the spindle does not turn; write M3 or M4, and S, before the thread")
    faults.add(place[by_pitch & ~k.given], "needs the pitch K beside it")
    faults.add(k.at(by_pitch & (k.value == 0.0)), "the pitch of a thread must not be 0")
    faults.add(blocks.letters["F"].at(by_pitch), "the feed of a thread is that of the spindle")


def seconds_a_turn(spindle: BlockSpindle, rows: LineArray, x: FloatArray) -> FloatArray:
    """Mean time of a turn along moves, (m,), s.

    ``x`` (m, k) is the distance from the axis at k places of the move, as far from each other, mm; between them it is
    linear.
    """
    surface = spindle.surface[rows][:, None]
    least = 1.0 / np.minimum(np.where(surface[:, 0], np.inf, spindle.speed[rows]), spindle.bound[rows])[:, None]
    slope = np.where(surface, 2.0 * np.pi / spindle.speed[rows][:, None], 0.0)
    time = np.maximum(least, slope * np.abs(x))
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = 0.5 * (least**2 / slope + slope * x**2)
    up_to = np.copysign(
        np.where(slope * np.abs(x) > least, beyond, least * np.abs(x)), x
    )  # integral of the time from 0
    step = np.diff(x, axis=1)
    same = np.abs(step) <= 1e-9 * np.abs(x[:, 1:])
    mean = np.where(same, time[:, 1:], np.diff(up_to, axis=1) / np.where(same, 1.0, step))
    return np.asarray(60.0 * mean.mean(axis=1))


def x_along(
    start: FloatArray, end: FloatArray, arcs: LineArray, arc: tuple[FloatArray, NDArray[np.uint8], FloatArray]
) -> FloatArray:
    """X at places along moves, (m, 65), mm; ``arc`` has the centres, normals and sweeps of the moves that are arcs."""
    share = np.linspace(0.0, 1.0, _CHORDS + 1)
    out = start[:, :1] + share * (end - start)[:, :1]
    centre, normal, sweep = arc
    for k, place in enumerate(arcs.tolist()):
        if normal[k] == 0:
            continue  # in G19 X is along the normal, and linear
        i, j = (normal[k] + 1) % 3, (normal[k] + 2) % 3
        spoke = (start[place, i] - centre[k, i]) + 1j * (start[place, j] - centre[k, j])
        turned = spoke * np.exp(1j * sweep[k] * share)
        out[place] = centre[k, 0] + (turned.real if i == 0 else turned.imag)
    return out
