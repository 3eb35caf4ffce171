"""The compiled joint solver against the problem as it is defined, in plain numpy."""

import numpy as np
import pytest
from joint_runs import lines
from joint_system_reference import Problem

from planner.compiled import core
from planner.geometry.blend import Legs


def walls_of(legs: Legs, d: int, sided: bool) -> np.ndarray | None:
    """The left sides of both legs in the plane of the first two axes; that of the second is kept along the first too."""
    if not sided:
        return None
    along = legs.vectors[:, 3]
    normals = np.zeros((2, d))
    normals[:, 0], normals[:, 1] = -along[:, 1], along[:, 0]
    return np.column_stack([normals / np.linalg.norm(normals, axis=1)[:, None], [0.0, 0.0], [1.0, 0.0]])


def instance(seed: int, d: int, *, sided: bool = False) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Two legs of two phases of two segments each, and a motion that is somewhere near them."""
    rng = np.random.default_rng(seed)
    legs, length = lines(np.cumsum(rng.normal(size=(3, d)), axis=0).tolist())
    switches = np.tile([True, False, False], 4)
    n = switches.size
    problem = Problem(
        switches=switches,
        share=np.where(switches, 0.0, np.tile([0.0, 0.4, 0.6], 4)),
        scale=np.exp(rng.normal(scale=0.2, size=n)),
        leg=np.repeat([0, 1], 6),
        vectors=legs.vectors,
        lengths=length,
        near=rng.uniform(0.5, 2.0, (n, 2)),
        pace=rng.uniform(0.1, 0.3, (n, 2)) * [1.0, rng.integers(2)],
        axes=np.stack([rng.uniform(0.1, 0.3, d) * rng.integers(2, size=d), rng.uniform(0.1, 0.3, d), np.ones(d)]),
        least=1e-4,
        walls=walls_of(legs, d, sided),
        target=np.concatenate([legs.vectors[-1, 0] + length[-1] * legs.vectors[-1, 3], np.zeros(2 * d)]),
    )
    x = np.column_stack([rng.normal(scale=0.3, size=(n + 1, 3 * d)), np.exp(rng.normal(scale=0.3, size=n + 1))])
    x[:, :d] += np.linspace(0.0, 1.0, n + 1)[:, None] * (problem.target[:d] - legs.vectors[0, 0]) + legs.vectors[0, 0]
    u = rng.normal(scale=0.3, size=(n, d))
    u[switches, 0] = np.exp(rng.normal(scale=0.3, size=4))
    return problem, x, u


@pytest.mark.parametrize("sided", [False, True])
@pytest.mark.parametrize(("seed", "d"), [(0, 2), (1, 2), (2, 2), (3, 3), (4, 3), (5, 4)])
def test_a_newton_step_is_that_of_the_whole_system(seed: int, d: int, sided: bool) -> None:
    """Rows, their two derivatives, the switches and the sweep at once, against a dense solve of the KKT system."""
    problem, x, u = instance(seed, d, sided=sided)
    rng = np.random.default_rng(seed + 100)
    prices, price = rng.normal(scale=0.1, size=x.shape), rng.normal(size=3 * d)
    aim = np.array([0.02, 30.0, 50.0])
    sizes = np.array([d, problem.n, problem.lengths.size])
    dx, du = np.zeros_like(x), np.zeros_like(u)
    done = core.joint_newton(
        *(sizes, problem.switches, problem.share, problem.scale, problem.leg, problem.vectors),
        *(np.zeros((2, 2)), problem.lengths, problem.near, problem.pace, problem.walls, problem.axes, problem.least),
        *(problem.target, 0.05, aim, x.copy(), u.copy(), np.empty(core.joint_work(sizes)), prices, price, dx, du),
    )
    assert done
    expected_x, expected_u = problem.newton(0.05, aim, x, u, prices, price)
    np.testing.assert_allclose(du, expected_u, rtol=0.0, atol=1e-6 * np.abs(expected_u).max())
    np.testing.assert_allclose(dx, expected_x, rtol=0.0, atol=1e-6 * np.abs(expected_x).max())


def test_without_holding_durations_an_indefinite_system_is_refused() -> None:
    """The time is concave in c: alone it has no least value."""
    problem, x, u = instance(0, 2)
    sizes = np.array([2, problem.n, 2])
    given = (
        *(sizes, problem.switches, problem.share, problem.scale, problem.leg, problem.vectors),
        *(np.zeros((2, 2)), problem.lengths, problem.near, problem.pace, problem.walls, problem.axes, problem.least),
    )
    rest = (np.empty(core.joint_work(sizes)), np.zeros_like(x), np.zeros(6), np.zeros_like(x), np.zeros_like(u))
    for hold, possible in ((0.0, 0), (100.0, 1)):
        aim = np.array([1e-9, 30.0, hold])
        assert core.joint_newton(*given, problem.target, 1e-9, aim, x.copy(), u.copy(), *rest) == possible
