"""Types that every room speaks of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.intp]
BoolArray: TypeAlias = NDArray[np.bool_]
# From which side a function is looked at where it jumps.
Side: TypeAlias = Literal["left", "right"]
# Called with what is being done, and how far it is, in [0, 1], or None where nobody knows.
Progress: TypeAlias = Callable[[str, float | None], None]
