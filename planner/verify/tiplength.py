"""Arc length of the tool tip from sample to sample, counted backwards where the tip has come to rest and turned back.

Where rotary axes carry the tip over such a place its path has a cusp: s'' of the length without a sign would jump from -a to
a, of a motion along a straight line with the acceleration a.

The steps are integrated one by one.  Differences of an accumulated length would be known to the last digits of the whole
only, which the third difference over a period of 1 ms makes 1e9 times larger.
"""

from __future__ import annotations

import numpy as np

from planner.gauss import gauss_legendre
from planner.geometry.curve import Curve
from planner.geometry.differential import dot, norm
from planner.sets import union
from planner.types import FloatArray
from planner.verify.peaks import chunks, zoom
from planner.verify.sizes import EPS, LENGTH_ACCURACY

# The tip comes to rest where its |C'| falls below this fraction of that at the samples around: to 0 but for the digits of
# u.  A turn, however tight, is none.
_AT_REST = 1e-8
_REST_SEARCHES = 3  # each narrows the place by 3e4
_NODES, _WEIGHTS = gauss_legendre(3)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
_TARGET = 1e-13  # of a step: the disagreement of a sum with that over its halves
# What is below the first, and not below the second of what it was before halving, is the rounding of |C'|.
_NOISE, _BETTER = 1e-9, 0.1
_HALVINGS = 20


def tip_steps(curve: Curve, u: FloatArray, *, exact: bool = True) -> tuple[FloatArray, float]:
    """Signed length of each step (m - 1,) between samples u (m,), and how far one may be off, mm.

    Not ``exact``: differences of the accumulated length where the tip cannot turn back, a quarter of the work; for samples
    that no tangential limit is compared with.
    """
    tip, u = curve.tip, np.maximum.accumulate(u)  # where u falls back, the check has said so
    slope = tip.derivatives(u, 1)[1]
    rounding = EPS * 0.5 * float((norm(slope) * np.abs(u)).max(initial=0.0))
    if tip.dim == 1:
        x = tip.derivatives(u, 0)[0, :, 0]
        return np.diff(x), rounding + EPS * float(np.abs(x).max(initial=0.0))
    if tip is curve and not exact:
        s = curve.arclength.s(u)
        return np.diff(s), rounding + LENGTH_ACCURACY * curve.length + EPS * float(s.max(initial=0.0))
    rests = _rests(curve, u, slope)
    breaks = curve._candidate_breaks()
    edges = union(u, breaks[(breaks > u[0]) & (breaks < u[-1])], rests)
    middle = 0.5 * (edges[1:] + edges[:-1])
    lengths, doubt = _lengths(tip, edges[:-1], edges[1:])
    sign = 1.0 - 2.0 * (np.searchsorted(rests, middle) % 2)
    step = np.searchsorted(u, middle, side="right") - 1
    return np.asarray(np.bincount(step, sign * lengths, u.size - 1), dtype=np.float64), rounding + doubt


def _lengths(tip: Curve, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, float]:
    """Length of the path over each piece, halved until the halves agree with the whole, and the largest disagreement."""

    def sums(lo: FloatArray, hi: FloatArray) -> FloatArray:
        out = np.empty(lo.size)
        for some in chunks(lo.size, _NODES.size):
            at = lo[some, None] + (hi - lo)[some, None] * _NODES
            speed = norm(tip.derivatives(at.reshape(-1), 1)[1]).reshape(at.shape)
            out[some] = (speed @ _WEIGHTS) * (hi - lo)[some]
        return out

    total, doubt = np.zeros(lower.size), 0.0
    owner, lo, hi = np.arange(lower.size), lower, upper
    whole, before = sums(lo, hi), np.full(lower.size, np.inf)
    for level in range(_HALVINGS):
        middle = 0.5 * (lo + hi)
        first, second = sums(lo, middle), sums(middle, hi)
        apart = np.abs(first + second - whole)
        share = np.divide(apart, whole, out=np.zeros_like(whole), where=whole > 0.0)
        again = (share > _TARGET) & ((share > _NOISE) | (share < _BETTER * before)) & (level < _HALVINGS - 1)
        again &= (middle > lo) & (middle < hi)
        total += np.bincount(owner[~again], (first + second)[~again], lower.size)
        doubt = max(doubt, float(apart[~again].max(initial=0.0)))
        if not again.any():
            break
        owner, before = np.tile(owner[again], 2), np.tile(share[again], 2)
        lo, hi = np.concatenate([lo[again], middle[again]]), np.concatenate([middle[again], hi[again]])
        whole = np.concatenate([first[again], second[again]])
    return total, doubt


def _rests(curve: Curve, u: FloatArray, slope: FloatArray) -> FloatArray:
    """Parameters at which the tip rests and turns back, increasing."""
    if curve.tip is curve:
        return np.empty(0)
    moving = norm(slope) > 0.0
    places, slope, size = u[moving], slope[moving], norm(slope[moving])
    turned = np.flatnonzero(dot(slope[1:], slope[:-1]) < 0.0)
    if turned.size == 0:
        return np.empty(0)
    lower, upper = np.minimum(places[turned], places[turned + 1]), np.maximum(places[turned], places[turned + 1])

    def slowness(x: FloatArray) -> FloatArray:
        return -norm(curve.tip.derivatives(x, 1)[1])

    at, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    for _ in range(_REST_SEARCHES):
        at, half = zoom(slowness, at, half, lower, upper), 1e-4 * half
    return np.sort(at[-slowness(at) <= _AT_REST * np.maximum(size[turned], size[turned + 1])])
