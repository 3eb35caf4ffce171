"""The multipliers of a certificate as functions: polynomials on the intervals between its knots.

On the interval k, with r = (sigma - sigma_k) / h_k in [0, 1], the jerk's multipliers l are quadratics and those of the
acceleration, m, are linear, both in Bernstein form; u(sigma) is the quintic that takes u, u' and u'' at both knots.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb

import numpy as np

from planner.certificate import CertificateSection
from planner.errors import InputError
from planner.types import FloatArray, IntArray
from planner.verify.sizes import EPS

# The way between two knots next to a stop may be less than the last digits of u: so many of them say nothing about it.
_DIGITS = 32.0
_HALVINGS = 8  # of an interval, to see that u increases all over it
_SLIVER = 1e-12  # of an interval: parts shorter than this are not cut off


@dataclass(frozen=True, eq=False)
class Multipliers:
    """One section's multipliers and coordinate, on the M intervals that have a length.

    Attributes
    ----------
    knot : (M,) int array
        The knot at which each interval begins.
    sigma, h : (M,) arrays
        Where it begins, and its length.
    u : (2, M) array
        Curve parameter at both ends.
    slope : (5, M) array
        Bernstein coefficients of du/dr.
    jerk : (K, 3, M) array
        Bernstein coefficients of l: one row for each axis, the last for the tip's arc length; 0 where there is none.
    acceleration : (K, 2, M) array
        m at both ends.
    """

    knot: IntArray
    sigma: FloatArray
    h: FloatArray
    u: FloatArray
    slope: FloatArray
    jerk: FloatArray
    acceleration: FloatArray

    @classmethod
    def of(cls, section: CertificateSection, jerk_rows: list[int], acceleration_rows: list[int], k: int) -> Multipliers:
        """Take a section apart; row i of its multipliers belongs to the motion ``rows[i]`` of ``k``."""
        knots = section.sigma
        step = np.diff(knots)
        some = np.flatnonzero(step > 0.0)
        h = step[some]
        before, after = np.append(0.0, step)[some], np.append(step, 0.0)[some + 1]
        first, middle, last = (section.jerk[:, some + i] for i in range(3))
        jerk = np.zeros((k, 3, some.size))
        # Exact at the ends, where an end of a closed path is compared with the other one.
        jerk[jerk_rows, 0] = np.where(before > 0.0, (h * first + before * middle) / (before + h), first)
        jerk[jerk_rows, 1] = middle
        jerk[jerk_rows, 2] = np.where(after > 0.0, (after * middle + h * last) / (h + after), last)
        acceleration = np.zeros((k, 2, some.size))
        acceleration[acceleration_rows, 0] = section.acceleration[:, some]
        acceleration[acceleration_rows, 1] = section.acceleration[:, some + 1]
        ends = section.u[:, some], section.u[:, some + 1]
        u = np.stack([ends[0][0], ends[1][0]])
        return cls(some, knots[some], h, u, _slopes(*ends, h), jerk, acceleration)

    def scaled(self, factor: float) -> Multipliers:
        """Every multiplier times one factor: the only change that leaves a bound as good as it is."""
        return replace(self, jerk=self.jerk * factor, acceleration=self.acceleration * factor)

    def coordinate(self, i: IntArray, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Curve parameter and its first two derivatives with respect to sigma, on the intervals i at r (both flat)."""
        slope, h = self.slope[:, i], self.h[i]
        way = np.cumsum(slope, axis=0) / 5.0
        u = np.clip(self.u[0, i] + bernstein(np.vstack([np.zeros_like(r), way]), r), self.u[0, i], self.u[1, i])
        bend = 4.0 * np.diff(slope, axis=0)
        return np.where(r == 1.0, self.u[1, i], u), bernstein(slope, r) / h, bernstein(bend, r) / h**2

    def jerk_at(self, i: IntArray, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Multipliers l (K, p) and their first two derivatives with respect to sigma."""
        a, b, c = (self.jerk[:, k, i] for k in range(3))
        s = 1.0 - r
        h = self.h[i]
        return (
            s * s * a + 2.0 * r * s * b + r * r * c,
            2.0 * (s * (b - a) + r * (c - b)) / h,
            2.0 * (a - 2.0 * b + c) / h**2,
        )

    def acceleration_at(self, i: IntArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Multipliers m (K, p) and their derivative with respect to sigma."""
        a, b = self.acceleration[:, 0, i], self.acceleration[:, 1, i]
        return a + (b - a) * r, (b - a) / self.h[i]

    def acceleration_price(self) -> float:
        """Integral of sum |m| over the section, s; exact."""
        a, b = self.acceleration[:, 0], self.acceleration[:, 1]
        size = np.abs(a) + np.abs(b)
        with np.errstate(over="ignore", invalid="ignore"):  # of a certificate that was changed: no bound comes of it
            crossing = np.divide(a**2 + b**2, 2.0 * size, out=np.zeros_like(size), where=size > 0.0)
            return float(np.sum(np.where(a * b < 0.0, crossing, 0.5 * size) * self.h))

    def signs_change(self) -> FloatArray:
        """Places r in (0, 1) at which an l passes 0, (2 K, M); nan where there is none."""
        a, b, c = (self.jerk[:, k] for k in range(3))
        quadratic, half = a - 2.0 * b + c, b - a
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            root = np.sqrt(half**2 - quadratic * a)
            # One root without cancellation, the other from the product of both.
            far = -(half + np.copysign(root, half))
            places = np.concatenate([far / quadratic, a / far])
        return np.where((places > 0.0) & (places < 1.0), places, np.nan)

    def largest_load(self, i: IntArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Largest sum |l| on parts [lower, upper] of the intervals i within which no l changes its sign; exact."""
        middle = 0.5 * (lower + upper)
        sign = np.sign(self.jerk_at(i, middle)[0])
        a, b, c = (np.sum(sign * self.jerk[:, k, i], axis=0) for k in range(3))
        bend = a - 2.0 * b + c
        vertex = np.divide(a - b, bend, out=lower.copy(), where=bend < 0.0)
        largest = np.zeros(i.size)
        for r in (lower, upper, np.clip(vertex, lower, upper)):
            largest = np.maximum(largest, np.abs(self.jerk_at(i, r)[0]).sum(axis=0))
        return largest

    def smallest_sizes(self, i: IntArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Smallest |l| of each motion (K,) over such parts; exact."""
        a, b, c = (self.jerk[:, k, i] for k in range(3))
        bend = a - 2.0 * b + c
        vertex = np.divide(a - b, bend, out=np.broadcast_to(lower, bend.shape).copy(), where=bend != 0.0)
        places = (np.broadcast_to(lower, bend.shape), np.broadcast_to(upper, bend.shape), np.clip(vertex, lower, upper))
        sizes = [np.abs((1.0 - r) ** 2 * a + 2.0 * r * (1.0 - r) * b + r**2 * c) for r in places]
        return np.asarray(np.min(sizes, axis=(0, 2)))

    def parts(self, extra: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Cut the intervals where an l changes its sign, and at the places ``extra (n, M)``: interval, lower, upper."""
        count = self.h.size
        places = np.concatenate([np.zeros((1, count)), self.signs_change(), extra, np.ones((1, count))])
        places = np.sort(places, axis=0).T  # nan last
        interval = np.repeat(np.arange(count), np.sum(~np.isnan(places), axis=1))
        at = places[~np.isnan(places)]
        kept = (np.diff(at, prepend=-1.0) > _SLIVER) | (at == 0.0)
        kept[np.append(np.flatnonzero(np.diff(interval)), at.size - 1)] = True
        interval, at = interval[kept], at[kept]
        same = interval[1:] == interval[:-1]
        some = np.flatnonzero(same & (np.diff(at) > 0.0))
        return interval[some], at[some], at[some + 1]


def bernstein(coefficients: FloatArray, r: FloatArray) -> FloatArray:
    """Evaluate polynomials with the Bernstein coefficients (n + 1, p) at r (p,): no cancellation where they are positive."""
    n = coefficients.shape[0] - 1
    total = coefficients[0] * (1.0 - r) ** n
    for k in range(1, n + 1):
        total = total + comb(n, k) * coefficients[k] * r**k * (1.0 - r) ** (n - k)
    return np.asarray(total)


def _slopes(start: FloatArray, end: FloatArray, h: FloatArray) -> FloatArray:
    """Bernstein coefficients (5, M) of du/dr from u, u', u'' at both ends of the intervals.

    The cubic through the derivatives alone, and a bump 30 r^2 (1 - r)^2 times what the way lacks then.  What is below
    the digits of u is not lacking.
    """
    s0, s1 = start[1] * h, end[1] * h
    b0, b1 = start[2] * h**2, end[2] * h**2
    lacking = (end[0] - start[0]) - 0.5 * (s0 + s1) - (b0 - b1) / 12.0
    digits = _DIGITS * EPS * np.maximum(np.abs(start[0]), np.abs(end[0]))
    middle = 0.5 * (s0 + s1) + (b0 - b1) / 6.0 + np.where(np.abs(lacking) <= digits, 0.0, 5.0 * lacking)
    return np.stack([s0, s0 + b0 / 4.0, middle, s1 - b1 / 4.0, s1])


def require_increasing(parts: Multipliers, where: str) -> None:
    """Raise InputError unless u increases all over every interval; u' may be 0 at an end of the section only.

    The Bernstein coefficients of du/dr bound it from below; where one is negative, the interval is halved.
    """
    rows = parts.slope
    interval = np.arange(rows.shape[1])
    still = rows[[0, -1]] == 0.0
    still[0, 0] = still[1, -1] = False
    bad = interval[still.any(axis=0)]
    for _ in range(_HALVINGS):
        doubtful = (rows < 0.0).any(axis=0)
        if bad.size or not doubtful.any():
            break
        interval = np.repeat(interval[doubtful], 2)
        triangle = [rows[:, doubtful]]
        while triangle[-1].shape[0] > 1:
            triangle.append(0.5 * (triangle[-1][1:] + triangle[-1][:-1]))
        halves = [[row[0] for row in triangle], [row[-1] for row in triangle[::-1]]]
        rows = np.moveaxis(np.array(halves), 0, -1).reshape(5, -1)
    bad = np.append(bad, interval[(rows < 0.0).any(axis=0)])
    if bad.size:
        raise InputError(
            f"{where}: the curve parameter does not increase between sigma[{parts.knot[bad[0]]}] and the next knot; "
            "u must grow with sigma"
        )
