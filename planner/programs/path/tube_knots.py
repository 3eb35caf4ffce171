"""Where the knots of a tube go.

The spacing H(s) is the least of

    1.5 tol / angle                at a vertex,
    sqrt(6 tol / jump)             at a jump of the curvature,
    0.4 rad / (turning per mm)     where blocks turn, sharp vertices excluded,
    3 mm

and grows by at most 0.5 mm a mm away from each.  Knots are equidistant in the integral of ds/H between the sharp vertices,
each of which has a knot: marching from one end would not treat both directions alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.types import FloatArray

SHARP = 0.2  # rad
_PER_ANGLE, _PER_JUMP, _TURNING = 1.5, 6.0, 0.4
_WIDEST = 3.0  # mm
_GROWTH = 0.5
_FEWEST = 8
_NEAR = 0.1  # of the spacing
_MAX_PARTS = 64
_PARTS_PER_SPACING = 4.0


def spacing_at(turn: FloatArray, bend: FloatArray, density: FloatArray, tolerance: FloatArray) -> FloatArray:
    """Spacing wanted at junctions, (n,), mm: of turn (rad), curvature jump (1/mm), turning density (rad/mm)."""
    with np.errstate(divide="ignore"):
        by_turn = _PER_ANGLE * tolerance / turn
        by_jump = np.sqrt(_PER_JUMP * tolerance / bend)
        by_turning = np.where(turn < SHARP, _TURNING / density, np.inf)
    return np.asarray(np.minimum(np.minimum(by_turn, by_jump), np.minimum(by_turning, _WIDEST)))


def place(start: float, end: float, at: FloatArray, spacing: FloatArray, pinned: FloatArray) -> FloatArray:
    """Knots from start to end.

    Parameters
    ----------
    start, end : float
        mm.
    at, spacing : (n,) arrays
        Where which spacing is wanted; increasing, mm.
    pinned : (k,) array
        Places that must be knots, increasing.

    Returns
    -------
    (m,) array
        Distinct, increasing.
    """
    s = np.concatenate([[start], at, [end]])
    wanted = np.concatenate([[_WIDEST], spacing, [_WIDEST]])
    s, first = np.unique(s, return_inverse=True)
    least = np.full(s.size, np.inf)
    np.minimum.at(least, first, wanted)
    least = _limited(s, least)
    gap = np.diff(s)
    parts = np.clip(np.ceil(_PARTS_PER_SPACING * gap / np.minimum(least[:-1], least[1:])), 1, _MAX_PARTS).astype(int)
    index = np.repeat(np.arange(gap.size), parts)
    within = _graded(gap, least, parts, index)
    fine = np.append(s[index] + gap[index] * within, end)
    into, back = gap[index] * within, gap[index] * (1.0 - within)
    fine_spacing = np.minimum(least[index] + _GROWTH * into, least[index + 1] + _GROWTH * back)
    fine_spacing = np.minimum(np.append(fine_spacing, least[-1]), _WIDEST)
    count = np.concatenate([[0.0], np.cumsum(0.5 * (1.0 / fine_spacing[1:] + 1.0 / fine_spacing[:-1]) * np.diff(fine))])
    corners = np.concatenate([[start], pinned[(pinned > start) & (pinned < end)], [end]])
    at_corner = np.interp(corners, fine, count)
    pieces = np.maximum(1, np.ceil(np.diff(at_corner) - 1e-9)).astype(int)
    if pieces.sum() < _FEWEST:
        pieces = pieces * int(np.ceil(_FEWEST / pieces.sum()))
    index = np.repeat(np.arange(pieces.size), pieces)
    within = (np.arange(index.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[index]
    knots = np.interp(at_corner[index] + np.diff(at_corner)[index] * within, count, fine)
    knots[np.cumsum(pieces) - pieces] = corners[:-1]
    return np.append(knots, end)


def onto(knots: FloatArray, marks: FloatArray) -> FloatArray:
    """Move the inner knots that nearly lie on a mark onto it.

    A plan has nodes at both, and between two that are passed within a microsecond rounding is worth more than any jerk.
    """
    out = knots.copy()
    room = _NEAR * np.diff(knots)
    k = np.searchsorted(0.5 * (knots[1:] + knots[:-1]), marks)
    inner = (k > 0) & (k < knots.size - 1)
    k, marks = k[inner], marks[inner]
    away = np.abs(marks - knots[k])
    near = np.flatnonzero(away < np.minimum(room[k - 1], room[k]))
    closest = near[np.argsort(-away[near], kind="stable")]  # of several marks beside a knot the closest comes last
    out[k[closest]] = marks[closest]
    return out


def _graded(gap: FloatArray, spacing: FloatArray, parts: NDArray[np.intp], index: NDArray[np.intp]) -> FloatArray:
    """Where the parts of every gap begin, as shares of it: evenly, or closer by the spacing where that is too coarse.

    With h0 and h1 at its ends and the spacing growing by g a mm from both, a gap d is cut at equal steps of the integral of
    dx/h, which is ln(1 + g x/h) / g from either end to where the two meet.
    """
    number = np.arange(index.size) - np.repeat(np.cumsum(parts) - parts, parts)
    share = number / parts[index]
    first, last = spacing[:-1], spacing[1:]
    meet = np.clip(0.5 * (gap + (last - first) / _GROWTH), 0.0, gap)
    one, other = (np.log1p(_GROWTH * x / h) / _GROWTH for x, h in ((meet, first), (gap - meet, last)))
    at = share * (one + other)[index]
    forth = first[index] * np.expm1(_GROWTH * at) / _GROWTH
    back = gap[index] - last[index] * np.expm1(_GROWTH * ((one + other)[index] - at)) / _GROWTH
    closer = np.where(at <= one[index], forth, back) / gap[index]
    return np.where((parts == _MAX_PARTS)[index], np.clip(closer, 0.0, 1.0), share)


def _limited(s: FloatArray, spacing: FloatArray) -> FloatArray:
    """Let the spacing grow by at most ``_GROWTH`` away from where it is small."""
    ramp = _GROWTH * s
    forth = np.minimum.accumulate(spacing - ramp) + ramp
    ramp = _GROWTH * (s[-1] - s)
    back = (np.minimum.accumulate((forth - ramp)[::-1]))[::-1] + ramp
    return np.asarray(np.minimum(forth, back))
