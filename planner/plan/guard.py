"""What must be true of every time law before anybody sees it: its numbers are finite, and neither t nor u falls back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.errors import CurveError, SolverError
from planner.geometry.curve import Curve
from planner.geometry.differential import dot
from planner.law import TimeLaw
from planner.types import FloatArray

# What makes a curve one for which no plan was found: a digit of u against the length of the path, and |C'| against its
# largest value on a piece.
_DIGIT, _SLOW = 1e-9, 1e-5
_SAMPLES = 64  # a piece
_BACKWARD = 1e-9  # of the largest rate of u: slower than that is rounding
_POINTS = 32
# Row k: the Bernstein coefficients of w^k, of degree 4, on [0, 1].
_BERNSTEIN = np.array(
    [[1, 1, 1, 1, 1], [0, 1 / 4, 1 / 2, 3 / 4, 1], [0, 0, 1 / 6, 1 / 2, 1], [0, 0, 0, 1 / 4, 1], [0, 0, 0, 0, 1]]
)


def require_law(curve: Curve, law: TimeLaw) -> None:
    """Refuse a table that is no time law.

    Raises
    ------
    SolverError
        If a number is not finite, or t or u falls back from node to node or between two.
    """
    require_finite_law(curve, law)
    behind = (np.diff(law.t) < 0.0) | (np.diff(law.u) < 0.0)
    if behind.any():
        raise _no_law(curve, law, int(np.argmax(behind)), "falls back from one node to the next")
    back = _falls_back(law)
    if back.any():
        raise _no_law(curve, law, int(np.argmax(back)), "falls back between two nodes")


def require_finite_law(curve: Curve, law: TimeLaw) -> None:
    """Refuse a law with a number that is not finite."""
    unknown = ~np.isfinite([law.t, law.u, law.u_rate, law.u_acceleration]).all(axis=0)
    if unknown.any():
        raise _no_law(curve, law, int(np.argmax(unknown)), "is not finite")


def _no_law(curve: Curve, law: TimeLaw, at: int, what: str) -> SolverError:
    # A node that is not finite has no place of its own; the last one before it has.
    known = np.flatnonzero(np.isfinite(law.u[: at + 1]))
    u = float(law.u[known[-1]]) if known.size else curve.domain[0]
    return SolverError(
        f"{curve.name}: no plan found near u = {u:.9g}, where the time law that was found {what}; split the curve there, "
        "or ask for more intervals"
    )


def _falls_back(law: TimeLaw) -> NDArray[np.bool_]:
    """Intervals (n - 1,) in which u' < 0 beyond rounding; the Bernstein coefficients of u' tell where to look."""
    out = np.zeros(law.t.size - 1, dtype=np.bool_)
    full = np.flatnonzero(np.diff(law.t) > 0.0)
    h = np.diff(law.t)[full]
    power = law.coefficients(full)[1:] * np.arange(1.0, 6.0)[:, None] * h ** np.arange(5)[:, None]
    digit = np.finfo(np.float64).eps * (np.abs(law.u[full + 1]) + np.abs(law.u_rate[full]) * law.t[full + 1])
    allowed = _BACKWARD * float(np.abs(law.u_rate).max(initial=0.0)) + 4.0 * digit / h
    least: FloatArray = (_BERNSTEIN.T @ power).min(axis=0)
    doubtful = np.flatnonzero(least < -allowed)
    w = np.linspace(0.0, 1.0, _POINTS + 1)
    rate = np.einsum("ki,kp->ip", power[:, doubtful], w ** np.arange(5)[:, None])
    out[full[doubtful]] = (rate < -allowed[doubtful, None]).any(axis=1)
    return out


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
