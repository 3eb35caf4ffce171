"""Plans without a jerk limit: closed forms, finer grids, and that no limit taken away makes a plan slower."""

import acceleration_reference as reference
import numpy as np
import program_blocks
import pytest
from cases import FEEDS, OPTIMA, PROGRAMS, drives, ellipse, line, velocity_time
from program_blocks import program
from strategies import random_nurbs

from planner import check, load_curve, load_limits, plan_feedrate, read_program
from planner.compiled import core
from planner.errors import InfeasibleError
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.plan.solvers import accelerations
from planner.programs.path.smooth_path import program_path
from planner.status import Status

INF = np.inf


def limits_of(feed=100.0, **changes):
    return drives(feed, **({"jerk": INF} | changes))


def planned(curve, limits, **options):
    profile = plan_feedrate(curve, limits, **options)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    return profile


@pytest.mark.parametrize("length", [1e-6, 1.0, 9.9, 10.1, 200.0, 1e6])
def test_a_line_is_run_by_the_trapezoid(length):
    exact = 2.0 * np.sqrt(length / 1000.0) if length < 10.0 else length / 100.0 + 0.1
    assert planned(line(length), limits_of()).duration == pytest.approx(exact, rel=1e-5)


def test_feeds_at_the_ends_of_a_line():
    profile = planned(line(50.0), limits_of(), start_feed=60.0, end_feed=20.0)
    way = (100.0**2 - 60.0**2 + 100.0**2 - 20.0**2) / 2000.0
    assert profile.duration == pytest.approx(0.04 + 0.08 + (50.0 - way) / 100.0, rel=1e-6)
    assert profile.feed[[0, -1]] == pytest.approx([60.0, 20.0], rel=1e-12)


@pytest.mark.parametrize(("start", "end"), [(90.0, 0.0), (0.0, 90.0), (90.0, 10.0)])
def test_feeds_that_no_plan_joins_are_infeasible(start, end):
    with pytest.raises(InfeasibleError, match="no plan from start_feed"):
        plan_feedrate(line(1.0), limits_of(), start_feed=start, end_feed=end)


def test_velocities_alone_are_used_up_everywhere():
    """With nothing but velocity limits the time is the integral of the slowest axis' share."""
    curve = ellipse()
    limits = Limits(INF, [60.0, 25.0], [INF] * 2, [INF] * 2)
    exact = velocity_time(30.0, 10.0, 60.0, 25.0)
    assert planned(curve, limits).duration == pytest.approx(exact, rel=1e-4)


def test_a_steady_circle_runs_at_its_acceleration():
    """With a tangential limit too weak to change the speed, a periodic circle runs at v^2 / r = A."""
    curve = load_curve("circle")
    limits = limits_of(feed=INF, velocity=INF, tangential_acceleration=1e-2)
    radius = curve.length / (2.0 * np.pi)
    profile = planned(curve, limits, periodic=True)
    assert profile.duration == pytest.approx(curve.length / np.sqrt(1000.0 * radius), rel=1e-4)


def test_a_periodic_path_begins_as_it_ends_and_gains_on_a_standing_start():
    curve = load_curve("hypotrochoid", scale=5.0)
    profile = planned(curve, limits_of(), periodic=True)
    assert profile.feed[0] == pytest.approx(profile.feed[-1], rel=1e-9)
    assert profile.duration < planned(curve, limits_of()).duration


@pytest.mark.parametrize("allowed", ["velocity", "acceleration", "tangential_acceleration", "feed"])
def test_any_one_limit_is_enough(allowed):
    everything = {"feed": INF, "velocity": [INF] * 2, "acceleration": [INF] * 2, "jerk": [INF] * 2}
    one = {"velocity": [60.0, 25.0], "acceleration": [900.0, 700.0], "tangential_acceleration": 500.0, "feed": 80.0}
    limits = Limits(**(everything | {allowed: one[allowed]}))
    curve = load_curve("circle")
    profile = planned(curve, limits)
    least = {"feed": curve.length / 80.0, "tangential_acceleration": 2.0 * np.sqrt(curve.length / 500.0)}
    if allowed in least:
        assert profile.duration == pytest.approx(least[allowed], rel=1e-4)


def test_a_rotary_axis_turns_while_the_tip_rests():
    curve = NurbsCurve([[5, 5, 0], [5, 5, 1]], [0, 0, 1, 1], 1, axes=["X", "Y", "A"])
    limits = Limits(100.0, [250, 250, 2], [1000, 1000, 10], [INF] * 3, axes=["X", "Y", "A"])
    assert planned(curve, limits).duration == pytest.approx(0.5 + 0.2, rel=1e-6)


@pytest.mark.parametrize("feed", FEEDS)
@pytest.mark.parametrize(("name", "scale"), [*OPTIMA, ("butterfly-nurbs", 1.0)])
def test_sixteen_times_the_intervals_gain_nothing(name, scale, feed):
    curve, limits = load_curve(name, scale=scale), limits_of(feed, chord_error=1e-3)
    finer = plan_feedrate(curve, limits, intervals=16_000).duration
    for intervals in (None, 1000):
        profile = planned(curve, limits, intervals=intervals)
        assert finer * (1.0 - 1e-6) <= profile.duration <= finer * (1.0 + 5e-5)


@pytest.mark.parametrize("name", ["slots", "zigzag"])
def test_programs_gain_nothing_from_more_intervals_and_never_lose_without_jerk(name):
    path = program_path(read_program(PROGRAMS / f"{name}.ngc"), 0.01, load_limits("mill"))
    limits = load_limits("mill").for_curve(path.curve)
    profile = planned(path.curve, limits.without_jerk(), intervals=path.intervals)
    finer = plan_feedrate(path.curve, limits.without_jerk(), intervals=16 * path.intervals)
    assert profile.duration <= finer.duration * (1.0 + 5e-5)
    for jerk in (2e4, 1e6):
        limited = limits._replace(jerk=[jerk] * limits.dim)
        assert profile.duration <= plan_feedrate(path.curve, limited, intervals=path.intervals).duration


def test_the_limit_of_a_high_jerk_is_the_plan_without_one():
    curve = load_curve("teardrop")
    reference = planned(curve, limits_of()).duration
    times = [plan_feedrate(curve, limits_of(jerk=jerk)).duration for jerk in (1e5, 1e6, 1e7)]
    assert times == sorted(times, reverse=True)
    assert reference * (1.0 - 1e-6) <= times[-1] <= reference * (1.0 + 1e-3)


def random_case(seed):
    rng = np.random.default_rng(seed)
    dim = int(rng.integers(2, 4))
    curve = random_nurbs(seed, int(rng.integers(2, 5)), dim, spans=int(rng.integers(1, 5)))
    limits = Limits(
        rng.uniform(20, 200), rng.uniform(50, 300, dim), rng.uniform(300, 2000, dim), [INF] * dim,
        chord_error=1e-3, tangential_acceleration=rng.uniform(300, 2000),
    )  # fmt: skip
    return curve, limits


def freed(limits):
    """The limits without each of them."""
    for name in ("feed", "chord_error", "tangential_acceleration"):
        yield limits._replace(**{name: INF})
    for name in ("velocity", "acceleration"):
        for j in range(limits.dim):
            row = getattr(limits, name).copy()
            row[j] = INF
            yield limits._replace(**{name: row})


@pytest.mark.parametrize("seed", range(4))
def test_no_limit_taken_away_makes_a_plan_slower(seed):
    curve, limits = random_case(seed)
    duration = planned(curve, limits).duration
    for fewer in freed(limits):
        assert planned(curve, fewer).duration <= duration * (1.0 + 5e-5)
    for jerk in (1e4, 1e6):
        assert duration <= plan_feedrate(curve, limits._replace(jerk=[jerk] * limits.dim)).duration * (1.0 + 5e-5)


@pytest.mark.parametrize("seed", range(4))
def test_what_one_percent_saves_is_what_a_plan_with_it_saves(seed):
    curve, limits = random_case(seed)
    profile = planned(curve, limits)
    saved = profile.saved_by_one_percent
    for j, axis in enumerate(curve.axes):
        more = limits.acceleration.copy()
        more[j] *= 1.01
        gain = profile.duration - plan_feedrate(curve, limits._replace(acceleration=more)).duration
        assert saved.get(f"acceleration {axis}", 0.0) == pytest.approx(gain, abs=1e-4 * profile.duration)
    gain = profile.duration - plan_feedrate(curve, limits.with_feed(1.01 * limits.feed)).duration
    assert saved.get("feed", 0.0) == pytest.approx(gain, abs=1e-4 * profile.duration)


def test_a_programmed_feed_is_told_from_that_of_the_machine():
    """F1200 binds on one leg and the machine's 100 mm/s on the other, where F is higher: each saves its own part."""
    moves = [program_blocks.line(50, 0, feed=20.0), program_blocks.line(50, 50, feed=150.0)]
    path = program_path(program(*moves), 0.01, limits_of())
    limits = limits_of()
    profile = plan_feedrate(path.curve, limits, intervals=500)
    saved = profile.saved_by_one_percent
    more = plan_feedrate(path.curve, limits.with_feed(101.0), intervals=500)
    assert profile.duration - more.duration == pytest.approx(saved["feed"], rel=0.05)
    faster = program_path(program(*(move | {"feed": 1.01 * move["feed"]} for move in moves)), 0.01, limits_of())
    again = plan_feedrate(faster.curve, limits, intervals=500)
    assert profile.duration - again.duration == pytest.approx(saved["programmed feed"], rel=0.05)
    assert saved["programmed feed"] > 5.0 * saved["feed"]
    assert not {"velocity X", "chord error"} & set(saved)


def test_slowing_down_without_jerk_is_said(monkeypatch):
    monkeypatch.setattr(accelerations, "_MAX_ROUNDS", 1)
    monkeypatch.setattr(accelerations, "_MAX_HALVINGS", 0)
    curve = load_curve("butterfly", scale=10.0)
    profile = plan_feedrate(curve, limits_of(), intervals=40)
    assert profile.work.slowdown > 1.001
    assert profile.status is Status.SLOWED
    assert any("slowed down as a whole" in note for note in profile.notes)


def test_toppra_says_nothing_of_a_slowing_down_that_was_none():
    notes = plan_feedrate(line(40.0), limits_of(), method="toppra").notes
    assert not [note for note in notes if "slowed down by -" in note or "slowed down by 0 %" in note]


def test_a_reserve_is_left_without_a_jerk_limit_too():
    curve = load_curve("butterfly", scale=10.0)
    limits = limits_of()
    middle = 0.5 * sum(curve.domain)
    profile = plan_feedrate(curve, limits, reserve=[(middle, 0.2)])
    law = profile.at(np.linspace(0.0, profile.duration, 20_001))
    q = curve.derivatives(law.u, 2)
    share = np.abs(q[2] * law.u_rate[:, None] ** 2 + q[1] * law.u_acceleration[:, None]).max(axis=1) / 1000.0
    after = law.u > middle + 0.01 * np.ptp(curve.domain)
    assert 0.99 < share[~after].max() <= 1.0 + 1e-6
    assert 0.75 < share[after].max() <= 0.8 * (1.0 + 1e-2)
    assert profile.duration > plan_feedrate(curve, limits).duration


def random_stage(seed):
    """Rows of 1 to 8 intervals that hold at rest, of two bounds each, some with leans, some idle or out of reach."""
    rng = np.random.default_rng(seed)
    count, n, points = int(rng.integers(1, 5)), int(rng.integers(1, 9)), int(rng.integers(2, 5))
    rows = rng.normal(size=(count, 2, n, points))
    rows *= 10.0 ** rng.integers(-2, 3, size=(count, 1, 1, 1))
    rows[:, :, rng.integers(n)] *= 0.0 if seed % 3 == 0 else 1.0
    h = rng.uniform(0.1, 2.0, (n, 1))
    offset = h * np.linspace(0.0, 1.0, points)
    offset[:, -1:] = h
    if seed % 4 == 0:  # at one point the control has no say at all
        rows[0, 1, -1, 0], rows[0, 0, -1, 0] = 0.0, 1.3
    cap = rng.uniform(0.1, 5.0, (n, points))
    lean = np.where(rng.random(n) < 0.5, 0.0, rng.normal(0.0, 0.3, n))
    return rows, rng.uniform(0.5, 2.0, (count, 2)), cap, offset, lean


@pytest.mark.parametrize("seed", range(60))
def test_the_compiled_passes_give_the_bits_of_plain_python(seed):
    rows, bounds, cap, offset, lean = random_stage(seed)
    size = rows.shape[0], *offset.shape
    slowest, fastest = ((0.0, 0.0), (0.0, 1.0), (0.3, 0.4), (4.0, 4.0), (0.0, INF))[seed % 5]
    ours, theirs, expected, reach = lean.copy(), lean.copy(), np.empty((2, lean.size + 1)), np.empty((2, lean.size + 1))
    with np.errstate(all="ignore"):
        reference.controllable(rows, bounds, cap, offset, theirs, slowest, fastest, expected)
        core.accelerations_controllable(*size, rows, bounds, cap, offset, ours, slowest, fastest, reach)
        assert np.array_equal(reach, expected, equal_nan=True)
        assert ours.tobytes() == theirs.tobytes()
        if np.isnan(reach).any():
            return
        law, x = np.empty(lean.size + 1), np.empty(lean.size + 1)
        reference.fastest(rows, bounds, cap, offset, theirs, expected, expected[1, 0], law)
        core.accelerations_fastest(*size, rows, bounds, cap, offset, ours, reach, reach[1, 0], x)
        assert x.tobytes() == law.tobytes()
        reference.follow_rows(rows, bounds, offset, law, theirs, expected_lean := np.empty_like(lean))
        core.accelerations_follow_rows(*size, rows, bounds, offset, x, ours, found := np.empty_like(lean))
        assert found.tobytes() == expected_lean.tobytes()


def test_the_stages_hold_what_they_should():
    """Some can be run through and some not; some laws follow a row."""
    run, led = 0, 0
    for seed in range(60):
        rows, bounds, cap, offset, lean = random_stage(seed)
        size, reach, x = (rows.shape[0], *offset.shape), np.empty((2, lean.size + 1)), np.empty(lean.size + 1)
        core.accelerations_controllable(*size, rows, bounds, cap, offset, lean, 0.0, 1.0, reach)
        if not np.isnan(reach).any():
            core.accelerations_fastest(*size, rows, bounds, cap, offset, lean, reach, reach[1, 0], x)
            core.accelerations_follow_rows(*size, rows, bounds, offset, x, lean.copy(), found := np.empty_like(lean))
            run, led = run + 1, led + bool(found.any())
    assert run > 20
    assert led > 5
