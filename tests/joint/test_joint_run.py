"""A run of blocks and a motion along it."""

import numpy as np
import pytest
from joint_runs import lines, run_of

from planner.errors import InputError
from planner.joint.joint_run import JointMotion, JointRun


def test_the_blocks_begin_and_end_at_the_points():
    run = run_of([[0.0, 0.0], [3.0, 4.0], [3.0, 9.0]])
    assert run.dim == 2
    np.testing.assert_allclose(run.starts, [[0.0, 0.0], [3.0, 4.0]], atol=1e-15)
    np.testing.assert_allclose(run.ends, [[3.0, 4.0], [3.0, 9.0]], atol=1e-15)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"tolerance": np.array([0.01, 0.0])}, r"tolerance\[1\] = .* must be > 0"),
        ({"feed": np.array([np.nan, 1.0])}, r"feed\[0\] = .* must be > 0"),
        ({"jerk": np.array([np.inf, 1.0])}, "jerk = .* must be finite"),
        ({"lengths": None}, "leg 1 begins 0.8 mm from the end of leg 0"),
    ],
)
def test_a_run_that_is_none_is_refused(changed, said):
    legs, length = lines([[0.0, 0.0], [3.0, 4.0], [3.0, 9.0]])
    if "lengths" in changed:
        changed = {}
        length = length - np.array([1.0, 0.0])
    run = run_of([[0.0, 0.0], [3.0, 4.0], [3.0, 9.0]])
    given = {name: getattr(run, name) for name in ("tolerance", "feed", "velocity", "acceleration", "jerk")} | changed
    with pytest.raises(InputError, match=said):
        JointRun(legs, length, **given)


def test_a_motion_is_the_cubic_between_its_nodes():
    t = np.array([0.0, 0.5, 1.25])
    jerk = np.array([[6.0, -12.0], [0.0, 24.0]])
    state = np.zeros((3, 3, 2))
    for k in range(2):
        h = t[k + 1] - t[k]
        p, v, a = state[k]
        state[k + 1] = p + h * v + h**2 / 2 * a + h**3 / 6 * jerk[k], v + h * a + h**2 / 2 * jerk[k], a + h * jerk[k]
    motion = JointMotion(t, *np.moveaxis(state, 1, 0), jerk, np.array([0, 1]))
    assert motion.duration == 1.25
    np.testing.assert_allclose(motion.at(t)[:3], np.moveaxis(state, 1, 0), atol=1e-14)
    np.testing.assert_array_equal(motion.at(np.array([0.5, 0.49999]))[3], [[0.0, 24.0], [6.0, -12.0]])
    slope = np.diff(motion.at(np.array([0.7 - 1e-6, 0.7 + 1e-6]))[0], axis=0)[0] / 2e-6
    np.testing.assert_allclose(slope, motion.at(np.array([0.7]))[1, 0], rtol=1e-8)
    with pytest.raises(ValueError, match="read-only"):
        motion.t[0] = 1.0


def test_normals_are_those_to_the_allowed_side_in_the_plane() -> None:
    points = [[0.0, 0.0, 0.0], [3.0, 4.0, 5.0], [3.0, 4.0, 6.0]]
    assert run_of(points).normals is None
    assert run_of(points, side=np.array([0, 0], dtype=np.int8)).normals is None
    left, right = (run_of(points, side=np.array([side, 0], dtype=np.int8)).normals for side in (1, -1))
    np.testing.assert_allclose(left, [[-0.8, 0.6, 0.0], [0.0, 0.0, 0.0]], atol=1e-15)
    np.testing.assert_array_equal(right, -left)
    with pytest.raises(InputError, match="leg 1 does not move in the plane of its side -1"):
        _ = run_of(points, side=np.array([1, -1], dtype=np.int8)).normals


def back_of(points, **given):
    """The run along the points the other way."""
    turned = {name: value[::-1] for name, value in given.items()}
    if "side" in turned:
        turned["side"] = -turned["side"]
    return run_of(points[::-1], **turned)


def test_of_both_directions_one_is_backward():
    rng = np.random.default_rng(4)
    for _ in range(50):
        points = np.round(np.cumsum(rng.normal(size=(6, 3)), axis=0), 1)
        assert run_of(points).is_backward != back_of(points).is_backward
    closed = np.array([[0.0, 0.0], [3.0, 1.0], [2.0, 5.0], [0.0, 0.0]])
    assert run_of(closed).is_backward != back_of(closed).is_backward
    there_and_back = np.array([[0.0, 0.0], [3.0, 1.0], [0.0, 0.0]])
    assert not run_of(there_and_back).is_backward
    assert not back_of(there_and_back).is_backward


def test_the_run_back_is_the_one_written_back_to_the_last_digit():
    rng = np.random.default_rng(5)
    points = np.round(np.cumsum(rng.normal(size=(8, 3)), axis=0), 4)
    given = {"tolerance": rng.uniform(0.01, 0.1, 7), "side": np.array([1, 0, -1, 0, 0, 1, 0], dtype=np.int8)}
    back, written = (run.between_vertices() for run in (run_of(points, **given).reversed(), back_of(points, **given)))
    np.testing.assert_array_equal(back.legs.vectors, written.legs.vectors)
    for name in ("lengths", "tolerance", "feed", "side"):
        np.testing.assert_array_equal(getattr(back, name), getattr(written, name))


def test_vertices_of_any_digits_stay_where_they_are():
    points = np.cumsum(np.random.default_rng(6).normal(size=(8, 3)), axis=0)
    run = run_of(points)
    np.testing.assert_array_equal(run.between_vertices().starts, run.starts)


def test_a_motion_back_in_time_passes_the_same_places():
    jerk = np.array([[6.0, -12.0], [0.0, 24.0], [-3.0, 1.0]])
    t = np.array([0.0, 0.5, 1.25, 1.5])
    state = np.zeros((4, 3, 2))
    for k in range(3):
        h = t[k + 1] - t[k]
        p, v, a = state[k]
        state[k + 1] = p + h * v + h**2 / 2 * a + h**3 / 6 * jerk[k], v + h * a + h**2 / 2 * jerk[k], a + h * jerk[k]
    motion = JointMotion(t, *np.moveaxis(state, 1, 0), jerk, np.array([0, 1, 1]))
    back = motion.reversed()
    at = np.array([0.01, 0.3, 0.7, 1.3, 1.49])
    signs = np.array([1.0, -1.0, 1.0, -1.0])[:, None, None]
    np.testing.assert_allclose(back.at(1.5 - at), signs * motion.at(at), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(back.leg, [0, 0, 1])
