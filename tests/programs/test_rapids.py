"""Rapids run at the axes' velocities or at a rapid of their own, not at the feed of the machine."""

import numpy as np
import pytest
from cases import drives
from program_blocks import line, program, rapid

from interp import replay
from planner import InputError, check, load_limits, plan_feedrate
from planner.output.table import table_limits, write_table
from planner.programs.path.smooth_path import program_path

AXES = ("X", "Y", "Z")
MACHINE = drives(dim=3, axes=AXES)


def s_curve(length, feed, acceleration=1000.0, jerk=20000.0):
    """Time of a move from rest to rest that reaches its feed and its acceleration, s."""
    return length / feed + feed / acceleration + acceleration / jerk


def planned(source, machine=MACHINE, **options):
    path = program_path(source, 0.01, machine)
    limits = machine.for_curve(path.curve)
    return path, limits, plan_feedrate(path.curve, limits, **options)


@pytest.mark.parametrize(("allowed", "feed"), [(np.inf, 250.0), (400.0, 250.0), (180.0, 180.0), (60.0, 60.0)])
def test_a_rapid_takes_the_time_of_its_s_curve(allowed, feed):
    path, limits, profile = planned(program(rapid(500, 0)), MACHINE._replace(rapid=allowed))
    assert profile.duration == pytest.approx(s_curve(500.0, feed), rel=1e-4)
    for plan in (profile, replay(path.curve, profile, 1e-3)):
        report = check(path.curve, limits, plan)
        assert report.ok, str(report)


def test_along_a_diagonal_both_axes_move_at_their_velocities():
    profile = planned(program(rapid(300, 300)))[2]
    assert profile.feed.max() == pytest.approx(250.0 * np.sqrt(2.0), rel=1e-4)


@pytest.mark.parametrize("method", ["toppra", "scurve", "nlp"])
def test_every_method_runs_rapids_faster_than_the_feed(method):
    _, _, profile = planned(program(rapid(200, 0), line(200, 50)), method=method, intervals=200)
    assert profile.feed.max() > 240.0
    assert profile.feed[profile.u > 200.0].max() <= 100.0 * (1.0 + 1e-6)


def test_without_a_jerk_limit_it_is_the_trapezoid():
    _, _, profile = planned(program(rapid(500, 0)), MACHINE.without_jerk())
    assert profile.duration == pytest.approx(500.0 / 250.0 + 0.25, rel=1e-5)


def test_the_check_measures_each_move_against_its_own_limit():
    path, limits, profile = planned(program(rapid(200, 0), line(200, 50)))
    slower = limits._replace(rapid=200.0)
    for plan in (profile, replay(path.curve, profile, 1e-3)):
        (broken,) = (row for row in check(path.curve, slower, plan).rows if not row.ok)
        assert (broken.limit, broken.allowed) == ("feed", 200.0)
        assert broken.ratio == pytest.approx(250.0 / 200.0, rel=1e-3)
        (broken,) = (row for row in check(path.curve, limits.with_feed(50.0), plan).rows if not row.ok)
        assert (broken.limit, broken.allowed) == ("feed", 50.0)
        assert broken.u > 200.0


def test_a_table_keeps_the_rapid(tmp_path):
    _, limits, profile = planned(program(rapid(200, 0)), MACHINE._replace(rapid=150.0))
    for allowed in (limits, limits._replace(rapid=np.inf)):
        write_table(tmp_path / "t.csv", profile, allowed)
        assert table_limits(tmp_path / "t.csv").rapid == allowed.rapid


def test_machine_files_have_a_rapid(tmp_path):
    file = tmp_path / "m.toml"
    axis = '[[axis]]\nname = "X"\nvelocity_mm_s = 250.0\nacceleration_mm_s2 = 1e3\njerk_mm_s3 = 2e4\n'
    file.write_text("feed_mm_s = 100.0\nrapid_mm_s = 150.0\n" + axis)
    assert load_limits(file).rapid == 150.0
    file.write_text("feed_mm_s = 100.0\n" + axis)
    assert load_limits(file).rapid == np.inf
    file.write_text("feed_mm_s = 100.0\nrapid_mm_s = 0.0\n" + axis)
    with pytest.raises(InputError, match=r"rapid_mm_s = 0\.0 must be a number > 0"):
        load_limits(file)
