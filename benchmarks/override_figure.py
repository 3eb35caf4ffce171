"""The picture of docs/override.md: a feed hold and a resume of the butterfly, in the triangle and over time.

python -m benchmarks.override_figure [--output docs]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from feedplan.job import Job, load_job
from interp.plan_file import plan_bytes, read_plan_file
from interp.step import PlanStep
from planner.output.figures import figure_style, place_panels, save_plot
from planner.output.palette import FAINT, INK, SERIES
from planner.types import FloatArray

_BLUE, _RED, _GREEN = SERIES[:3]
_WIDTH, _HEIGHT = 7.1, 4.6  # inches
_RESERVE = 0.09
_SHOWN = 3.2  # s


def run() -> tuple[Job, PlanStep, FloatArray, FloatArray, FloatArray]:
    """Samples of a run with a hold, a resume to 60 %, and full rate; what was asked for, and the course of the rate."""
    job = load_job("butterfly-nurbs", "mill", override_reserve=_RESERVE)
    step = PlanStep(plan_bytes(job.plan(), job.limits), 1e-3)
    t = step.period * np.arange(round(_SHOWN / step.period))
    asked = np.select([t < 0.7, t < 1.4, t < 2.2], [1.0, 0.0, 0.6], 1.0)
    positions, course = step.run(t.size, asked)
    return job, step, positions, asked, course


def override_figure() -> Figure:
    """Draw the triangle with the run in it, the rate over time, and what the axes use of their limits."""
    job, step, positions, asked, course = run()
    governor = read_plan_file(step.content).governor
    if governor is None:
        raise ValueError("the plan has no reserve")
    t = step.period * np.arange(1, asked.size + 1)
    with figure_style():
        figure = Figure(figsize=(_WIDTH, _HEIGHT), layout="constrained")
        left, right = figure.subplots(2, 2, squeeze=False).T
        triangle, rate = left
        tip = governor.high / (governor.high + governor.low)
        triangle.fill([0.0, tip, 1.0], [0.0, governor.fastest**2, 0.0], color=FAINT, alpha=0.3, lw=0.0)
        triangle.plot(course[:, 1], course[:, 2] ** 2, color=_BLUE, lw=1.0)
        triangle.set_xlabel("rate r")
        triangle.set_ylabel("r'^2 (1/s^2)")
        rate.plot(t, asked, color=INK, lw=0.6, ls=(0, (4, 2)), label="asked for")
        rate.plot(t, course[:, 1], color=_BLUE, lw=1.0, label="rate")
        rate.set_xlabel("time (s)")
        rate.set_ylabel("rate r")
        rate.legend(loc="lower right")
        for order, axes, limits, name in (
            (2, right[0], job.limits.acceleration, "acceleration"),
            (3, right[1], job.limits.jerk, "jerk"),
        ):
            share = np.diff(positions, order, axis=0) / step.period**order / limits
            for j, color in enumerate((_RED, _GREEN)):
                axes.plot(t[order:], share[:, j], color=color, lw=0.7, label=job.curve.axes[j])
            for value in (-1.0, 1.0):
                axes.axhline(value, color=INK, lw=0.6, ls=(0, (4, 2)))
            axes.set_xlabel("time (s)")
            axes.set_ylabel(f"{name} / limit")
        right[0].legend(loc="lower right")
        place_panels(figure)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("docs"), help="folder")
    given = parser.parse_args(arguments)
    save_plot(given.output / "override-hold.png", override_figure())
    Console().print(f"{given.output / 'override-hold.png'}")


if __name__ == "__main__":
    main()
