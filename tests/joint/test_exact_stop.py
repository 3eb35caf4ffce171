"""The motion that the joint solver starts from."""

import numpy as np
import pytest
from joint_runs import polygon, run_of

from planner.joint.exact_stop import stopping_motion


@pytest.mark.parametrize("seed", range(12))
def test_it_is_a_motion_inside_all_limits(seed):
    """Each stage leads to the next one exactly, along the lines, below the limits."""
    points, tolerance = polygon(seed)
    run = run_of(points, tolerance=np.full(len(points) - 1, tolerance))
    mesh = stopping_motion(run, 1.05)
    d = run.dim
    on = np.flatnonzero(~mesh.switches)
    p, v, a, t = np.split(mesh.x, [d, 2 * d, 3 * d], axis=1)
    h, jerk = mesh.share[on, None] * t[on], mesh.u[on]
    scale = np.abs(points).max()
    for found, after in (
        (p[on] + h * v[on] + h**2 * a[on] / 2.0 + h**3 * jerk / 6.0, p[on + 1]),
        (v[on] + h * a[on] + h**2 * jerk / 2.0, v[on + 1]),
        (a[on] + h * jerk, a[on + 1]),
    ):
        np.testing.assert_allclose(found, after, rtol=0.0, atol=1e-9 * max(scale, 1e3))
    assert np.abs(jerk).max() < 0.9 * 20000.0
    assert np.abs(a).max() < 0.95 * 1000.0
    assert np.sqrt((v**2).sum(axis=1)).max() < 0.96 * 100.0
    assert set(mesh.leg) == set(range(run.lengths.size))
