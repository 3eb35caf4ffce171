"""Times by gcode-simulator, a re-implementation of GRBL's junctions: no GRBL, and of X and Y alone."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from planner import Program
from planner.controllers.controller_motion import ControllerMotion
from planner.controllers.grbl import GrblSettings


def simulator_seconds(command: str, program: Program, motion: ControllerMotion, settings: GrblSettings) -> float | None:
    """Seconds of the legs of a motion, from where it begins; None of programs that move Z."""
    points = motion.legs.at(np.arange(motion.length.size), motion.length)[0] - program.start[0, :3]
    if np.ptp(points[:, 2]) > 0.0:
        return None
    feed = program.feed[np.searchsorted(program.line, motion.line, side="right") - 1]
    lines = [
        f"G0 X{x:.6f} Y{y:.6f}" if np.isinf(f) else f"G1 X{x:.6f} Y{y:.6f} F{60.0 * f:.6f}"
        for (x, y, _), f in zip(points, feed, strict=True)
    ]
    limits = []
    for k, axis in enumerate("xy"):
        limits += [f"--max-rate-{axis}", f"{60.0 * settings.max_rate[k]}", f"--max-accel-{axis}"]
        limits.append(f"{settings.acceleration[k]}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.gcode"
        path.write_text("\n".join(["G21", "G90", *lines, ""]), encoding="utf-8")
        run = [command, str(path), *limits, "--junction-deviation", f"{settings.junction_deviation}", "--json-output"]
        said = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    return float(json.loads(said[said.index("{") :])["execution_time"]["seconds"])
