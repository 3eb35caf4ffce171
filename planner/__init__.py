"""Time-optimal, jerk-limited feedrate planning for parametric tool paths (offline stage).

    from planner import load_curve, load_limits, plan_feedrate, check
    curve, limits = load_curve("butterfly-nurbs"), load_limits("mill")
    limits = limits.for_curve(curve)
    profile = plan_feedrate(curve, limits)
    print(profile.duration, check(curve, limits, profile).ok)

Lengths are in mm, angles in rad, times in s.

Every public name loads its module when it is first used: the command line answers before numpy would have loaded.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.bounds import certify
    from planner.check import Report, Row, check
    from planner.errors import (
        BrokenLimitError,
        CurveError,
        FeedrateError,
        InfeasibleError,
        InputError,
        SolverError,
        StalledError,
    )
    from planner.geometry.catalog import CATALOG, load_curve
    from planner.geometry.curve import Break, Curve
    from planner.geometry.drawing import read_dxf
    from planner.geometry.points import FittedCurve, read_points
    from planner.limits import FeedrateLimits, Limits, feedrate_limits, load_limits
    from planner.ngc import WrittenProgram, write_ngc
    from planner.plan import plan_feedrate
    from planner.profile import FeedrateProfile, ProfileStates, Samples
    from planner.programs.path import ProgramPath, program_path
    from planner.programs.program import Program
    from planner.programs.reader import read_program
    from planner.programs.times import LineTimes, line_times
    from planner.programs.windows import ProgramPlan, plan_program
    from planner.programs.written import write_program
    from planner.report import write_report
    from planner.tables import read_table, table_limits, write_table

__all__ = [
    "CATALOG",
    "Break",
    "BrokenLimitError",
    "Curve",
    "CurveError",
    "FeedrateError",
    "FeedrateLimits",
    "FeedrateProfile",
    "FittedCurve",
    "InfeasibleError",
    "InputError",
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
    "WrittenProgram",
    "certify",
    "check",
    "feedrate_limits",
    "line_times",
    "load_curve",
    "load_limits",
    "plan_feedrate",
    "plan_program",
    "program_path",
    "read_dxf",
    "read_points",
    "read_program",
    "read_table",
    "table_limits",
    "write_ngc",
    "write_program",
    "write_report",
    "write_table",
]

__version__ = "0.1.0"

_HOME = {
    "bounds": ("certify",),
    "check": ("Report", "Row", "check"),
    "errors": (
        "BrokenLimitError",
        "CurveError",
        "FeedrateError",
        "InfeasibleError",
        "InputError",
        "SolverError",
        "StalledError",
    ),
    "geometry.catalog": ("CATALOG", "load_curve"),
    "geometry.curve": ("Break", "Curve"),
    "geometry.drawing": ("read_dxf",),
    "geometry.points": ("FittedCurve", "read_points"),
    "limits": ("FeedrateLimits", "Limits", "feedrate_limits", "load_limits"),
    "ngc": ("WrittenProgram", "write_ngc"),
    "plan": ("plan_feedrate",),
    "profile": ("FeedrateProfile", "ProfileStates", "Samples"),
    "report": ("write_report",),
    "programs.path": ("ProgramPath", "program_path"),
    "programs.program": ("Program",),
    "programs.reader": ("read_program",),
    "programs.times": ("LineTimes", "line_times"),
    "programs.windows": ("ProgramPlan", "plan_program"),
    "programs.written": ("write_program",),
    "tables": ("read_table", "table_limits", "write_table"),
}
_MODULE_OF = {name: f"{__name__}.{module}" for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """Keeps ``planner.check`` the function: importing its module, of the same name, would put the module there."""

    def __setattr__(self, name: str, value: object) -> None:
        if isinstance(value, ModuleType) and name in _MODULE_OF:
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
