"""Programs as straight blocks: points of chords, stops, and what is refused."""

import numpy as np
import pytest

from planner import InputError
from planner.controllers.straight_blocks import straight_blocks


def blocks_of(program, count=8, waits_for=("dwell",)):
    return straight_blocks(program, "test", lambda radius, _angle, _length: np.full(radius.size, count), waits_for)


class TestChords:
    @pytest.mark.parametrize(
        ("text", "normal"),
        [
            ("G17 G3 X-5 Y0 I-5 J0", 2),
            ("G18 G3 X-5 Z0 I-5 K0", 1),
            ("G17 G2 X-5 Y0 Z4 I-5 J0", 2),
        ],
    )
    def test_equal_angles_on_the_circle(self, program, text, normal):
        blocks = blocks_of(program(f"F600\nG0 X5 Y0 Z0\n{text}\nM2\n"))
        assert blocks.length.size == 8
        ends = blocks.start + blocks.direction * blocks.length[:, None]
        plane = [k for k in range(3) if k != normal]
        assert np.linalg.norm(ends[:, plane], axis=1) == pytest.approx(5.0)
        assert blocks.length == pytest.approx(np.full(8, blocks.length[0]))
        assert ends[:-1] == pytest.approx(blocks.start[1:], abs=1e-12)
        assert ends[-1, plane] == pytest.approx([-5.0, 0.0], abs=1e-12)

    def test_direction(self, program):
        """Counterclockwise from the right goes up first."""
        blocks = blocks_of(program("F600\nG0 X5 Y0\nG3 X-5 Y0 I-5 J0\nM2\n"))
        assert blocks.direction[0, 1] > 0.9

    def test_a_radius_that_does_not_fit_is_left_to_the_last_chord(self, program):
        blocks = blocks_of(program("F600\nG0 X5 Y0\nG3 X-5.004 Y0 I-5 J0\nM2\n"))
        ends = blocks.start + blocks.direction * blocks.length[:, None]
        assert np.linalg.norm(ends[:-1, :2], axis=1) == pytest.approx(5.0)
        assert ends[-1, :2] == pytest.approx([-5.004, 0.0])

    def test_a_circle_that_is_one_chord_vanishes(self, program):
        blocks = blocks_of(program("F600\nG1 X1\nG3 X1 Y0 I-0.1 J0\nG1 X2\nM2\n"), count=1)
        assert blocks.line.tolist() == [2, 4]

    def test_nothing_else_is_left(self, program):
        with pytest.raises(InputError, match=r"part\.ngc:2: of the circle .* one chord"):
            blocks_of(program("F600\nG2 X0 Y0 I0.1 J0\nM2\n"), count=1)

    def test_too_many(self, program):
        with pytest.raises(InputError, match="are 30000000 chords; at most 20000000"):
            blocks_of(program("F600\nG2 X0 Y0 I5 J0\nM2\n"), count=30_000_000)


class TestStops:
    def test_only_what_is_waited_for(self, program):
        made = program("F600\nG1 X1\nM8\nX2\nG4 P1\nG3 X4 I1\nG4 P1\nG4 P1\nG1 X5\nM2\n")
        blocks = blocks_of(made, count=3)
        assert np.flatnonzero(blocks.stop).tolist() == [0, 2, 5, blocks.length.size]

    def test_before_the_first_move(self, program):
        blocks = blocks_of(program("G4 P1\nG1 X1 F60\nM2\n"))
        assert blocks.stop.tolist() == [True, True]


class TestRefused:
    def test_splines(self, program):
        with pytest.raises(InputError, match=r"part\.ngc:2: the controller test knows no splines"):
            blocks_of(program("G1 X1 F600\nG5 X4 Y4 I1 J1 P-1 Q-1\nM2\n"))

    def test_other_axes(self, program):
        with pytest.raises(InputError, match=r"part\.ngc:2: A: the model of test is of X Y Z"):
            blocks_of(program("G1 X1 F600\nA30\nM2\n"))

    def test_no_moves(self, program):
        with pytest.raises(InputError, match="moves nothing"):
            blocks_of(program("F600\nG4 P1\nM2\n"))
