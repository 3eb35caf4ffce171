"""The dense pass over a plan, and the search around its highest points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.compiled import core
from planner.geometry.curve import FeedCaps
from planner.machine.limits import Limits
from planner.types import FloatArray, IntArray
from planner.verify.findings import Place
from planner.verify.motion import Motion
from planner.verify.peaks import Highest, chunks, zoom
from planner.verify.quantities import axis_rows, names, sizes_of
from planner.verify.sizes import VELOCITY_STEP

_COURSE_SIZES = 5  # of a span, before its two ends


@dataclass(frozen=True, eq=False)
class Scan:
    """What the dense pass over a profile keeps.

    top_span, top_x : (quantities, candidates)
        The highest spans of each quantity and where their highest points are.
    largest : (quantities,)
        Largest size of each quantity at the points, less its slack.
    jerk : (dim, spans)
        Largest |axis jerk| on each span, less its slack: the digits of u, which the mean jerk of an interval does not have.
    steps : (2, spans + 1, dim)
        Steps of axis velocity and acceleration where spans meet; first and last entry: against a standstill.
    along : (spans + 1,)
        Steps of the tangential acceleration there; where the tip comes to rest, which may turn it back, those of its size.
    feed, feed_place : (spans,)
        Highest feed at the points of each span, and x there.
    course : (spans, 5 + 6 tip)
        Of the tip the largest acceleration across and along its path, the fastest turning of its direction, and the largest
        jerk along and across, at the points of each span; place, velocity and direction at both ends.
    density : int
        Points a span.
    """

    top_span: IntArray
    top_x: FloatArray
    largest: FloatArray
    jerk: FloatArray
    steps: FloatArray
    along: FloatArray
    feed: FloatArray
    feed_place: FloatArray
    course: FloatArray
    density: int


def scan_spans(motion: Motion, density: int) -> Scan:
    """Measure every span at ``density`` points, both ends included, and keep the highest."""
    dim, spans, tip = motion.curve.dim, motion.interval.size, motion.curve.tip.dim
    count = len(names(dim))
    tops = Highest(count)
    largest, work = np.zeros(count), np.empty((count, density))
    jerk = np.empty((dim, spans))
    steps = np.zeros((2, spans + 1, dim))
    before, after = np.zeros((2, spans + 1)), np.zeros((2, spans + 1))
    feed, feed_place = np.empty((2, spans))
    course = np.empty((spans, _COURSE_SIZES + 6 * tip))
    coordinates = dim if motion.curve.tip is motion.curve else dim + tip
    for span in chunks(spans, density * max(1, coordinates // 4)):  # fewer points, where each has more numbers
        some = slice(span[0], span[-1] + 1)
        x = motion.grid(span, density)
        ends, kept = np.empty((2, count, span.size)), np.empty((2, count, span.size))
        d, p, cartesian, rates, slack = motion.states(span, x)
        of_chunk = np.empty((dim, span.size))
        feeds = feed[some], feed_place[some]
        core.scan_measure(
            *x.shape,
            dim,
            tip,
            d,
            None if cartesian else p,
            rates,
            slack,
            x,
            ends,
            *kept,
            largest,
            of_chunk,
            *feeds,
            course[some],
            work,
        )
        jerk[:, some] = of_chunk
        for k in range(2):
            first, last = ends[:, axis_rows(dim, k)]
            steps[k, some] += first.T
            steps[k, some.start + 1 : some.stop + 1] -= last.T
        after[:, some], before[:, some.start + 1 : some.stop + 1] = ends[0, :2], ends[1, :2]
        tops.offer(kept[0], span, kept[1])
    rests = np.minimum(before[0], after[0]) <= VELOCITY_STEP * largest[0]
    along = np.where(rests, np.abs(after[1]) - np.abs(before[1]), after[1] - before[1])
    return Scan(tops.index, tops.x, largest, jerk, steps, along, feed, feed_place, course, density)


def worst_of(motion: Motion, scan: Scan, density: int) -> Iterator[tuple[str, int, float, float, Place]]:
    """Yield quantity, axis, worst value, its slack and its place, after the search around the highest points."""
    rows = names(motion.curve.dim)
    span, candidates = scan.top_span.reshape(-1), scan.top_span.shape[1]
    quantity = np.repeat(np.arange(len(rows)), candidates)
    every = np.arange(span.size)

    def height(x: FloatArray) -> FloatArray:
        d, p, cartesian, rates, slack = motion.states(span, x)
        used = np.empty(x.shape)
        of_tip = p.shape[2], d, None if cartesian else p
        core.scan_used(*x.shape, motion.curve.dim, *of_tip, rates, slack, quantity, used)
        return used

    lower, upper = motion.lower[span], motion.upper[span]
    x = zoom(height, scan.top_x.reshape(-1), (upper - lower) / (density - 1), lower, upper)[:, None]
    values, slack = motion.measure(span, x)
    worst, slack = sizes_of(values)[quantity, every, 0], slack[quantity, every, 0]
    u, t = motion.parameter(span, x)[:, 0], motion.time(span, x[:, 0])
    best = _used(worst, slack).reshape(-1, candidates).argmax(axis=1) + candidates * np.arange(len(rows))
    for (name, j), k in zip(rows, best, strict=True):
        yield name, j, max(float(worst[k]), 0.0), float(slack[k]), (float(t[k]), float(u[k]))


def _used(sizes: FloatArray, slack: FloatArray) -> FloatArray:
    """Size less slack; where both overflow it is no number, which argmax takes for the highest, as it should be."""
    with np.errstate(invalid="ignore"):
        return np.asarray(sizes - slack)


def machine_caps(programmed: FeedCaps, limits: Limits) -> FeedCaps:
    """What the machine allows on the stretches of a program: its rapid where the program commands no feed."""
    return FeedCaps(programmed.edges, np.where(np.isinf(programmed.feed), limits.rapid, limits.feed))


def feed_under(motion: Motion, scan: Scan, caps: FeedCaps, density: int) -> tuple[float, float, Place]:
    """Feed that uses most of what caps allow: value, cap and place.

    The scan kept the highest feed of each span; only where the cap changes within a span are its points looked at again.
    """
    found = (0.0, np.inf, (0.0, 0.0))
    low, high = np.sort(motion.u_ends, axis=0)
    cap = caps.at(low)
    one_cap = caps.at(high, True) == cap
    share = np.where(one_cap, scan.feed / cap, -np.inf)
    k = int(share.argmax())
    if share[k] > 0.0:
        found = (float(scan.feed[k]), float(cap[k]), motion.place(k, float(scan.feed_place[k])))
    mixed = np.flatnonzero(~one_cap)
    for span in chunks(mixed.size, density):
        some = mixed[span]
        x = motion.grid(some, density)
        feeds, u = motion.feed(some, x), motion.parameter(some, x)
        # On a step of the cap a span has that of its own side.
        allowed = caps.at(u, u >= motion.u_ends[1, some, None])
        i, j = np.unravel_index(int((feeds / allowed).argmax()), feeds.shape)
        if feeds[i, j] / allowed[i, j] > found[0] / found[1]:
            found = (float(feeds[i, j]), float(allowed[i, j]), motion.place(int(some[i]), float(x[i, j])))
    return found
