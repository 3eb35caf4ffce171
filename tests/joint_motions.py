"""Motions for tests, made from the jerk of every axis: what the joint solver may find."""

import numpy as np

from planner.geometry.blend import Legs
from planner.joint.joint_run import JointMotion, JointRun


def motion_of(durations, jerks, leg, start=None):
    """From rest: pieces of constant jerk, (m, d), that last so long, each along a block."""
    h, jerks = np.asarray(durations, dtype=float), np.asarray(jerks, dtype=float)
    state = np.zeros((3, h.size + 1, jerks.shape[1]))
    state[0, 0] = 0.0 if start is None else start
    for i, (step, j) in enumerate(zip(h, jerks, strict=True)):
        p, v, a = state[:, i]
        state[:, i + 1] = p + step * (v + step * (a / 2 + step * j / 6)), v + step * (a + step * j / 2), a + step * j
    return JointMotion(np.append(0.0, np.cumsum(h)), *state, jerks, np.asarray(leg))


def run_of(points, tolerance=0.01, feed=100.0, jerk=20000.0):
    """Lines between points."""
    points = np.asarray(points, dtype=float)
    step = np.diff(points, axis=0)
    length = np.sqrt(np.sum(step**2, axis=1))
    vectors = np.zeros((length.size, 4, points.shape[1]))
    vectors[:, 0], vectors[:, 3] = points[:-1], step / length[:, None]
    each = np.ones(length.size)
    axes = np.ones(points.shape[1])
    legs = Legs(vectors, np.zeros((length.size, 2)))
    return JointRun(legs, length, tolerance * each, feed * each, 250.0 * axes, 1000.0 * axes, jerk * axes)


def corner():
    """X comes to rest while Y leaves it, two pieces of 10 ms together: 60 ms; the run of its lines, and the motion."""
    h = [0.01] * 6
    x = [20000.0, -20000.0, -20000.0, 20000.0, 0.0, 0.0]
    y = [0.0, 0.0, 20000.0, -20000.0, -20000.0, 20000.0]
    motion = motion_of(h, np.stack([x, y], axis=1), [0, 0, 0, 1, 1, 1])
    end = motion.position[-1]
    return run_of([[0.0, 0.0], [end[0], 0.0], end]), motion


def there_and_back(early=0.0):
    """Out along X and back, turning at constant acceleration; the first block's pieces end so long before the turn, s."""
    h = np.array([0.01, 0.01, 0.01, 0.005 - early, 0.005 + early, 0.01, 0.01, 0.01])
    x = 20000.0 * np.array([1.0, -1.0, -1.0, 0.0, 0.0, 1.0, 1.0, -1.0])
    motion = motion_of(h, np.stack([x, 0.0 * x], axis=1), [0, 0, 0, 0, 1, 1, 1, 1])
    far = motion.at(np.array([0.035]))[0, 0]
    return run_of([[0.0, 0.0], far, [0.0, 0.0]]), motion
