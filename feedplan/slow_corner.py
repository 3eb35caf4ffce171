"""The corner of a part program that costs most time, as a picture shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from planner.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from feedplan.job import Job
    from planner.output.corner_view import Corner, CornerPass
    from planner.profile import FeedrateProfile
    from planner.programs.path.moves import MovingBlocks

_SHARP = np.cos(np.deg2rad(20.0))  # turns of less are no corners that a picture shows
_LONG = 10.0  # tolerances: shorter blocks lie within what a picture of a corner shows
_POINTS = 8001  # of a motion, from the middle of one block to that of the next


@dataclass(frozen=True, eq=False)
class SlowCorner:
    """A corner of a program.

    Attributes
    ----------
    corner : Corner
        The lines that meet in it, and the motions past it.
    lines : tuple of int
        Of the program: before the corner, and behind it.
    lost : float
        Time that it costs, s.
    """

    corner: Corner
    lines: tuple[int, int]
    lost: float


def slowest_corner(
    job: Job, profile: FeedrateProfile, others: Mapping[str, tuple[Job, FeedrateProfile]] | None = None
) -> SlowCorner | None:
    """Find the corner between two lines that costs most time, with the motions past it.

    What a corner costs is what the plan takes from the middle of one line to the middle of the next, less what that takes
    at their feeds.  Demanded stops, rapids and blocks without a tolerance are no corners, nor are lines shorter than ten
    tolerances.

    Parameters
    ----------
    job, profile : Job, FeedrateProfile
        Of a part program, and its plan.
    others : mapping of str to (Job, FeedrateProfile)
        Further plans of the same program by what to call them; they pass the same corner.

    Returns
    -------
    SlowCorner or None
        None where the program has no such corner.
    """
    if job.program is None or job.path is None:
        return None
    from planner.output.corner_view import Corner
    from planner.programs.path.moves import MovingBlocks

    within = job.path.curve.made_within
    mm, share = (None, 1.0) if within is None else (within.mm, within.share)
    blocks = MovingBlocks.of(job.program, None if mm is None else share * mm)
    allowed = blocks.tolerance * (share if mm is None else 1.0)
    least = np.minimum(allowed[:-1], allowed[1:])
    long = _length(blocks) > _LONG * allowed
    candidates = np.flatnonzero(_corners(blocks) & (least > 0.0) & long[:-1] & long[1:])
    if not candidates.size:
        return None
    at = int(candidates[np.argmax(_lost(job, profile, blocks)[candidates])])
    ends = blocks.programmed.legs.at(np.array([at, at + 1, at + 1]), np.array([0.0, 0.0, _length(blocks)[at + 1]]))[0]
    plans = {"this plan": (job, profile), **(others or {})}
    passes = tuple(_past(name, at, blocks, *plan) for name, plan in plans.items())
    line, lost = job.path.line, float(_lost(job, profile, blocks)[at])
    corner = Corner(ends[0], ends[1], ends[2], float(least[at]), passes)
    return SlowCorner(corner, (int(line[at]), int(line[at + 1])), lost)


def _length(blocks: MovingBlocks) -> FloatArray:
    return np.diff(blocks.programmed.edges)


def _corners(blocks: MovingBlocks) -> BoolArray:
    """Junctions (m - 1,) at which two lines meet in a sharp turn without a stop."""
    line = ~blocks.programmed.legs.curved & ~blocks.rapid & ~blocks.angular
    direction = blocks.programmed.legs.vectors[:, 3]
    straight = np.sum(direction[:-1] * direction[1:], axis=1)
    return np.asarray(line[:-1] & line[1:] & ~blocks.stop & (straight < _SHARP))


def _lost(job: Job, profile: FeedrateProfile, blocks: MovingBlocks) -> FloatArray:
    """What every junction costs, (m - 1,), s."""
    middle = np.diff(_middles(job, profile))
    half = 0.5 * _length(blocks) / np.minimum(blocks.speed, job.limits.feed)
    return np.asarray(middle - half[:-1] - half[1:])


def _middles(job: Job, profile: FeedrateProfile) -> FloatArray:
    """When a plan is in the middle of every block, (m,), s."""
    from planner.programs.times import times_at

    # Half the way along the path: where its feed was found with it the parameter runs with time.
    along = job.curve.tip.arclength
    s = along.s(job.path.u if job.path is not None else np.array(job.curve.domain))
    return times_at(profile, np.clip(along.u(0.5 * (s[:-1] + s[1:])), *job.curve.domain))


def _past(name: str, at: int, blocks: MovingBlocks, job: Job, profile: FeedrateProfile) -> CornerPass:
    """A plan from the middle of the block before a junction to the middle of the one behind, in mm and degrees."""
    from planner.output.corner_view import CornerPass

    middle = _middles(job, profile)
    t = np.linspace(middle[at], middle[at + 1], _POINTS)
    state = profile.at(t)
    scale = blocks.used.scale
    d = job.curve.derivatives(state.u, 1)[:, :, : scale.size] * scale
    return CornerPass(name, t, d[0], d[1] * state.u_rate[:, None])
