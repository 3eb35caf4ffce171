"""What the page plays back: the tool, its feed and its line at every time are those of the plan."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cases import PROGRAMS
from motions import plan_along, scurve

from feedplan.job import load_job
from feedplan.playback import Playback, PlayedLines
from planner import InputError, Limits, load_curve
from planner.programs.program_text import ProgramText
from planner.programs.times import line_times

CIRCLE, RADIUS = load_curve("circle"), 50.0
LIMITS = Limits(120.0, [250.0, 250.0], [1500.0, 2000.0], [25000.0, np.inf])
MOTION = scurve(CIRCLE.length, 100.0, 1000.0, 20000.0)
# A pocket in a subroutine that is called twice: its lines run twice, and stand below the calls.
LOOPED = """\
N10 G21 G90 G64 P0.01
N20 G0 X0 Y0 Z5
o100 sub
N40 G91 G1 X10 F1200
(of the pocket)
X10 Y5 F600
N60 G90
o100 endsub
N80 o100 call
N90 o100 call
G1 Z1 F300
M2
"""


def states(profile, t):
    found = profile.at(t)
    return profile.curve.tip.derivatives(found.u, 0)[0], found.feed


@pytest.fixture(scope="module")
def circle():
    return plan_along(CIRCLE, MOTION, LIMITS)


@pytest.fixture(scope="module")
def looped(tmp_path_factory):
    """A job, its plan and its text."""
    file = tmp_path_factory.mktemp("looped") / "pocket.ngc"
    file.write_text(LOOPED)
    job = load_job(file, "mill")
    return job, job.plan(), ProgramText.read(file)


class TestFrames:
    def test_between_frames_the_tool_is_where_the_motion_in_closed_form_has_it(self, circle):
        frames = Playback.of(circle, 20_000)
        t = np.random.default_rng(7).uniform(0.0, circle.duration, 5000)
        s, feed, _, _ = MOTION(t)
        position, shown = frames.at(t)
        start, opposite = CIRCLE.derivatives(CIRCLE.arclength.u([0.0, 0.5 * CIRCLE.length]), 0)[0]
        centre = 0.5 * (start + opposite)
        turned = np.arctan2(*(start - centre)[::-1]) - s / RADIUS  # clockwise
        on_circle = centre + RADIUS * np.stack([np.cos(turned), np.sin(turned)], axis=1)
        assert position == pytest.approx(on_circle, abs=1.1e-3)
        assert shown == pytest.approx(feed, abs=0.11)
        assert (frames.t[0], frames.t[-1]) == (0.0, circle.duration)
        assert np.all(np.diff(frames.t) > 0.0)

    @pytest.mark.parametrize("most", [2, 3, 10, 300, 20_000])
    @pytest.mark.parametrize("source", ["butterfly-nurbs", PROGRAMS / "stops.ngc"])
    def test_what_they_are_off_by_is_told(self, source, most):
        job = load_job(source, "mill")
        profile = job.plan()
        frames = Playback.of(profile, most)
        assert frames.t.size <= most
        t = np.random.default_rng(11).uniform(0.0, profile.duration, 3000)
        (position, feed), (tip, speed) = frames.at(t), states(profile, t)
        off = np.linalg.norm(position - tip, axis=1).max(), np.abs(feed - speed).max()
        # It is measured at some places; between them it is hardly larger.
        assert off[0] <= 1.1 * frames.position_error + 1e-9
        assert off[1] <= 1.1 * frames.feed_error + 1e-9
        if most == 20_000:
            assert frames.position_error <= 1e-3
            assert frames.feed_error <= 1e-3 * profile.feed.max()

    def test_more_frames_come_nearer(self, circle):
        errors = [Playback.of(circle, most).position_error for most in (20, 80, 320)]
        assert errors[0] > 8.0 * errors[1] > 64.0 * errors[2]

    def test_fewer_than_two_are_none(self, circle):
        with pytest.raises(InputError, match="most = 1 must be at least 2"):
            Playback.of(circle, 1)


class TestLines:
    def test_they_stand_in_the_order_of_the_run(self, looped):
        job, profile, text = looped
        played = PlayedLines.of(job, profile, text)
        assert played.line.tolist() == [4, 6, 4, 6, 11]
        assert played.feed == pytest.approx([20.0, 10.0, 20.0, 10.0, 5.0])
        assert np.all(np.diff(played.start) > 0.0)
        assert played.number.tolist() == [4, 6, 11]
        assert played.texts() == ["N40 G91 G1 X10 F1200", "X10 Y5 F600", "G1 Z1 F300"]
        assert played.n_words() == ["N40", "", ""]

    def test_each_begins_and_ends_where_its_block_does(self, looped):
        job, profile, text = looped
        played, frames = PlayedLines.of(job, profile, text), Playback.of(profile, 20_000)
        position, _ = frames.at(played.start)
        # at the corners the path may leave the program by its tolerance
        ends = [[10, 0, 5], [20, 5, 5], [30, 5, 5], [40, 10, 5]]
        assert position[1:] == pytest.approx(np.array(ends, dtype=float), abs=0.0111)
        for t, line in zip(played.start, played.line, strict=True):
            assert played.line[played.at(t + 1e-6)] == line
        assert played.line[played.at(profile.duration)] == 11

    def test_where_no_line_runs_twice_they_are_those_of_the_times(self):
        file = PROGRAMS / "slots.ngc"
        job = load_job(file, "mill")
        profile = job.plan()
        played, times = PlayedLines.of(job, profile, ProgramText.read(file)), job.line_times(profile)
        moving = times.seconds > 0.0
        assert played.line.tolist() == times.line[moving].tolist()
        assert played.start == pytest.approx(line_times(job.program, job.path, profile).start[moving], abs=1e-9)
        assert played.n_words() == []
        assert len(played.texts()) == played.number.size

    def test_a_feed_of_rotary_axes_alone_is_none_along_the_path(self, tmp_path):
        file = tmp_path / "turn.ngc"
        file.write_text("G21 G90\nG0 X0 A0\nG1 X10 F600\nG1 A90 F3600\nM2\n")
        limits = Limits(100.0, [250.0, 4.0], [1000.0, 20.0], [2e4, 400.0], axes=("X", "A"))
        job = load_job(file, limits)
        played = PlayedLines.of(job, job.plan(), ProgramText.read(file))
        assert played.line.tolist() == [3, 4]
        assert played.feed.tolist()[0] == 10.0
        assert np.isnan(played.feed[1])

    def test_a_curve_has_none(self, looped):
        _, profile, text = looped
        job = load_job("circle", "mill")
        with pytest.raises(InputError, match="circle has no lines; playing them needs a part program"):
            PlayedLines.of(job, profile, text)

    def test_they_cannot_be_changed(self, looped):
        with pytest.raises(dataclasses.FrozenInstanceError):
            PlayedLines.of(*looped).line = np.zeros(1)
