"""The integral of a certificate over one section, by Gauss sums that are halved until both halves agree with the whole.

At every point the integrand is exact,

    min over 0 < x <= cap of  w x^(-1/2) + g x,     w = 1 - sum |l|,     g = 1/2 sum (f q'' - f' q'),

attained at x = (w / 2g)^(2/3) where that is below the cap and g > 0, else at the cap.  Between the points it is not
enclosed: the difference between the sum over a part and the sums over its halves is what the integral may be off there.
The parts begin and end where an l changes its sign, so the integrand's kinks are those of the cap only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.gauss import gauss_legendre
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.types import FloatArray, IntArray
from planner.verify.certificate.multipliers import Multipliers
from planner.verify.certificate.pathspeeds import Bounds, Flags, PathPoints, path_points, stop_caps

_NODES, _WEIGHTS = gauss_legendre(8)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
_POWERS = np.arange(8)
# Row i: weights of the integral from the start of a part to its node i.
_UP_TO_NODE = (_NODES[:, None] ** (_POWERS + 1) / (_POWERS + 1)) @ np.linalg.inv(_NODES[:, None] ** _POWERS)
_WAY_MARGIN = 1e-6  # relative accuracy of the ways, which may only be too long
_PART_MARGIN = 1e-7  # and of the way up to a node within a part, as a share of that part's way
_TURN_MARGIN = 0.02  # the same, where an axis turns round within the part
_MIN_PARTS = 16.0  # of a stretch between two breaks of the curve
_MAX_CHANGE = 0.5  # of log |dq/du| over a part
_FOLLOWING, _MAX_PIECES, _MAX_PARTS = 8, 4096, 200_000  # rounds in which they are cut for it, of an interval, in all
_CLOSER = 10  # halvings of the interval next to a stop
_TARGET = 1e-10  # of the integral: the disagreement to be reached
_ROUNDS = 24
_AT_ONCE = 4000  # parts; bounds the memory
_MAX_OPEN = 8000  # parts; a certificate whose integrand is rough everywhere is paid with a large allowance

PartPoints = tuple[PathPoints, IntArray, FloatArray]  # of parts: the path there, and the interval and r of each, flat


@dataclass(frozen=True, eq=False)
class Stretches:
    """Parts of the intervals of a section, in order.

    Attributes
    ----------
    interval, lower, upper : (p,) arrays
        Part [lower, upper] of r in [0, 1] of each interval.
    way : (2, K, p) array
        Way of each motion from the start of the section to the start of the part, and from its end to the end.
    ramps : (2, K, p) bool array
        Whether a motion that rests at the start (end) has kept its direction, and its acceleration has made no step.
    """

    interval: IntArray
    lower: FloatArray
    upper: FloatArray
    way: FloatArray
    ramps: Flags

    def some(self, which: IntArray) -> Stretches:
        """Pick some of the parts."""
        return Stretches(
            self.interval[which], self.lower[which], self.upper[which], self.way[:, :, which], self.ramps[:, :, which]
        )


@dataclass(frozen=True, eq=False)
class SectionPath:
    """One section of a certificate on its curve: all that its integral needs."""

    curve: Curve
    limits: Limits
    parts: Multipliers
    speeds: FloatArray  # (2, K): of the motions at both ends; inf where it is not known

    def points(self, stretches: Stretches) -> PartPoints:
        """The path at the nodes of the parts, with the interval and r of each (flat)."""
        lower, upper = stretches.lower[:, None], stretches.upper[:, None]
        r = (lower + (upper - lower) * _NODES).reshape(-1)
        i = np.repeat(stretches.interval, _NODES.size)
        return path_points(self.curve, self.limits, self.parts, i, r), i, r

    def lengths(self, stretches: Stretches) -> FloatArray:
        """Length of each part in sigma."""
        return (stretches.upper - stretches.lower) * self.parts.h[stretches.interval]

    def caps(self, stretches: Stretches, points: PathPoints) -> FloatArray:
        """Largest sigma_dot^2 at the nodes (p 8,), by everything that limits it."""
        motions, count = points.first.shape[0], stretches.lower.size
        first = points.first.reshape(motions, count, _NODES.size)
        length = self.lengths(stretches)
        inside = np.abs(first) @ _UP_TO_NODE.T * length[:, None]
        way = np.abs(first) @ _WEIGHTS * length
        turns = (first.min(axis=-1) < 0.0) & (first.max(axis=-1) > 0.0)
        margin = np.where(turns, _TURN_MARGIN, _PART_MARGIN) * way
        cap = np.minimum(points.cap, points.chord_cap)
        bounds = Bounds.of(self.limits)
        for end, reached in enumerate((inside, way[:, :, None] - inside)):
            # To the nodes closest to an end the difference has lost its digits; it is no less than nothing.
            total = (stretches.way[end] + margin)[:, :, None] + np.maximum(reached, 0.0)
            total = (total * (1.0 + _WAY_MARGIN)).reshape(motions, -1)
            ramps = np.repeat(stretches.ramps[end], _NODES.size, axis=-1)
            cap = np.minimum(cap, stop_caps(bounds, points.first, total, self.speeds[end], ramps))
        return cap

    def sums(self, stretches: Stretches, at: PartPoints | None = None) -> tuple[FloatArray, FloatArray]:
        """Gauss sum of the integrand over each part, and the shortest time it takes."""
        points, i, r = self.points(stretches) if at is None else at
        cap = self.caps(stretches, points)
        w, g = self.terms(points, i, r)
        with np.errstate(divide="ignore"):
            least = np.where(np.isfinite(cap), cap, np.inf) ** -0.5
        weights = _WEIGHTS * self.lengths(stretches)[:, None]
        value = np.sum(weights * min_integrand(w, g, cap).reshape(weights.shape), axis=1)
        return value, np.sum(weights * least.reshape(weights.shape), axis=1)

    def terms(self, points: PathPoints, i: IntArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weight w = 1 - sum |l| and coefficient g of x at points of the path, (p,)."""
        load, force, slope = self.forces(i, r)
        return 1.0 - load, 0.5 * np.sum(force * points.second - slope * points.first, axis=0)

    def forces(self, i: IntArray, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Sum |l|, and f = m / A - l' / J of each motion (K, p) with its derivative."""
        bounds = Bounds.of(self.limits)
        load, l1, l2 = self.parts.jerk_at(i, r)
        m, m1 = self.parts.acceleration_at(i, r)
        per_a, per_j = 1.0 / bounds.acceleration[:, None], 1.0 / bounds.jerk[:, None]
        return np.abs(load).sum(axis=0), m * per_a - l1 * per_j, m1 * per_a - l2 * per_j

    def integral(self, stretches: Stretches) -> tuple[float, float]:
        """The integral, and by how much it may be too large."""
        found, doubt = 0.0, 0.0
        chunks = np.array_split(np.arange(stretches.lower.size), stretches.lower.size // _AT_ONCE + 1)
        values = [self.sums(stretches.some(some))[0] for some in chunks]
        share = _TARGET * sum(float(np.sum(np.abs(v))) for v in values) / stretches.lower.size
        for some, value in zip(chunks, values, strict=True):
            one, off = self._refined(stretches.some(some), value, share)
            found, doubt = found + one, doubt + off
        return found, doubt

    def _refined(self, stretches: Stretches, whole: FloatArray, share: float) -> tuple[float, float]:
        """Halve the parts until the halves agree with the whole to ``share`` each."""
        found, doubt = 0.0, 0.0
        for last in range(_ROUNDS, 0, -1):
            halves, at = self._halved(stretches)
            values, _ = self.sums(halves, at)
            pairs = values.reshape(-1, 2)
            with np.errstate(invalid="ignore"):
                apart = np.abs(pairs.sum(axis=1) - whole)
            open_ = (apart > share) & (last > 1) & np.isfinite(apart)
            open_ &= np.count_nonzero(open_) <= _MAX_OPEN
            found += float(np.sum(pairs[~open_]))
            doubt += float(np.sum(apart[~open_]))
            if not open_.any():
                break
            stretches, whole = halves.some(np.flatnonzero(np.repeat(open_, 2))), pairs[open_].reshape(-1)
        return (found, doubt) if np.isfinite(doubt) else (-np.inf, 0.0)

    def _halved(self, stretches: Stretches) -> tuple[Stretches, PartPoints]:
        """Cut every part in its middle, and evaluate the path at the nodes of the halves."""
        middle = 0.5 * (stretches.lower + stretches.upper)
        lower = np.stack([stretches.lower, middle], axis=1).reshape(-1)
        upper = np.stack([middle, stretches.upper], axis=1).reshape(-1)
        two = Stretches(
            np.repeat(stretches.interval, 2),
            lower,
            upper,
            np.repeat(stretches.way, 2, axis=-1),
            np.repeat(stretches.ramps, 2, axis=-1),
        )
        at = self.points(two)
        way = self.ways(two, at[0])
        two.way[0, :, 1::2] += way[:, 0::2]
        two.way[1, :, 0::2] += way[:, 1::2]
        return two, at

    def ways(self, stretches: Stretches, points: PathPoints) -> FloatArray:
        """Way of each motion over each part, (K, p)."""
        first = points.first.reshape(points.first.shape[0], -1, _NODES.size)
        return np.asarray(np.abs(first) @ _WEIGHTS * self.lengths(stretches))


def min_integrand(w: FloatArray, g: FloatArray, cap: FloatArray) -> FloatArray:
    """Smallest w x^(-1/2) + g x over 0 < x <= cap, for w >= 0; -inf where nothing caps x and g < 0."""
    w = np.maximum(w, 0.0)  # negative by rounding at most
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inside = (g > 0.0) & ((0.5 * w / g) ** 2 < cap**3)
        at_cap = w / np.sqrt(cap) + np.where(g == 0.0, 0.0, g * cap)
        return np.where(inside, 3.0 * np.cbrt((0.5 * w) ** 2 * np.maximum(g, 0.0)), at_cap)


def stretches_of(path: SectionPath, rests: tuple[bool, bool], breaks: FloatArray, jumps: FloatArray) -> Stretches:
    """Parts of a section: cut where multipliers change their sign, ever shorter at stops, no fewer than 16 a stretch.

    More where the motions' |dq/du| changes by orders of magnitude, as at a near-cusp: no sum over few points sees that.

    ``breaks`` are the parameters between which the curve is smooth, ``jumps`` those at which its curvature jumps.
    """
    parts = path.parts
    count = parts.h.size
    stretch = np.searchsorted(breaks, 0.5 * (parts.u[0] + parts.u[1]))
    pieces = np.ceil(_MIN_PARTS / np.bincount(stretch)[stretch]).astype(np.intp)
    near = np.full((2, _CLOSER, count), np.nan)
    shares = 0.5 ** np.arange(1, _CLOSER + 1)
    if rests[0]:
        near[0, :, 0] = shares
    if rests[1]:
        near[1, :, -1] = 1.0 - shares
    motions = parts.jerk.shape[0]
    for _ in range(_FOLLOWING):
        k = np.arange(1, pieces.max() + 1)[:, None]
        even = np.where(k < pieces, k / pieces, np.nan)
        interval, lower, upper = parts.parts(np.concatenate([even, near[0], near[1]]))
        nothing = np.zeros((2, motions, lower.size))
        bare = Stretches(interval, lower, upper, nothing, nothing > 0.0)
        points, i, r = path.points(bare)
        more = np.ones(count)
        np.maximum.at(more, interval, np.ceil(_change(points.first / parts.coordinate(i, r)[1]) / _MAX_CHANGE))
        if (more == 1.0).all() or lower.size > _MAX_PARTS:
            break
        pieces = np.minimum(pieces * np.minimum(more, _MAX_PIECES), _MAX_PIECES).astype(np.intp)
    first = points.first.reshape(motions, -1, _NODES.size)
    way = path.ways(bare, points)
    total = np.cumsum(way, axis=1)
    back = np.cumsum(way[:, ::-1], axis=1)[:, ::-1]
    u = parts.u[0, interval]
    steady = [
        _same_direction(first) & ((u < jumps.min(initial=np.inf)) & rests[0]),
        _same_direction(first[:, ::-1])[:, ::-1] & ((u >= jumps.max(initial=-np.inf)) & rests[1]),
    ]
    zero = np.zeros((motions, 1))
    ways = np.stack([np.hstack([zero, total[:, :-1]]), np.hstack([back[:, 1:], zero])])
    return Stretches(interval, lower, upper, ways, np.stack(steady))


def _change(slopes: FloatArray) -> FloatArray:
    """How much log |dq/du| changes within each part, by the slopes (K, p 8) at its nodes, each motion in its largest."""
    largest = np.abs(slopes).max(axis=1, keepdims=True)
    size = np.sum(np.divide(slopes, largest, out=np.zeros_like(slopes), where=largest > 0.0) ** 2, axis=0)
    size = np.maximum(size, np.finfo(np.float64).tiny).reshape(-1, _NODES.size)
    return np.asarray(0.5 * np.log(size.max(axis=1) / size.min(axis=1)))


def _same_direction(first: FloatArray) -> Flags:
    """Up to which part (K, p) each motion has kept its direction."""
    forwards = np.logical_and.accumulate(first.min(axis=-1) >= 0.0, axis=1)
    backwards = np.logical_and.accumulate(first.max(axis=-1) <= 0.0, axis=1)
    return np.asarray(forwards | backwards)
