"""Motions of piecewise constant jerk."""

import numpy as np
import pytest

from planner.joint.constant_jerk import arriving, rolled, spline_through


def test_states_follow_from_the_ones_before():
    rng = np.random.default_rng(1)
    jerk, width, start = rng.normal(size=(7, 2)), rng.uniform(0.1, 1.0, 7), rng.normal(size=(3, 2))
    p, v, a = rolled(start, jerk, width)
    h = width[:, None]
    np.testing.assert_allclose(a[1:], a[:-1] + h * jerk, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(v[1:], v[:-1] + h * a[:-1] + h**2 * jerk / 2.0, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(
        p[1:], p[:-1] + h * v[:-1] + h**2 * a[:-1] / 2.0 + h**3 * jerk / 6.0, rtol=0.0, atol=1e-13
    )


def test_the_change_that_makes_it_arrive_is_the_least():
    """Any other change with the same end is larger, in the sense of its integral square."""
    rng = np.random.default_rng(2)
    jerk, width, end = rng.normal(size=(9, 1)), rng.uniform(0.1, 1.0, 9), rng.normal(size=(3, 1))
    state, changed = arriving(np.zeros((3, 1)), jerk, width, end)
    np.testing.assert_allclose(rolled(np.zeros((3, 1)), changed, width)[:, -1], end, atol=1e-12)
    np.testing.assert_array_equal(state[:, -1], end)
    basis = np.stack([rolled(np.zeros((3, 1)), unit[:, None], width)[:, -1, 0] for unit in np.eye(9)], axis=1)
    silent = np.linalg.svd(basis)[2][3:]  # changes that do not move the end
    np.testing.assert_allclose(silent @ (width * (changed - jerk)[:, 0]), 0.0, atol=1e-12)


def test_the_spline_passes_its_points_and_has_no_jumps():
    rng = np.random.default_rng(3)
    p, width = rng.normal(size=(8, 2)), rng.uniform(0.1, 1.0, 7)
    v, a = spline_through(p, width)
    jerk = np.diff(a, axis=0) / width[:, None]
    state = rolled(np.stack([p[0], v[0], a[0]]), jerk, width)
    for found, wanted in zip(state, (p, v, a), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8)
    assert np.abs(v[[0, -1]]).max() == pytest.approx(0.0)
