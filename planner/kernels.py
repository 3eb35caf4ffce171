"""Compiled measurement of a time law; see ``law.py``."""

from __future__ import annotations

import numpy as np
from numba import njit, types

F64, NOTHING = types.float64, types.void
READ1, READ2, READ3, READ4 = (types.Array(F64, n, "C", readonly=True) for n in (1, 2, 3, 4))
WRITE2 = types.Array(F64, 2, "C")


@njit(NOTHING(READ4, READ4, READ3, READ2, READ1, WRITE2), cache=True, error_model="numpy")
def shares(q, tip, rates, rows, scalars, out):
    """Write the largest share of speed, acceleration and jerk limits used in each interval into ``out (3, n)``.

    ``q``, ``tip`` (4, n, k, dim): derivatives with respect to u at k points of each interval; ``rates (3, n, k)``: u',
    u'', u''' (with respect to time); ``rows (3, dim)``: velocity, acceleration and jerk limits; ``scalars``: feed, chord
    error, period, tangential acceleration and jerk.
    """
    feed, chord, period, along2, along3 = scalars[0], scalars[1], scalars[2], scalars[3], scalars[4]
    for i in range(q.shape[1]):
        most1 = most2 = most3 = 0.0
        for p in range(q.shape[2]):
            u1, u2, u3 = rates[0, i, p], rates[1, i, p], rates[2, i, p]
            for j in range(q.shape[3]):
                d1, d2, d3 = q[1, i, p, j], q[2, i, p, j], q[3, i, p, j]
                most1 = max(most1, abs(d1 * u1) / rows[0, j])
                most2 = max(most2, abs(d2 * u1 * u1 + d1 * u2) / rows[1, j])
                most3 = max(most3, abs(d3 * u1 * u1 * u1 + 3.0 * d2 * u1 * u2 + d1 * u3) / rows[2, j])
            dot11 = dot12 = dot13 = dot22 = 0.0
            for j in range(tip.shape[3]):
                d1, d2, d3 = tip[1, i, p, j], tip[2, i, p, j], tip[3, i, p, j]
                dot11 += d1 * d1
                dot12 += d1 * d2
                dot13 += d1 * d3
                dot22 += d2 * d2
            s1 = np.sqrt(dot11)
            most1 = max(most1, s1 * abs(u1) / feed)
            if not s1 > 0.0:
                continue
            s2 = dot12 / s1
            if np.isfinite(chord):
                normal = 0.0
                for j in range(tip.shape[3]):
                    normal += (tip[2, i, p, j] - s2 / s1 * tip[1, i, p, j]) ** 2
                if normal > 0.0:
                    radius = dot11 / np.sqrt(normal)
                    error = min(chord, radius)
                    allowed = 2.0 / period * np.sqrt(error * (2.0 * radius - error))
                    most1 = max(most1, s1 * abs(u1) / allowed)
            most2 = max(most2, abs(s1 * u2 + s2 * u1 * u1) / along2)
            s3 = (dot22 + dot13 - s2 * s2) / s1
            most3 = max(most3, abs(s1 * u3 + 3.0 * s2 * u1 * u2 + s3 * u1 * u1 * u1) / along3)
        out[0, i], out[1, i], out[2, i] = most1, most2, most3
