"""Limits from a Klipper configuration."""

import math

import pytest

from planner.errors import InputError
from planner.machine.machine_file import load_limits, read_machine

PRINTER = """\
# bed slinger
[mcu]
serial: /dev/ttyACM0

[printer]
kinematics: cartesian
max_velocity: 250   # mm/s
max_accel = 2500 ; mm/s^2
max_z_velocity: 12
max_z_accel: 80
square_corner_velocity: 4.0

[gcode_macro START]
gcode:
  {% if printer.idle %}
  [not a section
  max_velocity: nothing
  {% endif %}
"""


@pytest.fixture
def load(tmp_path):
    def load(text, **options):
        path = tmp_path / "printer.cfg"
        path.write_text(text)
        return load_limits(path, **options)

    return load


@pytest.fixture
def refusal(load):
    def refusal(text):
        with pytest.raises(InputError) as caught:
            load(text)
        return str(caught.value).partition("printer.cfg:")[2]

    return refusal


def test_limits_of_the_printer(load, tmp_path):
    limits = load(PRINTER)
    assert limits.axes == ("X", "Y", "Z")
    assert (limits.feed, limits.rapid, limits.tangential_acceleration) == (250, 250, 2500)
    assert limits.velocity.tolist() == [250, 250, 12]
    assert limits.acceleration.tolist() == [2500, 2500, 80]
    assert limits.jerk.tolist() == [math.inf] * 3
    assert read_machine(tmp_path / "printer.cfg", {"jerk_mm_s3": 1e5}).notes == (
        "its square_corner_velocity of 4 mm/s is no limit: the tolerance of the path stands for it",
        "jerk 100000 mm/s^3 given for X Y Z",
    )


def test_z_is_as_fast_as_the_others_where_nothing_else_is_said(load):
    text = PRINTER.replace("max_z_velocity: 12\n", "").replace("max_z_accel: 80\n", "")
    limits = load(text)
    assert (limits.velocity[2], limits.acceleration[2]) == (250, 2500)


def test_the_last_value_counts_as_in_klipper(load, tmp_path):
    (tmp_path / "slow.cfg").write_text("[printer]\nmax_velocity: 60\nmax_z_velocity: 5\n")
    assert load(PRINTER + "\n[include slow.cfg]\n").velocity.tolist() == [60, 60, 5]
    assert load("[include slow.cfg]\n" + PRINTER).velocity.tolist() == [250, 250, 12]
    assert load(PRINTER + "\n[include none*.cfg]\n").velocity.tolist() == [250, 250, 12]
    (tmp_path / "a1.cfg").write_text("[printer]\nmax_velocity: 70\n")
    (tmp_path / "a2.cfg").write_text("[printer]\nmax_velocity: 71\n")
    assert load(PRINTER + "\n[include a*.cfg]\n").velocity[0] == 71


def test_what_is_lacking_is_given_beside_it(load):
    text = PRINTER.replace("max_accel = 2500 ; mm/s^2\n", "").replace("max_z_accel: 80\n", "")
    assert load(text, complete={"acceleration_mm_s2": 900.0}).acceleration.tolist() == [900] * 3


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("max_velocity: 250", "max_velocity: fast", "7: [printer] max_velocity = fast must be a number > 0"),
        ("max_z_accel: 80", "max_z_accel: 0", "10: [printer] max_z_accel = 0 must be a number > 0"),
        ("velocity: 4.0", "velocity: -1", "11: [printer] square_corner_velocity = -1 must be a number >= 0"),
        (
            "max_z_velocity: 12",
            "max_z_velocity: 300",
            "9: [printer] max_z_velocity = 300 must be at most max_velocity, which is 250",
        ),
        ("kinematics: cartesian", "cartesian", '6: cartesian: is no option of [printer], such as "max_velocity: 300"'),
        ("[mcu]", "[mcu", '2: [mcu: a section must have its name in "[ ]"'),
        ("[printer]", "[print]", " [printer] is missing, the section with max_velocity and max_accel"),
        (
            "max_velocity: 250",
            "",
            " [printer] max_velocity is missing, velocity of axis X; write it there, or give velocity_mm_s "
            "(--velocity-mm-s)",
        ),
    ],
)
def test_refusals_name_file_line_and_option(refusal, old, new, message):
    assert old in PRINTER
    assert refusal(PRINTER.replace(old, new, 1)) == message


def test_includes_that_are_missing_or_lead_back(refusal):
    assert refusal("[include none.cfg]\n" + PRINTER).startswith("1: [include none.cfg]: ")
    assert refusal("[include printer.cfg]\n" + PRINTER).endswith("printer.cfg includes itself; delete this line")
