"""What the limits ask of the motions, each as one linear row of time derivatives.

A *motion* is a machine axis, or last the arc length of the tool tip.  With q its position, a limit reads

    lower <= w1 q' + w2 q'' + w3 q''' <= upper          (a prime is d/dt here),

lower < 0 < upper: a machine at rest keeps its limits.  The two bounds need not be of the same size: the motor of a vertical
axis that carries a weight has less left upwards than downwards.  One may be infinite, as of a limit on braking alone.  Feed
and chord error are not here; they change along a path and are limits on its speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from planner.machine.limits import Limits
from planner.quantity import AXIS, TANGENTIAL, Quantity, Scope


@dataclass(frozen=True)
class LimitRow:
    """One limit on one motion.

    Attributes
    ----------
    quantity : Quantity
    axis : str
        Empty for the arc length of the tip.
    motion : int
        Index of the motion: of the axis, or their number for the arc length.
    weights : (float, float, float)
        Of velocity, acceleration and jerk of the motion.
    lower, upper : float
        What the weighted sum stays within.
    scale : float
        What it is divided by where it is compared with others; bounds of the same size become -1 and 1.
    """

    quantity: Quantity
    axis: str
    motion: int
    weights: tuple[float, float, float]
    lower: float
    upper: float
    scale: float

    @property
    def name(self) -> str:
        """Name of the limit, as a plan has it."""
        return self.quantity.of(self.axis)

    @property
    def along(self) -> bool:
        """Whether its motion is the arc length of the tip."""
        return self.quantity.scope is Scope.PATH

    @property
    def order(self) -> int:
        """Order of the highest derivative in it."""
        return 1 + max(k for k, weight in enumerate(self.weights) if weight != 0.0)

    @property
    def bounds(self) -> tuple[float, float]:
        """The bounds of the scaled row."""
        return self.lower / self.scale, self.upper / self.scale


@lru_cache(maxsize=8)  # limits do not change, equal ones have equal rows, and a plan asks again and again
def limit_rows(limits: Limits) -> tuple[LimitRow, ...]:
    """Every finite limit on a motion; those of one order stand together, the axes' before that of the arc length."""
    quantities = sorted((*AXIS, *TANGENTIAL), key=lambda q: (q.order, q.scope is Scope.PATH))
    return tuple(
        _symmetric(quantity, axis, motion, most)
        for quantity in quantities
        for axis, motion, most in _limited(limits, quantity)
        if np.isfinite(most)
    )


def _limited(limits: Limits, quantity: Quantity) -> list[tuple[str, int, float]]:
    """Axis, motion and limit of a quantity."""
    if quantity in AXIS:
        return list(zip(limits.axes, range(limits.dim), limits.of(quantity), strict=True))
    return [("", limits.dim, limits.of(quantity)[0])]


def _symmetric(quantity: Quantity, axis: str, motion: int, most: float) -> LimitRow:
    """A limit on the size of one derivative."""
    first, second, third = (1.0 if quantity.order == order else 0.0 for order in (1, 2, 3))
    return LimitRow(quantity, axis, motion, (first, second, third), -most, most, most)
