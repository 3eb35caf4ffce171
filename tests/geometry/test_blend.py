"""Legs against fifty digits: lines, arcs and spirals, alone and among one another."""

import mpmath
import numpy as np
import pytest

from planner.geometry.blend import turning

LINE = ([0.0, 0.0], [0.0, 0.0], [0.6, -0.8], 0.0, 0.0)
SHIFTED = ([3.0, 1.0], [0.0, 0.0], [0.6, -0.8], 0.0, 0.0)  # a leg that begins off its origin
ARC = ([2.0, 0.0], [0.0, 2.0], [0.0, 0.0], 0.5, 0.0)
HELIX = ([2.0, 1.0], [-1.0, 2.0], [0.1, 0.2], -0.4, 0.0)
SPIRAL = ([2.0, 0.0], [0.0, 2.0], [0.0, 0.1], 0.5, 0.03)
GROWING = ([2.0, 1.0], [0.0, 0.0], [0.3, 0.0], 0.0, 0.05)  # no turn, and yet no line of constant speed
KINDS = {"line": LINE, "shifted": SHIFTED, "arc": ARC, "helix": HELIX, "spiral": SPIRAL, "growing": GROWING}


def arrays(legs):
    return np.array([leg[:3] for leg in legs]), np.array([leg[3:] for leg in legs])


def exact(leg, x, order):
    e1, e2, g, w, k = leg

    def axis(j):
        def value(at):
            radial = mpmath.mpf(e1[j]) * mpmath.cos(w * at) + mpmath.mpf(e2[j]) * mpmath.sin(w * at)
            return (1 + mpmath.mpf(k) * at) * radial + mpmath.mpf(g[j]) * at

        return float(mpmath.diff(value, mpmath.mpf(x), order))

    with mpmath.workdps(50):
        return [axis(j) for j in range(2)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_leg_and_its_derivatives(kind):
    x = np.array([0.0, 0.7, 3.0])
    found = turning(*arrays([KINDS[kind]] * 3), x)
    expected = [[exact(KINDS[kind], at, order) for at in x] for order in range(4)]
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-14)


def test_each_leg_among_others_is_what_it_is_alone():
    legs, x = [*KINDS.values(), *reversed(KINDS.values())], np.linspace(0.1, 4.0, 2 * len(KINDS))
    alone = np.concatenate([turning(*arrays([leg]), x[i : i + 1]) for i, leg in enumerate(legs)], axis=1)
    np.testing.assert_array_equal(turning(*arrays(legs), x), alone)
