"""Curves out of drawings (DXF).

A drawing's lines, arcs and splines are all rational B-splines, so the chain of them is one, exactly: every piece is taken
apart into Bezier segments, raised to the common degree, and joined with knots as often as the degree; corners then are
corners, and tangent pieces are smooth.

Ends join within 1 um.  Entities that are no longer than this (slivers, zero-length lines and arcs) are absorbed by the joint
in which they lie.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from math import comb
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import CurveError
from planner.geometry.curve import MAX_COORDINATE
from planner.geometry.nurbs import NurbsCurve
from planner.inputs import require_path, shorten
from planner.types import FloatArray

# Ends of neighbours lie this close; drawings are written with some 6 to 16 digits.
_JOIN_MM = 1e-3
_UNITS = {0: 1.0, 1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 13: 1e-3}  # $INSUNITS to mm; 0 is unitless
_STRAIGHT = 1e-9  # rad: an arc that turns less is a line, to what a joint counts as smooth
# A foreign parser of damaged bytes trips over whatever it meets.
_PARSER_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    OSError,
    RuntimeError,
    StopIteration,
    TypeError,
    ValueError,
    struct.error,
)
_READ = ("SPLINE", "LINE", "ARC", "CIRCLE", "LWPOLYLINE")
_OTHERWISE = "delete it, or put the path in a drawing of its own"
_INSTEAD = {
    "INSERT": "explode the block",
    "POLYLINE": "convert it to LWPOLYLINE, or save as R2000 or later",
    "ELLIPSE": "convert it to SPLINE",
}
_MAX_ARC = 0.5 * np.pi  # of one Bezier segment: beyond a half turn there is none, below the speed is more even


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
    file = require_path(path, CurveError)
    if not file.is_file():
        raise CurveError(f"{path}: cannot be read (there is no such file)")
    drawn, unit = _drawn(file, layer)
    if not drawn:
        where = "the model space" if layer is None else f"layer {layer!r}"
        raise CurveError(f"{path}: {where} has no {', '.join(_READ)}")
    pieces = [piece for one in drawn for piece in _pieces_of(one, unit)]
    long = [piece for piece in pieces if _length(piece) > _JOIN_MM]
    if not long:
        raise CurveError(
            f"{path}: no entity is longer than {_JOIN_MM} mm, within which ends join; are the units right?"
        )
    return _joined(_chained(long, str(path)), file.stem)


_HEADER = re.compile(rb"^[ \t]*2[ \t]*\r?\n[ \t]*HEADER[ \t]*\r?$", re.MULTILINE)


@dataclass(frozen=True)
class _Drawn:
    """An entity of a drawing as plain numbers, in the units of the drawing.

    ``rows``: the ends of a line; vertices with bulge of a polyline; control points of a spline; the centre of an arc.
    ``numbers``: radius, first angle and sweep (rad) of an arc; knots and, behind them, weights of a spline.  ``turn``: the
    entity's own axes in the world, where they are not the world's.
    """

    kind: str
    label: str
    rows: FloatArray
    numbers: tuple[float, ...] = ()
    degree: int = 0
    closed: bool = False
    turn: FloatArray | None = None

    def require_sound(self, unit: float) -> _Drawn:
        """Refuse what is no number, or no number of a drawing."""
        with np.errstate(over="ignore"):
            sizes = np.abs(self.rows[:, :3]) * unit
        if not (sizes <= MAX_COORDINATE).all():
            raise CurveError(f"{self.label}: its coordinates must be finite, and lie within {MAX_COORDINATE:g} mm of 0")
        if not np.isfinite([*self.numbers, *self.rows[:, 3:].reshape(-1)]).all():
            raise CurveError(f"{self.label}: its radius, angles, bulges, knots and weights must be finite")
        if self.kind in ("ARC", "CIRCLE") and not 0.0 < self.numbers[0] * unit <= MAX_COORDINATE:
            raise CurveError(
                f"{self.label}: radius = {self.numbers[0]!r} must be > 0, and at most {MAX_COORDINATE:g} mm"
            )
        return self


def _drawn(file: Path, layer: str | None) -> tuple[list[_Drawn], float]:
    """The entities of the model space, and the unit of the drawing in mm."""
    from ezdxf.filemanagement import readfile
    from ezdxf.lldxf.const import DXFError

    try:
        document = readfile(file)
        code = int(document.header.get("$INSUNITS", 0)) if _has_header(file) else 0
        entities = [entity for entity in document.modelspace() if layer is None or entity.dxf.layer == layer]
        kinds = [(entity.dxftype(), str(entity.dxf.handle)) for entity in entities]
    except (DXFError, *_PARSER_ERRORS) as problem:
        raise CurveError(f"{file}: not a valid DXF file ({shorten(str(problem))})") from None
    if code not in _UNITS:
        raise CurveError(f"{file}: $INSUNITS = {code} must be one of {', '.join(map(str, _UNITS))} (4 is mm, 1 inch)")
    found = []
    for entity, (kind, handle) in zip(entities, kinds, strict=True):
        label = f"{file}: {kind} #{handle}"
        if kind not in _READ:
            raise CurveError(f"{label} is not read; a chain of {', '.join(_READ)} is: {_INSTEAD.get(kind, _OTHERWISE)}")
        try:
            one = _numbers_of(entity, kind, label)
        except (DXFError, *_PARSER_ERRORS) as problem:
            raise CurveError(f"{label} cannot be read ({shorten(str(problem))}); the file is damaged") from None
        if kind == "SPLINE" and not one.rows.size:
            raise CurveError(f"{label} has fit points only; export it with control points")
        found.append(one.require_sound(_UNITS[code]))
    return found, _UNITS[code]


def _has_header(file: Path) -> bool:
    """Whether a drawing says anything of itself: where it has no section HEADER, ezdxf makes one up, in metres."""
    content = file.read_bytes()
    return content.startswith(b"AutoCAD Binary DXF") or bool(_HEADER.search(content))


def _numbers_of(entity: Any, kind: str, label: str) -> _Drawn:
    dxf = entity.dxf
    if kind == "LINE":
        return _Drawn(kind, label, np.array([_array(dxf.start), _array(dxf.end)]))
    if kind == "SPLINE":
        rows = np.array([_array(point) for point in entity.control_points]).reshape(-1, 3)
        numbers = [float(number) for number in (*entity.knots, *entity.weights)]
        return _Drawn(kind, label, rows, tuple(numbers), int(dxf.degree))
    ocs = entity.ocs()
    turn = np.array([_array(ocs.to_wcs(axis)) for axis in np.eye(3)]) if ocs.transform else None
    if kind == "LWPOLYLINE":
        height = float(dxf.get("elevation", 0.0))
        rows = np.array([[x, y, height, bulge] for x, y, bulge in entity.get_points("xyb")], dtype=np.float64)
        return _Drawn(kind, label, rows.reshape(-1, 4), closed=bool(entity.closed), turn=turn)
    first, last = (0.0, 360.0) if kind == "CIRCLE" else (float(dxf.start_angle), float(dxf.end_angle))
    sweep = float(np.radians((last - first) % 360.0)) or 2.0 * np.pi
    centre = _array(dxf.center)[None]
    return _Drawn(kind, label, centre, (float(dxf.radius), float(np.radians(first)), sweep), turn=turn)


def _pieces_of(one: _Drawn, unit: float) -> Iterator[_Piece]:
    """The pieces of an entity, in mm and world coordinates; those without any length are left out."""
    rows = one.rows.copy()
    rows[:, :3] *= unit
    if one.kind == "LINE":
        yield from _line(rows[0], rows[1], one.label)
    elif one.kind == "SPLINE":
        yield _spline(one, rows)
    elif one.kind == "LWPOLYLINE":
        for k in range(len(rows) if one.closed else len(rows) - 1):
            start, end = rows[k], rows[(k + 1) % len(rows)]
            for piece in _bulged(start[:3], end[:3], float(start[3]), f"{one.label}, vertex {k + 1}"):
                yield _in_world(one, piece)
    else:
        radius, first, sweep = one.numbers
        yield _in_world(one, _arc(rows[0], unit * radius, first, sweep, one.label))


def _array(point: Any) -> FloatArray:
    return np.array([float(c) for c in point], dtype=np.float64)


def _in_world(one: _Drawn, piece: _Piece) -> _Piece:
    """Turn from the entity's own coordinates, which an extrusion along -Z mirrors."""
    if one.turn is None:
        return piece
    points = piece.points.copy()
    points[..., :3] = points[..., :3] @ one.turn
    return _Piece(points, piece.widths, piece.label)


def _line(start: FloatArray, end: FloatArray, label: str) -> Iterator[_Piece]:
    length = float(np.linalg.norm(end - start))
    if length > 0.0:
        yield _Piece(np.array([[[*start, 1.0], [*end, 1.0]]]), np.array([length]), label)


def _arc(centre: FloatArray, radius: float, first: float, sweep: float, label: str) -> _Piece:
    """A circular arc: equal rational quadratics, with the middle weight cos of half their angle."""
    count = max(1, int(np.ceil(abs(sweep) / _MAX_ARC - 1e-9)))
    angles = first + sweep * np.arange(2 * count + 1) / (2 * count)
    weight = np.tile([1.0, np.cos(0.5 * sweep / count)], count + 1)[: angles.size]
    # The middle point lies at radius / weight: times its weight it is at the radius, as the ends are.
    spokes = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(angles.size)], axis=1)
    points = np.column_stack([spokes + weight[:, None] * centre, weight])
    rows = 2 * np.arange(count)[:, None] + np.arange(3)
    return _Piece(points[rows], np.full(count, radius * abs(sweep) / count), label)


def _bulged(start: FloatArray, end: FloatArray, bulge: float, label: str) -> Iterator[_Piece]:
    """A side of a polyline: a line, or an arc where there is a bulge, the tangent of a quarter of its angle.

    The arc is made from its chord c, without the centre, which lies far away for a small bulge.  With the sweep t, the point
    after an angle a is c sin(a/2) / sin(t/2), turned by (a - t)/2; the middle control points lie on the tangents there.
    """
    chord = end - start
    sweep = 4.0 * np.arctan(bulge)
    if abs(sweep) < _STRAIGHT or not chord.any():
        yield from _line(start, end, label)
        return
    sine = 2.0 * bulge / (1.0 + bulge**2)  # of half the sweep
    length = float(np.linalg.norm(chord)) * 0.5 * sweep / sine
    if not abs(length) <= MAX_COORDINATE:
        raise CurveError(
            f"{label}: bulge = {bulge:.6g} makes an arc of {abs(length):.3g} mm; at most {MAX_COORDINATE:g} mm"
        )
    count = max(1, int(np.ceil(abs(sweep) / _MAX_ARC - 1e-9)))
    half = 0.5 * sweep / count  # of a segment
    angle = half * np.arange(2 * count + 1)
    weight = np.tile([1.0, np.cos(half)], count + 1)[: angle.size]
    points = start + _turned(chord, 0.5 * (angle - sweep)) * (np.sin(0.5 * angle) / sine)[:, None]
    points[-1] = end
    step = np.tan(half) / (2.0 * sine)
    points[1::2] = points[:-1:2] + step * _turned(chord, angle[:-1:2] - 0.5 * sweep)
    rows = 2 * np.arange(count)[:, None] + np.arange(3)
    homogeneous = np.column_stack([points * weight[:, None], weight])
    yield _Piece(homogeneous[rows], np.full(count, length / count), label)


def _turned(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """A vector turned in its plane by angles (n,), (n, 3)."""
    x, y, z = vector
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y, np.full(angle.size, z)], axis=1)


def _spline(one: _Drawn, points: FloatArray) -> _Piece:
    """A B-spline as Bezier segments: its power-basis pieces in the basis of Bernstein."""
    count = len(points) + one.degree + 1
    knots, weights = list(one.numbers[:count]), list(one.numbers[count:]) or None
    curve = NurbsCurve(points, knots, one.degree, weights, None, one.label)
    power = curve.pieces.powers
    p = power.shape[2] - 1
    matrix = np.array([[comb(j, i) / comb(p, i) if i <= j else 0.0 for i in range(p + 1)] for j in range(p + 1)])
    return _Piece(np.einsum("ji,mci->mjc", matrix, power), np.diff(curve.pieces.breaks), one.label)


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
        raise CurveError(f"{where}: {_crowd(pieces, points, [crowded, *partners[crowded]])}")
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


def _crowd(pieces: list[_Piece], points: FloatArray, ends: list[int]) -> str:
    """Say which entities meet in one place, and which of them are drawn twice."""
    labels = list(dict.fromkeys(_short(pieces[k // 2]) for k in sorted(ends)))
    place = f"{len(ends)} ends meet at {_place(points[ends[0]])}, of {', '.join(labels[:6])}"
    others = [(k // 2, points[k ^ 1]) for k in sorted(ends)]
    for i, (one, far) in enumerate(others):
        for other, end in others[i + 1 :]:
            if one != other and np.linalg.norm(end - far) <= _JOIN_MM:
                double = f"{_short(pieces[one])} and {_short(pieces[other])} have both ends in common"
                return f"{place}; a chain has two at every joint: {double}, delete one if it is drawn twice"
    return f"{place}; a chain has two at every joint: delete what does not belong to it"


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
