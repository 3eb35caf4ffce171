"""A lower bound of the time of every motion within the tolerance of a program, whatever its path."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from planner.joint.bound import joint_bound
from planner.joint.joint_run import JointRun
from planner.machine.limits import Limits
from planner.programs.path.moves import MovingBlocks
from planner.programs.reading.program import Program
from planner.quantity import AXIS

MAX_BLOCKS = 1000  # a bound of more takes longer than their plan
_MIN_TOLERANCE = 1e-9  # mm; a larger one than the program's makes a bound lower


def any_path_bound(program: Program, tolerance: float | None, limits: Limits) -> float:
    """Bound the time of a program from below, whatever path is made of it.

    Every run from stop to stop is bounded by :func:`planner.joint.bound.joint_bound`, which has the proof; the limits of
    the axes and the commanded feeds are taken, the chord error is not.

    Parameters
    ----------
    program : Program
    tolerance : float or None
        mm; None for that of the program's own words.
    limits : Limits
        Of the machine.

    Returns
    -------
    float
        s; no motion that stays within the tolerance of every block, keeps the limits and rests at the exact stops takes
        less.  nan where none is known: of splines, spirals, axes without a jerk limit, and more than ``MAX_BLOCKS`` blocks.
    """
    blocks = MovingBlocks.of(program, tolerance)
    legs, limits = blocks.programmed.legs, limits.for_axes(blocks.axes, program.source)
    if blocks.row.size > MAX_BLOCKS or not np.isfinite(limits.jerk).all() or (legs.rates[:, 1] != 0.0).any():
        return math.nan
    if legs.ways is not None and (legs.ways[:, 0] >= 0.0).any():
        return math.nan
    rows: dict[str, Any] = {q.key: getattr(limits, q.key) * blocks.used.scale for q in AXIS}
    caps = np.where(np.isinf(blocks.feed), limits.rapid, np.minimum(blocks.feed, limits.feed))
    # Beside axes that the feed does not count, how fast these go is not known of a motion that is off its block.
    counted = np.broadcast_to(np.asarray(blocks.programmed.per_feed) == 1.0, caps.shape) & ~blocks.angular
    feed = np.where(counted, caps, np.inf)
    lengths = np.diff(blocks.programmed.edges)
    allowed = np.maximum(blocks.tolerance, _MIN_TOLERANCE)
    cuts = np.concatenate([[0], np.flatnonzero(blocks.stop) + 1, [blocks.row.size]])
    runs = (
        JointRun(legs.taken(np.arange(i, j)), lengths[i:j], allowed[i:j], feed[i:j], **rows) for i, j in pairwise(cuts)
    )
    return math.fsum(joint_bound(run).seconds for run in runs)
