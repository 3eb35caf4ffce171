"""Time-optimal, jerk-limited feedrate planning for parametric tool paths (offline stage).

    from planner import load_curve, load_limits, plan_feedrate, check
    curve, limits = load_curve("butterfly-nurbs"), load_limits("mill")
    profile = plan_feedrate(curve, limits)
    print(profile.duration, check(curve, limits, profile).ok)

Lengths are in mm, angles in rad, times in s.

Every public name loads its module when it is first used: the command line answers before numpy would have loaded.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from planner.version import __version__ as __version__

if TYPE_CHECKING:
    from feedplan.page import write_report
    from planner.errors import (
        BrokenLimitError,
        CurveError,
        FeedrateError,
        InfeasibleError,
        InputError,
        SolverError,
        StalledError,
    )
    from planner.geometry.catalog import CATALOG
    from planner.geometry.continuity import Break
    from planner.geometry.curve import Curve
    from planner.geometry.drawing.read_drawing import read_dxf
    from planner.geometry.points import FittedCurve, read_points
    from planner.machine.feed_limits import FeedrateLimits, feedrate_limits
    from planner.machine.limits import Limits
    from planner.machine.machine_file import load_limits
    from planner.output.ngc import WrittenProgram, write_ngc
    from planner.output.ngc_program import write_program
    from planner.output.table import read_table, table_limits, write_table
    from planner.plan import plan_feedrate
    from planner.plan.bounds import certify
    from planner.profile import FeedrateProfile, ProfileStates
    from planner.programs.long.windows import ProgramPlan, plan_program
    from planner.programs.path.smooth_path import ProgramPath, program_path
    from planner.programs.reading.program import Program
    from planner.programs.reading.reader import read_program
    from planner.programs.source import load_curve
    from planner.programs.times import LineTimes, line_times
    from planner.samples import Samples
    from planner.verify import Report, Row, check

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


_HOME = {
    "feedplan.page": ("write_report",),  # of the door above; scripts that take it from here keep working
    "planner.errors": (
        "BrokenLimitError",
        "CurveError",
        "FeedrateError",
        "InfeasibleError",
        "InputError",
        "SolverError",
        "StalledError",
    ),
    "planner.geometry.catalog": ("CATALOG",),
    "planner.geometry.continuity": ("Break",),
    "planner.geometry.curve": ("Curve",),
    "planner.geometry.drawing.read_drawing": ("read_dxf",),
    "planner.geometry.points": ("FittedCurve", "read_points"),
    "planner.machine.feed_limits": ("FeedrateLimits", "feedrate_limits"),
    "planner.machine.limits": ("Limits",),
    "planner.machine.machine_file": ("load_limits",),
    "planner.output.ngc": ("WrittenProgram", "write_ngc"),
    "planner.output.ngc_program": ("write_program",),
    "planner.output.table": ("read_table", "table_limits", "write_table"),
    "planner.plan": ("plan_feedrate",),
    "planner.plan.bounds": ("certify",),
    "planner.profile": ("FeedrateProfile", "ProfileStates"),
    "planner.programs.long.windows": ("ProgramPlan", "plan_program"),
    "planner.programs.path.smooth_path": ("ProgramPath", "program_path"),
    "planner.programs.reading.program": ("Program",),
    "planner.programs.reading.reader": ("read_program",),
    "planner.programs.source": ("load_curve",),
    "planner.programs.times": ("LineTimes", "line_times"),
    "planner.samples": ("Samples",),
    "planner.verify": ("Report", "Row", "check"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
