"""Arc length s(u) and its inverse, to a relative error near 1e-12.

The speed |C'(u)| is interpolated on panels by Chebyshev polynomials; a panel is halved until the tail of its series is
negligible against the whole length.  Integrated term by term, the series give s(u); Newton on them gives u(s).  Because
the panels follow the curve's breaks, neither direction ever looks across a discontinuity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from planner.compiled import core
from planner.errors import CurveError, InputError
from planner.inputs import coordinates, require_side
from planner.types import FloatArray, Side

_NODES = 16
# Tail of a panel's series: integrated, against the whole length; or by itself, against the mean speed on the panel.
_TOLERANCE = 1e-14
_SERIES_TOLERANCE = 1e-13
# A tail that two halvings leave as it was is rounding noise of the speed, if it is no larger than this of the mean.
_STALL = 0.8
_MAX_NOISE = 1e-4
_PANELS_PER_PIECE = 64
_FEW_PIECES = 4096


@dataclass(frozen=True, eq=False)
class ArcLength:
    """Accumulated length along a curve: ``s(u)``, its inverse, and the total.

    Build it with :meth:`of_speed`.
    """

    edges: FloatArray
    lengths: FloatArray
    _series: FloatArray
    _speeds: FloatArray

    @classmethod
    def of_speed(cls, speed: Callable[[FloatArray], FloatArray], breaks: FloatArray, name: str) -> ArcLength:
        """Integrate any speed(u) >= 0 from the first of the ``breaks`` (k,) to the last, panels split at each.

        Raises
        ------
        CurveError
            If the speed cannot be resolved, which takes a curve that is not piecewise smooth.
        """
        lo, hi = breaks[:-1], breaks[1:]
        most = _PANELS_PER_PIECE * max(lo.size, _FEW_PIECES)
        # Tail of the panel that each was halved from, and whether that one was at the level of noise already.
        before, at_noise = np.full(lo.size, np.inf), np.zeros(lo.size, dtype=np.bool_)
        done: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        total = 0.0
        while lo.size:
            half = 0.5 * (hi - lo)
            series = _speed_series(speed, lo, hi)
            mean, tail = np.abs(series[:, 0]), np.abs(series[:, -3:]).max(axis=1)
            total = total or float(np.sum(2.0 * half * series[:, 0]))
            resolved = (tail * half <= _TOLERANCE * total) | (tail <= _SERIES_TOLERANCE * mean)
            resolved |= hi - lo <= 8.0 * np.spacing(np.maximum(np.abs(lo), np.abs(hi)))
            stalled = (tail > _STALL * before) & (tail <= _MAX_NOISE * mean)
            settled = resolved | (stalled & at_noise)
            done.append((lo[settled], hi[settled], series[settled]))
            rest = ~settled
            before, at_noise = np.tile(tail[rest], 2), np.tile(stalled[rest], 2)
            mid = 0.5 * (lo + hi)[rest]
            lo, hi = np.concatenate([lo[rest], mid]), np.concatenate([mid, hi[rest]])
            if lo.size > most:
                raise CurveError(f"{name}: arc length needs more than {most} panels; the curve is not piecewise smooth")
        return cls._assemble(done)

    @classmethod
    def _assemble(cls, done: list[tuple[FloatArray, FloatArray, FloatArray]]) -> ArcLength:
        lo = np.concatenate([item[0] for item in done])
        hi = np.concatenate([item[1] for item in done])
        series = np.concatenate([item[2] for item in done])
        order = np.argsort(lo)
        lo, hi, series = lo[order], hi[order], series[order]
        length_series = _integrals(series) * (0.5 * (hi - lo))[:, None]
        each = np.maximum(length_series.sum(axis=1), 0.0)  # T_k(1) = 1
        lengths = np.concatenate([[0.0], np.cumsum(each)])
        arrays = (np.append(lo, hi[-1]), lengths, np.ascontiguousarray(length_series), np.ascontiguousarray(series))
        for array in arrays:
            array.setflags(write=False)
        return cls(*arrays)

    @property
    def total(self) -> float:
        """Whole length."""
        return float(self.lengths[-1])

    def s(self, u: ArrayLike) -> FloatArray:
        """Arc length from the start of the curve to u (any shape).

        Raises InputError for a parameter outside the domain.
        """
        points = _within(u, self.edges[0], self.edges[-1], "u")
        out = np.empty(points.size)
        core.arclength_at(
            *self._series.shape, self.edges, self.lengths, self._series, out.size, points.reshape(-1), out
        )
        return out.reshape(points.shape)

    def speed_at(self, u: float, side: Side) -> tuple[float, float, float]:
        """Speed ds/du and its first two derivatives at an edge or inside a panel, from the side given."""
        panel = int(np.searchsorted(self.edges, u, side=side)) - 1
        panel = min(max(panel, 0), self.edges.size - 2)
        half = 0.5 * (self.edges[panel + 1] - self.edges[panel])
        x = (u - self.edges[panel]) / half - 1.0
        first, second, third = (_chebyshev(x, self._speeds.shape[1]) @ self._speeds[panel]).tolist()
        return first, second / half, third / half**2

    def u(self, s: ArrayLike, *, side: Side = "right") -> FloatArray:
        """Curve parameter at arc length s (any shape).

        ``side`` matters only where the curve rests: "right" takes the last parameter with that length, "left" the
        first.  Raises InputError for a length outside the curve.
        """
        require_side(side)
        points = _within(s, 0.0, self.total, "s")
        panels = self.edges, self.lengths, self._series, self._speeds
        return inverse_on_panels(*panels, points.reshape(-1), side).reshape(points.shape)


def inverse_on_panels(
    edges: FloatArray, lengths: FloatArray, series: FloatArray, speeds: FloatArray, s: FloatArray, side: Side = "right"
) -> FloatArray:
    """Invert the arc length at the flat array s.

    Parameters
    ----------
    edges, lengths : (m + 1,) arrays
        Of the panels: in the parameter, and lengths from the start, which give the edges exactly.
    series, speeds : (m, terms) arrays
        Chebyshev series of the length since a panel's left edge, and of the speed.
    s : (n,) array
    side : {"right", "left"}
        Whether the last or the first parameter with that length is meant, where the curve rests.
    """
    out = np.empty(s.size)
    panels = edges, lengths, series, speeds
    core.arclength_inverse(*series.shape, speeds.shape[1], *panels, s.size, s, side == "left", out)
    return out


def _speed_series(speed: Callable[[FloatArray], FloatArray], lo: FloatArray, hi: FloatArray) -> FloatArray:
    """Chebyshev series of the speed on each panel.  The nodes lie inside, so no side of a break has to be chosen."""
    angles = np.pi * (np.arange(_NODES) + 0.5) / _NODES
    to_series = np.cos(np.outer(np.arange(_NODES), angles)) * (2.0 / _NODES)
    to_series[0] *= 0.5
    at = 0.5 * (lo + hi)[:, None] + 0.5 * (hi - lo)[:, None] * np.cos(angles)
    return np.asarray(speed(at.reshape(-1)).reshape(-1, _NODES) @ to_series.T)


def _integrals(series: FloatArray) -> FloatArray:
    """Chebyshev series of the integrals from -1, one a row: of T_k, (T_{k+1}/(k+1) - T_{k-1}/(k-1)) / 2."""
    count = series.shape[1]
    above = np.pad(series, ((0, 0), (1, 0)))
    below = np.pad(series[:, 2:], ((0, 0), (0, 2)))
    above[:, 1] *= 2.0  # T_0 alone is twice what the rule says
    degree = np.arange(1, count + 1)
    integral = np.zeros_like(above)
    integral[:, 1:] = (above[:, 1:] - below) / (2.0 * degree)
    integral[:, 0] = -(integral[:, 1:] @ (-1.0) ** degree)  # nothing at -1, where T_k is (-1)^k
    return integral


def _chebyshev(x: float, count: int) -> FloatArray:
    """T_k and its first two derivatives at x, (3, count), by the recurrence T_{k+1} = 2 x T_k - T_{k-1}."""
    rows = np.zeros((3, max(count, 2)))
    rows[0, :2], rows[1, 1] = (1.0, x), 1.0
    for k in range(2, count):
        rows[:, k] = 2.0 * x * rows[:, k - 1] - rows[:, k - 2]
        rows[1:, k] += (2.0 * rows[0, k - 1], 4.0 * rows[1, k - 1])
    return rows[:, :count]


def _within(values: ArrayLike, lo: float, hi: float, what: str) -> FloatArray:
    points = coordinates(values, what)
    slack = 1e-12 * (hi - lo)
    outside = ~((points >= lo - slack) & (points <= hi + slack))
    if outside.any():
        worst = points[outside].flat[0]
        raise InputError(f"{what} = {float(worst)!r} must lie within [{float(lo)!r}, {float(hi)!r}]")
    return np.clip(points, lo, hi)
