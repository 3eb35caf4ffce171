"""One iteration of the interior-point method in plain numpy, its Newton step by the dense KKT system: what the core must do.

Nothing here knows of Riccati recursions, blocks, or the order of points: points are rows of a dense map from the states at
the knots, the cubics and the ends are equations, and the step is one ``numpy.linalg.solve``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.plan.collocation import states_between

HOPE, LEAST_CENTRING, MOST_FALL = 2.0, 1e-4, 0.9


@dataclass
class Reference:
    """States z (3, n) at the knots, slacks and multipliers (sides, p): the speed, then both sides of every row."""

    problem: object
    z: np.ndarray
    slack: np.ndarray
    dual: np.ndarray
    clipped: bool = False

    def __post_init__(self):
        n = self.z.shape[1]
        eye = np.eye(3 * n).reshape(3 * n, 3, n)
        h, inner = self.problem.h, self.problem.inner
        # (p, 3, 3n): x, a, c of every point from all x, all a, all c
        self.points = np.stack([states_between(h, unit, inner) for unit in eye], axis=-1).transpose(1, 0, 2)
        acceleration, jerk = self.problem.acceleration, self.problem.jerk
        rows = np.zeros((len(acceleration) + len(jerk), self.problem.cap.size, 3))
        rows[: len(acceleration), :, :2] = acceleration.r.transpose(0, 2, 1)
        rows[len(acceleration) :] = jerk.r.transpose(0, 2, 1)
        speed = np.zeros((1, self.problem.cap.size, 3))
        speed[0, :, 0] = 1.0 / self.problem.cap
        self.rows = np.concatenate([speed, np.stack([rows, -rows], axis=1).reshape(-1, *rows.shape[1:])])
        sizes = np.minimum(np.concatenate([acceleration.bounds, jerk.bounds]), 1e9).reshape(-1)
        self.sizes = np.concatenate([[1.0], sizes])[:, None]
        self.is_jerk = np.arange(self.sizes.size)[:, None] >= 1 + 2 * len(acceleration)

    def at_points(self, z):
        return states_between(self.problem.h, z, self.problem.inner)

    def over(self, x, values, pace=None):
        """How far every side is beyond its bound, (sides, p)."""
        pace = x**-0.5 if pace is None else pace
        return values - self.sizes * np.where(self.is_jerk, pace, 1.0)

    def equations(self):
        """Rows of what a step keeps: the cubics, and what the ends prescribe."""
        n, h = self.z.shape[1], self.problem.h
        x, a, c = np.eye(3 * n).reshape(3, n, 3 * n)
        hh = h[:, None]
        rows = [
            x[1:] - x[:-1] - 2.0 * hh * a[:-1] - hh**2 * (2.0 * c[:-1] + c[1:]) / 3.0,
            a[1:] - a[:-1] - 0.5 * hh * (c[:-1] + c[1:]),
        ]
        if not np.isnan(self.problem.start):
            rows.append(x[:1])
        if not np.isnan(self.problem.start_slope):
            rows.append(a[:1])
        if not np.isnan(self.problem.end):
            rows.append(x[-1:])
        if self.problem.periodic:
            rows += [x[-1:] - x[:1], a[-1:] - a[:1], c[-1:] - c[:1]]
        return np.concatenate(rows)

    def gradients(self):
        """Of every side over x, a, c of its point, (sides, p, 3): the bound moves with the pace."""
        x = self.at_points(self.z)[0]
        out = self.rows.copy()
        out[:, :, 0] += np.where(self.is_jerk, self.sizes * 0.5 * x**-1.5, 0.0)
        return out

    def newton(self, target, product):
        """The step (3, n), and its slacks and multipliers, that aims at s l = target - product."""
        x = self.at_points(self.z)[0]
        g = self.gradients()
        over = self.over(x, np.einsum("rpk,kp->rp", self.rows, self.at_points(self.z)))
        stiff = self.dual / self.slack
        e = (target - product + self.dual * (self.slack + over)) / self.slack
        load = (np.where(self.is_jerk, self.sizes, 0.0) * self.dual).sum(axis=0)
        weight = self.problem.weight
        hessian = np.einsum("rp,rpi,rpj->pij", stiff, g, g)
        curvature = weight - load
        hessian[:, 0, 0] += 0.75 * (np.maximum(curvature, 0.0) if self.clipped else curvature) * x**-2.5
        gradient = np.einsum("rp,rpk->pk", e, g)
        gradient[:, 0] -= 0.5 * weight * x**-1.5
        bent = np.einsum("pij,pjb->pib", hessian, self.points)
        full = np.tensordot(self.points, bent, axes=([0, 1], [0, 1]))
        right = np.einsum("pia,pi->a", self.points, gradient)
        rows = self.equations()
        if not self.clipped and not self.is_convex(full):
            self.clipped = True
            return self.newton(target, product)
        system = np.block([[full, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        step = np.linalg.solve(system, np.concatenate([-right, np.zeros(len(rows))]))[: full.shape[0]].reshape(3, -1)
        ds = -over - np.einsum("rpk,kp->rp", g, self.at_points(step)) - self.slack
        dl = (target - product - self.dual * ds) / self.slack - self.dual
        return step, ds, dl

    def is_convex(self, hessian):
        """Positive definite for all controls from a given first state: what the pivots of the recursion say."""
        n = self.z.shape[1]
        rows = self.equations()[: 2 * (n - 1)]
        first = np.zeros((3, 3 * n))
        first[[0, 1, 2], [0, n, 2 * n]] = 1.0
        rows = np.concatenate([rows, first])
        null = np.linalg.qr(rows.T, mode="complete")[0][:, len(rows) :]
        return bool(np.linalg.eigvalsh(null.T @ hessian @ null).min() > 0.0)

    def iterate(self):
        """One predictor-corrector step."""
        gap, size = float((self.slack * self.dual).sum()), self.slack.size
        x, weight = self.at_points(self.z)[0], self.problem.weight
        time = float(weight @ x**-0.5)
        step, ds, dl = self.newton(0.0, 0.0)
        primal, dual = min(1.0, 1.0 / (-ds / self.slack).max()), min(1.0, 1.0 / (-dl / self.dual).max())
        affine = float(((self.slack + primal * ds) * (self.dual + dual * dl)).sum())
        hope = float(weight @ (0.5 * x**-1.5 * self.at_points(step)[0]))
        weight_of_hope = HOPE if gap >= 1e-2 * time else 0.125 * HOPE
        centring = min(max((affine / gap) ** 3, weight_of_hope * hope / gap, LEAST_CENTRING), 1.0)
        step, ds, dl = self.newton(centring * gap / size, np.sqrt(primal * dual) * ds * dl)
        fraction = min(max(1.0 - gap / time, 0.9), 0.995)
        fall = (-self.at_points(step)[0] / x).max()
        primal = min(length(float((-ds / self.slack).max()), fraction), length(float(fall), MOST_FALL))
        dual = length(float((-dl / self.dual).max()), fraction)
        self.z = self.z + primal * step
        state = self.at_points(self.z)
        over = self.over(state[0], np.einsum("rpk,kp->rp", self.rows, state))
        self.slack = np.maximum(self.slack + primal * ds, -over)
        self.dual = self.dual + dual * dl

    @property
    def totals(self):
        """Gap, time, and the largest violation relative to 1 + pace and to the bound's size."""
        state = self.at_points(self.z)
        over = self.slack + self.over(state[0], np.einsum("rpk,kp->rp", self.rows, state))
        scale = np.maximum(self.sizes, 1.0) * (1.0 + np.where(self.is_jerk, state[0] ** -0.5, 1.0))
        time = float(self.problem.weight @ state[0] ** -0.5)
        return float((self.slack * self.dual).sum()), time, float((over / scale).max())


def length(decrease, fraction):
    return fraction / decrease if decrease > fraction else 1.0
