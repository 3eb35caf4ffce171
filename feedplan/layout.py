"""Lines for a terminal: names beside text that wraps under itself, and tables; plain text with colours around it.

A text here is a list of lines.  Who prints them takes the colours off again where nobody sees them.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

BOLD, UNDERLINED, RED, GREEN = "1", "4", "1;31", "1;32"
"""Styles: what an escape sequence of a terminal takes (ECMA-48, SGR)."""

_NAME = 12  # columns of a name
_GAP = "  "  # between columns
_COLUMNS = 80  # where there is no terminal


def styled(text: str, style: str) -> str:
    """Put a style around a text; none leaves it as it is."""
    return f"\033[{style}m{text}\033[0m" if style and text else text


def named(name: str, text: str, style: str = "") -> list[str]:
    """Lay out a name and what is said of it; a long text wraps under itself."""
    lines = wrapped(text, width() - _NAME - 2 * len(_GAP))
    heads = [name, *[""] * (len(lines) - 1)]
    return [f"{head:{_NAME}}{_GAP}{styled(line, style)}" for head, line in zip(heads, lines, strict=True)]


def indented(text: str) -> list[str]:
    """Lay out a text two columns in."""
    return [_GAP + line for line in wrapped(text, width() - len(_GAP))]


def wrapped(text: str, columns: int) -> list[str]:
    """Break a text between words; within one only where it is longer than a line."""
    lines: list[str] = []
    for line in text.split("\n"):
        lines += textwrap.wrap(line, max(columns, 1), break_on_hyphens=False) or [""]
    return lines


def width() -> int:
    """Columns of the terminal, or of COLUMNS in the environment; as ``shutil`` finds them, which loads slowly."""
    given = os.environ.get("COLUMNS", "")
    if given.isdecimal() and int(given) > 0:
        return int(given)
    try:
        return os.get_terminal_size(sys.__stdout__.fileno()).columns or _COLUMNS if sys.__stdout__ else _COLUMNS
    except (ValueError, OSError):  # closed, or no terminal
        return _COLUMNS


@dataclass(frozen=True)
class Cell:
    """A cell of a table with a style."""

    text: str
    style: str = ""


def table(heads: Sequence[str], rows: Sequence[Sequence[str | Cell]], left: Sequence[str]) -> list[str]:
    """Lay out rows under their heads, which may have several lines.

    Parameters
    ----------
    heads : sequence of str
    rows : sequence of rows
        A cell for each head.
    left : sequence of str
        Heads of the columns that begin at the left; the others end at the right.
    """
    height = max(head.count("\n") for head in heads) + 1
    tall = [[""] * (height - 1 - head.count("\n")) + head.split("\n") for head in heads]
    above = [[Cell(column[k], UNDERLINED) for column in tall] for k in range(height)]
    cells = [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in rows]
    widths = [max(len(row[k].text) for row in (*above, *cells)) for k in range(len(heads))]
    lines = []
    for row in (*above, *cells):
        placed = [
            cell.text.ljust(size) if head in left else cell.text.rjust(size)
            for head, size, cell in zip(heads, widths, row, strict=True)
        ]
        placed[-1] = placed[-1].rstrip()
        lines.append(_GAP.join(styled(text, cell.style) for text, cell in zip(placed, row, strict=True)).rstrip())
    return lines
