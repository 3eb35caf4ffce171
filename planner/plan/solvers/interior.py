"""The jerk-limited optimum by a structured interior-point method.

The problem (see ``rows.py``): x = sigma_dot^2 is a cubic spline on the knots, so that a = x'/2 and c = x''/2 at
the knots are linked by linear dynamics over an interval of length h,

    x+ = x + 2h a + h^2 (2c + c+)/3,      a+ = a + h (c + c+)/2,

and everything is a function of (x, a, c) at the knots and, by the same cubic, at the points between (``collocation.py``).
We minimise

    sum_p w_p x_p^(-1/2)     subject to   |r . (x, a, c)| <= 1   or   |r . (x, a, c)| <= x^(-1/2)

or with bounds of two sizes, -b and B in place of -1 and 1 (``sides``).  Only the jerk rows are not convex: their bound
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

        max( (gap_affine / gap)^3,  2 D / gap ),     D = -grad(time) . step_affine,

    D being the time the linear model still hopes to gain.  The second term is what makes the long way from a poor start
    short: multipliers may not vanish while the primal iterate is far away (without it 23-81 iterations, with it 15-23).
4.  Separate primal and dual step lengths, a fraction clip(1 - gap/T, 0.9, 0.995) of the way to the boundary; x falls by
    90 % at most.  No line search is needed, by the consequence above.

It stops when sum(s l) is below 1e-6 of the time (less where some intervals take hardly any time) and no row is violated
by more than 1e-9.

End conditions.  A rest needs none (the rest map).  A prescribed feed fixes x at the first or last knot, a prescribed
acceleration a at the first, a periodic path equates both states: the first knot is fixed in the root solve, the others are
rows added by the Schur complement of a few extra sweeps.

Whether the KKT point found is the global optimum is answered by the lower bound of ``bounds.py``.  ``Lam <= w`` at
every point would be another proof, but the multipliers of neighbouring points share their load unevenly, so that it fails
at single points next to stops although the optimum is global.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from planner.errors import SolverError
from planner.geometry.differential import dot
from planner.plan.collocation import states_between
from planner.plan.rows import Constraints
from planner.status import Status
from planner.types import FloatArray, Progress

GAP_TOLERANCE = 1e-6
_FINEST_GAP, _MIN_SHARE = 1e-10, 1e-3
_MAX_ITERATIONS = 150
_FEASIBLE = 1e-9
_HOPE = 2.0  # weight of the hoped-for gain in the centring
_MAX_FALL = 0.9
# Slacks at the start are at least this much of a bound, and the start of a warm one is slowed down to this share of it.
_MIN_SLACK, _MIN_WARM_SLACK, _WARM_INSIDE = 0.05, 1e-6, 0.9999
_WAYPOINT_GAP = 3e-3
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
    problems: 4-10 iterations from there, against 9-20 from the law alone.

    ``z (3, p)``: states at all points; ``dual (m, 2, p)``: multipliers.  The solve that begins here takes both arrays over.
    """

    z: FloatArray
    dual: FloatArray


class Iterate:
    """The arrays of one solve, allocated once."""

    def __init__(self, problem: Constraints, start: FloatArray | Waypoint, centring: float, inside: float) -> None:
        points = problem.cap.size
        velocity = np.zeros((1, 3, points))
        velocity[0, 0] = 1.0 / np.minimum(problem.cap, _NO_CAP)
        acceleration = np.zeros((len(problem.acceleration), 3, points))
        acceleration[:, :2] = problem.acceleration.r
        self.rows = np.concatenate([velocity, acceleration, problem.jerk.r])
        # of the rows and of their multipliers: what limits the speed has no row of its own
        self.of = (None, *problem.acceleration.of, *problem.jerk.of)
        self.jerk = np.arange(self.rows.shape[0]) > acceleration.shape[0]
        sides = np.concatenate([np.ones((1, 2)), problem.acceleration.bounds, problem.jerk.bounds])
        self.sides = np.minimum(sides, _NO_BOUND)
        self.bounds = np.column_stack([self.jerk, self.sides])
        self.h, self.weight, self.inner = problem.h, problem.weight, problem.inner
        self.problem = problem
        self.free_start = np.isnan(problem.start)
        # how many of x, a, c are prescribed at the first knot
        self.fixed = int(not self.free_start) + int(not np.isnan(problem.start_slope))
        warm = isinstance(start, Waypoint)
        self.z = start.z if isinstance(start, Waypoint) else np.ascontiguousarray(start)
        self.scale_inside(_WARM_INSIDE if warm else inside)
        bounds, y = self.bounds_and_value()
        least = _MIN_WARM_SLACK if warm else _MIN_SLACK
        over = np.stack([y - bounds[:, 0], -y - bounds[:, 1]], axis=1)
        self.slack = np.ascontiguousarray(np.maximum(-over, least))
        self.time = float(dot(self.weight, self.z[0] ** -0.5))
        if isinstance(start, Waypoint):
            self.dual = start.dual
            self.gap = float(dot(self.slack.reshape(-1), self.dual.reshape(-1)))
        else:
            self.dual = centring * self.time / self.slack.size / self.slack
            self.gap = centring * self.time
        self.residual = float(((self.slack + over) / (1.0 + bounds)).max())
        self.product = np.zeros_like(self.slack)
        self.pace_sums = np.empty((6, points))
        self.hessian, self.gradient = np.empty((6, points)), np.empty((3, points))
        self.affine, self.step = np.zeros((3, points)), np.zeros((3, points))
        self.gains, self.root = np.empty((4, self.h.size)), np.empty(6)
        self.feed_forward, self.out = np.empty(self.h.size), np.empty(6)
        self.ends: list[tuple[FloatArray, FloatArray]] = []

    def bounds_and_value(self) -> tuple[FloatArray, FloatArray]:
        """Sizes of the upper and lower bounds (m, 2, p) and values r . z (m, p) of all rows."""
        y = self.rows[:, 0] * self.z[0]
        for k in (1, 2):
            y += self.rows[:, k] * self.z[k]
        return self.sides[:, :, None] * np.where(self.jerk[:, None], self.z[0] ** -0.5, 1.0)[:, None], y

    def scale_inside(self, share: float) -> None:
        """Slow the start down until it uses that share of every limit; not where a feed is prescribed."""
        if not (self.free_start and np.isnan(self.problem.end)):
            return
        _, y = self.bounds_and_value()
        y = np.maximum(y / self.sides[:, :1], -y / self.sides[:, 1:])
        used = float(y[~self.jerk].max())
        if self.jerk.any():
            used = max(used, float((y[self.jerk] * np.sqrt(self.z[0])).max()) ** (2.0 / 3.0))
        self.z *= share / used


def solve_interior(
    problem: Constraints,
    start: FloatArray | Waypoint,
    *,
    centring: float = 1.0,
    inside: float = 0.95,
    tolerance: float | None = None,
    deadline: float = np.inf,
    progress: Progress | None = None,
) -> Solution:
    """Solve one section.

    Parameters
    ----------
    problem : Constraints
    start : (3, p) array, or Waypoint
        x, a, c of a cubic spline at all points, x > 0 (see :func:`start_from`); or where the solution of a problem on the
        same grid that differs by little came through (``centring`` and ``inside`` then follow from it).
    centring : float
        Initial sum(s l) as a share of the time: 1 for a rough start, 0.1 for a good one.
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
    status: Status | None = None
    count = 0
    waypoint: Waypoint | None = None
    while status is None:
        count += 1
        status = _iterate(it)
        if waypoint is None and it.gap < _WAYPOINT_GAP * it.time and it.residual < _FEASIBLE:
            waypoint = Waypoint(it.z.copy(), it.dual.copy())
        if status is None and it.gap < tolerance * it.time and it.residual < _FEASIBLE:
            status = Status.OPTIMAL
        elif status is None and count >= _MAX_ITERATIONS:
            status = Status.TOO_MANY
        elif status is None and it.residual < _FEASIBLE and time.perf_counter() > deadline:
            status = Status.BUDGET
        if progress is not None:
            progress("solving", max(0.0, min(1.0, np.log(max(it.gap / it.time, tolerance)) / np.log(tolerance))))
    if it.residual > _FEASIBLE:
        given = not np.isnan([problem.start, problem.end]).all()
        raise SolverError(
            f"the interior-point method stopped after {count} iterations ({status.value}) with a violation of "
            f"{it.residual:.2g}{'; the entry or exit feed may not be attainable' if given else ''}"
        )
    knots = it.z[:, :: problem.inner + 1]
    x, a, c = (row.copy() for row in knots)
    cpu = time.process_time() - began
    return Solution(x, a, c, it.time, status, count, it.gap / it.time, it.residual, cpu, it, waypoint)


def is_global(it: Iterate) -> bool:
    """Whether the iterate, an optimum, is the global one for sure: Lam <= w at every point.

    The Lagrangian is then a sum of convex functions, so that the point at which it is stationary is its minimum.
    Coincident points, those of a double knot, count as one.
    """
    load = (it.dual * it.sides[:, :, None])[it.jerk].sum(axis=(0, 1))
    place = np.zeros(load.size, dtype=np.intp)
    place[1:] = np.cumsum(np.repeat(it.h > 0.0, it.inner + 1))
    return bool((np.bincount(place, load) <= np.bincount(place, it.weight) * (1.0 + _FEASIBLE)).all())


def _tolerance(problem: Constraints) -> float:
    """Relative gap that resolves the shortest interval too: the share of one row below a thousandth of its time."""
    full, middle = problem.h > 0.0, (problem.inner + 1) // 2
    share = problem.weight[middle :: problem.inner + 1][full] * problem.guess[:-1][full] ** -0.5
    rows = 2 * (1 + len(problem.acceleration) + len(problem.jerk)) * problem.cap.size
    return float(np.clip(_MIN_SHARE * rows * share.min() / share.sum(), _FINEST_GAP, GAP_TOLERANCE))


def _iterate(it: Iterate) -> Status | None:
    """One predictor-corrector step; returns why it cannot go on, if it cannot."""
    from planner.plan.solvers import interior_kernels as kernels

    pace = 1.0 / np.sqrt(it.z[0])
    state = (it.rows, it.bounds, it.z, pace, it.slack, it.dual, it.product)
    if not _factor(it, pace):
        return Status.SINGULAR
    _prepare_ends(it)
    _newton(it, it.affine)
    pace_step = -0.5 * pace / it.z[0] * it.affine[0]
    kernels.measure_iterate(*state, it.affine, pace_step, 0.0, 0.0, True, it.out)
    primal, dual = _length(it.out[0], 1.0), _length(it.out[1], 1.0)
    affine_gap = it.gap + primal * it.out[2] + dual * it.out[3] + primal * dual * it.out[4]
    hope = -float(dot(it.weight, pace_step))
    centring = min(max((affine_gap / it.gap) ** 3, _HOPE * hope / it.gap, 1e-4), 1.0)
    target, corrector = centring * it.gap / it.slack.size, primal * dual
    kernels.condense(*state, target, corrector, False, it.hessian, it.gradient, it.pace_sums)
    kernels.tie_pace(it.z, it.weight, it.pace_sums, False, False, it.hessian, it.gradient)
    _newton(it, it.step)
    pace_step = -0.5 * pace / it.z[0] * it.step[0]
    kernels.measure_iterate(*state, it.step, pace_step, target, corrector, False, it.out)
    fraction = min(max(1.0 - it.gap / it.time, 0.9), 0.995)
    primal = min(_length(it.out[0], fraction), _length(it.out[5], _MAX_FALL))
    dual = _length(it.out[1], fraction)
    if not (np.isfinite(it.out).all() and primal > 1e-10):
        return Status.NO_STEP
    new_pace = 1.0 / np.sqrt(it.z[0] + primal * it.step[0])
    kernels.advance_iterate(*state, it.step, pace_step, new_pace, target, corrector, primal, dual, it.out)
    it.time, it.gap, it.residual = float(dot(it.weight, new_pace)), float(it.out[0]), float(it.out[1])
    return None


def _factor(it: Iterate, pace: FloatArray) -> bool:
    """Assemble and factor the Newton system; without negative curvature where it is not positive definite."""
    from planner.plan.solvers import interior_kernels as kernels

    state = (it.rows, it.bounds, it.z, pace, it.slack, it.dual, it.product)
    for clip in (False, True):
        kernels.condense(*state, 0.0, 0.0, True, it.hessian, it.gradient, it.pace_sums)
        kernels.tie_pace(it.z, it.weight, it.pace_sums, clip, True, it.hessian, it.gradient)
        if kernels.factor_barrier(it.h, it.inner, it.hessian, it.gains, it.root) > 0.0:
            return True
    return False


def _length(decrease: float, fraction: float) -> float:
    """Step length at which the given largest relative decrease becomes ``fraction``, 1 at most."""
    return float(fraction / decrease) if decrease > fraction else 1.0


def _prepare_ends(it: Iterate) -> None:
    """Responses of the Newton system to a unit price on each end condition."""
    from planner.plan.solvers import interior_kernels as kernels

    prices: list[tuple[FloatArray, FloatArray]] = []
    unit = np.eye(3)
    if it.problem.periodic:
        prices = [(-unit[k], unit[k]) for k in range(3)]
    elif not np.isnan(it.problem.end):
        prices = [(np.zeros(3), unit[0])]
    it.ends = []
    none = np.zeros_like(it.gradient)
    for first, last in prices:
        response = np.empty_like(it.step)
        kernels.solve_barrier(it.h, it.inner, it.gains, it.root, none, first, last, it.fixed, it.feed_forward, response)
        it.ends.append((response, last))


def _newton(it: Iterate, step: FloatArray) -> None:
    """Solve for the step, and price the end conditions so that it keeps them."""
    from planner.plan.solvers import interior_kernels as kernels

    none = np.zeros(3)
    kernels.solve_barrier(it.h, it.inner, it.gains, it.root, it.gradient, none, none, it.fixed, it.feed_forward, step)
    if not it.ends:
        return

    def broken(z: FloatArray) -> FloatArray:
        return z[:, -1] - z[:, 0] if it.problem.periodic else z[:1, -1]

    system = np.stack([broken(response) for response, _ in it.ends], axis=1)
    price = np.linalg.solve(system, -broken(step))
    for (response, _), p in zip(it.ends, price, strict=True):
        step += p * response


def start_from(problem: Constraints, x: FloatArray) -> FloatArray:
    """States at all points of the cubic spline with the values x (one a knot) as its control values.

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
    return states_between(problem.h, _knot_states(knots, control), problem.inner)


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
