"""A plan played back: where the tool is at every time, at which feed, and on which line of its program.

Sketch.  The page draws the tool on the straight line between two frames, so frames are as dense as that needs: (1) the
nodes of the plan are the first frames, every k-th of them where they are too many; (2) an interval in which the tool or the
feed is farther from the straight line than is wanted is halved; (3) that ends when none is, or when as many frames are
there as are allowed: then the worst intervals were halved first, and what is left is told with the frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from feedplan.job import Job
from planner.errors import InputError
from planner.profile import FeedrateProfile
from planner.programs.program_text import ProgramText
from planner.programs.reading.program import ANGULAR
from planner.programs.reading.words import LineArray
from planner.programs.times import move_edges
from planner.types import FloatArray

_TOOL = 1e-3  # mm: the last digit that a controller shows
_FEED_SHARE = 1e-3  # of the highest feed
_INSIDE = (0.25, 0.5, 0.75)  # of an interval, where it is measured; its middle is where it is halved
_CHUNK = 100_000  # times evaluated at once; bounds the memory, changes no result


@dataclass(frozen=True, eq=False)
class Playback:
    """Frames of a plan; between two of them everything runs straight.

    Attributes
    ----------
    t : (n,) array
        Strictly increasing from 0 to the duration, s.
    position : (n, d) array
        The tool tip, mm.
    feed : (n,) array
        Its speed, mm/s.
    position_error, feed_error : float
        The farthest that the tool, mm, and the feed, mm/s, were found from the straight line: at three places between two
        frames, and at every node of the plan.
    """

    t: FloatArray
    position: FloatArray
    feed: FloatArray
    position_error: float
    feed_error: float

    @classmethod
    def of(cls, profile: FeedrateProfile, most: int) -> Playback:
        """Take frames of a plan, ``most`` of them at most, at least 2.

        Raises InputError if ``most`` is less.
        """
        if most < 2:
            raise InputError(f"most = {most} must be at least 2: the first and the last frame")
        nodes = profile.t[np.concatenate([[True], np.diff(profile.t) > 0.0])]
        t = nodes[:: max(1, -(-nodes.size // max(1, most // 2)))]
        # The first and the last are frames, also where only two are allowed.
        t = np.unique(np.concatenate([t[: most - 1], [profile.duration]]))
        places, feeds = _states(profile, t)
        wanted = np.array([_TOOL, _FEED_SHARE * max(float(profile.feed.max()), np.finfo(np.float64).tiny)])
        off = np.max(_off(profile, t, places, feeds) / wanted, axis=1)
        while t.size < most:
            bad = np.flatnonzero(off > 1.0)
            bad = np.sort(bad[np.argsort(-off[bad], kind="stable")[: most - t.size]])
            middle = 0.5 * (t[bad] + t[bad + 1])
            bad, middle = (values[(middle > t[bad]) & (middle < t[bad + 1])] for values in (bad, middle))
            if not bad.size:
                break
            more = _states(profile, middle)
            t = np.insert(t, bad + 1, middle)
            places, feeds = np.insert(places, bad + 1, more[0], axis=0), np.insert(feeds, bad + 1, more[1])
            # Both halves of each that was halved are measured anew.
            halves = np.concatenate([bad, bad + 1]) + np.tile(np.arange(bad.size), 2)
            off = np.insert(off, bad + 1, 0.0)
            off[halves] = np.max(_off(profile, t, places, feeds, halves) / wanted, axis=1)
        error = np.maximum(_off(profile, t, places, feeds).max(axis=0), _off_at(profile, t, places, feeds, nodes))
        return cls(t, places, feeds, float(error[0]), float(error[1]))

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position (m, d), mm, and feed (m,), mm/s, at times (m,), as the page shows them."""
        return _straight(self.t, self.position, self.feed, np.asarray(t, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class PlayedLines:
    """The lines of a part program in the order of the run; one that is run again stands here again.

    Attributes
    ----------
    start : (m,) array
        When each begins, s of the motion, without dwells and tool changes; not decreasing.
    line : (m,) int array
        Line number in the file, from 1.
    feed : (m,) array
        Programmed feed, mm/s; inf on rapids, nan where it is one of rotary axes alone.
    source : ProgramText
        The program as it stands.
    """

    start: FloatArray
    line: LineArray
    feed: FloatArray
    source: ProgramText

    @classmethod
    def of(cls, job: Job, profile: FeedrateProfile, source: ProgramText) -> PlayedLines:
        """Take the lines of a job's program; raises InputError if it has none."""
        if job.program is None or job.path is None:
            raise InputError(f"{job.curve.name} has no lines; playing them needs a part program")
        row = np.flatnonzero(job.program.lengths > 0.0)
        line, start = job.program.line[row], move_edges(job.path, profile)[:-1]
        feed = np.where(job.program.feed_group[row] == ANGULAR, np.nan, job.program.feed[row])
        # Several moves of a line, as those of a cycle, are one entry while their feed is one.
        new = np.concatenate([[True], (np.diff(line) != 0) | ~_same(feed[1:], feed[:-1])])
        return cls(start[new], line[new], feed[new], source)

    def at(self, t: float) -> int:
        """Which of the lines runs at a time."""
        return max(0, int(np.searchsorted(self.start, t, side="right")) - 1)

    @property
    def number(self) -> LineArray:
        """The lines that are named, each once, increasing."""
        return np.unique(self.line)

    def texts(self) -> list[str]:
        """What stands in each of these lines."""
        return [self.source.shown(number) for number in self.number.tolist()]

    def n_words(self) -> list[str]:
        """The N word of each of these lines, empty where it has none; no entries where no line has one."""
        words = [self.source.number_word(number) for number in self.number.tolist()]
        return words if any(words) else []


def _same(a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    return (a == b) | (np.isnan(a) & np.isnan(b))


def _states(profile: FeedrateProfile, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Tool tip (n, d), mm, and feed (n,), mm/s, of the plan."""
    parts = [profile.at(t[k : k + _CHUNK]) for k in range(0, t.size, _CHUNK)]
    tip = profile.curve.tip
    places = np.concatenate([tip.derivatives(part.u, 0)[0] for part in parts])
    return places, np.concatenate([np.asarray(part.feed) for part in parts])


def _straight(t: FloatArray, places: FloatArray, feeds: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions and feeds at the times ``at`` along straight lines between frames."""
    return np.stack([np.interp(at, t, column) for column in places.T], axis=-1), np.interp(at, t, feeds)


def _off_at(
    profile: FeedrateProfile, t: FloatArray, places: FloatArray, feeds: FloatArray, at: FloatArray
) -> FloatArray:
    """How far the plan is from the straight lines at any of the times, (2,): mm and mm/s."""
    return _distances(profile, t, places, feeds, at).max(axis=0)


def _off(
    profile: FeedrateProfile,
    t: FloatArray,
    places: FloatArray,
    feeds: FloatArray,
    intervals: LineArray | None = None,
) -> FloatArray:
    """How far the plan is from the straight line in each interval, or in some of them, (k, 2): mm and mm/s."""
    start = np.arange(t.size - 1) if intervals is None else intervals
    inside = t[start, None] + np.diff(t)[start, None] * np.array(_INSIDE)
    return _distances(profile, t, places, feeds, inside.ravel()).reshape(start.size, len(_INSIDE), 2).max(axis=1)


def _distances(
    profile: FeedrateProfile, t: FloatArray, places: FloatArray, feeds: FloatArray, at: FloatArray
) -> FloatArray:
    """Distance of tool and feed from the straight lines at times (m,), (m, 2)."""
    straight, true = _straight(t, places, feeds, at), _states(profile, at)
    return np.stack([np.linalg.norm(straight[0] - true[0], axis=1), np.abs(straight[1] - true[1])], axis=1)
