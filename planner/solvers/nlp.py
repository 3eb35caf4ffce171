"""The same problem by CasADi and IPOPT: the reference that shares no solver code with ``optimal.py``.

Variables are x, a, c at the knots; the cubic between knots enters as linear equations, midpoints as linear expressions.
Everything is written on whole vectors (MX), so that building the derivatives costs little beside the solve.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.constraints import Constraints
from planner.errors import SolverError
from planner.geometry.curve import FloatArray
from planner.solvers.optimal import Solution, start_from

_TOLERANCE = 1e-8
_MAX_ITERATIONS = 1000
_SMALLEST_X = 1e-10


def solve(problem: Constraints) -> Solution:
    """Solve one section with IPOPT.

    Parameters
    ----------
    problem : Constraints

    Returns
    -------
    Solution
        Without a lower bound.

    Raises
    ------
    SolverError
        With IPOPT's own words, if it does not converge.
    """
    import casadi

    n = problem.h.size + 1
    x, a, c = (casadi.MX.sym(name, n) for name in "xac")
    h = casadi.DM(problem.h)
    # the cubic on an interval: its end, and its middle
    equations = [
        x[1:] - x[:-1] - 2 * h * a[:-1] - h**2 * (2 * c[:-1] + c[1:]) / 3,
        a[1:] - a[:-1] - h * (c[:-1] + c[1:]) / 2,
    ]
    if problem.periodic:
        equations += [x[0] - x[-1], a[0] - a[-1], c[0] - c[-1]]
    middle = (
        x[:-1] + h * a[:-1] + h**2 * (5 * c[:-1] + c[1:]) / 24,
        a[:-1] + h * (3 * c[:-1] + c[1:]) / 8,
        (c[:-1] + c[1:]) / 2,
    )
    inner = np.flatnonzero(problem.h > 0.0)
    time: Any = 0.0
    rows, low, high = [], [], []
    knots, mids = slice(0, None, 2), slice(1, None, 2)
    for (px, pa, pc), at, chosen in (((x, a, c), knots, np.arange(n)), (middle, mids, inner)):
        chosen_list = chosen.tolist()
        px, pa, pc = (vector[chosen_list] for vector in (px, pa, pc))
        weight = problem.weight[at][chosen]
        time += casadi.dot(casadi.DM(weight), px**-0.5)
        rows.append(px)
        low.append(np.full(chosen.size, _SMALLEST_X))
        high.append(problem.cap[at][chosen])
        for row in problem.acceleration:
            alpha, beta = (casadi.DM(part[at][chosen]) for part in row)
            rows.append(alpha * px + beta * pa)
        for row in problem.jerk:
            r = [casadi.DM(part[at][chosen]) for part in row]
            rows.append((r[0] * px + r[1] * pa + r[2] * pc) * px**0.5)
        count = (len(problem.acceleration) + len(problem.jerk)) * chosen.size
        low.append(np.full(count, -1.0))
        high.append(np.full(count, 1.0))
    equation = casadi.vertcat(*equations)
    constraint = casadi.vertcat(equation, *rows)
    zeros = np.zeros(equation.shape[0])
    bounds = [np.full(3 * n, -np.inf), np.full(3 * n, np.inf)]
    bounds[0][:n] = _SMALLEST_X
    for value, index in ((problem.start, 0), (problem.end, n - 1)):
        if not np.isnan(value):
            bounds[0][index] = bounds[1][index] = value
    options = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "tol": _TOLERANCE, "max_iter": _MAX_ITERATIONS, "mu_strategy": "adaptive"},
    }
    solver = casadi.nlpsol("feedrate", "ipopt", {"x": casadi.vertcat(x, a, c), "f": time, "g": constraint}, options)
    found = solver(
        x0=_start(problem),
        lbx=bounds[0],
        ubx=bounds[1],
        lbg=np.concatenate([zeros, *low]),
        ubg=np.concatenate([zeros, *high]),
    )
    report = solver.stats()
    if not report["success"]:
        raise SolverError(
            f"IPOPT stopped after {report['iter_count']} iterations: {report['return_status']}; "
            'try another number of intervals, or method="optimal"'
        )
    z = np.array(found["x"]).reshape(3, n)
    return Solution(z[0], z[1], z[2], float(found["f"]), "optimal", int(report["iter_count"]), _TOLERANCE, _TOLERANCE)


def _start(problem: Constraints) -> FloatArray:
    """The same spline guess as the interior-point method's, slowed down until it keeps the limits."""
    z = start_from(problem, problem.guess)[:, 0::2]
    used = [float((z[0] / problem.cap[0::2]).max())]
    used += [float(np.abs(row[0, 0::2] * z[0] + row[1, 0::2] * z[1]).max()) for row in problem.acceleration]
    jerk = [np.abs(np.sum(row[:, 0::2] * z, axis=0)) * np.sqrt(z[0]) for row in problem.jerk]
    used += [float(value.max()) ** (2.0 / 3.0) for value in jerk]
    if np.isnan(problem.start) and np.isnan(problem.end):
        z = z * (0.9 / max(used))
    return z.reshape(-1)
