"""Feeds in neighbouring passes: a pass that is planted slower is found to the last digits, equal ones are equal."""

from dataclasses import replace

import numpy as np
import pytest
from cases import PROGRAMS, drives
from program_blocks import line, program, rapid

from planner import plan_feedrate
from planner.law import TimeLaw
from planner.profile import make_profile
from planner.programs.neighbours import neighbouring_passes
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.reader import read_program

LIMITS = drives(dim=3)
PASSES, LENGTH, LIFT = 4, 60.0, 6.0


def raster(step=0.5, *, back=True, feed=100.0, wave=0.0):
    """Passes along X, ``step`` apart, each from a stop to a stop: a rapid up, over, and down lies between."""
    moves = []
    for k in range(PASSES):
        y = step * k
        x = np.linspace(0.0, LENGTH, 61)
        x = x[::-1] if back and k % 2 else x
        moves += [rapid(x[0], y, LIFT), rapid(x[0], y, wave * np.sin(x[0] / 4.0))]
        moves += [line(place, y, wave * np.sin(place / 4.0), feed=feed) for place in x[1:]]
        moves.append(rapid(x[-1], y, LIFT))
    return program(*moves, start=(0.0, 0.0, LIFT))


def planned(source):
    path = program_path(source, 0.01, LIMITS, path="separate")
    limits = LIMITS.for_curve(path.curve)
    return path, plan_feedrate(path.curve, limits), limits


def slower_in(profile, path, first, last, factor):
    """The plan, with the blocks between two exact stops run in ``factor`` of their time."""
    law = profile.law
    inside = (law.u >= path.u[first]) & (law.u <= path.u[last])
    step = np.diff(law.t, prepend=0.0) * np.where(np.append(False, inside[1:] & inside[:-1]), factor, 1.0)
    rate = np.where(inside, factor, 1.0)
    changed = TimeLaw(np.cumsum(step), law.u, law.u_rate / rate, law.u_acceleration / rate**2)
    return make_profile(profile.curve, LIMITS.for_curve(path.curve), changed, method=profile.method)


def blocks_of(path, number):
    """First block of a pass, and the one after its last."""
    cuts = np.flatnonzero(np.diff(np.concatenate([[True], path.rapid, [True]]).astype(int)))
    return cuts[2 * number], cuts[2 * number + 1]


@pytest.mark.parametrize("back", [True, False])
def test_straight_passes_are_equal_and_a_slower_one_is_found(back):
    path, profile, limits = planned(raster(back=back))
    found = neighbouring_passes(path, profile, limits)
    assert found.worst < 1e-4
    first, last = blocks_of(path, 2)
    changed = neighbouring_passes(path, slower_in(profile, path, first, last, 1.02), limits)
    expected = 0.02 / (0.5 * 2.02)
    assert changed.worst == pytest.approx(expected, abs=2.0 * found.worst)
    slow = range(path.line[first], path.line[last - 1] + 1)
    assert sum(number in slow for number in changed.lines) == 1
    # Of the places some have another neighbour than the slow pass; those of the slow pass, and of some beside it, differ.
    assert expected / PASSES < changed.mean < 4.0 * expected / PASSES


def test_the_margin_is_what_the_machine_takes_to_brake():
    """Places nearer to a stop than v (v / A + A / J) / 2 = 7.5 mm are left out, of every pass."""
    path, profile, limits = planned(raster())
    found = neighbouring_passes(path, profile, limits)
    assert found.length == pytest.approx(PASSES * (LENGTH - 15.0), rel=0.03)


@pytest.mark.parametrize("step", [0.05, 0.5, 1.9])
def test_passes_within_reach_are_compared(step):
    path, profile, limits = planned(raster(step, wave=1.0))
    found = neighbouring_passes(path, profile, limits)
    assert found.length > 0.9 * PASSES * (LENGTH - 15.0)


def test_the_same_place_is_taken_across_the_path():
    """Equal passes, there and back, whose places do not lie side by side, on slopes where the feed changes fast."""
    path, profile, limits = planned(raster(0.5, wave=1.0))
    assert np.ptp(profile.feed[profile.feed > 1.0]) > 30.0
    found = neighbouring_passes(path, profile, limits)
    assert found.mean < 2e-4


def test_nothing_is_said_where_there_is_nothing_to_compare():
    for source in (
        raster(5.0),  # out of reach
        program(line(100.0, 0.0)),
        program(line(10.0, 0.0), line(10.0, 0.5), line(0.0, 0.5)),  # all of it near a turn
        read_program(PROGRAMS / "stops.ngc"),
    ):
        path, profile, limits = planned(source)
        assert neighbouring_passes(path, profile, limits) is None


def test_passes_under_another_feed_are_not_compared():
    """A finishing pass beside a roughing one, or a program whose F word differs, is not a fault."""
    moves = []
    for k in range(2):
        y = 0.5 * k
        ends = (0.0, LENGTH) if k == 0 else (LENGTH, 0.0)
        moves += [rapid(ends[0], y, LIFT), rapid(ends[0], y, 0.0), line(ends[1], y, 0.0, feed=100.0 - 40.0 * k)]
        moves.append(rapid(ends[1], y, LIFT))
    path, profile, limits = planned(program(*moves, start=(0.0, 0.0, LIFT)))
    assert neighbouring_passes(path, profile, limits) is None


def test_axes_without_a_jerk_limit():
    source = raster()
    path = program_path(source, 0.01, LIMITS, path="separate")
    limits = replace(LIMITS.for_curve(path.curve)).without_jerk()
    profile = plan_feedrate(path.curve, limits)
    found = neighbouring_passes(path, profile, limits)
    assert found.worst < 1e-6
    # Braking alone: v^2 / 2A = 5 mm.
    assert found.length == pytest.approx(PASSES * (LENGTH - 10.0), rel=0.03)


def test_a_program_of_turns_alone_has_none():
    moves = [line(0.0, 0.0, 0.0, angle, feed=100.0) for angle in (90.0, 0.0, 90.0, 0.0)]
    limits = drives(dim=4, axes="XYZA")
    path = program_path(program(*moves), 0.01, limits)
    own = limits.for_curve(path.curve)
    profile = plan_feedrate(path.curve, own)
    assert neighbouring_passes(path, profile, own) is None
