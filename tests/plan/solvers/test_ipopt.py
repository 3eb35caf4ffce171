"""IPOPT on the same problem: the reference, and our solver against it on paths neither was made for."""

import numpy as np
import pytest
from cases import MILL, drives, ellipse
from problems import problem_of
from strategies import random_nurbs

from planner import load_curve
from planner.errors import SolverError
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.plan.solvers import interior as optimal
from planner.plan.solvers import ipopt as nlp
from planner.status import Status
from planner.verify import check


def both(problem):
    ours = optimal.solve_interior(problem, optimal.start_from(problem, problem.guess), tolerance=1e-8)
    return ours, nlp.solve_nlp(problem)


@pytest.mark.parametrize("seed", range(32))
def test_both_solvers_find_the_same_optimum_on_random_paths(seed):
    rng = np.random.default_rng(seed)
    degree, dim = int(rng.integers(2, 6)), int(rng.integers(2, 5))
    curve = random_nurbs(seed, degree, dim, spans=int(rng.integers(1, 4)))
    rows = rng.uniform(50.0, 400.0, dim), rng.uniform(300.0, 3000.0, dim), rng.uniform(5e3, 6e4, dim)
    limits = Limits(float(rng.choice([60.0, 200.0, np.inf])), *rows, chord_error=1e-3)
    ours, reference = both(problem_of(curve, limits, 80))
    assert ours.time == pytest.approx(reference.time, rel=2e-6)
    assert ours.x == pytest.approx(reference.x, rel=2e-2, abs=1e-3 * reference.x.max())


VARIANTS = {
    "tangential limits": lambda: problem_of(
        load_curve("teardrop"),
        drives(tangential_acceleration=300.0, tangential_jerk=4000.0),
        80,
    ),
    "feeds at the ends": lambda: problem_of(load_curve("teardrop"), MILL, 80, start=30.0, end=60.0),
    "closed": lambda: problem_of(ellipse(), MILL, 80, periodic=True),
    "double knots": lambda: problem_of(load_curve("circle"), MILL, 80),
    "jerk alone": lambda: problem_of(ellipse(), drives(np.inf, velocity=np.inf, acceleration=np.inf), 80),
    "one jerk": lambda: problem_of(ellipse(), drives(jerk=[np.inf, 20000.0]), 80),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_both_solvers_agree_on_every_kind_of_problem(name):
    problem = VARIANTS[name]()
    ours, reference = both(problem)
    assert ours.time == pytest.approx(reference.time, rel=2e-6)
    for solution in (ours, reference):
        for value, at in ((problem.start, 0), (problem.end, -1)):
            if not np.isnan(value):
                assert solution.x[at] == pytest.approx(value, rel=1e-9)
        if problem.periodic:
            assert solution.a[0] == pytest.approx(solution.a[-1], abs=1e-6)
    assert reference.status is Status.OPTIMAL


@pytest.mark.parametrize(("length", "duration"), [(5.0, 4.0 * 1000.0 / 20000.0), (60.0, 0.75)])
def test_a_line_takes_the_time_of_the_s_curve(length, duration):
    """5 mm reach 1000 mm/s^2 just so; 60 mm reach 100 mm/s, 0.15 s and 7.5 mm from either end."""
    curve = NurbsCurve([[0.0, 0.0], [length, 0.0]], [0, 0, 1, 1], 1)
    profile = plan_feedrate(curve, MILL, method="nlp", intervals=120)
    assert profile.method == "nlp"
    assert duration * (1.0 - 1e-7) <= profile.duration <= duration * (1.0 + 1e-3)
    report = check(curve, MILL, profile)
    assert report.ok, str(report)


def test_reference_plans_keep_every_limit():
    curve = load_curve("circle")
    profile = plan_feedrate(curve, MILL, method="nlp", intervals=150)
    report = check(curve, MILL, profile)
    assert report.ok, str(report)
    assert profile.duration == pytest.approx(3.2916, rel=2e-3)


def test_contradicting_ends_are_told_in_ipopts_words():
    curve = NurbsCurve([[0.0, 0.0], [1.0, 0.0]], [0, 0, 1, 1], 1)
    with pytest.raises(SolverError, match=r"IPOPT stopped after .* iterations: .*; try another number of intervals"):
        nlp.solve_nlp(problem_of(curve, MILL, 40, start=90.0, end=5.0))


def test_steps_that_ipopt_takes_back_are_no_words_to_the_user(capfd):
    """On its way it tries squares of speeds below 0, whose roots are no numbers."""
    curve = NurbsCurve([[0.0, 0.0], [0.5, 0.0]], [0, 0, 1, 1], 1)
    with pytest.raises(SolverError, match="Infeasible"):
        nlp.solve_nlp(problem_of(curve, MILL, 24, start=60.0))
    assert capfd.readouterr() == ("", "")


def test_relaxation_is_a_lower_bound():
    problem = problem_of(load_curve("teardrop"), MILL, 80)
    ours, reference = both(problem)
    bound = nlp.relaxed_time(problem)
    assert bound <= min(ours.time, reference.time) * (1.0 + 1e-7)
    assert bound >= 0.99 * reference.time
