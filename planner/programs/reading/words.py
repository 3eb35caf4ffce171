"""A part program's file as words: a letter and a number each, with the line they stand in."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import InputError
from planner.inputs import shorten
from planner.types import FloatArray

LineArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

_CHUNK_BYTES = 4 * 1024**2  # bounds the memory of the tables made of it, about 30 bytes for each of these
_MAX_LINE_BYTES = 64 * 1024  # no block is that long: what has longer lines is no part program
_NO_BLOCK = re.compile(rb"^[ \t]*([/$?])[^\n]*", re.MULTILINE)
_O_LINE = re.compile(rb"[ \t]*(?:N[ \t]*[\d.]+[ \t]*)?O", re.IGNORECASE)
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


class _Fault(IntEnum):
    """What can be wrong with a character, as ``reading.h`` numbers it."""

    BYTE = 1
    CHARACTER = 2
    NO_LETTER = 3
    NO_NUMBER = 4
    OPEN_COMMENT = 5


@dataclass(frozen=True, eq=False)
class Words:
    """The words of some lines of a file, in their order.

    Attributes
    ----------
    letter : (n,) uint8 array
        ASCII codes of capital letters, or of %.
    value : (n,) array
        The numbers as written; inf where one exceeds double precision.
    line : (n,) int64 array
        Line numbers in the file, from 1.
    lines : int
        Lines in this part of the file.
    block : (n,) int64 array, optional
        A number for each block, not decreasing, where lines are run in another order than they stand, or again.
    stopped : bool
        The words end at a parameter, an expression or an O word: in this order of lines they are not those of the program.
    skipped : sequence of (str, int)
        Lines that are no blocks: / of block delete, $ and ? of a stream to GRBL, each with its number.
    """

    source: str
    text: bytes
    letter: NDArray[np.uint8]
    value: FloatArray
    line: LineArray
    first: NDArray[np.int32] | LineArray
    stop: NDArray[np.int32] | LineArray
    lines: int
    block: LineArray | None = None
    stopped: bool = False
    skipped: Sequence[tuple[str, int]] = ()

    @property
    def block_number(self) -> LineArray:
        """A number for each word, the same within a block."""
        return self.line if self.block is None else self.block

    def word(self, index: int) -> str:
        """The word as it stands in the file, in capitals."""
        raw = self.text[self.first[index] : self.stop[index]]
        return shorten("".join(raw.decode("ascii").upper().split()))


@dataclass
class Faults:
    """Of all that is wrong in a part of the file, the first in the order of the file."""

    words: Words
    index: int = field(init=False)
    reason: str = ""

    def __post_init__(self) -> None:
        self.index = self.words.line.size

    def add(self, indices: LineArray, reason: str | Callable[[int], str]) -> None:
        """Note faults of the words at these indices; the reason may depend on the place in ``indices``."""
        if indices.size:
            place = int(np.argmin(indices))
            if indices[place] < self.index:
                self.index = int(indices[place])
                self.reason = reason if isinstance(reason, str) else reason(place)

    def raise_first(self) -> None:
        """Raise InputError for the first fault, if there is one."""
        if self.reason:
            line, word = int(self.words.line[self.index]), self.words.word(self.index)
            raise InputError(f"{self.words.source}:{line}: {word}: {self.reason}")


def keep_words(words: Words, kept: Mask | slice) -> Words:
    """Some of the words."""
    columns = {name: getattr(words, name)[kept] for name in ("letter", "value", "line", "first", "stop")}
    return replace(words, **columns, block=None if words.block is None else words.block[kept])


def read_words(path: Path) -> Iterator[tuple[Words, InputError | None]]:
    """Read a file in parts of some megabytes; with the last part comes the error that ended it, if any.

    The error is not raised here, since something in the words before it may be wrong too.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    source = path.name
    done = 0
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is not a file")
        with open(path, "rb") as file:
            for text, error in text_parts(file):
                if done == 0 and b"\r" in text.rstrip() and b"\n" not in text:
                    raise InputError(f"{source}: its lines end with CR alone; save it with LF or CR LF")
                words, fault = scan_text(text, source, done)
                done += words.lines
                if fault is None and error:
                    fault = InputError(f"{source}:{done}: {_excerpt(text, text.rfind(10) + 1)}: {error}")
                yield words, fault
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
    except ValueError as problem:  # a null byte in the name
        if isinstance(problem, InputError):
            raise
        raise InputError(f"{str(path)!r}: is not a path ({problem})") from None


def text_parts(file: BinaryIO) -> Iterator[tuple[bytes, str]]:
    """Whole lines, some megabytes at a time; with a reason if the file has a line too long to be one."""
    first = True
    while text := file.read(_CHUNK_BYTES):
        if first:
            text, first = text.removeprefix(_BYTE_ORDER_MARK), False
        rest = b"" if text.endswith(b"\n") else file.readline(_MAX_LINE_BYTES)
        too_long = len(rest) == _MAX_LINE_BYTES and not rest.endswith(b"\n")
        yield text + rest, f"a line of more than {_MAX_LINE_BYTES} characters" if too_long else ""


def scan_text(text: bytes, source: str, lines_before: int) -> tuple[Words, InputError | None]:
    """Split whole lines into words; with them comes the error of the first character that fits nowhere, if any."""
    text, skipped = _without_lines(text, lines_before)
    raw = np.frombuffer(text, dtype=np.uint8)
    size = raw.size // 2 + 2  # a word has two characters; a % has one, which the rules let stand alone only
    size += text.count(b"%")
    letter, value = np.empty(size, dtype=np.uint8), np.empty(size)
    first, stop, line = (np.empty(size, dtype=np.int32) for _ in range(3))
    found = np.zeros(3, dtype=np.int64)
    count = core.words_scan(raw.size, raw, letter, value, first, stop, line, found)
    fault, stopped = None, False
    if found[0]:
        stopped = _needs_evaluation(text, int(found[0]), int(found[1]))
        count = int(np.searchsorted(line[:count], found[2]))  # the words before it are half a block
        fault = InputError(f"{source}:{lines_before + 1 + found[2]}: {_complaint(text, int(found[0]), int(found[1]))}")
    lines = text.count(b"\n") + (not text.endswith(b"\n"))
    at = line[:count].astype(np.int64) + (lines_before + 1)
    return Words(
        source, text, letter[:count], value[:count], at, first[:count], stop[:count], lines, None, stopped, skipped
    ), fault


def _needs_evaluation(text: bytes, what: int, at: int) -> bool:
    """Whether the scan ended in a line with a parameter, an expression or an O word."""
    if what not in (_Fault.CHARACTER, _Fault.NO_LETTER, _Fault.NO_NUMBER):
        return False
    line = text[text.rfind(b"\n", 0, at) + 1 : (text + b"\n").find(b"\n", at)]
    return any(sign in line for sign in (b"#", b"[", b"@", b"^")) or _O_LINE.match(line) is not None


def _without_lines(text: bytes, lines_before: int) -> tuple[bytes, list[tuple[str, int]]]:
    """The text without the words of lines that are no blocks, and these, by their first character."""
    if not any(character in text for character in (b"/", b"$", b"?")):
        return text, []
    found = [(match[1].decode(), match.start()) for match in _NO_BLOCK.finditer(text)]
    if not found:
        return text, []
    ends = np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == ord("\n"))
    lines = lines_before + 1 + np.searchsorted(ends, [start for _, start in found])
    return _NO_BLOCK.sub(b"", text), [(name, int(line)) for (name, _), line in zip(found, lines, strict=True)]


def _complaint(text: bytes, what: int, at: int) -> str:
    """Word and reason for a character that fits nowhere."""
    match what:
        case _Fault.BYTE:
            return f"byte 0x{text[at]:02x}: not a character of a part program; the file is binary or damaged"
        case _Fault.NO_NUMBER:
            return f"{_excerpt(text, at)}: a letter needs a number after it"
        case _Fault.NO_LETTER:
            return f"{_excerpt(text, at)}: a number needs a letter before it"
        case _Fault.OPEN_COMMENT:
            return f"{_excerpt(text, at)}: a comment that is not closed with ) in its line, or that holds another"
    character = chr(text[at])
    reason = "block delete stands at the start of a line" if character == "/" else "no word starts with it"
    return f"{character}: {reason}"


def _excerpt(text: bytes, at: int) -> str:
    """What stands at an offset, up to the next space, as it is."""
    rest = text[at : at + 40].split(b"\n")[0].decode("latin-1").strip().split()
    return shorten(rest[0].upper())[:20] if rest else "end of file"
