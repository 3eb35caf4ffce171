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
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.geometry.curve import Curve, Pieces
from planner.geometry.differential import dot
from planner.machine.limits import Limits
from planner.plan.ends import Free, Rest
from planner.plan.jumps import STEP_SEEN
from planner.plan.knots import Grid
from planner.plan.rows import path_at
from planner.plan.section import Section, axis_weights
from planner.quantity import ACCELERATION, JERK, motion_names
from planner.sets import union
from planner.types import FloatArray, IntArray

_REVERSAL_SAMPLES = 33  # of a piece

# Nodes in [0, 1] of the rule of the solver: Lobatto's, the ends moved inside, and their weights.
INSIDE = 1e-3
_ROOT = 0.5 / np.sqrt(5.0)
RULE_NODES = np.array([INSIDE, 0.5 - _ROOT, 0.5 + _ROOT, 1.0 - INSIDE])
RULE_WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0
_DIGITS = 32.0  # of u, that say nothing of a way between two knots
_HALVINGS = 6
_WAY_SAMPLES = 17  # of a cell, whose largest values the ways are sums of
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

    @cached_property
    def of(self) -> Multiplied:
        """The motions that have multipliers."""
        return Multiplied.of(self.limits, self.section.curve)

    @cached_property
    def h(self) -> FloatArray:
        """Lengths of the cells; 0 for empty ones."""
        return np.diff(self.sigma)

    @cached_property
    def full(self) -> IntArray:
        """Cells that are not empty."""
        return np.flatnonzero(self.h > 0.0)

    @cached_property
    def jumps(self) -> NDArray[np.bool_]:
        """Which cells are empty ones at a curvature jump, (n - 1,)."""
        at = np.array([b.u for b in self.section.jumps])
        return (self.h == 0.0) & np.isin(self.u[0, :-1], at)

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
        return union(cells[(rows < 0.0).any(axis=0)])

    def points(self, k: IntArray, r: FloatArray) -> Points:
        """Evaluate the path in the cells k at r (both flat), from inside the cells."""
        motions = self.rise.shape[0]
        at = Points(np.empty((motions, k.size)), np.empty((motions, k.size)), np.empty(k.size))
        core.track_points(*self.arrays, k.size, k, r, at.first, at.second, at.cap)
        return at

    @cached_property
    def arrays(self) -> tuple[object, ...]:
        """What every compiled function of a track begins with, see ``dual.h``."""
        curve, limits, none = self.section.curve, self.limits, np.empty(0)
        axes, tip, caps = curve.pieces, curve.tip.pieces, curve.feed_caps
        count, rows, terms = tip.coefficients.shape
        return (
            *(self.sigma.size - 1, self.rise.shape[0], self.sigma, self.u),
            *(len(axes.coefficients), axes.coefficients.shape[2], *_data(axes)),
            *(0 if curve.tip is curve else count, rows - 1, terms, *_data(tip)),
            *(
                (0, none, none)
                if caps is None
                else (caps.feed.size, caps.edges, caps.commanded(limits.feed, limits.rapid))
            ),
            np.array([limits.feed if caps is None else np.inf, np.inf, limits.chord_error, limits.period]),
            *(limits.velocity, limits.of_motions(ACCELERATION.order), limits.of_motions(JERK.order)),
            *(axis_weights(limits), *self.known_speeds),
            *(self.way, self.rise, self.ramps, self.near),
        )

    @cached_property
    def known_speeds(self) -> tuple[FloatArray | None, FloatArray | None]:
        """Speed of every motion at either end (K,): 0 at rest, by the feed, None where it is free."""
        return self._known_speed(0), self._known_speed(1)

    def _known_speed(self, end: int) -> FloatArray | None:
        asked = self.section.start if end == 0 else self.section.end
        if isinstance(asked, Rest):
            return np.zeros(self.rise.shape[0])
        if isinstance(asked, Free):
            return None
        curve, u = self.section.curve, self.u[0, [-end]]
        q, tip = (path.pieces.evaluate(u, 1, end == 1)[1, 0] for path in (curve, curve.tip))
        speed = np.sqrt(dot(tip, tip))
        return np.append(np.abs(q), speed) * asked.feed / speed

    def _with_ways(self) -> Track:
        """Measure the ways: sums of the largest |dq/du| at samples of each cell."""
        full, motions = self.full, self.rise.shape[0]
        nodes = np.linspace(0.0, 1.0, _WAY_SAMPLES)
        k, r = np.repeat(full, nodes.size), np.tile(nodes, full.size)
        first = np.empty((motions, k.size))
        core.track_reach(*self.arrays, k.size, k, r, first, np.empty(k.size), None)
        samples = first.reshape(motions, full.size, nodes.size)
        rise = np.zeros((motions, self.sigma.size - 1))
        rise[:, full] = np.abs(samples).max(axis=-1)
        step = rise * np.diff(self.u[0])
        way = np.zeros((2, motions, self.sigma.size))
        way[0, :, 1:] = np.cumsum(step, axis=1)
        way[1, :, :-1] = np.cumsum(step[:, ::-1], axis=1)[:, ::-1]
        low, high = np.full_like(rise, np.inf), np.full_like(rise, -np.inf)
        low[:, full], high[:, full] = samples.min(axis=-1), samples.max(axis=-1)
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
        cap, reached = np.empty(k.size), np.empty((2, k.size))
        core.track_reach(*self.arrays, k.size, k, r, np.empty((self.rise.shape[0], k.size)), cap, reached)
        near = np.zeros_like(self.near)
        near[:, full] = (reached < _NEAR * cap).reshape(2, -1, nodes.size).any(axis=2)
        return replace(self, near=near)


def _data(pieces: Pieces) -> tuple[object, ...]:
    return pieces.breaks, pieces.coefficients, pieces.rational, pieces.resting, pieces.origin


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
