"""A corner, drawn: its plane, the distance from the program, and what the panels show."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from planner import InputError
from planner.output.corner_view import Corner, CornerPass, _see, distance_from, plot_corner
from planner.output.figures import save_plot

E = 0.01


def passing(points, label="path", duration=0.2):
    """A motion through points at even times."""
    points = np.asarray(points, dtype=float)
    t = np.linspace(0.0, duration, len(points))
    return CornerPass(label, t, points, np.gradient(points, t, axis=0))


def corner(before, vertex, after, *motions):
    return Corner(*(np.asarray(p, dtype=float) for p in (before, vertex, after)), E, motions)


def chamfer(offset=0.007, reach=5.0, count=2001):
    """Along X, across the corner at a distance from both blocks, along Y."""
    a = 2.0 * offset
    x = np.interp(np.linspace(0.0, 1.0, count), [0.0, 0.45, 0.55, 1.0], [-reach, -a, 0.0, 0.0])
    y = np.interp(np.linspace(0.0, 1.0, count), [0.0, 0.45, 0.55, 1.0], [0.0, 0.0, a, reach])
    return np.stack([x, y], axis=1)


RIGHT_ANGLE = corner([-20.0, 0.0], [0.0, 0.0], [0.0, 20.0], passing(chamfer()))


class TestPlane:
    @pytest.mark.parametrize("degrees", [0.0, 1e-7, 30.0, 90.0, 179.9999999, 180.0])
    def test_the_turn_is_the_angle_between_the_blocks(self, degrees):
        a = np.radians(degrees)
        found = corner([-3.0, 0.0], [0.0, 0.0], [7.0 * np.cos(a), 7.0 * np.sin(a)], passing(chamfer()))
        assert found.turn == pytest.approx(degrees, abs=1e-12)

    def test_a_right_angle_is_seen_as_it_lies(self):
        assert RIGHT_ANGLE.plane == pytest.approx(np.eye(2))

    def test_in_space_it_has_the_blocks_in_it(self):
        rng = np.random.default_rng(1)
        for _ in range(20):
            before, vertex, after = rng.normal(size=(3, 4))
            found = corner(before, vertex, after, passing([before, vertex, after]))
            plane = found.plane
            assert plane @ plane.T == pytest.approx(np.eye(2), abs=1e-12)
            for end in (before, after):
                off = end - vertex
                assert np.hypot(*(plane @ off)) == pytest.approx(np.linalg.norm(off))
            assert (plane @ (vertex - before))[0] > 0.0
            assert (plane @ (after - vertex))[1] > 0.0  # the next block goes up

    def test_a_reversal_is_seen_across_where_the_motion_goes(self):
        motion = passing([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.005], [-1.0, 0.0, 0.0]])
        assert corner([-1, 0, 0], [0, 0, 0], [-1, 0, 0], motion).plane == pytest.approx(
            np.array([[1, 0, 0], [0, 0, 1]])
        )

    def test_a_reversal_along_the_line_has_a_plane_too(self):
        motion = passing([[-1.0, 0.0], [0.0, 0.0], [-1.0, 0.0]])
        plane = corner([-1, 0], [0, 0], [-1, 0], motion).plane
        assert plane @ plane.T == pytest.approx(np.eye(2))


class TestDistance:
    @pytest.mark.parametrize(
        ("point", "wanted"),
        [
            ([-5.0, 0.003], 0.003),
            ([-5.0, -0.003], -0.003),
            ([-0.004, 7.0], 0.004),
            ([0.004, 7.0], -0.004),
            ([-0.006, 0.006], 0.006),
            ([0.003, -0.004], -0.005),
            ([-5.0, 0.0], 0.0),
        ],
    )
    def test_inside_is_positive(self, point, wanted):
        assert distance_from(RIGHT_ANGLE, np.array([point])) == pytest.approx([wanted])

    def test_it_is_that_of_the_nearest_point_of_the_blocks(self):
        rng = np.random.default_rng(2)
        for _ in range(10):
            before, vertex, after = rng.normal(size=(3, 3))
            found = corner(before, vertex, after, passing([before, vertex, after]))
            points = rng.normal(size=(50, 3))
            share = np.linspace(0.0, 1.0, 20001)[:, None]
            blocks = np.concatenate([before + share * (vertex - before), vertex + share * (after - vertex)])
            near = [np.linalg.norm(blocks - p, axis=1).min() for p in points]
            assert np.abs(distance_from(found, points)) == pytest.approx(near, abs=1e-6)

    def test_turned_in_space_it_is_the_same(self):
        q, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
        points = np.random.default_rng(4).normal(scale=0.02, size=(100, 2))
        flat = distance_from(RIGHT_ANGLE, points)
        turned = corner(*(np.array([*p, 0.0]) @ q for p in ([-20, 0], [0, 0], [0, 20])), passing(np.zeros((2, 3))))
        assert distance_from(turned, np.column_stack([points, np.zeros(100)]) @ q) == pytest.approx(flat, abs=1e-12)

    def test_time_begins_at_the_vertex(self):
        seen = _see(RIGHT_ANGLE, RIGHT_ANGLE.passes[0])
        assert seen.t[np.argmin(np.hypot(*seen.place.T))] == 0.0
        assert seen.off.max() == pytest.approx(0.007, rel=1e-2)


class TestFigure:
    @pytest.mark.parametrize(("width", "rows"), [(180.0, 2), (85.0, 4)])
    def test_four_panels_show_every_motion(self, width, rows):
        two = dataclasses.replace(
            RIGHT_ANGLE, passes=(passing(chamfer(0.004), "first"), passing(chamfer(0.009), "second"))
        )
        figure = plot_corner(two, "a right angle", width_mm=width)
        assert len(figure.axes) == 4
        assert len({round(axes.get_position().y0, 3) for axes in figure.axes}) == rows
        path, off, feed, axes = figure.axes
        assert {"program", "first", "second"} <= {line.get_label() for line in path.lines}
        assert len(feed.lines) == 2
        peaks = [float(np.max(line.get_ydata())) for line in off.lines[:2]]
        assert peaks == pytest.approx([4.0, 9.0], rel=1e-2)  # um
        assert [float(line.get_ydata()[0]) for line in off.lines[2:4]] == [-10.0, 10.0]
        assert len([line for line in axes.lines if len(line.get_xdata()) > 2]) == 4
        assert path.get_xlabel().endswith("µm")
        assert all("ms" in panel.get_xlabel() for panel in (off, feed, axes))

    def test_the_disc_of_the_vertex_is_seen_however_sharp_the_turn(self):
        for degrees in (20, 90, 150, 179):
            a = np.radians(degrees)
            after = [20.0 * np.cos(a), 20.0 * np.sin(a)]
            motion = passing([[-20.0, 0.0], [0.0, 0.0], after])
            path = plot_corner(corner([-20, 0], [0, 0], after, motion)).axes[0]
            for low, high in (path.get_xlim(), path.get_ylim()):
                assert low < -10.0
                assert high > 10.0

    def test_a_motion_that_stops_says_so(self):
        t = np.linspace(-0.1, 0.1, 2001)
        x = np.minimum(t, 0.0) * np.abs(t) * 500.0
        y = np.maximum(t, 0.0) * np.abs(t) * 500.0
        place = np.stack([x, y], axis=1)
        motion = CornerPass("stop", t, place, np.gradient(place, t, axis=0))
        feed = plot_corner(dataclasses.replace(RIGHT_ANGLE, passes=(motion,))).axes[2]
        assert [text.get_text() for text in feed.get_legend().get_texts()] == ["comes to rest"]

    def test_the_same_corner_gives_the_same_bytes(self, tmp_path):
        for name in ("a.svg", "b.svg"):
            save_plot(tmp_path / name, plot_corner(RIGHT_ANGLE, "a right angle"))
        assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


class TestInput:
    def test_what_cannot_be_drawn_is_refused(self):
        motion = passing(chamfer())
        with pytest.raises(InputError, match="passes is empty"):
            corner([-1, 0], [0, 0], [0, 1])
        with pytest.raises(InputError, match=r"before = \[0\. 0\.\] is the vertex itself"):
            corner([0, 0], [0, 0], [0, 1], motion)
        with pytest.raises(InputError, match=r"tolerance = 0.0 mm must be > 0"):
            dataclasses.replace(RIGHT_ANGLE, tolerance=0.0)
        with pytest.raises(InputError, match="allowed is 80 to 420 mm"):
            plot_corner(RIGHT_ANGLE, width_mm=20.0)
