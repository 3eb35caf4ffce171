"""What a tolerance buys: each row is the plan of the program within that tolerance, and one that has none says why."""

from __future__ import annotations

import dataclasses
import math

import pytest
from cases import PROGRAMS
from texts import flat, strict_json

import feedplan.job
from feedplan.job import load_job
from feedplan.tolerances import (
    USUAL_UM,
    ToleranceTime,
    read_tolerances,
    time_of_tolerances,
    tolerance_facts,
    tolerance_lines,
)
from planner import InfeasibleError, InputError, SolverError, load_limits, write_table

SLOTS = PROGRAMS / "slots.ngc"
STOPS = PROGRAMS / "stops.ngc"
TOLERANCES = (0.05, 0.001, 0.01)
CORNER = "G21 G90\nF6000\nG0 X0 Y0\nG1 X20\nY20\nM2\n"
EXACT = "G21 G90 G61\nF6000\nG0 X0 Y0\nG1 X20\nY20\nX0\nM2\n"


@pytest.fixture(scope="module")
def rows():
    return time_of_tolerances(SLOTS, "mill", TOLERANCES)


@pytest.fixture(scope="module")
def now():
    return planned(load_job(SLOTS, "mill"))


def planned(job):
    profile = job.plan()
    return ToleranceTime.of(job.path, profile, job.check(profile))


class TestRows:
    def test_each_is_the_plan_of_its_own_path(self, rows):
        assert [row.tolerance for row in rows] == list(TOLERANCES)
        for row in rows:
            job = load_job(SLOTS, "mill", tolerance=row.tolerance)
            assert row.seconds == job.plan().duration
            assert (row.deviation, row.line) == (job.path.deviation.largest, job.path.deviation_line)
            assert 0.9 * row.tolerance < row.deviation <= row.tolerance
            assert (row.ok, row.breaks, row.reason) == (True, False, "")

    def test_a_larger_tolerance_takes_less_time(self, rows):
        seconds = [row.seconds for row in sorted(rows, key=lambda row: row.tolerance)]
        assert seconds == sorted(seconds, reverse=True)
        assert seconds[0] - seconds[-1] > 1.0

    def test_exact_stops_have_nothing_to_gain(self, tmp_path):
        (tmp_path / "exact.ngc").write_text(EXACT)
        found = time_of_tolerances(tmp_path / "exact.ngc", "mill", (0.001, 0.05))
        assert found[0].seconds == pytest.approx(found[1].seconds, rel=1e-9)
        assert [row.deviation for row in found] == [0.0, 0.0]

    def test_the_usual_ones_are_taken_where_none_are_named(self, tmp_path):
        (tmp_path / "exact.ngc").write_text(EXACT)
        found = time_of_tolerances(tmp_path / "exact.ngc")
        assert [1e3 * row.tolerance for row in found] == pytest.approx(USUAL_UM)

    def test_what_a_job_is_loaded_with_goes_through(self, rows):
        (slow,) = time_of_tolerances(SLOTS, load_limits("mill"), (0.01,), feed=20.0)
        assert slow.seconds == load_job(SLOTS, "mill", tolerance=0.01, feed=20.0).plan().duration
        assert slow.seconds > 2.0 * rows[-1].seconds

    def test_a_table_says_how_its_program_was_planned(self, tmp_path):
        job = load_job(SLOTS, "mill", tolerance=0.02, feed=50.0, share=0.5)
        write_table(tmp_path / "t.csv", job.plan(), job.limits)
        (found,) = time_of_tolerances(SLOTS, tolerances=(0.01,), table=tmp_path / "t.csv")
        wanted = load_job(SLOTS, "mill", tolerance=0.01, feed=50.0, share=0.5)
        assert (found.tolerance, wanted.path.tolerance) == (0.01, 0.005)
        assert planned(job).tolerance == 0.02
        assert found.seconds == pytest.approx(wanted.plan().duration, rel=1e-6)

    def test_progress_is_told(self, tmp_path):
        (tmp_path / "exact.ngc").write_text(EXACT)
        told = []
        time_of_tolerances(tmp_path / "exact.ngc", "mill", (0.001, 0.05), progress=lambda *said: told.append(said))
        assert told == [("planning within 1 um", 0.0), ("planning within 50 um", 0.5)]

    def test_the_path_is_the_one_asked_for(self, tmp_path):
        (tmp_path / "corner.ngc").write_text(CORNER)
        joint, separate = (
            time_of_tolerances(tmp_path / "corner.ngc", "mill", (0.01,), path=kind) for kind in ("joint", "separate")
        )
        assert [rows[0].path for rows in (joint, separate)] == ["joint", "separate"]
        assert joint[0].seconds < 0.985 * separate[0].seconds
        assert joint[0].deviation <= 0.01


class TestWithoutPlan:
    @pytest.mark.parametrize("error", [SolverError, InfeasibleError])
    def test_it_says_why_and_the_rest_goes_on(self, monkeypatch, rows, now, error):
        def load(source, machine, *, tolerance):
            if tolerance == TOLERANCES[1]:
                raise error("the path leaves the tolerance")
            return load_job(source, machine, tolerance=tolerance)

        monkeypatch.setattr(feedplan.job, "load_job", load)
        found = time_of_tolerances(SLOTS, "mill", TOLERANCES)
        assert (found[0], found[2]) == (rows[0], rows[2])
        assert math.isnan(found[1].seconds)
        assert (found[1].ok, found[1].breaks, found[1].reason) == (False, False, "the path leaves the tolerance")
        text = flat("\n".join(tolerance_lines(now, found)))
        assert "1 no plan" in text
        assert text.endswith("1 um no plan: the path leaves the tolerance")
        (facts,) = tolerance_facts(now, found[1:2])
        assert {key for key, value in facts.items() if value is None} == {
            "seconds", "saved_s", "saved_share", "deviation_mm", "deviation_line",
        }  # fmt: skip

    def test_a_broken_limit_is_told(self, now):
        job = load_job(SLOTS, "mill")
        profile = job.plan()
        weaker = dataclasses.replace(job, limits=job.limits.with_feed(50.0))
        broken = ToleranceTime.of(job.path, profile, weaker.check(profile))
        assert broken.breaks
        assert broken.reason.startswith("breaks feed: 2")
        assert "LIMIT BROKEN breaks feed: 2" in flat("\n".join(tolerance_lines(now, [broken])))


class TestText:
    def test_the_table_tells_seconds_and_what_is_saved(self, rows, now):
        lines = [line.split() for line in tolerance_lines(now, rows)]
        assert lines[2][:3] == ["10", "now", f"{now.seconds:.4f}"]
        for line, row in zip(lines[3:], rows, strict=True):
            saved = now.seconds - row.seconds
            share = f"{100.0 * saved / now.seconds:.1f}"
            place = [f"{1e3 * row.deviation:.4g}", str(row.line), row.path]
            assert line == [f"{1e3 * row.tolerance:g}", f"{row.seconds:.4f}", f"{saved:.4f}", share, *place]

    def test_facts_add_up(self, rows, now):
        for facts, row in zip(tolerance_facts(now, rows), rows, strict=True):
            assert facts["saved_s"] == now.seconds - row.seconds
            assert facts["saved_share"] == pytest.approx(facts["saved_s"] / now.seconds)


class TestInput:
    def test_a_list_is_in_um(self):
        assert read_tolerances("1, 2.5,50", "--t") == (0.001, 0.0025, 0.05)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("1,five", '--t: "five" is no number'),
            ("part.ngc", "stands behind the program"),
            ("", '--t: "" is no number'),
            ("1,-2", r"--t = -2.0 must be a number > 0"),
            ("0", r"--t = 0.0 must be a number > 0"),
            ("nan", r"--t = nan must be a number > 0"),
            ("inf", r"--t = inf must be finite"),
            ("5,1,5", r"--t = 5.0 is given twice"),
        ],
    )
    def test_bad_ones_are_named(self, text, message):
        with pytest.raises(InputError, match=message):
            read_tolerances(text, "--t")

    def test_tolerances_are_refused_before_anything_is_planned(self):
        for given, message in (((0.01, -1.0), "-1.0"), ((), "empty"), (("1",), "'1'")):
            with pytest.raises(InputError, match=message):
                time_of_tolerances("missing.ngc", "mill", given)

    def test_a_curve_has_no_tolerance(self):
        with pytest.raises(InputError, match="circle has no lines; what a tolerance buys needs a part program"):
            time_of_tolerances("circle", "mill")


class TestCommand:
    def test_one_command_tells_all(self, run, rows):
        code, out, err = run("time", SLOTS, "--rows", "0", "--tolerances-um", "50,1,10")
        assert (code, err) == (0, "")
        assert max(len(line) for line in out.splitlines()) <= 80
        assert [line.split()[1] for line in out.splitlines()[-3:]] == [f"{row.seconds:.4f}" for row in rows]

    def test_json(self, run, rows):
        code, out, _ = run("time", SLOTS, "--tolerances-um", "50,1,10", "--json")
        assert code == 0
        found = strict_json(out)
        assert [row["tolerance_mm"] for row in found["tolerances"]] == list(TOLERANCES)
        assert [row["seconds"] for row in found["tolerances"]] == [row.seconds for row in rows]
        assert "tolerances" not in strict_json(run("time", STOPS, "--json")[1])

    def test_the_usual_ones(self, run, tmp_path):
        (tmp_path / "exact.ngc").write_text(EXACT)
        out = strict_json(run("time", tmp_path / "exact.ngc", "--tolerances-um", "--json")[1])
        assert [1e3 * row["tolerance_mm"] for row in out["tolerances"]] == pytest.approx(USUAL_UM)

    @pytest.mark.parametrize("words", [("--tolerances-um", SLOTS), (SLOTS, "--tolerances-um", "1,x")])
    def test_what_is_no_list_is_refused(self, run, words):
        code, out, err = run("time", *words)
        assert (code, out) == (2, "")
        assert "is no number; it takes numbers in um with commas between them" in err

    def test_a_plan_that_breaks_a_limit_is_told_by_the_exit_code(self, run, monkeypatch, tmp_path):
        (tmp_path / "exact.ngc").write_text(EXACT)
        broken = ToleranceTime(0.05, 1.0, 0.04, 4, "joint", ok=False, reason="breaks jerk X: 2 times what is allowed")
        monkeypatch.setattr("feedplan.tolerances.time_of_tolerances", lambda *_args, **_kwargs: (broken,))
        code, out, _ = run("time", tmp_path / "exact.ngc", "--tolerances-um", "50")
        assert code == 1
        assert "50 um LIMIT BROKEN breaks jerk X: 2 times what is allowed" in flat(out)
