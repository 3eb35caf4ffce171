"""The jerk-limited optimum by a structured interior-point method.

The problem (see ``rows.py``): x = sigma_dot^2 is a cubic spline on the knots, so that a = x'/2 and c = x''/2 at
the knots are linked by linear dynamics over an interval of length h,

    x+ = x + 2h a + h^2 (2c + c+)/3,      a+ = a + h (c + c+)/2,

and everything is a function of (x, a, c) at the knots and, by the same cubic, at the points between (``collocation.py``).
We minimise

    sum_p w_p x_p^(-1/2)     subject to   |r . (x, a, c)| <= 1   or   |r . (x, a, c)| <= x^(-1/2)

or with bounds of two sizes, -b and B in place of -1 and 1.  Only the jerk rows are not convex: their bound
x^(-1/2) is.  That has a lucky consequence.  The linear prediction of a jerk row's slack after a step is never above the
true slack, so a step that is feasible to first order is feasible: once inside, every iterate is a valid plan, and the
method may stop at any time.

Rules of one iteration

1.  Eliminate slacks s and multipliers l point by point: a 3 x 3 Hessian and a gradient at every point.  Per point the
    objective and the jerk bounds contribute the curvature (w - Lam) 3/4 x^(-5/2), Lam the sum of its jerk multipliers.
2.  Newton step by a Riccati recursion over the knots: state (x, a, c), control the next c, scalar pivots.  One backward
    sweep factors, a backward and a forward one solve; the cost is linear in the number of knots, and nothing is squared
    that a spline basis would square.  If a pivot is not positive, negative curvature is dropped and the sweep repeated.
3.  Affine step first (complementarity 0), then the corrector of Mehrotra with the centring

        max( (gap_affine / gap)^3,  k D / gap ),     D = -grad(time) . step_affine,

    D being the time the linear model still hopes to gain, k = 2 until the gap is below 1e-2 and 1/4 from there on.  The
    second term is what makes the long way from a poor start short: multipliers may not vanish while the primal iterate is
    far away (without it 36 to more than 150 iterations, with it 15-22).  The corrector's products ds dl are those of the
    affine step times the root of its two lengths: the whole product overshoots, and the product of the lengths, a quarter
    where both are a half, as they are where slack and multiplier vanish together, takes 15 % more iterations.
4.  Separate primal and dual step lengths, a fraction clip(1 - gap/T, 0.9, 0.995) of the way to the boundary; x falls by
    90 % at most.  No line search is needed, by the consequence above.

It stops when sum(s l) is below 1e-6 of the time (less where some intervals take hardly any time) and no row is violated
by more than 1e-9.

End conditions.  A rest needs none: in the time of a law it is met by itself (``time_map.py``).  A prescribed feed fixes x at
the first or last knot, a prescribed acceleration a at the first, a periodic path equates both states: the first knot is
fixed in the root solve, the others are rows added by the Schur complement of a few extra sweeps.

Whether the KKT point found is the global optimum is answered by the lower bound of ``bounds.py``.  ``Lam <= w`` at
every point would be another proof, but the multipliers of neighbouring points share their load unevenly, so that it fails
at single points next to stops although the optimum is global.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import SolverError
from planner.plan.rows import Constraints
from planner.status import Status
from planner.types import FloatArray, Progress

GAP_TOLERANCE = 1e-6
BLOCK = 128  # points a block in the compiled core
_FINEST_GAP, _MIN_SHARE = 1e-10, 1e-3
_MAX_ITERATIONS = 150
_FEASIBLE = 1e-9
_VIOLATION_OF_GAP = 0.1  # where the solution is only on the way to another: a violation that is less than the gap
_HOPE = 2.0  # weight of the hoped-for gain in the centring
_WATCHED_WORK = 200_000  # points times iterations between looks at the clock
# Slacks at the start are at least this much of a bound, and the start of a warm one is slowed down to this share of it.
_MIN_SLACK, _MIN_WARM_SLACK, _WARM_INSIDE = 0.05, 1e-6, 0.9999
# Where a prescribed feed forbids to slow it down, some slacks are less than nothing: they begin so far from their boundary.
_MIN_FIXED_SLACK = 1e-3
# Relative gap of the waypoint, and of that of a solve which began at one: the next problem differs by less still.
_WAYPOINT_GAP, _NEXT_WAYPOINT_GAP = 1e-3, 3e-4
_NO_CAP = 1e300
_NO_BOUND = 1e9  # of a scaled row, in place of inf: the barrier of a bound so far away is flat


@dataclass(frozen=True, eq=False)
class Solution:
    """A solution of one section, in the units of its constraints.

    Attributes
    ----------
    x, a, c : (n,) arrays
        sigma_dot^2, sigma_ddot and its derivative at the knots.
    time : float
        Simpson sum of the time.
    status : Status
        OPTIMAL; else the iterate is feasible, but not optimal.
    iterations : int
    gap, residual : float
        sum(s l) / time, and the largest relative violation.
    cpu_s : float
        Computing time, CPU seconds.
    iterate : Iterate or None
        The interior point itself, from which sensitivities and bounds follow.
    """

    x: FloatArray
    a: FloatArray
    c: FloatArray
    time: float
    status: Status
    iterations: int
    gap: float
    residual: float
    cpu_s: float = np.nan
    iterate: Iterate | None = None
    waypoint: Waypoint | None = None


@dataclass(frozen=True, eq=False)
class Waypoint:
    """An interior point on the way to a solution: where to begin a problem that differs by little.

    A solution itself is a bad place to begin.  Its slacks and multipliers have gone to 0, and a small change leaves it on
    the wrong side of its own constraints.  An iterate whose gap is about as large as the change is well centred for both
    problems: 4-11 iterations from there, against 10-22 from the law alone.

    ``z (3, n)``: states at the knots; ``duals``: multipliers as in ``pairs``, of which few digits will do.
    """

    z: FloatArray
    duals: NDArray[np.float32]


class Iterate:
    """A point of the method: states at the knots, slacks and multipliers.

    ``z (3, n)``; ``pairs``: see ``solvers.h``.
    """

    def __init__(self, problem: Constraints, start: FloatArray | Waypoint, centring: float, inside: float) -> None:
        self.problem = problem
        sides = 2 * (len(problem.acceleration) + len(problem.jerk)) + 1
        self.iterations = np.zeros(1, dtype=np.int64)
        warm = isinstance(start, Waypoint)
        self.z = start.z.copy() if isinstance(start, Waypoint) else np.array(start)
        self.pairs = np.empty((-(-problem.cap.size // BLOCK), sides, 2, BLOCK), dtype=np.float32)
        self.pairs[-1] = 1.0  # what fills it up
        self._totals = np.zeros(4)
        # a prescribed feed does not scale with the rest
        free = np.isnan(problem.start) and np.isnan(problem.end)
        inside = (_WARM_INSIDE if warm else inside) if free else 0.0
        least = (_MIN_WARM_SLACK if free else _MIN_FIXED_SLACK) if warm else _MIN_SLACK
        duals = start.duals if isinstance(start, Waypoint) else None
        core.interior_begin(*self._arguments, inside, least, centring, duals, self.z, self.pairs, self._totals)
        priced = 3 if problem.periodic else int(not np.isnan(problem.end))
        fixed = int(not np.isnan(problem.start)) + int(not np.isnan(problem.start_slope))
        self._ends = fixed, priced
        self._work: FloatArray | None = None

    @cached_property
    def _arguments(self) -> tuple[Any, ...]:
        """The problem as the core takes it."""
        problem, accelerations, jerks = self.problem, self.problem.acceleration, self.problem.jerk
        bounds = np.minimum(np.concatenate([accelerations.bounds, jerks.bounds]), _NO_BOUND)
        return (
            *(problem.h, problem.h.size, problem.inner, problem.cap, problem.weight),
            *(len(accelerations), np.ascontiguousarray(accelerations.given), accelerations.factor),
            *(len(accelerations) + len(jerks), np.ascontiguousarray(jerks.given), jerks.factor, bounds),
        )

    def run(self, tolerance: float, most: int, feasible: float = _FEASIBLE) -> Status | None:
        """Iterate ``most`` times or until gap and violation are within tolerance; None where nothing else ends it."""
        if self._work is None:
            self._work = np.empty(core.interior_work(self.problem.h.size, self._ends[1]))
            self._totals[3] = 0.0
        ended = core.interior_run(
            *self._arguments,
            *self._ends,
            _HOPE,
            tolerance,
            feasible,
            most,
            self.z,
            self.pairs,
            self._work,
            self._totals,
            self.iterations,
        )
        return (None, Status.OPTIMAL, Status.SINGULAR, Status.NO_STEP)[ended]

    def waypoint(self) -> Waypoint:
        """A copy of the states and multipliers."""
        return Waypoint(self.z.copy(), self.pairs[:, :, 1].copy())

    def release(self) -> None:
        """Give back the memory of the Newton system; the next run builds it again."""
        self._work = None

    @property
    def gap(self) -> float:
        """sum(s l)."""
        return float(self._totals[0])

    @property
    def time(self) -> float:
        """Time by the weights of the points."""
        return float(self._totals[1])

    @property
    def residual(self) -> float:
        """Largest relative violation."""
        return float(self._totals[2])


def solve_interior(
    problem: Constraints,
    start: FloatArray | Waypoint,
    *,
    centring: float = 0.2,
    inside: float = 0.95,
    tolerance: float | None = None,
    deadline: float = np.inf,
    progress: Progress | None = None,
) -> Solution:
    """Solve one section.

    Parameters
    ----------
    problem : Constraints
    start : (3, n) array, or Waypoint
        x, a, c of a cubic spline at the knots, x > 0 (see :func:`start_from`); or where the solution of a problem on the
        same grid that differs by little came through (``centring`` and ``inside`` then follow from it).
    centring : float
        Initial sum(s l) as a share of the time: 0.2 for a rough start, 0.1 for a good one.
    inside : float
        Share of the limits that the start is slowed down to: less for a rough one.
    tolerance : float
        Relative gap at which to stop; if left out, 1e-6, or less where some intervals take hardly any time.
    deadline : float
        Value of ``time.perf_counter()`` at which to stop with the iterate at hand.
    progress : callable, optional
        Called with a message and the share done.

    Returns
    -------
    Solution

    Raises
    ------
    SolverError
        If no feasible iterate was found.
    """
    began = time.process_time()
    tolerance = _tolerance(problem) if tolerance is None else tolerance
    it = Iterate(problem, start, centring, inside)
    watched = progress is not None or deadline < np.inf
    at_once = max(1, _WATCHED_WORK // problem.cap.size) if watched else _MAX_ITERATIONS
    status: Status | None = None
    waypoint: Waypoint | None = None
    way_gap = _NEXT_WAYPOINT_GAP if isinstance(start, Waypoint) else _WAYPOINT_GAP
    while status is None:
        goal = tolerance if waypoint else max(tolerance, way_gap)
        # Only a problem with a prescribed feed violates anything on its way, to the last digit for many iterations.
        feasible = _FEASIBLE if goal <= GAP_TOLERANCE else _VIOLATION_OF_GAP * goal
        status = it.run(goal, min(at_once, _MAX_ITERATIONS - int(it.iterations[0])), feasible)
        if status is Status.OPTIMAL and goal > tolerance:
            waypoint = it.waypoint()
            status = Status.OPTIMAL if it.gap < tolerance * it.time and it.residual < _FEASIBLE else None
        if status is None and it.iterations[0] >= _MAX_ITERATIONS:
            status = Status.TOO_MANY
        elif status is None and it.residual < _FEASIBLE and time.perf_counter() > deadline:
            status = Status.BUDGET
        if progress is not None:
            progress("solving", max(0.0, min(1.0, np.log(max(it.gap / it.time, tolerance)) / np.log(tolerance))))
    it.release()
    count = int(it.iterations[0])
    if it.residual > feasible:
        given = not np.isnan([problem.start, problem.end]).all()
        raise SolverError(
            f"the interior-point method stopped after {count} iterations ({status.value}) with a violation of "
            f"{it.residual:.2g}{'; the entry or exit feed may not be attainable' if given else ''}"
        )
    x, a, c = it.z
    cpu = time.process_time() - began
    return Solution(x, a, c, it.time, status, count, it.gap / it.time, it.residual, cpu, it, waypoint)


def is_global(it: Iterate) -> bool:
    """Whether the iterate, an optimum, is the global one for sure: Lam <= w at every point.

    The Lagrangian is then a sum of convex functions, so that the point at which it is stationary is its minimum.
    Coincident points, those of a double knot, count as one.
    """
    problem = it.problem
    bounds = np.concatenate([problem.acceleration.bounds, problem.jerk.bounds])
    proven = core.sensitivity_proven(
        *(problem.h.size, problem.h, problem.inner, problem.weight, len(problem.acceleration), len(bounds), bounds),
        *(_FEASIBLE, it.pairs),
    )
    return bool(proven)


def _tolerance(problem: Constraints) -> float:
    """Relative gap that resolves the shortest interval too: the share of one row below a thousandth of its time."""
    full, middle = problem.h > 0.0, (problem.inner + 1) // 2
    share = problem.weight[middle :: problem.inner + 1][full] * problem.guess[:-1][full] ** -0.5
    rows = 2 * (1 + len(problem.acceleration) + len(problem.jerk)) * problem.cap.size
    return float(np.clip(_MIN_SHARE * rows * share.min() / share.sum(), _FINEST_GAP, GAP_TOLERANCE))


def start_from(problem: Constraints, x: FloatArray) -> FloatArray:
    """States (3, n) at the knots of the cubic spline with the values x (one a knot) as its control values.

    A spline's values lie between its control values, so a positive guess gives a positive start.
    """
    sigma = np.concatenate([[0.0], np.cumsum(problem.h)])
    knots = np.concatenate([[sigma[0]] * 3, sigma, [sigma[-1]] * 3])
    greville = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0
    inner = np.append(True, problem.h > 0.0)
    control = np.exp(np.interp(greville, sigma[inner], np.log(x[inner])))
    if problem.periodic:
        control[:3] = control[-3:] = min(control[0], control[-1])
    for value, edge in ((problem.start, slice(0, 3)), (problem.end, slice(-3, None))):
        if not np.isnan(value):
            control[edge] = value
    if not np.isnan(problem.start_slope):
        # x' at the first knot is three times the difference of the first two control values over the interval
        control[1] = problem.start + 2.0 / 3.0 * problem.start_slope * problem.h[0]
        control[2] = max(control[1], 0.5 * problem.start)
    return _knot_states(knots, control)


def _knot_states(knots: FloatArray, control: FloatArray) -> FloatArray:
    """x, a = x'/2 and c = x''/2 at the knots, (3, n), from the control values (n + 2,) of a cubic spline on knots (n + 6,).

    de Boor's triangle; x'' is linear between knots, its control values are its values (one-sided at a double knot).
    """
    n = knots.size - 6
    before2, before, at, after, after2 = (knots[k : k + n] for k in range(1, 6))
    low = ((after - at) * control[:-2] + (at - before2) * control[1:-1]) / (after - before2)
    high = ((after2 - at) * control[1:-1] + (at - before) * control[2:]) / (after2 - before)
    slope = 3.0 * np.diff(control) / (knots[4:-1] - knots[1:-4])
    bend = 2.0 * np.diff(slope) / (knots[4:-2] - knots[2:-4])
    share = (at - before) / (after - before)
    x, dx = (1.0 - share) * low + share * high, (1.0 - share) * slope[:-1] + share * slope[1:]
    return np.stack([x, 0.5 * dx, 0.5 * bend])
