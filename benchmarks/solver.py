"""Speed and reliability of the solver: against toppra, IPOPT and COPP, up to a million intervals, on random curves.

    python -m benchmarks.solver [--output result.json] [--repeats 7] [--random 1000] [--largest 1000000]

Every bar is listed beside what was measured.  CPU seconds of this process; ratios are medians of the ratios of runs that
follow one another, since the clock of a shared machine wanders.  A plan that fails its independent check scores no time.
"Solve" is one jerk-limited solve, coarse and fine grid together, as the others solve once; "plan" is everything from the
curve to the plan whose limits hold between the nodes, all rounds of refinement included.  COPP is measured where
``copp-py`` is installed (the extra ``feedplan[benchmarks]``).
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.cases import bump, drives, mill, reference_cases
from benchmarks.durations import toppra_seconds
from benchmarks.environment import environment
from feedplan.job import Job
from planner import Curve, FeedrateError, Limits, certify, load_curve
from planner.files.whole_file import whole_file
from planner.geometry.nurbs import NurbsCurve
from planner.plan.guess import breaks_inside, guess_feed
from planner.plan.rows import build
from planner.plan.section import cut
from planner.plan.solvers import interior as optimal
from planner.plan.solvers import ipopt as nlp
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap
from planner.types import FloatArray

INTERVALS = 1000
# COPP solves well where the numbers are about 1.
_COPP_LENGTH, _COPP_TIME = 2.5, 0.05  # mm, s
_PER_MACRO = 8
_COPP_TOLERANCE, _COPP_PASSES = 2e-5, 20
_SIZES = (20_000, 100_000, 1_000_000)
_SIZE_BARS = {20_000: 0.3, 100_000: 2.0, 1_000_000: 25.0}  # s of solving
_WIDTH = 140  # columns, where there is no terminal
_MAX_TOTAL, _MAX_MEMORY = 45.0, 2.5  # s, GB


def problem_of(curve: Curve, limits: Limits, intervals: int) -> Any:
    """The arrays that a solver sees, on the grid of the given size."""
    (section,) = cut(curve, limits, exact_stop=False)
    guess = guess_feed(section, limits, intervals)
    on = TimeMap.from_guess(section, limits, guess, breaks_inside(section), intervals // _PER_MACRO)
    return build(limits, TimeGrid.even(on, _PER_MACRO))[0]


def copp_robot(curve: Curve, limits: Limits, intervals: int) -> tuple[Any, FloatArray] | None:
    """The path and the axes' limits as COPP takes them, and its grid; None where COPP is not installed."""
    try:
        import copp_py as copp
    except ImportError:
        return None
    share = np.linspace(0.0, 1.0, intervals + 1)
    u0, u1 = curve.domain
    q = curve.derivatives(np.clip(u0 + share * (u1 - u0), u0, u1), 3) / _COPP_LENGTH
    for order in range(4):
        q[order] *= (u1 - u0) ** order
    robot = copp.Robot(curve.dim, capacity=share.size)
    robot.append_s(share)
    robot.set_q(q[0], q[1], q[2], 0, dddq=q[3])
    for add, row, order in (
        (robot.add_velocity_limits, np.minimum(limits.velocity, limits.feed), 1),
        (robot.add_acceleration_limits, limits.acceleration, 2),
        (robot.add_jerk_limits, limits.jerk, 3),
    ):
        bound = row * _COPP_TIME**order / _COPP_LENGTH
        add(bound, -bound, start_idx_s=0)
    return robot, share


def copp_without_jerk_seconds(curve: Curve, limits: Limits, intervals: int) -> float | None:
    """CPU time of COPP's TOPP2-RA, which knows no jerk limit; None where it is not installed, or gives up."""
    made = copp_robot(curve, limits, intervals)
    if made is None:
        return None
    import copp_py as copp
    from copp_py.solver import topp2_ra

    began = process_time()
    try:
        topp2_ra.solve(topp2_ra.Problem(made[0].constraints, (0, intervals)))
    except copp.CoppError:
        return None
    return process_time() - began


def copp_seconds(curve: Curve, limits: Limits, intervals: int) -> tuple[float, float] | None:
    """CPU time and duration of COPP's jerk-limited SOCP, linearised again until the time settles.

    None where it is not installed, or gives up.
    """
    made = copp_robot(curve, limits, intervals)
    if made is None:
        return None
    robot, share = made
    import copp_py as copp
    from copp_py.solver import topp2_ra, topp3_socp

    began = process_time()
    at = topp2_ra.solve(topp2_ra.Problem(robot.constraints, (0, intervals)))
    duration = np.inf
    for _ in range(_COPP_PASSES):
        try:
            profile = topp3_socp.solve(topp3_socp.Problem(robot.constraints, np.maximum(at, 1e-10)))
        except copp.CoppError:
            return None
        before, duration = duration, copp.interpolation.s_to_t_topp3(share, profile)[0]
        at = profile.a
        if abs(before - duration) <= _COPP_TOLERANCE * duration:
            break
    return process_time() - began, duration * _COPP_TIME


def ipopt_seconds(problem: Any) -> float:
    """CPU time in which CasADi builds and IPOPT solves the same problem."""
    began = process_time()
    nlp.solve_nlp(problem)
    return process_time() - began


def compare_case(curve: Curve, limits: Limits, optimum: float, repeats: int) -> dict[str, Any]:
    job = Job(curve, limits)
    job.plan(intervals=INTERVALS)
    toppra_seconds(curve, limits, INTERVALS)
    runs = []
    for _ in range(repeats):
        theirs = toppra_seconds(curve, limits, INTERVALS)
        began = process_time()
        profile = job.plan(intervals=INTERVALS)
        runs.append((process_time() - began, profile.work.first_solve_cpu_s, profile.work.solve_cpu_s, theirs))
    free = job.plan()
    began = process_time()
    bound = certify(curve, limits, profile)
    certify_s = process_time() - began
    ok = job.check(profile, density=20).ok and job.check(free, density=20).ok
    solve = median(run[1] for run in runs)
    copp = copp_seconds(curve, limits, INTERVALS)
    smooth = all(b.parametric >= 2 for b in curve.breaks)
    return {
        "check_ok": ok,
        "c2": smooth,
        "duration_s": profile.duration,
        "above_optimum": profile.duration / optimum - 1.0,
        "above_optimum_refined": free.duration / optimum - 1.0,
        "slowdown": profile.work.slowdown,
        "rounds": profile.work.rounds,
        "plan_s": median(run[0] for run in runs) if ok else None,
        "solve_s": solve if ok else None,
        "all_solves_s": median(run[2] for run in runs),
        "toppra_s": median(run[3] for run in runs),
        "solve_per_toppra": median(run[1] / run[3] for run in runs),
        "plan_per_toppra": median(run[0] / run[3] for run in runs),
        "ipopt_per_solve": ipopt_seconds(problem_of(curve, limits, INTERVALS)) / solve,
        "copp_per_solve": copp[0] / solve if copp else None,
        "copp_duration_s": copp[1] if copp else None,
        "certified_gap": 1.0 - bound / profile.duration,
        "certify_s": certify_s,
    }


def long_path(intervals: int) -> tuple[Curve, Limits]:
    """A winding path of one cubic span for every 20 intervals."""
    rng = np.random.default_rng(3)
    count = intervals // 20
    heading = np.cumsum(rng.normal(0.0, 0.25, count))
    points = np.cumsum(8.0 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, count - 3.0, count - 2), [count - 3.0] * 3])
    limits = mill()
    return NurbsCurve(points, knots, 3, name=f"winding path of {count} points"), limits


def one_size(kind: str, intervals: int) -> dict[str, Any]:
    """One size in this process: a long path from curve to checked plan, or the solver alone on a short curve."""
    warm = load_curve("teardrop"), drives()
    Job(*warm).check(Job(*warm).plan())
    if kind == "short":
        curve, limits = load_curve("butterfly", scale=10.0), drives(300.0)
        problem = problem_of(curve, limits, intervals)
        coarse = problem_of(curve, limits, intervals // 8)
        began = process_time()
        first = optimal.solve_interior(coarse, optimal.start_from(coarse, coarse.guess), tolerance=1e-2)
        share = [np.concatenate([[0.0], np.cumsum(p.h)]) / p.h.sum() for p in (problem, coarse)]
        ratio = (coarse.length_unit / coarse.time_unit / problem.length_unit * problem.time_unit) ** 2
        guess = np.interp(share[0], share[1], first.x) * ratio
        solution = optimal.solve_interior(problem, optimal.start_from(problem, guess), centring=0.1)
        solve_s = process_time() - began
        result = {
            "status": solution.status,
            "iterations": solution.iterations,
            "solve_s": solve_s,
            "first_solve_s": solve_s,
        }
    else:
        curve, limits = long_path(intervals)
        _ = curve.breaks
        wall, began = time.perf_counter(), process_time()
        job = Job(curve, limits)
        profile = job.plan(intervals=intervals)
        planned = process_time() - began
        gc.collect()
        ok = job.check(profile).ok
        result = {
            "status": profile.status.value,
            "check_ok": ok,
            "rounds": profile.work.rounds,
            "slowdown": profile.work.slowdown,
            "solve_s": profile.work.solve_cpu_s,
            "first_solve_s": profile.work.first_solve_cpu_s,
            "plan_s": planned,
            "total_s": process_time() - began,
            "wall_s": time.perf_counter() - wall,
        }
    result["memory_gb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    return result


def in_a_process(kind: str, intervals: int) -> dict[str, Any]:
    """Run :func:`one_size` in a process of its own, so that its memory is its own."""
    command = [sys.executable, "-m", "benchmarks.solver", "--one", kind, str(intervals)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=1200)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def tiny_features() -> dict[str, Any]:
    """Plan over a bump of 1 mm, 1 um and 1 nm; beside it toppra, without a jerk limit, on the nodes of the plan."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("CRITICAL")
    limits = mill()
    rows: dict[str, Any] = {}
    for nanometres in (1e6, 1e3, 1.0):
        curve = bump(nanometres)
        job = Job(curve, limits)
        profile = job.plan()
        u = np.unique(np.concatenate([np.linspace(*curve.domain, INTERVALS + 1), profile.u]))
        grid = (u - u[0]) / (u[-1] - u[0])
        bounds = [
            constraint.JointVelocityConstraint(np.stack([-limits.velocity, limits.velocity], axis=1)),
            constraint.JointAccelerationConstraint(np.stack([-limits.acceleration, limits.acceleration], axis=1)),
        ]
        bounds[1].set_discretization_type(constraint.DiscretizationType.Interpolation)
        path = toppra.SplineInterpolator(grid, curve.derivatives(u, 0)[0])
        problem = algorithm.TOPPRA(bounds, path, gridpoints=grid, solver_wrapper="seidel")
        problem.compute_parameterization(0.0, 0.0)
        rows[curve.name] = {
            "duration_s": profile.duration,
            "slowdown": profile.work.slowdown,
            "exact_stops": profile.work.sections - 1,
            "check_ok": job.check(profile).ok,
            "toppra": problem.problem_data.return_code.name,
        }
    return rows


def random_curve(seed: int) -> NurbsCurve:
    """A seeded random cubic NURBS in 2, 3 or 5 axes: scattered points, or a random walk."""
    rng = np.random.default_rng(seed)
    dim, count = (2, 3, 5)[seed % 3], int(rng.integers(6, 30))
    points = rng.uniform(-50.0, 50.0, (count, dim))
    if seed % 2:
        points = 10.0 * np.cumsum(rng.normal(size=(count, dim)), axis=0)
    knots = np.concatenate([[0.0] * 4, np.sort(rng.uniform(0.02, 0.98, count - 4)), [1.0] * 4])
    return NurbsCurve(points, knots, 3, np.exp(0.5 * rng.normal(size=count)), name=f"random {seed}")


def random_plans(count: int) -> dict[str, Any]:
    """Plan and check seeded random curves."""
    slowdowns, seconds, failures, infeasible = [], [], [], []
    for seed in track(range(count), "random curves", console=Console(stderr=True)):
        curve = random_curve(seed)
        limits = mill(dim=curve.dim)
        began = process_time()
        job = Job(curve, limits)
        try:
            profile = job.plan()
        except FeedrateError as error:
            failures.append(f"{seed}: {error}")
            continue
        seconds.append(process_time() - began)
        slowdowns.append(profile.work.slowdown)
        if not job.check(profile).ok:
            infeasible.append(seed)
    over = [seed for seed, slowdown in enumerate(slowdowns) if slowdown > 1.002]
    return {
        "curves": count,
        "failures": failures,
        "infeasible": infeasible,
        "slowdown_median": float(np.median(slowdowns)),
        "slowdown_90": float(np.quantile(slowdowns, 0.9)),
        "slowdown_largest": float(np.max(slowdowns)),
        "slowdown_above_1.002": over,
        "plan_s_median": float(np.median(seconds)),
        "plan_s_largest": float(np.max(seconds)),
    }


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def show_cases(rows: dict[str, dict[str, Any]]) -> Table:
    title = (
        f"{INTERVALS} intervals: bars solve <= 0.4, plan <= 1.2 (C2) or 2 x toppra; IPOPT >= 150, COPP >= 40 x solve"
    )
    table = Table(title=title, box=SIMPLE, padding=(0, 1, 0, 0))
    heads = (
        "case",
        "solve ms",
        "plan ms",
        "solve/toppra",
        "plan/toppra",
        "IPOPT/solve",
        "COPP/solve",
        "above T*",
        "gap",
    )
    for name in heads:
        table.add_column(name, justify="left" if name == "case" else "right")
    for name, row in rows.items():
        table.add_row(
            name + ("" if row["c2"] else " *"),
            _cell(row["solve_s"] and 1e3 * row["solve_s"], ".1f"),
            _cell(row["plan_s"] and 1e3 * row["plan_s"], ".1f"),
            _cell(row["solve_per_toppra"], ".2f"),
            _cell(row["plan_per_toppra"], ".2f"),
            _cell(row["ipopt_per_solve"], ".0f"),
            _cell(row["copp_per_solve"], ".0f"),
            f"{100.0 * row['above_optimum']:+.3f}%",
            f"{100.0 * row['certified_gap']:.3f}%",
        )
    return table


def show_sizes(rows: dict[str, dict[str, Any]]) -> Table:
    table = Table(title="large problems (first solve: coarse and fine)", box=SIMPLE, padding=(0, 1, 0, 0))
    for name in ("path", "status", "first solve s", "bar s", "all solves s", "curve to checked plan s", "memory GB"):
        table.add_column(name, justify="left" if name in {"path", "status"} else "right")
    for name, row in rows.items():
        table.add_row(
            name,
            row["status"],
            _cell(row["first_solve_s"], ".2f"),
            _cell(_SIZE_BARS[int(name.split()[1])], "g"),
            _cell(row["solve_s"], ".2f"),
            _cell(row.get("total_s"), ".1f"),
            _cell(row["memory_gb"], ".2f"),
        )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--output", type=Path, help="JSON result file")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--random", type=int, default=1000, help="how many random curves")
    parser.add_argument("--largest", type=int, default=_SIZES[-1], help="largest number of intervals")
    parser.add_argument("--one", nargs=2, metavar=("KIND", "INTERVALS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one_size(options.one[0], int(options.one[1]))))
        return
    progress = Console(stderr=True)
    out = Console() if sys.stdout.isatty() else Console(width=_WIDTH)
    rows = {
        name: compare_case(curve, limits, optimum, options.repeats)
        for name, curve, limits, optimum in track(reference_cases(), "against the others", console=progress)
    }
    out.print(show_cases(rows))
    wanted = [(kind, n) for n in _SIZES if n <= options.largest for kind in ("long", "short")]
    sizes = {f"{kind} {n}": in_a_process(kind, n) for kind, n in track(wanted, "large problems", console=progress)}
    out.print(show_sizes(sizes))
    tiny = tiny_features()
    out.print_json(data=tiny)
    some = random_plans(options.random)
    out.print_json(data=some)
    if options.output is not None:
        bars = {"size_solve_s": _SIZE_BARS, "size_total_s": _MAX_TOTAL, "size_memory_gb": _MAX_MEMORY}
        data = {
            "environment": environment(),
            "bars": bars,
            "cases": rows,
            "sizes": sizes,
            "tiny_features": tiny,
            "random": some,
        }
        with whole_file(options.output) as file:
            file.write((json.dumps(data, indent=1) + "\n").encode())


if __name__ == "__main__":
    main()
