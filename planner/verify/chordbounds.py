"""What no chord of a period can be left by further, from what the scan found at the points of each span.

A function is off its linear interpolation over T by T^2 / 8 times its second derivative at most, by T / 4 times a step of
the first, and by a step of its own.  Of a path only what is across the chord counts: all of the acceleration across the
path, and of that along it the sine of the angle by which the direction turns within the period, if it is no right angle.
"""

from __future__ import annotations

import numpy as np

from planner.compiled import core
from planner.types import FloatArray
from planner.verify.motion import Motion
from planner.verify.scan import Scan


def chord_bounds(motion: Motion, scan: Scan, period: float, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Bound the distance, but for rounding, mm, of the tip's path from its chords of a period within windows of time, (n,).

    Both ends of the windows increase.
    """
    every, tip = np.arange(motion.interval.size), motion.curve.tip
    time = np.stack([motion.time(every, motion.lower), motion.time(every, motion.upper)])
    work, queue = np.empty(5 * every.size + 3), np.empty(2 * every.size, dtype=np.intp)
    bound = np.empty(begin.size)
    of_spans = every.size, tip.dim, scan.density, tip is motion.curve, time, scan.course
    core.chord_bounds(*of_spans, period, begin.size, begin, end, bound, work, queue)
    return bound
