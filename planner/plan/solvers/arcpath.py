"""A section of a path along the arc length of the tool tip: its limits there, and the way back to a time law u(t).

With s the arc length of the tip and t = q_s, k = q_ss, z = q_sss the machine axes' derivatives along it, a feed v with
tangential acceleration a and jerk J puts on axis j

    velocity |t v| <= V_j,   acceleration |t a + k v^2| <= A_j,   jerk |t J + 3 k v a + z v^3| <= J_j.

:func:`describe` samples these rows on a grid refined until neighbours are alike, :func:`tabulate` turns phases of constant
jerk along s into nodes of a time law, and :func:`used_exactly` measures such a law against every limit on the exact curve.

At a curvature jump the acceleration of axis j steps by D = |dk_j| v^2; the rule for that is in :mod:`planner.plan.jumps`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.geometry.differential import (
    along_length,
    chain_rule,
    curvature,
    rates_along,
    rates_of_parameter,
    speed_derivatives,
)
from planner.law import quintic_coefficients
from planner.machine.feed_limits import chord_feed_limit, commanded_feed, largest_command
from planner.machine.limits import Limits
from planner.plan.jumps import JERK_BESIDE_STEP, PERIODS_AROUND_STEP, STEP_SHARE, passable
from planner.quantity import ACCELERATION, JERK, TANGENTIAL
from planner.types import FloatArray, IntArray, Side

LawColumns = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

_REST = 1e-9  # |p'| below this fraction of its largest value: the tip rests
# The first grid: so many points evenly in u, as many in s, and some in each panel of the arc length; then up to so many
# halvings of cells across which the limit curve changes by more than _CHANGE, or a direction by twice that.
_EVEN_POINTS, _PANEL_POINTS, _CHANGE, _PASSES, _MAX_GRID = 400, 4, 0.02, 8, 200_000
_NEXT_TO_JUMP = 1e-3  # of the distance covered in three periods
_STRAIGHT, _EVEN = 1e-12, 1e-10
_UNREACHED = 1.01  # times the acceleration at which the largest feed is reached
_BESIDE = 1e-3  # of a cell
# Two rounded numbers u, 4 eps apart, make the third derivative of a quintic over a time h uncertain by 240 eps |u| / h^3,
# the first two by fractions of that times h^2 and h.
_DIGITS = 240.0 * float(np.finfo(np.float64).eps)
_DIGITS_OF_ORDER = np.array([[0.07], [0.25], [1.0]])
NOISE = 1e-3  # share of the jerk limits that rounding may take
_ON_BREAK = 4.0 * float(np.finfo(np.float64).eps)
_CLOSE = 0.01  # of a phase
# The quintics' errors against the jerk limits and the largest feed; the command is met within a margin for the latter.
_HALVINGS, _JERK_ERROR, _FEED_ERROR, _FEED_MARGIN = 16, 1e-4, 5e-9, 1e-7
_CHECK_POINTS = 9
_SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True, eq=False)
class ArcPath:
    """Cells between grid points; limits scaled to 1 and linear across a cell.

    ``command`` the feed commanded; ``s (n + 1,)`` grid points; ``rows, slopes (n, 6, axes)``: t/V, t/A, k/A, t/J, 3k/J,
    z/J at a cell's left end and their change across it; ``cap (n,)`` of the feed by command, chord and curvature jumps;
    ``limit (n + 1,)`` the limit curve, that is the largest feed at a = J = 0, ``cruise (n,)`` its lowest value in each
    cell; ``curved (n,)`` 0 where the path is straight and u even along it, else 1; ``tops (4,)`` the largest feed,
    accelerations up and down, and jerk anywhere; ``jumps`` places of the curvature jumps that limit the feed;
    ``shortest`` a time over which double precision still holds a jerk, s; ``trials`` the places at which a ramp is to be
    tried, dense where the limits vary, and on both sides of every break.
    """

    command: float
    s: FloatArray
    rows: FloatArray
    slopes: FloatArray
    cap: FloatArray
    limit: FloatArray
    cruise: FloatArray
    curved: FloatArray
    tops: FloatArray
    jumps: FloatArray
    shortest: float
    trials: FloatArray

    def with_margin(self, margin: FloatArray, apart: int) -> ArcPath:
        """Tighten every limit but the command by a fraction (n,) where the path is curved; try every ``apart`` cells."""
        factor = 1.0 + margin * self.curved
        rows, slopes = self.rows * factor[:, None, None], self.slopes * factor[:, None, None]
        commanded = self.command / (1.0 + _FEED_MARGIN * self.curved)
        cap, cruise = (np.where(x < self.command, x / factor, commanded) for x in (self.cap, self.cruise))
        gap = np.abs(self.rows[1:] - self.rows[:-1] - self.slopes[:-1])
        breaks = 1 + np.flatnonzero((gap > _STRAIGHT * np.abs(self.rows).max(axis=0)).any(axis=(1, 2)))
        beside = [self.s[breaks] + _BESIDE * (self.s[breaks + side] - self.s[breaks]) for side in (-1, 1)]
        trials = np.unique(np.concatenate([self.s[::apart], *beside]))
        return replace(self, rows=rows, slopes=slopes, cap=cap, cruise=cruise, trials=trials)

    def used(self, s: FloatArray, v: FloatArray, a: FloatArray, jerk: FloatArray) -> FloatArray:
        """Largest share of any limit used in states along the path, all (m,)."""
        cell = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, self.cap.size - 1)
        w = (s - self.s[cell]) / (self.s[cell + 1] - self.s[cell])
        row = self.rows[cell] + w[:, None, None] * self.slopes[cell]
        tv, ta, ka, tj, kj, zj = (row[:, i] for i in range(6))
        v1, a1, j1 = v[:, None], a[:, None], jerk[:, None]
        share = np.maximum(np.abs(tv * v1), np.abs(ta * a1 + ka * v1**2))
        share = np.maximum(share, np.abs(tj * j1 + v1 * (kj * a1 + zj * v1**2)))
        return np.asarray(np.maximum(share.max(axis=1), v / self.cap[cell]))

    def lowest_cruise(self, s0: FloatArray, s1: FloatArray) -> FloatArray:
        """Smallest cruise feed over each of the stretches [s0, s1]."""
        first = np.clip(np.searchsorted(self.s, s0, side="right") - 1, 0, self.cruise.size - 1)
        last = np.clip(np.searchsorted(self.s, s1, side="left"), first + 1, self.cruise.size)
        bounds = np.stack([first, last], axis=1).reshape(-1)
        return np.asarray(np.minimum.reduceat(np.append(self.cruise, np.inf), bounds)[::2])


def advance_phase(state: FloatArray, jerk: FloatArray, h: FloatArray) -> FloatArray:
    """Move s, v, a (3, ...) on by the time h at constant jerk."""
    s, v, a = state
    return np.stack([s + h * (v + h * (0.5 * a + h * jerk / 6.0)), v + h * (a + 0.5 * h * jerk), a + h * jerk])


# ---- limits along the arc length ------------------------------------------------------------------------------------


def arc_derivatives_of_axes(curve: Curve, u: FloatArray, side: Side) -> tuple[FloatArray, ...]:
    """t, k, z (n, dim) of the machine axes along the TIP's arc length; |p'| and its first two u-derivatives (n,).

    Raises InputError where the tip rests.
    """
    q = curve.derivatives(u, 3, side=side)
    p = q if curve.tip is curve else curve.tip.derivatives(u, 3, side=side)
    speeds = speed_derivatives(p)
    speed = speeds[0]
    resting = np.flatnonzero(speed <= _REST * speed.max(initial=0.0))
    if resting.size:
        raise InputError(
            f'{curve.name}: the tool tip rests at u = {u[resting[0]]:.9g} while other axes move; method = "scurve" '
            'plans along the arc length of the tip and cannot cross such a stretch; use method = "optimal"'
        )
    return *along_length(q, speeds), *speeds


def describe(curve: Curve, limits: Limits, u_start: float, u_end: float, fastest_end: float) -> ArcPath:
    """Lay a grid over a section, whose ends have at most the feed ``fastest_end``, and scale the limits on it."""
    inside = [b for b in curve.breaks if u_start < b.u < u_end]
    jumps, jump_feed, reach = _jumps(curve, limits, np.array([b.u for b in inside if b.is_curvature_jump]))
    length = curve.arclength
    s0, s1 = float(length.s(u_start)), float(length.s(u_end))
    # The feed allowed at a jump holds in a tiny cell on either side of it.
    zones = np.concatenate([jumps + side * reach for side in (-1.0, -_NEXT_TO_JUMP, _NEXT_TO_JUMP, 1.0)])
    at_s = np.clip(np.append(np.linspace(s0, s1, _EVEN_POINTS + 1), zones), s0, s1)
    edges = np.unique(np.clip(length.edges, u_start, u_end))
    panels = edges[:-1, None] + np.diff(edges)[:, None] * np.linspace(0.0, 1.0, _PANEL_POINTS, endpoint=False)
    even = np.linspace(u_start, u_end, _EVEN_POINTS + 1)
    steps = curve.feed_caps.edges if curve.feed_caps is not None else np.empty(0)
    u = np.concatenate([even, panels.reshape(-1), [b.u for b in inside], steps, length.u(at_s)])
    arc_derivatives_of_axes(curve, np.clip(u, u_start, u_end), "right")  # before points of equal s, where it rests, go
    for remaining in reversed(range(_PASSES)):
        u = np.unique(np.clip(u, u_start, u_end))
        u = u[np.append(True, np.diff(length.s(u)) > 1e-15 * s1)]
        s = length.s(u)
        middle = 0.5 * (s[1:] + s[:-1])
        near = np.searchsorted(np.sort(jumps - reach), middle) > np.searchsorted(np.sort(jumps + reach), middle)
        jerk_share = np.where(near, JERK_BESIDE_STEP, 1.0)
        (rows, caps, limit), (end_rows, end_caps, end_limit) = (
            _limit_rows(curve, limits, at, side, jerk_share) for at, side in _cell_ends(u)
        )
        slopes = end_rows - rows
        turns = np.abs(slopes[:, [0, 1, 3]]) > 2.0 * _CHANGE * np.abs(rows[:, [0, 1, 3]]).max(axis=0)
        with np.errstate(invalid="ignore"):
            far = np.abs(end_limit - limit) > _CHANGE * np.minimum(limit, end_limit)
        far |= turns.any(axis=(1, 2))
        if not far.any() or remaining == 0 or u.size + np.count_nonzero(far) > _MAX_GRID:
            break
        u = np.append(u, 0.5 * (u[:-1] + u[1:])[far])
    speeds = [np.sqrt(np.sum(curve.tip.derivatives(x, 1, side=y)[1] ** 2, axis=-1)) for x, y in _cell_ends(u)]
    cap, at = np.minimum(caps, end_caps), np.searchsorted(s, jumps)
    np.minimum.at(cap, np.append(at - 1, at), np.append(jump_feed, jump_feed))
    cruise = np.minimum.reduce([limit, end_limit, cap])
    both = np.minimum(np.append(limit, np.inf), np.append(np.inf, end_limit))
    np.minimum.at(both, at, jump_feed)
    tops = _tops(float(cruise.max()), rows, s1 - s0, fastest_end, limits.period)
    v, a, _, j = tops
    units = np.array([v, a, v * v, j, v * a, v**3])[:, None]
    bend = np.append(np.abs(slopes * units), np.abs(rows * units)[:, [2, 4, 5]], axis=1)
    # Where |p'| varies, the quintics in u are as inexact on a straight path as on a bend.
    uneven = np.ptp(np.stack(speeds), axis=0) > _EVEN * speeds[0]
    curved = ((bend > _STRAIGHT).any(axis=(1, 2)) | uneven).astype(np.float64)
    # On a straight path, which is planned to the optimum, every phase is kept.
    shortest = float(np.cbrt(_DIGITS * s1 * np.abs(rows[:, 3]).max() / NOISE)) if curved.any() else 0.0
    both, cruise = np.minimum(both, v), np.minimum(cruise, v)
    command = largest_command(curve, limits)
    return ArcPath(
        command,
        s,
        rows,
        slopes,
        cap,
        both,
        cruise,
        curved,
        tops,
        jumps[jump_feed < v],
        shortest,
        s,
    )


def _cell_ends(u: FloatArray) -> tuple[tuple[FloatArray, Side], tuple[FloatArray, Side]]:
    """Left and right ends of the cells between grid points, and the side from which the curve is taken there."""
    return (u[:-1], "right"), (u[1:], "left")


def _limit_rows(
    curve: Curve, limits: Limits, u: FloatArray, side: Side, jerk_share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows (n, 6, axes), cap and limit curve (n,) at u; the tip's arc length is one more axis where it has limits."""
    t, k, z = arc_derivatives_of_axes(curve, u, side)[:3]
    velocity, acceleration, jerk = limits.velocity, limits.acceleration, limits.jerk
    if np.isfinite([limits.of(q) for q in TANGENTIAL]).any():
        one, zero = np.ones((u.size, 1)), np.zeros((u.size, 1))
        t, k, z = np.append(t, one, axis=1), np.append(k, zero, axis=1), np.append(z, zero, axis=1)
        velocity = np.append(velocity, np.inf)
        acceleration, jerk = limits.of_motions(ACCELERATION.order), limits.of_motions(JERK.order)
    jerks = jerk * jerk_share[:, None]
    parts = t / velocity, t / acceleration, k / acceleration, t / jerks, 3.0 * k / jerks, z / jerks
    commanded = commanded_feed(curve, limits, u, side == "left")
    cap = np.minimum(commanded, chord_feed_limit(curve.tip.curvature(u, side=side), limits))
    v, a, j = (np.abs(parts[i]).max(axis=1) for i in (0, 2, 5))
    with np.errstate(divide="ignore"):
        limit = np.minimum.reduce([cap, 1.0 / v, a**-0.5, np.cbrt(1.0 / j)])
    return np.stack(parts, axis=1), cap, np.asarray(limit)


def _jumps(curve: Curve, limits: Limits, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Arc length of curvature jumps, the feed allowed there, and the distance covered in three periods."""
    if u.size == 0:
        return u, u, u
    (t, before, *_), (_, after, *_) = (arc_derivatives_of_axes(curve, u, side) for side in _SIDES)
    s, step, window = curve.arclength.s(u), np.abs(after - before), PERIODS_AROUND_STEP * limits.period
    with np.errstate(divide="ignore"):
        alone = np.sqrt(passable(step, limits.jerk, limits.period))
        gain = (limits.acceleration / np.abs(t)).min(axis=1) * window
        reach = np.minimum(window * np.minimum(alone + gain, largest_command(curve, limits)), curve.length)
        # Steps within three periods of one another may add up.
        total = np.append(np.zeros((1, step.shape[1])), np.cumsum(step, axis=0), axis=0)
        near = total[np.searchsorted(s, s + reach, side="right")] - total[np.searchsorted(s, s - reach)]
        return s, np.sqrt(passable(near, limits.jerk, limits.period)), reach


def _tops(v: float, rows: FloatArray, length: float, fastest_end: float, period: float) -> FloatArray:
    """Largest feed, accelerations and jerk on the path; where there is no limit, finite ones that cost no time."""
    with np.errstate(divide="ignore"):
        a, j = (float((1.0 / np.abs(rows[:, i]).max(axis=1)).max()) for i in (1, 3))
    if np.isfinite(a):
        v = min(v, np.sqrt(fastest_end**2 + 2.0 * a * length))
    elif np.isfinite(j):
        v = min(v, fastest_end + 2.0 * np.cbrt(j * length**2))
    if not np.isfinite(v):
        raise InputError("feed, velocity, acceleration and jerk are all inf; at least one of them must be finite")
    if not np.isfinite(j):
        j = min(a, v / period) / period  # the acceleration builds up within a period, which samples cannot resolve
    a = min(a, _UNREACHED * np.sqrt(v * j))
    return np.array([v, a, a, j])


# ---- time law -------------------------------------------------------------------------------------------------------


def tabulate(
    curve: Curve, limits: Limits, u_ends: tuple[float, float], h: FloatArray, jerk: FloatArray, states: FloatArray
) -> LawColumns:
    """Turn phases of constant jerk along the arc length into the nodes (t, u, u_rate, u_acceleration) of a time law.

    Nodes stand where phases begin and on the curve's knots; an interval is halved while its quintic is off.  With an
    error e(t) ~ t^3 (h - t)^3 the third derivative is off most at the ends, by d, and the first by 0.009 d h^2.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    u_ends : pair of float
        Curve parameters of the ends.
    h, jerk : (n,) arrays
        Duration and jerk of each phase, s and mm/s^3.
    states : (3, n + 1) array
        s, v, a at the beginning of each phase and at the end.
    """
    clock = np.append(0.0, np.cumsum(h))
    breaks = curve._candidate_breaks()
    breaks = breaks[(breaks > u_ends[0]) & (breaks < u_ends[1])]
    cut, after = _crossings(states[:, :-1], jerk, h, curve.arclength.s(breaks), _ON_BREAK * curve.length)
    # Where the jerk is continuous but its slope is not, a node close by will do.
    close = np.minimum(after, h[cut] - after) < _CLOSE * h[cut]
    kept = np.isin(breaks, [b.u for b in curve.breaks]) | ~close
    breaks, cut, after = breaks[kept], cut[kept], after[kept]
    # Intervals: the phase they start in, how long after its start, and the curve parameter where it is known exactly.
    of, since = np.append(np.arange(h.size), cut), np.append(np.zeros(h.size), after)
    known = np.concatenate([u_ends[:1], np.full(h.size - 1, np.nan), breaks])
    for _ in range(_HALVINGS):
        order = np.lexsort((np.isnan(known), since, of))
        order = order[np.append(True, (np.diff(of[order]) > 0) | (np.diff(since[order]) > 0.0))]
        of, since, known = of[order], since[order], known[order]
        t = np.append(clock[of] + since, clock[-1])
        gap = np.diff(t)
        state = np.append(advance_phase(states[:, of], jerk[of], since), states[:, -1:], axis=1)
        u = np.append(known, u_ends[1])
        u[np.isnan(u)] = np.clip(curve.arclength.u(state[0, np.isnan(u)]), *u_ends)
        law, per_jerk, per_feed = _rates_of_u(curve, limits, u[:-1], state[:, :-1], jerk[of], "right")
        end_law = np.append(law[:, 1:], np.zeros((3, 1)), axis=1)
        broken = np.flatnonzero(np.append(~np.isnan(known[1:]), True))
        end_law[:, broken] = _rates_of_u(curve, limits, u[broken + 1], state[:, broken + 1], jerk[of[broken]], "left")[
            0
        ]
        c3 = quintic_coefficients(gap, (u[:-1], law[0], law[1]), (u[1:], end_law[0], end_law[1]))[3]
        off = np.abs(6.0 * c3 - law[2]) - _rounding(t[1:], u, law[0], gap)[2]
        coarse = (off * per_jerk > _JERK_ERROR) | (0.009 * off * gap**2 * per_feed > _FEED_ERROR * states[1].max())
        if not coarse.any():
            break
        of, since = np.append(of, of[coarse]), np.append(since, (since + 0.5 * gap)[coarse])
        known = np.append(known, np.full(int(coarse.sum()), np.nan))
    jump = np.abs(end_law[:2, :-1] - law[:2, 1:]) > _STRAIGHT * np.abs(law[:2]).max(axis=1, keepdims=True)
    at = np.flatnonzero(jump.any(axis=0)) + 1
    rates = [np.insert(np.append(law[k], end_law[k, -1]), at, end_law[k, at - 1]) for k in (0, 1)]
    return np.insert(t, at, t[at]), np.insert(u, at, u[at]), rates[0], rates[1]


def _crossings(
    begin: FloatArray, jerk: FloatArray, h: FloatArray, s: FloatArray, near: float
) -> tuple[IntArray, FloatArray]:
    """Phase in which each place s is passed, and the time since its start (bisection; 0 where they coincide)."""
    phase = np.clip(np.searchsorted(begin[0], s + near, side="right") - 1, 0, h.size - 1)
    lo, hi = np.zeros(s.size), h[phase]
    for _ in range(60):
        middle = 0.5 * (lo + hi)
        short = advance_phase(begin[:, phase], jerk[phase], middle)[0] < s
        lo, hi = np.where(short, middle, lo), np.where(short, hi, middle)
    return phase, np.where(np.abs(s - begin[0, phase]) <= near, 0.0, 0.5 * (lo + hi))


def _rates_of_u(
    curve: Curve, limits: Limits, u: FloatArray, state: FloatArray, jerk: FloatArray, side: Side
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """First three time derivatives (3, n) of u; what a unit of them is of the jerk limits (n,), and of feed (n,)."""
    t, _, _, *speeds = arc_derivatives_of_axes(curve, u, side)
    speed, slope, bend = speeds
    rates = np.stack(rates_of_parameter((speed, slope, bend), state[1], state[2], jerk))
    return rates, (np.abs(t) / limits.jerk).max(axis=1) * speed, speed


def _rounding(t: FloatArray, u: FloatArray, rate: FloatArray, gap: FloatArray) -> FloatArray:
    """What the last digits of u (found from s by inversion) and of t do to a quintic's derivatives 1, 2, 3: (3, n)."""
    digit = _DIGITS * (np.abs(u).max() + rate * t)
    return np.asarray(_DIGITS_OF_ORDER * digit / gap ** np.array([[1.0], [2.0], [3.0]]))


def used_exactly(curve: Curve, limits: Limits, nodes: LawColumns) -> tuple[FloatArray, FloatArray]:
    """Measure a time law on the exact curve, in each interval between its nodes.

    Returns
    -------
    used : (n - 1,) array
        Largest share of any limit used, but for rounding.
    noise : (n - 1,) array
        Share of the jerk limits that rounding of the nodes amounts to.
    """
    t, u, rate, acceleration = nodes
    i = np.flatnonzero(np.diff(t) > 0.0)
    gap = np.diff(t)[i]
    c = quintic_coefficients(gap, (u[i], rate[i], acceleration[i]), (u[i + 1], rate[i + 1], acceleration[i + 1]))
    w = np.linspace(0.0, 1.0, _CHECK_POINTS)[:, None] * gap
    value = c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))))
    rates = np.stack(
        [
            c[1] + w * (2.0 * c[2] + w * (3.0 * c[3] + w * (4.0 * c[4] + w * 5.0 * c[5]))),
            2.0 * c[2] + w * (6.0 * c[3] + w * (12.0 * c[4] + w * 20.0 * c[5])),
            6.0 * c[3] + w * (24.0 * c[4] + w * 60.0 * c[5]),
        ]
    )
    noise = _rounding(t[i + 1], u, rate[i], gap)
    rates -= np.clip(rates, -noise[:, None], noise[:, None])
    value = np.clip(value, u[i], u[i + 1])
    steps, jerk = _steps(curve, limits, nodes, t[i] + w)
    law = value[:-1].reshape(-1), *rates[:, :-1].reshape(3, -1)
    end_law = value[-1], *rates[:, -1]
    share = _shares(curve, limits, law, jerk[:-1].reshape(-1, 1), "right").reshape(-1, i.size)
    share = np.append(share, _shares(curve, limits, end_law, jerk[-1, :, None], "left")[None], axis=0)
    used, noisy = np.zeros(t.size - 1), np.zeros(t.size - 1)
    used[i] = _peaks(share, jerk)
    noisy[i] = noise[2] * (np.abs(curve.derivatives(u[i], 1)[1]) / limits.jerk).max(axis=1)
    return np.maximum(used, steps), noisy


def _peaks(y: FloatArray, allowed: FloatArray) -> FloatArray:
    """Largest of equidistant values (k, n) along the first axis, and of the parabolas through three of them.

    No parabola spans a change of what is allowed.
    """
    slope, bend = y[2:] - y[:-2], y[2:] - 2.0 * y[1:-1] + y[:-2]
    inside = (np.abs(slope) < -2.0 * bend) & (allowed[2:] == allowed[:-2])
    top = y[1:-1] - np.divide(slope**2, 8.0 * bend, out=np.zeros_like(bend), where=inside)
    return np.asarray(np.maximum(y.max(axis=0), top.max(axis=0)))


def _shares(
    curve: Curve, limits: Limits, law: tuple[FloatArray, ...], jerk_share: FloatArray, side: Side
) -> FloatArray:
    """Largest share of any limit used at points (m,) of a time law."""
    q = curve.derivatives(law[0], 3, side=side)
    v, a, j = (part[:, None] for part in law[1:])
    tip = q if curve.tip is curve else curve.tip.derivatives(law[0], 3, side=side)
    feed, along, along_jerk = rates_along(tip, law[1], law[2], law[3])
    commanded = commanded_feed(curve, limits, law[0], side == "left")
    cap = np.minimum(commanded, chord_feed_limit(curvature(tip), limits))
    allowed = limits.velocity, limits.acceleration, limits.jerk * jerk_share
    motion = chain_rule(q[1], q[2], q[3], v, a, j)
    of_axes = [np.abs(values) / bound for values, bound in zip(motion, allowed, strict=True)]
    of_tip = [feed / cap, np.abs(along) / limits.tangential_acceleration, np.abs(along_jerk) / limits.tangential_jerk]
    return np.asarray(np.concatenate([*of_axes, np.stack(of_tip, axis=1)], axis=1).max(axis=1))


def _steps(curve: Curve, limits: Limits, nodes: LawColumns, when: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share used of the acceleration step allowed, for the interval after each node; share of the jerk allowed at times."""
    t, u, rate, acceleration = nodes
    jumps = [b.u for b in curve.breaks if b.is_curvature_jump and u[0] < b.u < u[-1]]
    at, window = np.flatnonzero(np.isin(u, jumps)), PERIODS_AROUND_STEP * limits.period
    # the node before and the node after a jump, which may be one
    left, right = at[u[at - 1] != u[at]], at[u[at + 1] != u[at]]
    before, after = (curve.derivatives(u[i], 2, side=side)[1:] for i, side in zip((left, right), _SIDES, strict=True))
    v0, v1, a0, a1 = rate[left, None], rate[right, None], acceleration[left, None], acceleration[right, None]
    step = np.abs(after[1] * v1**2 + after[0] * a1 - before[1] * v0**2 - before[0] * a0)
    total, when_passed = np.append(np.zeros((1, curve.dim)), np.cumsum(step, axis=0), axis=0), t[left]
    first, last = (np.searchsorted(when_passed, when_passed + side * window) for side in (-1.0, 1.0))
    used = np.zeros(t.size - 1)
    used[right] = ((total[last] - total[first]) / (STEP_SHARE * limits.jerk * limits.period)).max(axis=1, initial=0.0)
    near = np.searchsorted(when_passed, when + window, side="right") > np.searchsorted(when_passed, when - window)
    return used, np.where(near, JERK_BESIDE_STEP, 1.0)
