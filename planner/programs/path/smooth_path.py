"""From a part program to a smooth path within tolerance.

The blocks, laid end to end, are the programmed path; its abscissa s is the length along it.  Junctions become exact stops,
cubic corners, or part of a tube (``corners``); what lies between stays the exact line, arc or helix.  The pieces form one
:class:`~planner.geometry.chain.ChainCurve`, C2 with bounded third derivative between the exact stops, and the abscissa of
every block is kept with it.  No path leaves here that was not measured within the tolerance: where a tube does not keep
it, an exact stop replaces the worst junction, and the path says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError, SolverError
from planner.geometry.chain import ChainCurve
from planner.geometry.tolerance import PathKind, PathSide, PathTolerance
from planner.inputs import positive_number, require_instance
from planner.machine.limits import Limits
from planner.programs.path.absorb import Absorbed, absorb
from planner.programs.path.corners import Junction, Junctions
from planner.programs.path.deviation import Deviation
from planner.programs.path.feeds import caps_of_blocks
from planner.programs.path.joint_runs import FoundRun, find_run, find_runs, left_out, separate_notes
from planner.programs.path.measure import Written
from planner.programs.path.measured_runs import MeasuredPath
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.separate_path import (
    Built,
    built_separately,
    classified,
    places_of,
    separate_time,
    shaping,
    widest_piece,
)
from planner.programs.path.sides import ALLOWED_OVERCUT, AllowedSides, overcut, samples, sides_of
from planner.programs.path.splice import Placed, spliced
from planner.programs.reading.noise import noise_amplitude
from planner.programs.reading.program import Program
from planner.types import FloatArray

# The path is measured a second time as a whole; a tube that this finds beyond its tolerance is narrowed, and built again.
MAX_TRIES = 4
NARROWER = 0.999  # than what would just do, by the measure before
_INTERVALS_PER_CORNER, _INTERVALS_PER_KNOT = 110, 4
MIN_INTERVALS = 1000  # of a plan of a program
_NOISE_FACTOR = 2.0
_DEMANDED = "demanded by the program"
_OTHER_SIDE = f"it would pass to the other side, by more than {ALLOWED_OVERCUT:g} of the tolerance"


@dataclass(frozen=True)
class Stop:
    """An exact stop of the path: curve parameter (mm), line of the block before it, and why."""

    u: float
    line: int
    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class ProgramPath:
    """A part program as a curve.

    Attributes
    ----------
    curve : ChainCurve
        The path; its parameter is arc length, mm (nearly, on tubes).  Its ``feed_caps`` are the program's F words, inf
        on rapids, its ``made_within`` the tolerance asked for.
    line : (m,) int array
        Line number of every block that moves.
    u : (m + 1,) array
        Curve parameters at which the blocks begin and end, mm, increasing.
    rapid : (m,) bool array
        Blocks at the machine's own limits.
    stops : tuple of Stop
        Exact stops inside the path.
    tolerance : float
        The largest of the tolerances in force, mm.
    deviation : Deviation
        The largest distance between path and program, measured in both directions.
    deviation_line : int
        Line of the block it was found at.
    deviation_share : float
        The largest deviation against the tolerance in force where it was found; never above 1.
    intervals : int
        A number of intervals that resolves the corners and tubes, for ``plan_feedrate``.
    overcut : float
        How far it leaves the program to a side that is not allowed, mm: never more than 1e-3 of the tolerance; 0 where both
        sides are.
    counts : dict
        How many blocks, corners, tubes, knots and stops the path has; how many runs from stop to stop, and how many of
        these were found jointly.
    notes : tuple of str
        What a reader of the verdict should know.
    """

    curve: ChainCurve
    line: NDArray[np.int64]
    u: FloatArray
    rapid: NDArray[np.bool_]
    stops: tuple[Stop, ...]
    tolerance: float
    deviation: Deviation
    deviation_line: int
    deviation_share: float
    intervals: int
    counts: dict[str, int]
    notes: tuple[str, ...]
    overcut: float = 0.0

    def __repr__(self) -> str:
        far, stops = self.deviation.largest, len(self.stops)
        return f"ProgramPath({self.curve.name}: within {1e3 * far:.4g} um of the program, {stops} exact stops)"


def program_path(
    program: Program, tolerance: float | None, limits: Limits, *, path: PathKind = "joint", side: PathSide = "both"
) -> ProgramPath:
    """Make a smooth path within tolerance of a part program.

    Parameters
    ----------
    program : Program
    tolerance : float or None
        Largest distance between path and program, mm, in place of the program's own P words; None for those
        (0.01 mm where there is none).  G61 and G61.1 stay exact.
    limits : Limits
        Of the machine.  A joint path is the fastest for them; in a separate one they weigh where smoothness is worth most.
    path : {"joint", "separate"}
        Find path and feed as one problem, or the path first.  A run of blocks from stop to stop of which path and feed
        cannot be found jointly is made separately; ``notes`` says which, and why.
    side : {"both", "left", "right", "inside", "outside"}
        Where the path may leave the programmed one to: ``left`` and ``right`` of the motion in the plane of the first two
        linear axes that move, ``inside`` and ``outside`` of closed contours; rapids and moves across that plane are exact.
        A run that cannot be found jointly has no tolerance then: it stays the program, with exact stops.

    Returns
    -------
    ProgramPath

    Raises
    ------
    InputError
        If the tolerance is not positive, or the machine lacks an axis of the program; if a contour has no such side, or
        the path is to be separate, which cuts corners inside.
    CurveError
        If the program moves nothing.
    """
    require_instance(program, Program, "program")
    if tolerance is not None:
        tolerance = positive_number(tolerance, "tolerance")
        if not np.isfinite(tolerance):
            raise InputError("tolerance = inf mm must be finite")
    if path not in get_args(PathKind):
        raise InputError(f"path = {path!r} must be one of {', '.join(get_args(PathKind))}")
    if side not in get_args(PathSide):
        raise InputError(f"side = {side!r} must be one of {', '.join(get_args(PathSide))}")
    if side != "both" and path != "joint":
        raise InputError(f"side = {side!r} is for path = 'joint'; a separate path cuts corners inside")
    limits = program.require_axes(limits)
    given = MovingBlocks.of(program, tolerance)
    sides = None if side == "both" else sides_of(given, side, program.line[given.row], program.source)
    absorbed = absorb(program, given) if sides is None else _nothing_absorbed(program, given)
    blocks = MovingBlocks.of(absorbed.program, None, given.used)
    blocks = blocks if sides is None else sides.cut(blocks)
    written = absorbed.written(given.programmed)
    limits = limits.for_axes(blocks.axes, program.source)
    runs, junctions = [], classified(blocks, absorbed.room)
    if path == "joint":
        runs = find_runs(blocks, junctions, limits, partial(separate_time, absorbed, blocks.used, limits), sides)

    def again(run: FoundRun, room: float) -> FoundRun:
        return find_run(blocks, junctions, limits, run.first, run.last, sides, room)

    # The rooms of the corners were measured one by one, which serves nearly always; else the other tries do without.
    share, number = 1.0, 0
    while number <= MAX_TRIES:
        joint = [(run.first, run.last) for run in runs if run.part is not None]
        exact = blocks if sides is None else _exact_but(blocks, joint)
        separate = built_separately(exact, shaping(limits), share, None if number else absorbed.room, joint)
        built = _Made(separate, spliced(separate.placed, blocks, runs, limits), runs, exact, sides)
        places = places_of(absorbed.edges, absorbed.own, separate.junctions, separate.tubes)
        measured = _measured(absorbed, built, written)
        found, largest = measured.largest(runs, places, widest_piece(separate.junctions, separate.tubes))
        if sides is not None:
            kept = left_out(runs, partial(_overcut, absorbed, built, sides, True), None, _OTHER_SIDE)
            if kept is not runs:
                runs = kept
                continue
        if largest <= 1.0:
            made = _report(program, (given, absorbed, exact), built, found, largest)
            cut = 0.0 if sides is None else max(_overcut(absorbed, built, sides, False, run) for run in runs)
            within = PathTolerance(tolerance, path=path, side=side)
            return replace(made, overcut=cut, curve=replace(made.curve, made_within=within))
        kept = left_out(runs, measured.share, again)
        if kept is not runs:
            runs = kept
            continue
        share *= NARROWER / largest if number else 1.0
        number += 1
    raise SolverError(
        f"{program.source}: the path leaves the tolerance by {largest - 1.0:.2g} of it at abscissa {found.abscissa:.6g} mm; "
        "give a larger tolerance"
    )


@dataclass(frozen=True, eq=False)
class _Made:
    """A path: what is made before the feed, and the whole with the runs that were found with theirs."""

    separate: Built
    placed: Placed
    runs: list[FoundRun]
    blocks: MovingBlocks
    sides: AllowedSides | None


def _nothing_absorbed(program: Program, given: MovingBlocks) -> Absorbed:
    """The blocks as they are: a line that stands for several would pass them on any side."""
    kept = absorb(program, replace(given, tolerance=np.zeros(given.row.size)))
    return replace(kept, program=replace(kept.program, tolerance=given.tolerance), own=given.tolerance)


def _exact_but(blocks: MovingBlocks, joint: list[tuple[int, int]]) -> MovingBlocks:
    """The blocks, without a tolerance but in these runs."""
    tolerance = np.zeros(blocks.row.size)
    for first, last in joint:
        tolerance[first:last] = blocks.tolerance[first:last]
    return replace(blocks, tolerance=tolerance)


def _overcut(absorbed: Absorbed, built: _Made, sides: AllowedSides, share: bool, run: FoundRun) -> float:
    """How far a run leaves the program to the side that is not allowed, mm, or that as a share of what may be of it."""
    if run.part is None or run.exact:
        return 0.0
    placed, programmed = built.placed, built.blocks.programmed
    inside = (placed.curve.edges >= placed.ends[run.first]) & (placed.curve.edges <= placed.ends[run.last])
    u = samples(placed.curve.edges[inside])
    s = np.interp(u, placed.u_edges, placed.s_edges)
    tolerance = absorbed.own[run.first : run.last]
    found = overcut(sides, programmed, programmed.of_curve(placed.curve, u, 0)[0], s, float(tolerance.max()))
    return found / (ALLOWED_OVERCUT * float(tolerance.min())) if share else found


def _measured(absorbed: Absorbed, built: _Made, written: Written) -> MeasuredPath:
    placed = built.placed
    edges = placed.curve.edges
    return MeasuredPath(placed.curve, edges, placed.u_edges, placed.s_edges, absorbed.edges, absorbed.own, written)


def _report(
    program: Program, made: tuple[MovingBlocks, Absorbed, MovingBlocks], built: _Made, found: Deviation, share: float
) -> ProgramPath:
    """Collect what belongs to a path: of the given blocks, what was absorbed, and the blocks that are left."""
    given, absorbed, blocks = made
    edges, junctions, placed = given.programmed.edges, built.separate.junctions, built.placed
    line = program.line[given.row]
    at = int(np.clip(np.searchsorted(edges, found.abscissa, side="right") - 1, 0, line.size - 1))
    stops = tuple(
        Stop(
            float(placed.ends[k + 1]),
            int(absorbed.program.line[k]),
            _reason(blocks, junctions, built, int(k)),
        )
        for k in np.flatnonzero(junctions.kind == Junction.STOP)
    )
    caps = caps_of_blocks(placed.ends, blocks.feed, blocks.angular)
    u = placed.at(absorbed.place)
    counts = {
        "blocks": line.size,
        "absorbed": absorbed.count,
        "corners": int(np.count_nonzero(junctions.kind == Junction.CORNER)),
        "tubes": len(built.separate.tubes),
        "knots": sum(tube.knots.size for tube in built.separate.tubes),
        "passes": max([0, *(tube.passes for tube in built.separate.tubes)]),
        "iterations": sum(tube.iterations for tube in built.separate.tubes),
        "stops": len(stops),
        "runs": len(built.runs),
        "joint": sum(run.part is not None for run in built.runs),
    }
    intervals = _INTERVALS_PER_CORNER * counts["corners"] + _INTERVALS_PER_KNOT * counts["knots"]
    for array in (line, u):
        array.setflags(write=False)
    return ProgramPath(
        curve=replace(placed.curve, feed_caps=caps),
        line=line,
        u=u,
        rapid=given.rapid,
        stops=stops,
        tolerance=float(given.tolerance.max()),
        deviation=found,
        deviation_line=int(line[at]),
        deviation_share=share,
        intervals=max(MIN_INTERVALS, intervals),
        counts=counts,
        notes=(*program.notes, *_notes(absorbed, blocks, built)),
    )


def _notes(absorbed: Absorbed, blocks: MovingBlocks, built: _Made) -> tuple[str, ...]:
    """What a reader should know: blocks absorbed, noise in the blocks, and exact stops that nobody asked for."""
    program = absorbed.program
    notes = []
    if absorbed.count:
        notes.append(
            f"{absorbed.count} block{'s' if absorbed.count > 1 else ''} of at most {1e3 * absorbed.longest:.3g} um absorbed "
            f"within {1e3 * absorbed.largest:.3g} um"
        )
    smooth = np.zeros(blocks.row.size + 1, dtype=np.bool_)
    smooth[1:-1] = built.separate.junctions.kind == Junction.TUBE
    points = np.concatenate([program.start[blocks.row[:1]], program.end[blocks.row]])
    amplitude = noise_amplitude(points, smooth)
    least = float(blocks.tolerance[blocks.tolerance > 0.0].min(initial=np.inf))
    if least < _NOISE_FACTOR * amplitude:
        notes.append(
            f"the blocks carry rounding or noise of about {1e3 * amplitude:.3g} um; a tolerance of {1e3 * least:.3g} um "
            f"follows it, one of {_NOISE_FACTOR * 1e3 * amplitude:.3g} um or more would smooth it away"
        )
    made = () if built.sides is None else ("exact, with stops at its corners",)
    notes += separate_notes(built.runs, program.line, *made)
    notes += [
        f"exact stop after line {program.line[blocks.row[k]]}: {reason}"
        for k, reason in sorted(built.separate.reasons.items())
    ]
    return tuple(notes)


def _reason(blocks: MovingBlocks, junctions: Junctions, built: _Made, k: int) -> str:
    """Why there is an exact stop at junction k."""
    if k in built.separate.reasons:
        return built.separate.reasons[k]
    across = built.sides is not None and (built.sides.allowed[k] != 0) != (built.sides.allowed[k + 1] != 0)
    small = min(blocks.tolerance[k], blocks.tolerance[k + 1]) > 0.0
    every = (
        ("beside a rapid", blocks.rapid[k] or blocks.rapid[k + 1]),
        ("the tool turns back", blocks.turns_back[k]),
        ("the feed is measured along axes that move at quite another rate", blocks.uneven[k]),
        ("beside a move that has no sides", across),
        (_DEMANDED, blocks.stop[k]),
        (f"a turn of {np.rad2deg(junctions.turn[k]):.0f} degrees", junctions.turn[k] > np.deg2rad(150.0)),
        ("a corner so small that stopping is faster", small),
    )
    return next((reason for reason, holds in every if holds), "no tolerance")
