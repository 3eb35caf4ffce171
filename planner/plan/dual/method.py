"""A primal-dual method for the best multipliers of the lower bound in ``terms.py``.

The multipliers are splines: theta holds the control values of quadratic B-splines l_j (one for each jerk limit) and of
linear ones m_i (one for each acceleration limit).  At the points p of a rule with weights omega they give, linearly,
(l, m, g)_p = D_p theta, and at double knots and the seam of a periodic path G_k = r_k . theta.  The best ones

    maximise  sum omega [ min_x (1 - sum |l|) x^(-1/2) + g x  - sum |m| ] + sum_k min(0, G_k cap_k) + b . theta .

The Lagrangian dual of that is a convex program whose unknowns sit at single points, with theta as the multiplier of its
one set of equations (a weak form of the laws of motion):

    minimise  sum omega y     subject to   sum omega D^T (e, u, x) + sum r_k x_k + b = 0,
              |e_j| <= y,   |u_i| <= 1,   x^(-1/2) <= y,   x <= cap,   0 <= x_k <= cap_k .

A predictor-corrector step (as in ``interior.py``: separate step lengths, the same centring) eliminates all points: with
k1, k2 the stiffnesses multiplier / slack of |e| <= y, k = k1 + k2, d = (k1 - k2)/k, rho = x^(-3/2)/2, those kv of the
epigraph x^(-1/2) <= y (multiplier v, slack t) and kmu of the cap,

    Y = sum 4 k1 k2/k + kv,   X = kv rho^2 + 3/4 v x^(-5/2) + kmu,   M = inv [[Y, kv rho], [kv rho, X]],
    S theta = sum omega D^T (z + dz_0) + sum r_k (x_k + dx_k0) + b,
    S = sum omega D^T C D + sum r r^T / h_k,      C_ee = diag(1/k) + d d^T M_yy,  C_ex = d M_yx,  C_xx = M_xx,  C_uu = 1/ku,

dz_0 the step of (e, u, x) at theta = 0.  S is banded; its Cholesky factor costs as much as a few sums over the points.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.types import FloatArray

_TOLERANCE = 3e-6
_SHARE_OF_LEFT = 0.02
_STALLED, _PATIENCE, _CLOSE = 0.7, 4, 1e-3  # close to the end, a gap that falls no faster than this in so many steps
_MAX_ITERATIONS = 50
_INSIDE, _ROOM, _CENTRING = 0.8, 1.2, 0.3  # of the start: x against the plan's, y against x^(-1/2), products against y
_WAYPOINT = 0.03  # relative gap, where another solve with slightly larger margins may begin
_HOPE, _MAX_HOPE = 2.0, 0.3  # weight of the hoped-for gain in the centring, and the largest centring it asks for
_MAX_FALL = 0.9


@dataclass(frozen=True, eq=False)
class Problem:
    """Arrays of one section in its own units of length and time (layout: see ``dual.h``).

    Attributes
    ----------
    place : (n - 1,) int array
        Which block of points a cell has; -1 for empty cells, which are atoms.
    axes : (int, int)
        Number of jerk and of acceleration limits.
    weight, cap, guess : (blocks, 4) arrays
        Quadrature weights, largest x, and about the x of a plan.
    quadratic (blocks, 3, 4), linear (blocks, 2, 4), rows (blocks, 4, local) : arrays
        Values of the B-splines, and the rows of g.
    atom_rows (n - 1, local), atom_caps (n - 1,) : arrays
        Of the empty cells.
    known : array
        b: what a prescribed feed at an end contributes.
    fixed : int array
        Unknowns that are 0, increasing.
    seam : (k, unknowns) array
        Where a path closes: conditions row . theta = 0.
    seam_row, seam_cap
        Row of G there, and its cap; None where the path does not close.
    """

    place: NDArray[np.int64]
    axes: tuple[int, int]
    weight: FloatArray
    cap: FloatArray
    guess: FloatArray
    quadratic: FloatArray
    linear: FloatArray
    rows: FloatArray
    atom_rows: FloatArray
    atom_caps: FloatArray
    known: FloatArray
    fixed: NDArray[np.int64]
    seam: FloatArray
    seam_row: FloatArray | None = None
    seam_cap: float = 0.0

    @property
    def structure(self) -> tuple[int | FloatArray | NDArray[np.int64], ...]:
        """What every function of the compiled method begins with."""
        points = self.weight, self.cap, self.quadratic, self.linear, self.rows
        return (self.place.size, *self.axes, self.place, *points, self.atom_rows, self.atom_caps)


class Iterates:
    """Where the method is: everything at the points, the atoms, theta; and a copy of where it came through."""

    def __init__(self, problem: Problem) -> None:
        jerks, accelerations = problem.axes
        blocks, points = problem.cap.shape
        self.points = np.zeros((blocks, 5 + 3 * (jerks + accelerations), points))
        x = np.minimum(_INSIDE * problem.guess, 0.5 * problem.cap)
        root = x**-0.5
        y = _ROOM * root
        share = _CENTRING * y
        self.points[:, 0], self.points[:, 1], self.points[:, 2] = y, x, y - root
        self.points[:, 3], self.points[:, 4] = share / (y - root), share / (problem.cap - x)
        for c in range(jerks + accelerations):
            bound = y if c < jerks else 1.0
            self.points[:, 6 + 3 * c] = self.points[:, 7 + 3 * c] = share / bound
        mean = float(np.sum(problem.weight * share) / np.sum(problem.weight))
        self.atoms = np.ones((problem.place.size, 3))
        self.atoms[:, 0] = 0.5 * problem.atom_caps
        self.atoms[:, 1] = self.atoms[:, 2] = mean / self.atoms[:, 0]
        self.seam = np.array([0.5 * problem.seam_cap, 0.0, 0.0])
        if problem.seam_row is not None:
            self.seam[1:] = mean / self.seam[0]
        self.theta = np.zeros(problem.known.size)
        self.waypoint: Iterates | None = None
        self.time = float(np.sum(problem.weight * y))
        constraints = 2 + 2 * (jerks + accelerations)
        single = 2.0 * (float(np.sum(problem.place < 0)) + (problem.seam_row is not None))
        self.count = constraints * float(problem.weight.sum()) + single
        self.gap = constraints * float(np.sum(problem.weight * share)) + single * mean


class _Newton:
    """The linear system of one iteration: a banded factor, bordered where a path closes."""

    def __init__(self, problem: Problem, state: Iterates, work: _Passes) -> None:
        self.work = work
        work.assemble()
        self.regular = work.factor() > 0.0
        if not self.regular:
            return
        self.border = problem.seam
        stiff = np.zeros(len(problem.seam))
        if problem.seam_row is not None:
            x, low, high = state.seam
            self.border = np.vstack([problem.seam, problem.seam_row])
            stiff = np.append(stiff, low / x + high / (problem.seam_cap - x))
        if len(self.border):
            self.responses = np.stack([self._solve(row) for row in self.border])
            self.inner = self.border @ self.responses.T + np.diag(stiff)

    def _solve(self, b: FloatArray) -> FloatArray:
        self.work.b[:] = b
        self.work.solve()
        return self.work.b.copy()

    def theta(self, b: FloatArray) -> FloatArray:
        """Solve (S + r r^T / h) theta = b with the seam's conditions, by the Schur complement of their prices."""
        found = self._solve(b)
        if len(self.border):
            found -= np.linalg.solve(self.inner, self.border @ found) @ self.responses
        return found


def best_multipliers(problem: Problem, planned: float, start: Iterates | None = None) -> Iterates:
    """Find the best multipliers ``theta``; any are valid, so it stops where it cannot go on.

    Best to a small relative gap, or to a small share of what is left to the time of a plan (``planned``, in the problem's
    units): where the bound cannot come close to the plan, its last digits say nothing.  ``start`` is a waypoint of the same
    problem but for its margins.
    """
    state = start or Iterates(problem)
    work = _Passes(problem, state)
    gaps = [np.inf] * _PATIENCE
    for _ in range(_MAX_ITERATIONS):
        if not _iterate(problem, state, work):
            break
        gaps.append(state.gap)
        if state.waypoint is None and state.gap < _WAYPOINT * state.time:
            state.waypoint = deepcopy(state)
        stalled = state.gap > _STALLED * gaps[-1 - _PATIENCE] and state.gap < _CLOSE * state.time
        if stalled or state.gap < max(_TOLERANCE * state.time, _SHARE_OF_LEFT * (planned - state.time)):
            break
    return state


class _Passes:
    """Arrays that every iteration writes to, and the compiled passes over them."""

    def __init__(self, problem: Problem, state: Iterates) -> None:
        jerks, accelerations = problem.axes
        (blocks, points), unknowns, local = problem.cap.shape, problem.known.size, problem.rows.shape[-1]
        reduced = np.empty((blocks, 5 + 2 * jerks + accelerations, points))
        band, scratch = np.empty((unknowns, local)), np.empty((points, local))
        self.last = np.zeros_like(state.points), np.zeros_like(state.atoms)  # steps at the points and of the atoms
        self.seam = np.zeros(3)
        self.b, self.theta, self.out = np.empty(unknowns), np.empty(unknowns), np.zeros(7)
        self.control = np.zeros(4)  # target, corrector, lengths of the primal and the dual step
        s, now, held = problem.structure, (state.points, state.atoms), (problem.fixed.size, problem.fixed)
        self.assemble = core.method_assemble.bind(*s, *now, unknowns, reduced, band, scratch)
        self.factor = core.method_factor.bind(unknowns, local, *held, band)
        self.solve = core.method_solve.bind(unknowns, local, *held, band, self.b)
        self.right_side = core.method_right_side.bind(
            *s, *now, *self.last, self.control, unknowns, reduced, self.b, scratch
        )
        self.steps = core.method_steps.bind(*s, *now, self.theta, self.control, reduced, *self.last, self.out)
        self.take_step = core.method_take_step.bind(*s, self.control, *self.last, *now, self.out)


def _iterate(problem: Problem, state: Iterates, work: _Passes) -> bool:
    """One predictor-corrector step; False where the system is singular or the step length vanishes."""
    newton = _Newton(problem, state, work)
    if not newton.regular:
        return False
    _direction(problem, state, work, newton, 0.0, 0.0)
    primal, dual = _length(work.out[0], 1.0), _length(work.out[1], 1.0)
    gap = state.gap + dual * work.out[3] + primal * work.out[4] + primal * dual * work.out[5]
    centring = min(max((gap / state.gap) ** 3, min(-_HOPE * work.out[6] / state.gap, _MAX_HOPE), 1e-4), 1.0)
    target, corrector = centring * state.gap / state.count, primal * dual
    theta = _direction(problem, state, work, newton, target, corrector)
    fraction = min(max(1.0 - state.gap / state.time, 0.9), 0.995)
    primal = min(_length(work.out[0], fraction), _length(work.out[2], _MAX_FALL))
    dual = _length(work.out[1], fraction)
    if not (np.isfinite(work.out).all() and np.isfinite(theta).all() and max(primal, dual) > 1e-8):
        return False
    state.theta = state.theta + dual * (theta - state.theta)
    state.seam[0] += primal * work.seam[0]
    state.seam[1:] += dual * work.seam[1:]
    work.control[2:] = primal, dual
    work.take_step()
    x, low, high = state.seam
    state.gap, state.time = float(work.out[0] + x * low + (problem.seam_cap - x) * high), float(work.out[1])
    return True


def _direction(
    problem: Problem, state: Iterates, work: _Passes, newton: _Newton, target: float, corrector: float
) -> FloatArray:
    """New theta for a target of the products, and the steps that belong to it."""
    work.control[:2] = target, corrector
    work.right_side()
    b = work.b + problem.known
    row, (x, low, high) = problem.seam_row, state.seam
    room = problem.seam_cap - x
    if row is not None:
        t1 = target - corrector * work.seam[0] * work.seam[1]
        t2 = target + corrector * work.seam[0] * work.seam[2]
        stiff = low / x + high / room
        b += row * (x - (t2 / room - t1 / x) / stiff)
    theta = newton.theta(b)
    work.theta[:] = theta
    work.steps()
    if row is not None:
        dx = -(float(row @ theta) + t2 / room - t1 / x) / stiff
        work.seam[:] = dx, (t1 - low * dx) / x - low, (t2 + high * dx) / room - high
        dlow, dhigh = work.seam[1:]
        work.out[0] = max(work.out[0], -dx / x, dx / room)
        work.out[1] = max(work.out[1], -dlow / low, -dhigh / high)
        work.out[3] += x * dlow + room * dhigh
        work.out[4] += dx * (low - high)
        work.out[5] += dx * (dlow - dhigh)
    return theta


def _length(decrease: float, fraction: float) -> float:
    """Step length at which the given largest relative decrease becomes ``fraction``, 1 at most."""
    return float(fraction / decrease) if decrease > fraction else 1.0
