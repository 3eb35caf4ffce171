"""Joint runs in the chain of a program: between and beside others, in any axes, and with the same definition each time."""

import numpy as np
import pytest
from cases import drives
from program_blocks import arc, line, program, rapid

from interp import replay
from planner import Limits, check, plan_feedrate
from planner.geometry.chain import Kind
from planner.programs.path.smooth_path import program_path

AXES = ("X", "Y", "Z")
LIMITS = drives(dim=3, axes=AXES)
# A joint run, an arc with a corner and one without a tolerance between stops, and a joint run at the end.
MIXED = program(
    line(10, 0),
    line(10, 10),
    line(20, 10, stop=True),
    line(30, 10, tolerance=0.0),
    line(30, 20, tolerance=0.0),
    rapid(30, 40),
    line(40, 40, feed=50.0),
    line(40, 50),
    tolerance=0.02,
)


def made(source, limits=LIMITS, **options):
    path = program_path(source, None, limits, **options)
    own = limits.for_curve(path.curve)
    return path, own, plan_feedrate(path.curve, own)


def test_joint_and_separate_runs_follow_one_another():
    path, limits, profile = made(MIXED)
    assert path.counts["runs"] == 5
    assert next(round(float(law.u[0])) for law in path.curve.timing.laws) == 0
    for plan in (profile, replay(path.curve, profile, limits.period)):
        assert check(path.curve, limits, plan).ok
    # the ends of the blocks at stops are their points
    corners = np.concatenate([MIXED.start[:1], MIXED.end])[:, :2]
    for k in (0, 3, 4, 6, 8):
        assert path.curve.derivatives(path.u[k], 0)[0][:2] == pytest.approx(corners[k], abs=1e-12)
    assert (np.diff(path.u) > 0.0).all()
    _, _, slower = made(MIXED, path="separate")
    assert profile.duration < slower.duration


def test_the_times_of_the_runs_add_up():
    path, limits, profile = made(MIXED)
    laws = path.curve.timing.laws
    stops = [stop.u for stop in path.stops]
    assert {float(law.u[0]) for law in laws} <= {0.0, *stops}
    assert {float(law.u[-1]) for law in laws} <= {path.curve.domain[1], *stops}
    for law in laws:
        begin, end = (profile.t[np.flatnonzero(profile.u == law.u[k])] for k in (0, -1))
        assert end[0] - begin[-1] == pytest.approx(law.duration, rel=1e-6)
    assert path.curve.timing.limits == limits


def test_the_same_program_makes_the_same_curve():
    first, second = (made(MIXED)[0].curve for _ in range(2))
    assert first.fingerprint == second.fingerprint
    assert made(MIXED, path="separate")[0].curve.fingerprint != first.fingerprint


def test_feed_caps_change_at_the_ends_of_blocks():
    path, _, _ = made(MIXED)
    caps = path.curve.feed_caps
    assert caps.edges[1:-1] == pytest.approx(path.u[[5, 6, 7]], abs=0.0)
    assert caps.feed.tolist() == [100.0, np.inf, 50.0, 100.0]


def test_rotary_axes_are_in_rad_on_the_curve_and_go_with_the_others():
    axes = ("X", "Y", "A")
    limits = Limits(100.0, [250.0, 250.0, 10.0], [1000.0, 1000.0, 50.0], [20000.0, 20000.0, 1000.0], axes=axes)
    source = program(line(10, 0, 0, 5), line(10, 10, 0, 10), line(20, 10, 0, 10), tolerance=0.02)
    path, own, profile = made(source, limits)
    assert path.counts["joint"] == 1
    assert check(path.curve, own, profile).ok
    assert path.curve.derivatives(path.curve.domain[1], 0)[0] == pytest.approx(
        [20.0, 10.0, np.deg2rad(10.0)], abs=1e-12
    )
    assert path.deviation_share <= 1.0


def test_where_the_feed_is_measured_on_other_axes_the_run_beside_is_joint_still():
    axes = ("X", "Y", "A")
    limits = Limits(100.0, [250.0, 250.0, 10.0], [1000.0, 1000.0, 50.0], [20000.0, 20000.0, 1000.0], axes=axes)
    source = program(
        line(10, 0), line(10, 10, stop=True), line(10, 10, 0, 30), line(10, 10, 0, 60, stop=True), line(20, 10),
        line(20, 20), tolerance=0.02,
    )  # fmt: skip
    path, own, profile = made(source, limits)
    assert path.curve.tip_columns
    assert (path.counts["runs"], path.counts["joint"]) == (3, 2)  # A alone goes straight on: there both are as fast
    assert check(path.curve, own, profile).ok


def test_arcs_stay_exact_where_their_run_is_separate():
    source = program(arc((10, 0), (5, 0), 1), arc((0, 0), (5, 0), 1, stop=True), line(0, 9), line(9, 9), tolerance=0.02)
    path, _, _ = made(source, path="separate")
    exact = np.linspace(0.0, path.u[2], 50)[5:-5]
    away = np.hypot(*(path.curve.derivatives(exact, 0)[0][:, :2] - [5.0, 0.0]).T) - 5.0
    assert np.abs(away).max() < 1e-12
    assert (path.curve.kind == Kind.LEG).any()
