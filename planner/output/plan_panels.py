"""The panels of a plan's figure: each draws into axes it is given.

What is drawn comes from ``traces``, whose lines keep the peaks of each stretch; colours and dashes come from ``palette``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from planner.geometry.curve import Curve
from planner.machine.feed_limits import COMMANDS, feedrate_limits, largest_command
from planner.machine.limits import Limits
from planner.output.figures import DASHED, envelope
from planner.output.palette import FAINT, INK, RAPID, limit_colour, line_dashes
from planner.output.traces import PlanTraces, Traces
from planner.profile import FeedrateProfile
from planner.quantity import AXIS, FEED, motion_names
from planner.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

_FEED_MAP = "viridis"
_PATH_POINTS = 2500
_PATH_ROOM_MM = 15.0  # beside and below a path, for its labels
_MIN_PATH_MM = 32.0
# A path in space is seen from the front right and from above, in parallel: each axis to the right and up.
_FROM, _ABOVE_BY = np.radians(60.0), np.radians(30.0)
_VIEW = np.array(
    [
        [np.sin(_FROM), -np.cos(_FROM) * np.sin(_ABOVE_BY)],
        [np.cos(_FROM), np.sin(_FROM) * np.sin(_ABOVE_BY)],
        [0.0, np.cos(_ABOVE_BY)],
    ]
)
_LANES = 8
_LANE_SHARE = 0.005
_MIN_WORTH = 1e-4  # of the duration
_MAX_SHARE = 4.0  # of a limit: higher peaks are named and not drawn, so that the limit stays visible
_SEEN = 0.003  # of the path: a line shown for less has no entry in the legend
_GREY = "#777777"
_ABOVE: dict[str, Any] = {
    "loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1, "columnspacing": 1.2, "handletextpad": 0.5,
}  # fmt: skip


# --- along the path -------------------------------------------------------------------------------------------------


def path_height(curve: Curve, traces: PlanTraces, width: float) -> float:
    """Height of the path's panel for its width, mm: as the path's shape needs, and at most a square."""
    moving = _moving(curve, traces.position)
    seen = traces.position[:, moving]
    if moving.size == 3:
        seen = _corners(seen).reshape(-1, 3) @ _VIEW
    span = np.ptp(seen, axis=0)
    ratio = 0.5 if moving.size == 1 else float(span[1] / span[0])
    room = width - 2.0 * _PATH_ROOM_MM  # numbers and label left, colours right
    return float(np.clip(room * ratio, _MIN_PATH_MM, room)) + _PATH_ROOM_MM  # of a path in space for its three lines


def _moving(curve: Curve, position: FloatArray) -> Any:
    return np.flatnonzero(np.ptp(position, axis=0) > 1e-9 * curve.length)[:3]


def draw_path(parent: SubFigure, place: tuple[int, int, int], curve: Curve, traces: PlanTraces) -> None:
    """Draw the tool tip's path, cutting moves by feed and rapids in grey."""
    s = traces.s
    feed = 0.5 * (traces.low["feed"].astype(np.float64) + traces.high["feed"])
    at = np.unique(np.searchsorted(s, np.linspace(0.0, s[-1], _PATH_POINTS)).clip(0, s.size - 1))
    if traces.rapid.any():  # the ends of rapids, which are exact
        at = np.union1d(at, np.flatnonzero(np.diff(traces.rapid)))
    tip = curve.tip
    points = traces.position[at]
    moving = _moving(curve, traces.position)
    names = [f"{tip.axes[j]}, mm" for j in moving]
    columns = [points[:, j] for j in moving]
    if moving.size == 1:  # one linear axis beside rotary ones: unroll it
        columns.insert(0, s[at])
        names.insert(0, "arc length, mm")
    line = np.stack(columns, axis=1)
    if in_space := moving.size == 3:
        line = line @ _VIEW
    segments = np.stack([line[:-1], line[1:]], axis=1)
    rapid = traces.rapid[at][1:]
    fastest = float(feed[~traces.rapid].max()) if not traces.rapid.all() else 0.0
    # The first segment after a rapid begins with the feed of the rapid, which is not its own.
    before, after = feed[at][:-1], feed[at][1:]
    middle = np.where(traces.rapid[at][:-1], after, 0.5 * (before + after))
    colour: dict[str, Any] = {
        "cmap": _FEED_MAP,
        "array": middle[~rapid],
        "clim": (0.0, fastest or 1.0),
    }
    grey: dict[str, Any] = {"colors": RAPID, "linewidths": 0.7, "linestyles": [(0, (3, 1.5))]}
    axes = parent.add_subplot(*place)
    lines = axes.add_collection(LineCollection(list(segments[~rapid]), lw=1.6, capstyle="round", **colour))
    if rapid.any():
        axes.add_collection(LineCollection(_runs(line, rapid), **grey))
    if in_space:
        _draw_box(axes, traces.position[:, moving], [tip.axes[j] for j in moving])
    else:
        axes.set_xlabel(names[0])
        axes.set_ylabel(names[1])
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim" if moving.size == 1 else "box")
    if rapid.any():
        entry = Line2D([], [], color=RAPID, lw=0.7, ls=(0, (3, 1.5)), label="rapid")
        axes.legend(handles=[entry], **_ABOVE)
    bar = parent.colorbar(lines, ax=axes, location="right", shrink=0.8, aspect=28)
    bar.set_label("feed, mm/s")
    bar.outline.set_visible(False)


def _runs(line: FloatArray, chosen: Any) -> list[FloatArray]:
    """Stretches of chosen segments, each as one line: dashes then run through."""
    first, last = np.flatnonzero(np.diff(chosen.astype(np.int8), prepend=0, append=0)).reshape(-1, 2).T
    return [line[i : j + 1] for i, j in zip(first, last, strict=True)]


def _corners(points: FloatArray) -> FloatArray:
    """Corners of the box around points in space, (2, 2, 2, 3) by the ends of the three axes."""
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1)


def _draw_box(axes: Axes, points: FloatArray, names: Sequence[str]) -> None:
    """Draw the box around a path in space, with letters beside its three nearest edges, and how far it reaches above."""
    corner = _corners(points) @ _VIEW
    edges = np.concatenate([np.moveaxis(corner, j, 0).reshape(2, 4, 2) for j in range(3)], axis=1)
    axes.add_collection(LineCollection(list(edges.swapaxes(0, 1)), colors="#dddddd", lw=0.5, zorder=0))
    nearest = (corner[:, 0, 0], corner[1, :, 0], corner[0, 0])
    for name, edge, where in zip(names, nearest, ((-3.0, -2.0), (3.0, -2.0), (-3.0, 0.0)), strict=True):
        axes.plot(*edge.T, color=INK, lw=0.6, zorder=1)
        axes.annotate(name, edge.mean(axis=0), where, textcoords="offset points", fontsize=7.0,
                      ha="right" if where[0] < 0.0 else "left", va="top" if where[1] < 0.0 else "bottom")  # fmt: skip
    reach = zip(names, points.min(axis=0), points.max(axis=0), strict=True)
    text = "\n".join(f"{name} {low:.4g} to {high:.4g} mm" for name, low, high in reach)
    axes.set_title(text.replace("-", "\N{MINUS SIGN}"), loc="left", fontsize=7.0, pad=9.0)
    axes.set_axis_off()


def draw_feed(axes: Axes, curve: Curve, limits: Limits, traces: PlanTraces) -> None:
    """Draw the feed over arc length, under the machine's feed, the program's F words and what the curve allows."""
    s = traces.s
    fastest = float(traces.high["feed"].max())
    command = largest_command(curve, limits)
    top = 1.12 * min(1.25 * fastest, command) if np.isfinite(command) else 1.4 * fastest
    top = max(top, 1.05 * fastest)
    colour = limit_colour("feed")
    x, y = _line(s, traces, "feed")
    axes.fill_between(x, y, color=colour, alpha=0.15, lw=0.0)
    axes.plot(x, y, color=colour, lw=1.2, label="feed", zorder=3)
    found = feedrate_limits(curve, limits, traces.u)
    bounds = (
        ("axis velocity", found.axis_velocity, _GREY, (0, (5, 1.5, 1, 1.5))),
        ("chord error", found.chord_error, limit_colour("chord error"), (0, (6, 1))),
        ("acceleration at steady feed", found.normal_acceleration, _GREY, (0, (1.5, 0.8))),
    )
    for name, values, shade, dashes in bounds:
        if np.sum(np.diff(s)[np.maximum(values[:-1], values[1:]) < top]) > _SEEN * s[-1]:
            axes.plot(
                *envelope(s, np.minimum(values, 2.0 * top)), color=shade, lw=0.7, ls=dashes, label=f"limit: {name}"
            )
    if (steps := _programmed(curve)) is not None:
        if np.nanmin(steps[1]) < top:
            axes.plot(*steps, color=limit_colour("programmed feed"), lw=0.6, label="limit: F word", zorder=4)
        _shade_rapids(axes, curve)
    if limits.feed < top:
        axes.axhline(limits.feed, color=INK, lw=0.6, ls=DASHED, label="limit: command")
    axes.set_xlim(0.0, float(s[-1]))
    axes.set_ylim(0.0, top)
    axes.set_xlabel("arc length, mm")
    axes.set_ylabel("feed, mm/s")
    axes.legend(ncols=2, **_ABOVE)


def _programmed(curve: Curve) -> tuple[FloatArray, FloatArray] | None:
    """The F words over arc length as steps, nan on rapids; None where no F word counts."""
    caps = curve.feed_caps
    if caps is None or np.isinf(caps.feed).all():
        return None
    value = np.where(np.isinf(caps.feed), np.nan, caps.feed)
    kept = np.flatnonzero(np.append(True, ~((value[1:] == value[:-1]) | (np.isnan(value[1:]) & np.isnan(value[:-1])))))
    s = curve.arclength.s(np.append(caps.edges[kept], caps.edges[-1]))
    return np.repeat(s, 2)[1:-1], np.repeat(value[kept], 2)


def _shade_rapids(axes: Axes, curve: Curve) -> None:
    """Mark stretches of rapids by a grey ground."""
    caps = curve.feed_caps
    assert caps is not None
    edge = np.flatnonzero(np.diff(np.isinf(caps.feed).astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    if edge.size:
        s = curve.arclength.s(caps.edges[edge])
        bars = [(float(a), float(b - a)) for a, b in s]
        axes.broken_barh(bars, (0.0, 1.0), transform=axes.get_xaxis_transform(), color=RAPID, alpha=0.18, lw=0.0,
                         label="rapid", zorder=0)  # fmt: skip


# --- over time ------------------------------------------------------------------------------------------------------


def share_names(curve: Curve, limits: Limits, what: str) -> list[tuple[str, str, str, float]]:
    """What a panel of shares shows: label, name of the limit, and name and unit of the trace of each line."""
    (quantity,) = (q for q in AXIS if q.label == what)
    allowed, names = limits.of_motions(quantity.order), motion_names(quantity.order, curve.axes)
    found = np.isfinite(allowed)
    shown = [
        (axis, name, name, 1.0) for axis, name, is_limited in zip(curve.axes, names, found, strict=False) if is_limited
    ]
    if quantity.order > FEED.order and found[-1]:  # the feed has a panel of its own
        shown.append(("tangential", names[-1], what, float(allowed[-1])))
    return shown


def draw_shares(axes: Axes, what: str, curve: Curve, limits: Limits, traces: PlanTraces) -> None:
    """Draw what each axis uses of its limit of velocity, acceleration or jerk; an axis without one is left out."""
    axes.axhline(0.0, color=FAINT, lw=0.4)
    for bound in (-1.0, 1.0):
        axes.axhline(bound, color=INK, lw=0.6, ls=DASHED)
    largest = 1.0
    for label, limit, trace, unit in share_names(curve, limits, what):
        t, share = _line(traces.t, traces, trace)
        share = share / unit
        largest = max(largest, float(np.abs(share).max()))
        axes.plot(t, share, color=limit_colour(limit), ls=line_dashes(limit), label=label)
    if largest > _MAX_SHARE:
        text = f"peaks to {largest:.3g}"
        axes.text(0.995, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=7.0, color="tab:red",
                  bbox={"fc": "white", "ec": "none", "pad": 0.5, "alpha": 0.8})  # fmt: skip
    top = 1.12 * min(largest, _MAX_SHARE)
    axes.set_ylim(-top, top)
    if largest <= 1.5:
        axes.set_yticks([-1.0, 0.0, 1.0])
    axes.set_ylabel(f"{what}\nover limit")
    axes.legend(ncols=7, **_ABOVE)


def draw_chord_error(axes: Axes, limits: Limits, chords: Traces) -> None:
    """Draw the distance of the path from the chord of each period."""
    micro = 1e3
    t, error = _line(chords.t, chords, "chord error")
    axes.plot(t, micro * error, color=limit_colour("chord error"))
    top = float(chords.high["chord error"].max())
    if np.isfinite(limits.chord_error):
        axes.axhline(micro * limits.chord_error, color=INK, lw=0.6, ls=DASHED)
        top = max(top, limits.chord_error)
    axes.set_ylim(0.0, 1.12 * micro * top if top > 0.0 else 1.0)
    axes.set_ylabel("chord error,\nµm")


def lanes_of(profile: FeedrateProfile) -> list[tuple[str, float]]:
    """Limits that hold the path back for long enough to be seen, with their share of the time; largest first."""
    return [item for item in profile.shares().items() if item[0] != "none" and item[1] >= _LANE_SHARE][:_LANES]


def draw_binding(axes: Axes, profile: FeedrateProfile) -> None:
    """Draw one lane for each limit, under its name, filled while it holds the path back."""
    lanes = lanes_of(profile)
    cuts = np.concatenate([[0.0], 0.5 * (profile.t[:-1] + profile.t[1:]), [profile.duration]])
    for lane, (name, share) in enumerate(lanes):
        held = profile.binding == profile.limit_names.index(name)
        first, last = np.flatnonzero(np.diff(held.astype(np.int8), prepend=0, append=0)).reshape(-1, 2).T
        bars = list(zip(cuts[first], cuts[last] - cuts[first], strict=True))
        axes.broken_barh(bars, (lane + 0.02, 0.4), color=limit_colour(name), lw=0.0)
        axes.annotate(f"{name}  {100.0 * share:.0f} %", (0.0, lane), (0.0, 0.8), xycoords=("axes fraction", "data"),
                      textcoords="offset points", va="bottom", fontsize=7.0)  # fmt: skip
        saved = _saved(profile, name)
        if saved >= _MIN_WORTH * profile.duration:
            text = f"{'10 % more saves ' if lane == 0 else ''}{saved:.2g} s"
            axes.annotate(text, (1.0, lane), (0.0, 0.8), xycoords=("axes fraction", "data"),
                          textcoords="offset points", va="bottom", ha="right", fontsize=7.0)  # fmt: skip
    if not lanes:
        axes.text(0.0, 0.5, "no limit is used up", fontsize=7.0, transform=axes.transAxes)
    axes.set_yticks([])
    axes.set_ylim(max(len(lanes), 1) - 0.4, -0.65)
    axes.spines["left"].set_visible(False)
    axes.set_title("held back by", loc="left", pad=1.0)


def _saved(profile: FeedrateProfile, name: str) -> float:
    """Seconds that 10 % more of a limit saves; a feed that binds is commanded by the machine, an F word or as a rapid."""
    saved = profile.saved_by_one_percent
    names = COMMANDS if name == "feed" else (name,)
    return 10.0 * sum(saved.get(one, 0.0) for one in names)


def _line(x: FloatArray, traces: Traces, name: str) -> tuple[FloatArray, FloatArray]:
    """A trace as a line over x, thinned out; of buckets both extremes."""
    low, high = (side[name].astype(np.float64) for side in (traces.low, traces.high))
    if not traces.thinned:
        return envelope(x, low)
    return envelope(np.repeat(x, 2), np.stack([low, high], axis=1).reshape(-1))
