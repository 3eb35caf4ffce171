"""What a part program, or the tool table of its machine, calls the tools.

The tool table comes first; then the comment behind a tool change in its own line; then a comment that stands alone: one
that begins with the tool, ``(T1 D=6. - flat end mill)`` or ``(T1: 6 mm end mill)``, one of a list of tools,
``(1 = End Mill {6 mm})``, or ``(Tool: End Mill)`` beside the change.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from planner.programs.operations import tool_number
from planner.programs.program_text import ProgramText
from planner.programs.reading.program import Program
from planner.programs.reading.setup import Tool

_OF_TOOL = re.compile(r"T(?:ool)?\s*(?P<number>\d+)\s*[:=-]?\s*(?P<name>.*\w.*)", re.IGNORECASE)
_LISTED = re.compile(r"(?P<number>\d+)\s*=\s*(?P<name>.*[A-Za-z].*)")
_BESIDE = re.compile(r"tool(?:\s*name)?\s*:\s*(?P<name>.*\w.*)", re.IGNORECASE)
_NEAR = 2  # lines from a tool change to the comment that names its tool


def tool_names(program: Program, text: ProgramText | None, table: Mapping[int, Tool] | None = None) -> dict[int, str]:
    """Names of the tools by their numbers; a tool that nobody names is not in it."""
    found = {number: tool.name for number, tool in (table or {}).items() if tool.name}
    if text is None:
        return found
    changes = [(event.line, tool_number(event.text)) for event in program.events if event.kind == "tool_change"]
    for line, number in changes:
        said = text.comment_in(line)
        if number is not None and said:
            found.setdefault(number, said)
    for pattern in (_OF_TOOL, _LISTED):
        for comment in text.comments:
            match = pattern.fullmatch(comment.text)
            if match is not None:
                found.setdefault(int(match["number"]), match["name"].strip())
    beside = [
        (comment.line, match["name"].strip()) for comment in text.comments if (match := _BESIDE.fullmatch(comment.text))
    ]
    for line, number in changes:
        near = [name for at, name in beside if abs(at - line) <= _NEAR]
        if number is not None and near:
            found.setdefault(number, near[0])
    return found
