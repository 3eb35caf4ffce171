"""Hidden limits of headless LinuxCNC found from five logs, and from times alone, and what they say of twenty other programs.

python -m benchmarks.calibration [-o results.json]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.calibration.programs import logged, predicted
from benchmarks.linuxcnc.interpreter import is_installed
from benchmarks.linuxcnc.machine import SERVO_PERIOD, Run, run_program
from planner.calibration.calibrate import calibrate_logs
from planner.calibration.calibrated_machine import calibrated_limits
from planner.calibration.controller_times import calibrate_times, seconds_of
from planner.calibration.log import Log
from planner.calibration.times_list import TimedProgram
from planner.controllers.known import CONTROLLERS
from planner.machine.limits import Limits
from planner.programs.reading.reader import read_program
from planner.quantity import ACCELERATION

AXES = ("X", "Y", "Z")
MACHINES = (((150.0, 120.0, 60.0), (900.0, 700.0, 400.0)), ((90.0, 110.0, 45.0), (1500.0, 1150.0, 620.0)))
START = Limits(200.0, [250.0] * 3, [1000.0] * 3, [20000.0] * 3, axes=AXES)
ALLOWED = (0.02, 0.01, 0.02, 0.05)  # acceleration; other programs, median and worst; median from times alone
CONTROLLER = "linuxcnc"


def judge(velocity: tuple[float, ...], acceleration: tuple[float, ...], folder: Path) -> dict[str, object]:
    """Run all programs on a machine, calibrate on the five and predict the twenty."""
    runs: dict[str, tuple[TimedProgram, Run]] = {}
    for name, text in (*logged(), *predicted()):
        file = folder / f"{name}.ngc"
        file.write_text(text)
        run = run_program(file, velocity, acceleration)
        timed = TimedProgram(name, read_program(file, start=(0.0, 0.0, 0.0)), run.whole_time, name)
        runs[name] = (timed, run)
    names = [name for name, _ in logged()]
    logs = []
    for name in names:
        position = runs[name][1].trace
        t = SERVO_PERIOD * np.arange(len(position))
        logs.append(Log(name, AXES, t, position, SERVO_PERIOD, (slice(0, t.size),)))
    found = calibrate_logs(logs, START)
    off = [
        limit.value / acceleration[AXES.index(limit.axis)] - 1.0 if limit.known else np.nan
        for limit in found.limits
        if limit.quantity is ACCELERATION
    ]
    row: dict[str, object] = {"velocity": velocity, "acceleration": acceleration, "acceleration_off": off}
    if CONTROLLER in CONTROLLERS:
        others = [runs[name][0] for name, _ in predicted()]
        times = calibrate_times([runs[name][0] for name in names], START, CONTROLLER, lambda _text, _share: None)
        row["from_logs"] = errors(others, calibrated_limits(START, found.limits))
        row["from_times"] = errors(others, calibrated_limits(START, times.fit.limits))
    return row


def errors(timed: list[TimedProgram], limits: Limits) -> list[float]:
    """Relative error of the model's times with these limits, absolute values, ascending."""
    said = seconds_of(timed, CONTROLLERS[CONTROLLER])(limits)
    return sorted(np.abs(said / [row.seconds for row in timed] - 1.0).tolist())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    if not is_installed():
        print("LinuxCNC is not installed (Debian: apt-get install --no-install-recommends linuxcnc-uspace)")
        return 3
    rows, missed = [], False
    for velocity, acceleration in MACHINES:
        with tempfile.TemporaryDirectory() as folder:
            row = judge(velocity, acceleration, Path(folder))
        rows.append(row)
        off = np.abs(np.array(row["acceleration_off"], dtype=np.float64))
        print(f"hidden acceleration {acceleration}: off by {', '.join(f'{100.0 * x:.3f} %' for x in off)}")
        missed |= bool(not np.all(off < ALLOWED[0]))
        for name, (median, worst) in {"from_logs": ALLOWED[1:3], "from_times": (ALLOWED[3], np.inf)}.items():
            if name in row:
                found = np.array(row[name])
                print(
                    f"  twenty others {name}: median {100.0 * np.median(found):.3f} %, worst {100.0 * found.max():.3f} %"
                )
                missed |= bool(np.median(found) > median or found.max() > worst)
            else:
                print(f"  twenty others {name}: there is no model of {CONTROLLER}")
                missed = True
    if options.output:
        options.output.write_text(json.dumps(rows, indent=1) + "\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
