"""When moves and rests begin: by hand, and as an event by event clock has it."""

from __future__ import annotations

import numpy as np
import pytest

from planner.machine.program_setup import RestTimes
from planner.programs.reading.reader import read_program
from planner.programs.schedule import Schedule

TEXT = """\
G21 G90
T1 M6
M3 S5000
G0 X5
G1 X9 F900
G4 P0.5
M3 S9000
G1 X0
M5
T2 M6
M4
G1 X5
M3
G4 P2
M2
"""


def scheduled(folder, text, rests, seconds=None):
    file = folder / "part.ngc"
    file.write_text(text)
    program = read_program(file)
    moving = program.lengths > 0.0
    return Schedule.of(program, np.arange(1.0, 1.0 + moving.sum()) if seconds is None else seconds, rests)


def test_by_hand(tmp_path):
    """The rapid to where the machine stands has no length; the moves take 1, 2 and 3 s."""
    run = scheduled(tmp_path, TEXT, RestTimes(10.0, 3.0))
    assert run.start.tolist() == [13.0, 14.5, 16.5 + 10.0 + 3.0]
    assert [(rest.line, rest.kind, rest.seconds) for rest in run.rests] == [
        (2, "tool_change", 10.0), (3, "spindle", 3.0), (6, "dwell", 0.5), (10, "tool_change", 10.0), (11, "spindle", 3.0),
        (13, "spindle", 3.0), (14, "dwell", 2.0),
    ]  # fmt: skip
    assert run.rest_start.tolist() == [0.0, 10.0, 14.0, 16.5, 26.5, 32.5, 35.5]
    assert run.total == 37.5
    assert [run.rested(kind) for kind in ("dwell", "tool_change", "spindle")] == [2.5, 20.0, 9.0]


def test_what_nobody_says_takes_no_time(tmp_path):
    run = scheduled(tmp_path, TEXT, RestTimes())
    assert run.total == 6.0 + 2.5
    assert run.start.tolist() == [0.0, 1.5, 3.5]


def test_no_rests(tmp_path):
    run = scheduled(tmp_path, "G21 G90\nG1 X5 F900\nX9\nM2\n", RestTimes(1.0, 1.0))
    assert (run.rests, run.start.tolist(), run.total) == ((), [0.0, 1.0], 3.0)


@pytest.mark.parametrize("words", ["M3", "M03 S100", "M4", "S100 M3"])
def test_a_start_is_a_turn_from_rest_or_the_other_way(tmp_path, words):
    other = "M4" if "3" in words else "M3"
    run = scheduled(
        tmp_path, f"G21 G90\n{words}\n{words}\nG1 X5 F9\nS500\n{other}\nM19 R5\n{other}\nM5\nM2\n", RestTimes(0.0, 2.0)
    )
    assert [rest.line for rest in run.rests if rest.kind == "spindle"] == [2, 6, 8]
