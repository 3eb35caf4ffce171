"""Machines of which everything is known: moves from rest to rest on straight lines, by three laws, and their logs."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from planner.calibration.log import Log

AXES = ("X", "Y", "Z")
VELOCITY, ACCELERATION, JERK = (150.0, 120.0, 60.0), (900.0, 700.0, 400.0), (20000.0, 14000.0, 9000.0)
TAU = 0.024  # s
REST = 0.06  # s between two moves

CORNERS = np.array(
    [
        [0, 0, 0], [80, 0, 0], [80, 50, 0], [80, 50, -20], [20, 10, -20], [20, 10, 0], [60, 12, -5], [5, 60, -2],
        [5, 5, -2], [9, 5, -2], [9, 8, -2], [9, 8, -3.5], [70, 30, 12], [0, 30, 12], [0, -60, 12], [0, -60, -25],
        [45, -15, 0],
    ],
    dtype=float,
)  # fmt: skip
"""Along each axis alone, across, long and short."""


def phases(length: float, feed: float, acceleration: float, jerk: float) -> list[tuple[float, float]]:
    """Jerk and duration of the phases of a move from rest to rest; an infinite jerk gives the acceleration instead."""
    if np.isinf(jerk):
        speed = min(feed, np.sqrt(length * acceleration))
        hold = length / speed - speed / acceleration
        return [(acceleration, speed / acceleration), (0.0, hold), (-acceleration, speed / acceleration)]

    def ramp(speed: float) -> tuple[float, float]:
        t_j = min(acceleration / jerk, np.sqrt(speed / jerk))
        return t_j, max(speed / (jerk * t_j) - t_j, 0.0)

    def way_of(speed: float) -> float:
        t_j, t_a = ramp(speed)
        return speed * (2.0 * t_j + t_a)

    speed = feed
    if way_of(feed) > length:
        low, high = 0.0, feed
        for _ in range(200):
            speed = 0.5 * (low + high)
            low, high = (speed, high) if way_of(speed) < length else (low, speed)
    t_j, t_a = ramp(speed)
    hold = max((length - way_of(speed)) / speed, 0.0)
    return [(jerk, t_j), (0.0, t_a), (-jerk, t_j), (0.0, hold), (-jerk, t_j), (0.0, t_a), (jerk, t_j)]


def way(t: np.ndarray, parts: list[tuple[float, float]], order: int) -> np.ndarray:
    """Way at times by pieces of constant derivative of an order, 2 or 3, from rest; rests before and after."""
    state, edge, s = np.zeros(order), 0.0, np.zeros_like(t)
    for value, duration in [*parts, (0.0, np.inf)]:
        inside = (t >= edge) & (t < edge + duration)
        s[inside] = derivative([*state, value], 0, t[inside] - edge)
        if np.isfinite(duration):
            state = np.array([derivative([*state, value], i, duration) for i in range(order)])
            edge += duration
    return s


def derivative(terms: list[float], order: int, x):
    """The derivative of an order of the sum of c_k x^k / k!."""
    return sum(c * x ** (k - order) / math.factorial(k - order) for k, c in enumerate(terms) if k >= order)


def path_limit(limits: tuple[float, ...], direction: np.ndarray) -> float:
    return min(limit / abs(d) for limit, d in zip(limits, direction, strict=True) if d != 0.0)


def made_log(
    law: str,
    *,
    feed: float = 1e9,
    period: float = 1e-3,
    count: float = 0.0,
    noise: float = 0.0,
    corners: np.ndarray = CORNERS,
    where: str = "made.csv",
) -> Log:
    """Log of the corners one after the other under "trapezoid", "s-curve" or "fir"."""
    order, tail = (3 if law == "s-curve" else 2), (TAU if law == "fir" else 0.0)
    # A moving average is that of the way over the last tau.
    lags = (np.arange(400) + 0.5) / 400 * TAU if law == "fir" else np.zeros(1)
    moves, start = [], REST
    for a, b in pairwise(corners):
        length = float(np.linalg.norm(b - a))
        direction = (b - a) / length
        v, acceleration, jerk = (path_limit(limits, direction) for limits in (VELOCITY, ACCELERATION, JERK))
        parts = phases(length, min(feed, v), acceleration, jerk if law == "s-curve" else np.inf)
        end = start + sum(duration for _, duration in parts) + tail
        moves.append((start, end, b - a, length, parts))
        start = end + REST
    t = np.arange(0.0, start, period)
    position = np.tile(corners[0], (t.size, 1))
    for begin, end, step, length, parts in moves:
        moving = (t > begin) & (t < end)
        s = np.mean([way(t[moving] - begin - lag, parts, order) for lag in lags], axis=0)
        position[moving] += s[:, None] * step / length
        position[t >= end] += step
    if noise:
        position = position + np.random.default_rng(0).normal(0.0, noise, position.shape)
    if count:
        position = np.round(position / count) * count
    return Log(where, AXES, t, position, period, (slice(0, t.size),))
