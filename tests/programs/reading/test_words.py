"""Words of a part program: characters, numbers and comments as they are read, and the compiled loops of the reader."""

import numpy as np
import pytest
import reader_reference as reference

from planner.compiled import core
from planner.programs.reading.program import LINE

END = "\nM2\n"


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

    @pytest.mark.parametrize(
        ("written", "number"),
        [("-+2", -2.0), ("+-2", -2.0), ("--2", 2.0), ("-+-2", 2.0), (" - + .5", -0.5), ("++2", 2.0)],
    )
    def test_several_signs(self, read, written, number):
        """As LinuxCNC takes them."""
        assert read(f"G1 X{written} F60" + END).end[0, 0] == number
        assert read(f"#1=1\nG1 X{written} Y#1 F60" + END).end[0, 0] == number

    @pytest.mark.parametrize("word", ["G0.99999", "G1.00005", "G+1", "N1.5 G1", "n7G01.0"])
    def test_codes_as_linuxcnc_rounds_them(self, read, word):
        p = read(f"F60\n{word} X3" + END)
        assert p.end[0, 0] == 3.0
        assert p.kind.tolist() == [LINE]

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
