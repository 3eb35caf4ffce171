"""Splines of part programs: curves of scipy, LinuxCNC's own chords, and what is refused with which words."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

from planner.programs.linuxcnc import canon
from planner.programs.linuxcnc.interpreter import canonical_calls, is_installed
from planner.programs.reading.program import LINE, RAPID, SPLINE
from planner.programs.reading.reader import read_program

END = "\nM2\n"
HALF = float(np.sqrt(0.5))


def points_of(program, moves, count=40):
    """Points of spline moves, evenly by length, (k, 3)."""
    out = []
    for k in moves:
        row = np.full(count, program.curve[k])
        s = np.linspace(0.0, program.lengths[k], count)
        out.append(program.beziers.at(row, s)[0] + program.beziers.start[program.curve[k]])
    return np.concatenate(out)[:, :3]


def nurbs_oracle(control, weights, knots, degree):
    """Many points of a NURBS by scipy, (n, dim)."""
    control, weights = np.asarray(control, dtype=float), np.asarray(weights, dtype=float)
    spline = BSpline(np.asarray(knots, dtype=float), np.column_stack([control * weights[:, None], weights]), degree)
    knots = np.asarray(knots, dtype=float)
    last = np.nextafter(knots[-degree - 1], -np.inf)
    u = np.union1d(np.linspace(knots[degree], last, 20001), np.minimum(knots, last))
    found = spline(u)
    return found[:, :-1] / found[:, -1:]


def from_points_to_chords(points, dense):
    """The largest distance from points to the polyline through many others."""
    near = cKDTree(dense).query(points)[1]
    away = []
    for first in (near - 1, near):
        a, b = (dense[np.clip(first + k, 0, len(dense) - 1)] for k in (0, 1))
        t = ((points - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1).clip(1e-300)
        away.append(np.sqrt(((a + np.clip(t, 0.0, 1.0)[:, None] * (b - a) - points) ** 2).sum(axis=1)))
    return float(np.minimum(*away).max())


def numbers(points):
    return " ".join(f"{name}{value:.17g}" for name, value in zip("XYZ", points, strict=False))


def g52(control, weights, order):
    """G5.2 to G5.3 from a first point at which the machine stands."""
    head = f"G5.2 P{weights[0]!r} L{order}" if weights[0] != 1.0 else ""
    rows = [f"{numbers(p)} P{w!r}" for p, w in zip(control[1:], weights[1:], strict=True)]
    if not head:
        rows[0] = f"G5.2 {rows[0]} L{order}"
    return "\n".join([head, *rows, "G5.3"]).strip()


def g62(control, weights, knots, order):
    """G6.2 from a first point at which the machine stands."""
    rows = [f"K{k!r} {numbers(p)} R{w!r}" for k, p, w in zip(knots, control, weights, strict=False)]
    return "\n".join([f"G6.2 P{order} {rows[0]}", *rows[1:], *(f"K{k!r}" for k in knots[len(control) :])])


def uniform_knots(count, order):
    """As LinuxCNC makes them: clamped, evenly spaced."""
    return [0.0] * order + [float(i) for i in range(1, count - order + 1)] + [float(count - order + 1)] * order


class TestCubic:
    def test_is_the_bezier_curve_of_its_handles(self, read):
        p = read("G0 X1 Y2\nG5 X11 Y4 I3 J5 P-2 Q6 F600" + END)
        on = np.flatnonzero(p.kind == SPLINE)
        assert p.line.tolist() == [2] * len(p)
        control = [[1, 2], [4, 7], [9, 10], [11, 4]]
        dense = nurbs_oracle(control, np.ones(4), [0] * 4 + [1] * 4, 3)
        assert from_points_to_chords(points_of(p, on)[:, :2], dense) < 1e-7
        assert p.start[0, :2].tolist() == [1, 2]
        assert p.end[-1, :2].tolist() == [11, 4]
        assert (p.start[1:] == p.end[:-1]).all()
        assert p.feed.tolist() == [10.0] * len(p)
        assert p.lengths.sum() == pytest.approx(np.sqrt((np.diff(dense, axis=0) ** 2).sum(axis=1)).sum(), rel=1e-8)

    def test_without_a_first_handle_goes_on_as_the_one_before_ended(self, read):
        whole = read("G5 X4 Y0 I1 J2 P-1 Q2 F60\nG5 X8 Y0 I1 J-2 P-1 Q2" + END)
        short = read("G5 X4 Y0 I1 J2 P-1 Q2 F60\nG5 X8 Y0 P-1 Q2" + END)
        bare = read("G5 X4 Y0 I1 J2 P-1 Q2 F60\nX8 Y0 P-1 Q2" + END)
        for other in (short, bare):
            assert points_of(other, range(len(other))).tolist() == points_of(whole, range(len(whole))).tolist()

    def test_goes_on_over_a_dwell_and_a_switch(self, read):
        p = read("G5 X4 Y0 I1 J2 P-1 Q2 F60\nM3 S100\nG4 P1\nG5 X8 Y0 P-1 Q2" + END)
        assert p.end[-1, :2].tolist() == [8, 0]

    def test_in_inches_and_relative(self, read):
        a = read("G20 G91 G0 X1 Y1\nG5 X1 Y0.5 I0.2 J0.3 P-0.1 Q0.4 F10" + END)
        b = read("G0 X25.4 Y25.4\nG5 X50.8 Y38.1 I5.08 J7.62 P-2.54 Q10.16 F254" + END)
        assert points_of(a, range(1, len(a))) - a.start[1, :3] == pytest.approx(
            points_of(b, range(len(b))) - b.start[0, :3], abs=1e-12
        )
        assert a.feed[-1] == pytest.approx(b.feed[-1])

    def test_under_inverse_time_has_one_rate(self, read):
        """A spline of several pieces takes the time of its block."""
        p = read("G93\nG5 X1 Y1 I0 J3 P0 Q-3 F12" + END)
        assert len(p) > 1
        assert (p.lengths / p.feed).sum() == pytest.approx(5.0, rel=1e-14)

    @pytest.mark.parametrize("handles", ["G5 I1 J0 P-2 Q0", "G5 I0 J0 P0 Q0", "G5 I0 J0 P-3 Q0", "G5.1 I0 J0"])
    def test_whose_handles_lie_on_its_line_is_a_line(self, read, handles):
        p = read(f"{handles} X10 Y0 F60" + END)
        assert p.kind.tolist() == [LINE]
        assert p.curve.tolist() == [-1]
        assert p.end[0, :2].tolist() == [10, 0]

    def test_is_where_its_axes_stand_from_the_start(self, read):
        """Z has its first word after the spline, which lies at that Z then."""
        p = read("G0 X1 Y1\nG5 X4 Y3 I1 J2 P-1 Q2 F60\nG0 Z7\nG1 Z0" + END)
        on = np.flatnonzero(p.kind == SPLINE)
        assert (points_of(p, on)[:, 2] == 7.0).all()
        assert (p.start[on, 2] == 7.0).all()

    def test_follows_offsets(self, read):
        p = read("G10 L2 P1 X100 Y10\nG0 X0 Y0\nG5 X4 Y0 I1 J2 P-1 Q2 F60" + END)
        assert points_of(p, [len(p) - 1])[-1, :2] == pytest.approx([104, 10], abs=1e-13)


class TestQuadratic:
    def test_is_the_bezier_curve_of_its_handle(self, read):
        p = read("G0 X1 Y1\nG5.1 X10 Y0 I5 J5 F60" + END)
        dense = nurbs_oracle([[1, 1], [6, 6], [10, 0]], np.ones(3), [0] * 3 + [1] * 3, 2)
        assert from_points_to_chords(points_of(p, np.flatnonzero(p.kind == SPLINE))[:, :2], dense) < 1e-7

    def test_one_handle_alone_or_none_is_refused(self, refusal):
        assert refusal("G5.1 X1 Y1 I1 F60" + END) == "1: I1: needs I and J, or with G5 neither"


class TestNurbs:
    @pytest.mark.parametrize("seed", range(8))
    def test_of_g52_is_scipys(self, read, seed):
        rng = np.random.default_rng(seed)
        order = int(rng.integers(3, 6))
        count = order + int(rng.integers(0, 5))
        control = np.cumsum(rng.uniform(-2.0, 8.0, (count, 2)), axis=0)
        weights = [1.0 if seed % 2 else float(rng.uniform(0.3, 3.0)), *rng.uniform(0.3, 3.0, count - 1).tolist()]
        p = read(f"G0 {numbers(control[0])}\nF600\n{g52(control, weights, order)}" + END)
        dense = nurbs_oracle(control, weights, uniform_knots(count, order), order - 1)
        assert from_points_to_chords(points_of(p, range(len(p)), 9)[:, :2], dense) < 5e-6
        assert p.lengths.sum() == pytest.approx(np.sqrt((np.diff(dense, axis=0) ** 2).sum(axis=1)).sum(), rel=1e-6)
        assert (np.diff(p.line) >= 0).all()
        listed = set(p.line) | set(p.zero_lines)
        assert listed == {1, *range(3, p.line_count)}

    @pytest.mark.parametrize("seed", range(8))
    def test_of_g62_is_scipys(self, read, seed):
        rng = np.random.default_rng(100 + seed)
        order = int(rng.integers(2, 6))
        count = order + int(rng.integers(0, 5))
        control = np.cumsum(rng.uniform(-2.0, 8.0, (count, 3)), axis=0)
        weights = rng.uniform(0.3, 3.0, count).tolist()
        inner = np.sort(rng.uniform(0.0, 9.0, count - order)).tolist()
        knots = [0.0] * order + inner + [10.0] * order
        p = read(f"G0 {numbers(control[0])}\nF600\n{g62(control, weights, knots, order)}" + END)
        dense = nurbs_oracle(control, weights, knots, order - 1)
        assert from_points_to_chords(points_of(p, range(len(p)), 9), dense) < 5e-6
        assert p.end[-1, :3] == pytest.approx(control[-1], abs=1e-12)

    def test_quarter_circle(self, read):
        p = read(f"G0 X0 Y0\nF600\n{g52([[0, 0], [10, 0], [10, 10]], [1.0, HALF, 1.0], 3)}" + END)
        points = points_of(p, range(len(p)))
        assert np.hypot(points[:, 0], points[:, 1] - 10.0) == pytest.approx(10.0, abs=1e-13)
        assert p.lengths.sum() == pytest.approx(5.0 * np.pi, rel=1e-15)

    def test_relative_control_points_count_from_the_start(self, read):
        """As LinuxCNC has it: the point that they count from does not move before G5.3."""
        relative = read("G0 X5 Y5\nG91 F60\nG5.2 X0 Y4 P1 L3\nX4 Y4 P1\nX4 Y0 P2\nG5.3\nG90 G1 X0 Y0" + END)
        absolute = read("G0 X5 Y5\nF60\nG5.2 X5 Y9 P1 L3\nX9 Y9 P1\nX9 Y5 P2\nG5.3\nG1 X0 Y0" + END)
        assert relative.end.tolist() == absolute.end.tolist()

    def test_of_g62_begins_where_the_machine_stands(self, read):
        a = read("G0 X1 Y1\nF60\nG6.2 P3 K0\nK0 X5 Y1\nK0 X5 Y5\nK1\nK1\nK1\nG1 X0" + END)
        b = read("G0 X1 Y1\nF60\nG6.2 P3 K0 X1 Y1\nK0 X5 Y1\nK0 X5 Y5\nK1\nK1\nK1\nG1 X0" + END)
        assert a.end.tolist() == b.end.tolist()
        assert a.kind.tolist() == [RAPID, SPLINE, LINE] or a.kind.tolist() == [SPLINE, LINE]

    def test_several_follow_one_another(self, read):
        p = read("F60\nG5.2 X0 Y4 P1 L3\nX4 Y4 P1\nG5.3\nG5.2 X8 Y4 P1 L3\nX8 Y8 P1\nG5.3" + END)
        assert p.end[-1, :2].tolist() == [8, 8]
        assert (p.start[1:] == p.end[:-1]).all()


REFUSED = {
    "G5 X1 Y1 P0 Q-3 F60": "1: G5: needs I J: the move before it is no G5 with whose P Q it could go on",
    "G5 X1 Y1 I0 J3 P0 Q-3 F60\nG1 X2\nG5 X1 Y1 P0 Q-3": (
        "3: G5: needs I J: the move before it is no G5 with whose P Q it could go on"
    ),
    "G5 X1 Y1 I1 P0 Q-3 F60": "1: I1: needs I and J, or with G5 neither",
    "G5 X1 Y1 I1 J1 P0 F60": "1: G5: needs the handle P Q at its end",
    "G5 X1 Y1 I1 J1 F60": "1: G5: needs the handle P Q at its end",
    "G5 I1 J1 P1 Q1 F60": "1: G5: a spline needs its end X Y",
    "G5.1 X1 Y1 F60": "1: G5.1: needs the handle I J",
    "G5.1 X1 Y1 I1 J1": "1: G5.1: no feed is given; F is missing",
    "G5 X1 Y1 Z1 I0 J3 P0 Q-3 F60": "1: Z1: a spline moves X and Y; move Z in a block of its own",
    "G18 G5 X1 Y1 I0 J3 P0 Q-3 F60": "1: G5: a spline lies in the plane XY, G17",
    "G19 F60\nG5.2 X1 Y1 P1\nX2 Y2 P1\nG5.3": "2: G5.2: a spline lies in the plane XY, G17",
    "G5 X9 Y1 I1 J1 R5 P-1 Q1 F60": (
        "1: R5: belongs to a word that is not in the block; it is read beside G10, M19, G2, G3, G76, G6.2, G81, G85 ..."
    ),
    "G5 X0 Y0 I0 J0 P0 Q0 F60": "1: G5: the spline has no length: its control points are one point",
    "G5 X10 Y0 I0 J0 P0 Q5 F60": (
        "1: G5: has a cusp near X0 Y0 (mm): its curvature is infinite and no feed passes it; give every handle a length, "
        "or split the spline there"
    ),
    "G5 X10 Y0 I10 J10 P-10 Q10 F60": (
        "1: G5: has a cusp near X5 Y7.5 (mm): its curvature is infinite and no feed passes it; give every handle a length, "
        "or split the spline there"
    ),
    "G5 X10 Y0 I20 J0 P-20 Q0 F60": "cusp",
    "F60\nG5.3": "2: G5.3: ends a spline that no G5.2 begins",
    "F60\nG5.2 X0 Y1 P1 L3\nG5.3": "3: G5.3: a spline of order 3 needs 3 control points; it has 2",
    "F60\nG5.2 X0 Y1 P1 L5\nX2 Y2 P1\nX3 Y0 P1\nG5.3": "5: G5.3: a spline of order 5 needs 5 control points; it has 4",
    "F60\nG5.2 X0 Y1 P1 L2\nX2 Y2 P1\nG5.3": "2: L2: the order of a spline is a whole number from 3 to 10",
    "F60\nG5.2 X0 Y1 P1 L11\nX2 Y2 P1\nG5.3": "2: L11: the order of a spline is a whole number from 3 to 10",
    "F60\nG5.2 X0 Y1 P1 L3\nX2 Y2 P-1\nG5.3": "3: P-1: a control point needs its weight P > 0",
    "F60\nG5.2 X0 Y1 P0 L3\nX2 Y2 P1\nG5.3": "2: P0: a control point needs its weight P > 0",
    "F60\nG5.2 P-2 L3\nX2 Y2 P1\nG5.3": "2: P-2: a weight must be > 0",
    "F60\nG5.2 X0 Y1 P1 L3\nX2 Y2\nG5.3": "3: X2: a control point needs its weight P > 0",
    "F60\nG5.2 X0 Y1 P1 L3\nX2 P1\nG5.3": "3: X2: a control point needs X and Y",
    "F60\nG5.2 X0 Y1 P1 L3\nX2 Y2 P1\nG1 X5": (
        "4: G1: stands within the spline that begins in line 2; end it with G5.3"
    ),
    "F60\nG5.2 X0 Y1 P1 L3\nM3 S5\nX2 Y2 P1\nG5.3": (
        "3: M3: stands within the spline that begins in line 2; end it with G5.3"
    ),
    "F60\nG5.2 X0 Y1 P1 L3\nX2 Y2 P1": "4: M2: stands within the spline that begins in line 2; end it with G5.3",
    "F60\nG5.2 X0 Y1 P1 L3\nX2 Y2 P1\nG5.3 X4 Y4": "4: X4: the block of G5.3 has no control point; write it before",
    "F60\nG5.2 X0 Y1 P1 L3\nX2 Y2 P1\nG5.3\nX5": "5: X5: no G0, G1, G2, G3 or cycle is active",
    "F60\nG5.2 X1 Y1 P1 Z3\nX2 Y2 P1\nG5.3": "2: Z3: a spline moves X and Y; move Z in a block of its own",
    "G93\nG5.2 X1 Y1 P1 F2\nX2 Y2 P1 F2\nG5.3 F2": "2: G5.2: a NURBS needs a feed in units a minute, G94",
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0\nK0 X1 Y1\nK1\nK1\nG1 X5": (
        "7: G1: the spline that begins in line 2 has 5 knots; 3 control points of order 3 need 6, the last 3 in blocks with "
        "K alone"
    ),
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0\nK0 X1 Y1\nK1\nK1\nK1\nK1": (
        "8: K1: the spline before it is complete; begin another with its G word"
    ),
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0\nK0 X1 Y1\nK1\nK0.5\nK1": (
        "6: K0.5: the knot is less than the one before; knots must not decrease"
    ),
    "F60\nG6.2 P3 K0 X0 Y0\nK0.1 X1 Y0\nK0.2 X1 Y1\nK1\nK1\nK1": (
        "7: K1: the first 3 knots must be equal, and the last 3: the spline begins and ends in control points"
    ),
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0\nK0 X1 Y1\nK0\nK0\nK0": (
        "7: K0: all knots are equal; the first 3 and the last 3 must differ"
    ),
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0\nK0 X1 Y1\nK1 X2 Y5\nK1 X3 Y1\nK1 X7 Y5\nK2\nK2\nK2": (
        "10: K2: the knot 1 appears 3 times; inside a spline of order 3 it may 2 times"
    ),
    "F60\nG6.2 P3 K0 X0 Y0 R0\nK0 X1 Y0\nK0 X1 Y1\nK1\nK1\nK1": "2: R0: a weight must be > 0",
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0 R-2\nK0 X1 Y1\nK1\nK1\nK1": "3: R-2: a weight must be > 0",
    "F60\nG6.2 P3 K0 X0 Y0\nX1 Y0\nK0 X1 Y1\nK1\nK1\nK1": "3: X1: a block of G6.2 needs its knot K",
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0\nK0 R2\nK1\nK1\nK1": "4: R2: a weight belongs to a control point; X, Y or Z is missing",
    "F60\nG6.2 P3 K0 X9 Y0\nK0 X1 Y0\nK0 X1 Y1\nK1\nK1\nK1": (
        "2: X9: the first control point lies 9 mm from where the machine stands; a spline begins there"
    ),
    "F60\nG6.2 P11 K0 X0 Y0": "2: P11: the order of a spline is a whole number from 2 to 10",
    "F60\nG6.2 P3 K0 X0 Y0\nP4 K0 X1 Y0": "3: P4: the order P belongs to the first block of a spline",
    "F60\nG6.2 P3 K0 X0 Y0\nK0 X1 Y0\nK0\nK1 X1 Y1": (
        "5: X1: a control point after a block with K alone; these come last"
    ),
    "F60\nG6.2 P4 K0 X0 Y0\nK0 X1 Y0\nK0\nK0\nK1\nK1": "7: K1: a spline of order 4 needs 4 control points; it has 2",
    "G91 F60\nG6.2 P3 K0 X0 Y0": "2: G6.2: control points of G6.2 are absolute; write G90",
    "F60\nG1 X1 K1": "2: K1: belongs to G2 or G3, which is not active",
}


@pytest.mark.parametrize("text", REFUSED)
def test_refused(refusal, text):
    message = refusal(text + END)
    assert message == REFUSED[text] or (REFUSED[text] == "cusp" and "has a cusp" in message)


def test_many_parts_of_a_file_are_one(tmp_path, monkeypatch):
    """Handles, open splines and curves go on from one part of the file to the next."""
    rng = np.random.default_rng(5)
    lines, at = ["F600"], 0.0
    for k in range(60):
        x, y = at + rng.uniform(2.0, 6.0), rng.uniform(-3.0, 3.0)
        if k % 3:
            lines.append(f"G5 X{x:.4f} Y{y:.4f} {'I1 J2 ' if k % 3 == 1 else ''}P-1 Q{rng.uniform(1, 3):.4f}")
        else:
            lines += [f"G5.2 X{at + 1:.4f} Y9 P1 L3", f"X{x:.4f} Y{y:.4f} P2", "G5.3"]
        at = x
    (tmp_path / "part.ngc").write_text("\n".join(lines) + END)
    whole = read_program(tmp_path / "part.ngc")
    monkeypatch.setattr("planner.programs.reading.words._CHUNK_BYTES", 64)
    parts = read_program(tmp_path / "part.ngc")
    for name in ("line", "kind", "start", "end", "curve", "feed", "zero_lines"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_array_equal(parts.beziers.start, whole.beziers.start)
    np.testing.assert_array_equal(parts.beziers.powers, whole.beziers.powers)


@pytest.mark.skipif(not is_installed(), reason="LinuxCNC is not installed (Debian: apt-get install linuxcnc-uspace)")
@pytest.mark.parametrize("seed", range(4))
def test_chords_of_linuxcnc_lie_on_the_curve_and_end_where_it_does(tmp_path, seed):
    rng = np.random.default_rng(seed)
    lines, ends, at = ["G21 G90 G17", "G0 X0 Y0", "F600"], [], np.zeros(2)
    for k in range(6):
        target = at + rng.uniform(3.0, 12.0, 2)
        if k % 3 == 0:
            lines.append(
                f"G5 {numbers(target)} I{rng.uniform(1, 4):.6f} J{rng.uniform(-4, 4):.6f} P-2 Q{rng.uniform(1, 4):.6f}"
            )
        elif k % 3 == 1:
            lines.append(f"G5.1 {numbers(target)} I{rng.uniform(1, 4):.6f} J{rng.uniform(-4, 4):.6f}")
        else:
            control = np.concatenate([[at], at + np.cumsum(rng.uniform(1.0, 4.0, (4, 2)), axis=0)])
            target = control[-1]
            lines.append(g52(control, [1.0, *rng.uniform(0.5, 2.0, 4).tolist()], int(rng.integers(3, 6))))
        ends.append(target)
        at = target
    path = tmp_path / "part.ngc"
    path.write_text("\n".join(lines) + END)
    ours = read_program(path)
    calls = canonical_calls(path).rows
    theirs = calls[calls[:, 0] == canon.LINE, 3:5]
    assert len(theirs) > 60 * 4
    dense = points_of(ours, np.flatnonzero(ours.kind == SPLINE), 2000)[:, :2]
    assert from_points_to_chords(theirs, dense) < 1e-5
    for end in ends:
        assert np.hypot(*(theirs - end).T).min() < 1e-6
        assert np.hypot(*(ours.end[:, :2] - end).T).min() < 1e-9
