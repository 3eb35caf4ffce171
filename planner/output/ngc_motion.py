"""What LinuxCNC makes of blocks that are written for it, and the blending and the feeds that make it keep to a plan.

Its trajectory planner has an acceleration limit and no jerk limit.  From block to block, under G64, it follows these rules
(LinuxCNC 2.9, ``src/emc/tp/tp.c`` and ``blendmath.c`` say them, runs in its simulator confirm them):

1. A kink by the angle h at the speed v asks for the acceleration v h/T within one servo period T.  Up to a tenth of what the
   axes have, the blocks join without a blend, and lose that share of their acceleration.
2. Else an arc of the radius R within P = R (1/cos(h/2) - 1) joins them, on at most half of either block.  On it the speed is
   at most sqrt(0.866 a R), and the acceleration along it is **half** of what a line has.
3. An arc shorter than the way of a period lowers the speed to one arc a period.
4. What is left of a line between two arcs becomes part of the second one where it takes less than four periods.

So a wide P costs acceleration: it turns the whole path into arcs.  ``needed_blends`` asks for the narrowest one that passes
the kink at the planned speed, and ``block_feeds`` for an F from which the ramps of rule 2 take what the plan allows for.
``motion_time`` follows the rules over all blocks: what LinuxCNC takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.types import FloatArray

_NORMAL = 0.866  # of the acceleration, across a blend
_ALONG = 0.5  # of the acceleration, along a blend
_KINK = 0.1  # of the acceleration, for a kink without a blend
_KINK_MARGIN = 0.8  # kinks below this share of _KINK need no blend, whatever the digits
_GAP_PERIODS = 4.0  # shorter rests of a line join the arc before
_NORMAL_MARGIN = 1.05  # a blend is wider by this than its speed asks for
_REST_PERIODS = 3.0  # from one rest to the next
_ARC_PERIODS = 1.3  # and at least as long as this many periods; with 1.1 LinuxCNC took 40 % longer on one of our curves


@dataclass(frozen=True, eq=False)
class BlockMotion:
    """Blocks as lines in X Y Z, with what the plan has there.

    Attributes
    ----------
    length : (n,) array
        mm.
    direction : (n, d) array
        Unit vectors.
    speed : (n + 1,) array
        Planned at the ends of the blocks, mm/s.
    acceleration : (d,) array
        Of the machine's axes, mm/s^2; finite.
    period : float
        Of the controller, s.
    """

    length: FloatArray
    direction: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    period: float

    @property
    def kinks(self) -> FloatArray:
        """Angles between the blocks, (n - 1,), rad."""
        apart = np.linalg.norm(np.diff(self.direction, axis=0), axis=1)
        angle: FloatArray = 2.0 * np.arcsin(np.clip(0.5 * apart, 0.0, 1.0))
        return angle

    @property
    def along(self) -> FloatArray:
        """What the axes allow along each block, (n,), mm/s^2."""
        with np.errstate(divide="ignore"):
            least: FloatArray = np.min(self.acceleration / np.abs(self.direction), axis=1)
        return least

    def kink_share(self, speed: FloatArray) -> FloatArray:
        """Share of the acceleration that each kink asks for within one period, (n - 1,), at these speeds."""
        change = np.abs(np.diff(self.direction, axis=0)) * (speed / self.period)[:, None]
        share: FloatArray = np.max(change / self.acceleration, axis=1, initial=0.0)
        return share


def needed_blends(motion: BlockMotion) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The least P, (n - 1,) in mm, with which each kink is passed at the planned speed, and where none is needed.

    Where half of a block is too short for that, it is the P that uses the half.
    """
    speed, half = motion.speed[1:-1], 0.5 * motion.kinks
    free = motion.kink_share(speed + motion.acceleration.max() * motion.period) <= _KINK_MARGIN * _KINK
    turned = np.maximum(motion.kinks, 1e-12)
    radius = np.maximum(
        _NORMAL_MARGIN * speed**2 / (_NORMAL * motion.acceleration.min()), _ARC_PERIODS * motion.period * speed / turned
    )
    shorter = np.minimum(motion.length[1:], motion.length[:-1])
    radius = np.minimum(radius, 0.5 * shorter / np.maximum(np.tan(half), 1e-12))
    return np.where(free, 0.0, radius * (1.0 / np.cos(np.minimum(half, 1.5)) - 1.0)), free


def block_feeds(motion: BlockMotion, times: FloatArray) -> FloatArray:
    """Feeds (n,), mm/s, at which blocks take their times (n,) with ramps between them.

    The controller reaches the feed of a block within it, or before it where it brakes, on a ramp as steep as it can.  With
    the mean feed of the plan, and a step D from block to block, the ramp would lose r D/2 of the mean, r the share of the
    acceleration that the plan uses: this is added.  At r = 1 it is the highest feed of the block.
    """
    step = np.abs(np.diff(motion.speed))
    used = np.minimum(step / times / motion.along, 1.0)
    most = np.maximum(motion.speed[1:], motion.speed[:-1])
    mean = motion.length / times
    feeds: FloatArray = np.maximum(mean, np.minimum(mean + 0.5 * step * used, most))
    return feeds


def motion_time(motion: BlockMotion, feeds: FloatArray, blends: FloatArray, stops: NDArray[np.bool_]) -> float:
    """Time that LinuxCNC takes by its rules, s.

    Parameters
    ----------
    motion : BlockMotion
    feeds, blends : (n,) array
        Feed, mm/s, and P, mm, of each block.
    stops : (n - 1,) array of bool
        Kinks at which it comes to rest.
    """
    slower = np.minimum(feeds[1:], feeds[:-1])
    asked = motion.kink_share(slower + motion.along[1:] * motion.period)
    half = 0.5 * motion.kinks
    reach = np.maximum(1.0 / np.cos(np.minimum(half, 1.5)) - 1.0, 1e-300)
    tangent = np.maximum(np.tan(half), 1e-12)
    shorter = 0.5 * np.minimum(motion.length[1:], motion.length[:-1])
    radius = np.minimum(np.minimum(blends[1:], blends[:-1]) / reach, shorter / tangent)
    arc = radius * motion.kinks
    fast = np.minimum(np.sqrt(_NORMAL * motion.acceleration.min() * radius), arc / motion.period)
    blended = (asked >= _KINK) & (fast > slower * _KINK / np.maximum(asked, _KINK)) & ~stops
    lost = np.where(stops | blended, 0.0, np.minimum(asked, _KINK))
    passed = np.where(stops, 0.0, slower * np.minimum(_KINK / np.maximum(asked, _KINK), 1.0))
    taken = np.where(blended, radius * tangent, 0.0)

    # Lines at the even places, blends between them at the odd ones; a blend without length where there is none.
    count = 2 * motion.length.size - 1
    way, acceleration, cap = np.zeros(count), np.zeros(count), np.full(count, np.inf)
    before, after = np.append(0.0, taken), np.append(taken, 0.0)
    way[::2] = np.maximum(motion.length - before - after, 0.0)
    way[1::2] = np.where(blended, arc, 0.0)
    cap[::2] = feeds
    cap[1::2] = np.where(blended, np.minimum(fast, np.maximum(feeds[1:], feeds[:-1])), passed)
    swallowed = np.append(blended, False) & (way[::2] < _GAP_PERIODS * motion.period * feeds)
    cap[::2] = np.where(swallowed, np.minimum(feeds, np.append(fast, np.inf)), feeds)
    whole = motion.along * (1.0 - np.maximum(np.append(0.0, lost), np.append(lost, 0.0)))
    acceleration[::2] = np.where(swallowed, _ALONG * motion.acceleration.min(), whole)
    acceleration[1::2] = _ALONG * motion.acceleration.min()
    return _ramped_time(way, acceleration, cap) + _REST_PERIODS * motion.period * (1 + int(stops.sum()))


def _ramped_time(way: FloatArray, acceleration: FloatArray, cap: FloatArray) -> float:
    """Least time from rest to rest over pieces with an acceleration and a highest speed each."""
    doubled = 2.0 * acceleration * way
    ends = np.minimum(np.append(cap, 0.0), np.append(0.0, cap))
    squares = (ends**2).tolist()
    gain = doubled.tolist()
    for k in range(len(gain) - 1, -1, -1):
        squares[k] = min(squares[k], squares[k + 1] + gain[k])
    for k, more in enumerate(gain):
        squares[k + 1] = min(squares[k + 1], squares[k] + more)
    v = np.sqrt(squares)
    first, last = v[:-1], v[1:]
    moves = way > 0.0
    first, last, way, acceleration, cap = (x[moves] for x in (first, last, way, acceleration, cap))
    with np.errstate(invalid="ignore"):
        peak = np.minimum(np.sqrt(0.5 * (first**2 + last**2) + acceleration * way), cap)
        ramps = (2.0 * peak - first - last) / acceleration
        held = way - (peak**2 - 0.5 * (first**2 + last**2)) / acceleration
    return float(np.sum(ramps + np.maximum(held, 0.0) / peak))
