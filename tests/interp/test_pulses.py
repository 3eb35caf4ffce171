"""Step pulses: against closed forms of mpmath, and against an integrator that counts them while it evaluates the plan."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from cases import PROGRAMS

from interp import pulses
from interp.pulses import MAX_EXCESS, PulseSummary, StepDriver, first_counts, highest_frequency, step_pulses
from planner import BrokenLimitError, InputError, Limits, load_curve, load_limits, plan_feedrate
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.profile import make_profile

LOOSE = Limits(1e3, 1e3, 1e5, 1e7, period=1e-3)
PICO = 1e12  # Hz
SLOW = {"pulse": 1e-9, "space": 1e-9, "setup": 1e-9}


def rest_to_rest(points, duration=1.0, weights=None):
    """A Bezier curve over one quintic, u = 10 x^3 - 15 x^4 + 6 x^5 with x = t / duration."""
    degree = len(points) - 1
    knots = [0.0] * (degree + 1) + [1.0] * (degree + 1)
    curve = NurbsCurve(points, knots, degree, weights, name="probe")
    zero = np.zeros(2)
    return make_profile(curve, LOOSE, TimeLaw(np.array([0.0, duration]), np.array([0.0, 1.0]), zero, zero), method="")


def everything(profile, driver):
    """All pulses in three arrays, and the summary."""
    summary = PulseSummary()
    blocks = list(step_pulses(profile, driver, summary))
    assert all(len(block) for block in blocks)
    return tuple(np.concatenate([getattr(b, name) for b in blocks]) for name in ("tick", "axis", "up")), summary


def time_at(u):
    """When the quintic reaches u, to 40 digits."""
    with mp.workdps(40):
        return mp.findroot(
            lambda x: 10 * x**3 - 15 * x**4 + 6 * x**5 - u, (mp.mpf(0), mp.mpf(1)), solver="anderson", tol=1e-60
        )


class TestClosedForms:
    def test_a_straight_line(self):
        """X = 3 u: level k + 1/2 is passed where u = (k + 1/2) / 30."""
        (tick, axis, up), summary = everything(
            rest_to_rest([[0.0, 0.0], [3.0, 0.0]]), StepDriver({"X": 10.0, "Y": 1.0}, PICO, **SLOW)
        )
        assert up.all()
        assert not axis.any()
        expected = [time_at((mp.mpf(k) + mp.mpf(1) / 2) / 30) for k in range(30)]
        assert len(tick) == 30
        for found, exact in zip(tick.tolist(), expected, strict=True):
            assert abs(found - exact * 10**12) <= 1.0
        assert summary.pulses == [30, 0]
        assert summary.error_steps == 0.5

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_an_axis_that_turns(self, sign):
        """Y = 4 u (1 - u): up through 9 levels to 1, and back; negative, the other way."""
        profile = rest_to_rest([[0.0, 0.0], [1.0, 2.0 * sign], [2.0, 0.0]])
        (tick, axis, up), summary = everything(profile, StepDriver({"X": 1e-3, "Y": 9.0}, PICO, **SLOW))
        assert summary.pulses == [0, 18]
        assert axis.all()
        assert up.tolist() == [sign > 0.0] * 9 + [sign < 0.0] * 9
        root = [mp.sqrt(1 - (mp.mpf(k) + mp.mpf(1) / 2) / 9) for k in range(9)]
        expected = [time_at((1 - r) / 2) for r in root] + [time_at((1 + r) / 2) for r in root[::-1]]
        for found, exact in zip(tick.tolist(), expected, strict=True):
            assert abs(found - exact * 10**12) <= 1.0

    def test_a_rational_piece(self):
        """A quarter of a circle: X = R (1 - u^2) / (1 + u^2), so u = sqrt((R - x) / (R + x))."""
        profile = rest_to_rest([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], weights=[1.0, 1.0, 2.0])
        (tick, axis, up), _ = everything(profile, StepDriver({"X": 20.0, "Y": 1e-3}, PICO, **SLOW))
        assert not axis.any()
        assert not up.any()
        levels = [(mp.mpf(k) + mp.mpf(1) / 2) / 20 for k in range(19, -1, -1)]
        expected = [time_at(mp.sqrt((1 - x) / (1 + x))) for x in levels]
        assert tick.size == 20
        for found, exact in zip(tick.tolist(), expected, strict=True):
            assert abs(found - exact * 10**12) <= 1.0


PLANS = ("butterfly-nurbs", "teardrop", "circle", "flank", str(PROGRAMS / "slots.ngc"))


@pytest.fixture(scope="module", params=PLANS)
def planned(request):
    """Plans of rational and plain splines, formulas, five axes, and of a part program."""
    name = request.param
    curve = load_curve(name, tolerance=0.01) if name.endswith(".ngc") else load_curve(name)
    limits = load_limits("five-axis" if "A" in curve.axes else "mill").for_curve(curve)
    return plan_feedrate(curve, limits)


def of_axes(profile, per_mm=1000.0, per_rad=7000.0, **named):
    curve = profile.curve
    units = zip(curve.axes, curve.axis_units, strict=True)
    return StepDriver({axis: per_mm if unit == "mm" else per_rad for axis, unit in units}, **named)


class TestIndependentIntegrator:
    """The counter beside the curve itself: none of the polynomials the pulses were found on are used."""

    def test_it_is_within_half_a_step_at_every_instant(self, planned):
        driver = of_axes(planned)
        (tick, axis, up), summary = everything(planned, driver)
        assert (np.diff(tick) >= 0).all()
        steps, starts = driver.steps_of(planned.curve.axes), first_counts(planned, driver)
        rng = np.random.default_rng(3)
        t = np.sort(np.concatenate([rng.uniform(0.0, planned.duration, 50_000), [0.0, planned.duration]]))
        for j in range(planned.curve.dim):
            own = tick[axis == j] / driver.clock_hz
            counts = starts[j] + np.concatenate([[0], np.cumsum(np.where(up[axis == j], 1, -1))])
            # just before and just after each pulse as well: there the error is largest
            near = np.concatenate([t, own - 2e-9, own + 2e-9])
            near = np.clip(near, 0.0, planned.duration)
            states = planned.at(near)
            d = planned.curve.derivatives(states.u, 1)
            moved = steps[j] * np.abs(d[1][:, j] * states.u_rate)
            off = np.abs(steps[j] * d[0][:, j] - counts[np.searchsorted(own, near, side="right")])
            slack = 0.5 * moved / driver.clock_hz + 1e-6
            assert (off <= summary.error_steps + slack).all()
            assert off.max() > 0.499
            assert summary.pulses[j] == own.size
        assert tick.size > 10_000

    def test_before_rounding_it_is_exact(self, planned):
        """With a clock a thousand times finer what the tick adds is gone."""
        driver = of_axes(planned, clock_hz=PICO)
        (tick, axis, up), _ = everything(planned, driver)
        steps, starts = driver.steps_of(planned.curve.axes), first_counts(planned, driver)
        q = planned.curve.derivatives(planned.at(np.minimum(tick / PICO, planned.duration)).u, 0)[0]
        for j in range(planned.curve.dim):
            own = axis == j
            way = np.where(up[own], 1.0, -1.0)
            levels = starts[j] + np.cumsum(way) - 0.5 * way
            assert np.abs(steps[j] * q[own, j] - levels).max(initial=0.0) <= 1e-6

    def test_no_frequency_exceeds_its_bound(self, planned):
        driver = of_axes(planned)
        _, summary = everything(planned, driver)
        assert (np.array(summary.highest_hz) <= highest_frequency(planned, driver) * (1.0 + 1e-6)).all()

    def test_the_counter_ends_where_the_plan_does(self, planned):
        driver = of_axes(planned)
        (_, axis, up), _ = everything(planned, driver)
        starts = first_counts(planned, driver)
        end = planned.curve.derivatives(planned.u[-1], 0)[0] * driver.steps_of(planned.curve.axes)
        for j in range(planned.curve.dim):
            assert abs(starts[j] + np.where(up[axis == j], 1, -1).sum() - end[j]) <= 0.5 + 1e-6


def test_the_size_of_a_block_changes_nothing(monkeypatch):
    profile = rest_to_rest([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]])
    driver = StepDriver({"X": 300.0, "Y": 200.0}, 1e9, **SLOW)
    whole, _ = everything(profile, driver)
    monkeypatch.setattr(pulses, "_PULSES_AT_ONCE", 7)
    parts, summary = everything(profile, driver)
    assert sum(summary.pulses) == whole[0].size > 900
    for one, other in zip(whole, parts, strict=True):
        assert np.array_equal(one, other)


class TestWhereAnAxisTurns:
    """Y = 4 h u (1 - u), turning at h: a level that is passed by next to nothing."""

    @staticmethod
    def peak(excess):
        h = (10.5 + excess) / 100.0
        return rest_to_rest([[0.0, 0.0], [1.0, 2.0 * h], [2.0, 0.0]])

    def driver(self, **named):
        return StepDriver({"X": 1e-3, "Y": 100.0}, **named)

    def test_a_pair_that_fits_stays(self):
        (tick, _, up), summary = everything(self.peak(1e-4), self.driver())
        assert (summary.left_out, summary.error_steps, tick.size) == (0, 0.5, 22)
        turn = int(np.flatnonzero(~up)[0])
        assert tick[turn] - tick[turn - 1] >= 7500

    def test_one_that_does_not_is_left_out_and_said(self):
        """The peak is passed in 2 sqrt(2 e / a) s; at 1e-9 of a step that is 1.1 us, too short for the driver."""
        (tick, _, _), summary = everything(self.peak(1e-9), self.driver())
        assert (summary.left_out, tick.size) == (1, 20)
        assert summary.error_steps == pytest.approx(0.5 + 1e-9, abs=1e-10)

    def test_one_that_reaches_further_is_refused(self):
        with pytest.raises(
            BrokenLimitError,
            match=r"Y: pulses at \d+\.?\d* Hz where it turns, .* us apart at t = 0\.51\d+ s, Y = 0\.105",
        ):
            everything(self.peak(20.0 * MAX_EXCESS), self.driver(setup=0.05))

    def test_a_level_just_reached_is_not_passed(self):
        (tick, _, _), _ = everything(self.peak(-1e-9), self.driver())
        assert tick.size == 20


class TestRefusals:
    PROFILE = rest_to_rest([[0.0, 0.0], [10.0, 0.0]])

    def test_too_fast(self):
        with pytest.raises(
            BrokenLimitError,
            match=r"X: pulses at 1\d+(\.\d+)? Hz, [\d.]+ us apart at t = 0\.\d+ s, X = \d\.\d+ mm; the driver takes 10000 "
            r"Hz there, 100 us; plan with a lower velocity of X, or take fewer steps per mm",
        ):
            everything(self.PROFILE, StepDriver({"X": 1000.0, "Y": 1.0}, pulse=5e-5, space=5e-5))

    @pytest.mark.parametrize(
        ("steps", "named", "message"),
        [
            ({"X": 10.0}, {}, "steps per mm of Y are missing; give them for each of the axes X Y"),
            ({"X": 0.0, "Y": 1.0}, {}, r"steps per mm of X = 0\.0 must be a number > 0"),
            ({"X": -3.0, "Y": 1.0}, {}, r"steps per mm of X = -3\.0 must be a number > 0"),
            ({"X": np.inf, "Y": 1.0}, {}, "steps per mm of X = inf must be > 0 and finite"),
            ({"A": np.nan}, {}, "steps per rad of A = nan must be"),
            ({"X": 1.0, "Y": 1.0}, {"clock_hz": 0.0}, r"clock_hz = 0\.0 must be a number > 0"),
            ({"X": 1.0, "Y": 1.0}, {"clock_hz": 1e18}, r"clock_hz = 1e\+18 Hz ticks more than 2\^55 times in 1 s"),
            (
                {"X": 1.0, "Y": 1.0},
                {"clock_hz": 1e5},
                r"clock_hz = 100000\.0 Hz must be at least 200000 Hz, 1 / \(pulse",
            ),
            ({"X": 1.0, "Y": 1.0}, {"pulse": -1e-6}, r"pulse = -1e-06 s must be >= 0 and finite"),
            ({"X": 1.0, "Y": 1.0}, {"setup": np.nan}, "setup = nan s must be >= 0"),
            ({"X": 1.0, "Y": 1.0}, {"pulse": 0.0, "space": 0.0}, "pulse . space = 0 s leaves no time"),
            ({"X": 1e16, "Y": 1.0}, {}, r"steps of X = 1e\+16 make 1e\+17 steps of its way; at most 2\^52"),
        ],
    )
    def test_what_is_wrong_is_named(self, steps, named, message):
        with pytest.raises(InputError, match=message):
            everything(self.PROFILE, StepDriver(steps, **named))

    def test_too_high_a_degree(self):
        points = np.linspace([0.0, 0.0], [1.0, 1.0], 41)
        with pytest.raises(InputError, match="its pieces are of degree 40; pulses are found up to degree 31"):
            everything(rest_to_rest(points), StepDriver({"X": 1.0, "Y": 1.0}))


def random_plan(seed):
    """A spline of any degree and weights, run through by any forward law; None where the law would fall back."""
    rng = np.random.default_rng(seed)
    degree, inner, nodes = (int(rng.integers(*ends)) for ends in ((1, 8), (0, 4), (2, 30)))
    count = degree + 1 + inner
    knots = np.concatenate([np.zeros(degree + 1), np.sort(rng.uniform(0.1, 0.9, inner)), np.ones(degree + 1)])
    points = rng.normal(size=(count, 2)) * 10.0 ** rng.uniform(-2.0, 2.0)
    if rng.random() < 0.3:
        points[:, 1] = 0.5  # at rest, halfway between two steps; X then only goes on
        points[:, 0].sort()
    weights = rng.uniform(0.2, 5.0, count) if rng.random() < 0.5 else None
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 0.1, nodes - 1))])
    u = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, nodes - 1))])
    u /= u[-1]
    rate = np.concatenate([[0.0], (u[2:] - u[:-2]) / (t[2:] - t[:-2]), [0.0]]) if nodes > 2 else np.zeros(2)
    law = TimeLaw(t, u, rate, np.zeros(nodes))
    if law.at(np.linspace(0.0, t[-1], 100 * nodes))[1].min() < 0.0:
        return None
    curve = NurbsCurve(points, knots, degree, weights, name="random")
    steps = {"X": float(10.0 ** rng.uniform(0.0, 3.0)), "Y": float(rng.choice([1.0, 2.0, 10.0, 333.3]))}
    return make_profile(curve, LOOSE, law, method=""), StepDriver(steps, PICO, pulse=1e-12, space=1e-12, setup=1e-9)


def test_random_plans():
    """The counter is within half a step just before and after each pulse, and in between."""
    tried = found = 0
    for seed in range(100):
        made = random_plan(seed)
        if made is None:
            continue
        tried += 1
        profile, driver = made
        summary = PulseSummary()
        blocks = list(step_pulses(profile, driver, summary))
        for j, steps in enumerate(driver.steps_of(profile.curve.axes)):
            own = np.concatenate([np.empty(0), *(block.tick[block.axis == j] / PICO for block in blocks)])
            up = np.concatenate([np.empty(0, dtype=bool), *(block.up[block.axis == j] for block in blocks)])
            counts = first_counts(profile, driver)[j] + np.concatenate([[0], np.cumsum(np.where(up, 1, -1))])
            near = np.concatenate([np.linspace(0.0, profile.duration, 2000), own - 1e-11, own + 1e-11])
            near = np.clip(near, 0.0, profile.duration)
            states = profile.at(near)
            d = profile.curve.derivatives(states.u, 1)[..., j]
            off = np.abs(steps * d[0] - counts[np.searchsorted(own, near, side="right")])
            slack = 1e-6 + 2e-11 * steps * np.abs(d[1] * states.u_rate)
            assert (off <= summary.error_steps + slack).all(), f"seed {seed}, axis {j}"
            found += own.size
    assert tried > 40
    assert found > 10_000
