"""The fastest motion along a line."""

import numpy as np
import pytest

from planner.joint.straight import along, reachable_acceleration, seven_phases


@pytest.mark.parametrize(
    ("length", "time"),
    [
        (20.0, 20.0 / 100.0 + 100.0 / 1000.0 + 1000.0 / 20000.0),  # V and A are reached: L / V + V / A + A / J
        (12.0, 0.05 + 2.0 * (np.sqrt(25.0**2 + 12.0 * 1000.0) - 25.0) / 1000.0 + 0.05),  # A alone
        (0.1, (32.0 * 0.1 / 20000.0) ** (1.0 / 3.0)),  # neither
    ],
)
def test_time_is_that_of_the_closed_form(length, time):
    durations, jerks = seven_phases(length, 100.0, 1000.0, 20000.0)
    assert durations.sum() == pytest.approx(time, rel=1e-12)
    assert along(durations, jerks, np.array([durations.sum()]))[:3, 0] == pytest.approx([length, 0.0, 0.0], abs=1e-10)


@pytest.mark.parametrize("seed", range(20))
def test_limits_are_kept_and_one_is_always_used(seed):
    length, velocity, acceleration, jerk = 10.0 ** np.random.default_rng(seed).uniform([-3, 0, 1, 3], [3, 3, 4, 6])
    durations, jerks = seven_phases(length, velocity, acceleration, jerk)
    assert (durations >= 0.0).all()
    _, v, a, _ = along(durations, jerks, np.linspace(0.0, durations.sum(), 10001))
    assert v.max() <= velocity * (1.0 + 1e-12)
    assert np.abs(a).max() <= acceleration * (1.0 + 1e-12)
    assert np.abs(jerks).max() == jerk


def test_infinite_velocity_and_acceleration_leave_the_jerk():
    durations, _ = seven_phases(2.0, np.inf, np.inf, 16000.0)
    assert durations.sum() == pytest.approx((32.0 * 2.0 / 16000.0) ** (1.0 / 3.0), rel=1e-12)


@pytest.mark.parametrize(
    ("velocity", "feed", "reached"), [(np.inf, 16.0, 800.0), (4.0, 16.0, 400.0), (np.inf, 25.0, 900.0)]
)
def test_an_acceleration_is_reached_where_the_speed_leaves_room_for_it(velocity, feed, reached):
    """From -V to V and no farther: the acceleration rises with J to sqrt(2 V J), at V = 0, and falls again."""
    limits = [np.array([value]) for value in (velocity, 900.0, 20000.0)]
    found = reachable_acceleration(*limits, feed)
    assert found == pytest.approx([reached])
    if reached < 900.0:
        speed = min(velocity, feed)
        rise = found[0] / 20000.0
        assert -speed + 20000.0 * rise**2 == pytest.approx(speed)  # two ramps of J rise^2 / 2
