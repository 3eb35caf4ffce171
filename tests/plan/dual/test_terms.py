"""The compiled path of a lower bound agrees with formulas over whole arrays, on every kind of section and limit."""

from __future__ import annotations

import numpy as np
import pytest
import track_reference as reference
from cases import MILL, PROJECT, drives
from plan.dual.test_value import random_splines
from problems import knotted

from planner import Limits, load_curve, load_limits, read_program
from planner.plan.dual.terms import Track
from planner.plan.dual.value import integrand, min_price
from planner.programs.path.smooth_path import program_path

INF = np.inf


def tangential():
    return Limits(
        100.0,
        [250.0] * 2,
        [1000.0] * 2,
        [20000.0] * 2,
        chord_error=1e-3,
        tangential_acceleration=800.0,
        tangential_jerk=9e3,
    )


def slots():
    path = program_path(read_program(PROJECT / "tests/data/programs/slots.ngc"), 0.01, load_limits("mill"))
    return path.curve, load_limits("mill").for_curve(path.curve)


TRACKS = {
    "rest": lambda: (load_curve("teardrop"), MILL, 60),
    "chord error, tangential": lambda: (load_curve("butterfly", scale=10.0), tangential(), 200),
    "feeds at the ends": lambda: (load_curve("butterfly-nurbs"), drives(250.0), 200, {"start": 30.0, "end": 60.0}),
    "a curvature jump": lambda: (load_curve("circle"), MILL, 60),
    "rotary": lambda: (load_curve("flank"), load_limits("five-axis"), 200),
    "no acceleration limits": lambda: (load_curve("teardrop"), Limits(50.0, [INF] * 2, [INF] * 2, [2e4] * 2), 60),
    "closed": lambda: (load_curve("circle"), MILL, 60, {"periodic": True}),
    "commanded feeds": lambda: (*slots(), 400),
}


@pytest.fixture(scope="module", params=TRACKS)
def track(request):
    curve, limits, intervals, *options = TRACKS[request.param]()
    section, _, grid = knotted(curve, limits, intervals, **(options[0] if options else {}))
    return Track.on(section, limits, grid)


def places(track, seed=0):
    """Points of every cell, at both ends too."""
    rng, count = np.random.default_rng(seed), track.full.size
    r = np.column_stack([np.zeros(count), rng.random((count, 3)), np.ones(count)])
    return np.repeat(track.full, 5), r.reshape(-1)


def agree(found, expected, digits=1e-11):
    """Up to rounding of the largest number; where one is infinite, both are."""
    finite = np.isfinite(expected)
    assert np.array_equal(np.isfinite(found), finite)
    size = np.abs(expected[finite]).max(initial=0.0)
    np.testing.assert_allclose(found[finite], expected[finite], rtol=digits, atol=digits * size)


def test_points(track):
    k, r = places(track)
    with np.errstate(all="ignore"):
        first, second, cap = reference.points(track, k, r)
        at = track.points(k, r)
    agree(at.first, first)
    agree(at.second, second)
    finite = np.isfinite(cap)
    assert np.array_equal(np.isfinite(at.cap), finite)
    np.testing.assert_allclose(at.cap[finite], cap[finite], rtol=1e-9)


def test_integrand(track):
    k, r = places(track, 1)
    splines = random_splines(track, np.random.default_rng(2))
    with np.errstate(all="ignore"):
        first, second, cap = reference.points(track, k, r)
        weight, pull = reference.weight_and_pull(splines, first, second, k, r)
        found = integrand(splines, k, r)
    agree(found[0], weight)
    agree(found[1], pull, 1e-10)
    np.testing.assert_array_equal(np.isfinite(found[2]), np.isfinite(cap))


def test_smallest_price():
    rng = np.random.default_rng(3)
    w = rng.choice([0.0, -0.1, 1e-9, 0.5, 1.0], 4000)
    g = rng.choice([0.0, 1.0, -1.0], 4000) * 10.0 ** rng.uniform(-6, 6, 4000)
    cap = rng.choice([0.0, 1e-9, 1.0, 1e6, INF], 4000)
    with np.errstate(all="ignore"):
        expected = reference.min_price(w, g, cap)
    np.testing.assert_allclose(min_price(w, g, cap), expected, rtol=1e-14, equal_nan=True)
    finite = np.isfinite(cap) & (cap > 0.0)
    x = cap[finite, None] * np.linspace(1e-3, 1.0, 300)  # no other x is cheaper
    others = np.maximum(w[finite, None], 0.0) / np.sqrt(x) + g[finite, None] * x
    assert (expected[finite] <= others.min(axis=1) + 1e-12 * np.abs(others).max(axis=1)).all()
