"""Where the knots of a tube go.

The spacing H(s) is the least of

    1.5 tol / angle                at a vertex,
    sqrt(6 tol / jump)             at a jump of the curvature,
    0.4 rad / (turning per mm)     where blocks turn, sharp vertices excluded,
    0.3 sqrt(8 tol / curvature)    where blocks are chords of a curve of that curvature,
    3 mm

and grows by at most 0.5 mm a mm away from each.  Knots are equidistant in the integral of ds/H between the sharp vertices,
each of which has a knot: marching from one end would not treat both directions alike.

The third derivative is linear between knots, so the feed that it allows at a place depends a little on where the knots
beside it are.  Where blocks are chords of a curve, knots therefore lie in planes that all passes share: x = k h, with h the
power of 2 nearest to H, and x the first axis that the path goes along by at least half.  Planes of a wider h are among those
of a closer one.  Between two planes that are farther apart than H knots are equidistant as above; where planes lie closer
than 0.4 H, as where the path turns back along x, none of them counts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from planner.types import BoolArray, FloatArray

SHARP = 0.2  # rad
_PER_ANGLE, _PER_JUMP, _TURNING = 1.5, 6.0, 0.4
_PER_CHORD = 0.3  # of the chord that leaves the curve by the tolerance
_ALONG = 0.5  # share of the way that an axis moves by, to have planes across it
_TOO_CLOSE = 0.4  # of the spacing
_WIDEST = 3.0  # mm
_WIDEST_PLANES = 2.0  # mm, a power of 2
_GROWTH = 0.5
_FEWEST = 8
_NEAR = 0.1  # of the spacing
_MAX_PARTS = 64
_PARTS_PER_SPACING = 4.0


def spacing_at(
    turn: FloatArray, bend: FloatArray, density: FloatArray, curvature: FloatArray, tolerance: FloatArray
) -> FloatArray:
    """Spacing wanted at junctions, (n,), mm.

    Of turn (rad), curvature jump (1/mm), turning density (rad/mm), and the curvature (1/mm) behind chords.
    """
    with np.errstate(divide="ignore"):
        by_turn = _PER_ANGLE * tolerance / turn
        by_turn = np.minimum(by_turn, _PER_CHORD * np.sqrt(8.0 * tolerance / curvature))
        by_jump = np.sqrt(_PER_JUMP * tolerance / bend)
        by_turning = np.where(turn < SHARP, _TURNING / density, np.inf)
    return np.asarray(np.minimum(np.minimum(by_turn, by_jump), np.minimum(by_turning, _WIDEST)))


def place(
    start: float,
    end: float,
    at: FloatArray,
    spacing: FloatArray,
    pinned: FloatArray,
    chords: BoolArray | None = None,
    points: Callable[[FloatArray], FloatArray] | None = None,
) -> FloatArray:
    """Knots from start to end.

    Parameters
    ----------
    start, end : float
        mm.
    at, spacing : (n,) arrays
        Where which spacing is wanted; increasing, mm.
    pinned : (k,) array
        Places that must be knots, increasing.
    chords : (n,) bool array, optional
        Which of the places are junctions of chords of a curve: between two of them knots lie in planes.
    points : callable, optional
        Programmed points (m, dim) at abscissae (m,), mm; needed where there are chords.

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
    in_plane = np.zeros(corners.size, dtype=np.bool_)
    if points is not None and chords is not None and chords.any():
        of_chords = np.isin(s, at[chords])
        between = (of_chords[:-1] & of_chords[1:])[index]
        planes = _planes(fine, fine_spacing, points(fine), between)
        planes = _apart(np.interp(planes, fine, count), np.interp(corners, fine, count), planes)
        corners, in_plane = _merged(corners, planes)
    at_corner = np.interp(corners, fine, count)
    pieces = np.diff(at_corner)
    pieces = np.where(in_plane[1:] | in_plane[:-1], np.rint(pieces), np.ceil(pieces - 1e-9)).clip(1).astype(int)
    if pieces.sum() < _FEWEST:
        pieces = pieces * int(np.ceil(_FEWEST / pieces.sum()))
    index = np.repeat(np.arange(pieces.size), pieces)
    within = (np.arange(index.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[index]
    knots = np.interp(at_corner[index] + np.diff(at_corner)[index] * within, count, fine)
    knots[np.cumsum(pieces) - pieces] = corners[:-1]
    return np.append(knots, end)


def _planes(s: FloatArray, spacing: FloatArray, points: FloatArray, between: BoolArray) -> FloatArray:
    """Where the path goes through planes, increasing, in the cells of ``s`` (m,) that ``between`` (m - 1,) tells."""
    step = np.diff(points, axis=0)
    along = np.abs(step) >= _ALONG * np.sqrt(np.sum(step**2, axis=1))[:, None]
    cell, axis = np.arange(between.size), np.argmax(along, axis=1)
    apart = np.minimum(2.0 ** np.rint(np.log2(0.5 * (spacing[1:] + spacing[:-1]))), _WIDEST_PLANES)
    begin, end = points[:-1][cell, axis], points[1:][cell, axis]
    first = np.floor(np.minimum(begin, end) / apart) + 1.0
    number = np.floor(np.maximum(begin, end) / apart) - first + 1.0
    number = np.where(between & along[cell, axis], number, 0.0).astype(np.intp)
    cell = np.repeat(cell, number)
    plane = first[cell] + np.arange(cell.size) - np.repeat(np.cumsum(number) - number, number)
    share = (plane * apart[cell] - begin[cell]) / (end - begin)[cell]
    return np.sort(s[cell] + share * np.diff(s)[cell])


def _apart(count: FloatArray, corners: FloatArray, planes: FloatArray) -> FloatArray:
    """Those of the planes that are not too close to another or to a corner; ``count`` and ``corners`` in spacings."""
    beyond = np.searchsorted(corners, count).clip(1, corners.size - 1)
    kept = np.minimum(count - corners[beyond - 1], corners[beyond] - count) >= _TOO_CLOSE
    close = np.diff(count) < _TOO_CLOSE
    kept[1:] &= ~close
    kept[:-1] &= ~close
    return planes[kept]


def _merged(corners: FloatArray, planes: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Both in order, and which are planes."""
    every = np.concatenate([corners, planes])
    order = np.argsort(every, kind="stable")
    return every[order], order >= corners.size


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
