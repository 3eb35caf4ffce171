"""Compiled measurement of a time law; see ``law.py``."""

from __future__ import annotations

import numpy as np
from numba import njit, types

F64, I64, NOTHING = types.float64, types.int64, types.void
READ1, READ2, READ3, READ4 = (types.Array(F64, n, "C", readonly=True) for n in (1, 2, 3, 4))
WRITE1, WRITE2 = (types.Array(F64, n, "C") for n in (1, 2))


@njit(NOTHING(READ4, READ4, READ3, I64, I64, READ2, READ1, WRITE1), cache=True, error_model="numpy")
def _shares_at(q, tip, rates, i, p, rows, scalars, out):
    """Shares of all limits used at point p of interval i: velocities and feed, accelerations, jerks."""
    dim = q.shape[3]
    u1, u2, u3 = rates[0, i, p], rates[1, i, p], rates[2, i, p]
    for j in range(dim):
        d1, d2, d3 = q[1, i, p, j], q[2, i, p, j], q[3, i, p, j]
        out[j] = abs(d1 * u1) / rows[0, j]
        out[dim + 2 + j] = abs(d2 * u1 * u1 + d1 * u2) / rows[1, j]
        out[2 * dim + 3 + j] = abs(d3 * u1 * u1 * u1 + 3.0 * d2 * u1 * u2 + d1 * u3) / rows[2, j]
    feed, chord, period, along2, along3 = scalars[0], scalars[1], scalars[2], scalars[3], scalars[4]
    dot11 = dot12 = dot13 = dot22 = 0.0
    for j in range(tip.shape[3]):
        d1, d2, d3 = tip[1, i, p, j], tip[2, i, p, j], tip[3, i, p, j]
        dot11 += d1 * d1
        dot12 += d1 * d2
        dot13 += d1 * d3
        dot22 += d2 * d2
    s1 = np.sqrt(dot11)
    out[dim] = s1 * abs(u1) / feed
    out[dim + 1] = out[2 * dim + 2] = out[3 * dim + 3] = 0.0
    if not s1 > 0.0:
        return
    s2 = dot12 / s1
    if np.isfinite(chord):
        normal = 0.0
        for j in range(tip.shape[3]):
            normal += (tip[2, i, p, j] - s2 / s1 * tip[1, i, p, j]) ** 2
        if normal > 0.0:
            radius = dot11 / np.sqrt(normal)
            error = min(chord, radius)
            out[dim + 1] = s1 * abs(u1) * period / (2.0 * np.sqrt(error * (2.0 * radius - error)))
    out[2 * dim + 2] = abs(s1 * u2 + s2 * u1 * u1) / along2
    s3 = (dot22 + dot13 - s2 * s2) / s1
    out[3 * dim + 3] = abs(s1 * u3 + 3.0 * s2 * u1 * u2 + s3 * u1 * u1 * u1) / along3


@njit(NOTHING(READ4, READ4, READ3, READ2, READ1, WRITE2), cache=True, error_model="numpy")
def shares(q, tip, rates, rows, scalars, out):
    """Write the largest share of speed, acceleration and jerk limits used in each interval into ``out (3, n)``.

    ``q``, ``tip`` (4, n, k, dim): derivatives with respect to u at k equidistant points of each interval;
    ``rates (3, n, k)``: u', u'', u''' (with respect to time); ``rows (3, dim)``: velocity, acceleration and jerk limits;
    ``scalars``: feed, chord error, period, tangential acceleration and jerk.  A peak between points is estimated by the
    parabola through three of them.
    """
    dim, points = q.shape[3], q.shape[2]
    count = 3 * dim + 4
    older, old, new = np.empty(count), np.empty(count), np.empty(count)
    for i in range(q.shape[1]):
        out[0, i] = out[1, i] = out[2, i] = 0.0
        for p in range(points):
            _shares_at(q, tip, rates, i, p, rows, scalars, new)
            for k in range(count):
                kind = 0 if k < dim + 2 else (1 if k < 2 * dim + 3 else 2)
                value = new[k]
                if p >= 2:
                    bend, lean = older[k] - 2.0 * old[k] + value, older[k] - value
                    # The vertex is nearest to the middle one, or at an end of the interval to its first or last point.
                    outer = (p == 2 and lean > 0.0) or (p == points - 1 and lean < 0.0)
                    if bend < 0.0 and abs(lean) <= (-2.0 * bend if outer else -bend):
                        value = old[k] - (older[k] - value) ** 2 / (8.0 * bend)
                out[kind, i] = max(out[kind, i], value)
                older[k], old[k] = old[k], new[k]
