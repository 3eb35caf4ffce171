"""The same problem by CasADi and IPOPT: the reference that shares no solver code with ``interior.py``.

Variables are x, a, c at the knots; the cubic between knots enters as linear equations, midpoints as linear expressions.
Everything is written on whole vectors (MX), so that building the derivatives costs little beside the solve.

The **convex relaxation** gives the pace y its own variable at every point: minimise sum w y with y >= x^(-1/2) and
|r . (x, a, c)| <= y in the jerk rows.  With y = x^(-1/2) it is the problem itself; with the inequality it is convex, so
its optimum is a lower bound for every plan (the relaxation of third-order time-optimal path parametrisation to a
second-order cone program).  Where the optimum has y = x^(-1/2) everywhere, that is the global one.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

from planner.errors import SolverError
from planner.plan.rows import Constraints, used_share
from planner.plan.solvers.interior import Solution, start_from
from planner.status import Status
from planner.types import FloatArray

_TOLERANCE = 1e-8
_MAX_ITERATIONS = 1000
_MIN_X = 1e-10


def solve_nlp(problem: Constraints) -> Solution:
    """Solve one section with IPOPT.

    Parameters
    ----------
    problem : Constraints

    Returns
    -------
    Solution

    Raises
    ------
    SolverError
        With IPOPT's own words, if it does not converge.
    """
    began = process_time()
    program = _Collocation.of(problem)
    paces = [px**-0.5 for px, _, _ in program.points]
    z, time, iterations = program.run(problem, paces, program.start)
    cpu = process_time() - began
    return Solution(z[0], z[1], z[2], time, Status.OPTIMAL, iterations, _TOLERANCE, _TOLERANCE, cpu)


def relaxed_time(problem: Constraints) -> float:
    """Optimum of the convex relaxation: a lower bound for every plan, in the unit of the problem.

    Raises
    ------
    SolverError
        With IPOPT's own words, if it does not converge.
    """
    import casadi

    program = _Collocation.of(problem)
    paces = [casadi.MX.sym("y", px.shape[0]) for px, _, _ in program.points]
    x = program.start[0]
    inner = problem.h > 0.0
    start = np.concatenate([program.start.reshape(-1), 1.1 * x**-0.5, 1.1 * (0.5 * (x[1:] + x[:-1])[inner]) ** -0.5])
    _, time, _ = program.run(problem, paces, start)
    return time * (1.0 - _TOLERANCE)


@dataclass(frozen=True, eq=False)
class _Collocation:
    """The symbols common to both problems.

    ``states`` are x, a, c at the knots; ``points`` the same as expressions, at the knots and at the midpoints; ``chosen``
    the indices of the collocation points of either kind; ``equations`` the cubic and the periodic ends.
    """

    states: tuple[Any, Any, Any]
    points: list[tuple[Any, Any, Any]]
    chosen: list[np.ndarray[Any, Any]]
    equations: Any
    start: FloatArray

    @classmethod
    def of(cls, problem: Constraints) -> _Collocation:
        import casadi

        n = problem.h.size + 1
        x, a, c = (casadi.MX.sym(name, n) for name in "xac")
        h = casadi.DM(problem.h)
        equations = [
            x[1:] - x[:-1] - 2 * h * a[:-1] - h**2 * (2 * c[:-1] + c[1:]) / 3,
            a[1:] - a[:-1] - h * (c[:-1] + c[1:]) / 2,
        ]
        if problem.periodic:
            equations += [x[0] - x[-1], a[0] - a[-1], c[0] - c[-1]]
        inner = np.flatnonzero(problem.h > 0.0)
        middle = (
            x[:-1] + h * a[:-1] + h**2 * (5 * c[:-1] + c[1:]) / 24,
            a[:-1] + h * (3 * c[:-1] + c[1:]) / 8,
            (c[:-1] + c[1:]) / 2,
        )
        mids = (middle[0][inner.tolist()], middle[1][inner.tolist()], middle[2][inner.tolist()])
        chosen = [2 * np.arange(n), 2 * inner + 1]
        return cls((x, a, c), [(x, a, c), mids], chosen, casadi.vertcat(*equations), _start(problem))

    def run(self, problem: Constraints, paces: list[Any], start: FloatArray) -> tuple[FloatArray, float, int]:
        """Minimise sum w y; returns x, a, c at the knots (3, n), the time and the number of iterations."""
        import casadi

        own = [pace for pace in paces if pace.is_symbolic()]
        time: Any = 0.0
        rows, low, high = [], [], []
        for (px, pa, pc), at, pace in zip(self.points, self.chosen, paces, strict=True):
            time += casadi.dot(casadi.DM(problem.weight[at]), pace)
            rows.append(px)
            low.append(np.full(at.size, _MIN_X))
            high.append(problem.cap[at])
            if own:
                rows.append(pace - px**-0.5)
                low.append(np.zeros(at.size))
                high.append(np.full(at.size, np.inf))
            for row, (most, least) in zip(problem.acceleration.r, problem.acceleration.bounds, strict=True):
                rows.append(casadi.DM(row[0, at]) * px + casadi.DM(row[1, at]) * pa)
                low.append(np.full(at.size, -least))
                high.append(np.full(at.size, most))
            for row, (most, least) in zip(problem.jerk.r, problem.jerk.bounds, strict=True):
                value = casadi.DM(row[0, at]) * px + casadi.DM(row[1, at]) * pa + casadi.DM(row[2, at]) * pc
                if own:
                    within = [side - bound * pace for side, bound in ((value, most), (-value, least)) if bound < np.inf]
                    rows += within
                    low.append(np.full(len(within) * at.size, -np.inf))
                    high.append(np.zeros(len(within) * at.size))
                else:
                    rows.append(value / pace)
                    low.append(np.full(at.size, -least))
                    high.append(np.full(at.size, most))
        zeros = np.zeros(self.equations.shape[0])
        lowest, highest = self._ends(problem, start.size)
        ipopt = {
            "print_level": 0,
            "sb": "yes",
            "tol": _TOLERANCE,
            "max_iter": _MAX_ITERATIONS,
            "mu_strategy": "adaptive",
        }
        constraint = casadi.vertcat(self.equations, *rows)
        statement: Any = {"x": casadi.vertcat(*self.states, *own), "f": time, "g": constraint}
        options: Any = {"print_time": False, "show_eval_warnings": False, "ipopt": ipopt}
        solver = casadi.nlpsol("feedrate", "ipopt", statement, options)
        found = solver(
            x0=start.reshape(-1),
            lbx=lowest,
            ubx=highest,
            lbg=np.concatenate([zeros, *low]),
            ubg=np.concatenate([zeros, *high]),
        )
        report = solver.stats()
        if not report["success"]:
            raise SolverError(
                f"IPOPT stopped after {report['iter_count']} iterations: {report['return_status']}; "
                'try another number of intervals, or method="optimal"'
            )
        n = problem.h.size + 1
        z = np.array(found["x"]).reshape(-1)[: 3 * n].reshape(3, n)
        return z, float(found["f"]), int(report["iter_count"])

    def _ends(self, problem: Constraints, size: int) -> tuple[FloatArray, FloatArray]:
        """Bounds on the variables x, then a, then c: x > 0, and what is prescribed."""
        n = problem.h.size + 1
        lowest, highest = np.full(size, -np.inf), np.full(size, np.inf)
        lowest[:n] = _MIN_X
        for value, index in ((problem.start, 0), (problem.end, n - 1), (problem.start_slope, n)):
            if not np.isnan(value):
                lowest[index] = highest[index] = value
        return lowest, highest


def _start(problem: Constraints) -> FloatArray:
    """The same spline guess as the interior-point method's, slowed down until it keeps the limits."""
    z = start_from(problem, problem.guess)
    used = [float((z[0] / problem.cap[0::2]).max())]
    for row, bounds in zip(problem.acceleration.r, problem.acceleration.bounds, strict=True):
        used.append(float(used_share(row[0, 0::2] * z[0] + row[1, 0::2] * z[1], bounds).max()))
    for row, bounds in zip(problem.jerk.r, problem.jerk.bounds, strict=True):
        share = used_share(np.sum(row[:, 0::2] * z, axis=0), bounds) * np.sqrt(z[0])
        used.append(float(share.max()) ** (2.0 / 3.0))
    if np.isnan(problem.start) and np.isnan(problem.end):
        z = z * (0.9 / max(used))
    return np.asarray(z)
