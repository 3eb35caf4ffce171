"""LinuxCNC's rules for written blocks, against closed forms and against what its simulator took."""

import numpy as np
import pytest
from cases import drives

from planner import load_curve, plan_feedrate, write_ngc
from planner.output.ngc_motion import BlockMotion, block_feeds, motion_time, needed_blends

# s: LinuxCNC 2.9.0~pre1 in its simulator, 250 mm/s and 1000 mm/s^2 an axis, servo period 1 ms, on the programs
# that ``write_ngc`` makes within 10 um from these curves (scale, seconds under feed).
RAN = {"circle": (1.0, 3.298), "teardrop": (1.0, 1.147), "hypotrochoid": (10.0, 7.218)}


def lines(points, speed, acceleration=1000.0):
    step = np.diff(np.asarray(points, dtype=float), axis=0)
    length = np.linalg.norm(step, axis=1)
    limits = np.full(step.shape[1], acceleration)
    return BlockMotion(length, step / length[:, None], np.asarray(speed, dtype=float), limits, 1e-3)


def polygon(radius, count):
    angle = 2.0 * np.pi * np.arange(count + 1) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("name", RAN)
def test_the_time_is_that_of_linuxcnc(tmp_path, name):
    scale, seconds = RAN[name]
    curve = load_curve(name, scale=scale)
    limits = drives(chord_error=1e-3)
    written = write_ngc(tmp_path / "a.ngc", curve, plan_feedrate(curve, limits), tolerance=0.01)
    assert written.duration == pytest.approx(seconds, rel=0.003)


def test_a_line_from_rest_to_rest():
    motion = lines([[0, 0], [5, 0], [10, 0]], [0, 50, 0])
    none = np.zeros(1, dtype=bool)
    # v/a + L/v at the feed, and the periods that starting and stopping take
    assert motion_time(motion, np.full(2, 50.0), np.full(2, 0.01), none) == pytest.approx(0.25 + 0.003)
    # never at the feed: 2 sqrt(L/a)
    assert motion_time(motion, np.full(2, 500.0), np.full(2, 0.01), none) == pytest.approx(0.2 + 0.003)
    # two lines with a rest between them
    assert motion_time(motion, np.full(2, 50.0), np.full(2, 0.01), ~none) == pytest.approx(0.3 + 0.006)


def test_a_diagonal_has_the_acceleration_of_both_axes():
    motion = lines([[0, 0], [5, 5], [10, 10]], [0, 50, 0])
    expected = 2.0 * np.sqrt(np.hypot(10, 10) / (1000.0 * np.sqrt(2.0)))
    found = motion_time(motion, np.full(2, 500.0), np.full(2, 0.01), np.zeros(1, dtype=bool))
    assert found == pytest.approx(expected + 0.003)


def test_the_speed_on_blends():
    """A polygon that blends turn into its circle: v = sqrt(0.866 a r)."""
    motion = lines(polygon(10.0, 60), np.full(61, 200.0))
    blends = np.full(60, 1.0)
    stops = np.zeros(59, dtype=bool)
    fast = np.sqrt(0.866 * 1000.0 * 10.0 * np.cos(np.pi / 60))
    # along the blends half of the acceleration: ramps at both ends, whose first and last half block is a line
    length = 2.0 * np.pi * 10.0
    expected = length / fast + fast / 500.0
    assert motion_time(motion, np.full(60, 200.0), blends, stops) == pytest.approx(expected, rel=0.04)


@pytest.mark.parametrize("speed", [20.0, 60.0, 80.0])
def test_the_blend_that_a_speed_needs(speed):
    motion = lines(polygon(10.0, 60), np.full(61, speed))
    blends, free = needed_blends(motion)
    assert not free.any()
    kink = 2.0 * np.pi / 60
    radius = blends / (1.0 / np.cos(0.5 * kink) - 1.0)
    allowed = np.sqrt(0.866 * 1000.0 * radius)
    assert (allowed >= speed).all()
    assert (radius * kink >= 1e-3 * speed).all()
    assert (allowed <= 1.03 * speed).all() or (radius * kink <= 1.4e-3 * speed).all()


def test_no_more_than_half_of_a_block():
    motion = lines(polygon(10.0, 60), np.full(61, 500.0))
    blends, _ = needed_blends(motion)
    kink = np.pi / 60
    radius = blends / (1.0 / np.cos(kink) - 1.0)
    assert radius * np.tan(kink) == pytest.approx(0.5 * motion.length[1:])


def test_small_kinks_need_no_blend():
    """A tenth of the acceleration within one period: 100 mm/s may turn by 1 mrad."""
    for angle, free in ((0.0005, True), (0.002, False)):
        motion = lines([[0, 0], [10, 0], [10 + 10 * np.cos(angle), 10 * np.sin(angle)]], [0, 100, 0])
        blends, found = needed_blends(motion)
        assert found.tolist() == [free]
        assert (blends[0] == 0.0) == free


def test_feeds_on_a_ramp():
    """Constant acceleration, cut into equal times: all of it needs the highest feed, half of it what lies between."""
    for share in (1.0, 0.5, 0.1):
        times = np.full(20, 0.01)
        speed = 10.0 + share * 1000.0 * 0.01 * np.arange(21)
        length = 0.5 * (speed[1:] + speed[:-1]) * 0.01
        motion = BlockMotion(length, np.tile([1.0, 0.0], (20, 1)), speed, np.full(2, 1000.0), 1e-3)
        feeds = block_feeds(motion, times)
        assert feeds == pytest.approx(length / times + 0.5 * np.diff(speed) * share)
        # From one feed to the next at the whole acceleration, then on: the time of the plan in every block.
        before, after = feeds[:-1], feeds[1:]
        ramp = (after - before) / 1000.0
        held = (length[1:] - 0.5 * (after + before) * ramp) / after
        assert ramp + held == pytest.approx(times[1:], rel=0.02)
        assert (ramp + held).sum() == pytest.approx(times[1:].sum(), rel=0.005)
