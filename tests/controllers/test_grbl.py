"""The model of GRBL, against closed forms: the trapezoid, the limits by direction, the junction deviation, the buffer."""

import json

import numpy as np
import pytest

from benchmarks.controllers.__main__ import GRBL, GRBL_SETTINGS
from benchmarks.controllers.programs import FILES, MADE
from planner import InputError, read_program
from planner.controllers.grbl import GrblSettings, grbl_motion, limit_along

TIMES = json.loads(GRBL.read_text())["times"]
PLAIN = GrblSettings([100.0] * 3, [1000.0] * 3)


def settings(**changes):
    return GrblSettings(**({"max_rate": [100.0] * 3, "acceleration": [1000.0] * 3} | changes))


def speed_after(motion, leg=0):
    """At the end of a leg."""
    return motion.speed_at(motion.start[1 + np.flatnonzero(motion.leg == leg)[-1:]])[0]


class TestAgainstGrbl:
    """Numbers of GRBL 1.1h's own planner and stepper code, whose clock rounds every step (benchmarks/controllers)."""

    @pytest.mark.parametrize("row", TIMES, ids=lambda row: f"{row['program']}-{row['settings']}")
    def test_times(self, row, tmp_path):
        name = row["program"]
        path = FILES / name
        if name in MADE:
            path = tmp_path / name
            path.write_text(MADE[name]())
        motion = grbl_motion(read_program(path), GRBL_SETTINGS[row["settings"]])
        assert motion.duration == pytest.approx(row["seconds"], rel=8e-4)

    def test_twelve_programs_by_three_settings(self):
        assert len(TIMES) == 36
        assert len({row["program"] for row in TIMES}) == 12


class TestOneLine:
    def test_trapezoid(self, program):
        assert grbl_motion(program("G1 X100 F3000\nM2\n"), PLAIN).duration == pytest.approx(100 / 50 + 50 / 1000)

    def test_by_direction(self, program):
        """Along (3, 4, 0) / 5: rates 90 / 0.6 and 60 / 0.8, accelerations 300 / 0.6 and 600 / 0.8."""
        own = settings(max_rate=[90, 60, 5], acceleration=[300, 600, 10])
        motion = grbl_motion(program("G91\nG1 X30 Y40 F60000\nM2\n"), own)
        v, a = 75.0, 500.0
        assert motion.duration == pytest.approx(50 / v + v / a)

    def test_rapids_run_at_the_rate_of_the_axes(self, program):
        motion = grbl_motion(program("G91 F600\nG0 X100\nM2\n"), PLAIN)
        assert motion.duration == pytest.approx(100 / 100 + 100 / 1000)

    def test_no_feed_is_slower_than_one_mm_a_minute(self, program):
        assert grbl_motion(program("G1 X0.1 F0.5\nM2\n"), PLAIN).duration == pytest.approx(6.0, rel=1e-3)

    def test_along_an_axis_that_does_not_move(self):
        assert limit_along(np.array([1.0, 2.0, 3.0]), np.array([[0.0, 0.0, -1.0]])).tolist() == [3.0]


class TestJunctions:
    @pytest.mark.parametrize("degrees", [30.0, 60.0, 90.0, 120.0, 150.0, 175.0])
    @pytest.mark.parametrize("deviation", [0.002, 0.01, 0.05])
    def test_junction_deviation(self, program, degrees, deviation):
        """v^2 = a d sin(t/2) / (1 - sin(t/2)); the edge of that circle is d from the corner."""
        t = np.radians(180.0 - degrees)
        text = f"G91 G1 X100 F6000\nX{100 * np.cos(t):.12f} Y{100 * np.sin(t):.12f}\nM2\n"
        own = settings(junction_deviation=deviation)
        change = np.array([[np.cos(t) - 1.0, np.sin(t), 0.0]])
        a = limit_along(own.acceleration, change / np.linalg.norm(change))[0]
        half = np.sin(np.radians(degrees) / 2)
        radius = deviation * half / (1 - half)
        assert radius / half - radius == pytest.approx(deviation)
        assert speed_after(grbl_motion(program(text), own)) == pytest.approx(min(np.sqrt(a * radius), 100.0), rel=1e-6)

    def test_the_slower_axis_decides_where_it_turns(self, program):
        """At a corner from X to Y the change of direction is along both."""
        own = settings(acceleration=[1000.0, 250.0, 1000.0])
        half = np.sin(np.pi / 4)
        wanted = np.sqrt(250.0 * np.sqrt(2.0) * 0.01 * half / (1 - half))
        assert speed_after(grbl_motion(program("G91 G1 X50 F6000\nY50\nM2\n"), own)) == pytest.approx(wanted)

    def test_reversal_stops_and_straight_on_does_not(self, program):
        assert speed_after(grbl_motion(program("G91 G1 X50 F3000\nX-50\nM2\n"), PLAIN)) == pytest.approx(0.0, abs=1e-9)
        straight = grbl_motion(program("G91 G1 X50 F3000\nX50\nM2\n"), PLAIN)
        assert straight.duration == pytest.approx(100 / 50 + 50 / 1000)

    def test_no_deviation_stops_at_every_corner(self, program):
        motion = grbl_motion(program("G91 G1 X50 F3000\nY50\nM2\n"), settings(junction_deviation=0.0))
        assert motion.duration == pytest.approx(2 * (50 / 50 + 50 / 1000))


class TestBuffer:
    @pytest.mark.parametrize("held", [2, 5, 15])
    def test_speed_on_many_short_blocks(self, program, held):
        """No junction is faster than the stop over the blocks known behind it: v^2 = 2 a (held - 1) L."""
        text = "G91 F6000\n" + "G1 X0.05\n" * 400 + "M2\n"
        motion = grbl_motion(program(text), settings(planner_blocks=held))
        steady = np.sqrt(2 * 1000 * (held - 1) * 0.05)
        assert speed_after(motion, 200) == pytest.approx(steady, rel=1e-9)

    def test_long_blocks_do_not_notice(self, program):
        text = "G91 F6000\n" + "G1 X20\n" * 40 + "M2\n"
        assert grbl_motion(program(text), PLAIN).duration == pytest.approx(800 / 100 + 100 / 1000)

    def test_against_a_planner_that_is_fed_block_by_block(self, program):
        """Run the buffer itself: plan the held blocks to a stop, run the first to its end, take the next one in."""
        rng = np.random.default_rng(5)
        heading = np.cumsum(rng.normal(size=150) * 0.05)
        steps = np.column_stack([np.cos(heading), np.sin(heading)]) * rng.uniform(0.03, 0.2, (150, 1))
        points = np.cumsum(steps, axis=0)
        text = "F6000\n" + "".join(f"G1 X{x:.4f} Y{y:.4f}\n" for x, y in points) + "M2\n"
        for held in (3, 8, 15):
            made = program(text)
            free = grbl_motion(made, settings(planner_blocks=10_000))
            motion = grbl_motion(made, settings(planner_blocks=held))
            length, n = motion.length, motion.length.size
            direction = free.legs.vectors[:, 3]
            rate = limit_along(PLAIN.acceleration, direction)
            cosine = -np.sum(direction[1:] * direction[:-1], axis=1)
            half = np.sqrt(0.5 * (1 - cosine))
            change = direction[1:] - direction[:-1]
            junction = limit_along(PLAIN.acceleration, change / np.linalg.norm(change, axis=1)[:, None])
            allowed = np.minimum(np.concatenate([[0], junction * 0.01 * half / (1 - half), [0]]), 100.0**2)
            v2 = [0.0]
            for i in range(n):
                ahead = 0.0
                for j in range(min(i + held, n) - 1, i, -1):
                    ahead = min(allowed[j], ahead + 2 * rate[j] * length[j])
                v2.append(min(ahead, v2[-1] + 2 * rate[i] * length[i]))
            found = [speed_after(motion, k) ** 2 for k in range(n - 1)]
            assert found == pytest.approx(v2[1:-1], abs=1e-6)
            assert motion.duration > 1.01 * free.duration


class TestWords:
    @pytest.mark.parametrize(
        ("word", "stops"), [("G4 P1", 1), ("M3 S500", 1), ("M8", 1), ("M0", 1), ("M1", 0), ("T2", 0), ("N7", 0)]
    )
    def test_what_it_waits_for(self, program, word, stops):
        motion = grbl_motion(program(f"G1 X50 F3000\n{word}\nX100\nM2\n"), PLAIN)
        assert motion.duration == pytest.approx(100 / 50 + (1 + stops) * 50 / 1000)

    def test_arcs(self, program):
        """The chords are within the tolerance of the arc, and would not be with half as many."""
        for r, tolerance in ((5.0, 0.002), (50.0, 0.002), (5.0, 0.1)):
            made = program(f"F600\nG2 X0 Y0 I{r} J0\nM2\n")
            motion = grbl_motion(made, settings(arc_tolerance=tolerance))
            n = motion.length.size
            assert n == int(np.pi * r / np.sqrt(tolerance * (2 * r - tolerance)))
            assert r * (1 - np.cos(np.pi / n)) < 1.3 * tolerance


class TestSteps:
    def test_points_are_rounded_to_steps(self, program):
        motion = grbl_motion(program("G1 X0.1234 Y0.02 F600\nX0.26\nM2\n"), settings(steps_per_mm=[100, 10, 10]))
        ends = motion.legs.at(np.arange(motion.length.size), motion.length)[0]
        assert ends[:, :2] == pytest.approx(np.array([[0.12, 0.0], [0.26, 0.0]]))

    def test_a_move_of_no_step_is_none(self, program):
        motion = grbl_motion(program("G1 X1 F600\nX1.004\nX2\nM2\n"), settings(steps_per_mm=100.0))
        assert motion.line.tolist() == [1, 3]

    def test_short_blocks_are_slowed(self, program):
        """Without them half a degree a block is no corner."""
        t = np.radians(0.5 * np.arange(1, 300))
        text = "F6000\n" + "".join(
            f"G1 X{x:.5f} Y{y:.5f}\n" for x, y in zip(10 * np.sin(t), 10 - 10 * np.cos(t), strict=True)
        )
        made = program(text + "M2\n")
        coarse, fine, none = (
            grbl_motion(made, settings(junction_deviation=0.002, steps_per_mm=s)).duration for s in (80, 1e5, np.inf)
        )
        assert coarse > 1.2 * none
        assert fine == pytest.approx(none, rel=1e-3)


class TestProperties:
    @pytest.mark.parametrize("seed", range(5))
    def test_time_falls_as_limits_rise(self, program, seed):
        rng = np.random.default_rng(seed)
        points = np.cumsum(rng.normal(size=(150, 3)) * rng.choice([0.05, 1.0, 10.0], (150, 1)), axis=0)
        made = program("F6000\n" + "".join(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f}\n" for x, y, z in points) + "M2\n")
        for name, values in (
            ("acceleration", [[a, a, 0.3 * a] for a in (100.0, 500.0, 3000.0)]),
            ("max_rate", [[v, v, 0.3 * v] for v in (10.0, 40.0, 100.0)]),
            ("junction_deviation", [0.0, 0.002, 0.01, 0.1]),
            ("planner_blocks", [2, 4, 8, 15]),
        ):
            times = [grbl_motion(made, settings(**{name: value})).duration for value in values]
            assert (np.diff(times) < 1e-9).all(), (name, times)
            assert times[-1] < times[0]

    @pytest.mark.parametrize("seed", range(5))
    def test_axes_stay_within_their_limits_on_every_leg(self, program, seed):
        rng = np.random.default_rng(50 + seed)
        points = np.cumsum(rng.normal(size=(100, 3)) * 3.0, axis=0)
        made = program("F9000\n" + "".join(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f}\n" for x, y, z in points) + "M2\n")
        own = settings(max_rate=[90.0, 70.0, 20.0], acceleration=[900.0, 500.0, 100.0])
        motion = grbl_motion(made, own)
        direction = np.abs(motion.legs.vectors[motion.leg, 3])
        last = motion.speed + np.diff(motion.start) * motion.acceleration
        assert (np.maximum(motion.speed, last)[:, None] * direction <= own.max_rate * (1 + 1e-9)).all()
        assert (np.abs(motion.acceleration)[:, None] * direction <= own.acceleration * (1 + 1e-9)).all()
        assert last[:-1] == pytest.approx(motion.speed[1:], abs=1e-6)


class TestBadInput:
    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"max_rate": [1.0, 2.0]}, "must be three finite numbers > 0"),
            ({"acceleration": [1.0, 0.0, 1.0]}, "acceleration = .* must be three finite numbers > 0"),
            ({"acceleration": [1.0, np.inf, 1.0]}, "acceleration = "),
            ({"junction_deviation": -0.01}, "junction_deviation = -0.01 must be a number >= 0"),
            ({"junction_deviation": "0.01"}, "junction_deviation = '0.01'"),
            ({"arc_tolerance": 0.0}, "arc_tolerance = 0.0 must be a number > 0"),
            ({"steps_per_mm": 0.0}, "steps_per_mm = .* must be three numbers > 0"),
            ({"steps_per_mm": [80.0, 80.0]}, "steps_per_mm = .* must be three numbers > 0"),
            ({"planner_blocks": 1}, "planner_blocks = 1 must be a whole number of at least 2"),
            ({"planner_blocks": 15.5}, "planner_blocks = 15.5 must be a whole"),
        ],
    )
    def test_settings(self, changes, message):
        with pytest.raises(InputError, match=message):
            settings(**changes)

    def test_a_circle_smaller_than_the_tolerance(self, program):
        made = program("F600\nG1 X1\nG2 X1 Y0 I0.0005 J0\nG1 X2\nM2\n")
        assert grbl_motion(made, settings(arc_tolerance=0.002)).line.tolist() == [2, 4]
