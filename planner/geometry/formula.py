"""Curves given by expressions, with exact derivatives by CasADi.

An expression is parsed into Python's syntax tree and rebuilt node by node as a CasADi expression.  Only numbers, the
parameter, ``pi``, ``e``, the operators ``+ - * / **`` and the functions of :data:`FUNCTIONS` exist in that small
language; nothing is ever executed as Python.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Any

import numpy as np

from planner.errors import CurveError
from planner.geometry.curve import Curve, FloatArray, Pieces, Side, require_regular

# Smooth functions only: a curve with |u| or sign(u) in it would hide its breaks.
FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "pow"
)  # fmt: skip
_CONSTANTS = {"pi": np.pi, "e": np.e}
_MAX_EXPRESSION = 10_000

# Fit of a smooth curve by polynomial pieces: the degree balances the number of pieces against the cost of a step.
_FIT_DEGREE = 9
_FIT_TOLERANCE = 1e-13  # of the curve's extent; 1e-11 mm on 100 mm
_MAX_FIT_PIECES = 200_000


@dataclass(frozen=True, eq=False)
class FormulaCurve(Curve):
    """A curve given by one expression an axis.

    Parameters
    ----------
    expressions : mapping of axis name to expression
        For example ``{"X": "cos(u)", "Y": "sin(u)"}``; A, B and C are rotary axes in rad.
    domain : pair of float
        Parameter range, increasing.
    parameter : str
        Name of the parameter in the expressions.
    scale : float
        Multiplies the linear axes.

    Raises
    ------
    CurveError
        If an expression is not one, or the curve is not finite or has a cusp.
    """

    expressions: Mapping[str, str]
    domain: tuple[float, float]
    parameter: str = "u"
    scale: float = 1.0
    name: str = "formula"

    def __post_init__(self) -> None:
        u0, u1 = self.domain
        if not (np.isfinite(u0) and np.isfinite(u1) and u0 < u1):
            raise CurveError(f"{self.name}: u_range = [{u0!r}, {u1!r}] must be two increasing finite numbers")
        if not 2 <= len(self.expressions) <= 6:
            raise CurveError(
                f"{self.name}: {len(self.expressions)} expressions; there must be 2 to 6, one for each axis"
            )
        require_regular(self)

    @property
    def axes(self) -> tuple[str, ...]:  # type: ignore[override]
        """Axis names, in the order of the expressions."""
        return tuple(self.expressions)

    @cached_property
    def _function(self) -> Any:
        import casadi

        u = casadi.SX.sym(self.parameter)
        rows = []
        for axis, text in self.expressions.items():
            factor = self.scale if axis not in "ABC" else 1.0
            rows.append(factor * parse_expression(text, {self.parameter: u}, f"{self.name}: {axis.lower()}"))
        derivatives = [casadi.vertcat(*rows)]
        for _ in range(3):
            derivatives.append(casadi.jacobian(derivatives[-1], u))
        return casadi.Function("curve", [u], derivatives)

    def _evaluate(self, u: FloatArray, order: int, side: Side) -> FloatArray:
        if u.size == 0:
            return np.empty((order + 1, 0, self.dim))
        values = self._function(u[None, :])
        return np.stack([np.array(values[k]).T for k in range(order + 1)])

    @cached_property
    def pieces(self) -> Pieces:
        """Polynomial pieces within 1e-13 of the curve's extent."""
        return fit_pieces(self)

    def definition(self) -> Mapping[str, Any]:
        """Expressions, range and scale."""
        return {
            "type": "formula",
            "expressions": dict(self.expressions),
            "domain": list(self.domain),
            "parameter": self.parameter,
            "scale": self.scale,
        }


def parse_expression(text: str, names: Mapping[str, Any], where: str) -> Any:
    """Build the CasADi (or float) value of an expression over the given names.

    Raises
    ------
    CurveError
        Naming ``where``, the offending part and what is allowed.
    """
    if not isinstance(text, str):
        raise CurveError(f"{where} = {text!r} must be an expression in quotation marks")
    if len(text) > _MAX_EXPRESSION:
        raise CurveError(f"{where} has {len(text)} characters; an expression may have {_MAX_EXPRESSION}")
    try:
        return _build(ast.parse(text.strip(), mode="eval").body, names, where, text)
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError, ZeroDivisionError) as error:
        if isinstance(error, CurveError):
            raise
        raise CurveError(f'{where} = "{_shorten(text)}" is not an expression ({error})') from None


def parse_constant(value: Any, where: str) -> float:
    """A number, or an expression without a parameter such as ``2*pi``."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    import casadi

    return float(casadi.evalf(casadi.SX(parse_expression(value, {}, where))))


def _shorten(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def _build(node: ast.expr, names: Mapping[str, Any], where: str, text: str) -> Any:
    import casadi

    def operand(child: ast.expr) -> Any:
        return _build(child, names, where, text)

    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return casadi.SX(float(node.value))
    if isinstance(node, ast.Name):
        if node.id in names:
            return names[node.id]
        if node.id in _CONSTANTS:
            return casadi.SX(_CONSTANTS[node.id])
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        return -operand(node.operand) if isinstance(node.op, ast.USub) else operand(node.operand)
    if isinstance(node, ast.BinOp):
        # Python's own casadi operators; a power of two constants stays a product, so its derivative does too
        match node.op:
            case ast.Add():
                return operand(node.left) + operand(node.right)
            case ast.Sub():
                return operand(node.left) - operand(node.right)
            case ast.Mult():
                return operand(node.left) * operand(node.right)
            case ast.Div():
                return operand(node.left) / operand(node.right)
            case ast.Pow():
                return operand(node.left) ** operand(node.right)
    if (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and not node.keywords
        and node.func.id in FUNCTIONS
    ):
        wanted = 2 if node.func.id in {"atan2", "pow"} else 1
        if len(node.args) == wanted:
            arguments = [operand(child) for child in node.args]
            return arguments[0] ** arguments[1] if node.func.id == "pow" else getattr(casadi, node.func.id)(*arguments)
    part = ast.get_source_segment(text.strip(), node) or text
    allowed = ", ".join([*names, *_CONSTANTS])
    raise CurveError(
        f'{where}: "{_shorten(part)}" is not allowed in an expression; allowed are numbers, {allowed}, + - * / **, '
        f"and the functions {', '.join(FUNCTIONS)}"
    )


def fit_pieces(curve: Curve) -> Pieces:
    """Fit polynomial pieces to a smooth curve, halving a piece until every coordinate is within tolerance.

    Each piece interpolates at Chebyshev points of the second kind, ends included, so neighbours join; the error is
    measured between the points, on the exact curve.
    """
    k = np.arange(_FIT_DEGREE + 1)
    nodes = 0.5 - 0.5 * np.cos(np.pi * k / _FIT_DEGREE)
    probes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(2 * _FIT_DEGREE) + 0.5) / (2 * _FIT_DEGREE))
    to_power = _chebyshev_to_power()
    to_series = np.linalg.inv(np.cos(np.outer(np.arccos(np.clip(2 * nodes - 1, -1, 1)), k)))
    u0, u1 = curve.domain
    corners = np.concatenate([[u0], curve._candidate_breaks(), [u1]])
    lo, hi = corners[:-1], corners[1:]
    scan = curve.derivatives(np.linspace(u0, u1, 400), 0)[0]
    extent = float((scan.max(axis=0) - scan.min(axis=0)).max())
    tolerance = _FIT_TOLERANCE * extent + 8.0 * np.finfo(float).eps * float(np.abs(scan).max())
    done: list[tuple[FloatArray, FloatArray]] = []
    count = 0
    while lo.size:
        width = hi - lo
        # A point computed as lo + 1.0 * width may miss hi by a rounding and fall outside the domain.
        at = np.minimum(lo[:, None] + width[:, None] * nodes, hi[:, None])
        values = _inside(curve, at, hi)
        series = np.einsum("ij,njd->nid", to_series, values)
        power = np.einsum("ij,njd->nid", to_power, series)
        probed = _inside(curve, lo[:, None] + width[:, None] * probes, hi)
        powers = probes[:, None] ** k
        error = np.abs(np.einsum("pi,nid->npd", powers, power) - probed).max(axis=(1, 2))
        bad = (error > tolerance) & (width > 64.0 * np.spacing(np.maximum(np.abs(lo), np.abs(hi))))
        done.append((lo[~bad], power[~bad]))
        count += int((~bad).sum())
        if count + int(bad.sum()) > _MAX_FIT_PIECES:
            raise CurveError(
                f"{curve.name}: more than {_MAX_FIT_PIECES} polynomial pieces are needed; the curve is not smooth"
            )
        mid = 0.5 * (lo + hi)[bad]
        lo, hi = np.concatenate([lo[bad], mid]), np.concatenate([mid, hi[bad]])
    starts = np.concatenate([item[0] for item in done])
    power = np.concatenate([item[1] for item in done])
    order = np.argsort(starts)
    denominator = np.zeros((starts.size, 1, _FIT_DEGREE + 1))
    denominator[:, 0, 0] = 1.0
    coefficients = np.concatenate([power[order].transpose(0, 2, 1), denominator], axis=1)
    return Pieces(np.append(starts[order], u1), np.ascontiguousarray(coefficients), False)


def _inside(curve: Curve, at: FloatArray, hi: FloatArray) -> FloatArray:
    """Positions at the points of each piece, the last one of a piece taken from the left."""
    values = curve.derivatives(at, 0)[0]
    last = at[:, -1] >= hi
    if last.any():
        values[last, -1] = curve.derivatives(at[last, -1], 0, side="left")[0]
    return values


def _chebyshev_to_power() -> FloatArray:
    """Matrix from the coefficients of T_k(2w - 1) to those of w^i: T_k(2w-1) = sum_i (-1)^(k-i) 4^i k/(k+i) C(k+i, 2i) w^i."""
    size = _FIT_DEGREE + 1
    matrix = np.zeros((size, size))
    matrix[0, 0] = 1.0
    for k in range(1, size):
        for i in range(k + 1):
            matrix[i, k] = (-1) ** (k - i) * 4**i * k * comb(k + i, 2 * i) / (k + i)
    return matrix


def axis_expressions(table: Mapping[str, Any], names: Sequence[str], where: str) -> dict[str, str]:
    """Collect the expressions of a curve file, one for each axis key that is present, in the order of ``names``."""
    found = {name.upper(): table[name] for name in names if name in table}
    if not 2 <= len(found) <= 6:
        raise CurveError(f"{where}: {len(found)} axis expressions; give 2 to 6 of {', '.join(names)}")
    return found
