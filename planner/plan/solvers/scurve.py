"""Jerk-limited S-curves between the feed minima of the limit curve: what industrial controls do today.

    feed |      limit curve .--------.
         |  __            .'  ______  '.          _______      o nodes, where the tangential acceleration is 0
         |'   '.  __    .'  .'      '. '.  __.--''             between them blocks: ramp up, cruise, ramp down, each
         |      ''  ''--o--'          '--o                     with its own top feed, accelerations up and down, jerk
         +--------------------------------------------- s      s: arc length of the tool tip

1. Limit curve: the largest feed that holds every limit where tangential acceleration and jerk are 0 (see ``arcpath``).
2. Nodes: its minima (shallow ones merged), the curvature jumps that count, and both ends of the section.
3. First plan: node feeds at 90 % of the limit curve.  Each block is the S-curve (by ruckig) whose tops are the largest
   ones on the path dilated in time, to f, f^2, f^2 and f^3, with the f of a ladder that is fastest and holds every limit
   at points along the block.  Where none holds, the faster end of the block is lowered.
4. Compass search (Kolda, Lewis, Torczon, SIAM Review 45 (2003) 385-482) over the tops of every block and over feed and
   place of every node.  A trial counts only if it holds the limits and saves time.  Then a node goes where one block is
   faster than two; a block that loses much against the limit curve gets one in the middle of its cruise, which changes
   nothing yet; and the search goes on.
5. The time law u(t) is checked densely on the exact curve.  Where it exceeds a limit, the margin there is raised and the
   blocks concerned go back to step 3.

Feasible, because no plan leaves but through the check of step 5.  On a straight line the first block tried is already
the time-optimal one.

Limitations.  The acceleration returns to zero at every node, and the jerk of a ramp is one number whatever the axes
would allow along it: up to 10 % above the optimum where acceleration rules, 30 % where jerk rules (the five-axis flank
path, bends of hundredths of a millimetre).  The search is local: another machine's rounding may move a duration by 1 %.
No bound on the time comes with it.  Where the tip rests while rotary axes move, there is no arc length to plan along;
bends of a few nanometres are corners in all but name, and may end in a SolverError.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import product

import numpy as np

from planner.errors import InfeasibleError, InputError, SolverError
from planner.geometry.curve import Curve
from planner.machine.limits import Limits, require_limits
from planner.plan.solvers.arcpath import (
    NOISE,
    ArcPath,
    IntArray,
    Nodes,
    advance_phase,
    describe,
    tabulate,
    used_exactly,
)
from planner.types import FloatArray

_MERGE = 0.05  # minima of the limit curve are merged unless the feed rises by this fraction between them
_FIRST_SHARE = 0.9  # of the limit curve
_LADDER: FloatArray = 0.9 ** np.arange(56.0)
_SLIGHTLY: FloatArray = np.array([1.0, 0.9995, 0.999, 0.998, 0.995, 0.99, 0.98, 0.96, 0.93])
_LOWER, _LOWER_LITTLE, _LOWEST = 0.85, 0.98, 1e-6
_MARGIN = 1e-3  # kept from every limit where the path is curved, for what lies between grid points
_ROUND_OFF, _TOLERANCE, _TINY = 1e-12, 1e-9, 1e-300
_HELD = 5e-7  # above a limit, half of what a check grants: rounding, where a straight line uses all of its jerk
_POINTS, _APART, _NEWTON_STEPS = 5, 4, 4  # a phase is tried at so many points evenly, and at one in so many of the grid
_CHUNK = 20_000  # blocks traced at once; bounds the memory
# Directions of the search.  Of a block: the logarithms of its top feed, accelerations up and down, and jerk.  Of a node:
# the logarithm of its feed, its place, and the pace of the ramps on both sides of it.
_UPWARDS = [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 1, 1, 1)]
_EXCHANGES = [(1, 0, 0, -0.7), (1, -1, -1, -1), (0, -0.7, 0, 1), (0, 0, -0.7, 1), (-0.7, 1, 0, 0), (-0.7, 0, 1, 0)]
_BLOCK_MOVES = np.array([*_UPWARDS, *_EXCHANGES], dtype=np.float64)
_NODE_MOVES = np.array([move for move in product((0.0, 1.0), (-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)) if any(move)])
_FIRST_STEP, _MIN_STEP, _RESUMED_STEP = 0.4, 4e-3, 0.1
_LARGER, _SMALLER = 1.5, 0.45
_GAIN = 1e-6  # the least saving that makes a trial count
_ROUNDS, _PATIENCE, _WORTH = 30, 5, 1e-3  # a search ends when its last five rounds saved less than this fraction
_TRIALS, _MANY = 60_000, 60  # blocks tried in one search; more blocks than this get no further nodes
_SPLIT_LOSS, _SPLITS = 4e-3, 4
_REPAIRS = 12
# A jerk switch that almost meets a break of the curve leaves an interval too short for double precision; the block is
# slowed by this factor to move the switch, at most so many times.
_NUDGE, _NUDGES = 0.998, 3


@dataclass
class _Plan:
    """Nodes, m + 1 places s with feeds v, and the m blocks between them: tops (m, 4), time (m,), inf where unknown."""

    s: FloatArray
    v: FloatArray
    tops: FloatArray
    time: FloatArray

    def ends(self, first: IntArray, last: IntArray | None = None) -> FloatArray:
        """Places and feeds (s0, v0, s1, v1) at the nodes ``first`` and ``last`` (the next ones), (4, n)."""
        last = first + 1 if last is None else last
        return np.stack([self.s[first], self.v[first], self.s[last], self.v[last]])


def plan_scurve(
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
        If there is a corner inside, the tip rests along the section, or nothing limits the feed.
    SolverError
        If no plan was found that holds every limit.
    """
    limits = require_limits(curve, limits)
    corners = [b.u for b in curve.breaks if b.is_corner and u_start < b.u < u_end]
    if corners:
        raise InputError(
            f"{curve.name}: the corner at u = {corners[0]:.9g} must be an exact stop, the end of a section"
        )
    base, solver = describe(curve, limits, u_start, u_end, max(start_feed, end_feed)), _Ruckig()
    margin = np.full(base.cap.size, _MARGIN)
    path = base.with_margin(margin, _APART)
    plan = _first_plan(path, solver, start_feed, end_feed)
    if plan is None:
        raise _infeasible(path, solver, start_feed, end_feed, f"{curve.name}, u = {u_start:.9g} to {u_end:.9g}")
    plan = _search(path, solver, plan)
    for repair in range(_REPAIRS):
        nodes = tabulate(curve, limits, (u_start, u_end), *_phases(solver, plan))
        used, noise = used_exactly(curve, limits, nodes)
        bad, short = (
            np.flatnonzero(used > 1.0 + _HELD),
            np.flatnonzero((noise > NOISE) & base.curved.any()),
        )
        if bad.size == 0 and (short.size == 0 or repair >= _NUDGES):
            return nodes
        places = curve.arclength.s(nodes[1])
        for i in bad:
            first, last = np.searchsorted(base.s, places[i : i + 2]) + np.array([-2, 1]) * (1 + repair)
            near = slice(max(first, 0), last)
            margin[near] += np.maximum(1.2 * (used[i] - 1.0), 0.5 * margin[near])
        path = base.with_margin(margin, max(_APART >> (repair + 1) // 2, 1))
        block = np.searchsorted(plan.s, 0.5 * (places[short] + places[short + 1])) - 1
        plan.tops[np.clip(block, 0, plan.time.size - 1)] *= _dilated(np.array([_NUDGE]))
        plan.time = _durations(path, solver, plan.ends(np.arange(plan.time.size)), plan.tops)
        if not _make_feasible(path, solver, plan, _LOWER_LITTLE):
            break
        if bad.size:
            _improve(path, solver, plan, _ROUNDS // (4 + 2 * repair))
    worst = int(np.argmax(used))
    raise SolverError(
        f"{curve.name}: at u = {nodes[1][worst]:.9g} a limit is used to {used[worst]:.9g}, and no S-curves were found "
        'that hold it; use method = "optimal", or an exact stop there'
    )


# ---- blocks ---------------------------------------------------------------------------------------------------------


class _Ruckig:
    """One reusable ruckig problem: a block of length 1 with no acceleration at either end."""

    def __init__(self) -> None:
        import ruckig

        self._solver, self._failure = ruckig.Ruckig(1), ruckig.RuckigError
        self._problem, self._trajectory = ruckig.InputParameter(1), ruckig.Trajectory(1)
        self._problem.current_position = self._problem.current_acceleration = self._problem.target_acceleration = [0.0]
        self._problem.target_position = [1.0]

    def solve(
        self, v0: float, v1: float, v: float, up: float, down: float, jerk: float
    ) -> tuple[list[float], ...] | None:
        """Durations and jerks of the seven phases, positions and feeds at their ends; None if ruckig finds none."""
        problem = self._problem
        problem.current_velocity, problem.target_velocity = [v0], [v1]
        problem.max_velocity, problem.max_jerk = [v], [jerk]
        for less in (1.0, 1.0 - 1e-13):  # where the acceleration is just reached, ruckig may find nothing
            problem.max_acceleration, problem.min_acceleration = [up * less], [-down * less]
            with suppress(self._failure):
                if self._solver.calculate(problem, self._trajectory) >= 0:
                    profile = self._trajectory.profiles[0][0]
                    return profile.t, profile.j, profile.p, profile.v
        return None


def _trace(
    solver: _Ruckig, ends: FloatArray, tops: FloatArray, below: float | FloatArray = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow blocks from (s0, v0) to (s1, v1): ``ends (4, m)`` = s0, v0, s1, v1, ``tops (m, 4)``.

    Returns the duration (m,), inf where there is no block or none faster than ``below``; phase durations and jerks
    (2, m, 7); and the states s, v, a at the eight ends of the phases (3, m, 8).
    """
    s0, v0, s1, v1 = ends
    length, fast, change = s1 - s0, np.maximum(v0, v1), np.abs(v1 - v0)
    v, up, down, jerk = np.maximum(tops[:, 0], fast), tops[:, 1], tops[:, 2], tops[:, 3]
    # Over less than the length that the change of feed takes, ruckig would overshoot and come back.
    a = np.where(v1 > v0, up, down)
    ramp = np.where(change * jerk > a * a, change / a + a / jerk, 2.0 * np.sqrt(change / jerk))
    some = np.flatnonzero((0.5 * (v0 + v1) * ramp <= length * (1.0 + _ROUND_OFF)) & (length / v < below))
    # Scaled so that the block has length 1 and its largest possible feed is 1.
    unit = np.minimum(v, fast + np.cbrt(jerk * length**2))
    tau = length / unit
    scaled = np.stack([v0 / unit, v1 / unit, v / unit, up * tau / unit, down * tau / unit, jerk * tau**2 / unit])
    solved = [solver.solve(*row) for row in scaled[:, some].T.tolist()]
    some = some[np.array([found is not None for found in solved], dtype=bool)]
    phases, time, states = np.zeros((2, v.size, 7)), np.full(v.size, np.inf), np.zeros((3, v.size, 8))
    if some.size:
        h, j, p, feeds = (
            np.array(part) for part in zip(*(found for found in solved if found is not None), strict=True)
        )
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
        states[:, :, i + 1] = advance_phase(states[:, :, i], phases[1, :, i], phases[0, :, i])
    return np.where(time < below, time, np.inf), phases, states


def _durations(
    path: ArcPath, solver: _Ruckig, ends: FloatArray, tops: FloatArray, below: FloatArray | None = None
) -> FloatArray:
    """Durations of blocks (m,); inf where a limit is exceeded or the block is not faster than ``below`` (m,)."""
    below = np.full(tops.shape[0], np.inf) if below is None else below
    if tops.shape[0] > _CHUNK:
        cuts = np.arange(_CHUNK, tops.shape[0], _CHUNK)
        parts = zip(np.split(ends, cuts, axis=1), np.split(tops, cuts), np.split(below, cuts), strict=True)
        return np.concatenate([_durations(path, solver, *part) for part in parts])
    time, phases, states = _trace(solver, ends, tops, below)
    active = phases[0] > 0.0
    slow = states[1, :, 3] > path.lowest_cruise(states[0, :, 3], states[0, :, 4]) * (1.0 + _ROUND_OFF)
    time[(active[:, 3] & slow) | (active & (phases[0] < path.shortest)).any(axis=1)] = np.inf
    ramps = active & (np.arange(7) != 3)
    for pick in (_spread, _at_trial_places):  # the few points of the first refute most blocks
        block, phase = np.nonzero(np.isfinite(time)[:, None] & ramps)
        h, jerk, begin = *phases[:, block, phase], states[:, block, phase]
        each, since = pick(path, h, jerk, begin, states[:2, block, phase + 1])
        s, v, a = advance_phase(begin[:, each], jerk[each], since)
        used = path.used(s, v, a, jerk[each])
        time[block[each[used > 1.0 + _ROUND_OFF]]] = np.inf
    return time


def _spread(
    path: ArcPath, h: FloatArray, jerk: FloatArray, begin: FloatArray, end: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Times since the beginning of phases (m,), spread evenly, and the phase each belongs to."""
    return np.repeat(np.arange(h.size), _POINTS), (h[:, None] * np.linspace(0.0, 1.0, _POINTS)).reshape(-1)


def _at_trial_places(
    path: ArcPath, h: FloatArray, jerk: FloatArray, begin: FloatArray, end: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The same for the places at which the path asks for a trial: Newton from the time constant acceleration takes."""
    first, last = (np.searchsorted(path.trials, s) for s in (begin[0], end[0]))
    count = last - first
    each = np.repeat(np.arange(h.size), count)
    s = path.trials[np.arange(each.size) + np.repeat(first - np.cumsum(count) + count, count)]
    (s0, v0, _), (s1, v1), jerk = begin[:, each], end[:, each], jerk[each]
    mean = v0 + np.sqrt(np.maximum(v0**2 + (v1**2 - v0**2) * (s - s0) / np.maximum(s1 - s0, _TINY), 0.0))
    since = np.minimum(2.0 * (s - s0) / np.maximum(mean, _TINY), h[each])
    for _ in range(_NEWTON_STEPS):
        at = advance_phase(begin[:, each], jerk, since)
        since = np.clip(since - (at[0] - s) / np.maximum(at[1], _TINY), 0.0, h[each])
    return each, since


def _phases(solver: _Ruckig, plan: _Plan) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Phases of a plan: durations and jerks (n,), and states (3, n + 1) at their beginnings and at the end."""
    _, phases, states = _trace(solver, plan.ends(np.arange(plan.time.size)), plan.tops)
    # A block ends some digits off its end.  What that adds to the jerk of a phase goes with 1 / h^3, so h^3 shares it out.
    share = np.cumsum(phases[0] ** 3, axis=1)
    share /= np.where(share[:, -1:] > 0.0, share[:, -1:], 1.0)
    states[0, :, 1:] += (plan.s[1:] - states[0, :, -1])[:, None] * share
    resolved = 4.0 * np.finfo(np.float64).eps * plan.time.sum()  # a shorter phase begins and ends at one time
    block, phase = np.nonzero(phases[0] > resolved)
    begin = np.flatnonzero(np.append(True, (phase[1:] != 3) | (phase[:-1] != 3)))  # two cruises in a row are one
    h = np.add.reduceat(phases[0, block, phase], begin)
    block, phase = block[begin], phase[begin]
    end = np.array([[plan.s[-1]], [plan.v[-1]], [0.0]])
    return h, phases[1, block, phase], np.append(states[:, block, phase], end, axis=1)


# ---- first plan -----------------------------------------------------------------------------------------------------


def _node_places(path: ArcPath) -> FloatArray:
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


def _first_plan(path: ArcPath, solver: _Ruckig, start_feed: float, end_feed: float) -> _Plan | None:
    """Plan with tops dilated in time alone; None where the ends cannot have the feeds given."""
    s = _node_places(path)
    v = _FIRST_SHARE * np.interp(s, path.s, path.limit)
    v[0], v[-1] = start_feed, end_feed
    plan = _Plan(s, v, np.tile(path.tops, (s.size - 1, 1)), np.full(s.size - 1, np.inf))
    return plan if _make_feasible(path, solver, plan, _LOWER) else None


def _dilated(f: FloatArray) -> FloatArray:
    """Factors (n, 4) of a block's tops that stretch its time by 1/f."""
    return np.asarray(f[:, None] ** np.array([1.0, 2.0, 2.0, 3.0]))


def _make_feasible(path: ArcPath, solver: _Ruckig, plan: _Plan, lower: float) -> bool:
    """Dilate the blocks of unknown time, and lower node feeds by a factor, until they hold; False where that fails."""
    last = plan.time.size
    slightly, wholly = _dilated(_SLIGHTLY), path.tops * _dilated(_LADDER)
    todo = np.flatnonzero(np.isinf(plan.time))
    while todo.size:
        tops = np.append(plan.tops[todo, None] * slightly, np.tile(wholly, (todo.size, 1, 1)), axis=1)
        each = np.repeat(todo, tops.shape[1])
        time = _durations(path, solver, plan.ends(each), tops.reshape(-1, 4)).reshape(tops.shape[:2])
        best, rows = np.argmin(time, axis=1), np.arange(todo.size)
        plan.time[todo], plan.tops[todo] = time[rows, best], tops[rows, best]
        bad = todo[np.isinf(plan.time[todo])]
        faster = np.unique(np.where(plan.v[bad] > plan.v[bad + 1], bad, bad + 1))
        if ((faster == 0) | (faster == last) | (plan.v[faster] < _LOWEST * path.tops[0])).any():
            return False
        plan.v[faster] *= lower
        todo = np.union1d(faster - 1, faster)
        plan.time[todo] = np.inf
    return True


def _infeasible(
    path: ArcPath, solver: _Ruckig, start_feed: float, end_feed: float, where: str
) -> InfeasibleError | SolverError:
    """Find by bisection with which feed at the start, or else at the end, there is a plan."""

    def plans(*feeds: float) -> bool:
        return _first_plan(path, solver, *feeds) is not None

    for name, end, given in (("start_feed", 0, start_feed), ("end_feed", -1, end_feed)):
        feeds = [start_feed, end_feed]
        feeds[end] = 0.0
        if given == 0.0 or not plans(*feeds):
            continue
        lo, hi = 0.0, min(given, float(path.limit[end]))
        feeds[end] = hi
        if plans(*feeds):
            lo = hi
        while hi - lo > 1e-6 * hi:
            feeds[end] = 0.5 * (lo + hi)
            lo, hi = (feeds[end], hi) if plans(*feeds) else (lo, feeds[end])
        return InfeasibleError(
            f'{where}: {name} = {given:.9g} mm/s is too fast; the largest that method = "scurve" can use is {lo:.6g} mm/s'
        )
    return SolverError(f'{where}: no S-curves were found that hold every limit; use method = "optimal"')


# ---- improvement ----------------------------------------------------------------------------------------------------


def _search(path: ArcPath, solver: _Ruckig, plan: _Plan) -> _Plan:
    """Improve a plan; remove and add nodes as long as that pays."""
    if plan.time.size > _MANY:
        plan = _merge(path, solver, plan)
    before = np.inf
    for _ in range(_SPLITS + 1):
        _improve(path, solver, plan, _ROUNDS)
        plan = _merge(path, solver, plan)
        now = float(plan.time.sum())
        if before - now < 2.0 * _WORTH * now or plan.time.size > _MANY:
            break
        before, plan = now, _split(path, solver, plan)
    return plan


def _improve(path: ArcPath, solver: _Ruckig, plan: _Plan, rounds: int) -> None:
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
        if len(totals) > _PATIENCE and totals[-1 - _PATIENCE] - totals[-1] < _WORTH * totals[-1]:
            break


def _search_blocks(path: ArcPath, solver: _Ruckig, plan: _Plan, step: FloatArray) -> None:
    """Try every direction on each block still searched; take the fastest, or shorten the step."""
    some = np.flatnonzero(step > _MIN_STEP)
    if some.size == 0:
        return
    tops = np.minimum(plan.tops[some, None] * np.exp(step[some, None, None] * _BLOCK_MOVES), path.tops)
    each = np.repeat(some, tops.shape[1])
    time = _durations(path, solver, plan.ends(each), tops.reshape(-1, 4), plan.time[each]).reshape(tops.shape[:2])
    best, rows = np.argmin(time, axis=1), np.arange(some.size)
    won = time[rows, best] < plan.time[some] * (1.0 - _GAIN)
    plan.time[some[won]], plan.tops[some[won]] = time[rows[won], best[won]], tops[rows[won], best[won]]
    step[some] = np.where(won, np.minimum(_LARGER * step[some], 1.0), _SMALLER * step[some])


def _search_nodes(
    path: ArcPath, solver: _Ruckig, plan: _Plan, nodes: IntArray, step: FloatArray, block_step: FloatArray
) -> None:
    """Try every direction on nodes no two of which share a block; a node on a curvature jump stays there."""
    nodes = nodes[step[nodes] > _MIN_STEP]
    if nodes.size == 0:
        return
    count, h = _NODE_MOVES.shape[0], step[nodes, None]
    room = np.minimum(plan.s[nodes] - plan.s[nodes - 1], plan.s[nodes + 1] - plan.s[nodes])
    room[np.isin(plan.s[nodes], path.jumps)] = 0.0
    v = plan.v[nodes, None] * np.exp(h * _NODE_MOVES[:, 0])
    s = plan.s[nodes, None] + 0.6 * h * room[:, None] * _NODE_MOVES[:, 1]
    pace = np.exp(h * _NODE_MOVES[:, 2])[..., None] ** np.array([0.0, 1.0, 1.0, 1.0])
    tops = np.minimum(np.stack([plan.tops[nodes - 1], plan.tops[nodes]])[:, :, None] * pace, path.tops)
    each, now = np.repeat(nodes, count), plan.time[nodes - 1] + plan.time[nodes]
    ends = np.stack([plan.ends(each - 1), plan.ends(each)], axis=1)
    ends[2, 0] = ends[0, 1] = s.reshape(-1)
    ends[3, 0] = ends[1, 1] = v.reshape(-1)
    below = np.tile(np.repeat(now, count), 2)
    time = _durations(path, solver, ends.reshape(4, -1), tops.reshape(-1, 4), below).reshape(2, nodes.size, count)
    both = time.sum(axis=0)
    best, rows = np.argmin(both, axis=1), np.arange(nodes.size)
    won = both[rows, best] < now * (1.0 - _GAIN)
    at, r, b = nodes[won], rows[won], best[won]
    plan.s[at], plan.v[at] = s[r, b], v[r, b]
    for side in (0, 1):
        plan.time[at - 1 + side], plan.tops[at - 1 + side] = time[side, r, b], tops[side, r, b]
        block_step[at - 1 + side] = np.maximum(block_step[at - 1 + side], _RESUMED_STEP)
    step[nodes] = np.where(won, np.minimum(_LARGER * step[nodes], 1.0), _SMALLER * step[nodes])


def _merge(path: ArcPath, solver: _Ruckig, plan: _Plan) -> _Plan:
    """Remove nodes, none on a curvature jump and no two of one block at once, where one block is faster than two."""
    parity, unchanged = 1, 0
    while unchanged < 2:
        nodes = np.arange(parity, plan.time.size, 2)
        nodes = nodes[~np.isin(plan.s[nodes], path.jumps)]
        wholly = np.broadcast_to(path.tops * _dilated(_LADDER), (nodes.size, _LADDER.size, 4))
        either = np.maximum(plan.tops[nodes - 1], plan.tops[nodes])[:, None] * _dilated(_LADDER[: _SLIGHTLY.size])
        tops = np.append(wholly, either, axis=1)
        each, now = np.repeat(nodes, tops.shape[1]), plan.time[nodes - 1] + plan.time[nodes]
        ends, below = plan.ends(each - 1, each + 1), np.repeat(now, tops.shape[1])
        time = _durations(path, solver, ends, tops.reshape(-1, 4), below).reshape(tops.shape[:2])
        best, rows = np.argmin(time, axis=1), np.arange(nodes.size)
        won = time[rows, best] < now * (1.0 - _GAIN)
        gone = nodes[won]
        plan.time[gone - 1], plan.tops[gone - 1] = time[rows, best][won], tops[rows, best][won]
        s, v, tops, time = (np.delete(part, gone, axis=0) for part in (plan.s, plan.v, plan.tops, plan.time))
        plan = _Plan(s, v, tops, time)
        parity, unchanged = 3 - parity, 0 if gone.size else unchanged + 1
    return plan


def _split(path: ArcPath, solver: _Ruckig, plan: _Plan) -> _Plan:
    """Put a node into the middle of the cruise of every block that loses much time against the limit curve."""
    _, phases, states = _trace(solver, plan.ends(np.arange(plan.time.size)), plan.tops)
    ideal = np.interp(plan.s, path.s, np.append(0.0, np.cumsum(np.diff(path.s) / path.cruise)))
    loss = plan.time - np.diff(ideal)
    loss[(plan.tops >= path.tops).all(axis=1)] = 0.0
    at = np.flatnonzero((loss > _SPLIT_LOSS * plan.time.sum()) & (phases[0, :, 3] > 0.0))
    s, v = 0.5 * (states[0, at, 3] + states[0, at, 4]), states[1, at, 3]
    before, after = plan.ends(at), plan.ends(at)
    before[2], before[3], after[0], after[1] = s, v, s, v
    first, second = (_durations(path, solver, ends, plan.tops[at]) for ends in (before, after))
    same = first + second <= plan.time[at] * (1.0 + _TOLERANCE)
    at = at[same]
    time = plan.time.copy()
    time[at] = first[same]
    return _Plan(
        np.insert(plan.s, at + 1, s[same]),
        np.insert(plan.v, at + 1, v[same]),
        np.insert(plan.tops, at + 1, plan.tops[at], axis=0),
        np.insert(time, at + 1, second[same]),
    )
