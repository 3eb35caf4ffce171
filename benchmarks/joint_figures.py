"""The pictures of docs/joint.md.

    python -m benchmarks.joint_figures [--output docs]

Path and feed found as one problem, beside a path that is made first and its feed after it.  Everything drawn is planned; the
machine is that of ``benchmarks.programs``.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.programs import FOLDER, LIMITS
from feedplan.job import Job, load_job
from feedplan.slow_corner import SlowCorner, slowest_corner
from feedplan.tolerances import ToleranceTime, time_of_tolerances
from planner.geometry.tolerance import PathKind
from planner.output.corner_view import distance_from, plot_corner
from planner.output.figures import save_plot
from planner.output.panels import Line, Panel, plot_panels
from planner.profile import FeedrateProfile

_LEG = 20.0  # mm
_SWEEP = (1e-3, 2e-3, 3e-3, 5e-3, 7e-3, 1e-2, 1.5e-2, 2e-2, 3e-2, 4e-2, 5e-2)  # mm
_TOLERANCES = (1e-3, 1e-2, 5e-2)  # mm, of one corner
_AROUND = 3.2  # of the corner drawn for each tolerance, in units of (e / J)^(1/3)
_MICRO, _MILLI = 1e3, 1e3
_TOGETHER, _APART = "both together", "path first, then feed"


def lines_through(points: Sequence[Sequence[float]], tolerance: float) -> str:
    """A part program of lines."""
    (x, y), *rest = points
    moves = "\n".join(f"X{a:.6f} Y{b:.6f}" for a, b in rest)
    return f"G21 G90 G64 P{tolerance:g}\nF6000\nG0 X{x:g} Y{y:g}\nG1 {moves}\nM2\n"


def turning(degrees: float, tolerance: float) -> str:
    """Two lines of 20 mm."""
    angle = np.deg2rad(degrees)
    end = (_LEG * (1.0 + np.cos(angle)), _LEG * np.sin(angle))
    return lines_through([(0.0, 0.0), (_LEG, 0.0), end], tolerance)


def planned(program: str, path: PathKind) -> tuple[Job, FeedrateProfile]:
    """Plan a program that is given as text."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "part.ngc"
        file.write_text(program)
        job = load_job(file, LIMITS, path=path)
    return job, job.plan()


def corner_of(program: str) -> SlowCorner:
    """The corner of a program that costs most time, its path found with the feed and before it."""
    job, profile = planned(program, "joint")
    other, before = planned(program, "separate")
    names = f"{_TOGETHER}: {profile.duration:.4f} s", f"{_APART}: {before.duration:.4f} s"
    found = slowest_corner(job, profile, {names[1]: (other, before)})
    if found is None:
        raise LookupError("the program has no corner")
    first, *rest = found.corner.passes
    return replace(found, corner=replace(found.corner, passes=(replace(first, label=names[0]), *rest)))


def corner_figure() -> Figure:
    """A right angle within 10 um."""
    return plot_corner(corner_of(turning(90.0, 1e-2)).corner, "A right angle between lines of 20 mm")


def reversal_figure() -> Figure:
    """A turn of 170 degrees within 10 um: where the path is made first the machine stops in it."""
    return plot_corner(corner_of(turning(170.0, 1e-2)).corner, "A turn of 170° between lines of 20 mm")


def time_figure() -> Figure:
    """Time of the zigzag against its tolerance, and what is saved by finding path and feed together."""
    kinds: tuple[PathKind, ...] = ("joint", "separate")
    found: dict[str, tuple[ToleranceTime, ...]] = {
        kind: time_of_tolerances(FOLDER / "zigzag.ngc", LIMITS, _SWEEP, path=kind) for kind in kinds
    }
    times = {kind: np.array([row.seconds for row in rows]) for kind, rows in found.items()}
    um = _MICRO * np.array(_SWEEP)
    saved = 100.0 * (1.0 - times["joint"] / times["separate"])
    return plot_panels(
        "The zigzag with its 38 right angles",
        [
            Panel("", "tolerance, µm", "time, s", [Line(_TOGETHER, um, times["joint"]), Line(_APART, um, times["separate"])],
                  legend="above", zero=False),
            Panel("saved by finding both together", "tolerance, µm", "% of the time", [Line("saved", um, saved)]),
        ],
    )  # fmt: skip


def swing_figure() -> Figure:
    """How far the path swings off the program around a right angle, in um and ms, and in their scales."""
    plain, scaled = [], []
    for tolerance in _TOLERANCES:
        corner = corner_of(turning(90.0, tolerance)).corner
        motion = corner.passes[0]
        off = distance_from(corner, motion.position)
        t = motion.t - motion.t[np.argmin(np.linalg.norm(motion.position - corner.vertex, axis=1))]
        unit = np.cbrt(tolerance / LIMITS.jerk[0])
        near = np.abs(t) < _AROUND * unit * 2.0
        label = f"{_MICRO * tolerance:g} µm"
        plain.append(Line(label, _MILLI * t[near], _MICRO * off[near]))
        scaled.append(Line(label, t[near] / unit, off[near] / tolerance))
    return plot_panels(
        "How far the path swings off the program at a right angle; inside is positive",
        [
            Panel("tolerance", "time from the vertex, ms", "off the program, µm", plain, legend="above"),
            Panel("in the scales of tolerance e and jerk J", "time from the vertex, (e/J)^(1/3)", "off the program, e",
                  scaled, bounds=(-1.0, 1.0), legend="none"),
        ],
    )  # fmt: skip


FIGURES = {"corner": corner_figure, "time": time_figure, "swing": swing_figure, "reversal": reversal_figure}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("docs"), help="folder of the pictures")
    folder = parser.parse_args().output
    for name, draw in FIGURES.items():
        save_plot(folder / f"joint-{name}.png", draw())


if __name__ == "__main__":
    main()
