"""Curves, limits and sections that several tests of certificates share."""

from __future__ import annotations

import numpy as np

from planner import load_curve, load_limits
from planner.geometry.nurbs import NurbsCurve
from planner.machine.limits import Limits
from planner.verify.certificate import _SectionOnCurve
from planner.verify.places import Places

L, V, A, J = 100.0, 120.0, 1000.0, 2e4
INF = [np.inf, np.inf]


def section_of(curve, limits, certificate, k):
    return _SectionOnCurve.of(curve, limits, certificate, k, Places.of(curve))


def tangential(velocity=V, acceleration=A, jerk=J):
    return Limits(velocity, INF, INF, INF, tangential_acceleration=acceleration, tangential_jerk=jerk)


def limits_for(name):
    curve = load_curve(name)
    limits = load_limits("five-axis" if name == "flank" else "mill").for_curve(curve)
    return curve, Limits(
        limits.feed,
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        limits.chord_error,
        limits.period,
        900.0,
        15000.0,
        axes=limits.axes,
    )


def bends(axes=("X", "Y")):
    """A quadratic B-spline: the tangent is continuous, the curvature jumps at every knot."""
    points = [[0.0, 0.0], [30.0, 0.0], [50.0, 20.0], [60.0, 60.0], [100.0, 60.0]]
    return NurbsCurve(points, [0.0, 0.0, 0.0, 40.0, 80.0, 120.0, 120.0, 120.0], 2, axes=axes, name="bends")
