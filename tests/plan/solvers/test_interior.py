"""The interior-point method: closed forms, the conditions of an optimum, and what must not change the optimum."""

from dataclasses import replace
from itertools import pairwise
from time import perf_counter

import numpy as np
import pytest
from cases import drives, ellipse, line, s_curve_time
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from problems import problem_of
from strategies import insert_knot, random_nurbs

from interp import replay
from planner import load_curve
from planner.errors import SolverError
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan import plan_feedrate
from planner.plan.solvers import interior as optimal
from planner.status import Status
from planner.verify import check

FREE = np.inf


def reversed_nurbs(curve):
    u0, u1 = curve.domain
    return NurbsCurve(
        curve.control_points[::-1], (u0 + u1 - curve.knots)[::-1], curve.degree, curve.weights[::-1], curve.axes
    )


def moved_parameter(curve, factor, shift):
    return NurbsCurve(curve.control_points, factor * curve.knots + shift, curve.degree, curve.weights, curve.axes)


def solved(problem, **options):
    return optimal.solve(problem, optimal.start_from(problem, problem.guess), **options)


def states(problem, solution):
    """x, a, c at all points, the middle ones by the cubic of an interval."""
    z = np.empty((3, problem.cap.size))
    z[:, ::2] = solution.x, solution.a, solution.c
    h, (x, a, c) = problem.h, z[:, :-2:2]
    after = z[2, 2::2]
    z[0, 1::2] = x + h * a + h**2 * (5.0 * c + after) / 24.0
    z[1, 1::2] = a + h * (3.0 * c + after) / 8.0
    z[2, 1::2] = 0.5 * (c + after)
    return z


def shares(problem, z):
    """Shares of the limits used at all points: (m, points)."""
    used = [z[0] / problem.cap]
    used += [np.abs(row[0] * z[0] + row[1] * z[1]) for row in problem.acceleration]
    used += [np.abs(row[0] * z[0] + row[1] * z[1] + row[2] * z[2]) * np.sqrt(z[0]) for row in problem.jerk]
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
    level = optimal.start_from(problem, inside[0, ::2])
    free = np.isnan([problem.start, problem.end]).all()
    times = []
    for _ in range(count):
        bump = 1.0 + 0.05 * rng.normal(size=4) @ np.cos(np.pi * np.outer(np.arange(1, 5), knots))
        change = optimal.start_from(problem, inside[0, ::2] * bump) - level  # nothing at an end that is prescribed
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
        problem, cap=problem.cap / 1.01, acceleration=problem.acceleration * 1.01, jerk=problem.jerk * 1.01
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
        assert optimal.solve(problem, optimal.start_from(problem, guess), tolerance=1e-7).time == pytest.approx(
            reference, rel=1e-6
        )


@pytest.mark.parametrize("name", ["teardrop", "feeds at the ends", "closed", "circle"])
def test_a_start_is_a_positive_spline_with_the_ends_asked_for(name):
    problem = PROBLEMS[name]()
    rng = np.random.default_rng(0)
    z = optimal.start_from(problem, rng.uniform(0.01, 2.0, problem.guess.size))
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

SEEDS = st.integers(0, 2000)
NO_SHRINKING = (Phase.explicit, Phase.generate)  # a smaller seed is not a simpler path


def random_case(seed):
    rng = np.random.default_rng(seed)
    degree, dim = int(rng.integers(3, 6)), int(rng.integers(2, 4))
    curve = random_nurbs(seed, degree, dim, spans=int(rng.integers(1, 5)), rational=bool(rng.integers(2)))
    limits = Limits(
        float(rng.choice([60.0, 200.0, FREE])),
        rng.uniform(50.0, 400.0, dim),
        rng.uniform(300.0, 3000.0, dim),
        rng.uniform(5000.0, 60000.0, dim),
        chord_error=float(rng.choice([1e-3, FREE])),
    )
    return curve, limits


def duration(curve, limits, **options):
    return plan_feedrate(curve, limits, **options).duration


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS)
def test_reversing_the_path_leaves_the_duration(seed):
    curve, limits = random_case(seed)
    assert duration(reversed_nurbs(curve), limits) == pytest.approx(duration(curve, limits), rel=5e-4)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.floats(0.05, 0.95))
def test_inserting_a_knot_leaves_the_duration(seed, u):
    curve, limits = random_case(seed)
    assume(np.abs(curve.knots - u).min() > 0.02)
    assert duration(insert_knot(curve, u), limits) == pytest.approx(duration(curve, limits), rel=5e-4)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from([1e-4, 3.0, 1e4]), st.sampled_from([-5.0, 0.0, 1.0]))
def test_an_affine_change_of_the_parameter_leaves_the_duration(seed, factor, shift):
    curve, limits = random_case(seed)
    moved = moved_parameter(curve, factor, factor * shift)
    assert duration(moved, limits) == pytest.approx(duration(curve, limits), rel=2e-5)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from([-18, -6, 12]))
def test_another_unit_of_length_leaves_the_plan(seed, power):
    curve, limits = random_case(seed)
    k = 2.0**power
    scaled = NurbsCurve(k * curve.control_points, curve.knots, curve.degree, curve.weights)
    other = Limits(
        k * limits.feed, k * limits.velocity, k * limits.acceleration, k * limits.jerk, k * limits.chord_error
    )
    first, second = plan_feedrate(curve, limits), plan_feedrate(scaled, other)
    assert second.duration == pytest.approx(first.duration, rel=1e-12)


@pytest.mark.parametrize("factor", [1e-6, 1e3])
def test_millimetres_to_kilometres_or_micrometres(factor):
    curve, scaled = load_curve("teardrop"), load_curve("teardrop", scale=factor)
    k = factor
    other = Limits(100 * k, [250 * k] * 2, [1000 * k] * 2, [20000 * k] * 2, chord_error=1e-3 * k)
    assert duration(scaled, other) == pytest.approx(duration(curve, drives(chord_error=1e-3)), rel=1e-9)


@settings(max_examples=4, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from([0.125, 64.0]))
def test_slower_in_proportion_takes_as_much_longer(seed, k):
    curve, limits = random_case(seed)
    slow = Limits(
        limits.feed / k,
        limits.velocity / k,
        limits.acceleration / k**2,
        limits.jerk / k**3,
        limits.chord_error,
        limits.period * k,
    )
    assert duration(curve, slow) == pytest.approx(k * duration(curve, limits), rel=1e-9)


@settings(max_examples=6, phases=NO_SHRINKING)
@given(SEEDS, st.sampled_from(["feed", "velocity", "acceleration", "jerk", "chord_error"]), st.floats(1.05, 3.0))
def test_a_wider_limit_costs_no_time(seed, which, factor):
    curve, limits = random_case(seed)
    names = ("feed", "velocity", "acceleration", "jerk", "chord_error")
    wider = Limits(*(getattr(limits, name) * (factor if name == which else 1.0) for name in names))
    assert duration(curve, wider) <= duration(curve, limits) * (1.0 + 5e-4)


@settings(max_examples=3, phases=NO_SHRINKING)
@given(SEEDS)
def test_the_same_input_gives_the_same_bits(seed):
    curve, limits = random_case(seed)
    first, second = plan_feedrate(curve, limits), plan_feedrate(*random_case(seed))
    assert all(np.array_equal(getattr(first, k), getattr(second, k)) for k in ("t", "u", "u_rate", "u_acceleration"))


# ---- what leaves the planner keeps its limits ----------------------------------------------------------------------


def require_feasible(curve, limits, profile, tightest=0.99):
    """The plan and its samples keep every limit, and use one up; limits lowered by 0.5 % are not kept."""
    report, of_samples = check(curve, limits, profile), check(curve, limits, replay(curve, profile))
    for row in (*report.rows, *of_samples.rows):
        assert row.ok, row
    assert max(row.ratio for row in report.rows if np.isfinite(row.ratio)) >= tightest
    k = 0.995
    lower = Limits(
        k * limits.feed, k * limits.velocity, k * limits.acceleration, k * limits.jerk, k * limits.chord_error
    )
    assert not check(curve, lower, profile).ok
    assert profile.lower_bound <= profile.duration * (1.0 + 1e-9)


@settings(max_examples=12, phases=NO_SHRINKING)
@given(SEEDS)
def test_plans_of_random_paths_are_feasible(seed):
    curve, limits = random_case(seed)
    profile = plan_feedrate(curve, limits)
    assert profile.status is Status.OPTIMAL
    require_feasible(curve, limits, profile)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_plans_of_many_random_paths_are_feasible(degree):
    broken = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        dim = int(rng.integers(2, 6))
        curve = random_nurbs(seed, degree, dim, spans=int(rng.choice([1, 4, 12])), repeat=int(rng.integers(1, degree)))
        rows = rng.uniform(50.0, 400.0, dim), rng.uniform(300.0, 3000.0, dim), rng.uniform(5e3, 6e4, dim)
        limits = Limits(float(rng.choice([60.0, 200.0, FREE])), *rows, period=float(rng.choice([1e-3, 4e-3])))
        profile = plan_feedrate(curve, limits)
        for report in (check(curve, limits, profile), check(curve, limits, replay(curve, profile))):
            broken += [(seed, row.limit, row.axis, row.ratio) for row in report.rows if not row.ok]
    assert broken == []


@pytest.mark.parametrize("spans", [10, 40, 160, 640, 1280])
def test_a_path_of_short_spans_with_small_curvature_jumps(spans):
    """The finer a quadratic spline follows a wave, the smaller its jumps: the plan must come close to that of the wave."""

    def wave(degree):
        s = np.linspace(0.0, 1.0, spans + degree)
        points = np.column_stack([60.0 * s, 5.0 * np.sin(6.0 * np.pi * s)])
        knots = [*[0.0] * degree, *np.linspace(0.0, 1.0, spans + 1), *[1.0] * degree]
        return NurbsCurve(points, knots, degree)

    limits = drives(chord_error=1e-3)
    profile = plan_feedrate(wave(2), limits)
    report = check(profile.curve, limits, profile)
    assert report.ok, str(report)
    assert check(profile.curve, limits, replay(profile.curve, profile)).ok
    smooth = duration(wave(3), limits)
    assert smooth <= profile.duration
    if spans >= 640:  # spans shorter than a period
        assert profile.duration <= 1.1 * smooth
    assert all(period > 0.0 for period in np.diff([b.u for b in profile.curve.breaks]))


@pytest.mark.parametrize(("spans", "period", "intervals"), [(40, 1e-4, None), (40, 1e-3, 100), (10, 1e-2, 60)])
def test_curvature_jumps_in_quick_succession(spans, period, intervals):
    """The feed falls to a fraction and rises again within a fraction of an interval of the wanted grid."""
    curve = random_nurbs(1, 2, 2, spans=spans)
    limits = drives(period=period)
    profile = plan_feedrate(curve, limits, intervals=intervals)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert check(curve, limits, replay(curve, profile)).ok
    assert profile.duration <= 1.05 * duration(curve, limits, intervals=4000)


def test_jumps_pass_within_their_share_of_the_jerk():
    w = np.sqrt(0.5)
    points = [[-20, 0], [-10, 0], [0, 0], [10, 0], [10, 10], [10, 20], [10, 30]]
    curve = NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 3, 3, 3], 2, [1, 1, 1, w, 1, 1, 1])
    limits = Limits(100.0, [250.0] * 2, [1000.0] * 2, [20000.0, 12000.0])
    profile = plan_feedrate(curve, limits)
    for b in curve.breaks:
        k = int(np.flatnonzero(profile.u == b.u)[0])
        sides = [curve.derivatives(b.u, 2, side=side) for side in ("left", "right")]
        before, after = (
            q[2] * profile.u_rate[i] ** 2 + q[1] * profile.u_acceleration[i]
            for q, i in zip(sides, (k, k + 1), strict=True)
        )
        step = np.abs(after - before) / (limits.jerk * limits.period)
        assert 0.97 * 2.0 / 3.0 <= step.max() <= 2.0 / 3.0 * (1.0 + 1e-6)
        t = profile.t[k] + limits.period * np.linspace(-3.0, 3.0, 1201)
        state = profile.at(t)
        q = curve.derivatives(state.u, 3)
        u1, u2, u3 = (v[:, None] for v in (state.u_rate, state.u_acceleration, state.u_jerk))
        jerk = np.abs(q[3] * u1**3 + 3.0 * q[2] * u1 * u2 + q[1] * u3)
        assert (jerk / limits.jerk).max() <= 0.5 * (1.0 + 1e-6)
    for phase in np.linspace(0.0, 1.0, 5):
        samples = replay(curve, profile, limits.period * (1.0 + 1e-3 * phase))
        assert check(curve, limits, samples).ok


# ---- ends ----------------------------------------------------------------------------------------------------------


@settings(max_examples=8, phases=NO_SHRINKING)
@given(SEEDS, st.floats(0.1, 1.0), st.one_of(st.just(0.0), st.floats(0.1, 1.0)))
def test_feeds_at_the_ends_are_kept_exactly(seed, start, end):
    curve, limits = random_case(seed)
    at_rest = plan_feedrate(curve, limits)
    # what a plan from rest has reached after a hundredth of the way can be braked there too
    top = [float(np.interp(share * curve.length, at_rest.s, at_rest.feed)) for share in (0.01, 0.99)]
    feeds = {"start_feed": 0.5 * start * top[0], "end_feed": 0.5 * end * top[1]}
    profile = plan_feedrate(curve, limits, **feeds)
    assert profile.feed[0] == pytest.approx(feeds["start_feed"], rel=1e-12)
    assert profile.feed[-1] == pytest.approx(feeds["end_feed"], rel=1e-12)
    assert profile.duration <= at_rest.duration * (1.0 + 5e-4)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert report.start_feed == pytest.approx(feeds["start_feed"], rel=1e-9)


@pytest.mark.parametrize("feed", [1.0, 10.0, 99.0, 100.0])
def test_a_line_entered_at_speed(feed):
    """With the acceleration free at the start it runs into the S-curve that brakes, at once or after some time."""
    profile = plan_feedrate(line(60.0, 0.0), drives(), start_feed=feed)
    at_rest = s_curve_time(60.0, 100.0, 1000.0, 20000.0)
    ramp = 0.5 * (at_rest - (60.0 - 100.0 * 0.15) / 100.0)
    assert ramp == pytest.approx(0.15)
    # from feed to 100 mm/s: at 1000 mm/s^2 from the start on, then falling at 20000 mm/s^3; shorter ramps likewise
    if 100.0 - feed >= 1000.0**2 / 20000.0 / 2.0:
        time = (100.0 - feed) / 1000.0 + 1000.0 / 20000.0 / 2.0
        fall = 1000.0 / 20000.0
        way = (time - fall) * 0.5 * (feed + 100.0 - 25.0) + 100.0 * fall - 20000.0 * fall**3 / 6.0
    else:
        time = np.sqrt(2.0 * (100.0 - feed) / 20000.0)
        way = 100.0 * time - 20000.0 * time**3 / 6.0
    exact = time + (60.0 - way - 100.0 * 0.15 / 2.0) / 100.0 + 0.15
    assert profile.duration == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("start", [0.0, 0.13, 0.4])
def test_a_closed_path_takes_as_long_from_wherever_it_is_entered(start):
    text = {"X": "30*cos(2*pi*u)", "Y": "10*sin(2*pi*u)"}
    curve = FormulaCurve(text, (start, start + 1.0))
    limits = drives()
    profile = plan_feedrate(curve, limits, periodic=True)
    reference = plan_feedrate(FormulaCurve(text, (0.0, 1.0)), limits, periodic=True, intervals=3000)
    assert profile.duration == pytest.approx(reference.duration, rel=2e-4)
    for values in (profile.feed, profile.acceleration):
        assert values[-1] == pytest.approx(values[0], abs=1e-8 * np.abs(values).max())
    assert check(curve, limits, profile).ok


def test_a_closed_path_whose_parameter_jumps_at_the_seam():
    limits = drives()
    even = FormulaCurve({"X": "20*cos(2*pi*u)", "Y": "10*sin(2*pi*u)"}, (0.0, 1.0))
    uneven = FormulaCurve({"X": "20*cos(pi*(u+u**2))", "Y": "10*sin(pi*(u+u**2))"}, (0.0, 1.0))
    first, second = (plan_feedrate(curve, limits, periodic=True) for curve in (even, uneven))
    assert second.duration == pytest.approx(first.duration, rel=2e-4)
    assert second.feed[0] == pytest.approx(second.feed[-1], rel=1e-9)
    assert second.feed[0] == pytest.approx(first.feed[0], rel=2e-3)


def test_corners_join_sections_from_stop_to_stop():
    corners = [[0.0, 0.0], [20.0, 0.0], [20.0, 7.0], [3.0, 7.0], [3.0, 3.0]]
    curve = NurbsCurve(corners, [0, 0, 1, 2, 3, 4, 4], 1)
    profile = plan_feedrate(curve, drives())
    sides = [float(np.abs(np.subtract(a, b)).sum()) for a, b in pairwise(corners)]
    exact = sum(s_curve_time(side, 100.0, 1000.0, 20000.0) for side in sides)
    assert profile.duration == pytest.approx(exact, rel=1e-4)
    assert profile.work.sections == 4
    stops = [profile.t[profile.u == u] for u in (1.0, 2.0, 3.0)]
    assert np.cumsum([s_curve_time(side, 100.0, 1000.0, 20000.0) for side in sides])[:3] == pytest.approx(
        [t[0] for t in stops], rel=1e-4
    )
    assert all(np.abs(profile.feed[profile.u == u]).max() == 0.0 for u in (1.0, 2.0, 3.0))


# ---- axes with other limits, or none -------------------------------------------------------------------------------


def test_an_axis_without_limits():
    curve = ellipse()
    limits = Limits(100.0, [FREE, 250.0], [FREE, 1000.0], [FREE, 20000.0])
    profile = plan_feedrate(curve, limits)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert profile.feed[[0, -1]].tolist() == [0.0, 0.0]
    assert profile.duration <= plan_feedrate(curve, drives()).duration * (1.0 + 5e-4)


def test_an_axis_without_a_jerk_limit():
    """X, which does not move at the start."""
    curve = ellipse()
    limits = Limits(100.0, [250.0] * 2, [1000.0] * 2, [FREE, 20000.0])
    profile = plan_feedrate(curve, limits)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert profile.duration <= plan_feedrate(curve, drives()).duration * (1.0 + 5e-4)


@pytest.mark.parametrize(
    ("feed", "velocity", "acceleration", "jerk", "more", "binding"),
    [
        (50.0, FREE, FREE, 20000.0, {}, {"feed"}),
        (FREE, 60.0, FREE, 20000.0, {}, {"velocity X"}),
        (FREE, FREE, 1000.0, 20000.0, {}, {"acceleration X", "jerk X"}),
        (FREE, FREE, FREE, 20000.0, {"chord_error": 1e-4}, {"chord error"}),
        (
            100.0,
            FREE,
            FREE,
            FREE,
            {"tangential_jerk": 3000.0, "tangential_acceleration": 200.0},
            {"feed", "tangential jerk"},
        ),
    ],
)
def test_any_selection_of_limits_binds(feed, velocity, acceleration, jerk, more, binding):
    curve = ellipse()
    limits = drives(feed, velocity=velocity, acceleration=acceleration, jerk=jerk, **more)
    profile = plan_feedrate(curve, limits)
    assert binding <= set(profile.shares())
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert max(row.ratio for row in report.rows if np.isfinite(row.ratio)) >= 0.99


def test_an_axis_that_turns_alone():
    """The tip stands still while the rotary axis makes an S-curve."""
    curve = NurbsCurve([[5, 5, 0], [5, 5, 1]], [0, 0, 1, 1], 1, axes=["X", "Y", "A"])
    limits = Limits(100.0, [250, 250, 2], [1000, 1000, 10], [2e4, 2e4, 200], 1e-3, axes=["X", "Y", "A"])
    profile = plan_feedrate(curve, limits)
    assert profile.duration == pytest.approx(s_curve_time(1.0, 2.0, 10.0, 200.0), rel=2e-4)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    assert check(curve, limits, replay(curve, profile)).ok


def test_a_path_on_which_the_tip_rests_for_a_while():
    xy = [[10.0 * k, 0.0] for k in range(4)] + [[30.0, 0.0]] * 5 + [[30.0, 10.0 * k] for k in range(1, 4)]
    points = np.column_stack([xy, 0.05 * np.arange(len(xy))])
    knots = [0, 0, 0, 0, *range(1, len(xy) - 3), *[len(xy) - 3] * 4]
    curve = NurbsCurve(points, knots, 3, axes=["X", "Y", "A"])
    limits = Limits(100.0, [250, 250, 2], [1000, 1000, 10], [2e4, 2e4, 200], 1e-3, axes=["X", "Y", "A"])
    profile = plan_feedrate(curve, limits)
    require_feasible(curve, limits, profile)
    resting = (profile.u > 5.01) & (profile.u < 5.99)
    assert profile.feed[resting].max() < 1e-9
    assert profile.u_rate[resting].min() > 0.0
    assert all(np.isfinite(getattr(profile, name)).all() for name in ("s", "feed", "acceleration", "jerk"))
