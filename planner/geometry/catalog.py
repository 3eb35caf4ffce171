"""The named curves, and curves from JSON or TOML files."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import CurveError, InputError
from planner.geometry.curve import Curve

CATALOG = ("teardrop", "hypotrochoid", "snailshell", "butterfly", "circle", "butterfly-nurbs", "flank")
_AXIS_KEYS = ("x", "y", "z", "a", "b", "c")
_REMARKS = ("name", "note", "units", "source", "dim", "type", "knots_4digit")
_KEYS = {
    "nurbs": ("degree", "control_points", "weights", "knots", "axes"),
    "formula": (*_AXIS_KEYS, "u_range", "parameter"),
    "dual_bspline_5axis": (
        "degree", "knots", "bottom_control_points", "top_control_points", "weights", "tool_axis", "kinematics"
    ),
}  # fmt: skip
_MAX_FILE_BYTES = 256 * 1024**2


def load_curve(source: str | Path, *, scale: float = 1.0) -> Curve:
    """Load a curve by its catalog name or from a file.

    Parameters
    ----------
    source : str or Path
        One of :data:`CATALOG`, or the path of a ``.json`` or ``.toml`` file.  In a file the object under ``curve``
        counts (or the file itself, where there is none): ``type`` is ``nurbs``, ``formula`` or ``dual_bspline_5axis``.
    scale : float
        Multiplies the linear axes.

    Returns
    -------
    Curve

    Raises
    ------
    CurveError
        If the name is unknown, the file cannot be read, or the curve in it is not valid.
    InputError
        If the scale is not a positive number.
    """
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError(f"scale = {scale!r} must be > 0 and finite")
    if isinstance(source, str) and source in CATALOG:
        text = resources.files("planner").joinpath(f"data/curves/{source}.json").read_text(encoding="utf-8")
        return _from_table(json.loads(text)["curve"], source, scale)
    path = Path(source)
    if path.suffix.lower() not in {".json", ".toml"}:
        raise CurveError(f'curve "{source}" is neither a .json or .toml file nor a name: {", ".join(CATALOG)}')
    table = _read(path)
    inner = table.get("curve", table)
    if not isinstance(inner, dict):
        raise CurveError(f'{path}: "curve" must be an object with the keys of a curve')
    return _from_table(inner, path.stem, scale)


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise CurveError(f"{path}: larger than {_MAX_FILE_BYTES // 1024**2} MiB; a curve file must be smaller")
        text = path.read_text(encoding="utf-8")
        table = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except OSError as error:
        raise CurveError(f"{path}: cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, json.JSONDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise CurveError(f"{path}: not a valid {path.suffix[1:].upper()} file ({error})") from None
    if not isinstance(table, dict):
        raise CurveError(f"{path}: must hold an object with the keys of a curve, not a {type(table).__name__}")
    return table


def _from_table(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    kind = table.get("type")
    if kind is None:
        kind = "nurbs" if "control_points" in table else "formula" if "x" in table else None
    if not isinstance(kind, str) or kind not in _KEYS:
        raise CurveError(f"{name}: type = {kind!r} must be one of {', '.join(_KEYS)}")
    unknown = sorted(set(table) - set(_KEYS[kind]) - set(_REMARKS))
    if unknown:
        raise CurveError(f'{name}: unknown key "{unknown[0]}"; a {kind} has the keys {", ".join(_KEYS[kind])}')
    if kind == "nurbs":
        return _nurbs(table, name, scale)
    return _formula(table, name, scale) if kind == "formula" else _dual_spline(table, name, scale)


def _need(table: Mapping[str, Any], keys: Sequence[str], name: str) -> list[Any]:
    missing = [key for key in keys if key not in table]
    if missing:
        raise CurveError(f'{name}: the key "{missing[0]}" is missing')
    return [table[key] for key in keys]


def _nurbs(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    from planner.geometry.nurbs import NurbsCurve

    degree, points, knots = _need(table, ("degree", "control_points", "knots"), name)
    axes = table.get("axes")
    if axes is not None:
        valid = isinstance(axes, list) and all(isinstance(a, str) and len(a) == 1 and a in "XYZABCUVW" for a in axes)
        if not valid or len(set(axes)) != len(axes):
            raise CurveError(f"{name}: axes = {axes!r} must be a list of different names out of X Y Z A B C U V W")
    curve = NurbsCurve(points, knots, degree, table.get("weights"), axes, name)
    if scale == 1.0:
        return curve
    factors = np.array([scale if unit == "mm" else 1.0 for unit in curve.axis_units])
    return NurbsCurve(curve.control_points * factors, curve.knots, curve.degree, curve.weights, curve.axes, name)


def _formula(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    from planner.geometry.formula import FormulaCurve, axis_expressions, parse_constant

    (span,) = _need(table, ("u_range",), name)
    if not isinstance(span, list) or len(span) != 2:
        raise CurveError(f"{name}: u_range = {span!r} must be a list of two numbers")
    domain = (parse_constant(span[0], f"{name}: u_range[0]"), parse_constant(span[1], f"{name}: u_range[1]"))
    parameter = table.get("parameter", "u")
    if not isinstance(parameter, str) or not parameter.isidentifier():
        raise CurveError(f"{name}: parameter = {parameter!r} must be a name")
    return FormulaCurve(axis_expressions(table, _AXIS_KEYS, name), domain, parameter, scale, name)


def _dual_spline(table: Mapping[str, Any], name: str, scale: float) -> Curve:
    from planner.geometry.fiveaxis import DualSplineCurve
    from planner.geometry.nurbs import NurbsCurve

    keys = ("degree", "knots", "bottom_control_points", "top_control_points")
    degree, knots, *sides = _need(table, keys, name)
    weights = table.get("weights")
    bottom, top = (
        NurbsCurve(points, knots, degree, weights, None, f"{name} ({side})", rests_allowed=True)
        for side, points in zip(("bottom", "top"), sides, strict=True)
    )
    if scale != 1.0:
        bottom, top = (
            NurbsCurve(c.control_points * scale, c.knots, c.degree, c.weights, None, c.name, rests_allowed=True)
            for c in (bottom, top)
        )
    return DualSplineCurve(bottom, top, name)
