"""Speeds that a bound may assume along the path."""

from __future__ import annotations

import numpy as np
import pytest
from certificates import smooth_certificate

from planner import load_curve
from planner.machine.limits import Limits
from planner.verify.certificate import verify_bound


def test_the_feed_of_the_chord_error():
    """On a circle of 10 mm, the chord of a period leaves it by the error exactly."""
    curve = load_curve("circle")
    radius = 1.0 / curve.curvature(np.array([0.3]))[0]
    limits = Limits(1e9, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2, chord_error=1e-3, period=2e-3)
    nothing = smooth_certificate(curve, seed=0, jerk=0.0, acceleration=0.0, feeds=(np.nan,) * 2, periodic=True)
    report = verify_bound(curve, limits, nothing)
    chord = curve.length / report.proved * limits.period
    assert radius - np.sqrt(radius**2 - 0.25 * chord**2) == pytest.approx(1e-3, rel=1e-9)
    assert "osculating circle" in report.statement
