"""Feeds that the path itself commands: kept by plans and samples, and found where they are not."""

from dataclasses import replace

import numpy as np
import pytest
from cases import drives
from program_blocks import line, program

from interp import replay
from planner import check, plan_feedrate
from planner.geometry.curve import FeedCaps
from planner.programs.path.smooth_path import program_path

MACHINE = drives(np.inf, dim=3)


@pytest.fixture(scope="module")
def stepped():
    """Two lines in a row, the first at 100 mm/s, the second at 20 mm/s, and the limits for their one axis."""
    curve = program_path(program(line(40, 0), line(60, 0, feed=20.0)), 0.01, MACHINE, path="separate").curve
    return curve, MACHINE.for_curve(curve)


def s_curve(change):
    """Time of a change of feed between two cruises at 1000 mm/s^2 and 20000 mm/s^3, s."""
    return change / 1000.0 + 0.05 if change > 50.0 else 2.0 * np.sqrt(change / 20000.0)


def test_edges_belong_to_the_stretch_of_their_side():
    caps = FeedCaps(np.array([0.0, 1.0, 3.0]), np.array([5.0, 2.0]))
    u = np.array([0.0, 0.5, 1.0, 2.0, 3.0])
    assert caps.at(u).tolist() == [5.0, 5.0, 2.0, 2.0, 2.0]
    assert caps.at(u, True).tolist() == [5.0, 5.0, 5.0, 2.0, 2.0]


def test_the_feed_falls_before_the_step(stepped):
    """A little sooner than cruise to cruise: a plan may brake into the step and dip below the slower feed."""
    curve, limits = stepped
    profile = plan_feedrate(curve, limits)
    up, down, stop = s_curve(100.0), s_curve(80.0), s_curve(20.0)
    first = (40.0 - 50.0 * up - 60.0 * down) / 100.0
    exact = up + first + down + (20.0 - 10.0 * stop) / 20.0 + stop
    assert 0.99 * exact <= profile.duration <= exact * 1.0005
    assert profile.feed[np.searchsorted(profile.u, 40.0)] == pytest.approx(20.0, rel=1e-4)
    report = check(curve, limits, profile)
    assert report.ok, str(report)
    (row,) = (row for row in report.rows if row.limit == "programmed feed")
    assert 0.999 < row.ratio <= 1.0 + 1e-6


@pytest.mark.parametrize("method", ["toppra", "scurve", "nlp"])
def test_every_method_keeps_them(stepped, method):
    curve, limits = stepped
    profile = plan_feedrate(curve, limits, method=method, intervals=200)
    (row,) = (row for row in check(curve, limits, profile).rows if row.limit == "programmed feed")
    assert row.ok, str(row)


def test_a_plan_made_without_them_is_found(stepped):
    curve, limits = stepped
    profile = plan_feedrate(replace(curve, feed_caps=None), limits.with_feed(100.0))
    for plan in (replace(profile, curve=curve), replay(curve, profile, 1e-3)):
        broken = [row for row in check(curve, limits, plan).rows if not row.ok]
        # the names of a plan that knew no cap are wrong where one would bind
        named = ["binding limit"] if plan is not profile and hasattr(plan, "binding") else []
        assert [row.limit for row in broken] == ["programmed feed", *named]
        assert broken[0].ratio == pytest.approx(5.0, rel=1e-3)
        assert broken[0].allowed == 20.0
        assert broken[0].u >= 40.0


def test_samples_of_a_plan_keep_them(stepped):
    curve, limits = stepped
    assert check(curve, limits, replay(curve, plan_feedrate(curve, limits), 1e-3)).ok
