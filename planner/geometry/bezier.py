"""Rational Bezier curves, each by the length along it: what the splines of a part program are made of.

A curve is a ratio of polynomials over w in [0, 1],

    C(w) = start + N(w) / D(w),   N(0) = 0,   D > 0,

kept as it was written: nothing is fitted to it.  By its length s it is C(w(s)), and only w(s) is tabulated, so that every
point lies on the curve, and the derivatives over s follow from those over w by the chain rule.

Arc length.  |C'| has branch points where C'.C' = 0, beside the real axis.  A curve is halved until 64 Chebyshev nodes
resolve its speed to rounding; ``tabulate_inverse`` then makes the inverse, as for blends, by panels of 12 terms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import CurveError
from planner.geometry.differential import curvature, norm
from planner.types import BoolArray, FloatArray, IntArray

_NODES = 64
SHARE_TERMS = 12  # of a panel of an inverse
_MAX_PANELS = 4096
_RESOLVED = 1e-14  # tail of the series of the speed, against its mean
_MAX_HALVINGS = 30  # a radius of 1e-6 mm on a curve of 10 m takes 18
_MAX_PARTS = 64  # of a curve that are not resolved at once: near a cusp there are two
_SAMPLES = 17
_STRAIGHT = 1e8  # b of tau = b sinh(x asinh(1/b)), with which tau is x to rounding


def tabulate_inverse(lengths: FloatArray, speeds: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Tabulate the inverse of arc lengths: tau = b sinh(x asinh(1/b)) over the share of the length.

    Parameters
    ----------
    lengths, speeds : (k, m) and (k, n) arrays
        Chebyshev series over x in [-1, 1] of the length from the start, and of its derivative.
    b : (k,) array

    Returns
    -------
    edges, series, first : arrays
        Edges of the panels, one more than panels for each row; Chebyshev series (panels, 12); first panel of each row,
        (k + 1,).

    Raises
    ------
    CurveError
        If an inverse needs too many panels.
    """
    edges, series, first = [np.empty(0)], [np.empty((0, SHARE_TERMS))], [0]
    room = np.empty(_MAX_PANELS + 1), np.empty((_MAX_PANELS, SHARE_TERMS))
    for length, speed, half_angle in zip(lengths, speeds, b, strict=True):
        panels = core.blend_tabulate(length.size, length, speed.size, speed, half_angle, _MAX_PANELS, *room)
        if panels < 0:
            raise CurveError(f"an arc length has no inverse within {_MAX_PANELS} panels")
        edges.append(room[0][: panels + 1].copy())
        series.append(room[1][:panels].copy())
        first.append(first[-1] + panels)
    return np.concatenate(edges), np.concatenate(series), np.array(first, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class LengthSeries:
    """Chebyshev series (k, n) over 2 w - 1 of the length of curves and of their speed, and the inverse made of them."""

    lengths: FloatArray
    speeds: FloatArray

    @cached_property
    def inverse(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """As :func:`tabulate_inverse` gives it."""
        return tabulate_inverse(self.lengths, self.speeds, np.full(self.lengths.shape[0], _STRAIGHT))


@dataclass(frozen=True, eq=False)
class Beziers:
    """Curves, k of them; build them with :meth:`of_powers`.

    Attributes
    ----------
    start : (k, dim) array
        Where each begins, mm.
    powers : (k, dim + 1, terms) array
        Ascending powers of w in [0, 1]: of the way from the start times the denominator, and of the denominator.
    length : (k,) array
        mm.
    """

    start: FloatArray
    powers: FloatArray
    length: FloatArray
    _series: LengthSeries

    @classmethod
    def of_powers(cls, start: FloatArray, powers: FloatArray) -> tuple[Beziers, NDArray[np.intp]]:
        """Make curves of powers, in halves where it takes that to resolve their speed; with them comes whose part each is.

        Near a cusp it is never resolved: look at :attr:`tightest`.
        """
        count = start.shape[0]
        parent, place = np.arange(count), np.zeros(count)
        done: list[tuple[NDArray[Any], ...]] = []
        for halving in range(_MAX_HALVINGS + 1):
            series = _speed_series(powers)
            resolved = _is_resolved(series)
            parts = np.bincount(parent[~resolved], minlength=count)
            resolved |= (parts > _MAX_PARTS)[parent] | (halving == _MAX_HALVINGS)
            done.append((parent[resolved], place[resolved], start[resolved], powers[resolved], series[resolved]))
            rest = ~resolved
            if not rest.any():
                break
            halves = [_half(start[rest], powers[rest], upper=upper) for upper in (False, True)]
            start, powers = (np.concatenate(parts) for parts in zip(*halves, strict=True))
            parent = np.tile(parent[rest], 2)
            place = np.concatenate([place[rest], place[rest] + 0.5 ** (halving + 1)])
        of, place, start, powers, speeds = (np.concatenate(column) for column in zip(*done, strict=True))
        order = np.lexsort((place, of))
        speeds = np.ascontiguousarray(speeds[order])
        lengths = np.ascontiguousarray(chebyshev.chebint(speeds, lbnd=-1, axis=1))
        beziers = cls(
            start[order], np.ascontiguousarray(powers[order]), lengths.sum(axis=1), LengthSeries(lengths, speeds)
        )
        return beziers, of[order].astype(np.intp)

    def __len__(self) -> int:
        """How many there are."""
        return int(self.length.size)

    def in_axes(self, columns: IntArray, rest: FloatArray) -> Beziers:
        """The curves in other axes: ``columns`` (n,) of their own; beyond these they rest at ``rest`` (k, n), mm."""
        own = np.flatnonzero(columns < self.start.shape[1])
        start = rest.copy()
        start[:, own] = self.start[:, columns[own]]
        powers = np.zeros((len(self), columns.size + 1, self.powers.shape[2]))
        powers[:, own], powers[:, -1] = self.powers[:, columns[own]], self.powers[:, -1]
        return replace(self, start=start, powers=powers)

    def with_columns(self, start: FloatArray) -> Beziers:
        """The curves from other starts (k, n), in n columns, of which the first are their own and the others rest."""
        powers = np.zeros((len(self), start.shape[1] + 1, self.powers.shape[2]))
        powers[:, : self.start.shape[1]], powers[:, -1] = self.powers[:, :-1], self.powers[:, -1]
        return replace(self, start=start, powers=powers)

    def taken(self, rows: NDArray[np.intp]) -> Beziers:
        """Some of the curves."""
        series = LengthSeries(
            *(np.ascontiguousarray(part[rows]) for part in (self._series.lengths, self._series.speeds))
        )
        return Beziers(self.start[rows], np.ascontiguousarray(self.powers[rows]), self.length[rows], series)

    @property
    def bow(self) -> FloatArray:
        """How far the points of every curve are from its chord, matched by their shares of either length, (k,), mm.

        At most, but for what happens between 33 of them.
        """
        share = np.linspace(0.0, 1.0, 2 * _SAMPLES - 1)
        row = np.repeat(np.arange(len(self)), share.size)
        way = self.at(row, np.outer(self.length, share).reshape(-1))[0]
        way = way.reshape(len(self), share.size, self.start.shape[1])
        return np.asarray(norm(way - share[:, None] * way[:, -1:]).max(axis=1, initial=0.0))

    def shifted(self, by: FloatArray) -> Beziers:
        """The curves moved by (k, dim), mm."""
        return replace(self, start=self.start + by)

    def joined(self, other: Beziers) -> Beziers:
        """These curves, and after them others."""
        terms = max(self.powers.shape[2], other.powers.shape[2])
        powers = [np.pad(one.powers, ((0, 0), (0, 0), (0, terms - one.powers.shape[2]))) for one in (self, other)]
        pairs = (
            (self.start, other.start), powers, (self.length, other.length), (self._series.lengths, other._series.lengths),
            (self._series.speeds, other._series.speeds),
        )  # fmt: skip
        start, joined, length, lengths, speeds = (np.concatenate(pair) for pair in pairs)
        return Beziers(start, joined, length, LengthSeries(lengths, speeds))

    def at(self, row: IntArray, s: FloatArray) -> FloatArray:
        """Way from the start of the curves ``row`` (n,) to the distances s (n,) along them, and three derivatives over s."""
        out = np.empty((4, row.size, self.start.shape[1]))
        rows, places = np.ascontiguousarray(row, dtype=np.intp), np.ascontiguousarray(s)
        core.bezier_at(self.start.shape[1], *self.arguments, row.size, rows, places, out)
        return out

    @property
    def tightest(self) -> FloatArray:
        """Smallest radius of curvature of every curve at 17 points, which its shape varies slowly between, (k,), mm.

        inf for lines; 0 where it rests or turns back, which leaves it without a tangent.
        """
        radius, _ = self._radii()
        return np.where(_is_resolved(self._series.speeds), radius.min(axis=1), 0.0)

    def tightest_point(self, row: int) -> FloatArray:
        """Where a curve has its smallest radius of curvature, (dim,), mm."""
        radius, way = self.taken(np.array([row]))._radii()
        return np.asarray(self.start[row] + way[0, int(np.argmin(radius[0]))])

    def _radii(self) -> tuple[FloatArray, FloatArray]:
        """Radii of curvature at some places of every curve, (k, 17), and the ways there from its start, (k, 17, dim)."""
        d = over_parameter(self.powers, np.linspace(0.0, 1.0, _SAMPLES))
        with np.errstate(divide="ignore"):
            return np.where(norm(d[1]) > 0.0, 1.0 / curvature(d), 0.0), d[0]

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The curves as functions of the compiled core take them."""
        edges, series, first = self._series.inverse
        return self.powers.shape[2], self.powers, self.length, first, edges, series

    def arrays(self) -> dict[str, FloatArray]:
        """Everything the curves are made of, by name."""
        series = self._series
        return {"start": self.start, "powers": self.powers, "lengths": series.lengths, "speeds": series.speeds}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, FloatArray]) -> Beziers:
        """The curves that :meth:`arrays` came from."""
        lengths = arrays["lengths"]
        return cls(arrays["start"], arrays["powers"], lengths.sum(axis=1), LengthSeries(lengths, arrays["speeds"]))

    def definition(self) -> Mapping[str, Any]:
        """What the curves are."""
        return {"start": self.start.tolist(), "powers": self.powers.tolist()}


def over_parameter(powers: FloatArray, w: FloatArray) -> FloatArray:
    """Way from the start and three derivatives, (4, k, m, dim), at w (m,) of curves with powers (k, dim + 1, terms)."""
    k, rows, terms = powers.shape
    out = np.empty((k, w.size, 4, rows - 1))
    core.bezier_over(k, rows - 1, terms, np.ascontiguousarray(powers), w.size, w, out)
    return np.moveaxis(out, 2, 0)


def _speed_series(powers: FloatArray) -> FloatArray:
    """Chebyshev series (k, 64) over 2 w - 1 of the speed over it."""
    angles = np.pi * (np.arange(_NODES) + 0.5) / _NODES
    to_series = np.cos(np.outer(np.arange(_NODES), angles)) * (2.0 / _NODES)
    to_series[0] *= 0.5
    speed = norm(over_parameter(powers, 0.5 + 0.5 * np.cos(angles))[1])
    return np.asarray(0.5 * speed @ to_series.T)


def _is_resolved(series: FloatArray) -> BoolArray:
    """Which series of a speed are complete to rounding."""
    return np.asarray(np.abs(series[:, -4:]).max(axis=1, initial=0.0) <= _RESOLVED * series[:, 0])


def _half(start: FloatArray, powers: FloatArray, *, upper: bool) -> tuple[FloatArray, FloatArray]:
    """Start and powers of the lower or the upper half of every curve."""
    terms = powers.shape[2]
    shift = np.array([[comb(j, k) if upper or j == k else 0 for j in range(terms)] for k in range(terms)], dtype=float)
    halves = powers @ (shift * 0.5 ** np.arange(terms)).T
    halves /= halves[:, -1:, :1]  # the denominator is 1 at the start
    begin = halves[:, :-1, 0].copy()
    halves[:, :-1] -= begin[:, :, None] * halves[:, -1:]
    return start + begin, halves
