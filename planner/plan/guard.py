"""What must be true of every time law before anybody sees it: its numbers are finite, and neither t nor u falls back."""

from __future__ import annotations

import numpy as np

from planner.compiled import core
from planner.errors import CurveError, SolverError
from planner.geometry.curve import Curve
from planner.geometry.differential import dot
from planner.law import TimeLaw

# What makes a curve one for which no plan was found: a digit of u against the length of the path, and |C'| against its
# largest value on a piece.
_DIGIT, _SLOW = 1e-9, 1e-5
_SAMPLES = 64  # a piece
# What the compiled look finds, by its number.
_DEFECTS = ("", "is not finite", "falls back from one node to the next", "falls back between two nodes")


def require_law(curve: Curve, law: TimeLaw) -> None:
    """Refuse a table that is no time law.

    Raises
    ------
    SolverError
        If a number is not finite, or t or u falls back from node to node or between two.
    """
    at = np.empty(1, dtype=np.int64)
    defect = core.guard_first_defect(law.t.size, law.t, law.u, law.u_rate, law.u_acceleration, at)
    if defect:
        raise _no_law(curve, law, int(at[0]), _DEFECTS[defect])


def require_finite_law(curve: Curve, law: TimeLaw) -> None:
    """Refuse a law with a number that is not finite."""
    unknown = ~np.isfinite([law.t, law.u, law.u_rate, law.u_acceleration]).all(axis=0)
    if unknown.any():
        raise _no_law(curve, law, int(np.argmax(unknown)), _DEFECTS[1])


def _no_law(curve: Curve, law: TimeLaw, at: int, what: str) -> SolverError:
    # A node that is not finite has no place of its own; the last one before it has.
    known = np.flatnonzero(np.isfinite(law.u[: at + 1]))
    u = float(law.u[known[-1]]) if known.size else curve.domain[0]
    return SolverError(
        f"{curve.name}: no plan found near u = {u:.9g}, where the time law that was found {what}; split the curve there, "
        "or ask for more intervals"
    )


def explained(curve: Curve, error: SolverError, start: float, end: float) -> SolverError | CurveError:
    """The same error, of the curve where it has between these parameters what the digits of a plan do not resolve."""
    edges = curve.pieces.breaks
    edges = np.concatenate([[start], edges[(edges > start) & (edges < end)], [end]])
    # Ever closer to both ends, and these from inside: |C'| is as small, or as large, there as anywhere.
    near = np.geomspace(1e-12, 0.5, _SAMPLES // 2)
    share = np.concatenate([[0.0], near, 1.0 - near[::-1], [1.0]])
    u = edges[:-1, None] + np.diff(edges)[:, None] * share
    u[:, -1] = edges[1:]
    velocity = curve.pieces.evaluate(u.reshape(-1), 1, np.tile(share == 1.0, edges.size - 1))[1]
    speed = np.sqrt(dot(velocity, velocity)).reshape(u.shape)
    digit = np.spacing(np.abs(u)) * speed
    slowness = speed / speed.max(axis=1, keepdims=True)
    length = float(np.sum(0.5 * (speed[:, 1:] + speed[:, :-1]) * np.diff(u, axis=1)))
    if digit.max() > _DIGIT * length:
        at = np.unravel_index(int(digit.argmax()), digit.shape)
        return CurveError(
            f"{error}. What is special there: a digit of u is worth {digit[at]:.3g} mm of the path at u = {u[at]:.9g}; let "
            "the parameter begin near 0, or spread it more evenly"
        )
    if slowness.min() < _SLOW:
        at = np.unravel_index(int(slowness.argmin()), slowness.shape)
        return CurveError(
            f"{error}. What is special there: |C'| falls to {slowness[at]:.2g} of its largest value on its piece at u = "
            f"{u[at]:.9g}, all but a cusp; remove the control point that nearly coincides with another"
        )
    return error
