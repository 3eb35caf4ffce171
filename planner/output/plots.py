"""A plan as a figure: the path, the feed under its limits, what every axis uses, and which limit holds the path back.

Only this module loads matplotlib.  Figures are made and saved without pyplot, under a style of their own: neither a
user's settings nor the time of day changes them.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from planner.errors import InputError
from planner.files.whole_file import whole_file
from planner.geometry.curve import Curve
from planner.geometry.differential import chain_rule
from planner.inputs import require_instance
from planner.machine.feed_limits import feedrate_limits, largest_command
from planner.machine.limits import Limits, require_limits
from planner.profile import FeedrateProfile, ProfileStates, Samples
from planner.types import FloatArray
from planner.verify import Report, check

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

_SIZE = (7.1, 7.6)  # inches: the text width of a two-column page
_PIXELS_PER_INCH = 200
# Okabe and Ito's colours, which stay apart for every kind of colour vision.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_INK, _FAINT = "#222222", "#9a9a9a"
_FEED_MAP = "viridis"
_STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "figure.titlesize": 9.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.4,
    "axes.linewidth": 0.6,
    "axes.edgecolor": _INK,
    "axes.labelcolor": _INK,
    "text.color": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "lines.linewidth": 0.9,
    "lines.solid_joinstyle": "round",
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "path",
    "svg.hashsalt": "feedplan",
}
# What says when a file was made, or by which version of what, would make every file another one.
_NO_DATES: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "ModDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}
_SCAN_POINTS = 400_000  # where the plan is evaluated at most
_COLUMNS = 1200  # of a panel; each keeps the smallest and the largest value it covers
_PATH_POINTS = 2500
_CHORDS = 200_000
_CHORD_PLACES = np.array([0.25, 0.5, 0.75])  # of a period; the chord is farthest from the path near its middle
_LANES = 8
_LANE_SHARE = 0.005
_MIN_WORTH = 1e-4  # of the duration


@dataclass(frozen=True, eq=False)
class _AxisMotion:
    """The plan at many times, with the axes' motion: (n, dim) each."""

    states: ProfileStates
    acceleration: FloatArray
    jerk: FloatArray


def plot_plan(
    curve: Curve, limits: Limits, profile: FeedrateProfile, samples: Samples | None = None, report: Report | None = None
) -> Figure:
    """Draw a plan on one page.

    Top: the path of the tool tip coloured by feed, and the feed over arc length under its limits.  Below, over time:
    every axis's acceleration and jerk as a share of its limit, the chord error of every period, and the times at which
    each limit holds the path back, with the time that 10 % more of it would save.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    profile : FeedrateProfile
    samples : Samples, optional
        Points between which the chord error is drawn; those of the limits' period if left out.
    report : Report, optional
        What the check says of the plan; checked here if left out.  A plan that breaks a limit is drawn, and says so.

    Returns
    -------
    matplotlib.figure.Figure
        7.1 by 7.6 inches; ``save_plot`` writes it.

    Raises
    ------
    InputError
        If the axes of the limits are not those of the curve.
    """
    limits = require_limits(curve, limits)
    require_instance(profile, FeedrateProfile, "profile")
    motion = _scan(curve, profile)
    with _style():
        figure = Figure(figsize=_SIZE, layout="constrained")
        report = check(curve, limits, profile) if report is None else report
        title = _title(profile) if report.ok else f"{_title(profile)}\n{textwrap.fill(report.summary(), 100)}"
        figure.suptitle(title, x=0.01, ha="left", color="black" if report.ok else "tab:red")
        if profile.s[-1] > 0.0:
            grid = figure.add_gridspec(2, 1, height_ratios=(1.0, 1.75))
            top, bottom = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
            _draw_path(top, curve, motion)
            _draw_feed(top.add_subplot(1, 2, 2), curve, limits, motion)
        else:  # the tool tip rests: there is no path, no feed and no chord
            bottom = figure.add_subfigure(figure.add_gridspec(1, 1)[0])
        rows = 4 if profile.s[-1] > 0.0 else 3
        over_time = bottom.subplots(rows, 1, sharex=True, height_ratios=(1.3, 1.3, 1.0, 1.0)[:rows])
        _draw_shares(over_time[0], "acceleration", curve, limits, motion)
        _draw_shares(over_time[1], "jerk", curve, limits, motion)
        if rows == 4:
            _draw_chord_error(over_time[2], curve, limits, profile, samples)
        _draw_binding(over_time[-1], curve, profile)
        over_time[-1].set_xlabel("time, s")
        over_time[-1].set_xlim(0.0, profile.duration)
        bottom.align_ylabels(over_time[:-1])
        # Laid out once: every later drawing would start from the layout before it, and end a little elsewhere.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
    return figure


def save_plot(path: str | Path, figure: Figure) -> None:
    """Write a figure as PNG, PDF or SVG, whole or not at all; the same figure gives the same bytes.

    Raises
    ------
    InputError
        If the suffix is another one, or the file cannot be written.
    """
    suffix = figure_format(path)
    with _style(), whole_file(path) as file:
        figure.savefig(file, format=suffix[1:], dpi=_PIXELS_PER_INCH, metadata=_NO_DATES[suffix])


def figure_format(path: str | Path) -> str:
    """Return the suffix .png, .pdf or .svg of a file name; raise InputError for another one."""
    suffix = Path(path).suffix.lower()
    if suffix not in _NO_DATES:
        raise InputError(f'{path}: the suffix "{suffix}" must be one of {", ".join(_NO_DATES)}')
    return suffix


@contextmanager
def _style() -> Iterator[None]:
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def _title(profile: FeedrateProfile) -> str:
    text = f"{profile.curve.name}: {profile.duration:.5g} s with the method {profile.method}"
    return text + (f" (lower bound {profile.lower_bound:.5g} s)" if np.isfinite(profile.lower_bound) else "")


def _scan(curve: Curve, profile: FeedrateProfile) -> _AxisMotion:
    """Evaluate the plan inside its intervals, near both ends of each, since the jerk may jump at a node."""
    start = profile.t[:-1][np.diff(profile.t) > 0.0]
    width = np.diff(profile.t)[np.diff(profile.t) > 0.0]
    inside = max(2, min(_SCAN_POINTS // start.size, max(4, _PATH_POINTS // start.size)))
    share = np.linspace(0.0, 1.0, inside)
    share[0], share[-1] = 1e-6, 1.0 - 1e-6
    if start.size * inside > _SCAN_POINTS:
        pick = np.linspace(0, start.size - 1, _SCAN_POINTS // inside).astype(np.intp)
        start, width = start[pick], width[pick]
    states = profile.at((start[:, None] + width[:, None] * share).reshape(-1))
    u1, u2, u3 = (values[:, None] for values in (states.u_rate, states.u_acceleration, states.u_jerk))
    q = curve.derivatives(states.u, 3)
    _, acceleration, jerk = chain_rule(q[1], q[2], q[3], u1, u2, u3)
    return _AxisMotion(states, acceleration, jerk)


def _envelope(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Thin out a line to the first, smallest, largest and last value of each column of the panel."""
    if x.size <= 4 * _COLUMNS:
        return x, y
    column = np.minimum(((x - x[0]) / (x[-1] - x[0]) * _COLUMNS).astype(np.intp), _COLUMNS - 1)
    first = np.flatnonzero(np.diff(column, prepend=-1))
    last = np.append(first[1:], x.size) - 1
    order = np.lexsort((y, column))
    ends = np.stack([first, order[first], order[last], last])
    keep = np.unique(ends)
    return x[keep], y[keep]


# --- panels ---------------------------------------------------------------------------------------------------------


def _draw_path(parent: SubFigure, curve: Curve, motion: _AxisMotion) -> None:
    s, feed = motion.states.s, motion.states.feed
    at = np.unique(np.searchsorted(s, np.linspace(0.0, s[-1], _PATH_POINTS)).clip(0, s.size - 1))
    tip = curve.tip
    points = tip.derivatives(motion.states.u[at], 0)[0]
    moving = np.flatnonzero(np.ptp(points, axis=0) > 1e-9 * curve.length)[:3]
    segments = np.stack([points[:-1], points[1:]], axis=1)[:, :, moving]
    colour = {"cmap": _FEED_MAP, "array": 0.5 * (feed[at][:-1] + feed[at][1:]), "clim": (0.0, float(feed.max()))}
    names = [f"{tip.axes[j]}, mm" for j in moving]
    axes: Any
    if moving.size == 3:
        from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

        axes = parent.add_subplot(1, 2, 1, projection="3d")
        lines = axes.add_collection3d(Line3DCollection(segments, lw=1.6, **colour))
        _dress_box(axes, points[:, moving], names)
    else:
        axes = parent.add_subplot(1, 2, 1)
        if moving.size == 1:  # one linear axis beside rotary ones: unroll it
            segments = np.stack([np.stack([s[at][:-1], s[at][1:]], axis=1), segments[:, :, 0]], axis=2)
            names.insert(0, "arc length, mm")
        lines = axes.add_collection(LineCollection(list(segments), lw=1.6, capstyle="round", **colour))
        axes.autoscale_view()
        axes.set_aspect("equal", adjustable="datalim" if moving.size == 1 else "box")
        axes.set_xlabel(names[0])
        axes.set_ylabel(names[1])
    bar = parent.colorbar(lines, ax=axes, location="left" if moving.size == 3 else "right", shrink=0.8, aspect=28)
    bar.set_label("feed, mm/s")
    bar.outline.set_visible(False)


def _dress_box(axes: Any, points: FloatArray, names: Sequence[str]) -> None:
    span = np.ptp(points, axis=0)
    centre = 0.5 * (points.max(axis=0) + points.min(axis=0))
    half = 0.5 * np.maximum(span, 0.15 * span.max())
    for setter, middle, width in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), centre, half, strict=True):
        setter(middle - 1.05 * width, middle + 1.05 * width)
    axes.set_box_aspect(half, zoom=0.9)
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), names, strict=True):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis._axinfo["grid"].update(color="#dddddd", linewidth=0.4)
        axis.set_major_locator(mpl.ticker.MaxNLocator(4))
        axis.set_label_text(name)


def _draw_feed(axes: Axes, curve: Curve, limits: Limits, motion: _AxisMotion) -> None:
    s, feed = motion.states.s, motion.states.feed
    found = feedrate_limits(curve, limits, motion.states.u)
    parts = {
        "axis velocity": found.axis_velocity,
        "chord error": found.chord_error,
        "acceleration at steady feed": found.normal_acceleration,
    }
    command = largest_command(curve, limits)
    top = 1.12 * min(float(np.max(feed)) * 1.25, command) if np.isfinite(command) else 1.4 * float(feed.max())
    top = max(top, 1.05 * float(feed.max()))
    for (name, values), colour in zip(parts.items(), _COLOURS[1:4], strict=True):
        if float(values.min()) < top:
            axes.plot(*_envelope(s, np.minimum(values, 2.0 * top)), color=colour, lw=0.6, label=f"limit: {name}")
    if limits.feed < top:
        axes.axhline(limits.feed, color=_INK, lw=0.6, ls=(0, (4, 2)), label="limit: command")
    x, y = _envelope(s, feed)
    axes.fill_between(x, y, color=_COLOURS[0], alpha=0.15, lw=0.0)
    axes.plot(x, y, color=_COLOURS[0], lw=1.1, label="feed")
    axes.set_xlim(0.0, float(s[-1]))
    axes.set_ylim(0.0, top)
    axes.set_xlabel("arc length, mm")
    axes.set_ylabel("feed, mm/s")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, borderaxespad=0.2)


def _draw_shares(axes: Axes, what: str, curve: Curve, limits: Limits, motion: _AxisMotion) -> None:
    """Draw what each axis uses of its limit; an axis without a limit is left out."""
    values, allowed = getattr(motion, what), getattr(limits, what)
    shown = [
        (name, values[:, j] / allowed[j], _COLOURS[j]) for j, name in enumerate(curve.axes) if np.isfinite(allowed[j])
    ]
    tangential = getattr(limits, f"tangential_{what}")
    if np.isfinite(tangential):
        shown.append(("tangential", getattr(motion.states, what) / tangential, _INK))
    axes.axhline(0.0, color=_FAINT, lw=0.4)
    for bound in (-1.0, 1.0):
        axes.axhline(bound, color=_INK, lw=0.6, ls=(0, (4, 2)))
    for name, share, colour in shown:
        axes.plot(*_envelope(motion.states.t, share), color=colour, label=name)
    largest = max((float(np.abs(share).max()) for _, share, _ in shown), default=1.0)
    axes.set_ylim(-1.12 * max(1.0, largest), 1.12 * max(1.0, largest))
    if largest <= 1.5:
        axes.set_yticks([-1.0, 0.0, 1.0])
    axes.set_ylabel(f"{what}\nover limit")
    if shown:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), borderaxespad=0.4)


def _draw_chord_error(
    axes: Axes, curve: Curve, limits: Limits, profile: FeedrateProfile, samples: Samples | None
) -> None:
    t, error = _chord_errors(curve, limits, profile, samples)
    micro = 1e3
    axes.plot(*_envelope(t, micro * error), color=_COLOURS[0])
    top = float(error.max())
    if np.isfinite(limits.chord_error):
        axes.axhline(micro * limits.chord_error, color=_INK, lw=0.6, ls=(0, (4, 2)))
        top = max(top, limits.chord_error)
    axes.set_ylim(0.0, 1.12 * micro * top if top > 0.0 else 1.0)
    axes.set_ylabel("chord error,\nµm")


def _chord_errors(
    curve: Curve, limits: Limits, profile: FeedrateProfile, samples: Samples | None
) -> tuple[FloatArray, FloatArray]:
    """Distance of the tip's path from the chord of each period, at the middle of the period; (m,) each, s and mm."""
    if samples is None:
        t = np.append(np.arange(0.0, profile.duration, limits.period), profile.duration)
        u = profile.at(t).u
    else:
        t, u = samples.t, samples.u
    k = np.unique(np.linspace(0, t.size - 2, min(t.size - 1, _CHORDS)).astype(np.intp))
    between = u[k, None] + (u[k + 1] - u[k])[:, None] * _CHORD_PLACES
    path = curve.tip.derivatives(np.clip(between, *curve.domain), 0)[0]
    ends = curve.tip.derivatives(np.stack([u[k], u[k + 1]]), 0)[0]
    chord = (ends[1] - ends[0])[:, None]
    square = np.sum(chord**2, axis=-1)
    off = path - ends[0][:, None]
    along = np.divide(np.sum(off * chord, axis=-1), square, out=np.zeros(off.shape[:2]), where=square > 0.0)
    apart = np.sqrt(np.sum((off - np.clip(along, 0.0, 1.0)[..., None] * chord) ** 2, axis=-1))
    return 0.5 * (t[k] + t[k + 1]), apart.max(axis=1)


def _draw_binding(axes: Axes, curve: Curve, profile: FeedrateProfile) -> None:
    """Draw one lane for each limit, filled while it holds the path back; an axis keeps its colour."""
    colours = dict(zip(curve.axes, _COLOURS, strict=False))
    shares = [item for item in profile.shares().items() if item[0] != "none" and item[1] >= _LANE_SHARE][:_LANES]
    edges = np.linspace(0.0, profile.duration, 2 * _COLUMNS + 1)
    node = np.searchsorted(0.5 * (profile.t[:-1] + profile.t[1:]), 0.5 * (edges[:-1] + edges[1:]))
    for lane, (name, _) in enumerate(shares):
        held = np.concatenate([[False], profile.binding[node] == profile.limit_names.index(name), [False]])
        first, last = np.flatnonzero(~held[:-1] & held[1:]), np.flatnonzero(held[:-1] & ~held[1:])
        bars = list(zip(edges[first], edges[last] - edges[first], strict=True))
        axes.broken_barh(bars, (lane - 0.38, 0.76), color=colours.get(name.split()[-1], _INK), lw=0.0)
    axes.set_yticks(range(len(shares)), [f"{name}  {100.0 * share:.0f} %" for name, share in shares])
    axes.set_ylim(max(len(shares), 4) - 0.5, -0.5)  # few lanes stay slim
    axes.tick_params(axis="y", length=0.0)
    axes.spines["left"].set_visible(False)
    axes.set_title("held back by", loc="left")
    saved = profile.saved_by_one_percent
    worth = [
        (lane, f"{10.0 * saved[name]:.2g} s")
        for lane, (name, _) in enumerate(shares)
        if _is_worth(saved, name, profile.duration)
    ]
    # beside the lanes, under a heading of its own
    for place, text in [*worth, (-1, "10 % more\nsaves")] if worth else []:
        axes.annotate(
            text,
            (1.0, place),
            (4.0, 0.0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center" if place >= 0 else "bottom",
            annotation_clip=False,
            fontsize="small",
        )


def _is_worth(saved: Mapping[str, float], limit: str, duration: float) -> bool:
    return 10.0 * saved.get(limit, 0.0) >= _MIN_WORTH * duration
