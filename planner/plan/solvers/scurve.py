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

The blocks are in ``scurve_blocks``, the search in ``scurve_search``.

Limitations.  The acceleration returns to zero at every node, and the jerk of a ramp is one number whatever the axes
would allow along it: up to 10 % above the optimum where acceleration rules, 30 % where jerk rules (the five-axis flank
path, bends of hundredths of a millimetre).  The search is local: another machine's rounding may move a duration by 1 %.
No bound on the time comes with it.  Where the tip rests while rotary axes move, there is no arc length to plan along;
bends of a few nanometres are corners in all but name, and may end in a SolverError.
"""

from __future__ import annotations

import numpy as np

from planner.errors import InfeasibleError, InputError, SolverError
from planner.geometry.curve import Curve
from planner.machine.limits import Limits, require_limits
from planner.plan.solvers.arcpath import (
    NOISE,
    ArcPath,
    LawColumns,
    describe,
    tabulate,
    used_exactly,
)
from planner.plan.solvers.scurve_blocks import (
    LADDER,
    SLIGHTLY,
    TOLERANCE,
    BlockPlan,
    Ruckig,
    block_phases,
    dilated_tops,
    durations,
)
from planner.plan.solvers.scurve_search import ROUNDS, improve, search_blocks_and_nodes
from planner.types import FloatArray

_MERGE = 0.05  # minima of the limit curve are merged unless the feed rises by this fraction between them
_FIRST_SHARE = 0.9  # of the limit curve
_LOWER, _LOWER_LITTLE, _LOWEST = 0.85, 0.98, 1e-6
_MARGIN = 1e-3  # kept from every limit where the path is curved, for what lies between grid points
_HELD = 5e-7  # above a limit, half of what a check grants: rounding, where a straight line uses all of its jerk
_APART = 4  # a phase is tried at one in so many points of the grid
_REPAIRS = 12
# A jerk switch that almost meets a break of the curve leaves an interval too short for double precision; the block is
# slowed by this factor to move the switch, at most so many times.
_NUDGE, _NUDGES = 0.998, 3


def plan_scurve(
    curve: Curve, limits: Limits, u_start: float, u_end: float, start_feed: float, end_feed: float
) -> LawColumns:
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
    base, solver = describe(curve, limits, u_start, u_end, max(start_feed, end_feed)), Ruckig()
    margin = np.full(base.cap.size, _MARGIN)
    path = base.with_margin(margin, _APART)
    plan = _first_plan(path, solver, start_feed, end_feed)
    if plan is None:
        raise _infeasible(path, solver, start_feed, end_feed, f"{curve.name}, u = {u_start:.9g} to {u_end:.9g}")
    plan = search_blocks_and_nodes(path, solver, plan)
    for repair in range(_REPAIRS):
        nodes = tabulate(curve, limits, (u_start, u_end), *block_phases(solver, plan))
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
        plan.tops[np.clip(block, 0, plan.time.size - 1)] *= dilated_tops(np.array([_NUDGE]))
        plan.time = durations(path, solver, plan.ends(np.arange(plan.time.size)), plan.tops)
        if not _make_feasible(path, solver, plan, _LOWER_LITTLE):
            break
        if bad.size:
            improve(path, solver, plan, ROUNDS // (4 + 2 * repair))
    worst = int(np.argmax(used))
    raise SolverError(
        f"{curve.name}: at u = {nodes[1][worst]:.9g} a limit is used to {used[worst]:.9g}, and no S-curves were found "
        'that hold it; use method = "optimal", or an exact stop there'
    )


def _node_places(path: ArcPath) -> FloatArray:
    """Places of the feed minima (both ends of a flat one), of the curvature jumps that count, and of the ends."""
    places = list(path.jumps)
    low = high = float(path.limit[0])
    first = last = 0
    falling = True
    for i, feed in enumerate(path.limit.tolist()):
        if falling:
            if feed < low * (1.0 - TOLERANCE):
                low, first, last = feed, i, i
            elif feed <= low * (1.0 + TOLERANCE):
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


def _first_plan(path: ArcPath, solver: Ruckig, start_feed: float, end_feed: float) -> BlockPlan | None:
    """Plan with tops dilated in time alone; None where the ends cannot have the feeds given."""
    s = _node_places(path)
    v = _FIRST_SHARE * np.interp(s, path.s, path.limit)
    v[0], v[-1] = start_feed, end_feed
    plan = BlockPlan(s, v, np.tile(path.tops, (s.size - 1, 1)), np.full(s.size - 1, np.inf))
    return plan if _make_feasible(path, solver, plan, _LOWER) else None


def _make_feasible(path: ArcPath, solver: Ruckig, plan: BlockPlan, lower: float) -> bool:
    """Dilate the blocks of unknown time, and lower node feeds by a factor, until they hold; False where that fails."""
    last = plan.time.size
    slightly, wholly = dilated_tops(SLIGHTLY), path.tops * dilated_tops(LADDER)
    todo = np.flatnonzero(np.isinf(plan.time))
    while todo.size:
        tops = np.append(plan.tops[todo, None] * slightly, np.tile(wholly, (todo.size, 1, 1)), axis=1)
        each = np.repeat(todo, tops.shape[1])
        time = durations(path, solver, plan.ends(each), tops.reshape(-1, 4)).reshape(tops.shape[:2])
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
    path: ArcPath, solver: Ruckig, start_feed: float, end_feed: float, where: str
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
