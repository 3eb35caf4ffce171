"""How far from optimal a plan can be: lower bounds on the time.

The cheap bound, which every plan carries, is the optimum without a jerk limit: every plan under a jerk limit is one
without.  The tight one (:func:`certify`) is the optimum of the convex relaxation in ``solvers/relaxed.py``; on most paths
it meets the plan, which is thereby proven to be the global optimum.

Both hold for the problem collocated on a grid, whose optimum differs from the continuous one by about 1e-4 of the time
at the default grid; a bound is therefore never reported above the duration of the plan at hand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.constraints import acceleration_rows, build, path_at, speed_cap
from planner.geometry.curve import Curve, FloatArray
from planner.grid import Grid, place_knots, scan, with_blends
from planner.limits import Limits
from planner.profile import FeedrateProfile
from planner.sections import Section, cut

_INTERVALS = 1000
_MIN_INTERVALS = 40


def certify(curve: Curve, limits: Limits, profile: FeedrateProfile) -> float:
    """Bound the time of every plan from below, tightly.

    Parameters
    ----------
    curve : Curve
    limits : Limits
        Those of the plan.
    profile : FeedrateProfile
        Says where the path stops and with which feeds it begins and ends.

    Returns
    -------
    float
        No plan of the discretised problem is faster, s; at least ``profile.lower_bound``.

    Raises
    ------
    SolverError
        If the problem could not be solved again.
    """
    limits.require_matches(curve)
    if not (np.isfinite(limits.jerk).any() or np.isfinite(limits.tangential_jerk)):
        return profile.lower_bound
    periodic = bool(profile.stats.get("periodic", False))
    feeds = (0.0, 0.0) if periodic else (float(profile.feed[0]), float(profile.feed[-1]))
    exact_stop = bool(profile.stats.get("exact_stop", False))
    sections = cut(curve, limits, *feeds, exact_stop=exact_stop, periodic=periodic)
    share = max(_MIN_INTERVALS, _INTERVALS // len(sections))
    total = sum(_certify_section(section, limits, share, periodic) for section in sections)
    return min(float(np.fmax(total, profile.lower_bound)), profile.duration)


def without_jerk(section: Section, limits: Limits, grid: Grid) -> tuple[FloatArray, float]:
    """Solve a section without its jerk limit, in its coordinate without rest blends.

    Returns
    -------
    x : (n,) array
        (dy/dt)^2 at the knots.
    time : float
        A lower bound for every plan of the section, s (up to the discretisation).
    """
    from planner.solvers.kernels import fastest_without_jerk

    plain = replace(section, blend_start=0.0, blend_end=0.0)
    sigma = section.position(grid.sigma) - plain.y_start
    sigma[-1] = plain.span
    path = path_at(plain, limits, sigma, grid.u, grid.u >= grid.stretch_end)
    h = np.maximum(np.diff(sigma), 0.0)
    h[np.diff(grid.sigma) == 0.0] = 0.0
    cap = speed_cap(limits, path)
    rows = acceleration_rows(limits, path)
    finite = cap[np.isfinite(cap)]
    # Where nothing else limits x, no plan can be faster than under the largest acceleration all along.
    largest = float(finite.max()) if finite.size == cap.size else _fastest(rows, float(plain.span), finite)
    ends = [
        0.0 if feed is None else largest if np.isnan(feed) else (feed / path.tip[1, at]) ** 2
        for feed, at in ((section.start_feed, 0), (section.end_feed, -1))
    ]
    x = np.empty(h.size + 1)
    fastest_without_jerk(h, np.minimum(cap, largest), rows, ends[0], ends[1], x)
    root = np.sqrt(x)
    time = float(np.sum(2.0 * h[h > 0.0] / np.maximum(root[1:] + root[:-1], 1e-300)[h > 0.0]))
    return x, time


def _fastest(rows: FloatArray, span: float, caps: FloatArray) -> float:
    steepest = np.abs(rows[:, 1]).max(axis=0) if len(rows) else np.zeros(1)
    reach = 2.0 * span / max(float(steepest.min()), 1e-300) if steepest.min() > 0.0 else 1e300
    return max(reach, float(caps.max())) if caps.size else reach


def _certify_section(section: Section, limits: Limits, intervals: int, periodic: bool) -> float:
    from planner.solvers import optimal
    from planner.solvers.relaxed import relaxed_time

    guess = scan(section, limits, intervals)
    section = with_blends(section, guess)
    grid = place_knots(section, guess, intervals)
    problem, _ = build(section, limits, grid, guess, periodic=periodic)
    solution = optimal.solve(problem, optimal.start_from(problem, problem.guess))
    if solution.iterate is None:
        return -np.inf
    return relaxed_time(problem, solution.iterate.z) * problem.time_unit
