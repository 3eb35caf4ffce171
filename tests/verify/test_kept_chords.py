"""Where the accelerations keep every chord: by a motion that uses all of them, and only of a path with a feed of its own."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import drives
from program_blocks import line, program

from planner import load_curve
from planner.programs.path.smooth_path import program_path
from planner.verify.kept_chords import without_kept_chords

PERIOD = 2e-3
AXES = ("X", "Y", "A")


@cache
def turning():
    limits = replace(drives(dim=3, axes=AXES), jerk=[2e4, 2e4, 1e3])
    return program_path(program(line(10, 0, 0, 0.1), line(10, 10, 0, 0.2), tolerance=0.01), None, limits).curve


def height_over_the_chord(acceleration):
    """How far a point that has the acceleration all the time is off the chord of a period in its middle."""
    acceleration = np.array(acceleration)
    start, middle, end = (0.5 * acceleration * t**2 for t in (0.0, 0.5 * PERIOD, PERIOD))
    return float(np.linalg.norm(middle - 0.5 * (start + end)))


@pytest.mark.parametrize(("share", "kept"), [(1.0 + 1e-9, True), (1.0 - 1e-9, False)])
def test_it_is_left_out_where_the_largest_acceleration_keeps_it(share, kept):
    curve = turning()
    assert curve.timing is not None
    highest = height_over_the_chord([600.0, 800.0])  # A turns and moves no tip
    limits = replace(
        drives(dim=3, axes=AXES), acceleration=[600.0, 800.0, 1e4], chord_error=share * highest, period=PERIOD
    )
    assert np.isinf(without_kept_chords(curve, limits).chord_error) == kept


def test_on_other_paths_it_always_counts():
    curve = load_curve("teardrop")
    limits = drives(dim=2, axes=("X", "Y"))
    limits = replace(limits, chord_error=1.0, period=PERIOD)
    assert without_kept_chords(curve, limits) == limits
