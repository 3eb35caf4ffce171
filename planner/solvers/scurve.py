"""Jerk-limited S-curves between the feed minima of the limit curve: what industrial controls do today.

With s the arc length of the tool tip and t = q_s, k = q_ss, z = q_sss the machine axes' derivatives along it, a feed v
with tangential acceleration a and jerk J puts on axis j

    velocity |t v| <= V_j,   acceleration |t a + k v^2| <= A_j,   jerk |t J + 3 k v a + z v^3| <= J_j.

    feed |      limit curve .--------.
         |  __            .'  ______  '.          _______      o nodes, where a = 0
         |'   '.  __    .'  .'      '. '.  __.--''             between them blocks: ramp up, cruise, ramp down, each
         |      ''  ''--o--'          '--o                     with its own top feed, accelerations up and down, jerk
         +--------------------------------------------- s

1. Limit curve: the largest feed at a = J = 0, on a grid refined until neighbours are alike.
2. Nodes: its minima (shallow ones merged), the curvature jumps that count, and both ends of the section.
3. First plan: node feeds at 90 % of the limit curve.  Each block is the S-curve (by ruckig) whose tops are the largest
   ones on the path dilated in time, to f, f^2, f^2 and f^3, with the f of a ladder that is fastest and holds every limit
   at points along the block.  Where none holds, the faster end of the block is lowered.
4. Compass search (Kolda, Lewis, Torczon, SIAM Review 45 (2003) 385-482) over the tops of every block and over feed and
   place of every node.  A trial counts only if it holds the limits and saves time.  Then blocks that lose much against
   the limit curve get a node in the middle of their cruise, which changes nothing yet, and the search goes on.
5. The time law u(t) is checked densely on the exact curve.  Where it exceeds a limit, the margin there is raised and the
   blocks concerned go back to step 3.

Feasible, because no plan leaves but through the check of step 5.  On a straight line the first block tried is already
the time-optimal one.  At a curvature jump the acceleration of axis j steps by D = |dk_j| v^2, which samples of period T
show as a jerk of up to 0.75 D/T: D is kept to 2/3 J_j T, and the jerk within three periods of the jump to J_j/2.

Limitations.  The acceleration returns to zero at every node, and the jerk of a ramp is one number whatever the axes
would allow along it: some percent above the optimum where acceleration rules, 30 % where jerk rules all along (the
five-axis flank path).  No bound on the time comes with it.  The arc length of the tip must grow all along the path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from planner.errors import InfeasibleError, InputError, SolverError
from planner.geometry.curve import Curve, FloatArray, Side
from planner.limits import Limits, chord_feed_limit
from planner.profile import along_tip, quintic_coefficients

Nodes = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
IntArray = NDArray[np.intp]

_REST = 1e-9  # |p'| below this fraction of its largest value: the tip rests
_EVEN_POINTS, _PANEL_POINTS = 400, 4  # of the first grid: evenly in u and in s, and in each panel of the arc length
_GRID_CHANGE, _GRID_PASSES, _MAX_GRID = 0.02, 8, 200_000
_STEP_SHARE, _PERIODS_AROUND_STEP = 2.0 / 3.0, 3.0
_MERGE = 0.05  # minima of the limit curve are merged unless the feed rises by this fraction between them
_FIRST_SHARE = 0.9
_LADDER = 0.9 ** np.arange(60)
_SLIGHTLY = np.array([1.0, 0.9995, 0.999, 0.998, 0.995, 0.99, 0.98, 0.96])
_LOWER, _LOWER_LITTLE, _LOWEST = 0.85, 0.98, 1e-6
_MARGIN = 1e-3  # kept from every limit where the path is curved, for what lies between grid points
_ROUND_OFF = 1e-12
_PHASE_POINTS, _STRIDE = 6, 4
_CHUNK = 20_000  # blocks traced at once; bounds the memory
# Directions of the search.  Of a block: the logarithms of its top feed, accelerations up and down, and jerk.  Of a node:
# the logarithm of its feed, its place, and the pace of the ramps on both sides of it.
_BLOCK_MOVES = np.array(
    [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 1, 1, 1)]
    + [(1, 0, 0, -0.7), (1, -1, -1, -1), (0, -0.7, 0, 1), (0, 0, -0.7, 1), (-0.7, 1, 0, 0), (-0.7, 0, 1, 0)]
)
_NODE_MOVES = np.array([move for move in product((0.0, 1.0), (-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)) if any(move)])
_FIRST_STEP, _SMALLEST_STEP = 0.4, 4e-3
_ROUNDS, _TRIALS, _MANY = 30, 60_000, 60
_GAIN = 1e-3  # five rounds that save less than this fraction end a search; so does twice that, for nodes added
_SPLIT_LOSS, _SPLITS = 4e-3, 4
_LAW_PASSES, _CHECK_POINTS, _REPAIRS = 16, 9, 12
_JERK_ERROR, _FEED_ERROR = 1e-4, 3e-10  # of the quintic time law, against the jerk limits and the largest feed
_ON_BREAK = 4.0 * np.finfo(float).eps
# Two rounded numbers u, 2 eps apart, make the third derivative of a quintic over a time h uncertain by 120 eps |u| / h^3.
_DIGITS = 120.0 * np.finfo(float).eps
_NOISE, _NUDGE, _NUDGES = 1e-3, 0.998, 3
_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class _Path:
    """A section as the search sees it: cells between grid points, limits scaled to 1 and linear across a cell.

    ``s (n + 1,)``; ``rows, slopes (n, 6, axes)``: t/V, t/A, k/A, t/J, 3k/J, z/J at a cell's left end and their change
    across it; ``cap (n,)`` of the feed by command and chord; ``limit (n + 1,)`` the limit curve, ``cruise (n,)`` its
    lower end in each cell; ``curved (n,)`` 0 where the cell is straight, else 1; ``tops (4,)`` the largest feed,
    accelerations up and down, and jerk anywhere; ``jumps`` places of the curvature jumps that limit the feed;
    ``shortest`` duration of a phase whose jerk double precision can hold, s; ``stride`` the number of cells between two points at which a ramp is tried.
    """

    s: FloatArray
    rows: FloatArray
    slopes: FloatArray
    cap: FloatArray
    limit: FloatArray
    cruise: FloatArray
    curved: FloatArray
    tops: FloatArray
    jumps: FloatArray
    shortest: float
    stride: int = _STRIDE

    def with_margin(self, margin: FloatArray) -> _Path:
        """Tighten every limit but the feed's cap by a fraction (n,) where the path is curved."""
        factor = 1.0 + margin * self.curved
        rows, slopes = self.rows * factor[:, None, None], self.slopes * factor[:, None, None]
        return replace(self, rows=rows, slopes=slopes, cruise=np.minimum(self.cruise / factor, self.cap))

    def used(self, s: FloatArray, v: FloatArray, a: FloatArray, jerk: FloatArray) -> FloatArray:
        """Largest share of any limit used in states along the path, all (m,)."""
        cell = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, self.cap.size - 1)
        w = (s - self.s[cell]) / (self.s[cell + 1] - self.s[cell])
        row = self.rows[cell] + w[:, None, None] * self.slopes[cell]
        tv, ta, ka, tj, kj, zj = (row[:, i] for i in range(6))
        v1, a1, j1 = v[:, None], a[:, None], jerk[:, None]
        share = np.maximum(np.abs(tv * v1), np.abs(ta * a1 + ka * v1**2))
        share = np.maximum(share, np.abs(tj * j1 + v1 * (kj * a1 + zj * v1**2)))
        return np.maximum(share.max(axis=1), v / self.cap[cell])

    def lowest_cruise(self, s0: FloatArray, s1: FloatArray) -> FloatArray:
        """Smallest cruise feed over each of the stretches [s0, s1]."""
        first = np.clip(np.searchsorted(self.s, s0, side="right") - 1, 0, self.cruise.size - 1)
        last = np.clip(np.searchsorted(self.s, s1, side="left"), first + 1, self.cruise.size)
        bounds = np.stack([first, last], axis=1).reshape(-1)
        return np.minimum.reduceat(np.append(self.cruise, np.inf), bounds)[::2]


@dataclass
class _Plan:
    """Nodes, m + 1 places s with feeds v, and the m blocks between them: tops (m, 4), time (m,), inf where unknown."""

    s: FloatArray
    v: FloatArray
    tops: FloatArray
    time: FloatArray

    def ends(self, block: IntArray) -> FloatArray:
        """Places and feeds (s0, v0, s1, v1) at the ends of blocks, (4, n)."""
        return np.stack([self.s[block], self.v[block], self.s[block + 1], self.v[block + 1]])


def plan_section(
    curve: Curve, limits: Limits, u_start: float, u_end: float, start_feed: float, end_feed: float
) -> Nodes:
    """Plan a section of a path that has no exact stop inside.

    Parameters
    ----------
    curve : Curve
    limits : Limits
        One for each axis of the curve.
    u_start, u_end : float
        Curve parameters of the section's ends.
    start_feed, end_feed : float
        Feed of the tool tip there, mm/s; 0 at an exact stop.  The tangential acceleration is 0 at both.

    Returns
    -------
    t, u, u_rate, u_acceleration : (n,) arrays
        Nodes of the time law, t from 0 s; double ones where the parametrisation jumps.

    Raises
    ------
    InfeasibleError
        If the section cannot be entered or left with the feed given; the message says with which it can.
    InputError
        If the tip rests along the section, or nothing limits the feed.
    SolverError
        If no plan was found that holds every limit.
    """
    limits.require_matches(curve)
    base = _describe(curve, limits, u_start, u_end, max(start_feed, end_feed))
    margin = np.full(base.cap.size, _MARGIN)
    path, solver = base.with_margin(margin), _Ruckig()
    plan = _first_plan(path, solver, start_feed, end_feed)
    if plan is None:
        raise _infeasible(path, solver, start_feed, end_feed, curve, (u_start, u_end))
    plan = _search(path, solver, plan)
    for repair in range(_REPAIRS):
        nodes = _time_law(curve, limits, solver, plan, (u_start, u_end))
        used, noise = _used_exactly(curve, limits, nodes)
        bad, short = np.flatnonzero(used > 1.0 + _TOLERANCE), np.flatnonzero(noise > _NOISE)
        if bad.size == 0 and (short.size == 0 or repair >= _NUDGES):
            return nodes
        places = curve.arclength.s(nodes[1])
        for i in bad:
            cells = slice(*np.clip(np.searchsorted(base.s, places[i : i + 2]) + [-2 - 2 * repair, 1 + 2 * repair], 0, margin.size))
            margin[cells] += np.maximum(1.2 * (used[i] - 1.0), 0.5 * margin[cells])
        path = replace(base.with_margin(margin), stride=max(_STRIDE >> (repair + 1) // 2, 1))
        every = np.arange(plan.time.size)
        # A jerk switch that almost meets a break leaves an interval too short for double precision; move the switch.
        nudged = np.clip(np.searchsorted(plan.s, 0.5 * (places[short] + places[short + 1])) - 1, 0, every.size - 1)
        plan.tops[nudged] *= _dilated(np.array([_NUDGE]))
        plan.time = _durations(path, solver, plan.ends(every), plan.tops, np.full(every.size, np.inf))
        if not _make_feasible(path, solver, plan, _LOWER_LITTLE):
            break
        if bad.size:
            _improve(path, solver, plan, _ROUNDS // (4 + 2 * repair))
    worst = int(np.argmax(used))
    raise SolverError(
        f"{curve.name}: at u = {nodes[1][worst]:.9g} a limit is used to {used[worst]:.9g}, and no S-curves were found "
        'that hold it; use method = "optimal"'
    )


# ---- the path -------------------------------------------------------------------------------------------------------


def _arc_derivatives(curve: Curve, u: FloatArray, side: Side) -> tuple[FloatArray, ...]:
    """t, k, z (n, dim) of the machine axes along the TIP's arc length; |p'| and its first two u-derivatives (n,)."""
    q = curve.derivatives(u, 3, side=side)
    p = q if curve.tip is curve else curve.tip.derivatives(u, 3, side=side)
    speed = np.sqrt(np.sum(p[1] ** 2, axis=-1))
    resting = np.flatnonzero(speed <= _REST * speed.max(initial=0.0))
    if resting.size:
        raise InputError(
            f'{curve.name}: the tool tip rests at u = {u[resting[0]]:.9g} while other axes move; method = "scurve" '
            'plans along the arc length of the tip and cannot cross such a stretch; use method = "optimal"'
        )
    speed1 = np.sum(p[1] * p[2], axis=-1) / speed
    speed2 = (np.sum(p[2] ** 2, axis=-1) + np.sum(p[1] * p[3], axis=-1) - speed1**2) / speed
    v, v1, v2 = speed[:, None], speed1[:, None], speed2[:, None]
    t = q[1] / v
    k = (q[2] - v1 * t) / v**2
    return t, k, (q[3] - 3.0 * v * v1 * k - v2 * t) / v**3, speed, speed1, speed2


def _limit_rows(
    curve: Curve, limits: Limits, u: FloatArray, side: Side, jerk_share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows of _Path, cap and limit curve at u; the tip's arc length counts as one more axis where it has limits."""
    t, k, z = _arc_derivatives(curve, u, side)[:3]
    velocity, acceleration, jerk = limits.velocity, limits.acceleration, limits.jerk
    tangential = np.array([limits.tangential_acceleration, limits.tangential_jerk])
    if np.isfinite(tangential).any():
        one, zero = np.ones((u.size, 1)), np.zeros((u.size, 1))
        t, k, z = np.append(t, one, axis=1), np.append(k, zero, axis=1), np.append(z, zero, axis=1)
        velocity = np.append(velocity, np.inf)
        acceleration, jerk = np.append(acceleration, tangential[0]), np.append(jerk, tangential[1])
    jerk = jerk * jerk_share[:, None]
    parts = t / velocity, t / acceleration, k / acceleration, t / jerk, 3.0 * k / jerk, z / jerk
    cap = np.minimum(limits.feed, chord_feed_limit(curve.tip.curvature(u, side=side), limits))
    v, a, j = (np.abs(parts[i]).max(axis=1) for i in (0, 2, 5))
    with np.errstate(divide="ignore"):
        return np.stack(parts, axis=1), cap, np.minimum.reduce([cap, 1.0 / v, a**-0.5, np.cbrt(1.0 / j)])


def _jump_zones(curve: Curve, limits: Limits, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Curvature jumps at u: arc length, largest feed, and the distance covered in three periods."""
    if u.size == 0:
        return u, u, u
    (t, before, *_), (_, after, *_) = (_arc_derivatives(curve, u, side) for side in ("left", "right"))
    s, step, window = curve.arclength.s(u), np.abs(after - before), _PERIODS_AROUND_STEP * limits.period
    with np.errstate(divide="ignore"):
        alone = np.sqrt((_STEP_SHARE * limits.jerk * limits.period / step).min(axis=1))
        gain = (limits.acceleration / np.abs(t)).min(axis=1) * window
        reach = np.minimum(window * np.minimum(alone + gain, limits.feed), curve.length)
        # steps within three periods of one another may add up
        total = np.append(np.zeros((1, step.shape[1])), np.cumsum(step, axis=0), axis=0)
        near = total[np.searchsorted(s, s + reach, side="right")] - total[np.searchsorted(s, s - reach)]
        return s, np.sqrt((_STEP_SHARE * limits.jerk * limits.period / near).min(axis=1)), reach


def _describe(curve: Curve, limits: Limits, u_start: float, u_end: float, fastest_end: float) -> _Path:
    """Lay the grid over a section and scale the limits on it."""
    inside = [b for b in curve.breaks if u_start < b.u < u_end]
    jumps, jump_feed, reach = _jump_zones(curve, limits, np.array([b.u for b in inside if b.geometric == 1]))
    length = curve.arclength
    s0, s1 = float(length.s(u_start)), float(length.s(u_end))
    # the feed allowed at a jump acts in a tiny cell on either side of it
    zones = np.concatenate([jumps + side * reach for side in (-1.0, -1e-3, 1e-3, 1.0)])
    at_s = np.clip(np.append(np.linspace(s0, s1, _EVEN_POINTS + 1), zones), s0, s1)
    edges = np.unique(np.clip(length.edges, u_start, u_end))
    panels = edges[:-1, None] + np.diff(edges)[:, None] * np.linspace(0.0, 1.0, _PANEL_POINTS, endpoint=False)
    even = np.linspace(u_start, u_end, _EVEN_POINTS + 1)
    u = np.concatenate([even, panels.reshape(-1), [b.u for b in inside], length.u(at_s)])
    for _ in range(_GRID_PASSES):
        u = np.unique(np.clip(u, u_start, u_end))
        u = u[np.append(True, np.diff(length.s(u)) > 1e-15 * s1)]
        s = length.s(u)
        middle = 0.5 * (s[1:] + s[:-1])
        near = np.searchsorted(np.sort(jumps - reach), middle) > np.searchsorted(np.sort(jumps + reach), middle)
        share = np.where(near, 0.5, 1.0)
        (rows, *first), (last_rows, *second) = (
            _limit_rows(curve, limits, at, side, share) for at, side in ((u[:-1], "right"), (u[1:], "left"))
        )
        slopes = last_rows - rows
        turns = np.abs(slopes[:, [0, 1, 3]]) > 2.0 * _GRID_CHANGE * np.abs(rows[:, [0, 1, 3]]).max(axis=0)
        with np.errstate(invalid="ignore"):
            far = np.abs(second[1] - first[1]) > _GRID_CHANGE * np.minimum(first[1], second[1])
        far |= turns.any(axis=(1, 2))
        if not far.any() or u.size + np.count_nonzero(far) > _MAX_GRID:
            break
        u = np.append(u, 0.5 * (u[:-1] + u[1:])[far])
    cap = np.minimum(first[0], second[0])
    limit = np.minimum(np.append(first[1], np.inf), np.append(np.inf, second[1]))
    at = np.searchsorted(s, jumps)
    np.minimum.at(limit, at, jump_feed)
    np.minimum.at(cap, np.append(at - 1, at), np.append(jump_feed, jump_feed))
    cruise = np.minimum(np.minimum(first[1], second[1]), cap)
    tops = _tops(float(cruise.max()), rows, s1 - s0, fastest_end, limits.period)
    v, a, _, j = tops
    shares = np.array([v, a, v * v, j, v * a, v**3])[:, None]
    bend = np.append(np.abs(slopes * shares), np.abs(rows * shares)[:, [2, 4, 5]], axis=1)
    curved = (bend > _ROUND_OFF).any(axis=(1, 2)).astype(float)
    limit, cruise = np.minimum(limit, v), np.minimum(cruise, v)
    # of a straight line, which is planned exactly, every phase is kept
    shortest = np.cbrt(_DIGITS * s1 * np.abs(rows[:, 3]).max() / _NOISE) if curved.any() else 0.0
    return _Path(s, rows, slopes, cap, limit, cruise, curved, tops, jumps[jump_feed < v], shortest)


def _tops(v: float, rows: FloatArray, length: float, fastest_end: float, period: float) -> FloatArray:
    """Largest feed, accelerations (up, down) and jerk on the path; finite ones that cost no time for those without limit."""
    with np.errstate(divide="ignore"):
        a, j = (float((1.0 / np.abs(rows[:, i]).max(axis=1)).max()) for i in (1, 3))
    if np.isfinite(a):
        v = min(v, np.sqrt(fastest_end**2 + 2.0 * a * length))
    elif np.isfinite(j):
        v = min(v, fastest_end + 2.0 * np.cbrt(j * length**2))
    if not np.isfinite(v):
        raise InputError("feed, velocity, acceleration and jerk are all inf; at least one of them must be finite")
    if not np.isfinite(j):
        j = min(a, v / period) / period  # the acceleration builds up within a period, which samples cannot resolve
    a = min(a, np.sqrt(v * j))
    return np.array([v, a, a, j])


# ---- blocks ---------------------------------------------------------------------------------------------------------


class _Ruckig:
    """One reusable ruckig problem: a block of length 1 with no acceleration at either end."""

    def __init__(self) -> None:
        import ruckig

        self._solver, self._failure = ruckig.Ruckig(1), ruckig.RuckigError
        self._problem, self._trajectory = ruckig.InputParameter(1), ruckig.Trajectory(1)
        self._problem.current_position = self._problem.current_acceleration = self._problem.target_acceleration = [0.0]
        self._problem.target_position = [1.0]

    def solve(self, v0: float, v1: float, v: float, up: float, down: float, jerk: float) -> tuple[list[float], ...] | None:
        """Durations and jerks of the seven phases, positions and velocities at their ends; None if ruckig finds none."""
        problem = self._problem
        problem.current_velocity, problem.target_velocity = [v0], [v1]
        problem.max_velocity, problem.max_jerk = [v], [jerk]
        problem.max_acceleration, problem.min_acceleration = [up], [-down]
        try:
            if self._solver.calculate(problem, self._trajectory) < 0:
                return None
        except self._failure:
            return None
        profile = self._trajectory.profiles[0][0]
        return profile.t, profile.j, profile.p, profile.v


def _trace(
    solver: _Ruckig, ends: FloatArray, tops: FloatArray, below: float | FloatArray = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow blocks from (s0, v0) to (s1, v1): ``ends (4, m)`` = s0, v0, s1, v1, ``tops (m, 4)``.

    Returns the duration (m,), inf where there is no block or none faster than ``below``; phase durations and jerks
    (2, m, 7); and the states s, v, a at the eight ends of the phases (3, m, 8).
    """
    s0, v0, s1, v1 = ends
    length, slow, fast = s1 - s0, np.minimum(v0, v1), np.maximum(v0, v1)
    v, up, down, jerk = np.maximum(tops[:, 0], fast), tops[:, 1], tops[:, 2], tops[:, 3]
    # Over less than the length that the change of feed takes, ruckig would overshoot and come back.
    change, a = fast - slow, np.where(v1 > v0, up, down)
    ramp = np.where(change * jerk > a * a, change / a + a / jerk, 2.0 * np.sqrt(change / jerk))
    some = np.flatnonzero((0.5 * (v0 + v1) * ramp <= length * (1.0 + _ROUND_OFF)) & (length / v < below))
    # Scaled so that the block has length 1 and its largest possible feed is 1.
    unit = np.minimum(v, fast + np.cbrt(jerk * length**2))
    tau = length / unit
    scaled = np.stack([v0 / unit, v1 / unit, v / unit, up * tau / unit, down * tau / unit, jerk * tau**2 / unit])
    solved = [solver.solve(*row) for row in scaled[:, some].T.tolist()]
    some = some[[found is not None for found in solved]]
    phases, time, states = np.zeros((2, v.size, 7)), np.full(v.size, np.inf), np.zeros((3, v.size, 8))
    if some.size:
        h, j, p, feeds = (np.array(part) for part in zip(*(found for found in solved if found is not None), strict=True))
        good = (feeds.min(axis=1) >= -_ROUND_OFF) & (np.abs(p[:, 7] - 1.0) <= _TOLERANCE)
        some, h, j, feeds = some[good], h[good], j[good], feeds[good]
        for first in (0, 4):  # a ramp between feeds that differ by rounding only is none
            same = np.abs(feeds[:, first + 3] - feeds[:, first]) <= _ROUND_OFF * feeds.max(axis=1)
            h[same, 3] += h[same, first : first + 3].sum(axis=1)
            h[same, first : first + 3] = 0.0
        phases[:, some] = tau[some, None] * h, np.where(h > 0.0, j * (unit / tau**2)[some, None], 0.0)
        time[some] = phases[0, some].sum(axis=1)
    states[0, :, 0], states[1, :, 0] = s0, v0
    for i in range(7):
        states[:, :, i + 1] = _advance(states[:, :, i], phases[1, :, i], phases[0, :, i])
    return np.where(time < below, time, np.inf), phases, states


def _advance(state: FloatArray, jerk: FloatArray, h: FloatArray) -> FloatArray:
    """Move s, v, a on by the time h at constant jerk."""
    s, v, a = state
    return np.stack([s + h * (v + h * (0.5 * a + h * jerk / 6.0)), v + h * (a + 0.5 * h * jerk), a + h * jerk])


def _durations(path: _Path, solver: _Ruckig, ends: FloatArray, tops: FloatArray, below: FloatArray) -> FloatArray:
    """Durations of blocks; inf where a limit is exceeded or the block is not faster than ``below`` (m,)."""
    if tops.shape[0] > _CHUNK:
        cuts = np.arange(_CHUNK, tops.shape[0], _CHUNK)
        parts = zip(np.split(ends, cuts, axis=1), np.split(tops, cuts), np.split(below, cuts), strict=True)
        return np.concatenate([_durations(path, solver, *part) for part in parts])
    time, phases, states = _trace(solver, ends, tops, below)
    cruising = np.isfinite(time) & (phases[0, :, 3] > 0.0)
    slow = path.lowest_cruise(states[0, :, 3], states[0, :, 4])
    time[cruising & (states[1, :, 3] > slow * (1.0 + _ROUND_OFF))] = np.inf
    time[((phases[0] > 0.0) & (phases[0] < path.shortest)).any(axis=1)] = np.inf
    ramps = np.isfinite(time)[:, None] & (phases[0] > 0.0) & (np.arange(7) != 3)
    block, phase = np.nonzero(ramps)
    cells = np.diff(np.searchsorted(path.s, states[0, block[:, None], phase[:, None] + np.arange(2)]), axis=1)[:, 0]
    count = np.maximum(cells // path.stride, _PHASE_POINTS)
    each, first = np.repeat(np.arange(count.size), count), np.cumsum(count) - count
    h, jerk = phases[:, block[each], phase[each]]
    at = _advance(states[:, block[each], phase[each]], jerk, h * (np.arange(each.size) - first[each]) / (count[each] - 1))
    time[block[each[path.used(*at, jerk) > 1.0 + _ROUND_OFF]]] = np.inf
    return time


# ---- first plan -----------------------------------------------------------------------------------------------------


def _nodes(path: _Path) -> FloatArray:
    """Places of the feed minima (both ends of a flat one), of the curvature jumps that count, and of the ends."""
    places = list(path.jumps)
    low = high = float(path.limit[0])
    first = last = 0
    falling = True
    for i, feed in enumerate(path.limit.tolist()):
        if falling:
            if feed < low * (1.0 - _TOLERANCE):
                low, first, last = feed, i, i
            elif feed <= low * (1.0 + _TOLERANCE):
                last = i
            elif feed > low * (1.0 + _MERGE):
                places += [path.s[first], path.s[last]]
                falling, high = False, feed
        elif feed > high:
            high = feed
        elif feed < high / (1.0 + _MERGE):
            falling, low, first, last = True, feed, i, i
    places = [s for s in places if path.s[0] < s < path.s[-1]]
    return np.unique([path.s[0], *places, path.s[-1]])


def _first_plan(path: _Path, solver: _Ruckig, start_feed: float, end_feed: float) -> _Plan | None:
    """Plan with tops dilated in time alone; None where the ends cannot have the feeds given."""
    s = _nodes(path)
    v = _FIRST_SHARE * np.interp(s, path.s, path.limit)
    v[0], v[-1] = start_feed, end_feed
    plan = _Plan(s, v, np.tile(path.tops, (s.size - 1, 1)), np.full(s.size - 1, np.inf))
    return plan if _make_feasible(path, solver, plan, _LOWER) else None


def _dilated(f: FloatArray) -> FloatArray:
    return f[:, None] ** np.array([1.0, 2.0, 2.0, 3.0])


def _make_feasible(path: _Path, solver: _Ruckig, plan: _Plan, lower: float) -> bool:
    """Dilate the blocks whose time is unknown, and lower node feeds, until they hold; False where that does not help."""
    given, last = plan.tops.copy(), plan.time.size
    count = _SLIGHTLY.size + _LADDER.size
    todo = np.flatnonzero(np.isinf(plan.time))
    while todo.size:
        slightly, wholly = given[todo, None] * _dilated(_SLIGHTLY), np.tile(path.tops * _dilated(_LADDER), (todo.size, 1, 1))
        each, tops = np.repeat(todo, count), np.append(slightly, wholly, axis=1).reshape(-1, 4)
        time = _durations(path, solver, plan.ends(each), tops, np.full(each.size, np.inf)).reshape(-1, count)
        best, rows = np.argmin(time, axis=1), np.arange(todo.size)
        plan.time[todo], plan.tops[todo] = time[rows, best], tops.reshape(todo.size, -1, 4)[rows, best]
        bad = todo[np.isinf(plan.time[todo])]
        faster = np.unique(np.where(plan.v[bad] > plan.v[bad + 1], bad, bad + 1))
        if ((faster == 0) | (faster == last) | (plan.v[faster] < _LOWEST * path.tops[0])).any():
            return False
        plan.v[faster] *= lower
        todo = np.union1d(faster - 1, faster)
    return True


def _infeasible(
    path: _Path, solver: _Ruckig, start_feed: float, end_feed: float, curve: Curve, u: tuple[float, float]
) -> InfeasibleError | SolverError:
    """Find out, by bisection, with which feed at the start, or else at the end, a plan exists."""
    for name, place, end, given in (("start_feed", u[0], 0, start_feed), ("end_feed", u[1], 1, end_feed)):

        def plans(feed: float, end: int = end) -> bool:
            feeds = (feed, end_feed) if end == 0 else (start_feed, feed)
            return _first_plan(path, solver, *feeds) is not None

        if given == 0.0 or not plans(0.0):
            continue
        lo, hi = 0.0, min(given, float(path.limit[-end]))
        if plans(hi):
            lo = hi
        while hi - lo > 1e-6 * hi:
            middle = 0.5 * (lo + hi)
            lo, hi = (middle, hi) if plans(middle) else (lo, middle)
        return InfeasibleError(
            f'{curve.name}: {name} = {given:.9g} mm/s is too fast at u = {place:.9g}; the largest allowed with method = "scurve" '
            f"is {lo:.6g} mm/s"
        )
    return SolverError(
        f"{curve.name}: no S-curves were found between u = {u[0]:.9g} and {u[1]:.9g} that hold every limit; use "
        'method = "optimal"'
    )


# ---- improvement ----------------------------------------------------------------------------------------------------


def _search(path: _Path, solver: _Ruckig, plan: _Plan) -> _Plan:
    """Improve a plan; add nodes as long as that pays."""
    before = np.inf
    for _ in range(_SPLITS + 1):
        _improve(path, solver, plan, _ROUNDS)
        now = float(plan.time.sum())
        if before - now < 2.0 * _GAIN * now or plan.time.size > _MANY:
            break
        before, plan = now, _split(path, solver, plan)
    return plan


def _improve(path: _Path, solver: _Ruckig, plan: _Plan, rounds: int) -> None:
    """Search the blocks, then every other node, in turn, until rounds gain next to nothing."""
    m = plan.time.size
    rounds = max(min(rounds, _TRIALS // (m * (_BLOCK_MOVES.shape[0] + 2 * _NODE_MOVES.shape[0]))), 2)
    block_step, node_step = np.full(m, _FIRST_STEP), np.full(m + 1, _FIRST_STEP)
    block_step[(plan.tops >= path.tops).all(axis=1)] = 0.0
    totals = [plan.time.sum()]
    for _ in range(rounds):
        _search_blocks(path, solver, plan, block_step)
        for parity in (1, 2):
            _search_nodes(path, solver, plan, np.arange(parity, m, 2), node_step, block_step)
        totals.append(plan.time.sum())
        if len(totals) > 5 and totals[-6] - totals[-1] < _GAIN * totals[-1]:
            break


def _search_blocks(path: _Path, solver: _Ruckig, plan: _Plan, step: FloatArray) -> None:
    """Try every direction of _BLOCK_MOVES on each block still searched; take the fastest, or halve the step."""
    some = np.flatnonzero(step > _SMALLEST_STEP)
    if some.size == 0:
        return
    count = _BLOCK_MOVES.shape[0]
    tops = np.minimum(plan.tops[some, None] * np.exp(step[some, None, None] * _BLOCK_MOVES), path.tops)
    each = np.repeat(some, count)
    time = _durations(path, solver, plan.ends(each), tops.reshape(-1, 4), plan.time[each]).reshape(-1, count)
    best, rows = np.argmin(time, axis=1), np.arange(some.size)
    won = time[rows, best] < plan.time[some] * (1.0 - 1e-6)
    plan.time[some[won]], plan.tops[some[won]] = time[rows[won], best[won]], tops[rows[won], best[won]]
    step[some] = np.where(won, np.minimum(1.5 * step[some], 1.0), 0.4 * step[some])


def _search_nodes(
    path: _Path, solver: _Ruckig, plan: _Plan, nodes: IntArray, step: FloatArray, block_step: FloatArray
) -> None:
    """Try every direction of _NODE_MOVES on nodes no two of which share a block."""
    nodes = nodes[step[nodes] > _SMALLEST_STEP]
    if nodes.size == 0:
        return
    count, h = _NODE_MOVES.shape[0], step[nodes, None]
    room = np.minimum(plan.s[nodes] - plan.s[nodes - 1], plan.s[nodes + 1] - plan.s[nodes])[:, None]
    v = plan.v[nodes, None] * np.exp(h * _NODE_MOVES[:, 0])
    room[np.isin(plan.s[nodes], path.jumps)] = 0.0
    s = plan.s[nodes, None] + 0.6 * h * room * _NODE_MOVES[:, 1]
    pace = np.exp(h * _NODE_MOVES[:, 2])[..., None] ** np.array([0.0, 1.0, 1.0, 1.0])
    tops = np.minimum(np.stack([plan.tops[nodes - 1], plan.tops[nodes]])[:, :, None] * pace, path.tops)
    each = np.repeat(nodes, count)
    left, right = plan.ends(each - 1), plan.ends(each)
    left[2], left[3] = right[0], right[1] = s.reshape(-1), v.reshape(-1)
    now = plan.time[nodes - 1] + plan.time[nodes]
    time = _durations(
        path, solver, np.concatenate([left, right], axis=1), tops.reshape(-1, 4), np.tile(np.repeat(now, count), 2)
    ).reshape(2, nodes.size, count)
    both = time.sum(axis=0)
    best, rows = np.argmin(both, axis=1), np.arange(nodes.size)
    won = both[rows, best] < now * (1.0 - 1e-6)
    at, r, b = nodes[won], rows[won], best[won]
    plan.s[at], plan.v[at] = s[r, b], v[r, b]
    for side in (0, 1):
        plan.time[at - 1 + side], plan.tops[at - 1 + side] = time[side, r, b], tops[side, r, b]
        block_step[at - 1 + side] = np.maximum(block_step[at - 1 + side], 0.1)
    step[nodes] = np.where(won, np.minimum(1.5 * step[nodes], 1.0), 0.5 * step[nodes])


def _split(path: _Path, solver: _Ruckig, plan: _Plan) -> _Plan:
    """Put a node into the middle of the cruise of every block that loses much time against the limit curve."""
    blocks = np.arange(plan.time.size)
    _, phases, states = _trace(solver, plan.ends(blocks), plan.tops)
    ideal = np.interp(plan.s, path.s, np.concatenate([[0.0], np.cumsum(np.diff(path.s) / path.cruise)]))
    loss = plan.time - np.diff(ideal)
    loss[(plan.tops >= path.tops).all(axis=1)] = 0.0
    at = np.flatnonzero((loss > _SPLIT_LOSS * plan.time.sum()) & (phases[0, :, 3] > 0.0))
    ends = plan.ends(at)
    s, v = 0.5 * (states[0, at, 3] + states[0, at, 4]), states[1, at, 3]
    halves = [
        _durations(path, solver, np.stack(part), plan.tops[at], np.full(at.size, np.inf))
        for part in ((ends[0], ends[1], s, v), (s, v, ends[2], ends[3]))
    ]
    same = halves[0] + halves[1] <= plan.time[at] * (1.0 + 1e-9)
    at, s, v, first, second = at[same], s[same], v[same], halves[0][same], halves[1][same]
    time = plan.time.copy()
    time[at] = first
    return _Plan(
        np.insert(plan.s, at + 1, s),
        np.insert(plan.v, at + 1, v),
        np.insert(plan.tops, at + 1, plan.tops[at], axis=0),
        np.insert(time, at + 1, second),
    )


# ---- time law -------------------------------------------------------------------------------------------------------


def _time_law(
    curve: Curve, limits: Limits, solver: _Ruckig, plan: _Plan, u_ends: tuple[float, float]
) -> Nodes:
    """Tabulate a plan: the nodes (t, u, u_rate, u_acceleration), and the block of each interval between them.

    Nodes stand where the jerk switches and on the curve's breaks; an interval is halved while its quintic is off.  With
    an error e(t) ~ t^3 (h - t)^3, the third derivative is off most at the ends, by d, and the first by 0.009 d h^2.
    """
    _, phases, states = _trace(solver, plan.ends(np.arange(plan.time.size)), plan.tops)
    block, phase = np.nonzero(phases[0] > 0.0)
    h, jerk = phases[:, block, phase]
    one = np.flatnonzero(np.append(True, (phase[1:] != 3) | (phase[:-1] != 3)))  # two cruises in a row are one
    block, phase, h, jerk = block[one], phase[one], np.add.reduceat(h, one), jerk[one]
    begin = states[:, block, phase]
    clock = np.append(0.0, np.cumsum(h))
    breaks = np.array([b.u for b in curve.breaks if u_ends[0] < b.u < u_ends[1]])
    cut, after = _crossings(begin, jerk, h, curve.arclength.s(breaks), _ON_BREAK * curve.length)
    # Intervals: the phase they start in, how long after its start, and the curve parameter where it is known exactly.
    of, since = np.append(np.arange(h.size), cut), np.append(np.zeros(h.size), after)
    known = np.concatenate([u_ends[:1], np.full(h.size - 1, np.nan), breaks])
    for _ in range(_LAW_PASSES):
        order = np.lexsort((np.isnan(known), since, of))
        order = order[np.append(True, (np.diff(of[order]) > 0) | (np.diff(since[order]) > 0.0))]
        of, since, known = of[order], since[order], known[order]
        t = np.append(clock[of] + since, clock[-1])
        gap = np.diff(t)
        state = np.append(_advance(begin[:, of], jerk[of], since), [[plan.s[-1]], [plan.v[-1]], [0.0]], axis=1)
        u = np.append(known, u_ends[1])
        u[np.isnan(u)] = np.clip(curve.arclength.u(state[0, np.isnan(u)]), *u_ends)
        law, per_jerk, per_feed = _rates_of_u(curve, limits, u[:-1], state[:, :-1], jerk[of], "right")
        end_law = np.append(law[:, 1:], np.zeros((3, 1)), axis=1)
        broken = np.flatnonzero(np.append(~np.isnan(known[1:]), True))
        end_law[:, broken] = _rates_of_u(curve, limits, u[broken + 1], state[:, broken + 1], jerk[of[broken]], "left")[0]
        c3 = quintic_coefficients(gap, (u[:-1], law[0], law[1]), (u[1:], end_law[0], end_law[1]))[3]
        noise = _rounding((t, u, law[0], law[1]), gap, np.arange(gap.size))[2]
        off = np.maximum(np.abs(6.0 * c3 - law[2]) - noise, 0.0)
        coarse = (off * per_jerk > _JERK_ERROR) | (0.009 * off * gap**2 * per_feed > _FEED_ERROR * states[1].max())
        if not coarse.any():
            break
        of, since = np.append(of, of[coarse]), np.append(since, (since + 0.5 * gap)[coarse])
        known = np.append(known, np.full(int(coarse.sum()), np.nan))
    jump = (np.abs(end_law[:2, :-1] - law[:2, 1:]) > _ROUND_OFF * np.abs(law[:2, 1:]).max(axis=1, keepdims=True)).any(axis=0)
    at = np.flatnonzero(jump) + 1
    rates = [np.insert(np.append(law[k], end_law[k, -1]), at, end_law[k, at - 1]) for k in (0, 1)]
    return np.insert(t, at, t[at]), np.insert(u, at, u[at]), rates[0], rates[1]


def _rounding(nodes: Nodes, gap: FloatArray, inner: IntArray) -> FloatArray:
    """What the last digits of u (found from s by inversion) and of t do to the quintics' derivatives 1, 2, 3; (3, n)."""
    t, u, rate, _ = nodes
    digit = (np.abs(u).max() + rate[inner] * t[inner + 1]) / gap ** np.array([[1.0], [2.0], [3.0]])
    return _DIGITS * np.array([[0.07], [0.25], [1.0]]) * digit


def _crossings(
    begin: FloatArray, jerk: FloatArray, h: FloatArray, s: FloatArray, near: float
) -> tuple[IntArray, FloatArray]:
    """Phase in which each place s is passed, and the time since its start (bisection; 0 where they coincide)."""
    phase = np.clip(np.searchsorted(begin[0], s + near, side="right") - 1, 0, h.size - 1)
    lo, hi = np.zeros(s.size), h[phase]
    for _ in range(60):
        middle = 0.5 * (lo + hi)
        short = _advance(begin[:, phase], jerk[phase], middle)[0] < s
        lo, hi = np.where(short, middle, lo), np.where(short, hi, middle)
    return phase, np.where(np.abs(s - begin[0, phase]) <= near, 0.0, 0.5 * (lo + hi))


def _rates_of_u(
    curve: Curve, limits: Limits, u: FloatArray, state: FloatArray, jerk: FloatArray, side: Side
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """First three time derivatives (3, n) of u from s, v, a and jerk; share of a jerk limit and feed per unit of them."""
    t, _, _, speed, speed1, speed2 = _arc_derivatives(curve, u, side)
    _, v, a = state
    u1 = v / speed
    u2 = (a - speed1 * u1**2) / speed
    u3 = (jerk - 3.0 * speed1 * u1 * u2 - speed2 * u1**3) / speed
    return np.stack([u1, u2, u3]), (np.abs(t) / limits.jerk).max(axis=1) * speed, speed


def _used_exactly(curve: Curve, limits: Limits, nodes: Nodes) -> tuple[FloatArray, FloatArray]:
    """Largest share of any limit used in each interval (n - 1,) of a time law, on the exact curve, but for rounding.

    Returns that share, and the share of a jerk limit that rounding of the nodes amounts to.
    """
    t, u, rate, acceleration = nodes
    inner = np.flatnonzero(np.diff(t) > 0.0)
    gap = np.diff(t)[inner]
    c = quintic_coefficients(
        gap, (u[inner], rate[inner], acceleration[inner]), (u[inner + 1], rate[inner + 1], acceleration[inner + 1])
    )
    w = np.linspace(0.0, 1.0, _CHECK_POINTS)[:, None] * gap
    at = c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))))
    at = np.clip(at, u[inner], u[inner + 1])
    u1 = c[1] + w * (2.0 * c[2] + w * (3.0 * c[3] + w * (4.0 * c[4] + w * 5.0 * c[5])))
    u2 = 2.0 * c[2] + w * (6.0 * c[3] + w * (12.0 * c[4] + w * 20.0 * c[5]))
    u3 = 6.0 * c[3] + w * (24.0 * c[4] + w * 60.0 * c[5])
    noise = _rounding(nodes, gap, inner)
    u1, u2, u3 = (x - np.clip(x, -noise[k], noise[k]) for k, x in enumerate((u1, u2, u3)))
    jumps = [b.u for b in curve.breaks if b.geometric == 1 and u[0] < b.u < u[-1]]
    jump_t = np.unique(t[np.isin(u, jumps)])
    when = t[inner] + w
    window = _PERIODS_AROUND_STEP * limits.period
    near = np.searchsorted(jump_t, when + window, side="right") > np.searchsorted(jump_t, when - window)
    used = np.zeros(when.shape)
    for some, side in ((slice(0, -1), "right"), (slice(-1, None), "left")):
        law = tuple(part[some].reshape(-1) for part in (at, u1, u2, u3))
        q = curve.derivatives(law[0], 3, side=side)
        _, v, a, j = (part[:, None] for part in law)
        jerk = limits.jerk * np.where(near[some].reshape(-1, 1), 0.5, 1.0)
        shares = [
            np.abs(q[1] * v) / limits.velocity,
            np.abs(q[2] * v**2 + q[1] * a) / limits.acceleration,
            np.abs(q[3] * v**3 + 3.0 * q[2] * v * a + q[1] * j) / jerk,
        ]
        feed, along, along_jerk = along_tip(curve, law, side)[1]
        shares += [np.abs(along / limits.tangential_acceleration)[:, None]]
        shares += [np.abs(along_jerk / limits.tangential_jerk)[:, None]]
        cap = np.minimum(limits.feed, chord_feed_limit(curve.tip.curvature(law[0], side=side), limits))
        shares += [(feed / cap)[:, None]]
        used[some] = np.concatenate(shares, axis=1).max(axis=1).reshape(used[some].shape)
    result = np.zeros((2, t.size - 1))
    result[0, inner] = used.max(axis=0)
    result[1, inner] = noise[2] * (np.abs(curve.derivatives(u[inner], 1)[1]) / limits.jerk).max(axis=1)
    return result[0], result[1]
