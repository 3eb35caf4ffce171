"""The rule for curvature jumps: how fast one is passed, and what jerk is left to the plan beside it.

Where the curvature jumps, a feed v makes the acceleration of an axis step by D = |dk| v^2.  No plan can help that but by
slowing down, and no step is a jerk until it is sampled: a unit step, sampled and differenced three times, is a quadratic
B-spline of its phase, with a peak of 3/4 over the period T and a support of three periods, one and a half on either side.

1. The step may make half of the jerk limit J that samples see:  3/4 D / T <= J / 2,  so  D <= 2/3 J T.
2. Within three periods of the jump the plan's own jerk has the other half: the samples up to one and a half periods away
   see the step, and each averages the plan's jerk over one and a half periods on either side of itself.
3. Steps less than three periods apart add up: together they have the half.

Every solver, the measure of a plan between its nodes and the guess of its knots take the rule from here.  The check does not
(:mod:`planner.verify.steps`): it samples the steps and adds the jerk beside them, in whatever shares.

Known limitation: the halves are a choice; where the jerk beside a jump is small, the step might have more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.geometry.curve import Curve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.quantity import JERK
from planner.types import FloatArray

# Jerk of samples by a step of the acceleration by 1, times their period: the peak of the quadratic B-spline.
STEP_SEEN = 0.75
# Periods before and after a step in which samples see it: half the support of that spline.
STEP_REACH = 1.5
# Share of the jerk limit that the plan itself may use beside a jump; the samples of the step have the rest.
JERK_BESIDE_STEP = 0.5
# Step of an acceleration over jerk limit and period, at which its samples use the rest of the jerk.
STEP_SHARE = (1.0 - JERK_BESIDE_STEP) / STEP_SEEN
# Periods before and after a jump in which the plan has only that share.
PERIODS_AROUND_STEP = 2.0 * STEP_REACH
# Factor on the jerk rows beside a jump: the plan's share, less what the jerk may exceed it by between collocation points.
JERK_COLLOCATED = 0.49
# How much wider the window is in the time of the law before the plan, and how much faster than that a plan goes at most.
_ROOM_AROUND_STEP, _MAX_FASTER = 1.1, 2.0
# Phases, in periods, at which the steps of jumps close to one another are added up.
_PHASES = np.linspace(-1.0, 1.0, 17)
# Largest slowing down searched for, as the log of x; steps of the search; jumps at once, which bounds the memory.
_MAX_SLOWING, _HALVINGS, _JUMPS_AT_ONCE = 14.0, 16, 10_000


def passable(step: FloatArray, jerk: FloatArray, period: float) -> FloatArray:
    """Largest square of the rate at which each jump may be passed alone, (m,): that of the feed, or of another coordinate.

    Parameters
    ----------
    step : (m, k) array
        Jumps of the second derivatives of k motions with respect to the coordinate.
    jerk : (k,) array
        Their jerk limits.
    period : float
        s.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.asarray(np.fmin.reduce(STEP_SHARE * jerk * period / np.abs(step), axis=1))


def beside_jumps(curve: Curve, limits: Limits, law: TimeLaw) -> NDArray[np.bool_]:
    """Intervals between the nodes of a time law, (n - 1,), in which a curvature jump leaves only a share of the jerk."""
    jumps = [b.u for b in curve.breaks if b.is_curvature_jump and law.u[0] < b.u < law.u[-1]]
    at, reach = law.t[np.searchsorted(law.u, jumps)], PERIODS_AROUND_STEP * limits.period
    first = np.maximum(np.searchsorted(law.t, at - reach, side="right") - 1, 0)
    last = np.searchsorted(law.t[:-1], at + reach)
    edges = np.bincount(first, minlength=law.t.size) - np.bincount(last, minlength=law.t.size)
    return np.asarray(np.cumsum(edges)[:-1] > 0)


def soften(
    limits: Limits, sigma: FloatArray, first: NDArray[np.intp], step: FloatArray, cap: FloatArray
) -> NDArray[np.bool_]:
    """Lower the cap at the curvature jumps of a section, in place; returns the points beside them, (p,).

    Parameters
    ----------
    limits : Limits
    sigma : (n,) array
        Knots; knot ``first[i]`` and the next are the two sides of jump i.
    first : (m,) int array
    step : (m, dim + 1) array
        Jump of the second derivative over sigma, of the axes and of the tip's arc length.
    cap : (p,) array
        Largest sigma_dot^2 at the knots and at the points between them (``collocation.py``).
    """
    stride = (cap.size - 1) // (sigma.size - 1)
    at = sigma[first]
    jerk = limits.of_motions(JERK.order)
    alone = passable(step, jerk, limits.period)
    passed = _together(at, step / jerk, np.minimum(alone, cap[stride * first]), limits.period)
    for k in range(stride + 1):
        cap[stride * first + k] = np.minimum(cap[stride * first + k], passed)
    # sigma is the time of a law that was much like the plan: at the jump it runs as fast as it may, beside it little faster.
    window = PERIODS_AROUND_STEP * limits.period
    reach = _ROOM_AROUND_STEP * window * np.clip(np.sqrt(passed), 1.0, _MAX_FASTER)
    # Whole intervals: within the one that the window ends in, the jerk climbs from one half to all of it.
    lo = np.maximum(np.searchsorted(sigma, at - reach, side="right") - 1, 0)
    hi = np.minimum(np.searchsorted(sigma, at + reach, side="left"), sigma.size - 1)
    edges = np.bincount(stride * lo, minlength=cap.size + 1) - np.bincount(stride * hi + 1, minlength=cap.size + 1)
    return np.asarray(np.cumsum(edges[:-1]) > 0)


def _together(at: FloatArray, step: FloatArray, alone: FloatArray, period: float) -> FloatArray:
    """Largest x at jumps (m,) of q'' by ``step`` (m, k) jerk limits, given those at which each alone may be passed.

    At constant sigma_dot the jumps i are seen in the samples as the jerk x / T sum_i step_i B((sigma - sigma_i) /
    (T sqrt(x))), B the quadratic B-spline.  Jumps further apart than its support of three periods do not meet.
    """
    found = alone.copy()
    gap = np.diff(at, prepend=-np.inf, append=np.inf)
    reach = 2.0 * PERIODS_AROUND_STEP * period * np.sqrt(alone)
    close = np.flatnonzero((np.minimum(gap[1:], gap[:-1]) < reach) & np.isfinite(alone))

    def share(i: NDArray[np.intp], x: FloatArray) -> FloatArray:
        width = period * np.sqrt(x)
        centre = at[i, None] + _PHASES * width[:, None]
        total = np.zeros((i.size, _PHASES.size, step.shape[1]))
        lo = np.searchsorted(at, centre[:, 0] - STEP_REACH * width)
        hi = np.searchsorted(at, centre[:, -1] + STEP_REACH * width, side="right")
        for k in range(int((hi - lo).max())):
            j = np.minimum(lo + k, at.size - 1)
            z = np.abs(centre - at[j, None]) / width[:, None]
            spline = np.where(z <= 0.5, STEP_SEEN - z**2, 0.5 * np.maximum(STEP_REACH - z, 0.0) ** 2)
            total += np.where((lo + k < hi)[:, None], spline, 0.0)[:, :, None] * step[j, None, :]
        return np.asarray(np.abs(total).max(axis=(1, 2)) * x / period)

    for some in np.array_split(close, max(1, close.size // _JUMPS_AT_ONCE)):
        meets = some[share(some, found[some]) > 1.0 - JERK_BESIDE_STEP] if some.size else some
        lo, hi = np.full(meets.size, -_MAX_SLOWING), np.zeros(meets.size)
        for _ in range(_HALVINGS if meets.size else 0):
            mid = 0.5 * (lo + hi)
            holds = share(meets, alone[meets] * np.exp(mid)) <= 1.0 - JERK_BESIDE_STEP
            lo, hi = np.where(holds, mid, lo), np.where(holds, hi, mid)
        found[meets] = alone[meets] * np.exp(lo)
    return found
