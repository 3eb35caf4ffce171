"""The arrays a solver sees, against differences of the path in many digits, and in other units."""

import mpmath
import numpy as np
import pytest
from cases import DRIVES, drives, line_arc_line, mill
from problems import laid_out
from program_blocks import line as block
from program_blocks import program, rapid
from strategies import derivatives_of, oracle

from planner import load_curve
from planner.geometry.curve import Pieces
from planner.geometry.differential import chain_rule
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.machine.feed_limits import COMMANDS, chord_feed_limit, command_kind
from planner.machine.limits import Limits
from planner.machine.machine_file import load_limits
from planner.plan import rows
from planner.plan.collocation import points_of
from planner.plan.rows import acceleration_rows, build, jerk_rows, path_at, path_on, speed_cap, speed_limits
from planner.plan.section import cut
from planner.plan.sensitivity import SpeedBound
from planner.programs.path.smooth_path import program_path

TANGENTIAL = {"tangential_acceleration": 700.0, "tangential_jerk": 9000.0}
LIMITS = Limits(120.0, [250.0, 200.0], [1000.0, 800.0], [20000.0, 30000.0], 1e-3, **TANGENTIAL)
FORMULA = FormulaCurve({"X": "30*cos(u)+5*sin(3*u)", "Y": "18*sin(u)+u**2"}, (0.2, 3.0))


def exact_formula(u):
    return 30 * mpmath.cos(u) + 5 * mpmath.sin(3 * u), 18 * mpmath.sin(u) + u**2


def rows_of(curve, limits, intervals=64, *, inner=1, **options):
    """Section, grid, and the arrays a solver sees with the path below them."""
    section, _, grid = laid_out(curve, limits, intervals, **options)
    constraints, _ = build(limits, grid, periodic=options.get("periodic", False), inner=inner)
    return section, grid, constraints, path_on(limits, grid.map, *places_of(grid, inner))


def places_of(grid, inner=1):
    """Sigma and macro of every point."""
    return points_of(grid.sigma, inner), np.repeat(grid.macro, inner + 1)[:-inner]


def parameter_at(grid, macro, sigma):
    """u by the polynomial of a macro, also beyond its ends."""
    d = sigma - grid.map.sigma[macro]
    return np.polynomial.polynomial.polyval(d, grid.map.powers[:, macro], tensor=False)


def exact_parameter(grid, macro, sigma):
    """u(sigma) on a macro in as many digits as mpmath is set to."""
    d = sigma - mpmath.mpf(float(grid.map.sigma[macro]))
    return sum(mpmath.mpf(float(c)) * d**k for k, c in enumerate(grid.map.powers[:, macro]))


# ---- rows against differences of q(sigma) --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def formula_path():
    section, grid, constraints, path = rows_of(FORMULA, LIMITS)
    derivatives = np.stack(
        [
            derivatives_of(lambda x, k=macro: exact_formula(exact_parameter(grid, k, x)), at, 2)
            for at, macro in zip(*places_of(grid), strict=True)
        ],
        axis=1,
    )
    return section, grid, constraints, path, derivatives


def test_path_derivatives_with_respect_to_sigma(formula_path):
    """As good as the pieces fitted to the formula, 1e-13 of its extent: each derivative costs two digits, or three."""
    _, _, _, path, d = formula_path
    for k, accuracy in ((0, 1e-13), (1, 4e-12), (2, 6e-10), (3, 1.2e-8)):
        assert path.axes[k] == pytest.approx(d[k], abs=accuracy * np.abs(d[k]).max())


def test_the_chain_rule_itself_costs_nothing(formula_path, monkeypatch):
    """The same on the formula in place of its pieces: to 1e-12, 1e-11 and 1e-10."""
    _, grid, _, _, d = formula_path
    monkeypatch.setattr(Pieces, "evaluate", lambda _pieces, u, order, _left: FORMULA.derivatives(u, order))
    path = path_on(LIMITS, grid.map, *places_of(grid))
    for k, accuracy in ((0, 1e-13), (1, 1e-12), (2, 1e-11), (3, 1e-10)):
        assert path.axes[k] == pytest.approx(d[k], abs=accuracy * np.abs(d[k]).max())


def test_rows_are_velocity_acceleration_and_jerk_over_their_limits(formula_path):
    """For any sigma_dot, sigma_ddot and their derivative c the rows give the axes' rates by the chain rule."""
    _, _, constraints, _, d = formula_path
    rng = np.random.default_rng(5)
    x, a, c = rng.uniform(0.1, 2.0, d.shape[1]), *rng.normal(size=(2, d.shape[1]))
    length, time = constraints.length_unit, constraints.time_unit
    v, sdd = (np.sqrt(x) * length / time)[:, None], (a * length / time**2)[:, None]
    sddd = (c * np.sqrt(x) * length / time**3)[:, None]
    acceleration = (d[2] * v**2 + d[1] * sdd) / LIMITS.acceleration
    jerk = (d[3] * v**3 + 3.0 * d[2] * v * sdd + d[1] * sddd) / LIMITS.jerk
    asked = np.delete(
        np.arange(x.size), 2 * np.flatnonzero(constraints.h == 0.0) + 1
    )  # nothing is between double knots
    ours = np.stack([row[0] * x + row[1] * a for row in constraints.acceleration.r[:2]], axis=1)
    assert ours[asked] == pytest.approx(acceleration[asked], abs=1e-10 * np.abs(acceleration).max())
    ours = np.stack([(r[0] * x + r[1] * a + r[2] * c) * np.sqrt(x) for r in constraints.jerk.r[:2]], axis=1)
    assert ours[asked] == pytest.approx(jerk[asked], abs=1e-9 * np.abs(jerk).max())
    speed = np.sqrt(np.sum(d[1] ** 2, axis=-1))
    velocities = np.abs(d[1]) * np.sqrt(constraints.cap)[:, None] * length / time
    feeds = speed * np.sqrt(constraints.cap) * length / time
    assert (velocities <= LIMITS.velocity * (1.0 + 1e-9))[1:-1].all()
    assert (feeds <= 120.0 * (1.0 + 1e-9))[1:-1].all()


def test_last_rows_are_those_of_the_arc_length_of_the_tip(formula_path):
    _, grid, constraints, _, d = formula_path
    sigma, macro = places_of(grid)
    h = 1e-4 * grid.map.span
    far = np.minimum(sigma, grid.map.span - sigma) > 0.02 * grid.map.span
    far[2 * np.flatnonzero(constraints.h == 0.0) + 1] = False
    s = {k: FORMULA.arclength.s(parameter_at(grid, macro[far], sigma[far] + k * h)) for k in range(-3, 4)}
    first = (45 * (s[1] - s[-1]) - 9 * (s[2] - s[-2]) + s[3] - s[-3]) / (60 * h)
    second = (270 * (s[1] + s[-1]) - 27 * (s[2] + s[-2]) + 2 * (s[3] + s[-3]) - 490 * s[0]) / (180 * h**2)
    # from |s'|^2 = q'.q', differentiated twice
    q1, q2, q3 = d[1:, far]
    third = (np.sum(q1 * q3 + q2 * q2, axis=-1) - second**2) / first
    length, time = constraints.length_unit, constraints.time_unit
    alpha, beta = constraints.acceleration.r[2][:, far]
    assert beta == pytest.approx(first * length / time**2 / 700.0, rel=1e-7)
    assert alpha == pytest.approx(second * length**2 / time**2 / 700.0, abs=1e-5 * np.abs(alpha).max())
    r = constraints.jerk.r[2][:, far]
    assert r[2] == pytest.approx(first * length / time**3 / 9000.0, rel=1e-7)
    assert r[1] == pytest.approx(3.0 * second * length**2 / time**3 / 9000.0, abs=1e-5 * np.abs(r[1]).max())
    assert r[0] == pytest.approx(third * length**3 / time**3 / 9000.0, abs=1e-5 * np.abs(r[0]).max())


@pytest.mark.parametrize("name", ["line and arc", "butterfly-nurbs"])
def test_double_knots_hold_the_values_of_either_side(name):
    curve = line_arc_line() if name == "line and arc" else load_curve(name)
    limits = drives(120.0)
    _, grid, _, path = rows_of(curve, limits, 100)
    double = grid.left[:-1][grid.at_breaks[:-1]][:6]
    jumps = 0.0
    for k in double:
        for knot, side in ((k, "left"), (k + 1, "right")):
            u, *rates = path.u[:, 2 * knot]
            q = oracle(curve, float(u), side)
            exact = np.stack([q[0], *chain_rule(q[1], q[2], q[3], *rates)])
            size = np.abs(path.axes[:, 2 * knot]).max(axis=-1)
            for order in range(4):
                assert path.axes[order, 2 * knot] == pytest.approx(exact[order], abs=1e-9 * size[order] + 1e-12)
        jumps = max(jumps, float(np.abs(path.axes[2:, 2 * k + 2] - path.axes[2:, 2 * k]).max()))
    assert jumps > 1e-3
    assert (path.axes[:, 2 * double + 1] == path.axes[:, 2 * double]).all()


@pytest.mark.parametrize("name", ["circle", "butterfly-nurbs"])
def test_velocity_and_acceleration_go_on_at_double_knots(name):
    """Also where the parametrisation of the curve jumps, as it does on a circle of four rational arcs."""
    _, grid, _, path = rows_of(load_curve(name), drives(120.0), 200)
    double = grid.left[:-1]
    for order in (0, 1, 2):
        size = np.abs(path.axes[order]).max()
        assert path.axes[order, 2 * double + 2] == pytest.approx(path.axes[order, 2 * double], abs=1e-9 * size)
    if name == "circle":
        at = double[grid.at_breaks[:-1]]
        assert np.abs(path.u[2, 2 * at + 2] - path.u[2, 2 * at]).max() > 1e-3 * np.abs(path.u[2]).max()


# ---- compiled rows against array arithmetic ------------------------------------------------------------------------


def program_of(*blocks):
    """A program, with blends that have a parameter of their own, and feeds that it commands."""
    return program_path(program(*blocks), 0.05, DRIVES, path="separate").curve


BENDS = (block(40, 0, feed=100.0), block(60, 20, feed=50.0), block(100, 20), block(120, 60, feed=100.0))
FREE = [np.inf] * 2
FILLED = {
    "formula": lambda: (FORMULA, LIMITS),
    "nurbs": lambda: (load_curve("butterfly-nurbs"), drives(120.0, chord_error=1e-4)),
    "blends": lambda: (program_of(*BENDS), drives(80.0, chord_error=1e-3, **TANGENTIAL)),
    "rapid": lambda: (program_of(rapid(40, 0)), drives(80.0, rapid=150.0)),
    "five axes": lambda: (load_curve("flank"), load_limits("five-axis")),
    "ramp": lambda: (FORMULA, Limits(120.0, FREE, [1000.0, 800.0], [20000.0, np.inf], period=5e-3)),
    "jerk alone": lambda: (FORMULA, Limits(np.inf, FREE, FREE, [20000.0, 8000.0])),
    "speed alone": lambda: (FORMULA, Limits(120.0, [100.0, np.inf], FREE, FREE, chord_error=1e-3)),
}


def near(found, exact):
    """Equal but for the order in which a sum of three or a product of five is made."""
    assert found.shape == exact.shape
    size = np.abs(exact).max(axis=-1, keepdims=True) if exact.size else 0.0
    assert (np.abs(found - exact) <= 1e-14 * size).all()


@pytest.mark.parametrize("inner", [1, 3])
@pytest.mark.parametrize("name", FILLED)
def test_rows_are_those_of_array_arithmetic(name, inner, monkeypatch):
    """Also where the points are taken some at a time."""
    curve, limits = FILLED[name]()
    monkeypatch.setattr(rows, "_INTERVALS_AT_ONCE", 97)
    _, _, grid = laid_out(curve, limits, 300)
    constraints, speeds = build(limits, grid, inner=inner)
    sigma, macro = places_of(grid, inner)
    path = path_on(limits, grid.map, sigma, macro)
    asked = np.ones(sigma.size, dtype=bool)
    for k in range(1, inner + 1):
        asked[(inner + 1) * np.flatnonzero(constraints.h == 0.0) + k] = False
    units = constraints.length_unit ** -np.arange(3.0)[:, None]
    plain = acceleration_rows(limits, path).r * units[:2]
    near(constraints.acceleration.r[:, :, asked], plain[:, :, asked])
    assert not constraints.acceleration.r[:, :, ~asked].any()
    plain = jerk_rows(limits, path).r * units
    near(constraints.jerk.r[: len(plain), :, asked], plain[:, :, asked])
    assert not constraints.jerk.r[:, :, ~asked].any()
    assert len(constraints.jerk) == len(plain) + (name == "ramp")
    if name == "ramp":
        close = np.minimum(sigma, grid.map.span - sigma) < 4.0 * limits.period
        alpha, beta = (acceleration_rows(limits, path).r * 0.5 * limits.period)[1]
        exact = np.stack([path.axes[3, :, 1] * 0.5 * limits.period / 800.0, 3.0 * alpha, beta]) * units * close
        near(constraints.jerk.r[-1][:, asked], exact[:, asked])
        assert close.any()
        assert not close.all()
    found = speed_limits(limits, path)
    assert constraints.cap == pytest.approx(speed_cap(limits, path), rel=4e-15)
    lowest = np.stack(list(found.values())).min(axis=0)
    kind = command_kind(curve, limits, path.u[0], path.left)
    names = SpeedBound.of(limits, speeds).names
    tie = np.sort(np.stack(list(found.values())), axis=0)
    clear = asked & ((tie[1] > tie[0] * (1.0 + 1e-12)) if len(tie) > 1 else True)
    assert clear.any() or name == "jerk alone"
    for k in np.flatnonzero(clear):
        expected = list(found)[int(np.argmin([row[k] for row in found.values()]))]
        expected = COMMANDS[kind[k]] if expected == "feed" and kind[k] else expected
        assert names[speeds.which[k]] == expected
    at_chord = (speeds.which == 1) & clear
    ratio = np.minimum(limits.chord_error * path.curvature[at_chord], 1.0)
    assert speeds.power[at_chord] == pytest.approx(2.0 * (1.0 - ratio) / (2.0 - ratio), rel=1e-6)
    other = clear & ~at_chord
    assert np.array_equal(speeds.power[other], np.where(np.isfinite(lowest[other]), 2.0, 0.0))


# ---- scaling, weights, caps, ends ----------------------------------------------------------------------------------


def array_of(constraints, field):
    """A field of the constraints; of rows, their coefficients."""
    found = getattr(constraints, field)
    return getattr(found, "r", found)


@pytest.mark.parametrize(("name", "intervals"), [("teardrop", 100), ("circle", 123), ("butterfly-nurbs", 100)])
@pytest.mark.parametrize("factor", [1000.0, 2.0**-20])
def test_the_same_path_in_other_units_gives_the_same_arrays(name, intervals, factor):
    """Millimetres to micrometres, or any other unit of length."""
    base = mill(chord_error=1e-4, **TANGENTIAL)
    other = Limits(
        100.0 * factor,
        [250.0 * factor] * 2,
        [1000.0 * factor] * 2,
        [20000.0 * factor] * 2,
        1e-4 * factor,
        tangential_acceleration=700.0 * factor,
        tangential_jerk=9000.0 * factor,
    )
    first = rows_of(load_curve(name), base, intervals)[2]
    second = rows_of(load_curve(name, scale=factor), other, intervals)[2]
    # a power of two changes no digit; otherwise a knot near a stop is known to 1e-16 of the whole path only
    accuracy = 1e-12 if factor < 1.0 else 1e-7
    assert second.time_unit == pytest.approx(first.time_unit, rel=max(1e-12, 1e-3 * accuracy))
    for field in ("h", "cap", "acceleration", "jerk", "weight", "guess"):
        ours, theirs = array_of(first, field), array_of(second, field)
        finite = np.isfinite(ours)
        assert np.array_equal(finite, np.isfinite(theirs))
        size = np.median(np.abs(ours[finite])) if factor < 1.0 else 1e2 * np.abs(ours[finite]).max()
        assert theirs[finite] == pytest.approx(ours[finite], rel=accuracy, abs=1e-12 * size)


def test_the_same_motion_in_another_unit_of_time_gives_the_same_arrays():
    slow = Limits(10.0, [25.0] * 2, [10.0] * 2, [20.0] * 2, 1e-3, period=1e-2)
    fast = mill()
    first, second = (rows_of(load_curve("teardrop"), limits)[2] for limits in (fast, slow))
    assert second.time_unit == pytest.approx(10.0 * first.time_unit, rel=1e-9)
    for field in ("h", "cap", "acceleration", "jerk", "guess"):
        assert array_of(second, field) == pytest.approx(array_of(first, field), rel=1e-7)


@pytest.mark.parametrize("name", ["teardrop", "circle", "flank"])
@pytest.mark.parametrize("inner", [1, 3])
def test_weights_add_up_to_the_length_and_integrate_by_their_order(name, inner):
    """Simpson's rule cubics, Boole's polynomials of degree 5."""
    limits = load_limits("five-axis") if name == "flank" else DRIVES
    _, grid, constraints, _ = rows_of(load_curve(name), limits, inner=inner)
    assert constraints.weight.sum() * constraints.length_unit == pytest.approx(grid.map.span, rel=1e-13)
    assert constraints.h.sum() * constraints.length_unit == pytest.approx(grid.map.span, rel=1e-13)
    assert constraints.h[constraints.h > 0.0].mean() == pytest.approx(1.0)
    sigma, order = places_of(grid, inner)[0] / grid.map.span, inner + 2
    assert constraints.weight @ sigma**order == pytest.approx(constraints.weight.sum() / (order + 1), rel=1e-12)


def test_empty_intervals_carry_no_rows():
    section, grid, constraints, _ = rows_of(load_curve("circle"), LIMITS)
    empty = 2 * np.flatnonzero(np.diff(grid.sigma) == 0.0) + 1
    assert empty.size == grid.map.piece.size - 1 >= section.curve._candidate_breaks().size > 0
    assert not constraints.acceleration.r[:, :, empty].any()
    assert not constraints.jerk.r[:, :, empty].any()
    assert not constraints.weight[empty].any()


def test_rows_exist_for_finite_limits_only():
    some = Limits(np.inf, [np.inf, 100.0], [1000.0, np.inf], [np.inf, np.inf], tangential_jerk=5000.0)
    _, grid, constraints, path = rows_of(FORMULA, some)
    assert constraints.acceleration.r.shape[:2] == (1, 2)
    assert constraints.jerk.r.shape[:2] == (2, 3)
    # X has an acceleration limit and none of the jerk: within four periods of a stop alone its ramp takes half a one
    sigma = places_of(grid)[0]
    inside = np.minimum(sigma, grid.map.span - sigma) < 4.0 * some.period
    assert 0 < np.count_nonzero(inside) < inside.size
    unit = constraints.jerk.r[0, 2, 5] / (path.tip[1, 5] / 5000.0)
    ramp = path.axes[1, :, 0] * 0.5 * some.period / 1000.0 * unit
    assert constraints.jerk.r[1, 2] == pytest.approx(
        np.where(inside, ramp, 0.0), rel=1e-9, abs=1e-12 * np.abs(ramp).max()
    )
    assert np.array_equal(acceleration_rows(some, path).r[0, 1], path.axes[1, :, 0] / 1000.0)
    assert np.array_equal(jerk_rows(some, path).r[0, 2], path.tip[1] / 5000.0)
    with np.errstate(divide="ignore"):
        assert speed_cap(some, path)[1:-1] == pytest.approx((100.0 / np.abs(path.axes[1, 1:-1, 1])) ** 2)
    # each row knows its limit
    assert [row.name for row in constraints.acceleration.of] == ["acceleration X"]
    assert [row.name for row in constraints.jerk.of] == ["tangential jerk", "acceleration X"]
    none = Limits(50.0, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2)
    assert acceleration_rows(none, path).r.shape == (0, 2, path.curvature.size)
    assert jerk_rows(none, path).r.shape == (0, 3, path.curvature.size)


def test_cap_is_the_smallest_of_feed_chord_and_velocities():
    limits = Limits(120.0, [90.0, 200.0], [1000.0, 800.0], [20000.0, 30000.0], 1e-5)
    _, _, constraints, path = rows_of(FORMULA, limits)
    u, rate = path.u[:2, 5:-5]
    d = FORMULA.derivatives(u, 2)
    speed = np.sqrt(np.sum(d[1] ** 2, axis=-1))
    # radius by three points on the curve
    near = [FORMULA.derivatives(u + k * 1e-4, 0)[0] for k in (-1, 0, 1)]
    sides = [np.sqrt(np.sum((near[i] - near[j]) ** 2, axis=-1)) for i, j in ((0, 1), (1, 2), (2, 0))]
    (ax, ay), (bx, by) = ((near[1] - near[0]).T, (near[2] - near[0]).T)
    radius = sides[0] * sides[1] * sides[2] / (2.0 * np.abs(ax * by - ay * bx))
    chord = 2.0 / limits.period * np.sqrt(2.0 * radius * 1e-5 - 1e-10)
    allowed = np.minimum(np.minimum(120.0, chord), (limits.velocity / np.abs(d[1])).min(axis=-1) * speed) / speed
    unit = constraints.length_unit / constraints.time_unit
    ours = np.sqrt(constraints.cap[5:-5]) * unit * rate
    assert ours == pytest.approx(allowed, rel=1e-5)
    assert chord_feed_limit(1.0 / radius, limits) == pytest.approx(chord, rel=1e-12)
    assert np.count_nonzero(np.isclose(ours * speed, chord, rtol=1e-4)) > 5


@pytest.mark.parametrize("name", ["teardrop", "circle"])
def test_prescribed_feeds(name):
    curve = load_curve(name)
    limits = DRIVES
    _, _, constraints, path = rows_of(curve, limits, start=30.0, end=20.0)
    unit = constraints.length_unit / constraints.time_unit
    for value, at, feed in ((constraints.start, 0, 30.0), (constraints.end, -1, 20.0)):
        assert np.sqrt(value) * unit * np.sqrt(np.sum(path.axes[1, at] ** 2)) == pytest.approx(feed, rel=1e-14)
    _, _, constraints, _ = rows_of(curve, limits, start=30.0)
    assert np.isnan(constraints.end)


def test_at_rest_and_on_a_periodic_path_the_ends_are_free():
    limits = DRIVES
    for periodic in (False, True):
        _, _, constraints, _ = rows_of(load_curve("circle"), limits, periodic=periodic)
        assert constraints.periodic is periodic
        assert np.isnan([constraints.start, constraints.end]).all()


def test_velocity_and_acceleration_rows_vanish_at_a_stop():
    """The map takes the path through a stop at finite sigma_dot, at rest with no acceleration."""
    _, _, constraints, path = rows_of(FORMULA, LIMITS)
    for end in (0, -1):
        assert not path.axes[1:3, end].any()
        assert np.abs(path.axes[3, end]).max() > 0.0
        assert not constraints.acceleration.r[:, :, end].any()
        assert constraints.cap[end] == np.inf
    assert (constraints.guess > 0.0).all()
    assert np.isfinite(constraints.guess).all()


def test_where_the_tip_rests_only_the_axes_count():
    xy = [[10.0 * k, 0.0] for k in range(4)] + [[30.0, 0.0]] * 5 + [[30.0, 10.0 * k] for k in range(1, 4)]
    points = np.column_stack([xy, 0.05 * np.arange(len(xy))])
    knots = [0, 0, 0, 0, *range(1, len(xy) - 3), *[len(xy) - 3] * 4]
    curve = NurbsCurve(points, knots, 3, axes=["X", "Y", "A"])
    rows = {"velocity": [250, 250, 2], "acceleration": [1000, 1000, 10], "jerk": [20000, 20000, 200]}
    limits = Limits(100.0, **rows, chord_error=1e-3, axes=["X", "Y", "A"], **TANGENTIAL)
    _, grid, constraints, path = rows_of(curve, limits, 400)
    inside = np.flatnonzero((path.u[0] > 5.1) & (path.u[0] < 5.9))
    assert inside.size > 10
    assert not path.tip[1:, inside].any()
    assert not path.curvature[inside].any()
    assert not constraints.acceleration.r[3, :, inside].any()
    a = path.axes[1, inside, 2] * constraints.length_unit / constraints.time_unit
    assert constraints.cap[inside] == pytest.approx((2.0 / a) ** 2)
    assert all(
        np.isfinite(array).all() for array in (constraints.acceleration.r, constraints.jerk.r, constraints.guess)
    )
    assert grid.intervals == pytest.approx(400, rel=0.02)


# ---- curvature jumps -----------------------------------------------------------------------------------------------


def jerk_of_tangents(rows):
    """Size of the coefficients of c, over all axes, at every point."""
    return np.sqrt(np.sum(rows[:, 2] ** 2, axis=0))


@pytest.mark.parametrize("period", [2e-4, 1e-3, 5e-3])
def test_a_curvature_jump_caps_the_step_of_the_acceleration(period):
    limits = drives(acceleration=[1000.0, 2000.0], jerk=[20000.0, 15000.0], period=period)
    _, grid, constraints, path = rows_of(line_arc_line(), limits, 300)
    unit = constraints.length_unit / constraints.time_unit
    for k in grid.left[:-1][grid.at_breaks[:-1]]:
        step = np.abs(path.axes[2, 2 * k + 2] - path.axes[2, 2 * k])
        x = constraints.cap[2 * k : 2 * k + 3] * unit**2
        assert x == pytest.approx(np.full(3, x[0]))
        # a step D of the acceleration is a jerk of 0.75 D / period in the samples: half of the limit
        assert (0.75 * step * x[0] / period / limits.jerk).max() == pytest.approx(0.5, rel=1e-9)
        # the jerk beside it has the other half, and elsewhere all of it
        ratio = jerk_of_tangents(constraints.jerk.r) / np.maximum(jerk_of_tangents(jerk_rows(limits, path).r), 1e-12)
        beside = ratio > 1.5 * np.median(ratio)
        assert beside[[2 * k - 2, 2 * k - 1, 2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 4]].all()
        assert np.ptp(ratio[beside]) <= 1e-9 * ratio.max()
        assert ratio[beside][0] / np.median(ratio) == pytest.approx(1.0 / 0.49)
        assert np.count_nonzero(beside) < 0.5 * ratio.size


def smooth_path(spans, degree):
    """A wave as a B-spline: of degree 2 its curvature jumps at every knot."""
    s = np.linspace(0.0, 1.0, spans + degree)
    points = np.column_stack([60.0 * s, 5.0 * np.sin(6.0 * np.pi * s)])
    knots = [*[0.0] * degree, *np.linspace(0.0, 1.0, spans + 1), *[1.0] * degree]
    return NurbsCurve(points, knots, degree)


def test_jumps_closer_than_a_few_periods_share_the_jerk():
    """Steps that meet in the samples add up, and the jerk beside them is halved once, not once for every jump."""
    limits = DRIVES
    curve = smooth_path(1000, 2)
    section, grid, constraints, path = rows_of(curve, limits, 1000)
    assert len(section.jumps) > 900
    unit = constraints.length_unit / constraints.time_unit
    ours, plain = jerk_of_tangents(constraints.jerk.r), jerk_of_tangents(jerk_rows(limits, path).r)
    there = (ours > 0.0) & (plain > 1e-9 * plain.max())
    ratio = ours[there] / plain[there]
    assert ratio.max() <= ratio.min() / 0.49 * (1.0 + 1e-9)
    first = grid.left[:-1][grid.at_breaks[:-1]]
    at, step = grid.sigma[first], path.axes[2, 2 * first + 2] - path.axes[2, 2 * first]
    x = constraints.cap[2 * first] * unit**2
    alone = np.min(2.0 / 3.0 * limits.jerk * limits.period / np.abs(step), axis=1)
    assert (x <= alone * (1.0 + 1e-9)).all()
    for k in range(3, first.size - 3, 50):
        # the third difference of the samples of q with these steps at constant sigma_dot, by brute force
        speed = np.sqrt(x[k])
        t = (at - at[k]) / speed
        time = limits.period * (np.arange(4)[:, None] - 1.5 + np.linspace(-1.0, 1.0, 41))
        moved = np.maximum(time[:, :, None] - t, 0.0) ** 2 / 2.0 @ (step * x[k])
        seen = np.abs(np.diff(moved, 3, axis=0)).max(axis=(0, 1)) / limits.period**3
        assert (seen / limits.jerk).max() <= 0.5 * 1.01


def test_path_at_reads_a_break_from_the_side_asked_for():
    curve = line_arc_line()
    limits = DRIVES
    (section,) = cut(curve, limits, exact_stop=False)
    sigma = section.sigma(section.coordinate(np.array([1.0, 1.0])))
    path = path_at(section, limits, sigma, np.array([1.0, 1.0]), np.array([True, False]))
    assert path.curvature == pytest.approx([0.0, 0.1], abs=1e-12)
    assert path.axes[2] == pytest.approx(np.array([[0.0, 0.0], [0.0, 0.1]]), abs=1e-9)
