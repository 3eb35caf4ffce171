"""A dual B-spline tool path on a table-tilting A/C machine.

Two splines guide the tool: P(u) its tip, H(u) a point on its axis.  The machine positions the workpiece under a fixed
spindle, so the axes follow from P and the unit tool axis O = (H - P)/|H - P| by

    A = atan2(sqrt(Oi^2 + Oj^2), Ok),   C = atan2(Oi, Oj),
    [X Y Z]' = [[cosC, -sinC, 0], [cosA sinC, cosA cosC, -sinA], [sinA sinC, sinA cosC, cosA]] P

(Ma, Yuan, Shen, Gao, J. Computational Design and Engineering 9 (2022) 2355-2374, section 4.3).  The splines' own
derivatives enter a tape of that map, which gives exact axis derivatives.  Sines and cosines of A and C are ratios of the
coordinates of O, so that only the angles themselves need a function.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from planner.compiled import core
from planner.errors import CurveError
from planner.geometry.curve import Curve, Pieces, golden_minimum, require_regular
from planner.geometry.fit import fit_pieces
from planner.geometry.nurbs import NurbsCurve
from planner.geometry.tape import Operation, Recorder, Tape
from planner.types import BoolArray, FloatArray

_POLE_TOLERANCE = 1e-9  # sin A below this: C has no direction
_UNWRAP_POINTS_PER_SPAN = 64


@dataclass(frozen=True, eq=False, repr=False)
class DualSplineCurve(Curve):
    """Machine axes X, Y, Z, A, C of a flank-milling path; ``tip`` is the bottom spline in workpiece coordinates.

    Parameters
    ----------
    bottom, top : NurbsCurve
        Tool tip and a point on the tool axis, three dimensions, one knot vector.
    """

    bottom: NurbsCurve
    top: NurbsCurve
    name: str = "dual_bspline_5axis"
    axes: tuple[str, ...] = ("X", "Y", "Z", "A", "C")

    def __post_init__(self) -> None:
        if self.bottom.dim != 3 or self.top.dim != 3:
            raise CurveError(f"{self.name}: bottom and top control points must have 3 columns each")
        if self.bottom.domain != self.top.domain:
            raise CurveError(f"{self.name}: bottom and top must share a parameter range")
        self._require_tool_axis()
        require_regular(self)

    def _require_tool_axis(self) -> None:
        """Raise CurveError where bottom and top meet, or C is undefined because the tool axis is vertical."""
        u, splines = self._scan
        across = np.hypot(*(splines[1] - splines[0]).T[:2])
        low = 1 + np.flatnonzero((across[1:-1] <= across[:-2]) & (across[1:-1] <= across[2:]))

        def tool_axis(at: FloatArray) -> FloatArray:
            return np.asarray(self.top.derivatives(at, 0)[0] - self.bottom.derivatives(at, 0)[0])

        refined, _ = golden_minimum(lambda at: np.hypot(*tool_axis(at).T[:2]), u[low - 1], u[low + 1])
        at = np.concatenate([u, refined])
        axis = tool_axis(at)
        length = np.hypot(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])
        shortest = int(np.argmin(length))
        if length[shortest] <= _POLE_TOLERANCE * length.max():
            raise CurveError(f"{self.name}: bottom and top meet at u = {at[shortest]:.9g}; there is no tool axis there")
        sine = np.hypot(axis[:, 0], axis[:, 1]) / length
        steepest = int(np.argmin(sine))
        if sine[steepest] < _POLE_TOLERANCE:
            raise CurveError(
                f"{self.name}: the tool axis is vertical at u = {at[steepest]:.9g}, where C is undefined; tilt it there"
            )

    @property
    def domain(self) -> tuple[float, float]:  # type: ignore[override]
        """Parameter range of both splines."""
        return self.bottom.domain

    @cached_property
    def tip(self) -> Curve:
        """The bottom spline."""
        return self.bottom

    @cached_property
    def pieces(self) -> Pieces:
        """Polynomial pieces fitted to the machine axes."""
        return fit_pieces(self)

    def _candidate_breaks(self) -> FloatArray:
        return np.union1d(self.bottom._candidate_breaks(), self.top._candidate_breaks())

    @cached_property
    def _scan(self) -> tuple[FloatArray, FloatArray]:
        """Parameters dense enough to follow C, and both splines there, (2, n, 3)."""
        u0, u1 = self.domain
        corners = np.concatenate([[u0], self._candidate_breaks(), [u1]])
        steps = np.linspace(0.0, 1.0, _UNWRAP_POINTS_PER_SPAN, endpoint=False)
        u = np.append((corners[:-1, None] + np.diff(corners)[:, None] * steps).reshape(-1), u1)
        return u, np.stack([self.bottom.derivatives(u, 0)[0], self.top.derivatives(u, 0)[0]])

    @cached_property
    def _unwrapped(self) -> FloatArray:
        """C without the jumps of atan2, at the scan's parameters."""
        bottom, top = self._scan[1]
        axis = top - bottom
        return np.unwrap(np.arctan2(axis[:, 0], axis[:, 1]))

    def _evaluate(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        return self._compiled(u, order, left, None)

    def _evaluate_with_tip(self, u: FloatArray, order: int, left: BoolArray) -> tuple[FloatArray, FloatArray]:
        tip = np.empty((order + 1, u.size, self.bottom.dim))
        return self._compiled(u, order, left, tip), tip

    def _compiled(self, u: FloatArray, order: int, left: BoolArray, tip: FloatArray | None) -> FloatArray:
        """Axes, and written into ``tip`` what is known of the bottom spline anyway."""
        out, work = np.empty((order + 1, u.size, len(self.axes))), _machine_axes().room
        core.fiveaxis_evaluate(*self._arrays, u.size, u, left, order, out, tip, work)
        return out

    @cached_property
    def _arrays(self) -> tuple[Any, ...]:
        """Both splines, the map to the axes and the turns of C, as the compiled evaluation takes them."""
        splines = [spline.pieces.arguments for spline in (self.bottom, self.top)]
        tape, places = _machine_axes(), self._scan[0]
        code = tape.steps.shape[0], tape.steps, tape.constants.size, tape.constants, tape.rows
        without_dim = [item for count, _, *others in splines for item in (count, *others)]
        return (*without_dim, *code, places.size, places, self._unwrapped)

    def definition(self) -> Mapping[str, Any]:
        """Both splines."""
        return {"type": "dual_bspline_5axis", "bottom": self.bottom.definition(), "top": self.top.definition()}


@cache
def _machine_axes() -> Tape:
    """Map points on both splines, (6,), to the axes, (5,)."""
    recorder = Recorder(6)
    p, h = ([recorder.input(3 * k + j) for j in range(3)] for k in range(2))
    axis = [h[j] - p[j] for j in range(3)]
    across = recorder.function(Operation.SQRT, axis[0] ** 2 + axis[1] ** 2)
    length = recorder.function(Operation.SQRT, axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    sin_a, cos_a, sin_c, cos_c = across / length, axis[2] / length, axis[0] / across, axis[1] / across
    turned = sin_c * p[0] + cos_c * p[1]
    return recorder.tape(
        [
            cos_c * p[0] - sin_c * p[1],
            cos_a * turned - sin_a * p[2],
            sin_a * turned + cos_a * p[2],
            recorder.function(Operation.ATAN2, across, axis[2]),
            recorder.function(Operation.ATAN2, axis[0], axis[1]),
        ]
    )
