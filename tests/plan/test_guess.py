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
from planner.machine.limits import Limits
from planner.machine.machine_file import load_limits
from planner.plan.guess import guess_feed
from planner.plan.section import cut


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
