"""Time-optimal, jerk-limited feedrate planning for parametric tool paths.

    import feedplan as fp
    curve = fp.load_curve("butterfly-nurbs")
    limits = fp.load_limits("mill")
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
    from feedplan.comparison import Comparison, compare
    from feedplan.job import Job, load_job, load_job_of_table, plan_and_check
    from feedplan.page import write_report
    from feedplan.program_time import ProgramTime, time_program
    from feedplan.tolerances import ToleranceTime, time_of_tolerances
    from feedplan.verdict import Verdict
    from interp import (
        FORMS,
        XY_TABLE,
        AdaptiveLimits,
        AxisDrive,
        FeedShape,
        GreedyRun,
        InterpolatorTable,
        PlanStep,
        RateLimits,
        TaylorTable,
        contour_error,
        filter_axes,
        greedy,
        interpolate_adaptive,
        interpolate_constant,
        interpolate_shape,
        quintic_step,
        read_plan_file,
        replay,
        replay_form,
        start,
        taylor_step,
        track,
        write_plan_file,
    )
    from interp.pulse_file import PulseTrain, read_pulses, write_pulses
    from interp.pulses import PulseBlock, PulseSummary, StepDriver, step_pulses
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
    from planner.certificate import Certificate
    from planner.geometry.makers import formula, from_points, from_spline, nurbs
    from planner.output.certificate_file import read_certificate, write_certificate
    from planner.output.cyclic_positions import write_cyclic_positions
    from planner.output.figures import save_plot
    from planner.output.joint_trajectory import JointPoints, write_joint_trajectory
    from planner.output.plots import plot_plan
    from planner.output.table import write_samples
    from planner.plan.bounds import Bound
    from planner.programs.line_table import write_line_times
    from planner.verify.certificate import BoundReport, verify_bound, verify_plan_bound

__all__ = [
    "CATALOG",
    "FORMS",
    "XY_TABLE",
    "AdaptiveLimits",
    "AxisDrive",
    "Bound",
    "BoundReport",
    "Break",
    "BrokenLimitError",
    "Certificate",
    "Comparison",
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
    "Job",
    "JointPoints",
    "Limits",
    "LineTimes",
    "PlanStep",
    "ProfileStates",
    "Program",
    "ProgramPath",
    "ProgramPlan",
    "ProgramTime",
    "PulseBlock",
    "PulseSummary",
    "PulseTrain",
    "RateLimits",
    "Report",
    "Row",
    "Samples",
    "SolverError",
    "StalledError",
    "StepDriver",
    "TaylorTable",
    "ToleranceTime",
    "Verdict",
    "WrittenProgram",
    "certify",
    "check",
    "compare",
    "contour_error",
    "feedrate_limits",
    "filter_axes",
    "formula",
    "from_points",
    "from_spline",
    "greedy",
    "interpolate_adaptive",
    "interpolate_constant",
    "interpolate_shape",
    "line_times",
    "load_curve",
    "load_job",
    "load_job_of_table",
    "load_limits",
    "nurbs",
    "plan_and_check",
    "plan_feedrate",
    "plan_program",
    "plot_plan",
    "program_path",
    "quintic_step",
    "read_certificate",
    "read_dxf",
    "read_plan_file",
    "read_points",
    "read_program",
    "read_pulses",
    "read_table",
    "replay",
    "replay_form",
    "save_plot",
    "start",
    "step_pulses",
    "table_limits",
    "taylor_step",
    "time_of_tolerances",
    "time_program",
    "track",
    "verify_bound",
    "verify_plan_bound",
    "write_certificate",
    "write_cyclic_positions",
    "write_joint_trajectory",
    "write_line_times",
    "write_ngc",
    "write_plan_file",
    "write_program",
    "write_pulses",
    "write_report",
    "write_samples",
    "write_table",
]

_HOME = {
    "feedplan.comparison": ("Comparison", "compare"),
    "feedplan.job": ("Job", "load_job", "load_job_of_table", "plan_and_check"),
    "feedplan.page": ("write_report",),
    "feedplan.program_time": ("ProgramTime", "time_program"),
    "feedplan.tolerances": ("ToleranceTime", "time_of_tolerances"),
    "feedplan.verdict": ("Verdict",),
    "interp.pulse_file": ("PulseTrain", "read_pulses", "write_pulses"),
    "interp.pulses": ("PulseBlock", "PulseSummary", "StepDriver", "step_pulses"),
    "planner.certificate": ("Certificate",),
    "planner.geometry.makers": ("formula", "from_points", "from_spline", "nurbs"),
    "planner.output.certificate_file": ("read_certificate", "write_certificate"),
    "planner.output.cyclic_positions": ("write_cyclic_positions",),
    "planner.output.figures": ("save_plot",),
    "planner.output.joint_trajectory": ("JointPoints", "write_joint_trajectory"),
    "planner.output.plots": ("plot_plan",),
    "planner.output.table": ("write_samples",),
    "planner.plan.bounds": ("Bound",),
    "planner.programs.line_table": ("write_line_times",),
    "planner.verify.certificate": ("BoundReport", "verify_bound", "verify_plan_bound"),
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
