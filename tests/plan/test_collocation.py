"""Points of an interval, weights of the time, and the cubic between knots, against polynomials that they are exact for."""

import numpy as np
import pytest

from planner.plan.collocation import inner_shares, mean_of, points_of, states_between, time_weights

KNOTS = np.array([0.0, 0.3, 0.3, 1.1, 1.15, 4.0])  # a double knot among them
H = np.diff(KNOTS)


@pytest.mark.parametrize("inner", [1, 3])
def test_points_keep_the_knots_and_divide_every_interval_evenly(inner):
    points = points_of(KNOTS, inner)
    assert points.size == (inner + 1) * H.size + 1
    assert (points[:: inner + 1] == KNOTS).all()
    assert np.diff(points).reshape(-1, inner + 1) == pytest.approx(np.repeat(H / (inner + 1), inner + 1).reshape(5, -1))
    assert inner_shares(inner) == pytest.approx(np.linspace(0.0, 1.0, inner + 2)[1:-1])


@pytest.mark.parametrize(("inner", "degree"), [(1, 3), (3, 5)])
def test_weights_integrate_what_their_rule_is_exact_for(inner, degree):
    points, weights = points_of(KNOTS, inner), time_weights(H, inner)
    for k in range(degree + 1):
        assert weights @ points**k == pytest.approx(4.0 ** (k + 1) / (k + 1), rel=1e-14)
    assert weights @ points ** (degree + 1) != pytest.approx(4.0 ** (degree + 2) / (degree + 2), rel=1e-9)


@pytest.mark.parametrize(("inner", "degree"), [(1, 3), (3, 5)])
def test_mean_of_an_interval(inner, degree):
    power = np.arange(degree + 1)
    with np.errstate(invalid="ignore"):
        exact = np.diff(KNOTS[:, None] ** (power + 1) / (power + 1), axis=0) / H[:, None]
    full = H > 0.0
    found = np.stack([mean_of(points_of(KNOTS, inner) ** k, inner) for k in power], axis=1)
    assert found[full] == pytest.approx(exact[full], rel=1e-12)


@pytest.mark.parametrize("inner", [1, 3])
def test_states_are_those_of_a_cubic(inner):
    cubic = np.polynomial.Polynomial([2.0, -1.0, 0.7, 0.3])
    slope, bend = 0.5 * cubic.deriv(), 0.5 * cubic.deriv(2)
    z = states_between(H, np.stack([f(KNOTS) for f in (cubic, slope, bend)]), inner)
    points = points_of(KNOTS, inner)
    for row, f in zip(z, (cubic, slope, bend), strict=True):
        assert row == pytest.approx(f(points), rel=1e-13, abs=1e-13)
