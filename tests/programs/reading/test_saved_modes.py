"""M70 to M73: what is in force is kept, and brought back."""

import math

import pytest

CHANGED = "G20 G18 G91 G55 G61 G99 S7\nF5\n"


class TestSavedModes:
    def test_all_of_it_comes_back(self, read):
        head = "G21 G10 L2 P2 X1000\nG64 P0.02 Q0.003\nM3 S100\nG0 X0 Y0\nF600\n"
        p = read(f"{head}M70\n{CHANGED}M5 M8\nG1 X1\nM72\nG1 X10\nG2 X20 I5\nM2\n")
        assert p.end[1:, 0].tolist() == [10.0, 20.0]
        assert p.feed[1:].tolist() == [10.0, 10.0]
        assert p.tolerance[1:].tolist() == [0.02, 0.02]
        assert p.naive_tolerance[1:].tolist() == [0.003, 0.003]
        assert p.sweep[-1] == pytest.approx(-math.pi)
        assert [e.text for e in p.events if e.kind in ("spindle", "coolant")][-2:] == ["M3 S100", "M9"]

    def test_at_the_end_of_the_subroutine(self, read):
        sub = f"O1 sub\nM73\n{CHANGED}G1 X#1\nO2 if [#1 GT 1]\nO1 return\nO2 endif\nO1 endsub\n"
        p = read(sub + "G21 F600\nO1 call [1]\nG1 X1\nO1 call [2]\nG1 X2\nM2\n")
        assert p.end[:, 0].tolist() == pytest.approx([25.4, 1.0, 51.8, 2.0])
        assert p.feed == pytest.approx([5 * 25.4 / 60, 10.0, 5 * 25.4 / 60, 10.0])

    def test_of_a_program_called_by_m98(self, read):
        p = read("F600\nM98 P5\nG1 X1\nM2\nO5\nM73\nG91 G1 X7\nM99\n")
        assert p.end[:, 0].tolist() == [7.0, 1.0]

    def test_each_call_keeps_its_own(self, read):
        p = read("O1 sub\nM70\nF60\nM72\nO1 endsub\nF600\nM70\nF300\nO1 call\nG1 X1\nM72\nG1 X2\nM2\n")
        assert p.feed.tolist() == [5.0, 10.0]

    def test_what_was_forgotten_does_not_come_back(self, read, refusal):
        p = read("O1 sub\nM73\nM71\nF60\nO1 endsub\nF600\nO1 call\nG1 X1\nM2\n")
        assert p.feed.tolist() == [1.0]
        assert refusal("F600\nM70\nM71\nM72\nM2\n") == (
            "4: M72: nothing is saved here that it could bring back; M70 or M73 saves what is in force"
        )

    def test_a_tool_length_and_the_plane_of_return(self, read):
        text = "T1 M6\nG10 L1 P1 Z10\nG43\nG98 F600\nG0 X0 Y0 Z20\nM70\nG49 G99\nM72\nG81 X1 Z0 R5\nG80\nM2\n"
        assert read(text).end[:, 2].tolist()[-4:] == [30.0, 15.0, 10.0, 30.0]
