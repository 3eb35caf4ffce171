"""The true chord error of a plan, and how much a section must slow down to keep it.

A solver sees the chord error as a feed limit, that of the osculating circle at each point.  Where the curvature changes
within one period, as at a near-cusp that is rounded by less than a period's way, the chord leaves the path by more.  So
the finished plan is measured as the check measures it, by the distance of the path from the chords of one period, and the
section in which it is too large is slowed down: on a circle the error goes with the square of the speed.  Such a place is
passed slowly anyway, but the whole section pays for it; the plan says so.
"""

from __future__ import annotations

import numpy as np

from planner.check.chords import profile_chord
from planner.check.motion import Motion, TimeLaw
from planner.geometry.curve import Curve, FloatArray
from planner.law import TimeNodes, joined
from planner.limits import Limits

_MET = 1.0 + 2e-7
_MOST_PASSES = 24
_LARGEST_STEP = 3.0  # of the slowing down in one pass
_BEYOND = 1e-6


def slowed_for_chords(curve: Curve, limits: Limits, parts: list[TimeNodes], may_slow: list[bool]) -> FloatArray:
    """Factors (k,) by which the sections of a plan have to be slowed down until its true chord error is kept.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    parts : list of TimeNodes
        The sections in their order.
    may_slow : list of bool
        Sections without a prescribed feed; where the error is in another one, nothing more can be done.
    """
    factors = np.ones(len(parts))
    if np.isinf(limits.chord_error):
        return factors
    ends = np.array([part.u[-1] for part in parts])
    for _ in range(_MOST_PASSES):
        nodes = joined([part.dilated(factor) for part, factor in zip(parts, factors, strict=True)])
        worst, (_, u) = profile_chord(Motion.of(curve, TimeLaw.of(nodes)), limits.period)
        share = worst / limits.chord_error
        at = min(int(np.searchsorted(ends, u)), len(parts) - 1)
        if share <= _MET or not may_slow[at]:
            break
        factors[at] *= min(np.sqrt(share), _LARGEST_STEP) * (1.0 + _BEYOND)
    return factors
