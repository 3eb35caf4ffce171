"""Certificates by closed form, for tests: the multipliers of the time-optimal straight line, in its own time."""

import numpy as np

from planner.certificate import Certificate, CertificateSection


def coefficients(knots, quadratics):
    """B-spline coefficients of a continuous piecewise quadratic, given as (value, slope, curvature) at interval starts."""
    h = np.diff(knots)
    start, slope, bend = np.array(quadratics, dtype=float).T
    end = start[-1] + slope[-1] * h[-1] + 0.5 * bend[-1] * h[-1] ** 2
    return np.concatenate([[start[0]], start + 0.5 * slope * h, [end]])


def line_section(length, velocity, acceleration, jerk):
    """Seven phases from rest to rest: jerk J for t1 = A / J, acceleration A until t2, jerk -J, velocity V, and back.

    The multipliers are those of Pontryagin's principle, with sigma = t: in the first phase l = 1 - b t + J/(2V) t^2, in
    the second l = 0 and m = 1 - v/V, in the third l = J/(2V) s (s - t1) at the time s before its end, then none.
    """
    t1 = acceleration / jerk
    t2 = velocity / acceleration
    t3 = t2 + t1
    total = length / velocity + t3
    assert t2 > t1, "the acceleration is not reached"
    assert total > 2.0 * t3, "the velocity is not reached"
    phases = np.array([0.0, t1, t2, t3])
    whole = np.concatenate([phases, total - phases[::-1]])
    v1 = 0.5 * acceleration * t1
    at = {
        0: (0.0, 0.0, 0.0),
        1: (v1 * t1 / 3.0, v1, acceleration),
        2: (v1 * t1 / 3.0 + 0.5 * velocity * (t2 - t1), velocity - v1, acceleration),
        3: (0.5 * velocity * t3, velocity, 0.0),
    }
    u = np.array([at[k] for k in range(4)] + [(length - at[k][0], at[k][1], -at[k][2]) for k in (3, 2, 1, 0)]).T
    b = (1.0 + v1 / velocity) / t1
    bend = jerk / velocity
    pieces = [(1.0, -b, bend), (0.0, 0.0, 0.0), (0.0, -0.5 * bend * t1, bend), (0.0, 0.0, 0.0)]
    pieces += [(0.0, -0.5 * bend * t1, bend), (0.0, 0.0, 0.0), (0.0, b - bend * t1, bend)]
    m1, m2 = 1.0 - v1 / velocity, v1 / velocity
    left = np.array([0.0, 0.0, m2, 0.0, 0.0, 0.0, -m1, 0.0])
    right = np.array([0.0, m1, 0.0, 0.0, 0.0, -m2, 0.0, 0.0])
    # Every inner knot is double: l has a kink there, and m jumps.
    twice = np.array([0, *np.repeat(np.arange(1, 7), 2), 7])
    sigma = whole[twice]
    some = []
    for k in range(7):
        some += [pieces[k], (0.0, 0.0, 0.0)]
    row = coefficients(sigma, some[:-1])
    # the coefficient of an empty interval is the value there, which is 0 at every double knot of these
    m = np.array([right[0], *np.stack([left[1:7], right[1:7]], axis=1).reshape(-1), left[7]])
    return CertificateSection(sigma, u[:, twice], row[None], m[None], 0.0, 0.0, np.nan), total


def line_certificate(curve, length, velocity, acceleration, jerk):
    section, total = line_section(length, velocity, acceleration, jerk)
    return Certificate((section,), ("jerk X",), ("acceleration X",), total, curve.fingerprint, periodic=False)
