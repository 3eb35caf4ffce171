"""The one door: what a job does is what its steps do, one after the other, whatever names the curve and the machine."""

from __future__ import annotations

import ast
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cases import PROJECT

import feedplan
import interp
import planner
from feedplan.job import Job, load_job, load_job_of_table, plan_and_check
from feedplan.sources import PATH_SHARE
from feedplan.verdict_text import to_text
from planner import (
    InputError,
    Limits,
    SolverError,
    check,
    load_curve,
    load_limits,
    read_program,
    read_table,
    write_table,
)
from planner.programs.path.smooth_path import program_path

MILL = load_limits("mill")
SLOTS = PROJECT / "tests" / "data" / "programs" / "slots.ngc"
QUICK = {"intervals": 60}


@pytest.fixture(scope="module")
def verdict():
    return plan_and_check("teardrop", "mill", **QUICK)


class TestPlanAndCheck:
    def test_is_its_steps_one_after_the_other(self, verdict):
        curve = load_curve("teardrop")
        limits = MILL.for_curve(curve)
        profile = planner.plan_feedrate(curve, limits, **QUICK)
        samples = interp.replay(curve, profile, limits.period)
        for name in ("t", "u", "u_rate", "u_acceleration"):
            assert np.array_equal(getattr(verdict.profile, name), getattr(profile, name))
        assert np.array_equal(verdict.samples.position, samples.position)
        assert verdict.plan_report == check(curve, limits, profile)
        assert verdict.samples_report == check(curve, limits, samples)
        assert verdict.lower_bound == planner.certify(curve, limits, profile)
        assert verdict.planning_time > 0.0
        assert (verdict.machine, verdict.ok) == ("mill", True)

    def test_takes_a_curve_and_limits_as_well(self, verdict):
        found = plan_and_check(load_curve("teardrop"), MILL, bound=False, **QUICK)
        assert found.profile.duration == verdict.profile.duration
        assert found.machine == "limits given"
        # The bound that every plan carries is not the tight one.
        assert found.lower_bound < verdict.lower_bound

    def test_a_limit_that_cannot_be_kept_is_told(self):
        found = plan_and_check("teardrop", "mill", method="toppra", **QUICK)
        assert not found.ok
        assert "jerk" in {row.limit for row in found.samples_report.violations}

    def test_progress_is_told(self):
        told = []
        plan_and_check("teardrop", "mill", progress=lambda text, share: told.append(text), **QUICK)
        assert told[-3:] == ["bounding the time from below", "checking the plan", "checking the samples"]

    def test_a_plan_is_not_lost_for_want_of_a_bound(self, monkeypatch, tmp_path):
        def certify(*_args):
            raise SolverError("no")

        monkeypatch.setattr(planner, "certify", certify)
        job = load_job("teardrop", "mill")
        found = job.run(**QUICK)
        assert found.ok
        assert math.isnan(found.lower_bound)
        assert "no lower bound: no" in found.notes
        with pytest.raises(SolverError):
            job.run(certificate=tmp_path / "bound.npz", **QUICK)

    def test_a_certificate_is_written_and_verified(self, tmp_path):
        file = tmp_path / "bound.npz"
        found = load_job("teardrop", "mill").run(certificate=file, **QUICK)
        assert found.ok
        assert found.proof.ok
        assert feedplan.read_certificate(file).bound == found.profile.lower_bound


class TestLoadJob:
    def test_what_is_given_takes_the_place_of_the_machines(self):
        job = load_job("teardrop", MILL, scale=2.0, feed=33.0, period=2e-3)
        assert (job.limits.feed, job.limits.period, job.limits.axes) == (33.0, 2e-3, ("X", "Y"))
        assert job.curve.length == pytest.approx(2.0 * load_curve("teardrop").length, rel=1e-12)

    @pytest.mark.parametrize(("curve", "machine"), [("teardrop", "mill"), ("flank", "five-axis")])
    def test_without_a_machine_an_example_with_its_axes_counts(self, curve, machine):
        assert load_job(curve).machine == f"{machine} (example machine)"

    @pytest.mark.parametrize("share", [1.0, PATH_SHARE])
    def test_a_program_is_the_path_within_its_share(self, share):
        job = load_job(SLOTS, "mill", tolerance=0.02, share=share)
        path = program_path(read_program(SLOTS), share * 0.02, MILL)
        assert job.curve.fingerprint == path.curve.fingerprint
        assert job.path.tolerance == share * 0.02
        assert job.room == pytest.approx((1.0 - share) * 0.02, abs=1e-15)
        assert job.facts[0][0] == "program"
        profile = job.plan()
        assert job.line_times(profile).moving == pytest.approx(profile.duration, rel=1e-12)

    @pytest.mark.parametrize(
        ("source", "options", "said"),
        [
            ("teardrop", {"tolerance": 0.1}, "tolerance = 0.1 mm is for part programs and points; teardrop is exact"),
            (load_curve("teardrop"), {"tolerance": 0.1}, "teardrop is exact"),
            (load_curve("teardrop"), {"scale": 2.0}, "scale = 2.0 is not for teardrop; it must be 1"),
            (SLOTS, {"scale": 2.0}, "scale = 2.0 is not for"),
            (SLOTS, {"tolerance": 0.0}, "tolerance = 0.0 must be a number > 0"),
            ("teardrop", {"tools": "tool.tbl"}, "tools = 'tool.tbl' is for part programs, "),
            ("teardrop", {"ignore": ("A",)}, "ignore = ('A',) is for part programs, "),
            ("flank", {"machine": MILL}, "the machine has no axis A, which flank moves"),
        ],
    )
    def test_refuses_what_does_not_fit(self, source, options, said):
        with pytest.raises(InputError, match="^.*" + re.escape(said)):
            load_job(source, **options)

    def test_lines_are_those_of_a_program(self):
        job = load_job("teardrop")
        with pytest.raises(InputError, match="teardrop has no lines"):
            job.line_times(job.plan(**QUICK))


class TestDrawings:
    @pytest.fixture
    def drawing(self, tmp_path):
        """Two circles and a text."""
        import ezdxf

        document = ezdxf.new("R2010")
        document.header["$INSUNITS"] = 4
        space = document.modelspace()
        space.add_circle((0, 0), 5, dxfattribs={"layer": "outer"})
        space.add_circle((0, 0), 3, dxfattribs={"layer": "inner"})
        space.add_text("made by hand")
        document.saveas(tmp_path / "part.dxf")
        return tmp_path / "part.dxf"

    def test_a_chain_or_a_layer_is_chosen_and_said(self, drawing):
        by_number, by_layer = load_job(drawing, chain=2, scale=2.0), load_job(drawing, layer="inner")
        assert by_number.curve.length == pytest.approx(12 * math.pi, rel=1e-9)
        assert by_layer.curve.length == pytest.approx(6 * math.pi, rel=1e-9)
        assert by_layer.facts == ()
        said = dict(by_number.facts)["drawing"]
        assert said.startswith("chain 2 of 2: CIRCLE #")
        assert said.endswith(", closed, 37.7 mm, layer inner; not read: 1 TEXT")
        with pytest.raises(InputError, match="the drawing has 2 chains; choose one by its number"):
            load_job(drawing)

    def test_a_table_of_it_is_checked_with_the_same_choice(self, drawing, tmp_path):
        found = plan_and_check(drawing, "mill", chain=2, **QUICK)
        write_table(tmp_path / "table.csv", found.profile, found.limits)
        job = load_job_of_table(tmp_path / "table.csv", drawing, chain=2)
        assert job.check(planner.read_table(tmp_path / "table.csv", job.curve)).ok

    @pytest.mark.parametrize("source", ["teardrop", SLOTS, load_curve("circle")])
    def test_other_curves_have_no_chains(self, source):
        with pytest.raises(InputError, match=r"chain = 1 is for drawings, \.dxf; .* is none"):
            load_job(source, chain=1)
        with pytest.raises(InputError, match=r"layer = 'a' is for drawings"):
            load_job(source, layer="a")


class TestMachines:
    """What a machine file lacks is given beside it, and said."""

    @pytest.fixture
    def printer(self, tmp_path):
        path = tmp_path / "printer.cfg"
        path.write_text("[printer]\nmax_velocity: 100\nmax_accel: 1000\n")
        return path

    def test_what_is_given_counts_and_is_said(self, printer):
        bare = load_job("teardrop", printer)
        assert bare.machine == f"{printer} (no jerk limit on X Y Z)"
        job = load_job("teardrop", printer, complete={"jerk_mm_s3": 20000.0})
        assert job.machine == f"{printer} (jerk 20000 mm/s^3 given for X Y Z)"
        assert job.limits.jerk.tolist() == [20000.0, 20000.0]

    def test_it_counts_beside_a_table_too(self, printer, tmp_path, verdict):
        write_table(tmp_path / "table.csv", verdict.profile, verdict.limits)
        job = load_job_of_table(tmp_path / "table.csv", "teardrop", printer, complete={"jerk_mm_s3": 9.0})
        assert job.limits.jerk.tolist() == [9.0, 9.0]

    def test_only_a_file_is_completed(self, tmp_path, verdict):
        write_table(tmp_path / "table.csv", verdict.profile, verdict.limits)
        given = {"jerk_mm_s3": 9.0}
        with pytest.raises(InputError, match="jerk_mm_s3: completes a machine file; limits are given whole"):
            load_job("teardrop", verdict.limits, complete=given)
        with pytest.raises(InputError, match=r"the limits are those of .*table\.csv"):
            load_job_of_table(tmp_path / "table.csv", "teardrop", complete=given)
        with pytest.raises(InputError, match="mill: jerk_mm_s3 = 9 completes what the file lacks, but it has jerk of"):
            load_job("teardrop", complete=given)


class TestLoadJobOfTable:
    @pytest.mark.parametrize("source", ["teardrop", load_curve("teardrop")], ids=["name", "curve"])
    def test_the_tables_own_limits_count(self, tmp_path, verdict, source):
        file = tmp_path / "table.csv"
        write_table(file, verdict.profile, verdict.limits)
        job = load_job_of_table(file, source)
        assert job.machine == f"limits in {file}"
        assert job.judge(planner.read_table(file, job.curve)).ok
        slow = load_job_of_table(file, source, Limits(10.0, [250.0] * 2, [1e3] * 2, [2e4] * 2))
        assert not slow.judge(planner.read_table(file, job.curve)).ok

    def test_a_program_is_made_into_the_same_path_again(self, tmp_path):
        file = tmp_path / "table.csv"
        job = load_job(SLOTS, "mill", tolerance=0.02, share=PATH_SHARE)
        write_table(file, job.plan(), job.limits)
        again = load_job_of_table(file, SLOTS)
        assert again.curve.fingerprint == job.curve.fingerprint
        assert again.room == job.room


class TestTheDoor:
    """``import feedplan`` is enough, and says the same to a type checker."""

    def test_has_every_public_name(self):
        assert {*planner.__all__, *interp.__all__} <= set(feedplan.__all__)
        assert feedplan.__all__ == sorted(feedplan.__all__, key=lambda name: (not name.isupper(), name))
        for name in feedplan.__all__:
            assert getattr(feedplan, name) is not None

    def test_a_type_checker_sees_the_same_names(self):
        tree = ast.parse(Path(feedplan.__file__).read_text(encoding="utf-8"))
        blocks = [node for node in tree.body if isinstance(node, ast.If)]
        seen = [alias.name for node in ast.walk(blocks[0]) if isinstance(node, ast.ImportFrom) for alias in node.names]
        assert sorted(seen) == sorted(feedplan.__all__)

    def test_no_step_stands_in_a_second_place(self):
        """Who wants to replay or check a plan asks the job."""
        homes = {"job.py"}
        for file in sorted((PROJECT / "feedplan").rglob("*.py")):
            calls = [node.func for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call)]
            names = {func.id for func in calls if isinstance(func, ast.Name)}
            names |= {f"{func.value.id}.{func.attr}" for func in calls
                      if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name)}  # fmt: skip
            found = names & {"check", "replay", "interp.replay", "planner.check", "plan_feedrate", "certify"}
            assert not found or file.name in homes, f"{file.name}: {found}"

    def test_runs_as_a_module(self):
        run = [sys.executable, "-m", "feedplan", "--version"]
        out = subprocess.run(run, cwd=PROJECT, capture_output=True, text=True, check=True).stdout
        assert out == f"feedplan {feedplan.__version__}\n"


def test_a_job_is_frozen():
    job = load_job("teardrop")
    with pytest.raises(AttributeError):
        job.room = 1.0
    assert isinstance(job, Job)


@pytest.fixture(scope="module")
def reserved():
    return plan_and_check("teardrop", "mill", override_reserve=0.1)


class TestOverrideReserve:
    def test_the_plan_uses_what_is_left_and_is_checked_against_the_whole(self, reserved):
        assert reserved.ok
        assert reserved.limits.jerk.tolist() == [20000.0, 20000.0]
        jerk = [row.ratio for row in reserved.plan_report.rows if row.limit == "jerk"]
        assert 0.8 < max(jerk) <= 0.9 * (1.0 + 1e-6)
        assert reserved.profile.origin.override_reserve == 0.1

    def test_the_verdict_says_what_it_costs(self, reserved):
        plain = plan_and_check("teardrop", "mill")
        assert reserved.reserve.without == plain.profile.duration
        assert reserved.profile.duration > plain.profile.duration
        assert reserved.reserve.stop_time < 0.7
        assert reserved.lower_bound == pytest.approx(plain.lower_bound)
        assert plain.reserve is None

    @pytest.mark.parametrize("moves", ["G1 X50\nX20\nX60\nX0", "G1 X50\nX10 Y0.01\nX60 Y0.02\nX0 Y1\nX50 Y1\nX50 Y0"])
    def test_a_path_that_turns_back_in_motion(self, tmp_path, moves):
        """Without the reserve its path has no such plan: others stop there, and their bounds are none of this one."""
        (tmp_path / "turns.ngc").write_text(f"G21 G90 G94 F6000 G64 P0.05\nG0 X0 Y0\n{moves}\nM2\n", encoding="utf-8")
        verdict = plan_and_check(tmp_path / "turns.ngc", "mill", override_reserve=0.1)
        assert verdict.ok
        assert not verdict.lower_bound > verdict.profile.duration
        assert np.isnan(verdict.reserve.without)
        assert verdict.reserve.stop_time < 0.7
        assert "what that costs is not known" in " ".join(" ".join(to_text(verdict)).split())

    def test_a_table_remembers_it(self, reserved, tmp_path):
        from feedplan.job import load_job_of_table
        from planner import write_table

        write_table(tmp_path / "t.csv", reserved.profile, reserved.limits)
        job = load_job_of_table(tmp_path / "t.csv", "teardrop")
        found = read_table(tmp_path / "t.csv", job.curve)
        assert job.override_reserve == found.origin.override_reserve == 0.1
        assert job.limits == reserved.limits
        assert found.limits == reserved.profile.limits
        assert job.judge(found).ok

    def test_a_reserve_that_is_none_is_refused_before_anything_is_planned(self):
        with pytest.raises(InputError, match="override_reserve"):
            plan_and_check("teardrop", "mill", override_reserve=0.7)
