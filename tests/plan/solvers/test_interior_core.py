"""The compiled interior-point method against plain numpy with dense linear algebra, iteration by iteration."""

from dataclasses import replace

import numpy as np
import pytest
from interior_reference import Reference

from planner.machine.limit_rows import limit_rows
from planner.machine.limits import Limits
from planner.plan.collocation import time_weights
from planner.plan.rows import Constraints, GridRows
from planner.plan.solvers import interior as optimal
from planner.status import Status

NAN = np.nan


def random_problem(seed, inner, **options):
    """Random rows on random intervals, double knots among them; feasible for slow plans."""
    rng = np.random.default_rng(seed)
    n = options.pop("intervals", int(rng.integers(5, 12)))
    h = rng.uniform(0.5, 1.5, n)
    h[rng.choice(np.arange(1, n - 1, 2), 2, replace=False)] = 0.0
    points = (inner + 1) * n + 1
    kinds = limit_rows(Limits(100.0, [1.0] * 2, [1.0] * 2, [1.0] * 2))
    accelerations = tuple(row for row in kinds if row.order == 2)
    jerks = tuple(row for row in kinds if row.order == 3)
    if options.pop("uneven", False):
        accelerations = tuple(replace(row, lower=-0.7, upper=1.2) for row in accelerations)
        jerks = (replace(jerks[0], upper=np.inf), replace(jerks[1], lower=-0.5))
    smooth = np.cos(rng.uniform(0.0, 2.0, (20, 1)) * np.linspace(0.0, 3.0, points) + rng.uniform(0.0, 6.0, (20, 1)))
    size = np.array([0.5, 1.0, 0.5, 1.0, 0.3, 0.8, 1.5, 0.3, 0.8, 1.5])[:, None]
    r = size * smooth[:10]
    given = {"start": NAN, "end": NAN, "start_slope": NAN, "periodic": False} | options
    return Constraints(
        h=h,
        cap=np.exp(smooth[10]) * np.where(rng.uniform(size=points) < 0.1, np.inf, 1.0),
        acceleration=GridRows(accelerations, np.ascontiguousarray(r[:4].reshape(2, 2, points))),
        jerk=GridRows(jerks, np.ascontiguousarray(r[4:].reshape(2, 3, points))),
        weight=time_weights(h, inner),
        guess=np.exp(0.3 * rng.normal(size=n + 1)),
        length_unit=1.0,
        time_unit=1.0,
        inner=inner,
        **given,
    )


ENDS = {
    "free": {},
    "feeds": {"start": 0.2, "end": 0.3},
    "a feed and a slope": {"start": 0.2, "start_slope": 0.02},
    "a feed at the end": {"end": 0.1},
    "periodic": {"periodic": True},
    "uneven bounds": {"uneven": True},
    "several blocks": {"intervals": 70},
    "a last knot alone in its block": {"intervals": 64},
}


def sides(iterate):
    """Slacks and multipliers (sides, p) of an iterate."""
    pairs = iterate.pairs.astype(np.float64).transpose(2, 1, 0, 3)
    return pairs.reshape(2, pairs.shape[1], -1)[:, :, : iterate.problem.cap.size].copy()


def reference_of(iterate):
    return Reference(iterate.problem, iterate.z.copy(), *sides(iterate))


def agree(iterate, reference, rel):
    scale = np.abs(reference.z).max(axis=1, keepdims=True)
    assert iterate.z / scale == pytest.approx(reference.z / scale, abs=rel)
    slack, dual = sides(iterate)
    assert slack == pytest.approx(reference.slack, rel=1e3 * rel, abs=rel)
    assert dual == pytest.approx(reference.dual, rel=1e3 * rel, abs=rel)
    gap, time, residual = reference.totals
    assert iterate.gap == pytest.approx(gap, rel=1e2 * rel)
    assert iterate.time == pytest.approx(time, rel=1e2 * rel)
    # slacks are kept with 24 bits, and what is violated is their difference from the true ones
    assert iterate.residual == pytest.approx(residual, rel=2.0**-23, abs=1e2 * rel)


def begun(problem):
    return optimal.Iterate(problem, optimal.start_from(problem, problem.guess), 1.0, 0.95)


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("inner", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_iterations_are_those_of_the_dense_system(seed, inner, ends):
    """From the start, and again further on; the recursion and the dense system may differ by rounding alone."""
    iterate = begun(random_problem(seed, inner, **ENDS[ends]))
    for _ in range(3):
        reference = reference_of(iterate)
        ended = iterate.run(0.0, 1)
        assert ended is None
        reference.iterate()
        agree(iterate, reference, 1e-9)
        iterate.run(0.0, 2)


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("inner", [1, 3])
def test_negative_curvature_is_dropped_where_the_system_is_not_positive_definite(inner, ends):
    """Multipliers of the jerk that outweigh the objective; the dense system drops it by its eigenvalues."""
    clipped = 0
    for seed in range(4):
        iterate = begun(random_problem(seed, inner, **ENDS[ends]))
        first = 1 + 2 * len(iterate.problem.acceleration)
        iterate.pairs[:, first:, 1] *= 40.0
        iterate.pairs[:, first:, 0] *= 20.0
        reference = reference_of(iterate)
        iterate._totals[:2] = reference.totals[:2]
        assert iterate.run(0.0, 1) is None
        reference.iterate()
        agree(iterate, reference, 1e-8)
        clipped += reference.clipped
    assert clipped > 0


@pytest.mark.parametrize("inner", [1, 3])
def test_iterations_one_by_one_are_those_of_one_call(inner):
    problem = random_problem(3, inner, intervals=70)
    one, many = begun(problem), begun(problem)
    for _ in range(7):
        one.run(0.0, 1)
    many.run(0.0, 7)
    assert (one.z == many.z).all()
    assert (one.pairs == many.pairs).all()
    assert one.iterations == many.iterations == 7


@pytest.mark.parametrize("inner", [1, 3])
def test_tightened_rows_are_the_rows_times_the_factors(inner):
    """To the last bit, of each kind alone and of both."""
    problem = random_problem(6, inner, intervals=70)
    by = 1.0 + 0.1 * np.random.default_rng(6).uniform(size=(2, problem.cap.size))
    for kinds in (("acceleration",), ("jerk",), ("acceleration", "jerk")):
        rows = {kind: getattr(problem, kind) for kind in kinds}
        tightened = replace(
            problem, **{kind: rows[kind].times(factor) for kind, factor in zip(kinds, by, strict=False)}
        )
        scaled = replace(
            problem,
            **{kind: GridRows(rows[kind].of, rows[kind].r * factor) for kind, factor in zip(kinds, by, strict=False)},
        )
        first, second = begun(tightened), begun(scaled)
        for iterate in (first, second):
            iterate.run(0.0, 5)
        assert (first.z == second.z).all()
        assert (first.pairs == second.pairs).all()
        assert (first.z != begun(problem).z).any()


@pytest.mark.parametrize("inner", [1, 3])
def test_solving_again_gives_the_same_bytes(inner):
    problem = random_problem(5, inner, intervals=70)
    first, second = (
        optimal.solve_interior(problem, optimal.start_from(problem, problem.guess), tolerance=1e-8) for _ in range(2)
    )
    assert first.status is Status.OPTIMAL
    assert first.x.tobytes() == second.x.tobytes()
    assert first.c.tobytes() == second.c.tobytes()


def test_memory_given_back_is_built_again():
    problem = random_problem(4, 3)
    kept, given_back = begun(problem), begun(problem)
    for iterate in (kept, given_back):
        iterate.run(0.0, 3)
    given_back.release()
    for iterate in (kept, given_back):
        assert iterate.run(1e-7, 60) is Status.OPTIMAL
    assert given_back.z == pytest.approx(kept.z, rel=1e-9)
    assert given_back.iterations == kept.iterations


def test_a_step_that_is_not_finite_is_not_taken():
    iterate = begun(random_problem(1, 1))
    iterate.pairs[:, 0, 0, 3] = 0.0
    before = iterate.z.copy()
    assert iterate.run(1e-6, 5) in {Status.SINGULAR, Status.NO_STEP}
    assert (iterate.z == before).all()


def test_a_waypoint_is_continued_with_its_multipliers():
    problem = random_problem(2, 3, intervals=70)
    iterate = begun(problem)
    iterate.run(1e-3, 50)
    again = optimal.Iterate(problem, iterate.waypoint(), 1.0, 0.95)
    assert again.z / iterate.z == pytest.approx(np.broadcast_to((again.z / iterate.z)[0, 0], again.z.shape), rel=1e-12)
    assert sides(again)[1] == pytest.approx(sides(iterate)[1], rel=1e-6)
    assert again.gap == pytest.approx(float(np.prod(sides(again), axis=0).sum()), rel=1e-12)
    cold = begun(problem)
    for it in (again, cold):
        assert it.run(1e-7, 60) is Status.OPTIMAL
    assert again.iterations < cold.iterations
    assert again.time == pytest.approx(cold.time, rel=1e-6)
