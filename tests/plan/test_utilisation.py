"""How far a time law uses the limits between its nodes, against looking everywhere."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import utilisation_reference as reference
from cases import drives
from program_blocks import line as block
from program_blocks import program
from strategies import random_nurbs

from planner import load_curve, load_limits
from planner.compiled import core
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw, quintic_coefficients
from planner.machine.feed_limits import commanded_feed
from planner.machine.limit_rows import limit_rows
from planner.machine.limits import Limits
from planner.plan.utilisation import _points, utilisation
from planner.programs.path.smooth_path import program_path

W = np.sqrt(0.5)
CURVES = {
    "formula": lambda: FormulaCurve({"X": "30*cos(u)", "Y": "18*sin(u)+u**2"}, (0.2, 3.0)),
    "circle": lambda: load_curve("circle"),
    "butterfly-nurbs": lambda: load_curve("butterfly-nurbs"),
}


def estimated(values, parts, granted):
    """Highest of the values and of the parabolas between them, less what is granted; whether that may be too low."""
    top = np.empty(1)
    doubtful = bool(core.utilisation_peak(parts, np.ascontiguousarray(values), granted, top))
    assert (top[0], doubtful) == reference.peak(values, parts, granted)
    return top[0], doubtful


def random_law(curve, seed, nodes=30):
    """Nodes of a wavy law along a curve, hit by some noise, its breaks at double nodes."""
    rng = np.random.default_rng(seed)
    lo, hi = curve.domain
    waves = [(2.0 * np.pi * k, rng.uniform(0.0, 0.3) / (2.0 * np.pi * k), rng.uniform(0.0, 6.0)) for k in (1, 2, 3)]

    def law(t, order):
        out = (lo + (hi - lo) * t, np.full(t.shape, hi - lo), np.zeros(t.shape))[order]
        for w, size, phase in waves:
            shift = size * (hi - lo) * np.sin(w * t + phase + 0.5 * np.pi * order) * w**order
            out = out + shift - (size * (hi - lo) * np.sin(phase) if order == 0 else 0.0)
        return out

    breaks = curve._candidate_breaks()
    t = np.linspace(0.0, 1.0, nodes + 1)
    u = law(t, 0)
    for at in breaks:
        near = int(np.argmin(np.abs(u - at)))
        left, right = 0.0, 1.0
        for _ in range(60):
            mid = 0.5 * (left + right)
            left, right = (mid, right) if law(np.array([mid]), 0)[0] < at else (left, mid)
        t[near], u[near] = mid, at
    u[0], u[-1] = lo, hi
    rate, acceleration = law(t, 1), law(t, 2)
    noise = np.diff(t).min()
    rate *= 1.0 + 1e-3 * noise**2 * rng.normal(size=t.size)
    acceleration += 1e-2 * noise * np.abs(acceleration).max() * rng.normal(size=t.size)
    twice = np.repeat(np.arange(t.size), 1 + np.isin(u, breaks))
    return TimeLaw(t[twice], u[twice], rate[twice], acceleration[twice])


def by_brute_force(curve, limits, nodes, points=1001):
    """Largest shares (3, n - 1) by evaluating every interval from its inside at many points."""
    out = np.zeros((3, nodes.t.size - 1))
    for i in np.flatnonzero(np.diff(nodes.t) > 0.0):
        pair = slice(i, i + 2)
        t = nodes.t[i] + (nodes.t[i + 1] - nodes.t[i]) * np.linspace(1e-9, 1.0 - 1e-9, points)
        u, u1, u2, u3 = TimeLaw(nodes.t[pair], nodes.u[pair], nodes.u_rate[pair], nodes.u_acceleration[pair]).at(t)
        q = curve.derivatives(u, 3)
        v = q[1] * u1[:, None]
        a = q[2] * u1[:, None] ** 2 + q[1] * u2[:, None]
        j = q[3] * u1[:, None] ** 3 + 3.0 * q[2] * (u1 * u2)[:, None] + q[1] * u3[:, None]
        tip = [i for i, axis in enumerate(curve.axes) if axis not in "ABC"]
        feed = np.sqrt(np.sum(v[:, tip] ** 2, axis=-1))
        direction = v[:, tip] / feed[:, None]
        along = np.abs(np.sum(a[:, tip] * direction, axis=-1))
        # d/dt of |v|' = v.a/|v|
        normal2 = np.sum(a[:, tip] ** 2, axis=-1) - along**2
        twice = np.abs(np.sum(j[:, tip] * direction, axis=-1) + normal2 / feed)
        curvature = np.sqrt(np.maximum(normal2, 1e-300)) / feed**2
        chord = np.minimum(limits.chord_error, 1.0 / curvature)
        allowed = (
            2.0 / limits.period * np.sqrt(chord * (2.0 / curvature - chord)) if np.isfinite(chord).all() else np.inf
        )
        speed = [(np.abs(v) / limits.velocity).max(), (feed / limits.feed).max()]
        if np.isfinite(limits.chord_error):
            speed.append((feed / allowed).max())
        out[0, i] = max(speed)
        out[1, i] = max((np.abs(a) / limits.acceleration).max(), (along / limits.tangential_acceleration).max())
        out[2, i] = max((np.abs(j) / limits.jerk).max(), (twice / limits.tangential_jerk).max())
    return out


EVERY_LIMIT = {"chord_error": 1e-3, "tangential_acceleration": 500.0, "tangential_jerk": 5000.0}
SOME = [
    {"feed": 100.0},
    {"velocity": [50.0, 80.0]},
    {"acceleration": [700.0, 500.0]},
    {"jerk": [20000.0, 9000.0]},
    {"chord_error": 1e-4},
    {"tangential_acceleration": 300.0},
    {"tangential_jerk": 3000.0},
]


@pytest.mark.parametrize("some", SOME, ids=lambda some: next(iter(some)))
@pytest.mark.parametrize("name", ["formula", "circle"])
def test_utilisation_of_every_kind_of_limit(name, some):
    curve = CURVES[name]()
    free = [np.inf, np.inf]
    limits = Limits(**({"feed": np.inf, "velocity": free, "acceleration": free, "jerk": free} | some))
    nodes = random_law(curve, 3)
    used = utilisation(curve, limits, nodes)
    exact = by_brute_force(curve, limits, nodes)
    found = np.stack([used.speed, used.acceleration, used.jerk])
    assert np.count_nonzero(exact.max(axis=1)) == 1
    assert found == pytest.approx(exact, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_the_peak_that_decides_is_found(seed):
    curve = random_nurbs(seed, 3, 2)
    limits = drives(**EVERY_LIMIT)
    nodes = random_law(curve, seed, 60)
    slowdown = utilisation(curve, limits, nodes).slowdown
    speed, acceleration, jerk = by_brute_force(curve, limits, nodes)
    exact = np.maximum(speed, np.maximum(np.sqrt(acceleration), np.cbrt(jerk)))
    assert slowdown.max() == pytest.approx(exact.max(), rel=2e-6)
    assert (slowdown >= exact * (1.0 - 1e-3)).all()
    assert (slowdown <= exact * 1.05).all()
    assert (slowdown[np.diff(nodes.t) == 0.0] == 0.0).all()


@pytest.mark.parametrize("place", [0.027, 0.5, 0.96])
def test_a_peak_between_two_points_is_estimated(place):
    """More intervals than are looked at closely; in each the third derivative of u is a parabola about a place."""
    count = 200
    line = NurbsCurve([[0.0, 0.0], [count, 0.0]], [0, 0, count, count], 1)
    # u over one interval of time 1, with feed and acceleration to begin with
    p = np.polynomial.Polynomial([1.0 - place**2, 2.0 * place, -1.0]).integ(3, k=[1.0, 0.7, 0.0])
    scale = 1.0 / p(1.0)
    ends = np.arange(2.0)
    rate, acceleration = (np.tile(scale * p.deriv(k)(ends), count) for k in (1, 2))
    t = np.repeat(np.arange(count + 1.0), 2)[1:-1]
    nodes = TimeLaw(t, t.copy(), rate, acceleration)
    limits = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [scale, np.inf])
    used = utilisation(line, limits, nodes).jerk
    assert used[::2] == pytest.approx(np.ones(count), rel=1e-8)


@pytest.mark.parametrize("height", [0.999, 1.001])
def test_a_peak_that_parabolas_miss_is_found_where_it_decides(height):
    """A whole blend within two intervals of a law: its jerk has peaks between the points that are looked at first."""
    blend = NurbsCurve([[0.0, 0.0], [4.0, 0.0], [6.0, 0.0], [6.0, 2.0], [6.0, 6.0]], [0, 0, 0, 0, 0.5, 1, 1, 1, 1], 3)
    nodes = TimeLaw(
        np.array([0.0, 0.4, 1.0]), np.array([0.0, 0.5, 1.0]), np.array([1.0, 1.5, 0.6]), np.array([1.0, 0.2, -2.0])
    )
    free = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [1.0, 1.0])
    peak = by_brute_force(blend, free, nodes, 20001)[2].max()
    limits = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [peak / height] * 2)
    assert utilisation(blend, limits, nodes).jerk.max() == pytest.approx(height, abs=1e-6)


@pytest.mark.parametrize("granted", [0.0, 0.3])
def test_a_peak_is_sure_or_said_to_be_doubtful(granted):
    """Cubics near 1 through six points: one that is not said to be doubtful rises nowhere above 1 unless that is seen."""
    rng, fine = np.random.default_rng(7), np.linspace(0.0, 5.0, 2001)
    doubts, kept, broken = 0, 0, 0
    for _ in range(4000):
        cubic = np.polynomial.Polynomial.fromroots(rng.uniform(-1.0, 6.0, 3)) * rng.choice([-1.0, 1.0])
        cubic = cubic / np.abs(cubic(np.arange(6))).max() * 10.0 ** rng.uniform(-6.0, 0.0)
        peak = cubic(fine).max()
        # at the points alone, or between them, it is about to exceed 1
        cubic += 1.0 + granted - peak + rng.uniform(-1.0, 1.0) * 0.1 * np.ptp(cubic(fine))
        peak = cubic(fine).max() - granted
        top, doubtful = estimated(cubic(np.arange(6.0)), 5, granted)
        doubts += doubtful
        if doubtful:
            continue
        if peak <= 1.0:
            kept += 1
            assert top <= 1.0 + 3e-7
        else:
            broken += 1
            assert top > 1.0 - 3e-7
    assert min(doubts, kept, broken) > 200


def test_a_peak_that_is_far_below_its_limit_is_not_looked_for():
    values = np.array([0.0, 0.4, 0.1, 0.5, 0.2, 0.3])  # as rough as can be
    assert not estimated(values, 5, 0.0)[1]
    assert estimated(2.0 * values, 5, 0.0)[1]
    assert not estimated(2.0 * values, 5, 1.0)[1]  # granted to rounding


def test_rounding_of_a_table_is_granted_and_no_more():
    """u = 1e5 + v t + j t^3 / 6 at points 1 ms apart: the last digit of u is worth more than the whole jerk limit."""
    line = NurbsCurve([[0.0, 0.0], [2e5, 0.0]], [0, 0, 2e5, 2e5], 1)
    t = 1e-3 * np.arange(400)
    u, rate, acceleration = 1e5 + (10.0 * t + 0.1 * t**3 / 6.0), 10.0 + 0.05 * t**2, 0.1 * t
    limits = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [0.5, np.inf])
    nodes = TimeLaw(t, u, rate, acceleration)
    assert by_brute_force(line, limits, nodes, 11)[2].max() > 1.0
    assert utilisation(line, limits, nodes).jerk.max() <= 0.2 * (1.0 + 1e-9)
    # at a tenth of the digits nothing is left to be granted
    near = TimeLaw(t, 10.0 * t + 0.1 * t**3 / 6.0, rate, acceleration)
    assert utilisation(line, limits, near).jerk == pytest.approx(np.full(399, 0.2), abs=2e-3)
    exact = TimeLaw(t, u, rate, acceleration, np.stack([np.diff(t), np.diff(10.0 * t + 0.1 * t**3 / 6.0)]))
    assert utilisation(line, limits, exact).jerk == pytest.approx(np.full(399, 0.2), abs=2e-3)


def test_what_is_granted_for_rounding_is_that_of_the_interval_and_not_of_the_end():
    """u = v t + t^3 / 6: a jerk of 1, at first over a millisecond, and at the end where the digits of u and t are large."""
    line = NurbsCurve([[0.0, 0.0], [2e6, 0.0]], [0, 0, 2e6, 2e6], 1)
    limits = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [0.5, np.inf])
    t = np.array([0.0, 1e-3, 2e-3, 100.0, 200.0])
    for feed in (0.0, 1e3):
        nodes = TimeLaw(t, feed * t + t**3 / 6.0, feed + t**2 / 2.0, t)
        assert utilisation(line, limits, nodes).jerk[[0, 1]] == pytest.approx([2.0, 2.0], rel=1e-3)


def test_every_interval_of_a_long_law_has_its_peak_estimated():
    """Only few intervals are looked at closely; the others rely on the parabola through three points."""
    curve = CURVES["formula"]()
    limits = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [20000.0, 9000.0])
    nodes = random_law(curve, 5, 400)
    used = utilisation(curve, limits, nodes).jerk
    exact = by_brute_force(curve, limits, nodes)[2]
    assert used == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("with_steps", [False, True])
def test_measuring_some_intervals_at_a_time_changes_nothing(monkeypatch, with_steps):
    curve = CURVES["butterfly-nurbs"]()
    law = random_law(curve, 2)
    if with_steps:
        law = replace(law, steps=np.stack([np.diff(law.t), np.diff(law.u)]))
    whole = utilisation(curve, drives(), law)
    monkeypatch.setattr(import_module("planner.plan.utilisation"), "_AT_ONCE", 7)
    parts = utilisation(curve, drives(), law)
    for name in ("speed", "acceleration", "jerk", "backward"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name))


def test_a_law_that_falls_back_says_how_fast():
    line = NurbsCurve([[0.0, 0.0], [10.0, 0.0]], [0, 0, 1, 1], 1)
    free = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [1.0, 1.0])
    nodes = TimeLaw(
        np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.0]), np.array([0.5, 2.0, 0.1]), np.array([0.0, 0.0, 0.0])
    )
    fine = [
        TimeLaw(*(c[k : k + 2] for c in (nodes.t, nodes.u, nodes.u_rate, nodes.u_acceleration))).at(at)[1]
        for k, at in enumerate(np.linspace([0.0, 1.0], [1.0, 2.0], 5001).T)
    ]
    used = utilisation(line, free, nodes)
    assert min(rates.min() for rates in fine) < -0.1
    assert used.backward == pytest.approx([max(0.0, -rates.min()) for rates in fine], rel=1e-2)


def test_feeds_that_the_path_commands_are_those_of_each_interval():
    blocks = (block(4, 0, feed=2.0), block(5, 0, feed=4.0), block(10, 0, feed=8.0))
    path = program_path(program(*blocks), 0.01, drives(np.inf), path="separate").curve
    free = Limits(5.0, *[[np.inf] * path.dim] * 3, axes=path.axes)
    u = np.arange(11.0)
    used = utilisation(path, free, TimeLaw(u, u, np.ones(11), np.zeros(11)))
    assert used.speed == pytest.approx([0.5] * 4 + [0.25] + [0.2] * 5, rel=1e-12)


def test_a_stretch_between_breaks_has_forty_points_however_few_its_intervals():
    """Breaks at 1, 2 and 3: one interval, two of unequal times, and ninety-seven."""
    points = [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0], [3.0, 1.0], [4.0, 0.0]]
    zigzag = NurbsCurve(points, [0, 0, 1, 2, 3, 4, 4], 1)
    u = np.concatenate([[0.0, 1.0, 1.25, 2.0, 3.0], np.linspace(3.0, 4.0, 98)[1:]])
    nodes = TimeLaw(u, u, np.ones(u.size), np.zeros(u.size))
    found = _points(zigzag, nodes, np.diff(u))
    assert found.tolist() == [40, 10, 30, 40, *[5] * 97]


def test_rotary_axes_and_a_resting_tip():
    xy = [[10.0 * k, 0.0] for k in range(4)] + [[30.0, 0.0]] * 5 + [[30.0, 10.0 * k] for k in range(1, 4)]
    points = np.column_stack([xy, 0.05 * np.arange(len(xy))])
    knots = [0, 0, 0, 0, *range(1, len(xy) - 3), *[len(xy) - 3] * 4]
    curve = NurbsCurve(points, knots, 3, axes=["X", "Y", "A"])
    t = np.linspace(0.0, 9.0, 91)
    limits = Limits(100.0, [250, 250, 0.1], [1000, 1000, 10], [2e4, 2e4, 200], 1e-3, axes=["X", "Y", "A"])
    double = np.repeat(np.arange(91), 1 + np.isin(np.round(t, 9), np.arange(1.0, 9.0)))
    one = np.ones(double.size)
    used = utilisation(curve, limits, TimeLaw(t[double], t[double], one, 0.0 * one))
    mid = np.append(0.5 * (t[double][1:] + t[double][:-1]), 0.0)[:-1]
    resting = (mid > 5.0) & (mid < 6.0) & (np.diff(t[double]) > 0.0)
    assert np.isfinite(used.slowdown).all()
    assert used.speed[resting] == pytest.approx(np.full(np.count_nonzero(resting), 0.5), rel=1e-9)
    assert used.jerk[resting].max() < 1e-6


def test_beside_a_curvature_jump_half_of_the_jerk_is_the_steps():
    points = [[-20, 0], [-10, 0], [0, 0], [10, 0], [10, 10]]
    curve = NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 2], 2, [1, 1, 1, W, 1])
    at = float(curve.arclength.s(1.0))
    feed, slowing = 10.0, 400.0  # mm/s and mm/s^3: a constant jerk along the line before the jump
    time = np.linspace(-0.05, 0.0, 51)
    s = at + feed * time - slowing * time**3 / 6.0
    u = curve.arclength.u(s)
    u[-1] = 1.0
    d = curve.derivatives(u, 2, side="left")
    speed = np.sqrt(np.sum(d[1] ** 2, axis=-1))
    rate = (feed - slowing * time**2 / 2.0) / speed
    acceleration = (-slowing * time - rate**2 * np.sum(d[1] * d[2], axis=-1) / speed) / speed
    after = np.linspace(0.001, 0.02, 20)
    u_after = curve.arclength.u(at + feed * after)
    d_after = curve.derivatives(u_after, 2)
    speed_after = np.sqrt(np.sum(d_after[1] ** 2, axis=-1))
    turn = -((feed / speed_after) ** 2) * np.sum(d_after[1] * d_after[2], axis=-1) / speed_after**2
    at_jump = curve.derivatives(np.array([1.0]), 2)[:, 0]
    first = np.sqrt(at_jump[1] @ at_jump[1])
    nodes = TimeLaw(
        np.concatenate([time, [0.0], after]) + 0.05,
        np.concatenate([u, [1.0], u_after]),
        np.concatenate([rate, [feed / first], feed / speed_after]),
        np.concatenate([acceleration, [-(feed**2) * (at_jump[1] @ at_jump[2]) / first**4], turn]),
    )
    limits = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [1000.0, np.inf], period=2e-3)
    used = utilisation(curve, limits, nodes).jerk
    before = nodes.t[1:51] < 0.05 - 6e-3 + 1e-9
    assert used[:50][before] == pytest.approx(np.full(np.count_nonzero(before), 0.4), rel=1e-3)
    assert used[45:50] == pytest.approx(np.full(5, 0.8), rel=1e-3)


def by_reference(curve, limits, law):
    """The same measurement in plain Python, and the quintics it is of."""
    i = np.flatnonzero(np.diff(law.t) > 0.0)
    h, advance = np.diff(law.t)[i], np.diff(law.u)[i]
    digit = np.finfo(float).eps * (np.abs(law.u[i + 1]) + np.abs(law.u_rate[i]) * law.t[i + 1])
    if law.steps is not None:
        (h, advance), digit = law.steps[:, i], 0.0 * digit
    none = np.zeros(i.size)
    with np.errstate(all="ignore"):
        ends = ((none, advance), (law.u_rate[i], law.u_rate[i + 1]), (law.u_acceleration[i], law.u_acceleration[i + 1]))
        quintic = quintic_coefficients(h, *zip(*ends, strict=True))
    quintic[0] = law.u[i]
    doubles = np.append(law.u[:-1][np.diff(law.t) == 0.0], law.u[-1])
    first, last = law.u[i], law.u[i + 1]
    end = doubles[np.searchsorted(doubles, last)]
    feed = commanded_feed(curve, limits, 0.5 * (first + last))
    spans = np.stack([h, first, last, end, digit, feed, _points(curve, law, np.diff(law.t))[i]])
    rows, kinds = [], []
    for row in limit_rows(limits):
        bounds, weights = (row.bounds, np.multiply(row.weights, 1.0 / row.scale))
        rows.append((*row.weights, row.lower, row.upper) if row.along else (*weights, *bounds))
        kinds.append((row.motion, row.order - 1))
    out = np.empty((4, i.size))
    axes, tip = (
        (part.breaks, part.coefficients, part.rational, part.resting, part.origin)
        for part in (curve.pieces, curve.tip.pieces)
    )
    chords = limits.chord_error, limits.period
    rows, kinds = np.array(rows).reshape(-1, 5), np.array(kinds).reshape(-1, 2)
    with np.errstate(all="ignore"):
        reference.shares(axes, tip, curve.tip is curve, quintic, spans, rows, kinds, chords, out)
    every = np.zeros((4, law.t.size - 1))
    every[:, i] = out
    return every


def measured(curve, limits, law):
    with np.errstate(all="ignore"):
        used = utilisation(curve, limits, law)
    return np.stack([used.speed, used.acceleration, used.jerk, used.backward])


MEASURED = {
    "a spline, every limit": (lambda: random_nurbs(3, 3, 2), drives(**EVERY_LIMIT), 30),
    "rational, and a number of intervals that four do not divide": (
        lambda: load_curve("circle"),
        drives(**EVERY_LIMIT),
        41,
    ),
    "a formula without chord error": (CURVES["formula"], drives(), 10),
    "one interval": (CURVES["formula"], drives(chord_error=1e-5), 1),
    "so coarse that all are doubtful": (lambda: random_nurbs(5, 3, 2), drives(**EVERY_LIMIT), 3),
}


@pytest.mark.parametrize("steps", [False, True])
@pytest.mark.parametrize("case", MEASURED)
def test_the_compiled_measurement_has_the_bits_of_the_plain_one(case, steps):
    make, limits, nodes = MEASURED[case]
    curve = make()
    law = random_law(curve, 1, nodes)
    if steps:
        law = replace(law, steps=np.stack([np.diff(law.t), np.diff(law.u)]))
    np.testing.assert_array_equal(measured(curve, limits, law), by_reference(curve, limits, law))


def test_the_bits_are_those_of_the_plain_one_where_the_tip_has_pieces_of_its_own():
    curve, limits = load_curve("flank"), load_limits("five-axis")
    assert curve.tip.pieces.breaks.size != curve.pieces.breaks.size
    law = random_law(curve, 2, 25)
    np.testing.assert_array_equal(measured(curve, limits, law), by_reference(curve, limits, law))


def test_what_is_not_a_number_is_measured_like_the_plain_one():
    """A tip that rests, intervals that end with their stretch, and a law of nan and inf."""
    points = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.1], [10.0, 0.0, 0.2], [20.0, 5.0, 0.3]]
    curve = NurbsCurve(points, [0, 0, 1, 2, 3, 3], 1, axes=["X", "Y", "A"])
    limits = Limits(100.0, [250, 250, 0.1], [1000, 1000, 10], [2e4, 2e4, 200], 1e-3, axes=["X", "Y", "A"])
    u = np.linspace(0.0, 3.0, 13)
    rate = np.ones(13)
    rate[[5, 11]] = np.nan, np.inf
    law = TimeLaw(u, u, rate, 0.0 * u)
    np.testing.assert_array_equal(measured(curve, limits, law), by_reference(curve, limits, law))


def test_a_planted_defect_is_another_measurement(monkeypatch):
    """With the parabolas left out, with no doubt, or with a point less the bits differ: the comparison sees one term."""
    curve, limits, peak = random_nurbs(5, 3, 2), drives(**EVERY_LIMIT), reference.peak
    changes = {
        30: lambda values, points, granted: (values[: points + 1].max() - granted, peak(values, points, granted)[1]),
        12: lambda values, points, granted: (peak(values, points, granted)[0], False),
        3: lambda values, points, granted: peak(values, points - 1, granted),
    }
    for nodes, changed in changes.items():
        law = random_law(curve, 1, nodes)
        monkeypatch.setattr(reference, "peak", changed)
        assert not np.array_equal(measured(curve, limits, law), by_reference(curve, limits, law))
