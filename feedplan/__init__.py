"""Time-optimal, jerk-limited feedrate planning for parametric tool paths.

    import feedplan as fp
    curve = fp.load_curve("butterfly-nurbs")
    limits = fp.load_limits("mill").for_curve(curve)
    profile = fp.plan_feedrate(curve, limits)
    print(profile.duration, fp.check(curve, limits, profile).ok)

Lengths are in mm, angles in rad, times in s.  Every public name of ``planner`` (offline) and ``interp`` (real time) is here
too, and loads its module when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from planner import __version__ as __version__

if TYPE_CHECKING:
    from feedplan.page import write_report
    from feedplan.verdict import Verdict
    from interp import (
        FORMS,
        XY_TABLE,
        AdaptiveLimits,
        AxisDrive,
        FeedShape,
        GreedyRun,
        InterpolatorTable,
        TaylorTable,
        contour_error,
        filter_axes,
        greedy,
        interpolate_adaptive,
        interpolate_constant,
        interpolate_shape,
        quintic_step,
        replay,
        replay_form,
        start,
        taylor_step,
        track,
    )
    from planner import (
        CATALOG,
        Break,
        BrokenLimitError,
        Curve,
        CurveError,
        FeedrateError,
        FeedrateLimits,
        FeedrateProfile,
        FittedCurve,
        InfeasibleError,
        InputError,
        Limits,
        LineTimes,
        ProfileStates,
        Program,
        ProgramPath,
        ProgramPlan,
        Report,
        Row,
        Samples,
        SolverError,
        StalledError,
        WrittenProgram,
        certify,
        check,
        feedrate_limits,
        line_times,
        load_curve,
        load_limits,
        plan_feedrate,
        plan_program,
        program_path,
        read_dxf,
        read_points,
        read_program,
        read_table,
        table_limits,
        write_ngc,
        write_program,
        write_table,
    )

__all__ = [
    "CATALOG",
    "FORMS",
    "XY_TABLE",
    "AdaptiveLimits",
    "AxisDrive",
    "Break",
    "BrokenLimitError",
    "Curve",
    "CurveError",
    "FeedShape",
    "FeedrateError",
    "FeedrateLimits",
    "FeedrateProfile",
    "FittedCurve",
    "GreedyRun",
    "InfeasibleError",
    "InputError",
    "InterpolatorTable",
    "Limits",
    "LineTimes",
    "ProfileStates",
    "Program",
    "ProgramPath",
    "ProgramPlan",
    "Report",
    "Row",
    "Samples",
    "SolverError",
    "StalledError",
    "TaylorTable",
    "Verdict",
    "WrittenProgram",
    "certify",
    "check",
    "contour_error",
    "feedrate_limits",
    "filter_axes",
    "greedy",
    "interpolate_adaptive",
    "interpolate_constant",
    "interpolate_shape",
    "line_times",
    "load_curve",
    "load_limits",
    "plan_feedrate",
    "plan_program",
    "program_path",
    "quintic_step",
    "read_dxf",
    "read_points",
    "read_program",
    "read_table",
    "replay",
    "replay_form",
    "start",
    "table_limits",
    "taylor_step",
    "track",
    "write_ngc",
    "write_program",
    "write_report",
    "write_table",
]

_HOME = {
    "feedplan.page": ("write_report",),
    "feedplan.verdict": ("Verdict",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in _MODULE_OF:
        value = getattr(import_module(_MODULE_OF[name]), name)
    else:
        interp, planner = import_module("interp"), import_module("planner")
        value = getattr(interp if name in interp.__all__ else planner, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
