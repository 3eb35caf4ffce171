"""Derivatives of a curve turned into others: by the time, by the arc length, of its speed; its curvature.

Everything follows from the chain rule for q(u(t)) and from s' = |C'|, the speed of the curve in u.  The formulas stand here
once, for the planner and for its check; ``tests/geometry/test_differential.py`` holds each to numbers of many digits.
Compiled code takes them from ``differential_inline.h``.

Shapes: ``d (k, ..., dim)`` holds the derivatives 0..k-1 with respect to u; dots are taken over the last axis.
"""

from __future__ import annotations

import numpy as np

from planner.types import FloatArray

Triple = tuple[FloatArray, FloatArray, FloatArray]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products along the last axis, on one thread: BLAS wakes its others for long vectors and gains nothing."""
    return np.asarray(np.einsum("...j,...j->...", a, b))


def norm(a: FloatArray) -> FloatArray:
    """Lengths along the last axis."""
    return np.asarray(np.sqrt(dot(a, a)))


def chain_rule(
    q1: FloatArray, q2: FloatArray, q3: FloatArray, u1: FloatArray, u2: FloatArray, u3: FloatArray
) -> Triple:
    """First three derivatives of q(u(t)) with respect to t: velocity, acceleration and jerk.

        v = q' u',   a = q'' u'^2 + q' u'',   j = q''' u'^3 + 3 q'' u' u'' + q' u'''

    Parameters
    ----------
    q1, q2, q3 : arrays
        First three derivatives of q with respect to u.
    u1, u2, u3 : arrays
        First three derivatives of u with respect to t, of shapes that broadcast with those.
    """
    return q1 * u1, q2 * u1**2 + q1 * u2, q3 * u1**3 + 3.0 * q2 * u1 * u2 + q1 * u3


def acceleration_terms(q1: FloatArray, q2: FloatArray) -> FloatArray:
    """Coefficients (2, ...) of x and x'/2 in an acceleration, where x(u) is the square of the rate of u.

    With u'^2 = x and u'' = x'/2 the chain rule is a = q'' x + q' x'/2: linear.
    """
    return np.stack([q2, q1])


def jerk_terms(q1: FloatArray, q2: FloatArray, q3: FloatArray) -> FloatArray:
    """Coefficients (3, ...) of x, x'/2 and x''/2 in a jerk over sqrt(x), where x(u) is the square of the rate of u.

    With u'^2 = x, u'' = x'/2 and u''' = sqrt(x) x''/2 the chain rule is j = sqrt(x) (q''' x + 3 q'' x'/2 + q' x''/2).
    """
    return np.stack([q3, 3.0 * q2, q1])


def speed_derivatives(d: FloatArray) -> Triple:
    """|C'| and its first two derivatives with respect to u, (...,); 0 where the curve rests.

    |C'|' = C'.C''/|C'|,   |C'|'' = (|C''|^2 + C'.C''' - |C'|'^2) / |C'|.
    """
    speed = norm(d[1])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = np.where(speed > 0.0, dot(d[1], d[2]) / speed, 0.0)
        bend = dot(d[2], d[2]) + dot(d[1], d[3]) - slope**2
        bend = np.where(speed > 0.0, bend / speed, 0.0)
    return speed, slope, bend


def rates_along(d: FloatArray, u1: FloatArray, u2: FloatArray, u3: FloatArray) -> Triple:
    """First three time derivatives of the arc length of a curve, (...,), from those of u."""
    s1, s2, s3 = speed_derivatives(d)
    # The chain rule, its terms summed from the other end: by ``chain_rule`` the last digits of every plan would differ.
    return s1 * u1, s1 * u2 + s2 * u1**2, s1 * u3 + 3.0 * s2 * u1 * u2 + s3 * u1**3


def rates_of_parameter(speeds: Triple, v: FloatArray, a: FloatArray, j: FloatArray) -> Triple:
    """First three time derivatives of u from those v, a, j of the arc length: the chain rule the other way round.

    ``speeds``: |C'| and its first two derivatives with respect to u.
    """
    speed, slope, bend = speeds
    u1 = v / speed
    u2 = (a - slope * u1**2) / speed
    return u1, u2, (j - 3.0 * slope * u1 * u2 - bend * u1**3) / speed


def inverse_derivatives(speeds: Triple) -> Triple:
    """First three derivatives of u with respect to the arc length, from |C'| and its first two derivatives."""
    speed, slope, bend = speeds
    return 1.0 / speed, -slope / speed**3, (3.0 * slope**2 - speed * bend) / speed**5


def along_length(q: FloatArray, speeds: Triple) -> Triple:
    """First three derivatives of q with respect to an arc length, (..., dim).

    With v = |C'| and its derivatives v', v'' in ``speeds (...,)``,

        q_s = q'/v,   q_ss = (q'' - v' q_s)/v^2,   q_sss = (q''' - 3 v v' q_ss - v'' q_s)/v^3.
    """
    v, v1, v2 = (part[..., None] for part in speeds)
    first = q[1] / v
    second = (q[2] - v1 * first) / v**2
    return first, second, (q[3] - 3.0 * v * v1 * second - v2 * first) / v**3


def arc_derivatives(d: FloatArray) -> FloatArray:
    """Derivatives 0..3 of a curve with respect to its arc length, (4, ..., dim), where |C'| > 0."""
    return np.stack([d[0], *along_length(d, speed_derivatives(d))])


def curvature_vector(d: FloatArray, of: FloatArray | None = None) -> FloatArray:
    """Second derivative with respect to the arc length, (..., dim), from two derivatives; ``of`` another curve's length.

    q_ss = (q'' - q' (C'.C''/|C'|^2)) / |C'|^2
    """
    path = d if of is None else of
    speed2 = dot(path[1], path[1])[..., None]
    return np.asarray((d[2] - d[1] * (dot(path[1], path[2])[..., None] / speed2)) / speed2)


def curvature(d: FloatArray) -> FloatArray:
    """Curvature from the derivatives d (3 or more, ..., dim) with respect to u; 0 where the curve rests."""
    speed2 = dot(d[1], d[1])
    # |C'|^2 |C''|^2 - (C'.C'')^2 cancels; the normal part of C'' does not.
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = d[2] - (dot(d[1], d[2]) / speed2)[..., None] * d[1]
        kappa = np.sqrt(dot(normal, normal)) / speed2
    return np.where(speed2 > 0.0, kappa, 0.0)
