"""The position loop of the X-Y table of 2002, and the contour error it leaves.

Each axis is driven through a velocity loop G(s) (mm/s per volt), whose integral is the position.  The controller is a
proportional gain with a feed-forward path:

    U = K_p (X_c - X_a) + K_v dX_c/dt,      X_a = G(s)/s U

Sampled with the period T: the command is held between samples, dX_c/dt is a backward difference, and G(s)/s is
discretised exactly under a zero-order hold.  The loop is then one linear difference equation an axis.

At a steady velocity v an axis lags by (1 - K_v g)/(K_p g) v, g = G(0).  Where two axes lag by different times the tool
leaves the contour even along a perfect command.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.inputs import numbers, positive_number, require_instance
from planner.types import FloatArray

DEFAULT_SETTLING = 0.5  # s
_SCAN_POINTS = 8192
_GOLDEN_PASSES = 60


@dataclass(frozen=True)
class AxisDrive:
    """One axis: G(s) = gain / (s^2 + damping s + stiffness), and the gains of its position loop.

    Attributes
    ----------
    gain, damping, stiffness : float
        mm/s^3 per volt, 1/s, 1/s^2.
    position_gain : float
        K_p, 1/s (a volt commands about 1 mm/s).
    feed_forward : float
        K_v, without unit.
    """

    gain: float
    damping: float
    stiffness: float
    position_gain: float
    feed_forward: float

    @property
    def steady_lag(self) -> float:
        """Time by which the axis lags behind a steady motion, s."""
        g = self.gain / self.stiffness
        return (1.0 - self.feed_forward * g) / (self.position_gain * g)


# Measured frequency responses and gains of the paper, for a feed of 100 mm/s.
XY_TABLE = (
    AxisDrive(112570.543, 601.677, 113727.10, 40.0, 0.6),
    AxisDrive(319514.874, 1649.133, 342115.44, 70.0, 0.6),
)


@dataclass(frozen=True, eq=False)
class Tracking:
    """What the axes make of a command.

    Attributes
    ----------
    period : float
        s.
    t : (m,) array
        Time, s; the command is held for the settling time beyond its end.
    command, actual : (m, dim) arrays
        Positions, mm.
    moving : int
        Number of points before the settling.
    """

    period: float
    t: FloatArray
    command: FloatArray
    actual: FloatArray
    moving: int

    def __post_init__(self) -> None:
        for array in (self.t, self.command, self.actual):
            array.setflags(write=False)

    @property
    def lag(self) -> FloatArray:
        """Command less actual position, (m, dim), mm."""
        return np.asarray(self.command - self.actual)


def track(
    position: ArrayLike,
    period: float,
    drives: Sequence[AxisDrive] = XY_TABLE,
    *,
    settling: float = DEFAULT_SETTLING,
) -> Tracking:
    """Follow a command with the position loop of every axis, from rest at its first point.

    Parameters
    ----------
    position : (m, dim) array_like
        The command, one point a period, mm.
    period : float
        s.
    drives : sequence of AxisDrive
        One for every axis.
    settling : float
        Time for which the last point is held, s.

    Returns
    -------
    Tracking

    Raises
    ------
    InputError
        If the command is not (m, dim) with one drive for each axis, the period is not positive and finite, the
        settling time is negative, or the loop is unstable at this period.
    """
    command = numbers(position, "position", InputError)
    if command.ndim != 2 or command.shape[1] != len(drives) or not len(command) or not np.isfinite(command).all():
        raise InputError(
            f"position has the shape {command.shape}; it must be (m, {len(drives)}), finite, m >= 1: one column a drive"
        )
    step = positive_number(period, "period")
    if not (np.isfinite(step) and np.isfinite(settling) and settling >= 0.0):
        raise InputError(f"period = {step!r} s must be finite and settling = {settling!r} s finite and >= 0")
    from scipy.signal import lfilter

    held = np.repeat(command[-1:], ceil(settling / step - 1e-9), axis=0)
    whole = np.concatenate([command, held])
    actual = np.empty_like(whole)
    for j, drive in enumerate(drives):
        actual[:, j] = lfilter(*closed_loop(drive, step), whole[:, j] - whole[0, j]) + whole[0, j]
    return Tracking(step, step * np.arange(len(whole), dtype=np.float64), whole, actual, len(command))


def closed_loop(drive: AxisDrive, period: float) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator, in powers of 1/z, from the command of an axis to its position.

    With P = B/A the discretised G(s)/s, the loop X = P (K_p (C - X) + K_v (1 - 1/z) C / T) is

        X / C = B (K_p + K_v (1 - 1/z) / T) / (A + K_p B).

    Raises
    ------
    InputError
        If the loop is unstable at this period.
    """
    from scipy.signal import cont2discrete

    velocity_loop: Any = ([drive.gain], [1.0, drive.damping, drive.stiffness, 0.0])
    b, a, _ = cont2discrete(velocity_loop, period, method="zoh")
    forward = np.array([drive.position_gain + drive.feed_forward / period, -drive.feed_forward / period])
    numerator, denominator = np.convolve(np.ravel(b), forward), np.asarray(a + drive.position_gain * np.ravel(b))
    largest = float(np.abs(np.roots(denominator)).max())
    if not largest < 1.0:
        raise InputError(
            f"the position loop is unstable: with the period {period!r} s and the gain {drive.position_gain!r} 1/s its "
            f"largest pole is {largest:.4g}, which must be < 1; lower either"
        )
    return numerator, denominator


def contour_error(curve: Curve, position: ArrayLike) -> FloatArray:
    """Distance of each point from the path of the tool tip: the contour error, mm.

    The nearest two of 8192 points equally spaced along the path give brackets, golden sections the nearest point there.

    Parameters
    ----------
    curve : Curve
    position : (m, dim) array_like
        Positions of the curve's axes, mm; a curve with rotary axes is refused.

    Returns
    -------
    (m,) array

    Raises
    ------
    InputError
        If the curve has rotary axes or the shape is another one.

    Notes
    -----
    Known limitation: the nearest point of the whole path counts, which near a self-crossing may lie on another branch.
    """
    require_instance(curve, Curve, "curve")
    points = numbers(position, "position", InputError)
    if curve.tip is not curve:
        raise InputError(
            f"{curve.name} has the axes {', '.join(curve.axes)}; the contour error needs linear axes alone"
        )
    if points.ndim != 2 or points.shape[1] != curve.dim:
        raise InputError(f"position has the shape {points.shape}; it must be (m, {curve.dim})")
    from scipy.spatial import cKDTree

    u = curve.arclength.u(np.linspace(0.0, curve.length, _SCAN_POINTS))
    # Two brackets: on a closed path the point at the seam is both the first and the last.
    near = np.asarray(cKDTree(curve.derivatives(u, 0)[0]).query(points, k=2)[1]).T
    lo, hi = u[np.maximum(near - 1, 0)], u[np.minimum(near + 1, u.size - 1)]

    def apart(x: FloatArray) -> FloatArray:
        return np.asarray(np.sum((curve.derivatives(x, 0)[0] - points) ** 2, axis=-1))

    best = np.minimum(apart(lo), apart(hi))
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(_GOLDEN_PASSES):
        left, right = hi - ratio * (hi - lo), lo + ratio * (hi - lo)
        at_left, at_right = apart(left), apart(right)
        best = np.minimum(best, np.minimum(at_left, at_right))
        lower = at_left < at_right
        lo, hi = np.where(lower, lo, left), np.where(lower, right, hi)
    return np.asarray(np.sqrt(best.min(axis=0)))
