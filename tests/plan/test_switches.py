"""Where a plan switches its jerk: planted smears, and an S-curve whose switches are known."""

import numpy as np
import pytest
from cases import drives, line

from planner.plan.ends import REST
from planner.plan.guess import guess_feed
from planner.plan.section import cut
from planner.plan.stage import Stage, Task
from planner.plan.switches import _switches
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap


@pytest.mark.parametrize("at", [0.4, 2.05, 2.5, 2.9])
@pytest.mark.parametrize(("before", "after"), [(1.0, -1.0), (-1.0, 0.0), (0.2, 1.0)])
def test_a_smear_with_the_integral_of_a_jump_is_put_back_where_the_jump_was(at, before, after):
    """Linear from level to level over an interval: the jump is in its middle, wherever the knots are."""
    time = np.array([0.0, at, at + 1.0, at + 2.0, at + 5.0])
    levels = np.array([[before, before, after, after, after]])
    found = _switches(levels, np.abs(np.diff(levels[0])), np.zeros(4, dtype=bool), time, 1)
    assert found == pytest.approx([at + 0.5], rel=1e-14)


@pytest.mark.parametrize("middle", [0.57, 0.3, -0.2])
@pytest.mark.parametrize("after", [0.0, -1.0])
def test_a_smear_that_ends_in_a_jump_at_a_double_knot_is_put_back_where_the_jump_was(middle, after):
    """From 1 to a level in between over an interval, and the rest at once at the end of a macro."""
    time = np.array([0.0, 1.0, 2.0, 2.0, 5.0])
    levels = np.array([[1.0, 1.0, middle, after, after]])
    found = _switches(levels, np.abs(np.diff(levels[0])), np.zeros(4, dtype=bool), time, 1)
    left_over = 0.5 * (1.0 + middle) - after  # beyond the second level, of an interval of length 1
    expected = 1.0 + left_over / (1.0 - after)
    assert found == pytest.approx([expected] if expected <= 2.0 else [], rel=1e-14)


def test_levels_that_stay_have_no_switch():
    time = np.arange(9.0)
    drift = np.linspace(-0.5, 0.5, 9)[None, :]  # 0.125 an interval
    assert _switches(drift, np.abs(np.diff(drift[0])), np.zeros(8, dtype=bool), time, 1).size == 0
    there_and_back = np.array([[1.0, 1.0, 0.6, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]])
    jump = np.repeat([[1.0, -1.0]], [4, 5], axis=1)
    at_cap = np.arange(8) > 2  # what a solver's last digits make of a jerk along the largest speed
    assert _switches(jump, np.abs(np.diff(jump[0])), at_cap, time, 1).size == 0
    assert _switches(there_and_back, np.abs(np.diff(there_and_back[0])), np.zeros(8, dtype=bool), time, 1).size == 0


def s_curve_stage(intervals):
    """The even grid of 20 mm of line at 100 mm/s: jerk, no jerk, jerk; 0.1 s of cruising; the same backwards, 0.35 s."""
    curve, limits = line(20.0), drives(100.0)
    (section,) = cut(curve, limits, REST, REST, exact_stop=False)
    guess = guess_feed(section, limits, intervals)
    on = TimeMap.from_guess(section, limits, guess, np.empty(0), intervals // 12)
    task = Task(section, limits, guess, "optimal", False, np.inf, None)
    stage = Stage.on(task, TimeGrid.even(on, 12))
    attempt = stage.solve(task, None)
    law = stage.time_law(attempt)
    sigma = np.linspace(0.0, law.t[-1], intervals // 12 + 1)
    stage = Stage.on(task, TimeGrid.even(TimeMap.from_law(section, law, sigma), 12))
    attempt = stage.solve(task, None)
    return stage, attempt, stage.time_law(attempt)


@pytest.mark.parametrize("intervals", [72, 96, 192, 240, 300])
def test_the_switches_of_an_s_curve_are_found_to_a_quarter_of_an_interval(intervals):
    """Also where a macro ends beside one, at 72, 240 and 300."""
    stage, attempt, law = s_curve_stage(intervals)
    found = stage.jerk_changes(attempt, law)
    assert found.time[-1] == law.t[-1]
    exact, interval = 0.05 * np.array([1, 2, 5, 6]), law.t[-1] / intervals  # 0.15 and 0.2 are the ends of the cruising
    nearest = np.abs(found.switches[:, None] - exact).min(axis=0)
    assert (nearest < 0.25 * interval).all()
    # and so much of the jerk changes at each: by its limit, or by more where a double knot beside it lets the jerk ring
    ends = stage.grid.map.sigma
    for at in exact:
        near = np.abs(0.5 * (found.time[1:] + found.time[:-1]) - at) < 4.0 * interval
        beside = np.abs(ends - at).min() < 2.0 * interval
        assert 0.95 < found.change[near].sum() < (2.5 if beside else 1.35)
    assert found.change[np.diff(stage.grid.sigma) == 0.0].max() == 0.0
