"""Pieces of constant acceleration along legs, against closed forms."""

import numpy as np
import pytest

from planner import InputError, check
from planner.controllers.controller_motion import ControllerMotion, Trapezoids, cut_legs, look_ahead, peak_speed
from planner.geometry.blend import Legs
from planner.machine.limits import Limits


def lines(points) -> tuple[Legs, np.ndarray]:
    """Legs through points, and their lengths."""
    points = np.asarray(points, dtype=np.float64)
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    vectors = np.zeros((length.size, 4, points.shape[1]))
    vectors[:, 0], vectors[:, 3] = points[:-1], step / length[:, None]
    return Legs(vectors, np.zeros((length.size, 2))), length


def motion_through(points, junction, cap, acceleration) -> ControllerMotion:
    """A motion with one acceleration, one cap, and these speeds allowed at the points."""
    legs, length = lines(points)
    rate = np.full(length.size, float(acceleration))
    ends = look_ahead(np.asarray(junction, dtype=np.float64), length, rate, rate)
    cruise = peak_speed(ends[:-1], ends[1:], length, rate, rate, np.full(length.size, float(cap)))
    shape = Trapezoids(ends[:-1], cruise, ends[1:], rate, rate)
    return shape.motion("test", ("X", "Y", "Z")[: legs.vectors.shape[2]], legs, length, 1 + np.arange(length.size))


class TestCutLegs:
    def test_the_motion_stays_and_lines_have_their_times(self):
        motion = motion_through([[0, 0], [10, 0], [10, 20]], [0, 40, 0], 100.0, 1000.0)
        cut = cut_legs(motion, np.array([0, 0, 1]), np.array([2.0, 6.0, 5.0]), np.array([7, 8, 9]))
        t = np.linspace(0.0, motion.duration, 1001)
        assert cut.at(t) == pytest.approx(motion.at(t), abs=1e-9)
        assert cut.speed_at(t[1:-1]) == pytest.approx(motion.speed_at(t[1:-1]), abs=1e-9)
        assert cut.length == pytest.approx([2.0, 4.0, 4.0, 5.0, 15.0])
        assert cut.line.tolist() == [7, 8, 1, 9, 2]
        assert cut.leg_seconds[0] == pytest.approx(np.sqrt(2 * 2.0 / 1000.0))
        assert cut.leg_seconds.sum() == pytest.approx(motion.duration)


class TestOneLine:
    def test_long_line_is_a_trapezoid(self):
        """T = L / v + v / a."""
        motion = motion_through([[0, 0], [100, 0]], [0, 0], 50.0, 1000.0)
        assert motion.duration == pytest.approx(100 / 50 + 50 / 1000, rel=1e-12)
        assert motion.start == pytest.approx([0, 0.05, 2.0, 2.05], rel=1e-12)
        assert motion.speed_at(np.array([0.025, 1.0, 2.025])) == pytest.approx([25.0, 50.0, 25.0], rel=1e-12)

    def test_short_line_is_a_triangle(self):
        """T = 2 sqrt(L / a)."""
        motion = motion_through([[0, 0], [1, 0]], [0, 0], 500.0, 1000.0)
        assert motion.duration == pytest.approx(2 * np.sqrt(1 / 1000), rel=1e-12)
        assert motion.leg.size == 2

    def test_two_accelerations(self):
        """Up with r, down with f: the peak v has v^2/2r + v^2/2f = L, and T = v/r + v/f."""
        legs, length = lines([[0, 0], [3, 4]])
        rise, fall = np.array([1000.0]), np.array([500.0])
        zero = np.zeros(1)
        peak = peak_speed(zero, zero, length, rise, fall, np.array([np.inf]))
        assert peak == pytest.approx(np.sqrt(2 * 5 / (1 / 1000 + 1 / 500)))
        motion = Trapezoids(zero, peak, zero, rise, fall).motion("test", ("X", "Y"), legs, length, np.array([7]))
        assert motion.duration == pytest.approx(peak[0] / 1000 + peak[0] / 500, rel=1e-12)
        assert motion.at(np.array([motion.duration]))[0] == pytest.approx([3, 4], abs=1e-12)


class TestLookAhead:
    def test_a_stop_far_ahead_slows_every_leg_before_it(self):
        ends = look_ahead(np.array([0, 100, 100, 100, 0.0]), np.ones(4), np.full(4, 1000.0), np.full(4, 1000.0))
        assert ends**2 == pytest.approx([0, 2000, 4000, 2000, 0])

    def test_nothing_is_above_what_a_junction_allows(self):
        rng = np.random.default_rng(1)
        for _ in range(50):
            allowed = rng.uniform(0, 80, 40)
            allowed[[0, -1]] = 0.0
            length, rise, fall = rng.uniform(0.01, 3, 39), rng.uniform(100, 2000, 39), rng.uniform(100, 2000, 39)
            found = look_ahead(allowed, length, rise, fall)
            gained = np.diff(found**2)
            assert (found <= allowed + 1e-12).all()
            assert (gained <= 2 * rise * length * (1 + 1e-12)).all()
            assert (-gained <= 2 * fall * length * (1 + 1e-12)).all()
            # highest: each is held by its junction, or by a neighbour it can just reach or slow down to
            held = np.isclose(found, allowed)
            held[1:] |= np.isclose(gained, 2 * rise * length)
            held[:-1] |= np.isclose(-gained, 2 * fall * length)
            assert held.all()


class TestMotion:
    @pytest.fixture
    def motion(self):
        rng = np.random.default_rng(3)
        points = np.cumsum(rng.normal(size=(60, 3)), axis=0)
        junction = rng.uniform(0, 40, 60)
        junction[[0, -1]] = 0.0
        return motion_through(points, junction, 60.0, 800.0)

    def test_position_and_speed_are_continuous(self, motion):
        inner = motion.start[1:-1]
        before, after = motion.at(inner - 1e-9), motion.at(inner + 1e-9)
        assert np.abs(after - before).max() < 1e-6
        assert motion.speed_at(inner - 1e-9) == pytest.approx(motion.speed_at(inner + 1e-9), abs=1e-4)

    def test_pieces_end_where_the_next_begin(self, motion):
        seconds = np.diff(motion.start)
        x = motion.x + seconds * (motion.speed + 0.5 * seconds * motion.acceleration)
        last = np.append(motion.leg[1:] != motion.leg[:-1], True)
        assert x[last] == pytest.approx(motion.length, abs=1e-9)
        assert x[~last] == pytest.approx(motion.x[1:][~last[:-1]], abs=1e-9)

    def test_lines_add_up(self, motion):
        line, seconds = motion.line_seconds()
        assert line.tolist() == list(range(1, 60))
        assert seconds.sum() == pytest.approx(motion.duration, rel=1e-12)

    def test_samples_go_through_the_one_check(self, motion):
        curve, samples = motion.curve("path"), motion.samples(1e-3)
        limits = Limits(60.0, 60.0, np.inf, np.inf, axes=motion.axes)
        rows = {(row.limit, row.axis): row for row in check(curve, limits, samples).rows}
        assert samples.t[-1] - 1e-3 < motion.duration <= samples.t[-1]
        for name in ("path start", "path end", "reversal", "sample times"):
            assert next(row for (limit, _), row in rows.items() if limit == name).ok
        assert all(row.ok for (limit, _), row in rows.items() if limit in ("feed", "path error", "velocity"))

    def test_a_limit_that_is_broken_is_seen(self, motion):
        limits = Limits(60.0, 60.0, 800.0, np.inf, axes=motion.axes)
        report = check(motion.curve("path"), limits, motion.samples(1e-3))
        assert {row.limit for row in report.violations} == {"acceleration"}  # its corners are steps of the velocity

    def test_rotary_axes_come_out_in_rad(self):
        legs, length = lines([[0, 0], [0, 90]])
        one = np.array([50.0])
        shape = Trapezoids(np.zeros(1), one, np.zeros(1), 1000.0 * one, 1000.0 * one)
        motion = shape.motion("test", ("X", "C"), legs, length, np.array([1]))
        assert motion.at(np.array([motion.duration]))[0, 1] == pytest.approx(np.pi / 2)
        assert motion.curve("turn").derivatives(np.array([90.0]), 0)[0, 0, 1] == pytest.approx(np.pi / 2)

    def test_in_some_of_its_axes(self):
        motion = motion_through([[0, 0, 1], [5, 0, 1], [5, 5, 1]], [0, 3, 0], 50.0, 1000.0)
        flat = motion.on_axes(("Y", "X"))
        t = np.linspace(0.0, motion.duration, 50)
        assert flat.at(t) == pytest.approx(motion.at(t)[:, [1, 0]])
        assert flat.duration == motion.duration
        with pytest.raises(InputError, match="axis Y moves; it cannot be left out of X, Z"):
            motion.on_axes(("X", "Z"))
        with pytest.raises(InputError, match="has the axes X, Y, Z; A is none of them"):
            motion.on_axes(("X", "A"))

    @pytest.mark.parametrize("period", [0.0, -1e-3, np.nan, "1 ms"])
    def test_bad_period(self, motion, period):
        with pytest.raises(InputError, match="period"):
            motion.samples(period)

    def test_too_many_samples(self, motion):
        with pytest.raises(InputError, match="samples of"):
            motion.samples(1e-12)
