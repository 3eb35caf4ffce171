"""The formulas of ``differential.py`` and ``chord.py`` at one point, for compiled code, which inlines them."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(forceinline=True, error_model="numpy")
def chain_rule(q1, q2, q3, u1, u2, u3):
    """First three derivatives of q(u(t)) with respect to t."""
    return q1 * u1, q2 * (u1 * u1) + q1 * u2, q3 * (u1 * u1 * u1) + q2 * (3.0 * u1 * u2) + q1 * u3


@njit(forceinline=True, error_model="numpy")
def speed_derivatives(square, along, bend):
    """|C'| > 0 and its first two derivatives with respect to u, from |C'|^2, C'.C'' and |C''|^2 + C'.C'''."""
    speed = np.sqrt(square)
    slope = along / speed
    return speed, slope, (bend - slope * slope) / speed


@njit(forceinline=True, error_model="numpy")
def rates_along(s1, s2, s3, u1, u2, u3):
    """First three time derivatives of an arc length, given |C'| and its first two derivatives, from those of u."""
    return s1 * u1, s1 * u2 + s2 * (u1 * u1), s1 * u3 + s2 * (3.0 * u1 * u2) + s3 * (u1 * u1 * u1)


@njit(forceinline=True, error_model="numpy")
def rates_of_parameter(speed, slope, bend, v, a, j):
    """First three time derivatives of u from those of the arc length, given |C'| and its first two derivatives."""
    u1 = v / speed
    u2 = (a - slope * u1 * u1) / speed
    return u1, u2, (j - 3.0 * slope * u1 * u2 - bend * u1 * u1 * u1) / speed


@njit(forceinline=True, error_model="numpy")
def half_chord(radius, error):
    """Half the length of the chord that leaves a circle by an error, as in ``chord.py``."""
    sagitta = min(error, radius)
    return np.sqrt(sagitta * (2.0 * radius - sagitta))
