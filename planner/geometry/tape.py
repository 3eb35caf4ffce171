"""Expressions recorded as a list of instructions, and evaluated with three derivatives over whole arrays of points.

A :class:`Recorder` writes down what is done to its inputs; equal operations are done once, and constants are folded.  The
:class:`Tape` it makes runs on blocks of points in compiled code, every instruction on a value and its three derivatives with
respect to a parameter at once: Leibniz' rule for a product, the chain rule for a function (Griewank, Walther, Evaluating
Derivatives, 2nd ed. 2008, chapter 13).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, auto

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.types import FloatArray

_ORDERS = 4  # a value and three derivatives
_BLOCK = 32  # points that the compiled code works on at once
# Whole powers up to this one are products, exact and cheap where the power function is neither.
_MAX_FACTORS = 8


class Operation(IntEnum):
    """What an instruction does, as the compiled code counts it.

    SHIFT, SCALE and QUOTIENT are sum, product and quotient with a constant as second operand; POWER has a constant exponent.
    """

    ADD = 0
    SUBTRACT = auto()
    MULTIPLY = auto()
    DIVIDE = auto()
    SHIFT = auto()
    SCALE = auto()
    QUOTIENT = auto()
    SQRT = auto()
    ABSOLUTE = auto()
    POWER = auto()
    POWER_OF = auto()
    EXP = auto()
    LOG = auto()
    SIN = auto()
    COS = auto()
    TAN = auto()
    ASIN = auto()
    ACOS = auto()
    ATAN = auto()
    ATAN2 = auto()
    SINH = auto()
    COSH = auto()
    TANH = auto()


_VALUES: dict[Operation, Callable[..., float]] = {
    Operation.SQRT: np.sqrt,
    Operation.EXP: np.exp,
    Operation.LOG: np.log,
    Operation.SIN: np.sin,
    Operation.COS: np.cos,
    Operation.TAN: np.tan,
    Operation.ASIN: np.arcsin,
    Operation.ACOS: np.arccos,
    Operation.ATAN: np.arctan,
    Operation.ATAN2: np.arctan2,
    Operation.SINH: np.sinh,
    Operation.COSH: np.cosh,
    Operation.TANH: np.tanh,
}


@dataclass(frozen=True, eq=False)
class Expression:
    """A value that a recorder knows how to make; arithmetic with it is recorded."""

    recorder: Recorder
    node: int

    @property
    def constant(self) -> float | None:
        """Its value, where it does not depend on the inputs."""
        return self.recorder.constant_of(self.node)

    def __add__(self, other: Expression | float) -> Expression:
        return self.recorder.add(self, self.recorder.expression(other))

    def __radd__(self, other: float) -> Expression:
        return self.recorder.expression(other) + self

    def __sub__(self, other: Expression | float) -> Expression:
        return self.recorder.subtract(self, self.recorder.expression(other))

    def __mul__(self, other: Expression | float) -> Expression:
        return self.recorder.multiply(self, self.recorder.expression(other))

    def __rmul__(self, other: float) -> Expression:
        return self.recorder.expression(other) * self

    def __truediv__(self, other: Expression | float) -> Expression:
        return self.recorder.divide(self, self.recorder.expression(other))

    def __pow__(self, other: Expression | float) -> Expression:
        return self.recorder.power(self, self.recorder.expression(other))

    def __neg__(self) -> Expression:
        return self * -1.0


_Key = tuple[Operation, int, int]


@dataclass(eq=False)
class Recorder:
    """Writes down expressions of ``inputs`` values."""

    inputs: int
    _nodes: list[_Key | float | None] = field(default_factory=list)  # None: an input; a number: a constant
    _known: dict[_Key | float, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._nodes.extend([None] * self.inputs)

    def input(self, k: int) -> Expression:
        """The k-th input."""
        return Expression(self, k)

    def expression(self, value: Expression | float) -> Expression:
        """The value itself, or a constant."""
        if isinstance(value, Expression):
            return value
        number = float(value)
        if np.isnan(number) or number == 0.0:  # nan equals nothing, and 0.0 equals -0.0
            self._nodes.append(number)
            return Expression(self, len(self._nodes) - 1)
        return self._noted(number)

    def constant_of(self, node: int) -> float | None:
        """Value of a node that is a constant."""
        value = self._nodes[node]
        return value if isinstance(value, float) else None

    def function(self, operation: Operation, *operands: Expression) -> Expression:
        """A function of one or two operands."""
        values = [operand.constant for operand in operands]
        if None not in values:
            with np.errstate(all="ignore"):
                return self.expression(float(_VALUES[operation](*values)))
        if operation is Operation.SQRT and (root := self._squared(operands[0])) is not None:
            return self._noted((Operation.ABSOLUTE, root, root))
        return self._noted((operation, operands[0].node, operands[-1].node))

    def add(self, a: Expression, b: Expression) -> Expression:
        """A + b."""
        if a.constant is not None and b.constant is not None:
            return self.expression(a.constant + b.constant)
        if a.constant is not None:
            a, b = b, a
        if b.constant is None:
            return self._noted((Operation.ADD, a.node, b.node))
        return a if b.constant == 0.0 else self._noted((Operation.SHIFT, a.node, b.node))

    def subtract(self, a: Expression, b: Expression) -> Expression:
        """A - b."""
        if b.constant is not None:
            return self.add(a, self.expression(-b.constant))
        return self._noted((Operation.SUBTRACT, a.node, b.node))

    def multiply(self, a: Expression, b: Expression) -> Expression:
        """A b; 0 where one of them is 0 all over."""
        if a.constant is not None and b.constant is not None:
            return self.expression(a.constant * b.constant)
        if a.constant is not None:
            a, b = b, a
        if b.constant is None:
            return self._noted((Operation.MULTIPLY, a.node, b.node))
        if b.constant == 0.0:
            return b
        return a if b.constant == 1.0 else self._noted((Operation.SCALE, a.node, b.node))

    def divide(self, a: Expression, b: Expression) -> Expression:
        """A / b."""
        if a.constant is not None and b.constant is not None:
            with np.errstate(all="ignore"):
                return self.expression(float(np.divide(a.constant, b.constant)))
        operation = Operation.DIVIDE if b.constant is None else Operation.QUOTIENT
        return self._noted((operation, a.node, b.node))

    def power(self, a: Expression, b: Expression) -> Expression:
        """A to the power of b: a product where b is a small whole number."""
        if a.constant is not None and b.constant is not None:
            with np.errstate(all="ignore"):
                return self.expression(float(np.power(a.constant, b.constant)))
        exponent = b.constant
        if exponent is None:
            return self._noted((Operation.POWER_OF, a.node, b.node))
        if exponent == 0.0:
            return self.expression(1.0)
        if exponent != round(exponent) or abs(exponent) > _MAX_FACTORS:
            return self._noted((Operation.POWER, a.node, b.node))
        return (
            self._product(a, int(exponent))
            if exponent > 0.0
            else self.expression(1.0) / self._product(a, -int(exponent))
        )

    def _product(self, a: Expression, count: int) -> Expression:
        if count == 1:
            return a
        half = self._product(a, count // 2)
        return half * half * a if count % 2 else half * half

    def _squared(self, a: Expression) -> int | None:
        """What a is the square of, if it was made so."""
        key = self._nodes[a.node]
        return key[1] if isinstance(key, tuple) and key[0] is Operation.MULTIPLY and key[1] == key[2] else None

    def _noted(self, key: _Key | float) -> Expression:
        if key not in self._known:
            self._nodes.append(key)
            self._known[key] = len(self._nodes) - 1
        return Expression(self, self._known[key])

    def tape(self, results: Sequence[Expression]) -> Tape:
        """The instructions that make these results, and no others."""
        needed = self._needed([result.node for result in results])
        constants = [k for k in needed if isinstance(self._nodes[k], float)]
        slot = {k: k for k in range(self.inputs)} | {k: self.inputs + i for i, k in enumerate(constants)}
        last: dict[int, int] = {}  # after which node a value is not needed any more
        for k in needed:
            key = self._nodes[k]
            if isinstance(key, tuple):
                last[key[1]] = last[key[2]] = k
        kept = {result.node for result in results} | set(slot)
        free, slots, steps = list[int](), self.inputs + len(constants), list[tuple[int, int, int, int]]()
        for k in needed:
            key = self._nodes[k]
            if not isinstance(key, tuple):
                continue
            if free:
                slot[k] = free.pop()
            else:
                slot[k], slots = slots, slots + 1
            steps.append((int(key[0]), slot[key[1]], slot[key[2]], slot[k]))
            # A result never stands where an operand does: the compiled code relies on it.
            free += [slot[operand] for operand in {key[1], key[2]} if last[operand] == k and operand not in kept]
        values = [float(self._nodes[k]) for k in constants]  # type: ignore[arg-type]
        code = np.array(steps, dtype=np.int32).reshape(-1, 4)
        rows = np.array([slot[result.node] for result in results], dtype=np.int32)
        return Tape(self.inputs, np.array(values), code, rows, slots)

    def _needed(self, nodes: list[int]) -> list[int]:
        """Every node that these are made of, themselves included, in the order in which they were written down."""
        found, todo = set[int](), nodes
        while todo:
            node = todo.pop()
            if node not in found:
                found.add(node)
                key = self._nodes[node]
                todo = todo + list(key[1:]) if isinstance(key, tuple) else todo
        return sorted(found)


@dataclass(frozen=True, eq=False)
class Tape:
    """Instructions on numbered slots: inputs, then constants, then what is made.

    Attributes
    ----------
    inputs : int
        Number of inputs.
    constants : (c,) array
    steps : (m, 4) array
        An :class:`Operation`, the slots of its two operands and that of its result.
    rows : (k,) array
        Slots of the results.
    slots : int
        Number of slots.
    """

    inputs: int
    constants: FloatArray
    steps: NDArray[np.int32]
    rows: NDArray[np.int32]
    slots: int

    def __call__(self, values: FloatArray, order: int) -> FloatArray:
        """Evaluate the results at n points, and their derivatives up to the order given, 0 to 3.

        Parameters
        ----------
        values : (4, n, inputs) or (1, n, inputs) array
            The inputs and their derivatives with respect to the parameter; values alone are those of the parameter itself.

        Returns
        -------
        (order + 1, n, results) array
            Not finite where the expressions are not.
        """
        n = values.shape[1]
        out = np.empty((order + 1, n, self.rows.size))
        given = values.shape[0], np.ascontiguousarray(values)
        steps = self.steps.shape[0], self.steps, self.inputs, self.constants.size, self.constants
        core.tape_run(*steps, self.rows.size, self.rows, n, order, *given, out, self.room)
        return out

    @property
    def room(self) -> FloatArray:
        """What a block of points takes while it is evaluated."""
        return np.empty(self.slots * _ORDERS * _BLOCK)
