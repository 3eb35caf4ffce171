"""Seeded problems of every kind that a lower bound has to hold for: curves, programs, limits, stops and ends."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from strategies import random_nurbs

from planner import Limits, load_limits
from planner.geometry.curve import Curve
from planner.geometry.nurbs import NurbsCurve
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.program import Program
from planner.programs.reading.reader import read_program

Rng = np.random.Generator
KINDS = ("curve", "polyline", "closed", "five axes", "tip turns back", "arcs")


@dataclass(frozen=True)
class BoundCase:
    """A curve, limits, and what a plan is asked for."""

    kind: str
    curve: Curve
    limits: Limits
    options: dict[str, Any] = field(default_factory=dict)


def bound_case(seed: int, folder: Path) -> BoundCase:
    """The case of a seed; kinds take turns."""
    rng = np.random.default_rng([31, seed])
    kind = KINDS[seed % len(KINDS)]
    if kind in {"polyline", "arcs"}:
        text = random_polyline(rng) if kind == "polyline" else random_arcs(rng)
        curve: Curve = program_path(program_of(text, folder), None, load_limits("mill"), path="separate").curve
    else:
        curve = _nurbs(kind, seed, rng)
    limits = random_limits(rng, curve)
    return BoundCase(kind, curve, limits, _options(kind, rng, limits))


def _nurbs(kind: str, seed: int, rng: Rng) -> NurbsCurve:
    if kind == "closed":
        return _closed(int(rng.integers(3, 6)), rng)
    if kind == "tip turns back":
        count = int(rng.integers(4, 7))
        tip = rng.uniform(15.0, 40.0, count) * np.resize([0.0, 1.0], count)
        points = np.column_stack([tip, np.cumsum(rng.uniform(0.1, 0.4, count))])
        return NurbsCurve(points, _clamped(count, 3), 3, axes=("X", "A"))
    curve = random_nurbs(seed, int(rng.integers(2, 6)), int(rng.integers(2, 4)), repeat=int(rng.integers(1, 3)))
    if kind == "curve":
        return curve
    count = len(curve.control_points)
    points = np.column_stack([curve.control_points, np.cumsum(rng.uniform(-0.5, 0.7, (count, 2)), axis=0)])
    return NurbsCurve(points, curve.knots, curve.degree, curve.weights, axes=(*curve.axes, "A", "C"))


def _clamped(count: int, degree: int) -> list[float]:
    return [*np.zeros(degree), *np.linspace(0.0, 1.0, count - degree + 1), *np.ones(degree)]


def _closed(degree: int, rng: Rng) -> NurbsCurve:
    """A smooth closed curve: control points around a circle, the first ones again at the end."""
    count = int(rng.integers(6, 12))
    angle = np.arange(count) * (2.0 * np.pi / count)
    ring = rng.uniform(10.0, 30.0, count)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.concatenate([ring, ring[:degree]])
    return NurbsCurve(points, np.arange(-degree, count + degree + 1) / count, degree)


def _options(kind: str, rng: Rng, limits: Limits) -> dict[str, Any]:
    if kind == "closed" and rng.random() < 0.7:
        return {"periodic": True}
    options: dict[str, Any] = {"exact_stop": True} if rng.random() < 0.2 else {}
    if rng.random() < 0.25:
        slow = 0.02 * min(limits.feed, float(limits.velocity.min()), 500.0)
        options |= {"start_feed": slow * rng.random(), "end_feed": slow * rng.random()}
        if rng.random() < 0.3 and limits.has_jerk:
            options["start_acceleration"] = 0.0
    return options


def random_limits(rng: Rng, curve: Curve) -> Limits:
    """Limits of a usual machine, some of them missing now and then: of single axes, or those of the jerk altogether."""
    rotary = np.array(curve.axis_units) == "rad"

    def row(low: float, high: float) -> np.ndarray:
        return 10.0 ** rng.uniform(low, high) * rng.uniform(0.3, 1.0, curve.dim) * np.where(rotary, 0.03, 1.0)

    velocity, acceleration, jerk = row(1.5, 3.0), row(2.0, 4.0), row(3.5, 6.0)
    if rng.random() < 0.2:
        velocity[:] = np.inf
    if rng.random() < 0.15:
        jerk[:] = np.inf
    elif rng.random() < 0.2:
        jerk[rng.integers(curve.dim)] = np.inf
    elif rng.random() < 0.1:
        acceleration[rng.integers(curve.dim)] = np.inf
    tangential = rng.random() < 0.25
    return Limits(
        10.0 ** rng.uniform(1.0, 2.7),
        velocity,
        acceleration,
        jerk,
        chord_error=1e-3 if rng.random() < 0.5 else np.inf,
        tangential_acceleration=10.0 ** rng.uniform(2.0, 4.0) if tangential else np.inf,
        tangential_jerk=10.0 ** rng.uniform(3.5, 6.0) if tangential and rng.random() < 0.7 else np.inf,
        axes=curve.axes,
        rapid=10.0 ** rng.uniform(1.5, 3.0) if rng.random() < 0.5 else np.inf,
    )


def program_of(text: str, folder: Path) -> Program:
    """Read a program given as text."""
    file = folder / "program.ngc"
    file.write_text(text)
    return read_program(file)


def random_polyline(rng: Rng) -> str:
    """Lines with F words, a rapid now and then, blended or with exact stops."""
    lines = ["G21 G90", "G61" if rng.random() < 0.15 else "G64 P0.02", "G0 X0 Y0"]
    for _ in range(int(rng.integers(3, 12))):
        x, y = rng.uniform(0.0, 30.0, 2)
        feed = f" F{rng.uniform(600.0, 9000.0):.0f}"
        lines.append(f"G0 X{x:.3f} Y{y:.3f}" if rng.random() < 0.2 else f"G1 X{x:.3f} Y{y:.3f}{feed}")
    return "\n".join([*lines, "M2", ""])


def random_arcs(rng: Rng) -> str:
    """Lines and arcs, each tangent to the one before: the curvature jumps between them."""
    lines = ["G21 G90 G64 P0.01", "G0 X0 Y0", f"F{rng.uniform(600.0, 9000.0):.0f}"]
    at, heading = np.zeros(2), rng.uniform(0.0, 2.0 * np.pi)
    for k in range(int(rng.integers(2, 6))):
        if k % 2 == 0:
            at = at + rng.uniform(5.0, 30.0) * np.array([np.cos(heading), np.sin(heading)])
            lines.append(f"G1 X{at[0]:.6f} Y{at[1]:.6f}")
            continue
        left, radius, turn = rng.random() < 0.5, rng.uniform(4.0, 25.0), rng.uniform(0.5, 2.5)
        side = 1.0 if left else -1.0
        to_centre = side * radius * np.array([-np.sin(heading), np.cos(heading)])
        heading += side * turn
        end = at + to_centre - side * radius * np.array([-np.sin(heading), np.cos(heading)])
        word = "G3" if left else "G2"
        lines.append(f"{word} X{end[0]:.6f} Y{end[1]:.6f} I{to_centre[0]:.6f} J{to_centre[1]:.6f}")
        at = end
    return "\n".join([*lines, "M2", ""])
