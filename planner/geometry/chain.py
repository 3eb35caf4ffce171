"""A path composed of lines, arcs, cubic blends and spline spans, one after the other.

The parameter is the arc length, exactly on legs and blends and nearly on spline spans, so that a chain whose pieces join
with continuous curvature is C2 in it and can be planned in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import CurveError
from planner.geometry.blend import Blends, Legs
from planner.geometry.continuity import Break, continuity
from planner.geometry.curve import AXES, DEFAULT_AXES, Curve, FeedCaps, Pieces, axis_names
from planner.geometry.differential import speed_derivatives
from planner.geometry.fit import interpolate
from planner.geometry.tolerance import PathTolerance
from planner.law import Timing
from planner.types import BoolArray, FloatArray

_FIT_TOLERANCE = 1e-13  # of the unit tangent
_ANGLE_ROUNDING = 2.0 * np.finfo(np.float64).eps  # of the unit tangent of an arc, by its angle
_MAX_HALVINGS = 24
_PROBES = 24
INTERVALS_OF_KIND = np.array([4, 110, 4])  # of a plan that resolve a leg, a blend and a span


class Kind(IntEnum):
    """What a piece of a chain is."""

    LEG = 0
    BLEND = 1
    SPAN = 2


@dataclass(frozen=True, eq=False, repr=False)
class ChainCurve(Curve):
    """Pieces of three kinds, joined.

    Attributes
    ----------
    edges : (m + 1,) array
        Parameters at which the pieces join, mm, increasing.
    kind : (m,) int array
        A :class:`Kind` each.
    row : (m,) int array
        Where the piece is in ``legs``, ``blends`` or ``spans``.
    offset : (m,) array
        Distance from the start of the leg to the start of the piece, mm; 0 for the other kinds.
    legs, blends : Legs, Blends or None
        Their columns are the axes and, where a feed is measured on others than X Y Z, those of the path it is measured on.
    spans : (k, columns, 5) array
        Ascending powers of the local parameter in [0, 1].
    joints : (j,) array
        Inner edges at which a derivative up to the third may jump; the others are smooth by construction.
    stops : (i,) array
        Inner edges at which the path is stopped exactly, whatever its shape.
    marks : (l,) array
        Further parameters inside at which a plan must have a knot, as where the feed cap changes.
    feed_caps : FeedCaps, optional
        What the program's F words allow.
    made_within : PathTolerance, optional
        Of the program.
    tip_columns : sequence of int
        The columns of the path that the feed is measured on; left out, the linear axes.
    timing : Timing, optional
        The feed that was found together with the path; no part of its definition.
    """

    edges: FloatArray
    kind: NDArray[np.int8]
    row: NDArray[np.intp]
    offset: FloatArray
    legs: Legs
    blends: Blends | None
    spans: FloatArray
    joints: FloatArray
    stops: FloatArray
    marks: FloatArray
    axes: tuple[str, ...] = ()
    name: str = "chain"
    feed_caps: FeedCaps | None = None
    made_within: PathTolerance | None = None
    tip_columns: tuple[int, ...] = ()
    timing: Timing | None = None

    def __post_init__(self) -> None:
        named = axis_names(self.axes or None, len(self.axes) or self.legs.vectors.shape[2], self.name)
        object.__setattr__(self, "axes", named)
        step = np.diff(self.edges)
        if self.edges.size < 2 or not (step > 0.0).all():
            at = int(np.argmin(step)) if step.size else 0
            raise CurveError(f"{self.name}: piece {at} has no length; every piece of a chain must have one")
        for array in (self.edges, self.kind, self.row, self.offset, self.spans, self.joints, self.stops, self.marks):
            array.setflags(write=False)

    @property
    def domain(self) -> tuple[float, float]:  # type: ignore[override]
        """From the first edge to the last."""
        return float(self.edges[0]), float(self.edges[-1])

    @property
    def demanded_stops(self) -> FloatArray:
        """Those of the program."""
        return self.stops

    @property
    def columns(self) -> int:
        """Number of columns of the pieces: the axes, and what else the tip is made of."""
        return int(self.legs.vectors.shape[2])

    @cached_property
    def tip(self) -> Curve:
        """The path that the feed is measured on: the linear axes, or what ``tip_columns`` say."""
        return FeedPath(self, self.tip_columns) if self.tip_columns else super().tip

    def _evaluate(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        return np.ascontiguousarray(self.every_column(u, order, left)[..., : self.dim])

    def _evaluate_with_tip(self, u: FloatArray, order: int, left: BoolArray) -> tuple[FloatArray, FloatArray]:
        if not self.tip_columns:
            return super()._evaluate_with_tip(u, order, left)
        d = self.every_column(u, order, left)
        return np.ascontiguousarray(d[..., : self.dim]), np.ascontiguousarray(d[..., list(self.tip_columns)])

    def every_column(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        """Derivatives 0..order of all columns at u (n,), from the left where ``left`` (n,); ``(order + 1, n, columns)``."""
        out = np.empty((order + 1, u.size, self.columns))
        core.chain_evaluate(*self._arrays, u.size, u, left, None, order, out)
        return out

    def _on_pieces(self, piece: NDArray[np.intp], x: FloatArray) -> FloatArray:
        """Position and three derivatives, (4, n, columns), at the distances x (n,) from the starts of pieces."""
        out = np.empty((4, x.size, self.columns))
        core.chain_evaluate(*self._arrays, x.size, np.ascontiguousarray(x), None, piece, 3, out)
        return out

    @cached_property
    def _arrays(self) -> tuple[Any, ...]:
        """What the compiled evaluation takes of the pieces, and of legs, spans and blends."""
        kind, row = self.kind.astype(np.uint8), np.ascontiguousarray(self.row, dtype=np.intp)
        weight = np.ones(self.columns) if self.blends is None else self.blends.weight
        arrays = [self.kind.size, self.columns, weight, self.edges, kind, row, self.offset]
        legs, blends = self.legs, self.blends
        arrays += [legs.vectors, legs.rates, legs.ways, np.ascontiguousarray(self.spans)]
        arrays += [0, *[None] * 5] if legs.beziers is None else legs.beziers.arguments
        if blends is None:
            return (*arrays, *[None] * 13)
        edges, series, first = blends.inverse
        arrays.append(blends.vertex)
        for part in (blends.before, blends.after):
            arrays += [part.vectors, part.rates, part.ways]
        arrays += [blends.size, blends.length, blends.shape, first, edges, series]
        return tuple(np.ascontiguousarray(item) if isinstance(item, np.ndarray) else item for item in arrays)

    def native_pieces(self, u: FloatArray) -> NDArray[np.intp]:
        """Blends have their tau: over it their axes are cubics; over arc length the third derivative has a spike."""
        piece = np.clip(np.searchsorted(self.edges, u, side="right") - 1, 0, self.kind.size - 1)
        return np.where(self.kind[piece] == Kind.BLEND, piece, -1)

    def native_parameter(self, piece: NDArray[np.intp], u: FloatArray) -> FloatArray:
        """The tau of blends at u."""
        return self._blends.tau(self.row[piece], u - self.edges[piece])

    def on_native(self, piece: NDArray[np.intp], v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u, and position with three derivatives over tau, of blends."""
        row = self.row[piece]
        return self.edges[piece] + self._blends.arc_length(row, v), self._blends.at(row, v)[..., : self.dim]

    def native_rates(self, d: FloatArray) -> FloatArray:
        """U is the arc length, in which the axes have their weights."""
        return np.stack(speed_derivatives(d * np.sqrt(self._blends.weight[: self.dim])))

    def native_spacing(self, piece: NDArray[np.intp]) -> FloatArray:
        """A share of the distance from tau to the branch points of the arc length."""
        return self._blends.spacing(self.row[piece])

    @property
    def _blends(self) -> Blends:
        if self.blends is None:
            raise CurveError(f"{self.name}: it has no blends")
        return self.blends

    def _candidate_breaks(self) -> FloatArray:
        return np.union1d(self.edges[1:-1], self.marks)

    def intervals_needed(self, start: float, end: float) -> int:
        """By kind: a blend is short against the path, and passed within few milliseconds."""
        first = np.searchsorted(self.edges, start, side="right") - 1
        last = np.searchsorted(self.edges, end, side="left")
        return int(INTERVALS_OF_KIND[self.kind[max(first, 0) : last]].sum())

    @cached_property
    def breaks(self) -> tuple[Break, ...]:
        """Joints that are not smooth; an exact stop counts as a corner, of geometric order 0."""
        if not self.joints.size:
            return ()
        stops = set(self.stops.tolist())
        found = [replace(b, geometric=0) if b.u in stops else b for b in continuity(self, self.joints)]
        return tuple(b for b in found if not b.is_smooth)

    @cached_property
    def pieces(self) -> Pieces:
        """Polynomial pieces: exact for lines and spans; for arcs and blends the tangent is fitted to 1e-13."""
        return self.pieces_of_columns(range(self.dim))

    def pieces_of_columns(self, columns: Sequence[int]) -> Pieces:
        """The pieces of some of the columns."""
        whole = self._all_pieces
        if len(columns) == self.columns:
            return whole
        coefficients = np.ascontiguousarray(whole.coefficients[:, [*columns, self.columns]])
        resting, origin = whole.resting[:, list(columns)].copy(), whole.origin[:, list(columns)].copy()
        return Pieces(whole.breaks, coefficients, whole.rational, resting, origin)

    @cached_property
    def _all_pieces(self) -> Pieces:
        """The pieces of all columns, all of the same breaks."""
        curved = np.flatnonzero(self._is_curved)
        plain = np.flatnonzero(~self._is_curved)
        fitted = _fit(self, curved)
        degree = max(4, fitted[1].shape[2] - 1) if curved.size else 4
        starts = np.concatenate([self.edges[plain], fitted[0]])
        powers = np.zeros((starts.size, self.columns + 1, degree + 1))
        powers[:, -1, 0] = 1.0
        if plain.size:
            powers[: plain.size, :-1, :5] = self._plain_powers(plain)
        if curved.size:
            powers[plain.size :, :-1] = fitted[1]
        order = np.argsort(starts, kind="stable")
        powers = np.ascontiguousarray(powers[order])
        resting = np.asarray(~powers[:, :-1, 1:].any(axis=2))
        return Pieces(np.append(starts[order], self.edges[-1]), powers, False, resting, np.zeros(resting.shape))

    @cached_property
    def _is_curved(self) -> NDArray[np.bool_]:
        """Pieces that are no polynomial."""
        curved = np.asarray(self.kind == Kind.BLEND)
        legs = self.kind == Kind.LEG
        curved[legs] = self.legs.curved[self.row[legs]]
        return curved

    def _plain_powers(self, plain: NDArray[np.intp]) -> FloatArray:
        """Ascending powers (n, columns, 5) of the lines and spans among the pieces."""
        powers = np.zeros((plain.size, self.columns, 5))
        on = self.kind[plain] == Kind.SPAN
        powers[on] = self.spans[self.row[plain[on]]]
        line = plain[~on]
        vectors = self.legs.vectors[self.row[line]]
        powers[~on, :, 0] = vectors[:, 0] + vectors[:, 1] + vectors[:, 3] * self.offset[line, None]
        powers[~on, :, 1] = vectors[:, 3] * (self.edges[line + 1] - self.edges[line])[:, None]
        return powers

    def definition(self) -> Mapping[str, Any]:
        """Everything that the pieces are made of."""
        arrays = {name: getattr(self, name) for name in ("edges", "kind", "row", "offset", "spans", "stops", "marks")}
        parts = {"leg": self.legs}
        if self.blends is not None:
            arrays |= {"blend_vertex": self.blends.vertex, "blend_size": self.blends.size}
            parts |= {"before": self.blends.before, "after": self.blends.after}
        for name, legs in parts.items():
            arrays |= {f"{name}_vectors": legs.vectors, f"{name}_rates": legs.rates}
            if legs.ways is not None:
                arrays[f"{name}_ways"] = legs.ways
        if self.tip_columns:
            arrays["tip_columns"] = np.array(self.tip_columns)
        out = {"type": "chain", "axes": list(self.axes)} | {key: value.tolist() for key, value in arrays.items()}
        return out if self.legs.beziers is None else out | {"curves": self.legs.beziers.definition()}


@dataclass(frozen=True, eq=False)
class FeedPath(Curve):
    """Some of the columns of a chain: the path that its feed is measured on."""

    parent: ChainCurve
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
        """Names of the axes that are columns, and for every other column one that is left."""
        own = self.parent.axes
        others = iter(name for name in (*DEFAULT_AXES, *AXES) if name not in own)
        return tuple(own[k] if k < len(own) else next(others) for k in self.columns)

    def _evaluate(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        return np.ascontiguousarray(self.parent.every_column(u, order, left)[..., list(self.columns)])

    @cached_property
    def pieces(self) -> Pieces:
        """The parent's pieces, other columns."""
        return self.parent.pieces_of_columns(self.columns)

    def definition(self) -> Mapping[str, Any]:
        """Parent and columns."""
        return {"parent": self.parent.definition(), "columns": list(self.columns)}

    def _candidate_breaks(self) -> FloatArray:
        return self.parent._candidate_breaks()


def span_derivatives(powers: FloatArray, w: FloatArray, width: FloatArray) -> FloatArray:
    """Value and three derivatives (4, n, dim) of quartics with ascending ``powers (n, dim, 5)`` at w (n, 1) = x / width."""
    c0, c1, c2, c3, c4 = (powers[:, :, k] for k in range(5))
    return np.stack(
        [
            c0 + w * (c1 + w * (c2 + w * (c3 + w * c4))),
            (c1 + w * (2.0 * c2 + w * (3.0 * c3 + w * 4.0 * c4))) / width,
            (2.0 * c2 + w * (6.0 * c3 + w * 12.0 * c4)) / width**2,
            (6.0 * c3 + w * 24.0 * c4) / width**3,
        ]
    )


def _fit(curve: ChainCurve, pieces: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Polynomials on these pieces, halved until within tolerance: starts (k,) and ascending powers (k, dim, p + 1).

    Fitted is the tangent, over the distance from the start of the piece, and integrated: a blend of micrometres far from
    the origin has no digits to spare in its position, and a third derivative needs them.  After many turns of an arc the
    rounding of its angle is more than the tolerance, and halving would not lessen it.
    """
    piece, lo, hi = pieces, np.zeros(pieces.size), curve.edges[pieces + 1] - curve.edges[pieces]
    starts, powers = [np.empty(0)], []
    for halving in range(_MAX_HALVINGS):
        if piece.size == 0:
            break

        def tangent(x: FloatArray, piece: NDArray[np.intp] = piece) -> FloatArray:
            return curve._on_pieces(np.repeat(piece, x.shape[1]), x.reshape(-1))[1].reshape(*x.shape, -1)

        power, error = interpolate(tangent, lo, hi, _PROBES)
        allowed = np.maximum(_FIT_TOLERANCE, _ANGLE_ROUNDING * _angles(curve, piece, hi))
        good = (error <= allowed[:, None]).all(axis=1) | (halving == _MAX_HALVINGS - 1)
        begin = curve._on_pieces(piece[good], lo[good])[0]
        integral = power[good] * (hi - lo)[good, None, None] / np.arange(1.0, power.shape[1] + 1.0)[:, None]
        starts.append(curve.edges[piece[good]] + lo[good])
        powers.append(np.concatenate([begin[:, None], integral], axis=1).transpose(0, 2, 1))
        mid = 0.5 * (lo + hi)[~good]
        piece = np.tile(piece[~good], 2)
        lo, hi = np.concatenate([lo[~good], mid]), np.concatenate([mid, hi[~good]])
    return np.concatenate(starts), np.concatenate(powers) if powers else np.empty((0, curve.columns, 5))


def _angles(curve: ChainCurve, piece: NDArray[np.intp], x: FloatArray) -> FloatArray:
    """Angle of arcs from where they begin to x (n,) from the start of these pieces, rad, (n,); 0 on other pieces."""
    angle = np.zeros(piece.size)
    on = np.flatnonzero(curve.kind[piece] == Kind.LEG)
    legs = piece[on]
    angle[on] = np.abs(curve.legs.rates[curve.row[legs], 0] * (curve.offset[legs] + x[on]))
    return angle
