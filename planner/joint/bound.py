"""A lower bound of the joint problem: no motion within the tolerance and the limits takes less, whatever its path.

Let t_k be a time at which the motion passes the vertex V_k: |q(t_k) - V_k| <= e_k, in the order of the vertices.  Such times
exist, since that is what the tolerance says.  In a direction w, s = w.q is a scalar motion with

    |s'| <= V = min(F |w|, sum |w_i| V_i),   |s''| <= A = sum |w_i| A_i,   |s'''| <= J = sum |w_i| J_i.

1. **Shortest time of a way.**  From t = 0 to T let s rise by D, with s'(0) <= c0, s''(0) <= a0, s'(T) <= c1 and
   s''(T) >= -a1.  Then s'(t) <= r0(t) = c0 + int min(A, a0 + J t), likewise s'(t) <= r1(T - t), and s' <= V.  Let v follow
   r0; then a parabola with v'' = -J to its top W; where W = V a stretch of that speed; such a parabola down; and r1.
   Its slope is continuous, or the parabola is there from the start or to the end.  On a parabola s' - v is convex, since
   s''' >= -J, and at both of its ends <= 0: so s' <= v everywhere, and D <= int v.  T is at least that of the v whose
   integral is D.  Where even W = max(c0, c1) makes more way than D, T >= D / W.

2. **Speed and acceleration at a vertex**, by Landau's inequality on an interval.  Let |f - m| <= M on an interval of length
   h <= h* = (192 M / J)^(1/3), and |f'''| <= J.  Then |f'| <= 18 M / h, |f''| <= 96 M / h^2 at its ends.  Proof: P = M T_3,
   the Chebyshev polynomial on the interval, has these derivatives at its end, and P''' = 192 M / h^3 >= J.  Were |f'| larger
   there, then g = P - x (f - m) would have the slope 0 at the end for some |x| < 1.  It has the signs of P at the four
   extremes of P, so three zeros between them; so g' has two besides that at the end, and g'' two: between these the mean
   of g''' is 0, but it is P''' - x f''' > 0.  For f'' likewise: g'' has a zero besides that at the end.

   From t_k to t_k+1 the motion is within e of block k, w.q so within M = |w.(V_k+1 - V_k)| / 2 + e |w| of its middle,
   which is e |w| for w across a line.  A direction that is across neither block at a vertex is a sum w = p + q of one across
   each, and |w.v| <= |p.v| + |q.v|.  How long a block takes at least (h, where less than h*) is what this bound says of
   it in the round before.  Before the start and behind the end the motion may be thought at rest for as long as wanted.
   Within the time of a block every moment ends an interval of half that time: with u along the block, and p the part of w
   across it, |s'| <= |w.u| F + |p.v| there.

3. **Turns.**  Let D > 0 be left between w.V_k and what s was at the milestone before, and likewise at the next one, each
   point taken e nearer.  Then s has a maximum between these two milestones, it is at least w.V_k - e |w|, and s' = 0 there.
   It is before the time of the next point that is passed.

4. **Milestones** are the t_k, and turns in the direction of an axis; their times rise.  The times between them add up to the
   whole: the best sequence of milestones is found by dynamic programming.  What makes the block behind a vertex short
   makes that before it long, if the motion speeds up there: the acceleration along the tangent m, half way between both
   directions, is in one of ``_CELLS`` cells, in each of which w.a <= max (w.m) m.a + |p.a|, p = w - (w.m) m.  The bound is
   the least over the cells of a vertex, and the largest over what follows on it.

An arc is taken in pieces: the foot of the motion on it moves continuously from its start to its end, and the first times at
which it reaches the ends of the pieces are times t_k.  Step 2 is used at its own ends alone: from the last time at the point
before, and until the first time at the point behind, the motion is within e + bulge of the chord.

What is proven is as good as these steps evaluated in floating point; ``_SAFE`` is taken off for that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.joint.joint_run import JointRun
from planner.types import BoolArray, FloatArray, IntArray

_SPAN = 12  # vertices between two milestones at most
_ROUNDS = 4
_BISECTIONS = 60
_CELLS = 9  # of the acceleration along the tangent at a point
_MAX_REFINED = 400  # points of a route whose accelerations are divided into cells
_OPPOSITE = 1e-3  # length of the sum of two unit vectors
_SAFE = 1.0 - 1e-10  # for what the sums are rounded by
_MAX_ANGLE = np.pi / 16.0  # of a piece of an arc
_PER_TOLERANCE = 4.0  # length of a piece at least
_PARALLEL = 1e-12  # square of the sine of a turn


@dataclass(frozen=True)
class JointBound:
    """A time that no motion of a run can fall below.

    Attributes
    ----------
    seconds : float
    milestones : tuple of str
        What the times are counted between.
    """

    seconds: float
    milestones: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Route:
    """Points that the motion passes in order, n + 1 of them, and the n pieces of blocks between them.

    ``radius`` (n + 1,) is how near it passes, ``joint`` (n + 1,) whether blocks meet there, ``reach`` (n,) how far it may be
    from the straight line between two points, ``feed`` (n,) the largest speed.
    """

    points: FloatArray
    radius: FloatArray
    joint: BoolArray
    reach: FloatArray
    feed: FloatArray
    run: JointRun

    @classmethod
    def of(cls, run: JointRun) -> _Route:
        """Take lines as they are, and arcs in pieces; a piece of an arc of angle phi bulges by r (1 - cos(phi / 2))."""
        n = run.lengths.size
        if (run.legs.rates[:, 1] != 0.0).any() or (run.legs.ways is not None and (run.legs.ways[:, 0] >= 0.0).any()):
            raise InputError(
                "the bound of path and feed together knows lines, arcs and helices, no spirals and splines"
            )
        angle = np.abs(run.legs.rates[:, 0]) * run.lengths
        radius = np.sqrt((run.legs.vectors[:, 1] ** 2).sum(axis=1))
        most = np.maximum(np.floor(run.lengths / (_PER_TOLERANCE * run.tolerance)), 1.0)
        count = np.minimum(np.maximum(np.ceil(angle / _MAX_ANGLE), 1.0), most).astype(np.intp)
        leg, first = np.repeat(np.arange(n), count), np.concatenate([[0], np.cumsum(count)])
        share = (np.arange(leg.size) - first[leg]) / count[leg]
        points = np.vstack([run.legs.at(leg, share * run.lengths[leg])[0], run.ends[-1:]])
        bulge = radius[leg] * (1.0 - np.cos(np.minimum(0.5 * angle[leg] / count[leg], np.pi)))
        near = np.append(run.tolerance[leg], 0.0)
        near[1:-1] = np.minimum(near[1:-1], run.tolerance[leg[:-1]])
        near[0] = 0.0
        joint = np.zeros(leg.size + 1, dtype=np.bool_)
        joint[first] = True
        return cls(points, near, joint, run.tolerance[leg] + bulge, run.feed[leg], run)

    def limits(self, w: FloatArray, feed: FloatArray) -> FloatArray:
        """V_w, A_w and J_w (3, m) of directions w (m, d)."""
        run, share = self.run, np.abs(w)
        length = np.sqrt((w**2).sum(axis=1))
        with np.errstate(invalid="ignore"):  # 0 of an axis without a limit is 0
            velocity, acceleration, jerk = (
                np.where(share > 0.0, share * limit, 0.0).sum(axis=1)
                for limit in (run.velocity, run.acceleration, run.jerk)
            )
            velocity = np.where(length > 0.0, np.minimum(feed * length, velocity), 0.0)
            acceleration = np.where(length > 0.0, acceleration, 0.0)
        return np.stack([velocity, acceleration, jerk])

    def at_rest(self, k: IntArray) -> BoolArray:
        return np.asarray((k == 0) | (k == self.feed.size))


@dataclass(frozen=True, eq=False)
class _Visits:
    """What is known of the motion when it passes the points; ``took`` (n,) is the least time of every piece, s."""

    route: _Route
    took: FloatArray

    def states(self, k: IntArray, w: FloatArray, feed: FloatArray) -> FloatArray:
        """Largest speed and acceleration (2, m) in the directions w (m, d) at the points k (m,)."""
        route, n = self.route, self.route.feed.size
        best = route.limits(w, feed)[:2]
        before, after = np.maximum(k - 1, 0), np.minimum(k, n - 1)
        for piece in (before, after):
            best = np.minimum(best, self._confined(piece, w))
        along = np.diff(route.points, axis=0)
        along = along / np.sqrt((along**2).sum(axis=1))[:, None]
        t1, t2 = along[before], along[after]
        cosine = (t1 * t2).sum(axis=1)[:, None]
        for one, other, first, second in ((t1, t2, before, after), (t2, t1, after, before)):
            across = one - cosine * other  # of other; its product with one is 1 - cosine^2
            with np.errstate(divide="ignore", invalid="ignore"):
                part = across * ((w * one).sum(axis=1)[:, None] / (1.0 - cosine**2))
            part = np.where(1.0 - cosine**2 > _PARALLEL, part, 0.0)
            best = np.minimum(best, self._confined(second, part) + self._confined(first, w - part))
        best = np.where(route.joint[k], best, route.limits(w, feed)[:2])
        return np.where(route.at_rest(k), 0.0, best)

    def _confined(self, piece: IntArray, w: FloatArray, part: float = 1.0) -> FloatArray:
        """Bounds (2, m) of speed and acceleration in the directions w, where ``part`` of the time of a piece ends."""
        route, n = self.route, self.route.feed.size
        chord = route.points[piece + 1] - route.points[piece]
        length = np.sqrt((w**2).sum(axis=1))
        half = 0.5 * np.abs((w * chord).sum(axis=1)) + route.reach[piece] * length
        jerk = route.limits(w, np.full(piece.size, np.inf))[2]
        took = np.where((piece == 0) | (piece == n - 1), np.inf, self.took[piece])
        with np.errstate(divide="ignore", invalid="ignore"):
            span = np.minimum(np.cbrt(192.0 * half / jerk), part * took)
            out = np.stack([18.0 * half / span, 96.0 * half / span**2])
        return np.where(length > 0.0, out, 0.0)

    def fastest(self, k: IntArray, to: IntArray, w: FloatArray, feed: FloatArray) -> FloatArray:
        """Largest speeds (m,) in the directions w between the visits of the points k and ``to``."""
        route = self.route
        chord = route.points[to] - route.points[k]
        unit = chord / np.maximum(np.sqrt((chord**2).sum(axis=1)), np.finfo(np.float64).tiny)[:, None]
        along = (w * unit).sum(axis=1)
        aside = self._confined(k, w - along[:, None] * unit, 0.5)[0]
        single = (to == k + 1) & route.joint[k] & route.joint[to]
        with np.errstate(invalid="ignore"):
            return np.where(single & np.isfinite(feed), np.abs(along) * feed + aside, np.inf)

    def tangent(self, k: IntArray) -> FloatArray:
        """Unit vectors (m, d) between the directions before and behind the points; 0 where these are opposite."""
        along = np.diff(self.route.points, axis=0)
        along = along / np.sqrt((along**2).sum(axis=1))[:, None]
        middle = along[np.maximum(k - 1, 0)] + along[np.minimum(k, along.shape[0] - 1)]
        length = np.sqrt((middle**2).sum(axis=1))[:, None]
        return np.where(length > _OPPOSITE, middle / np.maximum(length, _OPPOSITE), 0.0)

    def _in_cell(self, k: IntArray, w: FloatArray, feed: FloatArray, cell: FloatArray) -> FloatArray:
        """Largest accelerations (m,) in the directions w where those along the tangent are within ``cell`` (2, m)."""
        tangent = self.tangent(k)
        share = (w * tangent).sum(axis=1)
        aside = self.states(k, w - share[:, None] * tangent, feed)[1]
        return np.maximum((share * cell).max(axis=0) + aside, 0.0)

    def between(
        self,
        k: IntArray,
        to: IntArray,
        w: FloatArray,
        feed: FloatArray,
        turns: tuple[bool, bool] = (False, False),
        cells: FloatArray | None = None,
    ) -> FloatArray:
        """Least times (m,) from the points k to ``to`` (m,), seen in the directions w.

        ``turns`` says which milestones are turns; ``cells`` (2, 2, m) holds the least and the largest acceleration along
        the tangents of both points.
        """
        route = self.route
        length = np.sqrt((w**2).sum(axis=1))
        way = (w * (route.points[to] - route.points[k])).sum(axis=1) - (route.radius[k] + route.radius[to]) * length
        limits = route.limits(w, feed)
        if not any(turns):
            limits[0] = np.minimum(limits[0], self.fastest(k, to, w, feed))
        states = []
        for end, (at, turn) in enumerate(zip((k, to), turns, strict=True)):
            resting = np.where(route.at_rest(at), 0.0, limits[1])
            state = np.stack([np.zeros(at.size), resting]) if turn else self.states(at, w, feed)
            if cells is not None:
                state[1] = np.minimum(state[1], self._in_cell(at, -w if end else w, feed, cells[end]))
            states.append(state)
        return time_of_way(way, limits, states[0], states[1])


def time_of_way(way: FloatArray, limits: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Least times (m,) of the ways (m,): step 1 above.

    Parameters
    ----------
    way : (m,) array
        D; where it is not positive the time is 0.
    limits : (3, m) array
        V, A, J; the first two may be inf.
    start, end : (2, m) arrays
        c0, a0 and c1, a1.

    Returns
    -------
    (m,) array
    """
    jerk = limits[2]
    way = np.maximum(way, 0.0)
    most = 10.0 * np.cbrt(jerk * way**2) + np.minimum(start[0], limits[0]) + np.minimum(end[0], limits[0])
    top = np.minimum(limits[0], most)  # more is not reached within the way
    limits = np.stack([top, limits[1], jerk])
    ends = [np.stack([np.minimum(c, top), np.minimum(a, limits[1])]) for c, a in (start, end)]
    lowest = np.maximum(ends[0][0], ends[1][0])

    def climbed(speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        times, ways = zip(*(_climb(speed, limits, *one) for one in ends), strict=True)
        return times[0] + times[1], ways[0] + ways[1]

    low, high = lowest.copy(), top.copy()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        short = climbed(middle)[1] <= way
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    time_low, (time_top, way_top) = climbed(low)[0], climbed(top)
    with np.errstate(divide="ignore", invalid="ignore"):
        slow = np.where(way > 0.0, way / lowest, 0.0)
        fast = time_top + (way - way_top) / top
    out = np.where(way >= way_top, fast, np.where(climbed(lowest)[1] > way, slow, time_low))
    return np.where(way > 0.0, out, 0.0)


def _climb(speed: FloatArray, limits: FloatArray, c: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time and way (m,) from speed c and at most acceleration a to ``speed`` >= c with acceleration 0."""
    most, jerk = limits[1], np.maximum(limits[2], np.finfo(np.float64).tiny)
    rise = np.maximum(speed - c, 0.0)
    at_once = rise <= a**2 / (2.0 * jerk)
    a = np.where(at_once, 0.0, a)
    peak = np.minimum(np.sqrt(np.where(at_once, 2.0, 1.0) * jerk * rise + 0.5 * a**2), np.where(at_once, np.inf, most))
    growing, falling = np.where(at_once, 0.0, (peak - a) / jerk), peak / jerk
    ups = growing * 0.5 * (a + peak)
    with np.errstate(divide="ignore", invalid="ignore"):
        held = np.where(at_once, 0.0, np.maximum(rise - ups - 0.5 * peak * falling, 0.0) / peak)
    v1 = c + ups
    way = growing * (c + growing * (0.5 * a + growing * jerk / 6.0)) + held * (v1 + 0.5 * held * peak)
    return growing + held + falling, way + falling * (speed - jerk * falling**2 / 6.0)


def joint_bound(run: JointRun) -> JointBound:
    """Bound the time of every motion along a run from below.

    Parameters
    ----------
    run : JointRun
        Of lines, arcs and helices.

    Returns
    -------
    JointBound

    Raises
    ------
    InputError
        The run has spirals or splines.
    """
    route = _Route.of(run)
    visits = _Visits(route, np.zeros(route.feed.size))
    k = np.arange(route.feed.size)
    for _ in range(_ROUNDS):
        visits = _Visits(route, np.maximum(visits.took, _straight(visits, k, k + 1)))
    return _best_chain(visits)


def _straight(visits: _Visits, k: IntArray, to: IntArray, cells: FloatArray | None = None) -> FloatArray:
    """Least times from the points k to ``to`` (m,): the best of the direct way and of the axes."""
    route = visits.route
    way = route.points[to] - route.points[k]
    feed = _largest_between(route.feed, k, to)
    length = np.maximum(np.sqrt((way**2).sum(axis=1)), np.finfo(np.float64).tiny)
    best = visits.between(k, to, way / length[:, None], feed, cells=cells)
    for axis in range(route.run.dim):
        w = np.zeros_like(way)
        w[:, axis] = np.sign(way[:, axis])
        best = np.maximum(best, visits.between(k, to, w, feed, cells=cells))
    return best


def _largest_between(value: FloatArray, k: IntArray, to: IntArray) -> FloatArray:
    """Largest of value[k:to], for spans of at most _SPAN."""
    out = value[k]
    for ahead in range(1, _SPAN):
        out = np.maximum(out, value[np.minimum(k + ahead, to - 1)])
    return out


def _best_chain(visits: _Visits) -> JointBound:
    """The largest sum of times between milestones.

    Nodes of a point are its visits, one for each cell, and its turns, one for each axis and sense.  best[k, i] is a time
    before which the node is not reached: where the milestone before is a visit, that holds in one of its cells.
    """
    n, turns = visits.route.feed.size, 2 * visits.route.run.dim
    count = _CELLS if n <= _MAX_REFINED else 1
    to = np.repeat(np.arange(1, n + 1), np.minimum(np.arange(1, n + 1), _SPAN))
    first = np.searchsorted(to, np.arange(1, n + 2))
    k = to - 1 - (np.arange(to.size) - first[to - 1])
    gain = _gains(visits, k, to, count)
    best = np.full((n + 1, count + turns), -np.inf)
    best[0, :count] = 0.0
    came = np.zeros((n + 1, count + turns), dtype=np.intp)
    for at in range(1, n + 1):
        some = slice(first[at - 1], first[at])
        total = best[k[some], :, None] + gain[some]
        total = np.concatenate([total[:, :count].min(axis=1, keepdims=True), total[:, count:]], axis=1)
        total = total.reshape(-1, count + turns)
        came[at], best[at] = total.argmax(axis=0), total.max(axis=0)
    at, node = n, int(best[n, :count].argmin())
    seconds, names = float(best[at, node]) * _SAFE, []
    while at > 0:
        names.append(f"point {at}" if node < count else f"axis {(node - count) // 2} turns at point {at}")
        row, group = divmod(int(came[at, node]), 1 + turns)
        at, before = int(k[first[at - 1] + row]), at
        node = (
            int((best[at, :count] + gain[first[before - 1] + row, :count, node]).argmin())
            if group == 0
            else count + group - 1
        )
    return JointBound(seconds, tuple(reversed(names)))


def _gains(visits: _Visits, k: IntArray, to: IntArray, count: int) -> FloatArray:
    """Least times (m, nodes, nodes) between the nodes of the points k and ``to`` (m,); -inf where there is no such turn."""
    d = visits.route.run.dim
    gain = np.full((k.size, count + 2 * d, count + 2 * d), -np.inf)
    gain[:, :count, :count] = _straight(visits, k, to)[:, None, None]
    feed = np.full(k.size, visits.route.feed.max())
    for axis in range(d):
        for sense in (0, 1):
            w = np.zeros((k.size, d))
            w[:, axis] = 1.0 if sense else -1.0  # s rises: it may turn behind in this sense, and before in the other
            behind, before = (slice(count + 2 * axis + x, count + 2 * axis + x + 1) for x in (sense, 1 - sense))
            visit = slice(0, count)
            for i, j in ((visit, behind), (before, visit), (before, behind)):
                time = visits.between(k, to, w, feed, (i is before, j is behind))
                gain[:, i, j] = np.where(time > 0.0, time, -np.inf)[:, None, None]
    if count > 1:
        near = np.flatnonzero(to == k + 1)
        gain[near, :count, :count] = np.maximum(gain[near, :count, :count], _between_cells(visits, k[near], count))
    return gain


def _between_cells(visits: _Visits, k: IntArray, count: int) -> FloatArray:
    """Least times (m, count, count) from the points k to the next ones, from each cell to each."""
    route = visits.route
    points = np.arange(route.feed.size + 1)
    top = visits.states(points, visits.tangent(points), np.full(points.size, route.feed.max()))[1]
    edges = top * np.linspace(-1.0, 1.0, count + 1)[:, None]
    point, i, j = (a.reshape(-1) for a in np.meshgrid(k, np.arange(count), np.arange(count), indexing="ij"))
    cells = np.array([[edges[i, point], edges[i + 1, point]], [edges[j, point + 1], edges[j + 1, point + 1]]])
    return _straight(visits, point, point + 1, cells).reshape(k.size, count, count)
