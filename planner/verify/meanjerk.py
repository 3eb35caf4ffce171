"""Mean jerk between the nodes of a plan, which the digits of u do not hide.

Between nodes h apart the last digit of u is worth 60 eps |u| |C'| / h^3 of jerk, so over 1e-8 s the jerk at a point says
nothing.  Its mean does: the accelerations C'' u'^2 + C' u'' at both nodes follow from u' and u'' as they are tabulated, and

    mean jerk = (a_1 - a_0) / h

is off by no more than their rounding over h: some eps |a| / h, and what a digit of u changes of C'' and C'.  A plan whose
jerk keeps a limit keeps it on average over every interval.
"""

from __future__ import annotations

import numpy as np

from planner.compiled import core
from planner.types import FloatArray, IntArray
from planner.verify.findings import Place
from planner.verify.motion import Motion
from planner.verify.peaks import chunks


def mean_jerks(motion: Motion) -> list[tuple[float, float, Place]]:
    """Find the largest mean jerk of each axis over an interval, less its slack: value, slack and place."""
    dim = motion.curve.dim
    worst = [(0.0, 0.0, (0.0, 0.0))] * dim
    whole = np.flatnonzero((motion.lower == 0.0) & (motion.upper == 1.0))
    for some in chunks(whole.size, 2):
        span = whole[some]
        x = np.tile([0.0, 1.0], (span.size, 1))
        mean, slack = _means(motion, span, x)
        for j in range(dim):
            k = int((mean[j] - slack[j]).argmax())
            if mean[j, k] - slack[j, k] > worst[j][0] - worst[j][1]:
                place = (float(motion.time(span[[k]], np.zeros(1))[0]), float(motion.u_ends[0, span[k]]))
                worst[j] = (float(mean[j, k]), float(slack[j, k]), place)
    return worst


def _means(motion: Motion, span: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Size of the mean jerk over whole spans, and what rounding can make of it, (dim, n)."""
    curve, i = motion.curve, motion.interval[span]
    d, _, _, rates, _ = motion.states(span, x)
    u = np.ascontiguousarray(motion.u_ends[:, span].T)
    edges = np.concatenate([[curve.domain[0]], curve._candidate_breaks(), [curve.domain[1]]])
    piece = np.clip(np.searchsorted(edges, u[:, 0], side="right") - 1, 0, edges.size - 2)
    gap = np.maximum(np.diff(edges)[piece], np.abs(u[:, 1] - u[:, 0]))
    mean, slack = np.empty((2, curve.dim, span.size))
    times = motion.law.start[i], motion.law.h[i]
    core.meanjerk_measure(span.size, curve.dim, d, rates, u, *times, gap, mean, slack)
    return mean, slack
