"""The programs of the calibration benchmark: five that are logged, twenty whose times are predicted.

All are made here from a seed, as a shop has them: contours, pockets, facing, drilling, helices, surfaces of short chords.
None has a word that waits for the outside world (S, M8, G4), so that a run measures motion alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

Lines = list[str]


def _program(mode: str, body: Lines) -> str:
    return "\n".join(["G21 G17 G90 G94 G40 G49", mode, *body, "M2", ""])


def _rapid(x: float, y: float, z: float | None = None) -> str:
    return f"G0 X{x:.4f} Y{y:.4f}" + ("" if z is None else f" Z{z:.4f}")


def slots(mode: str, feed: int, lengths: tuple[float, ...]) -> str:
    """Single moves along X, along Y, along Z and across, each there and back by other lengths."""
    body = [f"F{feed}"]
    for length in lengths:
        body += [f"G1 X{length} Y0", f"G1 X{length} Y{0.9 * length:.3f}", f"G1 Z{-0.2 * length:.3f}"]
        body += [f"G1 X{0.3 * length:.3f} Y{0.1 * length:.3f}", "G1 Z0", _rapid(0, 0)]
    return _program(mode, body)


def facing(mode: str, feed: int, width: float, height: float, step: float, along: str = "X") -> str:
    """Passes there and back over a rectangle."""
    body, y, right = ["G0 Z5", _rapid(0, 0), "G1 Z-1 F900", f"F{feed}"], 0.0, True
    while y < height:
        end, other = (width if right else 0.0), y
        first, second = (
            (f"X{end:.3f}", f"Y{other + step:.3f}") if along == "X" else (f"Y{end:.3f}", f"X{other + step:.3f}")
        )
        body += [f"G1 {first}", f"G1 {second}"]
        y, right = y + step, not right
    return _program(mode, [*body, "G0 Z5", _rapid(0, 0)])


def pockets(mode: str, feed: int, count: int, size: float, radius: float) -> str:
    """Rectangles with round corners, cut in rings from inside."""
    body: Lines = ["G0 Z3"]
    for k in range(count):
        x, y = 1.7 * size * k, 0.6 * size * (k % 2)
        body += [_rapid(x, y), "G1 Z-2 F600", f"F{feed + 300 * k}"]
        for half in np.linspace(size / 4, size / 2, 3):
            r = min(radius, 0.8 * half)
            body += [f"G1 X{x + half:.3f} Y{y:.3f}", f"G1 Y{y + half - r:.3f}"]
            body += [f"G3 X{x + half - r:.3f} Y{y + half:.3f} I{-r:.3f} J0", f"G1 X{x - half + r:.3f}"]
            body += [f"G3 X{x - half:.3f} Y{y + half - r:.3f} I0 J{-r:.3f}", f"G1 Y{y - half + r:.3f}"]
            body += [f"G3 X{x - half + r:.3f} Y{y - half:.3f} I{r:.3f} J0", f"G1 X{x + half - r:.3f}"]
            body += [f"G3 X{x + half:.3f} Y{y - half + r:.3f} I0 J{r:.3f}", f"G1 Y{y:.3f}"]
        body.append("G0 Z3")
    return _program(mode, body)


def drilling(mode: str, feed: int, rows: int, columns: int, pitch: float, depth: float) -> str:
    """A plate of holes, each in two pecks."""
    body: Lines = ["G0 Z2"]
    for i in range(rows):
        for j in range(columns):
            body += [_rapid(pitch * j, 0.8 * pitch * i), f"G1 Z{-depth / 2:.3f} F{feed}", "G0 Z1"]
            body += [f"G1 Z{-depth:.3f}", "G0 Z2"]
    return _program(mode, body)


def polygon(mode: str, feed: int, seed: int, corners: int, size: float, depth: float = 0.0) -> str:
    """A random walk of straight moves, every direction and length."""
    random = np.random.default_rng(seed)
    points = size * random.random((corners, 3)) * [1.0, 0.8, 0.0] - [0.0, 0.0, 1.0] * (
        depth * random.random((corners, 1))
    )
    body = [_rapid(*points[0]), f"F{feed}", *(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f}" for x, y, z in points[1:])]
    return _program(mode, body)


def chords(mode: str, feed: int, path: Callable[[float], tuple[float, float, float]], blocks: int) -> str:
    """A smooth curve as short blocks."""
    points = [path(k / blocks) for k in range(blocks + 1)]
    body = [_rapid(*points[0]), f"F{feed}", *(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f}" for x, y, z in points[1:])]
    return _program(mode, body)


def arcs(mode: str, feed: int, radii: tuple[float, ...], pitch: float = 0.0) -> str:
    """Full circles or helices, a straight way from one to the next."""
    body, x = [_rapid(0, 0, 0), f"F{feed}"], 0.0
    for radius in radii:
        body.append(f"G2 X{x:.3f} Y0 Z{-pitch:.3f} I{radius:.3f} J0")
        x += 2.5 * radius
        body += [f"G1 X{x:.3f} Y{radius / 2:.3f}", f"G1 X{x:.3f} Y0 Z0"]
    return _program(mode, body)


def raster(mode: str, feed: int, width: float, passes: int, step: float, height: float) -> str:
    """A wavy surface in passes of short blocks."""
    body: Lines = [_rapid(0, 0, height + 1), f"F{feed}"]
    xs = np.arange(0.0, width + step / 2, step)
    for k in range(passes):
        y = 0.8 * k
        for x in xs if k % 2 == 0 else xs[::-1]:
            body.append(f"G1 X{x:.4f} Y{y:.3f} Z{height * math.sin(0.25 * x) * math.cos(0.3 * y):.4f}")
    return _program(mode, body)


def _star(t: float) -> tuple[float, float, float]:
    angle = 2.0 * math.pi * t
    radius = 25.0 + 8.0 * math.cos(5.0 * angle)
    return radius * math.cos(angle), radius * math.sin(angle), 0.0


def _figure_eight(t: float) -> tuple[float, float, float]:
    angle = 2.0 * math.pi * t
    return 40.0 * math.sin(angle), 20.0 * math.sin(2.0 * angle), 3.0 * math.sin(angle)


def _spiral(t: float) -> tuple[float, float, float]:
    angle = 8.0 * math.pi * t
    return (3.0 + 20.0 * t) * math.cos(angle), (3.0 + 20.0 * t) * math.sin(angle), 0.0


def logged() -> Iterator[tuple[str, str]]:
    """The five programs that the controller is logged on."""
    yield "slots", slots("G61", 15000, (60.0, 25.0, 110.0))
    yield "facing", facing("G64 P0.01", 6000, 90.0, 24.0, 4.0)
    yield "pockets", pockets("G64 P0.02", 3000, 3, 30.0, 4.0)
    yield "walk", polygon("G64 P0.05", 9000, 1, 24, 80.0, 15.0)
    yield "drilling", drilling("G64", 900, 3, 4, 22.0, 8.0)


def predicted() -> Iterator[tuple[str, str]]:
    """The twenty programs whose times are predicted."""
    yield "slots-64", slots("G64 P0.1", 4000, (30.0, 12.0))
    yield "slots-61", slots("G61.1", 7000, (45.0, 8.0, 20.0))
    yield "facing-y", facing("G64 P0.05", 4500, 60.0, 30.0, 3.0, "Y")
    yield "facing-fine", facing("G61", 9000, 40.0, 12.0, 1.0)
    yield "facing-free", facing("G64", 6000, 75.0, 20.0, 5.0)
    yield "pockets-small", pockets("G64 P0.01", 1800, 4, 14.0, 2.0)
    yield "pockets-fast", pockets("G64 P0.05", 6000, 2, 60.0, 10.0)
    yield "pockets-61", pockets("G61", 2400, 3, 24.0, 5.0)
    yield "drilling-deep", drilling("G64 P0.01", 600, 2, 5, 35.0, 14.0)
    yield "drilling-61", drilling("G61", 1200, 4, 4, 10.0, 5.0)
    yield "walk-slow", polygon("G64 P0.02", 2400, 2, 30, 50.0)
    yield "walk-61", polygon("G61", 6000, 3, 25, 90.0, 10.0)
    yield "walk-exact", polygon("G61.1", 7200, 4, 20, 70.0, 20.0)
    yield "walk-short", polygon("G64 P0.1", 6000, 5, 60, 8.0, 2.0)
    yield "star", chords("G64 P0.01", 4800, _star, 400)
    yield "figure-eight", chords("G64 P0.02", 6000, _figure_eight, 240)
    yield "spiral", chords("G64 P0.005", 3000, _spiral, 300)
    yield "circles", arcs("G64 P0.01", 6000, (4.0, 9.0, 15.0, 2.5))
    yield "helices", arcs("G64 P0.02", 3600, (6.0, 10.0, 5.0), 4.0)
    yield "raster", raster("G64 P0.01", 4200, 40.0, 5, 0.5, 2.0)
