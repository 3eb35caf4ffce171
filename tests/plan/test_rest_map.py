"""The rest map against its polynomial in exact fractions, and against its inverse."""

from fractions import Fraction

import numpy as np
import pytest

from planner.plan.rest_map import BLEND_LENGTH, covered, share_of_blend, slopes

SHARES = [Fraction(k, 64) for k in range(65)]


def slope(r):
    """p(r) as it is derived: flat at both ends of the blend, 0 at the stop and 1 where the middle begins."""
    return 1 - (1 - r) ** 4 * (1 + 4 * r + 6 * r**2)


def taylor(r):
    """Derivatives of p at r by exact differences of its sixth degree, from seven points."""
    step = Fraction(1, 1024)
    points = [r + k * step for k in range(-3, 4)]
    basis = []
    for k, x in enumerate(points):
        coefficients = [Fraction(1)]
        for j, other in enumerate(points):
            if j != k:
                scale = 1 / (x - other)
                shifted = [Fraction(0), *coefficients]
                coefficients = [
                    scale * (shifted[i] - (other - r) * (coefficients[i] if i < len(coefficients) else 0))
                    for i in range(len(shifted))
                ]
        basis.append(coefficients)
    return [sum(slope(x) * b[order] for x, b in zip(points, basis, strict=True)) for order in range(3)]


@pytest.mark.parametrize("r", SHARES[::8])
def test_slopes_are_those_of_the_polynomial(r):
    value, first, half_second = taylor(r)
    found = [float(some[0]) for some in slopes(np.array([float(r)]))]
    assert found == pytest.approx([float(value), float(first), float(2 * half_second)], abs=1e-12)


def test_what_is_covered_is_the_integral_of_the_slope():
    nodes, weights = np.polynomial.legendre.leggauss(4)  # exact to degree 7
    for r in SHARES:
        inside = float(r) * 0.5 * (nodes + 1.0)
        expected = 0.5 * float(r) * float(weights @ slopes(inside)[0])
        assert float(covered(np.array([float(r)]))[0]) == pytest.approx(expected, abs=1e-15)
    assert float(covered(np.ones(1))[0]) == pytest.approx(BLEND_LENGTH, abs=1e-16)


def test_it_is_at_rest_at_the_stop_and_flat_at_both_ends():
    for r, values in ((0.0, [0.0, 0.0]), (1.0, [1.0, 0.0])):
        value, first, _ = (float(some[0]) for some in slopes(np.array([r])))
        assert [value, first] == pytest.approx(values, abs=1e-14)


def test_the_inverse_holds_over_twenty_decades():
    r = np.concatenate([10.0 ** np.arange(-7.0, 0.0, 0.25), np.linspace(0.1, 1.0, 50)])
    assert share_of_blend(covered(r)) == pytest.approx(r, rel=1e-11)
    assert share_of_blend(np.array([0.0])).tolist() == [0.0]
