"""The check on a machine with rotary axes."""

from __future__ import annotations

import numpy as np
import pytest
from check_plans import AXIS_LIMITS, check, profile_on, sampled, scurve, tangential, unlimited

from planner import load_curve
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.samples import Samples
from planner.verify import tiplength
from planner.verify.tiplength import tip_steps


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


def test_steps_of_the_tip_are_lengths_and_negative_after_it_has_turned_back():
    """A circle against R times the angle; on X = cos v the way back of an axis, as A goes on, against X itself."""
    u = np.linspace(0.0, 2.0 * np.pi, 40_001)
    circle = FormulaCurve({"X": "1e4*cos(u)", "Y": "1e4*sin(u)"}, (0.0, 2.0 * np.pi))
    steps, doubt = tip_steps(circle, u)
    assert steps == pytest.approx(1e4 * np.diff(u), rel=1e-12, abs=0.0)
    assert doubt < 1e-11
    there_and_back = FormulaCurve({"X": "3*cos(u)", "Y": "4*cos(u)", "A": "u"}, (0.0, 3.0 * np.pi))
    u = np.sort(np.random.default_rng(3).uniform(0.0, 3.0 * np.pi, 500))
    steps, doubt = tip_steps(there_and_back, u)
    assert steps == pytest.approx(-5.0 * np.diff(np.cos(u)), abs=1e-11)
    assert doubt < 1e-11


def test_rounding_of_the_speed_is_told_and_not_halved_away(monkeypatch):
    """Speeds with an error of 1e-10: an honest doubt, and no more than a few points for each step."""
    circle = FormulaCurve({"X": "10*cos(u)", "Y": "10*sin(u)"}, (0.0, 6.0))
    rng, looked_at, norm = np.random.default_rng(5), [], tiplength.norm

    def noisy(vectors):
        looked_at.append(len(vectors))
        return norm(vectors) * (1.0 + 1e-10 * rng.normal(size=len(vectors)))

    monkeypatch.setattr(tiplength, "norm", noisy)
    u = np.linspace(0.0, 6.0, 1001)
    steps, doubt = tip_steps(circle, u)
    off = np.abs(steps - 10.0 * np.diff(u)).max()
    assert 0.5 * off <= doubt <= 1e-9 * 0.06
    assert sum(looked_at) <= 3 * 8 * u.size


def test_steps_that_no_limit_is_compared_with_are_the_same_to_the_digits_of_the_length():
    circle = FormulaCurve({"X": "10*cos(u)", "Y": "10*sin(u)"}, (0.0, 6.0))
    u = np.linspace(0.0, 6.0, 1001)
    (exact, _), (quick, off) = tip_steps(circle, u), tip_steps(circle, u, exact=False)
    assert np.abs(quick - exact).max() <= 4.0 * off < 1e-11
