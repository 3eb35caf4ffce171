"""The time-optimal plan of a section without a jerk limit, by two passes over its controllable range.

In the section's coordinate y, without rest blends, x = y_dot^2 is linear on every interval, a = y_ddot = x'/2 constant.
With q the machine axes (and the tip's arc length), rows and caps of ``rows.py`` read

    |q''(y) x + q'(y) a| <= A,     x <= cap(y),

linear in (x_k, a) at any point of an interval.  They are asked for at five points of each, both ends included, so that
what the law exceeds between them is of the fourth order.  Backward, the range [least, largest] of x from which the end
can be reached; forward, the largest x of the range of the next knot that can be reached.  From rest to rest the range
holds x = 0 everywhere, so there is always a plan; q' = 0 needs no care of its own.

Then the law is measured as it will run (``law.utilisation``).  Where it exceeds its limits by much, the grid is halved
there; where by little, the limits are tightened in that interval.  At last the whole grid is halved until that saves
nothing any more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.compiled import core
from planner.errors import InfeasibleError, SolverError
from planner.gauss import gauss_legendre
from planner.law import TimeLaw
from planner.machine.feed_limits import COMMANDS, command_kind
from planner.machine.limits import Limits
from planner.plan.ends import Feed, feed_at
from planner.plan.guess import FeedGuess, guess_feed
from planner.plan.knots import Grid, place_knots, with_blends
from planner.plan.rows import GridRows, acceleration_rows, path_at, speed_limits
from planner.plan.section import Section
from planner.plan.utilisation import Utilisation, utilisation
from planner.quantity import CHORD_ERROR, FEED
from planner.status import Work
from planner.types import FloatArray

_PARTS = 4  # of an interval, at whose ends the limits are asked for
_FASTEST = 1e4  # times the mean speed of the guess; stands for no bound
_MAX_ROUNDS, _MAX_LAPS = 40, 60
# An interval that exceeds its limits by more is halved, by less it is tightened; what is left slows the section down.
_TOO_COARSE, _MET, _MET_PRESCRIBED = 1.001, 1.0 + 2e-6, 1.0 + 2e-8
_STEP_SHARE = 1e-5  # of the time, for a start or a stop at once
# Tightened by this many times the excess: the peaks between the points measured are a little higher.
_MARGIN_GAIN = 1.05
# The grid is halved until that saves less than this share of the time, so many times and up to so many intervals.
_WORTH_HALVING, _MAX_HALVINGS, _MAX_INTERVALS = 5e-5, 4, 200_000
_MAX_LEANS, _WORTH_LEANING, _GAUSS_POINTS = 6, 1e-6, 8
_ATTAINABLE = 1e-12
_SEAM = 1e-10  # of x: a closed path may end by so much below its start
# Digits of place and time may make this share of an acceleration limit at nodes close to one another.
_ROUNDING_SHARE = 1e-6
_PERCENT = 0.01
_ROUNDED = 1e-12  # of the time


@dataclass(frozen=True, eq=False)
class _SpeedGrid:
    """A grid of one section with its rows and caps at the points of all intervals.

    ``y``, ``u`` (n + 1,) at the knots, ``rate (2, n, 2)`` the first two derivatives of u by y at both ends of each
    interval; ``rows`` with r (m, 2, n, p), ``speeds`` the largest x (n, p) by each speed limit, ``command (n, p)`` what the
    feed is of these (0 that of the limits, 1 a programmed one, 2 that of rapids); ``margin (2, n)`` by which
    speeds and accelerations are tightened; ``ends`` the x prescribed at the ends, nan where free (periodic).
    """

    y: FloatArray
    u: FloatArray
    rate: FloatArray
    offset: FloatArray
    rows: GridRows
    speeds: dict[str, FloatArray]
    command: NDArray[np.int8]
    margin: FloatArray
    ends: tuple[float, float]
    lean: FloatArray

    @classmethod
    def on(cls, section: Section, limits: Limits, y: FloatArray, u: FloatArray, mean: float) -> _SpeedGrid:
        h = np.diff(y)
        share = np.linspace(0.0, 1.0, _PARTS + 1)
        offset = h[:, None] * share
        at = y[:-1, None] + offset
        at[:, -1] = y[1:]
        inner = section.parameter((at + section.y_start).reshape(-1)).reshape(at.shape)
        inner[:, 0], inner[:, -1] = u[:-1], u[1:]
        inner = np.maximum.accumulate(np.clip(inner, u[:-1, None], u[1:, None]), axis=1)
        left = inner == u[1:, None]
        path = path_at(section, limits, at.reshape(-1), inner.reshape(-1), left.reshape(-1))
        rows = acceleration_rows(limits, path)
        speeds = {
            name: np.minimum(most**2, (_FASTEST * mean) ** 2).reshape(at.shape)
            for name, most in speed_limits(limits, path).items()
        }
        ends = [
            (end.feed / path.tip[1, k]) ** 2 if isinstance(end, Feed) else feed_at(end)
            for end, k in ((section.start, 0), (section.end, -1))
        ]
        return cls(
            y,
            u,
            path.u[1:3].reshape(2, *at.shape)[:, :, [0, -1]],
            np.ascontiguousarray(offset),
            replace(rows, given=np.ascontiguousarray(rows.r.reshape(*rows.r.shape[:2], *at.shape))),
            speeds,
            command_kind(section.curve, limits, inner.reshape(-1), left.reshape(-1)).reshape(at.shape),
            np.tile(1.0 / section.usable(u[:-1]), (2, 1)),
            (ends[0], ends[1]),
            np.zeros(h.size),
        )

    def led(self) -> tuple[_SpeedGrid, FloatArray]:
        """Solve, and let the accelerations lean along the rows that they follow as long as that saves time."""
        best, x = self, self.solve()
        for _ in range(_MAX_LEANS if x.size else 0):
            lean = np.empty_like(self.lean)
            rows, bounds, size = self._tight_rows()
            core.accelerations_follow_rows(*size, rows, bounds, self.offset, x, best.lean, lean)
            stage = replace(self, lean=lean)
            again = stage.solve()
            if again.size == 0:
                break
            gain = 1.0 - float(stage.time(again).sum()) / float(best.time(x).sum())
            if gain > 0.0:
                best, x = stage, again
            if gain < _WORTH_LEANING:
                break
        return best, x

    def solve(self) -> FloatArray:
        """Largest x at the knots, or empty where none joins the ends."""
        cap = self._cap()
        for value, at in ((self.ends[0], (0, 0)), (self.ends[1], (-1, -1))):
            if not np.isnan(value):
                cap[at] = max(cap[at], value)
        if np.isnan(self.ends[0]):
            return self._lap(cap)
        return self._passes(cap, *self.ends)

    def _cap(self) -> FloatArray:
        """Largest x (n, p) by all speed limits, tightened."""
        return np.asarray(np.min(list(self.speeds.values()), axis=0) / self.margin[0][:, None] ** 2)

    def _tight_rows(self) -> tuple[FloatArray, FloatArray, tuple[int, int, int]]:
        """Coefficients of the rows, tightened; their bounds; numbers of rows, intervals and points of each."""
        rows = np.ascontiguousarray(self.rows.r * self.margin[1][:, None])
        return rows, self.rows.bounds, (rows.shape[0], *self.offset.shape)

    def _passes(self, cap: FloatArray, start: float, end: float, below: float = 0.0) -> FloatArray:
        reach, x = np.empty((2, self.y.size)), np.empty(self.y.size)
        rows, bounds, size = self._tight_rows()
        stage = *size, rows, bounds, cap, self.offset, self.lean
        core.accelerations_controllable(*stage, end * (1.0 - below), end, reach)
        least, largest = reach[:, 0]
        if not least * (1.0 - _ATTAINABLE) <= start <= largest * (1.0 + _ATTAINABLE):
            return np.empty(0)
        core.accelerations_fastest(*stage, reach, start, x)
        return x

    def _lap(self, cap: FloatArray) -> FloatArray:
        """Largest x of a closed path: the largest feed at the seam with which a lap can begin and end."""
        reach, x = np.empty((2, self.y.size)), np.empty(self.y.size)
        rows, bounds, size = self._tight_rows()
        stage = *size, rows, bounds, cap, self.offset, self.lean
        seam = float(min(cap[0, 0], cap[-1, -1]))
        for _ in range(_MAX_LAPS):
            core.accelerations_controllable(*stage, 0.0, seam, reach)
            lap = min(seam, float(reach[1, 0]))
            core.accelerations_fastest(*stage, reach, lap, x)
            lap = min(lap, float(x[-1]))
            if lap >= seam * (1.0 - _ATTAINABLE):
                break
            seam = lap
        return self._passes(cap, lap, lap, _SEAM)

    def time(self, x: FloatArray) -> FloatArray:
        """Time of each interval: in closed form for a linear x, and by Gauss what the lean changes."""
        root, h = np.sqrt(x), self.offset[:, -1]
        with np.errstate(divide="ignore"):
            time = np.asarray(2.0 * h / (root[1:] + root[:-1]))
        k = np.flatnonzero(self.lean)
        points, weights = gauss_legendre(_GAUSS_POINTS)
        w = 0.5 * (points + 1.0)
        linear = x[k, None] * (1.0 - w) + x[k + 1, None] * w
        bent = linear + 2.0 * (self.lean[k] * h[k])[:, None] * (w * (1.0 - w))
        time[k] += 0.5 * h[k] * ((bent**-0.5 - linear**-0.5) @ weights)
        return time

    def stepping(self, x: FloatArray) -> NDArray[np.bool_]:
        """Intervals in which an unlimited acceleration takes x from rest to its cap, or back, too slowly."""
        cap = self._cap()
        steps = ((x[:-1] == 0.0) & (x[1:] > 0.99 * cap[:, -1])) | ((x[1:] == 0.0) & (x[:-1] > 0.99 * cap[:, 0]))
        time = self.time(x)
        return np.asarray(steps & (time > _STEP_SHARE * time.sum()))

    def law(self, x: FloatArray) -> TimeLaw:
        """Nodes of the law: two at each inner knot, where the acceleration jumps."""
        pairs = np.stack([x[:-1], x[1:]], axis=1)
        a = 0.5 * np.diff(pairs, axis=1) / self.offset[:, -1:] + self.lean[:, None] * np.array([1.0, -1.0])
        rate = self.rate[0] * np.sqrt(pairs)
        acceleration = self.rate[1] * pairs + self.rate[0] * a
        t = np.concatenate([[0.0], np.cumsum(self.time(x))])
        return TimeLaw(np.repeat(t, 2)[1:-1], np.repeat(self.u, 2)[1:-1], rate.reshape(-1), acceleration.reshape(-1))

    def tightened(self, used: Utilisation) -> _SpeedGrid:
        """The same with tighter limits in the intervals that exceed them."""
        excess = np.stack([used.speed[::2], used.acceleration[::2]])
        return replace(self, margin=self.margin * np.where(excess > 1.0, 1.0 + _MARGIN_GAIN * (excess - 1.0), 1.0))


@dataclass(frozen=True, eq=False)
class WithoutJerk:
    """A section planned without a jerk limit.

    Attributes
    ----------
    law : TimeLaw
    unmet : float
        By how much the law still has to be slowed down to keep its limits everywhere, >= 1.
    place : float
        The curve parameter at which it has to be slowed down most.
    work : Work
    saved : mapping
        Time that one percent more of each limit saves, s, by the limit's name.
    """

    law: TimeLaw
    unmet: float
    place: float
    work: Work
    saved: Mapping[str, float]


def plan_without_jerk(section: Section, limits: Limits, intervals: int) -> WithoutJerk:
    """Plan one section with speed and acceleration limits only.

    Parameters
    ----------
    section : Section
    limits : Limits
        Their jerk is ignored.
    intervals : int
        Number of grid intervals to begin with.

    Returns
    -------
    WithoutJerk

    Raises
    ------
    InfeasibleError
        If the limits do not join the feeds prescribed at the ends.
    """
    guess = guess_feed(section, limits, intervals)
    blended = with_blends(section, guess)
    # The same knots as with a jerk limit, dense at rest, mapped to the coordinate without blends.
    grid = place_knots(blended, guess, intervals)
    plain = replace(section, blend_start=0.0, blend_end=0.0)
    y, u = blended.position(grid.sigma) - plain.y_start, grid.u
    single = _apart(guess, grid, y)
    y, u = y[single], u[single]
    mean = float(y[-1]) / guess.duration
    closest = _closest(guess)
    best = _refined(plain, limits, y, u, mean, closest)
    halvings = 0
    while halvings < _MAX_HALVINGS and 2 * (best[0].y.size - 1) <= _MAX_INTERVALS:
        stage = best[0]
        finer = _refined(plain, limits, *_halved(plain, stage, np.ones(stage.y.size - 1, dtype=bool)), mean, closest)
        gain = 1.0 - _duration(finer) / _duration(best)
        if gain > 0.0:
            best = finer
        halvings += 1
        if gain < _WORTH_HALVING:
            break
    stage, x, unmet, place, rounds = best
    work = Work(intervals=stage.y.size - 1, iterations=rounds, rounds=rounds, slowdown=unmet)
    return WithoutJerk(stage.law(x), unmet, place, work, _saved(stage, x))


_Found = tuple[_SpeedGrid, FloatArray, float, float, int]


def _duration(found: _Found) -> float:
    stage, x, unmet, *_ = found
    return float(stage.time(x).sum()) * unmet


def _closest(guess: FeedGuess) -> tuple[FloatArray, FloatArray]:
    """Times between nodes from which on they tell an acceleration, at the coordinates of a scan.

    A digit e = eps (|u| |dq/du| + v t + L) in the place of a node, its time and the arc length, h between nodes, is
    12 e / h^2 of it.
    """
    digit = np.finfo(float).eps * (np.abs(guess.u) * guess.speed + guess.feed * guess.time + guess.length[-1])
    return guess.y, np.sqrt(12.0 * digit / (_ROUNDING_SHARE * guess.acceleration))


def _apart(guess: FeedGuess, grid: Grid, y: FloatArray) -> NDArray[np.bool_]:
    """Which knots to keep: one of each double one, and none between breaks that rounding hardly tells from another."""
    keep = np.append((np.diff(y) > 0.0) & (np.diff(grid.u) > 0.0), True)
    at = guess.y[0] + y
    time, least = np.interp(at, guess.y, guess.time), np.interp(at, *_closest(guess))
    if not (np.diff(time[keep]) < least[keep][1:]).any():
        return keep
    on_break = np.isin(grid.u, grid.u[grid.left])
    on_break[0] = True
    following = np.searchsorted(np.flatnonzero(on_break), np.arange(y.size), side="right")
    next_break = np.append(time[on_break], np.inf)[following]
    last = time[0]
    break_before = time[on_break][following - 1]
    for k in np.flatnonzero(keep & ~on_break):
        last = max(last, break_before[k])
        keep[k] = min(time[k] - last, next_break[k] - time[k]) >= least[k]
        last = time[k] if keep[k] else last
    return keep


def _refined(
    section: Section,
    limits: Limits,
    y: FloatArray,
    u: FloatArray,
    mean: float,
    closest: tuple[FloatArray, FloatArray],
) -> _Found:
    """Solve, and halve intervals and tighten limits until the law keeps them between the knots too."""
    stage = _SpeedGrid.on(section, limits, y, u, mean)
    best: _Found | None = None
    for round_ in range(1, _MAX_ROUNDS + 1):
        stage, x = stage.led()
        if x.size == 0:
            if best is None:
                raise InfeasibleError(_not_joined(section))
            break
        still = np.flatnonzero(~np.isfinite(stage.time(x)))
        if still.size:
            raise SolverError(
                f"{section.curve.name}: no plan found near u = {stage.u[still[0]]:.9g}, where the limits leave no feed; "
                "split the curve there, or ask for more intervals"
            )
        used = utilisation(section.curve, limits, stage.law(x))
        slowdown = np.maximum(used.speed, np.sqrt(used.acceleration))[::2]
        unmet = max(1.0, float(slowdown.max()))
        stepping = stage.stepping(x)
        found = (stage, x, unmet, float(stage.u[int(slowdown.argmax())]), round_)
        if best is None or _duration(found) < _duration(best):
            best = found
        if unmet <= (_MET_PRESCRIBED if section.has_prescribed_feed else _MET) and not stepping.any():
            break
        coarse = (slowdown > _TOO_COARSE) | stepping
        coarse &= stage.time(x) > 2.0 * np.interp(stage.y[1:] + section.y_start, *closest)
        if coarse.any():
            y, u = _halved(section, stage, coarse)
            if y.size > stage.y.size:
                stage = _SpeedGrid.on(section, limits, y, u, mean)
                continue
        stage = stage.tightened(used)
    if best is None:
        raise SolverError("no round of refinement was run")
    return best


def _halved(section: Section, stage: _SpeedGrid, where: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Knots with these intervals halved, but for those that rounding does not let."""
    k = np.flatnonzero(where)
    y = 0.5 * (stage.y[k] + stage.y[k + 1])
    u = section.parameter(y + section.y_start)
    inside = (u > stage.u[k]) & (u < stage.u[k + 1]) & (y > stage.y[k]) & (y < stage.y[k + 1])
    k = k[inside] + 1
    return np.insert(stage.y, k, y[inside]), np.insert(stage.u, k, u[inside])


def _saved(stage: _SpeedGrid, x: FloatArray) -> dict[str, float]:
    """Seconds that one percent more of each limit saves: solved again with it."""
    time = float(stage.time(x).sum())
    relaxed: dict[str, _SpeedGrid] = {}
    for name, most in stage.speeds.items():
        # x grows with the square of a speed, and with the chord error itself
        more = 1.0 + _PERCENT * (1.0 if name == CHORD_ERROR.label else 2.0)
        everywhere = np.ones_like(stage.command, dtype=np.bool_)
        parts = {name: everywhere}
        if name == FEED.label:
            parts = {kind: stage.command == k for k, kind in enumerate(COMMANDS)}
        for part, where in parts.items():
            relaxed[part] = replace(stage, speeds=stage.speeds | {name: most * np.where(where, more, 1.0)})
    for row, of in enumerate(stage.rows.of):
        r = stage.rows.r.copy()
        r[row] /= 1.0 + _PERCENT
        relaxed[of.name] = replace(stage, rows=replace(stage.rows, given=r))
    saved = {}
    for name, more_of_it in relaxed.items():
        again = more_of_it.solve()
        gain = time - float(stage.time(again).sum()) if again.size else 0.0
        if gain > _ROUNDED * time:
            saved[name] = gain
    return saved


def _not_joined(section: Section) -> str:
    length = float(np.diff(section.curve.arclength.s([section.u_start, section.u_end]))[0])
    return (
        f"no plan from start_feed = {feed_at(section.start):g} to end_feed = {feed_at(section.end):g} mm/s between "
        f"u = {section.u_start:.6g} and {section.u_end:.6g} (length {length:.6g} mm) keeps the acceleration limits; lower "
        "the higher feed"
    )
