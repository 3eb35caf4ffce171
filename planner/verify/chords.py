"""Chord errors: the true distance between the path and the chords of one period."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from planner.compiled import core
from planner.geometry.chord import distance_to_chord
from planner.geometry.curve import Curve
from planner.geometry.differential import norm
from planner.samples import Samples
from planner.types import FloatArray, IntArray
from planner.verify.findings import Place
from planner.verify.motion import Motion, Quintics
from planner.verify.peaks import CANDIDATES, Highest, chunks, zoom
from planner.verify.sizes import LENGTH_ACCURACY

# A period is looked at in sixteenths; chords start every fourth of them.
CHORD_PARTS = 16
_CHORD_STRIDE = 4
_STARTS_PER_INTERVAL = 24
# The highest chords are climbed in rounds over this many starts, and as many places on the chord.
_CLIMB_ROUNDS, _CLIMB_POINTS = 12, 9
_WORTH_A_LOOK = 1e-3  # of the chord error allowed


def profile_chord(motion: Motion, period: float) -> tuple[float, Place]:
    """Largest distance between the tip's path and its chord of one period, over every start of the period.

    The last point is held, so the last chords are shorter.
    """
    law, tip = motion.law, motion.curve.tip
    u0, u1 = motion.curve.domain
    end = float(law.start[-1] + law.h[-1])
    period = min(period, end)

    def position(t: FloatArray) -> FloatArray:
        return np.asarray(tip.derivatives(law.parameters(t.reshape(-1), u0, u1), 0)[0].reshape(*t.shape, -1))

    highest = Highest()
    for starts, points, stride in _chords(law, position, period, end):
        height, at = _heights(points, stride, CHORD_PARTS, starts.size)
        highest.offer(height[None], at, starts[None])

    start, share, heights = _climb_chords(position, highest.x[0], highest.index[0] / CHORD_PARTS, period, end)
    best = int(heights.argmax())
    t = min(float(start[best] + share[best] * period), end)
    return float(heights[best]), (t, float(law.parameters(np.array([t]), u0, u1)[0]))


def _heights(points: FloatArray, stride: int, parts: int, count: int) -> tuple[FloatArray, IntArray]:
    """Largest distance of each of ``count`` chords, from points[i stride] to parts after it, and its point."""
    height, top, dim = np.empty(count), np.empty(count, dtype=np.intp), points.shape[1]
    work = np.empty(points.size + 2 * (parts + 1))
    core.chord_heights(count, dim, stride, parts, np.ascontiguousarray(points), height, top, work)
    return height, top


def _chords(
    law: Quintics, position: Callable[[FloatArray], FloatArray], period: float, end: float
) -> Iterator[tuple[FloatArray, FloatArray, int]]:
    """Starts of chords of one period, the path at equal times (points, dim), and its points from start to start.

    In chunks, each chord with the points that divide its period into equal parts.  The starts are a fraction of the
    period apart; where a plan has far more periods than nodes they follow the nodes, as nothing changes faster than
    between two of those.
    """
    part = period / CHORD_PARTS
    count = int(np.ceil(end / (part * _CHORD_STRIDE)))
    if count <= _STARTS_PER_INTERVAL * law.h.size + CANDIDATES:
        for window in chunks(count, _CHORD_STRIDE):
            k = np.arange(window[0] * _CHORD_STRIDE, window[-1] * _CHORD_STRIDE + CHORD_PARTS + 1)
            yield np.asarray(window * _CHORD_STRIDE * part, dtype=np.float64), position(k * part), _CHORD_STRIDE
        return
    within = np.arange(_STARTS_PER_INTERVAL) / _STARTS_PER_INTERVAL
    every = (law.start[:, None] + law.h[:, None] * within).reshape(-1)
    for window in chunks(every.size, CHORD_PARTS + 1):
        starts = every[window]
        times = starts[:, None] + part * np.arange(CHORD_PARTS + 1)
        yield np.asarray(starts), position(times.reshape(-1)), CHORD_PARTS + 1


def _climb_chords(
    position: Callable[[FloatArray], FloatArray], start: FloatArray, share: FloatArray, period: float, end: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move start and place (share of the period) of each chord to the highest distance nearby; and that distance."""
    steps = np.linspace(-1.0, 1.0, _CLIMB_POINTS)
    half_start, half_share = period * _CHORD_STRIDE / CHORD_PARTS, 1.0 / CHORD_PARTS
    index = np.arange(start.size)
    for _ in range(_CLIMB_ROUNDS):
        starts = np.clip(start[:, None] + half_start * steps, 0.0, end)
        shares = np.clip(share[:, None] + half_share * steps, 0.0, 1.0)
        heights, best = _highest_of(position, starts, shares, period)
        start = starts[index, best // steps.size]
        share = shares[index, best % steps.size]
        half_start, half_share = half_start / 3.0, half_share / 3.0  # a spacing is a quarter of the half-width
    return start, share, heights


def _highest_of(
    position: Callable[[FloatArray], FloatArray], starts: FloatArray, shares: FloatArray, period: float
) -> tuple[FloatArray, IntArray]:
    """Largest distance from chords, each row's on its own, and where it is: chord times k plus place.

    The chords begin at starts (n, m); the places are at shares (n, k) of the period.
    """
    within = np.concatenate([np.tile([0.0, 1.0], (shares.shape[0], 1)), shares], axis=1)
    points = position(starts[:, :, None] + within[:, None, :] * period)
    height, top = np.empty(starts.shape[0]), np.empty(starts.shape[0], dtype=np.intp)
    work = np.empty(shares.shape[1] * (points.shape[-1] + 2))
    core.chord_tops(*starts.shape, shares.shape[1], points.shape[-1], points, height, top, work)
    return height, top


def sample_chord(
    curve: Curve, samples: Samples, u: FloatArray, density: int, *, allowed: float, rounding: float
) -> tuple[float, Place]:
    """Largest distance between the tip's path and the chords between consecutive samples.

    A path of length L between the ends of a chord c stays within sqrt(L^2 - c^2) / 2 of it.  Chords are looked at from the
    largest of these bounds on, as long as they may be among the highest and a thousandth of what is ``allowed``, mm: a slow
    program has millions that are neither.  ``rounding``: that of positions, mm.
    """
    tip = curve.tip
    begin, end = u[:-1], u[1:]
    grid = np.linspace(0.0, 1.0, density)

    def between(k: IntArray, x: FloatArray) -> FloatArray:
        lo, hi = np.minimum(begin, end)[k, None], np.maximum(begin, end)[k, None]
        return np.asarray(tip.derivatives(np.clip(begin[k, None] + (end - begin)[k, None] * x, lo, hi), 0)[0])

    def distance(k: IntArray, x: FloatArray) -> FloatArray:
        ends = tip.derivatives(np.stack([begin[k], end[k]]), 0)[0]
        return distance_to_chord(between(k, x), ends[0], ends[1])

    highest = Highest()
    bound = _within(curve, u, rounding)
    order = np.argsort(-bound, kind="stable")
    for some in chunks(begin.size, density):
        k = order[some]
        least = highest.height[0, -1] if highest.height.size == CANDIDATES else 0.0
        if some[0] > 0 and bound[k[0]] < max(least, _WORTH_A_LOOK * allowed):
            break
        height, at = _heights(between(k, grid).reshape(k.size * density, tip.dim), density, density - 1, k.size)
        highest.offer(height[None], k, grid[at][None])
    top = highest.index[0]
    half = np.full(top.size, 1.0 / (density - 1))
    x = zoom(lambda trial: distance(top, trial), highest.x[0], half, np.zeros(half.size), np.ones(half.size))
    heights = distance(top, x[:, None])[:, 0]
    best = int(heights.argmax())
    first, share = int(top[best]), float(x[best])
    place = float(samples.t[first]) + share * samples.period, float(begin[first] + (end[first] - begin[first]) * share)
    return float(heights[best]), place


def _within(curve: Curve, u: FloatArray, rounding: float) -> FloatArray:
    """How far the tip's path can leave each chord between consecutive parameters, by its length, (n - 1,)."""
    chord = norm(np.diff(curve.tip.derivatives(u, 0)[0], axis=0))
    length = np.abs(np.diff(curve.arclength.s(u))) + LENGTH_ACCURACY * curve.length + 2.0 * rounding
    return np.asarray(0.5 * np.sqrt(np.maximum(length - chord, 0.0)) * np.sqrt(length + chord))
