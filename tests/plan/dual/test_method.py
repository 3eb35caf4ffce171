"""One step of the primal-dual method, at random places: it solves the conditions of optimality, made linear there.

The oracle knows nothing of elimination.  It writes the program of ``method.py`` down with dense rows, point after point, and
asks of the steps that every condition holds: feasibility, what is stationary, the product of each slack and multiplier.
"""

from __future__ import annotations

import numpy as np
import pytest

from planner.compiled import core
from planner.plan.dual.method import Iterates, Problem, _Newton, _Passes

# jerk limits, acceleration limits, which of the cells are empty
SHAPES = (
    (2, 2, (3, 6)),
    (1, 0, ()),
    (0, 1, (2,)),
    (3, 1, (1,)),
    (5, 6, (4,)),
    (0, 3, ()),
)
CELLS = 9
POINTS = 4


def random_problem(jerks, accelerations, empty, seed=0):
    """A problem of any numbers but with the layout of a real one, and a state inside all bounds."""
    rng = np.random.default_rng([seed, jerks, accelerations])
    width = jerks + accelerations
    local, unknowns = 2 * width + jerks, (CELLS + 2) * width
    place = np.full(CELLS, -1)
    full = np.setdiff1d(np.arange(CELLS), empty)
    place[full] = np.arange(full.size)
    block = full.size, POINTS
    atom_rows = np.zeros((CELLS, local))
    atom_rows[list(empty)] = rng.normal(size=(len(empty), local))
    last_controls = np.arange(unknowns - width + jerks, unknowns)  # of no l m: there is one less of these
    problem = Problem(
        place,
        (jerks, accelerations),
        rng.uniform(0.1, 1.0, block),
        rng.uniform(1.0, 3.0, block),
        rng.uniform(0.5, 1.0, block),
        rng.uniform(0.1, 1.0, (full.size, 3, POINTS)),
        rng.uniform(0.1, 1.0, (full.size, 2, POINTS)),
        rng.normal(size=(*block, local)),
        atom_rows,
        rng.uniform(1.0, 2.0, CELLS),
        rng.normal(size=unknowns),
        np.union1d([0], last_controls).astype(np.int64),
        np.zeros((0, unknowns)),
    )
    state = Iterates(problem)
    # away from the centre, no two numbers alike
    state.points[:, 2:5] *= rng.uniform(0.5, 2.0, state.points[:, 2:5].shape)
    for c in range(width):
        bound = state.points[:, 0] if c < jerks else 1.0
        state.points[:, 5 + 3 * c] = bound * rng.uniform(-0.7, 0.7, block)
        state.points[:, 6 + 3 * c : 8 + 3 * c] *= rng.uniform(0.5, 2.0, (full.size, 2, POINTS))
    state.atoms *= rng.uniform(0.7, 1.4, state.atoms.shape)
    return problem, state, _Passes(problem, state)


def dense_rows(problem, cell, i):
    """Rows over all unknowns of one point: of each e, each u, and of x."""
    jerks, accelerations = problem.axes
    width, unknowns = jerks + accelerations, problem.known.size
    block, begin = problem.place[cell], cell * width
    e, u, x = np.zeros((jerks, unknowns)), np.zeros((accelerations, unknowns)), np.zeros(unknowns)
    for j in range(jerks):
        e[j, begin + j + width * np.arange(3)] = problem.quadratic[block, :, i]
    for m in range(accelerations):
        u[m, begin + jerks + m + width * np.arange(2)] = problem.linear[block, :, i]
    x[begin : begin + problem.rows.shape[-1]] = problem.rows[block, i]
    return e, u, x


def residuals(problem, state, before, after, theta, target, corrector):
    """What is left of each condition at the new place; ``before`` and ``after`` are (points, atoms) of steps."""
    jerks, accelerations = problem.axes
    width, found = jerks + accelerations, {"stationary": [], "product": [], "feasible": []}
    weak, size = problem.known.copy(), np.abs(problem.known).max()

    def product(slack, dslack, multiplier, dmultiplier, last):
        found["product"].append(
            slack * multiplier + slack * dmultiplier + multiplier * dslack + corrector * last - target
        )

    for cell in range(CELLS):
        block = problem.place[cell]
        if block < 0:
            (x, low, high), (dx, dlow, dhigh), old = state.atoms[cell], after[1][cell], before[1][cell]
            row = np.zeros(problem.known.size)
            row[cell * width : cell * width + problem.rows.shape[-1]] = problem.atom_rows[cell]
            found["stationary"].append(row @ theta - (low + dlow) + high + dhigh)
            product(x, dx, low, dlow, old[0] * old[1])
            product(problem.atom_caps[cell] - x, -dx, high, dhigh, -old[0] * old[2])
            weak += row * (x + dx)
            continue
        for i in range(POINTS):
            rows_e, rows_u, row_x = dense_rows(problem, cell, i)
            now, step, old = state.points[block, :, i], after[0][block, :, i], before[0][block, :, i]
            y, x, t, v, mu = now[:5]
            dy, dx, dt, dv, dmu = step[:5]
            weight, cap = problem.weight[block, i], problem.cap[block, i]
            found["feasible"].append(y + dy - (t + dt) - (x**-0.5 - 0.5 * x**-1.5 * dx))
            product(t, dt, v, dv, old[2] * old[3])
            product(cap - x, -dx, mu, dmu, -old[1] * old[4])
            found["stationary"].append(row_x @ theta + mu + dmu - 0.5 * x**-1.5 * (v + dv) + 0.75 * x**-2.5 * v * dx)
            of_y = 1.0 - (v + dv)
            for c in range(width):
                (z, low, high), (dz, dlow, dhigh), last = (part[5 + 3 * c : 8 + 3 * c] for part in (now, step, old))
                bound, dbound, dlast = (y, dy, old[0]) if c < jerks else (1.0, 0.0, 0.0)
                row = rows_e[c] if c < jerks else rows_u[c - jerks]
                found["stationary"].append(row @ theta + (low + dlow) - (high + dhigh))
                product(bound - z, dbound - dz, low, dlow, (dlast - last[0]) * last[1])
                product(bound + z, dbound + dz, high, dhigh, (dlast + last[0]) * last[2])
                weak += weight * row * (z + dz)
                of_y -= (low + dlow + high + dhigh) if c < jerks else 0.0
            found["stationary"].append(of_y)
            weak += weight * row_x * (x + dx)
            size = max(size, np.abs(row_x).max())
    weak[problem.fixed] = 0.0  # what is held has a price of its own
    return {name: np.abs(values).max() for name, values in found.items()} | {"weak": np.abs(weak).max() / size}


def taken(problem, state, work, target, corrector):
    """New theta, and the steps (points, atoms) before and after."""
    points = work.last[0]
    before = points.copy(), work.last[1].copy()
    newton = _Newton(problem, state, work)
    assert newton.regular
    work.control[:2] = target, corrector
    work.right_side()
    theta = newton.theta(work.b + problem.known)
    work.theta[:] = theta
    work.steps()
    return theta, before, (points, work.last[1])


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize(("target", "corrector"), [(0.0, 0.0), (0.3, 0.0), (0.2, 0.7)])
def test_the_step_meets_every_condition(shape, target, corrector):
    problem, state, work = random_problem(*shape)
    rng = np.random.default_rng(8)
    for array in work.last:  # the last steps, of which the corrector takes the products
        array[:] = rng.normal(0.0, 0.1, array.shape)
    theta, before, after = taken(problem, state, work, target, corrector)
    left = residuals(problem, state, before, after, theta, target, corrector)
    assert (theta[problem.fixed] == 0.0).all()
    assert max(left.values()) < 1e-9, left


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_what_the_driver_is_told(shape):
    problem, state, work = random_problem(*shape)
    _, _, (points, atoms) = taken(problem, state, work, 0.1, 0.0)
    jerks, _ = problem.axes
    now, d, atom, d_atom = state.points, points, state.atoms, atoms
    empty = problem.place < 0
    pairs = [(now[:, 2], d[:, 2], now[:, 3], d[:, 3]), (problem.cap - now[:, 1], -d[:, 1], now[:, 4], d[:, 4])]
    for c in range(sum(problem.axes)):
        bound, dbound = (now[:, 0], d[:, 0]) if c < jerks else (1.0, 0.0)
        z, low, high = (now[:, 5 + 3 * c + k] for k in range(3))
        dz, dlow, dhigh = (d[:, 5 + 3 * c + k] for k in range(3))
        pairs += [(bound - z, dbound - dz, low, dlow), (bound + z, dbound + dz, high, dhigh)]
    weights = [problem.weight] * len(pairs) + [np.ones(empty.sum())] * 2
    x = atom[empty, 0]
    pairs.append((x, d_atom[empty, 0], atom[empty, 1], d_atom[empty, 1]))
    pairs.append((problem.atom_caps[empty] - x, -d_atom[empty, 0], atom[empty, 2], d_atom[empty, 2]))
    expected = [
        max(np.max(-ds / s, initial=0.0) for s, ds, _, _ in pairs),
        max(np.max(-dm / m, initial=0.0) for _, _, m, dm in pairs),
        np.max(-d[:, 1] / now[:, 1], initial=0.0),
        sum(np.sum(w * s * dm) for w, (s, _, _, dm) in zip(weights, pairs, strict=True)),
        sum(np.sum(w * ds * m) for w, (_, ds, m, _) in zip(weights, pairs, strict=True)),
        sum(np.sum(w * ds * dm) for w, (_, ds, _, dm) in zip(weights, pairs, strict=True)),
        np.sum(problem.weight * d[:, 0]),
    ]
    np.testing.assert_allclose(work.out, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
    primal, dual = 0.3 / max(work.out[0], 1.0), 0.2 / max(work.out[1], 1.0)
    moved, moved_atoms = now.copy(), atom + d_atom * np.array([primal, dual, dual])
    is_multiplier = np.array([c in (3, 4) or (c >= 5 and (c - 5) % 3 > 0) for c in range(now.shape[1])])
    moved += d * np.where(is_multiplier, dual, primal)[:, None]
    moved[:, 2] = np.maximum(moved[:, 2], moved[:, 0] - moved[:, 1] ** -0.5)
    work.control[2:] = primal, dual
    work.take_step()
    np.testing.assert_allclose(state.points, moved, rtol=1e-14)
    np.testing.assert_allclose(state.atoms[empty], moved_atoms[empty], rtol=1e-14)
    gap = np.sum(problem.weight * (moved[:, 2] * moved[:, 3] + (problem.cap - moved[:, 1]) * moved[:, 4]))
    for c in range(sum(problem.axes)):
        bound, (z, low, high) = (moved[:, 0] if c < jerks else 1.0), (moved[:, 5 + 3 * c + k] for k in range(3))
        gap += np.sum(problem.weight * ((bound - z) * low + (bound + z) * high))
    x, low, high = moved_atoms[empty].T
    gap += np.sum(x * low + (problem.atom_caps[empty] - x) * high)
    np.testing.assert_allclose(work.out[:2], [gap, np.sum(problem.weight * moved[:, 0])], rtol=1e-12)


@pytest.mark.parametrize(("count", "local"), [(1, 1), (1, 4), (7, 3), (30, 10), (12, 25)])
def test_the_factor_solves_with_some_unknowns_held(count, local):
    rng = np.random.default_rng([count, local])
    band = rng.normal(size=(count, local))
    band[:, 0] = 2.0 * local
    dense = sum((np.diag(band[: count - d, d], d) for d in range(min(local, count))), np.zeros((count, count)))
    dense = dense + np.triu(dense, 1).T
    fixed = np.unique(rng.integers(0, count, count // 4)).astype(np.int64)
    free = np.setdiff1d(np.arange(count), fixed)
    b = rng.normal(size=count)
    expected = np.zeros(count)
    expected[free] = np.linalg.solve(dense[np.ix_(free, free)], b[free])
    smallest = core.method_factor(count, local, fixed.size, fixed, band)
    core.method_solve(count, local, fixed.size, fixed, band, b)
    np.testing.assert_allclose(b, expected, rtol=1e-12, atol=1e-14)
    pivots = np.diag(np.linalg.cholesky(dense[np.ix_(free, free)])) ** 2
    assert smallest == pytest.approx(min(pivots.min(), 1.0 if fixed.size else np.inf), rel=1e-12)


@pytest.mark.parametrize("wrong", [-1.0, 0.0, np.nan])
def test_a_matrix_without_a_factor_is_told(wrong):
    band = np.ones((5, 2)) * np.array([2.0, 0.1])
    band[3, 0] = wrong
    assert core.method_factor(5, 2, 0, np.empty(0, dtype=np.int64), band) == -1.0
