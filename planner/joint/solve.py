"""Path and feed as one problem: the fastest motion that stays within the tolerance of every block of a run.

The motion q(t) is sought directly, as a function of time.  Block k is cut into *phases*, whose durations T are free, and these
into segments of a given share w of the phase, on each of which the jerk j is constant.  With h = w T,

    p+ = p + h v + h^2/2 a + h^3/6 j,    v+ = v + h a + h^2/2 j,    a+ = a + h j,    T+ = T.

    minimise    sum of the T
    so that     |j_k| <= J_k,  |a_k| <= A_k,  |a| <= bend                           (exact: a is linear on a segment)
                |v| <= F,  |v_k| <= V_k,  dist(p, block) <= e                        at the nodes, 1/3 and 2/3 of each segment
                |p - vertex| <= e                                                  at the node where a block ends
                p, v, a given at the start, rest at the end.

dist is the distance from the block with its ends, so that the set is a stadium about a line: one convex row in any number of
axes.  It bounds how far the motion is from the blocks; with the discs at the vertices also how far the blocks are from it.

The method is a primal-dual interior point one: slacks s and multipliers z with g + s = 0 and z s = mu; mu falls with the
progress made.  A Newton step is one Riccati sweep over the segments (joint_sweep.c), so that an iteration costs time linear in
their number.  Durations times state make the dynamics bilinear; second derivatives are taken in full where the system stays
positive definite, else in part or not at all.  The start is the exact-stop motion, slowed by a tenth: it is strictly within all
limits.  The last state is held by multipliers and a weight.

Within the solver times are counted in units of a fifth of A / J or so, and lengths in what the jerk moves in a unit of time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.compiled import core
from planner.errors import SolverError
from planner.joint.joint_run import JointMotion, JointRun
from planner.joint.straight import along, seven_phases
from planner.types import BoolArray, FloatArray, IntArray

_GAP = 3e-5  # of the time
_SLOWED = 1.05
_MOST_ITERATIONS = 300
_FIRST, _AGAIN = 3e-2, 3e-3  # product of slacks and multipliers at a start
_PER_ZONE, _PER_MIDDLE = 10, 4  # segments of a phase beside a vertex, and between
_GROWTH = 1.15  # of the width from segment to segment, away from a vertex
_ZONE = 5.0  # length of a phase beside a vertex, of (e / J)^(1/3)
_OPEN = 30.0  # largest defect on the way, of the tolerance
_FOLLOWED = 50.0  # fourth power of the widest segment along an arc, of e r^3 / v^4
_MOST_PASSES = 10
_BETWEEN = 16  # parts of a segment at which it is measured
_MARGIN = 1e-5  # of the tolerance: what closing the last defects moves is less
_AIM = 0.998  # at what was beyond the tolerance or the feed; the more so from pass to pass
_MOST_SPEED = 1e-5  # relative excess of the feed for which all is slowed
_SHORTEST = 0.02  # time of a phase, in units
_WHY = {1: "after {} iterations it had not converged", 2: "its system became singular after {} iterations"}


@dataclass
class _Mesh:
    """Stages (m,), the switch to each phase and its segments, and a motion; in mm and s, with durations for their cubes."""

    switches: BoolArray
    share: FloatArray
    leg: IntArray
    x: FloatArray  # (m + 1, 3d + 1): position, velocity, acceleration, duration
    u: FloatArray  # (m, d): jerk, or the next duration


def solve_run(run: JointRun) -> JointMotion:
    """Find the fastest motion of a run.

    Raises
    ------
    SolverError
        Where the method does not converge, or a leg is of a kind that it does not treat.
    """
    if run.legs.ways is not None and (run.legs.ways[:, 0] >= 0.0).any():
        raise SolverError("path and feed together: the run has splines, for which it is not solved")
    if run.lengths.size == 1 and not run.legs.curved[0]:
        return _straight(run)
    mesh = _begin(run)
    return _motion(run, mesh, *_iterate(run, mesh))


def _limits_along(run: JointRun, leg: int) -> tuple[float, float, float]:
    """Limits of velocity, acceleration and jerk along a line."""
    share = np.abs(run.legs.vectors[leg, 3])
    with np.errstate(divide="ignore"):
        velocity, acceleration, jerk = ((limit / share).min() for limit in (run.velocity, run.acceleration, run.jerk))
    return min(velocity, run.feed[leg]), min(acceleration, run.bend), jerk


def _straight(run: JointRun) -> JointMotion:
    """The motion along a single line, in closed form."""
    durations, jerks = seven_phases(run.lengths[0], *_limits_along(run, 0))
    kept = durations > 0.0
    durations, jerks = durations[kept], jerks[kept]
    t = np.concatenate([[0.0], np.cumsum(durations)])
    s, v, a, _ = along(durations, jerks, t)[..., None]
    direction = run.legs.vectors[0, 3]
    s[-1], v[-1], a[-1] = run.lengths[0], 0.0, 0.0
    leg = np.zeros(jerks.size, dtype=np.int64)
    return JointMotion(t, run.starts[0] + s * direction, v * direction, a * direction, jerks[:, None] * direction, leg)


def _begin(run: JointRun) -> _Mesh:
    """The exact-stop motion, slowed; phases beside each vertex are as long as swinging within the tolerance takes."""
    d = run.dim
    switches, share, leg, x, u = [], [], [], [], []
    last = 0.0
    for k in range(run.lengths.size):
        phases, (p, v, a), jerk, slower = (_along_bend if run.legs.curved[k] else _along_line)(run, k)
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
    return _Mesh(np.array(switches), np.array(share), np.array(leg), np.vstack([*x, end]), np.concatenate(u))


_Phases = list[tuple[float, FloatArray]]


def _along_line(run: JointRun, leg: int) -> tuple[_Phases, FloatArray, FloatArray, float]:
    """Phases of the exact-stop motion along a line, states (3, n + 1, d) and jerks (n, d) slowed, and the factor in time."""
    length, direction = run.lengths[leg], run.legs.vectors[leg, 3]
    durations, jerks = seven_phases(length, *_limits_along(run, leg))
    phases = _phases(run, leg, durations.sum(), 3)
    width = np.concatenate([time * shares for time, shares in phases])
    state, jerk, slower = _averaged(durations, jerks, width, length)
    states = state[..., None] * direction
    states[0] += run.starts[leg]
    return phases, states, jerk[:, None] * direction, slower


def _along_bend(run: JointRun, leg: int) -> tuple[_Phases, FloatArray, FloatArray, float]:
    """The same along an arc: a spline through points of a motion that keeps the limits nearly, slowed until it does."""
    length, row = run.lengths[leg], np.array([leg])
    x = np.linspace(0.0, length, 33)
    _, first, second, third = np.abs(run.legs.at(np.repeat(row, x.size), x)).max(axis=1)
    with np.errstate(divide="ignore"):
        speed = min(
            run.feed[leg],
            (run.velocity / first).min(),
            np.sqrt(0.6 * np.minimum(run.acceleration, run.bend) / second).min(),
            np.cbrt(0.5 * run.jerk / third).min(),
        )
        acceleration = 0.6 * (np.minimum(run.acceleration, run.bend) / first).min()
        durations, jerks = seven_phases(length, speed, acceleration, 0.4 * (run.jerk / first).min())
    total = durations.sum()
    finest = (_FOLLOWED * run.tolerance[leg] * run.legs.radius(row)[0] ** 3 / speed**4) ** 0.25
    finest = min(finest, 2.0 * _zone(run, leg) / _PER_ZONE)
    phases = _phases(run, leg, total, max(3, int(np.ceil(total / (_PER_MIDDLE * finest)))))
    width = np.concatenate([time * shares for time, shares in phases])
    s = along(durations, jerks, np.concatenate([[0.0], np.cumsum(width)]))[0]
    s[-1] = length
    p = run.legs.at(np.repeat(row, s.size), s)[0]
    v, a = _spline(p, width)
    jerk = np.diff(a, axis=0) / width[:, None]
    used = [np.abs(new / limit).max() for new, limit in ((a, run.acceleration), (jerk, run.jerk), (v, run.velocity))]
    fast = max(used[2], np.sqrt((v**2).sum(axis=1)).max() / run.feed[leg])
    bent = np.sqrt((a**2).sum(axis=1)).max() / run.bend
    slower = max(1.0, fast / 0.95, (max(used[0], bent) / 0.9) ** 0.5, (used[1] / 0.85) ** (1.0 / 3.0))
    a[[0, -1]] = 0.0
    return phases, np.stack([p, v / slower, a / slower**2]), jerk / slower**3, slower


def _spline(p: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speeds and accelerations (n, d) of the cubic spline through points p at distances width (n - 1) in time, at rest at its ends."""
    n = p.shape[0]
    slope = np.diff(p, axis=0) / width[:, None]
    matrix, right = np.eye(n), np.zeros_like(p)
    i = np.arange(1, n - 1)
    matrix[i, i - 1], matrix[i, i], matrix[i, i + 1] = width[1:], 2.0 * (width[1:] + width[:-1]), width[:-1]
    right[1:-1] = 3.0 * (width[1:, None] * slope[:-1] + width[:-1, None] * slope[1:])
    v = np.linalg.solve(matrix, right)
    a = np.empty_like(p)
    a[:-1] = (6.0 * slope - 4.0 * v[:-1] - 2.0 * v[1:]) / width[:, None]
    a[-1] = (2.0 * v[-2] + 4.0 * v[-1] - 6.0 * slope[-1]) / width[-1]
    return v, a


def _zone(run: JointRun, leg: int) -> float:
    """Time beside a vertex in which swinging within the tolerance is worth it."""
    return float(_ZONE * np.cbrt(run.tolerance[leg] / run.jerk.max()))


def _phases(run: JointRun, leg: int, total: float, inner: int) -> list[tuple[float, FloatArray]]:
    """Times of the phases of a leg that takes so long, and the shares of their segments: short ones beside the vertices."""
    zone = _zone(run, leg)
    growing = _GROWTH ** np.arange(_PER_ZONE)
    growing /= growing.sum()
    if total < 0.3 * zone:
        return [(total, np.full(_PER_ZONE, 1.0 / _PER_ZONE))]
    if total < 2.5 * zone and inner <= 3:
        return [(0.5 * total, growing), (0.5 * total, growing[::-1])]
    middle = (total - 2.0 * zone) / inner
    return [(zone, growing), *[(middle, np.full(_PER_MIDDLE, 1.0 / _PER_MIDDLE))] * inner, (zone, growing[::-1])]


def _averaged(
    durations: FloatArray, jerks: FloatArray, width: FloatArray, length: float
) -> tuple[FloatArray, FloatArray, float]:
    """Jerks (n,) constant on segments of those widths that come near those of the phases and end alike; states (3, n + 1).

    All is slowed until it is strictly inside what the phases use; the third is the factor in time.
    """
    t = np.concatenate([[0.0], np.cumsum(width)])
    _, speed, acceleration, _ = along(durations, jerks, t)
    jerk = np.diff(acceleration) / width
    state, jerk = _arriving(np.zeros((3, 1)), jerk[:, None], width, np.array([[length], [0.0], [0.0]]))
    state, jerk = state[..., 0], jerk[:, 0]
    used = [
        np.abs(new).max() / np.abs(old).max()
        for new, old in ((state[1], speed), (state[2], acceleration), (jerk, jerks))
    ]
    slower = max(_SLOWED, used[0] / 0.95, (used[1] / 0.9) ** 0.5, (used[2] / 0.85) ** (1.0 / 3.0))
    return state / slower ** np.arange(3.0)[:, None], jerk / slower**3, slower


def _arriving(
    start: FloatArray, jerk: FloatArray, width: FloatArray, end: FloatArray, first: int = 0
) -> tuple[FloatArray, FloatArray]:
    """States (3, n + 1, d) of jerks (n, d) on segments of those widths, changed least, from ``first`` on, so that they end at ``end`` (3, d)."""
    state = _rolled(start, jerk, width)
    for _ in range(2):  # again for what rounding leaves
        left = width[first:].sum() - np.concatenate([[0.0], np.cumsum(width[first:])])
        # what each jerk adds to position, speed and acceleration at the end
        added = np.array([-np.diff(left**k) / c for k, c in ((3, 6.0), (2, 2.0), (1, 1.0))])
        unit = np.sqrt((added**2 / width[first:]).sum(axis=1))
        root = added / unit[:, None] / np.sqrt(width[first:])
        change = np.linalg.lstsq(root, (end - state[:, -1]) / unit[:, None], rcond=None)[0]
        jerk = jerk.copy()
        jerk[first:] += change / np.sqrt(width[first:, None])
        state = _rolled(start, jerk, width)
    state[:, -1] = end
    return state, jerk


def _rolled(start: FloatArray, jerk: FloatArray, width: FloatArray) -> FloatArray:
    """Position, speed and acceleration (3, n + 1, d) at the ends of segments with those jerks (n, d)."""
    h = width[:, None]
    state = np.empty((3, width.size + 1, jerk.shape[1]))
    state[:, 0] = start
    a = state[2]
    a[1:] = a[0] + np.cumsum(h * jerk, axis=0)
    v = state[1]
    v[1:] = v[0] + np.cumsum(h * (a[:-1] + 0.5 * h * jerk), axis=0)
    state[0, 1:] = state[0, 0] + np.cumsum(h * (v[:-1] + h * (0.5 * a[:-1] + h * (jerk / 6.0))), axis=0)
    return state


def _units(run: JointRun) -> tuple[float, float]:
    """Units of time, s, and of length, mm."""
    jerk = run.jerk.max()
    acceleration = min(run.acceleration.max(), run.bend)
    time = 0.2 * acceleration / jerk if np.isfinite(acceleration) else np.cbrt(2.0 * np.median(run.tolerance) / jerk)
    return time, jerk * time**3


def _scaled(mesh: _Mesh, time: float, length: float, origin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States and controls as the solver has them."""
    d = mesh.u.shape[1]
    t = mesh.x[:, 3 * d :] / time
    x = np.column_stack([mesh.x[:, : 3 * d] / length, t**3])
    x[:, :d] -= origin / length
    x[:, d : 2 * d] *= time * t
    x[:, 2 * d : 3 * d] *= (time * t) ** 2
    u = mesh.u * (time * t[:-1]) ** 3 / length
    u[mesh.switches, 0] = (mesh.u[mesh.switches, 0] / time) ** 3
    return x, u


def _iterate(run: JointRun, mesh: _Mesh) -> tuple[FloatArray, FloatArray, int]:
    """Improve the motion on the mesh until it is optimal and inside: states and controls, and the number of iterations."""
    (time, length), d, m = _units(run), run.dim, mesh.leg.size
    origin, speed = run.starts[0], length / time
    x, u = _scaled(mesh, time, length, origin)
    vectors = run.legs.vectors / length
    vectors[:, 0] -= origin / length
    vectors[:, 3] *= length
    sizes = np.array([d, m, run.lengths.size])
    geometry = (mesh.leg, vectors, run.legs.rates * length, run.lengths / length)
    axes = np.array([speed / run.velocity, speed / time / run.acceleration, speed / time**2 / run.jerk])
    axes[0, run.velocity >= run.feed.max()] = 0.0
    scalars = np.array([(speed / time / run.bend) ** 2, _SHORTEST**3])
    target = np.concatenate([(run.ends[-1] - origin) / length, np.zeros(2 * d)])
    work, found, between = np.empty(core.joint_work(sizes)), np.empty(6), np.empty((m, 2))
    reach, pace = (np.repeat(limit[mesh.leg][:, None], 2, axis=1) for limit in (run.tolerance, run.feed))
    after = np.flatnonzero(np.diff(mesh.leg)) + 2  # the segments that begin at vertices
    reach *= 1.0 - _MARGIN
    for limit in (reach, pace):
        limit[after, 0] = np.minimum(limit[after, 0], limit[after - 2, 0])
    scale = np.cbrt(np.where(mesh.switches, np.maximum(x[1:, -1], x[:-1, -1]), x[:-1, -1]))
    count = 0
    for once in range(_MOST_PASSES):
        status = core.joint_solve(
            *(sizes, mesh.switches, mesh.share, scale, *geometry, (length / reach) ** 2, (speed / pace) ** 2, axes),
            *(scalars, target, _GAP, _AGAIN if once else _FIRST, _OPEN * run.tolerance.min() / length),
            *(_MOST_ITERATIONS, x, u, work, found),
        )
        count += int(found[5])
        if status:
            raise SolverError(f"path and feed together: {_WHY[int(status)].format(int(found[5]))}; found {found}")
        core.joint_between(sizes, mesh.switches, mesh.share, *geometry, x, u, _BETWEEN, between)
        excess = between * [length, speed] / np.column_stack([run.tolerance, run.feed])[mesh.leg]
        over = excess > [1.0, 1.0 + _MOST_SPEED]
        if not over.any():
            return x, u, count
        for limit, beyond, where in zip((reach, pace), excess.T, over.T, strict=True):
            limit[where] *= (_AIM ** (1 + once) / beyond[where])[:, None]
    raise SolverError(f"path and feed together: after {_MOST_PASSES} passes it exceeds {excess.max(axis=0)}")


def _motion(run: JointRun, mesh: _Mesh, x: FloatArray, u: FloatArray, iterations: int) -> JointMotion:
    """The motion with exactly those durations and, but for rounding, jerks: each state follows from the one before."""
    d = run.dim
    time, length = _units(run)
    on = np.flatnonzero(~mesh.switches)
    duration = np.cbrt(x[on, 3 * d]) * time
    width, leg = mesh.share[on] * duration, mesh.leg[on]
    start, end = np.zeros((3, d)), np.zeros((3, d))
    start[0], end[0] = run.starts[0], run.ends[-1]
    first = int(np.searchsorted(leg, leg[-1]))
    (p, v, a), jerk = _arriving(start, length * u[on] / duration[:, None] ** 3, width, end, first)
    return JointMotion(np.concatenate([[0.0], np.cumsum(width)]), p, v, a, jerk, leg, iterations)
