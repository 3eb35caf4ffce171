"""The best multipliers on a track: the arrays of the primal-dual method, and the loop that keeps sum |l| below 1.

The method looks at four points of every cell.  Between them sum |l| may exceed 1, and scaling all multipliers down for
one place is dear; so where it does, l counts for more in the next round (its *margin*), and is kept below by as much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.plan.dual.method import Problem, best_multipliers
from planner.plan.dual.terms import RULE_NODES, RULE_WEIGHTS, Multiplied, Points, Track, jump_cap
from planner.plan.dual.value import Splines, normalised, seam_price, value
from planner.plan.ends import Free, Rest
from planner.plan.section import Section
from planner.sets import union
from planner.types import FloatArray, IntArray

ROUNDS = 3
_LOAD_MET, _LOAD_TOUCHED, _MARGIN = 1.0005, 1.0002, 1.0005
_LOAD_PER_GAP = 2.0
_MIN_CAP = 1e-12  # of a place, where x is about 1
_GOOD = 0.5  # of the time of the plan: caps alone prove less
_MAX_RANGE = 1e12  # of caps against the plan: beyond that a cap says nothing to the method


@dataclass(frozen=True, eq=False)
class Pace:
    """When a plan is where on a section: curve parameters ``u`` (k,), increasing, and times ``t`` (k,), s."""

    u: FloatArray
    t: FloatArray

    @property
    def duration(self) -> float:
        """Time of the section, s."""
        return float(self.t[-1] - self.t[0])

    def within(self, section: Section) -> Pace:
        """The part of it that runs along a section."""
        inside = (self.u > section.u_start) & (self.u < section.u_end)
        ends = np.array([section.u_start, section.u_end])
        t = np.interp(ends, self.u, self.t)
        return Pace(np.insert(ends, 1, self.u[inside]), np.insert(t, 1, self.t[inside]))


def best_splines(track: Track, pace: Pace, *, periodic: bool, rounds: int = ROUNDS) -> tuple[float, Splines]:
    """Find good multipliers of a section, and the bound that they prove.

    Parameters
    ----------
    track : Track
    pace : Pace
        Of a plan: where the method begins, and no work is spent on less than a small share of what the bound lies below
        its time.
    periodic : bool
    rounds : int
        Largest number of solves.

    Returns
    -------
    value : float
        s; at least what the caps of the speed alone prove.
    splines : Splines
        With sum |l| <= 1.
    """
    of = track.of
    if of.jerk.size + of.acceleration.size == 0:  # only speeds are limited, and the caps say all
        return _valued(_none(track), periodic)
    margin, start = np.ones(track.sigma.size - 1), None
    for left in range(rounds - 1, -1, -1):
        problem, (length, tau) = problem_of(track, pace, margin, periodic=periodic)
        state = best_multipliers(problem, pace.duration / tau, start)
        splines, load = normalised(_splines(track, state.theta, (length, tau), periodic))
        # Scaling costs less than the excess it removes.
        if left == 0 or load.max() <= max(_LOAD_MET, 1.0 + _LOAD_PER_GAP * (1.0 - state.time * tau / pace.duration)):
            break
        margin = np.where(load > _LOAD_TOUCHED, margin * load * _MARGIN, margin)
        start = state.waypoint
    best = _valued(splines, periodic)
    if best[0] > _GOOD * pace.duration:
        return best
    plain = _valued(_none(track), periodic)  # an evaluation more, which hardly ever pays
    return best if best[0] >= plain[0] else plain


def _valued(splines: Splines, periodic: bool) -> tuple[float, Splines]:
    seam = seam_price(splines, splines) if periodic else 0.0
    return value(splines)[0] + seam, splines


def _none(track: Track) -> Splines:
    """No multipliers: what the caps alone prove."""
    of, knots = track.of, track.sigma.size
    return Splines(track, of, np.zeros((of.jerk.size, knots + 1)), np.zeros((of.acceleration.size, knots)))


def _splines(track: Track, theta: FloatArray, units: tuple[float, float], periodic: bool) -> Splines:
    """Multipliers in the path's own units from the control values of the method; where a path closes they meet exactly."""
    of = track.of
    table = theta.reshape(-1, of.jerk.size + of.acceleration.size).T
    length, tau = units
    jerk = np.ascontiguousarray(table[: of.jerk.size])
    if periodic:
        jerk[:, -1] = jerk[:, 0]
    return Splines(track, of, jerk, np.ascontiguousarray(table[of.jerk.size :, :-1]) * (tau / length))


def problem_of(track: Track, pace: Pace, margin: FloatArray, *, periodic: bool) -> tuple[Problem, tuple[float, float]]:
    """Arrays of the method, and its units of length (of sigma) and time (s): a cell has about the length and time 1."""
    of = track.of
    jerks, width = of.jerk.size, of.jerk.size + of.acceleration.size
    full, h = track.full, track.h
    length, tau = float(track.sigma[-1]) / full.size, pace.duration / full.size
    per_x = (length / tau) ** 2
    nodes = RULE_NODES.size
    k, r = np.repeat(full, nodes), np.tile(RULE_NODES, full.size)
    at = track.points(k, r)
    # rows of g: motions over sigma / length, limits over tau
    first_j = at.first[of.jerk] * length / (of.most_jerk * tau**3)[:, None]
    second_j = at.second[of.jerk] * length**2 / (of.most_jerk * tau**3)[:, None]
    first_a = at.first[of.acceleration] * length / (of.most_acceleration * tau**2)[:, None]
    second_a = at.second[of.acceleration] * length**2 / (of.most_acceleration * tau**2)[:, None]
    basis = _quadratics(h / length, k, r)
    linear, slope = np.stack([1.0 - r, r]), 1.0 / (h[k] / length)
    rows = np.zeros((k.size, 2 * width + jerks))
    for a in range(3):
        rows[:, a * width : a * width + jerks] = 0.5 * (basis[2, a] * first_j - basis[1, a] * second_j).T
    for a, sign in ((0, -1.0), (1, 1.0)):
        rows[:, a * width + jerks : (a + 1) * width] = 0.5 * (linear[a] * second_a - sign * slope * first_a).T
    x = _squared_rate(track, pace, k, r) / per_x
    cap = np.minimum(at.cap / per_x, _MAX_RANGE * x)
    count = (track.sigma.size + 1) * width
    place = np.full(h.size, -1, dtype=np.int64)
    place[full] = np.arange(full.size)
    atoms, caps = _atoms(track, of, length, tau)
    known, fixed, seam, seam_row, seam_cap = _conditions(track, of, length, tau, periodic)
    block = full.size, nodes
    problem = Problem(
        place,
        (jerks, of.acceleration.size),
        RULE_WEIGHTS * h[full][:, None] / length,
        cap.reshape(block),
        np.minimum(x, cap).reshape(block),
        np.ascontiguousarray((basis[0] * margin[k]).reshape(3, *block).swapaxes(0, 1)),
        np.ascontiguousarray(linear.reshape(2, *block).swapaxes(0, 1)),
        rows.reshape(*block, -1),
        atoms,
        caps,
        known,
        union(fixed, np.arange(count - width + jerks, count, dtype=np.intp)).astype(np.int64),
        seam,
        seam_row,
        seam_cap,
    )
    return problem, (length, tau)


def _quadratics(h: FloatArray, k: IntArray, r: FloatArray) -> FloatArray:
    """Values, first and second derivatives (3, 3, p) of the three quadratic B-splines of the cells k at r."""
    before, after = np.append(0.0, h[:-1])[k], np.append(h[1:], 0.0)[k]
    own, s = h[k], 1.0 - r
    low, high = own / (before + own), own / (own + after)
    zero = np.zeros_like(r)
    bernstein = np.array(
        [
            [s * s, 2.0 * r * s, r * r],
            [-2.0 * s / own, (2.0 - 4.0 * r) / own, 2.0 * r / own],
            [2.0 / own**2 + zero, -4.0 / own**2 + zero, 2.0 / own**2 + zero],
        ]
    )
    b0, b1, b2 = bernstein[:, 0], bernstein[:, 1], bernstein[:, 2]
    return np.stack([low * b0, (1.0 - low) * b0 + b1 + (1.0 - high) * b2, high * b2], axis=1)


def _squared_rate(track: Track, pace: Pace, k: IntArray, r: FloatArray) -> FloatArray:
    """About the x of a plan at points, by the mean of sigma_dot over each cell: finite at rest."""
    full = track.full
    dt = np.diff(np.interp(track.u[0], pace.u, pace.t))[full]
    rate = track.h[full] / np.maximum(dt, 1e-9 * pace.duration / full.size)
    centre = 0.5 * (track.sigma[full] + track.sigma[full + 1])
    return np.asarray(np.interp(track.sigma[k] + r * track.h[k], centre, rate) ** 2)


def _pull_rows(
    track: Track, of: Multiplied, units: tuple[float, float], k: IntArray, end: int
) -> tuple[FloatArray, Points]:
    """Row (cells, local) of 1/2 sum f q' at the ends of cells in the method's units, and the path there."""
    length, tau = units
    at = track.points(k, np.full(k.size, float(end)))
    jerks, width = of.jerk.size, of.jerk.size + of.acceleration.size
    first_j = 0.5 * at.first[of.jerk] * length / (of.most_jerk * tau**3)[:, None]
    first_a = 0.5 * at.first[of.acceleration] * length / (of.most_acceleration * tau**2)[:, None]
    slope = _quadratics(track.h / length, k, np.full(k.size, float(end)))[1]
    rows = np.zeros((k.size, 2 * width + jerks))
    for a in range(3):
        rows[:, a * width : a * width + jerks] = -(slope[a] * first_j).T
    rows[:, end * width + jerks : (end + 1) * width] = first_a.T
    return rows, at


def _atoms(track: Track, of: Multiplied, length: float, tau: float) -> tuple[FloatArray, FloatArray]:
    """Rows of G, and caps, of the empty cells; 0 and 1 of the others.

    An empty cell shares its control values with both neighbours, one block less of each.
    """
    jerks, width = of.jerk.size, of.jerk.size + of.acceleration.size
    rows, caps = np.zeros((track.h.size, 2 * width + jerks)), np.ones(track.h.size)
    empty = np.flatnonzero(track.h == 0.0)
    if empty.size:
        before, at = _pull_rows(track, of, (length, tau), empty - 1, 1)
        after, beyond = _pull_rows(track, of, (length, tau), empty + 1, 0)
        # l' to the left of a double knot is of the control values k and k + 1, to its right of k + 1 and k + 2
        rows[empty, : width + jerks] += before[:, width:]
        rows[empty, width:] -= after[:, : width + jerks]
        caps[empty] = np.minimum(at.cap, beyond.cap)
        at_jump = track.jumps
        caps[at_jump] = np.minimum(caps[empty], jump_cap(track.limits, at, beyond))[at_jump[empty]]
        caps[empty] *= (tau / length) ** 2
    # A cap of 0 leaves an interior method no room; a larger one only makes its choice of multipliers a little worse.
    return rows, np.clip(caps, _MIN_CAP, 1.0 / np.finfo(float).eps)


def _conditions(
    track: Track, of: Multiplied, length: float, tau: float, periodic: bool
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray | None, float]:
    """What the ends say: known terms b, unknowns that are 0, and conditions, row of G and cap of a seam."""
    section, units = track.section, (length, tau)
    jerks, width = of.jerk.size, of.jerk.size + of.acceleration.size
    count = (track.sigma.size + 1) * width
    known, fixed = np.zeros(count), [np.empty(0, dtype=np.intp)]
    ends = []
    for end, asked in ((0, section.start), (1, section.end)):
        if isinstance(asked, Rest):  # it says nothing: q' and q_dd vanish there
            continue
        k = track.full[[0 if end == 0 else -1]]
        rows, at = _pull_rows(track, of, units, k, end)
        begin = int(k[0]) * width
        ends.append((begin, rows[0], float(at.cap[0]) * (tau / length) ** 2))
        if isinstance(asked, Free):
            continue
        x = (asked.feed / at.first[-1, 0]) ** 2
        sign = 2.0 * end - 1.0
        known[begin : begin + rows.shape[1]] += sign * rows[0] * x * (tau / length) ** 2
        outer = begin + 2 * end * width + np.arange(jerks)
        if asked.acceleration is None:
            fixed.append(outer)
            continue
        slope = (asked.acceleration - at.second[-1, 0] * x) / at.first[-1, 0]
        reached = at.second[of.jerk, 0] * x + at.first[of.jerk, 0] * slope
        known[outer] += sign * reached / of.most_jerk / tau
    seam, row = np.zeros((0, count)), None
    if periodic:
        seam, row = np.zeros((jerks, count)), np.zeros(count)
        (begin0, after, cap0), (begin1, before, cap1) = ends
        row[begin1 : begin1 + before.size] += before
        row[begin0 : begin0 + after.size] -= after
        for j in range(jerks):
            seam[j, begin0 + j], seam[j, begin1 + 2 * width + j] = 1.0, -1.0
        return known, np.concatenate(fixed), seam, row, min(cap0, cap1)
    return known, np.concatenate(fixed), seam, row, 0.0
