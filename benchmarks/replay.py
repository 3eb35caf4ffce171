"""The replay forms of the literature beside the quintic table, on one page.

    python -m benchmarks.replay [--output result.json] [--period 1e-3]

Plans eight cases, replays each plan by every form of ``interp.literature.forms`` and measures

- the largest distance of a sample from the plan, and of the feed between samples from the planned one;
- the first, second and third difference of the samples over T, T^2, T^3 as multiples of the axis limits, before the
  samples arrive at the end of the path and as they do, the worst of several phases of the last period;
- the time of a step in a compiled loop.

The table holds the worst of all cases; the circle, whose second derivative jumps at a knot, has a column of its own for
the jerk.  A form whose samples leave the curve, fall back or do not end with it scores no time.
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
from benchmarks.interpolator import arrival, deviations, difference_ratios, ratio_text
from feedplan.job import load_job
from interp.literature.forms import FORMS, FormName, prepare, replay_form
from planner.files.whole_file import require_writable, whole_file
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.samples import Samples

FloatArray = NDArray[np.float64]
Ratios = tuple[float, ...]


@dataclass(frozen=True)
class Measured:
    """One form on one case; ratios are (velocity, acceleration, jerk), the time is in ns, None where a check failed."""

    case: str
    form: FormName
    path_error_mm: float
    feed_fluctuation: float
    ratio_inside: Ratios
    ratio_end: Ratios
    periods_late: int
    failed: tuple[str, ...]
    step_ns: float | None


CASES = tuple(
    (name, scale, feed)
    for name, scale in (("teardrop", 1.0), ("butterfly", 10.0), ("hypotrochoid", 10.0), ("circle", 1.0))
    for feed in (100.0, 300.0)
)
BROKEN = "circle"  # the curve that is C1 at a knot
SLOWEST_FEED = 1.0  # mm/s; below it a relative error of the feed says nothing
ON_CURVE = 1e-9  # mm
PHASES = 8
REPEATS = 9
STEPS_PER_REPEAT = 100_000
_INVERSIONS = 8
LIMITATIONS = (
    "The feed of a form with V(u) is compared with the plan's at the same place, that of the others at the same time.",
    "Fluctuation counts where the plan moves faster than 1 mm/s, without the step that ends at the end of the path.",
    "Step times are those of one core that other work may share: compare them within one run.",
    "A form with V(u) carries the plan's time law to invert it; a controller that knows V(u) in closed form is faster.",
)


def plan(name: str, scale: float, feed: float) -> tuple[Curve, Limits, FeedrateProfile]:
    """Plan a case: axes of 250 mm/s, 1000 mm/s^2, 20000 mm/s^3."""
    job = load_job(name, drives(feed), scale=scale)
    return job.curve, job.limits, job.plan()


def fluctuation_by_place(curve: Curve, profile: FeedrateProfile, samples: Samples) -> float:
    """Largest relative error of the feed against that of the plan over a period from the same place on."""
    u = samples.u[: arrival(samples) - 1]
    t = np.interp(u, profile.u, profile.t)
    for _ in range(_INVERSIONS):
        law = profile.at(t)
        slope = np.where(law.u_rate > 0.0, law.u_rate, np.inf)
        t = np.clip(t - (law.u - u) / slope, 0.0, profile.duration)
    planned = profile.at(np.minimum(t + samples.period, profile.duration)).s - curve.arclength.s(u)
    actual = np.diff(curve.arclength.s(samples.u[: u.size + 1]))
    moving = planned > SLOWEST_FEED * samples.period
    return float(np.abs(actual[moving] / planned[moving] - 1.0).max())


def faults(curve: Curve, samples: Samples) -> tuple[str, ...]:
    """Name what makes samples worthless, whatever their time."""
    found = []
    if (np.diff(samples.u) < 0.0).any():
        found.append("parameter falls back")
    if np.abs(samples.position - curve.derivatives(samples.u, 0)[0]).max() > ON_CURVE:
        found.append("samples off the curve")
    if not np.array_equal(samples.position[-1], curve.derivatives(curve.domain[1], 0)[0]):
        found.append("end of the curve")
    return tuple(found)


def step_time(profile: FeedrateProfile, form: FormName, period: float) -> float:
    """Median time of a step in the compiled loop, ns."""
    replayer = prepare(profile, form, period)
    u, positions = np.empty(replayer.room), np.empty(replayer.room * profile.curve.dim)
    taken = replayer.run(replayer.state.copy(), u, positions)
    plans = max(1, STEPS_PER_REPEAT // taken)
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter_ns()
        for _ in range(plans):
            replayer.run(replayer.state.copy(), u, positions)
        times.append((time.perf_counter_ns() - begin) / (plans * taken))
    return float(np.median(times))


def measure(
    case: str, curve: Curve, limits: Limits, profile: FeedrateProfile, form: FormName, period: float
) -> Measured:
    """Replay one plan by one form, check it and time it."""
    samples = replay_form(curve, profile, form, period)
    late = samples.t.size - 1 - int(np.ceil(profile.duration / period - 1e-9))
    failed = faults(curve, samples)
    by_place = form.endswith("V(u)")
    within = samples if late <= 0 else _until(samples, samples.t.size - late)
    away, fluctuation = deviations(curve, profile, within)
    ratios = [difference_ratios(samples, limits)]
    for phase in np.arange(PHASES) / PHASES:
        near = profile.duration / (int(profile.duration / period) + phase)
        ratios.append(difference_ratios(replay_form(curve, profile, form, near), limits))
    inside, end = np.max(ratios, axis=0)
    return Measured(
        case,
        form,
        away,
        fluctuation_by_place(curve, profile, samples) if by_place else fluctuation,
        tuple(inside.tolist()),
        tuple(end.tolist()),
        late if by_place else arrival(samples) - int(np.ceil(profile.duration / period - 1e-9)),
        failed,
        None if failed else step_time(profile, form, period),
    )


def _until(samples: Samples, count: int) -> Samples:
    """The first samples, as far as the plan's time goes."""
    return Samples(samples.period, samples.t[:count], samples.u[:count], samples.position[:count])


def worst(rows: Sequence[Measured]) -> dict[str, dict[str, object]]:
    """The worst of all cases for each form."""
    found: dict[str, dict[str, object]] = {}
    for form in dict.fromkeys(row.form for row in rows):
        here = [row for row in rows if row.form == form]
        smooth = [row.ratio_inside for row in here if not row.case.startswith(BROKEN)]
        broken = [row.ratio_inside for row in here if row.case.startswith(BROKEN)]
        times = [row.step_ns for row in here if row.step_ns is not None]
        found[form] = {
            "path_error_mm": max(row.path_error_mm for row in here),
            "feed_fluctuation": max(row.feed_fluctuation for row in here),
            "ratio_inside": np.max(smooth, axis=0).tolist() if smooth else None,
            "ratio_inside_circle": np.max(broken, axis=0).tolist() if broken else None,
            "ratio_end": np.max([row.ratio_end for row in here], axis=0).tolist(),
            "failed": sorted({fault for row in here for fault in row.failed}),
            "step_ns": [min(times), max(times)] if times else None,
        }
    return found


def table(rows: dict[str, dict[str, object]], period: float) -> Table:
    """The forms beside each other."""
    page = Table(title=f"replay forms at T = {1e3 * period:g} ms, worst of {len(CASES)} cases", title_justify="left")
    page.add_column("form")
    heads = ("path error mm", "feed fluctuation", "inside v a j", f"j on the {BROKEN}", "at the end v a j", "ns a step")
    for head in heads:
        page.add_column(head, justify="right")
    for form, row in rows.items():
        inside, circle, end, times = (row[k] for k in ("ratio_inside", "ratio_inside_circle", "ratio_end", "step_ns"))
        cells = [f"{row['path_error_mm']:.2g}", f"{row['feed_fluctuation']:.2g}"]
        cells.append(ratio_text(inside) if isinstance(inside, list) else "")
        cells.append(ratio_text(circle[2:]) if isinstance(circle, list) else "")
        cells.append(ratio_text(end) if isinstance(end, list) else "")
        failed = row["failed"]
        cells.append(
            f"{times[0]:.0f} to {times[1]:.0f}" if isinstance(times, list) and not failed else f"failed: {failed}"
        )
        page.add_row(form, *cells)
    return page


def run(period: float, show: Callable[[object], None]) -> dict[str, object]:
    """Measure everything; the table goes to ``show``, the whole is returned."""
    rows: list[Measured] = []
    durations: dict[str, float] = {}
    for name, scale, feed in CASES:
        curve, limits, profile = plan(name, scale, feed)
        case = f"{name} x {scale:g}, {feed:g} mm/s"
        durations[case] = profile.duration
        rows += [measure(case, curve, limits, profile, form, period) for form in FORMS]
    summary = worst(rows)
    show(table(summary, period))
    for sentence in LIMITATIONS:
        show(sentence)
    return {
        "benchmark": "replay",
        "environment": environment(),
        "period_s": period,
        "durations_s": durations,
        "worst": summary,
        "cases": [asdict(row) for row in rows],
        "limitations": LIMITATIONS,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.replay", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--output", type=Path, help="write the result as JSON")
    parser.add_argument("--period", type=float, default=1e-3, help="interpolation period, s (default 1e-3)")
    options = parser.parse_args(arguments)
    if options.output is not None:
        require_writable(options.output)
    result = run(options.period, Console(width=130).print)
    if options.output is not None:
        with whole_file(options.output) as file:
            file.write((json.dumps(result, indent=1) + "\n").encode())


if __name__ == "__main__":
    main()
