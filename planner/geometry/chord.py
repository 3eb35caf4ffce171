"""Chords of a path: how long one may be on a circle, and how far points lie from it.

The planner limits the feed by the first on the osculating circle; the true chord error of a plan or of samples is the
second.  The check derives the first again where it needs it.
"""

from __future__ import annotations

import numpy as np

from planner.geometry.differential import dot, norm
from planner.types import FloatArray


def half_chord(curvature: FloatArray, error: FloatArray | float) -> FloatArray:
    """Half the length of the chord that leaves a circle by an error e, mm; inf where nothing bends.

    With the radius rho, sqrt(e (2 rho - e)); no chord leaves the circle by more than rho, so e is at most that.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = 1.0 / curvature
        sagitta = np.minimum(error, radius)
        half = np.sqrt(sagitta * (2.0 * radius - sagitta))
    return np.where(curvature > 0.0, half, np.inf)


def distance_to_chord(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances (..., k) of points (..., k, dim) from the segments between a and b (..., dim)."""
    chord = (b - a)[..., None, :]
    from_a = points - a[..., None, :]
    square = dot(chord, chord)
    along = dot(from_a, chord)
    share = np.clip(np.divide(along, square, out=np.zeros_like(along), where=square > 0.0), 0.0, 1.0)
    return norm(from_a - share[..., None] * chord)
