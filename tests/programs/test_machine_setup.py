"""Homes, work offsets and tool changes of a machine file: from the file to the moves of a program and its plan."""

from __future__ import annotations

import numpy as np
import pytest

from feedplan.job import load_job, load_job_of_table, plan_and_check
from planner import InputError, read_program, read_table, write_table
from planner.machine.machine_file import read_machine

AXIS = "velocity_mm_s = 200\nacceleration_mm_s2 = 2000\njerk_mm_s3 = 40000\n"
LIMITS = "feed_mm_s = 100\n" + "".join(f'[[axis]]\nname = "{axis}"\n{AXIS}' for axis in "XYZ")
TURNING = '[[axis]]\nname = "A"\nvelocity_deg_s = 360\nacceleration_deg_s2 = 3600\njerk_deg_s3 = 90000\n'
SETUP = """\
[program]
home_mm = { X = 1, Z = 120 }
second_home_inch = { X = -1, Y = 2 }
tool_change_mm = { X = -50, Z = 150 }

[program.offsets_mm]
G54 = { X = 100, Y = 50, Z = -30 }
"G59.3" = { X = 7 }
"""
NOTHING_ASSUMED = ()


@pytest.fixture
def machine(tmp_path):
    """Write a machine file with a table of programs."""

    def machine(setup=SETUP, limits=LIMITS):
        path = tmp_path / "shop.toml"
        path.write_text(limits + setup)
        return path

    return machine


@pytest.fixture
def read(machine, tmp_path):
    def read(text, **files):
        path = tmp_path / "part.ngc"
        path.write_text(text)
        return read_program(path, setup=read_machine(machine(**files)).setup)

    return read


def ends(program):
    return program.end[:, :3].tolist()


class TestOffsets:
    def test_of_coordinate_systems(self, read):
        program = read("G21 G90 F600\nG0 X0 Y0 Z0\nG1 X10\nG59.3 X10 Y0 Z0\nM2\n")
        assert ends(program) == [[110, 50, -30], [17, 0, 0]]
        assert program.notes == NOTHING_ASSUMED

    def test_the_program_may_set_them_anew(self, read):
        program = read("G21 G90 F600\nG0 X0 Y0 Z0\nG10 L2 P1 X5\nG1 X10\nG1 X11\nM2\n")
        assert ends(program)[-1] == [16, 50, -30]

    def test_machine_coordinates_leave_them_out(self, read):
        program = read("G21 G90 F600\nG0 X0 Y0 Z0\nG53 G0 Z-1\nG1 X1\nM2\n")
        assert ends(program) == [[100, 50, -1], [101, 50, -1]]
        assert program.notes == NOTHING_ASSUMED

    def test_of_axes_that_turn_are_in_degrees(self, read):
        setup = "[program.offsets_deg]\nG54 = { A = 90 }\n"
        program = read("G21 G90 F600\nG0 X0 A0\nG1 X5 A10\nM2\n", setup=setup, limits=LIMITS + TURNING)
        assert program.end[-1, 3] == pytest.approx(100.0)


class TestHomes:
    def test_g28_and_g30_lead_there(self, read):
        program = read("G21 G90 F600\nG54 G0 X0 Y0 Z0\nG1 X1\nG28\nG1 X0\nG30\nG1 X0\nM2\n")
        assert ends(program) == [[101, 50, -30], [1, 0, 120], [100, 0, 120], [-25.4, 50.8, 0], [100, 50.8, 0]]
        assert program.notes == NOTHING_ASSUMED

    def test_where_the_file_says_nothing_0_is_taken_and_said(self, read):
        program = read("G21 G90 F600\nG0 X0 Y0 Z0\nG1 X1\nG28\nG30\nM2\n", setup="[program]\nhome_mm = { X = 0 }\n")
        assert program.notes == ("taken for 0, since the program does not say: the position of G30 (line 5)",)


class TestToolChanges:
    CHANGE = "G21 G90 F600\nG0 X0 Y0 Z0\nG1 X1\nT2 M6\nG0 X0 Z5\nG1 X1\nM2\n"

    def test_m6_is_a_rapid_to_the_place_in_its_axes_and_then_the_change(self, read):
        program = read(self.CHANGE)
        assert ends(program) == [[101, 50, -30], [-50, 50, 150], [100, 50, -25], [101, 50, -25]]
        assert program.kind.tolist() == [1, 0, 0, 1]
        assert [(e.kind, e.after_move) for e in program.events if e.kind == "tool_change"] == [("tool_change", 1)]

    def test_without_a_place_it_moves_nothing(self, read):
        program = read(self.CHANGE, setup="")
        assert program.kind.tolist() == [1, 0, 1]
        assert [(e.kind, e.after_move) for e in program.events if e.kind == "tool_change"] == [("tool_change", 0)]

    def test_a_change_before_all_moves_takes_no_time(self, read):
        """The machine stands there already, as at a home that comes first."""
        program = read("G21 G90 F600\nT1 M6\nG0 X0 Y0 Z0\nG1 X5\nM2\n")
        assert ends(program) == [[100, 50, -30], [105, 50, -30]]
        assert program.start[0, :3].tolist() == [-50, 50, 150]

    def test_m61_changes_nothing_but_the_number(self, read):
        program = read("G21 G90 F600\nG0 X0 Y0 Z0\nG1 X1\nM61 Q3\nG1 X2\nM2\n")
        assert ends(program) == [[101, 50, -30], [102, 50, -30]]

    @pytest.mark.parametrize("block", ["T2 M6 G0 X5", "T2 M6 G28", "T2 M6 X3"])
    def test_a_motion_beside_it_is_refused(self, read, block):
        with pytest.raises(
            InputError, match=r"part\.ngc:4: M6: M6 leads to the tool change position of the machine file"
        ):
            read(f"G21 G90 F600\nG0 X0 Y0 Z0\nG1 X1\n{block}\nM2\n")

    def test_axes_that_turn(self, read):
        setup = "[program]\ntool_change_deg = { A = 180 }\n"
        program = read(self.CHANGE, setup=setup, limits=LIMITS + TURNING)
        assert program.end[:, 3].tolist() == [180, 180, 180]
        assert program.axes == ("X", "Y", "Z", "A")


def test_tools_of_the_file_count_unless_others_are_given(read, machine, tmp_path):
    (tmp_path / "own.tbl").write_text("T1 Z40\n")
    (tmp_path / "other.tbl").write_text("T1 Z60\n")
    text = "G21 G90 F600\nG0 X0 Z0\nT1 M6\nG43\nG1 Z1\nM2\n"
    setup = '[program]\ntools = "own.tbl"\n'
    assert ends(read(text, setup=setup))[-1][2] == 41
    given = read_program(tmp_path / "part.ngc", tools=tmp_path / "other.tbl", setup=read_machine(machine(setup)).setup)
    assert ends(given)[-1][2] == 61


class TestJobs:
    @pytest.fixture
    def part(self, tmp_path):
        path = tmp_path / "part.ngc"
        path.write_text("G21 G90 F3000\nG0 X0 Y0 Z5\nG1 X20\nG1 Y20\nG28\nM2\n")
        return path

    def test_a_plan_goes_home_and_its_table_is_checked_with_the_same_file(self, machine, part, tmp_path):
        file = machine()
        found = plan_and_check(part, file, tolerance=0.01)
        assert found.ok
        assert found.samples.position[-1] == pytest.approx([1, 0, 120], abs=1e-6)
        write_table(tmp_path / "table.csv", found.profile, found.limits, report=found.report)
        for options in ({"machine": file}, {"setup": file}):
            job = load_job_of_table(tmp_path / "table.csv", part, **options)
            assert job.check(read_table(tmp_path / "table.csv", job.curve)).ok
        without = load_job_of_table(tmp_path / "table.csv", part)
        with pytest.raises(InputError, match=r"the table is for the curve part\.ngc .*, not for part\.ngc"):
            read_table(tmp_path / "table.csv", without.curve)

    def test_homes_take_time(self, machine, part):
        near = load_job(part, machine(SETUP.replace("Z = 120", "Z = -25")), tolerance=0.01)
        far = load_job(part, machine(), tolerance=0.01)
        flat = np.hypot(119, 70)  # from (120, 70, -25) to the home, without its height
        assert far.curve.length - near.curve.length == pytest.approx(np.hypot(flat, 145) - flat, abs=0.1)

    def test_linuxcnc_has_them_in_files_of_its_own(self, machine, part):
        with pytest.raises(
            InputError, match="which LinuxCNC takes from its own files; leave them out with its reader rs274"
        ):
            load_job(part, machine(), reader="rs274")


def test_without_a_table_all_is_as_before(read):
    program = read("G21 G90 F600\nG0 X0 Y0 Z0\nG1 X1\nM2\n", setup="")
    assert np.array_equal(program.end[:, :3], [[1, 0, 0]])
