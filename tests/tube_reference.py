"""The tube's interior-point method in plain numpy with dense rows, and LAPACK's banded factor: what the core must do."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

GAP, MAX_ITERATIONS, TO_BOUNDARY, PENALTY, BOOSTS = 1e-4, 60, 0.99, 1e3, (0.0, 1e-13, 1e-11, 1e-9)


class DenseRows:
    """Rows as a dense matrix (count, n)."""

    def __init__(self, first, rows, offset, dim, size):
        self.offset, self.dim = offset, dim
        self.dense = np.zeros((first.size, size))
        for k in range(first.size):
            self.dense[k, first[k] * dim : first[k] * dim + rows.shape[1]] = rows[k]

    def values(self, control):
        return self.products(control) - self.offset

    def products(self, x):
        return self.dense @ x

    def transposed(self, y):
        return self.dense.T @ y


def lower_band(matrix, depth):
    return np.array([np.append(np.diagonal(matrix, -i), np.zeros(i)) for i in range(depth)])


def interior_point(rows, band, x, frozen):
    """Minimise over x (n,) in place; ``band`` (width, n) is the objective.  Returns the number of iterations."""
    width, n = band.shape
    objective = sum(np.diag(band[i, : n - i], -i) for i in range(width))
    objective = objective + np.tril(objective, -1).T
    gradient, value = objective @ x, rows.values(x)
    state = TubeIterate.start(value, 0.5 * float(gradient @ x))
    for count in range(1, MAX_ITERATIONS + 1):
        dual = gradient + rows.transposed(state.z1 - state.z2)
        dual[frozen] = 0.0
        system = objective + (rows.dense.T * state.curvature()) @ rows.dense
        system[frozen], system[:, frozen] = 0.0, 0.0
        system[frozen, frozen] = 1.0
        factor = banded_factor(lower_band(system, width))
        if factor is None:
            return count

        def solve(right, factor=factor):
            right[frozen] = 0.0
            return cho_solve_banded((factor, True), right)

        right, parts = state.condense(value, 0.0, None)
        dx = solve(-dual - rows.transposed(right))
        affine = state.step(rows.products(dx), parts)
        reach_p, reach_d = state.lengths(affine, 1.0)
        gap = state.gap
        centring = min(1.0, max((state.gap_after(affine, reach_p, reach_d) / gap) ** 3, 1e-5))
        right, parts = state.condense(value, centring * gap / (3.0 * state.e.size), affine)
        dx = solve(-dual - rows.transposed(right))
        step = state.step(rows.products(dx), parts)
        reach_p, reach_d = state.lengths(step, TO_BOUNDARY)
        x += reach_p * dx
        state.advance(step, reach_p, reach_d)
        value, gradient = rows.values(x), objective @ x
        cost = 0.5 * float(gradient @ x)
        if state.gap <= GAP * max(cost, 1e-12) and state.infeasibility(value) <= 1e-6:
            return count
    return MAX_ITERATIONS


def banded_factor(band):
    for boost in BOOSTS:
        try:
            raised = band.copy()
            raised[0] *= 1.0 + boost
            return cholesky_banded(raised, lower=True)
        except LinAlgError:
            continue
    return None


class TubeIterate:
    """Slacks s1 = 1 + e - r and s2 = 1 + e + r, elastics e and the multipliers z1, z2, y of the rows, all positive."""

    def __init__(self, s1: np.ndarray, s2: np.ndarray, e: np.ndarray, z1: np.ndarray, z2: np.ndarray, price: float):
        self.s1, self.s2, self.e, self.z1, self.z2 = s1, s2, e, z1, z2
        self.price = price
        self.y = np.full(e.size, price)

    @classmethod
    def start(cls, value: np.ndarray, cost: float) -> TubeIterate:
        """Strictly inside, complementarity the share of each row in the objective."""
        e = np.maximum(np.abs(value) - 0.9, 0.0) + 0.01
        mu = max(cost, 1e-8) / (2.0 * value.size)
        s1, s2 = 1.0 + e - value, 1.0 + e + value
        z1, z2 = mu / s1, mu / s2
        price = PENALTY * max(float(np.max(z1 + z2)), cost, 1e-8)
        return cls(s1, s2, e, z1, z2, price)

    @property
    def gap(self) -> float:
        """Sum of all complementarity products."""
        return float(self.s1 @ self.z1 + self.s2 @ self.z2 + self.e @ self.y)

    def infeasibility(self, value: np.ndarray) -> float:
        """Largest violation of the definitions of the slacks."""
        return float(np.abs(self.s1 - (1.0 + self.e - value)).max(initial=0.0))

    def curvature(self) -> np.ndarray:
        """D_k: what is left of a row's complementarity when its slacks and its elastic are eliminated."""
        d1, d2 = self.z1 / self.s1, self.z2 / self.s2
        return d1 + d2 - (d1 - d2) ** 2 / (d1 + d2 + self.y / self.e)

    def condense(
        self, value: np.ndarray, mu: float, affine: tuple[np.ndarray, ...] | None
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        """Right-hand side of every row, and what the back-substitution needs."""
        m1, m2, m3 = mu - self.s1 * self.z1, mu - self.s2 * self.z2, mu - self.e * self.y
        if affine is not None:
            ds1, ds2, de, dz1, dz2, dy = affine
            m1, m2, m3 = m1 - ds1 * dz1, m2 - ds2 * dz2, m3 - de * dy
        p1 = value - 1.0 - self.e + self.s1
        p2 = -value - 1.0 - self.e + self.s2
        py = self.price - self.z1 - self.z2 - self.y
        d1, d2 = self.z1 / self.s1, self.z2 / self.s2
        g1, g2 = (m1 + self.z1 * p1) / self.s1, (m2 + self.z2 * p2) / self.s2
        total = d1 + d2 + self.y / self.e
        h0, h1 = (m3 / self.e + g1 + g2 - py) / total, (d1 - d2) / total
        return g1 - g2 - (d1 - d2) * h0, (p1, p2, py, g1, g2, h0, h1, d1, d2)

    def step(self, dr: np.ndarray, parts: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        """Steps of s1, s2, e, z1, z2, y that go with the step dr of the rows."""
        p1, p2, py, g1, g2, h0, h1, d1, d2 = parts
        de = h0 + h1 * dr
        dz1, dz2 = g1 + d1 * (dr - de), g2 - d2 * (dr + de)
        return -p1 - dr + de, -p2 + dr + de, de, dz1, dz2, py - dz1 - dz2

    def lengths(self, step: tuple[np.ndarray, ...], fraction: float) -> tuple[float, float]:
        """Primal and dual step lengths that stay positive."""
        ds1, ds2, de, dz1, dz2, dy = step

        def longest(pairs: list[tuple[np.ndarray, np.ndarray]]) -> float:
            fall = max(float(np.max(-d / x, initial=0.0)) for x, d in pairs)
            return min(1.0, fraction / fall) if fall > 0.0 else 1.0

        return (
            longest([(self.s1, ds1), (self.s2, ds2), (self.e, de)]),
            longest([(self.z1, dz1), (self.z2, dz2), (self.y, dy)]),
        )

    def gap_after(self, step: tuple[np.ndarray, ...], primal: float, dual: float) -> float:
        """Sum of the products after a step."""
        ds1, ds2, de, dz1, dz2, dy = step
        pairs = ((self.s1, ds1, self.z1, dz1), (self.s2, ds2, self.z2, dz2), (self.e, de, self.y, dy))
        return float(sum((a + primal * da) @ (b + dual * db) for a, da, b, db in pairs))

    def advance(self, step: tuple[np.ndarray, ...], primal: float, dual: float) -> None:
        """Take the step."""
        ds1, ds2, de, dz1, dz2, dy = step
        self.s1, self.s2, self.e = self.s1 + primal * ds1, self.s2 + primal * ds2, self.e + primal * de
        self.z1, self.z2, self.y = self.z1 + dual * dz1, self.z2 + dual * dz2, self.y + dual * dy
