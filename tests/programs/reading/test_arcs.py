"""Arcs of a part program: centres, radii, turns, and what LinuxCNC allows of them."""

import numpy as np
import pytest

from planner import load_curve
from planner.programs.reading.program import ARC

END = "\nM2\n"


class TestArcs:
    @pytest.mark.parametrize(
        ("plane", "normal", "first", "second"), [("G17", 2, "X", "Y"), ("G18", 1, "Z", "X"), ("G19", 0, "Y", "Z")]
    )
    @pytest.mark.parametrize(("code", "sign"), [("G3", 1.0), ("G2", -1.0)])
    def test_a_quarter_in_each_plane(self, read, plane, normal, first, second, code, sign):
        offset = {"X": "I", "Y": "J", "Z": "K"}
        p = read(f"{plane} F60\nG1 {first}5 {second}0\n{code} {first}0 {second}{5 * sign} {offset[first]}-5" + END)
        assert p.normal[1] == normal
        assert p.sweep[1] == pytest.approx(sign * np.pi / 2, rel=1e-15)
        assert p.centre[1].tolist() == [0, 0, 0]
        # By the right-hand rule about the normal, the sweep takes the start to the end.
        axis = np.eye(3)[normal]
        arm = p.start[1, :3] - p.centre[1]
        turned = arm * np.cos(p.sweep[1]) + np.cross(axis, arm) * np.sin(p.sweep[1])
        assert p.centre[1] + turned == pytest.approx(p.end[1, :3], abs=1e-12)

    def test_a_full_circle(self, read):
        p = read("F60\nG2 I5\nG3 X0 Y0 J-2" + END)
        assert p.sweep.tolist() == [-2 * np.pi, 2 * np.pi]
        assert p.lengths == pytest.approx([10 * np.pi, 4 * np.pi], rel=1e-15)

    def test_a_helix(self, read):
        p = read("F60\nG3 X0 Y0 Z3 I4" + END)
        assert p.kind.tolist() == [ARC]
        assert p.lengths == pytest.approx([np.hypot(8 * np.pi, 3.0)], rel=1e-15)
        assert p.centre.tolist() == [[4, 0, 0]]

    @pytest.mark.parametrize(
        ("words", "centre", "sweep"),
        [
            ("G3 X6 Y0 R5", (3, 4), 2 * np.arcsin(0.6)),
            ("G3 X6 Y0 R-5", (3, -4), 2 * np.pi - 2 * np.arcsin(0.6)),
            ("G2 X6 Y0 R5", (3, -4), -2 * np.arcsin(0.6)),
            ("G2 X6 Y0 R-5", (3, 4), -(2 * np.pi - 2 * np.arcsin(0.6))),
            ("G3 X10 Y0 R5", (5, 0), np.pi),
        ],
    )
    def test_the_radius_form(self, read, words, centre, sweep):
        p = read(f"F60\n{words}" + END)
        assert p.centre[0, :2] == pytest.approx(centre, abs=1e-12)
        assert p.sweep == pytest.approx([sweep], rel=1e-12)

    def test_a_radius_short_by_its_digits_is_a_half_turn(self, read, refusal):
        """LinuxCNC takes 0.00127 mm of half the chord, whatever its length and unit."""
        p = read("F60\nG3 X10 Y0 R4.9999" + END)
        assert p.centre[0, :2] == pytest.approx((5, 0), abs=1e-12)
        assert abs(p.sweep[0]) == pytest.approx(np.pi)
        assert refusal("F60\nG3 X10 Y0 R4.99" + END).startswith("2: R4.99: start and end are 0.02 mm farther apart")
        for chord in (2.0, 20.0, 2000.0):
            assert len(read(f"F60\nG3 X{chord} Y0 R{chord / 2 - 0.00126:.5f}" + END)) == 1
            assert "farther apart" in refusal(f"F60\nG3 X{chord} Y0 R{chord / 2 - 0.00128:.5f}" + END)
        assert len(read("G20 F60\nG3 X2 Y0 R0.99996" + END)) == 1
        assert "farther apart" in refusal("G20 F60\nG3 X2 Y0 R0.99994" + END)

    def test_absolute_centres(self, read):
        p = read("F60\nG90.1\nG1 X10\nG3 X0 Y10 I0 J0\nG91.1 G3 X-10 Y0 J-10" + END)
        assert p.centre[1:, :2].tolist() == [[0, 0], [0, 0]]
        assert p.sweep[1:] == pytest.approx([np.pi / 2, np.pi / 2])

    @pytest.mark.parametrize("end", ["0.0049", "-0.0049"])
    def test_a_small_mismatch_of_the_radius_is_a_spiral(self, read, end):
        p = read(f"F60\nG1 X5\nG3 X{end} Y5 I-5" + END)
        radii = np.hypot(*(np.stack([p.start[1, :3], p.end[1, :3]]) - p.centre[1])[:, :2].T)
        assert radii == pytest.approx([5.0, np.hypot(5.0, 0.0049)], rel=1e-12)

    @pytest.mark.parametrize(
        ("unit", "radius", "allowed"),
        [
            ("G21", 1.0, 0.02828),
            ("G21", 20.0, 0.02828),
            ("G21", 100.0, 0.1),
            ("G21", 1000.0, 1.0),
            ("G21", 5000.0, 2.828),
            ("G20", 1.0, 0.002828),
            ("G20", 100.0, 0.1),
            ("G20", 500.0, 0.2828),
        ],
    )
    def test_what_the_radii_may_differ_by(self, read, refusal, unit, radius, allowed):
        """LinuxCNC's bounds, measured: 0.0283 mm or 0.00283 in, or 0.1 %, never more than 100 times the first."""
        for share, taken in ((0.995, True), (1.005, False)):
            far = radius + share * allowed  # of the larger radius 0.1 % is a little more
            text = f"{unit} F60\nG1 X{radius}\nG3 X{-far:.6f} Y0 I{-radius}" + END
            if taken:
                assert len(read(text)) == 2
            else:
                assert "they may differ by" in refusal(text)

    def test_an_arc_of_two_decimals_that_the_machine_runs(self, read):
        p = read("F60\nG1 X13.88 Y-39.21\nG3 X-22.28 Y-47.07 I-17.95 J-4.56" + END)
        assert p.end[1, :2].tolist() == [-22.28, -47.07]

    @pytest.mark.parametrize(("code", "sign"), [("G2", -1.0), ("G3", 1.0)])
    def test_several_turns(self, read, code, sign):
        p = read(f"F60\nG1 X4\n{code} X4 Y0 Z5 I-4 P5\n{code} X{4 if sign < 0 else -4} Y0 I-4 P2" + END)
        assert p.sweep[1] == pytest.approx(sign * 10 * np.pi, rel=1e-15)
        assert p.lengths[1] == pytest.approx(np.hypot(40 * np.pi, 5), rel=1e-14)
        assert p.sweep[2] == pytest.approx(sign * (4 if sign < 0 else 3) * np.pi, rel=1e-14)

    @pytest.mark.parametrize("turns", ["0", "1.5"])
    def test_turns_are_whole(self, refusal, turns):
        assert refusal(f"F60\nG3 I4 P{turns}\nM2") == (
            f"2: P{turns}: the turns of an arc must be a whole number of at least 1"
        )

    def test_turns_have_an_end(self, refusal, read):
        assert refusal("F60\nG3 I4 P10001\nM2") == "2: P10001: at most 10000 turns are read of one arc"
        assert read("F60\nG3 I4 P10000" + END).sweep[0] == pytest.approx(2e4 * np.pi, rel=1e-15)

    def test_turns_of_a_thread_are_planned(self, tmp_path):
        path = tmp_path / "thread.ngc"
        path.write_text("F800\nG1 X4\nG3 X4 Y0 Z-4 I-4 P5\nG1 X0\nM2\n")
        curve = load_curve(path, tolerance=0.01)
        assert curve.length == pytest.approx(8 + np.hypot(40 * np.pi, 4), abs=0.05)

    def test_a_full_circle_of_a_kilometre_is_said(self, read):
        p = read("F60\nG3 I-200000" + END)
        assert p.notes == (
            "line 2: start and end lie in one direction from the centre: by rule 1 full turns, 1256.64 m on a radius of "
            "200000 mm",
        )

    def test_the_length_of_a_spiral(self, read):
        p = read("F60\nG1 X10\nG3 X-10.005 Y0 I-10" + END)
        theta = np.linspace(0, np.pi, 200001)
        r = 10 + 0.005 * theta / np.pi
        exact = np.hypot(np.diff(r * np.cos(theta)), np.diff(r * np.sin(theta))).sum()
        assert p.lengths[1] == pytest.approx(exact, rel=1e-9)

    def test_a_modal_arc(self, read):
        p = read("F60\nG3 X10 I5\nX0 I-5" + END)
        assert p.kind.tolist() == [ARC, ARC]
        assert p.sweep == pytest.approx([np.pi, np.pi])
