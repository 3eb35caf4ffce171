"""What LinuxCNC's interpreter hands over: merged lines, halves of small arcs, limits."""

import math

import numpy as np
import pytest

from planner.compiled import core
from planner.controllers.linuxcnc_moves import EXACT, PARABOLIC, STOPS, linuxcnc_moves

HEAD = "G21 G90 G17 G94 F6000\n"
LIMITS = (np.array([200.0, 150.0, 20.0]), np.array([1000.0, 800.0, 200.0]))


class TestMerging:
    def test_kernel(self):
        """Against the rule, written once more."""
        rng = np.random.default_rng(4)
        merged = 0
        for _ in range(40):
            n = 260
            end = np.cumsum(rng.normal(size=(n, 3)) * [1.0, 0.02, 0.02] + [0.8, 0.0, 0.0], axis=0)
            tolerance = np.repeat(rng.choice([0.0, 0.02, 0.1], size=n // 10), 10)
            apart = rng.random(n) < 0.02
            kept = np.zeros(n, dtype=np.bool_)
            core.linuxcnc_merge(n, end, np.zeros(3), tolerance, apart, kept)
            expected, base, chain = np.zeros(n, dtype=np.bool_), np.zeros(3), []
            for i in range(n):
                if chain and (apart[i] or len(chain) > 100 or not _goes_on(base, end[chain], end[i], tolerance[i])):
                    expected[chain[-1]], base, chain = True, end[chain[-1]], []
                chain.append(i)
            expected[-1] = True
            assert (kept == expected).all()
            merged += n - kept.sum()
        assert merged > 1000

    def test_a_changed_feed_ends_it(self, program):
        moves = linuxcnc_moves(program(HEAD + "G64 P0.01\nG1 X1\nX2\nX3 F3000\nX4\nM2\n"), *LIMITS)
        assert moves.line.tolist() == [4, 6]

    def test_q0_does_not_merge(self, program):
        moves = linuxcnc_moves(program(HEAD + "G64 P0.01 Q0\nG1 X1\nX2\nM2\n"), *LIMITS)
        assert moves.line.tolist() == [3, 4]

    def test_small_arcs_become_chords(self, program):
        text = HEAD + "G64 P{}\nG3 X0.1 Y0.1 I0 J0.1\nM2\n"
        assert linuxcnc_moves(program(text.format(0.05)), *LIMITS).rows[:, 12].tolist() == [0.0]
        assert linuxcnc_moves(program(text.format(0.01)), *LIMITS).rows[:, 12].tolist() == [1.0]


def _goes_on(base, points, to, tolerance):
    """Whether all the points lie within the tolerance of the line from base to there."""
    whole = to - base
    if tolerance == 0.0 or not whole.any():
        return False
    share = np.clip((points - base) @ whole / (whole @ whole), 0.0, 1.0)
    return np.linalg.norm(points - base - share[:, None] * whole, axis=1).max() <= tolerance


class TestRows:
    def test_ends(self, program):
        text = "G1 X1\nG61\nX2\nG61.1\nX3\nG64 P0.1\nX4\nG81 X5 Z-1 R1\nM2\n"
        moves = linuxcnc_moves(program(HEAD + text), *LIMITS)
        assert moves.rows[:4, 14].tolist() == [PARABOLIC, EXACT, STOPS, PARABOLIC]
        assert set(moves.rows[4:, 14].tolist()) == {EXACT}  # of a cycle
        assert moves.rows[[0, 3], 16].tolist() == [0.0, 0.1]

    def test_limits_of_an_arc(self, program):
        """The slower of X and Y, and what is across."""
        row = linuxcnc_moves(program(HEAD + "G61\nG2 X0 Y0 I5 J0\nM2\n"), *LIMITS).rows[0]
        assert row[18] == pytest.approx(math.sqrt(math.sqrt(0.75) * 800.0 * 5.0))
        assert row[19] == pytest.approx(800.0)

    def test_limits_of_a_helix(self, program):
        """Z alone would take 10 mm / 20 mm/s."""
        row = linuxcnc_moves(program(HEAD + "G61\nG2 X0 Y0 Z-10 I5 J0\nM2\n"), *LIMITS).rows[0]
        length = math.hypot(10.0 * math.pi, 10.0)
        assert row[18] == pytest.approx(length / max(0.5, 10.0 * math.pi / math.sqrt(math.sqrt(0.75) * 800.0 * 5.0)))
