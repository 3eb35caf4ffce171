"""What a step of the controller's interpolator takes, beside the compiled loop of replay and the loop of version 0.1.0.

    python -m benchmarks.step [--former FOLDER --python PYTHON] [--steps 10000000]

Each case is planned and written as a plan file; ``benchmarks/step_clock.c`` is compiled with ``interp/step.c`` and steps
through it, pinned to a core: a loop without a clock, then single steps with one.  The loop of version 0.1.0, by numba,
runs in turn with it where its checkout and a Python that has numba are given: it gets the same two arrays.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from feedplan.job import Job, load_job
from interp.plan_file import write_plan_file
from interp.step import PlanStep
from interp.taylor import InterpolatorTable, quintic_step, runner, start
from planner.profile import FeedrateProfile

ROOT = Path(__file__).parents[1]
CASES = ("teardrop", "butterfly-nurbs", "flank")
RESERVE = 0.1
ROUNDS = 5
_REPEATS = 20_000
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", f"-I{ROOT}")
FORMER = """
import sys, time
sys.path.insert(0, sys.argv[1])
import numpy as np
from interp import kernels
given = np.load(sys.argv[2])
segments, pieces, state = given["segments"], given["pieces"], given["state"]
count = int(given["count"])
u, positions = np.empty(count), np.empty(count * ((state.size - kernels.END) // 2))
times = []
for _ in range(21):
    begun = [state.copy() for _ in range(20)]
    begin = time.perf_counter_ns()
    for one in begun:
        kernels.quintic_run(segments, pieces, one, u, positions)
    times.append((time.perf_counter_ns() - begin) / (20 * count))
print(float(np.median(times)))
"""


def clock(program: Path, file: Path, steps: int, *, governed: bool) -> list[float]:
    """Ns a step: in the loop; of single steps the median, the largest but a millionth, and the largest."""
    done = subprocess.run([program, file, str(steps), str(int(governed))], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()[:4]]


def former_step(profile: FeedrateProfile, period: float, former: Path, python: str, folder: Path) -> float:
    """Ns a step of the loop of version 0.1.0 on the table of a plan."""
    table = InterpolatorTable.from_profile(profile)
    state = start(table, period)
    # Its state had no sizes: sample, segment, piece, u, the period in two parts, last, end; then end and last position.
    old = np.concatenate([np.asarray(state)[:8], np.asarray(state)[-2 * table.dim :]])
    np.savez(folder / "former.npz", segments=table.segments, pieces=table.pieces, state=old, count=int(state[6]))
    done = subprocess.run(
        [python, "-c", FORMER, str(former), str(folder / "former.npz")],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": ""},
    )
    return float(done.stdout)


def replay_step(profile: FeedrateProfile, period: float) -> float:
    """Ns a step of the loop of replay, which takes eight samples together."""
    table = InterpolatorTable.from_profile(profile)
    run, state = runner(table, 5), start(table, period)
    count = int(state[6])
    u, positions = np.empty(count), np.empty(count * table.dim)
    times = []
    for _ in range(21):
        begin = time.perf_counter_ns()
        for _ in range(20):
            run(state.copy(), u, positions)
        times.append((time.perf_counter_ns() - begin) / (20 * count))
    return float(np.median(times))


def python_steps(profile: FeedrateProfile, file: Path, period: float) -> tuple[float, float]:
    """Ns of a step that is called from Python: by ``PlanStep`` and by ``quintic_step``."""
    table = InterpolatorTable.from_profile(profile)
    arrays, state, step = table.arrays, start(table, period), PlanStep(file, period)
    found = []
    for call in (step.step, lambda: quintic_step(*arrays, state)):
        times = []
        for _ in range(9):
            step.seek(sample=0, rate=1.0)
            begin = time.perf_counter_ns()
            for _ in range(_REPEATS // 10):
                call()
            times.append((time.perf_counter_ns() - begin) / (_REPEATS // 10))
        found.append(float(np.median(times)))
    return found[0], found[1]


def measure(job: Job, program: Path, folder: Path, steps: int, former: tuple[Path, str] | None) -> list[str]:
    """A row of the table: medians over rounds in which everything runs in turn."""
    profile, file = job.plan(), folder / "plan.fpr"
    write_plan_file(profile, file, job.limits)
    period = job.limits.period
    rounds = []
    for _ in range(ROUNDS):
        before = former_step(profile, period, *former, folder) if former else np.nan
        rounds.append(
            [
                clock(program, file, 1000, governed=False)[0],
                clock(program, file, 1000, governed=True)[0],
                before,
                replay_step(profile, period),
                *python_steps(profile, file, period),
            ]
        )
    times = np.median(rounds, axis=0)
    ratios = np.median(np.array(rounds)[:, :2] / np.array(rounds)[:, 2:3], axis=0)
    singles = [clock(program, file, steps, governed=governed)[1:] for governed in (False, True)]
    worst = [f"{most / middle:.0f} ({millionth / middle:.0f})" for middle, millionth, most in singles]
    return [
        job.curve.name,
        *(f"{x:.1f}" for x in times[:4]),
        *(f"{x:.2f}" for x in ratios),
        *worst,
        f"{times[4]:.0f}",
        f"{times[5]:.0f}",
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure all cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--former", type=Path, help="checkout of version 0.1.0")
    parser.add_argument("--python", default="python", help="a Python with numba, for it")
    parser.add_argument("--steps", type=int, default=10_000_000, help="single steps")
    parser.add_argument("--only", choices=CASES, help="one case")
    given = parser.parse_args(arguments)
    former = (given.former, given.python) if given.former else None
    heads = ("case", "step ns", "override ns", "0.1.0 ns", "replay ns", "step/0.1.0", "override/0.1.0")
    table = Table(*heads, "worst/median", "with override", "Python ns", "quintic_step ns")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = folder / "step_clock"
        files = [str(ROOT / "benchmarks" / "step_clock.c"), str(ROOT / "interp" / "step.c")]
        subprocess.run(["cc", *FLAGS, *files, "-o", str(program), "-lm"], check=True)
        for case in CASES if given.only is None else (given.only,):
            table.add_row(*measure(load_job(case, override_reserve=RESERVE), program, folder, given.steps, former))
    console = Console(width=150)
    console.print(table)
    console.print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; the largest of {given.steps} single steps")


if __name__ == "__main__":
    main()
