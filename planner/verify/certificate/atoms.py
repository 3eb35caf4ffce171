"""What a certificate gains and pays at single places: double knots, curvature jumps, and the ends of its sections.

Between two pieces the force f = m / A - l' / J may jump, and so may the coordinate; the speed v of the machine along its
path (the arc length of the axes) does not.  With v^2 = x |q'|^2 the brackets that integration by parts leaves there are

    G v^2 - sum (l_j / J_j) D_j,      G = 1/2 sum (f q')_left / |q'|^2_left - 1/2 sum (f q')_right / |q'|^2_right,

D the steps of the acceleration: none but at a jump of the curvature.  There D = k v^2 + t a, with the jump k of the
second derivative over arc length, the tangent t, and any step a along it; a check sees a step of one axis as a jerk of
0.75 |D| / T once it is sampled with the period T, and grants it together with the jerk within three periods:

    |D_j| <= J_j T / 0.75,      |jerk_j| <= J_j - 0.75 |D_j| / T   within 1.5 periods before and after.

The second takes 2.25 |D_j| / J_j min |l_j| off the integral of l_j jerk_j / J_j: more, as a rule, than the step gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from planner.geometry.differential import dot
from planner.types import FloatArray, IntArray
from planner.verify.certificate.pathspeeds import Bounds, Flags, PathPoints, path_points, stop_caps
from planner.verify.certificate.quadrature import SectionPath, Stretches
from planner.verify.sizes import STEP_PEAK, STEP_REACH

_TIME_MARGIN = 1.01  # the shortest times are Gauss sums
_CORNER_SLACK = 1e-9  # by which a vertex may lie outside the others' limits and still count


@dataclass(frozen=True, eq=False)
class SideTerms:
    """One side of a place: what the brackets need, per motion (K,).

    ``turn`` and ``bend`` are the first and second derivative over the arc length of the axes, ``force`` f, ``load``
    l / J, ``cap`` the largest v^2.
    """

    turn: FloatArray
    bend: FloatArray
    force: FloatArray
    load: FloatArray
    cap: float

    @property
    def pull(self) -> float:
        """1/2 sum f q' / |q'|^2 in units of v^2: the force along the path."""
        return 0.5 * float(np.sum(self.force * self.turn))


def sides(path: SectionPath, stretches: Stretches, i: IntArray, end: int) -> list[SideTerms]:
    """Evaluate the starts (end = 0) or ends (1) of the intervals i, from inside."""
    r = np.full(i.size, float(end))
    points = path_points(path.curve, path.limits, path.parts, i, r, np.full(i.size, end == 1))
    _, force, _ = path.forces(i, r)
    load = path.parts.jerk_at(i, r)[0] / Bounds.of(path.limits).jerk[:, None]
    cap = _caps(path, stretches, points, i, end)
    axes, bends = points.first[:-1].T, points.second[:-1].T
    v = np.sqrt(dot(axes, axes))
    turn = points.first / v
    bend = (points.second - turn * dot(axes / v[:, None], bends)) / v**2
    # f q' x = f q' v^2 / |q'|^2
    return [
        SideTerms(turn[:, k], bend[:, k], force[:, k] / v[k], load[:, k], float(cap[k] * v[k] ** 2))
        for k in range(i.size)
    ]


def _caps(path: SectionPath, stretches: Stretches, points: PathPoints, i: IntArray, end: int) -> FloatArray:
    """Largest sigma_dot^2 at the starts or ends of the intervals i."""
    cap = np.minimum(points.cap, points.chord_cap)
    # The way at the start of an interval is that at the start of its first part, its own way added from the far end.
    if end == 0:
        part = np.searchsorted(stretches.interval, i, side="left")
        beyond = np.maximum(part - 1, 0)
        ways = np.stack([stretches.way[0][:, part], stretches.way[1][:, beyond]])
        own = (part > 0) & np.ones_like(part, dtype=bool)
    else:
        part = np.searchsorted(stretches.interval, i, side="right") - 1
        beyond = np.minimum(part + 1, stretches.interval.size - 1)
        ways = np.stack([stretches.way[0][:, beyond], stretches.way[1][:, part]])
        own = part + 1 < stretches.interval.size
    for k in range(2):
        ramps: Flags = stretches.ramps[k][:, part] & stretches.ramps[k][:, beyond] & own
        reached = np.where(own, (1.0 + 1e-6) * ways[k], np.inf)
        cap = np.minimum(cap, stop_caps(Bounds.of(path.limits), points.first, reached, path.speeds[k], ramps))
    return cap


def passed(before: SideTerms, after: SideTerms) -> float:
    """Price of a place without a step of the acceleration: the least of G v^2."""
    pull, cap = before.pull - after.pull, min(before.cap, after.cap)
    return 0.0 if pull >= 0.0 else pull * cap


def stepped(before: SideTerms, after: SideTerms, path: SectionPath, spared: FloatArray) -> float:
    """Price of a curvature jump: the least of G v^2 - sum c D + sum b |D| over v^2 and the step along the path.

    It is piecewise linear and convex in the two, so its least value lies where two of the lines D_j = 0, |D_j| at its
    limit, v = 0, v^2 = cap meet.  ``spared`` is min |l_j| around the jump, (K,), 0 where nothing is known.
    """
    limits, curve = path.limits, path.curve
    bounds, dim = Bounds.of(limits), curve.dim
    cap = min(before.cap, after.cap)
    if not np.isfinite(cap):
        return -np.inf
    tangent, jump = 0.5 * (before.turn + after.turn)[:dim], (after.bend - before.bend)[:dim] * cap
    linear = np.array(curve.axis_units) == "mm"
    tip = before.turn[-1]
    # The step of the tip's acceleration is the part of the axes' steps along the tip's tangent.
    along = np.where(linear, tangent / tip, 0.0) if tip > 0.0 else np.zeros(dim)
    cost = before.load[:dim] + before.load[-1] * along
    saved = 2.0 * STEP_REACH * STEP_PEAK * spared[:dim] / bounds.jerk[:dim]
    largest = np.minimum(bounds.jerk[:dim] * limits.period / STEP_PEAK, 2.0 * bounds.acceleration[:dim])
    if not np.isfinite(largest[tangent != 0.0]).any():
        if np.dot(cost, tangent) != 0.0:
            return -np.inf  # nothing limits a step along the path
        tangent = np.zeros(dim)
    return _least(jump, tangent, before.pull - after.pull, cap, cost, saved, largest)


def _least(
    jump: FloatArray,
    tangent: FloatArray,
    pull: float,
    cap: float,
    cost: FloatArray,
    saved: FloatArray,
    largest: FloatArray,
) -> float:
    """Least value over the corners of the lines, in y = v^2 / cap and a = the step along the path over its largest."""
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = float(np.nanmin(np.where(tangent != 0.0, largest / np.abs(tangent), np.inf)))
    unit = reach if np.isfinite(reach) else 1.0
    tangent = tangent * unit
    lines = [(1.0, 0.0, 0.0), (1.0, 0.0, 1.0)]
    for k, t, most in zip(jump, tangent, largest, strict=True):
        lines.append((k, t, 0.0))
        if np.isfinite(most):
            lines += [(k, t, most), (k, t, -most)]
    # Where no line depends on the step, the corners are taken along v^2 alone.
    if not tangent.any():
        lines.append((0.0, 1.0, 0.0))
    least = 0.0
    for (k0, t0, b0), (k1, t1, b1) in combinations(lines, 2):
        det = k0 * t1 - k1 * t0
        if det == 0.0:
            continue
        y, a = (b0 * t1 - b1 * t0) / det, (k0 * b1 - k1 * b0) / det
        steps = jump * y + tangent * a
        if -_CORNER_SLACK <= y <= 1.0 + _CORNER_SLACK and np.all(np.abs(steps) <= largest * (1.0 + _CORNER_SLACK)):
            least = min(least, pull * cap * y - float(np.dot(cost, steps)) + float(np.dot(saved, np.abs(steps))))
    return least


def spared_around(path: SectionPath, stretches: Stretches, times: FloatArray, at: FloatArray) -> FloatArray:
    """Min |l_j| within 1.5 periods of each curvature jump, (K, jumps); 0 for jumps that are not alone.

    ``times (p + 1,)`` are the shortest times from the start of the section to the ends of its parts, ``at (jumps,)``
    those to the jumps.  At an end the window is cut off, so a jump closer than that to one is not alone either.
    """
    reach = _TIME_MARGIN * STEP_REACH * path.limits.period
    low = np.searchsorted(times[1:], at - reach, side="left")
    high = np.searchsorted(times[:-1], at + reach, side="right")
    around = np.diff(np.concatenate([[-np.inf], at, [np.inf]]))
    alone = (np.minimum(around[:-1], around[1:]) > 2.0 * reach) & (at > reach) & (times[-1] - at > reach)
    out = np.zeros((path.parts.jerk.shape[0], at.size))
    for k in np.flatnonzero(alone):
        some = np.arange(low[k], high[k])
        out[:, k] = path.parts.smallest_sizes(stretches.interval[some], stretches.lower[some], stretches.upper[some])
    return out


def end_term(side: SideTerms, path: SectionPath, feed: float, acceleration: float, sign: float) -> float:
    """Least bracket l q_dd / J + f q' x / 2 at an end with a feed, times ``sign`` (-1 at the start, +1 at the end).

    Where the tangential acceleration is not prescribed, it is whatever the limits allow.
    """
    bounds = Bounds.of(path.limits)
    if not side.turn[-1] > 0.0:
        return -np.inf  # the tip rests there: its feed says nothing of the machine's speed
    speed2 = (feed / side.turn[-1]) ** 2
    fixed = side.bend * speed2
    known = sign * (side.pull * speed2 + float(np.dot(side.load, fixed)))
    slope = sign * float(np.dot(side.load, side.turn))
    if np.isfinite(acceleration):
        return known + slope * (acceleration - fixed[-1]) / side.turn[-1]
    if slope == 0.0:
        return known
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.array([[-1.0], [1.0]]) * bounds.acceleration - fixed) / side.turn
    ends = ends[:, side.turn != 0.0]
    lowest, highest = ends.min(axis=0).max(), ends.max(axis=0).min()
    return known + min(slope * lowest, slope * highest)


def seam(last: SideTerms, first: SideTerms, path: SectionPath, smooth: bool) -> float:
    """Price of the place where a periodic path closes: feed and acceleration are the same on both sides.

    A difference of the l, and where the curvature jumps the l themselves, are paid with the largest acceleration.
    """
    bounds = Bounds.of(path.limits)
    paid = np.abs(last.load - first.load) if smooth else np.abs(last.load) + np.abs(first.load)
    with np.errstate(invalid="ignore"):
        price = np.where(paid > 0.0, paid * bounds.acceleration, 0.0)
    return passed(last, first) - float(np.sum(price))
