"""The command that calibrates a machine: its report, its machine file, and what it refuses."""

import numpy as np
import pytest
from known_machines import ACCELERATION, VELOCITY, made_log
from texts import flat, strict_json

from planner import load_limits

START = """\
feed_mm_s = 200.0
period_s = 0.002

[[axis]]
name = "X"
velocity_m_min = 15
acceleration_m_s2 = 1
jerk_mm_s3 = 30000

[[axis]]
name = "Y"
velocity_mm_s = 250
acceleration_mm_s2 = 1000
jerk_mm_s3 = 30000

[[axis]]
name = "Z"
velocity_mm_s = 250
acceleration_mm_s2 = 1000
jerk_mm_s3 = 30000

[program]
home_mm = { X = 5, Z = 100 }
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "start.toml").write_text(START)
    return tmp_path


def write_log(path, log, head="t_s,X_mm,Y_mm,Z_mm", rows=slice(None)):
    table = np.column_stack([log.t, log.position])[rows]
    np.savetxt(path, table, fmt=["%.6f", "%.4f", "%.4f", "%.4f"], delimiter=",", header=head, comments="")


def test_a_machine_file_and_a_report(folder, run):
    write_log(folder / "a.csv", made_log("trapezoid", count=1e-3))
    code, out, err = run("calibrate", "a.csv", "--machine", "start.toml", "-o", "machine.toml")
    assert code == 0, err
    limits = load_limits("machine.toml")
    assert limits.acceleration == pytest.approx(ACCELERATION, rel=1e-3)
    assert limits.velocity == pytest.approx(VELOCITY, rel=1e-3)
    assert limits.period == 0.002
    assert "home_mm = { X = 5.0, Z = 100.0 }" in (folder / "machine.toml").read_text()
    text = flat(out + err)
    assert "law trapezoid" in text
    assert "not told jerk X, jerk Y, jerk Z" in text
    assert "6 of 9 limits measured" in text


def test_json(folder, run):
    write_log(folder / "a.csv", made_log("s-curve", count=1e-3))
    _, out, _ = run("calibrate", "a.csv", "--machine", "start.toml", "-o", "machine.toml", "--json")
    facts = strict_json(out)
    assert facts["law"]["best"] == "S-curve"
    jerk = next(row for row in facts["limits"] if (row["axis"], row["limit"]) == ("X", "jerk"))
    assert jerk["known"]
    assert jerk["value"] == pytest.approx(20000.0, rel=5e-3)
    assert facts["notes"] == []


def test_a_log_that_tells_nothing_is_not_ok(folder, run):
    t = np.arange(1000) * 1e-3
    rows = np.column_stack([t, 0.0 * t, 3.0 + 0.0 * t])
    np.savetxt(folder / "still.csv", rows, delimiter=",", header="t_s,X_mm,Y_mm", comments="")
    code, out, err = run("calibrate", "still.csv", "--machine", "start.toml", "-o", "machine.toml")
    assert code == 0, err
    text = flat(out + err)
    assert "NOTHING TOLD no limit was measured: machine.toml has those of start.toml" in text
    assert "OK" not in text
    assert "it does not move in any log" in text
    before, after = load_limits("start.toml"), load_limits("machine.toml")
    assert before.acceleration.tolist() == after.acceleration.tolist()


def test_a_gap_is_said_and_the_pieces_are_used(folder, run):
    log = made_log("trapezoid", count=1e-3)
    write_log(folder / "a.csv", log, rows=np.r_[0:3000, 3200 : log.t.size])
    code, out, err = run("calibrate", "a.csv", "--machine", "start.toml", "-o", "machine.toml")
    assert code == 0, err
    assert "note a.csv: 1 gap (2.999 to 3.2 s); the pieces between are used" in flat(out + err)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.csv", "-o", "machine.toml"], "--machine is needed"),
        (["a.csv", "--machine", "start.toml", "-o", "machine.ini"], 'the suffix ".ini" must be .toml'),
        (["a.csv", "--machine", "start.toml", "-o", "start.toml"], "is an input of this command"),
        (["none.csv", "--machine", "start.toml", "-o", "machine.toml"], "none.csv: cannot be read"),
        (["inch.csv", "--machine", "start.toml", "-o", "machine.toml"], "as if a unit were wrong by 25.4 in length"),
        (["bare.csv", "--machine", "start.toml", "-o", "machine.toml"], 'the column "X" must name its unit'),
        (["a.csv", "start.toml", "--machine", "start.toml", "-o", "machine.toml"], "no column is an axis"),
    ],
)
def test_what_is_refused(folder, run, arguments, said):
    log = made_log("trapezoid")
    write_log(folder / "a.csv", log)
    write_log(folder / "inch.csv", log, "t_s,X_inch,Y_inch,Z_inch")
    write_log(folder / "bare.csv", log, "t_s,X,Y,Z")
    code, out, err = run("calibrate", *arguments)
    assert code == 2
    assert said in flat(out + err)
    assert not (folder / "machine.toml").exists()
    assert (folder / "start.toml").read_text() == START


def test_the_log_of_another_program(folder, run):
    write_log(folder / "a.csv", made_log("trapezoid"))
    (folder / "a.ngc").write_text("G21 G90\nG1 X200 F3000\nG1 Y100\nG1 X0\nM2\n")
    code, out, err = run("calibrate", "a.csv", "--machine", "start.toml", "-o", "machine.toml")
    assert code == 2
    assert "is not a log of a.ngc" in flat(out + err)
