"""The rule for curvature jumps, against steps of an acceleration that are sampled and differenced."""

import numpy as np
import pytest

from planner import Limits
from planner.plan import jumps
from planner.verify import sizes

JERK, PERIOD = np.array([2.0e4, 3.0e4]), 1e-3


def sampled(steps, times, phase):
    """Third differences over T^3 of a position whose acceleration steps by ``steps`` at ``times``, sampled at a phase."""
    span = times[-1] - times[0] + 12.0 * PERIOD
    t = times[0] - 6.0 * PERIOD + (phase + np.arange(int(span / PERIOD) + 2)) * PERIOD
    position = sum(0.5 * step * np.maximum(t - at, 0.0) ** 2 for step, at in zip(steps, times, strict=True))
    middle = 0.5 * (t[1:-2] + t[2:-1])
    return middle, np.diff(position, 3) / PERIOD**3


def highest(steps, times):
    return max(np.abs(sampled(steps, times, phase)[1]).max() for phase in np.linspace(0.0, 1.0, 41))


class TestOneJump:
    def test_a_sampled_step_has_the_peak_and_the_reach_that_the_rule_says(self):
        assert highest([1.0], [0.0]) * PERIOD == pytest.approx(jumps.STEP_SEEN, rel=1e-9)
        seen = [
            abs(at)
            for phase in np.linspace(0.0, 1.0, 101)
            for at, jerk in zip(*sampled([1.0], [0.0], phase), strict=True)
            if abs(jerk) * PERIOD > 1e-9
        ]
        assert max(seen) / PERIOD == pytest.approx(jumps.STEP_REACH, abs=0.02)

    def test_planner_and_check_know_the_same_peak_each_by_itself(self):
        assert (sizes.STEP_PEAK, sizes.STEP_REACH) == (jumps.STEP_SEEN, jumps.STEP_REACH)

    def test_at_the_passable_rate_the_samples_of_the_step_have_half_of_the_tightest_jerk(self):
        rng = np.random.default_rng(3)
        for _ in range(50):
            step = rng.normal(size=(1, 2))
            x = jumps.passable(step, JERK, PERIOD)[0]
            used = [highest([step[0, j] * x], [0.0]) / JERK[j] for j in (0, 1)]
            assert max(used) == pytest.approx(1.0 - jumps.JERK_BESIDE_STEP, rel=1e-9)

    def test_without_a_step_or_a_limit_any_rate_passes(self):
        steps = np.array([[0.0, 0.0], [1.0, 0.0]])
        assert (jumps.passable(steps, np.array([np.inf, 1.0]), PERIOD) == np.inf).all()


class TestManyJumps:
    @pytest.mark.parametrize("seed", range(20))
    def test_steps_that_meet_have_half_of_the_jerk_together(self, seed):
        """Jumps a fraction of a millimetre apart, passed at the rate that ``soften`` leaves."""
        rng = np.random.default_rng(seed)
        apart = 10.0 ** rng.uniform(-3.0, 0.0)
        sigma = np.array([0.0, 10.0, 10.0, 10.0 + apart, 10.0 + apart, 30.0])
        step = np.column_stack([rng.normal(size=(2, 2)), np.zeros(2)])
        limits = Limits(200.0, np.inf, [3e3, 3e3], JERK, period=PERIOD)
        cap = np.full(2 * sigma.size - 1, 4e4)
        beside = jumps.soften(limits, sigma, np.array([1, 3]), step, cap)
        passed = cap[[2, 6]]
        rate = np.sqrt(passed.min())
        times = np.array([0.0, apart]) / rate
        used = max(highest(step[:, j] * passed.min(), times) / JERK[j] for j in (0, 1))
        # the two steps are taken at one rate here, at least that of the slower: what both allow holds at the lower
        assert used <= (1.0 - jumps.JERK_BESIDE_STEP) * (1.0 + 1e-3)
        assert beside[2:9].all()
        assert (cap <= 4e4).all()

    def test_far_apart_each_passes_as_if_alone(self):
        sigma = np.array([0.0, 10.0, 10.0, 60.0, 60.0, 90.0])
        step = np.array([[0.3, -0.2, 0.0], [0.1, 0.5, 0.0]])
        limits = Limits(200.0, np.inf, [3e3, 3e3], JERK, period=PERIOD)
        cap = np.full(11, 4e4)
        jumps.soften(limits, sigma, np.array([1, 3]), step, cap)
        np.testing.assert_allclose(cap[[2, 6]], jumps.passable(step[:, :2], JERK, PERIOD), rtol=1e-14)
