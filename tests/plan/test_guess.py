"""The guess of the feed that places the knots."""

import numpy as np
import pytest
from cases import CURVES, ellipse, line, mill
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import laid_out
from utilisation_reference import limit_growth

from planner import load_curve
from planner.compiled import core
from planner.errors import InfeasibleError
from planner.geometry.differential import arc_derivatives, curvature, norm
from planner.geometry.nurbs import NurbsCurve
from planner.machine.feed_limits import chord_feed_limit, commanded_feed
from planner.machine.limits import Limits
from planner.machine.machine_file import load_limits
from planner.plan.guess import guess_feed
from planner.plan.section import axis_weights, cut


def test_guess_is_reachable_and_below_what_every_point_allows(case):
    _, _, _, guess, _ = case
    assert (guess.feed <= guess.ceiling * (1.0 + 1e-6)).all()
    assert (guess.feed[1:-1] > 0.0).all()
    assert guess.feed[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-3 * guess.feed.max())
    rise = np.abs(np.diff(guess.feed**2))
    allowed = 2.0 * np.maximum(guess.acceleration[1:], guess.acceleration[:-1]) * np.diff(guess.length)
    assert (rise <= allowed + 1e-9 * guess.feed.max() ** 2).all()


def test_turning_and_length_of_the_guess():
    _, guess, _ = laid_out(ellipse(20.0, 20.0), mill())
    assert guess.turning[-1] == pytest.approx(2.0 * np.pi, rel=1e-9)
    assert guess.length[-1] == pytest.approx(40.0 * np.pi, rel=1e-9)
    assert guess.ceiling == pytest.approx(np.full(guess.ceiling.size, 100.0))


def test_guess_on_a_line_is_that_of_constant_acceleration():
    limits = mill(jerk=[np.inf] * 2)
    _, guess, _ = laid_out(line(50.0), limits)
    s = guess.length
    left = np.maximum(np.minimum(s, 50.0 - s), 0.0)
    assert guess.feed == pytest.approx(np.minimum(100.0, np.sqrt(1400.0 * left)), abs=1e-3)


def test_a_path_that_nothing_limits_is_refused():
    limits = Limits(np.inf, [np.inf] * 2, [np.inf] * 2, [np.inf] * 2)
    (section,) = cut(line(10.0), limits, exact_stop=False)
    with pytest.raises(InfeasibleError, match="nothing limits the feed between u = 0 and 1"):
        guess_feed(section, limits, 100)


@given(st.integers(0, 10**6))
@settings(max_examples=50)
def test_growth_is_limited_from_every_neighbour(seed):
    """The largest values that no neighbour is exceeded from by more than its step, also where the steps differ by 1e20."""
    rng = np.random.default_rng(seed)
    values, steps = 10.0 ** rng.uniform(-20.0, 0.0, 12), 10.0 ** rng.uniform(-20.0, 0.0, 11)
    limited = values.copy()
    plain = values.copy()
    core.guess_limit_growth(12, limited, steps)
    limit_growth(plain, steps)
    assert np.array_equal(limited, plain)
    between = np.array([[steps[min(i, j) : max(i, j)].sum() for j in range(12)] for i in range(12)])
    assert limited == pytest.approx((values + between).min(axis=1), rel=1e-14, abs=0.0)


def test_a_feed_is_left_where_the_parameter_hardly_moves_the_path():
    """Beside a near-cusp differences of the path's length are nothing but rounding, and the feed must not vanish."""
    curve, limits = load_curve(CURVES / "seed36.json"), load_limits(CURVES / "seed36.toml")
    sections = cut(curve, limits, exact_stop=False)
    assert sections
    for section in sections:
        assert np.isfinite(guess_feed(section, limits, 1000).duration)


def by_arrays(curve, limits, u):
    """What ``guess_ceiling`` finds, by numpy's arrays."""
    q, tip = (part.pieces.evaluate(u, 3, u >= u[-1]) for part in (curve, curve.tip))
    weights = axis_weights(limits)
    scaled = q.copy()
    scaled[1:] *= weights
    with np.errstate(all="ignore"):
        arc = arc_derivatives(scaled)
        speed = norm(scaled[1])
        ratio = norm(tip[1]) / speed
        least = [
            np.fmin.reduce(weights * limit / np.abs(arc[k]), axis=1)
            for limit, k in (
                (limits.velocity, 1),
                (limits.acceleration, 2),
                (limits.jerk, 3),
                (limits.acceleration, 1),
                (limits.jerk, 1),
            )
        ]
        feed = np.fmin(commanded_feed(curve, limits, u), chord_feed_limit(curvature(tip), limits))
        along = [
            np.where(ratio > 0.0, most / ratio, np.inf)
            for most in (feed, limits.tangential_acceleration, limits.tangential_jerk)
        ]
        ceiling = np.fmin(np.fmin(least[0], np.sqrt(least[1])), along[0])
        tangential = np.fmin(least[3], along[1]), np.fmin(least[4], along[2])
        found = np.empty((5, u.size))
        core.guess_ceiling(
            *(u.size, curve.dim, curve.tip.dim, q, tip, weights, speed, speed**3, ratio, weights * limits.velocity),
            *(weights * limits.acceleration, weights * limits.jerk, commanded_feed(curve, limits, u)),
            *(limits.chord_error, limits.period, limits.tangential_acceleration, limits.tangential_jerk, found),
        )
    return np.stack([ceiling, least[2], *tangential, norm(arc[2])]), found


PLANAR = {
    "every limit": mill(chord_error=1e-3, tangential_acceleration=700.0, tangential_jerk=9e3),
    "no chord error": mill(),
    "axes that are not alike": Limits(100.0, [250.0, 90.0], [1000.0, 400.0], [2e4, np.inf], chord_error=1e-5),
    "nothing but a feed": Limits(50.0, *[[np.inf] * 2] * 3),
}


@pytest.mark.parametrize("limits", PLANAR.values(), ids=PLANAR)
@pytest.mark.parametrize("curve", [load_curve("circle"), line(10.0), load_curve("hypotrochoid", scale=10.0)])
def test_the_compiled_ceiling_has_the_bits_of_the_arrays(curve, limits):
    plain, found = by_arrays(curve, limits, np.linspace(*curve.domain, 501))
    np.testing.assert_array_equal(found, plain)


def test_the_ceiling_of_many_axes_is_that_of_the_arrays():
    """Sums of products in another order: their last digits differ.  On part of the second path the tip rests."""
    points = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.1], [10.0, 0.0, 0.2], [20.0, 5.0, 0.3]]
    turning = NurbsCurve(points, [0, 0, 1, 2, 3, 3], 1, axes=["X", "Y", "A"])
    machine = Limits(100.0, [250, 250, 0.1], [1000, 1000, 10], [2e4, 2e4, 200], 1e-3, axes=["X", "Y", "A"])
    for curve, limits in ((load_curve("flank"), load_limits("five-axis")), (turning, machine)):
        plain, found = by_arrays(curve, limits, np.linspace(*curve.domain, 301))
        np.testing.assert_allclose(found[[0, 2, 3]], plain[[0, 2, 3]], rtol=1e-12)
        # what is 0 but for rounding has no digits, and no limit by it
        for row, exact in ((1.0 / found[1], 1.0 / plain[1]), (found[4], plain[4])):
            np.testing.assert_allclose(row, exact, rtol=1e-9, atol=1e-12 * exact.max())
    assert np.isinf(plain[1]).any()
