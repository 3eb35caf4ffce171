"""From a solution in sigma to the nodes of a time law.

A solution gives x = sigma_dot^2 as a cubic on every interval.  Its time law has a node at each knot and at points between,

    t' = x^(-1/2) integrated by Gauss,   u_dot = u' x^(1/2),   u_ddot = u'' x + u' a,

with one-sided values at double knots.  Between nodes the law is the quintic of ``law.py``; that quintic, not the
cubic, is what ``utilisation.py`` measures, so what is measured is what will run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.compiled import core
from planner.law import TimeLaw
from planner.plan.time_knots import TimeGrid
from planner.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class SpeedLaw:
    """x = sigma_dot^2 as a piecewise cubic.

    ``sigma``, ``x``, ``a``, ``c`` at the knots, in the path's own units; equal neighbours in sigma are a double knot.
    """

    sigma: FloatArray
    x: FloatArray
    a: FloatArray
    c: FloatArray

    def at(self, sigma: FloatArray) -> FloatArray:
        """Evaluate x at any sigma."""
        i = np.clip(np.searchsorted(self.sigma, sigma, side="right") - 1, 0, self.sigma.size - 2)
        h = self.sigma[i + 1] - self.sigma[i]
        i = np.where(h > 0.0, i, i - 1)
        h = self.sigma[i + 1] - self.sigma[i]
        w = sigma - self.sigma[i]
        slope = (self.c[i + 1] - self.c[i]) / h
        return self.x[i] + w * (2.0 * self.a[i] + w * (self.c[i] + w * slope / 3.0))

    def time_law(self, grid: TimeGrid, counts: IntArray) -> TimeLaw:
        """Nodes at knots, and between: ``counts (m,)`` to each interval that is not empty, evenly.

        The steps of u are summed up from one exact point to the next: breaks, and what is taken as it is next to a stop;
        elsewhere the digits of u are those of a solve.  What is left over there beyond half a digit is spread over the
        steps by their length and the square of the times they take, since 60 e |C'| / dt^3 is the jerk of an error e; half
        a digit is not, since over two nodes a microsecond apart it would be a jerk beyond any limit.
        """
        at_breaks, on = grid.at_breaks, grid.map
        n = int(counts.sum()) + at_breaks.size
        # between macros that meet within a stretch all is continuous: one node
        kept = n - int(np.count_nonzero(~at_breaks))
        states, path, work = np.empty((3, n)), np.empty((5, n)), np.empty((4, n))
        moved, width, dt = np.empty(n), np.empty(n), np.empty(n)
        kind, macro = np.empty(n, dtype=np.uint8), np.empty(n, dtype=np.int64)
        core.speed_law_nodes(
            *(self.sigma.size, self.sigma, self.x, self.a, self.c, grid.macro, counts, *on.arguments, at_breaks),
            *(*on.beside_stops, n, states, path, moved, width, dt, kind, macro),
        )
        on.follow_native(path[:4], path[4], macro)
        u, advance = path[0].copy(), np.empty(n - 1)
        core.speed_law_advance(n, width, path, moved, advance)
        core.speed_law_in_step(n, kind, dt, advance, u, work)
        rate, acceleration = work[:2]  # has served
        core.speed_law_rates(n, states, path, moved, rate, acceleration, dt)
        del states, path, moved, width  # which bounds the memory
        table, steps = np.empty((4, kept)), np.empty((2, kept - 1))
        core.speed_law_table(n, kind, dt, advance, u, rate, acceleration, kept, table, steps)
        return TimeLaw(table[0], table[1], table[2], table[3], steps).forward_at_stops()
