"""Chord errors: the true distance between the path and the chords of one period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.compiled import core
from planner.geometry.chord import distance_to_chord
from planner.geometry.curve import Curve
from planner.geometry.differential import norm
from planner.samples import Samples
from planner.types import FloatArray, IntArray
from planner.verify.chordbounds import chord_bounds
from planner.verify.findings import Place
from planner.verify.motion import Motion, Quintics
from planner.verify.peaks import CANDIDATES, Highest, chunk_size, chunks, zoom
from planner.verify.scan import Scan
from planner.verify.sizes import LENGTH_ACCURACY

# A period is looked at in sixteenths; chords start every fourth of them.
CHORD_PARTS = 16
_CHORD_STRIDE = 4
_STARTS_PER_INTERVAL = 24
_GROUP = 16  # chords that share points
_FIRST_GROUPS = 8  # looked at first; twice as many each time, for after the first few mostly none are left
# The highest chords are climbed in rounds over this many starts, and as many places on the chord.
_CLIMB_ROUNDS, _CLIMB_POINTS = 12, 9
_WORTH_A_LOOK = 1e-3  # of the chord error allowed


@dataclass(frozen=True, eq=False)
class _Chords:
    """Chords of one period over a plan, in groups that share points, each chord with those that divide its period.

    The starts are a fraction of the period apart; where a plan has far more periods than nodes they follow the nodes, as
    nothing changes faster than between two of those.

    Attributes
    ----------
    count : int
        Groups.
    each, stride : int
        Chords of a group, and points from the start of one to that of the next.
    """

    law: Quintics
    part: float
    count: int
    each: int
    stride: int

    @classmethod
    def of(cls, law: Quintics, period: float, end: float) -> _Chords:
        """Divide a plan."""
        part = period / CHORD_PARTS
        starts = int(np.ceil(end / (part * _CHORD_STRIDE)))
        if starts <= _STARTS_PER_INTERVAL * law.h.size + CANDIDATES:
            return cls(law, part, -(-starts // _GROUP), _GROUP, _CHORD_STRIDE)
        return cls(law, part, law.h.size, _STARTS_PER_INTERVAL, CHORD_PARTS + 1)

    def starts(self, index: IntArray) -> FloatArray:
        """Where chords begin, s."""
        if self.stride == _CHORD_STRIDE:
            return np.asarray(index * _CHORD_STRIDE * self.part, dtype=np.float64)
        interval, k = np.divmod(index, self.each)
        return np.asarray(self.law.start[interval] + self.law.h[interval] * (k / self.each))

    def windows(self) -> tuple[FloatArray, FloatArray]:
        """Begin and end of each group."""
        first = np.arange(self.count) * self.each
        return self.starts(first), self.starts(first + self.each - 1) + CHORD_PARTS * self.part

    def times(self, groups: IntArray) -> FloatArray:
        """Times of the points of groups (m,), (m, points)."""
        if self.stride == _CHORD_STRIDE:
            points = (self.each - 1) * _CHORD_STRIDE + CHORD_PARTS + 1
            return np.asarray((groups[:, None] * (self.each * _CHORD_STRIDE) + np.arange(points)) * self.part)
        starts = self.starts(groups[:, None] * self.each + np.arange(self.each))
        return np.asarray(starts[..., None] + self.part * np.arange(CHORD_PARTS + 1)).reshape(groups.size, -1)


def profile_chord(motion: Motion, scan: Scan, period: float, rounding: float) -> tuple[float, Place]:
    """Largest distance between the tip's path and its chord of one period, over every start of the period.

    The last point is held, so the last chords are shorter.  Chords are looked at in groups, from that on which may be left
    furthest, until no other may be among the highest.  ``rounding``: that of positions, mm.
    """
    law, (u0, u1) = motion.law, motion.curve.domain
    end = float(law.start[-1] + law.h[-1])
    period = min(period, end)
    chords = _Chords.of(law, period, end)
    bound = chord_bounds(motion, scan, period, *chords.windows()) + 4.0 * rounding  # of a point and three of its chord
    order = np.argsort(-bound, kind="stable")
    highest, done, size = Highest(), 0, _FIRST_GROUPS
    while done < chords.count and not bound[order[done]] < highest.least:
        groups = np.sort(order[done : done + size])
        u = law.parameters(chords.times(groups).reshape(-1), u0, u1)
        points = motion.curve.tip.derivatives(u, 0)[0]
        height, at = _heights(points, (groups.size, chords.each), chords.stride, CHORD_PARTS)
        index = groups[:, None] * chords.each + np.arange(chords.each)
        highest.offer(height.reshape(1, -1), index.reshape(-1), at.reshape(1, -1) / CHORD_PARTS)
        done, size = done + size, min(2 * size, chunk_size(u.size // groups.size))
    start, share, heights = _climb_chords(motion, chords.starts(highest.index[0]), highest.x[0], period)
    best = int(heights.argmax())
    t = min(float(start[best] + share[best] * period), end)
    return float(heights[best]), (t, float(law.parameters(np.array([t]), u0, u1)[0]))


def _heights(points: FloatArray, shape: tuple[int, int], stride: int, parts: int) -> tuple[FloatArray, IntArray]:
    """Largest distance of chords from the path above each, and its point, both of the shape (groups, chords of a group).

    The points of a group follow those of the one before.  In a group a chord begins ``stride`` points after the one before,
    and ends ``parts`` after that.
    """
    height, top, dim = np.empty(shape), np.empty(shape, dtype=np.intp), points.shape[1]
    work = np.empty((points.shape[0] // shape[0] + stride) * dim + shape[1] * (parts + 3))
    core.chord_heights(*shape, dim, stride, parts, np.ascontiguousarray(points), height, top, work)
    return height, top


def _climb_chords(
    motion: Motion, start: FloatArray, share: FloatArray, period: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move start and place (share of the period) of each chord to the highest distance nearby; and that distance."""
    law, tip = motion.law, motion.curve.tip
    steps, end = np.linspace(-1.0, 1.0, _CLIMB_POINTS), float(law.start[-1] + law.h[-1])
    halves = np.array([period * _CHORD_STRIDE, 1.0]) / CHORD_PARTS
    start, share, heights = start.copy(), share.copy(), np.empty(start.size)
    u = np.empty((start.size, steps.size, steps.size + 2))
    left, work, size = np.zeros(u.size, dtype=np.bool_), np.empty(steps.size * (tip.dim + 2)), u.shape[:2]
    on_law = law.h.size, law.table, law.start, *motion.curve.domain, period
    spread = core.chord_trials.bind(*on_law, *size, steps, halves, start, share, u)
    choose = core.chord_choose.bind(*size, tip.dim, steps, end, halves, start, share, heights, work)
    for _ in range(_CLIMB_ROUNDS):
        spread()
        choose(tip._evaluate(u.reshape(-1), 0, left))
    return start, share, heights


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
        if some[0] > 0 and bound[k[0]] < max(highest.least, _WORTH_A_LOOK * allowed):
            break
        height, at = _heights(between(k, grid).reshape(k.size * density, tip.dim), (1, k.size), density, density - 1)
        highest.offer(height, k, grid[at])
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
