"""The reader of part programs: what is read, what is refused and with which words."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from planner.errors import InputError
from planner.machine.limits import Limits
from planner.programs.reading.program import ARC, LINE, RAPID, Program
from planner.programs.reading.reader import read_program

END = "\nM2\n"


@pytest.fixture
def read(tmp_path):
    def read(text: str | bytes, **options) -> Program:
        path = tmp_path / "part.ngc"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_program(path, **options)

    return read


@pytest.fixture
def refusal(read):
    """What the reader says of a program, without the name of the file."""

    def refusal(text: str | bytes) -> str:
        with pytest.raises(InputError) as caught:
            read(text)
        message = str(caught.value)
        assert message.startswith("part.ngc:")
        return message.removeprefix("part.ngc:")

    return refusal


class TestMoves:
    def test_lines_and_rapids_become_rows(self, read):
        p = read("G0 X1 Y2\nG1 X4 Y6 F600\n\nY8 Z-1\nG0 Z5\nM2\n")
        assert p.line.tolist() == [2, 4, 5]
        assert p.kind.tolist() == [LINE, LINE, RAPID]
        assert p.start.tolist() == [[1, 2, 0], [4, 6, 0], [4, 8, -1]]
        assert p.end.tolist() == [[4, 6, 0], [4, 8, -1], [4, 8, 5]]
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
        assert p.start.tolist() == [[5, 6, 3]]
        assert p.zero_lines.tolist() == [1, 2]

    def test_an_axis_that_cuts_first_stands_at_zero(self, read):
        p = read("G0 X5\nG1 X6 Y1 F60" + END)
        assert p.start.tolist() == [[5, 0, 0]]

    def test_an_increment_starts_at_zero(self, read):
        assert read("G91 G0 X5" + END).start.tolist() == [[0, 0, 0]]

    def test_it_can_be_given(self, read):
        p = read("G0 X5 Y6\nG1 X7 F60" + END, start=(1, 2, 3))
        assert p.start.tolist() == [[1, 2, 3], [5, 6, 3]]
        assert p.end.tolist() == [[5, 6, 3], [7, 6, 3]]

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
        arm = p.start[1] - p.centre[1]
        turned = arm * np.cos(p.sweep[1]) + np.cross(axis, arm) * np.sin(p.sweep[1])
        assert p.centre[1] + turned == pytest.approx(p.end[1], abs=1e-12)

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

    def test_a_radius_short_by_its_digits_is_a_half_turn(self, read):
        p = read("F60\nG3 X10.004 Y0 R5" + END)
        assert p.centre[0, :2] == pytest.approx((5.002, 0))
        assert abs(p.sweep[0]) == pytest.approx(np.pi)

    def test_absolute_centres(self, read):
        p = read("F60\nG90.1\nG1 X10\nG3 X0 Y10 I0 J0\nG91.1 G3 X-10 Y0 J-10" + END)
        assert p.centre[1:, :2].tolist() == [[0, 0], [0, 0]]
        assert p.sweep[1:] == pytest.approx([np.pi / 2, np.pi / 2])

    @pytest.mark.parametrize("end", ["0.0049", "-0.0049"])
    def test_a_small_mismatch_of_the_radius_is_a_spiral(self, read, end):
        p = read(f"F60\nG1 X5\nG3 X{end} Y5 I-5" + END)
        radii = np.hypot(*(np.stack([p.start[1], p.end[1]]) - p.centre[1])[:, :2].T)
        assert radii == pytest.approx([5.0, np.hypot(5.0, 0.0049)], rel=1e-12)

    def test_on_a_large_arc_the_mismatch_is_relative(self, read, refusal):
        assert len(read("F60\nG1 X1000\nG3 X-1000.4 Y0 I-1000" + END)) == 2
        assert refusal("F60\nG1 X1000\nG3 X-1000.6 Y0 I-1000" + END) == (
            "3: I-1000: start and end lie 1000 and 1000.6 mm from the centre; they may differ by 0.005 mm or 0.05 %"
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


O_WORDS = "O words (program numbers, subroutines, loops) are not read; delete the number, or write out the blocks"
NO_END = "end of file: there is no M2, M30 or closing %; the file may have been cut off, else end it with M2"
REFUSED = {
    # text: message after the name of the file
    "G1 X1 F60\nG1 X2 W3\nM2": "2: W3: only the axes X, Y and Z are read",
    "A90\nM2": "1: A90: rotary axes are not read",
    "O100 sub\nM2": f"1: O100 SUB: {O_WORDS}",
    "N5 o7 while [#1 lt 2]\nM2": f"1: O7 WHILE [#1 LT 2]: {O_WORDS}",
    "o<drill> call\nM2": f"1: O<DRILL> CALL: {O_WORDS}",
    "O100\nM2": f"1: O100: {O_WORDS}",
    "#1=5\nM2": "1: #1=5: parameters are not read; write the number",
    "G1 X#5 F600\nM2": "1: X#5: parameters are not read; write the number",
    "G1 X-#<depth> F600\nM2": "1: X-#<DEPTH>: parameters are not read; write the number",
    "G1 X10 F600\n[1+2]\nM2": "2: [1+2]: expressions are not read; write the number",
    "G1 Xsin[30] F600\nM2": "1: XSIN[30]: expressions are not read; write the number",
    "G1 X[1+2]\nM2": "1: X[1+2]: expressions are not read; write the number",
    "/G1 X1\nM2": "1: /: block delete is not read; remove the block or the stroke",
    "G41 D1\nM2": "1: G41: cutter compensation is not read",
    "G43 H1\nM2": "1: G43: tool length offsets are not read",
    "G81 X1 Z-1 R1\nM2": "1: G81: canned cycles are not read",
    "G5.2 X1 Y1\nM2": "1: G5.2: splines are not read; write G1, G2 or G3",
    "G92 X0\nM2": "1: G92: offsets are not read",
    "G95\nM2": "1: G95: feed per revolution is not read",
    "G12\nM2": "1: G12: no G word of the subset",
    "G1.05 X1\nM2": "1: G1.05: no G word of the subset",
    "M98 P1\nM2": "1: M98: no M word of the subset",
    "G1 X1e3 F60\nM2": "1: E3: a number has no exponent, and no word starts with E",
    "G1 X1\nM2": "1: G1: no feed is given; F is missing",
    "G0 X1\nG1\nX5 Y3\nM2": "3: X5: no feed is given; F is missing",
    "F0\nG1 X1\nM2": "2: G1: the feed is 0; F must be > 0",
    "G1 X1 F-5\nM2": "1: F-5: must not be negative",
    "G93\nG1 X1 F2\nX2\nM2": "3: X2: G93 needs an F in every block that cuts",
    "G93 F2\nM2": "1: F2: under G93 an F belongs to a block with G1, G2 or G3",
    "G93 G1 X1 F0\nM2": "1: F0: must be > 0",
    "F60\nG93 G1 X1 F2\nG94 X2\nM2": "3: X2: no feed is given; F is missing",
    "G0 G1 X1 F60\nM2": "1: G1: G0 of the same modal group is in the block already",
    "G90 G91\nM2": "1: G91: G90 of the same modal group is in the block already",
    "G17 G18 G19\nM2": "1: G18: G17 of the same modal group is in the block already",
    "M3 M4 S1\nM2": "1: M4: M3 of the same modal group is in the block already",
    "G1 X1 Y2 X3 F60\nM2": "1: X3: the block has X1 already",
    "X1\nM2": "1: X1: no G0, G1, G2 or G3 is active",
    "G80\nX1\nM2": "2: X1: no G0, G1, G2 or G3 is active",
    "G1 X1 I2 F60\nM2": "1: I2: belongs to G2 or G3, which is not active",
    "F60\nG2\nM2": "2: G2: an arc needs an end point or a centre",
    "F60\nG2 X5\nM2": "2: X5: an arc needs a centre I, J, K or a radius R",
    "F60\nG2 X5 I1 R3\nM2": "2: R3: an arc has a radius R or a centre I, J, K, not both",
    "F60\nG2 X5 R0\nM2": "2: R0: the radius must not be 0",
    "F60\nG2 X5 I2.5 K1\nM2": "2: K1: is along the normal of the plane, G17",
    "F60 G18\nG2 X5 I2.5 J1\nM2": "2: J1: is along the normal of the plane, G18",
    "F60\nG90.1\nG2 X5 I2.5\nM2": "3: I2.5: under G90.1 the arc needs J as well",
    "F60\nG2 X10 Y0 I4\nM2": (
        "2: I4: start and end lie 4 and 6 mm from the centre; they may differ by 0.005 mm or 0.05 %"
    ),
    "F60\nG2 X10 Y0 R4\nM2": "2: R4: start and end are 2 mm farther apart than twice the radius",
    "F60\nG2 X0 Y0 R4\nM2": "2: R4: a full circle has no radius form; give its centre with I, J, K",
    "F60\nG2 X0 Y0.003 I0 J0\nM2": "2: I0: the centre lies on the start or the end of the arc",
    "G4\nM2": "1: G4: needs the time P in seconds",
    "G4 P-1\nM2": "1: P-1: must not be negative",
    "G1 F60\nG4 P1 X1\nM2": "2: X1: motion beside G4; write the dwell in a block of its own",
    "P1\nM2": "1: P1: belongs to G4 or G64, which is not in the block",
    "G64 G4 P1\nM2": "1: P1: belongs to G4 or to G64; write them in two blocks",
    "G64 P0\nM2": "1: P0: the tolerance must be > 0; G61 holds the path exactly",
    "G64 Q1\nM2": "1: Q1: needs the tolerance P beside it",
    "Q1\nM2": "1: Q1: belongs to G64, which is not in the block",
    "G0 N10 X1\nM2": "1: N10: a line number must come first in its block",
    "N1.5 G0 X1\nM2": "1: N1.5: must be a whole number",
    "T1.5\nM2": "1: T1.5: must be a whole number",
    "S-1\nM2": "1: S-1: must not be negative",
    "G1 X F60\nM2": "1: X: a letter needs a number after it",
    "G1 X. F60\nM2": "1: X.: a letter needs a number after it",
    "G1 X1.2.3 F60\nM2": "1: .3: a number needs a letter before it",
    "G1 X1 2 F60\nM2": "1: 2: a number needs a letter before it",
    "G1 X--1 F60\nM2": "1: X--1: a letter needs a number after it",
    "G1 X1 ! F60\nM2": "1: !: no word starts with it",
    "G1 X1 (open\nY2 F60\nM2": "1: (OPEN: a comment that is not closed with ) in its line, or that holds another",
    "(a (b) c)\nM2": "1: (A: a comment that is not closed with ) in its line, or that holds another",
    "G1 X1) F60\nM2": "1: ): no word starts with it",
    "M2\nG1 X1 F60": "2: G1: follows the end of the program (M2, M30 or the closing %)",
    "%\nG1 X1 F60\n%\nG1 X2": "4: G1: follows the end of the program (M2, M30 or the closing %)",
    "%\n%\n%": "3: %: a third %; one opens the file, and one closes it",
    "G1 X1 F60\n%": "2: %: closes a file that no % opens",
    "% G1 X1 F60\nM2": "1: %: must stand alone in its line",
    "G1 X1 F60\nG1 X2": f"2: {NO_END}",
    "G1 X1 F60\nG1 X2\n": f"2: {NO_END}",
    "%\nG1 X1 F60\nG1 X2": "3: end of file: the closing % is missing; the file may have been cut off, else end it with %",
    "": "1: end of file: there is no block in it; a program needs a move and M2",
    "(nothing but this)\n\n": "2: end of file: there is no block in it; a program needs a move and M2",
    "G1 X1 F60\nG1 X2 Y\n": "2: Y: a letter needs a number after it",
    "G1 X1" + "0" * 400 + " F60\nM2": (
        "1: X1" + "0" * 55 + "...: the number must be at most 1e+09"
    ),
    "G1 X1000000001 F60\nM2": "1: X1000000001: the number must be at most 1e+09",
    "G91 F60\n" + "G1 X1000000000\n" * 26 + "M2": "27: G1: leads farther than 2.5e10 mm from 0",
}  # fmt: skip


class TestRefusals:
    @pytest.mark.parametrize("text", REFUSED, ids=lambda text: text[:24])
    def test_names_line_word_and_reason(self, refusal, text):
        assert refusal(text) == REFUSED[text]

    def test_the_first_of_several_faults_counts(self, refusal):
        assert refusal("F60\nG1 X1 Q2\nG2 X5 I9\nG1 X\nM2").startswith("2: Q2:")
        assert refusal("F60\nG2 X5 I9\nG1 X1 Q2\nM2").startswith("2: I9:")
        assert refusal("F60\nG1 X\nG1 X1 Q2\nM2").startswith("2: X:")

    def test_its_line_in_a_later_part_of_the_file(self, refusal, monkeypatch):
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 64)
        assert refusal("F60\n" + "G1 X1\nX2\n" * 200 + "G2 X9 I1\nM2").startswith("402: I1: start and end")
        assert refusal("F60\n" + "G1 X1\nX2\n" * 200 + "G7 X9\nM2").startswith("402: G7:")
        assert refusal("F60\n" + "G1 X1\nX2\n" * 200 + "X?\nM2").startswith("402: X?:")

    @pytest.mark.parametrize("cut", range(1, 58))
    def test_a_file_cut_anywhere_is_refused(self, refusal, cut):
        text = "G21 G90\nG0 X0 Y0\nF600\nG1 X10.5 Y2\nG3 X0 Y2 I-5.25\nG1 X1\nM2\n"
        assert refusal(text[:cut])  # without the M2 there is no telling what is lost

    def test_binary_rubbish(self, refusal):
        noise = np.random.default_rng(0).integers(0, 256, 5000, dtype=np.uint8).tobytes()
        assert re.match(r"\d+: ", refusal(noise))
        assert refusal(b"\x7fELF\x02\x01\x01\x00") == (
            "1: byte 0x7f: not a character of a part program; the file is binary or damaged"
        )
        assert refusal("G1 X1 F60 (\x00)\nM2") == (
            "1: byte 0x00: not a character of a part program; the file is binary or damaged"
        )
        assert refusal("G0 X1\nG1 Ä2\nM2").startswith("2: byte 0xc3:")

    def test_any_bytes_give_an_answer_or_an_error(self, read):
        rng = np.random.default_rng(1)
        alphabet = np.frombuffer(b"GGGMXYZIJKRFPNT0123456789.- \n\n%()", dtype=np.uint8)
        refused = []
        for _ in range(300):
            text = b"F60 G1\n" + rng.choice(alphabet, rng.integers(1, 40)).tobytes() + b"\nM2\n"
            try:
                read(text)
            except InputError as error:
                refused.append(str(error))
        assert len(refused) > 200
        assert [text for text in refused if not re.match(r"part\.ngc:\d+: .+: .+", text)] == []

    def test_one_endless_line(self, refusal):
        assert refusal(b"G1 " + b" " * 5_000_000 + b"X1 F60\nM2") == "1: G1: a line of more than 65536 characters"

    def test_a_missing_file_and_a_folder(self, tmp_path):
        with pytest.raises(InputError, match=r"absent\.ngc: cannot be read"):
            read_program(tmp_path / "absent.ngc")
        with pytest.raises(InputError, match="is not a file"):
            read_program(tmp_path)
        with pytest.raises(InputError, match="must be the path of a file"):
            read_program(3)
        with pytest.raises(InputError, match="null byte"):
            read_program("a\0b")

    def test_an_axis_that_the_machine_lacks(self, read):
        p = read("F60\nG1 X1\nG1 Z5" + END)
        assert p.axes == ("X", "Z")
        p.require_axes(Limits(100, [1, 1], [1, 1], [1, 1], axes=("X", "Z")))
        with pytest.raises(InputError) as caught:
            p.require_axes(Limits(100, [1, 1], [1, 1], [1, 1], axes=("X", "Y")))
        assert str(caught.value) == "part.ngc:3: Z: the machine has no axis Z; its axes are X, Y"


class TestLargeFiles:
    def test_one_block_repeated(self, read):
        p = read("F60\n" + "G1 X1 Y2\n" * 300_000 + "M2\n")
        assert p.line.tolist() == [2]
        assert p.zero_lines.tolist() == list(range(3, 300_002))
        assert p.line_count == 300_002

    def test_too_many_moves(self, refusal, monkeypatch):
        monkeypatch.setattr("planner.programs.reading.reader._MAX_MOVES", 1000)
        assert refusal("F60\nG91\n" + "G1 X1\n" * 1001 + "M2\n") == (
            "1004: end of part: more than 1000 moves, or 1000000 stops and switches; split the program"
        )

    @pytest.mark.slow
    def test_a_million_blocks(self, tmp_path):
        import resource
        import time

        path = tmp_path / "large.ngc"
        path.write_text("F60\n" + "".join(f"G1 X{i % 977}.25 Y{i % 811}.125\n" for i in range(1_000_000)) + "M2\n")
        begin = time.perf_counter()
        p = read_program(path)
        assert time.perf_counter() - begin < 10.0
        assert len(p) == 1_000_000
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 1e6


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
            assert values[:3] == pytest.approx(ours.end[k], abs=1e-3)


def test_lines_that_end_with_cr_alone_are_named(tmp_path):
    (tmp_path / "mac.ngc").write_bytes(b"G21 G90\rG0 X0 Y0\rG1 X10 F600\rM2\r")
    with pytest.raises(InputError, match=r"mac\.ngc: its lines end with CR alone; save it with LF or CR LF"):
        read_program(tmp_path / "mac.ngc")
    (tmp_path / "one.ngc").write_bytes(b"G21 G90 G1 X10 F600 M2\r\n")
    assert read_program(tmp_path / "one.ngc").lengths.sum() == pytest.approx(10.0)
