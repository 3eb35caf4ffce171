"""LinuxCNC programs of planned curves, read back by the reader of part programs."""

import os
import re
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


def ramped_time(program, profile, feeds):
    """Time of blocks at their feeds, on ramps as steep as the axes allow along each; by pieces of a micrometre or so."""
    direction = (program.end - program.start)[:, :3] / program.lengths[:, None]
    acceleration = np.min(profile.limits.acceleration.min() / np.maximum(np.abs(direction), 1e-9), axis=1)
    pieces = np.maximum(np.ceil(program.lengths / 1e-3).astype(int), 20)
    way, a, cap = (np.repeat(x, pieces) for x in (program.lengths / pieces, acceleration, feeds))
    squares = np.minimum(np.append(cap, 0.0), np.append(0.0, cap)) ** 2
    for k in range(way.size - 1, -1, -1):
        squares[k] = min(squares[k], squares[k + 1] + 2.0 * a[k] * way[k])
    for k in range(way.size):
        squares[k + 1] = min(squares[k + 1], squares[k] + 2.0 * a[k] * way[k])
    v = np.sqrt(squares)
    return float(np.sum(2.0 * way / (v[1:] + v[:-1])))


def distance_to_polyline(points, vertices):
    """From each point to the nearest of all segments, by brute force."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(vertices):
        w = np.clip((points - a) @ (b - a) / np.sum((b - a) ** 2), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - w[:, None] * (b - a), axis=1))
    return best


class TestOfAProfile:
    @pytest.mark.parametrize("tolerance", [0.05, 0.002])
    def test_a_machine_that_ramps_takes_the_time_of_the_plan(self, tmp_path, planned, tolerance, monkeypatch):
        """Each F is reached within its block, by an axis acceleration of the plan's limits: with the mean, time is lost."""
        curve, profile = planned
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=tolerance)
        program = read_program(tmp_path / "a.ngc")
        assert ramped_time(program, profile, program.feed) == pytest.approx(profile.duration, rel=0.006)
        monkeypatch.setattr("planner.output.ngc.block_feeds", lambda motion, times: motion.length / times)
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=tolerance)
        mean = read_program(tmp_path / "a.ngc")
        assert ramped_time(mean, profile, mean.feed) > 1.008 * profile.duration

    @pytest.mark.parametrize("tolerance", [0.05, 0.002])
    def test_both_modes_say_the_same_feeds(self, tmp_path, planned, tolerance):
        curve, profile = planned
        read, times = [], []
        for mode in ("feed", "inverse_time"):
            written = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=tolerance, mode=mode)
            read.append(read_program(tmp_path / "a.ngc"))
            times.append(written.duration)
            assert len(read[-1]) == written.blocks
        assert read[0].feed == pytest.approx(read[1].feed, rel=1e-6)
        assert times[0] == pytest.approx(times[1], rel=1e-6)

    def test_every_block_has_a_feed_that_the_plan_has_there(self, tmp_path, planned):
        curve, profile = planned
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.002)
        program = read_program(tmp_path / "a.ngc")
        ends = np.concatenate([program.start[:1], program.end])[:, :2]
        along = np.linspace(0.0, profile.duration, 200_001)
        law = profile.at(along)
        on_curve = curve.derivatives(law.u, 0)[0]
        at = [0]
        for point in ends[1:]:  # the place of each end in time, in order
            near = slice(at[-1], at[-1] + 4000)
            at.append(at[-1] + int(np.argmin(np.linalg.norm(on_curve[near] - point, axis=1))))
        for feed, a, b in zip(program.feed, at[:-1], at[1:], strict=True):
            assert 0.95 * law.feed[a : b + 1].min() - 0.2 <= feed <= 1.01 * law.feed[a : b + 1].max() + 0.2

    @pytest.mark.parametrize("tolerance", [0.05, 0.01, 0.001])
    def test_lines_and_blending_share_the_tolerance(self, tmp_path, planned, tolerance):
        curve, profile = planned
        written = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=tolerance)
        program = read_program(tmp_path / "a.ngc")
        vertices = np.concatenate([program.start[:1], program.end])[:, :2]
        on_curve = curve.derivatives(np.linspace(*curve.domain, 16001), 0)[0]
        there = distance_to_polyline(on_curve[::16], vertices).max()
        assert there == pytest.approx(written.deviation, rel=0.05)
        fine = curve.derivatives(np.linspace(*curve.domain, 160_001), 0)[0]
        at = [0]
        for point in vertices[1:]:  # in order: the curve passes places more than once
            near = fine[at[-1] : at[-1] + 4000]
            at.append(at[-1] + int(np.argmin(np.linalg.norm(near - point, axis=1))))
        away = np.empty(len(program))
        for k, (a, b) in enumerate(pairwise(vertices)):
            beside = fine[max(at[k] - 2, 0) : at[k + 1] + 3]
            away[k] = distance_to_polyline(np.linspace(a, b, 9), beside).max()
        blends = program.tolerance[:-1]  # the last block ends exactly
        assert (away[:-1] + blends).max() <= tolerance
        assert away.max() + blends.max() > 0.5 * tolerance
        assert written.reach <= tolerance
        assert (program.naive_tolerance[:-1] == 0.0).all()

    def test_the_frame(self, tmp_path, planned):
        curve, profile = planned
        write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.01)
        lines = (tmp_path / "a.ngc").read_text().splitlines()
        assert lines[1:5] == ["G21 G17 G90 G94", "G61", "G0 X54.493 Y52.139", "G64 P0.005 Q0"]
        assert lines[-1] == "M2"
        moves = [line for line in lines[5:-1] if line.startswith(("G1 X", "G1 Y"))]
        others = [line for line in lines[5:-1] if line not in moves]
        assert not any(word in "".join(moves) for word in "SMTPQ")
        assert others.pop() == "G61.1"
        assert lines[-3] == "G61.1"
        assert all(re.fullmatch(r"G64 P0\.\d+ Q0", line) for line in others)
        assert len(set(others)) > 10

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
        lines = (tmp_path / "a.ngc").read_text().splitlines()
        assert lines.count("G61.1") == 3
        assert lines.count("G64 P0.005 Q0") == 3
        assert lines[0].startswith("(steps _3-D_: ")

    def test_rotary_axes_in_degrees(self, tmp_path):
        curve = NurbsCurve([[0, 0, 0], [10, 0, 1], [20, 5, 2]], [0, 0, 0, 1, 1, 1], 2, axes=["X", "Y", "A"])
        profile = plan_feedrate(curve, Limits(50, [100] * 3, [500] * 3, [5000] * 3, axes="XYA"))
        written = write_ngc(tmp_path / "a.ngc", curve, profile, tolerance=0.01, mode="inverse_time")
        lines = (tmp_path / "a.ngc").read_text().splitlines()
        assert lines[-2].split()[3] == f"A{round(2 * DEGREES, 5):.5f}".rstrip("0")
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
