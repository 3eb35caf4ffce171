"""Gauss-Legendre rules: against numpy's, and exact for the polynomials that they have to be exact for."""

import mpmath
import numpy as np
import pytest

from planner.gauss import gauss_legendre


@pytest.mark.parametrize("count", [1, 2, 3, 6, 8, 17])
def test_it_is_numpys_rule(count):
    nodes, weights = gauss_legendre(count)
    expected = np.polynomial.legendre.leggauss(count)
    np.testing.assert_allclose(nodes, expected[0], rtol=0.0, atol=4e-16)
    np.testing.assert_allclose(weights, expected[1], rtol=2e-14)
    assert (np.diff(nodes) > 0.0).all()


@pytest.mark.parametrize("count", [1, 2, 3, 6, 8])
def test_it_is_exact_to_its_degree_and_no_further(count):
    nodes, weights = gauss_legendre(count)
    for degree in range(0, 2 * count, 2):
        assert weights @ nodes**degree == pytest.approx(2.0 / (degree + 1), rel=4e-16 * count + 4e-16)
    assert abs(weights @ nodes ** (2 * count) - 2.0 / (2 * count + 1)) > 1e-6


@pytest.mark.parametrize("count", [3, 6, 8])
def test_every_digit_of_the_small_rules(count):
    """The points are the roots in fifty digits, the weights 2 / ((1 - x^2) P_n'(x)^2)."""
    nodes, weights = gauss_legendre(count)
    with mpmath.workdps(50):
        roots = sorted(
            mpmath.polyroots(mpmath.taylor(lambda x: mpmath.legendre(count, x), 0, count), maxsteps=200, asc=True)
        )
        slopes = [mpmath.diff(lambda x: mpmath.legendre(count, x), root) for root in roots]
        exact = [2 / ((1 - x**2) * slope**2) for x, slope in zip(roots, slopes, strict=True)]
    np.testing.assert_allclose(nodes, [float(x) for x in roots], rtol=0.0, atol=2.3e-16)
    np.testing.assert_allclose(weights, [float(w) for w in exact], rtol=4e-15)


def test_nobody_changes_a_rule_for_the_others():
    nodes, _ = gauss_legendre(4)
    with pytest.raises(ValueError, match="read-only"):
        nodes[0] = 0.0
