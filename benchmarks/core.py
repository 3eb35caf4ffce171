"""What the compiled core must reach: computing times over those of others, closeness to the optimum, start-up.

    python -m benchmarks.core [--output result.json] [--beside earlier.json] [--only GROUP,...] [--repeats 7]
                              [--before CHECKOUT] [--million]

Prints a table in Markdown: what, the target, what was measured, whether it was reached.  CPU seconds of one process and
one thread; ratios are medians of the ratios of runs that follow one another, since the clock of a shared machine wanders.
A plan that fails the independent check scores no time.

"Solve" is one jerk-limited solve, coarse and fine grid together, as the others solve once.  "Curve to verified" is all
from a curve that nobody has evaluated yet to the report of the independent check, without the lower bound, which a plan
computes when it is asked for it; the result file has what that costs.  toppra and COPP's TOPP2-RA solve on as
many intervals and know no jerk limit; their setup is not counted.

Two rows compare with an earlier state of the project: ``--before`` takes a checkout of it, which this interpreter must be
able to run; both are then measured in turn, in processes of their own.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import inf, isnan, nan
from pathlib import Path
from statistics import median
from time import process_time, thread_time
from typing import Any

from rich.console import Console
from rich.progress import track

from benchmarks import corners, processes
from benchmarks.cases import CONVERGED, FEEDS, OPTIMA, mill, reference_cases
from benchmarks.durations import toppra_seconds
from benchmarks.environment import environment
from benchmarks.programs import FOLDER, LIMITS, NAMES
from benchmarks.solver import copp_without_jerk_seconds
from benchmarks.targets import Row, table
from feedplan.comparison.result import finite
from feedplan.job import Job, load_job
from planner import FeedrateProfile, load_curve
from planner.files.whole_file import require_writable, whole_file

TEN = tuple(f"{name} {feed:g}" for feed in FEEDS for name, _ in OPTIMA)
TOLERANCE = 1e-2  # mm, of programs
GROWING = (250, 500, 1000, 2000, 4000)
_SAME = 1e-6  # of the time: the gap at which the solver stops
_TURNS = 7
_COPP_RUNS = 5  # a third of a millisecond each


@dataclass(frozen=True)
class Settings:
    """What is asked for on the command line."""

    repeats: int = 7
    first_repeats: int = 7
    intervals: int = 1000
    cases: tuple[str, ...] = ()
    sweep: tuple[int, ...] = corners.SWEEP
    pairs: int = corners.HUNDRED.pairs
    before: Path | None = None
    million: int = 0

    def wants(self, case: str) -> bool:
        """Whether a case is to be measured."""
        return not self.cases or case in self.cases


# ---- against toppra and COPP ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """CPU seconds of one plan and its check; ``ok`` as the check says."""

    profile: FeedrateProfile
    plan: float
    check: float
    ok: bool

    @property
    def solve(self) -> float:
        """Of the first solve, coarse and fine grid."""
        return self.profile.work.first_solve_cpu_s


def run_job(job: Job, **options: Any) -> Run:
    """Plan and check a job whose curve nobody has evaluated yet."""
    began = process_time()
    profile = job.plan(**options)
    planned = process_time()
    report = job.check(profile)
    return Run(profile, planned - began, process_time() - planned, report.ok)


def reference_job(name: str) -> Job:
    """A reference case, loaded anew: nothing about its curve is known yet."""
    return next(Job(curve, limits) for label, curve, limits, _ in reference_cases() if label == name)


def compare_case(name: str, settings: Settings) -> dict[str, float]:
    """Median CPU seconds of a case, and medians of the ratios of runs that follow one another."""
    known = reference_job(name)
    intervals = settings.intervals
    run_job(known, intervals=intervals)
    toppra_seconds(known.curve, known.limits, intervals)
    found: dict[str, list[float]] = {}
    ok = True
    for _ in range(settings.repeats):
        toppra = toppra_seconds(known.curve, known.limits, intervals)
        run = run_job(reference_job(name), intervals=intervals)
        began = process_time()
        _ = run.profile.lower_bound
        bound = process_time() - began
        copp = _copp(known, intervals)
        ok &= run.ok
        values = {
            "solve_s": run.solve,
            "all_solves_s": run.profile.work.solve_cpu_s,
            "plan_s": run.plan,
            "check_s": run.check,
            "bound_s": bound,
            "toppra_s": toppra,
            "copp_s": copp,
            "solve_per_toppra": run.solve / toppra,
            "verified_per_toppra": (run.plan + run.check) / toppra,
            "solve_per_copp": run.solve / copp,
            "check_per_plan": run.check / run.plan,
        }
        for key, value in values.items():
            found.setdefault(key, []).append(value)
    return {key: median(values) if ok else inf for key, values in found.items()}


def _copp(job: Job, intervals: int) -> float:
    """Median CPU time of COPP's TOPP2-RA, nan where it is not installed or gives up."""
    times = [copp_without_jerk_seconds(job.curve, job.limits, intervals) for _ in range(_COPP_RUNS)]
    return median(time if time is not None else nan for time in times)


def others(settings: Settings) -> tuple[list[Row], dict[str, Any]]:
    """Solve and whole plan over toppra and COPP, check over plan."""
    names = [name for name, *_ in reference_cases() if settings.wants(name)]
    cases = {name: compare_case(name, settings) for name in track(names, "against others", console=_err())}

    def row(what: str, target: float, key: str, among: Callable[[str], bool]) -> Row:
        measured = {name: case[key] for name, case in cases.items() if among(name) and not isnan(case[key])}
        return Row(f"{what}, N = {settings.intervals}", target, measured)

    def ten(name: str) -> bool:
        return name in TEN

    def nurbs(name: str) -> bool:
        return name.startswith("butterfly-nurbs")

    def flank(name: str) -> bool:
        return name == "flank"

    def every(name: str) -> bool:
        return True

    rows = [
        row("solve : toppra without jerk, ten cases of two axes", 0.08, "solve_per_toppra", ten),
        row("solve : toppra without jerk, butterfly NURBS", 0.08, "solve_per_toppra", nurbs),
        row("solve : toppra without jerk, flank of five axes", 0.2, "solve_per_toppra", flank),
        row("curve to plan to verified : toppra, ten cases", 0.5, "verified_per_toppra", ten),
        row("curve to plan to verified : toppra, butterfly NURBS", 0.5, "verified_per_toppra", nurbs),
        row("curve to plan to verified : toppra, flank", 1.5, "verified_per_toppra", flank),
        row("solve : COPP's TOPP2-RA without jerk", 6.0, "solve_per_copp", every),
        row("check : plan, twelve curves", 0.3, "check_per_plan", every),
    ]
    return rows, cases


# ---- programs ------------------------------------------------------------------------------------------------------


def program_job(name: str) -> Job:
    """A part program within 10 um."""
    return load_job(FOLDER / f"{name}.ngc", LIMITS, tolerance=TOLERANCE, path="separate")


def programs(settings: Settings) -> tuple[list[Row], dict[str, Any]]:
    """Check over plan of part programs, and plan and check of a raster for each of its corners."""
    raster = corners.Raster(settings.pairs)
    loads: dict[str, Callable[[], Job]] = {name: (lambda name=name: program_job(name)) for name in NAMES}
    loads["raster"] = raster.load
    found: dict[str, dict[str, float]] = {}
    for name in track([name for name in loads if settings.wants(name)], "programs", console=_err()):
        run_job(loads[name]())
        runs = [run_job(loads[name]()) for _ in range(settings.repeats)]
        ok = all(run.ok for run in runs)
        found[name] = {
            "plan_s": median(run.plan for run in runs) if ok else inf,
            "check_s": median(run.check for run in runs) if ok else inf,
            "check_per_plan": median(run.check / run.plan for run in runs) if ok else inf,
            "both_s": median(run.check + run.plan for run in runs) if ok else inf,
            "intervals": runs[0].profile.work.intervals,
            "duration_s": runs[0].profile.duration,
        }
    corner = {"raster": 1e3 * found["raster"]["both_s"] / raster.corners} if "raster" in found else {}
    rows = [
        Row("check : plan, programs", 0.3, {name: case["check_per_plan"] for name, case in found.items()}),
        Row(f"plan and check of a raster of {raster.corners} corners, ms a corner", 2.0, corner),
    ]
    return rows, found


# ---- closeness to the optimum --------------------------------------------------------------------------------------


def nodes(settings: Settings) -> tuple[list[Row], dict[str, Any]]:
    """Intervals a corner for a plan close to the optimum, and the default plan of a raster with a closed form."""
    found = corners.sweep_intervals(settings.sweep)
    rows = [
        Row(
            f"intervals a corner for {above:g} above the converged optimum",
            target,
            {"raster": corners.intervals_needed(found, above)},
        )
        for above, target in ((5e-4, 45.0), (1e-4, 110.0))
    ]
    exact = corners.CLOSED_FORM.shortest_time
    run = run_job(corners.CLOSED_FORM.load())
    above = run.profile.duration / exact - 1.0 if run.ok else inf
    rows.append(Row(f"closed form {exact:.7f} s: default plan above it", 2e-4, {"raster": above}))
    each = run.profile.work.intervals / corners.CLOSED_FORM.corners
    return rows, {"sweep": found, "closed_form_s": exact, "closed_form_intervals_a_corner": each}


def durations(settings: Settings) -> tuple[list[Row], dict[str, Any]]:
    """The ten cases: default plan over the converged optimum, and whether more intervals are ever slower."""
    above, rises, found = {}, {}, {}
    cases = [
        (f"{name} {feed:g}", name, scale, feed, optima[k])
        for k, feed in enumerate(FEEDS)
        for (name, scale), optima in CONVERGED.items()
    ]
    for case, name, scale, feed, optimum in track(cases, "durations", console=_err()):
        if settings.wants(case):
            default, *times = planned_times(name, scale, feed, [None, *GROWING])
            above[case] = default / optimum - 1.0
            rises[case] = max(more / fewer - 1.0 if fewer < inf else inf for fewer, more in pairwise(times))
            counted = dict(zip(map(str, GROWING), times, strict=True))
            found[case] = {"optimum_s": optimum, "default_s": default, **counted}
    rows = [
        Row("default plan above the optimum, ten cases", 3e-5, above),
        Row(f"largest rise of the time as N grows, {GROWING[0]} to {GROWING[-1]}", _SAME, rises),
    ]
    return rows, found


def planned_times(name: str, scale: float, feed: float, counts: Sequence[int | None]) -> list[float]:
    """Times of plans on these numbers of intervals, None for the default; inf for one that fails its check."""
    times = []
    for count in counts:
        run = run_job(Job(load_curve(name, scale=scale), mill(feed)), intervals=count)
        times.append(run.profile.duration if run.ok else inf)
    return times


# ---- processes of their own ----------------------------------------------------------------------------------------


def start(settings: Settings) -> tuple[list[Row], dict[str, Any]]:
    """Whole processes over ``import numpy``."""
    found = processes.start_up(settings.repeats, settings.first_repeats)
    rows = [
        Row(f"`feedplan plan circle`, whole process, {name} : `import numpy`", 4.0, {"circle": found[key]})
        for name, key in (("first run", "first_per_numpy"), ("later ones", "later_per_numpy"))
    ]
    return rows, found


def million(settings: Settings) -> tuple[list[Row], dict[str, Any]]:
    """A very long plan: its CPU time over an earlier one's, and its memory an interval."""
    plan = f"plan on {settings.million or 1_000_000} intervals"
    what = (f"{plan} : before", f"{plan}, memory an interval, bytes")
    if not settings.million:
        return [Row(text, target, {}, "needs --million") for text, target in zip(what, (0.3, 800.0), strict=True)], {}
    found, missing = _in_turn(settings, 1, "long", str(settings.million))
    here, before = found["here"][0], found["before"]
    ratio = {"winding path": here["plan_cpu_s"] / before[0]["plan_cpu_s"]} if before else {}
    rows = [
        Row(what[0], 0.3, ratio, missing),
        Row(what[1], 800.0, {"winding path": here["bytes_per_interval"]}),
    ]
    return rows, found


def steps(settings: Settings) -> tuple[list[Row], dict[str, Any]]:
    """The interpolator's step over an earlier one's, which must make the bits of the replay."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            processes.in_checkout(settings.before or processes.HERE, "write", folder)
        except processes.AbsentError:  # the row says why
            processes.in_checkout(processes.HERE, "write", folder)
        found, missing = _in_turn(settings, _TURNS if settings.before else 1, "steps", folder)
    ratios = {}
    for name in found["here"][0]["step_ns"]:
        each = zip(found["here"], found["before"], strict=False)
        pairs = [now["step_ns"][name] / then["step_ns"][name] for now, then in each]
        same = all(run["same_bits_as_replay"] for run in found["here"])
        if pairs:
            ratios[name] = median(pairs) if same else inf
    return [Row("step of the quintic table, two axes : before", 0.6, ratios, missing)], found


def _in_turn(settings: Settings, turns: int, *arguments: str) -> tuple[dict[str, Any], str]:
    """Measure here and before; where the latter cannot be, say why."""
    if settings.before is None:
        return processes.in_turn(None, turns, *arguments) | {"before": []}, "needs --before"
    try:
        return processes.in_turn(settings.before, turns, *arguments), ""
    except processes.AbsentError as error:
        missing = f"{settings.before}: {error}"
        return processes.in_turn(None, turns, *arguments) | {"before": []}, missing


# ---- the command ---------------------------------------------------------------------------------------------------

GROUPS: dict[str, Callable[[Settings], tuple[list[Row], dict[str, Any]]]] = {
    "others": others,
    "programs": programs,
    "nodes": nodes,
    "durations": durations,
    "start": start,
    "million": million,
    "steps": steps,
}


def _err() -> Console:
    return Console(stderr=True)


def share_of_one_thread() -> float:
    """CPU time of this thread over that of the process while a plan is made: 1 where it has no other."""
    job = reference_job(TEN[0])
    job.plan()
    thread, process = thread_time(), process_time()
    job.plan()
    return (thread_time() - thread) / (process_time() - process)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.core", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--output", type=Path, help="write the result as JSON")
    parser.add_argument("--beside", type=Path, help="result of an earlier run, for a column of its own")
    parser.add_argument("--only", default=",".join(GROUPS), help=f"groups of rows (default: {','.join(GROUPS)})")
    parser.add_argument("--cases", default="", help='only these cases: "teardrop 100,flank,raster"')
    parser.add_argument("--repeats", type=int, default=7, help="runs of which the median is taken (default 7)")
    parser.add_argument("--first-repeats", type=int, help="the same for first commands after an installation")
    parser.add_argument("--intervals", type=int, default=1000, help="of the plans beside others (default 1000)")
    parser.add_argument("--pairs", type=int, default=corners.HUNDRED.pairs, help="lines of the raster (default 51)")
    parser.add_argument("--sweep", help="intervals a corner to try")
    parser.add_argument("--before", type=Path, help="a checkout of an earlier state, measured in turn with this one")
    parser.add_argument(
        "--million", type=int, nargs="?", const=1_000_000, default=0, help="plan so many intervals, too"
    )
    options = parser.parse_args(arguments)
    groups = options.only.split(",")
    if unknown := sorted(set(groups) - set(GROUPS)):
        parser.error(f"no group {', '.join(unknown)}; there are {', '.join(GROUPS)}")
    if options.output is not None:
        require_writable(options.output)
    beside = {} if options.beside is None else json.loads(options.beside.read_text(encoding="utf-8"))["rows"]
    settings = Settings(
        options.repeats,
        options.repeats if options.first_repeats is None else options.first_repeats,
        options.intervals,
        tuple(filter(None, options.cases.split(","))),
        corners.SWEEP if options.sweep is None else tuple(int(each) for each in options.sweep.split(",")),
        options.pairs,
        None if options.before is None else options.before.resolve(),
        options.million,
    )
    rows: list[Row] = []
    details: dict[str, Any] = {}
    for group in groups:
        found, details[group] = GROUPS[group](settings)
        rows += found
    print(table(rows, {row["what"]: row["text"] for row in beside}))
    if options.output is not None:
        facts = {
            "benchmark": "core",
            "environment": environment(),
            "repeats": settings.repeats,
            "share_of_one_thread": share_of_one_thread(),
            "rows": [asdict(row) | {"text": row.text, "reached": row.reached} for row in rows],
            "details": details,
        }
        with whole_file(options.output) as file:
            file.write((json.dumps(finite(facts), indent=1, allow_nan=False) + "\n").encode())


if __name__ == "__main__":
    main()
