"""Is the feed the same at the same place in neighbouring passes, there and back?

    python -m benchmarks.consistency [--output results.json] [--figure passes.png] [--no-linuxcnc] [--seeds 3]

Six passes of one curve, half a millimetre apart, there and back in turn.  Every pass is cut into chords of its own: of
random lengths, 0.3 to 1 times as long as keeps them within a chord error of the curve.  The program is planned within 10 um.
At every place of the curve the feeds of the six passes are compared: the largest less the smallest, against their mean.  The
places are the nearest ones on the curve that the chords were cut from, every 0.03 mm; 15 mm at either end, where the passes
begin and end, are left out.

With the same chords in every pass, turned round on the way back, the difference of those there from those back is what the
direction makes: the first and the last pass, which begin and end at rest, are left out of it.

LinuxCNC, where it is installed, runs the same programs under G64 P0.01; its feed is that of its positions, once a period.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from benchmarks.cases import drives
from benchmarks.linuxcnc.interpreter import is_installed
from benchmarks.linuxcnc.machine import SERVO_PERIOD, run_program
from feedplan.job import Job
from planner import FeedrateProfile, __version__, read_program
from planner.output.figures import save_plot
from planner.output.panels import Line, Panel, plot_panels
from planner.programs.path.smooth_path import program_path
from planner.types import FloatArray

PASSES, STEP = 6, 0.5  # mm apart
LENGTH = 120.0  # mm along X
WAVES = ((3.0, 25.0, 0.3), (0.8, 11.0, 1.0), (5.0, 60.0, 2.0))  # amplitude and wavelength in mm, phase
TOLERANCE = 0.01  # mm
CHORD_ERRORS = (0.001, 0.0025, 0.005, 0.01)  # mm
SHORTEST = 0.3  # of the length that keeps the chord error
LEFT_OUT = 15.0  # mm at either end
LIMITS = drives(dim=3)
MEAN, WORST, THERE_AND_BACK = 1e-3, 1e-2, 1e-5  # what is asked for
_BETWEEN = 2e-4  # s between the points of a plan that are looked at
_ON_PASS = 1e-3  # mm
_REACHES = np.geomspace(0.05, 10.0, 180)  # mm along X, that a chord may have at most
_INNER = np.linspace(0.0, 1.0, 17)


def height(x: FloatArray, order: int = 0) -> FloatArray:
    """Z of the curve at X, or a derivative of it."""
    return np.asarray(
        sum(
            size * (2.0 * np.pi / wave) ** order * np.sin(2.0 * np.pi / wave * x + phase + 0.5 * np.pi * order)
            for size, wave, phase in WAVES
        )
    )


@cache
def _way() -> tuple[FloatArray, FloatArray]:
    """X, and the distance along the curve there."""
    x = np.linspace(-1.0, LENGTH + 1.0, 200_001)
    rate = np.hypot(1.0, height(x, 1))
    s = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(x))])
    return x, s - np.interp(0.0, x, s)


def curve_length() -> float:
    return float(np.interp(LENGTH, *_way()))


def vertices(rng: np.random.Generator, chord_error: float) -> FloatArray:
    """X of the ends of random chords."""
    found = [0.0]
    while found[-1] < LENGTH:
        at = found[-1]
        x = at + _REACHES[:, None] * _INNER
        z = height(x)
        rise = (z[:, -1:] - z[:, :1]) / _REACHES[:, None]
        away = np.abs(z - z[:, :1] - rise * (x - at)).max(axis=1) / np.hypot(1.0, rise[:, 0])
        within = np.maximum.accumulate(away) <= chord_error
        found.append(at + float(rng.uniform(SHORTEST, 1.0) * _REACHES[within][-1]))
    return np.append(found[:-1], LENGTH) if LENGTH - found[-2] > 0.1 else np.append(found[:-2], LENGTH)


def write_passes(file: Path, chord_error: float, seed: int, *, alike: bool = False) -> int:
    """Write the program, with the same chords in every pass where ``alike``; returns the number of its blocks."""
    rng = np.random.default_rng(seed)
    lines = ["G21 G17 G90 G94", "G64 P0.01", f"G0 X0 Y0 Z{height(np.zeros(1))[0]:.6f}", "F6000"]
    x = vertices(rng, chord_error)
    for number in range(PASSES):
        if number:
            lines.append(f"G1 Y{STEP * number:.3f}")
            x = x if alike else vertices(rng, chord_error)
        way = x[::-1] if number % 2 else x
        lines += [f"G1 X{a:.6f} Z{b:.6f}" for a, b in zip(way[1:], height(way[1:]), strict=True)]
    file.write_text("\n".join([*lines, "M2"]) + "\n", encoding="ascii")
    return len(lines) - 4


@dataclass(frozen=True, eq=False)
class PassFeeds:
    """Feeds of the passes, (passes, n), mm/s, at distances along the curve, (n,), mm."""

    s: FloatArray
    feed: FloatArray

    @property
    def spread(self) -> FloatArray:
        """The largest less the smallest, against their mean, (n,)."""
        return np.asarray(np.ptp(self.feed, axis=0) / self.feed.mean(axis=0))

    @property
    def there_and_back(self) -> float:
        """Largest difference of the inner passes there from those back."""
        inner = self.feed[1:-1]
        return float(np.abs(inner[0::2].mean(axis=0) / inner[1::2].mean(axis=0) - 1.0).max())


def feeds_of(position: FloatArray, feed: FloatArray) -> PassFeeds:
    """Feeds of a motion (n, 3) in the order of time, by pass and place."""
    total = curve_length()
    s = np.linspace(LEFT_OUT, total - LEFT_OUT, int((total - 2.0 * LEFT_OUT) / 0.03))
    rows = []
    for number in range(PASSES):
        on = np.flatnonzero(np.abs(position[:, 1] - STEP * number) < _ON_PASS)
        place, of_pass = _place(position[on]), feed[on]
        if number % 2:
            place, of_pass = place[::-1], of_pass[::-1]
        going = np.append(True, np.diff(np.maximum.accumulate(place)) > 0.0)
        rows.append(np.interp(s, place[going], of_pass[going]))
    return PassFeeds(s, np.array(rows))


def _place(position: FloatArray) -> FloatArray:
    """Distance along the curve of the nearest points of it, (n,)."""
    x = position[:, 0].copy()
    for _ in range(6):
        z, slope, bend = (height(x, order) for order in range(3))
        away = z - position[:, 2]
        x -= (x - position[:, 0] + away * slope) / (1.0 + slope**2 + away * bend)
    return np.asarray(np.interp(x, *_way()))


def of_plan(profile: FeedrateProfile) -> PassFeeds:
    """Feeds of a plan."""
    at = profile.at(np.linspace(0.0, profile.duration, int(profile.duration / _BETWEEN)))
    return feeds_of(profile.curve.derivatives(at.u, 0)[0], at.feed)


def measure(file: Path, blocks: int) -> tuple[dict[str, Any], PassFeeds]:
    """Plan a program and compare its passes."""
    began = process_time()
    path = program_path(read_program(file), TOLERANCE, LIMITS)
    job = Job(path.curve, LIMITS.for_curve(path.curve), path=path)
    profile = job.plan()
    cpu = process_time() - began
    found, said = of_plan(profile), job.neighbouring_passes(profile)
    return {
        **_facts(found),
        "duration_s": profile.duration,
        "cpu_ms_a_block": 1e3 * cpu / blocks,
        "deviation_um": 1e3 * path.deviation.largest,
        "verdict_mean": None if said is None else said.mean,
        "verdict_worst": None if said is None else said.worst,
    }, found


def measure_linuxcnc(file: Path) -> tuple[dict[str, Any], PassFeeds]:
    """Let LinuxCNC run a program and compare its passes."""
    run = run_program(file, [250.0] * 3, [1000.0] * 3)
    step = np.diff(run.position, axis=0)
    found = feeds_of(0.5 * (run.position[1:] + run.position[:-1]), np.sqrt(np.sum(step**2, axis=1)) / SERVO_PERIOD)
    return {**_facts(found), "duration_s": run.cut_time, "version": run.version}, found


def _facts(found: PassFeeds) -> dict[str, Any]:
    spread = found.spread
    return {
        "mean": float(spread.mean()),
        "worst": float(spread.max()),
        "worst_at_mm": float(found.s[int(np.argmax(spread))]),
        "there_and_back": found.there_and_back,
    }


def passes_figure(found: dict[str, PassFeeds]) -> Any:
    """Feed of every pass over the place, and their spread."""
    panels = []
    for name, passes in found.items():
        feeds = [Line(f"pass {k + 1}", passes.s, feed) for k, feed in enumerate(passes.feed)]
        panels.append(Panel(name, "place along the curve, mm", "feed, mm/s", feeds, legend="none"))
        spread = [Line("spread", passes.s, 100.0 * passes.spread)]
        panels.append(Panel(f"{name}: spread", "place along the curve, mm", "% of the mean feed", spread, zero=True))
    return plot_panels("Six passes of one curve in random chords, within 10 µm", panels)


def results_table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="six passes of one curve, within 10 um", box=SIMPLE, padding=(0, 1, 0, 0))
    for head in (
        "planned by",
        "chords um",
        "alike",
        "seed",
        "blocks",
        "s",
        "mean %",
        "worst %",
        "there/back",
        "ms/block",
    ):
        table.add_column(head, justify="left" if head == "planned by" else "right", no_wrap=True)
    for row in rows:
        table.add_row(
            row["by"],
            f"{1e3 * row['chord_error_mm']:g}",
            "yes" if row["alike"] else "",
            str(row["seed"]),
            str(row["blocks"]),
            f"{row['duration_s']:.4f}",
            f"{100.0 * row['mean']:.3f}",
            f"{100.0 * row['worst']:.2f}",
            f"{row['there_and_back']:.1e}" if row["alike"] else "",
            f"{row['cpu_ms_a_block']:.2f}" if "cpu_ms_a_block" in row else "",
        )
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, help="JSON result file")
    parser.add_argument("--figure", type=Path, help="picture of the feeds of the passes")
    parser.add_argument("--seeds", type=int, default=1, help="random programs for each chord error")
    parser.add_argument("--no-linuxcnc", action="store_true", help="leave LinuxCNC out where it is installed")
    options = parser.parse_args()
    with_linuxcnc = is_installed() and not options.no_linuxcnc
    console = Console(width=110)
    rows: list[dict[str, Any]] = []
    drawn: dict[str, PassFeeds] = {}
    cases = [(error, seed, False) for error in CHORD_ERRORS for seed in range(1, options.seeds + 1)]
    with tempfile.TemporaryDirectory() as folder:
        for error, seed, alike in [*cases, *((error, 1, True) for error in CHORD_ERRORS)]:
            file = Path(folder) / "passes.ngc"
            blocks = write_passes(file, error, seed, alike=alike)
            facts = {"chord_error_mm": error, "seed": seed, "alike": alike, "blocks": blocks}
            row, found = measure(file, blocks)
            rows.append({"by": "feedplan", **facts, **row})
            shown = error == CHORD_ERRORS[2] and not alike
            drawn |= {"feedplan": found} if shown else {}
            if with_linuxcnc:
                row, found = measure_linuxcnc(file)
                rows.append({"by": "LinuxCNC", **facts, **row})
                drawn |= {"LinuxCNC": found} if shown else {}
    console.print(results_table(rows))
    if options.figure is not None:
        save_plot(options.figure, passes_figure(drawn))
    if options.output is not None:
        hardware = {"platform": platform.platform(), "cores": os.cpu_count(), "python": platform.python_version()}
        facts = {"feedplan": __version__, "hardware": hardware, "rows": rows}
        options.output.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    own = [row for row in rows if row["by"] == "feedplan"]
    met = all(row["mean"] <= MEAN and row["worst"] <= WORST for row in own if not row["alike"])
    return 0 if met and all(row["there_and_back"] <= THERE_AND_BACK for row in own if row["alike"]) else 1


if __name__ == "__main__":
    sys.exit(main())
