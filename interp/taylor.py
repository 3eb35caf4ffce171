"""The interpolators a controller calls once a period, and the plain arrays they run on.

    table = InterpolatorTable.from_profile(profile)
    state = start(table, 1e-3)
    position = state[-table.dim :]                # a view of the last sample, now the one at t = 0
    while not quintic_step(*table.arrays, state):
        send(position)

``quintic_step`` follows the plan itself: at t = k T it evaluates the time law u(t) of the profile and the curve there,
so no error accumulates.  ``taylor_step`` is the interpolator of the literature, which keeps u and adds to it in every
period what the plan's feed V(t), acceleration A(t) and jerk J(t) say; its error accumulates, and its last sample jumps
to the end of the path.  Both read plain arrays and the state only: see ``interp/interp.h`` for the layout.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import frexp, isfinite, ldexp

import numpy as np
from numpy.typing import NDArray

from interp import stepping
from interp.periods import WHOLE_PERIOD
from interp.stepping import State, quintic_step, taylor_step
from planner.compiled import core
from planner.errors import InputError
from planner.geometry.curve import Curve, Pieces
from planner.inputs import require_instance
from planner.profile import FeedrateProfile
from planner.sets import union
from planner.types import FloatArray

__all__ = ["InterpolatorTable", "TaylorTable", "last_sample", "quintic_step", "start", "taylor_step"]

PlaceRun = Callable[[FloatArray, FloatArray, FloatArray], None]

# Leading bits of the period; times a sample number below 2^33 their product is exact.
_PERIOD_BITS = 20
_MAX_SAMPLE = 2**33
_BISECTIONS = 64
# A plan may fall back by this share of its path: the noise of quintics between close nodes, not a motion.
_FALLING_BACK = 1e-10
_PROBES = 9
# A Taylor table's feed is right to this share of the mean feed; at a jump, where it cannot be, halving ends.
_FEED_TOLERANCE = 1e-9
_HALVINGS = 16


@dataclass(frozen=True, eq=False)
class InterpolatorTable:
    """What ``quintic_step`` reads: the time law of a plan and the curve, cut where either changes its polynomial.

    Attributes
    ----------
    segments : (n + 1, 8) array
        Start time, quintic, curve piece.
    pieces : (m + 1, rows, degree + 1) array
        Curve pieces.
    duration : float
        Of the plan, s.
    u_range : pair of float
        Curve parameter at the start and at the end.
    ends : (2, dim) array
        Positions there, mm (rad for rotary axes).
    """

    segments: FloatArray
    pieces: FloatArray
    duration: float
    u_range: tuple[float, float]
    ends: FloatArray

    def __post_init__(self) -> None:
        for array in (self.segments, self.pieces, self.ends):
            array.setflags(write=False)

    @classmethod
    def from_profile(cls, profile: FeedrateProfile) -> InterpolatorTable:
        """Build the table of a plan.

        Between two nodes of the plan u(t) is a quintic.  Where it crosses from one curve piece to the next, the
        quintic is split there and expanded about the crossing, in the local parameter of the new piece.  A step thus
        advances one pointer, and small numbers stay small: the parameter within the piece, the time within the segment.

        Raises
        ------
        InputError
            If the curve parameter of the plan falls back somewhere.
        """
        require_instance(profile, FeedrateProfile, "profile")
        axes = profile.curve.pieces
        pieces = packed_pieces(axes.breaks, axes.powers, rational=axes.rational)
        return cls(_segments(profile, axes.breaks), pieces, *_course(profile))

    @property
    def dim(self) -> int:
        """Number of machine axes."""
        return int(self.ends.shape[1])

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """The leading arguments of ``quintic_step``."""
        return self.segments, self.pieces


@dataclass(frozen=True, eq=False)
class TaylorTable:
    """What ``taylor_step`` reads: the feed of a plan over time, and the curve.

    Attributes
    ----------
    feed : (n + 1, 5) array
        Start time and cubic of the path speed V(t), mm/s; its derivatives are A(t) and J(t).
    pieces : (m + 1, rows, degree + 1) array
        Curve pieces of the machine axes and, where it is not made of these, of the tool tip, whose speed the feed is.
    duration, u_range, ends
        As in :class:`InterpolatorTable`.
    """

    feed: FloatArray
    pieces: FloatArray
    duration: float
    u_range: tuple[float, float]
    ends: FloatArray

    def __post_init__(self) -> None:
        for array in (self.feed, self.pieces, self.ends):
            array.setflags(write=False)

    @classmethod
    def from_profile(cls, profile: FeedrateProfile) -> TaylorTable:
        """Build the table of a plan.

        Between two nodes V(t) is the cubic that takes the feed and the acceleration of both, which is exact where the
        jerk is constant; where it is not, points are added until V(t) is the plan's to nine digits.
        """
        require_instance(profile, FeedrateProfile, "profile")
        return cls(_feed(profile), packed_curve(profile.curve), *_course(profile))

    @property
    def dim(self) -> int:
        """Number of machine axes."""
        return int(self.ends.shape[1])

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """The arguments of ``taylor_step`` after the order."""
        return self.feed, self.pieces


def start(table: InterpolatorTable | TaylorTable, period: float, *, first: int = 0) -> State:
    """Return the state at sample ``first``.

    Parameters
    ----------
    table : InterpolatorTable or TaylorTable
    period : float
        Time between two samples, s.
    first : int
        Sample to begin with, at most the last.  Only a plan that is followed exactly can be entered in the middle:
        with a :class:`TaylorTable` it must be 0.

    Returns
    -------
    (11 + 2 dim,) array
        For ``quintic_step`` or ``taylor_step``.  Sample number, curve parameter and the rest are at the indices
        ``SAMPLE``, ``U``, ... of ``interp.stepping``, the position in the last dim places; a copy is a snapshot that
        continues identically.

    Raises
    ------
    InputError
        If the period is not positive and finite, or there is no such first sample.
    """
    last = last_sample(table.duration, period)
    if not 0 <= first <= last:
        raise InputError(f"first = {first!r} must lie within 0 and {last}, the number of the last sample")
    if first > 0 and isinstance(table, TaylorTable):
        raise InputError(f"first = {first!r} must be 0: a Taylor step starts from the parameter of the step before it")
    mantissa, exponent = frexp(period)
    high = ldexp(float(int(mantissa * 2**_PERIOD_BITS)), exponent - _PERIOD_BITS)
    state = np.zeros(stepping.END + 2 * table.dim).view(State)
    state[stepping.SAMPLE] = max(first - 1, 0)
    state[stepping.U] = table.u_range[0]
    state[stepping.PERIOD_HIGH], state[stepping.PERIOD_LOW] = high, period - high
    state[stepping.LAST] = last
    state[stepping.U_END] = table.u_range[1]
    state[stepping.DIM], state[stepping.ROWS], state[stepping.POWERS] = table.dim, *table.pieces.shape[1:]
    state[stepping.END :] = table.ends[::-1].reshape(-1)
    if first > 0 and isinstance(table, InterpolatorTable):
        core.quintic_step(*table.arrays, state)
    return state


def last_sample(duration: float, period: float) -> int:
    """Number of the last sample, ceil(duration / period), and at least 1.

    Raises
    ------
    InputError
        If the period is not positive and finite, or too short to count the samples of the plan.
    """
    if not (isfinite(period) and period > 0.0):
        raise InputError(f"period = {period!r} s must be > 0 and finite")
    periods = duration / period if duration < _MAX_SAMPLE * period else np.inf
    if periods == np.inf:
        raise InputError(
            f"period = {period!r} s cuts the plan of {duration:.9g} s into more than 2^33 samples; use a coarser period"
        )
    whole = round(periods)
    return max(1, whole if abs(periods - whole) <= WHOLE_PERIOD else int(np.ceil(periods)))


def runner(table: InterpolatorTable | TaylorTable, order: int) -> PlaceRun:
    """Return the compiled loop of an order: (state, u, flat positions), filled with ``u.size`` steps."""
    arrays = table.arrays
    if isinstance(table, InterpolatorTable):
        return lambda state, u, positions: core.quintic_run(*arrays, state, u.size, u, positions)
    return lambda state, u, positions: core.taylor_run(order, *arrays, state, u.size, u, positions)


def _course(profile: FeedrateProfile) -> tuple[float, tuple[float, float], FloatArray]:
    """Duration, and both ends: their parameters, and positions by the curve itself rather than by its pieces."""
    u = profile.u[[0, -1]]
    return profile.duration, (float(u[0]), float(u[1])), profile.curve.derivatives(u, 0)[0]


def packed_curve(curve: Curve) -> FloatArray:
    """Lay out the machine axes of a curve and, where it is not made of these, its tool tip as compiled steps read them.

    Returns
    -------
    (m + 1, rows, degree + 1) array
        *pieces* of ``interp/interp.h``.
    """
    axes, tip = curve.pieces, curve.tip.pieces
    if curve.tip is curve:
        return packed_pieces(axes.breaks, axes.powers, rational=axes.rational)
    breaks = union(axes.breaks, tip.breaks)
    return packed_pieces(breaks, _refined(axes, breaks), _refined(tip, breaks))


def packed_pieces(
    breaks: FloatArray, axes: FloatArray, tip: FloatArray | None = None, *, rational: bool = True
) -> FloatArray:
    """Lay coefficients (m, dim + 1, degree + 1) of the axes, and of a tip, out as ``interp/interp.h`` has them.

    The denominator of the axes is left out where it is 1 and there is no tip behind it.
    """
    parts = [axes if rational or tip is not None else axes[:, :-1]]
    if tip is not None:
        parts.append(tip)
    size = max(2, *(part.shape[2] for part in parts))
    packed = np.zeros((breaks.size, 1 + sum(part.shape[1] for part in parts), size))
    packed[:-1, 0, 0], packed[:-1, 0, 1] = breaks[:-1], np.diff(breaks)
    packed[-1, 0, 0] = np.inf
    row = 1
    for part in parts:
        _, count, powers = part.shape
        packed[:-1, row : row + count, size - powers :] = part[:, :, ::-1]
        row += count
    return packed


def _refined(pieces: Pieces, breaks: FloatArray) -> FloatArray:
    """Coefficients of pieces cut at more breaks: on a part [lo, lo + scale] of [0, 1], w = lo + scale x."""
    owner = np.searchsorted(pieces.breaks, breaks[:-1], side="right") - 1
    width = np.diff(pieces.breaks)[owner]
    lo, scale = (breaks[:-1] - pieces.breaks[owner]) / width, np.diff(breaks) / width
    powers = pieces.powers.shape[2]
    shifted = expanded(pieces.powers[owner].transpose(2, 0, 1), lo[:, None])
    shifted *= scale[:, None] ** np.arange(powers)[:, None, None]
    return np.ascontiguousarray(shifted.transpose(1, 2, 0))


def _intervals(profile: FeedrateProfile) -> tuple[NDArray[np.intp], FloatArray]:
    """Index of the first node, and the length, of every interval that is not empty."""
    gap = np.diff(profile.t)
    index = np.flatnonzero(gap > 0.0)
    return index, gap[index]


def _segments(profile: FeedrateProfile, breaks: FloatArray) -> FloatArray:
    i, gap = _intervals(profile)
    t, u, law = profile.t, profile.u, profile.law.coefficients(i)
    _require_forward(law, gap, t[i])
    pieces = breaks.size - 1
    first = np.clip(np.searchsorted(breaks, u[i], side="right") - 1, 0, pieces - 1)
    last = np.clip(np.searchsorted(breaks, u[i + 1], side="left") - 1, first, pieces - 1)
    count = last - first + 1
    owner = np.repeat(np.arange(i.size), count)
    crossed = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)  # breaks passed within the interval
    piece = first[owner] + crossed
    later = crossed > 0
    begin = t[i][owner]
    begin[later] += _crossing(law[:, owner[later]], breaks[piece[later]], gap[owner[later]])
    local = law[:, owner]
    local[0] -= breaks[piece]  # before the expansion: the difference of two close numbers is exact
    table = np.zeros((owner.size + 1, 8))
    table[:-1, 0] = begin
    table[:-1, 1:7] = (expanded(local, begin - t[i][owner]) / np.diff(breaks)[piece]).T
    table[:-1, 7] = piece
    table[-1, 0] = np.inf
    return table


def _require_forward(law: FloatArray, gap: FloatArray, begin: FloatArray) -> None:
    """Raise InputError where u(t) falls back by more than roundings between two nodes: they lie too far apart."""
    x = np.linspace(0.0, 1.0, _PROBES)[:, None]
    u = np.zeros((_PROBES, gap.size))
    for k in range(5, 0, -1):
        u = (u + law[k] * gap**k) * x
    travelled = float(law[0, -1] - law[0, 0] + u[-1, -1])
    back = -np.diff(u, axis=0).min(axis=0)
    worst = int(np.argmax(back))
    if back[worst] > _FALLING_BACK * travelled:
        raise InputError(
            f"the curve parameter of the plan falls back by {back[worst]:.3g} between t = {float(begin[worst])!r} and "
            f"{float(begin[worst] + gap[worst])!r} s; it must not decrease: the plan needs more nodes there"
        )


def _crossing(law: FloatArray, level: FloatArray, gap: FloatArray) -> FloatArray:
    """Time within [0, gap] at which each quintic (6, n) reaches its level, by bisection."""
    lo, hi = np.zeros_like(gap), gap.copy()
    for _ in range(_BISECTIONS):
        mid = 0.5 * (lo + hi)
        value = law[0] - level
        power = np.ones_like(mid)
        for row in law[1:]:
            power = power * mid
            value = value + row * power
        below = value < 0.0
        lo, hi = np.where(below, mid, lo), np.where(below, hi, mid)
    return 0.5 * (lo + hi)


def expanded(c: FloatArray, shift: FloatArray) -> FloatArray:
    """Coefficients of p(shift + x) in powers of x; the first axis of ``c`` counts the powers (Horner, synthetic)."""
    out = c.copy()
    size = out.shape[0]
    for first in range(size - 1):
        for k in range(size - 2, first - 1, -1):
            out[k] += shift * out[k + 1]
    return out


def _feed(profile: FeedrateProfile) -> FloatArray:
    """Cubics of V(t) between the nodes, and between points halfway where that is too far from V(t) = u' |C'|."""
    i, _ = _intervals(profile)
    spans = np.stack([profile.t[i], profile.feed[i], profile.acceleration[i]])
    spans = np.concatenate([spans, np.stack([profile.t[i + 1], profile.feed[i + 1], profile.acceleration[i + 1]])])
    tolerance = _FEED_TOLERANCE * float(profile.s[-1] - profile.s[0]) / profile.duration
    for _ in range(_HALVINGS):
        cubics = _cubics(spans)
        gap = spans[3] - spans[0]
        off = np.zeros(gap.size, dtype=bool)
        for share in (0.3, 0.5, 0.7):
            inner = profile.at(spans[0] + share * gap)
            off |= np.abs(np.polynomial.polynomial.polyval(share * gap, cubics, tensor=False) - inner.feed) > tolerance
        if not off.any():
            break
        half = profile.at(0.5 * (spans[0] + spans[3])[off])
        middle = np.stack([half.t, half.feed, half.acceleration])
        first, second = np.concatenate([spans[:3, off], middle]), np.concatenate([middle, spans[3:, off]])
        spans = np.concatenate([spans[:, ~off], first, second], axis=1)
    spans = spans[:, np.argsort(spans[0], kind="stable")]
    table = np.zeros((spans.shape[1] + 1, 5))
    table[:-1, 0], table[:-1, 1:] = spans[0], _cubics(spans).T
    table[-1, 0] = np.inf
    return table


def _cubics(spans: FloatArray) -> FloatArray:
    """Coefficients (4, n) in powers of the time since the start, from rows t, V, A of the start and of the end."""
    t0, v0, a0, t1, v1, a1 = spans
    gap = t1 - t0
    rest = v1 - v0 - gap * a0
    bend = gap * (a1 - a0)
    return np.stack([v0, a0, (3.0 * rest - bend) / gap**2, (bend - 2.0 * rest) / gap**3])
