"""A simulated three-axis machine under LinuxCNC, without a screen: runs a program and measures its cycle time.

Time is counted in servo periods, one sample each, not by the clock: on a busy computer the periods come late, but their
number is that of the planner.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SERVO_PERIOD = 1e-3  # s
_FEED_MOTIONS = (2, 3)  # motion.motion-type of lines and arcs; 1 is a rapid
_LAG = 3  # joint commands trail the planner, and its motion type, by two periods and the filter's own
_LOCK = "feedplan-linuxcnc.lock"  # LinuxCNC runs once a computer


@dataclass(frozen=True, eq=False)
class Run:
    """How a program ran.

    Attributes
    ----------
    cut_time : float
        Servo periods under G1, G2 and G3, s.
    position : (n, 3) array
        Commanded positions of the cut, one a period, mm.
    trace : (m, 3) array
        The same of the whole program with its rapids, from the last at rest before it moves to the first after it.
    version : str
    queued : int
        Moves that were in the queue when the feed was let go.
    planner_clocks : (n,) array
        What its two real-time functions took in each period of the cut, clocks of the processor.
    """

    cut_time: float
    position: NDArray[np.float64]
    version: str
    queued: int
    trace: NDArray[np.float64]
    planner_clocks: NDArray[np.float64]

    @property
    def whole_time(self) -> float:
        """From the first commanded motion to the last, s."""
        return (len(self.trace) - 1) * SERVO_PERIOD

    @property
    def moving_time(self) -> float:
        """The same without the periods that stand still: dwells, and LinuxCNC's own pauses at stops."""
        return int(np.any(np.diff(self.trace, axis=0) != 0.0, axis=1).sum()) * SERVO_PERIOD


def run_program(
    program: Path,
    velocity: Sequence[float],
    acceleration: Sequence[float],
    *,
    start: Sequence[float] = (0.0, 0.0, 0.0),
    seconds: float = 300.0,
) -> Run:
    """Run a program on a machine with these axis limits, mm/s and mm/s^2, that stands at ``start``, mm.

    Raises RuntimeError with what went wrong.
    """
    with tempfile.TemporaryDirectory(prefix="linuxcnc-") as name, the_only_linuxcnc():
        folder = Path(name)
        folder.chmod(0o777)
        job = {
            "program": str(folder / "program.ngc"),
            "samples": str(folder / "samples.txt"),
            "result": str(folder / "result.json"),
            "seconds": seconds,
        }
        shutil.copy(program, job["program"])
        (folder / "job.json").write_text(json.dumps(job))
        _configure(folder, velocity, acceleration, start)
        log = _start(folder, seconds + 60.0)
        if not Path(job["result"]).is_file():
            raise RuntimeError(f"LinuxCNC did not come up:\n{log[-3000:]}")
        result = json.loads(Path(job["result"]).read_text())
        if result["error"]:
            raise RuntimeError(f"{program.name}: {result['error']}")
        rows = _samples(Path(job["samples"]))
    cuts = np.flatnonzero(np.isin(rows[:, 4], _FEED_MOTIONS))
    if cuts.size == 0:
        raise RuntimeError(f"{program.name}: nothing was cut")
    position = rows[cuts[0] + _LAG : cuts[-1] + _LAG + 1, 1:4]
    # Without a rapid before it the cut is in force while the feed is still held at 0.
    held = int(np.argmax(np.any(np.diff(position, axis=0) != 0.0, axis=1)))
    moving = np.flatnonzero(np.any(np.diff(rows[:, 1:4], axis=0) != 0.0, axis=1))
    trace = rows[moving[0] : moving[-1] + 2, 1:4]
    clocks = rows[cuts, 5] + rows[cuts, 6]
    return Run((cuts.size - held) * SERVO_PERIOD, position[held:], result["version"], result["queued"], trace, clocks)


def _samples(path: Path) -> NDArray[np.float64]:
    """Sample number, X, Y, Z, motion type, and clocks of the two real-time functions; none may be missing."""
    text = path.read_text()
    if "overrun" in text:
        raise RuntimeError("the sampler lost samples: the computer is too busy")
    rows = np.array([line.split() for line in text.splitlines() if line.count(" ") >= 6], dtype=np.float64)
    if rows.size == 0 or (np.diff(rows[:, 0]) != 1.0).any():
        raise RuntimeError("the sampler lost samples: the computer is too busy")
    return rows


@contextmanager
def alone(name: str) -> Iterator[None]:
    """Wait until no other process of this computer is within a lock of that name."""
    with open(Path(tempfile.gettempdir(), name), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def the_only_linuxcnc() -> Iterator[None]:
    """Wait until no other of our LinuxCNCs runs: there is one real-time part a computer."""
    with alone(_LOCK):
        yield


def realtime_environment(folder: Path) -> dict[str, str]:
    """Variables under which LinuxCNC's real-time part runs without a screen, its files in a folder."""
    environment = {**os.environ, "HOME": str(folder), "PATH": "/usr/bin:/bin:/usr/sbin:/sbin"}
    environment.pop("DISPLAY", None)
    if os.geteuid() == 0:  # it does not run as root
        environment |= {"RTAPI_UID": "65534", "RTAPI_FIFO_PATH": str(folder / "rtapi.fifo")}
    return environment


def _start(folder: Path, seconds: float) -> str:
    """Run LinuxCNC to its end; returns what it printed."""
    environment = realtime_environment(folder)
    log = folder / "log.txt"
    with open(log, "w") as file:
        process = subprocess.Popen(
            ["linuxcnc", str(folder / "machine.ini")],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(10)
    return log.read_text(errors="replace")


def _configure(folder: Path, velocity: Sequence[float], acceleration: Sequence[float], start: Sequence[float]) -> None:
    """Write the machine's files: INI, HAL, an empty tool table, an empty variable file and the display program."""
    speed, rate = (float(np.linalg.norm(values)) for values in (velocity, acceleration))
    sections = {
        "EMC": {"VERSION": "1.1", "MACHINE": "simulated"},
        "DISPLAY": {"DISPLAY": folder / "display", "CYCLE_TIME": 0.05, "MAX_FEED_OVERRIDE": 1.0},
        "TASK": {"TASK": "milltask", "CYCLE_TIME": SERVO_PERIOD},
        "RS274NGC": {"PARAMETER_FILE": folder / "machine.var"},
        "EMCMOT": {"EMCMOT": "motmod", "COMM_TIMEOUT": 4.0, "SERVO_PERIOD": round(SERVO_PERIOD * 1e9)},
        "EMCIO": {"EMCIO": "io", "CYCLE_TIME": 0.1, "TOOL_TABLE": folder / "machine.tbl"},
        "HAL": {"HALFILE": folder / "machine.hal"},
        "TRAJ": {
            "COORDINATES": "X Y Z",
            "LINEAR_UNITS": "mm",
            "ANGULAR_UNITS": "degree",
            "NO_FORCE_HOMING": 1,
            "DEFAULT_LINEAR_VELOCITY": speed,
            "MAX_LINEAR_VELOCITY": speed,
            "DEFAULT_LINEAR_ACCELERATION": rate,
            "MAX_LINEAR_ACCELERATION": rate,
            "ARC_BLEND_ENABLE": 1,
            "ARC_BLEND_OPTIMIZATION_DEPTH": 50,
            "ARC_BLEND_GAP_CYCLES": 4,
            "ARC_BLEND_RAMP_FREQ": 100,
        },
        "KINS": {"KINEMATICS": "trivkins", "JOINTS": 3},
    }
    for joint, axis in enumerate("XYZ"):
        limits = {
            "MAX_VELOCITY": velocity[joint],
            "MAX_ACCELERATION": acceleration[joint],
            "MIN_LIMIT": -1e6,
            "MAX_LIMIT": 1e6,
        }
        sections[f"AXIS_{axis}"] = limits
        homing: dict[str, float] = dict.fromkeys(("HOME_SEARCH_VEL", "HOME_LATCH_VEL", "HOME_SEQUENCE"), 0)
        homing |= {"HOME": start[joint], "HOME_OFFSET": start[joint]}
        sections[f"JOINT_{joint}"] = {"TYPE": "LINEAR", **limits, "FERROR": 1000, "MIN_FERROR": 1000, **homing}
    lines = [
        f"[{name}]\n" + "".join(f"{key} = {value}\n" for key, value in keys.items()) for name, keys in sections.items()
    ]
    (folder / "machine.ini").write_text("".join(lines))
    joints = "".join(
        f"net position-{j} joint.{j}.motor-pos-cmd => joint.{j}.motor-pos-fb sampler.0.pin.{j}\n" for j in range(3)
    )
    (folder / "machine.hal").write_text(
        "loadrt [KINS]KINEMATICS\n"
        "loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS\n"
        "loadrt sampler depth=60000 cfg=fffsss\n"
        "addf motion-command-handler servo-thread\n"
        "addf motion-controller servo-thread\n"
        f"{joints}"
        "addf sampler.0 servo-thread\n"
        "net motion-type motion.motion-type => sampler.0.pin.3\n"
        "net handler-clocks motion-command-handler.time => sampler.0.pin.4\n"
        "net controller-clocks motion-controller.time => sampler.0.pin.5\n"
        "net recording sampler.0.enable\n"
        "sets recording 0\n"
        "net estop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in\n"
        "net prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared\n"
        "net change iocontrol.0.tool-change => iocontrol.0.tool-changed\n"
    )
    for name in ("machine.tbl", "machine.var"):
        (folder / name).touch()
    # A copy: LinuxCNC's own user may not be allowed to read where this module stands.
    shutil.copy(Path(__file__).with_name("display.py"), folder / "display.py")
    display = folder / "display"
    display.write_text(f"#!/bin/sh\nexec /usr/bin/python3 {folder}/display.py {folder}/job.json\n")
    display.chmod(0o755)


def largest_distance(points: NDArray[np.float64], vertices: NDArray[np.float64], window: int = 40) -> float:
    """Largest distance of points that follow a polyline from it, mm; the nearest segment moves on with them."""
    a, chord = vertices[:-1], np.diff(vertices, axis=0)
    keep = np.sum(chord**2, axis=1) > 0.0
    a, chord = a[keep], chord[keep]
    squares = np.sum(chord**2, axis=1)
    at, worst = 0, 0.0
    for point in points:
        rows = slice(max(at - 5, 0), at + window)
        w = np.clip(np.sum((point - a[rows]) * chord[rows], axis=1) / squares[rows], 0.0, 1.0)
        away = np.sum((point - a[rows] - w[:, None] * chord[rows]) ** 2, axis=1)
        nearest = int(np.argmin(away))
        at, worst = rows.start + nearest, max(worst, float(away[nearest]))
    return float(np.sqrt(worst))
