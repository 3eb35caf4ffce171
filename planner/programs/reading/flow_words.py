"""The words that a program has run through, as they wait for the next step of the reader."""

from __future__ import annotations

import numpy as np

from planner.programs.reading.words import LineArray, Words

_NONE = np.empty(0, dtype=np.int64)


class WordQueue:
    """Words of runs of text and of evaluated lines, in their order, each block with a number of its own."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.count = 0
        self.ended = False  # M2, M30 or the second %
        self._blocks = self._percents = 0
        self._pieces: list[tuple[Words, LineArray]] = []
        self._lines: list[tuple[str, list[tuple[str, float, int, int]], int]] = []
        self._skipped: set[tuple[str, int]] = set()

    def add(self, words: Words, line: int | None) -> None:
        """Add words of plain text; ``line`` stands in place of theirs."""
        if not words.letter.size and not words.skipped:
            return
        self._close_lines()
        block = np.cumsum(np.append(0, np.diff(words.line) > 0))[: words.line.size]
        if line is not None:
            words = Words(
                words.source, words.text, words.letter, words.value, np.full(words.line.size, line), words.first, words.stop,
                words.lines,
            )  # fmt: skip
        self._append(words, block)

    def add_line(self, text: str, words: list[tuple[str, float, int, int]], line: int) -> None:
        """Add the words of an evaluated line."""
        if words:
            self._lines.append((text, words, line))
            self.count += len(words)
            self.ended |= any(word[:2] in (("M", 2.0), ("M", 30.0)) for word in words)

    def take(self, lines: int) -> Words:
        """All words so far, which leave the queue."""
        self._close_lines()
        pieces, self._pieces, self.count = self._pieces, [], 0
        starts = np.cumsum([0, *(len(words.text) for words, _ in pieces)])

        skipped = [entry for words, _ in pieces for entry in words.skipped if entry not in self._skipped]
        self._skipped |= set(skipped)
        return Words(
            self.source,
            b"".join(words.text for words, _ in pieces),
            np.concatenate([np.empty(0, dtype=np.uint8), *(words.letter for words, _ in pieces)]),
            np.concatenate([np.empty(0), *(words.value for words, _ in pieces)]),
            np.concatenate([_NONE, *(words.line for words, _ in pieces)]),
            np.concatenate([_NONE, *(words.first + start for (words, _), start in zip(pieces, starts, strict=False))]),
            np.concatenate([_NONE, *(words.stop + start for (words, _), start in zip(pieces, starts, strict=False))]),
            lines,
            np.concatenate([_NONE, *(block for _, block in pieces)]),
            skipped=skipped,
        )

    def _close_lines(self) -> None:
        """Make a piece of the evaluated lines."""
        if not self._lines:
            return
        lines, self._lines = self._lines, []
        starts = np.cumsum([0, *(len(text) for text, _, _ in lines)])
        rows = [
            (ord(letter), value, line, int(start) + first, int(start) + stop, k)
            for k, ((_, words, line), start) in enumerate(zip(lines, starts, strict=False))
            for letter, value, first, stop in words
        ]
        letter, value, line, first, stop, block = (np.array(column) for column in zip(*rows, strict=True))
        text = "".join(text for text, _, _ in lines).encode("latin-1")
        self.count -= letter.size
        words = Words(self.source, text, letter.astype(np.uint8), value.astype(np.float64), line, first, stop, 0)
        self._append(words, block)

    def _append(self, words: Words, block: LineArray) -> None:
        self.count += words.letter.size
        self._pieces.append((words, block + self._blocks))
        if words.letter.size:
            self._blocks += int(block[-1]) + 1
        self._percents += int((words.letter == ord("%")).sum())
        stop = (words.letter == ord("M")) & ((words.value == 2.0) | (words.value == 30.0))
        self.ended |= bool(stop.any()) or self._percents >= 2
