"""Predicted against actual time of programs that ``feedplan ngc`` writes, in headless LinuxCNC.

    python -m benchmarks.linuxcnc [-o results.json] [--only slots] [program.ngc ...]
    python -m benchmarks.linuxcnc rt ...       LinuxCNC's thread runs the plan itself: see rt.py

Every curve and part program is planned on the mill's limits, written, read by rs274 and run on a machine with **the plan's
own acceleration** (LinuxCNC has no jerk limit).  "predicted" is what ``write_ngc`` says that LinuxCNC takes, "planned" is
the duration of the plan; with a share of the acceleration the plan leaves LinuxCNC room to keep to it.  Exit code 1: a
prediction is off by more than 1 %, or a path leaves its tolerance.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import mill
from benchmarks.linuxcnc import rt
from benchmarks.linuxcnc.interpreter import interpret, is_installed
from benchmarks.linuxcnc.machine import largest_distance, run_program
from feedplan.job import load_job
from feedplan.sources import PATH_SHARE, is_program

PROGRAMS = Path(__file__).resolve().parents[2] / "tests" / "data" / "programs"
LIMITS = mill(dim=3)
CURVES = (("butterfly-nurbs", 1.0), ("teardrop", 1.0), ("hypotrochoid", 10.0), ("circle", 1.0))
SHARED = {"butterfly-nurbs": 0.75, "hypotrochoid": 0.8, "slots": 0.75, "zigzag": 0.75, "raster": 0.75}
TOLERANCES = (0.01, 0.05)  # of the part programs; curves have the first
ALLOWED = 0.01  # of the predicted time
HEAD = "program            um  share  blocks  planned s  predicted s  actual s  off predicted  off plan  distance um"


@dataclass(frozen=True)
class Case:
    """What is planned: a curve by name or a program, within a tolerance, mm, on a share of the acceleration."""

    source: str
    scale: float
    tolerance: float
    share: float


def cases(folder: Path) -> list[Case]:
    """All of them, in the order of the table."""
    raster = folder / "raster.ngc"
    raster.write_text(_raster())
    found = [Case(name, scale, TOLERANCES[0], 1.0) for name, scale in CURVES]
    files = (PROGRAMS / "slots.ngc", PROGRAMS / "zigzag.ngc", raster)
    found += [Case(str(file), 1.0, tolerance, 1.0) for file in files for tolerance in TOLERANCES]
    return found + [
        replace(case, share=SHARED[Path(case.source).stem]) for case in found if Path(case.source).stem in SHARED
    ]


def _raster() -> str:
    """Eight lines of 12 mm, there and back, 0.5 mm apart: fifteen corners."""
    corners = [(12.0 * ((k + 1) // 2 % 2), 0.5 * (k // 2)) for k in range(16)]
    return "\n".join(["G21 G90 G17 F6000", "G0 X0 Y0", *(f"G1 X{x:g} Y{y:g}" for x, y in corners[1:]), "M2"]) + "\n"


def judge(case: Case, folder: Path) -> dict[str, object]:
    """Plan, write, interpret and run one case."""
    program = is_program(case.source)
    job = load_job(
        case.source, LIMITS.without_chord_error() if program else LIMITS, scale=case.scale,
        tolerance=case.tolerance if program else None, share=PATH_SHARE if program else 1.0, acceleration_share=case.share,
    )  # fmt: skip
    if not program:
        job = replace(job, room=case.tolerance)
    profile = job.plan()
    path = folder / "written.ngc"
    written = job.write(path, profile, "feed")
    canonical = interpret(path)
    if canonical.counts["STRAIGHT_FEED"] != written.blocks:
        raise RuntimeError(f"{case.source}: rs274 makes {canonical.counts} of {written.blocks} blocks")
    run = run_program(path, LIMITS.velocity.tolist(), LIMITS.acceleration.tolist())
    u = np.linspace(*job.curve.domain, 40 * written.blocks)
    exact = np.zeros((u.size, 3))
    exact[:, ["XYZ".index(axis) for axis in job.curve.axes]] = job.curve.derivatives(u, 0)[0]
    return {
        "program": Path(case.source).stem,
        "tolerance_um": 1e3 * case.tolerance,
        "share": case.share,
        "blocks": written.blocks,
        "planned_s": profile.duration,
        "predicted_s": written.duration,
        "actual_s": run.cut_time,
        "off_predicted": run.cut_time / written.duration - 1.0,
        "off_plan": run.cut_time / profile.duration - 1.0,
        "distance_um": 1e3 * largest_distance(run.position, exact, 2000),
        "allowed_um": 1e3 * job.room,
        "linuxcnc": run.version,
    }


def missed(row: dict[str, Any]) -> bool:
    """Whether a row is not as it should be."""
    return bool(abs(row["off_predicted"]) > ALLOWED or row["distance_um"] > row["allowed_um"])


def main() -> int:
    if sys.argv[1:2] == ["rt"]:
        return rt.main(sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", type=Path, help="programs to run as they are, on the mill's limits")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--only", default="", help="part of the names to run")
    options = parser.parse_args()
    if not is_installed():
        print("LinuxCNC is not installed (Debian: apt-get install --no-install-recommends linuxcnc-uspace)")
        return 3
    for program in options.programs:
        interpret(program)
        run = run_program(program, [250.0] * 3, [1000.0] * 3)
        print(f"{program.name}: {run.cut_time:.3f} s, LinuxCNC {run.version}")
    if options.programs:
        return 0
    print(HEAD)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for case in cases(folder):
            if options.only not in Path(case.source).stem:
                continue
            row = judge(case, folder)
            rows.append(row)
            words = f"{row['program']:<16} {row['tolerance_um']:>4g} {row['share']:>6g} {row['blocks']:>7}"
            seconds = f"{row['planned_s']:>10.4f} {row['predicted_s']:>12.4f} {row['actual_s']:>9.3f}"
            off = f"{row['off_predicted']:>+14.2%} {row['off_plan']:>+9.2%} {row['distance_um']:>12.2f}"
            print(words, seconds, off, flush=True)
    if options.output:
        machine = {"platform": platform.platform(), "python": platform.python_version()}
        options.output.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")
    return 1 if any(missed(row) for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
