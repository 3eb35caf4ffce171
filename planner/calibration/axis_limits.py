"""Limits of axes from what was reached along straight lines.

Along a direction d the limit a of the path is the least a_i / |d_i|: one axis, or several, is at its own.  So

1. an axis' limit is at least the largest |d_i| a that was seen;
2. of each line, the axes at that largest value can be what held it back, and one of them was;
3. a line with one such axis proves that axis' limit; where each has two, none is proved.

A limit of the path itself (the tangential acceleration of a controller) looks as one of every axis that it is seen on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.quantity import Quantity
from planner.types import BoolArray, FloatArray

_NEAR = 0.02  # of a limit: as near can be at it
_AT = 0.003  # of a limit, or three standard errors: as near is it
_SURE = 5.0  # standard errors


@dataclass(frozen=True)
class AxisLimit:
    """What the logs tell of one limit of one axis.

    Attributes
    ----------
    axis : str
    quantity : Quantity
    value : float
        mm (rad) and s; where it is not known, the largest that was seen; 0 where nothing was.
    known : bool
    count : int
        Stretches that have it.
    spread : float
        Largest distance of one of them from the value, as a share of it.
    why : str
        Where it is not known, why.
    joint : bool
        Not known by itself, but one of several that fit together: of these, what is nearest to the start.
    """

    axis: str
    quantity: Quantity
    value: float
    known: bool
    count: int = 0
    spread: float = 0.0
    why: str = ""
    joint: bool = False


def axis_limits(
    quantity: Quantity,
    axes: Sequence[str],
    directions: FloatArray,
    reached: FloatArray,
    errors: FloatArray,
    binds: BoolArray | None = None,
) -> list[AxisLimit]:
    """Find the limit of each axis.

    Parameters
    ----------
    quantity : Quantity
    axes : sequence of str
        The columns of ``directions``.
    directions : (k, d) array
        Unit vectors.
    reached, errors : (k,) arrays
        What was reached along them, > 0, and its standard error.
    binds : (k,) bool array, optional
        Where a limit of an axis held it back; else what was reached says no more than "at least".
    """
    binds = np.ones(reached.size, dtype=bool) if binds is None else binds
    own = np.abs(directions) * reached[:, None]
    error = np.abs(directions) * errors[:, None]
    top = np.array([_top(own[:, j], error[:, j]) for j in range(len(axes))])
    at = (own + 2.0 * error >= (1.0 - _NEAR) * top) & (own > _SURE * error) & (own > 0.0)
    found = []
    for j, axis in enumerate(axes):
        alone = at[:, j] & (at.sum(axis=1) == 1) & binds
        if top[j] <= 0.0:
            found.append(AxisLimit(axis, quantity, 0.0, False, why="no log has this axis move so on a straight line"))
            continue
        same = at[:, j] & (np.abs(own[:, j] - top[j]) <= np.maximum(_AT * top[j], 3.0 * error[:, j]))
        mean = _mean(own[same, j], error[same, j])
        spread = float(np.abs(own[same, j] / mean - 1.0).max())
        count = int(same.sum())
        if alone.any():
            found.append(AxisLimit(axis, quantity, mean, True, count, spread))
            continue
        others = [axes[i] for i in np.flatnonzero(at[at[:, j]].any(axis=0)).tolist() if i != j]
        why = "no stretch was held back by it: it may be higher"
        if binds[at[:, j]].any() and others:
            why = f"it was reached only together with {' '.join(others)}: either may have been the one that held back"
        found.append(AxisLimit(axis, quantity, mean, False, count, spread, why))
    return found


def path_limit(values: FloatArray, directions: FloatArray) -> FloatArray:
    """The limit along directions (k, d) by those of the axes (d,): the least a_i / |d_i|, (k,)."""
    size = np.abs(directions)
    with np.errstate(divide="ignore"):
        return np.asarray(np.min(np.where(size > 0.0, values / np.where(size > 0.0, size, 1.0), np.inf), axis=1))


def _top(own: FloatArray, error: FloatArray) -> float:
    """The largest value that is there for sure: the largest by what it is at least, and the mean of those as large."""
    sure = own > _SURE * error
    if not sure.any():
        return 0.0
    least = np.where(sure, own - 3.0 * error, 0.0)
    largest = float(least.max())
    near = sure & (own + 3.0 * error >= (1.0 - _AT) * largest)
    return _mean(own[near], error[near])


def _mean(values: FloatArray, errors: FloatArray) -> float:
    """Mean, weighted by what is known of each."""
    weight = 1.0 / (errors**2 + (1e-4 * values) ** 2)
    return float(np.sum(weight * values) / np.sum(weight))
