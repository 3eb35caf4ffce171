"""Straight ways in a log, and the stretches of constant acceleration along them.

1. The positions of a piece fall into runs on straight lines, as long as the noise lets them be: along one the axes move in
   one ratio, so that a limit of one axis is a limit along the line.
2. The way along a run falls into stretches, each as long as one parabola fits it within the noise.
3. Of each, the acceleration, its standard error and the speeds at its ends count.

Runs of arcs and splines are short and yield no stretch: on them an axis' acceleration is no plateau.  Known limitation: a
slow change that hides in the noise is part of its stretch; its ends are left out of the fit for that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from planner.calibration.log import Log
from planner.types import FloatArray

LEAST = 7  # samples of a stretch: a parabola fits three, and four more try it
_STRAY = 4.5  # standard deviations; in 1e5 samples of noise hardly one strays as far
_FLOOR = 1e-7  # mm: what a log of many digits is off, be there no other noise
_SAME = 1e-9  # mm: values as near are one
_END = 0.1  # of a stretch, at each end, where a change may hide in the noise
_WHOLE = 0.05  # of a count, by which multiples may be off
_FIFTH = 252.0  # variance of a fifth difference of noise of variance 1


@dataclass(frozen=True)
class SteadyStretch:
    """Constant acceleration along a straight line.

    Attributes
    ----------
    log : int
        Which of the logs.
    first, last : int
        Samples of the log, both included.
    run : int
        Which straight run.
    direction : tuple of float
        Unit vector in the log's axes.
    acceleration, error : float
        Along the line, and its standard error, mm/s^2.
    speeds : tuple of float
        At the first and last sample, mm/s.
    """

    log: int
    first: int
    last: int
    run: int
    direction: tuple[float, ...]
    acceleration: float
    error: float
    speeds: tuple[float, float]


@dataclass(frozen=True, eq=False)
class StraightRun:
    """A straight run: time and way (n,) along its line from the sample ``first`` on, their noise, and what it may add up to.

    Axes that move alike are rounded alike: ``worst`` is the sum over the axes, ``noise`` the root of the sum of squares.
    """

    log: int
    first: int
    direction: FloatArray
    t: FloatArray
    way: FloatArray
    noise: float
    worst: float


def noise_of(log: Log) -> FloatArray:
    """Standard deviation of each axis' noise, (d,): from fifth differences while it moves, and from what it is rounded to.

    Motion of piecewise constant jerk has fifth differences at its knots alone, which the median passes over.  Of positions
    rounded to counts of an encoder the median may see nothing, where a count is no fraction of the steps.
    """
    found = np.full(len(log.axes), _FLOOR)
    for j in range(len(log.axes)):
        parts = []
        for piece in log.pieces:
            x = log.position[piece, j]
            parts.append(np.diff(x, 5)[np.abs(x[5:] - x[:-5]) > 0.0])
        rough = np.concatenate(parts)
        spread = 1.4826 * float(np.median(np.abs(rough))) / np.sqrt(_FIFTH) if rough.size else 0.0
        found[j] = max(_FLOOR, spread, _count(log.position[:, j]) / np.sqrt(12.0))
    return found


def _count(x: FloatArray) -> float:
    """What positions are whole multiples of, 0 if of nothing."""
    gaps = np.diff(np.unique(x - x[0]))
    gaps = gaps[gaps > _SAME]
    if gaps.size == 0:
        return 0.0
    count = float(gaps.min())
    # The smallest gap is known to a billionth of the way; the mean over many counts is what it really is.
    count *= float(np.sum(gaps) / count / max(np.sum(np.round(gaps / count)), 1.0))
    off = gaps / count - np.round(gaps / count)
    return count if np.abs(off).max() < _WHOLE else 0.0


def straight_runs(log: Log, index: int) -> Iterator[StraightRun]:
    """Cut a log into runs on straight lines."""
    sigma = noise_of(log)
    for piece in log.pieces:
        yield from _of_piece(log, index, piece, sigma)


def _of_piece(log: Log, index: int, piece: slice, sigma: FloatArray) -> Iterator[StraightRun]:
    allowed = _STRAY * float(np.linalg.norm(sigma))
    t, p = log.t[piece], log.position[piece]
    at = 0
    while at + LEAST <= t.size:
        n = _longest(lambda a, b: _is_straight(p[a:b], allowed), at, t.size)
        if n >= LEAST:
            q = p[at : at + n]
            direction = _direction(q)
            if np.linalg.norm(q - q[0], axis=1).max() > 10.0 * allowed:
                way = (q - q[0]) @ direction
                noises = np.abs(direction) * sigma
                noise, worst = float(np.linalg.norm(noises)), float(noises.sum())
                yield StraightRun(index, piece.start + at, direction, t[at : at + n], way, noise, worst)
        # Runs of noise share their ends; a corner is no part of either.
        at += max(n - 1, 1)


def stretches(log: Log, index: int) -> tuple[list[StraightRun], list[SteadyStretch]]:
    """Stretches of constant acceleration of a log, in the order of time, with the runs that they are of."""
    runs = list(straight_runs(log, index))
    return runs, [stretch for k, run in enumerate(runs) for stretch in _of_run(run, k)]


def _of_run(run: StraightRun, number: int) -> Iterator[SteadyStretch]:
    at, n = 0, run.t.size
    while at + LEAST <= n:
        count = _longest(lambda a, b: _is_parabola(run.t[a:b], run.way[a:b], run.noise), at, n)
        if count < LEAST:
            at += 1
            continue
        cut = int(_END * count) if count >= 2 * LEAST else 0
        inner = slice(at + cut, at + count - cut)
        t, s = run.t[inner], run.way[inner]
        mean, half = 0.5 * (t[0] + t[-1]), 0.5 * (t[-1] - t[0])
        _c0, c1, c2 = _parabola((t - mean) / half, s)
        a = 2.0 * c2 / half**2
        error = run.worst * np.sqrt(720.0 / t.size) / (t[-1] - t[0]) ** 2
        ends = np.array([run.t[at], run.t[at + count - 1]])
        v = c1 / half + a * (ends - mean)
        yield SteadyStretch(
            run.log, run.first + at, run.first + at + count - 1, number, tuple(run.direction.tolist()), float(a),
            float(error), (float(v[0]), float(v[1])),
        )  # fmt: skip
        at += max(count - 1, 1)


def _longest(fits: Callable[[int, int], bool], at: int, end: int) -> int:
    """Samples from ``at`` that fit, by doubling and halving; 0 where the fewest do not."""
    good, bad = 0, 0
    n = min(LEAST, end - at)
    while True:
        if not fits(at, at + n):
            bad = n
            break
        good = n
        if at + n == end:
            return good
        n = min(2 * n, end - at)
    if good == 0:
        return 0
    while bad - good > 1:
        middle = (good + bad) // 2
        if fits(at, at + middle):
            good = middle
        else:
            bad = middle
    return good


def _direction(q: FloatArray) -> FloatArray:
    """Unit vector of the line through positions, towards the farthest from the first."""
    centred = q - q.mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    far = q[np.argmax(np.sum((q - q[0]) ** 2, axis=1))] - q[0]
    return np.asarray(direction if direction @ far >= 0.0 else -direction)


def _is_straight(q: FloatArray, allowed: float) -> bool:
    """Whether positions lie on a line: by the line from the first to the farthest, and the best one if that fails."""
    if q.shape[1] == 1:
        return True
    off = q - q[0]
    square = np.sum(off**2, axis=1)
    far = off[np.argmax(square)]
    size = float(np.sqrt(far @ far))
    if size <= allowed:
        return True
    unit = far / size
    away = square - (off @ unit) ** 2
    return bool(away.max() <= allowed**2)


def _parabola(x: FloatArray, s: FloatArray) -> FloatArray:
    """Coefficients of the parabola of least squares through (x, s), constant first."""
    return np.asarray(np.linalg.lstsq(np.vander(x, 3, increasing=True), s, rcond=None)[0], dtype=np.float64)


def _is_parabola(t: FloatArray, s: FloatArray, noise: float) -> bool:
    mean, half = 0.5 * (t[0] + t[-1]), 0.5 * (t[-1] - t[0])
    x = (t - mean) / half
    off = s - np.vander(x, 3, increasing=True) @ _parabola(x, s)
    freedom = t.size - 3
    if np.abs(off).max() > _STRAY * noise:
        return False
    return bool(off @ off <= noise**2 * (freedom + 3.5 * np.sqrt(2.0 * freedom)))
