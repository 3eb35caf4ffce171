"""Motions of constant jerk on each of some segments: from their jerks, to a given end, and through given points."""

from __future__ import annotations

import numpy as np

from planner.types import FloatArray


def rolled(start: FloatArray, jerk: FloatArray, width: FloatArray) -> FloatArray:
    """Position, speed and acceleration (3, n + 1, d) at the ends of segments with those jerks (n, d)."""
    h = width[:, None]
    state = np.empty((3, width.size + 1, jerk.shape[1]))
    state[:, 0] = start
    a = state[2]
    a[1:] = a[0] + np.cumsum(h * jerk, axis=0)
    v = state[1]
    v[1:] = v[0] + np.cumsum(h * (a[:-1] + 0.5 * h * jerk), axis=0)
    state[0, 1:] = state[0, 0] + np.cumsum(h * (v[:-1] + h * (0.5 * a[:-1] + h * (jerk / 6.0))), axis=0)
    return state


def arriving(start: FloatArray, jerk: FloatArray, width: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States (3, n + 1, d), and jerks (n, d) changed least so that the last state is ``end`` (3, d)."""
    state = rolled(start, jerk, width)
    for _ in range(2):  # again for what rounding leaves
        left = width.sum() - np.concatenate([[0.0], np.cumsum(width)])
        # what each jerk adds to position, speed and acceleration at the end
        added = np.array([-np.diff(left**k) / c for k, c in ((3, 6.0), (2, 2.0), (1, 1.0))])
        unit = np.sqrt((added**2 / width).sum(axis=1))
        root = added / unit[:, None] / np.sqrt(width)
        change = _least(root, (end - state[:, -1]) / unit[:, None])
        jerk = jerk + change / np.sqrt(width[:, None])
        state = rolled(start, jerk, width)
    state[:, -1] = end
    return state, jerk


def _least(rows: FloatArray, right: FloatArray) -> FloatArray:
    """Solve rows (3, n) x = right (3, d) by the smallest x (n, d), by Gram and Schmidt.

    A library's solver rounds as the processor has it, and a rounding may decide which of two optima is found.
    """
    basis: list[FloatArray] = []
    shares: list[FloatArray] = []
    for k in range(3):
        row, wanted = rows[k], right[k]
        for unit, share in zip(basis, shares, strict=True):
            along = (unit * row).sum()
            row, wanted = row - along * unit, wanted - along * share
        size = np.sqrt((row * row).sum())
        basis.append(row / size)
        shares.append(wanted / size)
    return np.asarray(sum(unit[:, None] * share for unit, share in zip(basis, shares, strict=True)))


def spline_through(p: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speeds and accelerations (n, d) of the spline through points p, widths (n - 1) of time apart, at rest at its ends."""
    h = width[:, None]
    slope = np.diff(p, axis=0) / h
    v = np.zeros_like(p)
    # h_i v_i-1 + 2 (h_i-1 + h_i) v_i + h_i-1 v_i+1 = 3 (h_i slope_i-1 + h_i-1 slope_i), by elimination
    right = 3.0 * (h[1:] * slope[:-1] + h[:-1] * slope[1:])
    factor = np.zeros(width.size)
    for i in range(1, width.size):
        pivot = 2.0 * (width[i - 1] + width[i]) - width[i] * factor[i - 1]
        factor[i] = width[i - 1] / pivot
        v[i] = (right[i - 1] - width[i] * v[i - 1]) / pivot
    for i in range(width.size - 2, 0, -1):
        v[i] -= factor[i] * v[i + 1]
    a = np.empty_like(p)
    a[:-1] = (6.0 * slope - 4.0 * v[:-1] - 2.0 * v[1:]) / width[:, None]
    a[-1] = (2.0 * v[-2] + 4.0 * v[-1] - 6.0 * slope[-1]) / width[-1]
    return v, a
