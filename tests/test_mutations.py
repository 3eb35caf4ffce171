"""Readers and damaged files: refused with a message of ours, or read for what they say; no traceback, no hang.

For tables there is a measure of what they say: every number of the plan.  A damaged one that is read must be the plan that
was written.
"""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases import drives
from motions import plan_along, scurve
from mutations import mutated

from planner import (
    CATALOG,
    FeedrateError,
    load_curve,
    load_limits,
    program_path,
    read_program,
    read_table,
    table_limits,
    write_table,
)

EVERYDAY, SLOW, CHUNK = 200, 2300, 575  # mutations of a kind; nine kinds
LONGEST = 20.0  # s, for one file
MILL = drives(dim=3)
CIRCLE = load_curve("circle")

PROGRAM = """\
%
(part) G21 G17 G90 G94
N10 T1 M6
G54 G0 X0 Y0 Z5 S8000 M3
G64 P0.01 Q0.002
G1 Z-1 F300 M8
X20 F1200
X20.5 Y0.4
X21.1 Y0.9 ; short ones
X21.9 Y1.7
X20 Y10
G3 X15 Y15 I-5 J0
G2 X10 Y20 R5
G1 X0 Y20 Z-2
G4 P0.5
G61
X0 Y10
G64 P0.02
G3 X0 Y0 I2 J-5 Z-1
G0 Z5 M9
G91 G1 X1 Y1 F600
G90
M5
M2
%
"""
PRINTER_CFG = (
    "[printer]\nkinematics: corexy\nmax_velocity: 250 # mm/s\nmax_accel = 2500\nmax_z_accel: 12\n[include *.no]\n"
)
GRBL_SETTINGS = "$11=0.010\n$110=6000.000 (x max rate)\n$111=6000.000\n$120=350.000\n$121=350.000\n$130=300.000\nok\n"
MACHINE_INI = """\
[EMC]
MACHINE = test
[TRAJ]
COORDINATES = X Y Z A
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
MAX_LINEAR_VELOCITY = 100.0
MAX_LINEAR_ACCELERATION = 800
[EMCMOT]
SERVO_PERIOD = 1000000
[KINS]
KINEMATICS = trivkins coordinates=XYZA
[AXIS_X]
MAX_VELOCITY = 250
MAX_ACCELERATION = 1000
MAX_JERK = 20000
[JOINT_0]
MAX_VELOCITY = 240
[AXIS_Y]
MAX_VELOCITY = 250
MAX_ACCELERATION = 1000
[AXIS_Z]
MAX_VELOCITY = 250 # slow
MAX_ACCELERATION = 1000
[AXIS_A]
MAX_VELOCITY = 90
MAX_ACCELERATION = 500
"""
CURVE_TOML = """\
name = "slot"
type = "nurbs"
degree = 3
control_points = [[0, 0, 0], [10.0, 0.5, 1], [12, 8, 2], [3, 9, -1e0], [0.0, 14, 0], [-3, 15, 0.25]]
knots = [0, 0, 0, 0, 0.25, 0.5, 1, 1, 1, 1]
weights = [1, 1, 2.5, 1, 0.5, 1]
axes = ["X", "Y", "Z"]
"""


class HangError(BaseException):
    """A reader that took too long."""


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise HangError(f"more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@cache
def _table(suffix: str) -> tuple[bytes, tuple[bytes, ...]]:
    import tempfile

    motion = scurve(CIRCLE.length, 100.0, 1000.0, 20000.0)
    limits = drives()
    plan = plan_along(CIRCLE, motion, limits, np.linspace(0.0, motion.duration, 12))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"t{suffix}"
        write_table(path, plan, limits)
        return path.read_bytes(), _said(path)


def _said(path: Path) -> tuple[object, ...]:
    """Every number that a table says."""
    limits, plan = table_limits(path), read_table(path, CIRCLE)
    names = ("t", "u", "u_rate", "u_acceleration", "s", "feed", "acceleration", "jerk", "binding")
    columns = [(getattr(plan, name) + 0.0).tolist() for name in names]
    rows = [getattr(limits, name).tolist() for name in ("velocity", "acceleration", "jerk")]
    words = [
        getattr(limits, n) for n in ("feed", "chord_error", "period", "tangential_acceleration", "tangential_jerk")
    ]
    facts = [getattr(plan.origin, key) for key in ("exact_stop", "periodic", "period")]
    return (columns, rows, words, facts, plan.duration, repr(plan.lower_bound), plan.limit_names)


def read_one_table(path: Path) -> None:
    assert _said(path) == _table(path.suffix)[1]


def read_curve(path: Path) -> None:
    curve = load_curve(path)
    assert curve.length > 0.0
    assert curve.breaks is not None
    assert curve.fingerprint


def read_path(path: Path) -> None:
    program_path(read_program(path), 0.01, MILL)


@cache
def _drawing() -> tuple[bytes, tuple[int, int]]:
    """A chain of all kinds, and where in the file the entities stand."""
    import io

    import ezdxf

    document = ezdxf.new("R2000")
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    space.add_line((0, 0), (10, 0))
    space.add_arc((10, 3), 3, -90, 90)
    space.add_line((10, 6), (4, 6))
    space.add_lwpolyline([(4, 6, 0, 0, 0.3), (0, 8, 0, 0, 0), (0, 12, 0, 0, 0)])
    points, knots = [(0, 12, 0), (1, 14, 0), (3, 14, 0), (4, 12, 0)], [0, 0, 0, 0, 1, 1, 1, 1]
    space.add_rational_spline(points, [1, 2, 1, 1], degree=3, knots=knots)
    space.add_ellipse((7, 12), (3, 0), 0.5, np.pi, 2 * np.pi)
    space.add_spline([(10, 12), (12, 14), (14, 12)])
    space.add_polyline2d([(14, 12, 0.2), (15, 10, 0.0), (16, 10, 0.0)], format="xyb")
    document.blocks.new("part").add_line((0, 0), (1, 1))
    space.add_blockref("part", (16, 10), dxfattribs={"xscale": 2.0, "rotation": 30.0})
    space.add_text("made by hand")
    text = io.StringIO()
    document.write(text)
    data = text.getvalue().encode()
    at = data.index(b"\nENTITIES")
    return data, (at, data.index(b"ENDSEC", at))


@dataclass(frozen=True)
class Kind:
    """A kind of file: its suffix, a sound one, and its reader."""

    suffix: str
    content: Callable[[], bytes]
    read: Callable[[Path], object]
    text: bool = True
    part: Callable[[], tuple[int, int] | None] = lambda: None


def _points() -> bytes:
    angle = np.linspace(0.0, 6.0, 40)
    rows = np.stack([20 * np.cos(angle), 15 * np.sin(angle), angle], axis=1)
    return ("X_mm,Y_mm,Z_mm\n" + "".join(",".join(f"{x:.5f}" for x in row) + "\n" for row in rows)).encode()


def _json() -> bytes:
    import planner

    return (Path(planner.__file__).parent / "data/curves/teardrop.json").read_bytes()


def _toml() -> bytes:
    import planner

    return (Path(planner.__file__).parent / "data/machines/five-axis.toml").read_bytes()


KINDS = {
    "program": Kind(".ngc", PROGRAM.encode, read_path),
    "drawing": Kind(".dxf", lambda: _drawing()[0], read_curve, part=lambda: _drawing()[1]),
    "points": Kind(".csv", _points, read_curve),
    "curve.json": Kind(".json", _json, read_curve),
    "curve.toml": Kind(".toml", CURVE_TOML.encode, read_curve),
    "machine.toml": Kind(".toml", _toml, load_limits),
    "machine.ini": Kind(".ini", MACHINE_INI.encode, load_limits),
    "table.csv": Kind(".csv", lambda: _table(".csv")[0], read_one_table),
    "table.npz": Kind(".npz", lambda: _table(".npz")[0], read_one_table, text=False),
    "machine.cfg": Kind(".cfg", PRINTER_CFG.encode, load_limits),
    "machine.txt": Kind(".txt", GRBL_SETTINGS.encode, load_limits),
}


def attempt(kind: Kind, data: bytes, path: Path) -> bool:
    """Whether the file is read; raises what is not one of our errors."""
    path.write_bytes(data)
    try:
        with at_most(LONGEST):
            kind.read(path)
    except FeedrateError:
        return False
    return True


def sweep(name: str, seeds: range, folder: Path) -> int:
    """Read a mutation for each seed; return how many were read."""
    kind, number = KINDS[name], list(KINDS).index(name)
    sound, read = kind.content(), 0
    for seed in seeds:
        data = mutated(sound, (number, seed), text=kind.text, part=kind.part())
        try:
            read += attempt(kind, data, folder / f"file{kind.suffix}")
        except (Exception, HangError) as error:
            error.add_note(f"{name}, seed {seed}")
            raise
    return read


@pytest.mark.parametrize("name", KINDS)
def test_the_sound_file_is_read(tmp_path, name):
    kind = KINDS[name]
    assert attempt(kind, kind.content(), tmp_path / f"file{kind.suffix}")


@pytest.mark.parametrize("name", KINDS)
def test_mutations(tmp_path, name):
    read = sweep(name, range(EVERYDAY), tmp_path)
    assert 0 < read < EVERYDAY, f"{read} of {EVERYDAY} mutations were read"


@pytest.mark.slow
@pytest.mark.parametrize("first", range(EVERYDAY, EVERYDAY + SLOW, CHUNK))
@pytest.mark.parametrize("name", KINDS)
def test_many_mutations(tmp_path, name, first):
    sweep(name, range(first, first + CHUNK), tmp_path)


def test_the_catalog_and_the_kinds_are_all_there():
    assert "teardrop" in CATALOG
    assert json.loads(_json())["curve"]
