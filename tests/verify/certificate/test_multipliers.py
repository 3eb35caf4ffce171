"""Multipliers of a certificate: their loads and integrals, against dense sampling."""

from __future__ import annotations

import numpy as np
import pytest
from certificate_cases import limits_for, section_of
from certificates import pieces_of, smooth_certificate


def section_with(**options):
    curve, limits = limits_for("teardrop")
    return section_of(curve, limits, smooth_certificate(curve, seed=8, **options), 0)


def parts_ends(parts, stretches):
    """Larger of the loads at both ends of each part."""
    s = stretches
    return np.max([np.abs(parts.jerk_at(s.interval, r)[0]).sum(axis=0) for r in (s.lower, s.upper)], axis=0)


def test_the_largest_load_and_the_smallest_size():
    section = section_with(jerk=3.0, knots=6)
    s, parts = section.stretches, section.path.parts
    i, r, _ = pieces_of(section, 60)
    dense = np.abs(parts.jerk_at(i, r)[0])
    load = parts.largest_load(s.interval, s.lower, s.upper).reshape(-1)
    sampled = dense.sum(axis=0).reshape(load.size, -1).max(axis=1)
    assert np.all(load >= sampled - 1e-12)
    np.testing.assert_allclose(load, sampled, rtol=1e-2)
    inside = load > parts_ends(parts, s) + 1e-9  # the largest is within the part
    assert inside.any()


def test_the_integral_of_m():
    section = section_with(acceleration=1.0, knots=9)
    i, r, weight = pieces_of(section, 200)
    dense = np.sum(weight * np.abs(section.path.parts.acceleration_at(i, r)[0]).sum(axis=0))
    assert section.path.parts.acceleration_price() == pytest.approx(dense, rel=1e-4)
