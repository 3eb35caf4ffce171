"""Plans with a known motion on a line and on an ellipse, and the limits that they use up."""

from __future__ import annotations

import cases
import pytest
from check_plans import ELLIPSE, check, lift, limits_at, profile_on, sampled, scurve, unlimited

from planner import load_curve
from planner.machine.limits import Limits


@pytest.fixture(scope="module")
def line():
    return cases.line(60.0, 80.0)


@pytest.fixture(scope="module")
def line_limits():
    return Limits(100.0, [60.0, 80.0], [600.0, 800.0], [12000.0, 16000.0], 1e-3, 1e-3, 1000.0, 20000.0)


@pytest.fixture(scope="module")
def line_plan(line, line_limits):
    t, s, v, a = scurve(100.0, 100.0, 1000.0, 20000.0)
    return profile_on(line, line_limits, (t, s / 100.0, v / 100.0, a / 100.0))


@pytest.fixture(scope="module")
def circle():
    return load_curve("circle")


@pytest.fixture(scope="module")
def ellipse():
    return cases.ellipse(*ELLIPSE)


@pytest.fixture(scope="module")
def ellipse_plan(ellipse):
    motion = scurve(ellipse.length, 120.0, 900.0, 15000.0, 60)
    return profile_on(ellipse, unlimited(), lift(ellipse, motion))


@pytest.fixture(scope="module")
def ellipse_samples(ellipse, ellipse_plan):
    return sampled(ellipse, ellipse_plan, 1e-3)


@pytest.fixture(scope="module")
def used_up(ellipse, ellipse_plan, ellipse_samples):
    """Limits that the plan on the ellipse, and its samples, use up exactly; they hold."""
    limits = {}
    for kind, plan in (("profile", ellipse_plan), ("samples", ellipse_samples)):
        limits[kind] = limits_at(check(ellipse, unlimited(), plan))
        assert check(ellipse, limits[kind], plan).ok
    return limits
