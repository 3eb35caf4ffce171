"""Limits of machines out of their logs: made ones of which all is known, and those of a controller with hidden limits."""

import itertools
import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import PROJECT
from known_machines import ACCELERATION, AXES, CORNERS, JERK, TAU, VELOCITY, made_log

from benchmarks.calibration import programs
from planner.calibration.calibrate import calibrate_logs
from planner.calibration.calibrated_machine import calibrated_limits, calibrated_text
from planner.calibration.known_path import known_path
from planner.calibration.laws import MotionLaw
from planner.calibration.log import Log
from planner.errors import InputError
from planner.machine.limits import Limits
from planner.machine.machine_table import Machine
from planner.machine.machine_toml import toml_machine
from planner.programs.reading.reader import read_program
from planner.quantity import ACCELERATION as A
from planner.quantity import VELOCITY as V

START = Limits(200.0, [250.0] * 3, [1000.0] * 3, [30000.0] * 3, axes=AXES)
DATA = PROJECT / "tests" / "data" / "calibration"
NAMES = tuple(name for name, _ in programs.logged())
HIDDEN = json.loads((DATA / "linuxcnc.json").read_text())


@cache
def recorded(name):
    """A log of headless LinuxCNC: joint commands to the nanometre, kept as second differences."""
    with np.load(DATA / "linuxcnc.npz") as file:
        counts = np.cumsum(np.cumsum(file[name].astype(np.int64), axis=0), axis=0)
    t = HIDDEN["period_s"] * np.arange(counts.shape[0])
    return Log(f"{name}.csv", AXES, t, 1e-6 * counts, HIDDEN["period_s"], (slice(0, t.size),))


def program_of(name, folder):
    file = folder / f"{name}.ngc"
    file.write_text(dict(programs.logged())[name])
    return read_program(file)


def values(found, quantity, known=True):
    return {limit.axis: limit.value for limit in found.limits if limit.quantity is quantity and limit.known is known}


@cache
def hidden():
    return calibrate_logs([recorded(name) for name in NAMES], START)


class TestHiddenLimitsOfLinuxcnc:
    def test_acceleration_within_a_thousandth(self):
        got = values(hidden(), A)
        assert [got[axis] for axis in AXES] == pytest.approx(HIDDEN["acceleration"], rel=1e-3)

    def test_velocity_within_a_thousandth(self):
        got = values(hidden(), V)
        assert [got[axis] for axis in AXES] == pytest.approx(HIDDEN["velocity"], rel=1e-3)

    def test_it_is_a_trapezoid_whose_jerk_is_not_told(self):
        assert hidden().laws.best is MotionLaw.TRAPEZOID
        assert values(hidden(), A, known=False) == {}

    def test_counts_of_an_encoder_change_little(self):
        logs = [replace(log, position=np.round(log.position / 2e-3) * 2e-3) for log in map(recorded, NAMES)]
        got = values(calibrate_logs(logs, START), A)
        assert [got[axis] for axis in AXES] == pytest.approx(HIDDEN["acceleration"], rel=5e-3)

    def test_gaps_change_little(self):
        logs = []
        for log in map(recorded, NAMES):
            edges = np.linspace(0, log.t.size, 9).astype(int)
            pieces = tuple(slice(a, b - 200) for a, b in itertools.pairwise(edges))
            logs.append(replace(log, pieces=pieces))
        got = values(calibrate_logs(logs, START), A)
        assert [got[axis] for axis in AXES] == pytest.approx(HIDDEN["acceleration"], rel=2e-3)


class TestKnownMachines:
    def test_a_trapezoid(self):
        found = calibrate_logs([made_log("trapezoid", count=1e-3)], START)
        assert list(values(found, A).values()) == pytest.approx(ACCELERATION, rel=1e-3)
        assert list(values(found, V).values()) == pytest.approx(VELOCITY, rel=1e-3)
        assert calibrated_limits(START, found.limits).jerk.tolist() == [30000.0] * 3

    def test_an_s_curve(self):
        found = calibrate_logs([made_log("s-curve", count=1e-3)], START)
        assert list(values(found, A).values()) == pytest.approx(ACCELERATION, rel=2e-3)
        assert calibrated_limits(START, found.limits).jerk.tolist() == pytest.approx(JERK, rel=5e-3)

    def test_a_filter_is_written_as_the_jerk_of_a_move_from_rest(self):
        found = calibrate_logs([made_log("fir", count=1e-3)], START)
        assert found.laws.best is MotionLaw.FIR
        expected = [a / TAU for a in ACCELERATION]
        assert calibrated_limits(START, found.limits).jerk.tolist() == pytest.approx(expected, rel=5e-3)

    def test_an_acceleration_that_jerk_kept_out_of_reach_is_not_known(self):
        """At 40 mm/s the S-curve of X peaks at sqrt(40 * 20000) = 894 mm/s^2, below its 900."""
        found = calibrate_logs([made_log("s-curve", feed=40.0, count=5e-4)], START)
        assert set(values(found, A)) == {"Z"}
        assert all(limit.value < 900.0 for limit in found.limits if limit.axis == "X" and limit.quantity is A)

    def test_a_velocity_that_no_move_reached_is_not_known(self):
        found = calibrate_logs([made_log("trapezoid", feed=30.0)], START)
        assert values(found, V) == {}
        assert values(found, V, known=False) == pytest.approx(dict.fromkeys(AXES, 30.0), rel=1e-6)
        assert calibrated_limits(START, found.limits).velocity.tolist() == [250.0] * 3

    def test_what_was_passed_is_raised(self):
        slow = Limits(200.0, [20.0] * 3, [1000.0] * 3, [30000.0] * 3, axes=AXES)
        found = calibrate_logs([made_log("trapezoid", feed=30.0)], slow)
        assert calibrated_limits(slow, found.limits).velocity.tolist() == pytest.approx([30.0] * 3)

    def test_axes_that_do_not_move_or_are_not_logged(self):
        plane = CORNERS.copy()
        plane[:, 2] = 4.0
        keep = np.concatenate([[True], np.any(np.diff(plane, axis=0) != 0.0, axis=1)])
        machine = Limits(200.0, [250.0] * 4, [1000.0] * 4, [30000.0] * 4, axes=("X", "Y", "Z", "A"))
        found = calibrate_logs([made_log("trapezoid", corners=plane[keep])], machine)
        why = {limit.axis: limit.why for limit in found.limits if limit.quantity is A}
        assert set(values(found, A)) == {"X", "Y"}
        assert "does not move" in why["Z"]
        assert "no log has this axis" in why["A"]

    def test_logs_of_one_axis_each(self):
        logs = [
            replace(made_log("trapezoid"), axes=(axis,), position=made_log("trapezoid").position[:, [j]])
            for j, axis in enumerate(AXES)
        ]
        assert list(values(calibrate_logs(logs, START), A).values()) == pytest.approx(ACCELERATION, rel=1e-3)


class TestLogsThatAreWrong:
    def test_an_axis_that_the_machine_lacks(self):
        machine = Limits(200.0, [250.0] * 2, [1000.0] * 2, [30000.0] * 2, axes=("X", "Y"))
        with pytest.raises(InputError, match="machine has no axis Z; its axes are X, Y"):
            calibrate_logs([made_log("trapezoid")], machine)

    @pytest.mark.parametrize(
        ("length", "time", "said"),
        [
            (25.4, 1.0, "25.4 in length"),
            (1e-3, 1.0, "1000 in length"),
            (1.0, 60.0, "60 in time"),
            (1.0, 1e-3, "1000 in time"),
        ],
    )
    def test_units_against_the_machine_file(self, length, time, said):
        log = made_log("trapezoid")
        wrong = replace(log, t=time * log.t, position=length * log.position, period=time * log.period)
        with pytest.raises(InputError, match=said):
            calibrate_logs([wrong], START)
        assert calibrate_logs([wrong], START, trust_units=True).limits

    @pytest.mark.parametrize(
        ("length", "time", "said"),
        [
            (1 / 25.4, 1.0, r"as if inch were called mm; name the columns X_inch"),
            (1e-3, 1.0, "as if m were called mm"),
            (1.0, 1e3, "about 1000 times too long"),
            (1.0, 1 / 60, "about 60 times too short"),
        ],
    )
    def test_units_against_the_program(self, tmp_path, length, time, said):
        log = recorded("walk")
        wrong = replace(log, t=time * log.t, position=length * log.position, period=time * log.period)
        with pytest.raises(InputError, match=said):
            calibrate_logs([wrong], START, {0: program_of("walk", tmp_path)})

    def test_another_program(self, tmp_path):
        with pytest.raises(InputError, match=r"slots.csv: is not a log of walk.ngc: positions leave its path by"):
            calibrate_logs([recorded("slots")], START, {0: program_of("walk", tmp_path)})

    @pytest.mark.parametrize("name", NAMES)
    def test_its_own_program_at_another_origin(self, tmp_path, name):
        log = recorded(name)
        away = replace(log, position=np.add(log.position, [250.0, -80.0, 33.0]))
        assert known_path(away, program_of(name, tmp_path)).shift == pytest.approx([250.0, -80.0, 33.0], abs=2.0)

    def test_a_program_tells_a_feed_from_a_limit(self, tmp_path):
        """Of X alone at 150 mm/s nothing else says that F asked for 250."""
        text = "G21 G90 G61\nF15000\nG1 X110 Y0\nG1 X0 Y0\nM2\n"
        (tmp_path / "line.ngc").write_text(text)
        log = made_log("trapezoid", corners=np.array([[0.0, 0, 0], [110.0, 0, 0], [0.0, 0, 0]]))
        program = read_program(tmp_path / "line.ngc")
        assert "X" not in values(calibrate_logs([log], START), V)
        assert values(calibrate_logs([log], START, {0: program}), V)["X"] == pytest.approx(150.0)


def test_the_machine_file_says_where_each_value_is_from(tmp_path):
    found = calibrate_logs([made_log("trapezoid", feed=30.0)], START)
    text = calibrated_text(Machine(START), found.limits, ["of a test"], tmp_path)
    again = toml_machine(text, "again.toml").machine().limits
    assert again == calibrated_limits(START, found.limits)
    assert "velocity_mm_s = 250.0  # as it was: not measured" in text
    assert "# measured" in text
    assert text.startswith("# of a test\n")
