"""The highest points of many functions at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from planner.compiled import core
from planner.types import FloatArray, IntArray

# Points evaluated at once, whose arrays then stay in the cache; changes no result.
_CHUNK_POINTS = 8192
# Highest spans whose peaks are searched, and how: each round looks at 25 points and keeps 1.5 spacings on either side.
CANDIDATES = 8
_ZOOM_ROUNDS = 5
_ZOOM_POINTS = 25
_ZOOM_SHRINK = 8.0


def peaks(heights: FloatArray) -> tuple[FloatArray, IntArray]:
    """Height and index of the top of each row (..., k); inside a row, height of the parabola through the top three."""
    top = heights.argmax(axis=-1)
    middle = np.clip(top, 1, heights.shape[-1] - 2)[..., None]
    before, here, after = (np.take_along_axis(heights, middle + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    inside = (middle[..., 0] == top) & (bend < 0.0)
    rise = np.divide(-((before - after) ** 2), 8.0 * bend, out=np.zeros_like(bend), where=inside)
    return np.take_along_axis(heights, top[..., None], axis=-1)[..., 0] + rise, top


class Highest:
    """The highest few of what is offered, in rows, highest first; of equal ones that of the least index, in any order."""

    def __init__(self, rows: int = 1) -> None:
        self._kept = np.zeros(rows, dtype=np.intp)
        self._height, self._x = np.zeros((2, rows, CANDIDATES))
        self._index = np.zeros((rows, CANDIDATES), dtype=np.intp)

    @property
    def height(self) -> FloatArray:
        """Heights of those kept, (rows, candidates); every row keeps as many."""
        return np.ascontiguousarray(self._height[:, : self._kept[0]])

    @property
    def least(self) -> float:
        """What is lower is not among the highest of the first row."""
        return float(self._height[0, -1]) if self._kept[0] == CANDIDATES else -np.inf

    @property
    def index(self) -> IntArray:
        """What they are known by, (rows, candidates)."""
        return np.ascontiguousarray(self._index[:, : self._kept[0]])

    @property
    def x(self) -> FloatArray:
        """Place of each, (rows, candidates)."""
        return np.ascontiguousarray(self._x[:, : self._kept[0]])

    @property
    def rows(self) -> tuple[int, IntArray, FloatArray, IntArray, FloatArray]:
        """Room of each row, and the arrays that compiled code keeps: how many, heights, indices, places."""
        return CANDIDATES, self._kept, self._height, self._index, self._x

    def offer(self, height: FloatArray, index: IntArray, x: FloatArray) -> None:
        """Take the highest of these, (rows, n), known by their index (n,) and the place x (rows, n) of each."""
        core.peaks_keep(self._kept.size, index.size, height, index, x, *self.rows)


def zoom_trials(count: int) -> FloatArray:
    """Room for the places that a round of :func:`zoom` looks at, (count, k)."""
    return np.empty((count, _ZOOM_POINTS))


def zoom(
    height: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    half: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    trials: FloatArray | None = None,
) -> FloatArray:
    """Climb to the highest point within x - half .. x + half, each row of x (n,) on its own.

    ``trials``: :func:`zoom_trials`, for a function of the height that knows the array.
    """
    steps, x, half = np.linspace(-1.0, 1.0, _ZOOM_POINTS), x.copy(), half.copy()
    trials = zoom_trials(x.size) if trials is None else trials
    spread = core.peaks_trials.bind(*trials.shape, steps, x, half, lower, upper, trials)
    for _ in range(_ZOOM_ROUNDS):
        spread()
        core.peaks_choose(*trials.shape, trials, np.ascontiguousarray(height(trials)), _ZOOM_SHRINK, x, half)
    return x


def chunk_size(points_each: int) -> int:
    """How many things of so many points each are evaluated at once."""
    return max(1, _CHUNK_POINTS // points_each)


def chunks(count: int, points_each: int) -> Iterator[IntArray]:
    """Indices 0 .. count - 1 in pieces whose points are evaluated at once."""
    size = chunk_size(points_each)
    for first in range(0, count, size):
        yield np.arange(first, min(first + size, count))
