"""The runs of a part of a long program: which lie wholly within it, and where it ends for them.

A run goes from exact stop to exact stop, and its path and feed are one problem, so no part ends inside one: a part that
begins at rest ends at a stop, as soon as it has pieces enough.  A run that is longer than what a part looks at is made
separately; a part inside of such a one goes on as if there were no others, up to the stop at which it ends, if that is in
sight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from planner.programs.long.path_source import PathSource
from planner.programs.path.corners import Junction, Junctions
from planner.programs.path.joint_runs import FoundRun, cuts_of, faster, find_run, left_out
from planner.programs.path.moves import MovingBlocks
from planner.programs.path.separate_path import separate_time

MAX_BLOCKS = 4000  # of a run; bounds the memory of its solver and of its window
_WANTED_PIECES = 8000  # of a part
_SAME = 1e-9  # mm, of abscissae


@dataclass(frozen=True, eq=False)
class PartRuns:
    """The runs of a part.

    Attributes
    ----------
    runs : tuple of FoundRun
        In their order, from the first block in sight counted.  The first may be one of which only the start is in sight.
    end : float
        Abscissa at which the part ends for them; inf where no stop is in sight.
    """

    runs: tuple[FoundRun, ...] = ()
    end: float = np.inf

    def left_out(self, measure: Callable[[FoundRun], float], again: Callable[[FoundRun, float], FoundRun]) -> PartRuns:
        """As :func:`~planner.programs.path.joint_runs.left_out` of the runs; the same where nothing is beyond."""
        given = list(self.runs)
        kept = left_out(given, measure, again)
        return self if kept is given else replace(self, runs=tuple(kept))

    def smoothed(self, junctions: Junctions) -> Junctions:
        """Junctions, of which those inside the runs found jointly are nothing."""
        kind, size = junctions.kind.copy(), junctions.size.copy()
        for run in self.runs:
            if run.part is not None:
                inside = slice(run.first, run.last - 1)
                kind[inside], size[inside] = Junction.SMOOTH, 0.0
        return replace(junctions, kind=kind, size=size)


@dataclass(frozen=True, eq=False)
class RunsInSight:
    """What the runs of a part are found from.

    Attributes
    ----------
    source : PathSource
        With the limits for which path and feed are found together.
    first : int
        Of the moves that absorption leaves, the one that the blocks begin with.
    blocks : MovingBlocks
        Those in sight.
    junctions : Junctions
        What these become where the path is made separately.
    """

    source: PathSource
    first: int
    blocks: MovingBlocks
    junctions: Junctions

    def run(self, first: int, last: int) -> FoundRun:
        """Find the run from one block to before another, or say why it is made separately."""
        if last - first > MAX_BLOCKS:
            return _too_long(first, last)
        assert self.source.joint is not None
        found = find_run(self.blocks, self.junctions, self.source.joint, first, last)
        return faster(found, self.junctions, self._separate_time)

    def found(self, pairs: Iterable[tuple[int, int]]) -> Iterator[FoundRun]:
        """The runs from each first block to before each last, each when it is asked for."""
        return (self.run(first, last) for first, last in pairs)

    def _separate_time(self, first: int, last: int) -> float:
        """Time of a run of the blocks in sight, s, if its path is made before its feed."""
        source = self.source
        assert source.joint is not None
        return separate_time(source.absorbed, source.used, source.joint, self.first + first, self.first + last)


def find_part_runs(
    blocks: MovingBlocks,
    junctions: Junctions,
    find: Callable[[Sequence[tuple[int, int]]], Iterator[FoundRun]],
    within: tuple[float, float],
    *,
    rests: bool,
) -> PartRuns:
    """Find the runs of a part.

    Parameters
    ----------
    blocks : MovingBlocks
        Those in sight.
    junctions : Junctions
        What these become where the path is made separately.
    find : callable
        Finds runs, as :meth:`RunsInSight.found` does.
    within : (float, float)
        Abscissae: at which the part begins, and up to which the blocks in sight decide what the path is.
    rests : bool
        The path rests at the start.
    """
    edges, (start, known) = blocks.programmed.edges, within
    seen = int(np.searchsorted(edges, known, side="right")) - 1
    cuts = cuts_of(blocks, junctions)
    cuts = cuts[(edges[cuts] > start - _SAME) & (edges[cuts] <= known)]
    begins = rests and cuts.size > 0 and edges[cuts[0]] < start + _SAME
    if begins and cuts.size == 1:
        return PartRuns((_too_long(int(cuts[0]), seen),))
    cuts = cuts if begins else cuts[edges[cuts] > start + _SAME]
    if not cuts.size:
        return PartRuns()
    runs: list[FoundRun] = []
    count, end = 0, cuts[0]
    pairs = list(pairwise(cuts.tolist()))
    for (first, last), run in zip(pairs, find(pairs), strict=True):
        runs.append(run)
        count += last - first if run.part is None else run.part.kind.size
        end = last
        if count >= _WANTED_PIECES:
            break
    return PartRuns(tuple(runs), float(edges[end]))


def _too_long(first: int, last: int) -> FoundRun:
    """A run that is made separately, and goes on at least to before the last block."""
    return FoundRun(first, last, None, f"it has no stop within {min(last - first, MAX_BLOCKS)} blocks")
