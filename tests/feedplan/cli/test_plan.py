"""The command line: exit codes, messages a person can act on, one verdict, and nothing left behind by a failure."""

from __future__ import annotations

import dataclasses
import io
import os
import resource
import signal
import subprocess
import sys
import time
import tomllib

import numpy as np
import pytest
from cases import PROJECT
from pictures import width_of
from texts import strict_json

import feedplan.progress
import planner
from feedplan.cli import app
from planner import check, load_curve, load_limits, read_table, write_table
from planner.errors import InfeasibleError, SolverError, StalledError
from planner.law import TimeLaw
from planner.output.plots import plot_plan
from planner.profile import make_profile
from planner.status import Status

QUICK = ("--intervals", "60")
HEAVY = ("numpy", "scipy", "casadi", "matplotlib", "pydantic", "toppra", "ruckig", "rich")


PANELS = "path, feed, velocity, acceleration, jerk, chord, binding"
WIDTHS = "allowed is 80 to 420 mm; a paper's column is often 85, its page 180"
PLOT = ("--plot", "plan.pdf")
BAD_FIGURES = [
    ((*PLOT, "--panels", "path,speed"), f'panels: "speed" is not one of {PANELS}'),
    ((*PLOT, "--panels", "feed,feed"), 'panels: "feed" is given twice'),
    ((*PLOT, "--panels", ""), f'panels: "" is not one of {PANELS}'),
    ((*PLOT, "--panels", "feed,"), f'panels: "" is not one of {PANELS}'),
    ((*PLOT, "--width-mm", "8.5"), f"a figure 8.5 mm wide is not possible: {WIDTHS}"),
    ((*PLOT, "--width-mm", "nan"), f"a figure nan mm wide is not possible: {WIDTHS}"),
    ((*PLOT, "--width-mm", "inf"), f"a figure inf mm wide is not possible: {WIDTHS}"),
    ((*PLOT, "--width-mm", "-85"), f"a figure -85 mm wide is not possible: {WIDTHS}"),
    (("--panels", "feed"), "--panels says how a figure looks, and none is asked for; add --plot FILE"),
    (("--width-mm", "85"), "--width-mm says how a figure looks, and none is asked for; add --plot FILE"),
]


@pytest.fixture(scope="module")
def plan():
    """A plan of the teardrop on the mill."""
    curve = load_curve("teardrop")
    return planner.plan_feedrate(curve, load_limits("mill").for_curve(curve), intervals=60)


@pytest.fixture(scope="module")
def table(tmp_path_factory, plan):
    """The same plan on disk."""
    path = tmp_path_factory.mktemp("tables") / "teardrop.csv"
    write_table(path, plan, load_limits("mill").for_curve(plan.curve))
    return path


@pytest.fixture
def fast_table(tmp_path, plan):
    """The same plan, run 0.5 % faster than its limits allow."""
    limits = load_limits("mill").for_curve(plan.curve)
    nodes = (plan.t / 1.005, plan.u, plan.u_rate * 1.005, plan.u_acceleration * 1.005**2)
    write_table(tmp_path / "fast.csv", make_profile(plan.curve, limits, TimeLaw(*nodes), method="faster"), limits)
    return tmp_path / "fast.csv"


def planned_by(monkeypatch, planning):
    """Let a function take the place of the planner."""
    monkeypatch.setattr(planner, "plan_feedrate", planning)


class TestPlan:
    def test_a_plan_within_its_limits_is_ok(self, run, tmp_path):
        table, figure = tmp_path / "table.csv", tmp_path / "plan.png"
        code, out, err = run("plan", "teardrop", *QUICK, "-o", table, "--plot", figure)
        assert (code, err) == (0, "")
        profile = read_table(table, load_curve("teardrop"))
        assert f"{profile.duration:.6g} s" in out
        assert "mill (example machine); feed 100 mm/s, period 0.001 s" in out
        assert "held back by  feed" in out
        assert out.splitlines()[-1].startswith("OK  every limit holds, for the plan and for its ")
        assert f"optimal, {profile.t.size} nodes" in out
        assert figure.read_bytes().startswith(b"\x89PNG")
        assert sorted(tmp_path.iterdir()) == [figure, table]

    def test_json_says_what_the_check_says(self, run, tmp_path):
        table = tmp_path / "table.npz"
        code, out, err = run("plan", "teardrop", *QUICK, "-o", table, "--json")
        assert (code, err) == (0, "")
        facts = strict_json(out)
        curve = load_curve("teardrop")
        profile, limits = read_table(table, curve), load_limits("mill").for_curve(curve)
        assert facts["ok"] is True
        assert facts["duration_s"] == profile.duration
        assert facts["nodes"] == profile.t.size
        assert facts["held_back_by"] == profile.shares()
        assert facts["curve"]["hash"] == curve.fingerprint
        assert facts["files"] == [str(table)]
        found = {(row["limit"], row["axis"]): row for row in facts["checks"]["plan"]}
        for row in check(curve, limits, profile).rows:
            said = found[row.limit, row.axis]
            assert (said["worst"], said["ok"], said["u"], said["unit"]) == (row.worst, row.ok, row.u, row.unit)
            assert said["allowed"] == (row.allowed if np.isfinite(row.allowed) else None)
        assert {row["limit"] for row in facts["checks"]["samples"]} >= {"feed", "jerk", "path error"}

    def test_gap_notes_and_status_are_told(self, run, monkeypatch, plan):
        notes = ("exact stop at u = 0.5", *(f"curvature jumps, {i}" for i in range(20)))
        changed = dataclasses.replace(plan, lower_bound=plan.duration / 1.25, notes=notes, status=Status.BUDGET)
        planned_by(monkeypatch, lambda *_args, **_options: changed)
        monkeypatch.setattr("planner.certify", lambda _curve, _limits, profile: profile.lower_bound)
        code, out, _ = run("plan", "teardrop", "--json")
        facts = strict_json(out)
        assert code == 0
        assert facts["gap"] == pytest.approx(0.25)
        assert facts["lower_bound_s"] == plan.duration / 1.25
        assert len(facts["notes"]) == 22
        _, out, _ = run("plan", "teardrop")
        assert "the gap is at most 25.00%" in out
        assert "note          exact stop at u = 0.5" in out
        assert "15 more notes are in --json" in out

    def test_the_bound_is_certified(self, run, monkeypatch, plan):
        planned_by(monkeypatch, lambda *_args, **_options: plan)
        monkeypatch.setattr("planner.certify", lambda *_args: plan.duration / 1.125)
        assert strict_json(run("plan", "teardrop", "--json")[1])["gap"] == pytest.approx(0.125)

    def test_what_a_limit_costs_is_told(self, run):
        code, out, _ = run("plan", "teardrop", *QUICK, "--json")
        assert code == 0
        saved = strict_json(out)["saved_by_one_percent_s"]
        assert next(iter(saved)) == "feed"
        assert saved["feed"] > 0.0
        assert "10% more of   feed saves" in run("plan", "teardrop", *QUICK)[1]

    def test_no_bound_is_no_number(self, run, monkeypatch, plan):
        planned_by(monkeypatch, lambda *_args, **_options: dataclasses.replace(plan, lower_bound=np.nan))
        monkeypatch.setattr("planner.certify", lambda _curve, _limits, profile: profile.lower_bound)
        _, out, _ = run("plan", "teardrop", "--json")
        assert strict_json(out)["lower_bound_s"] is None
        assert strict_json(out)["gap"] is None
        _, out, _ = run("plan", "teardrop")
        assert "none from this method" in out

    def test_a_plan_without_a_jerk_limit_is_broken_and_says_why(self, run, tmp_path):
        code, out, _ = run("plan", "teardrop", *QUICK, "--method", "toppra", "-o", tmp_path / "t.csv")
        assert code == 1
        assert "the method toppra knows no jerk limit" in out
        assert "LIMIT BROKEN" in out
        assert "jerk X" in out
        assert run("check", tmp_path / "t.csv", "teardrop")[0] == 1

    def test_options_reach_the_planner(self, run, monkeypatch, plan):
        seen = {}

        def planning(curve, limits, **options):
            seen.update(options, curve=curve, limits=limits)
            return plan

        planned_by(monkeypatch, planning)
        run(
            "plan", "teardrop", "--machine", "mill", "--method", "scurve", "--feed-mm-s", "50", "--period-s", "0.002",
            "--start-feed-mm-s", "1", "--end-feed-mm-s", "2", "--periodic", "--exact-stop", "--intervals", "33",
            "--budget-s", "7",
        )  # fmt: skip
        assert (seen["limits"].feed, seen["limits"].period, seen["limits"].axes) == (50.0, 0.002, ("X", "Y"))
        options = {key: seen[key] for key in seen if key not in {"curve", "limits", "progress"}}
        assert options == {
            "method": "scurve",
            "start_feed": 1.0,
            "end_feed": 2.0,
            "periodic": True,
            "exact_stop": True,
            "intervals": 33,
            "budget": 7.0,
            "override_reserve": 0.0,
        }
        reserves = []
        planned_by(monkeypatch, lambda curve, limits, **given: reserves.append(given["override_reserve"]) or plan)
        run("plan", "teardrop", "--override-reserve", "0.05")
        assert reserves == [0.05, 0.0]  # the second for what the reserve costs
        planned_by(monkeypatch, planning)
        run("plan", "teardrop", "--scale", "2")
        assert seen["curve"].length == pytest.approx(2.0 * plan.curve.length)

    @pytest.mark.parametrize("curve", ["teardrop", "flank"])
    @pytest.mark.parametrize("method", ["optimal", "toppra"])
    def test_lines_fit_80_columns_without_colour_codes(self, run, curve, method):
        _, out, _ = run("plan", curve, *QUICK, "--method", method)
        assert max(len(line) for line in out.splitlines()) <= 80
        assert "\x1b" not in out
        assert "…" not in out

    def test_a_machine_with_rotary_axes_is_chosen_by_itself(self, run):
        _, out, _ = run("plan", "flank", *QUICK)
        assert "five-axis (example machine); no feed limit, period 0.002 s" in out


class TestFigure:
    @pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
    def test_panels_and_width_are_those_asked_for(self, run, monkeypatch, tmp_path, plan, suffix):
        planned_by(monkeypatch, lambda *_args, **_options: plan)
        drawn = []
        monkeypatch.setattr(
            planner.output.plots, "plot_plan", lambda *a, **k: drawn.append(plot_plan(*a, **k)) or drawn[-1]
        )
        path = tmp_path / f"plan{suffix}"
        code, _, err = run("plan", "teardrop", "--plot", path, "--panels", "jerk, path", "--width-mm", 85)
        assert (code, err) == (0, "")
        assert width_of(path) == pytest.approx(85.0, abs=0.13)  # a pixel
        assert [axes.get_ylabel().split("\n")[0] for axes in drawn[0].get_axes()] == ["Y, mm", "feed, mm/s", "jerk"]

    def test_alone_it_is_as_wide_as_a_page(self, run, monkeypatch, tmp_path, plan):
        planned_by(monkeypatch, lambda *_args, **_options: plan)
        code, _, _ = run("plan", "teardrop", "--plot", tmp_path / "plan.pdf")
        assert code == 0
        assert width_of(tmp_path / "plan.pdf") == pytest.approx(180.0, abs=0.01)

    @pytest.mark.parametrize(("options", "message"), BAD_FIGURES)
    def test_what_cannot_be_drawn_is_refused_before_the_work(self, run, monkeypatch, tmp_path, options, message):
        planned_by(monkeypatch, lambda *_args, **_options: pytest.fail("planned"))
        monkeypatch.chdir(tmp_path)
        code, out, err = run("plan", "teardrop", *options)
        assert (code, out) == (2, "")
        assert err == f"error: {message}\n"
        assert list(tmp_path.iterdir()) == []


class TestCheck:
    def test_a_good_table_holds(self, run, table):
        code, out, err = run("check", table, "teardrop", "--machine", "mill")
        assert (code, err) == (0, "")
        assert "machine       mill; feed 100 mm/s" in out
        assert out.splitlines()[-1].startswith("OK  every limit holds")

    def test_the_tables_own_limits_count_without_a_machine(self, run, table):
        code, out, _ = run("check", table, "teardrop", "--json")
        assert code == 0
        assert strict_json(out)["machine"] == f"limits in {table}"
        assert strict_json(out)["planning_time_s"] is None

    def test_a_plan_half_a_percent_too_fast_is_broken(self, run, fast_table):
        code, out, _ = run("check", fast_table, "teardrop")
        assert code == 1
        assert "LIMIT BROKEN" in out
        code, out, _ = run("check", fast_table, "teardrop", "--json")
        assert code == 1
        facts = strict_json(out)
        assert facts["ok"] is False
        assert {row["limit"] for row in facts["checks"]["plan"] if not row["ok"]} >= {"feed", "jerk"}

    def test_no_machine_gets_a_plan_that_breaks_a_limit(self, run, tmp_path, fast_table):
        """One rule: a program is refused, every other file says what it is; the exit code is 1."""
        assert "# verdict = BREAKS ITS LIMITS: " in fast_table.read_text()
        code, _, err = run("ngc", "teardrop", "--table", fast_table, "-o", tmp_path / "out.ngc")
        assert code == 1
        assert "out.ngc: not written: the plan BREAKS ITS LIMITS" in err
        code, out, _ = run("replay", fast_table, "teardrop", "-o", tmp_path / "samples.csv")
        assert code == 1
        assert "LIMIT BROKEN" in out
        assert "# verdict = BREAKS ITS LIMITS: " in (tmp_path / "samples.csv").read_text()
        assert run("report", fast_table, "teardrop", "-o", tmp_path / "page.html")[0] == 1
        assert '"ok":false' in (tmp_path / "page.html").read_text().replace(" ", "")
        assert not (tmp_path / "out.ngc").exists()

    def test_what_is_planned_too_fast_is_marked(self, run, tmp_path, plan, monkeypatch):
        limits = load_limits("mill").for_curve(plan.curve)
        nodes = (plan.t / 1.005, plan.u, plan.u_rate * 1.005, plan.u_acceleration * 1.005**2)
        planned_by(monkeypatch, lambda curve, limits, **options: fast)
        fast = make_profile(plan.curve, limits, TimeLaw(*nodes), method="faster")
        files = [tmp_path / name for name in ("t.csv", "out.ngc", "p.svg")]
        code, out, err = run("plan", "teardrop", "-o", files[0], "--program", files[1], "--plot", files[2])
        assert code == 1
        assert "out.ngc: not written, since the plan breaks a limit" in err
        written = "".join(out.split())
        assert f"{files[0].name}" in written
        assert "out.ngc" not in written
        assert "# verdict = BREAKS ITS LIMITS: " in files[0].read_text()
        figure = plot_plan(plan.curve, limits, fast)
        assert "BREAKS ITS LIMITS" in figure.get_suptitle()
        assert "BREAKS" not in plot_plan(plan.curve, limits, plan).get_suptitle()
        assert not files[1].exists()

    def test_the_bound_of_a_table_is_its_claim(self, run, table):
        code, out, _ = run("check", table, "teardrop")
        assert code == 0
        assert "is the table's claim, not checked; if true, the gap is at most" in " ".join(out.split())
        assert (
            strict_json(run("check", table, "teardrop", "--json")[1])["lower_bound_is"]
            == "claimed by the table, not verified"
        )
        assert strict_json(run("plan", "teardrop", *QUICK, "--json")[1])["lower_bound_is"] == "computed with the plan"

    def test_a_violation_shows_as_one_however_small(self, run, tmp_path, plan):
        limits = load_limits("mill").for_curve(plan.curve)
        largest = check(plan.curve, limits, plan).row("feed").worst
        tight = limits.with_feed(largest * (1.0 - 1e-5))
        write_table(tmp_path / "t.csv", plan, tight)
        code, out, _ = run("check", tmp_path / "t.csv", "teardrop")
        assert code == 1
        assert "> 100.0%" in out

    def test_the_scale_belongs_to_the_curve(self, run, tmp_path):
        code, _, _ = run("plan", "teardrop", *QUICK, "--scale", "2", "-o", tmp_path / "t.csv")
        assert code == 0
        assert run("check", tmp_path / "t.csv", "teardrop")[0] == 2
        assert run("check", tmp_path / "t.csv", "teardrop", "--scale", "2")[0] == 0


class TestReplay:
    def test_samples_are_written_and_summed_up(self, run, table, tmp_path, plan):
        code, out, err = run("replay", table, "teardrop", "--period-s", "0.002", "-o", tmp_path / "s.csv")
        assert (code, err) == (0, "")
        rows = [line for line in (tmp_path / "s.csv").read_text().splitlines() if not line.startswith("#")]
        count = int(np.ceil(plan.duration / 0.002)) + 1
        assert len(rows) == count + 1
        assert f"{count}, one every 0.002 s" in out
        assert "jerk Y" in out

    def test_taylor_steps_are_off_the_plan(self, run, table):
        found = {}
        for order in (1, 2, 3, 5):
            code, out, _ = run("replay", table, "teardrop", "--order", order)
            assert (code == 0) == ("LIMIT BROKEN" not in out)
            assert code == 0 or order < 5  # a cubic step may end beyond a limit by what it is off the plan
            found[order] = float(out.split("off the plan")[1].split()[0])
        assert found[5] < 1e-9
        assert found[1] > found[2] > found[3] > found[5]
        assert found[3] < 1e-5


class TestCurves:
    def test_every_curve_is_listed_with_its_source(self, run):
        code, out, _ = run("curves")
        assert code == 0
        assert all(name in out for name in planner.CATALOG)
        assert "X Y Z A C" in out
        assert "47 G2" in out
        assert "Hong-Yu Ma" in out
        assert max(len(line) for line in out.splitlines()) <= 80


BAD = [
    (("plan", "nope"), "nope"),
    (("plan", "nope.json"), "nope.json: cannot be read"),
    (("plan", "teardrop", "--machine", "nope.toml"), "nope.toml: cannot be read"),
    (("plan", "flank", "--machine", "mill"), "the machine has no axis A, which flank moves; its axes are X, Y, Z"),
    (("plan", "teardrop", "--feed-mm-s", "-5"), "feed = -5.0 must be"),
    (("plan", "teardrop", "--period-s", "0"), "period = 0.0 must be"),
    (("plan", "teardrop", "--period-s", "nan"), "period = nan must be"),
    (("plan", "teardrop", "--scale", "-1"), "scale = -1.0 must be"),
    (("plan", "teardrop", "--start-feed-mm-s", "-1"), "start_feed = -1.0"),
    (("plan", "teardrop", "--intervals", "2"), "intervals = 2 must"),
    (("plan", "teardrop", "--periodic"), "periodic"),
    (("plan", "teardrop", "-o", "missing/t.csv"), "missing/t.csv: cannot be written (there is no directory "),
    (("plan", "teardrop", "-o", "."), ".: cannot be written (it is a directory)"),
    (("plan", "teardrop", "-o", "t.xlsx"), 't.xlsx: the suffix ".xlsx" must be .csv or .npz'),
    (("plan", "teardrop", "--plot", "missing/p.png"), "missing/p.png: cannot be written"),
    (("plan", "teardrop", "--plot", "p.gif"), 'p.gif: the suffix ".gif" must be one of .png, .pdf, .svg'),
    (("check", "nope.csv", "teardrop"), "nope.csv: cannot be read"),
    (("check", "TABLE", "butterfly"), "is for the curve teardrop (hash "),
    (("check", "TABLE", "teardrop", "--machine", "nope"), "the example machines are mill, four-axis, five-axis"),
    (("check", "CUT", "teardrop"), "the last line is incomplete; the table is cut off"),
    (("replay", "TABLE", "butterfly"), "not for butterfly (hash "),
    (("replay", "CUT", "teardrop"), "is cut off"),
    (("replay", "TABLE", "teardrop", "--period-s", "0"), "period = 0.0"),
    (("replay", "TABLE", "teardrop", "--period-s", "1e-12"), "use a coarser period"),
    (("replay", "TABLE", "teardrop", "--order", "4"), "order = 4 must be"),
    (("replay", "TABLE", "teardrop", "-o", "missing/s.csv"), "missing/s.csv: cannot be written"),
]


class TestErrors:
    @pytest.mark.parametrize(("arguments", "message"), BAD, ids=lambda value: " ".join(value) if len(value) < 9 else "")
    def test_bad_input_is_one_line_and_exit_2(self, run, tmp_path, monkeypatch, table, arguments, message):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "cut.csv").write_text(table.read_text()[:-40])
        places = {"TABLE": str(table), "CUT": "cut.csv"}
        code, out, err = run(*(places.get(a, a) for a in arguments))
        assert (code, out) == (2, "")
        assert err.startswith("error: ")
        assert err.count("\n") == 1
        assert message in err
        assert os.listdir(tmp_path) == ["cut.csv"]

    def test_a_broken_machine_file_names_key_and_value(self, run, tmp_path):
        (tmp_path / "m.toml").write_text("feed_mm_s = -3.0\n")
        code, _, err = run("plan", "teardrop", "--machine", tmp_path / "m.toml")
        assert code == 2
        assert "feed_mm_s = -3.0 must be" in err

    @pytest.mark.parametrize(
        "arguments", [("nope",), ("plan",), ("plan", "teardrop", "--nope"), ("plan", "teardrop", "--feed-mm-s", "x")]
    )
    def test_wrong_usage_is_exit_2(self, run, arguments):
        code, out, err = run(*arguments)
        assert (code, out) == (2, "")
        assert "Error: " in err
        assert "Traceback" not in err

    def test_a_feed_that_the_limits_forbid_is_exit_3(self, run):
        code, out, err = run("plan", "teardrop", "--start-feed-mm-s", "500")
        assert (code, out) == (3, "")
        assert err == "error: start_feed = 500.0 mm/s is above the feed limit there, 100 mm/s (u = 0)\n"

    @pytest.mark.parametrize("kind", [InfeasibleError, SolverError, StalledError])
    def test_no_plan_is_exit_3_and_writes_nothing(self, run, monkeypatch, tmp_path, kind):
        def planning(*_args, **_options):
            raise kind("no plan because of this")

        planned_by(monkeypatch, planning)
        code, out, err = run("plan", "teardrop", "-o", tmp_path / "t.csv")
        assert (code, out, err) == (3, "", "error: no plan because of this\n")
        assert os.listdir(tmp_path) == []

    def test_what_nobody_expected_keeps_its_traceback(self, monkeypatch):
        def planning(*_args, **_options):
            raise ZeroDivisionError("a defect")

        planned_by(monkeypatch, planning)
        with pytest.raises(ZeroDivisionError, match="a defect"):
            app(["plan", "teardrop"])

    @pytest.mark.parametrize("swallowed", [False, True])
    def test_an_interrupt_is_exit_130_and_quiet(self, run, monkeypatch, tmp_path, swallowed):
        def planning(*_args, **_options):
            try:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(1.0)
            except KeyboardInterrupt:
                if swallowed:
                    raise SolverError("stopped by the user") from None
                raise

        planned_by(monkeypatch, planning)
        before = signal.getsignal(signal.SIGINT)
        assert run("plan", "teardrop", "-o", tmp_path / "t.csv") == (130, "", "")
        assert os.listdir(tmp_path) == []
        assert signal.getsignal(signal.SIGINT) is before


class TestHelp:
    def test_help_names_every_command_and_loads_nothing_heavy(self):
        code = (
            "import sys\nfrom feedplan.cli import main\n"
            "try:\n    main()\nfinally:\n"
            f"    print('loaded', [name for name in {HEAVY!r} if name in sys.modules])\n"
        )
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([sys.executable, "-c", code, "--help"], check=True, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert done.stdout.endswith("loaded []\n")
        for command in ("plan", "check", "replay", "curves"):
            assert f"\n    feedplan {command}" in done.stdout
        assert (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime) < 1.0  # about 0.2

    @pytest.mark.parametrize("command", ["plan", "check", "replay", "curves"])
    def test_every_command_has_an_example(self, run, command):
        code, out, _ = run(command, "--help")
        assert code == 0
        assert f"\n    feedplan {command}" in out
        assert max(len(line) for line in out.splitlines()) <= 80

    def test_the_version_is_that_of_the_project(self, run):
        project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
        assert run("--version") == (0, f"feedplan {project['version']}\n", "")


class TestPackage:
    def test_every_public_name_is_there(self):
        for name in planner.__all__:
            assert getattr(planner, name) is not None
            assert name in dir(planner)
        with pytest.raises(AttributeError, match="has no attribute 'nope'"):
            planner.nope  # noqa: B018

    @pytest.mark.parametrize(
        "first",
        [
            "import planner.verify",
            "from planner.verify import Report",
            "import planner.output.table",
            "from planner import *",
        ],
    )
    def test_check_is_the_function_whatever_was_imported_before(self, first):
        code = f"{first}\nfrom planner import check\nimport planner\nassert callable(check) and planner.check is check"
        subprocess.run([sys.executable, "-c", code], check=True)


class Terminal(io.StringIO):
    """A standard error that says it is a terminal."""

    def isatty(self):
        return True


class TestProgress:
    @pytest.mark.parametrize(("stream", "seconds"), [(Terminal, 5.0), (io.StringIO, 0.2)])
    def test_long_work_shows_on_a_terminal_only(self, monkeypatch, stream, seconds):
        screen = stream()
        monkeypatch.setattr(sys, "stderr", screen)
        monkeypatch.setattr(feedplan.progress, "_PATIENCE", 0.01)
        with feedplan.progress.ProgressLine() as line:
            line("section 1 of 3", 0.25)
            end = time.monotonic() + seconds
            while "section" not in screen.getvalue() and time.monotonic() < end:
                time.sleep(0.01)
        assert ("section 1 of 3" in screen.getvalue()) is (stream is Terminal)

    def test_short_work_shows_nothing(self, monkeypatch):
        screen = Terminal()
        monkeypatch.setattr(sys, "stderr", screen)
        with feedplan.progress.ProgressLine() as line:
            line("reading", None)
        assert screen.getvalue() == ""
