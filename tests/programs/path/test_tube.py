"""The tube: its spline, its ends, its optimum, its knots."""

import numpy as np
import path_reference as reference
import pytest
from scipy.interpolate import BSpline
from scipy.optimize import minimize
from tube_reference import DenseRows, interior_point

from planner.compiled import core
from planner.programs.path.deviation import foot_distance
from planner.programs.path.stretch import reachable
from planner.programs.path.tube import DEGREE, Spline, Tube, basis_powers, full_knots, greville, samples_of, smoothest
from planner.programs.path.tube_knots import onto, place, spacing_at
from planner.programs.reading.noise import noise_amplitude


def random_knots(seed, count):
    return np.cumsum(np.random.default_rng(seed).uniform(0.2, 1.5, count))


def test_basis_agrees_with_scipy():
    knots = random_knots(0, 9)
    basis = basis_powers(knots)
    for j in range(knots.size + 3):
        unit = np.eye(knots.size + 3)[j]
        spline = BSpline(full_knots(knots), unit, DEGREE)
        for i in range(knots.size - 1):
            w = np.linspace(0.0, 0.99, 5)
            expected = spline(knots[i] + w * (knots[i + 1] - knots[i]))
            found = np.polyval(basis[i, j - i][::-1], w) if 0 <= j - i <= DEGREE else 0.0 * w
            assert np.abs(found - expected).max() < 1e-13


def kinked(tolerance, *, dim=2, ends=1):
    """A tube around two lines that meet at 17 degrees."""
    knots = np.linspace(0.0, 10.0, 13)
    turn = 0.3
    directions = np.zeros((2, dim))
    directions[0, 0] = 1.0
    directions[1, :2] = np.cos(turn), np.sin(turn)

    def at(s):
        before = np.minimum(s, 5.0)[:, None] * directions[0]
        return before + np.maximum(s - 5.0, 0.0)[:, None] * directions[1]

    s = samples_of(knots, np.array([5.0]))
    tangent = np.where((s < 5.0)[:, None], directions[0], directions[1])
    tangent[s == 5.0] = directions.sum(axis=0) / np.sqrt(np.sum(directions.sum(axis=0) ** 2))
    rows = np.full(s.size, tolerance)
    start = np.stack([at(np.zeros(1))[0], directions[0], 0 * directions[0], 0 * directions[0]])[:ends]
    end = np.stack([at(np.full(1, 10.0))[0], directions[1], 0 * directions[0], 0 * directions[0]])[:ends]
    return Tube(knots, s, at(s), tangent, rows, start, end, at(greville(knots)), np.ones(12))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("ends", [1, 3, 4])
def test_spline_meets_its_ends_and_keeps_its_rows(dim, ends):
    tube = kinked(0.05, dim=dim, ends=ends)
    spline = smoothest(tube)
    for place_, data in ((0.0, tube.start), (10.0, tube.end)):
        found = spline.derivatives(np.array([place_]))[:ends, 0]
        assert np.abs(found - data).max() < 1e-10
    away = spline.derivatives(tube.abscissa)[0] - tube.point
    along = np.sum(away * tube.tangent, axis=1)
    across = np.sqrt(np.maximum(np.sum(away**2, axis=1) - along**2, 0.0))
    assert across.max() <= 0.05 * (1 + 1e-6)
    assert across.max() > 0.9 * 0.05 * (1.0 if dim == 2 else np.cos(np.pi / 8))
    assert np.abs(along).max() <= 0.1 * (1 + 1e-6)


def test_optimum_agrees_with_another_solver():
    """The same quadratic programme by SLSQP."""
    tube = kinked(0.05)
    knots = full_knots(tube.knots)
    spline = smoothest(tube)
    count = tube.initial.shape[0]
    design = BSpline.design_matrix(np.minimum(tube.abscissa, 10.0 - 1e-12), knots, DEGREE).toarray()
    gauss = (tube.knots[:-1, None] + np.diff(tube.knots)[:, None] * (0.5 + np.array([-1, 1]) / np.sqrt(12))).reshape(-1)
    third = np.column_stack([BSpline(knots, unit, DEGREE)(gauss, 3) for unit in np.eye(count)])
    half = 0.5 * np.repeat(np.diff(tube.knots), 2)
    quadratic = third.T @ (half[:, None] * third)

    def cost(c):
        c = c.reshape(count, 2)
        return 0.5 * float(np.sum(c * (quadratic @ c))), (quadratic @ c).reshape(-1)

    normal = np.column_stack([-tube.tangent[:, 1], tube.tangent[:, 0]])
    rows = []
    for direction, bound in ((normal, 0.05), (tube.tangent, 0.1)):
        a = (design[:, :, None] * direction[:, None, :]).reshape(len(design), -1)
        b = np.sum(direction * tube.point, axis=1)
        rows += [(-a, bound + b), (a, bound - b)]
    matrix, offset = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
    fixed = np.zeros((4, 2 * count))
    fixed[[0, 1, 2, 3], [0, 1, 2 * count - 2, 2 * count - 1]] = 1.0
    ends = np.concatenate([tube.start[0], tube.end[0]])
    reference = minimize(
        cost,
        tube.initial.reshape(-1),
        jac=True,
        method="SLSQP",
        constraints=[
            {"type": "ineq", "fun": lambda c: offset + matrix @ c, "jac": lambda c: matrix},
            {"type": "eq", "fun": lambda c: fixed @ c - ends, "jac": lambda c: fixed},
        ],
        options={"maxiter": 500, "ftol": 1e-14},
    )
    assert cost(spline.control.reshape(-1))[0] == pytest.approx(reference.fun, rel=1e-3)


def test_an_infeasible_tube_ends_with_an_excess():
    """Ends that point across a narrow tube cannot be kept within it; the excess is seen, and the solve ends."""
    tube = kinked(1e-4, ends=3)
    start = tube.start.copy()
    start[1] = [0.0, 1.0]
    bent = Tube(tube.knots, tube.abscissa, tube.point, tube.tangent, tube.half_width, start, tube.end,
                tube.initial.copy(), tube.weight)  # fmt: skip
    spline = smoothest(bent)
    away = np.sqrt(np.sum((spline.derivatives(tube.abscissa)[0] - tube.point) ** 2, axis=1))
    assert np.isfinite(away).all()
    assert away.max() > 1e-3


class TestKnots:
    def test_equidistant_where_nothing_bends(self):
        knots = place(0.0, 30.0, np.empty(0), np.empty(0), np.empty(0))
        assert np.diff(knots).max() == pytest.approx(3.0)
        assert np.ptp(np.diff(knots)) < 1e-9

    def test_the_other_direction_of_travel_has_the_same_knots(self):
        at, spacing = np.array([4.0, 11.0, 11.3]), np.array([0.05, 0.3, 0.02])
        forth = place(0.0, 20.0, at, spacing, at[:1])
        back = 20.0 - place(0.0, 20.0, 20.0 - at[::-1], spacing[::-1], 20.0 - at[:1])[::-1]
        assert forth.size == back.size
        assert np.abs(forth - back).max() < 1e-9

    def test_spacing_and_growth(self):
        at, spacing = np.array([10.0]), np.array([0.02])
        knots = place(0.0, 20.0, at, spacing, at)
        assert 10.0 in knots
        width = np.diff(knots)
        nearest = np.abs(0.5 * (knots[1:] + knots[:-1]) - 10.0)
        assert (width <= 0.02 + 0.5 * (nearest + width) + 1e-12).all()
        assert np.abs(np.diff(width)).max() <= 0.6 * width.max()

    def test_rules(self):
        found = spacing_at(
            np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.2, 0.0]), np.zeros(3), np.zeros(3), np.full(3, 0.01)
        )
        assert found == pytest.approx([0.15, np.sqrt(0.3), 3.0])
        assert spacing_at(np.array([0.1]), np.zeros(1), np.array([4.0]), np.zeros(1), np.array([1.0]))[
            0
        ] == pytest.approx(0.1)


def test_reachable_speed_from_rest():
    s = np.linspace(0.0, 10.0, 1001)
    ceiling = np.full(s.size, 100.0)
    ceiling[0] = 0.0
    found = reachable(s, ceiling, np.full(s.size, 1000.0), np.full(s.size, 2e4))
    assert found[0] == 0.0
    assert (np.diff(found) >= -1e-9).all()
    assert (found**2 <= 2.0 * 700.0 * s + 1e-6).all()
    back = reachable(s, ceiling[::-1], np.full(s.size, 1000.0), np.full(s.size, 2e4))
    assert np.abs(back[::-1] - found).max() < 1e-9


@pytest.mark.parametrize("amplitude", [5e-5, 1e-3])
def test_noise_of_a_rounded_circle_is_estimated(amplitude):
    rng = np.random.default_rng(3)
    angle = np.cumsum(rng.uniform(0.004, 0.008, 2000))
    points = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    noisy = points + rng.uniform(-amplitude, amplitude, points.shape)
    everywhere = np.ones(2000, dtype=bool)
    assert noise_amplitude(noisy, everywhere) == pytest.approx(amplitude, rel=0.25)
    assert noise_amplitude(points, everywhere) < 1e-7
    assert noise_amplitude(points[:10], everywhere[:10]) == 0.0


def test_knots_beside_marks_move_onto_them():
    knots = np.array([0.0, 1.0, 2.0, 2.5, 4.0, 5.0])
    marks = np.array([0.01, 0.95, 1.5, 2.04, 2.06, 2.499, 4.2, 4.999])
    assert onto(knots, marks).tolist() == [0.0, 0.95, 2.04, 2.499, 4.0, 5.0]
    for seed in range(200):
        rng = np.random.default_rng(seed)
        knots = random_knots(seed, 12)
        marks = np.sort(rng.uniform(knots[0], knots[-1], int(rng.integers(0, 30))))
        moved = onto(knots, marks)
        assert (np.diff(moved) >= 0.8 * np.diff(knots)).all()
        assert moved[[0, -1]].tolist() == knots[[0, -1]].tolist()
        assert np.isin(moved, np.concatenate([knots, marks])).all()


class TestCompiled:
    """The bits are those of plain Python, and the numbers those of dense matrices."""

    @pytest.mark.parametrize(
        ("count", "dim", "controls"), [(1, 2, 5), (40, 2, 23), (40, 3, 11), (7, 1, 300), (300, 3, 700)]
    )
    def test_banded_algebra(self, count, dim, controls):
        rng = np.random.default_rng([count, dim])
        width, n = 5 * dim, controls * dim
        first = np.sort(rng.integers(0, controls - 4, count)).astype(np.int64)
        rows = rng.normal(size=(count, width)) * (rng.random((count, width)) < 0.8)
        weight, x, y = rng.random(count), rng.normal(size=n), rng.normal(size=count)
        dense = np.zeros((count, n))
        for k in range(count):
            dense[k, first[k] * dim : first[k] * dim + width] = rows[k]
        band, expected = np.full((width, n), 0.5), np.full((width, n), 0.5)
        core.tube_add_rows(count, width, dim, first, rows, weight, n, band)
        reference.add_rows(first, rows, weight, dim, expected)
        assert band.tobytes() == expected.tobytes()
        whole = 0.5 * (np.abs(np.subtract.outer(np.arange(n), np.arange(n))) < width) + (dense.T * weight) @ dense
        for compiled, plain, arguments, exact in (
            (core.tube_apply_rows, reference.apply_rows, x, dense @ x),
            (core.tube_add_transposed, reference.add_transposed, y, 0.25 + dense.T @ y),
        ):
            found, expected = np.full(exact.size, 0.25), np.full(exact.size, 0.25)
            compiled(count, width, dim, first, rows, arguments, found)
            plain(first, rows, arguments, dim, expected)
            assert found.tobytes() == expected.tobytes()
            np.testing.assert_allclose(found, exact, atol=1e-12)
        core.tube_apply_band(width, n, band, x, found := np.empty(n))
        reference.apply_band(band, x, expected := np.empty(n))
        assert found.tobytes() == expected.tobytes()
        np.testing.assert_allclose(found, whole @ x, atol=1e-9)

    @pytest.mark.parametrize("dim", [2, 3])
    @pytest.mark.parametrize("seed", range(6))
    def test_the_interior_point_method_is_that_of_dense_rows(self, dim: int, seed: int) -> None:
        """Rows that bind, rows that none can keep, frozen numbers: the same iterations, and the same point."""
        rng = np.random.default_rng([dim, seed])
        controls, count, width = 40, 150, 5 * dim
        n = controls * dim
        first = np.sort(rng.integers(0, controls - 4, count)).astype(np.int64)
        rows = rng.normal(size=(count, width))
        offset = rng.normal(scale=3.0, size=count)
        offset[::50] += 40.0 * (seed % 2)
        band = np.zeros((width, n))
        core.tube_add_rows(count, width, dim, first, rng.normal(size=(count, width)), rng.random(count), n, band)
        band[0] += 0.1
        frozen = np.concatenate([np.arange(dim * (seed % 4)), np.arange(n - dim, n)]).astype(np.int64)
        x = rng.normal(size=n)
        expected = x.copy()
        iterations = interior_point(DenseRows(first, rows, offset, dim, n), band, expected, frozen)
        work = np.full(core.tube_solve_work(count, width, n), np.nan)
        found = core.tube_solve(
            *(count, width, dim, first, rows, offset, n, band, frozen.size, frozen, solved := x.copy(), work)
        )
        assert found == iterations
        assert 5 < found < 60
        np.testing.assert_allclose(solved, expected, rtol=1e-6, atol=1e-7)
        assert (solved[frozen] == x[frozen]).all()
        assert np.abs(DenseRows(first, rows, offset, dim, n).values(solved)).max() > 0.9

    def test_a_system_that_is_not_positive_ends_the_iteration(self) -> None:
        count, width, n = 3, 10, 20
        first, rows, offset = np.arange(count), np.zeros((count, width)), np.zeros(count)
        band, x = np.zeros((width, n)), np.ones(n)
        band[0] = -1.0
        work = np.empty(core.tube_solve_work(count, width, n))
        none = np.empty(0, dtype=np.int64)
        assert core.tube_solve(count, width, 2, first, rows, offset, n, band, 0, none, x, work) == 1
        assert (x == 1.0).all()

    @pytest.mark.parametrize("dim", [2, 3])
    def test_places_and_distances_are_those_of_the_search_in_numpy(self, dim: int) -> None:
        """Points near and far, on knots, at the ends of what they may reach: rounding apart the same feet."""
        rng = np.random.default_rng(dim)
        knots = random_knots(dim, 30)
        control = np.column_stack([greville(knots), *rng.normal(scale=0.5, size=(dim - 1, knots.size + 3))])
        powers = np.einsum(
            "nip,nid->ndp", basis_powers(knots), control[np.arange(knots.size - 1)[:, None] + np.arange(5)]
        )
        spline = Spline(knots, np.ascontiguousarray(powers), control, 0)
        s = np.concatenate([rng.uniform(knots[0], knots[-1], 400), knots])
        np.testing.assert_allclose(spline.places(s), spline.derivatives(s)[0], atol=1e-12)
        points = spline.derivatives(s)[0] + rng.normal(scale=0.02, size=(s.size, dim))
        near = np.clip(s + rng.uniform(-0.1, 0.1, s.size), knots[0], knots[-1])
        lo, hi = np.maximum(near - 0.3, knots[0]), np.minimum(near + 0.3, knots[-1])
        found = spline.distances(points, near, lo, hi)
        expected = foot_distance(lambda at: spline.derivatives(at)[:3], points, near, lo, hi)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-13)
        dense = spline.derivatives((lo[:, None] + (hi - lo)[:, None] * np.linspace(0.0, 1.0, 200)).reshape(-1))[0]
        least = np.sqrt(((dense.reshape(s.size, 200, dim) - points[:, None]) ** 2).sum(axis=2)).min(axis=1)
        assert np.median(np.abs(found - least)) < 1e-3
        assert (found > least - 1e-2).all()

    def test_axes_at_rest_are_put_beside_those_that_move(self) -> None:
        rng = np.random.default_rng(0)
        spline = Spline(random_knots(0, 5), rng.normal(size=(4, 2, 5)), np.empty(0), 0)
        whole = spline.in_axes(np.array([True, False, True]), np.array([0.0, 7.0, 0.0]))
        places = whole.places(spline.knots)
        assert (places[:, 1] == 7.0).all()
        assert (places[:, [0, 2]] == spline.places(spline.knots)).all()
