"""The pictures of docs/programs.md.

    python -m benchmarks.program_figures [--output docs]

Tolerance, corner and speed on the zigzag; the tube against a kernel on the slots.  Everything drawn is planned, on paths
that are made before their feed; those found with it are in ``benchmarks.joint_figures``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.programs import FOLDER, LIMITS, TOLERANCES
from feedplan.job import Job
from planner import Curve, FeedrateProfile, read_program
from planner.geometry.nurbs import NurbsCurve
from planner.output.figures import save_plot
from planner.output.panels import Line, Panel, plot_panels
from planner.programs.path.deviation import deviation
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.smooth_path import ProgramPath, program_path
from planner.programs.reading.program import Program
from planner.programs.times import times_at
from planner.types import FloatArray

_AROUND_UM = 60.0  # of the corner drawn
_AROUND_MM = 0.5  # of the feed drawn
_VERTEX = 3  # of the zigzag: between two of its long lines and the short one
_SWEEP = (0.001, 0.002, 0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03, 0.04, 0.05)  # mm
_DEGREE = 4
_SLOT = 2  # junction of the slots drawn: from a line into a half circle
_MICRO = 1e3
_HALVINGS = 18


def job(curve: Curve) -> Job:
    return Job(curve, LIMITS.for_curve(curve))


def along(profile: FeedrateProfile, u: FloatArray) -> FloatArray:
    """Feed of a plan at curve parameters."""
    return profile.at(np.clip(times_at(profile, u), 0.0, profile.duration)).feed


def stopping(program: Program) -> Program:
    """The same program with an exact stop after every move, as under G61."""
    return replace(program, stop_after=np.ones(len(program), dtype=bool))


def label(tolerance: float) -> str:
    return f"{_MICRO * tolerance:g} µm"


def corner_figure() -> Figure:
    """A right angle at three tolerances: its shape, the feed over it, and the time of all 38 of them."""
    program = read_program(FOLDER / "zigzag.ngc")
    vertex = program.end[_VERTEX - 1, :2]
    shapes, feeds = [], []
    for tolerance in TOLERANCES:
        path = program_path(program, tolerance, LIMITS, path="separate")
        profile = job(path.curve).plan()
        u = path.u[_VERTEX] + np.linspace(-_AROUND_MM, _AROUND_MM, 4001)
        feeds.append(Line(label(tolerance), u - path.u[_VERTEX], along(profile, u)))
        near = path.u[_VERTEX] + np.linspace(-0.3, 0.3, 6001)
        x, y = _MICRO * (path.curve.derivatives(near, 0)[0] - vertex).T
        seen = (np.abs(x) < _AROUND_UM) & (np.abs(y) < _AROUND_UM)
        shapes.append(Line(label(tolerance), x[seen], y[seen]))
    still = program_path(stopping(program), None, LIMITS, path="separate")
    rest = job(still.curve).plan()
    u = still.u[_VERTEX] + np.linspace(-_AROUND_MM, _AROUND_MM, 4001)
    feeds.append(Line("exact stop", u - still.u[_VERTEX], along(rest, u)))
    corner = program.start[_VERTEX - 1, :2], vertex, program.end[_VERTEX, :2]
    sides = [_MICRO * (p - vertex) for p in corner]
    sides = [side * min(1.0, _AROUND_UM / max(float(np.abs(side).max()), 1e-9)) for side in sides]
    shapes.append(Line("program", *np.array(sides).T))
    return plot_panels(
        "A right angle of the zigzag at three tolerances",
        [
            Panel("the corner", "X from the vertex, µm", "Y from the vertex, µm", shapes, equal=True, legend="none"),
            Panel("feed over it", "path from the vertex, mm", "feed, mm/s", feeds),
        ],
    )


def time_figure() -> Figure:
    """Time of the zigzag against its tolerance, beside a closed formula and an exact stop in every corner."""
    program = read_program(FOLDER / "zigzag.ngc")
    rest = job(program_path(stopping(program), None, LIMITS, path="separate").curve).plan().duration
    tolerances = np.array(_SWEEP)
    times, without = [], []
    for tolerance in tolerances:
        path = program_path(program, float(tolerance), LIMITS, path="separate")
        times.append(job(path.curve).plan().duration)
        without.append(job(path.curve).without_jerk().plan().duration)
    corners = len(program) - 1
    fine = np.concatenate([[0.0], np.geomspace(1e-5, tolerances[-1], 200)])
    # A corner of size A is two overlapping moves of constant jerk: while jerk binds it saves 2 (6 A / J)^(1/3).
    saved = 2.0 * np.cbrt(6.0 * fine / np.sqrt(2.0) / LIMITS.jerk[0])
    return plot_panels(
        "Time of the zigzag with its 38 right angles",
        [
            Panel(
                f"saved against {rest:.2f} s with exact stops",
                "tolerance, µm",
                "s",
                [
                    Line("plan", _MICRO * np.append(0.0, tolerances), rest - np.append(rest, times)),
                    Line("38 · 2 (6 A/J)^(1/3)", _MICRO * fine, corners * saved),
                ],
            ),
            Panel(
                "what the jerk limit costs",
                "tolerance, µm",
                "% of the time without",
                [Line("costs", _MICRO * tolerances, 100.0 * (np.array(times) / np.array(without) - 1.0))],
            ),
        ],
    )


def kernel_spline(program: Program, tolerance: float) -> NurbsCurve:
    """Smooth a program by a kernel: the widest uniform quartic B-spline with its control points on the program.

    The spline is the program averaged with a B-spline as weight, so it cuts inside every bend by the curvature times the
    kernel's variance over 2, all of it to one side.
    """
    blocks = MovingBlocks.of(program, tolerance)
    edges = blocks.programmed.edges
    exact = program_path(stopping(program), None, LIMITS, path="separate")  # the program itself, over its abscissa

    def spline(spacing: float) -> NurbsCurve:
        spans = int(np.ceil(edges[-1] / spacing))
        inner = np.linspace(0.0, edges[-1], spans + 1)
        knots = np.concatenate([np.zeros(_DEGREE), inner, np.full(_DEGREE, edges[-1])])
        greville = np.convolve(knots[1:-1], np.full(_DEGREE, 1.0 / _DEGREE), mode="valid")
        points = exact.curve.derivatives(np.clip(greville, *exact.curve.domain), 0)[0]
        return NurbsCurve(points, knots, _DEGREE, axes=exact.curve.axes, name="kernel")

    low, high = 1e-3, 5.0
    for _ in range(_HALVINGS):
        middle = np.sqrt(low * high)
        found = deviation(spline(middle), blocks.programmed, edges, edges, 3.0 * middle + 1.0)
        low, high = (middle, high) if found.largest <= tolerance else (low, middle)
    return spline(low)


def offset(curve: Curve, program: ProgramPath, u: FloatArray, s: FloatArray) -> FloatArray:
    """Distance of a curve from the program, positive to the left, at its points nearest to the program's abscissae s."""
    at = program.curve.derivatives(s, 1)[0:2]
    normal = np.stack([-at[1, :, 1], at[1, :, 0]], axis=1)
    v = u.copy()
    for _ in range(20):  # foot of the normal on the curve
        d = curve.derivatives(np.clip(v, *curve.domain), 1)
        v -= np.sum((d[0] - at[0]) * at[1], axis=1) / np.sum(d[1] * at[1], axis=1)
    return np.sum((curve.derivatives(np.clip(v, *curve.domain), 0)[0] - at[0]) * normal, axis=1)


def tube_figure(tolerance: float = 0.01) -> Figure:
    """From a line into a half circle: tube and kernel within the same tolerance, and an exact stop."""
    program = read_program(FOLDER / "slots.ngc")
    exact = program_path(stopping(program), None, LIMITS, path="separate")
    path = program_path(program, tolerance, LIMITS, path="separate")
    kernel = kernel_spline(program, tolerance)
    at = exact.u[_SLOT - 1]
    s = at + np.linspace(-12.0, 28.0, 2001)
    inside = np.interp(s, exact.u, path.u)
    stop = job(exact.curve).plan()
    curves: Sequence[tuple[str, Curve, FloatArray, FeedrateProfile]] = (
        ("tube", path.curve, inside, job(path.curve).plan()),
        ("kernel", kernel, s, job(kernel).plan()),
    )
    times: dict[str, list[float]] = {"tube": [], "kernel": []}
    for value in TOLERANCES:
        other = program_path(program, value, LIMITS, path="separate")
        times["tube"].append(job(other.curve).plan().duration)
        spline = kernel_spline(program, value)
        times["kernel"].append(job(spline).plan().duration)
    um = _MICRO * np.array(TOLERANCES)
    away = [Line(name, s - at, _MICRO * offset(curve, exact, u, s)) for name, curve, u, _ in curves]
    bends = [Line(name, s - at, curve.curvature(u)) for name, curve, u, _ in curves]
    feeds = [Line(name, s - at, along(profile, u)) for name, _, u, profile in curves]
    feeds.append(Line("exact stops", s - at, along(stop, s)))
    return plot_panels(
        f"From a line into a half circle of 5 mm and out again, within {label(tolerance)}",
        [
            Panel(
                "off the program, left is inside", "path, mm", "µm", away, bounds=(-1e3 * tolerance, 1e3 * tolerance)
            ),
            Panel("curvature", "path, mm", "1/mm", bends),
            Panel("feed", "path, mm", "feed, mm/s", feeds, legend="above"),
            Panel(
                "time of the slots",
                "tolerance, µm",
                "time, s",
                [Line(name, um, np.array(values)) for name, values in times.items()],
            ),
        ],
    )


FIGURES = {"corner": corner_figure, "time": time_figure, "tube": tube_figure}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("docs"), help="folder of the pictures")
    folder = parser.parse_args().output
    for name, draw in FIGURES.items():
        save_plot(folder / f"programs-{name}.png", draw())


if __name__ == "__main__":
    main()
