"""The feedrate table: a plan as a CSV or NPZ file, written whole and read back bit by bit.

One row is one node of the plan's time law.  Between two rows the curve parameter is the quintic in time that takes
their ``u``, ``u_rate`` and ``u_acceleration``, so these columns and ``t_s`` are the plan; the others show the same
nodes to a person or a controller, and a reader refuses a table in which they disagree.  The header holds the format
version, units, curve and its hash, method, duration, lower bound, what the independent check says of the plan, how it was
asked for (exact stops, periodic), every limit and the number of rows.

Read back, everything that follows from the time law, the curve and the limits is computed again and compared.  What does not
follow (method, status, notes, the lower bound) is the table's own word, and the profile says so.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.files.columns import ColumnFile, Columns, reading, write_columns
from planner.geometry.curve import ROTARY_AXES, Curve
from planner.inputs import require_instance, shorten
from planner.law import TimeLaw
from planner.machine.limits import RAPID, SCALARS, Limits, require_limits
from planner.machine.machine_toml import file_key
from planner.origin import Origin
from planner.output.table_curve import columns_on_curve, require_axes
from planner.output.table_header import (
    OPTIONAL_KEYS,
    notes_of,
    number_of,
    origin_of,
    reserve_lines,
    slowed_of,
    status_of,
    tolerance_lines,
)
from planner.profile import BOUND_TOLERANCE, FeedrateProfile
from planner.quantity import AXIS, limit_names
from planner.samples import Samples
from planner.status import Claim
from planner.types import FloatArray
from planner.verify import Report, check
from planner.verify.findings import BREAKS, HOLDS
from planner.verify.implied_columns import Nodes

_PLAN_FORMAT = "feedplan-table 2"
_SAMPLES_FORMAT = "feedplan-samples 2"
_UNITS = "mm, rad, s; u is the curve parameter, u_rate in 1/s, u_acceleration in 1/s^2"
_TIME_LAW = "between two rows u(t) is the quintic that takes u, u_rate and u_acceleration of both"
_ALONG = {"s_mm": "s", "feed_mm_s": "feed", "acceleration_mm_s2": "acceleration", "jerk_mm_s3": "jerk"}
_KEYS = (
    "format",
    "units",
    "time_law",
    "curve",
    "curve_hash",
    "axes",
    "method",
    "status",
    "exact_stop",
    "periodic",
    "duration_s",
    "lower_bound_s",
    "verdict",
    "limit_names",
    "notes",
    "rows",
)
# Axes that follow from the parameter may differ by what another machine's rounding does, against their largest value.
_AGREEMENT = 1e-9
_AT_REST = 1e-9  # of the largest feed
_SAME_PLACE = 1e-9  # of the domain: what rounding may leave between two rows of one place


def write_table(path: str | Path, profile: FeedrateProfile, limits: Limits, *, report: Report | None = None) -> None:
    """Write a plan as a feedrate table.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (also without a suffix) or ``.npz``.
    profile : FeedrateProfile
    limits : Limits
        Those of the machine, of which the plan may leave a reserve; they go into the header.
    report : Report, optional
        What :func:`~planner.verify.check` says of the plan under these limits; checked here if left out.  A plan that
        breaks a limit is written, and the line ``verdict`` says so.

    Raises
    ------
    InputError
        If the file cannot be written, the suffix is unknown, the plan has a value that is not finite, or the axes of
        the limits are not those of the curve.  Then no file is left behind.
    """
    require_instance(profile, FeedrateProfile, "profile")
    curve = profile.curve
    limits = require_limits(curve, limits)
    if report is not None:
        require_instance(report, Report, "report")
    report = check(curve, limits, profile) if report is None else report
    columns = {**profile.columns(), "binding": profile.binding}
    header = {
        "format": _PLAN_FORMAT,
        "units": _UNITS,
        "time_law": _TIME_LAW,
        **_curve_lines(curve),
        "method": profile.method,
        "status": profile.status.value,
        **{key: "yes" if getattr(profile.origin, key) else "no" for key in ("exact_stop", "periodic")},
        "duration_s": repr(profile.duration),
        "lower_bound_s": repr(float(profile.lower_bound)),
        "verdict": report.summary(),
        **_limit_lines(curve.axes, limits),
        **({"slowed": json.dumps(profile.slowed)} if profile.slowed else {}),
        **tolerance_lines(profile.origin.tolerance),
        **reserve_lines(profile.origin.override_reserve),
        "limit_names": ", ".join(profile.limit_names),
        "notes": json.dumps(profile.notes),
        "rows": str(profile.t.size),
    }
    write_columns(path, header, columns, {"binding": profile.limit_names})


def read_table(path: str | Path, curve: Curve) -> FeedrateProfile:
    """Read a feedrate table back, equal to the plan that was written bit by bit.

    A curve that another machine's rounding made is the same curve: every place of it agrees to 1e-12 of its size, and the
    plan then runs on the curve given.

    Status, notes and origin are what the header says, and ``checked`` what the check said when the table was written.  Its
    lower bound is the table's word, and ``claim`` says so; the work that the plan took stands in no table.

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
        If the file cannot be read, belongs to another curve, is cut off or damaged, has another version, says a thing
        twice, lacks a column or has one too many, holds something else than a finite number where one is due, has times
        that do not increase or parameters that do not reach from end to end of the curve, or shows a column or a header
        line that disagrees with its time law, the curve or its limits.
    """
    require_instance(curve, Curve, "curve")
    wanted = ["t_s", "u", "s_mm", *_axis_columns(curve), *list(_ALONG)[1:], "binding", "u_rate", "u_acceleration"]
    with reading(path, _PLAN_FORMAT, _KEYS) as file:
        header = file.header
        require_axes(file, curve)
        names = limit_names(curve.axes)
        _require_lines(file, {"axes": " ".join(curve.axes), "limit_names": ", ".join(names)})
        limits, origin = _limits_of(file), origin_of(file)
        used = limits.with_reserve(origin.override_reserve) if origin.override_reserve else limits
        written = file.columns(wanted, {"binding": names})
        columns = columns_on_curve(file, written, curve, _axis_columns(curve))
        _require_time_law(file, columns, curve)
        profile = FeedrateProfile(
            curve,
            TimeLaw(*(columns[name] for name in ("t_s", "u", "u_rate", "u_acceleration"))),
            s=columns["s_mm"],
            feed=columns["feed_mm_s"],
            acceleration=columns["acceleration_mm_s2"],
            jerk=columns["jerk_mm_s3"],
            binding=columns["binding"],
            limit_names=names,
            lower_bound=number_of(file, "lower_bound_s"),
            method=header["method"],
            limits=used,
            claim=Claim.TABLE,
            origin=origin,
            status=status_of(file),
            notes=notes_of(file),
            slowed=slowed_of(file, columns["t_s"].size),
            checked=header["verdict"],
        )
        _require_agreement(file, columns, profile, used)
        _require_facts(file, profile)
        file.require_rows(written)
        file.require_only([*_KEYS, *OPTIONAL_KEYS, *(key for keys in _limit_keys(curve.axes).values() for key in keys)])
        return profile


def table_limits(path: str | Path) -> Limits:
    """Read the limits a table was planned for out of its header.

    Raises InputError if the file cannot be read, is no feedrate table, or lacks a limit.
    """
    with reading(path, _PLAN_FORMAT, _KEYS) as file:
        limits = _limits_of(file)
        file.require_only(
            [*_KEYS, *OPTIONAL_KEYS, *(key for keys in _limit_keys(limits.axes).values() for key in keys)]
        )
        return limits


def table_origin(path: str | Path) -> Origin:
    """Read how the plan of a table was asked for, and the tolerance that its curve was made within.

    Raises InputError if the file cannot be read, is no feedrate table, or says something else than is written there.
    """
    with reading(path, _PLAN_FORMAT, _KEYS) as file:
        return origin_of(file)


def write_samples(path: str | Path, curve: Curve, samples: Samples, report: Report) -> None:
    """Write samples, one row a period: ``t_s``, ``u`` and the machine axes, as CSV or NPZ.

    The line ``verdict`` of the header is what the report of the samples says.

    Raises InputError if the file cannot be written; then none is left behind.
    """
    require_instance(curve, Curve, "curve")
    require_instance(samples, Samples, "samples")
    require_instance(report, Report, "report")
    columns: dict[str, NDArray[Any]] = {"t_s": samples.t, "u": samples.u}
    columns |= {name: samples.position[:, j] for j, name in enumerate(_axis_columns(curve))}
    header = {
        "format": _SAMPLES_FORMAT,
        "units": "mm, rad, s; u is the curve parameter",
        **_curve_lines(curve),
        "period_s": repr(float(samples.period)),
        "verdict": report.summary(),
        "rows": str(samples.t.size),
    }
    write_columns(path, header, columns, {})


def _axis_columns(curve: Curve) -> list[str]:
    return [f"{axis}_{unit}" for axis, unit in zip(curve.axes, curve.axis_units, strict=True)]


def _curve_lines(curve: Curve) -> dict[str, str]:
    return {"curve": " ".join(curve.name.split()), "curve_hash": curve.fingerprint, "axes": " ".join(curve.axes)}


def _limit_keys(axes: Sequence[str]) -> dict[str, list[str]]:
    """Header keys of every limit: one each, or one for every axis."""
    keys = {name: [f"limit_{file_key(name)}"] for name in SCALARS}
    units = ["rad" if axis in ROTARY_AXES else "mm" for axis in axes]
    for q in AXIS:
        keys[q.key] = [f"limit_{q.key}_{axis}_{q.suffix(unit)}" for axis, unit in zip(axes, units, strict=True)]
    return keys


def _limit_lines(axes: Sequence[str], limits: Limits) -> dict[str, str]:
    return {
        key: repr(float(value))
        for name, keys in _limit_keys(axes).items()
        for key, value in zip(keys, np.atleast_1d(getattr(limits, name)), strict=True)
        if name != RAPID or np.isfinite(value)
    }


def _limits_of(file: ColumnFile) -> Limits:
    axes = file.header["axes"].split()
    values: dict[str, Any] = {}
    for name, keys in _limit_keys(axes).items():
        if name == RAPID and keys[0] not in file.header:
            continue  # without a limit of their own
        row = [number_of(file, key) for key in keys]
        values[name] = row[0] if name in SCALARS else row
    try:
        return Limits(**values, axes=axes)
    except InputError as error:
        raise InputError(f"{file.path}: {error}") from None


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


def _require_agreement(file: ColumnFile, columns: Columns, profile: FeedrateProfile, limits: Limits) -> None:
    """Refuse columns that show another motion than the time law: whoever edits the feed alone changes nothing."""
    curve = profile.curve
    positions = curve.derivatives(profile.u, 0)[0]
    # An axis that stands still has no size of its own.
    scale = np.abs(positions).max(axis=0) + 1e-3 * np.abs(positions).max()
    for j, name in enumerate(_axis_columns(curve)):
        _require_near(file, name, columns[name], positions[:, j], np.full(profile.t.size, _AGREEMENT * scale[j]))
    nodes = Nodes.of(curve, profile)
    shown = {field: name for name, field in _ALONG.items()}
    for column in nodes.columns():
        _require_near(file, shown[column.name], column.shown, column.expected, column.granted)
    wrong = nodes.misnamed(limits)
    if wrong.size:
        row = int(wrong[0])
        used = {name: float(share[row]) for name, (share, _) in nodes.shares(limits).items()}
        most, named = max(used, key=lambda name: used[name]), profile.limit_names[profile.binding[row]]
        raise InputError(
            f'{file.place(row)}: binding = "{named}" disagrees with the time law: of {most} {100.0 * used[most]:.4g} % is '
            f"used there, of {named} {100.0 * used[named]:.4g} %"
        )


def _require_near(file: ColumnFile, name: str, shown: FloatArray, expected: FloatArray, granted: FloatArray) -> None:
    bad = np.flatnonzero(~(np.abs(shown - expected) <= granted))
    if bad.size:
        row = int(bad[0])
        raise InputError(
            f"{file.place(row)}: {name} = {float(shown[row])!r} disagrees with the time law, which gives "
            f"{float(expected[row])!r}; t_s, u, u_rate and u_acceleration are the plan, the others follow from them"
        )


def _require_lines(file: ColumnFile, further: dict[str, str]) -> None:
    """Refuse a header with other texts than those that are written."""
    for key, text in ({"units": _UNITS, "time_law": _TIME_LAW} | further).items():
        if file.header[key] != text:
            raise InputError(f'{file.path}: the header says {key} = "{shorten(file.header[key])}"; it must be "{text}"')


def _require_facts(file: ColumnFile, profile: FeedrateProfile) -> None:
    """Refuse header lines that contradict the plan."""
    header, feed = file.header, np.abs(profile.feed)
    if header["duration_s"] != repr(profile.duration):
        raise InputError(
            f"{file.path}: the header says duration_s = {shorten(header['duration_s'])}; the rows end at "
            f"t_s = {profile.duration!r}"
        )
    bound = profile.lower_bound
    if not (np.isnan(bound) or 0.0 <= bound <= profile.duration * (1.0 + BOUND_TOLERANCE)):
        raise InputError(
            f"{file.path}: the header says lower_bound_s = {bound!r}; it must be nan, or lie within [0, "
            f"{profile.duration!r}], the duration"
        )
    if not header["verdict"].startswith((HOLDS, BREAKS)):
        raise InputError(
            f'{file.path}: the header says verdict = "{shorten(header["verdict"])}"; it must begin with "{HOLDS}" or '
            f'"{BREAKS}"'
        )
    rest = _AT_REST * float(feed.max())
    if profile.origin.periodic and not abs(feed[0] - feed[-1]) <= 1e3 * rest:
        raise InputError(
            f"{file.path}: the header says periodic = yes, but the feed is {feed[0]:.9g} mm/s at the start and "
            f"{feed[-1]:.9g} mm/s at the end"
        )
    if profile.origin.exact_stop:
        jumps = [b.u for b in profile.curve.breaks if b.is_curvature_jump]
        passed = next((u for u in jumps if feed[np.argmin(np.abs(profile.u - u))] > rest), None)
        if passed is not None:
            raise InputError(
                f"{file.path}: the header says exact_stop = yes, but the plan does not stop at u = {passed:.9g}, where the "
                "curvature jumps"
            )
