"""Programs for LinuxCNC: a planned curve as short lines within a tolerance, with feeds at which it keeps to the plan.

The frame is ``G61``, the rapid to the start, ``G64 P.. Q0``, the cut, ``M2``: the rapid ends at rest, the cut is blended
within P, and without ``Q0`` the controller would merge blocks on its own.  No word is repeated that does not change; none
but the moves themselves stands in the cut, since S, M and G4 make a controller empty its queue.

The tolerance is shared between the lines and their blending, block by block: what a line leaves the curve by, digits
included, and P make the whole at most.  P is as small as the planned speed allows (:mod:`planner.output.ngc_motion`), since
on a blend LinuxCNC has half of its acceleration along the path.  Before a rest the block stands under ``G61.1``: under
``G64`` the last one would have half of it, and a blend would cut a corner that the plan does not.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import BrokenLimitError, InputError
from planner.files.whole_file import whole_file
from planner.geometry.curve import Curve
from planner.geometry.tolerance import PathTolerance
from planner.inputs import numbers, positive_number, require_instance
from planner.machine.limits import DEFAULT_PERIOD
from planner.output.ngc_blocks import (
    Room,
    WrittenBlocks,
    block_motion,
    blocks_of_profile,
    blocks_of_samples,
    lengths_of_feed,
)
from planner.output.ngc_motion import block_feeds, motion_time
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.types import FloatArray
from planner.verify import Report, check

FeedMode = Literal["feed", "inverse_time"]

_MIN_TOLERANCE_MM = 1e-6  # coordinates are written with up to 9 decimals
_F_DIGITS = 8  # of the feed
_P_DIGITS = 4
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_ALONG_THE_MOTION = re.compile(r"(M6[237]([PQE][-+.0-9]+)*)+")


@dataclass(frozen=True)
class WrittenProgram:
    """What was written.

    Attributes
    ----------
    blocks : int
        Number of blocks that cut.
    duration : float
        What LinuxCNC takes for them by its rules, s; where these are not known, the sum of the blocks' times.
    deviation : float
        Largest distance of a line to the curve, mm.
    reach : float
        Largest distance to the curve of what the controller may make of them, mm.
    """

    blocks: int
    duration: float
    deviation: float
    reach: float


def write_ngc(
    path: str | Path,
    curve: Curve,
    plan: FeedrateProfile | Samples,
    *,
    tolerance: float,
    mode: FeedMode = "feed",
    block_time: float = 0.01,
    inserted: Sequence[tuple[float, str]] = (),
    report: Report | None = None,
    acceleration: ArrayLike | None = None,
) -> WrittenProgram:
    """Write a LinuxCNC program of a planned curve, if the plan breaks no limit.

    Parameters
    ----------
    path : str or Path
        The file; written whole or not at all.
    curve : Curve
        Its axis names become the words; linear axes in mm, rotary ones in degrees.
    plan : FeedrateProfile or Samples
        A profile is cut into blocks of at most ``block_time``, shorter where the tolerance or a corner asks for it.
        Samples become a block each, as they are: their distance to the curve is measured, not bounded.
    tolerance : float
        Largest distance between the curve and what the controller may make of the program, mm; a degree of a rotary axis
        counts as a mm.
    mode : {"feed", "inverse_time"}
        F as feed in mm/min (G94) or as blocks a minute (G93).  Under G94 the feed is that of X Y Z together, of U V W where
        none of these moves, and where none of those moves either of A B C, in degrees a minute.
    block_time : float
        Longest time of a block, s: the steps in which the feed is given.
    inserted : sequence of (float, str)
        Lines to put in where the path passes a curve parameter, in their order, such as the spindle's words; those at
        the start of the curve come before the rapid to it.
    report : Report, optional
        What :func:`~planner.verify.check` says of the plan; if left out, a profile is checked here against the limits it
        was planned for.  Samples do not know theirs and need one.
    acceleration : float or (dim,) sequence of float, optional
        Of the machine's axes, mm/s^2; if left out, that of the limits of the plan.  A plan that uses a part of it is kept
        to where LinuxCNC turns and speeds up at the same time.

    Returns
    -------
    WrittenProgram

    Raises
    ------
    InputError
        If an option is not allowed, the tolerance is below the digits of the coordinates, or the file cannot be written.
    BrokenLimitError
        If the plan breaks a limit: a machine would run what is written.  Then no file is written.
    """
    require_instance(curve, Curve, "curve")
    require_instance(plan, (FeedrateProfile, Samples), "plan")
    if mode not in ("feed", "inverse_time"):
        raise InputError(f'mode = {mode!r} must be "feed" or "inverse_time"')
    tolerance = positive_number(tolerance, "tolerance")
    if not _MIN_TOLERANCE_MM <= tolerance < np.inf:
        raise InputError(f"tolerance = {tolerance!r} mm must be finite and at least {_MIN_TOLERANCE_MM} mm")
    require_both_sides(curve)
    _require_sound(path, curve, plan, report)
    # Directions of short blocks need a digit more than their places.
    digits = 2.0 if isinstance(plan, Samples) else 3.0
    decimals = int(np.clip(np.ceil(-np.log10(tolerance)) + digits, 4.0, 9.0))
    room = Room(tolerance, decimals, *_machine(curve, plan, acceleration))
    if isinstance(plan, Samples):
        blocks = blocks_of_samples(curve, plan, room)
    else:
        block_time = positive_number(block_time, "block_time")
        places = np.array([u for u, _ in inserted if curve.domain[0] < u < curve.domain[1]])
        blocks = blocks_of_profile(curve, plan, room, min(block_time, plan.duration), places)
    placed = _by_block(curve, blocks, inserted)
    stops = blocks.stops.copy()
    stops[[k for k, lines in placed.items() if k > 0 and any(map(_stops_the_machine, lines))]] = True
    stops[-1] = True
    lengths, times = lengths_of_feed(curve, blocks.points), np.diff(blocks.t)
    motion = None
    feeds = lengths / times
    if isinstance(plan, FeedrateProfile) and room.follows(curve):
        motion = block_motion(blocks.points, plan.at(blocks.t).feed, room)
        feeds = block_feeds(motion, times)
    rate = 60.0 * feeds / lengths if mode == "inverse_time" else 60.0 * feeds
    words = [_number(value) for value in rate]
    taken = np.array([float(word) for word in words])
    taken = 60.0 / taken if mode == "inverse_time" else 60.0 * lengths / taken
    duration = float(taken.sum())
    if motion is not None:
        duration = motion_time(motion, lengths / taken, blocks.blends, stops[1:-1])
    with whole_file(path) as file:
        for line in _lines(curve, blocks, words, mode, decimals, stops, placed):
            file.write(f"{line}\n".encode("ascii"))
    reach = float(np.max(blocks.deviations + blocks.blends))
    return WrittenProgram(len(words), duration, float(blocks.deviations.max()), reach)


def _machine(curve: Curve, plan: FeedrateProfile | Samples, acceleration: ArrayLike | None) -> tuple[FloatArray, float]:
    """Acceleration of the machine's axes, inf where it is not known, and the period of its controller."""
    limits = plan.limits if isinstance(plan, FeedrateProfile) else None
    period = DEFAULT_PERIOD if limits is None else limits.period
    if acceleration is None:
        known = np.full(curve.dim, np.inf) if limits is None else limits.acceleration
    else:
        known = numbers(acceleration, "acceleration", InputError)
        if known.shape not in ((), (curve.dim,)) or not (known > 0.0).all():
            raise InputError(
                f"acceleration = {acceleration!r} must be a number > 0, or one for each of {', '.join(curve.axes)}"
            )
    return np.broadcast_to(known, (curve.dim,)).astype(float), period


def require_both_sides(curve: Curve) -> None:
    """Refuse a curve that may leave its program to one side alone: blocks are chords, which pass it to the other."""
    within = curve.made_within
    if within is not None and within.side != PathTolerance.side:
        raise InputError(
            f"{curve.name}: side = {within.side!r}: the blocks of a written program are chords of the path, which pass the "
            "programmed one to the other side; write samples, or leave the side out"
        )


def _require_sound(path: str | Path, curve: Curve, plan: FeedrateProfile | Samples, report: Report | None) -> None:
    """Refuse a plan that breaks a limit, or that cannot be checked."""
    if report is None:
        limits = plan.limits if isinstance(plan, FeedrateProfile) else None
        if limits is None:
            raise InputError(
                f"{path}: not written: the plan does not say its limits; give report = check(curve, limits, plan)"
            )
        report = check(curve, limits, plan)
    if not report.ok:
        raise BrokenLimitError(f"{path}: not written: the plan {report.summary()}; plan again within the limits")


def _by_block(curve: Curve, blocks: WrittenBlocks, inserted: Sequence[tuple[float, str]]) -> Mapping[int, list[str]]:
    """Lines to put in after each point: the first one that is not before their place."""
    slack = 1e-9 * np.ptp(curve.domain)  # a place itself is a point, but for rounding
    after: dict[int, list[str]] = {}
    for place, line in inserted:
        after.setdefault(min(int(np.searchsorted(blocks.u, place - slack)), blocks.u.size - 1), []).append(line)
    return after


def _stops_the_machine(line: str) -> bool:
    """Whether LinuxCNC comes to rest for a line without moves: not for comments, nor for outputs set along the motion."""
    words = _COMMENT.sub("", line).upper().replace(" ", "")
    return bool(words) and _ALONG_THE_MOTION.fullmatch(words) is None


def _lines(
    curve: Curve,
    blocks: WrittenBlocks,
    feeds: list[str],
    mode: FeedMode,
    decimals: int,
    stops: NDArray[np.bool_],
    after: Mapping[int, list[str]],
) -> Iterator[str]:
    axes = curve.axes
    text = [[_plain(value, decimals) for value in row] for row in blocks.points.tolist()]
    name = "".join(c if c.isascii() and c.isprintable() and c not in "();" else "_" for c in curve.name)[:80]
    yield f"({name}: {len(feeds)} blocks)"
    yield "G21 G17 G90 G94"
    yield "G61"
    yield from after.get(0, ())
    yield "G0 " + " ".join(axis + word for axis, word in zip(axes, text[0], strict=True))
    if mode == "inverse_time":
        yield "G93"
    state, feed = "", ""
    for k in range(1, len(text)):
        wanted = "G61.1" if stops[k] else f"G64 P{_number(blocks.blends[k - 1], _P_DIGITS)} Q0"
        if wanted != state:
            yield wanted
            state = wanted
        words = [axis + word for axis, word, before in zip(axes, text[k], text[k - 1], strict=True) if word != before]
        if mode == "inverse_time" or feeds[k - 1] != feed:
            feed = feeds[k - 1]
            words.append("F" + feed)
        yield "G1 " + " ".join(words)
        yield from after.get(k, ())
    yield "M2"


def _plain(value: float, decimals: int) -> str:
    """A coordinate without the zeros at its end, and never -0."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _number(value: float, count: int = _F_DIGITS) -> str:
    """A number > 0 in plain digits, of which so many count."""
    digits = max(count - 1 - int(np.floor(np.log10(value))), 0)
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
