"""From a part program to a smooth path within tolerance.

The blocks, laid end to end, are the programmed path; its abscissa s is the length along it.  Junctions become exact stops,
cubic corners, or part of a tube (``corners``); what lies between stays the exact line, arc or helix.  The pieces form one
:class:`~planner.geometry.chain.ChainCurve`, C2 with bounded third derivative between the exact stops, and the abscissa of
every block is kept with it.  No path leaves here that was not measured within the tolerance: where a tube does not keep
it, an exact stop replaces the worst junction, and the path says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import CurveError, InputError, SolverError
from planner.geometry.blend import Legs
from planner.geometry.chain import ChainCurve, Kind
from planner.geometry.curve import FeedCaps, FloatArray
from planner.geometry.inputs import positive_number
from planner.limits import Limits
from planner.programs import knots as knotting
from planner.programs.corners import Junction, Junctions, blends_at, classify
from planner.programs.deviation import Deviation, Programmed, deviation
from planner.programs.noise import noise_amplitude
from planner.programs.program import ARC, RAPID, Program
from planner.programs.stretch import Fitted, Stretch, fit

DEFAULT_TOLERANCE = 0.01  # mm, where neither the program nor the caller gives one
_AXES = ("X", "Y", "Z")
# How far a tube goes on beyond its first and last junction, where the blocks are long, mm.  The knot spacing has grown
# to its largest by then.
_MARGIN = 12.0
_SHORT_REST = 2.0  # a leg between a tube and the end of a stretch that is shorter than this joins the tube, mm
# The path is measured a second time as a whole; a tube that this finds beyond its tolerance is narrowed, and built again.
_MOST_TRIES, _NARROWER = 4, 0.999
_INTERVALS_PER_CORNER, _INTERVALS_PER_KNOT, _FEWEST_INTERVALS = 200, 4, 1000
_NOISE_FACTOR = 2.0
_DEMANDED = "demanded by the program"


@dataclass(frozen=True)
class Stop:
    """An exact stop of the path: curve parameter (mm), line of the block before it, and why."""

    u: float
    line: int
    reason: str


@dataclass(frozen=True, eq=False)
class ProgramPath:
    """A part program as a curve.

    Attributes
    ----------
    curve : ChainCurve
        The path; its parameter is arc length, mm (nearly, on tubes).  Its ``feed_caps`` are the program's F words, inf
        on rapids.
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
        How many blocks, corners, tubes, knots and stops the path has.
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


def program_path(program: Program, tolerance: float | None, limits: Limits) -> ProgramPath:
    """Make a smooth path within tolerance of a part program.

    Parameters
    ----------
    program : Program
    tolerance : float or None
        Largest distance between path and program, mm, in place of the program's own P words; None for those
        (0.01 mm where there is none).  G61 and G61.1 stay exact stops.
    limits : Limits
        Of the machine; they weigh where smoothness is worth most.

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
    if tolerance is not None:
        tolerance = positive_number(tolerance, "tolerance")
        if not np.isfinite(tolerance):
            raise InputError("tolerance = inf mm must be finite")
    program.require_axes(limits)
    blocks = Blocks.of(program, tolerance)
    at = [limits.axes.index(axis) for axis in blocks.axes]
    rows = {name: getattr(limits, name)[at] for name in ("velocity", "acceleration", "jerk")}
    shaped = Limits(limits.feed, **rows, axes=blocks.axes, rapid=limits.rapid)
    share = 1.0
    for _ in range(_MOST_TRIES):
        built = _build(blocks, shaped, share)
        found, largest = _measure(blocks, built)
        if largest <= 1.0:
            return _report(program, blocks, built, found, largest)
        share *= _NARROWER / largest
    raise SolverError(
        f"{program.source}: the path leaves the tolerance by {largest - 1.0:.2g} of it at abscissa {found.abscissa:.6g} mm; "
        "give a larger tolerance"
    )


@dataclass(frozen=True, eq=False)
class Blocks:
    """The blocks that move, in the axes that move: rows of the program with a length."""

    row: NDArray[np.intp]
    axes: tuple[str, ...]
    programmed: Programmed
    tolerance: FloatArray
    feed: FloatArray
    rapid: NDArray[np.bool_]
    stop: NDArray[np.bool_]

    @classmethod
    def of(cls, program: Program, tolerance: float | None, moves: NDArray[np.bool_] | None = None) -> Blocks:
        """Take the moves as legs, in the axes that move or those of ``moves`` (3,)."""
        row = np.flatnonzero(program.lengths > 0.0)
        if not row.size:
            raise CurveError(f"{program.source}: the program moves nothing; a path needs a move")
        moves = moving_axes(program) if moves is None else moves
        legs, length = _legs(program, row, moves)
        edges = np.concatenate([[0.0], np.cumsum(length)])
        given = program.tolerance[row]
        own = np.where(np.isnan(given), DEFAULT_TOLERANCE, given)
        if tolerance is not None:
            own = np.where(given == 0.0, 0.0, tolerance)
        rapid = program.kind[row] == RAPID
        halts = np.concatenate([[0], np.cumsum(program.stop_after)])
        # a stop between two moves that stay counts, also after a move of length 0
        stop = (halts[row[1:]] > halts[row[:-1]]) | rapid[:-1] | rapid[1:]
        axes = tuple(name for name, moving in zip(_AXES, moves, strict=True) if moving)
        return cls(row, axes, Programmed(edges, legs), own, program.feed[row], rapid, stop)


def moving_axes(program: Program) -> NDArray[np.bool_]:
    """Which of X, Y and Z move, (3,); at least two, since a path has two axes or more."""
    moves = np.maximum(program.start.max(axis=0), program.end.max(axis=0)) > np.minimum(
        program.start.min(axis=0), program.end.min(axis=0)
    )
    arcs = program.kind == ARC
    moves[np.unique((program.normal[arcs][:, None] + np.array([1, 2])) % 3)] = True
    if moves.sum() < 2:
        moves[[k for k in range(3) if not moves[k]][: 2 - int(moves.sum())]] = True
    return np.asarray(moves)


def _legs(program: Program, row: NDArray[np.intp], moves: NDArray[np.bool_]) -> tuple[Legs, FloatArray]:
    """Legs of the moves ``row`` in the axes that move, and their lengths."""
    start, end = program.start[row], program.end[row]
    length = program.lengths[row].copy()
    vectors, rates = np.zeros((row.size, 4, 3)), np.zeros((row.size, 2))
    vectors[:, 0] = start
    vectors[:, 3] = (end - start) / length[:, None]
    on = np.flatnonzero(program.kind[row] == ARC)
    if on.size:
        index = row[on]
        normal = np.eye(3)[program.normal[index]]
        spoke, last = start[on] - program.centre[index], end[on] - program.centre[index]
        spoke -= normal * np.sum(spoke * normal, axis=1)[:, None]
        last -= normal * np.sum(last * normal, axis=1)[:, None]
        radius, final = (np.sqrt(np.sum(part**2, axis=1)) for part in (spoke, last))
        vectors[on, 0] = start[on] - spoke
        vectors[on, 1] = spoke
        vectors[on, 2] = np.cross(normal, spoke)
        vectors[on, 3] = normal * (np.sum((end[on] - start[on]) * normal, axis=1) / length[on])[:, None]
        rates[on, 0] = program.sweep[index] / length[on]
        rates[on, 1] = np.where(np.abs(final - radius) > 1e-12 * radius, (final / radius - 1.0) / length[on], 0.0)
    return Legs(np.ascontiguousarray(vectors[:, :, moves]), rates), length


@dataclass(frozen=True, eq=False)
class _Built:
    """The pieces of a path and where they lie."""

    curve: ChainCurve
    u_edges: FloatArray
    s_edges: FloatArray
    junctions: Junctions
    tubes: list[Fitted]
    reasons: dict[int, str]


def _build(blocks: Blocks, limits: Limits, share: float) -> _Built:
    """Classify the junctions, fit the tubes, and put exact stops where one cannot be kept within tolerance.

    ``share`` is the part of the tolerance that the tubes may use.
    """
    junctions = classify(blocks.programmed, blocks.tolerance, blocks.stop)
    reasons: dict[int, str] = {}
    tubes: list[Fitted] = []
    todo = _stretches(blocks, junctions)[::-1]
    feed = np.where(blocks.rapid, np.inf, np.minimum(blocks.feed, limits.feed))
    while todo:
        stretch = todo.pop()
        narrowed = replace(stretch, tolerance=share * stretch.tolerance)
        fitted = replace(fit(narrowed, blocks.programmed, limits, feed), tolerance=stretch.tolerance)
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
    return _Built(*_assemble(blocks, junctions, tubes), junctions, tubes, reasons)


def _within(s: FloatArray, stretch: Stretch) -> NDArray[np.bool_]:
    return np.asarray((s > stretch.start) & (s < stretch.end))


def _stretches(blocks: Blocks, junctions: Junctions, first: float = -np.inf, last: float = np.inf) -> list[Stretch]:
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


def _spacing(blocks: Blocks, junctions: Junctions) -> FloatArray:
    """Knot spacing wanted at every junction."""
    length = np.diff(blocks.programmed.edges)
    allowed = np.minimum(blocks.tolerance[:-1], blocks.tolerance[1:])
    density = junctions.turn / (0.5 * (length[:-1] + length[1:]))
    return knotting.spacing_at(junctions.turn, junctions.bend, density, np.maximum(allowed, 1e-9))


def _with_arcs(
    blocks: Blocks, spacing: FloatArray, at: FloatArray, start: float, end: float
) -> tuple[FloatArray, FloatArray]:
    """Add the spacing that arcs want, at their ends within the stretch and between."""
    edges, rates = blocks.programmed.edges, blocks.programmed.legs.rates
    i = max(int(np.searchsorted(edges, start, side="right")) - 1, 0)
    j = int(np.searchsorted(edges, end, side="left"))
    arcs = i + np.flatnonzero(rates[i:j, 0] != 0.0)
    if arcs.size == 0:
        return at, spacing
    wanted = 0.4 / np.abs(rates[arcs, 0])
    lo, hi = np.maximum(edges[arcs], start), np.minimum(edges[arcs + 1], end)
    count = np.maximum(1, np.ceil((hi - lo) / wanted)).astype(int)
    index = np.repeat(np.arange(arcs.size), count + 1)
    within = np.arange(index.size) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    places = lo[index] + (hi - lo)[index] * within / count[index]
    s, spacings = np.concatenate([at, places]), np.concatenate([spacing, wanted[index]])
    order = np.argsort(s, kind="stable")
    return s[order], spacings[order]


def _assemble(blocks: Blocks, junctions: Junctions, tubes: list[Fitted]) -> tuple[ChainCurve, FloatArray, FloatArray]:
    """Chain the pieces: the curve, and its edges in u and in s."""
    edges = blocks.programmed.edges
    corners = np.flatnonzero(junctions.kind == Junction.CORNER)
    blends = blends_at(blocks.programmed, junctions, corners) if corners.size else None
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
    spans = np.concatenate([tube.powers for tube in tubes]) if tubes else np.empty((0, len(blocks.axes), 5))
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
        legs=blocks.programmed.legs,
        blends=blends,
        spans=spans,
        joints=u_edges[np.searchsorted(s_edges, joints)],
        stops=u_edges[np.searchsorted(s_edges, stops)],
        marks=np.interp(edges[1:-1][blocks.feed[1:] != blocks.feed[:-1]], s_edges, u_edges),
        axes=blocks.axes,
        name="program",
    )
    return curve, u_edges, s_edges


def _inside(s: FloatArray, lo: FloatArray, hi: FloatArray) -> NDArray[np.intp]:
    """Which of the disjoint, increasing intervals holds each s, -1 for none."""
    if lo.size == 0:
        return np.full(s.size, -1, dtype=np.intp)
    i = np.searchsorted(lo, s, side="right") - 1
    return np.where((i >= 0) & (s < hi[np.maximum(i, 0)]), i, -1)


def _measure(blocks: Blocks, built: _Built) -> tuple[Deviation, float]:
    """The largest deviation of tubes and corners, and the largest against its tolerance."""
    s, junctions = blocks.programmed.edges[1:-1], built.junctions
    corners = np.flatnonzero(junctions.kind == Junction.CORNER)
    reach = junctions.reach[corners]
    allowed = np.minimum(blocks.tolerance[corners], blocks.tolerance[corners + 1])
    lo = np.concatenate([s[corners] - reach, [tube.knots[0] for tube in built.tubes]])
    hi = np.concatenate([s[corners] + reach, [tube.knots[-1] for tube in built.tubes]])
    tolerance = np.concatenate([allowed, [tube.tolerance for tube in built.tubes]])
    widest = max([0.0, *reach, *(float(np.diff(tube.knots).max()) for tube in built.tubes)])
    order = np.argsort(lo)
    found, largest = Deviation(0.0, 0.0, 0.0, 0.0), 0.0
    for value in np.unique(tolerance):
        some = order[tolerance[order] == value]
        measured = deviation(
            built.curve,
            blocks.programmed,
            built.u_edges,
            built.s_edges,
            8.0 * value + 2.0 * widest,
            where=(lo[some], hi[some]),
        )
        found = max(found, measured, key=lambda item: item.largest)
        largest = max(largest, measured.largest / float(value))
    return found, largest


def _report(program: Program, blocks: Blocks, built: _Built, found: Deviation, share: float) -> ProgramPath:
    """Collect what belongs to a path."""
    edges, junctions = blocks.programmed.edges, built.junctions
    line = program.line[blocks.row]
    at = int(np.clip(np.searchsorted(edges, found.abscissa, side="right") - 1, 0, line.size - 1))
    u = np.interp(edges, built.s_edges, built.u_edges)
    stops = tuple(
        Stop(float(u[k + 1]), int(line[k]), _reason(blocks, junctions, built.reasons, int(k)))
        for k in np.flatnonzero(junctions.kind == Junction.STOP)
    )
    feed = blocks.feed
    changes = np.concatenate([[0], 1 + np.flatnonzero(feed[1:] != feed[:-1])])
    caps = FeedCaps(np.append(u[changes], u[-1]), feed[changes])
    counts = {
        "blocks": line.size,
        "corners": int(np.count_nonzero(junctions.kind == Junction.CORNER)),
        "tubes": len(built.tubes),
        "knots": sum(tube.knots.size for tube in built.tubes),
        "passes": max([0, *(tube.passes for tube in built.tubes)]),
        "iterations": sum(tube.iterations for tube in built.tubes),
        "stops": len(stops),
    }
    intervals = _INTERVALS_PER_CORNER * counts["corners"] + _INTERVALS_PER_KNOT * counts["knots"]
    for array in (line, u):
        array.setflags(write=False)
    return ProgramPath(
        curve=replace(built.curve, feed_caps=caps),
        line=line,
        u=u,
        rapid=blocks.rapid,
        stops=stops,
        tolerance=float(blocks.tolerance.max()),
        deviation=found,
        deviation_line=int(line[at]),
        deviation_share=share,
        intervals=max(_FEWEST_INTERVALS, intervals),
        counts=counts,
        notes=_notes(program, blocks, built),
    )


def _notes(program: Program, blocks: Blocks, built: _Built) -> tuple[str, ...]:
    """What a reader should know: noise in the blocks, and exact stops that nobody asked for."""
    notes = []
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
    notes += [
        f"exact stop after line {program.line[blocks.row[k]]}: {reason}" for k, reason in sorted(built.reasons.items())
    ]
    return tuple(notes)


def _reason(blocks: Blocks, junctions: Junctions, reasons: dict[int, str], k: int) -> str:
    """Why there is an exact stop at junction k."""
    if k in reasons:
        return reasons[k]
    if blocks.rapid[k] or blocks.rapid[k + 1]:
        return "beside a rapid"
    if blocks.stop[k]:
        return _DEMANDED
    if junctions.turn[k] > np.deg2rad(150.0):
        return f"a turn of {np.rad2deg(junctions.turn[k]):.0f} degrees"
    return "no tolerance"
