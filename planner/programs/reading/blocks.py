"""The words of a part program by block: one column for each letter and each modal group."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.geometry.curve import MAX_COORDINATE
from planner.programs.reading.words import O_WORDS, Faults, LineArray, Mask, Words
from planner.types import FloatArray

# The modal groups; of each one word may stand in a block.  G40, G49 and G54 are read, and change nothing.
MOTION, PLANE, UNITS, DISTANCE, CENTRES, FEED_MODE, PATH_MODE, DWELL, COMPENSATION, TOOL_LENGTH, OFFSET = range(11)
STOP, CHANGE, SPINDLE, COOLANT = range(4)
G_GROUPS, M_GROUPS = 11, 4
# G words by ten times their number.
_G_WORDS = {
    0: MOTION, 10: MOTION, 20: MOTION, 30: MOTION, 800: MOTION,
    40: DWELL,
    170: PLANE, 180: PLANE, 190: PLANE,
    200: UNITS, 210: UNITS,
    900: DISTANCE, 910: DISTANCE,
    901: CENTRES, 911: CENTRES,
    930: FEED_MODE, 940: FEED_MODE,
    610: PATH_MODE, 611: PATH_MODE, 640: PATH_MODE,
    400: COMPENSATION, 490: TOOL_LENGTH, 540: OFFSET,
}  # fmt: skip
_M_WORDS = {
    0: STOP, 1: STOP, 2: STOP, 30: STOP,
    6: CHANGE,
    3: SPINDLE, 4: SPINDLE, 5: SPINDLE,
    7: COOLANT, 8: COOLANT, 9: COOLANT,
}  # fmt: skip
_VALUE_LETTERS = "NXYZIJKRFSTPQ"
_REFUSED_G = {
    410: "cutter compensation is not read", 420: "cutter compensation is not read",
    430: "tool length offsets are not read", 431: "tool length offsets are not read",
    520: "offsets are not read", 530: "machine coordinates are not read", 550: "only G54 is read",
    50: "splines are not read; write G1, G2 or G3", 51: "splines are not read; write G1, G2 or G3",
    52: "splines are not read; write G1, G2 or G3",
    100: "offsets are not read", 920: "offsets are not read", 280: "reference positions are not read",
    300: "reference positions are not read", 950: "feed per revolution is not read",
    **dict.fromkeys((730, 760, 810, 820, 830, 840, 850, 860, 870, 880, 890), "canned cycles are not read"),
}  # fmt: skip
_REFUSED_LETTERS = {
    **dict.fromkeys("ABC", "rotary axes are not read"),
    **dict.fromkeys("UVW", "only the axes X, Y and Z are read"),
    "O": O_WORDS,
    "D": "cutter compensation is not read",
    "H": "tool length offsets are not read",
    "L": "repetitions are not read",
    "E": "a number has no exponent, and no word starts with E",
}


@dataclass(frozen=True, eq=False)
class WordColumn:
    """The words with one letter, or of one modal group: value and index of the word, at every block."""

    given: Mask
    value: FloatArray
    word: LineArray

    def at(self, where: Mask) -> LineArray:
        """Indices of the words at the blocks where the mask and a word are."""
        return self.word[where & self.given]


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
        return np.logical_or.reduce([self.letters[name].given for name in names])

    def first_of(self, names: str, where: Mask) -> LineArray:
        """Index of the first word with one of these letters, at the blocks of the mask, which have one."""
        places = [np.where(c.given, c.word, np.iinfo(np.int64).max) for c in map(self.letters.__getitem__, names)]
        return np.minimum.reduce(places)[where]


def sort_words(words: Words, faults: Faults) -> Blocks:
    """Sort the words of every block by letter and modal group; refuse what is unknown or given twice."""
    starts = np.append(True, np.diff(words.line) > 0)
    of_word, first = np.cumsum(starts) - 1, np.flatnonzero(starts)
    wide = np.flatnonzero(~(np.abs(words.value) <= MAX_COORDINATE))
    faults.add(wide, f"the number must be at most {MAX_COORDINATE:.0e}")
    value = words.value.copy()
    value[wide] = 0.0

    def column(index: LineArray, numbers: FloatArray, twice: str) -> WordColumn:
        block = of_word[index]
        again = index[1:][block[1:] == block[:-1]]
        faults.add(again, lambda place: twice.format(words.word(int(index[np.searchsorted(index, again[place]) - 1]))))
        given, at, word = np.zeros(first.size, dtype=bool), np.zeros(first.size), np.zeros(first.size, dtype=np.int64)
        # In reverse, so that of two words the first is kept.
        given[block], at[block[::-1]], word[block[::-1]] = True, numbers[index][::-1], index[::-1]
        return WordColumn(given, at, word)

    known = np.zeros(256, dtype=bool)
    known[list(b"GM%" + _VALUE_LETTERS.encode())] = True
    strange = np.flatnonzero(~known[words.letter])
    faults.add(strange, lambda place: _REFUSED_LETTERS.get(chr(words.letter[strange[place]]), "no word of the subset"))
    letters = {
        name: column(np.flatnonzero(words.letter == ord(name)), value, "the block has {} already")
        for name in "%" + _VALUE_LETTERS
    }
    group, code = _groups(words, faults, value)
    pair = "{} of the same modal group is in the block already"
    by_group = [column(np.flatnonzero(group == k), code, pair) for k in range(G_GROUPS + M_GROUPS)]
    return Blocks(words, faults, words.line[first], first, of_word, letters, by_group[:G_GROUPS], by_group[G_GROUPS:])


def _groups(words: Words, faults: Faults, value: FloatArray) -> tuple[LineArray, FloatArray]:
    """Modal group of every G and M word (M after G; -1 for other words) and ten times its number."""
    group = np.full(value.size, -1)
    code = np.rint(10.0 * value)
    exact = np.abs(10.0 * value - code) < 1e-6
    for letter, table, offset, tenth in (("G", _G_WORDS, 0, 1), ("M", _M_WORDS, G_GROUPS, 10)):
        index = np.flatnonzero(words.letter == ord(letter))
        lookup = np.full(1001, -1)
        lookup[[tenth * key for key in table]] = [place + offset for place in table.values()]
        inside = exact[index] & (code[index] >= 0) & (code[index] <= 1000)
        group[index] = np.where(inside, lookup[np.where(inside, code[index], 0).astype(np.int64)], -1)
        refused = index[group[index] < 0]

        def reason(place: int, refused: LineArray = refused, letter: str = letter) -> str:
            known = _REFUSED_G if letter == "G" else {}
            return known.get(int(code[refused[place]]), f"no {letter} word of the subset")

        faults.add(refused, reason)
    return group, code
