"""Predicted against actual time of programs that ``write_ngc`` makes, in headless LinuxCNC.

    python -m benchmarks.linuxcnc [-o results.json] [program.ngc ...]

Every curve is planned on the mill's limits, written within 10 um, read by rs274 and run twice: on a machine with the
plan's own axis limits, and on one of twice the acceleration, which allows the plan's feed.  LinuxCNC has no jerk limit, but
on blends it uses only part of the acceleration, so with equal limits it is the one that holds the path back.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.linuxcnc.interpreter import interpret, is_installed
from benchmarks.linuxcnc.machine import largest_distance, run_program
from feedplan.job import load_job
from planner import write_ngc

CASES = (("butterfly-nurbs", 1.0), ("teardrop", 1.0), ("hypotrochoid", 10.0), ("circle", 1.0))
MODES = ("feed", "inverse_time")
TOLERANCE = 0.01
ALLOWED = 0.03  # of the predicted time, where LinuxCNC's limits allow the plan's feed
HEAD = "curve                mode           blocks  predicted s  actual s (2 a)     off    actual s (a)   distance um"


def judge(name: str, scale: float, mode: str, folder: Path) -> dict[str, object]:
    """Plan, write, interpret and run one curve."""
    job = load_job(name, "mill", scale=scale)
    curve, limits, profile = job.curve, job.limits, job.plan()
    path = folder / f"{name}.ngc"
    written = write_ngc(path, curve, profile, tolerance=TOLERANCE, mode=mode)
    canonical = interpret(path)
    if canonical.counts["STRAIGHT_FEED"] != written.blocks:
        raise RuntimeError(f"{name}: rs274 makes {canonical.counts} of {written.blocks} blocks")
    axes = np.zeros((2, 3))
    axes[0], axes[1] = limits.velocity.max(), limits.acceleration.max()
    free, same = (run_program(path, axes[0], factor * axes[1]) for factor in (2.0, 1.0))
    u = np.linspace(*curve.domain, 20 * written.blocks)
    exact = np.zeros((u.size, 3))
    exact[:, : curve.dim] = curve.derivatives(u, 0)[0]
    return {
        "curve": name,
        "scale": scale,
        "mode": mode,
        "blocks": written.blocks,
        "predicted_s": profile.duration,
        "actual_s": free.cut_time,
        "off": free.cut_time / profile.duration - 1.0,
        "actual_same_limits_s": same.cut_time,
        "distance_um": 1e3 * max(largest_distance(run.position, exact, 2000) for run in (free, same)),
        "linuxcnc": free.version,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", type=Path, help="programs to run as they are, on the mill's limits")
    parser.add_argument("-o", "--output", type=Path)
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
    with tempfile.TemporaryDirectory() as folder:
        for name, scale in CASES:
            for mode in MODES:
                row = judge(name, scale, mode, Path(folder))
                rows.append(row)
                print(
                    f"{name:<20} {mode:<13} {row['blocks']:>7} {row['predicted_s']:>12.4f} {row['actual_s']:>15.3f} "
                    f"{row['off']:>+7.2%} {row['actual_same_limits_s']:>15.3f} {row['distance_um']:>13.2f}",
                    flush=True,
                )
    if options.output:
        machine = {"platform": platform.platform(), "python": platform.python_version()}
        options.output.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")
    missed = [row for row in rows if abs(row["off"]) > ALLOWED or row["distance_um"] > 1e3 * TOLERANCE]
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
