"""Plans thinned out for drawing: peaks stay, and each stretch is drawn by its own side of the curve."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cases import drives
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import line_of_a_program, plan_along, scurve

from planner import Limits, Samples, load_curve
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.output.traces import trace_chord_error, trace_plan
from planner.profile import make_profile

FEED, ACCELERATION, JERK = 100.0, 1000.0, 20000.0
LIMITS = Limits(120.0, [250.0, 250.0], [1500.0, 2000.0], [25000.0, np.inf], chord_error=1e-3, period=2e-3)
CIRCLE = load_curve("circle")
RADIUS = 50.0
MOTION = scurve(CIRCLE.length, FEED, ACCELERATION, JERK)


@pytest.fixture(scope="module")
def profile():
    return plan_along(CIRCLE, MOTION, LIMITS)


class TestThinning:
    @pytest.mark.parametrize("most", [40, 333])
    def test_every_bucket_holds_the_plan_between_its_extremes(self, profile, most):
        traces = trace_plan(CIRCLE, LIMITS, profile, most)
        assert traces.thinned
        assert traces.t.size == most
        t = np.linspace(0.0, profile.duration, 20_001)
        states = profile.at(t)
        bucket = np.clip(np.searchsorted(traces.t, t, side="right") - 1, 0, most - 1)
        for name in ("feed", "acceleration", "jerk"):
            values = getattr(states, name)
            room = 0.02 * np.abs(values).max()  # what may happen between the points of an interval
            assert np.all(values >= traces.low[name][bucket] - room)
            assert np.all(values <= traces.high[name][bucket] + room)
            assert traces.high[name].max() == pytest.approx(values.max(), rel=2e-3)
            assert traces.low[name].min() == pytest.approx(values.min(), rel=2e-3, abs=1e-3)
        assert np.all(traces.low["feed"] <= traces.high["feed"])

    def test_one_short_peak_among_many_nodes_stays(self):
        times = np.linspace(0.0, MOTION.duration, 30_001)
        fine = plan_along(CIRCLE, MOTION, LIMITS, times)
        acceleration = fine.u_acceleration.copy()
        acceleration[12_345] *= 1.5  # one node of 30 001
        bent = make_profile(CIRCLE, LIMITS, TimeLaw(fine.t, fine.u, fine.u_rate, acceleration), method="bent")
        before, after = (trace_plan(CIRCLE, LIMITS, plan, 200) for plan in (fine, bent))
        changed = np.flatnonzero(after.high["jerk"] > 2.0 * JERK)
        assert changed.size == 1
        assert after.t[changed[0]] <= bent.t[12_345] <= after.t[changed[0] + 1]
        assert before.high["jerk"].max() < 1.01 * JERK

    def test_the_limit_that_binds_for_longest_names_the_bucket(self, profile):
        binding = np.array([0] * (profile.t.size - 60) + [1] * 50 + [2] * 10, dtype=np.int8)
        traces = trace_plan(CIRCLE, LIMITS, dataclasses.replace(profile, binding=binding), 12)
        middle = 0.5 * (profile.t[1:] + profile.t[:-1])
        start = np.concatenate([[0.0], middle])
        end = np.append(middle, profile.duration)
        for k in range(11):
            inside = np.minimum(end, traces.t[k + 1]) - np.maximum(start, traces.t[k])
            time = [inside[(binding == kind) & (inside > 0.0)].sum() for kind in range(3)]
            assert traces.binding[k] == int(np.argmax(time))

    @staticmethod
    def uneven_samples(seed):
        """Samples of the circle at random parameters: chords of up to 25 degrees, some over the joint of two pieces."""
        u = np.sort(np.random.default_rng(seed).uniform(*CIRCLE.domain, 200))
        u[0], u[-1] = CIRCLE.domain
        return Samples(1e-3, 1e-3 * np.arange(200), u, CIRCLE.derivatives(u, 0)[0])

    @pytest.mark.parametrize(
        "seeds", [range(0, 1001, 20), pytest.param(range(1001), marks=pytest.mark.slow)], ids=["some", "all"]
    )
    def test_chord_errors_are_those_of_the_closed_form(self, seeds):
        for seed in seeds:
            samples = self.uneven_samples(seed)
            angle = np.diff(CIRCLE.arclength.s(samples.u)) / RADIUS
            error = trace_chord_error(CIRCLE, samples, 1000).low["chord error"]
            assert error == pytest.approx(RADIUS * (1.0 - np.cos(0.5 * angle)), rel=2e-4, abs=1e-6), seed

    @settings(max_examples=20)
    @given(seed=st.integers(0, 1000), most=st.integers(2, 60))
    def test_chords_keep_their_extremes(self, seed, most):
        samples = self.uneven_samples(seed)
        whole, thin = trace_chord_error(CIRCLE, samples, 1000), trace_chord_error(CIRCLE, samples, most)
        error = whole.low["chord error"]
        bucket = np.clip(np.searchsorted(thin.t, whole.t, side="right") - 1, 0, most - 1)
        assert thin.t.size == most
        assert np.array_equal(np.unique(bucket), np.arange(most))
        for k in range(most):
            assert thin.low["chord error"][k] == error[bucket == k].min()
            assert thin.high["chord error"][k] == error[bucket == k].max()


class TestBreaks:
    """50 mm along X, then 50 along Y, with a stop in the corner; the jerk is full up to it and from it on."""

    CORNER = NurbsCurve([[0, 0], [50, 0], [50, 50]], [0, 0, 0.5, 1, 1], 1)

    def stop_in_the_corner(self, feed=60.0):
        half = scurve(50.0, feed, 500.0, 5000.0)
        s, v, a, _ = half(half.times)
        s[-1], v[-1], a[-1] = 50.0, 0.0, 0.0
        t = np.concatenate([half.times, half.duration + half.times])
        law = TimeLaw(t, np.concatenate([s, 50.0 + s]) / 100.0, np.tile(v, 2) / 100.0, np.tile(a, 2) / 100.0)
        limits = drives(200.0, 2, acceleration=1000.0, jerk=5000.0)
        return make_profile(self.CORNER, limits, law, method="by hand"), limits

    @pytest.mark.parametrize("most", [400_000, 301])
    def test_no_axis_moves_on_the_other_side_of_the_corner(self, most):
        """Where the path comes to rest, u meets the break by rounding while the last instant is still to come."""
        profile, limits = self.stop_in_the_corner()
        traces = trace_plan(self.CORNER, limits, profile, most)
        corner = 0.5 * profile.duration
        start, end = (traces.t, np.append(traces.t[1:], np.inf)) if traces.thinned else (traces.t, traces.t)
        for axis, other in ((0, "Y"), (1, "X")):
            side = end < corner if axis == 0 else start > corner
            assert side.sum() > 100
            for what in ("velocity", "acceleration", "jerk"):
                for values in (traces.low, traces.high):
                    assert np.all(values[f"{what} {other}"][side] == 0.0)
                    assert np.abs(values[f"{what} {'XY'[axis]}"][side]).max() < 1.0 + 1e-6
        jerk = traces.high["jerk X"][end < corner]
        assert jerk.max() == pytest.approx(1.0)
        assert jerk[-1] == pytest.approx(1.0)  # up to the corner


class TestPrograms:
    def test_f_words_and_rapids_at_every_point(self):
        profile, limits = line_of_a_program()
        traces = trace_plan(profile.curve, limits, profile, 400_000)
        assert not traces.thinned
        x = traces.position[:, 0]
        assert np.array_equal(traces.rapid, (traces.t > 5.0) & (traces.t < 5.5))
        wanted = np.where(traces.rapid, np.nan, np.where(x < 150.0, 20.0, 30.0))
        assert traces.low["programmed feed"] == pytest.approx(wanted, nan_ok=True)
        assert set(np.round(traces.low["feed"][traces.rapid], 3)) == {200.0}

    @pytest.mark.parametrize("most", [23, 96])
    def test_thinned_out_a_rapid_has_no_f_word(self, most):
        """Buckets that lie in the rapid alone have none, those that hold anything else have that of the rest."""
        profile, limits = line_of_a_program(parts=100)
        traces = trace_plan(profile.curve, limits, profile, most)
        assert traces.thinned
        start, end = traces.t[:-1], traces.t[1:]
        low, high = (side["programmed feed"][:-1] for side in (traces.low, traces.high))
        inside = (start > 5.0) & (end < 5.5)
        assert inside.sum() == {23: 0, 96: 3}[most]
        assert np.array_equal(np.isnan(low), inside)
        assert np.array_equal(np.isnan(high), inside)
        assert set(low[end < 5.0]) == set(high[end < 5.0]) == {20.0}
        assert set(low[start > 5.5]) == set(high[start > 5.5]) == {30.0}
        assert np.all(low[~inside] <= high[~inside])
