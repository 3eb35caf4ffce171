"""Logs as files have them, and everything that can be wrong with one."""

import numpy as np
import pytest

from planner.calibration.log import MIN_SAMPLES, log_of_text, read_log
from planner.errors import InputError

COUNT = 2 * MIN_SAMPLES


def text(head="t_s,X_mm,Y_mm", rows=None, mark=","):
    rows = [(0.001 * k, 0.5 * k, -0.25 * k) for k in range(COUNT)] if rows is None else rows
    return "\n".join([head, *(mark.join(f"{v:.9g}" for v in row) for row in rows)]) + "\n"


class TestWhatIsRead:
    def test_time_and_axes(self):
        log = log_of_text(text(), "a.csv")
        assert log.axes == ("X", "Y")
        assert log.period == pytest.approx(0.001)
        assert log.notes == ()
        assert log.position[3] == pytest.approx([1.5, -0.75])
        assert log.pieces == (slice(0, COUNT),)

    @pytest.mark.parametrize(
        ("head", "length", "time"),
        [
            ("t_ms,X_inch,Y_inch", 25.4, 1e-3),
            ("time (us), x [m], y [m]", 1000.0, 1e-6),
            ("Time_min,X mm,Y mm", 1.0, 60.0),
            ("t_ns,Y_mm,X_mm", 1.0, 1e-9),
        ],
    )
    def test_units(self, head, length, time):
        log = log_of_text(text(head), "a.csv")
        x = 0.5 if "Y_mm,X" not in head else -0.25
        assert log.period == pytest.approx(1e-3 * time)
        assert log.position[1, 0] == pytest.approx(x * length)

    def test_axes_that_turn(self):
        log = log_of_text(text("t_s,A_deg,C_rev"), "a.csv")
        assert log.position[1] == pytest.approx([np.radians(0.5), -0.5 * np.pi])

    @pytest.mark.parametrize("mark", [";", "\t"])
    def test_other_marks_remarks_and_other_columns(self, mark):
        rows = [(k, 7.0, k) for k in range(COUNT)]
        log = log_of_text("# of the router\n\n" + text(mark.join(["t_ms", "spindle", "Z_mm"]), rows, mark), "a.csv")
        assert log.axes == ("Z",)
        assert "spindle" in log.notes[0]

    def test_positions_alone_with_a_period(self, tmp_path):
        file = tmp_path / "a.csv"
        file.write_text(text("X_mm,Y_mm", [(k, k) for k in range(COUNT)]))
        assert read_log(file, 0.004).t[-1] == pytest.approx(0.004 * (COUNT - 1))

    def test_gaps_cut_it_into_pieces_and_are_said(self):
        t = np.arange(200) * 1e-3
        t[50:] += 0.3
        t[100:] += 0.2
        t[105:] += 0.1
        log = log_of_text(text("t_s,X_mm", list(zip(t, t, strict=True))), "a.csv")
        assert log.pieces == (slice(0, 50), slice(50, 100), slice(105, 200))
        assert "3 gaps (0.049 to 0.35 s" in log.notes[0]
        assert "less than" in log.notes[1]


class TestWhatIsWrong:
    @pytest.mark.parametrize(
        ("content", "said"),
        [
            ("", "is empty"),
            ("1,2,3\n4,5,6\n", "no column is an axis"),
            (text("t_s,X,Y_mm"), 'column "X" must name its unit, one of mm, m, inch: write X_mm'),
            (text("t,X_mm,Y_mm"), 'column "t" must name its unit'),
            (text("t_s,X_furlong,Y_mm"), "must name its unit"),
            (text("t_s,X_mm,x_inch"), 'the columns "X_mm" and "x_inch" are both X'),
            (text("t_s,t_ms,x_inch"), "are both time"),
            (text("t_s,X_mm"), "a.csv:2: 3 cells; a row must have 2"),
            (text("X_mm,Y_mm,Z_mm"), "no column of time"),
            (text("t_s,speed,load"), "no column is an axis"),
            (text(rows=[(0.0, 1.0, 2.0)] * 3), "3 samples; a log needs"),
            (text().replace("10,-5", "nan,-5"), "a.csv:22: X_mm = nan must be finite"),
            (text().replace("10,-5", "inf,-5"), "a.csv:22: X_mm = inf must be finite"),
            (text().replace("10,-5", "ten,-5"), 'a.csv:22: X_mm: "ten" must be a number'),
            (text().replace("0.02,", "0.018,"), "a.csv:22: time 0.018 s follows 0.019 s"),
            (text().replace("0.02,", "0.019,"), "time must grow"),
        ],
    )
    def test_is_said_with_its_place(self, content, said):
        with pytest.raises(InputError) as caught:
            log_of_text(content, "a.csv")
        assert said in str(caught.value)

    def test_gaps_everywhere(self):
        t = np.cumsum(np.where(np.arange(80) % 10 == 0, 0.5, 0.001))
        with pytest.raises(InputError, match="without a gap"):
            log_of_text(text("t_s,X_mm", list(zip(t, t, strict=True))), "a.csv")

    def test_time_and_a_period(self):
        with pytest.raises(InputError, match="leave the period out"):
            log_of_text(text(), "a.csv", 0.001)

    def test_no_file(self, tmp_path):
        with pytest.raises(InputError, match="cannot be read"):
            read_log(tmp_path / "none.csv")
