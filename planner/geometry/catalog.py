"""The named curves, and curves from JSON or TOML files."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.data import data_text
from planner.errors import CurveError, InputError
from planner.geometry.curve import Curve
from planner.geometry.tolerance import POINTS_TOLERANCE_MM
from planner.inputs import positive_number, read_text, require_path

if TYPE_CHECKING:
    from planner.geometry.nurbs import NurbsCurve

CATALOG = ("teardrop", "hypotrochoid", "snailshell", "butterfly", "circle", "butterfly-nurbs", "flank")
_AXIS_KEYS = ("x", "y", "z", "a", "b", "c")
_MACHINE = "table-tilting ac"
_FOR_READERS = ("name", "description", "note", "source")
_REMARKS = (*_FOR_READERS, "units", "dim", "type")
_UNITS = ("mm", "not stated")  # the second as in what was published
_KEYS = {
    "nurbs": ("degree", "control_points", "weights", "knots", "axes"),
    "formula": (*_AXIS_KEYS, "u_range", "parameter", "axes"),
    "dual_bspline_5axis": (
        "degree", "knots", "bottom_control_points", "top_control_points", "weights", "kinematics"
    ),
}  # fmt: skip


def read_curve(source: str | Path, *, scale: float = 1.0, layer: str | None = None, chain: int | None = None) -> Curve:
    """Load a curve by its catalog name or from the file of a curve, which no part program is.

    Parameters
    ----------
    source : str or Path
        One of :data:`CATALOG`, or the path of a ``.json`` or ``.toml`` file.  In a file the object under ``curve``
        counts (or the file itself, where there is none): ``type`` is ``nurbs``, ``formula`` or ``dual_bspline_5axis``.
        A ``.dxf`` file is read by :func:`~planner.geometry.drawing.read_drawing.read_dxf`, a ``.csv`` file of points by
        :func:`~planner.geometry.points.read_points` within 1 um.
    scale : float
        Multiplies the linear axes.
    layer, chain : str, int, optional
        Of a drawing.

    Returns
    -------
    Curve

    Raises
    ------
    CurveError
        If the name is unknown, the file cannot be read, or the curve in it is not valid.
    InputError
        If the scale is not a positive number, or a layer or chain is asked for of what is no drawing.
    """
    scale = positive_number(scale, "scale")
    if np.isinf(scale):
        raise InputError("scale = inf must be finite")
    kind = Path(source).suffix.lower() if isinstance(source, str | os.PathLike) else ""
    if kind == ".dxf":
        from planner.geometry.drawing.read_drawing import read_dxf

        return read_dxf(source, layer=layer, chain=chain, scale=scale)
    require_no_choice(source, layer, chain)
    if isinstance(source, str) and source in CATALOG:
        text = data_text(f"curves/{source}.json")
        return _from_table(json.loads(text)["curve"], source, scale)
    if kind == ".csv":
        from planner.geometry.points import read_points

        return _scaled(read_points(source, POINTS_TOLERANCE_MM), scale)
    if kind not in {".json", ".toml"}:
        path = require_path(source, CurveError, "source")
        what = "a directory; give" if path.is_dir() and str(source) else "neither"
        join = "or" if what != "neither" else "nor"
        raise CurveError(
            f"curve {str(source)!r} is {what} a .json, .toml, .dxf, .csv or .ngc file {join} a name: {', '.join(CATALOG)}"
        )
    return _from_table(_inner(_read(source, kind), str(source)), Path(source).stem, scale)


def _inner(table: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return what a file says of its curve: all, or the object under ``curve``, beside which only remarks may stand."""
    if "curve" not in table:
        return table
    allowed = ("curve", *_FOR_READERS, "units")
    unknown = sorted(set(table) - set(allowed))
    if unknown:
        raise CurveError(f'{name}: unknown key "{unknown[0]}" beside "curve"; there may be {", ".join(allowed[1:])}')
    _require_mm(table, name)
    inner = table["curve"]
    if not isinstance(inner, dict):
        raise CurveError(f'{name}: "curve" must be an object with the keys of a curve')
    return inner


def _require_mm(table: Mapping[str, Any], name: str) -> None:
    """Refuse lengths in another unit, which would count as mm."""
    units = table.get("units", "mm")
    if units not in _UNITS:
        raise CurveError(
            f'{name}: units = {units!r} must be "mm"; leave the key out and give the scale in mm, 25.4 for inches'
        )


def require_no_choice(source: str | Path, layer: str | None, chain: int | None) -> None:
    """Refuse a layer or a chain of what is no drawing."""
    for name, value in (("layer", layer), ("chain", chain)):
        if value is not None:
            raise InputError(f"{name} = {value!r} is for drawings, .dxf; {source} is none")


def _scaled(curve: NurbsCurve, scale: float) -> NurbsCurve:
    """The same curve with its linear axes multiplied."""
    from planner.geometry.nurbs import NurbsCurve

    if scale == 1.0:
        return curve
    factors = np.array([scale if unit == "mm" else 1.0 for unit in curve.axis_units])
    return NurbsCurve(curve.control_points * factors, curve.knots, curve.degree, curve.weights, curve.axes, curve.name)


def _read(source: str | Path, kind: str) -> dict[str, Any]:
    text = read_text(source, CurveError)
    try:
        table = json.loads(text, object_pairs_hook=_object) if kind == ".json" else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise CurveError(f"{source}: not a valid {kind[1:].upper()} file ({error})") from None
    if not isinstance(table, dict):
        raise CurveError(f"{source}: must hold an object with the keys of a curve, not a {type(table).__name__}")
    return table


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; of a key that is given twice Python would silently keep the last."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f'the key "{twice}" is given twice')
    return table


def _from_table(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    kind = table.get("type")
    if kind is None:
        kind = "nurbs" if "control_points" in table else "formula" if "x" in table else None
    if not isinstance(kind, str) or kind not in _KEYS:
        raise CurveError(f"{name}: type = {kind!r} must be one of {', '.join(_KEYS)}")
    unknown = sorted(set(table) - set(_KEYS[kind]) - set(_REMARKS))
    if unknown:
        keys, remarks = ", ".join(_KEYS[kind]), ", ".join(_REMARKS)
        raise CurveError(f'{name}: unknown key "{unknown[0]}"; a {kind} has the keys {keys}, and for remarks {remarks}')
    _require_mm(table, name)
    build = {"nurbs": _nurbs, "formula": _formula, "dual_bspline_5axis": _dual_spline}[kind]
    curve = build(table, name, scale)
    if table.get("dim", curve.dim) != curve.dim:
        raise CurveError(f"{name}: dim = {table['dim']!r}, but the curve has the axes {', '.join(curve.axes)}")
    return curve


def _need(table: Mapping[str, Any], keys: Sequence[str], name: str) -> list[Any]:
    missing = [key for key in keys if key not in table]
    if missing:
        raise CurveError(f'{name}: the key "{missing[0]}" is missing')
    return [table[key] for key in keys]


def _nurbs(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    from planner.geometry.nurbs import NurbsCurve

    degree, points, knots = _need(table, ("degree", "control_points", "knots"), name)
    weights, axes = table.get("weights"), table.get("axes")
    if axes is not None and not isinstance(axes, list):
        raise CurveError(f"{name}: axes = {axes!r} must be a list of names")
    return _scaled(NurbsCurve(points, knots, degree, weights, axes, name, rests_allowed=scale != 1.0), scale)


def _formula(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    from planner.geometry.formula import FormulaCurve, axis_expressions, parse_constant

    (span,) = _need(table, ("u_range",), name)
    if not isinstance(span, list) or len(span) != 2:
        raise CurveError(f"{name}: u_range = {span!r} must be a list of two numbers")
    domain = (parse_constant(span[0], f"{name}: u_range[0]"), parse_constant(span[1], f"{name}: u_range[1]"))
    return FormulaCurve(axis_expressions(table, _AXIS_KEYS, name), domain, table.get("parameter", "u"), scale, name)


def _dual_spline(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    from planner.geometry.fiveaxis import DualSplineCurve
    from planner.geometry.nurbs import NurbsCurve

    keys = ("degree", "knots", "bottom_control_points", "top_control_points")
    degree, knots, *sides = _need(table, keys, name)
    kinematics = table.get("kinematics", {})
    unknown = sorted(set(kinematics) - {"machine"}) if isinstance(kinematics, dict) else []
    if unknown:
        raise CurveError(f'{name}: unknown key "{unknown[0]}" in kinematics; there may be machine')
    machine = kinematics.get("machine", _MACHINE) if isinstance(kinematics, dict) else kinematics
    if not isinstance(machine, str) or not machine.replace("/", "").lower().startswith(_MACHINE):
        raise CurveError(f'{name}: kinematics is of a machine {machine!r}; "table-tilting AC" is the one known')
    weights = table.get("weights")
    bottom, top = (
        NurbsCurve(points, knots, degree, weights, None, f"{name} ({side})", rests_allowed=True)
        for side, points in zip(("bottom", "top"), sides, strict=True)
    )
    if scale != 1.0:
        bottom, top = (
            NurbsCurve(s.control_points * scale, s.knots, s.degree, s.weights, None, s.name, rests_allowed=True)
            for s in (bottom, top)
        )
    return DualSplineCurve(bottom, top, name)
