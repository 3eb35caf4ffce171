"""The benchmark of the compiled core: its closed form, how it judges, and the command on small sizes."""

from __future__ import annotations

import json
import sys
from math import inf
from pathlib import Path

import numpy as np
import pytest
import ruckig
from cases import PROJECT

from benchmarks import core, corners, processes
from benchmarks.targets import Row, table
from planner import read_program


def ruckig_time(length):
    """The shortest time of a line along an axis, by another planner."""
    given, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    given.max_velocity, given.max_acceleration, given.max_jerk = [corners.FEED], [1000.0], [20_000.0]
    given.target_position = [length]
    assert ruckig.Ruckig(1).calculate(given, found) == ruckig.Result.Working
    return found.duration


class TestClosedForm:
    @pytest.mark.parametrize("length", [1e-3, 0.5, 4.99, 5.0, 5.01, 14.9, 15.0, 15.1, 20.0, 300.0])
    def test_a_leg_takes_as_long_as_ruckig_says(self, length):
        assert corners.rest_to_rest(length) == pytest.approx(ruckig_time(length), rel=1e-9)

    def test_the_raster_takes_as_long_as_was_published(self):
        assert corners.CLOSED_FORM.shortest_time == pytest.approx(3.0173224, abs=5e-8)

    def test_a_jog_too_short_for_it_is_refused(self):
        with pytest.raises(ValueError, match="first arc of constant jerk"):
            _ = corners.SWEPT.shortest_time

    def test_no_plan_is_faster(self):
        job = corners.CLOSED_FORM.load()
        plan = job.plan(intervals=2000)
        assert job.check(plan).ok
        assert corners.CLOSED_FORM.shortest_time < plan.duration < 1.001 * corners.CLOSED_FORM.shortest_time


class TestRaster:
    @pytest.mark.parametrize("pairs", [1, 2, 5])
    def test_has_the_corners_it_says(self, tmp_path, pairs):
        raster = corners.Raster(pairs)
        file = tmp_path / "raster.ngc"
        file.write_text(raster.program)
        program = read_program(file)
        assert len(program) == 2 * pairs == raster.corners + 1
        saved = 20.5 * pairs - raster.load().curve.length
        assert 0.01 < saved / raster.corners < 0.012  # mm, each corner cut by 0.01 mm

    def test_the_fewest_intervals_are_those_from_which_on_all_are_enough(self):
        found = [(10.0, 9e-4), (20.0, 4e-4), (40.0, 6e-4), (80.0, 3e-4), (160.0, 1e-4)]
        assert corners.intervals_needed(found, 5e-4) == 80.0
        assert corners.intervals_needed(found, 1e-4) == 160.0
        assert corners.intervals_needed(found, 1e-3) == 10.0
        assert corners.intervals_needed(found, 1e-5) == inf
        assert corners.intervals_needed([*found, (320.0, inf)], 5e-4) == inf

    def test_more_intervals_come_closer_to_the_optimum_and_not_below(self):
        (few, far), (many, close) = corners.sweep_intervals([60, 250])
        assert few < many
        assert -2e-6 < close < far < 0.01


class TestRow:
    def test_the_worst_case_must_reach_the_target(self):
        row = Row("what", 2.0, {"a": 1.0, "b": 3.0})
        assert row.reached is False
        assert row.text == "1 to 3 (b)"
        assert Row("what", 3.0, {"a": 1.0, "b": 3.0}).reached is True
        assert Row("what", 3.0, {"a": inf}).reached is False

    def test_what_was_not_measured_is_not_reached(self):
        row = Row("what", 2.0, {}, "needs --before")
        assert row.reached is None
        assert row.text == "needs --before"

    def test_the_table_has_earlier_figures_beside(self):
        page = table([Row("a", 2.0, {"x": 1.0}), Row("b", 2e-4, {"x": 1.0})], {"a": "7"})
        assert "| a | <= 2 | 1 | yes | 7 |" in page
        assert "| b | <= 0.0002 | 1 | **no** | - |" in page


SMALL = ["--repeats", "1", "--intervals", "60", "--cases", "teardrop 100,raster", "--pairs", "3", "--sweep", "60,80"]
SMALL += ["--only", "others,programs,nodes,durations"]


def test_the_command_writes_what_it_prints(tmp_path, capsys):
    file = tmp_path / "core.json"
    core.main([*SMALL, "--output", str(file)])
    printed = capsys.readouterr().out
    facts = json.loads(file.read_text())
    assert len(facts["rows"]) == 15
    for row in facts["rows"]:
        assert f"| {row['what']} | <= {row['target']:g} | {row['text']} |" in printed
    assert len({row["what"] for row in facts["rows"]}) == 15
    teardrop = facts["details"]["others"]["teardrop 100"]
    assert teardrop["verified_per_toppra"] == pytest.approx(
        (teardrop["plan_s"] + teardrop["check_s"]) / teardrop["toppra_s"]
    )
    times = facts["details"]["durations"]["teardrop 100"]
    # the optimum stands there as a plan on 16 000 intervals, to seven digits
    assert times["optimum_s"] * (1.0 - 1e-6) <= times["4000"] <= times["250"]
    assert facts["share_of_one_thread"] == pytest.approx(1.0, abs=0.05)
    core.main(["--only", "million", "--beside", str(file)])
    assert "needs --million | - | - |" in capsys.readouterr().out


def test_a_plan_that_fails_its_check_scores_no_time(monkeypatch):
    job = core.reference_job("teardrop 100")
    failed = core.Run(job.plan(intervals=60), 0.1, 0.1, ok=False)
    monkeypatch.setattr(core, "run_job", lambda *_, **__: failed)
    settings = core.Settings(1, intervals=60, cases=("teardrop 100",))
    rows, _ = core.others(settings)
    assert all(row.worst == inf for row in rows if row.measured)
    rows, _ = core.durations(settings)
    assert [row.worst for row in rows] == [inf, inf]


class TestProcesses:
    def test_a_start_is_that_of_an_installed_command(self, tmp_path):
        """Where pip puts it, with the bytecode that pip compiles, although this process may write none."""
        pytest.importorskip("hatchling", reason="builds a wheel")
        commands = processes.installed(processes.built_wheel(PROJECT, tmp_path), tmp_path / "new")
        where = "import planner; print(planner.__file__, planner.__cached__)"
        file, cached = processes._run([commands / "python", "-c", where], tmp_path).split()
        assert Path(file).is_relative_to(tmp_path / "new")
        assert Path(cached).exists()
        assert processes.children_cpu([commands / "feedplan", "plan", "circle", "--intervals", "60"]) > 0.0

    def test_a_failure_is_named(self, tmp_path):
        with pytest.raises(processes.AbsentError, match="ModuleNotFoundError: No module named 'absent'"):
            processes.run_python(["-c", "import absent"], tmp_path)

    def test_the_work_of_a_child_is_counted(self, tmp_path):
        busy = "from time import process_time\nwhile process_time() < 0.3: pass"
        assert 0.3 <= processes.children_cpu([sys.executable, "-c", busy]) < 1.0

    @pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
    def test_memory_is_that_of_this_process(self):
        before = processes.memory("VmRSS")
        held = np.ones(8_000_000)
        assert processes.memory("VmRSS") - before == pytest.approx(held.nbytes, rel=0.05)
        assert processes.memory("VmHWM") >= before + 0.95 * held.nbytes

    @pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
    def test_a_long_plan_is_measured_here_and_in_another_checkout(self):
        settings = core.Settings(before=PROJECT, million=500)
        (ratio, memory), found = core.million(settings)
        assert 0.1 < ratio.worst < 10.0
        assert memory.worst >= 0.0  # so short a plan may live in what the first one left
        assert found["here"][0]["peak_gb"] > 0.02
        assert found["here"][0]["duration_s"] == found["before"][0]["duration_s"]

    @pytest.mark.parametrize("group", ["million", "steps"])
    def test_a_checkout_that_does_not_run_is_a_row_without_a_number(self, tmp_path, monkeypatch, group):
        monkeypatch.setattr(core, "_TURNS", 1)
        row = core.GROUPS[group](core.Settings(before=tmp_path, million=500))[0][0]
        assert row.reached is None
        assert "no feedplan in" in row.text

    def test_bits_that_differ_from_the_replay_score_nothing(self, monkeypatch):
        run = {"step_ns": {"circle": 10.0}, "same_bits_as_replay": True}
        slow = run | {"step_ns": {"circle": 40.0}}
        monkeypatch.setattr(processes, "in_checkout", lambda *_: {})
        monkeypatch.setattr(processes, "in_turn", lambda *_: {"here": [run, run], "before": [slow, slow]})
        settings = core.Settings(before=PROJECT)
        assert core.steps(settings)[0][0].worst == 0.25
        run["same_bits_as_replay"] = False
        assert core.steps(settings)[0][0].worst == inf

    def test_steps_of_the_table_make_the_bits_of_the_replay(self):
        (row,), found = core.steps(core.Settings())
        assert row.reached is None
        (run,) = found["here"]
        assert run["same_bits_as_replay"] is True
        assert all(np.isfinite(time) and time > 0.0 for time in run["step_ns"].values())
