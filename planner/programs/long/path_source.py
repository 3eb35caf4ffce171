"""What the path of a long program is made from: the program, and a cursor that says where its next part begins, and how."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.machine.limits import Limits
from planner.programs.long.run import Run
from planner.programs.path.absorb import Absorbed, absorb
from planner.programs.path.moves import MovingBlocks, ProgramAxes
from planner.programs.reading.program import Program
from planner.types import FloatArray


@dataclass(frozen=True, eq=False)
class Cursor:
    """Where a part begins, and how.

    Attributes
    ----------
    row : int
        Move that it begins in, of those that absorption leaves.
    offset : float
        How far along it, mm.
    entry : (4, dim) array or None
        Position and three derivatives there, inside a tube.
    rests : bool
        The path is at rest there.
    blocks : int
        How many blocks to look at.
    tail : Run or None
        The end of the part before it.
    deferred : float
        Tolerance of the last ``_DEFERRED`` tolerances before it, which have not been measured; 0 if all has been.
    """

    row: int
    offset: float
    entry: FloatArray | None
    rests: bool
    blocks: int
    tail: Run | None
    deferred: float


@dataclass(frozen=True, eq=False)
class PathSource:
    """A program, and what its path depends on besides: axes that move, the tolerance in place of its own, limits.

    ``limits`` are those that shape a path which is made separately; for ``joint`` ones path and feed are found together
    where they can be, None to make all of it separately.
    """

    program: Program
    used: ProgramAxes
    tolerance: float | None
    limits: Limits
    joint: Limits | None = None

    @cached_property
    def row(self) -> NDArray[np.intp]:
        """The moves of the program with a length."""
        return np.flatnonzero(self.program.lengths > 0.0)

    @cached_property
    def absorbed(self) -> Absorbed:
        """What absorption leaves of the program: the same for every part, so that parts join."""
        return absorb(self.program, MovingBlocks.of(self.program, self.tolerance, self.used))

    def given(self, first: int, last: int) -> slice:
        """Which of ``row`` the moves from ``first`` to before ``last`` stand for."""
        begin, end = np.searchsorted(self.absorbed.owner, [first, last])
        return slice(int(begin), int(end))
