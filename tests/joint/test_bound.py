"""The lower bound of path and feed together: below every motion, near known optima, each of its steps by an oracle."""

import json

import numpy as np
import pytest
from joint_reference import OPTIMA, cases, polygon, stopping_motion, turning
from scipy.optimize import linprog

import planner.joint.bound as bound_module
from planner.errors import InputError
from planner.geometry.blend import Legs
from planner.joint.bound import joint_bound, time_of_way
from planner.joint.joint_run import JointRun
from planner.joint.solve import solve_run

CASES = cases()
KEPT = {name: kept["seconds"] for name, kept in json.loads(OPTIMA.read_text(encoding="utf-8")).items()}
TIGHT = {  # share of IPOPT's optimum that the bound reaches
    "90 degrees, 1 um": 0.998,
    "90 degrees, 10 um": 0.997,
    "90 degrees, 50 um": 0.995,
    "135 degrees, 10 um": 0.993,
    "30 degrees, 20 um": 0.951,
    "170 degrees, 10 um": 0.9999,
    "three legs in space, 20 um": 0.93,
    "arc and line, 10 um": 0.86,
}


@pytest.mark.parametrize("name", CASES)
def test_the_bound_is_below_the_optimum_and_near_it(name):
    share = joint_bound(CASES[name]).seconds / KEPT[name]
    assert TIGHT[name] <= share <= 1.0 + 1e-6


def test_the_accelerations_at_a_vertex_are_shared_by_both_blocks(monkeypatch):
    """An octagon: each half of its turns would be fast with a tangential acceleration of its own sign."""
    angle = np.arange(9) * np.pi / 4.0
    run = polygon(5.0 * np.column_stack([np.cos(angle), np.sin(angle)]), 1e-2)
    fastest, bound = solve_run(run).duration, joint_bound(run).seconds
    assert 0.89 * fastest < bound < fastest
    monkeypatch.setattr(bound_module, "_CELLS", 1)
    assert 0.82 * fastest < joint_bound(run).seconds < 0.83 * fastest
    monkeypatch.setattr(bound_module, "_CELLS", 40)
    assert bound < joint_bound(run).seconds < fastest


@pytest.mark.parametrize("length", [1e-3, 0.05, 1.0, 7.0, 40.0])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0)])
def test_a_line_along_an_axis_takes_no_less_than_its_closed_form(length, direction):
    run = polygon([[0.0, 0.0], length * np.array(direction)], 0.01)
    assert joint_bound(run).seconds == pytest.approx(stopping_motion(run).duration, rel=1e-9)


def test_a_line_askew_is_near_its_closed_form():
    run = polygon([[0.0, 0.0], [24.0, 32.0]], 1e-3)
    assert 0.98 < joint_bound(run).seconds / stopping_motion(run).duration <= 1.0


def random_polygon(seed):
    """A polygon of 3 to 8 legs, and its tolerance."""
    rng = np.random.default_rng(seed)
    dim, count = 2 + seed % 2, rng.integers(3, 9)
    points, heading = [np.zeros(dim)], rng.normal(size=dim)
    for _ in range(count):
        heading /= np.linalg.norm(heading)
        points.append(points[-1] + heading * 10.0 ** rng.uniform(-0.5, 1.5))
        turn, aside = np.deg2rad(rng.uniform(5.0, 179.0)), rng.normal(size=dim)
        aside -= heading * (aside @ heading)
        heading = np.cos(turn) * heading + np.sin(turn) * aside / np.linalg.norm(aside)
    return polygon(points, 10.0 ** rng.uniform(-3.0, -1.3))


@pytest.mark.parametrize("seed", range(16))
def test_the_bound_is_below_every_motion(seed):
    run = random_polygon(seed)
    found = joint_bound(run)
    assert 0.5 * stopping_motion(run).duration < found.seconds <= solve_run(run).duration * (1.0 + 1e-6)


def scaled(run, length, time):
    """The same run in other units."""
    legs = Legs(run.legs.vectors * np.array([length, length, length, 1.0])[:, None], run.legs.rates / length)
    rates = (run.velocity / time, run.acceleration / time**2, run.jerk / time**3)
    return JointRun(
        legs, run.lengths * length, run.tolerance * length, run.feed * length / time, *(length * a for a in rates)
    )


@pytest.mark.parametrize("seed", range(2))
def test_units_make_no_difference(seed):
    run = random_polygon(seed)
    assert joint_bound(scaled(run, 40.0, 3.0)).seconds == pytest.approx(3.0 * joint_bound(run).seconds, rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_what_allows_more_takes_no_longer(seed):
    run = random_polygon(seed)
    before = joint_bound(run).seconds
    for name, factor in (("tolerance", 3.0), ("feed", 2.0), ("velocity", 2.0), ("acceleration", 1.5), ("jerk", 1.7)):
        wider = {key: getattr(run, key) for key in ("tolerance", "feed", "velocity", "acceleration", "jerk")}
        wider[name] = wider[name] * factor
        assert joint_bound(JointRun(run.legs, run.lengths, **wider)).seconds <= before * (1.0 + 1e-9), name


def test_limits_that_are_none():
    run = turning(
        20.0, 90.0, 20.0, 0.01, feed=np.full(2, np.inf), velocity=np.full(2, np.inf), acceleration=np.full(2, np.inf)
    )
    jerk_alone = 2.0 * (32.0 * 20.0 / 20000.0) ** (1.0 / 3.0)  # of two legs with stops
    assert 0.85 * jerk_alone < joint_bound(run).seconds < jerk_alone


def test_the_milestones_are_said():
    assert joint_bound(CASES["170 degrees, 10 um"]).milestones == ("axis 0 turns at point 1", "point 2")
    assert joint_bound(CASES["90 degrees, 10 um"]).milestones == ("point 1", "point 2")


def test_a_spiral_is_refused():
    legs = Legs(np.array([[[0.0, 0], [1, 0], [0, 1], [0, 0]]]), np.array([[1.0, 0.1]]))
    run = JointRun(legs, np.ones(1), np.full(1, 0.01), np.full(1, 9.0), *(np.full(2, 9.0) for _ in range(3)))
    with pytest.raises(InputError, match="no spirals and splines"):
        joint_bound(run)


# ---- step 1 --------------------------------------------------------------------------------------------


def farthest(time, limits, start, end, count=150):
    """The longest way within a time by linear programming: jerk constant on short intervals."""
    h = time / count
    velocity, acceleration, jerk = limits
    low = np.tril(np.ones((count + 1, count)), -1)  # a_k = a_0 + h sum of j
    a = np.column_stack([np.ones(count + 1), np.zeros(count + 1), h * low])  # unknowns a_0, v_0, j
    step = 0.5 * h * (a[1:] + a[:-1])
    v = np.vstack([np.zeros(count + 2), np.cumsum(step, axis=0)])
    v[:, 1] += 1.0
    way = (h * v[:-1] + 0.5 * h**2 * a[:-1]).sum(axis=0)
    way[2:] += h**3 / 6.0
    rows = [v, a, -a, v[-1:], -a[-1:]]
    sides = [velocity, acceleration, acceleration, end[0], end[1]]
    upper = np.concatenate([np.full(row.shape[0], side) for row, side in zip(rows, sides, strict=True)])
    bounds = [(-acceleration, min(start[1], acceleration)), (None, start[0]), *[(-jerk, jerk)] * count]
    found = linprog(-way, np.vstack(rows), upper, bounds=bounds)
    assert found.success
    return -found.fun


@pytest.mark.parametrize("seed", range(12))
def test_no_profile_goes_farther_in_the_time_of_a_way(seed):
    rng = np.random.default_rng(seed)
    limits = np.array([rng.uniform(20.0, 200.0), rng.uniform(300.0, 2000.0), rng.uniform(5e3, 5e4)])
    start, end = (np.array([rng.uniform(0.0, 15.0), rng.uniform(0.0, 0.9) * limits[1]]) for _ in range(2))
    time = 10.0 ** rng.uniform(-1.6, -0.4)
    way = farthest(time, limits, start, end)
    found = time_of_way(np.array([way]), limits[:, None], start[:, None], end[:, None])[0]
    assert found <= time * (1.0 + 1e-4)
    if found == pytest.approx(way / max(start[0], end[0]), rel=1e-9):  # from one end to the other without a top: D / W
        assert time < 0.04
    else:
        assert found == pytest.approx(time, rel=1e-2)


# ---- step 2 --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["90 degrees, 10 um", "135 degrees, 10 um", "three legs in space, 20 um"])
def test_speeds_at_the_vertices_of_a_motion_are_within_what_is_said_of_them(name):
    run = CASES[name]
    motion, route = solve_run(run), bound_module._Route.of(run)
    visits = bound_module._Visits(route, np.zeros(route.feed.size))
    k = np.arange(route.feed.size)
    visits = bound_module._Visits(route, bound_module._straight(visits, k, k + 1))
    assert (visits.took < np.array([motion.t[1:][motion.leg == j][-1] for j in k]) + 1e-9).all()
    rng = np.random.default_rng(1)
    for vertex in range(1, k.size):
        node = int(np.searchsorted(motion.leg, vertex))
        w = rng.normal(size=(200, run.dim))
        speed, acceleration = visits.states(np.full(200, vertex), w, np.full(200, 100.0))
        assert (np.abs(w @ motion.velocity[node]) <= speed * 1.02).all()  # the motion's tolerance is kept to some 1e-2
        assert (np.abs(w @ motion.acceleration[node]) <= acceleration * 1.02).all()


def test_landau_constants_are_those_of_the_cubic_of_chebyshev():
    cubic = np.polynomial.Chebyshev([0, 0, 0, 1], domain=[0.0, 2.0])
    slopes = [float(cubic.deriv(k)(2.0)) for k in (1, 2, 3)]
    np.testing.assert_allclose(slopes, [18.0 / 2.0, 96.0 / 4.0, 192.0 / 8.0], rtol=1e-12)


# ---- mutations: a bound that is too large is noticed -------------------------------------------------------


def exceeds():
    return any(joint_bound(run).seconds > KEPT[name] * (1.0 + 1e-6) for name, run in CASES.items())


@pytest.mark.parametrize("factor", [0.5, 0.8])
def test_speeds_at_vertices_taken_too_small_are_noticed(monkeypatch, factor):
    right = bound_module._Visits.states
    assert not exceeds()
    monkeypatch.setattr(bound_module._Visits, "states", lambda *args: factor * right(*args))
    assert exceeds()


def test_times_of_a_way_taken_too_long_are_noticed(monkeypatch):
    right = bound_module.time_of_way
    monkeypatch.setattr(bound_module, "time_of_way", lambda *args: 1.01 * right(*args))
    assert exceeds()


def test_tolerances_left_out_are_noticed(monkeypatch):
    right = bound_module._Route.of
    monkeypatch.setattr(bound_module._Route, "of", lambda run: _nearer(right(run)))
    assert exceeds()


def _nearer(route):
    """A motion that passes every vertex exactly, and does not leave its blocks by more than a tenth of the tolerance."""
    return bound_module._Route(route.points, 0.0 * route.radius, route.joint, 0.1 * route.reach, route.feed, route.run)
