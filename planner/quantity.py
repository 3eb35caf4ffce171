"""What can be limited: one table of the quantities, which everything else that tells them apart reads.

A limit is on a quantity of the *path* (one number) or of every *axis* (one each).  The table gives the order of its time
derivative, the power of the time with which it falls when a motion runs slower, its unit and the words and letters for
it.  It is data: no formula stands here, so that the planner and the check that shares no formula with it can both read it.

A further limit is an entry here, a field of :class:`~planner.machine.limits.Limits`, a row of ``limit_rows`` and what
the check measures (``verify``), with its test and its page; solvers, multipliers, shares, files, tables, verdicts and
letters follow from these.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

NONE = "none"
"""What holds a path back where no limit does."""


class Scope(Enum):
    """What a limit is on."""

    PATH = "path"
    AXIS = "axis"


@dataclass(frozen=True)
class Quantity:
    """One quantity that can be limited.

    Attributes
    ----------
    key : str
        Field of ``Limits``, and the beginning of the key in machine files and tables.
    letter : str
        What stands for it in a narrow table.
    scope : Scope
    order : int
        Order of the time derivative; 0 is a length.
    power : int
        A motion that runs slower by a factor f uses f^-power of it.
    required : bool
        A machine must say it, be it inf; else inf is meant where it is left out.
    """

    key: str
    letter: str
    scope: Scope
    order: int
    power: int
    required: bool = False

    @property
    def label(self) -> str:
        """The words for it."""
        return self.key.replace("_", " ")

    def of(self, axis: str) -> str:
        """Name of the limit on one axis; of the path where the axis is empty."""
        return f"{self.label} {axis}".strip()

    @property
    def per_time(self) -> str:
        """What follows the unit of length or angle: "/s^2"."""
        return "" if self.order == 0 else "/s" if self.order == 1 else f"/s^{self.order}"

    def unit(self, length: str = "mm") -> str:
        """Unit, by that of its axis: "mm" or "rad"."""
        return length + self.per_time

    def suffix(self, length: str = "mm") -> str:
        """The unit as keys of files end: "mm_s2"."""
        return self.unit(length).replace("/", "_").replace("^", "")

    def file_key(self, length: str = "mm") -> str:
        """Key of a machine file: "jerk_rad_s3"."""
        return f"{self.key}_{self.suffix(length)}"


FEED = Quantity("feed", "F", Scope.PATH, order=1, power=1, required=True)
CHORD_ERROR = Quantity("chord_error", "C", Scope.PATH, order=0, power=2)  # of a chord of one period: as its square
VELOCITY = Quantity("velocity", "V", Scope.AXIS, order=1, power=1, required=True)
ACCELERATION = Quantity("acceleration", "A", Scope.AXIS, order=2, power=2, required=True)
JERK = Quantity("jerk", "J", Scope.AXIS, order=3, power=3, required=True)
TANGENTIAL_ACCELERATION = Quantity("tangential_acceleration", "TA", Scope.PATH, order=2, power=2)
TANGENTIAL_JERK = Quantity("tangential_jerk", "TJ", Scope.PATH, order=3, power=3)

QUANTITIES = (
    FEED,
    CHORD_ERROR,
    VELOCITY,
    ACCELERATION,
    JERK,
    TANGENTIAL_ACCELERATION,
    TANGENTIAL_JERK,
)
PATH = tuple(quantity for quantity in QUANTITIES if quantity.scope is Scope.PATH)
AXIS = tuple(quantity for quantity in QUANTITIES if quantity.scope is Scope.AXIS)
TANGENTIAL = tuple(quantity for quantity in PATH if quantity.order > 1)
"""Time derivatives of the arc length beyond the feed."""


def motion_names(order: int, axes: Iterable[str]) -> tuple[str, ...]:
    """Limits on the derivatives of one order of the motions: of each axis, and last of the arc length of the tip."""
    axis, path = (next(q for q in some if q.order == order) for some in (AXIS, (FEED, *TANGENTIAL)))
    return (*(axis.of(name) for name in axes), path.label)


def with_label(label: str) -> Quantity | None:
    """The quantity with these words, None where they are not of one."""
    return next((quantity for quantity in QUANTITIES if quantity.label == label), None)


def limit_names(axes: Iterable[str]) -> tuple[str, ...]:
    """Every limit that a plan can name, "none" first: those of the path, then of each axis."""
    axes = tuple(axes)
    return (NONE, *(q.label for q in PATH), *(q.of(axis) for q in AXIS for axis in axes))
