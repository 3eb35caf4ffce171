"""The path of a section as a lower bound sees it: a coordinate, derivatives of the motions over it, and caps of the speed.

A *motion* is an axis or, last, the arc length of the tool tip, which the tangential limits are about.  The coordinate
sigma is the planner's own up to its knots, and the quintic u(sigma) that takes u, u' and u'' there in between: any
increasing map is a legal coordinate, and this one is exactly what a certificate hands on.

Caps of x = sigma_dot^2: the feed, the chord error (as the feed limit of the osculating circle), the axis velocities,
and near an end with known speed v_0 what any motion reaches on its way D from there,

    v^2 <= v_0^2 + 2 A D,           v^(3/2) <= (3/sqrt 2) sqrt(J) D   from rest, while the axis keeps its direction.

The last keep x bounded at a stop, where q' vanishes in sigma.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.geometry.curve import Curve
from planner.geometry.differential import curvature, dot
from planner.machine.feed_limits import chord_feed_limit, commanded_feed
from planner.machine.limits import Limits
from planner.plan.ends import Free, Rest
from planner.plan.jumps import STEP_SEEN
from planner.plan.knots import Grid
from planner.plan.rows import path_at
from planner.plan.section import Section, axis_weights
from planner.quantity import ACCELERATION, JERK, motion_names
from planner.types import FloatArray, IntArray

_REVERSAL_SAMPLES = 33  # of a piece

# Nodes in [0, 1] of the rule of the solver: Lobatto's, the ends moved inside, and their weights.
INSIDE = 1e-3
_ROOT = 0.5 / np.sqrt(5.0)
RULE_NODES = np.array([INSIDE, 0.5 - _ROOT, 0.5 + _ROOT, 1.0 - INSIDE])
RULE_WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0
_DIGITS = 32.0  # of u, that say nothing of a way between two knots
_HALVINGS = 6
_MIN_SHARE = 0.05  # of the motions of all axes, weighted
_WAY_MARGIN, _WAY_SAMPLES = 1.01, 17  # ways are sums of the largest values at so many samples of each cell
_NEAR = 4.0  # times the other caps of x, at samples: what the ways from the ends say is no limit


@dataclass(frozen=True, eq=False)
class Multiplied:
    """The motions whose jerk and whose acceleration are limited: indices, limits, and names of the limits."""

    jerk: IntArray
    acceleration: IntArray
    most_jerk: FloatArray
    most_acceleration: FloatArray
    jerk_names: tuple[str, ...]
    acceleration_names: tuple[str, ...]

    @classmethod
    def of(cls, limits: Limits, curve: Curve) -> Multiplied:
        """Find them; the arc length of a tip that turns back has no second derivative there, and takes no part."""
        jerk, acceleration = limits.of_motions(JERK.order), limits.of_motions(ACCELERATION.order)
        if np.isfinite([jerk[-1], acceleration[-1]]).any() and _turns_back(curve):
            jerk[-1] = acceleration[-1] = np.inf
        some_j, some_a = np.flatnonzero(np.isfinite(jerk)), np.flatnonzero(np.isfinite(acceleration))
        names_j, names_a = (motion_names(q.order, curve.axes) for q in (JERK, ACCELERATION))
        return cls(
            some_j,
            some_a,
            jerk[some_j],
            acceleration[some_a],
            tuple(names_j[i] for i in some_j),
            tuple(names_a[i] for i in some_a),
        )


def _turns_back(curve: Curve) -> bool:
    """Whether the tip comes to rest and reverses within a piece of its path while a rotary axis moves on."""
    if curve.tip is curve:
        return False  # a curve has a tangent everywhere
    edges = curve.tip.pieces.breaks
    share = np.linspace(0.0, 1.0, _REVERSAL_SAMPLES)
    u = edges[:-1, None] + np.diff(edges)[:, None] * share
    left = np.broadcast_to(share == 1.0, u.shape).reshape(-1)
    velocity = curve.tip.pieces.evaluate(u.reshape(-1), 1, left)[1].reshape(*u.shape, -1)
    return bool((dot(velocity[:, 1:], velocity[:, :-1]) < 0.0).any())


@dataclass(frozen=True, eq=False)
class Points:
    """The path at points: derivatives ``first``, ``second`` (K, p) of the motions over sigma, and ``cap`` (p,) of x."""

    first: FloatArray
    second: FloatArray
    cap: FloatArray


@dataclass(frozen=True, eq=False)
class Track:
    """A section on its knots.

    Attributes
    ----------
    section : Section
    limits : Limits
    sigma : (n,) array
        Knots; equal neighbours are a double knot, no three are equal, the ends are simple.
    u : (3, n) array
        Curve parameter and its first two derivatives with respect to sigma, one-sided at double knots.
    way : (2, K, n) array
        Way of each motion from either end to each knot, or more.
    rise : (K, n - 1) array
        Largest |dq/du| of each motion in each cell.
    ramps : (2, K, n - 1) bool array
        Cells up to which a motion that rests at an end has kept its direction.
    near : (2, n - 1) bool array
        Cells in which the way from an end may limit the speed; elsewhere it is not looked at.
    """

    section: Section
    limits: Limits
    sigma: FloatArray
    u: FloatArray
    way: FloatArray
    rise: FloatArray
    ramps: NDArray[np.bool_]
    near: NDArray[np.bool_]

    @classmethod
    def on(cls, section: Section, limits: Limits, grid: Grid) -> Track:
        """Take the knots of a grid."""
        path = path_at(section, limits, grid.sigma, grid.u, grid.u >= grid.stretch_end)
        kept = _simple(grid.sigma)
        sigma, u = grid.sigma[kept], np.ascontiguousarray(path.u[:3, kept])
        double = np.flatnonzero(np.diff(sigma) == 0.0)
        u[0, double + 1] = u[0, double]
        motions, cells = section.curve.dim + 1, sigma.size - 1
        bare = cls(
            section,
            limits,
            sigma,
            u,
            np.zeros((2, motions, cells + 1)),
            np.zeros((motions, cells)),
            np.zeros((2, motions, cells), dtype=bool),
            np.ones((2, cells), dtype=bool),
        )
        return bare._with_ways()._with_near()

    @property
    def h(self) -> FloatArray:
        """Lengths of the cells; 0 for empty ones."""
        return np.diff(self.sigma)

    @property
    def full(self) -> IntArray:
        """Cells that are not empty."""
        return np.flatnonzero(self.h > 0.0)

    @property
    def jumps(self) -> NDArray[np.bool_]:
        """Which cells are empty ones at a curvature jump, (n - 1,)."""
        at = np.array([b.u for b in self.section.jumps])
        return (self.h == 0.0) & np.isin(self.u[0, :-1], at)

    def coordinate(self, k: IntArray, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Way in u from the left and to the right knot, u' and u'' in the cells k at r, by the quintic."""
        h, slope, s = self.h[k], self._slope(k), 1.0 - r
        u1 = s**4 * slope[0] + 4.0 * r * s**3 * slope[1] + 6.0 * r**2 * s**2 * slope[2]
        u1 += 4.0 * r**3 * s * slope[3] + r**4 * slope[4]
        bend = [4.0 * (b - a) for a, b in pairwise(slope)]
        u2 = s**3 * bend[0] + 3.0 * r * s**2 * bend[1] + 3.0 * r**2 * s * bend[2] + r**3 * bend[3]
        gone, left = np.zeros_like(r), np.zeros_like(r)
        sums, back, binomial = np.zeros_like(r), np.zeros_like(r), (5.0, 10.0, 10.0, 5.0, 1.0)
        for i in range(5):
            sums = sums + slope[i] / 5.0
            back = back + slope[4 - i] / 5.0
            gone += binomial[i] * sums * r ** (i + 1) * s ** (4 - i)
            left += binomial[i] * back * s ** (i + 1) * r ** (4 - i)
        return gone, left, u1 / h, u2 / h**2

    def _slope(self, k: IntArray) -> tuple[FloatArray, ...]:
        """Bernstein coefficients of du/dr in the cells k."""
        h = self.h[k]
        s0, s1 = self.u[1, k] * h, self.u[1, k + 1] * h
        b0, b1 = self.u[2, k] * h**2, self.u[2, k + 1] * h**2
        whole = self.u[0, k + 1] - self.u[0, k]
        lacking = whole - 0.5 * (s0 + s1) - (b0 - b1) / 12.0
        digits = _DIGITS * np.finfo(float).eps * np.maximum(np.abs(self.u[0, k]), np.abs(self.u[0, k + 1]))
        lacking = np.where(np.abs(lacking) <= digits, 0.0, lacking)
        middle = 0.5 * (s0 + s1) + (b0 - b1) / 6.0 + 5.0 * lacking
        return s0, s0 + b0 / 4.0, middle, s1 - b1 / 4.0, s1

    @property
    def falling(self) -> IntArray:
        """Cells in which u may fall, by the coefficients of du/dr on 64 parts of each: there sigma is no coordinate."""
        cells = self.full
        rows = np.stack(self._slope(cells))
        for _ in range(_HALVINGS):
            doubtful = (rows < 0.0).any(axis=0)
            triangle = [rows[:, doubtful]]
            while triangle[-1].shape[0] > 1:
                triangle.append(0.5 * (triangle[-1][1:] + triangle[-1][:-1]))
            before, after = np.stack([row[0] for row in triangle]), np.stack([row[-1] for row in triangle[::-1]])
            cells, rows = np.tile(cells[doubtful], 2), np.hstack([before, after])
        return np.unique(cells[(rows < 0.0).any(axis=0)])

    def points(self, k: IntArray, r: FloatArray) -> Points:
        """Evaluate the path in the cells k at r (both flat), from inside the cells."""
        gone, left, u1, u2 = self.coordinate(k, r)
        first, second, cap = self._along(k, r, gone)
        for end, gone_or_left in ((0, gone), (1, left)):
            v0 = self.known_speed(end)
            if v0 is None:
                continue
            some = np.flatnonzero(self.near[end, k] | ~np.isfinite(cap))
            cells = k[some]
            # rounding next to an end may leave less than nothing
            way = np.maximum(self.way[end][:, cells + end] + self.rise[:, cells] * gone_or_left[some], 0.0)
            reached = self._reached(first[:, some], _WAY_MARGIN * way, v0, self.ramps[end][:, cells])
            cap[some] = np.minimum(cap[some], reached)
        return Points(first * u1, second * u1**2 + first * u2, cap / u1**2)

    def known_speed(self, end: int) -> FloatArray | None:
        """Speed of every motion at an end (K,): 0 at rest, by the feed, None where it is free."""
        asked = self.section.start if end == 0 else self.section.end
        motions = self.rise.shape[0]
        if isinstance(asked, Rest):
            return np.zeros(motions)
        if isinstance(asked, Free):
            return None
        k, r = (self.full[0], 0.0) if end == 0 else (self.full[-1], 1.0)
        first, _, _ = self._along(np.array([k]), np.array([r]), np.array([0.0 if end == 0 else np.inf]))
        return np.asarray(np.abs(first[:, 0]) * asked.feed / first[-1, 0])

    def _along(self, k: IntArray, r: FloatArray, gone: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Derivatives of the motions over u, and the cap of u_dot^2 by feed, chord error and velocities."""
        curve, limits = self.section.curve, self.limits
        end = self.u[0, k + 1]
        u = np.where(r >= 1.0, end, np.minimum(self.u[0, k] + gone, end))
        left = (u >= end) & (r > 0.0)
        q = curve.pieces.evaluate(u, 2, left)
        tip = q if curve.tip is curve else curve.tip.pieces.evaluate(u, 2, left)
        speed = np.sqrt(dot(tip[1], tip[1]))
        bend = np.divide(dot(tip[1], tip[2]), speed, out=np.zeros_like(speed), where=speed > 0.0)
        feed = commanded_feed(curve, limits, u)
        if curve.feed_caps is not None:  # where it changes within a cell, the larger
            for side in (commanded_feed(curve, limits, self.u[0, k]), commanded_feed(curve, limits, end, True)):
                feed = np.maximum(feed, side)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            cap = np.where(speed > 0.0, np.minimum(feed, chord_feed_limit(curvature(tip), limits)) / speed, np.inf)
            cap = np.fmin(cap, np.fmin.reduce(limits.velocity / np.abs(q[1]), axis=1))
        return np.vstack([q[1].T, speed]), np.vstack([q[2].T, bend]), cap**2

    def _reached(self, first: FloatArray, way: FloatArray, v0: FloatArray, ramps: NDArray[np.bool_]) -> FloatArray:
        """Largest u_dot^2 that the motions reach on their ways."""
        limits = self.limits
        # A motion that hardly takes part says little, and rounding could be all there is of its way.
        share = np.abs(first[:-1]) * axis_weights(limits)[:, None]
        first = np.vstack([np.where(share >= _MIN_SHARE * share.max(axis=0), first[:-1], 0.0), first[-1:]])
        acceleration = limits.of_motions(ACCELERATION.order)[:, None]
        jerk = limits.of_motions(JERK.order)[:, None]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            by_acceleration = (v0[:, None] ** 2 + 2.0 * acceleration * way) / first**2
            by_jerk = np.where(ramps, np.cbrt(1.5 * np.sqrt(2.0 * jerk) * way) ** 4 / first**2, np.inf)
        return np.fmin.reduce(np.fmin(by_acceleration, by_jerk), axis=0)

    def _with_ways(self) -> Track:
        """Measure the ways: sums of the largest |dq/du| at samples of each cell."""
        full, motions = self.full, self.rise.shape[0]
        nodes = np.linspace(0.0, 1.0, _WAY_SAMPLES)
        k, r = np.repeat(full, nodes.size), np.tile(nodes, full.size)
        gone = self.coordinate(k, r)[0]
        first = self._along(k, r, gone)[0].reshape(motions, full.size, nodes.size)
        rise = np.zeros((motions, self.sigma.size - 1))
        rise[:, full] = np.abs(first).max(axis=-1)
        step = rise * np.diff(self.u[0])
        way = np.zeros((2, motions, self.sigma.size))
        way[0, :, 1:] = np.cumsum(step, axis=1)
        way[1, :, :-1] = np.cumsum(step[:, ::-1], axis=1)[:, ::-1]
        low, high = np.full_like(rise, np.inf), np.full_like(rise, -np.inf)
        low[:, full], high[:, full] = first.min(axis=-1), first.max(axis=-1)
        ramps = np.zeros((2, *rise.shape), dtype=bool)
        jumps = np.array([b.u for b in self.section.jumps])
        before = self.u[0, 1:] <= jumps.min(initial=np.inf)
        after = self.u[0, :-1] >= jumps.max(initial=-np.inf)
        forward = _kept(low, high)
        backward = _kept(low[:, ::-1], high[:, ::-1])[:, ::-1]
        ramps[0] = forward & before & isinstance(self.section.start, Rest)
        ramps[1] = backward & after & isinstance(self.section.end, Rest)
        return replace(self, way=way, rise=rise, ramps=ramps)

    def _with_near(self) -> Track:
        """Tell where the ways from the ends limit the speed, or nearly so: a cap left out is no error, only weaker."""
        full, nodes = self.full, RULE_NODES
        k, r = np.repeat(full, nodes.size), np.tile(nodes, full.size)
        gone, left, _, _ = self.coordinate(k, r)
        first, _, cap = self._along(k, r, gone)
        near = np.zeros_like(self.near)
        for end, gone_or_left in ((0, gone), (1, left)):
            v0 = self.known_speed(end)
            if v0 is not None:
                way = np.maximum(self.way[end][:, k + end] + self.rise[:, k] * gone_or_left, 0.0)
                reached = self._reached(first, way, v0, self.ramps[end][:, k])
                near[end, full] = (reached < _NEAR * cap).reshape(-1, nodes.size).any(axis=1)
        return replace(self, near=near)


def largest_steps(limits: Limits) -> FloatArray:
    """Largest step of each axis' acceleration that a check grants, (dim,): one of D is seen as the jerk 0.75 D / T."""
    return np.minimum(limits.jerk * limits.period / STEP_SEEN, 2.0 * limits.acceleration)


def jump_cap(limits: Limits, before: Points, after: Points) -> FloatArray:
    """Largest x (k,) at curvature jumps, any step of the acceleration along the path being allowed for.

    The axes' accelerations step by D_j = [q_j''] x + q_j' a; without a, for each pair of axes,
    |[q_i''] q_j' - [q_j''] q_i'| x <= |D_i q_j'| + |D_j q_i'|.
    """
    largest, dim = largest_steps(limits), limits.dim
    slope, step = np.abs(before.first[:dim]), after.second[:dim] - before.second[:dim]
    cap = np.full(slope.shape[1], np.inf)
    for i in range(dim):
        for j in range(i):
            cross = np.abs(step[i] * before.first[j] - step[j] * before.first[i])
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                both = np.where(slope[j] > 0.0, largest[i] * slope[j], 0.0)
                both += np.where(slope[i] > 0.0, largest[j] * slope[i], 0.0)
                cap = np.fmin(cap, both / cross)
    return cap


def _kept(low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """Up to which cell each motion keeps its direction."""
    up = np.logical_and.accumulate(low > 0.0, axis=1)
    return np.asarray(up | np.logical_and.accumulate(high < 0.0, axis=1))


def _simple(sigma: FloatArray) -> NDArray[np.bool_]:
    """Knots to keep, so that no three are equal and the ends are simple."""
    equal = np.diff(sigma) == 0.0
    kept = np.ones(sigma.size, dtype=bool)
    kept[1:-1] = ~(equal[1:] & equal[:-1])
    edge = np.flatnonzero(~equal)
    kept[: edge[0]] = False
    kept[edge[-1] + 2 :] = False
    kept[[edge[0], edge[-1] + 1]] = True
    return kept
