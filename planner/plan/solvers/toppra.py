"""The time-optimal plan without a jerk limit by toppra, to compare with; ``accelerations.py`` plans.

toppra works on sigma_dot^2, linear between grid points (constant sigma_ddot), in the section's own coordinate without a
rest map.  Its result is taken over as it is: nothing is refitted, and the time law is exact where the coordinate is the
curve parameter.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InfeasibleError, SolverError
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.plan.ends import Feed, feed_at
from planner.plan.guess import guess_feed
from planner.plan.knots import place_knots, with_blends
from planner.plan.rows import acceleration_rows, path_at, speed_cap
from planner.plan.section import Section
from planner.types import FloatArray

_FASTEST = 1e4  # in units of the section over its expected duration; stands for no bound


def plan_toppra(section: Section, limits: Limits, intervals: int) -> TimeLaw:
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
    TimeLaw

    Raises
    ------
    InfeasibleError
        If toppra finds no controllable speeds at an end.
    """
    guess = guess_feed(section, limits, intervals)
    blended = with_blends(section, guess)
    # The same knots as the other methods use, which are dense at rest, mapped to the coordinate without blends.
    grid = place_knots(blended, guess, intervals)
    plain = replace(section, blend_start=0.0, blend_end=0.0)
    single = np.append(np.diff(grid.sigma) > 0.0, True)
    sigma = (blended.position(grid.sigma) - plain.y_start)[single]
    u = grid.u[single]
    expected = guess.duration
    x = _solve(plain, limits, sigma, u, expected)
    h = np.diff(sigma)
    speed = np.sqrt(x)
    rests = np.flatnonzero(speed[1:] + speed[:-1] <= 0.0)
    if rests.size:
        raise SolverError(
            f"toppra found no plan: it stands still from u = {u[rests[0]]:.6g} on; the method optimal plans it"
        )
    t = np.concatenate([[0.0], np.cumsum(2.0 * h / (speed[1:] + speed[:-1]))])
    a = 0.5 * np.diff(x) / h
    # sigma_ddot jumps at every grid point: a double node each
    right = path_at(plain, limits, sigma[:-1], u[:-1], u[:-1] >= plain.u_end).u
    left = path_at(plain, limits, sigma[1:], u[1:], np.ones(h.size, dtype=bool)).u
    rate = np.stack([right[1] * speed[:-1], left[1] * speed[1:]], axis=1)
    acceleration = np.stack([right[2] * x[:-1] + right[1] * a, left[2] * x[1:] + left[1] * a], axis=1)
    return TimeLaw(np.repeat(t, 2)[1:-1], np.repeat(u, 2)[1:-1], rate.reshape(-1), acceleration.reshape(-1))


def _solve(section: Section, limits: Limits, sigma: FloatArray, u: FloatArray, unit: float) -> FloatArray:
    """Run toppra on sigma over [0, 1] and times in ``unit``; returns x = sigma_dot^2 at the grid points.

    In these units everything is about 1: toppra bounds its own variables by 1e8, which would slow down a path of
    micrometres without a word.
    """
    import toppra
    from toppra import algorithm, constraint, interpolator
    from toppra.constraint import linear_constraint

    toppra.setup_logging("ERROR")
    span = float(sigma[-1])
    points = path_at(section, limits, sigma, u, u >= section.u_end)
    top = np.minimum(np.sqrt(speed_cap(limits, points)) * unit / span, _FASTEST)
    rows = acceleration_rows(limits, points)
    gridpoints = sigma / span
    gridpoints[-1] = 1.0

    class Interval(interpolator.AbstractGeometricPath):  # type: ignore[misc]
        """The range of the coordinate, which is all that toppra needs to know here."""

        @property
        def dof(self) -> int:
            return section.curve.dim

        @property
        def path_interval(self) -> FloatArray:
            return np.array([0.0, 1.0])

    class GivenRows(constraint.LinearConstraint):  # type: ignore[misc]
        """The planner's own rows, bounds and caps, handed over as they are."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, path: Any, gridpoints: FloatArray, *args: Any, **kwargs: Any) -> Any:
            xbound = np.stack([np.zeros_like(top), top**2], axis=1)
            if len(rows) == 0:
                return None, None, None, None, None, None, xbound
            alpha, beta = rows.r[:, 0].T * (span / unit) ** 2, rows.r[:, 1].T * span / unit**2
            both = np.concatenate([np.eye(len(rows)), -np.eye(len(rows))])
            # "interpolation": each holds at both ends of an interval
            given = (beta, alpha, np.zeros_like(alpha), both, rows.bounds.T.reshape(-1), xbound, None)
            *canonical, xbound, ubound = linear_constraint.canlinear_colloc_to_interpolate(
                *given, gridpoints, identical=True
            )
            return *canonical, ubound, xbound

        def get_dof(self) -> int:
            return section.curve.dim

    problem = algorithm.TOPPRA([GivenRows()], Interval(), gridpoints=gridpoints, solver_wrapper="seidel")
    ends = [
        end.feed / points.tip[1, at] * unit / span if isinstance(end, Feed) else 0.0
        for end, at in ((section.start, 0), (section.end, -1))
    ]
    problem.compute_parameterization(*ends)
    sd = problem.problem_data.sd_vec
    if sd is None or not np.isfinite(sd).all():
        if max(ends) > 0.0:
            raise InfeasibleError(
                f"no plan between start_feed = {feed_at(section.start):g} and end_feed = "
                f"{feed_at(section.end):g} mm/s keeps the acceleration limits: {problem.problem_data.return_code}"
            )
        raise SolverError(f"toppra found no plan: {problem.problem_data.return_code.name}; the method optimal plans it")
    return np.asarray((sd * span / unit) ** 2)
