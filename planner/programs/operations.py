"""What the tools and the operations of a part program take.

An operation is what the comments of CAM systems say it is.  Rules:

1.  Comments that name an operation, wherever they stand alone in a line: ``(begin operation: Pocket)``,
    ``(operation: Pocket)``, ``(Path: Pocket)``, ``(Toolpath:- Pocket)``, ``(--- Toolpath Pocket ---)``, ``(No. 1: Pocket)``,
    ``(OP 10: Pocket)``.  FreeCAD, Vectric, Estlcam and others write these.
2.  If there is none: a comment that stands alone in its line, after the last motion of one section and before the first
    of the next, which is a rapid, or comes with a tool, spindle or coolant word.  Fusion, CamBam and others write these.
    Of several the first of the last paragraph counts, before the tool change if any stand there; tool lists, dates,
    messages and the like do not count, nor does what no cut follows.
3.  If there is none but the head of the program: an operation for each tool.

A move counts to the last operation that began in a line above its own; one in a subprogram, to that of its call.  A tool
change and the start of the spindle count to the operation of the next move, since some posts write them before its comment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.programs.program_text import Comment, ProgramText
from planner.programs.reading.program import RAPID, Program
from planner.programs.reading.words import LineArray, Mask
from planner.programs.schedule import Pause, Schedule

_NAMED = tuple(
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        r"begin operation:\s*(?P<name>.+)",
        r"(?:operation|op)\b\s*\d*\s*[:=-]+\s*(?P<name>.+)",
        r"path:\s*(?P<name>.+)",
        r"toolpath(?:\s+name)?\s*:-?\s*(?P<name>.+)",
        r"-+\s*toolpath\s+(?P<name>.+?)\s*-+",
        r"(?P<name>n[or]\.\s*\d+\b.*)",
    )
)
_NO_NAME = re.compile(
    r"$|T\d+\b|\d+\s*=|tools?\b(?! ?path)|(?:msg|debug|print|log\w*|probe\w*|abort)\s*,|feedplan:|"
    r"(?:machin\w+|materials?|units?|date|time|output|file|program|post|vendor|description|author|document|block-\w+|"
    r"required)\b[^:=]*[:=]|(?:exported|created|generated|made|posted)\s+(?:by|with|using|on|at)\b|"
    r"(?:begin|end)\s+(?:preamble|postamble|program|of\b)|[\W\d]+$",
    re.IGNORECASE,
)
_SUBPROGRAM = re.compile(r"\s*(?:N[\d.]+\s*)?O(?:\d+|<[^>]*>)\s*(?P<word>sub|endsub|call)?", re.IGNORECASE)
_CALL = re.compile(r"(?:^|[^\w])M98\b|\bO\s*(?:\d+|<[^>]*>|\[[^\]]*\])\s*call\b", re.IGNORECASE)
_RETURN = re.compile(r"(?:^|[^\w])M99\b", re.IGNORECASE)
_END = re.compile(r"\s*(?:N[\d.]+\s*)?M0*(?:2|30)\b", re.IGNORECASE)
_O_LINE = re.compile(rb"^[ \t]*(?:N[\d.]+[ \t]*)?O", re.MULTILINE | re.IGNORECASE)
_OF_FLOW = re.compile(rb"^[ \t]*(?:N[\d.]+[ \t]*)?O|M98|M99|M0*2\b|M30", re.MULTILINE | re.IGNORECASE)
_STARTS = {"tool_change", "tool", "spindle", "coolant"}
_TOOL = re.compile(r"T\s*(\d+)", re.IGNORECASE)


@dataclass(frozen=True)
class SectionTime:
    """The time of an operation, or of all that a tool does.

    Attributes
    ----------
    name : str
        Of the operation or the tool, as the program or the tool table says it; empty where neither does.
    tool : int, optional
        Number of the tool; None before the first tool change.
    line : int
        Where it begins: of an operation the line of its comment.
    start_s : float
        When its first move or rest begins, s from the start of the run.
    motion_s, rapid_s : float
        Time of its motion, and of the rapids in that, s.
    dwell_s, change_s, spindle_s : float
        Times of its dwells, of its tool changes and of its spindle starts, s.
    tool_changes : int
    length_mm : float
    shares : mapping of str to float
        Share of its motion for which each limit holds it back, most first.
    """

    name: str
    tool: int | None
    line: int
    start_s: float
    motion_s: float
    rapid_s: float
    dwell_s: float
    change_s: float
    spindle_s: float
    tool_changes: int
    length_mm: float
    shares: Mapping[str, float] = field(default_factory=dict)

    @property
    def total_s(self) -> float:
        """All of its time, s."""
        return self.motion_s + self.dwell_s + self.change_s + self.spindle_s


@dataclass(frozen=True, eq=False)
class Division:
    """A division of a run: names and first lines, and to which of them each move (m,) and each rest (r,) belongs."""

    names: tuple[str, ...]
    lines: tuple[int, ...]
    tools: tuple[int | None, ...]
    of_move: LineArray
    of_rest: LineArray

    def times(
        self, program: Program, run: Schedule, held: Mapping[str, NDArray[np.float64]]
    ) -> tuple[SectionTime, ...]:
        """The time of each; ``held`` are the seconds for which each limit holds each of them back."""
        count = len(self.names)
        rapid = program.kind[run.row] == RAPID

        def sums(values: NDArray[np.float64]) -> list[float]:
            return np.bincount(self.of_move, values, count).tolist()

        motion, fast = sums(run.seconds), sums(np.where(rapid, run.seconds, 0.0))
        length = sums(program.lengths[run.row])
        start = np.full(count, np.inf)
        np.minimum.at(start, self.of_move, run.start)
        rests: dict[str, list[float]] = {kind: [0.0] * count for kind in ("dwell", "tool_change", "spindle")}
        changes = [0] * count
        for k, rest, begin in zip(self.of_rest.tolist(), run.rests, run.rest_start.tolist(), strict=True):
            rests[rest.kind][k] += rest.seconds
            changes[k] += rest.kind == "tool_change"
            start[k] = min(start[k], begin)
        out = []
        for k in range(count):
            part = {name: float(seconds[k]) for name, seconds in held.items()}
            share = {name: value / motion[k] for name, value in part.items() if value > 0.0} if motion[k] > 0.0 else {}
            shares = dict(sorted(share.items(), key=lambda item: -item[1]))
            out.append(
                SectionTime(
                    self.names[k], self.tools[k], self.lines[k], float(start[k]), motion[k], fast[k],
                    rests["dwell"][k], rests["tool_change"][k], rests["spindle"][k], changes[k], length[k], shares,
                )
            )  # fmt: skip
        return tuple(out)


def tool_sections(program: Program, run: Schedule, names: Mapping[int, str]) -> Division:
    """What each tool does, in the order in which they are first used; a tool that comes back is one."""
    number: list[int | None] = [None]
    first = [int(program.line[run.row[0]]) if run.row.size else 1]
    cuts, at = [0], [0]
    of_rest = []
    for rest in run.rests:
        if rest.kind == "tool_change":
            tool = tool_number(rest.text)
            if tool not in number[1:]:
                number.append(tool)
                first.append(rest.line)
            cuts.append(rest.before)
            at.append(number.index(tool, 1))
        of_rest.append(at[-1])
    of_move = np.array(at)[np.searchsorted(cuts, np.arange(run.row.size), side="right") - 1]
    named = tuple("" if tool is None else names.get(tool, "") for tool in number)
    return _used(named, tuple(first), tuple(number), of_move, np.array(of_rest, dtype=np.int64))


def operation_sections(program: Program, run: Schedule, text: ProgramText | None, tools: Division) -> Division | None:
    """What each operation does, by rules 1 and 2; None where no comment names one."""
    inside = np.zeros(0, dtype=bool) if text is None else _subprograms(text)
    begun = () if text is None else _named_operations(text, inside) or _described_operations(program, run, text, inside)
    if not begun:
        return None
    starts = np.array([comment.line for comment in begun])
    of_move = np.searchsorted(starts, program.line[run.row], side="right")
    if inside.any() and text is not None:
        of_move = _of_callers(program.line[run.row], of_move, starts, text, inside)
    following = np.append(of_move, of_move[-1:] if of_move.size else 0)
    of_rest = [
        int(np.searchsorted(starts, rest.line, side="right")) if _by_line(rest, inside) else int(following[rest.before])
        for rest in run.rests
    ]
    cut = program.kind[run.row] != RAPID  # the way to the tool change is the last tool's
    number = tuple(_tool_of(tools, (of_move == k) & cut, of_move == k) for k in range(len(begun) + 1))
    lines = (int(program.line[run.row[0]]) if run.row.size else 1, *starts.tolist())
    names = ("", *(comment.text for comment in begun))
    return _used(names, lines, number, of_move, np.array(of_rest, dtype=np.int64))


def _tool_of(tools: Division, *choices: Mask) -> int | None:
    """The tool of the first move of the first of these choices that has one."""
    for chosen in choices:
        if chosen.any():
            return tools.tools[int(tools.of_move[np.argmax(chosen)])]
    return None


def _by_line(rest: Pause, inside: Mask) -> bool:
    """Whether a rest counts to the operation that its line stands in, and not to that of the next move."""
    return rest.kind == "dwell" and not (rest.line < inside.size and inside[rest.line])


def _used(
    names: Sequence[str], lines: Sequence[int], tools: Sequence[int | None], of_move: LineArray, of_rest: LineArray
) -> Division:
    """Leave out the sections in which nothing happens."""
    used = np.unique(np.concatenate([of_move, of_rest])).astype(np.int64)
    pick = used.tolist()
    return Division(
        tuple(names[k] for k in pick),
        tuple(lines[k] for k in pick),
        tuple(tools[k] for k in pick),
        np.searchsorted(used, of_move),
        np.searchsorted(used, of_rest),
    )


def tool_number(words: str) -> int | None:
    """The number of a T word in some words; None where there is none."""
    found = _TOOL.search(words)
    return int(found[1]) if found else None


def _named_operations(text: ProgramText, inside: Mask) -> tuple[Comment, ...]:
    """Rule 1."""
    found = []
    for comment in text.comments:
        match = next((m for pattern in _NAMED if (m := pattern.fullmatch(comment.text))), None)
        if match is not None and not inside[comment.line]:
            found.append(Comment(comment.line, match["name"].strip()))
    return tuple(found)


def _described_operations(program: Program, run: Schedule, text: ProgramText, inside: Mask) -> tuple[Comment, ...]:
    """Rules 2 and 3."""
    line = program.line[run.row]
    cuts = np.unique(line[program.kind[run.row] != RAPID])
    motion = np.unique(np.concatenate([line, program.zero_lines]))
    motion = motion[~inside[np.minimum(motion, inside.size - 1)]]
    comments = [c for c in text.comments if not inside[c.line] and not _NO_NAME.match(c.text)]
    groups: dict[int, list[Comment]] = {}
    for comment, place in zip(comments, np.searchsorted(motion, [c.line for c in comments]).tolist(), strict=True):
        groups.setdefault(place, []).append(comment)
    acts = np.array(sorted(event.line for event in program.events if event.kind in _STARTS), dtype=np.int64)
    changes = np.array([event.line for event in program.events if event.kind == "tool_change"], dtype=np.int64)
    begun: list[Comment] = []
    for place, group in groups.items():
        if place == motion.size:
            continue
        before, after = (int(motion[place - 1]) if place else 0), int(motion[place])
        rapid = not np.isin(after, cuts)
        if place and not rapid and not ((acts > before) & (acts <= after)).any():
            continue
        here = changes[(changes > before) & (changes <= after)]
        ahead = [comment for comment in group if here.size and comment.line <= here[0]]
        begun.append(_heading(ahead or group))
    edges = np.array([*(comment.line for comment in begun), np.iinfo(np.int64).max])
    cut = np.diff(np.searchsorted(cuts, edges)) > 0
    cutting = [comment for comment, any_cut in zip(begun, cut.tolist(), strict=True) if any_cut]
    head = len(cutting) == 1 and (not motion.size or cutting[0].line < motion[0])
    return () if head else tuple(cutting)


def _heading(group: Sequence[Comment]) -> Comment:
    """The first comment of the last paragraph: of lines that follow one another."""
    first = len(group) - 1
    while first > 0 and group[first - 1].line == group[first].line - 1:
        first -= 1
    return group[first]


def _subprograms(text: ProgramText) -> Mask:
    """Which lines stand in a subprogram, by their numbers from 1; O word to endsub, or to M99."""
    inside = np.zeros(text.count + 2, dtype=bool)
    begun = -1
    for number in _lines_with(text, _OF_FLOW) if _O_LINE.search(text.raw) else ():
        line = text.line(number)
        found = _SUBPROGRAM.match(line)
        word = (found["word"] or "").lower() if found else ""
        bare = found is not None and not word and found.end() == len(line.split("(")[0].rstrip())
        if word == "sub" or (bare and begun < 0):
            begun = number
        elif begun >= 0 and (word == "endsub" or _RETURN.search(line)):
            inside[begun : number + 1] = True
            begun = -1
        elif _END.match(line):
            begun = -1
    return inside


def _lines_with(text: ProgramText, pattern: re.Pattern[bytes]) -> list[int]:
    """Numbers of the lines in which a pattern is found."""
    at = [match.start() for match in pattern.finditer(text.raw)]
    return np.unique(np.searchsorted(text.starts, at, side="right")).tolist()


def _of_callers(line: LineArray, of_move: LineArray, starts: LineArray, text: ProgramText, inside: Mask) -> LineArray:
    """Count the moves of subprograms to the operation of their call: the first after the last move outside."""
    found = [number for number in _lines_with(text, _OF_FLOW) if not inside[number] and _CALL.search(text.line(number))]
    calls = np.array(found, dtype=np.int64)
    within = inside[np.minimum(line, inside.size - 1)]
    if not calls.size or not within.any():
        return of_move
    outside = np.where(within, -1, np.arange(line.size))
    last = np.maximum.accumulate(outside)
    before = np.where(last >= 0, line[last], 0)
    call = calls[np.minimum(np.searchsorted(calls, before, side="right"), calls.size - 1)]
    return np.where(within, np.searchsorted(starts, call, side="right"), of_move)
