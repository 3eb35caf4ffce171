"""How a plan was asked for: what it takes to make its curve again and to check and replay it as it was meant."""

from __future__ import annotations

from dataclasses import dataclass

from planner.geometry.tolerance import PathTolerance
from planner.machine.limits import DEFAULT_PERIOD


@dataclass(frozen=True)
class Origin:
    """How a plan was asked for.

    Attributes
    ----------
    period : float
        Of the controller it was made for, s.
    exact_stop : bool
        It stops at curvature jumps instead of passing them slowly.
    periodic : bool or None
        It passes its end into its start; None where nobody says so, as in plans of other makers.
    tolerance : PathTolerance or None
        Within which its curve was made from a part program or from points; None for an exact curve.
    override_reserve : float
        Share of every jerk limit, and three times the share of every acceleration limit, that the plan leaves for feed
        override and feed hold; 0 where it leaves none.
    """

    period: float = DEFAULT_PERIOD
    exact_stop: bool = False
    periodic: bool | None = None
    tolerance: PathTolerance | None = None
    override_reserve: float = 0.0
