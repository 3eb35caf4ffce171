"""Files as the world sends them: seeded mutations of sound ones, of bytes, lines and words."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_]\w*|[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?|[^\s\w]")
NUMBERS = (
    b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-308", b"5e-324", b"-0", b"0", b"-1", b"1", b"2", b"1_0", b"1e", b"",
    b"9" * 40, b"1" + b"0" * 5000, b"-" + b"9" * 400, b"1e999", b"0x10", b"1e9", b"1e-9", b"1e17", b"0.1.2", b"--1", b"true",
    "\u0661\u0662".encode(), "\uff11".encode(), b"1,5", b"1e100", b"-1e-7", b"65536", b"1000000", b"null", b"2147483648",
)  # fmt: skip
BYTES = (
    b"\x00",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\r",
    b"\n",
    b"\n\n",
    b"\t",
    b'"',
    b"'",
    b"(",
    b")",
    b"[",
    b"{",
    b"#",
    b";",
    b",",
)

Mutation = Callable[[bytes, np.random.Generator], bytes]


def _place(data: bytes, rng: np.random.Generator) -> int:
    return int(rng.integers(0, len(data) + 1))


def _slice(data: bytes, rng: np.random.Generator, longest: int = 200) -> tuple[int, int]:
    at = _place(data, rng)
    return at, min(len(data), at + int(rng.integers(1, longest)))


def flip_bits(data: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(data)
    for at in rng.integers(0, len(data), int(rng.integers(1, 5))):
        out[at] ^= int(rng.integers(1, 256))
    return bytes(out)


def delete_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    a, b = _slice(data, rng)
    return data[:a] + data[b:]


def duplicate_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    a, b = _slice(data, rng)
    return data[:b] + data[a:b] + data[b:]


def insert_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng) if rng.random() < 0.8 else 0
    return data[:at] + BYTES[rng.integers(len(BYTES))] * int(rng.integers(1, 4)) + data[at:]


def truncate(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _place(data, rng)]


def other_line_ends(data: bytes, rng: np.random.Generator) -> bytes:
    return data.replace(b"\n", (b"\r\n", b"\r", b"\n\n", b"")[rng.integers(4)])


def _of_lines(change: Callable[[list[bytes], int, int], list[bytes]]) -> Mutation:
    def mutate(data: bytes, rng: np.random.Generator) -> bytes:
        lines = data.splitlines(keepends=True)
        i, j = (int(k) for k in rng.integers(0, len(lines), 2))
        return b"".join(change(lines, i, j))

    return mutate


def _swapped(items: list[bytes], i: int, j: int) -> list[bytes]:
    items = list(items)
    items[i], items[j] = items[j], items[i]
    return items


delete_line = _of_lines(lambda lines, i, _: lines[:i] + lines[i + 1 :])
repeat_line = _of_lines(lambda lines, i, j: [*lines[:j], lines[i], *lines[j:]])
swap_lines = _of_lines(_swapped)


def _of_words(pattern: re.Pattern[bytes], change: Callable[[bytes, bytes, np.random.Generator], bytes]) -> Mutation:
    def mutate(data: bytes, rng: np.random.Generator) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        for _ in range(int(rng.integers(1, 3))):
            one, other = (found[k] for k in rng.integers(0, len(found), 2))
            data = data[: one.start()] + change(one[0], other[0], rng) + data[one.end() :]
            found = list(pattern.finditer(data)) or found[:0]
            if not found:
                break
        return data

    return mutate


replace_number = _of_words(NUMBER, lambda _, __, rng: NUMBERS[rng.integers(len(NUMBERS))])
nudge_number = _of_words(NUMBER, lambda one, _, rng: one[:-1] + b"%d" % rng.integers(10))
scale_number = _of_words(NUMBER, lambda one, _, rng: one + b"e%d" % rng.integers(-30, 30))
delete_word = _of_words(WORD, lambda *_: b"")
repeat_word = _of_words(WORD, lambda one, *_: one + b" " + one)
swap_words = _of_words(WORD, lambda _, other, __: other)

OF_BYTES = (flip_bits, delete_bytes, duplicate_bytes, insert_bytes, truncate)
OF_TEXT = (
    other_line_ends, delete_line, repeat_line, swap_lines, replace_number, replace_number, nudge_number, scale_number,
    delete_word, repeat_word, swap_words,
)  # fmt: skip


def mutated(data: bytes, seed: tuple[int, ...], *, text: bool, part: tuple[int, int] | None = None) -> bytes:
    """A mutation of a file, or of the part of it from one byte to another; the same for the same seed."""
    rng = np.random.default_rng(seed)
    known = OF_BYTES + OF_TEXT if text else OF_BYTES
    if part is not None and rng.random() < 0.8:
        return data[: part[0]] + mutated(data[part[0] : part[1]], (*seed, 1), text=text) + data[part[1] :]
    for _ in range(1 if rng.random() < 0.7 else int(rng.integers(2, 5))):
        data = known[rng.integers(len(known))](data, rng) or b" "
    return data
