"""The motion that the joint solver starts from: every block by itself, from rest to rest, slowed until it is inside all.

A block is cut into phases, and these into segments of constant jerk.  Beside a vertex a phase is as long as swinging within
the tolerance takes, a few times (e / J)^(1/3), with segments that are the shorter the nearer they are to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.joint.constant_jerk import arriving, spline_through
from planner.joint.joint_run import JointRun
from planner.joint.straight import along, seven_phases
from planner.types import BoolArray, FloatArray, IntArray

_PER_ZONE, _PER_MIDDLE = 10, 4  # segments of a phase beside a vertex, and between
# The same of runs of at most so many blocks: 5e-4 faster in the mean, for half as much time again.
_FEW, _PER_ZONE_OF_FEW, _PER_MIDDLE_OF_FEW = 20, 16, 10
_GROWTH = 1.15  # of the width from segment to segment, away from a vertex
_ZONE = 5.0  # length of a phase beside a vertex, of (e / J)^(1/3)
_MIN_UNIT = 0.5  # of time, of (e / J)^(1/3)
_MAX_ON_ARC = (
    200  # segments of one time unit along an arc: at a very small feed there would be one for every few nanometres
)
_FOLLOWED = 50.0  # fourth power of the widest segment along an arc, of e r^3 / v^4
_Phases = list[tuple[float, FloatArray]]


@dataclass
class Mesh:
    """Stages (m,), the switch to each phase and its segments, and a motion; in mm and s, with durations for their cubes."""

    switches: BoolArray
    share: FloatArray
    leg: IntArray
    x: FloatArray  # (m + 1, 3d + 1): position, velocity, acceleration, duration
    u: FloatArray  # (m, d): jerk, or the next duration


def units_of(run: JointRun) -> tuple[float, float]:
    """Units of time, s, a fifth of what the first axis takes to its acceleration, and of length, mm.

    Where little acceleration is reached that is too short a time to count in: what swinging within the tolerance takes
    is not shorter then.
    """
    jerk, rise = run.jerk.max(), (run.acceleration / run.jerk).min()
    swing = np.cbrt(np.median(run.tolerance) / jerk)
    time = max(0.2 * rise, _MIN_UNIT * swing) if np.isfinite(rise) else np.cbrt(2.0) * swing
    return time, jerk * time**3


def limits_along(run: JointRun, leg: int) -> tuple[float, float, float]:
    """Limits of velocity, acceleration and jerk along a line."""
    share = np.abs(run.legs.vectors[leg, 3])
    with np.errstate(divide="ignore"):
        velocity, acceleration, jerk = ((limit / share).min() for limit in (run.velocity, run.acceleration, run.jerk))
    return min(velocity, run.feed[leg]), acceleration, jerk


def stopping_motion(run: JointRun, slowed: float) -> Mesh:
    """The exact-stop motion, slowed; phases beside each vertex are as long as swinging within the tolerance takes."""
    d = run.dim
    switches, share, leg, x, u = [], [], [], [], []
    last = 0.0
    for k in range(run.lengths.size):
        phases, (p, v, a), jerk, slower = (_along_bend if run.legs.curved[k] else _along_line)(run, k, slowed)
        at = 0
        for time, shares in phases:
            count = shares.size
            i = np.concatenate([[at], np.arange(at, at + count)])
            t = np.full(count + 1, time * slower)
            t[0] = last if last else t[1]
            control = jerk[i]
            control[0, 0] = last = t[1]
            x.append(np.column_stack([p[i], v[i], a[i], t]))
            u.append(control)
            switches += [True] + [False] * count
            share += [0.0, *shares]
            leg += [k] * (count + 1)
            at += count
    end = np.concatenate([run.ends[-1], np.zeros(2 * d), [last]])
    return Mesh(np.array(switches), np.array(share), np.array(leg), np.vstack([*x, end]), np.concatenate(u))


def _along_line(run: JointRun, leg: int, slowed: float) -> tuple[_Phases, FloatArray, FloatArray, float]:
    """Phases of the exact-stop motion along a line, states (3, n + 1, d) and jerks (n, d) slowed, and the factor in time."""
    length, direction = run.lengths[leg], run.legs.vectors[leg, 3]
    durations, jerks = seven_phases(length, *limits_along(run, leg))
    phases = _phases(run, leg, durations.sum(), 3)
    width = np.concatenate([time * shares for time, shares in phases])
    state, jerk, slower = _averaged(durations, jerks, width, length, slowed)
    states = state[..., None] * direction
    states[0] += run.starts[leg]
    return phases, states, jerk[:, None] * direction, slower


def _along_bend(run: JointRun, leg: int, slowed: float) -> tuple[_Phases, FloatArray, FloatArray, float]:
    """The same along an arc: a spline through points of a motion that keeps the limits nearly, slowed until it does."""
    length, row = run.lengths[leg], np.array([leg])
    x = np.linspace(0.0, length, 33)
    _, first, second, third = np.abs(run.legs.at(np.repeat(row, x.size), x)).max(axis=1)
    with np.errstate(divide="ignore"):
        speed = min(
            run.feed[leg],
            (run.velocity / first).min(),
            np.sqrt(0.6 * run.acceleration / second).min(),
            np.cbrt(0.5 * run.jerk / third).min(),
        )
        acceleration = 0.6 * (run.acceleration / first).min()
        durations, jerks = seven_phases(length, speed, acceleration, 0.4 * (run.jerk / first).min())
    total = durations.sum()
    finest = (_FOLLOWED * run.tolerance[leg] * run.legs.radius(row)[0] ** 3 / speed**4) ** 0.25
    finest = min(finest, max(units_of(run)[0], total / _MAX_ON_ARC))
    phases = _phases(run, leg, total, max(3, int(np.ceil(total / (_counts(run)[1] * finest)))))
    width = np.concatenate([time * shares for time, shares in phases])
    s = along(durations, jerks, np.concatenate([[0.0], np.cumsum(width)]))[0]
    s[-1] = length
    p = run.legs.at(np.repeat(row, s.size), s)[0]
    v, a = spline_through(p, width)
    jerk = np.diff(a, axis=0) / width[:, None]
    used = [np.abs(new / limit).max() for new, limit in ((a, run.acceleration), (jerk, run.jerk), (v, run.velocity))]
    fast = max(used[2], np.sqrt((v**2).sum(axis=1)).max() / run.feed[leg])
    slower = max(slowed, fast / 0.95, (used[0] / 0.9) ** 0.5, (used[1] / 0.85) ** (1.0 / 3.0))
    a[[0, -1]] = 0.0
    return phases, np.stack([p, v / slower, a / slower**2]), jerk / slower**3, slower


def _zone(run: JointRun, leg: int) -> float:
    """Time beside a vertex in which swinging within the tolerance is worth it."""
    return float(_ZONE * np.cbrt(run.tolerance[leg] / run.jerk.max()))


def _phases(run: JointRun, leg: int, total: float, inner: int) -> list[tuple[float, FloatArray]]:
    """Times of the phases of a leg that takes so long, and the shares of their segments: short ones beside the vertices."""
    zone = _zone(run, leg)
    beside, between = _counts(run)
    growing: FloatArray = _GROWTH ** np.arange(float(beside))
    growing = growing / growing.sum()
    if total < 0.3 * zone:
        return [(total, np.full(beside, 1.0 / beside))]
    if total < 2.5 * zone and inner <= 3:
        return [(0.5 * total, growing), (0.5 * total, growing[::-1])]
    middle = (total - 2.0 * zone) / inner
    return [(zone, growing), *[(middle, np.full(between, 1.0 / between))] * inner, (zone, growing[::-1])]


def _counts(run: JointRun) -> tuple[int, int]:
    """Segments of a phase beside a vertex, and between."""
    few = run.lengths.size <= _FEW
    return (_PER_ZONE_OF_FEW, _PER_MIDDLE_OF_FEW) if few else (_PER_ZONE, _PER_MIDDLE)


def _averaged(
    durations: FloatArray, jerks: FloatArray, width: FloatArray, length: float, slowed: float
) -> tuple[FloatArray, FloatArray, float]:
    """Jerks (n,) constant on segments of those widths that come near those of the phases and end alike; states (3, n + 1).

    All is slowed until it is strictly inside what the phases use; the third is the factor in time.
    """
    t = np.concatenate([[0.0], np.cumsum(width)])
    _, speed, acceleration, _ = along(durations, jerks, t)
    jerk = np.diff(acceleration) / width
    state, jerk = arriving(np.zeros((3, 1)), jerk[:, None], width, np.array([[length], [0.0], [0.0]]))
    state, jerk = state[..., 0], jerk[:, 0]
    used = [
        np.abs(new).max() / np.abs(old).max()
        for new, old in ((state[1], speed), (state[2], acceleration), (jerk, jerks))
    ]
    slower = max(slowed, used[0] / 0.95, (used[1] / 0.9) ** 0.5, (used[2] / 0.85) ** (1.0 / 3.0))
    return state / slower ** np.arange(3.0)[:, None], jerk / slower**3, slower
