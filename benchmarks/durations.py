"""Durations, bounds and computing times of the planner on the reference cases.

    python -m benchmarks.durations [--output results.json] [--repeats 5] [--intervals 1000]

Ten cases and two more, their reference optima from three independent solvers that agree within 1e-4.  CPU seconds of one
thread, medians, every method in the same process; toppra gets the same path as a cubic spline on the same number of grid
points.  A plan that fails its check scores no time.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.cases import reference_cases
from benchmarks.environment import environment
from feedplan.job import Job
from planner import Curve, FeedrateProfile, Limits, certify


def toppra_seconds(curve: Curve, limits: Limits, intervals: int) -> float:
    """CPU time of one toppra solve, axis velocity and acceleration limits, without its setup."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    grid = np.linspace(0.0, 1.0, intervals + 1)
    u = curve.domain[0] + grid * (curve.domain[1] - curve.domain[0])
    path = toppra.SplineInterpolator(grid, curve.derivatives(np.clip(u, *curve.domain), 0)[0])
    velocity = np.minimum(limits.velocity, 1e6)
    bounds = [
        constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
        constraint.JointAccelerationConstraint(np.stack([-limits.acceleration, limits.acceleration], axis=1)),
    ]
    bounds[1].set_discretization_type(constraint.DiscretizationType.Interpolation)
    problem = algorithm.TOPPRA(bounds, path, gridpoints=grid, solver_wrapper="seidel")
    began = process_time()
    problem.compute_parameterization(0.0, 0.0)
    return process_time() - began


def timed_plan(curve: Curve, limits: Limits, **options: Any) -> tuple[FeedrateProfile, float]:
    began = process_time()
    profile = Job(curve, limits).plan(**options)
    return profile, process_time() - began


def measure(curve: Curve, limits: Limits, optimum: float, repeats: int, intervals: int) -> dict[str, Any]:
    job = Job(curve, limits)
    job.plan(intervals=intervals)
    runs = [timed_plan(curve, limits, intervals=intervals) for _ in range(repeats)]
    profile = runs[0][0]
    report = job.check(profile)
    toppra_seconds(curve, limits, intervals)
    toppra_s = median(toppra_seconds(curve, limits, intervals) for _ in range(repeats))
    reference, nlp_s = timed_plan(curve, limits, method="nlp", intervals=intervals)
    bound = certify(curve, limits, profile)
    ok = report.ok
    return {
        "reference_s": optimum,
        "duration_s": profile.duration,
        "above_reference": profile.duration / optimum - 1.0,
        "certified_bound_s": bound,
        "certified_gap": 1.0 - bound / profile.duration,
        "slowdown": profile.work.slowdown,
        "check_ok": ok,
        "worst_ratio": max(row.ratio for row in report.rows),
        "solve_cpu_s": median(run.work.solve_cpu_s for run, _ in runs) if ok else None,
        "rounds": profile.work.rounds,
        "plan_cpu_s": median(seconds for _, seconds in runs) if ok else None,
        "toppra_cpu_s": toppra_s,
        "nlp_duration_s": reference.duration,
        "nlp_solve_cpu_s": reference.work.solve_cpu_s,
        "nlp_plan_cpu_s": nlp_s,
    }


def show(results: dict[str, dict[str, Any]]) -> Table:
    table = Table(title="durations against references, computing in CPU ms", box=SIMPLE, padding=(0, 1, 0, 0))
    for name in ("case", "seconds", "above optimum", "proven gap", "solve", "plan", "toppra", "IPOPT"):
        table.add_column(name, justify="left" if name == "case" else "right", no_wrap=name != "above optimum")
    for name, row in results.items():
        times = [row["solve_cpu_s"], row["plan_cpu_s"], row["toppra_cpu_s"], row["nlp_solve_cpu_s"]]
        table.add_row(
            name,
            f"{row['duration_s']:.4f}",
            f"{100.0 * row['above_reference']:+.3f}%",
            f"{100.0 * row['certified_gap']:.3f}%",
            *("fails" if seconds is None else f"{1e3 * seconds:.0f}" for seconds in times),
        )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--output", type=Path, help="JSON result file")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--intervals", type=int, default=1000)
    options = parser.parse_args()
    results = {
        name: measure(curve, limits, optimum, options.repeats, options.intervals)
        for name, curve, limits, optimum in track(reference_cases(), "planning", console=Console(stderr=True))
    }
    Console().print(show(results))
    if options.output is not None:
        header = {"intervals": options.intervals, "environment": environment()}
        options.output.write_text(json.dumps(header | {"cases": results}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
