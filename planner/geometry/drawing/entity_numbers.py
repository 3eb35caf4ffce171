"""Entities of a drawing as plain numbers, checked, and as pieces.

What is read of an entity stands in one function of ``_NUMBERS``; everything behind it knows nothing of the library.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.errors import CurveError
from planner.geometry.curve import MAX_COORDINATE
from planner.geometry.drawing.bezier_pieces import Piece, arc, bulged, ellipse, line, spline
from planner.inputs import shorten
from planner.types import FloatArray

# A foreign parser of damaged bytes trips over whatever it meets.
PARSER_ERRORS = (
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
SKIPPED = (
    "TEXT", "MTEXT", "ATTRIB", "ATTDEF", "POINT", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "LEADER",
    "MULTILEADER", "TOLERANCE", "HATCH", "MPOLYGON", "IMAGE", "WIPEOUT", "VIEWPORT", "XLINE", "RAY", "ACAD_TABLE",
    "OLE2FRAME",
)  # fmt: skip
"""What a drawing may hold that is no path: texts, marks, dimensions, fillings, pictures, construction lines."""
_INSTEAD = {"MLINE": "explode it to lines", "REGION": "explode it to lines and arcs"}
_OTHERWISE = "delete it, put the path on a layer of its own (--layer), or in a drawing of its own"
_CONTROL_FRAME = 16  # flag of a vertex of a polyline that only bends it
_FIT_DISTANCE = 1e-9  # of the size of a spline: how far its fit points may lie off it
_CUBIC = 3


@dataclass(frozen=True)
class DrawnNumbers:
    """An entity as plain numbers, in the units and the coordinates that it has in the file.

    ``rows``: the ends of a line; vertices with bulge of a polyline; control points of a spline; the centre of an arc;
    centre, major and minor axis of an ellipse.  ``numbers``: radius, first angle and sweep (rad) of an arc, radius 1 of an
    ellipse; knots and, behind them, weights of a spline.  ``turn``: the entity's own axes in the world, (3, 3), where they
    are not the world's.
    """

    kind: str
    label: str
    rows: FloatArray
    numbers: tuple[float, ...] = ()
    degree: int = 0
    closed: bool = False
    turn: FloatArray | None = None
    note: str = ""

    def require_sound(self) -> DrawnNumbers:
        """Refuse what is no number, or no number of a drawing."""
        _require_near(self.rows[:, :3], self.label)
        if not np.isfinite([*self.numbers, *self.rows[:, 3:].reshape(-1)]).all():
            raise CurveError(f"{self.label}: its radius, angles, bulges, knots and weights must be finite")
        if self.kind == "ARC" and not 0.0 < self.numbers[0] <= MAX_COORDINATE:
            raise CurveError(
                f"{self.label}: radius = {self.numbers[0]!r} must be > 0, and at most {MAX_COORDINATE:g} mm"
            )
        return self

    def pieces(self) -> Iterator[Piece]:
        """The pieces of the entity in the coordinates of the drawing or its block, in the units of the drawing."""
        matrix = np.eye(4)
        if self.turn is not None:
            matrix[:3, :3] = self.turn
        for piece in self._own_pieces():
            yield piece if self.turn is None else piece.mapped(matrix)

    def _own_pieces(self) -> Iterator[Piece]:
        rows = self.rows
        if self.kind == "LINE":
            yield from line(rows[0], rows[1])
        elif self.kind == "SPLINE":
            count = len(rows) + self.degree + 1
            knots, weights = list(self.numbers[:count]), list(self.numbers[count:]) or None
            yield spline(rows, knots, self.degree, weights, self.label)
        elif self.kind == "POLYLINE":
            for k in range(len(rows) if self.closed else len(rows) - 1):
                start, end = rows[k], rows[(k + 1) % len(rows)]
                yield from bulged(start[:3], end[:3], float(start[3]), f"{self.label}, vertex {k + 1}")
        elif self.kind == "ELLIPSE":
            yield ellipse(rows[1:], rows[0], *self.numbers)
        else:
            radius, first, sweep = self.numbers
            yield arc(rows[0], radius, first, sweep)


def numbers_of(entity: Any, label: str) -> DrawnNumbers:
    """Take an entity apart.

    Raises
    ------
    CurveError
        If it is of another type, damaged, or not as an entity of a drawing can be.
    """
    from ezdxf.lldxf.const import DXFError

    kind = entity.dxftype()
    if kind not in _NUMBERS:
        read = ", ".join((*_NUMBERS, "INSERT"))
        raise CurveError(f"{label} is not read; a chain of {read} is: {_INSTEAD.get(kind, _OTHERWISE)}")
    try:
        return _NUMBERS[kind](entity, label).require_sound()
    except CurveError:
        raise
    except (DXFError, *PARSER_ERRORS) as problem:
        raise CurveError(f"{label} cannot be read ({shorten(str(problem))}); the file is damaged") from None


def _require_near(points: FloatArray, label: str) -> None:
    if not (np.abs(points) <= MAX_COORDINATE).all():
        raise CurveError(f"{label}: its coordinates must be finite, and lie within {MAX_COORDINATE:g} mm of 0")


def _array(point: Any) -> FloatArray:
    return np.array([float(c) for c in point], dtype=np.float64)


def _turn(entity: Any) -> FloatArray | None:
    """The entity's own axes in the world, which an extrusion along -Z mirrors."""
    ocs = entity.ocs()
    return np.array([_array(ocs.to_wcs(axis)) for axis in np.eye(3)]) if ocs.transform else None


def _line(entity: Any, label: str) -> DrawnNumbers:
    return DrawnNumbers("LINE", label, np.array([_array(entity.dxf.start), _array(entity.dxf.end)]))


def _arc(entity: Any, label: str) -> DrawnNumbers:
    dxf = entity.dxf
    full = entity.dxftype() == "CIRCLE"
    first, last = (0.0, 360.0) if full else (float(dxf.start_angle), float(dxf.end_angle))
    sweep = float(np.radians((last - first) % 360.0)) or 2.0 * np.pi
    centre = _array(dxf.center)[None]
    return DrawnNumbers("ARC", label, centre, (float(dxf.radius), float(np.radians(first)), sweep), turn=_turn(entity))


def _ellipse(entity: Any, label: str) -> DrawnNumbers:
    """Centre + cos t major + sin t minor, where minor = ratio times (extrusion x major)."""
    dxf = entity.dxf
    major, normal = _array(dxf.major_axis), _array(dxf.extrusion)
    _require_near(np.array([major, normal]), label)
    minor = float(dxf.ratio) * np.cross(normal / (float(np.linalg.norm(normal)) or 1.0), major)
    first, last = float(dxf.start_param), float(dxf.end_param)
    sweep = float((last - first) % (2.0 * np.pi))
    # As files say a full turn: from 0 to 6.283185307179586, or 6.28318530718.
    if min(sweep, 2.0 * np.pi - sweep) < 1e-9 and abs(last - first) > 1e-9:
        sweep = 2.0 * np.pi
    return DrawnNumbers("ELLIPSE", label, np.array([_array(dxf.center), major, minor]), (first, sweep or 2.0 * np.pi))


def _lwpolyline(entity: Any, label: str) -> DrawnNumbers:
    height = float(entity.dxf.get("elevation", 0.0))
    rows = np.array([[x, y, height, bulge] for x, y, bulge in entity.get_points("xyb")], dtype=np.float64)
    return DrawnNumbers("POLYLINE", label, rows.reshape(-1, 4), closed=bool(entity.closed), turn=_turn(entity))


def _polyline(entity: Any, label: str) -> DrawnNumbers:
    """A polyline of old: vertices are entities, in the plane with bulges, or in space."""
    if entity.is_polygon_mesh or entity.is_poly_face_mesh:
        raise CurveError(f"{label} is a mesh, which is no path: {_OTHERWISE}")
    vertices = [vertex.dxf for vertex in entity.vertices if not int(vertex.dxf.flags) & _CONTROL_FRAME]
    flat = bool(entity.is_2d_polyline)
    height = float(_array(entity.dxf.get("elevation", (0.0, 0.0, 0.0)))[2])
    rows = np.array(
        [
            [
                float(v.location.x),
                float(v.location.y),
                height if flat else float(v.location.z),
                float(v.bulge) if flat else 0.0,
            ]
            for v in vertices
        ]
    )
    closed, turn = bool(entity.is_closed), _turn(entity) if flat else None
    return DrawnNumbers("POLYLINE", label, rows.reshape(-1, 4), closed=closed, turn=turn)


def _spline(entity: Any, label: str) -> DrawnNumbers:
    rows = np.array([_array(point) for point in entity.control_points]).reshape(-1, 3)
    if not rows.size:
        return _fitted_spline(entity, label)
    numbers = [float(number) for number in (*entity.knots, *entity.weights)]
    return DrawnNumbers("SPLINE", label, rows, tuple(numbers), int(entity.dxf.degree))


def _fitted_spline(entity: Any, label: str) -> DrawnNumbers:
    """A spline that has fit points only: the cubic through them that ezdxf makes, as CAD programs do.

    Its knots are the lengths of the chords; its ends have the tangents that are given for both, else no second derivative.
    """
    points = np.array([_array(point) for point in entity.fit_points]).reshape(-1, 3)
    _require_near(points, label)
    if len(points) < 2:
        raise CurveError(f"{label} has neither control points nor fit points; the file is damaged")
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if not steps.all():
        k = int(np.argmin(steps))
        raise CurveError(f"{label}: fit points {k + 1} and {k + 2} are the same; delete one")
    if entity.closed and np.abs(points[0] - points[-1]).max() > _FIT_DISTANCE * np.abs(points).max():
        raise CurveError(f"{label} is closed and has fit points only; export it with control points")
    made = entity.construction_tool()
    rows = np.array([_array(point) for point in made.control_points])
    knots = np.array(list(made.knots()))
    off = np.abs(np.array([_array(made.point(t)) for t in _chord_parameters(steps, knots)]) - points).max()
    if not off <= _FIT_DISTANCE * max(np.abs(points).max(), steps.sum()):
        raise CurveError(f"{label} lies {off:.3g} off its fit points as ezdxf makes it; export it with control points")
    return DrawnNumbers(
        "SPLINE",
        label,
        rows,
        tuple(knots.tolist()),
        int(made.degree),
        note=f"cubic through its {len(points)} fit points",
    )


def _chord_parameters(steps: FloatArray, knots: FloatArray) -> FloatArray:
    """Parameters of fit points: shares of the lengths of the chords."""
    along = np.append(0.0, np.cumsum(steps)) / steps.sum()
    along[-1] = 1.0
    return np.asarray(knots[0] + along * (knots[-1] - knots[0]))


_NUMBERS: dict[str, Callable[[Any, str], DrawnNumbers]] = {
    "SPLINE": _spline,
    "LINE": _line,
    "ARC": _arc,
    "CIRCLE": _arc,
    "ELLIPSE": _ellipse,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "HELIX": _spline,
}
READ = tuple(_NUMBERS)
"""Types of entities that are paths."""
