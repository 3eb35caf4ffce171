"""The time of a part program as a person reads it, and as JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from feedplan.layout import BOLD, RED, named, styled, table
from feedplan.program_time import ProgramTime
from feedplan.verdict_text import fact_lines, held_back
from planner.programs.times import KINDS, LineTimes

_DIGITS = 4  # behind the point of the seconds that are shown


def time_text(found: ProgramTime, rows: int = 12, file: str = "") -> list[str]:
    """Lay out the longest lines, the totals, and what the jerk limit costs; ``file`` is what was written."""
    parts = [*fact_lines(found.facts), "", *_line_table(found.lines, found.without_jerk, rows), ""]
    parts += named("total", f"{clock(found.total_s)} or {found.total_s:.6g} s", BOLD)
    parts += named("motion", f"{found.motion_s:.6g} s")
    if found.dwell_s:
        parts += named("dwells", f"{found.dwell_s:.6g} s")
    if found.tool_changes:
        parts += named("tool changes", _changes(found))
    parts += [
        *named("jerk limit", _cost(found)),
        *held_back(found.shares),
        *fact_lines(("note", note) for note in found.notes),
    ]
    if file:
        parts += named("written", file)
    if not found.ok:
        parts.append(styled(f"LIMIT BROKEN  {found.worst}", RED))
    return parts


def clock(seconds: float) -> str:
    """Write a time as h:mm:ss, rounded to the second."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def _changes(found: ProgramTime) -> str:
    count = found.tool_changes
    if found.tool_change_s is None:
        return f"{count}; not in the total, for nobody says how long one takes: --tool-change-s"
    return f"{count * found.tool_change_s:.6g} s, {count} of {found.tool_change_s:.6g} s"


def _line_table(times: LineTimes, without: LineTimes, shown: int) -> list[str]:
    """Lay the longest lines out, with what the others take together and the total."""
    # Lines of which the same time is shown stand in the order of the program.
    order = np.argsort(-np.round(times.seconds + times.dwell, _DIGITS), kind="stable")
    groups = [order[k : k + 1] for k in range(min(shown, order.size))]
    if order.size > shown:
        groups.append(order[shown:])
    groups.append(order)
    columns: dict[str, list[str]] = {
        "line": [
            *(str(times.line[group[0]]) for group in groups[: min(shown, order.size)]),
            *([f"{order.size - shown} others"] if order.size > shown else []),
            "all",
        ],
        "kind": [KINDS[times.kind[group[0]]] if group.size == 1 else "" for group in groups],
        "mm": [f"{times.length[group].sum():.3f}" for group in groups],
        "seconds": [f"{math.fsum(times.seconds[group]):.{_DIGITS}f}" for group in groups],
        "no jerk\nlimit": [f"{math.fsum(without.seconds[group]):.{_DIGITS}f}" for group in groups],
    }
    single = [int(group[0]) if group.size == 1 and times.seconds[group[0]] > 0.0 else -1 for group in groups]
    columns["held back by"] = ["" if k < 0 else _limit_name(times, k) for k in single]
    columns["share"] = ["" if k < 0 or not times.binding[k] else f"{100.0 * times.share[k]:.0f}%" for k in single]
    if times.dwell.any():
        dwells = [float(times.dwell[group].sum()) for group in groups]
        columns["dwell\ns"] = [f"{dwell:.4g}" if dwell else "" for dwell in dwells]
    if times.changes:
        changes = [int(times.tool_changes[group].sum()) for group in groups]
        columns["tool\nchanges"] = [str(count) if count else "" for count in changes]
    return table(list(columns), list(zip(*columns.values(), strict=True)), left=("kind", "held back by"))


def _limit_name(times: LineTimes, row: int) -> str:
    return times.limit_names[times.binding[row]] if times.binding[row] else "no limit"


def _cost(found: ProgramTime) -> str:
    """What the jerk limit costs against the least time of the same path without one."""
    if not found.jerk_limited:
        return "none is set: the times are the least that the accelerations allow"
    least = found.without_jerk.moving
    return (
        f"costs {found.motion_s - least:.4g} s or {100.0 * found.jerk_share:.1f}% of the {least:.6g} s that the "
        "same path takes at best without one"
    )


def time_facts(found: ProgramTime) -> dict[str, Any]:
    """The same for a program, every line."""
    times, without = found.lines, found.without_jerk
    columns: dict[str, list[Any]] = {
        "line": times.line.tolist(),
        "kind": [KINDS[k] for k in times.kind],
        "length_mm": times.length.tolist(),
        "seconds": times.seconds.tolist(),
        "without_jerk_limit_s": without.seconds.tolist(),
        "held_back_by": [times.limit_names[k] for k in times.binding],
        "share": times.share.tolist(),
        "dwell_s": times.dwell.tolist(),
        "tool_changes": times.tool_changes.tolist(),
    }
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
        "without_jerk_limit_s": without.moving,
        "jerk_limit_costs": found.jerk_share,
        "notes": list(found.notes),
        "lines": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
    }
