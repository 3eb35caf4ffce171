"""The verdict as a person reads it: lines and a table for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from feedplan.verdict import Verdict, percent, side_by_side
from planner.geometry.curve import Curve
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.status import Claim
from planner.verify import Report, Row

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from planner.programs.path.smooth_path import ProgramPath
    from planner.programs.reading.program import Program

_SHARE_SHOWN = 0.005  # limits that hold the path back for less of the time are summed up
_WORTH_SHOWN = 1e-4  # of the duration
_NOTES_SHOWN = 8
_LINES_SHOWN = 8


def to_text(verdict: Verdict) -> RenderableType:
    """Lay the verdict out for a terminal of 80 columns or more."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    parts: list[RenderableType] = [
        _facts(verdict),
        "",
        _limit_table(verdict.reports),
        "",
        held_back(verdict.profile),
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
    time = f"{profile.duration:.6g} s"
    lines = [
        named("curve", f"{curve.name}, {curve.length:.6g} mm, axes {' '.join(curve.axes)}"),
        *(named(name, text) for name, text in verdict.facts),
        *([] if verdict.program is None else program_lines(verdict.program)),
        machine_line(verdict.machine, limits, curve),
        named("plan", f"{profile.method}, {profile.nodes} nodes" + _planned_in(verdict.planning_time)),
    ]
    if math.isfinite(verdict.gap):
        gap = percent(max(verdict.gap, 0.0) if verdict.holds else verdict.gap, 2)
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


def machine_line(machine: str, limits: Limits, curve: Curve) -> Table:
    """Lay out where the limits come from, and which feed and period they have."""
    feed = f"feed {quantity(limits.feed, 'mm/s')}" if math.isfinite(limits.feed) else "no feed limit"
    if math.isfinite(limits.rapid) and curve.feed_caps is not None:
        feed += f", rapids {quantity(limits.rapid, 'mm/s')}"
    return named("machine", f"{machine}; {feed}, period {quantity(limits.period, 's')}")


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
    for rows in side_by_side(reports):
        worst = max((row for row in rows if row is not None), key=lambda row: row.ratio)
        cells = [Text(f"{worst.limit} {worst.axis}".strip()), Text(quantity(worst.allowed, worst.unit))]
        cells += [Text("") if row is None else Text(_used(row), "" if row.ok else "bold red") for row in rows]
        table.add_row(*cells, Text(f"{worst.t:.3f} s"))
    return table


def _broken(verdict: Verdict) -> str:
    """Say how many checks fail, and which is the worst."""
    found = {name: report.violations for name, report in verdict.reports}
    counts = ", ".join(f"{len(rows)} of the {name}" for name, rows in found.items() if rows)
    name, row = max(((name, row) for name, rows in found.items() for row in rows), key=lambda item: item[1].ratio)
    return (
        f"{counts}; the worst is {row.limit} {row.axis}".rstrip()
        + f" of the {name}: {quantity(row.worst, row.unit)} at t = {row.t:.6g} s, u = {row.u:.6g}, where "
        f"{quantity(row.allowed, row.unit)} is allowed"
    )


def held_back(profile: FeedrateProfile) -> Table:
    """Lay out which limit holds a plan back for which share of the time; the shares add up to all of it."""
    return named("held back by", ", ".join(f"{name} {percent(share)}" for name, share in _main_shares(profile)))


def _main_shares(profile: FeedrateProfile) -> Iterator[tuple[str, float]]:
    shares = profile.shares()
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
    text = percent(row.ratio)
    return f"> {text}" if not row.ok and text == percent(1.0) else text
