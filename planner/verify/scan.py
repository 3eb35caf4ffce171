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
from planner.verify.meanjerk import gaps_around, mean_jerks
from planner.verify.motion import Look, Motion
from planner.verify.peaks import Highest, chunk_size, chunks, zoom, zoom_trials
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
    means : list of (value, slack, place)
        The largest mean jerk of each axis over an interval.
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
    means: list[tuple[float, float, Place]]
    density: int


def scan_spans(motion: Motion, density: int) -> Scan:
    """Measure every span at ``density`` points, both ends included, and keep the highest."""
    dim, spans, tip = motion.curve.dim, motion.interval.size, motion.curve.tip.dim
    count = len(names(dim))
    tops = Highest(count)
    largest, work, jerk = np.zeros(count), np.empty((count, density)), np.empty((dim, spans))
    ends, course = np.empty((2, count, spans)), np.empty((spans, _COURSE_SIZES + 6 * tip))
    feed, feed_place = np.empty((2, spans))
    mean, mean_slack = np.zeros((2, dim, spans))
    coordinates = dim if motion.curve.tip is motion.curve else dim + tip
    room = min(spans, chunk_size(density * max(1, coordinates // 4)))  # fewer points, where each has more numbers
    sweep = motion.sweep(density, room)
    of_spans = motion.law.table, spans, motion.interval, motion.lower, motion.upper, motion.u_ends, gaps_around(motion)
    of_points = room, density, sweep.window, sweep.x, sweep.rates, sweep.slack, dim, tip
    found = ends, *tops.rows, largest, jerk, feed, feed_place, course, mean, mean_slack, work
    measure = core.scan_measure.bind(*of_spans, *of_points, *found)
    for d, p in sweep:
        measure(d, p)
    steps = np.zeros((2, spans + 1, dim))
    for k in range(2):
        first, last = ends[:, axis_rows(dim, k)]
        steps[k, :-1] += first.T
        steps[k, 1:] -= last.T
    (_, after), (_, before) = (np.pad(ends[k, :2], ((0, 0), (k, 1 - k))) for k in range(2))
    slowest = np.minimum(np.append(ends[0, 0], 0.0), np.append(0.0, ends[1, 0]))
    rests = slowest <= VELOCITY_STEP * largest[0]
    along = np.where(rests, np.abs(after) - np.abs(before), after - before)
    means = mean_jerks(motion, mean, mean_slack)
    return Scan(tops.index, tops.x, largest, jerk, steps, along, feed, feed_place, course, means, density)


def worst_of(motion: Motion, scan: Scan, density: int) -> Iterator[tuple[str, int, float, float, Place]]:
    """Yield quantity, axis, worst value, its slack and its place, after the search around the highest points."""
    rows, dim = names(motion.curve.dim), motion.curve.dim
    span, candidates = scan.top_span.reshape(-1), scan.top_span.shape[1]
    quantity = np.repeat(np.arange(len(rows)), candidates)
    every, trials = np.arange(span.size), zoom_trials(span.size)
    look, used = Look(motion, span, trials), np.empty(trials.shape)
    measure = core.scan_used.bind(*trials.shape, dim, motion.curve.tip.dim, look.rates, look.slack, quantity, used)

    def height(_: FloatArray) -> FloatArray:
        measure(*look())
        return used

    lower, upper = motion.lower[span], motion.upper[span]
    x = zoom(height, scan.top_x.reshape(-1), (upper - lower) / (density - 1), lower, upper, trials)[:, None]
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
    allowed = np.where(np.isinf(programmed.feed), limits.rapid, limits.feed)
    if programmed.angular is not None:
        allowed[programmed.angular] = np.inf  # its feeds are of lengths
    return FeedCaps(programmed.edges, allowed)


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
