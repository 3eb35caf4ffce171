"""Programs that were written are planned again: they hold their limits, and cost what their words and tolerance ask for."""

import re

import numpy as np
import pytest
from cases import PROGRAMS

from planner import Limits, check, plan_feedrate
from planner.output.ngc_program import write_program
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.reader import read_program

# Axes that differ, as on a light gantry: nothing is fast where another thing is.
LIMITS = Limits(200.0, [400.0, 250.0, 100.0], [1000.0, 300.0, 1000.0], [1e5, 1e5, 2e4])
TOLERANCE, SHARE = 0.01, 0.75
FEED = 12_000
AGAIN = 0.5 * (1.0 - SHARE) * TOLERANCE  # in place of P, which is the least with which LinuxCNC keeps to the plan


def random_program(seed):
    """Lines of 1 um to 6 mm, half circles and helices, rapids, exact stops and tolerances, one after the other."""
    rng = np.random.default_rng(seed)
    modes = ["G61", *(f"G64 P{tolerance}" for tolerance in (0.001, 0.01, 0.02, 0.05))]
    out, at, heading = ["G21 G90 G17", f"F{FEED}", str(rng.choice(modes))], np.zeros(3), rng.uniform(-3.0, 3.0)
    for kind in rng.choice(["mode", "rapid", "arc", "line"], int(rng.integers(6, 12)), p=[0.1, 0.15, 0.3, 0.45]):
        if kind == "mode":
            out.append(str(rng.choice(modes)))
            continue
        before = at.copy()
        if rng.random() < 0.3 and kind != "line":
            at[2] = rng.integers(0, 5)
        if kind == "rapid":
            at[:2] += rng.normal(size=2) * 10.0 ** rng.uniform(-2.0, 0.8)
        elif kind == "arc":
            at[0] += 2.0 * 10.0 ** rng.uniform(-1.0, 0.8)
        else:
            heading += rng.choice([0.0, 0.05, -0.3, 1.5, -1.5, 0.8])
            at[:2] += 10.0 ** rng.uniform(-3.0, 0.8) * np.array([np.cos(heading), np.sin(heading)])
        at = np.round(at, 4)
        word = {"rapid": "G0", "arc": str(rng.choice(["G2", "G3"])), "line": "G1"}[kind]
        centre = f" I{0.5 * (at[0] - before[0]):.5f} J0" if kind == "arc" else ""
        out.append(f"{word} X{at[0]:.4f} Y{at[1]:.4f} Z{at[2]:.4f}{centre}")
    return "\n".join([*out, "M2"]) + "\n"


def planned(file, tolerance):
    program = read_program(file)
    # Paths made before their feed: the blocks of a written program are short, and their runs are made so.
    path = program_path(program, tolerance, LIMITS, path="separate")
    limits = LIMITS.for_curve(path.curve)
    profile = plan_feedrate(path.curve, limits, intervals=None)
    report = check(path.curve, limits, profile)
    assert report.ok, report.violations
    assert profile.work.slowdown <= 1.001
    return program, path, profile


def assert_planned_again(folder, text):
    first, again = folder / "first.ngc", folder / "again.ngc"
    first.write_text(text)
    program, path, profile = planned(first, SHARE * TOLERANCE)
    write_program(again, program, path, profile, tolerance=(1.0 - SHARE) * TOLERANCE)
    _, as_written, capped = planned(again, AGAIN)
    # Each F is at most the highest feed of the plan in its block, so on every ramp it takes something off.
    assert capped.duration <= 1.3 * profile.duration + 0.02 * len(as_written.stops)
    again.write_text(re.sub(r" F[\d.]+", "", again.read_text()).replace("G94", f"G94\nF{FEED}"))
    _, _, free = planned(again, AGAIN)
    extra = len(as_written.stops) - len(path.stops)  # where the exact mode of the last block before a rest begins
    rests = len(path.stops) + 1  # the end is one
    assert 0 <= extra <= rests
    # An eighth of the tolerance is left to the corners.
    assert free.duration <= 1.035 * profile.duration + 0.02 * extra


@pytest.mark.parametrize("seed", range(6))
def test_a_program_that_was_written_is_planned_again(tmp_path, seed):
    assert_planned_again(tmp_path, random_program(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6, 36))
def test_every_program_that_was_written_is_planned_again(tmp_path, seed):
    assert_planned_again(tmp_path, random_program(seed))


def test_places_at_which_only_the_feed_changes_are_not_beside_others(tmp_path):
    """A line that ended 24 um before a knot of its tube, on the way to a stop, was slowed down seventyfold."""
    text = (PROGRAMS / "stops.ngc").read_text()
    assert_planned_again(tmp_path, re.sub(r"F\d+", f"F{FEED}", text))
    first, again = tmp_path / "first.ngc", tmp_path / "again.ngc"
    first.write_text(text)
    program, path, profile = planned(first, SHARE * TOLERANCE)
    write_program(again, program, path, profile, tolerance=(1.0 - SHARE) * TOLERANCE)
    _, as_written, capped = planned(again, AGAIN)
    assert capped.duration <= 1.12 * profile.duration
    near = np.diff(as_written.curve._candidate_breaks())
    assert near.min() > 1e-5
