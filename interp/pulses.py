"""Step and direction pulses of a plan, by the crossing times of half-step levels (reference-pulse interpolation).

    driver = StepDriver({"X": 1000.0, "Y": 1000.0})
    for block in step_pulses(profile, driver):
        send(block.tick, block.axis, block.up)

A counter follows each axis: it goes up when S q(t) exceeds the counter by half a step, down when it falls short by as
much, so that the counter is never further than half a step from the axis.  The times at which that happens are roots of
the plan's own polynomials, found in C (``interp/pulses.c``); nothing is sampled, and no error accumulates.

Between two pulses of one direction the axis moves a whole step, so their frequency is at most S times the largest velocity
of the axis.  Where an axis turns, the last pulse before and the first after it belong to one level and may be as close as
one likes: the plan passed the level by next to nothing.  Such a pair is left out where the driver could not follow it and
the level is passed by no more than ``MAX_EXCESS`` steps, which the summary tells; else the plan is refused.

Reference-pulse interpolation is what Yusoff's thesis (2022) plans for; there and in digital differential analysers the
pulses come of sums over periods.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from interp.taylor import InterpolatorTable
from planner.compiled import core
from planner.errors import BrokenLimitError, InputError
from planner.geometry.curve import ROTARY_AXES
from planner.inputs import positive_number, require_instance
from planner.profile import FeedrateProfile
from planner.types import BoolArray, FloatArray, IntArray

MAX_EXCESS = 1e-3
"""Steps by which a level may be passed where the pair of pulses of it is left out."""
_MAX_POWERS = 32  # of a curve piece, as in pulses.c
_PULSES_AT_ONCE = 1 << 16  # of an axis: bounds the memory
_MAX_TICKS = 2**55  # what a file holds
_MAX_STEPS = 2**52  # a counter is a double
_ROUNDING = 1e-9  # of a spacing: what is not worth a refusal
_EXCESS_POINTS = 33


@dataclass(frozen=True)
class StepDriver:
    """What the drives of a machine take.

    Attributes
    ----------
    steps : mapping of str to float
        Steps per mm, or per rad, of each axis by its name.
    clock_hz : float
        Of the clock whose ticks the times are rounded to; 1e9, nanoseconds, if left out.
    pulse, space : float
        Least time that a pulse is high, and low until the next, s.
    setup, hold : float
        Least time from a change of direction to a pulse, and from the end of a pulse to a change of direction, s.
    """

    steps: Mapping[str, float]
    clock_hz: float = 1e9
    pulse: float = 2.5e-6
    space: float = 2.5e-6
    setup: float = 5e-6
    hold: float = 0.0

    def __post_init__(self) -> None:
        for axis, steps in self.steps.items():
            unit = "rad" if axis in ROTARY_AXES else "mm"
            if not isfinite(positive_number(steps, f"steps per {unit} of {axis}")):
                raise InputError(f"steps per {unit} of {axis} = {steps!r} must be > 0 and finite")
        if not isfinite(positive_number(self.clock_hz, "clock_hz")):
            raise InputError(f"clock_hz = {self.clock_hz!r} must be > 0 and finite")
        for name in ("pulse", "space", "setup", "hold"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0.0):
                raise InputError(f"{name} = {value!r} s must be >= 0 and finite")
        if not self.pulse + self.space > 0.0:
            raise InputError("pulse + space = 0 s leaves no time between pulses; one of them must be > 0")
        if self.clock_hz * self.same < 1.0 - _ROUNDING:
            raise InputError(
                f"clock_hz = {self.clock_hz!r} Hz must be at least {1.0 / self.same:.6g} Hz, 1 / (pulse + space): two "
                "pulses of an axis could fall on one tick"
            )

    @property
    def same(self) -> float:
        """Least time between two pulses of one direction, s."""
        return self.pulse + self.space

    @property
    def turn(self) -> float:
        """Least time between two pulses of opposite directions, s."""
        return self.pulse + max(self.space, self.hold + self.setup)

    @property
    def max_hz(self) -> float:
        """Highest frequency of pulses that the drives take, Hz."""
        return 1.0 / self.same

    def steps_of(self, axes: tuple[str, ...]) -> FloatArray:
        """Steps per unit of axes, (dim,); InputError where those of one are missing."""
        for axis in axes:
            if axis not in self.steps:
                unit = "rad" if axis in ROTARY_AXES else "mm"
                raise InputError(
                    f"steps per {unit} of {axis} are missing; give them for each of the axes {' '.join(axes)}"
                )
        return np.array([float(self.steps[axis]) for axis in axes])


@dataclass(frozen=True, eq=False)
class PulseBlock:
    """Pulses in order of time, those of one tick in the order of the axes.

    Attributes
    ----------
    tick : (m,) int array
        Ticks of the clock since the plan began, at which a pulse rises.
    axis : (m,) uint8 array
        Index of the axis.
    up : (m,) bool array
        Towards larger coordinates.
    """

    tick: NDArray[np.int64]
    axis: NDArray[np.uint8]
    up: BoolArray

    def __len__(self) -> int:
        """Number of pulses."""
        return self.tick.size


@dataclass
class PulseSummary:
    """What is known of the pulses once all are made.

    Attributes
    ----------
    pulses : list of int
        Of each axis.
    highest_hz : list of float
        1 / the shortest time between two pulses of one direction, of each axis; 0 where there are no two.
    error_steps : float
        No counter was further than this from its axis, steps, but for what the axis moves in half a tick.
    left_out : int
        Pairs of pulses that were left out where an axis turns.
    """

    pulses: list[int] = field(default_factory=list)
    highest_hz: list[float] = field(default_factory=list)
    error_steps: float = 0.5
    left_out: int = 0


def first_counts(profile: FeedrateProfile, driver: StepDriver) -> IntArray:
    """Where the counters start, (dim,): the step nearest to the start of the plan."""
    steps = driver.steps_of(profile.curve.axes)
    return np.rint(steps * profile.curve.derivatives(profile.u[0], 0)[0]).astype(np.int64)


def step_pulses(
    profile: FeedrateProfile, driver: StepDriver, summary: PulseSummary | None = None
) -> Iterator[PulseBlock]:
    """Find the pulses of a plan, block by block, in bounded memory.

    Parameters
    ----------
    profile : FeedrateProfile
    driver : StepDriver
    summary : PulseSummary, optional
        Is filled while the blocks are taken.

    Yields
    ------
    PulseBlock

    Raises
    ------
    InputError
        If steps of an axis are missing, a time or a count is too large, or the curve is of too high a degree.
    BrokenLimitError
        If pulses follow each other closer than the driver takes: axis, place, frequency and what is allowed.
    """
    require_instance(profile, FeedrateProfile, "profile")
    require_instance(driver, StepDriver, "driver")
    summary = PulseSummary() if summary is None else summary
    table = InterpolatorTable.from_profile(profile)
    steps, counts = driver.steps_of(profile.curve.axes), first_counts(profile, driver)
    _require_room(profile, driver, steps, table)
    summary.pulses[:], summary.highest_hz[:] = [0] * table.dim, [0.0] * table.dim
    axes = [_AxisPulses(profile, table, driver, j, float(steps[j]), int(counts[j]), summary) for j in range(table.dim)]
    window = _window(profile, steps)
    end = 0.0
    while end < profile.duration:
        end = min(end + window, profile.duration)
        parts = [axis.until(end) for axis in axes]
        tick = np.concatenate([np.rint(t * driver.clock_hz).astype(np.int64) for t, _ in parts])
        which = np.concatenate([np.full(t.size, j, dtype=np.uint8) for j, (t, _) in enumerate(parts)])
        order = np.lexsort((which, tick))
        if order.size:
            yield PulseBlock(tick[order], which[order], np.concatenate([up for _, up in parts])[order])


def _require_room(profile: FeedrateProfile, driver: StepDriver, steps: FloatArray, table: InterpolatorTable) -> None:
    if profile.duration * driver.clock_hz > _MAX_TICKS:
        raise InputError(
            f"clock_hz = {driver.clock_hz:g} Hz ticks more than 2^55 times in {profile.duration:.6g} s; use a slower clock"
        )
    # The pieces stay within the coordinates that a curve may have, 1e9 mm.
    far = steps * np.abs(profile.curve.derivatives(profile.u, 0)[0]).max(axis=0)
    if (far > _MAX_STEPS).any():
        j = int(np.argmax(far))
        raise InputError(
            f"steps of {profile.curve.axes[j]} = {steps[j]:g} make {far[j]:.3g} steps of its way; at most 2^52 are counted"
        )
    if table.pieces.shape[2] > _MAX_POWERS:
        raise InputError(
            f"{profile.curve.name}: its pieces are of degree {table.pieces.shape[2] - 1}; pulses are found up to degree "
            f"{_MAX_POWERS - 1}"
        )


def _window(profile: FeedrateProfile, steps: FloatArray) -> float:
    """Time in which the fastest axis makes about as many pulses as are held at once, s."""
    velocity = profile.curve.derivatives(profile.u, 1)[1] * profile.u_rate[:, None]
    return _PULSES_AT_ONCE / max(1.0, float((steps * np.abs(velocity)).max()))


class _AxisPulses:
    """The pulses of one axis, taken up to later and later times."""

    def __init__(
        self,
        profile: FeedrateProfile,
        table: InterpolatorTable,
        driver: StepDriver,
        axis: int,
        steps: float,
        count: int,
        summary: PulseSummary,
    ) -> None:
        self._profile, self._driver, self._axis, self._steps = profile, driver, axis, steps
        self._summary = summary
        self._state = np.array([0.0, 0.0, float(count)])
        self._times, self._up = np.empty(_PULSES_AT_ONCE), np.empty(_PULSES_AT_ONCE, dtype=np.uint8)
        sizes = table.segments.shape[0] - 1, table.dim, *table.pieces.shape[1:]
        self._run = (*sizes, axis, _PULSES_AT_ONCE, steps), (table.duration, *table.arrays)
        self._waiting: tuple[FloatArray, BoolArray] = np.empty(0), np.empty(0, dtype=bool)
        self._last = -inf, True  # time and direction of the pulse before those that wait

    def until(self, end: float) -> tuple[FloatArray, BoolArray]:
        """Times and directions of the pulses that come next and that nothing after ``end`` can change."""
        found = [self._waiting]
        while True:
            (sizes, arrays), state = self._run, self._state
            count = core.pulses_run(*sizes, end, *arrays, state, self._times, self._up)
            found.append((self._times[:count].copy(), self._up[:count].astype(bool)))
            if count < self._times.size:
                break
        t, up = (np.concatenate(parts) for parts in zip(*found, strict=True))
        t, up = self._without_close_pairs(t, up)
        done = t.size if end >= self._profile.duration else int(np.searchsorted(t, end - self._driver.turn))
        self._waiting = t[done:], up[done:]
        self._require_spacing(t[:done], up[:done])
        self._summary.pulses[self._axis] += done
        return t[:done], up[:done]

    def _without_close_pairs(self, t: FloatArray, up: BoolArray) -> tuple[FloatArray, BoolArray]:
        """Leave out the pairs about a turn that the driver could not follow."""
        close = (up[1:] != up[:-1]) & (np.diff(t) < self._driver.turn * (1.0 - _ROUNDING))
        if not close.any():
            return t, up
        kept: list[int] = []
        for k in range(t.size):
            if kept and up[kept[-1]] != up[k] and t[k] - t[kept[-1]] < self._driver.turn * (1.0 - _ROUNDING):
                self._leave_out(float(t[kept[-1]]), float(t[k]))
                kept.pop()
            else:
                kept.append(k)
        return t[kept], up[kept]

    def _leave_out(self, first: float, second: float) -> None:
        """Take note of a pair that is left out; refuse to where the level is passed by too much."""
        at = np.linspace(first, second, _EXCESS_POINTS)
        q = self._profile.curve.derivatives(self._profile.at(at).u, 0)[0][:, self._axis]
        excess = self._steps * float(np.abs(q - q[0]).max())
        if excess > MAX_EXCESS:
            raise self._refusal(first, second, self._driver.turn, "where it turns")
        self._summary.error_steps = max(self._summary.error_steps, 0.5 + excess)
        self._summary.left_out += 1

    def _require_spacing(self, t: FloatArray, up: BoolArray) -> None:
        """Refuse pulses that follow each other closer than the driver takes, and remember the last."""
        if not t.size:
            return
        before, way = np.append(self._last[0], t), np.append(self._last[1], up)
        gap, same = np.diff(before), way[1:] == way[:-1]
        needed = np.where(same, self._driver.same, self._driver.turn) * (1.0 - _ROUNDING)
        close = np.flatnonzero(gap < needed)
        if close.size:
            k = int(close[0])
            which = "" if same[k] else "where it turns"
            allowed = self._driver.same if same[k] else self._driver.turn
            raise self._refusal(float(before[k]), float(before[k + 1]), allowed, which)
        if same.any():
            highest = self._summary.highest_hz
            highest[self._axis] = max(highest[self._axis], 1.0 / float(gap[same].min()))
        self._last = float(t[-1]), bool(up[-1])

    def _refusal(self, first: float, second: float, allowed: float, where: str) -> BrokenLimitError:
        axis, unit = self._profile.curve.axes[self._axis], self._profile.curve.axis_units[self._axis]
        place = self._profile.curve.derivatives(self._profile.at(np.array([second])).u, 0)[0][0, self._axis]
        hz = 1.0 / max(second - first, 1e-300)
        said = f" {where}" if where else ""
        return BrokenLimitError(
            f"{axis}: pulses at {hz:.6g} Hz{said}, {1e6 * (second - first):.4g} us apart at t = {second:.6f} s, {axis} = "
            f"{place:.6g} {unit}; the driver takes {1.0 / allowed:.6g} Hz there, {1e6 * allowed:.4g} us; plan with a lower "
            f"velocity of {axis}, or take fewer steps per {unit}"
        )


def highest_frequency(profile: FeedrateProfile, driver: StepDriver) -> FloatArray:
    """What no frequency of pulses exceeds, (dim,), Hz: steps times the highest velocity that the limits leave an axis.

    Between two pulses of one direction the axis moves a whole step.  No linear axis is faster than the feed.  inf where
    there is no limit, or the plan says none.
    """
    axes = profile.curve.axes
    if profile.limits is None:
        return np.full(len(axes), inf)
    own = profile.limits.on(profile.curve)
    feed = own.feed if profile.curve.feed_caps is None else max(own.feed, own.rapid)
    return driver.steps_of(axes) * np.minimum(own.velocity, [inf if a in ROTARY_AXES else feed for a in axes])
