"""What is in force, kept by M70 and M73, and brought back by M72 or at the end of the subroutine with the M73.

Kept are units, plane, distances, centres, feed mode, coordinate system, tool length on or off, return level, path mode
with its tolerances, feed, spindle and coolant; the motion is not, as on LinuxCNC.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.programs.reading.language import FEED_MODE, MOTION, PATH_MODE, UNITS
from planner.programs.reading.modal import INCH_MM, ReadingState
from planner.programs.reading.offsets import SYSTEM_CODES

_INCH, _BLEND, _PER_MINUTE = 200, 640, 940
ModeWords = list[tuple[str, float]]


@dataclass(frozen=True)
class SavedModes:
    """The words in force; feed and tolerances in mm."""

    units: int
    modes: tuple[int, ...]
    path: tuple[int, float, float]
    feed: float
    spindle: tuple[int, float]
    coolant: int


def saved_modes(state: ReadingState) -> SavedModes:
    """What is in force now."""
    apart = (MOTION, UNITS, PATH_MODE)
    modes = [code for group, code in sorted(state.modal.items()) if group not in apart]
    modes += [SYSTEM_CODES[state.offsets.active], 430 if state.offsets.length.any() else 490]
    feed = state.feed if state.modal[FEED_MODE] == _PER_MINUTE else np.nan
    path = (state.modal[PATH_MODE], state.tolerance, state.naive)
    return SavedModes(
        state.modal[UNITS], tuple(modes), path, feed, (state.spindle_code, state.spindle), state.coolant_code
    )


def restoring_blocks(saved: SavedModes, now: SavedModes) -> list[ModeWords]:
    """Blocks that bring back what was saved, of what is not in force now; units first, since feeds count in them."""
    unit = INCH_MM if saved.units == _INCH else 1.0
    first: ModeWords = [("G", saved.units / 10.0)] if saved.units != now.units else []
    words: ModeWords = [("G", code / 10.0) for code, here in zip(saved.modes, now.modes, strict=True) if code != here]
    if repr(saved.path) != repr(now.path):  # nan is nan
        mode, *tolerances = saved.path
        words.append(("G", mode / 10.0))
        if mode == _BLEND:
            words += [(name, value / unit) for name, value in zip("PQ", tolerances, strict=True) if not np.isnan(value)]
    if saved.feed != now.feed and not np.isnan(saved.feed):
        words.append(("F", saved.feed * 60.0 / unit))
    (code, speed), (code_now, speed_now) = saved.spindle, now.spindle
    if speed != speed_now and not np.isnan(speed):
        words.append(("S", speed))
    words += [("M", float(code))] if code != code_now else []
    words += [("M", float(saved.coolant))] if saved.coolant != now.coolant else []
    return [block for block in (first, words) if block]
