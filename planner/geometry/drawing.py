"""Curves out of drawings (DXF) and out of measured or computed points (CSV).

A drawing's lines, arcs and splines are all rational B-splines, so the chain of them is one, exactly: every piece is taken
apart into Bezier segments, raised to the common degree, and joined with knots as often as the degree; corners then are
corners, and tangent pieces are smooth.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import comb
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import CurveError
from planner.geometry.curve import FloatArray
from planner.geometry.inputs import positive_number, read_text, shorten
from planner.geometry.nurbs import NurbsCurve

if TYPE_CHECKING:
    from ezdxf.entities.dxfentity import DXFEntity

# Ends of neighbours lie this close; drawings are written with some 6 to 16 digits.
_JOIN_MM = 1e-3
_UNITS = {0: 1.0, 1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 13: 1e-3}  # $INSUNITS to mm; 0 is unitless
_READ = ("SPLINE", "LINE", "ARC", "CIRCLE", "LWPOLYLINE")
_LARGEST_ARC = 0.5 * np.pi  # of one Bezier segment: beyond a half turn there is none, below the speed is more even
_FIT_DEGREE = 5
_FIT_TRIALS = 12


@dataclass(frozen=True, eq=False)
class _Piece:
    """Bezier segments of one entity: homogeneous points (m, degree + 1, 4), w times X, Y, Z, and w; widths (m,)."""

    points: FloatArray
    widths: FloatArray
    label: str

    def at_start(self) -> FloatArray:
        return np.asarray(self.points[0, 0, :3] / self.points[0, 0, 3])

    def at_end(self) -> FloatArray:
        return np.asarray(self.points[-1, -1, :3] / self.points[-1, -1, 3])

    def reversed(self) -> _Piece:
        return _Piece(self.points[::-1, ::-1], self.widths[::-1], self.label)

    def raised(self, degree: int) -> FloatArray:
        """The segments with a higher degree: Q_j = sum_i C(p, i) C(r, j - i) / C(p + r, j) P_i, r the difference."""
        p = self.points.shape[1] - 1
        matrix = np.zeros((degree + 1, p + 1))
        for j in range(degree + 1):
            for i in range(max(0, j - degree + p), min(p, j) + 1):
                matrix[j, i] = comb(p, i) * comb(degree - p, j - i) / comb(degree, j)
        return np.einsum("ji,mic->mjc", matrix, self.points)


class FittedCurve(NurbsCurve):
    """A B-spline through or near given points.

    Attributes
    ----------
    deviation : float
        Largest distance of a given point from the point of the curve that stands for it, mm.
    row : int
        Line of the file that point stands in.
    """

    deviation: float
    row: int

    def __init__(
        self, control_points: ArrayLike, knots: ArrayLike, degree: int, axes: Sequence[str], name: str
    ) -> None:
        super().__init__(control_points, knots, degree, axes=axes, name=name)


def read_dxf(path: str | Path, *, layer: str | None = None) -> NurbsCurve:
    """Read a chain of SPLINE, LINE, ARC, CIRCLE and LWPOLYLINE entities from the model space of a DXF file.

    The entities may stand in any order and direction; the chain starts with the first in the file that has a free end,
    the way it is drawn, or with the first of all where the chain is closed.  Ends join within 1 um.

    Parameters
    ----------
    path : str or Path
    layer : str, optional
        Only the entities of this layer.

    Returns
    -------
    NurbsCurve
        In mm by the units of the drawing (unitless counts as mm); axes X and Y where the drawing lies at Z = 0.

    Raises
    ------
    CurveError
        If the file cannot be read, holds an entity of another type, or more than one chain.
    """
    from ezdxf.filemanagement import readfile
    from ezdxf.lldxf.const import DXFError

    file = Path(path)
    if not file.is_file():
        raise CurveError(f"{path}: cannot be read (there is no such file)")
    try:
        document = readfile(file)
    except (DXFError, OSError, UnicodeError, ValueError) as problem:
        raise CurveError(f"{path}: not a valid DXF file ({shorten(str(problem))})") from None
    code = int(document.header.get("$INSUNITS", 0))
    if code not in _UNITS:
        raise CurveError(f"{path}: $INSUNITS = {code} must be one of {', '.join(map(str, _UNITS))} (4 is mm, 1 inch)")
    pieces: list[_Piece] = []
    for entity in document.modelspace():
        if layer is None or entity.dxf.layer == layer:
            pieces.extend(_pieces_of(entity, _UNITS[code], str(path)))
    if not pieces:
        where = "the model space" if layer is None else f"layer {layer!r}"
        raise CurveError(f"{path}: {where} has no {', '.join(_READ)}")
    return _joined(_chained(pieces, str(path)), file.stem)


def _pieces_of(entity: DXFEntity, unit: float, where: str) -> Iterator[_Piece]:
    """The pieces of an entity, in mm and world coordinates."""
    kind = entity.dxftype()
    label = f"{where}: {kind} #{entity.dxf.handle}"
    if kind not in _READ:
        raise CurveError(f"{label} is not read; a chain of {', '.join(_READ)} is")
    if kind == "LINE":
        yield _line(unit * _array(entity.dxf.start), unit * _array(entity.dxf.end), label)
    elif kind == "SPLINE":
        yield _spline(entity, unit, label)
    elif kind in ("ARC", "CIRCLE"):
        first, last = (0.0, 360.0) if kind == "CIRCLE" else (entity.dxf.start_angle, entity.dxf.end_angle)
        first, sweep = np.radians(first), np.radians((last - first) % 360.0) or 2.0 * np.pi
        piece = _arc(unit * _array(entity.dxf.center), unit * entity.dxf.radius, first, sweep, label)
        yield _in_world(entity, piece)
    else:
        for piece in _polyline(entity, unit, label):
            yield _in_world(entity, piece)


def _array(point: Any) -> FloatArray:
    return np.array([float(c) for c in point], dtype=np.float64)


def _in_world(entity: Any, piece: _Piece) -> _Piece:
    """Turn from the entity's own coordinates, which an extrusion along -Z mirrors."""
    ocs = entity.ocs()
    if not ocs.transform:
        return piece
    turn = np.array([_array(ocs.to_wcs(axis)) for axis in np.eye(3)])
    points = piece.points.copy()
    points[..., :3] = points[..., :3] @ turn
    return _Piece(points, piece.widths, piece.label)


def _line(start: FloatArray, end: FloatArray, label: str) -> _Piece:
    length = float(np.linalg.norm(end - start))
    if not length > 0.0:
        raise CurveError(f"{label} has length 0")
    return _Piece(np.array([[[*start, 1.0], [*end, 1.0]]]), np.array([length]), label)


def _arc(centre: FloatArray, radius: float, first: float, sweep: float, label: str) -> _Piece:
    """A circular arc: equal rational quadratics, with the middle weight cos of half their angle."""
    count = int(np.ceil(abs(sweep) / _LARGEST_ARC - 1e-9))
    angles = first + sweep * np.arange(2 * count + 1) / (2 * count)
    weight = np.tile([1.0, np.cos(0.5 * sweep / count)], count + 1)[: angles.size]
    # The middle point lies at radius / weight: times its weight it is at the radius, as the ends are.
    spokes = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(angles.size)], axis=1)
    points = np.column_stack([spokes + weight[:, None] * centre, weight])
    rows = 2 * np.arange(count)[:, None] + np.arange(3)
    return _Piece(points[rows], np.full(count, radius * abs(sweep) / count), label)


def _polyline(entity: Any, unit: float, label: str) -> Iterator[_Piece]:
    """Lines, and arcs where the vertex has a bulge, the tangent of a quarter of the arc's angle."""
    rows = [(unit * x, unit * y, bulge) for x, y, bulge in entity.get_points("xyb")]
    height = unit * float(entity.dxf.get("elevation", 0.0))
    for k in range(len(rows) if entity.closed else len(rows) - 1):
        (x0, y0, bulge), (x1, y1, _) = rows[k], rows[(k + 1) % len(rows)]
        start, end = np.array([x0, y0, height]), np.array([x1, y1, height])
        if (start == end).all():
            continue
        place = f"{label}, vertex {k + 1}"
        if bulge == 0.0:
            yield _line(start, end, place)
            continue
        chord = end - start
        # From the middle of the chord to its left by (1 - b^2)/4b of it lies the centre.
        centre = 0.5 * (start + end) + (1.0 - bulge**2) / (4.0 * bulge) * np.array([-chord[1], chord[0], 0.0])
        arm = start - centre
        yield _arc(
            centre, float(np.hypot(arm[0], arm[1])), float(np.arctan2(arm[1], arm[0])), 4.0 * np.arctan(bulge), place
        )


def _spline(entity: Any, unit: float, label: str) -> _Piece:
    """A B-spline as Bezier segments: its power-basis pieces in the basis of Bernstein."""
    points = np.array([_array(p) for p in entity.control_points])
    if points.size == 0:
        raise CurveError(f"{label} has fit points only; export it with control points")
    weights = list(entity.weights) or None
    curve = NurbsCurve(unit * points, list(entity.knots), int(entity.dxf.degree), weights, None, label)
    power = curve.pieces.coefficients
    p = power.shape[2] - 1
    matrix = np.array([[comb(j, i) / comb(p, i) if i <= j else 0.0 for i in range(p + 1)] for j in range(p + 1)])
    return _Piece(np.einsum("ji,mci->mjc", matrix, power), np.diff(curve.pieces.breaks), label)


def _chained(pieces: list[_Piece], where: str) -> list[_Piece]:
    """Order and turn the pieces so that each starts where the one before it ends.

    Ends are numbered 2 k for the start of piece k and 2 k + 1 for its end.
    """
    from scipy.spatial import cKDTree

    points = np.array([end for piece in pieces for end in (piece.at_start(), piece.at_end())])
    found = cKDTree(points).query_ball_point(points, _JOIN_MM)
    partners = [[int(other) for other in near if other != k] for k, near in enumerate(found)]
    crowded = next((k for k, near in enumerate(partners) if len(near) > 1), None)
    if crowded is not None:
        count = len(partners[crowded]) + 1
        raise CurveError(f"{where}: {count} ends meet at {_place(points[crowded])}; a chain has two at every joint")
    # Begin at a free end, as drawn if there is such a one; a closed chain begins with the first piece.
    free = [k for k, near in enumerate(partners) if not near]
    end = min(free, key=lambda k: (k % 2, k), default=0)
    chain: list[_Piece] = []
    used = np.zeros(len(pieces), dtype=bool)
    while True:
        piece = pieces[end // 2]
        chain.append(piece if end % 2 == 0 else piece.reversed())
        used[end // 2] = True
        onward = [k for k in partners[end ^ 1] if not used[k // 2]]
        if not onward:
            break
        end = onward[0]
    if not used.all():
        others = np.repeat(~used, 2).nonzero()[0]
        distance = np.linalg.norm(points[others] - points[end ^ 1], axis=1)
        nearest = int(np.argmin(distance))
        raise CurveError(
            f"{where}: the drawing is more than one chain: the end {_place(points[end ^ 1])} of {_short(chain[-1])} lies "
            f"{distance[nearest]:.6g} mm from the nearest other, of {_short(pieces[others[nearest] // 2])}; "
            f"ends join within {_JOIN_MM} mm"
        )
    return chain


def _place(point: FloatArray) -> str:
    return f"({', '.join(f'{c:.6g}' for c in point)})"


def _short(piece: _Piece) -> str:
    return piece.label.rpartition(": ")[2]


def _joined(chain: list[_Piece], name: str) -> NurbsCurve:
    """One B-spline out of the pieces; where ends differ by a rounding, the later one gives way."""
    degree = max(piece.points.shape[1] - 1 for piece in chain)
    points: list[FloatArray] = []
    widths: list[float] = []
    for piece in chain:
        segments = piece.raised(degree)
        if points:
            segments = segments * (points[-1][-1, 3] / segments[0, 0, 3])
            segments[0, 0] = points[-1][-1]
        for segment in segments:
            points.append(segment if not points else segment.copy())
        # The parameter runs with the arc length, so that it has no needless jumps of speed.
        widths.extend((piece.widths * (_length(piece) / piece.widths.sum())).tolist())
    joined = np.concatenate([points[0], *(segment[1:] for segment in points[1:])])
    edges = np.append(0.0, np.cumsum(widths))
    knots = np.concatenate([[edges[0]], np.repeat(edges, degree), [edges[-1]]])
    weights = joined[:, 3]
    control = joined[:, :3] / weights[:, None]
    flat = bool((np.abs(control[:, 2]) <= 1e-12 * np.abs(control).max()).all())
    return NurbsCurve(control[:, :2] if flat else control, knots, degree, weights / weights[0], name=name)


def _length(piece: _Piece) -> float:
    """Length of the piece, near enough to set a parameter by: that of a polyline of 33 points a segment."""
    p = piece.points.shape[1] - 1
    w = np.linspace(0.0, 1.0, 33)
    basis = np.stack([comb(p, i) * w**i * (1.0 - w) ** (p - i) for i in range(p + 1)])
    values = np.einsum("iw,mic->mwc", basis, piece.points)
    return float(np.linalg.norm(np.diff(values[..., :3] / values[..., 3:], axis=1), axis=2).sum())


def read_points(path: str | Path, tolerance: float) -> FittedCurve:
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

    Returns
    -------
    FittedCurve
        With the deviation that was reached.

    Raises
    ------
    CurveError
        If the file cannot be read, or a line is not two or three numbers as the others are.

    References
    ----------
    P. Dierckx, Curve and Surface Fitting with Splines, Oxford University Press, 1993.
    """
    limit = positive_number(tolerance, "tolerance")
    points, lines, axes = _read_table(path)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.append(True, steps > 0.0)
    points, lines = points[keep], lines[keep]
    if points.shape[0] < 2:
        raise CurveError(f"{path}: {points.shape[0]} different points are too few; a curve needs 2")
    u = np.append(0.0, np.cumsum(steps[steps > 0.0]))
    knots, control, degree = _fit(points, u, limit)
    curve = FittedCurve(control, knots, degree, axes, Path(path).stem)
    away = np.linalg.norm(curve.derivatives(np.clip(u, *curve.domain), 0)[0] - points, axis=1)
    worst = int(np.argmax(away))
    object.__setattr__(curve, "deviation", float(away[worst]))
    object.__setattr__(curve, "row", int(lines[worst]))
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
    for fields in reader:
        cells = [field.strip() for field in fields if field.strip() or delimiter != " "]
        if not any(cells) or cells[0].startswith("#"):
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            head = tuple(cell.split("_")[0].upper() for cell in cells)
            if rows or names or not 2 <= len(head) <= 3 or head != ("X", "Y", "Z")[: len(head)]:
                raise CurveError(
                    f"{path}:{reader.line_num}: {shorten(','.join(cells))} must be 2 or 3 numbers"
                    + ("" if rows else ", or the names X, Y, Z in the first line")
                ) from None
            names = head
            continue
        wanted = len(rows[0]) if rows else len(names) or len(row)
        if len(row) != wanted or not 2 <= len(row) <= 3 or not np.isfinite(row).all():
            raise CurveError(
                f"{path}:{reader.line_num}: {shorten(','.join(cells))} must be "
                f"{wanted if rows or names else '2 or 3'} finite numbers"
            )
        rows.append(row)
        lines.append(reader.line_num)
    if not rows:
        raise CurveError(f"{path}: has no points")
    return np.array(rows), np.array(lines), ("X", "Y", "Z")[: len(rows[0])]
