"""Where a chord error is no limit, whatever the plan: on paths that were found with their feed, on machines slow enough."""

from __future__ import annotations

import numpy as np

from planner.geometry.curve import Curve
from planner.machine.limits import Limits


def without_kept_chords(curve: Curve, limits: Limits) -> Limits:
    """The limits without a chord error that nobody can exceed on a path that was found with its feed.

    On the way from p to q in the time T a point is off the chord by less than a T^2 / 8, where a is the largest acceleration
    of the tool tip.  The feed of the osculating circle would ask for more where the path bends within the chord error.
    """
    if curve.timing is None:
        return limits
    linear = np.array([unit == "mm" for unit in curve.axis_units])
    most = float(np.sqrt(np.sum(limits.acceleration[linear] ** 2)))
    kept = 0.125 * most * limits.period**2 <= limits.chord_error
    return limits.without_chord_error() if kept else limits
