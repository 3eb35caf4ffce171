"""The coordinate of a plan: the time of a previous law, in the parameter that each piece of the path has by nature.

    u  <-  v        on a piece that has a parameter of its own (a cubic blend has its tau), else v is u itself
    v  <-  sigma    a quintic on each *macro*, through v, v' and v'' of the previous law at both ends

A macro lies between two breaks of the path, or within.  Its ends are nodes of the previous law, one-sided where the
parametrisation jumps, so that position, velocity and acceleration of every axis are continuous over sigma where the law had
them so.  What is sought is how much faster or slower than that law to go: x = sigma_dot^2 is about 1 everywhere.

1.  At a stop v' = v'' = 0 makes the quintic go like sigma^3, as any start with a finite jerk does.  x stays finite and
    positive there, and velocity and acceleration vanish by themselves.
2.  The third derivative of v jumps from macro to macro, and so does x'' to make up for it: their ends are double knots.
3.  Over arc length a sharp corner's speed has a dip of some milliseconds and its third derivative a spike; over tau all axes
    are cubics, and the fastest passage is one at a constant rate.

The first law is a guess of the feed (:meth:`TimeMap.from_guess`), later ones are plans on coarser grids.

Known limitation: where a law is not increasing between its nodes there is no map; macros are then halved, and a law that
falls back for good is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import SolverError
from planner.geometry.differential import chain_rule, rates_of_parameter, speed_derivatives
from planner.law import TimeLaw, quintic_coefficients
from planner.machine.limits import Limits
from planner.plan.ends import Free, Rest
from planner.plan.guess import FeedGuess
from planner.plan.section import Section, axis_weights
from planner.sets import union
from planner.types import BoolArray, FloatArray, IntArray

_HALVINGS = 8
_CHECKED = 64  # points of a macro at which it must grow, where that is in doubt
# Row k: the Bernstein coefficients of w^k, of degree 4, on [0, 1]; a polynomial is nowhere below the least of its own.
_BERNSTEIN = np.array(
    [[1, 1, 1, 1, 1], [0, 1 / 4, 1 / 2, 3 / 4, 1], [0, 0, 1 / 6, 1 / 2, 1], [0, 0, 0, 1 / 4, 1], [0, 0, 0, 0, 1]]
)
_DIGITS = 16.0  # more than so many units in the last place is not rounding


@dataclass(frozen=True, eq=False)
class TimeMap:
    """u(sigma) on the K macros of a section.

    Attributes
    ----------
    section : Section
    sigma, u : (K + 1,) arrays
        Ends of the macros: times of the previous law, s, and curve parameters; exact on breaks.
    piece : (K,) int array
        Native piece of the curve that each lies on, or -1.
    powers : (6, K) array
        Of v in the distance from the start of each macro, ascending.
    """

    section: Section
    sigma: FloatArray
    u: FloatArray
    piece: NDArray[np.intp]
    powers: FloatArray

    @classmethod
    def through(
        cls, section: Section, sigma: FloatArray, u: FloatArray, before: FloatArray, after: FloatArray
    ) -> TimeMap:
        """The map through u (K + 1,) at sigma, with the first two derivatives ``before`` and ``after`` (2, K + 1) each."""
        curve, piece = section.curve, section.curve.native_pieces(0.5 * (u[1:] + u[:-1]))
        # the parameter that is native to a piece tells the places inside it; u follows from it to the last digit
        inner = 1 + np.flatnonzero((piece[1:] == piece[:-1]) & (piece[1:] >= 0))
        given, u = u, u.copy()
        if inner.size:
            u[inner] = curve.on_native(piece[inner], curve.native_parameter(piece[inner], u[inner]))[0]
        on = np.flatnonzero(piece >= 0)
        ends = []
        for place, rates in ((given[:-1], after[:, :-1]), (given[1:], before[:, 1:])):
            v, first, second = place.copy(), rates[0].copy(), rates[1].copy()
            if on.size:
                v[on] = curve.native_parameter(piece[on], place[on])
                speeds = curve.native_rates(curve.on_native(piece[on], v[on])[1])
                first[on] = rates[0, on] / speeds[0]
                second[on] = (rates[1, on] - speeds[1] * first[on] ** 2) / speeds[0]
            ends.append((v, first, second))
        return cls(section, sigma, u, piece, quintic_coefficients(np.diff(sigma), *ends))

    @classmethod
    def from_law(cls, section: Section, law: TimeLaw, sigma: FloatArray, *, periodic: bool = False) -> TimeMap:
        """The map through a law at its times sigma (K + 1,); where it has double nodes these must be nodes of it."""
        for _ in range(_HALVINGS):
            found = cls._through_law(section, law, sigma, periodic)
            falling = found.falls_back
            if not falling.any():
                return found
            sigma = union(sigma, 0.5 * (sigma[1:] + sigma[:-1])[falling])
        place = float(found.u[int(np.argmax(falling))])
        raise SolverError(f"the law that was found on a coarser grid falls back near u = {place:.9g}")

    @classmethod
    def _through_law(cls, section: Section, law: TimeLaw, sigma: FloatArray, periodic: bool) -> TimeMap:
        u, first, second, _ = law.at(sigma)
        sides = []
        first_at, after_last = np.searchsorted(law.t, sigma, side="left"), np.searchsorted(law.t, sigma, side="right")
        for found in (first_at, after_last - 1):
            i = np.clip(found, 0, law.t.size - 1)
            node = law.t[i] == sigma
            u = np.where(node, law.u[i], u)
            sides.append(
                np.stack([np.where(node, law.u_rate[i], first), np.where(node, law.u_acceleration[i], second)])
            )
        before, after = sides
        if periodic:
            _close(section, u, before, after)
        return cls.through(section, sigma, u, before, after)

    @classmethod
    def from_guess(cls, section: Section, limits: Limits, guess: FeedGuess, breaks: FloatArray, count: int) -> TimeMap:
        """The map of the time that a guess of the feed takes, on about ``count`` macros between the ``breaks``."""
        time = guess.time
        ends = np.concatenate([[section.u_start], breaks, [section.u_end]])
        at = np.interp(section.coordinate(ends), guess.y, time)
        at[0], at[-1] = 0.0, time[-1]
        parts = np.maximum(1, np.rint(np.diff(at) * count / time[-1])).astype(np.intp)
        t = divided(at, parts)
        for _ in range(_HALVINGS):
            u = section.parameter(np.interp(t, time, guess.y))
            u[np.searchsorted(t, at)] = ends
            found = cls._through_guess(section, limits, guess, t, u)
            falling = found.falls_back
            if not falling.any():
                return found
            t = union(t, 0.5 * (t[1:] + t[:-1])[falling])
        place = float(found.u[int(np.argmax(falling))])
        raise SolverError(f"no guess of the feed goes on steadily near u = {place:.9g}")

    @classmethod
    def _through_guess(
        cls, section: Section, limits: Limits, guess: FeedGuess, t: FloatArray, u: FloatArray
    ) -> TimeMap:
        """Cubics of the feed over time between the places u, whose slopes keep it from falling below either end."""
        feed = np.interp(t, guess.time, guess.feed)
        for end, asked in ((0, section.start), (-1, section.end)):
            if isinstance(asked, Rest):
                feed[end] = 0.0
        if isinstance(section.start, Free):
            feed[0] = feed[-1] = min(feed[0], feed[-1])
        way, h = np.diff(np.interp(t, guess.time, guess.length)), np.diff(t)
        slope = np.diff(feed) / h
        growth = np.zeros(t.size)
        both = slope[1:] * slope[:-1] > 0.0
        growth[1:-1][both] = 2.0 * slope[1:][both] * slope[:-1][both] / (slope[1:] + slope[:-1])[both]
        # the time in which such a cubic covers the way: way = h (v0 + v1) / 2 + h^2 (a0 - a1) / 12
        mean, bend = 0.5 * (feed[1:] + feed[:-1]), (growth[:-1] - growth[1:]) / 12.0
        root = np.sqrt(np.maximum(mean**2 + 4.0 * bend * way, 0.0))
        sigma = np.concatenate([[0.0], np.cumsum(2.0 * way / (mean + root))])
        weights = axis_weights(limits)
        sides = []
        for side in ("left", "right"):
            d = section.curve.derivatives(u, 3, side=side)
            sides.append(np.stack(rates_of_parameter(speed_derivatives(d * weights), feed, growth, 0.0 * feed)[:2]))
        return cls.through(section, sigma, u, *sides)

    @property
    def span(self) -> float:
        """Range [0, span] of sigma."""
        return float(self.sigma[-1])

    @property
    def falls_back(self) -> NDArray[np.bool_]:
        """Macros (K,) on which v does not grow."""
        h = np.diff(self.sigma)
        slope = self.powers[1:] * np.arange(1.0, 6.0)[:, None] * h ** np.arange(5.0)[:, None]
        doubtful = np.flatnonzero(~((_BERNSTEIN.T @ slope).min(axis=0) > 0.0))
        share = (np.arange(_CHECKED) + 0.5) / _CHECKED
        falls = np.zeros(h.size, dtype=np.bool_)
        falls[doubtful] = ~(np.einsum("kn,ks->ns", slope[:, doubtful], share ** np.arange(5.0)[:, None]) > 0.0).all(
            axis=1
        )
        return falls

    def native(self, macro: NDArray[np.intp], d: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """V and its first three derivatives at the distances d (n,) from the starts of macros (n,)."""
        c = self.powers[:, macro]
        v = c[0] + d * (c[1] + d * (c[2] + d * (c[3] + d * (c[4] + d * c[5]))))
        first = c[1] + d * (2.0 * c[2] + d * (3.0 * c[3] + d * (4.0 * c[4] + d * 5.0 * c[5])))
        second = 2.0 * c[2] + d * (6.0 * c[3] + d * (12.0 * c[4] + d * 20.0 * c[5]))
        if isinstance(self.section.end, Rest):  # at the stop itself the sums leave rounding
            stop = np.flatnonzero((macro == self.piece.size - 1) & (d >= self.sigma[-1] - self.sigma[-2]))
            first[stop] = second[stop] = 0.0
        return v, first, second, 6.0 * c[3] + d * (24.0 * c[4] + d * 60.0 * c[5])

    def along(self, sigma: FloatArray, macro: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """The path at places sigma (n,) of macros (n,).

        Returns
        -------
        u : (n,) array
        q : (4, n, dim) array
            Position of the axes and its derivatives over v, one-sided at the ends of a macro.
        rates : (3, n) array
            Derivatives of v over sigma.
        left : (n,) bool array
            Where the path is taken from the left: at the end of a macro, or so close to it that u rounds to it.
        """
        n, curve = sigma.size, self.section.curve
        path, left = np.empty((5, n)), np.empty(n, dtype=np.bool_)
        core.time_map_along(n, sigma, macro, *self.arguments, path, left)
        u, v = path[0], path[4]
        if not self.has_native:
            return u, curve.pieces.evaluate(u, 3, left), path[1:4], left
        piece = self.piece[macro]
        on = np.flatnonzero(piece >= 0)
        lo, hi = self.u[macro[on]], self.u[macro[on] + 1]
        v[on[left[on]]] = curve.native_parameter(piece[on[left[on]]], hi[left[on]])
        inside, of_blends = curve.on_native(piece[on], v[on])
        u[on] = np.where(np.isnan(u[on]), np.clip(inside, lo, hi), u[on])
        left[on] |= u[on] >= hi
        q = curve.pieces.evaluate(u, 3, left)
        q[:, on] = of_blends
        return u, q, path[1:4], left

    def parameter(self, macro: NDArray[np.intp], d: FloatArray) -> FloatArray:
        """U and its first three derivatives over sigma, (4, n), at the distances d (n,) from the starts of macros (n,)."""
        v, *rates = self.native(macro, d)
        last = d >= (self.sigma[macro + 1] - self.sigma[macro])
        found = np.stack([np.where(last, self.u[macro + 1], np.where(d <= 0.0, self.u[macro], v)), *rates])
        piece = self.piece[macro]
        on = np.flatnonzero(piece >= 0)
        if on.size:
            inside, q = self.section.curve.on_native(piece[on], v[on])
            found[0, on] = np.where(last[on] | (d[on] <= 0.0), found[0, on], inside)
            found[1:, on] = chain_rule(*self.section.curve.native_rates(q), *(rate[on] for rate in rates))
        found[0] = np.clip(found[0], self.u[macro], self.u[macro + 1])
        return found

    def follow_native(self, path: FloatArray, v: FloatArray, macro: NDArray[np.intp]) -> None:
        """Put u and its derivatives over sigma into ``path (4, n)``, in place, where it is the own parameter of a piece.

        ``path``: u where it is known, at the ends of macros, and the first three derivatives of the own parameter v (n,).
        """
        if not self.has_native:
            return
        piece = self.piece[macro]
        on = np.flatnonzero(piece >= 0)
        u, q = self.section.curve.on_native(piece[on], v[on])
        inside = np.clip(u, self.u[macro[on]], self.u[macro[on] + 1])
        path[0, on] = np.where(np.isnan(path[0, on]), inside, path[0, on])
        path[1:, on] = chain_rule(*self.section.curve.native_rates(q), *path[1:, on])

    @cached_property
    def has_native(self) -> bool:
        """Whether any piece has a parameter of its own."""
        return bool((self.piece >= 0).any())

    @property
    def arguments(self) -> tuple[Any, ...]:
        """What functions of the compiled core take of this map."""
        return self.piece.size, self.sigma, self.u, self.piece, self.powers, isinstance(self.section.end, Rest)

    @cached_property
    def beside_stops(self) -> tuple[FloatArray | None, FloatArray | None, float]:
        """Powers (6,) of the way from a stop at the start, and from one at the end; what is more than rounding of u there.

        A path that ends at u = 1 has no parameters closer to its end than 1e-16, and a plan goes there: next to a stop the
        quintic tells the distance from it in full.
        """
        section, start, end = self.section, None, None
        size = max(abs(section.u_start), abs(section.u_end), section.u_end - section.u_start)
        if isinstance(section.start, Rest) and self.piece[0] < 0:
            start = self.powers[:, 0].copy()
        if isinstance(section.end, Rest) and self.piece[-1] < 0:
            h, last = self.sigma[-1:] - self.sigma[-2:-1], np.array([self.piece.size - 1])
            ends = [self.native(last, d) for d in (h, 0.0 * h)]
            way = self.u[-1:] - self.u[-2:-1]
            end = quintic_coefficients(h, (0.0 * way, ends[0][1], -ends[0][2]), (way, ends[1][1], -ends[1][2]))[:, 0]
            end = np.ascontiguousarray(end)
        return start, end, _DIGITS * float(np.finfo(float).eps) * size


def divided(ends: FloatArray, parts: NDArray[np.intp]) -> FloatArray:
    """Cut the stretches between increasing ``ends`` (k + 1,) into so many equal parts each."""
    k = np.repeat(np.arange(parts.size), parts)
    share = (np.arange(k.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[k]
    return np.append(ends[k] + np.diff(ends)[k] * share, ends[-1])


def _close(section: Section, u: FloatArray, before: FloatArray, after: FloatArray) -> None:
    """Give the end of a periodic law the feed and acceleration of its start, in place."""
    ends = [section.curve.derivatives(u[[at]], 3, side=side) for at, side in ((0, "right"), (-1, "left"))]  # type: ignore[arg-type]
    start, end = (speed_derivatives(d) for d in ends)
    first = start[0] * after[0, 0]
    second = start[1] * after[0, 0] ** 2 + start[0] * after[1, 0]
    rates = rates_of_parameter(end, first, second, 0.0 * first)
    before[0, -1], before[1, -1] = float(rates[0][0]), float(rates[1][0])
