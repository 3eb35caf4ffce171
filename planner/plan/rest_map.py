"""The rest map: a coordinate in which the speed stays finite and positive down to a stop.

It removes the singularity of a start from rest, where sigma_dot^2 ~ y^(4/3).  Over a width w at each
end, with r = sigma / w,

    dy/dsigma = p(r) = 1 - (1-r)^4 (1 + 4r + 6r^2) = 4r^2 + 4r^3 - 21r^4 + 20r^5 - 6r^6,

which joins the slope 1 of the middle with three continuous derivatives.  In sigma the speed stays finite and positive
down to the stop; velocity and acceleration of every axis vanish there by themselves, and the jerk stays finite.
"""

from __future__ import annotations

import numpy as np

from planner.types import FloatArray

# Ascending powers of r of the slope p and of its integral; a blend of width w covers BLEND_LENGTH w of y.
_SLOPE = np.array([0.0, 0.0, 4.0, 4.0, -21.0, 20.0, -6.0])
_LENGTH = np.array([0.0, 0.0, 0.0, 4.0 / 3.0, 1.0, -21.0 / 5.0, 10.0 / 3.0, -6.0 / 7.0])
BLEND_LENGTH = float(_LENGTH.sum())
# The integral, p, p' and p'', highest power first
_MAPS = [_LENGTH[::-1], _SLOPE[::-1], np.polyder(_SLOPE[::-1]), np.polyder(_SLOPE[::-1], 2)]
_NEWTON_PASSES = 80


def covered(r: FloatArray) -> FloatArray:
    """Distance in y from the stop, over the width of the blend, at shares r (n,) of the blend."""
    return np.asarray(np.polyval(_MAPS[0], r))


def slopes(r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """p, p' and p'' at shares r (n,) of the blend."""
    slope, bend, twist = (np.asarray(np.polyval(some, r)) for some in _MAPS[1:])
    return slope, bend, twist


def share_of_blend(fraction: FloatArray) -> FloatArray:
    """Share r in [0, 1] of the blend at which a distance in y (n,) is covered, the inverse of :func:`covered`.

    By Newton, bracketed.
    """
    lo, hi = np.zeros_like(fraction), np.ones_like(fraction)
    r = np.minimum(np.cbrt(0.75 * fraction), 1.0)
    for _ in range(_NEWTON_PASSES):
        error = np.polyval(_MAPS[0], r) - fraction
        lo, hi = np.where(error <= 0.0, r, lo), np.where(error > 0.0, r, hi)
        slope = np.polyval(_MAPS[1], r)
        with np.errstate(divide="ignore", invalid="ignore"):
            trial = r - error / slope
        good = (trial >= lo) & (trial <= hi)
        following = np.where(error == 0.0, r, np.where(good, trial, 0.5 * (lo + hi)))
        if np.abs(following - r).max() <= 1e-15:
            break
        r = following
    return r
