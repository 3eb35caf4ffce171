"""What happens between the moves: dwells of the calls, and the stops and switches of the lines that were run."""

from __future__ import annotations

import re

import numpy as np

from planner.errors import InputError
from planner.programs.linuxcnc import canon
from planner.programs.linuxcnc.calls import CallColumns, unit_mm
from planner.programs.linuxcnc.interpreter import CanonicalCalls
from planner.programs.reading.program import Event
from planner.programs.reading.words import LineArray
from planner.types import FloatArray

_WORD = re.compile(r"(?<![<A-Z#])([MSTPQ]|G(?=64))([-+]?\d*\.?\d+|[-+]?\d+\.|[\[#-].*)")
_OF_INTEREST = re.compile(r"M|S|T|G64")
_BEFORE = {3: "spindle", 4: "spindle", 5: "spindle", 19: "spindle", 7: "coolant", 8: "coolant", 9: "coolant"}
_AFTER = {0: "stop", 1: "optional_stop", 2: "end", 30: "end", 60: "stop"}
_CHANGE = 6


def events_and_tolerances(
    calls: CanonicalCalls, columns: CallColumns, after: LineArray
) -> tuple[list[Event], FloatArray]:
    """Find the events, and P and Q of G64 at every move, (m, 2), mm; nan where none is given.

    ``after`` is for each row of the calls the index of the last kept move up to it.
    """
    table = calls.rows
    found: list[tuple[int, Event]] = []  # with the row at which each happens
    tolerances = np.full((columns.rows.size, 2), np.nan)
    ends = np.append(columns.marks[1:], len(table))
    wanted = [[_is_of_interest(line) for line in lines] for lines in calls.marked.lines]
    tool = ""
    for row, end, line in zip(columns.marks.tolist(), ends.tolist(), columns.mark_lines.tolist(), strict=True):
        file, number = int(table[row, 3]), int(table[row, 4])
        if not wanted[file][number - 1]:
            continue
        words = [(m[1], m[2]) for m in _WORD.finditer(calls.marked.lines[file][number - 1])]
        tool = next((f"T{value}" for letter, value in words if letter == "T"), tool)
        for kind, text, later in _happenings(words, tool):
            place = end - 1 if later else row
            found.append((place, Event(line, kind, 0.0, int(after[place]), text)))
        if ("G", "64") in words:
            place = np.searchsorted(columns.rows, row)
            unit = float(unit_mm(columns.state[min(place, len(columns.state) - 1)])) if len(columns.state) else 1.0
            tolerances[place:] = _blend(calls, line, words, unit)
    for row in np.flatnonzero(table[:, 0] == canon.DWELL).tolist():
        place = np.searchsorted(columns.marks, row) - 1
        line = int(columns.mark_lines[place]) if place >= 0 else 1
        found.append((row, Event(line, "dwell", float(table[row, 3]), int(after[row]), f"P{table[row, 3]:g}")))
    return [event for _, event in sorted(found, key=lambda item: item[0])], tolerances


def _is_of_interest(line: str) -> bool:
    return not line.startswith("O") and _OF_INTEREST.search(line) is not None


def _happenings(words: list[tuple[str, str]], tool: str) -> list[tuple[str, str, bool]]:
    """The events of a line: kind, words, and whether it comes after the motion."""
    codes = [int(float(value)) for letter, value in words if letter == "M" and value[0] not in "[#-"]
    out = []
    if _CHANGE in codes:
        out.append(("tool_change", f"M6 {tool}".strip(), False))
    elif any(letter == "T" for letter, _ in words):
        out.append(("tool", tool, False))
    speed = [f"S{value}" for letter, value in words if letter == "S"]
    for kind, further in (("spindle", speed), ("coolant", [])):
        said = [f"M{code}" for code in codes if _BEFORE.get(code) == kind] + further
        if said:
            out.append((kind, " ".join(said), False))
    return [*out, *((_AFTER[code], f"M{code}", True) for code in codes if code in _AFTER)]


def _blend(calls: CanonicalCalls, line: int, words: list[tuple[str, str]], unit: float) -> list[float]:
    """P and Q of G64, mm."""
    out = []
    for name in "PQ":
        value = next((number for letter, number in words if letter == name), "nan")
        if value[0] in "[#-":
            raise InputError(
                f"{calls.marked.names[0]}:{line}: G64: LinuxCNC does not tell its tolerance {name}; "
                "write a number, or give it with --tolerance-mm"
            )
        out.append(float(value) * unit)
    return [out[0] if out[0] > 0.0 else np.nan, out[1]]
