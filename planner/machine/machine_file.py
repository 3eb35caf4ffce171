"""Machine files (TOML, or the INI of a LinuxCNC machine) and the example machines by name."""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from planner.data import data_text
from planner.errors import InputError
from planner.geometry.curve import AXES, ROTARY_AXES
from planner.inputs import read_text, shorten
from planner.machine.limits import DEFAULT_PERIOD, PERIOD, RAPID, SCALARS, Limits
from planner.machine.linuxcnc_ini import machine_table
from planner.quantity import AXIS, FEED, QUANTITIES

EXAMPLE_MACHINES = ("mill", "five-axis")
_NAME = "name"  # key of an axis


def load_limits(path: str | Path) -> Limits:
    """Load a machine file (TOML, or the INI of a LinuxCNC machine), or one of the example machines by name.

    Keys: ``feed_mm_s``, ``rapid_mm_s``, ``chord_error_mm``, ``period_s``, ``tangential_acceleration_mm_s2``,
    ``tangential_jerk_mm_s3``, and one ``[[axis]]`` each with ``name``, ``velocity_mm_s``, ``acceleration_mm_s2``,
    ``jerk_mm_s3`` (``_rad_s``, ``_rad_s2``, ``_rad_s3`` for the rotary axes A, B, C).  ``inf`` means no limit.
    For what is read of an INI file see :mod:`planner.machine.linuxcnc_ini`.

    Parameters
    ----------
    path : str or Path
        A ``.toml`` or ``.ini`` file, or one of :data:`EXAMPLE_MACHINES`.

    Returns
    -------
    Limits

    Raises
    ------
    InputError
        Naming the file, the key, its value and what is allowed.
    """
    if path == "":
        raise InputError(
            f"machine '' must be a file, .toml or .ini, or an example machine: {', '.join(EXAMPLE_MACHINES)}"
        )
    if isinstance(path, str) and path in EXAMPLE_MACHINES:
        text = data_text(f"machines/{path}.toml")
        return _limits_from_toml(text, path)
    try:
        text = read_text(path, InputError)
    except InputError as error:
        if isinstance(path, str) and not Path(path).suffix:
            raise InputError(f"{error}; the example machines are {', '.join(EXAMPLE_MACHINES)}") from None
        raise
    if Path(path).suffix.lower() == ".ini":
        return _limits_from_table(machine_table(text, str(path)), str(path))
    return _limits_from_toml(text, str(path))


def _limits_from_toml(text: str, where: str) -> Limits:
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not a valid TOML file ({error})") from None
    return _limits_from_table(table, where)


def _limits_from_table(table: dict[str, Any], where: str) -> Limits:
    axes = table.pop("axis", [])
    head = _checked(table, HEAD_KEYS, where, "")
    if not isinstance(axes, list) or not axes or not all(isinstance(axis, dict) for axis in axes):
        raise InputError(
            f'{where}: one "[[axis]]" table for each axis is needed, with name, velocity, acceleration and jerk'
        )
    rows: list[dict[str, Any]] = []
    for i, axis in enumerate(axes):
        name = axis.get("name")
        known = isinstance(name, str) and name in AXES
        length = "rad" if known and name in ROTARY_AXES else "mm"
        found = _checked(axis, axis_keys(length), where, f"axis[{i}] ({name})" if known else f"axis[{i}]")
        rows.append({_NAME: name} | {q.key: found[q.file_key(length)] for q in AXIS})
    names = [row[_NAME] for row in rows]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f'{where}: axis "{twice[0]}" is given twice')
    single = {name: head[file_key(name)] for name in SCALARS}
    of_axes: dict[str, Any] = {q.key: [row[q.key] for row in rows] for q in AXIS}
    try:
        return Limits(**single, **of_axes, axes=names)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _checked(table: Mapping[str, Any], keys: Mapping[str, float], where: str, place: str) -> dict[str, Any]:
    """Values of a table of a machine file; ``keys`` are those it may have, each with its default, nan for required."""
    label = f"{place}.{{}}".format if place else "{}".format
    # A misspelt key is both unknown and missing; the unknown one is what the person wrote.
    for key in table:
        if key not in keys:
            raise InputError(f'{where}: unknown key "{label(key)}"; the keys are {", ".join(keys)}')
    found: dict[str, Any] = {}
    for key, default in keys.items():
        value = table.get(key, default)
        if key not in table and math.isnan(default):
            raise InputError(f'{where}: "{label(key)}" is missing; the keys are {", ".join(keys)}')
        if key == _NAME:
            if not isinstance(value, str) or value not in AXES:
                raise InputError(f"{where}: {label(key)} = {shorten(repr(value))} must be one of {', '.join(AXES)}")
        elif not _is_positive(value, finite=key == file_key(PERIOD)):
            allowed = "a finite number > 0" if key == file_key(PERIOD) else "a number > 0; use inf for no limit"
            raise InputError(f"{where}: {label(key)} = {shorten(repr(value))} must be {allowed}")
        found[key] = value if key == _NAME else float(value)
    return found


def _is_positive(value: object, *, finite: bool) -> bool:
    """Whether a value of a file is a number above zero: no text, no truth value, nothing that a double cannot hold."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        return False
    if isinstance(value, int):
        return value <= sys.float_info.max
    return not (finite and math.isinf(value))


def axis_keys(length: str) -> dict[str, float]:
    """Keys of an axis in mm or rad, all of them required."""
    return dict.fromkeys((_NAME, *(q.file_key(length) for q in AXIS)), math.nan)


def file_key(name: str) -> str:
    """Key in a machine file of what is one number, which names its unit: ``feed_mm_s``, ``period_s``."""
    keys = {q.key: q.file_key() for q in QUANTITIES} | {PERIOD: f"{PERIOD}_s", RAPID: f"{RAPID}_{FEED.suffix()}"}
    return keys[name]


HEAD_KEYS = {
    file_key(name): math.nan if name in {q.key for q in QUANTITIES if q.required} else math.inf
    for name in (FEED.key, RAPID, *SCALARS)
} | {file_key(PERIOD): DEFAULT_PERIOD}
"""Keys of the head of a machine file, each with its default; nan for what is required."""
