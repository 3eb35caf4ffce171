"""Corners: the closed form of the cubic blend, its arc length, and which junction becomes what."""

import mpmath
import numpy as np
import pytest
from cases import drives
from hypothesis import given
from hypothesis import strategies as st
from program_blocks import arc, line, program

from planner import plan_feedrate
from planner.geometry.blend import Blends, Legs
from planner.geometry.chain import ChainCurve, Kind
from planner.programs.path.corners import Junction, classify
from planner.programs.path.deviation import Programmed
from planner.programs.path.smooth_path import program_path


def lines(*points):
    """The programmed path through points."""
    p = np.array(points, dtype=float)
    step = np.diff(p, axis=0)
    length = np.sqrt(np.sum(step**2, axis=1))
    vectors = np.zeros((length.size, 4, p.shape[1]))
    vectors[:, 0], vectors[:, 3] = p[:-1], step / length[:, None]
    return Programmed(np.concatenate([[0.0], np.cumsum(length)]), Legs(vectors, np.zeros((length.size, 2))))


def chain_of(blend):
    """A chain of one blend."""
    nothing, no_legs = np.empty(0), Legs(np.empty((0, 4, 2)), np.empty((0, 2)))
    of_pieces = np.array([Kind.BLEND], dtype=np.int8), np.zeros(1, dtype=np.intp), np.zeros(1)
    return ChainCurve(
        np.array([0.0, blend.length[0]]), *of_pieces, no_legs, blend, np.empty((0, 2, 5)), nothing, nothing, nothing
    )


def corner(angle, size):
    """One blend at the origin between lines that turn by the angle."""
    vectors = np.zeros((1, 4, 2))
    before, after = vectors.copy(), vectors.copy()
    before[0, 3] = [-1.0, 0.0]
    after[0, 3] = [np.cos(angle), np.sin(angle)]
    rates = np.zeros((1, 2))
    return Blends.between(Legs(before, rates), Legs(after, rates), np.array([size]))


ANGLES = np.deg2rad([20.5, 45.0, 90.0, 120.0, 150.0])


@pytest.mark.parametrize("angle", ANGLES)
def test_blend_is_the_cubic_of_the_closed_form(angle):
    size, tau = 0.3, np.linspace(-1.0, 1.0, 21)
    t1, t2 = np.array([1.0, 0.0]), np.array([np.cos(angle), np.sin(angle)])
    expected = -size * (1 - tau[:, None]) ** 3 * t1 + size * (1 + tau[:, None]) ** 3 * t2
    found = corner(angle, size).at(np.zeros(21, dtype=np.intp), tau)
    assert np.abs(found[0] - expected).max() < 1e-14
    assert np.abs(found[3] - 6.0 * size * (t1 + t2)).max() < 1e-13


@pytest.mark.parametrize("angle", ANGLES)
def test_arc_length_of_a_blend_agrees_with_quadrature_in_30_digits(angle):
    blend = corner(angle, 0.02)
    s = blend.length[0] * np.array([0.0, 0.1, 0.37, 0.5, 0.9, 1.0])
    tau = blend.tau(np.zeros(s.size, dtype=np.intp), s)
    with mpmath.workdps(30):
        cosine = mpmath.cos(mpmath.mpf(float(angle)))

        def speed(x):
            a, b = (1 - x) ** 2, (1 + x) ** 2
            return 3 * mpmath.mpf("0.02") * mpmath.sqrt(a**2 + b**2 + 2 * a * b * cosine)

        exact = [float(mpmath.quad(speed, mpmath.linspace(-1, mpmath.mpf(float(x)), 12))) for x in tau]
    assert np.abs(np.array(exact) - s).max() < 2e-14 * blend.length[0] + 1e-17


@given(st.floats(0.36, 2.61), st.floats(1e-5, 1.0))
def test_blend_runs_at_unit_speed_and_joins_lines_with_their_curvature(angle, size):
    blend = corner(angle, size)
    s = blend.length[0] * np.linspace(0.0, 1.0, 17)
    d = chain_of(blend).derivatives(s)
    assert np.abs(np.sum(d[1] ** 2, axis=1) - 1.0).max() < 1e-13
    assert np.abs(d[2, [0, -1]]).max() * size < 1e-12  # straight at both ends
    assert np.abs(d[0, 0] - [-8.0 * size, 0.0]).max() < 1e-13 * size
    along = np.diff(d[0], axis=0)
    assert (np.sqrt(np.sum(along**2, axis=1)) <= np.diff(s) * (1 + 1e-12)).all()


@given(st.floats(0.37, 2.61), st.floats(1e-4, 0.1))
def test_vertex_lies_at_the_tolerance_from_the_blend(angle, tolerance):
    direction = [np.cos(angle), np.sin(angle)]
    path = lines([-5.0, 0.0], [0.0, 0.0], 5.0 * np.array(direction))
    junctions = classify(path, np.full(2, tolerance), np.zeros(1, dtype=bool))
    assert junctions.kind[0] == Junction.CORNER
    middle = corner(angle, float(junctions.size[0])).at(np.zeros(1, dtype=np.intp), np.zeros(1))[0, 0]
    assert float(np.hypot(*middle)) == pytest.approx(tolerance, rel=1e-8)
    assert float(np.hypot(*middle)) <= tolerance


@pytest.mark.parametrize(
    ("turn", "length", "kind"),
    [
        (151.0, 10.0, Junction.STOP),
        (149.0, 10.0, Junction.CORNER),
        (90.0, 10.0, Junction.CORNER),
        (90.0, 0.01, Junction.CORNER),  # smaller, never a tube
        (21.1, 10.0, Junction.CORNER),
        (30.0, 0.01, Junction.TUBE),  # blocks far too short
        (20.9, 10.0, Junction.TUBE),
        (0.0, 10.0, Junction.SMOOTH),
    ],
)
def test_rules(turn, length, kind):
    a = np.deg2rad(turn)
    path = lines([-length, 0.0], [0.0, 0.0], length * np.array([np.cos(a), np.sin(a)]))
    junctions = classify(path, np.full(2, 0.01), np.zeros(1, dtype=bool))
    assert junctions.kind[0] == kind
    assert junctions.reach[0] <= length
    demanded = classify(path, np.full(2, 0.01), np.ones(1, dtype=bool))
    assert demanded.kind[0] == Junction.STOP


def test_neighbouring_corners_share_a_short_block():
    path = lines([0, 0], [10, 0], [10, 0.1], [0, 0.1])
    junctions = classify(path, np.full(3, 0.05), np.zeros(2, dtype=bool))
    assert (junctions.kind == Junction.CORNER).all()
    assert junctions.reach.sum() < 0.1


@pytest.mark.parametrize("tolerance", [1e-3, 1e-2, 5e-2])
def test_time_of_a_right_angle(tolerance):
    """20 + 20 mm, a = 1000, J = 2e4, F = 100 mm/s: two legs of 0.35 s, which overlap in the corner.

    There one axis still brakes under +J while the other starts under +J: X = J t^3 / 6 over the size A of the corner, so
    each leg gives 2 (6 A / J)^(1/3) of its time, A = tolerance / sqrt 2, to the other.
    """
    seconds = 0.7 - 2.0 * np.cbrt(6.0 * tolerance / np.sqrt(2.0) / 2e4)
    limits = drives()
    path = program_path(program(line(20, 0), line(20, 20)), tolerance, limits, path="separate")
    profile = plan_feedrate(path.curve, limits, intervals=2000)
    assert seconds * (1.0 - 1e-6) <= profile.duration <= seconds * (1.0 + 2e-4)


def test_corner_beside_an_arc_keeps_the_tolerance():
    limits = drives()
    path = program_path(program(line(20, 0), arc((20, 10), (15, 5), 1), line(20, 25)), 0.05, limits, path="separate")
    assert path.counts["corners"] == 2
    assert path.deviation.largest <= 0.05
    assert path.deviation.largest > 0.03
    assert all(b.geometric >= 2 for b in path.curve.breaks)
