"""Stretches of constant acceleration in logs of which everything is known."""

import itertools

import numpy as np
import pytest
from known_machines import ACCELERATION, AXES, CORNERS, REST, made_log, path_limit, phases

from planner.calibration.log import Log
from planner.calibration.stretches import noise_of, straight_runs, stretches


def ramps_of_moves():
    """Acceleration and duration of every ramp of the trapezoid."""
    found = []
    for a, b in itertools.pairwise(CORNERS):
        length = float(np.linalg.norm(b - a))
        direction = (b - a) / length
        acceleration = path_limit(ACCELERATION, direction)
        speed = path_limit((150.0, 120.0, 60.0), direction)
        parts = phases(length, speed, acceleration, np.inf)
        found += [(direction, value, duration) for value, duration in parts if value != 0.0]
    return found


@pytest.mark.parametrize(("count", "noise"), [(0.0, 0.0), (1e-3, 0.0), (0.0, 1e-3)])
def test_every_ramp_of_a_trapezoid_is_found(count, noise):
    _, found = stretches(made_log("trapezoid", count=count, noise=noise), 0)
    expected = ramps_of_moves()
    hits = [
        s
        for direction, value, duration in expected
        for s in found
        if abs(np.dot(s.direction, direction)) > 0.999
        and abs(abs(s.acceleration) - abs(value)) < 5 * s.error + 1e-3 * abs(value)
        and s.last - s.first > 700 * duration
    ]  # fmt: skip
    assert len(hits) >= len(expected) == 2 * (len(CORNERS) - 1)


def test_errors_are_as_large_as_said():
    """Over many ramps in noise, distances from the truth in standard errors are those of a normal distribution."""
    _, found = stretches(made_log("trapezoid", noise=5e-4), 0)
    limits = {round(abs(v), 3) for _, v, _ in ramps_of_moves()}
    off = []
    for s in found:
        nearest = min(limits, key=lambda v: abs(v - abs(s.acceleration)))
        if s.last - s.first > 50 and abs(nearest - abs(s.acceleration)) < 0.02 * nearest:
            off.append((abs(s.acceleration) - nearest) / s.error)
    assert len(off) >= 20
    assert np.sqrt(np.mean(np.square(off))) < 2.0


@pytest.mark.parametrize(
    ("count", "noise", "expected"), [(1e-3, 0.0, 1e-3 / np.sqrt(12)), (0.0, 2e-3, 2e-3), (5e-4, 2e-3, 2e-3)]
)
def test_noise(count, noise, expected):
    assert noise_of(made_log("s-curve", count=count, noise=noise)) == pytest.approx(np.full(3, expected), rel=0.15)


def test_a_log_without_noise_has_that_of_its_digits():
    assert noise_of(made_log("s-curve")).max() == 1e-7


def test_arcs_have_no_plateau():
    t = np.arange(4000) * 1e-3
    angle = 2.0 * np.pi * (t - np.sin(2.0 * np.pi * t / 4.0) * 4.0 / (2.0 * np.pi)) / 4.0
    log = Log("a", ("X", "Y"), t, 30.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 1e-3, (slice(0, 4000),))
    assert [s for s in stretches(log, 0)[1] if s.last - s.first > 60] == []


def test_runs_do_not_reach_over_gaps():
    log = made_log("trapezoid")
    half = log.t.size // 2
    cut = Log(log.where, AXES, log.t, log.position, log.period, (slice(0, half), slice(half, log.t.size)))
    for run in straight_runs(cut, 0):
        assert run.first + run.t.size <= half or run.first >= half


def test_rest_alone_is_no_run():
    n = int(REST / 1e-3)
    log = Log("a", ("X",), np.arange(n) * 1e-3, np.full((n, 1), 7.0), 1e-3, (slice(0, n),))
    assert list(straight_runs(log, 0)) == []
