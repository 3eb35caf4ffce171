"""The words of a part program by block: one column for each letter and each modal group."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.geometry.curve import MAX_COORDINATE
from planner.programs.reading.language import (
    G_GROUPS,
    G_WORDS,
    M_GROUPS,
    M_WORDS,
    MOTION,
    NUMBER_LETTERS,
)  # fmt: skip
from planner.programs.reading.unread import UnreadWords
from planner.programs.reading.words import Faults, LineArray, Mask, Words
from planner.types import FloatArray

_NO_MOTION = 800
_ROUNDING = 1e-3  # of ten times the number of a G word: G0.99999 is G1


@dataclass(frozen=True, eq=False)
class WordColumn:
    """The words with one letter, or of one modal group: value and index of the word, at every block."""

    given: Mask
    value: FloatArray
    word: LineArray

    def at(self, where: Mask) -> LineArray:
        """Indices of the words at the blocks where the mask and a word are."""
        return self.word[where & self.given]

    def has(self, *values: float) -> Mask:
        """Blocks with a word of one of these values."""
        return self.given & np.isin(self.value, values)


@dataclass(frozen=True, eq=False)
class Blocks:
    """The blocks of a part: line and first word of each, and its words by letter and by modal group."""

    words: Words
    faults: Faults
    line: LineArray
    first: LineArray
    of_word: LineArray
    letters: dict[str, WordColumn]
    g: list[WordColumn]
    m: list[WordColumn]

    def any_of(self, names: str) -> Mask:
        """Blocks with a word of one of these letters."""
        found = [column.given for column in map(self.letters.__getitem__, names) if column.given.any()]
        return np.logical_or.reduce(found) if found else np.zeros(self.line.size, dtype=np.bool_)

    def first_of(self, names: str, where: Mask) -> LineArray:
        """Index of the first word with one of these letters, at the blocks of the mask, which have one."""
        rows = np.flatnonzero(where)
        found = np.full(rows.size, np.iinfo(np.int64).max)
        for column in map(self.letters.__getitem__, names if rows.size else ""):
            given = column.given[rows]
            found[given] = np.minimum(found[given], column.word[rows[given]])
        return found

    def number(self, row: int, letter: str) -> float | None:
        """The number behind a letter in a block, None where it is not there."""
        column = self.letters[letter]
        return float(column.value[row]) if column.given[row] else None


def sort_words(words: Words, faults: Faults, unread: UnreadWords) -> Blocks:
    """Sort the words of every block by letter and modal group; note what is unknown, refuse what is given twice."""
    starts = np.append(True, np.diff(words.block_number) > 0)
    of_word, first = np.cumsum(starts) - 1, np.flatnonzero(starts)
    wide = np.flatnonzero(~(np.abs(words.value) <= MAX_COORDINATE))
    faults.add(wide, f"the number must be at most {MAX_COORDINATE:.0e}")
    faults.raise_first()  # rules of blocks cannot be looked at without the number: they would say what it is not
    value = words.value
    nothing = WordColumn(np.zeros(first.size, dtype=bool), np.zeros(first.size), np.zeros(first.size, dtype=np.int64))

    def column(index: LineArray, numbers: FloatArray, twice: str) -> WordColumn:
        if not index.size:
            return nothing
        block = of_word[index]
        again = index[1:][block[1:] == block[:-1]]
        faults.add(again, lambda place: twice.format(words.word(int(index[np.searchsorted(index, again[place]) - 1]))))
        given, at, word = np.zeros(first.size, dtype=bool), np.zeros(first.size), np.zeros(first.size, dtype=np.int64)
        # In reverse, so that of two words the first is kept.
        given[block], at[block[::-1]], word[block[::-1]] = True, numbers[index][::-1], index[::-1]
        return WordColumn(given, at, word)

    known = np.zeros(256, dtype=bool)
    known[list(b"GM%" + NUMBER_LETTERS.encode())] = True
    unread.add(words, np.flatnonzero(~known[words.letter]))
    letters = {
        name: column(np.flatnonzero(words.letter == ord(name)), value, "the block has {} already")
        for name in "%" + NUMBER_LETTERS
    }
    group, code = _groups(words, value)
    unread.add(words, np.flatnonzero((group < 0) & ((words.letter == ord("G")) | (words.letter == ord("M")))))
    _let_motion_win(group, code, of_word)
    pair = "{} of the same modal group is in the block already"
    by_group = [column(np.flatnonzero(group == k), code, pair) for k in range(G_GROUPS + M_GROUPS)]
    return Blocks(words, faults, words.line[first], first, of_word, letters, by_group[:G_GROUPS], by_group[G_GROUPS:])


def _groups(words: Words, value: FloatArray) -> tuple[LineArray, FloatArray]:
    """Modal group of every G and M word (M after G; -1 for other words) and its code: its number, of G ten times that."""
    group = np.full(value.size, -1)
    code = value.copy()
    for letter, table, offset, factor in (("G", G_WORDS, 0, 10.0), ("M", M_WORDS, G_GROUPS, 1.0)):
        index = np.flatnonzero(words.letter == ord(letter))
        number = np.rint(factor * value[index])
        lookup = np.full(1001, -1)
        lookup[list(table)] = [word.group + offset for word in table.values()]
        inside = (np.abs(factor * value[index] - number) < _ROUNDING) & (number >= 0) & (number <= 1000)
        group[index] = np.where(inside, lookup[np.where(inside, number, 0).astype(np.int64)], -1)
        code[index] = number
    return group, code


def _let_motion_win(group: LineArray, code: FloatArray, of_word: LineArray) -> None:
    """Take G80 out of a block that names another motion."""
    none = np.flatnonzero((group == MOTION) & (code == _NO_MOTION))
    if none.size:
        others = of_word[(group == MOTION) & (code != _NO_MOTION)]
        group[none[np.isin(of_word[none], others)]] = -1
