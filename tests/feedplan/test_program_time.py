"""The time of a part program as a value: its parts add up, and it can be sent to another process."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from cases import PROGRAMS

from feedplan.job import Job, load_job
from feedplan.program_time import time_program
from feedplan.time_text import clock, time_facts, time_text
from planner import InputError, SolverError

MILL = """\
feed_mm_s = 100.0
[program]
tool_change_s = 6.5
[[axis]]
name = "X"
velocity_mm_s = 250.0
acceleration_mm_s2 = 1000.0
jerk_mm_s3 = 20000.0
[[axis]]
name = "Y"
velocity_mm_s = 250.0
acceleration_mm_s2 = 1000.0
jerk_mm_s3 = 20000.0
"""
# From stop to stop 60 mm at 3000 mm/min: s/v + v/a + a/j.
PART = "G21 G90\nT1 M6\nG0 X0\nG61\nG1 X60 F3000\nG4 P0.5\nX0\nT2 M6\nT1 M6\nM2\n"
LEG = 60.0 / 50.0 + 50.0 / 1000.0 + 1000.0 / 20000.0


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shop")
    (folder / "part.ngc").write_text(PART)
    (folder / "mill.toml").write_text(MILL)
    (folder / "bare.toml").write_text(MILL.replace("tool_change_s = 6.5\n", ""))
    return folder


@pytest.fixture(scope="module")
def found(files):
    return time_program(files / "part.ngc", files / "mill.toml")


class TestTotal:
    def test_motion_dwells_and_tool_changes(self, found):
        assert found.motion_s == pytest.approx(2.0 * LEG, rel=1e-4)
        assert (found.dwell_s, found.tool_changes, found.tool_change_s) == (0.5, 3, 6.5)
        assert found.total_s == pytest.approx(2.0 * LEG + 0.5 + 3 * 6.5, rel=1e-5)

    def test_what_is_given_stands_before_what_the_machine_says(self, files, found):
        other = time_program(files / "part.ngc", files / "mill.toml", tool_change_s=2)
        assert other.total_s == pytest.approx(found.motion_s + 0.5 + 3 * 2.0, rel=1e-12)
        assert time_program(files / "part.ngc", files / "mill.toml", tool_change_s=0.0).tool_change_s == 0.0

    def test_changes_whose_time_nobody_says_are_told_and_not_counted(self, files, found):
        bare = time_program(files / "part.ngc", files / "bare.toml")
        assert bare.tool_change_s is None
        assert bare.total_s == pytest.approx(found.motion_s + 0.5, rel=1e-12)
        assert any("3; not in the total" in line for line in time_text(bare))

    @pytest.mark.parametrize("seconds", [-1.0, math.nan, math.inf, "8", True])
    def test_no_time_at_all_is_refused(self, files, seconds):
        with pytest.raises(InputError, match=r"tool_change_s = .* must be a finite number of at least 0, in s"):
            time_program(files / "part.ngc", files / "mill.toml", tool_change_s=seconds)


def test_it_is_what_the_steps_of_a_job_give():
    job = load_job(PROGRAMS / "slots.ngc", "mill")
    profile = job.plan()
    found = time_program(PROGRAMS / "slots.ngc", "mill")
    assert found.lines.seconds.tolist() == job.line_times(profile).seconds.tolist()
    assert found.shares == profile.shares()
    assert sum(found.shares.values()) == pytest.approx(1.0, abs=1e-12)
    assert (found.ok, found.worst) == (job.check(profile).ok, "")


def test_another_process_can_have_it(found):
    again = pickle.loads(pickle.dumps(found))
    assert time_facts(again) == time_facts(found)
    assert time_text(again) == time_text(found)
    assert np.array_equal(again.lines.seconds, found.lines.seconds)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0:00:00"), (59.4, "0:00:59"), (59.6, "0:01:00"), (3599.5, "1:00:00"), (360000.0, "100:00:00")],
)
def test_clock(seconds, text):
    assert clock(seconds) == text


class TestWithoutJerk:
    """The plan without a jerk limit only tells what the limit costs: where there is none, the time of the program stands."""

    def test_a_path_without_such_a_plan(self, tmp_path, monkeypatch):
        monkeypatch.setattr(Job, "without_jerk", lambda job: _Refusing())
        file = tmp_path / "back.ngc"
        file.write_text("G21 G90 F600\nG0 X0 Y0\nG1 X10\nG1 X2\nG1 X4 Y1\nM2\n")
        found = time_program(file, "mill")
        assert found.ok
        assert found.without_jerk is None
        assert found.why_none == "no such plan"
        assert np.isnan(found.jerk_share)
        assert flat_text(found).endswith("jerk limit what it costs is not known: no such plan")
        assert "no jerk" not in flat_text(found)
        facts = time_facts(found)
        assert (
            facts["without_jerk_limit_s"]
            is facts["jerk_limit_costs"]
            is facts["lines"][0]["without_jerk_limit_s"]
            is None
        )
        found.write_lines(tmp_path / "lines.csv")
        assert "without_jerk_limit_s" not in (tmp_path / "lines.csv").read_text()

    def test_a_reversal_and_a_sharp_turn_have_a_time(self, tmp_path):
        file = tmp_path / "back.ngc"
        file.write_text("G21 G90 G0 X0 Y0\nF600\nG1 X10\nG1 X1\nG1 X3 Y3\nM2\n")
        assert time_program(file, "mill").motion_s < 2.367  # of the path made before its feed

    def test_it_is_not_planned_where_nobody_asks(self, files, monkeypatch):
        monkeypatch.setattr(Job, "without_jerk", lambda job: pytest.fail("planned"))
        found = time_program(files / "part.ngc", files / "mill.toml", without_jerk=False)
        assert found.without_jerk is None
        assert flat_text(found).endswith("jerk limit what it costs was not asked for")


class _Refusing:
    def plan(self, progress):
        raise SolverError("no such plan")


def flat_text(found):
    return " ".join(" ".join(time_text(found)).split())
