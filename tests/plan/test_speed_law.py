"""From sigma_dot^2 to the nodes of a time law: its integral, its derivatives, and its last digits."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from cases import DRIVES
from problems import laid_out
from program_blocks import line, program
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from speed_law_reference import time_law

from planner import load_curve
from planner.compiled import core
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.plan.ends import REST, Feed
from planner.plan.section import Section
from planner.plan.speed_law import SpeedLaw
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap
from planner.plan.utilisation import utilisation
from planner.programs.path.smooth_path import program_path


def law_on(curve, seed=0, intervals=40, limits=DRIVES):
    """A random positive spline x(sigma) on the grid of a curve: grid, nodes an interval, law, and x as a function."""
    _, _, grid = laid_out(curve, limits, intervals)
    distinct = np.unique(grid.sigma)
    heights = np.random.default_rng(seed).uniform(1.0, 3.0, 8)
    x = CubicSpline(distinct, CubicSpline(np.linspace(0.0, grid.map.span, 8), heights)(distinct))
    law = SpeedLaw(grid.sigma, x(grid.sigma), 0.5 * x(grid.sigma, 1), 0.5 * x(grid.sigma, 2))
    return grid, np.full(grid.intervals, 2), law, x


def on_one_macro(powers, sigma, begin=REST):
    """A grid of one macro from 0 on with u of these powers of sigma, and two nodes to an interval."""
    at = np.polynomial.polynomial.polyval(np.array([0.0, sigma[-1]]), powers)
    line = NurbsCurve([[0.0, 0.0], [10.0, 0.0]], [at[0], at[0], at[1], at[1]], 1)
    section = Section(line, *at, begin, Feed(1.0), None)
    on = TimeMap(section, np.array([0.0, sigma[-1]]), at, np.array([-1]), np.array(powers)[:, None])
    grid = TimeGrid(on, sigma, np.zeros(sigma.size, dtype=np.intp), np.array([sigma.size - 1]))
    return grid, np.full(sigma.size - 1, 2)


def at_even_speed(sigma):
    """x = 1 on these knots."""
    return SpeedLaw(sigma, np.ones(sigma.size), np.zeros(sigma.size), np.zeros(sigma.size))


def _advance(h, u):
    """Steps of u over lengths h, from u and its derivatives (4, n)."""
    n, found = u.shape[1], np.empty(u.shape[1] - 1)
    core.speed_law_advance(n, np.append(h, 0.0), np.ascontiguousarray(u), np.zeros(n), found)
    return found


def _in_step(u, advance, exact, dt):
    """Steps and u in agreement."""
    steps, nodes = advance.copy(), u.copy()
    core.speed_law_in_step(u.size, exact.astype(np.uint8), np.append(dt, 0.0), steps, nodes, np.empty((4, u.size)))
    return steps, nodes


CURVES = {
    "formula": lambda: FormulaCurve({"X": "30*cos(u)", "Y": "18*sin(u)+u**2"}, (0.2, 3.0)),
    "circle": lambda: load_curve("circle"),
    "butterfly-nurbs": lambda: load_curve("butterfly-nurbs"),
}


@pytest.fixture(scope="module", params=CURVES)
def laid(request):
    grid, counts, law, x = law_on(CURVES[request.param]())
    return grid, law, x, law.time_law(grid, counts)


# ---- SpeedLaw ------------------------------------------------------------------------------------------------------


def test_law_is_the_cubic_of_its_values_and_slopes(laid):
    grid, law, x, _ = laid
    sigma = np.linspace(0.0, grid.map.span, 501)
    assert law.at(sigma) == pytest.approx(x(sigma), rel=1e-12)
    assert law.at(law.sigma) == pytest.approx(law.x, rel=1e-12)


def test_at_a_double_knot_the_law_is_that_of_its_right_side_and_at_the_end_of_its_left():
    """x = 1 + s, 2 + w + 2 w^3, and 4 + w + w^2, one after another: other values on either side of both double knots."""
    law = SpeedLaw(
        np.array([0.0, 1.0, 2.0, 2.0, 3.0, 3.0]),
        np.array([1.0, 2.0, 5.0, 4.0, 6.0, 9.0]),
        np.array([0.5, 0.5, 3.5, 0.5, 1.5, 9.0]),
        np.array([0.0, 0.0, 6.0, 1.0, 1.0, 9.0]),
    )
    sigma = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0])
    assert law.at(sigma).tolist() == [1.0, 1.5, 2.0, 2.75, 4.0, 4.75, 6.0]


def test_times_are_the_integral_of_one_over_sigma_dot(laid):
    _, law, x, nodes = laid
    distinct = np.unique(law.sigma)
    points = np.sort(np.concatenate([distinct, 0.5 * (distinct[1:] + distinct[:-1])]))
    exact = [quad(lambda s: x(s) ** -0.5, a, b, epsrel=1e-13)[0] for a, b in pairwise(points)]
    t = np.unique(nodes.t)
    assert t.size == points.size
    assert np.diff(t) == pytest.approx(exact, rel=1e-10, abs=0.0)


def test_nodes_are_knots_and_midpoints_double_at_breaks_alone(laid):
    grid, _, _, nodes = laid
    curve = grid.map.section.curve
    breaks = curve._candidate_breaks()
    assert nodes.t.size == 2 * grid.intervals + 1 + breaks.size
    double = np.flatnonzero(np.diff(nodes.t) == 0.0)
    assert np.array_equal(nodes.u[double], breaks)
    assert np.array_equal(nodes.u[double + 1], nodes.u[double])
    assert nodes.t[0] == 0.0
    assert (nodes.u[0], nodes.u[-1]) == curve.domain


def test_rate_and_acceleration_of_the_parameter(laid):
    """By differences of u over the time, on either side of a break."""
    grid, law, x, nodes = laid
    distinct = np.unique(law.sigma)
    at = np.sort(np.concatenate([distinct, 0.5 * (distinct[1:] + distinct[:-1])]))
    single = np.append(np.diff(nodes.t) > 0.0, True)  # the right side of double nodes
    h = 1e-4 * np.diff(distinct).min()
    checked = 0
    for k in range(1, at.size - 1):
        near = at[k] + h * np.arange(4)  # to the right
        macro = np.full(4, np.searchsorted(grid.map.sigma, at[k], side="right") - 1)
        u = grid.map.parameter(macro, near - grid.map.sigma[macro])[0]
        t = np.append(0.0, [quad(lambda s: x(s) ** -0.5, at[k], s, epsrel=1e-14)[0] for s in near[1:]])
        cubic = np.polyfit(t / t[-1], u - u[0], 3)
        rate, acceleration = cubic[2] / t[-1], 2.0 * cubic[1] / t[-1] ** 2
        scale = nodes.u_rate[single].max()
        assert nodes.u_rate[single][k] == pytest.approx(rate, abs=1e-6 * scale)
        assert nodes.u_acceleration[single][k] == pytest.approx(
            acceleration, abs=2e-2 * np.abs(nodes.u_acceleration).max()
        )
        checked += 1
    assert checked > 50


def test_stops_are_at_rest_without_acceleration(laid):
    _, _, _, nodes = laid
    for end in (0, -1):
        assert nodes.u_rate[end] == 0.0
        assert nodes.u_acceleration[end] == 0.0


def test_a_law_that_dips_below_zero_between_points_stays_finite():
    grid, counts, law, _ = law_on(CURVES["formula"]())
    # on the last interval x falls below 0 before the middle, where it is positive again
    k, h = law.sigma.size - 2, float(law.sigma[-1] - law.sigma[-2])
    a, c = law.a.copy(), law.c.copy()
    a[k], c[k:] = -6.0 * law.x[k] / h, np.array([30.0, -18.0]) * law.x[k] / h**2
    dipping = SpeedLaw(law.sigma, law.x, a, c)
    assert dipping.at(np.linspace(0.0, grid.map.span, 20_001)).min() < 0.0
    t = dipping.time_law(grid, counts).t
    assert np.isfinite(t).all()
    assert (np.diff(t) > 0.0).all()


def test_slower_clock():
    grid, counts, law, _ = law_on(CURVES["circle"]())
    nodes = law.time_law(grid, counts)
    slow = nodes.dilated(2.0)
    assert np.array_equal(slow.u, nodes.u)
    assert np.array_equal(slow.t, 2.0 * nodes.t)
    assert np.array_equal(slow.u_rate, nodes.u_rate / 2.0)
    assert np.array_equal(slow.u_acceleration, nodes.u_acceleration / 4.0)
    table = TimeLaw(nodes.t, nodes.u, nodes.u_rate, nodes.u_acceleration).dilated(2.0)
    assert np.array_equal(table.t, slow.t)
    assert table.steps is None


def test_joined_laws_follow_one_another_and_share_the_moments_between_them():
    grid, counts, law, _ = law_on(CURVES["formula"]())
    nodes = law.time_law(grid, counts)
    parts = [nodes, nodes.dilated(3.0), nodes.dilated(0.5)]
    whole, size = TimeLaw.joined(parts), nodes.t.size
    assert whole.t[0] == 0.0
    for k, part in enumerate(parts):
        mine = slice(k * size, (k + 1) * size)
        assert whole.t[mine] - whole.t[k * size] == pytest.approx(part.t, rel=1e-12, abs=0.0)
        assert np.array_equal(whole.u_rate[mine], part.u_rate)
        assert np.array_equal(whole.u_acceleration[mine], part.u_acceleration)
    ends = np.array([size, 2 * size])
    assert np.array_equal(whole.t[ends], whole.t[ends - 1])
    assert whole.t[-1] == pytest.approx(4.5 * nodes.t[-1], rel=1e-12)


@pytest.mark.parametrize("curve", CURVES)
def test_a_law_in_another_unit_of_time_has_the_same_nodes(curve):
    """Powers of two round nothing: no digit of u, no node and no correction depends on how fast the law is."""
    grid, counts, law, _ = law_on(CURVES[curve](), intervals=400)
    nodes = law.time_law(grid, counts)
    for unit in (2.0**-20, 2.0**20):
        scaled = SpeedLaw(law.sigma, unit**2 * law.x, unit**2 * law.a, unit**2 * law.c).time_law(grid, counts)
        assert np.array_equal(scaled.t, nodes.t / unit)
        assert np.array_equal(scaled.u, nodes.u)
        assert np.array_equal(scaled.u_rate, unit * nodes.u_rate)
        assert np.array_equal(scaled.u_acceleration, unit**2 * nodes.u_acceleration)


def test_a_law_that_would_fall_back_into_a_stop_is_held_forward():
    """Towards rest over h and D with rate v, u' = (h - t)^2 p(t) stays >= 0 where 20 D >= 8 v h + a h^2."""
    line = NurbsCurve([[0.0, 0.0], [10.0, 0.0]], [0, 0, 1, 1], 1)
    free = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [1.0, 1.0])
    t = np.array([0.0, 0.5, 1.5, 2.0])
    u = np.array([0.0, 0.1, 0.9, 1.0])
    rate = np.array([0.0, 0.45, 0.45, 0.0])
    nodes = TimeLaw(t, u, rate, np.array([0.0, -2.0, 2.0, 0.0]))
    assert utilisation(line, free, nodes).backward[[0, 2]].min() > 0.0
    nodes = nodes.forward_at_stops()
    assert nodes.u_acceleration == pytest.approx([0.0, -0.8, 0.8, 0.0], rel=1e-12)  # (20 D / h - 8 v) / h
    assert utilisation(line, free, nodes).backward.max() <= 1e-12
    held = TimeLaw(t, u, rate, np.array([0.0, 0.3, -0.3, 0.0]))
    held = held.forward_at_stops()
    assert held.u_acceleration.tolist() == [0.0, 0.3, -0.3, 0.0]
    moving = TimeLaw(t, u, rate + 0.1, np.array([0.0, -2.0, 2.0, 0.0]))
    moving = moving.forward_at_stops()
    assert moving.u_acceleration.tolist() == [0.0, -2.0, 2.0, 0.0]


def test_nodes_of_a_law_are_held_forward_at_stops(monkeypatch):
    """A smooth law needs it for its last digits only; every law gets it."""
    grid, counts, law, _ = law_on(CURVES["formula"]())
    planted = TimeLaw(*np.zeros((4, 2)))
    monkeypatch.setattr(TimeLaw, "forward_at_stops", lambda given: planted)
    assert law.time_law(grid, counts) is planted


def test_steps_of_nodes_are_halves_of_intervals_whatever_their_sums_round_to():
    """x = 1 and u = sigma: also where the middle of an interval is no number."""
    rng = np.random.default_rng(2)
    sigma = np.sort(np.concatenate([[0.0], 10.0 ** rng.uniform(-12.0, 0.0, 200), 1.0 + rng.uniform(0.0, 1e-9, 200)]))
    nodes = at_even_speed(sigma).time_law(*on_one_macro([0.0, 1.0, 0.0, 0.0, 0.0, 0.0], sigma))
    halves = np.repeat([float(Fraction(b) - Fraction(a)) / 2.0 for a, b in pairwise(sigma)], 2)
    assert nodes.steps[0] == pytest.approx(halves, rel=4e-15, abs=0.0)
    assert nodes.steps[1] == pytest.approx(halves, rel=1e-12, abs=1e-26)


def test_a_node_is_the_moment_at_which_the_law_has_the_rounded_parameter():
    """u = 1 + t^3 at t from 2e-5 on: rounding moves u by up to 0.8 % of what it went, and t, u' and u'' go along."""
    sigma = np.append(0.0, np.sort(2e-5 * 10.0 ** np.random.default_rng(4).uniform(0.0, 1.0, 200)))
    nodes = at_even_speed(sigma).time_law(*on_one_macro([1.0, 0.0, 0.0, 1.0, 0.0, 0.0], sigma))
    meant = np.insert(sigma, np.arange(1, sigma.size), 0.5 * (sigma[1:] + sigma[:-1]))[2:-1]
    u, rate, acceleration, t = (of[2:-1] for of in (nodes.u, nodes.u_rate, nodes.u_acceleration, nodes.t))
    at = np.cbrt(u - 1.0)
    late = np.abs(at / meant - 1.0)
    assert late.max() > 2e-3
    assert np.array_equal(u, 1.0 + meant**3)
    assert rate == pytest.approx(3.0 * at**2, rel=0.3 * late.max() ** 2, abs=0.0)
    assert acceleration == pytest.approx(6.0 * at, rel=0.3 * late.max() ** 2, abs=0.0)
    assert t == pytest.approx(at, rel=0.0, abs=0.3 * late.max() ** 2 * at[0])


def test_steps_of_nodes_are_the_advance_of_the_law_and_not_the_differences_of_u():
    """Far from the origin u = 1e6 + sigma has four digits fewer than its steps have."""
    sigma = np.sort(np.append(np.random.default_rng(3).uniform(0.0, 1.0, 99), [0.0, 1.0]))
    nodes = at_even_speed(sigma).time_law(*on_one_macro([1e6, 1.0, 0.0, 0.0, 0.0, 0.0], sigma, Feed(1.0)))
    halves = np.repeat(0.5 * np.diff(sigma), 2)
    assert nodes.steps[1] == pytest.approx(halves, rel=1e-12, abs=0.0)
    assert np.abs(np.diff(nodes.u) - halves).max() > 1e-11


@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_beside_a_stop_the_law_is_that_of_the_path_and_not_of_the_digits_of_u(shift):
    """The jerk of each interval's quintic at its start is that of the cubic there; a digit of u is worth far more."""
    curve = FormulaCurve({"X": f"30*cos(u-{shift})", "Y": f"18*sin(u-{shift})"}, (0.2 + shift, 3.0 + shift))
    grid, counts, law, _ = law_on(curve, intervals=20_000)
    nodes = law.time_law(grid, counts)
    (h, advance), v, a = nodes.steps, nodes.u_rate, nodes.u_acceleration
    rest = advance - h * (v[:-1] + 0.5 * a[:-1] * h)
    c3 = (10.0 * rest - 4.0 * h * (v[1:] - v[:-1] - a[:-1] * h) + 0.5 * h**2 * (a[1:] - a[:-1])) / h**3
    knots = np.flatnonzero(np.append(np.diff(grid.sigma) > 0.0, False))[:20]
    u = grid.map.parameter(grid.macro[knots], grid.distances(grid.sigma[knots], grid.macro[knots]))
    x, slope, bend = law.x[knots], law.a[knots], law.c[knots]
    exact = (u[3] * x + 3.0 * u[2] * slope + u[1] * bend) * np.sqrt(x)
    scale = np.abs(exact).max()
    assert 6.0 * c3[2 * np.arange(20)] == pytest.approx(exact, abs=2e-2 * scale)
    # what a digit of u would be worth
    assert 60.0 * np.spacing(nodes.u[1]) / h[:20].min() ** 3 > (10.0 if shift else 1e-3) * 2e-2 * scale


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_the_advance_is_exact_for_a_rate_of_the_fifth_degree(offset):
    u = np.polynomial.Polynomial([0.0, 3.0, -1.0, 0.7, 0.2, -0.4, 0.3])
    t = np.array([0.0, 0.25, 0.75, 1.0])
    found = _advance(np.diff(t), np.stack([offset + u(t), *(u.deriv(k)(t) for k in (1, 2, 3))]))
    assert found == pytest.approx(np.diff(u(t)), rel=1e-14)


def test_over_long_intervals_the_difference_is_the_advance():
    t = np.linspace(0.0, 6.0, 4)
    u = np.stack([np.sin(t), np.cos(t), -np.sin(t), -np.cos(t)])
    assert np.array_equal(_advance(np.diff(t), u), np.diff(np.sin(t)))


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_steps_of_close_nodes_are_those_of_the_law_and_not_of_its_digits(offset):
    """u = offset + sin t / 3 at points 1e-5 apart: the last digits of u are worth more than the whole third derivative."""
    t = np.arange(4001) * 1e-5
    exact = np.sin(t) / 3.0
    noise = np.random.default_rng(1).uniform(-4.0, 4.0, t.size) * np.spacing(offset + 1.0)
    u = np.stack([offset + exact + noise, np.cos(t) / 3.0, -np.sin(t) / 3.0, -np.cos(t) / 3.0])
    u[0, [0, -1]] = offset + exact[[0, -1]]
    ends = np.zeros(t.size, dtype=bool)
    ends[[0, -1]] = True
    advance, nodes = _in_step(u[0], _advance(np.diff(t), u), ends, np.diff(t))
    assert np.abs(advance - np.diff(exact)).max() <= 1e-12 * exact[-1] + 8.0 * np.spacing(offset + 1.0) / t.size
    assert np.abs(np.diff(nodes) - advance).max() <= np.spacing(offset + 1.0)
    assert nodes[[0, -1]].tolist() == u[0, [0, -1]].tolist()


def test_half_a_digit_is_not_put_into_a_stretch_of_a_microsecond():
    """Beside the stop of a rest map, or at the ends of a short stretch, every point is known; its steps need no mending."""
    digit = np.spacing(43.6)
    t = np.concatenate([np.arange(11) * 1e-4, 1e-3 + np.arange(1, 5) * 2e-7, 1.0008e-3 + np.arange(1, 11) * 1e-4])
    exact = 16.0 * t
    u = 43.59 + exact
    known = np.zeros(t.size, dtype=bool)
    known[[0, 10, 12, 14, -1]] = True
    u[[10, 12, 14]] += np.array([0.4, -0.4, 0.4]) * digit
    u = np.round(u / digit) * digit
    steps = np.diff(exact)
    advance, nodes = _in_step(u, steps, known, np.diff(t))
    assert np.array_equal(nodes[known], u[known])
    assert np.abs(advance - steps).max() <= 1e-20  # 60 of it over h^3 is the jerk that it makes
    assert np.abs(np.diff(nodes) - advance).max() <= 1.5 * digit


def test_what_is_left_over_beyond_half_a_digit_is_spread():
    t = np.linspace(0.0, 1.0, 101)
    u = 1.0 + t
    u[-1] += 1e-13
    known = np.zeros(t.size, dtype=bool)
    known[[0, -1]] = True
    advance, nodes = _in_step(u, np.diff(t), known, np.diff(t))
    assert advance.sum() == pytest.approx(1.0 + 1e-13, abs=3e-16)
    assert np.ptp(advance - np.diff(t)) <= 2e-17
    assert nodes[-1] == u[-1]


# ---- by array arithmetic ---------------------------------------------------------------------------------------------


def blended():
    """A program with blends, which have a parameter of their own, and breaks."""
    lines = program(line(40, 0, feed=80.0), line(40, 20), line(60, 30), line(90, 30, feed=50.0))
    return program_path(lines, 0.05, DRIVES, path="separate").curve


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", [*CURVES, "blended"])
def test_nodes_are_those_of_array_arithmetic(name, seed):
    """Every digit but where sums are made in another order: there what is spread over the steps of u, digits themselves."""
    rng = np.random.default_rng(seed)
    grid, counts, law, _ = law_on(blended() if name == "blended" else CURVES[name](), seed, intervals=120)
    assert grid.map.has_native == (name == "blended")
    counts = rng.integers(1, 5, counts.size)
    x = law.x.copy()
    x[rng.integers(1, x.size - 1, 3)] *= 1e-5  # dips, where the cubic is held above zero
    law = SpeedLaw(law.sigma, x, law.a, law.c)
    found, plain = law.time_law(grid, counts), time_law(law, grid, counts)
    for attribute in ("t", "u_rate", "u_acceleration"):
        np.testing.assert_array_equal(getattr(found, attribute), getattr(plain, attribute))
    np.testing.assert_array_equal(found.steps[0], plain.steps[0])
    digit = np.spacing(np.abs(plain.u).max())
    assert np.abs(found.u - plain.u).max() <= digit
    assert np.abs(found.steps[1] - plain.steps[1]).max() <= 1e-3 * digit
