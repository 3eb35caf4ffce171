"""LinuxCNC programs of planned curves, read back by the reader of part programs."""

import os
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import drives

from interp import replay
from planner import Limits, check, load_curve, plan_feedrate
from planner.errors import BrokenLimitError, InputError
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.output.ngc import write_ngc
from planner.profile import make_profile
from planner.programs.reading.reader import read_program

DEGREES = 180.0 / np.pi


def limits_of(curve, feed=100.0):
    return drives(feed, dim=curve.dim, axes=curve.axes)


@pytest.fixture(scope="module")
def planned():
    curve = load_curve("butterfly-nurbs")
    return curve, plan_feedrate(curve, limits_of(curve))


@pytest.fixture(scope="module")
def stepped():
    """A path of two corners, at which the plan stops."""
    curve = NurbsCurve([[0, 0, 0], [20, 0, 0], [20, 10, 0], [30, 10, 5]], [0, 0, 1, 2, 3, 3], 1, name="steps (3-D)")
    return curve, plan_feedrate(curve, limits_of(curve))


def distance_to_polyline(points, vertices):
    """From each point to the nearest of all segments, by brute force."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(vertices):
        w = np.clip((points - a) @ (b - a) / np.sum((b - a) ** 2), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - w[:, None] * (b - a), axis=1))
    return best


class TestOfAProfile:
    @pytest.mark.parametrize("mode", ["feed", "inverse_time"])
    @pytest.mark.parametrize("tolerance", [0.05, 0.002])
    def test_block_times_sum_to_the_duration(self, tmp_path, planned, mode, tolerance):
        curve, profile = planned
        written = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=tolerance, mode=mode)
        program = read_program(tmp_path / "a.ngc")
        assert len(program) == written.blocks
        assert (program.lengths / program.feed).sum() == pytest.approx(profile.duration, rel=1e-6)
        assert written.duration == pytest.approx((program.lengths / program.feed).sum(), rel=1e-12)

    def test_every_block_has_the_mean_feed_of_the_plan_over_it(self, tmp_path, planned):
        curve, profile = planned
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.002)
        program = read_program(tmp_path / "a.ngc")
        t = np.append(0.0, np.cumsum(program.lengths / program.feed))
        s = profile.at(np.minimum(t, profile.duration)).s
        # The chord is shorter than its arc, most where the path turns sharply.
        assert program.feed == pytest.approx(np.diff(s) / np.diff(t), rel=0.02)

    @pytest.mark.parametrize("tolerance", [0.05, 0.01, 0.001])
    def test_the_lines_stay_within_half_the_tolerance(self, tmp_path, planned, tolerance):
        curve, profile = planned
        written = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=tolerance)
        program = read_program(tmp_path / "a.ngc")
        vertices = np.concatenate([program.start[:1], program.end])[:, :2]
        on_curve = curve.derivatives(np.linspace(*curve.domain, 16001), 0)[0]
        there = distance_to_polyline(on_curve[::16], vertices).max()
        assert there <= 0.5 * tolerance
        assert there == pytest.approx(written.deviation, rel=0.05)
        on_lines = (vertices[:-1] + vertices[1:])[::20] / 2
        back = distance_to_polyline(on_lines, on_curve).max()
        assert back <= 0.5 * tolerance
        assert program.tolerance == pytest.approx(np.full(len(program), 0.5 * tolerance))
        assert (program.naive_tolerance == 0.0).all()

    def test_the_frame(self, tmp_path, planned):
        curve, profile = planned
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.01)
        lines = (tmp_path / "a.ngc").read_text().splitlines()
        assert lines[1:5] == ["G21 G17 G90 G94", "G61", "G0 X54.493 Y52.139", "G64 P0.005 Q0"]
        assert lines[-1] == "M2"
        assert all(line.startswith("G1 X") or line.startswith("G1 Y") for line in lines[5:-1])
        assert not any(word in "".join(lines[5:-1]) for word in "SMTPQ")

    def test_blocks_are_as_short_as_asked_for(self, tmp_path, planned):
        curve, profile = planned
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=1.0, block_time=0.02)
        program = read_program(tmp_path / "a.ngc")
        assert (program.lengths / program.feed).max() <= 0.02 * 1.26  # a fixed time may take a quarter of a step
        assert len(program) <= profile.duration / 0.02 + 2

    def test_stops_are_exact(self, tmp_path, stepped):
        curve, profile = stepped
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.01)
        program = read_program(tmp_path / "a.ngc")
        stops = program.end[program.stop_after, :3]
        assert stops.tolist() == [[20, 0, 0], [20, 10, 0], [30, 10, 5]]
        assert (program.lengths / program.feed).sum() == pytest.approx(profile.duration, rel=1e-6)
        lines = (tmp_path / "a.ngc").read_text().splitlines()
        assert lines.count("G61") == 3
        assert lines.count("G64 P0.005 Q0") == 3
        assert lines[0].startswith("(steps _3-D_: ")

    def test_rotary_axes_in_degrees(self, tmp_path):
        curve = NurbsCurve([[0, 0, 0], [10, 0, 1], [20, 5, 2]], [0, 0, 0, 1, 1, 1], 2, axes=["X", "Y", "A"])
        profile = plan_feedrate(curve, Limits(50, [100] * 3, [500] * 3, [5000] * 3, axes="XYA"))
        written = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.01, mode="inverse_time")
        lines = (tmp_path / "a.ngc").read_text().splitlines()
        assert lines[-2].split()[3] == f"A{round(2 * DEGREES, 4):.4f}".rstrip("0")
        times = [60.0 / float(line.split("F")[1]) for line in lines if line.startswith("G1")]
        assert sum(times) == pytest.approx(profile.duration, rel=1e-6)
        assert written.deviation <= 0.005

    def test_an_angle_counts_at_a_lever(self, tmp_path):
        """A parabola of the angle alone, of height 0.25 rad on the chord: 14.3 degrees, which count as so many mm."""
        curve = NurbsCurve([[0, 0, 0], [10, 0, 0.5], [20, 0, 0]], [0, 0, 0, 1, 1, 1], 2, axes=["X", "Y", "A"])
        profile = plan_feedrate(curve, Limits(50, [100] * 3, [500] * 3, [5000] * 3, axes="XYA"))
        few = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=10.0, block_time=profile.duration)
        many = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.1, block_time=profile.duration)
        assert few.deviation <= 5.0
        assert many.deviation <= 0.05
        assert many.blocks > 5 * few.blocks


class TestOfBrokenPlans:
    """A machine would run what is written: no program of a plan that breaks a limit, or that cannot be checked."""

    def test_a_plan_too_fast_is_not_written(self, tmp_path, planned):
        curve, profile = planned
        nodes = (profile.t / 1.01, profile.u, profile.u_rate * 1.01, profile.u_acceleration * 1.01**2)
        fast = make_profile(curve, profile.limits, TimeLaw(*nodes), method="fast")
        path = tmp_path / "a.ngc"
        with pytest.raises(
            BrokenLimitError, match=r"a\.ngc: not written: the plan BREAKS ITS LIMITS: .* checks fail, the worst"
        ):
            write_ngc(path, curve, fast, tolerance=0.01)
        with pytest.raises(BrokenLimitError):
            write_ngc(path, curve, fast, tolerance=0.01, report=check(curve, profile.limits, fast))
        assert list(tmp_path.iterdir()) == []

    def test_a_plan_without_limits_needs_a_report(self, tmp_path, planned):
        curve, profile = planned
        for plan in (replay(curve, profile), replace(profile, limits=None)):
            with pytest.raises(InputError, match="the plan does not say its limits; give report"):
                write_ngc(tmp_path / "a.ngc", curve, plan, tolerance=0.01)
        assert list(tmp_path.iterdir()) == []


class TestOfSamples:
    def test_one_block_a_period(self, tmp_path, planned):
        curve, profile = planned
        samples = replay(curve, profile)
        report = check(curve, profile.limits, samples)
        written = write_ngc(tmp_path / "a.ngc", curve, samples, tolerance=0.01, report=report)
        program = read_program(tmp_path / "a.ngc")
        assert written.blocks == len(program)
        assert samples.t.size - 10 <= len(program) <= samples.t.size - 1  # those at rest are one
        assert (program.lengths / program.feed).sum() == pytest.approx(samples.t[-1], rel=1e-6)
        where = {tuple(row) for row in program.end[:, :2].tolist()}
        assert {tuple(row) for row in np.round(samples.position[20:-20], 4).tolist()} <= where

    def test_their_distance_is_measured(self, tmp_path, planned):
        curve, profile = planned
        samples = replay(curve, profile, 0.02)
        report = check(curve, profile.limits, samples)
        written = write_ngc(tmp_path / "a.ngc", curve, samples, tolerance=0.01, report=report)
        on_curve = curve.derivatives(np.linspace(*curve.domain, 20001), 0)[0]
        measured = distance_to_polyline(on_curve, samples.position[np.append(True, np.diff(samples.u) > 0)]).max()
        assert written.deviation == pytest.approx(measured, rel=0.05)
        assert written.deviation > 0.01


class TestRefusals:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"tolerance": 0}, "tolerance = 0 must be a number > 0"),
            ({"tolerance": np.inf}, "tolerance = inf mm must be finite and at least 1e-06 mm"),
            ({"tolerance": 0.01, "mode": "fast"}, 'mode = \'fast\' must be "feed" or "inverse_time"'),
            ({"tolerance": 0.01, "block_time": -1}, "block_time = -1 must be a number > 0"),
            ({"tolerance": 0.01, "block_time": 1e-9}, "block_time = 1e-09 s makes"),
            ({"tolerance": 1e-7}, "tolerance = 1e-07 mm must be finite and at least 1e-06 mm"),
        ],
    )
    def test_options(self, tmp_path, planned, options, message):
        with pytest.raises(InputError) as caught:
            write_ngc(tmp_path / "a.ngc", *planned, **options)
        assert str(caught.value).startswith(message)
        assert list(tmp_path.iterdir()) == []

    def test_an_older_file_stays_when_writing_fails(self, tmp_path, planned, monkeypatch):
        path = tmp_path / "a.ngc"
        path.write_text("old")
        monkeypatch.setattr("planner.output.ngc._plain", lambda value, decimals: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write_ngc(path, *planned, tolerance=0.01)
        assert path.read_text() == "old"
        assert [item.name for item in tmp_path.iterdir()] == ["a.ngc"]


@pytest.mark.skipif(shutil.which("rs274") is None, reason="LinuxCNC's interpreter rs274 is not installed")
@pytest.mark.parametrize("mode", ["feed", "inverse_time"])
def test_linuxcnc_accepts_the_program(tmp_path, stepped, mode):
    curve, profile = stepped
    written = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.01, mode=mode)
    for name in ("tool.tbl", "var"):
        (tmp_path / name).write_text("")
    command = ["rs274", "-g", "-n", "2", "-t", "tool.tbl", "-v", "var", "a.ngc"]
    run = subprocess.run(
        command, cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=20, check=True,
        env={**os.environ, "HOME": str(tmp_path)},
    )  # fmt: skip
    assert run.stdout.count("STRAIGHT_FEED") == written.blocks
    assert "PROGRAM_END" in run.stdout
