"""Paths of A B C and U V W: closed forms, what the feed is measured along, tolerance, derivatives, windows, programs out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from program_blocks import arc, line, program, rapid

from planner import check, plan_feedrate
from planner.errors import InputError
from planner.geometry.chain import Kind
from planner.geometry.curve import AXES, DEGREES
from planner.machine.limits import Limits
from planner.output.ngc_program import write_program
from planner.programs.long import parts, window
from planner.programs.long.windows import plan_program
from planner.programs.path.smooth_path import program_path
from planner.programs.path.tube import _across, _normals
from planner.programs.reading.reader import read_program
from planner.programs.times import line_times

ANGULAR = (2.0, 20.0, 400.0)
LIMITS = Limits(
    100.0,
    [250.0] * 3 + [ANGULAR[0]] * 3 + [100.0] * 3,
    [1000.0] * 3 + [ANGULAR[1]] * 3 + [500.0] * 3,
    [2e4] * 3 + [ANGULAR[2]] * 3 + [1e4] * 3,
    axes=AXES,
)
# The program of a four-axis post: turns by themselves, with a line, against the clock.
POST = """G21 G90 G94
G0 X0 Y0 Z10 A0
G1 Z0 F300
G1 A90 F1000
G1 X20 A180 F1000
G1 X40 Y5 A270
G93 G1 X50 A360 F20
G94
G0 Z10
M2
"""


def _rows(limits):
    return limits.velocity, limits.acceleration, limits.jerk


def rest_to_rest(way, velocity, acceleration, jerk):
    """Time of a motion of bounded velocity, acceleration and jerk from rest to rest: seven phases, or fewer."""
    if velocity * jerk < acceleration**2:
        ramp = 2.0 * np.sqrt(velocity / jerk)
    else:
        ramp = acceleration / jerk + velocity / acceleration
    if way >= velocity * ramp:
        return way / velocity + ramp
    if way <= 2.0 * acceleration**3 / jerk**2:
        return 4.0 * np.cbrt(0.5 * way / jerk)
    peak = 0.5 * (np.sqrt(acceleration**4 / jerk**2 + 4.0 * acceleration * way) - acceleration**2 / jerk)
    return 2.0 * (peak / acceleration + acceleration / jerk)


def planned(*moves, tolerance=0.01, limits=LIMITS, **words):
    source = program(*moves, **words)
    path = program_path(source, tolerance, limits)
    profile = plan_feedrate(path.curve, limits.for_curve(path.curve), intervals=path.intervals)
    report = check(path.curve, limits.for_curve(path.curve), profile)
    assert report.ok, report.summary()
    return source, path, profile


def winding(count, seed=0):
    """Short lines of X Y Z A B along a curve that turns, rounded to 1e-4."""
    s = 0.15 * np.arange(1, count + 1)
    shift = np.random.default_rng(seed).uniform(0, 6, 5)
    waves = [np.sin(0.3 * s + shift[k]) * (k + 1) - (k + 1) * np.sin(shift[k]) for k in range(5)]
    points = np.round(np.column_stack([s, *waves[:2], 5.0 * waves[2], s + 3.0 * waves[3]]), 4)
    return [line(*row) for row in points]


class TestClosedForms:
    @pytest.mark.parametrize(
        ("degrees", "feed"), [(200.0, 110.0), (200.0, 999.0), (5.0, 99.0), (0.3, 99.0), (90.0, 16.0)]
    )
    def test_an_axis_that_turns_alone(self, degrees, feed):
        _, _, profile = planned(line(0, 0, 0, degrees), feed=feed)
        velocity = min(ANGULAR[0], feed / DEGREES)
        expected = rest_to_rest(degrees / DEGREES, velocity, *ANGULAR[1:])
        assert profile.duration == pytest.approx(expected, rel=2e-5)

    @pytest.mark.parametrize(("way", "degrees", "feed"), [(3.0, 90.0, 80.0), (3.0, 90.0, 0.5), (50.0, 10.0, 80.0)])
    def test_beside_a_line(self, way, degrees, feed):
        """F is the feed along X; the slower axis holds the others back."""
        _, _, profile = planned(line(way, 0, 0, degrees), feed=feed)
        turn = degrees / DEGREES / way
        velocity, acceleration, jerk = (
            min(linear, angular / turn) for linear, angular in zip((250.0, 1000.0, 2e4), ANGULAR, strict=True)
        )
        expected = rest_to_rest(way, min(velocity, feed), acceleration, jerk)
        assert profile.duration == pytest.approx(expected, rel=2e-5)

    def test_an_axis_beside_x(self):
        _, _, profile = planned(line(0, 0, 0, 0, 0, 0, 30), feed=50.0)
        assert profile.duration == pytest.approx(rest_to_rest(30.0, 50.0, 500.0, 1e4), rel=2e-5)

    def test_beside_an_arc(self):
        """A quarter circle with the feed along it; A follows evenly."""
        _, path, profile = planned(arc((10, 10, 0, 40), (0, 10), 1), feed=5.0)
        assert path.curve.length == pytest.approx(5 * np.pi, rel=1e-12)
        at = path.curve.derivatives(np.linspace(*path.curve.domain, 9), 0)[0]
        assert at[:, 2] * DEGREES == pytest.approx(np.linspace(0, 40, 9), abs=1e-12)
        assert profile.duration == pytest.approx(np.pi, rel=0.03)

    def test_inverse_time(self, tmp_path):
        source = tmp_path / "part.ngc"
        source.write_text("G93\nG1 X3 A90 F4\nA0 F6\nU5 A9 F6\nM2\n")
        read = read_program(source)
        path = program_path(read, 0.01, LIMITS)
        profile = plan_feedrate(path.curve, LIMITS.for_curve(path.curve), intervals=path.intervals)
        assert line_times(read, path, profile).seconds == pytest.approx([15.0, 10.0, 10.0], rel=0.03)


class TestFeed:
    def test_is_measured_along_x_y_z_then_u_v_w_then_degrees(self):
        """Of the plan of every kind of move, from the motion of its axes alone."""
        feeds = np.array([20.0, 15.0, 10.0, 30.0])
        source, path, profile = planned(
            line(10, 0, 0, 30, 0, 0, 5, feed=20.0),
            line(10, 0, 0, 60, 0, 0, 25, feed=15.0),
            line(10, 0, 0, 100, 20, 0, 25, feed=10.0),
            arc((30, 0, 0, 0, 20, 0, 20), (20, 0), 1, feed=30.0),
        )
        assert source.feed_group.tolist() == [0, 1, 2, 0]
        t = np.linspace(0.0, profile.duration, 20001)
        state = profile.at(t)
        rates = path.curve.derivatives(state.u, 1)[1] * profile.law.at(t)[1][:, None]
        block = np.clip(np.searchsorted(path.u, state.u, side="right") - 1, 0, 3)
        names = path.curve.axes
        columns = {g: [names.index(a) for a in group if a in names] for g, group in enumerate(("XYZ", "UVW", "ABC"))}
        scale = np.array([DEGREES if name in "ABC" else 1.0 for name in names])
        largest = np.zeros(4)
        for k, group in enumerate(source.feed_group):
            some = (rates * scale)[block == k][:, columns[int(group)]]
            largest[k] = np.sqrt(np.sum(some**2, axis=1)).max()
        assert (largest <= feeds * (1 + 1e-6)).all()
        assert largest == pytest.approx(feeds, rel=1e-3)

    def test_length_of_the_path(self):
        source, path, _ = planned(line(10, 0, 0, 30), line(10, 0, 0, 90), line(10, 0, 0, 90, 0, 0, 7), tolerance=1e-4)
        assert source.lengths.tolist() == [10, 60, 7]
        assert path.curve.length == pytest.approx(77.0, abs=2e-3)

    def test_of_x_y_z_alone_the_tip_is_the_curve(self):
        path = program_path(program(line(10, 0), line(10, 10), arc((20, 20), (20, 10), -1)), 0.01, LIMITS)
        assert path.curve.tip is path.curve

    def test_no_tube_passes_where_it_changes(self):
        """However little the path turns there, and however short the blocks."""
        _, path, _ = planned(line(0.01, 0, 0, 10), line(0.01, 0, 0, 20), line(0.02, 0, 0, 20.02), line(0.02, 0, 0, 40))
        assert path.counts["tubes"] == 0
        assert path.counts["corners"] + path.counts["stops"] == 3
        assert path.counts["absorbed"] == 0


class TestShape:
    MOVES = (
        line(10, 0, 0, 0),
        line(10, 0, 0, 40),
        line(20, 0, 0, 60, 0, 0, 5),
        line(20, 0, 0, 60, 0, 0, 20),
        arc((30, 10, 5, 90, 0, 0, 20), (20, 10), 1),
        *(line(30 + 0.3 * k, 10 + 0.02 * k * k, 5, 90 + k * k) for k in range(1, 12)),
    )

    def test_derivatives_agree_with_differences(self):
        """Of the curve and of the path its feed is measured on, on lines, arcs, corners and tubes; pieces as well."""
        curve = program_path(program(*self.MOVES), 0.01, LIMITS).curve
        assert set(curve.kind.tolist()) == {Kind.LEG, Kind.BLEND, Kind.SPAN}
        assert curve.tip is not curve
        for path in (curve, curve.tip):
            for a, b in zip(curve.edges[:-1], curve.edges[1:], strict=True):
                u = np.linspace(a, b, 9)[1:-1]
                h = 1e-5 * (b - a)
                d = path.derivatives(u, 3)
                pieces = path.pieces.evaluate(u, 3, False)
                for order in (1, 2, 3):
                    ends = [path.derivatives(u + sign * h, order - 1)[order - 1] for sign in (1, -1)]
                    size = max(1.0, np.abs(d[order]).max())
                    assert np.abs((ends[0] - ends[1]) / (2 * h) - d[order]).max() < 1e-4 * size
                    assert np.abs(pieces[order] - d[order]).max() < 1e-6 * size
        assert (np.abs(np.diff(curve.tip.derivatives(curve.edges[1:-1], 0, side="left")[0], axis=0)) < 1e3).all()

    def test_both_are_continuous_where_pieces_join(self):
        curve = program_path(program(*self.MOVES), 0.01, LIMITS).curve
        inner = curve.edges[1:-1]
        for path in (curve, curve.tip):
            left, right = (path.derivatives(inner, 2, side=side) for side in ("left", "right"))
            assert np.abs(left[:2] - right[:2]).max() < 1e-9
            bends = np.abs(left[2] - right[2]).max(axis=1)
            assert (bends < 1e-6 * (1 + np.abs(left[2]).max())).all()

    def test_the_parameter_is_the_length_with_a_degree_as_a_mm(self):
        curve = program_path(program(*self.MOVES[:5]), 0.01, LIMITS).curve
        u = np.linspace(*curve.domain, 500)[1:-1]
        scale = [DEGREES if axis in "ABC" else 1.0 for axis in curve.axes]
        assert np.sqrt(np.sum((curve.derivatives(u, 1)[1] * scale) ** 2, axis=1)) == pytest.approx(1.0, abs=1e-10)

    def test_a_tool_that_turns_back_stops(self):
        _, path, _ = planned(line(1, 0, 0, 20), line(0, 0, 0, 40), line(1, 0, 0, 60))
        assert [stop.reason for stop in path.stops] == ["the tool turns back"] * 2
        _, path, _ = planned(line(1, 1, 0, 20), line(2, 0, 0, 40), line(3, 1, 0, 60))
        assert path.stops == ()

    @settings(max_examples=12)
    @given(st.integers(0, 10_000), st.sampled_from([0.003, 0.03]), st.sampled_from(["XYA", "XYZA", "XYZAB", "XYZABU"]))
    def test_random_programs_keep_their_tolerance(self, seed, tolerance, axes):
        """By brute force: in X Y Z, in U V W and in degrees each, and all of them together."""
        rng = np.random.default_rng(seed)
        columns = [AXES.index(axis) for axis in axes]
        points = np.zeros((25, 9))
        turn = rng.choice([0.05, 0.3, 2.0], 24)[:, None] * rng.normal(size=(24, len(axes)))
        direction = 0.3 * np.cumsum(turn, axis=0) + rng.normal(size=len(axes))
        step = rng.choice([0.05, 0.5, 6.0], 24)[:, None] * direction / np.sqrt(np.sum(direction**2, axis=1))[:, None]
        points[1:, columns] = np.cumsum(step, axis=0)
        path = program_path(program(*(line(*row) for row in points[1:])), tolerance, LIMITS)
        assert path.deviation_share <= 1.0
        curve = path.curve
        scale = [DEGREES if axis in "ABC" else 1.0 for axis in curve.axes]
        u = np.unique(
            np.concatenate([np.linspace(a, b, 6) for a, b in zip(curve.edges[:-1], curve.edges[1:], strict=True)])
        )
        found = curve.derivatives(u, 0)[0] * scale
        corners = points[:, [AXES.index(axis) for axis in curve.axes]]
        vector = np.diff(corners, axis=0)
        along = np.einsum("ukd,kd->uk", found[:, None] - corners[:-1], vector) / np.sum(vector**2, axis=1)
        away = found[:, None] - corners[:-1] - np.clip(along, 0, 1)[..., None] * vector
        nearest = np.argmin(np.sum(away**2, axis=2), axis=1)
        off = away[np.arange(u.size), nearest]
        for group in ("XYZ", "ABC", "UVW", AXES):
            some = [k for k, axis in enumerate(curve.axes) if axis in group]
            assert np.sqrt(np.sum(off[:, some] ** 2, axis=1)).max(initial=0.0) <= tolerance * (1 + 1e-9)

    def test_rows_of_a_tube_in_many_axes(self):
        """The polytope of the rows lies within the ball of the tolerance, and touches it."""
        rng = np.random.default_rng(4)
        for dim in range(2, 10):
            tangent = rng.normal(size=(40, dim))
            tangent /= np.sqrt(np.sum(tangent**2, axis=1))[:, None]
            normals, share = _normals(tangent)
            for normal in normals:
                assert np.abs(np.sum(normal * tangent, axis=1)).max() < 1e-12
                assert np.sum(normal**2, axis=1) == pytest.approx(1.0, abs=1e-12)
            x = rng.normal(size=(2000, dim))
            x -= np.sum(x * tangent[0], axis=1)[:, None] * tangent[0]
            reach = np.max([np.abs(x @ normal[0]) for normal in normals], axis=0)
            assert (np.sqrt(np.sum(x**2, axis=1)) / reach).max() <= (1.0 + 1e-12) / share
            if dim > 3:
                across = np.array([vector[0] for vector in _across(tangent)])
                assert across @ across.T == pytest.approx(np.eye(dim - 1), abs=1e-12)


def test_more_axes_than_the_program_moves():
    source = program(line(10, 0, 0, 30), line(20, 5, 0, 60))
    path = program_path(source, 0.01, LIMITS)
    assert path.curve.axes == ("X", "Y", "A")
    assert program_path(program(line(0, 0, 0, 0, 0, 90)), 0.01, LIMITS).curve.axes == ("X", "C")


def test_one_number_for_every_axis_says_nothing_of_one_that_turns():
    limits = Limits(100.0, 250.0, 1000.0, 2e4)
    with pytest.raises(
        InputError, match="velocity = 250 is one number for every axis, but A turns and is measured in rad"
    ):
        program_path(program(line(10, 0, 0, 30)), 0.01, limits)


def test_a_rapid_turns_at_the_limits_of_its_axis():
    _, _, profile = planned(rapid(0, 0, 0, 60), limits=Limits(10.0, *_rows(LIMITS), axes=AXES, rapid=20.0))
    assert profile.duration == pytest.approx(rest_to_rest(60 / DEGREES, *ANGULAR), rel=2e-5)


def test_windows_are_as_fast_as_the_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(window, "_WINDOW", 300)
    monkeypatch.setattr(parts, "_FIRST_BLOCKS", 400)
    monkeypatch.setattr(parts, "_MAX_BLOCKS", 400)
    monkeypatch.setattr(parts, "_MIN_BLOCKS", 200)
    moves = winding(900)
    end = moves[-1]["end"]
    moves += [line(*end[:3], end[3] + 80, feed=110.0), line(end[0] + 5, *end[1:3], end[3] + 90)]
    plan = plan_program(program(*moves, feed=30.0), LIMITS, 0.01, output=tmp_path / "plan.npz")
    assert plan.ok
    assert plan.windows >= 3
    whole = planned(*moves, feed=30.0)[2]
    assert plan.duration == pytest.approx(whole.duration, rel=5e-3)


@pytest.mark.parametrize("tolerance", [0.005, 0.02, 0.05])
def test_a_slow_wound_block_before_a_fast_turn_stops(tmp_path, tolerance):
    """F counts along X before, and along A after: a corner of both was planned 68 % too slow, or not at all."""
    source = tmp_path / "wound.ngc"
    source.write_text(f"G21 G90 G64 P{tolerance}\nG0 X0 Z0 A0\nG1 X10 A100 F20\nX20 A-200 Z-1\nA-3000 F3600\nM2\n")
    read = read_program(source)
    path = program_path(read, None, LIMITS)
    assert [stop.reason for stop in path.stops][-1] == "the feed is measured along axes that move at quite another rate"
    limits = LIMITS.for_curve(path.curve)
    profile = plan_feedrate(path.curve, limits, intervals=path.intervals)
    assert check(path.curve, limits, profile).ok
    assert profile.duration <= 1.01 * sum(read.lengths / read.feed)


class TestProgramsOut:
    def test_words_and_feeds(self, tmp_path):
        source = tmp_path / "post.ngc"
        source.write_text(POST)
        read = read_program(source)
        path = program_path(read, 0.01, LIMITS)
        profile = plan_feedrate(path.curve, LIMITS.for_curve(path.curve), intervals=path.intervals)
        for mode in ("feed", "inverse_time"):
            out = tmp_path / "out.ngc"
            write_program(out, read, path, profile, tolerance=0.005, mode=mode)
            again = read_program(out)
            assert again.axes == ("X", "Y", "Z", "A")
            assert (again.lengths / again.feed).sum() == pytest.approx(profile.duration, rel=1e-6)
            assert again.end[-1] == pytest.approx(read.end[-1], abs=1e-9)
            assert set(again.feed_group.tolist()) == {0, 2}
