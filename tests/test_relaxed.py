"""The convex relaxation against IPOPT on the same problem."""

from __future__ import annotations

import numpy as np
import pytest

from planner import Limits, load_curve, load_limits
from planner.constraints import Constraints, build
from planner.grid import place_knots, scan, with_blends
from planner.sections import cut
from planner.solvers import nlp, optimal
from planner.solvers.relaxed import relaxed_time


def problem_of(name: str, limits: Limits, intervals: int) -> Constraints:
    curve = load_curve(name)
    section = cut(curve, limits, 0.0, 0.0, exact_stop=False)[0]
    guess = scan(section, limits, intervals)
    section = with_blends(section, guess)
    return build(section, limits, place_knots(section, guess, intervals), guess)[0]


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("teardrop", Limits(300.0, [250.0] * 2, [1000.0] * 2, [20000.0] * 2)),
        ("butterfly-nurbs", Limits(250.0, [np.inf] * 2, [2000.0] * 2, [20000.0] * 2)),
        ("flank", load_limits("five-axis")),
    ],
)
def test_relaxation_agrees_with_ipopt(name: str, limits: Limits) -> None:
    problem = problem_of(name, limits, 120)
    solution = optimal.solve(problem, optimal.start_from(problem, problem.guess))
    assert solution.iterate is not None
    ours = relaxed_time(problem, solution.iterate.z)
    assert ours == pytest.approx(nlp.relaxed_time(problem), rel=2e-5)
    assert ours <= solution.time


def test_relaxation_is_lower_where_the_motion_profits_from_a_false_pace() -> None:
    problem = problem_of("flank", load_limits("five-axis"), 120)
    solution = optimal.solve(problem, optimal.start_from(problem, problem.guess))
    assert solution.iterate is not None
    assert relaxed_time(problem, solution.iterate.z) < 0.99 * solution.time
