"""Chains of the paths of a drawing, found by the edge miner of ezdxf, and the choice of one.

Ends within the distance of a joint become one point before: the miner tells by the distance of two points whether they are
joined, and of three on a line, the outer two too far apart, it would run in a circle for ever.  A path that begins where it
ends is a chain of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import CurveError
from planner.geometry.drawing.bezier_pieces import Piece
from planner.geometry.drawing.drawn_entities import JOIN_MM, DrawnEntity
from planner.types import FloatArray

_EXACT = 1e-9  # mm: points that are one have the same numbers
_MAX_MEETING = 100  # ends in one point; the miner looks at all of them for each
_SHOWN = 8  # chains in a message


@dataclass(frozen=True, eq=False)
class Chain:
    """Paths in the order in which they are run, with whether each is run from its end to its start."""

    entities: tuple[tuple[DrawnEntity, bool], ...]
    closed: bool

    @property
    def pieces(self) -> list[Piece]:
        """The pieces in this order."""
        found: list[Piece] = []
        for entity, backwards in self.entities:
            found += [p.reversed() for p in reversed(entity.pieces)] if backwards else entity.pieces
        return found

    def __str__(self) -> str:
        """Say which it is: how many entities, from where to where, how long, on which layers."""
        pieces = self.pieces
        count = len(self.entities)
        first = _short(self.entities[0][0])
        what = first if count == 1 else f"{count} entities from {first}"
        where = "closed" if self.closed else f"{_shown(pieces[0].start)} to {_shown(pieces[-1].end)}"
        layers = ", ".join(dict.fromkeys(entity.layer for entity, _ in self.entities))
        return f"{what}, {where}, {sum(entity.length for entity, _ in self.entities):.4g} mm, layer {layers}"


def find_chains(entities: Sequence[DrawnEntity], where: str) -> list[Chain]:
    """All chains, in the order of their first entities in the file.

    A chain starts with the first of its entities that has a free end, the way it is drawn, or with the first of all where it
    is closed.
    """
    from ezdxf.edgeminer import Deposit, find_all_simple_chains, make_edge

    points, meeting = _joints(entities)
    if meeting.max() > _MAX_MEETING:
        raise CurveError(f"{where}: {_crowd(entities, points, int(np.argmax(meeting)))}")
    looped = (points[0::2] == points[1::2]).all(axis=1)
    chains = [Chain(((entities[k], False),), True) for k in np.flatnonzero(looped).tolist()]
    edges = [
        make_edge(points[2 * k].tolist(), points[2 * k + 1].tolist(), payload=k)
        for k in np.flatnonzero(~looped).tolist()
    ]
    for mined in find_all_simple_chains(Deposit(edges, gap_tol=_EXACT)) if edges else ():
        chains.append(_ordered([(int(edge.payload), bool(edge.is_reverse)) for edge in mined], points, entities))
    order = {id(entity): k for k, entity in enumerate(entities)}
    return sorted(chains, key=lambda chain: min(order[id(entity)] for entity, _ in chain.entities))


def _ordered(mined: list[tuple[int, bool]], points: FloatArray, entities: Sequence[DrawnEntity]) -> Chain:
    """The chain of paths by their numbers, begun where the rule says, whatever the miner began with."""
    first, last = mined[0], mined[-1]
    closed = bool((points[2 * first[0] + first[1]] == points[2 * last[0] + (not last[1])]).all())
    turned = [(k, not backwards) for k, backwards in reversed(mined)]
    if not closed:
        mined = min(mined, turned, key=lambda way: (way[0][1], way[0][0]))
    else:
        start = min(k for k, _ in mined)
        way = mined if (start, False) in mined else turned
        at = way.index((start, False))
        mined = way[at:] + way[:at]
    return Chain(tuple((entities[k], backwards) for k, backwards in mined), closed)


def _joints(entities: Sequence[DrawnEntity]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Ends of the paths, start and end of each, (2 n, 3), those of one joint at one point; and how many meet at each."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    points = np.array([end for entity in entities for end in (entity.start, entity.end)])
    pairs = cKDTree(points).query_pairs(JOIN_MM, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, joint = connected_components(links, directed=False)
    _, first, of, count = np.unique(joint, return_index=True, return_inverse=True, return_counts=True)
    return points[first[of]], count[of].astype(np.int64)


def choose_chain(chains: Sequence[Chain], number: int | None, where: str) -> tuple[Chain, int]:
    """Choose the chain of a number, from 1 on, or the only one.

    Raises
    ------
    CurveError
        If there is none of that number, or there are several and none is chosen: they are listed.
    """
    if number is None and len(chains) == 1:
        return _single(chains[0], where), 1
    if number is not None and 1 <= number <= len(chains):
        return _single(chains[number - 1], where), number
    listed = "; ".join(f"{k}: {chain}" for k, chain in enumerate(chains[:_SHOWN], 1))
    more = f"; and {len(chains) - _SHOWN} more" if len(chains) > _SHOWN else ""
    count = f"{len(chains)} chains" if len(chains) > 1 else "1 chain"
    if number is not None:
        raise CurveError(f"{where}: chain = {number} must be 1 to {len(chains)}; there is {listed}{more}")
    raise CurveError(
        f"{where}: the drawing has {count}; choose one by its number (--chain, chain=) or its layer (--layer, layer=): "
        f"{listed}{more}{_why_apart([entity for chain in chains for entity, _ in chain.entities])}"
    )


def _single(chain: Chain, where: str) -> Chain:
    """Refuse a path that is drawn twice: it would be run out and back."""
    if len(chain.entities) == 2 and chain.closed:
        (one, _), (other, _) = chain.entities
        out, back = one.pieces, [piece.reversed() for piece in reversed(other.pieces)]
        same = any(
            len(out) == len(way)
            and all(
                p.points.shape == q.points.shape and np.abs(p.points - q.points).max() <= JOIN_MM
                for p, q in zip(out, way, strict=True)
            )
            for way in (back, other.pieces)
        )
        if same:
            raise CurveError(f"{where}: {_short(one)} and {_short(other)} are the same path, drawn twice; delete one")
    return chain


def _why_apart(entities: list[DrawnEntity]) -> str:
    """Say where more than two ends meet, or how far the two nearest are apart."""
    from scipy.spatial import cKDTree

    points, meeting = _joints(entities)
    if meeting.max() > 2:
        return f"; {_crowd(entities, points, int(np.argmax(meeting)))}"
    free = np.flatnonzero(meeting == 1)
    if free.size < 2:
        return ""
    found = cKDTree(points[free]).query(points[free], k=2)
    distance, other = np.asarray(found[0]), np.asarray(found[1])
    nearest = int(np.argmin(distance[:, 1]))
    one, two = (int(free[k]) for k in (nearest, other[nearest, 1]))
    return (
        f"; the nearest ends, {_shown(points[one])} of {_short(entities[one // 2])} and {_shown(points[two])} of "
        f"{_short(entities[two // 2])}, are {distance[nearest, 1]:.6g} mm apart and join within {JOIN_MM} mm"
    )


def _crowd(entities: Sequence[DrawnEntity], points: FloatArray, end: int) -> str:
    """Say which entities meet in one place, and which of them are drawn twice."""
    ends = np.flatnonzero((points == points[end]).all(axis=1)).tolist()
    labels = list(dict.fromkeys(_short(entities[k // 2]) for k in ends))
    said = f"{len(ends)} ends meet at {_shown(points[end])}, of {', '.join(labels[:6])}"
    for i, one in enumerate(ends[:_MAX_MEETING]):
        for other in ends[i + 1 : _MAX_MEETING]:
            if one // 2 != other // 2 and (points[one ^ 1] == points[other ^ 1]).all():
                two = f"{_short(entities[one // 2])} and {_short(entities[other // 2])}"
                double = f"{two} have both ends in common, delete one if it is drawn twice"
                return f"{said}; a chain has two at every joint: {double}"
    return f"{said}; a chain has two at every joint: delete what does not belong to it"


def _shown(point: FloatArray) -> str:
    """A point in a message."""
    return f"({', '.join(f'{c:.6g}' for c in point)})"


def _short(entity: DrawnEntity) -> str:
    """An entity in a message that names the file already."""
    return entity.label.rpartition(": ")[2]
