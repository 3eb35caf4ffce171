"""What a limit is said to cost, against plans with that limit changed, and against an identity that the whole must meet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from cases import drives, ellipse, line_arc_line, square
from problems import laid_out
from program_blocks import line as block
from program_blocks import program, rapid
from strategies import random_nurbs

from planner import Curve, FeedrateProfile, Limits, load_curve, load_limits, plan_feedrate
from planner.geometry.curve import FeedCaps
from planner.geometry.formula import FormulaCurve
from planner.geometry.nurbs import NurbsCurve
from planner.plan.coarse import Effort, coarse_plan
from planner.plan.collocation import states_between
from planner.plan.guess import guess_feed
from planner.plan.rows import build
from planner.plan.section import cut
from planner.plan.sensitivity import SpeedBound, saved_by_one_percent
from planner.plan.solvers.interior import Iterate, is_global, start_from
from planner.plan.stage import Stage, Task
from planner.programs.path.smooth_path import program_path
from planner.types import FloatArray

FREE = [np.inf] * 2
INTERVALS = 2000
# Seconds of plans with other limits differ by the noise of their grids, and bend over 1 %.
TOLERANCE = 0.03  # of the largest saving
ONE_GRID = 2e-3  # the same where knots stay


def arc_into_arc() -> Curve:
    """20 mm along Y, a quarter circle of radius 10 mm to the right and one to the left: the curvature jumps twice."""
    points = [[0, -20], [0, -10], [0, 0], [0, 10], [10, 10], [20, 10], [20, 20]]
    w = np.sqrt(0.5)
    return NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 3, 3, 3], 2, [1, 1, 1, w, 1, w, 1])


def blended(*blocks: Any) -> Curve:
    return program_path(program(*blocks), 0.05, drives(), path="separate").curve


BENDS = (block(40, 0), block(40, 20, feed=50.0), block(60, 30))
Case = tuple[Curve, Limits, dict[str, Any]]
CASES = {
    "formula": lambda: (load_curve("snailshell", scale=10.0), drives(300.0), {}),
    "five axes": lambda: (load_curve("flank"), load_limits("five-axis"), {}),
    "sharp nurbs": lambda: (
        load_curve("butterfly-nurbs"),
        Limits(250.0, FREE, [2000.0, 3000.0], [20000.0, 30000.0]),
        {},
    ),
    "slow axis": lambda: (load_curve("butterfly", scale=10.0), drives(300.0, velocity=[80.0, 150.0]), {}),
    "random": lambda: (random_nurbs(3, 4, 2, spans=3), drives(jerk=[15000.0, 9000.0]), {}),
    "three axes": lambda: (random_nurbs(5, 5, 3, spans=2), Limits(60.0, [90.0] * 3, [500.0] * 3, [5000.0] * 3), {}),
    "line": lambda: (NurbsCurve([[0, 0], [30, 20]], [0, 0, 1, 1], 1), drives(), {}),
    "corners": lambda: (square(20.0), drives(jerk=[20000.0, 15000.0]), {}),
    "jumps": lambda: (line_arc_line(), drives(jerk=[20000.0, 12000.0]), {}),
    "jump from arc to arc": lambda: (arc_into_arc(), drives(jerk=[20000.0, 12000.0]), {}),
    "stops at jumps": lambda: (line_arc_line(), drives(), {"exact_stop": True}),
    "tangential": lambda: (
        load_curve("teardrop"),
        drives(tangential_acceleration=300.0, tangential_jerk=4000.0),
        {},
    ),
    "tangential jerk": lambda: (load_curve("teardrop"), drives(jerk=FREE, tangential_jerk=4000.0), {}),
    "chord": lambda: (load_curve("teardrop"), drives(300.0, chord_error=1e-4), {}),
    "chord as long as the radius": lambda: (
        FormulaCurve({"X": "u", "Y": "2*cos(4*u)"}, (0.0, 6.0)),
        Limits(np.inf, FREE, [20000.0] * 2, [2e6] * 2, chord_error=0.03, period=1e-2),  # radii from 0.031 mm
        {},
    ),
    "periodic": lambda: (ellipse(), drives(300.0), {"periodic": True}),
    "ramp": lambda: (ellipse(), drives(jerk=[20000.0, np.inf], period=5e-3), {}),
    "feeds at the ends": lambda: (load_curve("teardrop"), drives(), {"start_feed": 30.0, "end_feed": 60.0}),
    "jerk alone": lambda: (ellipse(), Limits(np.inf, FREE, FREE, [20000.0, 8000.0]), {}),
    "program": lambda: (blended(*BENDS), drives(80.0), {}),
    "rapids": lambda: (blended(rapid(40, 0), block(60, 0, feed=50.0), rapid(100, 0)), drives(80.0, rapid=120.0), {}),
    "programmed feed": lambda: (blended(block(40, 0, feed=60.0), block(60, 0, feed=20.0)), drives(150.0), {}),
}


@cache
def planned(name: str) -> tuple[Case, FeedrateProfile]:
    case = CASES[name]()
    curve, limits, options = case
    return case, plan_feedrate(curve, limits, intervals=INTERVALS, **options)


def with_changed(curve: Curve, limits: Limits, name: str, factor: float) -> tuple[Curve, Limits]:
    """The same task with one limit, by its name in a plan, times a factor."""
    if name == "programmed feed":
        caps = curve.feed_caps
        assert caps is not None
        return replace(curve, feed_caps=FeedCaps(caps.edges, factor * caps.feed)), limits  # type: ignore[type-var]
    names = ("feed", "velocity", "acceleration", "jerk", "chord_error", "period")
    values: dict[str, Any] = {key: getattr(limits, key) for key in (*names, "axes")}
    values |= {key: getattr(limits, key) for key in ("tangential_acceleration", "tangential_jerk", "rapid")}
    key, axis = name.rsplit(" ", 1) if name.rsplit(" ", maxsplit=1)[-1] in limits.axes else (name, "")
    key = key.replace(" ", "_")
    if axis:
        values[key] = values[key].copy()
        values[key][limits.axes.index(axis)] *= factor
    else:
        values[key] *= factor
    return curve, Limits(**values)


def limited(curve: Curve, limits: Limits) -> list[str]:
    """Names of all limits that are there."""
    found = ["feed"] * bool(np.isfinite(limits.feed)) + ["chord error"] * bool(np.isfinite(limits.chord_error))
    found += ["programmed feed"] * bool(curve.feed_caps is not None and np.isfinite(curve.feed_caps.feed).any())
    found += ["rapid"] * bool(curve.feed_caps is not None and np.isfinite(limits.rapid))
    for kind in ("acceleration", "jerk"):
        found += [f"tangential {kind}"] * bool(np.isfinite(getattr(limits, f"tangential_{kind}")))
    for kind in ("velocity", "acceleration", "jerk"):
        found += [f"{kind} {a}" for a, v in zip(limits.axes, getattr(limits, kind), strict=True) if np.isfinite(v)]
    return found


# Between plans of their own the knots around a jump are elsewhere: 5e-5 of the time, more than 1 % of a limit is worth.
JUMPS = ("jumps", "jump from arc to arc")
SLOW = (
    "formula",
    "five axes",
    "sharp nurbs",
    "slow axis",
    "random",
    "three axes",
    "line",
    "jumps",
    "stops at jumps",
    "tangential jerk",
    "jerk alone",
)
EVERY = [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in CASES]


@pytest.mark.parametrize("name", [case for case in EVERY if case.values[0] not in JUMPS])
def test_what_is_said_to_be_saved_is_saved(name: str) -> None:
    """What 1 % more of a limit saves <= what is said <= what 1 % less costs, for every limit, said to cost or not.

    The two differ where a limit ceases or begins to bind, or two bind together: along a line at 45 degrees both axes have
    the same jerk, more for one alone saves nothing, and what they are worth may be told of either.
    """
    (curve, limits, options), profile = planned(name)
    said = profile.saved_by_one_percent
    names = limited(curve, limits)
    assert set(said) <= set(names)
    bounds = {}
    for limit in names:
        less, more = (
            plan_feedrate(*with_changed(curve, limits, limit, k), intervals=INTERVALS, **options).duration
            for k in (0.99, 1.01)
        )
        bounds[limit] = profile.duration - more, less - profile.duration
    room = TOLERANCE * max(costs for _, costs in bounds.values())
    assert room > 5e-6 * profile.duration
    assert any(saves > 0.5 * costs > room for saves, costs in bounds.values())
    for limit, (saves, costs) in bounds.items():
        assert saves - room <= said.get(limit, 0.0) <= costs + room, limit


@pytest.mark.parametrize("name", [*JUMPS, "tangential", "chord", "three axes", "formula", "jerk alone"])
def test_on_one_grid_the_savings_are_the_derivatives_of_the_time(name: str) -> None:
    """With the knots held, what 0.1 % more of a limit saves and 0.1 % less costs is what is said, to a few thousandths."""
    curve, limits, _ = CASES[name]()
    (section,) = cut(curve, limits, exact_stop=False)
    task = Task(section, limits, guess_feed(section, limits, 1000), "optimal", False, np.inf, None)
    effort = Effort(1000, False)
    coarse = coarse_plan(task, effort, 1000, follow=False)
    stage, before = coarse.first_stage(task, effort, 1000, follow=False), coarse.attempt

    def solved(curve: Curve, limits: Limits) -> tuple[float, Mapping[str, float]]:
        changed = Stage.on(replace(task, limits=limits, section=replace(section, curve=curve)), stage.grid)
        found = changed.solve(task, before, 1e-9)
        return float(changed.time_law(found).t[-1]), found.saved

    time, said = solved(curve, limits)
    room = ONE_GRID * max(said.values())
    assert len([seconds for seconds in said.values() if seconds > 10.0 * room]) >= 1
    for limit in limited(curve, limits):
        less, more = (solved(*with_changed(curve, limits, limit, k))[0] for k in (0.999, 1.001))
        saves, costs = (time - more) / 0.1, (less - time) / 0.1
        assert saves - room <= said.get(limit, 0.0) <= costs + room, limit


WEIGHTS = {"feed": 1.0, "programmed": 1.0, "rapid": 1.0, "velocity": 1.0, "acceleration": 2.0, "jerk": 3.0}
UNMOVED = ("jumps", "jump from arc to arc", "ramp", "feeds at the ends", "chord as long as the radius")


@pytest.mark.parametrize("name", [name for name in CASES if name not in UNMOVED])
def test_all_together_are_worth_the_whole_time(name: str) -> None:
    """Slower by the factor k everywhere, a plan keeps limits divided by k (feed), k^2 (acceleration) and k^3 (jerk).

    So T(V/k, A/k^2, J/k^3) = k T, and its derivative at k = 1 is

        T = - sum_V V dT/dV - 2 sum_A A dT/dA - 3 sum_J J dT/dJ,

    to which the chord error d, that allows a feed (2/P) sqrt(2 rho d) at the period P, adds 2 d dT/dd while d is small
    against the radius rho.  What it excludes: feeds that are prescribed, and jumps of the curvature, whose limit J P
    depends on the period as well, or ramps of axes without a jerk limit, a jerk of A / 8 P.
    """
    _, profile = planned(name)
    kinds = WEIGHTS | {"chord": 2.0}
    total = 0.0
    for limit, saved in profile.saved_by_one_percent.items():
        kind = limit.split(" ")[1] if limit.startswith("tangential") else limit.split(" ")[0]
        total += 100.0 * saved * kinds[kind]
    assert total == pytest.approx(profile.duration, rel=1e-3 if name == "chord" else 1e-4)


def used(curve: Curve, limits: Limits, profile: FeedrateProfile, limit: str) -> FloatArray:
    """Share of a limit of an axis that a plan uses, (n,), by the derivatives of the curve itself."""
    kind, axis = limit.split(" ")
    j = limits.axes.index(axis)
    t = np.linspace(0.0, profile.duration, 20_001)
    law = profile.at(t)
    q = curve.derivatives(law.u, 3)[..., j]
    u1, u2, u3 = law.u_rate, law.u_acceleration, law.u_jerk
    values = {
        "velocity": q[1] * u1,
        "acceleration": q[2] * u1**2 + q[1] * u2,
        "jerk": q[3] * u1**3 + 3.0 * q[2] * u1 * u2 + q[1] * u3,
    }
    return np.abs(values[kind]) / getattr(limits, kind)[j]


@pytest.mark.parametrize(
    "name", [name for name in CASES if name not in ("jumps", "jump from arc to arc", "ramp", "five axes")]
)
def test_a_limit_costs_time_where_it_holds_the_path_back_and_nowhere_else(name: str) -> None:
    """Shares of the time and savings name the same limits; what never comes near its limit saves nothing."""
    (curve, limits, _), profile = planned(name)
    said, shares = profile.saved_by_one_percent, profile.shares()
    assert sum(shares.values()) == pytest.approx(1.0, rel=1e-12)
    largest = max(said.values())
    held = {limit: said.get(limit, 0.0) for limit in limited(curve, limits)}
    held["feed"] = (
        held.get("feed", 0.0) + held.pop("programmed feed", 0.0) + held.pop("rapid", 0.0)
    )  # shares do not tell who commands a feed
    assert max(held.values()) > 0.01 * largest
    assert max(shares.get(limit, 0.0) for limit in held) > 0.02
    for limit, saved in held.items():
        if saved > 0.01 * largest:
            assert limit in shares
        if shares.get(limit, 0.0) > 0.02:
            assert saved > 1e-3 * largest, limit
        if " " in limit and limit.split(" ")[1] in limits.axes and used(curve, limits, profile, limit).max() < 0.9:
            assert saved < 1e-4 * largest
            assert limit not in shares


def test_a_feed_that_the_path_commands_is_not_the_machines() -> None:
    _, profile = planned("programmed feed")
    said = profile.saved_by_one_percent
    assert said.get("feed", 0.0) < 1e-6 * said["programmed feed"]


@pytest.mark.parametrize(("angle", "binding"), [(30.0, "Y"), (44.9, "Y"), (45.1, "X"), (60.0, "X")])
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_at_a_jump_the_axis_across_the_path_has_the_step(angle: float, binding: str, turn: float) -> None:
    """From a line at an angle to X into an arc the step is along the normal, and the arc turns away from it at once."""
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    points = np.array([(-20, 0), (-10, 0), (0, 0), (10, 0), (10, 10.0 * turn)]) @ [along, [-along[1], along[0]]]
    curve = NurbsCurve(points, [0, 0, 0, 1, 1, 2, 2, 2], 2, [1, 1, 1, np.sqrt(0.5), 1])
    limits = drives(500.0)
    _, _, grid = laid_out(curve, limits, 40, parts=10)
    bound = SpeedBound.of(limits, build(limits, grid, inner=1)[1])
    (jump,) = 2 * grid.left[:-1][grid.at_breaks[:-1]]
    names = [bound.names[k] for k in bound.which[jump - 1 : jump + 4]]
    assert names[1:4] == [f"jerk {binding}"] * 3
    assert {names[0], names[4]} <= {"velocity X", "velocity Y"}
    assert bound.power[jump - 1 : jump + 4].tolist() == [2.0, 1.0, 1.0, 1.0, 2.0]


# ---- sums over multipliers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("inner", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_sums_are_those_of_array_arithmetic(inner, seed):
    """More points than fit in a block, double knots, and multipliers of any size."""
    curve, limits = random_nurbs(seed + 3, 4, 2, spans=4), drives(jerk=[15000.0, 9000.0])
    _, _, grid = laid_out(curve, limits, 60, parts=4)
    problem, speeds = build(limits, grid, inner=inner)
    rng = np.random.default_rng(seed)
    iterate = Iterate(problem, start_from(problem, problem.guess), 0.2, 0.95)
    iterate.pairs[...] = 10.0 ** rng.uniform(-9.0, -3.0, iterate.pairs.shape)
    pairs = iterate.pairs.astype(np.float64)
    multipliers = pairs[:, :, 1].transpose(1, 0, 2).reshape(pairs.shape[1], -1)[:, : problem.cap.size]
    pace = states_between(problem.h, iterate.z, inner)[0] ** -0.5
    bound = SpeedBound.of(limits, speeds)
    saved = dict(
        zip(bound.names, np.bincount(bound.which, multipliers[0] * bound.power, len(bound.names)), strict=True)
    )
    rows = (*problem.acceleration.of, *problem.jerk.of)
    for k, row in enumerate(rows):
        both = (multipliers[1 + 2 * k] + multipliers[2 + 2 * k]) * (pace if row.order == 3 else 1.0)
        saved[row.name] = saved.get(row.name, 0.0) + both.sum()
    expected = {name: 0.01 * value for name, value in saved.items() if value > 0.0}
    assert saved_by_one_percent(iterate, bound) == pytest.approx(expected, rel=1e-12)
    # an optimum is proven where no place has more multipliers of jerks than weight
    load = multipliers[1 + 2 * len(problem.acceleration) :].sum(axis=0)
    place = np.append(0, np.cumsum(np.repeat(problem.h > 0.0, inner + 1)))
    assert place[-1] < place.size - 1
    ratio = float((np.bincount(place, load) / np.bincount(place, problem.weight)).max())
    for factor, proven in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        scaled = Iterate(problem, start_from(problem, problem.guess), 0.2, 0.95)
        scaled.pairs[...] = pairs * factor / ratio
        assert is_global(scaled) is proven
