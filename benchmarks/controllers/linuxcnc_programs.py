"""Part programs that the model of LinuxCNC is measured on beside the twelve: what its motion does at each word."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from benchmarks.controllers import programs

_UNITS = "G21 G17 G90 G94\n"


def _under(mode: str, text: str) -> str:
    """A program under another path mode."""
    return text.replace("G64 P0.01", mode)


def exact_path() -> str:
    """Rounded squares under G61: tangent joins keep their speed."""
    return _under("G61", programs.pocket())


def exact_stop() -> str:
    """A star under G61.1."""
    return _under("G61.1", programs.star())


def blended_star() -> str:
    """A star under G64 without P: as fast as it goes."""
    return _under("G64", programs.star())


def wide_star() -> str:
    """A star with a wide tolerance, and no merging."""
    return _under("G64 P0.5 Q0", programs.star())


def unmerged() -> str:
    """Short blocks that are not merged."""
    return _under("G64 P0.01 Q0", programs.surface())


def exact_spiral() -> str:
    """Short blocks under G61: kinks of a degree."""
    return _under("G61", programs.spiral())


def fast_spiral() -> str:
    """Short blocks at more than one a period, without P."""
    return _under("G64", programs.spiral()).replace("F3600", "F30000")


def words() -> str:
    """Words of spindle, coolant and outputs, dwells, messages and comments between lines."""
    between = [
        "S1000",
        "(a comment)",
        "M8",
        "G4 P0.1",
        "N10",
        "F2500",
        "(MSG, half way)",
        "M64 P0",
        "M62 P1",
        "M9",
    ]
    lines = [_UNITS + "G64 P0.02 F2400"]
    for k, word in enumerate(between):
        lines += [f"G1 X{6 * k + 3:g} Y{(k % 2) * 2:g}", word, f"X{6 * k + 6:g}"]
    return "\n".join([*lines, "M2", ""])


def arcs() -> str:
    """Arcs into lines and arcs at corners of all angles, convex and not."""
    lines = [_UNITS + "G64 P0.05\nG0 X0 Y0\nF3000"]
    for k in range(12):
        x, r = 22.0 * k, 3.0 + 0.5 * k
        way = "G2" if k % 2 else "G3"
        lines += [
            f"G1 X{x + 8:g} Y{0.8 * k:g}",
            f"{way} X{x + 8 + r:.4f} Y{0.8 * k:g} R{r:g}",
            f"G2 X{x + 20:g} Y{0.8 * k:g} R9",
        ]
        lines += [f"G1 X{x + 22:g} Y0"]
    return "\n".join([*lines, "M2", ""])


def tangents() -> str:
    """S curves of tangent arcs, whose curvature jumps."""
    lines = [_UNITS + "G64 P0.01\nG0 X0 Y0\nF4800"]
    for k in range(14):
        lines.append(f"{'G2' if k % 2 else 'G3'} X{8 * (k + 1):g} Y0 R{4 + 0.7 * k:g}")
    return "\n".join([*lines, "M2", ""])


def small_arcs() -> str:
    """Arcs of a fillet's size, some of which become chords."""
    lines = [_UNITS + "G64 P0.02\nG0 X0 Y0\nF3600"]
    for k in range(40):
        x = 3.0 * k
        size = 0.02 + 0.02 * k
        lines += [
            f"G1 X{x + 3 - size:.4f} Y0",
            f"G3 X{x + 3:.4f} Y{size:.4f} R{size:g}",
            f"G1 X{x + 3:.4f} Y2",
            "G1 Y0",
        ]
    return "\n".join([*lines, "M2", ""])


def helices() -> str:
    """Helices of several turns, up and down."""
    lines = [_UNITS + "G64 P0.01\nG0 X10 Y0 Z2\nF3000"]
    for k in range(1, 5):
        lines += [f"G2 X10 Y0 Z{-2 * k:g} I{-5 - k:g} J0 P{k}", f"G1 X{12 + k:g}", "X10"]
    return "\n".join([*lines, "M2", ""])


def cycles() -> str:
    """Canned cycles with pecks and dwells."""
    lines = [_UNITS + "G64\nG0 X0 Y0 Z10\nF600"]
    lines += ["G98 G81 X5 Y5 Z-4 R1", "X15", "X25 Y9", "G80", "G99 G83 X30 Y5 Z-9 R1 Q3", "X40", "G80"]
    lines += ["G82 X45 Y0 Z-3 R1 P0.1", "X50", "G80", "G0 Z10"]
    return "\n".join([*lines, "M2", ""])


def walk() -> str:
    """A random walk of lines of all lengths and directions, in space."""
    rng = np.random.default_rng(20)
    lines, point = [_UNITS + "G64 P0.03\nF4000"], np.zeros(3)
    for k in range(300):
        point += rng.normal(size=3) * [1.0, 1.0, 0.3] * 10.0 ** rng.uniform(-2.0, 1.0)
        feed = f" F{rng.integers(500, 6000)}" if k % 9 == 0 else ""
        lines.append("G1 X{:.4f} Y{:.4f} Z{:.4f}".format(*point) + feed)
    return "\n".join([*lines, "M2", ""])


def waves() -> str:
    """Long shallow waves in short blocks, F of a fast router."""
    x = np.linspace(0.0, 300.0, 2400)
    lines = [_UNITS + "G64 P0.005\nG0 X0 Y0\nF12000"]
    lines += [f"G1 X{a:.4f} Y{5.0 * math.sin(a / 7.0):.4f}" for a in x[1:]]
    return "\n".join([*lines, "M2", ""])


MADE: Mapping[str, Callable[[], str]] = {
    f"{make.__name__}.ngc": make
    for make in (
        exact_path, exact_stop, blended_star, wide_star, unmerged, exact_spiral, fast_spiral, words, arcs, tangents,
        small_arcs, helices, cycles, walk, waves,
    )
}  # fmt: skip
"""These programs, by the names of their files."""


def write_linuxcnc_programs(folder: Path) -> list[Path]:
    """Write the twelve and these into a folder; the paths of all."""
    paths = programs.write_programs(folder)
    for name, make in MADE.items():
        path = folder / name
        path.write_text(make(), encoding="utf-8")
        paths.append(path)
    return paths
