"""The time of a path without a jerk limit: what a look-ahead with trapezoidal feeds takes at best.

Controllers without a jerk limit plan in this way.  The law is toppra's on the grid of the planner, taken as it is: inside
a corner of some micrometres its acceleration may be a little above the limit between two nodes, which is worth 0.5 % of
the time at most on the paths tried, so it is a model to compare with and no plan to cut with.
"""

from __future__ import annotations

import numpy as np

from planner.geometry.curve import Curve, FloatArray
from planner.limits import Limits
from planner.profile import FeedrateProfile, make_profile
from planner.refine import DEFAULT_INTERVALS, MIN_INTERVALS
from planner.sections import cut
from planner.solvers.topp import plan_section


def plan_without_jerk(curve: Curve, limits: Limits, intervals: int | None = None) -> FeedrateProfile:
    """Plan a path from rest to rest, stopping at its corners, without any jerk limit.

    Parameters
    ----------
    curve : Curve
    limits : Limits
        Their jerk is ignored.
    intervals : int, optional
        Number of grid intervals.

    Returns
    -------
    FeedrateProfile
        Of the method "toppra".

    Raises
    ------
    InputError
        If the axes of the limits are not those of the curve.
    SolverError
        If toppra finds no plan.
    """
    limits.require_matches(curve)
    free = Limits(
        limits.feed,
        limits.velocity,
        limits.acceleration,
        np.full(limits.dim, np.inf),
        chord_error=limits.chord_error,
        period=limits.period,
        tangential_acceleration=limits.tangential_acceleration,
        axes=limits.axes,
    )
    # bends too tight to be seen on the grid are stops here
    sections = cut(curve, limits, 0.0, 0.0, exact_stop=False, fillets=False)
    lengths = np.diff(curve.arclength.s(np.array([*(s.u_start for s in sections), sections[-1].u_end])))
    counts = np.maximum(MIN_INTERVALS, np.rint((intervals or DEFAULT_INTERVALS) * lengths / lengths.sum())).astype(int)
    columns: list[list[FloatArray]] = [[], [], [], []]
    begin = 0.0
    for section, count in zip(sections, counts.tolist(), strict=True):
        nodes = plan_section(section, limits, count)[0]
        for column, values in zip(columns, (nodes.t + begin, nodes.u, nodes.u_rate, nodes.u_acceleration), strict=True):
            column.append(values)
        begin = float(columns[0][-1][-1])
    t, u, rate, acceleration = (np.concatenate(column) for column in columns)
    return make_profile(curve, free, (t, u, rate, acceleration), method="toppra", lower_bound=begin)
