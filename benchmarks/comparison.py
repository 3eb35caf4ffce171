"""The literature's interpolators and the planner's methods under the same limits.

    python -m benchmarks.comparison [--output result.json] [--markdown tables.md] [--cases TEXT] [--methods A,B,...]

Twenty cases: the four curves of the thesis with its limits and, scaled as in the table of durations, on the mill, the
circle of 2002 and the butterfly NURBS on the mill, at two feeds each.  What is measured, and what may be compared, is
written in ``feedplan.comparison``; ``feedplan compare`` prints the same for one curve.

Times of a method that breaks a limit are printed with the letters of what it breaks, and count for nothing.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

from rich.console import Console
from rich.progress import track

from benchmarks.cases import mill
from benchmarks.environment import environment
from feedplan.comparison import NOTE, compare
from feedplan.comparison.judgement import Dilation, Judgement, letters
from feedplan.comparison.methods import METHODS, select_methods
from feedplan.comparison.result import Result, finite, result_facts, saving, saving_facts
from planner import load_curve
from planner.files.whole_file import require_writable, whole_file
from planner.geometry.curve import Curve
from planner.machine.limits import Limits

LITERATURE = ("algorithm-", "2002-", "2007-")
REPEATS = 3
REPEATED = 1.0  # s; what takes longer is timed once
LIMITATIONS = (
    NOTE + ".",
    "Every method is judged from rest to rest. Algorithms 1-4 enter and leave a path at 0.5 mm/s, a step of 500 mm/s^2 and "
    "5e5 mm/s^3 at 1 ms: the table of factors has, in brackets, what they need without it.",
    "The factor of a uniform dilation sends the same points every kappa T. Sampled with T again, a jump of the "
    "acceleration leaves a jerk that falls with kappa^2 only: it flatters the methods without a jerk limit.",
    "Algorithms 1-4 in mode physical with the published parameters (lambda 0.18, S-curves over the first 10 % and the last "
    "5 % of the parameter, at least 0.5 mm/s): they depend on choices that the text leaves open.",
    "2002 runs at the commanded feed, or the highest that the path is long enough for; 2007 with the machine's "
    "acceleration over sqrt(2) along and across the path. Both papers leave these to the user.",
    "Processor times are those of one core that other work may share: compare them within one run.",
)


@dataclass(frozen=True)
class Case:
    """A curve, its scale, and a set of limits at a feed in mm/s."""

    curve: str
    scale: float
    machine: str
    feed: float

    @property
    def name(self) -> str:
        """As in the tables."""
        scale = "" if self.scale == 1.0 else f" x {self.scale:g}"
        return f"{self.curve}{scale}, {self.machine}, {self.feed:g} mm/s"

    def load(self) -> tuple[Curve, Limits]:
        """Load what is run."""
        return load_curve(self.curve, scale=self.scale), MACHINES[self.machine].with_feed(self.feed)


MACHINES = {
    "thesis": Limits(20.0, [30.0] * 2, [30.0] * 2, [200.0] * 2, chord_error=1e-6, period=1e-3),
    "mill": mill(),
}
FEEDS = {"thesis": (20.0, 40.0), "mill": (100.0, 300.0)}
CURVES = {
    "thesis": (("teardrop", 1.0), ("hypotrochoid", 1.0), ("snailshell", 1.0), ("butterfly", 1.0)),
    "mill": (
        ("teardrop", 1.0),
        ("hypotrochoid", 10.0),
        ("snailshell", 10.0),
        ("butterfly", 10.0),
        ("circle", 1.0),
        ("butterfly-nurbs", 1.0),
    ),
}
CASES = tuple(
    Case(name, scale, machine, feed)
    for machine, curves in CURVES.items()
    for feed in FEEDS[machine]
    for name, scale in curves
)


def measure(case: Case, methods: Sequence[str], repeats: int) -> list[Result]:
    """Run and judge every method; the computing time is the median of several runs, the first left out."""
    curve, limits = case.load()
    results = []
    for result in compare(curve, limits, methods).results:
        if result.judgement is not None and result.computing_time < REPEATED and repeats > 0:
            times = []
            for _ in range(repeats):
                began = time.process_time()
                METHODS[result.method](curve, limits)
                times.append(time.process_time() - began)
            results.append(replace(result, computing_time=median(times)))
        else:
            results.append(result)
    return results


def case_facts(case: Case, results: Sequence[Result]) -> dict[str, Any]:
    limits = MACHINES[case.machine]
    return {
        "case": case.name,
        "curve": case.curve,
        "scale": case.scale,
        "machine": case.machine,
        "feed_mm_s": case.feed,
        "velocity_mm_s": limits.velocity.tolist(),
        "acceleration_mm_s2": limits.acceleration.tolist(),
        "jerk_mm_s3": limits.jerk.tolist(),
        "chord_error_mm": limits.chord_error,
        "period_s": limits.period,
        "saving": saving_facts(saving(results)),
        "methods": [result_facts(result) for result in results],
    }


# ---- markdown ------------------------------------------------------------------------------------------------------


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose first column is text."""
    rule = ["---", *("---:" for _ in heads[1:])]
    return "\n".join("| " + " | ".join(row) + " |" for row in (heads, rule, *rows)) + "\n"


def saving_table(measured: dict[Case, list[Result]]) -> str:
    """What the optimum saves, a row a case."""
    rows = []
    for case, results in measured.items():
        found = saving(results)
        if found is None:
            rows.append([case.name, "breaks a limit", *[""] * 5])
            continue
        literature = [
            (r.judgement.dilation.duration, r.method)
            for r in results
            if r.method.startswith(LITERATURE) and r.judgement is not None and r.judgement.dilation.confirmed
        ]
        duration, name = min(literature) if literature else (float("nan"), "none")
        rows.append(
            [
                case.name,
                f"{found.optimum:.4f}",
                f"{found.rival} {found.rival_duration:.4f}" if found.rival else "none",
                f"{100.0 * found.share:.2f} %" if found.rival else "-",
                f"{found.slowed_rival} {found.slowed_duration:.4f}",
                f"{name} {duration:.4f}",
                f"{100.0 * (1.0 - found.optimum / duration):.1f} %",
            ]
        )
    heads = ["case", "optimum s", "fastest that breaks nothing, s", "saved", "fastest once slowed, s"]
    return markdown([*heads, "fastest of the literature once slowed, s", "saved"], rows)


def matrix(measured: dict[Case, list[Result]], machine: str, cell: Any) -> str:
    """One cell for each method and case of a machine."""
    cases = [case for case in measured if case.machine == machine]
    names = [result.method for result in measured[cases[0]]]
    rows = []
    for k, name in enumerate(names):
        rows.append([name, *(cell(measured[case][k]) for case in cases)])
    return markdown(["", *(f"{case.curve} {case.feed:g}" for case in cases)], rows)


def time_cell(result: Result) -> str:
    if result.judgement is None:
        return "not run"
    return f"{result.duration:.3f} {'' if result.ok else letters(result.judgement)}".strip()


def dilation_cell(result: Result) -> str:
    if result.judgement is None:
        return "not run"
    text = _factor(result.judgement.dilation)
    return text if result.entered_at_speed is None else f"{text} ({_factor(result.entered_at_speed.dilation)})"


def _factor(found: Dilation) -> str:
    return f"{found.factor:.2f}{'' if found.confirmed else '?'}"


def detail(results: Sequence[Result]) -> str:
    """All columns of one case."""
    rows = []
    for result in results:
        if result.judgement is None:
            rows.append([result.method, "not run", result.reason, *[""] * 8])
            continue
        ratios = result.judgement.ratios
        rows.append(
            [
                result.method,
                f"{result.duration:.4f}",
                _verdict(result.judgement),
                str(result.points),
                f"{1e3 * result.chord_error:.3g}",
                *(_ratio(ratios[name]) for name in ("feed", "velocity", "acceleration", "jerk")),
                "-" if result.fluctuation != result.fluctuation else f"{result.fluctuation:.1e}",
                f"{1e3 * result.computing_time:.1f}",
            ]
        )
    heads = ["method", "time s", "verdict", "points", "chord error um", "feed", "velocity", "acceleration", "jerk"]
    return markdown([*heads, "fluctuation", "CPU ms"], rows)


def _ratio(value: float) -> str:
    text = f"{value:.4g}"
    return f"1 + {value - 1.0:.0e}" if text == "1" and value > 1.0 + 1e-6 else text


def _verdict(judgement: Judgement) -> str:
    return "breaks " + ", ".join(row.limit for row in judgement.broken) if judgement.broken else "holds"


def document(measured: dict[Case, list[Result]]) -> str:
    """All tables, those of single cases last."""
    machines = [machine for machine in MACHINES if any(case.machine == machine for case in measured)]
    parts = ["# Comparison\n", "Made by `python -m benchmarks.comparison --markdown benchmarks/comparison.md`.\n"]
    parts += ["## What the optimum saves\n", saving_table(measured)]
    parts += ["## Times, and what is broken\n", "F feed, C chord error, V axis velocity, A acceleration, J jerk.\n"]
    parts += [
        f"Limits: {machine}; curve and feed in mm/s.\n\n{matrix(measured, machine, time_cell)}" for machine in machines
    ]
    parts += ["## Slowed down until nothing is broken\n"]
    parts += ["Factor of time; in brackets where the path is entered and left at the method's own feed.\n"]
    parts += [
        f"Limits: {machine}; curve and feed in mm/s.\n\n{matrix(measured, machine, dilation_cell)}"
        for machine in machines
    ]
    parts += ["## Limitations\n", "".join(f"- {sentence}\n" for sentence in LIMITATIONS)]
    parts += ["## Every case\n", "Ratios are the worst value over its limit.\n"]
    parts += [f"### {case.name}\n\n{detail(results)}" for case, results in measured.items()]
    return "\n".join(parts)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.comparison", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--output", type=Path, help="write the result as JSON")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown")
    parser.add_argument("--cases", default="", help='only cases with this text in their name: "circle", "thesis, 20"')
    parser.add_argument("--methods", help="names, or their beginnings: algorithm,2002,scurve,optimal")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="runs of which the computing time is the median")
    options = parser.parse_args(arguments)
    for path in (options.output, options.markdown):
        if path is not None:
            require_writable(path)
    methods = list(METHODS) if options.methods is None else select_methods(options.methods)
    cases = [case for case in CASES if options.cases in case.name]
    if not cases:
        parser.error(f'no case has "{options.cases}" in its name; they are: {"; ".join(case.name for case in CASES)}')
    console = Console(width=150)
    measure(cases[0], methods, 0)  # what is loaded and compiled on the way
    measured = {
        case: measure(case, methods, options.repeats)
        for case in track(cases, "comparing", console=Console(stderr=True))
    }
    text = document(measured)
    console.print(text, soft_wrap=True, markup=False, highlight=False)
    facts = {
        "benchmark": "comparison",
        "environment": environment(),
        "cases": [case_facts(case, results) for case, results in measured.items()],
        "limitations": LIMITATIONS,
    }
    if options.output is not None:
        with whole_file(options.output) as file:
            file.write((json.dumps(finite(facts), indent=1, allow_nan=False) + "\n").encode())
    if options.markdown is not None:
        with whole_file(options.markdown) as file:
            file.write(text.encode())


if __name__ == "__main__":
    main()
