"""Blocks of a plan by S-curves: from one node to the next by ruckig, and how long they take where every limit holds."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from planner.plan.solvers.arcpath import ArcPath, advance_phase
from planner.types import FloatArray, IntArray

# Factors in time of the tops that are tried: all at once on the ladder, or the block's own ones slightly.
LADDER: FloatArray = 0.9 ** np.arange(56.0)
SLIGHTLY: FloatArray = np.array([1.0, 0.9995, 0.999, 0.998, 0.995, 0.99, 0.98, 0.96, 0.93])
_ROUND_OFF, TOLERANCE, _TINY = 1e-12, 1e-9, 1e-300
_POINTS, _NEWTON_STEPS = 5, 4  # a phase is tried at so many points evenly before it is at the trial places of the path
_CHUNK = 20_000  # blocks traced at once; bounds the memory


@dataclass
class BlockPlan:
    """Nodes, m + 1 places s with feeds v, and the m blocks between them: tops (m, 4), time (m,), inf where unknown."""

    s: FloatArray
    v: FloatArray
    tops: FloatArray
    time: FloatArray

    def ends(self, first: IntArray, last: IntArray | None = None) -> FloatArray:
        """Places and feeds (s0, v0, s1, v1) at the nodes ``first`` and ``last`` (the next ones), (4, n)."""
        last = first + 1 if last is None else last
        return np.stack([self.s[first], self.v[first], self.s[last], self.v[last]])


class Ruckig:
    """One reusable ruckig problem: a block of length 1 with no acceleration at either end."""

    def __init__(self) -> None:
        import ruckig

        self._solver, self._failure = ruckig.Ruckig(1), ruckig.RuckigError
        self._problem, self._trajectory = ruckig.InputParameter(1), ruckig.Trajectory(1)
        self._problem.current_position = self._problem.current_acceleration = self._problem.target_acceleration = [0.0]
        self._problem.target_position = [1.0]

    def solve(
        self, v0: float, v1: float, v: float, up: float, down: float, jerk: float
    ) -> tuple[list[float], ...] | None:
        """Durations and jerks of the seven phases, positions and feeds at their ends; None if ruckig finds none."""
        problem = self._problem
        problem.current_velocity, problem.target_velocity = [v0], [v1]
        problem.max_velocity, problem.max_jerk = [v], [jerk]
        # Where the acceleration is just reached, ruckig may find nothing.
        for less in (1.0, 1.0 - 1e-13, 1.0 - 1e-12, 1.0 - 1e-11):
            problem.max_acceleration, problem.min_acceleration = [up * less], [-down * less]
            with suppress(self._failure):
                if self._solver.calculate(problem, self._trajectory) >= 0:
                    profile = self._trajectory.profiles[0][0]
                    return profile.t, profile.j, profile.p, profile.v
        return None


def trace(
    solver: Ruckig, ends: FloatArray, tops: FloatArray, below: float | FloatArray = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow blocks from (s0, v0) to (s1, v1): ``ends (4, m)`` = s0, v0, s1, v1, ``tops (m, 4)``.

    Returns the duration (m,), inf where there is no block or none faster than ``below``; phase durations and jerks
    (2, m, 7); and the states s, v, a at the eight ends of the phases (3, m, 8).
    """
    s0, v0, s1, v1 = ends
    length, fast, change = s1 - s0, np.maximum(v0, v1), np.abs(v1 - v0)
    v, up, down, jerk = np.maximum(tops[:, 0], fast), tops[:, 1], tops[:, 2], tops[:, 3]
    # Over less than the length that the change of feed takes, ruckig would overshoot and come back.
    a = np.where(v1 > v0, up, down)
    ramp = np.where(change * jerk > a * a, change / a + a / jerk, 2.0 * np.sqrt(change / jerk))
    some = np.flatnonzero((0.5 * (v0 + v1) * ramp <= length * (1.0 + _ROUND_OFF)) & (length / v < below))
    # Scaled so that the block has length 1 and its largest possible feed is 1.
    unit = np.minimum(v, fast + np.cbrt(jerk * length**2))
    tau = length / unit
    scaled = np.stack([v0 / unit, v1 / unit, v / unit, up * tau / unit, down * tau / unit, jerk * tau**2 / unit])
    solved = [solver.solve(*row) for row in scaled[:, some].T.tolist()]
    some = some[np.array([found is not None for found in solved], dtype=bool)]
    phases, time, states = np.zeros((2, v.size, 7)), np.full(v.size, np.inf), np.zeros((3, v.size, 8))
    if some.size:
        h, j, p, feeds = (
            np.array(part) for part in zip(*(found for found in solved if found is not None), strict=True)
        )
        good = (feeds.min(axis=1) >= -_ROUND_OFF) & (np.abs(p[:, 7] - 1.0) <= TOLERANCE)
        some, h, j, feeds = some[good], h[good], j[good], feeds[good]
        for first in (0, 4):  # a ramp between feeds that differ by rounding only is none
            same = np.abs(feeds[:, first + 3] - feeds[:, first]) <= _ROUND_OFF * feeds.max(axis=1)
            h[same, 3] += h[same, first : first + 3].sum(axis=1)
            h[same, first : first + 3] = 0.0
        phases[:, some] = tau[some, None] * h, np.where(h > 0.0, j * (unit / tau**2)[some, None], 0.0)
        time[some] = phases[0, some].sum(axis=1)
    states[0, :, 0], states[1, :, 0] = s0, v0
    for i in range(7):
        states[:, :, i + 1] = advance_phase(states[:, :, i], phases[1, :, i], phases[0, :, i])
    return np.where(time < below, time, np.inf), phases, states


def durations(
    path: ArcPath, solver: Ruckig, ends: FloatArray, tops: FloatArray, below: FloatArray | None = None
) -> FloatArray:
    """Durations of blocks (m,); inf where a limit is exceeded or the block is not faster than ``below`` (m,)."""
    below = np.full(tops.shape[0], np.inf) if below is None else below
    if tops.shape[0] > _CHUNK:
        cuts = np.arange(_CHUNK, tops.shape[0], _CHUNK)
        parts = zip(np.split(ends, cuts, axis=1), np.split(tops, cuts), np.split(below, cuts), strict=True)
        return np.concatenate([durations(path, solver, *part) for part in parts])
    time, phases, states = trace(solver, ends, tops, below)
    active = phases[0] > 0.0
    slow = states[1, :, 3] > path.lowest_cruise(states[0, :, 3], states[0, :, 4]) * (1.0 + _ROUND_OFF)
    time[(active[:, 3] & slow) | (active & (phases[0] < path.shortest)).any(axis=1)] = np.inf
    ramps = active & (np.arange(7) != 3)
    for pick in (_spread, _at_trial_places):  # the few points of the first refute most blocks
        block, phase = np.nonzero(np.isfinite(time)[:, None] & ramps)
        h, jerk, begin = *phases[:, block, phase], states[:, block, phase]
        each, since = pick(path, h, jerk, begin, states[:2, block, phase + 1])
        s, v, a = advance_phase(begin[:, each], jerk[each], since)
        used = path.used(s, v, a, jerk[each])
        time[block[each[used > 1.0 + _ROUND_OFF]]] = np.inf
    return time


def _spread(
    path: ArcPath, h: FloatArray, jerk: FloatArray, begin: FloatArray, end: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Times since the beginning of phases (m,), spread evenly, and the phase each belongs to."""
    return np.repeat(np.arange(h.size), _POINTS), (h[:, None] * np.linspace(0.0, 1.0, _POINTS)).reshape(-1)


def _at_trial_places(
    path: ArcPath, h: FloatArray, jerk: FloatArray, begin: FloatArray, end: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The same for the places at which the path asks for a trial: Newton from the time constant acceleration takes."""
    first, last = (np.searchsorted(path.trials, s) for s in (begin[0], end[0]))
    count = last - first
    each = np.repeat(np.arange(h.size), count)
    s = path.trials[np.arange(each.size) + np.repeat(first - np.cumsum(count) + count, count)]
    (s0, v0, _), (s1, v1), jerk = begin[:, each], end[:, each], jerk[each]
    mean = v0 + np.sqrt(np.maximum(v0**2 + (v1**2 - v0**2) * (s - s0) / np.maximum(s1 - s0, _TINY), 0.0))
    since = np.minimum(2.0 * (s - s0) / np.maximum(mean, _TINY), h[each])
    for _ in range(_NEWTON_STEPS):
        at = advance_phase(begin[:, each], jerk, since)
        since = np.clip(since - (at[0] - s) / np.maximum(at[1], _TINY), 0.0, h[each])
    return each, since


def block_phases(solver: Ruckig, plan: BlockPlan) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Phases of a plan: durations and jerks (n,), and states (3, n + 1) at their beginnings and at the end."""
    _, phases, states = trace(solver, plan.ends(np.arange(plan.time.size)), plan.tops)
    # A block ends some digits off its end.  What that adds to the jerk of a phase goes with 1 / h^3, so h^3 shares it out.
    share = np.cumsum(phases[0] ** 3, axis=1)
    share /= np.where(share[:, -1:] > 0.0, share[:, -1:], 1.0)
    states[0, :, 1:] += (plan.s[1:] - states[0, :, -1])[:, None] * share
    resolved = 4.0 * np.finfo(np.float64).eps * plan.time.sum()  # a shorter phase begins and ends at one time
    block, phase = np.nonzero(phases[0] > resolved)
    begin = np.flatnonzero(np.append(True, (phase[1:] != 3) | (phase[:-1] != 3)))  # two cruises in a row are one
    h = np.add.reduceat(phases[0, block, phase], begin)
    block, phase = block[begin], phase[begin]
    end = np.array([[plan.s[-1]], [plan.v[-1]], [0.0]])
    return h, phases[1, block, phase], np.append(states[:, block, phase], end, axis=1)


def dilated_tops(f: FloatArray) -> FloatArray:
    """Factors (n, 4) of a block's tops that stretch its time by 1/f."""
    return np.asarray(f[:, None] ** np.array([1.0, 2.0, 2.0, 3.0]))
