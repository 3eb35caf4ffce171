"""Twelve part programs that the models are measured on: four files, and eight that are made here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

FILES = Path(__file__).resolve().parents[2] / "tests" / "data" / "programs"
_HEAD = "G21 G17 G90 G94\nG64 P0.01\n"


def pocket() -> str:
    """Rounded squares from outside in, a step aside between them."""
    lines = [_HEAD + "G0 X0 Y-30 Z5", "G1 Z-2 F300", "F2400"]
    for half in np.arange(30.0, 5.0, -4.0):
        r = 0.3 * half
        flat = half - r
        lines += [f"G1 X0 Y{-half:.4f}", f"G1 X{flat:.4f} Y{-half:.4f}"]
        for x, y, i, j, side in (
            (half, -flat, 0, r, f"G1 X{half:.4f} Y{flat:.4f}"),
            (flat, half, -r, 0, f"G1 X{-flat:.4f} Y{half:.4f}"),
            (-half, flat, 0, -r, f"G1 X{-half:.4f} Y{-flat:.4f}"),
            (-flat, -half, r, 0, f"G1 X0 Y{-half:.4f}"),
        ):
            lines += [f"G3 X{x:.4f} Y{y:.4f} I{i:.4f} J{j:.4f}", side]
    return "\n".join([*lines, "G0 Z5", "M2", ""])


def drilling() -> str:
    """A grid of holes with a dwell in each."""
    lines = [_HEAD + "G0 X0 Y0 Z5"]
    for k in range(16):
        x, y = 12.0 * (k % 4), 9.0 * (k // 4)
        lines += [f"G0 X{x:g} Y{y:g}", "G0 Z1", "G1 Z-6 F240", "G4 P0.25", "G0 Z5"]
    return "\n".join([*lines, "M2", ""])


def surface() -> str:
    """3-D surfacing: rows of 0.3 mm blocks over hills, there and back."""
    lines = [_HEAD + "G0 X0 Y0 Z6", "F3000"]
    x = np.arange(0.0, 40.0 + 1e-9, 0.3)
    for row in range(6):
        y = 0.8 * row
        z = 3.0 + 2.0 * np.sin(0.35 * x + 0.2 * row) * np.cos(0.25 * y)
        order = range(x.size) if row % 2 == 0 else range(x.size - 1, -1, -1)
        lines += [f"G1 X{x[k]:.3f} Y{y:.3f} Z{z[k]:.3f}" for k in order]
    return "\n".join([*lines, "G0 Z6", "M2", ""])


def raster() -> str:
    """Reversals: a laser's rows, with the step aside at rapid."""
    lines = [_HEAD + "G0 X0 Y0", "F4800"]
    for row in range(30):
        lines += [f"G1 X{50 if row % 2 == 0 else 0}", f"G0 Y{0.2 * (row + 1):.1f}"]
    return "\n".join([*lines, "M2", ""])


def bore() -> str:
    """Two bores by helices, and a thread of three turns."""
    lines = [_HEAD + "G0 X8 Y0 Z1", "F1500"]
    lines += [f"G3 X8 Y0 Z{-0.5 * k:.1f} I-8 J0" for k in range(1, 9)]
    lines += ["G3 X8 Y0 I-8 J0", "G0 Z2", "G0 X33 Y0", "G1 Z0"]
    lines += [f"G2 X33 Y0 Z{-1.5 * k:.1f} I-3 J0" for k in range(1, 4)]
    return "\n".join([*lines, "G0 Z5", "M2", ""])


def spiral() -> str:
    """An Archimedean spiral in chords of about 0.4 mm."""
    turn = 2.0 * math.pi * np.sqrt(np.linspace(0.0, 36.0, 2600))
    lines = [_HEAD + "G0 X0 Y0", "F3600"]
    lines += [f"G1 X{0.4 * t * math.cos(t):.4f} Y{0.4 * t * math.sin(t):.4f}" for t in turn[1:]]
    return "\n".join([*lines, "M2", ""])


def star() -> str:
    """Sharp points, one feed word a line."""
    lines = [_HEAD + "G0 X20 Y0"]
    for k in range(1, 48):
        r, t = (20.0 if k % 2 == 0 else 9.0), 2.0 * math.pi * k / 46.0
        lines.append(f"G1 X{r * math.cos(t):.4f} Y{r * math.sin(t):.4f} F{1200 + 400 * (k % 6)}")
    return "\n".join([*lines, "M2", ""])


def planes() -> str:
    """Arcs in all planes, steep lines, and rapids with a feed of their own."""
    lines = [_HEAD + "G0 X0 Y0 Z10 F2400"]
    for k in range(6):
        x, y = 20.0 * k, 5.0 * (k % 3)
        lines += [
            f"G0 X{x:g} Y{y:g} F{1800 + 600 * (k % 3)}",
            f"G1 X{x:g} Y{y:g} Z2 F600",
            f"G18 G2 X{x + 10:g} Z2 I5 K0 F1800",
            f"G19 G3 Y{y + 8:g} Z2 J4 K0",
            f"G17 G2 X{x + 4:g} Y{y + 8:g} I-3 J0",
            f"G1 X{x + 14:g} Y{y + 3:g} Z10 F3000",
        ]
    return "\n".join([*lines, "M2", ""])


MADE: Mapping[str, Callable[[], str]] = {
    f"{make.__name__}.ngc": make for make in (pocket, drilling, surface, raster, bore, spiral, star, planes)
}
"""Those that are made, by the names of their files."""


def write_programs(folder: Path) -> list[Path]:
    """Write those that are made into a folder; the paths of all twelve."""
    paths = [FILES / f"{name}.ngc" for name in ("butterfly_5000", "slots", "stops", "zigzag")]
    for name, make in MADE.items():
        path = folder / name
        path.write_text(make(), encoding="utf-8")
        paths.append(path)
    return paths
