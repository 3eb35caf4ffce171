"""Limits with bounds of two sizes, as a motor under gravity has them, in every solver and measure."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from cases import MILL, ellipse
from problems import problem_of

from planner import load_curve
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.limit_rows import LimitRow, limit_rows
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.plan.rows import GridRows
from planner.plan.sensitivity import SpeedBound, saved_by_one_percent
from planner.plan.solvers import interior, ipopt
from planner.plan.utilisation import utilisation
from planner.quantity import ACCELERATION, JERK

INF = np.inf


def both(problem):
    ours = interior.solve_interior(problem, interior.start_from(problem, problem.guess), tolerance=1e-8)
    return ours, ipopt.solve_nlp(problem)


def tilted(rows: GridRows, up: float, down: float) -> GridRows:
    """The same rows with the bounds up and -down in place of 1 and -1."""
    return replace(rows, of=tuple(replace(row, lower=-down * row.scale, upper=up * row.scale) for row in rows.of))


def mirrored(rows: GridRows) -> GridRows:
    """The same limits on the negative of each row."""
    of = tuple(replace(row, lower=-row.upper, upper=-row.lower) for row in rows.of)
    return replace(rows, of=of, given=-rows.r)


PROBLEMS = {
    "circle": lambda: problem_of(load_curve("circle"), MILL, 80),
    "teardrop": lambda: problem_of(load_curve("teardrop"), MILL, 80, start=30.0, end=60.0),
    "closed": lambda: problem_of(ellipse(), MILL, 80, periodic=True),
}


@pytest.mark.parametrize(("up", "down"), [(1.0, 0.5), (0.4, 1.0), (1.3, 0.8), (INF, 0.6), (0.6, INF)])
@pytest.mark.parametrize("name", PROBLEMS)
def test_both_solvers_find_the_same_optimum(name, up, down):
    plain = PROBLEMS[name]()
    problem = replace(plain, acceleration=tilted(plain.acceleration, up, down), jerk=tilted(plain.jerk, down, 0.9 * up))
    ours, reference = both(problem)
    assert ours.time == pytest.approx(reference.time, rel=3e-6)
    used = problem.used(ours.x, ours.a, ours.c)
    assert used.max() <= 1.0 + 1e-6
    assert abs(ours.time / both(plain)[0].time - 1.0) > 1e-3  # the bounds do matter
    turned = replace(problem, acceleration=mirrored(problem.acceleration), jerk=mirrored(problem.jerk))
    assert both(turned)[0].time == pytest.approx(ours.time, rel=3e-6)


def test_a_multiplier_belongs_to_the_limit_its_row_names():
    """The order of the rows says nothing: shuffled, every limit keeps its worth."""
    plain = PROBLEMS["teardrop"]()
    names = ("feed",)
    bound = SpeedBound(names, np.zeros(plain.cap.size, dtype=np.uint8), np.ones(plain.cap.size, dtype=np.float32))

    def worth(problem):
        solution = interior.solve_interior(problem, interior.start_from(problem, problem.guess), tolerance=1e-9)
        return saved_by_one_percent(solution.iterate, bound)

    def turned(rows):
        return GridRows(rows.of[::-1], np.ascontiguousarray(rows.r[::-1]))

    first = worth(plain)
    second = worth(replace(plain, acceleration=turned(plain.acceleration), jerk=turned(plain.jerk)))
    assert {"acceleration X", "acceleration Y", "jerk X", "jerk Y"} <= set(first)
    assert first == pytest.approx(second, rel=1e-5)
    assert len(set(first.values())) == len(first)


@pytest.fixture(params=["one row", "a row without an upper bound beside it"])
def gravity(request, monkeypatch):
    """The acceleration of X may be 1000 mm/s^2 forwards and 250 backwards."""

    def rows(limits: Limits) -> tuple[LimitRow, ...]:
        found = []
        for row in limit_rows(limits):
            weaker = replace(row, lower=0.25 * row.lower)
            if row.quantity is not ACCELERATION or row.axis != "X":
                found.append(row)
            elif request.param == "one row":
                found.append(weaker)
            else:
                found += [row, replace(weaker, upper=INF)]
        return tuple(found)

    for module in ("planner.plan.rows", "planner.plan.utilisation", "planner.profile"):
        monkeypatch.setattr(import_module(module), "limit_rows", rows)


@pytest.mark.parametrize("method", ["optimal", "toppra"])
@pytest.mark.parametrize("length", [5.0, 60.0])
def test_a_line_without_jerk_speeds_up_and_slows_down_as_each_bound_lets_it(gravity, method, length):
    curve = NurbsCurve([[0.0, 0.0], [length, 0.0]], [0, 0, 1, 1], 1)
    profile = plan_feedrate(curve, Limits(100.0, INF, [1000.0, INF], INF), method=method)
    peak = min(100.0, np.sqrt(2.0 * length / (1.0 / 1000.0 + 1.0 / 250.0)))
    ramps = peak / 1000.0 + peak / 250.0
    exact = ramps + (length - 0.5 * peak * ramps) / peak
    assert profile.duration == pytest.approx(exact, rel=1e-4)
    assert profile.acceleration.max() == pytest.approx(1000.0, rel=1e-3)
    assert profile.acceleration.min() == pytest.approx(-250.0, rel=1e-3)


def test_a_line_with_jerk_keeps_both_bounds_and_uses_both(gravity):
    curve = NurbsCurve([[0.0, 0.0], [60.0, 0.0]], [0, 0, 1, 1], 1)
    limits = Limits(100.0, INF, [1000.0, INF], [20000.0, INF])
    profile = plan_feedrate(curve, limits, intervals=300)
    # ramps of s-curves: v / A + A / J each, and half of the feed on average
    up, down = 100.0 / 1000.0 + 1000.0 / 20000.0, 100.0 / 250.0 + 250.0 / 20000.0
    exact = up + down + (60.0 - 50.0 * (up + down)) / 100.0
    assert exact * (1.0 - 1e-7) <= profile.duration <= exact * (1.0 + 1e-3)
    assert profile.acceleration.max() == pytest.approx(1000.0, rel=1e-3)
    assert profile.acceleration.min() == pytest.approx(-250.0, rel=1e-3)
    used = utilisation(curve, limits, TimeLaw(profile.t, profile.u, profile.u_rate, profile.u_acceleration))
    assert used.acceleration.max() == pytest.approx(1.0, abs=2e-3)
    held = {profile.limit_names[k] for k in profile.binding[profile.acceleration < -249.9]}
    assert "acceleration X" in held


def test_rows_are_those_of_the_finite_limits():
    limits = Limits(9.0, [1.0, INF], [INF, 2.0], [3.0, 4.0], tangential_jerk=5.0)
    rows = limit_rows(limits)
    assert [row.name for row in rows] == ["velocity X", "acceleration Y", "jerk X", "jerk Y", "tangential jerk"]
    assert [row.motion for row in rows] == [0, 1, 0, 1, 2]
    assert [row.order for row in rows] == [1, 2, 3, 3, 3]
    assert [(row.lower, row.upper) for row in rows] == [(-most, most) for most in (1.0, 2.0, 3.0, 4.0, 5.0)]
    assert {row.bounds for row in rows} == {(-1.0, 1.0)}
    assert rows[2].quantity is JERK
