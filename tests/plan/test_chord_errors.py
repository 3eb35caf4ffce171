"""The true chord error of a plan: what accelerations alone make of it, and when it is not measured."""

from __future__ import annotations

import numpy as np
import pytest
from cases import DRIVES, MILL, line, square

from planner import Limits, load_curve, load_limits, plan_feedrate
from planner.geometry.nurbs import NurbsCurve
from planner.machine.feed_limits import largest_chord_error
from planner.plan import chord_errors
from planner.plan.chord_errors import highest_chord, slowed_for_chords
from planner.verify.chords import profile_chord

FREE = np.array([True])


def hairpin(seed: int) -> NurbsCurve:
    """A cubic with bends from mild to nearly a cusp."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(7, 2)) * 10.0 ** rng.uniform(-1.5, 1.0, size=(7, 1)), axis=0)
    return NurbsCurve(points, [0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4], 3, name=f"hairpin {seed}")


def true_error(curve, limits, plan):
    return highest_chord(curve, limits, plan.law)[0]


@pytest.mark.parametrize("period", [1e-3, 8e-3])
def test_no_plan_leaves_its_chords_by_more_than_accelerations_allow(period):
    close = 0
    for seed in range(12):
        curve = square(3.0) if seed == 0 else hairpin(seed)
        # neither jerk nor chord error keeps this one from using all of its accelerations, also across the path
        limits = Limits(300.0, [250.0] * 2, [1000.0, 600.0], [2e5] * 2, period=period)
        most = largest_chord_error(curve, limits)
        assert most == pytest.approx(np.hypot(1000.0, 600.0) * period**2 / 8.0, rel=1e-15, abs=0.0)
        found = true_error(curve, limits, plan_feedrate(curve, limits, intervals=100))
        assert found <= most * (1.0 + 1e-6)
        close += found > 0.5 * most
    assert close >= 6  # and the bound is no idle one


def test_only_axes_that_move_the_tip_count():
    curve, limits = load_curve("flank"), load_limits("five-axis")
    linear = [axis in "XYZ" for axis in curve.axes]
    assert 0 < sum(linear) < curve.dim
    most = np.linalg.norm(limits.acceleration[linear]) * limits.period**2 / 8.0
    assert largest_chord_error(curve, limits) == pytest.approx(most, rel=1e-15, abs=0.0)


def test_what_accelerations_allow_is_measured_and_what_they_do_not_is_not(monkeypatch):
    measured = []

    def counted(*given):
        measured.append(given)
        return profile_chord(*given)

    curve = hairpin(3)
    law = plan_feedrate(curve, MILL, intervals=60).law
    monkeypatch.setattr(chord_errors, "profile_chord", counted)
    most = largest_chord_error(curve, MILL)
    for share, times in ((2.01, 0), (np.inf, 0), (1.99, 1), (0.5, 1)):
        error = share * most
        limits = Limits(MILL.feed, MILL.velocity, MILL.acceleration, MILL.jerk, chord_error=error)
        measured.clear()
        factors = slowed_for_chords(curve, limits, [law], FREE)
        assert len(measured) >= times if times else not measured
        assert factors[0] >= 1.0


def test_a_law_too_fast_for_its_chords_is_slowed_down_until_it_keeps_them():
    """Beyond all accelerations: with a period of 8 ms the arc of a corner is no longer told from its chord."""
    curve = hairpin(5)
    law = plan_feedrate(curve, DRIVES, intervals=100).law
    limits = Limits(DRIVES.feed, DRIVES.velocity, DRIVES.acceleration, DRIVES.jerk, chord_error=1e-4, period=8e-3)
    factor = slowed_for_chords(curve, limits, [law], FREE)[0]
    assert factor > 1.0
    found = highest_chord(curve, limits, law.dilated(factor))[0]
    assert 0.99 * limits.chord_error < found <= limits.chord_error * chord_errors.MET_CHORD
    assert slowed_for_chords(curve, limits, [law], ~FREE)[0] == 1.0


def test_a_straight_line_has_no_chord_error():
    limits = Limits(MILL.feed, MILL.velocity, MILL.acceleration, MILL.jerk, chord_error=1e-9)
    curve = line(20.0)
    plan = plan_feedrate(curve, limits, intervals=60)
    assert slowed_for_chords(curve, limits, [plan.law], FREE)[0] == 1.0
