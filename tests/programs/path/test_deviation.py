"""Two-sided deviation: brute force, closed forms and planted faults."""

import numpy as np
import path_reference as reference
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.geometry.blend import Legs
from planner.geometry.nurbs import NurbsCurve
from planner.programs.path.deviation import Programmed, deviation, foot_distance, refined_peaks


def straight(points):
    p = np.array(points, dtype=float)
    length = np.sqrt(np.sum(np.diff(p, axis=0) ** 2, axis=1))
    vectors = np.zeros((length.size, 4, p.shape[1]))
    vectors[:, 0], vectors[:, 3] = p[:-1], np.diff(p, axis=0) / length[:, None]
    return Programmed(np.concatenate([[0.0], np.cumsum(length)]), Legs(vectors, np.zeros((length.size, 2))))


def helix(radius, pitch, sweep):
    """A helix about the z axis; pitch in mm a radian."""
    length = abs(sweep) * np.hypot(radius, pitch)
    vectors = np.zeros((1, 4, 3))
    vectors[0, 1], vectors[0, 2] = [radius, 0.0, 0.0], [0.0, radius, 0.0]
    vectors[0, 3] = [0.0, 0.0, pitch * abs(sweep) / length]
    return Programmed(np.array([0.0, length]), Legs(vectors, np.array([[sweep / length, 0.0]])))


def test_distance_to_lines_agrees_with_brute_force():
    rng = np.random.default_rng(1)
    vertices = np.cumsum(rng.normal(size=(12, 2)), axis=0)
    path = straight(vertices)
    points = rng.normal(size=(200, 2)) * 2.0 + vertices[rng.integers(0, 12, 200)]
    found = path.distance(points, np.full(200, 0.5 * path.edges[-1]), np.full(200, path.edges[-1]))
    dense = path.at(np.linspace(0.0, path.edges[-1], 100_001))[0]
    brute = np.array([np.sqrt(np.sum((dense - p) ** 2, axis=1)).min() for p in points])
    assert (found <= brute + 1e-12).all()
    assert (brute - found).max() < 1e-4


@settings(max_examples=15)
@given(st.floats(0.5, 50.0), st.floats(-3.0, 3.0), st.floats(0.3, 6.2), st.integers(0, 1000))
def test_distance_to_a_helix_agrees_with_brute_force(radius, pitch, sweep, seed):
    path = helix(radius, pitch, sweep)
    rng = np.random.default_rng(seed)
    s = rng.uniform(0.0, path.edges[-1], 20)
    points = path.at(s)[0] + 0.1 * radius * rng.uniform(-1.0, 1.0, (20, 3))
    found = path.distance(points, s, np.full(20, path.edges[-1]))
    grid = np.linspace(0.0, path.edges[-1], 20_001)
    brute = np.array([np.sqrt(np.sum((path.at(grid)[0] - p) ** 2, axis=1)).min() for p in points])
    assert (np.abs(found - brute) < 1e-3 * radius).all()
    assert (found <= brute + 1e-9 * radius).all()


def test_distance_is_searched_within_the_window():
    """Two passes 1 mm apart: the far one is nearer to the point, and does not count."""
    path = straight([[0, 0], [100, 0], [100, 1], [0, 1]])
    point = np.array([[50.0, 0.9]])
    near = path.distance(point, np.array([50.0]), np.array([5.0]))
    everywhere = path.distance(point, np.array([50.0]), np.array([500.0]))
    assert near[0] == pytest.approx(0.9)
    assert everywhere[0] == pytest.approx(0.1)


@pytest.mark.parametrize("shift", [1e-5, 1e-3, 0.05])
def test_planted_bump_is_found_on_both_sides(shift):
    """A straight cubic spline with one control point moved leaves the line by 2/3 of the shift at its knot."""
    x = np.arange(0.0, 40.0)
    points = np.column_stack([x, np.zeros(x.size)])
    points[17, 1] = shift
    knots = np.concatenate([[0.0] * 3, np.arange(0.0, 38.0), [37.0] * 3])
    greville = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0
    points[:, 0] = greville
    curve = NurbsCurve(points, knots, 3)
    path = straight([[0, 0], [10, 0], [37, 0]])
    ends = np.array([0.0, 10.0, 37.0])
    found = deviation(curve, path, ends, ends, 2.0)
    assert found.from_path == pytest.approx(2.0 / 3.0 * shift, rel=1e-9, abs=0.0)
    assert found.from_program == pytest.approx(2.0 / 3.0 * shift, rel=1e-6)
    assert found.abscissa == pytest.approx(greville[17], abs=1e-3)
    beside = deviation(curve, path, ends, ends, 2.0, where=(np.array([25.0]), np.array([37.0])))
    assert beside.largest < 1e-12


def test_missed_excursion_of_the_program_is_found():
    """The path cuts a spike off: every point of the path is near the program, but not the other way round."""
    path = straight([[0, 0], [10, 0], [10.0, 1.0], [10.001, 0.0], [20, 0]])
    curve = NurbsCurve([[0.0, 0.0], [20.0, 0.0]], [0.0, 0.0, 22.0, 22.0], 1)
    found = deviation(curve, path, np.array([0.0, 22.0]), np.array([0.0, path.edges[-1]]), 3.0)
    assert found.from_path < 1e-9
    assert found.largest == found.from_program == pytest.approx(1.0, abs=1e-6)


def test_foot_on_a_circle():
    def circle(u):
        return np.stack([np.column_stack([np.cos(u + k * np.pi / 2), np.sin(u + k * np.pi / 2)]) for k in range(3)])

    angle = np.linspace(0.0, 3.0, 50)
    radius = np.linspace(0.3, 2.0, 50)
    points = radius[:, None] * circle(angle)[0]
    found = foot_distance(circle, points, angle + 0.3, angle - 1.0, angle + 1.0)
    assert np.abs(found - np.abs(radius - 1.0)).max() < 1e-9


def test_peak_between_samples_is_refined():
    x = np.linspace(0.0, 1.0, 11)
    where, height = refined_peaks(lambda y: 1.0 - (y - 0.537) ** 2, x, 1.0 - (x - 0.537) ** 2)
    assert height.max() == pytest.approx(1.0, abs=1e-6)
    assert where[np.argmax(height)] == pytest.approx(0.537, abs=1e-3)


def random_legs(rng, count, dim):
    """Lines, arcs and spirals, as vectors (count, 4, dim) and rates (count, 2), one after another along the edges."""
    vectors = np.zeros((count, 4, dim))
    vectors[:, 0] = np.cumsum(rng.normal(size=(count, dim)), axis=0)
    rates = np.zeros((count, 2))
    for i in range(count):
        directions = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
        if i % 3 == 0:
            vectors[i, 3] = directions[0]
            continue
        radius = rng.uniform(0.2, 5.0)
        vectors[i, 1:3] = radius * directions[:2]
        rates[i] = rng.choice([-1.0, 1.0]) / radius, (0.0 if i % 3 == 1 else rng.uniform(-0.1, 0.1))
        if dim == 3:
            vectors[i, 3] = rng.uniform(-0.3, 0.3) * directions[2]
    return np.concatenate([[0.0], np.cumsum(rng.uniform(0.0, 2.0, count))]), vectors, rates


def polyline_with_arcs(rng, count, dim):
    """Lines end to end that turn back and cross each other, as short as the points are near; a few arcs among them."""
    turns = np.cumsum(rng.normal(0.0, 0.4, (count, dim)), axis=0) + rng.normal(0.0, 0.01, (count, dim))
    steps = (
        0.12
        * turns
        / np.linalg.norm(turns, axis=1)[:, None]
        * rng.choice([1.0, 1e-4, 20.0], (count, 1), p=[0.8, 0.1, 0.1])
    )
    vectors, rates = np.zeros((count, 4, dim)), np.zeros((count, 2))
    vectors[:, 0] = np.cumsum(steps, axis=0) - steps
    length = np.linalg.norm(steps, axis=1)
    vectors[:, 3] = steps / length[:, None]
    for i in rng.integers(0, count, count // 50):  # an arc beside the path, of the same length
        tangent = vectors[i, 3].copy()
        normal = np.eye(dim)[np.argmin(np.abs(tangent))]
        normal -= (normal @ tangent) * tangent
        normal /= np.linalg.norm(normal)
        vectors[i] = vectors[i, 0] + 2.0 * normal, -2.0 * normal, 2.0 * tangent, 0.0 * tangent
        rates[i, 0] = 0.5
    return np.concatenate([[0.0], np.cumsum(length)]), vectors, rates


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_blocks_that_are_not_looked_at_are_not_the_nearest(seed, dim):
    rng = np.random.default_rng([9, seed, dim])
    edges, vectors, rates = polyline_with_arcs(rng, 300, dim)
    n = 150
    s = rng.uniform(0.0, edges[-1], n)
    block = np.searchsorted(edges, s, side="right") - 1
    points = vectors[block, 0] + rng.choice([0.0, 1e-9, 0.005, 0.3, 30.0], (n, 1)) * rng.normal(size=(n, dim))
    window = rng.choice([0.0, 1.0, 7.0, 1e3], n)
    found = Programmed(edges, Legs(vectors, rates)).distance(points, s, window)
    reference.distance_to_blocks(edges, vectors, rates, points, s, window, expected := np.empty(n))
    assert found.tobytes() == expected.tobytes()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_the_compiled_distance_has_the_bits_of_plain_python(seed, dim):
    rng = np.random.default_rng([seed, dim])
    edges, vectors, rates = random_legs(rng, int(rng.integers(1, 30)), dim)
    n = 40
    s = np.concatenate([rng.uniform(0.0, edges[-1], n - 2), edges[[0, -1]]])
    points = vectors[rng.integers(0, len(vectors), n), 0] + rng.normal(size=(n, dim))
    window = rng.choice([0.0, 0.1, 3.0, 100.0], n)
    found = Programmed(edges, Legs(vectors, rates)).distance(points, s, window)
    reference.distance_to_blocks(edges, vectors, rates, points, s, window, expected := np.empty(n))
    assert found.tobytes() == expected.tobytes()
