"""The value of multipliers: the identity behind it, and that no multipliers prove more than a plan takes."""

from __future__ import annotations

import numpy as np
import pytest
from cases import MILL
from problems import knotted

from planner import (
    Limits,
    load_curve,
    plan_feedrate,
)
from planner.geometry.nurbs import NurbsCurve
from planner.plan.dual.problem import Pace, best_splines
from planner.plan.dual.terms import Multiplied, Track
from planner.plan.dual.value import Splines, _sides, integrand, normalised, value


def track_of(curve, limits, intervals, **options):
    section, guess, grid = knotted(curve, limits, intervals, **options)
    return Track.on(section, limits, grid), guess


def random_splines(track, rng, load=0.3, pace=1e-3):
    of, knots = Multiplied.of(track.limits, track.section.curve), track.sigma.size
    smooth = np.ones(9) / 9.0

    def rows(count, size, scale):
        noise = rng.normal(0.0, scale, (count, size))
        return np.array([np.convolve(row, smooth, "same") for row in noise]).reshape(count, size)

    return Splines(track, of, rows(of.jerk.size, knots + 1, load), rows(of.acceleration.size, knots, pace))


def test_time_of_any_motion_is_what_the_multipliers_say_of_it():
    """int l q_ddd / J dt + int m q_dd / A dsigma, from third derivatives, is int g x dsigma + G x + ends, without them."""
    knots = [0, 0, 0, 0, 0, 0.3, 0.3, 0.55, 1, 1, 1, 1, 1]  # degree 4: the third derivative jumps at 0.3
    points = [[0, 0], [10, 3], [20, -4], [25, 6], [31, 1], [40, 9], [50, 4], [60, 0]]
    curve = NurbsCurve(points, knots, 4)
    limits = Limits(100.0, [np.inf] * 2, [1000.0, 700.0], [20000.0, 30000.0])
    track, _ = track_of(curve, limits, 60, start=20.0, end=20.0)
    assert np.count_nonzero(track.h == 0.0) == 2
    splines = random_splines(track, np.random.default_rng(4))
    of, full = splines.of, track.full
    nodes, weights = np.polynomial.legendre.leggauss(12)
    r, k = np.tile(0.5 * (nodes + 1.0), full.size), np.repeat(full, nodes.size)
    sigma, step = track.sigma[k] + r * track.h[k], np.tile(0.5 * weights, full.size) * track.h[k]

    def motion(s):
        return 3.0 + np.sin(9.0 * s), 4.5 * np.cos(9.0 * s), -40.5 * np.sin(9.0 * s)  # x, x'/2, x''/2

    x, a, c = motion(sigma)
    q = np.moveaxis(curve.derivatives(curve.domain[0] + sigma, 3), -1, 1)  # u is sigma here
    acceleration = q[2] * x + q[1] * a
    jerk = q[3] * x**1.5 + (3.0 * q[2] * a + q[1] * c) * np.sqrt(x)
    controls = splines.controls[:, :, k]
    load = (1.0 - r) ** 2 * controls[0] + 2.0 * r * (1.0 - r) * controls[1] + r**2 * controls[2]
    m = (1.0 - r) * splines.acceleration[:, k] + r * splines.acceleration[:, k + 1]
    by_rates = np.sum(step / np.sqrt(x) * np.sum(load * jerk / of.most_jerk[:, None], axis=0))
    by_rates += np.sum(step * np.sum(m * acceleration / of.most_acceleration[:, None], axis=0))

    _, g, _ = integrand(splines, k, r)
    without = np.sum(step * g * x)
    empty = np.flatnonzero(track.h == 0.0)
    pull = _sides(splines, empty - 1, 1).pull - _sides(splines, empty + 1, 0).pull
    without += np.sum(pull * motion(track.sigma[empty])[0])
    for end, cell, sign in ((0, full[[0]], -1.0), (1, full[[-1]], 1.0)):
        side, (xe, ae, _) = _sides(splines, cell, end), motion(track.sigma[[0, -1][end]])
        without += sign * (side.pull[0] * xe + side.load[:, 0] @ (side.at.second[:, 0] * xe + side.at.first[:, 0] * ae))
    assert without == pytest.approx(by_rates, rel=1e-9, abs=1e-11)
    assert abs(by_rates) > 1e-3  # what is compared is not 0


@pytest.mark.parametrize("seed", range(6))
def test_no_multipliers_prove_more_than_a_plan_takes(seed):
    rng = np.random.default_rng(seed)
    curve = load_curve("butterfly", scale=10.0)
    track, guess = track_of(curve, MILL, 200)
    planned = plan_feedrate(curve, MILL).duration
    wild, load = normalised(random_splines(track, rng, load=float(rng.uniform(0.1, 5.0))))
    assert normalised(wild)[1].max() <= 1.0
    assert value(wild)[0] <= planned
    # near the best ones too, where a wrong term would show
    found, best = best_splines(track, Pace(guess.u, guess.time), periodic=False)
    bent = Splines(track, best.of, best.jerk * rng.uniform(0.98, 1.0, best.jerk.shape), best.acceleration)
    assert value(bent)[0] <= found + 1e-9 <= planned
    assert load.max() > 0.0
