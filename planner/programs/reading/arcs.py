"""Arcs of a part program: centre and sweep from the words of G2 and G3."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.types import FloatArray

# Start and end differ in their distance from the centre by the digits they are written with; by more the arc is wrong.
# The bounds are LinuxCNC's: 2 sqrt(2) steps of its resolution, 0.01 mm or 0.001 inch, or a share of the larger radius, of
# which it takes no more than 100 times the former.
RADIUS_MISMATCH_MM = 0.02 * np.sqrt(2.0)
RADIUS_MISMATCH_INCH = 0.002 * np.sqrt(2.0)
RADIUS_MISMATCH_SHARE = 1e-3
_MAX_MISMATCH = 100.0
RADIUS_TOO_SMALL_MM = 0.00127  # of half the chord, in either unit
# Start and end in one direction from the centre make a full turn by rule.  Where they are apart, and by so little against
# the circle, a short move was meant, and its digits lost; controllers do not agree on it.
_SAME_DIRECTION = 1e-6  # rad
_SMALL_CHORD = 1e-6  # of the circumference


@dataclass(frozen=True, eq=False)
class Arcs:
    """Centre (m, 3) in mm, sweep (m,) in rad, and what makes an arc impossible (m,), nan or a size in mm.

    ``mismatch`` is the difference of the two radii where it is too large, ``allowed`` what it may be, ``gap`` how much
    farther apart start and end are than a circle of the radius R allows, ``small`` a radius too small to be one, ``chord``
    the distance of a start and an end that are apart, and yet on a circle so large that they are the same.
    """

    centre: FloatArray
    sweep: FloatArray
    radii: FloatArray
    mismatch: FloatArray
    allowed: FloatArray
    gap: FloatArray
    chord: FloatArray
    small: NDArray[np.bool_]


def resolve_arcs(
    start: FloatArray,
    end: FloatArray,
    normal: NDArray[np.uint8],
    counterclockwise: NDArray[np.bool_],
    centre: FloatArray,
    radius: FloatArray,
    threshold: float,
    unit: FloatArray,
) -> Arcs:
    """Complete arcs given by their centre, or where ``radius`` is a number by that.

    In the plane of the arc, with the first and second axis such that they and the normal are right-handed, c the
    vector from start to end and R the radius, the centre lies at

        (start + end)/2 +- sqrt(R^2 - |c|^2/4) (-c_2, c_1)/|c|

    on the left of c for the shorter arc (R > 0) counterclockwise, on the right for the longer one (R < 0).  A chord
    longer than 2 |R| by the tolerance of written digits is a half turn.

    Parameters
    ----------
    start, end, centre : (m, 3) arrays
        mm; the centre counts where radius is nan, in the two axes of the plane.
    normal : (m,) uint8 array
        Axis normal to the plane.
    counterclockwise : (m,) bool array
        G3, seen against the normal.
    radius : (m,) array
        R, mm, or nan.
    threshold : float
        Points closer than this are the same, mm: the arc is a full circle.
    unit : (m,) array
        Length unit of the blocks, mm: what the digits of the radii may be off depends on it.

    Returns
    -------
    Arcs
    """
    rows = np.arange(start.shape[0])
    first, second = (normal + 1) % 3, (normal + 2) % 3
    p, q = (np.stack([point[rows, first], point[rows, second]], axis=1) for point in (start, end))
    chord = q - p
    distance = np.hypot(chord[:, 0], chord[:, 1])
    given = ~np.isnan(radius)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.sqrt(np.maximum(radius**2 - 0.25 * distance**2, 0.0))
        left = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / distance[:, None]
        side = np.where((radius > 0.0) == counterclockwise, height, -height)
        from_radius = 0.5 * (p + q) + side[:, None] * left
        gap = 0.5 * distance - np.abs(radius)
    middle = np.where(given[:, None], from_radius, np.stack([centre[rows, first], centre[rows, second]], axis=1))
    a, b = p - middle, q - middle
    radii = np.stack([np.hypot(a[:, 0], a[:, 1]), np.hypot(b[:, 0], b[:, 1])], axis=1)
    turn = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.sum(a * b, axis=1))  # in (-pi, pi]
    sweep = np.where(counterclockwise, turn, -turn) % (2.0 * np.pi)
    sweep[(distance < threshold) | (sweep == 0.0)] = 2.0 * np.pi
    mismatch = np.abs(radii[:, 1] - radii[:, 0])
    step = np.where(unit == 1.0, RADIUS_MISMATCH_MM, RADIUS_MISMATCH_INCH * unit)
    allowed = np.clip(RADIUS_MISMATCH_SHARE * radii.max(axis=1), step, _MAX_MISMATCH * step)
    too_wide = given & (gap > RADIUS_TOO_SMALL_MM)
    lost = (np.abs(turn) < _SAME_DIRECTION) & (distance >= threshold)
    lost &= distance < _SMALL_CHORD * 2.0 * np.pi * radii.max(axis=1)
    whole = start.copy()
    whole[rows, first], whole[rows, second] = middle[:, 0], middle[:, 1]
    return Arcs(
        centre=whole,
        sweep=np.where(counterclockwise, sweep, -sweep),
        radii=radii,
        mismatch=np.where(~given & (mismatch > allowed), mismatch, np.nan),
        allowed=allowed,
        gap=np.where(too_wide, gap, np.nan),
        chord=np.where(lost, distance, np.nan),
        small=~given & (radii.min(axis=1) < threshold),
    )
