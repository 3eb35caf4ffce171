"""Ramps of the acceleration and the law they follow, on machines of which everything is known."""

from functools import cache

import numpy as np
import pytest
from known_machines import ACCELERATION, AXES, JERK, TAU, made_log

from planner.calibration.laws import MotionLaw, fit_laws
from planner.calibration.ramps import Ramp, ramp_way, ramps
from planner.calibration.stretches import stretches

LAWS = {"trapezoid": MotionLaw.TRAPEZOID, "s-curve": MotionLaw.S_CURVE, "fir": MotionLaw.FIR}


@cache
def fitted(law, **given):
    log = made_log(law, **given)
    return fit_laws(ramps(*stretches(log, 0), np.array(ACCELERATION), log.period), AXES)


def test_the_way_of_a_ramp_is_the_integral_of_its_acceleration():
    t = np.linspace(-1.0, 2.0, 300_001)
    acceleration = np.clip(t / 0.7 + 0.5, 0.0, 1.0)
    speed = np.concatenate([[0.0], np.cumsum(0.5 * (acceleration[1:] + acceleration[:-1]))]) * 1e-5
    way, slope = ramp_way(t, 0.7)
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * 1e-5
    assert np.abs(slope - speed).max() < 1e-9
    assert np.abs(way - summed).max() < 1e-8


@pytest.mark.parametrize("duration", [0.0, 0.004, 0.03])
def test_a_ramp_is_measured(duration):
    t = np.arange(200) * 1e-3
    way = 3.0 + 20.0 * t + 50.0 * t**2 + 800.0 * ramp_way(t - 0.0913, duration)[0]
    ramp = Ramp(t, way + np.random.default_rng(0).normal(0.0, 1e-5, 200), 1e-5, 100.0, 900.0, 0.09, 1e-3, np.eye(3)[0])
    assert abs(ramp.duration - duration) < max(4.0 * ramp.error, 1e-4 if duration else 1.5e-3)
    assert not ramp.is_odd


def test_two_steps_are_no_ramp():
    t = np.arange(200) * 1e-3
    way = 800.0 * (ramp_way(t - 0.05, 0.0)[0] - 2.0 * ramp_way(t - 0.14, 0.0)[0])
    assert Ramp(t, way, 1e-6, 0.0, -800.0, 0.1, 1e-3, np.eye(3)[0]).is_odd


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "given", [(), (("count", 1e-3),), (("period", 4e-3), ("count", 1e-3)), (("count", 2e-4), ("noise", 3e-4))]
)
def test_the_law_is_found(law, given):
    found = fitted(law, **dict(given))
    assert found.best is LAWS[law]
    assert found.sure
    best = next(fit.misfit for fit in found.fits if fit.law is found.best)
    assert all(fit.misfit > 2.0 * best for fit in found.fits if fit.law is not found.best)


@pytest.mark.parametrize(
    ("given", "within"), [({}, 1e-3), ({"count": 1e-3}, 2e-3), ({"period": 4e-3, "count": 1e-3}, 5e-3)]
)
def test_jerk_and_filter_are_found(given, within):
    jerk = fitted("s-curve", **given).jerk
    assert all(limit.known for limit in jerk)
    assert [limit.value for limit in jerk] == pytest.approx(JERK, rel=within)
    assert fitted("fir", **given).tau == pytest.approx(TAU, rel=within)


def test_in_noise_two_laws_are_not_told_apart_and_that_is_said():
    found = fitted("s-curve", noise=4e-3)
    assert not found.sure
    assert found.best is MotionLaw.S_CURVE
    assert "not told apart" in found.says


def test_a_filter_shorter_than_three_samples_looks_like_none():
    found = fitted("fir", period=1e-2)
    assert found.best is MotionLaw.TRAPEZOID
    assert "3 samples, 30 ms" in found.says
    assert not any(limit.known for limit in found.jerk)


def test_nothing_to_tell_by():
    found = fit_laws([], AXES)
    assert found.best is None
    assert "nothing tells" in found.says
