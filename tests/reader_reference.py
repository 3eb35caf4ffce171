"""Loops of the reader in plain Python: the compiled ones give the same words and numbers."""

# What can be wrong with a character; 0 is nothing.
BYTE, CHARACTER, NO_LETTER, NO_NUMBER, OPEN_COMMENT = 1, 2, 3, 4, 5

# Digits beyond the 17th do not change a double; 10^22 is the largest power of ten that is one exactly.
_MAX_MANTISSA = 10**17


def _power_of_ten(n):
    """10^n: exact, or by squaring, so that it does not depend on a library."""
    if n <= 22:
        return float(10**n)
    result, base = 1.0, 10.0
    while n:
        if n & 1:
            result *= base
        n >>= 1
        base *= base
    return result


def _comment_end(text, i, close):
    """Index of the character that closes a comment opened at i, or -1 - index of the one that must not be there."""
    for j in range(i + 1, len(text)):
        c = text[j]
        if c == close:
            return j
        control = (c < 32 and c != 9 and c != 13) or c == 127  # noqa: PLR1714
        if control or (c == 40 and close == 41):
            return -1 - j
    return len(text) if close == 10 else -1 - len(text)


def _number(text, j):
    """The decimal number at an offset, with any number of signs: its value, where it ends, and how many digits it has."""
    size = len(text)
    sign = 1.0
    while j < size and text[j] in b"+- \t":
        sign = -sign if text[j] == 45 else sign
        j += 1
    mantissa, decimals, dropped, digits, dot = 0, 0, 0, 0, False
    while j < size and (48 <= text[j] <= 57 or (text[j] == 46 and not dot)):
        if text[j] == 46:
            dot = True
        else:
            digits += 1
            if mantissa < _MAX_MANTISSA:
                mantissa = 10 * mantissa + (text[j] - 48)
                decimals += dot
            else:
                dropped += not dot
        j += 1
    scale = _power_of_ten(decimals)
    value = sign * (mantissa / scale)
    if dropped > 0:
        value *= _power_of_ten(dropped)
    return value, j, digits


def _stray(c):
    """What is wrong with a character that starts no word."""
    if 48 <= c <= 57 or c == 43 or c == 45 or c == 46:  # noqa: PLR1714
        return NO_LETTER
    return CHARACTER if 32 < c < 127 else BYTE


def scan_words(text, letter, value, first, stop, line, fault):
    """Split text into words, a letter and a number each; returns how many.

    ``first`` and ``stop`` are the offsets of a word in the text, ``line`` counts from 0.  A % is a word without a
    number.  At the first character that fits nowhere the scan ends with ``fault`` = (what, offset, line).
    """
    n = 0
    at_line = 0
    i = 0
    while i < len(text):
        c = text[i]
        if c == 10 or c == 32 or c == 9 or c == 13:  # noqa: PLR1714
            at_line += c == 10
            i += 1
            continue
        if c == 40 or c == 59:  # noqa: PLR1714
            end = _comment_end(text, i, 41 if c == 40 else 10)
            if end < 0:
                bad = -1 - end
                open_ended = bad >= len(text) or text[bad] == 10 or text[bad] == 40
                fault[0], fault[1], fault[2] = (OPEN_COMMENT, i, at_line) if open_ended else (BYTE, bad, at_line)
                return n
            i = end + 1 if c == 40 else end
            continue
        c = c - 32 if 97 <= c <= 122 else c
        number, j = 0.0, i + 1
        what = 0
        if 65 <= c <= 90:
            number, j, digits = _number(text, j)
            what = 0 if digits > 0 else NO_NUMBER
        elif c != 37:
            what = _stray(c)
        if what:
            fault[0], fault[1], fault[2] = what, i, at_line
            return n
        letter[n], value[n], first[n], stop[n], line[n] = c, number, i, j, at_line
        n += 1
        i = j
    return n


def merge_short_moves(ends, always, threshold, position, keep):
    """Mark in ``keep`` the moves that lead farther than the threshold from where the last kept one ended.

    Measured from there, and not from the programmed point before, many short moves cannot add up to a lost one.
    ``position`` is where the first starts, and then where the last kept one ends.
    """
    for i in range(ends.shape[0]):
        square = 0.0
        for there, here in zip(ends[i], position, strict=True):
            square += (there - here) * (there - here)
        keep[i] = always[i] or square >= threshold * threshold
        if keep[i]:
            position[:] = ends[i]
