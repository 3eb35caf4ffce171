"""The words that are read: of each G and M word its modal group, and the letters that belong to it.

A new word is a line here, and where it does what no other does, a line in the table of that: cycles, or words that act at
once.
"""

from __future__ import annotations

from typing import NamedTuple

from planner.geometry.curve import AXES

# The modal groups; of each one word may stand in a block.
MOTION, PLANE, UNITS, DISTANCE, CENTRES, FEED_MODE, PATH_MODE, ONCE, COMPENSATION, TOOL_LENGTH, SYSTEM, RETRACT = range(
    12
)
SPEED_MODE, DIAMETER = 12, 13
G_GROUPS = 14
STOP, CHANGE, SPINDLE, COOLANT, SIGNAL, OVERRIDE = range(6)
M_GROUPS = 6

AXIS_LETTERS = "".join(AXES)
NUMBER_LETTERS = f"N{AXIS_LETTERS}IJKRFSTPQDEHL"
# Letters that mean nothing without a word that takes them; those of axes need one as well, and are looked at by themselves.
OWNED_LETTERS = "IJKRPQDEHL"


class LanguageWord(NamedTuple):
    """A G or M word: its modal group, the letters that belong to it, those it cannot be without, and whether it may stand
    where cutter compensation is on.
    """

    group: int
    takes: str = ""
    needs: str = ""
    beside: bool = True


def _same(codes: tuple[int, ...], word: LanguageWord) -> dict[int, LanguageWord]:
    return dict.fromkeys(codes, word)


# G words by ten times their number.
G_WORDS: dict[int, LanguageWord] = {
    **_same((0, 10), LanguageWord(MOTION, AXIS_LETTERS)),
    **_same((20, 30), LanguageWord(MOTION, f"{AXIS_LETTERS}IJKRP")),
    **_same((382, 383, 384, 385), LanguageWord(MOTION, AXIS_LETTERS, beside=False)),
    330: LanguageWord(MOTION, f"{AXIS_LETTERS}K", beside=False),
    331: LanguageWord(MOTION, "XYZIK", beside=False),
    760: LanguageWord(MOTION, "XYZIJKPQRHEL", beside=False),
    50: LanguageWord(MOTION, "XYIJPQ", beside=False),
    51: LanguageWord(MOTION, "XYIJ", beside=False),
    52: LanguageWord(MOTION, "XYPL", beside=False),
    53: LanguageWord(MOTION, beside=False),
    62: LanguageWord(MOTION, "XYZPKR", beside=False),
    800: LanguageWord(MOTION),
    **_same((810, 850), LanguageWord(MOTION, "XYZRL", beside=False)),
    740: LanguageWord(MOTION, "XYZRP", beside=False),
    **_same((820, 840, 860, 890), LanguageWord(MOTION, "XYZRLP", beside=False)),
    **_same((730, 830), LanguageWord(MOTION, "XYZRLQ", beside=False)),
    40: LanguageWord(ONCE, "P", "P"),
    100: LanguageWord(ONCE, f"LP{AXIS_LETTERS}R", "LP"),
    **_same((280, 300), LanguageWord(ONCE, AXIS_LETTERS, beside=False)),
    **_same((281, 301), LanguageWord(ONCE, beside=False)),
    **_same((520, 920), LanguageWord(ONCE, AXIS_LETTERS, beside=False)),
    **_same((921, 922, 923, 530), LanguageWord(ONCE, beside=False)),
    **_same((170, 180, 190, 171, 181, 191), LanguageWord(PLANE)),
    **_same((200, 210), LanguageWord(UNITS)),
    **_same((900, 910), LanguageWord(DISTANCE)),
    **_same((901, 911), LanguageWord(CENTRES)),
    **_same((930, 940, 950), LanguageWord(FEED_MODE)),
    **_same((610, 611), LanguageWord(PATH_MODE, beside=False)),
    640: LanguageWord(PATH_MODE, "PQ", beside=False),
    400: LanguageWord(COMPENSATION),
    **_same((410, 420), LanguageWord(COMPENSATION, "D")),
    **_same((411, 421), LanguageWord(COMPENSATION, "DL", "D")),
    430: LanguageWord(TOOL_LENGTH, "H", beside=False),
    431: LanguageWord(TOOL_LENGTH, AXIS_LETTERS, beside=False),
    432: LanguageWord(TOOL_LENGTH, f"H{AXIS_LETTERS}", beside=False),
    490: LanguageWord(TOOL_LENGTH, beside=False),
    **_same((540, 550, 560, 570, 580, 590, 591, 592, 593), LanguageWord(SYSTEM, beside=False)),
    **_same((980, 990), LanguageWord(RETRACT, beside=False)),
    960: LanguageWord(SPEED_MODE, "D"),
    970: LanguageWord(SPEED_MODE),
    **_same((70, 80), LanguageWord(DIAMETER)),
}

PROBES = (382, 383, 384, 385)
CUBIC, QUADRATIC, NURBS_BEGIN, NURBS_END, NURBS_KNOTS = 50, 51, 52, 53, 62
THREAD, TAP, THREADING = 330, 331, 760  # their feed is that of the spindle
CYCLES = (730, 740, 810, 820, 830, 840, 850, 860, 890, TAP, THREADING)

M_WORDS: dict[int, LanguageWord] = {
    **_same((0, 1, 2, 30, 60), LanguageWord(STOP)),
    6: LanguageWord(CHANGE, beside=False),
    61: LanguageWord(CHANGE, "Q", "Q"),
    **_same((3, 4, 5), LanguageWord(SPINDLE)),
    19: LanguageWord(SPINDLE, "RPQ"),
    **_same((7, 8, 9), LanguageWord(COOLANT)),
    **_same((62, 63, 64, 65), LanguageWord(SIGNAL, "P", "P", beside=False)),
    66: LanguageWord(SIGNAL, "PELQ", beside=False),
    **_same((67, 68), LanguageWord(SIGNAL, "EQ", "E", beside=False)),
    **_same((48, 49), LanguageWord(OVERRIDE, beside=False)),
    **_same((50, 51, 52, 53), LanguageWord(OVERRIDE, "P", beside=False)),
}

# What is known and not read: why, for the message that lists it.
UNREAD: dict[str, str] = {
    **dict.fromkeys(("G87", "G88"), "cycles that wait for a hand"),
    **dict.fromkeys((f"M{number}" for number in range(100, 200)), "a code of the user"),
}


def word_name(letter: str, value: float) -> str:
    """A G or M word in its shortest form, G1 for G01.0, and of any other the letter alone."""
    return f"{letter}{value:.10g}" if letter in "GM" else letter
