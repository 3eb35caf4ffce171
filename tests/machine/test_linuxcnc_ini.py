"""Limits from the INI file of a LinuxCNC machine."""

from pathlib import Path

import numpy as np
import pytest

from planner.errors import InputError
from planner.geometry.curve import AXES
from planner.machine.linuxcnc_ini import ini_machine
from planner.machine.machine_file import load_limits

POSITIVE = " must be a number > 0; leave the line out for no limit"
UNITS = "mm, metric, in, inch, imperial, or how many are a mm"
MILL = """\
# a three-axis mill
[EMCMOT]
SERVO_PERIOD = 500000
[KINS]
KINEMATICS = trivkins coordinates=XYYZ kinstype=BOTH
JOINTS = 4
[TRAJ]
COORDINATES = X Y Y Z
LINEAR_UNITS = mm
MAX_LINEAR_VELOCITY = 200   ; of the tool
[AXIS_X]
MAX_VELOCITY = 250
MAX_ACCELERATION = 1000
MAX_JERK = 20000
[AXIS_Y]
MAX_VELOCITY = 250
MAX_ACCELERATION = 1000
MAX_JERK = 20000
[AXIS_Z]
MAX_VELOCITY = 100
MAX_ACCELERATION = 500
[JOINT_1]
MAX_VELOCITY = 300
MAX_ACCELERATION = 900
[JOINT_2]
MAX_VELOCITY = 240
MAX_JERK = 15000
"""


@pytest.fixture
def load(tmp_path):
    def load(text):
        path = tmp_path / "machine.ini"
        path.write_text(text)
        return load_limits(path)

    return load


@pytest.fixture
def refusal(load):
    def refusal(text):
        with pytest.raises(InputError) as caught:
            load(text)
        return str(caught.value).partition("machine.ini:")[2]

    return refusal


def test_the_lowest_limit_of_axis_and_joints_counts(load):
    limits = load(MILL)
    assert limits.axes == ("X", "Y", "Z")
    assert limits.feed == 200.0
    assert limits.period == 5e-4
    assert limits.velocity.tolist() == [250, 240, 100]
    assert limits.acceleration.tolist() == [1000, 900, 500]
    assert limits.jerk.tolist() == [20000, 15000, np.inf]
    assert limits.tangential_acceleration == np.inf
    assert limits.chord_error == np.inf


def test_inches(load):
    limits = load(MILL.replace("LINEAR_UNITS = mm", "LINEAR_UNITS = inch"))
    mm = load(MILL)
    for name in ("feed", "velocity", "acceleration", "jerk"):
        assert getattr(limits, name) == pytest.approx(25.4 * getattr(mm, name), rel=1e-15)
    assert limits.period == mm.period


@pytest.mark.parametrize(("unit", "factor"), [("degree", np.pi / 180), ("grad", np.pi / 200), ("RAD", 1.0)])
def test_rotary_axes(load, unit, factor):
    text = MILL.replace("X Y Y Z\n", f"X Y Z A\nANGULAR_UNITS = {unit}\n").replace("XYYZ", "XYZA")
    text += "[AXIS_A]\nMAX_VELOCITY=90\nMAX_ACCELERATION=180\nMAX_JERK=3600\n"
    limits = load(text)
    assert limits.axes == ("X", "Y", "Z", "A")
    assert [limits.velocity[3], limits.acceleration[3], limits.jerk[3]] == pytest.approx(
        [90 * factor, 180 * factor, 3600 * factor], rel=1e-15
    )


@pytest.mark.parametrize(("unit", "factor"), [("1.0", 1.0), ("0.03937007874015748", 25.4), ("0.1", 10.0)])
def test_units_as_a_number_say_how_many_are_a_mm(load, unit, factor):
    limits = load(MILL.replace("LINEAR_UNITS = mm", f"LINEAR_UNITS = {unit}"))
    assert limits.velocity.tolist() == pytest.approx([factor * v for v in (250, 240, 100)], rel=1e-15)


def test_nine_axes_of_which_a_curve_takes_its_own(load):
    lines = [f"[AXIS_{axis}]\nMAX_VELOCITY={10 + k}\nMAX_ACCELERATION={100 + k}\n" for k, axis in enumerate(AXES)]
    limits = load(f"[TRAJ]\nCOORDINATES = {' '.join(AXES)}\nANGULAR_UNITS = rad\n" + "".join(lines))
    assert limits.axes == AXES
    assert limits.velocity.tolist() == list(range(10, 19))
    chosen = limits.for_axes(("X", "Z", "C"), "a program")
    assert (chosen.velocity.tolist(), chosen.acceleration.tolist()) == ([10, 12, 15], [100, 102, 105])


def test_axes_had_numbers_before_version_2_8(load):
    old = MILL.replace("[AXIS_X]", "[AXIS_0]").replace("[AXIS_Y]", "[AXIS_1]").replace("[AXIS_Z]", "[AXIS_2]")
    old = old[: old.index("[JOINT_1]")]
    assert load(old).velocity.tolist() == [250, 250, 100]


def test_the_same_value_twice_is_no_contradiction(load):
    assert load(MILL.replace("MAX_VELOCITY = 100\n", "MAX_VELOCITY = 100\nMAX_VELOCITY = 100\n")) == load(MILL)


class TestIncludes:
    @pytest.fixture
    def parts(self, tmp_path):
        """A machine in three files, in two folders."""
        (tmp_path / "axes").mkdir()
        head, _, rest = MILL.partition("[AXIS_X]")
        x, _, yz = rest.partition("[AXIS_Y]")
        (tmp_path / "machine.ini").write_text(head + "#INCLUDE axes/all.inc\n# and nothing else\n")
        (tmp_path / "axes" / "all.inc").write_text("#INCLUDE x.inc\n[AXIS_Y]" + yz)
        (tmp_path / "axes" / "x.inc").write_text("[AXIS_X]" + x)
        return tmp_path

    def test_the_lines_count_where_they_are_included(self, parts, load):
        found = load_limits(parts / "machine.ini")
        assert found == load(MILL)

    def test_what_is_wrong_has_the_line_of_its_own_file(self, parts):
        file = parts / "axes" / "x.inc"
        file.write_text(file.read_text().replace("1000", "soon"))
        with pytest.raises(InputError) as caught:
            load_limits(parts / "machine.ini")
        assert str(caught.value) == f"{file}:3: [AXIS_X]MAX_ACCELERATION = soon{POSITIVE}"

    def test_a_key_twice_in_two_files(self, parts):
        file = parts / "axes" / "all.inc"
        file.write_text(file.read_text() + "[AXIS_X]\nMAX_VELOCITY = 3\n")
        with pytest.raises(InputError) as caught:
            load_limits(parts / "machine.ini")
        first = f"first in line 2 of {parts / 'axes' / 'x.inc'}; leave one"
        assert str(caught.value) == f"{file}:16: [AXIS_X]MAX_VELOCITY: is given twice, {first}"


def test_the_trajectory_has_limits_of_its_own(load):
    given = "MAX_LINEAR_VELOCITY = 120\nMAX_LINEAR_ACCELERATION = 700\nMAX_LINEAR_JERK = 9000\n"
    limits = load(MILL.replace("MAX_LINEAR_VELOCITY = 200   ; of the tool\n", given))
    assert (limits.feed, limits.tangential_acceleration, limits.tangential_jerk) == (120, 700, 9000)


def test_the_names_before_version_2_8(load):
    assert load(MILL.replace("MAX_LINEAR_VELOCITY = 200", "MAX_VELOCITY = 210")).feed == 210


def test_without_a_limit_on_the_path_the_feed_has_none(load):
    assert load(MILL.replace("MAX_LINEAR_VELOCITY = 200   ; of the tool\n", "")).feed == np.inf


def test_joints_are_not_axes_of_other_kinematics(load):
    limits = load(MILL.replace("trivkins coordinates=XYYZ kinstype=BOTH", "5axiskins"))
    assert limits.velocity.tolist() == [250, 250, 100]


def test_what_does_not_concern_limits_is_passed_over(load):
    extra = (
        "[HAL]\nHALFILE = a.hal \\\n  more\n  words without a sign\nX = 1\nX = 2\n[DISPLAY]\nMAX_LINEAR_VELOCITY=1\n"
    )
    assert load(MILL + extra).velocity.tolist() == [250, 240, 100]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("COORDINATES = X Y Y Z", "", " [TRAJ]COORDINATES is missing; it names the axes, for example X Y Z"),
        (
            "COORDINATES = X Y Y Z",
            "COORDINATES = X Q",
            "8: [TRAJ]COORDINATES = X Q must be letters out of " + " ".join(AXES),
        ),
        ("LINEAR_UNITS = mm", "LINEAR_UNITS = cubit", "9: [TRAJ]LINEAR_UNITS = cubit must be one of " + UNITS),
        ("MAX_VELOCITY = 250", "MAX_VELOCITY = fast", "12: [AXIS_X]MAX_VELOCITY = fast" + POSITIVE),
        ("MAX_JERK = 20000", "MAX_JERK = 0", "14: [AXIS_X]MAX_JERK = 0" + POSITIVE),
        ("MAX_ACCELERATION = 500", "MAX_ACCELERATION = nan", "21: [AXIS_Z]MAX_ACCELERATION = nan" + POSITIVE),
        (
            "MAX_VELOCITY = 100\n",
            "",
            " [AXIS_Z]MAX_VELOCITY or [JOINT_3]MAX_VELOCITY is missing, velocity of axis Z; write it there, or give "
            "velocity_mm_s (--velocity-mm-s)",
        ),
        (
            "MAX_VELOCITY = 100",
            "MAX_VELOCITY 100",
            '20: MAX_VELOCITY 100: neither "[SECTION]" nor "KEY = value" within one',
        ),
        (
            "MAX_VELOCITY = 100",
            "MAX_VELOCITY = 100\nMAX_VELOCITY = 90",
            "21: [AXIS_Z]MAX_VELOCITY: is given twice, first in line 20; leave one",
        ),
        ("[AXIS_Z]", "[AXIS_Z", '19: [AXIS_Z: a section must have its name in "[ ]"'),
        ("SERVO_PERIOD = 500000", "SERVO_PERIOD = -1", "3: [EMCMOT]SERVO_PERIOD = -1" + POSITIVE),
        ("# a three-axis mill", "three axes", '1: three axes: neither "[SECTION]" nor "KEY = value" within one'),
    ],
)
def test_refusals_name_file_line_and_key(refusal, old, new, message):
    assert old in MILL
    assert refusal(MILL.replace(old, new, 1)) == message


def test_an_empty_file(refusal):
    assert refusal("").startswith(" [TRAJ]COORDINATES is missing")


class TestPlannerOfLinuxcnc:
    """What a model of it goes by, and no limit."""

    TEXT = (
        "[TRAJ]\nCOORDINATES = X\nARC_BLEND_ENABLE = 0\nARC_BLEND_KINK_RATIO = 0.2\n"
        "[AXIS_X]\nMAX_VELOCITY = 1\nMAX_ACCELERATION = 1\n"
    )

    def test_words(self):
        words = ini_machine(self.TEXT + "[DISPLAY]\nMAX_FEED_OVERRIDE = 1.5\n", Path("machine.ini")).setup.controller
        assert (words.arc_blend, words.kink_ratio, words.max_feed_override) == (0.0, 0.2, 1.5)
        assert words.optimization_depth is None

    def test_a_value_that_is_none(self):
        with pytest.raises(
            InputError, match=r"machine.ini:4: \[TRAJ\]ARC_BLEND_KINK_RATIO = none must be a number > 0"
        ):
            ini_machine(self.TEXT.replace("0.2", "none"), Path("machine.ini"))
