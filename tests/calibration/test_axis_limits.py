"""Limits of axes from what was reached along lines."""

import numpy as np
import pytest

from planner.calibration.axis_limits import axis_limits, path_limit
from planner.quantity import ACCELERATION

AXES = ("X", "Y", "Z")


def unit(*v):
    return np.array(v) / np.linalg.norm(v)


def found(directions, reached, errors=None, binds=None):
    reached = np.asarray(reached, dtype=float)
    errors = 1e-4 * reached if errors is None else np.asarray(errors)
    return axis_limits(ACCELERATION, AXES, np.array(directions), reached, errors, binds)


@pytest.mark.parametrize("seed", range(20))
def test_random_directions_give_the_limits_back(seed):
    random = np.random.default_rng(seed)
    limits = random.uniform(100.0, 2000.0, 3)
    directions = random.normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    share = random.choice([1.0, 1.0, 0.5, 0.9], 60)
    first = np.argmin(limits / np.abs(directions), axis=1)
    checked = 0
    for j, limit in enumerate(found(directions, path_limit(limits, directions) * share)):
        assert limit.value <= limits[j] * 1.001
        if np.any((first == j) & (share == 1.0)):
            assert limit.known
            assert limit.value == pytest.approx(limits[j], rel=3e-3)
            checked += 1
    assert checked >= 2


def test_two_axes_that_are_always_at_it_together_are_not_told_apart():
    limits = found([unit(1, 1, 0), unit(1, -1, 0), unit(0, 0, 1)], [1000.0, 1000.0, 300.0])
    assert [limit.known for limit in limits] == [False, False, True]
    assert limits[0].value == pytest.approx(1000.0 / np.sqrt(2.0))
    assert "together with Y" in limits[0].why


def test_a_move_of_one_alone_tells_of_that_one_and_no_more():
    limits = found([unit(1, 1, 0), unit(1, 0, 0)], [1000.0, 1000.0])
    assert limits[0].known
    assert limits[0].value == pytest.approx(1000.0)
    # X could not have held the first back: Y did
    assert limits[1].known
    assert limits[1].value == pytest.approx(1000.0 / np.sqrt(2.0))


def test_what_was_held_back_by_no_axis_is_at_least():
    limits = found([unit(1, 0, 0)], [80.0], binds=np.array([False]))
    assert not limits[0].known
    assert limits[0].value == 80.0
    assert "may be higher" in limits[0].why


def test_an_axis_that_does_not_move():
    limits = found([unit(1, 0, 0)], [80.0])
    assert [limit.known for limit in limits] == [True, False, False]
    assert limits[2].value == 0.0


def test_noise_does_not_raise_a_limit():
    """Of many uncertain values the largest is no limit."""
    random = np.random.default_rng(3)
    errors = np.full(200, 30.0)
    reached = 1000.0 + errors * random.normal(size=200)
    limit = found(np.tile(unit(1, 0, 0), (200, 1)), reached, errors)[0]
    assert limit.value == pytest.approx(1000.0, rel=0.01)


def test_nothing_was_seen():
    assert [limit.known for limit in axis_limits(ACCELERATION, AXES, np.empty((0, 3)), np.empty(0), np.empty(0))] == [
        False
    ] * 3
