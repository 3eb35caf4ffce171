"""What happens between the moves of a program: dwells, stops, tool changes and switches."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from planner.programs.reading.blocks import WordColumn
from planner.programs.reading.language import CHANGE, COOLANT, ONCE, SIGNAL, SPINDLE, STOP, SYSTEM, TOOL_LENGTH
from planner.programs.reading.modal import carry_forward
from planner.programs.reading.move_making import MovesOfPart
from planner.programs.reading.positions import ProgramTrack
from planner.programs.reading.program import Event, Program
from planner.programs.reading.words import Mask

_DWELL = 40
_MESSAGE = re.compile(rb"^[^;(\r\n]*\([ \t]*MSG[ \t]*,[^)\r\n]*\)", re.IGNORECASE | re.MULTILINE)
_TURNING = (3, 4, 5)
_SIGNALS_AT_ONCE = (64, 65, 66, 68)  # M62, M63 and M67 act with the next move
_STOP_KINDS = {0: "stop", 1: "optional_stop", 2: "end", 30: "end", 60: "stop"}


def add_events(track: ProgramTrack, moves: MovesOfPart) -> None:
    """Note events in the order in which a controller acts on them; the state takes them."""
    blocks, state = track.blocks, track.state
    letters, dwell = blocks.letters, blocks.g[ONCE].has(_DWELL)
    speed, tool = letters["S"], letters["T"]
    change, spindle, coolant, stop = (blocks.m[k] for k in (CHANGE, SPINDLE, COOLANT, STOP))
    signal, system, length = blocks.m[SIGNAL], blocks.g[SYSTEM], blocks.g[TOOL_LENGTH]
    at_once = signal.has(*_SIGNALS_AT_ONCE)
    others = [
        ("coolant", coolant.given, (coolant,)),
        ("signal", at_once, (signal, letters["P"])),
        ("offset", system.given | length.given, (system, length)),
    ]
    named = np.logical_or.reduce([column.given for column in (speed, tool, change, spindle, coolant, stop)])
    named |= dwell | at_once | system.given | length.given
    inside: dict[int, list[tuple[float, int]]] = {}
    for row, seconds, index in moves.dwells:
        inside.setdefault(row, []).append((seconds, index))
        named[row] = True
    last = state.moves + np.cumsum(moves.count) - 1
    for row in np.flatnonzero(named).tolist():
        line, after = int(blocks.line[row]), int(last[row])
        before = after - int(moves.count[row])

        def text(*columns: WordColumn, row: int = row) -> str:
            return " ".join(blocks.words.word(int(c.word[row])) for c in columns if c.given[row])

        def note(kind: str, words: str, index: int, seconds: float = 0.0, line: int = line) -> None:
            state.events.append(Event(line, kind, seconds, index, words))

        if tool.given[row]:
            state.tool = text(tool)
            if not change.given[row]:
                note("tool", state.tool, before)
        if change.given[row] and change.value[row] == 6:
            at = before if state.offsets.tool_change is None else after
            note("tool_change", f"{text(change)} {state.tool}".strip(), at)
        if spindle.given[row] or (speed.given[row] and speed.value[row] != state.spindle):
            note("spindle", text(spindle, speed), before)
        if speed.given[row]:
            state.spindle = float(speed.value[row])
        if spindle.given[row] and spindle.value[row] in _TURNING:
            state.spindle_code = int(spindle.value[row])
        for kind, columns in _of_block(others, row):
            note(kind, text(*columns), before)
        if dwell[row]:
            note("dwell", text(blocks.g[ONCE], letters["P"]), before, float(letters["P"].value[row]))
        for seconds, index in inside.get(row, ()):
            note("dwell", f"P{seconds:g}", state.moves + index, seconds)
        if stop.given[row]:
            note(_STOP_KINDS[int(stop.value[row])], text(stop), after)
    state.coolant_code = int(carry_forward(coolant.given, coolant.value, state.coolant_code)[-1])


def _of_block(
    others: Sequence[tuple[str, Mask, tuple[WordColumn, ...]]], row: int
) -> list[tuple[str, tuple[WordColumn, ...]]]:
    """Kinds and words of what a block has."""
    return [(kind, columns) for kind, given, columns in others if given[row]]


def with_messages(program: Program, file: Path) -> Program:
    """Add an event for each comment that is a message, ``(MSG, ...)``, to a program whose lines are run in their order."""
    raw = file.read_bytes()
    found = [(raw.count(b"\n", 0, match.start()) + 1, match[0].decode("latin-1")) for match in _MESSAGE.finditer(raw)]
    if not found:
        return program
    after = np.searchsorted(program.line, [line for line, _ in found], side="right") - 1
    messages = [Event(line, "message", 0.0, int(at), text) for (line, text), at in zip(found, after, strict=True)]
    events = sorted([*program.events, *messages], key=lambda event: event.after_move)
    return replace(program, events=tuple(events))
