"""The picture of docs/controller.md: a plan in a thread of LinuxCNC while override and hold are moved.

python -m benchmarks.linuxcnc.trace_figure [--output docs]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.linuxcnc.machine import SERVO_PERIOD
from benchmarks.linuxcnc.rt import Trace, can_build, component, plan_of, run_plan
from planner.machine.limits import Limits
from planner.output.figures import save_plot
from planner.output.panels import Line, Panel, plot_panels

# Seconds to wait, then what is typed: an override, a ramp of it as a potentiometer gives, a hold of a second and a half.
KNOBS = (
    (1.0, "sets override 0.4"),
    (1.2, "sets override 1"),
    (1.2, "sets hold 1"),
    (1.5, "sets hold 0"),
    *((0.05, f"sets override {share:.2f}") for share in np.linspace(1.0, 0.2, 17)),
    (0.8, "sets override 1"),
)


def drawn(trace: Trace, limits: Limits) -> Figure:
    """Override and rate, feed, and the jerk of both axes over the time of the machine."""
    t = SERVO_PERIOD * np.arange(len(trace.position))
    asked = np.where(trace.hold | ~trace.run, 0.0, trace.override)
    jerk = np.diff(trace.position, 3, axis=0) / SERVO_PERIOD**3
    label = "machine time, s"
    return plot_panels(
        "The butterfly in LinuxCNC: override and hold are moved, every limit holds",
        [
            Panel(
                "What is asked for, and the rate", label, "share",
                [Line("asked", t, asked), Line("rate", t, trace.rate, 1.2)],
            ),
            Panel("Feed", label, "mm/s", [Line("feed", t, trace.feed)], bounds=(limits.feed,), zero=True),
            Panel(
                "Jerk of the axes, and the limit", label, "mm/s³",
                [Line(axis, t[3:], jerk[:, j]) for j, axis in enumerate("XY")],
                bounds=(-float(limits.jerk[0]), float(limits.jerk[0])),
            ),
        ],
        columns=1,
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path())
    options = parser.parse_args(arguments)
    if not can_build():
        print("LinuxCNC and its compiler of components are needed (Debian: linuxcnc-uspace, linuxcnc-uspace-dev)")
        return 3
    content, _, dim, limits = plan_of("butterfly-nurbs")
    with component():
        trace = run_plan(content, dim, KNOBS)
    save_plot(options.output / "controller-trace.png", drawn(trace, limits))
    return 0


if __name__ == "__main__":
    sys.exit(main())
