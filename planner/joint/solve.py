"""Path and feed as one problem: the fastest motion that stays within the tolerance of every block of a run.

The motion q(t) is sought directly, as a function of time.  Block k is cut into *phases*, whose durations T are free, and
these into *segments*, a given share w of the phase each, on which the jerk j is constant.

    minimise    sum of the T
    so that     |j_k| <= J_k,  |a_k| <= A_k
                |v| <= F,  |v_k| <= V_k,  dist(p, block) <= e
                |p - vertex| <= e                               at the node where a block ends
                p, v, a given at the start and at the end.

Where one side of a block alone is allowed also n (p - vertex) >= 0, n being its normal to that side.  Where the next block
turns to the allowed side, which then is what is left of both, this holds for both all along them; where it turns away,
for each along its own, and for both at the node between them.

dist is the distance from the block with its ends, so that the set is a stadium about a line, in any number of axes.  It
bounds how far the motion is from the blocks; with the discs at the vertices also how far the blocks are from it.

In units of its phase, V = v T, A = a T^2, U = j T^3, a segment is linear with constant coefficients:

    p+ = p + w V + w^2/2 A + w^3/6 U,    V+ = V + w A + w^2/2 U,    A+ = A + w U,    c+ = c,    c = T^3,

and every row is convex, as |V|^2 <= F^2 c^(2/3).  Rows stand at the nodes and at the inner control points of the Bezier
curves of each half of a segment.  A curve lies in the convex hull of its control points, so that what they keep is kept
everywhere; not so about an arc, where the motion is measured between, and solved again where it exceeds.  What is not
linear is the *switch* from a phase to the next alone, which has V+ = r V and A+ = r^2 A, r = (c+/c)^(1/3).

The method is a primal-dual interior point one, with slacks s and multipliers z, g + s = 0 and z s = mu; mu falls with the
progress made.  A Newton step is one Riccati sweep (joint_sweep.c), linear in the number of segments.  Its system has all
second derivatives, and a weight on relative changes of the durations: with durations held it is convex, so that there
always is a weight at which it is positive definite.  The step is repeated with more of it where it is not, or where
durations would more than double.  When mu and what is left to gain are small durations are held, and Newton steps close
what the switches are off by.

A motion back in time keeps the same limits and tolerance, so the optimum along the blocks back is that motion.  Of both
directions the solver takes one, by a rule that looks at the vertices alone, and turns what it finds back.

Long runs are solved in windows of some blocks, each from the state that the one before has at the end of its first part,
to rest at its own end.

The start is the exact-stop motion (exact_stop.py), slowed.  Times are counted in a fifth of A / J, lengths in what the jerk
moves in that time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.compiled import core
from planner.errors import SolverError
from planner.joint.constant_jerk import arriving
from planner.joint.exact_stop import Mesh, limits_along, stopping_motion, units_of
from planner.joint.joint_run import JointMotion, JointRun
from planner.joint.straight import along, reachable_acceleration, seven_phases
from planner.types import FloatArray, IntArray

_GAP = 3e-5  # of the time
_MAX_ITERATIONS = 300
_ATTEMPTS = ((1.05, 3e-2), (1.3, 1e-1))  # how much the start is slowed; products of slacks and multipliers
_AGAIN = 3e-3  # that product where the start is a solution
_OPEN = 30.0  # largest defect on the way, of the tolerance
_MAX_PASSES = 10
_BETWEEN = 32  # parts of a segment at which it is measured
_MARGIN = 1e-5  # of the tolerance: closing the last defects moves by less
_BULGE = 1e-3  # of the tolerance, by which a motion may be further off an arc between the points that have rows
_AIM = 0.998  # at what was beyond the feed; the more so from pass to pass
_UNSEEN = 1e-4  # of the tolerance, by which the motion may be further off an arc between these places
_MORE = 1.5  # times as much as a motion was beyond the tolerance
_MAX_SPEED = 1e-7  # relative excess of the feed
_SETTLED = 20.0  # in units of time, the shortest part of the motion that is corrected by itself
_SHORTEST = 0.02  # duration of a phase, in units
_KEPT, _BEYOND, _MAX_BEYOND = 16, 8, 80  # blocks of a window that are kept, and those beyond
_REST = 40  # blocks that are not cut into windows
_WHY = {1: "it had not converged after {} iterations", 2: "its system was singular after {} iterations"}


def solve_run(run: JointRun) -> JointMotion:
    """Find the fastest motion of a run.

    Raises
    ------
    SolverError
        Where the method does not converge, or a leg is of a kind that it does not treat.
    """
    if run.legs.ways is not None and (run.legs.ways[:, 0] >= 0.0).any():
        raise SolverError("path and feed together: the run has splines, for which it is not solved")
    if run.normals is not None and run.legs.curved.any():
        raise SolverError("path and feed together: the run has arcs, for which it is not solved with one side alone")
    if run.lengths.size == 1 and not run.legs.curved[0]:
        return _straight(run)
    # Which of two optima is found may depend on the direction, or on a rounding: both directions are one and the same task.
    back = run.is_backward
    motion = _solved((run.reversed() if back else run).between_vertices())
    motion = motion.reversed() if back else motion
    return motion.with_ends(run.starts[0], run.ends[-1])


def _solved(run: JointRun) -> JointMotion:
    """The motion of a run of several lines, or with arcs, in the direction given."""
    # A limit beyond what is reached would set the units all the same, and the solver would find another motion, or none.
    reached = reachable_acceleration(run.velocity, run.acceleration, run.jerk, float(run.feed.max()))
    run = replace(run, acceleration=reached)
    failure = SolverError()
    for slowed, product in _ATTEMPTS:
        try:
            return _in_windows(run, stopping_motion(run, slowed), product)
        except SolverError as error:
            failure = error
    raise failure


def _straight(run: JointRun) -> JointMotion:
    """The motion along a single line, in closed form."""
    durations, jerks = seven_phases(run.lengths[0], *limits_along(run, 0))
    kept = durations > 0.0
    durations, jerks = durations[kept], jerks[kept]
    t = np.concatenate([[0.0], np.cumsum(durations)])
    s, v, a, _ = along(durations, jerks, t)[..., None]
    direction = run.legs.vectors[0, 3]
    s[-1], v[-1], a[-1] = run.lengths[0], 0.0, 0.0
    leg = np.zeros(jerks.size, dtype=np.int64)
    return JointMotion(t, run.starts[0] + s * direction, v * direction, a * direction, jerks[:, None] * direction, leg)


def _walls(run: JointRun) -> FloatArray | None:
    """What joint.h calls so: normals to the allowed sides, and whether those of the blocks beside are kept too."""
    normals = run.normals
    if normals is None:
        return None
    # the next leg leads to the allowed side of this one
    turns = np.sum(normals[:-1] * run.legs.vectors[1:, 3], axis=1) >= 0.0
    beside = turns & normals[1:].any(axis=1)
    return np.column_stack([normals, np.append(False, beside & normals[:-1].any(axis=1)), np.append(beside, False)])


class _Scaled:
    """A run on a mesh, and its motion x, u, in the solver's units; joint.h says what they are."""

    def __init__(self, run: JointRun, mesh: Mesh) -> None:
        self.run, self.mesh = run, mesh
        self.time, self.length = units_of(run)
        self.origin = run.starts[0]
        self.x, self.u = self._motion()
        speed, d = self.length / self.time, run.dim
        cubes = np.where(mesh.switches, np.maximum(self.x[1:, -1], self.x[:-1, -1]), self.x[:-1, -1])
        self.scale = np.cbrt(cubes)
        self.vectors = run.legs.vectors / self.length
        self.vectors[:, 0] -= self.origin / self.length
        self.vectors[:, 3] *= self.length
        self.axes = np.array(
            [speed / run.velocity, speed / self.time / run.acceleration, speed / self.time**2 / run.jerk]
        )
        self.axes[0, run.velocity >= run.feed.max()] = 0.0
        after = np.flatnonzero(np.diff(mesh.leg)) + 2  # the segments that begin at vertices
        self.bent = run.legs.curved[mesh.leg]
        reach = run.tolerance[mesh.leg] * np.where(self.bent, 1.0 - _BULGE, 1.0 - _MARGIN)
        self.reach, self.pace = (np.column_stack([limit, limit]) for limit in (reach, run.feed[mesh.leg]))
        for limit in (self.reach, self.pace):
            limit[after, 0] = np.minimum(limit[after, 0], limit[after - 2, 0])
        self.walls = _walls(run)
        self.target = np.column_stack([(run.ends - self.origin) / self.length, np.zeros((run.lengths.size, 2 * d))])

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        mesh, d = self.mesh, self.run.dim
        t = mesh.x[:, 3 * d :] / self.time
        x = np.column_stack([mesh.x[:, : 3 * d] / self.length, t**3])
        x[:, :d] -= self.origin / self.length
        x[:, d : 2 * d] *= self.time * t
        x[:, 2 * d : 3 * d] *= (self.time * t) ** 2
        u = mesh.u * (self.time * t[:-1]) ** 3 / self.length
        u[mesh.switches, 0] = (mesh.u[mesh.switches, 0] / self.time) ** 3
        return x, u

    def solve(self, stages: slice, last: int, product: float) -> int:
        """Improve the motion in these stages, to rest at the end of leg ``last``; the number of iterations."""
        mesh, run, speed = self.mesh, self.run, self.length / self.time
        switches, share, leg = mesh.switches[stages], mesh.share[stages], mesh.leg[stages]
        states = slice(stages.start, stages.stop + 1)
        x, u = np.ascontiguousarray(self.x[states]), np.ascontiguousarray(self.u[stages])
        sizes = np.array([run.dim, leg.size, run.lengths.size])
        legs = (leg, self.vectors, run.legs.rates * self.length, run.lengths / self.length)
        work, found, between = np.empty(core.joint_work(sizes)), np.empty(6), np.empty((leg.size, 2))
        opened, count = _OPEN * run.tolerance.min() / self.length, 0
        for once in range(_MAX_PASSES):
            near, pace = (self.length / self.reach[stages]) ** 2, (speed / self.pace[stages]) ** 2
            status = core.joint_solve(
                *(sizes, switches, share, self.scale[stages], *legs, near, pace, self.walls, self.axes),
                *(_SHORTEST**3, self.target[last], _GAP, _AGAIN if once else product, opened, _MAX_ITERATIONS),
                *(x, u, work, found),
            )
            count += int(found[5])
            if status:
                why = _WHY[int(status)].format(int(found[5]))
                raise SolverError(f"path and feed together, blocks {leg[0] + 1} to {leg[-1] + 1} of the run: {why}")
            core.joint_between(sizes, switches, share, *legs, x, u, _BETWEEN, between)
            excess = between * [self.length, speed] / np.column_stack([run.tolerance, run.feed])[leg]
            bent = self.bent[stages]
            excess[bent, 0] += _UNSEEN
            over = excess > [1.0, 1.0 + _MAX_SPEED]
            if not over.any():
                self.x[states], self.u[stages] = x, u
                return count
            # About all arcs alike: the next motion, another one, may be furthest off elsewhere.
            over[bent, 0], excess[bent, 0] = over[bent, 0].any(), excess[bent, 0].max(initial=0.0)
            over &= ~switches[:, None]
            away, fast = over.T
            self.reach[stages][away] *= 1.0 / excess[away, :1] ** _MORE
            self.pace[stages][fast] *= _AIM ** (1 + once) / excess[fast, 1:]
        raise SolverError(
            f"path and feed together, blocks {leg[0] + 1} to {leg[-1] + 1} of the run: after {_MAX_PASSES} passes the "
            f"tolerance is exceeded by {excess[:, 0].max() - 1.0:.2g} of it"
        )

    def long_enough(self, begin: IntArray, leg: int, last: int) -> int:
        """The first leg of those up to ``last`` so long after this one that the defects of its switches are nothing."""
        lasts = self.mesh.share * np.cbrt(self.x[:-1, -1])
        time = np.concatenate([[0.0], np.cumsum(lasts)])[begin]
        until = int(np.searchsorted(time[: last + 1], time[leg] + _SETTLED))
        return last if until > last or time[last] - time[until] < _SETTLED else until

    def settle(self, stages: slice, start: FloatArray) -> _Part:
        """The motion of these stages in mm and s, from the state ``start`` (3, d); each follows from the one before."""
        d = self.run.dim
        on = np.flatnonzero(~self.mesh.switches[stages]) + stages.start
        duration = np.cbrt(self.x[on, 3 * d]) * self.time
        width, leg = self.mesh.share[on] * duration, self.mesh.leg[on]
        end = self.x[stages.stop, : 3 * d].reshape(3, d) * self.length
        end /= duration[-1] ** np.arange(3.0)[:, None]
        end[0] += self.origin
        if stages.stop == self.mesh.leg.size:
            end = np.stack([self.run.ends[-1], np.zeros(d), np.zeros(d)])
        state, jerk = arriving(start, self.length * self.u[on] / duration[:, None] ** 3, width, end)
        return _Part(width, state, jerk, leg)


@dataclass
class _Part:
    """A part of the motion: widths (m,) of its segments, states (3, m + 1, d), jerks (m, d), legs (m,)."""

    width: FloatArray
    state: FloatArray
    jerk: FloatArray
    leg: IntArray


def _end_of_window(run: JointRun, leg: int, kept: int) -> int:
    """The leg before which a window ends: it is so long beyond the kept ones that stopping there takes them no time.

    From the speed v to rest it is v^2 / (2 a) + v a / (2 J); twice that, for the last to speed up as well.
    """
    n = run.lengths.size
    if n - leg <= _REST:
        return n
    speed = min(run.feed.max(), float(np.sqrt((run.velocity**2).sum())))
    acceleration, jerk = run.acceleration.min(), run.jerk.min()
    acceleration = min(acceleration, np.sqrt(speed * jerk)) if np.isfinite(speed) else acceleration
    way = speed * (speed / acceleration + acceleration / jerk) if np.isfinite(speed) else np.inf
    beyond = np.cumsum(run.lengths[kept : kept + _MAX_BEYOND])
    end = kept + max(_BEYOND, int(np.searchsorted(beyond, way)) + 1)
    return min(end, kept + _MAX_BEYOND, n)


def _in_windows(run: JointRun, mesh: Mesh, product: float) -> JointMotion:
    """Solve the run on a mesh, window by window."""
    scaled, n = _Scaled(run, mesh), run.lengths.size
    begin = np.searchsorted(mesh.leg, np.arange(n + 1))
    state = np.stack([run.starts[0], np.zeros(run.dim), np.zeros(run.dim)])
    pieces, count, leg = list[_Part](), 0, 0
    while leg < n:
        kept = min(leg + _KEPT, n)
        end = _end_of_window(run, leg, kept)
        kept = n if end == n else kept
        count += scaled.solve(slice(begin[leg], begin[end]), end - 1, product)
        while leg < kept:
            until = scaled.long_enough(begin, leg, kept)
            pieces.append(scaled.settle(slice(begin[leg], begin[until]), state))
            state, leg = pieces[-1].state[:, -1], until
    widths = np.concatenate([piece.width for piece in pieces])
    position, velocity, acceleration = (
        np.concatenate([pieces[0].state[k, :1], *(piece.state[k, 1:] for piece in pieces)]) for k in range(3)
    )
    jerk = np.concatenate([piece.jerk for piece in pieces])
    legs = np.concatenate([piece.leg for piece in pieces])
    t = np.concatenate([[0.0], np.cumsum(widths)])
    return JointMotion(t, position, velocity, acceleration, jerk, legs, count)
