"""Times on other controllers as a person reads them, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from feedplan.controller_time import ControllerTime
from feedplan.layout import indented, named, table
from feedplan.program_time import ProgramTime
from feedplan.time_text import clock

_DIGITS = 4  # behind the point of the seconds of a line, as beside the plan


def controller_lines(found: ProgramTime, times: Sequence[ControllerTime], rows: int) -> list[str]:
    """Lay out the totals beside the plan's, the lines that the controllers take longest for, and what the models go by."""
    rests = found.total_s - found.motion_s
    cells = [["this plan", clock(found.total_s), f"{found.motion_s:.6g}", ""]]
    for row in times:
        if row.refused:
            cells.append([row.controller, "-", "-", "-"])
        else:
            ratio = f"{row.motion_s / found.motion_s:.3f}" if found.motion_s > 0.0 else "-"
            cells.append([row.controller, clock(row.motion_s + rests), f"{row.motion_s:.6g}", ratio])
    heads = ["on", "total", "motion s", "times\nthe plan"]
    parts = table(heads, cells, left=("on",))
    ran = [row for row in times if not row.refused]
    if ran and rows:
        parts += ["", *_line_table(found, ran, rows)]
    for row in times:
        parts += ["", *named(row.controller, f"cannot run it: {row.refused}" if row.refused else _settings(row))]
        parts += indented(row.measured)
    return parts


def controller_facts(found: ProgramTime, times: Sequence[ControllerTime]) -> list[dict[str, Any]]:
    """The same for a program, every line."""
    rests = found.total_s - found.motion_s
    return [
        {
            "controller": row.controller,
            "total_s": None if row.refused else row.motion_s + rests,
            "motion_s": None if row.refused else row.motion_s,
            "times_the_plan": None if row.refused or not found.motion_s else row.motion_s / found.motion_s,
            "settings": [{"key": key, "value": value, "from": place} for key, value, place in row.settings],
            "measured": row.measured,
            "refused": row.refused or None,
            "lines": [{"line": line, "seconds": seconds} for line, seconds in row.line_s.items()],
        }
        for row in times
    ]


def _settings(row: ControllerTime) -> str:
    def shown(value: float | tuple[float, ...]) -> str:
        return " ".join(f"{number:g}" for number in (value if isinstance(value, tuple) else (value,)))

    return "; ".join(f"{key} {shown(value)}, {place}" for key, value, place in row.settings)


def _line_table(found: ProgramTime, times: Sequence[ControllerTime], shown: int) -> list[str]:
    """The lines that the slowest of the controllers takes longest for, and the time of each on all."""
    plan = dict(zip(found.lines.line.tolist(), found.lines.seconds.tolist(), strict=True))
    slowest = max(times, key=lambda row: row.motion_s)
    order = sorted(slowest.line_s, key=lambda line: (-round(slowest.line_s[line], _DIGITS), line))
    columns = [plan, *(row.line_s for row in times)]
    groups = [(str(line), [line]) for line in order[:shown]]
    if order[shown:]:
        groups.append((f"{len(order) - shown} others", order[shown:]))
    cells = [
        [name, *(f"{math.fsum(column.get(line, 0.0) for line in lines):.{_DIGITS}f}" for column in columns)]
        for name, lines in groups
    ]
    return table(["line", "this plan\ns", *(f"{row.controller}\ns" for row in times)], cells, left=())
