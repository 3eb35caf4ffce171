"""What the check compiles, against array arithmetic over all points and against the plan's own evaluation."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from planner import load_curve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.profile import make_profile
from planner.verify.motion import Motion, Quintics
from planner.verify.peaks import CANDIDATES, Highest, peaks
from planner.verify.quantities import REVERSAL, axis_rows, names

kernels = importlib.import_module("planner.verify.motion_kernels")


def plan_on(name, count=37):
    """A smooth law of time over a curve, whose nodes keep clear of its knots, so that spans begin between them."""
    curve = load_curve(name)
    free = [np.inf] * curve.dim
    u0, u1 = curve.domain
    x = np.linspace(0.0, 1.0, count)
    u = u0 + (u1 - u0) * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi))
    u[-1] = u1
    rate = (u1 - u0) * (1.0 - np.cos(2.0 * np.pi * x)) / 3.0
    nodes = (3.0 * x, u, rate, (u1 - u0) * 2.0 * np.pi * np.sin(2.0 * np.pi * x) / 9.0)
    return make_profile(curve, Limits(np.inf, free, free, free), TimeLaw(*nodes), method="test")


@pytest.fixture(scope="module", params=["circle", "flank"])
def motion(request):
    """On a Cartesian machine, and on one whose tool tip is not made of the machine axes."""
    profile = plan_on(request.param)
    return Motion.of(profile.curve, Quintics.of(profile))


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
    values, slack = np.empty((2, len(names(motion.curve.dim)), *x.shape))
    kernels.measure_points(d, p, cartesian, rates, error, values, slack)
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
    shape = (len(names(motion.curve.dim)), *x.shape)
    values, slack, moved, unused = (np.empty(shape) for _ in range(4))
    kernels.measure_points(d, p, cartesian, rates, error, values, slack)
    largest = np.zeros(shape)
    for signs in np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3):
        kernels.measure_points(d, p, cartesian, rates + (error * signs).T[:, :, None], error, moved, unused)
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
    states, count, dim = motion.states(span, x), len(names(motion.curve.dim)), motion.curve.dim
    ends, height, top = np.empty((2, count, span.size)), np.empty((count, span.size)), np.empty((count, span.size), int)
    largest, jerk = np.zeros(count), np.empty((dim, span.size))
    kernels.measure_spans(*states, ends, height, top, largest, jerk)
    values, slack = motion.measure(span, x)
    sizes = np.abs(values)
    sizes[REVERSAL] = values[REVERSAL]
    expected, at = peaks(sizes - slack)
    assert (top == at).all()
    assert height == pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert jerk == pytest.approx(peaks(np.maximum(sizes - slack, 0.0)[-dim:])[0], rel=1e-12, abs=1e-300)
    assert (largest == np.maximum((sizes - slack).max(axis=(1, 2)), 0.0)).all()
    assert (ends == np.moveaxis(values[:, :, [0, -1]], -1, 0)).all()


def test_what_is_not_a_number_is_the_highest(motion):
    span = np.arange(8)
    d, p, cartesian, rates, slack = motion.states(span, motion.grid(span, 24))
    count, dim = len(names(motion.curve.dim)), motion.curve.dim
    rates[2, 5, 11] = np.nan
    height, top = np.empty((count, 8)), np.empty((count, 8), dtype=np.intp)
    jerk = np.empty((dim, 8))
    kernels.measure_spans(d, p, cartesian, rates, slack, np.empty((2, count, 8)), height, top, np.zeros(count), jerk)
    rows = axis_rows(dim, 2)
    assert (height[rows, 5] == np.inf).all()
    assert (top[rows, 5] == 11).all()
    assert (jerk[:, 5] == np.inf).all()
    assert np.isfinite(np.delete(height, 5, axis=1)).all()


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


@pytest.mark.parametrize(("dim", "stride"), [(2, 3), (3, 9)])
def test_heights_of_chords_are_distances_to_segments(dim, stride):
    """The nearest of many points of each segment, in every direction; one chord has no length."""
    parts, count = 8, 12
    points = np.cumsum(np.random.default_rng(dim).normal(size=(count * stride + parts + 1, dim)), axis=0)
    points[2 * stride + parts] = points[2 * stride]
    height, top = np.empty(count), np.empty(count, dtype=np.intp)
    kernels.chord_heights(points, stride, parts, height, top)
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
        highest = Highest()
        for first in range(0, 200, size):
            some = np.arange(first, min(first + size, 200))
            highest.offer(height[some], some, x[some])
        assert highest.index.tolist() == order.tolist()
        assert highest.x.tolist() == x[order].tolist()
