"""Samples as target positions of drives in EtherCAT's cyclic synchronous position mode (CiA 402): CSV, one row a cycle.

A row has the target position 0x607A of every axis in increments of the drive, a signed 32-bit integer: the position of the
sample times increments per mm or rad, rounded to the nearest.  It is at most half an increment off, at every row, for each
row is rounded by itself.  The velocity offset 0x60B1, increments per s, is the plan's own velocity then, not a difference
of rows.  There is no torque offset: that takes masses and frictions, which no plan knows.

What rounding does to differences of rows: with half an increment, 1 / (2 S), at each row, a velocity of them is off by up
to 1 / (S T), an acceleration by 2 / (S T^2) and a jerk by 4 / (S T^3); the header says these.  With 1e4 increments per mm
and 1 ms the last is 4e5 mm/s^3, many times what a machine allows; it is noise of half an increment, which a drive's own
position loop sees and its velocity offset does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import BrokenLimitError, InputError
from planner.files.columns import write_columns
from planner.geometry.curve import ROTARY_AXES, Curve
from planner.inputs import positive_number, require_instance
from planner.profile import FeedrateProfile
from planner.samples import Samples
from planner.types import FloatArray
from planner.verify import Report

FORMAT = "feedplan-csp 1"
_INT32 = 2**31
_AT_ONCE = 1 << 18  # rows: bounds the memory of the velocities
_POWERS = range(-9, 1)  # of ten, of the interpolation time
_MAX_PERIODS = 255  # an unsigned byte


def write_cyclic_positions(
    path: str | Path,
    profile: FeedrateProfile,
    samples: Samples,
    increments: Mapping[str, float],
    *,
    report: Report,
    velocity_offset: bool = False,
) -> int:
    """Write samples of a plan as target positions of drives, one row a cycle, whole or not at all.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (also without a suffix) or ``.npz``.
    profile : FeedrateProfile
        The plan.
    samples : Samples
        Those of it.
    increments : mapping of str to float
        Increments per mm, or per rad, of each axis by its name; negative where the drive counts the other way.
    report : Report
        What :func:`~planner.verify.check` says of the samples.
    velocity_offset : bool
        Write 0x60B1 too.

    Returns
    -------
    int
        Number of rows.

    Raises
    ------
    InputError
        If increments of an axis are missing or 0, a count leaves 32 bits, the period is none of 0x60C2, or the file cannot
        be written.
    BrokenLimitError
        If the samples break a limit.  Then no file is written.
    """
    require_instance(profile, FeedrateProfile, "profile")
    require_instance(samples, Samples, "samples")
    require_instance(report, Report, "report")
    if not report.ok:
        raise BrokenLimitError(
            f"{path}: not written: the plan as sampled {report.summary()}; plan again within the limits"
        )
    curve = profile.curve
    factor, cycle = increments_of(curve, increments), interpolation_time(samples.period)
    columns: dict[str, NDArray[Any]] = {"t_s": samples.t}
    for j, axis in enumerate(curve.axes):
        columns[f"{axis}_607A"] = _counts(
            samples.position[:, j], factor[j], axis, curve.axis_units[j], "607A", samples.t
        )
    if velocity_offset:
        velocity = _velocities(profile, samples.t)
        for j, axis in enumerate(curve.axes):
            columns[f"{axis}_60B1"] = _counts(
                velocity[:, j], factor[j], axis, f"{curve.axis_units[j]}/s", "60B1", samples.t
            )
    write_columns(path, _header(curve, samples, factor, cycle, report), columns, {})
    return samples.t.size


def increments_of(curve: Curve, increments: Mapping[str, float]) -> FloatArray:
    """Increments per unit of the axes, (dim,); InputError where one is missing, 0 or not finite."""
    found = np.empty(curve.dim)
    for j, (axis, unit) in enumerate(zip(curve.axes, curve.axis_units, strict=True)):
        if axis not in increments:
            raise InputError(
                f"counts per {unit} of {axis} are missing; give them for each of the axes {' '.join(curve.axes)}"
            )
        value = increments[axis]
        if not np.isfinite(positive_number(abs(value), f"|counts per {unit} of {axis}|")):
            raise InputError(f"counts per {unit} of {axis} = {value!r} must be finite, and not 0")
        found[j] = value
    return found


def interpolation_time(period: float) -> tuple[int, int]:
    """The value and the power of ten of 0x60C2, whose product is the period, s.

    Raises InputError where there are none: the value is a whole number from 1 to 255.
    """
    for power in reversed(_POWERS) if np.isfinite(period) else ():
        value = round(period * 10.0**-power)
        if 1 <= value <= _MAX_PERIODS and abs(value * 10.0**power - period) <= 1e-12 * period:
            return value, power
    raise InputError(
        f"period = {period!r} s is no interpolation time of a drive (0x60C2): that is a whole number from 1 to "
        f"{_MAX_PERIODS} times a power of ten, such as 0.001, 0.00025 or 0.000125 s"
    )


def _counts(values: FloatArray, factor: float, axis: str, unit: str, name: str, t: FloatArray) -> NDArray[np.int64]:
    counts = np.rint(values * factor)
    bad = np.flatnonzero(~((counts >= -_INT32) & (counts < _INT32)))
    if bad.size:
        k = int(bad[0])
        raise InputError(
            f"{axis} = {values[k]:.6g} {unit} at t = {t[k]:.6g} s makes {counts[k]:.0f} increments; 0x{name} holds "
            f"{-_INT32} to {_INT32 - 1}: fewer counts per {'rad' if axis in ROTARY_AXES else 'mm'}"
        )
    return counts.astype(np.int64)


def _velocities(profile: FeedrateProfile, t: FloatArray) -> FloatArray:
    """Velocities of the axes (n, dim) at times of samples; beyond the end a plan stands."""
    out = np.zeros((t.size, profile.curve.dim))
    for first in range(0, t.size, _AT_ONCE):
        some = t[first : first + _AT_ONCE]
        states = profile.at(np.minimum(some, profile.duration))
        rates = profile.curve.derivatives(states.u, 1)[1] * states.u_rate[:, None]
        out[first : first + _AT_ONCE] = np.where((some <= profile.duration)[:, None], rates, 0.0)
    return out


def _header(
    curve: Curve, samples: Samples, factor: FloatArray, cycle: tuple[int, int], report: Report
) -> dict[str, str]:
    named = list(zip(curve.axes, curve.axis_units, factor.tolist(), strict=True))
    noise = {"velocity": (1, "s"), "acceleration": (2, "s2"), "jerk": (4, "s3")}
    bounds = {
        f"rounding_{quantity}_{axis}_{unit}_{suffix}": f"{by / (abs(each) * samples.period ** int(suffix[1:] or 1)):.6g}"
        for quantity, (by, suffix) in noise.items()
        for axis, unit, each in named
    }
    return {
        "format": FORMAT,
        "units": "t_s in s; 607A in increments, 60B1 in increments/s",
        "mode": "8, cyclic synchronous position (0x6060)",
        "curve": " ".join(curve.name.split()),
        "curve_hash": curve.fingerprint,
        "axes": " ".join(curve.axes),
        "period_s": repr(float(samples.period)),
        "interpolation_time_60C2": f"{cycle[0]}, {cycle[1]}",
        **{f"counts_{axis}_per_{unit}": repr(each) for axis, unit, each in named},
        "position_error": "at most half an increment at each row",
        **bounds,
        "verdict": report.summary(),
        "rows": str(samples.t.size),
    }
