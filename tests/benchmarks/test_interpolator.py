"""The benchmark of the interpolators must see what is wrong with one before it quotes its time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motions import plan_along, scurve

from benchmarks import interpolator
from interp import replay
from planner import load_curve
from planner.machine.limits import Limits

QUINTIC = interpolator.FORMS[-1]


@pytest.fixture(scope="module")
def case():
    """Curve, limits just above what its plan uses, plan, and what the benchmark finds over all phases."""
    curve = load_curve("teardrop")
    profile = plan_along(curve, scurve(curve.length, 60.0, 600.0, 12000.0))
    limits = Limits(100.0, [60.0] * 2, [600.0] * 2, [12000.0] * 2)
    return curve, limits, profile, interpolator.every_phase(curve, limits, profile)


def test_a_sound_replay_is_timed(case, monkeypatch):
    curve, limits, profile, phases = case
    monkeypatch.setattr(interpolator, "STEPS_PER_REPEAT", 1)
    for form in interpolator.FORMS:
        measured = interpolator.measure(curve, limits, profile, form, 1e-3, phases)
        assert measured.failed == ()
        assert 0.0 < measured.step_ns_fastest <= measured.step_ns < 1e5


def test_a_replay_beyond_the_limits_scores_no_time(case):
    curve, limits, profile, _ = case
    tight = Limits(100.0, limits.velocity, limits.acceleration, limits.jerk * 0.7)
    phases = interpolator.every_phase(curve, tight, profile)
    measured = interpolator.measure(curve, tight, profile, QUINTIC, 1e-3, phases)
    assert measured.failed == ("limits",)
    assert measured.step_ns is None
    assert measured.step_ns_fastest is None


def changed(samples, row, u=0.0, x=0.0):
    """The samples with one of them moved."""
    parameters, position = samples.u.copy(), samples.position.copy()
    parameters[row] += u
    position[row, 0] += x
    return replace(samples, u=parameters, position=position)


@pytest.mark.parametrize(
    ("row", "moved", "found"),
    [
        (500, {"x": 2e-7}, ("samples off the curve", "path error")),
        (500, {"x": 2e-9}, ("samples off the curve",)),
        (-1, {"x": 1e-13}, ("end of the curve",)),
        (500, {"u": -1e-3}, ("parameter falls back", "samples off the curve")),
        (500, {}, ()),
    ],
)
def test_a_planted_fault_is_named(case, row, moved, found):
    curve, _, profile, phases = case
    samples = changed(replay(curve, profile, 1e-3), row, **moved)
    assert interpolator.verdict(curve, profile, QUINTIC, samples, phases) == found


def test_a_missing_sample_is_named(case):
    curve, _, profile, phases = case
    samples = replay(curve, profile, 1e-3)
    short = replace(samples, t=samples.t[:-1], u=np.delete(samples.u, -2), position=np.delete(samples.position, -2, 0))
    assert interpolator.verdict(curve, profile, QUINTIC, short, phases)[0] == "number of samples"


def test_a_jump_to_the_end_counts_at_the_end_and_nowhere_else(case):
    curve, limits, profile, _ = case
    samples = replay(curve, profile, 1e-3)
    kept = 20
    early = replace(
        samples,
        t=samples.t[:-kept],
        u=np.append(samples.u[: -kept - 1], samples.u[-1]),
        position=np.append(samples.position[: -kept - 1], samples.position[-1:], axis=0),
    )
    inside, end = interpolator.difference_ratios(early, limits)
    assert max(inside) < 1.0
    assert end[2] > 10.0
