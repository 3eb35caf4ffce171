"""Where knots go in the time of a law: where its jerk changes, on breaks and switches, beside curvature jumps."""

import numpy as np
import pytest
from cases import drives, line, line_arc_line
from problems import laid_out

from planner import load_curve, plan_feedrate
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.plan import time_knots
from planner.plan.guess import breaks_inside, guess_feed
from planner.plan.section import cut
from planner.plan.time_knots import JerkChanges, place_in_time

MILL = drives(100.0)


def laws(curve, limits: Limits = MILL):
    (section,) = cut(curve, limits, exact_stop=False)
    profile = plan_feedrate(curve, limits, intervals=200)
    law = TimeLaw(profile.t, profile.u, profile.u_rate, profile.u_acceleration)
    return section, law, guess_feed(section, limits, 200)


def no_changes(law, switches=()):
    time = np.linspace(0.0, law.t[-1], 101)
    return JerkChanges(time, np.zeros(100), np.array(switches))


@pytest.mark.parametrize("name", ["teardrop", "circle", "butterfly-nurbs"])
@pytest.mark.parametrize("intervals", [100, 400])
def test_without_changes_knots_are_even_in_time_between_breaks(name, intervals):
    section, law, guess = laws(load_curve(name))
    grid = place_in_time(section, law, no_changes(law), intervals, guess=guess)
    h = np.diff(grid.sigma)
    assert np.count_nonzero(h) == grid.intervals
    assert grid.intervals == pytest.approx(intervals, rel=0.1, abs=breaks_inside(section).size)
    assert grid.sigma[-1] == grid.map.span == law.t[-1]
    if not breaks_inside(section).size:
        assert h[h > 0.0] == pytest.approx(np.full(grid.intervals, law.t[-1] / grid.intervals), rel=1e-6)
    # every break is the end of a macro, and has a knot on either side
    ends = grid.map.u[1:][grid.at_breaks]
    assert np.array_equal(ends, np.append(breaks_inside(section), section.u_end))
    assert np.array_equal(grid.sigma[grid.left], grid.map.sigma[1:])
    assert np.array_equal(grid.sigma[grid.left[:-1] + 1], grid.sigma[grid.left[:-1]])
    assert (np.diff(grid.macro) == (np.isin(np.arange(grid.sigma.size - 1), grid.left))).all()


def test_half_of_the_knots_go_where_the_jerk_changes_and_neighbours_differ_little():
    section, law, guess = laws(line(200.0))
    changes = no_changes(law)
    changes.change[[20, 60]] = 1.0
    grid = place_in_time(section, law, changes, 200, guess=guess)
    h = np.diff(grid.sigma)
    full = h[h > 0.0]
    assert full.size == pytest.approx(200, abs=3)
    middle = 0.5 * (grid.sigma[1:] + grid.sigma[:-1])[h > 0.0]
    for k in (20, 60):
        near = np.abs(middle - 0.5 * (changes.time[k] + changes.time[k + 1])) < law.t[-1] / 100
        assert np.count_nonzero(near) > 35
    ratio = full[1:] / full[:-1]
    assert ratio.max() < 2.1
    assert ratio.min() > 1.0 / 2.1
    even = place_in_time(section, law, changes, 200, guess=guess, even=True)
    assert np.ptp(np.diff(even.sigma)[np.diff(even.sigma) > 0.0]) < 1e-6 * law.t[-1]


def test_a_switch_has_a_double_knot_unless_it_is_at_a_break_or_beside_another():
    curve = load_curve("circle")
    section, law, guess = laws(curve)
    at_break = float(law.t[np.searchsorted(law.u, breaks_inside(section)[0])])
    step = law.t[-1] / 100
    switches = np.sort([0.3, 0.3 + 0.1 * step, 0.3 + 3.0 * step, at_break + 0.1 * step])
    grid = place_in_time(section, law, no_changes(law, switches), 300, guess=guess)
    doubled = grid.sigma[:-1][np.diff(grid.sigma) == 0.0]
    assert set(switches) & set(doubled) == {0.3, 0.3 + 3.0 * step}
    few = place_in_time(section, law, no_changes(law, np.linspace(0.1, 3.0, 150)), 300, guess=guess)
    assert not set(np.linspace(0.1, 3.0, 150)) & set(few.sigma)  # more than the grid can tell


def test_beside_a_curvature_jump_knots_are_half_a_period_apart():
    limits = drives(100.0, period=2e-3)
    section, law, guess = laws(line_arc_line(), limits)
    grid = place_in_time(section, law, no_changes(law), 60, guess=guess, period=2e-3)
    h, middle = np.diff(grid.sigma), 0.5 * (grid.sigma[1:] + grid.sigma[:-1])
    for jump in section.jumps:
        at = float(law.t[np.searchsorted(law.u, jump.u)])
        near = (np.abs(middle - at) < 6e-3) & (h > 0.0)
        assert np.count_nonzero(near) >= 8
        assert h[near].max() <= 1.6e-3
    far = np.abs(middle[:, None] - [law.t[np.searchsorted(law.u, jump.u)] for jump in section.jumps]).min(axis=1) > 0.05
    assert h[far].max() > 4e-3


def test_split_halves_the_intervals_asked_for_and_a_renewed_grid_keeps_its_knots():
    section, _, grid = laid_out(line_arc_line(), MILL, 60)
    h = np.diff(grid.sigma)
    where = np.zeros(h.size, dtype=bool)
    where[[0, 7, h.size - 1]] = True
    where[np.flatnonzero(h == 0.0)] = True  # nothing to halve
    finer = grid.split(where)
    assert finer.intervals == grid.intervals + 3
    assert set(np.setdiff1d(finer.sigma, grid.sigma)) == {
        0.5 * (grid.sigma[k] + grid.sigma[k + 1]) for k in (0, 7, h.size - 1)
    }
    assert np.array_equal(finer.sigma[finer.left], grid.sigma[grid.left])
    assert (np.diff(finer.macro)[finer.left[:-1]] == 1).all()
    profile = plan_feedrate(line_arc_line(), MILL, intervals=200)
    law = TimeLaw(profile.t, profile.u, profile.u_rate, profile.u_acceleration)
    u = grid.map.parameter(grid.macro, grid.distances(grid.sigma, grid.macro))[0]
    time = np.interp(u, law.u, law.t)
    time[grid.left[:-1] + 1] = time[grid.left[:-1]]
    for at in breaks_inside(section):
        k = np.flatnonzero(u == at)
        time[k] = law.t[np.searchsorted(law.u, at)]
    renewed = grid.renewed(law, time, periodic=False)
    assert renewed.map.span == law.t[-1]
    assert set(time) <= set(renewed.sigma)
    assert renewed.at_breaks.sum() == 3


@pytest.mark.parametrize("held", [False, True])
def test_intervals_are_counted_as_by_the_lower_envelope_of_all_ramps(held):
    """Against every pair of cells: a spacing is no more than that of another plus the growth over the distance."""
    rng = np.random.default_rng(3)
    fine = np.append(0.0, np.cumsum(rng.uniform(0.5, 1.5, 80)))
    middle, step = 0.5 * (fine[1:] + fine[:-1]), np.diff(fine)
    spacing = np.exp(rng.uniform(-3.0, 1.0, 80))
    most = np.where(rng.uniform(size=80) < 0.1, 0.1, np.inf) if held else np.full(80, np.inf)
    wanted, scale = 50.0 + np.sum(step * np.maximum(1.0 / most - 1.0 / spacing, 0.0)), 1.0
    for rounds in (1, 2, 3):
        ramps = np.minimum(scale * spacing, most)[:, None] + time_knots._GROWTH * np.abs(middle[:, None] - middle)
        counted = np.append(0.0, np.cumsum(step / ramps.min(axis=0)))
        found = time_knots._counted(fine, spacing, most, 50.0, rounds)
        assert found == pytest.approx(counted, rel=1e-12)
        scale *= counted[-1] / wanted
        scale = min(scale, time_knots._MAX_WIDER) if held else scale


@pytest.mark.parametrize("seed", range(20))
def test_stretches_share_the_intervals_and_no_more(seed):
    rng = np.random.default_rng(seed)
    shares = rng.uniform(0.1, 6.0, 30)
    total = round(shares.sum())
    parts = time_knots._whole(shares, total)
    assert parts.min() >= 1
    assert parts.sum() <= total
    assert (np.abs(parts - np.maximum(shares, 1.0)) <= 1.0).all()
    assert time_knots._whole(np.array([1.6, 2.7, 0.2]), 5).tolist() == [1, 3, 1]
