"""Words of the axes A B C, in degrees, and U V W, in the units of length."""

import shutil
import subprocess

import numpy as np
import pytest

from planner.errors import InputError
from planner.geometry.curve import AXES
from planner.machine.limits import Limits
from planner.programs.reading.program import ANGULAR
from planner.programs.reading.setup import Tool, read_tool_table

END = "\nM2\n"


class TestPositions:
    def test_every_axis(self, read):
        p = read("G1 X1 Y2 Z3 A4 B5 C6 U7 V8 W9 F60" + END)
        assert p.end.tolist() == [[*range(1, 10)]]
        assert p.start.tolist() == [[0] * 9]
        assert p.axes == AXES
        assert p.axis_lines.tolist() == [1] * 9

    def test_relative(self, read):
        p = read("F60 G91\nG1 A10 U1\nA10 X1\nG90 A5 U0" + END)
        assert p.end[:, [0, 3, 6]].tolist() == [[0, 10, 1], [1, 20, 1], [1, 5, 0]]

    def test_inches_are_lengths_and_not_angles(self, read):
        p = read("G20 F60\nG1 X1 A90\nU1 B1\nC2 W2" + END)
        assert p.end[-1].tolist() == [25.4, 0, 0, 90, 1, 2, 25.4, 0, 50.8]

    def test_as_written_and_not_unwound(self, read):
        p = read("F60\nG1 A350\nA10\nA730\nG91 A-720" + END)
        assert p.end[:, 3].tolist() == [350, 10, 730, 10]

    def test_the_first_rapid_starts_there(self, read):
        p = read("G0 X5 A30\nG1 C40 F60\nA10" + END)
        assert p.start[0].tolist() == [5, 0, 0, 30, 0, 0, 0, 0, 0]
        assert p.end[:, [3, 5]].tolist() == [[30, 40], [10, 40]]

    def test_an_axis_named_in_a_later_part_of_the_file(self, read, monkeypatch):
        text = "G0 X1\nG1 X2 F60\nY3\nG0 A30 X5\nG1 X6\nB4" + END
        whole = read(text)
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 8)
        parts = read(text)
        assert parts.start.tolist() == whole.start.tolist()
        assert parts.end.tolist() == whole.end.tolist()
        assert whole.start[:, 3].tolist() == [30] * 5
        assert whole.axis_lines.tolist() == [1, 3, 0, 4, 6, 0, 0, 0, 0]

    def test_where_the_machine_stands(self, read):
        p = read("G1 A1 F60\nG91 U1" + END, start=(1, 2, 3, 4, 5, 6, 7, 8, 9))
        assert p.start.tolist() == [[1, 2, 3, 4, 5, 6, 7, 8, 9], [1, 2, 3, 1, 5, 6, 7, 8, 9]]
        assert p.end[-1].tolist() == [1, 2, 3, 1, 5, 6, 8, 8, 9]
        with pytest.raises(InputError, match=r"three coordinates in mm, or nine of X Y Z A B C U V W"):
            read("G1 A1 F60" + END, start=(1, 2, 3, 4))

    def test_short_moves_are_none(self, read):
        p = read("F60\nG1 A1\nA1.0000001\nA2" + END)
        assert p.end[:, 3].tolist() == [1, 2]
        assert p.zero_lines.tolist() == [3]

    def test_beside_an_arc(self, read):
        p = read("F60\nG2 X10 I5 A90 W3\nG2 I-5 A0" + END)
        assert p.end[:, [0, 3, 8]].tolist() == [[10, 90, 3], [10, 0, 3]]
        assert p.lengths == pytest.approx([5 * np.pi, 10 * np.pi], rel=1e-14)
        assert p.centre.shape == (2, 3)


class TestOffsets:
    def test_systems(self, read):
        p = read("F60\nG10 L2 P2 A10 U5\nG55\nG1 A1 U1\nG53 A1 U1\nG20 U1" + END)
        assert p.end[:, [3, 6]].tolist() == [[11, 6], [1, 1], [1, 30.4]]

    def test_where_the_machine_is_set_to_be(self, read):
        p = read("F60\nG1 A90 X1\nG92 A0\nA10\nG92.1\nA10\nG10 L20 P1 A0\nA5\nG52 A7\nA0" + END)
        assert p.end[:, 3].tolist() == [90, 100, 10, 15, 17]

    def test_tool_lengths(self, read):
        p = read("F60\nG43.1 Z5 A2\nG1 A1 Z1\nG43.2 A3\nA1\nG49 A1" + END)
        assert p.end[:, [2, 3]].tolist() == [[6, 3], [6, 6], [6, 1]]
        p = read("F60\nG43 H1\nG1 Z1 A1 W1" + END, tools={1: Tool((0, 0, 40, 5, 0, 0, 0, 0, 7))})
        assert p.end[0, [2, 3, 8]].tolist() == [41, 6, 8]

    def test_tool_table(self, tmp_path):
        path = tmp_path / "tool.tbl"
        path.write_text("T1 P1 Z40 A2 W1.5 D6\n")
        assert read_tool_table(path) == {1: Tool((0, 0, 40, 2, 0, 0, 0, 0, 1.5), 6)}

    def test_homes(self, read):
        p = read("F60\nG1 X1 A30 U2\nG28.1\nX5 A90\nG28 A80\nA0\nG28" + END)
        assert p.end[:, [0, 3]].tolist() == [[1, 30], [5, 90], [5, 80], [5, 30], [5, 0], [1, 30]]

    def test_parameters(self, read):
        p = read("F60\nG1 X1 A20 U30\nG92 A0\nG1 B#5214 C[#5423+1]\nG20\nV#5426 W[#<_u>+#<_a>]" + END)
        assert p.end[1, 4:6].tolist() == [20, 1]
        assert p.end[2, 7:].tolist() == pytest.approx([30, 30], rel=1e-15)


class TestFeed:
    """LinuxCNC's rule: along X Y Z where any of these moves, else along U V W, else degrees."""

    @pytest.mark.parametrize(
        ("block", "length", "feed"),
        [
            ("G1 X3 A90 F2", 3, 2 / 60),
            ("G1 A90 F2", 90, 2 / 60),
            ("G1 A30 B40 F120", 50, 2),
            ("G1 U3 V4 A90 F120", 5, 2),
            ("G1 Z2 U3 V4 A90 F120", 2, 2),
            ("G93 G1 X3 A90 F2", 3, 6 / 60),
            ("G93 G1 A90 F2", 90, 180 / 60),
            ("G93 G1 U4 A90 F2", 4, 8 / 60),
            ("G20 G1 A90 F2", 90, 2 / 60),
            ("G20\nG1 U2 F2", 50.8, 50.8 / 60),
            ("G20 F2\nG21 G1 A90", 90, 2 / 60),
            ("G93 G2 X3 I1.5 A9 F2", 1.5 * np.pi, 3 * np.pi / 60),
            ("G1 X0.0000001 A90 F2", 90, 2 / 60),
        ],
    )
    def test_length_and_feed(self, read, block, length, feed):
        p = read(block + END)
        assert p.lengths == pytest.approx([length], rel=1e-14)
        assert p.feed == pytest.approx([feed], rel=1e-14)

    def test_what_it_is_measured_along(self, read):
        p = read("F60\nG1 X1 U1 A1\nU2 A2\nA3\nG0 A4\nX2" + END)
        assert p.feed_group.tolist() == [0, 1, ANGULAR, ANGULAR, 0]
        assert p.lengths.tolist() == [1, 1, 1, 1, 1]


def test_machine_without_the_axis(read):
    p = read("F60\nG1 X1\nG1 X2 A1" + END)
    mill = Limits(100.0, [1.0] * 3, [1.0] * 3, [1.0] * 3)
    with pytest.raises(InputError, match=r"part.ngc:3: A: the machine has no axis A; its axes are X, Y, Z"):
        p.require_axes(mill)


@pytest.mark.skipif(shutil.which("rs274") is None, reason="rs274 of LinuxCNC is not installed")
@pytest.mark.parametrize("seed", range(6))
def test_against_rs274(read, tmp_path, seed):
    """End points and feeds of random programs, in the six axes that rs274 reads by itself."""
    rng = np.random.default_rng(seed)
    words = ["G92 A{a}", "G10 L2 P1 A{a} X{x}", "G91", "G90", "G90 G53 G0 X{x} B{b}", "G52 B{b}", "G92.1", "G28 A{a}",
             "G43.1 X{a}", "G49"]  # fmt: skip
    moves = ["G1 A{a} F{f}", "G0 X{x} A{a}", "G1 X{x} C{c} F{f}", "G93 G1 A{a} B{b} F{f}\nG94 F100", "G1 Z{x} F{f}",
             "G93 G1 Y{x} B{b} F{f}\nG94 F50", "G90 G2 X{x} Y{a} R2000 C{c} F{f}"]  # fmt: skip
    text = "G21 G90 G94 F100\nG0 X0 Y0 Z0 A0 B0 C0\n"
    for _ in range(60):
        pool = words if rng.random() < 0.3 else moves
        numbers = {name: round(float(rng.uniform(1, 50)), 3) for name in "axbcf"}
        text += pool[int(rng.integers(len(pool)))].format(**numbers) + "\n"
    path = tmp_path / "random.ngc"
    path.write_text(text + "M2\n")
    ours, theirs = read(path.read_text()), _canon(path)
    assert len(theirs) == len(ours) > 35
    for k, (name, feed, end) in enumerate(theirs):
        assert end == pytest.approx(ours.end[k, :6], abs=1e-3)
        if name != "STRAIGHT_TRAVERSE":
            assert feed == pytest.approx(60.0 * ours.feed[k], abs=2e-3)


def _canon(path):
    """Moves that rs274 makes of a program, those of no length left out: name, feed in force, end in machine coordinates."""
    out = subprocess.run(
        ["rs274", "-g", str(path)], capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
    )
    moves, feed, at = [], 0.0, np.zeros(6)
    offsets = {name: np.zeros(6) for name in ("SET_G5X_OFFSET", "SET_G92_OFFSET", "USE_TOOL_LENGTH_OFFSET")}
    for row in out.stdout.splitlines():
        name, _, rest = row.split(None, 2)[2].partition("(")
        if name == "SET_FEED_RATE":
            feed = float(rest.rstrip(")"))
        if name in offsets:
            numbers = [float(value) for value in rest.rstrip(")").replace(",", " ").split()]
            offsets[name] = np.array(numbers[1:7] if name == "SET_G5X_OFFSET" else numbers[:6])
        if name not in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED"):
            continue
        values = [float(value) for value in rest.rstrip(")").replace(",", " ").split()]
        if name == "ARC_FEED":  # end in the plane, centre, turns, end along its normal
            values = [*values[:2], *values[5:]]
        end = np.array(values) + sum(offsets.values())
        if np.abs(end - at).max() > 5e-4 or name == "ARC_FEED":
            moves.append((name, feed, end))
        at = end
    return moves
