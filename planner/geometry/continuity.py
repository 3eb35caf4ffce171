"""Where a curve is not smooth: which derivative jumps at a parameter, and what that makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.geometry.differential import arc_derivatives
from planner.types import FloatArray, Side

MAX_DERIVATIVE = 3

# Relative sizes below which two one-sided values of the first, second and third derivative count as equal.
_JUMP_TOLERANCES = (1e-8, 1e-7, 1e-5)
# Rounding of a k-th derivative, against the coordinate over the k-th power of the distance to the next break.
_DERIVATIVE_NOISE = 1e3 * np.finfo(np.float64).eps


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

    @property
    def is_corner(self) -> bool:
        """The tangent jumps: every plan stops here."""
        return self.geometric == 0

    @property
    def is_curvature_jump(self) -> bool:
        """The tangent is continuous and the curvature is not: at speed, the acceleration steps here."""
        return self.geometric == 1

    @property
    def is_smooth(self) -> bool:
        """Nothing jumps, with respect to u or to arc length: not a break after all."""
        return min(self.parametric, self.geometric) >= MAX_DERIVATIVE


class OneSided(Protocol):
    """What is asked here of a curve."""

    @property
    def domain(self) -> tuple[float, float]:
        """First and last parameter."""

    @property
    def axis_units(self) -> tuple[str, ...]:
        """``mm`` or ``rad`` for each axis."""

    def derivatives(self, u: ArrayLike, order: int = 3, *, side: Side = "right") -> FloatArray:
        """Derivatives 0..order, from one side."""

    def _candidate_breaks(self) -> FloatArray: ...


def continuity_at(curve: OneSided, u: float) -> Break:
    """Compare the two sides of a parameter, with respect to u and to arc length."""
    return continuity(curve, np.array([u]))[0]


def continuity(curve: OneSided, u: FloatArray) -> list[Break]:
    """Compare the two sides of each parameter, with respect to u and to arc length.

    Two values count as equal where they differ by less than a fraction of their size, or by less than rounding can
    make of them: a k-th derivative is the k-th difference of coordinates over the distance to the next break.  The
    second and third arc-length derivatives are measured against 1/length at least, so that a straight line has none.
    Millimetres and radians are compared apart: beside 1e8 mm of X the turn of a rotary axis is no rounding.

    Where the curve rests on one side there is no tangent to compare: geometric order 0, angle 0.
    """
    u0, u1 = curve.domain
    sides = np.stack([curve.derivatives(u, 3, side="left"), curve.derivatives(u, 3, side="right")])
    size = np.abs(sides).max(axis=(0, -1))
    edges = np.concatenate([[u0], curve._candidate_breaks(), [u1]])
    fence = np.concatenate([[-np.inf], edges, [np.inf]])
    before, after = fence[np.searchsorted(edges, u, side="left")], fence[np.searchsorted(edges, u, side="right") + 1]
    gap = np.minimum(u - before, after - u)
    power = np.arange(4)[:, None]
    tolerance = np.array([0.0, *_JUMP_TOLERANCES])[:, None]

    speed = np.sqrt(np.sum(sides[:, 1] ** 2, axis=-1)).min(axis=0)
    moving = speed > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        arcs = np.stack([arc_derivatives(d) for d in sides])
        chord = np.sqrt(np.sum((arcs[0, 1] - arcs[1, 1]) ** 2, axis=-1))
        bend_jump = np.abs(arcs[0] - arcs[1])[2].max(axis=-1)
    parametric = geometric = np.full(u.size, MAX_DERIVATIVE)
    for unit, mean in _mean_slopes(curve, edges).items():
        axes = np.array(curve.axis_units) == unit
        own, along = sides[..., axes], arcs[..., axes]
        jump, own_size = np.abs(own[0] - own[1]).max(axis=-1), np.abs(own).max(axis=(0, -1))
        noise = _DERIVATIVE_NOISE * np.maximum(own_size[0], own_size[1] * gap) / gap**power
        parametric = np.minimum(parametric, _order(jump <= tolerance * own_size + noise))
        with np.errstate(divide="ignore", invalid="ignore"):
            arc_size = np.abs(along).max(axis=(0, -1))
            bend = np.maximum(arc_size[2], mean / ((u1 - u0) * speed))
            arc_size = np.maximum(arc_size, np.stack([np.zeros_like(bend), mean + 0.0 * bend, bend, bend**2 / mean]))
            arc_jump = np.abs(along[0] - along[1]).max(axis=-1)
            geometric = np.minimum(geometric, _order(arc_jump <= tolerance * arc_size + noise / speed**power))
    at_rest = size[1:].max(axis=0) == 0.0
    geometric = np.where(moving, geometric, np.where(at_rest, MAX_DERIVATIVE, 0))
    angle = np.where(moving, 2.0 * np.arcsin(np.minimum(1.0, 0.5 * np.nan_to_num(chord))), 0.0)
    bend_jump = np.where(moving, np.nan_to_num(arc_jump[2]), 0.0)
    rows = zip(u, parametric, geometric, angle, bend_jump, strict=True)
    return [Break(float(at), int(p), int(g), float(turn), float(bends)) for at, p, g, turn, bends in rows]


def _mean_slopes(curve: OneSided, edges: FloatArray) -> dict[str, float]:
    """Typical size of the tangent's components of each unit: the share of its axes in the way, 1 for the larger one."""
    units = np.array(curve.axis_units)
    if (units == units[0]).all():
        return {str(units[0]): 1.0}
    points = curve.derivatives(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]), 0)[0]
    extents = {str(unit): float(np.ptp(points[:, units == unit], axis=0).max()) for unit in np.unique(units)}
    largest = max(extents.values())
    return {unit: extent / largest if extent > 0.0 else 1.0 for unit, extent in extents.items()}


def _order(equal: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Highest k such that the derivatives 1..k are equal, from ``equal (4, n)``."""
    return np.asarray(np.cumprod(equal[1:], axis=0).sum(axis=0))
