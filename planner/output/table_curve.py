"""Whether a curve is the one that a table was planned on, by another machine's rounding too.

Equal hashes are equal curves.  Where they differ, a curve that was made again on another machine (another libm, another
compiler) is the same within its rounding: the rows of a table hold the place of the curve at every node of the plan, and
where all of them are those of the curve to ``SAME_CURVE`` of its size, on as many nodes in each polynomial piece as
determine it, the table is this curve's.  No further data is kept for that, so tables of earlier versions are compared
alike.

A node on a break of the curve that was planned is put on the break of the curve that is given: a last digit beside it, it
would be seen from the wrong side.  The law of time is otherwise read as it was written.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.errors import InputError
from planner.files.columns import ColumnFile, Columns
from planner.geometry.curve import ROTARY_AXES, Curve
from planner.inputs import shorten
from planner.types import FloatArray

SAME_CURVE = 1e-12
"""Of the largest coordinate, and of the domain: what a curve may differ by from the one that was planned."""


def require_axes(file: ColumnFile, curve: Curve) -> None:
    """Refuse a table of a curve with other axes."""
    said = file.header["axes"]
    if said != " ".join(curve.axes) and file.header["curve_hash"] != curve.fingerprint:
        raise _refusal(file, curve, f"its axes are {shorten(said)}, not {' '.join(curve.axes)}")


def columns_on_curve(file: ColumnFile, columns: Columns, curve: Curve, names: Sequence[str]) -> Columns:
    """The columns of a table as they are on this curve; ``names`` are those of its axes.

    Raises
    ------
    InputError
        If the table was planned on another curve: how far that is off and where, or why the rows cannot tell.
    """
    if file.header["curve_hash"] == curve.fingerprint:
        return columns
    if not np.isfinite(columns["u"]).all() or columns["u"].size < 2:
        raise _refusal(file, curve, "it has no rows to compare")
    u = _on_breaks(file, columns["u"], curve)
    _require_same_places(file, np.stack([columns[name] for name in names], axis=1), u, curve)
    _require_enough(file, u, curve)
    return {**columns, "u": u}


def _on_breaks(file: ColumnFile, u: FloatArray, curve: Curve) -> FloatArray:
    """Parameters (n,) with those beside a break, or an end, put on it; refused where the domain is another."""
    breaks = curve.pieces.breaks
    near = SAME_CURVE * (breaks[-1] - breaks[0])
    for said, end in ((float(u[0]), float(breaks[0])), (float(u[-1]), float(breaks[-1]))):
        if not abs(said - end) <= near:
            raise _refusal(file, curve, f"its parameter has an end at u = {said!r}, that of {curve.name} at {end!r}")
    after = np.clip(np.searchsorted(breaks, u), 1, breaks.size - 1)
    nearest = np.where(u - breaks[after - 1] < breaks[after] - u, breaks[after - 1], breaks[after])
    return np.where(np.abs(u - nearest) <= near, nearest, u)


def _require_same_places(file: ColumnFile, shown: FloatArray, u: FloatArray, curve: Curve) -> None:
    """Refuse rows ``shown (n, dim)`` that are not the curve's places at u (n,)."""
    inside = np.clip(u, *curve.domain)  # rows that go astray are refused by what reads the time law
    places = curve.derivatives(inside, 0)[0]
    turning = np.array([axis in ROTARY_AXES for axis in curve.axes])
    size = np.empty(curve.dim)
    for kind in (turning, ~turning):
        size[kind] = np.abs(places[:, kind]).max(initial=0.0)
    apart = np.abs(shown - places)
    if (apart <= SAME_CURVE * size).all():
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        row, j = np.unravel_index(int(np.argmax(np.nan_to_num(apart / size, nan=0.0, posinf=np.inf))), apart.shape)
    unit = curve.axis_units[j]
    raise _refusal(
        file,
        curve,
        f"{curve.axes[j]} is {apart[row, j]:.3g} {unit} off at u = {u[row]:.9g} (row {row + 1}); "
        f"{SAME_CURVE:g} of its size, {SAME_CURVE * size[j]:.2g} {unit}, is allowed",
    )


def _require_enough(file: ColumnFile, u: FloatArray, curve: Curve) -> None:
    """Refuse a table with fewer rows on a piece than it has coefficients: another curve may pass through them too."""
    pieces = curve.pieces
    needed = pieces.coefficients.shape[2] * (2 if pieces.rational else 1)
    at = np.unique(u)
    first, last = np.searchsorted(at, pieces.breaks[:-1]), np.searchsorted(at, pieces.breaks[1:], side="right")
    few = np.flatnonzero(last - first < needed)
    if few.size:
        start, end = pieces.breaks[few[0] : few[0] + 2]
        raise _refusal(
            file,
            curve,
            f"their hashes differ, and {last[few[0]] - first[few[0]]} rows between u = {start:.9g} and {end:.9g} cannot "
            f"tell whether rounding alone does it ({needed} are needed)",
        )


def _refusal(file: ColumnFile, curve: Curve, why: str) -> InputError:
    if file.header.get("path_kind") == "joint":
        why += (
            "; the path of a program as joint is the same to that only where rounding is the same; plan it there, or with "
            "--path separate"
        )
    return InputError(
        f"{file.path}: the table is for the curve {shorten(file.header['curve'])} (hash "
        f"{shorten(file.header['curve_hash'])[:12]}), not for {curve.name} (hash {curve.fingerprint[:12]}): {why}; give the "
        "curve, and the scale and tolerance, it was planned with; a program that counts on homes or offsets of a machine "
        "file needs that file too (--setup)"
    )
