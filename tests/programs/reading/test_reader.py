"""The reader of part programs: what is read, what is refused and with which words."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from planner.errors import InputError
from planner.programs.reading.program import ARC, LINE, RAPID, Program
from planner.programs.reading.reader import read_program

END = "\nM2\n"


class TestWordsThatWait:
    """What LinuxCNC waits for is an event, in the order of the program, and no stop of the plan."""

    def test_signals_offsets_and_messages(self, read):
        text = "F60\nG1 X1\n(MSG, one)\nX2\nM64 P1\nX3\nM62 P1\nG43 H0\n(no message) X4\n; (MSG, none)\nX5" + END
        p = read(text)
        found = [(event.kind, event.after_move) for event in p.events if event.kind != "end"]
        assert found == [("message", 0), ("signal", 1), ("offset", 2)]
        assert p.stop_after.tolist() == [False] * 4 + [True]


class TestMoves:
    def test_lines_and_rapids_become_rows(self, read):
        p = read("G0 X1 Y2\nG1 X4 Y6 F600\n\nY8 Z-1\nG0 Z5\nM2\n")
        assert p.line.tolist() == [2, 4, 5]
        assert p.kind.tolist() == [LINE, LINE, RAPID]
        assert p.start[:, :3].tolist() == [[1, 2, 0], [4, 6, 0], [4, 8, -1]]
        assert p.end[:, :3].tolist() == [[4, 6, 0], [4, 8, -1], [4, 8, 5]]
        assert p.feed.tolist() == [10.0, 10.0, np.inf]
        assert np.isnan(p.centre).all()
        assert p.sweep.tolist() == [0, 0, 0]
        assert p.line_count == 6
        assert p.source == "part.ngc"
        assert len(p) == 3

    def test_arrays_are_read_only(self, read):
        p = read("G0 X1\nG1 X4 F600" + END)
        for name in ("line", "kind", "start", "end", "centre", "sweep", "feed", "stop_after", "tolerance"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(p, name)[...] = 0

    def test_inches(self, read):
        p = read("G20\nG64 P0.001 Q0.002\nG0 X0\nG1 X1 F60\nG2 X1 Y0 I0 J1\nG21\nG1 X0 F60" + END)
        assert p.end[:, 0] == pytest.approx([25.4, 25.4, 0.0], rel=1e-15)
        assert p.feed == pytest.approx([25.4, 25.4, 1.0], rel=1e-15)
        assert p.centre[1] == pytest.approx([25.4, 25.4, 0.0], rel=1e-15)
        assert p.tolerance == pytest.approx(np.full(3, 0.0254), rel=1e-15)
        assert p.naive_tolerance == pytest.approx(np.full(3, 0.0508), rel=1e-15)

    def test_a_feed_beside_the_units_counts_in_those_before(self, read):
        p = read("F600\nG20 G1 X1 F5\nX2 F3\nG21 X3 F2\nG21 X4 F1" + END)
        assert p.feed == pytest.approx([5 / 60, 3 * 25.4 / 60, 2 * 25.4 / 60, 1 / 60], rel=1e-14)
        note = "F beside G20 or G21 counts in the units before, as on LinuxCNC, in 2 blocks, the first in line 2"
        assert note in p.notes

    def test_incremental_distances(self, read):
        p = read("G0 X10\nG91\nG1 X1 F60\nX1 Y2\nG90 X5\nG91 X1" + END)
        assert p.end[:, :2].tolist() == [[11, 0], [12, 2], [5, 2], [6, 2]]

    def test_many_increments_do_not_drift(self, read):
        p = read("G91 F60\n" + "G1 X0.1\n" * 20000 + "M2\n")
        assert p.end[:, 0] == pytest.approx(0.1 * np.arange(1, 20001), abs=1e-8)

    def test_the_tolerance_of_merging_may_stand_alone(self, read):
        p = read("F60\nG64 Q0.1\nG1 X1" + END)
        assert np.isnan(p.tolerance).all()
        assert p.naive_tolerance.tolist() == [0.1]

    def test_the_angle_of_the_spindle_is_no_radius(self, read):
        p = read("F60\nG2 X2 I1\nM19 R10\nX4 I1" + END)
        assert p.line.tolist() == [2, 4]

    def test_inverse_time_makes_a_feed_of_every_length(self, read):
        p = read("G93\nG1 X3 Y4 F2\nG3 X3 Y4 I1 J0 F4\nG94 G1 X0 F120" + END)
        assert p.feed == pytest.approx([5 / 30, 2 * np.pi / 15, 2.0], rel=1e-14)

    def test_the_modal_feed_of_rapids(self, read):
        """What a controller that knows no rapid runs them at; a word on their own line counts."""
        p = read("G91\nG0 X1\nF600 X1\nG1 X1 F300\nG0 X1\nX1 F120\nG93 G1 X1 F2\nG0 X1\nG94 X1\nX1 F60" + END)
        assert p.modal_feed == pytest.approx([np.nan, 10, 5, 5, 2, 1 / 30, np.nan, np.nan, 1], nan_ok=True)
        assert np.isinf(p.feed[p.kind == RAPID]).all()
        assert (p.modal_feed == p.feed)[p.kind != RAPID].all()

    def test_tolerance_follows_the_path_modes(self, read):
        p = read("F60\nG1 X1\nG64 P0.02 Q0\nX2\nG61\nX3\nG61.1\nX4\nG64\nX5\nG64 P.5\nX6" + END)
        assert p.tolerance == pytest.approx([np.nan, 0.02, 0, 0, np.nan, 0.5], nan_ok=True)
        assert p.naive_tolerance == pytest.approx([np.nan, 0, np.nan, np.nan, np.nan, np.nan], nan_ok=True)
        assert p.stop_after.tolist() == [False, False, False, True, False, True]  # G61 is no exact stop
        assert p.exact_stop.tolist() == [False, False, False, True, False, False]

    def test_rapids_stop_at_both_ends(self, read):
        p = read("F60\nG1 X1\nX2\nG0 X3\nX4\nG1 X5\nX6" + END)
        assert p.stop_after.tolist() == [False, True, True, True, False, True]

    @pytest.mark.parametrize("word", ["G4 P0.5", "M0", "M1", "M6 T1"])
    def test_dwells_stops_and_tool_changes_stop_before_them(self, read, word):
        p = read(f"F60\nG1 X1\n{word}\nX2\nX3" + END)
        assert p.stop_after.tolist() == [True, False, True]

    @pytest.mark.parametrize("word", ["M3 S100", "M5", "M8", "S500", "T4", "G17", "(x)", "F30"])
    def test_switches_do_not_stop(self, read, word):
        p = read(f"F60\nG1 X1\n{word}\nX2\nX3" + END)
        assert p.stop_after.tolist() == [False, False, True]


class TestFirstPosition:
    def test_the_first_rapid_starts_at_its_end(self, read):
        p = read("G0 X5 Y6\nZ3\nG1 Z-1 F60" + END)
        assert p.start[:, :3].tolist() == [[5, 6, 3]]
        assert p.zero_lines.tolist() == [1, 2]

    def test_an_axis_that_cuts_first_stands_at_zero(self, read):
        p = read("G0 X5\nG1 X6 Y1 F60" + END)
        assert p.start[:, :3].tolist() == [[5, 0, 0]]

    def test_an_increment_starts_at_zero(self, read):
        assert read("G91 G0 X5" + END).start[:, :3].tolist() == [[0, 0, 0]]

    def test_it_can_be_given(self, read):
        p = read("G0 X5 Y6\nG1 X7 F60" + END, start=(1, 2, 3))
        assert p.start[:, :3].tolist() == [[1, 2, 3], [5, 6, 3]]
        assert p.end[:, :3].tolist() == [[5, 6, 3], [7, 6, 3]]

    @pytest.mark.parametrize("start", [(1, 2), (1, 2, np.nan), "abc"])
    def test_it_must_be_a_point(self, read, start):
        with pytest.raises(InputError, match=r"^start"):
            read("G0 X5" + END, start=start)

    def test_an_axis_named_late_stood_there_from_the_start(self, read, monkeypatch):
        """The parts a file is read in do not matter."""
        text = "F60\nG1 X1\n" + "G1 Y1\nG1 Y2\n" * 50 + "G18\nG3 X3 I1\nG0 Z7\nG1 Z8" + END
        whole = read(text)
        assert whole.start[:-1, 2].tolist() == [7.0] * (len(whole) - 1)
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 40)
        parts = read(text)
        assert parts.start.tolist() == whole.start.tolist()
        assert parts.end.tolist() == whole.end.tolist()


class TestShortMoves:
    def test_a_move_of_no_length_keeps_its_line_and_its_words(self, read):
        p = read("F60\nG1 X1\nX1 F120 M8\nX2" + END)
        assert p.line.tolist() == [2, 4]
        assert p.zero_lines.tolist() == [3]
        assert p.feed.tolist() == [1.0, 2.0]
        assert [(e.kind, e.line, e.after_move) for e in p.events] == [("coolant", 3, 0), ("end", 5, 1)]

    def test_many_short_moves_are_not_lost(self, read):
        p = read("F60\nG91\n" + "G1 X0.0000004\n" * 1000 + "M2\n")
        assert p.end[-1, 0] == pytest.approx(0.0004, abs=1e-6)
        assert (p.lengths >= 1e-6).all()
        assert len(p) + p.zero_lines.size == 1000

    def test_the_threshold(self, read):
        p = read("F60\nG1 X0.0000009\nX0.0000021" + END)
        assert p.line.tolist() == [3]
        assert p.start[0, 0] == 0.0

    def test_every_moving_line_is_a_row_or_a_line_of_no_length(self, read, monkeypatch):
        rng = np.random.default_rng(5)
        lines = [f"G1 X{x} Y{y}" for x, y in rng.integers(0, 3, size=(500, 2))]
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 100)
        p = read("F60\n" + "\n".join(lines) + END)
        assert sorted([*p.line.tolist(), *p.zero_lines.tolist()]) == list(range(2, 502))
        assert (p.end[:-1] == p.start[1:]).all()


class TestEvents:
    def test_they_stand_where_a_controller_acts_on_them(self, read):
        p = read("T3 M6\nS9000 M3\nG0 X0\nF60 M8\nG1 X1 M0\nX2 M9 S8000\nG4 P1.5\nM5\nM30\n")
        assert [(e.line, e.kind, e.seconds, e.after_move, e.text) for e in p.events] == [
            (1, "tool_change", 0.0, -1, "M6 T3"),
            (2, "spindle", 0.0, -1, "M3 S9000"),
            (4, "coolant", 0.0, -1, "M8"),
            (5, "stop", 0.0, 0, "M0"),
            (6, "spindle", 0.0, 0, "S8000"),
            (6, "coolant", 0.0, 0, "M9"),
            (7, "dwell", 1.5, 1, "G4 P1.5"),
            (8, "spindle", 0.0, 1, "M5"),
            (9, "end", 0.0, 1, "M30"),
        ]

    def test_a_speed_that_does_not_change_is_no_event(self, read):
        p = read("F60\nS100\n" + "G1 X1 S100\nX2 S100\n" + "M2\n")
        assert [(e.line, e.kind) for e in p.events] == [(2, "spindle"), (5, "end")]

    def test_a_tool_selected_earlier(self, read):
        p = read("T7\nG0 X1\nM6" + END)
        assert [(e.kind, e.text) for e in p.events] == [("tool", "T7"), ("tool_change", "M6 T7"), ("end", "M2")]


@pytest.mark.skipif(shutil.which("rs274") is None, reason="LinuxCNC's interpreter rs274 is not installed")
class TestAgainstLinuxCNC:
    """Random programs, read by LinuxCNC's own interpreter."""

    CALL = re.compile(r"(STRAIGHT_TRAVERSE|STRAIGHT_FEED|ARC_FEED|SET_FEED_RATE|DWELL)\((.*)\)")

    def canonical(self, text: str, tmp_path) -> list[tuple[str, list[float]]]:
        (tmp_path / "part.ngc").write_text(text)
        for name in ("tool.tbl", "var"):
            (tmp_path / name).write_text("")
        command = ["rs274", "-g", "-n", "2", "-t", "tool.tbl", "-v", "var", "part.ngc"]
        run = subprocess.run(
            command, cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=20, check=True,
            env={**os.environ, "HOME": str(tmp_path)},
        )  # fmt: skip
        return [(m[1], [float(x) for x in m[2].split(",")]) for m in self.CALL.finditer(run.stdout)]

    def random_program(self, seed: int) -> str:
        rng = np.random.default_rng(seed)
        text = "G21 G17 G90 G94 F300\nG0 X0 Y0 Z0\n"
        for _ in range(40):
            a, b, r = rng.normal(size=3).round(3) * 10
            turn, side = rng.integers(2, 4), rng.choice([-1, 1])
            blocks = (
                f"G1 X{a:.3f} Y{b:.3f}",
                f"G91 G1 X{a:.3f} Z{b:.3f} F{abs(r) + 1:.2f}\nG90",
                f"G0 Z{r:.3f}",
                f"G17 G{turn} X{a:.3f} Y{b:.3f} R{side * 80}",
                f"G18 G{turn} X{a:.3f} Z{b:.3f} R90",
                f"G19 G3 J{a:.3f} K{b:.3f} X{r:.3f}",
                f"G17 G91 G2 X{2 * a:.3f} Y{2 * b:.3f} Z1 I{a:.3f} J{b:.3f}\nG90",
                f"G4 P{abs(r):.3f}",
            )
            text += blocks[rng.integers(len(blocks))] + "\n"
        return text + "M2\n"

    @pytest.mark.parametrize("seed", range(12))
    def test_the_same_end_points_centres_and_feeds(self, tmp_path, seed):
        text = self.random_program(seed)
        path = tmp_path / "ours.ngc"
        path.write_text(text)
        ours, calls = read_program(path, start=(0, 0, 0)), self.canonical(text, tmp_path)
        moves, feed, dwells = [], 300.0, []
        for name, values in calls:
            if name == "SET_FEED_RATE":
                feed = values[0]
            elif name == "DWELL":
                dwells.append(values[0])
            else:
                moves.append((name, values, feed))
        moves = moves[1:]  # to where both start
        assert len(moves) == len(ours) > 20
        for k, (name, values, rate) in enumerate(moves):
            self.compare(ours, k, name, values)
            assert ours.kind[k] == RAPID or 60.0 * ours.feed[k] == pytest.approx(rate, abs=1e-3)
        assert dwells == pytest.approx([e.seconds for e in ours.events if e.kind == "dwell"], abs=1e-3)

    def compare(self, ours: Program, k: int, name: str, values: list[float]) -> None:
        if name == "ARC_FEED":
            i, j, h = {2: (0, 1, 2), 1: (2, 0, 1), 0: (1, 2, 0)}[int(ours.normal[k])]
            expected = [ours.end[k, i], ours.end[k, j], ours.centre[k, i], ours.centre[k, j]]
            assert ours.kind[k] == ARC
            assert values[:4] == pytest.approx(expected, abs=1e-3)
            assert values[5] == pytest.approx(ours.end[k, h], abs=1e-3)
            assert np.sign(values[4]) == np.sign(ours.sweep[k])
        else:
            assert ours.kind[k] == (RAPID if name == "STRAIGHT_TRAVERSE" else LINE)
            assert values[:3] == pytest.approx(ours.end[k, :3], abs=1e-3)
