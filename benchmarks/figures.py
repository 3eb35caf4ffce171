"""The figures of the 2022 summary again, for its four curves and algorithms, and the optimal plan beside them.

    python -m benchmarks.figures --output DIRECTORY [--curve NAME]

Five pictures a curve, all under the limits of the summary:

    NAME-feedrates.png            feed, its limit, and the axes' feeds (figures 1-4 and 11-16)
    NAME-chord-errors.png         chord error of every step under the tolerance (figures 5-8)
    NAME-feedrate-limits.png      the four limits, whose minimum counts (figures 17-19)
    NAME-acceleration.png         tangential acceleration between its bounds (figures 20-22)
    NAME-comparison.png           feed and jerk of all methods over the path

Left is the published program with its defects, where the command feedrate drives the steps; right is mode physical, where
the planned one does.  Figures 9 and 10 of the summary are photographs of a screen and have no data.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track

from benchmarks.greedy import ALGORITHMS, limits
from feedplan.cli.compare import FIGURE_TITLE, comparison_panels
from feedplan.comparison import compare
from feedplan.job import Job
from interp.literature.greedy import greedy
from interp.literature.greedy_published import PUBLISHED_COUNTS
from interp.literature.greedy_run import GreedyRun
from planner import load_curve
from planner.geometry.curve import Curve
from planner.machine.feed_limits import feedrate_limits
from planner.output.figures import save_plot
from planner.output.panels import Line, Panel, plot_panels
from planner.samples import Samples
from planner.types import FloatArray

LIMITS = limits()
COMPARED = "algorithm,2002,2007,toppra,scurve,optimal"
_ERROR_FLOOR = 1e-3  # of the tolerance; smaller errors are drawn as this
_FEED_ROOM = 1.6  # of the command, or of the feeds drawn: higher limits are cut off
_ACCELERATION_ROOM = 2.0  # of the axes' limit: what is beyond is cut off, and its peak named
_INNER = np.arange(1, 20) / 20.0


@dataclass(frozen=True, eq=False)
class Runs:
    """Everything that is drawn of one curve."""

    curve: Curve
    published: tuple[GreedyRun, ...]
    physical: tuple[GreedyRun, ...]
    plan: Samples

    def rows(self, algorithms: Sequence[int]) -> list[tuple[str, GreedyRun]]:
        """Left and right runs, row by row, with their titles."""
        found = []
        for number in algorithms:
            for name, runs in (("as published", self.published), ("physical", self.physical)):
                found.append((f"Algorithm {number}, {name}, {runs[number - 1].duration:.2f} s", runs[number - 1]))
        return found

    @property
    def plan_title(self) -> str:
        """Title of the plan's panel."""
        return f"optimal plan, {self.plan.t[-1]:.2f} s"


def run_all(name: str) -> Runs:
    """Run the algorithms in both modes, and plan."""
    curve = load_curve(name)
    job = Job(curve, LIMITS)
    published = tuple(greedy(curve, LIMITS, number) for number in ALGORITHMS)
    physical = tuple(greedy(curve, LIMITS, number, mode="physical", variant="root") for number in ALGORITHMS)
    return Runs(curve, published, physical, job.replay(job.plan()))


def feedrates(runs: Runs) -> Figure:
    """Planned feed, its limit, and the axes' feeds; below, the optimal plan and all of them over time."""
    panels = [
        _feed_panel(title, run.samples, run.limit, run.feed, first=k < 2)
        for k, (title, run) in enumerate(runs.rows(ALGORITHMS))
    ]
    u = runs.plan.u
    limit = feedrate_limits(runs.curve, LIMITS, u).lowest
    panels.append(_feed_panel(runs.plan_title, runs.plan, limit, _path_feed(runs.curve, runs.plan)))
    over_time = [Line("optimal plan", runs.plan.t, _path_feed(runs.curve, runs.plan))]
    for label, run in (("Algorithm 4, published", runs.published[3]), ("Algorithm 4, physical", runs.physical[3])):
        over_time.append(Line(label, run.samples.t, run.actual_feed))
    panels.append(Panel("feed that drives the axes", "time, s", "feed, mm/s", over_time, legend="above"))
    return plot_panels(_title(runs, "feedrates"), panels)


def _feed_panel(title: str, samples: Samples, limit: FloatArray, feed: FloatArray, *, first: bool = False) -> Panel:
    """Limit and planned feed, and what the axes really do."""
    axes = np.abs(np.diff(samples.position, axis=0)) / samples.period
    most = max(float(axes.max()), float(feed.max()))
    top = _FEED_ROOM * min(most, LIMITS.feed)
    bounds = [LIMITS.feed] if top >= LIMITS.feed else []
    lines = [
        Line("x axis", samples.u[:-1], axes[:, 0]),
        Line("y axis", samples.u[:-1], axes[:, 1]),
        Line("planned feed", samples.u, feed),
        Line("feedrate limit", samples.u, np.minimum(limit, top)),
    ]
    return Panel(title, "u", "feed, mm/s", lines, bounds, legend="above" if first else "none")


def chord_errors(runs: Runs) -> Figure:
    """Chord error of every step, and the one the program looked at where it is another one."""
    panels = []
    for k, (title, run) in enumerate(runs.rows(ALGORITHMS)):
        lines = [Line("own curve", run.u[:-1], _visible(run.chord_error[:-1]))]
        if not np.allclose(run.controlled_error, run.chord_error, rtol=1e-3, atol=0.0):
            lines.append(Line("curve it looked at", run.u[:-1], _visible(run.controlled_error[:-1])))
        panels.append(_error_panel(title, lines, first=k == 0))
    lines = [Line("own curve", runs.plan.u[:-1], _visible(_chord_errors(runs.curve, runs.plan.u)))]
    panels.append(_error_panel(runs.plan_title, lines))
    return plot_panels(_title(runs, "chord errors (dashed: tolerance)"), panels)


def _error_panel(title: str, lines: Sequence[Line], *, first: bool = False) -> Panel:
    return Panel(
        title, "u", "chord error, mm", lines, [LIMITS.chord_error], log=True, legend="above" if first else "none"
    )


def _visible(error: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(error, _ERROR_FLOOR * LIMITS.chord_error))


def feed_limits(runs: Runs) -> Figure:
    """The four limits of Algorithms 2 to 4, of the planner, and their minimum."""
    panels = [
        _limit_panel(title, run.u, _four(run.limits), first=k < 2)
        for k, (title, run) in enumerate(runs.rows((2, 3, 4)))
    ]
    u = runs.plan.u
    four = feedrate_limits(runs.curve, LIMITS, u)
    panels.append(_limit_panel(runs.plan_title, u, _four(four)))
    return plot_panels(
        _title(runs, f"finding the feedrate limit (cut off at {_FEED_ROOM * LIMITS.feed:g} mm/s)"), panels
    )


def _four(found: object) -> dict[str, FloatArray]:
    names = {
        "axis velocity": "axis_velocity",
        "chord error": "chord_error",
        "normal acceleration": "normal_acceleration",
    }
    lowest: FloatArray = found.lowest  # type: ignore[attr-defined]
    return {label: getattr(found, name) for label, name in names.items()} | {"minimum": lowest}


def _limit_panel(title: str, u: FloatArray, found: dict[str, FloatArray], *, first: bool = False) -> Panel:
    lines = [Line(name, u, np.minimum(values, _FEED_ROOM * LIMITS.feed)) for name, values in found.items()]
    return Panel(title, "u", "feed limit, mm/s", lines, [LIMITS.feed], legend="above" if first else "none")


def accelerations(runs: Runs) -> Figure:
    """Tangential acceleration that drives the axes, its bounds, and the column that the program printed."""
    panels = []
    for k, (title, run) in enumerate(runs.rows(ALGORITHMS)):
        # Entering and leaving are steps of the published program's feed: left out, as in its figures.
        inner = slice(1, -2)
        u, actual = run.u[inner], run.acceleration[inner]
        if run.mode == "compat":
            planned = np.diff(run.feed, prepend=run.feed[0])[inner] / run.samples.period
            extra = [Line("as it was printed", u, _cut(run.reported_acceleration[inner]))]
        else:
            planned, extra = actual, []
        panels.append(_acceleration_panel(title, u, planned, run.acceleration_range[inner], extra, k < 2))
    u, feed = runs.plan.u, _path_feed(runs.curve, runs.plan)
    bounds = _tangential_range(runs.curve, u, feed)
    actual = np.gradient(feed, runs.plan.t)
    panels.append(_acceleration_panel(runs.plan_title, u, actual, bounds, [], False))
    return plot_panels(
        _title(runs, "tangential acceleration of the planned feed, cut off at twice the axes' limit"), panels
    )


def _acceleration_panel(
    title: str, u: FloatArray, values: FloatArray, bounds: FloatArray, extra: Sequence[Line], first: bool
) -> Panel:
    peak = float(np.abs(values).max())
    lines = [
        Line("least", u, _cut(bounds[:, 0])),
        Line("largest", u, _cut(bounds[:, 1])),
        Line("of the planned feed", u, _cut(values)),
        *extra,
    ]
    label = "acceleration, mm/s²"
    return Panel(f"{title}, peak {peak:.4g}", "u", label, lines, legend="above" if first else "none")


def _cut(values: FloatArray) -> FloatArray:
    most = _ACCELERATION_ROOM * float(LIMITS.acceleration.max())
    return np.clip(values, -most, most)


def _tangential_range(curve: Curve, u: FloatArray, feed: FloatArray) -> FloatArray:
    """Least and largest A with |A t_j + V^2 k_j| <= A_j for every axis: t the tangent, k = d2q/ds2; (n, 2), mm/s^2."""
    d = curve.derivatives(u, 2)
    speed2 = np.sum(d[1] ** 2, axis=-1)[:, None]
    tangent = d[1] / np.sqrt(speed2)
    bend = (d[2] - d[1] * np.sum(d[1] * d[2], axis=-1)[:, None] / speed2) / speed2 * feed[:, None] ** 2
    with np.errstate(divide="ignore"):
        ends = np.stack([(side * LIMITS.acceleration - bend) / tangent for side in (-1.0, 1.0)])
    return np.stack([ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)], axis=-1)


def comparison(runs: Runs) -> Figure:
    """Feed and jerk of all methods under these limits."""
    found = compare(runs.curve, LIMITS, COMPARED)
    return plot_panels(_title(runs, FIGURE_TITLE), comparison_panels(found))


def _path_feed(curve: Curve, samples: Samples) -> FloatArray:
    """Feed at every sample, from the arc length around it."""
    return np.asarray(np.gradient(curve.arclength.s(samples.u), samples.t))


def _chord_errors(curve: Curve, u: FloatArray) -> FloatArray:
    """Distance of 19 inner points of each step from the line through its ends, the largest; (m - 1,), mm."""
    ends = curve.derivatives(u, 0)[0]
    inner = u[:-1, None] + np.diff(u)[:, None] * _INNER
    off = curve.derivatives(inner, 0)[0] - ends[:-1, None]
    chord = np.diff(ends, axis=0)[:, None]
    across = np.abs(off[..., 0] * chord[..., 1] - off[..., 1] * chord[..., 0])
    length = np.sqrt(np.sum(chord**2, axis=-1))
    return np.asarray(np.divide(across, length, out=np.zeros_like(across), where=length > 0.0).max(axis=1))


def _title(runs: Runs, what: str) -> str:
    return f"{runs.curve.name}: {what}"


PICTURES: dict[str, Callable[[Runs], Figure]] = {
    "feedrates": feedrates,
    "chord-errors": chord_errors,
    "feedrate-limits": feed_limits,
    "acceleration": accelerations,
    "comparison": comparison,
}


def draw(name: str, folder: Path) -> list[Path]:
    """Draw all pictures of a curve; returns their names."""
    runs = run_all(name)
    paths = []
    for what, picture in PICTURES.items():
        path = folder / f"{name}-{what}.png"
        save_plot(path, picture(runs))
        paths.append(path)
    return paths


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.figures", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--output", type=Path, required=True, help="directory of the pictures; made if it is not there")
    parser.add_argument("--curve", choices=list(PUBLISHED_COUNTS), help="only this one")
    options = parser.parse_args(arguments)
    names = list(PUBLISHED_COUNTS) if options.curve is None else [options.curve]
    options.output.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    for name in track(names, "drawing", console=console):
        for path in draw(name, options.output):
            console.print(f"written  {path}", soft_wrap=True)


if __name__ == "__main__":
    main()
