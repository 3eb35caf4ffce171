"""The published numbers of points of Algorithms 1-4 (2022), printed against reproduced, and what the runs cost.

    python -m benchmarks.greedy [--output result.json] [--steps 1000000]

- the table of the summary, and the counts of the thesis for a circle, an ellipse and the teardrop at four feeds;
- the same with each defect of the published program repaired alone, and all of them together, beside the least number of
  chords that keeps the tolerance, the integral of max(1/(F T), sqrt(curvature/(8 e))) over the length;
- mode physical: time, and every limit that is broken, counted;
- processor time of a million steps.

A run whose chord error is not within the tolerance, where the algorithm holds it, scores no time.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from math import ceil, pi
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from benchmarks.environment import environment
from interp.literature.greedy import greedy
from interp.literature.greedy_published import DEFECTS, PUBLISHED_COUNTS, PUBLISHED_LIMITS
from interp.literature.greedy_setup import Braking
from planner import load_curve
from planner.files.whole_file import require_writable, whole_file
from planner.geometry.curve import Curve
from planner.geometry.formula import FormulaCurve
from planner.machine.limits import Limits

ALGORITHMS = (1, 2, 3, 4)
PERIOD = 1e-3
# Algorithm 3 at 10, 20, 30 and 40 mm/s, as the thesis prints them; semi-axes in mm.
THESIS_FEEDS = (10.0, 20.0, 30.0, 40.0)
THESIS_COUNTS = {
    "circle 79 x 79": (49641, 24822, 16549, 12413),
    "ellipse 11 x 51": (21575, 11296, 8338, 7351),
    "teardrop": (10261, 7599, 7347, 7347),
}
REPAIRED = {argument: repaired for argument, _, repaired in DEFECTS.values() if argument != "step_feed"}
PHYSICAL: tuple[tuple[int, Braking], ...] = ((1, "strict"), (2, "strict"), (2, "soft"), (3, "strict"), (4, "strict"))
SPEED = (
    ("Algorithm 1", 1, "theta", 2.0),
    ("Algorithm 2", 2, "theta", 2.0),
    ("Algorithm 3, root", 3, "root", 10.0),
    ("Algorithm 4, root", 4, "root", 10.0),
    ("Algorithm 3, theta", 3, "theta", None),
    ("Algorithm 4, theta", 4, "theta", None),
)
REPEATS = 3
LIMITATIONS = (
    "Number of points times the period is a machining time only where the feed that is planned drives the step: in the "
    "published program it does not, and the runs of mode compat break the limits of the axes.",
    "Mode physical depends on choices that the text leaves open: the lowest feed, strict or soft braking, the factors of "
    "the back-off.",
    "Times are processor time of one core that other work may share: compare them within one run.",
)


def limits(feed: float = PUBLISHED_LIMITS["feed"]) -> Limits:
    """The published limits."""
    velocity, acceleration, jerk = ([PUBLISHED_LIMITS[name]] * 2 for name in ("velocity", "acceleration", "jerk"))
    return Limits(feed, velocity, acceleration, jerk, chord_error=PUBLISHED_LIMITS["chord_error"], period=PERIOD)


def thesis_curve(name: str) -> Curve:
    if name == "teardrop":
        return load_curve(name)
    a, b = name.split()[1::2]
    return FormulaCurve({"X": f"{a}*sin(2*pi*u)", "Y": f"{b}*cos(2*pi*u)"}, (0.0, 1.0), name=name)


def least_chords(curve: Curve, feed: float) -> float:
    """Integral of max(1/(F T), sqrt(curvature/(8 e))) over the length, by the midpoint rule."""
    edges = np.linspace(*curve.domain, 200_001)
    mid = 0.5 * (edges[1:] + edges[:-1])
    speed = np.linalg.norm(curve.derivatives(mid, 1)[1], axis=-1)
    chords = np.sqrt(curve.curvature(mid) / (8.0 * PUBLISHED_LIMITS["chord_error"]))
    return float(np.sum(np.maximum(1.0 / (feed * PERIOD), chords) * speed) * (edges[1] - edges[0]))


def published_table() -> list[dict[str, Any]]:
    """Printed and reproduced, with what each run does to its own curve."""
    rows = []
    for name in PUBLISHED_COUNTS:
        curve = load_curve(name)
        for algorithm in ALGORITHMS:
            run = greedy(curve, limits(), algorithm)
            chord = run.row("chord error")
            rows.append(
                {
                    "curve": name,
                    "algorithm": algorithm,
                    "printed": run.published,
                    "reproduced": run.n,
                    "remark": run.remark,
                    "defects": run.defects,
                    "largest_chord_error_mm": chord.worst,
                    "share_beyond_tolerance": chord.count / (run.u.size - 1),
                    "violations": {row.limit: row.count for row in run.rows},
                }
            )
    return rows


def thesis_table() -> list[dict[str, Any]]:
    """Counts of the final thesis."""
    rows = []
    for name, counts in THESIS_COUNTS.items():
        curve = thesis_curve(name)
        made = tuple(greedy(curve, limits(feed), 3).n for feed in THESIS_FEEDS)
        rows.append({"curve": name, "feeds_mm_s": THESIS_FEEDS, "printed": counts, "reproduced": made})
    return rows


def defect_table() -> list[dict[str, Any]]:
    """Numbers of points with the defects repaired one by one; of the feed in the step with 3 mm/s at least."""
    switches: dict[str, dict[str, Any]] = {"as published": {}}
    for name, (argument, _, repaired) in DEFECTS.items():
        switches[f"without {name}"] = {argument: repaired}
    switches["without command feedrate in the step"]["min_feed"] = 3.0
    switches["all but the feed in the step repaired"] = REPAIRED
    switches["the same, solved for the step"] = REPAIRED | {"variant": "root"}
    rows = []
    for name in PUBLISHED_COUNTS:
        curve = load_curve(name)
        for label, changes in switches.items():
            counts = [greedy(curve, limits(), algorithm, **changes).n for algorithm in ALGORITHMS]
            rows.append({"curve": name, "program": label, "counts": counts})
        bounds = [None, None, ceil(least_chords(curve, limits().feed)), ceil(least_chords(curve, np.inf))]
        rows.append({"curve": name, "program": "least number of chords", "counts": bounds})
    return rows


def physical_table() -> list[dict[str, Any]]:
    """Mode physical with the defaults: what is broken how often."""
    rows = []
    for name in PUBLISHED_COUNTS:
        curve = load_curve(name)
        for algorithm, braking in PHYSICAL:
            run = greedy(curve, limits(), algorithm, mode="physical", variant="root", braking=braking)
            rows.append(
                {
                    "curve": name,
                    "algorithm": algorithm,
                    "braking": braking,
                    "duration_s": run.duration,
                    "violations": {row.limit: {"count": row.count, "worst": row.worst, "u": row.u} for row in run.rows},
                }
            )
    return rows


def speed_table(steps: int) -> list[dict[str, Any]]:
    """Processor time of whole calls, on as many turns of the hypotrochoid as make the number of steps."""
    one = load_curve("hypotrochoid")
    assert isinstance(one, FormulaCurve)
    rows = []
    for label, algorithm, variant, allowed in SPEED:
        changes: dict[str, Any] = {"error_curve": "own", "variant": variant}
        single = greedy(one, limits(), algorithm, **changes).n
        turns = ceil(steps / single)
        curve = FormulaCurve(one.expressions, (0.0, 6.0 * pi * turns), name=f"{turns} turns of the hypotrochoid")
        times, run = [], None
        for _ in range(REPEATS):
            begin = time.process_time()
            run = greedy(curve, limits(), algorithm, **changes, max_steps=2 * turns * single)
            times.append(time.process_time() - begin)
        assert run is not None
        sound = algorithm == 1 or run.row("chord error").count == 0
        rows.append(
            {
                "run": label,
                "points": run.n,
                "seconds_per_million": median(times) / run.n * 1e6 if sound else None,
                "fastest_per_million": min(times) / run.n * 1e6 if sound else None,
                "allowed_s": allowed,
            }
        )
    return rows


def grid(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table whose first column is text."""
    table = Table(title=title, title_justify="left", box=SIMPLE, padding=(0, 1, 0, 0))
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number == 0 else "right")
    for row in rows:
        table.add_row(*row)
    return table


def show_published(rows: Sequence[dict[str, Any]], show: Callable[[object], None]) -> None:
    cells = []
    for name in PUBLISHED_COUNTS:
        found = [row for row in rows if row["curve"] == name]
        pairs = [
            f"{row['printed']} / {row['reproduced']}{'' if row['printed'] == row['reproduced'] else ' *'}"
            for row in found
        ]
        shares = " ".join(f"{100.0 * row['share_beyond_tolerance']:.0f}" for row in found)
        cells.append([name, *pairs, shares])
    heads = ["curve", *(f"Algorithm {k}" for k in ALGORITHMS), "% of chords beyond 1e-6 mm"]
    show(grid("points, printed / reproduced", heads, cells))
    for row in rows:
        if row["remark"] and row["printed"] != row["reproduced"]:
            show(f"* {row['curve']}, Algorithm {row['algorithm']}: {row['remark']}")


def run(steps: int, show: Callable[[object], None]) -> dict[str, object]:
    """Measure everything; tables go to ``show`` as they are found, the whole is returned."""
    published = published_table()
    show_published(published, show)
    thesis = thesis_table()
    cells = [
        [row["curve"], *(f"{a} / {b}" for a, b in zip(row["printed"], row["reproduced"], strict=True))]
        for row in thesis
    ]
    show(grid("thesis, Algorithm 3, printed / reproduced", ["curve", *(f"{f:g} mm/s" for f in THESIS_FEEDS)], cells))
    defects = defect_table()
    cells = [[f"{r['curve']}, {r['program']}", *("-" if n is None else str(n) for n in r["counts"])] for r in defects]
    show(grid("points, defects repaired", ["program", *(f"Algorithm {k}" for k in ALGORITHMS)], cells))
    physical = physical_table()
    cells = [
        [f"{r['curve']}, Algorithm {r['algorithm']} {r['braking']}", f"{r['duration_s']:.3f}"]
        + [f"{item['count']} ({item['worst']:.3g})" for item in r["violations"].values()]
        for r in physical
    ]
    heads = ["mode physical", "s", "feed", "chord error", "acceleration", "jerk"]
    show(grid("steps beyond each limit (worst value)", heads, cells))
    speed = speed_table(steps)
    cells = [
        [
            row["run"],
            str(row["points"]),
            "failed" if row["seconds_per_million"] is None else f"{row['seconds_per_million']:.2f}",
            "-" if row["allowed_s"] is None else f"{row['allowed_s']:g}",
        ]
        for row in speed
    ]
    show(grid("processor time, measurement of the run included", ["run", "points", "s a million", "at most"], cells))
    for sentence in LIMITATIONS:
        show(sentence)
    return {
        "benchmark": "greedy",
        "environment": environment(),
        "limits": PUBLISHED_LIMITS | {"period_s": PERIOD},
        "published": published,
        "thesis": thesis,
        "defects": defects,
        "physical": physical,
        "speed": speed,
        "limitations": LIMITATIONS,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.greedy", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--output", type=Path, help="write the result as JSON")
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of the speed runs (default 1e6)")
    options = parser.parse_args(arguments)
    if options.output is not None:
        require_writable(options.output)
    result = run(options.steps, Console(width=130).print)
    if options.output is not None:
        with whole_file(options.output) as file:
            file.write((json.dumps(result, indent=1) + "\n").encode())


if __name__ == "__main__":
    main()
