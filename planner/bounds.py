"""How far from optimal a plan can be: lower bounds on the time.

Two bounds.  The cheap one is the optimum without a jerk limit: every plan under a jerk limit is a plan without one.  The
tight one (:func:`certify`) is a proof about the discretised problem itself.  The optimum's multipliers l give the
Lagrangian, whose minimum over x, a, c is a lower bound; it is convex in x where w >= Lam (see ``solvers/optimal.py``),
and there the optimum is its minimum.  At the few points where w < Lam, almost all of them next to a stop, the bound
x^(-1/2) of the jerk rows is replaced by its chord over [x_lo, x_hi].  The chord lies above the convex function, so this
only adds plans; those rows become linear, and the time of the new optimum, once its Lagrangian is convex everywhere, is a
lower bound for every plan with x in [x_lo, x_hi] there.  And every plan worth having is:

    x_hi   the smallest of the speed cap, the optimum without a jerk limit, and what the jerk allows at a distance from
           rest: an axis that has moved by d in one direction from a stop has v^3 <= 4.5 J d^2;
    x_lo   a plan that is slower at one point only loses the time w x^(-1/2) there against the optimum without a jerk
           limit, and may lose no more than the plan at hand does.

The bounds hold for the problem collocated on a grid, whose optimum differs from the continuous one by about 1e-4 at the
default grid.  For x_lo and x_hi that grid's optimum without jerk limit is used.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.constraints import Constraints, Path, acceleration_rows, build, path_at, speed_cap
from planner.errors import SolverError
from planner.geometry.curve import Curve, FloatArray
from planner.grid import Grid, place_knots, scan, with_blends
from planner.limits import Limits
from planner.profile import FeedrateProfile
from planner.sections import Section, cut
from planner.solvers.optimal import Iterate, Solution

_INTERVALS = 500
_MIN_INTERVALS = 40
_GAP = 1e-6
_MAX_ROUNDS = 12
# A displacement smaller than this share of the axis' largest coordinate is rounding.
_SMALLEST_DISPLACEMENT = 1e-11


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
    return max(total, profile.lower_bound) if np.isfinite(profile.lower_bound) else total


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
    sigma = section.rest_map(grid.sigma)[0] - plain.y_start
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
    from planner.solvers import nlp, optimal

    guess = scan(section, limits, intervals)
    section = with_blends(section, guess)
    grid = place_knots(section, guess, intervals)
    problem, _ = build(section, limits, grid, guess, periodic=periodic)
    solution = optimal.solve(problem, optimal.start_from(problem, problem.guess))
    return nlp.relaxed_time(replace(problem, guess=solution.x)) * problem.time_unit
