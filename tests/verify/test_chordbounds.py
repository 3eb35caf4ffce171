"""Bounds of chord errors from what the scan measures: no chord may be left further, and few of them are far from it."""

from __future__ import annotations

import importlib

import cases
import numpy as np
import pytest
from check_plans import constant_feed, lift, plan_on, profile_on, unlimited

from planner import load_curve
from planner.geometry.formula import FormulaCurve
from planner.verify.chordbounds import chord_bounds
from planner.verify.motion import Motion, Quintics
from planner.verify.scan import scan_spans
from planner.verify.sizes import position_rounding

chords = importlib.import_module("planner.verify.chords")

PERIODS = [1e-3, 0.02, 0.3]


def heights_and_bounds(motion, period, density=24):
    """Height of every chord that the check may look at, and the bound of its group, but for rounding."""
    law = motion.law
    end = float(law.start[-1] + law.h[-1])
    looked_at = chords._Chords.of(law, period, end)
    u = law.parameters(looked_at.times(np.arange(looked_at.count)).reshape(-1), *motion.curve.domain)
    points, shape = motion.curve.tip.derivatives(u, 0)[0], (looked_at.count, looked_at.each)
    height, _ = chords._heights(points, shape, looked_at.stride, chords.CHORD_PARTS)
    bound = chord_bounds(motion, scan_spans(motion, density), period, *looked_at.windows())
    rounding = 4.0 * position_rounding(motion.curve, np.linspace(*motion.curve.domain, 99))
    return height, bound[:, None] + rounding


def wild_motion(curve, seed, count=60):
    """Nodes of any place, rate and acceleration, some doubled with two values: the plan turns back, jumps and steps."""
    rng = np.random.default_rng(seed)
    u0, u1 = curve.domain
    t = np.cumsum(10.0 ** rng.uniform(-4.0, -1.0, count) * (rng.uniform(size=count) > 0.2))
    u = np.clip(np.linspace(u0, u1, count) + 0.02 * (u1 - u0) * rng.normal(size=count), u0, u1)
    u[rng.integers(count)] = u[0]
    rate, change = rng.normal(size=(2, count)) * (u1 - u0) / t[-1]
    rate[rng.uniform(size=count) < 0.1] = 0.0
    return Motion.of(curve, Quintics.of(profile_on(curve, unlimited(curve.dim), (t - t[0], u, rate, 10.0 * change))))


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("name", ["circle", "butterfly", "hypotrochoid", "teardrop", "snailshell", "flank"])
def test_no_chord_of_a_smooth_motion_is_left_further_than_its_bound(name, period):
    for count in (7, 37, 400):
        profile = plan_on(name, count)
        height, bound = heights_and_bounds(Motion.of(profile.curve, Quintics.of(profile)), period)
        assert (height <= bound).all()


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("seed", range(12))
def test_no_chord_of_any_motion_is_left_further_than_its_bound(seed, period):
    ellipse = FormulaCurve({"X": "40*cos(u)", "Y": "25*sin(u)"}, (0.0, 2.0 * np.pi))
    for curve in (ellipse, cases.square(30.0), load_curve("flank"), load_curve("butterfly-nurbs")):
        height, bound = heights_and_bounds(wild_motion(curve, seed), period)
        assert (height <= bound).all()


def test_a_corner_passed_at_speed_is_no_exception():
    """A chord over a corner of a square leaves it by up to half its length over the root of two."""
    square = cases.square(30.0)
    profile = profile_on(square, unlimited(), lift(square, constant_feed(square, 100.0, 80)))
    height, bound = heights_and_bounds(Motion.of(square, Quintics.of(profile)), 0.01)
    assert height.max() == pytest.approx(0.5 * np.sqrt(0.5), rel=0.1)
    assert (height <= bound).all()


def test_the_bound_of_a_circle_is_the_sagitta():
    circle, period = load_curve("circle"), 1e-3
    profile = profile_on(circle, unlimited(), lift(circle, constant_feed(circle, 100.0, 300)))
    height, bound = heights_and_bounds(Motion.of(circle, Quintics.of(profile)), period)
    inner = slice(1, -2)
    assert bound[inner, 0] == pytest.approx(height[inner].max(axis=1), rel=2e-3)


def test_a_straight_line_has_none_however_hard_it_is_driven():
    line = cases.line(60.0, 80.0)
    x = np.linspace(0.0, 1.0, 41)
    law = x**2 * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x), 6.0 - 12.0 * x
    motion = Motion.of(line, Quintics.of(profile_on(line, unlimited(), (x, *law))))
    height, bound = heights_and_bounds(motion, 0.02)
    assert height.max() < 1e-12
    assert bound[1:-1].max() < 1e-12


@pytest.mark.parametrize("period", PERIODS)
def test_chords_that_cannot_be_the_highest_are_left_out_and_change_nothing(monkeypatch, period):
    profile = plan_on("butterfly", 90)
    motion = Motion.of(profile.curve, Quintics.of(profile))
    scan, looked_at, heights = scan_spans(motion, 24), [], chords._heights
    monkeypatch.setattr(chords, "_heights", lambda *given: looked_at.append(given[1][0]) or heights(*given))
    found = chords.profile_chord(motion, scan, period, 1e-14)
    some = sum(looked_at)
    looked_at.clear()
    monkeypatch.setattr(chords, "chord_bounds", lambda *given: np.full(given[-1].size, np.inf))
    assert chords.profile_chord(motion, scan, period, 1e-14) == found
    assert period > 0.01 or some < 0.3 * sum(looked_at)


@pytest.mark.parametrize("name", ["circle", "flank"])
def test_the_course_of_a_span_is_that_of_its_points(name):
    profile = plan_on(name)
    motion = Motion.of(profile.curve, Quintics.of(profile))
    span, tip = np.arange(motion.interval.size), motion.curve.tip.dim
    scan = scan_spans(motion, 24)
    x = motion.grid(span, 24)
    _, p, _, rates, _ = motion.states(span, x)
    p, (u1, u2, u3) = p.reshape(4, *x.shape, tip), rates[..., None]
    velocity, acceleration = p[1] * u1, p[2] * u1**2 + p[1] * u2
    jerk = p[3] * u1**3 + 3.0 * p[2] * u1 * u2 + p[1] * u3
    direction = p[1] / np.linalg.norm(p[1], axis=-1)[..., None]
    along = np.sum(acceleration * direction, axis=-1)
    across = np.linalg.norm(acceleration - along[..., None] * direction, axis=-1)
    speed = np.linalg.norm(velocity, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        swing = np.where(speed > 1e-6 * speed.max(), across / speed, 0.0)
    thrust = np.sum(jerk * direction, axis=-1)
    aside = np.linalg.norm(jerk - thrust[..., None] * direction, axis=-1)
    sizes = np.stack([across, np.abs(along), swing, np.abs(thrust), aside], axis=-1)
    slack = 1e-7 * sizes.max(axis=(0, 1))  # across is the root of a difference of squares
    assert (np.abs(scan.course[:, :5] - sizes.max(axis=1)) <= slack).all()
    ends = np.concatenate([part[:, k] for k in (0, -1) for part in (p[0], velocity, direction)], axis=1)
    assert scan.course[:, 5:] == pytest.approx(ends, rel=1e-12, abs=1e-12)
