"""Curves given by expressions, with exact derivatives.

An expression is parsed into Python's syntax tree and recorded node by node on a tape, which knows how to differentiate.
Only numbers, the parameter, ``pi``, ``e``, the operators ``+ - * / **`` and the functions of :data:`FUNCTIONS` exist in
that small language; nothing is ever executed as Python.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from planner.errors import CurveError
from planner.geometry.curve import ROTARY_AXES, Curve, Pieces, axis_names, require_regular
from planner.geometry.fit import fit_pieces
from planner.geometry.tape import Expression, Operation, Recorder, Tape
from planner.inputs import numbers, positive_number, shorten
from planner.types import BoolArray, FloatArray

# Number of arguments.  Smooth functions only: a curve with |u| or sign(u) in it would hide its breaks.
_ARGUMENTS = {
    "sin": 1, "cos": 1, "tan": 1, "asin": 1, "acos": 1, "atan": 1, "atan2": 2, "sinh": 1, "cosh": 1, "tanh": 1,
    "exp": 1, "log": 1, "sqrt": 1, "pow": 2,
}  # fmt: skip
FUNCTIONS = tuple(_ARGUMENTS)
_CONSTANTS = {"pi": np.pi, "e": np.e}
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_MAX_EXPRESSION = 10_000  # characters


@dataclass(frozen=True, eq=False, repr=False)
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
    name : str
        For messages.

    Raises
    ------
    CurveError
        If an expression is not one, or the curve is not finite, not smooth, or has a cusp.
    """

    expressions: Mapping[str, str]
    domain: tuple[float, float]
    parameter: str = "u"
    scale: float = 1.0
    name: str = "formula"

    def __post_init__(self) -> None:
        ends = numbers(self.domain, f"{self.name}: u_range", CurveError)
        if ends.shape != (2,) or not np.isfinite(ends).all() or ends[0] >= ends[1]:
            raise CurveError(f"{self.name}: u_range = {ends.tolist()} must be two increasing finite numbers")
        count = len(self.expressions) if isinstance(self.expressions, Mapping) else 0
        if not 2 <= count <= 6:
            raise CurveError(f"{self.name}: {count} expressions; there must be 2 to 6, one for each axis")
        axis_names(tuple(self.expressions), count, self.name)
        if not isinstance(self.parameter, str) or not self.parameter.isidentifier():
            raise CurveError(f"{self.name}: parameter = {shorten(repr(self.parameter))} must be a name")
        # One spelling of the numbers, so that equal curves have equal fingerprints.
        object.__setattr__(self, "domain", tuple(ends.tolist()))
        object.__setattr__(self, "scale", positive_number(self.scale, f"{self.name}: scale"))
        object.__setattr__(self, "expressions", dict(self.expressions))
        require_regular(self)

    @property
    def axes(self) -> tuple[str, ...]:  # type: ignore[override]
        """Axis names, in the order of the expressions."""
        return tuple(self.expressions)

    @cached_property
    def _tape(self) -> Tape:
        """The position as instructions."""
        recorder = Recorder(1)
        names = {self.parameter: recorder.input(0)}
        rows = []
        for axis, text in self.expressions.items():
            value = parse_expression(text, recorder, names, f"{self.name}: {axis.lower()}")
            rows.append(value if axis in ROTARY_AXES else self.scale * value)
        return recorder.tape(rows)

    def _evaluate(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        return self._tape(u[None, :, None], order)

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


def parse_expression(text: str, recorder: Recorder, names: Mapping[str, Expression], where: str) -> Expression:
    """Record the value of an expression over the given names.

    Raises
    ------
    CurveError
        Naming ``where``, the offending part and what is allowed.
    """
    if not isinstance(text, str):
        raise CurveError(f"{where} = {shorten(repr(text))} must be an expression in quotation marks")
    if len(text) > _MAX_EXPRESSION:
        raise CurveError(f"{where} has {len(text)} characters; an expression may have {_MAX_EXPRESSION}")
    source = " ".join(text.split())  # on one line, as TOML may break it
    if "#" in source:
        raise CurveError(f'{where} = "{shorten(text)}" must not contain a comment')
    try:
        return _Reader(source, recorder, names, where).value(ast.parse(source, mode="eval").body)
    except CurveError:
        raise
    except (RecursionError, MemoryError):
        raise CurveError(f'{where} = "{shorten(text)}" is nested too deeply for an expression') from None
    except (SyntaxError, ValueError, OverflowError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        raise CurveError(f'{where} = "{shorten(text)}" is not an expression ({shorten(reason)})') from None


def parse_constant(value: Any, where: str) -> float:
    """A number, or an expression without a parameter such as ``2*pi``."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise CurveError(f"{where} = {shorten(str(value))} exceeds the range of double precision") from None
    constant = parse_expression(value, Recorder(0), {}, where).constant
    return np.nan if constant is None else constant


@dataclass(frozen=True)
class _Reader:
    """Records the syntax tree of one expression; whatever it does not know is refused."""

    source: str
    recorder: Recorder
    names: Mapping[str, Expression]
    where: str

    def value(self, node: ast.expr) -> Expression:
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return self.recorder.expression(float(number))
            case ast.Name(id=name) if name in self.names or name in _CONSTANTS:
                return self.names[name] if name in self.names else self.recorder.expression(_CONSTANTS[name])
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
                return self.value(inner) if isinstance(sign, ast.UAdd) else -self.value(inner)
            case ast.BinOp(op=operation) if type(operation) in _OPERATORS:
                return self._chain(node)
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if len(args) == _ARGUMENTS.get(name):
                values = [self.value(argument) for argument in args]
                if name != "pow":
                    return self.recorder.function(Operation[name.upper()], *values)
                return values[0] ** values[1]
        part = ast.get_source_segment(self.source, node) or self.source
        raise CurveError(
            f'{self.where}: "{shorten(part)}" is not allowed in an expression; allowed are numbers, '
            f"{', '.join([*self.names, *_CONSTANTS])}, + - * / **, and the functions {', '.join(FUNCTIONS)}"
        )

    def _chain(self, node: ast.BinOp) -> Expression:
        """A chain of operators: its left operands nest as deep as a sum has terms, so they are taken in a loop."""
        chain: list[ast.BinOp] = []
        inner: ast.expr = node
        while isinstance(inner, ast.BinOp) and type(inner.op) in _OPERATORS:
            chain.append(inner)
            inner = inner.left
        total = self.value(inner)
        for link in reversed(chain):
            total = _OPERATORS[type(link.op)](total, self.value(link.right))
        return total


def axis_expressions(table: Mapping[str, Any], names: Sequence[str], where: str) -> dict[str, str]:
    """Collect the expressions of a curve file, one for each axis key that is present.

    The order is that of ``names``, or of the list ``axes`` in the file, which must name the same axes.
    """
    found = {name.upper(): table[name] for name in names if name in table}
    if not 2 <= len(found) <= 6:
        raise CurveError(f"{where}: {len(found)} axis expressions; give 2 to 6 of {', '.join(names)}")
    axes = table.get("axes", list(found))
    if not isinstance(axes, list) or not all(isinstance(axis, str) for axis in axes) or sorted(axes) != sorted(found):
        raise CurveError(f"{where}: axes = {axes!r} must name the axes that have an expression: {', '.join(found)}")
    return {axis: found[axis] for axis in axes}
