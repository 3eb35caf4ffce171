"""The reader of part programs: what is read, what is refused and with which words."""

import re
import shutil
import subprocess

import numpy as np
import pytest
import reader_reference as reference

from planner import load_curve
from planner.compiled import core
from planner.errors import InputError
from planner.programs.reading.program import ARC, LINE, RAPID, Program
from planner.programs.reading.reader import read_program

END = "\nM2\n"


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
        p = read("G20\nG64 P0.001 Q0.002\nG0 X0\nG1 X1 F60\nG2 X1 Y0 I0 J1\nG21 G1 X0 F60" + END)
        assert p.end[:, 0] == pytest.approx([25.4, 25.4, 0.0], rel=1e-15)
        assert p.feed == pytest.approx([25.4, 25.4, 1.0], rel=1e-15)
        assert p.centre[1] == pytest.approx([25.4, 25.4, 0.0], rel=1e-15)
        assert p.tolerance == pytest.approx(np.full(3, 0.0254), rel=1e-15)
        assert p.naive_tolerance == pytest.approx(np.full(3, 0.0508), rel=1e-15)

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

    def test_the_slowest_feed_under_inverse_time(self, read):
        assert read("G93\nG1 X0.01 F1" + END).feed.tolist() == pytest.approx([0.1 / 60.0])

    def test_inverse_time_makes_a_feed_of_every_length(self, read):
        p = read("G93\nG1 X3 Y4 F2\nG3 X3 Y4 I1 J0 F4\nG94 G1 X0 F120" + END)
        assert p.feed == pytest.approx([5 / 30, 2 * np.pi / 15, 2.0], rel=1e-14)

    def test_tolerance_follows_the_path_modes(self, read):
        p = read("F60\nG1 X1\nG64 P0.02 Q0\nX2\nG61\nX3\nG61.1\nX4\nG64\nX5\nG64 P.5\nX6" + END)
        assert p.tolerance == pytest.approx([np.nan, 0.02, 0, 0, np.nan, 0.5], nan_ok=True)
        assert p.naive_tolerance == pytest.approx([np.nan, 0, np.nan, np.nan, np.nan, np.nan], nan_ok=True)
        assert p.stop_after.tolist() == [False, False, True, True, False, True]

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


class TestArcs:
    @pytest.mark.parametrize(
        ("plane", "normal", "first", "second"), [("G17", 2, "X", "Y"), ("G18", 1, "Z", "X"), ("G19", 0, "Y", "Z")]
    )
    @pytest.mark.parametrize(("code", "sign"), [("G3", 1.0), ("G2", -1.0)])
    def test_a_quarter_in_each_plane(self, read, plane, normal, first, second, code, sign):
        offset = {"X": "I", "Y": "J", "Z": "K"}
        p = read(f"{plane} F60\nG1 {first}5 {second}0\n{code} {first}0 {second}{5 * sign} {offset[first]}-5" + END)
        assert p.normal[1] == normal
        assert p.sweep[1] == pytest.approx(sign * np.pi / 2, rel=1e-15)
        assert p.centre[1].tolist() == [0, 0, 0]
        # By the right-hand rule about the normal, the sweep takes the start to the end.
        axis = np.eye(3)[normal]
        arm = p.start[1, :3] - p.centre[1]
        turned = arm * np.cos(p.sweep[1]) + np.cross(axis, arm) * np.sin(p.sweep[1])
        assert p.centre[1] + turned == pytest.approx(p.end[1, :3], abs=1e-12)

    def test_a_full_circle(self, read):
        p = read("F60\nG2 I5\nG3 X0 Y0 J-2" + END)
        assert p.sweep.tolist() == [-2 * np.pi, 2 * np.pi]
        assert p.lengths == pytest.approx([10 * np.pi, 4 * np.pi], rel=1e-15)

    def test_a_helix(self, read):
        p = read("F60\nG3 X0 Y0 Z3 I4" + END)
        assert p.kind.tolist() == [ARC]
        assert p.lengths == pytest.approx([np.hypot(8 * np.pi, 3.0)], rel=1e-15)
        assert p.centre.tolist() == [[4, 0, 0]]

    @pytest.mark.parametrize(
        ("words", "centre", "sweep"),
        [
            ("G3 X6 Y0 R5", (3, 4), 2 * np.arcsin(0.6)),
            ("G3 X6 Y0 R-5", (3, -4), 2 * np.pi - 2 * np.arcsin(0.6)),
            ("G2 X6 Y0 R5", (3, -4), -2 * np.arcsin(0.6)),
            ("G2 X6 Y0 R-5", (3, 4), -(2 * np.pi - 2 * np.arcsin(0.6))),
            ("G3 X10 Y0 R5", (5, 0), np.pi),
        ],
    )
    def test_the_radius_form(self, read, words, centre, sweep):
        p = read(f"F60\n{words}" + END)
        assert p.centre[0, :2] == pytest.approx(centre, abs=1e-12)
        assert p.sweep == pytest.approx([sweep], rel=1e-12)

    def test_a_radius_short_by_its_digits_is_a_half_turn(self, read, refusal):
        """LinuxCNC takes 0.00127 mm of half the chord, whatever its length and unit."""
        p = read("F60\nG3 X10 Y0 R4.9999" + END)
        assert p.centre[0, :2] == pytest.approx((5, 0), abs=1e-12)
        assert abs(p.sweep[0]) == pytest.approx(np.pi)
        assert refusal("F60\nG3 X10 Y0 R4.99" + END).startswith("2: R4.99: start and end are 0.02 mm farther apart")
        for chord in (2.0, 20.0, 2000.0):
            assert len(read(f"F60\nG3 X{chord} Y0 R{chord / 2 - 0.00126:.5f}" + END)) == 1
            assert "farther apart" in refusal(f"F60\nG3 X{chord} Y0 R{chord / 2 - 0.00128:.5f}" + END)
        assert len(read("G20 F60\nG3 X2 Y0 R0.99996" + END)) == 1
        assert "farther apart" in refusal("G20 F60\nG3 X2 Y0 R0.99994" + END)

    def test_absolute_centres(self, read):
        p = read("F60\nG90.1\nG1 X10\nG3 X0 Y10 I0 J0\nG91.1 G3 X-10 Y0 J-10" + END)
        assert p.centre[1:, :2].tolist() == [[0, 0], [0, 0]]
        assert p.sweep[1:] == pytest.approx([np.pi / 2, np.pi / 2])

    @pytest.mark.parametrize("end", ["0.0049", "-0.0049"])
    def test_a_small_mismatch_of_the_radius_is_a_spiral(self, read, end):
        p = read(f"F60\nG1 X5\nG3 X{end} Y5 I-5" + END)
        radii = np.hypot(*(np.stack([p.start[1, :3], p.end[1, :3]]) - p.centre[1])[:, :2].T)
        assert radii == pytest.approx([5.0, np.hypot(5.0, 0.0049)], rel=1e-12)

    @pytest.mark.parametrize(
        ("unit", "radius", "allowed"),
        [
            ("G21", 1.0, 0.02828),
            ("G21", 20.0, 0.02828),
            ("G21", 100.0, 0.1),
            ("G21", 1000.0, 1.0),
            ("G21", 5000.0, 2.828),
            ("G20", 1.0, 0.002828),
            ("G20", 100.0, 0.1),
            ("G20", 500.0, 0.2828),
        ],
    )
    def test_what_the_radii_may_differ_by(self, read, refusal, unit, radius, allowed):
        """LinuxCNC's bounds, measured: 0.0283 mm or 0.00283 in, or 0.1 %, never more than 100 times the first."""
        for share, taken in ((0.995, True), (1.005, False)):
            far = radius + share * allowed  # of the larger radius 0.1 % is a little more
            text = f"{unit} F60\nG1 X{radius}\nG3 X{-far:.6f} Y0 I{-radius}" + END
            if taken:
                assert len(read(text)) == 2
            else:
                assert "they may differ by" in refusal(text)

    def test_an_arc_of_two_decimals_that_the_machine_runs(self, read):
        p = read("F60\nG1 X13.88 Y-39.21\nG3 X-22.28 Y-47.07 I-17.95 J-4.56" + END)
        assert p.end[1, :2].tolist() == [-22.28, -47.07]

    @pytest.mark.parametrize(("code", "sign"), [("G2", -1.0), ("G3", 1.0)])
    def test_several_turns(self, read, code, sign):
        p = read(f"F60\nG1 X4\n{code} X4 Y0 Z5 I-4 P5\n{code} X{4 if sign < 0 else -4} Y0 I-4 P2" + END)
        assert p.sweep[1] == pytest.approx(sign * 10 * np.pi, rel=1e-15)
        assert p.lengths[1] == pytest.approx(np.hypot(40 * np.pi, 5), rel=1e-14)
        assert p.sweep[2] == pytest.approx(sign * (4 if sign < 0 else 3) * np.pi, rel=1e-14)

    @pytest.mark.parametrize("turns", ["0", "1.5"])
    def test_turns_are_whole(self, refusal, turns):
        assert refusal(f"F60\nG3 I4 P{turns}\nM2") == (
            f"2: P{turns}: the turns of an arc must be a whole number of at least 1"
        )

    def test_turns_of_a_thread_are_planned(self, tmp_path):
        path = tmp_path / "thread.ngc"
        path.write_text("F800\nG1 X4\nG3 X4 Y0 Z-4 I-4 P5\nG1 X0\nM2\n")
        curve = load_curve(path, tolerance=0.01)
        assert curve.length == pytest.approx(8 + np.hypot(40 * np.pi, 4), abs=0.05)

    def test_a_full_circle_of_a_kilometre_is_said(self, read):
        p = read("F60\nG3 I-200000" + END)
        assert p.notes == (
            "line 2: start and end lie in one direction from the centre: by rule 1 full turns, 1256.64 m on a radius of "
            "200000 mm",
        )

    def test_the_length_of_a_spiral(self, read):
        p = read("F60\nG1 X10\nG3 X-10.005 Y0 I-10" + END)
        theta = np.linspace(0, np.pi, 200001)
        r = 10 + 0.005 * theta / np.pi
        exact = np.hypot(np.diff(r * np.cos(theta)), np.diff(r * np.sin(theta))).sum()
        assert p.lengths[1] == pytest.approx(exact, rel=1e-9)

    def test_a_modal_arc(self, read):
        p = read("F60\nG3 X10 I5\nX0 I-5" + END)
        assert p.kind.tolist() == [ARC, ARC]
        assert p.sweep == pytest.approx([np.pi, np.pi])


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


class TestText:
    def test_lower_case_tabs_crlf_comments_and_numbers(self, read):
        text = (
            "%\r\n(header: Größe)\r\nn10\tg01 x+1.50y-.5\tf 60 ; to the end (\r\nN20 ( in between ) X2. Y00.25\r\n%\r\n"
        )
        p = read(text)
        assert p.end[:, :2].tolist() == [[1.5, -0.5], [2.0, 0.25]]
        assert p.line.tolist() == [3, 4]
        assert p.line_count == 5

    def test_a_byte_order_mark(self, read):
        assert len(read(b"\xef\xbb\xbfG1 X1 F60" + END.encode())) == 1

    def test_no_newline_at_the_end(self, read):
        assert read("G1 X1 F60\nM2").line_count == 2

    @pytest.mark.parametrize("digits", ["0.1", "123456.7890123", "3.14159265358979", "1e-9"[:1], "0.30000000000000004"])
    def test_numbers_are_the_nearest_doubles(self, read, digits):
        assert read(f"G1 X{digits} F60" + END).end[0, 0] == float(digits)

    def test_random_numbers_are_the_nearest_doubles(self, read):
        rng = np.random.default_rng(3)
        written = [f"{x:.{k}f}" for x, k in zip(rng.normal(size=400) * 1e3, rng.integers(0, 13, 400), strict=True)]
        p = read("F60\n" + "\n".join(f"G1 X{w} Z{i + 1}" for i, w in enumerate(written)) + END)
        assert p.end[:, 0].tolist() == [float(w) for w in written]

    def test_the_parts_it_is_read_in_do_not_matter(self, read, monkeypatch):
        rng = np.random.default_rng(4)
        pool = [
            "G1",
            "G91 G1",
            "G90 G1",
            "G20 G1",
            "G21 G1",
            "F120\n",
            "G61\n",
            "G64 P0.1\n",
            "G0",
            "S5 M3\n",
            "G4 P1\n",
        ]
        text = "F60\n"
        for x, y, k in zip(*rng.normal(size=(2, 300)), rng.integers(0, len(pool), 300), strict=True):
            text += f"{pool[k]} X{x:.3f} Y{y:.3f}\n"
        whole = read(text + END)
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 64)
        parts = read(text + END)
        for name in ("line", "kind", "feed", "stop_after", "tolerance", "zero_lines"):
            assert np.array_equal(getattr(whole, name), getattr(parts, name), equal_nan=True), name
        assert parts.end == pytest.approx(whole.end, abs=1e-9)
        assert parts.events == whole.events
        assert parts.line_count == whole.line_count


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
            command, cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=20, check=True
        )
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


class TestCompiled:
    """Words and moves are those of plain Python, whatever the characters are."""

    @staticmethod
    def scanned(text, scan):
        size = len(text) // 2 + 2 + text.count(b"%")
        columns = [np.zeros(size, dtype=d) for d in (np.uint8, np.float64, np.int32, np.int32, np.int32)]
        fault = np.zeros(3, dtype=np.int64)
        count = scan(text, *columns, fault)
        return count, fault.tolist(), [column[:count].tobytes() for column in columns]

    @staticmethod
    def compiled(text, *columns):
        return core.words_scan(len(text), np.frombuffer(text, dtype=np.uint8), *columns)

    def agree(self, text):
        found = self.scanned(text, self.compiled)
        assert found == self.scanned(text, lambda text, *columns: reference.scan_words(list(text), *columns))
        return found

    @pytest.mark.parametrize(
        "number",
        [
            *(
                "0",
                "-0",
                "+.5",
                "1.",
                "-.",
                ".",
                "",
                "1.2.3",
                "--1",
                "007",
                "  \t12",
                "1 2",
                "3.141592653589793238462643",
            ),
            *("9" * 400, "0." + "0" * 400 + "7", "1" + "0" * 30 + ".5", "123456789012345678.9", "99999999999999999.99"),
            *("0." + "0" * k + "123" for k in (18, 19, 20, 21, 22, 23, 30)),
        ],
    )
    def test_numbers(self, number):
        self.agree(b"X" + number.encode())
        self.agree(b"x" + number.encode() + b"\nY1")

    def test_numbers_with_few_digits_are_those_of_python(self):
        rng = np.random.default_rng(3)
        texts = [
            f"{value:.{digits}f}"
            for value, digits in zip(rng.normal(0, 300, 500), rng.integers(0, 9, 500), strict=True)
        ]
        count, _, columns = self.agree("\n".join("X" + text for text in texts).encode())
        assert count == 500
        assert np.frombuffer(columns[1]).tolist() == [float(text) for text in texts]

    @pytest.mark.parametrize("seed", range(300))
    def test_characters_at_random(self, seed):
        rng = np.random.default_rng(seed)
        likely = rng.choice(list(b"GXYZFNMxy0123456789.-+ \t\r\n\n();%"), int(rng.integers(0, 60)))
        text = bytearray(bytes(likely.astype(np.uint8).tolist()))
        if text and seed % 3 == 0:
            text[rng.integers(len(text))] = rng.integers(256)
        self.agree(bytes(text))

    def test_every_fault_is_among_them(self):
        seen = set()
        for text in (
            b"X1 \x80",
            b"X1 #2",
            b"12",
            b"X Y1",
            b"(a\nX1",
            b"(a(b)",
            b";only\x07",
            b"(never",
            b"; to the end",
        ):
            _, fault, _ = self.agree(text)
            seen.add(fault[0])
        assert seen == {0, 1, 2, 3, 4, 5}

    @pytest.mark.parametrize("axes", [3, 9])
    def test_moves_that_lead_nowhere(self, axes):
        rng = np.random.default_rng(9)
        ends = np.cumsum(rng.choice([0.0, 1e-7, 4e-7, 1e-6, 0.1], (400, axes), p=[0.8, 0.05, 0.05, 0.05, 0.05]), axis=0)
        always = rng.random(400) < 0.05
        ours, theirs = np.zeros(axes), np.zeros(axes)
        core.reader_merge_short_moves(400, axes, ends, always, 1e-6, ours, kept := np.empty(400, dtype=np.uint8))
        reference.merge_short_moves(ends, always, 1e-6, theirs, expected := np.empty(400, dtype=np.uint8))
        assert kept.tobytes() == expected.tobytes()
        assert ours.tobytes() == theirs.tobytes()
        assert 20 < kept.sum() < 400
