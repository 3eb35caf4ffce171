"""What is asked for at the ends of a section: rest, a feed, or nothing but that start and end agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Rest:
    """An exact stop: no feed, and no acceleration beyond it."""


@dataclass(frozen=True)
class Feed:
    """A tip feed, mm/s, above 0; and the tangential acceleration there, mm/s^2, where that is prescribed too."""

    feed: float
    acceleration: float | None = None


@dataclass(frozen=True)
class Free:
    """The seam of a periodic path, which is passed at any feed and acceleration, the same on both sides."""


End: TypeAlias = Rest | Feed | Free
REST, FREE = Rest(), Free()


def end_with(feed: float, acceleration: float | None = None) -> End:
    """Make the end of a tip feed, mm/s, as users give it: 0 is rest."""
    return REST if feed == 0.0 else Feed(feed, acceleration)


def feed_at(end: End) -> float:
    """Tip feed, mm/s, for messages and files: 0 at rest, nan where it is free."""
    return end.feed if isinstance(end, Feed) else 0.0 if isinstance(end, Rest) else float("nan")
