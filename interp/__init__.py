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
    from interp.taylor import InterpolatorTable, TaylorTable, quintic_step, start, taylor_step

__all__ = ["InterpolatorTable", "TaylorTable", "quintic_step", "replay", "start", "taylor_step"]

# Names that need compiled code: their module loads with their first use.
_COMPILED = dict.fromkeys(("InterpolatorTable", "TaylorTable", "quintic_step", "start", "taylor_step"), "interp.taylor")


def __getattr__(name: str) -> Any:
    if name not in _COMPILED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_COMPILED[name]), name)
