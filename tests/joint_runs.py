"""Runs of lines for the tests of the joint problem."""

import numpy as np

from planner.geometry.blend import Legs
from planner.joint.joint_run import JointRun


def lines(points: list[list[float]]) -> tuple[Legs, np.ndarray]:
    """Legs between points, and their lengths."""
    at = np.array(points)
    step = np.diff(at, axis=0)
    length = np.sqrt((step**2).sum(axis=1))
    vectors = np.zeros((length.size, 4, at.shape[1]))
    vectors[:, 0], vectors[:, 3] = at[:-1], step / length[:, None]
    return Legs(vectors, np.zeros((length.size, 2))), length


def run_of(points: list[list[float]], **changed: object) -> JointRun:
    legs, length = lines(points)
    n, d = length.size, len(points[0])
    given = {
        "tolerance": np.full(n, 0.01),
        "feed": np.full(n, 100.0),
        "velocity": np.full(d, 250.0),
        "acceleration": np.full(d, 1000.0),
        "jerk": np.full(d, 20000.0),
    }
    return JointRun(legs, length, **(given | changed))  # type: ignore[arg-type]


def polygon(seed: int, legs: int = 12) -> tuple[list[list[float]], float]:
    """A random polygon in the plane or in space, and a tolerance: legs of 0.2 to 50 mm, turns of 5 to 179 degrees."""
    rng = np.random.default_rng(seed)
    d, n = 2 + seed % 2, int(rng.integers(3, legs + 1))
    points = [np.zeros(d)]
    along = rng.normal(size=d)
    along /= np.linalg.norm(along)
    for _ in range(n):
        points.append(points[-1] + along * 10.0 ** rng.uniform(np.log10(0.2), np.log10(50.0)))
        turn, across = np.deg2rad(rng.uniform(5.0, 179.0)), rng.normal(size=d)
        across -= along * (across @ along)
        along = np.cos(turn) * along + np.sin(turn) * across / np.linalg.norm(across)
    return [point.tolist() for point in points], float(10.0 ** rng.uniform(-3.0, np.log10(0.05)))
