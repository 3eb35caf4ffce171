"""The fastest motion within the tolerance: what it may never break, what is known of it, and what must not change it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from joint_runs import polygon, run_of

from planner.errors import SolverError
from planner.geometry.blend import Legs
from planner.joint import solve
from planner.joint.joint_run import JointMotion, JointRun
from planner.joint.solve import solve_run
from planner.joint.straight import seven_phases

PLACES = 33  # in each piece, at which a motion is looked at


def sampled(motion: JointMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions and velocities (m, PLACES, d), and the legs."""
    h = np.linspace(0.0, 1.0, PLACES)[None, :, None] * np.diff(motion.t)[:, None, None]
    p, v, a, j = (
        part[: motion.leg.size, None] for part in (motion.position, motion.velocity, motion.acceleration, motion.jerk)
    )
    return p + h * v + h**2 * a / 2.0 + h**3 * j / 6.0, v + h * a + h**2 * j / 2.0, motion.leg


def nearest(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Distances of points from a line with its ends."""
    way = end - start
    share = np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
    return np.sqrt(((points - start - share[..., None] * way) ** 2).sum(axis=-1))


def assert_valid(run: JointRun, motion: JointMotion, vertices: np.ndarray) -> None:
    """From rest to rest, twice continuously differentiable, within tolerance and limits everywhere."""
    np.testing.assert_array_equal(motion.position[[0, -1]], np.stack([run.starts[0], run.ends[-1]]))
    assert not motion.velocity[[0, -1]].any()
    assert not motion.acceleration[[0, -1]].any()
    h = np.diff(motion.t)[:, None]
    assert (h > 0.0).all()
    p, v, a, j = motion.position, motion.velocity, motion.acceleration, motion.jerk
    np.testing.assert_allclose(p[:-1] + h * v[:-1] + h**2 * a[:-1] / 2.0 + h**3 * j / 6.0, p[1:], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(v[:-1] + h * a[:-1] + h**2 * j / 2.0, v[1:], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(a[:-1] + h * j, a[1:], rtol=0.0, atol=1e-9)
    assert (np.abs(a) <= run.acceleration * (1.0 + 1e-6)).all()
    assert (np.abs(j) <= run.jerk * (1.0 + 1e-6)).all()
    points, speeds, leg = sampled(motion)
    assert (np.abs(speeds) <= run.velocity * (1.0 + 1e-6)).all()
    assert (np.sqrt((speeds**2).sum(axis=-1)) <= run.feed[leg, None] * (1.0 + 1e-6)).all()
    assert (np.diff(leg) >= 0).all()
    assert set(leg) == set(range(run.lengths.size))
    for k, (start, end) in enumerate(pairwise(vertices)):
        assert nearest(points[leg == k], start, end).max() <= run.tolerance[k]
    for k in range(1, len(vertices) - 1):
        at = motion.position[np.searchsorted(leg, k)]
        assert np.linalg.norm(at - vertices[k]) <= min(run.tolerance[k - 1 : k + 1])


def exact_stop_time(points: list[list[float]]) -> float:
    """The time of the same lines, each from rest to rest, on the machine of these tests."""
    total = 0.0
    for step in np.diff(np.array(points), axis=0):
        length = np.linalg.norm(step)
        steepest = np.abs(step).max() / length
        total += seven_phases(length, 100.0, 1000.0 / steepest, 20000.0 / steepest)[0].sum()
    return total


@pytest.mark.parametrize("seed", range(1000, 1016))
def test_random_polygons_keep_everything_and_are_faster_than_stopping(seed):
    points, tolerance = polygon(seed)
    run = run_of(points, tolerance=np.full(len(points) - 1, tolerance))
    motion = solve_run(run)
    assert_valid(run, motion, np.array(points))
    assert motion.duration < exact_stop_time(points)


@pytest.mark.parametrize("seed", range(1000, 1008))
def test_there_and_back_are_one_motion(seed):
    """Of programs, whose numbers have an end: 1e-5 is asked for, and rounding is found."""
    points, tolerance = polygon(seed)
    points = np.round(points, 5)
    tolerances, feed = np.full(len(points) - 1, tolerance), np.linspace(60.0, 100.0, len(points) - 1)
    there = solve_run(run_of(points, tolerance=tolerances, feed=feed))
    back = solve_run(run_of(points[::-1], tolerance=tolerances, feed=feed[::-1]))
    assert back.duration == pytest.approx(there.duration, rel=1e-13)
    at = np.linspace(0.0, there.duration, 500)
    p, v, a, _ = there.at(at)
    q, w, b, _ = back.at(there.duration - at)
    np.testing.assert_allclose(q, p, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(-w, v, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(b, a, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize(
    ("points", "tolerance", "time"),
    [
        ([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0]], 0.01, 0.6594),
        ([[5.0 * np.cos(q), 5.0 * np.sin(q)] for q in np.arange(9) * np.pi / 4.0], 0.01, 1.1883),
    ],
)
def test_time_is_that_of_a_finer_solution(points, tolerance, time):
    """Solutions with several times the segments, to 1e-3."""
    run = run_of(points, tolerance=np.full(len(points) - 1, tolerance))
    assert solve_run(run).duration == pytest.approx(time, rel=1e-3)


def test_a_single_line_is_the_closed_form():
    points = [[1.0, 2.0, 3.0], [13.0, -3.0, 7.0]]
    run = run_of(points)
    motion = solve_run(run)
    assert_valid(run, motion, np.array(points))
    assert motion.duration == pytest.approx(exact_stop_time(points), rel=1e-13)
    assert motion.iterations == 0


@pytest.mark.parametrize("turn", [150.0, 170.0, 179.9, 180.0])
def test_a_sharp_turn_is_taken_by_reversing(turn):
    """Acceleration stays at its limit through the vertex, which saves nearly A / J = 50 ms against stopping."""
    angle = np.deg2rad(turn)
    points = [[0.0, 0.0], [12.0, 0.0], [12.0 + 12.0 * np.cos(angle), 12.0 * np.sin(angle)]]
    run = run_of(points)
    motion = solve_run(run)
    assert_valid(run, motion, np.array(points))
    assert 0.045 < exact_stop_time(points) - motion.duration < 0.055


def test_more_axes_and_a_turned_plane_change_nothing():
    """The same lines in a plane of five axes; and with the order of axes reversed."""
    points, _ = polygon(1002)
    time = solve_run(run_of(points)).duration
    wider = [[0.0, 1.0, point[1], 0.0, point[0]] for point in points]
    assert solve_run(run_of(wider)).duration == pytest.approx(time, rel=1e-4)


def test_units_do_not_matter():
    """Ten times the size at ten times all limits, and half the speed of time."""
    points, _ = polygon(1004)
    run = run_of(points)
    time = solve_run(run).duration
    larger = run_of((10.0 * np.array(points)).tolist(), tolerance=10.0 * run.tolerance)
    larger = replace(
        larger,
        feed=5.0 * run.feed,
        velocity=5.0 * run.velocity,
        acceleration=2.5 * run.acceleration,
        jerk=1.25 * run.jerk,
    )
    assert solve_run(larger).duration == pytest.approx(2.0 * time, rel=1e-4)


def test_limits_of_each_axis_and_block_are_its_own():
    points = [[0.0, 0.0], [10.0, 3.0], [12.0, 15.0], [30.0, 15.0]]
    run = run_of(
        points,
        tolerance=np.array([0.05, 0.002, 0.02]),
        feed=np.array([np.inf, 40.0, 90.0]),
        velocity=np.array([30.0, 80.0]),
        acceleration=np.array([800.0, 500.0]),
        jerk=np.array([30000.0, 5000.0]),
    )
    motion = solve_run(run)
    assert_valid(run, motion, np.array(points))
    used = np.abs(motion.velocity).max(axis=0)
    assert used[0] == pytest.approx(30.0, rel=1e-3)
    assert np.abs(motion.acceleration[:, 0]).max() == pytest.approx(800.0, rel=1e-2)


def test_windows_lose_nothing(monkeypatch):
    """Solved in parts that are joined at speed: within 1e-3 of the time of the whole."""
    points, _ = polygon(1009, legs=40)
    assert len(points) > 30
    run = run_of(points)
    monkeypatch.setattr(solve, "_KEPT", 100)
    whole = solve_run(run)
    monkeypatch.setattr(solve, "_KEPT", 8)
    monkeypatch.setattr(solve, "_BEYOND", 6)
    monkeypatch.setattr(solve, "_REST", 0)
    parts = solve_run(run)
    assert_valid(run, parts, np.array(points))
    assert parts.duration == pytest.approx(whole.duration, rel=1e-3)


def test_an_arc_between_lines():
    """A quarter of radius 5 mm, tangent to both: within the tolerance of it, faster than the centre line allows."""
    vectors = np.zeros((3, 4, 2))
    vectors[0, 0], vectors[0, 3] = [0.0, 0.0], [1.0, 0.0]
    vectors[1, :3] = [[20.0, 5.0], [0.0, -5.0], [5.0, 0.0]]
    vectors[2, 0], vectors[2, 3] = [25.0, 5.0], [0.0, 1.0]
    legs = Legs(vectors, np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.0]]))
    lengths = np.array([20.0, 2.5 * np.pi, 20.0])
    like = run_of([[0.0, 0.0], [20.0, 0.0], [25.0, 5.0], [25.0, 25.0]])
    run = replace(like, legs=legs, lengths=lengths)
    motion = solve_run(run)
    points, _, leg = sampled(motion)
    arc = points[leg == 1]
    assert np.abs(np.linalg.norm(arc - [20.0, 5.0], axis=-1) - 5.0).max() <= 0.01
    assert nearest(points[leg == 0], np.zeros(2), np.array([20.0, 0.0])).max() <= 0.01
    assert (np.abs(motion.acceleration) <= 1000.0 * (1.0 + 1e-6)).all()
    assert (np.abs(motion.jerk) <= 20000.0 * (1.0 + 1e-6)).all()
    assert 0.6 < motion.duration < 0.70


def test_splines_are_refused():
    run = run_of([[0.0, 0.0], [1.0, 0.0]])
    legs = replace(run.legs, ways=np.array([[0.0, 0.0, 1.0]]))
    object.__setattr__(run, "legs", legs)
    with pytest.raises(SolverError, match="splines"):
        solve_run(run)
