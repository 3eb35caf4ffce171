"""Limits of a machine from logs of its axes: what each log shows, put together, and what none of them shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.calibration.axis_limits import AxisLimit, axis_limits
from planner.calibration.known_path import KnownPath, known_path
from planner.calibration.laws import Laws, MotionLaw, fit_laws
from planner.calibration.log import Log
from planner.calibration.ramps import Ramp, ramps
from planner.calibration.stretches import SteadyStretch, StraightRun, stretches
from planner.errors import InputError
from planner.geometry.curve import AXES
from planner.machine.limits import Limits
from planner.programs.reading.program import Program
from planner.quantity import ACCELERATION, JERK, VELOCITY
from planner.types import BoolArray, FloatArray

_PRECISE = 0.01  # standard error of an acceleration as a share of it; beyond it tells nothing
_STEADY = 5e-3  # of its speed, by which a steady stretch may change it
_BELOW = 0.01  # of the feed that was asked for: a steady speed further below was held back
_PACES = 0.02  # by which two speeds along paths are not the same feed
_MIN_SPEED = 1e-3  # mm/s; less is a rest
_HIDDEN = 60.0  # a ramp of jerk j hides in noise for 2 (60 noise / j)^(1/3); see plateaus
_FAR, _TIMES = 5.0, (60.0, 1000.0)  # from what the machine file says, and factors between units of time
_LENGTHS = (25.4, 1000.0)  # and of length


@dataclass(frozen=True)
class Calibration:
    """What logs tell of a machine.

    Attributes
    ----------
    limits : tuple of AxisLimit
        Velocity, acceleration and jerk of each axis of the machine.
    laws : Laws
        Which law of motion fits.
    notes : tuple of str
        Gaps, columns passed over, programs that were found beside their logs.
    """

    limits: tuple[AxisLimit, ...]
    laws: Laws
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Sightings:
    """Stretches of all logs, with directions in the axes of the machine (k, d) and the feed asked for (k,)."""

    logs: Sequence[Log]
    runs: Sequence[list[StraightRun]]
    stretches: Sequence[SteadyStretch]
    direction: FloatArray
    feed: FloatArray

    def values(self, name: str) -> FloatArray:
        return np.array([getattr(stretch, name) for stretch in self.stretches], dtype=np.float64)


def calibrate_logs(
    logs: Sequence[Log], start: Limits, programs: Mapping[int, Program] | None = None, *, trust_units: bool = False
) -> Calibration:
    """Find the limits of a machine from logs.

    Parameters
    ----------
    logs : sequence of Log
    start : Limits
        The machine as its file says it: its axes, and the sizes that the logs are compared with.
    programs : mapping of int to Program, optional
        The program of a log, by its place: it says what feed was asked for, and whether log and program belong together.
    trust_units : bool
        Do not compare sizes with those of ``start``.

    Raises
    ------
    InputError
        If a log has an axis that the machine lacks, is another program's or in other units than it says.
    """
    axes = start.axes or AXES[: len(start.velocity)]
    for log in logs:
        strange = [axis for axis in log.axes if axis not in axes]
        if strange:
            raise InputError(
                f"{log.where}: the machine has no axis {strange[0]}; its axes are {', '.join(axes)}: add it to its "
                "file, or leave the column out"
            )
    known = {k: known_path(logs[k], program) for k, program in (programs or {}).items()}
    seen = _see(logs, axes, known)
    acceleration, velocity = _acceleration(seen, axes), _velocity(seen, axes, known)
    if not trust_units:
        _require_units(velocity, acceleration, start, axes)
    laws = fit_laws(_all_ramps(seen, acceleration, axes), axes)
    if laws.best is MotionLaw.S_CURVE:
        acceleration = _plateaus(seen, axes, acceleration, laws)
    notes = [note for log in logs for note in log.notes]
    for k, path in known.items():
        shifted = " beside it by " + " ".join(f"{s:.4g}" for s in path.shift) if np.any(path.shift != 0.0) else ""
        notes.append(f"{logs[k].where}: is a log of {path.program.source}{shifted}")
    moved = {axis for log in logs for j, axis in enumerate(log.axes) if np.ptp(log.position[:, j]) > 0.0}
    logged = {axis for log in logs for axis in log.axes}
    found = [_named(limit, logged, moved) for limit in (*velocity, *acceleration, *_jerk(laws, acceleration))]
    return Calibration(tuple(found), laws, tuple(notes))


def _see(logs: Sequence[Log], axes: Sequence[str], known: Mapping[int, KnownPath]) -> _Sightings:
    every: list[SteadyStretch] = []
    runs, directions, feeds = [], [np.empty((0, len(axes)))], [np.empty(0)]
    for k, log in enumerate(logs):
        own, found = stretches(log, k)
        runs.append(own)
        every += found
        columns = [axes.index(axis) for axis in log.axes]
        direction = np.zeros((len(found), len(axes)))
        if found:
            direction[:, columns] = [stretch.direction for stretch in found]
        directions.append(direction)
        feeds.append(known[k].feeds(log, found) if k in known and found else np.full(len(found), np.nan))
    return _Sightings(logs, runs, every, np.concatenate(directions), np.concatenate(feeds))


def _acceleration(seen: _Sightings, axes: Sequence[str], among: BoolArray | None = None) -> list[AxisLimit]:
    size, error = np.abs(seen.values("acceleration")), seen.values("error")
    use = (error < _PRECISE * size) & (size * _duration(seen) > _MIN_SPEED)
    if among is not None:
        use &= among
    return axis_limits(ACCELERATION, axes, seen.direction[use], size[use], error[use])


def _duration(seen: _Sightings) -> FloatArray:
    return np.array([seen.logs[s.log].t[s.last] - seen.logs[s.log].t[s.first] for s in seen.stretches])


def _all_ramps(seen: _Sightings, limits: Sequence[AxisLimit], axes: Sequence[str]) -> list[Ramp]:
    values = np.array([limit.value if limit.value > 0.0 else np.inf for limit in limits])
    found = []
    for k, log in enumerate(seen.logs):
        columns = [axes.index(axis) for axis in log.axes]
        own = [s for s in seen.stretches if s.log == k]
        for ramp in ramps(seen.runs[k], own, values[columns], log.period):
            direction = np.zeros(len(axes))
            direction[columns] = ramp.direction
            found.append(replace(ramp, direction=direction))
    return found


def _plateaus(seen: _Sightings, axes: Sequence[str], first: Sequence[AxisLimit], laws: Laws) -> list[AxisLimit]:
    """Accelerations that were held for longer than a ramp could hide in the noise; the others were perhaps never reached.

    The cubic term of a ramp of jerk j over a duration 2 h is 0.025 j h^3 from its parabola, root mean square: it shows where
    that is well above the noise.
    """
    least = np.array(
        [
            2.0 * (_HIDDEN * _run_of(seen, s).noise / max(_path_jerk(laws, d), 1e-9)) ** (1.0 / 3.0)
            for s, d in zip(seen.stretches, seen.direction, strict=True)
        ]
    )
    held = _acceleration(seen, axes, 0.6 * _duration(seen) > least)
    why = "it was not held on any move: the limit may be higher"
    return [
        a if a.known and a.value > 0.98 * b.value else replace(b, known=False, why=b.why or why)
        for a, b in zip(held, first, strict=True)
    ]


def _run_of(seen: _Sightings, stretch: SteadyStretch) -> StraightRun:
    return seen.runs[stretch.log][stretch.run]


def _path_jerk(laws: Laws, direction: FloatArray) -> float:
    values = [
        limit.value / abs(d) for limit, d in zip(laws.jerk, direction, strict=True) if d != 0.0 and limit.value > 0.0
    ]
    return min(values, default=np.inf)


def _velocity(seen: _Sightings, axes: Sequence[str], known: Mapping[int, KnownPath]) -> list[AxisLimit]:
    """Steady speeds: below the feed asked for, where that is known; else the same of an axis in two paces of the path."""
    speeds = np.abs(seen.values("speeds").reshape(-1, 2))
    speed, change = speeds.mean(axis=1), np.abs(np.diff(speeds, axis=1)[:, 0])
    steady = (speed > _MIN_SPEED) & (change <= _STEADY * speed)
    direction, feed, reached = seen.direction[steady], seen.feed[steady], speed[steady]
    error = seen.values("error")[steady] * _duration(seen)[steady]
    binds = reached < (1.0 - _BELOW) * feed  # not where no feed is known
    own = np.abs(direction) * reached[:, None]
    for j in range(len(axes)):
        top = own[:, j].max(initial=0.0)
        near = np.isnan(feed) & (own[:, j] > (1.0 - _STEADY) * top) & (top > 0.0)
        paces = reached[near]
        if paces.size and paces.max() > (1.0 + _PACES) * paces.min():
            binds = binds | near
    return axis_limits(VELOCITY, axes, direction, reached, error, binds)


def _jerk(laws: Laws, acceleration: Sequence[AxisLimit]) -> list[AxisLimit]:
    """Jerk by axis; that of a moving average is acceleration over its length, as a move from rest has it."""
    if laws.best is not MotionLaw.FIR:
        return list(laws.jerk)
    spread = laws.tau_error / laws.tau
    return [
        AxisLimit(a.axis, JERK, a.value / laws.tau, a.known, a.count, spread + a.spread, a.why) for a in acceleration
    ]


def _named(limit: AxisLimit, logged: set[str], moved: set[str]) -> AxisLimit:
    if limit.axis not in logged:
        return replace(limit, known=False, why="no log has this axis")
    return limit if limit.axis in moved else replace(limit, known=False, why="it does not move in any log")


def _require_units(
    velocity: Sequence[AxisLimit], acceleration: Sequence[AxisLimit], start: Limits, axes: Sequence[str]
) -> None:
    """Refuse logs whose speeds and accelerations are as far from the machine file's as two units are from each other.

    A unit of time that is wrong by f shows as f in speeds and f^2 in accelerations, one of length as f in both.  Speeds may
    well be far below their limits; accelerations are mostly reached.
    """
    pairs = [
        (v, a, k)
        for k, (v, a) in enumerate(zip(velocity, acceleration, strict=True))
        if a.value > 0.0 and v.value > 0.0
    ]
    finite = [(v, a, k) for v, a, k in pairs if np.isfinite(start.acceleration[k]) and np.isfinite(start.velocity[k])]
    if not finite:
        return
    speed = float(np.median([np.log(v.value / start.velocity[k]) for v, _, k in finite]))
    rate = float(np.median([np.log(a.value / start.acceleration[k]) for _, a, k in finite]))
    if abs(rate) < np.log(_FAR) and speed < np.log(_FAR):
        return
    choices = [(np.log(f), 2.0 * np.log(f), f"{f:g} in time") for f in _TIMES]
    choices += [(np.log(f), np.log(f), f"{f:g} in length") for f in _LENGTHS]
    choices += [(-v, -a, text) for v, a, text in choices]
    best = min(choices, key=lambda c: abs(rate - c[1]) + 0.2 * abs(speed - c[0]))
    if abs(rate - best[1]) > np.log(_FAR):
        return
    axis = axes[finite[0][2]]
    raise InputError(
        f"the logs show accelerations {np.exp(rate):.3g} times and speeds {np.exp(speed):.3g} times those of the machine "
        f"file ({axis}: {finite[0][1].value:.4g} against {start.acceleration[finite[0][2]]:.4g} mm/s^2), as if a unit were "
        f"wrong by {best[2]}; name the units of the columns, or confirm them (--trust-units)"
    )
