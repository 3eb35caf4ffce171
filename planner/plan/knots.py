"""Where the knots of a bound go, and of plans without a jerk limit; those of other plans follow a law (``time_knots.py``).

The guess of the feed gives the time spent along the path, and knots are placed by

    density = 0.2 uniform + 0.5 time + 0.3 turning angle,

with neighbouring spacings within a factor of about 2, no fewer than twenty in each rest blend, and a knot on every
break of the path: a double one where q''' jumps, so that the plan's third derivative may jump with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.plan.ends import Rest
from planner.plan.guess import FeedGuess, breaks_inside, least_times
from planner.plan.rest_map import BLEND_LENGTH
from planner.plan.section import Section
from planner.sets import union
from planner.types import FloatArray

_UNIFORM, _TIME, _TURNING = 0.2, 0.5, 0.3
# A path that turns by less in all, rad, is a straight line: its turning is rounding.
_STRAIGHT = 1e-9
# |d spacing / d sigma| that keeps neighbours within a factor 2
_GROWTH = 0.6
# Knots at least for a change of log |C'| by 1, and the share of the jerk limit that the quintics between may add.
_PER_CHANGE, _STRETCHED_JERK = 4.0, 1e-3
_BLEND_KNOTS = 20
_SLIVER = 1e-13  # of the whole
# An axis that hardly moves at a stop hardly limits what the path may do there; beyond this factor its share is not taken.
_UNUSUAL = 10.0
# Spacing at a curvature jump against the width of the dip there, and at most how many knots a dip may add to a grid.
_DIP_SHARE, _DIP_KNOTS = 0.25, 40


@dataclass(frozen=True, eq=False)
class Grid:
    """Knots of a section.

    Attributes
    ----------
    sigma : (n,) array
        Non-decreasing; equal neighbours are a double knot.
    u : (n,) array
        Curve parameters, exact on breaks.
    left : (k,) int array
        Knots at which the path is taken from the left: the first of each double one, and the last.
    """

    sigma: FloatArray
    u: FloatArray
    left: NDArray[np.intp]

    @property
    def stretch_end(self) -> FloatArray:
        """For each knot the parameter at which its stretch between breaks ends, (n,)."""
        return np.repeat(self.u[self.left], np.diff(self.left, prepend=-1))

    @property
    def intervals(self) -> int:
        """Number of intervals that are not empty."""
        return int(np.count_nonzero(np.diff(self.sigma) > 0.0))


def with_blends(section: Section, guess: FeedGuess) -> Section:
    """Give a section the widths of its rest map: v (v/A + A/J) / 2 at each stop, shrunk until both fit."""
    widths = []
    for at, end in ((0, section.start), (-1, section.end)):
        if not isinstance(end, Rest):
            widths.append(0.0)
            continue
        distance = guess.length if at == 0 else guess.length[-1] - guess.length
        top = float(guess.feed.max())
        jerk, most = _at_stop(guess.jerk, at), _at_stop(guess.acceleration, at)
        for _ in range(4):
            acceleration = min(most, float(np.sqrt(top * jerk)))
            build_up = acceleration / jerk if np.isfinite(jerk) else 0.0
            width = 0.5 * top * (top / acceleration + build_up)
            top = float(guess.feed[distance <= max(width, distance[1 if at == 0 else -2])].max())
        widths.append(width if section.arc is not None else width / float(guess.speed[at]))
    room = (section.y_end - section.y_start) / BLEND_LENGTH
    if sum(widths) > room:
        # Where one stop needs little, the other may use what it leaves.
        share = room / sum(widths)
        widths = [width * share for width in widths]
    return replace(section, blend_start=widths[0], blend_end=widths[1])


def _at_stop(allowed: FloatArray, at: int) -> float:
    """Acceleration or jerk at a stop; where no axis with a limit moves there, what is usual along the path."""
    usual = allowed[np.isfinite(allowed)]
    if not usual.size:
        return float(allowed[at])
    usual = np.sort(usual)
    median = 0.5 * (usual[(usual.size - 1) // 2] + usual[usual.size // 2])
    return float(min(allowed[at], _UNUSUAL * median))


def place_knots(section: Section, guess: FeedGuess, intervals: int, *, follow: bool = False) -> Grid:
    """Distribute about ``intervals`` intervals over a section (with blends) by the density above.

    ``follow``: more where quintics of u would not follow |C'| otherwise; a bound has none.
    """
    span, w0, w1 = section.span, section.blend_start, section.blend_end
    # Between the blends sigma is y and a constant; inside them it is sampled by itself, no inverse is needed.
    straight = guess.y - section.y_start + (1.0 - BLEND_LENGTH) * w0
    straight = straight[(straight > w0) & (straight < span - w1)]
    blend = np.linspace(0.0, 1.0, 8 * _BLEND_KNOTS + 1)
    sigma = union(blend * w0, straight, span - blend * w1)
    # A break may lie on a sample but for rounding; such a sliver has no density of its own.
    sigma = sigma[np.append(np.diff(sigma) > _SLIVER * span, True)]
    sigma[0] = 0.0
    y = section.position(sigma)
    time = guess.time
    cumulated = _UNIFORM * sigma / span + _TIME * np.interp(y, guess.y, time) / time[-1]
    cumulated += _TURNING * np.interp(y, guess.y, guess.turning) / max(guess.turning[-1], _STRAIGHT)
    step = np.diff(sigma)
    density = intervals * np.diff(cumulated) / (step * cumulated[-1])
    mid = 0.5 * (sigma[1:] + sigma[:-1])
    density[mid < section.blend_start] = np.maximum(
        density[mid < section.blend_start], _BLEND_KNOTS / max(section.blend_start, 1e-300)
    )
    density[span - mid < section.blend_end] = np.maximum(
        density[span - mid < section.blend_end], _BLEND_KNOTS / max(section.blend_end, 1e-300)
    )
    with np.errstate(divide="ignore"):  # a cell so short that rounding leaves it no share
        spacing = 1.0 / density
    dips = section.sigma(guess.dips.y)
    for shift in (0, 1):  # the cells on either side of a dip
        cell = np.clip(np.searchsorted(sigma, dips) - shift, 0, spacing.size - 1)
        np.minimum.at(spacing, cell, _DIP_SHARE * guess.dips.width)
    with np.errstate(over="ignore"):
        stretched = np.minimum(spacing, step * followed(guess, y)) if follow else spacing
    most = intervals + _DIP_KNOTS * dips.size
    count = _counted(sigma, step, spacing, mid, span)
    wanted = count[-1]
    if follow:
        count = _counted(sigma, step, stretched, mid, span)
        most += int(count[-1] - wanted)
    count *= max(1.0, min(most, count[-1]) / intervals) * intervals / count[-1]
    return _knots(section, sigma, count)


def followed(guess: FeedGuess, y: FloatArray) -> FloatArray:
    """Largest spacing of knots, in cells of the ``y (n,)``, at which their quintics follow |C'|, (n - 1,).

    With dL the change of log |C'| over the way ds of an interval, and l = ds / dL, a quintic in time is off by about
    (v^3 / l^2) dL^3 of jerk: by its sixth derivative where |C'| goes like the root of the way.  No closer than rounding
    allows, see :func:`least_times`.
    """
    change = np.abs(np.diff(np.interp(y, guess.y, np.log(guess.speed))))
    way = np.diff(np.interp(y, guess.y, guess.length))
    feed, jerk, least = (
        0.5 * (at[1:] + at[:-1])
        for at in (np.interp(y, guess.y, row) for row in (guess.feed, guess.jerk, least_times(guess)))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        each = np.minimum(1.0 / _PER_CHANGE, np.cbrt(_STRETCHED_JERK * jerk * (way / change) ** 2 / feed**3)) / change
        # of a cell that rounding leaves no way nothing is known
        return np.nan_to_num(np.fmax(each, 2.0 * least * feed / way), nan=np.inf)


def _counted(sigma: FloatArray, step: FloatArray, spacing: FloatArray, mid: FloatArray, span: float) -> FloatArray:
    """Accumulated number of intervals over sigma at these spacings of the cells, each in the growth of its neighbours."""
    spacing = spacing.copy()
    for flip in (slice(None), slice(None, None, -1)):
        ramp = _GROWTH * (mid[flip] if flip.step is None else span - mid[flip])
        spacing[flip] = np.minimum.accumulate(spacing[flip] - ramp) + ramp
    return np.concatenate([[0.0], np.cumsum(step / spacing)])


def _knots(section: Section, sigma: FloatArray, count: FloatArray) -> Grid:
    """Knots at whole numbers of intervals between breaks, given the accumulated number of intervals over sigma."""
    on = breaks_inside(section)
    corners = np.concatenate([[0.0], section.sigma(section.coordinate(on)), [section.span]])
    at = np.interp(corners, sigma, count)
    pieces = np.maximum(1, np.rint(np.diff(at))).astype(np.intp)
    parts = []
    for k, n in enumerate(pieces):
        inner = np.interp(at[k] + (at[k + 1] - at[k]) * np.arange(1, n) / n, count, sigma)
        parts.append(np.concatenate([[corners[k]], inner, [corners[k + 1]]]))
    knots = np.concatenate(parts)
    ends = np.cumsum(pieces + 1) - 1
    return make_grid(section, knots, ends, on)


def make_grid(section: Section, knots: FloatArray, ends: NDArray[np.intp], breaks: FloatArray) -> Grid:
    """Attach curve parameters to knots; ``ends`` are the last knots of the stretches between the given breaks."""
    u = section.parameter(section.position(knots))
    starts = np.concatenate([[0], ends[:-1] + 1])
    corners = np.concatenate([[section.u_start], breaks, [section.u_end]])
    u[starts], u[ends] = corners[:-1], corners[1:]
    return Grid(knots, u, ends)


def split(section: Section, grid: Grid, where: NDArray[np.bool_]) -> Grid:
    """Halve the intervals at which ``where`` (one flag an interval, empty ones included) is true."""
    halves = np.flatnonzero(where & (np.diff(grid.sigma) > 0.0))
    middle = 0.5 * (grid.sigma[halves] + grid.sigma[halves + 1])
    sigma = np.insert(grid.sigma, halves + 1, middle)
    ends = grid.left + np.searchsorted(halves, grid.left, side="left")
    return make_grid(section, sigma, ends, grid.u[grid.left[:-1]])
