"""Part programs that are refused: the line, the word and the reason."""

import re

import numpy as np
import pytest

from planner.errors import InputError
from planner.machine.limits import Limits
from planner.programs.reading.reader import read_program

NO_END = "end of file: there is no M2, M30 or closing %; the file may have been cut off, else end it with M2"


def unread(line, name, why):
    """The message for one word that is not read."""
    return (
        f"{line}: {name}: not read in this program: {name} (line {line}, 1 time{why}); post it without them, or pass over "
        "those that move nothing: --ignore WORD for each, or let an installed LinuxCNC read it: --reader rs274"
    )


REFUSED = {
    # text: message after the name of the file
    "A90\nM2": "1: A90: no G0, G1, G2, G3 or cycle is active",
    "F60\nG2 A90\nM2": "2: A90: an arc needs a centre I, J, K or a radius R",
    "F60\nG0 Z1\nG81 X1 Z-1 R0.5 B5\nM2": (
        "3: B5: a cycle moves X, Y and Z alone; write the move of the other axis in a block of its own"
    ),
    "F60\nG81 W3\nM2": (
        "2: W3: a cycle moves X, Y and Z alone; write the move of the other axis in a block of its own"
    ),
    "G0 G92 C1\nM2": "1: C1: belongs to the other word of the block; write the motion in a block of its own",
    "F60\nG1 A1 A2\nM2": "2: A2: the block has A1 already",
    "G87 X1 Z-1 R1\nM2": unread(1, "G87", ", cycles that wait for a hand"),
    "G12\nM2": unread(1, "G12", ""),
    "G1.05 X1\nM2": unread(1, "G1.05", ""),
    "G1 X1e3 F60\nM2": (
        "1: E3: a number has no exponent; E belongs to a word that is not in the block; it is read beside "
        "M66, M67, M68, G76"
    ),
    "G1 X1\nM2": "1: G1: no feed is given; F is missing",
    "G0 X1\nG1\nX5 Y3\nM2": "3: X5: no feed is given; F is missing",
    "F0\nG1 X1\nM2": "2: G1: the feed is 0; F must be > 0",
    "G1 X1 F-5\nM2": "1: F-5: must not be negative",
    "G93\nG1 X1 F2\nX2\nM2": "3: X2: G93 needs an F in every block that cuts",
    "G91 F60\nG53 G1 X1\nM2": "2: G53: machine coordinates are absolute; write G90 before",
    "G92\nM2": "1: G92: needs the axes that it shifts",
    "G38.2 F60\nM2": "1: G38.2: a probe needs the end of its move",
    "M66\nM2": "1: M66: needs the number of an input, P or E",
    "F60\nG84 X1 Z-1 R1\nM2": "2: X1: a cycle G84 needs a spindle that turns, M3",
    "F60 M4\nG84 X1 Z-1 R1\nM2": "2: X1: the spindle turns the other way; a cycle G84 needs M3",
    "F60\nG86 X1 Z-1 R1 P1\nM2": "2: X1: a cycle G86 needs a spindle that turns, M3 or M4",
    "F60 M4\nG74 X1 Z-1 R1 L2\nM2": (
        "2: L2: belongs to a word that is not in the block; it is read beside G10, G41.1, G42.1, M66, G76, G5.2, G81, "
        "G85 ..."
    ),
    "G18 F60\nG1 @1 ^2\nM2": "2: @1: polar coordinates are in the plane G17, which is not in force",
    "G93 G1 X1 F0\nM2": "1: F0: must be > 0",
    "F60\nG93 G1 X1 F2\nG94 X2\nM2": "3: X2: no feed is given; F is missing",
    "G0 G1 X1 F60\nM2": "1: G1: G0 of the same modal group is in the block already",
    "G90 G91\nM2": "1: G91: G90 of the same modal group is in the block already",
    "G17 G18 G19\nM2": "1: G18: G17 of the same modal group is in the block already",
    "M3 M4 S1\nM2": "1: M4: M3 of the same modal group is in the block already",
    "G1 X1 Y2 X3 F60\nM2": "1: X3: the block has X1 already",
    "X1\nM2": "1: X1: no G0, G1, G2, G3 or cycle is active",
    "G80\nX1\nM2": "2: X1: no G0, G1, G2, G3 or cycle is active",
    "G1 X1 I2 F60\nM2": "1: I2: belongs to G2 or G3, which is not active",
    "F60\nG2\nM2": "2: G2: an arc needs an end point or a centre",
    "F60\nG2 X5\nM2": "2: X5: an arc needs a centre I, J, K or a radius R",
    "F60\nG2 X5 I1 R3\nM2": "2: R3: an arc has a radius R or a centre I, J, K, not both",
    "F60\nG2 X5 R0\nM2": "2: R0: the radius must not be 0",
    "F60\nG2 X5 I2.5 K1\nM2": "2: K1: is along the normal of the plane, G17",
    "F60 G18\nG2 X5 I2.5 J1\nM2": "2: J1: is along the normal of the plane, G18",
    "F60\nG90.1\nG2 X5 I2.5\nM2": "3: I2.5: under G90.1 the arc needs J as well",
    "F60\nG2 X10 Y0 I4\nM2": (
        "2: I4: start and end lie 4 and 6 mm from the centre; they may differ by 0.0283 mm"
    ),
    "F60\nG2 X10 Y0 R4\nM2": "2: R4: start and end are 2 mm farther apart than twice the radius",
    "F60\nG2 X0 Y0 R4\nM2": "2: R4: a full circle has no radius form; give its centre with I, J, K",
    "F60\nG2 X0 Y0.003 I0 J0\nM2": "2: I0: the centre lies on the start or the end of the arc",
    "G4\nM2": "1: G4: needs the time P in seconds",
    "G4 P-1\nM2": "1: P-1: must not be negative",
    "P1\nM2": (
        "1: P1: belongs to a word that is not in the block; it is read beside G4, G10, G64, M19, M62, M63, M64, M65 ..."
    ),
    "G64 G4 P1\nM2": "1: P1: could belong to several words of the block; write them in two blocks",
    "Q1\nM2": (
        "1: Q1: belongs to a word that is not in the block; it is read beside G64, M61, M19, M66, M67, M68, G76, G5 ..."
    ),
    "G0 N10 X1\nM2": "1: N10: a line number must come first in its block",
    "T1.5\nM2": "1: T1.5: must be a whole number",
    "S-1\nM2": "1: S-1: must not be negative",
    "G1 X F60\nM2": "1: X: a letter needs a number after it",
    "G1 X. F60\nM2": "1: X.: a letter needs a number after it",
    "G1 X1.2.3 F60\nM2": "1: .3: a number needs a letter before it",
    "G1 X1 2 F60\nM2": "1: 2: a number needs a letter before it",
    "G1 X-- F60\nM2": "1: X--: a letter needs a number after it",
    "G1 X1 ! F60\nM2": "1: !: no word starts with it",
    "G1 X1 (open\nY2 F60\nM2": "1: (OPEN: a comment that is not closed with ) in its line, or that holds another",
    "(a (b) c)\nM2": "1: (A: a comment that is not closed with ) in its line, or that holds another",
    "G1 X1) F60\nM2": "1: ): no word starts with it",
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
    "G1 X1 F1000000001\nM2": "1: F1000000001: the number must be at most 1e+09",
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
        assert refusal("F60\n" + "G1 X1\nX2\n" * 200 + "G12 X9\nM2").startswith("402: G12:")
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
        p = read("F60\nG1 X1\nG1 Z5" + "\nM2\n")
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


def test_lines_that_end_with_cr_alone_are_named(tmp_path):
    (tmp_path / "mac.ngc").write_bytes(b"G21 G90\rG0 X0 Y0\rG1 X10 F600\rM2\r")
    with pytest.raises(InputError, match=r"mac\.ngc: its lines end with CR alone; save it with LF or CR LF"):
        read_program(tmp_path / "mac.ngc")
    (tmp_path / "one.ngc").write_bytes(b"G21 G90 G1 X10 F600 M2\r\n")
    assert read_program(tmp_path / "one.ngc").lengths.sum() == pytest.approx(10.0)
