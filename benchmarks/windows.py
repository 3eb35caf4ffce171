"""Long part programs in windows: time, memory, and what is lost against the plan of the whole.

The program is a winding curve in segments of 0.1 mm, rounded to 1 um as a CAM system writes it: turns of every size, no
exact stop, so that every window but the last ends in the middle of the motion.  Each size runs in a process of its own,
whose peak memory counts everything, the interpreter and its libraries too.  The loss is measured where the whole can
be planned as well: the same program, once in windows and once from end to end.

With ``--cores`` two more programs are planned with one core and with two, in turn: passes over a surface in blocks of 0.1 to
0.5 mm without a stop, and passes of teeth with a stop in each, of which path and feed are one problem.  The wall time of
each pair is compared, and the files must be the same to the last bit.  On a machine that does other work meanwhile the
processor time tells more: with two processes no run can be faster than the one of them that takes most.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from planner.machine.limits import Limits

_SEGMENT = 0.1  # mm
_WAVELENGTHS = (11.0, 17.0, 29.0, 47.0, 83.0)  # mm
_TOLERANCE = 0.01  # mm
_FEED, _AXIS = 100.0, (250.0, 1000.0, 2e4)  # mm/s; velocity, acceleration and jerk of each axis
_WHOLE = 20_000  # blocks that are planned as a whole too
# What is asked for: blocks, seconds, megabytes.
_ASKED = {100_000: (60.0, 600.0), 1_000_000: (600.0, 600.0)}


def write_winding(path: Path, blocks: int, seed: int = 7) -> None:
    """Write a program of ``blocks`` segments whose direction is a sum of seeded sine waves."""
    rng = np.random.default_rng(seed)
    s = _SEGMENT * np.arange(blocks)
    heading = np.zeros(blocks)
    for wavelength in _WAVELENGTHS:
        heading += rng.uniform(0.4, 0.8) * np.sin(2.0 * np.pi * s / wavelength + rng.uniform(0.0, 2.0 * np.pi))
    x, y = np.cumsum(_SEGMENT * np.cos(heading)), np.cumsum(_SEGMENT * np.sin(heading))
    with open(path, "w", encoding="ascii") as file:
        file.write("G21 G17 G90 G94\nG0 X0.000 Y0.000\nG64 P0.01\nF6000\n")
        for first in range(0, blocks, 10_000):
            some = slice(first, first + 10_000)
            file.writelines(f"G1 X{a:.3f} Y{b:.3f}\n" for a, b in zip(x[some], y[some], strict=True))
        file.write("M2\n")


def write_surface(path: Path, blocks: int, seed: int = 3) -> None:
    """Write passes there and back over a surface of waves, 50 mm long and 0.25 mm apart, in blocks of 0.1 to 0.5 mm."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    with open(path, "w", encoding="ascii") as file:
        file.write("G21 G17 G90 G94\nG0 X0.000 Y0.000 Z20.000\nG64 P0.01\nF6000\n")
        written = 0
        for k in range(blocks):
            x, y = np.cumsum(rng.uniform(0.1, 0.5, 240)), 0.25 * k
            x = np.concatenate([[0.0], x[x < 49.9], [50.0]])
            x = x if k % 2 == 0 else 50.0 - x
            wave = 4.0 * np.sin(2.0 * np.pi * x / 37.0 + phase[0]) * np.cos(2.0 * np.pi * y / 41.0 + phase[1])
            wave += 1.5 * np.sin(2.0 * np.pi * (x + y) / 17.0 + phase[2])
            wave += 0.4 * np.sin(2.0 * np.pi * (x - 0.5 * y) / 7.0 + phase[3])
            file.writelines(f"G1 X{a:.3f} Y{y:.3f} Z{b:.3f}\n" for a, b in zip(x, wave, strict=True))
            written += x.size
            if written >= blocks:
                break
        file.write("M2\n")


def write_teeth(path: Path, blocks: int, seed: int = 5) -> None:
    """Write passes of ten teeth with a stop in the middle, and rapids between them."""
    rng = np.random.default_rng(seed)
    with open(path, "w", encoding="ascii") as file:
        file.write("G21 G17 G90 G94\nG64 P0.01\nF6000\n")
        for k in range(-(-blocks // 21)):
            x = np.cumsum(rng.uniform(3.0, 5.0, 20))
            file.write(f"G0 X0.000 Y{0.5 * k:.3f}\n")
            for tooth, a in enumerate(x):
                file.write(f"G1 X{a:.3f} Y{0.5 * k + 3.0 * (tooth % 2 == 0):.3f}\n" + "G4 P0\n" * (tooth == 9))
        file.write("M2\n")


def run_windows(program: Path, output: Path, cores: int = 1) -> dict[str, float | int | bool | str]:
    """Plan a program in windows in this process; what it took and what came out."""
    import hashlib
    import resource

    from feedplan.progress import ProgressLine
    from planner.programs.long.windows import plan_program

    began, cpu = time.perf_counter(), time.process_time()
    with ProgressLine() as line:
        plan = plan_program(program, _limits(), _TOLERANCE, output=output, progress=line, cores=cores)
    of_others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "files": hashlib.sha256(plan.table.read_bytes() + plan.lines.read_bytes()).hexdigest(),
        "others_cpu_s": of_others.ru_utime + of_others.ru_stime,
        "others_peak_mb": of_others.ru_maxrss / 1024.0,
        "blocks": plan.blocks,
        "duration_s": plan.duration,
        "windows": plan.windows,
        "resumed": plan.resumed,
        "ok": plan.ok,
        "extra_stops": plan.stops,
        "deviation_um": 1e3 * plan.deviation,
        "worst": plan.worst,
        "worst_limit": plan.worst_limit,
        "joint_feed_mm_s": plan.joint_feed,
        "joint_acceleration_mm_s2": plan.joint_acceleration,
        "wall_s": time.perf_counter() - began,
        "cpu_s": time.process_time() - cpu,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def run_whole(program: Path) -> dict[str, float | int | bool | str]:
    """Plan a program from end to end in this process."""
    import resource

    from feedplan.job import load_job

    began, cpu = time.perf_counter(), time.process_time()
    job = load_job(program, _limits(), tolerance=_TOLERANCE)
    profile = job.plan()
    report = job.check(profile)
    return {
        "duration_s": profile.duration,
        "ok": report.ok,
        "wall_s": time.perf_counter() - began,
        "cpu_s": time.process_time() - cpu,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def _limits() -> Limits:
    velocity, acceleration, jerk = _AXIS
    return Limits(_FEED, [velocity] * 3, [acceleration] * 3, [jerk] * 3)


def _in_process(how: str, program: Path, output: Path) -> dict[str, float | int | bool | str]:
    """Run in a process of its own, for its peak memory."""
    command = [sys.executable, "-m", "benchmarks.windows", "--run", how, str(program), str(output)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    result: dict[str, float | int | bool | str] = json.loads(done.stdout.splitlines()[-1])
    return result


def measure(sizes: Sequence[int], whole: int, directory: Path) -> list[str]:
    """Measure every size, and the loss at the size ``whole``; the lines of a table."""
    lines = [
        "| blocks | wall s | CPU s | peak MB | windows | duration s | worst limit | joints mm/s^2 | deviation um |"
    ]
    lines.append("|---|---|---|---|---|---|---|---|---|")
    for blocks in sizes:
        program = directory / f"winding-{blocks}.ngc"
        write_winding(program, blocks)
        r = _in_process("windows", program, directory / f"winding-{blocks}.npz")
        asked = _ASKED.get(blocks)
        verdict = "" if r["ok"] else " FAILS ITS CHECK"
        if asked is not None and (float(r["wall_s"]) > asked[0] or float(r["peak_mb"]) > asked[1]):
            verdict += f" (asked: {asked[0]:g} s, {asked[1]:g} MB)"
        lines.append(
            f"| {blocks}{verdict} | {r['wall_s']:.1f} | {r['cpu_s']:.1f} | {r['peak_mb']:.0f} | {r['windows']} | "
            f"{r['duration_s']:.5f} | {r['worst']:.7f} {r['worst_limit']} | {r['joint_acceleration_mm_s2']:.1e} | "
            f"{r['deviation_um']:.3f} |"
        )
    if whole:
        program = directory / f"winding-{whole}.ngc"
        write_winding(program, whole)
        parts = _in_process("windows", program, directory / f"winding-{whole}.npz")
        one = _in_process("whole", program, directory / f"winding-{whole}.npz")
        loss = 100.0 * (float(parts["duration_s"]) / float(one["duration_s"]) - 1.0)
        lines.append("")
        lines.append(
            f"{whole} blocks in {parts['windows']} windows {parts['duration_s']:.6f} s, as a whole "
            f"{one['duration_s']:.6f} s: {loss:+.4f} % ({parts['cpu_s']:.1f} against {one['cpu_s']:.1f} s of CPU, "
            f"{parts['peak_mb']:.0f} against {one['peak_mb']:.0f} MB)"
        )
    return lines


def compare_cores(blocks: int, rounds: int, directory: Path) -> list[str]:
    """Plan each program with one core and with two, in turn; the lines of a table."""
    lines = [
        "| program | blocks | one core: wall s | CPU ms a block | two: wall s | CPU s of the plan, of the others | "
        "ratio of wall times | peak MB: one, two | same files |"
    ]
    lines.append("|---|---|---|---|---|---|---|---|---|")
    for name, write, count in (("surface", write_surface, blocks), ("teeth", write_teeth, blocks // 8)):
        program, output = directory / f"{name}.ngc", directory / f"{name}.npz"
        write(program, count)
        pairs = [tuple(_in_process(how, program, output) for how in ("1", "2")) for _ in range(rounds)]
        one, two = pairs[0]
        walls = [float(np.median([float(pair[k]["wall_s"]) for pair in pairs])) for k in (0, 1)]
        ratio = float(np.median([float(a["wall_s"]) / float(b["wall_s"]) for a, b in pairs]))
        cpu = 1e3 * float(np.median([float(a["cpu_s"]) for a, _ in pairs])) / int(one["blocks"])
        same = len({str(run["files"]) for pair in pairs for run in pair}) == 1
        lines.append(
            f"| {name} | {one['blocks']} | {walls[0]:.1f} | {cpu:.2f} | {walls[1]:.1f} | {two['cpu_s']:.1f}, "
            f"{two['others_cpu_s']:.1f} | {ratio:.2f} | {one['peak_mb']:.0f}, {two['peak_mb']:.0f} + "
            f"{two['others_peak_mb']:.0f} | {'yes' if same and one['ok'] else 'NO'} |"
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blocks", type=int, nargs="*", default=[100_000], help="sizes to measure")
    parser.add_argument("--whole", type=int, default=_WHOLE, help="size at which the loss is measured; 0 for none")
    parser.add_argument(
        "--cores", type=int, metavar="BLOCKS", help="compare one core with two on so many blocks instead"
    )
    parser.add_argument("--rounds", type=int, default=3, help="pairs of runs to compare")
    parser.add_argument("--run", nargs=3, metavar=("HOW", "PROGRAM", "OUTPUT"), help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.run:
        how, program, output = options.run
        cores = int(how) if how.isdigit() else 1
        result = run_whole(Path(program)) if how == "whole" else run_windows(Path(program), Path(output), cores)
        print(json.dumps(result))
        return
    if options.cores:
        with tempfile.TemporaryDirectory() as directory:
            print("\n".join(compare_cores(options.cores, options.rounds, Path(directory))))
        return
    with tempfile.TemporaryDirectory() as directory:
        print("\n".join(measure(options.blocks, options.whole, Path(directory))))


if __name__ == "__main__":
    main()
