"""The pictures of docs/method.md.

    python -m benchmarks.method_figures [--output docs]

Every picture shows what the planner computes, taken apart by ``benchmarks.method``; no curve in them is drawn by hand.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle
from matplotlib.ticker import MaxNLocator, NullLocator
from PIL import Image
from rich.console import Console

from benchmarks import method
from benchmarks.method import Case
from feedplan.job import Job
from planner.law import TimeLaw
from planner.output.figures import figure_style, place_panels, save_plot
from planner.output.palette import FAINT, INK, SERIES
from planner.output.plan_panels import draw_binding, draw_shares
from planner.output.traces import trace_plan
from planner.types import FloatArray

_WIDTH = 7.1  # inches, as the other figures
_BLUE, _RED, _GREEN, _PINK, _ORANGE, _SKY = SERIES
_DASHED = (0, (4, 2))
_MIN_EXCESS = 1e-7  # drawn; below it a limit is met
_POINTS = 400_000  # where a plan is evaluated at most
_AROUND = 9  # intervals between nodes on either side of the worst
_INSIDE = 1e-6  # of an interval: the jerk may jump at its ends


@contextmanager
def _page(height: float, rows: int, columns: int, **options: Any) -> Iterator[tuple[Figure, Any]]:
    """A figure with its axes, laid out once what is drawn on it is there."""
    with figure_style():
        figure = Figure(figsize=(_WIDTH, height), layout="constrained")
        yield figure, figure.subplots(rows, columns, squeeze=False, **options)
        place_panels(figure)


def _limit(axes: Any, value: float = 1.0) -> None:
    axes.axhline(value, color=INK, lw=0.6, ls=_DASHED, zorder=1)


# --- rest map -------------------------------------------------------------------------------------------------------


def rest_map_figure(intervals: int = 16) -> Figure:
    """Squared speed near a stop over y and over sigma, and the jerk of cubic splines through its exact values."""
    plain, mapped = method.start_in_y(intervals), method.start_in_sigma(intervals)
    with _page(2.4, 1, 3) as (figure, ((slope, value, jerk),)):
        r = np.linspace(0.0, 1.4, 200)
        inside = np.minimum(r, 1.0)
        slope.plot(r, 1.0 - (1.0 - inside) ** 4 * (1.0 + 4.0 * inside + 6.0 * inside**2), color=_GREEN)
        slope.axvline(1.0, color=FAINT, lw=0.6, ls=_DASHED)
        slope.text(0.97, 0.06, "rest blend", ha="right")
        slope.set(title="slope of the rest map", xlabel="σ / w", ylabel="dy/dσ", ylim=(0.0, 1.1), xlim=(0.0, 1.4))
        value.plot(plain.coordinate, plain.squared, color=_RED, label="(dy/dt)² over y")
        value.plot(mapped.coordinate / mapped.coordinate[-1], mapped.squared, color=_BLUE, label="(dσ/dt)² over σ")
        value.set(title="the same start from rest", xlabel="share of the way", ylabel="x (jerk 1, length 1)")
        value.set(xlim=(0.0, 1.0), ylim=(0.0, None))
        value.legend(loc="upper left")
        for spline, colour, label, row in (
            (plain, _RED, "knots equal in y", 0.03),
            (mapped, _BLUE, "knots equal in σ", 0.08),
        ):
            jerk.plot(spline.y, spline.jerk, color=colour, lw=0.9, label=label)
            ticks = np.full(spline.knots.size - 1, row)
            jerk.plot(spline.knots[1:], ticks, "|", color=colour, ms=5, mew=0.8, transform=jerk.get_xaxis_transform())
        jerk.set_xscale("log")
        jerk.set(title="jerk of splines through it", xlabel="y", ylabel="jerk over exact jerk")
        jerk.set(xlim=(1e-4, 1.0), ylim=(-0.15, 1.3))
        jerk.legend(loc="center right", bbox_to_anchor=(1.02, 0.42))
    return figure


# --- knots ----------------------------------------------------------------------------------------------------------


def knots_figure(of: Case, intervals: int = 250) -> Figure:
    """Knots on the path coloured by their spacing, and what the density is made of."""
    grid = method.stage(of, intervals).grid
    single = np.append(np.diff(grid.sigma) > 0.0, True)
    sigma, macro = grid.sigma[single], grid.macro[single]
    u = grid.map.parameter(macro, grid.distances(sigma, macro))[0]
    points = of.curve.tip.derivatives(u, 0)[0]
    s = of.curve.arclength.s(u)
    with _page(2.6, 1, 2, width_ratios=(1.0, 1.1)) as (figure, ((path, density),)):
        fine = of.curve.tip.derivatives(np.linspace(*of.curve.domain, 3000), 0)[0]
        path.plot(fine[:, 0], fine[:, 1], color=FAINT, lw=0.4, zorder=1)
        shown = {"cmap": "viridis_r", "norm": LogNorm(0.1, 3.0), "s": 8, "lw": 0, "zorder": 2}
        dots = path.scatter(points[:, 0], points[:, 1], c=np.gradient(s), **shown)
        bar = figure.colorbar(dots, ax=path, aspect=28, extend="min", ticks=(0.1, 0.3, 1.0, 3.0), format="%g")
        bar.set_label("distance to neighbours, mm")
        bar.outline.set_visible(False)
        bar.minorticks_off()
        path.set_aspect("equal")
        path.set(xlabel="X, mm", ylabel="Y, mm")
        edges = np.linspace(0.0, s[-1], 241)
        middle = 0.5 * (edges[1:] + edges[:-1])
        even = 0.5 * intervals * np.diff(np.interp(edges, s, sigma / sigma[-1])) / np.diff(edges)
        density.stackplot(middle, even, colors=[_ORANGE], labels=["half of them, even in time"], lw=0)
        count = np.diff(np.interp(edges, s, np.arange(s.size))) / np.diff(edges)
        density.plot(middle, count, color=INK, lw=0.7, label="knots placed")
        density.set(xlabel="arc length, mm", ylabel="knots per mm", xlim=(0.0, s[-1]), ylim=(0.0, 4.5))
        density.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


# --- a plan ---------------------------------------------------------------------------------------------------------


def plan_figure(of: Case) -> Figure:
    """Feed with the two bounds above it, and what each axis uses of acceleration and jerk."""
    curve, limits = of.curve, of.limits
    job = Job(curve, limits)
    profile, fastest = job.plan(), job.plan(method="toppra")
    traces = trace_plan(curve, limits, profile, _POINTS)
    with _page(5.0, 4, 1, sharex=True, height_ratios=(1.6, 1.1, 1.1, 1.7)) as (figure, column):
        feed, acceleration, jerk, held = column[:, 0]
        guess = of.task.guess
        t = profile.t
        ceiling = np.interp(traces.u, guess.u, guess.ceiling)
        without = np.interp(traces.s, fastest.s, fastest.feed)
        feed.plot(traces.t, ceiling, color=FAINT, lw=0.8, label="limit at steady feed")
        feed.plot(traces.t, without, color=_GREEN, lw=0.9, label="optimum without a jerk limit, at the same place")
        feed.plot(traces.t, traces.low["feed"], color=_BLUE, lw=1.2, label="plan")
        feed.set_ylim(0.0, 1.15 * min(limits.feed, float(traces.low["feed"].max()) * 1.4))
        feed.set_ylabel("feed,\nmm/s")
        feed.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        draw_shares(acceleration, "acceleration", curve, limits, traces)
        draw_shares(jerk, "jerk", curve, limits, traces)
        draw_binding(held, profile)
        held.set(xlabel="time, s", xlim=(0.0, float(t[-1])))
        figure.align_ylabels(column[:3, 0])
    return figure


# --- convexity ------------------------------------------------------------------------------------------------------


def convexity_figure(of: Case, intervals: int = method.INTERVALS) -> Figure:
    """The jerk bound with its tangent, and where the relaxation of a problem ends."""
    found = method.relax(of, intervals)
    with _page(2.6, 1, 2) as (figure, ((inner, outer),)):
        x = np.linspace(0.12, 3.2, 300)
        now = 0.6
        bound, tangent = x**-0.5, now**-0.5 - 0.5 * now**-1.5 * (x - now)
        inner.fill_between(x, 0.0, bound, color=_SKY, alpha=0.35, lw=0)
        inner.fill_between(x, 0.0, np.maximum(tangent, 0.0), color=_BLUE, alpha=0.35, lw=0)
        inner.plot(x, bound, color=INK)
        inner.plot(x, tangent, color=_BLUE, ls=_DASHED)
        inner.plot(now, now**-0.5, "o", color=INK, ms=4)
        inner.annotate("iterate", (now, now**-0.5), (0.95, 1.75), arrowprops={"arrowstyle": "-", "lw": 0.5})
        inner.text(2.1, 0.74, "bound x^(-1/2)")
        inner.text(0.42, 0.35, "allowed by\nthe tangent")
        inner.text(1.75, 0.2, "allowed by the limit")
        inner.set(title="a jerk row: what a step may do", xlabel="x", ylabel="|r · (x, a, c)|")
        inner.set(xlim=(0.0, 3.2), ylim=(0.0, 2.2))
        tight = found.pace * np.sqrt(found.x) < 1.001
        grid = np.geomspace(found.x.min(), found.x.max(), 300)
        outer.fill_between(grid, grid**-0.5, 10.0 * found.pace.max(), color=_SKY, alpha=0.35, lw=0)
        outer.plot(grid, grid**-0.5, color=INK, label="y = x^(-1/2), the problem itself")
        label = f"tight, {100.0 * float(tight.mean()):.0f} % of the points"
        outer.plot(found.x[tight], found.pace[tight], ".", color=_BLUE, ms=2.5, label=label)
        outer.plot(found.x[~tight], found.pace[~tight], ".", color=_RED, ms=2.5, label="loose")
        outer.set_xscale("log")
        outer.set_yscale("log")
        outer.set_ylim(0.8 * float(found.pace.min()), 1.6 * float(found.pace.max()))
        for axis, ticks in ((outer.xaxis, (0.3, 1.0, 3.0, 10.0)), (outer.yaxis, (0.3, 1.0, 3.0))):
            axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
            axis.set_minor_locator(NullLocator())
        outer.set(title=f"the relaxation, {of.name} mm/s", xlabel="x, scaled", ylabel="pace y, scaled")
        outer.legend(loc="lower left")
    return figure


# --- Newton system --------------------------------------------------------------------------------------------------


def newton_figure(knots: int = 6) -> Figure:
    """Which entries of the Newton system are not 0, and the recursion that solves it."""
    with _page(3.0, 1, 2, width_ratios=(1.0, 1.35)) as (figure, ((system, chain),)):
        size = 5 * knots - 2
        for row, column, colour in _newton_pattern(knots):
            system.add_patch(Rectangle((column, row), 1.0, 1.0, color=colour, lw=0))
        for k in range(knots):
            system.text(5 * k + 1.5, -0.4, str(k), ha="center", va="bottom", fontsize=7)
        system.set(xlim=(-0.3, size + 0.3), ylim=(size + 0.3, -0.3), xticks=[], yticks=[])
        system.set_aspect("equal")
        system.set_title("Newton system, unknowns knot by knot", loc="left", pad=14)
        for side in ("left", "bottom"):
            system.spines[side].set_visible(False)
        for y, colour, text in (
            (0.15, _BLUE, "Hessian of a knot and its midpoint, 3 x 3"),
            (0.08, _SKY, "of the midpoint, which depends on the next c"),
            (0.01, _ORANGE, "the two equations of an interval"),
        ):
            chain.add_patch(Rectangle((0.02, y), 0.025, 0.045, color=colour, lw=0, transform=chain.transAxes))
            chain.text(0.065, y + 0.022, text, va="center", transform=chain.transAxes)
        _draw_chain(chain)
    return figure


def _newton_pattern(knots: int) -> Iterator[tuple[int, int, str]]:
    """Entries (row, column, colour); a knot has x, a, c, an interval after it the prices of x+ and a+."""
    for k in range(knots - 1):
        here = [5 * k, 5 * k + 1, 5 * k + 2, 5 * k + 7]
        yield from ((i, j, _SKY) for i in here for j in here)
    for k in range(knots):
        yield from ((5 * k + i, 5 * k + j, _BLUE) for i in range(3) for j in range(3))
    for k in range(knots - 1):
        for price, state in ((5 * k + 3, (0, 1, 2, 5, 7)), (5 * k + 4, (1, 2, 6, 7))):
            for i in state:
                yield from ((price, 5 * k + i, _ORANGE), (5 * k + i, price, _ORANGE))


def _draw_chain(axes: Any) -> None:
    """Draw three knots with the controls between them, and the two sweeps."""
    axes.set_axis_off()
    axes.set(xlim=(0.0, 10.0), ylim=(0.0, 6.4))
    for i, x in enumerate((0.4, 4.1, 7.8)):
        axes.add_patch(Rectangle((x, 3.2), 1.8, 0.9, fill=False, ec=_BLUE, lw=1.0))
        axes.text(x + 0.9, 3.65, "x, a, c", ha="center", va="center")
        axes.text(x + 0.9, 4.2, f"knot {('k', 'k+1', 'k+2')[i]}", ha="center", va="bottom", color=_BLUE)
    for x in (2.2, 5.9):
        axes.add_patch(
            FancyArrowPatch((x, 3.65), (x + 1.9, 3.65), arrowstyle="-|>", mutation_scale=8, color=INK, lw=0.8)
        )
        axes.add_patch(Rectangle((x + 0.65, 3.47), 0.5, 0.36, color=_SKY, lw=0, zorder=2))
        axes.text(x + 0.95, 2.95, "next c", ha="center", va="top", color=_ORANGE)
        axes.add_patch(
            FancyArrowPatch((x + 0.95, 3.0), (x + 0.95, 3.45), arrowstyle="-|>", mutation_scale=6, color=_ORANGE)
        )
    for y, (begin, end), text in (
        (5.3, (9.6, 0.4), "backward: P, gains and pivot of one knot from those of the next"),
        (1.9, (0.4, 9.6), "forward: the step of one knot gives that of the next"),
    ):
        axes.add_patch(FancyArrowPatch((begin, y), (end, y), arrowstyle="-|>", mutation_scale=9, color=FAINT, lw=1.0))
        axes.text(5.0, y + 0.12, text, ha="center", va="bottom")


# --- iterations -----------------------------------------------------------------------------------------------------


def convergence_figure(of: Case, intervals: int = method.INTERVALS) -> Figure:
    """Time and gap of the iterates, from the scan alone and by way of the coarse grid."""
    problem = method.constraints(of, intervals)
    cold = method.trace(problem)
    coarse, fine = method.staged_traces(of, intervals)
    bound = method.relax(of, intervals).bound
    with _page(2.7, 1, 2) as (figure, ((time, gap),)):
        time.plot(cold.time, "o-", color=_BLUE, ms=2.5, label="every iterate is a valid plan")
        time.axhline(bound, color=INK, lw=0.8, ls=_DASHED, label=f"lower bound, {bound:.4f} s")
        time.set(xlabel="iteration, from the scan", ylabel="time of the iterate, s")
        time.set_ylim(0.93 * bound, 1.05 * float(cold.time[0]))
        time.legend(loc="upper right")
        gap.plot(cold.gap, color=_BLUE, lw=0.9, ls=":", label="its gap sum(s l)")
        gap.plot(np.maximum(cold.time / cold.time[-1] - 1.0, 1e-9)[:-1], "o-", color=_BLUE, ms=2.5, lw=0.8,
                 label="from the scan")  # fmt: skip
        best = float(fine.time[-1])
        work = np.arange(coarse.time.size) / method.COARSER
        then = work[-1] + np.arange(fine.time.size)
        gap.plot(work, coarse.time / best - 1.0, "s-", color=_GREEN, ms=2.5, lw=0.8, label="coarse grid, N/8")
        gap.plot(
            then[:-1],
            fine.time[:-1] / best - 1.0,
            "o-",
            color=_RED,
            ms=2.5,
            lw=0.8,
            label="then the fine grid",
        )
        late = fine.used > 1.0 + 1e-9
        gap.plot(then[late], (fine.time / best - 1.0)[late], "o", mfc="white", mec=_RED, ms=4, label="not yet feasible")
        gap.set_yscale("log")
        gap.set_ylabel("time above the optimum, share")
        gap.set_xlabel("work, iterations on the fine grid")
        for axes in (time, gap):
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        gap.set_ylim(1e-6, 5.0)
        gap.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=3)
    return figure


# --- between the points ---------------------------------------------------------------------------------------------


def between_figure(of: Case, intervals: int = method.INTERVALS) -> Figure:
    """Jerk between the points with constraints at knots only, at midpoints too, and after tightening."""
    at = method.stage(of, intervals)
    loose = method.knots_only(at)
    only, _ = method.measured(of, loose, loose.solve(of.task, None))
    before, after = method.tightening_rounds(of, intervals)
    worst = int(np.argmax(before.used.jerk))
    with figure_style():
        figure = Figure(figsize=(_WIDTH, 3.5), layout="constrained")
        grid = figure.add_gridspec(2, 3, height_ratios=(1.4, 1.0))
        for k, (title, nodes, centre) in enumerate(
            (
                ("knots only, from the stop on", only, 0),
                ("at knots and midpoints", before.nodes, worst),
                ("the same, tightened", after.nodes, worst),
            )
        ):
            axes = figure.add_subplot(grid[0, k])
            _draw_jerk(axes, of, nodes, centre)
            axes.set(title=title, xlabel="time, ms")
            if k == 0:
                axes.set_yscale("log")
                axes.set_ylim(0.1, 1000.0)
                axes.set_ylabel("largest share\nof a jerk limit")
                axes.legend(loc="upper left", ncols=2)
            else:
                axes.set_ylim(0.985, 1.0085)
        whole = figure.add_subplot(grid[1, :])
        for solved, colour, name in ((before, _RED, "first solve"), (after, _BLUE, "tightened")):
            edges, excess = _largest(of, solved, 240)
            whole.stairs(excess, edges, color=colour, fill=True, lw=0.0, label=f"{name}, T = {solved.nodes.t[-1]:.4f} s",
                         baseline=_MIN_EXCESS)  # fmt: skip
        whole.set_yscale("log")
        whole.set(xlabel="arc length, mm", ylabel="slowing down\nneeded, - 1", xlim=(0.0, of.curve.length))
        whole.set_ylim(_MIN_EXCESS, 2e-2)
        whole.legend(loc="upper right", ncols=2)
        place_panels(figure)
    return figure


def _largest(of: Case, solved: method.Round, bins: int) -> tuple[FloatArray, FloatArray]:
    """Edges of equal stretches of the path, and the largest slowing down that an interval in each needs."""
    s = of.curve.arclength.s(solved.nodes.u)
    edges = np.linspace(0.0, s[-1], bins + 1)
    place = np.clip(np.searchsorted(edges, 0.5 * (s[1:] + s[:-1]), side="right") - 1, 0, bins - 1)
    largest = np.full(bins, _MIN_EXCESS)
    np.maximum.at(largest, place, solved.used.slowdown - 1.0)
    return edges, largest


def _draw_jerk(axes: Any, of: Case, nodes: TimeLaw, centre: int) -> None:
    """The largest jerk share around an interval between nodes, and its values at knots and midpoints."""
    index = np.arange(max(centre - _AROUND, 0), min(centre + _AROUND, nodes.t.size - 2) + 1)
    start, step = nodes.t[index], np.diff(nodes.t)[index]

    def share(t: FloatArray) -> FloatArray:
        return np.asarray(np.abs(method.jerk_shares(of.curve, of.limits, nodes, t)).max(axis=1))

    fine = (start[:, None] + step[:, None] * np.linspace(_INSIDE, 1.0 - _INSIDE, 41)).reshape(-1)
    axes.plot(1e3 * (fine - fine[0]), share(fine), color=_BLUE, lw=0.8)
    ends = start + _INSIDE * step
    for first, fill, label in ((0, INK, "knots"), (1, "white", "midpoints")):
        at = ends[(index - first) % 2 == 0]
        axes.plot(1e3 * (at - fine[0]), share(at), "o", mfc=fill, mec=INK, mew=0.6, ms=2.8, label=label)
    _limit(axes)


# --- sensitivities and samples --------------------------------------------------------------------------------------


def sensitivity_figure(of: Case, intervals: int = method.INTERVALS) -> Figure:
    """What 1 % more of each limit saves, by the multipliers and by solving again."""
    rows = method.saving_rows(of, intervals)
    with _page(0.7 + 0.32 * len(rows), 1, 1) as (figure, ((axes,),)):
        place = np.arange(len(rows))
        axes.barh(place, [1e3 * row.promised_s for row in rows], 0.55, color=_BLUE, label="multipliers")
        axes.plot([1e3 * row.solved_s for row in rows], place, "D", color=_ORANGE, mec=INK, mew=0.5, ms=5,
                  label="solved again with limits 1 % higher and lower")  # fmt: skip
        for at, row in zip(place, rows, strict=True):
            axes.text(1e3 * max(row.promised_s, row.solved_s) + 0.3, at, f"{1e3 * row.promised_s:.2f} ms", va="center")
        axes.set_yticks(place, [row.limit for row in rows])
        axes.tick_params(axis="y", length=0.0)
        axes.invert_yaxis()
        axes.set(title=f"{of.name} mm/s: 1 % more saves", xlabel="ms", xlim=(0.0, 1.15e3 * rows[0].promised_s))
        axes.legend(loc="lower right")
    return figure


def samples_figure(of: Case, shown: tuple[float, float]) -> Figure:
    """The weight with which sampling averages the jerk, and the third differences of samples beside the jerk."""
    curve, limits = of.curve, of.limits
    job = Job(curve, limits)
    profile, period = job.plan(), limits.period
    traces = trace_plan(curve, limits, profile, _POINTS)
    with _page(2.3, 1, 2, width_ratios=(1.0, 2.2)) as (figure, ((weight, jerk),)):
        z = np.linspace(-1.8, 1.8, 361)
        spline = np.where(np.abs(z) <= 0.5, 0.75 - z**2, 0.5 * np.maximum(1.5 - np.abs(z), 0.0) ** 2)
        weight.fill_between(z, spline, color=_SKY, lw=0)
        weight.plot(z, spline, color=_BLUE)
        weight.set(title="weight of the jerk", xlabel="time, periods T", ylabel="weight, 1/T")
        weight.set_ylim(0.0, 0.85)
        jerk.plot(traces.t, traces.low["jerk X"], color=INK, lw=0.8, label="jerk X of the plan")
        samples = job.replay(profile)
        third = np.diff(samples.position[:, 0], 3) / period**3 / limits.jerk[0]
        t = samples.t[:-3] + 1.5 * period
        jerk.plot(t, third, "o", color=_RED, ms=2.4, label="third differences of its samples over T³")
        for bound in (-1.0, 1.0):
            _limit(jerk, bound)
        jerk.set(xlim=shown, ylim=(-1.15, 1.15), xlabel="time, s", ylabel="over the limit")
        jerk.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


# --- the command ----------------------------------------------------------------------------------------------------


def figures() -> dict[str, Callable[[], Figure]]:
    """Every picture by its file name."""
    return {
        "method-rest-map.png": rest_map_figure,
        "method-knots.png": lambda: knots_figure(method.case("butterfly 100")),
        "method-plan.png": lambda: plan_figure(method.teardrop(150.0)),
        "method-convexity.png": lambda: convexity_figure(method.case("butterfly-nurbs 250")),
        "method-newton.png": newton_figure,
        "method-convergence.png": lambda: convergence_figure(method.case("butterfly 100")),
        "method-between.png": lambda: between_figure(method.case("butterfly 100")),
        "method-sensitivities.png": lambda: sensitivity_figure(method.example()),
        "method-samples.png": lambda: samples_figure(method.teardrop(150.0), (0.37, 0.54)),
    }


def _reduce(path: Path) -> None:
    """Store a picture with a palette, a third of the size."""
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    small.save(path, optimize=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write every picture into a folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--output", type=Path, default=Path("docs"), help="folder (docs)")
    options = parser.parse_args(arguments)
    for name, draw in figures().items():
        save_plot(options.output / name, draw())
        _reduce(options.output / name)
        Console().print(f"{options.output / name}")


if __name__ == "__main__":
    main()
