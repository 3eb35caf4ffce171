"""Compass search over the blocks and the nodes of a plan by S-curves: rule 4 of ``scurve``."""

from __future__ import annotations

from itertools import product

import numpy as np

from planner.plan.solvers.arcpath import ArcPath
from planner.plan.solvers.scurve_blocks import (
    LADDER,
    SLIGHTLY,
    TOLERANCE,
    BlockPlan,
    Ruckig,
    dilated_tops,
    durations,
    trace,
)
from planner.types import FloatArray, IntArray

# Directions of the search.  Of a block: the logarithms of its top feed, accelerations up and down, and jerk.  Of a node:
# the logarithm of its feed, its place, and the pace of the ramps on both sides of it.
_UPWARDS = [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 1, 1, 1)]
_EXCHANGES = [(1, 0, 0, -0.7), (1, -1, -1, -1), (0, -0.7, 0, 1), (0, 0, -0.7, 1), (-0.7, 1, 0, 0), (-0.7, 0, 1, 0)]
_BLOCK_MOVES = np.array([*_UPWARDS, *_EXCHANGES], dtype=np.float64)
_NODE_MOVES = np.array([move for move in product((0.0, 1.0), (-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)) if any(move)])
_FIRST_STEP, _MIN_STEP, _RESUMED_STEP = 0.4, 4e-3, 0.1
_LARGER, _SMALLER = 1.5, 0.45
_GAIN = 1e-6  # the least saving that makes a trial count
ROUNDS, _PATIENCE, _WORTH = 30, 5, 1e-3  # a search ends when its last five rounds saved less than this fraction
_TRIALS, _MANY = 60_000, 60  # blocks tried in one search; more blocks than this get no further nodes
_SPLIT_LOSS, _SPLITS = 4e-3, 4


def search_blocks_and_nodes(path: ArcPath, solver: Ruckig, plan: BlockPlan) -> BlockPlan:
    """Improve a plan; remove and add nodes as long as that pays."""
    if plan.time.size > _MANY:
        plan = _merge(path, solver, plan)
    before = np.inf
    for _ in range(_SPLITS + 1):
        improve(path, solver, plan, ROUNDS)
        plan = _merge(path, solver, plan)
        now = float(plan.time.sum())
        if before - now < 2.0 * _WORTH * now or plan.time.size > _MANY:
            break
        before, plan = now, _split(path, solver, plan)
    return plan


def improve(path: ArcPath, solver: Ruckig, plan: BlockPlan, rounds: int) -> None:
    """Search the blocks, then every other node, in turn, until rounds gain next to nothing."""
    m = plan.time.size
    rounds = max(min(rounds, _TRIALS // (m * (_BLOCK_MOVES.shape[0] + 2 * _NODE_MOVES.shape[0]))), 2)
    block_step, node_step = np.full(m, _FIRST_STEP), np.full(m + 1, _FIRST_STEP)
    block_step[(plan.tops >= path.tops).all(axis=1)] = 0.0
    totals = [plan.time.sum()]
    for _ in range(rounds):
        _search_blocks(path, solver, plan, block_step)
        for parity in (1, 2):
            _search_nodes(path, solver, plan, np.arange(parity, m, 2), node_step, block_step)
        totals.append(plan.time.sum())
        if len(totals) > _PATIENCE and totals[-1 - _PATIENCE] - totals[-1] < _WORTH * totals[-1]:
            break


def _search_blocks(path: ArcPath, solver: Ruckig, plan: BlockPlan, step: FloatArray) -> None:
    """Try every direction on each block still searched; take the fastest, or shorten the step."""
    some = np.flatnonzero(step > _MIN_STEP)
    if some.size == 0:
        return
    tops = np.minimum(plan.tops[some, None] * np.exp(step[some, None, None] * _BLOCK_MOVES), path.tops)
    each = np.repeat(some, tops.shape[1])
    time = durations(path, solver, plan.ends(each), tops.reshape(-1, 4), plan.time[each]).reshape(tops.shape[:2])
    best, rows = np.argmin(time, axis=1), np.arange(some.size)
    won = time[rows, best] < plan.time[some] * (1.0 - _GAIN)
    plan.time[some[won]], plan.tops[some[won]] = time[rows[won], best[won]], tops[rows[won], best[won]]
    step[some] = np.where(won, np.minimum(_LARGER * step[some], 1.0), _SMALLER * step[some])


def _search_nodes(
    path: ArcPath, solver: Ruckig, plan: BlockPlan, nodes: IntArray, step: FloatArray, block_step: FloatArray
) -> None:
    """Try every direction on nodes no two of which share a block; a node on a curvature jump stays there."""
    nodes = nodes[step[nodes] > _MIN_STEP]
    if nodes.size == 0:
        return
    count, h = _NODE_MOVES.shape[0], step[nodes, None]
    room = np.minimum(plan.s[nodes] - plan.s[nodes - 1], plan.s[nodes + 1] - plan.s[nodes])
    room[np.isin(plan.s[nodes], path.jumps)] = 0.0
    v = plan.v[nodes, None] * np.exp(h * _NODE_MOVES[:, 0])
    s = plan.s[nodes, None] + 0.6 * h * room[:, None] * _NODE_MOVES[:, 1]
    pace = np.exp(h * _NODE_MOVES[:, 2])[..., None] ** np.array([0.0, 1.0, 1.0, 1.0])
    tops = np.minimum(np.stack([plan.tops[nodes - 1], plan.tops[nodes]])[:, :, None] * pace, path.tops)
    each, now = np.repeat(nodes, count), plan.time[nodes - 1] + plan.time[nodes]
    ends = np.stack([plan.ends(each - 1), plan.ends(each)], axis=1)
    ends[2, 0] = ends[0, 1] = s.reshape(-1)
    ends[3, 0] = ends[1, 1] = v.reshape(-1)
    below = np.tile(np.repeat(now, count), 2)
    time = durations(path, solver, ends.reshape(4, -1), tops.reshape(-1, 4), below).reshape(2, nodes.size, count)
    both = time.sum(axis=0)
    best, rows = np.argmin(both, axis=1), np.arange(nodes.size)
    won = both[rows, best] < now * (1.0 - _GAIN)
    at, r, b = nodes[won], rows[won], best[won]
    plan.s[at], plan.v[at] = s[r, b], v[r, b]
    for side in (0, 1):
        plan.time[at - 1 + side], plan.tops[at - 1 + side] = time[side, r, b], tops[side, r, b]
        block_step[at - 1 + side] = np.maximum(block_step[at - 1 + side], _RESUMED_STEP)
    step[nodes] = np.where(won, np.minimum(_LARGER * step[nodes], 1.0), _SMALLER * step[nodes])


def _merge(path: ArcPath, solver: Ruckig, plan: BlockPlan) -> BlockPlan:
    """Remove nodes, none on a curvature jump and no two of one block at once, where one block is faster than two."""
    parity, unchanged = 1, 0
    while unchanged < 2:
        nodes = np.arange(parity, plan.time.size, 2)
        nodes = nodes[~np.isin(plan.s[nodes], path.jumps)]
        wholly = np.broadcast_to(path.tops * dilated_tops(LADDER), (nodes.size, LADDER.size, 4))
        either = np.maximum(plan.tops[nodes - 1], plan.tops[nodes])[:, None] * dilated_tops(LADDER[: SLIGHTLY.size])
        tops = np.append(wholly, either, axis=1)
        each, now = np.repeat(nodes, tops.shape[1]), plan.time[nodes - 1] + plan.time[nodes]
        ends, below = plan.ends(each - 1, each + 1), np.repeat(now, tops.shape[1])
        time = durations(path, solver, ends, tops.reshape(-1, 4), below).reshape(tops.shape[:2])
        best, rows = np.argmin(time, axis=1), np.arange(nodes.size)
        won = time[rows, best] < now * (1.0 - _GAIN)
        gone = nodes[won]
        plan.time[gone - 1], plan.tops[gone - 1] = time[rows, best][won], tops[rows, best][won]
        s, v, tops, time = (np.delete(part, gone, axis=0) for part in (plan.s, plan.v, plan.tops, plan.time))
        plan = BlockPlan(s, v, tops, time)
        parity, unchanged = 3 - parity, 0 if gone.size else unchanged + 1
    return plan


def _split(path: ArcPath, solver: Ruckig, plan: BlockPlan) -> BlockPlan:
    """Put a node into the middle of the cruise of every block that loses much time against the limit curve."""
    _, phases, states = trace(solver, plan.ends(np.arange(plan.time.size)), plan.tops)
    ideal = np.interp(plan.s, path.s, np.append(0.0, np.cumsum(np.diff(path.s) / path.cruise)))
    loss = plan.time - np.diff(ideal)
    loss[(plan.tops >= path.tops).all(axis=1)] = 0.0
    at = np.flatnonzero((loss > _SPLIT_LOSS * plan.time.sum()) & (phases[0, :, 3] > 0.0))
    s, v = 0.5 * (states[0, at, 3] + states[0, at, 4]), states[1, at, 3]
    before, after = plan.ends(at), plan.ends(at)
    before[2], before[3], after[0], after[1] = s, v, s, v
    first, second = (durations(path, solver, ends, plan.tops[at]) for ends in (before, after))
    same = first + second <= plan.time[at] * (1.0 + TOLERANCE)
    at = at[same]
    time = plan.time.copy()
    time[at] = first[same]
    return BlockPlan(
        np.insert(plan.s, at + 1, s[same]),
        np.insert(plan.v, at + 1, v[same]),
        np.insert(plan.tops, at + 1, plan.tops[at], axis=0),
        np.insert(time, at + 1, second[same]),
    )
