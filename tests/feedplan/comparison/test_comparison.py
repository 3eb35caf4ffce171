"""The comparison of methods: who breaks what, how slow each must run, and what the command prints and writes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from feedplan.comparison import Comparison, compare, run_method
from feedplan.comparison.controller_rows import with_controllers
from feedplan.comparison.judgement import dilation, judge, least_dilation, letters, slowed_plan, worst_ratios
from feedplan.comparison.methods import METHODS, select_methods
from feedplan.comparison.result import result_facts, saving
from feedplan.comparison.two_paths import joint_saving, with_other_path
from feedplan.job import load_job
from planner import Limits, check, load_curve, load_limits
from planner.errors import InfeasibleError, InputError, SolverError

CHOSEN = ("algorithm-1", "algorithm-2-soft", "2002-bell-1", "2007-uniform", "toppra", "scurve", "optimal")
KEEPING = {"scurve", "optimal"}


@pytest.fixture(scope="module")
def teardrop():
    """Curve, limits and results by name."""
    curve = load_curve("teardrop")
    limits = load_limits("mill").for_curve(curve)
    return curve, limits, {result.method: result for result in compare(curve, limits, CHOSEN).results}


def held_differences(samples, order, period):
    """|n-th difference| over period^n of every axis, the ends held: what drives at rest see."""
    padded = np.pad(samples.position, [(3, 3), (0, 0)], mode="edge")
    return np.abs(np.diff(padded, order, axis=0)).max(axis=0) / period**order


class TestNumbers:
    @pytest.mark.parametrize("method", ["algorithm-1", "algorithm-2-soft", "2002-bell-1", "2007-uniform"])
    def test_ratios_are_differences_of_the_samples(self, teardrop, method):
        _, limits, results = teardrop
        result = results[method]
        for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
            found = held_differences(result.motion.samples, order, limits.period) / getattr(limits, name)
            assert result.judgement.ratios[name] == pytest.approx(found.max(), rel=1e-9)

    @pytest.mark.parametrize("method", CHOSEN)
    def test_time_is_that_of_the_samples(self, teardrop, method):
        _, limits, results = teardrop
        result = results[method]
        last = (result.points - 1) * limits.period
        assert last - limits.period < result.duration <= last + 1e-9
        assert result.motion.samples.t.size == result.points

    def test_a_plan_is_judged_between_its_samples_too(self, teardrop):
        curve, limits, results = teardrop
        for method in ("toppra", "scurve", "optimal"):
            motion = results[method].motion
            rows = [*check(curve, limits, motion.profile).rows, *check(curve, limits, motion.samples).rows]
            worst = max(row.ratio for row in rows if row.limit == "acceleration")
            assert results[method].judgement.ratios["acceleration"] == worst
            assert results[method].ok == all(row.ok for row in rows)

    def test_who_breaks_a_limit_is_shown_as_breaking_it(self, teardrop):
        _, _, results = teardrop
        assert {name for name, result in results.items() if result.ok} == KEEPING
        assert letters(results["optimal"].judgement) == "nothing"
        assert "J" in letters(results["toppra"].judgement)
        # Algorithm 1 runs at the command feed: it takes the axes' acceleration for granted.
        broken = {row.limit: row for row in results["algorithm-1"].judgement.broken}
        assert {"acceleration", "jerk"} <= set(broken)
        assert "chord error" not in broken
        assert all(row.worst > row.allowed for row in broken.values())

    def test_chord_error_beyond_its_tolerance_is_found(self):
        curve = load_curve("teardrop")
        tight = Limits(20.0, [30.0] * 2, [30.0] * 2, [200.0] * 2, chord_error=1e-6)
        first, third = compare(curve, tight, ["algorithm-1", "algorithm-3"]).results
        # Length^2 curvature / 8 where the teardrop is sharpest: radius 10.947321 mm.
        assert first.chord_error == pytest.approx(0.02**2 / 8.0 / 10.947321, rel=1e-3)
        assert "C" in letters(first.judgement)
        assert "C" not in letters(third.judgement)
        assert third.chord_error <= 1e-6 * (1.0 + 1e-6)

    def test_fluctuation_of_a_first_order_step(self, teardrop):
        _, _, results = teardrop
        motion = results["2002-bell-1"].motion
        chords = np.linalg.norm(np.diff(motion.samples.position, axis=0), axis=1)[:-1]
        fast = motion.commanded[:-1] > 1.0
        apart = np.abs(chords[fast] / (motion.commanded[:-1][fast] * motion.samples.period) - 1.0)
        assert results["2002-bell-1"].fluctuation == pytest.approx(apart.max(), rel=1e-3)
        assert results["optimal"].fluctuation < 1e-9

    def test_steady_feed_of_a_circle_is_where_the_normal_acceleration_is_used_up(self):
        limits = load_limits("mill").for_curve(load_curve("circle")).with_feed(300.0)
        (result,) = compare(load_curve("circle"), limits, ["2002-bell-steady"]).results
        # Radius 50 mm, 1000 mm/s^2; the jerk would allow cbrt(20000 x 50^2) = 368 mm/s.
        assert result.motion.commanded.max() == pytest.approx(np.sqrt(1000.0 * 50.0), rel=1e-6)


class TestDilation:
    def test_least_factor(self):
        none = dict.fromkeys(worst_ratios(()), 0.0)
        assert least_dilation(none) == 1.0
        for name, ratio, factor in (("velocity", 3.0, 3.0), ("acceleration", 4.0, 2.0), ("jerk", 27.0, 3.0)):
            assert least_dilation(none | {name: ratio}) == pytest.approx(factor)
        assert least_dilation(none | {"chord error": 9.0, "jerk": 8.0, "feed": 0.5}) == pytest.approx(3.0)

    @pytest.mark.parametrize("method", ["algorithm-1", "algorithm-2-soft", "2002-bell-1", "2007-uniform"])
    def test_slowed_samples_keep_every_limit_and_faster_ones_do_not(self, teardrop, method):
        _, limits, results = teardrop
        result = results[method]
        found = result.judgement.dilation
        assert found.confirmed
        assert found.duration == pytest.approx(found.factor * result.duration)
        used = []
        for factor in (found.factor, 0.999 * found.factor):
            shares = []
            for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
                values = held_differences(result.motion.samples, order, factor * limits.period)
                shares.append((values / getattr(limits, name)).max())
            used.append(max(shares))
        assert used[0] <= 1.0 + 1e-6
        assert used[1] > 1.0 + 1e-6

    def test_a_plan_is_slowed_between_its_samples(self, teardrop):
        curve, limits, results = teardrop
        found = results["toppra"].judgement.dilation
        assert found.confirmed
        profile = results["toppra"].motion.profile
        slowed = slowed_plan(profile, found.factor)
        report = check(curve, limits.with_period(found.factor * limits.period), slowed)
        # A step of the acceleration stays one, however slow: only what a drive sees of it falls.
        assert {row.limit for row in report.violations} == {"step on a smooth path"}
        assert next(row for row in report.rows if row.limit == "acceleration step").ok
        faster = check(
            curve, limits.with_period(0.999 * found.factor * limits.period), slowed_plan(profile, 0.999 * found.factor)
        )
        assert not all(row.ok for row in faster.rows if row.limit != "step on a smooth path")

    def test_what_keeps_every_limit_needs_no_factor(self, teardrop):
        _, _, results = teardrop
        for method in KEEPING:
            assert results[method].judgement.dilation.factor == 1.0
            assert results[method].judgement.dilation.duration == results[method].duration

    def test_the_optimum_run_faster_breaks_a_limit(self, teardrop):
        curve, limits, results = teardrop
        samples = results["optimal"].motion.samples
        period = 0.995 * samples.period
        faster = replace(samples, period=period, t=period * np.arange(samples.t.size))
        motion = replace(results["optimal"].motion, samples=faster, profile=None)
        _, judgement = judge(curve, limits, motion)
        assert judgement.broken

    def test_long_chords_are_cured_by_more_points(self):
        curve = load_curve("snailshell")
        tight = Limits(20.0, [30.0] * 2, [1e6] * 2, [1e12] * 2, chord_error=1e-6)
        (result,) = compare(curve, tight, ["algorithm-1"]).results
        assert [row.limit for row in result.judgement.broken] == ["chord error"]
        found = result.judgement.dilation
        assert found.confirmed
        # The chord error falls with the square of the factor, where chords are short.
        assert found.factor == pytest.approx(np.sqrt(result.chord_error / 1e-6), rel=0.05)

    def test_gives_up_on_what_does_not_depend_on_time(self, teardrop):
        curve, limits, results = teardrop
        motion = results["2002-bell-1"].motion
        position = motion.samples.position.copy()
        position[500] += 1.0  # a point off the path
        motion = replace(motion, samples=replace(motion.samples, position=position))
        rows, judgement = judge(curve, limits, motion)
        assert "path error" in {row.limit for row in rows if not row.ok}
        assert letters(judgement).endswith("?")
        assert not dilation(curve, limits, motion, judgement.ratios).confirmed


class TestSaving:
    def test_counts_only_who_breaks_nothing(self, teardrop):
        _, _, results = teardrop
        found = saving(list(results.values()))
        optimum, scurve = results["optimal"].duration, results["scurve"].duration
        assert found.optimum == optimum
        assert found.rival == "scurve"
        assert found.share == pytest.approx(1.0 - optimum / scurve)
        assert found.slowed_duration == min(
            result.judgement.dilation.duration for name, result in results.items() if name != "optimal"
        )
        # Faster ones are there, but they break limits.
        assert min(result.duration for result in results.values()) < optimum

    def test_there_is_none_without_an_optimum(self, teardrop):
        _, _, results = teardrop
        assert saving([results["scurve"]]) is None

    def test_there_may_be_no_rival(self, teardrop):
        _, _, results = teardrop
        found = saving([results["algorithm-1"], results["optimal"]])
        assert found.rival == ""
        assert found.slowed_rival == "algorithm-1"


class TestComparison:
    """The result of ``compare`` is a table of its methods."""

    @pytest.fixture
    def found(self, teardrop):
        curve, limits, results = teardrop
        return Comparison(curve, limits, tuple(results.values()))

    def test_has_a_result_by_name(self, found):
        assert found["optimal"] is found.results[-1]
        with pytest.raises(InputError, match="method 'nlp' was not compared; there are algorithm-1, "):
            _ = found["nlp"]

    def test_is_a_table_of_what_the_command_writes(self, found):
        frame = found.to_frame()
        assert list(frame["method"]) == list(CHOSEN)
        assert list(frame["machining_time_s"]) == [result.duration for result in found.results]
        assert frame["breaks"][0] == ", ".join(row.limit for row in found.results[0].judgement.broken)
        assert frame["jerk_ratio"].dtype == float
        pd.testing.assert_frame_equal(pd.DataFrame(found), frame)

    def test_is_told_in_two_lines(self, found):
        lines = repr(found).splitlines()
        assert len(lines) == 2
        assert max(map(len, lines)) <= 80
        assert "teardrop: 7 methods, 7 ran, 2 break nothing" in lines[0]
        assert f"{100.0 * found.saving.share:.2f} % less than scurve" in lines[1]
        assert repr(Comparison(found.curve, found.limits, found.results[:1])).count("\n") == 0

    def test_takes_a_text_of_names(self):
        curve = load_curve("circle")
        results = compare(curve, load_limits("mill").for_curve(curve), "2002-trapezoid,algorithm-1").results
        assert [result.method for result in results] == ["algorithm-1", "2002-trapezoid-1", "2002-trapezoid-2"]

    def test_needs_a_method(self, teardrop):
        curve, limits, _ = teardrop
        with pytest.raises(InputError, match="methods is empty"):
            compare(curve, limits, [])


class TestMethods:
    def test_select_by_beginnings(self):
        assert select_methods("2002-bell,optimal") == ["2002-bell-1", "2002-bell-2", "2002-bell-steady", "optimal"]
        assert select_methods("algorithm-2") == ["algorithm-2"]
        assert len(select_methods("algorithm,2002,2007,toppra,scurve,nlp,optimal")) == len(METHODS)
        for text in ("", "algo", "optimal,", "optimal-"):
            with pytest.raises(InputError, match="must be one of"):
                select_methods(text)

    def test_unknown_method(self, teardrop):
        curve, limits, _ = teardrop
        with pytest.raises(InputError, match="'fastest'"):
            compare(curve, limits, ["fastest"])

    def test_rotary_axes_are_a_reason(self):
        curve = load_curve("flank")
        results = compare(curve, load_limits("five-axis"), ["algorithm-1", "2002-bell-steady"]).results
        assert all("rotary" in result.reason for result in results)
        assert result_facts(results[0])["verdict"] == "not run"

    def test_steps_that_never_arrive_are_a_reason(self):
        curve = load_curve("butterfly-nurbs")
        limits = load_limits("mill").for_curve(curve).with_feed(300.0)
        second, first = compare(curve, limits, ["2002-bell-2", "2002-bell-1"]).results
        assert "come to u = 0.284" in second.reason
        assert first.reason == ""


@pytest.fixture(scope="module")
def corner(tmp_path_factory):
    """A program of three lines, compared on the path that is made first, with the row of the other."""
    file = tmp_path_factory.mktemp("corner") / "corner.ngc"
    file.write_text("G21 G90 G64 P0.01\nF6000\nG0 X0 Y0\nG1 X20\nY20\nX0\nM2\n")

    def load(kind):
        return load_job(file, "mill", path=kind)

    return {kind: both_paths(load(kind), load, ("scurve", "optimal")) for kind in ("separate", "joint")}, load


def both_paths(job, load, methods):
    found = compare(job.curve, job.limits, methods)
    return with_other_path(found.results, job, load, lambda other: run_method("optimal", other.curve, other.limits))


class TestBothPathsOfAProgram:
    def test_the_row_is_the_plan_of_the_other_path_judged_alike(self, corner):
        found, load = corner
        for kind, other in (("separate", "joint"), ("joint", "separate")):
            *_, optimal, row = found[kind]
            assert (optimal.method, row.method) == ("optimal", other)
            job = load(other)
            profile = job.plan()
            assert row.duration == profile.duration
            assert row.ok == (job.check(profile).ok and job.check(job.replay(profile)).ok)
            assert row.ok
            assert row.deviation == job.path.deviation.largest
            assert optimal.deviation == load(kind).path.deviation.largest
            assert max(row.deviation, optimal.deviation) <= 0.01

    def test_each_is_the_optimum_of_the_other_comparison(self, corner):
        found, _ = corner
        seconds = {kind: {row.method: row.duration for row in rows} for kind, rows in found.items()}
        assert seconds["separate"]["joint"] == seconds["joint"]["optimal"]
        assert seconds["joint"]["separate"] == seconds["separate"]["optimal"]
        saved = 1.0 - seconds["separate"]["joint"] / seconds["separate"]["optimal"]
        assert saved > 0.02
        assert [joint_saving(rows) for rows in found.values()] == [pytest.approx(saved)] * 2

    def test_it_is_no_rival_of_the_optimum(self, corner):
        for rows in corner[0].values():
            assert saving(rows).rival == saving(rows).slowed_rival == "scurve"

    def test_facts_tell_the_deviation(self, corner, teardrop):
        assert [0.009 < result_facts(row)["deviation_mm"] <= 0.01 for row in corner[0]["separate"]] == [True] * 3
        assert all(np.isnan(result_facts(row)["deviation_mm"]) for row in teardrop[2].values())

    def test_without_the_optimal_plan_there_is_none(self, corner):
        _, load = corner
        assert [row.method for row in both_paths(load("separate"), load, ("scurve",))] == ["scurve"]
        assert joint_saving(both_paths(load("separate"), load, ("scurve",))) is None

    def test_a_curve_has_one_path(self):
        job = load_job("teardrop", "mill")
        rows = compare(job.curve, job.limits, ("optimal",)).results
        assert with_other_path(rows, job, None, None) == rows
        assert joint_saving(rows) is None

    @pytest.mark.parametrize("error", [SolverError, InfeasibleError])
    def test_a_path_that_cannot_be_made_says_why(self, corner, error):
        _, load = corner

        def failing(kind):
            raise error("it does not converge")

        *_, row = both_paths(load("separate"), failing, ("optimal",))
        assert (row.method, row.judgement) == ("joint", None)
        assert row.reason == f"{error.__name__}: it does not converge"

    def test_where_no_run_is_joint_the_reason_is_told(self, tmp_path):
        file = tmp_path / "part.ngc"
        file.write_text("G21 G90 G64 P0.01\nF6000\nG0 X0 Y0\nG1 X20\nY20\nM2\n")
        limits = load_limits("mill").without_jerk()

        def load(kind):
            return load_job(file, limits, path=kind)

        *_, row = both_paths(load("separate"), load, ("optimal",))
        assert (row.method, row.judgement) == ("joint", None)
        assert "the path is made separately from the feed: the jerk of X, Y has no limit" in row.reason


@pytest.fixture(scope="module")
def slot(tmp_path_factory):
    """A program of two lines and a half circle."""
    file = tmp_path_factory.mktemp("controllers") / "slot.ngc"
    file.write_text("G21 G90 G64 P0.01\nF3000\nG0 X0 Y0\nG1 X20\nG3 X20 Y10 I0 J5\nG1 X0\nM2\n")
    return load_job(file, "mill", path="separate")


class TestControllers:
    """Models of controllers on a program of two lines and a half circle of radius 5."""

    def test_rows_behind_those_of_the_methods(self, slot):
        first = compare(slot.curve, slot.limits, ("scurve",)).results
        rows = with_controllers(first, slot, {"grbl": {}, "klipper": {"arc_resolution_mm": 0.5}})
        assert rows[: len(first)] == first
        grbl, klipper = rows[len(first) :]
        assert (grbl.method, klipper.method) == ("grbl", "klipper")
        assert "arc_resolution_mm 0.5" in klipper.motion.setting

    def test_they_are_judged_as_everything_is(self, slot):
        """Corners of chords are steps of the velocity: acceleration and jerk of the samples break, the feed holds."""
        for row in with_controllers((), slot, {"grbl": {}, "klipper": {}}):
            broken = {found.limit for found in row.judgement.broken}
            assert {"acceleration", "jerk"} <= broken
            assert broken.isdisjoint({"feed", "velocity", "path error", "path start", "path end", "sample times"})
            assert row.judgement.ratios["velocity"] <= 1.0
            assert not row.ok
            assert row.points == int(np.ceil(row.duration / slot.limits.period)) + 1

    def test_chords_leave_the_program_by_their_height(self, slot):
        """r (1 - cos(half the angle of one)): 15 chords of 1 mm at least, and those of 0.002 mm."""
        (klipper,) = with_controllers((), slot, {"klipper": {}})
        assert klipper.deviation == pytest.approx(5.0 * (1.0 - np.cos(np.pi / 15 / 2)), rel=1e-6)
        (grbl,) = with_controllers((), slot, {"grbl": {}})
        chords = int(0.5 * np.pi * 5.0 / np.sqrt(0.002 * (10.0 - 0.002)))
        assert grbl.deviation == pytest.approx(5.0 * (1.0 - np.cos(np.pi / chords / 2)), rel=1e-6)

    def test_they_are_no_rivals_on_the_same_path(self, slot):
        rows = with_controllers(compare(slot.curve, slot.limits, ("scurve", "optimal")).results, slot, {"grbl": {}})
        assert saving(rows).rival == saving(rows).slowed_rival == "scurve"

    def test_what_they_cannot_run_is_a_reason(self, tmp_path):
        file = tmp_path / "turn.ngc"
        file.write_text("G21 G90\nG1 X10 A30 F600\nM2\n")
        job = load_job(file, "four-axis", path="separate")
        (row,) = with_controllers((), job, {"grbl": {}})
        assert row.reason.startswith("InputError: turn.ngc:2: A: the model of grbl is of X Y Z")
        assert row.judgement is None

    def test_a_curve_has_none(self):
        job = load_job("teardrop", "mill")
        assert with_controllers((), job, {"grbl": {}}) == ()
