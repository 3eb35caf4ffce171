"""The real-time stage: samples of a plan, one point a period, and the interpolators of the literature.

    from interp import replay
    samples = replay(curve, profile, 1e-3)

and, for a controller's own loop, the tables and steps behind it:

    from interp import InterpolatorTable, quintic_step, start
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# ``greedy`` and ``replay`` share their names with their modules; imported here, the names are the functions from then on.
from interp.greedy import GreedyRun, greedy
from interp.replay import replay

if TYPE_CHECKING:
    from interp.feedshapes import FeedShape, filter_axes, interpolate_constant, interpolate_shape
    from interp.forms import FORMS, replay_form
    from interp.lookahead import AdaptiveLimits, interpolate_adaptive
    from interp.servo import XY_TABLE, AxisDrive, contour_error, track
    from interp.taylor import InterpolatorTable, TaylorTable, quintic_step, start, taylor_step

__all__ = [
    "FORMS",
    "XY_TABLE",
    "AdaptiveLimits",
    "AxisDrive",
    "FeedShape",
    "GreedyRun",
    "InterpolatorTable",
    "TaylorTable",
    "contour_error",
    "filter_axes",
    "greedy",
    "interpolate_adaptive",
    "interpolate_constant",
    "interpolate_shape",
    "quintic_step",
    "replay",
    "replay_form",
    "start",
    "taylor_step",
    "track",
]

# Names whose module loads with their first use.
_HOME = {
    "feedshapes": ("FeedShape", "filter_axes", "interpolate_constant", "interpolate_shape"),
    "forms": ("FORMS", "replay_form"),
    "lookahead": ("AdaptiveLimits", "interpolate_adaptive"),
    "servo": ("XY_TABLE", "AxisDrive", "contour_error", "track"),
    "taylor": ("InterpolatorTable", "TaylorTable", "quintic_step", "start", "taylor_step"),
}
_MODULE_OF = {name: f"{__name__}.{module}" for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)
