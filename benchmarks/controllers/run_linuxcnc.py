"""Times of programs in headless LinuxCNC."""

from __future__ import annotations

from pathlib import Path

from benchmarks.linuxcnc.machine import run_program
from planner import Program
from planner.controllers.linuxcnc import LinuxcncSettings


def linuxcnc_seconds(
    programs: list[tuple[Path, Program]], settings: dict[str, LinuxcncSettings]
) -> tuple[str, dict[tuple[str, str], float]]:
    """The version, and of every program and machine the time in which it moves, s: rests and pauses are none."""
    found, version = {}, ""
    for path, program in programs:
        for name, own in settings.items():
            run = run_program(
                path, own.max_velocity.tolist(), own.max_acceleration.tolist(), start=program.start[0, :3].tolist()
            )
            found[path.name, name] = run.moving_time
            version = run.version
    return version, found
