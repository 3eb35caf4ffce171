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
SPEED_MODE = 12
G_GROUPS = 13
STOP, CHANGE, SPINDLE, COOLANT, SIGNAL, OVERRIDE = range(6)
M_GROUPS = 6

AXIS_LETTERS = "".join(AXES)
NUMBER_LETTERS = f"N{AXIS_LETTERS}IJKRFSTPQDEHL"
# Letters that mean nothing without a word that takes them; those of axes need one as well, and are looked at by themselves.
OWNED_LETTERS = "IJKRPQDEHL"


class LanguageWord(NamedTuple):
    """A G or M word: its modal group, the letters that belong to it, those it cannot be without, and what it does."""

    group: int
    takes: str = ""
    needs: str = ""


def _same(codes: tuple[int, ...], word: LanguageWord) -> dict[int, LanguageWord]:
    return dict.fromkeys(codes, word)


# G words by ten times their number.
G_WORDS: dict[int, LanguageWord] = {
    **_same((0, 10), LanguageWord(MOTION, AXIS_LETTERS)),
    **_same((20, 30), LanguageWord(MOTION, f"{AXIS_LETTERS}IJKRP")),
    **_same((382, 383, 384, 385), LanguageWord(MOTION, AXIS_LETTERS)),
    50: LanguageWord(MOTION, "XYIJPQ"),
    51: LanguageWord(MOTION, "XYIJ"),
    52: LanguageWord(MOTION, "XYPL"),
    53: LanguageWord(MOTION),
    62: LanguageWord(MOTION, "XYZPKR"),
    800: LanguageWord(MOTION),
    **_same((810, 850), LanguageWord(MOTION, "XYZRL")),
    740: LanguageWord(MOTION, "XYZRP"),
    **_same((820, 840, 860, 890), LanguageWord(MOTION, "XYZRLP")),
    **_same((730, 830), LanguageWord(MOTION, "XYZRLQ")),
    40: LanguageWord(ONCE, "P", "P"),
    100: LanguageWord(ONCE, f"LP{AXIS_LETTERS}R", "LP"),
    **_same((280, 300), LanguageWord(ONCE, AXIS_LETTERS)),
    **_same((281, 301), LanguageWord(ONCE)),
    **_same((520, 920), LanguageWord(ONCE, AXIS_LETTERS)),
    **_same((921, 922, 923, 530), LanguageWord(ONCE)),
    **_same((170, 180, 190), LanguageWord(PLANE)),
    **_same((200, 210), LanguageWord(UNITS)),
    **_same((900, 910), LanguageWord(DISTANCE)),
    **_same((901, 911), LanguageWord(CENTRES)),
    **_same((930, 940), LanguageWord(FEED_MODE)),
    **_same((610, 611), LanguageWord(PATH_MODE)),
    640: LanguageWord(PATH_MODE, "PQ"),
    400: LanguageWord(COMPENSATION),
    430: LanguageWord(TOOL_LENGTH, "H"),
    431: LanguageWord(TOOL_LENGTH, AXIS_LETTERS),
    432: LanguageWord(TOOL_LENGTH, f"H{AXIS_LETTERS}"),
    490: LanguageWord(TOOL_LENGTH),
    **_same((540, 550, 560, 570, 580, 590, 591, 592, 593), LanguageWord(SYSTEM)),
    **_same((980, 990), LanguageWord(RETRACT)),
    960: LanguageWord(SPEED_MODE, "D"),
    970: LanguageWord(SPEED_MODE),
}

PROBES = (382, 383, 384, 385)
CUBIC, QUADRATIC, NURBS_BEGIN, NURBS_END, NURBS_KNOTS = 50, 51, 52, 53, 62
CYCLES = (730, 740, 810, 820, 830, 840, 850, 860, 890)

M_WORDS: dict[int, LanguageWord] = {
    **_same((0, 1, 2, 30, 60), LanguageWord(STOP)),
    6: LanguageWord(CHANGE),
    61: LanguageWord(CHANGE, "Q", "Q"),
    **_same((3, 4, 5), LanguageWord(SPINDLE)),
    19: LanguageWord(SPINDLE, "RPQ"),
    **_same((7, 8, 9), LanguageWord(COOLANT)),
    **_same((62, 63, 64, 65), LanguageWord(SIGNAL, "P", "P")),
    66: LanguageWord(SIGNAL, "PELQ"),
    **_same((67, 68), LanguageWord(SIGNAL, "EQ", "E")),
    **_same((48, 49), LanguageWord(OVERRIDE)),
    **_same((50, 51, 52, 53), LanguageWord(OVERRIDE, "P")),
}

# What is known and not read: why, for the message that lists it.
UNREAD: dict[str, str] = {
    "G7": "diameters",
    **dict.fromkeys(("G17.1", "G18.1", "G19.1"), "planes of U, V and W"),
    **dict.fromkeys(("G33", "G33.1", "G76"), "threads"),
    **dict.fromkeys(("G41", "G42", "G41.1", "G42.1"), "cutter compensation"),
    **dict.fromkeys(("G87", "G88"), "cycles that wait for a hand"),
    "G95": "feed per revolution",
}


def word_name(letter: str, value: float) -> str:
    """A G or M word in its shortest form, G1 for G01.0, and of any other the letter alone."""
    return f"{letter}{value:.10g}" if letter in "GM" else letter
