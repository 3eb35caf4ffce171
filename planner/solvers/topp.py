"""The time-optimal plan without a jerk limit, by toppra: a lower bound, and what many controllers plan.

toppra works on sigma_dot^2, linear between grid points (constant sigma_ddot), in the section's own coordinate without a
rest map.  Its result is taken over as it is: nothing is refitted, and the time law is exact where the coordinate is the
curve parameter.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from planner.constraints import path_at
from planner.errors import InfeasibleError, SolverError
from planner.geometry.curve import FloatArray
from planner.grid import place_knots, scan, with_blends
from planner.law import TimeNodes
from planner.limits import Limits, chord_feed_limit
from planner.sections import Section


def plan_section(section: Section, limits: Limits, intervals: int) -> tuple[TimeNodes, float, dict[str, Any]]:
    """Plan one section with acceleration limits only.

    Parameters
    ----------
    section : Section
    limits : Limits
        Their jerk is ignored.
    intervals : int
        Number of grid intervals.

    Returns
    -------
    nodes : TimeNodes
    lower_bound : float
        Its duration, s: no plan with a jerk limit can be faster (up to toppra's discretisation).
    stats : dict

    Raises
    ------
    InfeasibleError
        If toppra finds no controllable speeds at an end.
    """
    guess = scan(section, limits, intervals)
    blended = with_blends(section, guess)
    # The same knots as the other methods use, which are dense at rest, mapped to the coordinate without blends.
    grid = place_knots(blended, guess, intervals)
    plain = replace(section, blend_start=0.0, blend_end=0.0)
    single = np.append(np.diff(grid.sigma) > 0.0, True)
    sigma = (blended.rest_map(grid.sigma)[0] - plain.y_start)[single]
    u = grid.u[single]
    x = _solve(plain, limits, sigma, u)
    h = np.diff(sigma)
    speed = np.sqrt(x)
    t = np.concatenate([[0.0], np.cumsum(2.0 * h / (speed[1:] + speed[:-1]))])
    a = 0.5 * np.diff(x) / h
    # sigma_ddot jumps at every grid point: a double node each
    right = path_at(plain, limits, sigma[:-1], u[:-1], u[:-1] >= plain.u_end).u
    left = path_at(plain, limits, sigma[1:], u[1:], np.ones(h.size, dtype=bool)).u
    rate = np.stack([right[1] * speed[:-1], left[1] * speed[1:]], axis=1)
    acceleration = np.stack([right[2] * x[:-1] + right[1] * a, left[2] * x[1:] + left[1] * a], axis=1)
    nodes = TimeNodes(np.repeat(t, 2)[1:-1], np.repeat(u, 2)[1:-1], rate.reshape(-1), acceleration.reshape(-1))
    stats = {"status": "feasible", "intervals": h.size, "iterations": 1}
    return nodes, float(t[-1]), stats


def _solve(section: Section, limits: Limits, sigma: FloatArray, u: FloatArray) -> FloatArray:
    """Run toppra on a scaled coordinate; returns x = sigma_dot^2 at the grid points."""
    import toppra
    from toppra import algorithm, constraint, interpolator

    toppra.setup_logging("ERROR")
    span = float(sigma[-1])

    class ScaledPath(interpolator.AbstractGeometricPath):  # type: ignore[misc]
        """The section over [0, 1] for toppra."""

        def __call__(self, path_positions: FloatArray, order: int = 0) -> FloatArray:
            at = np.atleast_1d(np.asarray(path_positions, dtype=np.float64)) * span
            values = path_at(section, limits, at, _exact(at, sigma, u), at >= span).axes[order] * span**order
            return values if np.ndim(path_positions) else values[0]

        @property
        def dof(self) -> int:
            return section.curve.dim

        @property
        def path_interval(self) -> FloatArray:
            return np.array([0.0, 1.0])

        @property
        def waypoints(self) -> None:
            return None

    constraints: list[Any] = []
    if np.isfinite(limits.acceleration).any():
        bound = np.where(np.isfinite(limits.acceleration), limits.acceleration, 1e12)
        constraints.append(constraint.JointAccelerationConstraint(np.stack([-bound, bound], axis=1)))
        constraints[-1].set_discretization_type(constraint.DiscretizationType.Interpolation)
    points = path_at(section, limits, sigma, u, u >= section.u_end)
    feed = np.minimum(limits.feed, chord_feed_limit(points.curvature, limits))
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.fmin(feed / points.tip[1], np.fmin.reduce(limits.velocity / np.abs(points.axes[1]), axis=1))
    top = np.minimum(np.nan_to_num(top, nan=np.inf), 1e6 * span)
    gridpoints = sigma / span
    gridpoints[-1] = 1.0
    caps = top / span

    class SpeedCap(constraint.LinearConstraint):  # type: ignore[misc]
        """sigma_dot below a cap at every grid point, handed over as it is."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, path: Any, gridpoints: FloatArray, *args: Any, **kwargs: Any) -> Any:
            xbound = np.stack([np.zeros_like(caps), caps**2], axis=1)
            return None, None, None, None, None, None, xbound

        def get_dof(self) -> int:
            return section.curve.dim

    constraints.append(SpeedCap())
    problem = algorithm.TOPPRA(constraints, ScaledPath(), gridpoints=gridpoints, solver_wrapper="seidel")
    ends = [
        0.0 if feed is None or np.isnan(feed) else feed / points.tip[1, at] / span
        for feed, at in ((section.start_feed, 0), (section.end_feed, -1))
    ]
    problem.compute_parameterization(*ends)
    sd = problem.problem_data.sd_vec
    if sd is None or not np.isfinite(sd).all():
        if max(ends) > 0.0:
            raise InfeasibleError(
                f"no plan between start_feed = {section.start_feed or 0.0:g} and end_feed = "
                f"{section.end_feed or 0.0:g} mm/s keeps the acceleration limits: {problem.problem_data.return_code}"
            )
        raise SolverError(f"toppra found no plan: {problem.problem_data.return_code}")
    return np.asarray((sd * span) ** 2)


def _exact(at: FloatArray, sigma: FloatArray, u: FloatArray) -> FloatArray:
    """Curve parameters at points of the grid, exact on breaks."""
    index = np.clip(np.searchsorted(sigma, at * (1.0 - 1e-12)), 0, sigma.size - 1)
    near = np.abs(sigma[index] - at) <= 1e-12 * sigma[-1]
    return np.where(near, u[index], np.interp(at, sigma, u))
