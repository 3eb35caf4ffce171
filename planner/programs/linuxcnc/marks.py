"""A copy of a program with a mark before every line, so that LinuxCNC tells which line it runs.

The interpreter numbers the lines of the file that it is in, and says neither which file that is, nor which line failed.
A mark is a comment ``(feedplan-mark 0 17 XZ)``: the file, 0 for the program itself, the line, and what it names; it moves
nothing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from planner.errors import InputError
from planner.programs.linuxcnc.canon import MARKED, PITCH_FOLLOWS

_COMMENT = re.compile(r"\([^()\n]*\)|;[^\n]*")
_CALL = re.compile(r"^(?:N[\d.]+)?O(\d+|<[^<>]*>)CALL")
_BEGIN = re.compile(r"^(?:N[\d.]+)?O(\d+|<[^<>]*>)(?:SUB|$)")
_PROGRAM = re.compile(r"M98P(\d+)|P(\d+)M98")
_TOOL = re.compile(r"[TH](\d+)|M61Q(\d+)")
_NO_WORD = re.compile(r"#<[^<>]*>|[A-Z]{2,}")
_AXIS = re.compile(r"[XYZABCUVW@^]")
_CHANGE = re.compile(r"M\s*0*6(?![\d.])", re.IGNORECASE)
_SELECTED = re.compile(r"T\d+")
_THREAD = re.compile(r"G(?:33(?:\.1)?|(76))(?![\d.])")
_PLAIN_WORD = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
PART = "feedplan_part.ngc"


@dataclass(frozen=True)
class MarkedProgram:
    """The program's lines and those of the files that it calls, bare: in capitals, without spaces and comments.

    ``numbers`` are the numbers of the lines in the copy of the program, of each the line in the program itself.
    """

    names: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]
    numbers: tuple[int, ...]

    @property
    def line_count(self) -> int:
        """Lines of the program."""
        return len(self.lines[0]) - (self.lines[0][-1] == "")

    @property
    def tools(self) -> tuple[int, ...]:
        """Numbers of the tools that the files name."""
        found = (m[1] or m[2] for lines in self.lines for line in lines for m in _TOOL.finditer(line))
        return tuple(sorted({int(number) for number in found if int(number) > 0}))


def bare(line: str) -> str:
    """A line in capitals, without spaces and comments."""
    return "".join(_COMMENT.sub("", line).upper().split())


def write_marked(program: Path, folder: Path) -> MarkedProgram:
    """Write the marked copies of a program and of the files beside it that it calls.

    Raises InputError where one cannot be read.
    """
    todo = [program]
    names: list[str] = []
    lines: list[tuple[str, ...]] = []
    numbers: tuple[int, ...] = ()
    while len(names) < len(todo):
        index = len(names)
        path = todo[index]
        try:
            text = path.read_text(encoding="latin-1")
        except OSError as problem:
            raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
        marked, places = _marked(text.split("\n"), index)
        (folder / (path.name if index else PART)).write_text("\n".join(marked), encoding="latin-1")
        stripped = tuple(bare(line) for line in text.split("\n"))
        numbers = numbers or places
        names.append(path.name)
        lines.append(stripped)
        for label in _called(stripped):
            called = program.parent / f"{label}.ngc"
            if called.is_file() and called not in todo:
                todo.append(called)
    return MarkedProgram(tuple(names), tuple(lines), numbers)


def _marked(lines: list[str], index: int) -> tuple[list[str], tuple[int, ...]]:
    """Lines with marks, and of each line of the copy the line that it stands for."""
    out: list[str] = []
    places: list[int] = [0]  # lines are counted from 1
    begun = False
    for number, line in enumerate(lines, start=1):
        opens = not begun and line.strip().startswith("%")  # must be the first
        begun |= bool(line.strip())
        said = [line]
        if begun and not opens and line.strip():
            said = [f"({MARKED} {index} {number} {_signs(bare(line))})", *_pitch(line), *_apart(line)]
        out += said
        places += [number] * len(said)
    return out, tuple(places)


def _signs(line: str) -> str:
    """What the line names: axes, + and - for G90 and G91, and ~ for a move to a home."""
    words = _NO_WORD.sub("", line)
    axes = "".join(sorted({"@": "XY", "^": "Y"}.get(letter, letter) for letter in set(_AXIS.findall(words))))
    modes = "+" * bool(re.search(r"G90(?![\d.])", words)) + "-" * bool(re.search(r"G91(?![\d.])", words))
    return (axes + modes + "~" * bool(re.search(r"G(?:28|30)(?![\d.])", words))) or "."


def _apart(line: str) -> list[str]:
    """A line, or two where a tool is changed and its length taken: the interpreter alone, without a machine to ask, would
    lose where the tool stands.
    """
    words = bare(line)
    if (
        words[:1] in ("/", "O")
        or "G43" not in words
        or not _CHANGE.search(words)
        or any(sign in words for sign in "#[")
    ):
        return [line]
    tool = _SELECTED.search(words)
    return [f"{tool[0] if tool else ''} M6", _CHANGE.sub("", _COMMENT.sub("", line))]


def word_value(line: str, letter: str) -> str:
    """What stands behind a letter of a bare line, where it begins a word; empty where there is none."""
    depth, outside = 0, []
    for sign in line:
        depth += sign in "[<"
        outside.append("" if depth else sign)
        depth -= sign in "]>"
    starts = [k for k, sign in enumerate(outside) if sign.isalpha() and not (k and outside[k - 1].isalpha())]
    for start, end in zip(starts, [*starts[1:], len(line)], strict=True):
        if line[start] == letter:
            return line[start + 1 : end]
    return ""


def _pitch(line: str) -> list[str]:
    """Of a thread whose pitch is no plain number a dwell as long, in which the interpreter tells it."""
    words = bare(line)
    thread = _THREAD.search(words)
    if thread is None or words[:1] in ("/", "O"):
        return []
    value = word_value(words, "P" if thread[1] else "K")
    return [f"({PITCH_FOLLOWS})", f"G4 P[ABS[{value}]]"] if value and not _PLAIN_WORD.fullmatch(value) else []


def _called(lines: tuple[str, ...]) -> list[str]:
    """Labels of the subroutines that are called and are not in the file."""
    own = {m[1] for line in lines if (m := _BEGIN.match(line))}
    called = {m[1] for line in lines if (m := _CALL.match(line))}
    called |= {number for line in lines for m in _PROGRAM.finditer(line) for number in m.groups() if number}
    return sorted(label.strip("<>").lower() for label in called - own)
