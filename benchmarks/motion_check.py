"""A dense check of a motion along a run of blocks, which shares no formula with what found it.

Only times, positions, velocities, accelerations and jerks of the nodes enter, and the blocks.  A limit on a polynomial of
low degree is held at that one's extremes, others at ``DENSITY`` places of every piece.  Distances are of brute force: from
a dense set of points, to the nearest of another dense set, refined along the path or along the block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from planner.joint.joint_run import JointMotion, JointRun
from planner.types import FloatArray, IntArray

DENSITY = 24  # places of a piece
POINTS = 200  # of a block, to which or from which distances are measured
WITHIN = 1e-6  # of a limit or a tolerance
ROUNDING = 1e-8  # of the largest coordinate, speed, ... that occurs
_NEWTON = 6
_AT_A_TIME = 2_000_000

Along = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


def defects(run: JointRun, motion: JointMotion) -> list[str]:
    """What is wrong with a motion, in words; empty where nothing is."""
    found = [*_wrong_form(run, motion)]
    if found:
        return found  # the rest would make no sense
    shares = np.arange(DENSITY + 1) / DENSITY
    h = np.diff(motion.t)
    state = _moved(motion, np.arange(h.size)[:, None], h[:, None] * shares)
    return [
        *_ends_not_at_rest(run, motion),
        *_jumps(motion, h),
        *_beyond_axes(run, motion, h),
        *_beyond_feed(run, motion, state[1]),
        *_away_from_blocks(run, motion, state[0]),
        *_passes_vertices(run, motion),
        *_blocks_away(run, motion, h),
    ]


def _moved(motion: JointMotion, piece: IntArray, h: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and acceleration a time h after the begin of pieces."""
    p, v, a, j = (x[piece] for x in (motion.position, motion.velocity, motion.acceleration, motion.jerk))
    h = h[..., None]
    return p + v * h + a * h**2 / 2.0 + j * h**3 / 6.0, v + a * h + j * h**2 / 2.0, a + j * h


def _wrong_form(run: JointRun, motion: JointMotion) -> Iterator[str]:
    m, d = motion.leg.size, run.dim
    shapes = {"t": (m + 1,), "position": (m + 1, d), "velocity": (m + 1, d), "acceleration": (m + 1, d), "jerk": (m, d)}
    for name, shape in shapes.items():
        value = getattr(motion, name)
        if value.shape != shape:
            yield f"{name} has the shape {value.shape}, not {shape}"
        elif not np.isfinite(value).all():
            yield f"{name} is not finite"
    if motion.t[0] != 0.0 or not (np.diff(motion.t) > 0.0).all():
        yield "the times do not rise from 0"
    if motion.leg[0] != 0 or motion.leg[-1] != run.lengths.size - 1 or not np.isin(np.diff(motion.leg), (0, 1)).all():
        yield "the pieces do not run along one block after the other"


def _ends_not_at_rest(run: JointRun, motion: JointMotion) -> Iterator[str]:
    size = max(np.abs(motion.position).max(), 1.0)
    for which, node, wanted in (("start", 0, run.starts[0]), ("end", -1, run.ends[-1])):
        if (off := np.abs(motion.position[node] - wanted).max()) > ROUNDING * size:
            yield f"the {which} is {off:.3g} mm from that of the run"
        for name in ("velocity", "acceleration"):
            value = getattr(motion, name)
            if (off := np.abs(value[node]).max()) > ROUNDING * np.abs(value).max():
                yield f"{name} {off:.3g} at the {which}, not at rest"


def _jumps(motion: JointMotion, h: FloatArray) -> Iterator[str]:
    reached = _moved(motion, np.arange(h.size), h)
    for name, value in zip(("position", "velocity", "acceleration"), reached, strict=True):
        given = getattr(motion, name)
        off = np.abs(value - given[1:]).max(axis=1) / max(np.abs(given).max(), 1e-300)
        if off.max() > ROUNDING:
            yield f"{name} jumps by {off.max():.3g} of its largest at t = {motion.t[1 + off.argmax()]:.6g} s"


def _beyond_axes(run: JointRun, motion: JointMotion, h: FloatArray) -> Iterator[str]:
    """|j| is constant and a linear on a piece; v is a parabola, with its extreme where a is 0."""
    a, j = motion.acceleration[:-1], motion.jerk
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.where(j != 0.0, -a / j, 0.0)
    top = np.where((top > 0.0) & (top < h[:, None]), top, 0.0)
    velocity = np.maximum(np.abs(motion.velocity[:-1] + top * (a + 0.5 * top * j)), np.abs(motion.velocity[1:]))
    whole = motion.acceleration
    for name, value, limit in (
        ("velocity", velocity, run.velocity),
        ("acceleration", whole, run.acceleration),
        ("jerk", j, run.jerk),
    ):
        if (worst := (np.abs(value) / limit).max(axis=1)).max() > 1.0 + WITHIN:
            at = int(worst.argmax())
            yield f"{name} {worst[at]:.9g} of its limit at t = {motion.t[at]:.6g} s"


def _beyond_feed(run: JointRun, motion: JointMotion, velocity: FloatArray) -> Iterator[str]:
    share = np.linalg.norm(velocity, axis=2).max(axis=1) / run.feed[motion.leg]
    if share.max() > 1.0 + WITHIN:
        yield f"speed {share.max():.9g} of the feed at t = {motion.t[share.argmax()]:.6g} s"


def _nearest(points: FloatArray, along: Along, places: FloatArray, lo: float, hi: float) -> FloatArray:
    """Distances of points (k, d) to a path: to the nearest of its points at ``places``, and from there on by Newton."""
    candidates = along(places)[0]
    out = np.empty(points.shape[0])
    step = max(1, _AT_A_TIME // candidates.size)
    for first in range(0, out.size, step):
        some = points[first : first + step]
        square = ((some[:, None] - candidates) ** 2).sum(axis=2)
        x, best = places[square.argmin(axis=1)], square.min(axis=1)
        for _ in range(_NEWTON):
            p, d1, d2 = along(x)
            away = p - some
            convex = (d1**2).sum(axis=1) + (away * d2).sum(axis=1)
            slope = np.where(convex > 0.0, convex, np.inf)
            x = np.clip(x - (away * d1).sum(axis=1) / slope, lo, hi)
            best = np.minimum(best, ((along(x)[0] - some) ** 2).sum(axis=1))
        out[first : first + step] = np.sqrt(best)
    return out


def _too_far(distance: FloatArray, tolerance: float) -> bool:
    return bool(distance.max() > tolerance * (1.0 + WITHIN) + 1e-12)


def _on_block(run: JointRun, block: int) -> Along:
    def along(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        d = run.legs.at(np.full(x.size, block), x)
        return d[0], d[1], d[2]

    return along


def _away_from_blocks(run: JointRun, motion: JointMotion, position: FloatArray) -> Iterator[str]:
    """Every point of the motion from the block that it runs along."""
    for block in range(run.lengths.size):
        points = position[motion.leg == block].reshape(-1, run.dim)
        length = run.lengths[block]
        distance = _nearest(points, _on_block(run, block), np.linspace(0.0, length, POINTS), 0.0, length)
        if _too_far(distance, run.tolerance[block]):
            yield f"{distance.max() / run.tolerance[block]:.9g} of the tolerance away from block {block}"


def _passes_vertices(run: JointRun, motion: JointMotion) -> Iterator[str]:
    for block in range(run.lengths.size - 1):
        node = int(np.searchsorted(motion.leg, block + 1))
        away = np.linalg.norm(motion.position[node : node + 1] - run.ends[block], axis=1)
        tolerance = run.tolerance[block : block + 2].min()
        if _too_far(away, tolerance):
            yield f"{away[0] / tolerance:.9g} of the tolerance away from the end of block {block}, where it leaves it"


def _blocks_away(run: JointRun, motion: JointMotion, h: FloatArray) -> Iterator[str]:
    """Every point of a block from the motion, while this runs along it or its neighbours."""

    def along(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        piece = np.clip(np.searchsorted(motion.t, t, side="right") - 1, 0, h.size - 1)
        return _moved(motion, piece, t - motion.t[piece])

    shares = np.arange(DENSITY) / DENSITY
    for block in range(run.lengths.size):
        near = np.flatnonzero(np.abs(motion.leg - block) <= 1)
        times = np.append((motion.t[near, None] + h[near, None] * shares).reshape(-1), motion.t[near[-1] + 1])
        points = _on_block(run, block)(np.linspace(0.0, run.lengths[block], POINTS))[0]
        distance = _nearest(points, along, times, times[0], times[-1])
        if _too_far(distance, run.tolerance[block]):
            yield f"block {block} is {distance.max() / run.tolerance[block]:.9g} of its tolerance away from the motion"
