"""The map of a plan's coordinate: through a law, over blends in their own parameter, and down to a stop."""

import numpy as np
import pytest
from cases import DRIVES
from hypothesis import given, settings
from problems import SEEDS, laid_out, random_case
from program_blocks import line, program

from planner import load_curve, plan_feedrate
from planner.compiled import core
from planner.errors import SolverError
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.plan.ends import FREE, REST
from planner.plan.rows import path_on
from planner.plan.section import cut
from planner.plan.time_knots import TimeGrid
from planner.plan.time_map import TimeMap
from planner.programs.path.smooth_path import program_path


def law_of(name):
    curve = load_curve(name)
    profile = plan_feedrate(curve, DRIVES, intervals=200)
    (section,) = cut(curve, DRIVES, exact_stop=False)
    return section, TimeLaw(profile.t, profile.u, profile.u_rate, profile.u_acceleration)


@pytest.mark.parametrize("name", ["teardrop", "circle", "butterfly-nurbs"])
def test_a_map_takes_a_law_at_its_nodes_from_either_side(name):
    section, law = law_of(name)
    nodes = np.unique(np.append(law.t[:: law.t.size // 40], law.t[np.flatnonzero(np.diff(law.t) == 0.0)]))
    nodes = np.append(nodes[nodes < law.t[-1]], law.t[-1])
    found = TimeMap.from_law(section, law, nodes)
    assert set(nodes) <= set(found.sigma)
    k = np.arange(found.sigma.size - 1)
    for macro, at, side in ((k, found.sigma[:-1], "right"), (k, found.sigma[1:], "left")):
        d = found.parameter(macro, at - found.sigma[macro])
        i = np.searchsorted(law.t, at, side=side) - (side == "right")
        node = law.t[np.clip(i, 0, law.t.size - 1)] == at
        assert np.count_nonzero(node) > 20
        i = i[node]
        assert d[0, node] == pytest.approx(law.u[i], rel=1e-14)
        for order, of in ((1, law.u_rate), (2, law.u_acceleration)):
            assert d[order, node] == pytest.approx(of[i], abs=1e-8 * np.abs(of).max())


def test_between_nodes_a_map_is_the_law_where_that_is_one_quintic():
    section, law = law_of("teardrop")
    found = TimeMap.from_law(section, law, law.t[::1])
    t = np.random.default_rng(1).uniform(0.0, law.t[-1], 500)
    macro = np.searchsorted(found.sigma, t, side="right") - 1
    assert found.parameter(macro, t - found.sigma[macro])[0] == pytest.approx(law.at(t)[0], abs=1e-13)


def test_over_a_blend_at_a_constant_rate_every_axis_has_a_constant_jerk():
    """q = V + D1(A (1 - tau)^3) + D2(A (1 + tau)^3), tau' = r: each axis has the jerk 6 A r^3 of its leg."""
    curve = program_path(program(line(40, 0), line(40, 30)), 0.05, DRIVES, path="separate").curve
    (section,) = cut(curve, DRIVES, exact_stop=False)
    edges, size = curve.edges[1:3], float(curve.blends.size[0])
    rate = 7.0
    ends = np.array([[rate, rate], [0.0, 0.0]])
    tangent = 3.0 * size * 4.0  # |dq/dtau| at either end
    on = TimeMap.through(section, np.array([0.0, 2.0 / rate]), edges, tangent * ends, tangent * ends)
    # the acceleration of u at the ends: that of the arc length at a constant rate of tau
    for bend, at in ((-6.0, 0), (6.0, 1)):
        ends[1, at] = bend * size * 2.0 * rate**2 / tangent
    on = TimeMap.through(section, on.sigma, edges, tangent * ends, tangent * ends)
    d = np.linspace(0.0, 2.0 / rate, 42)[:-1]
    macro = np.zeros(d.size, dtype=np.int64)  # the end itself would be a stop
    path = path_on(DRIVES, on, d, macro)
    # out of +X, into +Y: the one slows down by as much as the other speeds up
    assert path.axes[3, :, 0] == pytest.approx(np.full(41, 6.0 * size * rate**3), rel=1e-9)
    assert path.axes[3, :, 1] == pytest.approx(np.full(41, 6.0 * size * rate**3), rel=1e-9)
    u = path.u
    assert u[0] == pytest.approx(
        edges[0] + curve.blends.arc_length(np.zeros(41, dtype=np.intp), rate * d - 1.0), rel=1e-15
    )
    assert u[1] == pytest.approx(np.sqrt(np.sum(path.axes[1] ** 2, axis=1)), rel=1e-12)  # u is the arc length


def test_next_to_a_stop_the_map_knows_by_how_much_u_is_rounded():
    """u = 1 - e^3 on the last macro, at distances e from its end."""
    line = NurbsCurve([[0.0, 0.0], [10.0, 0.0]], [0.0, 0.0, 1.0, 1.0], 1)
    (section,) = cut(line, DRIVES, REST, REST, exact_stop=False)
    h = 0.5
    powers = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]) * (1.0 - h**3) / h**3
    last = np.array([1.0 - h**3, 3.0 * h**2, -3.0 * h, 1.0, 0.0, 0.0])  # 1 - (h - d)^3
    on = TimeMap(
        section,
        np.array([0.0, h, 2.0 * h]),
        np.array([0.0, 1.0 - h**3, 1.0]),
        np.array([-1, -1]),
        np.stack([powers, last], axis=1),
    )
    near = 2.0 * h - 10.0 ** np.linspace(-3.0, -5.0, 50)
    sigma = np.concatenate([[0.0, h, h], near, [2.0 * h]])
    grid = TimeGrid(on, sigma, np.repeat([0, 1], [2, 52]), np.array([1, sigma.size - 1]))
    u, moved = nodes_of(grid)
    meant = (2.0 * h - near) ** 3  # of the distances that the knots stand for
    assert moved[3:-1] == pytest.approx((u[3:-1] - 1.0) + meant, abs=1e-3 * np.spacing(1.0))
    assert np.count_nonzero(moved[3:-1]) > 40
    assert not moved[[0, 1, 2, -1]].any()
    assert (np.abs(moved) <= np.spacing(1.0)).all()


def nodes_of(grid):
    """Parameter u of the nodes of the law x = 1, one to an interval, and by how much rounding moved it."""
    n, count = grid.sigma.size, grid.intervals + grid.left.size
    states, path, (moved, width, time) = np.empty((3, count)), np.empty((5, count)), np.empty((3, count))
    kind, macro = np.empty(count, dtype=np.uint8), np.empty(count, dtype=np.int64)
    core.speed_law_nodes(
        *(n, grid.sigma, np.ones(n), np.zeros(n), np.zeros(n), grid.macro, np.ones(grid.intervals, dtype=np.int64)),
        *(*grid.map.arguments, grid.at_breaks, *grid.map.beside_stops, count, states, path, moved, width, time),
        *(kind, macro),
    )
    return path[0], moved


def test_a_law_that_falls_back_has_no_map():
    section, law = law_of("teardrop")
    rate = law.u_rate.copy()
    rate[100] = -rate[100]
    broken = TimeLaw(law.t, law.u, rate, law.u_acceleration)
    with pytest.raises(SolverError, match=r"falls back near u = 0\.\d"):
        TimeMap.from_law(section, broken, law.t[::20])


@settings(max_examples=30)
@given(SEEDS)
def test_maps_of_guesses_grow_everywhere_and_rest_at_stops(seed):
    curve, limits = random_case(seed)
    _, _, grid = laid_out(curve, limits, 200)
    on = grid.map
    share = np.linspace(0.0, 1.0, 101)
    h = np.diff(on.sigma)
    k = np.repeat(np.arange(h.size), share.size)
    u = on.parameter(k, (h[:, None] * share).reshape(-1))
    inside = np.tile((share > 0.0) & (share < 1.0), h.size)
    assert (u[1, inside] > 0.0).all()
    assert not u[1:3, [0, -1]].any()
    assert (np.diff(u[0]) >= 0.0).all()
    assert (u[0, 0], u[0, -1]) == curve.domain


def test_the_map_of_a_periodic_law_ends_as_it_begins():
    curve = load_curve("circle")
    profile = plan_feedrate(curve, DRIVES, intervals=100, periodic=True)
    (section,) = cut(curve, DRIVES, FREE, FREE, exact_stop=False)
    rate = profile.u_rate.copy()
    rate[-1] *= 1.0 + 1e-7  # what a solver leaves
    law = TimeLaw(profile.t, profile.u, rate, profile.u_acceleration)
    found = TimeMap.from_law(section, law, np.append(law.t[:-1:10], law.t[-1]), periodic=True)
    grid = TimeGrid.even(found, 1)
    path = path_on(DRIVES, found, grid.sigma, grid.macro)
    for order in (1, 2):
        assert path.axes[order, -1] == pytest.approx(path.axes[order, 0], abs=1e-11 * np.abs(path.axes[order]).max())
