"""The feedrate table: a plan as a CSV or NPZ file, written whole and read back bit by bit.

One row is one node of the plan's time law.  Between two rows the curve parameter is the quintic in time that takes
their ``u``, ``u_rate`` and ``u_acceleration``, so these columns and ``t_s`` are the plan; the others show the same
nodes to a person or a controller, and a reader refuses a table in which they disagree.  The header holds the format
version, units, curve and its hash, method, duration, lower bound, every limit and the number of rows.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.geometry.curve import ROTARY_AXES, Curve, Side
from planner.limits import Limits
from planner.profile import FeedrateProfile, Samples
from planner.tablefile import ColumnFile, Columns, reading, write_columns

_PLAN_FORMAT = "feedplan-table 1"
_SAMPLES_FORMAT = "feedplan-samples 1"
_UNITS = "mm, rad, s; u is the curve parameter, u_rate in 1/s, u_acceleration in 1/s^2"
_TIME_LAW = "between two rows u(t) is the quintic that takes u, u_rate and u_acceleration of both"
_ALONG = {"s_mm": "s", "feed_mm_s": "feed", "acceleration_mm_s2": "acceleration", "jerk_mm_s3": "jerk"}
_SCALAR_LIMITS = {
    "feed": "mm_s",
    "chord_error": "mm",
    "period": "s",
    "tangential_acceleration": "mm_s2",
    "tangential_jerk": "mm_s3",
}
_AXIS_LIMITS = {"velocity": "s", "acceleration": "s2", "jerk": "s3"}
_KEYS = ("curve", "curve_hash", "axes", "method", "duration_s", "lower_bound_s", "limit_names", "notes", "rows")
# Columns that follow from the others may differ by what another machine's rounding does, against their largest value.
_AGREEMENT = 1e-6
# What else a table may say of its curve: how the path was made from a part program or from points.
_ORIGIN = ("path_tolerance_mm", "path_share")
_SAME_PLACE = 1e-9  # of the domain: what rounding may leave between two rows of one place


def write_table(path: str | Path, profile: FeedrateProfile, limits: Limits) -> None:
    """Write a plan as a feedrate table.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (also without a suffix) or ``.npz``.
    profile : FeedrateProfile
    limits : Limits
        The limits it was planned for; they go into the header.

    Raises
    ------
    InputError
        If the file cannot be written, the suffix is unknown, the plan has a value that is not finite, or the axes of
        the limits are not those of the curve.  Then no file is left behind.
    """
    curve = profile.curve
    limits.require_matches(curve)
    positions = curve.derivatives(profile.u, 0)[0]
    columns: dict[str, NDArray[Any]] = {"t_s": profile.t, "u": profile.u, "s_mm": profile.s}
    columns |= {name: positions[:, j] for j, name in enumerate(_axis_columns(curve))}
    columns |= {name: getattr(profile, field) for name, field in _ALONG.items()}
    columns |= {"binding": profile.binding, "u_rate": profile.u_rate, "u_acceleration": profile.u_acceleration}
    header = {
        "format": _PLAN_FORMAT,
        "units": _UNITS,
        "time_law": _TIME_LAW,
        **_curve_lines(curve),
        "method": profile.method,
        "duration_s": repr(profile.duration),
        "lower_bound_s": repr(float(profile.lower_bound)),
        **_limit_lines(curve.axes, limits),
        **{key: str(value) for key, value in profile.stats.get("origin", {}).items() if key in _ORIGIN},
        "limit_names": ", ".join(profile.limit_names),
        "notes": json.dumps([str(note) for note in profile.stats.get("notes", ())]),
        "rows": str(profile.t.size),
    }
    write_columns(path, header, columns, {"binding": profile.limit_names})


def read_table(path: str | Path, curve: Curve) -> FeedrateProfile:
    """Read a feedrate table back, equal to the plan that was written bit by bit.

    ``stats`` holds the notes of the plan and the period it was made for, nothing else; :func:`table_limits` reads all
    limits in the header.

    Parameters
    ----------
    path : str or Path
        A file of :func:`write_table`.
    curve : Curve
        The curve it was planned for.

    Returns
    -------
    FeedrateProfile

    Raises
    ------
    InputError
        If the file cannot be read, belongs to another curve, is cut off, has an unknown version, lacks a column, holds
        something else than a finite number where one is due, has times that do not increase or parameters that do not
        reach from end to end of the curve, or shows columns that disagree with its time law.
    """
    wanted = ["t_s", "u", *_ALONG, *_axis_columns(curve), "binding", "u_rate", "u_acceleration"]
    with reading(path, _PLAN_FORMAT, _KEYS) as file:
        header = file.header
        _require_curve(file, curve)
        names = tuple(header["limit_names"].split(", "))
        columns = file.columns(wanted, {"binding": names})
        _require_time_law(file, columns, curve)
        _require_agreement(file, columns, curve)
        return FeedrateProfile(
            curve,
            t=columns["t_s"],
            u=columns["u"],
            u_rate=columns["u_rate"],
            u_acceleration=columns["u_acceleration"],
            s=columns["s_mm"],
            feed=columns["feed_mm_s"],
            acceleration=columns["acceleration_mm_s2"],
            jerk=columns["jerk_mm_s3"],
            binding=columns["binding"],
            limit_names=names,
            lower_bound=_number(file, "lower_bound_s"),
            method=header["method"],
            stats={"notes": _notes(file), "period": _number(file, "limit_period_s")}
            | ({"origin": _origin(file)} if _origin(file) else {}),
        )


def table_limits(path: str | Path) -> Limits:
    """Read the limits a table was planned for out of its header.

    Raises InputError if the file cannot be read, is no feedrate table, or lacks a limit.
    """
    with reading(path, _PLAN_FORMAT, _KEYS) as file:
        return _limits_of(file)


def table_origin(path: str | Path) -> dict[str, str]:
    """Read how the path of a table was made from a part program or points; empty for other curves.

    Raises InputError if the file cannot be read or is no feedrate table.
    """
    with reading(path, _PLAN_FORMAT, _KEYS) as file:
        return _origin(file)


def write_samples(path: str | Path, curve: Curve, samples: Samples) -> None:
    """Write samples, one row a period: ``t_s``, ``u`` and the machine axes, as CSV or NPZ.

    Raises InputError if the file cannot be written; then none is left behind.
    """
    columns: dict[str, NDArray[Any]] = {"t_s": samples.t, "u": samples.u}
    columns |= {name: samples.position[:, j] for j, name in enumerate(_axis_columns(curve))}
    header = {
        "format": _SAMPLES_FORMAT,
        "units": "mm, rad, s; u is the curve parameter",
        **_curve_lines(curve),
        "period_s": repr(float(samples.period)),
        "rows": str(samples.t.size),
    }
    write_columns(path, header, columns, {})


def _axis_columns(curve: Curve) -> list[str]:
    return [f"{axis}_{unit}" for axis, unit in zip(curve.axes, curve.axis_units, strict=True)]


def _curve_lines(curve: Curve) -> dict[str, str]:
    return {"curve": " ".join(curve.name.split()), "curve_hash": curve.fingerprint, "axes": " ".join(curve.axes)}


def _limit_keys(axes: Sequence[str]) -> dict[str, list[str]]:
    """Header keys of every limit: one each, or one for every axis."""
    keys = {name: [f"limit_{name}_{unit}"] for name, unit in _SCALAR_LIMITS.items()}
    units = ["rad" if axis in ROTARY_AXES else "mm" for axis in axes]
    for name, per in _AXIS_LIMITS.items():
        keys[name] = [f"limit_{name}_{axis}_{unit}_{per}" for axis, unit in zip(axes, units, strict=True)]
    return keys


def _limit_lines(axes: Sequence[str], limits: Limits) -> dict[str, str]:
    return {
        key: repr(float(value))
        for name, keys in _limit_keys(axes).items()
        for key, value in zip(keys, np.atleast_1d(getattr(limits, name)), strict=True)
    }


def _limits_of(file: ColumnFile) -> Limits:
    axes = file.header["axes"].split()
    values: dict[str, Any] = {}
    for name, keys in _limit_keys(axes).items():
        row = [_number(file, key) for key in keys]
        values[name] = row[0] if name in _SCALAR_LIMITS else row
    try:
        return Limits(**values, axes=axes)
    except InputError as error:
        raise InputError(f"{file.path}: {error}") from None


def _origin(file: ColumnFile) -> dict[str, str]:
    return {key: file.header[key] for key in _ORIGIN if key in file.header}


def _number(file: ColumnFile, key: str) -> float:
    text = file.header.get(key, "")
    try:
        return float(text)
    except ValueError:
        raise InputError(f'{file.path}: the header says {key} = "{text}"; it must be a number') from None


def _notes(file: ColumnFile) -> list[str]:
    try:
        notes = json.loads(file.header["notes"])
    except json.JSONDecodeError:
        notes = None
    if not isinstance(notes, list):
        raise InputError(
            f"{file.path}: the header says notes = {file.header['notes']}; it must be a JSON list of texts"
        )
    return [str(note) for note in notes]


def _require_curve(file: ColumnFile, curve: Curve) -> None:
    found = file.header["curve_hash"]
    if found != curve.fingerprint:
        raise InputError(
            f"{file.path}: the table is for the curve {file.header['curve']} (hash {found[:12]}), not for {curve.name} "
            f"(hash {curve.fingerprint[:12]}); give the curve, and the scale and tolerance, it was planned with"
        )


def _require_time_law(file: ColumnFile, columns: Columns, curve: Curve) -> None:
    """Refuse rows that are no function of time from one end of the curve to the other."""
    t, u = columns["t_s"], columns["u"]
    if t.size < 2 or t[0] != 0.0 or not t[-1] > 0.0:
        raise InputError(f"{file.path}: the rows must start at t_s = 0 and last longer than 0 s")
    u0, u1 = curve.domain
    slack = _SAME_PLACE * (u1 - u0)
    step = np.diff(t)
    # A break of the parametrisation has two rows at one time and place, one for either side.
    bad = np.flatnonzero((step < 0.0) | ((step == 0.0) & (np.abs(np.diff(u)) > slack)))
    if bad.size:
        row = int(bad[0]) + 1
        raise InputError(
            f"{file.place(row)}: t_s = {float(t[row])!r} must be greater than {float(t[row - 1])!r}, the one before"
        )
    bad = np.flatnonzero(~((u >= u0) & (u <= u1)))
    if bad.size:
        row = int(bad[0])
        raise InputError(
            f"{file.place(row)}: u = {float(u[row])!r} must lie within [{u0!r}, {u1!r}], the domain of {curve.name}"
        )
    if u[0] > u0 + slack or u[-1] < u1 - slack:
        raise InputError(
            f"{file.path}: the rows run from u = {float(u[0])!r} to {float(u[-1])!r}; {curve.name} runs from {u0!r} to "
            f"{u1!r}"
        )


def _require_agreement(file: ColumnFile, columns: Columns, curve: Curve) -> None:
    """Refuse columns that show another motion than the time law: whoever edits the feed alone changes nothing."""
    u, rate, feed = columns["u"], columns["u_rate"], columns["feed_mm_s"]
    positions = curve.derivatives(u, 0)[0]
    # At a break of the parametrisation a row holds the value of either side.
    sides: tuple[Side, Side] = ("left", "right")
    speeds = [np.sqrt(np.sum(curve.tip.derivatives(u, 1, side=side)[1] ** 2, axis=-1)) * rate for side in sides]
    nearest = np.where(np.abs(speeds[0] - feed) < np.abs(speeds[1] - feed), *speeds)
    expected = {name: positions[:, j] for j, name in enumerate(_axis_columns(curve))}
    expected |= {"s_mm": curve.arclength.s(u), "feed_mm_s": nearest}
    for name, values in expected.items():
        shown, scale = columns[name], float(np.abs(values).max())
        if name not in _ALONG:  # an axis that stands still has no size of its own
            scale += 1e-3 * float(np.abs(positions).max())
        bad = np.flatnonzero(np.abs(shown - values) > _AGREEMENT * scale)
        if bad.size:
            row = int(bad[0])
            raise InputError(
                f"{file.place(row)}: {name} = {float(shown[row])!r} disagrees with the time law, which gives "
                f"{float(values[row])!r}; t_s, u, u_rate and u_acceleration are the plan, the others follow from them"
            )
