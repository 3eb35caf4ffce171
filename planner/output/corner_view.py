"""A corner of a program, seen close: the tolerance around it, the paths that motions take, and how fast they are.

Everything is drawn in the plane of the corner: one axis goes on along the block before it, the other across that, towards
the block behind.  Where the program turns back the other axis is the one across which the first motion goes farthest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from planner.errors import InputError
from planner.output.figures import DASHED, LINE_MM, figure_style, inches, place_panels
from planner.output.palette import FAINT, INK, SERIES
from planner.output.panel_choice import NARROW_MM, PAGE_MM, require_width
from planner.types import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MICRO = 1e3
_MILLI = 1e3
_CLOSE = 6.0  # half the width of the corner seen closest, in tolerances
_SLOW = 0.6  # of the fastest: the time in which all motions are slower is shown
_REST = 1e-3  # of the fastest: slower is called rest, since the motion is sampled
_ROOM, _ABOVE = 1.5, 1.25  # of the tolerance: around the disc, and above its lines
_PARALLEL = 1e-6  # sine of the angle below which the blocks span no plane
_ROW_MM, _CORNER_MM = 52.0, 60.0
_TUBE = "#e6e9ec"
_ALONG, _ACROSS = "-", (0.0, (2.2, 1.0))


@dataclass(frozen=True, eq=False)
class CornerPass:
    """A motion past a vertex.

    Attributes
    ----------
    label : str
    t : (n,) array
        s, increasing.
    position, velocity : (n, d) arrays
        Then, mm and mm/s.
    """

    label: str
    t: FloatArray
    position: FloatArray
    velocity: FloatArray


@dataclass(frozen=True, eq=False)
class Corner:
    """A vertex of a program and the motions past it.

    Attributes
    ----------
    before, vertex, after : (d,) arrays
        Where the block before begins, where it ends, and where the next one ends, mm.
    tolerance : float
        mm.
    passes : sequence of CornerPass
    """

    before: FloatArray
    vertex: FloatArray
    after: FloatArray
    tolerance: float
    passes: Sequence[CornerPass]

    def __post_init__(self) -> None:
        if not self.passes:
            raise InputError("passes is empty; a corner is drawn with at least one motion past it")
        if not self.tolerance > 0.0:
            raise InputError(f"tolerance = {self.tolerance!r} mm must be > 0")
        for name in ("before", "after"):
            if not np.linalg.norm(getattr(self, name) - self.vertex) > 0.0:
                raise InputError(f"{name} = {getattr(self, name)} is the vertex itself; a block has a length")

    @property
    def turn(self) -> float:
        """Angle between the directions of the two blocks, degrees."""
        a, b = self.vertex - self.before, self.after - self.vertex
        # The arc tangent of half the angle keeps its digits at 0 and at 180 degrees.
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        return float(np.rad2deg(2.0 * np.arctan2(np.linalg.norm(b - a), np.linalg.norm(b + a))))

    @property
    def plane(self) -> FloatArray:
        """Two unit vectors, (2, d): along the block before, and across it."""
        along, leaving = self.vertex - self.before, self.after - self.vertex
        along = along / np.linalg.norm(along)
        across = leaving - (leaving @ along) * along
        size = np.linalg.norm(across)
        if size < _PARALLEL * np.linalg.norm(leaving):
            off = self.passes[0].position - self.vertex
            off = off - np.outer(off @ along, along)
            across = off[np.argmax(np.sum(off**2, axis=1))]
            size = np.linalg.norm(across)
            if size == 0.0:  # all on one line: any other direction serves
                across = np.eye(along.size)[np.argmin(np.abs(along))]
                across = across - (across @ along) * along
                size = np.linalg.norm(across)
        return np.stack([along, across / size])


@dataclass(frozen=True, eq=False)
class _Seen:
    """A motion in the plane of its corner: time from the vertex, s; place from it, mm; speeds, mm/s."""

    label: str
    t: FloatArray
    place: FloatArray
    velocity: FloatArray
    feed: FloatArray
    off: FloatArray  # distance from the program, mm, inside positive


def plot_corner(corner: Corner, title: str = "", *, width_mm: float = PAGE_MM) -> Figure:
    """Draw a corner: the path close to the vertex, how far it is off the program, the feed and the speed of both axes.

    Parameters
    ----------
    corner : Corner
    title : str
    width_mm : float
        80 to 420; below 130 the panels stand one under the other.

    Returns
    -------
    matplotlib.figure.Figure
        ``save_plot`` writes it.
    """
    width = require_width(width_mm)
    seen = [_see(corner, motion) for motion in corner.passes]
    span = _slow_time(seen)
    columns = 2 if width >= NARROW_MM else 1
    with figure_style():
        height = 4.0 * LINE_MM + (_CORNER_MM + _ROW_MM) * (1 if columns == 2 else 2)
        figure = Figure(figsize=(inches(width), inches(height)), layout="constrained")
        ratios = [_CORNER_MM, _ROW_MM] if columns == 2 else [_CORNER_MM, _ROW_MM, _CORNER_MM, _ROW_MM]
        panels = figure.subplots(4 // columns, columns, height_ratios=ratios, squeeze=False).flat
        _draw_corner(panels[0], corner, seen)
        _draw_distance(panels[1], corner, seen, span)
        _draw_feed(panels[2], seen, span)
        _draw_axes(panels[3], seen, span)
        lines, labels = panels[0].get_legend_handles_labels()
        ncols = len(labels) if columns == 2 else 1
        figure.legend(lines, labels, loc="outside upper left", ncols=ncols, title=title, alignment="left")
        place_panels(figure)
    return figure


def _see(corner: Corner, motion: CornerPass) -> _Seen:
    """Take a motion apart in the plane of its corner; it begins to count where it is nearest to the vertex."""
    plane = corner.plane
    place = (motion.position - corner.vertex) @ plane.T
    nearest = int(np.argmin(np.sum((motion.position - corner.vertex) ** 2, axis=1)))
    return _Seen(
        motion.label,
        motion.t - motion.t[nearest],
        place,
        motion.velocity @ plane.T,
        np.sqrt(np.sum(motion.velocity**2, axis=1)),
        distance_from(corner, motion.position),
    )


def distance_from(corner: Corner, position: FloatArray) -> FloatArray:
    """Distance of points (n, d) from the two blocks of a corner, (n,), mm, positive on its inside."""
    ends = corner.before, corner.after
    feet = [_foot(position, corner.vertex, end) for end in ends]
    gap = np.array([np.sqrt(np.sum((position - foot) ** 2, axis=1)) for foot in feet])
    legs = [(end - corner.vertex) / np.linalg.norm(end - corner.vertex) for end in ends]
    # What points into the corner: across each leg, towards the other.
    inward = [b - (a @ b) * a for a, b in (legs, legs[::-1])]
    side = np.array([(position - foot) @ into for foot, into in zip(feet, inward, strict=True)])
    nearer = np.argmin(gap, axis=0)
    pick = np.arange(len(position))
    # Outside, where both are nearest to the vertex, no foot tells a side: what is on neither leg's inner side is outside.
    inside = np.where(side[nearer, pick] >= 0.0, 1.0, -1.0)
    return np.asarray(gap[nearer, pick] * inside)


def _foot(position: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Nearest points of a segment."""
    chord = end - start
    share = np.clip((position - start) @ chord / (chord @ chord), 0.0, 1.0)
    return np.asarray(start + share[:, None] * chord)


def _slow_time(seen: Sequence[_Seen]) -> tuple[float, float]:
    """When to begin and to end, s from the vertex, so that all motions are seen to be slow there."""
    begin, end = 0.0, 0.0
    for motion in seen:
        fast = motion.feed > _SLOW * motion.feed.max()
        before, after = motion.t[fast & (motion.t < 0.0)], motion.t[fast & (motion.t > 0.0)]
        begin = min(begin, float(before[-1] if before.size else motion.t[0]))
        end = max(end, float(after[0] if after.size else motion.t[-1]))
    return begin, end


# --- panels ---------------------------------------------------------------------------------------------------------


def _draw_corner(axes: Axes, corner: Corner, seen: Sequence[_Seen]) -> None:
    """The tolerance as a grey tube with the disc of the vertex, the program dashed, and the paths."""
    e = _MICRO * corner.tolerance
    reach = _CLOSE * e
    ends = [_MICRO * (corner.plane @ (end - corner.vertex)) for end in (corner.before, corner.after)]
    for end in ends:
        direction = end / np.hypot(*end)
        normal = e * np.array([-direction[1], direction[0]])
        axes.add_patch(Polygon([normal, normal + end, end - normal, -normal], color=_TUBE, lw=0.0))
    axes.add_patch(Circle((0.0, 0.0), e, color=_TUBE, lw=0.0))
    for end in ends:
        direction = end / np.hypot(*end)
        normal = e * np.array([-direction[1], direction[0]])
        for side in (normal, -normal):
            axes.plot(*np.stack([side, side + end]).T, color=FAINT, lw=0.5)
    axes.add_patch(Circle((0.0, 0.0), e, fill=False, ec=FAINT, lw=0.5))
    axes.plot(*np.stack([ends[0], np.zeros(2), ends[1]]).T, color=INK, lw=0.6, ls=DASHED, label="program")
    for motion, colour in zip(seen, SERIES, strict=False):
        at = np.flatnonzero(np.abs(_MICRO * motion.place).max(axis=1) < 3.0 * reach)
        axes.plot(*(_MICRO * motion.place[at]).T, color=colour, lw=1.1, label=motion.label)
    axes.set_aspect("equal", adjustable="box")
    middle = 0.5 * reach * (ends[0] / np.hypot(*ends[0]) + ends[1] / np.hypot(*ends[1]))
    middle *= min(1.0, (reach - _ROOM * e) / max(np.hypot(*middle), e))  # all of the disc is seen
    axes.set_xlim(middle[0] - reach, middle[0] + reach)
    axes.set_ylim(middle[1] - reach, middle[1] + reach)
    axes.set_xlabel("along the block before, from the vertex, µm")
    axes.set_ylabel("across it, µm")
    axes.set_title(f"the corner, and {e:g} µm around it", loc="left")


def _draw_distance(axes: Axes, corner: Corner, seen: Sequence[_Seen], span: tuple[float, float]) -> None:
    """How far each motion is off the program: where it swings out, and where it cuts the corner."""
    e = _MICRO * corner.tolerance
    for motion, colour in zip(seen, SERIES, strict=False):
        at = _within(motion, span)
        axes.plot(_MILLI * motion.t[at], _MICRO * motion.off[at], color=colour)
    for bound in (-e, e):
        axes.axhline(bound, color=INK, lw=0.6, ls=DASHED)
    axes.axhline(0.0, color=FAINT, lw=0.4)
    axes.set_xlim(_MILLI * span[0], _MILLI * span[1])
    axes.set_ylim(-_ABOVE * e, _ABOVE * e)
    axes.set_xlabel("time from the vertex, ms")
    axes.set_ylabel("inside is positive, µm")
    axes.set_title("off the program; dashed: the tolerance", loc="left")


def _draw_feed(axes: Axes, seen: Sequence[_Seen], span: tuple[float, float]) -> None:
    """The feed of each motion over time, at rest in the vertex or not."""
    for motion, colour in zip(seen, SERIES, strict=False):
        at = _within(motion, span)
        lowest = float(motion.feed[at].min())
        said = "comes to rest" if lowest < _REST * motion.feed.max() else f"{lowest:.3g} mm/s at least"
        axes.plot(_MILLI * motion.t[at], motion.feed[at], color=colour, label=said)
    axes.set_xlim(_MILLI * span[0], _MILLI * span[1])
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time from the vertex, ms")
    axes.set_ylabel("feed, mm/s")
    axes.set_title("feed", loc="left")
    axes.legend(loc="upper center")


def _draw_axes(axes: Axes, seen: Sequence[_Seen], span: tuple[float, float]) -> None:
    """The speed along the block before, and across it: how far the braking of the one overlaps the start of the other."""
    for motion, colour in zip(seen, SERIES, strict=False):
        at = _within(motion, span)
        for row, dashes in enumerate((_ALONG, _ACROSS)):
            axes.plot(_MILLI * motion.t[at], motion.velocity[at, row], color=colour, ls=dashes)
    axes.axhline(0.0, color=FAINT, lw=0.4)
    axes.plot([], [], color=INK, ls=_ALONG, label="along the block before")
    axes.plot([], [], color=INK, ls=_ACROSS, label="across it")
    axes.set_xlim(_MILLI * span[0], _MILLI * span[1])
    axes.set_xlabel("time from the vertex, ms")
    axes.set_ylabel("speed, mm/s")
    axes.set_title("each axis", loc="left")
    axes.legend(loc="upper center")


def _within(motion: _Seen, span: tuple[float, float]) -> IntArray:
    return np.flatnonzero((motion.t >= span[0]) & (motion.t <= span[1]))
