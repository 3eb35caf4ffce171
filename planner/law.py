"""The time law of a plan: the curve parameter u as a function of time.

A law is a table: at increasing times t_i the curve parameter u and its first two time derivatives.  Between two nodes u(t)
is the quintic that takes these values, so u, its rate and its acceleration are continuous, and the plan that is checked,
written, read back and replayed is one and the same function.  Where the parametrisation itself jumps (a knot at which |C'|
or C'' changes) two nodes share t and u and carry the values of either side.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.types import FloatArray


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """The curve parameter as a function of time, by its nodes.

    Attributes
    ----------
    t, u, u_rate, u_acceleration : (n,) arrays
        Times, s, from 0 on; the curve parameter there, and its first two time derivatives.
    steps : (2, n - 1) array, optional
        t and u from node to node before they are rounded to sums, where the law knows them.  Between close nodes the last
        digits of t and u are worth a jerk; whoever mends an excess must not chase these.
    """

    t: FloatArray
    u: FloatArray
    u_rate: FloatArray
    u_acceleration: FloatArray
    steps: FloatArray | None = None

    def __post_init__(self) -> None:
        for array in (self.t, self.u, self.u_rate, self.u_acceleration, self.steps):
            if array is not None:
                array.setflags(write=False)

    @property
    def duration(self) -> float:
        """Time from start to end, s."""
        return float(self.t[-1])

    def coefficients(self, i: NDArray[np.intp]) -> FloatArray:
        """Coefficients (6, m), ascending powers of the time since node i, of the quintics from the nodes i (m,) on.

        The intervals must have a length.
        """
        ends = ((self.u[at], self.u_rate[at], self.u_acceleration[at]) for at in (i, i + 1))
        return quintic_coefficients(self.t[i + 1] - self.t[i], *ends)

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Evaluate u and its first three time derivatives at times (m,) within the law; at a double node, its right side."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, self.t.size - 2)
        while True:  # the last node may be double
            empty = self.t[i + 1] <= self.t[i]
            if not empty.any():
                break
            i = i - empty
        c, w = self.coefficients(i), t - self.t[i]
        value = c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * c[5]))))
        first = c[1] + w * (2.0 * c[2] + w * (3.0 * c[3] + w * (4.0 * c[4] + w * 5.0 * c[5])))
        second = 2.0 * c[2] + w * (6.0 * c[3] + w * (12.0 * c[4] + w * 20.0 * c[5]))
        third = 6.0 * c[3] + w * (24.0 * c[4] + w * 60.0 * c[5])
        return np.clip(value, float(self.u[0]), float(self.u[-1])), first, second, third

    def dilated(self, factor: float) -> TimeLaw:
        """The same law run ``factor`` times slower."""
        steps = None if self.steps is None else self.steps * np.array([[factor], [1.0]])
        # Sums of the dilated steps: products of the rounded times would round once more.
        t = self.t * factor if steps is None else np.concatenate([[0.0], np.cumsum(steps[0])])
        return TimeLaw(t, self.u, self.u_rate / factor, self.u_acceleration / factor**2, steps)

    def only(self, index: NDArray[np.intp]) -> TimeLaw:
        """The law through some of the nodes, first and last among them."""
        steps = None if self.steps is None else np.add.reduceat(self.steps, index[:-1], axis=1)
        law = TimeLaw(self.t[index], self.u[index], self.u_rate[index], self.u_acceleration[index], steps)
        return law.forward_at_stops()

    def forward_at_stops(self) -> TimeLaw:
        """Let u not fall back in an interval that ends at rest, where the solver's last digits shape the quintic.

        From rate v and acceleration a to rest over h and a distance D, u' = (h - t)^2 p(t) with a quadratic p whose value
        at the end has the sign of 20 D - 8 v h - a h^2; likewise, backwards in time, in one that begins at rest.
        """
        acceleration = self.u_acceleration.copy()
        for rest, inner, sign in ((-1, -2, 1.0), (0, 1, -1.0)):
            h = abs(self.t[rest] - self.t[inner])
            if self.u_rate[rest] == 0.0 and h > 0.0:
                most = (20.0 * abs(self.u[rest] - self.u[inner]) / h - 8.0 * self.u_rate[inner]) / h
                acceleration[inner] = sign * min(sign * acceleration[inner], most)
        return replace(self, u_acceleration=acceleration)

    @staticmethod
    def joined(parts: Sequence[TimeLaw]) -> TimeLaw:
        """Join laws; at a stop the last node of one and the first of the next form a double node."""
        offsets = np.concatenate([[0.0], np.cumsum([part.t[-1] for part in parts])])
        return TimeLaw(
            np.concatenate([part.t + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
            np.concatenate([part.u for part in parts]),
            np.concatenate([part.u_rate for part in parts]),
            np.concatenate([part.u_acceleration for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class Timing:
    """The feed of a curve that was found together with its path.

    Attributes
    ----------
    laws : tuple of TimeLaw
        On stretches from stop to stop, in their order; the times of each begin at 0, u is the curve's parameter.
    limits : Hashable
        The limits they were found for: equal ones are kept by them, and under no other are they the fastest.
    """

    laws: tuple[TimeLaw, ...]
    limits: Hashable

    def between(self, start: float, end: float) -> TimeLaw | None:
        """The law of the stretch from start to end, None if there is none."""
        law = self._by_start.get(start)
        return law if law is not None and law.u[-1] == end else None

    @cached_property
    def _by_start(self) -> dict[float, TimeLaw]:
        return {float(law.u[0]): law for law in self.laws}

    def covers(self, u: float) -> bool:
        """Whether u lies inside one of the stretches, not at an end."""
        k = int(np.searchsorted([law.u[0] for law in self.laws], u)) - 1
        return k >= 0 and u < float(self.laws[k].u[-1])


def quintic_coefficients(
    duration: FloatArray,
    start: tuple[FloatArray, FloatArray, FloatArray],
    end: tuple[FloatArray, FloatArray, FloatArray],
) -> FloatArray:
    """Coefficients (6, n), ascending powers of the time since the start, of the quintics between pairs of nodes.

    With h the duration, D = u1 - u0 and dots for time derivatives,

        c0..c2 = u0, u0', u0''/2
        c3 = [ 20 D - ( 8 u1' + 12 u0') h - (3 u0'' -   u1'') h^2] / 2 h^3
        c4 = [-30 D + (14 u1' + 16 u0') h + (3 u0'' - 2 u1'') h^2] / 2 h^4
        c5 = [ 12 D -   6 (u1' + u0')  h + (   u1'' -   u0'') h^2] / 2 h^5

    Parameters
    ----------
    duration : (n,) array
        Positive.
    start, end : three (n,) arrays each
        u, its rate and its acceleration.
    """
    h = duration
    u0, v0, a0 = start
    u1, v1, a1 = end
    # D less its second-order part: the large common terms cancel here once, not in each coefficient.
    rest = (u1 - u0) - h * (v0 + 0.5 * a0 * h)
    dv = (v1 - v0 - a0 * h) * h
    da = (a1 - a0) * h**2
    return np.stack(
        [
            u0,
            v0,
            0.5 * a0,
            (10.0 * rest - 4.0 * dv + 0.5 * da) / h**3,
            (-15.0 * rest + 7.0 * dv - da) / h**4,
            (6.0 * rest - 3.0 * dv + 0.5 * da) / h**5,
        ]
    )
