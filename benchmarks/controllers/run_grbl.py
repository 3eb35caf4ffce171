"""Times of programs by GRBL's own planner and stepper code, built for this computer from the folder of its sources."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np

from planner.controllers.grbl import GrblSettings
from planner.programs.reading.program import ARC, RAPID, Program

HOST = Path(__file__).with_name("grbl_host")
_SOURCES = ("planner.c", "motion_control.c", "nuts_bolts.c")
_WAITS_FOR = ("dwell", "tool_change", "stop", "end", "spindle", "coolant")
_SECONDS = 600.0  # for a program


def build(sources: Path, folder: Path) -> Path:
    """Compile the host with the sources of GRBL 1.1 (the folder with planner.c); the program."""
    out = folder / "run_grbl"
    command = ["gcc", "-std=gnu11", "-O1", "-w", "-fcommon", "-ffunction-sections", "-Wl,--gc-sections"]
    command += [f"-I{HOST}", f"-I{sources}", str(HOST / "run_grbl.c"), *(str(sources / name) for name in _SOURCES)]
    subprocess.run([*command, "-lm", "-o", str(out)], check=True)
    return out


def version(sources: Path) -> str:
    """What the sources call themselves, such as 1.1h."""
    text = (sources / "grbl.h").read_text(encoding="utf-8")
    return next(line.split('"')[1] for line in text.splitlines() if line.startswith("#define GRBL_VERSION "))


def run_grbl(host: Path, program: Program, settings: GrblSettings) -> float:
    """Seconds of motion of a program; the steps of the three axes are the same."""
    text = host_text(program, settings)
    run = subprocess.run([str(host)], input=text, capture_output=True, text=True, check=True, timeout=_SECONDS)
    return float(run.stdout)


def host_text(program: Program, settings: GrblSettings) -> str:
    """The program in the words of the host."""
    rates = " ".join(f"{60.0 * value:.9g}" for value in settings.max_rate)
    accelerations = " ".join(f"{value:.9g}" for value in settings.acceleration)
    lines = [
        f"set {settings.steps_per_mm[0]:g} {rates} {accelerations} {settings.junction_deviation:.9g} "
        f"{settings.arc_tolerance:.9g}",
        f"from {_point(program.start[0])}",
    ]
    waits = {event.after_move for event in program.events if event.kind in _WAITS_FOR}
    for k in range(len(program)):
        if k - 1 in waits:
            lines.append("wait")
        kind, end = int(program.kind[k]), _point(program.end[k])
        if kind == RAPID:
            lines.append(f"rapid {end}")
            continue
        word, arc = "line", ""
        if kind == ARC:
            normal = int(program.normal[k])
            offset = program.centre[k] - program.start[k, :3]
            plane = ((normal + 1) % 3, (normal + 2) % 3, normal)
            word, arc = "arc", f" {_point(offset)} {plane[0]} {plane[1]} {plane[2]} {int(program.sweep[k] < 0.0)}"
        lines.append(f"{word} {end} {60.0 * program.feed[k]:.9g}{arc}")
    return "\n".join(lines) + "\n"


def _point(values: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in values[:3])
