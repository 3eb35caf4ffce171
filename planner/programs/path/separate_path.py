"""The path of a program as it is made before its feed: legs, cubic corners and tubes.

Junctions become exact stops, cubic corners, or part of a tube (``corners``); what lies between stays the exact line, arc or
helix.  Runs that were found jointly stay legs, block by block, until their own pieces are put there (``splice``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.geometry.chain import ChainCurve, Kind
from planner.machine.limits import Limits
from planner.programs.path import tube_knots as knotting
from planner.programs.path.absorb import Absorbed
from planner.programs.path.chord_curvature import curvature_of_chords
from planner.programs.path.corners import Junction, Junctions, blends_at, classify
from planner.programs.path.feeds import caps_of_blocks
from planner.programs.path.measure import LinePlace
from planner.programs.path.moves import MovingBlocks, ProgramAxes
from planner.programs.path.splice import Placed
from planner.programs.path.stretch import Fitted, Stretch, fit
from planner.programs.reading.program import part_of
from planner.quantity import AXIS
from planner.types import BoolArray, FloatArray

# How far a tube goes on beyond its first and last junction, where the blocks are long, mm.  The knot spacing has grown
# to its largest by then.
MARGIN = 12.0
SHORT_REST = 2.0  # a leg between a tube and the end of a stretch that is shorter than this joins the tube, mm


@dataclass(frozen=True, eq=False)
class Built:
    """The pieces of a path and where they lie."""

    placed: Placed
    junctions: Junctions
    tubes: list[Fitted]
    reasons: dict[int, str]


def built_separately(
    blocks: MovingBlocks, limits: Limits, share: float, room: FloatArray | None, joint: list[tuple[int, int]]
) -> Built:
    """Classify the junctions, fit the tubes, and put exact stops where one cannot be kept within tolerance.

    ``share`` is the part of the tolerance that the tubes may use, ``room`` what the corners may; ``joint`` are the first
    blocks of the runs that stay as they are, and those after their last.
    """
    junctions = classified(blocks, room)
    for first, last in joint:
        junctions.kind[first : last - 1], junctions.size[first : last - 1] = Junction.SMOOTH, 0.0
    reasons: dict[int, str] = {}
    tubes: list[Fitted] = []
    todo = tube_stretches(blocks, junctions)[::-1]
    feed = np.where(blocks.rapid | blocks.angular, blocks.feed, np.minimum(blocks.feed, limits.feed))
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
        todo += tube_stretches(blocks, junctions, stretch.start, stretch.end)[::-1]
    curve, u_edges, s_edges = assemble(blocks, junctions, tubes)
    placed = Placed(curve, u_edges, s_edges, np.interp(blocks.programmed.edges, s_edges, u_edges))
    return Built(placed, junctions, tubes, reasons)


def shaping(limits: Limits) -> Limits:
    """What of the limits shapes a path that is made before its feed."""
    rows: dict[str, Any] = {q.key: getattr(limits, q.key) for q in AXIS}
    return Limits(limits.feed, **rows, axes=limits.axes, rapid=limits.rapid)


def separate_time(absorbed: Absorbed, used: ProgramAxes, limits: Limits, first: int, last: int) -> float:
    """Time of a run of the blocks that absorption leaves, s, if its path is made before its feed.

    Parameters
    ----------
    absorbed : Absorbed
    used : ProgramAxes
        What the program moves.
    limits : Limits
        Of these axes, whole.
    first, last : int
        The first block of the run, and the one after its last.
    """
    from planner.plan import plan_feedrate

    some = MovingBlocks.of(part_of(absorbed.program, slice(first, last)), None, used)
    placed = built_separately(some, shaping(limits), 1.0, absorbed.room[first : last - 1], []).placed
    caps = caps_of_blocks(placed.ends, some.feed, some.angular)
    return plan_feedrate(replace(placed.curve, feed_caps=caps), limits).duration


def classified(blocks: MovingBlocks, room: FloatArray | None) -> Junctions:
    """What the junctions of the blocks become; ``room`` is what the corners may use."""
    return classify(blocks.programmed, blocks.tolerance, blocks.stop, room, blocks.apart)


def _within(s: FloatArray, stretch: Stretch) -> NDArray[np.bool_]:
    return np.asarray((s > stretch.start) & (s < stretch.end))


def tube_stretches(
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
    new = np.concatenate([[True], (np.diff(after) > 0) | (np.diff(s[features]) > 2.0 * MARGIN + SHORT_REST)])
    begin = np.flatnonzero(new)
    end = np.append(begin[1:], features.size) - 1
    spacing, chords = _spacing(blocks, junctions)
    out = []
    for i, j in zip(begin, end, strict=True):
        lo, hi = left[i], right[i]
        start, finish = s[features[i]] - MARGIN, s[features[j]] + MARGIN
        start = lo if start < lo + SHORT_REST else start
        finish = hi if finish > hi - SHORT_REST else finish
        rests = (bool(start == lo and stops[after[i]]), bool(finish == hi and stops[after[i] + 1]))
        inside = slice(features[i], features[j] + 1)
        vertices = s[inside]
        at, wanted = _with_arcs(blocks, spacing[inside], vertices, start, finish)
        of_chords = np.isin(at, vertices[chords[inside]])
        sharp = vertices[junctions.turn[inside] > knotting.SHARP]
        first, last = blocks_between(edges, start, finish)
        allowed = blocks.tolerance[first:last]
        most = float(allowed.max())
        parts = edges[first : last + 1], allowed / most
        out.append(Stretch(float(start), float(finish), rests, at, wanted, of_chords, vertices, sharp, most, *parts))
    return out


def blocks_between(edges: FloatArray, start: float, end: float) -> tuple[int, int]:
    """The first block between two abscissae, and the one after the last."""
    first = int(np.clip(np.searchsorted(edges, start, side="right") - 1, 0, edges.size - 2))
    return first, int(np.clip(np.searchsorted(edges, end, side="left"), first + 1, edges.size - 1))


def _spacing(blocks: MovingBlocks, junctions: Junctions) -> tuple[FloatArray, BoolArray]:
    """Knot spacing wanted at every junction, and which are those of chords."""
    length = np.diff(blocks.programmed.edges)
    allowed = np.minimum(blocks.tolerance[:-1], blocks.tolerance[1:])
    density = junctions.turn / (0.5 * (length[:-1] + length[1:]))
    smooth = (junctions.kind <= Junction.TUBE) & (junctions.turn < knotting.SHARP)
    curvature, chords = curvature_of_chords(blocks.programmed, smooth, junctions.turn, allowed)
    allowed = np.maximum(allowed, 1e-9)
    return knotting.spacing_at(junctions.turn, junctions.bend, density, curvature, allowed), chords


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


def assemble(
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


def places_of(edges: FloatArray, own: FloatArray, junctions: Junctions, tubes: list[Fitted]) -> list[LinePlace]:
    """Abscissae between which a path is not the program itself, and the tolerance in force there."""
    s, reach = edges[1:-1], junctions.reach
    corners = np.flatnonzero(junctions.kind == Junction.CORNER)
    places = [(float(s[k] - reach[k]), float(s[k] + reach[k]), float(min(own[k], own[k + 1]))) for k in corners]
    for tube in tubes:
        lo, hi = float(tube.knots[0]), float(tube.knots[-1])
        first, last = blocks_between(edges, lo, hi)
        change = first + 1 + np.flatnonzero(np.diff(own[first:last]))
        begins = [lo, *edges[change].tolist()]
        places += zip(begins, [*begins[1:], hi], own[np.append(first, change)].tolist(), strict=True)
    return places


def widest_piece(junctions: Junctions, tubes: list[Fitted]) -> float:
    """Length of the longest piece of the corners and tubes, mm."""
    widest = [float(np.diff(tube.knots).max()) for tube in tubes]
    return max([float(junctions.reach.max(initial=0.0)), *widest])
