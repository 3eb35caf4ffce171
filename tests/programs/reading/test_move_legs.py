"""Moves as legs, against the points the program says."""

import numpy as np
import pytest

from planner.programs.reading.move_legs import legs_of_moves

XYZ = np.arange(9) < 3


def legs_of(program, moves=XYZ):
    return legs_of_moves(program, np.arange(len(program)), moves)


class TestLegs:
    def test_each_leg_runs_from_start_to_end(self, read):
        program = read("G21 G1 X3 Y4 F600\nG2 X13 Y4 I5 J0\nG3 X13 Y4 Z2 I2 J0 P2\nG1 Z0\nM2\n")
        legs, length = legs_of(program)
        row = np.arange(len(program))
        assert length == pytest.approx(program.lengths)
        assert legs.at(row, np.zeros(row.size))[0] == pytest.approx(program.start[:, :3], abs=1e-9)
        assert legs.at(row, length)[0] == pytest.approx(program.end[:, :3], abs=1e-9)
        assert np.linalg.norm(legs.at(row, 0.3 * length)[1], axis=1) == pytest.approx(1.0)

    def test_half_an_arc(self, read):
        legs, length = legs_of(read("G21 F600\nG2 X10 Y0 I5 J0\nM2\n"))
        assert length == pytest.approx([5 * np.pi])
        assert legs.at(np.array([0]), 0.5 * length)[0] == pytest.approx(np.array([[5, 5, 0]]), abs=1e-12)

    def test_a_degree_counts_as_a_mm(self, read):
        legs, length = legs_of(read("G21 G1 X3 A4 F600\nM2\n"), np.isin(np.arange(9), [0, 3]))
        assert length == pytest.approx([5.0])
        assert legs.at(np.array([0]), length)[0] == pytest.approx(np.array([[3.0, 4.0]]))
