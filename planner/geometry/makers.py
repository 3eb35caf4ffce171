"""Curves out of what a script has: control points, expressions, splines of scipy, arrays of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import CurveError
from planner.geometry.formula import FormulaCurve, parse_constant
from planner.geometry.nurbs import NurbsCurve
from planner.geometry.points import FittedCurve, fit_points
from planner.inputs import numbers
from planner.types import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly

# Of the size of the coordinates: by so much two pieces of a polynomial may miss each other and still be joined.
_JOINED = 1e-12


def nurbs(
    degree: int,
    control_points: ArrayLike,
    knots: ArrayLike,
    weights: ArrayLike | None = None,
    axes: Sequence[str] | None = None,
    *,
    name: str = "nurbs",
) -> NurbsCurve:
    """Make a (rational) B-spline curve.

    Parameters
    ----------
    degree : int
    control_points : (n, dim) array_like
        2 to 6 axes, mm; rad for A, B and C.
    knots : (n + degree + 1,) array_like
        Non-decreasing; an interior knot at most ``degree`` times.
    weights : (n,) array_like, optional
        Positive; 1 if left out.
    axes : sequence of str, optional
        Names; X, Y, Z, U, V, W if left out.
    name : str
        For messages and pictures.

    Raises
    ------
    CurveError
        For a malformed definition, a curve of length 0, or a cusp.
    """
    return NurbsCurve(control_points, knots, degree, weights, axes, name)


def formula(
    expressions: Mapping[str, str],
    u_range: tuple[float | str, float | str],
    *,
    parameter: str = "u",
    scale: float = 1.0,
    name: str = "formula",
) -> FormulaCurve:
    """Make a curve of one expression an axis, as ``formula({"X": "30*cos(u)", "Y": "20*sin(u)"}, (0, "2*pi"))``.

    Parameters
    ----------
    expressions : mapping of axis name to expression
        2 to 6 axes; numbers, the parameter, ``pi``, ``e``, ``+ - * / **`` and functions.  Nothing is executed as Python.
    u_range : pair of float or expression
        Ends of the parameter, increasing.
    parameter : str
        Its name in the expressions.
    scale : float
        Multiplies the linear axes.
    name : str
        For messages and pictures.

    Raises
    ------
    CurveError
        If an expression is not one, or the curve is not finite, not smooth, or has a cusp.
    """
    if not isinstance(u_range, Sequence) or isinstance(u_range, str) or len(u_range) != 2:
        raise CurveError(f"{name}: u_range = {u_range!r} must be a pair: the ends of the parameter")
    first, last = (parse_constant(end, f"{name}: u_range[{k}]") for k, end in enumerate(u_range))
    return FormulaCurve(expressions, (first, last), parameter, scale, name)


def from_spline(spline: BSpline | PPoly, axes: Sequence[str] | None = None, *, name: str = "spline") -> NurbsCurve:
    """Take over a spline of scipy, exact but for rounding.

    Parameters
    ----------
    spline : scipy.interpolate.BSpline or PPoly
        Vector-valued, (dim,) of 2 to 6 axes, mm (rad for A, B and C): what ``make_interp_spline`` or ``make_lsq_spline``
        give, and ``CubicSpline``, ``PchipInterpolator`` or ``Akima1DInterpolator``.  Its parameter becomes the curve's.
    axes : sequence of str, optional
        Names; X, Y, Z, U, V, W if left out.
    name : str
        For messages and pictures.

    Returns
    -------
    NurbsCurve
        On [t[k], t[n]] of a B-spline, [x[0], x[-1]] of a piecewise polynomial.

    Raises
    ------
    CurveError
        If it is no such spline, is not continuous, or is not a curve: of length 0, or with a cusp.
    """
    from scipy.interpolate import BSpline, PPoly

    if isinstance(spline, BSpline):
        control = _vectors(spline.c, name)[: len(spline.t) - spline.k - 1]
        return NurbsCurve(control, spline.t, int(spline.k), None, axes, name)
    if isinstance(spline, PPoly):
        return _from_pieces(np.asarray(spline.x), np.asarray(spline.c), axes, name)
    raise CurveError(f"{name}: a {type(spline).__name__} must be a BSpline or PPoly of scipy.interpolate")


def from_points(
    points: ArrayLike, tolerance: float, axes: Sequence[str] | None = None, *, name: str = "points"
) -> FittedCurve:
    """Fit a smooth curve to points, as :func:`~planner.geometry.points.read_points` does to those of a file.

    Parameters
    ----------
    points : (n, 2) or (n, 3) array_like
        In the order of the path, mm.
    tolerance : float
        Largest distance of a point from the curve, mm.
    axes : sequence of str, optional
        Names of the linear axes; X, Y, Z if left out.
    name : str
        For messages and pictures.

    Returns
    -------
    FittedCurve
        With the ``deviation`` that was reached, mm, and the ``row`` of the array where.

    Raises
    ------
    CurveError
        If the array is of another shape, not finite, has fewer than 2 different points, or no spline keeps the tolerance.
    """
    values = _finite(numbers(points, f"{name}: points", CurveError), f"{name}: points")
    if values.ndim != 2 or values.shape[1] not in (2, 3):
        raise CurveError(f"{name}: points has the shape {values.shape}; it must be (n, 2) or (n, 3)")
    return fit_points(values, tolerance, axes, name, name, lambda row: f"{name}: points[{row}]")


def _from_pieces(x: FloatArray, c: FloatArray, axes: Sequence[str] | None, name: str) -> NurbsCurve:
    """Join polynomials in powers of u - x_i, c (k + 1, m, dim), highest first, into a B-spline of knots as often as k.

    On a piece of width h the Bernstein coefficients are b_j = sum_{i <= j} C(j, i) / C(k, i) a_i h^i, with a_i that of the
    i-th power; where two pieces meet, b_k of one is b_0 of the next.
    """
    from scipy.special import comb

    ascending = _vectors(np.moveaxis(c[::-1], 0, 1), name, dim=3)  # (m, k + 1, dim)
    order, dim = ascending.shape[1:]
    if order < 2:
        raise CurveError(f"{name}: a spline of degree 0 is no curve")
    if (np.diff(x) <= 0.0).any():
        raise CurveError(f"{name}: its breakpoints fall; they must increase")
    degree = order - 1
    j, i = np.meshgrid(np.arange(order), np.arange(order), indexing="ij")
    scaled = ascending * np.diff(x)[:, None, None] ** np.arange(order)[:, None]
    bernstein = np.einsum("ji,mid->mjd", comb(j, i) / comb(degree, i), scaled)
    gap = np.abs(bernstein[1:, 0] - bernstein[:-1, -1])
    if (gap > _JOINED * np.abs(bernstein).max()).any():
        row = int(np.argmax(gap.max(axis=1)))
        raise CurveError(
            f"{name}: jumps by {gap[row].max():.3g} at u = {float(x[row + 1])!r}; a path must be continuous"
        )
    control = np.concatenate([bernstein[:, :-1].reshape(-1, dim), bernstein[-1:, -1]])
    knots = np.concatenate([[x[0]], np.repeat(x, degree), [x[-1]]])
    return NurbsCurve(control, knots, degree, None, axes, name)


def _vectors(values: ArrayLike, name: str, dim: int = 2) -> FloatArray:
    array = numbers(values, f"{name}: coefficients", CurveError)
    if array.ndim != dim:
        shape = array.shape[dim - 1 :]
        raise CurveError(
            f"{name}: the values of the spline have the shape {shape}; they must be vectors of 2 to 6 axes"
        )
    return array


def _finite(array: FloatArray, what: str) -> FloatArray:
    if not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0])
        raise CurveError(f"{what}[{row}] = {array[row].tolist()} must be finite")
    return array
