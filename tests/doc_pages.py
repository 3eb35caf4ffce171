"""The pages of the documentation as data: their code blocks, tables, links and pictures, and how a block is typed in.

A page is typed as a reader would type it, block after block, in an empty directory that holds a link to ``tests`` and to
``docs``.  Fenced blocks count by their language:

    sh       every line is typed.  ``feedplan`` lines run in this process and must exit with 0, or with N where the line
             ends in ``# exit status N``.  Under ``<!-- parsed, not run -->`` they only have to be understood.
    python   runs; the blocks of a page share one namespace.
    text     directly behind one of these: what it prints.  Words must be equal, numbers agree within 1 %; ``...`` on a
             line of its own stands for any number of lines.
    others   under ``<!-- file: NAME -->`` are written to that file.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from cases import PROJECT

DOCS = PROJECT / "docs"
PAGES = (PROJECT / "README.md", *sorted(DOCS.glob("*.md")))
_FENCE = re.compile(
    r"(?:<!--\s*(?P<remark>[^>]*?)\s*-->\n)?(?P<indent>[ ]*)```(?P<language>\w*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
_TABLE = re.compile(r"^<!-- keys: (?P<name>[^>]*?) -->\n(?P<rows>(?:^\|.*\n)+)", re.MULTILINE)
_LINK = re.compile(r"(?P<picture>!?)\[[^\]]*\]\((?P<target>[^)\s]+)\)")
# Times of computing, and where along the path an evenly used limit is used most, are not the same on every machine.
_NOT_COMPARED = (
    (re.compile(r"planned in [\d.e+-]+ s"), "planned in * s"),
    (re.compile(r"(\d%)\s+[\d.e+-]+ s\s*$", re.MULTILINE), r"\1 * s"),
)
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
_NEAR = 0.01


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, what a comment directly above it says, the text, and the block's first line."""

    language: str
    remark: str
    text: str
    line: int
    follows: bool  # nothing but white space between it and the block before it


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page."""
    source = page.read_text(encoding="utf-8")
    found, end = [], -1
    for match in _FENCE.finditer(source):
        line = source.count("\n", 0, match.start()) + 1
        follows = end >= 0 and not source[end : match.start()].strip()
        found.append(Block(match["language"], match["remark"] or "", match["text"], line, follows))
        end = match.end()
    return found


def key_tables(page: Path) -> dict[str, list[list[str]]]:
    """Tables under ``<!-- keys: NAME -->``: the cells of each row, without the head; back-quotes are taken off the first."""
    tables = {}
    for match in _TABLE.finditer(page.read_text(encoding="utf-8")):
        rows = [[cell.strip() for cell in row.strip("|\n ").split(" | ")] for row in match["rows"].splitlines()]
        tables[match["name"]] = [[row[0].strip("`"), *row[1:]] for row in rows[2:]]
    return tables


def links(page: Path) -> list[tuple[bool, str]]:
    """Whether it is a picture, and the target, of every link outside code blocks."""
    text = _FENCE.sub("", page.read_text(encoding="utf-8"))
    return [(bool(match["picture"]), match["target"]) for match in _LINK.finditer(text)]


def anchors(page: Path) -> set[str]:
    """What the headings of a page can be linked to by."""
    heads = re.findall(r"^#+ (.*)$", _FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def differs(shown: str, printed: str) -> str:
    """Say where a printed text is not what the page shows; empty where it is."""
    words = _words(printed)
    at = 0
    for part in re.split(r"^\s*\.\.\.\s*$", shown, flags=re.MULTILINE):
        wanted = _words(part)
        starts = [at] if at == 0 and part is shown else range(at, len(words) - len(wanted) + 1)
        found = next((k for k in starts if all(map(_same, wanted, words[k : k + len(wanted)]))), None)
        if found is None or found + len(wanted) > len(words):
            return f"the page shows\n{part}\nbut this was printed:\n{printed}"
        at = found + len(wanted)
    return ""


def _words(text: str) -> list[str]:
    for pattern, instead in _NOT_COMPARED:
        text = pattern.sub(instead, text)
    return text.split()


def _same(shown: str, printed: str) -> bool:
    if shown == printed:
        return True
    if _NUMBER.sub("\0", shown) != _NUMBER.sub("\0", printed):
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(printed), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=_NEAR, abs_tol=1e-9) for a, b in pairs)
