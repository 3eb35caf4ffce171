"""The true chord error of a plan, and how much a section must slow down to keep it.

A solver sees the chord error as a feed limit, that of the osculating circle at each point.  Where the curvature changes
within one period, as at a near-cusp that is rounded by less than a period's way, the chord leaves the path by more.  So
the finished plan is measured as the check measures it, by the distance of the path from the chords of one period, and the
section in which it is too large is slowed down: on a circle the error goes with the square of the speed.  Such a place is
passed slowly anyway, but the whole section pays for it; the plan says so.

Most machines cannot get so far off at all: a position p(t) with |p''| <= A leaves the chord of a period T by at most
A T^2 / 8, whatever the path, and where that is well below what is allowed nothing is measured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.geometry.chord import distance_to_chord
from planner.geometry.curve import Curve
from planner.law import TimeLaw
from planner.machine.feed_limits import largest_chord_error
from planner.machine.limits import Limits
from planner.types import FloatArray
from planner.verify.chords import CHORD_PARTS, profile_chord
from planner.verify.motion import Motion, Quintics
from planner.verify.scan import scan_spans
from planner.verify.sizes import position_rounding

MET_CHORD = 1.0 + 2e-7
_MAX_PASSES = 24  # of one section
_MAX_STEP = 3.0  # of the slowing down in one pass
_BEYOND = 1e-6
_MAX_POINTS = 1_000_000
_POINTS = 24  # of an interval, as many as the check has
# Of the acceleration limits: a section that may be slowed down keeps them, but for a millionth.
_ROOM = 2.0


def chord_shares(curve: Curve, limits: Limits, law: TimeLaw) -> tuple[FloatArray, FloatArray]:
    """Largest share of the chord error's limit by chords of one period around each time: times (m,), shares (m,).

    Chords begin at every 16th of a period and are looked at there, of a plan of very many periods at fewer; all are raised
    until the largest is that of every phase.
    """
    tip, (u0, u1) = curve.tip, curve.domain
    period = min(limits.period, float(law.t[-1]))
    part = max(period / CHORD_PARTS, float(law.t[-1]) / _MAX_POINTS)
    parts = max(1, round(period / part))
    times = part * np.arange(int(np.ceil(law.t[-1] / part)) + 1)
    u = law.at(np.minimum(times, law.t[-1]))[0]
    points = tip.derivatives(np.clip(u, u0, u1), 0)[0]
    windows = np.lib.stride_tricks.sliding_window_view(points, parts + 1, axis=0)  # (m - parts, dim, parts + 1)
    begin, end = windows[..., 0], windows[..., -1]
    height = np.zeros(begin.shape[0])
    for k in range(1, parts):  # one by one, which bounds the memory
        height = np.maximum(height, distance_to_chord(windows[:, None, :, k], begin, end)[:, 0])
    shares = height / limits.chord_error
    worst = highest_chord(curve, limits, law)[0] / limits.chord_error
    shares *= max(1.0, worst / float(shares.max(initial=worst)))
    padded = np.pad(shares, parts, constant_values=0.0)
    covering = np.lib.stride_tricks.sliding_window_view(padded, parts + 1).max(axis=1)
    return np.asarray(times[: covering.size], dtype=np.float64), np.asarray(covering[: times.size], dtype=np.float64)


def highest_chord(curve: Curve, limits: Limits, law: TimeLaw) -> tuple[float, tuple[float, float]]:
    """Largest distance of the path from a chord of one period, mm, and where it is, as the check measures it."""
    motion, rounding = Motion.of(curve, Quintics.of(law)), position_rounding(curve, np.clip(law.u, *curve.domain))
    return profile_chord(motion, scan_spans(motion, _POINTS), limits.period, rounding)


def slowed_for_chords(curve: Curve, limits: Limits, parts: list[TimeLaw], may_slow: NDArray[np.bool_]) -> FloatArray:
    """Factors (k,) by which the sections of a plan have to be slowed down until its true chord error is kept.

    Parameters
    ----------
    curve : Curve
    limits : Limits
    parts : list of TimeLaw
        The sections in their order.
    may_slow : (k,) bool array
        Sections without a prescribed feed; where the error is in another one, nothing more can be done.
    """
    factors = np.ones(len(parts))
    if _ROOM * largest_chord_error(curve, limits) <= limits.chord_error:
        return factors
    passes = np.zeros(len(parts), dtype=np.intp)
    while passes.max() < _MAX_PASSES:
        law = TimeLaw.joined([part.dilated(factor) for part, factor in zip(parts, factors, strict=True)])
        worst, (t, _) = highest_chord(curve, limits, law)
        share = worst / limits.chord_error
        # A chord may begin in one section and end in the next.
        ends = np.cumsum([factor * part.t[-1] for part, factor in zip(parts, factors, strict=True)])[:-1]
        first, last = np.searchsorted(ends, [t - limits.period, t + limits.period])
        at = np.arange(first, last + 1)
        if share <= MET_CHORD or not may_slow[at].all():
            break
        passes[at] += 1
        factors[at] *= min(np.sqrt(share), _MAX_STEP) * (1.0 + _BEYOND)
    return factors
