"""The time of a part program written back into it, as comments.

    (feedplan: time 0:12:40, 759.91 s)
    (feedplan: time of motion 741.4 s, dwells 2.5 s, 2 tool changes 16 s)
    ...
    (2D Adaptive1)
    (feedplan: time 0:07:02, 421.77 s, of this operation)

1.  The first stand at the head of the program, behind a %, an O number and a byte order mark; the others behind the comments
    that begin the operations.
2.  Comments are in parentheses, or behind a semicolon where that is all the program itself uses.
3.  Those of an earlier time are taken out first.  Every other byte stays: encoding, line ends, numbers, blank lines.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from feedplan.program_time import ProgramTime
from feedplan.time_text import clock
from planner.files.whole_file import whole_file

_SAYS = "feedplan: time "
_OURS = re.compile(
    rb"[ \t]*(?:N[ \t]*[\d.]+[ \t]*)?(?:\(feedplan: time [^()\r\n]*\)|; feedplan: time [^\r\n]*)[ \t]*\r?\n?"
)
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_PERCENT = re.compile(rb"[ \t]*%[ \t]*\r?\n")
_NUMBER = re.compile(rb"[ \t]*[O:]\d+[ \t]*(?:\([^()\r\n]*\))?[ \t]*\r?\n", re.IGNORECASE)


def write_with_time(file: str | Path, found: ProgramTime) -> None:
    """Write the program with its time in comments, whole or not at all; raises InputError where that cannot be."""
    with whole_file(file) as target:
        target.write(program_with_time(found))


def program_with_time(found: ProgramTime) -> bytes:
    """The bytes of a program with the comments above, in place of those of an earlier time."""
    raw = found.text.raw
    mark = _BYTE_ORDER_MARK if raw.startswith(_BYTE_ORDER_MARK) else b""
    lines = re.findall(rb"[^\n]*\n|[^\n]+", raw[len(mark) :])  # as the reader counts them: LF alone ends a line
    end = b"\r\n" if lines and lines[0].endswith(b"\r\n") else b"\n"
    semicolon = b";" in raw and b"(" not in raw
    behind: dict[int, list[str]] = {}
    for part in found.operations if found.named else ():
        if part.name:
            behind[part.line] = [f"{clock(part.total_s)}, {part.total_s:.2f} s, of this operation"]
    kept: list[tuple[int, bytes]] = [(k, line) for k, line in enumerate(lines, 1) if not _OURS.fullmatch(line)]
    head = _head([line for _, line in kept])
    out = [mark]
    for place, (number, line) in enumerate([*kept, (0, b"")]):
        if place == head:
            out += _comments(_totals(found), semicolon, end)
        out.append(line)
        out += _comments(behind.get(number, ()), semicolon, end)
    return b"".join(out)


def _head(lines: Sequence[bytes]) -> int:
    """Behind how many lines the time stands: a % and an O number come first."""
    place = 0
    while place < len(lines) and not lines[place].strip():
        place += 1
    if place < len(lines) and _PERCENT.fullmatch(lines[place]):
        place += 1
    else:
        place = 0
    return place + 1 if place < len(lines) and _NUMBER.fullmatch(lines[place]) else place


def _totals(found: ProgramTime) -> list[str]:
    parts = [f"of motion {found.motion_s:.2f} s"]
    if found.dwell_s:
        parts.append(f"dwells {found.dwell_s:.2f} s")
    if found.tool_changes:
        count = f"{found.tool_changes} tool change" + ("s" if found.tool_changes > 1 else "")
        parts.append(f"{count} not counted" if found.tool_change_s is None else f"{count} {found.change_s:.2f} s")
    if found.spindle_s:
        parts.append(f"spindle starts {found.spindle_s:.2f} s")
    return [f"{clock(found.total_s)}, {found.total_s:.2f} s", ", ".join(parts)]


def _comments(texts: Sequence[str], semicolon: bool, end: bytes) -> list[bytes]:
    form = "; {}{}" if semicolon else "({}{})"
    return [form.format(_SAYS, text).encode("ascii") + end for text in texts]
