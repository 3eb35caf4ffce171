"""The real-time stage: samples of a plan, one point a period, and the interpolators of the literature.

    from interp import replay
    samples = replay(curve, profile, 1e-3)

and, for a controller's own loop, the tables and steps behind it:

    from interp import InterpolatorTable, quintic_step, start
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# ``replay`` shares its name with its module; imported here, the name is the function from then on.
from interp.replay import replay

if TYPE_CHECKING:
    from interp.literature.feedshapes import FeedShape, filter_axes, interpolate_constant, interpolate_shape
    from interp.literature.forms import FORMS, replay_form
    from interp.literature.greedy import greedy
    from interp.literature.greedy_run import GreedyRun
    from interp.literature.lookahead import AdaptiveLimits, interpolate_adaptive
    from interp.literature.servo import XY_TABLE, AxisDrive, contour_error, track
    from interp.plan_file import read_plan_file, write_plan_file
    from interp.rate_limits import RateLimits
    from interp.step import PlanStep
    from interp.taylor import InterpolatorTable, TaylorTable, quintic_step, start, taylor_step

__all__ = [
    "FORMS",
    "XY_TABLE",
    "AdaptiveLimits",
    "AxisDrive",
    "FeedShape",
    "GreedyRun",
    "InterpolatorTable",
    "PlanStep",
    "RateLimits",
    "TaylorTable",
    "contour_error",
    "filter_axes",
    "greedy",
    "interpolate_adaptive",
    "interpolate_constant",
    "interpolate_shape",
    "quintic_step",
    "read_plan_file",
    "replay",
    "replay_form",
    "start",
    "taylor_step",
    "track",
    "write_plan_file",
]

# Names whose module loads with their first use.
_HOME = {
    "interp.literature.feedshapes": ("FeedShape", "filter_axes", "interpolate_constant", "interpolate_shape"),
    "interp.literature.forms": ("FORMS", "replay_form"),
    "interp.literature.greedy": ("greedy",),
    "interp.literature.greedy_run": ("GreedyRun",),
    "interp.literature.lookahead": ("AdaptiveLimits", "interpolate_adaptive"),
    "interp.literature.servo": ("XY_TABLE", "AxisDrive", "contour_error", "track"),
    "interp.plan_file": ("read_plan_file", "write_plan_file"),
    "interp.rate_limits": ("RateLimits",),
    "interp.step": ("PlanStep",),
    "interp.taylor": ("InterpolatorTable", "TaylorTable", "quintic_step", "start", "taylor_step"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)
