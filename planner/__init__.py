"""Time-optimal, jerk-limited feedrate planning for parametric tool paths (offline stage).

    from planner import load_curve, load_limits, plan_feedrate, check
    curve, limits = load_curve("butterfly-nurbs"), load_limits("mill.toml")
    profile = plan_feedrate(curve, limits)
    print(profile.duration, check(curve, limits, profile).ok)

Lengths are in mm, angles in rad, times in s.
"""

from planner.errors import (
    CurveError,
    FeedrateError,
    InfeasibleError,
    InputError,
    SolverError,
    StalledError,
)
from planner.geometry.catalog import CATALOG, load_curve
from planner.geometry.curve import Break, Curve
from planner.limits import FeedrateLimits, Limits, feedrate_limits, load_limits
from planner.profile import FeedrateProfile, ProfileStates, Samples

__all__ = [
    "CATALOG",
    "Break",
    "Curve",
    "CurveError",
    "FeedrateError",
    "FeedrateLimits",
    "FeedrateProfile",
    "InfeasibleError",
    "InputError",
    "Limits",
    "ProfileStates",
    "Samples",
    "SolverError",
    "StalledError",
    "feedrate_limits",
    "load_curve",
    "load_limits",
]
