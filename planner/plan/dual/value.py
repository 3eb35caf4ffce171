"""The lower bound that given multipliers prove.  This alone is the proof: the multipliers may come from anywhere.

With l_j for each jerk limit, m_i for each acceleration limit and the force f = m / A - l' / J of each motion,

    T >= int min over 0 < x <= cap of [(1 - sum |l|) x^(-1/2) + g x] dsigma - int sum |m| dsigma
         + sum over double knots of min(0, G cap) - jumps + ends,
    g = 1/2 sum (f q'' - f' q'),      G = -1/2 sum [f] q'      ([.] the step at a double knot),

for every plan, provided sum |l| <= 1; where it is more all multipliers are scaled down together.  At an end with a feed
x is known, and 1/2 f q' x + l q_dd / J is what it says.  **At a curvature jump** the acceleration of axis j may step by
|D_j| <= J_j T / 0.75 (a check with the period T grants no more), which costs l_j D_j / J_j; but with the step the check
grants the axis only the rest of its jerk for 1.5 periods before and after, which is worth 2.25 min |l_j| D_j / J_j.

The integral of |m| and the largest sum |l| are exact, as is the minimum.  The rest is a Gauss sum over each part and over
its halves, halved on where the two differ; the sum of the differences that are left is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.compiled import core
from planner.gauss import gauss_legendre
from planner.plan.dual.terms import RULE_NODES, Multiplied, Points, Track, jump_cap, largest_steps
from planner.plan.ends import Feed
from planner.plan.jumps import STEP_REACH, STEP_SEEN
from planner.types import FloatArray, IntArray

_NODES, _WEIGHTS = gauss_legendre(6)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
_TARGET = 1e-9  # of the integral: the difference between parts and halves to be reached
_LEVELS = 14
_SLIVER = 1e-9  # of a cell: parts shorter than this are not cut off
_ROUNDING = 1e-14
_CAP_MARGIN = 1.05  # of the largest cap at samples of a cell


@dataclass(frozen=True, eq=False)
class Splines:
    """Multipliers of a section: ``jerk (J, n + 1)`` and ``acceleration (A, n)`` as in a certificate, on a track."""

    track: Track
    of: Multiplied
    jerk: FloatArray
    acceleration: FloatArray

    def scaled(self, factor: float) -> Splines:
        """Every multiplier times one factor; no other change leaves a bound as good as it is."""
        return Splines(self.track, self.of, factor * self.jerk, factor * self.acceleration)

    @cached_property
    def controls(self) -> FloatArray:
        """Bernstein coefficients (3, J, n - 1) of l in each cell."""
        h = self.track.h
        before, after = np.append(0.0, h[:-1]), np.append(h[1:], 0.0)
        c0, c1, c2 = self.jerk[:, :-2], self.jerk[:, 1:-1], self.jerk[:, 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            low = (h * c0 + before * c1) / (before + h)
            high = (after * c1 + h * c2) / (h + after)
        return np.stack([low, c1, high])


def value(splines: Splines) -> tuple[float, float]:
    """Bound of a section by its multipliers, which must satisfy sum |l| <= 1, and what was subtracted for the quadrature."""
    parts = _parts(splines)
    integral, off = _integral(splines, *parts)
    return integral - off - _price_of_acceleration(splines) + _between(splines) + _ends(splines), off


def normalised(splines: Splines) -> tuple[Splines, FloatArray]:
    """Scale the multipliers so that sum |l| <= 1; and the largest sum |l| of each cell before that."""
    load = largest_load(splines)
    most = float(load.max(initial=0.0))
    return (splines if most <= 1.0 else splines.scaled((1.0 - _ROUNDING) / most)), load


def largest_load(splines: Splines) -> FloatArray:
    """Largest sum |l| in each cell, (n - 1,); exact: between changes of sign it is one quadratic."""
    k, lower, upper = _parts(splines)
    a, b, c = splines.controls[:, :, k]
    middle = 0.5 * (lower + upper)
    sign = np.sign(_quadratic(a, b, c, middle))
    a, b, c = (np.sum(sign * part, axis=0) for part in (a, b, c))
    bend = a - 2.0 * b + c
    vertex = np.divide(a - b, bend, out=lower.copy(), where=bend < 0.0)
    values = [_quadratic(a, b, c, r) for r in (lower, upper, np.clip(vertex, lower, upper))]
    load = np.zeros(splines.track.sigma.size - 1)
    np.maximum.at(load, k, np.max(values, axis=0))
    return load


def _quadratic(a: FloatArray, b: FloatArray, c: FloatArray, r: FloatArray) -> FloatArray:
    s = 1.0 - r
    return s * s * a + 2.0 * r * s * b + r * r * c


def _parts(splines: Splines) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cut the cells where an l changes its sign: cell, lower and upper end in [0, 1] of each part."""
    full = splines.track.full
    a, b, c = splines.controls[:, :, full]
    bend, half = a - 2.0 * b + c, b - a
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(half**2 - bend * a)
        far = -(half + np.copysign(root, half))
        places = np.concatenate([far / bend, a / far])
    inner = (places > _SLIVER) & (places < 1.0 - _SLIVER)
    cut = np.flatnonzero(inner.any(axis=0))
    whole = np.setdiff1d(np.arange(full.size), cut, assume_unique=True)
    at = np.sort(np.where(inner[:, cut], places[:, cut], 1.0), axis=0)
    edges = np.concatenate([np.zeros((1, cut.size)), at, np.ones((1, cut.size))])
    lower, upper = edges[:-1].T, edges[1:].T
    some = upper - lower > 0.0
    cells = np.broadcast_to(full[cut][:, None], lower.shape)[some]
    k = np.concatenate([full[whole], cells])
    lower = np.concatenate([np.zeros(whole.size), lower[some]])
    upper = np.concatenate([np.ones(whole.size), upper[some]])
    order = np.lexsort((lower, k))
    return k[order], lower[order], upper[order]


def min_price(w: FloatArray, g: FloatArray, cap: FloatArray) -> FloatArray:
    """Smallest w x^(-1/2) + g x over 0 < x <= cap; for g > 0 at x = (w / 2g)^(2/3) where that is below the cap."""
    out = np.empty(w.size)
    core.value_min_price(w.size, w, g, cap, out)
    return out


def integrand(splines: Splines, k: IntArray, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weight 1 - sum |l| of the pace, coefficient g of x, and its cap, (n,) each, at points of the cells k (n,)."""
    of = splines.of
    found = np.empty(k.size), np.empty(k.size), np.empty(k.size)
    multipliers = (
        *(of.jerk.size, of.jerk, of.most_jerk, splines.controls),
        *(of.acceleration.size, of.acceleration, of.most_acceleration, splines.acceleration),
    )
    core.value_integrand(*splines.track.arrays, *multipliers, k.size, k, r, *found)
    return found


def _sums(splines: Splines, k: IntArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Gauss sum of the integrand over each part."""
    r = (lower[:, None] + (upper - lower)[:, None] * _NODES).reshape(-1)
    found = min_price(*integrand(splines, np.repeat(k, _NODES.size), r)).reshape(k.size, -1)
    return np.asarray(found @ _WEIGHTS * (upper - lower) * splines.track.h[k])


def _integral(splines: Splines, k: IntArray, lower: FloatArray, upper: FloatArray) -> tuple[float, float]:
    """The integral, and by how much it may be too large."""
    whole = _sums(splines, k, lower, upper)
    share = _TARGET * float(np.abs(whole).sum()) / k.size
    found = off = 0.0
    for level in range(_LEVELS):
        middle = 0.5 * (lower + upper)
        halves = np.repeat(k, 2)
        lower, upper = np.stack([lower, middle], axis=1).reshape(-1), np.stack([middle, upper], axis=1).reshape(-1)
        values = _sums(splines, halves, lower, upper)
        pairs = values.reshape(-1, 2).sum(axis=1)
        with np.errstate(invalid="ignore"):
            apart = np.abs(pairs - whole)
        again = (apart > share) & np.isfinite(apart) & (level < _LEVELS - 1)
        found, off = found + float(pairs[~again].sum()), off + float(apart[~again].sum())
        if not again.any():
            break
        some = np.repeat(again, 2)
        k, lower, upper, whole = k[again], lower[some], upper[some], values[some]
        k = np.repeat(k, 2)
    return (found, off) if np.isfinite(off) else (-np.inf, 0.0)


def _price_of_acceleration(splines: Splines) -> float:
    """Integral of sum |m|, exact."""
    a, b = splines.acceleration[:, :-1], splines.acceleration[:, 1:]
    size = np.abs(a) + np.abs(b)
    crossing = np.divide(a**2 + b**2, 2.0 * size, out=np.zeros_like(size), where=size > 0.0)
    return float(np.sum(np.where(a * b < 0.0, crossing, 0.5 * size) * splines.track.h))


@dataclass(frozen=True, eq=False)
class _Sides:
    """Ends of cells, from inside: derivatives (K, p) of the motions, cap, half of sum f q', and |l| / J of each motion."""

    at: Points
    pull: FloatArray
    load: FloatArray


def _sides(splines: Splines, k: IntArray, end: int) -> _Sides:
    of, track = splines.of, splines.track
    h = track.h[k]
    at = track.points(k, np.full(k.size, float(end)))
    a, b, c = splines.controls[:, :, k]
    slope = 2.0 * ((b - a) if end == 0 else (c - b)) / h
    m = splines.acceleration[:, k + end]
    pull = np.sum(m * at.first[of.acceleration] / of.most_acceleration[:, None], axis=0)
    pull -= np.sum(slope * at.first[of.jerk] / of.most_jerk[:, None], axis=0)
    load = np.zeros_like(at.first)
    load[of.jerk] = (a if end == 0 else c) / of.most_jerk[:, None]
    return _Sides(at, 0.5 * pull, load)


def _between(splines: Splines) -> float:
    """Price of the double knots; those at curvature jumps pay for the steps of the acceleration too."""
    track = splines.track
    empty = np.flatnonzero(track.h == 0.0)
    if empty.size == 0:
        return 0.0
    before, after = _sides(splines, empty - 1, 1), _sides(splines, empty + 1, 0)
    pull, cap = before.pull - after.pull, np.minimum(before.at.cap, after.at.cap)
    jump = np.flatnonzero(track.jumps[empty])
    cap[jump] = np.minimum(cap, jump_cap(track.limits, before.at, after.at))[jump]
    with np.errstate(invalid="ignore"):
        total = float(np.sum(np.where(pull < 0.0, pull * cap, 0.0)))
    if jump.size:
        spared = _spared(splines, empty[jump])
        total -= sum((_step_price(splines, before, int(i), spared[:, n]) for n, i in enumerate(jump)), 0.0)
    return total


def _step_price(splines: Splines, side: _Sides, i: int, spared: FloatArray) -> float:
    """Most that steps of the axes' acceleration cost at a jump, where min |l| around it is ``spared`` (K,)."""
    limits, dim = splines.track.limits, splines.track.section.curve.dim
    tip = side.at.first[-1, i]
    linear = np.array(splines.track.section.curve.axis_units) == "mm"
    along = np.where(linear, np.abs(side.at.first[:-1, i]) / tip, 0.0) if tip > 0.0 else np.zeros(dim)
    cost = np.abs(side.load[:dim, i]) + np.abs(side.load[-1, i]) * along
    cost -= 2.0 * STEP_REACH * STEP_SEEN * spared[:dim] / limits.jerk
    largest = largest_steps(limits)
    paid = cost > 0.0
    return float(np.sum(cost[paid] * largest[paid]))


def _spared(splines: Splines, jumps: IntArray) -> FloatArray:
    """Min |l_j| within 1.5 periods of each jump, (K, jumps); 0 for those that are not alone there."""
    track, of = splines.track, splines.of
    least = np.zeros(track.sigma.size - 1)
    nodes, full = RULE_NODES, track.full
    cap = track.points(np.repeat(full, nodes.size), np.tile(nodes, full.size)).cap.reshape(-1, nodes.size)
    least[full] = track.h[full] / np.sqrt(_CAP_MARGIN * cap.max(axis=1))
    times = np.append(0.0, np.cumsum(least))
    at, reach = times[jumps], STEP_REACH * track.limits.period
    around = np.diff(np.concatenate([[-np.inf], at, [np.inf]]))
    alone = (np.minimum(around[:-1], around[1:]) > 2.0 * reach) & (at > reach) & (times[-1] - at > reach)
    low = np.searchsorted(times[1:], at - reach, side="left")
    high = np.searchsorted(times[:-1], at + reach, side="right")
    a, b, c = splines.controls
    out = np.zeros((track.rise.shape[0], jumps.size))
    for n in np.flatnonzero(alone):
        some = np.arange(low[n], high[n])
        some = some[track.h[some] > 0.0]
        hull = np.stack([a[:, some], b[:, some], c[:, some]])
        one_sign = (hull > 0.0).all(axis=(0, 2)) | (hull < 0.0).all(axis=(0, 2))
        out[of.jerk, n] = np.where(one_sign, np.abs(hull).min(axis=(0, 2)), 0.0)
    return out


def _ends(splines: Splines) -> float:
    """Bracket 1/2 f q' x + l q_dd / J at ends with a feed: plus at the end, minus at the start."""
    section, total = splines.track.section, 0.0
    for end, asked in ((0, section.start), (1, section.end)):
        if not isinstance(asked, Feed):
            continue
        side, sign = _sides(splines, splines.track.full[[0 if end == 0 else -1]], end), 2.0 * end - 1.0
        x = (asked.feed / side.at.first[-1, 0]) ** 2
        total += sign * float(side.pull[0]) * x
        slope = 0.0  # where it is not prescribed, l is 0
        if asked.acceleration is not None:
            slope = (asked.acceleration - side.at.second[-1, 0] * x) / side.at.first[-1, 0]
        total += sign * float(side.load[:, 0] @ (side.at.second[:, 0] * x + side.at.first[:, 0] * slope))
    return total


def seam_price(first: Splines, last: Splines) -> float:
    """Price of the place where a periodic path closes: G cap, l being the same on both sides."""
    after, before = _sides(first, first.track.full[[0]], 0), _sides(last, last.track.full[[-1]], 1)
    pull, cap = float(before.pull[0] - after.pull[0]), float(min(before.at.cap[0], after.at.cap[0]))
    return 0.0 if pull >= 0.0 else pull * cap
