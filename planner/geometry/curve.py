"""The tool path as a parametric curve.

A :class:`Curve` answers one question, ``derivatives(u)``, from either side of a break; everything else here (breaks
with their order of continuity, curvature, compiled pieces) follows from that answer.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.compiled import core
from planner.errors import CurveError, InputError
from planner.geometry.arclength import ArcLength
from planner.geometry.continuity import MAX_DERIVATIVE, Break, continuity
from planner.geometry.differential import curvature, dot, norm
from planner.geometry.tolerance import PathTolerance
from planner.inputs import coordinates, require_side
from planner.law import Timing
from planner.types import BoolArray, FloatArray, Side

AXES = ("X", "Y", "Z", "A", "B", "C", "U", "V", "W")
ROTARY_AXES = frozenset("ABC")
MAX_COORDINATE = 1e9  # mm; beyond it the digits of a double no longer hold a path to 1e-7
DEFAULT_AXES = ("X", "Y", "Z", "U", "V", "W")
DEGREES = 180.0 / np.pi  # of a radian; where angles and lengths are taken together, a degree counts as a mm

# |C'| below this fraction of its values around is a cusp: the unit tangent is lost to cancellation there.
_CUSP_TOLERANCE = 1e-9
# |C'| times the width of the piece, against the coordinate: less is a rest.  Pieces narrower than the given fraction of
# the domain are left out, since their |C'| is mostly rounding.
_REST_TOLERANCE = 64.0 * np.finfo(np.float64).eps
_NARROW = 1e-6
# A polynomial piece of the degrees met here has its minima of |C'| farther apart than two of these.
_SCAN_INTERVALS = 16
_SCAN_BLOCK = 4096  # pieces at a time, which bounds the memory of the scan


@dataclass(frozen=True, eq=False)
class Pieces:
    """A curve as (rational) polynomials in power basis: what compiled code reads (see ``curve_inline.h``).

    Attributes
    ----------
    breaks : (m + 1,) array
        Parameters at which the pieces join, increasing.
    coefficients : (m, dim + 1, degree + 1) array
        Ascending powers of the local parameter in [0, 1], of the place from the piece's origin; the last row of each piece
        is the denominator.
    rational : bool
        False where every denominator is 1.
    resting : (m, dim) bool array
        Coordinates that have one value all over a piece.
    origin : (m, dim) array
        Of a rational piece its start: the quotient rule takes the place times D' from N', which far from 0, or with weights
        far apart, would leave of a derivative what rounding does.  0 where the pieces are polynomials.
    """

    breaks: FloatArray
    coefficients: FloatArray
    rational: bool
    resting: NDArray[np.bool_]
    origin: FloatArray

    def __post_init__(self) -> None:
        for array in (self.breaks, self.coefficients, self.resting, self.origin):
            array.setflags(write=False)

    @cached_property
    def powers(self) -> FloatArray:
        """Coefficients with the place itself for a numerator, (m, dim + 1, degree + 1)."""
        powers = self.coefficients.copy()
        powers[:, :-1] += self.origin[:, :, None] * powers[:, -1:]
        return powers

    def evaluate(self, u: FloatArray, order: int, left: NDArray[np.bool_] | bool) -> FloatArray:
        """Evaluate derivatives 0..order at the flat array u, from the left where asked; ``(order + 1, n, dim)``."""
        out = np.empty((order + 1, u.size, self.coefficients.shape[1] - 1))
        sides = np.full(u.size, left) if isinstance(left, bool) else left
        core.curve_evaluate(*self.arguments, u.size, u, sides, order, out)
        return out

    @property
    def arguments(self) -> tuple[Any, ...]:
        """These pieces as functions of the compiled core take them."""
        count, rows, terms = self.coefficients.shape
        return count, rows - 1, terms, self.breaks, self.coefficients, self.rational, self.resting, self.origin


@dataclass(frozen=True, eq=False)
class FeedCaps:
    """Largest feed of the tool tip on stretches of a curve, as the F words of a part program command it.

    Attributes
    ----------
    edges : (k + 1,) array
        Curve parameters at which the stretches join, increasing; the first and last are the ends of the curve.
    feed : (k,) array
        mm/s; inf on rapids, which have a limit of their own.
    angular : (k,) bool array, optional
        Stretches whose feed is in degrees/s: a machine's limits on feeds are not of these.
    """

    edges: FloatArray
    feed: FloatArray
    angular: BoolArray | None = None

    def __post_init__(self) -> None:
        for array in (self.edges, self.feed):
            array.setflags(write=False)

    def commanded(self, feed: float, rapid: float) -> FloatArray:
        """What is left of the caps by the limits of a machine on feed and rapids, (k,)."""
        found = np.where(np.isinf(self.feed), rapid, np.minimum(feed, self.feed))
        return found if self.angular is None else np.where(self.angular, self.feed, found)

    def at(self, u: FloatArray, left: NDArray[np.bool_] | bool = False) -> FloatArray:
        """Cap at parameters u, of the stretch before an edge where ``left`` is true."""
        return self.feed[self.stretch(u, left)]

    def stretch(self, u: FloatArray, left: NDArray[np.bool_] | bool = False) -> NDArray[np.intp]:
        """Index of the stretch at parameters u, of that before an edge where ``left`` is true."""
        before = np.searchsorted(self.edges, u, side="left") - 1
        after = np.searchsorted(self.edges, u, side="right") - 1
        return np.clip(np.where(left, before, after), 0, self.feed.size - 1)


class Curve(ABC):
    """A parametric tool path in machine axes.

    Subclasses provide ``name``, ``domain``, ``axes`` and :meth:`_evaluate`; ``feed_caps`` where a program commands feeds,
    ``made_within`` where the curve stands for a program or for points, ``timing`` where its feed was found with it.  Curves
    are immutable.
    """

    name: str
    domain: tuple[float, float]
    axes: tuple[str, ...]
    feed_caps: FeedCaps | None = None
    made_within: PathTolerance | None = None
    timing: Timing | None = None

    @abstractmethod
    def _evaluate(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        """Derivatives 0..order at u (n,) within the domain, from the left where ``left`` (n,); ``(order + 1, n, dim)``."""

    def _evaluate_with_tip(self, u: FloatArray, order: int, left: BoolArray) -> tuple[FloatArray, FloatArray]:
        """As :meth:`_evaluate`, of the machine axes and of the tool tip; the same array twice where these are the same."""
        own = self._evaluate(u, order, left)
        return own, own if self.tip is self else self.tip._evaluate(u, order, left)

    @property
    @abstractmethod
    def pieces(self) -> Pieces:
        """The curve for compiled code; exact for B-splines, fitted otherwise."""

    @abstractmethod
    def definition(self) -> Mapping[str, Any]:
        """Everything that determines the curve, as plain data; hashed into :attr:`fingerprint`."""

    @property
    def demanded_stops(self) -> FloatArray:
        """Inner parameters at which the path is stopped exactly, whatever its shape."""
        return np.empty(0)

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

    def derivatives(self, u: ArrayLike, order: int = 3, *, side: Side | BoolArray = "right") -> FloatArray:
        """Evaluate the machine axes and their derivatives with respect to u.

        Parameters
        ----------
        u : array_like
            Curve parameters within ``domain``.
        order : int
            Highest derivative, 0 to 3.
        side : {"right", "left"} or bool array of the shape of u
            Which one-sided value to take at a break, of an array the left one where true.  At the ends of the domain
            the inner one is taken.

        Returns
        -------
        ndarray, shape (order + 1,) + u.shape + (dim,)
            Index 0 is the position (mm or rad), index k the k-th derivative.

        Raises
        ------
        InputError
            If a parameter is not finite or outside the domain, or the order or side is not one of those above.
        """
        points, left = self._places(u, order, side)
        return self._evaluate(points.reshape(-1), order, left).reshape((order + 1, *points.shape, self.dim))

    def derivatives_with_tip(
        self, u: ArrayLike, order: int = 3, *, side: Side | BoolArray = "right"
    ) -> tuple[FloatArray, FloatArray]:
        """As :meth:`derivatives`, of the machine axes and of the tool tip, in less time than one after the other.

        Where these are the same the two are one array.
        """
        points, left = self._places(u, order, side)
        own, tip = self._evaluate_with_tip(points.reshape(-1), order, left)
        shaped = own.reshape((order + 1, *points.shape, self.dim))
        return shaped, shaped if tip is own else tip.reshape((order + 1, *points.shape, self.tip.dim))

    def _places(self, u: ArrayLike, order: int, side: Side | BoolArray) -> tuple[FloatArray, BoolArray]:
        """Parameters as a contiguous array, and which of them, flat, are seen from the left; InputError for others."""
        if not isinstance(order, int | np.integer) or not 0 <= order <= MAX_DERIVATIVE:
            raise InputError(f"order = {order!r} must be 0, 1, 2 or 3")
        points = np.ascontiguousarray(coordinates(u, "u")).reshape(np.shape(u))
        left = _is_left(side, points.shape)
        flat = points.reshape(-1)
        u0, u1 = self.domain
        outside = ~((flat >= u0) & (flat <= u1))
        if outside.any():
            place = int(np.argmax(outside))
            raise InputError(
                f"u[{place}] = {float(flat[place])!r} must lie within [{u0!r}, {u1!r}], the domain of {self.name}"
            )
        return points, left

    def curvature(self, u: ArrayLike, *, side: Side = "right") -> FloatArray:
        """Curvature |C' x C''| / |C'|^3 at every u, in 1/mm; 0 where the curve rests."""
        return curvature(self.derivatives(u, 2, side=side))

    @cached_property
    def breaks(self) -> tuple[Break, ...]:
        """Interior parameters where a derivative up to the third jumps, with the order of continuity there."""
        found = continuity(self, self._candidate_breaks())
        return tuple(b for b in found if not b.is_smooth)

    @cached_property
    def arclength(self) -> ArcLength:
        """Arc length of the tool tip, s(u) and u(s)."""
        tip = self.tip

        def speed(u: FloatArray) -> FloatArray:
            return norm(tip.derivatives(u, 1)[1])

        return ArcLength.of_speed(speed, self.pieces.breaks, self.name)

    def __repr__(self) -> str:
        """Name, length, axes and domain; what a curve is defined by may be megabytes."""
        first, last = self.domain
        head = f"{type(self).__name__}({self.name}: {self.length:.6g} mm, axes {' '.join(self.axes)},"
        return f"{head}\n    u from {first:.6g} to {last:.6g})"

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

    def native_pieces(self, u: FloatArray) -> NDArray[np.intp]:
        """Pieces that have a parameter of their own, by places (n,) inside them; -1 where that is u."""
        return np.full(u.size, -1, dtype=np.intp)

    def native_parameter(self, piece: NDArray[np.intp], u: FloatArray) -> FloatArray:
        """The own parameter of such pieces (n,) at u (n,)."""
        raise NotImplementedError

    def on_native(self, piece: NDArray[np.intp], v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """U (n,) at the own parameters v (n,) of such pieces (n,), and position and three derivatives over v (4, n, dim)."""
        raise NotImplementedError

    def native_rates(self, d: FloatArray) -> FloatArray:
        """The first three derivatives (3, n) of u over the own parameter, from those of the axes, d (4, n, dim)."""
        raise NotImplementedError

    def native_spacing(self, piece: NDArray[np.intp]) -> FloatArray:
        """Steps (n,) of the own parameter that quintics u over time follow."""
        raise NotImplementedError

    def intervals_needed(self, start: float, end: float) -> int:
        """How many intervals of a plan resolve the features between two parameters, as far as the curve knows of any."""
        return 0


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

    def _evaluate(self, u: FloatArray, order: int, left: BoolArray) -> FloatArray:
        return np.ascontiguousarray(self.parent._evaluate(u, order, left)[..., list(self.columns)])

    @cached_property
    def pieces(self) -> Pieces:
        """The parent's pieces, fewer rows."""
        whole = self.parent.pieces
        rows = [*self.columns, self.parent.dim]
        resting = np.ascontiguousarray(whole.resting[:, list(self.columns)])
        origin = np.ascontiguousarray(whole.origin[:, list(self.columns)])
        return Pieces(whole.breaks, np.ascontiguousarray(whole.coefficients[:, rows]), whole.rational, resting, origin)

    def definition(self) -> Mapping[str, Any]:
        """Parent and columns."""
        return {"parent": self.parent.definition(), "columns": list(self.columns)}

    def _candidate_breaks(self) -> FloatArray:
        return self.parent._candidate_breaks()


def _is_left(side: Side | BoolArray, shape: tuple[int, ...]) -> BoolArray:
    """Whether each of the points of a shape is seen from the left, flat."""
    if not isinstance(side, np.ndarray):
        require_side(side)
        return np.full(int(np.prod(shape)), side == "left")
    if side.dtype != np.bool_ or side.shape != shape:
        raise InputError(f"side is an array {side.shape} of {side.dtype}; it must be bool, of the shape {shape} of u")
    return np.ascontiguousarray(side.reshape(-1))


def axis_names(
    axes: Sequence[str] | None, count: int, where: str, error: type[InputError] = CurveError
) -> tuple[str, ...]:
    """Check the names of ``count`` axes: different ones out of :data:`AXES`; X, Y, Z, U, V, W if left out.

    Raises
    ------
    CurveError, or the ``error`` given
        Naming ``where``, the names and what is allowed.
    """
    if axes is None:
        if count > len(DEFAULT_AXES):
            raise error(f"{where}: {count} axes need their names, out of {' '.join(AXES)}")
        return DEFAULT_AXES[:count]
    names = tuple(axes) if isinstance(axes, Sequence) else ()
    if not all(isinstance(axis, str) and axis in AXES for axis in names) or len(set(names)) != len(names) or not names:
        raise error(f"{where}: axes = {axes!r} must be a list of different names out of {' '.join(AXES)}")
    if len(names) != count:
        raise error(f"{where}: axes names {len(names)} axes, but there are values for {count}")
    return names


def require_finite(curve: Curve, u: FloatArray, d: FloatArray) -> None:
    """Raise CurveError where the derivatives ``d (order + 1, n, dim)`` at the parameters u (n,) are not finite."""
    bad = ~np.isfinite(d).all(axis=(0, 2))
    if bad.any():
        place = u[int(np.argmax(bad))]
        raise CurveError(f"{curve.name}: not finite at u = {place:.9g}; position and three derivatives must be")


def require_regular(curve: Curve) -> None:
    """Raise CurveError where the curve is not finite, has no length, or has a cusp (|C'| = 0).

    |C'|^2 is scanned on every piece from its inside; each minimum that lies well below its neighbours is refined by
    golden-section search, so a zero between two scan points is found.  What counts is |C'| against its values around,
    not against the largest on the curve: a slow parametrisation is not a cusp.
    """
    edges = curve.pieces.breaks
    length = 0.0
    slow = []
    for start in range(0, edges.size - 1, _SCAN_BLOCK):
        block = edges[start : start + _SCAN_BLOCK + 1]
        width = np.diff(block)[:, None]
        u = block[:-1, None] + width * np.linspace(0.0, 1.0, _SCAN_INTERVALS + 1)
        u[:, -1] = block[1:]
        d = curve.derivatives(u, 3)
        d[:, :, -1] = curve.derivatives(block[1:], 3, side="left")
        require_finite(curve, u.reshape(-1), d.reshape(4, -1, curve.dim))
        with np.errstate(over="ignore"):
            speed = np.sqrt(dot(d[1], d[1]))
        if not np.isfinite(speed).all():
            raise CurveError(f"{curve.name}: |C'| overflows; coordinates over knot spacing must stay below 1e150")
        length += float(np.sum(speed * width))
        travel = speed * np.maximum(width, _NARROW * (edges[-1] - edges[0]))
        slow.append(_slowest(curve, u, speed, travel <= _REST_TOLERANCE * np.abs(d[0]).max(axis=-1)))
    if length == 0.0:
        at = curve.derivatives(edges[0], 0)[0].tolist()
        raise CurveError(f"{curve.name}: the curve has length 0 (every point is {at}); it must have a length")
    worst = min((item for item in slow if item is not None), default=None)
    if worst is not None:
        raise CurveError(
            f"{curve.name}: |C'| = {worst[0]:.3g} at u = {worst[1]:.9g} is a cusp or a rest; a curve must have a "
            "tangent everywhere: split it there, or remove repeated control points"
        )


def _slowest(curve: Curve, u: FloatArray, speed: FloatArray, resting: NDArray[np.bool_]) -> tuple[float, float] | None:
    """Smallest |C'| that is a cusp or a rest, and its parameter, from a scan with one row for each piece."""
    if resting.any():
        return float(speed[resting][0]), float(u[resting][0])
    fence = np.pad(speed, ((0, 0), (2, 2)), constant_values=0.0)
    around = np.max([fence[:, :-4], fence[:, 1:-3], fence[:, 3:-1], fence[:, 4:]], axis=0)
    fence[:, [0, 1, -2, -1]] = np.inf
    lowest = (speed <= fence[:, 1:-3]) & (speed <= fence[:, 3:-1])
    # Where C' passes zero in a straight line, the nearest of the scan points has at most a third of the second next.
    row, column = np.nonzero(lowest & (speed <= 0.5 * around))
    if row.size == 0:
        return None
    near = around[row, column]
    lo, hi = u[row, np.maximum(column - 1, 0)], u[row, np.minimum(column + 1, u.shape[1] - 1)]
    resolution = np.spacing(np.maximum(np.abs(lo), np.abs(hi))) / (hi - lo)
    at, low = golden_minimum(lambda x: np.sum(curve.derivatives(x, 1)[1] ** 2, axis=-1), lo, hi)
    low = np.sqrt(low)
    at = np.where(low <= speed[row, column], at, u[row, column])
    low = np.minimum(low, speed[row, column])
    cusps = np.flatnonzero(low <= (_CUSP_TOLERANCE + 8.0 * resolution) * near)
    if cusps.size == 0:
        return None
    worst = int(cusps[np.argmin(low[cusps])])
    return float(low[worst]), float(at[worst])


def golden_minimum(
    f: Callable[[FloatArray], FloatArray], lo: FloatArray, hi: FloatArray, passes: int = 60
) -> tuple[FloatArray, FloatArray]:
    """Golden-section search on all intervals at once: the place of each minimum, and f there.

    A pass leaves 0.618 of the interval: 60 of them 3e-13.
    """
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    for _ in range(passes):
        inner, outer = hi - golden * (hi - lo), lo + golden * (hi - lo)
        keep = f(inner) <= f(outer)
        lo, hi = np.where(keep, lo, inner), np.where(keep, outer, hi)
    at = 0.5 * (lo + hi)
    return at, f(at)
