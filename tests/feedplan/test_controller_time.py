"""Times of a part program on other controllers: values, text, JSON, and what is refused."""

from __future__ import annotations

import json
import math
import pickle

import pytest
from cases import PROGRAMS

from feedplan.controller_time import chosen_controllers, controller_times
from planner import InputError
from planner.controllers.known import CONTROLLERS

PRINTER = "[printer]\nmax_velocity: 100\nmax_accel: 1000\nsquare_corner_velocity: 10\n"
GRBL = "$11=0.02\n" + "".join(f"$11{k}=6000\n$12{k}=1000\n" for k in range(3))
LINES = "G21 G90\nG1 X50 F3000\nG4 P0.5\nX0\nM2\n"  # two lines of 50 mm at 50 mm/s, a stop between
LEG = 50 / 50 + 50 / 1000


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "printer.cfg").write_text(PRINTER)
    (tmp_path / "grbl.txt").write_text(GRBL)
    (tmp_path / "part.ngc").write_text(LINES)
    (tmp_path / "turn.ngc").write_text("G21 G1 X10 A30 F600\nM2\n")
    return tmp_path


def times(folder, machine, names, settings=(), part="part.ngc", **options):
    return controller_times(folder / part, folder / machine, chosen_controllers(names, settings), **options)


class TestTimes:
    @pytest.mark.parametrize("machine", ["printer.cfg", "grbl.txt"])
    def test_two_lines(self, folder, machine):
        found = times(folder, machine, ["klipper,grbl"])
        assert [row.controller for row in found] == ["klipper", "grbl"]
        for row in found:
            assert row.motion_s == pytest.approx(2 * LEG)
            assert row.line_s == pytest.approx({2: LEG, 4: LEG})

    def test_the_example_machine(self):
        """What Kalico takes at 100 mm/s and 1000 mm/s^2 (benchmarks/controllers)."""
        (row,) = controller_times(PROGRAMS / "zigzag.ngc", "mill", {"klipper": {}})
        assert row.motion_s == pytest.approx(11.434804, abs=1e-6)
        assert math.fsum(row.line_s.values()) == pytest.approx(row.motion_s)

    def test_settings_of_the_file_and_given(self, folder):
        (row,) = times(folder, "printer.cfg", ["klipper"], ["minimum_cruise_ratio=0.25"])
        assert row.settings == (
            ("square_corner_velocity_mm_s", 10.0, "of the machine file"),
            ("minimum_cruise_ratio", 0.25, "given"),
            ("arc_resolution_mm", 1.0, "the controller's default"),
        )

    @pytest.mark.parametrize("machine", ["printer.cfg", "grbl.txt"])
    def test_a_feed_in_place_of_the_machine_s(self, folder, machine):
        for row in times(folder, machine, ["klipper", "grbl"], feed=20.0):
            assert row.motion_s == pytest.approx(2 * (50 / 20 + 20 / 1000))

    def test_a_raised_corner_speed_is_faster(self):
        slow, fast = (
            controller_times(PROGRAMS / "zigzag.ngc", "mill", {"grbl": {"junction_deviation_mm": d}})[0].motion_s
            for d in (0.001, 0.1)
        )
        assert fast < slow

    def test_what_a_controller_cannot_run_has_a_reason(self, folder):
        found = controller_times(folder / "turn.ngc", "four-axis", {"klipper": {}, "grbl": {}})
        for row in found:
            assert math.isnan(row.motion_s)
            assert row.refused.startswith("turn.ngc:1: A: the model of ")

    def test_it_can_be_sent_elsewhere(self, folder):
        found = times(folder, "grbl.txt", ["all"])
        assert pickle.loads(pickle.dumps(found)) == found


class TestChoice:
    def test_all(self):
        assert list(chosen_controllers(["all"], [])) == list(CONTROLLERS)

    def test_a_setting_goes_to_those_that_have_it(self):
        found = chosen_controllers(
            ["klipper,grbl", "klipper"], ["junction_deviation_mm=0.02", "arc_resolution_mm = 0.5"]
        )
        assert found == {"klipper": {"arc_resolution_mm": 0.5}, "grbl": {"junction_deviation_mm": 0.02}}

    @pytest.mark.parametrize(
        ("names", "settings", "message"),
        [
            (["fanuc"], [], "controller 'fanuc' must be one of klipper, grbl"),
            (["klipper,"], [], "controller '' must be one of"),
            (["grbl"], ["junction_deviation_mm"], "must be KEY=VALUE with a number, such as junction_deviation_mm=1"),
            (["grbl"], ["junction_deviation_mm=small"], "must be KEY=VALUE"),
            (["grbl"], ["square_corner_velocity_mm_s=5"], "grbl has none; there are junction_deviation_mm, "),
            ([], ["junction_deviation_mm=0.1"], "'junction_deviation_mm=0.1' needs the controller that it is for"),
        ],
    )
    def test_refused(self, names, settings, message):
        with pytest.raises(InputError, match=message):
            chosen_controllers(names, settings)

    def test_a_value_that_is_none(self, folder):
        with pytest.raises(InputError, match=r"junction_deviation = -1\.0 must be a number >= 0"):
            times(folder, "grbl.txt", ["grbl"], ["junction_deviation_mm=-1"])


class TestCommand:
    def test_text(self, run, folder):
        code, out, _ = run("time", folder / "part.ngc", "--machine", folder / "grbl.txt", "--controller", "grbl")
        assert code == 0
        row = next(line.split() for line in out.splitlines() if line.startswith("grbl "))
        assert row == ["grbl", "0:00:03", "2.1", "1.000"]  # 2.1 s of motion, 0.5 s of dwell
        flat = " ".join(out.split())
        assert "junction_deviation_mm 0.02, of the machine file" in flat
        assert CONTROLLERS["grbl"].measured in flat

    def test_json(self, run, folder):
        code, out, _ = run(
            "time", folder / "part.ngc", "--machine", folder / "grbl.txt", "--controller", "all", "--json",
            "--controller-setting", "planner_blocks=31",
        )  # fmt: skip
        assert code == 0
        facts = {row["controller"]: row for row in json.loads(out)["controllers"]}
        assert list(facts) == list(CONTROLLERS)
        grbl = facts["grbl"]
        assert grbl["total_s"] == pytest.approx(2 * LEG + 0.5)
        assert grbl["times_the_plan"] == pytest.approx(1.0, rel=1e-4)
        assert [row["line"] for row in grbl["lines"]] == [2, 4]
        assert {"key": "planner_blocks", "value": 31.0, "from": "given"} in grbl["settings"]
        assert grbl["refused"] is None

    def test_a_program_that_it_cannot_run(self, run, folder):
        code, out, _ = run("time", folder / "turn.ngc", "--machine", "four-axis", "--controller", "klipper")
        assert code == 0
        flat = " ".join(out.split())
        assert "klipper cannot run it: turn.ngc:1: A: the model of klipper is of X Y Z" in flat

    def test_an_unknown_one_is_told_before_anything_is_planned(self, run, folder):
        code, out, err = run("time", folder / "part.ngc", "--controller", "marlin")
        assert (code, out) == (2, "")
        assert "controller 'marlin' must be one of klipper, grbl" in " ".join(err.split())


class TestCompareCommand:
    def test_rows_of_a_program(self, run, folder):
        code, out, _ = run(
            "compare", folder / "part.ngc", "--machine", folder / "grbl.txt", "--jerk-mm-s3", "1e6",
            "--methods", "optimal", "--controller", "grbl,klipper",
        )  # fmt: skip
        assert code == 0
        rows = {line.split()[0]: line.split() for line in out.splitlines() if line.startswith(("grbl ", "klipper "))}
        assert set(rows) == {"grbl", "klipper"}
        flat = " ".join(out.split())
        assert CONTROLLERS["klipper"].measured in flat
        assert "grbl, the model of a controller, leaves the program by" in flat

    def test_all_of_them_where_nothing_is_named(self, run, folder):
        code, out, _ = run("compare", folder / "part.ngc", "--machine", folder / "grbl.txt", "--json")
        assert code == 0
        assert [row["method"] for row in json.loads(out)["methods"]][-len(CONTROLLERS) :] == list(CONTROLLERS)

    def test_a_curve_has_no_controller(self, run):
        code, out, err = run("compare", "teardrop", "--machine", "mill", "--controller", "grbl")
        assert (code, out) == (2, "")
        assert "--controller is for part programs; teardrop is none" in " ".join(err.split())
