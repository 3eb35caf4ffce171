"""A part program as Kalico reads it: what it would drop or refuse is written in the words it knows.

Kalico knows absolute G0 to G3 with I J K, G17 to G19, G4 and M400; of a line it takes one command, and no comments in
brackets.  So every move is a line of its own with its F word, an arc has its centre, and what the program waits for (a
dwell, a tool change, a stop) is M400.  G92 sets the start.  Numbers are fixed: an exponent would be an E word.
"""

from __future__ import annotations

import numpy as np

from planner.programs.reading.program import ARC, RAPID, SPLINE, Program

_PLANES = ("G19", "G18", "G17")  # by the axis normal to them
_CENTRES = {0: (1, 2), 1: (0, 2), 2: (0, 1)}
_WAITS_FOR = ("dwell", "tool_change", "stop")


def kalico_text(program: Program) -> str:
    """The text; an arc of more than a turn, or a spline, is a ValueError."""
    lines = ["G90", f"G92 {_words('XYZ', program.start[0])}"]
    waits = {event.after_move for event in program.events if event.kind in _WAITS_FOR}
    plane, feed = 2, np.nan
    for k in range(len(program)):
        if k - 1 in waits:
            lines.append("M400")
        kind, normal = int(program.kind[k]), int(program.normal[k])
        if kind == SPLINE or abs(program.sweep[k]) > 2.0 * np.pi + 1e-9:
            raise ValueError(f"{program.source}:{program.line[k]}: Kalico does not know this move")
        word = "G0" if kind == RAPID else "G1"
        centre = ""
        if kind == ARC:
            if normal != plane:
                lines.append(_PLANES[normal])
                plane = normal
            # Kalico looks at G18 as X Z, where the standard has Z X.
            word = "G2" if (program.sweep[k] < 0.0) != (normal == 1) else "G3"
            offset = program.centre[k] - program.start[k, :3]
            centre = " " + " ".join(_words("IJK"[axis], offset[axis : axis + 1]) for axis in _CENTRES[normal])
        own = program.modal_feed[k]
        f = "" if np.isnan(own) or own == feed else f" F{60.0 * own:.9f}"
        feed = feed if np.isnan(own) else own
        lines.append(f"{word} {_words('XYZ', program.end[k])}{centre}{f}")
    return "\n".join(lines) + "\n"


def _words(letters: str, values: np.ndarray) -> str:
    return " ".join(f"{letter}{value:.12f}" for letter, value in zip(letters, values[: len(letters)], strict=True))
