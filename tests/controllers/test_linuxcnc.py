"""The model of LinuxCNC: against LinuxCNC itself, and against closed forms of what its motion does."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.controllers.linuxcnc_programs import MADE
from benchmarks.controllers.programs import FILES
from benchmarks.controllers.programs import MADE as TWELVE
from planner import InputError, load_limits, read_program
from planner.controllers.linuxcnc import LinuxcncSettings, linuxcnc_motion, linuxcnc_on

TIMES = json.loads((Path(__file__).parents[1] / "data" / "linuxcnc_times.json").read_text())
T = TIMES["period_s"]
PLAIN = LinuxcncSettings([200.0] * 3, [1000.0] * 3)
HEAD = "G21 G90 G17 G94 F6000\n"
V, A = 100.0, 1000.0


def settings(name):
    return LinuxcncSettings(**TIMES["settings"][name])


class TestAgainstLinuxcnc:
    """Periods in which the joints of headless LinuxCNC move (benchmarks/controllers)."""

    @pytest.mark.parametrize("row", TIMES["times"], ids=lambda row: f"{row['program']}-{row['settings']}")
    def test_times(self, row, tmp_path):
        name = row["program"]
        path, made = FILES / name, TWELVE | MADE
        if name in made:
            path = tmp_path / name
            path.write_text(made[name]())
        motion = linuxcnc_motion(read_program(path), settings(row["settings"]))
        assert motion.duration == pytest.approx(row["seconds"], rel=TIMES["within"])

    def test_how_many(self):
        timed = {(row["program"], row["settings"]) for row in TIMES["times"]}
        assert len(timed) == len(TIMES["times"]) >= 40
        assert {name for name, _ in timed} >= set(MADE) | set(TWELVE)


class TestLine:
    """Two periods are those by which the joints trail the plan."""

    def test_trapezoid(self, program):
        motion = linuxcnc_motion(program(HEAD + "G61\nG1 X10\nM2\n"), PLAIN)
        assert motion.duration == pytest.approx(10 / V + V / A + 2 * T, abs=T)

    def test_last_move_of_g64_has_half_the_acceleration(self, program):
        motion = linuxcnc_motion(program(HEAD + "G64\nG1 X10\nM2\n"), PLAIN)
        assert motion.duration == pytest.approx(2 * math.sqrt(10 / (A / 2)) + 2 * T, abs=T)

    @pytest.mark.parametrize("word", ["S500", "M8", "M64 P0", "G4 P0", "M0", "G55", "(MSG, half way)"])
    def test_words_that_wait_for_the_motion(self, program, word):
        once = linuxcnc_motion(program(HEAD + "G61\nG1 X10\nM2\n"), PLAIN)
        twice = linuxcnc_motion(program(HEAD + f"G61\nG10 L2 P2 X0\nG1 X10\n{word}\nX20\nM2\n"), PLAIN)
        assert twice.duration == pytest.approx(2 * once.duration)

    @pytest.mark.parametrize("word", ["M62 P0", "(a comment)", "N10", "T1"])
    def test_words_that_do_not(self, program, word):
        plain = linuxcnc_motion(program(HEAD + "G61\nG1 X10\nX20\nM2\n"), PLAIN)
        with_word = linuxcnc_motion(program(HEAD + f"G61\nG1 X10\n{word}\nX20\nM2\n"), PLAIN)
        assert with_word.duration == plain.duration < 0.31

    def test_by_direction(self, program):
        """Along (3, 4, 0) / 5: min(90 / 0.6, 60 / 0.8), min(300 / 0.6, 400 / 0.8)."""
        own = LinuxcncSettings([90, 60, 5], [300, 400, 10])
        motion = linuxcnc_motion(program("G21 G61\nG1 X30 Y40 F60000\nM2\n"), own)
        assert motion.duration == pytest.approx(50 / 75 + 75 / 500 + 2 * T, abs=T)

    def test_the_velocity_of_the_path(self, program):
        own = LinuxcncSettings([200.0] * 3, [1000.0] * 3, path_velocity=50.0)
        motion = linuxcnc_motion(program("G21 G61 G91\nG0 X30 Y40\nM2\n"), own)
        assert motion.duration == pytest.approx(1.0 + 50 / (1000 / 0.8) + 2 * T, abs=T)


class TestCorners:
    def test_a_kink_of_g61_stops_with_a_tenth_less(self, program):
        """Both lines have 0.9 of the acceleration."""
        motion = linuxcnc_motion(program(HEAD + "G61\nG1 X10\nY10\nM2\n"), PLAIN)
        assert motion.duration == pytest.approx(2 * (10 / V + V / (0.9 * A)) + 2 * T, abs=3 * T)

    def test_exact_stop(self, program):
        motion = linuxcnc_motion(program(HEAD + "G61.1\nG1 X10\nY10\nM2\n"), PLAIN)
        assert motion.duration == pytest.approx(2 * (10 / V + V / A) + 2 * T, abs=3 * T)

    def test_straight_on_under_g61_and_g61_1(self, program):
        text = HEAD + "{}\n" + "".join(f"G1 X{k}\n" for k in range(1, 11)) + "M2\n"
        on, stops = (linuxcnc_motion(program(text.format(mode)), PLAIN).duration for mode in ("G61", "G61.1"))
        assert on < 0.22
        assert stops > 10 * 2 * math.sqrt(1.0 / A)

    def test_the_arc_of_a_corner_keeps_the_tolerance(self, program):
        """It passes the corner at the distance P, with R = P / (sqrt(2) - 1)."""
        own = linuxcnc_motion(program(HEAD + "G64 P0.1\nG1 X10\nY10\nM2\n"), PLAIN)
        bent = np.flatnonzero(own.legs.rates[:, 0])
        radius = 1.0 / own.legs.rates[bent, 0]
        assert radius == pytest.approx([0.1 / (math.sqrt(2.0) - 1.0)], rel=1e-6)
        away = np.linalg.norm(own.at(np.linspace(0.0, own.duration, 20001)) - [10.0, 0.0, 0.0], axis=1).min()
        assert away == pytest.approx(0.1, rel=1e-3)

    def test_a_wider_tolerance_is_no_slower(self, program):
        text = HEAD + "G64 P{}\nG1 X10\nY10\nX20\nM2\n"
        times = [linuxcnc_motion(program(text.format(p)), PLAIN).duration for p in (0.001, 0.01, 0.1, 1.0)]
        assert times == sorted(times, reverse=True)

    def test_without_a_tolerance_moves_overlap(self, program):
        motion = linuxcnc_motion(program(HEAD + "G64\nG1 X10\nY10\nM2\n"), PLAIN)
        assert motion.duration == pytest.approx(0.374, abs=1e-9)  # as LinuxCNC
        assert motion.at(np.array([motion.duration])) == pytest.approx(np.array([[10.0, 10.0, 0.0]]), abs=1e-9)

    def test_the_path_has_no_gap(self, program):
        for mode in ("G64", "G64 P0.1", "G61"):
            motion = linuxcnc_motion(program(HEAD + f"{mode}\nG1 X10\nY5\nG2 X0 Y0 R8\nG1 Z3\nM2\n"), PLAIN)
            end = motion.legs.at(np.arange(motion.length.size), motion.length)[0]
            begin = motion.legs.at(np.arange(motion.length.size), np.zeros(motion.length.size))[0]
            assert np.abs(end[:-1] - begin[1:]).max() < 1e-9


class TestArcs:
    def test_a_circle(self, program):
        """v = sqrt(sqrt(3) / 2 a r); under G61 alone half of the acceleration is along the path."""
        motion = linuxcnc_motion(program(HEAD + "G61\nG2 I5 J0\nM2\n"), PLAIN)
        v = math.sqrt(math.sqrt(0.75) * A * 5.0)
        assert motion.speed.max() == pytest.approx(v, rel=1e-3)
        assert motion.duration == pytest.approx(10 * math.pi / v + v / (A / 2) + 2 * T, abs=2 * T)


class TestLines:
    def test_lines_keep_their_times(self, program):
        text = HEAD + "G64 P0.01\n" + "".join(f"G1 X{k}\n" for k in range(1, 11)) + "M2\n"
        motion = linuxcnc_motion(program(text), PLAIN)
        assert motion.duration == pytest.approx(0.285, abs=1e-9)  # of one line, as on LinuxCNC
        line, seconds = motion.line_seconds()
        assert line.tolist() == list(range(3, 13))
        assert seconds.sum() == pytest.approx(motion.duration)
        assert seconds == pytest.approx(seconds[::-1], abs=4 * T)


class TestInput:
    def test_splines_and_rotary_axes(self, program):
        with pytest.raises(InputError, match=r"part.ngc:1: the model of linuxcnc knows no splines"):
            linuxcnc_motion(program("G21 G5.1 X10 Y0 I5 J5 F600\nM2\n"), PLAIN)
        with pytest.raises(InputError, match="A: the model of linuxcnc is of X Y Z"):
            linuxcnc_motion(program("G21 G1 X10 A5 F600\nM2\n"), PLAIN)
        with pytest.raises(InputError, match="moves nothing"):
            linuxcnc_motion(program("G21\nM2\n"), PLAIN)

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"max_velocity": [1, 2]}, "max_velocity"),
            ({"max_acceleration": [1, 2, math.inf]}, "max_acceleration"),
            ({"period": 0.0}, "period"),
            ({"gap_cycles": -1.0}, "gap_cycles"),
            ({"path_velocity": 0.0}, "path_velocity"),
        ],
    )
    def test_settings(self, change, message):
        with pytest.raises(InputError, match=message):
            LinuxcncSettings(**({"max_velocity": [1.0] * 3, "max_acceleration": [1.0] * 3} | change))

    def test_on_a_machine(self):
        limits = load_limits("mill")
        own = linuxcnc_on(limits)
        assert own.max_velocity.tolist() == limits.velocity[:3].tolist()
        assert own.path_velocity == limits.rapid
        assert own.period == limits.period
