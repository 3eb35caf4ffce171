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

_GAP = 1e-5  # of the time
_SLOWED = 1.1
_MOST_ITERATIONS = 300
_FIRST, _AGAIN = 1e-2, 3e-3  # product of slacks and multipliers at a start
_PER_ZONE, _PER_MIDDLE = 8, 4  # segments of a phase beside a vertex, and between
_ZONE = 5.0  # length of a phase beside a vertex, of (e / J)^(1/3)
_SHORTEST = 0.02  # time of a phase, in units
_WHY = {1: "after {} iterations it had not converged", 2: "its system became singular after {} iterations"}


@dataclass
class _Mesh:
    """Segments (m,) and a motion at their nodes; in mm and s."""

    begins: BoolArray
    share: FloatArray
    leg: IntArray
    x: FloatArray  # (m + 1, 3d + 1)
    u: FloatArray  # (m, d + 1)


def solve_run(run: JointRun) -> JointMotion:
    """Find the fastest motion of a run.

    Raises
    ------
    SolverError
        Where the method does not converge, or a leg is of a kind that it does not treat.
    """
    if run.legs.curved.any():
        raise SolverError("the joint problem is not solved for curved legs")
    if run.lengths.size == 1:
        return _straight(run)
    mesh = _begin(run)
    found = _iterate(run, mesh)
    return _motion(mesh, found)


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
    return JointMotion(
        t, run.starts[0] + s * direction, v * direction, a * direction, jerks[:, None] * direction, leg
    )


def _begin(run: JointRun) -> _Mesh:
    """The exact-stop motion, slowed; phases beside each vertex are as long as swinging within the tolerance takes."""
    begins, share, leg, x, u = [], [], [], [], []
    for k, length in enumerate(run.lengths):
        durations, jerks = seven_phases(length, *_limits_along(run, k))
        total = durations.sum()
        direction, start = run.legs.vectors[k, 3], run.starts[k]
        at = 0.0
        for time, count in _phases(run, k, total):
            nodes = at + time * np.arange(count + 1) / count
            s, v, a, _ = along(durations, jerks, nodes)
            v, a = v / _SLOWED, a / _SLOWED**2
            slowed = time * _SLOWED
            jerk = np.diff(a) / (slowed / count)
            state = [start + s[:-1, None] * direction, v[:-1, None] * direction, a[:-1, None] * direction]
            x.append(np.column_stack([*state, np.full(count, slowed)]))
            u.append(np.column_stack([jerk[:, None] * direction, np.full(count, slowed)]))
            begins += [True] + [False] * (count - 1)
            share += [1.0 / count] * count
            leg += [k] * count
            at += time
    controls = np.concatenate(u)
    states = np.vstack([*x, np.concatenate([run.ends[-1], np.zeros(2 * run.dim + 1)])])
    states[1:, -1] = controls[:, -1]
    return _Mesh(np.array(begins), np.array(share), np.array(leg), states, controls)


def _phases(run: JointRun, leg: int, total: float) -> list[tuple[float, int]]:
    """Times of the phases of a leg that takes so long, and their numbers of segments."""
    zone = _ZONE * np.cbrt(run.tolerance[leg] / run.jerk.max())
    if total * _SLOWED < 0.3 * zone:
        return [(total, _PER_ZONE)]
    if total < 2.5 * zone:
        return [(0.5 * total, _PER_ZONE)] * 2
    return [(zone, _PER_ZONE), *[((total - 2.0 * zone) / 3.0, _PER_MIDDLE)] * 3, (zone, _PER_ZONE)]


@dataclass(frozen=True)
class _Units:
    """A unit of time, s, and of length, mm."""

    time: float
    length: float

    def of_states(self, d: int) -> FloatArray:
        orders = np.concatenate([self.length / self.time ** np.repeat(np.arange(3.0), d), [self.time]])
        return orders

    def of_controls(self, d: int) -> FloatArray:
        return np.concatenate([np.full(d, self.length / self.time**3), [self.time]])


def _units(run: JointRun) -> _Units:
    jerk = run.jerk.max()
    acceleration = min(run.acceleration.max(), run.bend)
    time = 0.2 * acceleration / jerk if np.isfinite(acceleration) else np.cbrt(2.0 * np.median(run.tolerance) / jerk)
    return _Units(time, jerk * time**3)


def _iterate(run: JointRun, mesh: _Mesh) -> int:
    """Improve the motion on the mesh until it is optimal; the number of iterations."""
    units, d, m = _units(run), run.dim, mesh.leg.size
    origin = run.starts[0]
    shift = np.concatenate([origin, np.zeros(2 * d + 1)])
    x = (mesh.x - shift) / units.of_states(d)
    u = mesh.u / units.of_controls(d)
    vectors = (run.legs.vectors - np.array([origin, origin * 0.0, origin * 0.0, origin * 0.0])) / units.length
    vectors[:, 3] *= units.length
    near = np.repeat((units.length / run.tolerance[mesh.leg])[:, None] ** 2, 3, axis=1)
    speed = units.length / units.time
    pace = np.repeat((speed / run.feed[mesh.leg])[:, None] ** 2, 3, axis=1)
    changes = np.flatnonzero(np.diff(mesh.leg)) + 1
    near[changes, 0] = np.maximum(near[changes, 0], near[changes - 1, 0])
    pace[changes, 0] = np.maximum(pace[changes, 0], pace[changes - 1, 0])
    axes = np.array([speed / run.velocity, speed / units.time / run.acceleration, speed / units.time**2 / run.jerk])
    axes[0, run.velocity >= run.feed.max()] = 0.0
    scalars = np.array([(speed / units.time / run.bend) ** 2, _SHORTEST])
    sizes = np.array([d, m, run.lengths.size, 0])
    target = np.concatenate([(run.ends[-1] - origin) / units.length, np.zeros(2 * d)])
    work = np.empty(core.joint_work(sizes))
    found = np.empty(6)
    status = core.joint_solve(
        *(sizes, mesh.begins, mesh.share, mesh.leg, vectors, run.legs.rates * units.length, run.lengths / units.length),
        *(near, pace, axes, scalars, target, _GAP, _FIRST, _MOST_ITERATIONS, x, u, work, found),
    )
    if status:
        raise SolverError(f"path and feed together: {_WHY[int(status)].format(int(found[5]))}; found {found}")
    mesh.x = x * units.of_states(d) + shift
    mesh.u = u * units.of_controls(d)
    return int(found[5])


def _motion(mesh: _Mesh, iterations: int) -> JointMotion:
    d = mesh.u.shape[1] - 1
    duration = np.where(mesh.begins, mesh.u[:, d], mesh.x[:-1, 3 * d])
    t = np.concatenate([[0.0], np.cumsum(mesh.share * duration)])
    p, v, a = (np.ascontiguousarray(mesh.x[:, k * d : (k + 1) * d]) for k in range(3))
    return JointMotion(t, p, v, a, np.ascontiguousarray(mesh.u[:, :d]), mesh.leg, iterations)
