"""CasADi expressions evaluated over whole arrays of points.

CasADi differentiates; its virtual machine then runs the expression once for every point.  A :class:`Tape` runs the same
list of instructions once for a block of points, one numpy operation an instruction, which is 10 to 40 times faster.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from planner.types import FloatArray

# Points per block: the registers of a block, some 30 of them, then stay in the processor's cache.
_BLOCK = 2048


@dataclass(frozen=True, eq=False)
class Tape:
    """A list of instructions on numbered slots: registers, then inputs, then constants, then outputs.

    Attributes
    ----------
    registers : int
        Number of registers.
    inputs : int
        Number of inputs.
    constants : tuple of float
    rows : int
        Components of each output; all outputs have as many.
    steps : tuple of (ufunc, operand slots, target slot)
    ends : tuple of int
        ``steps[:ends[k]]`` computes the outputs 0..k.
    """

    registers: int
    inputs: int
    constants: tuple[float, ...]
    rows: int
    steps: tuple[tuple[Callable[..., Any], tuple[int, ...], int], ...]
    ends: tuple[int, ...]

    @classmethod
    def record(cls, inputs: Any, outputs: Sequence[Any]) -> Tape:
        """Record the instructions that take a CasADi column of symbols to columns of one common height."""
        import casadi

        # A derivative that is zero everywhere would be left out of a sparse column.
        dense = [casadi.densify(output) for output in outputs]
        function = casadi.Function("tape", [inputs], dense, {"cse": True})
        operations = _operations()
        count = function.n_instructions()
        codes = [function.instruction_id(k) for k in range(count)]
        fixed = [k for k in range(count) if codes[k] == casadi.OP_CONST]
        constants = tuple(float(function.instruction_constant(k)) for k in fixed)
        registers, height, rows = int(function.sz_w()), int(inputs.numel()), int(outputs[0].numel())
        first_output = registers + height + len(constants)
        constant_slot = {k: registers + height + i for i, k in enumerate(fixed)}
        slot = list(range(registers))  # where the value of each register is found
        steps: list[tuple[Callable[..., Any], tuple[int, ...], int]] = []
        ends = [0] * len(outputs)
        for k, code in enumerate(codes):
            source, target = function.instruction_input(k), function.instruction_output(k)
            if code == casadi.OP_CONST:
                slot[target[0]] = constant_slot[k]
            elif code == casadi.OP_INPUT:
                slot[target[0]] = registers + source[1]
            elif code == casadi.OP_OUTPUT:
                steps.append((np.positive, (slot[source[0]],), first_output + target[0] * rows + target[1]))
                ends[target[0]] = len(steps)
            else:
                operands = tuple(slot[i] for i in source)
                slot[target[0]] = target[0]
                steps.append((operations[code], operands, target[0]))
        return cls(registers, height, constants, rows, tuple(steps), tuple(np.maximum.accumulate(ends).tolist()))

    def __call__(self, inputs: FloatArray, count: int) -> FloatArray:
        """Evaluate the first outputs at n points.

        Parameters
        ----------
        inputs : (m, n) array
            A row for every input.
        count : int
            Number of outputs.

        Returns
        -------
        (count, n, rows) array
            Not finite where the expressions are not.
        """
        n = inputs.shape[1]
        out = np.empty((count, n, self.rows))
        work = np.empty((self.registers, min(n, _BLOCK)))
        constants = [np.float64(value) for value in self.constants]
        steps = self.steps[: self.ends[count - 1]]
        with np.errstate(all="ignore"):
            for start in range(0, n, _BLOCK):
                block = slice(start, min(start + _BLOCK, n))
                slots: list[Any] = list(work[:, : block.stop - start])
                slots += list(inputs[:, block])
                slots += constants
                slots += [out[k, block, j] for k in range(count) for j in range(self.rows)]
                for operation, operands, target in steps:
                    operation(*[slots[i] for i in operands], out=slots[target])
        return out


def _twice(x: FloatArray, out: FloatArray) -> FloatArray:
    return np.add(x, x, out=out)


@cache
def _operations() -> dict[int, Callable[..., Any]]:
    """Numpy's counterpart of each CasADi operation that the smooth functions and their derivatives consist of."""
    import casadi

    return {
        casadi.OP_ASSIGN: np.positive,
        casadi.OP_ADD: np.add,
        casadi.OP_SUB: np.subtract,
        casadi.OP_MUL: np.multiply,
        casadi.OP_DIV: np.divide,
        casadi.OP_NEG: np.negative,
        casadi.OP_INV: np.reciprocal,
        casadi.OP_SQ: np.square,
        casadi.OP_TWICE: _twice,
        casadi.OP_POW: np.power,
        casadi.OP_CONSTPOW: np.power,
        casadi.OP_SQRT: np.sqrt,
        casadi.OP_FABS: np.abs,  # what CasADi makes of sqrt(x**2)
        casadi.OP_SIGN: np.sign,
        casadi.OP_EXP: np.exp,
        casadi.OP_LOG: np.log,
        casadi.OP_SIN: np.sin,
        casadi.OP_COS: np.cos,
        casadi.OP_TAN: np.tan,
        casadi.OP_ASIN: np.arcsin,
        casadi.OP_ACOS: np.arccos,
        casadi.OP_ATAN: np.arctan,
        casadi.OP_ATAN2: np.arctan2,
        casadi.OP_SINH: np.sinh,
        casadi.OP_COSH: np.cosh,
        casadi.OP_TANH: np.tanh,
    }
