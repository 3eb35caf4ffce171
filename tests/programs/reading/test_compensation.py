"""Cutter compensation: the tool beside the programmed path, or the reason why it does not fit there."""

import numpy as np
import pytest
from compensated_programs import HAS_LINUXCNC, TOOLS_MM, Draw, canonical, difference

from planner.errors import InputError
from planner.programs.linuxcnc.canonical_program import read_with_linuxcnc
from planner.programs.reading.program import ARC, LINE, RAPID
from planner.programs.reading.reader import read_program
from planner.programs.reading.setup import Tool

HEAD = "G21 F300\nG0 X0 Y0\n"
SQUARE = "G1 X10 Y0\nG1 X20\nG1 Y10\nG1 X10\nG1 Y0\nG40\nG1 X0\nM2\n"


def sampled(program, rows, count=200):
    """Points along some moves, (m, 3)."""
    out = []
    for k in rows:
        share = np.linspace(0, 1, count)[:, None]
        points = program.start[k, :3] + share * (program.end[k] - program.start[k])[:3]
        if program.kind[k] == ARC:
            normal = int(program.normal[k])
            i, j = (normal + 1) % 3, (normal + 2) % 3
            spoke = program.start[k, :3] - program.centre[k]
            turned = (spoke[i] + 1j * spoke[j]) * np.exp(1j * share[:, 0] * program.sweep[k])
            points[:, i], points[:, j] = program.centre[k, i] + turned.real, program.centre[k, j] + turned.imag
        out.append(points)
    return np.concatenate(out)


def distance_to(corners, points):
    """From points to a polygon's sides, (m,)."""
    z, a = points[:, 0] + 1j * points[:, 1], corners[:, None]
    side = np.roll(corners, -1)[:, None] - a
    along = np.clip(((z - a) / side).real, 0.0, 1.0)
    return np.abs(z - a - along * side).min(axis=0)


class TestPath:
    def test_outside_corners_are_arcs_about_the_corner(self, read):
        p = read(HEAD + "G42.1 D2\n" + SQUARE)
        assert p.kind.tolist() == [LINE, LINE, ARC, LINE, ARC, LINE, ARC, LINE, LINE]
        assert p.end[1:8, :2] == pytest.approx(
            np.array([[20, -1], [21, 0], [21, 10], [20, 11], [10, 11], [9, 10], [9, 0]]), abs=1e-12
        )
        assert p.centre[2, :2].tolist() == [20, 0]
        assert p.sweep[[2, 4, 6]] == pytest.approx(np.full(3, np.pi / 2))
        assert p.line[1:8].tolist() == [5, 6, 6, 7, 7, 8, 8]

    def test_inside_corners_are_where_the_paths_cross(self, read):
        p = read(HEAD + "G41.1 D2\n" + SQUARE)
        assert p.end[:, :2] == pytest.approx(np.array([[10, 1], [19, 1], [19, 9], [11, 9], [11, 0], [0, 0]]), abs=1e-12)
        assert (p.kind == LINE).all()

    def test_the_entry_and_the_exit(self, read):
        p = read(HEAD + "G42.1 D3\nG1 X10\nX20\nG40\nG0 X20 Y0\nM2\n")
        assert p.start[0].tolist() == [0.0] * 9
        assert p.end[:, :2].tolist() == [
            [10, -1.5],
            [20, -1.5],
            [20, 0],
        ]  # back to the same point is a move of the tool
        assert p.kind.tolist() == [LINE, LINE, RAPID]
        assert p.line.tolist() == [4, 5, 7]

    def test_a_rapid_goes_around_a_corner_by_a_line(self, read):
        p = read(HEAD + "G42.1 D2\nG0 X10\nG0 Y10\nG40\nG0 X0\nM2\n")
        assert p.kind.tolist() == [RAPID] * 4
        assert p.end[:3, :2] == pytest.approx(np.array([[10, -1], [11, 0], [11, 10]]), abs=1e-12)

    @pytest.mark.parametrize(("side", "radius"), [("G41", 4.0), ("G42", 6.0)])
    def test_arcs_keep_their_centre(self, read, side, radius):
        p = read(HEAD + f"{side}.1 D2\nG1 X10\nG3 X10 Y10 J5\nG1 X0\nG40\nG1 Y0\nM2\n")
        assert p.centre[1, :2] == pytest.approx((10, 5))
        spokes = np.hypot(*(np.stack([p.start[1, :3], p.end[1, :3]]) - p.centre[1])[:, :2].T)
        assert spokes == pytest.approx(np.full(2, radius), abs=1e-12)
        assert p.sweep[1] == pytest.approx(np.pi)

    def test_a_full_circle_stays_one(self, read):
        p = read(HEAD + "G41.1 D2\nG1 X10\nG3 X10 Y0 Z-3 J5 P2\nG40\nG1 Y3\nM2\n")
        assert p.sweep[1] == pytest.approx(4 * np.pi, rel=1e-12)
        assert p.end[1, :3] == pytest.approx([10, 1, -3])

    def test_moves_along_the_normal_wait_with_the_corner(self, read):
        p = read(HEAD + "G41.1 D2\nG1 X10\nG0 Z5\nG1 Z-1\nG1 Y10\nG40\nG1 X0\nM2\n", start=(0, 0, 0))
        assert p.end[:4, :3] == pytest.approx(np.array([[9, 1, 0], [9, 1, 5], [9, 1, -1], [9, 10, -1]]), abs=1e-12)

    def test_the_height_changes_in_the_move_and_not_in_the_corner(self, read):
        p = read(HEAD + "G42.1 D2\nG1 X10\nG1 Y10 Z4\nG40\nG1 X0\nM2\n")
        assert p.end[:3, 2].tolist() == [0, 0, 4]

    def test_inside_corners_of_no_length_vanish_with_their_line_kept(self, read):
        """LinuxCNC sends a move of no length there."""
        p = read(HEAD + "G42.1 D2\nG1 X0 Y10\nG1 X10\nG1 X10 Y9\nG1 X11\nG40\nG1 Y20\nM2\n")
        assert p.end[:, :2] == pytest.approx(np.array([[1, 9], [9, 9], [10, 8], [11, 8], [11, 20]]), abs=1e-12)
        assert p.line.tolist() == [4, 5, 7, 7, 9]
        assert p.zero_lines.tolist() == [2, 6]

    def test_a_negative_diameter_is_one_on_the_other_side(self, read):
        a, b = (read(HEAD + f"{word}\n" + SQUARE) for word in ("G41.1 D2", "G42.1 D-2"))
        assert np.array_equal(a.end, b.end)

    def test_inches_count_for_the_diameter(self, read):
        p = read("G20 F30\nG0 X0 Y0\nG41.1 D0.2\nG1 X1\nG1 X2\nG40\nG1 Y1\nM2\n")
        assert p.end[:2, 1] == pytest.approx(np.full(2, 2.54))

    def test_offsets_move_the_path_with_them(self, read):
        a = read(HEAD + "G42.1 D2\n" + SQUARE)
        b = read("G10 L2 P1 X100 Y-50\nG92 X0 Y0\n" + HEAD + "G42.1 D2\n" + SQUARE, start=(100, -50, 0))
        assert b.end - a.end == pytest.approx(np.tile([100, -50, *7 * [0]], (len(a), 1)), abs=1e-9)

    def test_the_feed_under_inverse_time_is_that_of_the_programmed_length(self, read):
        p = read("G0 X0 Y0\nG41.1 D2\nG93\nG1 X10 F6\nG1 X20 F6\nG40\nG1 X20 Y0 F6\nM2\n")
        assert p.feed == pytest.approx([1.0, 1.0, 0.1 / 60])

    def test_a_radius_of_zero_changes_nothing(self, read):
        a, b = read(HEAD + SQUARE), read(HEAD + "G41.1 D0\n" + SQUARE)
        assert np.array_equal(a.end, b.end)

    @pytest.mark.parametrize("word", ["G41.1 D2", "G42.1 D2"])
    def test_the_parts_it_is_read_in_do_not_matter(self, read, monkeypatch, word):
        text = (
            HEAD
            + word
            + "\nG1 X10\n"
            + "G1 Y10\nG4 P1\nG1 Z-1\nG3 X0 Y10 R5\nG1 Y0\nM8\nG1 X10\n" * 5
            + "G40\nG1 X1\nM2\n"
        )
        whole = read(text)
        monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 30)
        parts = read(text)
        for name in ("line", "kind", "end", "centre", "sweep", "feed", "stop_after", "zero_lines"):
            assert np.array_equal(getattr(whole, name), getattr(parts, name), equal_nan=True), name
        assert whole.events == parts.events

    def test_loops_and_parameters(self, read):
        looped = "O1 repeat [3]\nG1 X[#5420+10]\nG1 Y[#5421+10]\nO1 endrepeat\n"
        plain = "".join(f"G1 X{10 * k}\nG1 Y{10 * k}\n" for k in (1, 2, 3))
        a, b = (read(HEAD + "G42.1 D2\n" + moves + "G40\nG1 X0\nM2\n") for moves in (looped, plain))
        assert a.end == pytest.approx(b.end, abs=1e-12)

    def test_events_come_after_the_move_that_they_follow(self, read):
        p = read(HEAD + "G42.1 D2\nG1 X10\nM8\nG1 Y10\nG4 P2\nG1 X0\nG40\nG1 Y0\nM2\n")
        assert p.kind[:4].tolist() == [LINE, ARC, LINE, ARC]
        assert [(e.kind, e.after_move) for e in p.events] == [("coolant", 0), ("dwell", 2), ("end", 5)]
        assert p.stop_after.tolist() == [False, False, True, False, False, True]


class TestLatheTools:
    @pytest.mark.parametrize(
        ("orientation", "z", "x"),
        [(1, 1, -1), (2, -1, -1), (3, -1, 1), (4, 1, 1), (5, 1, 0), (6, 0, -1), (7, -1, 0), (8, 0, 1), (9, 0, 0)],
    )
    def test_the_control_point_is_at_the_side_of_the_tool(self, read, orientation, z, x):
        head = "G18 F300\nG0 X0 Z0\n"
        moves = "G1 Z-10\nG1 Z-20\nG40\nG1 X9 Z9\nM2\n"
        middle, tool = (read(head + f"G42.1 D2{word}\n" + moves) for word in ("", f" L{orientation}"))
        assert (tool.end - middle.end)[:2, :3] == pytest.approx(np.tile([x, 0, z], (2, 1)), abs=1e-12)
        assert tool.end[2, :3].tolist() == middle.end[2, :3].tolist() == [9, 0, 9]
        table = read(head + "T4 M6\nG42\n" + moves, tools={4: Tool(diameter=2.0, orientation=orientation)})
        assert np.array_equal(table.end, tool.end)

    def test_an_arc_cannot_be_their_entry(self, refusal):
        """LinuxCNC sends a line to the end of the arc, and then a full turn."""
        assert refusal("G18 F300\nG0 X20 Z5\nG42.1 D2 L2\nG3 X30 Z-5 R20\nG40\nM2") == (
            "4: G3: the first move beside which a lathe tool goes must be straight: G0 or G1"
        )


TABLE = {1: Tool(diameter=2.0), 2: Tool(diameter=3.0)}


class TestTools:
    @pytest.mark.parametrize(
        ("words", "radius"), [("G42 D1", 1.0), ("T2 M6\nG42", 1.5), ("T2 M6\nG42 D0", 1.5), ("M61 Q1\nG42 D2", 1.5)]
    )
    def test_the_one_that_is_named_or_in_the_spindle(self, read, words, radius):
        p = read(HEAD + f"{words}\nG1 X10\nG1 X20\nG40\nG1 Y9\nM2\n", tools=TABLE)
        assert p.end[:2, 1] == pytest.approx(np.full(2, -radius))

    def test_the_radius_that_the_program_writes(self, read):
        p = read("G10 L1 P1 R4\n" + HEAD + "G42 D1\nG1 X10\nG1 X20\nG40\nG1 Y9\nM2\n", tools=TABLE)
        assert p.end[:2, 1].tolist() == [-4, -4]
        p = read("G20\nG10 L1 P7 R0.5\n" + HEAD + "G42 D7\nG1 X20\nG1 X40\nG40\nG1 Y9\nM2\n")
        assert p.end[:2, 1] == pytest.approx(np.full(2, -12.7))

    def test_a_tool_that_nobody_describes(self, refusal):
        assert refusal(HEAD + "G41 D3\nM2") == (
            "3: G41: the diameter of tool 3 is not known; give a tool table with a line T3 D6 (--tools), or write G41.1 D "
            "with the diameter"
        )
        assert refusal(HEAD + "T5 M6\nG42\nM2").startswith("4: G42: the diameter of tool 5 is not known")

    def test_a_table_without_a_diameter_is_said(self, read):
        p = read(HEAD + "G42 D1\nG1 X10\nG40\nM2\n", tools={1: Tool()})
        assert p.notes == ("taken for 0, since the program does not say: the diameter of tool 1 (line 3)",)

    def test_the_orientation_in_a_table(self, tmp_path):
        from planner.programs.reading.setup import read_tool_table

        (tmp_path / "t.tbl").write_text("T1 P1 D2 Q3\n")
        assert read_tool_table(tmp_path / "t.tbl")[1] == Tool((0.0, 0.0, 0.0), 2.0, 3)
        (tmp_path / "t.tbl").write_text("T1 P1 D2 Q12\n")
        with pytest.raises(InputError, match=r"t\.tbl:1: Q12: the orientation of a tool is a whole number from 0 to 9"):
            read_tool_table(tmp_path / "t.tbl")


NOT_BESIDE = "is not possible while cutter compensation is on; write G40 before it"
# What stands behind G21 F300, G0 X0 Y0, G42.1 D2 and G1 X10, in line 5 on.
REFUSED_BESIDE = {
    "G18": f"5: G18: {NOT_BESIDE}",
    "G28": f"5: G28: {NOT_BESIDE}",
    "G28.1": f"5: G28.1: {NOT_BESIDE}",
    "G30 X1": f"5: G30: {NOT_BESIDE}",
    "G53 G0 X20": f"5: G53: {NOT_BESIDE}",
    "G54": f"5: G54: {NOT_BESIDE}",
    "G92 X1": f"5: G92: {NOT_BESIDE}",
    "G10 L2 P1 X1": f"5: G10: {NOT_BESIDE}",
    "G10 L20 P0 X1": f"5: G10: {NOT_BESIDE}",
    "G43 H1": f"5: G43: {NOT_BESIDE}",
    "G49": f"5: G49: {NOT_BESIDE}",
    "G64 P0.1": f"5: G64: {NOT_BESIDE}",
    "G61": f"5: G61: {NOT_BESIDE}",
    "G98": f"5: G98: {NOT_BESIDE}",
    "G81 X20 Z-1 R1": f"5: G81: {NOT_BESIDE}",
    "G38.2 X20": f"5: G38.2: {NOT_BESIDE}",
    "T1 M6": f"5: M6: {NOT_BESIDE}",
    "G40 T1 M6": f"5: M6: {NOT_BESIDE}",
    "M64 P1": f"5: M64: {NOT_BESIDE}",
    "M48": f"5: M48: {NOT_BESIDE}",
    "G42.1 D2": "5: G42.1: compensation is on already; write G40 before it",
    "G41 D1": "5: G41: compensation is on already; write G40 before it",
}
TAKEN_BESIDE = (
    "G17", "G20", "G21", "G90", "G91", "G90.1", "G93", "G94 F300", "G10 L2 P2 X1", "G80", "G4 P1", "M0", "M1", "M3 S9", "M5",
    "M8", "M9", "S5", "T3", "G97", "G40 G54", "M19 R3", "G10 L1 P1 Z4", "M61 Q3",
)  # fmt: skip


class TestWhatIsRefused:
    @pytest.mark.parametrize("words", REFUSED_BESIDE)
    def test_words_that_cannot_stand_beside(self, refusal, words):
        assert refusal(HEAD + f"G42.1 D2\nG1 X10\n{words}\nG40\nM2\n") == REFUSED_BESIDE[words]

    @pytest.mark.parametrize("words", TAKEN_BESIDE)
    def test_words_that_can(self, read, words):
        assert len(read(HEAD + f"G42.1 D2\nG1 X10\n{words}\nG40\nM2\n")) == 1

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G41.1\nM2", "1: G41.1: needs D beside it"),
            ("G41 D1.5\nM2", "1: D1.5: must be a whole number"),
            ("G41 D-1\nM2", "1: D-1: must not be negative"),
            (
                "G40 D1\nM2",
                "1: D1: belongs to a word that is not in the block; it is read beside G41, G42, G41.1, G42.1, G96",
            ),
            ("G41.1 D2 L3\nM2", "1: L3: the orientation of a lathe tool needs the plane G18"),
            ("G19 G41.1 D2\nM2", "1: G41.1: the tool can be beside a path in G17 and G18, not in G19"),
            ("G41.1 D2 G40\nM2", "1: G40: G41.1 of the same modal group is in the block already"),
            ("G81 Z-1 R1 X0 F99\nG41.1 D2\nX5\nM2", f"3: X5: a cycle {NOT_BESIDE}"),
        ],
    )
    def test_words_that_do_not_fit(self, refusal, text, message):
        assert refusal(text).startswith(message)

    @pytest.mark.parametrize(
        ("moves", "message"),
        [
            ("G1 X1", "4: G1: the first move beside which the tool goes has 1 mm in the plane; it must be longer than"),
            ("G1 Z5", "4: G1: the first move beside which the tool goes has 0 mm in the plane"),
            (
                "G3 X1 I.5",
                "4: G3: the first move beside which the tool goes is an arc; its radius, and the way to its end,",
            ),
            ("G1 X10\nG3 X10 Y2 J1", "5: G3: the tool of radius 1 mm does not fit into the arc of 1 mm"),
            (
                "G1 X10\nG1 Y10\nG1 X9.5\nG1 Y5",
                "7: G1: the inside corner cuts more from the line before than there is of it",
            ),
            (
                "G1 X10\nG3 X4.5258 Y-4.4758 I-.4992 J-4.975",
                "5: G3: the tool does not fit into the inside corner of arc and",
            ),
            (
                "G1 X10\nG3 X11.7431 Y0.0761 J20\nG1 Y20",
                "6: G1: the inside corner cuts more from the arc before than there",
            ),
            ("G1 X10 Y0\nG40\nG3 X20 I5", "6: G3: the move after G40 must be straight; write G0 or G1 before the arc"),
        ],
    )
    def test_gouges(self, refusal, moves, message):
        assert refusal(HEAD + f"G41.1 D{4 if 'X11.7' in moves else 2}\n{moves}\nG40\nG1 X50\nM2\n").startswith(message)


class TestDistance:
    """Every point of the tool's path is as far from a contour as the radius, on its side.

    At a corner of less than 0.05 rad, which has no arc, it may be nearer by radius (1 - cos 0.05).
    """

    @pytest.mark.parametrize("outside", [True, False])
    def test_of_contours_of_lines(self, read, outside):
        counted, refused = 0, []
        for seed in range(60):
            rng = np.random.default_rng(seed)
            count = int(rng.integers(5, 10))
            angles = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
            corners = np.round(rng.uniform(18, 30, count) * np.exp(1j * angles), 4)
            along = corners[0] + 0.5 * (corners[1] - corners[0])
            begin = (1.4 if outside else 0.5) * along
            word = "G42.1" if outside else "G41.1"  # the contour is run counterclockwise
            text = f"F300\nG0 X{begin.real:.4f} Y{begin.imag:.4f}\n{word} D3\n"
            text += "".join(f"G1 X{z.real:.5f} Y{z.imag:.5f}\n" for z in [along, *corners[1:], corners[0], along])
            try:
                p = read(text + "G40\nG0 X0 Y0 Z9\nM2\n")
            except InputError as error:
                refused.append(str(error))
                continue
            points = sampled(p, range(1, len(p) - 1))
            assert distance_to(corners, points) == pytest.approx(
                np.full(len(points), 1.5), abs=1.5 * (1 - np.cos(0.05))
            ), seed
            spokes = corners[:, None] - (points[:, 0] + 1j * points[:, 1])
            winding = np.angle(np.roll(spokes, -1, axis=0) / spokes).sum(axis=0) / (2 * np.pi)
            assert winding == pytest.approx(np.full(len(points), 0.0 if outside else 1.0), abs=1e-9), seed
            counted += 1
        assert counted > 30
        assert [text for text in refused if "the inside corner cuts more" not in text] == []


@pytest.mark.skipif(not HAS_LINUXCNC, reason="LinuxCNC's interpreter rs274 is not installed")
class TestAgainstLinuxCNC:
    def test_the_same_moves_and_the_same_refusals(self, tmp_path):
        (tmp_path / "mm.tbl").write_text(TOOLS_MM)
        moves = refused = arcs_that_lead_back = 0
        wrong = []
        for seed in range(500):
            draw = Draw(seed)
            text = draw.program()
            theirs = canonical(text, tmp_path)
            try:
                ours = read_program(tmp_path / "part.ngc", start=(0, 0, 0), tools=tmp_path / "mm.tbl")
            except InputError as error:
                if theirs is not None and "no arc leads from here" in str(error):
                    arcs_that_lead_back += 1
                elif theirs is not None:
                    wrong.append((seed, str(error)))
                refused += 1
                continue
            if theirs is None:
                wrong.append((seed, "taken"))
            elif found := difference(ours, theirs[1:], 4e-3 if draw.inch else 1.1e-3):
                wrong.append((seed, found))
            else:
                moves += len(ours)
        assert wrong == []
        assert moves > 3000
        assert 100 < refused < 300
        assert arcs_that_lead_back < 10


class TestSplines:
    """Beside a spline no tool is led, but the program may have both."""

    def test_refused_beside_compensation(self, refusal):
        assert refusal(HEAD + "G41.1 D2\nG1 X10 Y0\nG5.1 X20 Y0 I5 J5\nG40\nM2\n").startswith("5: G5.1: ")

    def test_after_g40_a_line_comes_first(self, refusal):
        text = HEAD + "G41.1 D2\nG1 X10 Y0\nG40\nG5.1 X20 Y0 I5 J5\nM2\n"
        assert refusal(text) == "6: spline: the move after G40 must be straight; write G0 or G1 before the spline"

    def test_before_and_after_it_is_as_programmed(self, read):
        spline = "G5.1 X{} Y0 I5 J5\n"
        program = read(
            HEAD + spline.format(10) + "G41.1 D2\nG1 X20\nX30\nG40\nG1 X40 Y0\n" + spline.format(50) + "M2\n"
        )
        assert program.kind.tolist() == [3, 1, 1, 1, 3]
        assert program.end[:, :2] == pytest.approx(np.array([[10, 0], [20, 1], [30, 1], [40, 0], [50, 0]]))
        assert program.curve.tolist() == [0, -1, -1, -1, 1]


class TestToolChangeBesideThePath:
    """M6 behind a G40 that no move follows: LinuxCNC asks the machine where it is, which is beside the programmed point."""

    BEGIN = "F600\nG41.1 D2\nG1 X10\nG1 X20 Z1\nG1 Z2\nG40\n"

    def test_without_a_change_the_next_move_leads_back_to_the_programmed_point(self, read):
        p = read(self.BEGIN + "G1 Z4\nM2\n")
        assert p.end[-1, :3] == pytest.approx([20, 0, 4], abs=1e-12)

    @pytest.mark.parametrize(
        ("after", "ends"),
        [
            ("G1 Z4\nG91 X3\nG90 X2\nY4", [[20, 1, 4], [23, 1, 4], [2, 1, 4], [2, 4, 4]]),
            ("G92 X0\nG1 X1 Y5\nG90 X2", [[21, 5, 2], [22, 5, 2]]),
            ("G28 Z5\nG0 X1", [[20, 1, 5], [20, 1, 0], [1, 1, 0]]),
            ("G81 X25 Z-1 R3\nG80", [[20, 1, 3], [25, 1, 3], [25, 1, -1], [25, 1, 3]]),
            ("T2 M6\nG1 X0", [[0, 1, 2]]),
        ],
    )
    def test_it_goes_on_from_where_the_tool_is(self, read, after, ends):
        p = read(self.BEGIN + f"T1 M6\n{after}\nM2\n")
        assert p.end[3:, :3] == pytest.approx(np.array(ends, dtype=float), abs=1e-12)
        assert p.start[3, :3] == pytest.approx([20, 1, 2], abs=1e-12)
        assert p.start[1:] == pytest.approx(p.end[:-1])

    def test_the_end_may_be_an_arc(self, read):
        p = read("F600\nG42.1 D2\nG1 X10\nG3 X20 Y10 J10\nG40\nT1 M6\nG1 Z4\nX0\nM2\n")
        assert p.end[-2:, :3] == pytest.approx(np.array([[21, 10, 4], [0, 10, 4]]), abs=1e-9)

    def test_a_move_between_is_to_the_programmed_point(self, read):
        p = read(self.BEGIN + "G0 Z3\nT1 M6\nG1 Z4\nM2\n")
        assert p.end[-2:, :3] == pytest.approx(np.array([[20, 0, 3], [20, 0, 4]]), abs=1e-12)

    def test_in_a_subroutine_and_with_parameters(self, read):
        p = read("O1 sub\nG0 Z#1\nO1 endsub\n" + self.BEGIN + "#1=[1+2]\nT1 M6\nO1 call [7]\nG1 X#<_x>\nM2\n")
        assert p.end[-1, :3] == pytest.approx([20, 1, 7], abs=1e-12)

    def test_compensation_again_without_a_move_is_refused(self, read):
        with pytest.raises(InputError, match=r":8: G41\.1: the tool stands beside the path before G40"):
            read(self.BEGIN + "T1 M6\nG41.1 D2\nG1 X40\nX60\nG40\nG1 X0\nM2\n")

    @pytest.mark.skipif(not HAS_LINUXCNC, reason="LinuxCNC's interpreter rs274 is not installed")
    @pytest.mark.parametrize("after", ["G1 Z4\nG91 X3\nG90 X2\nY4", "G92 X0\nG1 X1 Y5\nG90 X2", "G28 Z5\nG0 X1"])
    def test_as_linuxcnc(self, tmp_path, after):
        path = tmp_path / "part.ngc"
        path.write_text(self.BEGIN + f"T1 M6\n{after}\nM2\n")
        tools = {1: Tool((0.0, 0.0, 0.0), 3.0)}
        theirs = read_with_linuxcnc(path, tools=tools, from_zero=True)
        ours = read_program(path, tools=tools, start=(0, 0, 0))
        assert ours.end == pytest.approx(theirs.end, abs=1e-6)
