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
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError, SolverError
from planner.geometry.chain import ChainCurve, Kind
from planner.geometry.tolerance import PathKind, PathTolerance
from planner.inputs import positive_number, require_instance
from planner.machine.limits import Limits
from planner.programs.path import tube_knots as knotting
from planner.programs.path.absorb import Absorbed, absorb
from planner.programs.path.corners import Junction, Junctions, blends_at
from planner.programs.path.deviation import Deviation
from planner.programs.path.feeds import caps_of_blocks
from planner.programs.path.joint_runs import FoundRun, classified, find_runs, left_out, separate_notes
from planner.programs.path.measure import LinePlace, Written, largest_deviation
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.splice import Placed, spliced
from planner.programs.path.stretch import Fitted, Stretch, fit
from planner.programs.reading.noise import noise_amplitude
from planner.programs.reading.program import Program
from planner.quantity import AXIS
from planner.types import FloatArray

# How far a tube goes on beyond its first and last junction, where the blocks are long, mm.  The knot spacing has grown
# to its largest by then.
_MARGIN = 12.0
_SHORT_REST = 2.0  # a leg between a tube and the end of a stretch that is shorter than this joins the tube, mm
# The path is measured a second time as a whole; a tube that this finds beyond its tolerance is narrowed, and built again.
MAX_TRIES = 4
NARROWER = 0.999  # than what would just do, by the measure before
_INTERVALS_PER_CORNER, _INTERVALS_PER_KNOT = 110, 4
MIN_INTERVALS = 1000  # of a plan of a program
_NOISE_FACTOR = 2.0
_PER_PIECE = (
    5  # places between two nodes of a joint motion at which its deviation is looked at, before the largest are refined
)
_DEMANDED = "demanded by the program"


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

    def __repr__(self) -> str:
        far, stops = self.deviation.largest, len(self.stops)
        return f"ProgramPath({self.curve.name}: within {1e3 * far:.4g} um of the program, {stops} exact stops)"


def program_path(program: Program, tolerance: float | None, limits: Limits, *, path: PathKind = "joint") -> ProgramPath:
    """Make a smooth path within tolerance of a part program.

    Parameters
    ----------
    program : Program
    tolerance : float or None
        Largest distance between path and program, mm, in place of the program's own P words; None for those
        (0.01 mm where there is none).  G61 and G61.1 stay exact stops.
    limits : Limits
        Of the machine.  A joint path is the fastest for them; in a separate one they weigh where smoothness is worth most.
    path : {"joint", "separate"}
        Find path and feed as one problem, or the path first.  A run of blocks from stop to stop of which path and feed
        cannot be found jointly is made separately; ``notes`` says which, and why.

    Returns
    -------
    ProgramPath

    Raises
    ------
    InputError
        If the tolerance is not positive, or the machine lacks an axis of the program.
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
    limits = program.require_axes(limits)
    given = MovingBlocks.of(program, tolerance)
    absorbed = absorb(program, given)
    blocks = MovingBlocks.of(absorbed.program, None, given.used)
    written = absorbed.written(given.programmed)
    limits = limits.for_axes(blocks.axes, program.source)
    rows: dict[str, Any] = {q.key: getattr(limits, q.key) for q in AXIS}
    shaped = Limits(limits.feed, **rows, axes=blocks.axes, rapid=limits.rapid)
    runs = find_runs(blocks, classified(blocks, None), limits) if path == "joint" else []
    # The rooms of the corners were measured one by one, which serves nearly always; else the other tries do without.
    share, number = 1.0, 0
    while number <= MAX_TRIES:
        built = _build(blocks, (shaped, limits), share, None if number else absorbed.room, runs)
        found, largest = _measure(absorbed, built, written)
        if largest <= 1.0:
            made = _report(program, (given, absorbed, blocks), built, found, largest)
            return replace(made, curve=replace(made.curve, made_within=PathTolerance(tolerance, path=path)))
        kept = left_out(runs, partial(_measure_run, absorbed, built, written))
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
class _Built:
    """The pieces of a path and where they lie."""

    placed: Placed
    junctions: Junctions
    tubes: list[Fitted]
    reasons: dict[int, str]
    runs: list[FoundRun]


def _build(
    blocks: MovingBlocks, limits: tuple[Limits, Limits], share: float, room: FloatArray | None, runs: list[FoundRun]
) -> _Built:
    """Classify the junctions, fit the tubes, and put exact stops where one cannot be kept within tolerance.

    ``share`` is the part of the tolerance that the tubes may use, ``room`` what the corners may; ``limits`` those that
    shape a tube, and those that ``runs`` were found for.
    """
    shaped, whole = limits
    junctions = classified(blocks, room)
    parts = [(run.first, run.last, run.part) for run in runs if run.part is not None]
    for first, last, _ in parts:
        junctions.kind[first : last - 1], junctions.size[first : last - 1] = Junction.SMOOTH, 0.0
    reasons: dict[int, str] = {}
    tubes: list[Fitted] = []
    todo = _stretches(blocks, junctions)[::-1]
    feed = np.where(blocks.rapid | blocks.angular, blocks.feed, np.minimum(blocks.feed, shaped.feed))
    while todo:
        stretch = todo.pop()
        narrowed = replace(stretch, tolerance=share * stretch.tolerance)
        fitted = replace(fit(narrowed, blocks.programmed, shaped, feed), tolerance=stretch.tolerance)
        if fitted.deviation <= narrowed.tolerance:
            tubes.append(fitted)
            continue
        inner = np.flatnonzero((junctions.kind == Junction.TUBE) & _within(blocks.programmed.edges[1:-1], stretch))
        at = inner[np.argmin(np.abs(blocks.programmed.edges[1:-1][inner] - fitted.abscissa))]
        junctions.kind[at] = Junction.STOP
        reasons[int(at)] = (
            f"the tube would leave the tolerance by {1e3 * (fitted.deviation - narrowed.tolerance):.3g} um"
        )
        todo += _stretches(blocks, junctions, stretch.start, stretch.end)[::-1]
    curve, u_edges, s_edges = _assemble(blocks, junctions, tubes)
    placed = Placed(curve, u_edges, s_edges, np.interp(blocks.programmed.edges, s_edges, u_edges))
    return _Built(spliced(placed, blocks, parts, whole), junctions, tubes, reasons, runs)


def _within(s: FloatArray, stretch: Stretch) -> NDArray[np.bool_]:
    return np.asarray((s > stretch.start) & (s < stretch.end))


def _stretches(
    blocks: MovingBlocks, junctions: Junctions, first: float = -np.inf, last: float = np.inf
) -> list[Stretch]:
    """Stretches that need a tube, between first and last."""
    edges = blocks.programmed.edges
    s = edges[1:-1]
    reach = junctions.reach
    features = np.flatnonzero((junctions.kind == Junction.TUBE) & (s > first) & (s < last))
    if features.size == 0:
        return []
    fences = np.flatnonzero(junctions.kind >= Junction.CORNER)
    # the room between the fences around each feature, less what corners take
    after = np.searchsorted(fences, features)
    left = np.concatenate([[edges[0]], s[fences] + reach[fences]])[after]
    right = np.concatenate([s[fences] - reach[fences], [edges[-1]]])[after]
    stops = np.concatenate([[True], junctions.kind[fences] == Junction.STOP, [True]])
    new = np.concatenate([[True], (np.diff(after) > 0) | (np.diff(s[features]) > 2.0 * _MARGIN + _SHORT_REST)])
    begin = np.flatnonzero(new)
    end = np.append(begin[1:], features.size) - 1
    spacing = _spacing(blocks, junctions)
    out = []
    for i, j in zip(begin, end, strict=True):
        lo, hi = left[i], right[i]
        start, finish = s[features[i]] - _MARGIN, s[features[j]] + _MARGIN
        start = lo if start < lo + _SHORT_REST else start
        finish = hi if finish > hi - _SHORT_REST else finish
        rests = (bool(start == lo and stops[after[i]]), bool(finish == hi and stops[after[i] + 1]))
        inside = slice(features[i], features[j] + 1)
        vertices = s[inside]
        at, wanted = _with_arcs(blocks, spacing[inside], vertices, start, finish)
        sharp = vertices[junctions.turn[inside] > knotting.SHARP]
        allowed = blocks.tolerance[features[i] : features[j] + 2]
        out.append(Stretch(float(start), float(finish), rests, at, wanted, vertices, sharp, float(allowed.min())))
    return out


def _spacing(blocks: MovingBlocks, junctions: Junctions) -> FloatArray:
    """Knot spacing wanted at every junction."""
    length = np.diff(blocks.programmed.edges)
    allowed = np.minimum(blocks.tolerance[:-1], blocks.tolerance[1:])
    density = junctions.turn / (0.5 * (length[:-1] + length[1:]))
    return knotting.spacing_at(junctions.turn, junctions.bend, density, np.maximum(allowed, 1e-9))


def _with_arcs(
    blocks: MovingBlocks, spacing: FloatArray, at: FloatArray, start: float, end: float
) -> tuple[FloatArray, FloatArray]:
    """Add the spacing that arcs want, at their ends within the stretch and between."""
    edges, legs = blocks.programmed.edges, blocks.programmed.legs
    i = max(int(np.searchsorted(edges, start, side="right")) - 1, 0)
    j = int(np.searchsorted(edges, end, side="left"))
    arcs = i + np.flatnonzero(legs.curved[i:j])
    if arcs.size == 0:
        return at, spacing
    wanted = np.minimum(0.4 * legs.radius(arcs), edges[arcs + 1] - edges[arcs])
    lo, hi = np.maximum(edges[arcs], start), np.minimum(edges[arcs + 1], end)
    count = np.maximum(1, np.ceil((hi - lo) / wanted)).astype(int)
    index = np.repeat(np.arange(arcs.size), count + 1)
    within = np.arange(index.size) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    places = lo[index] + (hi - lo)[index] * within / count[index]
    s, spacings = np.concatenate([at, places]), np.concatenate([spacing, wanted[index]])
    order = np.argsort(s, kind="stable")
    return s[order], spacings[order]


def _assemble(
    blocks: MovingBlocks, junctions: Junctions, tubes: list[Fitted]
) -> tuple[ChainCurve, FloatArray, FloatArray]:
    """Chain the pieces: the curve, and its edges in u and in s."""
    edges = blocks.programmed.edges
    corners = np.flatnonzero(junctions.kind == Junction.CORNER)
    columns = blocks.columns
    legs = columns.legs()
    blends = blends_at(blocks.programmed, junctions, corners, (legs, columns.weight)) if corners.size else None
    reach = junctions.reach[corners]
    c0, c1 = edges[1:-1][corners] - reach, edges[1:-1][corners] + reach
    t0, t1 = (np.array([tube.knots[k] for tube in tubes]) for k in (0, -1))
    cuts = np.unique(np.concatenate([edges, c0, c1, t0, t1]))
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    in_corner = _inside(middle, c0, c1)
    in_tube = _inside(middle, t0, t1)
    on_leg = np.flatnonzero((in_corner < 0) & (in_tube < 0))
    block = np.clip(np.searchsorted(edges, middle[on_leg], side="right") - 1, 0, edges.size - 2)
    counts = [tube.knots.size - 1 for tube in tubes]
    before = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
    none = np.empty((0, legs.vectors.shape[2], 5))
    spans = np.concatenate([none, *(columns.spans(tube.powers, float(tube.knots[0])) for tube in tubes)])
    starts = [cuts[on_leg], c0, *(tube.knots[:-1] for tube in tubes)]
    lengths = [cuts[on_leg + 1] - cuts[on_leg], blends.length if blends else np.empty(0)]
    lengths += [np.diff(tube.knots) for tube in tubes]
    kinds = np.repeat([Kind.LEG, Kind.BLEND, Kind.SPAN], [on_leg.size, corners.size, int(before[-1])]).astype(np.int8)
    rows = np.concatenate([block, np.arange(corners.size), np.arange(before[-1])]).astype(np.intp)
    offsets = np.zeros(rows.size)
    offsets[: on_leg.size] = cuts[on_leg] - edges[block]
    start = np.concatenate(starts)
    order = np.argsort(start, kind="stable")
    s_edges = np.append(start[order], edges[-1])
    u_edges = np.concatenate([[0.0], np.cumsum(np.concatenate(lengths)[order])])
    joints = np.setdiff1d(cuts[1:-1], np.concatenate([tube.knots[1:-1] for tube in tubes]) if tubes else [])
    joints = joints[np.isin(joints, s_edges)]
    stops = edges[1:-1][junctions.kind == Junction.STOP]
    curve = ChainCurve(
        edges=u_edges,
        kind=kinds[order],
        row=rows[order],
        offset=offsets[order],
        legs=legs,
        blends=blends,
        spans=spans,
        joints=u_edges[np.searchsorted(s_edges, joints)],
        stops=u_edges[np.searchsorted(s_edges, stops)],
        marks=np.interp(edges[1:-1][(blocks.feed[1:] != blocks.feed[:-1]) | blocks.apart], s_edges, u_edges),
        axes=blocks.axes,
        name="program",
        tip_columns=columns.tip,
    )
    return curve, u_edges, s_edges


def _inside(s: FloatArray, lo: FloatArray, hi: FloatArray) -> NDArray[np.intp]:
    """Which of the disjoint, increasing intervals holds each s, -1 for none."""
    if lo.size == 0:
        return np.full(s.size, -1, dtype=np.intp)
    i = np.searchsorted(lo, s, side="right") - 1
    return np.where((i >= 0) & (s < hi[np.maximum(i, 0)]), i, -1)


def _measure(absorbed: Absorbed, built: _Built, written: Written) -> tuple[Deviation, float]:
    """The largest deviation of the path, and the largest against its tolerance."""
    placed = built.placed
    along = placed.curve, placed.u_edges, placed.s_edges, written
    places = places_of(absorbed.edges, absorbed.own, built.junctions, built.tubes)
    measured = largest_deviation(*along, places, widest_piece(built.junctions, built.tubes), pieces=placed.curve.edges)
    found = [measured, *_measured_runs(absorbed, built, written, built.runs)]
    return max((deviation for deviation, _ in found), key=lambda item: item.largest), max(share for _, share in found)


def _measured_runs(
    absorbed: Absorbed, built: _Built, written: Written, runs: list[FoundRun]
) -> list[tuple[Deviation, float]]:
    """What joint runs deviate, and the largest share of their tolerance; their pieces are short."""
    placed = built.placed
    places = [place for run in runs for place in _places_of_run(absorbed, run)]
    if not places:
        return []
    widest = max(float(np.diff(run.part.abscissa).max()) for run in runs if run.part is not None)
    along = placed.curve, placed.u_edges, placed.s_edges, replace(written, lines=[])
    return [largest_deviation(*along, places, widest, pieces=placed.curve.edges, density=_PER_PIECE)]


def _measure_run(absorbed: Absorbed, built: _Built, written: Written, run: FoundRun) -> float:
    """The largest deviation of a run against its tolerance."""
    return max((share for _, share in _measured_runs(absorbed, built, written, [run])), default=0.0)


def _places_of_run(absorbed: Absorbed, run: FoundRun) -> list[LinePlace]:
    """Where a run that was found jointly lies, block by block, and the tolerance there."""
    if run.part is None or run.exact:
        return []
    some = range(run.first, run.last)
    return [(float(absorbed.edges[k]), float(absorbed.edges[k + 1]), float(absorbed.own[k])) for k in some]


def places_of(edges: FloatArray, own: FloatArray, junctions: Junctions, tubes: list[Fitted]) -> list[LinePlace]:
    """Abscissae between which a path is not the program itself, and the tolerance in force there."""
    s, reach = edges[1:-1], junctions.reach
    corners = np.flatnonzero(junctions.kind == Junction.CORNER)
    places = [(float(s[k] - reach[k]), float(s[k] + reach[k]), float(min(own[k], own[k + 1]))) for k in corners]
    for tube in tubes:
        first, last = np.searchsorted(edges, tube.knots[[0, -1]], side="right") - 1
        allowed = own[max(first, 0) : max(last, first + 1)]
        places.append((float(tube.knots[0]), float(tube.knots[-1]), float(allowed.min())))
    return places


def widest_piece(junctions: Junctions, tubes: list[Fitted]) -> float:
    """Length of the longest piece of the corners and tubes, mm."""
    widest = [float(np.diff(tube.knots).max()) for tube in tubes]
    return max([float(junctions.reach.max(initial=0.0)), *widest])


def _report(
    program: Program, made: tuple[MovingBlocks, Absorbed, MovingBlocks], built: _Built, found: Deviation, share: float
) -> ProgramPath:
    """Collect what belongs to a path: of the given blocks, what was absorbed, and the blocks that are left."""
    given, absorbed, blocks = made
    edges, junctions, placed = given.programmed.edges, built.junctions, built.placed
    line = program.line[given.row]
    at = int(np.clip(np.searchsorted(edges, found.abscissa, side="right") - 1, 0, line.size - 1))
    stops = tuple(
        Stop(
            float(placed.ends[k + 1]), int(absorbed.program.line[k]), _reason(blocks, junctions, built.reasons, int(k))
        )
        for k in np.flatnonzero(junctions.kind == Junction.STOP)
    )
    caps = caps_of_blocks(placed.ends, blocks.feed, blocks.angular)
    u = placed.at(absorbed.place)
    counts = {
        "blocks": line.size,
        "absorbed": absorbed.count,
        "corners": int(np.count_nonzero(junctions.kind == Junction.CORNER)),
        "tubes": len(built.tubes),
        "knots": sum(tube.knots.size for tube in built.tubes),
        "passes": max([0, *(tube.passes for tube in built.tubes)]),
        "iterations": sum(tube.iterations for tube in built.tubes),
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


def _notes(absorbed: Absorbed, blocks: MovingBlocks, built: _Built) -> tuple[str, ...]:
    """What a reader should know: blocks absorbed, noise in the blocks, and exact stops that nobody asked for."""
    program = absorbed.program
    notes = []
    if absorbed.count:
        notes.append(
            f"{absorbed.count} block{'s' if absorbed.count > 1 else ''} of at most {1e3 * absorbed.longest:.3g} um absorbed "
            f"within {1e3 * absorbed.largest:.3g} um"
        )
    smooth = np.zeros(blocks.row.size + 1, dtype=np.bool_)
    smooth[1:-1] = built.junctions.kind == Junction.TUBE
    points = np.concatenate([program.start[blocks.row[:1]], program.end[blocks.row]])
    amplitude = noise_amplitude(points, smooth)
    least = float(blocks.tolerance[blocks.tolerance > 0.0].min(initial=np.inf))
    if least < _NOISE_FACTOR * amplitude:
        notes.append(
            f"the blocks carry rounding or noise of about {1e3 * amplitude:.3g} um; a tolerance of {1e3 * least:.3g} um "
            f"follows it, one of {_NOISE_FACTOR * 1e3 * amplitude:.3g} um or more would smooth it away"
        )
    notes += separate_notes(built.runs, program.line)
    notes += [
        f"exact stop after line {program.line[blocks.row[k]]}: {reason}" for k, reason in sorted(built.reasons.items())
    ]
    return tuple(notes)


def _reason(blocks: MovingBlocks, junctions: Junctions, reasons: dict[int, str], k: int) -> str:
    """Why there is an exact stop at junction k."""
    if k in reasons:
        return reasons[k]
    small = min(blocks.tolerance[k], blocks.tolerance[k + 1]) > 0.0
    every = (
        ("beside a rapid", blocks.rapid[k] or blocks.rapid[k + 1]),
        ("the tool turns back", blocks.turns_back[k]),
        ("the feed is measured along axes that move at quite another rate", blocks.uneven[k]),
        (_DEMANDED, blocks.stop[k]),
        (f"a turn of {np.rad2deg(junctions.turn[k]):.0f} degrees", junctions.turn[k] > np.deg2rad(150.0)),
        ("a corner so small that stopping is faster", small),
    )
    return next((reason for reason, holds in every if holds), "no tolerance")
