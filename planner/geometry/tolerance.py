"""The tolerance that a curve was made within, where it stands for a part program or for points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

DEFAULT_TOLERANCE = 0.01  # mm of a part program, where neither the program nor the caller gives one
POINTS_TOLERANCE_MM = 1e-3  # of the points of a CSV file

PathKind = Literal["joint", "separate"]
"""How the path of a part program is made: together with its feed, as one problem, or first and its feed after it."""


PathSide = Literal["both", "left", "right", "inside", "outside"]
"""Where the path may leave a programmed contour to: both its sides, that of the motion, or that of a closed contour."""


@dataclass(frozen=True)
class PathTolerance:
    """With the same source and the same tolerance the same curve is made again.

    Attributes
    ----------
    mm : float or None
        Largest distance from the source, mm; None: the P words of the part program.
    share : float
        Part of it that the curve took; the rest is left to a program written from the plan.
    machine : str
        Example machine whose limits weighed the path of a part program; empty where they are those of the plan.
    path : {"joint", "separate"}
        Whether it was found together with its feed.
    side : {"both", "left", "right", "inside", "outside"}
        Where it may leave the program to.
    """

    mm: float | None
    share: float = 1.0
    machine: str = ""
    path: PathKind = "separate"
    side: PathSide = "both"
