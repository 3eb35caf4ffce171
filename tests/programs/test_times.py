"""Seconds a line: they add up, a line is what the time law says it is, and what holds it back is found."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import PROGRAMS, drives
from hypothesis import given, settings
from hypothesis import strategies as st
from program_blocks import line, polyline, program, rapid

from planner import InputError, Limits, load_curve, plan_feedrate
from planner.law import TimeLaw
from planner.machine.program_setup import RestTimes
from planner.profile import make_profile
from planner.programs.path.smooth_path import program_path
from planner.programs.reading.reader import read_program
from planner.programs.times import KINDS, held_seconds, line_times, move_edges, times_at

LIMITS = drives(dim=3)


def planned(source, tolerance=0.01, limits=LIMITS, **options):
    path = program_path(source, tolerance, limits)
    options = {"intervals": path.intervals} | options
    profile = plan_feedrate(path.curve, limits.for_curve(path.curve), **options)
    return source, path, profile, line_times(source, path, profile)


@cache
def of_file(name):
    return planned(read_program(PROGRAMS / f"{name}.ngc"))


@cache
def without_jerk(name):
    source, path, _, _ = of_file(name)
    profile = plan_feedrate(path.curve, LIMITS.for_curve(path.curve).without_jerk(), intervals=path.intervals)
    return source, path, profile, line_times(source, path, profile)


def from_text(folder, text, **options):
    file = folder / "part.ngc"
    file.write_text(text)
    return planned(read_program(file), **options)


@pytest.mark.parametrize("plan", [of_file, without_jerk])
@pytest.mark.parametrize("name", ["zigzag", "slots"])
def test_the_lines_add_up_to_the_duration(name, plan):
    source, path, profile, times = plan(name)
    assert math.fsum(times.seconds) == pytest.approx(profile.duration, abs=1e-9)
    assert times.moving == math.fsum(times.seconds)
    assert times.line.tolist() == [3, *source.line.tolist()]  # the rapid to where the machine stands
    assert times.seconds[0] == 0.0
    assert (times.seconds[1:] > 0.0).all()
    assert times.u_start[1:].tolist() == path.u[:-1].tolist()
    assert times.u_end[1:].tolist() == path.u[1:].tolist()
    assert times.length[1:].tolist() == source.lengths.tolist()


def test_thousands_of_short_blocks_add_up():
    profile, times = of_file("butterfly_5000")[2:]
    assert times.line.size == 5001
    assert math.fsum(times.seconds) == pytest.approx(profile.duration, abs=1e-9)
    feed = times.length[1:] / times.seconds[1:]
    assert np.median(feed) == pytest.approx(100.0, rel=1e-3)
    assert feed.max() < 103.0  # a vertex may lie along the path by twice the tolerance, here a sixth of a block


def test_a_line_takes_from_vertex_to_vertex():
    """The plan, evaluated at the running sums of the seconds, stands on the vertices of the program."""
    source, path, profile, times = of_file("butterfly_5000")
    t = np.minimum(np.cumsum(times.seconds), profile.duration)
    states = profile.at(t[1:])
    assert np.abs(states.u - path.u[1:]).max() <= 1e-9
    position = path.curve.derivatives(np.clip(states.u, *path.curve.domain), 0)[0]
    away = np.sqrt(np.sum((position - source.end[:, :2]) ** 2, axis=1))
    assert away.max() <= np.hypot(0.01, 0.02)  # across by the tolerance, along by twice as much


def test_zigzag_lines_by_symmetry():
    """Forwards and backwards the zigzag is the same, so its lines take as long from either end."""
    times = of_file("zigzag")[3]
    assert times.seconds[1:] == pytest.approx(times.seconds[:0:-1], rel=2e-3)


def test_an_exact_stop_takes_the_time_of_its_closed_form():
    """40 mm from rest to rest, bound by jerk, acceleration and feed: v/a + a/j + s/v."""
    source = polyline([[0, 0], [40, 0], [40, 40]])
    source = replace(source, stop_after=np.array([True, True]))
    times = planned(source, limits=drives(dim=3))[3]
    exact = 40.0 / 100.0 + 100.0 / 1000.0 + 1000.0 / 2e4
    assert times.seconds == pytest.approx([exact, exact], rel=1e-4)


class TestTimesAt:
    def test_on_nodes_the_node(self):
        profile = of_file("slots")[2]
        first = np.flatnonzero(np.diff(profile.u, prepend=-1.0) > 0.0)
        assert times_at(profile, profile.u[first]).tolist() == profile.t[first].tolist()

    @settings(max_examples=30)
    @given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20))
    def test_inverts_the_time_law(self, shares):
        profile = of_file("slots")[2]
        u = np.array(shares) * profile.u[-1]
        t = times_at(profile, u)
        assert np.abs(profile.at(t).u - u).max() <= 1e-11 * profile.u[-1]

    def test_close_to_rest(self):
        """There u grows with the cube of time: u = j t^3 / 6."""
        profile = of_file("zigzag")[2]
        u = np.array([1e-12, 1e-10, 1e-8])
        jerk = float(profile.at(1e-6).u_jerk)
        assert times_at(profile, u) == pytest.approx(np.cbrt(6.0 * u / jerk), rel=1e-3)


class TestBinding:
    def test_a_long_line_is_held_back_by_the_feed(self):
        times = planned(polyline([[0, 0], [400, 0]]))[3]
        assert times.limit_names[times.binding[0]] == "feed"
        ramp = 100.0 / 1000.0 + 1000.0 / 2e4  # s, at either end
        assert times.share[0] == pytest.approx(1.0 - 2.0 * ramp / (4.0 + ramp), abs=0.03)

    def test_a_slow_axis_is_named(self):
        limits = Limits(100.0, [250.0, 20.0, 250.0], [1000.0] * 3, [2e4] * 3)
        source = replace(polyline([[0, 0], [50, 0], [50, 50]]), stop_after=np.array([True, True]))
        times = planned(source, limits=limits)[3]
        assert [times.limit_names[k] for k in times.binding] == ["feed", "velocity Y"]

    def test_shares_by_hand(self):
        """Nodes at 0, 1, 2, 3, 4 s: a line from 0.75 to 2.25 s lies half with the node at 1 s, 2/3 of the rest at 2 s."""
        source, path, profile, _ = planned(polyline([[0, 0], [30, 0], [90, 0], [120, 0]]))
        limits = drives()
        t = np.arange(5.0)
        u = np.linspace(*path.curve.domain, 5)
        rate = np.full(5, 30.0)
        uniform = make_profile(path.curve, limits, TimeLaw(t, u, rate, np.zeros(5)), method="uniform")
        names = profile.limit_names
        marked = replace(uniform, binding=np.array([0, 1, 2, 2, 0], dtype=np.int8))
        times = line_times(source, path, marked)
        assert times.seconds == pytest.approx([1.0, 2.0, 1.0])
        # lines: 0-1 s (node 0: 0.5 s none, node 1: 0.5 s), 1-3 s (node 1: 0.5, node 2: 1, node 3: 0.5), 3-4 s
        assert [names[k] for k in times.binding] == [names[1], names[2], names[2]]
        assert times.share == pytest.approx([0.5, 0.75, 0.5])

    def test_nothing_binds(self):
        source, path, profile, _ = of_file("slots")
        free = replace(profile, binding=np.zeros(profile.t.size, dtype=np.int8))
        times = line_times(source, path, free)
        assert not times.binding.any()
        assert not times.share.any()


class TestLinesThatDoNotMove:
    TEXT = "G21 G90\nT1 M6\nG0 X0 Y0\nG1 X20 F3000\nX20\nG4 P0.5\nY20\nG4 P0.25\nT2 M6\nG0 X0\nM2\n"

    def test_columns(self, tmp_path):
        *_, profile, times = from_text(tmp_path, self.TEXT)
        rows = {
            int(n): (KINDS[k], float(d), int(c))
            for n, k, d, c in zip(times.line, times.kind, times.dwell, times.tool_changes, strict=True)
        }
        assert rows == {
            2: ("none", 0.0, 1),
            3: ("none", 0.0, 0),
            4: ("line", 0.0, 0),
            5: ("none", 0.0, 0),
            6: ("none", 0.5, 0),
            7: ("line", 0.0, 0),
            8: ("none", 0.25, 0),
            9: ("none", 0.0, 1),
            10: ("rapid", 0.0, 0),
        }
        still = times.kind == 0
        assert not times.seconds[still].any()
        assert not times.length[still].any()
        assert (times.u_start == times.u_end).tolist() == still.tolist()
        assert (np.diff(times.u_start) >= 0.0).all()
        assert times.u_start[4] == times.u_end[2]  # the dwell stands where line 4 ends
        assert (times.dwelling, times.changes) == (0.75, 2)
        assert times.moving == pytest.approx(profile.duration, abs=1e-9)

    def test_arcs_and_rapids_are_named(self, tmp_path):
        times = from_text(tmp_path, "G21 G90\nG0 X0 Y0\nG0 X5\nG2 X15 I5 F3000\nM2\n")[3]
        assert [KINDS[k] for k in times.kind] == ["none", "rapid", "arc"]
        assert times.length[2] == pytest.approx(5.0 * np.pi)


def test_the_plan_of_another_curve_is_refused():
    source, path, *_ = of_file("slots")
    curve = load_curve("teardrop")
    other = plan_feedrate(curve, LIMITS.for_curve(curve), intervals=60)
    with pytest.raises(InputError, match=r"is for the curve teardrop, not for the path of slots\.ngc"):
        line_times(source, path, other)


class TestWithoutJerk:
    def test_trapezoids_from_stop_to_stop(self):
        """40 mm at 100 mm/s: s/v + v/a; 4 mm does not reach the feed: 2 sqrt(s/a)."""
        source = replace(polyline([[0, 0], [40, 0], [40, 4]]), stop_after=np.array([True, True]))
        path = program_path(source, 0.01, LIMITS)
        profile = plan_feedrate(path.curve, LIMITS.for_curve(path.curve).without_jerk(), intervals=2000)
        times = line_times(source, path, profile)
        assert times.seconds == pytest.approx([40 / 100 + 100 / 1000, 2 * math.sqrt(4 / 1000)], rel=2e-3)
        assert profile.duration * (1.0 - 1e-3) <= profile.lower_bound <= profile.duration

    def test_a_path_with_corners_on_a_finer_grid(self):
        path, profile = without_jerk("zigzag")[1:3]
        limits = LIMITS.for_curve(path.curve)
        finer = plan_feedrate(path.curve, limits.without_jerk(), intervals=4 * path.intervals)
        assert profile.duration == pytest.approx(finer.duration, rel=5e-3)

    def test_no_path_takes_longer_without(self):
        for name in ("slots", "zigzag"):
            assert without_jerk(name)[3].moving < of_file(name)[3].moving

    def test_axes_must_match(self):
        path = of_file("slots")[1]
        with pytest.raises(InputError, match=r"the limits have 1 axis \(X\), but .* has 2 \(X, Y\)"):
            plan_feedrate(path.curve, Limits(100.0, [250.0], [1000.0], [20000.0], axes="X").without_jerk())


def test_moves_in_space():
    source = program(line(10, 0, 0), line(10, 0, 5), rapid(0, 0, 5))
    _, path, profile, times = planned(source)
    assert path.curve.axes == ("X", "Z")
    assert [KINDS[k] for k in times.kind] == ["line", "line", "rapid"]
    assert times.moving == pytest.approx(profile.duration, abs=1e-9)


class TestAlongTheRun:
    TEXT = "G21 G90\nT1 M6\nG0 X0 Y0\nG1 X20 F3000\nG4 P0.5\nY20\nM3 S100\nT2 M6\nG0 X0\nM2\n"

    def test_starts(self, tmp_path):
        """As the planned edges and the rests put them, dwells, tool changes and the spindle counted."""
        source, path, profile, _ = from_text(tmp_path, self.TEXT)
        rests = RestTimes(8.0, 3.0)
        times = line_times(source, path, profile, rests)
        edges = move_edges(path, profile)
        assert dict(zip(times.line.tolist(), times.start.tolist(), strict=True)) == pytest.approx(
            {2: 0.0, 3: 8.0, 4: 8.0, 5: 8.0 + edges[1], 6: 8.5 + edges[1], 7: 8.5 + edges[2], 8: 11.5 + edges[2],
             9: 19.5 + edges[2]}
        )  # fmt: skip
        assert times.total == pytest.approx(profile.duration + 0.5 + 2 * 8.0 + 3.0)
        assert line_times(source, path, profile).total == pytest.approx(profile.duration + 0.5)

    def test_ends_and_feeds(self, tmp_path):
        times = from_text(tmp_path, self.TEXT)[3]
        at = dict(zip(times.line.tolist(), range(times.line.size), strict=True))
        assert times.end[at[4], :3].tolist() == [20.0, 0.0, 0.0]
        assert times.end[at[5], :3].tolist() == [20.0, 0.0, 0.0]
        assert times.end[at[9], :3].tolist() == [0.0, 20.0, 0.0]
        assert (times.feed[at[4]], times.feed[at[9]]) == (50.0, np.inf)
        assert np.isnan(times.feed[at[5]])
        assert times.mean_feed[at[4]] == pytest.approx(20.0 / times.seconds[at[4]])
        assert times.mean_feed[at[5]] == 0.0

    def test_the_highest_feed_is_that_of_the_plan(self):
        path, profile, times = of_file("slots")[1:]
        edges = move_edges(path, profile)
        for row in range(1, times.line.size):
            t = np.linspace(edges[row - 1], edges[row], 400)
            dense = float(profile.at(t).feed.max())
            assert times.highest_feed[row] == pytest.approx(dense, rel=2e-3)
            assert times.highest_feed[row] >= times.mean_feed[row] * (1.0 - 2e-3)

    def test_a_line_that_is_run_again_begins_the_first_time(self, tmp_path):
        text = "G21 G90\n#1=3\no1 while [#1 GT 0]\nG1 X[#1] F600\nG4 P1\n#1=[#1-1]\no1 endwhile\nM2\n"
        path, profile, times = from_text(tmp_path, text)[1:]
        assert times.line.tolist() == [4, 5]
        first = move_edges(path, profile)[1]
        assert times.start == pytest.approx([0.0, first])
        assert times.dwell.tolist() == [0.0, 3.0]
        assert times.end[0, 0] == 1.0

    def test_held_seconds_add_up_to_the_shares_of_the_plan(self):
        path, profile = of_file("slots")[1:3]
        edges = move_edges(path, profile)
        group = np.arange(edges.size - 1) % 3
        held = held_seconds(profile, edges, group, 3)
        shares = profile.shares()
        for name, seconds in held.items():
            assert seconds.shape == (3,)
            assert seconds.sum() / profile.duration == pytest.approx(shares[name], abs=1e-9)
        assert set(held) == set(shares) - {"none"}
