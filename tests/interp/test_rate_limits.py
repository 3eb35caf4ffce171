"""What the rate of a plan may do, and that no signal of override and hold breaks a limit."""

from dataclasses import replace

import numpy as np
import pytest
from override_signals import adversary, random_signal, ratios

from feedplan.job import load_job
from interp import replay
from interp.plan_file import plan_bytes
from interp.rate_limits import RateLimits, rate_limits
from interp.step import PlanStep
from planner import Limits, check, load_curve, plan_feedrate
from planner.errors import InputError

RESERVE = 0.09
PERIODS = (0.25e-3, 1e-3, 2e-3)
MACHINE = Limits(100.0, 300.0, 1000.0, 20000.0)


class Case:
    """The butterfly planned with a reserve, the fastest stop within it, and its plan file."""

    def __init__(self, name, limits, reserve):
        self.curve = load_curve(name)
        self.limits = limits.on(self.curve)
        self.profile = plan_feedrate(self.curve, self.limits, override_reserve=reserve)
        self.governor = rate_limits(self.profile, self.limits)
        self.content = plan_bytes(self.profile, self.limits, governor=self.governor)

    def step(self, period, governor=None):
        content = self.content if governor is None else plan_bytes(self.profile, self.limits, governor=governor)
        return PlanStep(content, period)

    def signal(self, seed, period, governor=None):
        """Ratios of velocity, acceleration and jerk under a random signal, and how many periods it ran."""
        rng = np.random.default_rng(seed)
        step = self.step(period, governor)
        # As long as the plan takes: what is left of it when the signal ends is of no interest.
        override, hold = random_signal(rng, int(1.2 * self.profile.duration / period), period)
        if rng.random() < 0.5:  # anywhere in the plan, from a stand
            step.seek(rng.uniform(0.0, self.profile.duration))
        start = step.position.copy()
        positions, course = step.run(override.size, override, hold)
        found = ratios(np.concatenate([start[None], positions]), period, self.limits, ends=step.done)
        return found, course


@pytest.fixture(scope="module")
def butterfly():
    return Case("butterfly-nurbs", MACHINE, RESERVE)


# ---- what is promised ------------------------------------------------------------------------------------------------


def test_a_stop_and_a_resume_take_what_is_said(butterfly):
    assert butterfly.governor.stop_time < 0.7
    without = plan_feedrate(butterfly.curve, butterfly.limits).duration
    assert butterfly.profile.duration < 1.03 * without
    step = butterfly.step(1e-3)
    step.run(2000)
    _, down = step.run(2000, 0.0)
    _, up = step.run(2000, 1.0)
    taken = [1e-3 * np.count_nonzero(down[:, 1] > 0.0), 1e-3 * np.count_nonzero(up[:, 1] < 1.0)]
    assert down[-1, 1] == 0.0
    assert up[-1, 1] == 1.0
    assert taken == pytest.approx([butterfly.governor.stop_time] * 2, abs=4e-3)


@pytest.mark.parametrize("period", PERIODS)
def test_random_signals_keep_every_limit(butterfly, period):
    worst, lowest = np.zeros(3), 1.0
    for seed in range(60 if period > 0.5e-3 else 30):
        found, course = butterfly.signal(seed, period)
        worst = np.maximum(worst, found)
        lowest = min(lowest, course[:, 1].min())
    assert (worst <= 1.0).all(), worst
    assert worst[2] > 0.9, worst  # they try
    assert lowest == 0.0


@pytest.mark.slow
def test_ten_thousand_random_signals_keep_every_limit(butterfly):
    worst = np.zeros(3)
    for seed in range(10_000):
        worst = np.maximum(worst, butterfly.signal(1000 + seed, PERIODS[seed % 3])[0])
    print(worst)
    assert (worst <= 1.0).all(), worst


def test_square_waves_of_every_frequency_keep_every_limit(butterfly):
    worst = np.zeros(3)
    for period in PERIODS[1:]:
        for half in np.unique(np.geomspace(1, 1.0 / period, 25).astype(int)):
            for low, high in ((0.0, 1.0), (0.0, 0.1), (0.9, 1.0), (0.4, 0.6)):
                step = butterfly.step(period)
                count = int(1.5 * butterfly.profile.duration / period)
                override = np.where(np.arange(count) // half % 2, low, high)
                start = step.position.copy()
                positions, _ = step.run(count, override)
                found = ratios(np.concatenate([start[None], positions]), period, butterfly.limits, ends=step.done)
                worst = np.maximum(worst, found)
    assert (worst <= 1.0).all(), worst


@pytest.mark.parametrize("period", PERIODS[1:])
def test_an_adversary_keeps_every_limit(butterfly, period):
    worst = np.zeros(3)
    for begin in (0.0, 1.3, 3.1):
        step = butterfly.step(period)
        step.seek(begin)
        positions = adversary(step, butterfly.limits, 500)
        worst = np.maximum(worst, ratios(positions, period, butterfly.limits, ends=False))
    assert (worst <= 1.0).all(), worst
    assert worst[2] > 0.9, worst


@pytest.mark.slow
@pytest.mark.parametrize("period", PERIODS)
def test_an_adversary_over_the_whole_plan(butterfly, period):
    step = butterfly.step(period)
    positions = adversary(step, butterfly.limits, int(8.0 / period))
    worst = ratios(positions, period, butterfly.limits, ends=step.done)
    print(worst)
    assert (worst <= 1.0).all(), worst


def test_a_governor_that_allows_too_much_is_caught(butterfly):
    """The planted error: twice the rate, or a plan without reserve under the same governor, breaks a limit."""
    twice = replace(butterfly.governor, high=4.0 * butterfly.governor.high, low=4.0 * butterfly.governor.low)
    worst = max(butterfly.signal(seed, 1e-3, twice)[0].max() for seed in range(20))
    assert worst > 1.05
    greedy = plan_feedrate(butterfly.curve, butterfly.limits)
    assert rate_limits(greedy, butterfly.limits) is None
    step = PlanStep(plan_bytes(greedy, butterfly.limits, governor=butterfly.governor), 1e-3)
    start = step.position.copy()
    positions, _ = step.run(4000, np.where(np.arange(4000) // 400 % 2, 0.0, 1.0))
    assert ratios(np.concatenate([start[None], positions]), 1e-3, butterfly.limits, ends=False).max() > 1.02


@pytest.mark.parametrize("name", ["circle", "flank", "teardrop"])
def test_other_curves_pass_the_check_under_override(name):
    """Curvature jumps, five axes: by the check itself, with the contour and the chord error."""
    job = load_job(name, override_reserve=0.1)
    profile = job.plan()
    content = plan_bytes(profile, job.limits)
    for seed in range(2):
        step = PlanStep(content, job.limits.period)
        rng = np.random.default_rng(seed)
        override, hold = random_signal(rng, int(2.0 * profile.duration / step.period), step.period)
        samples = step.samples(job.curve.axes, override, hold)
        report = job.check(samples)
        assert report.ok, report.summary()


# ---- the triangle ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [*PERIODS, 8e-3])
def test_the_rate_stays_in_its_triangle(butterfly, period):
    """r'^2 <= 2 L r and 2 H (1 - r) after every period, whatever is asked for; too long a period makes L as small as H."""
    high = butterfly.governor.high
    low = butterfly.governor.low if period <= butterfly.governor.longest_period else high
    for seed in range(12):
        _, course = butterfly.signal(seed, period)
        rate, slope = course[:, 1], course[:, 2]
        assert (rate >= 0.0).all()
        assert (rate <= 1.0).all()
        assert (slope**2 <= 2.0 * low * rate * (1.0 + 1e-7) + 1e-15).all()
        assert (slope**2 <= 2.0 * high * (1.0 - rate) * (1.0 + 1e-7) + 1e-12).all()


@pytest.mark.parametrize("target", [0.0, 1e-9, 0.02, 0.0607, 0.3, 0.77, 1.0 - 1e-9, 1.0])
def test_the_rate_comes_to_what_is_asked_for_and_stays(butterfly, target):
    for begin in (0.0, 0.03, 0.5, 1.0):
        step = butterfly.step(1e-3)
        step.seek(1.0, rate=begin)
        _, course = step.run(1500, target)
        assert course[-1, 1] == target
        assert course[-1, 2] == 0.0
        rate = course[:, 1]
        assert ((np.diff(rate) >= -1e-12) | (np.diff(rate) <= 1e-12)).all()
        # It does not pass the target by more than a period's worth.
        beyond = (rate - target) * np.sign(target - begin)
        assert beyond.max() < 1e-3


@pytest.mark.parametrize("reserve", [0.05, 0.1])
def test_no_faster_pair_of_bounds_was_missed(reserve):
    """Against a plain search over both bounds with a formula of its own at points between those of the module."""
    case = Case("teardrop", MACHINE, reserve)
    profile, limits = case.profile, case.limits
    t = np.linspace(0.0, profile.duration, 4_011)
    u, first, second, third = (part[:, None] for part in profile.law.at(t))
    d = case.curve.derivatives(np.clip(u[:, 0], *case.curve.domain), 3)
    v, a, j = (
        np.abs(part)
        for part in (
            d[1] * first,
            d[2] * first**2 + d[1] * second,
            d[3] * first**3 + 3.0 * d[2] * first * second + d[1] * third,
        )
    )

    def exceeded(high, low):
        tip = high / (high + low)
        worst = 0.0
        for rate in np.linspace(0.0, 1.0, 150):
            slope = np.sqrt(min(2.0 * low * rate, 2.0 * high * (1.0 - rate)))
            curve = low if rate <= tip else high
            worst = max(
                worst,
                ((rate**2 * a + slope * v) / limits.acceleration).max(),
                ((rate**3 * j + 3.0 * rate * slope * a + curve * v) / limits.jerk).max(),
            )
        return worst

    found = case.governor
    assert exceeded(found.high, found.low) <= 1.0
    assert exceeded(1.1 * found.high, found.low) > 1.0
    assert exceeded(found.high, 1.5 * found.low) > 1.0


def test_stop_time_is_that_of_the_triangle():
    bounds = RateLimits(10.0, 40.0, 0.25)
    assert bounds.fastest == pytest.approx(4.0)
    assert bounds.stop_time == pytest.approx(0.5)


def test_the_end_of_the_plan_may_be_reached_at_any_rate(butterfly):
    for override in (1.0, 0.5, 0.013):
        step = butterfly.step(1e-3)
        step.seek(butterfly.profile.duration - 0.05)
        samples = step.samples(override=np.full(40_000, override))
        assert step.done
        assert (samples.position[-1] == step.position).all()
        assert (ratios(samples.position, 1e-3, butterfly.limits, ends=True) <= 1.0).all()


def test_samples_under_override_lie_on_the_curve(butterfly):
    step = butterfly.step(1e-3)
    override, hold = random_signal(np.random.default_rng(5), 8000, 1e-3)
    samples = step.samples(butterfly.curve.axes, override, hold)
    there = butterfly.curve.derivatives(samples.u, 0)[0]
    assert np.abs(there - samples.position).max() < 1e-10
    assert check(butterfly.curve, butterfly.limits, samples).ok


def test_a_plan_without_reserve_has_none(butterfly):
    plain = plan_feedrate(butterfly.curve, butterfly.limits)
    step = PlanStep(plan_bytes(plain, butterfly.limits))
    assert not step.governed
    with pytest.raises(InputError, match="made without a reserve"):
        step.step(0.5)
    with pytest.raises(InputError, match="made without a reserve"):
        step.run(10, hold=True)
    assert (step.samples().position == replay(butterfly.curve, plain).position).all()
