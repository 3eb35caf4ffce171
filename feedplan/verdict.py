"""The verdict on a plan, for a person and for a program: how long, how near the optimum, what holds it back."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from planner.frames import Tabular
from planner.geometry.curve import Curve
from planner.machine.feed_limits import COMMANDS
from planner.machine.limits import Limits
from planner.profile import BOUND_TOLERANCE, FeedrateProfile, Samples
from planner.quantity import QUANTITIES
from planner.status import Claim
from planner.verify import Report, Row

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from planner.programs.path.path import ProgramPath
    from planner.programs.reading.program import Program
    from planner.verify.certificate import BoundReport

# Rows of a report that are limits of the machine; the others say that a plan is a plan at all, and are counted.
_LIMITS = (COMMANDS[0], COMMANDS[1], *(q.label for q in QUANTITIES[1:]), "jerk at a curvature break")
_SHARE_SHOWN = 0.005  # limits that hold the path back for less of the time are summed up
_WORTH_SHOWN = 1e-4  # of the duration
_NOTES_SHOWN = 8
_LINES_SHOWN = 8


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Tabular):
    """A plan, what was found about it and about the samples of it; as a table, what is used of each limit.

    Attributes
    ----------
    profile : FeedrateProfile
    limits : Limits
        Against which both were checked.
    machine : str
        Where the limits come from.
    samples : Samples
    plan_report, samples_report : Report
    planning_time : float
        s; nan where the plan was read from a table.
    files : tuple of str
        What was written.
    program : ProgramPath, optional
        The path, where it comes from a part program.
    facts : tuple of (str, str)
        Further lines on where the path comes from, each with its name.
    proof : BoundReport, optional
        What the certificate of the lower bound proves; None where none was given.
    """

    profile: FeedrateProfile
    limits: Limits
    machine: str
    samples: Samples
    plan_report: Report
    samples_report: Report
    planning_time: float = math.nan
    files: tuple[str, ...] = ()
    program: ProgramPath | None = None
    facts: tuple[tuple[str, str], ...] = ()
    proof: BoundReport | None = None

    def columns(self) -> dict[str, NDArray[Any]]:
        """Limit, axis, what is allowed, the share of it that the plan and its samples use, and when most is used."""
        rows = _merged(_reports(self))
        worst = [max((row for row in pair if row is not None), key=lambda row: row.ratio) for pair in rows]
        used = np.array([[math.nan if row is None else row.ratio for row in pair] for pair in rows])
        words = {name: np.array([getattr(row, name) for row in worst], object) for name in ("limit", "axis", "unit")}
        return {
            "limit": words["limit"],
            "axis": words["axis"],
            "allowed": np.array([row.allowed for row in worst]),
            "unit": words["unit"],
            "plan": used[:, 0],
            "samples": used[:, 1],
            "t_s": np.array([row.t for row in worst]),
            "ok": np.array([all(row is None or row.ok for row in pair) for pair in rows]),
        }

    def __repr__(self) -> str:
        said = "every limit holds" if self.holds else "LIMIT BROKEN"
        gap = "" if math.isnan(self.gap) else f", at most {_percent(max(self.gap, 0.0), 2)} above the optimum"
        if self.holds and not self.ok:
            said += ", but its lower bound does not"
        return f"Verdict({self.profile.curve.name}: {self.profile.duration:.6g} s{gap};\n        {said})"

    @property
    def holds(self) -> bool:
        """Every limit holds, for the plan and for its samples."""
        return self.plan_report.ok and self.samples_report.ok

    @property
    def ok(self) -> bool:
        """Every limit holds, and nothing contradicts the lower bound: neither its certificate nor the plan itself."""
        return self.holds and (self.proof is None or self.proof.ok) and not self.contradicted

    @property
    def contradicted(self) -> bool:
        """The lower bound lies above a plan that keeps every limit: the bound is wrong."""
        return self.holds and self.gap < -BOUND_TOLERANCE

    @property
    def lower_bound(self) -> float:
        """No plan is faster, s: as far as it was proved, else what the plan says; nan where there is none."""
        return self.profile.lower_bound if self.proof is None else self.proof.proved

    @property
    def claim(self) -> Claim:
        """How the lower bound is known."""
        return self.profile.claim if self.proof is None else Claim.CERTIFIED

    @property
    def report(self) -> Report:
        """The report that decides, for the heads of files: that of the samples where only they break a limit."""
        return self.samples_report if self.plan_report.ok else self.plan_report

    @property
    def gap(self) -> float:
        """Time above the lower bound as a fraction of it; nan where there is none."""
        bound = self.lower_bound
        return self.profile.duration / bound - 1.0 if bound > 0.0 else math.nan

    @property
    def notes(self) -> list[str]:
        """What the planner says of its plan, and why a plan without a jerk limit breaks one."""
        notes = list(self.profile.notes)
        if self.program is not None:  # its stops are told by line, not by the parameter of the path
            told = {f"exact stop at u = {stop.u:.6g}" for stop in self.program.stops}
            notes = [*self.program.notes, *(note for note in notes if note not in told)]
        if not self.profile.status.as_meant:
            sentence = self.profile.status.sentence
            notes.append(f"not the optimum: {sentence}; the gap says how much time may be left in the plan")
        if self.profile.method == "toppra" and not self.ok:
            notes.append("the method toppra knows no jerk limit: compare with its time, but do not cut with its plan")
        return notes


def to_json(verdict: Verdict) -> str:
    """Write the verdict as JSON; a number that is not finite becomes null."""
    profile, limits = verdict.profile, verdict.limits
    facts = {
        "ok": verdict.ok,
        "curve": _curve_facts(profile.curve),
        "machine": verdict.machine,
        "feed_mm_s": limits.feed,
        "rapid_mm_s": limits.rapid,
        "period_s": verdict.samples.period,
        "method": profile.method,
        "duration_s": profile.duration,
        "lower_bound_s": verdict.lower_bound,
        "lower_bound_is": verdict.claim.value,
        "gap": verdict.gap,
        "nodes": profile.t.size,
        "samples": verdict.samples.t.size,
        "planning_time_s": verdict.planning_time,
        "checks": {
            "plan": [_row_facts(row) for row in verdict.plan_report.rows],
            "samples": [_row_facts(row) for row in verdict.samples_report.rows],
        },
        "held_back_by": profile.shares(),
        "saved_by_one_percent_s": dict(profile.saved_by_one_percent),
        "notes": verdict.notes,
        "files": list(verdict.files),
    }
    if verdict.proof is not None:
        facts["certificate"] = _proof_facts(verdict.proof)
    if verdict.facts:
        facts["source"] = dict(verdict.facts)
    if verdict.program is not None:
        facts["program"] = program_facts(verdict.program)
    return json.dumps(_finite(facts), indent=2, allow_nan=False)


def _proof_facts(proof: BoundReport) -> dict[str, Any]:
    return {
        "ok": proof.ok,
        "proved_s": proof.proved,
        "claimed_s": proof.claimed,
        "quadrature_allowance_s": proof.allowance,
        "scale": proof.scale,
        "assumed_stops": list(proof.stops),
        "statement": proof.statement,
    }


def _curve_facts(curve: Curve) -> dict[str, Any]:
    """Name, hash, axes, domain and length of a curve."""
    return {
        "name": curve.name,
        "hash": curve.fingerprint,
        "axes": list(curve.axes),
        "domain": list(curve.domain),
        "length_mm": curve.length,
    }


def program_facts(path: ProgramPath) -> dict[str, Any]:
    """Tolerance and deviation of the path of a part program, and where it stops."""
    return {
        "tolerance_mm": path.tolerance,
        "deviation_mm": path.deviation.largest,
        "deviation_line": path.deviation_line,
        "deviation_share": path.deviation_share,
        "exact_stops": [{"line": stop.line, "u": stop.u, "reason": stop.reason} for stop in path.stops],
        **path.counts,
    }


def _row_facts(row: Row) -> dict[str, Any]:
    return {
        "limit": row.limit,
        "axis": row.axis,
        "worst": row.worst,
        "allowed": row.allowed,
        "unit": row.unit,
        "ratio": row.ratio,
        "t_s": row.t,
        "u": row.u,
        "ok": row.ok,
    }


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def to_text(verdict: Verdict) -> RenderableType:
    """Lay the verdict out for a terminal of 80 columns or more."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    shares = ", ".join(f"{name} {_percent(share)}" for name, share in _main_shares(verdict))
    parts: list[RenderableType] = [
        _facts(verdict),
        "",
        _limit_table(_reports(verdict)),
        "",
        named("held back by", shares),
        *_worth(verdict.profile),
        *([] if verdict.proof is None else [named("proved", verdict.proof.statement)]),
        *(named("note", note) for note in _shortened(verdict.notes)),
        *(named("written", name) for name in verdict.files),
        "",
    ]
    if verdict.ok:
        count = verdict.samples.t.size
        return Group(*parts, Text(f"OK  every limit holds, for the plan and for its {count} samples", "bold green"))
    if verdict.holds and verdict.proof is not None and not verdict.proof.ok:
        return Group(*parts, Text("NOT PROVED", "bold red"), Padding(Text(verdict.proof.refusal), (0, 0, 0, 2)))
    if verdict.holds:
        text = f"every limit holds, but the lower bound is {_contradiction(verdict)}"
        return Group(*parts, Text("BOUND CONTRADICTED", "bold red"), Padding(Text(text), (0, 0, 0, 2)))
    return Group(*parts, Text("LIMIT BROKEN", "bold red"), Padding(Text(_broken(verdict)), (0, 0, 0, 2)))


def samples_text(profile: FeedrateProfile, samples: Samples, report: Report, apart: float, file: str) -> RenderableType:
    """Lay out what the samples of a plan use of its limits; ``apart`` is their distance from the plan, mm or rad."""
    from rich.console import Group
    from rich.text import Text

    curve = profile.curve
    lines = [
        named("curve", f"{curve.name}, {curve.length:.6g} mm, axes {' '.join(curve.axes)}"),
        named("plan", f"{profile.method}, {profile.duration:.6g} s"),
        named("samples", f"{samples.t.size}, one every {quantity(samples.period, 's')}"),
        named("off the plan", f"{apart:.3g} at most, mm or rad on any axis"),
    ]
    written = [named("written", file)] if file else []
    verdict = [] if report.ok else [Text("LIMIT BROKEN", "bold red")]
    return Group(*lines, "", _limit_table([("samples", report)]), "", *written, *verdict)


def _shortened(notes: list[str]) -> list[str]:
    if len(notes) <= _NOTES_SHOWN:
        return notes
    return [*notes[: _NOTES_SHOWN - 1], f"{len(notes) - _NOTES_SHOWN + 1} more notes are in --json"]


def _contradiction(verdict: Verdict) -> str:
    """Say whose error a lower bound above a sound plan is."""
    own = "an error of this program; please report it with the curve and the limits"
    claimed = verdict.profile.claim is Claim.TABLE
    return f"above the time of the plan: {'the claim of the table is false' if claimed else own}"


def _facts(verdict: Verdict) -> RenderableType:
    from rich.console import Group

    profile, limits, curve = verdict.profile, verdict.limits, verdict.profile.curve
    feed = f"feed {quantity(limits.feed, 'mm/s')}" if math.isfinite(limits.feed) else "no feed limit"
    if math.isfinite(limits.rapid) and curve.feed_caps is not None:
        feed += f", rapids {quantity(limits.rapid, 'mm/s')}"
    time = f"{profile.duration:.6g} s"
    lines = [
        named("curve", f"{curve.name}, {curve.length:.6g} mm, axes {' '.join(curve.axes)}"),
        *(named(name, text) for name, text in verdict.facts),
        *([] if verdict.program is None else program_lines(verdict.program)),
        named("machine", f"{verdict.machine}; {feed}, period {quantity(limits.period, 's')}"),
        named("plan", f"{profile.method}, {profile.t.size} nodes" + _planned_in(verdict.planning_time)),
    ]
    if math.isfinite(verdict.gap):
        gap = _percent(max(verdict.gap, 0.0) if verdict.holds else verdict.gap, 2)
        bound = f"{verdict.lower_bound:.6g} s; the gap is at most {gap}"
        if verdict.contradicted:
            bound = f"{verdict.lower_bound:.9g} s is {_contradiction(verdict)}"
        elif verdict.gap < 0.0 and not verdict.holds:
            bound = f"{verdict.lower_bound:.6g} s; no plan within the limits is as fast as this one, which breaks them"
        if verdict.proof is not None:
            bound += f", {verdict.claim.value}"
        elif verdict.claim is Claim.TABLE and not verdict.contradicted:
            bound = f"{verdict.lower_bound:.6g} s is the table's claim, not checked; if true, the gap is at most {gap}"
    else:
        bound = "none from this method"
    return Group(*lines, named("duration", time, "bold"), named("lower bound", bound))


def program_lines(path: ProgramPath) -> Iterator[Table]:
    """Lay out how the path of a part program keeps to it."""
    if path.deviation.largest > 0.0:
        far = (
            f"{_micro(path.deviation.largest)} at most, at line {path.deviation_line}; {_micro(path.tolerance)} allowed"
        )
    else:
        far = f"none; {_micro(path.tolerance)} allowed" if path.tolerance > 0.0 else "none"
    yield named("deviation", far)
    reasons: dict[str, list[int]] = {}
    for stop in path.stops:
        reasons.setdefault(stop.reason, []).append(stop.line)
    for reason, lines in reasons.items():
        shown = ", ".join(map(str, lines[:_LINES_SHOWN])) + (", ..." if len(lines) > _LINES_SHOWN else "")
        yield named("exact stops", f"{len(lines)}, {reason}: after line {shown}")


def program_summary(program: Program, path: ProgramPath) -> str:
    """What is in a program, and what the path is made of."""
    from planner.programs.reading.program import ARC

    arcs = int((program.kind == ARC).sum())
    parts = [_count(program.line_count, "line"), _count(len(program), "move") + (f" ({arcs} arcs)" if arcs else "")]
    parts += [_count(path.counts[f"{what}s"], what) for what in ("corner", "tube") if path.counts[f"{what}s"]]
    dwells = [event.seconds for event in program.events if event.kind == "dwell"]
    changes = sum(event.kind == "tool_change" for event in program.events)
    if dwells:
        parts.append(f"{_count(len(dwells), 'dwell')} ({sum(dwells):g} s, apart)")
    if changes:
        parts.append(f"{_count(changes, 'tool change')} (apart)")
    return ", ".join(parts)


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _micro(length: float) -> str:
    """A length in mm as text in um."""
    return f"{1e3 * length:.4g} um"


def _worth(profile: FeedrateProfile) -> list[Table]:
    """One line on the limits whose relaxation would save most."""
    saved = {name: 10.0 * value for name, value in profile.saved_by_one_percent.items()}
    shown = [(name, value) for name, value in saved.items() if value > _WORTH_SHOWN * profile.duration][:4]
    if not shown:
        return []
    return [named("10% more of", ", ".join(f"{name} saves {value:.3g} s" for name, value in shown))]


def _planned_in(seconds: float) -> str:
    return f", planned in {seconds:.3g} s" if math.isfinite(seconds) else ""


def named(name: str, text: str, style: str = "") -> Table:
    """Lay out one line of the verdict; a long text wraps under itself."""
    from rich.table import Table
    from rich.text import Text

    line = Table.grid(padding=(0, 2, 0, 0))
    line.add_column(width=12)
    line.add_column(overflow="fold")
    line.add_row(name, Text(text, style=style))
    return line


def _limit_table(reports: Sequence[tuple[str, Report]]) -> Table:
    """Lay out the share of each limit that is used: a row for each limit and axis, a column for each report."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="underline")
    table.add_column("limit", no_wrap=True)
    for title in ("allowed", *(title for title, _ in reports), "worst at"):
        table.add_column(title, justify="right", no_wrap=True)
    for rows in _merged(reports):
        worst = max((row for row in rows if row is not None), key=lambda row: row.ratio)
        cells = [Text(f"{worst.limit} {worst.axis}".strip()), Text(quantity(worst.allowed, worst.unit))]
        cells += [Text("") if row is None else Text(_used(row), "" if row.ok else "bold red") for row in rows]
        table.add_row(*cells, Text(f"{worst.t:.3f} s"))
    return table


def _merged(reports: Sequence[tuple[str, Report]]) -> list[list[Row | None]]:
    """The rows that are shown, in the order of the limits; of each report one, None where it has none."""
    names = dict.fromkeys((row.limit, row.axis) for _, report in reports for row in report.rows if _is_shown(row))
    order = sorted(names, key=lambda name: _LIMITS.index(name[0]) if name[0] in _LIMITS else len(_LIMITS))
    found = [{(row.limit, row.axis): row for row in report.rows} for _, report in reports]
    return [[rows.get(name) for rows in found] for name in order]


def _is_shown(row: Row) -> bool:
    return not row.ok or (row.limit in _LIMITS and math.isfinite(row.allowed))


def _reports(verdict: Verdict) -> list[tuple[str, Report]]:
    return [("plan", verdict.plan_report), ("samples", verdict.samples_report)]


def _broken(verdict: Verdict) -> str:
    """Say how many checks fail, and which is the worst."""
    found = {name: report.violations for name, report in _reports(verdict)}
    counts = ", ".join(f"{len(rows)} of the {name}" for name, rows in found.items() if rows)
    name, row = max(((name, row) for name, rows in found.items() for row in rows), key=lambda item: item[1].ratio)
    return (
        f"{counts}; the worst is {row.limit} {row.axis}".rstrip()
        + f" of the {name}: {quantity(row.worst, row.unit)} at t = {row.t:.6g} s, u = {row.u:.6g}, where "
        f"{quantity(row.allowed, row.unit)} is allowed"
    )


def _main_shares(verdict: Verdict) -> Iterator[tuple[str, float]]:
    shares = verdict.profile.shares()
    small = 0.0
    for name, share in shares.items():
        if share >= _SHARE_SHOWN:
            yield ("no limit" if name == "none" else name), share
        else:
            small += share
    if small > 0.0:
        yield "others", small


def quantity(value: float, unit: str) -> str:
    """Write a number with its unit, ``none`` for an absent limit."""
    return "none" if math.isinf(value) and value > 0.0 else f"{value:.6g} {unit}".strip()


def _used(row: Row) -> str:
    """Write the share of a limit that is used; a violation shows as one, however small."""
    if not math.isfinite(row.ratio):
        return "broken"
    if row.ratio >= 10.0:
        return f"{row.ratio:.3g} x"
    text = _percent(row.ratio)
    return f"> {text}" if not row.ok and text == _percent(1.0) else text


def _percent(share: float, digits: int = 1) -> str:
    return f"{100.0 * share + 0.0:.{digits}f}%"
