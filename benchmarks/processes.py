"""What is measured in processes of their own: start-up, a long plan and its memory, a step; also of another checkout.

    python -P benchmarks/processes.py long 1000000
    python -P benchmarks/processes.py write FOLDER
    python -P benchmarks/processes.py steps FOLDER

measure the packages that stand on ``PYTHONPATH``, which the functions here set to one checkout or the other, in turn.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import process_time, process_time_ns
from typing import Any
from unittest.mock import patch

HERE = Path(__file__).resolve().parents[1]
_COMMAND = ("plan", "circle")
_NUMPY = ("-c", "import numpy")
_PIP, _OFFLINE = ("-m", "pip", "-q"), ("--no-deps", "--no-index")
_NOT_PASSED_ON = ("PYTHONDONTWRITEBYTECODE", "PYTHONPATH", "NUMBA_CACHE_DIR")
_PLANAR = ("circle", "teardrop", "butterfly-nurbs")
_PERIOD = 1e-3  # s
_PATIENCE = 3600  # s
_LOOPS = 10  # of some 40 ms


class AbsentError(Exception):
    """A checkout that cannot be measured here, and why."""


# ---- called by the benchmark ---------------------------------------------------------------------------------------


def start_up(repeats: int, first_repeats: int) -> dict[str, Any]:
    """CPU time of whole processes, s: ``feedplan plan circle`` and, in turn with it, ``import numpy``.

    As a user has it: the command that pip puts into a new environment, with the bytecode that pip compiles.  "first" is the
    first command after the installation.
    """
    first, later, numpy_alone = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        wheel = built_wheel(HERE, Path(folder))
        for k in range(first_repeats):
            commands = installed(wheel, Path(folder) / f"{k}")
            first.append(children_cpu([commands / "feedplan", *_COMMAND]))
            numpy_alone.append(children_cpu([commands / "python", *_NUMPY]))
        for _ in range(repeats):
            numpy_alone.append(children_cpu([commands / "python", *_NUMPY]))
            later.append(children_cpu([commands / "feedplan", *_COMMAND]))
    alone = median(numpy_alone)
    return {
        "numpy_cpu_s": alone,
        "first_cpu_s": median(first),
        "later_cpu_s": median(later),
        "first_per_numpy": median(first) / alone,
        "later_per_numpy": median(later) / alone,
    }


def built_wheel(checkout: Path, folder: Path) -> Path:
    """Build the wheel of a checkout with what is installed here."""
    _run([sys.executable, *_PIP, "wheel", *_OFFLINE, "--no-build-isolation", "-w", str(folder), str(checkout)], folder)
    (wheel,) = folder.glob("*.whl")
    return wheel


def installed(wheel: Path, folder: Path) -> Path:
    """Install a wheel into a new environment, which has the libraries of this one; returns its folder of commands."""
    _run([sys.executable, "-m", "venv", "--without-pip", str(folder)], folder.parent)
    place = {name: Path(sysconfig.get_path(name, "venv", {"base": str(folder)})) for name in ("purelib", "scripts")}
    sites = [path for path in sys.path if path.endswith("site-packages")]
    (place["purelib"] / "libraries.pth").write_text("\n".join(sites), encoding="utf-8")
    python = str(place["scripts"] / "python")
    _run([sys.executable, *_PIP, "--python", python, "install", *_OFFLINE, str(wheel)], folder)
    return place["scripts"]


def children_cpu(command: Sequence[str | Path]) -> float:
    """CPU time of a process and of all that it starts, s."""
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        _run(command, Path(folder))
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run_python(arguments: Sequence[str], packages: Path) -> str:
    """Run Python with a checkout before what is installed; returns what it printed.  AbsentError if it fails."""
    return _run([sys.executable, "-P", *arguments], packages, PYTHONPATH=str(packages))


def _run(command: Sequence[str | Path], folder: Path, **environment: str) -> str:
    # Bytecode is written and read as it usually is, whatever this process was told.
    kept = {name: value for name, value in os.environ.items() if name not in _NOT_PASSED_ON}
    done = subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env={**kept, "OPENBLAS_NUM_THREADS": "1", **environment},
        capture_output=True,
        text=True,
        timeout=_PATIENCE,
        check=False,
    )
    if done.returncode != 0:
        raise AbsentError((done.stderr.strip() or done.stdout.strip()).splitlines()[-1])
    return done.stdout


def in_checkout(checkout: Path, *arguments: str) -> dict[str, Any]:
    """Run a measurement of this file in a process that sees the packages of a checkout."""
    answer: dict[str, Any] = json.loads(run_python([str(Path(__file__).resolve()), *arguments], checkout))
    return answer


def in_turn(before: Path | None, turns: int, *arguments: str) -> dict[str, list[dict[str, Any]]]:
    """The same measurement here and, where one is given, in another checkout, one after the other."""
    checkouts = {"here": HERE} | ({} if before is None else {"before": before})
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in checkouts}
    for _ in range(turns):
        for name, checkout in checkouts.items():
            found[name].append(in_checkout(checkout, *arguments))
    return found


# ---- run in a process of its own -----------------------------------------------------------------------------------


def memory(kind: str) -> int:
    """``VmRSS`` or the highest so far, ``VmHWM``, of this process, bytes."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(status.split(f"{kind}:")[1].split()[0])


def long_plan(intervals: int) -> dict[str, Any]:
    """Plan a winding path: CPU time, and the memory that comes on top of what the curve and the libraries take."""
    from benchmarks.cases import drives
    from benchmarks.solver import long_path
    from feedplan.job import Job
    from planner import load_curve

    Job(load_curve("teardrop"), drives()).plan()
    curve, limits = long_path(intervals)
    _ = curve.breaks
    held = memory("VmRSS")
    began = process_time()
    profile = Job(curve, limits).plan(intervals=intervals)
    return {
        "plan_cpu_s": process_time() - began,
        "duration_s": profile.duration,
        "bytes_per_interval": (memory("VmHWM") - held) / intervals,
        "peak_gb": memory("VmHWM") / 1e9,
    }


def write_plans(folder: Path) -> dict[str, Any]:
    """Write the plans whose steps are timed, as tables that every checkout reads."""
    from benchmarks.cases import drives
    from feedplan.job import Job
    from planner import load_curve, write_table

    for name in _PLANAR:
        curve, limits = load_curve(name), drives()
        write_table(folder / f"{name}.npz", Job(curve, limits).plan(intervals=1000), limits)
    return {"plans": list(_PLANAR)}


def steps(folder: Path) -> dict[str, Any]:
    """Shortest time of a step of the quintic table in its compiled loop, ns, and whether steps make the replay's bits."""
    import numpy as np

    from benchmarks.interpolator import FORMS, loop_times
    from interp import InterpolatorTable, quintic_step, replay, start
    from planner import load_curve, read_table

    step_ns, same = {}, True
    for name in _PLANAR:
        curve = load_curve(name)
        profile = read_table(folder / f"{name}.npz", curve)
        with patch("time.perf_counter_ns", process_time_ns):  # this process's time, whatever else runs
            step_ns[name] = min(min(loop_times(profile, FORMS[-1], _PERIOD)) for _ in range(_LOOPS))
        table = InterpolatorTable.from_profile(profile)
        state = start(table, _PERIOD)
        position = state[-table.dim :]
        stepped, done = [position.copy()], False
        while not done:
            done = quintic_step(*table.arrays, state)
            stepped.append(position.copy())
        same &= np.array_equal(np.array(stepped), replay(curve, profile, _PERIOD).position)
    return {"step_ns": step_ns, "same_bits_as_replay": bool(same)}


def main() -> None:
    import planner

    if not Path(planner.__file__).is_relative_to(os.environ["PYTHONPATH"]):
        sys.exit(f"no feedplan in {os.environ['PYTHONPATH']}")
    kind, *rest = sys.argv[1:]
    if kind == "long":
        print(json.dumps(long_plan(int(rest[0]))))
    else:
        print(json.dumps({"write": write_plans, "steps": steps}[kind](Path(rest[0]))))


if __name__ == "__main__":
    main()
