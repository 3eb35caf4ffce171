"""The interior-point method: closed forms, the conditions of an optimum, and what must not change the optimum."""

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest
from cases import drives, ellipse, line, s_curve_time
from problems import problem_of

from planner import load_curve
from planner.errors import SolverError
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.plan.collocation import states_between
from planner.plan.solvers import interior as optimal
from planner.status import Status

FREE = np.inf


def solved(problem, **options):
    return optimal.solve_interior(problem, optimal.start_from(problem, problem.guess), **options)


def states(problem, solution):
    """x, a, c at all points, the ones between by the cubic of an interval."""
    return states_between(problem.h, np.stack([solution.x, solution.a, solution.c]), problem.inner)


def started(problem, x):
    """x, a, c of a start at all points."""
    return states_between(problem.h, optimal.start_from(problem, x), problem.inner)


def shares(problem, z):
    """Shares of the limits used at all points: (m, points)."""
    used = [z[0] / problem.cap]
    used += [np.abs(row[0] * z[0] + row[1] * z[1]) for row in problem.acceleration.r]
    used += [np.abs(row[0] * z[0] + row[1] * z[1] + row[2] * z[2]) * np.sqrt(z[0]) for row in problem.jerk.r]
    return np.array(used)


# ---- closed forms --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [1e-6, 0.05, 1.0, 4.9, 5.1, 14.0, 16.0, 60.0])
def test_a_line_takes_the_time_of_the_s_curve(length):
    """5 mm reach 1000 mm/s^2 just so, 15 mm reach 100 mm/s."""
    exact = s_curve_time(length, 100.0, 1000.0, 20000.0)
    found = plan_feedrate(line(length, 0.0), drives()).duration
    assert exact * (1.0 - 1e-7) <= found <= exact * (1.0 + 1e-4)


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e5])
def test_a_line_limited_by_jerk_alone(length):
    found = plan_feedrate(line(length, 0.0), drives(FREE, velocity=FREE, acceleration=FREE)).duration
    assert found == pytest.approx(np.cbrt(32.0 * length / 20000.0), rel=5e-5)


def test_the_axis_that_needs_longest_decides_on_a_slanted_line():
    curve = line(30.0, 40.0, 0.0)
    limits = Limits(FREE, [100.0, 250.0, 1.0], [1000.0] * 3, [20000.0, 50000.0, 1.0])
    # along the line every axis limit divided by its share of the direction
    exact = s_curve_time(50.0, 100.0 / 0.6, 1000.0 / 0.8, 20000.0 / 0.6)
    assert plan_feedrate(curve, limits).duration == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("feed", [50.0, 130.0])
def test_a_circle_run_continuously(feed):
    circle = ellipse(20.0, 20.0)
    profile = plan_feedrate(circle, drives(feed), periodic=True)
    assert profile.duration == pytest.approx(40.0 * np.pi / feed, rel=5e-6)
    assert profile.feed == pytest.approx(np.full(profile.feed.size, feed), rel=1e-5)


def test_a_circle_too_fast_for_its_curvature_is_run_at_the_feed_the_axes_allow():
    """At constant feed v on a radius r the axes feel v^2 / r; the path may use the other axis where one is spent."""
    circle = ellipse(20.0, 20.0)
    profile = plan_feedrate(circle, drives(300.0), periodic=True)
    assert profile.duration < 40.0 * np.pi / np.sqrt(20.0 * 1000.0)
    assert profile.feed.min() >= np.sqrt(20.0 * 1000.0) * (1.0 - 1e-4)


# ---- the discretised problem ---------------------------------------------------------------------------------------

PROBLEMS = {
    "teardrop": lambda: problem_of(load_curve("teardrop"), drives(300.0)),
    "circle": lambda: problem_of(load_curve("circle"), drives()),
    "butterfly-nurbs": lambda: problem_of(load_curve("butterfly-nurbs"), drives(250.0), 300),
    "tangential": lambda: problem_of(
        load_curve("teardrop"), drives(tangential_acceleration=300.0, tangential_jerk=4000.0)
    ),
    "feeds at the ends": lambda: problem_of(load_curve("teardrop"), drives(), start=30.0, end=60.0),
    "closed": lambda: problem_of(ellipse(), drives(), periodic=True),
    "jerk alone": lambda: problem_of(line(10.0, 5.0), drives(FREE, velocity=FREE, acceleration=FREE)),
}


@pytest.fixture(scope="module", params=PROBLEMS)
def case(request):
    problem = PROBLEMS[request.param]()
    return problem, solved(problem, tolerance=1e-7)


def test_solution_keeps_every_limit_and_uses_one_almost_everywhere(case):
    problem, solution = case
    used = shares(problem, states(problem, solution))
    assert used.max() <= 1.0 + 1e-8
    at_knots = used[:, ::2].max(axis=0)
    assert np.mean(at_knots > 0.99) > 0.6  # where the jerk of no axis is at its limit it changes sign


def test_solution_is_a_cubic_spline(case):
    problem, solution = case
    h, x, a, c = problem.h, solution.x, solution.a, solution.c
    scale = np.abs(x).max()
    assert x[1:] == pytest.approx(x[:-1] + 2 * h * a[:-1] + h**2 * (2 * c[:-1] + c[1:]) / 3, abs=1e-9 * scale)
    assert a[1:] == pytest.approx(a[:-1] + 0.5 * h * (c[:-1] + c[1:]), abs=1e-9 * np.abs(a).max())


def test_solution_reports_its_simpson_time_and_its_gap(case):
    problem, solution = case
    z = states(problem, solution)
    counts = problem.weight > 0.0
    assert solution.time == pytest.approx(problem.weight[counts] @ z[0, counts] ** -0.5, rel=1e-10)
    assert solution.status is Status.OPTIMAL
    assert 0.0 <= solution.gap <= 1e-7
    assert solution.iterations < 60


def test_ends_are_as_prescribed(case):
    """A feed asked for is kept; where none is asked for a fastest plan uses up a limit from the first point to the last."""
    problem, solution = case
    used = shares(problem, states(problem, solution)).max(axis=0)
    for value, at in ((problem.start, 0), (problem.end, -1)):
        if np.isnan(value):
            assert used[at] > 0.99
        else:
            assert solution.x[at] == pytest.approx(value, rel=1e-13)
    if problem.periodic:
        for values in (solution.x, solution.a, solution.c):
            assert values[-1] == pytest.approx(values[0], abs=1e-9 * np.abs(values).max())


def simpson_time(problem, z):
    counts = problem.weight > 0.0
    return problem.weight[counts] @ z[0, counts] ** -0.5


def feasible_times(problem, inside, count=30):
    """Times of plans at the border of what is feasible, in random directions from a plan ``inside`` (3, p)."""
    rng = np.random.default_rng(1)
    knots = np.concatenate([[0.0], np.cumsum(problem.h)]) / problem.h.sum()
    level = started(problem, inside[0, ::2])
    free = np.isnan([problem.start, problem.end]).all()
    times = []
    for _ in range(count):
        bump = 1.0 + 0.05 * rng.normal(size=4) @ np.cos(np.pi * np.outer(np.arange(1, 5), knots))
        change = started(problem, inside[0, ::2] * bump) - level  # nothing at an end that is prescribed
        lo, hi = 0.0, 1.0
        for _ in range(30):
            share = 0.5 * (lo + hi)
            z = inside + share * change
            lo, hi = (share, hi) if z[0].min() > 0.0 and shares(problem, z).max() <= 1.0 else (lo, share)
        z = inside + lo * change
        if free:  # the whole plan may be run faster as well
            used = shares(problem, z)
            z /= max(used[: 1 + len(problem.acceleration)].max(), used.max() ** (2.0 / 3.0))
        assert lo > 0.0
        assert shares(problem, z).max() <= 1.0 + 1e-9
        times.append(simpson_time(problem, z))
    return np.array(times)


def test_no_feasible_change_saves_time(case):
    """No plan near the optimum is faster; near a plan that leaves 1 % of its limits unused many are faster than that."""
    problem, solution = case
    narrow = replace(
        problem, cap=problem.cap / 1.01, acceleration=problem.acceleration.times(1.01), jerk=problem.jerk.times(1.01)
    )
    wasteful = states(problem, solved(narrow))
    times = feasible_times(problem, wasteful)
    assert times.size == 30
    assert (times >= simpson_time(problem, states(problem, solution)) * (1.0 - 1e-6)).all()
    assert np.count_nonzero(times < simpson_time(problem, wasteful)) >= 5


def test_tolerance_bounds_the_loss():
    problem = PROBLEMS["teardrop"]()
    times = {tolerance: solved(problem, tolerance=tolerance).time for tolerance in (1e-2, 1e-4, 1e-8)}
    for tolerance, time in times.items():
        assert times[1e-8] * (1.0 - 1e-9) <= time <= times[1e-8] * (1.0 + 2.0 * tolerance)


def test_a_deadline_ends_at_a_feasible_point():
    problem = PROBLEMS["butterfly-nurbs"]()
    early = solved(problem, deadline=perf_counter())
    assert early.status is Status.BUDGET
    assert shares(problem, states(problem, early)).max() <= 1.0 + 1e-8
    assert solved(problem).time <= early.time <= 2.0 * solved(problem).time


def test_progress_is_told_and_ends_complete():
    said = []
    solved(PROBLEMS["teardrop"](), progress=lambda text, share: said.append((text, share)))
    assert [text for text, _ in said] == ["solving"] * len(said)
    assert said[-1][1] == 1.0
    assert max(share for _, share in said) == 1.0


def test_feeds_that_cannot_be_joined_are_an_error():
    with pytest.raises(SolverError, match="may not be attainable"):
        solved(problem_of(line(1.0, 0.0), drives(), start=90.0, end=5.0))


def test_another_start_leads_to_the_same_optimum():
    problem = PROBLEMS["teardrop"]()
    reference = solved(problem, tolerance=1e-7).time
    for guess in (np.full(problem.guess.size, 1e-3), problem.guess * np.linspace(0.2, 1.0, problem.guess.size)):
        assert optimal.solve_interior(
            problem, optimal.start_from(problem, guess), tolerance=1e-7
        ).time == pytest.approx(reference, rel=1e-6)


@pytest.mark.parametrize("name", ["teardrop", "feeds at the ends", "closed", "circle"])
def test_a_start_is_a_positive_spline_with_the_ends_asked_for(name):
    problem = PROBLEMS[name]()
    rng = np.random.default_rng(0)
    z = started(problem, rng.uniform(0.01, 2.0, problem.guess.size))
    assert (z[0] > 0.0).all()
    h, (x, a, c) = problem.h, z[:, ::2]
    assert x[1:] == pytest.approx(x[:-1] + 2 * h * a[:-1] + h**2 * (2 * c[:-1] + c[1:]) / 3, abs=1e-9)
    assert a[1:] == pytest.approx(a[:-1] + 0.5 * h * (c[:-1] + c[1:]), abs=1e-9)
    inner = np.flatnonzero(h > 0.0)
    assert z[0, 2 * inner + 1] == pytest.approx((x[:-1] + h * a[:-1] + h**2 * (5 * c[:-1] + c[1:]) / 24)[inner])
    for value, at in ((problem.start, 0), (problem.end, -1)):
        if not np.isnan(value):
            assert z[0, at] == pytest.approx(value)
    if problem.periodic:
        assert z[:, 0] == pytest.approx(z[:, -1], abs=1e-9)


# ---- what must not change the plan ---------------------------------------------------------------------------------


# ---- what leaves the planner keeps its limits ----------------------------------------------------------------------


# ---- ends ----------------------------------------------------------------------------------------------------------


# ---- axes with other limits, or none -------------------------------------------------------------------------------
