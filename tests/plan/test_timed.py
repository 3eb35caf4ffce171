"""A feed that was found with its path is taken under the limits it was found for, and under no others."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import drives
from program_blocks import line, program

from interp import replay
from planner import InputError, SolverError, certify, check, feedrate_limits, load_curve, plan_feedrate
from planner.law import TimeLaw, Timing
from planner.machine.feed_limits import osculating_limits
from planner.programs.path.smooth_path import program_path
from planner.verify.certificate import verify_plan_bound

LIMITS = drives(dim=3, axes=("X", "Y", "Z"))
TWO_RUNS = program(line(10, 0), line(10, 10), line(20, 10, stop=True), line(20, 20), line(30, 20), tolerance=0.02)


@cache
def given():
    path = program_path(TWO_RUNS, None, LIMITS)
    assert path.counts["joint"] == 2
    return path.curve, LIMITS.for_curve(path.curve)


@cache
def taken():
    return plan_feedrate(*given())


def is_taken(profile, law):
    """The rows between its ends are those of the law."""
    inside = (profile.u > law.u[0]) & (profile.u < law.u[-1])
    return profile.u[inside].tolist() == law.u[(law.u > law.u[0]) & (law.u < law.u[-1])].tolist()


def test_it_is_taken_under_its_limits():
    curve, limits = given()
    profile = taken()
    laws = curve.timing.laws
    assert len(laws) == 2
    assert profile.duration == pytest.approx(sum(law.duration for law in laws), rel=1e-6)
    assert profile.duration > sum(law.duration for law in laws)
    assert profile.work.sections == 2
    assert all(is_taken(profile, law) for law in laws)
    assert check(curve, limits, profile).ok
    assert 0.0 < profile.lower_bound <= profile.duration


def test_other_limits_plan_the_path_anew():
    curve, limits = given()
    slower = limits.with_feed(40.0)
    profile = plan_feedrate(curve, slower)
    assert check(curve, slower, profile).ok
    assert profile.feed.max() <= 40.0 * (1.0 + 1e-6)
    assert profile.duration > taken().duration


@pytest.mark.parametrize("options", [{"method": "toppra"}, {"method": "scurve"}, {"intervals": 400}])
def test_what_asks_for_another_solver_gets_it(options):
    curve, limits = given()
    profile = plan_feedrate(curve, limits, **options)
    assert not any(is_taken(profile, law) for law in curve.timing.laws)
    assert profile.method == options.get("method", "optimal")


def test_the_feed_along_the_path_is_near_the_optimum_of_that_path():
    curve, limits = given()
    anew = plan_feedrate(curve, limits, intervals=3000)
    assert check(curve, limits, anew).ok
    assert taken().duration == pytest.approx(anew.duration, rel=2e-3)


@pytest.mark.parametrize(
    ("options", "named"),
    [({"start_feed": 20.0}, "start_feed = 20 mm/s"), ({"end_feed": 5.0}, "end_feed = 5 mm/s")],
)
def test_a_feed_at_an_end_that_was_found_at_rest_is_refused(options, named):
    curve, limits = given()
    with pytest.raises(InputError, match=f'{named}.*found together with its feed.*path = "separate"'):
        plan_feedrate(curve, limits, **options)


def test_a_bound_of_the_path_is_below_the_plan():
    curve, limits = given()
    bound = certify(curve, limits, taken())
    assert 0.9 * taken().duration < float(bound) <= taken().duration * (1.0 + 1e-6)


def test_stretches_are_known_by_their_ends():
    law = TimeLaw(*(np.array(column) for column in ([0.0, 1.0], [2.0, 3.0], [0.0, 0.0], [0.0, 0.0])))
    timing = Timing((law,), "limits")
    assert timing.between(2.0, 3.0) is law
    assert timing.between(2.0, 4.0) is None
    assert timing.between(1.0, 3.0) is None
    assert [timing.covers(u) for u in (1.0, 2.0, 2.5, 3.0, 9.0)] == [False, False, True, False, False]


def turning(*stops):
    """Out along X and back, and out again."""
    moves = [line(10, 0), line(0, 0, stop=bool(stops)), line(10, 0)]
    path = program_path(program(*moves, tolerance=0.01), None, LIMITS)
    return path.curve, LIMITS.for_curve(path.curve)


def test_a_path_that_turns_back_is_not_stopped_at_the_turn():
    curve, limits = turning()
    profile = plan_feedrate(curve, limits)
    for plan in (profile, replay(curve, profile, limits.period)):
        report = check(curve, limits, plan)
        assert report.ok, str(report)
    # each of the two turns saves A / J beside an exact stop, less the way that is left to go at speed
    stopping = plan_feedrate(curve, limits, intervals=1200)
    assert check(curve, limits, stopping).ok
    assert stopping.duration - profile.duration == pytest.approx(2 * 0.048, rel=0.01)
    at = np.flatnonzero((profile.u_rate == 0.0) & (profile.t > 0.0) & (profile.t < profile.duration))
    assert at.size == 4
    assert profile.u_acceleration[at] == pytest.approx([-1000.0, 1000.0] * 2, rel=1e-5)


def test_a_plan_that_turns_back_has_no_bound():
    curve, limits = turning()
    profile = plan_feedrate(curve, limits)
    assert np.isnan(profile.lower_bound)
    with pytest.raises(SolverError, match=r"no lower bound.*turns back at u = 9\.99"):
        certify(curve, limits, profile)
    assert not np.isnan(plan_feedrate(curve, limits, intervals=600).lower_bound)


def test_where_a_stop_is_demanded_it_stops():
    curve, limits = turning("after the way back")
    profile = plan_feedrate(curve, limits)
    assert check(curve, limits, profile).ok
    at = np.flatnonzero(profile.u == curve.stops[0])
    assert profile.u_acceleration[at].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("degrees", [165.0, 176.0, 179.7])
def test_a_turn_tighter_than_the_chord_error_is_bounded_by_what_the_check_measures(degrees):
    """The feed of the osculating circle would be below that of a plan that keeps every chord."""
    angle = np.deg2rad(degrees)
    limits = replace(LIMITS, chord_error=1e-3, period=1e-3)
    end = line(12 + 12 * np.cos(angle), 12 * np.sin(angle))
    path = program_path(program(line(12, 0), end, tolerance=1e-3), None, limits)
    own = limits.for_curve(path.curve)
    profile = plan_feedrate(path.curve, own)
    assert path.counts["joint"] == 1
    states = profile.at(np.linspace(0.0, profile.duration, 20_001)[1:-1])
    assert (states.feed > 1.2 * feedrate_limits(path.curve, own, states.u).chord_error).any()
    assert check(path.curve, own, profile).ok
    assert profile.lower_bound <= profile.duration <= 1.001 * profile.lower_bound
    bound = certify(path.curve, own, profile)
    assert "chord" not in bound.statement
    found = verify_plan_bound(path.curve, own, bound.certificate, profile)
    assert found.ok
    assert "chord" not in found.statement
    assert found.proved == pytest.approx(bound, rel=1e-6)
    assert "chord error" not in {profile.limit_names[k] for k in profile.binding}


def test_where_accelerations_do_not_keep_the_chords_their_feed_counts():
    curve, _ = given()
    least = np.sqrt(2.0) * 1000.0 * 1e-3**2 / 8.0
    loose, tight = (
        replace(LIMITS, chord_error=share * least, period=1e-3).for_curve(curve) for share in (1.0001, 0.9999)
    )
    assert np.isinf(osculating_limits(curve, loose).chord_error)
    assert osculating_limits(curve, tight) == tight
    alone = load_curve("teardrop")
    assert osculating_limits(alone, loose.for_curve(alone)) == loose.for_curve(alone)
