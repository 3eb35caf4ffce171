"""The time law of a plan: at increasing times the curve parameter u with its first two time derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.types import FloatArray


@dataclass(frozen=True, eq=False)
class TimeNodes:
    """Nodes of a time law: four (n,) arrays as in ``FeedrateProfile``; t starts at 0.

    ``steps (2, n - 1)``: t and u from node to node before they are rounded to sums, where the law knows them.  Between
    close nodes the last digits of t and u are worth a jerk; whoever mends an excess must not chase these.
    """

    t: FloatArray
    u: FloatArray
    u_rate: FloatArray
    u_acceleration: FloatArray
    steps: FloatArray | None = None

    def dilated(self, factor: float) -> TimeNodes:
        """The same law run ``factor`` times slower."""
        steps = None if self.steps is None else self.steps * np.array([[factor], [1.0]])
        # Sums of the dilated steps: products of the rounded times would round once more.
        t = self.t * factor if steps is None else np.concatenate([[0.0], np.cumsum(steps[0])])
        return TimeNodes(t, self.u, self.u_rate / factor, self.u_acceleration / factor**2, steps)

    def only(self, index: NDArray[np.intp]) -> TimeNodes:
        """The law through some of the nodes, first and last among them."""
        steps = None if self.steps is None else np.add.reduceat(self.steps, index[:-1], axis=1)
        nodes = TimeNodes(self.t[index], self.u[index], self.u_rate[index], self.u_acceleration[index], steps)
        nodes.keep_forward_at_stops()
        return nodes

    def keep_forward_at_stops(self) -> None:
        """Let u not fall back in an interval that ends at rest, where the solver's last digits shape the quintic.

        From rate v and acceleration a to rest over h and a distance D, u' = (h - t)^2 p(t) with a quadratic p whose value
        at the end has the sign of 20 D - 8 v h - a h^2; likewise, backwards in time, in one that begins at rest.
        """
        for rest, inner, sign in ((-1, -2, 1.0), (0, 1, -1.0)):
            h = abs(self.t[rest] - self.t[inner])
            if self.u_rate[rest] == 0.0 and h > 0.0:
                most = (20.0 * abs(self.u[rest] - self.u[inner]) / h - 8.0 * self.u_rate[inner]) / h
                self.u_acceleration[inner] = sign * min(sign * self.u_acceleration[inner], most)


def joined(parts: list[TimeNodes]) -> TimeNodes:
    """Join laws; at a stop the last node of one and the first of the next form a double node."""
    offsets = np.concatenate([[0.0], np.cumsum([part.t[-1] for part in parts])])
    return TimeNodes(
        np.concatenate([part.t + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
        np.concatenate([part.u for part in parts]),
        np.concatenate([part.u_rate for part in parts]),
        np.concatenate([part.u_acceleration for part in parts]),
    )
