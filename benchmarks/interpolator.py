"""What each interpolator costs and how well it keeps the plan.

    python -m benchmarks.interpolator [--output result.json]

Plans the cases, replays each plan with Taylor steps of order 1, 2, 3 and with the time-indexed quintic, and measures

- the largest distance of a sample from the plan, and of the feed between samples from the planned one;
- the first, second and third difference of the samples over T, T^2, T^3 as multiples of the axis limits, before the
  samples arrive at the end of the path and as they do;
- the time of a step in a compiled loop, and of one call from Python a period.

A form that fails its check (see ``verdict``) scores no time.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.cases import drives
from benchmarks.environment import environment
from feedplan.job import load_job
from interp import InterpolatorTable, TaylorTable, quintic_step, replay, start, stepping, taylor_step
from interp.taylor import runner
from planner import load_curve
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.samples import Samples

FloatArray = NDArray[np.float64]
# Of the quintic at each period: the worst ratios (velocity, acceleration, jerk) and feed fluctuation over all phases.
Phases = dict[float, tuple[tuple[float, ...], float]]


@dataclass(frozen=True)
class Case:
    """A curve, and the feed and machine it is planned for; without one, axes of 250 mm/s, 1000 mm/s^2, 20000 mm/s^3."""

    curve: str
    feed: float
    scale: float = 1.0
    machine: str = ""


@dataclass(frozen=True)
class Form:
    """An interpolator, and the distance from the plan beyond which it is not working, mm at 1 ms."""

    name: str
    order: int
    path_error: float


@dataclass(frozen=True)
class Measured:
    """One form on one case; ratios are (velocity, acceleration, jerk), times are in ns, None where the check failed."""

    form: str
    path_error_mm: float
    feed_fluctuation: float
    ratio_inside: tuple[float, ...]
    ratio_end: tuple[float, ...]
    failed: tuple[str, ...]
    step_ns: float | None
    step_ns_fastest: float | None


@dataclass(frozen=True)
class CallTimes:
    """Calls from Python, one a period, clock included, ns."""

    curve: str
    form: str
    p50: float
    p99: float
    maximum: float


CASES = (
    Case("circle", 100.0),
    Case("circle", 300.0),
    Case("teardrop", 100.0),
    Case("butterfly-nurbs", 100.0),
    Case("butterfly", 100.0, scale=10.0),
    Case("flank", 100.0, machine="five-axis"),
)
CALLED = ("circle", "butterfly-nurbs", "flank")
FORMS = (
    Form("Taylor 1", 1, 1.0),
    Form("Taylor 2", 2, 2e-2),
    Form("Taylor 3", 3, 2e-3),
    Form("quintic", 5, 1e-7),
)
# What the samples of the quintic must keep, at each of these periods and at every phase of the last one.
PERIODS = (0.25e-3, 1e-3, 2e-3)
PHASES = 16
RATIOS = (1.0001, 1.0005, 1.0005)
FEED_FLUCTUATION = 1e-6
SLOWEST_FEED = 1.0  # mm/s; below it a relative error of the feed says nothing
REPEATS = 9
STEPS_PER_REPEAT = 200_000
LIMITATIONS = (
    "Fluctuation is that of the arc length between samples where the plan moves faster than 1 mm/s; the last step, in "
    "which a Taylor replay jumps to the end, counts in the columns of the end only.",
    "Distances from the plan do not see the error of the plan itself.",
    "Step times are those of one core that other work may share: compare them within one run.",
    "Call times include one reading of the clock, which is listed beside them, and no cache is emptied between calls.",
)


def plan(case: Case) -> tuple[Curve, Limits, FeedrateProfile]:
    """Plan a case."""
    curve = load_curve(case.curve, scale=case.scale)
    job = load_job(curve, case.machine or drives(case.feed, curve.dim), feed=case.feed)
    return job.curve, job.limits, job.plan()


def arrival(samples: Samples) -> int:
    """Index of the first sample at the end of the path; Taylor steps may be there before their time."""
    return int(np.argmax(samples.u >= samples.u[-1]))


def difference_ratios(samples: Samples, limits: Limits) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Worst differences as multiples of the limits: windows before the arrival at the end, and windows with it."""
    q = samples.position
    q = np.concatenate([np.repeat(q[:1], 3, axis=0), q, np.repeat(q[-1:], 3, axis=0)])
    inside, end = [], []
    for k, allowed in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk)):
        ratio = (np.abs(np.diff(q, k, axis=0)) / samples.period**k / allowed).max(axis=1)
        split = 3 + arrival(samples) - k
        inside.append(float(ratio[:split].max()))
        end.append(float(ratio[split:].max()))
    return tuple(inside), tuple(end)


def deviations(curve: Curve, profile: FeedrateProfile, samples: Samples) -> tuple[float, float]:
    """Largest distance of a sample from the plan, mm, and largest relative error of the feed before the last step."""
    law = profile.at(np.minimum(samples.t, profile.duration))
    away = samples.position - curve.derivatives(law.u, 0)[0]
    steps = slice(0, arrival(samples) - 1)
    planned = np.diff(law.s)[steps]
    actual = np.diff(curve.arclength.s(samples.u))[steps]
    moving = planned > SLOWEST_FEED * samples.period
    return float(np.sqrt(np.sum(away**2, axis=1)).max()), float(np.abs(actual / planned - 1.0)[moving].max())


def verdict(curve: Curve, profile: FeedrateProfile, form: Form, samples: Samples, phases: Phases) -> tuple[str, ...]:
    """Name what is wrong with a replay: nothing, for a form whose time may be quoted."""
    failed = []
    if samples.t.size != int(np.ceil(profile.duration / samples.period - 1e-9)) + 1:
        failed.append("number of samples")
    if not np.array_equal(samples.position[-1], curve.derivatives(curve.domain[1], 0)[0]):
        failed.append("end of the curve")
    if (np.diff(samples.u) < 0.0).any():
        failed.append("parameter falls back")
    if np.abs(samples.position - curve.derivatives(samples.u, 0)[0]).max() > 1e-9:
        failed.append("samples off the curve")
    if not deviations(curve, profile, samples)[0] <= form.path_error:
        failed.append("path error")
    if form.order == 5:
        if any((np.array(ratios) > RATIOS).any() for ratios, _ in phases.values()):
            failed.append("limits")
        if any(fluctuation > FEED_FLUCTUATION for _, fluctuation in phases.values()):
            failed.append("feed fluctuation")
    return tuple(failed)


def every_phase(curve: Curve, limits: Limits, profile: FeedrateProfile) -> Phases:
    """Worst ratios and feed fluctuation of the quintic for each period, over the phases of the last one.

    The replay is what is measured here: it is called by itself, not as a step of a job.
    """
    worst: Phases = {}
    for period in PERIODS:
        ratios, fluctuations = [], []
        for phase in np.arange(PHASES) / PHASES:
            samples = replay(curve, profile, profile.duration / (int(profile.duration / period) + phase))
            ratios.append(np.maximum(*difference_ratios(samples, limits)))
            fluctuations.append(deviations(curve, profile, samples)[1])
        worst[period] = tuple(np.max(ratios, axis=0).tolist()), max(fluctuations)
    return worst


def table_of(profile: FeedrateProfile, form: Form) -> InterpolatorTable | TaylorTable:
    """The arrays a form runs on."""
    return InterpolatorTable.from_profile(profile) if form.order == 5 else TaylorTable.from_profile(profile)


def loop_times(profile: FeedrateProfile, form: Form, period: float) -> list[float]:
    """Time of a step in the compiled loop, ns, one for each repeat; every repeat runs whole plans."""
    table = table_of(profile, form)
    first = start(table, period)
    count = int(first[stepping.LAST])
    u, positions = np.empty(count), np.empty(count * table.dim)
    plans = max(1, STEPS_PER_REPEAT // count)
    run = runner(table, form.order)

    def once() -> None:
        run(first.copy(), u, positions)

    times = []
    for repeat in range(REPEATS + 1):
        begin = time.perf_counter_ns()
        for _ in range(plans):
            once()
        if repeat > 0:  # the first one warms up
            times.append((time.perf_counter_ns() - begin) / (plans * count))
    return times


def call_times(profile: FeedrateProfile, form: Form, period: float, calls: int) -> NDArray[np.int64]:
    """Time of every single call from Python, ns."""
    arrays = table_of(profile, form).arrays
    first = start(table_of(profile, form), period)
    state, taken, clock, order = first.copy(), np.empty(calls, dtype=np.int64), time.perf_counter_ns, form.order
    for n in range(calls):
        if state[stepping.SAMPLE] >= state[stepping.LAST]:
            state[:] = first
        if order == 5:
            begin = clock()
            quintic_step(*arrays, state)
            taken[n] = clock() - begin
        else:
            begin = clock()
            taylor_step(order, *arrays, state)
            taken[n] = clock() - begin
    return taken


def clock_times(calls: int) -> NDArray[np.int64]:
    """Time between two readings of the clock, ns."""
    taken, clock = np.empty(calls, dtype=np.int64), time.perf_counter_ns
    for n in range(calls):
        begin = clock()
        taken[n] = clock() - begin
    return taken


def measure(
    curve: Curve, limits: Limits, profile: FeedrateProfile, form: Form, period: float, phases: Phases
) -> Measured:
    """Replay one plan with one form, check it and time it."""
    samples = replay(curve, profile, period, order=form.order)
    failed = verdict(curve, profile, form, samples, phases)
    times = [] if failed else loop_times(profile, form, period)
    return Measured(
        form.name,
        *deviations(curve, profile, samples),
        *difference_ratios(samples, limits),
        failed,
        float(np.median(times)) if times else None,
        min(times) if times else None,
    )


def quantiles(curve: str, form: str, taken: NDArray[np.int64]) -> CallTimes:
    """Summarise the times of single calls."""
    p50, p99 = np.percentile(taken, [50.0, 99.0])
    return CallTimes(curve, form, float(p50), float(p99), float(taken.max()))


def ratio_text(ratios: Sequence[float]) -> str:
    """Velocity, acceleration and jerk ratio in one cell."""
    return " ".join(f"{ratio:.4f}" if ratio < 10.0 else f"{ratio:.1f}" for ratio in ratios)


def form_table(title: str, rows: Sequence[Measured]) -> Table:
    """The four forms beside each other."""
    table = Table(title=title, title_justify="left")
    table.add_column("form")
    for head in ("path error mm", "feed fluctuation", "inside v a j", "at the end v a j", "ns a step"):
        table.add_column(head, justify="right")
    for row in rows:
        cells = [f"{row.path_error_mm:.2g}", f"{row.feed_fluctuation:.2g}"]
        cells += [ratio_text(row.ratio_inside), ratio_text(row.ratio_end)]
        cells.append(f"failed: {', '.join(row.failed)}" if row.step_ns is None else f"{row.step_ns:.0f}")
        table.add_row(row.form, *cells)
    return table


def phase_table(rows: dict[str, Phases]) -> Table:
    """The quintic at every phase of the last period."""
    table = Table(title=f"quintic, worst over {PHASES} phases of the last period", title_justify="left")
    table.add_column("plan")
    for period in PERIODS:
        table.add_column(f"v a j at {1e3 * period:g} ms", justify="right")
    table.add_column("feed fluctuation", justify="right")
    for name, worst in rows.items():
        cells = [ratio_text(ratios) for ratios, _ in worst.values()]
        table.add_row(name, *cells, f"{max(fluctuation for _, fluctuation in worst.values()):.2g}")
    return table


def call_table(rows: Sequence[CallTimes], calls: int) -> Table:
    """Calls from Python."""
    table = Table(title=f"one call a period from Python, ns, {calls} calls", title_justify="left")
    for head in ("curve", "form"):
        table.add_column(head)
    for head in ("p50", "p99", "max"):
        table.add_column(head, justify="right")
    for row in rows:
        table.add_row(row.curve, row.form, f"{row.p50:.0f}", f"{row.p99:.0f}", f"{row.maximum:.0f}")
    return table


def run(period: float, calls: int, show: Callable[[object], None]) -> dict[str, object]:
    """Measure everything; tables go to ``show`` as they are found, the whole is returned."""
    plans: list[dict[str, object]] = []
    phases: dict[str, Phases] = {}
    called = [quantiles("", "clock alone", clock_times(calls))]
    for case in CASES:
        curve, limits, profile = plan(case)
        name = f"{case.curve} x {case.scale:g}, {case.feed:g} mm/s"
        phases[name] = every_phase(curve, limits, profile)
        rows = [measure(curve, limits, profile, form, period, phases[name]) for form in FORMS]
        title = f"{name}: {profile.duration:.4f} s, {profile.t.size} nodes, T = {1e3 * period:g} ms"
        show(form_table(title, rows))
        plans.append(
            {
                **asdict(case),
                "duration_s": profile.duration,
                "nodes": profile.t.size,
                "forms": [asdict(row) for row in rows],
                "quintic_every_phase": {
                    f"{t:g}": {"ratios": r, "feed_fluctuation": f} for t, (r, f) in phases[name].items()
                },
            }
        )
        if case.curve in CALLED and case.curve not in {row.curve for row in called}:
            passed = [form for form, row in zip(FORMS, rows, strict=True) if not row.failed]
            called += [quantiles(case.curve, f.name, call_times(profile, f, period, calls)) for f in passed]
    show(phase_table(phases))
    show(call_table(called, calls))
    for sentence in LIMITATIONS:
        show(sentence)
    return {
        "benchmark": "interpolator",
        "environment": environment(),
        "period_s": period,
        "plans": plans,
        "calls": {"count": calls, "ns": [asdict(row) for row in called]},
        "limitations": LIMITATIONS,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.interpolator", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--output", type=Path, help="write the result as JSON")
    parser.add_argument("--period", type=float, default=1e-3, help="interpolation period, s (default 1e-3)")
    parser.add_argument("--calls", type=int, default=1_000_000, help="calls from Python for each form (default 1e6)")
    options = parser.parse_args(arguments)
    result = run(options.period, options.calls, Console(width=130).print)
    if options.output is not None:
        options.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
