"""The verdict as a person reads it: lines and a table for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from feedplan.layout import BOLD, GREEN, RED, Cell, indented, named, styled, table
from feedplan.verdict import Verdict, percent, side_by_side
from planner.geometry.curve import Curve
from planner.geometry.tolerance import PathTolerance
from planner.machine.limits import Limits
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.status import Claim
from planner.verify import Report, Row

if TYPE_CHECKING:
    from planner.programs.neighbours import NeighbouringPasses
    from planner.programs.path.smooth_path import ProgramPath
    from planner.programs.reading.program import Program

_SHARE_SHOWN = 0.005  # limits that hold the path back for less of the time are summed up
_WORTH_SHOWN = 1e-4  # of the duration
_NOTES_SHOWN = 8
_LINES_SHOWN = 8


def to_text(verdict: Verdict) -> list[str]:
    """Lay the verdict out in lines for a terminal of 80 columns or more."""
    parts = [
        *_facts(verdict),
        "",
        *_limit_table(verdict.reports),
        "",
        *held_back(verdict.profile.shares()),
        *_worth(verdict.profile),
        *([] if verdict.proof is None else named("proved", verdict.proof.statement)),
        *_all_named("note", _shortened(verdict.notes)),
        *_all_named("written", verdict.files),
        "",
    ]
    if verdict.ok:
        count = verdict.samples.t.size
        return [*parts, styled(f"OK  every limit holds, for the plan and for its {count} samples", GREEN)]
    if verdict.holds and verdict.proof is not None and not verdict.proof.ok:
        return [*parts, styled("NOT PROVED", RED), *indented(verdict.proof.refusal)]
    if verdict.holds:
        text = f"every limit holds, but the lower bound is {_contradiction(verdict)}"
        return [*parts, styled("BOUND CONTRADICTED", RED), *indented(text)]
    return [*parts, styled("LIMIT BROKEN", RED), *indented(_broken(verdict))]


def samples_text(profile: FeedrateProfile, samples: Samples, report: Report, apart: float, file: str) -> list[str]:
    """Lay out what the samples of a plan use of its limits; ``apart`` is their distance from the plan, mm or rad."""
    curve = profile.curve
    return [
        *named("curve", f"{curve.name}, {curve.length:.6g} mm, axes {' '.join(curve.axes)}"),
        *named("plan", f"{profile.method}, {profile.duration:.6g} s"),
        *named("samples", f"{samples.t.size}, one every {quantity(samples.period, 's')}"),
        *named("off the plan", f"{apart:.3g} at most, mm or rad on any axis"),
        "",
        *_limit_table([("samples", report)]),
        "",
        *(named("written", file) if file else []),
        *([] if report.ok else [styled("LIMIT BROKEN", RED)]),
    ]


def _all_named(name: str, texts: Iterable[str]) -> list[str]:
    return [line for text in texts for line in named(name, text)]


def _shortened(notes: list[str]) -> list[str]:
    if len(notes) <= _NOTES_SHOWN:
        return notes
    return [*notes[: _NOTES_SHOWN - 1], f"{len(notes) - _NOTES_SHOWN + 1} more notes are in --json"]


def _contradiction(verdict: Verdict) -> str:
    """Say whose error a lower bound above a sound plan is."""
    own = "an error of this program; please report it with the curve and the limits"
    claimed = verdict.profile.claim is Claim.TABLE
    return f"above the time of the plan: {'the claim of the table is false' if claimed else own}"


def _facts(verdict: Verdict) -> list[str]:
    profile, limits, curve = verdict.profile, verdict.limits, verdict.profile.curve
    time = f"{profile.duration:.6g} s"
    lines = [
        *named("curve", f"{curve.name}, {curve.length:.6g} mm, axes {' '.join(curve.axes)}"),
        *fact_lines(verdict.facts),
        *fact_lines(() if verdict.program is None else program_pairs(verdict.program)),
        *fact_lines([machine_pair(verdict.machine, limits, curve)]),
        *named("plan", f"{profile.method}, {profile.nodes} nodes" + _planned_in(verdict.planning_time)),
    ]
    if math.isfinite(verdict.gap):
        gap = percent(max(verdict.gap, 0.0) if verdict.holds else verdict.gap, 2)
        on_path = " on this path" if curve.timing is not None else ""
        bound = f"{verdict.lower_bound:.6g} s; the gap{on_path} is at most {gap}"
        if verdict.contradicted:
            above = (
                max(verdict.lower_bound, verdict.any_path) if math.isfinite(verdict.any_path) else verdict.lower_bound
            )
            bound = f"{above:.9g} s is {_contradiction(verdict)}"
        elif verdict.gap < 0.0 and not verdict.holds:
            bound = f"{verdict.lower_bound:.6g} s; no plan within the limits is as fast as this one, which breaks them"
        if verdict.proof is not None:
            bound += f", {verdict.claim.value}"
        elif verdict.claim is Claim.TABLE and not verdict.contradicted:
            bound = f"{verdict.lower_bound:.6g} s is the table's claim, not checked; if true, the gap is at most {gap}"
    else:
        bound = "none from this method"
    return [
        *lines,
        *named("duration", time, BOLD),
        *named("lower bound", bound),
        *_any_path(verdict),
        *_reserve(verdict),
        *_passes(verdict.passes),
    ]


def _any_path(verdict: Verdict) -> list[str]:
    """Lay out how much faster a motion on another path could be."""
    if math.isnan(verdict.any_path):
        return []
    less = percent(max(1.0 - verdict.any_path / verdict.profile.duration, 0.0), 2)
    said = "no motion within the tolerance and with the same stops takes less"
    return named("any path", f"{verdict.any_path:.6g} s; {said}: {less} at most is left")


def _reserve(verdict: Verdict) -> list[str]:
    """Lay out what the reserve for feed override costs, and how fast a feed hold is."""
    reserve = verdict.reserve
    if reserve is None:
        return []
    if math.isnan(reserve.without):
        cost = "what that costs is not known, as no plan without it is found that turns back where this one does"
    else:
        more = max(verdict.profile.duration - reserve.without, 0.0)
        cost = f"{quantity(more, 's')} or {percent(more / reserve.without, 2)} more than {reserve.without:.6g} s without it"
    hold = (
        f"a feed hold from full feed takes {reserve.stop_time:.3g} s"
        if math.isfinite(reserve.stop_time)
        else "too little for feed override: the feed cannot be changed within the limits"
    )
    shares = f"{percent(reserve.share)} of the jerk and {percent(reserve.share / 3.0)} of the acceleration are left"
    return named("reserve", f"{shares}, {cost}; {hold}")


def _passes(passes: NeighbouringPasses | None) -> list[str]:
    """Lay out how equal the feed is in neighbouring passes."""
    if passes is None:
        return []
    text = (
        f"feeds at the same place differ by {percent(passes.mean, 3)} on average and {percent(passes.worst, 2)} at most, "
        f"between lines {passes.lines[0]} and {passes.lines[1]} ({passes.feeds[0]:.4g} and {passes.feeds[1]:.4g} mm/s)"
    )
    return named("passes", text)


def fact_lines(facts: Iterable[tuple[str, str]]) -> list[str]:
    """Lay out what is known of where a curve comes from."""
    return [line for name, text in facts for line in named(name, text)]


def machine_pair(machine: str, limits: Limits, curve: Curve) -> tuple[str, str]:
    """Say where the limits come from, and which feed and period they have."""
    feed = f"feed {quantity(limits.feed, 'mm/s')}" if math.isfinite(limits.feed) else "no feed limit"
    if math.isfinite(limits.rapid) and curve.feed_caps is not None:
        feed += f", rapids {quantity(limits.rapid, 'mm/s')}"
    return "machine", f"{machine}; {feed}, period {quantity(limits.period, 's')}"


def program_pairs(path: ProgramPath) -> list[tuple[str, str]]:
    """Say how the path of a part program keeps to it."""
    if path.deviation.largest > 0.0:
        far = (
            f"{_micro(path.deviation.largest)} at most, at line {path.deviation_line}; {_micro(path.tolerance)} allowed"
        )
    else:
        far = f"none; {_micro(path.tolerance)} allowed" if path.tolerance > 0.0 else "none"
    found = [("path", path_made(path)), ("deviation", far)]
    within = path.curve.made_within
    if within is not None and within.side != PathTolerance.side:
        found.append(("side", f"{within.side} alone; overcut {_micro(path.overcut)}, measured"))
    reasons: dict[str, list[int]] = {}
    for stop in path.stops:
        reasons.setdefault(stop.reason, []).append(stop.line)
    for reason, lines in reasons.items():
        shown = ", ".join(map(str, lines[:_LINES_SHOWN])) + (", ..." if len(lines) > _LINES_SHOWN else "")
        found.append(("exact stops", f"{len(lines)}, {reason}: after line {shown}"))
    return found


def path_made(path: ProgramPath) -> str:
    """How the path of a program was made."""
    runs, joint = path.counts["runs"], path.counts["joint"]
    if not joint:
        return "separate, before its feed"
    return f"joint, with its feed: {'all' if joint == runs else joint} of {_count(runs, 'run')} from stop to stop"


def program_summary(program: Program, path: ProgramPath) -> str:
    """What is in a program, and what the path is made of."""
    from planner.programs.reading.program import ARC, SPLINE

    of_kinds = [(int((program.kind == kind).sum()), what) for kind, what in ((ARC, "arc"), (SPLINE, "spline"))]
    curved = ", ".join(f"{number} {what}s" for number, what in of_kinds if number)
    parts = [_count(program.line_count, "line"), _count(len(program), "move") + (f" ({curved})" if curved else "")]
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


def _worth(profile: FeedrateProfile) -> list[str]:
    """One line on the limits whose relaxation would save most."""
    saved = {name: 10.0 * value for name, value in profile.saved_by_one_percent.items()}
    shown = [(name, value) for name, value in saved.items() if value > _WORTH_SHOWN * profile.duration][:4]
    if not shown:
        return []
    return named("10% more of", ", ".join(f"{name} saves {value:.3g} s" for name, value in shown))


def _planned_in(seconds: float) -> str:
    return f", planned in {seconds:.3g} s" if math.isfinite(seconds) else ""


def _limit_table(reports: Sequence[tuple[str, Report]]) -> list[str]:
    """Lay out the share of each limit that is used: a row for each limit and axis, a column for each report."""
    heads = ["limit", "allowed", *(title for title, _ in reports), "worst at"]
    lines: list[list[str | Cell]] = []
    for rows in side_by_side(reports):
        worst = max((row for row in rows if row is not None), key=lambda row: row.ratio)
        used = ["" if row is None else Cell(_used(row), "" if row.ok else RED) for row in rows]
        name = f"{worst.limit} {worst.axis}".strip()
        lines.append([name, quantity(worst.allowed, worst.unit), *used, f"{worst.t:.3f} s"])
    return table(heads, lines, left=("limit",))


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


def held_back(shares: Mapping[str, float]) -> list[str]:
    """Lay out which limit holds a plan back for which share of the time; the shares add up to all of it."""
    return named("held back by", ", ".join(f"{name} {percent(share)}" for name, share in _main_shares(shares)))


def _main_shares(shares: Mapping[str, float]) -> Iterator[tuple[str, float]]:
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
