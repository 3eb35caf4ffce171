"""A plan as a figure: the path, the feed under its limits, what every axis uses, and which limit holds the path back."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure, SubFigure

from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.inputs import require_instance
from planner.machine.limits import Limits, require_limits
from planner.output.figures import CHARACTER_MM, LINE_MM, figure_style, inches, place_panels
from planner.output.panel_choice import NARROW_MM, PAGE_MM, PLAN_PANELS, panel_names, require_width
from planner.output.plan_panels import (
    draw_binding,
    draw_chord_error,
    draw_feed,
    draw_path,
    draw_shares,
    lanes_of,
    path_height,
    share_names,
)
from planner.output.traces import PlanTraces, trace_chord_error, trace_plan
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.verify import Report, check
from planner.verify.findings import BREAKS

_USUAL = ("path", "feed", "acceleration", "jerk", "chord", "binding")
_SHARES = ("velocity", "acceleration", "jerk")
_NEED_MOTION = {"path", "feed", "chord"}  # of the tool tip
_POINTS = 400_000  # where the plan is evaluated at most
_CHORDS = 200_000
# mm
_FEED_HEIGHT, _SHARE_HEIGHT, _CHORD_HEIGHT, _LANE_HEIGHT, _LANES_ROOM = 58.0, 24.0, 20.0, 6.5, 5.0
_TIME_AXIS, _TITLE_ROOM = 9.0, 2.0


def plot_plan(
    curve: Curve,
    limits: Limits,
    profile: FeedrateProfile,
    samples: Samples | None = None,
    report: Report | None = None,
    *,
    panels: str | Sequence[str] | None = None,
    width_mm: float = PAGE_MM,
) -> Figure:
    """Draw a plan on one page.

    "path" is that of the tool tip, coloured by feed; rapids are grey, and do not take part in the colours.  "feed" is
    drawn over arc length under its limits.  The others are drawn over time: what every axis uses of its "velocity",
    "acceleration" and "jerk", the "chord" error of every period, and under "binding" the times at which each limit holds
    the path back, with the time that 10 % more of it would save.  A limit has one colour in all of them.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    profile : FeedrateProfile
    samples : Samples, optional
        Points between which the chord error is drawn; those of the limits' period if left out.
    report : Report, optional
        What the check says of the plan; checked here if left out.  A plan that breaks a limit is drawn, and says so.
    panels : str or sequence of str, optional
        As "path,feed" or ("path", "feed"): path and feed come first, the others in this order.  If left out all but
        "velocity", and no panel that would be empty.
    width_mm : float
        80 to 420; fonts are 7 and 8 points at any width.  Below 130, path and feed stand one under the other.  The height
        follows from the panels.

    Returns
    -------
    matplotlib.figure.Figure
        ``save_plot`` writes it.

    Raises
    ------
    InputError
        If the axes of the limits are not those of the curve, a panel is unknown, or the width out of range.
    """
    limits = require_limits(curve, limits)
    require_instance(profile, FeedrateProfile, "profile")
    for given, kind, name in ((samples, Samples, "samples"), (report, Report, "report")):
        if given is not None:
            require_instance(given, kind, name)
    width = require_width(width_mm)
    moves = profile.s[-1] > 0.0
    chosen = _chosen(panels, curve, limits, moves=moves)
    traces = trace_plan(curve, limits, profile, _POINTS)
    report = check(curve, limits, profile) if report is None else report
    text = _title(profile, report, int(width / CHARACTER_MM))
    heights = {name: _height(name, width, curve, limits, profile, traces) for name in chosen}
    over_path = [name for name in chosen if name in {"path", "feed"}]
    beside = len(over_path) == 2 and width >= NARROW_MM
    rows = [max(heights[name] for name in over_path)] if beside else [heights[name] for name in over_path]
    over_time = [name for name in chosen if name not in over_path]
    if over_time:
        rows.append(sum(heights[name] for name in over_time) + _TIME_AXIS)
    with figure_style():
        head = _TITLE_ROOM + LINE_MM * (1 + text.count("\n"))
        figure = Figure(figsize=(inches(width), inches(head + sum(rows))), layout="constrained")
        figure.suptitle(text, x=0.01, ha="left", color="black" if report.ok else "tab:red")
        grid = figure.add_gridspec(len(rows), 1, height_ratios=rows)
        parts = [figure.add_subfigure(grid[k]) for k in range(len(rows))]
        for k, name in enumerate(over_path):
            column = 1 + k if beside else 1
            part = parts[0] if beside else parts[k]
            if name == "path":
                draw_path(part, (1, 2 if beside else 1, column), curve, traces)
            else:
                draw_feed(part.add_subplot(1, 2 if beside else 1, column), curve, limits, traces)
        if over_time:
            rest = {name: heights[name] for name in over_time}
            _draw_over_time(parts[-1], rest, curve, limits, profile, samples, traces)
        place_panels(figure)
    return figure


def _chosen(panels: str | Sequence[str] | None, curve: Curve, limits: Limits, *, moves: bool) -> tuple[str, ...]:
    """Names of the panels, in the order in which they are drawn."""
    if panels is None:
        empty = {what for what in _SHARES if not share_names(curve, limits, what)}
        return tuple(name for name in _USUAL if name not in empty and (moves or name not in _NEED_MOTION))
    names = panel_names(panels, PLAN_PANELS)
    for name in names:
        if name in _NEED_MOTION and not moves:  # then there is no path, no feed and no chord
            raise InputError(f'panels: "{name}" cannot be drawn, since the tool tip rests on {curve.name}')
        if name in _SHARES and not share_names(curve, limits, name):
            raise InputError(f'panels: "{name}" would be empty, since no axis has a limit of its {name}')
    return tuple(sorted(names, key=lambda name: {"path": -2, "feed": -1}.get(name, names.index(name))))


def _height(
    name: str, width: float, curve: Curve, limits: Limits, profile: FeedrateProfile, traces: PlanTraces
) -> float:
    """Height of a panel, mm."""
    if name == "path":
        return path_height(curve, traces, width if width < NARROW_MM else 0.5 * width)
    if name == "binding":
        return _LANES_ROOM + _LANE_HEIGHT * max(1, len(lanes_of(profile)))
    return {"feed": _FEED_HEIGHT, "chord": _CHORD_HEIGHT}.get(name, _SHARE_HEIGHT)


def _draw_over_time(
    part: SubFigure,
    heights: dict[str, float],
    curve: Curve,
    limits: Limits,
    profile: FeedrateProfile,
    samples: Samples | None,
    traces: PlanTraces,
) -> None:
    ratios = list(heights.values())
    column = part.subplots(len(heights), 1, sharex=True, height_ratios=ratios, squeeze=False)[:, 0]
    for name, axes in zip(heights, column, strict=True):
        if name == "chord":
            draw_chord_error(
                axes, limits, trace_chord_error(curve, samples or _sampled(curve, limits, profile), _CHORDS)
            )
        elif name == "binding":
            draw_binding(axes, profile)
        else:
            draw_shares(axes, name, curve, limits, traces)
    column[-1].set_xlabel("time, s")
    column[-1].set_xlim(0.0, profile.duration)
    part.align_ylabels([axes for name, axes in zip(heights, column, strict=True) if name != "binding"])


def _sampled(curve: Curve, limits: Limits, profile: FeedrateProfile) -> Samples:
    """Where the plan is, once a period."""
    t = np.append(np.arange(0.0, profile.duration, limits.period), profile.duration)
    u = profile.at(t).u
    return Samples(limits.period, t, u, curve.derivatives(u, 0)[0])


def _title(profile: FeedrateProfile, report: Report, letters: int) -> str:
    """What is drawn, and in a line of its own what breaks: the worst first, as many as fit."""
    text = f"{profile.curve.name}: {profile.duration:.5g} s, {profile.method}"
    if np.isfinite(profile.lower_bound):
        text += f"; lower bound {profile.lower_bound:.5g} s"
    text = textwrap.fill(text, letters)
    axes: dict[str, list[str]] = {}
    for row in sorted(report.violations, key=lambda row: -row.ratio):
        axes.setdefault(row.limit, []).append(row.axis)
    names = [" ".join([limit, *axes[limit]]).strip() for limit in axes]
    for shown in range(len(names), 0, -1):
        rest = len(names) - shown
        line = f"{BREAKS}: {', '.join(names[:shown])}" + (f" and {rest} more" if rest else "")
        if len(line) <= letters or shown == 1:
            return f"{text}\n{textwrap.shorten(line, letters, placeholder=' ...')}"
    return text
