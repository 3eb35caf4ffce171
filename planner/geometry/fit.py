"""Polynomial pieces fitted to a smooth curve, for compiled code.

Each piece interpolates the curve at Chebyshev points of the second kind, ends included, so that neighbours join.  A
piece is halved until every coordinate is within tolerance between the points, measured on the exact curve.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from planner.errors import CurveError
from planner.geometry.curve import Curve, Pieces, require_finite
from planner.types import FloatArray

_DEGREE = 9  # balances the number of pieces against the cost of a step
_TOLERANCE = 1e-13  # of the extent: 1e-11 mm on 100 mm
_ANGLE = 1.0  # rad; extents of the rotary axes count as this at least
_SCAN_POINTS = 400
_MAX_BLUR = 1e-9  # of the extent
# A corner hidden in a formula leaves an error of about a twentieth of the piece, which is seen at this depth.
_MAX_HALVINGS = 34
# An error that shrinks less than this on halving, and is no larger than this many tolerances, may be rounding.
_STALL = 0.3
_MAX_NOISE = 1e5
_SLOPE_TOLERANCE = 1e-4
_MAX_PIECES = 50_000

_NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)


def fit_pieces(curve: Curve) -> Pieces:
    """Fit polynomial pieces of degree 9 to 1e-13 of the curve's extent.

    The extent is that of the linear axes together, and of the rotary ones together.  Added is what rounding makes of
    the position, and of the parameter at the speed of the curve.  Where the evaluation itself is noisier, as near a
    vertical tool axis, a piece is accepted with that noise.

    Raises
    ------
    CurveError
        If the curve is not finite, or not smooth between its breaks.
    """
    u0, u1 = curve.domain
    corners = np.concatenate([[u0], curve._candidate_breaks(), [u1]])
    tolerance = _tolerances(curve)
    lo, hi = corners[:-1], corners[1:]
    done: list[tuple[FloatArray, FloatArray]] = []
    settled = 0
    # A feature between the probes would be missed: the first, wide pieces are probed closely.
    probes = _SCAN_POINTS // lo.size
    before = np.full(lo.size, np.inf)  # error of the piece that each was halved from
    for _ in range(_MAX_HALVINGS):
        power, error = interpolate(lambda u: curve.derivatives(u, 0)[0], lo, hi, max(probes, 2 * _DEGREE))
        # an axis that stands still has neither error nor tolerance
        excess = np.nan_to_num(error / np.maximum(tolerance, np.finfo(float).tiny), nan=np.inf)
        largest = excess.max(axis=1)
        good = largest <= 1.0
        stalled = np.flatnonzero(~good & (largest > _STALL * before) & (largest <= _MAX_NOISE))
        good[stalled] = _derivatives_agree(curve, lo[stalled], hi[stalled], power[stalled], excess[stalled] > 1.0)
        done.append((lo[good], power[good]))
        settled += int(np.count_nonzero(good))
        lo, hi, before = lo[~good], hi[~good], np.tile(largest[~good], 2)
        if lo.size == 0:
            return _join(done, u1)
        if settled + 2 * lo.size > _MAX_PIECES:
            raise CurveError(
                f"{curve.name}: more than {_MAX_PIECES} polynomial pieces are needed, most near u = {lo[0]:.9g}; "
                "the curve oscillates too fast, has a pole, or rounding hides its shape"
            )
        mid = 0.5 * (lo + hi)
        lo, hi = np.concatenate([lo, mid]), np.concatenate([mid, hi])
        probes //= 2
    raise CurveError(
        f"{curve.name}: not smooth near u = {lo[0]:.9g}; a curve must not jump, turn a corner or have a pole: "
        "split it there"
    )


def _derivatives_agree(
    curve: Curve, lo: FloatArray, hi: FloatArray, power: FloatArray, where: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Tell rounding from a corner: whether the pieces have the curve's first derivatives in the coordinates ``where``.

    An error that halving leaves as it was is one or the other.
    """
    width = (hi - lo)[:, None]
    exact = curve.derivatives(np.minimum(lo[:, None] + width * _NODES, hi[:, None]), 1)[1]
    slopes = np.arange(1, _DEGREE + 1) * _NODES[:, None] ** np.arange(_DEGREE)
    fitted = np.einsum("pi,nid->npd", slopes, power[:, 1:]) / width[:, :, None]
    apart = np.abs(fitted - exact).max(axis=1)
    return np.asarray((~where | (apart <= _SLOPE_TOLERANCE * np.abs(exact).max(axis=1))).all(axis=1))


def _tolerances(curve: Curve) -> FloatArray:
    """Largest error allowed in each coordinate, (dim,)."""
    u = np.linspace(*curve.domain, _SCAN_POINTS)
    scan = curve.derivatives(u, 3)
    require_finite(curve, u, scan)
    linear = np.array([unit == "mm" for unit in curve.axis_units])
    eps = np.finfo(np.float64).eps
    extent = np.ptp(scan[0], axis=0)
    blur = 2.0 * np.spacing(np.abs(u).max()) * np.abs(scan[1]).max(axis=0)
    if (blur > _MAX_BLUR * extent.max()).any():
        raise CurveError(
            f"{curve.name}: the digits of u do not suffice: near |u| = {np.abs(u).max():.3g} its rounding moves the "
            f"point by {blur.max():.3g}; shift the parameter towards 0, or let the curve change more slowly with it"
        )
    rounding = 8.0 * eps * np.abs(scan[0]).max(axis=0) + blur
    common = np.where(linear, np.max(extent * linear), max(float(np.max(extent * ~linear)), _ANGLE))
    noise = np.where(linear, np.max(rounding * linear), np.max(rounding * ~linear))
    least = np.finfo(np.float64).tiny  # for axes that stay at 0
    return np.asarray(np.maximum(_TOLERANCE * common + noise, least))


def interpolate(
    values: Callable[[FloatArray], FloatArray], lo: FloatArray, hi: FloatArray, probes: int
) -> tuple[FloatArray, FloatArray]:
    """Interpolate ``values`` on the pieces [lo, hi]: ascending powers (m, degree + 1, dim), largest errors (m, dim).

    ``values`` maps parameters (m, k), a row for each piece, to (m, k, dim).
    """
    w = 0.5 - 0.5 * np.cos(np.pi * (np.arange(probes) + 0.5) / probes)
    # A point computed as lo + 1.0 * width may miss hi by a rounding and fall outside the domain.
    at = np.minimum(lo[:, None] + (hi - lo)[:, None] * np.concatenate([_NODES, w]), hi[:, None])
    exact = values(at)
    with np.errstate(invalid="ignore", over="ignore"):
        # In two steps: the entries of the one matrix for both, some 1e6, would bring their rounding with them.
        series = np.einsum("ij,njd->nid", _nodes_to_series(), exact[:, : _DEGREE + 1])
        power = np.einsum("ij,njd->nid", _series_to_powers(), series)
        fitted = np.einsum("pi,nid->npd", w[:, None] ** np.arange(_DEGREE + 1), power)
        return power, np.abs(fitted - exact[:, _DEGREE + 1 :]).max(axis=1)


def _join(done: list[tuple[FloatArray, FloatArray]], end: float) -> Pieces:
    starts = np.concatenate([item[0] for item in done])
    power = np.concatenate([item[1] for item in done])
    order = np.argsort(starts)
    coefficients = np.zeros((starts.size, power.shape[2] + 1, _DEGREE + 1))
    coefficients[:, :-1] = power[order].transpose(0, 2, 1)
    coefficients[:, -1, 0] = 1.0
    resting = np.asarray(~coefficients[:, :-1, 1:].any(axis=2))
    return Pieces(np.append(starts[order], end), coefficients, False, resting, np.zeros(resting.shape))


def _nodes_to_series() -> FloatArray:
    """Matrix from the values at the nodes to the coefficients of the Chebyshev series in 2w - 1."""
    return np.asarray(np.linalg.inv(chebyshev.chebvander(2.0 * _NODES - 1.0, _DEGREE)), dtype=np.float64)


def _series_to_powers() -> FloatArray:
    """Matrix from the Chebyshev series in 2w - 1 to ascending powers of w.

    T_k(2w - 1) = sum_i (-1)^(k-i) 4^i k/(k+i) binom(k+i, 2i) w^i.
    """
    matrix = np.zeros((_DEGREE + 1, _DEGREE + 1))
    matrix[0, 0] = 1.0
    for k in range(1, _DEGREE + 1):
        for i in range(k + 1):
            matrix[i, k] = (-1) ** (k - i) * 4**i * k * comb(k + i, 2 * i) / (k + i)
    return matrix
