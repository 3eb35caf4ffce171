"""Where a plan changes its jerk: how much in every interval, and the places at which it switches.

On a grid that knows nothing of it a switch is smeared over an interval or two: the jerk goes from one level, on which it was
at a limit or along one, to another.  A straight jump at the time

    t_s = ( integral of j over [t_0, t_1] - j_1 t_1 + j_0 t_0 ) / (j_0 - j_1)

between the same two levels has the same integral: it leaves the axis with the same acceleration.  That is where the switch
is, to some tenths of an interval.  Where a macro ends within the smear, the jerk jumps part of the way at the double knot
there: that belongs to the same run.  Switches are looked for on grids without knots at switches alone; where there is one
already, the smear is on one side of it, and the formula does not settle.

Known limitation: along the largest speed the jerk is a matter of a solver's last digits and has no level; the switches to
and from there are left to the changes, which draw knots as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.plan.collocation import states_between
from planner.plan.rows import Constraints
from planner.plan.time_knots import JerkChanges
from planner.types import FloatArray

# A jerk that changes by less than this in an interval stays on its level; levels differ by more than the second.
_LEVEL, _SWITCH = 0.15, 0.25
# Where the speed is all along an interval within this of its largest, jerks are those of a solver's last digits.
_AT_CAP = 0.99995


def jerk_changes(problem: Constraints, states: FloatArray, time: FloatArray) -> JerkChanges:
    """Changes and switches of a solution: x, a, c ``states (3, n)`` at the knots, passed at the ``time (n,)``, s."""
    stride, n = problem.inner + 1, problem.h.size
    z = states_between(problem.h, states, problem.inner)
    empty = np.flatnonzero(problem.h == 0.0)
    rows = problem.jerk.r if len(problem.jerk) else problem.acceleration.r
    levels = np.empty((rows.shape[0], z.shape[1]))
    for level, row in zip(levels, rows, strict=True):  # one by one, which bounds the memory
        np.einsum("kp,kp->p", row, z[: row.shape[0]], out=level)
    levels *= np.sqrt(np.maximum(z[0], 0.0)) if len(problem.jerk) else 1.0
    np.clip(levels, -1.0, 1.0, out=levels)
    for k in range(1, stride):  # nothing is asked for between the knots of a double one
        levels[:, empty * stride + k] = levels[:, empty * stride]
    each = np.abs(np.diff(levels, axis=1)).reshape(rows.shape[0], n, stride).sum(axis=2)
    change = each.max(axis=0)
    at_cap = (z[0] / problem.cap)[:-1].reshape(n, stride).min(axis=1) > _AT_CAP
    # a jump at the end of a macro takes part of a smear beside it along
    switches = _switches(levels, change, at_cap, time, stride)
    change[at_cap | (problem.h == 0.0)] = 0.0  # a jump at a double knot is resolved
    return JerkChanges(time, change, switches)


def _switches(
    levels: FloatArray, change: FloatArray, at_cap: NDArray[np.bool_], time: FloatArray, stride: int
) -> FloatArray:
    """Increasing times at which a jump has the integral of the ``levels (m, p)`` over a run of intervals that change.

    Runs that are ``at_cap`` all along have none.
    """
    moving = np.diff(np.concatenate([[0], (change > _LEVEL).astype(np.int8), [0]]))
    first, last = np.flatnonzero(moving == 1), np.flatnonzero(moving == -1)
    free = np.append(0, np.cumsum(~at_cap))
    some = free[last] > free[first]
    first, last = first[some], last[some]
    h = np.diff(time)
    t = np.append((time[:-1, None] + h[:, None] * np.arange(stride) / stride).reshape(-1), time[-1])
    mean = 0.5 * (levels[:, 1:] + levels[:, :-1]) * np.repeat(h / stride, stride)
    integral = np.concatenate([np.zeros((levels.shape[0], 1)), np.cumsum(mean, axis=1)], axis=1)
    a, b = first * stride, last * stride
    before, after = levels[:, a], levels[:, b]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (integral[:, b] - integral[:, a] - after * t[b] + before * t[a]) / (before - after)
        found = (np.abs(after - before) > _SWITCH) & (at >= t[a]) & (at <= t[b])
    return np.sort(at[found])
