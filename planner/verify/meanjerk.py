"""Mean jerk between the nodes of a plan, which the digits of u do not hide.

Between nodes h apart the last digit of u is worth 60 eps |u| |C'| / h^3 of jerk, so over 1e-8 s the jerk at a point says
nothing.  Its mean does: the accelerations C'' u'^2 + C' u'' at both nodes follow from u' and u'' as they are tabulated, and

    mean jerk = (a_1 - a_0) / h

is off by no more than their rounding over h: some eps |a| / h, and what a digit of u changes of C'' and C'.  A plan whose
jerk keeps a limit keeps it on average over every interval.
"""

from __future__ import annotations

import numpy as np

from planner.types import FloatArray, IntArray
from planner.verify.findings import Place
from planner.verify.motion import Motion
from planner.verify.peaks import chunks
from planner.verify.sizes import EPS

_DIGITS = 16.0  # of derivatives: sums of a few products


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
            k = int((mean[:, j] - slack[:, j]).argmax())
            if mean[k, j] - slack[k, j] > worst[j][0] - worst[j][1]:
                place = (float(motion.time(span[[k]], np.zeros(1))[0]), float(motion.u_ends[0, span[k]]))
                worst[j] = (float(mean[k, j]), float(slack[k, j]), place)
    return worst


def _means(motion: Motion, span: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Size of the mean jerk over whole spans, and what rounding can make of it, (n, dim)."""
    i = motion.interval[span]
    d, _, _, rates, _ = motion.states(span, x)
    position, first, second, third = (part.reshape(span.size, 2, -1) for part in np.abs(d))
    u1, u2 = (rate[..., None] for rate in rates[:2])
    signed = d.reshape(4, span.size, 2, -1)
    acceleration = signed[2] * u1**2 + signed[1] * u2
    u = np.abs(motion.u_ends[:, span].T)[..., None]
    width = np.abs(np.diff(motion.u_ends[:, span], axis=0))[0]
    edges = np.concatenate([[motion.curve.domain[0]], motion.curve._candidate_breaks(), [motion.curve.domain[1]]])
    piece = np.clip(np.searchsorted(edges, motion.u_ends[0, span], side="right") - 1, 0, edges.size - 2)
    gap = np.maximum(np.diff(edges)[piece], width)[:, None, None]
    off = _DIGITS * EPS * (second * u1**2 + first * np.abs(u2) + position * u1**2 / gap**2)
    off += EPS * u * (third * u1**2 + second * np.abs(u2))
    h = motion.law.h[i][:, None]
    mean = np.abs(acceleration[:, 1] - acceleration[:, 0]) / h
    return mean, off.sum(axis=1) / h + mean * EPS * (motion.law.start[i][:, None] + h) / h
