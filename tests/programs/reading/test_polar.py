"""Polar coordinates, against the same points in X and Y."""

import numpy as np
import pytest

HEAD = "G21 F600\nG0 X3 Y4 Z5\n"


class TestPolar:
    @pytest.mark.parametrize(
        ("line", "end"),
        [
            ("G1 @10 ^30", (10 * np.cos(np.pi / 6), 5.0)),
            ("G1 @10", (6.0, 8.0)),
            ("G1 ^90", (0.0, 5.0)),
            ("G1 ^[45+45] @#<_x>", (0.0, 3.0)),
            ("G91 G1 @5", (6.0, 8.0)),
            ("G91 G1 ^90", (-4.0, 3.0)),
            ("G91 G1 @-5 ^-90 Z1", (0.0, 0.0)),
            ("g2 @5 ^180 r5", (-5.0, 0.0)),
        ],
    )
    def test_ends(self, read, line, end):
        assert read(HEAD + line + "\nM2\n").end[-1, :2] == pytest.approx(end, abs=1e-12)

    def test_they_count_from_the_origin_of_the_program(self, read):
        p = read("G21 F600\nG10 L2 P2 X100\nG55 G0 X1 Y0\nG1 @2 ^90\nM2\n")
        assert p.end[-1, :3].tolist() == pytest.approx([100.0, 2.0, 0.0])

    def test_holes_on_a_circle(self, read):
        p = read("F600\nG0 X10 Y0 Z5\nG91 G81 ^60 Z-2 R-3 L6\nG80\nM2\n")
        holes = p.end[p.kind == 1]
        angle = np.radians(60.0 * np.arange(1, 7))
        assert holes[:, :3] == pytest.approx(
            np.column_stack([10 * np.cos(angle), 10 * np.sin(angle), np.zeros(6)]), abs=1e-12
        )
        assert set(p.line.tolist()) == {3}

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("G1 @5 X1", "3: @5: polar coordinates stand in place of X and Y, not beside them"),
            ("G20 G1 @5 ^3", "3: @5: polar coordinates beside G20, G21 or G53; write that word in a block before"),
            ("G0 X0 Y0\nG1 @5", "4: @5: at the origin no angle is known; give both @ and ^ in absolute distances"),
            (
                "G0 X0 Y0\nG91 G1 ^5 @4",
                "4: ^5: at the origin no angle is known; give both @ and ^ in absolute distances",
            ),
            ("G1 ^", "3: ^: a number, a parameter or an expression is missing"),
        ],
    )
    def test_refused(self, refusal, line, message):
        assert refusal(HEAD + line + "\nM2\n") == message
