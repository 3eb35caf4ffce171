"""How the acceleration passes from one stretch to the next: at once, at a jerk, or in a time of its own.

    acceleration
    a1        ________      duration of a ramp by model:
             /              trapezoid   0
    a0 _____/               S-curve     |a1 - a0| / jerk of the path
            |--| duration   FIR         tau, the length of the moving average, whatever a1 - a0

1. Between two stretches that are at their limit or at rest, a ramp is fitted to the positions: its middle and its duration
   by search, the rest by linear least squares.
2. Each model gives every ramp a duration; what positions are then off is its misfit.
3. A ramp shorter than three samples looks as a step does.

Where all ramps are as high as each other, S-curve and FIR are the same motion: then that is said.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.calibration.axis_limits import path_limit
from planner.calibration.stretches import SteadyStretch, StraightRun
from planner.types import FloatArray

RESOLVED = 3.0  # periods
_HIGH = 0.5  # of the limit: a ramp is at least as high
_FULL = 0.03  # of the limit, by which an acceleration may be below it
_REACH = 3.0  # durations of the gap between two stretches that are looked at on either side ...
_MIN_REACH = 8  # ... at least so many samples ...
_MAX_REACH = 400  # ... and at most
_STRANGE, _PART = 3.0, 0.01  # of the noise, and of the misfit of a step: a ramp that is off by more is none
_GRID = 20  # durations that are tried before the search
_STEPS = 25  # of the golden section, each 0.62 of the one before
_TURNS = 3  # of the search for the middle, which is nearly linear


@dataclass(frozen=True, eq=False)
class Ramp:
    """The samples around one ramp: time and way (n,), accelerations before and after, where these would meet."""

    t: FloatArray
    way: FloatArray
    noise: float
    before: float
    after: float
    centre: float
    period: float
    direction: FloatArray

    @property
    def height(self) -> float:
        """Size of the change of acceleration, mm/s^2."""
        return abs(self.after - self.before)

    @cached_property
    def is_odd(self) -> bool:
        """Whether no ramp fits: something else happens there."""
        return self.least / self.t.size > (_STRANGE * self.noise) ** 2 and self.least > _PART * self.misfit(0.0)

    @property
    def longest(self) -> float:
        """More than this no ramp here can last, s."""
        return float(self.t[-1] - self.t[0])

    def misfit(self, duration: float) -> float:
        """Sum of squares of what positions are off a ramp of this duration, mm^2, wherever it stands best.

        The way is linear in all but the middle, which moves by Gauss-Newton steps.
        """
        x = 2.0 * (self.t - self.t[0]) / self.longest - 1.0
        plain = np.vander(x, 3, increasing=True)
        centre = self.centre
        for _ in range(_TURNS):
            shape, slope = ramp_way(self.t - centre, duration)
            moved = np.linalg.lstsq(np.column_stack([plain, shape, -slope]), self.way, rcond=None)[0]
            if moved[3] == 0.0:
                break
            centre = float(np.clip(centre + moved[4] / moved[3], self.t[0], self.t[-1]))
        columns = np.column_stack([plain, ramp_way(self.t - centre, duration)[0]])
        off = self.way - columns @ np.linalg.lstsq(columns, self.way, rcond=None)[0]
        return float(off @ off)

    @cached_property
    def duration(self) -> float:
        """What fits best, s."""
        tried = np.linspace(0.0, 1.0, _GRID) ** 2 * self.longest
        sizes = [self.misfit(float(d)) for d in tried]
        k = int(np.argmin(sizes))
        low, high = float(tried[max(k - 1, 0)]), float(tried[min(k + 1, _GRID - 1)])
        return golden(self.misfit, low, high)[0]

    @cached_property
    def least(self) -> float:
        """Its misfit, mm^2."""
        return self.misfit(self.duration)

    @cached_property
    def error(self) -> float:
        """Standard error of the duration, s: where the misfit is larger by one variance of the noise."""
        step = max(0.1 * self.duration, 0.5 * self.period)
        rise = self.misfit(self.duration + step) - self.least
        variance = max(self.noise**2, self.least / max(self.t.size - 6, 1))
        return float(step * np.sqrt(variance / rise)) if rise > 0.0 else self.longest


def ramp_way(t: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
    """Way and speed of an acceleration that rises from 0 to 1 in ``duration`` around t = 0."""
    x = t + 0.5 * duration
    inside, beyond = np.clip(x, 0.0, duration), np.maximum(x - duration, 0.0)
    if duration <= 0.0:
        return 0.5 * beyond**2, beyond
    way = inside**3 / (6.0 * duration) + 0.5 * duration * beyond + 0.5 * beyond**2
    return way, inside**2 / (2.0 * duration) + beyond


def ramps(
    runs: Sequence[StraightRun], stretches: Sequence[SteadyStretch], limits: FloatArray, period: float
) -> list[Ramp]:
    """Ramps of a log between stretches at the limit of acceleration, (d,) by axis, or at none."""
    found = []
    for number, run in enumerate(runs):
        whole = [s for s in stretches if s.run == number and _is_whole(s, limits)]
        for a, b in itertools.pairwise(whole):
            full = float(path_limit(limits, run.direction[None])[0])
            if abs(a.acceleration - b.acceleration) > _HIGH * full:
                found.append(_ramp(run, a, b, period))
    return found


def _is_whole(stretch: SteadyStretch, limits: FloatArray) -> bool:
    """Whether an acceleration is at its limit, or none."""
    full = float(path_limit(limits, np.array([stretch.direction]))[0])
    share = abs(stretch.acceleration) / full
    return share < _FULL or share > 1.0 - _FULL


def _ramp(run: StraightRun, a: SteadyStretch, b: SteadyStretch, period: float) -> Ramp:
    first, last = a.last - run.first, b.first - run.first
    reach = int(np.clip(_REACH * max(last - first, 0), _MIN_REACH, _MAX_REACH))
    rows = slice(max(a.first - run.first, first - reach), min(b.last - run.first, last + reach) + 1)
    # Where the speed of one reaches that of the other.
    early, late = float(run.t[first]), float(run.t[last])
    rise = a.acceleration - b.acceleration
    centre = (b.speeds[0] - b.acceleration * late - a.speeds[1] + a.acceleration * early) / rise
    centre = float(np.clip(centre, min(early, late), max(early, late)))
    return Ramp(run.t[rows], run.way[rows], run.noise, a.acceleration, b.acceleration, centre, period, run.direction)


def golden(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Minimum of a function with one valley, by the golden section."""
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    a, b = low, high
    c, d = b - ratio * (b - a), a + ratio * (b - a)
    fc, fd = function(c), function(d)
    for _ in range(_STEPS):
        if fc < fd:
            b, d, fd = d, c, fc
            c = b - ratio * (b - a)
            fc = function(c)
        else:
            a, c, fc = c, d, fd
            d = a + ratio * (b - a)
            fd = function(d)
        if b - a < 1e-9:
            break
    return (c, fc) if fc < fd else (d, fd)
