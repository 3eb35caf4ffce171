"""The joint problem's Newton system in plain numpy: rows as defined, derivatives by complex steps, a dense solve."""

from itertools import pairwise

import numpy as np

_STEP = 1e-30


class Problem:
    """As joint.h has it; x and u are those of the iterate."""

    def __init__(self, **given):
        self.__dict__.update(given)
        self.d = self.vectors.shape[2]
        self.n = self.switches.size
        self.nx = 3 * self.d + 1

    def foot(self, leg, p):
        o, _, _, g = self.vectors[leg]
        at = (p - o) @ g
        at = 0.0 if at.real < 0.0 else self.lengths[leg] if at.real > self.lengths[leg] else at
        return o + at * g

    def rows(self, i, z):
        """Values of the rows of a stage at z, its state and control; in no order that matters."""
        d, cube = self.d, self.scale[i] ** 3
        x, u = z[: self.nx], z[self.nx :]
        if self.switches[i]:
            return np.array([(self.least - u[0]) / cube])
        g, w = x[3 * d] / cube, self.share[i]
        p, v, a = x[:d], x[d : 2 * d], x[2 * d : 3 * d]
        places, speeds = [], []
        b = [p, p + w * v / 3.0, p + 2.0 * w * v / 3.0 + w**2 * a / 6.0, p + w * v + w**2 * a / 2.0 + w**3 * u / 6.0]
        left, right = halves(b)
        places += [*left[1:3], *right[1:3]]
        left, right = halves([v, v + w * a / 2.0, v + w * a + w**2 * u / 2.0])
        speeds += [left[1], right[1]]
        found = [self.near[i, 1] * ((q - self.foot(self.leg[i], q)) ** 2).sum() - 1.0 for q in places]
        pace = [self.pace[i, 1]] * 2
        sided = places[:2] if i == self.n - 1 else places[2:] if i < 2 else places
        found += [row for q in sided for row in self.walled(i, q, self.near[i, 1], False)]
        if i > 1:
            corner = self.switches[i - 1] and self.leg[i - 2] != self.leg[i]
            near = self.vectors[self.leg[i], 0] if corner else self.foot(self.leg[i], p)
            found.append(self.near[i, 0] * ((p - near) ** 2).sum() - 1.0)
            found += self.walled(i, p, self.near[i, 0], corner)
            speeds.append(v)
            pace.append(self.pace[i, 0])
            found += self.sided(a, self.axes[1], self.scale[i] ** 2, g ** (2.0 / 3.0))
        for by, speed in zip(pace, speeds, strict=True):
            if by > 0.0:
                found.append(by * (speed**2).sum() / self.scale[i] ** 2 - g ** (2.0 / 3.0))
            found += self.sided(speed, self.axes[0], self.scale[i], g ** (1.0 / 3.0))
        found += self.sided(u, self.axes[2], cube, g)
        return np.array(found)

    def walled(self, i, p, near, corner):
        """Of a stage, at p: rows of the sides of its leg, and of those beside it that are kept along it or at their node."""
        if self.walls is None:
            return []
        d, leg = self.d, self.leg[i]
        before, after = self.walls[leg, d:]
        legs = [leg, *[leg - 1] * int(before or corner), *[leg + 1] * int(after)]
        return [-np.sqrt(near) * self.walls[k, :d] @ (p - self.vectors[k, 0]) for k in legs if self.walls[k, :d].any()]

    @staticmethod
    def sided(y, per, unit, most):
        return [sign * y[k] * per[k] / unit - most for k in np.flatnonzero(per) for sign in (1.0, -1.0)]

    def arrive(self, i, z):
        d, x, u = self.d, z[: self.nx], z[self.nx :]
        p, v, a, c = x[:d], x[d : 2 * d], x[2 * d : 3 * d], x[3 * d :]
        if self.switches[i]:
            r = (u[0] / c[0]) ** (1.0 / 3.0)
            return np.concatenate([p, r * v, r**2 * a, u[:1]])
        w = self.share[i]
        end = [p + w * v + w**2 * a / 2.0 + w**3 * u / 6.0, v + w * a + w**2 * u / 2.0, a + w * u, c]
        return np.concatenate(end)

    def newton(self, start, aim, x, u, prices, price):
        """The step (dx, du) that a dense solve of the whole Newton system gives."""
        mu, weight, hold = aim
        sizes = [self.nx + (1 if s else self.d) for s in self.switches]
        first = np.concatenate([[0], np.cumsum(sizes)])
        total, free = first[-1] + self.nx, self.nx * (self.n + 1)
        matrix, right = np.zeros((total + free,) * 2), np.zeros(total + free)
        matrix[total + np.arange(self.nx), np.arange(self.nx)] = 1.0  # the first state is given
        for i in range(self.n):
            z = np.concatenate([x[i], u[i, : sizes[i] - self.nx]])
            at = slice(first[i], first[i + 1])
            hessian, gradient = self.stage(i, z, start, mu, hold, prices[i + 1])
            matrix[at, at] += hessian
            right[at] -= gradient
            row = total + self.nx * (i + 1) + np.arange(self.nx)
            matrix[row, at] = jacobian(lambda z, i=i: self.arrive(i, z), z)
            matrix[row, first[i + 1] + np.arange(self.nx)] = -1.0
            right[row] = -(self.arrive(i, z) - x[i + 1])
        last = first[-1] + np.arange(3 * self.d)
        matrix[last, last] += weight
        right[last] -= price + weight * (x[-1, :-1] - self.target)
        matrix[:total, total:] = matrix[total:, :total].T
        solved = np.linalg.solve(matrix, right)
        dx = np.array([solved[k : k + self.nx] for k in first])
        du = np.zeros_like(u)
        for i in range(self.n):
            du[i, : sizes[i] - self.nx] = solved[first[i] + self.nx : first[i + 1]]
        return dx, du

    def stage(self, i, z, start, mu, hold, prices):
        """Hessian and gradient of the barrier problem's Lagrangian over z."""
        value = self.rows(i, z)
        slack = np.maximum(-value, 0.01)
        dual = start / slack
        slopes = jacobian(lambda z: self.rows(i, z), z)
        hessian = slopes.T @ (slopes * (dual / slack)[:, None])
        hessian += curvature(lambda z: dual @ self.rows(i, z), z)
        gradient = slopes.T @ ((mu + dual * (value + slack)) / slack)
        if self.switches[i]:
            hessian += curvature(lambda z: prices @ self.arrive(i, z) + z[self.nx] ** (1.0 / 3.0), z)
            gradient[-1] += z[self.nx] ** (-2.0 / 3.0) / 3.0
            hessian[-1, -1] += hold / (9.0 * z[self.nx] ** 2)
        return hessian, gradient


def halves(points):
    """Control points of both halves of a Bezier curve, by de Casteljau."""
    left, right = [points[0]], [points[-1]]
    while len(points) > 1:
        points = [0.5 * (a + b) for a, b in pairwise(points)]
        left.append(points[0])
        right.insert(0, points[-1])
    return left, right


def jacobian(function, z):
    """By complex steps: exact."""
    columns = [function(z + 1j * _STEP * unit).imag / _STEP for unit in np.eye(z.size)]
    return np.stack(columns, axis=-1)


def curvature(function, z):
    """Second derivatives: differences of complex steps."""
    out = np.empty((z.size, z.size))
    for k, unit in enumerate(np.eye(z.size)):
        h = 1e-5 * max(1.0, abs(z[k]))
        out[k] = (jacobian(function, z + h * unit) - jacobian(function, z - h * unit)) / (2.0 * h)
    return 0.5 * (out + out.T)
