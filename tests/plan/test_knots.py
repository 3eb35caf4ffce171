"""Where the knots of a plan go."""

import numpy as np
import pytest
from cases import ellipse, line, line_arc_line, mill
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import knotted
from strategies import random_nurbs

from planner import load_curve
from planner.geometry.formula import FormulaCurve
from planner.plan.knots import place_knots, split

# ---- knots ---------------------------------------------------------------------------------------------------------


def test_knots_run_from_end_to_end(case):
    curve, _, section, _, grid = case
    assert grid.sigma[0] == 0.0
    assert grid.sigma[-1] == section.span
    assert (np.diff(grid.sigma) >= 0.0).all()
    assert (np.diff(grid.u) >= 0.0).all()
    assert (grid.u[0], grid.u[-1]) == curve.domain


def test_there_are_about_as_many_intervals_as_wanted(case):
    curve, _, section, guess, grid = case
    assert grid.intervals == pytest.approx(1000, abs=2 + len(section.jumps) * 40 + 0.5 * len(curve.breaks))
    coarse = place_knots(section, guess, 50)
    assert 50 <= coarse.intervals + 2 <= 52 + len(curve.breaks) + 40 * len(section.jumps)


def test_neighbouring_intervals_differ_little(case):
    curve, _, _, _, grid = case
    h = np.diff(grid.sigma)
    h = h[h > 0.0]
    ratio = np.maximum(h[1:] / h[:-1], h[:-1] / h[1:])
    # Between breaks the number of intervals is rounded, which only matters where there are few.
    few = curve.breaks and len(curve.breaks) > grid.intervals / 20
    assert ratio.max() <= (3.0 if few else 2.4)


def test_every_break_has_a_double_knot_exactly_on_it(case):
    curve, _, section, _, grid = case
    breaks = np.array([b.u for b in curve.breaks])
    double = np.flatnonzero(np.diff(grid.sigma) == 0.0)
    assert np.isin(breaks, grid.u[double]).all()
    assert np.array_equal(grid.u[double], grid.u[double + 1])
    assert np.array_equal(grid.left[:-1], double)
    assert grid.left[-1] == grid.sigma.size - 1
    assert np.isin(grid.u[double], curve._candidate_breaks()).all()
    other = np.delete(np.arange(grid.u.size), np.concatenate([double, double + 1, [0, grid.u.size - 1]]))
    assert grid.u[other] == pytest.approx(section.parameter(section.rest_map(grid.sigma[other])[0]), rel=1e-15)


def test_a_knot_at_which_only_the_fourth_derivative_jumps_counts_as_a_break():
    curve = random_nurbs(3, 4, 2, spans=3)
    assert curve.breaks == ()
    _, _, grid = knotted(curve, mill())
    assert np.isin(curve._candidate_breaks(), grid.u).all()


def test_stretches_end_at_the_next_break(case):
    _, _, _, _, grid = case
    ends = grid.u[grid.left]
    for k in np.linspace(0, grid.u.size - 1, 40).astype(int):
        assert grid.stretch_end[k] == ends[np.searchsorted(grid.left, k)]


def test_a_rest_is_resolved(case):
    _, _, section, _, grid = case
    for width, distance in ((section.blend_start, grid.sigma), (section.blend_end, section.span - grid.sigma)):
        assert width > 0.0
        assert np.count_nonzero((distance > 0.0) & (distance < width)) >= 9


def test_knots_crowd_where_the_path_is_slow_or_turns():
    curve = FormulaCurve({"X": "100*u", "Y": "0.2*atan(50*(u-0.5))"}, (0.0, 1.0))
    _, _, grid = knotted(curve, mill())
    near = np.diff(grid.u)[np.abs(grid.u[:-1] - 0.5) < 0.01].mean()
    assert near < 0.4 * np.diff(grid.u)[(grid.u[:-1] > 0.25) & (grid.u[:-1] < 0.35)].mean()


@pytest.mark.parametrize("period", [1e-3, 1e-4])
def test_a_curvature_jump_that_is_passed_slowly_is_resolved(period):
    section, guess, grid = knotted(line_arc_line(), mill(period=period))
    feed = np.sqrt(2.0 / 3.0 * 20000.0 * period / 0.1)
    assert guess.dips.feed == pytest.approx([feed, feed], rel=1e-6)
    # v^1.5 grows by 2.12 sqrt(J) a mm; the plan has left the jump's feed behind after about this length
    width = feed**1.5 / (2.12 * np.sqrt(20000.0))
    at = section.sigma(section.coordinate(np.array([1.0, 2.0])))
    for centre in at:
        distance = np.abs(grid.sigma - centre)
        assert np.count_nonzero((distance > 0.0) & (distance < 3.0 * width)) >= 6


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.integers(2, 5), st.integers(24, 400))
def test_knots_of_random_paths(seed, degree, intervals):
    rng = np.random.default_rng(seed)
    curve = random_nurbs(seed, degree, 3, spans=int(rng.integers(1, 40)), repeat=int(rng.integers(1, degree)))
    section, _, grid = knotted(curve, mill(dim=3), intervals)
    candidates = curve._candidate_breaks()
    assert (np.diff(grid.sigma) >= 0.0).all()
    assert grid.sigma[[0, -1]].tolist() == [0.0, section.span]
    assert np.isin(candidates, grid.u).all()
    assert grid.left.size == candidates.size + 1
    least = max(intervals - 1 - candidates.size, candidates.size + 1)
    assert (
        least <= grid.intervals <= intervals + 1 + candidates.size * (1 + 40 * (degree == 2 or len(section.jumps) > 0))
    )


# ---- splitting -----------------------------------------------------------------------------------------------------


def test_split_halves_the_intervals_asked_for():
    section, _, grid = knotted(load_curve("circle"), mill(), 60)
    h = np.diff(grid.sigma)
    where = np.zeros(h.size, dtype=bool)
    where[[0, 7, h.size - 1]] = True
    where |= h == 0.0  # an empty interval is not halved
    finer = split(section, grid, where)
    assert finer.sigma.size == grid.sigma.size + 3
    expected = np.sort(np.append(grid.sigma, [0.5 * (grid.sigma[k] + grid.sigma[k + 1]) for k in (0, 7, h.size - 1)]))
    assert np.array_equal(finer.sigma, expected)
    assert np.array_equal(finer.u[finer.left], grid.u[grid.left])
    assert np.array_equal(np.flatnonzero(np.diff(finer.sigma) == 0.0), finer.left[:-1])
    assert np.isin(grid.u, finer.u).all()


def test_split_beside_a_double_knot_keeps_it():
    section, _, grid = knotted(line_arc_line(), mill(), 60)
    where = np.zeros(grid.sigma.size - 1, dtype=bool)
    before = grid.left[:-1]
    where[before - 1] = where[before + 1] = True
    finer = split(section, grid, where)
    assert finer.intervals == grid.intervals + 4
    assert finer.u[finer.left].tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(finer.u[finer.left[:-1] + 1], [1.0, 2.0])


def test_split_of_everything_doubles_the_grid():
    section, _, grid = knotted(load_curve("butterfly-nurbs"), mill(), 200)
    finer = split(section, grid, np.ones(grid.sigma.size - 1, dtype=bool))
    assert finer.intervals == 2 * grid.intervals
    assert split(section, grid, np.zeros(grid.sigma.size - 1, dtype=bool)).sigma.tolist() == grid.sigma.tolist()


# ---- rest blends -----------------------------------------------------------------------------------------------------


def test_prescribed_feeds_need_no_blend():
    section, guess, _ = knotted(load_curve("teardrop"), mill(), start=50.0, end=20.0)
    assert (section.blend_start, section.blend_end) == (0.0, 0.0)
    assert guess.feed[[0, -1]] == pytest.approx([50.0, 20.0], rel=1e-9)


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e4])
def test_blends_are_the_way_it_takes_to_speed_up(length):
    section, guess, _ = knotted(line(length), mill())
    top = guess.feed.max()
    way = 0.5 * top * (top / 1000.0 + 1000.0 / 20000.0)
    assert section.blend_start * section.curve.length <= way * (1.0 + 1e-9)
    assert section.blend_start == pytest.approx(section.blend_end, rel=0.05)
    assert section.blend_start + section.blend_end <= section.span * (1.0 + 1e-12)


@pytest.mark.parametrize("limited", ["X", "Y"])
def test_an_axis_that_has_no_limits_leaves_the_guess_to_the_other(limited):
    """Where the limited axis stands still nothing bounds the feed but the command."""
    free = [np.inf if axis != limited else 1.0 for axis in "XY"]
    rows = {name: np.array(free) * value for name, value in (("acceleration", 1000.0), ("jerk", 20000.0))}
    section, guess, grid = knotted(ellipse(), mill(**rows))
    assert np.isfinite(guess.feed).all()
    assert 50.0 < guess.feed.max() <= 100.0
    assert min(section.blend_start, section.blend_end) > 0.0
    assert grid.intervals == pytest.approx(1000, abs=2)
