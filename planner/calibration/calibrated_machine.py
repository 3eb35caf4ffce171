"""The machine file that a calibration makes: what was found in place of what the start file says, and where from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from planner.calibration.axis_limits import AxisLimit
from planner.machine.limits import Limits
from planner.machine.machine_table import Machine
from planner.machine.toml_text import toml_text
from planner.quantity import AXIS

_DIGITS = 6
_PASSED = 1e-3  # of a limit: less is no more than it
_SMALL = 1e-4  # shares below are not told apart


def calibrated_limits(start: Limits, found: Sequence[AxisLimit]) -> Limits:
    """Limits with what was found; where it is not known those of the start, or what was reached if that is more."""
    rows = {q.key: getattr(start, q.key).copy() for q in AXIS}
    for limit in found:
        if limit.known or limit.joint or is_raised(limit, start):
            rows[limit.quantity.key][start.axes.index(limit.axis)] = float(f"{limit.value:.{_DIGITS}g}")
    return start.with_axes(start.axes, **rows)


def calibrated_text(machine: Machine, found: Sequence[AxisLimit], head: Sequence[str], folder: Path) -> str:
    """The machine file, each limit of an axis with a remark of where it comes from."""
    limits = calibrated_limits(machine.limits, found)
    remarks = {(limit.axis, limit.quantity.key): remark(limit, machine.limits) for limit in found}
    return toml_text(limits, machine.setup, folder, head, remarks)


def remark(limit: AxisLimit, start: Limits) -> str:
    """Where a value of the file comes from."""
    if limit.known:
        return f"measured {limit.count} times, within {percent(limit.spread)}; was {_was(limit, start):g}"
    if limit.joint:
        return f"fits together with others, by itself within {percent(limit.spread)}; was {_was(limit, start):g}"
    if is_raised(limit, start):
        return f"reached, may be higher; was {_was(limit, start):g}"
    return "as it was: not measured"


def is_raised(limit: AxisLimit, start: Limits) -> bool:
    """Whether a limit that is not known was passed: it is at least what was reached."""
    return not limit.known and not limit.joint and limit.value > _was(limit, start) * (1.0 + _PASSED)


def percent(share: float) -> str:
    """A small share as a person reads it."""
    return f"{100.0 * share:.2g}%" if share >= _SMALL else f"<{100.0 * _SMALL:.2g}%"


def _was(limit: AxisLimit, start: Limits) -> float:
    return float(getattr(start, limit.quantity.key)[start.axes.index(limit.axis)])
