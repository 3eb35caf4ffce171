"""LinuxCNC runs plans: the HAL component feedplan_rt, built, loaded into a real-time thread without a screen, and measured.

    python -m benchmarks.linuxcnc rt [-o results.json] [--trace trace.npz]

1. The sampled positions of a plan are those of ``interp.step`` to 1e-9 mm, and their differences keep every limit.
2. So they do while a script moves override and hold at random; and what was recorded of the two signals, given to
   ``interp.step``, makes the same positions.
3. What a period costs, beside LinuxCNC's own planner (the ``.time`` pins of HAL, in clocks of the processor).
4. Cycle times of three programs: LinuxCNC's planner, which has no jerk limit, and the same machine running the plan.

Exit code 1: a position is off, or a limit does not hold; 3: LinuxCNC or its compiler of components is not installed, or its
folder of modules may not be written to.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import mill
from benchmarks.linuxcnc.interpreter import is_installed
from benchmarks.linuxcnc.machine import SERVO_PERIOD, alone, realtime_environment, run_program, the_only_linuxcnc
from feedplan.job import load_job
from feedplan.sources import PATH_SHARE, is_program
from interp.plan_file import plan_bytes
from interp.step import PlanStep
from planner import load_curve
from planner.machine.limits import Limits

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ROOT / "tests" / "data" / "programs"
MODULES = Path("/usr/lib/linuxcnc/modules")
_MODULE = "feedplan_rt.so"
LIMITS = mill(dim=3)
RESERVE = 0.1
TOLERANCE = 0.01  # mm, of programs
ALLOWED = 1e-9  # mm
_FINE = 1e6  # the sampler writes six decimals: positions are given to it in nm
_SIGNALS = 8  # columns of the sampler behind the positions
_KNOBS = 40
_SEED = 15


@dataclass(frozen=True, eq=False)
class Trace:
    """What the sampler recorded of a run, one row a period from the last before the first motion.

    ``position`` (n, dim) mm; ``override``, ``hold`` and ``run`` as they were when the row was made; ``rate``, ``feed`` mm/s;
    ``clocks`` what the component took.
    """

    position: NDArray[np.float64]
    override: NDArray[np.float64]
    hold: NDArray[np.bool_]
    run: NDArray[np.bool_]
    done: NDArray[np.bool_]
    rate: NDArray[np.float64]
    feed: NDArray[np.float64]
    clocks: NDArray[np.float64]

    @property
    def seconds(self) -> float:
        """From the first period of motion to the end of the plan."""
        return float(np.argmax(self.done)) * SERVO_PERIOD


def can_build() -> bool:
    """Whether components can be compiled and loaded here."""
    return is_installed() and shutil.which("halcompile") is not None and os.access(MODULES, os.W_OK)


@contextmanager
def component() -> Iterator[None]:
    """Build feedplan_rt and put it where LinuxCNC loads modules from, for the time being; one process at a time."""
    module = MODULES / _MODULE
    with alone(f"{_MODULE}.lock"):
        before = module.read_bytes() if module.exists() else None
        module.write_bytes(_built())
        try:
            yield
        finally:
            if before is None:
                module.unlink(missing_ok=True)
            else:
                module.write_bytes(before)


def _built() -> bytes:
    """The module, compiled in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="feedplan-rt-") as name:
        folder = Path(name)
        (folder / "interp").symlink_to(ROOT / "interp")
        run = subprocess.run(
            ["halcompile", "--compile", "interp/linuxcnc/feedplan_rt.comp"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PATH": "/usr/bin:/bin:/usr/sbin:/sbin"},
        )
        built = folder / _MODULE
        if run.returncode or not built.is_file():
            raise RuntimeError(f"halcompile failed:\n{run.stdout[-3000:]}{run.stderr[-3000:]}")
        return built.read_bytes()


def configuration(plan: Path, dim: int, period: float = SERVO_PERIOD) -> str:
    """The HAL file of a machine without a screen: a thread, the component, and the sampler."""
    lines = [
        f"loadrt threads name1=servo-thread period1={round(period * 1e9)}",
        f"loadrt feedplan_rt plan={plan}",
        f"loadrt scale count={dim}",
        f"loadrt sampler depth=20000 cfg={'f' * dim}fbbbffss",
        "addf feedplan-rt servo-thread",
        *(f"addf scale.{j} servo-thread" for j in range(dim)),
        "addf sampler.0 servo-thread",
    ]
    for j in range(dim):
        lines += [
            f"setp scale.{j}.gain {_FINE:g}",
            f"net position-{j} feedplan-rt.position-{j} => scale.{j}.in",
            f"net sampled-{j} scale.{j}.out => sampler.0.pin.{j}",
        ]
    signals = (("override", "<="), ("hold", "<="), ("run", "<="), ("done", "=>"), ("rate", "=>"), ("feed", "=>"))
    for i, (name, _) in enumerate(signals):
        lines.append(f"net {name} feedplan-rt.{name} sampler.0.pin.{dim + i}")
    lines.append(f"net line feedplan-rt.line sampler.0.pin.{dim + 6}")
    lines.append(f"net clocks feedplan-rt.time sampler.0.pin.{dim + 7}")
    return "\n".join([*lines, "sets override 1", "sets hold 0", "sets run 0", "start", ""])


def run_plan(content: bytes, dim: int, knobs: Sequence[tuple[float, str]] = (), seconds: float = 120.0) -> Trace:
    """Run a plan to its end in a thread of HAL; knobs are commands to halcmd, each with the time to wait before it, s."""
    with tempfile.TemporaryDirectory(prefix="feedplan-rt-") as name, the_only_linuxcnc():
        folder = Path(name)
        folder.chmod(0o777)
        (folder / "part.fpr").write_bytes(content)
        (folder / "rt.hal").write_text(configuration(folder / "part.fpr", dim))
        environment = realtime_environment(folder)
        out, log = folder / "samples.txt", folder / "log.txt"
        with open(log, "w") as file:
            hal = subprocess.Popen(
                ["halrun", "-I", "-f", str(folder / "rt.hal")],
                cwd=folder, env=environment, stdin=subprocess.PIPE, stdout=file, stderr=subprocess.STDOUT, text=True,
            )  # fmt: skip
            try:
                _operate(hal, out, environment, knobs, seconds)
            except RuntimeError as problem:
                raise RuntimeError(f"{problem}:\n{log.read_text(errors='replace')[-2000:]}") from None
            finally:
                if hal.poll() is None:
                    hal.communicate("exit\n", timeout=20)
                subprocess.run(
                    ["halrun", "-U"], env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False
                )
        return _trace(out, dim, log.read_text(errors="replace"))


def _operate(
    hal: subprocess.Popen[str],
    out: Path,
    environment: dict[str, str],
    knobs: Sequence[tuple[float, str]],
    seconds: float,
) -> None:
    """Start the sampler, run the plan, turn the knobs, and wait for its end."""

    def say(command: str) -> None:
        assert hal.stdin is not None
        hal.stdin.write(command + "\n")
        hal.stdin.flush()

    def done() -> bool:
        said = subprocess.run(
            ["halcmd", "getp", "feedplan-rt.done"], env=environment, capture_output=True, text=True, check=False
        )
        return said.stdout.strip() == "TRUE"

    end = time.monotonic() + seconds
    # The last signal of the HAL file: all that it names is loaded then.
    while subprocess.run(["halcmd", "gets", "clocks"], env=environment, capture_output=True, check=False).returncode:
        if time.monotonic() > end or hal.poll() is not None:
            raise RuntimeError("HAL did not come up")
        time.sleep(0.05)
    with open(out, "w") as file:
        sampler = subprocess.Popen(["halsampler", "-t"], env=environment, stdout=file)
        try:
            time.sleep(0.2)
            say("sets run 1")
            for wait, command in knobs:
                time.sleep(wait)
                say(command)
            # Said again until it is done: a last command that did not arrive would leave the plan held for ever.
            last = ["sets run 1", *(command for _, command in knobs[-2:])]
            while not done():
                if time.monotonic() > end:
                    raise RuntimeError("the plan did not come to its end")
                time.sleep(0.5)
                for command in last:
                    say(command)
            time.sleep(0.3)
        finally:
            sampler.terminate()
            sampler.wait(5)


def _trace(path: Path, dim: int, log: str) -> Trace:
    rows = np.array(
        [line.split() for line in path.read_text().splitlines() if line.count(" ") >= dim + _SIGNALS], dtype=np.float64
    )
    if rows.size == 0 or (np.diff(rows[:, 0]) != 1.0).any():
        raise RuntimeError(f"the sampler lost samples:\n{log[-2000:]}")
    first = int(np.argmax(rows[:, dim + 3] != 0.0))
    if first == 0:
        raise RuntimeError(f"the plan did not begin:\n{log[-2000:]}")
    rows = rows[first - 1 :, 1:]
    override, hold, run, done, rate, feed, _, clocks = rows[:, dim:].T
    return Trace(rows[:, :dim] / _FINE, override, hold != 0, run != 0, done != 0, rate, feed, clocks)


def off_step(trace: Trace, content: bytes) -> float:
    """Largest distance on an axis from what ``interp.step`` makes of the recorded signals, mm."""
    step = PlanStep(content, SERVO_PERIOD)
    start = step.position.copy()
    positions, _ = step.run(len(trace.override) - 1, trace.override[1:], trace.hold[1:] | ~trace.run[1:])
    expected = np.concatenate([start[None], positions])
    beyond = np.abs(trace.position[len(expected) :] - expected[-1])
    return float(max(np.abs(trace.position[: len(expected)] - expected).max(), beyond.max(initial=0.0)))


def ratios(trace: Trace, limits: Limits) -> dict[str, float]:
    """Largest velocity, acceleration and jerk of an axis as shares of their limits, by differences of the samples."""
    held = np.concatenate(
        [np.repeat(trace.position[:1], 3, axis=0), trace.position, np.repeat(trace.position[-1:], 3, axis=0)]
    )
    found = {}
    for order, name in ((1, "velocity"), (2, "acceleration"), (3, "jerk")):
        worst = np.abs(np.diff(held, order, axis=0)).max(axis=0) / SERVO_PERIOD**order
        found[name] = float((worst / getattr(limits, name)).max())
    found["feed"] = float(trace.feed.max() / limits.feed)
    return found


def random_knobs(seconds: float, seed: int = _SEED) -> list[tuple[float, str]]:
    """Commands at random times that change the override, and hold and let go; at the end all is let go."""
    rng = np.random.default_rng(seed)
    knobs, held = [], False
    for wait in rng.exponential(seconds / _KNOBS, _KNOBS):
        if rng.random() < 0.35:
            held = not held
            knobs.append((float(wait), f"sets hold {int(held)}"))
        else:
            knobs.append((float(wait), f"sets override {rng.choice([0.0, 0.1, 0.5, 0.9, 1.0, rng.random()]):.3f}"))
    return [*knobs, (0.3, "sets hold 0"), (0.0, "sets override 1")]


def clock_rate() -> float:
    """Clocks of the processor's counter a second, as HAL counts them."""
    source = "#include <stdio.h>\n#include <time.h>\n#include <x86intrin.h>\nint main(void) {\n" + (
        "struct timespec a, b, w = {0, 200000000}; clock_gettime(CLOCK_MONOTONIC, &a);\n"
        "unsigned long long x = __rdtsc(); nanosleep(&w, 0); clock_gettime(CLOCK_MONOTONIC, &b);\n"
        "unsigned long long y = __rdtsc();\n"
        'printf("%.0f", (double)(y - x) / ((double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec)));}\n'
    )
    with tempfile.TemporaryDirectory() as name:
        binary = Path(name, "clocks")
        subprocess.run(["gcc", "-x", "c", "-", "-o", str(binary)], input=source, text=True, check=True)
        return float(subprocess.run([str(binary)], capture_output=True, text=True, check=True).stdout)


def plan_of(source: str, limits: Limits = LIMITS) -> tuple[bytes, float, int, Limits]:
    """A plan with a reserve as a file, its duration, its number of axes, and the machine's limits on these."""
    program = is_program(source)
    own = limits.without_chord_error() if program else limits
    job = load_job(
        source, own.with_reserve(RESERVE),
        tolerance=TOLERANCE if program else None, share=PATH_SHARE if program else 1.0,
    )  # fmt: skip
    profile = job.plan()
    profile = replace(profile, origin=replace(profile.origin, override_reserve=RESERVE))
    machine = own.for_curve(job.curve)
    return plan_bytes(profile, machine), profile.duration, job.curve.dim, machine


def polyline(folder: Path, name: str = "butterfly-nurbs", blocks: int = 5000) -> Path:
    """A curve as the program that a CAM system writes of it: chords, within 1 um of it."""
    curve = load_curve(name)
    points = curve.derivatives(np.linspace(*curve.domain, blocks + 1), 0)[0]
    path = folder / f"{name}.ngc"
    head = ["G21 G90 G17 G61", f"G0 X{points[0, 0]:.6f} Y{points[0, 1]:.6f}", "G64 P0.001", "F6000"]
    path.write_text("\n".join([*head, *(f"G1 X{x:.6f} Y{y:.6f}" for x, y in points[1:]), "M2"]) + "\n")
    return path


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.linuxcnc rt",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--trace", type=Path, help="where the trace with moved knobs is kept")
    options = parser.parse_args(arguments)
    if not can_build():
        print(
            "skipped: LinuxCNC and its compiler of components are needed (Debian: apt-get install --no-install-recommends "
            f"linuxcnc-uspace linuxcnc-uspace-dev), and leave to write to {MODULES}"
        )
        return 3
    with component():
        found = measure(options.trace)
    if options.output:
        machine = {"platform": platform.platform(), "load": os.getloadavg()[0]}
        options.output.write_text(json.dumps({"machine": machine, **found}, indent=1) + "\n")
    return 1 if found["missed"] else 0


def measure(kept: Path | None) -> dict[str, object]:
    """Run everything, print it, and return it."""
    content, duration, dim, limits = plan_of("butterfly-nurbs")
    rate = clock_rate()
    still, moved = run_plan(content, dim), run_plan(content, dim, random_knobs(2.0 * duration))
    if kept:
        np.savez(kept, **vars(moved))
    rows = {}
    for name, trace in (("override 1", still), ("moved", moved)):
        ratio = ratios(trace, limits)
        ns = 1e9 * trace.clocks[1 : max(int(np.argmax(trace.done)), 2)] / rate
        rows[name] = {
            "seconds": trace.seconds, "periods": len(trace.position), "off_mm": off_step(trace, content), **ratio,
            "ns_median": float(np.median(ns)), "ns_99": float(np.quantile(ns, 0.99)),
        }  # fmt: skip
        print(name, *(f"{key} {value:.6g}" for key, value in rows[name].items()), sep="  ", flush=True)
    programs = {}
    with tempfile.TemporaryDirectory() as name:
        files = [polyline(Path(name)), PROGRAMS / "slots.ngc", PROGRAMS / "zigzag.ngc"]
        for file, source in zip(files, ("butterfly-nurbs", *map(str, files[1:])), strict=True):
            programs[file.stem] = compared(file, source, rate)
    worst = [
        max(row[name] for name in ("velocity", "acceleration", "jerk")) for row in (*rows.values(), *programs.values())
    ]
    missed = [
        *(share > 1.0 for share in worst),
        *(row["off_mm"] > ALLOWED for row in (*rows.values(), *programs.values())),
    ]
    return {"butterfly": rows, "programs": programs, "missed": any(missed)}


def compared(file: Path, source: str, rate: float) -> dict[str, float]:
    """A program by LinuxCNC's planner, and the plan of it on the same machine."""
    run = run_program(file, LIMITS.velocity.tolist(), LIMITS.acceleration.tolist())
    content, duration, dim, limits = plan_of(source)
    trace = run_plan(content, dim)
    own = 1e9 * run.planner_clocks / rate
    ns = 1e9 * trace.clocks[1 : max(int(np.argmax(trace.done)), 2)] / rate
    row = {
        "linuxcnc_s": run.cut_time, "linuxcnc_whole_s": run.whole_time, "plan_s": duration, "ran_s": trace.seconds,
        "off_mm": off_step(trace, content), **ratios(trace, limits),
        "linuxcnc_ns_median": float(np.median(own)), "linuxcnc_ns_99": float(np.quantile(own, 0.99)),
        "ns_median": float(np.median(ns)), "ns_99": float(np.quantile(ns, 0.99)),
    }  # fmt: skip
    print(file.stem, *(f"{key} {value:.6g}" for key, value in row.items()), sep="  ", flush=True)
    return row
