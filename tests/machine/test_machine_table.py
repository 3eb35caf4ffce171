"""What a machine file lacks is given beside it, or asked for."""

import math

import pytest

from planner.errors import InputError
from planner.machine.machine_file import load_limits, read_machine
from planner.machine.machine_table import COMPLETIONS

INI = """\
[TRAJ]
COORDINATES = X Y A
[AXIS_X]
MAX_VELOCITY = 100
MAX_ACCELERATION = 500
[AXIS_Y]
MAX_VELOCITY = 100
MAX_JERK = 7000
[AXIS_A]
MAX_VELOCITY = 90
MAX_ACCELERATION = 360
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "machine.ini"
    path.write_text(INI)
    return path


def test_only_what_is_lacking_is_given(file):
    machine = read_machine(file, {"acceleration_mm_s2": 400, "jerk_mm_s3": 9000, "jerk_rad_s3": 50})
    assert machine.limits.acceleration[:2].tolist() == [500, 400]
    assert machine.limits.jerk.tolist() == [9000, 7000, 50]
    assert machine.notes == (
        "acceleration 400 mm/s^2 given for Y",
        "jerk 9000 mm/s^3 given for X",
        "jerk 50 rad/s^3 given for A",
    )


def test_what_has_no_limit_is_said(file):
    machine = read_machine(file, {"acceleration_mm_s2": 400})
    assert machine.limits.jerk.tolist() == [math.inf, 7000, math.inf]
    assert machine.notes[-1] == "no jerk limit on X A"


def test_what_is_lacking_is_asked_for_by_its_name(file):
    with pytest.raises(InputError) as caught:
        load_limits(file)
    assert str(caught.value) == (
        f"{file}: [AXIS_Y]MAX_ACCELERATION or [JOINT_1]MAX_ACCELERATION is missing, acceleration of axis Y; write it "
        "there, or give acceleration_mm_s2 (--acceleration-mm-s2)"
    )


@pytest.mark.parametrize(
    ("complete", "message"),
    [
        (
            {"velocity_mm_s": 5},
            "velocity_mm_s = 5 completes what the file lacks, but it has velocity of every axis in mm (X 100, Y 100); "
            "change it there, or leave velocity_mm_s out",
        ),
        ({"jerk": 5}, f"complete: unknown key 'jerk'; the keys are {', '.join(COMPLETIONS)}"),
        ({"jerk_mm_s3": 0}, "jerk_mm_s3 = 0 must be a number > 0"),
        ({"jerk_mm_s3": "5"}, "jerk_mm_s3 = '5' must be a number > 0"),
        ([5], "complete = [5] must map keys to numbers"),
    ],
)
def test_what_completes_nothing_is_refused(file, complete, message):
    with pytest.raises(InputError) as caught:
        load_limits(file, complete=complete)
    assert message in str(caught.value)


def test_no_axis_of_that_kind():
    with pytest.raises(InputError, match=r"it has jerk of every axis in rad \(no such axis\)"):
        load_limits("mill", complete={"jerk_rad_s3": 5.0})


def test_a_toml_file_may_leave_to_the_caller_what_it_lacks(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text('feed_mm_s = 5\n[[axis]]\nname = "X"\nvelocity_mm_s = 5\nacceleration_mm_s2 = inf\n')
    limits = load_limits(path, complete={"acceleration_mm_s2": 3.0, "jerk_mm_s3": 4.0})
    assert (limits.acceleration[0], limits.jerk[0]) == (3.0, 4.0)
