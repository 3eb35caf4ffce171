"""Which stretches of a program are found jointly, path and feed as one problem, and why the others are not.

A run goes from one exact stop to the next: one that the program demands, one beside a rapid, where the tool turns back,
where the feed begins to be measured along other axes at quite another rate, and where blocks without a tolerance begin or
end.  Each is a problem of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from planner.errors import SolverError
from planner.geometry.chain import Kind
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.geometry.differential import dot
from planner.joint.joint_run import JointMotion, JointRun
from planner.joint.solve import solve_run
from planner.joint.straight import reachable_acceleration
from planner.machine.limits import Limits
from planner.programs.path.corners import Junction, Junctions
from planner.programs.path.joint_pieces import JointPart, feet, pieces_of
from planner.programs.path.moves import MovingBlocks, scale_of
from planner.programs.path.sides import AllowedSides
from planner.programs.reading.program import FEED_GROUPS
from planner.quantity import AXIS
from planner.types import FloatArray, IntArray

_MAX_BLOCKS = 20_000  # of a run: bounds the memory of its solver
# Of a run most of whose blocks go on smoothly: the time of its solver, where there is little to gain.
_MAX_SMOOTH, _SMOOTH_SHARE = 500, 0.8
# A run of more blocks to a corner, half of which swing by less than this share of the tolerance: of twelve such runs no end
# was found, after 4 to 12 ms a block instead of one, and the path made first uses all of the tolerance.
_MAX_FINE, _FINE = 64, 0.5
# Blocks shorter than so many tolerances are passed within the swing beside a vertex: of many of them no end is found.
_SHORT, _MAX_SHORT = 5.0, 60
_MAX_APART = 100.0  # times the jerk limit of one axis that of another; beyond it no one unit of time serves the solver
_MAX_SLOWED = 5e-3  # a motion that exceeds its limits by more in time is none
_LOOKED_AT = 12  # of a piece, at which its distance from the block is
# What is aimed at, one try after the other, and what will do, of the tolerance: the measure of the whole path refines what
# points tell.
_AIMS, _MET = (0.9995, 0.998, 0.995, 0.985, 0.96), 0.9998
_WORTH = 1e-4  # of the time: where less is gained the path is left on the blocks
# A run that the measure of the whole path finds beyond its tolerance by less is found again, with so much less of it.
_NEARLY, _LESS, _MIN_ROOM = 1.05, 0.998, 0.8
_NO_LENGTH = 4.0 * float(np.finfo(np.float64).eps)  # of a program
_SHOWN = 4  # runs in a note
_POINTS, _NEWTON_STEPS = 6, 3  # of a piece, at which its feed is looked at


@dataclass(frozen=True, eq=False)
class FoundRun:
    """A run and what was found for it.

    Attributes
    ----------
    first, last : int
        Its blocks, from the first on to before the last.
    part : JointPart or None
        None where it is made separately.
    reason : str
        Why it is; empty where it was found jointly.
    room : float
        Share of the tolerance that it was found within.
    """

    first: int
    last: int
    part: JointPart | None
    reason: str = ""
    room: float = 1.0

    @property
    def exact(self) -> bool:
        """It is the program itself: a single line."""
        return self.part is not None and self.last == self.first + 1 and self.part.kind.tolist() == [Kind.LEG]


def find_runs(
    blocks: MovingBlocks,
    junctions: Junctions,
    limits: Limits,
    separate_time: Callable[[int, int], float],
    sides: AllowedSides | None = None,
) -> list[FoundRun]:
    """Cut the blocks at their exact stops, and find the path and the feed of every run that allows it.

    Parameters
    ----------
    blocks : MovingBlocks
    junctions : Junctions
        What these become where the path is made separately.
    limits : Limits
        Of the axes of the blocks, whole: with chord error and period.
    separate_time : callable
        Time of a run whose path is made before its feed, s, by its first block and the one after its last.  Asked for runs
        without a corner: there the tolerance may have nothing more to give, and the grid of the joint problem decides.
    sides : AllowedSides, optional
        Where the blocks may be left to one side alone.  What is made separately keeps to none.
    """
    cuts = cuts_of(blocks, junctions).tolist()
    runs = [find_run(blocks, junctions, limits, first, last, sides) for first, last in pairwise(cuts)]
    if sides is not None:
        return runs
    return [faster(run, junctions, separate_time) for run in runs]


def cuts_of(blocks: MovingBlocks, junctions: Junctions) -> IntArray:
    """The blocks that runs begin with, and one after the last."""
    allowed = np.minimum(blocks.tolerance[:-1], blocks.tolerance[1:])
    stop = blocks.stop | ((junctions.kind == Junction.STOP) & (allowed <= 0.0))
    return np.concatenate([[0], np.flatnonzero(stop) + 1, [blocks.row.size]])


def faster(run: FoundRun, junctions: Junctions, separate_time: Callable[[int, int], float]) -> FoundRun:
    """The run as it is, or left to the separate path where that is faster; arguments as of :func:`find_runs`."""
    inner = junctions.kind[run.first : run.last - 1]
    if run.part is None or run.exact or (inner >= Junction.CORNER).any():
        return run
    took, other = run.part.law.duration, separate_time(run.first, run.last)
    if took < other * (1.0 - _WORTH):
        return run
    gained = f"{100.0 * (1.0 - other / took):.2g} % faster" if other < took else "as fast"
    reason = f"that is {gained} here"
    return replace(run, part=None, reason=reason)


def find_run(
    blocks: MovingBlocks,
    junctions: Junctions,
    limits: Limits,
    first: int,
    last: int,
    sides: AllowedSides | None = None,
    room: float = 1.0,
) -> FoundRun:
    """Find path and feed of the run from one block to before another within a share of its tolerance, if it allows that."""
    # A line by itself is taken as it is, without the solver.
    alone = last == first + 1 and not blocks.programmed.legs.curved[first]
    fastest = float((_caps(blocks, limits)[first:last] * _per_feed(blocks)[first:last]).max())
    of_machine = _reason_of_limits(limits) if alone else reason_of_machine(limits, fastest)
    reason = of_machine or _reason_of_blocks(blocks, junctions, first, last)
    if reason:
        return FoundRun(first, last, None, reason)
    try:
        run = _run_of(blocks, limits, first, last)
        run = replace(run, tolerance=room * run.tolerance)
        if sides is not None:
            run = replace(run, side=sides.allowed[first:last], plane=sides.plane)
        motion = _within_limits(blocks, first, limits, run, _within_tolerance(run))
        part = pieces_of(run, motion)
        # At the end of the program the parameter has to tell both ends of a piece apart.
        if np.diff(part.edges).min() <= _NO_LENGTH * float(blocks.programmed.edges[-1]):
            raise SolverError("the motion found has a piece too short for the digits of the path")
        return FoundRun(first, last, part, room=room)
    except SolverError as error:
        return FoundRun(first, last, None, str(error))


def separate_notes(runs: list[FoundRun], line: IntArray, made: str = "made separately from the feed") -> list[str]:
    """Say which runs are made separately, and why; ``line`` are the numbers of the blocks' lines."""
    reasons: dict[str, list[FoundRun]] = {}
    for run in runs:
        if run.part is None:
            reasons.setdefault(run.reason, []).append(run)
    notes = []
    for reason, some in reasons.items():
        if len(some) == len(runs):
            which = "the path is"
        else:
            shown = ", ".join(_between(line[run.first], line[run.last - 1]) for run in some[:_SHOWN])
            single = len(some) == 1 and line[some[0].first] == line[some[0].last - 1]
            which = f"line {shown} is" if single else f"lines {shown}{', ...' if len(some) > _SHOWN else ''} are"
        notes.append(f"{which} {made}: {reason}")
    return notes


def _between(first: int, last: int) -> str:
    return f"{first}" if first == last else f"{first} to {last}"


def left_out(
    runs: list[FoundRun],
    measure: Callable[[FoundRun], float],
    again: Callable[[FoundRun, float], FoundRun] | None = None,
    reason: str = "it would leave the tolerance by {:.2g} of it",
) -> list[FoundRun]:
    """Find what is beyond its tolerance with less of it, or leave it out; the same list where nothing is.

    Parameters
    ----------
    runs : list of FoundRun
    measure : callable
        Largest distance of a run from its blocks, against the tolerance.
    again : callable
        The run within another share of its tolerance; None where that is no help.
    reason : str
        Why a run is left out, with the place of what is beyond.
    """
    shares = [0.0 if run.part is None else measure(run) for run in runs]
    if max(shares, default=0.0) <= 1.0:
        return runs
    return [
        run if share <= 1.0 else _narrowed(run, share, again, reason) for run, share in zip(runs, shares, strict=True)
    ]


def _narrowed(
    run: FoundRun, share: float, again: Callable[[FoundRun, float], FoundRun] | None, reason: str
) -> FoundRun:
    room = run.room * _LESS / share
    if again is not None and share <= _NEARLY and room >= _MIN_ROOM:
        return again(run, room)
    return replace(run, part=None, reason=reason.format(share - 1.0))


def reason_of_machine(limits: Limits, feed: float) -> str:
    """Why no run of a program but single lines is found jointly on a machine, up to this feed, mm/s, if it is so."""
    reason = _reason_of_limits(limits)
    if reason:
        return reason
    if _may_exceed_chords(limits, feed):
        return "the chord error limits the acceleration to less than the axes do"
    jerk = limits.jerk * scale_of(limits.axes)
    if jerk.max() > _MAX_APART * jerk.min():
        return f"the jerk limits of its axes are more than {_MAX_APART:g} times apart"
    return ""


def _reason_of_limits(limits: Limits) -> str:
    """Which limit of a machine no motion of a run would know of, if there is one."""
    free = [axis for axis, jerk in zip(limits.axes, limits.jerk, strict=True) if not np.isfinite(jerk)]
    if free:
        return f"the jerk of {', '.join(free)} has no limit"
    if np.isfinite(limits.tangential_acceleration) or np.isfinite(limits.tangential_jerk):
        return "the acceleration or the jerk along the path has a limit of its own"
    return ""


def _may_exceed_chords(limits: Limits, feed: float) -> bool:
    """Whether the accelerations that are reached let the chord error be exceeded; on a curve ``osculating_limits`` tells."""
    linear = [axis not in ROTARY_AXES for axis in limits.axes]
    reached = reachable_acceleration(limits.velocity, limits.acceleration, limits.jerk, feed)
    most = float(np.sqrt(np.sum(reached[linear] ** 2)))
    return most * limits.period**2 / 8.0 > limits.chord_error


def _reason_of_blocks(blocks: MovingBlocks, junctions: Junctions, first: int, last: int) -> str:
    """Why a run is not found jointly, if it is so."""
    legs, count, kind = blocks.programmed.legs, last - first, junctions.kind
    tolerance = blocks.tolerance[first:last]
    short = int(np.count_nonzero(blocks.length[first:last] < _SHORT * tolerance))
    smooth = int(np.count_nonzero(kind[first : last - 1] <= Junction.TUBE))
    reasons = (
        (legs.ways is not None and bool((legs.ways[first:last, 0] >= 0.0).any()), "it has splines"),
        (
            bool(blocks.apart[first : last - 1].any()),
            "its feed is measured along other axes from some block on",
        ),
        (bool((tolerance <= 0.0).any()) and (count > 1 or bool(legs.curved[first])), "it has no tolerance"),
        (count > _MAX_BLOCKS, f"it has {count} blocks, more than {_MAX_BLOCKS}"),
        (short > _MAX_SHORT, f"{short} of its {count} blocks are shorter than {_SHORT:g} times their tolerance"),
        (
            smooth > max(_MAX_SMOOTH, _SMOOTH_SHARE * count),
            f"{smooth} of its {count} blocks go on smoothly, more than {_MAX_SMOOTH}",
        ),
        (
            count > _MAX_FINE * max(1, count - 1 - smooth) and _swing(blocks, junctions, first, last) < _FINE,
            f"its {count} blocks go on smoothly, finer than the tolerance asks for",
        ),
    )
    return next((reason for holds, reason in reasons if holds), "")


def _swing(blocks: MovingBlocks, junctions: Junctions, first: int, last: int) -> float:
    """Height of the arc over half of two blocks, against the tolerance: the median of a run."""
    shorter = np.minimum(blocks.length[first : last - 1], blocks.length[first + 1 : last])
    allowed = np.minimum(blocks.tolerance[first : last - 1], blocks.tolerance[first + 1 : last])
    return float(np.median(shorter * junctions.turn[first : last - 1] / (8.0 * allowed)))


def _run_of(blocks: MovingBlocks, limits: Limits, first: int, last: int) -> JointRun:
    """The run as the solver takes it: mm and degrees."""
    scale = blocks.used.scale
    rows = {q.key: getattr(limits, q.key) * scale for q in AXIS}
    some = np.arange(first, last)
    lengths = blocks.length[first:last]
    tolerance = blocks.tolerance[first:last]
    return JointRun(
        blocks.programmed.legs.taken(some),
        lengths,
        # A single line without a tolerance is taken exactly, whatever it is given.
        np.where(tolerance > 0.0, tolerance, 1e-3 * lengths),
        _caps(blocks, limits)[first:last] * _per_feed(blocks)[first:last],
        **rows,
    )


def _caps(blocks: MovingBlocks, limits: Limits) -> FloatArray:
    """Largest feed of every block, as the program measures it."""
    under = np.where(np.isinf(blocks.feed), limits.rapid, np.minimum(blocks.feed, limits.feed))
    return np.where(blocks.angular, blocks.feed, under)


def _per_feed(blocks: MovingBlocks) -> FloatArray:
    return np.broadcast_to(np.asarray(blocks.programmed.per_feed, dtype=np.float64), (blocks.row.size,))


def _within_tolerance(run: JointRun) -> JointMotion:
    """Solve, in blocks that the motion leaves by more than their tolerance again with less of it."""
    allowed = used = run.tolerance / run.tolerance
    for aim in _AIMS:
        allowed = np.where(used > _MET, allowed * aim / used, allowed)
        motion = solve_run(replace(run, tolerance=allowed * run.tolerance))
        used = _shares(run, motion)
        if used.max() <= _MET:
            return motion
    raise SolverError(f"the motion found leaves the tolerance by {used.max() - 1.0:.2g} of it")


def _shares(run: JointRun, motion: JointMotion) -> FloatArray:
    """Largest distance of the motion from each block against its tolerance, (n,): of points, and parabolas through three.

    And of the vertices from the motion, where it goes from one block to the next.
    """
    inner = np.arange(_LOOKED_AT + 1) / _LOOKED_AT
    h = np.diff(motion.t)[:, None] * inner
    parts = (motion.position, motion.velocity, 0.5 * motion.acceleration)
    p, v, a = (part[:-1, None] for part in parts)
    x = h[..., None]
    points = p + x * (v + x * (a + x * (motion.jerk[:, None] / 6.0)))
    leg = np.repeat(motion.leg, inner.size)
    begins = motion.t[np.flatnonzero(np.diff(motion.leg, prepend=-1, append=-1))]
    share = ((motion.t[:-1, None] + h).reshape(-1) - begins[leg]) / np.diff(begins)[leg]
    away = feet(run, leg, points.reshape(-1, run.dim), share)[1].reshape(h.shape) ** 2
    before, middle, after = away[:, :-2], away[:, 1:-1], away[:, 2:]
    bend = np.maximum(2.0 * middle - before - after, 1e-300)
    top = middle + np.where((middle > before) & (middle > after), (after - before) ** 2 / (8.0 * bend), 0.0)
    largest = np.maximum(np.maximum(away[:, 0], away[:, -1]), top.max(axis=1))
    used = np.zeros(run.lengths.size)
    np.maximum.at(used, motion.leg, np.sqrt(largest) / run.tolerance[motion.leg])
    node = np.flatnonzero(np.diff(motion.leg)) + 1
    from_vertex = motion.position[node] - run.ends[:-1]
    of_disc = np.sqrt(dot(from_vertex, from_vertex)) / np.minimum(run.tolerance[:-1], run.tolerance[1:])
    return np.maximum(used, np.maximum(np.append(of_disc, 0.0), np.append(0.0, of_disc)))


def _within_limits(blocks: MovingBlocks, first: int, limits: Limits, run: JointRun, motion: JointMotion) -> JointMotion:
    """Slow a motion down by what it exceeds of its limits between the points that the solver looks at.

    Velocities are largest at nodes or where the acceleration is 0, accelerations at nodes; jerks are constant.
    """
    velocity = np.maximum(np.abs(motion.velocity[:-1]), np.abs(motion.velocity[1:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        h = -motion.acceleration[:-1] / motion.jerk
    inside = (h > 0.0) & (h < np.diff(motion.t)[:, None])
    peak = np.abs(motion.velocity[:-1] + 0.5 * motion.acceleration[:-1] * np.where(inside, h, 0.0))
    velocity = np.where(inside, np.maximum(velocity, peak), velocity)
    feed = _feed(blocks, first, motion)
    cap = _caps(blocks, limits)[first + motion.leg]
    acceleration = float((np.abs(motion.acceleration) / run.acceleration).max())
    jerk = float((np.abs(motion.jerk) / run.jerk).max())
    speed = max(float((velocity / run.velocity).max()), float((feed / cap).max()))
    excess = max(1.0, speed, float(np.sqrt(acceleration)), float(np.cbrt(jerk)))
    if excess > 1.0 + _MAX_SLOWED:
        raise SolverError(f"the motion found exceeds its limits by {100.0 * (excess - 1.0):.2g} % in time")
    return replace(
        motion,
        t=motion.t * excess,
        velocity=motion.velocity / excess,
        acceleration=motion.acceleration / excess**2,
        jerk=motion.jerk / excess**3,
    )


def _feed(blocks: MovingBlocks, first: int, motion: JointMotion) -> FloatArray:
    """Largest feed on every piece as the program measures it, (m,): the highest of some points, and Newton from there."""
    counted = [name in AXES[FEED_GROUPS[int(blocks.group[first])]] for name in blocks.axes]
    v, a, j = motion.velocity[:-1, counted], motion.acceleration[:-1, counted], motion.jerk[:, counted]
    step = np.diff(motion.t)

    def motion_at(h: FloatArray) -> tuple[FloatArray, FloatArray]:
        return v + h[:, None] * (a + 0.5 * h[:, None] * j), a + h[:, None] * j

    places = [step * (k / _POINTS) for k in range(_POINTS + 1)]
    squares = np.stack([np.sum(motion_at(h)[0] ** 2, axis=1) for h in places])
    highest = np.argmax(squares, axis=0)
    largest, h = squares.max(axis=0), np.stack(places)[highest, np.arange(step.size)]
    for _ in range(_NEWTON_STEPS):
        velocity, acceleration = motion_at(h)
        rise = np.sum(velocity * acceleration, axis=1)
        bend = np.sum(acceleration**2 + velocity * j, axis=1)
        h = np.clip(np.where(bend < 0.0, h - rise / np.where(bend < 0.0, bend, -1.0), h), 0.0, step)
        largest = np.maximum(largest, np.sum(motion_at(h)[0] ** 2, axis=1))
    return np.asarray(np.sqrt(largest))
