"""The convex relaxation of the feedrate problem: a lower bound for every plan, at the price of one more solve.

The problem of ``optimal.py`` is convex but for its jerk rows, |r . (x, a, c)| <= x^(-1/2).  Give the pace y = 1/sigma_dot a
variable of its own at every point,

    minimise sum w y      subject to   y >= x^(-1/2),   |r . (x, a, c)| <= y  (jerk),   |r . (x, a, c)| <= 1  (others).

Every plan is a point of this problem, with y = x^(-1/2), so its optimum is a lower bound; and it is convex, so its optimum
is the global one.  Where that optimum has y = x^(-1/2) everywhere it is the optimum of the problem itself, proven; where
not, the relaxed motion would buy jerk by pretending to be slower than it is, and the bound stays below.

The method is that of ``optimal.py`` with one more constraint a point, x^(-1/2) - y <= 0 with slack t and multiplier v.
The pace occurs at its own point only, so it is eliminated there: with D = sum of stiffnesses + v/t,

    H <- H - b b^T / D,     g <- g - b g_y / D,     dy = -(g_y + b . dz) / D,

and the Riccati recursion is the same.
"""

from __future__ import annotations

import numpy as np

from planner.constraints import Constraints
from planner.errors import SolverError
from planner.geometry.curve import FloatArray, dot
from planner.solvers.optimal import Iterate, _length, _newton, _prepare_ends

_TOLERANCE = 2e-6
_RESIDUAL = 1e-7
_MAX_ITERATIONS = 80
_ROOM = 1.05  # the start's pace over x^(-1/2)


class _Epigraph:
    """Slack and multiplier of x^(-1/2) - y <= 0 at every point, and the pace itself."""

    def __init__(self, it: Iterate, share: float) -> None:
        self.pace = _ROOM * it.z[0] ** -0.5
        self.slack = self.pace - it.z[0] ** -0.5
        self.dual = share / self.slack
        self.product = np.zeros_like(self.slack)
        # The midpoint of an empty interval has no weight of its own; without any its pace would run away.
        self.weight = np.maximum(it.weight, 1e-6 * it.weight.mean())

    def step(self, it: Iterate, dz: FloatArray, terms: tuple[FloatArray, ...]) -> FloatArray:
        """Recover the step of the pace from that of z."""
        stiff, gradient, bx, ba, bc = terms
        return -(gradient + bx * dz[0] + ba * dz[1] + bc * dz[2]) / stiff

    def eliminate(
        self, it: Iterate, target: float, corrector: float, factorise: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Add the epigraph to the sums of ``kernels.condense`` and eliminate the pace."""
        x = it.z[0]
        root = x**-0.5
        slope = -0.5 * root / x
        own = self.dual / self.slack
        push = (target - corrector * self.product) / self.slack + own * (self.slack + root - self.pace)
        sums = it.pace_sums
        stiff = sums[1] + own
        bx, ba, bc = -sums[2] - own * slope, -sums[3], -sums[4]
        gradient = self.weight - sums[0] - push
        if factorise:
            curvature = self.dual * 0.75 * root / x**2 + own * slope**2
            for k, change in enumerate((bx * bx, bx * ba, bx * bc, ba * ba, ba * bc, bc * bc)):
                it.hessian[k] -= change / stiff
            it.hessian[0] += curvature
        it.gradient[0] += push * slope
        for k, b in enumerate((bx, ba, bc)):
            it.gradient[k] -= b * gradient / stiff
        return stiff, gradient, bx, ba, bc

    def changes(
        self, it: Iterate, dz: FloatArray, dy: FloatArray, target: float, corrector: float
    ) -> tuple[FloatArray, FloatArray]:
        """Steps of slack and multiplier."""
        root = it.z[0] ** -0.5
        dt = self.pace + dy - root + 0.5 * root / it.z[0] * dz[0] - self.slack
        return dt, (target - corrector * self.product - self.dual * dt) / self.slack - self.dual


def relaxed_time(problem: Constraints, z: FloatArray) -> float:
    """Optimum of the convex relaxation, in the unit of the problem, less what convergence leaves open.

    Parameters
    ----------
    problem : Constraints
    z : (3, 2n - 1) array
        States to start from: an optimum of the problem.

    Raises
    ------
    SolverError
        If the method does not converge.
    """
    it = Iterate(problem, z.copy(), 0.1, 0.95)
    epigraph = _Epigraph(it, it.gap / (it.slack.size + it.z.shape[1]))
    it.dual[:] = it.gap / (it.slack.size + it.z.shape[1]) / it.slack
    it.time = float(dot(epigraph.weight, epigraph.pace))
    for _ in range(_MAX_ITERATIONS):
        residual = _iterate(it, epigraph)
        if it.gap < _TOLERANCE * it.time and max(it.residual, residual) < _RESIDUAL:
            return it.time * (1.0 - _TOLERANCE) - it.gap
    raise SolverError(
        f"the convex relaxation did not converge in {_MAX_ITERATIONS} iterations "
        f"(gap {it.gap / it.time:.2g}, residual {it.residual:.2g})"
    )


def _iterate(it: Iterate, epigraph: _Epigraph) -> float:
    """One predictor-corrector step; returns the epigraph's relative residual."""
    from planner.solvers import kernels

    state = (it.rows, it.jerk, it.z, epigraph.pace, it.slack, it.dual, it.product)
    sums = (it.hessian, it.gradient, it.pace_sums)
    kernels.condense(*state, 0.0, 0.0, True, *sums)
    terms = epigraph.eliminate(it, 0.0, 0.0, True)
    if kernels.factor(it.h, it.hessian, it.gains, it.root) <= 0.0:
        raise SolverError("the Newton system of the convex relaxation is singular")
    _prepare_ends(it)
    _newton(it, it.affine)
    dy = epigraph.step(it, it.affine, terms)
    kernels.measure(*state, it.affine, dy, 0.0, 0.0, True, it.out)
    dt, dv = epigraph.changes(it, it.affine, dy, 0.0, 0.0)
    primal = min(_length(it.out[0], 1.0), _length(float((-dt / epigraph.slack).max()), 1.0))
    dual = min(_length(it.out[1], 1.0), _length(float((-dv / epigraph.dual).max()), 1.0))
    gap = (
        it.gap
        + primal * (it.out[2] + float(dot(dt, epigraph.dual)))
        + dual * (it.out[3] + float(dot(epigraph.slack, dv)))
    )
    gap += primal * dual * (it.out[4] + float(dot(dt, dv)))
    epigraph.product = dt * dv
    hope = -float(dot(epigraph.weight, dy))
    centring = min(max((gap / it.gap) ** 3, 2.0 * hope / it.gap, 1e-4), 1.0)
    target, corrector = centring * it.gap / (it.slack.size + dt.size), primal * dual
    kernels.condense(*state, target, corrector, False, *sums)
    terms = epigraph.eliminate(it, target, corrector, False)
    _newton(it, it.step)
    dy = epigraph.step(it, it.step, terms)
    kernels.measure(*state, it.step, dy, target, corrector, False, it.out)
    dt, dv = epigraph.changes(it, it.step, dy, target, corrector)
    fraction = min(max(1.0 - it.gap / it.time, 0.9), 0.995)
    primal = min(_length(it.out[0], fraction), _length(it.out[5], 0.9))
    primal = min(primal, _length(float((-dt / epigraph.slack).max()), fraction))
    dual = min(_length(it.out[1], fraction), _length(float((-dv / epigraph.dual).max()), fraction))
    new_pace = epigraph.pace + primal * dy
    kernels.advance(*state, it.step, dy, new_pace, target, corrector, primal, dual, it.out)
    epigraph.pace = new_pace
    epigraph.slack = np.maximum(epigraph.slack + primal * dt, new_pace - it.z[0] ** -0.5)
    epigraph.dual = epigraph.dual + dual * dv
    it.time = float(dot(epigraph.weight, new_pace))
    it.gap = float(it.out[0]) + float(dot(epigraph.slack, epigraph.dual))
    it.residual = float(it.out[1])
    root = it.z[0] ** -0.5
    return float(((epigraph.slack + root - new_pace) / (1.0 + root)).max())
