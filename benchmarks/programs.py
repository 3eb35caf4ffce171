"""Part programs: durations at three tolerances against their bars, and LinuxCNC running what is written from the plans.

    python -m benchmarks.programs [--output results.json] [--no-linuxcnc]

Machine: the mill's limits without a chord error, 250 mm/s, 1000 mm/s^2 and 20 000 mm/s^3 an axis, F6000.  CPU seconds of
one run.  Where LinuxCNC is installed, the program written from each plan at 10 um is read
by rs274 and run headless on a machine of twice the plan's acceleration, which lets it follow the plan's feed: LinuxCNC has
no jerk limit, and on blends uses only part of its acceleration.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from benchmarks.cases import drives
from benchmarks.linuxcnc.interpreter import interpret, is_installed
from benchmarks.linuxcnc.machine import run_program
from feedplan.job import Job
from planner import FeedrateProfile, Limits, Program, __version__, read_program
from planner.output.ngc_program import write_program
from planner.programs.path.smooth_path import ProgramPath, program_path
from planner.programs.times import line_times

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "data" / "programs"
TOLERANCES = (1e-3, 1e-2, 5e-2)  # mm
BARS = {  # s
    ("butterfly_5000", 1e-3): 6.66,
    ("butterfly_5000", 1e-2): 6.66,
    ("slots", 1e-2): 5.80,
    ("slots", 5e-2): 5.32,
    ("zigzag", 1e-2): 12.90,
    ("zigzag", 5e-2): 12.20,
}
NAMES = ("butterfly_5000", "slots", "zigzag")
LIMITS = drives(dim=3)
RUN_TOLERANCE = 1e-2  # mm; the path takes three quarters, the blocks and their blending the rest
PATH_SHARE = 0.75
ALLOWED = 0.03  # of the predicted time


def planned(program: Program, tolerance: float) -> tuple[ProgramPath, Limits, FeedrateProfile]:
    path = program_path(program, tolerance, LIMITS, path="separate")
    limits = LIMITS.for_curve(path.curve)
    return path, limits, Job(path.curve, limits).plan()


def measure(name: str, tolerance: float) -> dict[str, Any]:
    """Plan one program within one tolerance."""
    program = read_program(FOLDER / f"{name}.ngc")
    began = process_time()
    path = program_path(program, tolerance, LIMITS, path="separate")
    limits = LIMITS.for_curve(path.curve)
    made = process_time()
    job = Job(path.curve, limits)
    profile = job.plan()
    done = process_time()
    without = job.without_jerk().plan()
    bar = BARS.get((name, tolerance))
    return {
        "program": name,
        "tolerance_mm": tolerance,
        "duration_s": profile.duration,
        "bar_s": bar,
        "met": bar is None or profile.duration <= bar,
        "without_jerk_limit_s": without.duration,
        "deviation_mm": path.deviation.largest,
        "deviation_line": path.deviation_line,
        "exact_stops": len(path.stops),
        "path_cpu_s": made - began,
        "plan_cpu_s": done - made,
        "lines_off_s": line_times(program, path, profile).moving - profile.duration,
        "check_ok": job.check(profile).ok,
    }


def judge(name: str, folder: Path) -> dict[str, Any]:
    """Write the program of a plan, let rs274 read it and LinuxCNC run it."""
    source = read_program(FOLDER / f"{name}.ngc")
    path, _, profile = planned(source, PATH_SHARE * RUN_TOLERANCE)
    file = folder / f"{name}.ngc"
    written = write_program(file, source, path, profile, tolerance=(1.0 - PATH_SHARE) * RUN_TOLERANCE)
    canonical = interpret(file)
    run = run_program(file, [250.0] * 3, [2000.0] * 3)
    return {
        "program": name,
        "tolerance_mm": RUN_TOLERANCE,
        "blocks": written.blocks,
        "accepted": canonical.counts["STRAIGHT_FEED"] == written.blocks,
        "predicted_s": profile.duration,
        "actual_s": run.cut_time,
        "off": run.cut_time / profile.duration - 1.0,
        "linuxcnc": run.version,
    }


def durations_table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="durations of part programs", box=SIMPLE, padding=(0, 1, 0, 0))
    for head in ("program", "tol um", "s", "bar", "no jerk", "costs", "dev. um", "path CPU s", "plan", "check"):
        table.add_column(head, justify="left" if head == "program" else "right", no_wrap=True)
    for row in rows:
        table.add_row(
            row["program"],
            f"{1e3 * row['tolerance_mm']:g}",
            f"{row['duration_s']:.3f}",
            "" if row["bar_s"] is None else f"{row['bar_s']:.2f}" + ("" if row["met"] else " MISSED"),
            f"{row['without_jerk_limit_s']:.3f}",
            f"{100.0 * (row['duration_s'] / row['without_jerk_limit_s'] - 1.0):.1f}%",
            f"{1e3 * row['deviation_mm']:.3f}",
            f"{row['path_cpu_s']:.2f}",
            f"{row['plan_cpu_s']:.2f}",
            "ok" if row["check_ok"] else "FAILS",
        )
    return table


def runs_table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="written within 10 um and run by LinuxCNC", box=SIMPLE, padding=(0, 1, 0, 0))
    for head in ("program", "blocks", "rs274", "predicted s", "actual s", "off"):
        table.add_column(head, justify="left" if head == "program" else "right", no_wrap=True)
    for row in rows:
        table.add_row(
            row["program"],
            str(row["blocks"]),
            "accepts" if row["accepted"] else "MERGES",
            f"{row['predicted_s']:.4f}",
            f"{row['actual_s']:.3f}",
            f"{row['off']:+.2%}",
        )
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, help="JSON result file")
    parser.add_argument("--no-linuxcnc", action="store_true", help="leave LinuxCNC out where it is installed")
    options = parser.parse_args()
    console = Console(width=100)
    planned(read_program(FOLDER / "slots.ngc"), 0.05)  # compile
    rows = [measure(name, tolerance) for name in NAMES for tolerance in TOLERANCES]
    console.print(durations_table(rows))
    console.print("Where a path really has corners a jerk limit costs 1 to 30 %: that is the column costs.")
    runs: list[dict[str, Any]] = []
    if is_installed() and not options.no_linuxcnc:
        with tempfile.TemporaryDirectory() as folder:
            runs = [judge(name, Path(folder)) for name in NAMES]
        console.print(runs_table(runs))
    elif not options.no_linuxcnc:
        console.print("LinuxCNC is not installed (Debian: apt-get install --no-install-recommends linuxcnc-uspace)")
    if options.output is not None:
        hardware = {"platform": platform.platform(), "cores": os.cpu_count(), "python": platform.python_version()}
        facts = {"feedplan": __version__, "hardware": hardware, "durations": rows, "linuxcnc": runs}
        options.output.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    good = all(row["met"] and row["check_ok"] for row in rows)
    return 0 if good and all(run["accepted"] and abs(run["off"]) <= ALLOWED for run in runs) else 1


if __name__ == "__main__":
    sys.exit(main())
