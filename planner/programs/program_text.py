"""The text of a part program: its lines as a person wrote them, their N words, and the comments that stand alone."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from planner.errors import InputError
from planner.inputs import require_path, shorten
from planner.programs.reading.words import LineArray

# A line that is a comment and nothing else, behind an N word at most; of several comments in a line none stands alone.
_COMMENT_LINE = re.compile(
    rb"^[ \t]*(?:N[ \t]*[\d.]+[ \t]*)?(?:\(([^()\r\n]*)\)|;([^\r\n]*))[ \t]*\r?$", re.MULTILINE | re.IGNORECASE
)
_COMMENT = re.compile(r"\(([^()]*)\)|;(.*)")
_NUMBER = re.compile(r"[ \t]*(N[ \t]*\d[\d.]*)", re.IGNORECASE)


@dataclass(frozen=True)
class Comment:
    """A comment that stands alone in its line: number of the line, from 1, and what stands in it, without blanks around."""

    line: int
    text: str


@dataclass(frozen=True, eq=False, repr=False)
class ProgramText:
    """The bytes of a part program."""

    raw: bytes

    @classmethod
    def read(cls, path: str | Path) -> ProgramText:
        """Read a file; raises InputError if it cannot be read."""
        try:
            return cls(require_path(path).read_bytes())
        except OSError as problem:
            raise InputError(f"{path}: cannot be read ({problem.strerror})") from None

    @cached_property
    def starts(self) -> LineArray:
        """Where each line begins in the bytes, (n,)."""
        ends = np.flatnonzero(np.frombuffer(self.raw, dtype=np.uint8) == ord("\n")) + 1
        if ends.size and ends[-1] == len(self.raw):
            ends = ends[:-1]
        return np.concatenate([np.zeros(1, dtype=np.int64), ends])

    @property
    def count(self) -> int:
        """Number of lines."""
        return int(self.starts.size)

    def line(self, number: int) -> str:
        """A line by its number from 1, without its end and blanks around it; empty where there is none."""
        if not 1 <= number <= self.count:
            return ""
        stop = int(self.starts[number]) if number < self.count else len(self.raw)
        return decoded(self.raw[int(self.starts[number - 1]) : stop]).strip()

    def shown(self, number: int) -> str:
        """A line as it can be shown: cut where it is long, with what cannot be printed spelt out."""
        return shorten(self.line(number).replace("\t", " "))

    def number_word(self, number: int) -> str:
        """The N word of a line, without blanks in it; empty where there is none."""
        found = _NUMBER.match(self.line(number))
        return "".join(found[1].upper().split()) if found else ""

    def comment_in(self, number: int) -> str:
        """The first comment in a line, empty where there is none."""
        found = _COMMENT.search(self.line(number))
        return (found[1] if found[1] is not None else found[2]).strip() if found else ""

    @cached_property
    def comments(self) -> tuple[Comment, ...]:
        """The comments that stand alone in their lines, in the order of the file."""
        found = list(_COMMENT_LINE.finditer(self.raw))
        at = np.searchsorted(self.starts, [match.start() for match in found], side="right")
        texts = (match[1] if match[1] is not None else match[2] for match in found)
        return tuple(Comment(int(line), decoded(text).strip()) for line, text in zip(at, texts, strict=True))


def decoded(raw: bytes) -> str:
    """Text of bytes that are UTF-8, or else of a western code page, which posts write umlauts in."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace")
