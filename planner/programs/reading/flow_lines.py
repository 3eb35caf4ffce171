"""A file as runs of plain text and lines with parameters, expressions and O words, of which it is known where they lead."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from planner.errors import InputError
from planner.programs.reading.words import Words, scan_text, text_parts

_O_LINE = re.compile(rb"^[ \t]*(?:N[ \t]*[\d.]+[ \t]*)?O[^\n]*", re.IGNORECASE | re.MULTILINE)
_OTHER_LINE = re.compile(rb"^[^\n]*[#\[@^][^\n]*", re.MULTILINE)
_CALL_LINE = re.compile(rb"^[^\n]*M(?:9[89]|7[0-3])[^\n]*", re.IGNORECASE | re.MULTILINE)
_COMMENT = re.compile(rb"\([^()\n]*\)|;[^\n]*")
_O_WORD = re.compile(
    r"(?:N[\d.]+)?O(\d+|<[^<>]*>)(SUB|ENDSUB|CALL|RETURN|IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|DO|REPEAT|ENDREPEAT|BREAK|CONTINUE)?"
    r"(.*)"
)
_CALLS = re.compile(r"M(?:9[89]|7[0-3])(?!\d|\.\d)")
_OPENED_BY = {"ENDSUB": "SUB", "ENDIF": "IF", "ELSE": "IF", "ELSEIF": "IF", "ENDWHILE": "WHILE", "ENDREPEAT": "REPEAT"}
_LOOPS = ("WHILE", "DO", "REPEAT")
_WITH_ARGUMENTS = ("CALL", "RETURN", "ENDSUB", "IF", "ELSEIF", "WHILE", "REPEAT")


@dataclass
class FlowLine:
    """A line that is evaluated, in capitals, without spaces and comments.

    ``keyword`` is None for a line of words and "" for an O word alone; ``partner`` the index of the item where it leads: the
    other end of a loop or of an if, or behind it.
    """

    line: int
    text: str
    keyword: str | None = None
    label: str = ""
    arguments: str = ""
    partner: int = -1
    branches: list[int] = field(default_factory=list)
    fault: str = ""  # said where the line is run


@dataclass(frozen=True)
class PlainLines:
    """A run of lines that need no evaluation."""

    text: bytes
    first_line: int
    source: str

    @cached_property
    def scanned(self) -> tuple[Words, InputError | None]:
        """The words, and the error of the first character that fits nowhere, if any."""
        return scan_text(self.text, self.source, self.first_line - 1)


@dataclass
class Listing:
    """A file: its items in their order, and where subroutines begin, by their labels."""

    name: str
    items: list[FlowLine | PlainLines]
    begins: dict[str, int]
    line_count: int


def flow_lines(text: bytes) -> list[tuple[int, int]]:
    """Where the lines stand that need evaluation: offsets of their first and behind their last character."""
    patterns = []
    if b"O" in text or b"o" in text:
        patterns.append(_O_LINE)
    if any(sign in text for sign in (b"#", b"[", b"@", b"^")):
        patterns.append(_OTHER_LINE)
    if any(call in text for call in (b"M9", b"M7", b"m9", b"m7")):
        patterns.append(_CALL_LINE)
    found = {match.span() for pattern in patterns for match in pattern.finditer(text)}
    return sorted(span for span in found if _is_flow(_bare(text[slice(*span)])))


def _bare(line: bytes) -> str:
    """A line in capitals, without spaces and comments."""
    return "".join(_COMMENT.sub(b"", line).decode("latin-1").upper().split())


def _is_flow(line: str) -> bool:
    if line.startswith("/"):
        return False
    return any(sign in line for sign in "#[@^") or _O_WORD.match(line) is not None or _CALLS.search(line) is not None


def read_listing(path: Path) -> Listing:
    """Read a file and find where its O words lead.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    try:
        with open(path, "rb") as file:
            parts = list(text_parts(file))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
    text = b"".join(part for part, _ in parts)
    count = text.count(b"\n") + (not text.endswith(b"\n"))
    if parts and parts[-1][1]:
        raise InputError(f"{path.name}:{count}: end of part: {parts[-1][1]}")
    items: list[FlowLine | PlainLines] = []
    at = line = 0
    for first, last in flow_lines(text):
        _add_plain(items, text[at:first], line, path.name)
        line += text.count(b"\n", at, first)
        items.append(_flow_line(_bare(text[first:last]), line + 1))
        at = last + 1
        line += 1
    _add_plain(items, text[at:], line, path.name)
    return Listing(path.name, items, _linked(items), count)


def _add_plain(items: list[FlowLine | PlainLines], text: bytes, lines_before: int, source: str) -> None:
    if text.strip():
        items.append(PlainLines(text, lines_before + 1, source))


def _flow_line(text: str, line: int) -> FlowLine:
    match = _O_WORD.fullmatch(text)
    if match is None:
        return FlowLine(line, text)
    label = match[1].strip("<>").lower()
    return FlowLine(line, text, match[2] or "", label.lstrip("0") or "0" if label.isdigit() else label, match[3])


def _linked(items: list[FlowLine | PlainLines]) -> dict[str, int]:
    """Find the other end of every O word; returns where subroutines begin."""
    open_items: list[int] = []
    begins: dict[str, int] = {}
    for index, item in enumerate(items):
        if not isinstance(item, FlowLine) or item.keyword is None:
            continue
        if item.arguments and item.keyword not in _WITH_ARGUMENTS:
            item.fault = "nothing belongs behind it; O words are sub, call, if, while, do, repeat ..."
        if item.keyword in ("", "SUB"):
            if item.label in begins and item.keyword == "SUB":
                item.fault = "there is a subroutine of this label already"
            begins.setdefault(item.label, index + 1)
        if item.keyword == "WHILE" and _closes_do(items, open_items, item):
            item.keyword, item.partner = "UNTIL", open_items.pop()
            _opener(items, item.partner).partner = index
        elif item.keyword in ("SUB", "IF", *_LOOPS):
            open_items.append(index)
        elif item.keyword in ("BREAK", "CONTINUE"):
            item.branches = _loop_around(items, open_items, item)
        elif item.keyword in _OPENED_BY:
            _close(items, open_items, index)
    for index in open_items:
        _opener(items, index).fault = "is not closed"
    _link_jumps(items)
    return begins


def _loop_around(items: list[FlowLine | PlainLines], open_items: list[int], item: FlowLine) -> list[int]:
    """The loop that a break or a continue is in."""
    for index in reversed(open_items):
        loop = _opener(items, index)
        if loop.label == item.label and loop.keyword in _LOOPS:
            return [index]
    item.fault = "is in no loop of this label"
    return []


def _opener(items: list[FlowLine | PlainLines], index: int) -> FlowLine:
    item = items[index]
    if not isinstance(item, FlowLine):
        raise AssertionError("only an O word opens")
    return item


def _closes_do(items: list[FlowLine | PlainLines], open_items: list[int], item: FlowLine) -> bool:
    last = _opener(items, open_items[-1]) if open_items else None
    return last is not None and last.keyword == "DO" and last.label == item.label


def _close(items: list[FlowLine | PlainLines], open_items: list[int], index: int) -> None:
    """An O word that belongs to the one opened last."""
    item = _opener(items, index)
    key = item.keyword or ""
    opener = _opener(items, open_items[-1]) if open_items else None
    if opener is None or (opener.keyword, opener.label) != (_OPENED_BY[key], item.label):
        item.fault = f"closes no {_OPENED_BY[key].lower()} of this label"
        return
    if key in ("ELSE", "ELSEIF"):
        opener.branches.append(index)
        return
    item.partner = open_items.pop()
    opener.partner = index + 1 if key == "ENDSUB" else index
    for branch in opener.branches:
        _opener(items, branch).partner = index + 1


def _link_jumps(items: list[FlowLine | PlainLines]) -> None:
    """Where break and continue lead."""
    for item in items:
        if isinstance(item, FlowLine) and item.keyword in ("BREAK", "CONTINUE") and item.branches:
            begin = item.branches[0]
            loop = _opener(items, begin)
            item.partner = (
                loop.partner + 1 if item.keyword == "BREAK" else begin if loop.keyword == "WHILE" else loop.partner
            )
