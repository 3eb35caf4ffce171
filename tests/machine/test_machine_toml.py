"""Units of a machine file in TOML, and what programs count on."""

import math
import tomllib

import pytest

from planner.errors import InputError
from planner.machine.machine_file import load_limits, read_machine
from planner.machine.machine_toml import HEAD_KEYS, PROGRAM_KEYS, axis_keys, unit_keys
from planner.machine.program_setup import RestTimes

PLAIN = {"feed_mm_s": 100.0, "rapid_mm_s": 150.0, "chord_error_mm": 0.002, "period_s": 0.002}
PLAIN |= {"tangential_acceleration_mm_s2": 700.0, "tangential_jerk_mm_s3": 9000.0}
X = {"velocity_mm_s": 200.0, "acceleration_mm_s2": 800.0, "jerk_mm_s3": 15000.0}
A = {"velocity_rad_s": 6.0, "acceleration_rad_s2": 60.0, "jerk_rad_s3": 900.0}
MILL = """\
feed_mm_s = 100.0
[[axis]]
name = "X"
velocity_mm_s = 200
acceleration_mm_s2 = 800
jerk_mm_s3 = 15000
"""


def text_of(head, *axes):
    lines = [f"{key} = {value!r}" for key, value in head.items()]
    for name, axis in axes:
        lines += ["[[axis]]", f'name = "{name}"', *(f"{key} = {value!r}" for key, value in axis.items())]
    return "\n".join(lines)


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "machine.toml"
        path.write_text(text)
        return read_machine(path)

    return read


def spellings():
    """Every key of a machine file with every other unit that it may have."""
    every = [("head", key) for key in HEAD_KEYS] + [("X", key) for key in X] + [("A", key) for key in A]
    return [(of, key, other, factor) for of, key in every for other, factor in unit_keys(key).items()]


@pytest.mark.parametrize(("of", "key", "other", "factor"), spellings())
def test_a_key_says_the_same_in_every_unit(read, of, key, other, factor):
    tables = {"head": PLAIN, "X": X, "A": A}
    plain = read(text_of(PLAIN, ("X", X), ("A", A))).limits
    tables[of] = {other if name == key else name: v / factor if name == key else v for name, v in tables[of].items()}
    found = read(text_of(tables["head"], ("X", tables["X"]), ("A", tables["A"]))).limits
    for name in ("feed", "rapid", "chord_error", "period", "tangential_acceleration", "tangential_jerk"):
        assert getattr(found, name) == pytest.approx(getattr(plain, name), rel=1e-15)
    for name in ("velocity", "acceleration", "jerk"):
        assert getattr(found, name) == pytest.approx(getattr(plain, name), rel=1e-15)


def test_units_by_their_own_numbers():
    """A foot a minute, a turn a minute: from what the units are, not from the table."""
    assert unit_keys("feed_mm_s")["feed_inch_min"] * 12 == pytest.approx(304.8 / 60, rel=1e-15)
    assert unit_keys("feed_mm_s")["feed_m_min"] * 60 == pytest.approx(1000.0, rel=1e-15)
    assert unit_keys("velocity_rad_s")["velocity_rev_min"] * 60 == pytest.approx(2 * math.pi, rel=1e-15)
    assert unit_keys("jerk_rad_s3")["jerk_deg_s3"] * 180 == pytest.approx(math.pi, rel=1e-15)
    assert unit_keys("acceleration_mm_s2")["acceleration_m_s2"] == 1000.0
    assert unit_keys("chord_error_mm") == {"chord_error_mm": 1.0, "chord_error_m": 1000.0, "chord_error_inch": 25.4}
    assert unit_keys("period_s") == {"period_s": 1.0, "period_ms": 1e-3}
    assert unit_keys("jerk_mm_s3").keys() == {"jerk_mm_s3", "jerk_m_s3", "jerk_inch_s3"}
    assert unit_keys("name") == {"name": 1.0}


def test_no_two_keys_have_a_spelling_in_common():
    for keys in (HEAD_KEYS, axis_keys("mm"), axis_keys("rad")):
        every = [other for key in keys for other in unit_keys(key)]
        assert len(every) == len(set(every))


class TestProgram:
    TEXT = (
        MILL
        + """
[program]
tools = "tools.tbl"
home_mm = { X = 0, Z = 120.5 }
home_deg = { A = 90 }
second_home_inch = { X = -1.0 }
tool_change_mm = { X = 10, Y = 20 }
tool_change_s = 6.5
spindle_start_s = 0

[program.offsets_mm]
G54 = { X = 100, Y = 50.5, Z = -30 }
"G59.1" = { X = 1 }

[program.offsets_deg]
G54 = { C = 180 }
"""
    )

    def test_positions_in_mm_and_degrees(self, read, tmp_path):
        setup = read(self.TEXT).setup
        assert setup.tools == tmp_path / "tools.tbl"
        assert setup.home == {"X": 0.0, "Z": 120.5, "A": 90.0}
        assert setup.second_home == {"X": -25.4}
        assert setup.tool_change == {"X": 10.0, "Y": 20.0}
        assert setup.rests == RestTimes(6.5, 0.0)
        assert setup.offsets == {
            "G54": {"X": 100.0, "Y": 50.5, "Z": -30.0, "C": 180.0},
            "G59.1": {"X": 1.0},
        }

    @pytest.mark.parametrize(("unit", "value"), [("deg", 90.0), ("rad", math.pi / 2), ("rev", 0.25)])
    def test_an_angle_in_every_unit(self, read, unit, value):
        setup = read(f"{MILL}[program]\nhome_{unit} = {{ B = {value!r} }}\n").setup
        assert setup.home == {"B": pytest.approx(90.0, rel=1e-15)}

    def test_limits_are_the_same_with_it(self, read):
        assert read(self.TEXT).limits == read(MILL).limits

    def test_without_it_nothing_is_known(self, read):
        setup = read(MILL).setup
        assert (setup.tools, setup.home, setup.second_home, setup.tool_change, setup.offsets) == (None,) * 4 + ({},)
        assert setup.rests == RestTimes(None, None)

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("home = { X = 1 }", f'toml:8: unknown key "program.home"; the keys are {", ".join(PROGRAM_KEYS)}'),
            ("home_mm = 5", "toml:8: program.home_mm = 5 must be a table such as { X = 10 }"),
            ("home_mm = {}", "toml:8: program.home_mm = {} must be a table such as { X = 10 }"),
            ("home_mm = { A = 5 }", 'toml:8: program.home_mm has "A"; in mm there may be X, Y, Z, U, V, W'),
            ("home_deg = { X = 5 }", 'toml:8: program.home_deg has "X"; in deg there may be A, B, C'),
            ("home_mm = { X = inf }", "toml:8: program.home_mm.X = inf must be a finite number"),
            ("home_mm = { X = true }", "toml:8: program.home_mm.X = True must be a finite number"),
            ('home_mm = { X = "1" }', "toml:8: program.home_mm.X = '1' must be a finite number"),
            ("tools = 3", "toml:8: program.tools = 3 must be the name of a tool table, .tbl"),
            (
                "offsets_mm = { G60 = { X = 1 } }",
                "toml:8: program.offsets_mm must be a table with a point for each of G54,",
            ),
            ("tool_change_s = -1", "toml:8: program.tool_change_s = -1 must be a finite number of at least 0, in s"),
            ("tool_change_s = nan", "toml:8: program.tool_change_s = nan must be a finite number of at least 0, in s"),
            ('tool_change_s = "8 s"', "toml:8: program.tool_change_s = '8 s' must be a finite number of at least 0"),
            ("spindle_start_s = inf", "toml:8: program.spindle_start_s = inf must be a finite number of at least 0"),
            ("spindle_start_s = true", "toml:8: program.spindle_start_s = True must be a finite number of at least 0"),
            ("offsets_mm = { G54 = 1 }", "toml:8: program.offsets_mm.G54 = 1 must be a table such as { X = 10 }"),
        ],
    )
    def test_refusals_name_file_line_and_key(self, read, line, message):
        with pytest.raises(InputError) as caught:
            read(f"{MILL}[program]\n{line}\n")
        assert message in str(caught.value)

    def test_a_program_that_is_no_table(self, read):
        with pytest.raises(InputError, match="toml:1: program must be a table, with the keys tools, home_mm"):
            read("program = 1\n" + MILL)


def test_lines_are_not_invented_where_a_file_is_written_otherwise(read):
    """Inline tables have no line of their own: the file alone is named."""
    text = 'feed_mm_s = 1\naxis = [{ name = "X", velocity_mm_s = 0, acceleration_mm_s2 = 1, jerk_mm_s3 = 1 }]'
    assert tomllib.loads(text)
    with pytest.raises(InputError, match=r"machine\.toml: axis\[0\] \(X\)\.velocity_mm_s = 0 must be"):
        read(text)


def test_a_machine_of_another_name_is_known_by_its_feed(tmp_path):
    path = tmp_path / "machine.conf"
    path.write_text(MILL)
    assert load_limits(path).feed == 100.0
    path.write_text("speed: 5\n")
    with pytest.raises(
        InputError, match=r"machine\.conf: is no machine file; it must be \.toml, the \.ini of LinuxCNC"
    ):
        load_limits(path)
