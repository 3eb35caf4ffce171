"""Words of a part program that are not read: collected, and said in one message; or passed over where that is asked for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from planner.errors import InputError
from planner.programs.reading.language import G_WORDS, M_WORDS, NUMBER_LETTERS, UNREAD, word_name
from planner.programs.reading.words import LineArray, Mask, Words, keep_words

_SHOWN = 20
_FIRST_USER_CODE = 100
_WORD = re.compile(r"([A-Z])(\d*\.?\d*)")


@dataclass
class UnreadWords:
    """The words that are not read: of each its first line, and how often it stands in the file.

    ``ignored`` are words to pass over, in capitals: G and M words with their number, other words by their letter.
    """

    source: str
    ignored: frozenset[str] = frozenset()
    found: dict[str, tuple[int, int]] = field(default_factory=dict)
    passed: dict[str, tuple[int, int]] = field(default_factory=dict)

    def add(self, words: Words, indices: LineArray) -> None:
        """Note the words at these indices."""
        _count(words, indices, self.found)

    def without_ignored(self, words: Words) -> Words:
        """The words that are left when those to be ignored are taken out, which are counted."""
        out = np.zeros(words.letter.size, dtype=bool)
        for name in self.ignored:
            letter, number = name[0], name[1:]
            of_name = words.letter == ord(letter)
            if number:
                of_name &= np.abs(words.value - float(number)) < 1e-6
            out |= of_name
        if not out.any():
            return words
        _count(words, np.flatnonzero(out), self.passed)
        return keep_words(words, ~out & ~_of_user_codes(words, out))

    def require_none(self) -> None:
        """Raise InputError with every word that is not read."""
        if not self.found:
            return
        order = sorted(self.found, key=lambda name: self.found[name][0])
        line = self.found[order[0]][0]
        parts = []
        for name in order[:_SHOWN]:
            first, count = self.found[name]
            reason = f", {UNREAD[name]}" if name in UNREAD else ""
            parts.append(f"{name} (line {first}, {count} time{'s' if count > 1 else ''}{reason})")
        more = f" and {len(order) - _SHOWN} others" if len(order) > _SHOWN else ""
        raise InputError(
            f"{self.source}:{line}: {order[0]}: not read in this program: {'; '.join(parts)}{more}; post it without "
            "them, or pass over those that move nothing: --ignore WORD for each, or let an installed LinuxCNC read it: "
            "--reader rs274"
        )

    def notes(self) -> list[str]:
        """What was passed over, a sentence each."""
        return [
            f"{name} is passed over as asked, {count} time{'s' if count > 1 else ''}, the first in line {first}"
            for name, (first, count) in sorted(self.passed.items(), key=lambda item: item[1])
        ]


def _of_user_codes(words: Words, out: Mask) -> Mask:
    """The P and Q beside codes of the user that are taken out, where no G word has use for them."""
    user = out & (words.letter == ord("M")) & (words.value >= _FIRST_USER_CODE)
    if not user.any():
        return user
    block = words.block_number
    own = np.setdiff1d(block[user], block[words.letter == ord("G")])
    return np.isin(words.letter, (ord("P"), ord("Q"))) & np.isin(block, own)


def _count(words: Words, indices: LineArray, table: dict[str, tuple[int, int]]) -> None:
    for index in indices.tolist():
        name = word_name(chr(words.letter[index]), float(words.value[index]))
        first, count = table.get(name, (int(words.line[index]), 0))
        table[name] = (first, count + 1)


def ignored_words(names: Sequence[str]) -> frozenset[str]:
    """Check the words to ignore, and bring them to their shortest form.

    Raises InputError where one is no word, or one that is read: that would change the program without a trace.
    """
    found = set()
    for name in [names] if isinstance(names, str) else names:
        match = _WORD.fullmatch(name.strip().upper()) if isinstance(name, str) else None
        if match is None or ((match[1] in "GM") != bool(match[2].strip("."))):
            raise InputError(f"ignore = {name!r} must be a word to pass over, as M123 or G6.2")
        if match[1] not in "GM":
            known, short = match[1] in NUMBER_LETTERS, match[1]
        else:
            number, table = float(match[2]), G_WORDS if match[1] == "G" else M_WORDS
            known = round((10.0 if match[1] == "G" else 1.0) * number) in table
            short = word_name(match[1], number)
        if known:
            raise InputError(f"ignore = {name!r}: the word is read; only what is not can be passed over")
        found.add(short)
    return frozenset(found)
