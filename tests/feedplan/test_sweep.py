"""What if: every combination once, its base first, and what each saves."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import click
import numpy as np
import pytest

from feedplan.batch_times import CaseTime, NamedMachine, TimeRow, TimeRows, TimingCase, time_programs
from feedplan.local_processes import LocalProcesses
from feedplan.program_files import ProgramFile, find_programs
from feedplan.program_time import time_program
from feedplan.sweep import name_machines, read_numbers, read_scale, sweep_cases, sweep_facts, sweep_text
from planner.errors import InfeasibleError, InputError
from planner.machine.limits import Limits
from planner.machine.machine_file import read_machine
from planner.machine.machine_table import Machine

FILES = [ProgramFile(Path(name), name) for name in ("a.ngc", "b.ngc")]
MILL = NamedMachine("mill", read_machine("mill"))
FOUR = NamedMachine("four-axis", read_machine("four-axis"))


class TestScales:
    def test_are_a_limit_and_its_factors(self):
        scale = read_scale("jerk=1, 2,4")
        assert (scale.name, scale.key, scale.axis, scale.factors) == ("jerk", "jerk", "", (1.0, 2.0, 4.0))
        scale = read_scale("acceleration.x=1.5")
        assert (scale.name, scale.key, scale.axis, scale.factors) == ("acceleration.X", "acceleration", "X", (1.5,))

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("jerk", "must be a limit and its factors"),
            ("period=2", "must be a limit and its factors"),
            ("jerk.=2", "must be a limit and its factors"),
            ("jerk=", '"" must be a number > 0'),
            ("jerk=1,x", '"x" must be a number > 0'),
            ("jerk=-1", '"-1" must be a number > 0'),
            ("jerk=0", '"0" must be a number > 0'),
            ("jerk=nan", '"nan" must be a number > 0'),
            ("jerk=inf", "must be finite"),
            ("jerk=1,2,1", "1 is given twice"),
        ],
    )
    def test_that_are_none_say_what_is_allowed(self, text, said):
        with pytest.raises(InputError) as error:
            read_scale(text)
        assert said in str(error.value)
        assert text.partition("=")[0] in str(error.value)

    def test_multiply_one_limit_and_no_other(self):
        limits = MILL.machine.limits
        cases = sweep_cases(
            FILES[:1], [MILL], (), [read_scale("acceleration.Y=3"), read_scale("jerk=2"), read_scale("feed=5")]
        )
        base, found = (case.machine.machine.limits for case in cases)
        assert base == limits
        np.testing.assert_array_equal(found.acceleration, limits.acceleration * [1.0, 3.0, 1.0])
        np.testing.assert_array_equal(found.jerk, 2.0 * limits.jerk)
        np.testing.assert_array_equal(found.velocity, limits.velocity)
        assert (found.feed, found.chord_error, found.period) == (5.0 * limits.feed, limits.chord_error, limits.period)

    def test_of_what_no_machine_limits_are_refused(self):
        loose = NamedMachine("loose", Machine(Limits(100, [100, 100], [1000, 1000], [np.inf, np.inf], axes="XY")))
        with pytest.raises(InputError, match="--scale jerk: there is no such limit on loose, so its factor"):
            sweep_cases(FILES, [loose], (), [read_scale("jerk=2")])
        assert len(sweep_cases(FILES[:1], [loose, MILL], (), [read_scale("jerk=1,2")])) == 4
        with pytest.raises(
            InputError, match=r"--scale jerk\.Z: loose: jerk\.Z: the machine has no such limit; its axes are X, Y"
        ):
            sweep_cases(FILES, [loose], (), [read_scale("jerk.Z=2")])
        with pytest.raises(InputError, match=r"feed\.X: the machine has no such limit; it is one of the path"):
            sweep_cases(FILES, [MILL], (), [read_scale("feed.X=2")])

    def test_of_one_limit_are_given_at_once(self):
        with pytest.raises(InputError, match="--scale jerk: is given twice"):
            sweep_cases(FILES, [MILL], (), [read_scale("jerk=2"), read_scale("jerk=4")])


class TestCombinations:
    def test_are_each_there_once_after_the_base(self):
        scales = [read_scale("jerk=2,4"), read_scale("acceleration.X=1,1.5")]
        cases = sweep_cases(FILES, [MILL, FOUR], [0.01, 0.05], scales)
        assert len({case.key for case in cases}) == len(cases) == 2 * (1 + 2 * 2 * 4)
        for file in FILES:
            first, *others = [case for case in cases if case.file is file]
            assert (first.machine.label, first.tolerance) == ("mill", 0.01)
            assert dict(first.scales) == {"jerk": 1.0, "acceleration.X": 1.0}
            found = [(c.machine.label, c.tolerance, *(factor for _, factor in c.scales)) for c in others]
            assert found == list(product(("mill", "four-axis"), (0.01, 0.05), (2.0, 4.0), (1.0, 1.5)))

    def test_have_the_base_among_them_once(self):
        cases = sweep_cases(FILES[:1], [MILL], (), [read_scale("jerk=2,1,4")])
        assert [dict(case.scales)["jerk"] for case in cases] == [1.0, 2.0, 4.0]
        assert [case.tolerance for case in cases] == [None] * 3

    def test_name_machines_of_one_file_name_apart(self):
        found = name_machines(["old/mill.toml", "new/mill.toml", "mill"], [MILL.machine] * 3)
        assert [machine.label for machine in found] == ["old/mill.toml", "new/mill.toml", "mill"]
        with pytest.raises(InputError, match="--machine mill: is given twice"):
            name_machines(["mill", "mill"], [MILL.machine] * 2)


def test_numbers_are_read_once_each():
    assert read_numbers("0.01,0.05", "--tolerance-mm") == (0.01, 0.05)
    with pytest.raises(InputError, match='--tolerance-mm: "a" must be a number > 0'):
        read_numbers("a", "--tolerance-mm")


def test_the_rows_are_the_times_on_each_machine_of_its_own(tmp_path):
    """Scaled limits are those of a machine that has them in its file."""
    part = tmp_path / "part.ngc"
    part.write_text("G21 G90 G0 X0 Y0\nF6000\nG1 X10\nY15\nM2\n")
    files, _ = find_programs([str(part)])
    cases = sweep_cases(files, [MILL], [0.02], [read_scale("acceleration=1,2")])
    with LocalProcesses(1) as pool:
        found = time_programs(cases, pool)
    for row, factor in zip(found.rows, (1.0, 2.0), strict=True):
        own = MILL.machine.limits
        limits = Limits(own.feed, own.velocity, factor * own.acceleration, own.jerk, own.chord_error, own.period)
        assert row.time.motion_s == pytest.approx(time_program(part, limits, tolerance=0.02).motion_s, rel=1e-12)
    base, faster = sweep_facts(found)
    assert (base["saved_s"], base["scale_acceleration"], faster["scale_acceleration"]) == (0.0, 1.0, 2.0)
    assert faster["saved_s"] == found.rows[0].total_s - found.rows[1].total_s > 0.0


def test_a_person_reads_what_each_saves_against_the_base_of_its_program():
    def row(file, factor, total):
        case = TimingCase(file, MILL, 0.01, (("jerk", factor),))
        time = None if total is None else CaseTime(total, 0.0, 0, None, total, "jerk X", 0.5, "")
        return TimeRow(case, time, None if time else InfeasibleError("no feed keeps the limits"))

    first, second = FILES
    rows = (
        row(first, 1.0, 10.0),
        row(first, 2.0, 8.0),
        row(first, 4.0, None),
        row(second, 1.0, None),
        row(second, 2.0, 5.0),
    )
    lines = [" ".join(click.unstyle(line).split()) for line in sweep_text(TimeRows(rows), ["a note"], "out.csv")]
    assert lines[:8] == [
        "total saves saves",
        "program change s s % held back by share verdict",
        "a.ngc none 10.000 base base jerk X 50% ok",
        "a.ngc jerk x 2 8.000 2.000 20.0 jerk X 50% ok",
        "a.ngc jerk x 4 no plan",
        "b.ngc none base base no plan",
        "b.ngc jerk x 2 5.000 jerk X 50% ok",
        "",
    ]
    text = " ".join(lines)
    assert "of each program: mill, 10 um, every limit as the machine has it" in text
    assert "a.ngc on mill within 10 um, jerk x 4: no feed keeps the limits" in text
    assert "note a note" in text
    assert "written out.csv" in text
    assert [facts["saved_s"] for facts in sweep_facts(TimeRows(rows))] == [0.0, 2.0, None, None, None]
