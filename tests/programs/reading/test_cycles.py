"""Canned cycles: the moves of each, written out by hand."""

import numpy as np
import pytest

from planner.programs.reading.program import LINE, RAPID

END = "\nM2\n"
START = "G98 F60\nG0 X0 Y0 Z10\nG1 Z5\n"


def moves(program, first=1):
    """Kind and end of the moves of a program after those of its start."""
    return [
        ("R" if k == RAPID else "L", *end)
        for k, end in zip(program.kind[first:], program.end[first:, :3].tolist(), strict=True)
    ]


class TestEachCycle:
    def test_drilling(self, read):
        p = read(START + "G81 X1 Y2 Z-3 R1" + END)
        assert moves(p) == [("R", 1, 2, 5), ("R", 1, 2, 1), ("L", 1, 2, -3), ("R", 1, 2, 5)]
        assert p.line.tolist() == [3, 4, 4, 4, 4]
        assert p.feed[3] == 1.0
        assert p.stop_after.all()

    @pytest.mark.parametrize("code", ["G82", "G86"])
    def test_with_a_dwell(self, read, code):
        p = read("M3\n" + START + f"{code} X1 Z-3 R1 P0.5\nX2" + END)
        one = [("R", 1, 0, 5), ("R", 1, 0, 1), ("L", 1, 0, -3), ("R", 1, 0, 5)]
        assert moves(p) == one + [(kind, 2, y, z) for kind, _, y, z in one]
        dwells = [(e.line, e.seconds, e.after_move) for e in p.events if e.kind == "dwell"]
        assert dwells == [(5, 0.5, 3), (6, 0.5, 7)]

    def test_pecks_that_clear_the_chips(self, read):
        p = read(START + "G83 X1 Z-3 R1 Q1.5" + END)
        assert moves(p) == [
            ("R", 1, 0, 5),
            ("R", 1, 0, 1),
            ("L", 1, 0, -0.5),
            ("R", 1, 0, 1),
            ("R", 1, 0, -0.246),
            ("L", 1, 0, -2),
            ("R", 1, 0, 1),
            ("R", 1, 0, -1.746),
            ("L", 1, 0, -3),
            ("R", 1, 0, 5),
        ]

    def test_pecks_that_break_the_chips(self, read):
        p = read(START + "G73 X1 Z-3 R1 Q2" + END)
        assert moves(p)[2:] == [("L", 1, 0, -1), ("R", 1, 0, -0.746), ("L", 1, 0, -3), ("R", 1, 0, 5)]

    def test_pecks_that_end_at_the_bottom_make_none_of_no_depth(self, read):
        p = read(START + "G83 X1 Z-0.6 R0.3 Q0.1" + END)
        assert moves(p).count(("R", 1, 0, 0.3)) == 9
        assert len(moves(p)) == 2 + 8 * 3 + 2

    def test_boring(self, read):
        p = read(START + "G85 X1 Z-3 R1" + END)
        assert moves(p)[2:] == [("L", 1, 0, -3), ("L", 1, 0, 1), ("R", 1, 0, 5)]

    def test_boring_with_a_dwell(self, read):
        p = read(START + "G89 X1 Z-3 R1 P2" + END)
        assert moves(p)[2:] == [("L", 1, 0, -3), ("L", 1, 0, 5)]
        assert [(e.seconds, e.after_move) for e in p.events if e.kind == "dwell"] == [(2.0, 3)]
        assert p.stop_after[3]

    @pytest.mark.parametrize(("code", "turn"), [("G74", "M4"), ("G84", "M3")])
    def test_tapping(self, read, code, turn):
        p = read(f"{turn} S100\n" + START + f"{code} X1 Z-3 R1" + END)
        assert moves(p)[2:] == [("L", 1, 0, -3), ("L", 1, 0, 5)]


class TestLevels:
    def test_a_file_starts_with_the_return_to_the_plane(self, read):
        """As LinuxCNC does, and unlike most other controllers."""
        p = read("F60\nG0 X0 Y0 Z10\nG1 Z5\nG81 X1 Z-3 R1" + END)
        assert moves(p)[-1] == ("R", 1, 0, 1)

    def test_back_to_the_plane(self, read):
        p = read(START + "G99 G81 X1 Z-3 R1\nX2\nG98 X3" + END)
        assert moves(p) == [
            *[("R", 1, 0, 5), ("R", 1, 0, 1), ("L", 1, 0, -3), ("R", 1, 0, 1)],
            *[("R", 2, 0, 1), ("L", 2, 0, -3), ("R", 2, 0, 1)],
            # To where the series began, which is where it goes back to, on the way to the next hole.
            *[("R", 3, 0, 5), ("R", 3, 0, 1), ("L", 3, 0, -3), ("R", 3, 0, 5)],
        ]

    def test_a_plane_above_the_start(self, read):
        p = read(START + "G81 X1 Z-3 R7" + END)
        assert moves(p) == [("R", 0, 0, 7), ("R", 1, 0, 7), ("L", 1, 0, -3), ("R", 1, 0, 7)]

    def test_another_motion_ends_the_series(self, read):
        p = read(START + "G81 X1 Z-3 R1\nG80\nG0 Z2\nG81 X3 Z-3 R1" + END)
        assert moves(p)[4:] == [("R", 1, 0, 2), ("R", 3, 0, 2), ("R", 3, 0, 1), ("L", 3, 0, -3), ("R", 3, 0, 2)]

    def test_incremental_with_repeats(self, read):
        p = read(START + "G91 G99 G81 X1 Y1 Z-2 R-3 L3\nG90 G0 X0" + END)
        hole = [("R", 1, 1, 5), ("R", 1, 1, 2), ("L", 1, 1, 0), ("R", 1, 1, 2)]
        rest = [("R", k, k, z) if z else ("L", k, k, 0) for k in (2, 3) for z in (2, 0, 2)]
        assert moves(p) == [*hole, *rest, ("R", 0, 3, 2)]

    def test_in_a_shifted_system(self, read):
        p = read("F60\nG10 L2 P1 X100 Z-50\n" + START + "G81 X1 Z-3 R1" + END)
        assert moves(p) == [("R", 101, 0, -45), ("R", 101, 0, -49), ("L", 101, 0, -53), ("R", 101, 0, -45)]

    def test_in_inches_the_gap_is_the_same(self, read):
        p = read("G20 G98 F60\nG0 X0 Y0 Z1\nG1 Z0.5\nG83 X1 Z-.2 R0.1 Q0.2" + END)
        ends = p.end[1:, 2] / 25.4
        assert ends == pytest.approx([0.5, 0.1, -0.1, 0.1, -0.09, -0.2, 0.5], abs=1e-12)

    @pytest.mark.parametrize(("plane", "order"), [("G18", (2, 0, 1)), ("G19", (1, 2, 0))])
    def test_in_other_planes(self, read, plane, order):
        i, j, n = order
        names = "XYZ"
        p = read(f"G98 F60 {plane}\nG0 X0 Y0 Z0\nG1 {names[n]}5\nG81 {names[i]}1 {names[j]}2 {names[n]}-3 R1" + END)
        assert p.end[1:, [i, j, n]].tolist() == [[1, 2, 5], [1, 2, 1], [1, 2, -3], [1, 2, 5]]

    def test_words_that_stay(self, read):
        p = read(START + "G82 X1 Z-3 R1 P0.5\nX2 R2\nX3 Z-1 P1" + END)
        assert [z for kind, _, _, z in moves(p) if kind == "L"] == [-3, -3, -1]
        assert [m for m in moves(p) if m[3] == 2] == [("R", 2, 0, 2), ("R", 3, 0, 2)]
        assert [e.seconds for e in p.events if e.kind == "dwell"] == [0.5, 0.5, 1.0]


class TestWhatIsRefused:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G81 X1 Z-1", "4: X1: the first block of a cycle G81 needs R"),
            ("G81 X1", "4: X1: the first block of a cycle G81 needs Z and R"),
            ("G83 X1 Z-1 R1", "4: X1: the first block of a cycle G83 needs Q"),
            ("G82 X1 Z-1 R1", "4: X1: the first block of a cycle G82 needs P"),
            ("G81 X1 Z-1 R1\nG83 X2 Z-1 Q1", "5: X2: the first block of a cycle G83 needs R"),
            ("G83 X1 Z-1 R1 Q0", "4: X1: the depth Q of a peck must be > 0"),
            (
                "G83 X1 Z-1000 R1 Q0.0001",
                "4: X1: makes 3e+07 moves of one block; at most 1000000 are read: look at Q and L",
            ),
            ("G81 X1 Z-1 R1 L0", "4: X1: a cycle is repeated at least once; L must be > 0"),
            ("G81 X1 Z-1 R-2", "4: X1: the plane R lies 1 mm below the bottom of the hole"),
            ("G93 G81 X1 Z-1 R1 F2", "4: X1: a cycle needs a feed in units a minute or a turn, G94 or G95"),
            ("G81 Z-1 R1 Q5", "4: Q5: belongs to a word that is not in the block"),
            ("G81", "4: G81: a cycle needs X, Y or Z"),
            ("G53 G81 X1 Z-1 R1", "4: G53: machine coordinates need G0 or G1"),
            ("G88 X1 Z-1 R1 P1", "4: G88: not read in this program: G88 (line 4, 1 time, cycles that wait for a hand)"),
        ],
    )
    def test_with_line_word_and_reason(self, refusal, text, message):
        assert refusal(START + text + END).startswith(message)


@pytest.mark.parametrize("seed", range(25))
def test_programs_written_out_by_hand_are_the_same(read, seed):
    """Holes at random, in a system at random: the plain moves, made without the reader, give the same program."""
    rng = np.random.default_rng(seed)
    x0, y0, z0 = rng.normal(0, 50, 3).round(2)
    cycles, plain = [f"F60\nG10 L2 P2 X{x0} Y{y0} Z{z0}\nG55"], ["F60"]
    level, at = 20.0, (0.0, 0.0)

    def go(kind, x, y, z):
        plain.append(f"G{kind} X{x + x0:.4f} Y{y + y0:.4f} Z{z + z0:.4f}")

    cycles.append("G0 X0 Y0 Z20")
    go(0, 0, 0, level)
    for _ in range(6):
        r, depth = round(rng.uniform(1, 15), 2), round(rng.uniform(-9, 0), 2)
        q, retract = round(rng.uniform(0.7, 4), 2), rng.integers(98, 100)
        code = rng.choice(["81", "83", "73", "85"])
        here = level
        for k in range(rng.integers(1, 4)):
            at = tuple(rng.normal(0, 30, 2).round(2))
            words = f" Z{depth} R{r}" + (f" Q{q}" if code in "8373" else "") if k == 0 else ""
            cycles.append(f"G{retract}" + (f" G{code}" if k == 0 else "") + f" X{at[0]} Y{at[1]}{words}")
            back = r if retract == 99 else level
            go(0, *at, here)
            go(0, *at, r)
            down = r - q
            while code in "8373" and down > depth + 1e-6:
                go(1, *at, down)
                if code == "83":
                    go(0, *at, r)
                go(0, *at, down + 0.254)
                down -= q
            go(1, *at, depth)
            if code == "85":
                go(1, *at, r)
            go(0, *at, back)
            here = back
        cycles.append(f"G80 G0 Z{level}")
        go(0, *at, level)
    ours, theirs = read("\n".join(cycles) + END), read("\n".join(plain) + END)
    assert ours.kind.tolist() == theirs.kind.tolist()
    assert len(ours) > 20
    assert ours.end == pytest.approx(theirs.end, abs=1e-3)
    assert ours.stop_after.tolist() == theirs.stop_after.tolist()
    assert {LINE, RAPID} == set(ours.kind.tolist())


def test_lines_of_cycles_are_timed(tmp_path, read):
    from planner import line_times, load_limits, plan_feedrate, program_path

    p = read(START + "G82 X10 Z-3 R1 P0.5\nX20\nG80\nG1 X30" + END)
    limits = load_limits("mill")
    path = program_path(p, 0.01, limits)
    times = line_times(p, path, plan_feedrate(path.curve, limits.for_curve(path.curve), intervals=path.intervals))
    assert times.line.tolist() == [2, 3, 4, 5, 7]
    assert times.length == pytest.approx([0, 5, 10 + 4 + 4 + 8, 10 + 4 + 4 + 8, 10])
    assert times.dwell.tolist() == [0, 0, 0.5, 0.5, 0]
    assert times.seconds.sum() == pytest.approx(times.moving)
    assert (np.diff(times.u_start) >= 0).all()
    assert times.u_end[:-1] == pytest.approx(times.u_start[1:])
