"""Which law of motion a machine follows: a trapezoid of speed, an S-curve, or a trapezoid through a moving average."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from planner.calibration.axis_limits import AxisLimit, axis_limits, path_limit
from planner.calibration.ramps import RESOLVED, Ramp, golden
from planner.quantity import JERK
from planner.types import FloatArray

_SEEN = 25.0  # rise of the misfit over the noise, five standard deviations: a ramp is no step
_MOST = 50  # ramps that are looked at: more say no more
_APART = 1.5  # times the misfit of the better law, from where the other does not fit
_ALIKE = 1.2  # ratio of the highest ramp to the lowest in one direction, up to which S-curve and FIR are one motion


class MotionLaw(Enum):
    """How the speed changes."""

    TRAPEZOID = "trapezoid"
    S_CURVE = "S-curve"
    FIR = "FIR"


@dataclass(frozen=True)
class LawFit:
    """One law with its best parameters: how far positions around ramps are off it, root mean square, mm."""

    law: MotionLaw
    misfit: float


@dataclass(frozen=True)
class Laws:
    """What the ramps of the acceleration say.

    Attributes
    ----------
    fits : tuple of LawFit
        Every law; empty where there is no ramp to tell by.
    best : MotionLaw, optional
        The one that fits, or of two that cannot be told apart the S-curve.
    sure : bool
        Whether the others do not fit.
    jerk : tuple of AxisLimit
        By axis, of an S-curve.
    tau, tau_error : float
        Length of the moving average of FIR and its standard error, s.
    ramps : int
        How many there are.
    says : str
        The same in a sentence.
    """

    fits: tuple[LawFit, ...]
    best: MotionLaw | None
    sure: bool
    jerk: tuple[AxisLimit, ...]
    tau: float
    tau_error: float
    ramps: int
    says: str


def fit_laws(ramps: Sequence[Ramp], axes: Sequence[str]) -> Laws:
    """Fit every law to ramps, whose directions are in these axes."""
    none = tuple(
        AxisLimit(axis, JERK, 0.0, False, why="no ramp of the acceleration is long enough to see") for axis in axes
    )
    ramps = [ramp for ramp in ramps[:: max(1, len(ramps) // _MOST)] if not ramp.is_odd]
    if not ramps:
        says = "no log has a straight move whose acceleration comes to its limit: nothing tells the law of motion"
        return Laws((), None, False, none, np.nan, np.nan, 0, says)
    variance = np.array([max(ramp.noise**2, ramp.least / max(ramp.t.size - 6, 1)) for ramp in ramps])
    duration, error, height, period = (
        np.array([getattr(ramp, name) for ramp in ramps]) for name in ("duration", "error", "height", "period")
    )
    directions = np.array([ramp.direction for ramp in ramps])
    tau = _average(ramps, variance, float(np.average(duration, weights=error**-2.0)))
    scatter = float(np.average((duration - tau) ** 2, weights=error**-2.0))
    step, average = _misfits(ramps, np.zeros(len(ramps))), _misfits(ramps, np.full(len(ramps), tau))
    count = sum(ramp.t.size for ramp in ramps)
    least = RESOLVED * float(np.median(period))
    if tau < least or np.sum((step - average) / variance) < _SEEN:
        says = (
            f"trapezoid: in {len(ramps)} changes of acceleration nothing is seen of a jerk limit or a filter; what takes "
            f"less than {RESOLVED:.0f} samples, {1e3 * least:.4g} ms, looks like this"
        )
        return Laws(
            (LawFit(MotionLaw.TRAPEZOID, _rms(step, count)),),
            MotionLaw.TRAPEZOID,
            True,
            none,
            np.nan,
            np.nan,
            len(ramps),
            says,
        )
    seen = (error < 0.5 * duration) & (duration > period)
    slope = height[seen] / duration[seen]
    jerk = axis_limits(JERK, axes, directions[seen], slope, slope * error[seen] / duration[seen])
    values = np.array([limit.value if limit.value > 0.0 else np.inf for limit in jerk])
    curve = _misfits(ramps, height / path_limit(values, directions))
    fits = tuple(LawFit(law, _rms(off, count)) for law, off in zip(MotionLaw, (step, curve, average), strict=True))
    best, sure, says = _choice(float(np.sum(curve / variance)), float(np.sum(average / variance)), height, tau)
    return Laws(fits, best, sure, tuple(jerk), tau, float(np.sqrt(scatter / max(len(ramps) - 1, 1))), len(ramps), says)


def _average(ramps: Sequence[Ramp], variance: FloatArray, near: float) -> float:
    """The one duration of all ramps that fits best.

    A mean of their own durations would not do: near 0 the noise makes these as uncertain as they are small.
    """
    return golden(
        lambda tau: float(np.sum(_misfits(ramps, np.full(len(ramps), tau)) / variance)), 0.3 * near, 2.0 * near
    )[0]


def _misfits(ramps: Sequence[Ramp], durations: FloatArray) -> FloatArray:
    return np.array([ramp.misfit(min(float(d), ramp.longest)) for ramp, d in zip(ramps, durations, strict=True)])


def _rms(off: FloatArray, count: int) -> float:
    return float(np.sqrt(np.sum(off) / count))


def _choice(curve: float, average: float, height: FloatArray, tau: float) -> tuple[MotionLaw, bool, str]:
    """The better of S-curve and FIR by their misfits over the noise, and whether the other is worse for sure."""
    best, other = (MotionLaw.S_CURVE, MotionLaw.FIR) if curve <= average else (MotionLaw.FIR, MotionLaw.S_CURVE)
    low, high = sorted((curve, average))
    if high > _APART * low and high - low > _SEEN:
        more = f", a moving average of {1e3 * tau:.4g} ms" if best is MotionLaw.FIR else ""
        return best, True, f"{best.value}{more}: {other.value} is off {np.sqrt(high / low):.3g} times as far"
    spread = float(height.max() / height.min())
    why = (
        "every change of acceleration is about as high"
        if spread < _ALIKE
        else "the changes of acceleration that would tell them apart are too few or too noisy"
    )
    return (
        MotionLaw.S_CURVE,
        False,
        f"S-curve or FIR, not told apart: {why}; moves too short for a steady feed would tell",
    )
