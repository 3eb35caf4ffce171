"""What a program counts on that does not stand in it: the tools of the machine."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from planner.errors import InputError
from planner.geometry.curve import AXES
from planner.inputs import require_path, shorten

_ENTRY = re.compile(r"([A-Z])([-+]?\d*\.?\d+(?:E[-+]?\d+)?|[-+]?\d+\.)", re.IGNORECASE)


@dataclass(frozen=True)
class Tool:
    """A tool: its offsets along X Y Z A B C U V W, mm and degrees, or those of the first of them; its diameter, mm; of a
    lathe tool the orientation; and what the table calls it.

    An orientation is LinuxCNC's: 1 to 8 are the sides on which the tool is, 0 and 9 its middle.
    """

    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    diameter: float = 0.0
    orientation: int = 0
    name: str = ""


def read_tool_table(path: str | Path) -> Mapping[int, Tool]:
    """Read a tool table of LinuxCNC, ``.tbl``: a line for each tool, ``T1 P1 Z40.2 D6 ;6 mm end mill``, in mm.

    Raises
    ------
    InputError
        ``file:line: word: reason`` where it is none.
    """
    file = require_path(path)
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
    except OSError as problem:
        raise InputError(f"{file}: cannot be read ({problem.strerror})") from None
    tools: dict[int, Tool] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split(";")[0].split()
        if not words:
            continue
        entries = _entries(f"{file.name}:{number}", words)
        if "T" not in entries:
            raise InputError(f"{file.name}:{number}: {shorten(line.strip())}: a line of a tool table needs a T word")
        tool = entries["T"]
        if tool != int(tool) or tool < 0:
            raise InputError(
                f"{file.name}:{number}: T{tool:g}: the number of a tool must be a whole number of at least 0"
            )
        if int(tool) in tools:
            raise InputError(f"{file.name}:{number}: T{tool:g}: the tool is in the table already")
        offset = [entries.get(axis, 0.0) for axis in AXES]
        orientation = entries.get("Q", 0.0)
        if orientation not in range(10):
            raise InputError(
                f"{file.name}:{number}: Q{orientation:g}: the orientation of a tool is a whole number from 0 to 9"
            )
        tools[int(tool)] = Tool(
            tuple(offset if any(offset[3:]) else offset[:3]),
            entries.get("D", 0.0),
            int(orientation),
            line.partition(";")[2].strip(),
        )
    if not tools:
        raise InputError(f"{file.name}:1: end of file: there is no tool in the table; give a line T1 P1 Z40 for each")
    return tools


def _entries(place: str, words: list[str]) -> dict[str, float]:
    entries: dict[str, float] = {}
    for word in words:
        match = _ENTRY.fullmatch(word)
        if match is None:
            raise InputError(
                f"{place}: {shorten(word)}: no word of a tool table, which has lines as T1 P1 Z40.2 D6 ;name"
            )
        entries[match[1].upper()] = float(match[2])
    return entries
