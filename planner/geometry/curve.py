"""The tool path as a parametric curve.

A :class:`Curve` answers one question, ``derivatives(u)``, from either side of a break; everything else here (breaks
with their order of continuity, curvature, compiled pieces) follows from that answer.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import CurveError, InputError

if TYPE_CHECKING:
    from planner.geometry.arclength import ArcLength

FloatArray = NDArray[np.float64]
Side = Literal["left", "right"]

ROTARY_AXES = frozenset("ABC")
DEFAULT_AXES = ("X", "Y", "Z", "U", "V", "W")
MAX_DERIVATIVE = 3

# Relative sizes below which two one-sided values count as equal.  Evaluation noise grows by about the number of
# pieces over the length with each derivative, hence the looser figures for the higher ones.
_TANGENT_TOLERANCE = 1e-8
_CURVATURE_TOLERANCE = 1e-7
_CURVATURE_RATE_TOLERANCE = 1e-5
# |C'| below this fraction of its largest value is a cusp: the unit tangent is lost to cancellation there.
_CUSP_TOLERANCE = 1e-9
_SCAN_POINTS_PER_PIECE = 48


@dataclass(frozen=True)
class Break:
    """A parameter at which a curve is not smooth.

    Attributes
    ----------
    u : float
        Curve parameter.
    parametric : int
        Highest k (0..3) for which the k-th derivative with respect to u is continuous.
    geometric : int
        The same for derivatives with respect to arc length: 0 position only (a corner), 1 tangent, 2 curvature,
        3 the derivative of curvature too.
    angle : float
        Turn of the tangent, rad.
    curvature_jump : float
        Largest component of the jump of the second arc-length derivative, 1/mm.
    """

    u: float
    parametric: int
    geometric: int
    angle: float
    curvature_jump: float


@dataclass(frozen=True, eq=False)
class Pieces:
    """A curve as (rational) polynomials in power basis: what compiled code reads (see ``kernels``).

    Attributes
    ----------
    breaks : (m + 1,) array
        Parameters at which the pieces join, increasing.
    coefficients : (m, dim + 1, degree + 1) array
        Ascending powers of the local parameter in [0, 1]; the last row of each piece is the denominator.
    rational : bool
        False where every denominator is 1.
    """

    breaks: FloatArray
    coefficients: FloatArray
    rational: bool

    def __post_init__(self) -> None:
        for array in (self.breaks, self.coefficients):
            array.setflags(write=False)

    def evaluate(self, u: FloatArray, order: int, side: Side) -> FloatArray:
        """Evaluate derivatives 0..order at the flat array u; returns ``(order + 1, n, dim)``."""
        from planner.geometry.kernels import evaluate_pieces

        out = np.empty((order + 1, u.size, self.coefficients.shape[1] - 1))
        evaluate_pieces(self.breaks, self.coefficients, self.rational, u, side == "left", order, out)
        return out


class Curve(ABC):
    """A parametric tool path in machine axes.

    Subclasses provide ``name``, ``domain``, ``axes`` and :meth:`_evaluate`.  Curves are immutable.
    """

    name: str
    domain: tuple[float, float]
    axes: tuple[str, ...]

    @abstractmethod
    def _evaluate(self, u: FloatArray, order: int, side: Side) -> FloatArray:
        """Derivatives 0..order at the flat array u within the domain; returns ``(order + 1, n, dim)``."""

    @property
    @abstractmethod
    def pieces(self) -> Pieces:
        """The curve for compiled code; exact for B-splines, fitted otherwise."""

    @abstractmethod
    def definition(self) -> Mapping[str, Any]:
        """Everything that determines the curve, as plain data; hashed into :attr:`fingerprint`."""

    @property
    def dim(self) -> int:
        """Number of machine axes."""
        return len(self.axes)

    @property
    def axis_units(self) -> tuple[str, ...]:
        """``mm`` or ``rad`` for each axis: A, B and C are rotary."""
        return tuple("rad" if axis in ROTARY_AXES else "mm" for axis in self.axes)

    @cached_property
    def tip(self) -> Curve:
        """The path of the tool tip, on which feed and chord error are measured: the linear axes."""
        linear = tuple(j for j, axis in enumerate(self.axes) if axis not in ROTARY_AXES)
        return self if len(linear) == self.dim else AxesSubset(self, linear)

    def derivatives(self, u: ArrayLike, order: int = 3, *, side: Side = "right") -> FloatArray:
        """Evaluate the machine axes and their derivatives with respect to u.

        Parameters
        ----------
        u : array_like
            Curve parameters within ``domain``.
        order : int
            Highest derivative, 0 to 3.
        side : {"right", "left"}
            Which one-sided value to take at a break.  At the ends of the domain the inner one is taken.

        Returns
        -------
        ndarray, shape (order + 1,) + u.shape + (dim,)
            Index 0 is the position (mm or rad), index k the k-th derivative.

        Raises
        ------
        InputError
            If a parameter is not finite or outside the domain, or the order or side is not one of those above.
        """
        if order not in range(MAX_DERIVATIVE + 1):
            raise InputError(f"order = {order!r} must be 0, 1, 2 or 3")
        if side not in {"left", "right"}:
            raise InputError(f'side = {side!r} must be "left" or "right"')
        points = np.asarray(u, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1))
        u0, u1 = self.domain
        outside = ~((flat >= u0) & (flat <= u1))
        if outside.any():
            place = int(np.argmax(outside))
            raise InputError(
                f"u[{place}] = {flat[place]!r} must lie within [{u0!r}, {u1!r}], the domain of {self.name}"
            )
        return self._evaluate(flat, order, side).reshape((order + 1, *points.shape, self.dim))

    def curvature(self, u: ArrayLike, *, side: Side = "right") -> FloatArray:
        """Curvature |C' x C''| / |C'|^3 at every u, in 1/mm; 0 where the curve rests."""
        d = self.derivatives(u, 2, side=side)
        speed2 = np.sum(d[1] ** 2, axis=-1)
        dot = np.sum(d[1] * d[2], axis=-1)
        # |C'|^2 |C''|^2 - (C'.C'')^2 cancels; the normal part of C'' does not.
        with np.errstate(divide="ignore", invalid="ignore"):
            normal = d[2] - (dot / speed2)[..., None] * d[1]
            kappa = np.sqrt(np.sum(normal**2, axis=-1)) / speed2
        return np.where(speed2 > 0.0, kappa, 0.0)

    @cached_property
    def breaks(self) -> tuple[Break, ...]:
        """Interior parameters where a derivative up to the third jumps, with the order of continuity there."""
        found = (continuity_at(self, u) for u in self._candidate_breaks())
        return tuple(b for b in found if min(b.parametric, b.geometric) < MAX_DERIVATIVE)

    @cached_property
    def arclength(self) -> ArcLength:
        """Arc length of the tool tip, s(u) and u(s)."""
        from planner.geometry.arclength import ArcLength

        return ArcLength.of_tip(self)

    @property
    def length(self) -> float:
        """Length of the tool-tip path, mm."""
        return self.arclength.total

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the definition, written into tables so that a table is never replayed on another curve."""
        text = json.dumps(self.definition(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    def _candidate_breaks(self) -> FloatArray:
        """Interior parameters at which a derivative may jump."""
        return np.empty(0)


@dataclass(frozen=True, eq=False)
class AxesSubset(Curve):
    """Some of the axes of another curve: the tool tip of a machine with rotary axes."""

    parent: Curve
    columns: tuple[int, ...]

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the parent."""
        return f"{self.parent.name} (tool tip)"

    @property
    def domain(self) -> tuple[float, float]:  # type: ignore[override]
        """Domain of the parent."""
        return self.parent.domain

    @property
    def axes(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the axes kept."""
        return tuple(self.parent.axes[j] for j in self.columns)

    def _evaluate(self, u: FloatArray, order: int, side: Side) -> FloatArray:
        return self.parent._evaluate(u, order, side)[..., list(self.columns)]

    @cached_property
    def pieces(self) -> Pieces:
        """The parent's pieces, fewer rows."""
        whole = self.parent.pieces
        rows = [*self.columns, self.parent.dim]
        return Pieces(whole.breaks, np.ascontiguousarray(whole.coefficients[:, rows]), whole.rational)

    def definition(self) -> Mapping[str, Any]:
        """Parent and columns."""
        return {"parent": self.parent.definition(), "columns": list(self.columns)}

    def _candidate_breaks(self) -> FloatArray:
        return self.parent._candidate_breaks()


def arc_derivatives(d: FloatArray) -> FloatArray:
    """Derivatives with respect to arc length from those with respect to u.

    With v = |C'|, v' = C'.C''/v and v'' = (|C''|^2 + C'.C''' - v'^2)/v,

        C_s = C'/v,   C_ss = (C'' - v' C_s)/v^2,   C_sss = (C''' - 3 v v' C_ss - v'' C_s)/v^3.

    Parameters
    ----------
    d : (4, n, dim) array
        Derivatives 0..3 with respect to u, with |C'| > 0.

    Returns
    -------
    (4, n, dim) array
    """
    v = np.sqrt(np.sum(d[1] ** 2, axis=-1))[:, None]
    v1 = np.sum(d[1] * d[2], axis=-1)[:, None] / v
    v2 = (np.sum(d[2] ** 2, axis=-1)[:, None] + np.sum(d[1] * d[3], axis=-1)[:, None] - v1**2) / v
    tangent = d[1] / v
    second = (d[2] - v1 * tangent) / v**2
    third = (d[3] - 3.0 * v * v1 * second - v2 * tangent) / v**3
    return np.stack([d[0], tangent, second, third])


def continuity_at(curve: Curve, u: float) -> Break:
    """Compare the two sides of a parameter, with respect to u and to arc length."""
    at = np.array([u])
    left = curve.derivatives(at, 3, side="left")[:, 0]
    right = curve.derivatives(at, 3, side="right")[:, 0]
    u0, u1 = curve.domain
    arc = arc_derivatives(np.stack([left, right], axis=1))
    size = max(float(np.abs(arc[2]).max()), (u1 - u0) ** -1 / max(float(np.abs(left[1]).max()), 1e-300))
    scales = (1.0, size, size**2)
    tolerances = (_TANGENT_TOLERANCE, _CURVATURE_TOLERANCE, _CURVATURE_RATE_TOLERANCE)
    geometric = parametric = 0
    for k in (1, 2, 3):
        jump = float(np.abs(arc[k, 0] - arc[k, 1]).max())
        if geometric == k - 1 and jump <= tolerances[k - 1] * max(float(np.abs(arc[k]).max()), scales[k - 1]):
            geometric = k
        reach = max(float(np.abs(left[k]).max()), float(np.abs(right[k]).max()), 1e-300)
        if parametric == k - 1 and float(np.abs(left[k] - right[k]).max()) <= tolerances[k - 1] * reach:
            parametric = k
    chord = float(np.sqrt(np.sum((arc[1, 0] - arc[1, 1]) ** 2)))
    return Break(
        u=float(u),
        parametric=parametric,
        geometric=geometric,
        angle=2.0 * float(np.arcsin(min(1.0, 0.5 * chord))),
        curvature_jump=float(np.abs(arc[2, 0] - arc[2, 1]).max()),
    )


def require_regular(curve: Curve) -> None:
    """Raise CurveError where the curve is not finite, has no length, or has a cusp (|C'| = 0).

    |C'|^2 is scanned between the candidate breaks and every low local minimum is refined by golden-section search, so a
    zero between two scan points is found.
    """
    u0, u1 = curve.domain
    corners = np.concatenate([[u0], curve._candidate_breaks(), [u1]])
    steps = np.linspace(0.0, 1.0, _SCAN_POINTS_PER_PIECE + 1)
    u = np.unique((corners[:-1, None] + np.diff(corners)[:, None] * steps).reshape(-1))
    u = np.clip(u, u0, u1)
    d = curve.derivatives(u, 3)
    if not np.isfinite(d).all():
        place = int(np.argmax(~np.isfinite(d).all(axis=(0, 2))))
        raise CurveError(f"{curve.name}: not finite at u = {u[place]:.9g}; position and three derivatives must be")
    speed2 = np.sum(d[1] ** 2, axis=-1)
    top = float(speed2.max())
    if top == 0.0:
        raise CurveError(
            f"{curve.name}: the curve has length 0 (every point is {d[0, 0].tolist()}); it must have a length"
        )
    padded = np.concatenate([[np.inf], speed2, [np.inf]])
    low = np.flatnonzero((speed2 <= padded[:-2]) & (speed2 <= padded[2:]) & (speed2 < 0.05 * top))
    if low.size == 0:
        return
    lo, hi = u[np.maximum(low - 1, 0)], u[np.minimum(low + 1, u.size - 1)]
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    for _ in range(60):
        inner, outer = hi - golden * (hi - lo), lo + golden * (hi - lo)
        f = [np.sum(curve.derivatives(x, 1)[1] ** 2, axis=-1) for x in (inner, outer)]
        keep = f[0] <= f[1]
        lo, hi = np.where(keep, lo, inner), np.where(keep, outer, hi)
    candidates = np.concatenate([u[low], 0.5 * (lo + hi)])
    speed = np.sqrt(np.sum(curve.derivatives(candidates, 1)[1] ** 2, axis=-1))
    worst = int(np.argmin(speed))
    if speed[worst] < _CUSP_TOLERANCE * np.sqrt(top):
        raise CurveError(
            f"{curve.name}: |C'| = {speed[worst]:.3g} at u = {candidates[worst]:.9g} is a cusp (largest |C'| is "
            f"{np.sqrt(top):.3g}); a curve must have a tangent everywhere: split it there, or remove repeated control points"
        )
