"""The time of a part program as a person reads it, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from feedplan.layout import BOLD, RED, indented, named, styled, table, width
from feedplan.limit_costs import MORE
from feedplan.program_time import ProgramTime
from feedplan.verdict import percent
from feedplan.verdict_text import fact_lines
from planner.programs.operations import SectionTime
from planner.programs.times import KINDS, LineTimes
from planner.quantity import NONE

_DIGITS = 4  # behind the point of the seconds that are shown
_SECTIONS_SHOWN = 30
_NAME_SHOWN = 28  # characters of an operation, or a tool
_MIN_TEXT = 8  # characters of a line
_LIMITS_SHOWN = 0.005  # of the time, held back or saved
_PERCENT = round(100 * MORE)  # that a limit is raised by, for what it costs
_MINUTE = 60.0


def time_text(found: ProgramTime, rows: int = 12, files: Sequence[str] = ()) -> list[str]:
    """Lay out operations, tools, the longest lines, the totals, and what each limit costs; ``files`` were written."""
    parts = [*fact_lines(found.facts), ""]
    if found.named:
        parts += [*_section_table(found.operations, found.total_s, "operation"), ""]
    if found.tool_changes:
        parts += [*_section_table(found.tools, found.total_s, "tool"), ""]
    parts += [*_line_table(found, rows), "", *_limit_table(found), ""]
    parts += named("total", f"{clock(found.total_s)} or {found.total_s:.6g} s", BOLD)
    parts += named("motion", f"{found.motion_s:.6g} s")
    if found.dwell_s:
        parts += named("dwells", f"{found.dwell_s:.6g} s")
    for name, count, each, option in (
        ("tool changes", found.tool_changes, found.tool_change_s, ": --tool-change-s"),
        ("spindle", found.spindle_starts, found.rests.spindle_start, ""),
    ):
        if count and (each is not None or option):
            parts += named(name, _rests(count, each, option))
    if found.waits:
        parts += named("waits", f"{found.waits} for a person (M0, M1, M60), not in the total")
    parts += [*named("jerk limit", _cost(found)), *fact_lines(("note", note) for note in found.notes)]
    for file in files:
        parts += named("written", file)
    if not found.ok:
        parts.append(styled(f"LIMIT BROKEN  {found.worst}", RED))
    return parts


def clock(seconds: float) -> str:
    """Write a time as h:mm:ss, rounded to the second."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def _rests(count: int, each: float | None, option: str) -> str:
    if each is None:
        return f"{count}; not in the total, for nobody says how long one takes{option}"
    return f"{count * each:.6g} s, {count} of {each:.6g} s"


def _section_table(sections: Sequence[SectionTime], total: float, what: str) -> list[str]:
    """Lay out what operations or tools take; of very many those that take longest, in the order of the run."""
    longest = sorted(range(len(sections)), key=lambda k: -sections[k].total_s)[:_SECTIONS_SHOWN]
    shown = [sections[k] for k in sorted(longest)]
    rest = [sections[k] for k in range(len(sections)) if k not in longest]
    names = [_cut(_title(section, what), _NAME_SHOWN) for section in shown]
    columns: dict[str, list[str]] = {what: [*names, *([f"{len(rest)} others"] if rest else [])]}
    groups = [[section] for section in shown] + ([rest] if rest else [])
    if what == "operation":
        columns["tool"] = ["" if len(g) > 1 or g[0].tool is None else f"T{g[0].tool}" for g in groups]
    seconds = [math.fsum(section.total_s for section in group) for group in groups]
    columns["starts"] = [clock(group[0].start_s) if len(group) == 1 else "" for group in groups]
    columns["time"] = [clock(value) for value in seconds]
    columns["seconds"] = [f"{value:.2f}" for value in seconds]
    columns["%"] = [f"{100.0 * value / total:.1f}" if total > 0.0 else "" for value in seconds]
    columns["held back by"] = [_main_limit(group[0].shares) if len(group) == 1 else "" for group in groups]
    return table(list(columns), list(zip(*columns.values(), strict=True)), left=(what, "tool", "held back by"))


def _title(section: SectionTime, what: str) -> str:
    if what == "operation":
        return section.name or "before the first"
    return "no tool yet" if section.tool is None else f"T{section.tool} {section.name}".strip()


def _main_limit(shares: Mapping[str, float]) -> str:
    name, share = next(iter(shares.items()), ("no limit", 0.0))
    return f"{name} {100.0 * share:.0f}%" if share else name


def _line_table(found: ProgramTime, shown: int) -> list[str]:
    """Lay the longest lines out, with what the others take together and the total."""
    times, without = found.lines, found.without_jerk
    taken = times.seconds + times.rest
    # Lines of which the same time is shown stand in the order of the program.
    order = np.argsort(-np.round(taken, _DIGITS), kind="stable")
    count = min(shown, order.size)
    groups = [*(order[k : k + 1] for k in range(count)), *([order[count:]] if order.size > count else []), order]
    single = [int(group[0]) if k < count else -1 for k, group in enumerate(groups)]
    columns: dict[str, list[str]] = {
        "line": [str(times.line[k]) for k in single if k >= 0]
        + ([f"{order.size - count} others"] if order.size > count else [])
        + ["all"],
        "text": [],
        "starts": ["" if k < 0 else f"{times.start[k]:.2f}" for k in single],
        "seconds": [f"{math.fsum(taken[group]):.{_DIGITS}f}" for group in groups],
        "no jerk\nlimit": [],
        "feed\nmm/min": [
            "" if k < 0 or not times.seconds[k] else f"{_MINUTE * times.mean_feed[k]:.0f}" for k in single
        ],
        "held back by": ["" if k < 0 or not times.seconds[k] else _limit_of(times, k) for k in single],
    }
    if without is None:
        del columns["no jerk\nlimit"]
    else:
        least = without.seconds + without.rest
        columns["no jerk\nlimit"] = [f"{math.fsum(least[group]):.{_DIGITS}f}" for group in groups]
    used = sum(max(map(len, [*head.split("\n"), *cells])) + 2 for head, cells in columns.items() if head != "text")
    room = max(width() - used, _MIN_TEXT)
    columns["text"] = ["" if k < 0 else _cut(found.text.shown(int(times.line[k])), room) for k in single]
    return table(list(columns), list(zip(*columns.values(), strict=True)), left=("text", "held back by"))


def _cut(text: str, room: int) -> str:
    return text if len(text) <= room else text[: room - 3] + "..."


def _limit_of(times: LineTimes, row: int) -> str:
    name = times.limit_names[times.binding[row]] if times.binding[row] else "no limit"
    return f"{name} {100.0 * times.share[row]:.0f}%" if times.binding[row] else name


def _limit_table(found: ProgramTime) -> list[str]:
    """Lay out for which share of the motion each limit holds the program back, and what more of it saves where known."""
    measured = {cost.limit: cost for cost in found.costs}
    estimated = {} if measured else {name: _PERCENT * value for name, value in found.saved_by_one_percent.items()}
    worth = {name: cost.saved_s for name, cost in measured.items()} | estimated
    least = _LIMITS_SHOWN * found.motion_s
    every = dict.fromkeys([*found.shares, *worth])
    shown = [
        n for n in every if found.shares.get(n, 0.0) >= _LIMITS_SHOWN or n in measured or worth.get(n, 0.0) >= least
    ]
    others = [name for name in every if name not in shown]
    columns: dict[str, list[str]] = {"held back by": ["no limit" if name == NONE else name for name in shown]}
    columns["of the\nmotion"] = [percent(found.shares.get(name, 0.0)) for name in shown]
    if others:
        columns["held back by"].append("others")
        columns["of the\nmotion"].append(percent(math.fsum(found.shares.get(name, 0.0) for name in others)))
    if worth:
        about = "saves, s" if measured else "saves about, s"
        blank = [""] * bool(others)
        saved = [worth.get(name, math.nan) for name in shown]
        columns[f"{_PERCENT}% more\n{about}"] = ["" if math.isnan(x) else f"{x + 0.0:.4f}" for x in saved] + blank
        shares = [x / found.motion_s if found.motion_s else math.nan for x in saved]
        columns["of the\ntime"] = ["" if math.isnan(x) else percent(x) for x in shares] + blank
    lines = table(list(columns), list(zip(*columns.values(), strict=True)), left=("held back by",))
    for cost in found.costs:
        if not cost.ok:
            lines += indented(f"with {_PERCENT}% more {cost.limit}: {cost.reason}")
    return lines


def _cost(found: ProgramTime) -> str:
    """What the jerk limit costs against the least time of the same path without one."""
    if not found.jerk_limited:
        return "none is set: the times are the least that the accelerations allow"
    if found.without_jerk is None:
        return f"what it costs is not known: {found.why_none}" if found.why_none else "what it costs was not asked for"
    least = found.without_jerk.moving
    return (
        f"costs {found.motion_s - least:.4g} s or {100.0 * found.jerk_share:.1f}% of the {least:.6g} s that the "
        "same path takes at best without one"
    )


def time_facts(found: ProgramTime) -> dict[str, Any]:
    """The same for a program, every line."""
    return {
        "ok": found.ok,
        "program": {"file": found.program, **found.path_facts},
        "machine": found.machine,
        "total": clock(found.total_s),
        "total_s": found.total_s,
        "motion_s": found.motion_s,
        "dwell_s": found.dwell_s,
        "tool_changes": found.tool_changes,
        "tool_change_s": found.tool_change_s,
        "spindle_starts": found.spindle_starts,
        "spindle_start_s": found.rests.spindle_start,
        "waits": found.waits,
        "without_jerk_limit_s": None if found.without_jerk is None else found.without_jerk.moving,
        "jerk_limit_costs": None if math.isnan(found.jerk_share) else found.jerk_share,
        "held_back_by": dict(found.shares),
        "saved_by_one_percent_s": dict(found.saved_by_one_percent),
        "costs": [
            {
                "limit": cost.limit,
                "more_percent": _PERCENT,
                "saved_s": None if math.isnan(cost.saved_s) else cost.saved_s,
                "ok": cost.ok,
                "reason": cost.reason,
            }
            for cost in found.costs
        ],
        "operations_named": found.named,
        "operations": [_section_facts(section) for section in found.operations],
        "tools": [_section_facts(section) for section in found.tools],
        "notes": list(found.notes),
        "lines": _line_facts(found),
    }


def _section_facts(section: SectionTime) -> dict[str, Any]:
    return {
        "name": section.name,
        "tool": section.tool,
        "line": section.line,
        "start_s": section.start_s,
        "total": clock(section.total_s),
        "total_s": section.total_s,
        "motion_s": section.motion_s,
        "rapid_s": section.rapid_s,
        "dwell_s": section.dwell_s,
        "change_s": section.change_s,
        "spindle_s": section.spindle_s,
        "tool_changes": section.tool_changes,
        "length_mm": section.length_mm,
        "held_back_by": dict(section.shares),
    }


def _line_facts(found: ProgramTime) -> list[dict[str, Any]]:
    """The columns of the file of lines; a feed that no line has is None."""
    times = found.lines
    columns: dict[str, list[Any]] = {name: values.tolist() for name, values in times.columns().items()}
    columns["kind"] = [KINDS[k] for k in times.kind]
    columns["held_back_by"] = [times.limit_names[k] for k in times.binding]
    for name in [name for name in columns if name.endswith("feed_mm_min")]:
        columns[name] = [value or None for value in columns[name]]
    least = found.without_jerk
    columns["without_jerk_limit_s"] = [None] * times.line.size if least is None else least.seconds.tolist()
    columns["n_word"] = [found.text.number_word(line) for line in columns["line"]]
    columns["text"] = [found.text.shown(line) for line in columns["line"]]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
