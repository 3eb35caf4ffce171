"""The worst values that the check reports: against brute force, and with one planted violation a limit."""

from __future__ import annotations

import numpy as np
import pytest
from check_plans import (
    AXIS_LIMITS,
    ELLIPSE,
    SINGLE_LIMITS,
    check,
    constant_feed,
    failing,
    lift,
    lowered,
    nodes_of,
    profile_on,
    sampled,
    scurve,
    searching,
    unlimited,
    with_lengths,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import load_curve
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.samples import Samples


@pytest.fixture(scope="module")
def coarse_plan(ellipse):
    """Few nodes of a smooth time law, so that every peak lies between points."""
    t, h = np.linspace(0.0, 2.0, 23), 1e-3

    def law(x):
        return np.pi * x + 0.6 * np.sin(np.pi * x / 2.0) ** 2 * np.sin(np.pi * x)

    u, rate = law(t), (law(t + h) - law(t - h)) / (2 * h)
    second = (law(t + h) - 2 * law(t) + law(t - h)) / h**2
    u[-1] = 2.0 * np.pi
    return profile_on(ellipse, unlimited(), (t, u, rate, second))


@pytest.fixture(scope="module")
def wavy_plan(ellipse):
    """A rate of u with several waves: many peaks of nearly one height between the nodes."""

    def law(x):
        return np.pi * x + 0.04 * sum(np.sin(4.0 * k * np.pi * x) for k in (1, 2, 3))

    t, h = np.linspace(0.0, 2.0, 28), 1e-3
    u = law(t)
    u[-1] = 2.0 * np.pi
    rate, second = (law(t + h) - law(t - h)) / (2 * h), (law(t + h) - 2 * law(t) + law(t - h)) / h**2
    return profile_on(ellipse, unlimited(), (t, u, rate, second))


@pytest.mark.parametrize("plan", ["coarse_plan", "wavy_plan"])
def test_density_changes_no_worst_value(ellipse, plan, request):
    profile = request.getfixturevalue(plan)
    reports = [check(ellipse, unlimited(), profile, density=density) for density in (4, 24, 57)]
    for name, axis in [*((name, "") for name in SINGLE_LIMITS), *((n, a) for n in AXIS_LIMITS for a in "XY")]:
        first, *others = (report.row(name, axis) for report in reports)
        for other in others:
            assert other.worst == pytest.approx(first.worst, rel=1e-9, abs=0.0)


def test_a_short_way_back_between_nodes_is_found(ellipse):
    """u' = 1 + 1.002 cos 4t dips below zero four times for some 0.03 s; at every node it is positive."""
    t = np.linspace(0.0, 2.0 * np.pi, 23)
    u, rate = t + 1.002 / 4.0 * np.sin(4.0 * t), 1.0 + 1.002 * np.cos(4.0 * t)
    u[-1] = 2.0 * np.pi
    assert rate.min() > 0.0
    plan = profile_on(ellipse, unlimited(), (t, u, rate, -4.0 * 1.002 * np.sin(4.0 * t)))
    rows = [check(ellipse, unlimited(), plan, density=density).row("reversal") for density in (4, 24, 48)]
    fine = plan.at(np.linspace(0.0, plan.duration, 400_001)).u_rate
    for row in rows:
        assert not row.ok
        assert row.worst == pytest.approx(-fine.min(), rel=1e-6)


def test_density_changes_no_chord_error_of_samples(ellipse, coarse_plan):
    samples = sampled(ellipse, coarse_plan, 0.05)
    rows = [check(ellipse, unlimited(), samples, density=density).row("chord error") for density in (8, 24, 101)]
    assert rows[1].worst == pytest.approx(rows[0].worst, rel=1e-9)
    assert rows[2].worst == pytest.approx(rows[0].worst, rel=1e-9)


def test_chunks_change_nothing(monkeypatch, ellipse, ellipse_plan, circle):
    limits = Limits(100.0, [90.0] * 2, [500.0] * 2, [9000.0] * 2, 1e-4)
    on_circle = profile_on(circle, limits, lift(circle, constant_feed(circle, 100.0, 300), double=False))
    cases = [(ellipse, ellipse_plan), (ellipse, sampled(ellipse, ellipse_plan, 1e-3)), (circle, on_circle)]
    whole = [check(curve, limits, plan) for curve, plan in cases]
    for points in (300, 777, 20_000):
        monkeypatch.setattr(searching, "_CHUNK_POINTS", points)
        assert [check(curve, limits, plan) for curve, plan in cases] == whole


def test_chord_error_agrees_with_brute_force(ellipse, coarse_plan):
    """The largest distance over 400 phases of the sampling, each chord looked at in 60 points."""
    period = 0.04
    report = check(ellipse, unlimited(period=period), coarse_plan)
    starts = np.linspace(0.0, coarse_plan.duration - period, 4000)
    t = starts[:, None] + period * np.linspace(0.0, 1.0, 61)
    u = coarse_plan.at(np.minimum(t, coarse_plan.duration)).u
    p = np.stack([ELLIPSE[0] * np.cos(u), ELLIPSE[1] * np.sin(u)], axis=-1)
    chord = p[:, -1] - p[:, 0]
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=-1) / np.linalg.norm(chord, axis=1)[:, None]
    distance = np.abs(np.einsum("nkd,nd->nk", p - p[:, :1], normal))
    row = report.row("chord error")
    assert distance.max() <= row.worst * (1 + 1e-12)
    assert row.worst == pytest.approx(distance.max(), rel=1e-3)
    assert row.t == pytest.approx(t.flat[distance.argmax()], abs=2e-3)
    assert row.u == pytest.approx(float(coarse_plan.at(row.t).u), abs=1e-12)


def test_distance_is_to_the_chord_not_to_its_line():
    """A hairpin passed within one period: its tip lies beyond the end of the chord."""
    hairpin = NurbsCurve([[0.0, 0.0], [3.0, 0.0], [3.0, 0.1], [1.0, 0.1]], [0, 0, 0, 0, 1, 1, 1, 1], 3)
    samples = Samples(1.0, np.array([0.0, 1.0]), np.array([0.0, 1.0]), hairpin.derivatives(np.array([0.0, 1.0]), 0)[0])
    row = check(hairpin, unlimited(), samples).row("chord error")
    u = np.linspace(0.0, 1.0, 200_001)
    p = hairpin.derivatives(u, 0)[0]
    end = np.array([1.0, 0.1])
    share = np.clip(p @ end / (end @ end), 0.0, 1.0)
    assert row.worst == pytest.approx(np.linalg.norm(p - share[:, None] * end, axis=1).max(), rel=1e-8)
    assert row.worst > 0.9


EVERY_LIMIT = [*((name, None) for name in SINGLE_LIMITS), *((name, j) for name in AXIS_LIMITS for j in (0, 1))]


def ellipse_position(profile, t):
    u = profile.at(np.clip(t, 0.0, profile.duration)).u
    return np.stack([ELLIPSE[0] * np.cos(u), ELLIPSE[1] * np.sin(u)], axis=-1)


def differenced(profile, t, order, name, axis):
    """One-sided finite differences of the closed form of the ellipse, before and after t; |value| of the quantity."""
    h = 2e-4
    found = []
    for sign in (-1.0, 1.0):
        at = t + sign * h * np.arange(order + 1)
        if at.min() < 0.0 or at.max() > profile.duration:
            continue
        if name in {"feed", "tangential acceleration", "tangential jerk"}:
            u = np.linspace(*profile.at(np.array([at.min(), at.max()])).u, 40_001)
            steps = np.hypot(*(np.diff(f) for f in (ELLIPSE[0] * np.cos(u), ELLIPSE[1] * np.sin(u))))
            values = np.interp(profile.at(at).u, u, np.concatenate([[0.0], np.cumsum(steps)]))
        else:
            values = ellipse_position(profile, at)[:, axis]
        found.append(abs(np.diff(values, order)[0]) / h**order)
    assert found
    return found


@pytest.mark.parametrize(("name", "axis"), EVERY_LIMIT)
def test_a_limit_lowered_by_a_thousandth_is_found_on_the_profile(ellipse, ellipse_plan, used_up, name, axis):
    report = check(ellipse, lowered(used_up["profile"], name, axis, 0.999), ellipse_plan)
    letter = "" if axis is None else "XY"[axis]
    assert failing(report) == {(name, letter)}
    row = report.row(name, letter)
    assert row.ratio == pytest.approx(1.0 / 0.999, rel=1e-12)
    assert row.u == pytest.approx(float(ellipse_plan.at(row.t).u), abs=1e-12)
    if name == "chord error":
        return
    order = {"feed": 1, "velocity": 1}.get(name, 3 if "jerk" in name else 2)
    there = differenced(ellipse_plan, row.t, order, name, axis)
    assert min(abs(value / row.worst - 1.0) for value in there) < 0.01


@pytest.mark.parametrize(("name", "axis"), EVERY_LIMIT)
def test_a_limit_lowered_by_a_thousandth_is_found_on_the_samples(
    ellipse, ellipse_plan, ellipse_samples, used_up, name, axis
):
    samples = ellipse_samples
    report = check(ellipse, lowered(used_up["samples"], name, axis, 0.999), samples)
    letter = "" if axis is None else "XY"[axis]
    assert failing(report) == {(name, letter)}
    row = report.row(name, letter)
    u_there = float(ellipse_plan.at(min(row.t, ellipse_plan.duration)).u)
    # The place is the middle of the samples that the difference takes in.
    assert row.u == pytest.approx(u_there, abs=1e-5)
    if name not in {"feed", "chord error"}:
        order = {"velocity": 1}.get(name, 3 if "jerk" in name else 2)
        at = np.clip(row.t + 1e-3 * (np.arange(order + 1) - order / 2), 0.0, ellipse_plan.duration)
        along = ellipse.arclength.s(ellipse_plan.at(at).u)
        moved = along if axis is None else ellipse_position(ellipse_plan, at)[:, axis]
        assert abs(np.diff(moved, order)[0]) / 1e-3**order == pytest.approx(row.worst, rel=1e-5)


def test_the_place_of_a_tangential_row_is_the_middle_of_its_samples(ellipse):
    """A plan from rest to rest without constant phases, so that only the right place has the reported value."""
    x, total, period = np.linspace(0.0, 1.0, 101), 2.0, 5e-3
    u = 2.0 * np.pi * x - np.sin(2.0 * np.pi * x)
    u[-1] = 2.0 * np.pi
    rate = 2.0 * np.pi * (1.0 - np.cos(2.0 * np.pi * x)) / total
    second = 4.0 * np.pi**2 * np.sin(2.0 * np.pi * x) / total**2
    plan = profile_on(ellipse, unlimited(), (x * total, u, rate, second))
    report = check(ellipse, unlimited(), sampled(ellipse, plan, period))
    for order, name in ((2, "tangential acceleration"), (3, "tangential jerk")):
        row = report.row(name)
        at = np.clip(row.t + period * (np.arange(order + 1) - order / 2), 0.0, plan.duration)
        there = np.diff(ellipse.arclength.s(plan.at(at).u), order)[0] / period**order
        assert abs(there) == pytest.approx(row.worst, rel=1e-6)


@pytest.mark.parametrize("on_samples", [False, True])
def test_a_plan_sped_up_by_half_a_percent_fails(line, line_limits, line_plan, on_samples):
    k = 1.005
    t, u, rate, second = nodes_of(line_plan)
    fast = profile_on(line, line_limits, (t / k, u, rate * k, second * k**2))
    plan, original = (sampled(line, p, 1e-3) if on_samples else p for p in (fast, line_plan))
    assert check(line, line_limits, original).ok
    report = check(line, line_limits, plan)
    assert not report.ok
    assert report.row("jerk", "X").ratio == pytest.approx(k**3, rel=1e-6)
    assert report.row("acceleration", "Y").ratio == pytest.approx(k**2, rel=1e-6)
    assert report.row("feed").ratio == pytest.approx(k, rel=1e-9)
    wanted = {(name, axis) for name in AXIS_LIMITS for axis in "XY"}
    wanted |= {(name, "") for name in ("feed", "tangential acceleration", "tangential jerk")}
    assert failing(report) == wanted


@settings(max_examples=8, deadline=None, derandomize=True)
@given(k=st.floats(0.2, 5.0))
def test_scaling_time_scales_the_ratios(k):
    curve = load_curve("circle")
    motion = scurve(curve.length, 80.0, 500.0, 8000.0, 8)
    t, u, rate, second = lift(curve, with_lengths(motion, curve.arclength.s(curve._candidate_breaks())))
    limits = Limits(90.0, [70.0] * 2, [400.0] * 2, [7000.0] * 2, np.inf, 1e-3, 450.0, 9000.0)
    plans = [profile_on(curve, limits, nodes) for nodes in ((t, u, rate, second), (t * k, u, rate / k, second / k**2))]
    pairs = [
        [check(curve, limits, plan) for plan in plans],
        [check(curve, limits, sampled(curve, p, T)) for p, T in zip(plans, (4e-3, 4e-3 * k), strict=True)],
    ]
    for before, after in pairs:
        for order, name in enumerate(AXIS_LIMITS, start=1):
            for axis in "XY":
                expected = before.row(name, axis).ratio / k**order
                assert after.row(name, axis).ratio == pytest.approx(expected, rel=1e-6)
        assert after.row("feed").ratio == pytest.approx(before.row("feed").ratio / k, rel=1e-9)
        assert after.row("tangential jerk").ratio == pytest.approx(before.row("tangential jerk").ratio / k**3, rel=1e-5)


def test_a_peak_between_the_points_of_a_coarse_look_is_found():
    """A narrow bump crossed at a constant rate: y = h exp(-z^2), z = (u - c)/w, |y'''| = h/w^3 |H_3(z)| exp(-z^2).

    It is largest where the Hermite polynomial H_4 = 16 z^4 - 48 z^2 + 12 has its smallest root; six points an interval
    see less than a tenth of it.
    """
    height, width, centre = 1e-3, 0.02, 0.25
    curve = FormulaCurve({"X": "100*u", "Y": f"{height}*exp(-((u-{centre})/{width})**2)"}, (0.0, 1.0), name="bump")
    t = np.array([0.0, 0.5, 1.0])
    z = np.sqrt((48.0 - np.sqrt(48.0**2 - 4.0 * 16.0 * 12.0)) / 32.0)
    highest = height / width**3 * abs(8.0 * z**3 - 12.0 * z) * np.exp(-(z**2))
    seen = np.abs(curve.derivatives(np.linspace(0.0, 1.0, 11), 3)[3, :, 1]).max()
    assert seen < 0.1 * highest
    for factor, found in ((1.0 - 1e-4, {("jerk", "Y")}), (1.0 + 1e-4, set())):
        limits = unlimited(jerk=[np.inf, factor * highest])
        report = check(curve, limits, profile_on(curve, limits, (t, t, np.ones(3), np.zeros(3))))
        assert failing(report) == found
        row = report.row("jerk", "Y")
        assert row.worst == pytest.approx(highest, rel=1e-9)
        assert abs(row.u - centre) == pytest.approx(width * z, rel=1e-3)
