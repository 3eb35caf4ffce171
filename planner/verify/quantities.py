"""What is measured of a plan at a point of its path, and in which order.

As rows: feed, tangential acceleration, tangential jerk, speed backwards along u; then velocity, acceleration and jerk,
each of every axis: ``4 + 3 dim`` of them.
"""

from __future__ import annotations

import numpy as np

from planner.quantity import AXIS, FEED, TANGENTIAL, Quantity
from planner.types import FloatArray

_TIP_RATES = (FEED, *TANGENTIAL)
REVERSAL = len(_TIP_RATES)  # row of -u'
ALONG = tuple(range(1, REVERSAL))  # rows of the rates along the path beyond the feed
FIRST_AXIS = REVERSAL + 1  # row of the velocity of the first axis


def names(dim: int) -> tuple[tuple[str, int], ...]:
    """Limit and axis (-1: none) of each row."""
    single = (*(q.label for q in _TIP_RATES), "reversal")
    return (*((name, -1) for name in single), *((q.label, j) for q in AXIS for j in range(dim)))


def row_of(quantity: Quantity) -> int:
    """Row of a quantity of the path."""
    return _TIP_RATES.index(quantity)


def axis_rows(dim: int, k: int) -> slice:
    """Rows of the axes' velocity (k = 0), acceleration (1) or jerk (2)."""
    return slice(FIRST_AXIS + k * dim, FIRST_AXIS + (k + 1) * dim)


def sizes_of(values: FloatArray) -> FloatArray:
    """What is compared with the limits: sizes, but of the speed backwards only what is backwards."""
    sizes = np.abs(values)
    sizes[REVERSAL] = values[REVERSAL]
    return sizes
