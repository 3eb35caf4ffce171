"""``feedplan export``: the files of controllers from a table, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from cases import PROGRAMS

from interp import replay
from interp.plan_file import read_plan_file
from interp.pulse_file import read_pulses
from planner import load_curve, read_table

SLOTS = str(PROGRAMS / "slots.ngc")


@pytest.fixture
def table(run, tmp_path):
    file = tmp_path / "table.csv"
    assert run("plan", "circle", "--intervals", 200, "-o", file)[0] == 0
    return file


class TestFiles:
    def test_positions_of_drives(self, run, table, tmp_path):
        file = tmp_path / "drives.csv"
        code, out, _ = run(
            "export", table, "circle", "--counts-per-mm", "X=10000,Y=-8000", "--velocity-offset", "-o", file
        )
        assert code == 0
        assert "rows, one every 1 ms; rounded by half an increment at most: X 0.05 um, Y 0.0625 um" in out
        lines = [line.split(",") for line in file.read_text().splitlines() if not line.startswith("#")]
        assert lines[0] == ["t_s", "X_607A", "Y_607A", "X_60B1", "Y_60B1"]
        curve = load_curve("circle")
        samples = replay(curve, read_table(table, curve))
        counts = np.array([line[1:3] for line in lines[1:]], dtype=np.int64)
        assert np.abs(counts - samples.position * [10000.0, -8000.0]).max() <= 0.5 + 1e-6

    def test_another_period(self, run, table, tmp_path):
        file = tmp_path / "drives.csv"
        code, out, _ = run(
            "export", table, "circle", "--counts-per-mm", 10000, "--period-s", 0.00025, "-o", file, "--json"
        )
        assert code == 0
        facts = json.loads(out)
        assert facts["period_s"] == 0.00025
        assert "# interpolation_time_60C2 = 25, -5\n" in file.read_text()

    def test_a_trajectory_of_ros(self, run, table, tmp_path):
        file = tmp_path / "trajectory.yaml"
        code, out, _ = run("export", table, "circle", "--joint-names", "x, y", "-o", file)
        assert code == 0
        found = yaml.safe_load(file.read_text())
        assert found["joint_names"] == ["x", "y"]
        assert f"{len(found['points'])} points" in out

    @pytest.mark.parametrize("name", ["part.steps", "part.csv"])
    def test_pulses(self, run, table, tmp_path, name):
        file = tmp_path / name
        code, out, _ = run("export", table, "circle", "--steps-per-mm", 100, "--format", "steps", "-o", file)
        assert code == 0
        assert f"{len(read_pulses(file).pulses)} pulses: X " in out
        assert "200 kHz allowed; within 0.5 steps of the plan" in out

    def test_a_plan_file_says_whether_it_obeys(self, run, table, tmp_path):
        code, out, _ = run("export", table, "circle", "-o", tmp_path / "p.fpr")
        assert code == 0
        assert "it obeys neither override nor hold (plan it with --override-reserve)" in out
        assert run("plan", "circle", "--override-reserve", 0.2, "-o", tmp_path / "reserve.csv")[0] == 0
        code, out, _ = run("export", tmp_path / "reserve.csv", "circle", "-o", tmp_path / "p.fpr")
        stop = read_plan_file(tmp_path / "p.fpr").governor.stop_time
        assert f"it obeys override and hold, and a hold from full rate takes {stop:.3g} s" in out

    def test_the_plan_file_of_the_step_with_the_lines_of_the_program(self, run, tmp_path):
        table, file = tmp_path / "table.csv", tmp_path / "part.fpr"
        assert run("plan", SLOTS, "--tolerance-mm", 0.01, "-o", table)[0] == 0
        code, out, _ = run("export", table, SLOTS, "-o", file)
        assert code == 0
        found = read_plan_file(file)
        starts, numbers = found.lines.T
        assert starts[0] == 0.0
        assert (np.diff(starts) > 0.0).all()
        assert f"{numbers.size} lines of the program" in out
        # the same lines as those that take time in the table of line times
        assert run("plan", SLOTS, "--tolerance-mm", 0.01, "-o", table, "--lines", tmp_path / "lines.csv")[0] == 0
        rows = [row.split(",") for row in (tmp_path / "lines.csv").read_text().splitlines() if row[0] != "#"]
        moving = {int(row[0]) for row in rows[1:] if float(row[rows[0].index("seconds")]) > 0.0}
        assert set(numbers.astype(int)) == moving

    def test_standard_output(self, run, table):
        code, out, err = run("export", table, "circle", "--format", "ros", "-o", "-")
        assert code == 0
        assert len(yaml.safe_load(out)["points"]) > 10
        assert err.startswith("standard output: ") or "points" in err


class TestRefusals:
    @pytest.mark.parametrize(
        ("words", "code", "message"),
        [
            (("-o", "a.foo"), 2, 'a.foo: the suffix ".foo" is of no format'),
            (("-o", "-"), 2, "a file on standard output has no suffix; say its format with --format"),
            (("-o", "a.csv"), 2, "counts per mm of X, Y are missing; give them with --counts-per-mm"),
            (("-o", "a.csv", "--counts-per-mm", "0"), 2, "|counts per mm of X| = 0.0 must be a number > 0"),
            (("-o", "a.csv", "--counts-per-mm", "X=1"), 2, "counts per mm of Y are missing"),
            (("-o", "a.csv", "--counts-per-mm", "1e9"), 2, "0x607A holds -2147483648 to 2147483647"),
            (("-o", "a.csv", "--counts-per-mm", "1", "--counts-per-rad", "1"), 0, ""),
            (
                ("-o", "a.csv", "--counts-per-mm", "1", "--period-s", "0.0003333"),
                2,
                "is no interpolation time of a drive (0x60C2)",
            ),
            (("-o", "a.csv", "--counts-per-mm", "1", "--period-s", "0"), 2, "is no interpolation time"),
            (("-o", "a.csv", "--counts-per-mm", "1", "--period-s", "nan"), 2, "is no interpolation time"),
            (("-o", "a.csv", "--counts-per-mm", "1", "--period-s", "inf"), 2, "is no interpolation time"),
            (("-o", "a.csv", "--counts-per-mm", "1", "--joint-names", "x"), 2, "--joint-names is for the format ros"),
            (("-o", "a.yaml", "--joint-names", "x"), 2, "joint names x must be 2 different ones, for X Y"),
            (("-o", "a.yaml", "--deviation-mm", "-1"), 2, "tolerance = -1.0 must be a number > 0"),
            (("-o", "a.steps"), 2, "steps per mm of X, Y are missing; give them with --steps-per-mm"),
            (("-o", "a.steps", "--steps-per-mm", "0"), 2, "steps per mm of X = 0.0 must be a number > 0"),
            (("-o", "a.steps", "--steps-per-mm", "1", "--clock-hz", "0"), 2, "clock_hz = 0.0 must be"),
            (("-o", "a.steps", "--steps-per-mm", "1", "--setup-us", "-1"), 2, "setup = -1e-06 s must be >= 0"),
            (("-o", "a.steps", "--steps-per-mm", "5000"), 1, "the driver takes 200000 Hz there, 5 us"),
            (
                ("-o", "a.steps", "--steps-per-mm", "100", "--pulse-us", "200"),
                1,
                "mm; the driver takes 4938.27 Hz there",
            ),
            (("-o", "a.steps", "--steps-per-mm", "1", "--period-s", "1"), 2, "--period-s is for the format csp"),
            (("-o", "a.fpr", "--clock-hz", "1"), 2, "--clock-hz is for the format steps"),
            (("-o", "missing/a.yaml"), 2, "cannot be written (there is no directory "),
            (("-o", "table.csv", "--counts-per-mm", "1"), 2, "is an input of this command"),
        ],
    )
    def test_what_is_wrong_is_named_and_nothing_written(self, run, table, tmp_path, monkeypatch, words, code, message):
        monkeypatch.chdir(tmp_path)
        found, out, err = run("export", "table.csv", "circle", *words)
        assert found == code
        if code:
            assert message in err
            assert out == ""
            assert [file.name for file in tmp_path.iterdir()] == ["table.csv"]

    @pytest.mark.parametrize("words", [("-o", "a.yaml"), ("-o", "a.csv", "--counts-per-mm", "1"), ("-o", "a.fpr")])
    def test_a_plan_that_breaks_the_machines_limits(self, run, table, tmp_path, monkeypatch, words):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "slow.toml").write_text(
            "feed_mm_s = 20\nchord_error_mm = 0.001\nperiod_s = 0.001\n"
            + "".join(
                f'[[axis]]\nname = "{axis}"\nvelocity_mm_s = 10\nacceleration_mm_s2 = 1000\njerk_mm_s3 = 20000\n'
                for axis in "XY"
            )
        )
        code, out, err = run("export", table, "circle", "--machine", "slow.toml", *words)
        assert (code, out) == (1, "")
        assert "not written: the plan " in err
        assert not (tmp_path / words[1]).exists()

    def test_a_table_of_another_curve(self, run, table, tmp_path):
        code, _, err = run("export", table, "teardrop", "-o", tmp_path / "a.yaml")
        assert code == 2
        assert "is for the curve circle" in err
