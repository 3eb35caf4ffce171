"""The deviation of a path of which some runs were found with their feed.

These are measured apart, with their own windows and fewer points on each of their pieces, which are short and many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.geometry.curve import Curve
from planner.programs.path.deviation import Deviation
from planner.programs.path.joint_runs import FoundRun
from planner.programs.path.measure import LinePlace, Written, largest_deviation
from planner.types import FloatArray

# Places between two nodes of a joint motion at which its deviation is looked at, before the largest are refined.
_PER_PIECE = 5


@dataclass(frozen=True, eq=False)
class MeasuredPath:
    """A path to be measured.

    Attributes
    ----------
    curve : Curve
    pieces : (k,) array
        Parameters at which its pieces begin and end.
    u_edges, s_edges : (n,) arrays
        Parameters, and the abscissae of the blocks that go with them.
    edges, own : (m + 1,) and (m,) arrays
        Of the blocks that it was made from: abscissae, and the tolerance in force, mm.
    written : Written
    """

    curve: Curve
    pieces: FloatArray
    u_edges: FloatArray
    s_edges: FloatArray
    edges: FloatArray
    own: FloatArray
    written: Written

    def largest(self, runs: Sequence[FoundRun], places: Sequence[LinePlace], widest: float) -> tuple[Deviation, float]:
        """The largest deviation, and the largest against its tolerance.

        Parameters
        ----------
        runs : sequence of FoundRun
        places : sequence of (float, float, float)
            Corners and tubes, as for ``largest_deviation``.
        widest : float
            The longest piece of these, mm.
        """
        inside = {line for run in runs if run.part is not None for line in self._lines(run)}
        apart = [line for line in self.written.lines if line not in inside]
        along = self.curve, self.u_edges, self.s_edges, replace(self.written, lines=apart)
        found = [largest_deviation(*along, places, widest, pieces=self.pieces), *self._of_runs(runs)]
        far = max((deviation for deviation, _ in found), key=lambda item: item.largest)
        return far, max(share for _, share in found)

    def share(self, run: FoundRun) -> float:
        """The largest deviation of a run against its tolerance; 0 of one that was not found."""
        return max((share for _, share in self._of_runs([run])), default=0.0)

    def places_of_run(self, run: FoundRun) -> list[LinePlace]:
        """Where a run that was found lies, block by block, and the tolerance there."""
        if run.part is None:
            return []
        if run.exact:  # it is the line, which may stand for several blocks
            return self._lines(run)
        some = range(run.first, run.last)
        return [(float(self.edges[k]), float(self.edges[k + 1]), float(self.own[k])) for k in some]

    def _lines(self, run: FoundRun) -> list[LinePlace]:
        """Lines of a run that stand for several blocks; their ends are those of blocks but for rounding."""
        first, last = np.searchsorted(self._middles, self.edges[[run.first, run.last]])
        return list(self.written.lines[first:last])

    @cached_property
    def _middles(self) -> FloatArray:
        return np.array([0.5 * (start + end) for start, end, _ in self.written.lines])

    def _of_runs(self, runs: Sequence[FoundRun]) -> list[tuple[Deviation, float]]:
        places = [place for run in runs for place in self.places_of_run(run)]
        if not places:
            return []
        widest = max(float(np.diff(run.part.abscissa).max()) for run in runs if run.part is not None)
        along = self.curve, self.u_edges, self.s_edges, replace(self.written, lines=[])
        return [largest_deviation(*along, places, widest, pieces=self.pieces, density=_PER_PIECE)]
