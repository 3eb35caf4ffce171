"""The check against closed forms, against brute force, and against plans with one planted defect."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.errors import InputError
from planner.geometry.catalog import load_curve
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.limits import Limits
from planner.profile import Samples, make_profile

# planner.check is the function, not the package of the same name, so modules are asked for by name.
package = importlib.import_module("planner.check")
searching = importlib.import_module("planner.check.peaks")
check = package.check

AXIS_LIMITS = ("velocity", "acceleration", "jerk")
SINGLE_LIMITS = ("feed", "chord error", "tangential acceleration", "tangential jerk")
ELLIPSE = (40.0, 25.0)


# ---- plans with a known motion -------------------------------------------------------------------------------------


def scurve(length, feed, acceleration, jerk, parts=1):
    """Nodes (t, s, v, a) of the seven constant-jerk phases from rest to rest, each cut into equal parts."""
    rise = acceleration / jerk
    hold = feed / acceleration - rise
    cruise = length / feed - (feed / acceleration + rise)
    assert hold > 0.0
    assert cruise > 0.0
    phases = [(rise, jerk), (hold, 0.0), (rise, -jerk), (cruise, 0.0), (rise, -jerk), (hold, 0.0), (rise, jerk)]
    rows = [(0.0, 0.0, 0.0, 0.0)]
    for duration, j in phases:
        t, s, v, a = rows[-1]
        for w in duration * np.arange(1, parts + 1) / parts:
            rows.append((t + w, s + v * w + a * w**2 / 2 + j * w**3 / 6, v + a * w + j * w**2 / 2, a + j * w))
    nodes = np.array(rows).T
    nodes[1:, -1] = length, 0.0, 0.0
    return nodes


def constant_feed(curve, feed, count):
    """Nodes (t, s, v, a) at constant feed, the knots of the curve among them."""
    s = np.linspace(0.0, curve.length, count + 1)
    knots = curve.arclength.s(curve._candidate_breaks())
    apart = np.abs(s[:, None] - knots).min(axis=1) if knots.size else np.full(s.size, np.inf)
    s = np.union1d(s[apart > 1e-9 * curve.length], knots)
    return np.stack([s / feed, s, np.full(s.size, feed), np.zeros(s.size)])


def lift(curve, motion, double=True):
    """Nodes (t, u, u_rate, u_acceleration) on a curve from nodes along its length; double ones at its knots."""
    t, s, v, a = motion
    u, knots = curve.arclength.u(s), curve._candidate_breaks()
    on_knot = np.zeros(u.size, dtype=bool)
    if knots.size:
        distance = np.abs(u[:, None] - knots)
        on_knot = distance.min(axis=1) < 1e-9
        u[on_knot] = knots[distance.argmin(axis=1)[on_knot]]
    i = np.repeat(np.arange(u.size), np.where(on_knot & double, 2, 1))
    before = np.append(i[1:] == i[:-1], False)
    d = np.where(before[:, None], curve.tip.derivatives(u[i], 2, side="left"), curve.tip.derivatives(u[i], 2))
    speed2 = np.sum(d[1] ** 2, axis=-1)
    bend = np.sum(d[1] * d[2], axis=-1)
    return t[i], u[i], v[i] / np.sqrt(speed2), a[i] / np.sqrt(speed2) - v[i] ** 2 * bend / speed2**2


def profile_on(curve, limits, nodes):
    return make_profile(curve, limits, nodes, method="test")


def nodes_of(profile):
    return [np.array(column) for column in (profile.t, profile.u, profile.u_rate, profile.u_acceleration)]


def sampled(curve, profile, period):
    """One point a period of the plan itself; the end point fills the last period."""
    count = int(np.ceil(profile.duration / period - 1e-9))
    t = np.arange(count + 1) * period
    u = profile.at(np.minimum(t, profile.duration)).u
    return Samples(period, t, u, curve.derivatives(u, 0)[0])


def unlimited(dim=2, **given_limits):
    free = [np.inf] * dim
    return Limits(**({"feed": np.inf, "velocity": free, "acceleration": free, "jerk": free} | given_limits))


def limits_at(report):
    """Limits that a plan in X and Y uses up exactly, by its own report."""
    rows = {name: [report.row(name, axis).worst for axis in "XY"] for name in AXIS_LIMITS}
    single = {name.replace(" ", "_"): report.row(name).worst for name in SINGLE_LIMITS}
    return Limits(**rows, **single)


def lowered(limits, name, axis_index, factor):
    key = name.replace(" ", "_")
    value = np.array(getattr(limits, key), dtype=float)
    if axis_index is None:
        value = float(value * factor)
    else:
        value[axis_index] *= factor
    return limits._replace(**{key: value})


def failing(report):
    return {(row.limit, row.axis) for row in report.violations}


@pytest.fixture(scope="module")
def line():
    return NurbsCurve([[0.0, 0.0], [60.0, 80.0]], [0, 0, 1, 1], 1, name="line")


@pytest.fixture(scope="module")
def line_limits():
    return Limits(100.0, [60.0, 80.0], [600.0, 800.0], [12000.0, 16000.0], 1e-3, 1e-3, 1000.0, 20000.0)


@pytest.fixture(scope="module")
def line_plan(line, line_limits):
    t, s, v, a = scurve(100.0, 100.0, 1000.0, 20000.0)
    return profile_on(line, line_limits, (t, s / 100.0, v / 100.0, a / 100.0))


@pytest.fixture(scope="module")
def circle():
    return load_curve("circle")


@pytest.fixture(scope="module")
def ellipse():
    return FormulaCurve({"X": "40*cos(u)", "Y": "25*sin(u)"}, (0.0, 2.0 * np.pi), name="ellipse")


@pytest.fixture(scope="module")
def ellipse_plan(ellipse):
    motion = scurve(ellipse.length, 120.0, 900.0, 15000.0, 60)
    return profile_on(ellipse, unlimited(), lift(ellipse, motion))


@pytest.fixture(scope="module")
def ellipse_samples(ellipse, ellipse_plan):
    return sampled(ellipse, ellipse_plan, 1e-3)


@pytest.fixture(scope="module")
def used_up(ellipse, ellipse_plan, ellipse_samples):
    """Limits that the plan on the ellipse, and its samples, use up exactly; they hold."""
    limits = {}
    for kind, plan in (("profile", ellipse_plan), ("samples", ellipse_samples)):
        limits[kind] = limits_at(check(ellipse, unlimited(), plan))
        assert check(ellipse, limits[kind], plan).ok
    return limits


# ---- closed forms --------------------------------------------------------------------------------------------------


def test_scurve_on_a_line_uses_each_limit_exactly(line, line_limits, line_plan):
    report = check(line, line_limits, line_plan)
    assert report.ok
    assert report.violations == ()
    for axis, share in (("X", 0.6), ("Y", 0.8)):
        for name, top in zip(AXIS_LIMITS, (100.0, 1000.0, 20000.0), strict=True):
            assert report.row(name, axis).worst == pytest.approx(share * top, rel=1e-12)
            assert report.row(name, axis).ratio == pytest.approx(1.0, rel=1e-12)
            assert report.row(name, axis).unit == ("mm/s", "mm/s^2", "mm/s^3")[AXIS_LIMITS.index(name)]
    for name in ("feed", "tangential acceleration", "tangential jerk"):
        assert report.row(name).ratio == pytest.approx(1.0, rel=1e-12)
    assert report.row("chord error").worst < 1e-13
    assert report.start_feed == report.end_feed == 0.0


def test_samples_of_an_scurve_on_a_line_reach_but_never_exceed_it(line, line_limits, line_plan):
    # 50 ms of constant jerk hold many periods, so the differences reach the limits, whatever the phase.
    for period in (1e-3, 0.73e-3):
        report = check(line, line_limits, sampled(line, line_plan, period))
        assert report.ok
        for name in AXIS_LIMITS:
            for axis in "XY":
                assert report.row(name, axis).ratio == pytest.approx(1.0, rel=1e-6)
        assert report.row("tangential jerk").ratio == pytest.approx(1.0, rel=1e-6)
        assert report.row("feed").ratio == pytest.approx(1.0, rel=1e-9)


def test_circle_at_constant_feed(circle):
    v, radius = 100.0, 50.0
    limits = Limits(v, [v] * 2, [v**2 / radius] * 2, [v**3 / radius**2] * 2, period=2e-3)
    profile = profile_on(circle, limits, lift(circle, constant_feed(circle, v, 1000)))
    report = check(circle, limits, profile)
    assert report.ok
    for axis in "XY":
        assert report.row("velocity", axis).worst == pytest.approx(v, rel=1e-11)
        assert report.row("acceleration", axis).worst == pytest.approx(v**2 / radius, rel=1e-9)
        assert report.row("jerk", axis).worst == pytest.approx(v**3 / radius**2, rel=1e-6)
        assert report.row("acceleration step", axis).worst < 1e-7
    half = radius * np.sin(0.5 * v * limits.period / radius)
    assert report.row("chord error").worst == pytest.approx(radius - np.sqrt(radius**2 - half**2), rel=1e-9)
    assert report.row("tangential acceleration").worst < 1e-6
    assert report.start_feed == pytest.approx(v)
    assert report.end_feed == pytest.approx(v)


def test_circle_of_samples_at_constant_feed(circle):
    """A plan that starts and ends at speed: inside, the differences are those of a circle of known radius."""
    v, radius, count = 100.0, 50.0, 1000
    period = circle.length / v / count
    profile = profile_on(circle, unlimited(), lift(circle, constant_feed(circle, v, 1000)))
    samples = sampled(circle, profile, period)
    report = check(circle, unlimited(), samples)
    half = radius * np.sin(np.pi / count)
    assert report.row("feed").worst == pytest.approx(2.0 * half / period, rel=1e-10)
    assert report.row("chord error").worst == pytest.approx(radius - np.sqrt(radius**2 - half**2), rel=1e-8)
    assert report.start_feed == pytest.approx(v, rel=1e-5)
    # From a point that is held, the first period at speed v is an acceleration of v / T and a jerk of v / T^2.
    assert report.row("acceleration", "Y").worst == pytest.approx(v / period, rel=1e-4)
    assert report.row("jerk", "Y").worst == pytest.approx(v / period**2, rel=1e-2)


def test_ramp_on_a_circle_has_the_jerk_of_the_closed_form(circle):
    """On a circle s''' = j adds to -v^3/R^2 along the path, and 3 v a / R across it."""
    radius, limits = 50.0, unlimited()
    motion = scurve(circle.length, 80.0, 500.0, 8000.0, 120)
    t, s, v, a = motion
    knots = circle.arclength.s(circle._candidate_breaks())
    report = check(circle, limits, profile_on(circle, limits, lift(circle, with_lengths(motion, knots))))
    # dense closed form over the phases
    best = np.zeros((2, 2))
    for k in range(t.size - 1):
        j = (a[k + 1] - a[k]) / (t[k + 1] - t[k])
        w = np.linspace(0.0, t[k + 1] - t[k], 200)
        sk, vk, ak = s[k] + v[k] * w + a[k] * w**2 / 2 + j * w**3 / 6, v[k] + a[k] * w + j * w**2 / 2, a[k] + j * w
        angle = sk / radius
        along, across = np.stack([-np.sin(angle), np.cos(angle)]), np.stack([-np.cos(angle), -np.sin(angle)])
        best[0] = np.maximum(best[0], np.abs(ak * along + vk**2 / radius * across).max(axis=1))
        jerk = (j - vk**3 / radius**2) * along + 3.0 * vk * ak / radius * across
        best[1] = np.maximum(best[1], np.abs(jerk).max(axis=1))
    for j, axis in enumerate("XY"):
        assert report.row("acceleration", axis).worst == pytest.approx(best[0, j], rel=1e-5)
        assert report.row("jerk", axis).worst == pytest.approx(best[1, j], rel=1e-5)
    assert report.row("tangential jerk").worst == pytest.approx(8000.0, rel=1e-4)


def with_lengths(motion, lengths):
    """The same constant-jerk motion with nodes at further places."""
    t, s, v, a = motion
    extra = []
    for length in lengths:
        if np.abs(s - length).min() < 1e-9:
            continue
        k = int(np.searchsorted(s, length)) - 1
        j = (a[k + 1] - a[k]) / (t[k + 1] - t[k])
        roots = np.roots([j / 6, a[k] / 2, v[k], s[k] - length]) if abs(j) > 1e-9 else None
        w = (length - s[k]) / v[k] if roots is None else roots[np.argmin(abs(roots - (length - s[k]) / v[k]))].real
        extra.append((t[k] + w, length, v[k] + a[k] * w + j * w**2 / 2, a[k] + j * w))
    merged = np.concatenate([motion, np.array(extra).T.reshape(4, -1)], axis=1)
    return merged[:, np.argsort(merged[0])]


def test_limits_that_are_absent_are_measured_all_the_same(ellipse, ellipse_plan):
    for plan in (ellipse_plan, sampled(ellipse, ellipse_plan, 1e-3)):
        report = check(ellipse, unlimited(), plan)
        assert report.ok
        for name in SINGLE_LIMITS:
            assert report.row(name).ratio == 0.0
            assert report.row(name).worst > 0.0
        for name in AXIS_LIMITS:
            assert report.row(name, "X").worst > 0.0


# ---- the reported worst does not depend on how it is looked for ----------------------------------------------------


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
            assert other.worst == pytest.approx(first.worst, rel=1e-9)


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


# ---- one planted violation a limit ---------------------------------------------------------------------------------

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


# ---- planted defects of the table ----------------------------------------------------------------------------------


def test_a_rate_beyond_double_precision_fails(ellipse, ellipse_plan, used_up):
    """The cube of u' overflows: the jerk there is no number, its rounding neither, and it is beyond every limit."""
    rate = ellipse_plan.u_rate.copy()
    rate[200] = 1e120
    report = check(ellipse, used_up["profile"], dataclasses.replace(ellipse_plan, u_rate=rate))
    for axis in "XY":
        row = report.row("jerk", axis)
        assert not row.ok
        assert ellipse_plan.t[199] <= row.t <= ellipse_plan.t[201]
    assert not report.row("tangential jerk").ok


@pytest.mark.parametrize(("column", "size"), [(1, 1e-7), (2, 1e-4), (3, 5e-2)])
def test_one_bad_node_is_found_where_it_is(ellipse, ellipse_plan, used_up, column, size):
    used = used_up["profile"]
    generous = used._replace(jerk=used.jerk * 1.05, tangential_jerk=used.tangential_jerk * 1.05)
    assert check(ellipse, generous, ellipse_plan).ok
    nodes, k = nodes_of(ellipse_plan), 150
    nodes[column][k] += size * nodes[column][k]
    report = check(ellipse, generous, profile_on(ellipse, generous, nodes))
    rows = [row for row in report.violations if row.limit == "jerk"]
    assert rows
    for row in rows:
        assert nodes[0][k - 1] <= row.t <= nodes[0][k + 1]
        assert nodes[1][k - 1] <= row.u <= nodes[1][k + 1]


def test_one_bad_sample_is_found_where_it_is(ellipse, ellipse_samples, used_up):
    samples, used = ellipse_samples, used_up["samples"]
    k, error = 400, 2e-5
    position = samples.position.copy()
    position[k, 1] += error
    report = check(ellipse, used, Samples(1e-3, samples.t, samples.u, position))
    assert ("path error", "Y") in failing(report)
    assert report.row("path error", "Y").worst == pytest.approx(error, rel=1e-6)
    assert report.row("path error", "Y").t == samples.t[k]
    assert report.row("path error", "X").ok
    row = report.row("jerk", "Y")
    assert not row.ok
    assert abs(row.t - samples.t[k]) <= 1.5e-3 + 1e-12
    assert samples.u[k - 2] <= row.u <= samples.u[k + 2]
    # 3 e / T^3, on top of what the plan has there
    assert row.worst == pytest.approx(3.0 * error / 1e-9, rel=0.3)


def far_samples(off, along=0.0):
    """A line of 1e7 mm over u = -67.000001 .. -67, one sample moved across and along it; a digit is 0.14 mm."""
    curve = NurbsCurve([[0.0, 0.0], [8e6, 6e6]], [-67.000001, -67.000001, -67.0, -67.0], 1)
    u = np.linspace(*curve.domain, 101)
    position = curve.derivatives(u, 0)[0]
    position[50] += off * np.array([-0.6, 0.8]) + along * np.array([0.8, 0.6])
    return curve, Samples(1e-3, 1e-3 * np.arange(101), u, position)


@pytest.mark.parametrize(
    ("off", "along", "holds"), [(0.0, 0.05, True), (0.0, -0.1, True), (0.0, 0.3, False), (0.05, 0.0, False)]
)
def test_a_position_between_two_doubles_of_u_is_on_the_path(off, along, holds):
    curve, samples = far_samples(off, along)
    inf = [np.inf, np.inf]
    report = check(curve, Limits(np.inf, inf, inf, inf), samples)
    assert all(report.row("path error", axis).ok for axis in "XY") is holds


def test_a_velocity_step_is_a_violation(ellipse, ellipse_plan):
    k, share = 200, 1e-6
    t, u, rate, second = nodes_of(ellipse_plan)
    nodes = [np.insert(column, k, column[k]) for column in (t, u, rate, second)]
    nodes[2][k + 1] *= 1.0 + share
    report = check(ellipse, unlimited(), profile_on(ellipse, unlimited(), nodes))
    slope = np.array([-ELLIPSE[0] * np.sin(u[k]), ELLIPSE[1] * np.cos(u[k])])
    for j, axis in enumerate("XY"):
        row = report.row("velocity step", axis)
        assert not row.ok
        assert row.worst == pytest.approx(abs(slope[j] * rate[k] * share), rel=1e-6)
        assert (row.t, row.u) == (t[k], u[k])
        assert row.ratio == np.inf
    assert check(ellipse, unlimited(), ellipse_plan).row("velocity step", "X").ok


def test_a_knot_crossed_between_nodes_is_looked_at_from_both_sides(circle):
    """At a constant rate of u the circle's axis acceleration jumps at u = 0.5, where C'' does; no node is near."""
    t = np.array([0.0, 1.3, 3.0])
    nodes = (t, t / 3.0, np.full(3, 1.0 / 3.0), np.zeros(3))
    limits = unlimited(jerk=[1e5] * 2, period=2e-3)
    report = check(circle, limits, profile_on(circle, limits, nodes))
    sides = [circle.derivatives(0.5, 3, side=side) for side in ("left", "right")]
    jump = np.abs(sides[1][2] - sides[0][2]) / 9.0
    axis = "XY"[int(jump.argmax())]
    row = report.row("acceleration step", axis)
    assert row.worst == pytest.approx(jump.max(), rel=1e-9)
    assert row.t == pytest.approx(1.5, abs=1e-12)
    assert row.u == 0.5
    sampled_row = report.row("jerk at a curvature break", axis)
    assert sampled_row.worst >= 0.75 * jump.max() / 2e-3
    assert sampled_row.t == pytest.approx(1.5, abs=1e-12)


def test_constant_acceleration_from_rest_is_a_step_of_it(line):
    """Trapezoidal speed: D = a at both ends and at the corners of the trapezoid; sampled 0.75 a / T."""
    a, v = 1000.0, 100.0
    t = np.array([0.0, 0.1, 0.1, 1.0, 1.0, 1.1])
    s = np.array([0.0, 5.0, 5.0, 95.0, 95.0, 100.0])
    second = np.array([a, a, 0.0, 0.0, -a, -a])
    nodes = (t, s / 100.0, np.array([0.0, v, v, v, v, 0.0]) / 100.0, second / 100.0)
    for period in (1e-3, 0.4e-3):
        limits = unlimited(jerk=[1e9] * 2, period=period)
        profile = profile_on(line, limits, nodes)
        report = check(line, limits, profile)
        for axis, share in (("X", 0.6), ("Y", 0.8)):
            assert report.row("jerk", axis).worst < 1e-6
            assert report.row("acceleration step", axis).worst == pytest.approx(share * a, rel=1e-12)
            assert report.row("jerk at a curvature break", axis).worst == pytest.approx(0.75 * share * a / period)
            assert report.row("jerk at a curvature break", axis).t in {0.0, 0.1, 1.0, 1.1}
            # With no jerk besides, the step is to its limit as its sampled jerk is to the jerk limit.
            jerk_share = report.row("jerk at a curvature break", axis).ratio
            assert report.row("acceleration step", axis).ratio == pytest.approx(jerk_share, rel=1e-9)
        assert report.start_acceleration == pytest.approx(a)
        # The samples, at the worst phase of each step, see just that; at others less.
        jerk = max_sampled_jerk(line, profile, period)
        assert jerk[0] == pytest.approx(0.75 * 600.0 / period, rel=1e-3)


def test_an_acceleration_where_the_point_is_held_is_a_step(line):
    """From rest, a falls linearly from a to -a: nothing jumps on the way, but both ends are held points."""
    a, period = 1000.0, 1e-3
    duration = np.sqrt(6.0 * 100.0 / a)
    nodes = (np.array([0.0, duration]), np.array([0.0, 1.0]), np.zeros(2), np.array([a, -a]) / 100.0)
    limits = unlimited(jerk=[1e9] * 2, period=period)
    report = check(line, limits, profile_on(line, limits, nodes))
    for axis, share in (("X", 0.6), ("Y", 0.8)):
        row = report.row("jerk at a curvature break", axis)
        assert row.worst == pytest.approx(share * (0.75 * a / period + 2.0 * a / duration), rel=1e-9)
        assert row.t in {0.0, duration}
    assert report.start_acceleration == pytest.approx(a)
    assert report.end_acceleration == pytest.approx(-a)
    # Beginning and ending at speed, the same acceleration continues what came before.
    moving = (nodes[0], nodes[1], np.full(2, 1.0 / duration), np.full(2, 5.0))
    report = check(line, limits, profile_on(line, limits, moving))
    assert report.row("acceleration step", "X").worst == 0.0


def max_sampled_jerk(curve, profile, period, phases=64):
    """Largest third difference over T^3 of each axis over many phases of the sampling, both ends held."""
    best = np.zeros(curve.dim)
    count = int(np.ceil(profile.duration / period)) + 6
    for phase in np.arange(phases) / phases:
        t = np.clip((np.arange(count) - 3 + phase) * period, 0.0, profile.duration)
        q = curve.derivatives(profile.at(t).u, 0)[0]
        best = np.maximum(best, np.abs(np.diff(q, 3, axis=0)).max(axis=0) / period**3)
    return best


# ---- corners and curvature breaks ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def corner():
    return NurbsCurve([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]], [0.0, 0.0, 0.5, 1.0, 1.0], 1, name="corner")


def two_legs(motion):
    """The same motion on either leg of the corner."""
    t, s, v, a = motion
    return tuple(
        np.concatenate(parts) / scale
        for parts, scale in (((t, t + t[-1]), 1.0), ((s, s + 50.0), 100.0), ((v, v), 100.0), ((a, a), 100.0))
    )


CORNER_LIMITS = Limits(100.0, [100.0] * 2, [1000.0] * 2, [20000.0] * 2)


def test_stopping_at_a_corner_passes(corner):
    report = check(corner, CORNER_LIMITS, profile_on(corner, CORNER_LIMITS, two_legs(scurve(50.0, 100, 1000, 20000))))
    assert report.ok
    assert report.row("exact stop").worst == 0.0
    assert report.row("acceleration at an exact stop").worst == 0.0


@pytest.mark.parametrize("node_at_corner", [True, False])
def test_a_corner_passed_at_speed_fails(corner, node_at_corner):
    """At constant feed, with a node at the corner and without."""
    s = np.array([0.0, 50.0, 100.0]) if node_at_corner else np.array([0.0, 20.0, 70.0, 100.0])
    v = 20.0
    nodes = (s / v, s / 100.0, np.full(s.size, v / 100.0), np.zeros(s.size))
    report = check(corner, CORNER_LIMITS, profile_on(corner, CORNER_LIMITS, nodes))
    assert {("exact stop", ""), ("velocity step", "X"), ("velocity step", "Y")} <= failing(report)
    row = report.row("exact stop")
    assert row.worst == pytest.approx(v, rel=1e-9)
    assert row.t == pytest.approx(50.0 / v, rel=1e-12)
    assert row.u == 0.5
    assert report.row("velocity step", "X").worst == pytest.approx(v, rel=1e-9)


def test_a_corner_reached_with_acceleration_fails(corner):
    a = 400.0
    half = np.sqrt(50.0 / a)
    t = np.array([0.0, half, half, 2 * half])
    s, v = np.array([0.0, 25.0, 25.0, 50.0]), np.array([0.0, a * half, a * half, 0.0])
    nodes = two_legs((t, s, v, np.array([a, a, -a, -a])))
    # Without a jerk limit a stop may be left at full acceleration.  A jerk limit of 1e9 mm/s^3 the samples of this plan
    # keep, but no jerk is large enough for its steps: at the stop, and where either leg turns from speeding up to braking.
    limits = unlimited(acceleration=[1000.0] * 2, jerk=[1e9] * 2)
    assert check(corner, limits._replace(jerk=[np.inf] * 2), profile_on(corner, unlimited(), nodes)).ok
    report = check(corner, limits, profile_on(corner, unlimited(), nodes))
    smooth = "step on a smooth path"
    assert failing(report) == {("acceleration at an exact stop", ""), (smooth, "X"), (smooth, "Y")}
    assert report.row(smooth, "X").worst == pytest.approx(2.0 * a)
    assert report.row(smooth, "X").t == pytest.approx(half)
    row = report.row("acceleration at an exact stop")
    assert row.worst == pytest.approx(a)
    assert row.t == pytest.approx(2 * half)
    assert row.u == 0.5


RADIUS = 20.0


@pytest.fixture(scope="module")
def line_arc():
    """A straight segment of 40 mm, then a quarter circle: the curvature jumps from 0 to 1/R."""
    points = [[0.0, 0.0], [20.0, 0.0], [40.0, 0.0], [40.0 + RADIUS, 0.0], [40.0 + RADIUS, RADIUS]]
    weights = [1.0, 1.0, 1.0, np.sqrt(0.5), 1.0]
    return NurbsCurve(points, [0, 0, 0, 0.5, 0.5, 1, 1, 1], 2, weights, name="line and arc")


def test_curvature_break_at_constant_feed(line_arc):
    """D = v^2/R across the path; nearby the jerk is v^3/R^2 along it, turned by up to 3 v T / R."""
    (bend,) = line_arc.breaks
    assert bend.geometric == 1
    v, period = 30.0, 1e-3
    step, jerk = v**2 / RADIUS, v**3 / RADIUS**2
    expected = 0.75 * step / period + jerk * np.sin(3.0 * v * period / RADIUS)
    nodes = lift(line_arc, constant_feed(line_arc, v, 400))
    reports = {}
    for factor in (1.0 - 1e-5, 1.0 + 1e-5):
        limits = unlimited(jerk=[expected, expected * factor], period=period)
        reports[factor] = check(line_arc, limits, profile_on(line_arc, limits, nodes))
    assert reports[1.0 + 1e-5].ok
    assert failing(reports[1.0 - 1e-5]) == {("jerk at a curvature break", "Y")}
    report = reports[1.0 - 1e-5]
    row = report.row("jerk at a curvature break", "Y")
    assert row.worst == pytest.approx(expected, rel=1e-6)
    assert row.t == pytest.approx(40.0 / v, abs=1e-12)
    assert row.u == 0.5
    assert report.row("jerk at a curvature break", "X").worst == pytest.approx(jerk, rel=1e-5)
    assert report.row("acceleration step", "Y").worst == pytest.approx(step, rel=1e-9)
    # Samples of that plan, away from its ends: at the worst phase the step shows, and never more than that.
    seen = 0.0
    for phase in np.arange(100) / 100:
        t = 40.0 / v + (np.arange(9) - 4 + phase) * period
        q = line_arc.derivatives(profile_on(line_arc, limits, nodes).at(t).u, 0)[0]
        seen = max(seen, np.abs(np.diff(q[:, 1], 3)).max() / period**3)
    assert 0.75 * step / period * (1 - 1e-3) < seen <= row.worst


def test_curvature_breaks_close_together_add_up():
    """y'' rises in three steps that are passed within one and a half periods: they reach the drive nearly as one.

    With knots k_m the curve is y = sum_m c_m (x - k_m)_+^2 / 2, x = u; the control points of a quadratic spline are its
    polar form at two consecutive knots k', k'', here sum_m c_m (k' - k_m)_+ (k'' - k_m)_+ / 2.
    """
    feed, period = 20.0, 1e-3
    at = 8.0 + feed * period * np.array([0.0, 0.5, 1.4])
    bends = np.array([0.010, 0.008, 0.012])
    knots = np.concatenate([[0.0] * 3, at, [16.0] * 3])
    pairs = np.maximum(knots[1:-2, None] - at, 0.0) * np.maximum(knots[2:-1, None] - at, 0.0)
    points = np.stack([(knots[1:-2] + knots[2:-1]) / 2.0, pairs @ bends / 2.0], axis=1)
    curve = NurbsCurve(points, knots, 2, name="close knots")
    limits = unlimited(jerk=[1e6] * 2, period=period)
    profile = profile_on(curve, limits, lift(curve, constant_feed(curve, feed, 300)))
    report = check(curve, limits, profile)
    t = at[1] / feed + (np.arange(-6, 7) + np.arange(400)[:, None] / 400) * period
    q = curve.derivatives(profile.at(t).u, 0)[0][..., 1]
    seen = np.abs(np.diff(q, 3, axis=1)).max() / period**3
    single = 0.75 * report.row("acceleration step", "Y").worst / period
    assert report.row("acceleration step", "Y").worst == pytest.approx(feed**2 * bends.max(), rel=1e-3)
    assert seen > 1.4 * single
    row = report.row("jerk at a curvature break", "Y")
    assert seen <= row.worst
    assert row.worst == pytest.approx(seen, rel=1e-2)


def test_a_node_a_rounding_beside_a_knot_lies_on_it(circle):
    """Inverting the arc length gives the knot but for its last digit; each side still belongs to its own node."""
    v = 100.0
    limits = Limits(v, [v] * 2, [v**2 / 50.0] * 2, [v**3 / 2500.0] * 2)
    for beside in (-np.inf, np.inf):
        nodes = lift(circle, constant_feed(circle, v, 1000))
        nodes[1][nodes[1] == 0.5] = np.nextafter(0.5, beside)
        report = check(circle, limits, profile_on(circle, limits, nodes))
        assert report.ok
        assert max(report.row("acceleration step", axis).worst for axis in "XY") < 1e-6


# ---- what belongs together -----------------------------------------------------------------------------------------


def test_a_plan_for_another_curve_is_refused(line, line_limits, line_plan, circle):
    with pytest.raises(InputError, match=r"made for another curve: line .* not circle"):
        check(circle, line_limits, line_plan)
    twin = NurbsCurve([[0.0, 0.0], [60.0, 80.0]], [0, 0, 1, 1], 1, name="the same line under another name")
    assert check(twin, line_limits, line_plan).ok


def test_arguments_are_validated(line, line_limits, line_plan):
    three = Limits(1.0, [1.0] * 3, [1.0] * 3, [1.0] * 3)
    with pytest.raises(InputError, match="3 axes"):
        check(line, three, line_plan)
    for density in (3, 2.5, True):
        with pytest.raises(InputError, match="density"):
            check(line, line_limits, line_plan, density=density)
    for tolerance in (-1e-9, np.nan, np.inf):
        with pytest.raises(InputError, match="tolerance"):
            check(line, line_limits, line_plan, tolerance=tolerance)
    with pytest.raises(InputError, match="dict"):
        check(line, line_limits, {})
    samples = sampled(line, line_plan, 1e-3)
    with pytest.raises(InputError, match=r"shape \(1151, 3\)"):
        check(line, line_limits, Samples(1e-3, samples.t, samples.u, np.zeros((samples.t.size, 3))))
    with pytest.raises(InputError, match="m >= 2"):
        check(line, line_limits, Samples(1e-3, samples.t[:1], samples.u[:1], samples.position[:1]))
    with pytest.raises(InputError, match="period = 0"):
        check(line, line_limits, Samples(0.0, samples.t, samples.u, samples.position))
    with pytest.raises(InputError, match="must be one-dimensional, equal"):
        check(line, line_limits, dataclasses.replace(line_plan, u=line_plan.u[1:]))
    with pytest.raises(InputError, match='no row "jerk" for the axis "Z"'):
        check(line, line_limits, line_plan).row("jerk", "Z")


@pytest.mark.parametrize(
    ("name", "column", "index", "value"),
    [
        ("finite values", "u_rate", 3, np.nan),
        ("finite values", "t", 0, -np.inf),
        ("time order", "t", 3, 0.05),
        ("time order", "t", 0, -0.01),
        ("path start", "u", 0, 1e-9),
        ("path end", "u", -1, 1.0 - 1e-9),
        ("reversal", "u_rate", 3, -1e-3),
        ("table columns", "s", 4, 90.0),
        ("table columns", "feed", 4, 100.0 * (1 + 1e-8)),
        ("table columns", "acceleration", 4, 1.0),
        ("table columns", "jerk", 4, 1.0),
        ("binding limit", "binding", 4, 2),
        ("binding limit", "binding", 4, -1),
        ("binding limit", "binding", 4, 100),
    ],
)
def test_a_defective_table_is_found(line, line_limits, line_plan, name, column, index, value):
    broken = getattr(line_plan, column).copy()
    broken[index] = value
    report = check(line, line_limits, dataclasses.replace(line_plan, **{column: broken}))
    assert (name, "") in failing(report)
    if name in ("table columns", "binding limit"):
        assert failing(report) == {(name, "")}
        assert report.row(name).t == line_plan.t[4]


def test_a_jump_of_position_is_found(ellipse, ellipse_plan):
    k = 100
    nodes = [np.insert(column, k, column[k]) for column in nodes_of(ellipse_plan)]
    nodes[1][k] -= 1e-6
    row = check(ellipse, unlimited(), profile_on(ellipse, unlimited(), nodes)).row("position step")
    assert not row.ok
    assert row.worst == pytest.approx(1e-6 * ellipse.length / (2 * np.pi), rel=1e-6)
    assert row.t == nodes[0][k]


def test_standing_still_on_a_closed_curve_is_not_a_plan(ellipse):
    """Start and end of a closed curve are one point; the whole of the path is still missing."""
    t = np.arange(5) * 1e-3
    still = Samples(1e-3, t, np.zeros(5), ellipse.derivatives(np.zeros(5), 0)[0])
    assert ("path end", "") in failing(check(ellipse, unlimited(), still))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("sample times", lambda s: dataclasses.replace(s, t=s.t + np.where(np.arange(s.t.size) == 7, 1e-9, 0.0))),
        ("sample times", lambda s: dataclasses.replace(s, t=s.t * (1 + 1e-9))),
        ("path end", lambda s: dataclasses.replace(s, t=s.t[:-1], u=s.u[:-1], position=s.position[:-1])),
        ("path end", lambda s: dataclasses.replace(s, position=s.position + np.where(s.u == 1.0, 1e-12, 0.0)[:, None])),
        (
            "path start",
            lambda s: dataclasses.replace(s, position=s.position + np.where(s.u == 0.0, 1e-12, 0.0)[:, None]),
        ),
        ("finite values", lambda s: dataclasses.replace(s, u=np.where(np.arange(s.t.size) == 7, np.nan, s.u))),
        ("reversal", lambda s: dataclasses.replace(s, u=np.where(np.arange(s.t.size) == 600, s.u[598], s.u))),
    ],
)
def test_defective_samples_are_found(line, line_limits, line_plan, name, change):
    # 1.1505 s is no whole number of periods; the end point is reached within the last one.
    samples = sampled(line, line_plan, 1.1e-3)
    assert check(line, line_limits, samples).ok
    assert (name, "") in failing(check(line, line_limits, change(samples)))


def test_rounding_is_granted_and_no_more(line, line_limits, line_plan):
    """At 0.1 ms an error of 8e-12 mm already is a jerk of 8e-12 * 3 / 1e-12 mm/s^3; rounding is far below."""
    samples = sampled(line, line_plan, 1e-4)
    report = check(line, line_limits, samples)
    assert report.ok
    assert 0.0 < report.row("jerk", "X").slack < 0.3
    position = samples.position.copy()
    position[int(0.03 / 1e-4), 0] += 8e-12
    assert ("jerk", "X") in failing(check(line, line_limits, Samples(1e-4, samples.t, samples.u, position)))


def test_nodes_closer_than_double_precision_resolves_are_granted_their_rounding(circle):
    """Nodes a rounding apart: their interval holds any jerk, none of which a machine could see."""
    v = 100.0
    motion = constant_feed(circle, v, 1000)
    s = np.sort(np.append(motion[1], np.nextafter(motion[1, 501], np.inf)))
    t = s / v
    keep = np.append(True, np.diff(t) > 0.0)
    assert np.diff(t[keep]).min() < 1e-15
    nodes = lift(circle, np.stack([t, s, np.full(s.size, v), np.zeros(s.size)])[:, keep])
    limits = Limits(v, [v] * 2, [v**2 / 50.0] * 2, [v**3 / 2500.0 * (1 + 1e-6)] * 2)
    report = check(circle, limits, profile_on(circle, limits, nodes))
    assert report.ok
    assert report.row("acceleration step", "X").slack < 1e-3


def test_the_last_digit_of_the_time_counts_where_that_of_the_parameter_does_not():
    """Near u = 0 a table holds u to any precision, but not the times that belong to it."""
    curve = FormulaCurve({"X": "50*cos(u)", "Y": "50*sin(u)"}, (-np.pi, np.pi))
    close = np.array([-2e-6, -1e-6, 1e-6, 2e-6])
    u = np.concatenate([np.linspace(-np.pi, -0.01, 300), close, np.linspace(0.01, np.pi, 300)])
    limits = Limits(50.0, [50.0] * 2, [50.0] * 2, [50.0] * 2)
    nodes = (u + np.pi, u, np.ones(u.size), np.zeros(u.size))
    profile = profile_on(curve, limits, nodes)
    assert 50.0 * np.abs(profile.at(np.pi + close[:-1] + 1e-7).u_jerk).max() > 1000.0
    report = check(curve, limits, profile)
    assert report.ok
    assert report.row("jerk", "Y").worst == pytest.approx(50.0, rel=1e-6)


# ---- a machine with rotary axes ------------------------------------------------------------------------------------


def test_five_axes_agree_with_finite_differences():
    """Machine axes against differences of the positions; feed and chord on the tool tip."""
    curve = load_curve("flank")
    u0, u1 = curve.domain
    # A smooth law of time, u = u0 + (u1 - u0) w(t / 8 s), w = x - sin(2 pi x) / (2 pi); knots lie between its nodes.
    x = np.linspace(0.0, 1.0, 301)
    scale, total = u1 - u0, 8.0
    u = u0 + scale * (x - np.sin(2 * np.pi * x) / (2 * np.pi))
    u[-1] = u1
    rate = scale * (1.0 - np.cos(2 * np.pi * x)) / total
    nodes = (x * total, u, rate, scale * 2 * np.pi * np.sin(2 * np.pi * x) / total**2)
    limits = unlimited(5, period=4e-3)
    profile = profile_on(curve, limits, nodes)
    report = check(curve, limits, profile)
    h = 1e-3
    t = np.linspace(0.0, total, int(total / h) + 1)
    law = profile.at(t)
    q = curve.derivatives(law.u, 0)[0]
    for order, name in enumerate(AXIS_LIMITS, start=1):
        brute = np.abs(np.diff(q, order, axis=0)).max(axis=0) / h**order
        for j, axis in enumerate("XYZAC"):
            row = report.row(name, axis)
            # A difference is an average, here over at most 3 ms: never above the peak, and little below.
            assert brute[j] <= row.worst * (1 + 1e-6)
            assert row.worst == pytest.approx(brute[j], rel=1e-2)
            assert row.unit.startswith("rad" if axis in "AC" else "mm")
    tip = curve.tip.derivatives(law.u, 0)[0]
    assert report.row("feed").worst == pytest.approx(np.linalg.norm(np.diff(tip, axis=0), axis=1).max() / h, rel=1e-4)
    samples = check(curve, limits, sampled(curve, profile, 4e-3))
    assert samples.row("chord error").worst <= report.row("chord error").worst * (1 + 1e-9)
    assert samples.row("chord error").worst == pytest.approx(report.row("chord error").worst, rel=0.05)
    assert samples.row("feed").worst == pytest.approx(report.row("feed").worst, rel=1e-3)
    s = curve.arclength.s(law.u)
    for order, name in ((2, "tangential acceleration"), (3, "tangential jerk")):
        brute = np.abs(np.diff(s, order)).max() / h**order
        assert report.row(name).worst == pytest.approx(brute, rel=2e-3)


def test_a_rotary_axis_turns_while_the_tip_rests():
    """A turns by 2 rad with the tip at rest, then X moves 10 mm; an exact stop lies between."""
    curve = NurbsCurve(
        [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [10.0, 0.0, 2.0]],
        [0.0, 0.0, 0.5, 1.0, 1.0],
        1,
        axes=("X", "Y", "A"),
        rests_allowed=True,
    )
    t, s, v, a = scurve(0.5, 1.0, 8.0, 100.0)
    nodes = (np.append(t, t + t[-1]), np.append(s, s + 0.5), np.append(v, v), np.append(a, a))
    limits = Limits(20.0, [20.0, 20.0, 4.0], [160.0, 160.0, 32.0], [2000.0, 2000.0, 400.0], 1e-3)
    profile = profile_on(curve, limits, nodes)
    for report in (check(curve, limits, profile), check(curve, limits, sampled(curve, profile, 1e-3))):
        assert report.ok
        for axis in "XA":
            for name in AXIS_LIMITS:
                assert report.row(name, axis).ratio == pytest.approx(1.0, rel=1e-6)
        assert report.row("feed").worst == pytest.approx(20.0, rel=1e-6)
        assert report.row("jerk", "A").unit == "rad/s^3"
    assert check(curve, limits, profile).row("exact stop").t == pytest.approx(t[-1])


def forth_and_back(across=0.0):
    """X runs 10 mm forth and back while A turns; ``across`` makes a turn of its path of the rest of the tip."""
    axes, points = ("X", "A"), [[0.0, 0.0], [20.0, 0.5], [0.0, 1.0]]
    if across:
        axes, points = ("X", "Y", "A"), [[0.0, 0.0, 0.0], [20.0, 0.5 * across, 0.5], [0.0, across, 1.0]]
    return NurbsCurve(points, [0, 0, 0, 1, 1, 1], 2, axes=axes, name="forth and back")


def turning_samples(curve, duration=2.0, period=1e-3):
    """The curve at u = t / duration by minimum-jerk motion from rest to rest."""
    t = np.arange(0.0, duration + 0.5 * period, period)
    w = t / duration
    u = w**4 * (35.0 - w * (84.0 - w * (70.0 - 20.0 * w)))
    return Samples(period, t, u, curve.derivatives(u, 0)[0])


def tangential(curve, samples, acceleration, jerk):
    inf = [np.inf] * curve.dim
    limits = Limits(
        np.inf, inf, inf, inf, tangential_acceleration=acceleration, tangential_jerk=jerk, axes=curve.axes, period=1e-3
    )
    report = check(curve, limits, samples)
    return report.row("tangential acceleration"), report.row("tangential jerk")


def test_where_a_tip_comes_to_rest_and_turns_back_its_length_is_counted_backwards():
    """X alone moves the tip: what is measured along its path is X's own acceleration and jerk, and no more is granted."""
    curve = forth_and_back()
    samples = turning_samples(curve)
    x = np.pad(samples.position[:, 0], 3, mode="edge")
    a, j = (np.abs(np.diff(x, n)).max() / samples.period**n for n in (2, 3))
    for row, size in zip(tangential(curve, samples, 1.001 * a, 1.001 * j), (a, j), strict=True):
        assert row.ok
        assert row.worst == pytest.approx(size, rel=1e-4)
    # the turn is where X accelerates most: a limit below that is broken there
    assert abs(samples.u[np.abs(np.diff(x, 2)).argmax() - 2] - 0.5) < 0.01
    assert not any(row.ok for row in tangential(curve, samples, 0.999 * a, 0.999 * j))


def test_a_tight_turn_is_no_rest():
    """Half a micrometre across: the tip does turn, and its tangential acceleration does change its sign within it."""
    curve = forth_and_back(5e-4)
    samples = turning_samples(curve)
    x = np.pad(samples.position[:, 0], 3, mode="edge")
    jerk = np.abs(np.diff(x, 3)).max() / samples.period**3
    row = tangential(curve, samples, np.inf, 10.0 * jerk)[1]
    assert not row.ok


def test_the_tip_starts_from_rest_in_the_parameter():
    """X = 9 u^2 - 5 u^3 beside a turning axis: p_u = 0 at u = 0, where the tangential acceleration 18 is largest."""
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [3.0, 0.0, 2.0], [4.0, 0.0, 3.0]]
    curve = NurbsCurve(points, [0] * 4 + [1] * 4, 3, axes=("X", "Y", "A"), rests_allowed=True)
    limits = unlimited(3)
    nodes = (np.array([0.0, 0.6, 1.0]), np.array([0.0, 0.6, 1.0]), np.ones(3), np.zeros(3))
    report = check(curve, limits, profile_on(curve, limits, nodes))
    assert report.row("tangential acceleration").worst == pytest.approx(18.0, rel=1e-12)
    assert report.row("tangential acceleration").t == 0.0
    assert report.start_acceleration == pytest.approx(18.0, rel=1e-12)
    assert report.row("tangential jerk").worst == pytest.approx(30.0, rel=1e-9)
    assert report.row("velocity", "A").worst == pytest.approx(3.0, rel=1e-12)


# ---- the report ----------------------------------------------------------------------------------------------------


def test_report_reads_as_a_table(line, line_limits, line_plan):
    good = str(check(line, line_limits, line_plan))
    assert good.startswith("every limit holds")
    assert "FAILS" not in good
    slow = lowered(line_limits, "jerk", 1, 0.5)
    bad = str(check(line, slow, line_plan))
    assert bad.startswith("1 of ")
    (marked,) = [text for text in bad.splitlines() if text.startswith("FAILS")]
    assert "jerk Y" in marked
    assert "mm/s^3" in marked


def test_report_and_rows_are_frozen(line, line_limits, line_plan):
    report = check(line, line_limits, line_plan)
    with pytest.raises(dataclasses.FrozenInstanceError):
        report.rows = ()
    with pytest.raises(dataclasses.FrozenInstanceError):
        report.rows[0].worst = 0.0
    keys = [(row.limit, row.axis) for row in report.rows]
    assert len(keys) == len(set(keys))


def test_the_check_knows_nothing_of_the_planner():
    files = sorted(Path(inspect.getfile(package)).parent.rglob("*.py"))
    assert {"__init__", "chords", "motion", "profile", "report", "samples"} <= {file.stem for file in files}
    nodes = [node for file in files for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))]
    imported = {
        f"{node.module}.{name.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for name in node.names
        if node.level > 0 or (node.module or "").startswith("planner")
    }
    assert {name for name in imported if not name.startswith("planner.check.")} == {
        "planner.certificate.Certificate",
        "planner.certificate.CertificateSection",
        "planner.errors.InputError",
        "planner.geometry.curve.Curve",
        "planner.geometry.curve.FeedCaps",
        "planner.geometry.curve.FloatArray",
        "planner.geometry.curve.curvature",
        *(f"planner.geometry.kernels.{name}" for name in ("FLAG", "I64", "NOTHING", "find_piece")),
        *(f"planner.geometry.kernels.{access}{n}" for access in ("READ", "WRITE") for n in (1, 2, 3)),
        "planner.limits.Limits",
        "planner.profile.FeedrateProfile",
        "planner.profile.Samples",
    }
    assert not [node for node in nodes if isinstance(node, ast.Import) and "planner" in ast.dump(node)]


def test_types_are_what_they_say(line, line_limits, line_plan):
    for row in check(line, line_limits, line_plan).rows:
        for field in ("worst", "allowed", "ratio", "t", "u", "slack"):
            assert type(getattr(row, field)) is float
        assert type(row.ok) is bool


@pytest.mark.parametrize("allowed", [1e-9, 1e-3])
def test_chords_that_cannot_be_the_highest_are_left_out_and_change_nothing(monkeypatch, allowed):
    """Samples of 0.01 to 0.3 steps on an ellipse: the highest chord is that of looking at them all."""
    chords = importlib.import_module("planner.check.chords")
    ellipse = FormulaCurve({"X": "30*cos(u)", "Y": "3*sin(u)"}, (0.0, 2.0 * np.pi))
    u = np.concatenate([[0.0], np.cumsum(np.random.default_rng(4).uniform(0.01, 0.3, 60_000))])
    u = u / u[-1] * 2.0 * np.pi
    samples = Samples(1e-3, 1e-3 * np.arange(u.size), u, ellipse.derivatives(u, 0)[0])
    looked_at = []
    heights = chords._heights
    monkeypatch.setattr(chords, "_heights", lambda *given: looked_at.append(given[-1]) or heights(*given))
    found = chords.sample_chord(ellipse, samples, u, 24, allowed=allowed, rounding=1e-14)
    assert sum(looked_at) < 0.2 * u.size
    monkeypatch.setattr(chords, "_within", lambda _curve, u, _rounding: np.full(u.size - 1, np.inf))
    assert chords.sample_chord(ellipse, samples, u, 24, allowed=allowed, rounding=1e-14) == found
    assert sum(looked_at) > u.size
