"""What a check finds: a row for each limit and axis, and the verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.frames import Tabular
from planner.geometry.curve import Curve
from planner.quantity import ACCELERATION, AXIS, FEED, JERK, PATH, TANGENTIAL_ACCELERATION, VELOCITY

HOLDS, BREAKS = "every limit holds", "BREAKS ITS LIMITS"

Place = tuple[float, float]  # (t, u)

# Unit of each row; of a row about an axis, what follows the axis' own unit.
_UNITS = {
    **{q.label: q.unit() for q in PATH},
    **{q.label: q.per_time for q in AXIS},
    "programmed feed": FEED.unit(),
    "velocity step": VELOCITY.per_time,
    "acceleration step": ACCELERATION.per_time,
    "tangential step": TANGENTIAL_ACCELERATION.unit(),
    "step on a smooth path": ACCELERATION.per_time,
    "jerk at a curvature break": JERK.per_time,
    "reversal": "1/s",
    "path start": "mm",
    "path end": "mm",
    "path error": "",
    "position step": "mm",
    "table columns": "",
    "binding limit": "",
    "finite values": "",
    "time order": "s",
    "sample times": "s",
}


@dataclass(frozen=True)
class Row:
    """The worst use of one limit by one axis.

    Attributes
    ----------
    limit : str
        What is limited, by its label in :mod:`planner.quantity`; "programmed feed" (against the curve's own caps),
        "velocity step", "acceleration step", "tangential step", "step on a smooth path", "jerk at a curvature break",
        "exact stop", "acceleration at an exact stop"; or what makes the plan one at all: "reversal", "path start",
        "path end", "path error", "position step", "table columns" (largest error over what rounding grants),
        "binding limit" (nodes that name another limit than the one used most), "finite values", "time order",
        "sample times".
    axis : str
        Name of the axis; empty where the row is not about one.
    worst, allowed : float
        Largest value found (of places with different slack: the largest less slack) and the limit, in ``unit``.
    ratio : float
        worst / allowed; 0 where the limit is inf; where nothing is allowed, 0 or (if it is not ok) inf.
    t, u : float
        Where the worst value is, s and curve parameter.
    unit : str
        Unit of worst and allowed.
    slack : float
        What the rounding of the plan's own numbers can add to the value there; granted on top of ``allowed``.
    ok : bool
        worst <= allowed (1 + tolerance) + slack.
    """

    limit: str
    axis: str
    worst: float
    allowed: float
    ratio: float
    t: float
    u: float
    unit: str
    slack: float
    ok: bool


@dataclass(frozen=True, repr=False)
class Report(Tabular):
    """What :func:`check` found: a table of its rows.

    Attributes
    ----------
    rows : tuple of Row
        One for each limit and axis.
    start_feed, end_feed : float
        Feed with which the plan begins and ends, mm/s.
    start_acceleration, end_acceleration : float
        Tangential acceleration there, mm/s^2.
    """

    rows: tuple[Row, ...]
    start_feed: float = 0.0
    end_feed: float = 0.0
    start_acceleration: float = 0.0
    end_acceleration: float = 0.0

    @property
    def ok(self) -> bool:
        """True where every row holds."""
        return all(row.ok for row in self.rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Every field of the rows, (n,) arrays."""
        kinds = {"limit": object, "axis": object, "unit": object, "ok": np.bool_}
        names = [field.name for field in fields(Row)]
        return {name: np.array([getattr(row, name) for row in self.rows], kinds.get(name, float)) for name in names}

    def __repr__(self) -> str:
        worst = max(self.rows, key=lambda row: row.ratio, default=None)
        name = (
            "" if worst is None else f"; most used: {worst.limit} {worst.axis}".rstrip() + f", {worst.ratio:.6g} of it"
        )
        count = len(self.violations)
        return f"Report({HOLDS if not count else f'{count} of {len(self.rows)} checks fail'}{name})"

    @property
    def violations(self) -> tuple[Row, ...]:
        """The rows that do not hold."""
        return tuple(row for row in self.rows if not row.ok)

    def summary(self) -> str:
        """One line for the head of a file: every limit holds, or which breaks most."""
        broken = self.violations
        if not broken:
            return HOLDS
        worst = max(broken, key=lambda row: row.ratio)
        name = f"{worst.limit} {worst.axis}".strip()
        return (
            f"{BREAKS}: {len(broken)} of {len(self.rows)} checks fail, the worst is {name}, {worst.worst:.6g} of "
            f"{worst.allowed:.6g} {worst.unit} at t = {worst.t:.6g} s".replace("  ", " ")
        )

    def row(self, limit: str, axis: str = "") -> Row:
        """Return the row of a limit and an axis; raises InputError where there is none."""
        for row in self.rows:
            if (row.limit, row.axis) == (limit, axis):
                return row
        known = ", ".join(f"{row.limit} {row.axis}".strip() for row in self.rows)
        raise InputError(f'there is no row "{limit}" for the axis "{axis}"; there are {known}')

    def __str__(self) -> str:
        """A table, one line a row, with the verdict above it."""
        count = len(self.violations)
        head = "every limit holds" if not count else f"{count} of {len(self.rows)} checks fail"
        lines = [f"{head}; feed {self.start_feed:.6g} mm/s at the start, {self.end_feed:.6g} mm/s at the end"]
        for row in self.rows:
            name = f"{row.limit} {row.axis}".strip()
            lines.append(
                f"{'' if row.ok else 'FAILS':5} {name:28} {row.worst:13.7g} of {row.allowed:10.6g} {row.unit:8}"
                f" ratio {row.ratio:<12.7g} at t = {row.t:.6g} s, u = {row.u:.6g}"
                + (f" (slack {row.slack:.2g})" if row.slack > 0.0 else "")
            )
        return "\n".join(lines)


class Rows:
    """Collects rows and gives each its unit and verdict."""

    def __init__(self, curve: Curve, tolerance: float) -> None:
        self.axes = curve.axes
        self.units = curve.axis_units
        self.tolerance = tolerance
        self.rows: list[Row] = []

    def add(
        self,
        limit: str,
        worst: float,
        allowed: float,
        place: Place,
        *,
        slack: float = 0.0,
        j: int | None = None,
        unit: str | None = None,
    ) -> None:
        """Add one row, about axis j if given; place is (t, u)."""
        worst, allowed, slack = float(worst), float(allowed), float(slack)
        ok = bool(np.isfinite(worst)) and worst <= allowed * (1.0 + self.tolerance) + slack
        if np.isinf(allowed):
            ratio = 0.0
        elif allowed > 0.0:
            ratio = worst / allowed
        else:
            ratio = 0.0 if ok else np.inf
        axis = "" if j is None else self.axes[j]
        if unit is None:
            unit = ("" if j is None else self.units[j]) + _UNITS[limit]
        self.rows.append(Row(limit, axis, worst, allowed, ratio, float(place[0]), float(place[1]), unit, slack, ok))
