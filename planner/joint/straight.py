"""The fastest motion along a straight line from rest to rest: seven phases of constant jerk.

With the limits V, A, J along the line the speed rises with jerk J, 0, -J to its top, is kept, and falls likewise.  Rising to
v takes T = 2 v / a + ... : the acceleration reaches a = min(A, sqrt(J v)), in the time a / J, is kept for v / a - a / J, and
falls again; the way is v T / 2.
"""

from __future__ import annotations

import numpy as np

from planner.types import FloatArray


def seven_phases(length: float, velocity: float, acceleration: float, jerk: float) -> tuple[FloatArray, FloatArray]:
    """Durations (7,) and jerks (7,) of the fastest motion along ``length`` from rest to rest; phases may have none.

    The top speed v satisfies v T(v) <= length, with T(v) = v / a + a / J the time of rising to it: where A is not reached
    v = (J length^2 / 4)^(1/3), else v (v / A + A / J) = length.
    """
    top = np.cbrt(jerk * length**2 / 4.0)
    if jerk * top > acceleration**2:
        rise = acceleration**2 / jerk  # the speed at which A is first reached, and gone from at once
        top = 0.5 * (np.sqrt(rise**2 + 4.0 * acceleration * length) - rise)
    top = min(top, velocity)
    most = min(acceleration, np.sqrt(jerk * top))
    growing, kept = most / jerk, max(top / most - most / jerk, 0.0)
    cruising = max(length / top - (2.0 * growing + kept), 0.0)
    durations = np.array([growing, kept, growing, cruising, growing, kept, growing])
    return durations, jerk * np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])


def reachable_acceleration(velocity: FloatArray, acceleration: FloatArray, jerk: FloatArray, feed: float) -> FloatArray:
    """The accelerations of the axes (d,) that a motion from rest to rest can have: their limits, or less at low speed.

    An axis whose speed stays within +-V gains 2 V at most while its acceleration rises from 0 to a and falls to 0 again,
    which takes a^2 / J: a^2 <= 2 V J.
    """
    return np.minimum(acceleration, np.sqrt(2.0 * np.minimum(velocity, feed) * jerk))


def along(durations: FloatArray, jerks: FloatArray, t: FloatArray) -> FloatArray:
    """Way, speed, acceleration and jerk (4, k) at the times t (k,) of phases from rest; later ones at the end."""
    ends = np.concatenate([[0.0], np.cumsum(durations)])
    states = np.zeros((durations.size + 1, 3))
    for k, (h, j) in enumerate(zip(durations, jerks, strict=True)):
        states[k + 1] = _moved(states[k], h, j)
    at = np.clip(np.searchsorted(ends, t, side="right") - 1, 0, durations.size - 1)
    moved = _moved(states[at].T, np.minimum(t, ends[-1]) - ends[at], jerks[at])
    return np.vstack([moved, jerks[None, at]])


def _moved(state: FloatArray, h: FloatArray, j: FloatArray) -> FloatArray:
    s, v, a = state
    return np.array([s + h * (v + h * (0.5 * a + h * (j / 6.0))), v + h * (a + 0.5 * h * j), a + h * j])
