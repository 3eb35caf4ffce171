"""Splines of a program, from the reader to the plan: exact in the path, blended at their ends, in parts, in the lists."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BPoly

from interp import replay
from planner import InputError, check, load_limits, plan_feedrate, write_ngc
from planner.programs.long import parts, window
from planner.programs.long.windows import plan_program
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.program import LINE, SPLINE
from planner.programs.reading.reader import read_program
from planner.programs.times import KINDS, line_times

MACHINE = load_limits("mill")
HALF = float(np.sqrt(0.5))
HEAD = "G21 G90 G17 G64 P0.01\nG0 X0 Y0\nF3000\n"
END = "\nM2\n"


@pytest.fixture
def read(tmp_path):
    def read(text):
        (tmp_path / "part.ngc").write_text(text)
        return read_program(tmp_path / "part.ngc")

    return read


def planned(source):
    path = program_path(source, None, MACHINE, path="separate")
    limits = MACHINE.for_curve(path.curve)
    return path, limits, plan_feedrate(path.curve, limits, intervals=path.intervals)


def wave(count, *, seed=0):
    """Blocks G5 that go on smoothly, some with a corner between them, and lines and arcs among them."""
    rng = np.random.default_rng(seed)
    out, x = [], 0.0
    for k in range(count):
        x += 4.0
        y = float(rng.uniform(-2.0, 2.0))
        if k % 5 == 3:
            out.append(f"G1 X{x:.3f} Y{y:.3f}")
        elif k % 5 == 4:
            out.append(f"G2 X{x:.3f} Y{y:.3f} R9")
        else:
            handles = "" if k % 5 == 1 else f"I1.5 J{rng.uniform(-2, 2):.3f} "
            out.append(f"G5 X{x:.3f} Y{y:.3f} {handles}P-1.5 Q{rng.uniform(-2, 2):.3f}")
    return "\n".join(out)


ARC = {
    "between lines": "G1 X20\n{}\nG1 Y40",
    "by itself": "{}",
    "after a corner": "G1 Y-5\nG1 X0 Y0\n{}\nG1 X0 Y40",
}


@pytest.mark.parametrize("before", ARC)
def test_a_quarter_circle_is_planned_as_the_arc(read, before):
    x = 20.0 if before == "between lines" else 0.0
    end = x + 11.0  # of this radius 12 mm of margin are no whole number of knots: rounding does not decide how many
    arc = f"G3 X{end} Y11 I0 J11"
    g52 = f"G5.2 X{end} Y0 P{HALF!r} L3\nX{end} Y11 P1\nG5.3"
    g62 = f"G6.2 P3 K0 X{x} Y0\nK0 X{end} Y0 R{HALF!r}\nK0 X{end} Y11\nK1\nK1\nK1"
    found = [planned(read(HEAD + ARC[before].format(words) + END)) for words in (arc, g52, g62)]
    durations = [profile.duration for _, _, profile in found]
    assert durations[1:] == pytest.approx([durations[0]] * 2, rel=1e-9)
    for path, limits, profile in found:
        assert check(path.curve, limits, profile).ok
        assert path.curve.length == pytest.approx(found[0][0].curve.length, rel=1e-12)


class TestPath:
    def test_lies_on_the_spline_as_it_was_written(self, read):
        """Where nothing is blended every point of the path is a point of the cubic: to rounding, not to a tolerance."""
        path, _, _ = planned(read(HEAD + "G5 X10 Y5 I4 J6 P-3 Q1" + END))
        u = np.linspace(*path.curve.domain, 301)
        spline = BPoly(np.array([[0, 0], [4, 6], [7, 6], [10, 5]], dtype=float)[:, None], [0.0, 1.0])
        w = np.linspace(0.0, 1.0, 301)
        point = path.curve.derivatives(u, 0)[0]
        for _ in range(60):
            away, slope = spline(w) - point, spline.derivative()(w)
            w = np.clip(w - (away * slope).sum(axis=1) / (slope**2).sum(axis=1), 0.0, 1.0)
        assert np.sqrt(((spline(w) - point) ** 2).sum(axis=1)).max() < 1e-13
        assert np.sqrt((path.curve.derivatives(u, 1)[1] ** 2).sum(axis=1)) == pytest.approx(1.0, abs=1e-14)
        assert path.deviation.largest == 0.0

    @pytest.mark.parametrize("seed", range(3))
    def test_keeps_the_tolerance_and_its_plan_the_limits(self, read, seed):
        path, limits, profile = planned(read(HEAD + wave(25, seed=seed) + END))
        assert path.counts["corners"] + path.counts["tubes"] > 5
        assert 0.005 < path.deviation.largest <= 0.01
        assert path.deviation_share <= 1.0
        report = check(path.curve, limits, profile)
        assert report.ok, report.summary()
        assert check(path.curve, limits, replay(path.curve, profile)).ok

    def test_deviation_of_its_own_making_is_seen(self, read):
        """The measure does not take the path's word: a program whose handle is another by 0.1 mm is off by 0.0444."""
        from planner.programs.path.deviation import deviation
        from planner.programs.path.moves import MovingBlocks

        path, _, _ = planned(read(HEAD + "G5 X10 Y0 I3 J6 P-3 Q6" + END))
        other = read(HEAD + "G5 X10 Y0 I3 J6.1 P-3 Q6" + END)
        programmed = MovingBlocks.of(other, None).programmed
        u = np.array(path.curve.domain)
        found = deviation(path.curve, programmed, u, programmed.edges[[0, -1]], 3.0)
        assert found.from_path == pytest.approx(found.from_program, rel=1e-2)
        assert 0.03 < found.largest < 0.0445

    def test_smooth_continuation_needs_neither_corner_nor_tube(self, read):
        """A straight line into a cubic with no curvature at its ends goes on exactly."""
        path, _, _ = planned(read(HEAD + "G1 X10\nG5 X30 Y10 I5 J0 P-10 Q0\nG1 X40" + END))
        curvature = path.curve.curvature(np.array([10.0]), side="right")
        assert curvature[0] > 1e-3  # it has one here: the tube is right
        assert path.counts["tubes"] >= 1
        straight, _, _ = planned(read(HEAD + "G1 X10\nG5 X20 Y0 I3 J0 P-3 Q0\nG1 X40" + END))
        assert straight.counts["tubes"] == straight.counts["corners"] == straight.counts["stops"] == 0

    def test_exact_mode_stops_at_the_ends_and_not_within(self, read):
        """Under G61 a spline of several pieces is one move: its pieces join smoothly, and nothing stops there."""
        source = read(HEAD + "G61\nG5 X4 Y4 I0 J6 P-1 Q-6\nG1 X20" + END)
        assert np.count_nonzero(source.kind == SPLINE) > 1
        path, _, _ = planned(source)
        assert [stop.line for stop in path.stops] == [5]
        assert path.deviation.largest == 0.0

    def test_short_splines_are_absorbed(self, read):
        """Splines inside the tolerance beside a corner leave no corner of nanometres."""
        short = "G1 X10\nG5 X10.0005 Y0.0005 I0.0002 J0.0002 P-0.0002 Q-0.0001\nG1 Y10"
        path, _, profile = planned(read(HEAD + short + END))
        assert path.counts["absorbed"] >= 1
        assert path.deviation.largest <= 0.01
        _, _, other = planned(read(HEAD + "G1 X10.0005\nG1 Y10" + END))
        assert profile.duration == pytest.approx(other.duration, rel=2e-3)

    def test_many_small_splines_become_a_tube(self, read):
        """Splines that meet at small angles, each far too short for a corner."""
        s = np.linspace(0.0, 6.0, 60)
        points = np.round(np.column_stack([10 * np.sin(s / 3), 10 - 10 * np.cos(s / 3)]), 3)
        rows = [f"G5.1 X{x} Y{y} I{dx / 2:.5f} J{dy / 2 + 0.001:.5f}" for (x, y), (dx, dy) in
                zip(points[1:], np.diff(points, axis=0), strict=True)]  # fmt: skip
        path, limits, profile = planned(read(HEAD + "\n".join(rows) + END))
        assert path.counts["tubes"] == 1
        assert path.counts["corners"] == path.counts["stops"] == 0
        assert check(path.curve, limits, profile).ok

    def test_in_space(self, read):
        text = "G1 Z5\nG6.2 P4 K0 X0 Y0 Z5\nK0 X5 Y0 Z6\nK0 X5 Y5 Z9\nK0 X0 Y9 Z2\nK1\nK1\nK1\nK1\nG1 X-5"
        path, limits, profile = planned(read(HEAD + text + END))
        assert path.curve.axes == ("X", "Y", "Z")
        assert check(path.curve, limits, profile).ok


class TestLists:
    def test_lines_have_their_seconds_and_kind(self, read):
        source = read(HEAD + "G5 X4 Y4 I0 J6 P-1 Q-6\nG5.2 X8 Y4 P1 L3\nX8 Y8 P1\nX4 Y9 P1\nG5.3\nG1 X0" + END)
        path, _, profile = planned(source)
        times = line_times(source, path, profile)
        assert times.line.tolist() == [2, 4, 5, 6, 7, 8, 9]
        kinds = [KINDS[kind] for kind in times.kind]
        assert kinds == ["none", "spline", "none", "spline", "spline", "none", "line"]
        assert times.seconds.sum() == pytest.approx(profile.duration, rel=1e-12)
        assert times.length[1] == pytest.approx(source.lengths[source.line == 4].sum(), rel=1e-14)

    def test_written_program_is_within_its_tolerance_and_is_read_again(self, read, tmp_path):
        path, _, profile = planned(read(HEAD + wave(10) + END))
        written = write_ngc(tmp_path / "out.ngc", path.curve, profile, tolerance=0.005)
        assert written.deviation < written.reach <= 0.005
        again = read_program(tmp_path / "out.ngc")
        assert (again.kind[1:] == LINE).all()
        assert again.end[-1, :2] == pytest.approx(path.curve.derivatives(path.curve.domain[1], 0)[0], abs=1e-5)


@pytest.fixture
def short_windows(monkeypatch):
    monkeypatch.setattr(window, "_WINDOW", 300)
    monkeypatch.setattr(parts, "_FIRST_BLOCKS", 40)
    monkeypatch.setattr(parts, "_MIN_BLOCKS", 20)
    monkeypatch.setattr(parts, "_MAX_BLOCKS", 60)


class TestWindows:
    def test_windows_are_the_whole_plan(self, read, tmp_path, short_windows):
        source = read(HEAD + wave(60, seed=4) + END)
        _, _, whole = planned(source)
        result = plan_program(source, MACHINE, output=tmp_path / "plan.npz")
        assert result.windows > 3
        assert result.duration == pytest.approx(whole.duration, rel=5e-3)
        assert not result.violations

    def test_interrupted_it_goes_on_as_if_it_had_not_been(self, read, tmp_path, short_windows):
        """The journal holds the curves of what is planned and not yet kept."""
        source = read(HEAD + wave(60, seed=4) + END)
        straight = plan_program(source, MACHINE, output=tmp_path / "a.npz")

        class StopError(Exception):
            pass

        def progress(message, share):
            if message == "window 3":
                raise StopError

        with pytest.raises(StopError):
            plan_program(source, MACHINE, output=tmp_path / "b.npz", progress=progress)
        resumed = plan_program(source, MACHINE, output=tmp_path / "b.npz")
        assert resumed.resumed == 2
        assert resumed.duration == straight.duration
        with np.load(straight.table) as a, np.load(resumed.table) as b:
            assert a.files == b.files
            for name in a.files:
                assert np.array_equal(a[name], b[name]), name


@pytest.mark.parametrize("radius", [1e-2, 1e-4, 1e-6, 2e-9])
def test_a_turn_close_to_a_cusp_is_planned(read, radius):
    """The curve that has a cusp for apart = 0: in its middle the speed is 3/2 apart, its slope across it 60."""
    apart = np.sqrt(60.0 * radius) / 1.5
    path, limits, profile = planned(read(HEAD + f"G5 X10 Y0 I{10 + apart:.12f} J10 P{-10 - apart:.12f} Q10" + END))
    assert check(path.curve, limits, profile).ok
    assert path.deviation.largest <= 0.01
    assert profile.duration < 0.63


def test_a_cusp_is_refused_with_its_line(read):
    with pytest.raises(InputError, match=r"part.ngc:4: G5: has a cusp near X5 Y7.5 "):
        read(HEAD + "G5 X10 Y0 I10 J10 P-10 Q10" + END)
