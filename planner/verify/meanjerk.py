"""Mean jerk between the nodes of a plan, which the digits of u do not hide.

Between nodes h apart the last digit of u is worth 60 eps |u| |C'| / h^3 of jerk, so over 1e-8 s the jerk at a point says
nothing.  Its mean does: the accelerations C'' u'^2 + C' u'' at both nodes follow from u' and u'' as they are tabulated, and

    mean jerk = (a_1 - a_0) / h

is off by no more than their rounding over h: some eps |a| / h, and what a digit of u changes of C'' and C'.  A plan whose
jerk keeps a limit keeps it on average over every interval.
"""

from __future__ import annotations

import numpy as np

from planner.types import FloatArray
from planner.verify.findings import Place
from planner.verify.motion import Motion


def mean_jerks(motion: Motion, mean: FloatArray, slack: FloatArray) -> list[tuple[float, float, Place]]:
    """Largest mean jerk of each axis over an interval, less its slack: value, slack and place.

    ``mean`` and ``slack`` (dim, spans): of the spans that are whole intervals; 0 of others.
    """
    with np.errstate(invalid="ignore"):
        top = (mean - slack).argmax(axis=1)
    at = motion.time(top, np.zeros(top.size))
    return [
        (float(mean[j, k]), float(slack[j, k]), (float(at[j]), float(motion.u_ends[0, k])))
        if mean[j, k] > slack[j, k]
        else (0.0, 0.0, (0.0, 0.0))
        for j, k in enumerate(top)
    ]


def gaps_around(motion: Motion) -> FloatArray:
    """Distance of the knots of the curve around each span, (spans,): no less than between the ends of the span."""
    curve, u = motion.curve, motion.u_ends
    edges = np.concatenate([[curve.domain[0]], curve._candidate_breaks(), [curve.domain[1]]])
    piece = np.clip(np.searchsorted(edges, u[0], side="right") - 1, 0, edges.size - 2)
    return np.asarray(np.maximum(np.diff(edges)[piece], np.abs(u[1] - u[0])))
