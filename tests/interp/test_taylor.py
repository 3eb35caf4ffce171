"""The steps themselves: their order of accuracy, their state, and the tables they run on."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from cases import drives
from motions import plan_along, scurve, time_at

from interp import InterpolatorTable, TaylorTable, quintic_step, replay, start, stepping, taylor_step
from planner import load_curve
from planner.errors import InputError
from planner.law import TimeLaw
from planner.profile import make_profile

ORDERS = (1, 2, 3, 5)
TAYLOR_ORDERS = (1, 2, 3)
# feed, acceleration, jerk along the path
MOTIONS = {
    "circle": (100.0, 800.0, 14000.0),
    "teardrop": (60.0, 600.0, 12000.0),
    "butterfly-nurbs": (40.0, 400.0, 10000.0),
    "flank": (20.0, 200.0, 5000.0),
}


@pytest.fixture(scope="module")
def cases():
    """Curve, motion and plan by name."""
    found = {}
    for name, (feed, acceleration, jerk) in MOTIONS.items():
        curve = load_curve(name)
        motion = scurve(curve.length, feed, acceleration, jerk)
        times = np.linspace(0.0, motion.duration, 20_000) if name == "butterfly-nurbs" else None
        found[name] = curve, motion, plan_along(curve, motion, times=times)
    return found


def table_of(profile, order):
    return (InterpolatorTable if order == 5 else TaylorTable).from_profile(profile)


def take_step(table, order, state):
    return quintic_step(*table.arrays, state) if order == 5 else taylor_step(order, *table.arrays, state)


def slope(x, y):
    """Exponent p of the power law y ~ x^p."""
    return np.polyfit(np.log(x), np.log(y), 1)[0]


# ---- accuracy ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", TAYLOR_ORDERS)
@pytest.mark.parametrize("name", ["circle", "teardrop", "flank"])
def test_one_step_from_the_exact_state_errs_by_the_next_power_of_the_period(cases, name, order):
    # Inside a phase of constant jerk and off the breaks of the curve, where u(t) is smooth.
    curve, motion, profile = cases[name]
    t = 0.5 * motion.times[1]
    table = TaylorTable.from_profile(profile)
    u = curve.arclength.u(motion(t)[0])
    periods = (motion.times[1] - t) / np.array([4.0, 8.0, 16.0, 32.0])
    errors = []
    for period in periods:
        # one step of the period's length, entered at t: a sample number that makes k T = t
        state = start(table, period)
        state[stepping.SAMPLE] = t / period
        state[stepping.U] = u
        taylor_step(order, *table.arrays, state)
        errors.append(abs(state[stepping.U] - curve.arclength.u(motion(t + period)[0])))
    assert slope(periods, errors) == pytest.approx(order + 1, abs=0.1)


@pytest.mark.parametrize("order", TAYLOR_ORDERS)
def test_the_accumulated_error_falls_with_the_order_of_the_step(order):
    # Where u(t) is smooth but at samples: the phases last 50 ms each, and the circle breaks beyond the time looked at.
    curve = load_curve("circle")
    motion = scurve(curve.length, 100.0, 1000.0, 20000.0)
    profile = plan_along(curve, motion)
    until = time_at(motion, 0.45 * curve.length)
    periods = 0.05 / np.array([5, 10, 20, 40])
    errors = []
    for period in periods:
        samples = replay(curve, profile, period, order=order, stop=until)
        errors.append(np.abs(samples.u - curve.arclength.u(motion(samples.t)[0])).max())
    assert slope(periods, errors) == pytest.approx(order, abs=0.1)


def test_orders_rank_as_the_literature_has_them_and_the_plan_itself_is_exact(cases):
    for name in ("circle", "teardrop", "flank"):
        curve, _, profile = cases[name]
        error = []
        for order in ORDERS:
            samples = replay(curve, profile, 1e-3, order=order)
            u = profile.at(np.minimum(samples.t, profile.duration)).u
            error.append(np.abs(samples.position - curve.derivatives(u, 0)[0]).max())
        first, second, third, quintic = error
        assert 1e-3 < first < 1.0
        assert second < first / 50.0
        assert third < second / 5.0
        assert quintic < 4e-11


@pytest.mark.parametrize("name", ["butterfly-nurbs", "flank", "teardrop"])
def test_the_table_is_the_time_law_of_the_plan(cases, name):
    # intervals of the plan are cut at the joints of the pieces and expanded anew
    curve, _, profile = cases[name]
    samples = replay(curve, profile, profile.duration / 9973.0)
    law = profile.at(np.minimum(samples.t, profile.duration))
    assert np.abs(samples.u - law.u).max() < 1e-14 * (curve.domain[1] - curve.domain[0]) + 1e-15
    assert np.abs(samples.position - curve.derivatives(law.u, 0)[0]).max() < 1e-11


@pytest.mark.parametrize("order", ORDERS)
def test_a_plan_of_two_nodes_crosses_all_pieces_in_one_interval(order):
    curve = load_curve("butterfly-nurbs")
    # constant rate of the parameter: u(t) = t/2 over all 48 pieces, the feed as it comes
    limits = drives()
    nodes = tuple(np.array(x) for x in ([0.0, 2.0], curve.domain, [0.5, 0.5], [0.0, 0.0]))
    profile = make_profile(curve, limits, TimeLaw(*nodes), method="constant rate")
    if order == 5:
        assert len(InterpolatorTable.from_profile(profile).segments) == len(curve.pieces.breaks)
    samples = replay(curve, profile, 1e-4, order=order)
    error = np.abs(samples.position - curve.derivatives(0.5 * samples.t, 0)[0]).max()
    assert error < {1: 1e-1, 2: 1e-2, 3: 1e-2, 5: 1e-11}[order]


@pytest.mark.parametrize("name", MOTIONS)
def test_the_feed_of_a_taylor_table_is_that_of_the_plan(cases, name):
    _, motion, profile = cases[name]
    feed = TaylorTable.from_profile(profile).feed
    t = np.linspace(0.0, motion.duration, 5001)
    row = np.searchsorted(feed[:, 0], t, side="right") - 1
    v = np.polynomial.polynomial.polyval(t - feed[row, 0], feed[row, 1:].T, tensor=False)
    law = profile.at(t)
    assert np.abs(v - law.feed).max() < 2e-9 * law.feed.max()
    if name != "butterfly-nurbs":  # whose sharp turns these nodes do not resolve
        assert np.abs(v - motion(t)[1]).max() < 1e-7 * law.feed.max()


# ---- the state -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("name", MOTIONS)
def test_stepping_gives_the_samples_of_replay_to_the_bit(cases, name, order):
    curve, _, profile = cases[name]
    samples = replay(curve, profile, 2e-3, order=order)
    table = table_of(profile, order)
    state = start(table, 2e-3)
    position = state[-curve.dim :]
    rows, parameters, done = [position.copy()], [state[stepping.U]], False
    while not done:
        done = take_step(table, order, state)
        rows.append(position.copy())
        parameters.append(state[stepping.U])
    assert np.array_equal(rows, samples.position)
    assert np.array_equal(parameters, samples.u)


@pytest.mark.parametrize("order", ORDERS)
def test_the_end_is_held(cases, order):
    _, _, profile = cases["circle"]
    table = table_of(profile, order)
    state = start(table, profile.duration / 4.0)
    assert [take_step(table, order, state) for _ in range(6)] == [False, False, False, True, True, True]
    assert np.array_equal(state[-2:], table.ends[1])
    assert state[stepping.SAMPLE] == 4.0
    assert state[stepping.U] == 1.0


@pytest.mark.parametrize("order", ORDERS)
def test_a_copy_of_the_state_continues_identically(cases, order):
    _, _, profile = cases["teardrop"]
    table = table_of(profile, order)
    state = start(table, 1e-3)
    for _ in range(500):
        take_step(table, order, state)
    snapshot = state.copy()
    first, second = [], []
    for rows, current in ((first, state), (second, snapshot)):
        for _ in range(500):
            take_step(table, order, current)
            rows.append(current.copy())
    assert np.array_equal(first, second)


def test_a_plan_can_be_entered_at_any_sample(cases):
    curve, _, profile = cases["butterfly-nurbs"]
    table = InterpolatorTable.from_profile(profile)
    samples = replay(curve, profile, 1e-3)
    for first in (0, 1, 777, samples.t.size - 2, samples.t.size - 1):
        state = start(table, 1e-3, first=first)
        assert np.array_equal(state[-2:], samples.position[first])
        assert state[stepping.SAMPLE] == first
        quintic_step(*table.arrays, state)
        assert np.array_equal(state[-2:], samples.position[min(first + 1, samples.t.size - 1)])


def test_a_sample_that_does_not_exist_cannot_be_entered(cases):
    _, _, profile = cases["circle"]
    table = InterpolatorTable.from_profile(profile)
    for first in (-1, 10_000_000):
        with pytest.raises(InputError, match=f"first = {first} must lie within 0 and"):
            start(table, 1e-3, first=first)
    with pytest.raises(InputError, match="first = 5 must be 0: a Taylor step"):
        start(TaylorTable.from_profile(profile), 1e-3, first=5)
    with pytest.raises(InputError, match=r"period = nan s must be > 0 and finite"):
        start(table, np.nan)


# ---- the tables ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
def test_tables_are_frozen_plain_arrays(cases, order):
    for _, _, profile in cases.values():
        table = table_of(profile, order)
        for array in (*table.arrays, table.ends):
            assert type(array) is np.ndarray
            assert array.dtype == np.float64
            assert array.flags.c_contiguous
            assert not array.flags.writeable
        assert table.arrays[0][-1, 0] == table.arrays[1][-1, 0, 0] == np.inf


def test_a_plan_whose_parameter_falls_back_is_refused():
    curve = load_curve("circle")
    limits = drives()
    nodes = tuple(np.array(x) for x in ([0.0, 1.0, 2.0], [0.0, 0.5, 1.0], [0.0, -0.2, 0.0], [0.0, 0.0, 0.0]))
    profile = make_profile(curve, limits, TimeLaw(*nodes), method="swinging")
    with pytest.raises(InputError, match=r"falls back by .* between t = 0\.0 and 1\.0 s"):
        InterpolatorTable.from_profile(profile)


def test_a_plan_may_rest_on_the_way():
    curve = load_curve("circle")
    limits = drives()
    times, u = np.array([0.0, 3.0, 4.0, 7.0]), np.array([0.0, 0.3, 0.3, 1.0])
    profile = make_profile(curve, limits, TimeLaw(times, u, np.zeros(4), np.zeros(4)), method="stop")
    for order in ORDERS:
        samples = replay(curve, profile, 1e-3, order=order)
        assert np.ptp(samples.u[3001:4001]) == 0.0
        assert abs(samples.u[3500] - 0.3) < {1: 1e-3, 2: 1e-5, 3: 1e-5, 5: 1e-15}[order]


# ---- memory -------------------------------------------------------------------------------------------------------


def test_calls_keep_no_memory(cases):
    _, _, profile = cases["circle"]
    table = InterpolatorTable.from_profile(profile)
    arrays, state = table.arrays, start(table, 1e-5)
    quintic_step(*arrays, state)
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(10_000):
            quintic_step(*arrays, state)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 1000
