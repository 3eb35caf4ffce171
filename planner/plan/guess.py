"""A guess of the feed, from what the limits allow at every point alone.

1. Sample the section, closely where it matters: at its ends, around curvature jumps, in short stretches between breaks.
2. The ceiling at each sample: the feed that every velocity, chord error and curvature allows there, with no
   acceleration along the path.
3. A forward and a backward scan take from it what acceleration and jerk cannot reach.

The guess gives the time spent along the path, the place of every knot follows from it (``knots``), and how close nodes
may stand before rounding makes their jerk.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from planner.compiled import core
from planner.errors import CurveError, InfeasibleError
from planner.geometry.differential import arc_derivatives, dot, norm
from planner.machine.feed_limits import commanded_feed
from planner.machine.limits import Limits
from planner.plan.ends import Feed, feed_at
from planner.plan.jumps import passable
from planner.plan.section import Section, axis_weights, evaluate
from planner.plan.slow import resolved
from planner.sets import union
from planner.types import FloatArray

# Samples: so many an interval, fewer where there are many
_SCAN_PER_INTERVAL, _MANY = 2, 20_000
_MIN_SCAN = 600
# A stretch between breaks has at least so many: a cubic corner has no curvature at either end, only inside.
_SCAN_PER_STRETCH, _GRADED = 16, 20
# How much of acceleration and jerk the scans let the feed use along the path; the rest is left to the curvature.
GROWTH_ACCELERATION = 0.7
GROWTH_JERK = 0.35 * 2.12
_DIP_LEVELS = 10
_NARROWEST_DIP = 1e-9  # of the section
# Share of the jerk limit that rounding may make of nodes close to one another.
_ROUNDING_SHARE = 1e-3
# The same where only nodes as close as that follow the path, with room for the rest of the jerk.
SHORTEST_SHARE = 10.0
_MIN_RESOLVABLE = 200
# Of the length of a section that a digit of u may be worth, and the fewest intervals that it must resolve.
_MAX_DIGIT, _MIN_RESOLVED = 1e-5, 24


@dataclass(frozen=True, eq=False)
class FeedGuess:
    """A guess of the plan on a sample of a section.

    ``y`` and ``length`` (weighted arc length) at the samples; ``feed`` the guess and ``ceiling`` the pointwise bound in
    weighted units per s; ``turning`` the accumulated turning angle, rad; ``acceleration`` and ``jerk`` the tangential
    ones that the axes allow at the samples; ``speed`` the weighted |dq/du|; ``u`` the curve
    parameter.  ``dips`` are places at which the feed is held low.
    """

    y: FloatArray
    length: FloatArray
    feed: FloatArray
    ceiling: FloatArray
    turning: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    speed: FloatArray
    u: FloatArray
    dips: Dips

    @cached_property
    def time(self) -> FloatArray:
        """Accumulated time at the samples, s."""
        mean = 0.5 * (self.feed[1:] + self.feed[:-1])
        return np.concatenate([[0.0], np.cumsum(np.diff(self.length) / mean)])

    @property
    def duration(self) -> float:
        """Of the guess, s."""
        return float(self.time[-1])

    @cached_property
    def resolved(self) -> float:
        """Number of intervals that rounding leaves, inf where it has no part, nan where the limits leave no feed."""
        least = least_times(self, _ROUNDING_SHARE)
        per_node = 0.5 * (least[1:] + least[:-1])
        some = per_node > 0.0
        if not some.any():
            return np.inf
        count = float(np.sum(np.diff(self.time)[some] / (2.0 * per_node[some])))
        return count if np.isfinite(count) else np.nan


@dataclass(frozen=True, eq=False)
class Dips:
    """Where the feed is held low: at curvature jumps, and at ends with a feed.

    The ``y`` of each, the ``feed`` there, and the ``width`` of y over which it doubles or so.
    """

    y: FloatArray
    feed: FloatArray
    width: FloatArray


def guess_feed(section: Section, limits: Limits, intervals: int, *, follow: bool = False) -> FeedGuess:
    """Sample a section and guess its feed; ``follow``: with samples that crowd where |C'| changes fast."""
    curve = section.curve
    weights = axis_weights(limits)
    count = max(_MIN_SCAN, min(_SCAN_PER_INTERVAL * intervals, intervals + _MANY))
    y = np.linspace(section.y_start, section.y_end, count + 1)
    # The ends need closer samples, or a start that is short against the path is stepped over.
    near = (section.y_end - section.y_start) * _nearer(count)
    dips = _dips(section, limits, weights)
    close = _close_to(dips, (section.y_end - section.y_start) / count)
    close = close[(close > section.y_start) & (close < section.y_end)]
    breaks = section.coordinate(breaks_inside(section))
    inside = _inside_short(np.concatenate([[section.y_start], breaks, [section.y_end]]), y[1] - y[0])
    y = union(y, section.y_start + near, section.y_end - near, breaks, inside, close)
    u = section.parameter(y)
    if follow:
        more = resolved(curve, weights, union(u))
        y = union(y, np.clip(section.coordinate(more), y[0], y[-1]))
        u = section.parameter(y)
    q = evaluate(curve, u, u >= section.u_end)
    tip = q if curve.tip is curve else evaluate(curve.tip, u, u >= section.u_end)
    speed = norm(q[1] * weights)
    # Not differences of its sum: next to a place where |C'| nearly vanishes these are nothing but rounding.
    way = 0.5 * (speed[1:] + speed[:-1]) * np.diff(u)
    length = np.concatenate([[0.0], np.cumsum(way)])
    accelerations, jerks = weights * limits.acceleration, weights * limits.jerk
    # a sample on a step of the cap takes the lower side
    commanded = np.minimum(commanded_feed(curve, limits, u), commanded_feed(curve, limits, u, True))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = norm(tip[1]) / speed
        rows = np.empty((5, u.size))
        core.guess_ceiling(
            *(u.size, curve.dim, tip.shape[2], q, tip, weights, speed, speed**3, ratio),
            *(weights * limits.velocity, accelerations, jerks, commanded, limits.chord_error, limits.period),
            *(limits.tangential_acceleration, limits.tangential_jerk, rows),
        )
        ceiling, by_jerk, _, _, kappa = rows
        acceleration, jerk = rows[2].copy(), rows[3].copy()  # kept, the others are not
        ceiling = np.fmin(ceiling, np.cbrt(by_jerk))
    at = np.searchsorted(y, dips.y)
    ceiling[at] = np.minimum(ceiling[at], dips.feed)
    per_tip_feed = np.divide(1.0, ratio, out=np.full_like(ratio, np.inf), where=ratio > 0.0)
    feed = _reachable(section, ceiling, way, acceleration, jerk, per_tip_feed)
    _require_feed(section, u, feed, speed)
    found = FeedGuess(y, length, feed, ceiling, _accumulate(kappa, length), acceleration, jerk, speed, u, dips)
    _require_digits(section, found)
    return found


@cache
def _nearer(count: int) -> FloatArray:
    """Distances from an end, as shares of the whole, of samples that are closer than those of so many intervals."""
    return np.geomspace(1e-9, 0.5 / count, 48)


def _require_feed(section: Section, u: FloatArray, feed: FloatArray, speed: FloatArray) -> None:
    """Refuse a path on which some place between the ends can only be passed at no feed at all."""
    held = np.flatnonzero(~(feed[1:] + feed[:-1] > 0.0))
    if held.size:
        raise CurveError(
            f"{section.curve.name}: no feed is left at u = {u[held[0]]:.9g}, where |C'| = {speed[held[0]]:.3g}: its "
            "curvature there is beyond double precision; split the curve there, or move the control points around it"
        )


def _require_digits(section: Section, guess: FeedGuess) -> None:
    """Refuse a path of which u, in double precision, does not tell the points, or not the jerk between a few."""
    digit = np.spacing(np.abs(guess.u)) * guess.speed
    at = int(digit.argmax())
    share = digit[at] / guess.length[-1]
    if share > _MAX_DIGIT or guess.resolved < _MIN_RESOLVED:
        raise CurveError(
            f"{section.curve.name}: a digit of u is worth {share:.2g} of the path between u = {section.u_start!r} and "
            f"{section.u_end!r}, too much for a plan at these limits; let the parameter begin near 0, or spread it more "
            "evenly"
        )


def _dips(section: Section, limits: Limits, weights: FloatArray) -> Dips:
    """Feeds (weighted) at which the curvature jumps of a section may be passed, one by one, and those at its ends."""
    curve = section.curve
    ends = ((section.u_start, section.start), (section.u_end, section.end))
    feeds = [(u, end.feed) for u, end in ends if isinstance(end, Feed)]
    u = np.array([*(b.u for b in section.jumps), *(u for u, _ in feeds)])
    if u.size == 0:
        return Dips(u, u, u)
    sides = [curve.derivatives(u, 3, side=side) for side in ("left", "right")]
    for d in sides:
        d[1:] *= weights
    before, after = (arc_derivatives(d) for d in sides)
    jerks = weights * limits.jerk
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        feed = np.sqrt(passable(after[2] - before[2], jerks, limits.period))
        for i, (at, prescribed) in enumerate(feeds, start=len(section.jumps)):
            tip = np.sqrt(np.sum(curve.tip.derivatives(at, 1)[1] ** 2))
            feed[i] = prescribed / tip * np.sqrt(np.sum(sides[0][1, i] ** 2))
        width = feed**1.5 / (GROWTH_JERK * np.sqrt(np.fmin.reduce(jerks / np.abs(after[1]), axis=1)))
    if section.arc is None:
        width /= np.sqrt(dot(sides[0][1], sides[0][1]))
    least = _NARROWEST_DIP * (section.y_end - section.y_start)
    return Dips(section.coordinate(u), feed, np.where(np.isfinite(width), np.maximum(width, least), np.inf))


def _inside_short(edges: FloatArray, spacing: float) -> FloatArray:
    """Samples inside the stretches between ``edges`` that are too short for the given spacing to see what they hold.

    Beside them there are samples ever further apart, up to that spacing: the feed falls to what such a stretch allows within
    a way of its own size, and from one far sample to the stretch its time would be guessed much too long.
    """
    width = np.diff(edges)
    short = np.flatnonzero((width > 0.0) & (width < _SCAN_PER_STRETCH * spacing))
    if short.size == 0:
        return np.empty(0)
    share = np.arange(1, _SCAN_PER_STRETCH) / _SCAN_PER_STRETCH
    inside = edges[short, None] + width[short, None] * share
    reach = width[short, None] * 2.0 ** np.arange(_GRADED)
    reach = np.where(reach < spacing, reach, 0.0)
    beside = np.concatenate([edges[short, None] - reach, edges[short + 1, None] + reach])
    return np.clip(np.concatenate([inside.reshape(-1), beside.reshape(-1)]), edges[0], edges[-1])


def _close_to(dips: Dips, spacing: float) -> FloatArray:
    """Samples around the dips that the given spacing would step over, ever closer."""
    narrow = dips.width < spacing
    if not narrow.any():
        return np.empty(0)
    levels = int(np.ceil(np.log(spacing / dips.width.min()) / np.log(4.0))) + 1
    distance = spacing * 0.25 ** np.arange(1, min(levels, _DIP_LEVELS) + 1)
    around = dips.y[narrow][:, None] + np.concatenate([-distance, distance])
    return np.asarray(around.reshape(-1))


def _accumulate(rate: FloatArray, over: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(over))])


def _steps(rate: FloatArray, way: FloatArray, ceiling: FloatArray) -> FloatArray:
    """Growth over the way (n - 1,) from sample to sample, at most the largest finite ceiling.

    Where the only axes with a limit stand still the rate has no bound, and its sum would swamp all others.
    """
    steps = 0.5 * (rate[1:] + rate[:-1]) * way
    largest = float(ceiling[np.isfinite(ceiling)].max(initial=0.0))
    return np.minimum(steps, largest) if largest > 0.0 else steps


def _grown(values: FloatArray, steps: FloatArray) -> FloatArray:
    """Largest values below the given ones (n,) that exceed no neighbour by more than the step between, ``steps (n - 1,)``.

    By sums over all steps; where these swamp neighbours that are not 0, the steps are taken one by one.
    """
    growth = np.concatenate([[0.0], np.cumsum(steps)])
    forward = np.minimum.accumulate(values - growth) + growth
    back = growth[-1] - growth[::-1]
    out = np.asarray((np.minimum.accumulate(forward[::-1] - back) + back)[::-1])
    if not (out[1:] + out[:-1] > 0.0).all():
        out = values.copy()
        core.guess_limit_growth(out.size, out, steps)
    return np.maximum(out, 0.0)


def _reachable(
    section: Section,
    ceiling: FloatArray,
    way: FloatArray,
    acceleration: FloatArray,
    jerk: FloatArray,
    per_tip_feed: FloatArray,
) -> FloatArray:
    """Largest feed below the ceiling that grows and falls no faster than acceleration and jerk allow.

    Under an acceleration A alone v^2 grows by 2A a unit of length; under a jerk J alone v^1.5 by 2.12 sqrt(J).
    """
    feed = ceiling.copy()
    for index, end in ((0, section.start), (-1, section.end)):
        at_end = end.feed * per_tip_feed[index] if isinstance(end, Feed) else feed_at(end)
        feed[index] = min(feed[index], at_end) if np.isfinite(at_end) else feed[index]
    # Powers are taken of shares of the largest feed: the same numbers in any units.
    top = float(feed[np.isfinite(feed)].max(initial=0.0)) or 1.0
    share = feed / top
    growths = ((2.0, 2.0 * GROWTH_ACCELERATION * acceleration / top**2), (1.5, GROWTH_JERK * np.sqrt(jerk / top**3)))
    for power, rate in growths:
        finite = np.isfinite(rate)
        if not finite.any():
            continue
        bounded = np.where(finite, rate, rate[finite].max())
        raised = share**power
        share = _grown(raised, _steps(bounded, way, raised)) ** (1.0 / power)
    feed = share * top
    if not np.isfinite(feed).all():
        raise InfeasibleError(
            f"{section.curve.name}: nothing limits the feed between u = {section.u_start:.9g} and {section.u_end:.9g}; "
            "a feed, an axis velocity, acceleration or jerk must be finite"
        )
    return feed


def least_times(guess: FeedGuess, share: float = SHORTEST_SHARE) -> FloatArray:
    """Time that nodes must be apart at each sample, so that rounding makes no more than this share of the jerk limit, s.

    A digit e = eps (|u| |dq/du| + v t) in the place of a node and in its time, h between nodes, is 60 e / h^3 of jerk.
    """
    digit = np.finfo(float).eps * (np.abs(guess.u) * guess.speed + guess.feed * guess.time)
    with np.errstate(divide="ignore"):
        return np.asarray(np.cbrt(60.0 * digit / (share * guess.jerk)))


def resolvable(guess: FeedGuess) -> int:
    """Largest number of intervals of which the nodes still tell a jerk: closer ones differ by rounding.

    See :func:`least_times`.
    """
    count = guess.resolved
    if np.isnan(count):
        raise InfeasibleError(
            "the limits leave no feed that can be told from 0 on some of the path; a period, a chord error, a velocity, an "
            "acceleration or a jerk is too small or too large for it by many orders of magnitude"
        )
    return int(np.clip(count, _MIN_RESOLVABLE, 1e9))


def breaks_inside(section: Section) -> FloatArray:
    """Parameters at which the path is not smooth; even a fourth derivative that jumps puts a kink into the jerk.

    Of breaks closer to one another than rounding resolves the first stands for all; so does an end for those beside it.
    """
    u = section.curve._candidate_breaks()
    u = u[(u > section.u_start) & (u < section.u_end)]
    if u.size == 0:
        return u
    least, y = section.resolution, section.coordinate(u)
    kept = (np.diff(y, prepend=section.y_start) > least) & (section.y_end - y > least)
    return np.asarray(u[kept])
