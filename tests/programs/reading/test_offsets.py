"""Coordinate systems, shifts, tool lengths, homes: where a number in a block lies on the machine."""

import re

import numpy as np
import pytest

from planner.errors import InputError
from planner.programs.linuxcnc.canonical_program import read_with_linuxcnc
from planner.programs.linuxcnc.interpreter import is_installed
from planner.programs.reading.program import LINE, RAPID
from planner.programs.reading.reader import read_program
from planner.programs.reading.setup import Tool, read_tool_table

END = "\nM2\n"


class TestSystems:
    def test_an_origin_that_the_program_sets(self, read):
        p = read("G10 L2 P2 X100 Y50 Z-10\nF60\nG1 X1 Y2 Z3\nG55 G1 X1 Y2 Z3\nX0\nG54 X1" + END)
        assert p.end[:, :3].tolist() == [[1, 2, 3], [101, 52, -7], [100, 52, -7], [1, 52, -7]]
        assert p.notes == ()

    def test_a_change_of_system_moves_nothing(self, read):
        p = read("F60\nG10 L2 P3 X10\nG1 X5\nG56\nG91 X1\nG90 Y1" + END)
        assert p.end[:, :3].tolist() == [[5, 0, 0], [6, 0, 0], [6, 1, 0]]

    def test_all_nine_and_the_active_one(self, read):
        codes = ("54", "55", "56", "57", "58", "59", "59.1", "59.2", "59.3")
        text = "".join(f"G10 L2 P{k} X{k}00\n" for k in range(1, 10))
        text += "F60\n" + "".join(f"G{code} G1 X{k}\n" for k, code in enumerate(codes, start=1))
        p = read(text + "G10 L2 P0 X7\nX0" + END)
        assert p.end[:, 0].tolist() == [*(101 * k for k in range(1, 10)), 7]

    def test_where_the_machine_stands_becomes_a_point(self, read):
        p = read("F60\nG1 X10 Y5\nG10 L20 P2 X1 Y0\nG55 X2 Y2" + END)
        assert p.end[:, :3].tolist() == [[10, 5, 0], [11, 7, 0]]

    def test_in_inches(self, read):
        p = read("G20 F60\nG10 L2 P2 X1\nG55 G1 X1" + END)
        assert p.end[0, 0] == pytest.approx(50.8, rel=1e-15)

    def test_an_origin_that_nothing_sets_is_said(self, read):
        p = read("F60\nG57\nG1 X1" + END)
        assert p.notes == ("taken for 0, since the program does not say: the origin of G57 (line 2)",)

    def test_absolute_centres_move_along(self, read):
        p = read("F60\nG10 L2 P2 X100\nG55 G90.1\nG1 X5 Y0\nG3 X0 Y5 I0 J0" + END)
        assert p.centre[1].tolist() == [100, 0, 0]
        assert p.end[1, :3].tolist() == [100, 5, 0]


class TestShift:
    def test_where_the_machine_stands_gets_another_number(self, read):
        p = read("F60\nG1 X10\nG92 X0 Y2\nX5 Y3\nG92.1\nX1 Y1" + END)
        assert p.end[:, :3].tolist() == [[10, 0, 0], [15, 1, 0], [1, 1, 0]]

    def test_two_of_them_add_up(self, read):
        p = read("F60\nG1 X10\nG92 X0\nX5\nG92 X0\nX1" + END)
        assert p.end[:, 0].tolist() == [10, 15, 16]

    def test_suspended_and_restored(self, read):
        p = read("F60\nG1 X10\nG92 X0\nG92.2\nX1\nG92.3\nX1\nG92.1\nG92.3\nX1" + END)
        assert p.end[:, 0].tolist() == [10, 1, 11, 1]

    def test_a_local_origin(self, read):
        p = read("F60\nG10 L2 P1 X100\nG52 X5\nG1 X1\nG52 X0\nX1" + END)
        assert p.end[:, 0].tolist() == [106, 101]

    def test_machine_coordinates_know_no_shift(self, read):
        p = read("F60\nG10 L2 P1 X100 Z-5\nG1 X1 Z1\nG53 G0 X3\nG1 X1" + END)
        assert p.end[:, :3].tolist() == [[101, 0, -4], [3, 0, -4], [101, 0, -4]]
        assert p.kind.tolist() == [LINE, RAPID, LINE]

    def test_machine_coordinates_need_a_straight_move(self, refusal):
        assert refusal("F60\nG1 X5\nG3 G53 X0 I-2.5\nM2") == "3: G53: machine coordinates need G0 or G1"


class TestLengths:
    def test_of_a_table(self, read):
        tools = {1: Tool((0.0, 0.0, 40.0)), 7: Tool((1.0, 0.0, 25.0))}
        p = read("F60\nT7 M6\nG43\nG1 X1 Z0\nG43 H1 Z0\nG49 Z0\nX0" + END, tools=tools)
        assert p.end[:, :3].tolist() == [[2, 0, 25], [2, 0, 40], [2, 0, 0], [0, 0, 0]]
        assert p.notes == ()

    def test_of_the_program_itself(self, read):
        p = read("F60\nG10 L1 P3 Z12.5\nG43 H3\nG1 Z1\nG43.2 H3 Z0" + END)
        assert p.end[0, :3].tolist() == [0, 0, 13.5]

    def test_given_in_the_block(self, read):
        p = read("F60\nG43.1 Z2\nG1 Z1\nG43.1 X3\nX1 Z1\nG43.2 Z1\nZ1" + END)
        assert p.end[:, :3].tolist() == [[0, 0, 3], [4, 0, 3], [4, 0, 4]]

    def test_on_top_of_another(self, read):
        p = read("F60\nG10 L1 P1 Z10\nG10 L1 P2 Z3\nG43 H1\nG43.2 H2\nG1 Z1" + END)
        assert p.end[0, :3].tolist() == [0, 0, 14]

    def test_one_that_nothing_says_is_0_and_said_once(self, read):
        p = read("T1 M6\nG43 H1\nG0 Z5\nF60\nG43 Z6 H1\nG1 Z1" + END)
        assert p.notes == ("taken for 0, since the program does not say: the length of tool 1 (line 2)",)
        assert p.end[-1, :3].tolist() == [0, 0, 1]

    def test_a_tool_the_table_lacks(self, read):
        with pytest.raises(InputError, match=r"part\.ngc:2: H9: the tool table has no tool 9; add a line T9"):
            read("F60\nG43 H9\nG1 Z1" + END, tools={1: Tool()})

    def test_a_table_of_linuxcnc(self, tmp_path, read):
        path = tmp_path / "tool.tbl"
        path.write_text("; tools\n\nT1 P1 D6.0 Z+40.2 ;6 mm end mill\nt2 P2 X.5 Z-3.\n")
        assert read_tool_table(path) == {
            1: Tool((0.0, 0.0, 40.2), 6.0, name="6 mm end mill"),
            2: Tool((0.5, 0.0, -3.0)),
        }
        assert read("F60\nG43 H1\nG1 Z1" + END, tools=path).end[0, 2] == pytest.approx(41.2, rel=1e-15)

    @pytest.mark.parametrize(
        ("text", "reason"),
        [
            ("G0 X1\nM2\n", r"tool\.tbl:1: G0 X1: a line of a tool table needs a T word"),
            ("T1 P1 Z4\nT1 Z5\n", r"tool\.tbl:2: T1: the tool is in the table already"),
            ("T1 Zlong\n", r"tool\.tbl:1: Zlong: no word of a tool table"),
            ("T1.5 Z1\n", r"tool\.tbl:1: T1\.5: the number of a tool must be a whole number"),
            (";nothing\n", r"tool\.tbl:1: end of file: there is no tool in the table"),
        ],
    )
    def test_what_is_no_table(self, tmp_path, text, reason):
        (tmp_path / "tool.tbl").write_text(text)
        with pytest.raises(InputError, match=reason):
            read_tool_table(tmp_path / "tool.tbl")

    def test_a_table_that_is_not_there(self, tmp_path):
        with pytest.raises(InputError, match=r"absent\.tbl: cannot be read"):
            read_tool_table(tmp_path / "absent.tbl")


class TestHomes:
    def test_over_a_point_to_the_home(self, read):
        p = read("F60\nG1 X10 Y10 Z-1\nG91 G28 Z6\nG90\nG28" + END)
        assert p.end[:, :3].tolist() == [[10, 10, -1], [10, 10, 5], [10, 10, 0], [0, 0, 0]]
        assert p.kind.tolist() == [LINE, RAPID, RAPID, RAPID]
        assert p.line.tolist() == [2, 3, 3, 5]
        assert p.notes == ("taken for 0, since the program does not say: the position of G28 (line 3)",)

    def test_a_home_that_the_program_sets(self, read):
        p = read("F60\nG1 X10 Z5\nG28.1\nG30.1\nX1 Z1\nG28 X2\nG30" + END)
        assert p.end[2:, :3].tolist() == [[2, 0, 1], [10, 0, 1], [10, 0, 5]]
        assert p.notes == ()

    def test_the_home_does_not_move_with_the_work(self, read):
        p = read("F60\nG10 L2 P1 X50\nG1 X1\nG28 X2" + END)
        assert p.end[:, 0].tolist() == [51, 52, 0]


class TestWhatIsRefused:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G10 L2 X1", "1: G10: needs P beside it"),
            ("G10 L12 P1 X1", "1: L12: of G10 only L1, L2, L10, L11 and L20 are read"),
            ("G10 L10 P0 X1", "1: P0: the number of a tool must be a whole number of at least 1"),
            ("G10 L2 P10 X1", "1: P10: the number of a coordinate system is 1 to 9, or 0 for the active one"),
            ("G10 L2 P1 R45", "1: R45: a coordinate system that is turned is not read; turn the program"),
            ("G10 L1 P0 Z1", "1: P0: the number of a tool must be a whole number of at least 1"),
            ("G0 G92 X1", "1: X1: belongs to the other word of the block; write the motion in a block of its own"),
            ("G54 G55", "1: G55: G54 of the same modal group is in the block already"),
            ("G43 H1.5", "1: H1.5: must be a whole number"),
            ("H1", "1: H1: belongs to a word that is not in the block; it is read beside G43, G43.2, G76"),
            ("D1", "1: D1: belongs to a word that is not in the block; it is read beside G41, G42, G41.1, G42.1, G96"),
        ],
    )
    def test_with_the_word_and_the_reason(self, refusal, text, message):
        assert refusal(text + END) == message


class TestSwitches:
    """What every post writes and what moves nothing."""

    @pytest.mark.parametrize(
        "block",
        [
            *("M48", "M49", "M50 P0", "M51", "M52 P1", "M53 P1", "M62 P1", "M63 P1", "M64 P0", "M65 P0", "M66 P0 L0"),
            *("M67 E0 Q-1.5", "M68 E0 Q5", "M19 R90", "M61 Q3", "G96 D2000 S100", "G97 S900", "G98", "G99", "G64 P0"),
            *("G80", "M7", "N12.5", "/G1 X99", "$H", "? "),
        ],
    )
    def test_moves_nothing(self, read, block):
        p = read(f"F60\nG1 X1\n{block}\nG1 X2" + END)
        assert p.end[:, 0].tolist() == [1, 2]
        assert p.stop_after.tolist() == [False, True]

    def test_m60_stops(self, read):
        p = read("F60\nG1 X1\nM60\nX2" + END)
        assert p.stop_after.tolist() == [True, True]

    def test_lines_passed_over_are_said(self, read):
        p = read("F60\n$X\nG1 X1 (a / b)\n/G1 X2\n  / M3\n" + END)
        assert p.end[:, 0].tolist() == [1]
        assert p.notes == (
            "1 line with $ (a setting of GRBL) passed over, the first is line 2",
            "2 lines with / (block delete is on) passed over, the first is line 4",
        )

    def test_a_motion_beside_g80(self, read):
        p = read("G80 G0 X0 Y0\nG1 X10 F600" + END)
        assert p.end[:, 0].tolist() == [10]

    def test_what_follows_the_end_is_not_read(self, read):
        for end in ("M2", "M30", "%"):
            p = read(("%\n" if end == "%" else "") + f"G1 X1 F60\n{end}\nthis is # no [ program\nG1 X5 é\n")
            assert p.end[:, 0].tolist() == [1]
            assert p.line_count == 4 + (end == "%")

    def test_numbers_next_to_those_of_a_word(self, read):
        assert read("F60\nG0.99999 X1" + END).kind.tolist() == [LINE]


class TestProbing:
    def test_moves_are_taken_in_full_and_said(self, read):
        p = read("F60\nG38.2 Z-5\nG1 X1\nG38.5 Z0\nX0" + END)
        assert p.end[:, :3].tolist() == [[0, 0, -5], [1, 0, -5], [1, 0, 0], [0, 0, 0]]
        assert set(p.kind.tolist()) == {LINE}
        assert p.notes == ("3 probing moves taken in full, the first in line 2",)

    def test_over_the_parts_of_a_file(self, read, monkeypatch):
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 8)
        assert read("F60\nG38.2 Z-5\nG1 X1\nG38.5 Z0\nX0" + END).notes == (
            "3 probing moves taken in full, the first in line 2",
        )


class TestTools:
    def test_a_tool_that_the_table_lacks(self, read):
        """Where there is a table; LinuxCNC refuses the T word too."""
        table = {1: Tool((0.0, 0.0, 40.0))}
        with pytest.raises(
            InputError, match=r"part\.ngc:2: T9: the tool table has no such tool; add a line for it, as T1"
        ):
            read("T1 M6\nT9 M6" + END, tools=table)
        assert read("T1 M6\nT0\nG10 L1 P9 Z3\nT9" + END, tools=table).notes == ()
        assert read("T9 M6" + END).events[0].text == "M6 T9"


class TestUnread:
    TEXT = "G1 X1 F60\nM123\nG88 X2\nM123 P1\nG88\nG12.1\n"

    def test_all_of_them_in_one_message(self, refusal):
        assert refusal(self.TEXT + END) == (
            "2: M123: not read in this program: M123 (line 2, 2 times, a code of the user); G88 (line 3, 2 times, "
            "cycles that wait for a hand); "
            "G12.1 (line 6, 1 time); post it without them, or pass over those that move nothing: --ignore WORD for each, or "
            "let an installed LinuxCNC read it: --reader rs274"
        )

    def test_over_the_parts_of_a_file(self, refusal, monkeypatch):
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 8)
        said = refusal(self.TEXT + END)
        assert "M123 (line 2, 2 times, a code of the user); G88 (line 3, 2 times, cycles that" in said
        assert "G12.1 (line 6" in said

    def test_passed_over_as_asked(self, read):
        p = read("G1 X1 F60\nM123 P1 Q-2.5\nM124 X2\nM123\nM124 P3\n" + END, ignore=("m124", "M123"))
        assert p.end[:, 0].tolist() == [1, 2]
        assert p.notes == (
            "M123 is passed over as asked, 2 times, the first in line 2",
            "M124 is passed over as asked, 2 times, the first in line 3",
        )

    @pytest.mark.parametrize("word", ["X", "G1", "M3", "M03", "", "M", "A", "A1", "12", "G1.x"])
    def test_what_cannot_be_ignored(self, read, word):
        with pytest.raises(InputError, match=rf"ignore = {re.escape(repr(word))}"):
            read("G1 X1 F60" + END, ignore=(word,))


def test_the_parts_it_is_read_in_do_not_matter(read, monkeypatch):
    """Words that act at once, at random between moves."""
    rng = np.random.default_rng(12)
    pool = ["G54", "G55", "G10 L2 P2 X{x} Y1", "G92 X{x}", "G92.1", "G43.1 Z{x}", "G49", "G53 G0 X{x} Y{y}", "G28 Z{x}",
            "G91 G1 X{x}\nG90", "G52 Y{y}", "G20 G1 X{x}\nG21", "G10 L20 P0 Y{y}"]  # fmt: skip
    text = "F60 G1 X1 Y1 Z1\n"
    for x, y, k in zip(*rng.normal(size=(2, 200)).round(3), rng.integers(0, 2 * len(pool), 200), strict=True):
        text += (pool[k] if k < len(pool) else "G1 X{x} Y{y}").format(x=x, y=y) + "\n"
    whole = read(text + END)
    monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 64)
    parts = read(text + END)
    assert len(whole) > 100
    assert parts.line.tolist() == whole.line.tolist()
    assert parts.end == pytest.approx(whole.end, abs=1e-9)
    assert parts.notes == whole.notes


class TestToolsMeasuredByTheMachine:
    """G10 L10 and L11: the length is what makes the place of the machine the point in the block."""

    @pytest.mark.parametrize(
        ("lines", "end"),
        [
            ("G43\nG92 Z2\nG10 L10 P1 Z5\nG43\nG1 Z1", [3, 0, -4]),
            ("G92 Z2\nG10 L2 P1 Z7\nG10 L11 P1 Z5\nG43\nG1 Z1", [3, 0, 1]),
            ("G10 L2 P9 Z9\nG10 L11 P1 Z5\nG43\nG1 Z1", [3, 0, -13]),
            ("G10 L10 P1 X1\nG43\nG1 X0", [2, 0, 0]),
        ],
    )
    def test_the_length(self, tmp_path, lines, end):
        path = tmp_path / "part.ngc"
        path.write_text(f"F600\nG1 X3\nT1 M6\n{lines}\nM2\n")
        tools = {1: Tool((0.0, 0.0, 10.0))}
        assert read_program(path, tools=tools, start=(0, 0, 0)).end[-1, :3] == pytest.approx(end, abs=1e-12)
        if is_installed():
            theirs = read_with_linuxcnc(path, tools=tools, from_zero=True)
            assert theirs.end[-1, :3] == pytest.approx(end, abs=1e-9)


def test_a_block_of_offsets_under_a_cycle_moves_nothing(read):
    p = read("F600\nG0 Z5\nG81 X1 Z-1 R2\nG10 L2 P3 X9\nG80\nG0 X2\nM2\n")
    assert p.line.tolist()[1:-1] == [3] * (len(p) - 2)
