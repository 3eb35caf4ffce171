"""The benchmarks of the literature's interpolators: what their tables say, on a few of their runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import drives
from motions import plan_along, scurve

from benchmarks import classics
from benchmarks import replay as forms
from interp import interpolate_adaptive, replay_form
from interp.literature.lookahead import PAPER_LIMITS
from planner import load_curve


@pytest.fixture(scope="module")
def plan():
    curve = load_curve("circle")
    limits = drives()
    return curve, limits, plan_along(curve, scurve(curve.length, 100.0, 800.0, 14000.0))


def test_before_the_look_ahead_the_limit_is_exceeded_and_after_it_is_not():
    curve = load_curve("butterfly-nurbs")
    rows = [
        classics.look_ahead_row(form, curve, PAPER_LIMITS, interpolate_adaptive(curve, PAPER_LIMITS, **options), 0.0)
        for form, options in (
            ("before", {"look_ahead": False}),
            ("printed", {}),
            ("uniform", {"rule": "uniform", "order": 2}),
        )
    ]
    assert rows[0].acceleration_ratio > 1.5
    assert rows[0].acceleration_exceeded == 7
    for row in rows[1:]:
        assert row.acceleration_ratio <= 1.0
        assert row.acceleration_exceeded == 0
    assert rows[1].normal_ratio > 5.0
    assert rows[2].normal_ratio < 1.2


def test_step_times_are_listed_beside_the_published_ones(monkeypatch):
    monkeypatch.setattr(classics, "REPEATS", 1)
    monkeypatch.setattr(classics, "STEPS_PER_REPEAT", 1)
    rows, servo = classics.step_times(load_curve("circle"))
    assert [row.published_us for row in rows] == [540.0, 580.0, 600.0, 1020.0, 1040.0, 1140.0]
    assert all(0.0 < row.measured_ns < 1e5 for row in rows)
    assert servo > 0.0


def test_feed_errors_off_the_knot_leave_out_the_step_across_it(monkeypatch):
    monkeypatch.setattr(classics, "PERIODS", (2e-3,))
    rows = {(row.shape, row.order): row for row in classics.feed_errors(load_curve("circle"))}
    assert rows["bell", 2].against_mean == pytest.approx(0.1442, abs=1e-4)
    assert rows["bell", 2].off_the_knot < 0.003
    assert rows["trapezoid", 2].off_the_knot > 0.03


def test_fluctuation_by_place_does_not_count_the_drift_in_time(plan):
    curve, _, profile = plan
    samples = replay_form(curve, profile, "quintic", 1e-3)
    assert forms.fluctuation_by_place(curve, profile, samples) < 1e-6
    # the same motion some periods late, as if it had waited at the start
    late = replace(
        samples,
        t=1e-3 * np.arange(samples.t.size + 5),
        u=np.concatenate([np.zeros(5), samples.u]),
        position=np.concatenate([np.repeat(samples.position[:1], 5, axis=0), samples.position]),
    )
    assert forms.fluctuation_by_place(curve, profile, late) < 1e-6
    moved = samples.u.copy()
    moved[800] += 1e-5 * (moved[801] - moved[800])
    assert forms.fluctuation_by_place(curve, profile, replace(samples, u=moved)) == pytest.approx(1e-5, rel=0.1)


def test_faults_are_named_and_score_no_time(plan, monkeypatch):
    curve, limits, profile = plan
    samples = replay_form(curve, profile, "RK2", 1e-3)
    assert forms.faults(curve, samples) == ()
    position, u = samples.position.copy(), samples.u.copy()
    position[7, 0] += 1e-6
    assert forms.faults(curve, replace(samples, position=position)) == ("samples off the curve",)
    u[900] = u[903]
    found = forms.faults(curve, replace(samples, u=u, position=curve.derivatives(u, 0)[0]))
    assert found == ("parameter falls back",)
    monkeypatch.setattr(forms, "faults", lambda *_: ("planted",))
    monkeypatch.setattr(forms, "PHASES", 1)
    assert forms.measure("circle", curve, limits, profile, "RK2", 1e-3).step_ns is None


def test_the_worst_of_all_cases_is_told_apart_for_the_broken_curve(plan, monkeypatch):
    curve, limits, profile = plan
    monkeypatch.setattr(forms, "PHASES", 4)
    monkeypatch.setattr(forms, "REPEATS", 1)
    monkeypatch.setattr(forms, "STEPS_PER_REPEAT", 1)
    rows = [forms.measure("circle", curve, limits, profile, form, 1e-3) for form in ("Taylor 1", "chord", "quintic")]
    worst = forms.worst(rows)
    assert worst["Taylor 1"]["ratio_inside"] is None
    assert worst["Taylor 1"]["ratio_inside_circle"][2] > 5.0
    assert worst["chord"]["ratio_inside_circle"][2] < 1.01
    assert worst["quintic"]["ratio_end"][2] < 1.001
    assert worst["quintic"]["path_error_mm"] < 1e-10
    assert worst["chord"]["path_error_mm"] > 1e-5
    forms.table(worst, 1e-3)
