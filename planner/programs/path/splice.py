"""Put the pieces of jointly found runs in the place of the blocks in a chain."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.geometry.blend import Legs
from planner.geometry.chain import ChainCurve, Kind
from planner.law import Timing
from planner.machine.limits import Limits
from planner.programs.path.joint_pieces import JointPart
from planner.programs.path.joint_runs import FoundRun
from planner.programs.path.moves import MovingBlocks
from planner.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Placed:
    """A chain and what lies where on it.

    Attributes
    ----------
    curve : ChainCurve
    u_edges, s_edges : (n,) arrays
        Parameters, and the abscissae of the blocks that go with them, both increasing.
    ends : (m + 1,) array
        Parameters at which the blocks begin and end.
    """

    curve: ChainCurve
    u_edges: FloatArray
    s_edges: FloatArray
    ends: FloatArray

    def at(self, s: FloatArray) -> FloatArray:
        """Parameters of abscissae (n,)."""
        return np.interp(s, self.s_edges, self.u_edges)


def spliced(placed: Placed, blocks: MovingBlocks, found: list[FoundRun], limits: Limits) -> Placed:
    """Replace the legs of whole runs by what was found for them.

    Parameters
    ----------
    placed : Placed
        A chain in which every block of these runs is a leg, and their ends are stops.
    blocks : MovingBlocks
    found : list of FoundRun
        In the order of the program.
    limits : Limits
        They were found for.
    """
    runs = [(run.first, run.last, run.part) for run in found if run.part is not None]
    if not runs:
        return placed
    curve, edges = placed.curve, blocks.programmed.edges
    first, last = (np.array(column) for column in list(zip(*runs, strict=True))[:2])
    parts = [part for _, _, part in runs]
    begin, end = np.searchsorted(placed.s_edges, edges[first]), np.searchsorted(placed.s_edges, edges[last])
    inside = np.zeros(curve.kind.size + 1, dtype=np.int64)
    np.add.at(inside, begin, 1)
    np.add.at(inside, end, -1)
    kept = np.flatnonzero(np.cumsum(inside)[:-1] == 0)
    # Groups in their order: a kept piece each, and a part each.
    order = np.argsort(np.concatenate([kept, begin]), kind="stable")
    totals = np.concatenate([np.diff(curve.edges)[kept], [part.edges[-1] for part in parts]])[order]
    starts = np.empty(order.size)
    starts[order] = np.concatenate([[0.0], np.cumsum(totals)[:-1]])
    of_kept, of_parts = starts[: kept.size], starts[kept.size :]
    pieces, joined = _pieces(curve, blocks, kept, runs)
    start = np.concatenate([of_kept, *(u + part.edges[:-1] for u, part in zip(of_parts, parts, strict=True))])
    order = np.argsort(start, kind="stable")
    length = float(np.cumsum(totals)[-1])
    u_edges = np.append(start[order], length)
    moved = np.full(curve.edges.size, np.nan)
    moved[kept], moved[begin], moved[-1] = of_kept, of_parts, length
    joints = [moved[np.searchsorted(curve.edges, curve.joints)]]
    stops = [moved[np.searchsorted(curve.edges, curve.stops)]]
    ends = _moved_ends(placed, moved)
    laws = []
    for u, (i, j, part) in zip(of_parts, runs, strict=True):
        joints.append(u + part.edges[1:-1])
        ends[i : j + 1] = u + part.ends
        laws.append(replace(part.law, u=u + part.law.u))
    marks = (blocks.feed[1:] != blocks.feed[:-1]) | blocks.apart
    new = replace(
        curve,
        edges=u_edges,
        kind=pieces[0][order].astype(np.int8),
        row=pieces[1][order].astype(np.intp),
        offset=pieces[2][order],
        legs=joined[0],
        spans=joined[1],
        joints=_inner(joints),
        stops=_inner(stops),
        marks=ends[1:-1][marks],
        timing=Timing(tuple(laws), limits),
    )
    along = [
        np.stack([of_kept, placed.s_edges[kept]]),
        *(np.stack([u + part.at, edges[i] + part.abscissa]) for u, (i, _, part) in zip(of_parts, runs, strict=True)),
        np.array([[length], [edges[-1]]]),
    ]
    u, s = np.concatenate(along, axis=1)
    at = np.unique(s, return_index=True)[1]
    return Placed(new, u[at], s[at], ends)


def _inner(parts: list[FloatArray]) -> FloatArray:
    found = np.unique(np.concatenate(parts))
    return found[np.isfinite(found)]


def _moved_ends(placed: Placed, moved: FloatArray) -> FloatArray:
    """Where the ends of the blocks outside of the runs are now."""
    old = placed.curve.edges
    piece = np.clip(np.searchsorted(old, placed.ends, side="right") - 1, 0, old.size - 1)
    return np.asarray(moved[piece] + (placed.ends - old[piece]))


def _pieces(
    curve: ChainCurve, blocks: MovingBlocks, kept: IntArray, runs: list[tuple[int, int, JointPart]]
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[Legs, FloatArray]]:
    """Kind, row and offset of the kept pieces and of those of the runs; the legs and spans of both."""
    columns, edges = blocks.columns, blocks.programmed.edges
    kind = np.concatenate([part.kind for _, _, part in runs])
    powers = np.concatenate([columns.spans(part.powers, float(edges[i])) for i, _, part in runs])
    legs = kind == Kind.LEG
    vectors = np.zeros((int(legs.sum()), 4, powers.shape[1]))
    vectors[:, 0], vectors[:, 3] = powers[legs, :, 0], powers[legs, :, 1]
    row = np.where(legs, curve.legs.vectors.shape[0] + np.cumsum(legs) - 1, len(curve.spans) + np.cumsum(~legs) - 1)
    pieces = (
        np.concatenate([curve.kind[kept], kind]),
        np.concatenate([curve.row[kept], row]),
        np.concatenate([curve.offset[kept], np.zeros(kind.size)]),
    )
    joined = curve.legs.joined(Legs(vectors, np.zeros((vectors.shape[0], 2))))
    return pieces, (joined, np.concatenate([curve.spans, powers[~legs]]))
