"""Curves out of measured or computed points (CSV)."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import CurveError
from planner.geometry.curve import MAX_COORDINATE
from planner.geometry.nurbs import NurbsCurve
from planner.geometry.tolerance import PathTolerance
from planner.inputs import plain_number, positive_number, read_text, shorten
from planner.types import FloatArray

_FIT_DEGREE = 5
_FIT_TRIALS = 12
_NOT_FINITE = ("inf", "-inf", "nan")
_SAME = 1e-12  # of the length: steps that are lost in the parameter


class FittedCurve(NurbsCurve):
    """A B-spline through or near given points.

    Attributes
    ----------
    deviation : float
        Largest distance of a given point from the point of the curve that stands for it, mm.
    row : int
        Line of the file, or row of the array, that point stands in.
    """

    deviation: float
    row: int

    def __init__(
        self, control_points: ArrayLike, knots: ArrayLike, degree: int, axes: Sequence[str] | None, name: str
    ) -> None:
        super().__init__(control_points, knots, degree, axes=axes, name=name)


def read_points(path: str | Path, tolerance: float, *, share: float = 1.0) -> FittedCurve:
    """Fit a smooth curve to the points of a CSV file.

    A B-spline of degree 5 (its fourth derivative is continuous), smoothed by the least-squares criterion of FITPACK, with
    the fewest knots of some trials that keep every point within the tolerance; interpolated where none does.

    Parameters
    ----------
    path : str or Path
        Two or three numbers a line, X, Y and Z in mm, parted by commas, semicolons, tabs or spaces; the first line may
        name the columns.
    tolerance : float
        Largest distance of a point from the curve, mm.
    share : float
        Part of the tolerance that the curve may take; the rest is for a program written from its plan.

    Returns
    -------
    FittedCurve
        With the deviation that was reached.

    Raises
    ------
    CurveError
        If the file cannot be read, a line is not two or three numbers as the others are, or no spline keeps the tolerance.

    References
    ----------
    P. Dierckx, Curve and Surface Fitting with Splines, Oxford University Press, 1993.
    """
    limit = share * positive_number(tolerance, "tolerance")
    points, lines, axes = _read_table(path)
    curve = fit_points(points, limit, axes, Path(path).stem, str(path), lambda row: f"{path}:{lines[row]}")
    object.__setattr__(curve, "row", int(lines[curve.row]))
    object.__setattr__(curve, "made_within", PathTolerance(float(tolerance), share))
    return curve


def fit_points(
    points: FloatArray,
    tolerance: float,
    axes: Sequence[str] | None,
    name: str,
    source: str,
    place: Callable[[int], str],
) -> FittedCurve:
    """Fit a curve to points (n, dim) as :func:`read_points` does; messages name the source, and the place of a row."""
    limit = positive_number(tolerance, "tolerance")
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.append(True, steps > _SAME * steps.sum()) if points.shape[0] else np.zeros(0, dtype=bool)
    points, rows = points[keep], np.flatnonzero(keep)
    if points.shape[0] < 2:
        raise CurveError(f"{source}: {points.shape[0]} different points are too few; a curve needs 2")
    u = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    try:
        knots, control, degree = _fit(points, u, limit)
    except (np.linalg.LinAlgError, ValueError):  # the matrix of the spline is singular, or FITPACK refuses its input
        k = int(np.argmax(np.diff(u)))
        raise CurveError(
            f"{place(rows[k + 1])}: this point is {np.diff(u)[k]:.6g} mm from the one before it, where half of "
            f"all steps are below {np.median(np.diff(u)):.3g} mm: no spline keeps within {limit:g} mm of such points; is it "
            "one of them?"
        ) from None
    curve = FittedCurve(control, knots, degree, axes, name)
    away = np.linalg.norm(curve.derivatives(np.clip(u, *curve.domain), 0)[0] - points, axis=1)
    worst = int(np.argmax(away))
    if not away[worst] <= limit:
        raise CurveError(
            f"{place(rows[worst])}: the spline through the points misses this one by {away[worst]:.3g} mm; "
            f"{limit:g} mm are allowed: the points are too uneven"
        )
    object.__setattr__(curve, "deviation", float(away[worst]))
    object.__setattr__(curve, "row", int(rows[worst]))
    object.__setattr__(curve, "made_within", PathTolerance(limit))
    return curve


def _fit(points: FloatArray, u: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray, int]:
    """Knots, control points and degree of a spline within the tolerance of points at the parameters u."""
    import warnings

    from scipy.interpolate import BSpline, make_interp_spline, splprep

    degree = min(_FIT_DEGREE, points.shape[0] - 1)
    budget = points.shape[0] * tolerance**2
    for _ in range(_FIT_TRIALS):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # "s too small": then the deviation tells
            found = splprep(list(points.T), u=u, k=degree, s=budget)[0]
        knots, control = np.asarray(found[0]), np.array(found[1]).T
        if np.linalg.norm(BSpline(knots, control, degree)(u) - points, axis=1).max() <= tolerance:
            return knots, control, degree
        budget /= 4.0
    through = make_interp_spline(u, points, k=degree)
    return np.asarray(through.t), np.asarray(through.c), degree


def _read_table(path: str | Path) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Points (n, 2 or 3), their lines in the file, and the names of the axes."""
    text = read_text(path, CurveError)
    delimiter = next((c for c in ";,\t" if c in text), " ")
    rows: list[list[float]] = []
    lines: list[int] = []
    names: tuple[str, ...] = ()
    reader = csv.reader(text.splitlines(), delimiter=delimiter, skipinitialspace=True)
    for fields in _rows(reader, path):
        cells = [field.strip() for field in fields if field.strip() or delimiter != " "]
        if not any(cells) or cells[0].startswith("#"):
            continue
        row = [number for cell in cells if (number := plain_number(cell, other=_NOT_FINITE)) is not None]
        if len(row) != len(cells):
            head = tuple(cell.split("_")[0].upper() for cell in cells)
            if rows or names or not 2 <= len(head) <= 3 or head != ("X", "Y", "Z")[: len(head)]:
                raise CurveError(
                    f"{path}:{reader.line_num}: {shorten(','.join(cells))} must be 2 or 3 numbers"
                    + ("" if rows else ", or the names X, Y, Z in the first line")
                )
            names = head
            continue
        wanted = len(rows[0]) if rows else len(names) or len(row)
        if len(row) != wanted or not 2 <= len(row) <= 3 or not np.isfinite(row).all():
            raise CurveError(
                f"{path}:{reader.line_num}: {shorten(','.join(cells))} must be "
                f"{wanted if rows or names else '2 or 3'} finite numbers"
            )
        if max(map(abs, row)) > MAX_COORDINATE:
            raise CurveError(
                f"{path}:{reader.line_num}: {shorten(','.join(cells))}: coordinates must lie within "
                f"{MAX_COORDINATE:g} mm of 0"
            )
        rows.append(row)
        lines.append(reader.line_num)
    if not rows:
        raise CurveError(f"{path}: has no points")
    return np.array(rows), np.array(lines), ("X", "Y", "Z")[: len(rows[0])]


def _rows(reader: Iterator[list[str]], path: str | Path) -> Iterator[list[str]]:
    """The rows of a CSV reader, which refuses fields of more than 128 KiB and lines that end within quotes."""
    try:
        yield from reader
    except csv.Error as problem:
        raise CurveError(f"{path}: is not a list of points ({problem})") from None
