"""The experiments of two papers run again: feed shapes (2002) and adaptive feed with look-ahead (2007).

    python -m benchmarks.classics [--output result.json] [--figures DIRECTORY]

Cheng, Tsai, Cheng, Real-time variable feedrate parametric interpolator for CNC machining, IFAC 2002: the NURBS circle at
100 mm/s with ramps of 0.5 s; feed errors, contour errors on the X-Y table, computing times beside the published ones.

Zhang, Zhou, Intelligent NURBS interpolator based on the adaptive feedrate control, Chin. J. Aeronaut. 20 (2007): feed and
acceleration before and after the look-ahead with the limits of the paper.  Its curve is not printed: here it is the
butterfly NURBS.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.environment import environment
from interp.literature.feedshapes import (
    FILTERS,
    SHAPES,
    FeedShape,
    ShapedRun,
    filter_axes,
    interpolate_constant,
    interpolate_shape,
)
from interp.literature.lookahead import PAPER_LIMITS, AdaptiveLimits, AdaptiveRun, interpolate_adaptive
from interp.literature.servo import Tracking, contour_error, track
from interp.taylor import packed_curve
from planner import load_curve
from planner.compiled import core
from planner.errors import InputError
from planner.files.whole_file import require_writable, whole_file
from planner.geometry.curve import Curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

FEED, RAMP = 100.0, 0.5  # mm/s, s
PERIODS = (1e-3, 2e-3)
CONTROL_PERIOD = 1e-3
# Table 1 of 2002, us on a TMS320C32: order -> trapezoid, exponential, bell; and its servo controller.
PUBLISHED_US = {1: (540.0, 580.0, 600.0), 2: (1020.0, 1040.0, 1140.0)}
PUBLISHED_SERVO_US = 45.0
FORMS = (("averaged", 1), ("averaged", 2), ("uniform", 1), ("uniform", 2))
REPEATS = 15
STEPS_PER_REPEAT = 100_000
TOLERANCE = 1e-6  # relative excess that still counts as within a limit
LIMITATIONS = (
    "2002: figure 4 is lost, so the bell is a raised cosine and the exponential has a time constant of a fifth of the "
    "ramp, cut off a ramp after it begins to fall.",
    "2002: against the feed at the start of a period a second-order step shows A T/2 as an error; its own reference is "
    "the mean of both ends.  At 2 ms the step across the double knot u = 0.5 hides the rank of trapezoid and bell.",
    "2002: contour errors are simulated with the printed transfer functions, without noise, friction and quantisation.",
    "Computing times: the paper's are those of a 2002 signal processor with NURBS evaluated from the recurrence; ours of "
    "a compiled loop on power-basis pieces.  They are listed, not compared.",
    "2007: acceleration is the difference of the chord feeds of neighbouring periods; the normal acceleration is the "
    "square of their mean times the curvature between them.",
)


@dataclass(frozen=True)
class FeedError:
    """Largest feed errors of one run, mm/s, against the feed at the start of a period and against its mean."""

    period_s: float
    shape: str
    order: int
    against_start: float
    against_mean: float
    off_the_knot: float
    samples: int
    reached: float


@dataclass(frozen=True)
class ContourError:
    """One command on the X-Y table, mm."""

    acceleration: str
    kind: str
    ramp_s: float
    path_error: float
    largest: float
    rms: float
    lag: tuple[float, ...]


@dataclass(frozen=True)
class StepTime:
    """Computing time of one step: as published, us, and here, ns."""

    order: int
    shape: str
    published_us: float
    measured_ns: float


@dataclass(frozen=True)
class LookAhead:
    """One run at the adaptive feed; ratios are against the limits of the paper."""

    form: str
    period_s: float
    duration_s: float
    samples: int
    acceleration_ratio: float
    acceleration_exceeded: int
    planned_ratio: float
    normal_ratio: float
    normal_exceeded: int
    feed_error: float
    looked_ahead_mm: float
    compute_ms: float


# ---- 2002 ----------------------------------------------------------------------------------------------------------


def shaped(curve: Curve, kind: Any, period: float, order: int, ramp: float = RAMP) -> ShapedRun:
    """One run with the acceleration before interpolation."""
    return interpolate_shape(curve, FeedShape(kind, curve.length, FEED, ramp), period, order=order)


def feed_errors(curve: Curve) -> list[FeedError]:
    """Every shape, order and period."""
    rows = []
    for period in PERIODS:
        for order in (1, 2):
            for kind in SHAPES:
                run = shaped(curve, kind, period, order)
                mean, u = np.abs(run.feed_error("mean")), run.samples.u
                off_knot = mean[(u[:-1] > 0.5) | (u[1:] < 0.5)]
                start = float(np.abs(run.feed_error("start")).max())
                row = start, float(mean.max()), float(off_knot.max()), u.size, run.reached
                rows.append(FeedError(period, kind, order, *row))
    return rows


def commands(curve: Curve, ramp: float) -> list[tuple[str, str, FloatArray]]:
    """Commands with the acceleration before and after interpolation: which, kind, positions."""
    found = [("before", str(kind), shaped(curve, kind, CONTROL_PERIOD, 2, ramp).samples.position) for kind in SHAPES]
    steady = interpolate_constant(curve, FEED, CONTROL_PERIOD).samples
    return found + [("after", str(kind), filter_axes(steady, kind, ramp).position) for kind in FILTERS]


def contour_errors(curve: Curve, ramp: float) -> tuple[list[ContourError], dict[str, tuple[Tracking, FloatArray]]]:
    """Every command on the table; the motions with their contour errors, for figures."""
    rows, motions = [], {}
    for which, kind, position in commands(curve, ramp):
        tracking = track(position, CONTROL_PERIOD)
        error = contour_error(curve, tracking.actual)
        rms = float(np.sqrt(np.mean(error[: tracking.moving] ** 2)))
        lag = tuple(np.abs(tracking.lag).max(axis=0).tolist())
        path = float(contour_error(curve, position).max())
        rows.append(ContourError(which, kind, ramp, path, float(error.max()), rms, lag))
        motions[f"{which}, {kind}"] = tracking, error
    return rows, motions


def median_ns(once: Callable[[], object], steps: int) -> float:
    """Median time of a step, ns; the first call is left out."""
    runs = max(1, STEPS_PER_REPEAT // steps)
    times = []
    for _ in range(REPEATS + 1):
        begin = time.perf_counter_ns()
        for _ in range(runs):
            once()
        times.append((time.perf_counter_ns() - begin) / (runs * steps))
    return float(np.median(times[1:]))


def step_times(curve: Curve) -> tuple[list[StepTime], float]:
    """Feed shape and interpolation of a step, and the servo loops of both axes, ns."""
    pieces = packed_curve(curve)
    sizes = curve.dim, *pieces.shape[1:]
    rows = []
    for order, published in PUBLISHED_US.items():
        for kind, us in zip(SHAPES, published, strict=True):
            run = shaped(curve, kind, CONTROL_PERIOD, order)
            count = run.samples.u.size
            u, feed, acceleration = np.zeros(count), np.empty(count), np.empty(count)
            numbers = FeedShape(kind, curve.length, FEED, RAMP).array
            out = count, u, feed, acceleration, np.empty((count, curve.dim))

            def once(order: int = order, numbers: FloatArray = numbers, out: Any = out) -> None:
                core.feedshape_run(order, numbers, pieces, *sizes, CONTROL_PERIOD, curve.domain[1], *out)

            rows.append(StepTime(order, kind, us, median_ns(once, count)))
    position = shaped(curve, "trapezoid", CONTROL_PERIOD, 2).samples.position
    servo = median_ns(lambda: track(position, CONTROL_PERIOD, settling=0.0), len(position))
    return rows, servo


# ---- 2007 ----------------------------------------------------------------------------------------------------------


def timed(curve: Curve, limits: AdaptiveLimits, **options: Any) -> tuple[AdaptiveRun, float]:
    """A run and its computing time, ms, the median of several."""
    run, times = interpolate_adaptive(curve, limits, **options), []
    for _ in range(5):
        begin = time.perf_counter()
        interpolate_adaptive(curve, limits, **options)
        times.append(1e3 * (time.perf_counter() - begin))
    return run, float(np.median(times))


def look_ahead_row(form: str, curve: Curve, limits: AdaptiveLimits, run: AdaptiveRun, took: float) -> LookAhead:
    """Measure a run against the limits."""
    feed = run.actual_feed
    along = np.abs(run.acceleration) / limits.acceleration
    across = (0.5 * (feed[1:] + feed[:-1])) ** 2 * curve.curvature(run.samples.u[1:-1]) / limits.normal_acceleration
    commanded = run.feed[:-1]
    counted = commanded[:-1] > 1.0
    return LookAhead(
        form,
        limits.period,
        run.duration,
        run.samples.u.size,
        float(along.max()),
        int((along > 1.0 + TOLERANCE).sum()),
        float(np.abs(run.planned_acceleration).max() / limits.acceleration),
        float(across.max()),
        int((across > 1.0 + TOLERANCE).sum()),
        float(np.abs(feed[:-1] / commanded[:-1] - 1.0)[counted].max()),
        run.looked_ahead,
        took,
    )


def look_ahead_rows(curve: Curve) -> tuple[list[LookAhead], dict[str, AdaptiveRun]]:
    """Before the look-ahead and after it, for every form and both periods; the runs at the paper's period."""
    rows, runs = [], {}
    for period in (PAPER_LIMITS.period, 0.5 * PAPER_LIMITS.period):
        limits = replace(PAPER_LIMITS, period=period)
        options: list[tuple[str, dict[str, Any]]] = [("before", {"look_ahead": False})]
        options += [(f"after, {rule}, order {order}", {"rule": rule, "order": order}) for rule, order in FORMS]
        for form, chosen in options:
            run, took = timed(curve, limits, **chosen)
            rows.append(look_ahead_row(form, curve, limits, run, took))
            runs.setdefault(form, run)
    return rows, runs


# ---- tables and figures --------------------------------------------------------------------------------------------


def page(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table whose first column is text."""
    table = Table(title=title, title_justify="left")
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k == 0 else "right")
    for row in rows:
        table.add_row(*row)
    return table


def feed_table(rows: Sequence[FeedError]) -> Table:
    """Feed errors, one line a run."""
    heads = ("2002: feed error, mm/s", "T ms", "order", "against V_k", "against the mean", "mean, off the knot")
    cells = [
        (r.shape, f"{1e3 * r.period_s:g}", f"{r.order}", *(f"{x:.4f}" for x in (r.against_start, r.against_mean)),
         f"{r.off_the_knot:.4f}")
        for r in rows
    ]  # fmt: skip
    return page("circle of 50 mm, 100 mm/s, ramps of 0.5 s", heads, cells)


def contour_table(rows: Sequence[ContourError]) -> Table:
    """Contour errors, one line a command."""
    heads = ("2002: acceleration", "ramp s", "path error mm", "contour error mm", "rms mm", "lag x, y mm")
    cells = [
        (f"{r.acceleration} interpolation, {r.kind}", f"{r.ramp_s:g}", f"{r.path_error:.4f}", f"{r.largest:.4f}",
         f"{r.rms:.4f}", ", ".join(f"{x:.3f}" for x in r.lag))
        for r in rows
    ]  # fmt: skip
    return page("the X-Y table, T = 1 ms", heads, cells)


def time_table(rows: Sequence[StepTime], servo_ns: float) -> Table:
    """The paper's Table 1 beside our times."""
    heads = ("2002: one step", "order", "published us", "measured ns")
    cells = [(r.shape, f"{r.order}", f"{r.published_us:.0f}", f"{r.measured_ns:.0f}") for r in rows]
    cells.append(("servo controller", "", f"{PUBLISHED_SERVO_US:.0f}", f"{servo_ns:.0f}"))
    return page("computing time", heads, cells)


def look_ahead_table(rows: Sequence[LookAhead]) -> Table:
    """Before and after the look-ahead."""
    heads = ("2007", "T ms", "time s", "a/a_max", "exceeded", "planned", "a_N ratio", "exceeded", "feed error", "ms")
    cells = [
        (r.form, f"{1e3 * r.period_s:g}", f"{r.duration_s:.3f}", f"{r.acceleration_ratio:.3f}",
         f"{r.acceleration_exceeded}", f"{r.planned_ratio:.3f}", f"{r.normal_ratio:.2f}", f"{r.normal_exceeded}",
         f"{100.0 * r.feed_error:.1f}%", f"{r.compute_ms:.2f}")
        for r in rows
    ]  # fmt: skip
    return page("butterfly NURBS, 100 mm/s, 9.8 m/s^2 along and 0.98 m/s^2 across the path", heads, cells)


def look_ahead_figure(runs: dict[str, AdaptiveRun]) -> Figure:
    """Feed and acceleration along u before and after the look-ahead (figures 6 and 7 of 2007)."""
    from planner.output.panels import Line, Panel, plot_panels

    chosen = {
        "before": "before look-ahead",
        "after, averaged, order 1": "after, as printed",
        "after, uniform, order 2": "after, uniform, order 2",
    }
    allowed = 1e-3 * PAPER_LIMITS.acceleration
    feeds, accelerations = [], []
    for form, title in chosen.items():
        run = runs[form]
        u = run.samples.u
        feeds.append(Panel(title, "u", "feed, mm/s", [Line("feed", u[:-1], run.actual_feed)], (PAPER_LIMITS.feed,)))
        line = Line("acceleration", u[1:-1], 1e-3 * run.acceleration)
        accelerations.append(Panel("", "u", "acceleration, m/s²", [line], (-allowed, allowed)))
    title = "Adaptive feed on the butterfly NURBS (Zhang, Zhou 2007)"
    return plot_panels(title, [*feeds, *accelerations], columns=len(chosen))


def feed_error_figure(curve: Curve) -> Figure:
    """Feed and feed error over time of the three shapes, second order (figure 7 of 2002)."""
    from planner.output.panels import Line, Panel, plot_panels

    feeds, errors = [], []
    for kind in SHAPES:
        run = shaped(curve, kind, CONTROL_PERIOD, 2)
        t = run.samples.t[:-1]
        feeds.append(Panel(kind, "time, s", "feed, mm/s", [Line("feed", t, run.actual_feed)]))
        lines = [Line("against V(t)", t, run.feed_error("start")), Line("against the mean", t, run.feed_error("mean"))]
        errors.append(Panel("", "time, s", "feed error, mm/s", lines))
    return plot_panels(
        "Second-order interpolator on the circle (Cheng, Tsai, Cheng 2002)", [*feeds, *errors], columns=3
    )


def contour_figure(motions: dict[str, tuple[Tracking, FloatArray]]) -> Figure:
    """Paths and contour errors of the X-Y table, trapezoid before and after interpolation (figure 8 of 2002)."""
    from planner.output.panels import Line, Panel, plot_panels

    paths, errors = [], []
    for name in ("before, trapezoid", "after, moving average"):
        tracking, error = motions[name]
        lines = [
            Line(label, p[:, 0], p[:, 1]) for label, p in (("command", tracking.command), ("actual", tracking.actual))
        ]
        which = name.split(",", maxsplit=1)[0]
        paths.append(Panel(f"acceleration {which} interpolation", "X, mm", "Y, mm", lines, equal=True))
        errors.append(Panel("", "time, s", "contour error, mm", [Line("contour error", tracking.t, error)]))
    return plot_panels("Position tracking of the X-Y table (Cheng, Tsai, Cheng 2002)", [*paths, *errors])


def run(show: Callable[[object], None], figures: Path | None) -> dict[str, object]:
    """Measure everything; tables go to ``show`` as they are found, the whole is returned."""
    circle, butterfly = load_curve("circle"), load_curve("butterfly-nurbs")
    errors = feed_errors(circle)
    show(feed_table(errors))
    contours, motions = contour_errors(circle, RAMP)
    contours += contour_errors(circle, 0.1 * RAMP)[0]
    show(contour_table(contours))
    times, servo_ns = step_times(circle)
    show(time_table(times, servo_ns))
    rows, runs = look_ahead_rows(butterfly)
    show(look_ahead_table(rows))
    for sentence in LIMITATIONS:
        show(sentence)
    if figures is not None:
        from planner.output.figures import save_plot

        save_plot(figures / "2002-feed-errors.png", feed_error_figure(circle))
        save_plot(figures / "2002-contour-errors.png", contour_figure(motions))
        save_plot(figures / "2007-look-ahead.png", look_ahead_figure(runs))
    duration = FeedShape("trapezoid", circle.length, FEED, RAMP).duration
    return {
        "benchmark": "classics",
        "environment": environment(),
        "2002": {
            "length_mm": circle.length,
            "duration_s": duration,
            "feed_errors_mm_s": [asdict(row) for row in errors],
            "contour_errors_mm": [asdict(row) for row in contours],
            "step_times": [asdict(row) for row in times],
            "servo": {"published_us": PUBLISHED_SERVO_US, "measured_ns": servo_ns},
        },
        "2007": {"limits": asdict(PAPER_LIMITS), "runs": [asdict(row) for row in rows]},
        "limitations": LIMITATIONS,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.classics", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--output", type=Path, help="write the result as JSON")
    parser.add_argument("--figures", type=Path, help="directory for the figures")
    options = parser.parse_args(arguments)
    if options.output is not None:
        require_writable(options.output)
    if options.figures is not None and not options.figures.is_dir():
        raise InputError(f"--figures {options.figures}: there is no such directory")
    result = run(Console(width=130).print, options.figures)
    if options.output is not None:
        with whole_file(options.output) as file:
            file.write((json.dumps(result, indent=1) + "\n").encode())


if __name__ == "__main__":
    main()
