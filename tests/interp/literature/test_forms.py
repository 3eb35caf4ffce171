"""The replay forms: their orders of accuracy, their ends, and what they are compared by."""

from __future__ import annotations

import numpy as np
import pytest
from cases import drives
from motions import plan_along, scurve, time_at

from interp import replay
from interp.literature.forms import FORMS, prepare, replay_form
from planner import load_curve
from planner.errors import InputError, StalledError
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.profile import make_profile

BY_PLACE = ("Taylor 1 V(u)", "Taylor 2 V(u)", "Taylor 3 V(u)")
# Order of the accumulated error in the period, where u(t) is smooth.  The chord form follows the plan's distance: what
# is left is the arc less its chord.
ACCUMULATED = {
    "Taylor 1": 1, "Taylor 2": 2, "Taylor 3": 3, "RK2": 2, "chord": 2,
    "Taylor 1 V(u)": 1, "Taylor 2 V(u)": 2, "Taylor 3 V(u)": 3,
}  # fmt: skip
# feed, acceleration, jerk along the path
MOTIONS = {"circle": (100.0, 800.0, 14000.0), "teardrop": (60.0, 600.0, 12000.0), "flank": (20.0, 200.0, 5000.0)}


@pytest.fixture(scope="module")
def cases():
    """Curve, motion and plan by name."""
    found = {}
    for name, (feed, acceleration, jerk) in MOTIONS.items():
        curve = load_curve(name)
        motion = scurve(curve.length, feed, acceleration, jerk)
        found[name] = curve, motion, plan_along(curve, motion)
    return found


@pytest.fixture(scope="module")
def smooth():
    """A plan whose u(t) has all derivatives: the middle of a motion of constant jerk, on a curve of one piece."""
    curve = NurbsCurve([[0.0, 0.0], [40.0, 60.0], [90.0, -20.0], [140.0, 30.0]], [0.0] * 4 + [1.0] * 4, 3, name="bow")
    duration, jerk = 2.0, 30.0
    speed = (curve.length - jerk * duration**3 / 6.0) / duration
    t = np.linspace(0.0, duration, 4001)
    s, v, a = speed * t + jerk * t**3 / 6.0, speed + jerk * t**2 / 2.0, jerk * t
    u = curve.arclength.u(np.clip(s, 0.0, curve.length))
    u[0], u[-1] = curve.domain
    d = curve.derivatives(u, 2)
    rate = np.linalg.norm(d[1], axis=1)
    bend = np.sum(d[1] * d[2], axis=1)
    limits = Limits(500.0, [500.0] * 2, [1e4] * 2, [1e5] * 2)
    return curve, make_profile(curve, limits, TimeLaw(t, u, v / rate, a / rate - v**2 * bend / rate**4), method="exact")


def slope(x, y):
    """Exponent p of the power law y ~ x^p."""
    return np.polyfit(np.log(x), np.log(y), 1)[0]


@pytest.mark.parametrize("form", ACCUMULATED)
def test_the_accumulated_error_has_the_order_of_the_form(smooth, form):
    curve, profile = smooth
    periods = 1.5 / np.array([30, 60, 120, 240])
    errors = []
    for period in periods:
        samples = replay_form(curve, profile, form, period)
        k = round(1.5 / period)
        errors.append(abs(samples.u[k] - float(profile.at(1.5).u)))
    assert slope(periods, errors) == pytest.approx(ACCUMULATED[form], abs=0.2)


@pytest.mark.parametrize("form", ["RK2", "chord", *BY_PLACE])
@pytest.mark.parametrize("name", MOTIONS)
def test_samples_lie_on_the_curve_and_end_with_it(cases, name, form):
    curve, _, profile = cases[name]
    samples = replay_form(curve, profile, form, 1e-3)
    assert samples.u[0] == curve.domain[0]
    assert samples.u[-1] == curve.domain[1]
    assert (np.diff(samples.u) >= 0.0).all()
    assert np.abs(samples.position - curve.derivatives(samples.u, 0)[0]).max() < 4e-11
    assert np.array_equal(samples.position[-1], curve.derivatives(curve.domain[1], 0)[0])
    late = samples.t.size - 1 - int(np.ceil(profile.duration / 1e-3))
    assert abs(late) <= (0.02 * samples.t.size if form in BY_PLACE else 10)


@pytest.mark.parametrize("name", ["circle", "teardrop"])
def test_errors_rank_as_measured(cases, name):
    curve, _, profile = cases[name]
    error = {}
    for form in FORMS:
        samples = replay_form(curve, profile, form, 1e-3)
        law = profile.at(np.minimum(samples.t, profile.duration))
        error[form] = np.linalg.norm(samples.position - curve.derivatives(law.u, 0)[0], axis=1).max()
    assert error["Taylor 1"] > 20.0 * error["Taylor 2"] > 100.0 * error["Taylor 3"]
    assert error["Taylor 1 V(u)"] > 5.0 * error["Taylor 2 V(u)"] > 100.0 * error["Taylor 3 V(u)"]
    assert 1e-5 < error["RK2"] < 1e-3
    assert 1e-5 < error["chord"] < 2e-3
    assert error["quintic"] < 4e-11


def test_one_runge_kutta_step_is_that_of_its_formula(cases):
    curve, motion, profile = cases["teardrop"]
    samples = replay_form(curve, profile, "RK2", 1e-3)
    for k in (1, 100, 700, 1500):
        rate = [float(motion(j * 1e-3)[1]) for j in (k, k + 1)]
        here = rate[0] / np.linalg.norm(curve.derivatives(samples.u[k], 1)[1])
        there = rate[1] / np.linalg.norm(curve.derivatives(samples.u[k] + 1e-3 * here, 1)[1])
        step = samples.u[k + 1] - samples.u[k]
        assert step == pytest.approx(0.5e-3 * (here + there), rel=1e-6, abs=0.0)


def test_chords_of_the_chord_form_are_the_distances_of_the_plan(cases):
    curve, motion, profile = cases["circle"]
    samples = replay_form(curve, profile, "chord", 1e-3)
    chords = np.linalg.norm(np.diff(samples.position, axis=0), axis=1)[5:-10]
    planned = np.diff(motion(samples.t)[0])[5:-10]
    assert chords == pytest.approx(planned, rel=1e-4, abs=1e-8)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_step_with_v_of_u_takes_the_feed_of_the_plan_at_its_place(cases, order):
    curve, motion, profile = cases["circle"]
    samples = replay_form(curve, profile, f"Taylor {order} V(u)", 1e-3)
    assert samples.u[1] == pytest.approx(float(profile.at(1e-3).u), rel=1e-12, abs=0.0)
    for k in (60, 300, 900, 2000, 3000):
        t = time_at(motion, float(curve.arclength.s(samples.u[k])))
        _, v, a, j = (float(x) for x in motion(t))
        d = curve.derivatives(samples.u[k], 3)
        speed = np.linalg.norm(d[1])
        first = d[1] @ d[2] / speed
        second = (d[2] @ d[2] + d[1] @ d[3] - first**2) / speed
        u1 = v / speed
        u2 = (a - first * u1**2) / speed
        u3 = (j - 3.0 * first * u1 * u2 - second * u1**3) / speed
        step = sum(c * 1e-3**n / f for n, c, f in ((1, u1, 1), (2, u2, 2), (3, u3, 6))[:order])
        assert samples.u[k + 1] - samples.u[k] == pytest.approx(step, rel=1e-8)


def test_taylor_and_quintic_are_those_of_replay(cases):
    curve, _, profile = cases["teardrop"]
    for form, order in (("Taylor 1", 1), ("Taylor 2", 2), ("Taylor 3", 3), ("quintic", 5)):
        expected = replay(curve, profile, 1e-3, order=order)
        assert np.array_equal(replay_form(curve, profile, form, 1e-3).u, expected.u)
        replayer = prepare(profile, form, 1e-3)
        u, positions = np.empty(replayer.room), np.empty(replayer.room * curve.dim)
        assert replayer.run(replayer.state.copy(), u, positions) == replayer.count
        assert np.array_equal(u, expected.u[1:])


@pytest.mark.parametrize("form", ["RK2", "chord", *BY_PLACE])
def test_runs_of_any_length_make_one(cases, form):
    curve, _, profile = cases["circle"]
    whole = replay_form(curve, profile, form, 2e-3)
    replayer = prepare(profile, form, 2e-3)
    state, parts = replayer.state.copy(), []
    while state[3] < curve.domain[1]:
        u, positions = np.empty(7), np.empty(14)
        parts.append(u[: replayer.run(state, u, positions)])
    joined = np.concatenate(parts)
    assert np.array_equal(joined, whole.u[-joined.size :])


@pytest.mark.parametrize("form", FORMS)
def test_plans_that_do_not_stop_are_replayed_to_their_end(smooth, form):
    curve, profile = smooth
    samples = replay_form(curve, profile, form, 1e-3)
    assert samples.u[-1] == 1.0
    assert samples.start_feed > 0.0
    assert samples.end_feed > 0.0
    assert abs(samples.t.size - 2001) <= 30


@pytest.mark.parametrize("periods", [1.0, 1.5, 2.5, 3.0])
@pytest.mark.parametrize("form", FORMS)
def test_plans_of_a_few_periods(cases, form, periods):
    curve, _, profile = cases["circle"]
    samples = replay_form(curve, profile, form, profile.duration / periods)
    assert samples.u[0] == 0.0
    assert samples.u[-1] == 1.0


def test_what_cannot_be_replayed_is_refused(cases):
    curve, _, profile = cases["circle"]
    with pytest.raises(InputError, match="form = 'RK4' must be one of Taylor 1"):
        replay_form(curve, profile, "RK4")
    with pytest.raises(InputError, match="form = 'RK4'"):
        prepare(profile, "RK4", 1e-3)
    with pytest.raises(InputError, match="replay it on its own curve"):
        replay_form(load_curve("teardrop"), profile, "RK2")
    with pytest.raises(InputError, match="period = nan"):
        replay_form(curve, profile, "RK2", np.nan)
    with pytest.raises(InputError, match="at most 100000000"):
        replay_form(curve, profile, "chord", profile.duration / 2e8)


def test_a_rest_on_the_way_stalls_v_of_u_or_is_passed():
    curve = load_curve("circle")
    limits = drives()
    times, u = np.array([0.0, 3.0, 4.0, 7.0]), np.array([0.0, 0.3, 0.3, 1.0])
    profile = make_profile(curve, limits, TimeLaw(times, u, np.zeros(4), np.zeros(4)), method="stop")
    with pytest.raises(
        StalledError, match=r"Taylor 2 V\(u\) has got to u = 0\.2999999.* of 1\.0 .* its feed is 0 there"
    ):
        replay_form(curve, profile, "Taylor 2 V(u)", 1e-3)
