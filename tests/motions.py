"""Plans with a motion known in closed form: seven phases of constant jerk along the tool tip, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from cases import drives

from planner.geometry.curve import FeedCaps
from planner.geometry.differential import arc_derivatives
from planner.geometry.nurbs import NurbsCurve
from planner.law import TimeLaw
from planner.machine.limits import Limits
from planner.profile import make_profile


@dataclass(frozen=True)
class Motion:
    """Arc length over time: ``jerks[i]`` from ``times[i]`` to ``times[i + 1]``, from ``states[i]`` (s, v, a) on."""

    times: np.ndarray
    jerks: np.ndarray
    states: np.ndarray

    @property
    def duration(self):
        return float(self.times[-1])

    def __call__(self, t, side="right"):
        """s and its first three time derivatives; held outside."""
        t = np.asarray(t, dtype=float)
        i = np.clip(np.searchsorted(self.times, t, side=side) - 1, 0, self.jerks.size - 1)
        w = np.clip(t, 0.0, self.duration) - self.times[i]
        s, v, a = self.states[i].T
        j = self.jerks[i]
        return s + w * (v + w * (a / 2 + w * j / 6)), v + w * (a + w * j / 2), a + w * j, j


def scurve(length, feed, acceleration, jerk):
    """The fastest such motion that reaches feed and acceleration."""
    rise = acceleration / jerk
    hold = feed / acceleration - rise
    cruise = length / feed - (feed / acceleration + rise)
    assert hold >= 0.0
    assert cruise >= 0.0
    phases = [(rise, jerk), (hold, 0.0), (rise, -jerk), (cruise, 0.0), (rise, -jerk), (hold, 0.0), (rise, jerk)]
    phases = [(h, j) for h, j in phases if h > 0.0]
    states = [(0.0, 0.0, 0.0)]
    for h, j in phases:
        s, v, a = states[-1]
        states.append((s + h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j))
    times = np.concatenate([[0.0], np.cumsum([h for h, _ in phases])])
    return Motion(times, np.array([j for _, j in phases]), np.array(states[:-1]))


def node_times(motion, per_phase=40, step=2e-3):
    """The ends of the phases and as many equal parts between them as either figure asks for."""
    parts = [max(per_phase, int(np.ceil(h / step))) for h in np.diff(motion.times)]
    inner = [a + (b - a) * np.arange(n) / n for a, b, n in zip(motion.times, motion.times[1:], parts, strict=False)]
    return np.append(np.concatenate(inner), motion.duration)


def time_at(motion, s):
    """Time at which the motion has covered s, by bisection."""
    lo, hi = 0.0, motion.duration
    for _ in range(100):
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if motion(mid)[0] < s else (lo, mid)
    return 0.5 * (lo + hi)


def plan_along(curve, motion, limits=None, times=None):
    """The profile of a motion along a curve, with a double node at every parameter where a derivative jumps."""
    t = node_times(motion) if times is None else times
    u = curve.arclength.u(np.clip(motion(t)[0], 0.0, curve.length))
    u[0], u[-1] = curve.domain
    before = np.zeros(t.size, dtype=bool)
    for b in curve.breaks:
        at = time_at(motion, float(curve.arclength.s(b.u)))
        apart = np.abs(t - at) > 1e-9
        row = int(np.searchsorted(t[apart], at))
        t, u = np.insert(t[apart], row, [at, at]), np.insert(u[apart], row, [b.u, b.u])
        before = np.insert(before[apart], row, [True, False])
    _, v, a, _ = motion(t)
    v[[0, -1]] = a[[0, -1]] = 0.0
    left, right = (curve.tip.derivatives(u, 2, side=side) for side in ("left", "right"))
    d = np.where(before[:, None], left, right)
    speed = np.linalg.norm(d[1], axis=-1)
    bend = np.sum(d[1] * d[2], axis=-1)
    if limits is None:
        limits = drives(300.0, curve.dim)
    return make_profile(curve, limits, TimeLaw(t, u, v / speed, a / speed - v**2 * bend / speed**4), method="s-curve")


def line_of_a_program(parts=1):
    """A line of 300 mm along X, as a program has it: F words of 20 and 30 mm/s around a rapid, each for 100 mm.

    Returns a plan by hand, each of the three in so many parts, and the limits, of 25 mm/s: 5 s at 20 mm/s, 0.5 s at 200
    and 5 s at 20 again, the feed jumping.
    """
    line = NurbsCurve([[0, 0], [100, 0], [200, 0], [300, 0]], [0, 0, 0, 0, 1, 1, 1, 1], 3)
    caps = FeedCaps(np.array([0.0, 1.0, 2.0, 3.0]) / 3.0, np.array([20.0, np.inf, 30.0]))
    object.__setattr__(line, "feed_caps", caps)  # as the curve of a program has them
    limits = Limits(25.0, [400.0] * 2, [5000.0] * 2, [1e5] * 2)
    share = np.arange(parts + 1) / parts
    t = np.concatenate([5.0 * share, 5.0 + 0.5 * share, 5.5 + 5.0 * share])
    u = np.concatenate([share, 1.0 + share, 2.0 + share]) / 3.0
    rate = np.repeat([20.0, 200.0, 20.0], parts + 1) / 300.0
    return make_profile(line, limits, TimeLaw(t, u, rate, np.zeros(t.size)), method="by hand"), limits


def positions_at(curve, motion, t):
    """Machine axes at any times, exactly: C(u(s(t))), held outside the motion."""
    s = np.clip(motion(t)[0], 0.0, curve.length)
    return curve.derivatives(curve.arclength.u(s), 0)[0]


def largest_rates(curve, motion, count=20_000):
    """Largest velocity, acceleration and jerk of each axis, (3, dim), from the closed form on either side of a jump."""
    largest = np.zeros((3, curve.dim))
    t = np.union1d(np.linspace(0.0, motion.duration, count), motion.times)
    for side in ("left", "right"):
        s, v, a, j = (x[:, None] for x in motion(t, side))
        u = curve.arclength.u(np.clip(s[:, 0], 0.0, curve.length))
        c = arc_derivatives(curve.derivatives(u, 3, side=side))
        rates = (c[1] * v, c[2] * v**2 + c[1] * a, c[3] * v**3 + 3.0 * c[2] * v * a + c[1] * j)
        largest = np.maximum(largest, [np.abs(rate).max(axis=0) for rate in rates])
    return largest


def largest_differences(samples, hold=3):
    """Largest first, second and third difference of the samples over T, T^2, T^3, (3, dim), held at both ends."""
    q = samples.position
    q = np.concatenate([np.repeat(q[:1], hold, axis=0), q, np.repeat(q[-1:], hold, axis=0)])
    return np.stack([np.abs(np.diff(q, k, axis=0)).max(axis=0) / samples.period**k for k in (1, 2, 3)])
