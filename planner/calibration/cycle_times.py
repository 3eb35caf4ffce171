"""Limits of a machine from nothing but how long programs took on it.

A model of its controller says how long each program takes for given limits.  With x the logarithms of the limits over those
of the machine file,

    minimise  sum over programs of rho((log T_model(x) - log T_measured) / e)^2  +  sum over limits of (x / spread)^2.

1. Logarithms make every program count alike, and keep limits positive.  rho is linear for programs far off.
2. The second sum says that the machine file is about right.  It hardly moves what the times depend on; what they do
   not depend on stays, and of limits that only fit together those nearest to the file's are taken.
3. The standard error of each x comes from the slopes d log T / d x at the optimum.  A limit with a small one is known.
   One with a large one is not, by itself; its value is kept if the times depend on it.  With no more programs than limits
   none is known.
4. A program that is off far more than the others is named and left out: it waits for something, or is another one.

Known limitation: the model's own error is part of the misfit; where it is one-sided, so are the limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from planner.calibration.axis_limits import AxisLimit
from planner.calibration.calibrated_machine import calibrated_limits
from planner.machine.limits import Limits
from planner.quantity import ACCELERATION, VELOCITY, Quantity
from planner.types import BoolArray, FloatArray

Seconds = Callable[[Limits], FloatArray]
"""What a model says of every program, (n,) s, for given limits."""

_STEP = 0.02  # of a logarithm, for slopes: times move in steps of a period
_KNOWN = 0.10  # standard error of a logarithm up to which a limit is known
_ROUGH, _FINE = 0.05, 3e-3  # what a time may be off (e): in a first search, and by models at their best
_SPREAD = 0.7  # of the logarithms of what a machine file says: a factor of two
_FLAT = 5e-3  # slope of a logarithm of a time: with less nothing depends on a limit
_SPAN = float(np.log(30.0))  # a limit is at most so far from the start
_TURNS = 25  # of a search
_SHIFTS = (0.0, -0.7, -1.4)  # of the logarithms of velocities, where searches begin
_ODD, _MIN_ODD = 6.0, 0.02  # times the median error, and of the time: such a program is left out


@dataclass(frozen=True, eq=False)
class TimesFit:
    """Limits found from times.

    Attributes
    ----------
    limits : tuple of AxisLimit
        Velocity and acceleration of each axis; the spread is the standard error.
    predicted : (n,) array
        Times by the model with the limits found, s.
    error : (n,) array
        Their relative difference from those measured.
    used : (n,) bool array
        False for programs that were left out.
    singular_values : (p,) array
        Of d log T / d log limit.
    """

    limits: tuple[AxisLimit, ...]
    predicted: FloatArray
    error: FloatArray
    used: BoolArray
    singular_values: FloatArray

    @property
    def misfit(self) -> float:
        """Median of the errors of the programs that were used."""
        return float(np.median(np.abs(self.error[self.used])))


@dataclass(frozen=True)
class _Unknown:
    """A limit that is looked for."""

    quantity: Quantity
    column: int

    def of(self, start: Limits) -> float:
        """What the start says."""
        return float(getattr(start, self.quantity.key)[self.column])


def fit_times(seconds: Seconds, measured: FloatArray, start: Limits, axes: Sequence[str]) -> TimesFit:
    """Find velocity and acceleration of some axes of a machine from the times of programs.

    Parameters
    ----------
    seconds : callable
        The model.
    measured : (n,) array
        Times, s.
    start : Limits
        Where the search begins, and what stays where the times do not tell.
    axes : sequence of str
        That the programs move.
    """
    unknown = [
        _Unknown(quantity, start.axes.index(axis))
        for quantity in (ACCELERATION, VELOCITY)
        for axis in axes
        if np.isfinite(getattr(start, quantity.key)[start.axes.index(axis)])
    ]
    used = np.ones(measured.size, dtype=bool)
    fit = _TimesProblem(seconds, np.log(measured), start, unknown)
    x = fit.solve(fit.begin(used), used)
    off = np.abs(fit.errors(x))
    odd = off > max(_ODD * float(np.median(off)), _MIN_ODD)
    if odd.any() and np.count_nonzero(~odd) > len(unknown):
        used = ~odd
        x = fit.solve(x, used)
    slopes = fit.slopes(x)[used]
    flat = np.linalg.norm(slopes, axis=0) < _FLAT
    x = np.where(flat, 0.0, x)
    error = fit.standard_errors(x, slopes, used)
    if np.count_nonzero(used) <= np.count_nonzero(~flat):
        # As many limits as programs fit any model, also a wrong one: the misfit says nothing of their errors.
        error = np.maximum(error, 2.0 * _KNOWN)
    limits = tuple(
        _limit(item, start, float(x[k]), float(error[k]), bool(flat[k]), int(np.count_nonzero(used)))
        for k, item in enumerate(unknown)
    )
    shown = np.asarray(np.linalg.svd(slopes, compute_uv=False), dtype=np.float64)
    predicted = np.asarray(seconds(fit.limits(x)))
    return TimesFit(limits, predicted, predicted / measured - 1.0, used, shown)


@dataclass(frozen=True, eq=False)
class _TimesProblem:
    """The least squares, in logarithms of limits over those of the start."""

    seconds: Seconds
    measured: FloatArray
    start: Limits
    unknown: Sequence[_Unknown]

    def limits(self, x: FloatArray) -> Limits:
        found = [
            AxisLimit(self.start.axes[item.column], item.quantity, item.of(self.start) * float(np.exp(value)), True)
            for item, value in zip(self.unknown, x, strict=True)
        ]
        return calibrated_limits(self.start, found)

    def errors(self, x: FloatArray) -> FloatArray:
        return np.asarray(np.log(self.seconds(self.limits(x))) - self.measured)

    def slopes(self, x: FloatArray) -> FloatArray:
        """D log T / d x, (programs, limits), over steps that are longer than those in which times move."""
        steps = _STEP * np.eye(x.size)
        return np.stack([(self.errors(x + h) - self.errors(x - h)) / (2.0 * _STEP) for h in steps], axis=1)

    def begin(self, used: BoolArray) -> FloatArray:
        """Where the search begins: a velocity above what is reached has no slope, so lower ones are tried too."""
        velocity = np.array([item.quantity is VELOCITY for item in self.unknown])
        found = [self.search(shift * velocity, used, _ROUGH) for shift in _SHIFTS]
        return min(found, key=lambda x: float(np.median(np.abs(self.errors(x)))))

    def solve(self, x: FloatArray, used: BoolArray) -> FloatArray:
        """Search on from x."""
        return self.search(self.search(x, used, _ROUGH), used, _FINE)

    def search(self, x: FloatArray, used: BoolArray, off: float) -> FloatArray:
        """Search from x with times that may be ``off``."""

        def residuals(y: FloatArray) -> FloatArray:
            return np.append(self.errors(y)[used] / off, y / _SPREAD)

        def rows(y: FloatArray) -> FloatArray:
            return np.vstack([self.slopes(y)[used] / off, np.eye(y.size) / _SPREAD])

        result = least_squares(
            residuals, x, jac=rows, bounds=(-_SPAN, _SPAN), loss="soft_l1", f_scale=3.0, xtol=1e-4, ftol=1e-4,
            max_nfev=_TURNS,
        )  # fmt: skip
        return np.asarray(result.x, dtype=np.float64)

    def standard_errors(self, x: FloatArray, slopes: FloatArray, used: BoolArray) -> FloatArray:
        """Standard error of every logarithm, by the slopes and the spread of what the file says."""
        off = self.errors(x)[used]
        noise = max(_FINE, float(np.sqrt(off @ off / max(off.size - x.size, 1))))
        normal = slopes.T @ slopes / noise**2 + np.eye(x.size) / _SPREAD**2
        return np.asarray(np.sqrt(np.diag(np.linalg.inv(normal))))


def _limit(item: _Unknown, start: Limits, x: float, error: float, flat: bool, programs: int) -> AxisLimit:
    axis, value = start.axes[item.column], item.of(start) * float(np.exp(x))
    if flat:
        return AxisLimit(axis, item.quantity, 0.0, False, why="the times do not depend on it")
    if error <= _KNOWN:
        return AxisLimit(axis, item.quantity, value, True, programs, error)
    why = "the times depend on it only together with others: a value that fits, near the start, is written"
    return AxisLimit(axis, item.quantity, value, False, programs, error, why, joint=True)
