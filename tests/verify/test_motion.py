"""What the check compiles, against array arithmetic over all points and against the plan's own evaluation."""

from __future__ import annotations

import motion_reference as plain
import numpy as np
import pytest
from check_plans import plan_on

from planner.compiled import core
from planner.geometry.chord import distance_to_chord
from planner.geometry.differential import chain_rule
from planner.verify.meanjerk import gaps_around
from planner.verify.motion import Motion, Quintics, measure_points
from planner.verify.peaks import CANDIDATES, Highest, peaks
from planner.verify.quantities import REVERSAL, axis_rows, names
from planner.verify.scan import scan_spans


@pytest.fixture(scope="module", params=["circle", "flank"])
def motion(request):
    """On a Cartesian machine, and on one whose tool tip is not made of the machine axes."""
    profile = plan_on(request.param)
    return Motion.of(profile.curve, Quintics.of(profile))


def scanned(states, x, u_ends=None, law=None):
    """What the scan keeps of spans at x (n, k), each a whole interval, of which as many are kept as there are.

    Ends, heights, spans and places of the highest, largest, jerk, feed and its place, course, mean jerk and its slack.
    """
    d, p, cartesian, rates, slack = states
    count, dim, spans = len(names(d.shape[2])), d.shape[2], x.shape[0]
    kept, tops = np.zeros(count, dtype=np.intp), np.empty((2, count, spans))
    ends, at = np.empty((2, count, spans)), np.empty((count, spans), dtype=np.intp)
    largest, jerk, feed, feed_place = np.zeros(count), np.empty((dim, spans)), *np.empty((2, spans))
    course, mean, off = np.empty((spans, 5 + 6 * p.shape[2])), *np.empty((2, dim, spans))
    table = np.ones((spans, 17)) if law is None else law
    u_ends = np.ones((2, spans)) if u_ends is None else u_ends
    of_spans = table, spans, np.arange(spans), np.zeros(spans), np.ones(spans), u_ends, np.full(spans, 0.5)
    found = spans, kept, tops[0], at, tops[1], largest, jerk, feed, feed_place, course, mean, off
    of_points = *x.shape, np.array([0, spans]), x, rates, slack, dim, p.shape[2]
    work = np.empty((count, x.shape[1]))
    core.scan_measure(*of_spans, *of_points, ends, *found, work, d, None if cartesian else p)
    assert (kept == spans).all()
    return ends, tops[0], at, tops[1], largest, jerk, feed, feed_place, course, mean, off


def every_top(heights, places, spans, row):
    """Height and place of each span, from those in the order of their heights."""
    order = np.argsort(spans[row])
    return heights[row][order], places[row][order]


def chained(d, rates):
    """First three time derivatives of C(u(t)), (3, n, k, dim), in array arithmetic."""
    d = d.reshape(4, *rates.shape[1:], -1)
    u1, u2, u3 = rates[..., None]
    return np.stack([d[1] * u1, d[2] * u1**2 + d[1] * u2, d[3] * u1**3 + 3.0 * d[2] * u1 * u2 + d[1] * u3])


def test_every_quantity_follows_from_the_chain_rule(motion):
    dim, tip = motion.curve.dim, motion.curve.tip
    span = np.arange(motion.interval.size)
    x = motion.grid(span, 24)[:, 1:-1]  # away from knots, where both sides are one
    values, _ = motion.measure(span, x)
    u, rates = motion.parameter(span, x), motion.law.rates(motion.interval[span], x)
    for k, expected in enumerate(chained(motion.curve.derivatives(u, 3), rates)):
        assert np.moveaxis(values[axis_rows(dim, k)], 0, -1) == pytest.approx(expected, rel=1e-12, abs=1e-9)
    first, second, third = chained(tip.derivatives(u, 3), rates)
    speed = np.linalg.norm(first, axis=-1)
    along = np.sum(first * second, axis=-1) / speed
    # d/dt (p'.p'' / |p'|)
    change = (np.sum(second**2 + first * third, axis=-1) - along**2) / speed
    assert values[0] == pytest.approx(speed, rel=1e-12)
    assert values[1] == pytest.approx(along, rel=1e-9, abs=1e-9)
    assert values[2] == pytest.approx(change, rel=1e-8, abs=1e-6)
    assert (values[REVERSAL] == -rates[0]).all()


def test_the_slack_along_the_tip_is_that_of_all_terms(motion):
    """|.| of what the sizes of all terms gain, and for the jerk what the turning of the tangent gains besides."""
    span = np.arange(motion.interval.size)
    x = motion.grid(span, 7)
    d, p, cartesian, rates, _ = motion.states(span, x)
    error = np.tile([1e-3, 1e-2, 1e-1], (span.size, 1))
    _, slack = measure_points(d, p, cartesian, rates, error)
    high = np.abs(rates) + error.T[:, :, None]
    expected = np.linalg.norm(chained(np.abs(p), high) - chained(np.abs(p), np.abs(rates)), axis=-1)
    speed = np.linalg.norm(p[1], axis=-1)
    tangent = p[1] / speed[:, None]
    across = p[2] - np.sum(p[2] * tangent, axis=-1)[:, None] * tangent
    turn = (np.sum(across**2, axis=-1) / speed).reshape(x.shape)
    expected[2] += turn * (high[0] ** 3 - np.abs(rates[0]) ** 3)
    assert slack[:3] == pytest.approx(expected, rel=1e-9)


def test_slack_is_what_errors_of_the_rates_can_change(motion):
    """Shifting u', u'' and u''' by their slack, in every combination of signs, moves no value by more, and one by it."""
    span = np.arange(motion.interval.size)
    x = motion.grid(span, 7)
    d, p, cartesian, rates, _ = motion.states(span, x)
    error = np.tile([1e-6, 1e-5, 1e-4], (span.size, 1))
    values, slack = measure_points(d, p, cartesian, rates, error)
    largest = np.zeros(values.shape)
    for signs in np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3):
        moved, _ = measure_points(d, p, cartesian, rates + (error * signs).T[:, :, None], error)
        np.maximum(largest, np.abs(moved - values), out=largest)
    size = np.abs(values).max(axis=(1, 2), keepdims=True)
    assert (largest <= slack + 1e-12 * size).all()
    for k in (0, 1):  # of the velocity exactly, of the acceleration to first order
        rows = axis_rows(motion.curve.dim, k)
        assert (slack[rows].max(axis=(1, 2)) <= (1.0 + 1e-4) * largest[rows].max(axis=(1, 2)) + 1e-12).all()


@pytest.mark.parametrize("density", [4, 24])
def test_the_peaks_of_spans_are_those_of_all_their_points(motion, density):
    span = np.arange(motion.interval.size)
    x = motion.grid(span, density)
    dim = motion.curve.dim
    ends, heights, spans, places, largest, jerk, feed, feed_place, *_ = scanned(motion.states(span, x), x)
    height, place = np.array([every_top(heights, places, spans, k) for k in range(len(heights))]).swapaxes(0, 1)
    assert (np.diff(heights, axis=1) <= 0.0).all()
    values, slack = motion.measure(span, x)
    sizes = np.abs(values)
    sizes[REVERSAL] = values[REVERSAL]
    expected, at = peaks(sizes - slack)
    assert (place == x[span, at]).all()
    assert height == pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert jerk == pytest.approx(peaks(np.maximum(sizes - slack, 0.0)[-dim:])[0], rel=1e-12, abs=1e-300)
    assert (largest == np.maximum((sizes - slack).max(axis=(1, 2)), 0.0)).all()
    assert (ends == np.moveaxis(values[:, :, [0, -1]], -1, 0)).all()
    assert (feed == values[0].max(axis=1)).all()
    assert (feed_place == x[span, values[0].argmax(axis=1)]).all()


@pytest.mark.parametrize("density", [1, 2, 7, 24, 32, 33, 70])
def test_compiled_measurement_has_the_bits_of_the_plain_one(motion, density):
    """At random states: some points of them rest, turn back, or hold no number."""
    rng = np.random.default_rng(density)
    spans, dim, tip = 6, motion.curve.dim, motion.curve.tip.dim
    cartesian = motion.curve.tip is motion.curve
    d = rng.normal(size=(4, spans * density, dim))
    d[1, ::5] = 0.0
    d[2, ::25] = 0.0
    p = d if cartesian else rng.normal(size=(4, spans * density, tip))
    rates, slack = rng.normal(size=(3, spans, density)), 1e-3 * rng.uniform(size=(spans, 3))
    for k, value in enumerate([np.nan, np.inf, -np.inf, 0.0]):
        rates[rng.integers(3), k, rng.integers(density)] = value
    slack[4] = np.inf
    states, count = (d, p, cartesian, rates, slack), len(names(dim))
    expected = np.empty((2, count, spans, density))
    with np.errstate(all="ignore"):
        plain.measure_points(*states, *expected)
    assert np.array_equal(np.stack(measure_points(*states)), expected, equal_nan=True)
    x = rng.uniform(size=(spans, density))
    ends, height, top = np.empty((2, count, spans)), np.empty((count, spans)), np.empty((count, spans), dtype=int)
    largest, jerk = np.zeros(count), np.empty((dim, spans))
    with np.errstate(all="ignore"):
        plain.measure_spans(*states, ends, height, top, largest, jerk)
    own_ends, heights, at, places, *others = scanned(states, x)
    assert np.array_equal(own_ends, ends, equal_nan=True)
    for row in range(count):
        one, place = every_top(heights, places, at, row)
        assert np.array_equal(one, height[row], equal_nan=True)
        assert np.array_equal(place, x[np.arange(spans), top[row]])
    for one, other in zip(others, (largest, jerk), strict=False):
        assert np.array_equal(one, other, equal_nan=True)


def test_what_is_not_a_number_is_the_highest(motion):
    span = np.arange(8)
    d, p, cartesian, rates, slack = motion.states(span, motion.grid(span, 24))
    rates[2, 5, 11] = np.nan
    x = np.tile(np.arange(24.0), (8, 1))
    _, heights, spans, places, _, jerk, *_ = scanned((d, p, cartesian, rates, slack), x)
    rows = axis_rows(motion.curve.dim, 2)
    assert (spans[rows, 0] == 5).all()
    assert (heights[rows, 0] == np.inf).all()
    assert (places[rows, 0] == 11.0).all()
    assert (jerk[:, 5] == np.inf).all()
    assert np.isfinite(heights[:, 2:]).all()


def test_the_law_is_that_of_the_profile():
    profile = plan_on("circle")
    law = Quintics.of(profile)
    t = np.random.default_rng(4).uniform(0.0, profile.duration, 500)
    i, x = law.at(t)
    state = profile.at(t)
    assert law.value(i, x[:, None])[:, 0] == pytest.approx(state.u, rel=1e-13)
    expected = np.stack([state.u_rate, state.u_acceleration, state.u_jerk])
    assert law.rates(i, x[:, None])[..., 0] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    # At the nodes the table itself, from either side; a time at a node belongs to the interval that begins there.
    every = np.arange(law.h.size)
    i, x = law.at(profile.t)
    assert (i == np.append(every, every[-1])).all()
    assert (x == np.append(np.zeros(every.size), 1.0)).all()
    for side, nodes in ((0.0, slice(None, -1)), (1.0, slice(1, None))):
        at = np.full((every.size, 1), side)
        assert (law.rates(every, at)[:2, :, 0] == [profile.u_rate[nodes], profile.u_acceleration[nodes]]).all()
    assert (law.value(every, np.ones((every.size, 1)))[:, 0] == profile.u[1:]).all()


def test_compiled_law_has_the_bits_of_the_plain_one():
    law = Quintics.of(plan_on("circle"))
    rng = np.random.default_rng(8)
    end = law.start[-1] + law.h[-1]
    t = np.concatenate(
        [rng.uniform(0.0, end, 300), law.start, np.sort(rng.uniform(0.0, end, 300)), [0.0, end, 2.0 * end]]
    )
    i, x = np.empty(t.size, dtype=np.intp), np.empty(t.size)
    plain.locate(law.start, law.h, t, i, x)
    assert all((one == other).all() for one, other in zip(law.at(t), (i, x), strict=True))
    x = np.concatenate([rng.uniform(size=(i.size, 3)), np.zeros((i.size, 1)), np.ones((i.size, 1))], axis=1)
    out = np.empty((4, *x.shape))
    coefficients, ends = law.table[:, 8:14].T, law.table[:, 2:8].T.reshape(2, 3, -1)
    plain.time_law(coefficients, law.h, ends, i, x, out)
    assert (law.value(i, x) == out[0]).all()
    assert (law.rates(i, x) == out[1:]).all()
    low, high = 0.1, 5.0  # u at a time, held at the end of the law, within a range
    expected = np.clip(
        law.value(*(part[:, None] if part.dtype == float else part for part in law.at(t)))[:, 0], low, high
    )
    assert (law.parameters(t, low, high) == expected).all()


def test_knots_are_found_where_the_law_passes_them():
    law = Quintics.of(plan_on("circle"))
    rng = np.random.default_rng(9)
    i = rng.integers(0, law.h.size, 50)
    low, high = law.u_ends[:, i]
    u = np.concatenate([low + (high - low) * rng.uniform(size=50), high[:5]])
    i = np.concatenate([i, i[:5]])
    x = law.crossing(i, u)
    assert ((x >= 0.0) & (x <= 1.0)).all()
    assert law.value(i, x[:, None])[:, 0] == pytest.approx(u, rel=1e-14)
    before = np.nextafter(x, 0.0)[:, None]
    assert (law.value(i, before)[:, 0] < u).all()


def test_grid_is_equidistant_and_meets_both_ends(motion):
    span = np.array([3, 0, 5])
    for density in (4, 24, 25):
        x = motion.grid(span, density)
        lower, upper = motion.lower[span, None], motion.upper[span, None]
        assert x == pytest.approx(lower + (upper - lower) * np.linspace(0.0, 1.0, density), rel=1e-15, abs=1e-16)
        assert (x[:, [0]] == lower).all()
        assert (x[:, [-1]] == upper).all()


@pytest.mark.parametrize("density", [1, 25, 40])
def test_use_of_one_quantity_is_its_size_less_its_slack(motion, density):
    count, dim = len(names(motion.curve.dim)), motion.curve.dim
    span = np.arange(count) % motion.interval.size
    x = np.random.default_rng(density).uniform(size=(count, density))
    d, p, cartesian, rates, slack = motion.states(span, x)
    row, used = np.arange(count), np.empty(x.shape)
    core.scan_used(*x.shape, dim, p.shape[2], rates, slack, row, used, d, None if cartesian else p)
    values, granted = measure_points(d, p, cartesian, rates, slack)
    sizes = np.abs(values)
    sizes[REVERSAL] = values[REVERSAL]
    assert (used == (sizes - granted)[row, row]).all()


@pytest.mark.parametrize("dim", [2, 5])
def test_compiled_mean_jerks_are_those_of_array_arithmetic(dim):
    rng = np.random.default_rng(dim)
    count = 20
    d, rates, u = rng.normal(size=(4, 2 * count, dim)), rng.normal(size=(3, count, 2)), rng.normal(size=(count, 2))
    start, h, gap = rng.uniform(0.0, 3.0, count), 10.0 ** rng.uniform(-9.0, 0.0, count), np.full(count, 0.5)
    law = np.ones((count, 17))
    law[:, 0], law[:, 1] = start, h
    states = d, d, True, rates, np.zeros((count, 3))
    *_, mean, slack = scanned(states, np.tile([0.0, 1.0], (count, 1)), np.ascontiguousarray(u.T), law)
    expected = plain.mean_jerks(d, rates, u, start, h, gap)
    assert pytest.approx(expected[0], rel=1e-13) == mean.T
    assert pytest.approx(expected[1], rel=1e-13) == slack.T


def test_only_whole_intervals_have_a_mean_jerk_and_the_largest_is_told(motion):
    scan = scan_spans(motion, 24)
    whole = np.flatnonzero((motion.lower == 0.0) & (motion.upper == 1.0))
    assert 0 < whole.size < motion.interval.size
    d, _, _, rates, _ = motion.states(whole, np.tile([0.0, 1.0], (whole.size, 1)))
    u, i = motion.u_ends[:, whole].T, motion.interval[whole]
    mean, slack = plain.mean_jerks(d, rates, u, motion.law.start[i], motion.law.h[i], gaps_around(motion)[whole])
    for j, (value, off, (t, at)) in enumerate(scan.means):
        k = int((mean - slack)[:, j].argmax())
        assert (value, off) == pytest.approx((mean[k, j], slack[k, j]), rel=1e-12)
        assert (t, at) == (motion.law.start[i[k]], u[k, 0])


def chord_heights(points, stride, parts, count, groups=1):
    height, top = np.empty((groups, count)), np.empty((groups, count), dtype=np.intp)
    size, dim = points.shape[0] // groups, points.shape[1]
    work = np.empty(dim * (size + stride) + count * (parts + 3))
    core.chord_heights(groups, count, dim, stride, parts, points, height, top, work)
    return height.reshape(-1), top.reshape(-1)


@pytest.mark.parametrize(("dim", "stride", "parts"), [(2, 4, 16), (3, 9, 8), (1, 1, 3), (6, 24, 23)])
def test_compiled_chords_have_the_bits_of_the_plain_ones(dim, stride, parts):
    points = np.cumsum(np.random.default_rng(dim).normal(size=(39 * stride + parts + 1, dim)), axis=0)
    points[2 * stride + parts] = points[2 * stride]
    points[7 * stride : 9 * stride] = points[7 * stride]
    expected = np.empty(40), np.empty(40, dtype=np.intp)
    plain.chord_heights(points, stride, parts, *expected)
    for one, other in zip(chord_heights(points, stride, parts, 40), expected, strict=True):
        assert (one == other).all()
    twice = np.concatenate([points, points])
    for one, other in zip(chord_heights(twice, stride, parts, 40, groups=2), expected, strict=True):
        assert (one == np.tile(other, 2)).all()


def test_a_chord_moves_to_the_highest_of_its_trials():
    rng = np.random.default_rng(6)
    count, trials = 5, 9
    steps = np.linspace(-1.0, 1.0, trials)
    points = rng.normal(size=(count, trials, trials + 2, 2))
    start, share, height = rng.uniform(0.05, 0.95, count), rng.uniform(0.3, 0.7, count), np.empty(count)
    expected = distance_to_chord(points[:, :, 2:], points[:, :, 0], points[:, :, 1]).reshape(count, -1)
    best = expected.argmax(axis=1)
    starts, shares = (np.clip(x + 0.1 * steps[k], 0.0, 1.0) for x, k in ((start, best // 9), (share, best % 9)))
    halves, work = np.array([0.1, 0.1]), np.empty(trials * 4)
    core.chord_choose(count, trials, 2, steps, 1.0, halves, start, share, height, work, points)
    assert (halves == 0.1 / 3.0).all()
    assert height == pytest.approx(expected.max(axis=1), rel=1e-14)
    assert (start == starts).all()
    assert (share == shares).all()


def test_trials_of_chords_lie_around_them_and_within_the_plan():
    law = Quintics.of(plan_on("circle"))
    end, steps = law.start[-1] + law.h[-1], np.linspace(-1.0, 1.0, 9)
    start, share, period = np.array([0.0, 1.0, end]), np.array([0.0, 0.4, 1.0]), 0.2
    u = np.empty((3, 9, 11))
    core.chord_trials(
        law.h.size, law.table, law.start, 0.0, 6.0, period, 3, 9, steps, np.array([0.05, 0.1]), start, share, u
    )
    starts = np.clip(start[:, None] + 0.05 * steps, 0.0, end)
    shares = np.concatenate([np.tile([0.0, 1.0], (3, 1)), np.clip(share[:, None] + 0.1 * steps, 0.0, 1.0)], axis=1)
    times = starts[:, :, None] + shares[:, None] * period
    assert (u == law.parameters(times.reshape(-1), 0.0, 6.0).reshape(u.shape)).all()


@pytest.mark.parametrize(("dim", "stride"), [(2, 3), (3, 9)])
def test_heights_of_chords_are_distances_to_segments(dim, stride):
    """The nearest of many points of each segment, in every direction; one chord has no length."""
    parts, count = 8, 12
    points = np.cumsum(np.random.default_rng(dim).normal(size=((count - 1) * stride + parts + 1, dim)), axis=0)
    points[2 * stride + parts] = points[2 * stride]
    height, top = chord_heights(points, stride, parts, count)
    share = np.linspace(0.0, 1.0, 20_001)[:, None]
    for i in range(count):
        part = points[i * stride : i * stride + parts + 1]
        along = part[0] + share * (part[-1] - part[0])
        distance = np.array([np.linalg.norm(along - point, axis=1).min() for point in part])
        assert top[i] == distance.argmax()
        assert height[i] == pytest.approx(peaks(distance[None])[0][0], rel=1e-6)


def test_of_equal_heights_the_earliest_are_kept_however_they_come():
    rng = np.random.default_rng(5)
    height, x = rng.integers(0, 6, 200).astype(float), rng.uniform(size=200)
    order = np.lexsort([np.arange(200), -height])[:CANDIDATES]
    for size in (1, 7, 64, 200):
        highest, every = Highest(2), np.arange(200) if size < 64 else rng.permutation(200)
        for first in range(0, 200, size):
            some = every[first : first + size]
            highest.offer(np.stack([-height[some], height[some]]), some, np.stack([x[some], x[some]]))
        assert highest.index[1].tolist() == order.tolist()
        assert highest.x[1].tolist() == x[order].tolist()
        assert highest.height[0].tolist() == np.sort(-height)[::-1][:CANDIDATES].tolist()
        assert highest.least == highest.height[0, -1]


def test_fewer_than_there_is_room_for_are_all_kept():
    highest = Highest()
    highest.offer(np.array([[1.0, 3.0, 2.0]]), np.arange(3), np.array([[0.1, 0.3, 0.2]]))
    assert highest.height.tolist() == [[3.0, 2.0, 1.0]]
    assert highest.least == -np.inf
    assert highest.index.tolist() == [[1, 2, 0]]
    assert highest.x.tolist() == [[0.3, 0.2, 0.1]]


def test_compiled_terms_of_columns_are_those_of_array_arithmetic():
    rng = np.random.default_rng(8)
    count, dim = 40, 3
    p, rates = rng.normal(size=(4, count, dim)), rng.normal(size=(3, count))
    p[1, ::7] = 0.0
    values = rng.normal(size=(4 + 3 * dim, count))
    before, terms, bend = values.copy(), np.empty((3, count)), np.empty(count)
    core.columns_terms(count, dim, p, rates, values, terms, bend)
    first, second, third = np.linalg.norm(p[1:], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where(first > 0.0, second**2 / first, 0.0)
        across = p[2] - (np.sum(p[1] * p[2], axis=-1) / first**2)[:, None] * p[1]
        expected = np.where(first > 0.0, np.linalg.norm(across, axis=-1) / first**2, np.inf)
    assert terms == pytest.approx(np.stack(chain_rule(first, second, third + turn, *np.abs(rates))), rel=1e-13)
    assert bend == pytest.approx(expected, rel=1e-12)
    before[1:3, first == 0.0] = 0.0
    assert (values == before).all()


def test_what_a_column_uses_is_infinite_where_it_is_no_number():
    shown, expected = np.array([1.0, 2.0, np.nan, 1.0, 5.0, np.inf]), np.array([1.5, 2.0, 1.0, np.inf, 4.0, np.inf])
    granted, used = np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0]), np.empty(6)
    core.columns_used(6, shown, expected, granted, used)
    assert used.tolist() == [0.5, 0.0, np.inf, np.inf, np.inf, np.inf]


def test_compiled_shares_and_the_limit_used_most_are_those_of_array_arithmetic():
    rng = np.random.default_rng(9)
    count, rows, tolerance, slacks = 300, np.array([1, REVERSAL, 5, 9]), 1e-3, 4.0
    values, granted = rng.normal(size=(10, count)), 1e-3 * rng.uniform(size=(10, count))
    values[5, 3], granted[9, 4], values[1, 5] = np.nan, np.inf, np.inf
    allowed, rate = np.array([1.0, 2.0, np.inf, 0.5]), rng.uniform(1.0, 1.1, (4, count))
    share, slack = np.empty((2, 4, count))
    core.columns_shares(count, 4, rows, allowed, rate, values, granted, share, slack)
    sizes = np.abs(values[rows])
    sizes[1] = values[REVERSAL]
    largest = np.finfo(np.float64).max
    expected = [np.fmin(np.fmax(part * rate / allowed[:, None], 0.0), largest) for part in (sizes, granted[rows])]
    assert share == pytest.approx(expected[0], rel=1e-15)
    assert slack == pytest.approx(expected[1], rel=1e-15)
    named, wrong = rng.integers(-1, 4, count), np.empty(count, dtype=np.bool_)
    found = core.columns_misnamed(count, 4, share, slack, named, tolerance, slacks, wrong)
    own = np.where(named >= 0, share[named, np.arange(count)], -np.inf)
    near = np.where(share >= own - tolerance, slack, 0.0).max(axis=0)
    with np.errstate(over="ignore"):
        others = share.max(axis=0) - (tolerance + slacks * near)
    assert (wrong == ((named < 0) | ~(own >= others))).all()
    assert 0 < found == wrong.sum() < count
